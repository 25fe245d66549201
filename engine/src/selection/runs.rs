//! Runs of voxels along x, and which of them hang together: what islands and holes are found by. There are far fewer runs than
//! voxels.

use std::collections::HashMap;

use rayon::prelude::*;

use super::{BRICK, BRICK_VOXELS, Brick, BrickDiff, Selection, VoxelBox};
use crate::error::Result;
use crate::progress::Progress;

/// Which voxels touch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Connectivity {
    /// The 6 with a face in common.
    #[default]
    Faces,
    /// The 26 with at least a corner in common.
    Corners,
}

/// Neighboring voxels of one kind in a row of the box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    /// Of the box: its y + its height × its z.
    pub row: usize,
    /// First voxel, and the one behind the last, along x of the grid.
    pub from: usize,
    pub to: usize,
    /// What it is, as the caller tells.
    pub kind: u8,
    /// Sum of its memberships, 255 = 1.
    pub sum: u64,
}

/// The runs of a box, row by row.
#[derive(Clone, Debug)]
pub(super) struct Runs {
    pub voxels: VoxelBox,
    pub runs: Vec<Run>,
    /// Where each row begins in `runs`, and the end.
    starts: Vec<usize>,
}

impl Runs {
    /// Of voxels by their kind; those of none are in no run.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled) on request.
    pub fn of(
        selection: &Selection,
        voxels: VoxelBox,
        kind: impl Fn(u8) -> Option<u8> + Sync,
        progress: &Progress,
    ) -> Result<Self> {
        let [nx, ny, nz] = voxels.map(|[from, to]| to.saturating_sub(from));
        progress.begin("connecting", nz as u64);
        let slices: Result<Vec<Vec<Run>>> = (0..nz)
            .into_par_iter()
            .map(|z| {
                progress.advance(1)?;
                let at = voxels[2][0] + z;
                let values = selection.values([voxels[0], voxels[1], [at, at + 1]]);
                let mut runs = Vec::new();
                for (y, row) in values.chunks(nx.max(1)).enumerate() {
                    let mut from = voxels[0][0];
                    for of_kind in row.chunk_by(|a, b| kind(*a) == kind(*b)) {
                        let to = from + of_kind.len();
                        if let Some(kind) = kind(of_kind[0]) {
                            let sum = of_kind.iter().map(|v| u64::from(*v)).sum();
                            runs.push(Run { row: y + ny * z, from, to, kind, sum });
                        }
                        from = to;
                    }
                }
                Ok(runs)
            })
            .collect();
        let runs: Vec<Run> = slices?.into_iter().flatten().collect();
        let mut starts = vec![0; ny * nz + 1];
        runs.iter().for_each(|run| starts[run.row + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        Ok(Self { voxels, runs, starts })
    }

    /// y and z of a run, in the grid.
    pub fn y_z(&self, run: &Run) -> [usize; 2] {
        let height = self.voxels[1][1] - self.voxels[1][0];
        [self.voxels[1][0] + run.row % height, self.voxels[2][0] + run.row / height]
    }

    /// The runs that touch `i` in a row so many further along y and z, as positions in `runs`.
    fn touching(&self, i: usize, [dy, dz]: [isize; 2], reach: usize) -> std::ops::Range<usize> {
        let run = &self.runs[i];
        let [height, depth] = [1, 2].map(|a| self.voxels[a][1] - self.voxels[a][0]);
        let y = (run.row % height).checked_add_signed(dy).filter(|y| *y < height);
        let z = (run.row / height).checked_add_signed(dz).filter(|z| *z < depth);
        let (Some(y), Some(z)) = (y, z) else { return 0..0 };
        let row = y + height * z;
        let others = &self.runs[self.starts[row]..self.starts[row + 1]];
        let first = others.partition_point(|other| other.to + reach <= run.from);
        let last = others.partition_point(|other| other.from < run.to + reach);
        self.starts[row] + first..self.starts[row] + last.max(first)
    }

    /// All runs that touch `i`, by faces or by corners.
    pub fn neighbors(&self, i: usize, connectivity: Connectivity) -> impl Iterator<Item = usize> + '_ {
        let (rows, reach): (&[[isize; 2]], usize) = match connectivity {
            Connectivity::Faces => (&[[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1]], 0),
            Connectivity::Corners => {
                (&[[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]], 1)
            }
        };
        // In its own row, those that end where it begins.
        rows.iter()
            .flat_map(move |row| self.touching(i, *row, if *row == [0, 0] { 1 } else { reach }))
            .filter(move |j| *j != i)
    }

    /// Which component each run of `kind` belongs to, numbered from 0 in the order of their first runs, and how many there are;
    /// `NONE` for runs of other kinds.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled) on request.
    pub fn components(&self, kind: u8, connectivity: Connectivity, progress: &Progress) -> Result<(Vec<u32>, usize)> {
        let mut component = vec![NONE; self.runs.len()];
        let mut num = 0;
        let mut queue = Vec::new();
        for first in 0..self.runs.len() {
            if self.runs[first].kind != kind || component[first] != NONE {
                continue;
            }
            component[first] = num;
            queue.push(first);
            while let Some(run) = queue.pop() {
                if run % 4096 == 0 {
                    progress.check()?;
                }
                for next in self.neighbors(run, connectivity) {
                    if self.runs[next].kind == kind && component[next] == NONE {
                        component[next] = num;
                        queue.push(next);
                    }
                }
            }
            num += 1;
        }
        Ok((component, num as usize))
    }
}

/// In no component.
pub(super) const NONE: u32 = u32::MAX;

/// Bricks that are changed voxel by voxel.
#[derive(Default)]
pub(super) struct Patches(HashMap<[usize; 3], Box<[u8; BRICK_VOXELS]>>);

impl Patches {
    /// Sets the voxels `from .. to` of a row; the rest of its bricks is as in `base`.
    pub fn set_run(
        &mut self,
        base: &Selection,
        [from, to]: [usize; 2],
        [y, z]: [usize; 2],
        value: impl Fn([usize; 3]) -> u8,
    ) {
        let mut x = from;
        while x < to {
            let place = [x / BRICK, y / BRICK, z / BRICK];
            let end = to.min((place[0] + 1) * BRICK);
            let values = self.0.entry(place).or_insert_with(|| Box::new(base.brick(place).values()));
            let row = BRICK * (y % BRICK + BRICK * (z % BRICK));
            for x in x..end {
                values[row + x % BRICK] = value([x, y, z]);
            }
            x = end;
        }
    }

    /// Sets the voxels `from .. to` of a row to what they are in a selection; all others of their bricks are empty.
    pub fn copy_run(&mut self, source: &Selection, [from, to]: [usize; 2], [y, z]: [usize; 2]) {
        let mut x = from;
        while x < to {
            let place = [x / BRICK, y / BRICK, z / BRICK];
            let end = to.min((place[0] + 1) * BRICK);
            let values = self.0.entry(place).or_insert_with(|| Box::new([0; BRICK_VOXELS]));
            let row = BRICK * (y % BRICK + BRICK * (z % BRICK));
            let (first, last) = (row + x % BRICK, row + x % BRICK + end - x);
            match source.brick(place) {
                Brick::Uniform(value) => values[first..last].fill(*value),
                Brick::Voxels(brick) => values[first..last].copy_from_slice(&brick.values[first..last]),
            }
            x = end;
        }
    }

    /// Puts them in; returns what was there.
    pub fn apply(self, selection: &mut Selection) -> BrickDiff {
        let pool = selection.pool().clone();
        let bricks = self.0.into_iter().map(|(place, values)| (place, pool.brick(&values))).collect();
        selection.replace(bricks)
    }
}
