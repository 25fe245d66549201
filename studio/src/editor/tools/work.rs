//! Edits of selections that may take a while: on a thread, and then one step.

use eframe::egui::Context;
use fabrica_engine::Progress;
use fabrica_engine::selection::{Connectivity, Holes, Selection};

use super::super::files::{Job, is_cancelled};
use super::super::open_figure::OpenFigure;
use super::super::ui_command::UiCommand;
use super::super::wording;
use super::shorter_mm;
use super::target::{Target, grouped};

/// An edit that is under way.
pub struct Work {
    job: Job<Selection>,
    target: Target,
    /// What its step is called; what it has changed follows.
    label: String,
    /// What is said if it changed nothing.
    nothing: &'static str,
}

impl Work {
    /// Begins.
    pub fn start(
        ctx: &Context,
        target: Target,
        label: String,
        nothing: &'static str,
        work: impl FnOnce(Selection, &Progress) -> anyhow::Result<Selection> + Send + 'static,
    ) -> Self {
        let (before, ctx) = (target.before.clone(), ctx.clone());
        let job = Job::start(label.clone(), move || ctx.request_repaint(), move |progress| work(before, progress));
        Self { job, target, label, nothing }
    }

    /// What to show while it goes on.
    pub fn progress(&self) -> (&str, &Progress) {
        (&self.job.title, &self.job.progress)
    }

    /// Takes over what came of it; none while it goes on. The slot that was edited, or a sentence.
    pub fn poll(&mut self, open: &mut OpenFigure) -> Option<Result<String, String>> {
        let result = self.job.finished()?;
        Some(match result {
            Err(error) if is_cancelled(&error) => Err(format!("{} was cancelled", self.label)),
            Err(error) => Err(wording::sentence(&error)),
            Ok(_) if !self.target.is_current(open) => Err(format!("{}: the selection has changed since", self.label)),
            Ok(now) if now.changed_since(&self.target.before).is_empty() => Err(self.nothing.to_owned()),
            Ok(now) => {
                let by = now.num_voxels() - self.target.before.num_voxels();
                let sign = if by < 0.0 { "\u{2212}" } else { "+" };
                let label = format!("{}, {sign}{} voxels", self.label, grouped(by.abs().round() as u64));
                open.document.begin();
                self.target.add(open);
                self.target.set(open, now, label);
                open.document.commit();
                Ok(self.target.slot.clone())
            }
        })
    }
}

/// What a command of the menu Selection does; none for others.
pub fn refine(ctx: &Context, command: UiCommand, target: Target, mm: f64) -> Option<Work> {
    use UiCommand as C;
    let size = shorter_mm(mm);
    let title = target.title.clone();
    let label = match command {
        C::GrowSelection => format!("Grow {title} by {size} mm"),
        C::ShrinkSelection => format!("Shrink {title} by {size} mm"),
        C::SmoothSelection => format!("Smooth {title} by {size} mm"),
        C::FillHoles => format!("Fill holes of {title}"),
        C::KeepLargest => format!("Keep largest part of {title}"),
        C::InvertSelection => format!("Invert {title}"),
        _ => return None,
    };
    Some(Work::start(ctx, target, label, "That changes nothing", move |mut selection, progress| {
        match command {
            C::GrowSelection => drop(selection.grow_mm(mm, progress)?),
            C::ShrinkSelection => drop(selection.grow_mm(-mm, progress)?),
            C::SmoothSelection => drop(selection.smooth_mm(mm, true, progress)?),
            C::FillHoles => drop(selection.fill_holes(Holes::InSpace, progress)?),
            C::KeepLargest => drop(selection.keep_largest(1, Connectivity::Faces, progress)?),
            _ => drop(selection.invert()),
        }
        Ok(selection)
    }))
}
