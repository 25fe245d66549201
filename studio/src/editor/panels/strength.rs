//! How much of a meeting shows, painted on the square of the two values that meet.

use std::sync::Arc;

use eframe::egui::{
    self, Align2, Color32, FontId, Mesh, PointerButton, Pos2, Rect, Role, Sense, Stroke, StrokeKind, Ui, Vec2,
    WidgetInfo,
};
use fabrica_engine::scene::moved::{STRENGTH_SIZE, Strength};

use super::super::open_figure::OpenFigure;
use super::super::theme;
use crate::figure::Command;
use crate::figure::template::MeetingStrength;

/// Edge of the square, points.
const EDGE: f32 = 160.0;
/// Radius of the brush, in cells.
const RADIUS: f32 = 6.0;

/// The square, with the hand on it. None: all of it shows, whatever the values. `set` makes the edit of what it becomes.
pub fn edit(
    ui: &mut Ui,
    open: &mut OpenFigure,
    title: &str,
    strength: Option<&MeetingStrength>,
    set: &dyn Fn(Option<MeetingStrength>) -> Command,
) {
    let tokens = theme::tokens(ui.ctx());
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(EDGE), Sense::click_and_drag());
    let mean =
        strength.map_or(1.0, |s| s.0.cells().iter().map(|c| f64::from(*c)).sum::<f64>() / (255.0 * CELLS as f64));
    response.widget_info(|| WidgetInfo {
        value: Some(100.0 * mean),
        ..WidgetInfo::labeled(Role::Slider, true, format!("{title}: strength by values, mean in %"))
    });
    let buttons = [PointerButton::Primary, PointerButton::Secondary];
    let held = buttons.into_iter().find(|b| response.dragged_by(*b) || response.clicked_by(*b));
    let held = held.or_else(|| buttons.into_iter().find(|b| response.drag_stopped_by(*b)));
    let (at, by, alt) = ui.input(|i| (i.pointer.latest_pos(), i.pointer.delta(), i.modifiers.alt));
    let command = held.zip(at).map(|(button, at)| {
        let erases = alt || button == PointerButton::Secondary;
        let cell = |at: Pos2| Vec2::new(at.x - rect.left(), rect.bottom() - at.y) * (STRENGTH_SIZE as f32 / EDGE);
        let mut cells = cells_of(strength, erases);
        // A click has no way behind it.
        let from = if response.dragged() { at - by } else { at };
        stroke(&mut cells, cell(from), cell(at), erases);
        set(Strength::new(cells).map(|strength| MeetingStrength(Arc::new(strength))))
    });
    open.edit_by(&response, command);
    paint(ui, rect, strength);
    ui.painter().rect_stroke(rect, 0.0, Stroke::new(1.0, tokens.border), StrokeKind::Outside);
    if let Some(at) = response.hover_pos() {
        let radius = RADIUS * EDGE / STRENGTH_SIZE as f32;
        let painter = ui.painter_at(rect);
        painter.circle_stroke(at, radius, Stroke::new(3.0, Color32::WHITE));
        painter.circle_stroke(at, radius, Stroke::new(1.5, theme::GIZMO));
    }
    let small = |ui: &Ui, text: &str| theme::small(ui.ctx(), text);
    ui.label(small(ui, "Right: higher values at rest. Up: higher moved values."));
    let hint = "Drag: shows where these values meet. Right button or Alt: does not.";
    ui.add(egui::Label::new(small(ui, hint)).wrap());
    if ui.add_enabled(strength.is_some(), egui::Button::new("Reset strength")).clicked() {
        open.edit(set(None));
    }
}

const CELLS: usize = STRENGTH_SIZE * STRENGTH_SIZE;

/// What is painted on: where all shows, erasing begins with all and painting with nothing.
fn cells_of(strength: Option<&MeetingStrength>, erases: bool) -> Vec<u8> {
    strength.map_or_else(|| vec![if erases { 255 } else { 0 }; CELLS], |strength| strength.0.cells().to_vec())
}

/// A soft disc from one place, in cells, to another.
fn stroke(cells: &mut [u8], from: Vec2, to: Vec2, erases: bool) {
    let way = to - from;
    for (i, cell) in cells.iter_mut().enumerate() {
        let at = Vec2::new((i % STRENGTH_SIZE) as f32 + 0.5, (i / STRENGTH_SIZE) as f32 + 0.5) - from;
        let t = (at.dot(way) / way.length_sq().max(1e-6)).clamp(0.0, 1.0);
        let d = (at - t * way).length() / RADIUS;
        let weight = (1.0 - d * d).max(0.0).powi(2);
        let full = (255.0 * weight).round() as u8;
        *cell = if erases { (*cell).min(255 - full) } else { (*cell).max(full) };
    }
}

fn paint(ui: &Ui, rect: Rect, strength: Option<&MeetingStrength>) {
    let tokens = theme::tokens(ui.ctx());
    let Some(strength) = strength else {
        ui.painter().rect_filled(rect, 0.0, tokens.accent);
        let font = FontId::proportional(12.0);
        ui.painter().text(rect.center(), Align2::CENTER_CENTER, "For any two values", font, Color32::WHITE);
        return;
    };
    let edge = EDGE / STRENGTH_SIZE as f32;
    let mut mesh = Mesh::default();
    for (i, cell) in strength.0.cells().iter().enumerate() {
        let corner =
            rect.left_bottom() + Vec2::new((i % STRENGTH_SIZE) as f32, -((i / STRENGTH_SIZE) as f32 + 1.0)) * edge;
        let color = tokens.canvas.lerp_to_gamma(tokens.accent, f32::from(*cell) / 255.0);
        mesh.add_colored_rect(Rect::from_min_size(corner, Vec2::splat(edge)), color);
    }
    ui.painter().add(mesh);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_show_and_erase_where_they_go() {
        let mut cells = cells_of(None, false);
        let at = |cells: &[u8], x: usize, y: usize| cells[x + STRENGTH_SIZE * y];
        stroke(&mut cells, Vec2::new(10.5, 20.5), Vec2::new(30.5, 20.5), false);
        assert_eq!((at(&cells, 10, 20), at(&cells, 20, 20), at(&cells, 30, 20)), (255, 255, 255));
        assert!(at(&cells, 20, 23) > 50 && at(&cells, 20, 27) == 0 && at(&cells, 3, 20) == 0);
        stroke(&mut cells, Vec2::new(20.5, 20.5), Vec2::new(20.5, 20.5), true);
        assert_eq!((at(&cells, 20, 20), at(&cells, 10, 20)), (0, 255));
        // On what shows everywhere, erasing leaves the rest.
        let mut cells = cells_of(None, true);
        stroke(&mut cells, Vec2::new(0.5, 0.5), Vec2::new(0.5, 0.5), true);
        assert_eq!((at(&cells, 0, 0), at(&cells, 30, 30)), (0, 255));
    }
}
