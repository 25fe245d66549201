//! Accuracy settings: what a user trades for speed.

use std::f64::consts::FRAC_1_SQRT_2;

use super::lighting::MAX_LIGHTS;
use crate::error::{Error, Result};

/// Step, style look-ups and early termination of the march.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Length of a piece, in voxels along the ray (so that 1:100 voxels are sampled evenly). Where something shows, samples
    /// are [`PARTS`] times as dense.
    pub step_voxels: f64,
    /// How much a style may change between two looks at it: the most that its surface's normal turns, in radians, times the
    /// style's [`sharpness`](crate::styles::StyleImage::sharpness). Hatching needs many looks, a matte style hardly any.
    pub style_change: f64,
    /// ε_t: a ray ends when its transmittance falls below this; its color is then divided by its opacity.
    pub termination: f64,
    /// How the borders of regions are found.
    pub borders: Borders,
}

/// How a place is shared out among regions (docs/rendering.md §8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Borders {
    /// By the memberships of all regions that are there: what a picture means.
    #[default]
    Exact,
    /// By the nearest voxel's label and how far the interpolated label is from it (Lindholm and Bock, "Poor Man's Rendering of
    /// Segmented Data"): each place has one look, whatever the number of regions, and borders between them become gaps.
    TwoLookUps,
}

/// Parts that a piece in which something shows is cut into: a fourth of the samples is enough to find it (`PARTS` of
/// `shaders/raycast.wgsl`).
pub const PARTS: u32 = 4;

/// Rounds of the raycaster's loops in one pass (`MAX_ROUNDS` of `shaders/raycast.wgsl`).
pub const MAX_ROUNDS: u32 = 65_000;

/// Rounds that a look takes: its own, one for each light of an object that is lit or two styles and, where styles carry patterns, those
/// of the curvature (4) and of two patterns with four groups of lines and two octaves of dots each.
pub const fn rounds_per_look(is_lit: bool, has_patterns: bool) -> u32 {
    1 + if is_lit || has_patterns { MAX_LIGHTS as u32 } else { 2 } + if has_patterns { 4 + 2 * (1 + 4 + 2) } else { 0 }
}

/// Rounds that a piece takes at most with one look a part (`ROUNDS_PER_PIECE` of `shaders/lib/looks.wgsl`), each of which takes
/// `per_look`.
pub const fn rounds_per_piece(per_look: u32) -> u32 {
    7 + (1 + per_look) * PARTS
}

impl Quality {
    /// Two voxels a step: for a look.
    pub const DRAFT: Self = Self::balanced_at(2.0, FRAC_1_SQRT_2);
    /// Half a voxel a step.
    pub const STANDARD: Self = Self::balanced_at(0.5, 0.5 * FRAC_1_SQRT_2);
    /// A quarter of a voxel a step: for print.
    pub const FINAL: Self = Self::balanced_at(0.25, 0.25);

    /// The balanced setting of a step: the other two cost about as much accuracy as the step does, on the Pareto front of
    /// the shipped templates. The named qualities are of this kind.
    pub fn balanced(step_voxels: f64) -> Self {
        Self::balanced_at(step_voxels, 0.5 * step_voxels.sqrt())
    }

    const fn balanced_at(step_voxels: f64, style_change: f64) -> Self {
        Self { step_voxels, style_change, termination: step_voxels / 1024.0, borders: Borders::Exact }
    }

    /// How many pieces one pass of the raycaster may walk: software adapters end a shader's loops silently after 65 535
    /// rounds, summed over the nest. A piece takes [`rounds_per_piece`] with one look at the style a part; half of the rounds
    /// are left for more looks.
    pub fn pieces_per_pass(per_look: u32) -> u32 {
        MAX_ROUNDS / 2 / rounds_per_piece(per_look)
    }

    pub(crate) fn validate(&self) -> Result<()> {
        let step = self.step_voxels;
        // Below 1/1024 voxel a ray through 4096 voxels has more samples than f32 can number.
        if !(step.is_finite() && (1.0 / 1024.0..=64.0).contains(&step)) {
            return Err(Error::scene(format!("the step is {step} voxels"), "choose one between 1/1024 and 64 voxels"));
        }
        if !(1e-3..=100.0).contains(&self.style_change) {
            return Err(Error::scene(
                format!("styles would change by {} between two looks", self.style_change),
                "choose a number from 0.001 to 100",
            ));
        }
        if !(0.0..1.0).contains(&self.termination) {
            return Err(Error::scene(
                format!("rays would end at a transmittance of {}", self.termination),
                "choose a number from 0 up to, not including, 1",
            ));
        }
        Ok(())
    }
}
