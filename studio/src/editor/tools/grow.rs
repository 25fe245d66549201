//! Click-to-grow: what hangs together with a seed and has values like its own. The tolerance is changed while one looks.

use eframe::egui::{Context, Key, Painter, Pos2, Ui, Vec2};
use fabrica_engine::selection::{Edge, Growth, Seeds, Selection};
use glam::DVec3;

use super::super::files::{Job, is_cancelled};
use super::super::open_figure::OpenFigure;
use super::super::panels::properties::shorter;
use super::super::wording;
use super::target::{Target, named};
use super::view::View;
use super::{Hand, Mode, Settings, shorter_ml};

/// Points that the hand may tremble in a click.
const TREMBLE: f32 = 4.0;
/// Points of a drag by which the tolerance changes e-fold.
const DRAG: f64 = 150.0;
/// A region that takes this share of the volume has mostly leaked.
const LEAK_SHARE: f64 = 0.25;
/// A region that becomes so many times larger by one more step of tolerance has leaked.
const LEAK_JUMP: u64 = 8;

/// A region that is not accepted yet.
#[derive(Default)]
pub struct Grow {
    preview: Option<Preview>,
    /// The drag under way: where it began, with which tolerance, and what a click there would add.
    drag: Option<Drag>,
}

struct Drag {
    from: Pos2,
    tolerance: f64,
    /// A voxel for the region, or (true) against it; none where the click began the region.
    seed: Option<([usize; 3], bool)>,
    moves: bool,
}

struct Preview {
    target: Target,
    seeds: Seeds,
    mode: Mode,
    growth: Option<Growth>,
    job: Option<Job<Grown>>,
    /// What is shown.
    shown: Option<Shown>,
    unit: &'static str,
}

#[derive(Clone, Copy)]
struct Shown {
    tolerance: f64,
    ml: f64,
    has_leaked: bool,
}

/// What comes from the thread.
struct Grown {
    growth: Growth,
    /// The target with the region in it.
    selection: Selection,
    shown: Shown,
}

impl Grow {
    /// Whether there is a region to be accepted.
    pub fn is_open(&self) -> bool {
        self.preview.is_some()
    }

    /// Whether it grows just now.
    pub fn is_growing(&self) -> bool {
        self.preview.as_ref().is_some_and(|preview| preview.job.is_some())
    }

    /// Gives it up; the document goes back by itself.
    pub fn abort(&mut self) {
        if let Some(job) = self.preview.take().and_then(|preview| preview.job) {
            job.progress.cancel();
        }
        self.drag = None;
    }

    /// Follows the hand and the wheel (points). A sentence if there is something to say; the slot of a region that was accepted.
    pub fn follow(
        &mut self,
        ui: &Ui,
        hands: &[Hand],
        view: Option<&View>,
        open: &mut OpenFigure,
        settings: &mut Settings,
    ) -> Result<Option<String>, String> {
        // Escape, undo, or another gesture ended it.
        let mut accepted = None;
        if let Some(preview) = self.preview.as_ref().filter(|_| !open.document.in_gesture()) {
            let slot = preview.target.slot.clone();
            accepted = open.document.figure().selections.iter().any(|s| s.name == slot).then_some(slot);
            self.abort();
        }
        for hand in hands {
            match *hand {
                Hand::Pressed { at, shift, alt } => self.press(at, [shift, alt], view, open, settings)?,
                Hand::Moved(at) => {
                    if let Some(drag) = &mut self.drag {
                        drag.moves |= (at - drag.from).length() > TREMBLE;
                        if drag.moves {
                            let by = f64::from(at.x - drag.from.x) / DRAG;
                            settings.tolerance = Some(drag.tolerance * by.exp());
                        }
                    }
                }
                Hand::Released => {
                    if let Some((voxel, is_barred)) = self.drag.take().filter(|d| !d.moves).and_then(|d| d.seed)
                        && let Some(preview) = &mut self.preview
                    {
                        let seeds = &mut preview.seeds;
                        if is_barred {
                            seeds.barred.push(voxel)
                        } else {
                            seeds.seeds.push(voxel)
                        }
                        preview.restart();
                    }
                }
            }
        }
        let Some(preview) = &mut self.preview else { return Ok(accepted) };
        let wheel = ui.input(|i| i.smooth_scroll_delta().y);
        if wheel != 0.0 && view.is_some() {
            settings.tolerance = Some(settings.tolerance(open) * (f64::from(wheel) / 500.0).exp());
        }
        let outcome = preview.grow(ui.ctx(), open, settings.tolerance(open));
        if outcome.is_err() {
            open.document.abort();
            self.abort();
        } else if ui.input(|i| i.key_pressed(Key::Enter)) && !ui.ctx().text_edit_focused() && preview.shown.is_some() {
            accepted = Some(preview.target.slot.clone());
            open.document.commit();
            self.abort();
        }
        outcome.map(|()| accepted)
    }

    fn press(
        &mut self,
        at: Pos2,
        [shift, alt]: [bool; 2],
        view: Option<&View>,
        open: &mut OpenFigure,
        settings: &Settings,
    ) -> Result<(), String> {
        let Some(view) = view else { return Ok(()) };
        let voxel = voxel_at(view, at, open).ok_or("There is nothing to grow from")?;
        let tolerance = settings.tolerance(open);
        let seed = self.preview.is_some().then_some((voxel, alt));
        if self.preview.is_none() {
            let target = Target::of(open, &settings.target)?;
            if target.volume.colors.is_some() {
                return Err("Colors do not grow; use the brush or the lasso".to_owned());
            }
            let unit = target.volume.modality.suffix();
            let seeds = Seeds::at(voxel);
            let mode = settings.mode.held(shift, alt);
            open.document.begin();
            self.preview = Some(Preview { target, seeds, mode, growth: None, job: None, shown: None, unit });
        }
        self.drag = Some(Drag { from: at, tolerance, seed, moves: false });
        Ok(())
    }

    /// What it is just now, beside the pointer.
    pub fn draw(&self, painter: &Painter, at: Pos2, tolerance: f64) {
        let Some(preview) = &self.preview else { return };
        let mut text = preview.tolerance_text(tolerance);
        match preview.shown {
            Some(shown) => {
                text += &format!(", {} ml", shorter_ml(shown.ml));
                if shown.has_leaked {
                    text += " · may have leaked";
                }
            }
            None => text += ", growing…",
        }
        super::tell(painter, at + Vec2::new(18.0, -16.0), &text);
    }
}

impl Preview {
    fn tolerance_text(&self, tolerance: f64) -> String {
        let digits = if tolerance < 1.0 { 1000.0 } else { 1.0 };
        format!("±{}{}", shorter((tolerance * digits).round() / digits), self.unit)
    }

    /// Other seeds: all is to be found anew.
    fn restart(&mut self) {
        if let Some(job) = self.job.take() {
            job.progress.cancel();
        }
        (self.growth, self.shown) = (None, None);
    }

    /// Takes over what has grown, and goes on to another tolerance.
    fn grow(&mut self, ctx: &Context, open: &mut OpenFigure, tolerance: f64) -> Result<(), String> {
        if let Some(result) = self.job.as_ref().and_then(Job::finished) {
            self.job = None;
            match result {
                Ok(grown) => {
                    (self.growth, self.shown) = (Some(grown.growth), Some(grown.shown));
                    self.target.add(open);
                    let size = self.tolerance_text(grown.shown.tolerance);
                    let label = named("Grow", &self.target.title, self.mode);
                    let label = format!("{label}, {size}, {} ml", shorter_ml(grown.shown.ml));
                    self.target.set(open, grown.selection, label);
                }
                Err(error) if is_cancelled(&error) => {}
                Err(error) => return Err(wording::sentence(&error)),
            }
        }
        if self.job.is_some() || self.shown.is_some_and(|shown| shown.tolerance == tolerance) {
            return Ok(());
        }
        let growth = match self.growth.take() {
            Some(growth) => growth,
            None => Growth::new(&self.target.volume, &self.seeds)?,
        };
        let (before, how) = (self.target.before.clone(), self.mode.combination());
        let ctx = ctx.clone();
        let title = format!("Growing {}", self.target.title);
        self.job = Some(Job::start(
            title,
            move || ctx.request_repaint(),
            move |progress| {
                let mut growth = growth;
                progress.begin("growing", 0);
                growth.grow(tolerance, usize::MAX, progress)?;
                let region = growth.region(tolerance, Edge::default(), before.pool(), progress)?;
                let leaps = |[below, at]: [u64; 2]| below > 0 && at / below >= LEAK_JUMP;
                let has_leaked = growth.share(tolerance) > LEAK_SHARE
                    || growth.leak(tolerance).is_some_and(|(_, counts)| leaps(counts));
                let shown = Shown { tolerance, ml: region.volume_ml(), has_leaked };
                let mut selection = before;
                selection.combine(&region, how).map_err(anyhow::Error::msg)?;
                Ok(Grown { growth, selection, shown })
            },
        ));
        Ok(())
    }
}

/// The voxel that is meant at a position: in the figure the one behind the surface.
fn voxel_at(view: &View, at: Pos2, open: &OpenFigure) -> Option<[usize; 3]> {
    let place = view.place(at)?;
    let grid = &open.chosen_volume()?.grid;
    let inward = if matches!(view, View::Figure(_)) { grid.spacing_mm().min_element() } else { 0.0 };
    let index = grid.index_from_world().transform_point3(place.rest_mm + inward * place.inward).round();
    let last = DVec3::from_array(grid.dims().map(|n| (n - 1) as f64));
    let is_near = (index - index.clamp(DVec3::ZERO, last)).abs().max_element() <= 1.0;
    is_near.then(|| index.clamp(DVec3::ZERO, last).to_array().map(|n| n as usize))
}
