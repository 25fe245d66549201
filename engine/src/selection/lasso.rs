//! What a polygon on the screen encloses: through everything, or down to a depth.

use std::sync::Arc;

use glam::{DMat4, DVec2, DVec3};

use super::fill::{Filling, filled, places, point, quantized, voxels_of};
use super::{BRICK, BrickPool, Limits, Selection};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;

/// Where a point of the world, RAS mm, is seen: x and y in pixels, and its depth in any unit; nothing if it cannot be (behind the
/// eye). Straight lines must be seen as such, as in perspective and parallel views.
pub type ScreenFromWorld<'a> = dyn Fn(DVec3) -> Option<DVec3> + Sync + 'a;

/// The depths that are selected at a pixel, from the nearest to the farthest; nothing where nothing is.
pub type DepthRange<'a> = dyn Fn(DVec2) -> Option<[f64; 2]> + Sync + 'a;

/// The view of a matrix in homogeneous coordinates: x / w and y / w are pixels, z / w is the depth; w ≤ 0 is behind the eye.
pub fn projection(screen_from_world: DMat4) -> impl Fn(DVec3) -> Option<DVec3> + Sync {
    move |at| {
        let p = screen_from_world * at.extend(1.0);
        (p.w > 0.0).then(|| p.truncate() / p.w)
    }
}

/// A polygon on the screen, closed by itself, in a view.
pub struct Lasso<'a> {
    /// Its corners in pixels, at least three. Where it crosses itself, all that it goes around (with a winding number other than
    /// 0) is inside.
    pub polygon: Vec<DVec2>,
    /// The view.
    pub screen_from_world: &'a ScreenFromWorld<'a>,
    /// Restricts what it takes, for a first surface; nothing: through everything.
    pub depth: Option<&'a DepthRange<'a>>,
}

impl Lasso<'_> {
    /// The voxels of a grid whose middles are seen inside, with a border as wide as a voxel is seen. Depths are cut crisply.
    ///
    /// # Errors
    /// [`Error::Scene`] if the polygon has no area or is not finite, or the limits are of another grid;
    /// [`Error::Cancelled`] on request.
    pub fn select(
        &self,
        grid: &Grid,
        limits: &Limits,
        pool: &Arc<BrickPool>,
        progress: &Progress,
    ) -> Result<Selection> {
        limits.check(grid).map_err(|what| Error::scene(what, "resample one of them"))?;
        let map = DistanceMap::new(&self.polygon)
            .ok_or_else(|| Error::scene("the lasso encloses nothing", "draw it around something"))?;
        let dims = grid.dims();
        let places = places(dims.map(|n| [0, n]));
        progress.begin("selecting", places.len() as u64);
        let seen = |at: DVec3| (self.screen_from_world)(grid.world_from_index().transform_point3(at));
        let mut selection = filled(*grid, pool, places, progress, |place| {
            let middle = point(place.map(|n| n * BRICK)) + 0.5 * (BRICK as f64 - 1.0);
            // To the corners of the outer voxels, which is farther than any middle.
            let reach = 0.5 * BRICK as f64;
            let corners = (0..8).map(|i| {
                let sign = |a: usize| if i >> a & 1 == 0 { -reach } else { reach };
                seen(middle + DVec3::new(sign(0), sign(1), sign(2)))
            });
            let corners: Option<Vec<DVec3>> = corners.collect();
            let mut width = None;
            if let (Some(corners), Some(center)) = (corners, seen(middle)) {
                let radius = corners.iter().map(|c| (*c - center).truncate().length()).fold(0.0, f64::max);
                let brick_width = self.width(&seen, middle);
                let inside = map.inside(center.truncate());
                if inside < -radius - brick_width {
                    return Filling::Uniform(0);
                }
                if inside > radius + brick_width && self.depth.is_none() {
                    return Filling::Uniform(255);
                }
                // It changes little across a brick in front of the eye; near the eye it is found for each voxel.
                width = Some(brick_width).filter(|_| radius < 64.0);
            }
            Filling::Voxels(voxels_of(place, dims, |voxel| {
                let at = point(voxel);
                let Some(pixel) = seen(at) else { return 0 };
                let is_in_depth = self.depth.is_none_or(|depth| {
                    depth(pixel.truncate()).is_some_and(|[near, far]| (near..=far).contains(&pixel.z))
                });
                if !is_in_depth {
                    return 0;
                }
                let width = width.unwrap_or_else(|| self.width(&seen, at));
                quantized(0.5 + map.inside(pixel.truncate()) / width)
            }))
        })?;
        selection.limit(limits);
        Ok(selection)
    }

    /// How wide a voxel is seen there, in pixels, over all directions of the screen.
    fn width(&self, seen: &impl Fn(DVec3) -> Option<DVec3>, at: DVec3) -> f64 {
        let Some(here) = seen(at) else { return 1.0 };
        let edges = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            // Half forward and, if that leads behind the eye, back.
            let step = seen(at + 0.5 * axis).or_else(|| seen(at - 0.5 * axis)).unwrap_or(here);
            4.0 * (step - here).truncate().length_squared()
        });
        (edges.iter().sum::<f64>() * 0.5).sqrt().max(1e-9)
    }
}

/// How far inside a polygon pixels lie: exactly near its border, and as far as that elsewhere.
struct DistanceMap {
    /// Pixel of the first cell's middle, and pixels per cell.
    origin: DVec2,
    cell: f64,
    size: [usize; 2],
    /// Inside above 0, in pixels; x fastest.
    inside: Vec<f32>,
    /// The largest distance that is told, in pixels.
    most: f64,
}

/// Cells along the longer side of a polygon, at most.
const MAX_CELLS: f64 = 1500.0;

/// Cells beside an edge in which its distance is known.
const BAND: f64 = 40.0;

impl DistanceMap {
    /// Nothing if the polygon has no area.
    fn new(polygon: &[DVec2]) -> Option<Self> {
        if polygon.len() < 3 || polygon.iter().any(|p| !(p.is_finite() && p.abs().max_element() < 1e9)) {
            return None;
        }
        let low = polygon.iter().copied().reduce(DVec2::min)?;
        let high = polygon.iter().copied().reduce(DVec2::max)?;
        let extent = (high - low).max_element();
        if extent <= 0.0 {
            return None;
        }
        // Small polygons are looked at more closely than in pixels.
        let cell = (extent / MAX_CELLS).max((extent / 200.0).min(1.0));
        let margin = BAND + 2.0;
        let origin = low - margin * cell;
        let size = ((high - low) / cell).to_array().map(|n| n.ceil() as usize + 2 * margin as usize + 1);
        let mut map = Self { origin, cell, size, inside: Vec::new(), most: BAND * cell };
        map.inside = vec![map.most as f32; size[0] * size[1]];
        let edges = || polygon.iter().zip(polygon.iter().cycle().skip(1)).filter(|(a, b)| a != b);
        for (a, b) in edges() {
            map.near_edge(*a, *b);
        }
        let mut has_area = false;
        for y in 0..size[1] {
            let at = origin.y + y as f64 * cell;
            // Where the row of cells crosses edges, and which way they go.
            let mut crossings: Vec<(f64, i32)> = edges()
                .filter(|(a, b)| (a.y <= at) != (b.y <= at))
                .map(|(a, b)| (a.x + (at - a.y) / (b.y - a.y) * (b.x - a.x), if a.y < b.y { 1 } else { -1 }))
                .collect();
            crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (mut winding, mut next) = (0, 0);
            for x in 0..size[0] {
                let pixel = origin.x + x as f64 * cell;
                while next < crossings.len() && crossings[next].0 <= pixel {
                    winding += crossings[next].1;
                    next += 1;
                }
                let value = &mut map.inside[x + size[0] * y];
                if winding == 0 {
                    *value = -*value;
                } else {
                    has_area = true;
                }
            }
        }
        has_area.then_some(map)
    }

    /// Lowers the distances beside an edge to that.
    fn near_edge(&mut self, a: DVec2, b: DVec2) {
        let along = b - a;
        let length_squared = along.length_squared();
        // Row by row, in the part of the row that the edge with its band can cover.
        let rows = |y: f64| ((y - self.origin.y) / self.cell).round();
        let first = (rows(a.y.min(b.y)) - BAND).max(0.0) as usize;
        let last = (rows(a.y.max(b.y)) + BAND).max(0.0) as usize;
        for y in first..=last.min(self.size[1] - 1) {
            let at = self.origin.y + y as f64 * self.cell;
            // The piece of the edge whose points lie within the band above and below the row.
            let t = |y: f64| if along.y == 0.0 { 0.0 } else { (y - a.y) / along.y };
            let (mut from, mut to) = (t(at - self.most), t(at + self.most));
            if along.y == 0.0 {
                (from, to) = (0.0, 1.0);
            } else if from > to {
                (from, to) = (to, from);
            }
            let (p, q) = (a + from.clamp(0.0, 1.0) * along, a + to.clamp(0.0, 1.0) * along);
            let column = |x: f64| ((x - self.origin.x) / self.cell).round();
            let left = (column(p.x.min(q.x)) - BAND).max(0.0) as usize;
            let right = ((column(p.x.max(q.x)) + BAND).max(0.0) as usize).min(self.size[0] - 1);
            for x in left..=right {
                let pixel = self.origin + DVec2::new(x as f64, y as f64) * self.cell;
                let t = ((pixel - a).dot(along) / length_squared).clamp(0.0, 1.0);
                let distance = (pixel - (a + t * along)).length() as f32;
                let value = &mut self.inside[x + self.size[0] * y];
                *value = value.min(distance);
            }
        }
    }

    /// How far inside a pixel lies, interpolated; below 0 outside.
    fn inside(&self, pixel: DVec2) -> f64 {
        let at = (pixel - self.origin) / self.cell;
        let is_on = at.x >= 0.0 && at.y >= 0.0 && at.x < (self.size[0] - 1) as f64 && at.y < (self.size[1] - 1) as f64;
        if !is_on {
            // As far from the map's middle part as from the nearest edge, at least.
            let size = DVec2::new((self.size[0] - 1) as f64, (self.size[1] - 1) as f64);
            let beyond = (at - at.clamp(DVec2::ZERO, size)).length() * self.cell;
            return if beyond.is_finite() { -(self.most + beyond) } else { f64::NEG_INFINITY };
        }
        let first = at.floor();
        let weight = at - first;
        let [x, y] = [first.x as usize, first.y as usize];
        let value = |x: usize, y: usize| f64::from(self.inside[x + self.size[0] * y]);
        let row = |y: usize| value(x, y) * (1.0 - weight.x) + value(x + 1, y) * weight.x;
        row(y) * (1.0 - weight.y) + row(y + 1) * weight.y
    }
}

#[cfg(test)]
mod tests;
