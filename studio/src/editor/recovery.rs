//! What a crash would lose: every document that is edited writes itself into a slot, a folder with a lock that its process
//! holds. A slot whose lock can be had belongs to nobody any more, and what lies in it can be restored.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

use anyhow::{Result, anyhow, bail};
use fabrica_engine::Error;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::session::{Session, lock, seconds, stored_path, title, write_json};
use crate::figure::{Document, Template};

/// The version of recovery files that this program writes.
const VERSION: u64 = 1;
/// How many of the last steps are told.
const NUM_STEPS: usize = 5;
/// A slot's files.
const FIGURE: &str = "figure.json";
const LOCK: &str = "lock";

/// A document as it is kept for the case of a crash.
#[derive(Clone, Debug, PartialEq)]
pub struct Recoverable {
    /// Its file, absolute, if it has one: volumes with relative names are found from that file's folder.
    pub path: Option<PathBuf>,
    /// Its title, or its file's name.
    pub title: String,
    /// When it was kept, in whole seconds.
    pub saved_at: SystemTime,
    /// What was done last: labels of the last undo steps (five at most), oldest first.
    pub steps: Vec<String>,
    /// The figure.
    pub figure: Template,
}

/// [`Recoverable`] in a file; the figure is written and read as templates are.
#[derive(Serialize, Deserialize)]
struct Stored<F> {
    recovery: u64,
    #[serde(default)]
    path: Option<StoredPath>,
    title: String,
    #[serde(with = "seconds")]
    saved_at: SystemTime,
    steps: Vec<String>,
    figure: F,
}

#[derive(Serialize, Deserialize)]
#[serde(transparent)]
struct StoredPath(#[serde(with = "stored_path")] PathBuf);

impl Recoverable {
    /// A document as it is now.
    pub fn of(document: &Document, path: Option<&Path>) -> Self {
        let labels: Vec<String> = document.labels().map(str::to_owned).collect();
        Self {
            path: path.map(|p| std::path::absolute(p).unwrap_or_else(|_| p.to_owned())),
            title: title(document.figure(), path),
            saved_at: SystemTime::now(),
            steps: labels[labels.len().saturating_sub(NUM_STEPS)..].to_vec(),
            figure: Template::clone(document.figure()),
        }
    }

    /// The folder that the figure's volumes are named from.
    pub fn folder(&self) -> &Path {
        self.path.as_deref().and_then(Path::parent).unwrap_or(Path::new(""))
    }

    fn parse(bytes: &[u8]) -> Result<Self> {
        let value: Value = serde_json::from_slice(bytes).map_err(|e| anyhow!("it is not JSON ({e})"))?;
        match value.get("recovery").and_then(Value::as_u64) {
            Some(VERSION) => {}
            Some(v) => bail!("it is of version {v} and this program reads version {VERSION}; update Fabrica"),
            None => bail!("it is no recovery file of Fabrica"),
        }
        let stored: Stored<Value> = serde_json::from_value(value).map_err(|e| anyhow!("a part of it is wrong: {e}"))?;
        Ok(Self {
            path: stored.path.map(|p| p.0),
            title: stored.title,
            saved_at: stored.saved_at,
            steps: stored.steps,
            figure: Template::parse(&stored.figure.to_string())?,
        })
    }
}

/// A folder whose lock this process holds.
#[derive(Debug)]
struct Slot {
    folder: PathBuf,
    lock: File,
}

impl Slot {
    fn figure(&self) -> PathBuf {
        self.folder.join(FIGURE)
    }

    /// Removes all that this program put there. The caller holds the session's lock if it can be had: then nobody takes
    /// the slot for an orphan in between.
    fn remove(self) -> Result<()> {
        remove_if_there(&self.figure())?;
        // Some systems do not remove what is open.
        drop(self.lock);
        remove_if_there(&self.folder.join(LOCK))?;
        for leftover in fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            if leftover.file_name().to_string_lossy().starts_with(&format!(".{FIGURE}.tmp-")) {
                // Half a file of a process that was killed while it wrote.
                let _ = fs::remove_file(leftover.path());
            }
        }
        // What somebody else put there stays, and the folder with it.
        let _ = fs::remove_dir(&self.folder);
        Ok(())
    }
}

fn remove_if_there(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(Error::io(path, &error).into()),
        _ => Ok(()),
    }
}

/// Where one document keeps itself. Dropping it leaves what it kept, which is then an orphan.
#[derive(Debug)]
pub struct RecoverySlot {
    session: Session,
    slot: Option<Slot>,
}

impl RecoverySlot {
    /// Keeps the document in place of what was kept before, whole or not at all. It waits for the disk.
    ///
    /// # Errors
    /// One sentence; what was kept before is then still there.
    pub fn write(&self, document: &Recoverable) -> Result<()> {
        let Some(slot) = &self.slot else { return Ok(()) };
        let stored = Stored {
            recovery: VERSION,
            path: document.path.clone().map(StoredPath),
            title: document.title.clone(),
            saved_at: document.saved_at,
            steps: document.steps.clone(),
            figure: &document.figure,
        };
        Ok(write_json(&slot.figure(), &stored)?)
    }

    /// Removes what was kept, after it was saved or discarded; the slot can be written again.
    ///
    /// # Errors
    /// One sentence if it is still there.
    pub fn clear(&self) -> Result<()> {
        self.slot.as_ref().map_or(Ok(()), |slot| remove_if_there(&slot.figure()))
    }

    /// Removes what was kept and the slot.
    ///
    /// # Errors
    /// One sentence if something is still there.
    pub fn close(self) -> Result<()> {
        let _lock = self.session.folder().map(lock);
        self.slot.map_or(Ok(()), Slot::remove)
    }

    /// Whether its folder has gone (somebody tidied up): nothing can be kept there any more.
    pub fn is_gone(&self) -> bool {
        self.slot.as_ref().is_some_and(|slot| !slot.folder.is_dir())
    }
}

/// What a process that is gone has left. Nobody else sees it as long as this lives; dropping it leaves it for the next run.
#[derive(Debug)]
pub struct Orphan {
    /// When it was kept.
    pub saved_at: SystemTime,
    /// The document, or one sentence why it cannot be read (it may be of a newer version; it is not removed for that).
    pub content: Result<Recoverable, String>,
    session: Session,
    slot: Slot,
}

impl Orphan {
    /// Takes the document over, with the slot that it lies in: it stays there until the slot is written or cleared, so that
    /// another crash loses nothing.
    ///
    /// # Errors
    /// The sentence in `content`; it then stays for another time.
    pub fn restore(self) -> Result<(Recoverable, RecoverySlot)> {
        let document = self.content.map_err(|sentence| anyhow!(sentence))?;
        Ok((document, RecoverySlot { session: self.session, slot: Some(self.slot) }))
    }

    /// Removes it for good.
    ///
    /// # Errors
    /// One sentence if something is still there.
    pub fn discard(self) -> Result<()> {
        RecoverySlot { session: self.session, slot: Some(self.slot) }.close()
    }
}

impl Session {
    /// A slot of its own for a document; one that keeps nothing if the session has no folder.
    ///
    /// # Errors
    /// One sentence if no slot can be made.
    pub fn begin_recovery(&self) -> Result<RecoverySlot> {
        static COUNTER: AtomicU64 = AtomicU64::new(0);
        let Some(folder) = self.folder() else { return Ok(RecoverySlot { session: self.clone(), slot: None }) };
        // A slot that is not locked yet looks like an orphan: nobody shall look.
        let _lock = lock(folder)?;
        let all = folder.join("recovery");
        fs::create_dir_all(&all).map_err(|e| Error::not_written(&all, &e))?;
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
        let folder = loop {
            let counter = COUNTER.fetch_add(1, Ordering::Relaxed);
            let folder = all.join(format!("{now}-{}-{counter}", std::process::id()));
            match fs::create_dir(&folder) {
                Ok(()) => break folder,
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(Error::not_written(&folder, &error).into()),
            }
        };
        let path = folder.join(LOCK);
        let locked = File::create_new(&path).and_then(|file| file.try_lock().map_err(io::Error::from).map(|()| file));
        match locked {
            Ok(lock) => Ok(RecoverySlot { session: self.clone(), slot: Some(Slot { folder, lock }) }),
            Err(error) => {
                let _ = fs::remove_file(&path);
                let _ = fs::remove_dir(&folder);
                Err(Error::not_written(&path, &error).into())
            }
        }
    }

    /// What processes that are gone have left, newest first. Slots that they left empty are removed.
    pub fn recoverable(&self) -> Vec<Orphan> {
        let Some(folder) = self.folder() else { return Vec::new() };
        let Ok(entries) = fs::read_dir(folder.join("recovery")) else { return Vec::new() };
        // Without it (a disk that can only be read) what is there can be restored all the same.
        let held = lock(folder);
        let mut orphans = Vec::new();
        for folder in entries.flatten().map(|entry| entry.path()) {
            // No lock file: no slot of ours. Reading is enough to lock.
            let Ok(lock) = OpenOptions::new().read(true).open(folder.join(LOCK)) else { continue };
            if lock.try_lock().is_err() {
                continue;
            }
            let slot = Slot { folder, lock };
            match fs::read(slot.figure()) {
                Ok(bytes) => orphans.push(self.orphan(slot, Recoverable::parse(&bytes))),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {
                    if held.is_ok() {
                        // It is in nobody's way if it stays.
                        let _ = slot.remove();
                    }
                }
                Err(error) => {
                    let fault = Error::io(&slot.figure(), &error);
                    orphans.push(self.orphan(slot, Err(fault.into())));
                }
            }
        }
        orphans.sort_by_key(|orphan| std::cmp::Reverse(orphan.saved_at));
        orphans
    }

    fn orphan(&self, slot: Slot, content: Result<Recoverable>) -> Orphan {
        let path = slot.figure();
        let written = || fs::metadata(&path).and_then(|m| m.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
        Orphan {
            saved_at: content.as_ref().map_or_else(|_| written(), |document| document.saved_at),
            content: content.map_err(|e| format!("what was kept in {} cannot be used: {e:#}", path.display())),
            session: self.clone(),
            slot,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::super::session::tests::figure;
    use super::*;
    use crate::figure::Command;

    fn session(folder: &tempfile::TempDir) -> Session {
        Session::open(Some(folder.path().join("state")))
    }

    fn document(title: &str, age: u64) -> Recoverable {
        Recoverable {
            path: Some("/data/study/figure.json".into()),
            title: title.to_owned(),
            saved_at: SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000 - age),
            steps: vec!["Move view".to_owned()],
            figure: figure(title),
        }
    }

    fn slots(folder: &tempfile::TempDir) -> Vec<PathBuf> {
        let all = folder.path().join("state/recovery");
        fs::read_dir(all).into_iter().flatten().map(|entry| entry.unwrap().path()).collect()
    }

    #[test]
    fn what_is_dropped_is_found_and_what_is_held_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let (older, newer, held) =
            (session(&folder).begin_recovery(), session(&folder).begin_recovery(), session(&folder).begin_recovery());
        let (older, newer, held) = (older.unwrap(), newer.unwrap(), held.unwrap());
        older.write(&document("older", 5)).unwrap();
        newer.write(&document("newest", 3)).unwrap();
        newer.write(&document("newer", 2)).unwrap();
        held.write(&document("held", 1)).unwrap();
        assert!(session(&folder).recoverable().is_empty());
        drop((older, newer));
        let orphans = session(&folder).recoverable();
        let found: Vec<Recoverable> = orphans.iter().map(|o| o.content.clone().unwrap()).collect();
        assert_eq!(found, [document("newer", 2), document("older", 5)]);
        assert_eq!(found[0].folder(), Path::new("/data/study"));
        assert!(found[0].figure.extra.contains_key("future"));
        // A second window is not offered the same again; it is when the first gave no answer.
        assert!(session(&folder).recoverable().is_empty());
        drop(orphans);
        assert_eq!(session(&folder).recoverable().len(), 2);
        held.close().unwrap();
        assert_eq!(slots(&folder).len(), 2);
    }

    #[test]
    fn what_is_restored_is_safe_until_written_or_cleared() {
        let folder = tempfile::tempdir().unwrap();
        session(&folder).begin_recovery().unwrap().write(&document("a", 1)).unwrap();
        let (restored, slot) = session(&folder).recoverable().remove(0).restore().unwrap();
        assert_eq!(restored, document("a", 1));
        // It crashes again at once.
        drop(slot);
        let (_, slot) = session(&folder).recoverable().remove(0).restore().unwrap();
        slot.write(&document("b", 0)).unwrap();
        drop(slot);
        let (restored, slot) = session(&folder).recoverable().remove(0).restore().unwrap();
        assert_eq!(restored.title, "b");
        slot.clear().unwrap();
        slot.clear().unwrap();
        drop(slot);
        // An empty slot is nothing to restore, and is tidied away.
        assert!(session(&folder).recoverable().is_empty() && slots(&folder).is_empty());
        session(&folder).begin_recovery().unwrap().write(&document("c", 0)).unwrap();
        session(&folder).recoverable().remove(0).discard().unwrap();
        assert!(slots(&folder).is_empty());
    }

    #[test]
    fn what_cannot_be_read_is_listed_and_kept() {
        let folder = tempfile::tempdir().unwrap();
        session(&folder).begin_recovery().unwrap().write(&document("a", 1)).unwrap();
        let file = slots(&folder)[0].join(FIGURE);
        let text = fs::read_to_string(&file).unwrap();
        for (changed, part) in [
            (text.replace("\"recovery\": 1", "\"recovery\": 2"), "version 2"),
            (text.replace("\"fabrica\": 1", "\"fabrica\": 7"), "version 7"),
            (text.replace("\"steps\"", "\"stairs\""), "steps"),
            (text[..text.len() / 2].to_owned(), "not JSON"),
            (String::new(), "not JSON"),
            ("{}".to_owned(), "no recovery file"),
        ] {
            fs::write(&file, &changed).unwrap();
            let orphan = session(&folder).recoverable().remove(0);
            let sentence = orphan.content.clone().unwrap_err();
            assert!(sentence.contains(part) && sentence.contains(FIGURE), "{sentence}");
            assert_eq!(orphan.restore().unwrap_err().to_string(), sentence);
            assert_eq!(fs::read_to_string(&file).unwrap(), changed);
        }
        // What a newer version adds does not matter.
        fs::write(&file, text.replacen('{', "{\"mood\": \"fine\",", 1)).unwrap();
        assert_eq!(session(&folder).recoverable()[0].content, Ok(document("a", 1)));
    }

    #[test]
    fn half_files_go_and_foreign_ones_stay() {
        let folder = tempfile::tempdir().unwrap();
        let slot = session(&folder).begin_recovery().unwrap();
        let place = slots(&folder).remove(0);
        fs::write(place.join(".figure.json.tmp-1-0"), "half").unwrap();
        slot.close().unwrap();
        assert!(!place.exists());
        fs::create_dir_all(&place).unwrap();
        fs::write(place.join("letter.txt"), "").unwrap();
        assert!(session(&folder).recoverable().is_empty());
        fs::write(place.join(LOCK), "").unwrap();
        assert!(session(&folder).recoverable().is_empty() && place.join("letter.txt").exists());
    }

    #[test]
    fn a_document_is_kept_with_its_last_steps() {
        let mut open = Document::new(figure(""));
        for i in 0..7 {
            open.apply(Command::SetTitle(format!("{i}"))).unwrap();
            open.begin();
            open.commit();
            let mut camera = open.figure().camera.clone();
            camera.height += 0.1;
            open.apply(Command::SetCamera(camera)).unwrap();
        }
        let kept = Recoverable::of(&open, Some(Path::new("here.json")));
        assert_eq!((kept.steps.len(), kept.title.as_str()), (NUM_STEPS, "6"));
        assert_eq!(kept.steps.last().map(String::as_str), open.undo_label());
        assert!(kept.path.unwrap().is_absolute());
        let bare = Recoverable::of(&Document::new(figure("")), None);
        assert_eq!((bare.title.as_str(), bare.folder()), ("Untitled", Path::new("")));
    }

    #[test]
    fn without_a_place_nothing_is_kept() {
        let session = Session::open(None);
        let slot = session.begin_recovery().unwrap();
        slot.write(&document("a", 0)).unwrap();
        slot.clear().unwrap();
        assert!(session.recoverable().is_empty() && !slot.is_gone());
        slot.close().unwrap();
    }
}
