//! The picture and the hand on it: the figure's frame, gestures that move the view, the orientation cube, and the answer to
//! "what is this?".

use std::fmt::Display;
use std::sync::Arc;
use std::time::Instant;

use eframe::egui::epaint::PathShape;
use eframe::egui::{
    self, Align2, Area, Color32, ColorImage, Context, CursorIcon, EventFilter, FontId, Id, Key, Modifiers, Order,
    PointerButton, Pos2, Rect, Response, Role, Sense, Stroke, TextureHandle, TextureOptions, Ui, Vec2, WidgetInfo,
};
use fabrica_engine::error::printable;
use fabrica_engine::pick::{Pick, pick};
use fabrica_engine::scene::{Camera, Projection};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::labels::Label;
use glam::{DVec2, DVec3};

use super::gallery::{DraggedStyle, Gallery};
use super::gizmo::Gizmo;
use super::open_figure::OpenFigure;
use super::painter::{Painter, Request, Stage, Update};
use super::panels::curve::{dress_material, insert_node};
use super::panels::properties::shorter;
use super::panels::regions::dress;
use super::panels::transfer_function::FunctionView;
use super::slices::pane::is_tools;
use super::tools::FigureView;
use super::{theme, view};
use crate::figure::command::{Chosen, FunctionOf, function_at};
use crate::figure::template::CameraTemplate;
use crate::figure::theme::{Theme, Themes};
use crate::figure::{Command, Template};

/// Radians that an arrow key turns, and the share of the height that it moves with Shift.
const KEY_TURN: f64 = 5.0 * std::f64::consts::PI / 180.0;
const KEY_MOVE: f64 = 0.05;
/// Half the edge of the orientation cube, points.
const CUBE: f32 = 17.0;
/// What of the area belongs to the panels' edges.
const EDGE: f32 = 5.0;
/// Space around the frame.
const MARGIN: f32 = 28.0;

/// The picture in the frame, and what the painter was asked for.
#[derive(Default)]
pub struct Picture {
    texture: Option<TextureHandle>,
    /// How far it is; none while nothing has come.
    pub stage: Option<Stage>,
    /// The estimated error of the finished picture, 8-bit codes.
    pub error_codes: Option<f64>,
    /// The last request's number: older updates are late.
    number: u64,
    /// The last request of a figure that is not open any more.
    forgotten: u64,
    asked: Option<(Arc<Template>, [u32; 2], bool)>,
    asked_at: Option<Instant>,
    /// Pixels of the whole picture as shown, RGBA; kept for thumbnails.
    pixels: Vec<u8>,
    size: [usize; 2],
    /// Times from asking to the first rows, ms, of all requests so far.
    pub coarse_ms: Vec<f64>,
    /// Frames with dabs whose picture is still to come: when they began, and the request that shows them once there is one.
    dabs: Vec<(Instant, Option<u64>)>,
    /// Times from the beginning of a frame with dabs to the first picture that shows them, ms.
    pub dab_ms: Vec<f64>,
    /// When another theme was asked for whose picture is still to come, and the request that shows it.
    themed: Option<(Instant, u64)>,
    /// Times from asking for another theme to the first picture in it, ms.
    pub theme_ms: Vec<f64>,
}

impl Picture {
    /// Forgets the picture: another figure is open.
    pub fn clear(&mut self) {
        *self = Self {
            number: self.number,
            forgotten: self.number,
            coarse_ms: std::mem::take(&mut self.coarse_ms),
            dab_ms: std::mem::take(&mut self.dab_ms),
            theme_ms: std::mem::take(&mut self.theme_ms),
            ..Self::default()
        };
    }

    /// Whether it is as fine as the figure asks for.
    pub fn is_refined(&self) -> bool {
        matches!(self.stage, Some(Stage::Refined { .. }))
    }

    /// The picture, RGBA, with its columns and rows; none before the first whole one.
    pub fn pixels(&self) -> Option<(&[u8], [usize; 2])> {
        (!self.pixels.is_empty()).then_some((&self.pixels[..], self.size))
    }

    /// Asks for the figure anew, even if it is the one that was asked for last.
    pub fn ask_again(&mut self) {
        self.asked = None;
    }

    /// The figure in each of these themes, as it would be asked for.
    pub fn in_themes(&self, open: &OpenFigure, themes: &Themes) -> Vec<Request> {
        let (Some(sources), Some((_, size, _))) = (open.sources(), &self.asked) else { return Vec::new() };
        let in_theme = |theme: &Arc<Theme>| {
            let figure = Template { theme: Some(theme.name.clone()), ..Template::clone(open.document.figure()) };
            let sources = sources.clone();
            Request { figure: Arc::new(figure), sources, size: *size, coarse_only: true, is_painted: false }
        };
        themes.all().iter().map(in_theme).collect()
    }

    fn ask(&mut self, painter: &Painter, open: &OpenFigure, size: [u32; 2], rests: bool) {
        let figure = open.document.figure();
        let coarse_only = open.document.in_motion() && !rests;
        let same =
            |(f, s, c): &(Arc<Template>, [u32; 2], bool)| looks_same(f, figure) && *s == size && *c == coarse_only;
        if self.asked.as_ref().is_some_and(same) {
            return;
        }
        let Some(sources) = open.sources() else {
            // What is shown is of another volume.
            (self.stage, self.error_codes, self.asked, self.forgotten) = (None, None, None, self.number);
            return;
        };
        let is_painted = self.dabs.iter().any(|(_, shown_by)| shown_by.is_none());
        self.number = painter.ask(Request { figure: figure.clone(), sources, size, coarse_only, is_painted });
        self.dabs.iter_mut().for_each(|(_, shown_by)| *shown_by = shown_by.or(Some(self.number)));
        (self.stage, self.error_codes, self.asked_at) = (None, None, Some(Instant::now()));
        if self.asked.as_ref().is_some_and(|(before, ..)| before.theme != figure.theme) {
            self.themed = Some((Instant::now(), self.number));
        }
        self.asked = Some((figure.clone(), size, coarse_only));
    }

    /// A frame that began then has painted.
    pub fn has_dabs(&mut self, begun: Instant) {
        self.dabs.push((begun, None));
    }

    /// Takes in what the painter says; a fault of this picture comes back as a sentence.
    pub fn take(&mut self, ctx: &Context, update: Update) -> Option<String> {
        match update {
            Update::Failed { number, message } if number == self.number => {
                // Nothing more will come of it.
                self.stage = Some(Stage::Failed);
                return Some(message);
            }
            Update::Stopped { number } if number == self.number => self.stage = Some(Stage::Stopped),
            Update::Estimated { number, codes } if number == self.number => self.error_codes = Some(codes),
            // Of an older request, a coarse picture is still newer than what is seen: a hand that never rests sees it move.
            Update::Rows { number, size, y, num_rows, pixels, stage }
                if number == self.number || stage == Stage::Coarse && number > self.forgotten =>
            {
                if number == self.number
                    && let Some(asked) = self.asked_at.take()
                {
                    self.coarse_ms.push(asked.elapsed().as_secs_f64() * 1e3);
                }
                if let Some((asked, _)) = self.themed.take_if(|(_, shown_by)| *shown_by <= number) {
                    self.theme_ms.push(asked.elapsed().as_secs_f64() * 1e3);
                }
                let dab_ms = &mut self.dab_ms;
                self.dabs.retain(|(begun, shown_by)| {
                    let is_shown = shown_by.is_some_and(|shown_by| shown_by <= number);
                    if is_shown {
                        dab_ms.push(begun.elapsed().as_secs_f64() * 1e3);
                    }
                    !is_shown
                });
                let image = ColorImage::from_rgba_premultiplied([size[0], num_rows], &pixels);
                match &mut self.texture {
                    Some(texture) if texture.size() == size && num_rows < size[1] => {
                        texture.set_partial([0, y], image, TextureOptions::LINEAR);
                    }
                    Some(texture) => texture.set(image, TextureOptions::LINEAR),
                    none => *none = Some(ctx.load_texture("figure", image, TextureOptions::LINEAR)),
                }
                if num_rows == size[1] && stage != Stage::Coarse {
                    (self.pixels, self.size) = (pixels, size);
                } else if size == self.size && stage != Stage::Coarse {
                    let from = 4 * size[0] * y;
                    self.pixels[from..from + pixels.len()].copy_from_slice(&pixels);
                }
                self.stage = Some(stage);
            }
            _ => {}
        }
        None
    }
}

/// Whether two figures have the same picture, whatever they are called.
fn looks_same(a: &Arc<Template>, b: &Arc<Template>) -> bool {
    let same = |a: &Template, b: &Template| {
        a.volumes == b.volumes
            && a.selections == b.selections
            && a.objects == b.objects
            && a.camera == b.camera
            && a.background == b.background
            && a.theme == b.theme
            && a.quality == b.quality
    };
    Arc::ptr_eq(a, b) || same(a, b)
}

/// What was asked about, and where.
struct Answer {
    at: Pos2,
    pick: Pick,
    /// Whose transfer function is seen there.
    of: FunctionOf,
    figure: Arc<Template>,
}

/// What the pointer is on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Under {
    /// In the volume as it was read (RAS), mm: where it was, for what was moved.
    pub position_mm: DVec3,
    /// Data value.
    pub value: f64,
}

/// The viewport's own state.
#[derive(Default)]
pub struct Viewport {
    /// The picture.
    pub picture: Picture,
    answer: Option<Answer>,
    /// What the pointer is on, with where it was when that was found.
    under: Option<(Pos2, Arc<Template>, Option<Under>)>,
    /// The scene's region that is seen there.
    under_region: Option<usize>,
    /// What the drag does, and where the pointer was when it was last followed.
    motion: Option<(Motion, Pos2)>,
    /// What the hand can do here, for the status bar.
    pub hint: &'static str,
    /// A place that is marked in the picture: world, mm.
    pub marker_mm: Option<DVec3>,
    /// What was asked about last, until somebody takes it.
    asked: Option<Pick>,
    /// Whether the primary button is a tool's.
    pub is_tools: bool,
    /// Whether the hand rests within a gesture: the picture is refined all the same.
    pub rests: bool,
    /// Pixels of the whole picture.
    size: [u32; 2],
    gizmo: Gizmo,
    /// The figure as a tool sees it, where the primary button would be pressed on it.
    aimed: Option<FigureView>,
}

/// What a drag does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    Orbit,
    Pan,
    Dolly,
    Roll,
}

/// The motion of a drag: the left button orbits like the middle one while there is no other tool; with a pen, Space stands for
/// the middle button.
fn motion(button: PointerButton, modifiers: Modifiers, space: bool) -> Option<Motion> {
    match (button, modifiers.command || modifiers.ctrl, modifiers.shift) {
        (PointerButton::Secondary | PointerButton::Extra1 | PointerButton::Extra2, ..) => None,
        (_, true, true) => Some(Motion::Roll),
        (_, true, false) => Some(Motion::Dolly),
        // Krita's: Space alone moves the paper, with Shift it turns.
        (PointerButton::Primary, false, shift) if space => Some(if shift { Motion::Orbit } else { Motion::Pan }),
        (_, false, true) => Some(Motion::Pan),
        (_, false, false) => Some(Motion::Orbit),
    }
}

/// The largest rectangle of an aspect (width over height) in the middle of an area, on whole pixels.
fn frame_in(area: Rect, aspect: f32, pixels_per_point: f32) -> Rect {
    let width = area.width().min(area.height() * aspect).max(1.0);
    let snap = |x: f32| (x * pixels_per_point).round() / pixels_per_point;
    let size = Vec2::new(snap(width), snap(width / aspect)).max(Vec2::splat(1.0 / pixels_per_point));
    let min = area.center() - 0.5 * size;
    Rect::from_min_size(Pos2::new(snap(min.x), snap(min.y)), size)
}

impl Viewport {
    /// Escape: what is open here closes; whether anything was.
    pub fn dismiss(&mut self) -> bool {
        self.motion = None;
        self.gizmo.forget();
        self.answer.take().is_some()
    }

    /// What the pointer is on.
    pub fn under(&self) -> Option<Under> {
        self.under.as_ref().and_then(|(_, _, under)| *under)
    }

    /// The figure as a tool sees it, if it is under the pointer.
    pub fn aimed(&self) -> Option<FigureView> {
        self.aimed.clone()
    }

    /// The number, in the scene, of the region that the pointer is on.
    pub fn region_under(&self) -> Option<usize> {
        self.under_region
    }

    /// What was asked about since this was called last.
    pub fn take_asked(&mut self) -> Option<Pick> {
        self.asked.take()
    }

    /// Asks for the picture of the figure as it is now, after everything that may edit it in a frame: a frame sooner than the next.
    pub fn ask(&mut self, open: &OpenFigure, painter: &Painter) {
        if self.size != [0; 2] {
            self.picture.ask(painter, open, self.size, self.rests);
        }
    }

    /// Where the camera's frame lies, its picture, its gestures.
    pub fn show(&mut self, ui: &mut Ui, open: &mut OpenFigure, gallery: &Gallery, function_view: &mut FunctionView) {
        let area = ui.available_rect_before_wrap();
        // The panels' edges are theirs to be dragged.
        let response = ui.allocate_rect(area.shrink(EDGE), Sense::click_and_drag());
        let scale = ui.ctx().pixels_per_point();
        let page = open.document.figure().figure.clone();
        let frame = frame_in(area.shrink(MARGIN), (page.width_mm / page.height_mm) as f32, scale);
        let figure = open.document.figure().clone();
        let assumption = open.assumed_orientation().map(str::to_owned);
        response.widget_info(|| WidgetInfo::labeled(Role::Canvas, true, describe(&figure, assumption.is_some())));

        match self.is_tools {
            true => self.gizmo.forget(),
            false => {
                if let Some(scene) = open.scene(gallery.wardrobe()).filter(|_| open.chosen_region().is_some()) {
                    self.gizmo.follow(ui, open, &scene.camera, frame, &response);
                } else {
                    self.gizmo.forget();
                }
            }
        }
        self.drag(ui, &response, open, frame);
        self.keys(ui, &response, open);
        wheel(ui, &response, open, frame);
        let size = [frame.width(), frame.height()].map(|n| ((n * scale).round() as u32).max(1));
        // Asked for once nothing in this frame can edit the figure any more.
        self.size = size;

        let painter = ui.painter_at(area);
        painter.rect_filled(frame, 0.0, Color32::WHITE);
        if let Some(texture) = &self.picture.texture {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            // Without its volume, a figure's last picture is a memory.
            let tint = if open.missing().is_none() { Color32::WHITE } else { Color32::from_gray(110) };
            painter.image(texture.id(), frame, whole, tint);
        }
        paint_surroundings(ui, &painter, frame, &open.document.figure().camera, &page, assumption.as_deref());
        if let Some(marker_mm) = self.marker_mm
            && let Some(scene) = open.scene(gallery.wardrobe())
            && let Some(at) = seen_at(&scene.camera, marker_mm)
        {
            mark(&painter.with_clip_rect(frame), frame.center() + frame.height() * at);
        }
        self.gizmo.paint(ui, &painter, assumption.is_some());
        let at = Pos2::new(area.left() + 3.2 * CUBE, area.bottom() - 3.2 * CUBE);
        cube(ui, open, at, assumption.as_deref());

        self.hover(ui, &response, open, gallery, frame, size);
        function_view.marked = self.answer.as_ref().map(|a| a.pick.value).or(self.under().map(|u| u.value));
        let is_aimed = response.hovered() || response.is_pointer_button_down_on();
        let scene = (self.is_tools && is_aimed).then(|| open.scene(gallery.wardrobe())).flatten();
        self.aimed = scene.map(|scene| FigureView { frame, size, scene });
        if self.is_tools && (response.clicked() || response.drag_started()) {
            response.request_focus();
        }
        if response.clicked()
            && !self.is_tools
            && let Some(at) = response.interact_pointer_pos().filter(|at| !self.gizmo.is_at(*at))
        {
            self.ask_what(open, gallery, at, frame, size);
        }
        // A style that falls on the picture dresses the material that is seen there.
        let aimed = Self::aim(ui, &response, open, gallery, frame, size);
        open.aimed = aimed.as_ref().and_then(|(of, _)| Some((of.object, of.part.clone()?)));
        function_view.aimed = aimed.as_ref().filter(|(of, _)| *of == open.function_of()).map(|(_, node)| *node);
        if let Some((of, node)) = aimed
            && let Some(style) = response.dnd_release_payload::<DraggedStyle>()
        {
            open.aimed = None;
            drop_style(open, of, node, &style.0);
        }
        self.answer(ui, open, gallery, function_view);
    }

    fn drag(&mut self, ui: &Ui, response: &Response, open: &mut OpenFigure, frame: Rect) {
        let (modifiers, space) = ui.input(|i| (i.modifiers, i.key_down(Key::Space)));
        let buttons = [PointerButton::Primary, PointerButton::Middle];
        if response.drag_started() {
            response.request_focus();
            let button = buttons.into_iter().find(|b| response.dragged_by(*b)).filter(|_| !self.gizmo.is_held());
            let button = button.filter(|b| !(self.is_tools && is_tools(*b, modifiers, space)));
            let from = ui.input(|i| i.pointer.press_origin());
            self.motion = button.and_then(|b| motion(b, modifiers, space)).zip(from);
            if self.motion.is_some() {
                self.answer = None;
                open.document.begin();
            }
        }
        // The positions, not what egui calls the drag's delta: that leaves out the frames of the press and the release.
        let at = ui.input(|i| i.pointer.latest_pos());
        if let (Some((motion, last)), Some(at)) = (&mut self.motion, at)
            && open.document.in_gesture()
            && (response.dragged() || response.drag_stopped())
        {
            let (before, now) = (std::mem::replace(last, at) - frame.center(), at - frame.center());
            if before != now {
                let height = f64::from(frame.height().max(1.0));
                let (dx, dy) = (f64::from(now.x - before.x) / height, f64::from(now.y - before.y) / height);
                let camera = &open.document.figure().camera;
                let camera = match motion {
                    Motion::Orbit => view::orbit(camera, dx, dy),
                    Motion::Pan => view::pan(camera, dx, dy),
                    Motion::Dolly => view::dolly(camera, (-3.0 * dy).exp(), [0.0; 2]),
                    Motion::Roll => view::roll(camera, f64::from(before.angle() - now.angle())),
                };
                open.edit(Command::SetCamera(camera));
            }
            ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
        }
        if response.drag_stopped() && self.motion.take().is_some() {
            open.document.commit();
        }
        self.hint = if let Some(hint) = self.gizmo.hint() {
            hint
        } else if open.document.in_motion() {
            "Esc gives the drag up"
        } else {
            "Click: what is this? · Drag: orbit · Shift+drag: pan · Ctrl+Shift+drag: roll · Wheel: closer"
        };
    }

    /// The view by keys, while the viewport has the focus.
    fn keys(&self, ui: &Ui, response: &Response, open: &mut OpenFigure) {
        if !response.has_focus() {
            return;
        }
        let filter = EventFilter { horizontal_arrows: true, vertical_arrows: true, ..EventFilter::default() };
        ui.memory_mut(|m| m.set_focus_lock_filter(response.id, filter));
        let camera = &open.document.figure().camera;
        let mut moved: Option<CameraTemplate> = None;
        ui.input_mut(|i| {
            let arrows = [
                (Key::ArrowLeft, DVec2::NEG_X),
                (Key::ArrowRight, DVec2::X),
                (Key::ArrowUp, DVec2::NEG_Y),
                (Key::ArrowDown, DVec2::Y),
            ];
            for (key, by) in arrows {
                // Turned by view::orbit's half circle for a height.
                let turn = by * KEY_TURN / std::f64::consts::PI;
                if i.consume_key(Modifiers::SHIFT, key) {
                    moved = Some(view::pan(camera, KEY_MOVE * by.x, KEY_MOVE * by.y));
                } else if i.consume_key(Modifiers::NONE, key) {
                    moved = Some(view::orbit(camera, turn.x, turn.y));
                }
            }
            for (key, factor) in [(Key::Plus, 1.1), (Key::Equals, 1.1), (Key::Minus, 1.0 / 1.1)] {
                if i.consume_key(Modifiers::NONE, key) || i.consume_key(Modifiers::SHIFT, key) {
                    moved = Some(view::dolly(camera, factor, [0.0; 2]));
                }
            }
        });
        if let Some(camera) = moved {
            open.edit(Command::SetCamera(camera));
        }
    }

    fn pick_at(open: &mut OpenFigure, gallery: &Gallery, at: Pos2, frame: Rect, size: [u32; 2]) -> Option<Pick> {
        if !frame.contains(at) {
            return None;
        }
        let scene = open.scene(gallery.wardrobe())?;
        let share = (at - frame.min) / frame.size();
        let pixel = |share: f32, n: u32| ((share * n as f32) as u32).min(n - 1);
        pick(&scene, size, pixel(share.x, size[0]), pixel(share.y, size[1]))
    }

    fn hover(
        &mut self,
        ui: &Ui,
        response: &Response,
        open: &mut OpenFigure,
        gallery: &Gallery,
        frame: Rect,
        size: [u32; 2],
    ) {
        let at = response.hover_pos().filter(|_| !open.document.in_gesture());
        let Some(at) = at else {
            (self.under, self.under_region) = (None, None);
            return;
        };
        let figure = open.document.figure().clone();
        let known = |(p, f, _): &(Pos2, Arc<Template>, Option<Under>)| *p == at && Arc::ptr_eq(f, &figure);
        if self.under.as_ref().is_some_and(known) {
            return;
        }
        // While the pointer flies past, nobody reads.
        if ui.input(|i| i.pointer.velocity().length()) > 600.0 {
            return;
        }
        let found = Self::pick_at(open, gallery, at, frame, size);
        self.under_region = found.and_then(|p| p.region);
        self.under = Some((at, figure, found.map(|p| Under { position_mm: p.rest_mm, value: p.value })));
    }

    fn ask_what(&mut self, open: &mut OpenFigure, gallery: &Gallery, at: Pos2, frame: Rect, size: [u32; 2]) {
        let pick = Self::pick_at(open, gallery, at, frame, size);
        let figure = open.document.figure().clone();
        self.answer = pick.map(|pick| {
            let of = function_seen(open, &pick);
            // Where the curve that is shown is the one that is seen, too.
            if function_at(&figure, &of) == open.function() {
                open.node = Some(nearest_node(&figure, &of, &pick));
            }
            Answer { at, pick, of, figure }
        });
        self.asked = pick;
    }

    /// What a style that is carried over the picture would dress: whose transfer function, and which node of it.
    fn aim(
        ui: &Ui,
        response: &Response,
        open: &mut OpenFigure,
        gallery: &Gallery,
        frame: Rect,
        size: [u32; 2],
    ) -> Option<(FunctionOf, usize)> {
        response.dnd_hover_payload::<DraggedStyle>()?;
        let at = ui.input(|i| i.pointer.latest_pos())?;
        let pick = Self::pick_at(open, gallery, at, frame, size)?;
        let of = function_seen(open, &pick);
        let node = nearest_node(open.document.figure(), &of, &pick);
        Some((of, node))
    }

    /// The answer to "what is this?", beside the place that was asked about.
    fn answer(&mut self, ui: &Ui, open: &mut OpenFigure, gallery: &Gallery, view: &mut FunctionView) {
        let Some(answer) = &self.answer else { return };
        let figure = open.document.figure();
        // Another view shows something else there.
        if answer.figure.camera != figure.camera
            || answer.figure.volumes != figure.volumes
            || answer.figure.selections != figure.selections
        {
            self.answer = None;
            return;
        }
        let of = answer.of.clone();
        let Some(nodes) =
            function_at(figure, &of).map(|function| function.nodes_of(of.row).clone()).filter(|n| !n.is_empty())
        else {
            self.answer = None;
            return;
        };
        let node = nearest_node(figure, &of, &answer.pick);
        let unit = open.chosen_volume().map_or("", |v| v.modality.suffix());
        let structures = open.chosen_volume().and_then(|v| structures_at(v, answer.pick.rest_mm));
        let part = of.part.as_ref().and_then(|part| name_of(figure, of.object, part));
        let (at, value, gradient) = (answer.at, answer.pick.value, answer.pick.gradient);
        let painter = ui.painter();
        painter.circle_stroke(at, 6.0, Stroke::new(4.0, Color32::WHITE));
        painter.circle_stroke(at, 6.0, Stroke::new(2.0, theme::GIZMO));
        let (mut done, mut chooses) = (false, false);
        let area =
            Area::new(Id::unique("what is this")).order(Order::Foreground).fixed_pos(at + Vec2::new(16.0, -12.0));
        area.constrain(true).show(ui.ctx(), |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width(260.0);
                ui.horizontal(|ui| {
                    let (rect, _) = ui.allocate_exact_size(Vec2::splat(34.0), Sense::hover());
                    gallery.paint(ui.painter(), rect.center(), 16.0, &nodes[node].style);
                    ui.vertical(|ui| {
                        let numbers = format!("{value:.0}{unit}, gradient {gradient:.2}");
                        let strong = |text: &str| egui::RichText::new(text).strong();
                        let accent = theme::tokens(ui.ctx()).accent;
                        if let Some(part) = &part {
                            let tooltip = "Chooses it in the list of regions";
                            chooses |= ui.link(strong(part).color(accent)).on_hover_text(tooltip).clicked();
                            ui.label(theme::small(ui.ctx(), numbers));
                        } else {
                            let what = structures.unwrap_or(numbers);
                            ui.add(egui::Label::new(strong(&what)).wrap());
                        }
                        let style = gallery.title(&nodes[node].style);
                        ui.label(theme::small(
                            ui.ctx(),
                            format!("Style {style}, node {} of {}", node + 1, nodes.len()),
                        ));
                    });
                });
                ui.horizontal_wrapped(|ui| {
                    if part.is_some() {
                        let tooltip = "Chooses it in the list of regions, and its transfer function below";
                        chooses |= ui.button("Choose it").on_hover_text(tooltip).clicked();
                    }
                    if ui.button("New node here").on_hover_text("Puts a node at this value on its curve").clicked() {
                        open.choose(of.object, of.part.clone());
                        insert_node(open, value, 1.0, None, None);
                        done = true;
                    }
                    if ui.button("Show value").on_hover_text("Brings this value into the transfer function").clicked() {
                        let (low, high) = view.range.unwrap_or((value, value));
                        if !(low..high).contains(&value) {
                            view.range = None;
                        }
                        done = true;
                    }
                });
            });
        });
        if chooses {
            open.choose(of.object, of.part);
            open.node = Some(node);
            open.reveals_region = true;
            ui.ctx().request_repaint();
        }
        if done || chooses {
            self.answer = None;
        }
    }
}

/// What a part of an object is called.
fn name_of(figure: &Template, object: usize, part: &Chosen) -> Option<String> {
    let region = figure.objects.get(object)?.regions.get(part.region)?;
    Some(part.structure.clone().unwrap_or_else(|| region.title().to_owned()))
}

/// Whose transfer function shows what was picked.
fn function_seen(open: &OpenFigure, pick: &Pick) -> FunctionOf {
    let part = pick.region.and_then(|number| open.part_at(number));
    let row = pick.row;
    match part {
        Some((object, part, _)) => FunctionOf { object, part: Some(part), row },
        None => FunctionOf { row, ..FunctionOf::object(open.object) },
    }
}

/// A style that falls on what is seen: on a region's own transfer function, or the object's, on the node's material there; a region
/// without one of its own is dressed as a whole.
fn drop_style(open: &mut OpenFigure, of: FunctionOf, node: usize, style: &str) {
    let figure = open.document.figure();
    let own = |part: &Chosen| {
        let region = figure.objects.get(of.object)?.regions.get(part.region)?;
        Some(region.own_look(part.structure.as_deref()).transfer_function.is_some())
    };
    match &of.part {
        Some(part) if own(part) != Some(true) => dress(open, of.object, &part.clone(), style),
        _ => {
            let row = of.row;
            let shown = FunctionOf { row: open.row, ..of.clone() } == open.function_of();
            dress_material(open, of, node, style);
            if shown {
                open.choose_row(row);
                open.node = Some(node);
            }
        }
    }
}

/// Names and numbers of the structures at a place, if the volume shows structures; where they overlap, all of them.
pub fn structures_at(volume: &Volume, position_mm: DVec3) -> Option<String> {
    let label = |label: &Label| {
        let number = label.id.to_string();
        // Without a name it is called by its number.
        if label.name == number {
            format!("Structure {number}")
        } else {
            format!("{} (structure {number})", printable(label.name.clone()))
        }
    };
    let named: Vec<String> = volume.structures_at(position_mm).into_iter().map(label).collect();
    (!named.is_empty()).then(|| named.join(", "))
}

/// The node whose style a picked sample has most of.
fn nearest_node(figure: &Template, of: &FunctionOf, pick: &Pick) -> usize {
    let num_nodes = function_at(figure, of).map_or(1, |function| function.nodes_of(of.row).len());
    (pick.node.round().max(0.0) as usize).min(num_nodes.max(1) - 1)
}

fn wheel(ui: &Ui, response: &Response, open: &mut OpenFigure, frame: Rect) {
    let wheel = ui.input(|i| i.smooth_scroll_delta().y);
    let Some(at) = response.hover_pos().filter(|_| wheel != 0.0 && !open.document.in_gesture()) else { return };
    let height = f64::from(frame.height().max(1.0));
    let from_middle = at - frame.center();
    let place = [f64::from(from_middle.x) / height, -f64::from(from_middle.y) / height];
    let camera = view::dolly(&open.document.figure().camera, (f64::from(wheel) / 300.0).exp(), place);
    open.edit(Command::SetCamera(camera));
}

/// Where a place (world, mm) is seen, in heights of the picture to the right of its middle and down; none behind the eye.
fn seen_at(camera: &Camera, place_mm: DVec3) -> Option<Vec2> {
    let from_eye = place_mm - camera.eye_mm;
    let depth = match camera.projection {
        Projection::Perspective { .. } => from_eye.dot(camera.forward),
        Projection::Orthographic { .. } => 1.0,
    };
    let height = 2.0 * camera.half_height() * depth;
    let at = Vec2::new((from_eye.dot(camera.right) / height) as f32, (-from_eye.dot(camera.up) / height) as f32);
    (depth > 0.0 && at.is_finite()).then_some(at)
}

/// A small cross with a gap in the middle, on any background.
fn mark(painter: &egui::Painter, at: Pos2) {
    for (width, color) in [(4.0, Color32::WHITE), (2.0, theme::GIZMO)] {
        for side in [Vec2::X, -Vec2::X, Vec2::Y, -Vec2::Y] {
            // The edge goes around the ends, too.
            let edge = 0.5 * (width - 2.0);
            painter.line_segment([at + (4.0 - edge) * side, at + (11.0 + edge) * side], Stroke::new(width, color));
        }
    }
}

/// What somebody who does not see the picture is told of it.
fn describe(figure: &Template, is_assumed: bool) -> String {
    let [left, right, ..] = view::letters(&figure.camera).map(|letter| marked(letter, is_assumed));
    let objects: Vec<&str> = figure.objects.iter().filter(|o| o.visible).map(|o| o.title()).collect();
    let objects = if objects.is_empty() { "Nothing".to_owned() } else { objects.join(", ") };
    format!("Figure: {objects}, {}, {left} on the left, {right} on the right", view::side(&figure.camera))
}

/// Letters of the body as they are shown: with a question mark where no file says that they are right.
pub fn marked(letters: impl Display, is_assumed: bool) -> String {
    if is_assumed { format!("{letters}?") } else { letters.to_string() }
}

/// What is said beside letters that are assumed.
pub fn why_marked(assumption: &str) -> String {
    format!("The letters are assumed. {assumption}")
}

/// `assumption`: why the letters may be wrong, if they may.
fn paint_surroundings(
    ui: &Ui,
    painter: &egui::Painter,
    frame: Rect,
    camera: &CameraTemplate,
    page: &crate::figure::template::Page,
    assumption: Option<&str>,
) {
    let tokens = theme::tokens(ui.ctx());
    let color = if assumption.is_some() { tokens.warning } else { tokens.dim };
    let [left, right, top, bottom] = view::letters(camera);
    for (letters, at, anchor) in [
        (left, frame.left_center() - Vec2::X * 6.0, Align2::RIGHT_CENTER),
        (right, frame.right_center() + Vec2::X * 6.0, Align2::LEFT_CENTER),
        (top, frame.center_top() - Vec2::Y * 4.0, Align2::CENTER_BOTTOM),
        (bottom, frame.center_bottom() + Vec2::Y * 4.0, Align2::CENTER_TOP),
    ] {
        let text = marked(&letters, assumption.is_some());
        let rect = painter.text(at, anchor, text, FontId::proportional(14.0), color);
        if let Some(why) = assumption {
            let response = ui.interact(rect.expand(3.0), ui.scope_id().with(("letters", &letters)), Sense::hover());
            response.on_hover_text(why_marked(why));
        }
    }
    let mut caption = format!("{} x {} mm", shorter(page.width_mm), shorter(page.height_mm));
    // A small frame has the letter of its upper side there.
    if frame.width() > 280.0 {
        caption += &format!("   {} dpi", shorter(page.dpi));
    }
    let at = frame.left_top() - Vec2::Y * 6.0;
    painter.text(at, Align2::LEFT_BOTTOM, caption, FontId::proportional(11.0), tokens.dim);
}

/// A cube with a letter on each side, turned as the object is: a click on a side looks at it.
fn cube(ui: &Ui, open: &mut OpenFigure, center: Pos2, assumption: Option<&str>) {
    let (from, right, up) = view::axes(&open.document.figure().camera);
    let project = |p: DVec3| center + CUBE * Vec2::new(p.dot(right) as f32, -p.dot(up) as f32);
    let rect = Rect::from_center_size(center, Vec2::splat(3.4 * CUBE));
    let response = ui.interact(rect, ui.scope_id().with("cube"), Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, "Orientation cube"));
    let tokens = theme::tokens(ui.ctx());
    let painter = ui.painter();
    let sides = [
        ('R', DVec3::X),
        ('L', DVec3::NEG_X),
        ('A', DVec3::Y),
        ('P', DVec3::NEG_Y),
        ('S', DVec3::Z),
        ('I', DVec3::NEG_Z),
    ];
    let pointer = response.hover_pos().or(response.interact_pointer_pos());
    let mut chosen = None;
    for (letter, normal) in sides {
        let facing = normal.dot(from);
        if facing < 0.02 {
            continue;
        }
        let (a, b) = (normal.any_orthonormal_pair(), 1.0);
        let corners = [(b, b), (b, -b), (-b, -b), (-b, b)].map(|(s, t)| project(normal + s * a.0 + t * a.1));
        let hovered = pointer.is_some_and(|p| contains(&corners, p));
        if hovered {
            chosen = Some(normal);
        }
        let fill = if hovered { tokens.selected } else { tokens.raised };
        let fill = fill.lerp_to_gamma(tokens.canvas, 0.5 * (1.0 - facing as f32));
        painter.add(PathShape::convex_polygon(corners.to_vec(), fill, Stroke::new(1.0, tokens.border)));
        if facing > 0.25 {
            let font = FontId::proportional(8.0 + 6.0 * facing as f32);
            let color = if assumption.is_some() { tokens.warning } else { tokens.text };
            let text = marked(letter, assumption.is_some());
            painter.text(project(normal), Align2::CENTER_CENTER, text, font, color);
        }
    }
    let mut tooltip = "Click a side to look at it: right, left, anterior, posterior, superior, inferior".to_owned();
    if let Some(why) = assumption {
        tooltip = format!("{tooltip}.\n{}", why_marked(why));
    }
    let response = response.on_hover_text(tooltip);
    if response.clicked()
        && let Some(direction) = chosen
    {
        let camera = view::from_side(&open.document.figure().camera, direction);
        open.edit(Command::SetCamera(camera));
    }
}

/// Whether a point is inside a convex polygon, whichever way around its corners go.
fn contains(corners: &[Pos2; 4], p: Pos2) -> bool {
    let side = |i: usize| {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        (b - a).rot90().dot(p - a)
    };
    (0..4).all(|i| side(i) >= 0.0) || (0..4).all(|i| side(i) <= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drags_move_the_view_as_elsewhere() {
        let ctrl = Modifiers { ctrl: true, command: true, ..Modifiers::NONE };
        for (button, modifiers, space, expected) in [
            (PointerButton::Primary, Modifiers::NONE, false, Some(Motion::Orbit)),
            (PointerButton::Middle, Modifiers::NONE, false, Some(Motion::Orbit)),
            (PointerButton::Middle, Modifiers::SHIFT, false, Some(Motion::Pan)),
            (PointerButton::Middle, ctrl, false, Some(Motion::Dolly)),
            (PointerButton::Primary, Modifiers::NONE, true, Some(Motion::Pan)),
            (PointerButton::Primary, Modifiers::SHIFT, true, Some(Motion::Orbit)),
            (PointerButton::Primary, ctrl | Modifiers::SHIFT, true, Some(Motion::Roll)),
            (PointerButton::Secondary, Modifiers::NONE, false, None),
        ] {
            assert_eq!(motion(button, modifiers, space), expected, "{button:?} {modifiers:?} {space}");
        }
    }

    #[test]
    fn what_a_ray_meets_is_seen_where_the_ray_began() {
        use fabrica_engine::reference::ray::ray_from_pixel;
        let size = [300, 200];
        let projections = [Projection::Perspective { fov_y_deg: 35.0 }, Projection::Orthographic { height_mm: 90.0 }];
        for projection in projections {
            let (eye, forward) = (DVec3::new(30.0, -200.0, 40.0), DVec3::new(-0.1, 1.0, -0.2));
            let camera = Camera::looking(eye, forward, DVec3::Z, projection).unwrap();
            for [x, y] in [[0, 0], [150, 100], [299, 42], [17, 199]] {
                let ray = ray_from_pixel(&camera, size, x, y);
                let seen = seen_at(&camera, ray.origin_mm + 170.0 * ray.direction).unwrap();
                let pixel = 200.0 * seen + Vec2::new(149.5, 99.5);
                assert!((pixel - Vec2::new(x as f32, y as f32)).length() < 1e-3, "{x} {y}: {pixel}");
            }
            let behind = seen_at(&camera, eye - 10.0 * camera.forward);
            assert_eq!(behind.is_some(), matches!(projection, Projection::Orthographic { .. }));
        }
    }

    #[test]
    fn frames_lie_on_whole_pixels_and_keep_their_aspect() {
        let area = Rect::from_min_size(Pos2::new(3.3, 7.1), Vec2::new(801.7, 433.3));
        for (aspect, scale) in [(1.73, 1.0), (0.5, 1.25), (4.0, 2.0)] {
            let frame = frame_in(area, aspect, scale);
            assert!(area.expand(1.0).contains_rect(frame));
            assert!((frame.width() / frame.height() - aspect).abs() < 0.02 * aspect, "{frame}");
            for x in [frame.left(), frame.top(), frame.right(), frame.bottom()] {
                let pixels = x * scale;
                assert!((pixels - pixels.round()).abs() < 1e-2, "{frame} at {scale}");
            }
        }
    }
}
