//! Handles in the figure that move the chosen region: arrows along the axes of the body, a point in the picture's plane, rings that
//! turn, a square that scales.

mod geometry;

use eframe::egui::epaint::PathShape;
use eframe::egui::{
    self, Align2, Color32, CursorIcon, EventFilter, FontId, Key, Modifiers, Painter, PointerButton, Pos2, Rect, Sense,
    Stroke, StrokeKind, Ui, Vec2, WidgetInfo,
};
use fabrica_engine::scene::Camera;
use glam::DVec3;

pub use self::geometry::Handle;
use self::geometry::{REACH, RING, Shape, Sight, on_ring};
use super::movable::{Change, Movable};
use super::open_figure::OpenFigure;
use super::theme;
use super::tools::tell;
use super::viewport::marked;
use crate::figure::template::SCALES;

/// What Ctrl rounds to: mm, degrees, and of a scale.
const SNAP_MM: f64 = 1.0;
const SNAP_DEG: f64 = 15.0;
const SNAP_SCALE: f64 = 0.1;
/// How much slower Shift makes the hand.
const FINE: f64 = 0.1;
/// What an arrow key does: mm, degrees, factor.
const KEY_MM: f64 = 1.0;
const KEY_DEG: f64 = 5.0;
const KEY_SCALE: f64 = 1.05;
/// A ring that is seen closer to its edge than this is turned along what is seen of it.
const EDGE_ON: f64 = 0.2;

/// The handles' own state.
#[derive(Default)]
pub struct Gizmo {
    drag: Option<Drag>,
    shape: Option<Shape>,
    /// What is under the pointer.
    over: Option<Handle>,
    /// The box around what is held, while the picture is not there yet: its edges as they are seen.
    edges: Vec<[Pos2; 2]>,
    /// Where the focus is.
    focused: Option<Pos2>,
}

struct Drag {
    handle: Handle,
    /// What it holds, as it was.
    start: Movable,
    sight: Sight,
    from: Pos2,
    /// Where the pointer was, and where it would be if it had not been slowed down.
    last: Pos2,
    at: Pos2,
    /// How far a ring has been turned, degrees: beyond a full turn.
    turned_deg: f64,
    text: String,
}

impl Drag {
    /// What the pointer asks for now; none where it points at nothing.
    fn change(&mut self, snaps: bool) -> Option<Change> {
        let snap = |value: f64, to: f64| if snaps { (value / to).round() * to } else { value };
        let (sight, pivot) = (&self.sight, self.start.pivot_mm);
        match self.handle {
            Handle::Axis(axis) => {
                let along = DVec3::AXES[axis];
                // The plane through the axis that faces the eye most.
                let normal = along.cross(along.cross(sight.direction(pivot))).try_normalize()?;
                let on = |at: Pos2| sight.on_plane(at, pivot, normal);
                Some(Change::By(snap((on(self.at)? - on(self.from)?).dot(along), SNAP_MM) * along))
            }
            Handle::Center => {
                let on = |at: Pos2| sight.on_plane(at, pivot, sight.camera.forward);
                let by = on(self.at)? - on(self.from)?;
                let along = |axis: DVec3| snap(by.dot(axis), SNAP_MM) * axis;
                Some(Change::By(along(sight.camera.right) + along(sight.camera.up)))
            }
            Handle::Ring(axis) => {
                let raw = self.angle_deg(axis)?;
                // The nearest to what it was: a hand may go around several times.
                self.turned_deg = raw + 360.0 * ((self.turned_deg - raw) / 360.0).round();
                Some(Change::Turn(snap(self.turned_deg, SNAP_DEG) * DVec3::AXES[axis]))
            }
            Handle::Scale => {
                let center = sight.seen(pivot)?;
                let out = self.from - center;
                let factor = f64::from((self.at - center).dot(out) / out.length_sq().max(1.0));
                let scale = self.start.moved().scale;
                let least = if snaps { SNAP_SCALE } else { SCALES.0 };
                Some(Change::Scale(snap(scale * factor, SNAP_SCALE).clamp(least, SCALES.1) / scale))
            }
        }
    }

    /// How far the pointer has gone around an axis, right-handed, up to full turns.
    fn angle_deg(&self, axis: usize) -> Option<f64> {
        let (sight, pivot, along) = (&self.sight, self.start.pivot_mm, DVec3::AXES[axis]);
        if sight.direction(pivot).dot(along).abs() > EDGE_ON {
            let arm = |at: Pos2| Some(sight.on_plane(at, pivot, along)? - pivot);
            let (a, b) = (arm(self.from)?, arm(self.at)?);
            return Some(along.dot(a.cross(b)).atan2(a.dot(b)).to_degrees());
        }
        // Along the ring's near side, as far as a point of it that the hand holds would go.
        let unit_mm = RING * sight.mm_per_point(pivot);
        let points = (0..360).map(|i| (i, on_ring(axis, f64::from(i).to_radians())));
        let near = points.filter(|(_, p)| p.dot(sight.direction(pivot)) <= 0.0);
        let seen = near.filter_map(|(i, p)| Some((i, sight.seen(pivot + unit_mm * p)?)));
        let (held, at) = seen.min_by(|a, b| a.1.distance(self.from).total_cmp(&b.1.distance(self.from)))?;
        let next = sight.seen(pivot + unit_mm * on_ring(axis, f64::from(held + 1).to_radians()))?;
        let per_deg = next - at;
        Some(f64::from((self.at - self.from).dot(per_deg) / per_deg.length_sq().max(1e-6)))
    }
}

impl Gizmo {
    /// Whether the hand holds a handle.
    pub fn is_held(&self) -> bool {
        self.drag.is_some()
    }

    /// Whether a handle is under a position: it is then no click on the picture.
    pub fn is_at(&self, at: Pos2) -> bool {
        self.shape.as_ref().is_some_and(|shape| shape.handle_at(at).is_some())
    }

    /// Nothing is held any more.
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    /// What the hand can do, while there is something to do with it.
    pub fn hint(&self) -> Option<&'static str> {
        let held = self.drag.as_ref().map(|_| "Shift: fine · Ctrl: 1 mm, 15°, 0.1 · Esc gives the drag up");
        held.or(self
            .over
            .map(|_| "Drag: moves the region · Shift: fine · Ctrl: 1 mm, 15°, 0.1 · Arrow keys, once it has the focus"))
    }

    /// Follows the hand, in the picture that `camera` sees in `frame`; before the picture follows it.
    pub fn follow(&mut self, ui: &Ui, open: &mut OpenFigure, camera: &Camera, frame: Rect, picture: &egui::Response) {
        let Some(start) = Movable::chosen(open) else { return self.forget() };
        if self.drag.is_some() && !open.document.in_gesture() {
            // Escape took it.
            self.drag = None;
        }
        let sight = Sight { camera: *camera, frame };
        self.shape = Shape::new(&sight, start.pivot_mm);
        let Some(shape) = &self.shape else { return self.forget() };
        let pointer = ui.input(|i| i.pointer.latest_pos());
        self.over = pointer.filter(|_| picture.hovered()).and_then(|at| shape.handle_at(at));
        let (mut held, mut change) = (None, None);
        self.focused = None;
        for (handle, at) in shape.grips() {
            let rect = Rect::from_center_size(at, Vec2::splat(2.0 * REACH));
            let sense = Sense::drag() | Sense::focusable_noninteractive();
            let response = ui.interact(rect, ui.scope_id().with(handle), sense);
            response.widget_info(|| WidgetInfo::slider(true, value(handle, &start), handle.name()));
            if response.hovered() {
                self.over = Some(handle);
            }
            if response.drag_started_by(PointerButton::Primary) {
                held = Some(handle);
            }
            if response.has_focus() {
                self.focused = Some(at);
                change = change.or(by_key(ui, response.id, handle, camera));
            }
        }
        let press = ui.input(|i| i.pointer.press_origin());
        if picture.drag_started_by(PointerButton::Primary)
            && let Some(at) = press
        {
            held = held.or(shape.handle_at(at));
        }
        if let Some(change) = change.filter(|_| self.drag.is_none()) {
            start.apply(open, change);
        }
        if let (Some(handle), Some(from)) = (held, press) {
            open.document.begin();
            let (last, at, turned_deg, text) = (from, from, 0.0, String::new());
            self.drag = Some(Drag { handle, start, sight, from, last, at, turned_deg, text });
        }
        self.drag_on(ui, open);
        let held = self.drag.as_ref().and_then(|drag| Some((&drag.sight, Movable::chosen(open)?)));
        self.edges = held.map_or_else(Vec::new, |(sight, now)| {
            let seen = |[a, b]: [DVec3; 2]| Some([sight.seen(a)?, sight.seen(b)?]);
            now.edges_mm(open).into_iter().filter_map(seen).collect()
        });
        if self.drag.is_some() || self.over.is_some() {
            let icon = if self.drag.is_some() { CursorIcon::Grabbing } else { CursorIcon::Grab };
            ui.ctx().set_cursor_icon(icon);
        }
    }

    fn drag_on(&mut self, ui: &Ui, open: &mut OpenFigure) {
        let Some(drag) = &mut self.drag else { return };
        let (modifiers, now) = ui.input(|i| (i.modifiers, i.pointer.latest_pos()));
        if let Some(now) = now.filter(|now| *now != drag.last) {
            let by = now - std::mem::replace(&mut drag.last, now);
            drag.at += if modifiers.shift { FINE as f32 } else { 1.0 } * by;
        }
        if let Some(change) = drag.change(modifiers.command || modifiers.ctrl) {
            drag.text = told(change, drag, open.assumed_orientation().is_some());
            drag.start.apply(open, change);
        }
        if !ui.input(|i| i.pointer.primary_down()) {
            open.document.commit();
            self.drag = None;
        }
    }

    /// The handles, over the picture.
    pub fn paint(&self, ui: &Ui, painter: &Painter, is_assumed: bool) {
        let Some(shape) = &self.shape else { return };
        let held = self.drag.as_ref().map(|drag| drag.handle);
        let is_lit = |handle: Handle| held.or(self.over) == Some(handle);
        // While one is held, the others are not in the way.
        let is_shown = |handle: Handle| held.is_none_or(|held| held == handle || handle == Handle::Center);
        for is_white in [true, false] {
            let line = if is_white { Stroke::new(2.5, Color32::WHITE) } else { Stroke::new(1.0, theme::GIZMO) };
            for ends in &self.edges {
                painter.line_segment(*ends, line);
            }
            let stroke = |width: f32, handle: Handle| {
                let width = if is_lit(handle) { width + 1.5 } else { width };
                if is_white { Stroke::new(width + 2.0, Color32::WHITE) } else { Stroke::new(width, theme::GIZMO) }
            };
            for ring in shape.rings.iter().filter(|ring| is_shown(Handle::Ring(ring.axis))) {
                for (ends, is_near) in &ring.pieces {
                    // The far side is thin, and without an edge.
                    if *is_near {
                        painter.line_segment(*ends, stroke(2.0, Handle::Ring(ring.axis)));
                    } else if !is_white {
                        painter.line_segment(*ends, Stroke::new(1.0, theme::GIZMO.gamma_multiply(0.6)));
                    }
                }
                let radius = if is_lit(Handle::Ring(ring.axis)) { 6.5 } else { 5.0 };
                dot(painter, ring.grip, radius, is_white);
            }
            for (axis, end) in shape.arms.iter().filter(|arm| is_shown(Handle::Axis(arm.0))) {
                painter.line_segment([shape.center, *end], stroke(2.5, Handle::Axis(*axis)));
                head(painter, *end, (*end - shape.center).normalized(), is_white);
                dot(painter, *end, 9.0, is_white);
            }
            if is_shown(Handle::Scale) {
                let half = if is_lit(Handle::Scale) { 7.0 } else { 5.5 };
                let square = Rect::from_center_size(shape.square, Vec2::splat(2.0 * half));
                if is_white {
                    painter.rect_filled(square.expand(2.0), 1.0, Color32::WHITE);
                } else {
                    painter.rect_filled(square, 1.0, theme::GIZMO);
                    painter.rect_stroke(square.shrink(3.0), 0.0, Stroke::new(1.0, Color32::WHITE), StrokeKind::Inside);
                }
            }
            let radius = if is_lit(Handle::Center) { 7.5 } else { 6.0 };
            dot(painter, shape.center, radius, is_white);
        }
        for (axis, end) in shape.arms.iter().filter(|arm| is_shown(Handle::Axis(arm.0))) {
            let letter = marked(["R", "A", "S"][*axis], is_assumed);
            painter.text(*end, Align2::CENTER_CENTER, letter, FontId::proportional(12.0), Color32::WHITE);
        }
        if let Some(at) = self.focused {
            painter.circle_stroke(at, REACH, Stroke::new(4.0, Color32::WHITE));
            painter.circle_stroke(at, REACH, Stroke::new(2.0, theme::GIZMO));
        }
        if let (Some(drag), Some(at)) = (&self.drag, ui.input(|i| i.pointer.latest_pos())) {
            tell(painter, at + Vec2::new(18.0, -18.0), &drag.text);
        }
    }
}

fn dot(painter: &Painter, at: Pos2, radius: f32, is_white: bool) {
    let (radius, color) = if is_white { (radius + 2.0, Color32::WHITE) } else { (radius, theme::GIZMO) };
    painter.circle_filled(at, radius, color);
}

/// The head of an arrow behind the letter at its end.
fn head(painter: &Painter, end: Pos2, along: Vec2, is_white: bool) {
    let (edge, color) = if is_white { (2.5, Color32::WHITE) } else { (0.0, theme::GIZMO) };
    let side = along.rot90() * (6.0 + edge);
    let base = end + 7.0 * along;
    let corners = vec![base + side, end + (17.0 + 1.5 * edge) * along, base - side];
    painter.add(PathShape::convex_polygon(corners, color, Stroke::NONE));
}

/// A handle's value: mm, degrees, factor.
fn value(handle: Handle, start: &Movable) -> f64 {
    match handle {
        Handle::Axis(axis) => start.moved().offset[axis] * start.radius_mm,
        Handle::Center => DVec3::from_array(start.moved().offset).length() * start.radius_mm,
        Handle::Ring(axis) => start.moved().turn[axis],
        Handle::Scale => start.moved().scale,
    }
}

/// What is written beside the pointer.
fn told(change: Change, drag: &Drag, is_assumed: bool) -> String {
    match (change, drag.handle) {
        (Change::By(mm), Handle::Axis(axis)) => {
            let letter = [["R", "L"], ["A", "P"], ["S", "I"]][axis][usize::from(mm[axis] < 0.0)];
            format!("{:.1} mm {}", mm.length(), marked(letter, is_assumed))
        }
        (Change::By(mm), _) => format!("{:.1} mm", mm.length()),
        (Change::Turn(deg), Handle::Ring(axis)) => format!("{:.1}°", deg[axis]).replace('-', "\u{2212}"),
        (Change::Turn(deg), _) => format!("{:.1}°", deg.length()),
        (Change::Scale(factor), _) => format!("× {:.2}", drag.start.moved().scale * factor),
        (Change::Back, _) => String::new(),
    }
}

/// What an arrow key asks of the handle that has the focus.
fn by_key(ui: &Ui, id: egui::Id, handle: Handle, camera: &Camera) -> Option<Change> {
    let filter = EventFilter { horizontal_arrows: true, vertical_arrows: true, ..EventFilter::default() };
    ui.memory_mut(|m| m.set_focus_lock_filter(id, filter));
    let arrows = [
        (Key::ArrowRight, [1.0, 0.0]),
        (Key::ArrowLeft, [-1.0, 0.0]),
        (Key::ArrowUp, [0.0, 1.0]),
        (Key::ArrowDown, [0.0, -1.0]),
    ];
    let pressed = |key: Key| {
        let is_pressed = |modifiers| ui.input_mut(|i| i.consume_key(modifiers, key));
        is_pressed(Modifiers::SHIFT).then_some(FINE).or_else(|| is_pressed(Modifiers::NONE).then_some(1.0))
    };
    let (fine, [x, y]) = arrows.into_iter().find_map(|(key, by)| Some((pressed(key)?, by)))?;
    let steps = fine * (x + y);
    Some(match handle {
        Handle::Axis(axis) => Change::By(KEY_MM * steps * DVec3::AXES[axis]),
        Handle::Center => Change::By(KEY_MM * fine * (x * camera.right + y * camera.up)),
        Handle::Ring(axis) => Change::Turn(KEY_DEG * steps * DVec3::AXES[axis]),
        Handle::Scale => Change::Scale(KEY_SCALE.powf(steps)),
    })
}

#[cfg(test)]
mod tests {
    use fabrica_engine::scene::Projection;

    use super::super::movable::Part;
    use super::*;
    use crate::figure::template::MoveTemplate;

    fn drag(handle: Handle, from_eye: DVec3, projection: Projection) -> Drag {
        let camera = Camera::looking(400.0 * from_eye.normalize(), -from_eye, DVec3::Z, projection).unwrap();
        let sight = Sight { camera, frame: Rect::from_min_size(Pos2::ZERO, Vec2::new(800.0, 600.0)) };
        let pivot_mm = DVec3::new(10.0, 0.0, -5.0);
        let start = Movable {
            object: 0,
            region: 0,
            title: "Brain".to_owned(),
            parts: vec![Part { structure: None, moved: MoveTemplate::default(), center_mm: pivot_mm }],
            radius_mm: 50.0,
            pivot_mm,
        };
        let (from, text) = (Pos2::ZERO, String::new());
        Drag { handle, start, sight, from, last: from, at: from, turned_deg: 0.0, text }
    }

    fn changed(start: &Movable, change: Change) -> (MoveTemplate, String) {
        let (moves, label) = start.changed(change);
        (moves[0].1.clone().unwrap(), label)
    }

    const PROJECTIONS: [Projection; 2] =
        [Projection::Perspective { fov_y_deg: 30.0 }, Projection::Orthographic { height_mm: 200.0 }];
    const FROM: DVec3 = DVec3::new(-0.6, 0.72, 0.34);

    #[test]
    fn a_handle_stays_under_the_pointer() {
        for projection in PROJECTIONS {
            for axis in 0..3 {
                let mut drag = drag(Handle::Axis(axis), FROM, projection);
                let place = |mm: f64| drag.start.pivot_mm + mm * DVec3::AXES[axis];
                (drag.from, drag.at) = (drag.sight.seen(place(20.0)).unwrap(), drag.sight.seen(place(44.0)).unwrap());
                let Some(Change::By(mm)) = drag.change(false) else { panic!() };
                assert!(mm.distance(24.0 * DVec3::AXES[axis]) < 1e-2, "{axis}: {mm}");
                let Some(Change::By(mm)) = drag.change(true) else { panic!() };
                assert!(mm.distance(24.0 * DVec3::AXES[axis]) < 1e-12, "{mm}");
                let (moved, label) = changed(&drag.start, Change::By(mm));
                assert!((moved.offset[axis] - 0.48).abs() < 1e-12 && label == "Move Brain 24.0 mm", "{label}");
            }
            let mut drag = drag(Handle::Center, FROM, projection);
            let to = drag.start.pivot_mm + 12.0 * drag.sight.camera.right - 7.0 * drag.sight.camera.up;
            (drag.from, drag.at) = (drag.sight.seen(drag.start.pivot_mm).unwrap(), drag.sight.seen(to).unwrap());
            let Some(Change::By(mm)) = drag.change(false) else { panic!() };
            assert!(mm.distance(to - drag.start.pivot_mm) < 1e-2, "{mm}");
        }
    }

    #[test]
    fn rings_turn_right_handed_and_beyond_half_a_turn() {
        for (projection, axis) in PROJECTIONS.into_iter().flat_map(|p| [0, 1, 2].map(|axis| (p, axis))) {
            let mut drag = drag(Handle::Ring(axis), FROM, projection);
            let on = |drag: &Drag, deg: f64| {
                drag.sight.seen(drag.start.pivot_mm + 30.0 * on_ring(axis, deg.to_radians())).unwrap()
            };
            drag.from = on(&drag, 20.0);
            for step in 1..=50 {
                drag.at = on(&drag, 20.0 + 10.0 * f64::from(step));
                let Some(Change::Turn(deg)) = drag.change(false) else { panic!() };
                let expected = 10.0 * f64::from(step) * DVec3::AXES[axis];
                assert!(deg.distance(expected) < 0.05, "{axis}: {deg} at {step}");
            }
            assert_eq!(drag.change(true), Some(Change::Turn(495.0 * DVec3::AXES[axis])));
        }
        // A point that is turned about superior goes from right to anterior.
        let start = drag(Handle::Ring(2), FROM, PROJECTIONS[0]).start;
        let (moved, label) = changed(&start, Change::Turn(90.0 * DVec3::Z));
        assert!((moved.rotation() * DVec3::X).distance(DVec3::Y) < 1e-12 && label == "Turn Brain 90.0°");
        // Turns add up about the body's axes, not the region's.
        let again = Movable { parts: vec![Part { moved, ..start.parts[0].clone() }], ..start };
        let (moved, _) = changed(&again, Change::Turn(90.0 * DVec3::X));
        assert!((moved.rotation() * DVec3::X).distance(DVec3::Z) < 1e-12);
    }

    #[test]
    fn a_ring_that_is_seen_from_its_edge_turns_all_the_same() {
        for projection in PROJECTIONS {
            let mut drag = drag(Handle::Ring(2), DVec3::Y, projection);
            let held = drag.start.pivot_mm + 30.0 * DVec3::Y;
            drag.from = drag.sight.seen(held).unwrap();
            // What is before the axis goes to the left of the body, which is on the right of the screen.
            drag.at = drag.from + Vec2::new(40.0, 0.0);
            let Some(Change::Turn(DVec3 { z: deg, .. })) = drag.change(false) else { panic!() };
            // A radian is the radius of the ring, whose near side is a little larger.
            assert!((deg - (40.0 / RING).to_degrees()).abs() < 3.0, "{deg}");
            drag.at = drag.from - Vec2::new(40.0, 0.0);
            let Some(Change::Turn(DVec3 { z: back, .. })) = drag.change(false) else { panic!() };
            assert!((deg + back).abs() < 0.5, "{deg} {back}");
        }
    }

    #[test]
    fn scales_go_no_further_than_they_may() {
        let mut drag = drag(Handle::Scale, FROM, PROJECTIONS[0]);
        let center = drag.sight.seen(drag.start.pivot_mm).unwrap();
        drag.from = center + Vec2::new(80.0, -80.0);
        for (out, factor, snapped) in [(120.0, 1.5, 1.5), (83.0, 1.0375, 1.0), (-200.0, 0.01, 0.1), (1e6, 100.0, 100.0)]
        {
            drag.at = center + Vec2::new(out, -out);
            let Some(Change::Scale(is)) = drag.change(false) else { panic!() };
            let Some(Change::Scale(with_ctrl)) = drag.change(true) else { panic!() };
            assert!((is - factor).abs() < 1e-4 && (with_ctrl - snapped).abs() < 1e-9, "{out}: {is} {with_ctrl}");
        }
        let (moved, label) = changed(&drag.start, Change::Scale(1.5));
        assert_eq!((moved.scale, label.as_str()), (1.5, "Scale Brain × 1.50"));
    }

    #[test]
    fn several_parts_stay_together() {
        let mut start = drag(Handle::Scale, FROM, PROJECTIONS[0]).start;
        let tilted = MoveTemplate { turn: [0.0, 30.0, 0.0], offset: [0.1, 0.0, 0.0], ..MoveTemplate::default() };
        let other = Part { structure: Some("b".to_owned()), moved: tilted, center_mm: DVec3::new(-20.0, 4.0, 9.0) };
        start.parts.push(other);
        for change in
            [Change::By(DVec3::new(1.0, 2.0, 3.0)), Change::Turn(DVec3::new(10.0, 70.0, -20.0)), Change::Scale(0.6)]
        {
            let (moves, _) = start.changed(change);
            // Whatever was done to the first was done to the second: the same map of the world.
            let [by, again] = [0, 1].map(|i| {
                let part = &start.parts[i];
                let pose = |moved: &MoveTemplate| moved.pose(part.center_mm, start.radius_mm);
                pose(moves[i].1.as_ref().unwrap()) * pose(&part.moved).inverse()
            });
            assert!(by.abs_diff_eq(again, 1e-9), "{change:?}: {by:?} is not {again:?}");
        }
    }
}
