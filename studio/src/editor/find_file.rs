//! Looking for a missing volume by its name: figures move to other folders and machines, and their data with them.

use std::collections::{HashSet, VecDeque};
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use fabrica_engine::{Error, Progress, Result};

/// How far below the folder is looked: what lies in it has depth 1.
pub const MAX_DEPTH: usize = 6;
/// How many files and folders are looked at in all.
pub const MAX_ENTRIES: usize = 20_000;

/// Files and folders called `file_name` (exactly so) in `folder` and below it, nearest first, those of one depth by their
/// paths. Hidden folders are not entered, nor are those that cannot be read; a folder that links lead to more than once is
/// entered once. `progress` counts what was looked at. It ends at [`MAX_DEPTH`] and [`MAX_ENTRIES`].
///
/// # Errors
/// [`Error::Cancelled`], or that `folder` itself cannot be read.
pub fn search(folder: &Path, file_name: &OsStr, progress: &Progress) -> Result<Vec<PathBuf>> {
    search_within(folder, file_name, MAX_ENTRIES, progress)
}

fn search_within(folder: &Path, file_name: &OsStr, max_entries: usize, progress: &Progress) -> Result<Vec<PathBuf>> {
    progress.begin("searching", 0);
    let mut found = Vec::new();
    let mut seen = HashSet::new();
    let mut queue = VecDeque::from([(folder.to_owned(), 1)]);
    let mut num_left = max_entries;
    while let Some((place, depth)) = queue.pop_front()
        && num_left > 0
    {
        progress.check()?;
        // Links may lead in circles.
        if fs::canonicalize(&place).is_ok_and(|real| !seen.insert(real)) {
            continue;
        }
        let paths = match list(&place, num_left, progress) {
            Ok(paths) => paths,
            Err(Listing::Cancelled) => return Err(Error::Cancelled),
            Err(Listing::Failed(error)) if depth == 1 => return Err(Error::io(folder, &error)),
            Err(Listing::Failed(_)) => continue,
        };
        num_left -= paths.len();
        for path in paths {
            let Some(name) = path.file_name() else { continue };
            let is_hidden = name.as_encoded_bytes().starts_with(b".");
            let (is_hit, is_folder) = (name == file_name, depth < MAX_DEPTH && !is_hidden && path.is_dir());
            if is_folder {
                queue.push_back((path.clone(), depth + 1));
            }
            // A link that leads nowhere is not what is missing.
            if is_hit && path.exists() {
                found.push(path);
            }
        }
    }
    Ok(found)
}

enum Listing {
    Cancelled,
    Failed(io::Error),
}

/// What lies in a folder, at most `most` of it, sorted: what is found does not depend on the file system's order.
fn list(folder: &Path, most: usize, progress: &Progress) -> std::result::Result<Vec<PathBuf>, Listing> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(Listing::Failed)?.take(most) {
        progress.advance(1).map_err(|_| Listing::Cancelled)?;
        paths.extend(entry.map(|e| e.path()));
    }
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(root: &Path, file: &str) {
        let path = root.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "").unwrap();
    }

    fn found(root: &Path, max_entries: usize) -> Vec<String> {
        let paths = search_within(root, OsStr::new("ct.nrrd"), max_entries, &Progress::new()).unwrap();
        paths.iter().map(|p| p.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/")).collect()
    }

    #[test]
    fn nearest_comes_first_and_hidden_and_deep_ones_do_not_come() {
        let folder = tempfile::tempdir().unwrap();
        for file in
            ["z/ct.nrrd", "a/b/ct.nrrd", "ct.nrrd", "a/ct.nrrd", "a/other.nrrd", ".git/ct.nrrd", "a/CT.nrrd.txt"]
        {
            place(folder.path(), file);
        }
        place(folder.path(), "1/2/3/4/5/ct.nrrd");
        place(folder.path(), "i/2/3/4/5/6/ct.nrrd");
        let all = ["ct.nrrd", "a/ct.nrrd", "z/ct.nrrd", "a/b/ct.nrrd", "1/2/3/4/5/ct.nrrd"];
        assert_eq!(found(folder.path(), MAX_ENTRIES), all);
        // Six entries lie in the folder itself: with one more, a folder below is only begun.
        assert!(found(folder.path(), 7).len() <= 2);
        assert!(found(folder.path(), 0).is_empty());
    }

    #[test]
    #[cfg(unix)]
    fn circles_of_links_end() {
        let folder = tempfile::tempdir().unwrap();
        place(folder.path(), "a/ct.nrrd");
        std::os::unix::fs::symlink(folder.path(), folder.path().join("a/up")).unwrap();
        std::os::unix::fs::symlink(folder.path().join("a"), folder.path().join("b")).unwrap();
        std::os::unix::fs::symlink("nowhere", folder.path().join("ct.nrrd")).unwrap();
        assert_eq!(found(folder.path(), MAX_ENTRIES), ["a/ct.nrrd"]);
    }

    #[test]
    fn it_can_be_cancelled_and_a_missing_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        place(folder.path(), "a/ct.nrrd");
        let progress = Progress::new();
        search(folder.path(), OsStr::new("ct.nrrd"), &progress).unwrap();
        assert_eq!(progress.snapshot().1, 2);
        progress.cancel();
        assert!(matches!(search(folder.path(), OsStr::new("ct.nrrd"), &progress), Err(Error::Cancelled)));
        let missing = folder.path().join("missing");
        let error = search(&missing, OsStr::new("ct.nrrd"), &Progress::new()).unwrap_err();
        assert!(error.to_string().contains("no such") && error.to_string().contains("missing"), "{error}");
    }
}
