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

/// How many bricks a piece of `step_voxels` may reach into on either side of the one its middle is in, besides that one's border.
pub fn reach(step_voxels: f64) -> u8 {
    (0.5 * (step_voxels - MAX_SKIP_STEP) / BRICK as f64).ceil().clamp(0.0, f64::from(u8::MAX)) as u8
}

/// Voxels from the faces of a volume on, along each axis, that its rim takes.
pub const RIM: usize = 4;

/// The longest step, in voxels, of which what is seen within a voxel of a face is in the rim: a look at a fourth of it reaches that
/// much farther.
pub const MAX_RIM_STEP: f64 = 8.0;

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
    /// (min, max) of the [`RIM`] outermost voxels on all sides.
    pub rim: (f64, f64),
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
        let rim = with_voxels!(voxels, v => rim_range(v, dims));
        Self { dims: bricks, ranges, rim, clear: Vec::new() }
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

    /// Chebyshev distance, in bricks, of each brick to the nearest one of which a piece whose middle is in it may show something:
    /// one that `is_occupied` (given its range of stored numbers) or has such a one at most `reach` (see [`reach`]) away. 0 = itself,
    /// 255 = that far or farther, or nothing is occupied.
    pub fn distances(&self, reach: u8, is_occupied: impl Fn(f64, f64) -> bool + Sync) -> Vec<u8> {
        let occupied = |i: usize| self.may_show(i) && is_occupied(self.ranges[i].0, self.ranges[i].1);
        let mut distances = chebyshev_distances(self.dims, occupied);
        if reach > 0 {
            distances.iter_mut().filter(|d| **d < u8::MAX).for_each(|d| *d = d.saturating_sub(reach));
        }
        distances
    }
}

/// Chebyshev distance of each cell of a box of `dims` cells (x fastest) to the nearest one that `is_occupied`; 0 = occupied itself,
/// 255 = that far or farther, or nothing is occupied.
pub fn chebyshev_distances(dims: [usize; 3], is_occupied: impl Fn(usize) -> bool + Sync) -> Vec<u8> {
    let [nx, ny, nz] = dims;
    let cells = (0..nx * ny * nz).into_par_iter().with_min_len(1 << 12);
    let mut along_x: Vec<u8> = cells.map(|i| if is_occupied(i) { 0 } else { u8::MAX }).collect();
    along_x.par_chunks_mut(nx).for_each(|row| {
        for x in 1..nx {
            row[x] = row[x].min(row[x - 1].saturating_add(1));
        }
        for x in (1..nx).rev() {
            row[x - 1] = row[x - 1].min(row[x].saturating_add(1));
        }
    });
    // The distance of two cells is the largest of those along the axes: axis by axis, of whole rows.
    let along_y = nearest_of_rows(&along_x, nx, |row, reach| {
        let (y, plane) = (row % ny, row - row % ny);
        [y.checked_sub(reach), Some(y + reach).filter(|y| *y < ny)].map(|y| y.map(|y| plane + y))
    });
    nearest_of_rows(&along_y, nx, |row, reach| {
        let behind = row + reach * ny;
        [row.checked_sub(reach * ny), Some(behind).filter(|row| *row < ny * nz)]
    })
}

/// The least, of every row of `nx` cells and those `others` that are so many rows away from it, of that distance and their own, whichever
/// is larger.
fn nearest_of_rows(distances: &[u8], nx: usize, others: impl Fn(usize, usize) -> [Option<usize>; 2] + Sync) -> Vec<u8> {
    let mut nearest = distances.to_vec();
    nearest.par_chunks_mut(nx).enumerate().for_each(|(row, own)| {
        for reach in 1..u8::MAX {
            let rows = others(row, usize::from(reach));
            // Rows farther away change nothing any more.
            if rows == [None, None] || own.iter().all(|d| *d <= reach) {
                break;
            }
            for other in rows.into_iter().flatten() {
                for (own, there) in own.iter_mut().zip(&distances[other * nx..][..nx]) {
                    *own = (*own).min((*there).max(reach));
                }
            }
        }
    });
    nearest
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

fn rim_range<T: Voxel>(voxels: &[T], [nx, ny, nz]: [usize; 3]) -> (f64, f64) {
    let is_outer = |i: usize, n: usize| i < RIM || i + RIM >= n;
    let of_row = |i: usize| {
        let row = &voxels[i * nx..][..nx];
        let whole = is_outer(i % ny, ny) || is_outer(i / ny, nz) || nx <= 2 * RIM;
        let [left, right] = if whole { [row, &[]] } else { [&row[..RIM], &row[nx - RIM..]] };
        left.iter()
            .chain(right)
            .map(|s| s.to_f64())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), s| (low.min(s), high.max(s)))
    };
    (0..ny * nz)
        .into_par_iter()
        .map(of_row)
        .reduce(|| (f64::INFINITY, f64::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)))
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
    fn the_rim_is_four_voxels_wide() {
        let dims = [11, 10, 12];
        let at = |x: usize, y: usize, z: usize| {
            let mut v = vec![0i16; 11 * 10 * 12];
            v[x + 11 * (y + 10 * z)] = -7;
            MinMaxBricks::compute(&Voxels::I16(v), dims).rim.0
        };
        assert_eq!([at(4, 5, 6), at(6, 4, 7), at(5, 5, 5)], [0.0; 3]);
        assert_eq!(
            [at(3, 5, 6), at(7, 5, 6), at(5, 3, 6), at(5, 6, 6), at(5, 5, 3), at(5, 5, 8), at(0, 9, 0)],
            [-7.0; 7]
        );
        // What is as thin is all rim.
        assert_eq!(MinMaxBricks::compute(&Voxels::U8(vec![3; 8]), [8, 1, 1]).rim, (3.0, 3.0));
    }

    #[test]
    fn what_is_transparent_is_not_occupied() {
        let dims = [24, 8, 8];
        let mut colors = vec![[255, 255, 255, 0]; 24 * 64];
        colors[17] = [0, 0, 0, 1];
        let bricks = MinMaxBricks::compute(&Voxels::U8(vec![9; 24 * 64]), dims).without_clear(&colors, dims);
        assert_eq!(bricks.distances(0, |_, _| true), [1, 0, 0]);
        assert_eq!([0, 1, 2].map(|i| bricks.may_show(i)), [false, true, true]);
    }

    #[test]
    fn distances_are_chebyshev() {
        let dims = [40, 32, 24];
        let mut v = vec![0u8; 40 * 32 * 24];
        v[4 + 40 * (4 + 32 * 4)] = 1;
        let bricks = MinMaxBricks::compute(&Voxels::U8(v), dims);
        let distance = bricks.distances(0, |_, hi| hi > 0.0);
        for (i, d) in distance.iter().enumerate() {
            let expected = (i % 5).max(i / 5 % 4).max(i / 20);
            assert_eq!(usize::from(*d), expected, "brick {i}");
        }
        assert!(bricks.distances(0, |_, _| false).iter().all(|&d| d == 255));
        // Pieces that reach into the next brick find it from one brick farther away.
        let farther = bricks.distances(1, |_, hi| hi > 0.0);
        assert!(distance.iter().zip(&farther).all(|(d, f)| *f == d.saturating_sub(1)));
        assert!(bricks.distances(1, |_, _| false).iter().all(|&d| d == 255));
    }

    #[test]
    fn long_pieces_reach_into_more_bricks() {
        assert_eq!([0.25, 2.0, 2.1, 4.0, 18.0, 18.1].map(reach), [0, 0, 1, 1, 1, 2]);
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
