//! The window: what is open, what is shown, and how commands and gestures reach the document. It holds no figure data of its
//! own and never waits: files are read on threads, pictures come from the painter.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui::{
    self, Align2, CentralPanel, Color32, ColorImage, Context, FontId, Key, Modal, Panel, PointerButton, Pos2, Rect,
    Sense, TextureHandle, TextureOptions, Ui, Vec2, ViewportCommand,
};
use fabrica_engine::Error;
use fabrica_engine::gpu::AdapterChoice;
use fabrica_engine::styles::StyleLibrary;
use fabrica_engine::volume::Volume;
use glam::DVec3;

use super::files::{Loaded, Loading, is_template, save};
use super::painter::{Painter, Request, Stage, Update};
use super::ui_command::UiCommand;
use super::{theme, view};
use crate::figure::template::QualityName;
use crate::figure::{Command, Document, Template};

/// What is open.
struct Open {
    document: Document,
    /// Where the figure is saved; none for one that a volume was dressed in.
    path: Option<PathBuf>,
    /// One a slot; empty where they could not be read.
    volumes: Vec<Arc<Volume>>,
    /// The figure and size that the painter was asked for last, and whether only coarsely.
    asked: Option<(Arc<Template>, [u32; 2], bool)>,
}

/// The picture in the frame.
#[derive(Default)]
struct Shown {
    texture: Option<TextureHandle>,
    stage: Option<Stage>,
    /// The last request's number: older updates are late.
    number: u64,
}

/// A question in front of everything else.
enum Dialog {
    /// A path to open.
    Open(String),
    /// A path to save to.
    SaveAs(String),
    /// There are unsaved changes: what was asked for.
    Unsaved(Then),
    /// The palette with what is typed.
    Palette(String),
}

/// What happens once unsaved changes are dealt with.
#[derive(Clone, Debug)]
enum Then {
    Quit,
    Open(PathBuf),
}

/// The editor: the state behind the window.
pub struct Editor {
    painter: Painter,
    adapter: String,
    open: Option<Open>,
    loading: Option<Loading>,
    shown: Shown,
    dialog: Option<Dialog>,
    /// What went wrong last, until it is closed.
    banner: Option<String>,
    /// What is worth a line in the status bar.
    notice: String,
    quitting: bool,
}

impl Editor {
    /// An editor without a figure; `file` is opened.
    pub fn new(ctx: &Context, adapter: AdapterChoice, file: Option<PathBuf>) -> Self {
        theme::install(ctx);
        ctx.options_mut(|o| o.zoom_with_keyboard = false);
        let wake = ctx.clone();
        let mut editor = Self {
            painter: Painter::start(adapter, StyleLibrary::embedded(), move || wake.request_repaint()),
            adapter: String::new(),
            open: None,
            loading: None,
            shown: Shown::default(),
            dialog: None,
            banner: None,
            notice: String::new(),
            quitting: false,
        };
        if let Some(file) = file {
            editor.load(ctx, file);
        }
        editor
    }

    /// The document, if one is open.
    pub fn document(&self) -> Option<&Document> {
        self.open.as_ref().map(|open| &open.document)
    }

    /// Whether something is read or drawn.
    pub fn is_busy(&self) -> bool {
        self.loading.is_some() || (self.open.is_some() && !matches!(self.shown.stage, Some(Stage::Refined { .. })))
    }

    /// The last fault that the user was told.
    pub fn banner(&self) -> Option<&str> {
        self.banner.as_deref()
    }

    fn load(&mut self, ctx: &Context, path: PathBuf) {
        if let Some(loading) = self.loading.take() {
            loading.progress.cancel();
        }
        self.banner = None;
        let wake = ctx.clone();
        self.loading = Some(Loading::start(path, move || wake.request_repaint()));
    }

    fn poll(&mut self, ctx: &Context) {
        if let Some(loading) = &self.loading
            && let Some(result) = loading.finished()
        {
            let path = loading.path.clone();
            self.loading = None;
            match result {
                Ok(loaded) => self.show_loaded(path, loaded),
                Err(error) if error.downcast_ref::<Error>().is_some_and(|e| matches!(e, Error::Cancelled)) => {}
                Err(error) => self.banner = Some(format!("{error:#}")),
            }
        }
        let updates: Vec<Update> = self.painter.updates().collect();
        for update in updates {
            match update {
                Update::Ready(name) => self.adapter = name,
                Update::Failed { number, message } if number == self.shown.number => self.banner = Some(message),
                Update::Rows { number, size, y, num_rows, pixels, stage } if number == self.shown.number => {
                    let image = ColorImage::from_rgba_premultiplied([size[0], num_rows], &pixels);
                    match &mut self.shown.texture {
                        Some(texture) if texture.size() == size && num_rows < size[1] => {
                            texture.set_partial([0, y], image, TextureOptions::LINEAR);
                        }
                        Some(texture) => texture.set(image, TextureOptions::LINEAR),
                        none => *none = Some(ctx.load_texture("figure", image, TextureOptions::LINEAR)),
                    }
                    self.shown.stage = Some(stage);
                }
                _ => {}
            }
        }
    }

    fn show_loaded(&mut self, path: PathBuf, loaded: Loaded) {
        let is_template = is_template(&path);
        let notes = loaded.notes.join("; ");
        (self.banner, self.notice) =
            if loaded.volumes.is_empty() { (Some(notes), String::new()) } else { (None, notes) };
        self.shown = Shown { number: self.shown.number, ..Shown::default() };
        self.open = Some(Open {
            document: Document::new(loaded.figure),
            path: is_template.then_some(path),
            volumes: loaded.volumes,
            asked: None,
        });
    }

    /// Why a command cannot be run just now; `None` if it can.
    pub fn disabled(&self, command: UiCommand) -> Option<&'static str> {
        let document = self.document();
        match command {
            c if c.needs_figure() && document.is_none() => Some("Open a volume or a figure first"),
            UiCommand::Undo if document.is_some_and(|d| d.undo_label().is_none() && !d.in_gesture()) => {
                Some("Nothing to undo")
            }
            UiCommand::Redo if document.is_some_and(|d| d.redo_label().is_none()) => Some("Nothing to redo"),
            _ => None,
        }
    }

    /// Runs a command, unless it is disabled.
    pub fn run(&mut self, ctx: &Context, command: UiCommand) {
        use UiCommand as C;
        if self.disabled(command).is_some() {
            return;
        }
        let camera = self.document().map(|d| d.figure().camera.clone());
        let edit = match (command, camera) {
            (C::Fit, Some(camera)) => Some(Command::SetCamera(view::fit(&camera))),
            (C::FromFront, Some(camera)) => Some(Command::SetCamera(view::from_side(&camera, DVec3::Y))),
            (C::FromBack, Some(camera)) => Some(Command::SetCamera(view::from_side(&camera, DVec3::NEG_Y))),
            (C::FromLeft, Some(camera)) => Some(Command::SetCamera(view::from_side(&camera, DVec3::NEG_X))),
            (C::FromRight, Some(camera)) => Some(Command::SetCamera(view::from_side(&camera, DVec3::X))),
            (C::FromAbove, Some(camera)) => Some(Command::SetCamera(view::from_side(&camera, DVec3::Z))),
            (C::FromBelow, Some(camera)) => Some(Command::SetCamera(view::from_side(&camera, DVec3::NEG_Z))),
            (C::RollLeft, Some(camera)) => Some(Command::SetCamera(view::roll(&camera, 15f64.to_radians()))),
            (C::RollRight, Some(camera)) => Some(Command::SetCamera(view::roll(&camera, -15f64.to_radians()))),
            (C::Projection, Some(camera)) => Some(Command::SetProjection(view::other(camera.projection))),
            (C::QualityDraft, _) => Some(Command::SetQuality(QualityName::Draft)),
            (C::QualityStandard, _) => Some(Command::SetQuality(QualityName::Standard)),
            (C::QualityFinal, _) => Some(Command::SetQuality(QualityName::Final)),
            _ => None,
        };
        if let Some(edit) = edit {
            self.edit(edit);
            return;
        }
        match command {
            C::Open => self.dialog = Some(Dialog::Open(String::new())),
            C::Save => self.save(),
            C::SaveAs => self.dialog = Some(Dialog::SaveAs(self.proposed_path())),
            C::Quit => self.guarded(ctx, Then::Quit),
            C::Palette => self.dialog = Some(Dialog::Palette(String::new())),
            C::Theme => {
                let other = match ctx.theme() {
                    egui::Theme::Dark => egui::ThemePreference::Light,
                    egui::Theme::Light => egui::ThemePreference::Dark,
                };
                ctx.set_theme(other);
            }
            C::LargerText => ctx.set_zoom_factor((ctx.zoom_factor() * 1.1).min(2.0)),
            C::SmallerText => ctx.set_zoom_factor((ctx.zoom_factor() / 1.1).max(0.75)),
            C::Undo | C::Redo => {
                if let Some(open) = &mut self.open {
                    let done = if command == C::Undo { open.document.undo() } else { open.document.redo() };
                    debug_assert!(done, "disabled() says whether there is a step");
                }
            }
            _ => {}
        }
    }

    /// Makes an edit; a fault becomes the banner.
    pub fn edit(&mut self, command: Command) {
        if let Some(open) = &mut self.open
            && let Err(error) = open.document.apply(command)
        {
            self.banner = Some(format!("{error:#}"));
        }
    }

    fn guarded(&mut self, ctx: &Context, then: Then) {
        if self.document().is_some_and(Document::is_changed) {
            self.dialog = Some(Dialog::Unsaved(then));
        } else {
            self.go_on(ctx, then);
        }
    }

    fn go_on(&mut self, ctx: &Context, then: Then) {
        match then {
            Then::Quit => {
                self.quitting = true;
                ctx.send_viewport_cmd(ViewportCommand::Close);
            }
            Then::Open(path) => self.load(ctx, path),
        }
    }

    fn proposed_path(&self) -> String {
        let open = self.open.as_ref();
        let path = open.and_then(|o| o.path.clone()).unwrap_or_else(|| PathBuf::from("figure.json"));
        std::path::absolute(&path).unwrap_or(path).display().to_string()
    }

    fn save(&mut self) {
        match self.open.as_ref().and_then(|open| open.path.clone()) {
            Some(path) => self.save_to(&path),
            None => self.dialog = Some(Dialog::SaveAs(self.proposed_path())),
        }
    }

    fn save_to(&mut self, path: &Path) {
        let Some(open) = &mut self.open else { return };
        let before = open.path.as_deref();
        match save(open.document.figure(), before, path) {
            Ok(written) => {
                // Its volumes may be named differently from another folder; that is no edit.
                if written != **open.document.figure() {
                    open.document = Document::new(written);
                    open.asked = None;
                } else {
                    let figure = open.document.figure().clone();
                    open.document.mark_saved(&figure);
                }
                open.path = Some(path.to_owned());
                self.notice = format!("Saved {}", path.display());
            }
            Err(error) => self.banner = Some(format!("{error:#}. Nothing was lost")),
        }
    }

    /// The whole window.
    pub fn ui(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        self.poll(&ctx);
        self.keys(&ctx);
        self.dropped(&ctx);
        if ctx.input(|i| i.viewport().close_requested()) && !self.quitting {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
            self.guarded(&ctx, Then::Quit);
        }
        Panel::top("menus").show(ui, |ui| self.menus(ui));
        Panel::bottom("status").show(ui, |ui| self.status(ui));
        if let Some(banner) = self.banner.clone() {
            Panel::top("banner").show(ui, |ui| {
                ui.horizontal_wrapped(|ui| {
                    ui.colored_label(theme::tokens(&ctx).error, banner);
                    if ui.button("Close").clicked() {
                        self.banner = None;
                    }
                });
            });
        }
        let canvas = egui::Frame::new().fill(theme::tokens(&ctx).canvas);
        CentralPanel::default().frame(canvas).show(ui, |ui| {
            if let Some(loading) = &self.loading {
                let (stage, done, total) = loading.progress.snapshot();
                ui.vertical_centered(|ui| {
                    ui.add_space(0.4 * ui.available_height());
                    ui.label(format!("Reading {}: {stage}", loading.path.display()));
                    if total > 0 {
                        ui.add(egui::ProgressBar::new(done as f32 / total as f32).desired_width(320.0));
                    }
                    if ui.button("Cancel").clicked() {
                        loading.progress.cancel();
                    }
                });
                ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
            } else if self.open.is_some() {
                self.viewport(ui);
            } else {
                self.start_page(ui);
            }
        });
        self.dialogs(&ctx);
    }

    fn keys(&mut self, ctx: &Context) {
        if self.dialog.is_none() {
            // Those with more modifiers first: egui's test ignores further ones.
            let mut keyed: Vec<_> = UiCommand::ALL.iter().filter_map(|c| Some((*c, c.shortcut()?))).collect();
            keyed.sort_by_key(|(_, s)| {
                let m = s.modifiers;
                std::cmp::Reverse([m.alt, m.shift, m.ctrl || m.command].into_iter().filter(|on| *on).count())
            });
            for (command, shortcut) in keyed {
                if ctx.input_mut(|i| i.consume_shortcut(&shortcut)) {
                    self.run(ctx, command);
                }
            }
        }
        if ctx.input(|i| i.key_pressed(Key::Escape))
            && let Some(open) = &mut self.open
        {
            open.document.abort();
        }
    }

    fn dropped(&mut self, ctx: &Context) {
        let dropped = ctx.input(|i| i.raw.dropped_files.first().map(|f| f.path().to_owned()));
        if let Some(path) = dropped {
            self.guarded(ctx, Then::Open(path));
        }
    }

    fn menus(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        egui::MenuBar::new().ui(ui, |ui| {
            let mut names: Vec<&str> = UiCommand::ALL.iter().map(|c| c.menu()).collect();
            names.dedup();
            for name in names {
                ui.menu_button(name, |ui| {
                    for command in UiCommand::ALL.iter().filter(|c| c.menu() == name) {
                        self.menu_item(&ctx, ui, *command);
                    }
                });
            }
        });
    }

    fn menu_item(&mut self, ctx: &Context, ui: &mut Ui, command: UiCommand) {
        let mut button = egui::Button::new(self.label(command));
        if let Some(shortcut) = command.shortcut() {
            button = button.shortcut_text(ctx.format_shortcut(&shortcut));
        }
        let why = self.disabled(command);
        let response = ui.add_enabled(why.is_none(), button);
        let response = response.on_hover_text(command.tooltip()).on_disabled_hover_text(why.unwrap_or_default());
        if response.clicked() {
            self.run(ctx, command);
            ui.close();
        }
    }

    /// A command's name, with the step's for undo and redo.
    fn label(&self, command: UiCommand) -> String {
        let step = match (command, self.document()) {
            (UiCommand::Undo, Some(d)) => d.undo_label(),
            (UiCommand::Redo, Some(d)) => d.redo_label(),
            _ => None,
        };
        match step {
            Some(step) => format!("{}: {step}", command.text()),
            None => command.text().to_owned(),
        }
    }

    fn status(&self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if self.open.is_some() {
                ui.label(match self.shown.stage {
                    None => "Drawing".to_owned(),
                    Some(Stage::Coarse) => "Coarse".to_owned(),
                    Some(Stage::Refining(share)) => format!("Refining {:.0} %", 100.0 * share),
                    Some(Stage::Refined { seconds }) => format!("Refined in {seconds:.1} s"),
                });
                ui.separator();
                ui.label("Drag: orbit · middle drag or Shift+drag: pan · wheel: closer");
                ui.separator();
            }
            ui.label(&self.notice);
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.label(&self.adapter);
            });
        });
    }

    fn start_page(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        ui.vertical_centered(|ui| {
            ui.add_space(0.3 * ui.available_height());
            ui.heading("Fabrica");
            ui.label("Drop a volume, a folder of one, or a figure here, or");
            ui.add_space(8.0);
            if ui.button("Open…").clicked() {
                self.run(&ctx, UiCommand::Open);
            }
            ui.add_space(8.0);
            if ui.button("Begin with the specimen: a head").clicked() {
                self.load(&ctx, PathBuf::from("specimen:head"));
            }
        });
    }

    fn viewport(&mut self, ui: &mut Ui) {
        let area = ui.available_rect_before_wrap();
        let response = ui.allocate_rect(area, Sense::click_and_drag());
        let Some(open) = &mut self.open else { return };
        let figure = open.document.figure().clone();
        let frame = frame_in(area.shrink(24.0), (figure.figure.width_mm / figure.figure.height_mm) as f32);
        let tokens = theme::tokens(ui.ctx());
        response.widget_info(|| {
            let [left, right, ..] = view::letters(&figure.camera);
            egui::WidgetInfo::labeled(
                egui::Role::Image,
                true,
                format!("Figure: {left} on the left, {right} on the right"),
            )
        });

        // Gestures: one drag is one step.
        let height = f64::from(frame.height().max(1.0));
        if response.drag_started() {
            open.document.begin();
        }
        if response.dragged() && open.document.in_gesture() {
            let delta = response.drag_delta();
            let (dx, dy) = (f64::from(delta.x) / height, f64::from(delta.y) / height);
            let pans = response.dragged_by(PointerButton::Middle) || ui.input(|i| i.modifiers.shift);
            let camera = &open.document.figure().camera;
            let camera = if pans { view::pan(camera, dx, dy) } else { view::orbit(camera, dx, dy) };
            if delta != Vec2::ZERO {
                let _ = open.document.apply(Command::SetCamera(camera));
            }
        }
        if response.drag_stopped() {
            open.document.commit();
        }
        let wheel = ui.input(|i| i.smooth_scroll_delta().y);
        if let Some(at) = response.hover_pos().filter(|_| wheel != 0.0) {
            let from_middle = at - frame.center();
            let place = [f64::from(from_middle.x) / height, -f64::from(from_middle.y) / height];
            let camera = view::dolly(&open.document.figure().camera, (f64::from(wheel) / 300.0).exp(), place);
            let _ = open.document.apply(Command::SetCamera(camera));
        }

        // The painter is asked for whatever is new.
        let figure = open.document.figure().clone();
        let scale = ui.ctx().pixels_per_point();
        let size = [frame.width(), frame.height()].map(|n| ((n * scale).round() as u32).max(1));
        let coarse_only = open.document.in_gesture();
        let wanted = (figure.clone(), size, coarse_only);
        let same =
            open.asked.as_ref().is_some_and(|(f, s, c)| Arc::ptr_eq(f, &figure) && *s == size && *c == coarse_only);
        if !same && !open.volumes.is_empty() {
            let request = Request { figure: figure.clone(), volumes: open.volumes.clone(), size, coarse_only };
            self.shown.number = self.painter.ask(request);
            self.shown.stage = None;
            open.asked = Some(wanted);
        }

        let painter = ui.painter_at(area);
        painter.rect_filled(frame, 0.0, Color32::WHITE);
        if let Some(texture) = &self.shown.texture {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            painter.image(texture.id(), frame, whole, Color32::WHITE);
        }
        let [left, right, top, bottom] = view::letters(&figure.camera);
        for (letter, at, anchor) in [
            (left, frame.left_center() - Vec2::X * 6.0, Align2::RIGHT_CENTER),
            (right, frame.right_center() + Vec2::X * 6.0, Align2::LEFT_CENTER),
            (top, frame.center_top() - Vec2::Y * 4.0, Align2::CENTER_BOTTOM),
            (bottom, frame.center_bottom() + Vec2::Y * 4.0, Align2::CENTER_TOP),
        ] {
            painter.text(at, anchor, letter, FontId::proportional(14.0), tokens.dim);
        }
    }

    fn dialogs(&mut self, ctx: &Context) {
        let Some(mut dialog) = self.dialog.take() else { return };
        let mut chosen: Option<Choice> = None;
        let modal = Modal::new(egui::Id::unique("dialog")).show(ctx, |ui| {
            ui.set_width(420.0);
            match &mut dialog {
                Dialog::Open(text) => chosen = path_dialog(ui, "Open a volume, a folder or a figure", "Open", text),
                Dialog::SaveAs(text) => chosen = path_dialog(ui, "Save the figure as", "Save", text),
                Dialog::Unsaved(_) => {
                    ui.heading("Save the changes first?");
                    ui.horizontal(|ui| {
                        if ui.button("Save").clicked() {
                            chosen = Some(Choice::Accept);
                        }
                        if ui.button("Do not save").clicked() {
                            chosen = Some(Choice::Discard);
                        }
                        if ui.button("Cancel").clicked() {
                            chosen = Some(Choice::Cancel);
                        }
                    });
                }
                Dialog::Palette(text) => {
                    let field = ui.add(egui::TextEdit::singleline(text).hint_text("Command").desired_width(400.0));
                    field.request_focus();
                    let found: Vec<UiCommand> =
                        UiCommand::ALL.iter().copied().filter(|c| matches(c.text(), text)).collect();
                    // The field keeps the focus, so that Enter does not end it as elsewhere.
                    if ui.input(|i| i.key_pressed(Key::Enter)) {
                        chosen = found.first().map(|c| Choice::Run(*c));
                    }
                    egui::ScrollArea::vertical().max_height(320.0).show(ui, |ui| {
                        for command in found {
                            let why = self.disabled(command);
                            let mut button = egui::Button::new(command.text()).frame(false);
                            if let Some(shortcut) = command.shortcut() {
                                button = button.shortcut_text(ctx.format_shortcut(&shortcut));
                            }
                            let response = ui.add_enabled(why.is_none(), button);
                            if response.on_disabled_hover_text(why.unwrap_or_default()).clicked() {
                                chosen = Some(Choice::Run(command));
                            }
                        }
                    });
                }
            }
        });
        if chosen.is_none() && modal.should_close() {
            chosen = Some(Choice::Cancel);
        }
        match (chosen, dialog) {
            (None, dialog) => self.dialog = Some(dialog),
            (Some(Choice::Cancel), _) => {}
            (Some(Choice::Run(command)), _) => self.run(ctx, command),
            (Some(_), Dialog::Open(text)) => self.guarded(ctx, Then::Open(PathBuf::from(text.trim()))),
            (Some(_), Dialog::SaveAs(text)) => self.save_to(Path::new(text.trim())),
            (Some(Choice::Discard), Dialog::Unsaved(then)) => self.go_on(ctx, then),
            (Some(_), Dialog::Unsaved(then)) => {
                self.save();
                if self.document().is_some_and(|d| !d.is_changed()) {
                    self.go_on(ctx, then);
                }
            }
            (Some(_), Dialog::Palette(_)) => {}
        }
    }
}

/// What a dialog ended with.
enum Choice {
    Accept,
    Discard,
    Cancel,
    Run(UiCommand),
}

fn path_dialog(ui: &mut Ui, title: &str, verb: &str, text: &mut String) -> Option<Choice> {
    ui.heading(title);
    let label = ui.label("Path");
    let field = ui.add(egui::TextEdit::singleline(text).desired_width(400.0)).labelled_by(label.id);
    if ui.memory(|m| m.focused().is_none()) {
        field.request_focus();
    }
    // The field keeps the focus, so that Enter does not end it as elsewhere.
    let entered = ui.input(|i| i.key_pressed(Key::Enter));
    let mut choice = None;
    ui.horizontal(|ui| {
        if (ui.button(verb).clicked() || entered) && !text.trim().is_empty() {
            choice = Some(Choice::Accept);
        }
        if ui.button("Cancel").clicked() {
            choice = Some(Choice::Cancel);
        }
    });
    choice
}

/// Whether the letters of `typed` come in `name`, in this order.
fn matches(name: &str, typed: &str) -> bool {
    let mut letters = name.chars().flat_map(char::to_lowercase);
    typed.chars().flat_map(char::to_lowercase).filter(|c| !c.is_whitespace()).all(|c| letters.any(|l| l == c))
}

/// The largest rectangle of an aspect (width over height) in the middle of an area.
fn frame_in(area: Rect, aspect: f32) -> Rect {
    let width = area.width().min(area.height() * aspect).max(1.0);
    Rect::from_center_size(area.center(), Vec2::new(width, width / aspect))
}

impl eframe::App for Editor {
    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        Self::ui(self, ui);
    }
}
