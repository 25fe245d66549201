//! What each command does; saving, and the questions on the way.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use eframe::egui::{self, Context, ViewportCommand};
use fabrica_engine::Progress;
use fabrica_engine::slice::anatomical::Convention;
use glam::DVec3;

use super::super::dialogs::{self, Choice, Dialog, Then};
use super::super::file_dialog::{FileDialog, Purpose};
use super::super::movable::{Change, Movable};
use super::super::open_figure::OpenFigure;
use super::super::panels::curve;
use super::super::session::Settings;
use super::super::tools::{Mode, Tool};
use super::super::ui_command::UiCommand;
use super::super::{files, view, wording};
use super::chrome::{Banner, Notice};
use super::{Editor, waker};
use crate::figure::template::{CameraTemplate, QualityName};
use crate::figure::theme::Wardrobe;
use crate::figure::{Command, Document, Template, bridge, framing};

impl Editor {
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
            UiCommand::PutBack if !self.open.as_ref().and_then(Movable::chosen).is_some_and(|m| m.is_moved()) => {
                Some("Choose a region that is moved first")
            }
            UiCommand::InsertNode | UiCommand::RemoveNode if node.is_none() => {
                Some("Choose a node of the transfer function first")
            }
            UiCommand::RemoveNode
                if self.open.as_ref().and_then(OpenFigure::function).is_some_and(|f| f.nodes.len() == 1) =>
            {
                Some("A transfer function needs one node at least")
            }
            UiCommand::SliceSides | UiCommand::SliceWindow if !self.layout.shows_slices => {
                Some("Show slices first (Q)")
            }
            UiCommand::Rename | UiCommand::ShowHide if self.open.as_ref().is_some_and(|o| o.chosen().is_none()) => {
                Some("The figure has no object")
            }
            UiCommand::AddSelections | UiCommand::AddMasks
                if self.open.as_ref().is_some_and(|o| o.chosen_volume().is_none()) =>
            {
                Some("The object has no volume")
            }
            c if c.menu() == "Selection" && self.tools.progress().is_some() => Some("Another edit is under way"),
            c if c.menu() == "Selection" && self.open.as_ref().is_some_and(|o| self.tools.target(o).is_none()) => {
                Some("Paint a selection first (B), or choose one, or a structure of a label map")
            }
            UiCommand::ReplaceVolume | UiCommand::ReadOtherwise
                if document.is_some_and(|d| d.figure().volumes.is_empty()) =>
            {
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
    pub(super) fn run_on_figure(&mut self, command: UiCommand) -> bool {
        use UiCommand as C;
        let Some(open) = &mut self.open else { return false };
        let camera = &open.document.figure().camera;
        let side = |direction| Command::SetCamera(view::from_side(camera, direction));
        let edit = match command {
            C::Fit => {
                self.slices.fit();
                Command::SetCamera(fitted(open, self.gallery.wardrobe()))
            }
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
                Command::RemoveNode { of: open.function_of(), node }
            }
            C::PutBack => {
                let Some(movable) = Movable::chosen(open) else { return true };
                movable.command(Change::Back)
            }
            C::InsertNode => {
                curve::insert_after_chosen(open);
                return true;
            }
            _ => return false,
        };
        open.edit(edit);
        true
    }

    pub(super) fn run_on_window(&mut self, ctx: &Context, command: UiCommand) {
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
            C::AddSelections => self.ask_for_path(ctx, Purpose::Selections),
            C::AddMasks => self.ask_for_path(ctx, Purpose::Masks),
            C::ReadOtherwise => {
                let chosen = self.open.as_ref().and_then(OpenFigure::chosen_slot).unwrap_or(0);
                self.ask_how_to_read(ctx, chosen);
            }
            C::Quit => self.guarded(ctx, Then::Quit),
            C::Palette => self.dialog = Some(Dialog::Palette(String::new(), 0)),
            C::History => self.layout.shows_history = !self.layout.shows_history,
            C::Panels => self.layout.hides_panels = !self.layout.hides_panels,
            C::Slices => {
                let slices = !self.layout.shows_slices;
                self.layout.shows_slices = slices;
                if !slices {
                    self.slices.hide();
                }
                self.keep_settings(Settings { slices, ..self.session.settings() });
            }
            C::SliceSides => {
                self.slices.convention = match self.slices.convention {
                    Convention::Radiological => Convention::Neurological,
                    Convention::Neurological => Convention::Radiological,
                };
            }
            C::SliceWindow => self.slices.reset_window(),
            C::SelectTool | C::BrushTool | C::LassoTool | C::RectangleTool | C::GrowTool => {
                if let Some(tool) = Tool::ALL.into_iter().find(|tool| tool.command() == command) {
                    self.tools.take(tool, self.open.as_mut());
                }
            }
            C::ReplaceMode | C::AddMode | C::SubtractMode | C::IntersectMode => {
                if let Some(mode) = Mode::ALL.into_iter().find(|mode| mode.command() == command) {
                    self.tools.settings.mode = mode;
                }
            }
            C::Erase => {
                let erases = self.tools.settings.erases();
                self.tools.settings.mode = if erases { Mode::Add } else { Mode::Subtract };
            }
            C::SmallerBrush | C::LargerBrush => {
                if let Some(open) = &self.open {
                    self.tools.scale_radius(open, if command == C::LargerBrush { 1.1 } else { 1.0 / 1.1 });
                }
            }
            C::GrowSelection
            | C::ShrinkSelection
            | C::SmoothSelection
            | C::FillHoles
            | C::KeepLargest
            | C::InvertSelection => {
                if let Some(open) = &self.open {
                    self.tools.refine(ctx, command, open);
                }
            }
            C::StyleFromPicture => self.ask_for_path(ctx, Purpose::Picture),
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
                self.keep_settings(Settings { dark: other == egui::ThemePreference::Dark, ..self.session.settings() });
            }
            C::LargerText => self.set_scale(ctx, ctx.zoom_factor() * 1.1),
            C::SmallerText => self.set_scale(ctx, ctx.zoom_factor() / 1.1),
            C::ResetLayout => {
                self.set_scale(ctx, 1.0);
                (self.layout.hides_panels, self.layout.function.range) = (false, None);
                ctx.memory_mut(|memory| memory.data.remove_by_type::<egui::containers::panel::PanelState>());
            }
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

    fn set_scale(&mut self, ctx: &Context, scale: f32) {
        let scale = scale.clamp(0.75, 2.0);
        ctx.set_zoom_factor(scale);
        self.keep_settings(Settings { scale, ..self.session.settings() });
    }

    pub(super) fn keep_settings(&self, settings: Settings) {
        // Best effort: nobody's work depends on it.
        let _ = self.session.keep_settings(&settings);
    }

    pub(super) fn ask_for_path(&mut self, ctx: &Context, purpose: Purpose) {
        if self.system_dialogs {
            if self.file_dialog.is_none() {
                self.file_dialog = Some(FileDialog::open(purpose, &self.proposed_path(), waker(ctx)));
            }
        } else {
            self.ask_for_typed_path(purpose);
        }
    }

    pub(super) fn ask_for_typed_path(&mut self, purpose: Purpose) {
        let proposed = match purpose {
            Purpose::Save => self.proposed_path().display().to_string(),
            _ => String::new(),
        };
        self.dialog = Some(Dialog::Path(purpose, proposed));
    }

    /// Where a figure is likely to be saved, or others to lie.
    pub(super) fn proposed_path(&self) -> PathBuf {
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

    pub(super) fn path_given(&mut self, ctx: &Context, purpose: Purpose, path: PathBuf) {
        match purpose {
            Purpose::Open | Purpose::OpenFolder => self.guarded(ctx, Then::Open(vec![path])),
            Purpose::Save => {
                self.save_to(ctx, &dialogs::saved_as(&path));
            }
            Purpose::Picture => self.read_picture(ctx, &path),
            Purpose::Volume(slot) => self.fill(ctx, slot, &path),
            Purpose::Selections | Purpose::Masks => self.add_selections(ctx, &path),
            Purpose::OtherSelections(slot) | Purpose::OtherMasks(slot) => self.use_selections(ctx, slot, &path),
        }
    }

    pub(super) fn guarded(&mut self, ctx: &Context, then: Then) {
        if self.document().is_some_and(Document::is_changed) {
            self.dialog = Some(Dialog::Unsaved(then));
        } else {
            self.go_on(ctx, then);
        }
    }

    pub(super) fn go_on(&mut self, ctx: &Context, then: Then) {
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
                self.refresh_start_page();
                ctx.send_viewport_cmd(ViewportCommand::Title("Fabrica".to_owned()));
            }
            Then::Open(paths) => self.load(ctx, paths),
        }
    }

    pub(super) fn save(&mut self, ctx: &Context) {
        match self.open.as_ref().and_then(|open| open.path.clone()) {
            Some(path) => self.save_to(ctx, &path),
            None => self.ask_for_path(ctx, Purpose::Save),
        }
    }

    pub(super) fn save_to(&mut self, ctx: &Context, path: &Path) {
        let Some(open) = &mut self.open else { return };
        let written = write(open, path);
        match written {
            Ok(()) => {
                open.path = Some(path.to_owned());
                self.banner = None;
                ctx.send_viewport_cmd(ViewportCommand::Title(format!("{} - Fabrica", open.name())));
                self.notice = Notice::now(format!("Saved {}", path.display()));
                self.note_recent();
                if let Some(then) = self.after_saving.take() {
                    self.go_on(ctx, then);
                }
            }
            Err(error) => {
                self.after_saving = None;
                let text = format!("{}. Nothing was lost", wording::sentence(&error));
                self.banner = Some(Banner { offer: Some(UiCommand::SaveAs), ..Banner::new(text) });
            }
        }
    }

    pub(super) fn dialogs(&mut self, ctx: &Context) {
        let Some(mut dialog) = self.dialog.take() else { return };
        let chosen = dialogs::show(
            ctx,
            &mut dialog,
            |command| self.disabled(command),
            |name| self.gallery.library().info(name).is_ok(),
        );
        match (chosen, dialog) {
            (None, dialog) => self.dialog = Some(dialog),
            (Some(Choice::Cancel), _) => self.after_saving = None,
            (Some(Choice::Run(command)), _) => self.run(ctx, command),
            (Some(_), Dialog::Path(purpose, text)) => {
                self.path_given(ctx, purpose, PathBuf::from(text.trim()));
            }
            (Some(Choice::Other), Dialog::Unsaved(then)) => self.go_on(ctx, then),
            (Some(_), Dialog::Unsaved(then)) => {
                // It may take a path first.
                self.after_saving = Some(then);
                self.save(ctx);
            }
            (Some(Choice::Selections), Dialog::Dropped(paths, _)) => {
                if let Some(path) = paths.first() {
                    self.add_selections(ctx, path);
                }
            }
            (Some(Choice::Style), Dialog::Dropped(paths, _)) => {
                if let Some(path) = paths.first() {
                    self.read_picture(ctx, path);
                }
            }
            (Some(Choice::Other), Dialog::Dropped(paths, _)) => self.guarded(ctx, Then::Open(paths)),
            (Some(_), Dialog::Dropped(paths, _)) => {
                if let Some(path) = paths.first() {
                    self.fill(ctx, 0, path);
                }
            }
            (Some(_), Dialog::Style(style)) => self.save_style(ctx, style),
            (Some(_), Dialog::Volume(choice)) => self.volume_chosen(ctx, choice),
            (Some(_), Dialog::Palette(..)) => {}
        }
    }
}

/// The view of before with the whole object as large in the frame as it can be.
fn fitted(open: &mut OpenFigure, wardrobe: Wardrobe<'_>) -> CameraTemplate {
    let scene = open.scene(wardrobe);
    let figure = open.document.figure();
    let sources = open.sources();
    let reference = sources.and_then(|sources| bridge::reference(figure, &sources, &Progress::new()).ok().flatten());
    match scene.as_ref().and_then(|scene| scene.objects.first()).zip(reference) {
        Some((object, reference)) => framing::fit(&figure.camera, &figure.figure, object, &reference),
        None => view::fit(&figure.camera),
    }
}

/// Writes the figure, its files named as they are called from the new place.
fn write(open: &mut OpenFigure, path: &Path) -> Result<()> {
    let (old, new) = files::folders(open.path.as_deref(), path);
    let mut renamed = Template::clone(open.document.figure());
    for name in renamed.files_mut() {
        files::rename_file(name, old.as_deref(), new.as_deref())?;
    }
    files::save(&renamed, path)?;
    // Only now: what could not be written must not have changed.
    open.rename_files(|name| {
        // Those that can be parsed in the present could be in the past.
        let _ = files::rename_file(name, old.as_deref(), new.as_deref());
    });
    open.document.mark_saved();
    Ok(())
}
