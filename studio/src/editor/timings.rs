//! How fast the window is, for those who work on it: `fabrica open --timings FILE`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};

/// Times of one run.
pub struct Timings {
    path: PathBuf,
    begun: Instant,
    /// From the program's beginning until the first frame that can be used.
    usable: Option<Duration>,
    /// Whether a picture was drawn in the last frame; none before the first.
    was_busy: Option<bool>,
    /// CPU time of the window's frames, ms: while the picture is drawn, and at rest.
    busy_ms: Vec<f64>,
    idle_ms: Vec<f64>,
    /// Of taking a step back or bringing it again, without the picture, ms.
    undo_ms: Vec<f64>,
}

impl Timings {
    /// Written to `path` at the end; the program began at `begun`.
    pub fn new(path: PathBuf, begun: Instant) -> Self {
        Self {
            path,
            begun,
            usable: None,
            was_busy: None,
            busy_ms: Vec::new(),
            idle_ms: Vec::new(),
            undo_ms: Vec::new(),
        }
    }

    /// The time that the frame before took, as eframe measures it, in seconds: the window's code, its drawing, and handing it
    /// to the screen.
    pub fn cpu_usage(&mut self, seconds: Option<f32>) {
        let Some((seconds, was_busy)) = seconds.zip(self.was_busy) else { return };
        let times = if was_busy { &mut self.busy_ms } else { &mut self.idle_ms };
        times.push(1e3 * f64::from(seconds));
    }

    /// A frame was made; whether a picture is being drawn, and whether the window can be used.
    pub fn frame(&mut self, busy: bool, usable: bool) {
        if usable && self.usable.is_none() {
            self.usable = Some(self.begun.elapsed());
        }
        self.was_busy = Some(busy);
    }

    /// A step was taken back or brought again.
    pub fn undone(&mut self, time: Duration) {
        self.undo_ms.push(1e3 * time.as_secs_f64());
    }

    /// Writes everything as JSON, with the times of the coarse pictures, of frames' shares of strokes, and from those, and from
    /// another theme, to the pictures that show them.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, coarse_ms: &[f64], dab_ms: &[f64], seen_ms: &[f64], theme_ms: &[f64]) -> Result<()> {
        let of = |times: &[f64]| {
            let mut sorted = times.to_vec();
            sorted.sort_by(f64::total_cmp);
            let at = |share: f64| sorted.get(((sorted.len() as f64 - 1.0) * share).round() as usize).copied();
            serde_json::json!({"count": sorted.len(), "median": at(0.5), "p95": at(0.95), "max": sorted.last()})
        };
        let report = serde_json::json!({
            "usable_s": self.usable.map(|d| d.as_secs_f64()),
            "coarse_picture_ms": of(coarse_ms),
            "frame_while_drawing_ms": of(&self.busy_ms),
            "frame_at_rest_ms": of(&self.idle_ms),
            "undo_ms": of(&self.undo_ms),
            "dabs_of_a_frame_ms": of(dab_ms),
            "dabs_to_their_picture_ms": of(seen_ms),
            "themes_to_their_picture_ms": of(theme_ms),
        });
        let text = serde_json::to_string_pretty(&report)? + "\n";
        std::fs::write(&self.path, text)
            .with_context(|| format!("the times were not written to {}", self.path.display()))
    }
}
