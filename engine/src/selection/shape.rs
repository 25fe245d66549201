//! Ellipsoids and boxes in space, with borders one voxel wide.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::fill::{Filling, filled, places, point, quantized, voxel_box, voxels_of};
use super::{BRICK, BrickPool, Limits, Selection, VoxelBox};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;

/// A solid in the world, RAS mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    kind: Kind,
    /// Takes the unit ball, or the cube from −1 to 1, to the shape.
    world_from_unit: DAffine3,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Ellipsoid,
    Cuboid,
}

impl Shape {
    /// A ball.
    pub fn ball(center_mm: DVec3, radius_mm: f64) -> Self {
        Self::ellipsoid(center_mm, DVec3::splat(radius_mm), DMat3::IDENTITY)
    }

    /// An ellipsoid with its half axes along the columns of `axes`, a rotation.
    pub fn ellipsoid(center_mm: DVec3, radii_mm: DVec3, axes: DMat3) -> Self {
        Self::new(Kind::Ellipsoid, center_mm, radii_mm, axes)
    }

    /// A box with its edges, of these lengths, along the columns of `axes`, a rotation.
    pub fn cuboid(center_mm: DVec3, size_mm: DVec3, axes: DMat3) -> Self {
        Self::new(Kind::Cuboid, center_mm, 0.5 * size_mm, axes)
    }

    fn new(kind: Kind, center_mm: DVec3, half_mm: DVec3, axes: DMat3) -> Self {
        let matrix3 = axes * DMat3::from_diagonal(half_mm);
        Self { kind, world_from_unit: DAffine3 { matrix3, translation: center_mm } }
    }

    /// Its middle.
    pub fn center_mm(&self) -> DVec3 {
        self.world_from_unit.translation
    }

    /// The selection of a grid's voxels in it. A voxel that its border cuts belongs to it in part: in a box exactly as far as
    /// it lies in where the box is parallel to the grid, in an ellipsoid as if the border were straight within the voxel.
    ///
    /// # Errors
    /// [`Error::Scene`] if the shape has no volume or is not finite, or the limits are of another grid;
    /// [`Error::Cancelled`] on request.
    pub fn select(
        &self,
        grid: &Grid,
        limits: &Limits,
        pool: &Arc<BrickPool>,
        progress: &Progress,
    ) -> Result<Selection> {
        limits.check(grid).map_err(|what| Error::scene(what, "resample one of them"))?;
        let determinant = self.world_from_unit.matrix3.determinant();
        if !(self.world_from_unit.is_finite() && determinant.abs() > 0.0) {
            return Err(Error::scene("the shape has no volume", "give it sizes above 0 mm"));
        }
        let on_grid = OnGrid::new(self, grid);
        let dims = grid.dims();
        let places = places(on_grid.bounds(dims));
        progress.begin("selecting", places.len() as u64);
        let mut selection = filled(*grid, pool, places, progress, |place| {
            let middle = point(place.map(|n| n * BRICK)) + 0.5 * (BRICK as f64 - 1.0);
            match on_grid.whole_brick(middle) {
                Some(value) => Filling::Uniform(value),
                None => Filling::Voxels(voxels_of(place, dims, |voxel| quantized(on_grid.membership(point(voxel))))),
            }
        })?;
        selection.limit(limits);
        if limits.connected {
            selection.keep_connected_to(grid.index_from_world().transform_point3(self.center_mm()), progress)?;
        }
        Ok(selection)
    }
}

/// A shape as the voxels of a grid see it.
struct OnGrid {
    kind: Kind,
    unit_from_index: DAffine3,
    index_from_unit: DAffine3,
    /// The most that a voxel can be in: that of a shape smaller than a voxel.
    most: f64,
}

impl OnGrid {
    fn new(shape: &Shape, grid: &Grid) -> Self {
        let index_from_unit = grid.index_from_world() * shape.world_from_unit;
        let unit_volume = if shape.kind == Kind::Cuboid { 8.0 } else { 4.0 / 3.0 * std::f64::consts::PI };
        Self {
            kind: shape.kind,
            unit_from_index: index_from_unit.inverse(),
            index_from_unit,
            most: (unit_volume * index_from_unit.matrix3.determinant().abs()).min(1.0),
        }
    }

    /// Voxels with memberships above 0 lie in it.
    fn bounds(&self, dims: [usize; 3]) -> VoxelBox {
        let rows = self.index_from_unit.matrix3.transpose();
        let rows = [rows.x_axis, rows.y_axis, rows.z_axis];
        let half = DVec3::from_array(rows.map(|row| match self.kind {
            Kind::Ellipsoid => row.length(),
            Kind::Cuboid => row.abs().element_sum(),
        }));
        let middle = self.index_from_unit.translation;
        // A border is wider than a voxel's edge where it cuts the grid obliquely.
        let margin = DVec3::splat(0.9);
        voxel_box(middle - half - margin, middle + half + margin, dims)
    }

    /// The membership at a (fractional) voxel index.
    fn membership(&self, at: DVec3) -> f64 {
        let p = self.unit_from_index.transform_point3(at);
        let m = &self.unit_from_index.matrix3;
        match self.kind {
            Kind::Ellipsoid => {
                let r = p.length();
                // How much r changes across a voxel: the norm of its gradient per index.
                let width = if r > 0.0 { (m.transpose() * (p / r)).length() } else { 0.0 };
                let inside = if width > 0.0 { 0.5 + (1.0 - r) / width } else { 1.0 };
                inside.clamp(0.0, self.most)
            }
            Kind::Cuboid => {
                let rows = m.transpose();
                let rows = [rows.x_axis, rows.y_axis, rows.z_axis];
                (0..3)
                    .map(|a| {
                        let width = rows[a].length();
                        let overlap = (p[a] + 0.5 * width).min(1.0) - (p[a] - 0.5 * width).max(-1.0);
                        (overlap / width).clamp(0.0, 1.0)
                    })
                    .product()
            }
        }
    }

    /// The membership of all voxels of a brick around `middle`, if they surely have the same.
    fn whole_brick(&self, middle: DVec3) -> Option<u8> {
        // To the farthest voxel, and as far as that reaches.
        let reach = 0.5 * BRICK as f64 + 0.5;
        let p = self.unit_from_index.transform_point3(middle);
        let m = &self.unit_from_index.matrix3;
        let corners = (0..8).map(|i| {
            let sign = DVec3::from_array(std::array::from_fn(|a| if i >> a & 1 == 0 { -reach } else { reach }));
            p + *m * sign
        });
        match self.kind {
            // Convex: all corners in, all in.
            Kind::Ellipsoid => corners.map(|c| c.length()).all(|r| r <= 1.0).then_some(255),
            Kind::Cuboid => corners.map(|c| c.abs().max_element()).all(|c| c <= 1.0).then_some(255),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(dims: [usize; 3], spacing: [f64; 3], shear: f64) -> Grid {
        let mut matrix3 = DMat3::from_diagonal(DVec3::from_array(spacing));
        matrix3.z_axis.y = shear * spacing[2];
        Grid::new(dims, DAffine3 { matrix3, translation: DVec3::new(-20.0, 5.0, 3.0) }).unwrap()
    }

    fn select(shape: &Shape, grid: &Grid) -> Selection {
        shape.select(grid, &Limits::default(), &Arc::default(), &Progress::new()).unwrap()
    }

    #[test]
    fn volumes_are_those_of_geometry() {
        let turned = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(0.4);
        for (dims, spacing, shear) in [
            ([64, 64, 64], [1.0, 1.0, 1.0], 0.0),
            ([128, 100, 40], [0.5, 0.7, 2.0], 0.0),
            ([90, 90, 60], [0.8, 0.8, 1.5], 0.3),
        ] {
            let grid = grid(dims, spacing, shear);
            let center = grid.world_from_index().transform_point3(point(dims.map(|n| n / 2)) + 0.3);
            let volume = |shape: Shape| select(&shape, &grid).volume_ml() * 1000.0;
            let near = |got: f64, expected: f64| {
                assert!((got / expected - 1.0).abs() < 0.01, "{got} for {expected}, spacing {spacing:?}");
            };
            let pi = std::f64::consts::PI;
            near(volume(Shape::ball(center, 14.0)), 4.0 / 3.0 * pi * 14.0_f64.powi(3));
            near(
                volume(Shape::ellipsoid(center, DVec3::new(6.0, 9.0, 14.0), turned)),
                4.0 / 3.0 * pi * 6.0 * 9.0 * 14.0,
            );
            near(volume(Shape::cuboid(center, DVec3::new(11.3, 17.1, 13.7), DMat3::IDENTITY)), 11.3 * 17.1 * 13.7);
            near(volume(Shape::cuboid(center, DVec3::new(11.0, 17.0, 13.0), turned)), 11.0 * 17.0 * 13.0);
        }
    }

    #[test]
    fn an_upright_box_is_exact_to_a_step_of_the_memberships() {
        let grid = grid([20, 20, 20], [1.0; 3], 0.0);
        let low = grid.world_from_index().transform_point3(DVec3::new(3.25, 4.5, 6.0));
        let selection =
            select(&Shape::cuboid(low + DVec3::new(2.0, 1.0, 0.2), DVec3::new(4.0, 2.0, 0.4), DMat3::IDENTITY), &grid);
        // From 3.25 to 7.25, 4.5 to 6.5, 6 to 6.4: a slice thinner than a voxel.
        assert_eq!(selection.bounds(), Some([[3, 8], [5, 7], [6, 7]]));
        assert_eq!(selection.get([3, 5, 6]), quantized(0.25 * 0.4));
        assert_eq!(selection.get([5, 6, 6]), quantized(0.4));
        assert_eq!(selection.get([7, 6, 6]), quantized(0.75 * 0.4));
    }

    #[test]
    fn shapes_outside_of_the_grid_and_shapes_of_nothing() {
        let grid = grid([9, 9, 9], [1.0; 3], 0.0);
        assert!(select(&Shape::ball(DVec3::splat(1e9), 4.0), &grid).is_empty());
        let all = select(&Shape::ball(DVec3::ZERO, 1e6), &grid);
        assert_eq!((all.num_voxels(), all.bounds()), (729.0, Some([[0, 9]; 3])));
        for bad in
            [Shape::ball(DVec3::ZERO, 0.0), Shape::ball(DVec3::NAN, 4.0), Shape::ball(DVec3::ZERO, f64::INFINITY)]
        {
            let error = bad.select(&grid, &Limits::default(), &Arc::default(), &Progress::new()).unwrap_err();
            assert!(error.to_string().contains("no volume"), "{error}");
        }
        // Smaller than a voxel: as much of it as it is.
        let tiny = select(&Shape::ball(grid.world_from_index().transform_point3(DVec3::splat(4.0)), 0.3), &grid);
        assert!((tiny.num_voxels() - 0.113).abs() < 0.01, "{}", tiny.num_voxels());
    }

    #[test]
    fn whole_bricks_are_what_their_voxels_would_be() {
        let grid = grid([60, 50, 44], [0.9, 1.1, 1.3], 0.2);
        let turned = DMat3::from_rotation_y(0.5);
        let center = grid.world_from_index().transform_point3(DVec3::new(30.0, 24.0, 20.0));
        for shape in [Shape::ball(center, 21.0), Shape::cuboid(center, DVec3::new(40.0, 35.0, 42.0), turned)] {
            let selection = select(&shape, &grid);
            let on_grid = OnGrid::new(&shape, &grid);
            for i in 0..grid.num_voxels() {
                let voxel = [i % 60, i / 60 % 50, i / 3000];
                assert_eq!(selection.get(voxel), quantized(on_grid.membership(point(voxel))), "{voxel:?}");
            }
        }
    }
}
