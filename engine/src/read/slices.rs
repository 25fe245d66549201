//! Slices that are decoded one by one, as one stream of bytes: pages of a TIFF file, files of a folder.

use std::io::{self, Read};
use std::ops::Range;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use super::stream::{self, ElementType, Endian, VoxelRequest};
use super::window::Averaging;
use super::{Entry, ReadOptions, color_volume_of, volume_of};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::{Orientation, Rescale, Volume};

/// What is said of a picture file, which knows no patient.
pub fn no_patient() -> Orientation {
    Orientation::Assumed(
        "The file has no patient space: x is taken as left, y (rows, downwards) as posterior and z as superior, as in axial \
         images, so left and right may be swapped."
            .to_owned(),
    )
}

/// What the pixels of a slice are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelKind {
    /// Numbers of a type.
    Values(ElementType),
    /// sRGB without alpha.
    Rgb,
    /// sRGB with straight alpha.
    Rgba,
}

impl PixelKind {
    /// As [`Entry::type_name`].
    pub fn name(self) -> &'static str {
        match self {
            Self::Values(element) => element.name(),
            Self::Rgb => "rgb",
            Self::Rgba => "rgba",
        }
    }

    /// Bytes of a decoded pixel: of its type, or of four 8-bit channels.
    pub fn num_bytes(self) -> usize {
        match self {
            Self::Values(element) => element.num_bytes(),
            Self::Rgb | Self::Rgba => 4,
        }
    }

    /// As [`Entry::bytes_per_voxel`]: colors keep their luminance as well.
    pub fn bytes_per_voxel(self) -> usize {
        match self {
            Self::Values(element) => element.num_bytes(),
            Self::Rgb | Self::Rgba => 6,
        }
    }
}

/// The affine of slices without a place: x left, y posterior, z superior, which shows axial images as they are mostly
/// stored and mirrors nothing; the middle of the grid is the origin.
pub fn world_without_patient(dims: [u64; 3], spacing_mm: DVec3) -> DAffine3 {
    let steps = DVec3::new(-spacing_mm.x, -spacing_mm.y, spacing_mm.z);
    let center = DVec3::from_array(dims.map(|n| n.saturating_sub(1) as f64 / 2.0)) * steps;
    DAffine3 { matrix3: DMat3::from_diagonal(steps), translation: -center }
}

/// Reads a volume of slices, of which `decode` gives the pixels: numbers in the machine's byte order or RGBA.
///
/// # Errors
/// Those of `decode`, and as [`stream::read_voxels`].
#[expect(clippy::too_many_arguments, reason = "one call for each of two readers")]
pub fn read(
    path: &Path,
    entry: &Entry,
    kind: PixelKind,
    rescale: Rescale,
    warnings: Vec<String>,
    options: &ReadOptions,
    progress: &Progress,
    decode: impl FnMut(usize) -> Result<Vec<u8>>,
) -> Result<Volume> {
    let window = options.window.on(path, entry.grid.dims())?;
    let [nx, ny, nz] = entry.grid.dims();
    let slice_bytes = nx * ny * kind.num_bytes();
    progress.begin("reading", (slice_bytes * nz) as u64);
    let mut slices = Slices {
        decode,
        wanted: window.range(2),
        count: nz,
        slice_bytes,
        next: 0,
        bytes: Vec::new(),
        position: 0,
        left: 0,
    };
    match kind {
        PixelKind::Values(element) => {
            let endian = Endian::NATIVE;
            let request = VoxelRequest { element, endian, window, averaging: Averaging::Mean, is_size_checked: false };
            let voxels = stream::read_voxels(&mut slices, request, path, progress)?;
            volume_of(path, entry, window, voxels, rescale, warnings)
        }
        PixelKind::Rgb | PixelKind::Rgba => {
            let colors = stream::read_colors(&mut slices, 4, window, path, progress)?;
            color_volume_of(path, entry, window, colors, warnings)
        }
    }
}

/// The pixels of all slices for [`Read`]; of those that are not wanted zeros, as nobody looks at them.
struct Slices<F> {
    decode: F,
    wanted: Range<usize>,
    count: usize,
    slice_bytes: usize,
    next: usize,
    /// The present slice; empty for one that is not wanted.
    bytes: Vec<u8>,
    position: usize,
    /// Bytes of the present slice to come.
    left: usize,
}

impl<F: FnMut(usize) -> Result<Vec<u8>>> Read for Slices<F> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.left == 0 {
            if self.next == self.count {
                return Ok(0);
            }
            self.bytes = Vec::new();
            if self.wanted.contains(&self.next) {
                self.bytes = (self.decode)(self.next).map_err(io::Error::other)?;
            }
            (self.position, self.left) = (0, self.slice_bytes);
            self.next += 1;
        }
        let n = self.left.min(buffer.len());
        match self.bytes.get(self.position..self.position + n) {
            Some(bytes) => buffer[..n].copy_from_slice(bytes),
            None => buffer[..n].fill(0),
        }
        self.position += n;
        self.left -= n;
        Ok(n)
    }
}
