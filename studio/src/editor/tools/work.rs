//! Edits of selections that may take a while: on a thread, and then one step.

use eframe::egui::{Context, Pos2};
use fabrica_engine::Progress;
use fabrica_engine::selection::{Connectivity, DepthRange, Holes, Lasso, Limits, Selection};
use glam::DVec2;

use super::super::files::{Job, is_cancelled};
use super::super::open_figure::OpenFigure;
use super::super::ui_command::UiCommand;
use super::super::wording;
use super::lasso::Loop;
use super::target::{Target, grouped, named};
use super::view::{FigureView, View};
use super::{Mode, shorter_mm};

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

/// How far a loop reaches into the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// Through everything.
    Through,
    /// From the first surface that is seen so deep, mm; in a slice its own layer of voxels.
    Surface(f64),
}

/// Begins to select what lies in a loop on the screen.
pub fn enclose(
    ctx: &Context,
    target: Target,
    around: Loop,
    limits: Limits,
    reach: Reach,
    mode: Mode,
    verb: &str,
) -> Work {
    let label = named(verb, &target.title, mode);
    let nothing = match mode {
        Mode::Add | Mode::Replace => "Nothing inside",
        Mode::Subtract => "Nothing of the selection is inside",
        Mode::Intersect => "All of the selection is inside",
    };
    Work::start(ctx, target, label, nothing, move |mut selection, progress| {
        let view = &around.view;
        let polygon: Vec<DVec2> = around.corners.iter().map(|at| DVec2::new(at.x.into(), at.y.into())).collect();
        let seen = |place| view.seen(place);
        let spacing = selection.grid().spacing_mm().max_element();
        let depth: Option<Box<DepthRange<'_>>> = match (reach, view) {
            (Reach::Through, _) => None,
            (Reach::Surface(_), View::Slice(_, geometry)) => {
                let half = 0.5 * geometry.frame.step_mm;
                Some(Box::new(move |_| Some([-half, half])))
            }
            (Reach::Surface(depth_mm), View::Figure(figure)) => {
                let depths = Depths::new(figure, &polygon, progress)?;
                Some(Box::new(move |at| depths.at(at).map(|near| [near - spacing, near + depth_mm])))
            }
        };
        let lasso = Lasso { polygon, screen_from_world: &seen, depth: depth.as_deref() };
        let found = lasso.select(selection.grid(), &limits, selection.pool(), progress)?;
        // What went around nothing does not take everything away.
        if !found.is_empty() {
            drop(selection.combine(&found, mode.combination()).map_err(anyhow::Error::msg)?);
        }
        Ok(selection)
    })
}

/// How deep the first surface lies within a loop, in a raster of the screen.
struct Depths {
    first: DVec2,
    size: [usize; 2],
    /// mm along the view axis; NaN where nothing is seen.
    mm: Vec<f64>,
}

/// Edge of a cell, in points.
const CELL: f64 = 3.0;

impl Depths {
    fn new(figure: &FigureView, polygon: &[DVec2], progress: &Progress) -> anyhow::Result<Self> {
        let low = polygon.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = polygon.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let size = ((high - low) / CELL).to_array().map(|n| n.clamp(0.0, 4096.0) as usize + 1);
        progress.begin("looking", size[1] as u64);
        let mut mm = Vec::with_capacity(size[0] * size[1]);
        for y in 0..size[1] {
            progress.advance(1)?;
            mm.extend((0..size[0]).map(|x| {
                let at = low + (DVec2::new(x as f64, y as f64) + 0.5) * CELL;
                figure.depth_mm(Pos2::new(at.x as f32, at.y as f32)).unwrap_or(f64::NAN)
            }));
        }
        Ok(Self { first: low, size, mm })
    }

    fn at(&self, at: DVec2) -> Option<f64> {
        let [x, y] = ((at - self.first) / CELL).to_array().map(|n| n.max(0.0) as usize);
        (x < self.size[0] && y < self.size[1]).then(|| self.mm[x + self.size[0] * y]).filter(|depth| !depth.is_nan())
    }
}
