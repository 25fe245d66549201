//! Styles from artwork (thesis §3.3.1, Fig. 3.4; Sloan et al. 2001, "The Lit Sphere"): a ball in a picture is resampled to a
//! style's square, and where there is no ball, places whose normal somebody knows are interpolated over the sphere.
//!
//! All mixing is done in premultiplied linear light. Places of pictures are in pixels: x to the right, y down, (0, 0) the outer
//! corner of the first pixel, whose center is (0.5, 0.5).

mod normals;

use std::path::Path;

use rayon::prelude::*;

use super::{STYLE_SIZE, extend_radially, normal_from_uv};
use crate::color;
use crate::error::{Error, Result};
use crate::image_out::{Picture, PngOptions, save_png};

pub use self::normals::{CONTRADICTION_CODES, Contradiction, NormalPair, extract_normals};

/// The smallest radius of a circle, in pixels.
pub const MIN_RADIUS_PX: f64 = 4.0;
/// Below this radius, in pixels, a style is visibly softer than the built-in ones.
pub const SHARP_RADIUS_PX: f64 = 32.0;
/// Of a disc, at most this share may be filled from its neighbors.
pub const MAX_FILLED: f64 = 0.5;
/// Pixels nearer than this to the circle, in pixels, mix in what is behind the ball: half a pixel's diagonal.
const RIM_PX: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// What transparency in the picture means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Alpha {
    /// Nothing is there: a hole, filled from its neighbors; the style is opaque.
    #[default]
    Fill,
    /// The style is as transparent there.
    Keep,
}

/// What is done to the colors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// How far colors go to the gray of their luminance, in linear light: 0 (not) to 1.
    pub desaturate: f64,
    /// Whether all colors are made brighter by one factor, so that the brightest channel of all but the brightest 1 % of the
    /// directions is 1 (highlights clip): artwork is often dark.
    pub relight: bool,
    /// What transparency means.
    pub alpha: Alpha,
}

/// A style taken from a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Extracted {
    /// [`STYLE_SIZE`]² texels of straight linear RGBA, as style files have them: the sphere touches the edges, row 0 = up. Beyond
    /// the disc the rim's colors go on for two texels, then it is transparent.
    pub picture: Picture,
    /// The share of the disc, 0 to 1, about which the picture says nothing and which was filled from its neighbors.
    pub filled: f64,
    /// Pairs of one normal and different colors, which were averaged; none from a circle.
    pub contradictions: Vec<Contradiction>,
}

/// The style of a ball that fills the circle around `center_px` = (x, y) with `radius_px` in `picture` (straight linear RGBA).
///
/// Each texel is the mean of the pixels around its place, weighted by a tent as wide as the coarser of both grids. Pixels within
/// half a diagonal of the circle are left out, as the background is mixed in there: the rim has the color of the ring inside. A
/// texel of which less than half can be seen is a hole, filled by the harmonic function of its borders (as a membrane would).
///
/// # Errors
/// [`Error::Scene`] for numbers that are not finite, a circle smaller than [`MIN_RADIUS_PX`], wholly off the picture, or of
/// which more than half must be filled.
pub fn extract_circle(picture: &Picture, center_px: [f64; 2], radius_px: f64, options: &Options) -> Result<Extracted> {
    check(options)?;
    let [x, y] = center_px;
    if ![x, y, radius_px].iter().all(|v| v.is_finite()) {
        return Err(Error::scene(
            "the circle's place or radius is no number",
            "give three numbers: x, y, radius in pixels",
        ));
    }
    if radius_px < MIN_RADIUS_PX {
        return Err(Error::scene(
            format!("the circle's radius of {radius_px} pixels is too small for a style"),
            format!("choose a ball of at least {MIN_RADIUS_PX} pixels' radius, better {SHARP_RADIUS_PX} or more"),
        ));
    }
    let (width, height) = (picture.width as f64, picture.height as f64);
    // The point of the picture that is nearest to the center.
    if (x - x.clamp(0.0, width)).hypot(y - y.clamp(0.0, height)) >= radius_px {
        return Err(Error::scene(
            format!("the circle lies wholly off the picture of {width} × {height} pixels"),
            "choose one in it: x from the left, y from the top, in pixels",
        ));
    }
    // Also what keeps the work within a few times the picture.
    let area = std::f64::consts::PI * radius_px * radius_px;
    if width * height < (1.0 - MAX_FILLED) * area {
        return Err(too_empty(1.0 - width * height / area));
    }
    let ball = Ball { picture, center: center_px, radius: radius_px, alpha: options.alpha };
    let texels: Vec<Option<[f32; 4]>> =
        (0..STYLE_SIZE * STYLE_SIZE).into_par_iter().map(|i| ball.texel(n_xy_of(i)?)).collect();
    let disc = || (0..texels.len()).filter(|i| n_xy_of(*i).is_some());
    let num_holes = disc().filter(|i| texels[*i].is_none()).count();
    let filled = num_holes as f64 / disc().count() as f64;
    if filled > MAX_FILLED {
        return Err(too_empty(filled));
    }
    Ok(Extracted { picture: finish(fill(&texels), options), filled, contradictions: Vec::new() })
}

/// Writes a style's file, whole or not at all.
///
/// # Errors
/// [`Error::File`] if it cannot be written.
pub fn save(found: &Extracted, path: &Path) -> Result<()> {
    let pixels: Vec<[f32; 4]> = found.picture.pixels.iter().copied().map(color::premultiplied_from_straight).collect();
    let text = vec![("Software".to_owned(), format!("Fabrica {}", env!("CARGO_PKG_VERSION")))];
    let (width, height) = (found.picture.width as u32, found.picture.height as u32);
    save_png(path, width, height, &pixels, &PngOptions { text, ..PngOptions::default() })
}

fn too_empty(share: f64) -> Error {
    Error::scene(
        format!("{:.0} % of the circle lie off the picture or on transparent pixels", 100.0 * share),
        format!("choose a circle of which at least {:.0} % can be seen", 100.0 * (1.0 - MAX_FILLED)),
    )
}

fn check(options: &Options) -> Result<()> {
    if (0.0..=1.0).contains(&options.desaturate) {
        return Ok(());
    }
    Err(Error::scene(format!("colors cannot be desaturated by {}", options.desaturate), "give a number from 0 to 1"))
}

/// The n_xy of a texel's center; none outside the disc.
fn n_xy_of(texel: usize) -> Option<[f64; 2]> {
    let uv = [texel % STYLE_SIZE, texel / STYLE_SIZE].map(|i| (i as f64 + 0.5) / STYLE_SIZE as f64);
    let n_xy = normal_from_uv(uv, STYLE_SIZE);
    (n_xy[0].hypot(n_xy[1]) <= 1.0 + 1e-9).then_some(n_xy)
}

/// A ball in a picture.
struct Ball<'a> {
    picture: &'a Picture,
    center: [f64; 2],
    radius: f64,
    alpha: Alpha,
}

impl Ball<'_> {
    /// The premultiplied color of a normal, or none where too little is seen.
    fn texel(&self, n_xy: [f64; 2]) -> Option<[f32; 4]> {
        let half_width = (2.0 * self.radius / (STYLE_SIZE as f64 - 1.0)).max(1.0);
        let most = self.radius - RIM_PX;
        // What lies between the outermost pixels and the rim has the color of the former.
        let length = n_xy[0].hypot(n_xy[1]) * self.radius;
        let pull = if length > most { self.radius * most / length } else { self.radius };
        let (x, y) = (self.center[0] + pull * n_xy[0], self.center[1] - pull * n_xy[1]);
        let range = |v: f64| ((v - half_width - 0.5).ceil() as i64, (v + half_width - 0.5).floor() as i64);
        let ((x0, x1), (y0, y1)) = (range(x), range(y));
        let tent = |i: i64, v: f64| 1.0 - (i as f64 + 0.5 - v).abs() / half_width;
        let (mut sum, mut seen, mut total) = ([0.0; 4], 0.0, 0.0);
        for row in y0..=y1 {
            let (across, is_row) = (tent(row, y), (0..self.picture.height as i64).contains(&row));
            for column in x0..=x1 {
                let (dx, dy) = (column as f64 + 0.5 - self.center[0], row as f64 + 0.5 - self.center[1]);
                if dx * dx + dy * dy > most * most {
                    continue;
                }
                let weight = across * tent(column, x);
                total += weight;
                if is_row && (0..self.picture.width as i64).contains(&column) {
                    let pixel = self.picture.pixels[row as usize * self.picture.width + column as usize];
                    let [r, g, b, a] = color::premultiplied_from_straight(pixel).map(f64::from);
                    for (sum, c) in sum.iter_mut().zip([r, g, b, a]) {
                        *sum += weight * c;
                    }
                    seen += weight * if self.alpha == Alpha::Fill { a } else { 1.0 };
                }
            }
        }
        (seen > 0.5 * total && seen > 0.0).then(|| sum.map(|c| (c / seen) as f32))
    }
}

/// Fills holes in the disc with the harmonic function of what is around them: first coarse to fine by means of what there is, then
/// relaxed. What is outside the disc has no say, and stays transparent.
fn fill(texels: &[Option<[f32; 4]>]) -> Vec<[f32; 4]> {
    let mut filled = coarse_to_fine(texels, STYLE_SIZE);
    let holes: Vec<usize> = (0..texels.len()).filter(|i| texels[*i].is_none() && n_xy_of(*i).is_some()).collect();
    let is_disc: Vec<bool> = (0..texels.len()).map(|i| n_xy_of(i).is_some()).collect();
    // From a start that is right at large scales, this takes away what is left at small ones.
    const SWEEPS: usize = 200;
    for _ in 0..if holes.is_empty() { 0 } else { SWEEPS } {
        for &i in &holes {
            let (x, y) = (i % STYLE_SIZE, i / STYLE_SIZE);
            let sides = [
                (x > 0).then(|| i - 1),
                (x + 1 < STYLE_SIZE).then_some(i + 1),
                (y > 0).then(|| i - STYLE_SIZE),
                (y + 1 < STYLE_SIZE).then_some(i + STYLE_SIZE),
            ];
            let around = || sides.iter().flatten().filter(|k| is_disc[**k]);
            let count = around().count() as f32;
            if count > 0.0 {
                filled[i] = std::array::from_fn(|c| around().map(|k| filled[*k][c]).sum::<f32>() / count);
            }
        }
    }
    filled
}

/// Holes take the mean of what there is in the smallest cell around them, interpolated between cells (pull and push).
fn coarse_to_fine(texels: &[Option<[f32; 4]>], size: usize) -> Vec<[f32; 4]> {
    if size == 1 || texels.iter().all(Option::is_some) {
        return texels.iter().map(|t| t.unwrap_or([0.0; 4])).collect();
    }
    let half = size / 2;
    let coarse: Vec<Option<[f32; 4]>> = (0..half * half)
        .map(|i| {
            let first = i / half * 2 * size + i % half * 2;
            let four = [first, first + 1, first + size, first + size + 1].map(|k| texels[k]);
            let count = four.iter().flatten().count() as f32;
            (count > 0.0).then(|| std::array::from_fn(|c| four.iter().flatten().map(|t| t[c]).sum::<f32>() / count))
        })
        .collect();
    let coarse = coarse_to_fine(&coarse, half);
    let between = |i: usize| {
        let near = i / 2;
        let far = if i.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(half - 1) };
        [(near, 0.75), (far, 0.25)]
    };
    (0..size * size)
        .map(|i| {
            texels[i].unwrap_or_else(|| {
                let mut sum = [0.0; 4];
                for (row, down) in between(i / size) {
                    for (column, across) in between(i % size) {
                        for (sum, c) in sum.iter_mut().zip(coarse[row * half + column]) {
                            *sum += down * across * c;
                        }
                    }
                }
                sum
            })
        })
        .collect()
}

/// What is done to the colors of a style of premultiplied texels, and to what lies outside the disc.
fn finish(texels: Vec<[f32; 4]>, options: &Options) -> Picture {
    let mut pixels: Vec<[f32; 4]> = texels.into_iter().map(color::straight_from_premultiplied).collect();
    let amount = options.desaturate as f32;
    for pixel in &mut pixels {
        let [r, g, b, a] = pixel.map(|c| c.clamp(0.0, 1.0));
        let gray = 0.2126 * r + 0.7152 * g + 0.0722 * b;
        let [r, g, b] = [r, g, b].map(|c| c + amount * (gray - c));
        // Beside alpha, a picture has nothing to say where it is filled.
        *pixel = [r, g, b, if options.alpha == Alpha::Fill { 1.0 } else { a }];
    }
    if options.relight {
        let gain = 1.0 / brightest(&pixels);
        for pixel in &mut pixels {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(|c| (c * gain).min(1.0));
            *pixel = [r, g, b, pixel[3]];
        }
    }
    extend_radially(&mut pixels, STYLE_SIZE);
    let center = (STYLE_SIZE as f64 - 1.0) / 2.0;
    for (i, pixel) in pixels.iter_mut().enumerate() {
        if ((i % STYLE_SIZE) as f64 - center).hypot((i / STYLE_SIZE) as f64 - center) > center + 2.0 {
            *pixel = [0.0; 4];
        }
    }
    Picture { width: STYLE_SIZE, height: STYLE_SIZE, pixels }
}

/// The largest channel of all but the brightest 1 % of the directions; 1 for a style that is black.
fn brightest(pixels: &[[f32; 4]]) -> f32 {
    let seen = |i: &usize| n_xy_of(*i).is_some() && pixels[*i][3] > 0.05;
    let mut values: Vec<f32> =
        (0..pixels.len()).filter(seen).map(|i| pixels[i][..3].iter().copied().fold(0.0, f32::max)).collect();
    values.sort_by(f32::total_cmp);
    let value = values.get((values.len() * 99 / 100).min(values.len().saturating_sub(1))).copied().unwrap_or(1.0);
    // Darker than the first code is black.
    if value > color::linear_from_srgb8(1) { value } else { 1.0 }
}

#[cfg(test)]
mod tests;
