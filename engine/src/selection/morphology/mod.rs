//! Growing and shrinking, smoothing, holes and islands. Memberships stay soft: borders come out one voxel wide.
//!
//! Beyond the grid a selection is taken to go on as it is at the grid's faces: a structure that the scan cuts off is neither
//! eaten from there by shrinking, nor thinned by smoothing.

pub(super) mod distance;
mod holes;
mod islands;
mod smooth;
#[cfg(test)]
mod tests;

pub use holes::Holes;
pub use islands::Islands;
use rayon::prelude::*;

use super::fill::places;
use super::{BRICK, BRICK_VOXELS, Brick, BrickDiff, Selection, VoxelBox};
use crate::error::{Error, Result};
use crate::progress::Progress;
use distance::Distances;

impl Selection {
    /// Moves its surface (f = ½, interpolated between voxels) outward by `mm`, inward where that is below 0: every voxel gets the
    /// membership ½ − (d − mm) / w from 0 to 1, d being its distance to the surface (inside below 0) in mm, w its extent
    /// across it. By 0 mm the border becomes one voxel wide. Returns what the bricks were before. Costs the voxels around the
    /// surface; d is exact to a few hundredths of a voxel where the surface is smooth.
    ///
    /// # Errors
    /// [`Error::Scene`] if `mm` is not finite, [`Error::Cancelled`] on request.
    pub fn grow_mm(&mut self, mm: f64, progress: &Progress) -> Result<BrickDiff> {
        if !mm.is_finite() {
            return Err(Error::scene(format!("a selection cannot grow by {mm} mm"), "give a number of mm"));
        }
        let Some(bounds) = self.bounds() else { return Ok(BrickDiff::default()) };
        let distances = Distances::new(self.grid(), mm.abs());
        let margin = distances.margin();
        let dims = self.grid().dims();
        let touched: VoxelBox = std::array::from_fn(|a| {
            let margin = if mm > 0.0 { margin[a] } else { 0 };
            [bounds[a][0].saturating_sub(margin), (bounds[a][1] + margin).min(dims[a])]
        });
        let blocks = blocks(touched, margin, dims);
        progress.begin(if mm < 0.0 { "shrinking" } else { "growing" }, blocks.len() as u64);
        let this = &*self;
        let bricks: Result<Vec<_>> = blocks
            .into_par_iter()
            .map(|block| {
                progress.advance(1)?;
                let bricks: Vec<([usize; 3], Brick)> = match distances.moved(this, block, mm) {
                    distance::Moved::All(value) => {
                        places(block).into_iter().map(|place| (place, Brick::Uniform(value))).collect()
                    }
                    distance::Moved::Voxels(values) => bricks_of(this, block, |i| values[i]),
                };
                Ok(bricks)
            })
            .collect();
        let bricks = bricks?.into_iter().flatten().collect();
        Ok(self.replace(bricks))
    }
}

/// Blocks of whole bricks that cover a box, each large against the margin that working on it takes.
fn blocks(voxels: VoxelBox, margin: [usize; 3], dims: [usize; 3]) -> Vec<VoxelBox> {
    const EDGE: usize = 64;
    let edge = margin.map(|n| EDGE.max((2 * n).next_multiple_of(BRICK)));
    let ranges: [Vec<[usize; 2]>; 3] = std::array::from_fn(|a| {
        let first = voxels[a][0] / BRICK * BRICK;
        let last = voxels[a][1].next_multiple_of(BRICK).min(dims[a]);
        (first..last).step_by(edge[a]).map(|from| [from, (from + edge[a]).min(last)]).collect()
    });
    let [x, y, z] = ranges;
    z.iter().flat_map(|z| y.iter().flat_map(|y| x.iter().map(|x| [*x, *y, *z]))).collect()
}

/// The box with a margin, within the grid.
fn with_margin(voxels: VoxelBox, margin: [usize; 3], dims: [usize; 3]) -> VoxelBox {
    std::array::from_fn(|a| [voxels[a][0].saturating_sub(margin[a]), (voxels[a][1] + margin[a]).min(dims[a])])
}

/// The bricks of a block of whole ones, by the values of its voxels, x fastest.
fn bricks_of(selection: &Selection, block: VoxelBox, value: impl Fn(usize) -> u8) -> Vec<([usize; 3], Brick)> {
    let [nx, ny, _] = block.map(|[from, to]| to - from);
    let brick = |place: [usize; 3]| {
        let mut values = [0; BRICK_VOXELS];
        for z in 0..BRICK {
            for y in 0..BRICK {
                for x in 0..BRICK {
                    let at = [place[0] * BRICK + x, place[1] * BRICK + y, place[2] * BRICK + z];
                    if (0..3).all(|a| at[a] < block[a][1]) {
                        let [i, j, k] = std::array::from_fn(|a| at[a] - block[a][0]);
                        values[x + BRICK * (y + BRICK * z)] = value(i + nx * (j + ny * k));
                    }
                }
            }
        }
        (place, selection.pool().brick(&values))
    };
    places(block).into_iter().map(brick).collect()
}
