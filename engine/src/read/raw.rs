//! Plain voxels without a header: the user says how they lie ([`RawLayout`], `--raw` on the command line).
//!
//! World: the index axes are taken as right, anterior, superior (RAS), and the middle of the grid is the origin.

use std::fmt::{self, Display, Formatter};
use std::path::Path;
use std::str::FromStr;

use glam::{DAffine3, DMat3, DVec3};

use super::stream::{self, ByteSource, ElementType, Endian, VoxelRequest};
use super::window::Averaging;
use super::{Entry, ReadOptions, VolumeReader, absurd_size, check_frame, grid_of, volume_of};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Modality, Orientation, Rescale, Volume};

/// How the layout is written, for messages.
pub const EXAMPLE: &str =
    "256x256x128xuint16,0.5x0.5x1,big (sizes and type; spacing in mm and byte order may be left out)";

/// How plain voxels lie in a file, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct RawLayout {
    dims: [u64; 3],
    element: ElementType,
    spacing_mm: DVec3,
    endian: Endian,
}

impl RawLayout {
    /// Number of voxels along x, y, z.
    pub fn dims(&self) -> [u64; 3] {
        self.dims
    }

    /// Distance of neighboring voxels along x, y, z, in mm.
    pub fn spacing_mm(&self) -> DVec3 {
        self.spacing_mm
    }

    /// What is wrong with it for the file at `path`, as a clause; a compressed file is known to fit only when it is read.
    pub fn misfit(&self, path: &Path) -> Option<String> {
        let length = std::fs::metadata(path).ok()?.len();
        let size = stream::size_bytes(&self.dims, self.element)?;
        let is_compressed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
        (size != length && !is_compressed).then(|| format!("the layout needs {size} bytes, but the file has {length}"))
    }

    /// The layout that the name of a file speaks of ("engine_256x256x128_uint8.raw"), if it fits the file's size. Without a
    /// type in the name, the integers of that many bytes.
    pub fn guess(path: &Path) -> Option<Self> {
        let name = path.file_stem()?.to_string_lossy().to_lowercase();
        let size = std::fs::metadata(path).ok()?.len();
        let words = || name.split(['_', '-', '.', ' ', '(', ')']);
        let dims = words().find_map(|word| {
            let edges: Option<Vec<u64>> =
                word.splitn(4, 'x').take(3).map(|n| n.parse().ok().filter(|n| *n > 0)).collect();
            <[u64; 3]>::try_from(edges?).ok()
        })?;
        // The type may hang on the sizes: 256x256x128xuint8.
        let named = name.split(['_', '-', '.', ' ', '(', ')', 'x']).find_map(element_type);
        let by_size = || {
            [ElementType::U8, ElementType::U16, ElementType::F32]
                .into_iter()
                .find(|e| stream::size_bytes(&dims, *e) == Some(size))
        };
        let element = named.or_else(by_size)?;
        let is_big = words().any(|w| matches!(w, "big" | "be" | "msb"));
        let endian = if is_big { Endian::Big } else { Endian::Little };
        let layout = Self { dims, element, spacing_mm: DVec3::ONE, endian };
        (stream::size_bytes(&dims, element) == Some(size)).then_some(layout)
    }
}

impl Display for RawLayout {
    /// As it is written, for [`RawLayout::from_str`].
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let ([x, y, z], spacing) = (self.dims, self.spacing_mm);
        let order = if self.endian == Endian::Little { "little" } else { "big" };
        write!(f, "{x}x{y}x{z}x{},{}x{}x{},{order}", self.element.name(), spacing.x, spacing.y, spacing.z)
    }
}

impl FromStr for RawLayout {
    type Err = Error;

    /// `DIMSxTYPE[,spacing][,endian]`: `256x256x128xuint8`, `256x256x128xuint16,0.5x0.5x1,big`. Spacing in mm
    /// (one number for all axes, or three), 1 mm if it is left out; little endian if that is left out.
    fn from_str(text: &str) -> Result<Self> {
        let fault = |what: String| Error::scene(what, format!("write it like {EXAMPLE}"));
        let mut parts = text.split(',').map(str::trim);
        let shape: Vec<_> = parts.next().unwrap_or_default().split('x').map(str::trim).collect();
        let [x, y, z, type_name] = shape[..] else {
            return Err(fault(format!("the raw layout `{text}` has no three sizes and a type")));
        };
        let mut dims = [0; 3];
        for (n, word) in dims.iter_mut().zip([x, y, z]) {
            *n = word
                .parse()
                .ok()
                .filter(|&n| n > 0)
                .ok_or_else(|| fault(format!("`{word}` in the raw layout `{text}` is no number of voxels")))?;
        }
        let element = element_type(type_name)
            .ok_or_else(|| fault(format!("`{type_name}` in the raw layout `{text}` is no voxel type")))?;
        let (mut spacing_mm, mut endian) = (None, None);
        for part in parts {
            let order = match part {
                "little" | "le" => Some(Endian::Little),
                "big" | "be" => Some(Endian::Big),
                _ => None,
            };
            if order.is_some() && endian.is_none() {
                endian = order;
            } else if let Some(spacing) = parse_spacing(part).filter(|_| spacing_mm.is_none()) {
                spacing_mm = Some(spacing);
            } else {
                return Err(fault(format!(
                    "`{part}` in the raw layout `{text}` is no spacing in mm and no byte order"
                )));
            }
        }
        Ok(Self {
            dims,
            element,
            spacing_mm: spacing_mm.unwrap_or(DVec3::ONE),
            endian: endian.unwrap_or(Endian::Little),
        })
    }
}

fn parse_spacing(text: &str) -> Option<DVec3> {
    let numbers: Option<Vec<f64>> =
        text.split('x').map(|w| w.trim().parse().ok().filter(|s: &f64| s.is_finite() && *s > 0.0)).collect();
    match numbers?[..] {
        [all] => Some(DVec3::splat(all)),
        [x, y, z] => Some(DVec3::new(x, y, z)),
        _ => None,
    }
}

fn element_type(name: &str) -> Option<ElementType> {
    Some(match name.to_lowercase().as_str() {
        "uint8" | "u8" | "uchar" => ElementType::U8,
        "int8" | "i8" => ElementType::I8,
        "uint16" | "u16" | "ushort" => ElementType::U16,
        "int16" | "i16" | "short" => ElementType::I16,
        "uint32" | "u32" => ElementType::U32,
        "int32" | "i32" => ElementType::I32,
        "uint64" | "u64" => ElementType::U64,
        "int64" | "i64" => ElementType::I64,
        "float32" | "f32" | "float" => ElementType::F32,
        "float64" | "f64" | "double" => ElementType::F64,
        _ => return None,
    })
}

/// Reads plain voxels as [`ReadOptions::raw`] describes them.
pub struct RawReader;

impl VolumeReader for RawReader {
    fn name(&self) -> &'static str {
        "raw voxels"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["raw", "bin", "vol"]
    }

    fn recognizes(&self, _path: &Path, _head: &[u8]) -> bool {
        false
    }

    fn survey(&self, path: &Path, options: &ReadOptions, _progress: &Progress) -> Result<Vec<Entry>> {
        Ok(vec![open(path, options)?.0])
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        let (entry, layout, mut source) = open(path, options)?;
        check_frame(path, options.frame, 1)?;
        let window = options.window.on(path, entry.grid.dims())?;
        progress.begin("reading", (entry.grid.num_voxels() * entry.bytes_per_voxel) as u64);
        let request = VoxelRequest {
            element: layout.element,
            endian: layout.endian,
            window,
            averaging: Averaging::Mean,
            is_size_checked: !source.is_gzip(),
        };
        let voxels = stream::read_voxels(&mut source, request, path, progress)?;
        source.finish(progress)?;
        volume_of(path, &entry, window, voxels, Rescale::IDENTITY, Vec::new())
    }
}

/// The file as its layout announces it, and its bytes.
fn open<'a>(path: &Path, options: &'a ReadOptions) -> Result<(Entry, &'a RawLayout, ByteSource)> {
    let layout = options
        .raw
        .as_ref()
        .ok_or_else(|| Error::NeedsLayout { path: path.to_owned(), guess: RawLayout::guess(path).map(Box::new) })?;
    let size = stream::size_bytes(&layout.dims, layout.element).ok_or_else(|| absurd_size(path, &layout.dims))?;
    // Raw voxels may begin with the two bytes of gzip by chance: the name has to agree.
    let is_named_gzip = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    let source = if is_named_gzip { ByteSource::open(path)? } else { ByteSource::open_at(path, 0, false)? };
    if !source.is_gzip() {
        let length = std::fs::metadata(path).map_err(|e| Error::io(path, &e))?.len();
        // A file that is too long was described wrongly as surely as one that is too short.
        if length != size {
            return Err(Error::file(
                path,
                format!("the raw layout needs {size} bytes, but the file has {length}"),
                "correct the sizes or the type of the layout",
            ));
        }
    }
    source.check_holds(size)?;
    let center = DVec3::from_array(layout.dims.map(|n| (n - 1) as f64 / 2.0)) * layout.spacing_mm;
    let world_from_index = DAffine3 { matrix3: DMat3::from_diagonal(layout.spacing_mm), translation: -center };
    let entry = Entry {
        key: String::new(),
        title: String::new(),
        format: "raw".to_owned(),
        modality: Modality::Unknown,
        grid: grid_of(path, layout.dims, world_from_index)?,
        orientation: Orientation::Assumed(
            "Plain voxels have no patient space: x is taken as right, y as anterior and z as superior, so left and right may be \
             swapped."
                .to_owned(),
        ),
        type_name: layout.element.name(),
        bytes_per_voxel: layout.element.num_bytes(),
        num_frames: 1,
        num_files: 1,
        is_labels: false,
        is_localizer: false,
    };
    Ok((entry, layout, source))
}

#[cfg(test)]
mod tests {
    use super::super::read_volume;
    use super::super::testing::{ALL_TYPES, Folder, encode, gzip};
    use super::*;

    fn read_as(path: &Path, layout: &str) -> Result<Volume> {
        let options = ReadOptions { raw: Some(layout.parse()?), ..ReadOptions::default() };
        read_volume(path, &options, &Progress::new())
    }

    #[test]
    fn layouts_as_written() {
        let layout: RawLayout = "256x256x128xuint8".parse().unwrap();
        assert_eq!((layout.dims(), layout.spacing_mm()), ([256, 256, 128], DVec3::ONE));
        let full: RawLayout = "2x3x4xuint16,0.5x0.5x1,big".parse().unwrap();
        assert_eq!((full.element, full.endian), (ElementType::U16, Endian::Big));
        assert_eq!(full.spacing_mm(), DVec3::new(0.5, 0.5, 1.0));
        assert_eq!("2x3x4xu16, big, 0.5x0.5x1".parse::<RawLayout>().unwrap(), full);
        let same: RawLayout = "2x3x4xf32,0.25".parse().unwrap();
        assert_eq!(same.spacing_mm(), DVec3::splat(0.25));
        for wrong in [
            "",
            "2x3x4",
            "2x3xu8",
            "0x3x4xu8",
            "-2x3x4xu8",
            "2x3x4xu9",
            "2x3x4xu8,0",
            "2x3x4xu8,1x2",
            "2x3x4xu8,nan",
            "2x3x4xu8,middle",
            "2x3x4xu8,big,little",
            "2x3x4xu8,1,1",
            "2x3x4x5xu8",
        ] {
            let sentence = wrong.parse::<RawLayout>().unwrap_err().to_string();
            assert!(sentence.contains("; write it like 256x"), "{wrong}: {sentence}");
        }
    }

    #[test]
    fn a_layout_is_written_as_it_is_read_and_guessed_from_the_name() {
        for text in ["2x3x4xuint16,0.5x0.5x1,big", "256x256x128xfloat32,1x1x1,little"] {
            assert_eq!(text.parse::<RawLayout>().unwrap().to_string(), text);
        }
        let folder = Folder::new();
        let guess =
            |name: &str, size: usize| RawLayout::guess(&folder.write(name, &vec![0; size])).map(|l| l.to_string());
        assert_eq!(guess("fuel_4x3x2_uint8.raw", 24).unwrap(), "4x3x2xuint8,1x1x1,little");
        assert_eq!(guess("a-4x3x2xint16-big.raw", 48).unwrap(), "4x3x2xint16,1x1x1,big");
        assert_eq!(guess("scan 4x3x2.raw", 48).unwrap(), "4x3x2xuint16,1x1x1,little");
        for (name, size) in [("fuel_4x3x2_uint8.raw", 25), ("scan.raw", 24), ("0x3x2.raw", 0), ("4x3.raw", 12)] {
            assert_eq!(guess(name, size), None, "{name}");
        }
        let refusal = folder.refusal("fuel_4x3x2_uint8.raw", &[0; 24]);
        assert!(refusal.contains("by its name and size: --raw 4x3x2xuint8,1x1x1,little"), "{refusal}");
    }

    #[test]
    fn voxels_of_every_type_and_order_around_the_origin() {
        let folder = Folder::new();
        let values: Vec<f64> = (0..24).map(f64::from).collect();
        for (element, name) in
            ALL_TYPES.into_iter().zip(["u8", "i8", "uint16", "short", "u32", "i32", "u64", "i64", "float", "f64"])
        {
            for (endian, order) in [(Endian::Little, "little"), (Endian::Big, "big")] {
                let bytes = encode(&values, element, endian);
                let layout = format!("2x3x4x{name},1x2x3,{order}");
                for path in [folder.write("a.raw", &bytes), folder.write("a.raw.gz", &gzip(&bytes))] {
                    let volume = read_as(&path, &layout).unwrap();
                    assert_eq!(volume.value(1, 2, 3), 23.0);
                    assert_eq!(volume.value(1, 0, 2), 13.0);
                    assert_eq!(volume.grid.orientation_letters(), "RAS");
                    let corner = volume.grid.world_from_index().transform_point3(DVec3::ZERO);
                    assert_eq!(corner, DVec3::new(-0.5, -2.0, -4.5));
                }
            }
        }
    }

    #[test]
    fn a_layout_that_does_not_fit_is_refused() {
        let folder = Folder::new();
        let path = folder.write("a.raw", &[0x1f, 0x8b, 1, 2, 3, 4, 5, 6]);
        assert_eq!(read_as(&path, "2x2x2xu8").unwrap().value(0, 0, 0), 31.0);
        for layout in ["2x2x1xu8", "2x2x3xu8", "2x2x2xu16"] {
            let refusal = read_as(&path, layout).unwrap_err().to_string();
            assert!(refusal.contains("bytes, but the file has 8"), "{refusal}");
        }
        let huge = format!("{0}x{0}x{0}xf64", u64::MAX);
        assert!(read_as(&path, &huge).unwrap_err().to_string().contains("more than any file holds"));
    }
}
