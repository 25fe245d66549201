//! When a document is kept for the case of a crash, and the thread that does it: the disk may be slow, the window is not.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Result;

use super::recovery::{Recoverable, RecoverySlot};
use super::session::Session;
use crate::figure::{Document, Template};

/// How long nothing must change before it is kept.
pub const QUIET: Duration = Duration::from_secs(2);
/// How long a change waits at most, also while others follow, and how long after a failure it is tried again.
pub const LATEST: Duration = Duration::from_secs(10);

/// Says when to write: [`QUIET`] after the last change, but at the latest [`LATEST`] after the first that is not written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pacing {
    /// When to write, and until when that may move; none while nothing has changed.
    due: Option<(Instant, Instant)>,
}

impl Pacing {
    /// Something has changed.
    pub fn changed(&mut self, now: Instant) {
        let latest = self.due.map_or(now + LATEST, |(_, latest)| latest);
        self.due = Some(((now + QUIET).min(latest), latest));
    }

    /// What changed is being written, or is nothing any more (saved, undone).
    pub fn settled(&mut self) {
        self.due = None;
    }

    /// What was being written could not be.
    pub fn failed(&mut self, now: Instant) {
        // What has changed since then may come sooner.
        self.due = self.due.or(Some((now + LATEST, now + LATEST)));
    }

    /// How long from `now` until it is time to write: zero if it is, none if there is nothing to write.
    pub fn wait(&self, now: Instant) -> Option<Duration> {
        self.due.map(|(due, _)| due.saturating_duration_since(now))
    }
}

enum Job {
    Write(Box<Recoverable>),
    Clear,
    Close,
}

/// Keeps one document. Dropping it leaves what was kept last.
pub struct Autosave {
    pacing: Pacing,
    /// The figure as it was when last looked at.
    seen: Option<Arc<Template>>,
    /// Whether something is kept, or on its way.
    is_kept: bool,
    num_in_flight: usize,
    fault: Option<String>,
    jobs: Sender<Job>,
    reports: Receiver<Result<()>>,
    thread: JoinHandle<()>,
}

impl Autosave {
    /// Starts the thread, with the slot that a restored document came with. `wake` is called, there, when something was
    /// done: [`Autosave::tick`] then learns of it.
    pub fn start(session: Session, restored: Option<RecoverySlot>, wake: impl Fn() + Send + 'static) -> Self {
        let (jobs, their_jobs) = channel();
        let (their_reports, reports) = channel();
        let is_kept = restored.is_some();
        let thread = std::thread::spawn(move || {
            work(&session, restored, &their_jobs, &|report| {
                // Nobody listens any more when another document was opened.
                let _ = their_reports.send(report);
                wake();
            });
        });
        Self { pacing: Pacing::default(), seen: None, is_kept, num_in_flight: 0, fault: None, jobs, reports, thread }
    }

    /// Looks at the document, once a frame, and has it written or what was kept removed, as is due. After how long it must
    /// be called again even if nothing happens; none: need not be.
    pub fn tick(&mut self, document: &Document, path: Option<&Path>, now: Instant) -> Option<Duration> {
        while let Ok(report) = self.reports.try_recv() {
            self.num_in_flight -= 1;
            self.fault = report.err().map(|e| format!("{e:#}"));
            if self.fault.is_some() {
                self.pacing.failed(now);
            }
        }
        if !document.is_changed() {
            self.pacing.settled();
            self.seen = None;
            if std::mem::take(&mut self.is_kept) {
                self.send(Job::Clear);
            }
            return None;
        }
        let figure = document.figure();
        if !self.seen.as_ref().is_some_and(|seen| Arc::ptr_eq(seen, figure)) {
            self.seen = Some(figure.clone());
            self.pacing.changed(now);
        }
        // One at a time; its end wakes the window.
        if self.num_in_flight > 0 {
            return None;
        }
        if self.pacing.wait(now) == Some(Duration::ZERO) {
            self.write(document, path);
        }
        self.pacing.wait(now)
    }

    /// Why the document could not be kept the last time, in one sentence; none if it could.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// The window goes without an answer (a shutdown): keeps the document as it is, and waits until that is done.
    pub fn leave(mut self, document: &Document, path: Option<&Path>) {
        let is_new = !self.seen.as_ref().is_some_and(|seen| Arc::ptr_eq(seen, document.figure()));
        if !document.is_changed() {
            let _ = self.close().join();
            return;
        }
        if is_new || self.pacing != Pacing::default() {
            self.write(document, path);
        }
        drop(self.jobs);
        let _ = self.thread.join();
    }

    /// The document was saved or is discarded: removes what was kept. To be joined before the program ends, or that may not
    /// be done; otherwise nobody needs to wait.
    pub fn close(self) -> JoinHandle<()> {
        let _ = self.jobs.send(Job::Close);
        self.thread
    }

    fn write(&mut self, document: &Document, path: Option<&Path>) {
        self.pacing.settled();
        self.is_kept = true;
        self.send(Job::Write(Box::new(Recoverable::of(document, path))));
    }

    fn send(&mut self, job: Job) {
        // The thread lives as long as there is somebody to send.
        if self.jobs.send(job).is_ok() {
            self.num_in_flight += 1;
        }
    }
}

/// The thread: jobs in their order, so that nothing is kept again after it was cleared.
fn work(session: &Session, mut slot: Option<RecoverySlot>, jobs: &Receiver<Job>, tell: &dyn Fn(Result<()>)) {
    for job in jobs {
        match job {
            Job::Write(document) => tell(keep(session, &mut slot, &document)),
            Job::Clear => tell(slot.as_ref().map_or(Ok(()), RecoverySlot::clear)),
            Job::Close => {
                if let Some(slot) = slot.take() {
                    // Nobody listens any more.
                    let _ = slot.close();
                }
                return;
            }
        }
    }
}

/// Writes into the slot; the first time it makes one, so that a document that is only looked at leaves no trace.
fn keep(session: &Session, slot: &mut Option<RecoverySlot>, document: &Recoverable) -> Result<()> {
    let mine = match slot.take().filter(|slot| !slot.is_gone()) {
        Some(mine) => mine,
        None => session.begin_recovery()?,
    };
    slot.insert(mine).write(document)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::session::tests::figure;
    use super::*;
    use crate::figure::Command;

    fn seconds(n: f64) -> Duration {
        Duration::from_secs_f64(n)
    }

    #[test]
    fn it_waits_for_quiet_but_not_for_ever() {
        let start = Instant::now();
        let at = |n: f64| start + seconds(n);
        let mut pacing = Pacing::default();
        assert_eq!(pacing.wait(start), None);
        pacing.changed(start);
        assert_eq!((pacing.wait(at(0.0)), pacing.wait(at(1.5))), (Some(QUIET), Some(seconds(0.5))));
        assert_eq!(pacing.wait(at(2.0)), Some(Duration::ZERO));
        // A drag that goes on: the first change has waited for ten seconds.
        for n in 1..=9 {
            pacing.changed(at(f64::from(n)));
        }
        assert_eq!(pacing.wait(at(9.0)), Some(seconds(1.0)));
        pacing.changed(at(12.0));
        assert_eq!(pacing.wait(at(12.0)), Some(Duration::ZERO));
        pacing.settled();
        assert_eq!(pacing.wait(at(13.0)), None);
        // The next change has its own ten seconds.
        pacing.changed(at(13.0));
        assert_eq!(pacing.wait(at(13.0)), Some(QUIET));
        pacing.settled();
        pacing.failed(at(20.0));
        assert_eq!(pacing.wait(at(20.0)), Some(LATEST));
        pacing.settled();
        pacing.changed(at(30.0));
        pacing.failed(at(30.5));
        assert_eq!(pacing.wait(at(30.0)), Some(QUIET));
    }

    /// An autosave, with a receiver that says when its thread has done something.
    fn start(session: &Session, restored: Option<RecoverySlot>) -> (Autosave, Receiver<()>) {
        let (sender, woken) = channel();
        let wake = move || {
            let _ = sender.send(());
        };
        (Autosave::start(session.clone(), restored, wake), woken)
    }

    fn rename(document: &mut Document, title: &str) {
        document.apply(Command::SetTitle(title.to_owned())).unwrap();
    }

    #[test]
    fn a_document_is_kept_cleared_and_kept_again() {
        let folder = tempfile::tempdir().unwrap();
        let session = Session::open(Some(folder.path().join("state")));
        let (mut autosave, woken) = start(&session, None);
        let mut document = Document::new(figure("a"));
        let now = Instant::now();
        assert_eq!(autosave.tick(&document, None, now), None);
        rename(&mut document, "b");
        assert_eq!(autosave.tick(&document, None, now), Some(QUIET));
        assert_eq!(autosave.tick(&document, None, now + seconds(1.0)), Some(seconds(1.0)));
        assert!(!folder.path().join("state").exists(), "nothing is written before its time");
        assert_eq!(autosave.tick(&document, None, now + QUIET), None);
        woken.recv().unwrap();
        assert_eq!(autosave.tick(&document, None, now + QUIET), None);
        assert!(autosave.fault().is_none() && session.recoverable().is_empty(), "it is held");
        // Saved: nothing to recover. Edited again, and the program is gone.
        document.mark_saved();
        assert_eq!(autosave.tick(&document, None, now), None);
        woken.recv().unwrap();
        rename(&mut document, "c");
        autosave.leave(&document, Some(Path::new("/f/c.json")));
        let orphan = session.recoverable().remove(0);
        let (restored, slot) = orphan.restore().unwrap();
        assert_eq!((restored.title.as_str(), restored.path.as_deref()), ("c", Some(Path::new("/f/c.json"))));

        // Restored, it counts as changed and is kept; saved, it is not.
        let (mut autosave, woken) = start(&session, Some(slot));
        let mut document = Document::recovered(restored.figure, None);
        assert_eq!(autosave.tick(&document, None, now), Some(QUIET));
        document.mark_saved();
        autosave.tick(&document, None, now);
        woken.recv().unwrap();
        drop(autosave);
        assert!(woken.recv().is_err(), "the thread ends with its owner");
        assert!(session.recoverable().is_empty());
    }

    #[test]
    fn closing_leaves_nothing_and_dropping_leaves_what_was_kept() {
        let folder = tempfile::tempdir().unwrap();
        let session = Session::open(Some(folder.path().to_owned()));
        let mut document = Document::new(figure("a"));
        rename(&mut document, "b");
        for (is_closed, num_left) in [(true, 0), (false, 1)] {
            let (mut autosave, woken) = start(&session, None);
            let now = Instant::now();
            autosave.tick(&document, None, now);
            autosave.tick(&document, None, now + LATEST);
            if is_closed {
                autosave.close().join().unwrap();
            } else {
                drop(autosave);
                while woken.recv().is_ok() {}
            }
            assert_eq!(session.recoverable().len(), num_left);
        }
        assert_eq!(fs::read_dir(folder.path().join("recovery")).unwrap().count(), 1);
    }

    #[test]
    fn a_fault_is_told_and_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let state = folder.path().join("state");
        fs::write(&state, "in the way").unwrap();
        let session = Session::open(Some(state.clone()));
        let (mut autosave, woken) = start(&session, None);
        let mut document = Document::new(figure("a"));
        rename(&mut document, "b");
        let now = Instant::now();
        autosave.tick(&document, None, now);
        autosave.tick(&document, None, now + QUIET);
        woken.recv().unwrap();
        assert_eq!(autosave.tick(&document, None, now + QUIET), Some(LATEST));
        assert!(autosave.fault().unwrap().contains("state"), "{:?}", autosave.fault());
        fs::remove_file(&state).unwrap();
        autosave.tick(&document, None, now + QUIET + LATEST);
        woken.recv().unwrap();
        autosave.tick(&document, None, now + QUIET + LATEST);
        assert!(autosave.fault().is_none());
        // Somebody tidies up while the window is open.
        fs::remove_dir_all(&state).unwrap();
        rename(&mut document, "c");
        autosave.leave(&document, None);
        assert_eq!(session.recoverable()[0].content.as_ref().unwrap().title, "c");
    }
}
