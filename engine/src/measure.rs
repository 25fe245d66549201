//! The yardstick: how far a picture is from the truth, and what that accuracy costs. Outside a frame: it renders scenes
//! with the GPU and compares them with the f64 reference, refined until it stands still.
//!
//! Three parts: [`Difference`] says how far two pictures are apart, [`Converged`] is the picture that a scene means, and
//! [`measure`] gives each accuracy setting its time and its error.

use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;

use crate::color::srgb_from_linear;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reference::ray::{ray_from_pixel, samples};
use crate::reference::{March, Reference};
use crate::render::{FloatImage, RenderOptions, Renderer};
use crate::scene::{Background, Borders, Quality, Scene};

/// What the differences of all pixels come to. A pixel's difference is that of its worst channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Deviation {
    /// Root mean square over the pixels.
    pub rmse: f64,
    /// 99.9th percentile: the smallest difference that at least 99.9 % of the pixels do not exceed.
    pub p999: f64,
    /// The largest.
    pub max: f64,
}

impl Deviation {
    /// Of the pixels' differences (finite, in any order); zeros for none.
    fn of(mut differences: Vec<f64>) -> Self {
        differences.sort_by(f64::total_cmp);
        let Some(&max) = differences.last() else { return Self::default() };
        let n = differences.len();
        let squares: f64 = differences.iter().map(|d| d * d).sum();
        // Nearest rank, ⌈0.999 n⌉, in integers.
        Self { rmse: (squares / n as f64).sqrt(), p999: differences[(n * 999).div_ceil(1000) - 1], max }
    }
}

/// How far a picture is from a reference, on float pixels before any rounding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// In premultiplied linear RGBA, over the background if that is opaque.
    pub linear: Deviation,
    /// In 8-bit sRGB codes (255 times the encoded value, not rounded): over the scene's background if that is opaque,
    /// else over black or white, whichever shows the pixel's difference more.
    pub codes: Deviation,
    /// Share, 0 … 1, of the pixels compared in which either picture shows anything but background.
    pub covered: f64,
    /// Pixels that were compared.
    pub num_compared: usize,
    /// Pixels left out, because the reference does not know them well enough.
    pub num_unsettled: usize,
}

impl Difference {
    /// Compares `picture`, as [`Renderer::render`] makes it (over `background`), with the pixels of a reference, which
    /// come without background. Pixels marked in `unsettled` are counted and left out.
    ///
    /// # Errors
    /// [`Error::Scene`] for pictures of different sizes, a pixel that is not finite, or nothing left to compare.
    pub fn of(
        picture: &FloatImage,
        reference: &[[f64; 4]],
        background: Background,
        unsettled: Option<&[bool]>,
    ) -> Result<Self> {
        let num_pixels = picture.pixels.len();
        if reference.len() != num_pixels || unsettled.is_some_and(|u| u.len() != num_pixels) {
            return Err(Error::scene(
                format!("a picture of {num_pixels} pixels is compared with one of {}", reference.len()),
                "give both the same size",
            ));
        }
        let (mut linear, mut codes, mut num_covered) = (Vec::new(), Vec::new(), 0usize);
        for (i, (pixel, reference)) in picture.pixels.iter().zip(reference).enumerate() {
            if unsettled.is_some_and(|u| u[i]) {
                continue;
            }
            let pixel = pixel.map(f64::from);
            if pixel.iter().chain(reference).any(|c| !c.is_finite()) {
                return Err(Error::scene(
                    format!("pixel {i} is not finite: {pixel:?} against {reference:?}"),
                    "this is a fault of the rendering; report it with the scene",
                ));
            }
            let (expected, shows) = match background {
                Background::Transparent => (*reference, pixel[3] > 0.0 || reference[3] > 0.0),
                Background::Color(color) => {
                    let color = color.map(f64::from);
                    (over(*reference, color), reference[3] > 0.0 || pixel[..3] != color)
                }
            };
            num_covered += usize::from(shows);
            linear.push((0..4).map(|c| (pixel[c] - expected[c]).abs()).fold(0.0, f64::max));
            codes.push(match background {
                Background::Color(_) => codes_apart(pixel, expected),
                Background::Transparent => [0.0, 1.0]
                    .map(|gray| codes_apart(over(pixel, [gray; 3]), over(expected, [gray; 3])))
                    .into_iter()
                    .fold(0.0, f64::max),
            });
        }
        let num_compared = codes.len();
        if num_compared == 0 {
            return Err(Error::scene(
                "no pixel of the reference settled, so that there is nothing to compare",
                "choose another size or view",
            ));
        }
        Ok(Self {
            linear: Deviation::of(linear),
            codes: Deviation::of(codes),
            covered: num_covered as f64 / num_compared as f64,
            num_compared,
            num_unsettled: num_pixels - num_compared,
        })
    }
}

/// A premultiplied color over an opaque one.
fn over(rgba: [f64; 4], color: [f64; 3]) -> [f64; 4] {
    let through = 1.0 - rgba[3];
    [rgba[0] + through * color[0], rgba[1] + through * color[1], rgba[2] + through * color[2], 1.0]
}

/// The largest difference of two opaque linear colors in 8-bit sRGB codes. Below black there is only black.
fn codes_apart(a: [f64; 4], b: [f64; 4]) -> f64 {
    let code = |linear: f64| 255.0 * srgb_from_linear(linear.max(0.0));
    (0..3).map(|c| (code(a[c]) - code(b[c])).abs()).fold(0.0, f64::max)
}

/// Halving the step must change a pixel by less than this, in its worst channel (premultiplied linear), …
const SETTLED: f64 = 1e-4;
/// … this often in a row, since a single small change may be an accident; only at the finest step one is enough.
const SETTLED_TWICE: u32 = 2;
/// The step, in voxels, at which refinement begins.
const COARSEST_STEP: f64 = 0.5;
/// The step, in voxels, at which it gives up.
const FINEST_STEP: f64 = 1.0 / 256.0;
/// Transmittance below which rays end all the same: a thousandth of what counts as settled.
const NEVER: f64 = 1e-7;
/// Samples that all refinements of a pixel may take together: a ray through 256 voxels gets to the finest step, one
/// through a stack of thousands does not take minutes.
const MAX_SAMPLES_PER_PIXEL: u64 = 1 << 18;

/// The picture that a scene means, whatever its quality says: the f64 reference without early termination, each pixel
/// with the step halved until that no longer changes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Converged {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Premultiplied linear RGBA without background, row 0 = top.
    pub pixels: Vec<[f64; 4]>,
    /// Whether a pixel still changed by 1e-4 or more when refinement had to stop (silhouettes, jumps of the transfer
    /// function or of a style); its color is that of the finest step.
    pub unsettled: Vec<bool>,
    /// How many those are.
    pub num_unsettled: usize,
}

impl Converged {
    /// Refines all pixels of a picture of `size` (width, height), on all cores. Progress counts pixels.
    ///
    /// # Errors
    /// What [`Reference::new`] refuses, [`Error::Scene`] for a picture without pixels, [`Error::Cancelled`] on request.
    pub fn of(scene: &Scene, size: [u32; 2], progress: &Progress) -> Result<Self> {
        let [width, height] = size;
        if width == 0 || height == 0 {
            return Err(Error::scene(
                format!("a picture of {width} x {height} pixels has nothing in it"),
                "choose at least 1 pixel a side",
            ));
        }
        progress.begin("preparing the reference", 0);
        let reference = Reference::new(scene)?;
        let num_pixels = u64::from(width) * u64::from(height);
        progress.begin("converging the reference", num_pixels);
        let refined: Vec<([f64; 4], bool)> = (0..num_pixels)
            .into_par_iter()
            .map(|i| {
                progress.check()?;
                let (x, y) = ((i % u64::from(width)) as u32, (i / u64::from(width)) as u32);
                let refined = refine(|step| reference.march(size, x, y, step, NEVER));
                progress.advance(1)?;
                Ok(refined)
            })
            .collect::<Result<_>>()?;
        let (pixels, settled): (Vec<[f64; 4]>, Vec<bool>) = refined.into_iter().unzip();
        let unsettled: Vec<bool> = settled.into_iter().map(|s| !s).collect();
        let num_unsettled = unsettled.iter().filter(|u| **u).count();
        Ok(Self { size, pixels, unsettled, num_unsettled })
    }

    /// How far `picture` of the same scene is from this one, over the scene's `background`.
    ///
    /// # Errors
    /// As [`Difference::of`].
    pub fn difference(&self, picture: &FloatImage, background: Background) -> Result<Difference> {
        Difference::of(picture, &self.pixels, background, Some(&self.unsettled))
    }
}

/// The color at the finest step that was needed (or allowed), and whether it settled.
fn refine(march: impl Fn(f64) -> March) -> ([f64; 4], bool) {
    let mut step = COARSEST_STEP;
    let mut now = march(step);
    let mut num_samples = now.num_samples;
    let mut num_small = 0;
    // A ray beside the volume has nothing to refine.
    while now.num_samples > 0 {
        step /= 2.0;
        if step < FINEST_STEP || num_samples + 2 * now.num_samples > MAX_SAMPLES_PER_PIXEL {
            return (now.rgba, num_small > 0);
        }
        let before = now.rgba;
        now = march(step);
        num_samples += now.num_samples;
        let change = (0..4).map(|c| (now.rgba[c] - before[c]).abs()).fold(0.0, f64::max);
        num_small = if change < SETTLED { num_small + 1 } else { 0 };
        if num_small == SETTLED_TWICE {
            break;
        }
    }
    (now.rgba, true)
}

/// A setting with what it costs and what it gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The setting.
    pub quality: Quality,
    /// Median time of a frame in milliseconds: one [`Renderer::render`] of a resident volume, with its tables, its draw
    /// and the pixels' way back.
    pub ms: f64,
    /// See [`samples_per_ray`].
    pub samples_per_ray: f64,
    /// How far the picture is from the converged one.
    pub difference: Difference,
    /// No other setting is both as fast and as accurate (99.9th percentile of the codes), and better in one of the two.
    pub pareto: bool,
}

/// Steps of the default grid, in voxels.
const STEPS: [f64; 8] = [8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625];
/// Style changes of the default grid, as multiples of the balanced one.
const CHANGES: [f64; 3] = [4.0, 1.0, 0.25];

/// The settings that are worth a measurement and that `scene` allows, coarse to fine, the named qualities and what their
/// termination does among them; with regions, also the named qualities with borders by two look-ups.
pub fn default_settings(scene: &Scene) -> Vec<Quality> {
    let mut settings = vec![Quality::DRAFT, Quality::STANDARD, Quality::FINAL];
    for step_voxels in STEPS {
        let balanced = Quality::balanced(step_voxels);
        for times in CHANGES {
            settings.push(Quality { style_change: times * balanced.style_change, ..balanced });
        }
    }
    for termination in [1.0 / 64.0, 1.0 / 256.0, 1.0 / 1024.0, 1.0 / 16384.0] {
        settings.push(Quality { termination, ..Quality::STANDARD });
    }
    if scene.objects.iter().any(|object| !object.regions.is_empty()) {
        let named = [Quality::DRAFT, Quality::STANDARD, Quality::FINAL];
        settings.extend(named.map(|quality| Quality { borders: Borders::TwoLookUps, ..quality }));
    }
    // What is alike but for borders stands together, the exact ones first.
    let key = |q: &Quality| [q.step_voxels, q.style_change, q.termination, -f64::from(q.borders as u8)];
    settings.sort_by(|a, b| key(b).partial_cmp(&key(a)).unwrap_or(std::cmp::Ordering::Equal));
    settings.dedup();
    let mut scene = scene.clone();
    settings.retain(|quality| {
        scene.quality = *quality;
        scene.validate().is_ok()
    });
    settings
}

/// Draws `scene` with each of `settings`, `frames` times and once before for what is made only once, and compares the
/// pictures with `converged`, whose size they have. The camera stands still; the renderer caches no pictures.
///
/// # Errors
/// As [`Renderer::render`] and [`Difference::of`]; [`Error::Scene`] for 0 frames.
pub fn measure(
    renderer: &mut Renderer,
    scene: &Scene,
    converged: &Converged,
    settings: &[Quality],
    frames: u32,
    progress: &Progress,
) -> Result<Vec<Row>> {
    if frames == 0 {
        return Err(Error::scene("0 frames have no time", "measure at least 1"));
    }
    // A fine step takes longer than a coarse one: the estimate of what is left must know.
    let weight = |quality: &Quality| (64.0 / quality.step_voxels).ceil() as u64;
    progress.begin("measuring", settings.iter().map(|q| weight(q) * u64::from(frames + 1)).sum());
    let mut rows = Vec::with_capacity(settings.len());
    let mut times_ms = vec![Vec::with_capacity(frames as usize); settings.len()];
    let mut scene = scene.clone();
    // All settings in turn, again and again: what slows the machine down for a while slows all of them.
    for round in 0..=frames {
        for (quality, times_ms) in settings.iter().zip(&mut times_ms) {
            scene.quality = *quality;
            let start = Instant::now();
            // A progress of its own: tiles are not what is counted here.
            let picture = renderer.render(&scene, converged.size, &RenderOptions::default(), &Progress::new())?;
            let ms = start.elapsed().as_secs_f64() * 1e3;
            if round == 0 {
                rows.push(Row {
                    quality: *quality,
                    ms: 0.0,
                    samples_per_ray: samples_per_ray(&scene, converged.size),
                    difference: converged.difference(&picture, scene.background)?,
                    pareto: false,
                });
            } else {
                times_ms.push(ms);
            }
            progress.advance(weight(quality))?;
        }
    }
    for (row, times_ms) in rows.iter_mut().zip(&mut times_ms) {
        row.ms = median(times_ms);
    }
    let points: Vec<[f64; 2]> = rows.iter().map(|row| [row.ms, row.difference.codes.p999]).collect();
    for (row, pareto) in rows.iter_mut().zip(pareto_front(&points)) {
        row.pareto = pareto;
    }
    Ok(rows)
}

/// Which points, of two numbers that shall both be small, are on the Pareto front: no other point is at most as large
/// in both and smaller in one. Equal points share their place; one with a NaN has none.
pub fn pareto_front(points: &[[f64; 2]]) -> Vec<bool> {
    let beats = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
    points.iter().map(|p| !p.iter().any(|c| c.is_nan()) && !points.iter().any(|other| beats(other, p))).collect()
}

/// The median; of an even number the mean of the two in the middle; NaN of none. Sorts `values`.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { f64::NAN } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}

/// Pixels a side of the sparse grid that [`samples_per_ray`] averages over, at most.
const SPARSE_EDGE: u32 = 32;

/// The mean number of samples on the rays of a picture of `size` pixels at the scene's step: those on a ray's grid inside
/// the volume's box (the reference's `num_samples`), 0 for a ray beside it. What leaping over empty bricks and early
/// termination save is not taken off, so that the number says how finely a ray is sampled. Averaged over a sparse
/// grid of at most 32 × 32 pixels; 0 for a scene or picture without content.
pub fn samples_per_ray(scene: &Scene, size: [u32; 2]) -> f64 {
    let Some(object) = scene.objects.first() else { return 0.0 };
    let pixels = sparse_pixels(size, SPARSE_EDGE);
    let count = |&[x, y]: &[u32; 2]| {
        let ray = ray_from_pixel(&scene.camera, size, x, y);
        samples(&ray, &object.volume.grid, scene.quality.step_voxels).map_or(0, |s| s.count)
    };
    pixels.iter().map(count).sum::<u64>() as f64 / pixels.len().max(1) as f64
}

/// Columns and rows of an even grid of at most `most` × `most` pixels of a picture of `size`.
fn sparse_pixels(size: [u32; 2], most: u32) -> Vec<[u32; 2]> {
    let places = |edge: u32| {
        let n = u64::from(edge.min(most));
        (0..n).map(move |i| ((2 * i + 1) * u64::from(edge) / (2 * n)) as u32)
    };
    places(size[1]).flat_map(|y| places(size[0]).map(move |x| [x, y])).collect()
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::reference::testing::{node, scene, volume};
    use crate::scene::{Camera, Projection};
    use crate::styles::StyleImage;

    fn picture(pixels: Vec<[f32; 4]>) -> FloatImage {
        FloatImage { width: pixels.len() as u32, height: 1, pixels }
    }

    #[test]
    fn a_difference_has_its_closed_form() {
        // 2000 gray opaque pixels; one of them is 0.25 too dark, in light.
        let mut pixels = vec![[0.5, 0.5, 0.5, 1.0]; 2000];
        let reference: Vec<[f64; 4]> = pixels.iter().map(|p| p.map(f64::from)).collect();
        let same = Difference::of(&picture(pixels.clone()), &reference, Background::Transparent, None).unwrap();
        assert_eq!((same.linear, same.codes), (Deviation::default(), Deviation::default()));
        assert_eq!((same.covered, same.num_compared, same.num_unsettled), (1.0, 2000, 0));
        pixels[7] = [0.25, 0.5, 0.5, 1.0];
        let one = Difference::of(&picture(pixels.clone()), &reference, Background::Transparent, None).unwrap();
        let codes = 255.0 * (srgb_from_linear(0.5) - srgb_from_linear(0.25));
        assert_eq!(one.linear.max, 0.25);
        assert!((one.codes.max - codes).abs() < 1e-9);
        assert!((one.linear.rmse - 0.25 / 2000f64.sqrt()).abs() < 1e-15);
        assert!((one.codes.rmse - codes / 2000f64.sqrt()).abs() < 1e-12);
        // One pixel of 2000 is below a thousandth, two are a thousandth, three are above.
        for (extra, p999) in [(8, 0.0), (9, 0.25)] {
            pixels[extra] = [0.25, 0.5, 0.5, 1.0];
            let found = Difference::of(&picture(pixels.clone()), &reference, Background::Transparent, None).unwrap();
            assert_eq!(found.linear.p999, p999, "{extra}");
        }
        // What is unsettled is left out, but counted.
        let unsettled: Vec<bool> = (0..2000).map(|i| (7..10).contains(&i)).collect();
        let without = Difference::of(&picture(pixels), &reference, Background::Transparent, Some(&unsettled)).unwrap();
        assert_eq!((without.codes.max, without.num_compared, without.num_unsettled), (0.0, 1997, 3));
    }

    #[test]
    fn a_difference_is_seen_over_the_background_that_shows_it() {
        // Black of opacity ½ against nothing: invisible over black, and half the light over white.
        let (half_black, clear) = ([0.0, 0.0, 0.0, 0.5], [0.0; 4]);
        let expected = 255.0 * (1.0 - srgb_from_linear(0.5));
        let found = Difference::of(&picture(vec![half_black]), &[clear], Background::Transparent, None).unwrap();
        assert!((found.codes.max - expected).abs() < 1e-9 && found.linear.max == 0.5, "{found:?}");
        // White of opacity ½: invisible over white.
        let half_white = [0.5; 4];
        let found = Difference::of(&picture(vec![half_white]), &[clear], Background::Transparent, None).unwrap();
        assert!((found.codes.max - 255.0 * srgb_from_linear(0.5)).abs() < 1e-9, "{found:?}");
        // Over an opaque background only that one counts; the picture comes with it, the reference without.
        let color = [0.25, 0.5, 0.75];
        let over_color = picture(vec![[0.125, 0.25, 0.375, 1.0], [0.25, 0.5, 0.75, 1.0]]);
        let reference = [[0.0, 0.0, 0.0, 0.5], clear];
        let found = Difference::of(&over_color, &reference, Background::Color(color), None).unwrap();
        assert_eq!((found.codes.max, found.linear.max, found.covered), (0.0, 0.0, 0.5));
        let found = Difference::of(&over_color, &[clear, clear], Background::Color(color), None).unwrap();
        assert_eq!(found.linear.max, 0.375);
    }

    #[test]
    fn a_planted_shift_is_seen() {
        let row = |shift: f64| (0..500).map(move |i| 0.5 + 0.5 * (0.05 * (f64::from(i) - shift)).sin());
        let reference: Vec<[f64; 4]> = row(0.0).map(|v| [v, v, v, 1.0]).collect();
        let errors = [0.0, 0.1, 1.0].map(|shift| {
            let shifted = picture(row(shift).map(|v| [v as f32, v as f32, v as f32, 1.0]).collect());
            Difference::of(&shifted, &reference, Background::Transparent, None).unwrap()
        });
        // The steepest slope is 0.025 a pixel, and 1/√2 of it in the mean.
        assert!(errors[0].linear.max < 1e-7 && errors[0].codes.max < 1e-2, "{:?}", errors[0]);
        assert!(
            (errors[2].linear.max - 0.025).abs() < 1e-4 && (errors[2].linear.rmse - 0.025 / 2f64.sqrt()).abs() < 1e-3
        );
        assert!((errors[2].codes.rmse / errors[1].codes.rmse - 10.0).abs() < 1.0);
    }

    #[test]
    fn pictures_that_cannot_be_compared_are_refused() {
        let one = picture(vec![[0.0; 4]]);
        let compare = |p: &FloatImage, r: &[[f64; 4]], u: Option<&[bool]>| {
            Difference::of(p, r, Background::Transparent, u).unwrap_err().to_string()
        };
        assert!(compare(&one, &[], None).contains("same size"));
        assert!(compare(&one, &[[0.0; 4]], Some(&[])).contains("same size"));
        assert!(compare(&one, &[[0.0; 4]], Some(&[true])).contains("settled"));
        assert!(compare(&picture(vec![[f32::NAN; 4]]), &[[0.0; 4]], None).contains("not finite"));
        assert!(compare(&one, &[[f64::INFINITY; 4]], None).contains("not finite"));
    }

    #[test]
    fn refinement_stops_for_its_reasons() {
        use std::cell::Cell;
        let calls = Cell::new(0u32);
        let march = |samples_per_voxel: f64, value: &dyn Fn(f64) -> f64| {
            calls.set(0);
            refine(|step| {
                calls.set(calls.get() + 1);
                let num_samples = (samples_per_voxel / step).ceil() as u64;
                March { rgba: [value(step); 4], num_samples, num_visible: num_samples }
            })
        };
        // Second order with a constant of 0.01: changes of 1.9e-3, 4.7e-4, 1.2e-4, 2.9e-5, 7.3e-6.
        assert!(march(10.0, &|h| 0.01 * h * h).1);
        assert_eq!(calls.get(), 6);
        // One accidental agreement is not enough: ½ and ¼ agree, ⅛ does not.
        let (rgba, settled) = march(10.0, &|h| if h > 0.2 { 0.3 } else { 0.4 });
        assert!(settled && rgba[0] == 0.4);
        assert_eq!(calls.get(), 5);
        // First order, with changes of 1.6e-4 before the finest step and 7.8e-5 at it: that has to do.
        assert!(march(10.0, &|h| 0.02 * h).1);
        assert_eq!(calls.get(), 8);
        // What never settles goes to the finest step and says so.
        let (rgba, settled) = march(10.0, &|h| 0.1 * (1.0 / h).log2());
        assert!(!settled && (rgba[0] - 0.8).abs() < 1e-12);
        assert_eq!(calls.get(), 8);
        // … or until it has cost enough: 2000 + 4000 + … stays below the budget.
        assert!(!march(16_384.0, &|h| 1.0 / h).1);
        assert_eq!(calls.get(), 3);
        assert!(march(0.0, &|_| 0.0).1);
        assert_eq!(calls.get(), 1);
    }

    /// A block of `dims` voxels of 1 mm with `value` at each position, seen along +x by parallel rays.
    fn block(value: impl Fn(DVec3) -> f64, nodes: &[(f64, f64)]) -> Scene {
        let projection = Projection::Orthographic { height_mm: 6.0 };
        let camera = Camera::looking(DVec3::new(-50.0, 3.5, 3.5), DVec3::X, DVec3::Z, projection).unwrap();
        let nodes = nodes.iter().map(|&(at, opacity)| node(at, 0, opacity)).collect();
        scene(volume([12, 8, 8], DAffine3::IDENTITY, value), nodes, vec![StyleImage::flat("w", [1.0; 4])], camera)
    }

    #[test]
    fn a_homogeneous_slab_converges_at_once() {
        let mut scene = block(|_| 1.0, &[(0.0, 0.2)]);
        let progress = Progress::new();
        let converged = Converged::of(&scene, [12, 6], &progress).unwrap();
        assert_eq!((converged.num_unsettled, progress.snapshot().1), (0, 72));
        // The picture is 12 mm wide and the block 8: two columns a side look past it.
        let expected = 1.0 - 0.8f64.powi(12);
        for (i, pixel) in converged.pixels.iter().enumerate() {
            let inside = (2..10).contains(&(i % 12));
            let value = if inside { expected } else { 0.0 };
            assert!(pixel.iter().all(|c| (c - value).abs() < 1e-9), "{i}: {pixel:?}");
        }
        // The scene's own quality does not matter.
        scene.quality = Quality { step_voxels: 7.0, termination: 0.5, ..Quality::FINAL };
        assert_eq!(Converged::of(&scene, [12, 6], &progress).unwrap(), converged);
        let image =
            FloatImage { width: 12, height: 6, pixels: converged.pixels.iter().map(|p| p.map(|c| c as f32)).collect() };
        let difference = converged.difference(&image, Background::Transparent).unwrap();
        assert!(difference.codes.max < 1e-3 && (difference.covered - 8.0 / 12.0).abs() < 1e-12, "{difference:?}");
    }

    #[test]
    fn a_step_edge_converges_or_is_counted() {
        // A ramp along the ray that becomes visible at 4.3 voxels and turns denser at 7.7: neither on any step's grid.
        let scene = block(|p| p.x, &[(4.3, 0.0), (4.3, 0.1), (7.7, 0.1), (7.7, 0.35)]);
        let converged = Converged::of(&scene, [4, 4], &Progress::new()).unwrap();
        // Beyond the last voxel center the edge value goes on, to 11.5.
        let expected = 1.0 - 0.9f64.powf(7.7 - 4.3) * 0.65f64.powf(11.5 - 7.7);
        for (pixel, unsettled) in converged.pixels.iter().zip(&converged.unsettled) {
            let tolerance = if *unsettled { 3e-3 } else { 3e-4 };
            assert!((pixel[3] - expected).abs() < tolerance, "{pixel:?} {expected} {unsettled}");
        }
        assert_eq!(converged.num_unsettled, converged.unsettled.iter().filter(|u| **u).count());
    }

    #[test]
    fn convergence_can_be_cancelled_and_needs_pixels() {
        let scene = block(|p| p.x, &[(0.0, 0.2)]);
        let progress = Progress::new();
        assert!(Converged::of(&scene, [0, 4], &progress).is_err());
        progress.cancel();
        assert!(matches!(Converged::of(&scene, [64, 64], &progress), Err(Error::Cancelled)));
    }

    #[test]
    fn the_front_has_what_nothing_beats() {
        let points =
            [[1.0, 9.0], [2.0, 4.0], [2.0, 5.0], [3.0, 4.0], [4.0, 1.0], [4.0, 1.0], [9.0, 2.0], [f64::NAN, 0.0]];
        assert_eq!(pareto_front(&points), [true, true, false, false, true, true, false, false]);
        assert!(pareto_front(&[]).is_empty());
    }

    #[test]
    fn medians() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&mut []).is_nan());
    }

    #[test]
    fn samples_per_ray_are_the_references() {
        let mut scene = block(|p| p.x, &[(0.0, 0.2)]);
        for step_voxels in [2.0, 0.35] {
            scene.quality.step_voxels = step_voxels;
            let size = [12, 6];
            let reference = Reference::new(&scene).unwrap();
            let march = |[x, y]: [u32; 2]| reference.march(size, x, y, step_voxels, 0.0).num_samples;
            let pixels = sparse_pixels(size, SPARSE_EDGE);
            assert_eq!(pixels.len(), 72);
            let mean = pixels.into_iter().map(march).sum::<u64>() as f64 / 72.0;
            assert_eq!(samples_per_ray(&scene, size), mean);
        }
        assert_eq!(
            sparse_pixels([100, 3], 4),
            [
                [12, 0],
                [37, 0],
                [62, 0],
                [87, 0],
                [12, 1],
                [37, 1],
                [62, 1],
                [87, 1],
                [12, 2],
                [37, 2],
                [62, 2],
                [87, 2]
            ]
        );
        scene.objects.clear();
        assert_eq!(samples_per_ray(&scene, [4, 4]), 0.0);
    }

    #[test]
    fn the_default_grid_has_the_named_qualities_once() {
        let settings = default_settings(&block(|_| 1.0, &[(0.0, 0.2)]));
        for named in [Quality::DRAFT, Quality::STANDARD, Quality::FINAL] {
            assert_eq!(settings.iter().filter(|q| **q == named).count(), 1);
        }
        assert!(settings.windows(2).all(|w| w[0].step_voxels >= w[1].step_voxels && w[0] != w[1]));
        assert!(settings.iter().all(|q| q.validate().is_ok()));
    }
}
