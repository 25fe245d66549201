//! What outlives a run of the window, in one folder: the recent figures, here, and what a crash would lose (`recovery`).
//!
//! All of it is best effort. Without a folder everything does nothing, damaged files are passed over, and a full disk costs
//! no more than what would have been remembered. Any number of windows may share the folder: files are replaced whole, and
//! whoever reads one to write it again holds the folder's lock.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use fabrica_engine::color;
use fabrica_engine::image_out::{PngOptions, save_atomic, save_png};
use fabrica_engine::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::figure::Template;

/// How many recent figures are kept.
pub const MAX_RECENTS: usize = 24;
/// The longer side of a thumbnail, at most, in pixels.
pub const THUMBNAIL: usize = 320;
/// How long the folder's lock is waited for: who holds it writes a file or two.
const PATIENCE: Duration = Duration::from_secs(1);

/// The folder of what is remembered, or none.
#[derive(Clone, Debug)]
pub struct Session {
    folder: Option<PathBuf>,
}

/// A figure that was opened or saved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recent {
    /// Its file, absolute.
    #[serde(with = "stored_path")]
    pub path: PathBuf,
    /// Its title, or its file's name.
    pub title: String,
    /// When it was opened or saved last.
    #[serde(with = "seconds")]
    pub opened: SystemTime,
    /// Its size on the page: "173 x 100 mm".
    pub page: String,
    /// A PNG of at most [`THUMBNAIL`] pixels a side, if there is one.
    #[serde(skip)]
    pub thumbnail: Option<PathBuf>,
    /// Whether its file was there when the list was read.
    #[serde(skip)]
    pub is_there: bool,
}

/// A picture as the window has it.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// RGBA, sRGB with straight alpha, row 0 = top: 4 · columns · rows bytes.
    pub rgba: &'a [u8],
}

/// The file of the settings.
const SETTINGS: &str = "settings.json";

/// How the window is looked at, whatever is open.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Light on dark, or dark on light.
    pub dark: bool,
    /// Size of text and controls, 1: as made.
    pub scale: f32,
    /// Whether slices are shown beside the figure.
    pub slices: bool,
    /// Whether they have the patient's right on the right.
    pub neurological: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { dark: true, scale: 1.0, slices: false, neurological: false }
    }
}

impl Session {
    /// `FABRICA_STATE`, else the platform's folder for a program's state; none if there is no such thing.
    pub fn default_folder() -> Option<PathBuf> {
        chosen_folder(std::env::var_os("FABRICA_STATE"))
    }

    /// A session that remembers in `folder`, which need not exist yet; without one, everything does nothing.
    pub fn open(folder: Option<PathBuf>) -> Self {
        Self { folder: folder.map(|f| std::path::absolute(&f).unwrap_or(f)) }
    }

    /// Where it remembers.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Where styles are kept that were made of pictures; it need not exist yet.
    pub fn styles_folder(&self) -> Option<PathBuf> {
        Some(self.folder()?.join("styles"))
    }

    /// The settings as they were left; as they are made where there are none, or none that can be read.
    pub fn settings(&self) -> Settings {
        let text = self.folder().and_then(|folder| fs::read_to_string(folder.join(SETTINGS)).ok());
        text.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
    }

    /// Keeps the settings.
    ///
    /// # Errors
    /// One sentence; what cannot be kept is no reason to stop.
    pub fn keep_settings(&self, settings: &Settings) -> Result<()> {
        let Some(folder) = self.folder() else { return Ok(()) };
        let path = folder.join(SETTINGS);
        let text = serde_json::to_string_pretty(settings).unwrap_or_default();
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
        save_atomic(&path, |file| file.write_all(text.as_bytes()).map_err(|e| Error::io(&path, &e)))
    }

    /// The recent figures, newest first, also those whose files are gone. What is damaged is left out.
    pub fn recents(&self) -> Vec<Recent> {
        let Some(folder) = self.folder() else { return Vec::new() };
        let mut recents = read_recents(folder);
        for recent in &mut recents {
            recent.is_there = recent.path.exists();
            recent.thumbnail = Some(thumbnail_path(folder, &recent.path)).filter(|p| p.is_file());
        }
        recents
    }

    /// Puts a figure first. Without a thumbnail, the one of before stays. It waits for the disk: not for the window's thread.
    ///
    /// # Errors
    /// One sentence; what cannot be remembered is no reason to stop.
    pub fn note_recent(&self, path: &Path, figure: &Template, thumbnail: Option<Pixels<'_>>) -> Result<()> {
        let Some(folder) = self.folder() else { return Ok(()) };
        let path = std::path::absolute(path).map_err(|e| Error::io(path, &e))?;
        let recent = Recent {
            title: title(figure, Some(&path)),
            opened: SystemTime::now(),
            page: format!("{} x {} mm", figure.figure.width_mm, figure.figure.height_mm),
            thumbnail: None,
            is_there: true,
            path,
        };
        let _lock = lock(folder)?;
        let picture = thumbnail_path(folder, &recent.path);
        change_recents(folder, |recents| {
            recents.retain(|r| r.path != recent.path);
            recents.insert(0, recent);
        })?;
        // The entry first: it is worth more than its picture.
        thumbnail.map_or(Ok(()), |pixels| save_thumbnail(&picture, pixels))
    }

    /// Takes a figure off the list, with its thumbnail. The figure's own file is not touched.
    ///
    /// # Errors
    /// One sentence.
    pub fn forget_recent(&self, path: &Path) -> Result<()> {
        let Some(folder) = self.folder() else { return Ok(()) };
        let path = std::path::absolute(path).map_err(|e| Error::io(path, &e))?;
        let _lock = lock(folder)?;
        change_recents(folder, |recents| recents.retain(|r| r.path != path))
    }
}

/// The variable's folder unless it is empty or missing.
fn chosen_folder(variable: Option<OsString>) -> Option<PathBuf> {
    variable.filter(|v| !v.is_empty()).map(PathBuf::from).or_else(|| {
        let folders = directories::ProjectDirs::from("", "", "fabrica")?;
        Some(folders.state_dir().unwrap_or(folders.data_local_dir()).to_owned())
    })
}

/// What a figure is called: its title, else its file's name, else "Untitled".
pub fn title(figure: &Template, path: Option<&Path>) -> String {
    if !figure.title.is_empty() {
        return figure.title.clone();
    }
    path.and_then(Path::file_stem).map_or_else(|| "Untitled".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// The folder's lock, held until the file is dropped. Makes the folder if it is missing.
pub(super) fn lock(folder: &Path) -> Result<File> {
    let path = folder.join("lock");
    let io_error = |error: std::io::Error| Error::not_written(&path, &error);
    fs::create_dir_all(folder).map_err(io_error)?;
    let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(io_error)?;
    let deadline = Instant::now() + PATIENCE;
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(TryLockError::WouldBlock) if Instant::now() < deadline => std::thread::sleep(Duration::from_millis(5)),
            Err(TryLockError::WouldBlock) => {
                return Err(Error::file(&path, "another Fabrica keeps this locked", "wait for it or close it"));
            }
            Err(TryLockError::Error(error)) => return Err(io_error(error)),
        }
    }
}

fn recents_path(folder: &Path) -> PathBuf {
    folder.join("recent.json")
}

/// What can be read of the list, without thumbnails.
fn read_recents(folder: &Path) -> Vec<Recent> {
    let entries: Vec<serde_json::Value> =
        fs::read(recents_path(folder)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default();
    let recents = entries.into_iter().filter_map(|entry| serde_json::from_value::<Recent>(entry).ok());
    recents.filter(|r| r.path.is_absolute()).take(MAX_RECENTS).collect()
}

/// Reads the list and writes it changed; thumbnails of what fell off go too. The caller holds the lock.
fn change_recents(folder: &Path, change: impl FnOnce(&mut Vec<Recent>)) -> Result<()> {
    let path = recents_path(folder);
    let before = read_recents(folder);
    let mut after = before.clone();
    change(&mut after);
    after.truncate(MAX_RECENTS);
    write_json(&path, &after)?;
    for gone in before.iter().filter(|old| after.iter().all(|new| new.path != old.path)) {
        // One that is missing or stays does no harm.
        let _ = fs::remove_file(thumbnail_path(folder, &gone.path));
    }
    Ok(())
}

/// Writes a value as indented JSON, whole or not at all.
pub(super) fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|e| Error::file(path, format!("this cannot be written as JSON: {e}"), "report this"))?;
    save_atomic(path, |file| file.write_all((text + "\n").as_bytes()).map_err(|e| Error::not_written(path, &e)))
}

/// Where a figure's thumbnail lies: the same in every version, so that pictures are found again.
fn thumbnail_path(folder: &Path, figure: &Path) -> PathBuf {
    // FNV-1a, 64 bits: 24 paths do not meet.
    let hash =
        figure.as_os_str().as_encoded_bytes().iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
    folder.join("thumbnails").join(format!("{hash:016x}.png"))
}

fn save_thumbnail(path: &Path, pixels: Pixels<'_>) -> Result<()> {
    let [width, height] = pixels.size;
    if width == 0 || height == 0 || pixels.rgba.len() != width * height * 4 {
        return Err(Error::scene(
            format!("{} bytes are no picture of {width} × {height} pixels", pixels.rgba.len()),
            "report this: it is a fault of the program",
        ));
    }
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|e| Error::not_written(path, &e))?;
    }
    let ([width, height], small) = shrink(pixels, THUMBNAIL);
    save_png(path, width as u32, height as u32, &small, &PngOptions::default())
}

/// The picture with its longer side at most `longest`, as averages over areas, premultiplied and linear: thin bright lines
/// keep their light. A small picture keeps its pixels.
fn shrink(pixels: Pixels<'_>, longest: usize) -> ([usize; 2], Vec<[f32; 4]>) {
    let scale = (longest as f64 / pixels.size[0].max(pixels.size[1]) as f64).min(1.0);
    let size = pixels.size.map(|n| ((n as f64 * scale).round() as usize).max(1));
    let [columns, rows] = [0, 1].map(|axis| shares(pixels.size[axis], size[axis]));
    let texels = pixels.rgba.as_chunks::<4>().0;
    let mut small = vec![[0.0; 4]; size[0] * size[1]];
    let mut line = vec![[0.0; 4]; pixels.size[0]];
    for (out, (first, weights)) in small.chunks_exact_mut(size[0]).zip(&rows) {
        line.fill([0.0; 4]);
        for (row, &weight) in texels.chunks_exact(pixels.size[0]).skip(*first).zip(weights) {
            for (sum, &texel) in line.iter_mut().zip(row) {
                add(sum, color::premultiplied_linear_from_srgb8(texel), weight);
            }
        }
        for (sum, (first, weights)) in out.iter_mut().zip(&columns) {
            for (&pixel, &weight) in line[*first..].iter().zip(weights) {
                add(sum, pixel, weight);
            }
        }
    }
    (size, small)
}

fn add(sum: &mut [f32; 4], pixel: [f32; 4], weight: f32) {
    for (sum, value) in sum.iter_mut().zip(pixel) {
        *sum += weight * value;
    }
}

/// Per cell of `to` equal cells over `from` pixels (`to` ≤ `from`): the first pixel it covers, and the shares, in sum 1, of
/// that pixel and those after it.
fn shares(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    // In units of 1/to of a pixel, where every border is whole.
    (0..to)
        .map(|cell| {
            let (begin, end) = (cell * from, (cell + 1) * from);
            let pixels = begin / to..end.div_ceil(to);
            let weights = pixels.clone().map(|i| (((i + 1) * to).min(end) - (i * to).max(begin)) as f32 / from as f32);
            (pixels.start, weights.collect())
        })
        .collect()
}

/// Times in files: whole seconds since 1970.
pub(super) mod seconds {
    use std::time::{Duration, SystemTime, UNIX_EPOCH};

    use serde::de::Error as _;
    use serde::{Deserialize as _, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(time: &SystemTime, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(time.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<SystemTime, D::Error> {
        let seconds = u64::deserialize(deserializer)?;
        UNIX_EPOCH
            .checked_add(Duration::from_secs(seconds))
            .ok_or_else(|| D::Error::custom(format!("{seconds} seconds are no time")))
    }
}

/// Paths in files: text, or what the system has where a name is not UTF-8.
pub(super) mod stored_path {
    use std::ffi::OsString;
    use std::path::{Path, PathBuf};

    use serde::{Deserialize, Deserializer, Serialize as _, Serializer};

    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Stored {
        Text(String),
        Raw(OsString),
    }

    pub fn serialize<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
        match path.to_str() {
            Some(text) => serializer.serialize_str(text),
            None => path.as_os_str().serialize(serializer),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<PathBuf, D::Error> {
        Ok(match Stored::deserialize(deserializer)? {
            Stored::Text(text) => text.into(),
            Stored::Raw(raw) => raw.into(),
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use fabrica_engine::image_out::read_png;

    use super::*;

    pub fn figure(title: &str) -> Template {
        Template::parse(&format!(
            r#"{{"fabrica": 1, "title": "{title}", "future": [1, 2.5], "volumes": [{{"name": "v", "file": "a.nii"}}],
            "objects": [], "camera": {{"from": [0, 1, 0]}}, "figure": {{"width_mm": 173, "height_mm": 100.5}}}}"#
        ))
        .unwrap()
    }

    #[test]
    fn recents_come_newest_first_and_once() {
        let folder = tempfile::tempdir().unwrap();
        let session = Session::open(Some(folder.path().join("not/yet")));
        assert!(session.recents().is_empty());
        session.forget_recent(Path::new("/never.json")).unwrap();
        for i in 0..30 {
            session.note_recent(Path::new(&format!("/f/{i}.json")), &figure(""), None).unwrap();
        }
        session.note_recent(Path::new("/f/20.json"), &figure("Twenty"), None).unwrap();
        session.forget_recent(Path::new("/f/28.json")).unwrap();
        let recents = session.recents();
        assert_eq!(recents.len(), MAX_RECENTS - 1);
        let titles: Vec<&str> = recents.iter().map(|r| r.title.as_str()).collect();
        assert_eq!(titles[..4], ["Twenty", "29", "27", "26"]);
        assert_eq!((recents[0].path.as_path(), recents[0].page.as_str()), (Path::new("/f/20.json"), "173 x 100.5 mm"));
        assert!(recents[0].opened.elapsed().unwrap() < Duration::from_secs(60) && recents[0].thumbnail.is_none());
        // A path counts from the folder of now.
        session.note_recent(Path::new("here.json"), &figure(""), None).unwrap();
        assert_eq!(session.recents()[0].path, std::path::absolute("here.json").unwrap());
    }

    #[test]
    fn thumbnails_follow_the_list() {
        let folder = tempfile::tempdir().unwrap();
        let session = Session::open(Some(folder.path().to_owned()));
        let rgba = [255, 0, 0, 255].repeat(1000 * 500);
        let pixels = Pixels { size: [1000, 500], rgba: &rgba };
        session.note_recent(Path::new("/a.json"), &figure(""), Some(pixels)).unwrap();
        session.note_recent(Path::new("/a.json"), &figure(""), None).unwrap();
        let file = session.recents()[0].thumbnail.clone().unwrap();
        let picture = read_png(&file).unwrap();
        assert_eq!((picture.width, picture.height), (320, 160));
        assert!(picture.pixels.iter().all(|p| *p == [1.0, 0.0, 0.0, 1.0]));
        session.forget_recent(Path::new("/a.json")).unwrap();
        assert!(!file.exists());
        session.note_recent(Path::new("/0.json"), &figure(""), Some(pixels)).unwrap();
        for i in 1..=MAX_RECENTS {
            session.note_recent(Path::new(&format!("/{i}.json")), &figure(""), None).unwrap();
        }
        assert_eq!(fs::read_dir(folder.path().join("thumbnails")).unwrap().count(), 0);
        let wrong = session.note_recent(Path::new("/b.json"), &figure(""), Some(Pixels { size: [2, 2], rgba: &rgba }));
        assert!(wrong.unwrap_err().to_string().contains("2 × 2") && session.recents()[0].title == "b");
    }

    #[test]
    fn shrinking_averages_light() {
        // A checkerboard of black and white is half the light, which is code 188 and not 128.
        let board: Vec<u8> = (0..64).flat_map(|i| [[0, 0, 0, 255], [255; 4]][(i + i / 8) % 2]).collect();
        let (size, pixels) = shrink(Pixels { size: [8, 8], rgba: &board }, 4);
        assert_eq!(size, [4, 4]);
        assert!(pixels.iter().all(|p| color::straight_srgb8_from_premultiplied_linear(*p) == [188, 188, 188, 255]));
        // Clear pixels give no color away.
        let (_, pixels) = shrink(Pixels { size: [2, 1], rgba: &[255, 0, 0, 255, 0, 255, 0, 0] }, 1);
        assert_eq!(pixels, [[0.5, 0.0, 0.0, 0.5]]);
        let (size, pixels) = shrink(Pixels { size: [2, 1], rgba: &[9; 8] }, 320);
        assert_eq!((size, pixels.len()), ([2, 1], 2));
        // Every pixel counts alike, and a thin picture keeps a row.
        for (from, to) in [(7, 3), (1000, 320), (5, 5), (3, 1)] {
            let mut sums = vec![0.0; from];
            for (first, weights) in shares(from, to) {
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                weights.iter().enumerate().for_each(|(i, w)| sums[first + i] += w);
            }
            assert!(sums.iter().all(|s| (s - to as f32 / from as f32).abs() < 1e-5), "{from} to {to}: {sums:?}");
        }
        assert_eq!(shrink(Pixels { size: [900, 1], rgba: &[0; 3600] }, 320).0, [320, 1]);
    }

    #[test]
    fn two_processes_do_not_lose_each_others_figures() {
        // Locks belong to open files: threads with files of their own are as good as processes.
        let folder = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let session = Session::open(Some(folder.path().to_owned()));
                scope.spawn(move || {
                    for i in 0..5 {
                        let path = PathBuf::from(format!("/{thread}-{i}.json"));
                        session.note_recent(&path, &figure(""), None).unwrap();
                    }
                });
            }
        });
        assert_eq!(Session::open(Some(folder.path().to_owned())).recents().len(), 20);
    }

    #[test]
    fn damage_is_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let session = Session::open(Some(folder.path().to_owned()));
        session.note_recent(Path::new("/a.json"), &figure(""), None).unwrap();
        let file = folder.path().join("recent.json");
        let text = fs::read_to_string(&file).unwrap();
        fs::write(&file, text.replacen('[', r#"[{"path": 3}, "x", "#, 1)).unwrap();
        assert_eq!(session.recents().len(), 1);
        fs::write(&file, &text[..text.len() / 2]).unwrap();
        assert!(session.recents().is_empty());
        session.note_recent(Path::new("/b.json"), &figure(""), None).unwrap();
        assert_eq!(session.recents().len(), 1);
        // A time beyond all times is damage too.
        let text = fs::read_to_string(&file).unwrap();
        let opened = text.lines().find(|l| l.contains("opened")).unwrap();
        fs::write(&file, text.replace(opened, &format!("\"opened\": {},", u64::MAX))).unwrap();
        assert!(session.recents().is_empty());
    }

    #[test]
    #[cfg(unix)]
    fn names_that_are_not_text_are_kept() {
        use std::os::unix::ffi::OsStringExt as _;
        let folder = tempfile::tempdir().unwrap();
        let session = Session::open(Some(folder.path().to_owned()));
        let path = PathBuf::from(OsString::from_vec(b"/f/\xff.json".to_vec()));
        session.note_recent(&path, &figure(""), None).unwrap();
        assert_eq!(session.recents()[0].path, path);
    }

    #[test]
    fn without_a_place_nothing_happens_and_a_bad_place_is_a_sentence() {
        let session = Session::open(None);
        session.note_recent(Path::new("/a.json"), &figure(""), None).unwrap();
        assert!(session.recents().is_empty());
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let session = Session::open(Some(file));
        assert!(session.note_recent(Path::new("/a.json"), &figure(""), None).is_err() && session.recents().is_empty());
    }

    #[test]
    fn the_variable_chooses_the_folder() {
        assert_eq!(chosen_folder(Some("/here".into())), Some("/here".into()));
        assert_eq!(chosen_folder(Some(OsString::new())), chosen_folder(None));
    }
}
