//! The trade as a control: how accurate a setting is for *this* scene, which is accurate enough, or the most accurate in a
//! given time.
//! Found by drawing a sparse sample of the picture's own pixels with ever smaller steps, on the adapter that will draw
//! the picture; the reference is not needed. Works for whatever the raycaster draws.

use std::time::Instant;

use crate::error::{Error, Result};
use crate::measure::Difference;
use crate::progress::Progress;
use crate::render::{FloatImage, RenderOptions, Renderer, put_over};
use crate::scene::{Background, Quality, Scene};

/// Steps that are tried, in voxels, coarse to fine; what is chosen may lie between two of them. None above 2: there the
/// raycaster no longer leaps over empty bricks, so that they are slower.
const LADDER: [f64; 8] = [2.0, 1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015_625];
/// A setting is compared with one whose step is this many rungs finer, and thus a quarter of its own.
const FINER: usize = 2;
/// Pixels of a sample: a sixteenth of the picture's, but no fewer and no more than these (or all of them).
const FEWEST_PIXELS: u64 = 1 << 12;
const MOST_PIXELS: u64 = 1 << 14;
/// What all settings of the raycaster share and no comparison among them shows: half-float styles, the
/// transfer table. 99.9th percentile in 8-bit codes, measured on the shipped templates at the finest steps.
const FLOOR_CODES: f64 = 0.3;
/// How much of the bound an estimate may fill: what is left is for the pixels that the sample leaves out.
const FILL: f64 = 0.75;
/// The finest step that a budget is spent on: what is left of the error there is the floor.
const FINEST_STEP: f64 = 1.0 / 16.0;
/// The share of a budget that is planned for.
const PLANNED: f64 = 0.9;

/// A sample that takes longer than this, in ms, need not be drawn again to know its time.
const LONG_MS: f64 = 1000.0;

/// A setting with what is to be expected of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The setting.
    pub quality: Quality,
    /// Estimated 99.9th percentile of the error, in 8-bit codes.
    pub codes: f64,
    /// Estimated time of a frame, ms; only where a budget was given.
    pub ms: Option<f64>,
    /// How many pixels it rests on.
    pub num_pixels: usize,
    /// The step, in voxels, that it was compared with.
    pub against_step: f64,
}

/// A scene's picture, sampled sparsely at the steps that were asked for so far.
struct Sampler<'a> {
    renderer: &'a mut Renderer,
    scene: Scene,
    background: Background,
    size: [u32; 2],
    options: RenderOptions,
    progress: &'a Progress,
}

impl<'a> Sampler<'a> {
    fn new(renderer: &'a mut Renderer, scene: &Scene, size: [u32; 2], progress: &'a Progress) -> Result<Self> {
        scene.validate()?;
        let num_pixels = u64::from(size[0]) * u64::from(size[1]);
        let wanted = (num_pixels / 16).clamp(FEWEST_PIXELS, MOST_PIXELS);
        let stride = ((num_pixels as f64 / wanted as f64).sqrt().round() as u32).max(1);
        let background = scene.background;
        // Without a background: what a pixel shows of it is the comparison's to know.
        let scene = Scene { background: Background::Transparent, ..scene.clone() };
        let options = RenderOptions { stride, ..RenderOptions::default() };
        Ok(Self { renderer, scene, background, size, options, progress })
    }

    /// Whether the scene can be drawn with this setting.
    fn allows(&mut self, quality: Quality) -> bool {
        self.scene.quality = quality;
        self.scene.validate().is_ok()
    }

    fn draw(&mut self, quality: Quality) -> Result<FloatImage> {
        self.scene.quality = quality;
        self.renderer.render(&self.scene, self.size, &self.options, self.progress)
    }

    /// Estimated error of the setting that drew `coarse`, from a picture of a quarter of its step or less.
    fn codes(&self, coarse: &FloatImage, fine: &FloatImage) -> Result<f64> {
        let mut coarse = coarse.clone();
        put_over(self.background, &mut coarse.pixels);
        let fine: Vec<[f64; 4]> = fine.pixels.iter().map(|p| p.map(f64::from)).collect();
        let found = Difference::of(&coarse, &fine, self.background, None)?.codes.p999;
        Ok(found.hypot(FLOOR_CODES))
    }
}

/// The error of the scene's own quality, drawn in `size` pixels: estimated as [`for_error`] does it, against the balanced
/// setting of a quarter of its step (of half a voxel at most).
///
/// # Errors
/// [`Error::Scene`] where there is no such finer setting; [`Error::Cancelled`] on request; else as [`Renderer::render`].
pub fn of_quality(renderer: &mut Renderer, scene: &Scene, size: [u32; 2], progress: &Progress) -> Result<Estimate> {
    let quality = scene.quality;
    let against_step = (0.25 * quality.step_voxels).min(LADDER[FINER]);
    let balanced = Quality::balanced(against_step);
    // A setting of the user's own may look at styles more closely than its step needs: what it is compared with does too. Borders are
    // compared with exact ones.
    let finer = Quality {
        step_voxels: against_step,
        style_change: quality.style_change.min(balanced.style_change),
        termination: quality.termination.min(balanced.termination),
        ..balanced
    };
    let mut sampler = Sampler::new(renderer, scene, size, progress)?;
    if !sampler.allows(finer) {
        return Err(Error::scene(
            format!("a step of {} voxels has no finer one to be compared with", quality.step_voxels),
            "choose a longer step",
        ));
    }
    let picture = sampler.draw(quality)?;
    let finest = sampler.draw(finer)?;
    Ok(Estimate {
        quality,
        codes: sampler.codes(&picture, &finest)?,
        ms: None,
        num_pixels: picture.pixels.len(),
        against_step,
    })
}

/// The cheapest setting whose error on this scene, drawn in `size` pixels, is estimated to be at most `bound` 8-bit codes
/// (99.9th percentile).
///
/// # Errors
/// [`Error::Scene`] where the bound cannot be met, with the best that can; else as [`Renderer::render`].
pub fn for_error(
    renderer: &mut Renderer,
    scene: &Scene,
    size: [u32; 2],
    bound: f64,
    progress: &Progress,
) -> Result<Estimate> {
    if !(bound.is_finite() && bound > 0.0) {
        return Err(Error::scene(format!("an error of {bound} codes is no bound"), "give a positive number"));
    }
    let mut sampler = Sampler::new(renderer, scene, size, progress)?;
    let target = FILL * bound;
    let mut pictures: Vec<FloatImage> = Vec::new();
    for &step in &LADDER {
        if !sampler.allows(Quality::balanced(step)) {
            break;
        }
        pictures.push(sampler.draw(Quality::balanced(step))?);
        let Some(candidate) = pictures.len().checked_sub(FINER + 1) else { continue };
        let finest = &pictures[candidate + FINER];
        let codes = sampler.codes(&pictures[candidate], finest)?;
        let estimate = |step, codes| Estimate {
            quality: Quality::balanced(step),
            codes,
            ms: None,
            num_pixels: finest.pixels.len(),
            against_step: LADDER[candidate + FINER],
        };
        if codes > target {
            continue;
        }
        // Between this rung and the one above, which was not good enough, errors go as a power of the step.
        if let Some(above) = candidate.checked_sub(1) {
            let coarser = sampler.codes(&pictures[above], finest)?;
            let share = (target / codes).ln() / (coarser / codes).ln();
            if coarser > codes && share > 0.1 {
                let step = LADDER[candidate] * (LADDER[above] / LADDER[candidate]).powf(share.min(0.95));
                let between = sampler.draw(Quality::balanced(step))?;
                let codes = sampler.codes(&between, finest)?;
                if codes <= target {
                    return Ok(estimate(step, codes));
                }
            }
        }
        return Ok(estimate(LADDER[candidate], codes));
    }
    // The finest setting that has a finer one to be compared with.
    let Some(last) = pictures.len().checked_sub(FINER + 1) else {
        return Err(Error::scene(
            "this volume is too large for an estimate of the error",
            "choose a quality by its name instead",
        ));
    };
    let codes = sampler.codes(&pictures[last], &pictures[last + FINER])?;
    Err(Error::scene(
        format!("an error of at most {bound} codes cannot be promised for this figure"),
        format!(
            "the best is {:.2} (a step of {} voxels): ask for that or more",
            (100.0 * codes / FILL).ceil() / 100.0,
            LADDER[last]
        ),
    ))
}

/// The most accurate setting with which drawing this scene in `size` pixels is expected to take at most `budget_ms`: on
/// this adapter, with what else it does just now. Reading the volume and writing the picture are not counted.
///
/// # Errors
/// [`Error::Scene`] where nothing is fast enough, with the time of the fastest; else as [`Renderer::render`].
pub fn for_budget(
    renderer: &mut Renderer,
    scene: &Scene,
    size: [u32; 2],
    budget_ms: f64,
    progress: &Progress,
) -> Result<Estimate> {
    if !(budget_ms.is_finite() && budget_ms > 0.0) {
        return Err(Error::scene(format!("{budget_ms} ms are no budget"), "give a positive number"));
    }
    let mut sampler = Sampler::new(renderer, scene, size, progress)?;
    let (coarsest, middle) = (LADDER[0], LADDER[1]);
    let (mut picture, coarsest_ms) = sampler.timed(coarsest)?;
    let whole_ms = sampler.whole_ms(coarsest)?;
    if whole_ms > budget_ms {
        return Err(Error::scene(
            format!("this figure cannot be drawn in {budget_ms} ms"),
            format!("the fastest that can be had takes {:.0} ms: ask for that or more", (whole_ms / PLANNED).ceil()),
        ));
    }
    // A sample's pixels lie apart and share less work than the picture's, and both have a part that does not depend on the
    // step: what the picture's time rises by when the sample's does, from one step to another, tells the rest.
    let (_, middle_ms) = sampler.timed(middle)?;
    let slope = (sampler.whole_ms(middle)? - whole_ms) / (middle_ms - coarsest_ms);
    let per_pixels = f64::from(size[0]) * f64::from(size[1]) / picture.pixels.len() as f64;
    let slope = if slope.is_finite() && slope > 0.0 { slope.min(2.0 * per_pixels) } else { per_pixels };
    let expected = |sample_ms: f64| whole_ms + slope * (sample_ms - coarsest_ms).max(0.0);
    let planned_ms = PLANNED * budget_ms;
    let (mut step, mut step_ms) = (coarsest, whole_ms);
    for finer in LADDER.into_iter().skip(1) {
        // Without a quarter of its step to be compared with, a setting has no estimate.
        if finer < FINEST_STEP || !sampler.allows(Quality::balanced(0.25 * finer)) {
            break;
        }
        let (next, sample_ms) = sampler.timed(finer)?;
        let next_ms = expected(sample_ms);
        if next_ms > planned_ms {
            // Between the two, times go as a power of the step.
            let share = (planned_ms / step_ms).ln() / (next_ms / step_ms).ln();
            if share > 0.1 {
                let between = step * (finer / step).powf(share.min(1.0));
                let (next, sample_ms) = sampler.timed(between)?;
                if expected(sample_ms) <= budget_ms {
                    (picture, step_ms, step) = (next, expected(sample_ms), between);
                }
            }
            break;
        }
        (picture, step_ms, step) = (next, next_ms, finer);
    }
    let against_step = 0.25 * step;
    let finest = sampler.draw(Quality::balanced(against_step))?;
    Ok(Estimate {
        quality: Quality::balanced(step),
        codes: sampler.codes(&picture, &finest)?,
        ms: Some(step_ms),
        num_pixels: picture.pixels.len(),
        against_step,
    })
}

impl Sampler<'_> {
    /// A sample and the time that it takes, in ms, without what is made only once for a step: pipeline, tables, textures.
    fn timed(&mut self, step_voxels: f64) -> Result<(FloatImage, f64)> {
        let once = self.clocked(step_voxels)?;
        if once.1 > LONG_MS { Ok(once) } else { self.clocked(step_voxels) }
    }

    /// The time that the whole picture takes, in ms.
    fn whole_ms(&mut self, step_voxels: f64) -> Result<f64> {
        self.scene.quality = Quality::balanced(step_voxels);
        let start = Instant::now();
        self.renderer.render(&self.scene, self.size, &RenderOptions::default(), self.progress)?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    fn clocked(&mut self, step_voxels: f64) -> Result<(FloatImage, f64)> {
        let start = Instant::now();
        let picture = self.draw(Quality::balanced(step_voxels))?;
        Ok((picture, start.elapsed().as_secs_f64() * 1e3))
    }
}
