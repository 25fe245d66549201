//! Which way slices lie in the body, and which way up they are shown.
//!
//! A grid that stands upright is cut along the patient's axes. One that does not is cut along its own: the slices that one sees
//! are those that the scanner took, and each goes by the name of the one that it is nearest to.

use glam::DVec3;

use crate::spaces::Grid;

/// Up to this angle between an index axis and the patient's, a grid stands upright. Half a body's breadth away from the middle
/// that is a few millimeters, about a slice.
pub const UPRIGHT_DEG: f64 = 1.0;

/// A slice's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Orientation {
    /// Across the body; anterior is up in the picture.
    Axial,
    /// From side to side, as one sees a face; superior is up.
    Coronal,
    /// From front to back, as one sees a profile; superior is up.
    Sagittal,
}

impl Orientation {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Axial, Self::Coronal, Self::Sagittal];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Axial => "Axial",
            Self::Coronal => "Coronal",
            Self::Sagittal => "Sagittal",
        }
    }

    /// World axes (0: R, 1: A, 2: S): across the slice, to its side, and up in it.
    fn world_axes(self) -> [usize; 3] {
        match self {
            Self::Axial => [2, 0, 1],
            Self::Coronal => [1, 0, 2],
            Self::Sagittal => [0, 1, 2],
        }
    }
}

/// Which side of the body is on which side of axial and coronal slices. Sagittal ones have anterior on the left with both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Convention {
    /// The patient's right is on the left of the picture, as when one faces them.
    #[default]
    Radiological,
    /// The patient's right is on the right of the picture, as when one stands behind them.
    Neurological,
}

impl Convention {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Radiological => "Radiological",
            Self::Neurological => "Neurological",
        }
    }
}

/// How the slices of one orientation lie in a grid, and how they are shown. Directions are unit vectors in RAS.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// To the right of the picture.
    pub right: DVec3,
    /// Up in the picture; across `right`.
    pub up: DVec3,
    /// Across both, to the side where positions grow: superior, anterior or right.
    pub normal: DVec3,
    /// From a place on a slice to the same place on the next, mm: along the normal, or along an index axis of a grid that is sheared.
    pub advance_mm: DVec3,
    /// Position, along the normal from the world's origin, of the middle of the slice that comes first, mm.
    pub first_mm: f64,
    /// From slice to slice, mm; above 0.
    pub step_mm: f64,
    /// How many there are.
    pub num_slices: usize,
}

impl Frame {
    /// Of a grid.
    pub fn of(grid: &Grid, orientation: Orientation, convention: Convention) -> Self {
        let [across, side, upward] = orientation.world_axes();
        let nearest = grid.nearest_world_axes();
        let matrix = grid.world_from_index().matrix3;
        // Step from voxel to voxel along the index axis that is nearest to a world axis, towards that axis' positive end.
        let step = |world: usize| {
            let step = matrix.col(nearest.iter().position(|n| *n == world).unwrap_or(world));
            if step[world] < 0.0 { -step } else { step }
        };
        // A single slice is shown as it is, however little it is turned.
        let is_upright = grid.obliquity_deg() <= UPRIGHT_DEG && !grid.dims().contains(&1);
        let direction = |world: usize| if is_upright { DVec3::AXES[world] } else { step(world) };
        let up = direction(upward).normalize();
        // A sheared grid's axes are not at right angles; a picture's are.
        let aside = direction(side).reject_from_normalized(up).normalize();
        let normal = up.cross(aside);
        let normal = if normal.dot(step(across)) < 0.0 { -normal } else { normal };
        let is_flipped = orientation == Orientation::Sagittal || convention == Convention::Radiological;
        let step_mm = normal.dot(step(across));
        let advance_mm = if is_upright { step_mm * normal } else { step(across) };
        let num_slices = grid.dims()[nearest.iter().position(|n| *n == across).unwrap_or(across)];
        let middle = DVec3::from_array(grid.dims().map(|n| 0.5 * (n as f64 - 1.0)));
        let middle_mm = normal.dot(grid.world_from_index().transform_point3(middle));
        Self {
            right: if is_flipped { -aside } else { aside },
            up,
            normal,
            advance_mm,
            first_mm: middle_mm - 0.5 * step_mm * (num_slices as f64 - 1.0),
            step_mm,
            num_slices,
        }
    }

    /// From the eye into the picture, a unit vector.
    pub fn view_direction(&self) -> DVec3 {
        self.up.cross(self.right)
    }

    /// Position of a place along the normal, mm.
    pub fn position_mm(&self, place_mm: DVec3) -> f64 {
        self.normal.dot(place_mm)
    }

    /// Positions of the middles of the first and the last slice, mm.
    pub fn range_mm(&self) -> [f64; 2] {
        [self.first_mm, self.first_mm + self.step_mm * (self.num_slices as f64 - 1.0)]
    }

    /// The number, from 0, of the slice that is nearest to a position; NaN: the first.
    pub fn slice_at(&self, position_mm: f64) -> usize {
        // Casts saturate.
        (((position_mm - self.first_mm) / self.step_mm).round() as usize).min(self.num_slices - 1)
    }

    /// Position of a slice's middle, mm.
    pub fn slice_mm(&self, slice: usize) -> f64 {
        self.first_mm + self.step_mm * slice as f64
    }

    /// The same place on the slice at a position: the positions along the other two orientations' normals stay, and with them the
    /// other two indices of a voxel.
    #[must_use]
    pub fn moved_to(&self, place_mm: DVec3, position_mm: f64) -> DVec3 {
        place_mm + (position_mm - self.position_mm(place_mm)) / self.step_mm * self.advance_mm
    }

    /// What a grid takes of the picture, as positions along `right` and `up` from the world's origin: least and most, mm.
    pub fn extent_mm(&self, grid: &Grid) -> [[f64; 2]; 2] {
        let (min, max) = grid.index_box();
        let corners = grid.box_corners_mm(min, max);
        [self.right, self.up].map(|axis| {
            let positions = corners.map(|corner| axis.dot(corner));
            [positions.into_iter().fold(f64::MAX, f64::min), positions.into_iter().fold(f64::MIN, f64::max)]
        })
    }
}
