//! A folder of volume files: a mask per structure, as automatic segmentation writes them, or scans to choose from.
//!
//! What is a mask is seen in its voxels alone: one value beside 0. Scans and masks share types and grids, so the middle
//! slices of the files that could be scans by their size are looked at.

use std::cmp::Ordering;
use std::ops::Range;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::label_table::readable;
use super::window::Window;
use super::{Entry, ReadOptions, VolumeReader, check_frame, has_extension, reader_for, volume_of, window_labels};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;
use crate::volume::labels::{Label, LabelMap, LayerBuilder, background, distinct_color, numbered, same_grid};
use crate::volume::{Modality, Rescale, Volume, Voxel as _, Voxels};
use crate::with_voxels;

/// Endings of the files that count; DICOM and pictures are other readers' folders.
const EXTENSIONS: [&str; 4] = ["nii", "nrrd", "mha", "mhd"];

/// More files than any segmentation has.
const MAX_FILES: usize = 4096;

/// A compressed mask takes less than a 16th of a byte per voxel, a scan more.
const MASK_BYTES_PER_VOXEL: f64 = 1.0 / 16.0;

/// [`Entry::key`] of the masks, taken together.
const MASKS_KEY: &str = "masks";

/// Reads folders of NIfTI, NRRD and MetaImage files.
pub struct FolderReader;

impl VolumeReader for FolderReader {
    fn name(&self) -> &'static str {
        "folder of masks"
    }

    fn recognizes(&self, path: &Path, head: &[u8]) -> bool {
        head.is_empty() && path.is_dir() && volume_files(path).is_ok_and(|files| files.take(2).count() == 2)
    }

    fn survey(&self, path: &Path, _options: &ReadOptions, progress: &Progress) -> Result<Vec<Entry>> {
        Ok(Contents::of(path, progress)?.entries())
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        let contents = Contents::of(path, progress)?;
        match contents.choose(path, options)? {
            Choice::File(file) => {
                reader_for(file, &ReadOptions::default())?.read(file, &without_series(options), progress)
            }
            Choice::Masks => contents.read_numbers(path, options, progress),
        }
    }

    fn read_labels(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<LabelMap>> {
        let contents = Contents::of(path, progress)?;
        let choice = contents.choose(path, options)?;
        match choice {
            Choice::File(file) => {
                reader_for(file, &ReadOptions::default())?.read_labels(file, &without_series(options), progress)
            }
            Choice::Masks => {
                let layers = contents.read_masks(path, progress)?;
                layers.into_iter().map(|layer| window_labels(path, layer, options.window)).collect()
            }
        }
    }
}

fn without_series(options: &ReadOptions) -> ReadOptions {
    ReadOptions { series: None, ..options.clone() }
}

/// The files of a folder that can hold volumes, in no order. Hidden ones are other systems' bookkeeping.
fn volume_files(folder: &Path) -> Result<impl Iterator<Item = PathBuf>> {
    let listing = std::fs::read_dir(folder).map_err(|e| Error::io(folder, &e))?;
    Ok(listing.flatten().map(|e| e.path()).filter(|path| {
        let is_hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        !is_hidden && EXTENSIONS.iter().any(|e| has_extension(path, e)) && path.is_file()
    }))
}

/// A file and what its header says.
struct Member {
    path: PathBuf,
    entry: Entry,
}

/// What is in a folder.
struct Contents {
    masks: Vec<Member>,
    /// Everything else, to choose from.
    others: Vec<Member>,
    /// The faults of files that cannot be read.
    damaged: Vec<Error>,
}

enum Choice<'a> {
    Masks,
    File(&'a Path),
}

impl Contents {
    /// Opens all files' headers, and the middle slices of those that could be scans.
    fn of(folder: &Path, progress: &Progress) -> Result<Self> {
        let mut paths: Vec<PathBuf> = volume_files(folder)?.take(MAX_FILES + 1).collect();
        if paths.len() > MAX_FILES {
            let what = format!("the folder has more than {MAX_FILES} volume files");
            return Err(Error::file(folder, what, "name one of its files, or a folder with fewer"));
        }
        paths.sort_by(|a, b| natural_order(&name_of(a), &name_of(b)));
        let open = |path: PathBuf| -> Result<Member> {
            progress.check()?;
            let options = ReadOptions::default();
            let entries = reader_for(&path, &options)?.survey(&path, &options, &Progress::new())?;
            let entry =
                entries.into_iter().next().ok_or_else(|| Error::file(&path, "it holds no volume", "remove it"))?;
            Ok(Member { path, entry })
        };
        let opened: Vec<Result<Member>> = paths.into_par_iter().map(open).collect();
        progress.check()?;
        let (mut members, mut damaged) = (Vec::new(), Vec::new());
        for result in opened {
            match result {
                Ok(member) => members.push(member),
                Err(error) => damaged.push(error),
            }
        }
        if members.is_empty() {
            let nothing = || Error::file(folder, "the folder has no volume files", "name a file or another folder");
            return Err(damaged.into_iter().next().unwrap_or_else(nothing));
        }
        let (mut masks, mut others) = (Vec::new(), Vec::new());
        let looks = are_masks(&members, progress)?;
        for (member, look) in members.into_iter().zip(looks) {
            match look {
                Ok(true) => masks.push(member),
                Ok(false) => others.push(member),
                Err(error) => damaged.push(error),
            }
        }
        Ok(Self { masks, others, damaged })
    }

    /// The scans under their files' names, then the masks as one.
    fn entries(&self) -> Vec<Entry> {
        let scan = |member: &Member| {
            let name = name_of(&member.path);
            let title = if member.entry.title.is_empty() { stem_of(&name) } else { member.entry.title.clone() };
            Entry { key: name, title, ..member.entry.clone() }
        };
        self.others.iter().map(scan).chain(self.masks_entry()).collect()
    }

    fn masks_entry(&self) -> Option<Entry> {
        let title = match self.masks.len() {
            1 => "1 mask".to_owned(),
            n => format!("{n} masks"),
        };
        let most = self.most_common()?;
        Some(Entry {
            key: MASKS_KEY.to_owned(),
            title,
            format: "folder of masks".to_owned(),
            modality: Modality::Unknown,
            grid: most.grid,
            orientation: most.orientation.clone(),
            type_name: "uint16",
            bytes_per_voxel: 2,
            num_frames: 1,
            num_files: self.masks.iter().map(|m| m.entry.num_files).sum(),
            is_labels: true,
            is_localizer: false,
        })
    }

    /// The first of the masks on the grid that most have.
    fn most_common(&self) -> Option<&Entry> {
        let mut kinds: Vec<(&Entry, usize)> = Vec::new();
        for mask in &self.masks {
            match kinds.iter().position(|(known, _)| same_grid(&known.grid, &mask.entry.grid)) {
                Some(i) => kinds[i].1 += 1,
                // Where all differ, no comparison of all with all.
                None if kinds.len() < 16 => kinds.push((&mask.entry, 1)),
                None => {}
            }
        }
        let most = kinds.iter().map(|(_, count)| *count).max()?;
        kinds.into_iter().find(|(_, count)| *count == most).map(|(entry, _)| entry)
    }

    /// What the entry is that was chosen.
    fn choose(&self, folder: &Path, options: &ReadOptions) -> Result<Choice<'_>> {
        let entries = self.entries();
        let index = match &options.series {
            Some(key) => entries.iter().position(|e| e.key == *key),
            None => Some(0).filter(|_| entries.len() == 1),
        };
        let index =
            index.ok_or_else(|| Error::file(folder, "none of its volumes was chosen", "name one of its files"))?;
        Ok(self.others.get(index).map_or(Choice::Masks, |m| Choice::File(&m.path)))
    }

    /// The masks in layers, on the grid that most have.
    fn read_masks(&self, folder: &Path, progress: &Progress) -> Result<Vec<LabelMap>> {
        let fault = |what: String| Error::file(folder, what, "name one of its files, or a folder with fewer");
        if let Some(Error::File { what, path, .. }) = self.damaged.first() {
            // A structure that is silently missing is worse than none.
            return Err(Error::file(path, what.clone(), "copy it again, or remove it from its folder"));
        }
        let grid =
            self.most_common().map(|entry| entry.grid).ok_or_else(|| fault("the folder has no masks".to_owned()))?;
        progress.begin("reading", self.masks.len() as u64);
        let mut builder = LayerBuilder::new(grid).map_err(fault)?;
        let (mut notes, mut resampled) = (Vec::new(), Vec::new());
        // So many masks at a time are in memory.
        let chunk_size = rayon::current_num_threads().max(1);
        for (chunk, first_id) in self.masks.chunks(chunk_size).zip((1..).step_by(chunk_size)) {
            let read = |member: &Member| {
                progress.check()?;
                Mask::read(member, &grid)
            };
            let masks: Vec<Result<Mask>> = chunk.par_iter().map(read).collect();
            for ((member, mask), id) in chunk.iter().zip(masks).zip(first_id..) {
                let Mask { runs, note, warnings } = mask?;
                let name = name_of(&member.path);
                let label = Label { id, name: stem_of(&name), color: distinct_color(id), code: None };
                builder.add(label, &runs).map_err(fault)?;
                resampled.extend(note.map(|note| (name, note)));
                notes.extend(warnings.into_iter().filter(|w| !notes.contains(w)).collect::<Vec<_>>());
                progress.advance(1)?;
            }
        }
        if let Some((name, note)) = resampled.first() {
            let of = format!("{} of {} masks, the first being {name}: ", resampled.len(), self.masks.len());
            notes.push(of + &note.replace("The label map", "It").replace("the scan", "the others"));
        }
        let mut layers = builder.finish();
        layers[0].notes = notes;
        Ok(layers)
    }

    /// The first layer as a volume of numbers.
    fn read_numbers(&self, folder: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        check_frame(folder, options.frame, 1)?;
        let mut layers = self.read_masks(folder, progress)?.into_iter();
        let fault = |what: &str| Error::file(folder, what, "name another folder");
        let (entry, layer) = self.masks_entry().zip(layers.next()).ok_or_else(|| fault("the folder has no masks"))?;
        let mut warnings = layer.notes.clone();
        let num_hidden: usize = layers.map(|layer| layer.labels.len() - 1).sum();
        if num_hidden > 0 {
            warnings.push(format!("{num_hidden} of the masks overlap others and are not in this volume of numbers."));
        }
        let window = options.window.on(folder, layer.grid.dims())?;
        let layer = window_labels(folder, LabelMap { notes: Vec::new(), ..layer }, options.window)?;
        let number = |v: &u16| layer.labels[usize::from(*v)].id as u16;
        let voxels = Voxels::U16(layer.voxels.iter().map(number).collect());
        volume_of(folder, &entry, window, voxels, Rescale::IDENTITY, warnings)
    }
}

/// Which members are masks, or why that cannot be seen. The middle slice is read of every file that is larger than
/// compressed masks are, and of the largest of the others: where that is a mask, the smaller ones are, too.
/// [`Mask::read`] looks at all of their voxels.
fn are_masks(members: &[Member], progress: &Progress) -> Result<Vec<Result<bool>>> {
    let can_be = |e: &Entry| e.num_frames == 1 && !e.type_name.starts_with("rgb");
    let density = |m: &Member| {
        // The voxels of a detached header lie in a file of which nothing is known here.
        let is_alone = m.entry.num_files == 1 && !has_extension(&m.path, "mhd");
        let bytes = std::fs::metadata(&m.path).map_or(u64::MAX, |m| m.len());
        if is_alone { bytes as f64 / m.entry.grid.num_voxels() as f64 } else { f64::INFINITY }
    };
    let mut candidates: Vec<(usize, f64)> =
        members.iter().enumerate().filter(|(_, m)| can_be(&m.entry)).map(|(i, m)| (i, density(m))).collect();
    candidates.sort_by(|a, b| b.1.total_cmp(&a.1));
    let (large, small) = candidates.split_at(candidates.partition_point(|c| c.1 > MASK_BYTES_PER_VOXEL));
    let look = |&(i, _): &(usize, f64)| (i, progress.check().and_then(|()| middle_is_binary(&members[i])));
    let mut looks: Vec<Result<bool>> = members.iter().map(|_| Ok(false)).collect();
    for (i, is_mask) in large.par_iter().map(look).collect::<Vec<_>>() {
        looks[i] = is_mask;
    }
    let mut are_all = false;
    for candidate in small {
        let (i, is_mask) = if are_all { (candidate.0, Ok(true)) } else { look(candidate) };
        are_all |= matches!(is_mask, Ok(true));
        looks[i] = is_mask;
    }
    progress.check()?;
    Ok(looks)
}

fn middle_is_binary(member: &Member) -> Result<bool> {
    let [nx, ny, nz] = member.entry.grid.dims();
    let window = Window { crop: Some([[0, nx], [0, ny], [nz / 2, nz / 2 + 1]]), ..Window::default() };
    let options = ReadOptions { window, ..ReadOptions::default() };
    let slice = reader_for(&member.path, &ReadOptions::default())?.read(&member.path, &options, &Progress::new())?;
    Ok(slice.colors.is_none() && runs_of(&slice).is_ok())
}

/// One structure.
struct Mask {
    /// Its voxels, as runs of positions in the memory order of the common grid.
    runs: Vec<Range<usize>>,
    note: Option<String>,
    warnings: Vec<String>,
}

impl Mask {
    fn read(member: &Member, grid: &Grid) -> Result<Self> {
        let path = &member.path;
        let volume =
            reader_for(path, &ReadOptions::default())?.read(path, &ReadOptions::default(), &Progress::new())?;
        let apart = "move it out of the folder, and open it alone";
        let fault = |what: String| Error::file(path, what, apart);
        let runs =
            runs_of(&volume).map_err(|[a, b]| fault(format!("this is no mask: it has the values {a} and {b}")))?;
        let warnings = volume.warnings;
        if runs.is_empty() || same_grid(&volume.grid, grid) {
            return Ok(Self { runs, note: None, warnings });
        }
        let mut voxels = vec![0; volume.grid.num_voxels()];
        runs.iter().for_each(|run| voxels[run.clone()].fill(1));
        let labels = vec![background(), numbered(1)];
        let map = LabelMap { grid: volume.grid, voxels, labels, notes: Vec::new() };
        let (map, note) = map.resampled_to(grid).map_err(|what| {
            fault(what.replace("the label map", "the mask").replace("the scan takes", "the others take"))
        })?;
        let mut runs = Vec::new();
        for (i, _) in map.voxels.iter().enumerate().filter(|(_, v)| **v != 0) {
            extend(&mut runs, i);
        }
        Ok(Self { runs, note, warnings })
    }
}

/// Where the values of a volume are not 0 (nor NaN); two of them if they are not all the same.
fn runs_of(volume: &Volume) -> std::result::Result<Vec<Range<usize>>, [f64; 2]> {
    let mut runs = Vec::new();
    let mut mask_value = None;
    with_voxels!(&volume.voxels, stored => {
        let Some(mut last) = stored.first().copied() else { return Ok(runs) };
        let mut is_inside = false;
        let mut is_first = true;
        for (i, &v) in stored.iter().enumerate() {
            // Neighbors are mostly alike.
            if is_first || v != last {
                let value = volume.rescale.value(v.to_f64());
                is_inside = value != 0.0 && !value.is_nan();
                if is_inside {
                    let known = *mask_value.get_or_insert(value);
                    if value != known {
                        return Err([known, value]);
                    }
                }
                (last, is_first) = (v, false);
            }
            if is_inside {
                extend(&mut runs, i);
            }
        }
    });
    Ok(runs)
}

fn extend(runs: &mut Vec<Range<usize>>, position: usize) {
    match runs.last_mut() {
        Some(run) if run.end == position => run.end += 1,
        _ => runs.push(position..position + 1),
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// A structure's name from its file's: "adrenal_gland_left.nii.gz" is the "adrenal gland left".
fn stem_of(name: &str) -> String {
    let lower = name.to_lowercase();
    let without = |name: &str, ending: &str| name.len() - if name.ends_with(ending) { ending.len() } else { 0 };
    let mut end = without(&lower, ".gz");
    end = EXTENSIONS.iter().map(|e| without(&lower[..end], &format!(".{e}"))).min().unwrap_or(end);
    let stem = name.get(..end).unwrap_or(name);
    readable(stem.strip_suffix(".seg").unwrap_or(stem))
}

/// Names in the order in which people count: "rib 2" before "rib 10".
fn natural_order(a: &str, b: &str) -> Ordering {
    let parts = |text: &str| -> Vec<(u64, String)> {
        let is_same_kind = |a: &char, b: &char| a.is_ascii_digit() == b.is_ascii_digit();
        let characters: Vec<char> = text.to_lowercase().chars().collect();
        let part = |part: &[char]| {
            let text: String = part.iter().collect();
            (text.parse().unwrap_or(0), text)
        };
        characters.chunk_by(is_same_kind).map(part).collect()
    };
    parts(a).cmp(&parts(b)).then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests;
