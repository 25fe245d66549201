//! Distances of every place of a volume to the surface of a selection, for transfer functions that go by them
//! (docs/rendering.md §4).

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DAffine3, DVec3};
use half::f16;
use rayon::prelude::*;

use super::morphology::distance::Distances;
use super::{IN, Selection};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;

/// Cells along the longest side of a field, at most: distances change by a mm per mm, wherever they are.
const MAX_CELLS: usize = 160;

/// Fields that were made lately, with what they were made of: a figure is resolved anew after each edit of it.
static LATELY: Mutex<Vec<(Vec<Selection>, Arc<DistanceField>)>> = Mutex::new(Vec::new());

/// How many of them are kept, of at most 8 MB each.
const MAX_LATELY: usize = 6;

/// Distances in mm to the surface of a selection (membership ½), below 0 inside, on cells of whole voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceField {
    volume_dims: [usize; 3],
    /// Voxels along each edge of a cell.
    voxels: [usize; 3],
    dims: [usize; 3],
    /// x fastest.
    values: Vec<f16>,
}

impl DistanceField {
    /// Of all that is in any of some selections of a grid: what was made for them lately, else made now. Nothing is as far away as half
    /// floats go, 65 504 mm. Takes two steps for each plane of cells.
    ///
    /// # Errors
    /// [`Error::Cancelled`] on request, [`Error::Scene`] for a grid so fine or wide that its cells have no place.
    pub fn of(selections: &[Selection], grid: &Grid, progress: &Progress) -> Result<Arc<Self>> {
        let is_of = |(known, field): &(Vec<Selection>, Arc<Self>)| {
            field.volume_dims == grid.dims()
                && known.len() == selections.len()
                && known.iter().zip(selections).all(|(a, b)| a.grid() == b.grid() && a.is_copy_of(b))
        };
        let lately = || LATELY.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, field)) = lately().iter().find(|made| !made.0.is_empty() && is_of(made)) {
            return Ok(field.clone());
        }
        let field = Arc::new(Self::new(selections, grid, progress)?);
        let mut lately = lately();
        if lately.len() >= MAX_LATELY {
            lately.remove(0);
        }
        lately.push((selections.to_vec(), field.clone()));
        Ok(field)
    }

    fn new(selections: &[Selection], grid: &Grid, progress: &Progress) -> Result<Self> {
        let volume_dims = grid.dims();
        let spacing = grid.spacing_mm();
        // Cells about as long along all axes, and none longer than it takes.
        let longest = (0..3).map(|a| volume_dims[a] as f64 * spacing[a]).fold(0.0, f64::max) / MAX_CELLS as f64;
        let voxels: [usize; 3] = std::array::from_fn(|a| {
            let least = volume_dims[a].div_ceil(MAX_CELLS);
            ((longest / spacing[a]).round() as usize).clamp(least, volume_dims[a])
        });
        let dims: [usize; 3] = std::array::from_fn(|a| volume_dims[a].div_ceil(voxels[a]));
        let inside = memberships(selections, grid, voxels, dims, progress)?;
        let values = Distances::new(&coarse(grid, voxels, dims)?, 0.0).signed_mm(&inside, dims, progress)?;
        let (low, high) = (f16::MIN.to_f32(), f16::MAX.to_f32());
        let values = values.into_iter().map(|mm| f16::from_f32(mm.clamp(low, high))).collect();
        Ok(Self { volume_dims, voxels, dims, values })
    }

    /// Voxels of the volume along x, y, z.
    pub fn volume_dims(&self) -> [usize; 3] {
        self.volume_dims
    }

    /// Cells along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Voxels along each edge of a cell: a cell's middle is at (i + ½) of these − ½ in the volume's index space. Cells at the volume's
    /// far faces may stick out of it.
    pub fn voxels(&self) -> [usize; 3] {
        self.voxels
    }

    /// Distances at the middles of cells, mm, x fastest; trilinear in between, beyond the outer middles the edge goes on.
    pub fn values(&self) -> &[f16] {
        &self.values
    }
}

impl DistanceField {
    /// Smallest and largest distance that a place can have whose index-space position is in a box, given by its corners.
    pub fn range(&self, low: DVec3, high: DVec3) -> (f64, f64) {
        let cells: [[usize; 2]; 3] = std::array::from_fn(|a| {
            let cell = |p: f64| (p + 0.5) / self.voxels[a] as f64 - 0.5;
            let last = self.dims[a] - 1;
            [(cell(low[a]).floor().max(0.0) as usize).min(last), (cell(high[a]).ceil().max(0.0) as usize).min(last)]
        });
        let [xs, ys, zs] = cells;
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for z in zs[0]..=zs[1] {
            for y in ys[0]..=ys[1] {
                let row = self.dims[0] * (y + self.dims[1] * z);
                for mm in &self.values[row + xs[0]..=row + xs[1]] {
                    (least, most) = (least.min(mm.to_f64()), most.max(mm.to_f64()));
                }
            }
        }
        (least, most)
    }
}

/// The grid of the cells.
fn coarse(grid: &Grid, voxels: [usize; 3], dims: [usize; 3]) -> Result<Grid> {
    let edge = DVec3::from_array(voxels.map(|n| n as f64));
    let middle = DAffine3::from_scale(edge) * DAffine3::from_translation(DVec3::splat(0.5));
    let to_first = DAffine3::from_translation(DVec3::splat(-0.5));
    Grid::new(dims, grid.world_from_index() * to_first * middle)
        .map_err(|fault| Error::scene(fault, "measure distances on another grid"))
}

/// The mean, in each cell, of the largest membership in any of the selections. What is thinner than a cell still has a surface: a cell counts as in that has a voxel which does,
/// where none around it is in anyway.
fn memberships(
    selections: &[Selection],
    grid: &Grid,
    voxels: [usize; 3],
    dims: [usize; 3],
    progress: &Progress,
) -> Result<Vec<u8>> {
    let volume = grid.dims();
    progress.begin("distances", 2 * dims[2] as u64);
    let planes: Result<Vec<Vec<(u8, bool)>>> = (0..dims[2])
        .into_par_iter()
        .map(|z| {
            progress.advance(1)?;
            let range = |a: usize, i: usize| [i * voxels[a], ((i + 1) * voxels[a]).min(volume[a])];
            let slab = [[0, volume[0]], [0, volume[1]], range(2, z)];
            let mut plane = vec![(0u8, false); dims[0] * dims[1]];
            let meets = |s: &&Selection| s.bounds().is_some_and(|b| slab[2][0] < b[2][1] && slab[2][1] > b[2][0]);
            let mut here = selections.iter().filter(meets).map(|s| s.values(slab));
            let Some(mut f) = here.next() else { return Ok(plane) };
            here.for_each(|other| f.iter_mut().zip(other).for_each(|(f, other)| *f = other.max(*f)));
            for (i, cell) in plane.iter_mut().enumerate() {
                let ([x0, x1], [y0, y1]) = (range(0, i % dims[0]), range(1, i / dims[0]));
                let rows =
                    (0..slab[2][1] - slab[2][0]).flat_map(|k| (y0..y1).map(move |y| volume[0] * (y + volume[1] * k)));
                let (mut sum, mut count, mut most) = (0u32, 0u32, 0u8);
                for f in rows.flat_map(|row| &f[row + x0..row + x1]) {
                    (sum, count, most) = (sum + u32::from(*f), count + 1, most.max(*f));
                }
                *cell = (((sum + count / 2) / count.max(1)) as u8, most >= IN);
            }
            Ok(plane)
        })
        .collect();
    let cells = planes?.concat();
    let [nx, ny, nz] = dims;
    let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
    let is_lone = |i: usize| {
        let [x, y, z] = [i % nx, i / nx % ny, i / (nx * ny)];
        let is_in = |x: usize, y: usize, z: usize| cells[x + nx * (y + ny * z)].0 >= IN;
        !around(z, nz).any(|z| around(y, ny).any(|y| around(x, nx).any(|x| is_in(x, y, z))))
    };
    Ok((0..cells.len())
        .map(|i| match cells[i] {
            (mean, true) if mean < IN && is_lone(i) => IN,
            (mean, _) => mean,
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::selection::{Limits, Shape};

    fn ball(dims: [usize; 3], spacing: DVec3, radius_mm: f64) -> (Selection, DVec3) {
        let grid = Grid::new(dims, DAffine3::from_scale(spacing)).unwrap();
        let middle = spacing * (DVec3::from_array(dims.map(|n| n as f64)) - 1.0) * 0.5;
        let ball = Shape::ball(middle, radius_mm);
        (ball.select(&grid, &Limits::default(), &Arc::default(), &Progress::new()).unwrap(), middle)
    }

    /// Largest error of a ball's distances at the middles of cells.
    fn error_mm(dims: [usize; 3], spacing: DVec3, radius_mm: f64) -> f64 {
        let (selection, middle) = ball(dims, spacing, radius_mm);
        let field = DistanceField::of(std::slice::from_ref(&selection), selection.grid(), &Progress::new()).unwrap();
        let [nx, ny, _] = field.dims();
        let edge = DVec3::from_array(field.voxels().map(|n| n as f64));
        let of = |i: usize| {
            let cell = DVec3::from_array([i % nx, i / nx % ny, i / (nx * ny)].map(|n| n as f64));
            let expected = (((cell + 0.5) * edge - 0.5) * spacing).distance(middle) - radius_mm;
            // Half floats have eleven bits.
            (field.values()[i].to_f64() - expected).abs() - 5e-4 * expected.abs()
        };
        (0..field.values().len()).map(of).fold(0.0, f64::max)
    }

    #[test]
    fn distances_of_balls_are_those_of_balls() {
        for (dims, spacing, radius_mm) in
            [([48, 48, 48], DVec3::ONE, 14.0), ([60, 60, 20], DVec3::new(0.5, 0.5, 1.5), 9.0)]
        {
            let error = error_mm(dims, spacing, radius_mm);
            assert!(error < 0.2 * spacing.max_element(), "{radius_mm}: {error} mm");
        }
    }

    #[test]
    fn cells_of_several_voxels_are_as_good_for_their_size() {
        let spacing = DVec3::splat(0.1);
        let (selection, _) = ball([400, 32, 32], spacing, 1.2);
        let field = DistanceField::of(std::slice::from_ref(&selection), selection.grid(), &Progress::new()).unwrap();
        assert_eq!((field.dims(), field.voxels()), ([134, 11, 11], [3, 3, 3]));
        assert!(error_mm([400, 32, 32], spacing, 1.2) < 0.2 * 0.3);
    }

    #[test]
    fn what_is_thinner_than_a_cell_has_a_surface_and_nothing_is_far_away() {
        let (mut selection, _) = ball([400, 32, 32], DVec3::splat(0.1), 1.2);
        selection.change([[0, 400], [0, 32], [0, 32]], |_, _| 0);
        let far = DistanceField::of(std::slice::from_ref(&selection), selection.grid(), &Progress::new()).unwrap();
        assert!(far.values().iter().all(|d| d.to_f64() > 65_000.0));
        selection.change([[100, 101], [0, 32], [16, 17]], |_, _| 255);
        let near = DistanceField::of(std::slice::from_ref(&selection), selection.grid(), &Progress::new()).unwrap();
        let least = near.values().iter().map(|d| d.to_f64()).fold(f64::INFINITY, f64::min);
        assert!((-0.2..0.1).contains(&least), "{least}");
    }

    #[test]
    fn a_cancelled_field_is_none() {
        let progress = Progress::new();
        progress.cancel();
        let (selection, _) = ball([16; 3], DVec3::ONE, 4.0);
        assert!(matches!(
            DistanceField::of(std::slice::from_ref(&selection), selection.grid(), &progress),
            Err(Error::Cancelled)
        ));
    }
}
