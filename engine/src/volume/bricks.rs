//! Bricks of 8³ voxels: the smallest and largest value in each, and how far the nearest brick is that a transfer
//! function shows. The march leaps over what is empty with the second; the first is made once per volume.

use rayon::prelude::*;

use super::{Voxel, Voxels};
use crate::with_voxels;

/// Edge of a brick in voxels.
pub const BRICK: usize = 8;

/// The longest step, in voxels, that the border of the bricks allows to leap with: a piece whose middle is in a brick
/// has its ends at most half a step outside of it.
pub const MAX_SKIP_STEP: f64 = 2.0;

/// Voxels around a brick that its range includes: one that half a step reaches into, one for interpolation.
const BORDER: usize = 2;

/// Smallest and largest stored number of each brick with its border: brick b answers for all pieces of rays whose
/// middle is from 8b − ½ to 8b + 7½.
#[derive(Clone, Debug)]
pub struct MinMaxBricks {
    /// Number of bricks along x, y, z.
    pub dims: [usize; 3],
    /// (min, max) per brick, x fastest, in stored numbers.
    pub ranges: Vec<(f64, f64)>,
    /// Whether a brick, border included, has nothing but transparent voxels and so shows nothing whatever their values; empty
    /// where there is no such brick.
    clear: Vec<bool>,
}

impl MinMaxBricks {
    /// Of gap-free voxels (see [`fill_no_data`](super::no_data::fill_no_data)) on a grid of `dims`.
    pub fn compute(voxels: &Voxels, dims: [usize; 3]) -> Self {
        let bricks = dims.map(|n| n.div_ceil(BRICK));
        let mut ranges = vec![(0.0, 0.0); bricks[0] * bricks[1] * bricks[2]];
        with_voxels!(voxels, v => {
            ranges.par_chunks_mut(bricks[0] * bricks[1]).enumerate().for_each(|(bz, layer)| {
                for (i, range) in layer.iter_mut().enumerate() {
                    *range = brick_range(v, dims, [i % bricks[0], i / bricks[0], bz]);
                }
            });
        });
        Self { dims: bricks, ranges, clear: Vec::new() }
    }

    /// The same bricks of a volume with these straight colors (`dims` voxels), of which transparent ones show nothing.
    #[must_use]
    pub fn without_clear(mut self, colors: &[[u8; 4]], dims: [usize; 3]) -> Self {
        let [nx, ny, _] = self.dims;
        let clear: Vec<bool> = (0..self.ranges.len())
            .into_par_iter()
            .map(|i| {
                let (from, to) = with_border([i % nx, i / nx % ny, i / (nx * ny)], dims);
                let mut rows =
                    (from[2]..to[2]).flat_map(|z| (from[1]..to[1]).map(move |y| dims[0] * (y + dims[1] * z)));
                rows.all(|row| colors[row + from[0]..row + to[0]].iter().all(|c| c[3] == 0))
            })
            .collect();
        self.clear = if clear.contains(&true) { clear } else { Vec::new() };
        self
    }

    /// Whether brick `i` may show something: not all of it is transparent.
    pub fn may_show(&self, i: usize) -> bool {
        !self.clear.get(i).is_some_and(|clear| *clear)
    }

    /// Smallest and largest stored number of all.
    pub fn range(&self) -> (f64, f64) {
        self.ranges.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Chebyshev distance, in bricks, of each brick to the nearest one that `is_occupied` (given its range of stored
    /// numbers); 0 = occupied itself, 255 = that far or farther, or nothing is occupied.
    pub fn distances(&self, is_occupied: impl Fn(f64, f64) -> bool) -> Vec<u8> {
        chebyshev_distances(self.dims, |i| self.may_show(i) && is_occupied(self.ranges[i].0, self.ranges[i].1))
    }
}

/// Chebyshev distance of each cell of a box of `dims` cells (x fastest) to the nearest one that `is_occupied`; 0 = occupied itself,
/// 255 = that far or farther, or nothing is occupied.
pub fn chebyshev_distances(dims: [usize; 3], is_occupied: impl Fn(usize) -> bool) -> Vec<u8> {
    let count = dims.iter().product();
    let mut distance: Vec<u8> = (0..count).map(|i| if is_occupied(i) { 0 } else { u8::MAX }).collect();
    let [nx, ny, nz] = dims.map(|n| n as isize);
    // Two chamfer sweeps with weight 1 for all 26 neighbors are exact for the Chebyshev metric.
    let half: Vec<[isize; 3]> = (-1..=1)
        .flat_map(|z| (-1..=1).flat_map(move |y| (-1..=1).map(move |x| [x, y, z])))
        .take_while(|&o| o != [0, 0, 0])
        .collect();
    let mut relax = |x: isize, y: isize, z: isize, sign: isize| {
        let at = |x: isize, y: isize, z: isize| (x + nx * (y + ny * z)) as usize;
        let mut best = distance[at(x, y, z)];
        for [ox, oy, oz] in &half {
            let (px, py, pz) = (x + sign * ox, y + sign * oy, z + sign * oz);
            if (0..nx).contains(&px) && (0..ny).contains(&py) && (0..nz).contains(&pz) {
                best = best.min(distance[at(px, py, pz)].saturating_add(1));
            }
        }
        distance[at(x, y, z)] = best;
    };
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                relax(x, y, z, 1);
            }
        }
    }
    for z in (0..nz).rev() {
        for y in (0..ny).rev() {
            for x in (0..nx).rev() {
                relax(x, y, z, -1);
            }
        }
    }
    distance
}

/// Takes over into `distance` (see [`chebyshev_distances`]) that one more cell is occupied. Gives back whether that changed anything.
pub fn occupy(distance: &mut [u8], dims: [usize; 3], cell: [usize; 3]) -> bool {
    let index = |[x, y, z]: [usize; 3]| x + dims[0] * (y + dims[1] * z);
    if distance[index(cell)] == 0 {
        return false;
    }
    // Shells around the cell, until one is nearer to others throughout: so is all beyond it.
    for reach in 0..u8::MAX {
        let range = |a: usize| {
            let r = usize::from(reach);
            (cell[a].saturating_sub(r), (cell[a] + r).min(dims[a] - 1))
        };
        let [x, y, z] = [range(0), range(1), range(2)];
        let mut any = false;
        for k in z.0..=z.1 {
            for j in y.0..=y.1 {
                let on_side = cell[1].abs_diff(j).max(cell[2].abs_diff(k)) == usize::from(reach);
                let mut set = |i: usize| {
                    if cell[0].abs_diff(i) == usize::from(reach) || on_side {
                        let d = &mut distance[index([i, j, k])];
                        any |= *d > reach;
                        *d = (*d).min(reach);
                    }
                };
                if on_side {
                    (x.0..=x.1).for_each(set);
                } else {
                    set(x.0);
                    if x.1 > x.0 {
                        set(x.1);
                    }
                }
            }
        }
        if !any {
            break;
        }
    }
    true
}

/// First voxel of a brick and its border, and the one behind the last.
fn with_border(brick: [usize; 3], dims: [usize; 3]) -> ([usize; 3], [usize; 3]) {
    let from = brick.map(|b| (b * BRICK).saturating_sub(BORDER));
    (from, std::array::from_fn(|i| (brick[i] * BRICK + BRICK + BORDER).min(dims[i])))
}

fn brick_range<T: Voxel>(voxels: &[T], dims: [usize; 3], brick: [usize; 3]) -> (f64, f64) {
    let (from, to) = with_border(brick, dims);
    let first = voxels[from[0] + dims[0] * (from[1] + dims[1] * from[2])];
    let (mut lo, mut hi) = (first, first);
    for z in from[2]..to[2] {
        for y in from[1]..to[1] {
            let row = dims[0] * (y + dims[1] * z);
            for &s in &voxels[row + from[0]..row + to[0]] {
                lo = if s < lo { s } else { lo };
                hi = if s > hi { s } else { hi };
            }
        }
    }
    (lo.to_f64(), hi.to_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bricks_include_their_border() {
        let dims = [17, 9, 8];
        let mut v = vec![0i16; 17 * 9 * 8];
        v[9] = 7; // x = 9: inside brick 1, on the border of brick 0
        let bricks = MinMaxBricks::compute(&Voxels::I16(v), dims);
        assert_eq!(bricks.dims, [3, 2, 1]);
        assert_eq!(bricks.ranges.iter().map(|r| r.1).collect::<Vec<_>>(), [7.0, 7.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(bricks.range(), (0.0, 7.0));
    }

    #[test]
    fn what_is_transparent_is_not_occupied() {
        let dims = [24, 8, 8];
        let mut colors = vec![[255, 255, 255, 0]; 24 * 64];
        colors[17] = [0, 0, 0, 1];
        let bricks = MinMaxBricks::compute(&Voxels::U8(vec![9; 24 * 64]), dims).without_clear(&colors, dims);
        assert_eq!(bricks.distances(|_, _| true), [1, 0, 0]);
        assert_eq!([0, 1, 2].map(|i| bricks.may_show(i)), [false, true, true]);
    }

    #[test]
    fn distances_are_chebyshev() {
        let dims = [40, 32, 24];
        let mut v = vec![0u8; 40 * 32 * 24];
        v[4 + 40 * (4 + 32 * 4)] = 1;
        let bricks = MinMaxBricks::compute(&Voxels::U8(v), dims);
        let distance = bricks.distances(|_, hi| hi > 0.0);
        for (i, d) in distance.iter().enumerate() {
            let expected = (i % 5).max(i / 5 % 4).max(i / 20);
            assert_eq!(usize::from(*d), expected, "brick {i}");
        }
        assert!(bricks.distances(|_, _| false).iter().all(|&d| d == 255));
    }

    #[test]
    fn one_more_occupied_cell_is_taken_over() {
        let dims = [9, 7, 12];
        let mut occupied = vec![false; 9 * 7 * 12];
        let mut distance = chebyshev_distances(dims, |i| occupied[i]);
        for i in 0..40 {
            let cell = [i * 5 % 9, i * 3 % 7, i * 7 % 12];
            let at = cell[0] + 9 * (cell[1] + 7 * cell[2]);
            assert_eq!(occupy(&mut distance, dims, cell), !occupied[at]);
            occupied[at] = true;
            assert_eq!(distance, chebyshev_distances(dims, |i| occupied[i]), "{i}");
        }
    }
}
