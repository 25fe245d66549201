//! Where tools work: the figure, or a slice.

use std::sync::Arc;

use eframe::egui::{Pos2, Rect, Vec2};
use fabrica_engine::pick::{Pick, pick};
use fabrica_engine::scene::{Camera, Projection, Scene};
use fabrica_engine::slice::anatomical::Orientation;
use glam::DVec3;

use super::super::slices::pane::Geometry;

/// The figure as it is seen.
#[derive(Clone)]
pub struct FigureView {
    /// The picture's place, in points.
    pub frame: Rect,
    /// Pixels of the picture.
    pub size: [u32; 2],
    /// What it shows.
    pub scene: Arc<Scene>,
}

/// What is under the pointer, as a hand means it that paints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Where it is seen: world (RAS), mm.
    pub seen_mm: DVec3,
    /// Where it is in the volume: elsewhere, for a region that was moved.
    pub rest_mm: DVec3,
    /// From the eye into the picture, in the volume: a unit vector.
    pub inward: DVec3,
    /// How large a millimeter of the volume is there, mm.
    pub scale: f64,
}

/// A view that tools work in.
#[derive(Clone)]
pub enum View {
    /// The figure.
    Figure(FigureView),
    /// A slice.
    Slice(Orientation, Geometry),
}

impl FigureView {
    /// What is seen at a position of the pointer; none beside the picture, and where it shows nothing.
    fn pick(&self, at: Pos2) -> Option<Pick> {
        if !self.frame.contains(at) {
            return None;
        }
        let share = (at - self.frame.min) / self.frame.size();
        let pixel = |share: f32, n: u32| ((share * n as f32) as u32).min(n - 1);
        pick(&self.scene, self.size, pixel(share.x, self.size[0]), pixel(share.y, self.size[1]))
    }

    /// Along the view axis: how far what is seen at a position lies from the eye, mm. None as well where that was moved: what lies
    /// behind it in the volume is something else.
    pub fn depth_mm(&self, at: Pos2) -> Option<f64> {
        let camera = &self.scene.camera;
        let is_at_rest = |pick: &Pick| pick.rest_mm.distance(pick.position_mm) < 1e-6;
        let pick = self.pick(at).filter(is_at_rest)?;
        Some((pick.position_mm - camera.eye_mm).dot(camera.forward))
    }

    fn place(&self, at: Pos2) -> Option<Place> {
        let pick = self.pick(at)?;
        let camera = &self.scene.camera;
        let direction = match camera.projection {
            Projection::Perspective { .. } => (pick.position_mm - camera.eye_mm).normalize_or_zero(),
            Projection::Orthographic { .. } => camera.forward,
        };
        let region = pick.region.filter(|_| !pick.is_ghost);
        let region = region.and_then(|i| self.scene.objects.first()?.regions.get(i)?.moved());
        let (inward, scale) = region.map_or((direction, 1.0), |moved| {
            let m = moved.pose.matrix3;
            ((m.inverse() * direction).normalize_or_zero(), m.determinant().abs().cbrt())
        });
        Some(Place { seen_mm: pick.position_mm, rest_mm: pick.rest_mm, inward, scale })
    }
}

/// Where a place (RAS mm) is seen in a picture: heights of it from its middle to the right and down, and mm from the eye along
/// the view axis; none behind the eye.
fn seen(camera: &Camera, place_mm: DVec3) -> Option<DVec3> {
    let from_eye = place_mm - camera.eye_mm;
    let depth = from_eye.dot(camera.forward);
    let scale = match camera.projection {
        Projection::Perspective { .. } => depth,
        Projection::Orthographic { .. } => 1.0,
    };
    let height = 2.0 * camera.half_height() * scale;
    (scale > 0.0).then(|| DVec3::new(from_eye.dot(camera.right) / height, -from_eye.dot(camera.up) / height, depth))
}

impl View {
    /// Whether it is the same, however it is seen.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Figure(_), Self::Figure(_)) => true,
            (Self::Slice(a, _), Self::Slice(b, _)) => a == b,
            _ => false,
        }
    }

    /// The picture's place.
    pub fn rect(&self) -> Rect {
        match self {
            Self::Figure(figure) => figure.frame,
            Self::Slice(_, geometry) => geometry.rect,
        }
    }

    /// What is at a position of the pointer: in the figure the surface that is seen there; none beside it.
    pub fn place(&self, at: Pos2) -> Option<Place> {
        match self {
            Self::Figure(figure) => figure.place(at),
            Self::Slice(_, geometry) => geometry.rect.contains(at).then(|| {
                let place = geometry.place_mm(at);
                Place { seen_mm: place, rest_mm: place, inward: geometry.frame.view_direction(), scale: 1.0 }
            }),
        }
    }

    /// How large a point of the screen is at a place.
    pub fn mm_per_point(&self, place_mm: DVec3) -> f64 {
        match self {
            Self::Figure(figure) => {
                let camera = &figure.scene.camera;
                let depth = match camera.projection {
                    Projection::Perspective { .. } => (place_mm - camera.eye_mm).dot(camera.forward).max(1e-6),
                    Projection::Orthographic { .. } => 1.0,
                };
                2.0 * camera.half_height() * depth / f64::from(figure.frame.height().max(1.0))
            }
            Self::Slice(_, geometry) => geometry.mm_per_point,
        }
    }

    /// From the eye into the picture at a place: a unit vector.
    pub fn direction(&self, place_mm: DVec3) -> DVec3 {
        match self {
            Self::Figure(figure) => match figure.scene.camera.projection {
                Projection::Perspective { .. } => (place_mm - figure.scene.camera.eye_mm).normalize_or_zero(),
                Projection::Orthographic { .. } => figure.scene.camera.forward,
            },
            Self::Slice(_, geometry) => geometry.frame.view_direction(),
        }
    }

    /// Where a place is seen, in points, and how deep, mm: from the eye, or in front of (below 0) and behind the slice.
    pub fn seen(&self, place_mm: DVec3) -> Option<DVec3> {
        match self {
            Self::Figure(figure) => {
                let at = seen(&figure.scene.camera, place_mm)?;
                let (middle, height) = (figure.frame.center(), f64::from(figure.frame.height()));
                Some(DVec3::new(f64::from(middle.x) + height * at.x, f64::from(middle.y) + height * at.y, at.z))
            }
            Self::Slice(_, geometry) => {
                let at = geometry.position(place_mm);
                let depth = (place_mm - geometry.center_mm).dot(geometry.frame.view_direction());
                Some(DVec3::new(f64::from(at.x), f64::from(at.y), depth))
            }
        }
    }

    /// Where a place is seen.
    pub fn position(&self, place_mm: DVec3) -> Option<Pos2> {
        self.seen(place_mm).map(|at| Pos2::ZERO + Vec2::new(at.x as f32, at.y as f32))
    }
}
