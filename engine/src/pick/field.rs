//! The data along a ray, from the voxels as they are asked for.

use std::cell::OnceCell;

use glam::{DMat3, DVec3, DVec4};

use crate::reference::color::{Jacobian, premultiplied};
use crate::reference::sample::{Quantity, central_differences, trilinear, within_centers};
use crate::scene::Object;

/// Gauss-Hermite quadrature with three points: a Gaussian of deviation σ as samples at these multiples of it. Exact for
/// polynomials of up to the fifth degree, which is closer than the normals of a picture need.
const GAUSSIAN: [(f64, f64); 3] =
    [(-1.732_050_807_568_877_2, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732_050_807_568_877_2, 1.0 / 6.0)];

/// The data as pictures reconstruct them (docs/rendering.md §2), voxel by voxel as they are asked for.
pub struct Field<'a> {
    object: &'a Object,
    /// Smallest data value of the volume.
    least: OnceCell<f64>,
}

impl<'a> Field<'a> {
    /// Of an object.
    pub fn of(object: &'a Object) -> Self {
        Self { object, least: OnceCell::new() }
    }

    /// The data value of a voxel; where it has none, the smallest of its neighbors', else of the volume's.
    fn voxel(&self, x: usize, y: usize, z: usize) -> f64 {
        let volume = &self.object.volume;
        let value = volume.value(x, y, z);
        if value.is_finite() {
            return value;
        }
        let [nx, ny, nz] = volume.grid.dims();
        let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
        let mut smallest = f64::INFINITY;
        for zz in around(z, nz) {
            for yy in around(y, ny) {
                for xx in around(x, nx) {
                    let neighbor = volume.value(xx, yy, zz);
                    smallest = if neighbor.is_finite() { smallest.min(neighbor) } else { smallest };
                }
            }
        }
        if smallest.is_finite() { smallest } else { *self.least.get_or_init(|| self.object.data_range().0) }
    }

    /// Data value at the index-space position `p`.
    pub fn value(&self, p: DVec3) -> f64 {
        trilinear(self.object.volume.grid.dims(), p, |x, y, z| self.voxel(x, y, z))
    }

    /// Premultiplied linear color at `p`, in a volume of colors.
    fn color(&self, colors: &[[u8; 4]], p: DVec3) -> DVec4 {
        let dims = self.object.volume.grid.dims();
        trilinear(dims, p, |x, y, z| premultiplied(colors[x + dims[0] * (y + dims[1] * z)]))
    }

    /// ĝ's numerator at `p`: the gradient of the data, or what the change of colors makes of it, smoothed by a Gaussian of
    /// deviation `sigma` (in voxels along each axis).
    pub fn gradient(&self, p: DVec3, sigma: DVec3, to_world: DMat3) -> DVec3 {
        let p = within_centers(self.object.volume.grid.dims(), p);
        match &self.object.volume.colors {
            None => central_differences(|p| smoothed(|p| self.value(p), p, sigma), to_world, p),
            Some(colors) => Jacobian::at(|p| smoothed(|p| self.color(colors, p), p, sigma), to_world, p).gradient(),
        }
    }

    /// Weight, from 0 to 1, of the voxels around `p` that have data, and the alpha of colors.
    pub fn has_data(&self, p: DVec3) -> f64 {
        let volume = &self.object.volume;
        if let Some(colors) = &volume.colors {
            return self.color(colors, p).w;
        }
        trilinear(volume.grid.dims(), p, |x, y, z| if volume.value(x, y, z).is_finite() { 1.0 } else { 0.0 })
    }
}

/// A field at `p`, smoothed by a Gaussian of deviation `sigma` (in voxels along each axis).
fn smoothed<T: Quantity>(field: impl Fn(DVec3) -> T, p: DVec3, sigma: DVec3) -> T {
    let middle = field(p);
    if sigma == DVec3::ZERO {
        return middle;
    }
    // As differences from the middle, which keep a constant.
    let mut sum = middle;
    for (z, weight_z) in GAUSSIAN {
        for (y, weight_y) in GAUSSIAN {
            for (x, weight_x) in GAUSSIAN {
                let weight = weight_x * weight_y * weight_z;
                sum = sum + (field(p + DVec3::new(x, y, z) * sigma) - middle) * weight;
            }
        }
    }
    sum
}
