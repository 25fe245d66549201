//! The window: what is open, what is shown, and how commands and gestures reach the document. It holds no figure data of its
//! own and never waits: files are read on threads, pictures come from the painter.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Result;
use eframe::egui::{self, CentralPanel, Context, Key, Panel, Ui, ViewportCommand};
use fabrica_engine::gpu::AdapterChoice;
use fabrica_engine::styles::StyleLibrary;
use fabrica_engine::volume::{Modality, Volume};
use glam::DVec3;

use super::autosave::Autosave;
use super::dialogs::{self, Choice, Dialog, Then};
use super::file_dialog::{Answer, FileDialog, Purpose};
use super::files::{self, Job, Loaded, is_cancelled};
use super::find_file;
use super::gallery::Gallery;
use super::open_figure::OpenFigure;
use super::painter::{Painter, Stage, Update};
use super::panels::start_page::{self, Pictures};
use super::panels::transfer_function::{self, FunctionView};
use super::panels::{history, objects, properties, styles};
use super::recovery::{Orphan, Recoverable, RecoverySlot};
use super::session::{Pixels, Recent, Session};
use super::timings::Timings;
use super::ui_command::UiCommand;
use super::viewport::Viewport;
use super::{theme, view};
use crate::figure::shipped::SHIPPED;
use crate::figure::template::{QualityName, VolumeSlot};
use crate::figure::{Command, Document, Template};

/// A line that is shown for a while.
#[derive(Default)]
struct Notice {
    text: String,
    since: Option<Instant>,
}

/// How long a notice stays.
const NOTICE: Duration = Duration::from_secs(8);

impl Notice {
    fn now(text: impl Into<String>) -> Self {
        let text = text.into();
        Self { since: (!text.is_empty()).then(Instant::now), text }
    }

    /// Whether it is still to be read; a frame follows when it no longer is.
    fn is_fresh(&self, ctx: &Context) -> bool {
        let left = self.since.and_then(|since| NOTICE.checked_sub(since.elapsed()));
        if let Some(left) = left {
            ctx.request_repaint_after(left);
        }
        left.is_some()
    }
}

/// With what a window begins.
pub struct Options {
    /// What draws the figure.
    pub adapter: AdapterChoice,
    /// What is opened first: a figure, a volume, or both.
    pub files: Vec<PathBuf>,
    /// The styles that can be used.
    pub styles: StyleLibrary,
    /// What outlives the window.
    pub session: Session,
    /// Whether the system's file dialogs are used; without them paths are typed.
    pub system_dialogs: bool,
    /// Where times are written at the end, with the time at which the program began.
    pub timings: Option<(PathBuf, Instant)>,
}

impl Options {
    /// Nothing is opened, nothing is kept, paths are typed.
    pub fn plain(adapter: AdapterChoice) -> Self {
        Self {
            adapter,
            files: Vec::new(),
            styles: StyleLibrary::embedded(),
            session: Session::open(None),
            system_dialogs: false,
            timings: None,
        }
    }
}

/// What else than the figure a window shows.
#[derive(Default)]
struct Layout {
    function: FunctionView,
    search: String,
    renaming: Option<(usize, String)>,
    hides_panels: bool,
    shows_history: bool,
    pictures: Pictures,
}

/// The editor: the state behind the window.
pub struct Editor {
    painter: Painter,
    gallery: Gallery,
    session: Session,
    adapter: String,
    system_dialogs: bool,
    open: Option<OpenFigure>,
    autosave: Option<Autosave>,
    viewport: Viewport,
    layout: Layout,
    loading: Option<Job<Loaded>>,
    /// A volume on its way into a slot; whether that is an edit, or only brings what the figure names.
    filling: Option<(Job<Arc<Volume>>, usize, VolumeSlot, bool)>,
    searching: Option<(Job<Vec<PathBuf>>, usize)>,
    /// A slot whose volume could not be read, and why; it is not tried again by itself.
    missing: Option<(VolumeSlot, String)>,
    file_dialog: Option<FileDialog>,
    dialog: Option<Dialog>,
    recents: Vec<Recent>,
    orphans: Vec<Orphan>,
    /// What went wrong last, until it is closed.
    banner: Option<String>,
    /// What is worth a line in the status bar, for a while.
    notice: Notice,
    timings: Option<Timings>,
    quitting: bool,
}

impl Editor {
    /// An editor without a figure; what the options name is opened.
    pub fn new(ctx: &Context, options: Options) -> Self {
        theme::install(ctx);
        ctx.options_mut(|o| o.zoom_with_keyboard = false);
        let styles = Arc::new(options.styles);
        let mut editor = Self {
            painter: Painter::start(options.adapter, styles.clone(), waker(ctx)),
            gallery: Gallery::start(ctx, styles),
            recents: options.session.recents(),
            orphans: options.session.recoverable(),
            session: options.session,
            adapter: String::new(),
            system_dialogs: options.system_dialogs,
            open: None,
            autosave: None,
            viewport: Viewport::default(),
            layout: Layout::default(),
            loading: None,
            filling: None,
            searching: None,
            missing: None,
            file_dialog: None,
            dialog: None,
            banner: None,
            notice: Notice::default(),
            timings: options.timings.map(|(path, begun)| Timings::new(path, begun)),
            quitting: false,
        };
        if !options.files.is_empty() {
            editor.load(ctx, options.files);
        }
        editor
    }

    /// The document, if one is open.
    pub fn document(&self) -> Option<&Document> {
        self.open.as_ref().map(|open| &open.document)
    }

    /// The figure that is open, with what is chosen in it.
    pub fn open_figure(&mut self) -> Option<&mut OpenFigure> {
        self.open.as_mut()
    }

    /// Whether something is read, or a picture is still to come.
    pub fn is_busy(&self) -> bool {
        let waits = self.loading.is_some() || self.filling.is_some() || self.searching.is_some();
        let drawn = matches!(self.viewport.picture.stage, Some(Stage::Refined { .. } | Stage::Failed));
        waits || self.open.as_ref().is_some_and(|open| open.missing().is_none() && !drawn)
    }

    /// The last fault that the user was told.
    pub fn banner(&self) -> Option<&str> {
        self.banner.as_deref()
    }

    /// The last line in the status bar.
    pub fn notice(&self) -> &str {
        &self.notice.text
    }

    /// The thread that draws.
    pub fn painter(&self) -> &Painter {
        &self.painter
    }

    fn load(&mut self, ctx: &Context, paths: Vec<PathBuf>) {
        let title = paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
        self.begin_loading(Job::start(title, waker(ctx), move |progress| files::load(&paths, progress)));
    }

    fn begin_loading(&mut self, job: Job<Loaded>) {
        if let Some(loading) = self.loading.replace(job) {
            loading.progress.cancel();
        }
        self.banner = None;
    }

    fn load_shipped(&mut self, ctx: &Context, which: usize) {
        let figure = SHIPPED[which].figure();
        let job = Job::start(figure.title.clone(), waker(ctx), move |p| files::load_figure(figure, None, p));
        self.begin_loading(job);
    }

    fn restore(&mut self, ctx: &Context, which: usize) {
        if which >= self.orphans.len() {
            return;
        }
        match self.orphans.remove(which).restore() {
            Ok((found, slot)) => {
                let Recoverable { path, figure, .. } = found;
                let saved = path.as_deref().and_then(|p| Template::read(p).ok());
                self.show_document(ctx, Document::recovered(figure, saved), path, &[], Some(slot));
                self.notice = Notice::now("Recovered; save it to keep it");
            }
            Err(error) => self.banner = Some(format!("{error:#}")),
        }
    }

    fn poll(&mut self, ctx: &Context) {
        self.gallery.poll(ctx);
        if let Some(result) = self.loading.as_ref().and_then(Job::finished) {
            self.loading = None;
            match result {
                Ok(loaded) => self.show_loaded(ctx, loaded),
                Err(error) if is_cancelled(&error) => self.notice = Notice::now("Opening was cancelled"),
                Err(error) => self.banner = Some(format!("{error:#}")),
            }
        }
        self.poll_volumes(ctx);
        let updates: Vec<Update> = self.painter.updates().collect();
        for update in updates {
            match update {
                Update::Ready(name) => self.adapter = name,
                Update::Restarted => self.notice = Notice::now("Graphics device restarted"),
                update => {
                    if let Some(fault) = self.viewport.picture.take(ctx, update) {
                        self.banner = Some(fault);
                    }
                }
            }
        }
        if let Some(answer) = self.file_dialog.as_ref().and_then(FileDialog::poll)
            && let Some(dialog) = self.file_dialog.take()
        {
            match answer {
                Answer::Path(path) => self.path_given(ctx, dialog.purpose, path),
                Answer::Nothing => {}
                Answer::NoDialog => self.ask_for_typed_path(dialog.purpose),
            }
        }
        if let Some(fault) = self.open.as_mut().and_then(|open| open.fault.take()) {
            self.banner = Some(fault);
        }
    }

    /// Volumes that are missing are read, found, or asked for.
    fn poll_volumes(&mut self, ctx: &Context) {
        if let Some((job, ..)) = &self.filling
            && let Some(result) = job.finished()
            && let Some((_, number, slot, is_edit)) = self.filling.take()
            && let Some(open) = &mut self.open
        {
            match result {
                Ok(volume) => {
                    self.notice = Notice::now(volume.warnings.join("; "));
                    open.keep_volume(slot.clone(), volume);
                    if is_edit {
                        open.edit(Command::SetVolume { slot: number, volume: slot });
                    }
                    self.missing = None;
                    self.viewport.picture.ask_again();
                }
                Err(error) if is_edit && is_cancelled(&error) => {}
                Err(error) if is_edit => self.banner = Some(format!("{error:#}. The figure is as it was")),
                Err(error) => self.missing = Some((slot, format!("{error:#}"))),
            }
        }
        if let Some((job, _)) = &self.searching
            && let Some(result) = job.finished()
            && let Some((_, number)) = self.searching.take()
        {
            match result.map(|found| found.into_iter().next()) {
                Ok(Some(path)) => self.fill(ctx, number, &path),
                Ok(None) => self.banner = Some("There is no file of this name in the folder or below it".to_owned()),
                Err(error) if is_cancelled(&error) => {}
                Err(error) => self.banner = Some(format!("{error:#}")),
            }
        }
        // Undo may bring back a slot that was never read.
        let Some(open) = self.open.as_ref().filter(|_| self.filling.is_none()) else { return };
        let Some(number) = open.missing() else { return };
        let slot = open.document.figure().volumes[number].clone();
        if self.missing.as_ref().is_some_and(|(tried, _)| *tried == slot) {
            return;
        }
        let (theirs, folder) = (slot.clone(), open.folder().to_owned());
        let job = Job::start(slot.file.clone(), waker(ctx), move |p| files::load_slot(&theirs, &folder, p));
        self.filling = Some((job, number, slot, false));
    }

    /// Reads a file for a slot; once it is there, its use is an edit.
    fn fill(&mut self, ctx: &Context, number: usize, path: &Path) {
        let Some(open) = &self.open else { return };
        let Some(slot) = open.document.figure().volumes.get(number) else { return };
        match files::slot_for(slot, path) {
            Ok(slot) => {
                let theirs = slot.clone();
                let job =
                    Job::start(slot.file.clone(), waker(ctx), move |p| files::load_slot(&theirs, Path::new(""), p));
                self.filling = Some((job, number, slot, true));
            }
            Err(error) => self.banner = Some(format!("{error:#}")),
        }
    }

    fn show_loaded(&mut self, ctx: &Context, loaded: Loaded) {
        let notes = loaded.notes.join("; ");
        let unread = loaded.volumes.is_empty() && !loaded.figure.volumes.is_empty();
        let slot = loaded.figure.volumes.first().cloned();
        self.show_document(ctx, Document::new(loaded.figure), loaded.path, &loaded.volumes, None);
        if let (true, Some(slot)) = (unread, slot) {
            self.missing = Some((slot, notes));
        } else {
            self.notice = Notice::now(notes);
        }
    }

    fn show_document(
        &mut self,
        ctx: &Context,
        document: Document,
        path: Option<PathBuf>,
        volumes: &[Arc<Volume>],
        slot: Option<RecoverySlot>,
    ) {
        self.close_figure();
        self.autosave = Some(Autosave::start(self.session.clone(), slot, waker(ctx)));
        let open = OpenFigure::new(document, path, volumes);
        ctx.send_viewport_cmd(ViewportCommand::Title(format!("{} - Fabrica", open.name())));
        self.open = Some(open);
        self.note_recent();
    }

    /// Takes the open figure away; what was kept of it against a crash goes with it.
    fn close_figure(&mut self) {
        self.note_recent();
        if let Some(autosave) = self.autosave.take() {
            // Nobody needs to wait for it.
            drop(autosave.close());
        }
        self.open = None;
        (self.filling, self.searching, self.missing) = (None, None, None);
        (self.banner, self.notice) = (None, Notice::default());
        self.viewport.picture.clear();
        self.viewport.dismiss();
        self.layout.function.forget_figure();
        self.layout.renaming = None;
    }

    /// Puts a saved figure on the list of recent ones, with its picture if there is one.
    fn note_recent(&mut self) {
        let Some(open) = &self.open else { return };
        let Some(path) = &open.path else { return };
        let picture = self.viewport.picture.pixels().filter(|_| !open.document.is_changed());
        let thumbnail = picture.map(|(rgba, size)| Pixels { size, rgba });
        // Best effort: the list is no part of anybody's work.
        let _ = self.session.note_recent(path, open.document.figure(), thumbnail);
        self.recents = self.session.recents();
        self.layout.pictures.clear();
    }

    /// Why a command cannot be run just now; `None` if it can.
    pub fn disabled(&self, command: UiCommand) -> Option<&'static str> {
        let document = self.document();
        let node = self.open.as_ref().and_then(|open| open.node);
        match command {
            c if c.needs_figure() && document.is_none() => Some("Open a volume or a figure first (Ctrl+O)"),
            UiCommand::Undo if document.is_some_and(|d| d.undo_label().is_none() && !d.in_gesture()) => {
                Some("Nothing to undo")
            }
            UiCommand::Redo if document.is_some_and(|d| d.redo_label().is_none()) => Some("Nothing to redo"),
            UiCommand::InsertNode | UiCommand::RemoveNode if node.is_none() => {
                Some("Choose a node of the transfer function first")
            }
            UiCommand::RemoveNode
                if self
                    .open
                    .as_ref()
                    .and_then(OpenFigure::chosen)
                    .is_some_and(|o| o.transfer_function.nodes.len() == 1) =>
            {
                Some("A transfer function needs one node at least")
            }
            UiCommand::Rename | UiCommand::ShowHide if self.open.as_ref().is_some_and(|o| o.chosen().is_none()) => {
                Some("The figure has no object")
            }
            UiCommand::ReplaceVolume if document.is_some_and(|d| d.figure().volumes.is_empty()) => {
                Some("The figure has no place for a volume")
            }
            _ => None,
        }
    }

    /// Runs a command, unless it is disabled.
    pub fn run(&mut self, ctx: &Context, command: UiCommand) {
        if self.disabled(command).is_none() && !self.run_on_figure(command) {
            self.run_on_window(ctx, command);
        }
    }

    /// Runs what is an edit of the figure; whether it was one.
    fn run_on_figure(&mut self, command: UiCommand) -> bool {
        use UiCommand as C;
        let Some(open) = &mut self.open else { return false };
        let camera = &open.document.figure().camera;
        let side = |direction| Command::SetCamera(view::from_side(camera, direction));
        let edit = match command {
            C::Fit => Command::SetCamera(view::fit(camera)),
            C::FromFront => side(DVec3::Y),
            C::FromBack => side(DVec3::NEG_Y),
            C::FromLeft => side(DVec3::NEG_X),
            C::FromRight => side(DVec3::X),
            C::FromAbove => side(DVec3::Z),
            C::FromBelow => side(DVec3::NEG_Z),
            C::RollLeft => Command::SetCamera(view::roll(camera, 15f64.to_radians())),
            C::RollRight => Command::SetCamera(view::roll(camera, -15f64.to_radians())),
            C::Projection => Command::SetProjection(view::other(camera.projection)),
            C::QualityDraft => Command::SetQuality(QualityName::Draft),
            C::QualityStandard => Command::SetQuality(QualityName::Standard),
            C::QualityFinal => Command::SetQuality(QualityName::Final),
            C::ShowHide => {
                let visible = !open.chosen().is_some_and(|o| o.visible);
                Command::SetVisible { object: open.object, visible }
            }
            C::RemoveNode => {
                let Some(node) = open.node.take() else { return true };
                Command::RemoveNode { object: open.object, node }
            }
            C::InsertNode => {
                transfer_function::insert_after_chosen(open);
                return true;
            }
            _ => return false,
        };
        open.edit(edit);
        true
    }

    fn run_on_window(&mut self, ctx: &Context, command: UiCommand) {
        use UiCommand as C;
        match command {
            C::New => self.guarded(ctx, Then::New),
            C::Open => self.ask_for_path(ctx, Purpose::Open),
            C::OpenFolder => self.ask_for_path(ctx, Purpose::OpenFolder),
            C::Save => self.save(ctx),
            C::SaveAs => self.ask_for_path(ctx, Purpose::Save),
            C::ReplaceVolume => {
                let slot = self.open.as_ref().and_then(OpenFigure::missing).unwrap_or(0);
                self.ask_for_path(ctx, Purpose::Volume(slot));
            }
            C::Quit => self.guarded(ctx, Then::Quit),
            C::Palette => self.dialog = Some(Dialog::Palette(String::new(), 0)),
            C::History => self.layout.shows_history = !self.layout.shows_history,
            C::Panels => self.layout.hides_panels = !self.layout.hides_panels,
            C::HistogramScale => self.layout.function.logarithmic = !self.layout.function.logarithmic,
            C::Rename => {
                self.layout.hides_panels = false;
                let name = self.open.as_ref().and_then(|o| Some((o.object, o.chosen()?.title().to_owned())));
                self.layout.renaming = name;
            }
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
                    let begun = Instant::now();
                    let done = if command == C::Undo { open.document.undo() } else { open.document.redo() };
                    debug_assert!(done, "disabled() says whether there is a step");
                    if let Some(timings) = &mut self.timings {
                        timings.undone(begun.elapsed());
                    }
                }
            }
            _ => {}
        }
    }

    /// Makes an edit; a fault becomes the banner.
    pub fn edit(&mut self, command: Command) {
        if let Some(open) = &mut self.open {
            open.edit(command);
        }
    }

    fn ask_for_path(&mut self, ctx: &Context, purpose: Purpose) {
        if self.system_dialogs {
            if self.file_dialog.is_none() {
                self.file_dialog = Some(FileDialog::open(purpose, &self.proposed_path(), waker(ctx)));
            }
        } else {
            self.ask_for_typed_path(purpose);
        }
    }

    fn ask_for_typed_path(&mut self, purpose: Purpose) {
        let proposed = match purpose {
            Purpose::Save => self.proposed_path().display().to_string(),
            _ => String::new(),
        };
        self.dialog = Some(Dialog::Path(purpose, proposed));
    }

    /// Where a figure is likely to be saved, or others to lie.
    fn proposed_path(&self) -> PathBuf {
        let open = self.open.as_ref();
        let beside_volume = || {
            let file = PathBuf::from(&open?.document.figure().volumes.first()?.file);
            file.is_absolute().then(|| {
                let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let stem = name.split('.').next().filter(|s| !s.is_empty()).unwrap_or("figure").to_owned();
                file.with_file_name(stem + ".json")
            })
        };
        let path = open.and_then(|o| o.path.clone()).or_else(beside_volume);
        let path = path.unwrap_or_else(|| PathBuf::from("figure.json"));
        std::path::absolute(&path).unwrap_or(path)
    }

    fn path_given(&mut self, ctx: &Context, purpose: Purpose, path: PathBuf) {
        match purpose {
            Purpose::Open | Purpose::OpenFolder => self.guarded(ctx, Then::Open(vec![path])),
            Purpose::Save => {
                let path = if path.extension().is_none() { path.with_extension("json") } else { path };
                self.save_to(ctx, &path);
            }
            Purpose::Volume(slot) => self.fill(ctx, slot, &path),
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
                self.note_recent();
                if let Some(autosave) = self.autosave.take() {
                    // What was kept against a crash must be gone before the program is.
                    let _ = autosave.close().join();
                }
                self.quitting = true;
                ctx.send_viewport_cmd(ViewportCommand::Close);
            }
            Then::New => {
                self.close_figure();
                self.orphans = self.session.recoverable();
                ctx.send_viewport_cmd(ViewportCommand::Title("Fabrica".to_owned()));
            }
            Then::Open(paths) => self.load(ctx, paths),
            Then::Shipped(which) => self.load_shipped(ctx, which),
            Then::Restore(which) => self.restore(ctx, which),
        }
    }

    fn save(&mut self, ctx: &Context) {
        match self.open.as_ref().and_then(|open| open.path.clone()) {
            Some(path) => self.save_to(ctx, &path),
            None => self.ask_for_path(ctx, Purpose::Save),
        }
    }

    fn save_to(&mut self, ctx: &Context, path: &Path) {
        let Some(open) = &mut self.open else { return };
        let written = write(open, path);
        match written {
            Ok(()) => {
                open.path = Some(path.to_owned());
                ctx.send_viewport_cmd(ViewportCommand::Title(format!("{} - Fabrica", open.name())));
                self.notice = Notice::now(format!("Saved {}", path.display()));
                self.note_recent();
            }
            Err(error) => self.banner = Some(format!("{error:#}. Nothing was lost")),
        }
    }

    /// The whole window.
    pub fn ui(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        self.poll(&ctx);
        self.escape(&ctx);
        self.dropped(&ctx);
        if ctx.input(|i| i.viewport().close_requested()) && !self.quitting {
            ctx.send_viewport_cmd(ViewportCommand::CancelClose);
            self.guarded(&ctx, Then::Quit);
        }
        self.autosave(&ctx);
        let bar = egui::Frame::new().fill(theme::tokens(&ctx).panel).inner_margin(egui::Margin::symmetric(8, 2));
        Panel::top("menus").frame(bar).show(ui, |ui| self.menus(ui));
        Panel::bottom("status").frame(bar).show(ui, |ui| self.status(ui));
        self.banners(ui);
        let canvas = egui::Frame::new().fill(theme::tokens(&ctx).canvas);
        if self.loading.is_some() {
            CentralPanel::default().frame(canvas).show(ui, |ui| self.progress(ui));
        } else if self.open.is_some() {
            self.workspace(ui, canvas);
        } else {
            self.start_page(ui);
        }
        self.shortcuts(&ctx);
        self.dialogs(&ctx);
        if let Some(timings) = &mut self.timings {
            let busy = self.open.is_some() && !self.viewport.picture.is_refined();
            timings.frame(busy, self.open.is_some() || self.loading.is_none());
        }
    }

    fn autosave(&mut self, ctx: &Context) {
        let Some((open, autosave)) = self.open.as_ref().zip(self.autosave.as_mut()) else { return };
        if let Some(wait) = autosave.tick(&open.document, open.path.as_deref(), Instant::now()) {
            ctx.request_repaint_after(wait);
        }
    }

    /// Shortcuts, at the end of a frame: what the pointer did in it came first (a drag, then Ctrl+S).
    fn shortcuts(&mut self, ctx: &Context) {
        if self.dialog.is_some() {
            return;
        }
        let typing = ctx.text_edit_focused();
        // Those with more modifiers first: egui's test ignores further ones.
        let mut keyed: Vec<_> = UiCommand::ALL.iter().filter_map(|c| Some((*c, c.shortcut()?))).collect();
        keyed.sort_by_key(|(_, s)| {
            let m = s.modifiers;
            std::cmp::Reverse([m.alt, m.shift, m.ctrl || m.command].into_iter().filter(|on| *on).count())
        });
        for (command, shortcut) in keyed {
            if !(typing && command.yields_to_text()) && ctx.input_mut(|i| i.consume_shortcut(&shortcut)) {
                self.run(ctx, command);
                ctx.request_repaint();
            }
        }
    }

    fn escape(&mut self, ctx: &Context) {
        if !ctx.input(|i| i.key_pressed(Key::Escape)) {
            return;
        }
        let gesture = self.open.as_mut().is_some_and(|open| {
            let under_way = open.document.in_gesture();
            open.document.abort();
            under_way
        });
        if !gesture
            && !self.viewport.dismiss()
            && self.dialog.is_none()
            && !ctx.text_edit_focused()
            && let Some(open) = &mut self.open
        {
            open.node = None;
        }
    }

    fn dropped(&mut self, ctx: &Context) {
        let paths: Vec<PathBuf> = ctx.input(|i| i.raw.dropped_files.iter().map(|f| f.path().to_owned()).collect());
        if paths.is_empty() {
            return;
        }
        // A volume on an open figure may be meant for it.
        if self.open.is_some() && paths.len() == 1 && !paths.iter().any(|p| files::is_template(p)) {
            self.dialog = Some(Dialog::Dropped(paths));
        } else {
            self.guarded(ctx, Then::Open(paths));
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
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let keys = UiCommand::Palette.shortcut().map_or(String::new(), |s| ctx.format_shortcut(&s));
                let search = egui::Button::new(theme::small(&ctx, "Search commands"))
                    .shortcut_text(keys)
                    .frame_when_inactive(true)
                    .fill(theme::tokens(&ctx).raised)
                    .stroke(egui::Stroke::new(1.0, theme::tokens(&ctx).border));
                if ui.add(search.min_size(egui::Vec2::new(200.0, 22.0))).clicked() {
                    self.run(&ctx, UiCommand::Palette);
                }
                if let Some(open) = &self.open {
                    ui.add_space(24.0);
                    let mark = if open.document.is_changed() { " •" } else { "" };
                    let hover = if mark.is_empty() { "" } else { "There are changes that are not saved" };
                    ui.label(egui::RichText::new(format!("{}{mark}", open.name())).strong()).on_hover_text(hover);
                }
            });
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
        let tokens = theme::tokens(ui.ctx());
        ui.horizontal(|ui| {
            if let Some(open) = &self.open {
                if let Some(under) = self.viewport.under() {
                    ui.label(place(under.position_mm));
                    let unit = match open.chosen_volume().map(|v| v.modality) {
                        Some(Modality::Ct) => "HU",
                        _ => "",
                    };
                    ui.label(format!("{:.1} {unit}", under.value));
                    ui.separator();
                }
                if !self.notice.is_fresh(ui.ctx()) {
                    ui.label(theme::small(ui.ctx(), self.viewport.hint));
                }
            }
            if self.notice.is_fresh(ui.ctx()) {
                ui.label(&self.notice.text);
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.label(theme::small(ui.ctx(), &self.adapter)).on_hover_text("What draws the figure");
                if let Some(fault) = self.autosave.as_ref().and_then(Autosave::fault) {
                    ui.colored_label(tokens.warning, "Not kept against a crash").on_hover_text(fault);
                }
                if self.open.is_some() {
                    ui.separator();
                    self.picture_status(ui);
                }
            });
        });
    }

    /// How far the picture is, from right to left.
    fn picture_status(&self, ui: &mut Ui) {
        let tokens = theme::tokens(ui.ctx());
        if let Some(codes) = self.viewport.picture.error_codes {
            let tooltip = "Estimated difference from the exact picture, in 8-bit codes, of 99.9 % of the pixels. The quality \
                           (Figure) sets it";
            ui.label(format!("Error ~{codes:.1}/255")).on_hover_text(tooltip);
        }
        match self.viewport.picture.stage {
            None => drop(ui.label("Drawing")),
            Some(Stage::Coarse) => drop(ui.label("Coarse")),
            Some(Stage::Refining(share)) => {
                ui.label(format!("Refining {:.0} %", 100.0 * share));
                ui.add(egui::ProgressBar::new(share).desired_width(80.0).desired_height(6.0));
            }
            Some(Stage::Refined { seconds }) => {
                ui.colored_label(tokens.good, format!("Refined in {seconds:.1} s"));
            }
            Some(Stage::Failed) => drop(ui.colored_label(tokens.error, "Not drawn")),
        }
    }

    fn banners(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        let tokens = theme::tokens(&ctx);
        let frame = theme::panel_frame(&ctx);
        if let Some(banner) = self.banner.clone() {
            Panel::top("banner").frame(frame).show(ui, |ui| {
                ui.horizontal_wrapped(|ui| {
                    ui.colored_label(tokens.error, banner);
                    if ui.button("Close").clicked() {
                        self.banner = None;
                    }
                });
            });
        }
        if let Some((job, ..)) = &self.filling {
            let (title, progress) = (job.title.clone(), job.progress.clone());
            Panel::top("filling").frame(frame).show(ui, |ui| progress_row(ui, &title, &progress));
        } else if let Some((job, _)) = &self.searching {
            let (title, progress) = (job.title.clone(), job.progress.clone());
            Panel::top("searching").frame(frame).show(ui, |ui| progress_row(ui, &title, &progress));
        } else if let Some(number) = self.open.as_ref().and_then(OpenFigure::missing) {
            Panel::top("missing").frame(frame).show(ui, |ui| self.missing_volume(ui, number));
        }
        if self.open.is_some() && !self.orphans.is_empty() {
            Panel::top("recovered").frame(frame).show(ui, |ui| {
                ui.horizontal_wrapped(|ui| {
                    let one = self.orphans.len() == 1;
                    let text = if one { "A figure was" } else { "Figures were" };
                    ui.colored_label(tokens.warning, format!("{text} not saved when Fabrica ended."));
                    if ui.button("Show").on_hover_text("On the start page").clicked() {
                        self.guarded(&ctx, Then::New);
                    }
                    if ui.button("Later").clicked() {
                        self.orphans.clear();
                    }
                });
            });
        }
    }

    fn missing_volume(&mut self, ui: &mut Ui, number: usize) {
        let ctx = ui.ctx().clone();
        let Some(open) = &self.open else { return };
        let file = PathBuf::from(&open.document.figure().volumes[number].file);
        let folder = open.folder().to_owned();
        let why = self.missing.as_ref().map_or("The figure's volume was not read", |(_, why)| why).to_owned();
        ui.horizontal_wrapped(|ui| {
            ui.colored_label(theme::tokens(&ctx).error, why);
            if ui.button("Find…").on_hover_text("Another place for this volume; the look stays").clicked() {
                self.ask_for_path(&ctx, Purpose::Volume(number));
            }
            let beside = !folder.as_os_str().is_empty();
            let search = ui.add_enabled(beside, egui::Button::new("Search the figure's folder"));
            let search = search.on_hover_text("For a file of the same name, also in the folders below");
            if search.on_disabled_hover_text("The figure is not saved anywhere").clicked() {
                let name = file.file_name().unwrap_or(OsStr::new("")).to_owned();
                let title = format!("{} for {}", folder.display(), name.to_string_lossy());
                let job = Job::start(title, waker(&ctx), move |p| Ok(find_file::search(&folder, &name, p)?));
                self.searching = Some((job, number));
            }
            if ui.button("Try again").clicked() {
                self.missing = None;
            }
            ui.label(theme::small(&ctx, "The figure can be edited and saved without it"));
        });
    }

    fn progress(&mut self, ui: &mut Ui) {
        let Some(loading) = &self.loading else { return };
        let (title, progress) = (loading.title.clone(), loading.progress.clone());
        ui.vertical_centered(|ui| {
            ui.add_space(0.4 * ui.available_height());
            ui.label(egui::RichText::new(title).strong());
            let (stage, done, total) = progress.snapshot();
            ui.label(theme::small(ui.ctx(), stage));
            let share = if total > 0 { done as f32 / total as f32 } else { 0.0 };
            ui.add(egui::ProgressBar::new(share).desired_width(320.0));
            if ui.button("Cancel").clicked() {
                progress.cancel();
            }
        });
        ui.ctx().request_repaint_after(Duration::from_millis(100));
    }

    fn start_page(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        let contents = start_page::Contents { recents: &self.recents, orphans: &self.orphans };
        let chosen = start_page::show(ui, &contents, &mut self.layout.pictures);
        match chosen {
            None => {}
            Some(start_page::Choice::Run(command)) => self.run(&ctx, command),
            Some(start_page::Choice::Open(path)) => self.load(&ctx, vec![path]),
            Some(start_page::Choice::Shipped(which)) => self.load_shipped(&ctx, which),
            Some(start_page::Choice::Restore(which)) => self.restore(&ctx, which),
            Some(start_page::Choice::Forget(path)) => {
                let _ = self.session.forget_recent(&path);
                self.recents = self.session.recents();
            }
            Some(start_page::Choice::Discard(which)) => {
                if let Err(error) = self.orphans.remove(which).discard() {
                    self.banner = Some(format!("{error:#}"));
                }
            }
        }
    }

    /// The figure with its panels.
    fn workspace(&mut self, ui: &mut Ui, canvas: egui::Frame) {
        let Some(open) = &mut self.open else { return };
        let ctx = ui.ctx().clone();
        let frame = theme::panel_frame(&ctx);
        let mut wants_volume = false;
        let shown = !self.layout.hides_panels;
        if shown {
            Panel::right("right").frame(frame).default_size(290.0).size_range(220.0..=420.0).show(ui, |ui| {
                objects::show(ui, open, &self.gallery, &mut self.layout.renaming);
                ui.separator();
                if self.layout.shows_history {
                    history::show(ui, open);
                    ui.separator();
                }
                egui::ScrollArea::vertical().id_salt("properties").auto_shrink(false).show(ui, |ui| {
                    wants_volume = properties::show(ui, open);
                });
            });
            Panel::bottom("function").frame(frame).default_size(210.0).size_range(120.0..=480.0).resizable(true).show(
                ui,
                |ui| {
                    Panel::right("gallery")
                        .frame(egui::Frame::new().inner_margin(egui::Margin { left: 12, ..Default::default() }))
                        .default_size(290.0)
                        .size_range(150.0..=520.0)
                        .show(ui, |ui| styles::show(ui, open, &self.gallery, &mut self.layout.search));
                    CentralPanel::default().frame(egui::Frame::new()).show(ui, |ui| {
                        transfer_function::show(ui, open, &self.gallery, &mut self.layout.function);
                    });
                },
            );
        }
        CentralPanel::default().frame(canvas).show(ui, |ui| {
            self.viewport.show(ui, open, &self.gallery, &mut self.layout.function, &self.painter);
        });
        if wants_volume {
            self.run(&ctx, UiCommand::ReplaceVolume);
        }
    }

    fn dialogs(&mut self, ctx: &Context) {
        let Some(mut dialog) = self.dialog.take() else { return };
        let chosen = dialogs::show(ctx, &mut dialog, |command| self.disabled(command));
        match (chosen, dialog) {
            (None, dialog) => self.dialog = Some(dialog),
            (Some(Choice::Cancel), _) => {}
            (Some(Choice::Run(command)), _) => self.run(ctx, command),
            (Some(_), Dialog::Path(purpose, text)) => {
                // A volume may be missing its file's unsaved changes; they are asked about where it matters.
                self.path_given(ctx, purpose, PathBuf::from(text.trim()));
            }
            (Some(Choice::Other), Dialog::Unsaved(then)) => self.go_on(ctx, then),
            (Some(_), Dialog::Unsaved(then)) => {
                self.save(ctx);
                if self.document().is_some_and(|d| !d.is_changed()) {
                    self.go_on(ctx, then);
                }
            }
            (Some(Choice::Other), Dialog::Dropped(paths)) => self.guarded(ctx, Then::Open(paths)),
            (Some(_), Dialog::Dropped(paths)) => {
                if let Some(path) = paths.first() {
                    self.fill(ctx, 0, path);
                }
            }
            (Some(_), Dialog::Palette(..)) => {}
        }
    }

    /// The window is going: writes what is to be written.
    pub fn leave(&mut self) {
        if let Some(timings) = self.timings.take()
            && let Err(error) = timings.write(&self.viewport.picture.coarse_ms)
        {
            eprintln!("error: {error:#}");
        }
        // Where nobody was asked (the session ends), what is not saved is kept.
        if let Some((open, autosave)) = self.open.as_ref().zip(self.autosave.take()) {
            autosave.leave(&open.document, open.path.as_deref());
        }
    }
}

/// Writes the figure, its files named as they are called from the new place.
fn write(open: &mut OpenFigure, path: &Path) -> Result<()> {
    let (old, new) = files::folders(open.path.as_deref(), path);
    let mut renamed = Template::clone(open.document.figure());
    for slot in &mut renamed.volumes {
        files::rename_file(slot, old.as_deref(), new.as_deref())?;
    }
    files::save(&renamed, path)?;
    // Only now: what could not be written must not have changed.
    open.rename_files(|slot| {
        // Those that can be parsed in the present could be in the past.
        let _ = files::rename_file(slot, old.as_deref(), new.as_deref());
    });
    open.document.mark_saved();
    Ok(())
}

/// Wakes the window from another thread.
fn waker(ctx: &Context) -> impl Fn() + Send + 'static {
    let ctx = ctx.clone();
    move || ctx.request_repaint()
}

/// A position in the body: millimeters to the right, to the front, up, or to their opposites.
fn place(mm: DVec3) -> String {
    let one = |value: f64, letters: [char; 2]| {
        let letter = if value < 0.0 { letters[1] } else { letters[0] };
        format!("{letter} {:.1}", value.abs())
    };
    format!("{} {} {} mm", one(mm.x, ['R', 'L']), one(mm.y, ['A', 'P']), one(mm.z, ['S', 'I']))
}

fn progress_row(ui: &mut Ui, title: &str, progress: &fabrica_engine::Progress) {
    ui.horizontal(|ui| {
        let (stage, done, total) = progress.snapshot();
        ui.label(format!("{title}: {stage}"));
        let share = if total > 0 { done as f32 / total as f32 } else { 0.0 };
        ui.add(egui::ProgressBar::new(share).desired_width(160.0));
        if ui.button("Cancel").clicked() {
            progress.cancel();
        }
    });
    ui.ctx().request_repaint_after(Duration::from_millis(100));
}

impl eframe::App for Editor {
    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        if let Some(timings) = &mut self.timings {
            timings.cpu_usage(frame.info().cpu_usage);
        }
        Self::ui(self, ui);
    }

    fn on_exit(&mut self) {
        self.leave();
    }
}
