//! Where volumes come from: files, folders, and the specimens, which are made once and kept in a cache.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};
use fabrica_engine::read::limits::Limits;
use fabrica_engine::read::{ReadOptions, read_volume};
use fabrica_engine::selection::{from_label_maps, write_segmentation};
use fabrica_engine::specimen::{self, Request};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume_out::write_nrrd;
use fabrica_engine::{Error, Progress};

use crate::memory;

/// What a template or a command line calls a volume.
#[derive(Clone, Debug, PartialEq)]
pub enum VolumeSource {
    /// A file or folder.
    Path(PathBuf),
    /// A specimen: its name, resolution and variant.
    Specimen(Request),
}

impl VolumeSource {
    /// "specimen:NAME[@N][,VARIANT]" (see [`specimen::Variant`]), or a path, which counts from `base` unless it is absolute.
    ///
    /// # Errors
    /// A sentence for a resolution that is no number and for words that are no variant.
    pub fn parse(text: &str, base: &Path) -> Result<Self> {
        let Some(specimen) = text.strip_prefix("specimen:") else { return Ok(Self::Path(base.join(text))) };
        Ok(Self::Specimen(Request::parse(specimen)?))
    }

    /// Reads or makes the volume.
    ///
    /// # Errors
    /// One sentence from the reader or the specimen.
    pub fn load(&self, options: &ReadOptions, progress: &Progress) -> Result<Arc<Volume>> {
        let volume = match self {
            Self::Path(path) => read_volume(path, &within_memory(options), progress)?,
            Self::Specimen(_)
                if (ReadOptions { limits: Limits::default(), ..options.clone() }) != ReadOptions::default() =>
            {
                bail!(
                    "a specimen is one volume, as large as its name says: it has no layout, series, frame or part; leave these out"
                )
            }
            Self::Specimen(request) => load_specimen(request, progress)?,
        };
        Ok(Arc::new(volume))
    }
}

/// The options with what is free as the limit, where they have none of their own.
pub(super) fn within_memory(options: &ReadOptions) -> ReadOptions {
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

/// The name of a specimen's file in the cache. The variant's text is canonical, and what is put for `/` and `,` occurs
/// nowhere else in it, so no two variants share a file.
fn cache_name(request: &Request) -> String {
    let Request { name, resolution, variant } = request;
    let version = specimen::version(name);
    if variant.is_plain() {
        return format!("specimen-{name}-{resolution}-v{version}.nrrd");
    }
    let mut words = variant.to_string().replace('/', "~").replace(',', "_");
    // File names have an end; a list of structures need not.
    if words.len() > 120 {
        let hash =
            words.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        words = format!("{hash:016x}");
    }
    format!("specimen-{name}-{resolution}-{words}-v{version}.nrrd")
}

fn load_specimen(request: &Request, progress: &Progress) -> Result<Volume> {
    // The name goes into a file name only once the engine knows it.
    request.check()?;
    let file = cache_folder().map(|folder| folder.join(cache_name(request)));
    if let Some(file) = &file
        && file.exists()
    {
        match read_volume(file, &ReadOptions::default(), progress) {
            Ok(volume) => return Ok(as_specimen(volume, request)),
            Err(Error::Cancelled) => return Err(Error::Cancelled.into()),
            // A damaged cache is made again.
            Err(_) => {}
        }
    }
    let made = request.generate(progress)?;
    if let Some(file) = &file {
        // No cache (a full disk, a read-only home) only costs the next run its time.
        let _ = file.parent().map(std::fs::create_dir_all);
        let _ = write_nrrd(file, &made.volume);
    }
    Ok(as_specimen(made.volume, request))
}

/// The file of a specimen's structures in the cache, made if it is not there; none where there is no cache.
///
/// # Errors
/// One sentence from the specimen.
pub fn cached_structures(request: &Request, progress: &Progress) -> Result<Option<PathBuf>> {
    request.check()?;
    let Some(folder) = cache_folder() else { return Ok(None) };
    let file = folder.join(cache_name(request).replace(".nrrd", "-structures.seg.nrrd"));
    if !file.exists() {
        let made = from_label_maps(&[request.generate(progress)?.labels], &Arc::default(), progress)?;
        // No cache (a full disk, a read-only home) only costs the next run its time.
        let _ = std::fs::create_dir_all(&folder);
        if write_segmentation(&file, &made, progress).is_err() {
            return Ok(None);
        }
    }
    Ok(Some(file))
}

fn as_specimen(mut volume: Volume, request: &Request) -> Volume {
    "specimen".clone_into(&mut volume.format);
    volume.modality = request.modality();
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
            VolumeSource::Specimen(Request::plain("head", 96))
        );
        assert_eq!(VolumeSource::parse("a/b.nii", base).unwrap(), VolumeSource::Path("/figures/a/b.nii".into()));
        assert_eq!(VolumeSource::parse("/c.nii", base).unwrap(), VolumeSource::Path("/c.nii".into()));
        assert!(VolumeSource::parse("specimen:head@many", base).is_err());
        assert!(VolumeSource::parse("specimen:head,tall", base).is_err());
    }

    #[test]
    fn every_variant_has_a_file_of_its_own() {
        let name = |text: &str| cache_name(&Request::parse(text).unwrap());
        assert_eq!(name("head@64"), format!("specimen-head-64-v{}.nrrd", specimen::version("head")));
        let many = format!("head,without={}", (0..40).map(|i| format!("part-{i}")).collect::<Vec<_>>().join("+"));
        let texts = [
            "head",
            "head,mr",
            "head,mirrored",
            "head,turn=1/2/3",
            "head,turn=12/0/3",
            "head,turn=-1/2/3",
            "head,size=1.15",
            "head,noise=1.15",
            "head,without=skin+fat",
            "head,without=skin-fat",
            &many,
            &format!("{many}0"),
        ];
        let mut names: Vec<String> = texts.iter().map(|text| name(text)).collect();
        assert!(names.iter().all(|n| n.len() < 200 && !n.contains(['/', ',', ':'])));
        names.sort();
        names.dedup();
        assert_eq!(names.len(), texts.len());
        assert_eq!(name("head,mr,size=2"), name("head, size=2.0, mr"));
    }
}
