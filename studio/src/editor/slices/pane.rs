//! One slice: its head with the position, its picture, its crosshair, and the hand on it.

use std::sync::Arc;

use eframe::egui::{
    self, Align, Align2, Color32, ColorImage, CursorIcon, DragValue, Event, EventFilter, FontId, Key, Layout,
    Modifiers, MouseWheelUnit, PointerButton, Pos2, Rect, Response, Role, Sense, Slider, Stroke, StrokeKind,
    TextureHandle, TextureOptions, Ui, UiBuilder, Vec2, WidgetInfo,
};
use fabrica_engine::slice::anatomical::{Convention, Frame, Orientation};
use fabrica_engine::slice::{self, Filter, Plane, Sample, Window};
use fabrica_engine::spaces::{Grid, direction_letters};
use fabrica_engine::volume::Volume;
use glam::DVec3;

use super::super::panels::properties::{parse_number, shorter};
use super::super::theme;
use super::super::viewport::Under;
use super::overlay::{self, Overlay};
use super::{clamped, filter_for, window};

/// What the hand can do on a slice, and while it does.
pub const HINT: &str = "Drag: crosshair · Shift+move: crosshair · Wheel: slices · Ctrl+wheel: closer · Middle drag: pan · Right drag: window";
/// While it drags.
pub const DRAG_HINT: &str = "Esc gives the drag up";
/// Height of the head.
const HEAD: f32 = 28.0;
/// Space for letters around what is fitted in.
const MARGIN: f32 = 22.0;
/// Around the middle of the crosshair, where the slice is not covered.
const CROSSHAIR_GAP: f32 = 7.0;
/// Points that are a notch of a wheel, of devices that do not count in notches.
const POINTS_PER_NOTCH: f32 = 50.0;
/// Share of the picture that Shift and an arrow move by.
const KEY_MOVE: f32 = 0.05;
/// mm per point at least and at most, in those that show all.
const ZOOMS: (f64, f64) = (0.005, 4.0);

/// Where a slice is looked at, once it is not all of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// What is in the middle of the picture: world, mm; its position along the normal does not matter.
    pub center_mm: DVec3,
    /// How much is seen.
    pub mm_per_point: f64,
}

/// What a drag does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drag {
    /// Moves the crosshair.
    Crosshair,
    /// Makes the window wider or brighter.
    Window,
    /// Moves the slice with the hand.
    Pan,
    /// Brings it closer.
    Zoom,
}

/// What a drag does: as in the figure, with the crosshair where that turns.
fn drag_of(button: PointerButton, modifiers: Modifiers, space: bool) -> Option<Drag> {
    match (button, modifiers.command || modifiers.ctrl) {
        (PointerButton::Extra1 | PointerButton::Extra2, _) => None,
        (PointerButton::Secondary, _) => Some(Drag::Window),
        (_, true) => Some(Drag::Zoom),
        (PointerButton::Middle, false) => Some(Drag::Pan),
        (PointerButton::Primary, false) => Some(if space || modifiers.shift { Drag::Pan } else { Drag::Crosshair }),
    }
}

/// Whether a button is a tool's while there is one: the primary one, unless it stands for another.
pub fn is_tools(button: PointerButton, modifiers: Modifiers, space: bool) -> bool {
    button == PointerButton::Primary && !space && !modifiers.command && !modifiers.ctrl
}

/// How a slice lies on the screen: from pointer positions to places in the body and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// The picture's place, in points.
    pub rect: Rect,
    /// What is in its middle, on the slice: world, mm.
    pub center_mm: DVec3,
    /// How much is seen.
    pub mm_per_point: f64,
    /// Which way the slice lies.
    pub frame: Frame,
}

impl Geometry {
    /// The place in the body (world, mm; on the slice) at a position of the pointer.
    pub fn place_mm(&self, at: Pos2) -> DVec3 {
        let from_middle = at - self.rect.center();
        let (x, y) = (f64::from(from_middle.x) * self.mm_per_point, f64::from(from_middle.y) * self.mm_per_point);
        self.center_mm + x * self.frame.right - y * self.frame.up
    }

    /// Where a place in the body is seen, or what is before or behind it.
    pub fn position(&self, place_mm: DVec3) -> Pos2 {
        let by = (place_mm - self.center_mm) / self.mm_per_point;
        self.rect.center() + Vec2::new(by.dot(self.frame.right) as f32, -by.dot(self.frame.up) as f32)
    }

    /// The slice with the screen's pixels on it.
    pub fn plane(&self, pixels_per_point: f32) -> Plane {
        let pixel_mm = self.mm_per_point / f64::from(pixels_per_point);
        let half = Vec2::splat(0.5 / pixels_per_point);
        Plane {
            origin_mm: self.place_mm(self.rect.min + half),
            right_mm: pixel_mm * self.frame.right,
            down_mm: -pixel_mm * self.frame.up,
            size: [self.rect.width(), self.rect.height()].map(|n| (n * pixels_per_point).round() as usize),
        }
    }
}

/// What the pointer is on in a slice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Which slice.
    pub orientation: Orientation,
    /// Where, on the slice: world (RAS), mm.
    pub place_mm: DVec3,
    /// From the eye into the picture: a unit vector in RAS.
    pub view_direction: DVec3,
    /// How large a point of the screen is there, mm.
    pub mm_per_point: f64,
}

/// What all slices have in common, and which of them it is.
pub struct Context<'a> {
    /// Which.
    pub orientation: Orientation,
    /// How those of [`Orientation::ALL`] lie.
    pub frames: &'a [Frame; 3],
    /// Which side is which.
    pub convention: Convention,
    /// What is shown.
    pub volume: &'a Arc<Volume>,
    /// Whether there is nothing between its voxels.
    pub is_labels: bool,
    /// The scale in which all three are seen whole.
    pub fitting_mm_per_point: f64,
    /// Black and white.
    pub window: Window,
    /// Selections that lie over it.
    pub overlays: &'a [Overlay],
    /// Whether the primary button is a tool's.
    pub is_tools: bool,
    /// Whether the wheel is, too.
    pub takes_wheel: bool,
}

/// What came of the hand on a slice.
#[derive(Default)]
pub struct Done {
    /// The crosshair was moved: anywhere in the world, mm.
    pub crosshair_mm: Option<DVec3>,
    /// The window was changed, or reset.
    pub window: Option<Option<Window>>,
    /// The drag that is under way.
    pub drag: Option<Drag>,
    /// Whether the pointer is on it.
    pub is_hovered: bool,
    /// Whether what the primary button does there is meant for a tool.
    pub is_aimed: bool,
    /// What it is on.
    pub under: Option<Under>,
}

/// One slice's own state.
#[derive(Default)]
pub struct Pane {
    /// Where it is looked at; none: all of it.
    pub view: Option<View>,
    picture: Option<Picture>,
    shown: Option<(Orientation, Geometry)>,
    /// Parts of a notch that the wheel has turned.
    notches: f32,
    last: Option<Pos2>,
}

/// A picture with what it is of.
struct Picture {
    texture: TextureHandle,
    volume: Arc<Volume>,
    plane: Plane,
    filter: Filter,
    window: Window,
    /// Its pixels without what lies over them.
    plain: Vec<[u8; 4]>,
    overlays: Vec<Overlay>,
}

/// Where a slice's picture is in its place: below the head, on whole pixels.
pub fn picture_in(place: Rect, pixels_per_point: f32) -> Rect {
    let snap = |x: f32| (x * pixels_per_point).round() / pixels_per_point;
    let [left, right] = [place.left(), place.right()].map(snap);
    let [top, bottom] = [(place.top() + HEAD).min(place.bottom() - 1.0), place.bottom()].map(snap);
    Rect::from_min_max(Pos2::new(left, top), Pos2::new(right.max(left + 1.0), bottom.max(top + 1.0)))
}

/// The one scale, mm per point, in which all slices are seen whole: a thing has the same size in each.
pub fn fitting(grid: &Grid, frames: &[Frame; 3], pictures: &[Rect; 3]) -> f64 {
    let of_one = |(frame, picture): (&Frame, &Rect)| {
        let [across, along] = frame.extent_mm(grid).map(|[low, high]| high - low);
        let room = (picture.size() - Vec2::splat(2.0 * MARGIN)).max(Vec2::splat(8.0));
        (across / f64::from(room.x)).max(along / f64::from(room.y))
    };
    frames.iter().zip(pictures).map(of_one).fold(f64::MIN_POSITIVE, f64::max)
}

/// By which color one knows an orientation: 3D Slicer's. The heads name them, too.
fn color(orientation: Orientation) -> Color32 {
    match orientation {
        Orientation::Axial => Color32::from_rgb(0xf3, 0x4a, 0x33),
        Orientation::Coronal => Color32::from_rgb(0x6e, 0xb0, 0x4b),
        Orientation::Sagittal => Color32::from_rgb(0xed, 0xd5, 0x4c),
    }
}

/// The letters of an orientation's positions above and below 0.
fn position_letters(orientation: Orientation) -> [char; 2] {
    match orientation {
        Orientation::Axial => ['S', 'I'],
        Orientation::Coronal => ['A', 'P'],
        Orientation::Sagittal => ['R', 'L'],
    }
}

/// "S 12.5 mm".
fn position_text(orientation: Orientation, mm: f64) -> String {
    // Hundredths of a millimeter tell the slices of clinical scans apart, and of finer ones nobody reads the position.
    let rounded = (mm * 100.0).round() / 100.0;
    format!("{} {} mm", position_letters(orientation)[usize::from(rounded < 0.0)], shorter(rounded.abs()))
}

/// A position as people type it: "I 12", or with a sign.
fn parse_position(orientation: Orientation, text: &str) -> Option<f64> {
    let letter = text.trim().chars().next()?.to_ascii_uppercase();
    let number = parse_number(text.trim().trim_start_matches(char::is_alphabetic))?;
    Some(if letter == position_letters(orientation)[1] { -number } else { number })
}

impl Pane {
    /// Forgets what it drew.
    pub fn forget_picture(&mut self) {
        (self.picture, self.shown) = (None, None);
    }

    /// Where in the body a position of the pointer is, if it is on this slice.
    pub fn aim(&self, at: Pos2) -> Option<Aim> {
        let (orientation, geometry) = self.shown.as_ref().filter(|(_, geometry)| geometry.rect.contains(at))?;
        Some(Aim {
            orientation: *orientation,
            place_mm: geometry.place_mm(at),
            view_direction: geometry.frame.view_direction(),
            mm_per_point: geometry.mm_per_point,
        })
    }

    /// How it lies on the screen, as it was shown last.
    pub fn shown(&self) -> Option<&(Orientation, Geometry)> {
        self.shown.as_ref()
    }

    /// The slice in its place; `under_way` is the drag that it is in.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        context: &Context<'_>,
        place: Rect,
        rect: Rect,
        crosshair_mm: DVec3,
        under_way: Option<Drag>,
    ) -> Done {
        let mut done = Done { drag: under_way, ..Done::default() };
        let frame = context.frames[context.orientation as usize];
        let head = Rect::from_min_max(place.min, Pos2::new(place.right(), rect.top()));
        if let Some(position_mm) = head_of(ui, context, &frame, head, frame.position_mm(crosshair_mm)) {
            done.crosshair_mm = Some(frame.moved_to(crosshair_mm, position_mm));
        }
        let response = ui.allocate_rect(rect, Sense::click_and_drag());
        let [left, right] = [direction_letters(-frame.right), direction_letters(frame.right)];
        response.widget_info(|| {
            let position = position_text(context.orientation, frame.position_mm(crosshair_mm));
            let (name, side) = (context.orientation.name(), context.convention.name().to_lowercase());
            let text = format!("{name} slice at {position}, {side}, {left} on the left, {right} on the right");
            WidgetInfo::labeled(Role::Canvas, true, text)
        });
        let geometry = self.geometry(context, rect, frame, crosshair_mm);
        self.drag(ui, &response, context, &geometry, &mut done);
        if done.drag.is_none() {
            self.pointer(ui, &response, context, &geometry, crosshair_mm, &mut done);
            self.keys(ui, &response, context, &geometry, crosshair_mm, &mut done);
        }
        // What the hand did is seen in the same frame, in this slice.
        let now = done.crosshair_mm.map_or(crosshair_mm, |place| super::on_voxel(&context.volume.grid, place));
        let geometry = self.geometry(context, rect, frame, now);
        self.shown = Some((context.orientation, geometry));
        done.is_hovered = response.contains_pointer() || done.drag.is_some();
        done.is_aimed = response.contains_pointer() && done.drag.is_none();
        if context.is_tools && response.clicked() {
            response.request_focus();
        }
        let at = ui.input(|i| i.pointer.latest_pos()).filter(|at| rect.contains(*at) && done.is_hovered);
        done.under = at.and_then(|at| under(context, &geometry, at));
        let window = done.window.map_or(context.window, |w| w.unwrap_or_else(|| window::of_volume(context.volume)));
        self.paint(ui, &response, &Context { window, ..*context }, &geometry, now);
        done
    }

    fn geometry(&self, context: &Context<'_>, rect: Rect, frame: Frame, crosshair_mm: DVec3) -> Geometry {
        let (low, high) = context.volume.grid.index_box();
        let view = self.view.unwrap_or(View {
            center_mm: context.volume.grid.world_from_index().transform_point3(0.5 * (low + high)),
            mm_per_point: context.fitting_mm_per_point,
        });
        let ahead = frame.position_mm(crosshair_mm) - frame.position_mm(view.center_mm);
        let center_mm = view.center_mm + ahead * frame.normal;
        Geometry { rect, center_mm, mm_per_point: view.mm_per_point, frame }
    }

    fn drag(&mut self, ui: &Ui, response: &Response, context: &Context<'_>, geometry: &Geometry, done: &mut Done) {
        let (modifiers, space) = ui.input(|i| (i.modifiers, i.key_down(Key::Space)));
        let buttons = [PointerButton::Primary, PointerButton::Middle, PointerButton::Secondary];
        let at = ui.input(|i| i.pointer.latest_pos());
        let any_down = ui.input(|i| i.pointer.any_down());
        if done.drag.is_none() && response.is_pointer_button_down_on() {
            let pressed = buttons.into_iter().find(|b| ui.input(|i| i.pointer.button_pressed(*b)));
            let pressed = pressed.filter(|button| !(context.is_tools && is_tools(*button, modifiers, space)));
            done.drag = pressed.and_then(|button| drag_of(button, modifiers, space));
            self.last = ui.input(|i| i.pointer.press_origin());
            if done.drag.is_some() {
                response.request_focus();
            }
        }
        let (Some(drag), Some(at)) = (done.drag, at) else { return };
        let last = self.last.replace(at).unwrap_or(at);
        match drag {
            Drag::Crosshair => done.crosshair_mm = Some(self.on_slice(context, geometry, at)),
            Drag::Window if last != at && context.volume.colors.is_none() => {
                done.window = Some(Some(window::dragged(context.window, at - last)));
            }
            Drag::Pan if last != at => {
                let by = geometry.place_mm(last) - geometry.place_mm(at);
                self.view = Some(View { center_mm: geometry.center_mm + by, mm_per_point: geometry.mm_per_point });
            }
            Drag::Zoom if last != at => {
                let factor = (-3.0 * f64::from((at.y - last.y) / geometry.rect.height().max(1.0))).exp();
                self.zoom(context, geometry, geometry.rect.center(), factor);
            }
            _ => {}
        }
        if drag != Drag::Crosshair {
            ui.ctx().set_cursor_icon(if drag == Drag::Pan { CursorIcon::Grabbing } else { CursorIcon::AllScroll });
        }
        if !any_down {
            (done.drag, self.last) = (None, None);
        }
    }

    /// A place in the volume, on this slice.
    fn on_slice(&self, context: &Context<'_>, geometry: &Geometry, at: Pos2) -> DVec3 {
        let place = geometry.place_mm(at);
        let inside = clamped(&context.volume.grid, place);
        geometry.frame.moved_to(inside, geometry.frame.position_mm(place))
    }

    /// What the pointer does without a drag: Shift+move, double click, wheel.
    fn pointer(
        &mut self,
        ui: &Ui,
        response: &Response,
        context: &Context<'_>,
        geometry: &Geometry,
        crosshair_mm: DVec3,
        done: &mut Done,
    ) {
        let double = [PointerButton::Secondary, PointerButton::Primary];
        let double = &double[..if context.is_tools { 1 } else { 2 }];
        if double.iter().any(|button| response.double_clicked_by(*button)) {
            done.window = Some(None);
        }
        let Some(at) = response.hover_pos() else { return };
        ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
        // Pressed and let go within a frame it is no drag.
        if response.clicked() && !context.is_tools && ui.input(|i| i.modifiers.is_none()) {
            done.crosshair_mm = Some(self.on_slice(context, geometry, at));
        }
        if ui
            .input(|i| i.modifiers.shift_only() && i.pointer.is_moving() && !(context.is_tools && i.pointer.any_down()))
        {
            done.crosshair_mm = Some(self.on_slice(context, geometry, at));
        }
        let (turned, zoomed) = ui.input(|i| {
            let notches = i.events.iter().map(|event| match event {
                Event::MouseWheel { unit, delta, modifiers, .. } if !modifiers.command && !modifiers.ctrl => match unit
                {
                    MouseWheelUnit::Point => delta.y / POINTS_PER_NOTCH,
                    MouseWheelUnit::Line => delta.y,
                    MouseWheelUnit::Page => 10.0 * delta.y,
                },
                _ => 0.0,
            });
            (notches.sum::<f32>(), f64::from(i.zoom_delta()))
        });
        self.notches += if context.takes_wheel { 0.0 } else { turned };
        let slices = self.notches.trunc();
        self.notches -= slices;
        if slices != 0.0 {
            done.crosshair_mm = Some(stepped(&geometry.frame, crosshair_mm, slices as i64));
        }
        if zoomed != 1.0 {
            self.zoom(context, geometry, at, zoomed);
        }
    }

    /// Makes what is at a position `factor` times as large, where it is.
    fn zoom(&mut self, context: &Context<'_>, geometry: &Geometry, at: Pos2, factor: f64) {
        let fitting = context.fitting_mm_per_point;
        let mm_per_point = (geometry.mm_per_point / factor).clamp(ZOOMS.0 * fitting, ZOOMS.1 * fitting);
        let place = geometry.place_mm(at);
        let center_mm = place + (geometry.center_mm - place) * (mm_per_point / geometry.mm_per_point);
        self.view = Some(View { center_mm, mm_per_point });
    }

    /// The slice by keys, while it has the focus.
    fn keys(
        &mut self,
        ui: &Ui,
        response: &Response,
        context: &Context<'_>,
        geometry: &Geometry,
        crosshair_mm: DVec3,
        done: &mut Done,
    ) {
        if !response.has_focus() {
            return;
        }
        let filter = EventFilter { horizontal_arrows: true, vertical_arrows: true, ..EventFilter::default() };
        ui.memory_mut(|m| m.set_focus_lock_filter(response.id, filter));
        let Geometry { rect, frame, .. } = *geometry;
        let arrows = [
            (Key::ArrowLeft, -frame.right, Vec2::new(-1.0, 0.0)),
            (Key::ArrowRight, frame.right, Vec2::new(1.0, 0.0)),
            (Key::ArrowUp, frame.up, Vec2::new(0.0, -1.0)),
            (Key::ArrowDown, -frame.up, Vec2::new(0.0, 1.0)),
        ];
        let mut place = crosshair_mm;
        for (key, direction, on_screen) in arrows {
            if ui.input_mut(|i| i.consume_key(Modifiers::SHIFT, key)) {
                let by = geometry.place_mm(rect.center() + KEY_MOVE * rect.height() * on_screen) - geometry.center_mm;
                self.view = Some(View { center_mm: geometry.center_mm - by, mm_per_point: geometry.mm_per_point });
            } else if ui.input_mut(|i| i.consume_key(Modifiers::NONE, key)) {
                // A voxel to the side is a slice of another orientation.
                let others = context.frames.iter().filter(|other| other.normal != frame.normal);
                let along = |other: &Frame| other.advance_mm.normalize().dot(direction);
                if let Some(other) = others.max_by(|a, b| along(a).abs().total_cmp(&along(b).abs())) {
                    place = stepped(other, place, if along(other) > 0.0 { 1 } else { -1 });
                }
            }
        }
        for (key, by) in [(Key::PageUp, 1), (Key::PageDown, -1)] {
            if ui.input_mut(|i| i.consume_key(Modifiers::NONE, key)) {
                place = stepped(&frame, place, by);
            }
        }
        for (key, factor) in [(Key::Plus, 1.1), (Key::Equals, 1.1), (Key::Minus, 1.0 / 1.1)] {
            if ui.input_mut(|i| i.consume_key(Modifiers::NONE, key) || i.consume_key(Modifiers::SHIFT, key)) {
                self.zoom(context, geometry, geometry.position(crosshair_mm), factor);
            }
        }
        if place != crosshair_mm {
            done.crosshair_mm = Some(place);
        }
    }

    fn paint(&mut self, ui: &Ui, response: &Response, context: &Context<'_>, geometry: &Geometry, crosshair_mm: DVec3) {
        let Geometry { rect, frame, .. } = *geometry;
        self.draw(ui, context, geometry);
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 0.0, Color32::BLACK);
        if let Some(picture) = &self.picture {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            painter.image(picture.texture.id(), rect, whole, Color32::WHITE);
        }
        let middle = geometry.position(crosshair_mm);
        for (other, orientation) in context.frames.iter().zip(Orientation::ALL) {
            if orientation == context.orientation {
                continue;
            }
            // Where the two slices meet.
            let line = frame.normal.cross(other.normal);
            let along = Vec2::new(line.dot(frame.right) as f32, -line.dot(frame.up) as f32).normalized();
            let stroke = Stroke::new(1.0, color(orientation).gamma_multiply(0.85));
            let reach = rect.size().length() + (middle - rect.center()).length();
            for side in [along, -along] {
                painter.line_segment([middle + CROSSHAIR_GAP * side, middle + reach * side], stroke);
            }
        }
        let text = |at: Pos2, anchor: Align2, text: String, size: f32| {
            let font = FontId::proportional(size);
            for by in [Vec2::new(1.0, 1.0), Vec2::new(-1.0, 1.0), Vec2::new(1.0, -1.0), Vec2::new(-1.0, -1.0)] {
                painter.text(at + by, anchor, &text, font.clone(), Color32::from_black_alpha(190));
            }
            painter.text(at, anchor, text, font, Color32::from_gray(236));
        };
        for (direction, at, anchor) in [
            (-frame.right, rect.left_center() + Vec2::new(6.0, 0.0), Align2::LEFT_CENTER),
            (frame.right, rect.right_center() - Vec2::new(6.0, 0.0), Align2::RIGHT_CENTER),
            (frame.up, rect.center_top() + Vec2::new(0.0, 4.0), Align2::CENTER_TOP),
            (-frame.up, rect.center_bottom() - Vec2::new(0.0, 4.0), Align2::CENTER_BOTTOM),
        ] {
            text(at, anchor, direction_letters(direction), 15.0);
        }
        let corner = rect.left_bottom() + Vec2::new(6.0, -5.0);
        text(corner, Align2::LEFT_BOTTOM, context.convention.name().to_owned(), 11.0);
        if context.volume.colors.is_none() {
            let Window { level, width } = context.window;
            let number = |value: f64| format!("{value:.*}", window::decimals(width));
            let values = format!("W {}  L {}", number(width), number(level));
            text(rect.right_bottom() + Vec2::new(-6.0, -5.0), Align2::RIGHT_BOTTOM, values, 11.0);
        }
        if response.has_focus() {
            let stroke = Stroke::new(2.0, theme::tokens(ui.ctx()).accent);
            painter.rect_stroke(rect, 0.0, stroke, StrokeKind::Inside);
        }
    }

    /// Draws the slice, unless what it drew last is the same.
    fn draw(&mut self, ui: &Ui, context: &Context<'_>, geometry: &Geometry) {
        if !ui.is_rect_visible(geometry.rect) {
            return;
        }
        let plane = geometry.plane(ui.ctx().pixels_per_point());
        let filter = filter_for(context.is_labels, slice::pixels_per_voxel(&context.volume.grid, &plane));
        let (volume, window) = (context.volume, context.window);
        let is_plain_same = self.picture.as_ref().is_some_and(|drawn| {
            let same_look = drawn.plane == plane && drawn.filter == filter && drawn.window == window;
            same_look && Arc::ptr_eq(&drawn.volume, volume)
        });
        if is_plain_same && self.picture.as_ref().is_some_and(|drawn| drawn.overlays == context.overlays) {
            return;
        }
        let drawn = self.picture.take();
        let (texture, plain) = match drawn {
            Some(drawn) if is_plain_same => (Some(drawn.texture), drawn.plain),
            drawn => (drawn.map(|drawn| drawn.texture), slice::draw(volume, &plane, filter, window)),
        };
        let mut pixels = plain.clone();
        overlay::lay(&mut pixels, &plane, context.overlays);
        let image = ColorImage::from_rgba_unmultiplied(plane.size, pixels.as_flattened());
        let texture = match texture {
            Some(mut texture) => {
                texture.set(image, TextureOptions::NEAREST);
                texture
            }
            None => ui.ctx().load_texture(context.orientation.name(), image, TextureOptions::NEAREST),
        };
        let overlays = context.overlays.to_vec();
        self.picture = Some(Picture { texture, volume: volume.clone(), plane, filter, window, plain, overlays });
    }
}

/// A place so many slices further.
fn stepped(frame: &Frame, place_mm: DVec3, slices: i64) -> DVec3 {
    let now = frame.slice_at(frame.position_mm(place_mm)) as i64;
    let then = now.saturating_add(slices).clamp(0, frame.num_slices as i64 - 1);
    frame.moved_to(place_mm, frame.slice_mm(then as usize))
}

/// What is at a position on a slice; none outside the volume.
fn under(context: &Context<'_>, geometry: &Geometry, at: Pos2) -> Option<Under> {
    let position_mm = geometry.place_mm(at);
    let filter = if context.is_labels { Filter::Nearest } else { Filter::Linear };
    match slice::value_at(context.volume, position_mm, filter) {
        Sample::Outside => None,
        Sample::Gap => Some(Under { position_mm, value: f64::NAN }),
        Sample::Data(value) => Some(Under { position_mm, value }),
    }
}

/// Name, slider and number; the position that is chosen there.
fn head_of(ui: &mut Ui, context: &Context<'_>, frame: &Frame, head: Rect, position_mm: f64) -> Option<f64> {
    let tokens = theme::tokens(ui.ctx());
    let name = context.orientation.name();
    let [first, last] = frame.range_mm();
    let mut chosen = None;
    ui.painter().rect_filled(head, 0.0, tokens.panel);
    let chip = Rect::from_min_size(head.min, Vec2::new(4.0, head.height()));
    ui.painter().rect_filled(chip, 0.0, color(context.orientation));
    let builder = UiBuilder::new().id_salt("head").max_rect(head.shrink2(Vec2::new(10.0, 1.0)));
    ui.scope_builder(builder, |ui| {
        ui.horizontal_centered(|ui| {
            ui.label(egui::RichText::new(name).strong());
            let enabled = frame.num_slices > 1;
            let (mut typed, mut slid) = (position_mm, position_mm);
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let number = DragValue::new(&mut typed)
                    .range(first..=last)
                    .speed(0.25 * frame.step_mm)
                    .update_while_editing(false)
                    .custom_formatter(|mm, _| position_text(context.orientation, mm))
                    .custom_parser(|text| parse_position(context.orientation, text));
                let response = ui.add_enabled(enabled, number).accessible_name(format!("{name} position"));
                if response.on_hover_text("Where it lies along the body, from the origin of the scan").changed() {
                    chosen = Some(typed);
                }
                ui.spacing_mut().slider_width = ui.available_width().max(24.0);
                let tooltip = "Which slice is shown; wheel and Page Up or Down on the slice step through them";
                let response = ui.add_enabled(enabled, Slider::new(&mut slid, first..=last).show_value(false));
                if response.accessible_name(format!("{name} slice")).on_hover_text(tooltip).changed() {
                    chosen = Some(slid);
                }
            });
        });
    });
    chosen
}

#[cfg(test)]
mod tests {
    use fabrica_engine::spaces::Grid;
    use glam::{DAffine3, DMat3};

    use super::*;

    #[test]
    fn drags_are_those_of_the_figure_or_the_crosshair() {
        let ctrl = Modifiers { ctrl: true, command: true, ..Modifiers::NONE };
        for (button, modifiers, space, expected) in [
            (PointerButton::Primary, Modifiers::NONE, false, Some(Drag::Crosshair)),
            (PointerButton::Primary, Modifiers::SHIFT, false, Some(Drag::Pan)),
            (PointerButton::Primary, Modifiers::NONE, true, Some(Drag::Pan)),
            (PointerButton::Primary, ctrl, false, Some(Drag::Zoom)),
            (PointerButton::Middle, Modifiers::NONE, false, Some(Drag::Pan)),
            (PointerButton::Middle, Modifiers::SHIFT, false, Some(Drag::Pan)),
            (PointerButton::Middle, ctrl, false, Some(Drag::Zoom)),
            (PointerButton::Secondary, Modifiers::NONE, false, Some(Drag::Window)),
            (PointerButton::Extra1, Modifiers::NONE, false, None),
        ] {
            assert_eq!(drag_of(button, modifiers, space), expected, "{button:?} {modifiers:?} {space}");
        }
    }

    #[test]
    fn positions_on_the_screen_are_places_in_the_body() {
        let matrix = DMat3::from_rotation_x(0.3) * DMat3::from_diagonal(DVec3::new(-0.7, 0.7, 3.0));
        let grid =
            Grid::new([64, 80, 20], DAffine3 { matrix3: matrix, translation: DVec3::new(9.0, 8.0, 7.0) }).unwrap();
        let rect = Rect::from_min_size(Pos2::new(100.0, 50.0), Vec2::new(301.0, 200.0));
        for orientation in Orientation::ALL {
            let frame = Frame::of(&grid, orientation, Convention::Radiological);
            let center_mm = grid.world_from_index().transform_point3(DVec3::new(30.0, 40.0, 10.0));
            let geometry = Geometry { rect, center_mm, mm_per_point: 0.4, frame };
            assert!(geometry.place_mm(rect.center()).distance(center_mm) < 1e-9);
            let at = Pos2::new(133.0, 210.0);
            let place = geometry.place_mm(at);
            assert!((geometry.position(place) - at).length() < 1e-3);
            assert!((frame.position_mm(place) - frame.position_mm(center_mm)).abs() < 1e-9);
            // Ten points to the right are four millimeters to where the letter says.
            let by = geometry.place_mm(at + Vec2::new(10.0, 0.0)) - place;
            assert!((by - 4.0 * frame.right).length() < 1e-6);
            let plane = geometry.plane(2.0);
            assert_eq!(plane.size, [602, 400]);
            assert!(plane.at(300.5, 199.5).distance(center_mm) < 1e-6);
            assert!(plane.at(0.0, 0.0).distance(geometry.place_mm(rect.min + Vec2::splat(0.25))) < 1e-5);
        }
        // Shown whole, nothing of any slice is outside its picture.
        let frames = Orientation::ALL.map(|o| Frame::of(&grid, o, Convention::Neurological));
        let mm_per_point = fitting(&grid, &frames, &[rect; 3]);
        let (low, high) = grid.index_box();
        let center_mm = grid.world_from_index().transform_point3(0.5 * (low + high));
        for frame in frames {
            let geometry = Geometry { rect, center_mm, mm_per_point, frame };
            assert!(
                grid.box_corners_mm(low, high)
                    .iter()
                    .all(|c| rect.shrink(MARGIN - 0.1).contains(geometry.position(*c)))
            );
        }
    }

    #[test]
    fn positions_are_said_and_typed_with_their_letter() {
        for (orientation, mm, text) in [
            (Orientation::Axial, 12.5, "S 12.5 mm"),
            (Orientation::Axial, -3.0, "I 3 mm"),
            (Orientation::Coronal, -0.001, "A 0 mm"),
            (Orientation::Sagittal, -7.254, "L 7.25 mm"),
        ] {
            assert_eq!(position_text(orientation, mm), text);
            assert!((parse_position(orientation, text).unwrap() - mm).abs() < 0.005, "{text}");
        }
        assert_eq!(parse_position(Orientation::Axial, "-12"), Some(-12.0));
        assert_eq!(parse_position(Orientation::Axial, "i 2*3 mm"), Some(-6.0));
        assert_eq!(parse_position(Orientation::Axial, "S"), None);
        assert_eq!(parse_position(Orientation::Axial, ""), None);
    }
}
