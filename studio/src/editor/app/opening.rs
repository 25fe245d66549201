//! How figures and volumes come in, and go.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui::{Context, ViewportCommand};
use fabrica_engine::read::limits::Limits;
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::statistics::Statistics;

use super::super::autosave::Autosave;
use super::super::dialogs::Dialog;
use super::super::files::{self, Filled, Job, Loaded, Opened, is_cancelled};
use super::super::open_figure::OpenFigure;
use super::super::panels::properties::shorter;
use super::super::recovery::{Recoverable, RecoverySlot};
use super::super::session::Pixels;
use super::super::volume_choice::VolumeChoice;
use super::super::wording;
use super::chrome::{Banner, Notice};
use super::{Editor, waker};
use crate::figure::command::FunctionOf;
use crate::figure::shipped::SHIPPED;
use crate::figure::sources::Sources;
use crate::figure::template::{Domain, ObjectTemplate, SelectionSlot, VolumeSlot};
use crate::figure::{Command, Document, Template, first_look, sources};

impl Editor {
    pub(super) fn load(&mut self, ctx: &Context, paths: Vec<PathBuf>) {
        let title = paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
        let limits = self.limits;
        self.begin_loading(Job::start(title, waker(ctx), move |progress| files::load(&paths, limits, progress)));
    }

    pub(super) fn begin_loading(&mut self, job: Job<Opened>) {
        if let Some(loading) = self.loading.replace(job) {
            loading.progress.cancel();
        }
        (self.banner, self.answered) = (None, None);
    }

    pub(super) fn load_shipped(&mut self, ctx: &Context, which: usize) {
        let figure = SHIPPED[which].figure();
        let limits = self.limits;
        let job = Job::start(figure.title.clone(), waker(ctx), move |p| files::load_figure(figure, None, limits, p));
        self.begin_loading(job);
    }

    pub(super) fn restore(&mut self, ctx: &Context, which: usize) {
        if which >= self.orphans.len() {
            return;
        }
        match self.orphans.remove(which).restore() {
            Ok((found, slot)) => {
                let Recoverable { path, figure, .. } = found;
                let saved = path.as_deref().and_then(|p| Template::read(p).ok());
                self.show_document(ctx, Document::recovered(figure, saved), path, &Sources::default(), Some(slot));
                self.notice = Notice::now("Recovered; save it to keep it");
            }
            Err(error) => self.banner = Some(Banner::new(wording::sentence(&error))),
        }
    }

    /// Volumes that are missing are read, found, or asked for.
    pub(super) fn poll_volumes(&mut self, ctx: &Context) {
        if let Some((job, ..)) = &self.filling
            && let Some(result) = job.finished()
            && let Some((_, number, slot, is_edit)) = self.filling.take()
            && let Some(open) = &mut self.open
        {
            match result {
                Ok(Filled { volume, look, unfiltered }) => {
                    self.answered = None;
                    let before = open.document.figure().volumes.get(number).and_then(|slot| open.volume_of(slot));
                    let data = open.chosen().is_some_and(|o| o.transfer_function.domain == Domain::Data);
                    let mut notes = volume.warnings.clone();
                    notes.extend(before.filter(|_| is_edit && data).and_then(|before| other_values(before, &volume)));
                    self.notice = Notice::now(notes.join(" "));
                    if let Some(unfiltered) = unfiltered {
                        open.keep_volume(slot.unfiltered(), unfiltered);
                    }
                    open.keep_volume(slot.clone(), volume);
                    if is_edit {
                        use_volume(open, number, slot, look);
                    }
                    (self.missing, self.banner) = (None, None);
                    self.viewport.picture.ask_again();
                }
                Err(error) if is_edit && is_cancelled(&error) => self.answered = None,
                Err(error)
                    if is_edit && let Some(choice) = VolumeChoice::after(&error, &slot, Some(number), self.limits) =>
                {
                    self.dialog = Some(Dialog::Volume(Box::new(choice)));
                }
                Err(error) if is_edit => {
                    let sentence = wording::sentence(&error);
                    if !self.ask_again(&sentence) {
                        self.banner = Some(Banner::new(format!("{sentence}. The figure is as it was")));
                    }
                }
                Err(error) => self.missing = Some((slot, wording::sentence(&error))),
            }
        }
        if let Some((job, _)) = &self.searching
            && let Some(result) = job.finished()
            && let Some((_, number)) = self.searching.take()
        {
            match result.map(|found| found.into_iter().next()) {
                Ok(Some(path)) => self.fill(ctx, number, &path),
                Ok(None) => self.banner = Some(Banner::new("There is no file of this name in the folder or below it")),
                Err(error) if is_cancelled(&error) => {}
                Err(error) => self.banner = Some(Banner::new(wording::sentence(&error))),
            }
        }
        if let Some(result) = self.asking.as_ref().and_then(Job::finished) {
            self.asking = None;
            match result {
                Ok(choice) => self.dialog = Some(Dialog::Volume(Box::new(choice))),
                Err(error) if is_cancelled(&error) => {}
                Err(error) => self.banner = Some(Banner::new(wording::sentence(&error))),
            }
        }
        // Undo may bring back a slot that was never read.
        let Some(open) = self.open.as_ref().filter(|_| self.filling.is_none()) else { return };
        let Some(number) = open.missing() else {
            self.poll_selections(ctx);
            return;
        };
        let slot = open.document.figure().volumes[number].clone();
        if self.missing.as_ref().is_some_and(|(tried, _)| *tried == slot) {
            return;
        }
        let (theirs, folder) = (slot.clone(), open.folder().to_owned());
        let unfiltered = open.unfiltered(&slot).cloned();
        let job = Job::start(slot.file.clone(), waker(ctx), move |p| {
            files::fill_slot(&theirs, &folder, false, Limits::default(), unfiltered, p)
        });
        self.filling = Some((job, number, slot, false));
    }

    /// Selections that are not there (as undo brought a slot back, or its volume is another one) are read.
    fn poll_selections(&mut self, ctx: &Context) {
        if let Some((job, ..)) = &self.selecting
            && let Some(result) = job.finished()
            && let Some((_, slot, volume, edit)) = self.selecting.take()
            && let Some(open) = &mut self.open
        {
            match (result, edit) {
                (Ok(read), edit) => {
                    self.notice = Notice::now(read.notes.join(" "));
                    open.keep_selections(slot, &volume, read);
                    if let Some(edit) = edit {
                        open.edit(edit);
                    }
                }
                (Err(error), Some(_)) if is_cancelled(&error) => {}
                (Err(error), Some(_)) => {
                    self.banner = Some(Banner::new(format!("{}. The figure is as it was", wording::sentence(&error))));
                }
                // Not asked for again and again.
                (Err(_), None) => open.keep_selections(slot, &volume, Arc::default()),
            }
            self.viewport.picture.ask_again();
        }
        let Some(open) = self.open.as_mut().filter(|_| self.selecting.is_none()) else { return };
        open.follow_voxels();
        let Some((slot, volume)) = open.missing_selections() else { return };
        let (theirs, of, folder) = (slot.clone(), volume.clone(), open.folder().to_owned());
        let job =
            Job::start(slot.title().to_owned(), waker(ctx), move |p| files::load_selections(&theirs, &folder, &of, p));
        self.selecting = Some((job, slot, volume, None));
    }

    /// Reads a label map or selections for the chosen object; once they are there, they are an edit.
    pub(super) fn add_selections(&mut self, ctx: &Context, path: &Path) {
        let Some(open) = &self.open else { return };
        let (Some(object), Some(volume)) = (open.chosen(), open.chosen_volume().cloned()) else { return };
        let figure = open.document.figure();
        let stem = path.file_name().unwrap_or_default().to_string_lossy();
        let stem = stem.split('.').next().filter(|s| !s.is_empty()).unwrap_or("selections");
        let is_free = |name: &String| figure.selections.iter().all(|s| s.name != *name);
        let others = (2..).map(|i| format!("{stem} {i}"));
        let Some(name) = std::iter::once(stem.to_owned()).chain(others).find(is_free) else { return };
        let slot = match files::file_name(path) {
            Ok(file) => SelectionSlot::new(&name, &object.volume, file),
            Err(error) => {
                self.banner = Some(Banner::new(wording::sentence(&error)));
                return;
            }
        };
        let region = first_look::of_selections(&name, &volume);
        let edit = Command::AddSelections { object: open.object, slot: slot.clone(), region };
        let (theirs, of, folder) = (slot.clone(), volume.clone(), open.folder().to_owned());
        let job = Job::start(slot.title().to_owned(), waker(ctx), move |p| {
            sources::load_selections(&theirs, &folder, &of, p)
        });
        self.selecting = Some((job, slot, volume, Some(edit)));
    }

    /// Reads a label map or selections for a slot that has some already; once they are there, their use is an edit.
    pub(super) fn use_selections(&mut self, ctx: &Context, number: usize, path: &Path) {
        let Some(open) = &self.open else { return };
        let figure = open.document.figure();
        let Some(before) = figure.selections.get(number) else { return };
        let volume = figure.volumes.iter().find(|v| v.name == before.volume).and_then(|v| open.volume_of(v)).cloned();
        let Some(volume) = volume else {
            self.banner = Some(Banner::new("The volume whose voxels they select is missing; choose it first"));
            return;
        };
        let slot = match files::file_name(path) {
            // A table names the structures of the file that it was made for.
            Ok(file) => SelectionSlot { file: Some(file), voxels: None, table: None, ..before.clone() },
            Err(error) => {
                self.banner = Some(Banner::new(wording::sentence(&error)));
                return;
            }
        };
        let edit = Command::SetSelections { slot: number, selections: slot.clone() };
        let (theirs, of, folder) = (slot.clone(), volume.clone(), open.folder().to_owned());
        let job = Job::start(slot.title().to_owned(), waker(ctx), move |p| {
            sources::load_selections(&theirs, &folder, &of, p)
        });
        self.selecting = Some((job, slot, volume, Some(edit)));
    }

    /// Reads a file for a slot; once it is there, its use is an edit.
    pub(super) fn fill(&mut self, ctx: &Context, number: usize, path: &Path) {
        let Some(open) = &self.open else { return };
        let Some(slot) = open.document.figure().volumes.get(number) else { return };
        match files::slot_for(slot, path) {
            Ok(slot) => self.fill_with(ctx, number, slot, self.limits),
            Err(error) => self.banner = Some(Banner::new(wording::sentence(&error))),
        }
    }

    /// Reads what a slot names, if it is within the limits; once it is there, it takes the place of slot `number`.
    pub(super) fn fill_with(&mut self, ctx: &Context, number: usize, slot: VolumeSlot, limits: Limits) {
        let folder = self.open.as_ref().map(|open| open.folder().to_owned()).unwrap_or_default();
        let present = self.open.as_ref().and_then(|open| open.document.figure().volumes.get(number));
        // What is made for colors suits no values, and the other way around.
        let has_new_look = present.is_some_and(|p| p.file == slot.file && p.labels != slot.labels);
        let theirs = slot.clone();
        // Where nothing but filters changes, the file need not be read again.
        let is_refiltered =
            present.is_some_and(|p| p.filters != slot.filters && p.unfiltered().reads_same(&slot.unfiltered()));
        let unfiltered = self.open.as_ref().filter(|_| is_refiltered).and_then(|open| open.unfiltered(&slot)).cloned();
        if let Some((before, ..)) = &self.filling {
            before.progress.cancel();
        }
        let job = Job::start(slot.file.clone(), waker(ctx), move |p| {
            files::fill_slot(&theirs, &folder, has_new_look, limits, unfiltered, p)
        });
        self.answered = None;
        self.filling = Some((job, number, slot, true));
    }

    /// Looks at the file of a slot, to ask how it shall be read.
    pub(super) fn ask_how_to_read(&mut self, ctx: &Context, number: usize) {
        let Some(open) = &self.open else { return };
        let Some(slot) = open.document.figure().volumes.get(number).cloned() else { return };
        let folder = open.folder().to_owned();
        let (title, limits) = (slot.file.clone(), self.limits);
        self.asking = Some(Job::start(title, waker(ctx), move |p| files::ask(&slot, &folder, number, limits, p)));
    }

    /// A volume is read as it was answered.
    pub(super) fn volume_chosen(&mut self, ctx: &Context, choice: Box<VolumeChoice>) {
        match (choice.answer(), choice.place) {
            (Ok((slot, limits)), Some(number)) => self.fill_with(ctx, number, slot, limits),
            (Ok((slot, limits)), None) => {
                let title = slot.file.clone();
                self.begin_loading(Job::start(title, waker(ctx), move |p| files::undressed(slot, limits, p)));
            }
            (Err(error), _) => {
                self.dialog = Some(Dialog::Volume(Box::new(choice.refused(wording::sentence(&error)))));
                return;
            }
        }
        self.answered = Some(choice);
    }

    /// Asks once more how a volume shall be read, with why it could not be read as it was answered; whether it had been asked.
    pub(super) fn ask_again(&mut self, fault: &str) -> bool {
        let answered = self.answered.take();
        let asks = answered.is_some();
        if let Some(choice) = answered {
            self.dialog = Some(Dialog::Volume(Box::new(choice.refused(fault.to_owned()))));
        }
        asks
    }

    pub(super) fn show_loaded(&mut self, ctx: &Context, loaded: Loaded) {
        let notes = loaded.notes.join(" ");
        let unread = loaded.sources.volumes.is_empty() && !loaded.figure.volumes.is_empty();
        let place = loaded.asked.as_ref().and_then(|asked| asked.place).unwrap_or(0);
        let slot = loaded.figure.volumes.get(place).cloned();
        self.show_document(ctx, Document::new(loaded.figure), loaded.path, &loaded.sources, None);
        if let (true, Some(slot)) = (unread, slot) {
            self.missing = Some((slot, notes));
            self.dialog = loaded.asked.map(|choice| Dialog::Volume(Box::new(choice)));
        } else {
            self.notice = Notice::now(notes);
        }
    }

    pub(super) fn show_document(
        &mut self,
        ctx: &Context,
        document: Document,
        path: Option<PathBuf>,
        sources: &Sources,
        slot: Option<RecoverySlot>,
    ) {
        self.close_figure();
        self.autosave = Some(Autosave::start(self.session.clone(), slot, waker(ctx)));
        let open = OpenFigure::new(document, path, sources);
        ctx.send_viewport_cmd(ViewportCommand::Title(format!("{} - Fabrica", open.name())));
        self.open = Some(open);
        self.note_recent();
    }

    /// Takes the open figure away; what was kept of it against a crash goes with it.
    pub(super) fn close_figure(&mut self) {
        self.note_recent();
        if let Some(autosave) = self.autosave.take() {
            // Nobody needs to wait for it.
            drop(autosave.close());
        }
        self.open = None;
        (self.filling, self.searching, self.asking, self.missing, self.answered) = (None, None, None, None, None);
        self.selecting = None;
        self.missed.clear();
        (self.banner, self.notice) = (None, Notice::default());
        self.viewport.picture.clear();
        self.viewport.dismiss();
        self.slices.forget_figure();
        self.tools.forget_figure();
        self.layout.function.forget_figure();
        self.layout.renaming = None;
    }

    /// Puts a saved figure on the list of recent ones, with its picture if there is one; on a thread, as it waits for the disk.
    pub(super) fn note_recent(&mut self) {
        let Some(open) = &self.open else { return };
        let Some(path) = open.path.clone() else { return };
        let picture = self.viewport.picture.pixels().filter(|_| !open.document.is_changed());
        let picture = picture.map(|(rgba, size)| (rgba.to_vec(), size));
        let (session, figure) = (self.session.clone(), open.document.figure().clone());
        self.noted();
        self.noting = Some(std::thread::spawn(move || {
            let thumbnail = picture.as_ref().map(|(rgba, size)| Pixels { size: *size, rgba });
            // Best effort: the list is no part of anybody's work.
            let _ = session.note_recent(&path, &figure, thumbnail);
        }));
    }

    /// Waits until recent figures are on the list.
    pub(super) fn noted(&mut self) {
        if let Some(noting) = self.noting.take() {
            let _ = noting.join();
        }
    }

    /// Reads what the start page shows anew.
    pub(super) fn refresh_start_page(&mut self) {
        self.noted();
        (self.recents, self.orphans) = (self.session.recents(), self.session.recoverable());
        self.layout.pictures.clear();
    }
}

/// A volume takes the place of a slot's, with a look of its own if it needs one: one step.
fn use_volume(open: &mut OpenFigure, number: usize, slot: VolumeSlot, look: Option<ObjectTemplate>) {
    let command = Command::SetVolume { slot: number, volume: slot.clone() };
    let Some(look) = look else { return open.edit(command) };
    let objects = open.document.figure().objects.iter().map(|o| o.volume == slot.name).collect::<Vec<_>>();
    open.document.begin();
    for object in (0..objects.len()).filter(|i| objects[*i]) {
        open.edit(Command::SetTransferFunction {
            of: FunctionOf::object(object),
            function: look.transfer_function.clone(),
        });
        open.edit(Command::SetGradientScale { object, scale_mm: look.gradient_scale_mm });
    }
    open.edit(command);
    open.document.commit();
}

/// What to say where a volume's values are of another kind than those of the volume before it.
fn other_values(before: &Volume, now: &Volume) -> Option<String> {
    let (old, new) = (before.known_statistics()?, now.known_statistics()?);
    let ratio = (new.max - new.min) / (old.max - old.min);
    (!(0.5..=2.0).contains(&ratio)).then(|| {
        let range = |s: &Statistics| format!("{} to {}", shorter(s.min), shorter(s.max));
        format!(
            "Its values go from {}, those of before from {}: move the nodes, or open it by itself for a look of its own.",
            range(new),
            range(old)
        )
    })
}
