//! Volumes of colors (docs/rendering.md §2, §4): premultiplied linear light in f64, and the gradient that the Jacobian of a
//! color has.

use glam::{DMat3, DVec3, DVec4};

use crate::color::linear_from_srgb;

/// Rec. 709 weights of linear light.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];
/// Rec. 601 weights: what the sign of a gradient goes by.
const BRIGHTNESS: [f64; 3] = [0.299, 0.587, 0.114];
/// Squares of singular values that differ by less than this share of the larger count as the same.
const SAME: f64 = 1e-4;

/// Premultiplied linear RGBA, 0 to 1, of a straight sRGB color.
pub fn premultiplied(color: [u8; 4]) -> DVec4 {
    let [red, green, blue, alpha] = color.map(|code| f64::from(code) / 255.0);
    DVec4::new(alpha * linear_from_srgb(red), alpha * linear_from_srgb(green), alpha * linear_from_srgb(blue), alpha)
}

/// Linear luminance of a linear color.
pub fn luminance(rgb: [f64; 3]) -> f64 {
    (0..3).map(|c| LUMINANCE[c] * rgb[c]).sum()
}

/// How a color changes, per mm along each axis of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jacobian(pub [DVec4; 3]);

impl Jacobian {
    /// By central differences, one voxel to each side of the index-space position `p`. `world_gradient_from_index` is M⁻ᵀ.
    pub fn at(field: impl Fn(DVec3) -> DVec4, world_gradient_from_index: DMat3, p: DVec3) -> Self {
        let difference = |e: DVec3| 0.5 * (field(p + e) - field(p - e));
        let along = [difference(DVec3::X), difference(DVec3::Y), difference(DVec3::Z)];
        let rows = world_gradient_from_index.transpose();
        // ∂/∂world_i = Σ_k (M⁻ᵀ)_ik ∂/∂index_k
        let world = |i: usize| along[0] * rows.col(i).x + along[1] * rows.col(i).y + along[2] * rows.col(i).z;
        Self([world(0), world(1), world(2)])
    }

    /// `weight` of the way from this one to `other`.
    pub fn towards(&self, other: &Self, weight: f64) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + (other.0[i] - self.0[i]) * weight))
    }

    /// g: the direction in which the color changes most, as long as the change is; towards more light and alpha.
    pub fn gradient(&self) -> DVec3 {
        // Rows: what the root mean square of light and alpha take of each channel.
        let third = (1.0 / 3.0f64).sqrt();
        let row = |c: usize, weight: f64| weight * DVec3::new(self.0[0][c], self.0[1][c], self.0[2][c]);
        let rows = [row(0, third), row(1, third), row(2, third), row(3, 1.0)];
        let size = rows.iter().map(|r| r.abs().max_element()).fold(0.0, f64::max);
        if size < f64::MIN_POSITIVE {
            return DVec3::ZERO;
        }
        let rows = rows.map(|r| r / size);
        let square = rows.iter().fold(DMat3::ZERO, |sum, r| sum + DMat3::from_cols(*r * r.x, *r * r.y, *r * r.z));
        let (values, vectors) = eigen(square);
        let largest = values.into_iter().fold(0.0, f64::max);
        // Light and alpha: the sign, and the choice where several directions are as strong.
        let brighter = (0..3).map(|c| BRIGHTNESS[c] / third * rows[c]).fold(rows[3], |a, b| a + b);
        let strongest = (0..3).filter(|&i| values[i] >= (1.0 - SAME) * largest);
        let directions: Vec<DVec3> = strongest.map(|i| vectors[i]).collect();
        let along = match directions[..] {
            [one] => {
                if one.dot(brighter) >= 0.0 {
                    one
                } else {
                    -one
                }
            }
            _ => directions.iter().map(|d| *d * d.dot(brighter)).sum::<DVec3>().normalize_or_zero(),
        };
        along * largest.sqrt() * size
    }
}

/// Eigenvalues and unit eigenvectors of a symmetric matrix, by Jacobi's rotations.
fn eigen(matrix: DMat3) -> ([f64; 3], [DVec3; 3]) {
    let (mut a, mut v) = (matrix, DMat3::IDENTITY);
    for _ in 0..30 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(q)[p];
            if off.abs() < 1e-300 {
                continue;
            }
            let theta = (a.col(q)[q] - a.col(p)[p]) / (2.0 * off);
            let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
            let (c, s) = (1.0 / t.hypot(1.0), t / t.hypot(1.0));
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = c;
            turn.col_mut(q)[q] = c;
            turn.col_mut(q)[p] = s;
            turn.col_mut(p)[q] = -s;
            a = turn.transpose() * a * turn;
            v *= turn;
        }
    }
    ([a.x_axis.x, a.y_axis.y, a.z_axis.z], [v.x_axis, v.y_axis, v.z_axis])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Jacobian whose rows (red, green, blue, alpha) are given.
    fn of_rows(rows: [DVec3; 4]) -> Jacobian {
        Jacobian([0, 1, 2].map(|i| DVec4::new(rows[0][i], rows[1][i], rows[2][i], rows[3][i])))
    }

    #[test]
    fn eigen_takes_matrices_apart() {
        let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(-1.9) * DMat3::from_rotation_y(0.4);
        for values in [[3.0, 2.0, 1.0], [1.0, 1.0, 1.0], [5.0, 0.0, 0.0], [2.0, 2.0, 0.1], [1.0, 1e-9, 1e-12], [0.0; 3]]
        {
            let matrix = turn * DMat3::from_diagonal(DVec3::from_array(values)) * turn.transpose();
            let (found, vectors) = eigen(matrix);
            for (value, vector) in found.into_iter().zip(vectors) {
                assert!((matrix * vector - value * vector).length() < 1e-12, "{values:?}: {found:?}");
                assert!((vector.length() - 1.0).abs() < 1e-12);
            }
            assert!((found.iter().sum::<f64>() - values.iter().sum::<f64>()).abs() < 1e-12);
        }
    }

    #[test]
    fn the_gradient_of_grays_is_that_of_their_value() {
        for size in [1e-200, 1e-9, 1.0, 1e90] {
            let g = DVec3::new(-0.3, 0.8, 0.1) * size;
            let found = of_rows([g, g, g, DVec3::ZERO]).gradient();
            assert!((found - g).length() < 1e-12 * size, "{found}");
            let found = of_rows([DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, g]).gradient();
            assert!((found - g).length() < 1e-12 * size, "{found}");
        }
        assert_eq!(of_rows([DVec3::ZERO; 4]).gradient(), DVec3::ZERO);
    }

    #[test]
    fn colors_of_one_luminance_have_a_gradient() {
        // From red to green: the luminance stays and the color does not.
        let g = DVec3::new(0.6, 0.0, 0.8);
        let rows = [g / 0.2126, -g / 0.7152, DVec3::ZERO, DVec3::ZERO];
        let found = of_rows(rows).gradient();
        let expected = ((1.0 / 0.2126f64).powi(2) + (1.0 / 0.7152f64).powi(2)).sqrt() / 3.0f64.sqrt();
        assert!((found.length() - expected).abs() < 1e-12 && found.cross(g).length() < 1e-9, "{found}");
    }

    #[test]
    fn of_two_changes_that_are_as_strong_light_decides() {
        let found = of_rows([DVec3::X, DVec3::ZERO, -DVec3::Y, DVec3::ZERO]).gradient();
        // Red grows along x and blue along -y; red is brighter.
        let expected = DVec3::new(0.299, -0.114, 0.0).normalize() / 3.0f64.sqrt();
        assert!((found - expected).length() < 1e-12, "{found}");
    }

    #[test]
    fn the_jacobian_of_a_linear_field_is_its_slope() {
        let affine = super::super::testing::awkward_affines()[4];
        let slopes = [DVec3::X, DVec3::new(0.2, -3.0, 0.5), DVec3::ZERO, DVec3::ONE];
        let field = |p: DVec3| {
            let world = affine.transform_point3(p);
            DVec4::from_array(slopes.map(|s| s.dot(world)))
        };
        let found = Jacobian::at(field, affine.matrix3.inverse().transpose(), DVec3::new(3.0, 4.0, 5.0));
        for (i, axis) in found.0.into_iter().enumerate() {
            assert!((axis - DVec4::from_array(slopes.map(|s| s[i]))).length() < 1e-9);
        }
    }
}
