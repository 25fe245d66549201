//! Volume files: one entry point for every format, [`read_volume`].
//!
//! A format is one [`VolumeReader`] in one file, listed in [`READERS`]; callers never name it. Which one reads a
//! file is decided by content first and by the name only where the content says nothing (raw voxels, a damaged
//! header that shall get its own sentence). Every reader delivers RAS millimeters, voxels in the stored type,
//! and checks sizes against the file before it allocates.

pub mod dicom;
pub mod image_folder;
pub mod label_table;
pub mod limits;
pub mod mask_folder;
pub mod metaimage;
pub mod nifti;
pub mod npy;
pub mod nrrd;
mod parts;
pub mod raw;
mod slices;
mod stream;
#[cfg(test)]
mod testing;
pub mod tiff;
pub mod window;

use std::path::Path;

use glam::DAffine3;

use crate::error::{Error, Result, printable, remedies};
use crate::progress::Progress;
use crate::spaces::Grid;
use crate::volume::colors::colors_of;
use crate::volume::labels::LabelMap;
use crate::volume::{Modality, Orientation, Rescale, Volume, Voxels};

use limits::Limits;
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
    /// What its numbers are taken for.
    pub numbers: Numbers,
    /// Which part of it, and how finely.
    pub window: Window,
    /// What it may take.
    pub limits: Limits,
}

/// What the numbers of a volume are taken for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Numbers {
    /// Values, even where the file says that they are names of structures.
    #[default]
    Values,
    /// Names of structures: what is read are their colors, and the label map itself ([`Volume::labels`]).
    Structures,
    /// Names of structures where the file says so, else values.
    AsStated,
}

impl Numbers {
    /// Whether those of a volume are names of structures.
    pub fn are_structures(self, entry: &Entry) -> bool {
        match self {
            Self::Values => false,
            Self::Structures => true,
            Self::AsStated => entry.is_labels,
        }
    }
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
    /// Whether the letters of its axes are the file's or assumed.
    pub orientation: Orientation,
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
    /// Whether the file says that it only shows where others lie.
    pub is_localizer: bool,
}

impl Entry {
    /// One line for people: "CT Abdomen 5.0, 512 x 512 x 110, 0.78 x 0.78 x 5 mm".
    pub fn in_words(&self) -> String {
        let [x, y, z] = self.grid.dims();
        let spacing = self.grid.spacing_mm();
        let short = |mm: f64| {
            let text = format!("{mm:.3}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        };
        let kind = self.modality.abbreviation();
        // Many descriptions begin with it.
        let named = if self.title.starts_with(kind) { self.title.clone() } else { [kind, &self.title].join(" ") };
        let frames = if self.num_frames > 1 { format!(", {} frames", self.num_frames) } else { String::new() };
        let size = format!("{x} x {y} x {z}, {} x {} x {} mm", short(spacing.x), short(spacing.y), short(spacing.z));
        let named = named.trim();
        printable(if named.is_empty() { format!("{size}{frames}") } else { format!("{named}, {size}{frames}") })
    }
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
        numbers_as_labels(self, path, options, progress)
    }
}

/// How much of a file [`VolumeReader::recognizes`] gets to see.
pub const HEAD_BYTES: usize = 4096;

/// The formats, asked in this order.
static READERS: [&dyn VolumeReader; 9] = [
    &nifti::NiftiReader,
    &nrrd::NrrdReader,
    &metaimage::MetaImageReader,
    // Before TIFF, whose mark may stand in a DICOM file's preamble.
    &dicom::DicomReader,
    &tiff::TiffReader,
    &npy::NpyReader,
    &mask_folder::FolderReader,
    &image_folder::ImageFolderReader,
    &raw::RawReader,
];

/// Reads a volume from a file or folder of any known format.
///
/// The work shows as the stage "reading" in decoded bytes and stops at [`Progress::cancel`].
///
/// # Errors
/// [`Error::File`] with one sentence for the user if the path does not exist, no format fits, the file is
/// damaged or holds no volume, or there is no such frame or series; [`Error::Several`], [`Error::NeedsLayout`] and
/// [`Error::TooLarge`] where the caller has to choose; [`Error::Cancelled`] on request.
pub fn read_volume(path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
    progress.check()?;
    let reader = reader_for(path, options)?;
    let entries = reader.survey(path, options, progress)?;
    let (entry, note) = choose(path, &entries, options.series.as_deref(), options.numbers == Numbers::Structures)?;
    options.limits.check(path, entry, options)?;
    let series = (entries.len() > 1).then(|| entry.key.clone());
    let options = &ReadOptions { series, ..options.clone() };
    let mut volume = if options.numbers.are_structures(entry) {
        colors_of_labels(path, entry, reader.read_labels(path, options, progress)?)?
    } else {
        reader.read(path, options, progress)?
    };
    volume.source = Some(path.to_owned());
    volume.warnings.extend(note);
    Ok(volume)
}

/// The entry that `series` names (see [`ReadOptions::series`]), whatever case it is in. Without it the only one; or of volumes
/// the only one that is no label map, no localizer and more than a few slices, with a note about the others; or, if `of_labels`,
/// the only label map.
///
/// # Errors
/// [`Error::Several`] if there is more than one to choose from, [`Error::File`] if none is meant.
pub fn choose<'a>(
    path: &Path,
    entries: &'a [Entry],
    series: Option<&str>,
    of_labels: bool,
) -> Result<(&'a Entry, Option<String>)> {
    /// Single pictures have fewer slices.
    const MIN_SLICES: usize = 3;
    let several = || Error::Several { path: path.to_owned(), entries: entries.to_vec() };
    let Some(wanted) = series.map(str::trim) else {
        if let [only] = entries {
            return Ok((only, None));
        }
        let is_volume = |e: &Entry| !e.is_localizer && e.grid.dims().iter().all(|n| *n >= MIN_SLICES);
        let mut fit = entries.iter().filter(|e| if of_labels { e.is_labels } else { !e.is_labels && is_volume(e) });
        let (Some(only), None) = (fit.next(), fit.next()) else { return Err(several()) };
        let n = entries.len() - 1;
        let others = if n == 1 { "1 other series was".to_owned() } else { format!("{n} other series were") };
        let note = format!("{others} left out: label maps, localizers, single pictures or few slices.");
        return Ok((only, Some(note).filter(|_| !of_labels)));
    };
    if let Some(exact) = entries.iter().find(|e| e.key == wanted) {
        return Ok((exact, None));
    }
    // Before names: whoever takes a number from the list does not mean a digit of a name.
    if let Ok(number) = wanted.parse::<usize>() {
        let numbered = number.checked_sub(1).and_then(|i| entries.get(i));
        return numbered.map(|entry| (entry, None)).ok_or_else(|| {
            let what = format!("there is no series {number}: it holds {}", entries.len());
            Error::file(path, what, remedies::LIST_SERIES)
        });
    }
    let lower = wanted.to_lowercase();
    let mut meant = entries.iter().filter(|e| [&e.key, &e.title].iter().any(|t| t.to_lowercase().contains(&lower)));
    match (meant.next(), meant.next()) {
        (Some(only), None) => Ok((only, None)),
        (Some(first), Some(second)) => {
            let wanted: String = wanted.chars().take(60).collect();
            let (a, b) = (first.in_words(), second.in_words());
            let what = format!("\"{wanted}\" is a part of the names of several series: {a}; {b}");
            Err(Error::file(path, what, remedies::NAME_SERIES))
        }
        (None, _) => {
            let wanted: String = wanted.chars().take(60).collect();
            let what = format!("there is no series \"{wanted}\" among its {}", entries.len());
            Err(Error::file(path, what, remedies::LIST_SERIES))
        }
    }
}

/// The last parts of the names of files that can be read, for dialogs; DICOM files have any, or none.
pub fn extensions() -> Vec<&'static str> {
    READERS.iter().flat_map(|reader| reader.extensions()).copied().chain(["gz"]).collect()
}

/// A volume of numbers that was read, which are names of structures: in their colors, with its label map.
///
/// # Errors
/// [`Error::File`] if a number is no integer or there are too many, [`Error::TooLarge`] if their colors take more than they may.
pub fn in_structures_colors(volume: &Volume, limits: &Limits) -> Result<Volume> {
    let path = volume.source.as_deref().unwrap_or(Path::new(""));
    let entry = Entry {
        key: String::new(),
        title: volume.description.clone(),
        format: volume.format.clone(),
        modality: volume.modality,
        grid: volume.grid,
        orientation: volume.orientation.clone(),
        type_name: volume.voxels.type_name(),
        bytes_per_voxel: volume.voxels.bytes_per_voxel(),
        num_frames: volume.num_frames,
        num_files: 1,
        is_labels: true,
        is_localizer: false,
    };
    limits.check(path, &entry, &ReadOptions { numbers: Numbers::Structures, ..ReadOptions::default() })?;
    let mut colors = colors_of_labels(path, &entry, vec![labels_of(path, volume)?])?;
    colors.source.clone_from(&volume.source);
    Ok(colors)
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
    let reader = reader_for(path, options)?;
    let entries = reader.survey(path, options, progress)?;
    let (entry, _) = choose(path, &entries, options.series.as_deref(), true)?;
    let series = (entries.len() > 1).then(|| entry.key.clone());
    reader.read_labels(path, &ReadOptions { series, ..options.clone() }, progress)
}

fn reader_for(path: &Path, options: &ReadOptions) -> Result<&'static dyn VolumeReader> {
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, &e))?;
    if metadata.is_dir() {
        return READERS.iter().copied().find(|r| r.recognizes(path, &[])).ok_or_else(|| {
            let is_empty = std::fs::read_dir(path).is_ok_and(|mut files| files.next().is_none());
            if is_empty {
                return Error::file(path, "the folder is empty", "name a folder with a scan in it");
            }
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
    READERS.iter().copied().find(|r| r.extensions().iter().any(|e| has_extension(path, e))).ok_or_else(|| {
        let of_files = READERS.iter().filter(|r| !r.extensions().is_empty());
        let formats: Vec<_> = of_files.map(|r| format!("{} (.{})", r.name(), r.extensions().join(", ."))).collect();
        Error::file(
            path,
            format!("this is no volume in a format that Fabrica reads: {}", formats.join(", ")),
            remedies::CONVERT_OR_DESCRIBE,
        )
    })
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
    warnings: Vec<String>,
) -> Result<Volume> {
    let make = |grid| Volume::new(grid, voxels, rescale, &entry.format);
    described(path, entry, window, make, warnings)
}

/// As [`volume_of`], of sRGB colors with straight alpha.
fn color_volume_of(
    path: &Path,
    entry: &Entry,
    window: window::OnGrid,
    colors: Vec<[u8; 4]>,
    warnings: Vec<String>,
) -> Result<Volume> {
    described(path, entry, window, |grid| Volume::from_colors(grid, colors, &entry.format), warnings)
}

fn described(
    path: &Path,
    entry: &Entry,
    window: window::OnGrid,
    make: impl FnOnce(Grid) -> std::result::Result<Volume, String>,
    mut warnings: Vec<String>,
) -> Result<Volume> {
    let fault = |what| Error::file(path, what, "write the file again");
    let mut volume = window.grid(&entry.grid).and_then(make).map_err(fault)?;
    // First, as it matters most.
    warnings.splice(0..0, entry.orientation.assumption().map(str::to_owned));
    warnings.extend(window.note());
    volume.orientation.clone_from(&entry.orientation);
    volume.num_frames = entry.num_frames;
    volume.modality = entry.modality;
    volume.description.clone_from(&entry.title);
    volume.warnings = warnings;
    Ok(volume)
}

/// The numbers of an integer volume as structures.
fn numbers_as_labels<R: VolumeReader + ?Sized>(
    reader: &R,
    path: &Path,
    options: &ReadOptions,
    progress: &Progress,
) -> Result<Vec<LabelMap>> {
    // Readers make means where several voxels become one, which numbers of structures have not.
    let Window { crop, reduce } = options.window;
    let exact = ReadOptions { window: Window { crop, ..Window::default() }, ..options.clone() };
    let volume = reader.read(path, &exact, progress)?;
    Ok(vec![window_labels(path, labels_of(path, &volume)?, Window { crop: None, reduce })?])
}

fn labels_of(path: &Path, volume: &Volume) -> Result<LabelMap> {
    let remedy = "open it as a volume, or save it with an integer type";
    LabelMap::from_volume(volume).map_err(|what| Error::file(path, what, remedy))
}

/// The part of a label map that `window` keeps: of voxels that become one, the label nearest to their middle.
fn window_labels(path: &Path, labels: LabelMap, window: Window) -> Result<LabelMap> {
    if window.is_whole() {
        return Ok(labels);
    }
    let window = window.on(path, labels.grid.dims())?;
    let grid = window.grid(&labels.grid).map_err(|what| Error::file(path, what, "write the file again"))?;
    let mut voxels = window::Collector::new(window, window::Averaging::Nearest, path);
    voxels.push(&labels.voxels)?;
    let notes = labels.notes.into_iter().chain(window.note()).collect();
    Ok(LabelMap { grid, voxels: voxels.finish(), notes, ..labels })
}

/// The structures of all layers in their colors; where several overlap, that of the first layer.
fn colors_of_labels(path: &Path, entry: &Entry, mut layers: Vec<LabelMap>) -> Result<Volume> {
    let fault = |what| Error::file(path, what, "open it as a volume of numbers");
    let num_layers = layers.len();
    let Some(grid) = layers.first().map(|layer| layer.grid) else {
        return Err(fault("it has no structures".to_owned()));
    };
    let (mut colors, mut warnings) = (Vec::new(), Vec::new());
    for layer in &mut layers {
        let below = colors_of(layer).map_err(fault)?;
        if colors.is_empty() {
            colors = below;
        } else {
            colors.iter_mut().zip(below).filter(|(color, _)| color[3] == 0).for_each(|(color, below)| *color = below);
        }
        warnings.append(&mut layer.notes);
    }
    if num_layers > 1 {
        warnings.push(format!("Structures overlap; of {num_layers} layers the first is seen where they do."));
    }
    // A reader of numbers may have said it in its notes.
    if let Some(why) = entry.orientation.assumption().filter(|why| !warnings.iter().any(|w| w == why)) {
        warnings.insert(0, why.to_owned());
    }
    let mut volume = Volume::from_colors(grid, colors, &entry.format).map_err(fault)?;
    volume.orientation.clone_from(&entry.orientation);
    volume.num_frames = entry.num_frames;
    volume.description.clone_from(&entry.title);
    volume.warnings = warnings;
    volume.labels = layers;
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
        let other = Folder::new();
        let of_folder =
            || read_volume(other.path(), &ReadOptions::default(), &Progress::new()).unwrap_err().to_string();
        assert!(of_folder().contains("the folder is empty"), "{}", of_folder());
        other.write("notes.txt", b"hello");
        assert!(of_folder().contains("this is a folder without a volume"), "{}", of_folder());
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
    fn what_no_file_says_about_the_body_is_known_to_be_assumed() {
        let folder = Folder::new();
        let phantom = Phantom::oriented("RAS");
        let nifti = NiftiFile::new(1, &phantom, ElementType::U8, Endian::Little);
        let voxels = encode(&phantom.values, ElementType::U8, Endian::Little);
        let nrrd = |fields: &str| {
            let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n{fields}\n");
            [header.as_bytes(), &voxels].concat()
        };
        let axes = "space directions: (1,0,0) (0,1,0) (0,0,1)\n";
        let meta = |fields: &str| {
            let header =
                format!("NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\n{fields}ElementDataFile = LOCAL\n");
            [header.as_bytes(), &voxels].concat()
        };
        let identity = "TransformMatrix = 1 0 0 0 1 0 0 0 1\n";
        let npy = |text: &str| {
            [b"\x93NUMPY\x01\0", &(text.len() as u16).to_le_bytes()[..], text.as_bytes(), &voxels].concat()
        };
        let layout = "5x4x3xuint8".parse::<raw::RawLayout>().unwrap();
        for (name, bytes, is_known) in [
            ("sform.nii", nifti.bytes(), true),
            ("qform.nii", nifti.clone().with_qform(phantom.world_from_index).bytes(), true),
            ("neither.nii", NiftiFile { sform_code: 0, ..nifti }.bytes(), false),
            ("both.nrrd", nrrd(&format!("space: LPS\n{axes}")), true),
            ("no space.nrrd", nrrd(axes), false),
            ("no axes.nrrd", nrrd("space: LPS\nspacings: 1 1 1\n"), false),
            ("scanner.nrrd", nrrd(&format!("space: scanner-xyz\n{axes}")), false),
            ("matrix.mha", meta(identity), true),
            ("letters.mha", meta("AnatomicalOrientation = RAI\n"), true),
            ("other letters.mha", meta("AnatomicalOrientation = LAS\n"), false),
            ("unknown.mha", meta(&format!("{identity}AnatomicalOrientation = ???\n")), false),
            ("turned.mha", meta("TransformMatrix = 0 1 0 1 0 0 0 0 1\nAnatomicalOrientation = ???\n"), true),
            ("place only.mha", meta("Offset = 1 2 3\n"), false),
            ("array.npy", npy("{'descr': '|u1', 'fortran_order': False, 'shape': (3, 4, 5), }\n"), false),
            ("plain.raw", voxels.clone(), false),
        ] {
            let path = folder.write(name, &bytes);
            let raw = name.ends_with("raw").then(|| layout.clone());
            let window = Window { crop: Some([[1, 5], [0, 4], [1, 3]]), reduce: [2, 1, 1] };
            for window in [Window::default(), window] {
                let options = ReadOptions { raw: raw.clone(), window, ..ReadOptions::default() };
                let entry = survey(&path, &options, &Progress::new()).unwrap().remove(0);
                let volume = read_volume(&path, &options, &Progress::new()).unwrap();
                assert_eq!(volume.orientation.is_known(), is_known, "{name}: {:?}", volume.orientation);
                assert_eq!(entry.orientation, volume.orientation, "{name}");
                // Whoever reads the warnings learns it too, once.
                let said = volume.warnings.iter().filter(|w| Some(w.as_str()) == volume.orientation.assumption());
                assert_eq!(said.count(), usize::from(!is_known), "{name}: {:?}", volume.warnings);
                let colors =
                    read_volume(&path, &ReadOptions { numbers: Numbers::Structures, ..options }, &Progress::new())
                        .unwrap();
                assert_eq!(colors.orientation, volume.orientation, "{name}");
                let said = colors.warnings.iter().filter(|w| Some(w.as_str()) == volume.orientation.assumption());
                assert_eq!(said.count(), usize::from(!is_known), "{name}: {:?}", colors.warnings);
            }
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
    fn a_series_is_named_by_key_number_or_a_part_of_its_name() {
        let entry = |title: &str, slices: usize| Entry {
            key: format!("{title}, {slices}"),
            title: title.to_owned(),
            format: "DICOM".to_owned(),
            modality: Modality::Ct,
            grid: Grid::new([8, 8, slices], DAffine3::IDENTITY).unwrap(),
            orientation: Orientation::Stated,
            type_name: "int16",
            bytes_per_voxel: 2,
            num_frames: 1,
            num_files: slices,
            is_labels: false,
            is_localizer: false,
        };
        let path = Path::new("a");
        let entries = [entry("Scout", 1), entry("Abdomen 5.0", 60), entry("Abdomen 2.0", 150)];
        let chosen = |series: &str| choose(path, &entries, Some(series), false).map(|(e, _)| e.title.clone());
        assert_eq!(chosen("Abdomen 5.0, 60").unwrap(), "Abdomen 5.0");
        assert_eq!(chosen("3").unwrap(), "Abdomen 2.0");
        assert_eq!(chosen(" scout").unwrap(), "Scout");
        let error = chosen("abdomen").unwrap_err().to_string();
        assert!(error.contains("a part of the names of several series: CT Abdomen 5.0, 8 x 8 x 60"), "{error}");
        assert!(chosen("4").unwrap_err().to_string().contains("there is no series 4: it holds 3"));
        let error = choose(path, &entries, None, false).unwrap_err().to_string();
        assert!(error.contains("it holds 3 volumes: 1: CT Scout, 8 x 8 x 1, 1 x 1 x 1 mm; 2: CT Abdomen"), "{error}");
        let (only, note) = choose(path, &entries[..2], None, false).unwrap();
        assert_eq!(only.title, "Abdomen 5.0");
        assert_eq!(
            note.unwrap(),
            "1 other series was left out: label maps, localizers, single pictures or few slices."
        );
        assert_eq!(choose(path, &entries[..1], None, false).unwrap().0.title, "Scout");
    }

    #[test]
    fn what_takes_too_much_is_not_read() {
        let folder = Folder::new();
        let bytes = NiftiFile::new(1, &Phantom::oriented("RAS"), ElementType::I16, Endian::Little).bytes();
        let path = folder.write("a.nii", &bytes);
        let limits = Limits { bytes: Some(300), edge: None };
        let options = ReadOptions { limits, ..ReadOptions::default() };
        let Err(Error::TooLarge(fault)) = read_volume(&path, &options, &Progress::new()) else { panic!("was read") };
        let sentence = fault.to_string();
        assert!(
            sentence.contains("its 5 x 4 x 3 voxels take 720 bytes of memory, and it may take 300 bytes"),
            "{sentence}"
        );
        let fitting = ReadOptions { window: fault.fitting, ..options };
        assert_eq!(read_volume(&path, &fitting, &Progress::new()).unwrap().grid.num_voxels(), 24);
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
