//! "What is this?": what a pixel of a picture shows, found on the CPU with one ray and without anything that would have to
//! be prepared for it.
//!
//! The method is that of A. Wiebel, F. M. Vos, D. Foerster and H.-C. Hege, *WYSIWYP: What You See Is What You Pick* (IEEE
//! TVCG 18(12), 2012): along the ray opacity piles up, and what a viewer takes for the thing that is seen is where it jumps
//! most. Theirs cuts the ray at every minimum of its slope; here a minimum counts from a depth of one half on, as the noise
//! of a scan would else cut a thick translucent body into slices.

mod field;
mod line;

use std::ops::Range;

use glam::DVec3;

use self::line::{Line, Shown};
use crate::reference::ray::ray_from_pixel;
use crate::scene::Scene;

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Where it is seen: world (RAS), mm.
    pub position_mm: DVec3,
    /// Where it is in the volume as it was read: elsewhere, for what was moved.
    pub rest_mm: DVec3,
    /// The data value there (CT: HU).
    pub value: f64,
    /// ‖ĝ‖ there, from 0 to 1: steeper than G counts as 1, and a face of the volume as at least what it looks like.
    pub gradient: f64,
    /// How much of the pixel it is, from 0 to 1: the jump of the ray's opacity.
    pub opacity: f64,
    /// Row of the transfer function that is seen there; 0, where it is 1-D.
    pub row: usize,
    /// Node coordinate in that row: i + w is w of the way from node i to node i + 1.
    pub node: f64,
    /// The region of the object that shows most of the jump; none: what belongs to no region.
    pub region: Option<usize>,
    /// Whether it is the ghost of that region: the place that it left.
    pub is_ghost: bool,
}

/// A jump below this is nothing that a viewer could mean.
const LEAST_OPACITY: f64 = 0.01;
/// A ray whose transmittance is below this holds no jump worth picking.
const SPENT: f64 = 0.1 * LEAST_OPACITY;
/// Up to this share of the slope before and behind it, a minimum parts two things.
const DIP: f64 = 0.5;

/// What pixel (column `x`, row `y` from the top left) of a picture of `image_size` (width, height) pixels shows of the
/// scene's first object; `None` where it shows nothing or is not in the picture, and for a scene that
/// [`Scene::validate`] refuses.
///
/// Regions count as in pictures (docs/rendering.md §8): with their shares of each place, so that a hidden one is looked through.
/// Of a jump that several of them make, the answer is about the one that shows most of it. What was moved is met where it is drawn,
/// and its ghost where it was (§9); where they overlap, opacities are those of eqs. 2.4 and 2.5, meetings being left out.
///
/// It reads the voxels near the ray only. Opacities are those of the picture, both ends of a piece and the style's own
/// included; normals are of data smoothed by σ_g, by quadrature at the place itself. G (and, beside wide gaps, the range of the data) comes from the volume,
/// which finds it once; a volume that was drawn has it.
pub fn pick(scene: &Scene, image_size: [u32; 2], x: u32, y: u32) -> Option<Pick> {
    let object = scene.objects.first()?;
    if x >= image_size[0] || y >= image_size[1] || scene.validate().is_err() {
        return None;
    }
    let line = Line::new(scene, object, image_size[1], ray_from_pixel(&scene.camera, image_size, x, y));
    let seen = line.march();
    let opacities: Vec<f64> = seen.iter().map(|s| s.opacity).collect();
    let jump = largest_jump(&opacities);
    let opacity: f64 = opacities[jump.clone()].iter().sum();
    if opacity < LEAST_OPACITY {
        return None;
    }
    let shown: Vec<&Shown> = seen[jump].iter().flat_map(|s| &s.shown).collect();
    let whose = most_shown(&shown)?;
    let best = shown.iter().filter(|s| (s.part, s.region) == whose).max_by(|a, b| a.opacity.total_cmp(&b.opacity))?;
    Some(Pick {
        position_mm: line.ray.origin_mm + best.t * line.ray.direction,
        rest_mm: line.rest_mm(best),
        value: line.value(best),
        gradient: line.steepness(best).min(1.0),
        opacity,
        row: best.row,
        node: best.node,
        region: best.region,
        is_ghost: line.is_ghost(best),
    })
}

/// Which part of the object, and which region in it, shows most of a stretch, in all; none of nothing.
fn most_shown(shown: &[&Shown]) -> Option<(usize, Option<usize>)> {
    let mut sums: Vec<((usize, Option<usize>), f64)> = Vec::new();
    for part in shown {
        let whose = (part.part, part.region);
        match sums.iter_mut().find(|(known, _)| *known == whose) {
            Some((_, sum)) => *sum += part.opacity,
            None => sums.push((whose, part.opacity)),
        }
    }
    sums.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(whose, _)| whose)
}

/// The stretch of a ray over which its opacity rises most, in a row of what each piece adds to it. Stretches are parted at
/// the minima that are at most [`DIP`] of the largest before and of what follows.
fn largest_jump(opacities: &[f64]) -> Range<usize> {
    let (mut best, mut best_sum) = (0..0, 0.0);
    let mut close = |stretch: Range<usize>| {
        let sum: f64 = opacities[stretch.clone()].iter().sum();
        if sum > best_sum {
            (best, best_sum) = (stretch, sum);
        }
    };
    // The present stretch: its first piece, its largest, and the smallest since then.
    let (mut first, mut peak, mut valley) = (0, 0.0, 0);
    for (i, &opacity) in opacities.iter().enumerate() {
        let low = opacities[valley];
        if low <= DIP * peak && low < DIP * opacity {
            close(first..valley);
            (first, peak, valley) = (valley, opacity, i);
        } else if opacity >= peak {
            (peak, valley) = (opacity, i);
        } else if opacity < low {
            valley = i;
        }
    }
    close(first..opacities.len());
    best
}

#[cfg(test)]
mod tests;
