//! The strip of tools, and the bar with the settings of the one in the hand.

use eframe::egui::{
    Align2, ComboBox, DragValue, FontId, Painter, Pos2, Rect, Response, Sense, Shape, Stroke, StrokeKind, Ui, Vec2,
};

use super::super::open_figure::OpenFigure;
use super::super::panels::properties::parse_number;
use super::super::theme;
use super::super::ui_command::UiCommand;
use super::{Aim, Mode, Settings, Tool, shorter_mm, target};

/// Edge of a button of the strip, points.
const BUTTON: f32 = 36.0;

/// The strip; the command of the button that was pressed.
pub fn strip(ui: &mut Ui, active: Tool) -> Option<UiCommand> {
    let mut wanted = None;
    ui.spacing_mut().item_spacing.y = 4.0;
    for tool in Tool::ALL {
        let command = tool.command();
        let (rect, response) = ui.allocate_exact_size(Vec2::splat(BUTTON), Sense::click());
        let key = command.shortcut().map_or(String::new(), |s| ui.ctx().format_shortcut(&s));
        let info = || {
            let name = format!("{} ({key})", command.text());
            eframe::egui::WidgetInfo::selected(eframe::egui::Role::Button, true, active == tool, name)
        };
        response.widget_info(info);
        button(ui, rect, &response, active == tool, tool, &key);
        if response.on_hover_text(format!("{} ({key})\n{}", command.text(), command.tooltip())).clicked() {
            wanted = Some(command);
        }
    }
    wanted
}

fn button(ui: &Ui, rect: Rect, response: &Response, is_active: bool, tool: Tool, key: &str) {
    let tokens = theme::tokens(ui.ctx());
    let painter = ui.painter();
    if is_active {
        painter.rect_filled(rect, 4.0, tokens.selected);
    }
    if response.hovered() || response.has_focus() || is_active {
        let color = if response.has_focus() || response.hovered() { tokens.accent } else { tokens.border };
        painter.rect_stroke(rect, 4.0, Stroke::new(1.0, color), StrokeKind::Inside);
    }
    icon(painter, rect.center() - Vec2::new(2.0, 2.0), tool, Stroke::new(1.6, tokens.text));
    let at = rect.right_bottom() - Vec2::new(4.0, 2.0);
    painter.text(at, Align2::RIGHT_BOTTOM, key, FontId::proportional(10.0), tokens.dim);
}

/// An icon of 18 points.
fn icon(painter: &Painter, center: Pos2, tool: Tool, line: Stroke) {
    let at = |x: f32, y: f32| center + Vec2::new(x, y);
    match tool {
        Tool::Select => {
            let corners = vec![
                at(-4.0, -8.0),
                at(-4.0, 6.0),
                at(-0.5, 3.0),
                at(2.0, 8.0),
                at(4.0, 7.0),
                at(1.6, 2.2),
                at(6.0, 2.0),
            ];
            painter.add(Shape::closed_line(corners, line));
        }
        Tool::Brush => {
            painter.line_segment([at(8.0, -8.0), at(-1.0, 1.0)], Stroke::new(3.0, line.color));
            painter.circle_filled(at(-4.0, 4.0), 4.2, line.color);
            painter.line_segment([at(-4.0, 4.0), at(-8.0, 8.0)], Stroke::new(3.0, line.color));
        }
        Tool::Lasso => {
            let point = |i: i32| {
                let angle = i as f32 / 24.0 * std::f32::consts::TAU;
                at(8.0 * angle.cos(), -2.0 + 5.5 * angle.sin())
            };
            painter.add(Shape::closed_line((0..24).map(point).collect(), line));
            painter.add(Shape::line(vec![at(-4.0, 3.0), at(-3.0, 6.0), at(-6.0, 9.0)], line));
        }
        Tool::Rectangle => {
            let corners = [at(-8.0, -6.0), at(8.0, -6.0), at(8.0, 6.0), at(-8.0, 6.0), at(-8.0, -6.0)];
            painter.extend(Shape::dashed_line(&corners, line, 3.0, 2.5));
        }
        Tool::Grow => {
            painter.line_segment([at(-8.0, 8.0), at(2.0, -2.0)], Stroke::new(2.5, line.color));
            for (x, y) in [(0.0, -1.0), (0.75, -0.75), (1.0, 0.0), (0.75, 0.75), (-0.75, -0.75)] {
                let middle = at(3.5, -3.5);
                painter.line_segment([middle + 3.0 * Vec2::new(x, y), middle + 6.0 * Vec2::new(x, y)], line);
            }
        }
    }
}

/// The settings of the tool in the hand.
pub fn options(ui: &mut Ui, active: Tool, settings: &mut Settings, open: &OpenFigure) {
    ui.label(theme::heading(active.command().text()));
    ui.separator();
    if active == Tool::Select {
        ui.label(theme::small(ui.ctx(), "Click: what is this? · Drag: turn the figure, move the crosshair of slices"));
        return;
    }
    targets(ui, settings, open);
    if active == Tool::Brush {
        for (mode, text, tooltip) in [
            (Mode::Add, "Add", "Into the selection (A; Alt turns it around while it is held)"),
            (Mode::Subtract, "Erase", "Out of the selection (S or E; Alt turns it around while it is held)"),
        ] {
            let is_on = settings.erases() == (mode == Mode::Subtract);
            if ui.selectable_label(is_on, text).on_hover_text(tooltip).clicked() {
                settings.mode = mode;
            }
        }
    } else {
        for mode in Mode::ALL {
            let command = mode.command();
            let key = command.shortcut().map_or(String::new(), |s| format!(" ({})", ui.ctx().format_shortcut(&s)));
            let tooltip = format!("{}{key}", command.tooltip());
            if ui.selectable_label(settings.mode == mode, format!("{mode:?}")).on_hover_text(tooltip).clicked() {
                settings.mode = mode;
            }
        }
    }
    ui.separator();
    if active == Tool::Brush {
        let least = settings.least_radius_mm(open);
        let mut radius = settings.radius_mm(open);
        let tooltip = format!("Shift+drag, or [ and ]; at least half a voxel, {} mm", shorter_mm(least));
        if number(ui, "Radius", " mm", &tooltip, &mut radius) {
            settings.set_radius_mm(open, radius);
        }
        let tooltip = "Fades from the middle to the radius, as a Gaussian with half the radius as its deviation";
        ui.checkbox(&mut settings.is_soft, "Soft").on_hover_text(tooltip);
        ui.separator();
    }
    if matches!(active, Tool::Lasso | Tool::Rectangle) {
        reach(ui, settings, open);
        ui.separator();
    }
    if active == Tool::Grow {
        let mut tolerance = settings.tolerance(open);
        let unit = open.chosen_volume().map_or("", |v| v.modality.suffix());
        let tooltip = "How unlike its seeds a region may be; drag to the side or turn the wheel while it is shown";
        if number(ui, "Tolerance", unit, tooltip, &mut tolerance) {
            settings.tolerance = Some(tolerance.max(0.0));
        }
    } else {
        range(ui, settings, open);
        if active == Tool::Brush {
            let tooltip = "Only what hangs together with the way of the brush, within the values and what is visible";
            ui.checkbox(&mut settings.is_connected, "Connected").on_hover_text(tooltip);
        }
        let tooltip = "In the figure: leaves out voxels that the transfer function makes transparent, such as air";
        ui.checkbox(&mut settings.is_visible_only, "Visible only").on_hover_text(tooltip);
    }
    ui.separator();
    let mut mm = settings.refine_mm(open);
    if number(ui, "Refine by", " mm", "By how much the menu Selection grows, shrinks and smooths", &mut mm) {
        settings.refine_mm = Some(mm.clamp(1e-3, 1e3));
    }
}

fn reach(ui: &mut Ui, settings: &mut Settings, open: &OpenFigure) {
    for (is_surface, text, tooltip) in [
        (false, "Through", "All that is seen behind the loop, in a slice also above and below it"),
        (true, "Surface", "Only what is seen first, down to a depth; in a slice its own layer of voxels"),
    ] {
        if ui.selectable_label(settings.is_surface_only == is_surface, text).on_hover_text(tooltip).clicked() {
            settings.is_surface_only = is_surface;
        }
    }
    if settings.is_surface_only {
        let mut depth = settings.depth_mm(open);
        if number(ui, "Depth", " mm", "How deep under the surface that is seen first", &mut depth) {
            settings.depth_mm = Some(depth.clamp(0.0, 1e4));
        }
    }
}

fn targets(ui: &mut Ui, settings: &mut Settings, open: &OpenFigure) {
    let mut all: Vec<(Aim, String)> = vec![(Aim::New, "New selection".to_owned())];
    all.extend(target::all(open).into_iter().map(|(slot, title)| (Aim::Painted(slot), title)));
    // A structure that comes from a file: what is chosen in the list, or was.
    let copies = [Some(settings.target.clone()), target::chosen(open)];
    for aim in copies.into_iter().flatten().filter(|aim| matches!(aim, Aim::Copy(_))) {
        if let Aim::Copy(part) = &aim
            && let Some(title) = target::title(open, part)
            && all.iter().all(|(known, _)| *known != aim)
        {
            all.push((aim, format!("{title} (a copy)")));
        }
    }
    let now = all.iter().find(|(aim, _)| *aim == settings.target).unwrap_or(&all[0]);
    let combo = ComboBox::from_id_salt("target").selected_text(&now.1).width(130.0).truncate().show_ui(ui, |ui| {
        for (aim, title) in &all {
            if ui.selectable_label(*aim == now.0, title).clicked() {
                settings.target = aim.clone();
            }
        }
    });
    let tooltip = match now.0 {
        Aim::Copy(_) => {
            "What is painted into: its file stays as it is, a copy of it is drawn in its place from the first edit on"
        }
        _ => "What is painted into",
    };
    combo.response.accessible_name("Target selection").on_hover_text(tooltip);
}

fn range(ui: &mut Ui, settings: &mut Settings, open: &OpenFigure) {
    let Some(volume) = open.chosen_volume().filter(|v| v.colors.is_none()) else { return };
    let whole = || {
        let (low, high) = volume.bricks().range();
        [low, high].map(|stored| volume.rescale.value(stored))
    };
    let mut is_limited = settings.range.is_some();
    if ui.checkbox(&mut is_limited, "Values").on_hover_text("Only voxels with values in a range").changed() {
        settings.range = is_limited.then(whole);
    }
    if let Some([low, high]) = &mut settings.range {
        let [a, b] = whole();
        let speed = 0.002 * (b - a).abs().max(1e-9);
        let unit = volume.modality.suffix();
        for (name, value) in [("Lowest value", low), ("Highest value", high)] {
            let field = DragValue::new(value).speed(speed).suffix(unit).max_decimals(1).custom_parser(parse_number);
            ui.add(field.update_while_editing(false)).accessible_name(name).on_hover_text(name);
        }
    }
}

/// A number with its name; whether it was changed.
fn number(ui: &mut Ui, label: &str, unit: &str, tooltip: &str, value: &mut f64) -> bool {
    let text = ui.label(theme::small(ui.ctx(), label));
    let speed = 0.01 * value.abs().max(0.1);
    let field = DragValue::new(value).speed(speed).suffix(unit).max_decimals(2).custom_parser(parse_number);
    ui.add(field.update_while_editing(false))
        .labelled_by(text.id)
        .accessible_name(label)
        .on_hover_text(tooltip)
        .changed()
}
