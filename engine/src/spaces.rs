//! Spaces and the affine between them.
//!
//! *World* is millimeters, right-handed, RAS+ (x right, y anterior, z superior).
//! *Index* is the voxel grid: voxel centers at integers, x fastest in memory.

use glam::{DAffine3, DMat3, DVec3};

/// The letters of the world axes' two ends.
const LETTERS: [[char; 2]; 3] = [['R', 'L'], ['A', 'P'], ['S', 'I']];

/// Towards which side of the body a direction (RAS, of any length) points: the letter that fits best first, then those that come
/// near to it ("AL" for an oblique one).
pub fn direction_letters(direction: DVec3) -> String {
    let direction = direction.normalize_or_zero();
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| direction[b].abs().total_cmp(&direction[a].abs()));
    // Within 22.5° of an axis, it alone is meant.
    let limit = std::f64::consts::FRAC_PI_8.sin();
    let meant = axes.into_iter().enumerate().filter(|(i, axis)| *i == 0 || direction[*axis].abs() > limit);
    meant.map(|(_, axis)| LETTERS[axis][usize::from(direction[axis] < 0.0)]).collect()
}

/// A voxel grid in the world: its size and where its voxel centers lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    dims: [usize; 3],
    world_from_index: DAffine3,
    index_from_world: DAffine3,
}

impl Grid {
    /// A grid of `dims` voxels (x y z, each ≥ 1) with the affine that takes voxel indices to world mm.
    ///
    /// # Errors
    /// A clause saying what is wrong: an axis of 0 voxels, an affine that is not finite or not invertible
    /// (volume of a voxel below 1e-30 mm³ or flatter than 1e-9), more voxels than fit an address.
    pub fn new(dims: [usize; 3], world_from_index: DAffine3) -> Result<Self, String> {
        if dims.contains(&0) {
            return Err(format!("the grid has an axis of 0 voxels ({} x {} x {})", dims[0], dims[1], dims[2]));
        }
        if dims[0]
            .checked_mul(dims[1])
            .and_then(|n| n.checked_mul(dims[2]))
            .is_none_or(|n| n > isize::MAX as usize / 16)
        {
            return Err(format!("{} x {} x {} voxels are more than any memory holds", dims[0], dims[1], dims[2]));
        }
        if !world_from_index.is_finite() {
            return Err("the voxel-to-world matrix has entries that are not finite".to_owned());
        }
        let m = world_from_index.matrix3;
        let lengths = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
        let det = m.determinant().abs();
        if !(det > 1e-30 && det > 1e-9 * lengths) {
            return Err("the voxel axes do not span space (spacing 0 or singular voxel-to-world matrix)".to_owned());
        }
        Ok(Self { dims, world_from_index, index_from_world: world_from_index.inverse() })
    }

    /// Number of voxels along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Number of voxels in all.
    pub fn num_voxels(&self) -> usize {
        self.dims[0] * self.dims[1] * self.dims[2]
    }

    /// World mm of a (fractional) voxel index.
    pub fn world_from_index(&self) -> DAffine3 {
        self.world_from_index
    }

    /// (Fractional) voxel index of a world position in mm.
    pub fn index_from_world(&self) -> DAffine3 {
        self.index_from_world
    }

    /// Distance of neighboring voxel centers along x, y, z of the grid, in mm.
    pub fn spacing_mm(&self) -> DVec3 {
        let m = self.world_from_index.matrix3;
        DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length())
    }

    /// Takes a gradient per index step to a gradient per mm of world space (the inverse transpose).
    pub fn world_gradient_from_index(&self) -> DMat3 {
        self.index_from_world.matrix3.transpose()
    }

    /// Whether the grid is a mirror image of a right-handed one (as LAS is).
    pub fn is_left_handed(&self) -> bool {
        self.world_from_index.matrix3.determinant() < 0.0
    }

    /// The world axis (0: R, 1: A, 2: S) that each index axis follows best. Every index axis gets another one, so that a 45° grid
    /// has three too.
    pub fn nearest_world_axes(&self) -> [usize; 3] {
        const PERMUTATIONS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let axes = self.unit_axes();
        let fit = |p: &[usize; 3]| -> f64 { (0..3).map(|i| axes[i][p[i]].abs()).sum() };
        PERMUTATIONS.iter().copied().reduce(|a, b| if fit(&b) > fit(&a) { b } else { a }).unwrap_or([0, 1, 2])
    }

    /// The world direction that each index axis follows best ([`Grid::nearest_world_axes`]), as letters ("RAS": x to the right,
    /// y to the front, z up).
    pub fn orientation_letters(&self) -> String {
        let axes = self.unit_axes();
        let nearest = self.nearest_world_axes();
        (0..3).map(|i| LETTERS[nearest[i]][usize::from(axes[i][nearest[i]] < 0.0)]).collect()
    }

    /// Largest angle between an index axis and the world axis of its letter, in degrees (0 for an upright grid).
    pub fn obliquity_deg(&self) -> f64 {
        self.unit_axes().iter().map(|a| a.abs().max_element().clamp(0.0, 1.0).acos().to_degrees()).fold(0.0, f64::max)
    }

    fn unit_axes(&self) -> [DVec3; 3] {
        let m = self.world_from_index.matrix3;
        [m.x_axis.normalize_or_zero(), m.y_axis.normalize_or_zero(), m.z_axis.normalize_or_zero()]
    }

    /// The eight corners, in world mm, of the index box `min..=max` (half a voxel beyond the outer centers
    /// for the whole grid: `-0.5 ..= dims - 0.5`).
    pub fn box_corners_mm(&self, min: DVec3, max: DVec3) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, axis: usize| if i >> bit & 1 == 0 { min[axis] } else { max[axis] };
            self.world_from_index.transform_point3(DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2)))
        })
    }

    /// The index box of the whole grid: half a voxel beyond the outer voxel centers.
    pub fn index_box(&self) -> (DVec3, DVec3) {
        let d = self.dims.map(|n| n as f64 - 0.5);
        (DVec3::splat(-0.5), DVec3::from_array(d))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_follow_the_axes() {
        let las = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 2.0)));
        let grid = Grid::new([2, 2, 2], las).unwrap();
        assert_eq!(grid.orientation_letters(), "LAS");
        assert!(grid.is_left_handed());
        // A grid turned by exactly 45° still has three different letters.
        let turned = DAffine3::from_mat3(DMat3::from_rotation_z(std::f64::consts::FRAC_PI_4));
        let letters = Grid::new([2, 2, 2], turned).unwrap().orientation_letters();
        assert_eq!(letters.len(), 3);
        assert!(letters.contains(['R', 'L']) && letters.contains(['A', 'P']) && letters.ends_with('S'), "{letters}");
    }

    #[test]
    fn flat_and_broken_grids_are_refused() {
        let flat = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)));
        assert!(Grid::new([2, 2, 2], flat).unwrap_err().contains("do not span space"));
        assert!(Grid::new([2, 0, 2], DAffine3::IDENTITY).is_err());
        assert!(Grid::new([usize::MAX, 2, 2], DAffine3::IDENTITY).is_err());
        let nan = DAffine3::from_translation(DVec3::new(f64::NAN, 0.0, 0.0));
        assert!(Grid::new([1, 1, 1], nan).is_err());
        // 1e-4 mm voxels are a micro-CT, not a fault.
        assert!(Grid::new([2, 2, 2], DAffine3::from_scale(DVec3::splat(1e-4))).is_ok());
    }
}
