//! Which part of a volume is read, and how finely: for scans that fit neither the memory nor the adapter whole.
//!
//! The voxels pass by once, in the order of the file, and only what is kept takes memory ([`Collector`]).

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};

use super::stream;
use crate::color::{linear_from_srgb8, srgb8_from_linear};
use crate::error::{Error, Result};
use crate::spaces::Grid;

/// A box of voxels, and how many of them become one. The default is everything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First and, exclusive, last voxel along x, y, z of the file.
    pub crop: Option<[[usize; 2]; 3]>,
    /// So many voxels of the file, along x, y, z, become one: their mean, and for label maps the one nearest to their middle.
    pub reduce: [usize; 3],
}

impl Default for Window {
    fn default() -> Self {
        Self { crop: None, reduce: [1; 3] }
    }
}

impl Window {
    /// The window on a grid of `dims` voxels.
    ///
    /// # Errors
    /// One sentence for a box that is empty or leaves the grid, and for a reduction by 0.
    pub fn on(&self, path: &Path, dims: [usize; 3]) -> Result<OnGrid> {
        let crop = self.crop.unwrap_or(dims.map(|n| [0, n]));
        for axis in 0..3 {
            let ([first, end], n) = (crop[axis], dims[axis]);
            if first >= end || end > n {
                let name = ["x", "y", "z"][axis];
                return Err(Error::file(
                    path,
                    format!("the crop {first}..{end} along {name} is no part of the volume's 0..{n}"),
                    "correct it; the end is the first voxel that is left out",
                ));
            }
            if self.reduce[axis] == 0 {
                return Err(Error::file(path, "0 voxels cannot become one", "reduce by 1 or more"));
            }
        }
        // An axis shorter than a block becomes one voxel; a last block that is not whole is left out, as its middle would
        // lie elsewhere.
        let block = std::array::from_fn(|i| self.reduce[i].min(crop[i][1] - crop[i][0]));
        let kept = std::array::from_fn(|i| (crop[i][1] - crop[i][0]) / block[i]);
        Ok(OnGrid { file: dims, first: crop.map(|c| c[0]), block, kept })
    }

    /// Whether it is everything, as it is.
    pub fn is_whole(&self) -> bool {
        *self == Self::default()
    }
}

/// A window on a grid of known size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OnGrid {
    /// Voxels of the file.
    file: [usize; 3],
    /// The first voxel that is kept.
    first: [usize; 3],
    /// Voxels of the file in one that is kept.
    block: [usize; 3],
    /// Voxels that are kept.
    kept: [usize; 3],
}

impl OnGrid {
    /// Voxels along x, y, z that are kept.
    pub fn dims(&self) -> [usize; 3] {
        self.kept
    }

    /// How many are kept.
    pub fn num_voxels(&self) -> usize {
        self.kept.iter().product()
    }

    /// How many the file has.
    pub fn num_file_voxels(&self) -> usize {
        self.file.iter().product()
    }

    /// Whether all are kept.
    pub fn is_whole(&self) -> bool {
        self.kept == self.file
    }

    /// The voxels of the file along `axis` that matter: slices outside need not be decoded.
    pub fn range(&self, axis: usize) -> Range<usize> {
        self.first[axis]..self.first[axis] + self.kept[axis] * self.block[axis]
    }

    /// The grid of what is kept: a voxel lies where the middle of its block was.
    ///
    /// # Errors
    /// As [`Grid::new`], a clause.
    pub fn grid(&self, whole: &Grid) -> std::result::Result<Grid, String> {
        let scale = DVec3::from_array(self.block.map(|b| b as f64));
        let offset: [f64; 3] = std::array::from_fn(|i| self.first[i] as f64 + (self.block[i] as f64 - 1.0) / 2.0);
        let file_from_kept = DAffine3::from_mat3_translation(DMat3::from_diagonal(scale), DVec3::from_array(offset));
        Grid::new(self.kept, whole.world_from_index() * file_from_kept)
    }

    /// What the user shall know about a volume that is not whole.
    pub fn note(&self) -> Option<String> {
        let [x, y, z] = self.file;
        let [kx, ky, kz] = self.kept;
        let what = match (self.block == [1; 3], (0..3).any(|i| self.range(i).len() + self.block[i] <= self.file[i])) {
            (true, false) => return None,
            (true, true) => "a part",
            (false, false) => "reduced",
            (false, true) => "a part, reduced",
        };
        Some(format!("Of {x} x {y} x {z} voxels, {kx} x {ky} x {kz} were loaded ({what})."))
    }
}

/// What voxels of the file become where several become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Averaging {
    /// Their mean; NaN and ±Inf count only where there is nothing else.
    Mean,
    /// The one nearest to their middle: label maps know no mean.
    Nearest,
}

/// An element of a volume that can be averaged.
pub trait Averaged: Copy + Send + Sync + 'static {
    /// The components in which means are taken (colors: premultiplied linear light and alpha), 0 where there are fewer.
    fn parts(self) -> [f64; 4];
    /// The element with these components, rounded to its type.
    fn from_parts(parts: [f64; 4]) -> Self;
}

macro_rules! impl_averaged {
    ($($t:ty),*; $($f:ty),*) => {
        $(impl Averaged for $t {
            fn parts(self) -> [f64; 4] { [self as f64, 0.0, 0.0, 0.0] }
            fn from_parts(parts: [f64; 4]) -> Self { parts[0].round() as $t }
        })*
        $(impl Averaged for $f {
            fn parts(self) -> [f64; 4] { [f64::from(self), 0.0, 0.0, 0.0] }
            fn from_parts(parts: [f64; 4]) -> Self { parts[0] as $f }
        })*
    };
}
impl_averaged!(u8, i8, u16, i16, u32, i32, u64, i64; f32, f64);

/// sRGB with straight alpha: means are those of light, weighted by alpha.
impl Averaged for [u8; 4] {
    fn parts(self) -> [f64; 4] {
        let alpha = f64::from(self[3]) / 255.0;
        let light = |i: usize| f64::from(linear_from_srgb8(self[i])) * alpha;
        [light(0), light(1), light(2), alpha]
    }

    fn from_parts([r, g, b, alpha]: [f64; 4]) -> Self {
        let code = |light: f64| srgb8_from_linear((light / alpha.max(1e-12)) as f32);
        [code(r), code(g), code(b), (alpha * 255.0).round() as u8]
    }
}

/// Takes the voxels of a frame in the order of the file, any number at a time, and keeps those of a window.
pub struct Collector<T> {
    path: PathBuf,
    window: OnGrid,
    averaging: Averaging,
    /// Voxels taken so far.
    position: usize,
    kept: Vec<T>,
    /// Sums of one layer of blocks, and how many finite voxels each has.
    sums: Vec<([f64; 4], u32)>,
}

impl<T: Averaged> Collector<T> {
    /// A collector for a window; `path` is for its errors. Its memory grows with what is kept.
    pub fn new(window: OnGrid, averaging: Averaging, path: &Path) -> Self {
        Self { path: path.to_owned(), window, averaging, position: 0, kept: Vec::new(), sums: Vec::new() }
    }

    /// Whether nothing more is wanted.
    pub fn is_full(&self) -> bool {
        self.kept.len() == self.window.num_voxels()
    }

    /// Takes the next voxels.
    ///
    /// # Errors
    /// One sentence if there is not enough memory.
    pub fn push(&mut self, mut voxels: &[T]) -> Result<()> {
        let [nx, ny, _] = self.window.file;
        while !voxels.is_empty() && !self.is_full() {
            let (x, row) = (self.position % nx, self.position / nx);
            let n = (nx - x).min(voxels.len());
            let (now, later) = voxels.split_at(n);
            self.push_run(x, row % ny, row / ny, now)?;
            self.position += n;
            voxels = later;
        }
        Ok(())
    }

    /// Passes over `count` voxels that are known to lie outside the window.
    pub fn skip(&mut self, count: usize) {
        self.position += count;
    }

    /// What was kept.
    pub fn finish(self) -> Vec<T> {
        self.kept
    }

    /// Voxels of one row, the first at `x`.
    fn push_run(&mut self, x: usize, y: usize, z: usize, run: &[T]) -> Result<()> {
        let w = self.window;
        let (columns, rows, slices) = (w.range(0), w.range(1), w.range(2));
        if rows.contains(&y) && slices.contains(&z) {
            let (begin, end) = (columns.start.max(x), columns.end.min(x + run.len()));
            if begin < end {
                self.keep(begin, y, z, &run[begin - x..end - x])?;
            }
        }
        // The last voxel of the last row of a layer of blocks: the layer's means are known.
        let is_last = |i: usize, at: usize| (at + 1 - w.first[i]).is_multiple_of(w.block[i]);
        let (last_x, last_y) = (columns.end - 1, rows.end - 1);
        if !self.sums.is_empty()
            && slices.contains(&z)
            && y == last_y
            && (x..x + run.len()).contains(&last_x)
            && is_last(2, z)
        {
            stream::grow(&mut self.kept, self.sums.len(), w.num_voxels(), &self.path)?;
            for (sum, count) in &mut self.sums {
                let parts = if *count == 0 { [f64::NAN; 4] } else { sum.map(|s| s / f64::from(*count)) };
                self.kept.push(T::from_parts(parts));
                (*sum, *count) = ([0.0; 4], 0);
            }
        }
        Ok(())
    }

    /// Voxels of one row that lie in the window.
    fn keep(&mut self, x: usize, y: usize, z: usize, run: &[T]) -> Result<()> {
        let w = self.window;
        if w.block == [1; 3] || self.averaging == Averaging::Nearest {
            let extra = run.len().min(w.num_voxels() - self.kept.len());
            stream::grow(&mut self.kept, extra, w.num_voxels(), &self.path)?;
        }
        if w.block == [1; 3] {
            self.kept.extend_from_slice(run);
            return Ok(());
        }
        let within = |i: usize, at: usize| ((at - w.first[i]) / w.block[i], (at - w.first[i]) % w.block[i]);
        let ((row, in_row), (_, in_slice)) = (within(1, y), within(2, z));
        match self.averaging {
            Averaging::Nearest => {
                if in_row == w.block[1] / 2 && in_slice == w.block[2] / 2 {
                    let middle = (0..).zip(run).filter(|(i, _)| within(0, x + i).1 == w.block[0] / 2);
                    self.kept.extend(middle.map(|(_, v)| *v));
                }
            }
            Averaging::Mean => {
                if self.sums.is_empty() {
                    let layer = w.kept[0] * w.kept[1];
                    stream::grow(&mut self.sums, layer, layer, &self.path)?;
                    self.sums.resize(layer, ([0.0; 4], 0));
                }
                for (i, v) in run.iter().enumerate() {
                    let parts = v.parts();
                    if parts.iter().all(|p| p.is_finite()) {
                        let (sum, count) = &mut self.sums[row * w.kept[0] + within(0, x + i).0];
                        (0..4).for_each(|k| sum[k] += parts[k]);
                        *count += 1;
                    }
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(window: Window, averaging: Averaging, chunk: usize) -> (OnGrid, Vec<f32>) {
        let dims = [5, 4, 3];
        let on = window.on(Path::new("a"), dims).unwrap();
        let voxels: Vec<f32> = (0..60).map(|i| (i % 5 + 10 * (i / 5 % 4) + 100 * (i / 20)) as f32).collect();
        let mut collector = Collector::new(on, averaging, Path::new("a"));
        voxels.chunks(chunk).for_each(|c| collector.push(c).unwrap());
        assert!(collector.is_full());
        (on, collector.finish())
    }

    #[test]
    fn a_crop_keeps_its_voxels_however_they_come() {
        let crop = Window { crop: Some([[1, 3], [2, 4], [0, 2]]), ..Window::default() };
        for chunk in [1, 3, 7, 60] {
            let (on, voxels) = kept(crop, Averaging::Mean, chunk);
            assert_eq!(voxels, [21.0, 22.0, 31.0, 32.0, 121.0, 122.0, 131.0, 132.0]);
            assert_eq!(on.dims(), [2, 2, 2]);
        }
    }

    #[test]
    fn a_reduced_voxel_is_the_mean_of_its_block_and_lies_in_its_middle() {
        // A linear ramp: the mean of a block is the value at its middle, which the reduced grid must name.
        for (window, chunk) in [([2, 2, 1], 1), ([2, 3, 2], 4), ([1, 1, 3], 60), ([9, 9, 9], 11)] {
            for crop in [None, Some([[1, 5], [1, 4], [0, 3]])] {
                let (on, voxels) = kept(Window { crop, reduce: window }, Averaging::Mean, chunk);
                let whole = Grid::new([5, 4, 3], DAffine3::IDENTITY).unwrap();
                let grid = on.grid(&whole).unwrap();
                let [nx, ny, _] = grid.dims();
                for (i, v) in voxels.iter().enumerate() {
                    let index = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
                    let p = grid.world_from_index().transform_point3(index);
                    assert!((f64::from(*v) - (p.x + 10.0 * p.y + 100.0 * p.z)).abs() < 1e-4, "{window:?} {p}");
                }
            }
        }
    }

    #[test]
    fn labels_are_picked_and_never_averaged() {
        let (_, voxels) = kept(Window { reduce: [3, 3, 3], ..Window::default() }, Averaging::Nearest, 13);
        assert_eq!(voxels, [111.0]);
    }

    #[test]
    fn gaps_do_not_spread_and_colors_mix_as_light() {
        let on = Window { reduce: [2, 1, 1], ..Window::default() }.on(Path::new("a"), [4, 1, 1]).unwrap();
        let mut gaps = Collector::new(on, Averaging::Mean, Path::new("a"));
        gaps.push(&[f64::NAN, 2.0, f64::NAN, f64::INFINITY]).unwrap();
        let gaps = gaps.finish();
        assert!(gaps[0] == 2.0 && gaps[1].is_nan());
        let mut colors = Collector::new(on, Averaging::Mean, Path::new("a"));
        colors.push(&[[255, 0, 0, 255], [0, 0, 255, 255], [9, 9, 9, 0], [200, 10, 30, 255]]).unwrap();
        assert_eq!(colors.finish(), [[188, 0, 188, 255], [200, 10, 30, 128]]);
    }

    #[test]
    fn boxes_that_leave_the_grid_are_refused_and_what_was_left_out_is_said() {
        let on = |crop, reduce| Window { crop, reduce }.on(Path::new("a"), [10, 10, 10]);
        for crop in [[[0, 11], [0, 10], [0, 10]], [[3, 3], [0, 10], [0, 10]], [[0, 10], [7, 2], [0, 10]]] {
            assert!(on(Some(crop), [1; 3]).unwrap_err().to_string().contains("is no part of the volume's 0..10"));
        }
        assert!(on(None, [1, 0, 1]).is_err());
        assert_eq!(on(None, [1; 3]).unwrap().note(), None);
        let note = on(None, [2, 2, 3]).unwrap().note().unwrap();
        assert_eq!(note, "Of 10 x 10 x 10 voxels, 5 x 5 x 3 were loaded (reduced).");
        let note = on(Some([[0, 5], [0, 10], [0, 10]]), [1; 3]).unwrap().note().unwrap();
        assert_eq!(note, "Of 10 x 10 x 10 voxels, 5 x 10 x 10 were loaded (a part).");
    }
}
