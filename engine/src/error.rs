//! The one error type of the engine: every message is one sentence that says
//! what is wrong and what to do, with the file last.

use std::path::{Path, PathBuf};

use crate::read::Entry;
use crate::read::limits::TooLarge;
use crate::read::raw::{self, RawLayout};

/// Result of an engine call.
pub type Result<T> = std::result::Result<T, Error>;

/// What can go wrong in the engine. `Display` gives the sentence a user reads.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder that cannot be used as it is.
    #[error("{what}; {remedy} ({})", path.display())]
    File {
        /// What is wrong, as a clause without a final period.
        what: String,
        /// What the user can do about it.
        remedy: String,
        /// Where.
        path: PathBuf,
    },
    /// A folder or file holds several volumes and none of them was chosen.
    #[error("it holds {} volumes: {}; choose one with --series ({})", entries.len(), in_words(entries), path.display())]
    Several {
        /// Where.
        path: PathBuf,
        /// What there is.
        entries: Vec<Entry>,
    },
    /// Plain voxels whose layout was not given.
    #[error("a raw file does not say how its voxels lie; {} ({})", layout_remedy(guess.as_deref()), path.display())]
    NeedsLayout {
        /// Where.
        path: PathBuf,
        /// What name and size of the file speak of.
        guess: Option<Box<RawLayout>>,
    },
    /// A volume takes more than it may.
    #[error("{0}")]
    TooLarge(Box<TooLarge>),
    /// The adapter cannot do what the scene asks for, or there is none.
    #[error("{what}; {remedy}")]
    Gpu {
        /// What is wrong.
        what: String,
        /// What the user can do about it.
        remedy: String,
    },
    /// A scene or a request that has no meaning (an image of 0 pixels, a style that does not exist).
    #[error("{what}; {remedy}")]
    Scene {
        /// What is wrong.
        what: String,
        /// What the user can do about it.
        remedy: String,
    },
    /// The user stopped the work.
    #[error("cancelled")]
    Cancelled,
}

/// The volumes there are, numbered; of many the first ones.
pub fn in_words(entries: &[Entry]) -> String {
    const MOST: usize = 8;
    let mut words: Vec<_> = (1..).zip(entries).take(MOST).map(|(i, e)| format!("{i}: {}", e.in_words())).collect();
    if entries.len() > MOST {
        words.push("...".to_owned());
    }
    words.join("; ")
}

/// The text with a mark for every control character, which could end a line or steer a terminal.
pub fn printable(text: String) -> String {
    let is_bad = |c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}');
    if !text.contains(is_bad) {
        return text;
    }
    text.chars().map(|c| if is_bad(c) { char::REPLACEMENT_CHARACTER } else { c }).collect()
}

fn layout_remedy(guess: Option<&RawLayout>) -> String {
    match guess {
        Some(layout) => format!("add the layout, by its name and size: --raw {layout}"),
        None => format!("add the layout: --raw {}", raw::EXAMPLE),
    }
}

/// Remedies that name options of the command line and its commands. A window, which has none of them, knows them by these
/// constants and says its own.
pub mod remedies {
    /// What is no file of the format that its name promises.
    pub const DESCRIBE_VOXELS: &str = "check what the file is; if it holds plain voxels, describe them with --raw";
    /// A file of no format.
    pub const CONVERT_OR_DESCRIBE: &str =
        "convert it, or describe plain voxels with --raw, as in --raw 256x256x128xuint16,0.5x0.5x1,big";
    /// A series that there is not.
    pub const LIST_SERIES: &str = "list them with `fabrica inspect`, and give a number or a part of the name";
    /// A part of the names of several series.
    pub const NAME_SERIES: &str = "give more of the name, or its number in the list of `fabrica inspect`";
    /// An adapter that cannot draw.
    pub const OTHER_ADAPTER: &str = "update its driver or choose another adapter (--adapter software)";
}

impl Error {
    /// A fault of the file or folder at `path`. What a sentence quotes of a damaged file stays on its line.
    pub fn file(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::File { what: printable(what.into()), remedy: printable(remedy.into()), path: path.to_owned() }
    }

    /// An operating-system error on `path`, with the remedy that fits its kind.
    pub fn io(path: &Path, error: &std::io::Error) -> Self {
        use std::io::ErrorKind as K;
        let (what, remedy) = match error.kind() {
            K::NotFound => ("there is no such file or folder".to_owned(), "check the path"),
            K::PermissionDenied => {
                ("reading or writing is not permitted".to_owned(), "change the permissions or choose another place")
            }
            K::UnexpectedEof => ("the file ends too early".to_owned(), "copy or download it again"),
            K::StorageFull => ("the disk is full".to_owned(), "free some space or choose another place"),
            K::QuotaExceeded => {
                ("your share of the disk is used up".to_owned(), "free some space or choose another place")
            }
            K::ReadOnlyFilesystem => ("this disk can only be read".to_owned(), "choose another place"),
            K::IsADirectory => ("this is a folder, not a file".to_owned(), "name a file in it"),
            _ => (error.to_string(), "check the file and its disk"),
        };
        Self::file(path, what, remedy)
    }

    /// An operating-system error that kept the file at `path` from being written, where writing is whole or not at all: if
    /// there is a file, the sentence adds that it is as it was.
    pub fn not_written(path: &Path, error: &std::io::Error) -> Self {
        use std::io::ErrorKind as K;
        let fault = match error.kind() {
            K::NotFound => Self::file(path, "there is no such folder", "create it or save elsewhere"),
            K::NotADirectory => {
                Self::file(path, "the path leads through a file", "name a folder before the file's name")
            }
            K::PermissionDenied => Self::file(
                path,
                "writing in this folder is not permitted",
                "change the folder's permissions or save elsewhere",
            ),
            K::ReadOnlyFilesystem => Self::file(path, "this disk can only be read", "save elsewhere"),
            K::InvalidFilename => {
                Self::file(path, "no file can have this name here", "choose a shorter or plainer one")
            }
            _ => Self::io(path, error),
        };
        match fault {
            Self::File { what, remedy, path } if path.is_file() => {
                Self::File { what, remedy: remedy + "; the file there is as it was", path }
            }
            other => other,
        }
    }

    /// A fault of the adapter.
    pub fn gpu(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Gpu { what: what.into(), remedy: remedy.into() }
    }

    /// A fault of the scene or of the request.
    pub fn scene(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Scene { what: what.into(), remedy: remedy.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_quoted_of_a_damaged_file_stays_on_its_line() {
        let text = Error::file(Path::new("a"), "its header `a\nb\u{1b}[31m\u{2028}` is none", "copy\rit").to_string();
        assert_eq!(text, "its header `a\u{fffd}b\u{fffd}[31m\u{fffd}` is none; copy\u{fffd}it (a)");
    }
}
