//! A progress bar on stderr for work over half a second, if stderr is a terminal; Ctrl-C cancels the work cleanly.

use std::io::IsTerminal as _;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use fabrica_engine::Progress;
use indicatif::{ProgressBar, ProgressStyle};

/// How long work may take before a bar appears.
const PATIENCE: Duration = Duration::from_millis(500);

/// Shows a [`Progress`] until it is dropped.
pub struct Bar {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Bar {
    /// Starts watching.
    pub fn watch(progress: &Progress) -> Self {
        let interrupted = progress.clone();
        // A second handler in one process (tests) is refused; the first one keeps working.
        let _ = ctrlc::set_handler(move || interrupted.cancel());
        if !std::io::stderr().is_terminal() {
            return Self { stop: None, thread: None };
        }
        let (stop, stopped) = channel();
        let progress = progress.clone();
        let thread = std::thread::spawn(move || {
            let start = Instant::now();
            let bar = ProgressBar::hidden();
            let mut shown = String::new();
            if let Ok(style) = ProgressStyle::with_template("{msg:32} {wide_bar} {percent:>3} % {eta:>4}") {
                bar.set_style(style);
            }
            while stopped.recv_timeout(Duration::from_millis(80)) == Err(RecvTimeoutError::Timeout) {
                let (stage, done, total) = progress.snapshot();
                if start.elapsed() > PATIENCE && !stage.is_empty() {
                    if bar.is_hidden() {
                        // Once: a new target forgets the line that is to be drawn over.
                        bar.set_draw_target(indicatif::ProgressDrawTarget::stderr());
                    }
                    if stage != shown {
                        // The estimate of what is left starts anew.
                        bar.reset();
                        bar.set_message(stage.clone());
                        shown = stage;
                    }
                    bar.set_length(total.max(1));
                    bar.set_position(done.min(total));
                }
            }
            bar.finish_and_clear();
        });
        Self { stop: Some(stop), thread: Some(thread) }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // The bar is decoration: its panic must not become the program's.
            let _ = thread.join();
        }
    }
}
