//! Slices: any field on a voxel grid, resampled on a plane through it, on the CPU and from the voxels as they are. Values become
//! gray by a window, colors stay what they are, and fields from 0 to 1 (which voxels are selected) are laid over with a tint.
//!
//! Geometry is f64. Between voxel centers fields are trilinear, as pictures reconstruct them (docs/rendering.md §2); the outer half
//! voxel has the edge's value, and beyond it there is nothing.

pub mod anatomical;

use std::hint::black_box;
use std::num::NonZero;
use std::ops::Range;

use glam::{DVec3, DVec4};

use crate::color::{premultiplied_linear_from_srgb8, straight_srgb8_from_premultiplied_linear};
use crate::reference::sample::Quantity;
use crate::spaces::Grid;
use crate::volume::{Rescale, Volume, Voxel};
use crate::with_voxels;

/// A plane in the world with pixels on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// The middle of the top left pixel: world (RAS), mm.
    pub origin_mm: DVec3,
    /// From the middle of a pixel to that of its right neighbor, mm.
    pub right_mm: DVec3,
    /// From the middle of a pixel to that of the one below, mm.
    pub down_mm: DVec3,
    /// Columns and rows.
    pub size: [usize; 2],
}

impl Plane {
    /// World mm of a (fractional) pixel, whose middle is at whole numbers.
    pub fn at(&self, x: f64, y: f64) -> DVec3 {
        self.origin_mm + x * self.right_mm + y * self.down_mm
    }
}

/// What a field is between voxel centers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// Trilinear.
    Linear,
    /// The value of the nearest voxel: numbers of structures, and voxels that are to be seen as such.
    Nearest,
}

/// A field: a number, or a color, for every voxel of a grid.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a, T> {
    /// Where the voxels are.
    pub grid: &'a Grid,
    /// As many as the grid has, x fastest.
    pub voxels: &'a [T],
}

/// What a pixel of the plane meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sample<V> {
    /// Nothing: it lies outside the grid.
    Outside,
    /// Voxels without a value (NaN, ±Inf), by more than half.
    Gap,
    /// A value.
    Data(V),
}

/// What a voxel may be.
pub trait Texel: Copy + Sync {
    /// What is interpolated.
    type Value: Quantity;
    /// Of this voxel.
    fn value(self) -> Self::Value;
    /// Whether it, or what came of several, has a value at all.
    fn is_data(value: Self::Value) -> bool;
}

/// Stored numbers; rescaling follows, as it is linear.
impl<T: Voxel> Texel for T {
    type Value = f64;

    fn value(self) -> f64 {
        self.to_f64()
    }

    fn is_data(value: f64) -> bool {
        value.is_finite()
    }
}

/// sRGB with straight alpha; interpolated as premultiplied linear light.
impl Texel for [u8; 4] {
    type Value = DVec4;

    fn value(self) -> DVec4 {
        DVec4::from_array(premultiplied_linear_from_srgb8(self).map(f64::from))
    }

    fn is_data(_: DVec4) -> bool {
        true
    }
}

/// Half a voxel beyond the outer centers, and what f64 may lose on the way there (voxels).
const REACH: f64 = 0.5 + 1e-9;
/// Where a pixel spans more voxels, it is the mean of at most so many samples along each side.
const MAX_SUBSAMPLES: usize = 4;
/// Samples that are worth a thread of their own.
const SAMPLES_PER_THREAD: usize = 1 << 15;
const MAX_THREADS: usize = 8;

/// The field on the plane: what `pixel` (given column, row and sample) makes of every pixel, row by row from the top.
///
/// A pixel that spans several voxels is the mean of samples a voxel or so apart (of [`Filter::Linear`] only), so that a slice that
/// is shown small neither flickers nor loses thin things.
///
/// It works on threads of its own and not in the shared pool: what waits there for the 3-D picture may take seconds.
///
/// # Panics
/// If the field has another number of voxels than its grid.
pub fn resample<T: Texel, P: Copy + Default + Send>(
    field: Field<'_, T>,
    plane: &Plane,
    filter: Filter,
    pixel: impl Fn([usize; 2], Sample<T::Value>) -> P + Sync,
) -> Vec<P> {
    let size = plane.size;
    let lattice = Lattice::new(field, plane, filter);
    let mut pixels = vec![P::default(); size[0] * size[1]];
    let num_samples = pixels.len() * lattice.subsamples[0] * lattice.subsamples[1];
    let cores = std::thread::available_parallelism().map_or(1, NonZero::get).min(MAX_THREADS);
    let num_threads = (num_samples / SAMPLES_PER_THREAD).clamp(1, cores);
    let rows_each = size[1].div_ceil(num_threads).max(1);
    let band = |first: usize, pixels: &mut [P]| {
        let mut row_of_samples = Row::default();
        for (y, row) in (first..).zip(pixels.chunks_mut(size[0].max(1))) {
            lattice.row(y, row.len(), &mut row_of_samples, |x, sample| row[x] = pixel([x, y], sample));
        }
    };
    std::thread::scope(|scope| {
        let mut bands = pixels.chunks_mut((rows_each * size[0]).max(1)).enumerate();
        let mine = bands.next();
        for (i, pixels) in bands {
            let band = &band;
            scope.spawn(move || band(i * rows_each, pixels));
        }
        if let Some((_, pixels)) = mine {
            band(0, pixels);
        }
    });
    pixels
}

/// A field with the plane in its index space.
struct Lattice<'a, T> {
    voxels: &'a [T],
    dims: [usize; 3],
    origin: DVec3,
    right: DVec3,
    down: DVec3,
    filter: Filter,
    /// Samples along the sides of a pixel.
    subsamples: [usize; 2],
}

impl<'a, T: Texel> Lattice<'a, T> {
    fn new(field: Field<'a, T>, plane: &Plane, filter: Filter) -> Self {
        assert_eq!(field.voxels.len(), field.grid.num_voxels(), "a field fills its grid");
        let index_from_world = field.grid.index_from_world();
        let right = index_from_world.transform_vector3(plane.right_mm);
        let down = index_from_world.transform_vector3(plane.down_mm);
        let subsamples = [right, down].map(|step| {
            let voxels = step.abs().max_element();
            if filter == Filter::Nearest { 1 } else { ((voxels - 0.25).ceil().max(1.0) as usize).min(MAX_SUBSAMPLES) }
        });
        Self {
            voxels: field.voxels,
            dims: field.grid.dims(),
            origin: index_from_world.transform_point3(plane.origin_mm),
            right,
            down,
            filter,
            subsamples,
        }
    }

    /// The pixels of row `y`, one by one.
    fn row(&self, y: usize, width: usize, row: &mut Row<T::Value>, mut pixel: impl FnMut(usize, Sample<T::Value>)) {
        let [across, along] = self.subsamples;
        let offset = |i: usize, n: usize| (i as f64 + 0.5) / n as f64 - 0.5;
        row.means.clear();
        row.means.resize(width, Mean::default());
        for j in 0..along {
            let start = self.origin + (y as f64 + offset(j, along)) * self.down + offset(0, across) * self.right;
            let step = self.right * (across as f64).recip();
            row.cells.clear();
            row.cells.extend((0..width * across).map(|i| {
                let cell = self.cell(start + i as f64 * step);
                // Across the rows of the memory every sample waits for it. Asked for here, where there is little else to do,
                // many are on their way at once (three times as fast).
                if let Some(cell) = &cell {
                    black_box(self.voxels[cell.first + cell.steps[1] + cell.steps[2]]);
                }
                cell
            }));
            if across * along == 1 {
                row.cells.iter().enumerate().for_each(|(x, cell)| pixel(x, self.sample(cell.as_ref())));
                return;
            }
            for (mean, cells) in row.means.iter_mut().zip(row.cells.chunks(across)) {
                cells.iter().for_each(|cell| mean.add(self.sample(cell.as_ref())));
            }
        }
        row.means.iter().enumerate().for_each(|(x, mean)| pixel(x, mean.sample(across * along)));
    }

    /// The voxels around a place in index space; none outside.
    fn cell(&self, p: DVec3) -> Option<Cell> {
        let last = DVec3::from_array(self.dims.map(|n| n as f64 - 1.0));
        // NaN is outside too.
        if !(p.cmpge(DVec3::splat(-REACH)) & p.cmple(last + REACH)).all() {
            return None;
        }
        let p = p.clamp(DVec3::ZERO, last);
        let p = if self.filter == Filter::Nearest { (p + 0.5).floor().min(last) } else { p };
        let [nx, ny, _] = self.dims;
        let mut cell = Cell { first: 0, steps: [0; 3], weights: [0.0; 3] };
        for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
            // By way of i64, whose cast is a single instruction.
            let at = p[axis] as i64;
            let weight = p[axis] - at as f64;
            cell.first += stride * at as usize;
            // Where there is no way to the next voxel, it need not exist.
            if weight > 0.0 {
                (cell.steps[axis], cell.weights[axis]) = (stride, weight);
            }
        }
        Some(cell)
    }

    fn sample(&self, cell: Option<&Cell>) -> Sample<T::Value> {
        let Some(&Cell { first, steps: [right, down, deep], weights: [wx, wy, wz] }) = cell else {
            return Sample::Outside;
        };
        let at = |i: usize| self.voxels[i].value();
        // Keeps a constant exactly, which a(1 − w) + bw does not.
        let lerp = |a: T::Value, b: T::Value, w: f64| a + (b - a) * w;
        let line = |i: usize| if right == 0 { at(i) } else { lerp(at(i), at(i + right), wx) };
        let layer = |i: usize| if down == 0 { line(i) } else { lerp(line(i), line(i + down), wy) };
        let value = if deep == 0 { layer(first) } else { lerp(layer(first), layer(first + deep), wz) };
        if T::is_data(value) {
            return Sample::Data(value);
        }
        // What of the eight has data, by its weight.
        let (mut sum, mut total) = (None, 0.0);
        for (z, wz) in [(0, 1.0 - wz), (deep, wz)] {
            for (y, wy) in [(0, 1.0 - wy), (down, wy)] {
                for (x, wx) in [(0, 1.0 - wx), (right, wx)] {
                    let (value, weight) = (at(first + x + y + z), wx * wy * wz);
                    if weight > 0.0 && T::is_data(value) {
                        total += weight;
                        let so_far = sum.unwrap_or(value);
                        sum = Some(so_far + (value - so_far) * (weight / total));
                    }
                }
            }
        }
        match sum {
            Some(sum) if total >= 0.5 => Sample::Data(sum),
            _ => Sample::Gap,
        }
    }
}

/// Eight voxels, or fewer where a place lies on a line between them.
#[derive(Clone, Copy)]
struct Cell {
    /// Position of the first in memory.
    first: usize,
    /// From it to its neighbors along x, y, z; 0 where the place does not lie between two.
    steps: [usize; 3],
    /// How far the place is on the way to them, from 0 to 1.
    weights: [f64; 3],
}

/// What a row of pixels is made with.
struct Row<V> {
    cells: Vec<Option<Cell>>,
    means: Vec<Mean<V>>,
}

impl<V> Default for Row<V> {
    fn default() -> Self {
        Self { cells: Vec::new(), means: Vec::new() }
    }
}

/// The mean of the samples of a pixel.
#[derive(Clone, Copy)]
struct Mean<V> {
    value: Option<V>,
    num_data: usize,
    num_gaps: usize,
}

impl<V> Default for Mean<V> {
    fn default() -> Self {
        Self { value: None, num_data: 0, num_gaps: 0 }
    }
}

impl<V: Quantity> Mean<V> {
    fn add(&mut self, sample: Sample<V>) {
        match sample {
            Sample::Outside => {}
            Sample::Gap => self.num_gaps += 1,
            Sample::Data(value) => {
                self.num_data += 1;
                // As a running mean it keeps a constant.
                let mean = self.value.unwrap_or(value);
                self.value = Some(mean + (value - mean) * (self.num_data as f64).recip());
            }
        }
    }

    fn sample(&self, num_samples: usize) -> Sample<V> {
        match self.value {
            _ if 2 * (self.num_data + self.num_gaps) < num_samples => Sample::Outside,
            Some(mean) if self.num_data >= self.num_gaps => Sample::Data(mean),
            _ => Sample::Gap,
        }
    }
}

/// Which values become which gray: black at `level − width/2`, white at `level + width/2`, straight between them (DICOM PS3.3
/// C.11.2.1.3.2, LINEAR_EXACT).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// The data value that becomes middle gray.
    pub level: f64,
    /// From black to white, in data values; above 0.
    pub width: f64,
}

impl Window {
    /// From black at `low` to white at `high`; a range of nothing is widened by what f64 can tell apart.
    pub fn of_range(low: f64, high: f64) -> Self {
        let level = 0.5 * (low + high);
        Self { level, width: (high - low).max(level.abs() * 1e-12).max(f64::MIN_POSITIVE) }
    }

    /// The gray of a value, 0 to 255.
    pub fn gray(self, value: f64) -> u8 {
        // Casts saturate.
        (((value - self.level) / self.width + 0.5) * 255.0 + 0.5) as u8
    }
}

/// Gaps are hatched with this on nothing: state is never told by a color alone.
const HATCH: [u8; 4] = [120, 126, 134, 255];
/// Pixels from one line of the hatching to the next.
const HATCH_PX: usize = 7;

/// The picture of a volume on a plane, sRGB with straight alpha, row by row from the top: grays by the window, or the volume's
/// colors; transparent outside, gaps hatched.
pub fn draw(volume: &Volume, plane: &Plane, filter: Filter, window: Window) -> Vec<[u8; 4]> {
    let grid = &volume.grid;
    let gap = |[x, y]: [usize; 2]| if (x + y).is_multiple_of(HATCH_PX) { HATCH } else { [0; 4] };
    if let Some(colors) = &volume.colors {
        return resample(Field { grid, voxels: &colors[..] }, plane, filter, |at, sample| match sample {
            Sample::Outside => [0; 4],
            Sample::Gap => gap(at),
            Sample::Data(color) => straight_srgb8_from_premultiplied_linear(color.as_vec4().to_array()),
        });
    }
    let Rescale { slope, intercept } = volume.rescale;
    with_voxels!(&volume.voxels, voxels => {
        resample(Field { grid, voxels: &voxels[..] }, plane, filter, |at, sample| match sample {
            Sample::Outside => [0; 4],
            Sample::Gap => gap(at),
            Sample::Data(stored) => {
                let gray = window.gray(stored * slope + intercept);
                [gray, gray, gray, 255]
            }
        })
    })
}

/// The data value of a volume at a place (world mm), between voxels as a slice shows it.
pub fn value_at(volume: &Volume, position_mm: DVec3, filter: Filter) -> Sample<f64> {
    let plane = Plane { origin_mm: position_mm, right_mm: DVec3::ZERO, down_mm: DVec3::ZERO, size: [1, 1] };
    let grid = &volume.grid;
    let sample = with_voxels!(&volume.voxels, voxels => {
        let lattice = Lattice::new(Field { grid, voxels: &voxels[..] }, &plane, filter);
        lattice.sample(lattice.cell(lattice.origin).as_ref())
    });
    match sample {
        Sample::Data(stored) => Sample::Data(volume.rescale.value(stored)),
        other => other,
    }
}

/// How a field from 0 to 1 is laid over a slice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tint {
    /// sRGB.
    pub color: [u8; 3],
    /// Of the color where the field is 1, from 0 to 1.
    pub opacity: f64,
    /// Whether the pixels within, at the border of what is at least one half, have the color alone.
    pub outlined: bool,
}

/// Lays memberships (0: not at all, 255: wholly) over a picture of the same plane, sRGB with straight alpha as [`draw`] made it.
///
/// # Panics
/// If the picture has another size than the plane, or the field another number of voxels than its grid.
pub fn lay_over(picture: &mut [[u8; 4]], plane: &Plane, memberships: Field<'_, u8>, tint: Tint) {
    let [width, height] = plane.size;
    assert_eq!(picture.len(), width * height, "a picture has the plane's size");
    let shares = resample(memberships, plane, Filter::Linear, |_, sample| match sample {
        Sample::Data(share) => (share / 255.0) as f32,
        _ => 0.0,
    });
    let inside = |x: usize, y: usize| shares[x + width * y] >= 0.5;
    let around = |at: usize, n: usize| -> Range<usize> { at.saturating_sub(1)..(at + 2).min(n) };
    for y in 0..height {
        for x in 0..width {
            let share = f64::from(shares[x + width * y]);
            let is_edge = || around(x, width).any(|x| !inside(x, y)) || around(y, height).any(|y| !inside(x, y));
            let weight = if tint.outlined && inside(x, y) && is_edge() { 1.0 } else { share * tint.opacity };
            if weight > 0.0 {
                let under = &mut picture[x + width * y];
                *under = over(*under, tint.color, weight.min(1.0));
            }
        }
    }
}

/// A color with an alpha over another, as screens blend: in sRGB codes.
fn over(under: [u8; 4], [r, g, b]: [u8; 3], alpha: f64) -> [u8; 4] {
    let below = f64::from(under[3]) / 255.0 * (1.0 - alpha);
    let total = alpha + below;
    let mix = |top: u8, bottom: u8| ((f64::from(top) * alpha + f64::from(bottom) * below) / total).round() as u8;
    [mix(r, under[0]), mix(g, under[1]), mix(b, under[2]), (total * 255.0).round() as u8]
}

/// How many pixels a plane has to a voxel, along that of its two axes where they are fewer. Above some eight, one sees voxels.
pub fn pixels_per_voxel(grid: &Grid, plane: &Plane) -> f64 {
    let pixels = |step: DVec3| grid.index_from_world().transform_vector3(step).abs().max_element().recip();
    pixels(plane.right_mm).min(pixels(plane.down_mm))
}

#[cfg(test)]
mod tests;
