//! Where the handles are on the screen, and which of them is under the pointer.

use std::f64::consts::TAU;

use eframe::egui::{Pos2, Rect, Vec2};
use fabrica_engine::scene::{Camera, Projection};
use glam::DVec3;

/// Lengths in points: of an arrow, of a ring's radius, and how far to the right and up the square is.
const ARM: f64 = 64.0;
pub const RING: f64 = 90.0;
const SQUARE: f32 = 78.0;
/// Half of what the hand has to hit of a point, of an arrow's shaft, and of a ring.
pub const REACH: f32 = 12.0;
const SHAFT_REACH: f32 = 8.0;
const RING_REACH: f32 = 7.0;
/// An arrow shorter than that points at the eye, or away from it.
const SHORTEST: f32 = 20.0;
/// Points of a ring.
const NUM_POINTS: usize = 96;
/// Where a ring's grip may be.
const NUM_PLACES: usize = 16;

/// What the hand holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Handle {
    /// Moves along an axis of the body: right, anterior, superior.
    Axis(usize),
    /// Moves in the picture's plane.
    Center,
    /// Turns about an axis of the body.
    Ring(usize),
    /// Scales.
    Scale,
}

impl Handle {
    /// What it is called by those who do not see it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Axis(0) => "Move right or left",
            Self::Axis(1) => "Move anterior or posterior",
            Self::Axis(_) => "Move superior or inferior",
            Self::Center => "Move in the picture's plane",
            Self::Ring(0) => "Turn about the axis right",
            Self::Ring(1) => "Turn about the axis anterior",
            Self::Ring(_) => "Turn about the axis superior",
            Self::Scale => "Scale about its middle",
        }
    }
}

/// A picture's place on the screen, and the camera that it is seen with.
#[derive(Clone, Debug)]
pub struct Sight {
    /// The camera.
    pub camera: Camera,
    /// In points.
    pub frame: Rect,
}

impl Sight {
    fn height(&self) -> f64 {
        f64::from(self.frame.height().max(1.0))
    }

    /// Where a place (world, mm) is seen; none behind the eye.
    pub fn seen(&self, place_mm: DVec3) -> Option<Pos2> {
        let from_eye = place_mm - self.camera.eye_mm;
        let depth = match self.camera.projection {
            Projection::Perspective { .. } => from_eye.dot(self.camera.forward),
            Projection::Orthographic { .. } => 1.0,
        };
        let scale = self.height() / (2.0 * self.camera.half_height() * depth);
        let at = [from_eye.dot(self.camera.right), -from_eye.dot(self.camera.up)].map(|n| (n * scale) as f32);
        let at = self.frame.center() + Vec2::new(at[0], at[1]);
        (depth > 0.0 && at.is_finite()).then_some(at)
    }

    /// The ray through a position: origin (mm) and direction, which is no unit vector.
    fn ray(&self, at: Pos2) -> (DVec3, DVec3) {
        let from_middle = at - self.frame.center();
        let [x, y] = [from_middle.x, -from_middle.y].map(|n| f64::from(n) / self.height());
        let across = 2.0 * self.camera.half_height() * (x * self.camera.right + y * self.camera.up);
        match self.camera.projection {
            Projection::Perspective { .. } => (self.camera.eye_mm, self.camera.forward + across),
            Projection::Orthographic { .. } => (self.camera.eye_mm + across, self.camera.forward),
        }
    }

    /// Which way one looks at a place: a unit vector.
    pub fn direction(&self, place_mm: DVec3) -> DVec3 {
        match self.camera.projection {
            Projection::Perspective { .. } => (place_mm - self.camera.eye_mm).normalize_or_zero(),
            Projection::Orthographic { .. } => self.camera.forward,
        }
    }

    /// What of a plane is seen at a position; none where one looks along it, or away from it.
    pub fn on_plane(&self, at: Pos2, point_mm: DVec3, normal: DVec3) -> Option<DVec3> {
        let (origin, direction) = self.ray(at);
        let along = direction.dot(normal);
        let t = (point_mm - origin).dot(normal) / along;
        let is_before = matches!(self.camera.projection, Projection::Orthographic { .. }) || t > 0.0;
        (along.abs() > 1e-3 * direction.length() && t.is_finite() && is_before).then(|| origin + t * direction)
    }

    /// How large a point of the screen is at a place.
    pub fn mm_per_point(&self, place_mm: DVec3) -> f64 {
        let depth = match self.camera.projection {
            Projection::Perspective { .. } => (place_mm - self.camera.eye_mm).dot(self.camera.forward),
            Projection::Orthographic { .. } => 1.0,
        };
        2.0 * self.camera.half_height() * depth / self.height()
    }
}

/// A ring as it is seen, in successive pieces.
pub struct Ring {
    /// Around which axis.
    pub axis: usize,
    /// Its pieces: both ends, and whether the eye sees it before the pivot.
    pub pieces: Vec<([Pos2; 2], bool)>,
    /// Where it is held.
    pub grip: Pos2,
}

/// All handles around a place, as they are seen.
pub struct Shape {
    /// Where the place is seen that they are around.
    pub center: Pos2,
    /// Axes that do not point at the eye, with the end of each.
    pub arms: Vec<(usize, Pos2)>,
    /// The rings.
    pub rings: Vec<Ring>,
    /// The middle of the square.
    pub square: Pos2,
}

/// A point of the ring about an axis.
pub fn on_ring(axis: usize, angle: f64) -> DVec3 {
    let [u, v] = [DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]];
    angle.cos() * u + angle.sin() * v
}

impl Shape {
    /// Around a place; none behind the eye.
    pub fn new(sight: &Sight, pivot_mm: DVec3) -> Option<Self> {
        let center = sight.seen(pivot_mm)?;
        let unit_mm = sight.mm_per_point(pivot_mm);
        let at = |direction: DVec3, points: f64| sight.seen(pivot_mm + points * unit_mm * direction);
        let arm = |axis: usize| {
            let end = at(DVec3::AXES[axis], ARM)?;
            ((end - center).length() >= SHORTEST).then_some((axis, end))
        };
        let arms: Vec<(usize, Pos2)> = (0..3).filter_map(arm).collect();
        let square = center + SQUARE * Vec2::new(1.0, -1.0);
        let mut taken: Vec<Pos2> = arms.iter().map(|arm| arm.1).chain([center, square]).collect();
        let forward = sight.direction(pivot_mm);
        let mut rings = Vec::new();
        for axis in 0..3 {
            let point = |i: usize, of: usize| on_ring(axis, i as f64 / of as f64 * TAU);
            let seen: Vec<Pos2> = (0..NUM_POINTS).filter_map(|i| at(point(i, NUM_POINTS), RING)).collect();
            if seen.len() < NUM_POINTS {
                continue;
            }
            let piece = |i: usize| ([seen[i], seen[(i + 1) % NUM_POINTS]], point(i, NUM_POINTS).dot(forward) <= 0.0);
            // Where it is furthest from all others, and before them rather than behind.
            let room = |p: Pos2| taken.iter().map(|other| other.distance(p)).fold(2.5 * REACH, f32::min);
            let places = (0..NUM_PLACES).filter_map(|i| {
                let direction = point(i, NUM_PLACES);
                let place = at(direction, RING)?;
                Some((place, room(place) - 4.0 * direction.dot(forward) as f32))
            });
            let Some((grip, _)) = places.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            taken.push(grip);
            rings.push(Ring { axis, pieces: (0..NUM_POINTS).map(piece).collect(), grip });
        }
        Some(Self { center, arms, rings, square })
    }

    /// Where handles are held, those that are on top last.
    pub fn grips(&self) -> Vec<(Handle, Pos2)> {
        let rings = self.rings.iter().map(|ring| (Handle::Ring(ring.axis), ring.grip));
        let arms = self.arms.iter().map(|(axis, end)| (Handle::Axis(*axis), *end));
        rings.chain(arms).chain([(Handle::Scale, self.square), (Handle::Center, self.center)]).collect()
    }

    /// What is under a position: a grip, else a shaft, else a ring on its near side, else on its far side.
    pub fn handle_at(&self, at: Pos2) -> Option<Handle> {
        let grip = self.grips().into_iter().rev().find(|(_, grip)| grip.distance(at) <= REACH);
        let shaft = || self.arms.iter().find(|(_, end)| to_segment(at, [self.center, *end]) <= SHAFT_REACH);
        let ring = |is_near: bool| {
            let distance = |ring: &Ring| {
                let pieces = ring.pieces.iter().filter(|(_, near)| *near == is_near);
                pieces.map(|(ends, _)| to_segment(at, *ends)).fold(f32::INFINITY, f32::min)
            };
            let all = self.rings.iter().map(|ring| (ring.axis, distance(ring)));
            all.filter(|(_, d)| *d <= RING_REACH).min_by(|a, b| a.1.total_cmp(&b.1))
        };
        grip.map(|(handle, _)| handle)
            .or_else(|| shaft().map(|(axis, _)| Handle::Axis(*axis)))
            .or_else(|| ring(true).or_else(|| ring(false)).map(|(axis, _)| Handle::Ring(axis)))
    }
}

/// Distance of a position to a piece of a line.
fn to_segment(at: Pos2, [a, b]: [Pos2; 2]) -> f32 {
    let along = b - a;
    let t = ((at - a).dot(along) / along.length_sq().max(1e-9)).clamp(0.0, 1.0);
    at.distance(a + t * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sight(from: DVec3, projection: Projection) -> Sight {
        let up = if from.normalize().z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
        let camera = Camera::looking(400.0 * from.normalize(), -from, up, projection).unwrap();
        Sight { camera, frame: Rect::from_min_size(Pos2::new(50.0, 30.0), Vec2::new(800.0, 600.0)) }
    }

    const PROJECTIONS: [Projection; 2] =
        [Projection::Perspective { fov_y_deg: 30.0 }, Projection::Orthographic { height_mm: 200.0 }];

    #[test]
    fn what_is_on_a_plane_is_seen_where_it_was_found() {
        for projection in PROJECTIONS {
            let sight = sight(DVec3::new(-0.6, 0.72, 0.34), projection);
            for normal in [DVec3::X, DVec3::Y, sight.camera.forward] {
                let at = Pos2::new(300.0, 400.0);
                let place = sight.on_plane(at, DVec3::new(3.0, -8.0, 5.0), normal).unwrap();
                assert!((place - DVec3::new(3.0, -8.0, 5.0)).dot(normal).abs() < 1e-9);
                assert!(sight.seen(place).unwrap().distance(at) < 1e-3);
            }
            // Along it there is nothing to be seen of it.
            assert!(sight.on_plane(sight.frame.center(), DVec3::ZERO, sight.camera.right).is_none());
        }
    }

    #[test]
    fn handles_are_apart_and_found_from_every_side() {
        let mut sides = vec![DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z, DVec3::ONE];
        sides.extend([DVec3::new(-0.6, 0.72, 0.34), DVec3::new(1.0, 1.0, -0.4), DVec3::new(0.2, -1.0, 0.05)]);
        for (from, projection) in sides.iter().flat_map(|from| PROJECTIONS.map(|p| (*from, p))) {
            let shape = Shape::new(&sight(from, projection), DVec3::new(5.0, -3.0, 8.0)).unwrap();
            let grips = shape.grips();
            // Along an axis its arrow is none, and nothing else is missing.
            let along = from.normalize().abs().max_element() > 0.97;
            assert_eq!(grips.len(), if along { 7 } else { 8 }, "{from}");
            for (i, (handle, at)) in grips.iter().enumerate() {
                assert_eq!(shape.handle_at(*at), Some(*handle), "{from}: {handle:?}");
                for (other, place) in &grips[..i] {
                    // Targets of 24 points do not overlap.
                    assert!(place.distance(*at) >= 2.0 * REACH, "{from}: {handle:?} and {other:?}");
                }
            }
            assert_eq!(shape.handle_at(shape.center + Vec2::splat(300.0)), None);
        }
    }

    #[test]
    fn shafts_and_rings_are_held_anywhere() {
        let shape = Shape::new(&sight(DVec3::Y, PROJECTIONS[1]), DVec3::ZERO).unwrap();
        // From the front: superior is up, right on the left, and the ring about the view is a circle.
        assert_eq!(shape.handle_at(shape.center + Vec2::new(0.0, -30.0)), Some(Handle::Axis(2)));
        assert_eq!(shape.handle_at(shape.center + Vec2::new(-30.0, 3.0)), Some(Handle::Axis(0)));
        assert_eq!(shape.handle_at(shape.center + RING as f32 * Vec2::angled(2.3)), Some(Handle::Ring(1)));
        assert_eq!(shape.handle_at(shape.center + 0.6 * RING as f32 * Vec2::angled(2.3)), None);
    }
}
