//! Islands: the parts of a selection that do not touch.

use std::collections::VecDeque;

use glam::DVec3;

use crate::error::Result;
use crate::progress::Progress;
use crate::selection::fill::voxels_around;
use crate::selection::runs::{NONE, Patches, Runs};
use crate::selection::{BrickDiff, Combination, Connectivity, IN, Selection};

/// Kinds of runs.
const CORE: u8 = 0;
const FRINGE: u8 = 1;

/// The islands of a selection, by size: components of the voxels that are in (f ≥ ½), each with the soft voxels around it. A
/// soft voxel goes with the island that is nearest, counted in runs of voxels; soft voxels that lead to no island belong to none.
#[derive(Clone, Debug)]
pub struct Islands {
    selection: Selection,
    runs: Runs,
    /// Of each run, its island.
    island: Vec<u32>,
    /// Sum of memberships per island, 255 = 1; falling.
    sums: Vec<u64>,
}

impl Islands {
    /// Finds them.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled) on request.
    pub fn of(selection: &Selection, connectivity: Connectivity, progress: &Progress) -> Result<Self> {
        let kind = |f: u8| match f {
            0 => None,
            IN.. => Some(CORE),
            _ => Some(FRINGE),
        };
        let runs = Runs::of(selection, selection.bounds().unwrap_or_default(), kind, progress)?;
        let (mut island, num) = runs.components(CORE, connectivity, progress)?;
        let mut queue: VecDeque<usize> = (0..island.len()).filter(|i| island[*i] != NONE).collect();
        while let Some(run) = queue.pop_front() {
            for next in runs.neighbors(run, Connectivity::Corners) {
                if island[next] == NONE {
                    island[next] = island[run];
                    queue.push_back(next);
                }
            }
        }
        let mut sums = vec![0; num];
        for (run, island) in runs.runs.iter().zip(&island).filter(|(_, island)| **island != NONE) {
            sums[*island as usize] += run.sum;
        }
        // Stable: of equal islands the first in the grid comes first.
        let mut order: Vec<u32> = (0..num as u32).collect();
        order.sort_by_key(|i| std::cmp::Reverse(sums[*i as usize]));
        let mut rank = vec![0; num];
        order.iter().zip(0..).for_each(|(island, position)| rank[*island as usize] = position);
        island.iter_mut().filter(|i| **i != NONE).for_each(|i| *i = rank[*i as usize]);
        let sums = order.iter().map(|i| sums[*i as usize]).collect();
        Ok(Self { selection: selection.clone(), runs, island, sums })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.sums.is_empty()
    }

    /// Their volumes in ml, the largest first.
    pub fn volumes_ml(&self) -> Vec<f64> {
        let voxel_ml = self.selection.grid().world_from_index().matrix3.determinant().abs() * 1e-3;
        self.sums.iter().map(|sum| *sum as f64 / 255.0 * voxel_ml).collect()
    }

    /// Which island a voxel belongs to.
    pub fn at(&self, [x, y, z]: [usize; 3]) -> Option<usize> {
        let voxels = self.runs.voxels;
        let is_inside = [x, y, z].iter().zip(&voxels).all(|(n, [from, to])| (from..to).contains(&n));
        let row = is_inside.then(|| y - voxels[1][0] + (voxels[1][1] - voxels[1][0]) * (z - voxels[2][0]))?;
        let i = self.runs.runs.partition_point(|run| (run.row, run.to) <= (row, x));
        let run = self.runs.runs.get(i).filter(|run| run.row == row && run.from <= x)?;
        debug_assert!(x < run.to, "the runs are in order");
        Some(self.island[i]).filter(|island| *island != NONE).map(|island| island as usize)
    }

    /// The selection with only those islands of which `keep` says so, by their numbers.
    pub fn kept(&self, keep: impl Fn(usize) -> bool) -> Selection {
        let mut kept = Selection::empty(*self.selection.grid(), self.selection.pool());
        let mut patches = Patches::default();
        for (run, _) in self.runs.runs.iter().zip(&self.island).filter(|(_, i)| **i != NONE && keep(**i as usize)) {
            patches.copy_run(&self.selection, [run.from, run.to], self.runs.y_z(run));
        }
        patches.apply(&mut kept);
        kept
    }

    /// Each of the first `most` as a selection of its own.
    pub fn split(&self, most: usize) -> Vec<Selection> {
        (0..self.len().min(most)).map(|island| self.kept(|i| i == island)).collect()
    }
}

impl Selection {
    /// Keeps the `most` largest islands. Returns what the bricks were before.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled) on request.
    pub fn keep_largest(&mut self, most: usize, connectivity: Connectivity, progress: &Progress) -> Result<BrickDiff> {
        let kept = Islands::of(self, connectivity, progress)?.kept(|island| island < most);
        Ok(self.take_over(&kept))
    }

    /// Takes islands of less than `volume_ml` out. Returns what the bricks were before.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled) on request.
    pub fn remove_smaller(
        &mut self,
        volume_ml: f64,
        connectivity: Connectivity,
        progress: &Progress,
    ) -> Result<BrickDiff> {
        let islands = Islands::of(self, connectivity, progress)?;
        let volumes = islands.volumes_ml();
        let kept = islands.kept(|island| volumes[island] >= volume_ml);
        Ok(self.take_over(&kept))
    }

    /// Keeps the islands within a voxel of a place, in voxel indices.
    pub(in crate::selection) fn keep_connected_to(&mut self, at: DVec3, progress: &Progress) -> Result<BrickDiff> {
        let islands = Islands::of(self, Connectivity::Faces, progress)?;
        let is_in = |voxel: &[usize; 3]| self.get(*voxel) >= IN;
        let wanted: Vec<usize> =
            voxels_around(at, self.grid().dims()).filter(is_in).filter_map(|voxel| islands.at(voxel)).collect();
        let kept = islands.kept(|island| wanted.contains(&island));
        Ok(self.take_over(&kept))
    }

    /// Becomes a selection of the same grid.
    pub(in crate::selection) fn take_over(&mut self, other: &Self) -> BrickDiff {
        // The grids are the same.
        self.combine(other, Combination::Replace).unwrap_or_default()
    }
}
