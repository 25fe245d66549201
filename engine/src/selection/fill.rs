//! Selections made brick by brick, in parallel: what every tool that fills space does.

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::{BRICK, BRICK_VOXELS, Brick, BrickPool, Selection, VoxelBox};
use crate::error::Result;
use crate::progress::Progress;
use crate::spaces::Grid;

/// What a brick shall be.
pub(super) enum Filling {
    /// All alike.
    Uniform(u8),
    /// x fastest; what lies beyond the grid does not matter.
    Voxels(Box<[u8; BRICK_VOXELS]>),
}

/// The bricks that a box touches, x fastest.
pub(super) fn places(voxels: VoxelBox) -> Vec<[usize; 3]> {
    if voxels.iter().any(|[from, to]| from >= to) {
        return Vec::new();
    }
    let range = voxels.map(|[from, to]| from / BRICK..to.div_ceil(BRICK));
    (range[2].clone())
        .flat_map(|z| range[1].clone().map(move |y| [y, z]))
        .flat_map(|[y, z]| range[0].clone().map(move |x| [x, y, z]))
        .collect()
}

/// A selection of `grid` in which these bricks are what `fill` says and all others empty.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled) on request.
pub(super) fn filled(
    grid: Grid,
    pool: &Arc<BrickPool>,
    places: Vec<[usize; 3]>,
    progress: &Progress,
    fill: impl Fn([usize; 3]) -> Filling + Sync,
) -> Result<Selection> {
    let mut selection = Selection::empty(grid, pool);
    let made: Result<Vec<_>> = places
        .into_par_iter()
        .with_min_len(16)
        .map(|place| {
            progress.advance(1)?;
            let brick = match fill(place) {
                Filling::Uniform(value) => Brick::Uniform(value),
                Filling::Voxels(values) => pool.brick(&values),
            };
            Ok((place, brick))
        })
        .filter(|made| !matches!(made, Ok((_, brick)) if brick.is_empty()))
        .collect();
    selection.replace(made?);
    Ok(selection)
}

/// The memberships of a brick, by `membership` of each of its voxels that lies in a grid of `dims`.
pub(super) fn voxels_of(
    place: [usize; 3],
    dims: [usize; 3],
    mut membership: impl FnMut([usize; 3]) -> u8,
) -> Box<[u8; BRICK_VOXELS]> {
    let mut values = Box::new([0; BRICK_VOXELS]);
    let first = place.map(|n| n * BRICK);
    let last: [usize; 3] = std::array::from_fn(|a| (first[a] + BRICK).min(dims[a]));
    for z in first[2]..last[2] {
        for y in first[1]..last[1] {
            let row = BRICK * (y % BRICK + BRICK * (z % BRICK));
            for x in first[0]..last[0] {
                values[row + x % BRICK] = membership([x, y, z]);
            }
        }
    }
    values
}

/// The voxels of a grid whose centers lie from `low` to `high`, in (fractional) voxel indices; empty if there are none or a bound
/// is no number.
pub(super) fn voxel_box(low: DVec3, high: DVec3, dims: [usize; 3]) -> VoxelBox {
    std::array::from_fn(|a| {
        // Casts saturate, and take NaN as 0: as an end, that leaves nothing.
        let from = low[a].ceil().max(0.0) as usize;
        let to = (high[a].floor() + 1.0).max(0.0) as usize;
        [from.min(dims[a]), to.min(dims[a])]
    })
}

/// A membership from 0 to 1 as it is stored; NaN is 0.
pub(super) fn quantized(membership: f64) -> u8 {
    (membership.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// A voxel's place as a point.
pub(super) fn point(voxel: [usize; 3]) -> DVec3 {
    DVec3::from_array(voxel.map(|n| n as f64))
}

/// The voxels of a grid of `dims` within a voxel of a place, in each direction.
pub(super) fn voxels_around(middle: DVec3, dims: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let near = voxel_box(middle - 1.0, middle + 1.0, dims).map(|[from, to]| from..to);
    let [x, y, z] = near;
    z.flat_map(move |z| y.clone().map(move |y| [y, z])).flat_map(move |[y, z]| x.clone().map(move |x| [x, y, z]))
}
