//! ‖ĝ‖ voxel by voxel, slice after slice, and the largest in each brick: between voxels it is nowhere larger than around.

use glam::DVec3;
use rayon::prelude::*;

use super::Volume;
use super::bricks::BRICK;
use super::colors::color_change;
use super::no_data::fill_no_data;
use super::prefilter::{Prefilter, Source};
use crate::error::Result;
use crate::progress::Progress;

/// Voxels around a brick that its largest edge includes, as its range of values does.
const BORDER: usize = 2;

/// Hands over every slice, from z = 0 on, as a function from x and y to ‖g‖/G; g is that of data smoothed by a Gaussian of `sigma_mm`.
/// Takes a step a slice.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled) on request.
pub fn each_slice(
    volume: &Volume,
    sigma_mm: f64,
    progress: &Progress,
    mut take: impl FnMut(usize, &(dyn Fn(usize, usize) -> f64 + Sync)),
) -> Result<()> {
    let dims = volume.grid.dims();
    let [nx, ny, nz] = dims;
    let sigma = (DVec3::splat(sigma_mm) / volume.grid.spacing_mm()).to_array();
    let filled = fill_no_data(volume);
    let stored = filled.voxels.as_ref();
    let (source, channels) = match &volume.colors {
        Some(colors) => (Source::Colors(colors), 4),
        None => (Source::Values { voxels: stored, offset: 0.0, scale: 1.0 }, 1),
    };
    let mut filter = Prefilter::new(source, dims, sigma);
    let to_world = volume.grid.world_gradient_from_index();
    let slope = if volume.colors.is_some() { 1.0 } else { volume.rescale.slope };
    let per_edge = 0.5 * slope / volume.gradient_max();
    progress.begin("edges", nz as u64);
    let first = filter.slab(0, 1);
    let mut around: [Vec<f32>; 3] = [first.clone(), first, Vec::new()];
    for z in 0..nz {
        around[2] = if z + 1 < nz { filter.slab(z + 1, z + 2) } else { around[1].clone() };
        let planes = &around;
        let edge = |x: usize, y: usize| {
            let at = |plane: usize, x: usize, y: usize, c: usize| f64::from(planes[plane][channels * (x + nx * y) + c]);
            let (left, right) = (x.saturating_sub(1), (x + 1).min(nx - 1));
            let (up, down) = (y.saturating_sub(1), (y + 1).min(ny - 1));
            let change = |c: usize| {
                let d = DVec3::new(
                    at(1, right, y, c) - at(1, left, y, c),
                    at(1, x, down, c) - at(1, x, up, c),
                    at(2, x, y, c) - at(0, x, y, c),
                );
                to_world * (per_edge * d)
            };
            match channels {
                4 => color_change([0, 1, 2, 3].map(change)),
                _ => change(0).length(),
            }
        };
        take(z, &edge);
        around.rotate_left(1);
        progress.advance(1)?;
    }
    Ok(())
}

/// The largest ‖ĝ‖ that a place in or up to half a step of two voxels beside each brick can have, x fastest.
pub fn brick_maxima(volume: &Volume, sigma_mm: f64) -> Vec<f64> {
    let dims = volume.grid.dims();
    let bricks = dims.map(|n| n.div_ceil(BRICK));
    let around = |b: usize, n: usize| (b * BRICK).saturating_sub(BORDER)..((b + 1) * BRICK + BORDER).min(n);
    let mut largest = vec![0.0f64; bricks.iter().product()];
    let taken = each_slice(volume, sigma_mm, &Progress::new(), |z, edge| {
        let plane: Vec<f64> =
            (0..dims[1]).into_par_iter().flat_map_iter(|y| (0..dims[0]).map(move |x| edge(x, y))).collect();
        let most = |i: usize| {
            let rows = around(i / bricks[0], dims[1]).map(|y| dims[0] * y);
            let columns = around(i % bricks[0], dims[0]);
            rows.flat_map(|row| &plane[row + columns.start..row + columns.end]).copied().fold(0.0, f64::max)
        };
        let here: Vec<f64> = (0..bricks[0] * bricks[1]).into_par_iter().map(most).collect();
        for layer in (0..bricks[2]).filter(|b| around(*b, dims[2]).contains(&z)) {
            let own = &mut largest[layer * here.len()..(layer + 1) * here.len()];
            own.iter_mut().zip(&here).for_each(|(most, here)| *most = most.max(*here));
        }
    });
    debug_assert!(taken.is_ok(), "nobody cancels it");
    largest
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::spaces::Grid;
    use crate::volume::{Rescale, Voxels};

    #[test]
    fn bricks_have_the_edges_around_them() {
        // A step from 0 to 100 between x = 19 and 20: in the border of the second brick and in the third.
        let grid = Grid::new([40, 8, 8], DAffine3::IDENTITY).unwrap();
        let voxels = Voxels::U8((0..2560).map(|i| if i % 40 < 20 { 0 } else { 100 }).collect());
        let volume = Volume::new(grid, voxels, Rescale::IDENTITY, "test").unwrap();
        let found = brick_maxima(&volume, 0.0);
        assert_eq!(found, [0.0, 0.0, 1.0, 0.0, 0.0]);
        let smooth = brick_maxima(&volume, 2.0);
        assert!(smooth[1] > 0.15 && smooth[2] < 0.5 && smooth[3] > 0.15 && smooth[0] < 0.05, "{smooth:?}");
    }
}
