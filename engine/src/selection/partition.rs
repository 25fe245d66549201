//! Structures whose borders are smoothed together, so that none gains what no other loses.
//!
//! A label map says of each voxel what it is and nothing else: drawn as it is, its structures have the stairs of their voxels.
//! Here each membership is smoothed by a Gaussian, and what was a border between two structures becomes their transition. As a
//! Gaussian keeps sums, they still share out each voxel. Then the transitions are sharpened again, all memberships of a voxel
//! together, back to about a voxel's width: a smooth surface, and no fog.

use rayon::prelude::*;

use super::{BRICK, BRICK_VOXELS, Brick, Selection, Structure, VoxelBox};
use crate::error::Result;
use crate::progress::Progress;

/// Exponent that sharpens: a border smoothed by a Gaussian of σ voxels climbs by 0.4/σ a voxel where two structures are equal,
/// and p times that after it.
const SHARPNESS_PER_SIGMA: f64 = 2.5;
/// Widest Gaussian, voxels.
pub const MOST_SIGMA: f64 = 4.0;

/// The structures with borders smoothed by a Gaussian of `sigma` voxels (at most [`MOST_SIGMA`]) along each axis and sharpened again.
/// What is no structure counts as one more. Structures that overlap keep to do so. `sigma` ≤ 0 changes nothing.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled) on request.
pub fn smooth_partition(structures: &[Structure], sigma: f64, progress: &Progress) -> Result<Vec<Structure>> {
    let Some(first) = structures.first().filter(|_| sigma > 0.0) else { return Ok(structures.to_vec()) };
    let kernel = Kernel::new(sigma.min(MOST_SIGMA));
    let grid = *first.selection.grid();
    let size = first.selection.size_in_bricks();
    let candidates = candidates(structures, size, kernel.reach().div_ceil(BRICK));
    progress.begin("smoothing", candidates.len() as u64);
    let bricks: Vec<Vec<(usize, Brick)>> = candidates
        .par_iter()
        .with_min_len(8)
        .map(|(place, present)| {
            progress.advance(1)?;
            Ok(kernel.brick(structures, *place, present))
        })
        .collect::<Result<_>>()?;
    let mut by_structure: Vec<Vec<([usize; 3], Brick)>> = vec![Vec::new(); structures.len()];
    for ((place, _), found) in candidates.iter().zip(bricks) {
        for (i, brick) in found {
            by_structure[i].push((*place, brick));
        }
    }
    Ok(structures
        .iter()
        .zip(by_structure)
        .map(|(structure, bricks)| {
            let mut selection = Selection::empty(grid, structure.selection.pool());
            selection.replace(bricks);
            Structure { label: structure.label.clone(), selection }
        })
        .collect())
}

/// Bricks that have anything of a structure in them or up to `reach` bricks beside them, with those structures.
fn candidates(structures: &[Structure], size: [usize; 3], reach: usize) -> Vec<([usize; 3], Vec<usize>)> {
    let mut near: std::collections::BTreeMap<[usize; 3], Vec<usize>> = std::collections::BTreeMap::new();
    for (i, structure) in structures.iter().enumerate() {
        for (place, _) in structure.selection.bricks() {
            let range = |a: usize| place[a].saturating_sub(reach)..(place[a] + reach + 1).min(size[a]);
            for p in
                range(2).flat_map(|z| range(1).map(move |y| [y, z])).flat_map(|[y, z]| range(0).map(move |x| [x, y, z]))
            {
                let list = near.entry(p).or_default();
                if list.last() != Some(&i) {
                    list.push(i);
                }
            }
        }
    }
    near.into_iter().collect()
}

/// A Gaussian, from its middle outwards.
struct Kernel {
    weights: Vec<f64>,
    sharpness: f64,
}

impl Kernel {
    fn new(sigma: f64) -> Self {
        let reach = (3.0 * sigma).ceil() as usize;
        let weights = (0..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
        Self { weights, sharpness: (SHARPNESS_PER_SIGMA * sigma).max(1.0) }
    }

    /// Voxels to either side that count.
    fn reach(&self) -> usize {
        self.weights.len() - 1
    }

    /// What a brick has of the structures around it: those of which it has anything.
    fn brick(&self, structures: &[Structure], place: [usize; 3], present: &[usize]) -> Vec<(usize, Brick)> {
        let dims = structures[0].selection.grid().dims();
        let first = place.map(|n| n * BRICK);
        let voxels: VoxelBox = std::array::from_fn(|a| {
            [first[a].saturating_sub(self.reach()), (first[a] + BRICK + self.reach()).min(dims[a])]
        });
        let smoothed: Vec<(usize, Vec<f64>)> = present
            .iter()
            .map(|&i| (i, structures[i].selection.values(voxels)))
            .filter(|(_, values)| values.iter().any(|f| *f > 0))
            .map(|(i, values)| (i, self.smoothed(&values, voxels, first)))
            .collect();
        if let [(i, only)] = &smoothed[..]
            && only.iter().all(|f| *f > 1.0 - 1e-9)
        {
            return vec![(*i, Brick::Uniform(u8::MAX))];
        }
        let mut shares = vec![[0; BRICK_VOXELS]; smoothed.len()];
        for voxel in 0..BRICK_VOXELS {
            let at = [voxel % BRICK, voxel / BRICK % BRICK, voxel / (BRICK * BRICK)];
            if (0..3).any(|a| first[a] + at[a] >= dims[a]) {
                continue;
            }
            let wanted: f64 = smoothed.iter().map(|(_, f)| f[voxel]).sum();
            let sharp = |f: f64| f.max(0.0).powf(self.sharpness);
            let all: f64 = smoothed.iter().map(|(_, f)| sharp(f[voxel])).sum::<f64>() + sharp(1.0 - wanted);
            for ((_, f), share) in smoothed.iter().zip(&mut shares) {
                let f = wanted.max(1.0) * sharp(f[voxel]) / all.max(f64::MIN_POSITIVE);
                share[voxel] = (255.0 * f.min(1.0)).round() as u8;
            }
        }
        let pool = structures[0].selection.pool();
        let found = smoothed.iter().zip(&shares).map(|((i, _), share)| (*i, pool.brick(share)));
        found.filter(|(_, brick)| !brick.is_empty()).collect()
    }

    /// The Gaussian mean at each voxel of the brick that begins at `first`; beyond the grid there is nothing to count.
    fn smoothed(&self, values: &[u8], voxels: VoxelBox, first: [usize; 3]) -> Vec<f64> {
        let mut size = voxels.map(|[from, to]| to - from);
        let mut field: Vec<f64> = values.iter().map(|f| f64::from(*f) / 255.0).collect();
        for axis in 0..3 {
            // Along one axis after the other the box shrinks to the brick.
            let inner = size[..axis].iter().product::<usize>();
            let outer = size[axis + 1..].iter().product::<usize>();
            let n = size[axis];
            let mut out = Vec::with_capacity(inner * BRICK * outer);
            for o in 0..outer {
                for at in 0..BRICK {
                    let center = first[axis] + at - voxels[axis][0];
                    let (from, to) = (center.saturating_sub(self.reach()), (center + self.reach() + 1).min(n));
                    let weights: Vec<f64> = (from..to).map(|i| self.weights[i.abs_diff(center)]).collect();
                    let total: f64 = weights.iter().sum();
                    for i in 0..inner {
                        let taps = (from..to).zip(&weights);
                        let sum: f64 = taps.map(|(k, w)| w * field[i + inner * (k + n * o)]).sum();
                        out.push(if total > 0.0 { sum / total } else { 0.0 });
                    }
                }
            }
            field = out;
            size[axis] = BRICK;
        }
        field
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DAffine3;

    use super::*;
    use crate::selection::BrickPool;
    use crate::spaces::Grid;
    use crate::volume::labels::numbered;

    fn structures(dims: [usize; 3], owner: impl Fn([usize; 3]) -> usize + Sync, count: usize) -> Vec<Structure> {
        let grid = Grid::new(dims, DAffine3::IDENTITY).unwrap();
        let pool = Arc::new(BrickPool::default());
        (1..=count)
            .map(|i| {
                let mut selection = Selection::empty(grid, &pool);
                selection.change(dims.map(|n| [0, n]), |voxel, _| if owner(voxel) == i { 255 } else { 0 });
                Structure { label: numbered(i as u32), selection }
            })
            .collect()
    }

    #[test]
    fn borders_become_smooth_and_nothing_is_lost() {
        // Two that meet along a slope, in a grid that is no multiple of a brick.
        let dims = [30, 21, 19];
        let owner = |[x, y, z]: [usize; 3]| if 3 * x > y + z + 25 { 2 } else { 1 };
        let made = smooth_partition(&structures(dims, owner, 2), 1.0, &Progress::new()).unwrap();
        for (x, y, z) in [(3, 3, 3), (8, 0, 0), (9, 1, 1), (15, 10, 10), (29, 20, 18), (14, 9, 8)] {
            let [a, b] = [0, 1].map(|i| i32::from(made[i].selection.get([x, y, z])));
            assert!((a + b - 255).abs() <= 1, "{x} {y} {z}: {a} + {b}");
        }
        assert_eq!(made[0].selection.get([0, 0, 0]), 255);
        // Where the slope crosses a row, memberships are between 0 and 1.
        let row: Vec<u8> = (0..30).map(|x| made[1].selection.get([x, 10, 9])).collect();
        assert!(row.windows(2).all(|w| w[0] <= w[1]) && row.iter().any(|f| (20..235).contains(f)), "{row:?}");
        assert!(row.iter().filter(|f| (5..250).contains(*f)).count() <= 4, "fog: {row:?}");
    }

    #[test]
    fn a_ball_keeps_its_volume_and_loses_its_stairs() {
        let dims = [32; 3];
        let radius = 10.0;
        let distance = |v: [usize; 3]| v.map(|n| (n as f64 - 15.5).powi(2)).iter().sum::<f64>().sqrt();
        let crisp = structures(dims, |v| usize::from(distance(v) < radius), 1);
        let made = smooth_partition(&crisp, 1.0, &Progress::new()).unwrap();
        let (before, after) = (crisp[0].selection.num_voxels(), made[0].selection.num_voxels());
        assert!((after / before - 1.0).abs() < 0.03, "{after} of {before}");
        // How far the surface f = ½ is from the sphere, along the rays from its center.
        let roughness = |s: &Selection| -> f64 {
            let mut worst = 0.0f64;
            for i in 0..200 {
                let (a, b) = (f64::from(i) * 2.4, (f64::from(i) / 100.0 - 1.0).asin());
                let d = [a.cos() * b.cos(), a.sin() * b.cos(), b.sin()];
                let at = |r: f64| s.interpolated(glam::DVec3::from_array(d.map(|c| 15.5 + r * c)));
                let crossing = (0..800).map(|k| 6.0 + f64::from(k) * 0.01).find(|r| at(*r) < 0.5).unwrap();
                worst = worst.max((crossing - (radius - 0.1)).abs());
            }
            worst
        };
        let [rough, smooth] = [&crisp[0].selection, &made[0].selection].map(roughness);
        println!("{rough} {smooth}");
        assert!(smooth < 0.55 * rough, "{smooth} of {rough} voxels");
    }

    #[test]
    fn what_overlaps_stays_whole() {
        let dims = [16; 3];
        let mut both = structures(dims, |[x, ..]| usize::from(x < 8), 1);
        both.push(both[0].clone());
        let made = smooth_partition(&both, 1.0, &Progress::new()).unwrap();
        assert!(made.iter().all(|s| s.selection.get([2, 8, 8]) == 255 && s.selection.get([14, 8, 8]) == 0));
        let none = smooth_partition(&both, 0.0, &Progress::new()).unwrap();
        assert!(none[0].selection.changed_since(&both[0].selection).is_empty());
        assert!(smooth_partition(&[], 1.0, &Progress::new()).unwrap().is_empty());
    }
}
