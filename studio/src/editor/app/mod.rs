//! The window: what is open, what is shown, and how commands and gestures reach the document. It holds no figure data of its
//! own and never waits: files are read on threads, pictures come from the painter.

mod chrome;
mod commands;
mod opening;
mod own_styles;

use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

use eframe::egui::{self, CentralPanel, Context, Key, Panel, Ui, UiBuilder, ViewportCommand};
use fabrica_engine::gpu::AdapterChoice;
use fabrica_engine::image_in;
use fabrica_engine::read::limits::Limits;
use fabrica_engine::slice::anatomical::Convention;
use fabrica_engine::styles::StyleLibrary;
use fabrica_engine::volume::Volume;

use self::chrome::{Banner, Notice};
use super::autosave::Autosave;
use super::dialogs::{Dialog, Then};
use super::file_dialog::{Answer, FileDialog};
use super::files::{self, Filled, Job, Opened, is_cancelled};
use super::filter_preview::FilterPreview;
use super::gallery::Gallery;
use super::open_figure::OpenFigure;
use super::painter::{Painter, Stage, Update};
use super::panels::start_page::Pictures;
use super::panels::transfer_function::{self, FunctionView};
use super::panels::{history, objects, properties, styles};
use super::recovery::Orphan;
use super::session::{Recent, Session, Settings};
use super::slices::SliceViews;
use super::style_from_picture::StyleFromPicture;
use super::theme;
use super::timings::Timings;
use super::tools::{self, Tools, View};
use super::ui_command::UiCommand;
use super::viewport::Viewport;
use super::volume_choice::VolumeChoice;
use super::wording;
use crate::figure::sources::Selections;
use crate::figure::template::{SelectionSlot, VolumeSlot};
use crate::figure::theme::Themes;
use crate::figure::{Command, Document};

/// With what a window begins.
pub struct Options {
    /// What draws the figure.
    pub adapter: AdapterChoice,
    /// What is opened first: a figure, a volume, or both.
    pub files: Vec<PathBuf>,
    /// The styles that can be used.
    pub styles: StyleLibrary,
    /// The themes that can be used.
    pub themes: Themes,
    /// What of the user's own cannot be used, and why: one sentence.
    pub fault: Option<String>,
    /// Where styles go that are made of pictures, if anywhere.
    pub styles_folder: Option<PathBuf>,
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
            themes: Themes::built_in().clone(),
            fault: None,
            styles_folder: None,
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
    fresh: styles::Fresh,
    renaming: Option<(usize, String)>,
    hides_panels: bool,
    shows_history: bool,
    shows_slices: bool,
    /// Which side slices have on the right, as it was kept last.
    is_neurological: bool,
    pictures: Pictures,
}

/// Selections on their way.
type Selecting = (Job<Arc<Selections>>, SelectionSlot, Arc<Volume>, Option<Command>);

/// The editor: the state behind the window.
pub struct Editor {
    painter: Painter,
    gallery: Gallery,
    styles_folder: Option<PathBuf>,
    session: Session,
    adapter: String,
    /// What a volume may take: what the adapter says, once it is open, and what is free.
    limits: Limits,
    system_dialogs: bool,
    open: Option<OpenFigure>,
    autosave: Option<Autosave>,
    viewport: Viewport,
    slices: SliceViews,
    filter_preview: FilterPreview,
    tools: Tools,
    layout: Layout,
    loading: Option<Job<Opened>>,
    /// A volume on its way into a slot; whether that is an edit, or only brings what the figure names.
    filling: Option<(Job<Filled>, usize, VolumeSlot, bool)>,
    /// Selections that are being read, for which slot and volume, and as which edit if they are new.
    selecting: Option<Selecting>,
    searching: Option<(Job<Vec<PathBuf>>, usize)>,
    /// A file that is looked at, to ask how it shall be read.
    asking: Option<Job<VolumeChoice>>,
    /// A picture on its way into the dialog that makes a style of it.
    picturing: Option<Job<StyleFromPicture>>,
    /// How a volume is just read, as it was answered: asked again if that fails.
    answered: Option<Box<VolumeChoice>>,
    /// A slot whose volume could not be read, and why; it is not tried again by itself.
    missing: Option<(VolumeSlot, String)>,
    /// Slots of selections that could not be read, and that the user wants to hear no more of.
    missed: Vec<SelectionSlot>,
    file_dialog: Option<FileDialog>,
    dialog: Option<Dialog>,
    /// What was asked for when the figure was to be saved first.
    after_saving: Option<Then>,
    recents: Vec<Recent>,
    /// The thread that puts a figure on that list.
    noting: Option<JoinHandle<()>>,
    orphans: Vec<Orphan>,
    /// What went wrong last, until it is closed.
    banner: Option<Banner>,
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
        let settings = options.session.settings();
        ctx.set_theme(if settings.dark { egui::Theme::Dark } else { egui::Theme::Light });
        ctx.set_zoom_factor(settings.scale.clamp(0.75, 2.0));
        let (styles, themes) = (Arc::new(options.styles), Arc::new(options.themes));
        let mut editor = Self {
            noting: None,
            painter: Painter::start(options.adapter, styles.clone(), themes.clone(), waker(ctx)),
            gallery: Gallery::start(ctx, styles, themes),
            styles_folder: options.styles_folder,
            recents: options.session.recents(),
            orphans: options.session.recoverable(),
            session: options.session,
            adapter: String::new(),
            limits: Limits::default(),
            system_dialogs: options.system_dialogs,
            open: None,
            autosave: None,
            viewport: Viewport::default(),
            slices: SliceViews::new(side_of(&settings)),
            filter_preview: FilterPreview::default(),
            tools: Tools::default(),
            layout: Layout {
                shows_slices: settings.slices,
                is_neurological: settings.neurological,
                ..Layout::default()
            },
            loading: None,
            filling: None,
            selecting: None,
            searching: None,
            asking: None,
            picturing: None,
            answered: None,
            missing: None,
            missed: Vec::new(),
            file_dialog: None,
            dialog: None,
            after_saving: None,
            banner: options.fault.map(Banner::new),
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

    /// Whether something is read, or a picture is still to come.
    pub fn is_busy(&self) -> bool {
        let waits = self.loading.is_some()
            || self.selecting.is_some()
            || self.filling.is_some()
            || self.searching.is_some()
            || self.asking.is_some()
            || self.picturing.is_some()
            || self.tools.is_busy();
        let drawn = matches!(self.viewport.picture.stage, Some(Stage::Refined { .. } | Stage::Failed | Stage::Stopped));
        waits || self.open.as_ref().is_some_and(|open| open.missing().is_none() && !drawn)
    }

    /// The last fault that the user was told.
    pub fn banner(&self) -> Option<&str> {
        self.banner.as_ref().map(|banner| banner.text.as_str())
    }

    /// The last line in the status bar.
    pub fn notice(&self) -> &str {
        &self.notice.text
    }

    /// The slices beside the figure, if they are shown.
    pub fn slices(&self) -> Option<&SliceViews> {
        self.layout.shows_slices.then_some(&self.slices)
    }

    /// The tools, and which of them is in the hand.
    pub fn tools(&self) -> &Tools {
        &self.tools
    }

    /// The picture of the figure, RGBA, with its columns and rows; none before the first whole one.
    pub fn picture_pixels(&self) -> Option<(&[u8], [usize; 2])> {
        self.viewport.picture.pixels()
    }

    /// The thread that draws.
    pub fn painter(&self) -> &Painter {
        &self.painter
    }

    fn poll(&mut self, ctx: &Context) {
        self.gallery.poll(ctx);
        if let Some(result) = self.loading.as_ref().and_then(Job::finished) {
            self.loading = None;
            match result {
                Ok(Opened::Figure(loaded)) => self.show_loaded(ctx, *loaded),
                Ok(Opened::Asked(choice)) => self.dialog = Some(Dialog::Volume(choice)),
                Err(error) if is_cancelled(&error) => {
                    self.answered = None;
                    self.notice = Notice::now("Opening was cancelled");
                }
                Err(error) => {
                    let sentence = wording::sentence(&error);
                    if !self.ask_again(&sentence) {
                        self.banner = Some(Banner::new(sentence));
                    }
                }
            }
        }
        self.poll_volumes(ctx);
        self.poll_picture();
        let updates: Vec<Update> = self.painter.updates().collect();
        for update in updates {
            match update {
                Update::Ready { adapter, edge } => (self.adapter, self.limits.edge) = (adapter, Some(edge)),
                Update::Restarted => self.notice = Notice::now("Graphics device restarted"),
                update => {
                    if let Some(fault) = self.viewport.picture.take(ctx, update) {
                        self.banner = Some(Banner::new(fault));
                    }
                }
            }
        }
        if let Some(answer) = self.file_dialog.as_ref().and_then(FileDialog::poll)
            && let Some(dialog) = self.file_dialog.take()
        {
            match answer {
                Answer::Path(path) => self.path_given(ctx, dialog.purpose, path),
                Answer::Nothing => self.after_saving = None,
                Answer::NoDialog => {
                    // Nor will there be one later: asking for it takes a while on a busy machine.
                    self.system_dialogs &= !dialog.was_refused_at_once();
                    self.ask_for_typed_path(dialog.purpose);
                }
            }
        }
        if let Some(fault) = self.open.as_mut().and_then(|open| open.fault.take()) {
            self.banner = Some(Banner::new(fault));
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
        self.gallery.follow_theme(self.open.as_ref().map(|open| open.document.figure().as_ref()));
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
        let pressed = |event: &egui::Event| matches!(event, egui::Event::Key { pressed: true, .. });
        if !ctx.input(|i| i.events.iter().any(pressed)) {
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
        let unfinished = self.tools.abort();
        if !gesture
            && !unfinished
            && !self.slices.abort()
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
        // No volume is a JPEG.
        if let ([path], Some(_)) = (&paths[..], &self.open)
            && image_in::is_named_as_picture(path)
            && !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"))
        {
            self.read_picture(ctx, path);
            return;
        }
        // A volume on an open figure may be meant for it.
        if self.open.is_some() && paths.len() == 1 && !paths.iter().any(|p| files::is_template(p)) {
            let has_volume = self.open.as_ref().is_some_and(|open| open.chosen_volume().is_some());
            self.dialog = Some(Dialog::Dropped(paths, has_volume));
        } else {
            self.guarded(ctx, Then::Open(paths));
        }
    }

    /// The figure with its panels.
    fn workspace(&mut self, ui: &mut Ui, canvas: egui::Frame) {
        let Some(open) = &mut self.open else { return };
        let ctx = ui.ctx().clone();
        let frame = theme::panel_frame(&ctx);
        let mut wanted = None;
        let mut pressed = None;
        let shown = !self.layout.hides_panels;
        self.tools.poll(open);
        if shown {
            let bar = frame.inner_margin(egui::Margin::symmetric(12, 3));
            Panel::top("options").frame(bar).exact_size(38.0).show(ui, |ui| {
                egui::ScrollArea::horizontal().id_salt("options").show(ui, |ui| {
                    ui.horizontal_centered(|ui| {
                        tools::bar::options(ui, self.tools.active(), &mut self.tools.settings, open)
                    });
                });
            });
            let strip = frame.inner_margin(egui::Margin::same(5));
            Panel::left("tools").frame(strip).exact_size(46.0).resizable(false).show(ui, |ui| {
                pressed = tools::bar::strip(ui, self.tools.active());
            });
            Panel::right("right")
                .frame(frame)
                .default_size(290.0)
                .size_range(250.0..=share(ui.available_width(), 420.0).max(280.0))
                .show(ui, |ui| {
                    objects::show(ui, open, &self.gallery, &mut self.layout.renaming);
                    ui.separator();
                    if self.layout.shows_history {
                        history::show(ui, open);
                        ui.separator();
                    }
                    egui::ScrollArea::vertical().id_salt("properties").auto_shrink(false).show(ui, |ui| {
                        let names = self.gallery.library().names();
                        let pending = self.filling.as_ref().map(|(_, number, slot, _)| (*number, slot));
                        let place_mm = self.slices.crosshair_mm().filter(|_| self.layout.shows_slices);
                        let filtering = properties::Filtering { preview: &mut self.filter_preview, place_mm, pending };
                        wanted = properties::show(ui, open, &names, self.gallery.wardrobe(), filtering);
                    });
                });
            Panel::bottom("function")
                .frame(frame)
                .default_size(210.0)
                .size_range(120.0..=share(ui.available_height(), 480.0))
                .resizable(true)
                .show(ui, |ui| {
                    Panel::right("gallery")
                        .frame(egui::Frame::new().inner_margin(egui::Margin { left: 12, ..Default::default() }))
                        .default_size(290.0)
                        .size_range(120.0..=share(ui.available_width(), 520.0))
                        .show(ui, |ui| {
                            let (search, fresh) = (&mut self.layout.search, &mut self.layout.fresh);
                            if styles::show(ui, open, &self.gallery, search, fresh) {
                                pressed = Some(UiCommand::StyleFromPicture);
                            }
                        });
                    CentralPanel::default().frame(egui::Frame::new()).show(ui, |ui| {
                        transfer_function::show(ui, open, &self.gallery, &mut self.layout.function);
                    });
                });
        }
        // Panels may have gone back in time.
        open.follow_voxels();
        (self.viewport.is_tools, self.slices.is_tools) = (self.tools.takes_primary(), self.tools.takes_primary());
        (self.slices.takes_wheel, self.viewport.rests) = (self.tools.takes_wheel(), self.tools.rests());
        CentralPanel::default().frame(canvas).show(ui, |ui| {
            let mut slice = None;
            if self.layout.shows_slices {
                let place = self.slices.show(ui, open);
                self.viewport.marker_mm = self.slices.crosshair_mm();
                ui.scope_builder(UiBuilder::new().id_salt("figure").max_rect(place), |ui| {
                    ui.painter().rect_filled(place, 0.0, canvas.fill);
                    self.viewport.show(ui, open, &self.gallery, &mut self.layout.function);
                });
                if let Some(pick) = self.viewport.take_asked() {
                    self.slices.look_at(pick.rest_mm);
                    ctx.request_repaint();
                }
                if let Some(under) = self.slices.under() {
                    self.layout.function.marked = Some(under.value).filter(|value| value.is_finite());
                }
                slice = self.slices.aimed().map(|(orientation, geometry)| View::Slice(orientation, geometry));
            } else {
                self.viewport.marker_mm = None;
                self.viewport.show(ui, open, &self.gallery, &mut self.layout.function);
                self.viewport.take_asked();
            }
            let aimed = slice.or_else(|| self.viewport.aimed().map(View::Figure));
            let begun = Instant::now();
            if self.tools.follow(ui, open, aimed) {
                self.viewport.picture.has_dabs(begun);
            }
            self.viewport.ask(open, &self.painter);
        });
        if let Some(said) = self.tools.take_said() {
            self.notice = Notice::now(said);
        }
        if let Some(command) = pressed {
            self.run(&ctx, command);
        }
        let neurological = self.slices.convention == Convention::Neurological;
        if neurological != self.layout.is_neurological {
            self.layout.is_neurological = neurological;
            self.keep_settings(Settings { neurological, ..self.session.settings() });
        }
        match wanted {
            None => {}
            Some(properties::Wanted::Command(command)) => self.run(&ctx, command),
            Some(properties::Wanted::Themes) => {
                if let Some(open) = &self.open {
                    let themes = self.gallery.wardrobe().themes;
                    self.painter.expect(self.viewport.picture.in_themes(open, themes));
                }
            }
            Some(properties::Wanted::Reading(number, slot)) => self.fill_with(&ctx, number, *slot, self.limits),
        }
    }

    /// The window is going: writes what is to be written.
    pub fn leave(&mut self) {
        if let Some(timings) = self.timings.take()
            && let picture = &self.viewport.picture
            && let Err(error) =
                timings.write(&picture.coarse_ms, self.tools.dab_ms(), &picture.dab_ms, &picture.theme_ms)
        {
            eprintln!("error: {error:#}");
        }
        self.noted();
        // Where nobody was asked (the session ends), what is not saved is kept.
        if let Some((open, autosave)) = self.open.as_ref().zip(self.autosave.take()) {
            autosave.leave(&open.document, open.path.as_deref());
        }
    }
}

/// The most that a panel may take of what there is, in points; `most` where there is enough. Small windows and large text leave
/// the figure its place.
fn share(available: f32, most: f32) -> f32 {
    (0.4 * available).clamp(200.0, most)
}

/// Which side of the body is on which side of slices.
fn side_of(settings: &Settings) -> Convention {
    if settings.neurological { Convention::Neurological } else { Convention::Radiological }
}

/// Wakes the window from another thread.
fn waker(ctx: &Context) -> impl Fn() + Send + 'static {
    let ctx = ctx.clone();
    move || ctx.request_repaint()
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
