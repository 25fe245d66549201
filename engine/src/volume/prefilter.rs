//! The Gaussian-prefiltered copy that gradients are taken from: without it lit spheres on noisy CT look like
//! sandpaper. Made slab by slab on the way to the GPU, so that the copy never exists in host memory.

use std::collections::VecDeque;
use std::ops::Range;

use rayon::prelude::*;

use super::{Voxel, Voxels};
use crate::color::premultiplied_linear_from_srgb8;
use crate::with_voxels;

/// Sampled Gaussian of standard deviation `sigma` voxels, normalized to sum 1: entry k is the weight at ±k.
/// Cut at 4σ, where the weights left out sum to 6e-5. `sigma` = 0 gives the identity.
pub fn gaussian_taps(sigma: f64) -> Vec<f64> {
    let radius = (4.0 * sigma).ceil() as usize;
    let weights: Vec<f64> =
        (0..=radius).map(|k| if k == 0 { 1.0 } else { (-0.5 * (k as f64 / sigma).powi(2)).exp() }).collect();
    let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    weights.into_iter().map(|w| w / sum).collect()
}

/// Produces the smoothed volume in slabs of consecutive z, in f32. Beyond the edges the outermost voxels go on.
#[derive(Debug)]
pub struct Prefilter<'a> {
    source: Source<'a>,
    dims: [usize; 3],
    taps: [Vec<f32>; 3],
    /// Planes already smoothed in x and y; the first belongs to z = `first_plane`.
    planes: VecDeque<Vec<f32>>,
    first_plane: usize,
}

/// What is smoothed.
#[derive(Clone, Copy, Debug)]
pub enum Source<'a> {
    /// Gap-free voxels, as (stored − offset) × scale.
    Values {
        /// The stored numbers.
        voxels: &'a Voxels,
        /// In stored numbers.
        offset: f64,
        /// Per stored number.
        scale: f64,
    },
    /// Straight sRGB colors, as premultiplied linear RGBA: four numbers a voxel.
    Colors(&'a [[u8; 4]]),
}

impl Source<'_> {
    /// Numbers per voxel.
    fn num_channels(self) -> usize {
        match self {
            Self::Values { .. } => 1,
            Self::Colors(_) => 4,
        }
    }

    /// The numbers of a row of voxels.
    fn read(self, row: Range<usize>, out: &mut [f32]) {
        match self {
            Self::Values { voxels, offset, scale } => with_voxels!(voxels, v => {
                for (o, s) in out.iter_mut().zip(&v[row]) {
                    *o = ((s.to_f64() - offset) * scale) as f32;
                }
            }),
            Self::Colors(colors) => {
                for (o, &color) in out.chunks_exact_mut(4).zip(&colors[row]) {
                    o.copy_from_slice(&premultiplied_linear_from_srgb8(color));
                }
            }
        }
    }
}

impl<'a> Prefilter<'a> {
    /// A filter with standard deviation `sigma_voxels` along x, y, z.
    pub fn new(source: Source<'a>, dims: [usize; 3], sigma_voxels: [f64; 3]) -> Self {
        let taps = std::array::from_fn(|i| {
            // Wider than four times the axis is a plain average already.
            let mut taps = gaussian_taps(sigma_voxels[i].min(4.0 * dims[i] as f64));
            // Beyond the axis every tap reads the edge voxel: fold them.
            if taps.len() > dims[i] {
                let tail: f64 = taps.drain(dims[i]..).sum();
                // Every tap but the middle one is used on both sides.
                taps[dims[i] - 1] += if dims[i] == 1 { 2.0 * tail } else { tail };
            }
            taps.into_iter().map(|t| t as f32).collect()
        });
        Self { source, dims, taps, planes: VecDeque::new(), first_plane: 0 }
    }

    /// The smoothed planes `z0..z1`, x fastest, a color's four numbers together. Slabs are to be asked for in ascending order.
    pub fn slab(&mut self, z0: usize, z1: usize) -> Vec<f32> {
        let [nx, ny, nz] = self.dims;
        let radius = self.taps[2].len() - 1;
        let (from, to) = (z0.saturating_sub(radius), (z1 + radius).min(nz));
        while self.first_plane < from && self.planes.pop_front().is_some() {
            self.first_plane += 1;
        }
        if self.planes.is_empty() {
            self.first_plane = from;
        }
        let next = self.first_plane + self.planes.len();
        let this = &*self;
        let new: Vec<Vec<f32>> = (next..to).into_par_iter().map(|z| this.plane_xy(z)).collect();
        self.planes.extend(new);
        let plane_length = nx * ny * self.source.num_channels();
        let mut slab = vec![0.0f32; plane_length * (z1 - z0)];
        slab.par_chunks_mut(plane_length).zip(z0..z1).for_each(|(out, z)| {
            let plane = |z: isize| &self.planes[z.clamp(0, nz as isize - 1) as usize - self.first_plane];
            for (k, &tap) in self.taps[2].iter().enumerate() {
                accumulate(out, plane(z as isize - k as isize), plane(z as isize + k as isize), tap, k);
            }
        });
        slab
    }

    fn plane_xy(&self, z: usize) -> Vec<f32> {
        let [nx, ny, _] = self.dims;
        // Along x, a color's neighbor is four numbers away.
        let channels = self.source.num_channels();
        let row_length = channels * nx;
        let mut rows = vec![0.0f32; row_length * ny];
        let radius = channels * (self.taps[0].len() - 1);
        let mut padded = vec![0.0f32; row_length + 2 * radius];
        for (y, row) in rows.chunks_mut(row_length).enumerate() {
            let start = nx * (y + ny * z);
            self.source.read(start..start + nx, &mut padded[radius..radius + row_length]);
            for i in (0..radius).rev() {
                padded[i] = padded[i + channels];
            }
            for i in radius + row_length..padded.len() {
                padded[i] = padded[i - channels];
            }
            for (k, &tap) in self.taps[0].iter().enumerate() {
                let (before, after) = (radius - channels * k, radius + channels * k);
                accumulate(row, &padded[before..][..row_length], &padded[after..][..row_length], tap, k);
            }
        }
        let mut plane = vec![0.0f32; row_length * ny];
        for (y, out) in plane.chunks_mut(row_length).enumerate() {
            let row = |y: isize| &rows[row_length * y.clamp(0, ny as isize - 1) as usize..][..row_length];
            for (k, &tap) in self.taps[1].iter().enumerate() {
                accumulate(out, row(y as isize - k as isize), row(y as isize + k as isize), tap, k);
            }
        }
        plane
    }
}

fn accumulate(out: &mut [f32], before: &[f32], after: &[f32], tap: f32, k: usize) {
    if k == 0 {
        for (o, a) in out.iter_mut().zip(after) {
            *o = tap * a;
        }
    } else {
        for ((o, b), a) in out.iter_mut().zip(before).zip(after) {
            *o += tap * (b + a);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taps_sum_to_one_and_zero_sigma_is_the_identity() {
        assert_eq!(gaussian_taps(0.0), [1.0]);
        let taps = gaussian_taps(1.3);
        assert!((taps[0] + 2.0 * taps[1..].iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn slabs_equal_the_direct_sum() {
        let dims = [7, 5, 11];
        let voxels: Vec<i16> = (0..7 * 5 * 11).map(|i| (i * 7919 % 1009) as i16 - 500).collect();
        let sigma = [0.8, 1.1, 1.6];
        let taps = sigma.map(gaussian_taps);
        let direct = |x: usize, y: usize, z: usize| {
            let mut sum = 0.0;
            let weight = |t: &Vec<f64>, k: isize| t.get(k.unsigned_abs()).copied().unwrap_or(0.0);
            for kz in -10..=10isize {
                for ky in -10..=10isize {
                    for kx in -10..=10isize {
                        let w = weight(&taps[0], kx) * weight(&taps[1], ky) * weight(&taps[2], kz);
                        if w > 0.0 {
                            let c = |p: usize, k: isize, n: usize| (p as isize + k).clamp(0, n as isize - 1) as usize;
                            let i = c(x, kx, 7) + 7 * (c(y, ky, 5) + 5 * c(z, kz, 11));
                            sum += w * (f64::from(voxels[i]) + 500.0) / 1000.0;
                        }
                    }
                }
            }
            sum
        };
        let stored = Voxels::I16(voxels.clone());
        let source = Source::Values { voxels: &stored, offset: -500.0, scale: 1e-3 };
        let mut filter = Prefilter::new(source, dims, sigma);
        let mut z = 0;
        for step in [3, 1, 5, 2] {
            let slab = filter.slab(z, z + step);
            for (i, v) in slab.iter().enumerate() {
                let expected = direct(i % 7, i / 7 % 5, z + i / 35);
                assert!((f64::from(*v) - expected).abs() < 1e-5, "{i} of slab {z}: {v} is not {expected}");
            }
            z += step;
        }
    }

    #[test]
    fn a_filter_wider_than_the_volume_ends_and_averages() {
        let stored = Voxels::U8(vec![0, 100]);
        let source = Source::Values { voxels: &stored, offset: 0.0, scale: 1.0 };
        let slab = Prefilter::new(source, [2, 1, 1], [1e6, 1e6, 1e6]).slab(0, 1);
        assert!((slab[0] - 50.0).abs() < 5.0 && (slab[1] - 50.0).abs() < 5.0, "{slab:?}");
    }

    #[test]
    fn a_color_is_smoothed_channel_by_channel() {
        let dims = [5, 4, 3];
        let colors: Vec<[u8; 4]> = (0..60).map(|i| [1, 3, 7, 11].map(|n| (i * n * 37 % 256) as u8)).collect();
        let sigma = [1.4, 0.6, 0.9];
        let slab = Prefilter::new(Source::Colors(&colors), dims, sigma).slab(0, 3);
        for channel in 0..4 {
            let values = colors.iter().map(|&c| premultiplied_linear_from_srgb8(c)[channel]).collect();
            let stored = Voxels::F32(values);
            let source = Source::Values { voxels: &stored, offset: 0.0, scale: 1.0 };
            let alone = Prefilter::new(source, dims, sigma).slab(0, 3);
            assert!(slab.iter().skip(channel).step_by(4).eq(&alone), "channel {channel}");
        }
    }
}
