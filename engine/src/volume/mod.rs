//! The volume: voxels as they were stored, the rescale to data values (CT: HU) and the grid in the world.
//! Everything downstream (statistics, bricks, upload, reference) reads it through this file.

pub mod bricks;
pub(crate) mod colors;
pub mod edges;
pub mod filter;
pub mod gradient;
pub mod joint;
pub mod labels;
pub mod no_data;
pub mod prefilter;
pub mod statistics;

use std::ops::Range;
use std::path::PathBuf;
use std::sync::OnceLock;

use bricks::MinMaxBricks;
use glam::{DAffine3, DVec3};
use labels::{Label, LabelMap};
use no_data::fill_no_data;
use statistics::Statistics;

use crate::error::Result;
use crate::progress::Progress;
use crate::spaces::Grid;

/// Voxels in the type of the file, x fastest. One copy in memory, never widened.
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "each variant is its element type")]
pub enum Voxels {
    U8(Vec<u8>),
    I8(Vec<i8>),
    U16(Vec<u16>),
    I16(Vec<i16>),
    U32(Vec<u32>),
    I32(Vec<i32>),
    U64(Vec<u64>),
    I64(Vec<i64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// Runs `$body` with `$slice` bound to the typed voxel slice, whichever type it has.
#[macro_export]
macro_rules! with_voxels {
    ($voxels:expr, $slice:ident => $body:expr) => {
        match $voxels {
            $crate::volume::Voxels::U8($slice) => $body,
            $crate::volume::Voxels::I8($slice) => $body,
            $crate::volume::Voxels::U16($slice) => $body,
            $crate::volume::Voxels::I16($slice) => $body,
            $crate::volume::Voxels::U32($slice) => $body,
            $crate::volume::Voxels::I32($slice) => $body,
            $crate::volume::Voxels::U64($slice) => $body,
            $crate::volume::Voxels::I64($slice) => $body,
            $crate::volume::Voxels::F32($slice) => $body,
            $crate::volume::Voxels::F64($slice) => $body,
        }
    };
}

/// A stored number that can become a data value.
pub trait Voxel: Copy + PartialOrd + Send + Sync + 'static {
    /// The stored number as f64 (64-bit integers above 2⁵³ round).
    fn to_f64(self) -> f64;
    /// Whether it is a number at all (false for NaN and ±Inf).
    fn is_finite(self) -> bool;
}

macro_rules! impl_voxel {
    ($($t:ty),*; $($f:ty),*) => {
        $(impl Voxel for $t {
            fn to_f64(self) -> f64 { self as f64 }
            fn is_finite(self) -> bool { true }
        })*
        $(impl Voxel for $f {
            fn to_f64(self) -> f64 { f64::from(self) }
            fn is_finite(self) -> bool { self.is_finite() }
        })*
    };
}
impl_voxel!(u8, i8, u16, i16, u32, i32, u64, i64; f32, f64);

impl Voxels {
    /// Number of voxels.
    pub fn len(&self) -> usize {
        with_voxels!(self, v => v.len())
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Name of the element type as NumPy spells it ("int16").
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::U8(_) => "uint8",
            Self::I8(_) => "int8",
            Self::U16(_) => "uint16",
            Self::I16(_) => "int16",
            Self::U32(_) => "uint32",
            Self::I32(_) => "int32",
            Self::U64(_) => "uint64",
            Self::I64(_) => "int64",
            Self::F32(_) => "float32",
            Self::F64(_) => "float64",
        }
    }

    /// Ranges of them, one after the other.
    fn gathered(&self, ranges: impl Iterator<Item = Range<usize>>) -> Self {
        fn of<T: Copy>(voxels: &[T], ranges: impl Iterator<Item = Range<usize>>) -> Vec<T> {
            ranges.flat_map(|range| voxels[range].iter().copied()).collect()
        }
        match self {
            Self::U8(v) => Self::U8(of(v, ranges)),
            Self::I8(v) => Self::I8(of(v, ranges)),
            Self::U16(v) => Self::U16(of(v, ranges)),
            Self::I16(v) => Self::I16(of(v, ranges)),
            Self::U32(v) => Self::U32(of(v, ranges)),
            Self::I32(v) => Self::I32(of(v, ranges)),
            Self::U64(v) => Self::U64(of(v, ranges)),
            Self::I64(v) => Self::I64(of(v, ranges)),
            Self::F32(v) => Self::F32(of(v, ranges)),
            Self::F64(v) => Self::F64(of(v, ranges)),
        }
    }

    /// Bytes of one voxel.
    pub fn bytes_per_voxel(&self) -> usize {
        match self {
            Self::U8(_) | Self::I8(_) => 1,
            Self::U16(_) | Self::I16(_) => 2,
            Self::U32(_) | Self::I32(_) | Self::F32(_) => 4,
            Self::U64(_) | Self::I64(_) | Self::F64(_) => 8,
        }
    }
}

/// An element type for people ("16-bit unsigned integers"), from the name that [`Voxels::type_name`] and
/// [`Entry::type_name`](crate::read::Entry::type_name) give it.
pub fn type_in_words(type_name: &str) -> &str {
    match type_name {
        "uint8" => "8-bit unsigned integers",
        "int8" => "8-bit signed integers",
        "uint16" => "16-bit unsigned integers",
        "int16" => "16-bit signed integers",
        "uint32" => "32-bit unsigned integers",
        "int32" => "32-bit signed integers",
        "uint64" => "64-bit unsigned integers",
        "int64" => "64-bit signed integers",
        "float32" => "32-bit floating-point numbers",
        "float64" => "64-bit floating-point numbers",
        "rgb" => "RGB colors",
        "rgba" => "RGB colors with alpha",
        other => other,
    }
}

/// data value = stored × slope + intercept (CT: HU). The identity where a file says nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rescale {
    /// Factor, finite and not 0.
    pub slope: f64,
    /// Offset, finite.
    pub intercept: f64,
}

impl Rescale {
    /// Stored numbers are data values.
    pub const IDENTITY: Self = Self { slope: 1.0, intercept: 0.0 };

    /// The data value of a stored number.
    pub fn value(self, stored: f64) -> f64 {
        stored * self.slope + self.intercept
    }
}

/// What the voxels measure, as far as the file says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Modality {
    /// Hounsfield units.
    Ct,
    /// Magnetic resonance: arbitrary units.
    Mr,
    /// Positron emission tomography.
    Pet,
    /// Single-photon emission: scintigraphy, SPECT.
    Nuclear,
    /// Ultrasound.
    Ultrasound,
    /// Radiography, mammography, fluoroscopy, angiography, tomosynthesis.
    XRay,
    /// Not stated.
    #[default]
    Unknown,
}

impl Modality {
    /// As scanners name it; empty where it is not stated.
    pub fn abbreviation(self) -> &'static str {
        match self {
            Self::Ct => "CT",
            Self::Mr => "MR",
            Self::Pet => "PET",
            Self::Nuclear => "NM",
            Self::Ultrasound => "US",
            Self::XRay => "X-ray",
            Self::Unknown => "",
        }
    }

    /// What follows its values: their unit after a blank, where they have one.
    pub fn suffix(self) -> &'static str {
        if self == Self::Ct { " HU" } else { "" }
    }
}

/// Where the letters of a volume's axes (R L A P S I) come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Orientation {
    /// Its file says how the axes lie in the body, or it was made so.
    Stated,
    /// Its file does not: a sentence about why, and what was assumed. Left and right may be swapped.
    Assumed(String),
}

impl Orientation {
    /// Whether the file says it.
    pub fn is_known(&self) -> bool {
        *self == Self::Stated
    }

    /// What was assumed and why, if the file does not say it.
    pub fn assumption(&self) -> Option<&str> {
        match self {
            Self::Stated => None,
            Self::Assumed(why) => Some(why),
        }
    }
}

/// A scalar volume in the world.
#[derive(Clone, Debug)]
pub struct Volume {
    /// Size and place in the world.
    pub grid: Grid,
    /// Whether the letters of its axes are the file's or assumed; a volume without a file has its maker's.
    pub orientation: Orientation,
    /// The stored numbers, `grid.num_voxels()` of them, x fastest.
    pub voxels: Voxels,
    /// From stored numbers to data values.
    pub rescale: Rescale,
    /// What the data values mean.
    pub modality: Modality,
    /// The color of every voxel, sRGB with straight alpha, of a volume of colors; `voxels` are then their linear luminances.
    pub colors: Option<Vec<[u8; 4]>>,
    /// The layers of the label map whose structures have these colors; none if they are no structures'.
    pub labels: Vec<LabelMap>,
    /// How the file describes it ("Abdomen 5.0"); may be empty.
    pub description: String,
    /// The file format it came from ("NIfTI-1", "specimen").
    pub format: String,
    /// The file or folder it came from, if any.
    pub source: Option<PathBuf>,
    /// How many frames the file holds; this volume is one of them.
    pub num_frames: usize,
    /// What the user should know about how the file was read, a sentence each.
    pub warnings: Vec<String>,
    derived: Derived,
}

/// What is computed from the voxels once, when first asked for. Voxels never change after loading.
#[derive(Clone, Debug, Default)]
struct Derived {
    bricks: OnceLock<MinMaxBricks>,
    statistics: OnceLock<Statistics>,
    gradient_max: OnceLock<f64>,
}

impl Volume {
    /// A volume without a file.
    ///
    /// # Errors
    /// A clause, if the number of voxels is not that of the grid or the rescale is not finite or has slope 0.
    pub fn new(grid: Grid, voxels: Voxels, rescale: Rescale, format: &str) -> std::result::Result<Self, String> {
        if voxels.len() != grid.num_voxels() {
            return Err(format!("{} voxels do not fill a grid of {}", voxels.len(), grid.num_voxels()));
        }
        if !(rescale.slope.is_finite() && rescale.intercept.is_finite() && rescale.slope != 0.0) {
            return Err(format!("rescale slope {} and intercept {} are unusable", rescale.slope, rescale.intercept));
        }
        Ok(Self {
            grid,
            orientation: Orientation::Stated,
            voxels,
            rescale,
            modality: Modality::Unknown,
            colors: None,
            labels: Vec::new(),
            description: String::new(),
            format: format.to_owned(),
            source: None,
            num_frames: 1,
            warnings: Vec::new(),
            derived: Derived::default(),
        })
    }

    /// A volume of colors, sRGB with straight alpha: its values are their linear luminances, 0 to 1 (Rec. 709 weights), in
    /// steps of 1/65535, which the adapter keeps exactly. Where alpha is 0 a neighbor's luminance stands in.
    ///
    /// # Errors
    /// As [`Volume::new`].
    pub fn from_colors(grid: Grid, colors: Vec<[u8; 4]>, format: &str) -> std::result::Result<Self, String> {
        if colors.len() != grid.num_voxels() {
            return Err(format!("{} voxels do not fill a grid of {}", colors.len(), grid.num_voxels()));
        }
        let luminances = colors::luminances(&colors, grid.dims());
        let rescale = Rescale { slope: 1.0 / 65535.0, intercept: 0.0 };
        let volume = Self::new(grid, Voxels::U16(luminances), rescale, format)?;
        Ok(Self { colors: Some(colors), ..volume })
    }

    /// Data value at a voxel (NaN and ±Inf as stored).
    ///
    /// # Panics
    /// If the index is outside the grid.
    pub fn value(&self, x: usize, y: usize, z: usize) -> f64 {
        let [nx, ny, _] = self.grid.dims();
        let i = x + nx * (y + ny * z);
        self.rescale.value(with_voxels!(&self.voxels, v => v[i].to_f64()))
    }

    /// Ranges of stored numbers in bricks of 8³ voxels; computed on the first call.
    pub fn bricks(&self) -> &MinMaxBricks {
        self.derived.bricks.get_or_init(|| {
            let bricks = MinMaxBricks::compute(&fill_no_data(self).voxels, self.grid.dims());
            match &self.colors {
                Some(colors) => bricks.without_clear(colors, self.grid.dims()),
                None => bricks,
            }
        })
    }

    /// G: the ‖g‖, in data units per mm, that counts as 1 ([`gradient::gradient_max`]); computed on the first call.
    pub fn gradient_max(&self) -> f64 {
        *self.derived.gradient_max.get_or_init(|| gradient::gradient_max(self, &fill_no_data(self).voxels))
    }

    /// Range, background and percentiles of the data values; computed on the first call.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled) on request.
    pub fn statistics(&self, progress: &Progress) -> Result<&Statistics> {
        if let Some(known) = self.derived.statistics.get() {
            return Ok(known);
        }
        let computed = Statistics::compute(self, progress)?;
        Ok(self.derived.statistics.get_or_init(|| computed))
    }

    /// What [`Volume::statistics`] has found, if it has been asked.
    pub fn known_statistics(&self) -> Option<&Statistics> {
        self.derived.statistics.get()
    }

    /// The structures at a place in the world (RAS mm), one a layer, of a volume that shows structures in their colors.
    pub fn structures_at(&self, position_mm: DVec3) -> Vec<&Label> {
        self.labels.iter().filter_map(|layer| layer.label_at(position_mm)).collect()
    }

    /// A box of it, where it lies: from the first to, exclusive, the last voxel along each index axis. Without its colors and structures.
    ///
    /// # Panics
    /// If there is no voxel in it, or it is not within the volume.
    #[must_use]
    pub fn cropped(&self, part: [[usize; 2]; 3]) -> Self {
        let [nx, ny, _] = self.grid.dims();
        let [x, y, z] = part;
        let rows = (z[0]..z[1]).flat_map(|z| (y[0]..y[1]).map(move |y| nx * (y + ny * z)));
        let voxels = self.voxels.gathered(rows.map(|row| row + x[0]..row + x[1]));
        let first = DVec3::from_array(part.map(|p| p[0] as f64));
        let affine = self.grid.world_from_index() * DAffine3::from_translation(first);
        let grid = Grid::new(part.map(|p| p[1] - p[0]), affine).unwrap_or_else(|e| panic!("{e}"));
        Self {
            grid,
            orientation: self.orientation.clone(),
            voxels,
            rescale: self.rescale,
            modality: self.modality,
            colors: None,
            labels: Vec::new(),
            description: self.description.clone(),
            format: self.format.clone(),
            source: self.source.clone(),
            num_frames: self.num_frames,
            warnings: self.warnings.clone(),
            derived: Derived::default(),
        }
    }

    /// Decoded size in bytes: voxels in the stored type, colors, and numbers of structures.
    pub fn num_bytes(&self) -> usize {
        let colors = self.colors.as_ref().map_or(0, |_| 4);
        self.voxels.len() * (self.voxels.bytes_per_voxel() + colors + 2 * self.labels.len())
    }
}
