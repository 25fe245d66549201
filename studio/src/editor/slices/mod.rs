//! Slice views: the volume cut in three directions through one place, the crosshair, beside the figure. They show the volume of
//! the chosen object as it is, whatever its look, and draw it on the spot: neither waits for the painter.
//!
//! The crosshair is on the middle of a voxel, so that each slice shows a layer of voxels as the scanner took it.

pub mod overlay;
pub mod pane;
pub mod window;

use std::sync::Arc;

use eframe::egui::{ComboBox, DragValue, Pos2, Rect, Ui, UiBuilder, Vec2};
use fabrica_engine::slice::anatomical::{Convention, Frame, Orientation};
use fabrica_engine::slice::{Filter, Window};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::Volume;
use glam::DVec3;

use self::pane::{Aim, Drag, Geometry, Pane};
use super::open_figure::OpenFigure;
use super::panels::properties::parse_number;
use super::theme;
use super::viewport::Under;

/// Between two views.
const GAP: f32 = 2.0;
/// The strip above them.
const STRIP: f32 = 34.0;

/// The three views and what they have in common.
#[derive(Default)]
pub struct SliceViews {
    /// Which side of the body is on which side of the picture.
    pub convention: Convention,
    /// What they show; none before they showed anything, and where a volume is missing.
    subject: Option<Subject>,
    /// By hand; none: what suits the volume.
    window: Option<Window>,
    panes: [Pane; 3],
    /// What the hand does, in which of them, and what it was like before.
    gesture: Option<(Drag, usize, Before)>,
    under: Option<Under>,
    /// What the hand can do here, while the pointer is on a slice.
    hint: Option<&'static str>,
    /// Whether the primary button is a tool's.
    pub is_tools: bool,
    /// Whether the wheel is a tool's.
    pub takes_wheel: bool,
    /// The slice on which a tool would be pressed just now.
    aimed: Option<usize>,
}

/// A volume and the place that is looked at.
#[derive(Clone)]
struct Subject {
    volume: Arc<Volume>,
    /// Whether its voxels are names, between which there is nothing.
    is_labels: bool,
    /// On the middle of a voxel.
    crosshair_mm: DVec3,
}

/// What a gesture may change.
#[derive(Clone, Copy)]
struct Before {
    crosshair_mm: DVec3,
    window: Option<Window>,
    view: Option<pane::View>,
}

impl SliceViews {
    /// None yet, with a side of the body on the right.
    pub fn new(convention: Convention) -> Self {
        Self { convention, ..Self::default() }
    }

    /// Another figure is open.
    pub fn forget_figure(&mut self) {
        *self = Self::new(self.convention);
    }

    /// They are not shown any more: pictures go.
    pub fn hide(&mut self) {
        self.abort();
        self.panes.iter_mut().for_each(Pane::forget_picture);
        (self.under, self.hint, self.aimed) = (None, None, None);
    }

    /// What the pointer is on in a slice.
    pub fn under(&self) -> Option<Under> {
        self.under
    }

    /// What the hand can do, while the pointer is on a slice.
    pub fn hint(&self) -> Option<&'static str> {
        self.hint
    }

    /// The place that is looked at: world (RAS), mm; none without a volume.
    pub fn crosshair_mm(&self) -> Option<DVec3> {
        self.subject.as_ref().map(|s| s.crosshair_mm)
    }

    /// Which slices meet there: the volume's layer number, from 0 and from the body's end that positions begin at, and how many
    /// there are.
    pub fn slice(&self, orientation: Orientation) -> Option<(usize, usize)> {
        let subject = self.subject.as_ref()?;
        let frame = Frame::of(&subject.volume.grid, orientation, self.convention);
        Some((frame.slice_at(frame.position_mm(subject.crosshair_mm)), frame.num_slices))
    }

    /// Which values are black and white; none without a volume, and for colors.
    pub fn window(&self) -> Option<Window> {
        let volume = &self.subject.as_ref()?.volume;
        volume.colors.is_none().then(|| self.window.unwrap_or_else(|| window::of_volume(volume)))
    }

    /// Where a place on the screen lies in the body, for tools that work in slices; none beside the slices. It holds for what was
    /// shown last.
    pub fn aim(&self, at: Pos2) -> Option<Aim> {
        self.panes.iter().find_map(|pane| pane.aim(at))
    }

    /// Which slice the primary button would be pressed on for a tool, and how it lies on the screen; none where something else is
    /// under the pointer.
    pub fn aimed(&self) -> Option<(Orientation, Geometry)> {
        self.panes[self.aimed?].shown().copied()
    }

    /// How the slice of an orientation lies on the screen; none before it was shown.
    pub fn geometry(&self, orientation: Orientation) -> Option<Geometry> {
        let shown = self.panes.iter().filter_map(Pane::shown);
        shown.copied().find(|(shown, _)| *shown == orientation).map(|(_, geometry)| geometry)
    }

    /// Looks at a place; outside of the volume, at the voxel that is nearest to it.
    pub fn look_at(&mut self, place_mm: DVec3) {
        if let Some(subject) = &mut self.subject {
            subject.crosshair_mm = on_voxel(&subject.volume.grid, place_mm);
        }
    }

    /// Shows all of the volume in each slice.
    pub fn fit(&mut self) {
        self.panes.iter_mut().for_each(|pane| pane.view = None);
    }

    /// The grays that suit the volume.
    pub fn reset_window(&mut self) {
        self.window = None;
    }

    /// Gives a gesture up: everything is as it was before; whether there was one.
    pub fn abort(&mut self) -> bool {
        let Some((_, pane, before)) = self.gesture.take() else { return false };
        self.window = before.window;
        self.panes[pane].view = before.view;
        self.look_at(before.crosshair_mm);
        true
    }

    /// Follows the figure to another volume.
    fn follow(&mut self, open: &OpenFigure) {
        let figure = open.document.figure();
        let slot = open.chosen_slot().or((!figure.volumes.is_empty()).then_some(0)).map(|n| &figure.volumes[n]);
        let Some((slot, volume)) = slot.and_then(|slot| Some((slot, open.volume_of(slot)?))) else {
            self.subject = None;
            return;
        };
        let is_labels = slot.labels;
        match &mut self.subject {
            Some(subject) if Arc::ptr_eq(&subject.volume, volume) => subject.is_labels = is_labels,
            // Another frame of the same scan is looked at in the same way.
            Some(subject) if subject.volume.grid == volume.grid => {
                (subject.volume, subject.is_labels) = (volume.clone(), is_labels);
            }
            subject => {
                let grid = &volume.grid;
                let middle = DVec3::from_array(grid.dims().map(|n| (n / 2) as f64));
                let middle = grid.world_from_index().transform_point3(middle);
                *subject = Some(Subject { volume: volume.clone(), is_labels, crosshair_mm: on_voxel(grid, middle) });
                self.panes = Default::default();
                (self.window, self.gesture) = (None, None);
            }
        }
    }

    /// The strip and the slices in their places; what is left is the figure's.
    pub fn show(&mut self, ui: &mut Ui, open: &OpenFigure) -> Rect {
        self.follow(open);
        let area = ui.available_rect_before_wrap();
        let strip = Rect::from_min_size(area.min, Vec2::new(area.width(), STRIP.min(area.height())));
        let views = Rect::from_min_max(strip.left_bottom(), area.max);
        ui.painter().rect_filled(area, 0.0, theme::tokens(ui.ctx()).hairline);
        ui.painter().rect_filled(strip, 0.0, theme::tokens(ui.ctx()).panel);
        let builder = UiBuilder::new().id_salt("slice strip").max_rect(strip.shrink2(Vec2::new(8.0, 4.0)));
        ui.scope_builder(builder, |ui| ui.horizontal_centered(|ui| self.strip(ui)));
        // As 3D Slicer lays them out: axial, figure; coronal, sagittal.
        let middle = views.center();
        let place = |right: bool, below: bool| {
            let x = if right { [middle.x + 0.5 * GAP, views.right()] } else { [views.left(), middle.x - 0.5 * GAP] };
            let y = if below { [middle.y + 0.5 * GAP, views.bottom()] } else { [views.top(), middle.y - 0.5 * GAP] };
            Rect::from_min_max(Pos2::new(x[0], y[0]), Pos2::new(x[1], y[1]))
        };
        let places = [place(false, false), place(false, true), place(true, true)];
        (self.under, self.hint, self.aimed) = (None, None, None);
        let overlays = self.subject.as_ref().map(|s| overlay::of(open, &s.volume)).unwrap_or_default();
        match self.subject.clone() {
            Some(subject) => self.panes(ui, subject, places, &overlays),
            None => {
                for place in places {
                    ui.painter().rect_filled(place, 0.0, theme::tokens(ui.ctx()).canvas);
                    let builder = UiBuilder::new().max_rect(place.shrink(12.0));
                    ui.scope_builder(builder, |ui| ui.label(theme::small(ui.ctx(), "The volume was not found")));
                }
            }
        }
        place(true, false)
    }

    fn panes(&mut self, ui: &mut Ui, mut subject: Subject, places: [Rect; 3], overlays: &[overlay::Overlay]) {
        let frames = Orientation::ALL.map(|o| Frame::of(&subject.volume.grid, o, self.convention));
        let pictures = places.map(|place| pane::picture_in(place, ui.ctx().pixels_per_point()));
        let mm_per_point = pane::fitting(&subject.volume.grid, &frames, &pictures);
        let window = self.window.unwrap_or_else(|| window::of_volume(&subject.volume));
        for (i, orientation) in Orientation::ALL.into_iter().enumerate() {
            let context = pane::Context {
                orientation,
                frames: &frames,
                convention: self.convention,
                volume: &subject.volume,
                is_labels: subject.is_labels,
                fitting_mm_per_point: mm_per_point,
                window,
                overlays,
                is_tools: self.is_tools,
                takes_wheel: self.takes_wheel,
            };
            let builder = UiBuilder::new().id_salt(orientation.name()).max_rect(places[i]);
            let pane = &mut self.panes[i];
            let before = Before { crosshair_mm: subject.crosshair_mm, window: self.window, view: pane.view };
            let under_way = self.gesture.as_ref().filter(|(_, pane, _)| *pane == i).map(|(drag, ..)| *drag);
            let done = ui.scope_builder(builder, |ui| {
                pane.show(ui, &context, places[i], pictures[i], subject.crosshair_mm, under_way)
            });
            let done = done.inner;
            if let Some(place_mm) = done.crosshair_mm {
                subject.crosshair_mm = on_voxel(&subject.volume.grid, place_mm);
            }
            if let Some(window) = done.window {
                self.window = window;
                ui.ctx().request_repaint();
            }
            match (done.drag, under_way) {
                (Some(drag), None) => self.gesture = Some((drag, i, before)),
                (None, Some(_)) => self.gesture = None,
                _ => {}
            }
            if done.is_aimed {
                self.aimed = Some(i);
            }
            if done.is_hovered {
                self.under = done.under;
                self.hint = Some(if done.drag.is_some() { pane::DRAG_HINT } else { pane::HINT });
            }
        }
        if Some(subject.crosshair_mm) != self.crosshair_mm() {
            // Slices before this one show the old place still.
            ui.ctx().request_repaint();
            self.look_at(subject.crosshair_mm);
        }
    }

    /// Grays, sides.
    fn strip(&mut self, ui: &mut Ui) {
        let Some(subject) = self.subject.clone() else { return };
        let unit = subject.volume.modality.suffix();
        match self.window() {
            None => drop(ui.label(theme::small(ui.ctx(), "Colors as they are"))),
            Some(Window { mut level, mut width }) => {
                let speed = 0.004 * width;
                let decimals = window::decimals(width);
                let number = |ui: &mut Ui, label: &str, tooltip: &str, value: &mut f64| {
                    let text = ui.label(theme::small(ui.ctx(), label));
                    let field = DragValue::new(value).speed(speed).suffix(unit).max_decimals(decimals);
                    let field = field.update_while_editing(false).custom_parser(parse_number);
                    let tooltip = format!("{tooltip}. Right-drag in a slice: to the side and up; double-click: reset");
                    ui.add(field).labelled_by(text.id).accessible_name(label).on_hover_text(tooltip).changed()
                };
                let wider = number(ui, "Window", "From black to white, in data values", &mut width);
                let moved = number(ui, "Level", "The data value that becomes middle gray", &mut level);
                if wider || moved {
                    self.window = Some(Window { level, width: width.max(window::least_width(level)) });
                }
                self.presets(ui, &subject.volume);
            }
        }
        ui.separator();
        for convention in [Convention::Radiological, Convention::Neurological] {
            let tooltip = match convention {
                Convention::Radiological => "The patient's right on the left of axial and coronal slices",
                Convention::Neurological => "The patient's right on the right of axial and coronal slices",
            };
            if ui.selectable_label(self.convention == convention, convention.name()).on_hover_text(tooltip).clicked() {
                self.convention = convention;
            }
        }
    }

    fn presets(&mut self, ui: &mut Ui, volume: &Volume) {
        let presets = window::presets(volume);
        let now = self.window;
        let name = presets.iter().find(|(_, window)| *window == now).map_or("By hand", |(name, _)| name);
        let combo = ComboBox::from_id_salt("window presets").selected_text(name).show_ui(ui, |ui| {
            for (name, window) in &presets {
                if ui.selectable_label(*window == now, *name).clicked() {
                    self.window = *window;
                }
            }
        });
        combo.response.accessible_name("Window preset").on_hover_text("Grays for what one wants to see");
    }
}

/// The middle of the voxel at a place, or of the one that is nearest to it.
fn on_voxel(grid: &Grid, place_mm: DVec3) -> DVec3 {
    Orientation::ALL.into_iter().fold(clamped(grid, place_mm), |place, orientation| {
        // What the sides are called moves no slice.
        let frame = Frame::of(grid, orientation, Convention::Radiological);
        frame.moved_to(place, frame.slice_mm(frame.slice_at(frame.position_mm(place))))
    })
}

/// A place in the volume's box, or the one of it that is nearest along its index axes.
fn clamped(grid: &Grid, place_mm: DVec3) -> DVec3 {
    let (low, high) = grid.index_box();
    let index = grid.index_from_world().transform_point3(place_mm).clamp(low, high);
    grid.world_from_index().transform_point3(index)
}

/// What lies between voxels, in a picture with so many pixels to a voxel.
fn filter_for(is_labels: bool, pixels_per_voxel: f64) -> Filter {
    // Large enough, one wants to see voxels and not what was made up between them.
    if is_labels || pixels_per_voxel > 8.0 { Filter::Nearest } else { Filter::Linear }
}
