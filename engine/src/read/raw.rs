//! Plain voxels without a header: the user says how they lie ([`RawLayout`], `--raw` on the command line).
//!
//! World: the index axes are taken as right, anterior, superior (RAS), and the middle of the grid is the origin.

use std::path::Path;
use std::str::FromStr;

use glam::{DAffine3, DMat3, DVec3};

use super::stream::{self, ByteSource, ElementType, Endian, VoxelRequest};
use super::{Parts, ReadOptions, VolumeReader, absurd_size, check_frame, grid_of};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Rescale, Volume};

/// How the layout is written, for messages.
pub(super) const EXAMPLE: &str =
    "--raw 256x256x128xuint16,0.5x0.5x1,big (sizes and type; spacing in mm and byte order may be left out)";

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

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        let layout = options.raw.as_ref().ok_or_else(|| {
            Error::file(path, "a raw file does not say how its voxels lie", format!("add the layout: {EXAMPLE}"))
        })?;
        check_frame(path, options.frame, 1)?;
        let size = stream::size_bytes(&layout.dims, layout.element).ok_or_else(|| absurd_size(path, &layout.dims))?;
        // Raw voxels may begin with the two bytes of gzip by chance: the name has to agree.
        let is_named_gzip = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
        let mut source = if is_named_gzip { ByteSource::open(path)? } else { ByteSource::open_at(path, 0, false)? };
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
        let grid = grid_of(path, layout.dims, world_from_index)?;
        progress.begin("reading", size);
        let request = VoxelRequest {
            element: layout.element,
            endian: layout.endian,
            count: grid.num_voxels(),
            is_size_checked: !source.is_gzip(),
        };
        let voxels = stream::read_voxels(&mut source, request, path, progress)?;
        let mut warnings = Vec::new();
        source.finish(&mut warnings)?;
        Parts { path, grid, voxels, rescale: Rescale::IDENTITY, format: "raw", num_frames: 1, warnings }.into_volume()
    }
}
