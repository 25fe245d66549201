//! Reconstruction (docs/rendering.md §2): voxels as f64, trilinear values, the gradient volume, gradients and their
//! normalization G. Prepared once per volume; read at every sample of a ray.

use std::ops::{Add, Mul, Sub};

use glam::{DMat3, DVec3, DVec4};
use rayon::prelude::*;

use crate::spaces::Grid;

/// G rests on about this many voxels at most.
const MAX_GRADIENT_SAMPLES: usize = 1 << 20;

/// What can be interpolated and smoothed: data values, and colors.
pub trait Quantity: Copy + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<f64, Output = Self> {}
impl Quantity for f64 {}
impl Quantity for DVec4 {}

/// One value per voxel, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice<T = f64> {
    /// Number of voxels along x, y, z.
    pub dims: [usize; 3],
    /// `dims[0] * dims[1] * dims[2]` values.
    pub values: Vec<T>,
}

impl<T: Copy> Lattice<T> {
    /// The value of voxel x, y, z.
    ///
    /// # Panics
    /// If the index is outside the lattice.
    pub fn at(&self, x: usize, y: usize, z: usize) -> T {
        self.values[x + self.dims[0] * (y + self.dims[1] * z)]
    }
}

/// Keeps a constant exactly, which a(1 − w) + bw does not: no noise for normals to be taken from.
fn lerp<T: Quantity>(a: T, b: T, w: f64) -> T {
    a + (b - a) * w
}

/// Trilinear value, at the index-space position `p`, of a grid of `dims` voxels whose values `at` gives; beyond the outer
/// voxel centers the edge value goes on.
pub fn trilinear<T: Quantity>(dims: [usize; 3], p: DVec3, at: impl Fn(usize, usize, usize) -> T) -> T {
    let axis = |i: usize| {
        let last = dims[i] - 1;
        let clamped = p[i].clamp(0.0, last as f64);
        let low = clamped.floor();
        let first = low as usize;
        (first, (first + 1).min(last), clamped - low)
    };
    let ((x0, x1, wx), (y0, y1, wy), (z0, z1, wz)) = (axis(0), axis(1), axis(2));
    let along_x = |y: usize, z: usize| lerp(at(x0, y, z), at(x1, y, z), wx);
    let along_y = |z: usize| lerp(along_x(y0, z), along_x(y1, z), wy);
    lerp(along_y(z0), along_y(z1), wz)
}

/// [`trilinear`] of a lattice.
pub fn sample_volume<T: Quantity>(lattice: &Lattice<T>, p: DVec3) -> T {
    trilinear(lattice.dims, p, |x, y, z| lattice.at(x, y, z))
}

/// F: the data smoothed by a Gaussian of standard deviation `sigma_mm` (0: the data itself), separably along the index
/// axes, the edge voxel going on beyond the edge.
pub fn gradient_volume<T: Quantity>(data: &Lattice<T>, grid: &Grid, sigma_mm: f64) -> Lattice<T> {
    let mut smoothed = data.clone();
    if sigma_mm > 0.0 {
        for axis in 0..3 {
            // A Gaussian wider than that is flat over the axis.
            let widest = 4.0 * data.dims[axis] as f64;
            smoothed = smooth_along(&smoothed, axis, (sigma_mm / grid.spacing_mm()[axis]).min(widest));
        }
    }
    smoothed
}

/// Smooths along one index axis with a Gaussian of `sigma` voxels, sampled at the integers up to ⌈4σ⌉.
fn smooth_along<T: Quantity>(lattice: &Lattice<T>, axis: usize, sigma: f64) -> Lattice<T> {
    let n = lattice.dims[axis] as i64;
    let radius = (4.0 * sigma).ceil() as i64;
    let bell = |k: i64| (-0.5 * (k as f64 / sigma).powi(2)).exp();
    let sum: f64 = (-radius..=radius).map(bell).sum();
    // For each voxel of the axis: the first voxel that it reads and the weights from there on. What falls beyond the
    // edge is added to the edge voxel's weight.
    let rows: Vec<(i64, Vec<f64>)> = (0..n)
        .map(|i| {
            let (first, last) = ((i - radius).max(0), (i + radius).min(n - 1));
            let mut weights = vec![0.0; (last - first + 1) as usize];
            for k in -radius..=radius {
                weights[((i + k).clamp(0, n - 1) - first) as usize] += bell(k) / sum;
            }
            (first, weights)
        })
        .collect();
    let stride: usize = lattice.dims[..axis].iter().product();
    let values = (0..lattice.values.len())
        .into_par_iter()
        .map(|voxel| {
            let i = voxel / stride % lattice.dims[axis];
            let (first, weights) = &rows[i];
            let own = lattice.values[voxel];
            let start = voxel - i * stride + *first as usize * stride;
            // Weights sum to 1; differences keep a constant exactly constant.
            let terms = weights.iter().enumerate().map(|(k, &w)| (lattice.values[start + k * stride] - own) * w);
            terms.fold(own, |sum, term| sum + term)
        })
        .collect();
    Lattice { dims: lattice.dims, values }
}

/// The world gradient, in data units per mm, of an index-space field at `p`: central differences, one voxel to each side.
/// `world_gradient_from_index` is M⁻ᵀ.
pub fn central_differences(field: impl Fn(DVec3) -> f64, world_gradient_from_index: DMat3, p: DVec3) -> DVec3 {
    let difference = |e: DVec3| 0.5 * (field(p + e) - field(p - e));
    world_gradient_from_index * DVec3::new(difference(DVec3::X), difference(DVec3::Y), difference(DVec3::Z))
}

/// g at the index-space position `p`, in data units per mm of world space: [`central_differences`] of the trilinear
/// gradient volume. Beyond the outer voxel centers that of the edge goes on.
pub fn gradient_at(gradient_volume: &Lattice, world_gradient_from_index: DMat3, p: DVec3) -> DVec3 {
    let within = within_centers(gradient_volume.dims, p);
    central_differences(|q| sample_volume(gradient_volume, q), world_gradient_from_index, within)
}

/// The place between the outer voxel centers of a grid of `dims` voxels that is nearest to the index-space position `p`.
pub fn within_centers(dims: [usize; 3], p: DVec3) -> DVec3 {
    p.clamp(DVec3::ZERO, DVec3::from_array(dims.map(|n| n as f64 - 1.0)))
}

/// G: the 99.9th percentile of ‖g‖, in data units per mm, over the voxels where it is above 0, from the unsmoothed
/// `data`; 1 if there is none. Large volumes are looked at every n-th voxel, n odd.
pub fn gradient_max(data: &Lattice, world_gradient_from_index: DMat3) -> f64 {
    steepest(data.dims, |center| gradient_at(data, world_gradient_from_index, center).length())
}

/// G of ‖g‖ at the voxel centers (index space) of a grid of `dims` voxels.
pub fn steepest(dims: [usize; 3], magnitude: impl Fn(DVec3) -> f64) -> f64 {
    let count = dims.iter().product::<usize>();
    let stride = count.div_ceil(MAX_GRADIENT_SAMPLES) | 1;
    let [nx, ny, _] = dims;
    let mut magnitudes: Vec<f64> = (0..count)
        .step_by(stride)
        .map(|voxel| {
            let center = DVec3::new((voxel % nx) as f64, (voxel / nx % ny) as f64, (voxel / nx / ny) as f64);
            // Voxel centers a unit apart: the clamp makes the edge one-sided, still divided by 2.
            magnitude(center)
        })
        .filter(|&magnitude| magnitude > 0.0)
        .collect();
    magnitudes.sort_by(f64::total_cmp);
    match magnitudes.len() {
        0 => 1.0,
        n => magnitudes[(n - 1) * 999 / 1000],
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{awkward_affines, lattice};
    use super::*;

    #[test]
    fn sample_volume_reproduces_a_linear_field() {
        let field = |p: DVec3| 3.0 * p.x - 2.0 * p.y + 0.5 * p.z + 7.0;
        let data = lattice([5, 6, 7], field);
        for i in 0..500 {
            let p = DVec3::new(f64::from(i) * 0.137 % 4.0, f64::from(i) * 0.291 % 5.0, f64::from(i) * 0.533 % 6.0);
            assert!((sample_volume(&data, p) - field(p)).abs() < 1e-12);
        }
        // Beyond the outer centers the edge goes on.
        assert_eq!(sample_volume(&data, DVec3::new(-0.5, 2.0, 3.0)), field(DVec3::new(0.0, 2.0, 3.0)));
        assert_eq!(sample_volume(&data, DVec3::new(1.0, 5.5, 9.0)), field(DVec3::new(1.0, 5.0, 6.0)));
        assert_eq!(sample_volume(&lattice([1, 1, 1], |_| 4.0), DVec3::splat(0.3)), 4.0);
    }

    #[test]
    fn gradient_at_is_the_world_gradient_of_a_linear_field() {
        let slope = DVec3::new(0.3, -1.7, 2.9);
        for affine in awkward_affines() {
            let grid = Grid::new([21, 22, 23], affine).unwrap();
            let data = lattice(grid.dims(), |p| slope.dot(affine.transform_point3(p)) - 4.0);
            let to_world = affine.matrix3.inverse().transpose();
            // A Gaussian leaves a linear field as it is, away from the edge.
            for sigma_mm in [0.0, 0.8 * grid.spacing_mm().min_element()] {
                let smoothed = gradient_volume(&data, &grid, sigma_mm);
                for p in [DVec3::new(10.0, 11.0, 12.0), DVec3::new(9.3, 11.7, 10.1)] {
                    let g = gradient_at(&smoothed, to_world, p);
                    assert!((g - slope).length() < 1e-9, "{g} {affine:?}");
                }
            }
        }
    }

    #[test]
    fn gradient_volume_of_an_impulse_is_the_kernel() {
        let grid = Grid::new([21, 1, 1], glam::DAffine3::from_scale(DVec3::new(0.5, 1.0, 1.0))).unwrap();
        let data = lattice(grid.dims(), |p| if p.x == 10.0 { 1.0 } else { 0.0 });
        // σ = 0.75 mm is 1.5 voxels of 0.5 mm; taps reach 6 voxels.
        let smoothed = gradient_volume(&data, &grid, 0.75);
        let bell = |k: i32| (-f64::from(k * k) / (2.0 * 1.5 * 1.5)).exp();
        let sum: f64 = (-6..=6).map(bell).sum();
        for k in -10..=10i32 {
            let expected = if k.abs() <= 6 { bell(k) / sum } else { 0.0 };
            assert!((smoothed.values[(10 + k) as usize] - expected).abs() < 1e-15, "{k}");
        }
    }

    #[test]
    fn gradient_volume_keeps_a_constant_and_repeats_the_edge() {
        let grid = Grid::new([6, 5, 4], glam::DAffine3::IDENTITY).unwrap();
        let constant = lattice(grid.dims(), |_| 0.1);
        // 1e9 mm is capped at four axis lengths; 1e-200 mm is a single tap.
        for sigma_mm in [1e-200, 0.3, 1.0, 50.0, 1e9] {
            assert_eq!(gradient_volume(&constant, &grid, sigma_mm), constant);
        }
        let step = lattice([6, 1, 1], |p| if p.x < 1.0 { 1.0 } else { 0.0 });
        let line = Grid::new([6, 1, 1], glam::DAffine3::IDENTITY).unwrap();
        let smoothed = gradient_volume(&step, &line, 1.0);
        let bell: Vec<f64> = (-4..=4).map(|k| (-0.5 * f64::from(k * k)).exp()).collect();
        // The first voxel sees itself in place of all that lies before it: the weights of k ≤ 0.
        let expected = bell[..5].iter().sum::<f64>() / bell.iter().sum::<f64>();
        assert!((smoothed.values[0] - expected).abs() < 1e-15);
    }

    #[test]
    fn gradient_max_is_the_percentile() {
        // 3 units a voxel of 0.5 mm inside; one-sided at the edge, so half of that there.
        let to_world = DMat3::from_diagonal(DVec3::new(2.0, 1.0, 1.0));
        let ramp = lattice([5, 4, 4], |p| 3.0 * p.x);
        assert_eq!(gradient_max(&ramp, to_world), 6.0);
        let pair = lattice([2, 1, 1], |p| 3.0 * p.x);
        assert_eq!(gradient_max(&pair, to_world), 3.0);
        assert_eq!(gradient_max(&lattice([5, 4, 4], |_| 0.1), to_world), 1.0);
        // Voxel i has the magnitude i, the first 0 and the last 1501: 3002 above 0, of which 1501 twice. The rank is
        // 3001·999/1000 = 2997, the value there 2997.
        let mut values = vec![0.0; 3003];
        for i in 1..3002 {
            values[i + 1] = values[i - 1] + 2.0 * i as f64;
        }
        assert_eq!(gradient_max(&Lattice { dims: [3003, 1, 1], values }, DMat3::IDENTITY), 2997.0);
        // Above 2²⁰ voxels every third is looked at: those here have ½ and the others 2 and 2½.
        let values = (0..(1 << 20) + 1).map(|i| [0.0, 5.0, 4.0][i % 3]).collect();
        assert_eq!(gradient_max(&Lattice { dims: [(1 << 20) + 1, 1, 1], values }, DMat3::IDENTITY), 0.5);
    }
}
