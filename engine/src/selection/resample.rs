//! Selections on another grid.

use std::sync::Arc;

use glam::DVec3;

use super::fill::{Filling, filled, places, point, quantized, voxel_box, voxels_of};
use super::{BRICK, BrickPool, Selection};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;
use crate::volume::labels::same_grid;

/// At most so many places of a voxel are looked at along an axis, where the new grid is coarser.
const MAX_LOOKS: f64 = 8.0;

impl Selection {
    /// The selection on another grid, in bricks of `pool`: as it is if the grids agree within 0.01 voxels; else the trilinear
    /// interpolation of its memberships at the middle of each voxel, or, where the new voxels are larger, its mean over places in
    /// the voxel that lie no farther apart than the old voxels (at most 8 along an axis). Where the voxels of both grids
    /// coincide that copies. Outside of its grid nothing is selected. The note, if any, is a sentence about what that changed.
    ///
    /// # Errors
    /// [`Error::Scene`] if nothing of it lies in `grid`; [`Error::Cancelled`] on request.
    pub fn resampled_to(
        &self,
        grid: &Grid,
        pool: &Arc<BrickPool>,
        progress: &Progress,
    ) -> Result<(Self, Option<String>)> {
        if same_grid(self.grid(), grid) {
            let mut same = Self::empty(*grid, pool);
            let bricks = self.bricks().map(|(place, brick)| (place, pool.brick(&brick.values())));
            same.replace(bricks.collect());
            return Ok((same, None));
        }
        let Some(bounds) = self.bounds() else { return Ok((Self::empty(*grid, pool), None)) };
        let here_from_there = self.grid().index_from_world() * grid.world_from_index();
        let there_from_here = here_from_there.inverse();
        let corner = |pick: usize| {
            DVec3::from_array(std::array::from_fn(|a| {
                if pick >> a & 1 == 0 { bounds[a][0] as f64 - 1.0 } else { bounds[a][1] as f64 }
            }))
        };
        let corners: [DVec3; 8] = std::array::from_fn(|i| there_from_here.transform_point3(corner(i)));
        let [low, high] = [DVec3::min, DVec3::max].map(|f| corners.into_iter().reduce(f).unwrap_or_default());
        let m = here_from_there.matrix3;
        let looks: [usize; 3] =
            [m.x_axis, m.y_axis, m.z_axis].map(|axis| (axis.length() - 1e-3).ceil().clamp(1.0, MAX_LOOKS) as usize);
        let offsets: Vec<DVec3> = (0..looks.iter().product())
            .map(|i: usize| {
                let at = [i % looks[0], i / looks[0] % looks[1], i / (looks[0] * looks[1])];
                DVec3::from_array(std::array::from_fn(|a| (at[a] as f64 + 0.5) / looks[a] as f64 - 0.5))
            })
            .collect();
        let places = places(voxel_box(low - 0.5, high + 0.5, grid.dims()));
        progress.begin("resampling", places.len() as u64);
        let resampled = filled(*grid, pool, places, progress, |place| {
            Filling::Voxels(voxels_of(place, grid.dims(), |voxel| {
                let sum: f64 = offsets
                    .iter()
                    .map(|o| self.interpolated(here_from_there.transform_point3(point(voxel) + *o)))
                    .sum();
                quantized(sum / offsets.len() as f64)
            }))
        })?;
        let (before, after) = (self.volume_ml(), resampled.volume_ml());
        if resampled.is_empty() {
            return Err(Error::scene(
                "the selection lies outside of the grid, or is too thin for its voxels",
                "take a selection of this scan",
            ));
        }
        let mm = self.grid().spacing_mm().to_array().map(|mm| (mm * 1000.0).round() / 1000.0);
        let note = format!(
            "The selection has another grid ({} x {} x {} mm) than the scan; it was resampled: {before:.3} ml became {after:.3} ml.",
            mm[0], mm[1], mm[2]
        );
        let is_kept = (after / before - 1.0).abs() < 1e-3 && looks == [1; 3];
        Ok((resampled, (!is_kept).then_some(note)))
    }

    /// The trilinear interpolation at a (fractional) voxel index, from 0 to 1.
    pub fn interpolated(&self, at: DVec3) -> f64 {
        let dims = self.grid().dims();
        let first = at.floor();
        let weight = at - first;
        let first = first.to_array();
        let is_near = (0..3).all(|a| first[a] >= -1.0 && first[a] < dims[a] as f64);
        if !is_near {
            return 0.0;
        }
        let mut sum = 0.0;
        for corner in 0..8_usize {
            let pick = [corner & 1, corner >> 1 & 1, corner >> 2];
            let mut w = 1.0;
            let mut voxel = [0; 3];
            let mut is_inside = true;
            for a in 0..3 {
                w *= if pick[a] == 0 { 1.0 - weight[a] } else { weight[a] };
                let n = first[a] as isize + pick[a] as isize;
                is_inside &= n >= 0 && (n as usize) < dims[a];
                voxel[a] = n.max(0) as usize;
            }
            if is_inside && w > 0.0 {
                let brick = self.brick(voxel.map(|n| n / BRICK));
                sum += w * f64::from(brick.get(voxel.map(|n| n % BRICK)));
            }
        }
        sum / 255.0
    }
}

#[cfg(test)]
mod tests;
