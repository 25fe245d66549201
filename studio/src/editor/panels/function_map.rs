//! The map of a 2-D transfer function: value across, the second coordinate upwards, its rows as lines with their nodes, over how many
//! voxels there are of each pair. A row's curve is edited beside it.

use std::sync::Arc;

use eframe::egui::{
    self, Align2, Button, Color32, ColorImage, ComboBox, Context, CursorIcon, DragValue, FontId, Pos2, Rect, Role,
    Sense, Stroke, TextureHandle, TextureOptions, Ui, Vec2, WidgetInfo,
};
use fabrica_engine::Progress;
use fabrica_engine::scene::across::MAX_ROWS;
use fabrica_engine::selection::DistanceField;
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::joint::JointHistogram;
use serde_json::Map;

use super::super::files::Job;
use super::super::gallery::Gallery;
use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::curve::{Positions, opacity_at, round_to};
use super::plot::{Plot, color_at, paint_note};
use crate::figure::Command;
use crate::figure::template::{AcrossTemplate, AxisName, NodeTemplate, RowTemplate, TransferFunctionTemplate};

/// Cells of the map's picture.
const CELLS: [usize; 2] = [160, 80];
/// How near a press must come to a node or a row.
const GRAB: f32 = 8.0;
/// Radius of a node's dot.
const DOT: f32 = 4.5;
/// Room for the second coordinate's numbers.
const AXIS: f32 = 34.0;

/// How the map is looked at; no part of the figure.
#[derive(Default)]
pub struct MapView {
    joint: Joint,
    picture: Option<(PictureOf, TextureHandle)>,
    /// What is dragged, unrounded: value and place, and where the pointer was.
    dragged: Option<(f64, f64, Pos2)>,
}

/// What a picture of the map shows.
#[derive(PartialEq)]
struct PictureOf {
    function: TransferFunctionTemplate,
    values: (f64, f64),
    places: (f64, f64),
    joint: Option<usize>,
    paper: Color32,
    /// Of the nodes of all rows: a theme changes them.
    colors: Vec<Color32>,
}

/// The joint histogram, counted on a thread.
#[derive(Default)]
struct Joint {
    of: Option<JointOf>,
    counting: Option<Job<JointHistogram>>,
    counted: Option<Arc<JointHistogram>>,
    /// How many were counted, to tell one from another.
    number: usize,
}

/// What is counted.
struct JointOf {
    volume: Arc<Volume>,
    sigma_mm: f64,
    values: (f64, f64),
    places: (f64, f64),
    field: Option<Arc<DistanceField>>,
}

impl PartialEq for JointOf {
    fn eq(&self, other: &Self) -> bool {
        let field = |of: &Self| of.field.as_ref().map(Arc::as_ptr);
        Arc::ptr_eq(&self.volume, &other.volume)
            && field(self) == field(other)
            && (self.sigma_mm, self.values, self.places) == (other.sigma_mm, other.values, other.places)
    }
}

impl Joint {
    fn get(&mut self, ctx: &Context, of: JointOf) -> Option<(usize, Arc<JointHistogram>)> {
        if self.of.as_ref() != Some(&of) {
            if let Some(counting) = &self.counting {
                counting.progress.cancel();
            }
            let (volume, field, ctx) = (of.volume.clone(), of.field.clone(), ctx.clone());
            let (sigma_mm, values, places) = (of.sigma_mm, of.values, of.places);
            let count = move |progress: &Progress| {
                Ok(match field {
                    None => JointHistogram::of_edges(&volume, values, sigma_mm, progress)?,
                    Some(field) => JointHistogram::of_distances(&volume, values, &field, places, progress)?,
                })
            };
            self.counting = Some(Job::start("Joint histogram".to_owned(), move || ctx.request_repaint(), count));
            self.counted = None;
            self.of = Some(of);
        }
        if let Some(counted) = self.counting.as_ref().and_then(Job::finished) {
            self.counting = None;
            self.counted = counted.ok().map(Arc::new);
            self.number += 1;
        }
        self.counted.clone().map(|joint| (self.number, joint))
    }
}

/// The choice of a second coordinate, or of none.
pub fn choose_axis(ui: &mut Ui, open: &mut OpenFigure) {
    let Some(function) = open.whole_function() else { return };
    let by = function.across.as_ref().map(|across| across.by);
    let regions = names_to_measure_from(open);
    let title = |by: Option<AxisName>| {
        by.map_or("value alone", |by| match by {
            AxisName::Edge => "value × edge strength",
            AxisName::Distance => "value × distance",
            AxisName::Importance => "value × importance",
        })
    };
    let mut wanted = by;
    let combo = ComboBox::from_id_salt("second coordinate").selected_text(title(by)).width(150.0);
    let response = combo.show_ui(ui, |ui| {
        for other in std::iter::once(None).chain(AxisName::ALL.map(Some)) {
            let can = other != Some(AxisName::Distance) || !regions.is_empty();
            let row = ui.add_enabled(can, Button::selectable(other == by, title(other)));
            if row.on_disabled_hover_text("Add a region first: distances are measured from one").clicked() {
                wanted = other;
            }
        }
    });
    let response = response.response.accessible_name("Second coordinate");
    response.on_hover_text(
        "What opacity and style go by besides the value: the function then has rows, and blends from one to the next",
    );
    if wanted == by {
        return;
    }
    let label = wanted.map_or("Go by value alone".to_owned(), |by| format!("Go by value and {}", by.title()));
    let function = wanted.map_or_else(
        || function.row(open.row),
        |by| with_axis(&function, by, open.chosen_region().is_some(), &regions),
    );
    open.edit(Command::SetRows { of: open.function_of(), function, label });
    if open.fault.is_none() {
        open.choose_row(if wanted.is_some() { open.row } else { 0 });
    }
}

/// Titles of the object's regions: what distances can be measured from.
fn names_to_measure_from(open: &OpenFigure) -> Vec<String> {
    open.chosen().map_or_else(Vec::new, |object| object.regions.iter().map(|r| r.title().to_owned()).collect())
}

/// A function with another second coordinate: its rows, or two that are alike, so that nothing changes until one of them is edited.
fn with_axis(
    function: &TransferFunctionTemplate,
    by: AxisName,
    is_part: bool,
    regions: &[String],
) -> TransferFunctionTemplate {
    let (low, high) = match by {
        AxisName::Edge => (0.0, 0.5),
        AxisName::Distance => (0.0, 20.0),
        AxisName::Importance => (0.0, 2.0),
    };
    let num_rows = function.num_rows().max(2);
    let place = |row: usize| round_to(low + (high - low) * row as f64 / (num_rows - 1) as f64, 1e-3);
    let from =
        (by == AxisName::Distance).then(|| if is_part { regions.last() } else { regions.first() }.cloned()).flatten();
    let rows = (1..num_rows).map(|row| RowTemplate {
        at: place(row),
        nodes: function.nodes_of(row).clone(),
        extra: Map::new(),
    });
    let across = AcrossTemplate { by, from, at: place(0), rows: rows.collect(), extra: Map::new() };
    TransferFunctionTemplate { across: Some(across), ..function.clone() }
}

/// What of the second coordinate is shown.
fn places_shown(across: &AcrossTemplate) -> (f64, f64) {
    let places = across.places();
    let (low, high) = (places[0], places[places.len() - 1]);
    match across.by {
        AxisName::Edge => (low.min(0.0), high.max(1.0)),
        AxisName::Importance => (low.min(0.0), high.max(2.0)),
        AxisName::Distance => {
            // In round numbers, so that it does not follow every move of a row.
            let step = 10f64.powf((high.abs().max(low.abs()).max(5.0)).log10().floor());
            (((low / step).floor() - 1.0) * step, ((high / step).ceil() + 1.0) * step)
        }
    }
}

/// The map of the function that is worked on, in `area`. `values`: those at its left and right.
pub fn show(ui: &mut Ui, open: &mut OpenFigure, gallery: &Gallery, view: &mut MapView, area: Rect, values: (f64, f64)) {
    let Some(function) = open.whole_function() else { return };
    let Some(across) = function.across.clone() else { return };
    let rect = Rect::from_min_max(area.min + Vec2::new(AXIS, 4.0), area.max - Vec2::new(4.0, 16.0));
    if rect.height() < 24.0 || rect.width() < 40.0 {
        return;
    }
    let tokens = theme::tokens(ui.ctx());
    let volume = open.chosen_volume().cloned();
    let statistics = volume.as_deref().and_then(Volume::known_statistics);
    let positions = Positions::new(&function, statistics);
    let places = places_shown(&across);
    let map = MapPlot { plot: Plot { rect, low: values.0, high: values.1 }, places };
    let joint = volume.as_ref().filter(|_| across.by != AxisName::Importance).and_then(|volume| {
        let field = match across.by {
            AxisName::Distance => Some(open.distances_from(across.from.as_deref()?)?),
            _ => None,
        };
        let sigma_mm = open.chosen()?.gradient_scale_mm.unwrap_or_else(|| volume.grid.spacing_mm().min_element());
        view.joint.get(ui.ctx(), JointOf { volume: volume.clone(), sigma_mm, values, places, field })
    });
    let of = PictureOf {
        function: function.clone(),
        values,
        places,
        joint: joint.as_ref().map(|j| j.0),
        paper: tokens.field,
        colors: function.all_nodes().map(|node| gallery.mean(&node.style)).collect(),
    };
    if view.picture.as_ref().is_none_or(|(known, _)| *known != of) {
        let picture = picture(&function, &across, positions, &map, joint.as_ref().map(|j| &*j.1), gallery, tokens);
        let texture = ui.ctx().load_texture("map of the transfer function", picture, TextureOptions::LINEAR);
        view.picture = Some((of, texture));
    }
    let response = ui.allocate_rect(rect, Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Canvas, true, "Map of the transfer function"));
    if response.double_clicked()
        && let Some(at) = response.interact_pointer_pos()
        && function.num_rows() < MAX_ROWS
    {
        add_row(open, &function, map.place(at.y), map.resolution());
    }
    let painter = ui.painter().with_clip_rect(area);
    if let Some((_, texture)) = &view.picture {
        let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        painter.image(texture.id(), rect, whole, Color32::WHITE);
    }
    let font = FontId::proportional(11.0);
    for share in [0.0, 0.5, 1.0] {
        let place = map.places.0 + share * (map.places.1 - map.places.0);
        let align = [Align2::RIGHT_BOTTOM, Align2::RIGHT_CENTER, Align2::RIGHT_TOP][(2.0 * share) as usize];
        let text = format!("{}", round_to(place, 0.01) + 0.0);
        painter.text(Pos2::new(rect.left() - 4.0, map.y(place)), align, text, font.clone(), tokens.dim);
    }
    let name = match (&across.from, across.by) {
        (Some(from), AxisName::Distance) => format!("up: mm from {from}"),
        (_, by) => format!("up: {}", by.title()),
    };
    painter.text(rect.left_bottom() + Vec2::Y * 2.0, Align2::LEFT_TOP, name, font, tokens.dim);
    rows(ui, open, &function, &across, positions, &map, gallery, view);
}

/// Where values and places are on the map.
struct MapPlot {
    plot: Plot,
    places: (f64, f64),
}

impl MapPlot {
    fn y(&self, place: f64) -> f32 {
        let share = (place - self.places.0) / (self.places.1 - self.places.0);
        self.plot.rect.bottom() - share.clamp(-1.0, 2.0) as f32 * self.plot.rect.height()
    }

    fn place(&self, y: f32) -> f64 {
        let share = f64::from((self.plot.rect.bottom() - y) / self.plot.rect.height());
        self.places.0 + share * (self.places.1 - self.places.0)
    }

    /// Of the second coordinate, per pixel.
    fn resolution(&self) -> f64 {
        (self.places.1 - self.places.0) / f64::from(self.plot.rect.height().max(1.0))
    }
}

/// Puts a row where it belongs, and works on it.
fn add_row(open: &mut OpenFigure, function: &TransferFunctionTemplate, place: f64, resolution: f64) {
    let (function, row) = function.with_row(round_to(place, resolution));
    open.edit(Command::SetRows { of: open.function_of(), function, label: "Add row".to_owned() });
    if open.fault.is_none() {
        open.choose_row(row);
    }
}

/// The row that is worked on: where it is, one more, one less; what distances are measured from.
pub fn row_fields(ui: &mut Ui, open: &mut OpenFigure) {
    let Some(function) = open.whole_function() else { return };
    let Some(across) = &function.across else { return };
    let (row, num_rows) = (open.row.min(function.num_rows() - 1), function.num_rows());
    let of = open.function_of();
    let places = across.places();
    ui.label(theme::small(ui.ctx(), format!("Row {}/{num_rows} at", row + 1)));
    let mut at = places[row];
    let speed = if across.by == AxisName::Distance { 0.2 } else { 0.005 };
    let field =
        DragValue::new(&mut at).speed(speed).suffix(across.by.unit()).max_decimals(3).update_while_editing(false);
    let response = ui.add(field.custom_parser(super::properties::parse_number)).accessible_name("Row place");
    let label = format!("Move row to {}{}", round_to(at, 1e-3), across.by.unit());
    let moved = Command::SetRows { of: of.clone(), function: function.with_row_at(row, at), label };
    open.edit_by(&response, response.changed().then_some(moved));
    let more = ui.add_enabled(num_rows < MAX_ROWS, Button::new("Add row"));
    if more.on_hover_text("One more, half way to the next (double-click on the map)").clicked() {
        let next = places.get(row + 1).copied().unwrap_or_else(|| {
            let before = row.checked_sub(1).map_or(places[row] - 1.0, |before| places[before]);
            places[row] + (places[row] - before)
        });
        add_row(open, &function, places[row].midpoint(next), 1e-3);
    }
    let less = ui.add_enabled(num_rows > 2, Button::new("Remove row"));
    let why = "A 2-D function has two rows at least: choose \"value alone\" instead";
    if less.on_hover_text("Takes this row away").on_disabled_hover_text(why).clicked() {
        open.edit(Command::SetRows {
            of: of.clone(),
            function: function.without_row(row),
            label: "Remove row".to_owned(),
        });
        open.choose_row(row.min(num_rows - 2));
    }
    if across.by != AxisName::Distance {
        return;
    }
    let from = across.from.clone().unwrap_or_default();
    let mut wanted = None;
    let combo = ComboBox::from_id_salt("distance from").selected_text(format!("from {from}")).width(96.0).truncate();
    let response = combo.show_ui(ui, |ui| {
        for name in names_to_measure_from(open) {
            if ui.selectable_label(name == from, &name).clicked() {
                wanted = Some(name);
            }
        }
    });
    let _ = response.response.accessible_name("Distance from");
    if let Some(name) = wanted.filter(|name| *name != from) {
        let label = format!("Measure distances from {name}");
        let across = AcrossTemplate { from: Some(name), ..across.clone() };
        open.edit(Command::SetRows {
            of,
            function: TransferFunctionTemplate { across: Some(across), ..function.clone() },
            label,
        });
    }
}

/// The rows with their nodes, to be chosen and dragged.
#[expect(clippy::too_many_arguments, reason = "what a row knows of its surroundings")]
fn rows(
    ui: &Ui,
    open: &mut OpenFigure,
    function: &TransferFunctionTemplate,
    across: &AcrossTemplate,
    positions: Positions<'_>,
    map: &MapPlot,
    gallery: &Gallery,
    view: &mut MapView,
) {
    let tokens = theme::tokens(ui.ctx());
    let rect = map.plot.rect;
    let painter = ui.painter().with_clip_rect(rect.expand(GRAB));
    for (row, place) in across.places().into_iter().enumerate() {
        let (y, is_chosen) = (map.y(place), open.row == row);
        if !(rect.top() - 1.0..=rect.bottom() + 1.0).contains(&y) {
            continue;
        }
        let line = Rect::from_min_max(Pos2::new(rect.left(), y - 4.0), Pos2::new(rect.right(), y + 4.0));
        let response = ui.interact(line, ui.scope_id().with(("row", row)), Sense::click_and_drag());
        let described = format!("Row {} at {}{}", row + 1, round_to(place, 1e-3), across.by.unit());
        response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &described));
        if response.clicked() || response.drag_started() {
            open.choose_row(row);
        }
        drag(ui, &response, open, map, view, (0.0, place), |open, _, at| {
            let label = format!("Move row to {}{}", round_to(at, map.resolution()), across.by.unit());
            let whole = open.whole_function()?;
            Some(Command::SetRows { of: open.function_of(), function: whole.with_row_at(row, at), label })
        });
        if response.hovered() || response.dragged() {
            ui.ctx().set_cursor_icon(CursorIcon::ResizeVertical);
            paint_note(&painter, Pos2::new(rect.center().x, y - 6.0), &described, tokens);
        }
        let color = if is_chosen { tokens.accent } else { tokens.text.gamma_multiply(0.7) };
        painter.hline(rect.x_range(), y, Stroke::new(if is_chosen { 2.0 } else { 1.0 }, color));
        for (i, node) in function.nodes_of(row).iter().enumerate() {
            let value = positions.value(node.at);
            let center = Pos2::new(map.plot.x(value), y);
            if !map.plot.spans(center.x) {
                continue;
            }
            let dot = Rect::from_center_size(center, Vec2::splat(2.0 * GRAB));
            let response = ui.interact(dot, ui.scope_id().with(("row node", row, i)), Sense::click_and_drag());
            let described = format!("Row {}, node {} at {}", row + 1, i + 1, round_to(node.at, 1e-3));
            response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &described));
            if response.clicked() || response.drag_started() {
                open.choose_row(row);
                open.node = Some(i);
            }
            drag(ui, &response, open, map, view, (value, place), |open, value, _| {
                let at = positions.at(value, map.plot.resolution());
                Some(Command::MoveNode { of: open.function_of(), node: i, at, opacity: node.opacity })
            });
            if response.hovered() || response.dragged() {
                ui.ctx().set_cursor_icon(CursorIcon::ResizeHorizontal);
                let text = format!("{} · {:.0} %", round_to(node.at, 1e-3), 100.0 * node.opacity);
                paint_note(&painter, center - Vec2::Y * 8.0, &text, tokens);
            }
            let ring = if is_chosen && open.node == Some(i) { tokens.accent } else { tokens.text };
            painter.circle(center, DOT, gallery.mean(&node.style), Stroke::new(1.5, ring));
        }
    }
}

/// Follows a drag from a value and a place: one drag is one step.
fn drag(
    ui: &Ui,
    response: &egui::Response,
    open: &mut OpenFigure,
    map: &MapPlot,
    view: &mut MapView,
    (value, place): (f64, f64),
    command: impl Fn(&OpenFigure, f64, f64) -> Option<Command>,
) {
    if response.drag_started() {
        open.document.begin();
        view.dragged = ui.input(|i| i.pointer.press_origin()).map(|from| (value, place, from));
    }
    if (response.dragged() || response.drag_stopped())
        && open.document.in_gesture()
        && let (Some((value, place, last)), Some(pointer)) = (&mut view.dragged, ui.input(|i| i.pointer.latest_pos()))
    {
        let fine = if ui.input(|i| i.modifiers.shift) { 0.1 } else { 1.0 };
        let by = pointer - std::mem::replace(last, pointer);
        *value += fine * f64::from(by.x) * map.plot.resolution();
        *place -= fine * f64::from(by.y) * map.resolution();
        if let Some(command) = command(open, *value, round_to(*place, fine * map.resolution())) {
            open.edit(command);
        }
    }
    if response.drag_stopped() {
        open.document.commit();
        view.dragged = None;
    }
}

/// What the function makes of each value and place, over how many voxels there are of them.
fn picture(
    function: &TransferFunctionTemplate,
    across: &AcrossTemplate,
    positions: Positions<'_>,
    map: &MapPlot,
    joint: Option<&JointHistogram>,
    gallery: &Gallery,
    tokens: theme::Tokens,
) -> ColorImage {
    let places = across.places();
    let rows: Vec<(Vec<f64>, &Vec<NodeTemplate>, Vec<Color32>)> = (0..places.len())
        .map(|row| {
            let nodes = function.nodes_of(row);
            let means = nodes.iter().map(|node| gallery.mean(&node.style)).collect();
            (nodes.iter().map(|node| positions.value(node.at)).collect(), nodes, means)
        })
        .collect();
    // Straight color and opacity of a row at a value.
    let of_row = |row: usize, value: f64| {
        let (values, nodes, means) = &rows[row];
        (color_at(values, means, value), opacity_at(values, nodes, value) as f32)
    };
    let [columns, lines] = CELLS;
    let pixel = |i: usize| {
        let (column, line) = (i % columns, i / columns);
        let value = map.plot.low + (map.plot.high - map.plot.low) * (column as f64 + 0.5) / columns as f64;
        let share = 1.0 - (line as f64 + 0.5) / lines as f64;
        let place = map.places.0 + share * (map.places.1 - map.places.0);
        let upper = places.partition_point(|at| *at <= place);
        let (below, above, weight) = match upper {
            0 => (0, 0, 0.0),
            n if n == places.len() => (n - 1, n - 1, 0.0),
            n => (n - 1, n, ((place - places[n - 1]) / (places[n] - places[n - 1])) as f32),
        };
        let ((a, alpha_a), (b, alpha_b)) = (of_row(below, value), of_row(above, value));
        let (alpha_a, alpha_b) = ((1.0 - weight) * alpha_a, weight * alpha_b);
        let alpha = alpha_a + alpha_b;
        let color = if alpha > 0.0 { a.lerp_to_gamma(b, alpha_b / alpha) } else { a };
        let count = joint.filter(|joint| joint.most > 0).map_or(0.0, |joint| {
            let (x, y) = (column * joint.dims[0] / columns, (lines - 1 - line) * joint.dims[1] / lines);
            f64::from(joint.counts[x + joint.dims[0] * y]).ln_1p() / f64::from(joint.most).ln_1p()
        });
        let ground = tokens.field.lerp_to_gamma(tokens.text, 0.85 * count as f32);
        ground.lerp_to_gamma(color, 0.75 * alpha)
    };
    ColorImage::new(CELLS, (0..columns * lines).map(pixel).collect())
}
