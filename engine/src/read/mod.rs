//! Volume files: one entry point for every format, [`read_volume`].
//!
//! A format is one [`VolumeReader`] in one file, listed in [`READERS`]; callers never name it. Which one reads a
//! file is decided by content first and by the name only where the content says nothing (raw voxels, a damaged
//! header that shall get its own sentence). Every reader delivers RAS millimeters, voxels in the stored type,
//! and checks sizes against the file before it allocates.

pub mod nifti;
pub mod nrrd;
pub mod raw;
mod stream;
#[cfg(test)]
mod testing;

use std::path::Path;

use glam::DAffine3;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;
use crate::volume::{Rescale, Volume, Voxels};

use stream::ByteSource;

/// What the caller may choose about reading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// Which frame (time point, component) of a file with several, from 0.
    pub frame: usize,
    /// Read the file as plain voxels in this layout, whatever its content or name.
    pub raw: Option<raw::RawLayout>,
}

/// A file format, or a way in which volumes lie in a folder.
pub trait VolumeReader: Sync {
    /// The format's name for users ("NIfTI").
    fn name(&self) -> &'static str;

    /// Endings of file names, lower case, without the first dot, that promise this format where the content is
    /// not recognized. An added `.gz` needs no entry.
    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    /// Whether the *content* is this format: `head` has the first [`HEAD_BYTES`] bytes (fewer if the file is
    /// shorter), decompressed if the file is gzip. For a folder it is empty and `path` is all there is to look at.
    fn recognizes(&self, path: &Path, head: &[u8]) -> bool;

    /// Reads one volume: RAS mm, voxels as stored.
    ///
    /// # Errors
    /// [`Error::File`] with a sentence for every fault of the file, [`Error::Cancelled`] on request.
    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume>;
}

/// How much of a file [`VolumeReader::recognizes`] gets to see.
pub const HEAD_BYTES: usize = 4096;

/// The formats, asked in this order.
static READERS: [&dyn VolumeReader; 3] = [&nifti::NiftiReader, &nrrd::NrrdReader, &raw::RawReader];

/// Reads a volume from a file or folder of any known format.
///
/// The work shows as the stage "reading" in decoded bytes and stops at [`Progress::cancel`].
///
/// # Errors
/// [`Error::File`] with one sentence for the user if the path does not exist, no format fits, the file is
/// damaged or holds no scalar volume, or there is no such frame; [`Error::Cancelled`] on request.
pub fn read_volume(path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
    progress.check()?;
    let mut volume = reader_for(path, options)?.read(path, options, progress)?;
    volume.source = Some(path.to_owned());
    Ok(volume)
}

fn reader_for(path: &Path, options: &ReadOptions) -> Result<&'static dyn VolumeReader> {
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, &e))?;
    if metadata.is_dir() {
        return READERS.iter().copied().find(|r| r.recognizes(path, &[])).ok_or_else(|| {
            Error::file(path, "this is a folder without a volume that Fabrica knows", "name a file in it")
        });
    }
    if !metadata.is_file() {
        return Err(Error::file(path, "this is neither a file nor a folder", "name a volume file"));
    }
    if metadata.len() == 0 {
        return Err(Error::file(path, "the file is empty", "copy or download it again"));
    }
    if options.raw.is_some() {
        return Ok(&raw::RawReader);
    }
    // A damaged gzip file still has a name by which a reader is found, which then says what is wrong.
    let head = ByteSource::open(path)?.read_up_to(HEAD_BYTES).unwrap_or_default();
    if let Some(reader) = READERS.iter().find(|r| r.recognizes(path, &head)) {
        return Ok(*reader);
    }
    if let Some(program) = foreign_compression(&head) {
        return Err(Error::file(
            path,
            format!("the file is compressed with {program}, which Fabrica does not read"),
            "decompress it first, or compress it with gzip",
        ));
    }
    if let Some(format) = not_read_yet(path, &head) {
        return Err(Error::file(
            path,
            format!("this is a {format} file, which Fabrica does not read yet"),
            "convert it to NIfTI or NRRD (dcm2niix, 3D Slicer and ITK-SNAP can)",
        ));
    }
    READERS.iter().copied().find(|r| r.extensions().iter().any(|e| has_extension(path, e))).ok_or_else(|| {
        let formats: Vec<_> =
            READERS.iter().map(|r| format!("{} (.{})", r.name(), r.extensions().join(", ."))).collect();
        Error::file(
            path,
            format!("this is no volume in a format that Fabrica reads: {}", formats.join(", ")),
            format!("convert it, or describe plain voxels with {}", raw::EXAMPLE),
        )
    })
}

/// A format of the field that has no reader yet.
fn not_read_yet(path: &Path, head: &[u8]) -> Option<&'static str> {
    let named = |extensions: &[&str]| extensions.iter().any(|e| has_extension(path, e));
    if head.get(128..132) == Some(b"DICM") || named(&["dcm", "dicom", "ima"]) {
        Some("DICOM")
    } else if head.starts_with(b"ObjectType") || head.starts_with(b"NDims") || named(&["mha", "mhd"]) {
        Some("MetaImage")
    } else if head.starts_with(b"II*\0") || head.starts_with(b"MM\0*") || named(&["tif", "tiff"]) {
        Some("TIFF")
    } else {
        None
    }
}

/// The program behind a compressed file that is not gzip, from its first bytes.
fn foreign_compression(head: &[u8]) -> Option<&'static str> {
    const MAGICS: [(&[u8], &str); 5] = [
        (b"BZh", "bzip2"),
        (b"\xfd7zXZ\0", "xz"),
        (b"\x28\xb5\x2f\xfd", "zstd"),
        (b"PK\x03\x04", "zip"),
        (b"7z\xbc\xaf\x27\x1c", "7-Zip"),
    ];
    MAGICS.iter().find(|(magic, _)| head.starts_with(magic)).map(|(_, program)| *program)
}

/// Whether the name ends in `.extension` or `.extension.gz`, in any case.
fn has_extension(path: &Path, extension: &str) -> bool {
    let Some(name) = path.file_name() else { return false };
    let name = name.to_string_lossy().to_lowercase();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    name.strip_suffix(extension).is_some_and(|stem| stem.ends_with('.'))
}

/// What every reader knows at the end.
struct Parts<'a> {
    path: &'a Path,
    grid: Grid,
    voxels: Voxels,
    rescale: Rescale,
    format: &'a str,
    num_frames: usize,
    warnings: Vec<String>,
}

impl Parts<'_> {
    fn into_volume(self) -> Result<Volume> {
        let mut volume = Volume::new(self.grid, self.voxels, self.rescale, self.format)
            .map_err(|what| Error::file(self.path, what, "write the file again"))?;
        volume.num_frames = self.num_frames;
        volume.warnings = self.warnings;
        Ok(volume)
    }
}

/// The grid, with the fault as a sentence about the file.
fn grid_of(path: &Path, dims: [u64; 3], world_from_index: DAffine3) -> Result<Grid> {
    let [x, y, z] = dims.map(|n| usize::try_from(n).unwrap_or(usize::MAX));
    Grid::new([x, y, z], world_from_index)
        .map_err(|what| Error::file(path, what, "correct the header with the program that wrote it"))
}

/// Refuses a frame that the file does not have.
fn check_frame(path: &Path, frame: usize, num_frames: usize) -> Result<()> {
    if frame < num_frames {
        return Ok(());
    }
    let (what, remedy) = if num_frames == 1 {
        (format!("there is no frame {frame}: the file has 1 frame"), "leave the frame out".to_owned())
    } else {
        let last = num_frames - 1;
        (format!("there is no frame {frame}: the file has {num_frames} frames"), format!("choose 0 to {last}"))
    };
    Err(Error::file(path, what, remedy))
}

/// The sentence for a header whose sizes multiply to more than a file can be.
fn absurd_size(path: &Path, dims: &[u64]) -> Error {
    let dims: Vec<_> = dims.iter().map(u64::to_string).collect();
    Error::file(
        path,
        format!("the header promises {} voxels, more than any file holds", dims.join(" x ")),
        "the header is damaged: copy or download it again",
    )
}

#[cfg(test)]
mod tests {
    use super::testing::{ElementType, Endian, Folder, NiftiFile, Phantom, gzip};
    use super::*;

    #[test]
    fn content_decides_before_the_name() {
        let folder = Folder::new();
        let nifti = NiftiFile::new(1, &Phantom::oriented("RAS"), ElementType::U8, Endian::Little).bytes();
        // Compressed although the name does not say so, uncompressed although it does, no or a wrong ending.
        for (name, bytes) in [
            ("a.nii", gzip(&nifti)),
            ("a.nii.gz", nifti.clone()),
            ("a", nifti.clone()),
            ("a.nrrd", gzip(&nifti)),
            ("A.NII.GZ", gzip(&nifti)),
        ] {
            let volume = folder.read(name, &bytes).unwrap();
            Phantom::assert_in_world(&volume);
            assert_eq!(volume.source.as_deref(), Some(folder.path().join(name).as_path()));
        }
    }

    #[test]
    fn what_is_no_volume_is_refused_with_a_sentence() {
        let folder = Folder::new();
        assert!(folder.refusal("a.txt", b"hello").contains("no volume in a format that Fabrica reads: NIfTI (.nii"));
        assert!(folder.refusal("a.nii", b"").contains("the file is empty"));
        assert!(folder.refusal("a.nii.bz2", b"BZh91AY&SY").contains("compressed with bzip2"));
        assert!(folder.refusal("a.nii", &[7; 1024]).contains("this is no NIfTI file"));
        assert!(folder.refusal("a.nii.gz", b"\x1f\x8b").contains("ends after 0 of the 348 bytes"));
        assert!(folder.refusal("a.nrrd", &[7; 1024]).contains("this is no NRRD file"));
        assert!(folder.refusal("a.raw", &[7; 1024]).contains("--raw 256x256x128xuint16,0.5x0.5x1,big"));
        let none = read_volume(Path::new("/no/such.nii"), &ReadOptions::default(), &Progress::new()).unwrap_err();
        assert!(none.to_string().contains("no such file"), "{none}");
        let here = read_volume(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap_err();
        assert!(here.to_string().contains("this is a folder"), "{here}");
    }

    #[test]
    fn cancelling_stops() {
        let folder = Folder::new();
        let nifti = NiftiFile::new(1, &Phantom::oriented("RAS"), ElementType::U8, Endian::Little).bytes();
        let path = folder.write("a.nii", &nifti);
        let progress = Progress::new();
        progress.cancel();
        let error = read_volume(&path, &ReadOptions::default(), &progress).unwrap_err();
        assert!(matches!(error, Error::Cancelled));
    }

    #[test]
    fn progress_ends_at_its_total() {
        let folder = Folder::new();
        let nifti = NiftiFile::new(1, &Phantom::oriented("RAS"), ElementType::U8, Endian::Little).bytes();
        for bytes in [gzip(&nifti), nifti] {
            let path = folder.write("a.nii", &bytes);
            let progress = Progress::new();
            read_volume(&path, &ReadOptions::default(), &progress).unwrap();
            assert_eq!(progress.snapshot(), ("reading".to_owned(), 412, 412));
        }
    }
}
