//! What is around the figure: menus, the status bar, what went wrong, progress, the start page.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use eframe::egui::{self, Context, Panel, Ui};
use fabrica_engine::Progress;
use glam::DVec3;

use super::super::autosave::Autosave;
use super::super::dialogs::Then;
use super::super::file_dialog::Purpose;
use super::super::files::Job;
use super::super::open_figure::OpenFigure;
use super::super::painter::Stage;
use super::super::panels::properties::shorter;
use super::super::panels::start_page;
use super::super::ui_command::UiCommand;
use super::super::viewport::{marked, structures_at, why_marked};
use super::super::{find_file, theme, wording};
use super::{Editor, waker};
use crate::figure::template::QualityName;

/// What went wrong, until it is closed.
#[derive(Clone, Debug)]
pub(super) struct Banner {
    pub(super) text: String,
    /// A way out.
    pub(super) offer: Option<UiCommand>,
}

impl Banner {
    /// A fault as a sentence.
    pub(super) fn new(text: impl Into<String>) -> Self {
        let text = text.into();
        let mut letters = text.chars();
        let first = letters.next().into_iter().flat_map(char::to_uppercase);
        Self { text: first.chain(letters).collect(), offer: None }
    }
}

/// A line that is shown for a while.
#[derive(Default)]
pub(super) struct Notice {
    pub(super) text: String,
    since: Option<Instant>,
}

/// From this width on, the status bar has room for a hint.
const WIDE: f32 = 1000.0;

/// How long a notice stays.
const NOTICE: Duration = Duration::from_secs(8);

impl Notice {
    pub(super) fn now(text: impl Into<String>) -> Self {
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

impl Editor {
    pub(super) fn menus(&mut self, ui: &mut Ui) {
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

    pub(super) fn menu_item(&mut self, ctx: &Context, ui: &mut Ui, command: UiCommand) {
        let mut button = egui::Button::new(self.label(command)).selected(self.is_on(command));
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

    /// Whether a command is one of several states, and the one that is on.
    fn is_on(&self, command: UiCommand) -> bool {
        let quality = self.document().map(|d| d.figure().quality);
        match command {
            UiCommand::QualityDraft => quality == Some(QualityName::Draft),
            UiCommand::QualityStandard => quality == Some(QualityName::Standard),
            UiCommand::QualityFinal => quality == Some(QualityName::Final),
            UiCommand::History => self.layout.shows_history,
            UiCommand::Slices => self.layout.shows_slices,
            UiCommand::Erase => self.tools.settings.erases(),
            UiCommand::ReplaceMode | UiCommand::AddMode | UiCommand::SubtractMode | UiCommand::IntersectMode => {
                self.tools.settings.mode.command() == command
            }
            command => self.open.is_some() && self.tools.active().command() == command,
        }
    }

    /// A command's name, with the step's for undo and redo.
    pub(super) fn label(&self, command: UiCommand) -> String {
        let step = match (command, self.document()) {
            (UiCommand::Undo, Some(d)) => d.undo_label(),
            (UiCommand::Redo, Some(d)) => d.redo_label(),
            _ => None,
        };
        if let (UiCommand::GrowSelection | UiCommand::ShrinkSelection | UiCommand::SmoothSelection, Some(open)) =
            (command, &self.open)
        {
            return format!("{} by {} mm", command.text(), shorter(self.tools.settings.refine_mm(open)));
        }
        match step {
            Some(step) => format!("{}: {step}", command.text()),
            None => command.text().to_owned(),
        }
    }

    pub(super) fn status(&mut self, ui: &mut Ui) {
        let tokens = theme::tokens(ui.ctx());
        ui.horizontal(|ui| {
            if let Some(open) = &self.open {
                if let Some(under) = self.slices.under().or(self.viewport.under()) {
                    let why = open.assumed_orientation();
                    let label = ui.label(place(under.position_mm, why.is_some()));
                    why.map(|why| label.on_hover_text(why_marked(why)));
                    let unit = open.chosen_volume().map_or("", |v| v.modality.suffix());
                    let named = open.chosen_volume().and_then(|v| structures_at(v, under.position_mm));
                    let region = self.viewport.region_under().filter(|_| self.slices.under().is_none());
                    let region = region.and_then(|number| open.part_at(number));
                    let unit = region.map_or(unit.to_owned(), |(.., s)| format!("{unit}, {}", s.label.name));
                    ui.label(match named {
                        Some(named) => named,
                        None if under.value.is_nan() => "no value".to_owned(),
                        None => format!("{:.1}{unit}", under.value),
                    });
                    ui.separator();
                }
                let hint = self.tools.hint().or(self.slices.hint()).unwrap_or(self.viewport.hint);
                if !self.notice.is_fresh(ui.ctx()) && ui.ctx().content_rect().width() > WIDE {
                    ui.label(theme::small(ui.ctx(), hint));
                }
            }
            if self.notice.is_fresh(ui.ctx()) {
                let room = (ui.available_width() - 420.0).max(120.0);
                ui.scope(|ui| {
                    ui.set_max_width(room);
                    ui.add(egui::Label::new(&self.notice.text).truncate()).on_hover_text(&self.notice.text);
                });
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
    pub(super) fn picture_status(&mut self, ui: &mut Ui) {
        let tokens = theme::tokens(ui.ctx());
        if let Some(codes) = self.viewport.picture.error_codes {
            let tooltip = "Estimated difference from the exact picture, in 8-bit codes, of 99.9 % of the pixels. The quality \
                           (Figure) sets it";
            ui.label(format!("Error ~{codes:.1}/255")).on_hover_text(tooltip);
        }
        match self.viewport.picture.stage {
            None if self.open.as_ref().is_some_and(|o| o.missing().is_some()) => drop(ui.label("No volume")),
            None => drop(ui.label("Drawing")),
            Some(Stage::Coarse) => drop(ui.label("Coarse")),
            Some(Stage::Refining(share)) => {
                ui.label(format!("Refining {:.0} %", 100.0 * share));
                ui.add(egui::ProgressBar::new(share).desired_width(80.0).desired_height(6.0));
                if ui.small_button("Stop").on_hover_text("Leaves the picture as it is").clicked() {
                    self.painter.stop();
                }
            }
            Some(Stage::Refined { seconds }) => {
                ui.colored_label(tokens.good, format!("Refined in {seconds:.1} s"));
            }
            Some(Stage::Stopped) => {
                if ui.small_button("Stopped: go on").on_hover_text("Draws the picture to its end").clicked() {
                    self.viewport.picture.ask_again();
                }
            }
            Some(Stage::Failed) => drop(ui.colored_label(tokens.error, "Not drawn")),
        }
    }

    pub(super) fn banners(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        let tokens = theme::tokens(&ctx);
        let frame = theme::panel_frame(&ctx);
        if let Some(banner) = self.banner.clone() {
            Panel::top("banner").frame(frame).show(ui, |ui| {
                ui.horizontal_wrapped(|ui| {
                    ui.colored_label(tokens.error, &banner.text);
                    if let Some(command) = banner.offer
                        && ui.button(command.text()).clicked()
                    {
                        self.banner = None;
                        self.run(&ctx, command);
                    }
                    if ui.button("Close").clicked() {
                        self.banner = None;
                    }
                });
            });
        }
        if let Some((job, ..)) = &self.selecting {
            let (title, progress) = (job.title.clone(), job.progress.clone());
            Panel::top("selecting").frame(frame).show(ui, |ui| progress_row(ui, &title, &progress));
        }
        if let Some((title, progress)) = self.tools.progress() {
            let (title, progress) = (title.to_owned(), progress.clone());
            Panel::top("refining").frame(frame).show(ui, |ui| progress_row(ui, &title, &progress));
        }
        if let Some((job, ..)) = &self.filling {
            let (title, progress) = (job.title.clone(), job.progress.clone());
            Panel::top("filling").frame(frame).show(ui, |ui| progress_row(ui, &title, &progress));
        } else if let Some((job, _)) = &self.searching {
            let (title, progress) = (job.title.clone(), job.progress.clone());
            Panel::top("searching").frame(frame).show(ui, |ui| progress_row(ui, &title, &progress));
        } else if let Some(number) = self.open.as_ref().and_then(OpenFigure::missing) {
            Panel::top("missing").frame(frame).show(ui, |ui| self.missing_volume(ui, number));
        } else if self.selecting.is_none()
            && let Some((number, why)) = self.open.as_ref().and_then(|open| open.missing_structures(&self.missed))
        {
            Panel::top("missing selections").frame(frame).show(ui, |ui| self.missing_selections(ui, number, &why));
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

    pub(super) fn missing_volume(&mut self, ui: &mut Ui, number: usize) {
        let ctx = ui.ctx().clone();
        let Some(open) = &self.open else { return };
        let file = PathBuf::from(&open.document.figure().volumes[number].file);
        let folder = open.folder().to_owned();
        let why = self.missing.as_ref().map_or("The figure's volume was not read", |(_, why)| why).to_owned();
        ui.horizontal_wrapped(|ui| {
            ui.colored_label(theme::tokens(&ctx).error, Banner::new(why).text);
            let choose = ui.button("Choose a file…");
            if choose.on_hover_text("This volume in another place, or another one; the look stays").clicked() {
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

    /// A label map that could not be read: the figure is drawn without its structures.
    pub(super) fn missing_selections(&mut self, ui: &mut Ui, number: usize, why: &str) {
        let ctx = ui.ctx().clone();
        ui.horizontal_wrapped(|ui| {
            ui.colored_label(theme::tokens(&ctx).error, Banner::new(why).text);
            let hint =
                "This label map in another place, or that of another scan; the looks stay by the structures' names";
            if ui.button("Choose a file…").on_hover_text(hint).clicked() {
                self.ask_for_path(&ctx, Purpose::OtherSelections(number));
            }
            if ui.button("Choose a folder of masks…").on_hover_text("A file for each structure").clicked() {
                self.ask_for_path(&ctx, Purpose::OtherMasks(number));
            }
            let Some(open) = &mut self.open else { return };
            let Some(slot) = open.document.figure().selections.get(number).cloned() else { return };
            if ui.button("Try again").clicked() {
                open.forget_selections(&slot);
            }
            if ui.button("Not now").on_hover_text("The figure can be edited and saved without it").clicked() {
                self.missed.push(slot);
            }
        });
    }

    pub(super) fn progress(&mut self, ui: &mut Ui) {
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

    pub(super) fn start_page(&mut self, ui: &mut Ui) {
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
                    self.banner = Some(Banner::new(wording::sentence(&error)));
                }
            }
        }
    }
}

/// A position in the body: millimeters to the right, to the front, up, or to their opposites.
fn place(mm: DVec3, is_assumed: bool) -> String {
    let one = |value: f64, letters: [char; 2]| {
        let letter = if value < 0.0 { letters[1] } else { letters[0] };
        format!("{} {:.1}", marked(letter, is_assumed), value.abs())
    };
    format!("{} {} {} mm", one(mm.x, ['R', 'L']), one(mm.y, ['A', 'P']), one(mm.z, ['S', 'I']))
}

fn progress_row(ui: &mut Ui, title: &str, progress: &Progress) {
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
