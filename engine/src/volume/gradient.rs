//! How steep a volume's edges are.

use glam::DVec3;
use rayon::prelude::*;

use super::colors::{color_change, premultiplied};
use super::{Volume, Voxel, Voxels};
use crate::with_voxels;

/// At most about this many voxels are looked at: the 99.9th percentile of 2²⁰ samples rests on a thousand.
const MAX_SAMPLES: usize = 1 << 20;

/// G: the 99.9th percentile of ‖g‖, in data units per mm, over the voxels whose central differences are not all 0;
/// 1 for a constant volume. (The thesis takes the maximum: one metal implant turns everything else to 0.)
/// `voxels` are the volume's, without gaps. In a volume of colors ‖g‖ is how fast the color changes. Large volumes are sampled
/// at a fixed stride, so the result is the same on every run.
pub fn gradient_max(volume: &Volume, voxels: &Voxels) -> f64 {
    let to_world = volume.grid.world_gradient_from_index();
    if let Some(colors) = &volume.colors {
        return percentile(volume, |neighbors| {
            let [x, y, z] = neighbors.map(|[below, above]| premultiplied(colors[above]) - premultiplied(colors[below]));
            color_change([0, 1, 2, 3].map(|c| to_world * (0.5 * DVec3::new(x[c], y[c], z[c]))))
        });
    }
    let slope = volume.rescale.slope;
    with_voxels!(voxels, v => percentile(volume, |neighbors| {
        let [x, y, z] = neighbors.map(|[below, above]| v[above].to_f64() - v[below].to_f64());
        (to_world * (0.5 * slope * DVec3::new(x, y, z))).length()
    }))
}

/// Of `magnitude` of a voxel's neighbors (below and above it along x, y, z; itself at the edge), over the voxels where it is
/// above 0.
fn percentile(volume: &Volume, magnitude: impl Fn([[usize; 2]; 3]) -> f64 + Sync) -> f64 {
    let [nx, ny, nz] = volume.grid.dims();
    // An odd stride prime to most axis lengths visits all rows and columns.
    let stride = (volume.grid.num_voxels().div_ceil(MAX_SAMPLES)) | 1;
    let mut magnitudes: Vec<f64> = (0..volume.grid.num_voxels().div_ceil(stride))
        .into_par_iter()
        .filter_map(|s| {
            let i = s * stride;
            let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
            let at = |x: usize, y: usize, z: usize| x + nx * (y + ny * z);
            let magnitude = magnitude([
                [at(x.saturating_sub(1), y, z), at((x + 1).min(nx - 1), y, z)],
                [at(x, y.saturating_sub(1), z), at(x, (y + 1).min(ny - 1), z)],
                [at(x, y, z.saturating_sub(1)), at(x, y, (z + 1).min(nz - 1))],
            ]);
            (magnitude > 0.0 && magnitude.is_finite()).then_some(magnitude)
        })
        .collect();
    if magnitudes.is_empty() {
        return 1.0;
    }
    let rank = (magnitudes.len() - 1) * 999 / 1000;
    *magnitudes.select_nth_unstable_by(rank, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spaces::Grid;
    use crate::volume::Rescale;

    #[test]
    fn gradient_max_is_in_data_units_per_mm() {
        // 3 stored units a voxel of 0.5 mm, slope 2: 12 data units a mm.
        let grid = Grid::new([5, 4, 4], glam::DAffine3::from_scale(DVec3::new(0.5, 1.0, 1.0))).unwrap();
        let ramp = Voxels::I16((0..80).map(|i| 3 * (i % 5)).collect());
        let volume = Volume::new(grid, ramp, Rescale { slope: 2.0, intercept: 7.0 }, "test").unwrap();
        assert!((gradient_max(&volume, &volume.voxels) - 12.0).abs() < 1e-12);
        let flat = Volume::new(grid, Voxels::U8(vec![9; 80]), Rescale::IDENTITY, "test").unwrap();
        assert_eq!(gradient_max(&flat, &flat.voxels), 1.0);
    }
}
