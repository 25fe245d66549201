//! Sloan's way for what is no ball: pairs of a pixel and the normal that the surface has there.
//!
//! The colors of the pairs are interpolated over the hemisphere by radial functions: c(n) = c₀ + Σ wᵢ·‖n − nᵢ‖ with Σ wᵢ = 0, ‖·‖
//! the chord between unit normals. The system has one solution for any distinct normals, the function goes through all pairs
//! and needs no triangles, which would leave the rim open. It is clamped to the range of the pairs' colors.

use rayon::prelude::*;

use super::super::STYLE_SIZE;
use super::{Alpha, Extracted, Options, check, finish, n_xy_of};
use crate::color;
use crate::error::{Error, Result};
use crate::image_out::Picture;

/// Colors of one normal that differ by more than this, in 8-bit sRGB codes of a channel, contradict each other.
pub const CONTRADICTION_CODES: f64 = 32.0;
/// Normals nearer than this (a chord; 1.4°) are one.
const SAME_NORMAL: f64 = 1.0 / 40.0;
/// Directions further than this (a chord; 20°) from every pair are counted as filled.
const FAR: f64 = 0.35;
/// Solving takes the cube of this.
const MOST_SITES: usize = 700;
/// Fewer pairs say nothing of a shading.
const MIN_PAIRS: usize = 3;

/// What somebody knows of a picture: at this pixel, the surface has this normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalPair {
    /// (x, y) in pixels.
    pub pixel: [f64; 2],
    /// (right, up) components of the unit normal towards the viewer, |n_xy| ≤ 1.
    pub n_xy: [f64; 2],
}

/// Two pairs of one normal, with different colors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contradiction {
    /// Their indices among the pairs.
    pub pairs: [usize; 2],
    /// By how much they differ, in 8-bit sRGB codes of the channel that differs most.
    pub codes: f64,
}

/// A normal with the mean color of its pairs.
struct Site {
    normal: [f64; 3],
    first: usize,
    sum: [f64; 4],
    count: f64,
    color: [f64; 4],
}

/// The style that goes through `pairs` in `picture` (straight linear RGBA). A pair's color is the mean of the pixels within
/// 1.5 pixels (a tent). Normals within 1.4° are one, with the mean color; those of more than 700 are merged further.
///
/// # Errors
/// [`Error::Scene`] for a pair (by its number, from 1) off the picture, on a transparent pixel, with numbers that are not finite or
/// |n_xy| > 1, and for fewer than 3 different normals.
pub fn extract_normals(picture: &Picture, pairs: &[NormalPair], options: &Options) -> Result<Extracted> {
    check(options)?;
    let mut colors = Vec::with_capacity(pairs.len());
    for (i, pair) in pairs.iter().enumerate() {
        colors.push((normal_of(pair, i + 1)?, color_at(picture, pair.pixel, i + 1, options.alpha)?));
    }
    let mut distance = SAME_NORMAL;
    let (sites, contradictions) = loop {
        let merged = merge(&colors, distance);
        if merged.0.len() <= MOST_SITES {
            break merged;
        }
        distance *= 1.25;
    };
    if sites.len() < MIN_PAIRS {
        return Err(Error::scene(
            format!("{} different normals are too few for a style", sites.len()),
            format!("give at least {MIN_PAIRS}, better some twenty, from the middle to the rim"),
        ));
    }
    let weights = solve(&sites);
    let range = |pick: fn(f64, f64) -> f64| {
        sites.iter().map(|s| s.color).reduce(|a, b| std::array::from_fn(|c| pick(a[c], b[c]))).unwrap_or([0.0; 4])
    };
    let (least, most) = (range(f64::min), range(f64::max));
    let texels: Vec<([f32; 4], Option<bool>)> = (0..STYLE_SIZE * STYLE_SIZE)
        .into_par_iter()
        .map(|i| {
            let Some(n_xy) = n_xy_of(i) else { return ([0.0; 4], None) };
            let normal = unit(n_xy);
            let mut sum = weights[sites.len()];
            let mut nearest = f64::INFINITY;
            for (site, weight) in sites.iter().zip(&weights) {
                let distance = chord(normal, site.normal);
                nearest = nearest.min(distance);
                sum = std::array::from_fn(|c| sum[c] + weight[c] * distance);
            }
            let texel = std::array::from_fn(|c| sum[c].clamp(least[c], most[c]) as f32);
            (texel, Some(nearest > FAR))
        })
        .collect();
    let num_texels = texels.iter().filter(|(_, far)| far.is_some()).count();
    let num_far = texels.iter().filter(|(_, far)| *far == Some(true)).count();
    let picture = finish(texels.into_iter().map(|(texel, _)| texel).collect(), options);
    Ok(Extracted { picture, filled: num_far as f64 / num_texels as f64, contradictions })
}

fn unit([x, y]: [f64; 2]) -> [f64; 3] {
    [x, y, (1.0 - x * x - y * y).max(0.0).sqrt()]
}

fn chord(a: [f64; 3], b: [f64; 3]) -> f64 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    (x * x + y * y + z * z).sqrt()
}

fn normal_of(pair: &NormalPair, number: usize) -> Result<[f64; 3]> {
    let length = pair.n_xy[0].hypot(pair.n_xy[1]);
    // A hand's rounding is no fault.
    if length.is_nan() || length > 1.001 {
        return Err(Error::scene(
            format!("pair {number} has the normal ({}, {}), which no surface has", pair.n_xy[0], pair.n_xy[1]),
            "give its components to the right and up: in the middle of a ball 0, 0, at its rim of length 1",
        ));
    }
    Ok(unit(pair.n_xy.map(|n| n / length.max(1.0))))
}

/// The premultiplied color around a place.
fn color_at(picture: &Picture, [x, y]: [f64; 2], number: usize, alpha: Alpha) -> Result<[f64; 4]> {
    const RADIUS: f64 = 1.5;
    let (width, height) = (picture.width, picture.height);
    if !(0.0..width as f64).contains(&x) || !(0.0..height as f64).contains(&y) {
        return Err(Error::scene(
            format!("pair {number} lies at ({x}, {y}), off the picture of {width} × {height} pixels"),
            "give its place in pixels, x from the left, y from the top",
        ));
    }
    let near = |v: f64, end: usize| (v - RADIUS).max(0.0) as usize..((v + RADIUS).ceil() as usize).min(end);
    let (mut sum, mut weights) = ([0.0; 4], 0.0);
    for row in near(y, height) {
        for column in near(x, width) {
            let tent = |i: usize, v: f64| (1.0 - (i as f64 + 0.5 - v).abs() / RADIUS).max(0.0);
            let weight = tent(row, y) * tent(column, x);
            let pixel = color::premultiplied_from_straight(picture.pixels[row * width + column]).map(f64::from);
            sum = std::array::from_fn(|c| sum[c] + weight * pixel[c]);
            weights += weight * if alpha == Alpha::Fill { pixel[3] } else { 1.0 };
        }
    }
    if weights < 1e-3 {
        return Err(Error::scene(
            format!("pair {number} lies on a transparent part of the picture"),
            "move it, or keep the picture's transparency",
        ));
    }
    Ok(sum.map(|c| c / weights))
}

/// Pairs whose normals are nearer than `distance` to the first of a site join it.
fn merge(colors: &[([f64; 3], [f64; 4])], distance: f64) -> (Vec<Site>, Vec<Contradiction>) {
    let mut sites: Vec<Site> = Vec::new();
    let mut contradictions = Vec::new();
    for (i, (normal, color)) in colors.iter().enumerate() {
        let Some(site) = sites.iter_mut().find(|s| chord(s.normal, *normal) < distance) else {
            sites.push(Site { normal: *normal, first: i, sum: *color, count: 1.0, color: *color });
            continue;
        };
        let codes = difference(colors[site.first].1, *color);
        // What differs because the program merged it is none of the user's.
        if codes > CONTRADICTION_CODES && chord(site.normal, *normal) < SAME_NORMAL {
            contradictions.push(Contradiction { pairs: [site.first, i], codes });
        }
        site.count += 1.0;
        site.sum = std::array::from_fn(|c| site.sum[c] + color[c]);
        site.color = site.sum.map(|c| c / site.count);
    }
    (sites, contradictions)
}

/// How different two premultiplied colors look, in codes of the channel that differs most.
fn difference(a: [f64; 4], b: [f64; 4]) -> f64 {
    let code = |v: f64| 255.0 * color::srgb_from_linear(v.clamp(0.0, 1.0));
    let of = |c: usize| if c == 3 { 255.0 * (a[c] - b[c]).abs() } else { (code(a[c]) - code(b[c])).abs() };
    (0..4).map(of).fold(0.0, f64::max)
}

/// The weight of each site, and the constant, by elimination with pivots.
fn solve(sites: &[Site]) -> Vec<[f64; 4]> {
    let n = sites.len();
    let mut rows: Vec<Vec<f64>> = (0..=n)
        .map(|i| {
            let entry = |k: usize| match (i < n, k < n) {
                (true, true) => chord(sites[i].normal, sites[k].normal),
                (false, false) => 0.0,
                _ => 1.0,
            };
            let right = if i < n { sites[i].color } else { [0.0; 4] };
            (0..=n).map(entry).chain(right).collect()
        })
        .collect();
    for k in 0..=n {
        let pivot = (k..=n).max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs())).unwrap_or(k);
        rows.swap(k, pivot);
        let (above, below) = rows.split_at_mut(k + 1);
        let pivot = &above[k];
        below.par_iter_mut().for_each(|row| {
            let factor = row[k] / pivot[k];
            row[k..].iter_mut().zip(&pivot[k..]).for_each(|(value, p)| *value -= factor * p);
        });
    }
    let mut weights = vec![[0.0; 4]; n + 1];
    for k in (0..=n).rev() {
        weights[k] = std::array::from_fn(|c| {
            let known: f64 = (k + 1..=n).map(|j| rows[k][j] * weights[j][c]).sum();
            (rows[k][n + 1 + c] - known) / rows[k][k]
        });
    }
    weights
}
