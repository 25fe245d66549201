//! Reading and writing what is edited: figures with their volumes come in on a thread of their own, figures go out whole.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use anyhow::{Context as _, Result};
use fabrica_engine::image_out::save_atomic;
use fabrica_engine::read::ReadOptions;
use fabrica_engine::volume::Volume;
use fabrica_engine::{Error, Progress};

use crate::figure::first_look::{self, first_look};
use crate::figure::source::VolumeSource;
use crate::figure::{Template, bridge};

/// Volumes that are being read, on a thread of their own.
pub struct Loading {
    /// What is read.
    pub path: PathBuf,
    /// To be polled and cancelled.
    pub progress: Progress,
    result: Receiver<Result<Loaded>>,
}

/// A figure with its volumes.
pub struct Loaded {
    /// The figure.
    pub figure: Template,
    /// One a slot; empty if they could not be read.
    pub volumes: Vec<Arc<Volume>>,
    /// What the user shall know, a sentence each.
    pub notes: Vec<String>,
}

impl Loading {
    /// Begins to [`load`] a file; `wake` is called at the end, on the thread.
    pub fn start(path: PathBuf, wake: impl Fn() + Send + 'static) -> Self {
        let progress = Progress::new();
        let (sender, result) = channel();
        let (file, theirs) = (path.clone(), progress.clone());
        std::thread::spawn(move || {
            // Nobody listens any more when another file was asked for.
            let _ = sender.send(load(&file, &theirs));
            wake();
        });
        Self { path, progress, result }
    }

    /// The outcome, once.
    pub fn finished(&self) -> Option<Result<Loaded>> {
        self.result.try_recv().ok()
    }
}

/// Whether a file is a figure rather than a volume.
pub fn is_template(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"))
}

/// Reads a figure with its volumes, or a volume, which gets a first look.
///
/// # Errors
/// One sentence; a figure whose volumes cannot be read opens without them, and a note says why.
pub fn load(path: &Path, progress: &Progress) -> Result<Loaded> {
    if is_template(path) {
        let figure = Template::read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        return Ok(match bridge::load_volumes(&figure, folder, &[], progress) {
            Ok(volumes) => {
                let notes = volumes.iter().flat_map(|v| v.warnings.clone()).collect();
                Loaded { figure, volumes, notes }
            }
            Err(error) if error.downcast_ref::<Error>().is_some_and(|e| matches!(e, Error::Cancelled)) => {
                return Err(error);
            }
            // The figure opens without them: nothing of it is lost.
            Err(error) => Loaded { figure, volumes: Vec::new(), notes: vec![format!("{error:#}")] },
        });
    }
    let name = path.to_str().context("the path is not UTF-8, and templates are; rename the file")?;
    let source = VolumeSource::parse(name, Path::new(""))?;
    let volume = source.load(&ReadOptions::default(), progress)?;
    let file = match &source {
        VolumeSource::Path(path) => std::path::absolute(path)?.display().to_string(),
        VolumeSource::Specimen { .. } => name.to_owned(),
    };
    let figure = first_look(&volume, first_look::slot(file), progress)?;
    Ok(Loaded { figure, notes: volume.warnings.clone(), volumes: vec![volume] })
}

/// Writes a figure as a template and gives back what was written: files that were named relative to the place of before are
/// named so that they are found from the new one.
///
/// # Errors
/// One sentence; the file is then what it was.
pub fn save(figure: &Template, before: Option<&Path>, path: &Path) -> Result<Template> {
    let mut written = figure.clone();
    let folder = |p: &Path| std::path::absolute(p).ok().and_then(|p| p.parent().map(Path::to_owned));
    let (old, new) = (before.and_then(folder), folder(path));
    if let Some(old) = old.filter(|old| new.as_ref() != Some(old)) {
        for slot in &mut written.volumes {
            if let VolumeSource::Path(file) = VolumeSource::parse(&slot.file, &old)? {
                slot.file = file.display().to_string();
            }
        }
    }
    let text = written.to_json()?;
    save_atomic(path, |file| {
        use std::io::Write as _;
        file.write_all(text.as_bytes()).map_err(|e| Error::io(path, &e))
    })
    .context("the figure was not saved")?;
    Ok(written)
}
