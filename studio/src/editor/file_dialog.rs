//! The system's file dialogs, on threads: the window goes on meanwhile. Where the system has none, the window asks for a path
//! itself.

use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use fabrica_engine::{image_in, read};

/// Nobody closes a dialog as fast as this: there was none (no portal, no zenity). The library does not tell the two apart.
const NOBODY: Duration = Duration::from_millis(1000);

/// Faster than any hand.
const AT_ONCE: Duration = Duration::from_millis(250);

/// What a path is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A volume or figure to open.
    Open,
    /// A folder with a volume.
    OpenFolder,
    /// A picture with a ball, for a style.
    Picture,
    /// Where to save the figure.
    Save,
    /// A volume for a slot of the figure.
    Volume(usize),
    /// A label map or selections for the chosen object.
    Selections,
    /// A folder of masks for the chosen object.
    Masks,
    /// A label map or selections for a slot of the figure that has some.
    OtherSelections(usize),
    /// A folder of masks for such a slot.
    OtherMasks(usize),
}

/// A dialog that is open.
pub struct FileDialog {
    /// What it is for.
    pub purpose: Purpose,
    begun: Instant,
    answer: Receiver<Option<PathBuf>>,
}

/// What came of a dialog.
pub enum Answer {
    /// This.
    Path(PathBuf),
    /// It was closed.
    Nothing,
    /// The system has no dialog.
    NoDialog,
}

type Chosen = Pin<Box<dyn Future<Output = Option<rfd::FileHandle>> + Send>>;

impl FileDialog {
    /// Opens the dialog in the folder of `near`, with its name where something is saved; `wake` is called at the end.
    pub fn open(purpose: Purpose, near: &Path, wake: impl Fn() + Send + 'static) -> Self {
        let mut dialog = rfd::AsyncFileDialog::new();
        if let Some(folder) = near.parent().filter(|f| f.is_dir()) {
            dialog = dialog.set_directory(folder);
        }
        let volumes = read::extensions();
        let all = [&["json"], &volumes[..]].concat();
        // The future is made here, as macOS wants it on the main thread, and awaited elsewhere.
        let chosen: Chosen = match purpose {
            // Slices of a scan often have no extension.
            Purpose::Open => {
                Box::pin(dialog.add_filter("Volumes and figures", &all).add_filter("All files", &["*"]).pick_file())
            }
            Purpose::Volume(_) => {
                Box::pin(dialog.add_filter("Volumes", &volumes).add_filter("All files", &["*"]).pick_file())
            }
            Purpose::Selections | Purpose::OtherSelections(_) => {
                Box::pin(dialog.add_filter("Label maps", &volumes).add_filter("All files", &["*"]).pick_file())
            }
            Purpose::Picture => {
                let dialog = dialog.add_filter("Pictures", &image_in::EXTENSIONS);
                Box::pin(dialog.add_filter("All files", &["*"]).pick_file())
            }
            Purpose::OpenFolder | Purpose::Masks | Purpose::OtherMasks(_) => Box::pin(dialog.pick_folder()),
            Purpose::Save => {
                let name = near.file_name().unwrap_or_default().to_string_lossy();
                Box::pin(dialog.add_filter("Figures", &["json"]).set_file_name(name).save_file())
            }
        };
        let (sender, answer) = channel();
        std::thread::spawn(move || {
            let path = pollster::block_on(chosen).map(|file| file.path().to_owned());
            // Nobody waits any more when the window is closing.
            let _ = sender.send(path);
            wake();
        });
        Self { purpose, begun: Instant::now(), answer }
    }

    /// Whether it ended faster than any hand: there is no dialog in this session.
    pub fn was_refused_at_once(&self) -> bool {
        self.begun.elapsed() < AT_ONCE
    }

    /// What came of it; none while it is open.
    pub fn poll(&self) -> Option<Answer> {
        match self.answer.try_recv() {
            Ok(Some(path)) => Some(Answer::Path(path)),
            Ok(None) if self.begun.elapsed() < NOBODY => Some(Answer::NoDialog),
            Ok(None) => Some(Answer::Nothing),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Answer::NoDialog),
        }
    }
}
