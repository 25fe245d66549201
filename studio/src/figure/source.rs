//! Where volumes come from: files, folders, and the specimens, which are made once and kept in a cache.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};
use fabrica_engine::read::limits::Limits;
use fabrica_engine::read::{ReadOptions, read_volume};
use fabrica_engine::specimen;
use fabrica_engine::volume::{Modality, Volume};
use fabrica_engine::volume_out::write_nrrd;
use fabrica_engine::{Error, Progress};

use crate::memory;

/// What a template or a command line calls a volume.
#[derive(Clone, Debug, PartialEq)]
pub enum VolumeSource {
    /// A file or folder.
    Path(PathBuf),
    /// A specimen and its number of voxels along the longest axis.
    Specimen {
        /// "head".
        name: String,
        /// Voxels along the longest axis.
        resolution: usize,
    },
}

impl VolumeSource {
    /// "specimen:NAME", "specimen:NAME@N", or a path, which counts from `base` unless it is absolute.
    ///
    /// # Errors
    /// A sentence for a resolution that is no number.
    pub fn parse(text: &str, base: &Path) -> Result<Self> {
        let Some(specimen) = text.strip_prefix("specimen:") else { return Ok(Self::Path(base.join(text))) };
        let (name, resolution) = match specimen.split_once('@') {
            None => (specimen, specimen::DEFAULT_RESOLUTION),
            Some((name, digits)) => match digits.parse() {
                Ok(n) => (name, n),
                Err(_) => bail!("\"{text}\" has no number of voxels after the @; write for example specimen:head@128"),
            },
        };
        Ok(Self::Specimen { name: name.to_owned(), resolution })
    }

    /// Reads or makes the volume.
    ///
    /// # Errors
    /// One sentence from the reader or the specimen.
    pub fn load(&self, options: &ReadOptions, progress: &Progress) -> Result<Arc<Volume>> {
        let volume = match self {
            Self::Path(path) => read_volume(path, &within_memory(options), progress)?,
            Self::Specimen { .. } if options.raw.is_some() || options.frame > 0 => {
                bail!("a specimen has one frame and no raw layout; leave --raw and --frame out")
            }
            Self::Specimen { name, resolution } => load_specimen(name, *resolution, progress)?,
        };
        Ok(Arc::new(volume))
    }
}

/// The options with what is free as the limit, where they have none of their own.
fn within_memory(options: &ReadOptions) -> ReadOptions {
    let bytes = options.limits.bytes.or_else(memory::free_bytes);
    ReadOptions { limits: Limits { bytes, ..options.limits }, ..options.clone() }
}

/// The folder for what can be made again: `FABRICA_CACHE`, else the platform's cache folder.
fn cache_folder() -> Option<PathBuf> {
    std::env::var_os("FABRICA_CACHE")
        .filter(|v| !v.is_empty())
        .map(PathBuf::from)
        .or_else(|| Some(directories::ProjectDirs::from("", "", "fabrica")?.cache_dir().to_owned()))
}

fn load_specimen(name: &str, resolution: usize, progress: &Progress) -> Result<Volume> {
    // The name goes into a file name only once the engine knows it.
    let file = specimen::NAMES
        .contains(&name)
        .then(cache_folder)
        .flatten()
        .map(|folder| folder.join(format!("specimen-{name}-{resolution}-v{}.nrrd", specimen::version(name))));
    if let Some(file) = &file
        && file.exists()
    {
        match read_volume(file, &ReadOptions::default(), progress) {
            Ok(volume) => return Ok(as_specimen(volume)),
            Err(Error::Cancelled) => return Err(Error::Cancelled.into()),
            // A damaged cache is made again.
            Err(_) => {}
        }
    }
    let made = specimen::generate(name, resolution, progress)?;
    if let Some(file) = &file {
        // No cache (a full disk, a read-only home) only costs the next run its time.
        let _ = file.parent().map(std::fs::create_dir_all);
        let _ = write_nrrd(file, &made.volume);
    }
    Ok(as_specimen(made.volume))
}

fn as_specimen(mut volume: Volume) -> Volume {
    "specimen".clone_into(&mut volume.format);
    volume.modality = Modality::Ct;
    volume.source = None;
    volume
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_parse() {
        let base = Path::new("/figures");
        assert_eq!(
            VolumeSource::parse("specimen:head@96", base).unwrap(),
            VolumeSource::Specimen { name: "head".into(), resolution: 96 }
        );
        assert_eq!(VolumeSource::parse("a/b.nii", base).unwrap(), VolumeSource::Path("/figures/a/b.nii".into()));
        assert_eq!(VolumeSource::parse("/c.nii", base).unwrap(), VolumeSource::Path("/c.nii".into()));
        assert!(VolumeSource::parse("specimen:head@many", base).is_err());
    }
}
