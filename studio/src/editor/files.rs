//! Reading and writing what is edited: figures with their volumes come in on a thread of their own, figures go out whole.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use anyhow::{Context as _, Result, bail};
use fabrica_engine::image_out::save_atomic;
use fabrica_engine::read;
use fabrica_engine::read::limits::Limits;
use fabrica_engine::volume::Volume;
use fabrica_engine::{Error, Progress};

use super::ui_command::UiCommand;
use super::volume_choice::VolumeChoice;
use super::wording;
use crate::figure::first_look;
use crate::figure::source::VolumeSource;
use crate::figure::sources::{Selections, Sources};
use crate::figure::template::{ObjectTemplate, SelectionSlot, VolumeSlot};
use crate::figure::{Template, sources};

/// Work on a thread of its own.
pub struct Job<T> {
    /// What it is about, for whoever waits.
    pub title: String,
    /// To be polled and cancelled.
    pub progress: Progress,
    result: Receiver<Result<T>>,
}

impl<T: Send + 'static> Job<T> {
    /// Begins; `wake` is called at the end, on the thread.
    pub fn start(
        title: String,
        wake: impl Fn() + Send + 'static,
        work: impl FnOnce(&Progress) -> Result<T> + Send + 'static,
    ) -> Self {
        let progress = Progress::new();
        let (sender, result) = channel();
        let theirs = progress.clone();
        std::thread::spawn(move || {
            // Nobody listens any more when something else was asked for.
            let _ = sender.send(work(&theirs));
            wake();
        });
        Self { title, progress, result }
    }

    /// The outcome, once.
    pub fn finished(&self) -> Option<Result<T>> {
        self.result.try_recv().ok()
    }
}

/// Whether an error is the user's own wish.
pub fn is_cancelled(error: &anyhow::Error) -> bool {
    error.downcast_ref::<Error>().is_some_and(|e| matches!(e, Error::Cancelled))
}

/// A figure with its volumes.
pub struct Loaded {
    /// The figure.
    pub figure: Template,
    /// Where it is saved; none for a new one.
    pub path: Option<PathBuf>,
    /// Volumes, one a slot, empty if they could not be read; and selections, as many as were reached.
    pub sources: Sources,
    /// What the user shall know, a sentence each.
    pub notes: Vec<String>,
    /// What has to be answered before its volumes can be read.
    pub asked: Option<VolumeChoice>,
}

/// What came of opening something.
pub enum Opened {
    /// A figure.
    Figure(Box<Loaded>),
    /// A question about a volume.
    Asked(Box<VolumeChoice>),
}

/// Whether a file is a figure rather than a volume.
pub fn is_template(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"))
}

/// Reads what was given: a figure with its volumes; a volume, which gets a first look; or a figure with other volumes, which
/// take the places of its own in a new figure.
///
/// # Errors
/// One sentence; a figure whose volumes cannot be read opens without them, and a note says why.
pub fn load(paths: &[PathBuf], limits: Limits, progress: &Progress) -> Result<Opened> {
    let (figures, volumes): (Vec<&PathBuf>, Vec<&PathBuf>) = paths.iter().partition(|p| is_template(p));
    match (&figures[..], &volumes[..]) {
        ([figure], []) => load_figure(Template::read(figure)?, Some(figure), limits, progress),
        ([figure], others) => dress(Template::read(figure)?, figure, others, limits, progress),
        ([], [volume]) => {
            let slot = VolumeSlot::new(first_look::SLOT, file_name(volume)?);
            undressed(slot, limits, progress)
        }
        ([], []) => bail!("nothing is given to open"),
        ([], many) => bail!("{} volumes are given and this version draws one; open one of them", many.len()),
        (many, _) => bail!("{} figures are given; open one at a time", many.len()),
    }
}

/// Reads the volumes of a figure that is saved at `path` (none: it came with the program).
///
/// # Errors
/// [`Error::Cancelled`]; volumes that cannot be read are a note, or a question.
pub fn load_figure(figure: Template, path: Option<&Path>, limits: Limits, progress: &Progress) -> Result<Opened> {
    let folder = path.and_then(Path::parent).unwrap_or(Path::new(""));
    let mut loaded =
        Loaded { figure, path: path.map(Path::to_owned), sources: Sources::default(), notes: Vec::new(), asked: None };
    let mut volumes = Vec::new();
    for (i, slot) in loaded.figure.volumes.iter().enumerate() {
        match load_slot(slot, folder, limits, progress) {
            Ok(volume) => volumes.push(volume),
            Err(error) if is_cancelled(&error) => return Err(error),
            // The figure opens without them: nothing of it is lost.
            Err(error) => {
                loaded.asked = VolumeChoice::after(&error, slot, Some(i), limits);
                loaded.notes = vec![wording::sentence(&error)];
                return Ok(Opened::Figure(Box::new(loaded)));
            }
        }
    }
    loaded.sources.volumes = volumes;
    for slot in &loaded.figure.selections {
        let of = loaded.figure.volumes.iter().position(|v| v.name == slot.volume);
        let Some(volume) = of.and_then(|i| loaded.sources.volumes.get(i)) else { break };
        let read = load_selections(slot, folder, volume, progress)?;
        loaded.sources.selections.push(read);
    }
    loaded.notes = loaded.sources.warnings().cloned().collect();
    Ok(Opened::Figure(Box::new(loaded)))
}

/// The look of a figure on other volumes.
fn dress(
    mut figure: Template,
    from: &Path,
    others: &[&PathBuf],
    limits: Limits,
    progress: &Progress,
) -> Result<Opened> {
    if others.len() > figure.volumes.len() {
        bail!(
            "{} volumes are given and the figure {} has {} of them; leave out the last ones",
            others.len(),
            from.display(),
            figure.volumes.len()
        );
    }
    rename_files(&mut figure, folder_of(from).as_deref(), None)?;
    for (slot, path) in figure.volumes.iter_mut().zip(others) {
        *slot = slot_for(slot, path)?;
    }
    load_figure(figure, None, limits, progress)
}

/// A slot with another file in it. A file of the same name is the same, elsewhere; one of the same kind may have the layout
/// that the old one has, if it does not say so itself.
///
/// # Errors
/// One sentence if the path is not UTF-8.
pub fn slot_for(slot: &VolumeSlot, path: &Path) -> Result<VolumeSlot> {
    let old = Path::new(&slot.file);
    if old.file_name() == path.file_name() {
        return Ok(VolumeSlot { file: file_name(path)?, ..slot.clone() });
    }
    let raw = slot.raw.clone().filter(|_| old.extension() == path.extension());
    Ok(VolumeSlot { raw, ..VolumeSlot::new(&slot.name, file_name(path)?) })
}

/// Reads the volume of a slot, if it is within `limits`.
///
/// # Errors
/// One sentence from the reader.
pub fn load_slot(slot: &VolumeSlot, folder: &Path, limits: Limits, progress: &Progress) -> Result<Arc<Volume>> {
    let volume = sources::load_slot(slot, folder, limits, progress)?;
    counted(&volume, progress)?;
    Ok(volume)
}

/// Reads the selections of a slot. Those that cannot be read are none, with a note that says why: the rest of the figure can be
/// worked on without them.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn load_selections(
    slot: &SelectionSlot,
    folder: &Path,
    volume: &Volume,
    progress: &Progress,
) -> Result<Arc<Selections>> {
    match sources::load_selections(slot, folder, volume, progress) {
        Err(error) if !is_cancelled(&error) => {
            let notes = vec![wording::sentence(&error) + "."];
            Ok(Arc::new(Selections { notes, is_missing: true, ..Selections::default() }))
        }
        read => read,
    }
}

/// A volume for a slot of a figure that is open.
pub struct Filled {
    /// The volume.
    pub volume: Arc<Volume>,
    /// What it is dressed in now, where its numbers mean something else than before.
    pub look: Option<ObjectTemplate>,
    /// What was read for it, before its filters; none where it has none.
    pub unfiltered: Option<Arc<Volume>>,
}

/// Reads the volume of a slot as [`load_slot`] does, or takes what was read for it before its filters; `has_new_look`: and dresses it
/// anew.
///
/// # Errors
/// One sentence from the reader.
pub fn fill_slot(
    slot: &VolumeSlot,
    folder: &Path,
    has_new_look: bool,
    limits: Limits,
    unfiltered: Option<Arc<Volume>>,
    progress: &Progress,
) -> Result<Filled> {
    let before = match unfiltered {
        Some(known) => known,
        None => load_slot(&slot.unfiltered(), folder, limits, progress)?,
    };
    let volume = sources::filtered(slot, before.clone(), progress)?;
    counted(&volume, progress)?;
    let look = has_new_look.then(|| first_look::look(&volume, slot, progress)).transpose()?;
    Ok(Filled { volume, look, unfiltered: Some(before).filter(|_| !slot.filters.is_empty()) })
}

/// Reads the volume of a slot and gives it a first look, or asks how it shall be read.
///
/// # Errors
/// One sentence from the reader.
pub fn undressed(slot: VolumeSlot, limits: Limits, progress: &Progress) -> Result<Opened> {
    let first_look::Opened { figure, mut volume, guess } = match first_look::open(slot.clone(), None, limits, progress)
    {
        Ok(opened) => opened,
        Err(error) => {
            let asked = VolumeChoice::after(&error, &slot, None, limits).ok_or(error)?;
            return Ok(Opened::Asked(Box::new(asked)));
        }
    };
    if let Some(guess) = guess {
        let command = UiCommand::ReadOtherwise;
        let otherwise = format!("{guess} If it is a scan: {}, \"{}\".", command.menu(), command.text());
        // First, as it explains the picture. Nobody else has the volume yet.
        Arc::make_mut(&mut volume).warnings.insert(0, otherwise);
    }
    counted(&volume, progress)?;
    let notes = volume.warnings.clone();
    Ok(Opened::Figure(Box::new(Loaded { figure, path: None, sources: Sources::of(vec![volume]), notes, asked: None })))
}

/// What the file of a slot offers, and the question how it shall be read.
///
/// # Errors
/// One sentence from the reader.
pub fn ask(
    slot: &VolumeSlot,
    folder: &Path,
    place: usize,
    limits: Limits,
    progress: &Progress,
) -> Result<VolumeChoice> {
    match VolumeSource::parse(&slot.file, folder)? {
        VolumeSource::Path(path) => {
            match read::survey(&path, &slot.options()?, progress) {
                Ok(entries) => Ok(VolumeChoice::new(&path, slot, Some(place), entries, limits)),
                Err(Error::Cancelled) => Err(Error::Cancelled.into()),
                // Another layout may help, or a first one.
                Err(error) if slot.raw.is_some() => {
                    let choice = VolumeChoice::new(&path, slot, Some(place), Vec::new(), limits);
                    Ok(choice.refused(wording::sentence(&error.into())))
                }
                Err(error) => {
                    let error = error.into();
                    VolumeChoice::after(&error, slot, Some(place), limits).ok_or(error)
                }
            }
        }
        VolumeSource::Specimen(_) => bail!("a specimen has one size and no parts; choose another with \"Open\""),
    }
}

/// As templates name a file: absolute; specimens by their own name.
///
/// # Errors
/// One sentence for a path that is not UTF-8.
pub fn file_name(path: &Path) -> Result<String> {
    let name = path.to_str().context("the path is not UTF-8, and templates are; rename the file")?;
    match VolumeSource::parse(name, Path::new(""))? {
        VolumeSource::Path(path) => Ok(std::path::absolute(path)?.display().to_string()),
        VolumeSource::Specimen(_) => Ok(name.to_owned()),
    }
}

/// Counts a volume's values and gradients, as panels and picking want them known, here on the thread.
fn counted(volume: &Volume, progress: &Progress) -> Result<()> {
    progress.begin("counting values", 0);
    volume.statistics(progress)?;
    volume.bricks();
    volume.gradient_max();
    Ok(())
}

fn folder_of(path: &Path) -> Option<PathBuf> {
    std::path::absolute(path).ok().and_then(|p| p.parent().map(Path::to_owned))
}

/// A file's name as it is called from the folder `new`: one in it or below it by its way from there, so that a folder can be
/// moved as a whole; any other by its whole path. Names that are no absolute paths count from `old`.
///
/// # Errors
/// One sentence for a specimen without a size.
pub fn rename_file(name: &mut String, old: Option<&Path>, new: Option<&Path>) -> Result<()> {
    let old = old.map(|o| std::path::absolute(o).unwrap_or_else(|_| o.to_owned())).unwrap_or_default();
    let VolumeSource::Path(file) = VolumeSource::parse(name, &old)? else { return Ok(()) };
    let named = match new.and_then(|new| file.strip_prefix(new).ok()) {
        Some(below) => below,
        // As it is called from the same place.
        None if new == Some(&old) => return Ok(()),
        None => &file,
    };
    *name = named.display().to_string();
    Ok(())
}

fn rename_files(figure: &mut Template, old: Option<&Path>, new: Option<&Path>) -> Result<()> {
    figure.files_mut().try_for_each(|name| rename_file(name, old, new))
}

/// The folders that the files of a figure count from, before and after it is saved at `path`.
pub fn folders(before: Option<&Path>, path: &Path) -> (Option<PathBuf>, Option<PathBuf>) {
    (before.and_then(folder_of), folder_of(path))
}

/// Writes a figure as a template. Its files are named as they are called from `path`'s folder already.
///
/// # Errors
/// One sentence; the file is then what it was.
pub fn save(figure: &Template, path: &Path) -> Result<()> {
    let text = figure.to_json()?;
    save_atomic(path, |file| {
        use std::io::Write as _;
        file.write_all(text.as_bytes()).map_err(|e| Error::io(path, &e))
    })
    .context("the figure was not saved")
}
