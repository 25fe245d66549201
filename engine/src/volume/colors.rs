//! Volumes of colors: the values that stand for their voxels, how fast they change, and colors from a label map.

use glam::{DMat3, DVec3, DVec4};
use rayon::prelude::*;

use super::Volume;
use super::labels::LabelMap;
use crate::color::{luminance_of_srgb8, premultiplied_linear_from_srgb8};

/// What a channel counts for in the distance of two colors (premultiplied linear RGBA): the root mean square of the three of
/// light, so that grays are as far apart as their values, and alpha as much as all three of them.
const DISTANCE: DVec4 = DVec4::new(THIRD, THIRD, THIRD, 1.0);
/// √⅓.
const THIRD: f64 = 0.577_350_269_189_625_8;

/// Linear luminances of straight sRGB colors on a grid of `dims` voxels, in steps of 1/65535. A voxel of alpha 0 has no color:
/// as one without data it takes the smallest luminance of its 26 neighbors that are seen, so that its hidden color moves no
/// surface; 0 where there is none.
pub(super) fn luminances(colors: &[[u8; 4]], dims: [usize; 3]) -> Vec<u16> {
    let of = |[r, g, b, _]: [u8; 4]| (luminance_of_srgb8([r, g, b]) * 65535.0).round() as u16;
    let [nx, ny, nz] = dims;
    let hidden = |i: usize| {
        let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
        let around = |at: usize, n: usize| at.saturating_sub(1)..(at + 2).min(n);
        let mut smallest: Option<u16> = None;
        for row in around(z, nz).flat_map(|zz| around(y, ny).map(move |yy| nx * (yy + ny * zz))) {
            for color in &colors[row..row + nx][around(x, nx)] {
                if color[3] > 0 {
                    smallest = Some(smallest.map_or(of(*color), |s| s.min(of(*color))));
                }
            }
        }
        smallest.unwrap_or(0)
    };
    colors.par_iter().enumerate().map(|(i, &color)| if color[3] > 0 { of(color) } else { hidden(i) }).collect()
}

/// ‖g‖ of a volume of colors: the largest singular value of the Jacobian whose rows, `gradients`, are the gradients of the
/// channels of premultiplied linear RGBA, as far as each counts.
pub(super) fn color_change(gradients: [DVec3; 4]) -> f64 {
    let mut square = DMat3::ZERO;
    for (row, weight) in gradients.into_iter().zip(DISTANCE.to_array()) {
        let row = weight * row;
        square += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
    }
    largest_eigenvalue(square).sqrt()
}

/// Of a symmetric matrix without negative eigenvalues, in closed form (O. K. Smith, *Eigenvalues of a symmetric 3 × 3 matrix*,
/// Communications of the ACM 4(4), 1961).
fn largest_eigenvalue(matrix: DMat3) -> f64 {
    let size = matrix.to_cols_array().into_iter().fold(0.0, |a: f64, b| a.max(b.abs()));
    if size <= 0.0 || !size.is_finite() {
        return size.max(0.0);
    }
    let scaled = matrix * size.recip();
    let mean = (scaled.x_axis.x + scaled.y_axis.y + scaled.z_axis.z) / 3.0;
    let rest = scaled - DMat3::from_diagonal(DVec3::splat(mean));
    let spread = (rest.to_cols_array().into_iter().map(|x| x * x).sum::<f64>() / 6.0).sqrt();
    if spread <= 0.0 {
        return size * mean;
    }
    let turn = (0.5 * (rest * spread.recip()).determinant()).clamp(-1.0, 1.0).acos() / 3.0;
    size * (mean + 2.0 * spread * turn.cos())
}

/// Premultiplied linear RGBA of a voxel.
pub(super) fn premultiplied(color: [u8; 4]) -> DVec4 {
    DVec4::from_array(premultiplied_linear_from_srgb8(color).map(f64::from))
}

impl Volume {
    /// A volume of the colors of a label map's structures: opaque where there is one, nothing where there is none (position 0).
    ///
    /// # Errors
    /// As [`Volume::from_colors`]; a voxel whose position is that of no structure.
    pub fn from_labels(labels: &LabelMap) -> Result<Self, String> {
        Self::from_colors(labels.grid, colors_of(labels)?, "labels")
    }
}

/// The color of every voxel's structure, straight sRGB, opaque; transparent where there is none (position 0).
///
/// # Errors
/// A clause for a voxel whose position is that of no structure.
pub(crate) fn colors_of(labels: &LabelMap) -> Result<Vec<[u8; 4]>, String> {
    let mut palette: Vec<[u8; 4]> = labels.labels.iter().map(|l| [l.color[0], l.color[1], l.color[2], 255]).collect();
    if let Some(none) = palette.first_mut() {
        *none = [0; 4];
    }
    let color = |&position: &u16| {
        palette.get(usize::from(position)).copied().ok_or_else(|| {
            format!("a voxel is of structure {position} and the last of them is {}", palette.len() as i64 - 1)
        })
    };
    labels.voxels.iter().map(color).collect()
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::spaces::Grid;
    use crate::volume::Voxels;
    use crate::volume::labels::Label;

    #[test]
    fn hidden_colors_take_their_darkest_neighbors_luminance() {
        let seen = |v: u8| [v, v, v, 255];
        let hidden = [255, 255, 255, 0];
        let luminances = luminances(&[seen(200), hidden, seen(100), hidden, hidden, hidden], [6, 1, 1]);
        let of = |v: u8| (luminance_of_srgb8([v; 3]) * 65535.0).round() as u16;
        assert_eq!(luminances, [of(200), of(100), of(100), of(100), 0, 0]);
    }

    #[test]
    fn the_change_of_grays_is_that_of_their_value() {
        let g = DVec3::new(0.3, -0.7, 0.2);
        assert!((color_change([g, g, g, DVec3::ZERO]) - g.length()).abs() < 1e-12);
        assert!((color_change([DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, g]) - g.length()).abs() < 1e-12);
        // Three channels along three axes: no direction is special, and every singular value is the same.
        let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ZERO];
        assert!((color_change(axes) - THIRD).abs() < 1e-12);
        assert_eq!(color_change([DVec3::ZERO; 4]), 0.0);
        for size in [1e-150, 1e-5, 1e100] {
            let change = color_change([size * DVec3::X, 0.5 * size * DVec3::Y, DVec3::ZERO, DVec3::ZERO]);
            assert!((change / (size * THIRD) - 1.0).abs() < 1e-12, "{size}: {change}");
        }
    }

    #[test]
    fn labels_become_colors() {
        let label = |id, color| Label { id, name: id.to_string(), color, code: None };
        let mut map = LabelMap {
            grid: Grid::new([3, 1, 1], DAffine3::IDENTITY).unwrap(),
            voxels: vec![0, 2, 1],
            labels: vec![label(0, [9; 3]), label(7, [255, 0, 0]), label(70_000, [0, 255, 0])],
            notes: Vec::new(),
        };
        let volume = Volume::from_labels(&map).unwrap();
        assert_eq!(volume.colors, Some(vec![[0; 4], [0, 255, 0, 255], [255, 0, 0, 255]]));
        // Where no structure is, a neighbor's value goes on.
        assert_eq!(volume.voxels, Voxels::U16(vec![46871, 46871, 13933]));
        map.voxels[1] = 3;
        assert!(Volume::from_labels(&map).unwrap_err().contains("structure 3"));
    }
}
