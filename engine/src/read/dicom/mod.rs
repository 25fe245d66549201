//! DICOM: files, series in folders and trees of folders, multi-frame and enhanced objects, segmentations.
//!
//! - `file`, `elements`, `syntax`: a header, of which only what is known by name is kept
//! - `image`, `slices`: what it says about pixels, places and values
//! - `folder`, `series`: which files there are, and which belong together
//! - `geometry`: slices in order, in an even stack
//! - `frames`, `codec`, `voxels`, `assemble`: pixels
//! - `segmentation`: label maps
//!
//! The world is LPS and becomes RAS. **Nothing of a header leaves this folder but geometry, modality, series description and,
//! of segmentations, names, colors and codes of structures**: no identifier is in a key, a sentence or a volume.

mod assemble;
mod codec;
mod elements;
mod file;
mod folder;
mod frames;
mod geometry;
mod image;
mod segmentation;
mod series;
mod slices;
mod syntax;
#[cfg(test)]
mod tests;
mod voxels;

use std::path::Path;

use super::{Entry, ReadOptions, VolumeReader, check_frame};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::labels::LabelMap;
use crate::volume::{Rescale, Volume, Voxels};

use file::{DicomFile, Unusable};
use image::Image;
use series::{Found, Stack};

/// Reads DICOM files and folders of them.
pub struct DicomReader;

impl VolumeReader for DicomReader {
    fn name(&self) -> &'static str {
        "DICOM"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["dcm", "dicom", "ima"]
    }

    fn recognizes(&self, path: &Path, head: &[u8]) -> bool {
        if head.is_empty() { path.is_dir() && folder::has_dicom(path) } else { file::is_dicom(head) }
    }

    fn survey(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<Entry>> {
        let opened = Opened::open(path, progress)?;
        if let Some(error) = options.series.as_deref().and_then(|wanted| opened.fault_of(wanted)) {
            return Err(error);
        }
        // A scout view does not stand for the series that it was made for.
        let is_more = |s: &Stack| s.segmentation.is_some() || (!s.entry.is_localizer && s.entry.grid.dims()[2] > 2);
        let has_more = opened.found.stacks.iter().any(is_more);
        if opened.found.stacks.is_empty() || (!has_more && !opened.found.faults.is_empty() && !opened.is_file) {
            return Err(opened.fault(path));
        }
        Ok(opened.found.stacks.into_iter().map(|s| s.entry).collect())
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        let opened = Opened::open(path, progress)?;
        let (index, mut notes) = opened.choose(path, options)?;
        let stack = &opened.found.stacks[index];
        check_frame(path, options.frame, stack.entry.num_frames)?;
        let window = options.window.on(path, stack.entry.grid.dims())?;
        if let Some(file) = stack.segmentation {
            let layers = segmentation::layers(&opened.files[file], options.window, progress)?;
            return labels_as_volume(path, stack, layers, window, notes);
        }
        let mut volume = assemble::volume(path, &opened.files, stack, options.frame, window, progress)?;
        notes.append(&mut volume.warnings);
        volume.warnings = notes;
        Ok(volume)
    }

    fn read_labels(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<LabelMap>> {
        let opened = Opened::open(path, progress)?;
        let (index, _) = opened.choose(path, options)?;
        let stack = &opened.found.stacks[index];
        if let Some(file) = stack.segmentation {
            return segmentation::layers(&opened.files[file], options.window, progress);
        }
        let volume = self.read(path, options, progress)?;
        let remedy = "open it as a volume, or name a DICOM segmentation";
        Ok(vec![LabelMap::from_volume(&volume).map_err(|what| Error::file(path, what, remedy))?])
    }
}

/// The files that a path stands for, and the volumes in them.
struct Opened {
    files: Vec<DicomFile>,
    found: Found,
    /// Whether the path is that of one file.
    is_file: bool,
}

impl Opened {
    fn open(path: &Path, progress: &Progress) -> Result<Self> {
        if !path.is_dir() {
            return Self::open_file(path, progress);
        }
        let folder::Gathered { files, damaged } = folder::open_all(folder::list(path, true, progress)?, progress)?;
        let mut found = series::find(path, &files);
        found.damaged.extend(damaged);
        Ok(Self { files, found, is_file: false })
    }

    /// A file that holds one slice stands for the series that it belongs to, as far as it lies in the same folder.
    fn open_file(path: &Path, progress: &Progress) -> Result<Self> {
        let file = DicomFile::open(path).map_err(|unusable| match unusable {
            Unusable::Faulty(error) => error,
            Unusable::NotDicom => not_dicom(path),
        })?;
        let image = Image::of(&file)?;
        let is_alone = image.num_frames > 1 || image::is_segmentation(&file);
        let mut files = vec![file];
        let mut damaged = Vec::new();
        if let (false, Some(parent)) = (is_alone, path.parent()) {
            let parent = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
            // The named file comes first, so that of two copies it is the one that counts.
            let others = folder::list(parent, false, progress).unwrap_or_default();
            let name = path.file_name();
            let others = others.into_iter().filter(|p| p.file_name() != name).collect();
            let gathered = folder::open_all(others, progress)?;
            let series = |f: &DicomFile| f.elements.word(dicom_dictionary_std::tags::SERIES_INSTANCE_UID);
            let own = series(&files[0]);
            files.extend(gathered.files.into_iter().filter(|f| series(f) == own));
            damaged = gathered.damaged;
        }
        let mut found = series::find(path, &files);
        // Of the series, the stack that the file is in.
        let is_of_file = |stack: &Stack| {
            stack.segmentation == Some(0) || stack.slices.frames.iter().flatten().any(|slice| slice.file == 0)
        };
        found.stacks.retain(is_of_file);
        found.damaged.extend(damaged);
        Ok(Self { files, found, is_file: true })
    }

    /// The stack of the entry that was chosen, and what to say about the others that are not in the survey.
    fn choose(&self, path: &Path, options: &ReadOptions) -> Result<(usize, Vec<String>)> {
        let stacks = &self.found.stacks;
        let mut notes = Vec::new();
        if !self.found.damaged.is_empty() {
            let n = self.found.damaged.len();
            let files =
                if n == 1 { "1 damaged DICOM file was".to_owned() } else { format!("{n} damaged DICOM files were") };
            notes.push(format!("{files} left out."));
        }
        let num_refused = self.found.faults.len();
        if num_refused > 0 {
            let series = if num_refused == 1 { "1 series was" } else { "Several series were" };
            notes.push(format!("{series} left out, as no volume can be made of it: {}.", self.fault(path)));
        }
        let index = match options.series.as_deref() {
            Some(key) => stacks.iter().position(|s| s.entry.key == key),
            None => Some(0).filter(|_| stacks.len() == 1),
        };
        Ok((index.ok_or_else(|| self.fault(path))?, notes))
    }

    /// Why no volume can be made of the series that is called so, if none can.
    fn fault_of(&self, wanted: &str) -> Option<Error> {
        let part = wanted.trim().to_lowercase();
        let has_part = |text: &str| !part.is_empty() && text.to_lowercase().contains(&part);
        if self.found.stacks.iter().any(|s| has_part(&s.entry.key) || has_part(&s.entry.title)) {
            return None;
        }
        self.found.faults.iter().find(|(title, _)| has_part(title)).map(|(_, error)| copy_of(error))
    }

    /// Why there is nothing to read.
    fn fault(&self, path: &Path) -> Error {
        let faults = self.found.faults.iter().map(|(_, e)| e);
        let first = faults.chain(&self.found.damaged).chain(&self.found.without_pixels).next();
        first.map_or_else(|| Error::file(path, "it has no DICOM picture", "name the folder of the slices"), copy_of)
    }
}

fn copy_of(error: &Error) -> Error {
    match error {
        Error::File { what, remedy, path } => Error::file(path, what.clone(), remedy.clone()),
        _ => Error::Cancelled,
    }
}

fn not_dicom(path: &Path) -> Error {
    // What is named .dcm and packed as a whole.
    if super::stream::ByteSource::open(path).is_ok_and(|source| source.is_gzip()) {
        Error::file(path, "this DICOM file is compressed with gzip", "decompress it first")
    } else {
        Error::file(
            path,
            "this is no DICOM file: neither a preamble nor a data set begins it",
            "check what the file is",
        )
    }
}

/// The first layer of a segmentation as a volume: the numbers of its structures.
fn labels_as_volume(
    path: &Path,
    stack: &Stack,
    layers: Vec<LabelMap>,
    window: super::window::OnGrid,
    mut notes: Vec<String>,
) -> Result<Volume> {
    if layers.len() > 1 {
        notes.push(format!("Its structures overlap: of {} layers this is the first.", layers.len()));
    }
    let Some(layer) = layers.into_iter().next() else {
        return Err(Error::file(path, "the segmentation has no structures", "choose another file"));
    };
    let ids: Vec<u16> = layer.labels.iter().map(|l| u16::try_from(l.id).unwrap_or(u16::MAX)).collect();
    let numbers = layer.voxels.iter().map(|v| ids.get(usize::from(*v)).copied().unwrap_or(0));
    let voxels = if ids.iter().all(|id| *id < 256) {
        Voxels::U8(numbers.map(|n| n as u8).collect())
    } else {
        Voxels::U16(numbers.collect())
    };
    super::volume_of(path, &stack.entry, window, voxels, Rescale::IDENTITY, notes)
}
