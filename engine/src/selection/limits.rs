//! What restricts brushes and shapes: values of the scan, what is visible, what hangs together.

use std::fmt;
use std::sync::Arc;

use super::Edge;
use super::Selection;
use super::range::Range;
use crate::volume::Volume;
use crate::volume::labels::same_grid;

/// Where a tool may select at all. Limits by value and by visibility take the smaller of its membership and theirs.
#[derive(Clone, Default)]
pub struct Limits {
    /// Values of a scan on the selection's grid.
    pub values: Option<ValueLimit>,
    /// Only what hangs together, by faces of voxels that are in (f ≥ ½) after the other limits, with the tool's center: the
    /// path of a brush, the center of a shape. The center may miss its structure by a voxel. A lasso has no center and ignores
    /// this.
    pub connected: bool,
    /// Whether a voxel may be selected: for a brush that paints what one sees, whether it is visible.
    pub allowed: Option<Arc<dyn Fn([usize; 3]) -> bool + Send + Sync>>,
}

/// Values from `low` to `high` of a scan.
#[derive(Clone, Debug)]
pub struct ValueLimit {
    /// On the selection's grid.
    pub scan: Arc<Volume>,
    /// Smallest data value.
    pub low: f64,
    /// Largest data value.
    pub high: f64,
    /// Of the range.
    pub edge: Edge,
}

impl fmt::Debug for Limits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { values, connected, allowed } = self;
        let values = values.as_ref().map(|v| (v.low, v.high, v.edge));
        write!(f, "Limits {{ values: {values:?}, connected: {connected}, allowed: {} }}", allowed.is_some())
    }
}

impl Limits {
    /// A clause if they are of another grid than the selection.
    ///
    /// # Errors
    /// See above.
    pub(super) fn check(&self, grid: &crate::spaces::Grid) -> Result<(), String> {
        match &self.values {
            Some(limit) if !same_grid(&limit.scan.grid, grid) => {
                Err("the scan whose values limit the tool lies on another grid than the selection".to_owned())
            }
            _ => Ok(()),
        }
    }

    /// The membership of a voxel that the tool gives `membership`, without regard to what hangs together.
    pub(super) fn of(&self, voxel: [usize; 3], membership: u8) -> u8 {
        if membership == 0 || self.allowed.as_ref().is_some_and(|is_allowed| !is_allowed(voxel)) {
            return 0;
        }
        let Some(ValueLimit { scan, low, high, edge }) = &self.values else { return membership };
        membership.min(Range { low: *low, high: *high, edge: *edge }.membership(scan, voxel))
    }

    /// Whether they restrict voxels one by one.
    pub(super) fn is_by_voxel(&self) -> bool {
        self.values.is_some() || self.allowed.is_some()
    }
}

impl Selection {
    /// Takes out what the limits do not allow, without regard to what hangs together.
    pub(super) fn limit(&mut self, limits: &Limits) {
        if limits.is_by_voxel()
            && let Some(bounds) = self.bounds()
        {
            self.change(bounds, |voxel, membership| limits.of(voxel, membership));
        }
    }
}
