//! The brush: on the surface that is seen in the figure, in the plane of a slice; a ball of voxels wherever it goes.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use eframe::egui::{self, Align2, Color32, FontId, Pos2, Shape, Stroke as Line, Vec2};
use fabrica_engine::selection::{Brush as Round, BrushMode, Profile, Stroke};
use glam::DVec3;

use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::target::{Target, stroke};
use super::view::{Place, View};
use super::{Hand, Settings, shorter_mm};

/// What a frame may take for dabs; the way of the hand that is left is for the next.
const BUDGET: Duration = Duration::from_millis(10);

/// The brush's own state.
#[derive(Default)]
pub struct Brush {
    stroke: Option<Painting>,
    /// Where a drag began that changes the radius, and the radius there.
    resizing: Option<(Pos2, f64, f64)>,
    /// The surface under the pointer as it was found last.
    under: Option<(Pos2, Option<Place>)>,
    /// Which way the surface faces there, if it is even enough to tell: a unit vector.
    normal: Option<DVec3>,
}

struct Painting {
    stroke: Stroke,
    target: Target,
    view: View,
    erases: bool,
    radius_mm: f64,
    /// Positions of the pointer that are still to be painted at.
    way: VecDeque<Pos2>,
    last_at: Pos2,
    last: Option<Place>,
    is_released: bool,
}

impl Brush {
    /// Whether a stroke is under way, or its last dabs.
    pub fn is_busy(&self) -> bool {
        self.stroke.is_some()
    }

    /// Gives the stroke up; the document goes back by itself.
    pub fn abort(&mut self) {
        (self.stroke, self.resizing) = (None, None);
    }

    /// Follows the hand. A sentence if there is something to say.
    pub fn follow(
        &mut self,
        hands: &[Hand],
        view: Option<&View>,
        open: &mut OpenFigure,
        settings: &mut Settings,
    ) -> Option<String> {
        let mut said = None;
        if self.stroke.is_some() && !open.document.in_gesture() {
            self.abort();
        }
        for hand in hands {
            match *hand {
                Hand::Pressed { at, shift, alt } => {
                    let Some(view) = view else { continue };
                    self.finish(open);
                    if shift {
                        let place = view.place(at).map(|place| (place.seen_mm, place.scale));
                        let place = place.or_else(|| middle(open).map(|middle| (middle, 1.0)));
                        let mm_per_point = place.map_or(1.0, |(place, scale)| view.mm_per_point(place) / scale);
                        self.resizing = Some((at, settings.radius_mm(open), mm_per_point));
                    } else {
                        said = self.begin(at, view, open, settings, alt).err();
                    }
                }
                Hand::Moved(at) => {
                    if let Some((from, radius, mm_per_point)) = self.resizing {
                        settings.set_radius_mm(open, radius + f64::from(at.x - from.x) * mm_per_point);
                    } else if let Some(painting) = &mut self.stroke {
                        painting.go_on(at);
                    }
                }
                Hand::Released => {
                    self.resizing = None;
                    if let Some(painting) = &mut self.stroke {
                        painting.is_released = true;
                    }
                }
            }
        }
        if let Some(painting) = &mut self.stroke {
            painting.paint(open, Instant::now() + BUDGET);
            if painting.is_released && painting.way.is_empty() {
                said = said.or(self.finish(open));
            }
        }
        said
    }

    fn begin(
        &mut self,
        at: Pos2,
        view: &View,
        open: &mut OpenFigure,
        settings: &Settings,
        alt: bool,
    ) -> Result<(), String> {
        let target = Target::of(open, &settings.target)?;
        let erases = settings.erases() != alt;
        let radius_mm = settings.radius_mm(open);
        let brush = Round {
            radius_mm,
            profile: if settings.is_soft { Profile::Soft } else { Profile::Hard },
            strength: 1.0,
            mode: if erases { BrushMode::Erase } else { BrushMode::Paint },
        };
        let stroke = Stroke::new(&target.before, brush, settings.limits(open, &target.volume, view))?;
        open.document.begin();
        let (way, view) = (VecDeque::from([at]), view.clone());
        let (last_at, last, is_released) = (at, None, false);
        self.stroke = Some(Painting { stroke, target, view, erases, radius_mm, way, last_at, last, is_released });
        Ok(())
    }

    /// Ends a stroke: one step, if it changed anything.
    fn finish(&mut self, open: &mut OpenFigure) -> Option<String> {
        let mut painting = self.stroke.take()?;
        painting.paint(open, Instant::now() + Duration::from_secs(1));
        open.document.commit();
        let is_same = painting.stroke.selection().changed_since(&painting.target.before).is_empty();
        match (is_same, painting.last, painting.erases) {
            (false, ..) => None,
            (true, None, _) => Some("There is nothing to paint on".to_owned()),
            (true, Some(_), true) => Some("Nothing of the selection was there".to_owned()),
            (true, Some(_), false) => Some("Nothing new to paint there, within the limits in the bar".to_owned()),
        }
    }

    /// The disc at the pointer, with its radius.
    pub fn cursor(&mut self, painter: &egui::Painter, at: Pos2, view: &View, radius_mm: f64, erases: bool) {
        let at = self.resizing.map_or(at, |(from, ..)| from);
        if self.stroke.is_none() && self.under.is_none_or(|(of, _)| of != at) {
            let place = view.place(at);
            self.under = Some((at, place));
            self.normal = place.and_then(|place| normal(view, at, place.seen_mm, place.scale * radius_mm));
        }
        let place = match &self.stroke {
            Some(painting) => painting.last,
            None => self.under.and_then(|(_, place)| place),
        };
        // As large as it is where it was moved to.
        let shown_mm = place.map_or(radius_mm, |place| place.scale * radius_mm);
        let place = place.map(|place| place.seen_mm);
        let (radius, is_on) = match place {
            Some(place) => ((shown_mm / view.mm_per_point(place)) as f32, true),
            None => (12.0, false),
        };
        let radius = radius.clamp(1.5, 4000.0);
        let round = |angle: f32| at + radius * Vec2::angled(angle);
        let tangents = self.normal.filter(|_| place.is_some()).map(DVec3::any_orthonormal_pair);
        let on_surface = |angle: f32| {
            let ((u, v), center) = tangents.zip(place)?;
            let (sin, cos) = f64::from(angle).sin_cos();
            // The disc is where the pointer is, even if what was found lies a part of a pixel beside it.
            Some(at + (view.position(center + shown_mm * (cos * u + sin * v))? - view.position(center)?))
        };
        let circle: Vec<Pos2> = (0..=96)
            .map(|i| i as f32 / 96.0 * std::f32::consts::TAU)
            .map(|angle| on_surface(angle).unwrap_or_else(|| round(angle)))
            .collect();
        let color = if erases { Color32::from_rgb(0xd5, 0x5e, 0x00) } else { theme::GIZMO };
        for (width, color) in [(3.5, Color32::WHITE), (1.5, color)] {
            let line = Line::new(width, color);
            if is_on {
                painter.add(Shape::closed_line(circle[..96].to_vec(), line));
            } else {
                painter.extend(Shape::dashed_line(&circle, line, 3.0, 4.0));
            }
        }
        painter.circle_filled(at, 1.5, color);
        if self.resizing.is_some() {
            let text = format!("{} mm", shorter_mm(radius_mm));
            super::tell(painter, at + Vec2::new(radius + 8.0, 0.0), &text);
        } else if erases {
            painter.text(
                at + Vec2::splat(0.75 * radius + 3.0),
                Align2::LEFT_TOP,
                "\u{2212}",
                FontId::proportional(16.0),
                color,
            );
        }
    }

    /// What is under the pointer may be another surface now.
    pub fn forget_surface(&mut self) {
        self.under = None;
    }
}

impl Painting {
    /// Goes on to a position: past others, so that a fast hand leaves no gaps on curved surfaces.
    fn go_on(&mut self, at: Pos2) {
        let radius =
            self.last.map_or(8.0, |place| place.scale * self.radius_mm / self.view.mm_per_point(place.seen_mm));
        let step = (0.35 * radius as f32).clamp(2.0, 24.0);
        let way = at - self.last_at;
        let num = (way.length() / step).ceil().max(1.0) as usize;
        self.way.extend((1..=num).map(|i| self.last_at + way * (i as f32 / num as f32)));
        self.last_at = at;
    }

    /// Paints what is left of the way until a time.
    fn paint(&mut self, open: &mut OpenFigure, until: Instant) {
        let mut has_changed = false;
        while let Some(at) = self.way.pop_front() {
            match self.view.place(at) {
                None => self.stroke.lift(),
                Some(place) => {
                    // From a near surface to a far one the brush is lifted, and does not dig.
                    if self.last.is_some_and(|last| last.rest_mm.distance(place.rest_mm) > 1.5 * self.radius_mm + 1e-9)
                        && matches!(self.view, View::Figure(_))
                    {
                        self.stroke.lift();
                    }
                    has_changed |= !self.stroke.dab_to(place.rest_mm).is_empty();
                    self.last = Some(place);
                }
            }
            if Instant::now() > until {
                break;
            }
        }
        if has_changed {
            self.target.add(open);
            let now = self.stroke.selection().clone();
            let num_voxels = now.num_voxels() - self.target.before.num_voxels();
            let label = stroke(&self.target.title, self.erases, num_voxels);
            self.target.set(open, now, label);
        }
    }
}

/// Which way the surface at a place faces, as seen from half a radius around it; none in slices and where it is too uneven.
fn normal(view: &View, at: Pos2, place: DVec3, radius_mm: f64) -> Option<DVec3> {
    if matches!(view, View::Slice(..)) {
        return None;
    }
    let mm_per_point = view.mm_per_point(place);
    let by = (0.5 * radius_mm / mm_per_point).clamp(4.0, 30.0) as f32;
    // Behind an edge lies something else.
    let near = |by: Vec2| {
        view.place(at + by)
            .map(|p| p.seen_mm)
            .filter(|p| p.distance(place) < 4.0 * f64::from(by.length()) * mm_per_point)
    };
    let along = |by: Vec2| Some((near(by)? - near(-by)?).normalize_or_zero());
    let normal = along(Vec2::new(by, 0.0))?.cross(along(Vec2::new(0.0, by))?).try_normalize()?;
    (normal.dot(view.direction(place)).abs() > 0.2).then_some(normal)
}

/// The middle of the volume.
fn middle(open: &OpenFigure) -> Option<DVec3> {
    let grid = &open.chosen_volume()?.grid;
    let (low, high) = grid.index_box();
    Some(grid.world_from_index().transform_point3(0.5 * (low + high)))
}
