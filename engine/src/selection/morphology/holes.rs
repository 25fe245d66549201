//! Holes: what a selection encloses.

use rayon::prelude::*;

use crate::error::Result;
use crate::progress::Progress;
use crate::selection::runs::{Patches, Runs};
use crate::selection::{BrickDiff, Connectivity, IN, Selection, VoxelBox};

/// What counts as enclosed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Holes {
    /// What cannot be reached from the faces of the grid, going from face to face of voxels that are out (f < ½).
    #[default]
    InSpace,
    /// The same within every slice across an axis of the grid (0 to 2): also fills what is a tube in space.
    InSlices(usize),
}

/// Voxels of a row, with its y and z.
type Span = ([usize; 2], [usize; 2]);

impl Selection {
    /// Selects what is enclosed, and the soft inner side of what encloses it. Returns what the bricks were before. Looks at the
    /// voxels of the selection's bounds.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled) on request.
    pub fn fill_holes(&mut self, holes: Holes, progress: &Progress) -> Result<BrickDiff> {
        let Some(bounds) = self.bounds() else { return Ok(BrickDiff::default()) };
        let spans = match holes {
            Holes::InSpace => in_space(self, bounds, progress)?,
            Holes::InSlices(axis) => in_slices(self, bounds, axis.min(2), progress)?,
        };
        let mut patches = Patches::default();
        for (x, y_z) in &spans {
            patches.set_run(self, *x, *y_z, |_| 255);
        }
        let mut filled = self.clone();
        patches.apply(&mut filled);
        // Behind a soft inner border there is no border any more; but what also borders on the outside stays.
        let dims = self.grid().dims();
        let mut soft = Patches::default();
        for ([from, to], [y, z]) in spans {
            for z in z.saturating_sub(1)..(z + 2).min(dims[2]) {
                for y in y.saturating_sub(1)..(y + 2).min(dims[1]) {
                    for x in from.saturating_sub(1)..(to + 1).min(dims[0]) {
                        let f = filled.get([x, y, z]);
                        if (IN..255).contains(&f) && !borders_on_outside(&filled, [x, y, z]) {
                            soft.set_run(&filled, [x, x + 1], [y, z], |_| 255);
                        }
                    }
                }
            }
        }
        soft.apply(&mut filled);
        Ok(self.take_over(&filled))
    }
}

fn borders_on_outside(selection: &Selection, voxel: [usize; 3]) -> bool {
    let dims = selection.grid().dims();
    (0..3).any(|a| {
        [-1, 1].into_iter().any(|step| {
            let mut next = voxel;
            let Some(n) = voxel[a].checked_add_signed(step).filter(|n| *n < dims[a]) else { return false };
            next[a] = n;
            selection.get(next) < IN
        })
    })
}

fn in_space(selection: &Selection, bounds: VoxelBox, progress: &Progress) -> Result<Vec<Span>> {
    let runs = Runs::of(selection, bounds, |f| (f < IN).then_some(0), progress)?;
    let (component, num) = runs.components(0, Connectivity::Faces, progress)?;
    // Around its bounds nothing is selected, or the grid ends.
    let mut is_outside = vec![false; num];
    let [x, y, z] = bounds;
    for (run, component) in runs.runs.iter().zip(&component) {
        let [at_y, at_z] = runs.y_z(run);
        let touches_face =
            run.from == x[0] || run.to == x[1] || at_y == y[0] || at_y + 1 == y[1] || at_z == z[0] || at_z + 1 == z[1];
        is_outside[*component as usize] |= touches_face;
    }
    let enclosed = runs.runs.iter().zip(component).filter(|(_, c)| !is_outside[*c as usize]);
    Ok(enclosed.map(|(run, _)| ([run.from, run.to], runs.y_z(run))).collect())
}

fn in_slices(selection: &Selection, bounds: VoxelBox, axis: usize, progress: &Progress) -> Result<Vec<Span>> {
    let [from, to] = bounds[axis];
    progress.begin("filling holes", (to - from) as u64);
    // The axes of a slice, the faster one first.
    let [u, v] = [[1, 2], [0, 2], [0, 1]][axis];
    let [nu, nv] = [u, v].map(|a| bounds[a][1] - bounds[a][0]);
    let slices: Result<Vec<Vec<Span>>> = (from..to)
        .into_par_iter()
        .map(|at| {
            progress.advance(1)?;
            let mut voxels = bounds;
            voxels[axis] = [at, at + 1];
            let is_in: Vec<bool> = selection.values(voxels).iter().map(|f| *f >= IN).collect();
            let mut is_outside = vec![false; is_in.len()];
            let border =
                (0..nu).flat_map(|i| [i, i + nu * (nv - 1)]).chain((0..nv).flat_map(|j| [nu * j, nu * j + nu - 1]));
            let mut queue: Vec<usize> = border.collect();
            while let Some(i) = queue.pop() {
                if is_in[i] || std::mem::replace(&mut is_outside[i], true) {
                    continue;
                }
                let (x, y) = (i % nu, i / nu);
                queue.extend((x > 0).then(|| i - 1));
                queue.extend((x + 1 < nu).then(|| i + 1));
                queue.extend((y > 0).then(|| i - nu));
                queue.extend((y + 1 < nv).then(|| i + nu));
            }
            let enclosed = (0..is_in.len()).filter(|i| !is_in[*i] && !is_outside[*i]);
            Ok(enclosed
                .map(|i| {
                    let mut voxel = [at; 3];
                    voxel[u] = bounds[u][0] + i % nu;
                    voxel[v] = bounds[v][0] + i / nu;
                    ([voxel[0], voxel[0] + 1], [voxel[1], voxel[2]])
                })
                .collect())
        })
        .collect();
    Ok(slices?.into_iter().flatten().collect())
}
