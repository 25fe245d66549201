//! The one error type of the engine: every message is one sentence that says
//! what is wrong and what to do, with the file last.

use std::path::{Path, PathBuf};

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

impl Error {
    /// A fault of the file or folder at `path`.
    pub fn file(path: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::File { what: what.into(), remedy: remedy.into(), path: path.to_owned() }
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
            K::IsADirectory => ("this is a folder, not a file".to_owned(), "name a file in it"),
            _ => (error.to_string(), "check the file and its disk"),
        };
        Self::file(path, what, remedy)
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
