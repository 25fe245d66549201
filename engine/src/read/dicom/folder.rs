//! The DICOM files of a folder and the folders in it.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::file::{DicomFile, Unusable, is_dicom};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::read::stream::read_full;

/// Folders in folders that are looked into.
const MAX_DEPTH: usize = 16;

/// Files of a folder that are looked at to recognize it.
const NUM_PROBED: usize = 64;

/// What a folder holds.
pub struct Gathered {
    /// The files whose headers could be read, by path.
    pub files: Vec<DicomFile>,
    /// Faults of files that look like DICOM.
    pub damaged: Vec<Error>,
}

/// Reads the headers of files, several at a time.
///
/// # Errors
/// [`Error::Cancelled`] on request.
pub fn open_all(paths: Vec<PathBuf>, progress: &Progress) -> Result<Gathered> {
    progress.begin("reading headers", paths.len() as u64);
    let opened: Vec<_> = paths
        .into_par_iter()
        .map(|path| {
            let opened = DicomFile::open(&path);
            progress.advance(1).map(|()| opened)
        })
        .collect::<Result<_>>()?;
    let mut gathered = Gathered { files: Vec::new(), damaged: Vec::new() };
    for file in opened {
        match file {
            Ok(file) => gathered.files.push(file),
            Err(Unusable::NotDicom) => {}
            Err(Unusable::Faulty(error)) => gathered.damaged.push(error),
        }
    }
    Ok(gathered)
}

/// The files in a folder, in the order of their names; those of folders in it too if `is_tree`.
///
/// # Errors
/// If the folder itself cannot be listed. What cannot be listed inside of it is passed over.
pub fn list(folder: &Path, is_tree: bool, progress: &Progress) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    // Links may lead back: every folder is looked into once, by its real place.
    let mut seen = HashSet::new();
    let mut waiting = vec![(folder.to_owned(), 0)];
    while let Some((folder, depth)) = waiting.pop() {
        progress.check()?;
        let real = fs::canonicalize(&folder).unwrap_or_else(|_| folder.clone());
        if !seen.insert(real) {
            continue;
        }
        let entries = match fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(error) if depth == 0 => return Err(Error::io(&folder, &error)),
            Err(_) => continue,
        };
        let mut paths: Vec<PathBuf> =
            entries.flatten().filter(|e| !is_hidden(&e.file_name())).map(|e| e.path()).collect();
        paths.sort();
        for path in paths {
            if !path.is_dir() {
                files.push(path);
            } else if is_tree && depth < MAX_DEPTH {
                waiting.push((path, depth + 1));
            }
        }
    }
    files.sort();
    Ok(files)
}

fn is_hidden(name: &std::ffi::OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(b".") || name.eq_ignore_ascii_case(b"DICOMDIR")
}

/// Whether a folder has DICOM files, from a look at a few of its files.
pub fn has_dicom(folder: &Path) -> bool {
    let mut num_left = NUM_PROBED;
    let mut seen = HashSet::new();
    probe(folder, 0, &mut num_left, &mut seen)
}

fn probe(folder: &Path, depth: usize, num_left: &mut usize, seen: &mut HashSet<PathBuf>) -> bool {
    let real = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    if depth > MAX_DEPTH || *num_left == 0 || !seen.insert(real) {
        return false;
    }
    let Ok(entries) = fs::read_dir(folder) else { return false };
    let mut folders = Vec::new();
    for entry in entries.flatten().filter(|e| !is_hidden(&e.file_name())) {
        let path = entry.path();
        if path.is_dir() {
            folders.push(path);
        } else if *num_left > 0 {
            *num_left -= 1;
            if begins_as_dicom(&path) {
                return true;
            }
        }
    }
    folders.sort();
    // A folder of pictures and documents beside the folder of the scan takes nothing from the latter.
    folders.into_iter().any(|folder| {
        let mut num_left = NUM_PROBED;
        probe(&folder, depth + 1, &mut num_left, seen)
    })
}

fn begins_as_dicom(path: &Path) -> bool {
    let is_file = fs::metadata(path).is_ok_and(|m| m.is_file());
    let mut head = [0; 512];
    is_file
        && fs::File::open(path).and_then(|mut file| read_full(&mut file, &mut head)).is_ok_and(|n| is_dicom(&head[..n]))
}
