//! Progress and cancellation of long work: the worker writes, any number of
//! watchers (a progress bar, a window) poll.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{Error, Result};

/// Handle on a piece of long work. Clones share the same state.
#[derive(Clone, Debug, Default)]
pub struct Progress(Arc<State>);

#[derive(Debug, Default)]
struct State {
    stage: Mutex<String>,
    done: AtomicU64,
    total: AtomicU64,
    cancelled: AtomicBool,
}

impl Progress {
    /// A fresh handle with no stage.
    pub fn new() -> Self {
        Self::default()
    }

    /// Begins a stage of `total` units (bytes, slices, tiles; 0 = unknown) under a short name ("reading").
    pub fn begin(&self, stage: &str, total: u64) {
        stage.clone_into(&mut self.0.stage.lock().unwrap_or_else(PoisonError::into_inner));
        self.0.done.store(0, Ordering::Relaxed);
        self.0.total.store(total, Ordering::Relaxed);
    }

    /// Adds `units` of finished work.
    ///
    /// # Errors
    /// [`Error::Cancelled`] once [`Progress::cancel`] was called: the worker returns it at once.
    pub fn advance(&self, units: u64) -> Result<()> {
        self.0.done.fetch_add(units, Ordering::Relaxed);
        self.check()
    }

    /// [`Error::Cancelled`] if the work shall stop.
    pub fn check(&self) -> Result<()> {
        if self.0.cancelled.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// Asks the worker to stop at its next check.
    pub fn cancel(&self) {
        self.0.cancelled.store(true, Ordering::Relaxed);
    }

    /// The present stage, units done and units in all (0 = unknown).
    pub fn snapshot(&self) -> (String, u64, u64) {
        let stage = self.0.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        (stage, self.0.done.load(Ordering::Relaxed), self.0.total.load(Ordering::Relaxed))
    }
}
