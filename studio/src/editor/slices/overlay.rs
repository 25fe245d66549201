//! Selections over slices: each in the color of its region, with an outline.

use std::sync::Arc;

use fabrica_engine::selection::{Selection, VoxelBox};
use fabrica_engine::slice::{Field, Plane, Tint, lay_over};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::Volume;
use glam::{DAffine3, DVec3};

use super::super::open_figure::OpenFigure;
use crate::figure::sources::Selections;
use crate::figure::template;

/// How much of a slice a selection covers within its outline.
const OPACITY: f64 = 0.3;

/// The structures of a region with their colors, sRGB.
#[derive(Clone)]
pub struct Overlay {
    selections: Arc<Selections>,
    /// As many as there are structures; none: not of this region.
    colors: Vec<Option<[u8; 3]>>,
}

impl PartialEq for Overlay {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.selections, &other.selections) && self.colors == other.colors
    }
}

/// What the regions of the chosen object select of a volume.
pub fn of(open: &OpenFigure, volume: &Volume) -> Vec<Overlay> {
    let Some(object) = open.chosen() else { return Vec::new() };
    let slots = &open.document.figure().selections;
    let regions = object.regions.iter().filter_map(|region| {
        let slot = slots.iter().find(|slot| slot.name == region.selection)?;
        let selections = open.selections_of(slot)?.clone();
        let colors = selections.structures.iter().map(|structure| {
            if region.structure.as_ref().is_some_and(|wanted| !template::is_called(&structure.label, wanted)) {
                return None;
            }
            let is_here = structure.selection.grid().dims() == volume.grid.dims();
            is_here.then(|| match region.look_at(Some(&region.called(&structure.label))).tint {
                Some(template::Tint::Color(color)) => color,
                _ => structure.label.color,
            })
        });
        let colors = colors.collect();
        Some(Overlay { selections, colors })
    });
    regions.collect()
}

/// Lays them over a slice's pixels.
pub fn lay(pixels: &mut [[u8; 4]], plane: &Plane, overlays: &[Overlay]) {
    for overlay in overlays {
        for (structure, color) in overlay.selections.structures.iter().zip(&overlay.colors) {
            if let Some(color) = color {
                lay_one(pixels, plane, &structure.selection, *color);
            }
        }
    }
}

/// Costs the pixels that the selection may cover.
fn lay_one(pixels: &mut [[u8; 4]], plane: &Plane, selection: &Selection, color: [u8; 3]) {
    let Some(voxels) = voxels_on(plane, selection) else { return };
    let [low, high] = [0, 1].map(|end| DVec3::from_array(voxels.map(|range| range[end] as f64)) - 0.5);
    let corners = selection.grid().box_corners_mm(low, high);
    let along = |axis: DVec3, of: DVec3| (of - plane.origin_mm).dot(axis) / axis.length_squared();
    let range = |axis: DVec3, n: usize| {
        let at = || corners.iter().map(|corner| along(axis, *corner));
        let from = at().fold(f64::INFINITY, f64::min).floor().max(0.0) as usize;
        let to = (at().fold(f64::NEG_INFINITY, f64::max).ceil() + 1.0).clamp(0.0, n as f64) as usize;
        from..to.max(from)
    };
    let (columns, rows) = (range(plane.right_mm, plane.size[0]), range(plane.down_mm, plane.size[1]));
    let size = [columns.len(), rows.len()];
    if size.contains(&0) {
        return;
    }
    let origin_mm = plane.at(columns.start as f64, rows.start as f64);
    let part = Plane { origin_mm, size, ..*plane };
    let row = |y: usize| plane.size[0] * y + columns.start..plane.size[0] * y + columns.end;
    let mut picture: Vec<[u8; 4]> = rows.clone().flat_map(|y| pixels[row(y)].iter().copied()).collect();
    let first = DVec3::from_array(voxels.map(|range| range[0] as f64));
    let Ok(grid) = Grid::new(
        voxels.map(|[from, to]| to - from),
        selection.grid().world_from_index() * DAffine3::from_translation(first),
    ) else {
        return;
    };
    let values = selection.values(voxels);
    let tint = Tint { color, opacity: OPACITY, outlined: true };
    lay_over(&mut picture, &part, Field { grid: &grid, voxels: &values }, tint);
    for (y, line) in rows.zip(picture.chunks(size[0])) {
        pixels[row(y)].copy_from_slice(line);
    }
}

/// The voxels whose memberships a slice may show, with those beside them; none if it misses the selection.
fn voxels_on(plane: &Plane, selection: &Selection) -> Option<VoxelBox> {
    let bounds = selection.bounds()?;
    let dims = selection.grid().dims();
    let [width, height] = plane.size.map(|n| n as f64);
    let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
    let corners = corners.map(|(x, y)| selection.grid().index_from_world().transform_point3(plane.at(x, y)));
    let low = corners.into_iter().fold(DVec3::INFINITY, DVec3::min).floor() - 1.0;
    let high = corners.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max).ceil() + 2.0;
    let voxels: VoxelBox = std::array::from_fn(|a| {
        let from = (low[a].max(0.0) as usize).max(bounds[a][0].saturating_sub(1));
        let to = (high[a].max(0.0) as usize).min(bounds[a][1] + 1).min(dims[a]);
        [from, to]
    });
    voxels.iter().all(|[from, to]| from < to).then_some(voxels)
}

#[cfg(test)]
mod tests {
    use fabrica_engine::Progress;
    use fabrica_engine::selection::{BrickPool, Limits, Shape};

    use super::*;

    #[test]
    fn a_part_of_the_pixels_is_as_good_as_all() {
        let affine = DAffine3::from_scale(DVec3::new(-0.5, 0.5, 2.0));
        let grid = Grid::new([60, 50, 20], affine).unwrap();
        let shape = Shape::ball(DVec3::new(-14.0, 10.0, 19.0), 6.0);
        let pool = Arc::new(BrickPool::default());
        let ball = shape.select(&grid, &Limits::default(), &pool, &Progress::new()).unwrap();
        let dense = ball.values([[0, 60], [0, 50], [0, 20]]);
        for z in [18.0, 20.3, 27.0] {
            let plane = Plane {
                origin_mm: DVec3::new(1.0, -1.0, z),
                right_mm: DVec3::new(-0.3, 0.0, 0.0),
                down_mm: DVec3::new(0.0, 0.3, 0.0),
                size: [110, 95],
            };
            let gray = [90, 90, 90, 255];
            let (mut part, mut whole) = (vec![gray; 110 * 95], vec![gray; 110 * 95]);
            lay_one(&mut part, &plane, &ball, [255, 0, 0]);
            let tint = Tint { color: [255, 0, 0], opacity: OPACITY, outlined: true };
            lay_over(&mut whole, &plane, Field { grid: &grid, voxels: &dense }, tint);
            assert!(part == whole, "at {z} mm");
            assert_eq!(part.iter().any(|p| *p != gray), z < 26.0, "at {z} mm");
        }
    }
}
