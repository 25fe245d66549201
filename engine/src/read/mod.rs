//! Volume files: one entry point for every format, [`read_volume`].
//!
//! A format is one [`VolumeReader`] in one file, listed in [`READERS`]; callers never name it. Which one reads a
//! file is decided by content first and by the name only where the content says nothing (raw voxels, a damaged
//! header that shall get its own sentence). Every reader delivers RAS millimeters, voxels in the stored type,
//! and checks sizes against the file before it allocates.

pub mod dicom;
pub mod nifti;
pub mod nrrd;
pub mod raw;
mod stream;
#[cfg(test)]
mod testing;
pub mod window;

use std::path::Path;

use glam::DAffine3;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;
use crate::volume::labels::LabelMap;
use crate::volume::{Modality, Rescale, Volume, Voxels};

use stream::ByteSource;
use window::Window;

/// What the caller may choose about reading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// Which frame (time point, component) of a file with several, from 0.
    pub frame: usize,
    /// Read the file as plain voxels in this layout, whatever its content or name.
    pub raw: Option<raw::RawLayout>,
    /// Which volume of a folder or file with several: an [`Entry::key`], a part of an [`Entry::title`] that only one has, or
    /// its number in the survey, from 1.
    pub series: Option<String>,
    /// Which part of it, and how finely.
    pub window: Window,
}

/// A volume that a file or folder offers, as far as headers tell.
#[derive(Clone, Debug)]
pub struct Entry {
    /// What [`ReadOptions::series`] takes to name it among several; made of geometry, modality and description alone, so
    /// that a template may hold it. Empty where a file holds one volume.
    pub key: String,
    /// How the file describes it ("Abdomen 5.0"); may be empty.
    pub title: String,
    /// As [`Volume::format`].
    pub format: String,
    /// What the values mean.
    pub modality: Modality,
    /// Size and place in the world, of the whole.
    pub grid: Grid,
    /// The element type as NumPy spells it, "rgb" or "rgba" for colors.
    pub type_name: &'static str,
    /// Bytes of one voxel in memory.
    pub bytes_per_voxel: usize,
    /// Frames (time points, components) to choose from.
    pub num_frames: usize,
    /// Files that it lies in.
    pub num_files: usize,
    /// Whether the file says that its numbers are names of structures.
    pub is_labels: bool,
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

    /// What there is to read, from headers alone: takes next to no memory, and of big files next to no time. At least one
    /// entry.
    ///
    /// # Errors
    /// As [`VolumeReader::read`].
    fn survey(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<Entry>>;

    /// Reads one volume: RAS mm, voxels as stored, of them those in [`ReadOptions::window`].
    ///
    /// # Errors
    /// [`Error::File`] with a sentence for every fault of the file, [`Error::Cancelled`] on request.
    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume>;

    /// Reads a label map: one layer, or several where structures overlap. A format that knows names and colors gives them;
    /// of any other the numbers of an integer volume are the structures.
    ///
    /// # Errors
    /// As [`VolumeReader::read`], and for voxels that are no integers.
    fn read_labels(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<LabelMap>> {
        let volume = self.read(path, options, progress)?;
        let remedy = "open it as a volume, or save it with an integer type";
        Ok(vec![LabelMap::from_volume(&volume).map_err(|what| Error::file(path, what, remedy))?])
    }
}

/// How much of a file [`VolumeReader::recognizes`] gets to see.
pub const HEAD_BYTES: usize = 4096;

/// The formats, asked in this order.
static READERS: [&dyn VolumeReader; 4] = [&nifti::NiftiReader, &nrrd::NrrdReader, &dicom::DicomReader, &raw::RawReader];

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

/// Lists the volumes of a file or folder without reading them.
///
/// # Errors
/// As [`read_volume`].
pub fn survey(path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<Entry>> {
    progress.check()?;
    reader_for(path, options)?.survey(path, options, progress)
}

/// Reads a label map from a file or folder of any known format, a layer for every set of structures that do not overlap.
///
/// # Errors
/// As [`read_volume`], and for voxels that are no integers.
pub fn read_labels(path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<LabelMap>> {
    progress.check()?;
    reader_for(path, options)?.read_labels(path, options, progress)
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
    if head.starts_with(b"ObjectType") || head.starts_with(b"NDims") || named(&["mha", "mhd"]) {
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

/// The volume of `entry`, with the voxels that its window kept and what the user shall know.
fn volume_of(
    path: &Path,
    entry: &Entry,
    window: window::OnGrid,
    voxels: Voxels,
    rescale: Rescale,
    mut warnings: Vec<String>,
) -> Result<Volume> {
    let fault = |what| Error::file(path, what, "write the file again");
    let grid = window.grid(&entry.grid).map_err(fault)?;
    let mut volume = Volume::new(grid, voxels, rescale, &entry.format).map_err(fault)?;
    warnings.extend(window.note());
    volume.num_frames = entry.num_frames;
    volume.modality = entry.modality;
    volume.description.clone_from(&entry.title);
    volume.warnings = warnings;
    Ok(volume)
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
    use super::testing::{ElementType, Endian, Folder, NiftiFile, Phantom, encode, gzip};
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
    fn a_window_is_the_same_part_whatever_the_file() {
        let folder = Folder::new();
        let phantom = Phantom::oriented("RAS");
        let window = Window { crop: Some([[1, 5], [0, 4], [1, 3]]), reduce: [2, 1, 2] };
        let options = ReadOptions { window, ..ReadOptions::default() };
        let nifti = NiftiFile::new(1, &phantom, ElementType::F32, Endian::Little).bytes();
        let [x, y, z] = phantom.dims;
        let digits: Vec<_> = phantom.values.iter().map(f64::to_string).collect();
        let nrrd = |encoding: &str| {
            format!("NRRD0004\ntype: float\ndimension: 3\nsizes: {x} {y} {z}\nencoding: {encoding}\nendian: little\n\n")
        };
        let raw = encode(&phantom.values, ElementType::F32, Endian::Little);
        for (name, bytes) in [
            ("a.nii", nifti.clone()),
            ("a.nii.gz", gzip(&nifti)),
            ("a.nrrd", [nrrd("raw").as_bytes(), &raw].concat()),
            ("b.nrrd", [nrrd("gzip").as_bytes(), &gzip(&raw)].concat()),
            ("c.nrrd", [nrrd("ascii"), digits.join(" ")].concat().into_bytes()),
        ] {
            let path = folder.write(name, &bytes);
            let volume = read_volume(&path, &options, &Progress::new()).unwrap();
            assert_eq!(volume.grid.dims(), [2, 4, 1], "{name}");
            let at = |i: usize, j: usize, k: usize| phantom.values[i + x * (j + y * k)];
            for (i, j) in [(0, 0), (1, 0), (0, 3), (1, 2)] {
                let block = [(1, 1), (2, 1), (1, 2), (2, 2)].map(|(di, k)| at(2 * i + di, j, k));
                assert!((volume.value(i, j, 0) - block.iter().sum::<f64>() / 4.0).abs() < 1e-5, "{name}");
            }
            assert!(volume.warnings.iter().any(|w| w.contains("2 x 4 x 1 were loaded")), "{:?}", volume.warnings);
            let entries = survey(&path, &ReadOptions::default(), &Progress::new()).unwrap();
            assert_eq!((entries.len(), entries[0].grid.dims(), entries[0].type_name), (1, phantom.dims, "float32"));
        }
    }

    #[test]
    fn integer_volumes_are_label_maps_and_others_are_not() {
        let folder = Folder::new();
        let phantom =
            Phantom { values: (0..60).map(|i| [0.0, 1605.0, 7.0][i % 3]).collect(), ..Phantom::oriented("RAS") };
        let read = |element| {
            let bytes = NiftiFile::new(1, &phantom, element, Endian::Little).bytes();
            read_labels(&folder.write("a.nii", &bytes), &ReadOptions::default(), &Progress::new())
        };
        let layers = read(ElementType::I16).unwrap();
        let ids: Vec<_> = layers[0].labels.iter().map(|l| (l.id, l.name.as_str())).collect();
        assert_eq!(ids, [(0, "background"), (7, "7"), (1605, "1605")]);
        assert_eq!(layers[0].voxels[..4], [0, 2, 1, 0]);
        let halves = Phantom { values: vec![0.5; 60], ..Phantom::oriented("RAS") };
        let bytes = NiftiFile::new(1, &halves, ElementType::F32, Endian::Little).bytes();
        let error = read_labels(&folder.write("b.nii", &bytes), &ReadOptions::default(), &Progress::new()).unwrap_err();
        assert!(error.to_string().contains("a voxel is 0.5, which numbers no structure"), "{error}");
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
