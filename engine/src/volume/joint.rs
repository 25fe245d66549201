//! Joint histograms: how many voxels have which value and which second coordinate, for looking at 2-D transfer functions
//! (G. Kindlmann and J. Durkin, Semi-automatic generation of transfer functions, 1998).

use rayon::prelude::*;

use super::edges::each_slice;
use super::{Volume, Voxel as _};
use crate::error::Result;
use crate::progress::Progress;
use crate::selection::DistanceField;
use crate::with_voxels;

/// Counts over values and a second coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct JointHistogram {
    /// Bins along values and along the second coordinate.
    pub dims: [usize; 2],
    /// Values at the first bin's beginning and at the last one's end.
    pub values: (f64, f64),
    /// The second coordinate there.
    pub places: (f64, f64),
    /// Voxels in each bin, values fastest; what is outside is in none.
    pub counts: Vec<u32>,
    /// The most in a bin.
    pub most: u32,
}

/// Bins along values and along the second coordinate.
const DIMS: [usize; 2] = [160, 80];

impl JointHistogram {
    /// Over values and ‖ĝ‖ from 0 to 1, gradients being those of data smoothed by a Gaussian of `sigma_mm`. Takes a step a slice.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled) on request.
    pub fn of_edges(volume: &Volume, values: (f64, f64), sigma_mm: f64, progress: &Progress) -> Result<Self> {
        let mut made = Self::empty(values, (0.0, 1.0));
        each_slice(volume, sigma_mm, progress, |z, edge| made.add_slice(volume, z, |x, y| edge(x, y).min(1.0)))?;
        made.most = made.counts.iter().copied().max().unwrap_or(0);
        Ok(made)
    }

    /// Over values and distances between two bounds, mm.
    ///
    /// # Errors
    /// As [`JointHistogram::of_edges`].
    pub fn of_distances(
        volume: &Volume,
        values: (f64, f64),
        field: &DistanceField,
        places: (f64, f64),
        progress: &Progress,
    ) -> Result<Self> {
        let [nx, ny, _] = field.dims();
        let edge = field.voxels();
        progress.begin("joint histogram", volume.grid.dims()[2] as u64);
        let mut made = Self::empty(values, places);
        for z in 0..volume.grid.dims()[2] {
            // The cell's own: bins are about as wide.
            let plane = ny * (z / edge[2]);
            made.add_slice(volume, z, |x, y| field.values()[x / edge[0] + nx * (y / edge[1] + plane)].to_f64());
            progress.advance(1)?;
        }
        made.most = made.counts.iter().copied().max().unwrap_or(0);
        Ok(made)
    }

    fn empty(values: (f64, f64), places: (f64, f64)) -> Self {
        Self { dims: DIMS, values, places, counts: vec![0; DIMS[0] * DIMS[1]], most: 0 }
    }

    fn add_slice(&mut self, volume: &Volume, z: usize, place: impl Fn(usize, usize) -> f64 + Sync) {
        let [nx, ny, _] = volume.grid.dims();
        let [columns, rows] = self.dims;
        let bin = |at: f64, (low, high): (f64, f64), count: usize| {
            let share = (at - low) / (high - low);
            // Both ends are in the outermost bins.
            (0.0..=1.0).contains(&share).then(|| ((share * count as f64) as usize).min(count - 1))
        };
        let (values, places) = (self.values, self.places);
        let of_row = |mut counts: Vec<u32>, y: usize| {
            let row = nx * (y + ny * z);
            with_voxels!(&volume.voxels, v => for x in 0..nx {
                let value = volume.rescale.value(v[row + x].to_f64());
                let Some(column) = bin(value, values, columns) else { continue };
                if let Some(row) = bin(place(x, y), places, rows) {
                    counts[column + columns * row] += 1;
                }
            });
            counts
        };
        let none = || vec![0u32; columns * rows];
        let add = |mut a: Vec<u32>, b: Vec<u32>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        };
        let own = (0..ny).into_par_iter().with_min_len(64).fold(none, of_row).reduce(none, add);
        self.counts.iter_mut().zip(own).for_each(|(sum, n)| *sum += n);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::selection::Selection;
    use crate::spaces::Grid;
    use crate::volume::{Rescale, Voxels};

    /// A step from 0 to 100 between x = 7 and 8.
    fn step() -> Volume {
        let grid = Grid::new([16, 8, 8], DAffine3::from_scale(DVec3::new(0.5, 1.0, 1.0))).unwrap();
        let voxels = Voxels::I16((0..1024).map(|i| if i % 16 < 8 { 0 } else { 100 }).collect());
        Volume::new(grid, voxels, Rescale { slope: 2.0, intercept: 0.0 }, "test").unwrap()
    }

    #[test]
    fn a_step_has_its_edge_in_two_slices_of_voxels() {
        let made = JointHistogram::of_edges(&step(), (0.0, 200.0), 0.0, &Progress::new()).unwrap();
        let at = |column: usize, row: usize| made.counts[column + made.dims[0] * row];
        let (right, top) = (made.dims[0] - 1, made.dims[1] - 1);
        assert_eq!((at(0, 0), at(0, top), at(right, 0), at(right, top)), (448, 64, 448, 64));
        assert_eq!((made.counts.iter().sum::<u32>(), made.most), (1024, 448));
    }

    #[test]
    fn distances_are_counted_where_they_are() {
        let volume = step();
        let mut selection = Selection::empty(volume.grid, &Arc::default());
        selection.change([[0, 4], [0, 8], [0, 8]], |_, _| 255);
        let field = DistanceField::of(&[selection], &volume.grid, &Progress::new()).unwrap();
        let made = JointHistogram::of_distances(&volume, (0.0, 200.0), &field, (0.0, 4.0), &Progress::new()).unwrap();
        // Voxels 4 to 11 are a quarter of a mm to three and three quarters away: half of them have the lower value.
        let of = |columns: std::ops::Range<usize>| -> u32 {
            (0..made.dims[1])
                .flat_map(|row| columns.clone().map(move |c| (row, c)))
                .map(|(r, c)| made.counts[c + made.dims[0] * r])
                .sum()
        };
        assert_eq!((of(0..1), of(made.dims[0] - 1..made.dims[0])), (4 * 64, 4 * 64));
    }
}
