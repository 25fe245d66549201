//! Patterns: strokes of ink on paper that stand for the tone of a style's sphere (docs/rendering.md §4, "Patterns"). They lie in the
//! volume at rest, so that they stay on what is drawn; only how densely they are drawn follows the page.

use glam::DVec3;

use crate::error::{Error, Result};

/// What a style draws its tone with.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    /// Lines or dots.
    pub strokes: Strokes,
    /// Distance of neighboring strokes on the page, in figure points (1/72 inch): above 0. Strokes have fixed places, so that it is met
    /// within half as much and twice as much.
    pub spacing_pt: f64,
    /// Color of strokes, linear RGB.
    pub ink: [f32; 3],
    /// Color between them, linear RGB; brighter than the ink.
    pub paper: [f32; 3],
    /// What there is of the sphere's own opacity between strokes, 0 to 1.
    pub paper_opacity: f64,
}

/// What ink is put on paper with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Strokes {
    /// Lines whose width is the tone: planes, cut by the surface.
    Hatching {
        /// Which planes.
        direction: Direction,
        /// How many ways lines cross each other where it is dark: 1 (never) to 3.
        layers: u32,
    },
    /// Dots whose size and number are the tone.
    Stipple,
}

/// Which way lines run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Direction {
    /// Along sections across an axis of the world (the volume at rest): any vector but 0.
    Axis(DVec3),
    /// Across the light: the object's first one, or the direction in which the sphere is brightest.
    Light,
    /// Around what is curved, where the surface bends most: as rings around a tube.
    Around,
    /// Along what is curved, where the surface bends least: as the grain of a trunk.
    Along,
}

/// The widest spacing of strokes, in points: two inches.
pub const MAX_SPACING_PT: f64 = 144.0;

/// Rec. 709 luminance.
pub(crate) fn luminance(color: [f32; 3]) -> f64 {
    let [r, g, b] = color.map(f64::from);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

impl Pattern {
    /// Lines or dots of black ink on white paper, so many points apart.
    pub fn new(strokes: Strokes, spacing_pt: f64) -> Self {
        Self { strokes, spacing_pt, ink: [0.0; 3], paper: [1.0; 3], paper_opacity: 1.0 }
    }

    /// Whether the curvature of surfaces matters.
    pub fn follows_curvature(&self) -> bool {
        matches!(self.strokes, Strokes::Hatching { direction: Direction::Around | Direction::Along, .. })
    }

    /// Axes that sections are across: unit vectors, orthogonal, the first that of [`Direction::Axis`].
    pub fn axes(&self) -> [DVec3; 3] {
        let first = match self.strokes {
            Strokes::Hatching { direction: Direction::Axis(axis), .. } => axis.normalize(),
            _ => return DVec3::AXES,
        };
        // The second is upright where it can be.
        let up = if first.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
        let second = (up - up.dot(first) * first).normalize();
        [first, second, first.cross(second)]
    }

    /// Checks what types cannot. `name`: of the style.
    ///
    /// # Errors
    /// [`Error::Scene`] with the first fault.
    pub fn validate(&self, name: &str) -> Result<()> {
        let fail = |what: String, remedy: &str| {
            Err(Error::scene(format!("the pattern of the style \"{name}\" {what}"), remedy))
        };
        if !(self.spacing_pt > 0.0 && self.spacing_pt <= MAX_SPACING_PT) {
            let what = format!("has a spacing of {} points", self.spacing_pt);
            return fail(what, "give a spacing above 0 and up to 144 points");
        }
        if !(0.0..=1.0).contains(&self.paper_opacity) {
            return fail(format!("has a paper of opacity {}", self.paper_opacity), "give an opacity from 0 to 1");
        }
        if [self.ink, self.paper].iter().flatten().any(|c| !(0.0..=1.0).contains(c)) {
            return fail("has a color outside of 0 to 1".into(), "give colors as \"#rrggbb\"");
        }
        if luminance(self.paper) - luminance(self.ink) < 0.01 {
            return fail("has paper that is not brighter than its ink".into(), "give a darker ink or a brighter paper");
        }
        match self.strokes {
            Strokes::Hatching { layers, .. } if !(1..=3).contains(&layers) => {
                fail(format!("crosses lines {layers} ways"), "give 1, 2 or 3 layers")
            }
            Strokes::Hatching { direction: Direction::Axis(axis), .. }
                if !(axis.is_finite() && axis.length() > 1e-9) =>
            {
                fail("has sections across no axis".into(), "give an axis other than 0, 0, 0")
            }
            _ => Ok(()),
        }
    }
}

/// How far to either side of a place normals are compared for the curvature of a surface, in voxels of the smallest spacing.
pub const CURVATURE_VOXELS: f64 = 3.0;
