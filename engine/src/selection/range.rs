//! Selections by the scan's values: all voxels from a lower to an upper bound.

use std::sync::Arc;

use super::fill::{Filling, filled, places, quantized, voxels_of};
use super::{BrickPool, Selection};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::{Volume, Voxels};

/// What becomes of voxels next to a bound of a range of values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Edge {
    /// A voxel is in or out. Its surface has stairs.
    Crisp,
    /// Partly in, as a voxel is that the surface of equal values cuts: f = ½ + (value − bound) / g, from 0 to 1, g being the
    /// norm of the values' differences across a voxel (central ones; one-sided at the faces and beside gaps). For values that
    /// are linear around the voxel that is its part beyond the surface; where no neighbor by a face lies on the other side of
    /// a bound it is the crisp selection, and f ≥ ½ always is.
    #[default]
    PartialVolume,
    /// f rises from 0 to 1 over this many units of the values, ½ at the bound.
    Linear(f64),
}

/// Memberships by value.
#[derive(Clone, Debug)]
pub(super) struct Range {
    pub low: f64,
    pub high: f64,
    pub edge: Edge,
}

impl Range {
    /// The membership of a voxel; 0 where the value is no number.
    pub fn membership(&self, scan: &Volume, voxel: [usize; 3]) -> u8 {
        let [x, y, z] = voxel;
        let value = scan.value(x, y, z);
        if !value.is_finite() {
            return 0;
        }
        // The bound that is nearer decides; the other one lies on the side where f is larger.
        let inside = self.inside(value);
        let width = match self.edge {
            Edge::Crisp => 0.0,
            Edge::Linear(width) => width,
            Edge::PartialVolume => self.width(scan, voxel, value),
        };
        if width > 0.0 { quantized(0.5 + inside / width) } else { quantized(f64::from(u8::from(inside >= 0.0))) }
    }

    /// How far a value lies in the range; below 0 outside.
    fn inside(&self, value: f64) -> f64 {
        (value - self.low).min(self.high - value)
    }

    /// Norm of the differences of the values per voxel along x, y, z, where the surface passes between the voxel and one of its
    /// six neighbors; else 0: along the skin, values rise steeply and yet never reach those of bone.
    fn width(&self, scan: &Volume, voxel: [usize; 3], value: f64) -> f64 {
        let dims = scan.grid.dims();
        let is_in = self.inside(value) >= 0.0;
        let mut is_cut = false;
        let mut at = |a: usize, n: usize| {
            let mut other = voxel;
            other[a] = n;
            let value = scan.value(other[0], other[1], other[2]);
            is_cut |= value.is_finite() && (self.inside(value) >= 0.0) != is_in;
            value.is_finite().then_some(value)
        };
        let mut squared = 0.0;
        for a in 0..3 {
            let before = voxel[a].checked_sub(1).and_then(|n| at(a, n));
            let after = Some(voxel[a] + 1).filter(|n| *n < dims[a]).and_then(|n| at(a, n));
            let difference: f64 = match (before, after) {
                (Some(before), Some(after)) => 0.5 * (after - before),
                (Some(one), None) | (None, Some(one)) => value - one,
                (None, None) => 0.0,
            };
            squared += difference * difference;
        }
        if is_cut { squared.sqrt() } else { 0.0 }
    }

    /// How far from a bound a value may be and yet be partly in, in a brick whose values, border included, span `span`.
    fn reach(&self, span: f64) -> f64 {
        match self.edge {
            Edge::Crisp => 0.0,
            Edge::Linear(width) => 0.5 * width,
            // Three differences of at most the span, and f = 0 at half their norm.
            Edge::PartialVolume => 0.5 * 3_f64.sqrt() * span,
        }
    }
}

/// The voxels of a scan whose data values lie from `low` to `high` (either may be infinite; none if low > high), on its grid.
/// Voxels without a number are in no range. Bricks that lie wholly in or out cost a look at their smallest and largest value.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled) on request.
pub fn select_range(
    scan: &Volume,
    [low, high]: [f64; 2],
    edge: Edge,
    pool: &Arc<BrickPool>,
    progress: &Progress,
) -> Result<Selection> {
    let range = Range { low, high, edge };
    let dims = scan.grid.dims();
    let places = if low <= high { places(dims.map(|n| [0, n])) } else { Vec::new() };
    let bricks = scan.bricks();
    let has_gaps = matches!(scan.voxels, Voxels::F32(_) | Voxels::F64(_));
    progress.begin("selecting", places.len() as u64);
    filled(scan.grid, pool, places, progress, |place| {
        let [nx, ny, _] = bricks.dims;
        let (a, b) = bricks.ranges[place[0] + nx * (place[1] + ny * place[2])];
        let (a, b) = (scan.rescale.value(a), scan.rescale.value(b));
        let (smallest, largest) = (a.min(b), a.max(b));
        let reach = range.reach(largest - smallest);
        if largest + reach < low || smallest - reach > high {
            Filling::Uniform(0)
        } else if smallest - reach > low && largest + reach < high && !has_gaps {
            Filling::Uniform(255)
        } else {
            Filling::Voxels(voxels_of(place, dims, |voxel| range.membership(scan, voxel)))
        }
    })
}
