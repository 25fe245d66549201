//! Regions (docs/rendering.md §8): how a place is shared out among a volume's regions and its background, and the faces that
//! appear where what shows ends because a region does.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::sample::{Lattice, sample_volume};
use super::style::Face;
use crate::scene::{self, Axis, Region, StyleTransferFunction};

/// ‖ĝ‖ up to which the end of a region makes a face, and from which on the data's own surface does.
const NO_MATERIAL_EDGE: f64 = 0.025;
const MATERIAL_EDGE: f64 = 0.05;
/// Change over a voxel, as a share of what shows, from which on the end of a region is a face and no transition.
const SHARP_END: f64 = 0.25;

/// What looks alike: the background (index 0) or a region.
#[derive(Clone, Debug)]
pub struct Look<'a> {
    /// f per voxel; none for the background, which has what is left.
    pub membership: Option<Arc<Lattice>>,
    /// Value, and a second coordinate, → style and opacity.
    pub transfer_function: &'a StyleTransferFunction,
    /// Its rows, each by itself: but one, where it has no second coordinate.
    pub rows: Arc<Vec<StyleTransferFunction>>,
    /// Takes the place of the styles' colors.
    pub tint: Option<DVec3>,
    /// Factor of opacity.
    pub opacity: f64,
}

impl<'a> Look<'a> {
    /// Of what belongs to no region.
    pub fn background(transfer_function: &'a StyleTransferFunction) -> Self {
        let rows = Arc::new(transfer_function.rows().collect());
        Self { membership: None, transfer_function, rows, tint: None, opacity: 1.0 }
    }

    /// f of a region, voxel by voxel.
    pub fn memberships(region: &Region) -> Lattice {
        let dims = region.selection.grid().dims();
        let [nx, ny, _] = dims;
        let voxel = |i: usize| f64::from(region.selection.get([i % nx, i / nx % ny, i / (nx * ny)])) / 255.0;
        Lattice { dims, values: (0..dims.iter().product()).map(voxel).collect() }
    }

    /// Of a region with these memberships.
    pub fn region(look: &'a scene::Look, membership: Arc<Lattice>) -> Self {
        Self {
            membership: Some(membership),
            transfer_function: &look.transfer_function,
            rows: Arc::new(look.transfer_function.rows().collect()),
            tint: look.tint.map(|tint| DVec3::from_array(tint.map(f64::from))),
            opacity: look.opacity,
        }
    }

    /// The rows that share out a place, and their shares, each above 0. `edge` = ‖ĝ‖ there, `distance` gives that of a field in mm.
    pub fn rows_at(&self, edge: f64, distance: impl Fn(usize) -> f64) -> Vec<(usize, f64)> {
        let Some(across) = &self.transfer_function.across else { return vec![(0, 1.0)] };
        let place = match across.axis {
            Axis::Edge => edge.min(1.0),
            Axis::Distance(field) => distance(field),
            Axis::Even(place) => place,
        };
        // Hats: each row's share falls to 0 at its neighbors, and goes on beyond the outermost.
        let at: Vec<f64> = across.places().collect();
        let share = |row: usize| {
            let from_below = if row == 0 { 1.0 } else { (place - at[row - 1]) / (at[row] - at[row - 1]) };
            let from_above = at.get(row + 1).map_or(1.0, |next| (next - place) / (next - at[row]));
            from_below.min(from_above).clamp(0.0, 1.0)
        };
        (0..at.len()).map(|row| (row, share(row))).filter(|(_, share)| *share > 0.0).collect()
    }
}

/// w: how much of index position `p` each look has. They sum up to 1: regions that want more than there is share it in
/// proportion, and the background has what they leave.
pub fn shares(looks: &[Look<'_>], p: DVec3) -> Vec<f64> {
    let mut shares: Vec<f64> =
        looks.iter().map(|look| look.membership.as_ref().map_or(0.0, |f| sample_volume(f, p))).collect();
    let wanted: f64 = shares.iter().sum();
    shares.iter_mut().for_each(|f| *f /= wanted.max(1.0));
    shares[0] = (1.0 - wanted).max(0.0);
    shares
}

/// The face at `p` of what shows, where it ends with a region rather than by its own values. `opacities` = how much of each
/// look shows here, `to_world` = M⁻ᵀ.
pub fn cut_face(looks: &[Look<'_>], p: DVec3, opacities: &[f64], to_world: DMat3) -> Face {
    end_face(|p| shares(looks, p).iter().zip(opacities).map(|(w, a)| w * a).sum(), p, to_world)
}

/// As [`cut_face`], of U = `shown` as a function of the index position.
pub fn end_face(shown: impl Fn(DVec3) -> f64, p: DVec3, to_world: DMat3) -> Face {
    let (mut change, mut most) = (DVec3::ZERO, 0.0f64);
    for (axis, e) in DVec3::AXES.into_iter().enumerate() {
        let (before, behind) = (shown(p - 0.5 * e), shown(p + 0.5 * e));
        change[axis] = behind - before;
        most = most.max(before).max(behind);
    }
    let ends = if most > 0.0 { smoothstep(0.0, SHARP_END, change.length() / most) } else { 0.0 };
    Face { normal: -(to_world * change).normalize_or_zero(), weight: ends }
}

/// The face of regions as far as the data have no surface of their own, whose ‖ĝ‖ is `steepness`.
pub fn where_flat(cut: Face, steepness: f64) -> Face {
    Face { weight: cut.weight * (1.0 - smoothstep(NO_MATERIAL_EDGE, MATERIAL_EDGE, steepness)), ..cut }
}

/// Two faces at one place: their normals by their weights, so that nothing jumps where one of them begins.
pub fn joined(a: Face, b: Face) -> Face {
    let normal = (a.weight * a.normal + b.weight * b.normal).normalize_or_zero();
    Face { normal, weight: a.weight.max(b.weight) }
}

/// From 0 to 1 as `x` goes from `from` to `to`.
pub fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let x = ((x - from) / (to - from)).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
