//! The transfer function as a picture that is worked on: the histogram of the values, the curve of the opacity, its nodes,
//! and below them the spheres of their styles. Successive nodes of one style are one material, with one sphere.

use std::ops::Range;

use eframe::egui::epaint::PathShape;
use eframe::egui::{
    self, ComboBox, CursorIcon, DragValue, Pos2, Rect, Response, Role, Sense, Stroke, Ui, Vec2, WidgetInfo,
};
use fabrica_engine::volume::Volume;

use super::super::gallery::{DraggedStyle, Gallery};
use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::curve::{Positions, insert_node, materials, round_to, statistics_of, whole_range};
use super::function_map;
use super::histogram::{Histogram, Inside};
use super::plot::{Plot, paint_axis, paint_curve, paint_histogram, paint_note, paint_tints};
use crate::figure::Command;
use crate::figure::command::Chosen;
use crate::figure::template::{LookTemplate, NodeTemplate};

/// How the panel is looked at; no part of the figure.
pub struct FunctionView {
    /// Whether the histogram's counts are shown as their logarithms.
    pub logarithmic: bool,
    /// The values at the plot's left and right; `None`: all that matter.
    pub range: Option<(f64, f64)>,
    /// The value that the pointer is on in the picture, or that was asked about.
    pub marked: Option<f64>,
    /// The node whose material a style that is carried over the picture would dress.
    pub aimed: Option<usize>,
    /// The values inside what is chosen.
    inside: Inside,
    /// Of a 2-D function, how its map is looked at.
    map: function_map::MapView,
    /// A node that is dragged: value and opacity before they are rounded, and where the pointer was.
    dragged: Option<(f64, f64, Pos2)>,
}

impl Default for FunctionView {
    fn default() -> Self {
        Self {
            logarithmic: true,
            range: None,
            marked: None,
            aimed: None,
            inside: Inside::default(),
            map: Default::default(),
            dragged: None,
        }
    }
}

impl FunctionView {
    /// Another figure is open: what was looked at in the last one is none of its business.
    pub fn forget_figure(&mut self) {
        *self = Self { logarithmic: self.logarithmic, ..Self::default() };
    }
}

/// From this width on, a node's fields are beside the title.
const WIDE: f32 = 660.0;
const WIDE_PART: f32 = 900.0;
/// Radius of a node's dot, and how near a press must come.
const DOT: f32 = 5.5;
const GRAB: f32 = 10.0;
/// Radius of a material's sphere.
const SPHERE: f32 = 14.0;
/// Of the panel's width, what the map of a 2-D function takes.
const MAP_SHARE: f32 = 0.42;
/// What Shift leaves of a drag.
const FINE: f64 = 0.1;

/// The panel.
pub fn show(ui: &mut Ui, open: &mut OpenFigure, gallery: &Gallery, view: &mut FunctionView) {
    let Some(function) = open.function() else {
        ui.label("The figure has no object.");
        return;
    };
    // Undo may have taken it away.
    open.row = open.row.min(open.num_rows() - 1);
    let volume = open.chosen_volume().cloned();
    let volume = volume.as_deref();
    let statistics = statistics_of(volume);
    let positions = Positions::new(&function, statistics);
    // Whatever the fields above need: the plot has the panel's width.
    let width = ui.max_rect();
    header(ui, open, gallery, view, positions, volume);
    if open.num_rows() > 1 {
        ui.horizontal(|ui| function_map::row_fields(ui, open));
    }

    let tokens = theme::tokens(ui.ctx());
    let mut area = ui.available_rect_before_wrap().intersect(width);
    let values: Vec<f64> = function.nodes.iter().map(|n| positions.value(n.at)).collect();
    let whole = whole_range(&values, volume.zip(statistics));
    let (low, high) = view.range.unwrap_or(whole);
    if open.num_rows() > 1 {
        let (left, right) = area.split_left_right_at_fraction(MAP_SHARE);
        function_map::show(ui, open, gallery, &mut view.map, left, (low, high));
        area = right;
    }
    let spheres_height = 2.0 * SPHERE + 8.0;
    let rect = Rect::from_min_max(area.min + Vec2::new(8.0, 4.0), area.max - Vec2::new(8.0, spheres_height + 16.0));
    if rect.height() < 24.0 || rect.width() < 60.0 {
        return;
    }
    let plot = Plot { rect, low, high };

    let response = ui.allocate_rect(area, Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Canvas, true, "Plot of the transfer function"));
    look_around(ui, &response, plot, whole, view);
    if response.double_clicked()
        && let Some(at) = response.interact_pointer_pos().filter(|p| rect.contains(*p))
    {
        insert_node(open, plot.value(at.x), plot.resolution(), None, Some(plot.opacity(at.y)));
    } else if response.clicked() {
        open.node = None;
    }

    let painter = ui.painter_at(area);
    painter.rect_filled(rect, 2.0, tokens.field);
    if let Some((volume, statistics)) = volume.zip(statistics) {
        paint_histogram(
            &painter,
            plot,
            &Histogram::of(volume, statistics),
            view.logarithmic,
            tokens.border.gamma_multiply(0.45),
        );
        if let Some(inside) = view.inside.of_chosen(ui.ctx(), open) {
            paint_histogram(&painter, plot, inside, view.logarithmic, tokens.accent.gamma_multiply(0.4));
        }
    }
    paint_tints(&painter, plot, &values, &function.nodes, gallery);
    paint_axis(&painter, plot, volume, tokens);
    paint_curve(&painter, plot, &values, &function.nodes, tokens);
    if let Some(marked) = view.marked.map(|v| plot.x(v)).filter(|x| plot.spans(*x)) {
        painter.vline(marked, rect.y_range(), Stroke::new(1.5, tokens.warning));
        let top = Pos2::new(marked, rect.top());
        let triangle = vec![top, top + Vec2::new(-5.0, -7.0), top + Vec2::new(5.0, -7.0)];
        ui.painter().add(PathShape::convex_polygon(triangle, tokens.warning, Stroke::NONE));
    }
    nodes(ui, open, plot, positions, &values, &function.nodes, volume, view);
    let spheres = place_spheres(plot, &values, &function.nodes);
    material_spheres(ui, open, gallery, &function.nodes, &spheres, (rect.bottom() + 16.0 + SPHERE, view.aimed));
    drop_style(ui, open, &response, plot, &values, &function.nodes, &spheres);
}

/// Title, node fields, scale.
fn header(
    ui: &mut Ui,
    open: &mut OpenFigure,
    gallery: &Gallery,
    view: &mut FunctionView,
    positions: Positions<'_>,
    volume: Option<&Volume>,
) {
    // A part's title is longer, and what takes its function away stands beside it.
    let room = if open.chosen_region().is_some() { WIDE_PART } else { WIDE };
    let wide = ui.available_width() > room;
    // From the right: what is on the left gets the rest.
    let right_to_left = egui::Layout::right_to_left(egui::Align::Center);
    ui.allocate_ui_with_layout(Vec2::new(ui.available_width(), theme::ROW), right_to_left, |ui| {
        if view.range.is_some() && ui.button("Whole range").on_hover_text("Shows all values again").clicked() {
            view.range = None;
        }
        let tooltip = "How the histogram counts: logarithms show what few voxels have";
        if ui.selectable_label(!view.logarithmic, "Linear").on_hover_text(tooltip).clicked() {
            view.logarithmic = false;
        }
        if ui.selectable_label(view.logarithmic, "Log").on_hover_text(tooltip).clicked() {
            view.logarithmic = true;
        }
        function_map::choose_axis(ui, open);
        ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
            title(ui, open, wide);
            if wide {
                chosen_node(ui, open, gallery, positions, volume);
            }
        });
    });
    if !wide && open.node.is_some() {
        ui.horizontal_wrapped(|ui| chosen_node(ui, open, gallery, positions, volume));
    }
}

/// Whose function it is, and how a part's comes to be the object's again.
fn title(ui: &mut Ui, open: &mut OpenFigure, wide: bool) {
    let Some(chosen) = open.chosen_region().cloned() else {
        ui.label(theme::heading("Transfer function"));
        return;
    };
    let Some(region) = open.chosen().and_then(|o| o.regions.get(chosen.region)).cloned() else { return };
    let name = chosen.structure.clone().unwrap_or_else(|| region.title().to_owned());
    let is_own = open.has_own_function();
    let around = match chosen.structure {
        Some(_) if region.look.transfer_function.is_some() => "the group's",
        _ => "the object's",
    };
    let why = if is_own {
        format!("{name} has a transfer function of its own")
    } else {
        format!("{name} looks as its surroundings: its first edit makes a copy of {around} for it")
    };
    ui.scope(|ui| {
        ui.set_max_width(if wide { 0.34 } else { 0.5 } * ui.available_width());
        // What tells one from another comes first: the end may not have room.
        let text = theme::heading(&format!("{name}: transfer function"));
        ui.add(egui::Label::new(text).truncate()).on_hover_text(why);
    });
    if !is_own {
        if wide {
            ui.label(theme::small(ui.ctx(), format!("(as {around})")));
        }
        return;
    }
    let back = ui.button(format!("Back to {around}")).on_hover_text("Takes its own transfer function away");
    if back.clicked() {
        let look = LookTemplate { transfer_function: None, ..region.own_look(chosen.structure.as_deref()) };
        let Chosen { region, structure } = chosen;
        open.edit(Command::SetLook { object: open.object, region, structure, look });
        open.node = None;
    }
}

/// The fields of the chosen node, or how there comes to be one.
fn chosen_node(
    ui: &mut Ui,
    open: &mut OpenFigure,
    gallery: &Gallery,
    positions: Positions<'_>,
    volume: Option<&Volume>,
) {
    let nodes = open.function().map_or_else(Vec::new, |function| function.nodes);
    if let Some((n, node)) = open.node.and_then(|n| Some((n, nodes.get(n)?))) {
        node_fields(ui, open, gallery, positions, volume, n, node, nodes.len());
    } else {
        let hint = "Double-click adds a node, drag moves it, drop a style on a sphere or between";
        ui.add(egui::Label::new(theme::small(ui.ctx(), hint)).truncate());
    }
}

#[expect(clippy::too_many_arguments, reason = "one row of widgets")]
fn node_fields(
    ui: &mut Ui,
    open: &mut OpenFigure,
    gallery: &Gallery,
    positions: Positions<'_>,
    volume: Option<&Volume>,
    number: usize,
    node: &NodeTemplate,
    num_nodes: usize,
) {
    let of = open.function_of();
    ui.label(theme::small(ui.ctx(), format!("Node {}/{num_nodes}", number + 1)));
    let (mut at, mut percent) = (node.at, 100.0 * node.opacity);
    ui.label(theme::small(ui.ctx(), positions.name()));
    let unit = positions.unit(volume);
    let speed = positions.speed();
    let decimals = if speed >= 1.0 { 1 } else { 6 };
    let field = DragValue::new(&mut at).speed(speed).suffix(unit).max_decimals(decimals).update_while_editing(false);
    let response = ui.add(field.custom_parser(super::properties::parse_number)).accessible_name("Node value");
    let response =
        response.on_hover_text("Where the node is: data value, or percentile of what is above the background");
    let command =
        response.changed().then_some(Command::MoveNode { of: of.clone(), node: number, at, opacity: node.opacity });
    open.edit_by(&response, command);
    ui.label(theme::small(ui.ctx(), "opacity"));
    let field = DragValue::new(&mut percent).speed(0.5).range(0.0..=100.0).suffix(" %").max_decimals(1);
    let response = ui
        .add(field.update_while_editing(false).custom_parser(super::properties::parse_number))
        .accessible_name("Node opacity");
    let response =
        response.on_hover_text("Opacity of one reference length of this material (Properties: Opacity is per)");
    let moved = Command::MoveNode { of: of.clone(), node: number, at: node.at, opacity: percent / 100.0 };
    open.edit_by(&response, response.changed().then_some(moved));
    let combo = ComboBox::from_id_salt("node style").selected_text(gallery.title(&node.style)).width(110.0);
    let mut chosen = None;
    let response = combo.show_ui(ui, |ui| {
        for info in gallery.library().infos() {
            if ui.selectable_label(info.name == node.style, &info.title).clicked() {
                chosen = Some(info.name.clone());
            }
        }
    });
    let _ = response.response.accessible_name("Node style");
    if let Some(style) = chosen {
        open.edit(Command::SetStyle { of: of.clone(), nodes: number..number + 1, style });
    }
    let remove = ui.add_enabled(num_nodes > 1, egui::Button::new("Remove"));
    let why = "A transfer function needs one node at least";
    if remove.on_hover_text("Takes the node away (Delete)").on_disabled_hover_text(why).clicked() {
        open.edit(Command::RemoveNode { of, node: number });
        open.node = None;
    }
}

/// The wheel comes nearer, a drag of the paper moves along.
fn look_around(ui: &Ui, response: &Response, plot: Plot, whole: (f64, f64), view: &mut FunctionView) {
    let wheel = f64::from(ui.input(|i| i.smooth_scroll_delta().y));
    if let Some(at) = response.hover_pos().filter(|_| wheel != 0.0) {
        let (value, factor) = (plot.value(at.x), (-wheel / 200.0).exp());
        let (low, high) = (value + factor * (plot.low - value), value + factor * (plot.high - value));
        let (whole_low, whole_high) = whole;
        if (1e-4..=4.0).contains(&((high - low) / (whole_high - whole_low))) {
            view.range = Some((low, high));
        }
    }
    if response.dragged() {
        let by = f64::from(response.drag_delta().x) * plot.resolution();
        view.range = Some((plot.low - by, plot.high - by));
        ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
    }
}

#[expect(clippy::too_many_arguments, reason = "what a dot knows of its surroundings")]
fn nodes(
    ui: &Ui,
    open: &mut OpenFigure,
    plot: Plot,
    positions: Positions<'_>,
    values: &[f64],
    nodes: &[NodeTemplate],
    volume: Option<&Volume>,
    view: &mut FunctionView,
) {
    let tokens = theme::tokens(ui.ctx());
    let painter = ui.painter().clone();
    let of = open.function_of();
    for (i, node) in nodes.iter().enumerate() {
        let center = Pos2::new(plot.x(values[i]), plot.y(node.opacity));
        if !plot.spans(center.x) {
            continue;
        }
        let id = ui.scope_id().with(("node", i));
        let response =
            ui.interact(Rect::from_center_size(center, Vec2::splat(2.0 * GRAB)), id, Sense::click_and_drag());
        let described = format!("Node {} at {}{}", i + 1, round_to(node.at, 1e-4), positions.unit(volume));
        response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &described));
        if response.clicked() || response.drag_started() {
            open.node = Some(i);
        }
        let mut number = i;
        if response.drag_started() {
            open.document.begin();
            view.dragged = ui.input(|i| i.pointer.press_origin()).map(|from| (values[i], node.opacity, from));
            // The copy that goes along is the one on the side that the hand goes to.
            if ui.input(|i| i.modifiers.alt) {
                open.edit(Command::InsertNode { of: of.clone(), node: node.clone() });
                if response.total_drag_delta().is_some_and(|d| d.x > 0.0) {
                    number = i + 1;
                    open.node = Some(number);
                    ui.ctx().set_dragged_id(ui.scope_id().with(("node", number)));
                }
            }
        }
        if (response.dragged() || response.drag_stopped())
            && open.document.in_gesture()
            && let (Some((value, opacity, last)), Some(pointer)) =
                (&mut view.dragged, ui.input(|i| i.pointer.latest_pos()))
        {
            let fine = if ui.input(|i| i.modifiers.shift) { FINE } else { 1.0 };
            let by = pointer - std::mem::replace(last, pointer);
            *value += fine * f64::from(by.x) * plot.resolution();
            *opacity -= fine * f64::from(by.y / plot.rect.height());
            let at = positions.at(*value, fine * plot.resolution());
            let opacity = round_to(opacity.clamp(0.0, 1.0), 0.01 * fine);
            open.edit(Command::MoveNode { of: of.clone(), node: number, at, opacity });
            ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
        }
        if response.drag_stopped() {
            open.document.commit();
            view.dragged = None;
        }
        let is_chosen = open.node == Some(i);
        let fill = if is_chosen { tokens.accent } else { tokens.panel };
        let radius = if response.hovered() || is_chosen { DOT + 1.5 } else { DOT };
        painter.circle(center, radius, fill, Stroke::new(2.0, tokens.text));
        let text = format!("{}{} · {:.0} %", round_to(node.at, 1e-3), positions.unit(volume), 100.0 * node.opacity);
        if response.dragged() {
            paint_note(&painter, center - Vec2::Y * 14.0, &text, tokens);
        } else {
            response.clone().on_hover_text(text);
        }
        response.context_menu(|ui| {
            ui.set_min_width(140.0);
            if ui.add_enabled(nodes.len() > 1, egui::Button::new("Remove node")).clicked() {
                open.edit(Command::RemoveNode { of: of.clone(), node: i });
                open.node = None;
                ui.close();
            }
            if ui.button("Duplicate node").clicked() {
                open.edit(Command::InsertNode { of: of.clone(), node: node.clone() });
                open.node = Some(i + 1);
                ui.close();
            }
        });
    }
}

/// A material's nodes and the middle of its sphere.
struct PlacedSphere {
    run: Range<usize>,
    x: f32,
}

/// Each below the middle of its nodes, the more opaque ones counting more, none over another.
fn place_spheres(plot: Plot, values: &[f64], nodes: &[NodeTemplate]) -> Vec<PlacedSphere> {
    let mut placed: Vec<PlacedSphere> = materials(nodes)
        .into_iter()
        .map(|run| {
            let weights: Vec<f64> = run.clone().map(|i| nodes[i].opacity + 0.01).collect();
            let sum: f64 = run.clone().zip(&weights).map(|(i, w)| w * f64::from(plot.x(values[i]))).sum();
            PlacedSphere { x: (sum / weights.iter().sum::<f64>()) as f32, run }
        })
        .filter(|s| plot.spans(s.x))
        .collect();
    let apart = 2.0 * SPHERE + 6.0;
    for i in 1..placed.len() {
        placed[i].x = placed[i].x.max(placed[i - 1].x + apart);
    }
    // Pushed back from the right edge.
    let mut limit = plot.rect.right() - SPHERE;
    for sphere in placed.iter_mut().rev() {
        sphere.x = sphere.x.min(limit);
        limit = sphere.x - apart;
    }
    placed
}

fn material_spheres(
    ui: &Ui,
    open: &mut OpenFigure,
    gallery: &Gallery,
    nodes: &[NodeTemplate],
    spheres: &[PlacedSphere],
    (y, aimed_node): (f32, Option<usize>),
) {
    let tokens = theme::tokens(ui.ctx());
    for (i, PlacedSphere { run, x }) in spheres.iter().enumerate() {
        let center = Pos2::new(*x, y);
        let style = &nodes[run.start].style;
        let rect = Rect::from_center_size(center, Vec2::splat(2.0 * SPHERE));
        let response = ui.interact(rect, ui.scope_id().with(("sphere", i)), Sense::click_and_drag());
        let title = gallery.title(style).to_owned();
        response.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Material {}: {title}", i + 1)));
        response.dnd_set_drag_payload(DraggedStyle(style.clone()));
        let strongest = run.clone().max_by(|a, b| nodes[*a].opacity.total_cmp(&nodes[*b].opacity));
        if response.clicked() {
            open.node = strongest;
        }
        let painter = ui.painter();
        gallery.paint(painter, center, SPHERE, style);
        let aimed = response.dnd_hover_payload::<DraggedStyle>().is_some()
            || aimed_node.is_some_and(|node| run.contains(&node));
        let is_chosen = open.node.is_some_and(|n| run.contains(&n));
        if aimed || is_chosen || response.hovered() {
            let width = if aimed { 3.0 } else { 2.0 };
            painter.circle_stroke(center, SPHERE + 2.0, Stroke::new(width, tokens.accent));
        }
        response.on_hover_text(format!("{title}: drop another style here, or drag this one elsewhere"));
    }
}

/// A style that is dropped dresses the material, or the node, that it falls on; between them it becomes a node.
fn drop_style(
    ui: &Ui,
    open: &mut OpenFigure,
    response: &Response,
    plot: Plot,
    values: &[f64],
    nodes: &[NodeTemplate],
    spheres: &[PlacedSphere],
) {
    let Some(pointer) = ui.input(|i| i.pointer.latest_pos()).filter(|p| response.rect.contains(*p)) else { return };
    let node = (0..nodes.len())
        .filter(|i| Pos2::new(plot.x(values[*i]), plot.y(nodes[*i].opacity)).distance(pointer) < GRAB)
        .min_by(|a, b| {
            let far = |i: usize| Pos2::new(plot.x(values[i]), plot.y(nodes[i].opacity)).distance(pointer);
            far(*a).total_cmp(&far(*b))
        });
    let below_plot = pointer.y > plot.rect.bottom();
    let sphere = spheres.iter().find(|s| below_plot && (s.x - pointer.x).abs() < SPHERE + 3.0);
    if !egui::DragAndDrop::has_payload_of_type::<DraggedStyle>(ui.ctx()) {
        return;
    }
    if sphere.is_none() && node.is_none() && plot.rect.contains(pointer) {
        let accent = theme::tokens(ui.ctx()).accent;
        ui.painter().vline(pointer.x, plot.rect.y_range(), Stroke::new(1.5, accent));
    }
    if !ui.input(|i| i.pointer.any_released()) {
        return;
    }
    let Some(style) = egui::DragAndDrop::take_payload::<DraggedStyle>(ui.ctx()).map(|s| s.0.clone()) else { return };
    let of = open.function_of();
    if let Some(sphere) = sphere {
        open.edit(Command::SetStyle { of, nodes: sphere.run.clone(), style });
    } else if let Some(node) = node {
        open.edit(Command::SetStyle { of, nodes: node..node + 1, style });
        open.node = Some(node);
    } else {
        insert_node(open, plot.value(pointer.x), plot.resolution(), Some(style), None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(at: f64, style: &str, opacity: f64) -> NodeTemplate {
        NodeTemplate { at, style: style.to_owned(), opacity, extra: serde_json::Map::new() }
    }

    #[test]
    fn spheres_do_not_lie_on_each_other() {
        let rect = Rect::from_min_size(Pos2::ZERO, Vec2::new(200.0, 50.0));
        let plot = Plot { rect, low: 0.0, high: 100.0 };
        let nodes = [node(97.0, "a", 1.0), node(98.0, "b", 1.0), node(99.0, "c", 1.0)];
        let placed = place_spheres(plot, &[97.0, 98.0, 99.0], &nodes);
        assert!(placed.windows(2).all(|w| w[1].x - w[0].x >= 2.0 * SPHERE), "they overlap");
        assert!(placed[2].x <= 200.0 - SPHERE);
    }
}
