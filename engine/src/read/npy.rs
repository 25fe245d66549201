//! NumPy's `.npy`, versions 1 to 3: one array, whose axis that runs fastest in memory is x.
//!
//! So an array in C order has the axes z, y, x (with a fourth in front for frames), and one in Fortran order x, y, z, which
//! is what `numpy.save` makes of volumes from ITK and from nibabel. An innermost axis of 3 or 4 bytes is color. There is no
//! voxel size and no patient: 1 mm, and the axes of images ([`super::slices`]).
//! Format: numpy.org, `numpy.lib.format`.

use std::path::Path;

use glam::DVec3;

use super::slices::{self, PixelKind};
use super::stream::{self, ByteSource, ElementType, Endian, Magnitudes, VoxelRequest};
use super::window::Averaging;
use super::{Entry, ReadOptions, VolumeReader, absurd_size, check_frame, color_volume_of, grid_of, volume_of};
use crate::error::{Error, Result, remedies};
use crate::progress::Progress;
use crate::volume::{Modality, Rescale, Volume};

const MAGIC: &[u8] = b"\x93NUMPY";

/// A header longer than this is that of a table.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Reads NumPy arrays.
pub struct NpyReader;

impl VolumeReader for NpyReader {
    fn name(&self) -> &'static str {
        "NumPy"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["npy"]
    }

    fn recognizes(&self, path: &Path, head: &[u8]) -> bool {
        head.starts_with(MAGIC) || is_npz(path, head)
    }

    fn survey(&self, path: &Path, _options: &ReadOptions, _progress: &Progress) -> Result<Vec<Entry>> {
        Ok(vec![Opened::open(path)?.entry])
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        Opened::open(path)?.read(path, options, progress)
    }
}

/// Whether it is an archive of arrays.
fn is_npz(path: &Path, head: &[u8]) -> bool {
    head.starts_with(b"PK\x03\x04") && super::has_extension(path, "npz")
}

/// A file whose header is understood and whose voxels are there as far as the file's size tells.
struct Opened {
    entry: Entry,
    kind: PixelKind,
    is_complex: bool,
    endian: Endian,
    /// The file from its first voxel on.
    source: ByteSource,
    warnings: Vec<String>,
}

impl Opened {
    fn open(path: &Path) -> Result<Self> {
        let mut source = ByteSource::open(path)?;
        let start = source.read_up_to(12)?;
        if is_npz(path, &start) {
            return Err(Error::file(
                path,
                "this is an archive of NumPy arrays, and Fabrica reads single ones",
                "save the volume alone with numpy.save",
            ));
        }
        let cut_off = || Error::file(path, "the file ends within its header", "copy or download it again");
        if !start.starts_with(&MAGIC[..MAGIC.len().min(start.len())]) || start.is_empty() {
            return Err(Error::file(
                path,
                "this is no NumPy file: it does not begin with NumPy's mark",
                remedies::DESCRIBE_VOXELS,
            ));
        }
        let [.., major, _, a, b, c, d] = start[..] else { return Err(cut_off()) };
        // Version 1 has two bytes for the length, and the header begins with the other two.
        let (length, mut text) = match major {
            1 => (u64::from(u16::from_le_bytes([a, b])), vec![c, d]),
            2 | 3 => (u64::from(u32::from_le_bytes([a, b, c, d])), Vec::new()),
            _ => {
                let what = format!("this is version {major} of NumPy's format, of which Fabrica reads 1 to 3");
                return Err(Error::file(path, what, "save it with numpy.save"));
            }
        };
        if !(2..=MAX_HEADER_BYTES).contains(&length) {
            return Err(fault(path, format!("its header promises to have {length} bytes")));
        }
        let rest = length - text.len() as u64;
        text.extend(source.read_up_to(rest as usize)?);
        if (text.len() as u64) < length {
            return Err(cut_off());
        }
        let header = Header::parse(path, &String::from_utf8_lossy(&text))?;
        let (element, is_complex, endian) = header.element_type(path)?;

        // Axes by their speed, the fastest first.
        let mut sizes = header.shape.clone();
        if !header.is_fortran {
            sizes.reverse();
        }
        let channels = (element == ElementType::U8 && !header.is_bool() && sizes.len() >= 3)
            .then(|| sizes[0])
            .filter(|n| matches!(n, 3 | 4));
        let kind = match channels {
            Some(3) => PixelKind::Rgb,
            Some(_) => PixelKind::Rgba,
            None => PixelKind::Values(element),
        };
        let spatial = &sizes[usize::from(channels.is_some())..];
        if !(2..=4).contains(&spatial.len()) {
            return Err(Error::file(
                path,
                format!("the array has {} axes, where a volume has 3, or 4 with frames", header.shape.len()),
                "save it as z, y, x, or with the frames as a fourth axis in front",
            ));
        }
        let dims: [u64; 3] = std::array::from_fn(|i| spatial.get(i).copied().unwrap_or(1));
        let num_frames = spatial.get(3).copied().unwrap_or(1);
        let parts = if is_complex { 2 } else { 1 };
        let all: Vec<u64> = sizes.iter().copied().chain([parts]).collect();
        let size = stream::size_bytes(&all, element).ok_or_else(|| absurd_size(path, &sizes))?;
        if source.is_compressed() {
            source.check_holds(size)?;
        } else {
            // The size of the file is known, and so is where the voxels begin.
            let preamble = if major == 1 { 10 } else { 12 };
            source.check_holds(size.saturating_add(preamble + length))?;
        }
        let mut warnings = vec!["The file does not give the voxel size; 1 mm is assumed.".to_owned()];
        if is_complex {
            warnings.push("The voxels are complex numbers, of which the magnitude is shown.".to_owned());
        }
        let entry = Entry {
            key: String::new(),
            title: String::new(),
            format: "NumPy".to_owned(),
            modality: Modality::Unknown,
            grid: grid_of(path, dims, slices::world_without_patient(dims, DVec3::ONE))?,
            orientation: slices::no_patient(),
            type_name: kind.name(),
            bytes_per_voxel: kind.bytes_per_voxel(),
            num_frames: usize::try_from(num_frames).unwrap_or(usize::MAX),
            num_files: 1,
            is_labels: false,
            is_localizer: false,
        };
        Ok(Self { entry, kind, is_complex, endian, source, warnings })
    }

    fn read(self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        let Self { entry, kind, is_complex, endian, mut source, warnings } = self;
        check_frame(path, options.frame, entry.num_frames)?;
        let window = options.window.on(path, entry.grid.dims())?;
        let (voxel_bytes, num_channels) = match kind {
            PixelKind::Values(element) => (element.num_bytes() * if is_complex { 2 } else { 1 }, 1),
            PixelKind::Rgb => (3, 3),
            PixelKind::Rgba => (4, 4),
        };
        let frame_bytes = (entry.grid.num_voxels() * voxel_bytes) as u64;
        let frame_start = options.frame as u64 * frame_bytes;
        progress.begin("reading", frame_start + frame_bytes);
        source.skip(frame_start, progress)?;
        let PixelKind::Values(element) = kind else {
            let colors = stream::read_colors(&mut source, num_channels, window, path, progress)?;
            source.finish(progress)?;
            return color_volume_of(path, &entry, window, colors, warnings);
        };
        let is_size_checked = !source.is_compressed();
        let request = VoxelRequest { element, endian, window, averaging: Averaging::Mean, is_size_checked };
        let voxels = if is_complex {
            let mut magnitudes = Magnitudes::new(&mut source, element, endian);
            stream::read_voxels(&mut magnitudes, VoxelRequest { endian: Endian::NATIVE, ..request }, path, progress)?
        } else {
            stream::read_voxels(&mut source, request, path, progress)?
        };
        source.finish(progress)?;
        volume_of(path, &entry, window, voxels, Rescale::IDENTITY, warnings)
    }
}

/// The dictionary at the beginning: `{'descr': '<i2', 'fortran_order': False, 'shape': (3, 4, 5), }`.
#[derive(Debug, PartialEq)]
struct Header {
    descr: String,
    is_fortran: bool,
    shape: Vec<u64>,
}

impl Header {
    fn parse(path: &Path, text: &str) -> Result<Self> {
        let shown: String = text.trim().chars().take(60).collect();
        let broken = || fault(path, format!("its header `{shown}` is none of NumPy's"));
        let after = |key: &str| {
            let quoted = [format!("'{key}'"), format!("\"{key}\"")];
            let rest = quoted.iter().find_map(|q| text.split_once(q.as_str()))?.1;
            rest.trim_start().strip_prefix(':').map(str::trim_start)
        };
        let descr = after("descr").ok_or_else(broken)?;
        if descr.starts_with('[') {
            return Err(Error::file(
                path,
                "its elements are records of several values",
                "save one of their fields with numpy.save",
            ));
        }
        let quote = descr.chars().next().filter(|c| matches!(c, '\'' | '"')).ok_or_else(broken)?;
        let descr = descr[1..].split(quote).next().ok_or_else(broken)?.to_owned();
        let order = after("fortran_order").ok_or_else(broken)?;
        let is_fortran = match (order.starts_with("True"), order.starts_with("False")) {
            (true, _) => true,
            (_, true) => false,
            _ => return Err(broken()),
        };
        let inner = after("shape").and_then(|s| s.strip_prefix('(')?.split_once(')')).ok_or_else(broken)?.0;
        let words = inner.split(',').map(str::trim).filter(|w| !w.is_empty());
        // Python 2 wrote long integers with an L.
        let shape: Option<Vec<u64>> = words.map(|w| w.trim_end_matches('L').parse().ok()).collect();
        let shape = shape.ok_or_else(broken)?;
        if shape.contains(&0) {
            return Err(fault(path, "the array is empty".to_owned()));
        }
        Ok(Self { descr, is_fortran, shape })
    }

    fn is_bool(&self) -> bool {
        self.descr.trim_start_matches(['|', '<', '>', '=']) == "b1"
    }

    /// The type of a number (of a part, if they are complex) and its byte order.
    fn element_type(&self, path: &Path) -> Result<(ElementType, bool, Endian)> {
        let endian = if self.descr.starts_with('>') { Endian::Big } else { Endian::Little };
        let (element, is_complex) = match self.descr.trim_start_matches(['|', '<', '>', '=']) {
            "b1" | "u1" => (ElementType::U8, false),
            "i1" => (ElementType::I8, false),
            "u2" => (ElementType::U16, false),
            "i2" => (ElementType::I16, false),
            "u4" => (ElementType::U32, false),
            "i4" => (ElementType::I32, false),
            "u8" => (ElementType::U64, false),
            "i8" => (ElementType::I64, false),
            "f4" => (ElementType::F32, false),
            "f8" => (ElementType::F64, false),
            "c8" => (ElementType::F32, true),
            "c16" => (ElementType::F64, true),
            _ => {
                return Err(Error::file(
                    path,
                    format!("the element type `{}` is none that Fabrica reads", self.descr),
                    "save it with astype('float32')",
                ));
            }
        };
        Ok((element, is_complex, endian))
    }
}

fn fault(path: &Path, what: String) -> Error {
    Error::file(path, what, "save the array again with numpy.save")
}

#[cfg(test)]
mod tests {
    use super::super::testing::{ALL_TYPES, Folder, encode, gzip, read_frame, torture};
    use super::*;
    use crate::volume::Voxels;

    /// A file as `numpy.save` writes it.
    fn npy(version: u8, descr: &str, order: &str, shape: &str, voxels: &[u8]) -> Vec<u8> {
        let mut text = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({shape}), }}");
        let preamble = if version == 1 { 10 } else { 12 };
        while !(preamble + text.len() + 1).is_multiple_of(64) {
            text.push(' ');
        }
        text.push('\n');
        let length = (text.len() as u32).to_le_bytes();
        let length = if version == 1 { &length[..2] } else { &length[..] };
        [MAGIC, &[version, 0], length, text.as_bytes(), voxels].concat()
    }

    #[test]
    fn every_type_version_and_byte_order() {
        let folder = Folder::new();
        let values: Vec<f64> = (0..60).map(f64::from).collect();
        for element in ALL_TYPES {
            let letter = match element {
                ElementType::F32 | ElementType::F64 => 'f',
                ElementType::I8 | ElementType::I16 | ElementType::I32 | ElementType::I64 => 'i',
                _ => 'u',
            };
            for (version, endian, mark) in [
                (1, Endian::Little, '<'),
                (2, Endian::Big, '>'),
                (3, Endian::Little, if letter == 'f' { '=' } else { '|' }),
            ] {
                let descr = format!("{mark}{letter}{}", element.num_bytes());
                let bytes = npy(version, &descr, "False", "3, 4, 5", &encode(&values, element, endian));
                for bytes in [gzip(&bytes), bytes] {
                    let volume = folder.read("a.npy", &bytes).unwrap();
                    assert_eq!((volume.grid.dims(), volume.voxels.type_name()), ([5, 4, 3], element.name()));
                    assert_eq!((volume.value(1, 0, 0), volume.value(0, 1, 0), volume.value(4, 3, 2)), (1.0, 5.0, 59.0));
                    assert_eq!(volume.grid.orientation_letters(), "LPS");
                }
            }
        }
    }

    #[test]
    fn shapes_and_orders() {
        let folder = Folder::new();
        let bytes: Vec<u8> = (0..120).collect();
        let read_as = |descr: &str, order: &str, shape: &str, n: usize| {
            folder.read("a.npy", &npy(1, descr, order, shape, &bytes[..n])).unwrap()
        };
        assert_eq!(read_as("|u1", "True", "5, 4, 3", 60).grid.dims(), [5, 4, 3]);
        assert_eq!(read_as("|b1", "False", "4, 5", 20).grid.dims(), [5, 4, 1]);
        let path = folder.write("a.npy", &npy(1, "|u1", "False", "2, 3, 4, 5", &bytes));
        let second = read_frame(&path, 1).unwrap();
        assert_eq!((second.grid.dims(), second.num_frames, second.value(1, 0, 0)), ([5, 4, 3], 2, 61.0));
        assert!(read_frame(&path, 2).is_err());
        let colors = read_as("|u1", "False", "2, 5, 4, 3", 120);
        assert_eq!((colors.grid.dims(), colors.colors.unwrap()[39]), ([4, 5, 2], [117, 118, 119, 255]));
        let colors = read_as("|u1", "True", "4, 3, 5", 60);
        assert_eq!((colors.grid.dims(), colors.colors.unwrap()[1]), ([3, 5, 1], [4, 5, 6, 7]));
        // Truths are no colors, and neither are numbers of two bytes.
        assert!(read_as("|b1", "False", "5, 4, 3", 60).colors.is_none());
        assert!(read_as("<u2", "False", "5, 4, 3", 120).colors.is_none());
        let pairs = encode(&[3.0, 4.0, 5.0, 12.0], ElementType::F64, Endian::Big);
        let complex = folder.read("a.npy", &npy(1, ">c16", "False", "1, 1, 2", &pairs)).unwrap();
        assert_eq!(complex.voxels, Voxels::F64(vec![5.0, 13.0]));
        assert!(complex.warnings.join(" ").contains("the magnitude is shown"));
    }

    #[test]
    fn what_is_no_volume_gets_a_sentence() {
        let folder = Folder::new();
        for (descr, order, shape, expected) in [
            ("<f2", "False", "1, 1, 1", "the element type `<f2`"),
            ("|O", "False", "1, 1, 1", "the element type `|O`"),
            ("|u1", "Maybe", "1, 1, 1", "is none of NumPy's"),
            ("|u1", "False", "", "has 0 axes"),
            ("|u1", "False", "5,", "has 1 axes"),
            ("|u1", "False", "1, 1, 1, 1, 1", "has 5 axes"),
            ("|u1", "False", "1, 0, 1", "is empty"),
            ("|u1", "False", "1, -1, 1", "is none of NumPy's"),
            ("|u1", "False", "9, 9, 9", "but the file ends after"),
            ("|u1", "False", "4294967296, 4294967296, 4294967296", "more than any file holds"),
        ] {
            let refusal = folder.refusal("a.npy", &npy(1, descr, order, shape, &[1, 2]));
            assert!(refusal.contains(expected), "{refusal}");
        }
        let records = npy(1, "x", "False", "1, 1, 1", &[1]);
        let records = String::from_utf8_lossy(&records[10..]).replace("'x'", "[('a', '<i4')]");
        let records = [MAGIC, &[1, 0], &(records.len() as u16).to_le_bytes(), records.as_bytes()].concat();
        assert!(folder.refusal("a.npy", &records).contains("records"));
        assert!(folder.refusal("a.npz", b"PK\x03\x04abc").contains("archive of NumPy arrays"));
        assert!(folder.refusal("a.npy", &[7; 100]).contains("this is no NumPy file"));
        let newer = npy(9, "|u1", "False", "1, 1, 1", &[1]);
        assert!(folder.refusal("a.npy", &newer).contains("version 9"));
    }

    #[test]
    fn damage_anywhere_gives_a_sentence() {
        let bytes = npy(1, "<i2", "False", "3, 4, 5", &[0; 120]);
        torture("a.npy", &bytes, usize::MAX);
    }
}
