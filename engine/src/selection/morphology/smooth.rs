//! Smoothing.

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::{blocks, bricks_of, with_margin};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::selection::fill::quantized;
use crate::selection::{BrickDiff, Selection, VoxelBox};

/// Standard deviations to the end of the kernel.
const REACH: f64 = 3.0;

/// A smoothed membership of 1.
const ONE: f64 = 65535.0;

/// Steps of 1/65535 that smoothed memberships are counted in.
const STEPS: usize = 1 << 16;

impl Selection {
    /// Smooths with a Gaussian whose standard deviation is `sigma_mm`, along the axes of the grid. As that is, borders become
    /// about 2.5 sigma wide; with `keep_volume`, they are made one voxel wide again, f' = ½ + k (f − t) from 0 to 1, at the level
    /// t at which the volume is what it was (as a whole: what is thinner than sigma goes, and the rest makes up for it).
    /// Returns what the bricks were before.
    ///
    /// # Errors
    /// [`Error::Scene`] if `sigma_mm` is no length, [`Error::Cancelled`] on request.
    pub fn smooth_mm(&mut self, sigma_mm: f64, keep_volume: bool, progress: &Progress) -> Result<BrickDiff> {
        if !(sigma_mm >= 0.0 && sigma_mm.is_finite()) {
            let what = format!("a selection cannot be smoothed by {sigma_mm} mm");
            return Err(Error::scene(what, "give a number of mm above 0"));
        }
        let Some(bounds) = self.bounds().filter(|_| sigma_mm > 0.0) else { return Ok(BrickDiff::default()) };
        let dims = self.grid().dims();
        let kernels = self.grid().spacing_mm().to_array().map(|spacing| kernel(sigma_mm / spacing));
        let margin = std::array::from_fn(|a| (kernels[a].len() / 2).min(dims[a]));
        let blocks = blocks(with_margin(bounds, margin, dims), margin, dims);
        progress.begin("smoothing", blocks.len() as u64);
        let this = &*self;
        let smoothed: Result<Vec<(VoxelBox, Option<Vec<u16>>)>> = blocks
            .into_par_iter()
            .map(|block| {
                progress.advance(1)?;
                Ok((block, smoothed(this, block, with_margin(block, margin, dims), &kernels)))
            })
            .collect();
        let smoothed = smoothed?;
        let voxel_mm = self.grid().world_from_index().matrix3.determinant().abs().cbrt();
        // A straight border is steepest in its middle, where it rises by 1 / (σ √τ) per mm.
        let gain = if keep_volume { (sigma_mm * TAU.sqrt() / voxel_mm).max(1.0) } else { 1.0 };
        let level = if keep_volume {
            let mut counts = vec![0_u64; STEPS];
            for (block, values) in &smoothed {
                match values {
                    Some(values) => values.iter().for_each(|g| counts[usize::from(*g)] += 1),
                    None => {
                        counts[usize::from(u16::from(self.get(block.map(|b| b[0]))) * 257)] +=
                            block.iter().map(|[a, b]| (b - a) as u64).product::<u64>()
                    }
                }
            }
            level_of(&counts, gain, self.num_voxels())
        } else {
            0.5
        };
        let table: Vec<u8> = (0..STEPS).map(|g| quantized(0.5 + gain * (g as f64 / ONE - level))).collect();
        let bricks = smoothed
            .into_par_iter()
            .flat_map_iter(|(block, values)| {
                // Even around: as it is, but for what sharpening makes of it.
                let even = usize::from(this.get(block.map(|b| b[0]))) * 257;
                bricks_of(this, block, |i| table[values.as_ref().map_or(even, |v| usize::from(v[i]))])
            })
            .collect();
        Ok(self.replace(bricks))
    }
}

/// The level at which that many voxels remain.
fn level_of(counts: &[u64], gain: f64, num_voxels: f64) -> f64 {
    let remaining = |level: f64| -> f64 {
        // What is 0 stays 0.
        let parts = counts.iter().enumerate().skip(1).filter(|(_, n)| **n > 0);
        parts.map(|(g, n)| *n as f64 * (0.5 + gain * (g as f64 / ONE - level)).clamp(0.0, 1.0)).sum()
    };
    let (mut low, mut high) = (0.5 / gain, 1.0 + 0.5 / gain);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if remaining(middle) > num_voxels { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Weights of a Gaussian, as many on both sides of the middle.
fn kernel(sigma: f64) -> Vec<f32> {
    let reach = (REACH * sigma).ceil().min(1e6) as i64;
    (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32).collect()
}

/// A block smoothed, in 1/65535, x fastest; nothing if all around it is one membership.
fn smoothed(selection: &Selection, block: VoxelBox, region: VoxelBox, kernels: &[Vec<f32>; 3]) -> Option<Vec<u16>> {
    let first = selection.get(region.map(|r| r[0]));
    if crate::selection::fill::places(region).into_iter().all(|place| selection.brick(place).range() == [first; 2]) {
        return None;
    }
    let mut values: Vec<f32> = selection.values(region).iter().map(|f| f32::from(*f) * 257.0).collect();
    let mut extent = region;
    for (a, kernel) in kernels.iter().enumerate() {
        let mut narrowed = extent;
        narrowed[a] = block[a];
        values = along(&values, extent, narrowed, a, kernel);
        extent = narrowed;
    }
    Some(values.iter().map(|g| (g + 0.5).clamp(0.0, ONE as f32) as u16).collect())
}

/// Weighted means along an axis; what lies beyond the box has no weight.
fn along(values: &[f32], from: VoxelBox, to: VoxelBox, axis: usize, kernel: &[f32]) -> Vec<f32> {
    let [size, new] = [from, to].map(|b| b.map(|[from, to]| to - from));
    let stride: usize = size[..axis].iter().product();
    let reach = kernel.len() / 2;
    let offset = to[axis][0] - from[axis][0];
    let n = size[axis];
    let mut out = vec![0.0; new.iter().product()];
    // Lines of neighbors along the faster axes are worked on together.
    let num_outer: usize = size[axis + 1..].iter().product();
    for outer in 0..num_outer {
        for i in 0..new[axis] {
            let middle = i + offset;
            let window = middle.saturating_sub(reach)..(middle + reach + 1).min(n);
            let target = &mut out[stride * (i + new[axis] * outer)..][..stride];
            let mut sum = 0.0;
            for j in window {
                let weight = kernel[j + reach - middle];
                sum += weight;
                let source = &values[stride * (j + n * outer)..][..stride];
                target.iter_mut().zip(source).for_each(|(t, s)| *t += weight * s);
            }
            target.iter_mut().for_each(|t| *t /= sum);
        }
    }
    out
}
