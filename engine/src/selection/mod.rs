//! Selection volumes (thesis §2.3.1, §2.3.2): how much each voxel of a grid belongs to a structure, from 0 (not at all) to 1.
//!
//! Sparse, fuzzy and often edited: so they are kept in bricks of 8³ voxels, which are never changed but replaced. A copy shares
//! all of its bricks with the original, an edit makes new ones where it touches only, equal bricks are in memory once, and what
//! an edit has changed is found by comparing addresses: that is what undo steps and uploads are made of.

mod brick;

use std::sync::Arc;

pub use brick::{Brick, BrickPool, BrickVoxels};
use rayon::prelude::*;

use crate::spaces::Grid;
pub use crate::volume::bricks::BRICK;

/// Voxels in a brick.
pub const BRICK_VOXELS: usize = BRICK * BRICK * BRICK;

/// Bricks along the edge of a chunk.
const CHUNK: usize = 8;

/// Half-open box of voxels: first and, exclusive, last along x, y, z. Empty if any last is not above its first.
pub type VoxelBox = [[usize; 2]; 3];

/// A block of 8³ bricks, shared between copies of a selection until one of them changes it.
#[derive(Clone, Debug)]
struct Chunk {
    bricks: Vec<Brick>,
    /// Of its voxels, counted from the chunk's first; `None` where all are 0.
    bounds: Option<VoxelBox>,
    /// Sum of memberships, 255 = 1.
    sum: u64,
}

/// Memberships f ∈ [0, 1] in 1/255, one for each voxel of a grid. Copies are cheap.
#[derive(Clone, Debug)]
pub struct Selection {
    grid: Grid,
    /// Chunks along x, y, z.
    size: [usize; 3],
    /// x fastest; `None`: nothing in it is selected.
    chunks: Vec<Option<Arc<Chunk>>>,
    pool: Arc<BrickPool>,
}

/// Bricks as they were before an edit, or after it: what an undo step keeps.
#[derive(Clone, Debug, Default)]
pub struct BrickDiff {
    bricks: Vec<([usize; 3], Brick)>,
}

impl BrickDiff {
    /// Whether nothing changed.
    pub fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }

    /// Bricks that differ: their places, in bricks.
    pub fn places(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        self.bricks.iter().map(|(place, _)| *place)
    }

    /// Memory that it keeps alive at most, in bytes: its own and that of its bricks, which others may share.
    pub fn num_bytes(&self) -> usize {
        self.bricks.iter().map(|(_, brick)| size_of::<([usize; 3], Brick)>() + brick.num_bytes()).sum()
    }
}

impl Selection {
    /// Nothing selected of `grid`. Selections with one `pool` share equal bricks.
    pub fn empty(grid: Grid, pool: &Arc<BrickPool>) -> Self {
        let size = grid.dims().map(|n| n.div_ceil(BRICK * CHUNK));
        Self { grid, size, chunks: vec![None; size.iter().product()], pool: pool.clone() }
    }

    /// The grid whose voxels it selects.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// What keeps its bricks apart from equal ones.
    pub fn pool(&self) -> &Arc<BrickPool> {
        &self.pool
    }

    /// Bricks along x, y, z; those at the far faces may reach beyond the grid, where all memberships are 0.
    pub fn size_in_bricks(&self) -> [usize; 3] {
        self.grid.dims().map(|n| n.div_ceil(BRICK))
    }

    /// Membership of a voxel, 255 = 1.
    ///
    /// # Panics
    /// If it lies outside the grid.
    pub fn get(&self, [x, y, z]: [usize; 3]) -> u8 {
        let dims = self.grid.dims();
        assert!(x < dims[0] && y < dims[1] && z < dims[2], "voxel {x} {y} {z} of {dims:?}");
        self.brick([x / BRICK, y / BRICK, z / BRICK]).get([x % BRICK, y % BRICK, z % BRICK])
    }

    /// The brick at a place (in bricks).
    ///
    /// # Panics
    /// If it lies outside the grid.
    pub fn brick(&self, place: [usize; 3]) -> &Brick {
        match &self.chunks[self.chunk_index(place)] {
            None => &Brick::EMPTY,
            Some(chunk) => &chunk.bricks[index_in_chunk(place)],
        }
    }

    /// Places and bricks in which something is selected, in no particular order.
    pub fn bricks(&self) -> impl Iterator<Item = ([usize; 3], &Brick)> + '_ {
        self.chunks.iter().enumerate().filter_map(|(i, chunk)| Some((i, chunk.as_ref()?))).flat_map(
            move |(i, chunk)| {
                let first = self.first_brick(i);
                let selected = chunk.bricks.iter().enumerate().filter(|(_, brick)| !brick.is_empty());
                selected.map(move |(j, brick)| (place_in_chunk(first, j), brick))
            },
        )
    }

    /// The smallest box that holds every voxel with a membership above 0; `None` if there is none.
    pub fn bounds(&self) -> Option<VoxelBox> {
        let mut all: Option<VoxelBox> = None;
        for (i, chunk) in self.chunks.iter().enumerate() {
            let Some(bounds) = chunk.as_ref().and_then(|chunk| chunk.bounds) else { continue };
            let first = self.first_brick(i).map(|n| n * BRICK);
            all = Some(joined(all, std::array::from_fn(|a| bounds[a].map(|n| n + first[a]))));
        }
        all
    }

    /// Sum of the memberships: how many voxels it is, partly selected ones in part.
    pub fn num_voxels(&self) -> f64 {
        self.chunks.iter().flatten().map(|chunk| chunk.sum).sum::<u64>() as f64 / 255.0
    }

    /// Its volume in ml (cm³).
    pub fn volume_ml(&self) -> f64 {
        self.num_voxels() * self.grid.world_from_index().matrix3.determinant().abs() * 1e-3
    }

    /// Whether nothing is selected.
    pub fn is_empty(&self) -> bool {
        self.chunks.iter().flatten().all(|chunk| chunk.sum == 0)
    }

    /// Changes the voxels of a box, clipped to the grid: `change` gets a voxel's place and membership and gives its new one.
    /// Returns what the bricks were before. Work and memory are those of the bricks that the box touches.
    pub fn change(&mut self, voxels: VoxelBox, change: impl Fn([usize; 3], u8) -> u8 + Sync) -> BrickDiff {
        let dims = self.grid.dims();
        let voxels: VoxelBox = std::array::from_fn(|a| voxels[a].map(|n| n.min(dims[a])));
        if voxels.iter().any(|[from, to]| from >= to) {
            return BrickDiff::default();
        }
        let range = voxels.map(|[from, to]| from / BRICK..to.div_ceil(BRICK));
        let places: Vec<[usize; 3]> = (range[2].clone())
            .flat_map(|z| range[1].clone().map(move |y| [y, z]))
            .flat_map(|[y, z]| range[0].clone().map(move |x| [x, y, z]))
            .collect();
        let changed = places.into_par_iter().with_min_len(16).filter_map(|place| {
            let old = self.brick(place);
            let mut values = old.values();
            let mut differs = false;
            let part: VoxelBox = std::array::from_fn(|a| {
                let first = place[a] * BRICK;
                [voxels[a][0].max(first), voxels[a][1].min(first + BRICK)]
            });
            for z in part[2][0]..part[2][1] {
                for y in part[1][0]..part[1][1] {
                    let row = BRICK * (y % BRICK + BRICK * (z % BRICK));
                    for x in part[0][0]..part[0][1] {
                        let value = &mut values[row + x % BRICK];
                        let new = change([x, y, z], *value);
                        differs |= new != *value;
                        *value = new;
                    }
                }
            }
            differs.then(|| (place, self.pool.brick(&values)))
        });
        let mut diff = BrickDiff { bricks: changed.collect() };
        self.swap(&mut diff);
        diff
    }

    /// Puts the bricks of a diff where they belong and leaves those that were there in it: undo, and then redo.
    ///
    /// # Panics
    /// If a place lies outside the grid.
    pub fn swap(&mut self, diff: &mut BrickDiff) {
        // Chunk by chunk, so that each is copied and summed up once.
        diff.bricks.sort_by_key(|(place, _)| self.chunk_index(*place));
        let mut rest = &mut diff.bricks[..];
        while let Some((place, _)) = rest.first() {
            let index = self.chunk_index(*place);
            let end = rest.iter().position(|(p, _)| self.chunk_index(*p) != index).unwrap_or(rest.len());
            let (these, others) = rest.split_at_mut(end);
            rest = others;
            let chunk = self.chunks[index].get_or_insert_with(|| {
                Arc::new(Chunk { bricks: vec![Brick::EMPTY; CHUNK * CHUNK * CHUNK], bounds: None, sum: 0 })
            });
            let chunk = Arc::make_mut(chunk);
            for (place, brick) in these {
                std::mem::swap(&mut chunk.bricks[index_in_chunk(*place)], brick);
            }
            self.sum_up(index);
        }
    }

    /// Makes a chunk's sum and bounds true again after its bricks have changed.
    fn sum_up(&mut self, index: usize) {
        // Uniform bricks are as large as the grid lets them be.
        let first = self.first_brick(index);
        let room = |j: usize| -> [usize; 3] {
            let place = place_in_chunk(first, j);
            std::array::from_fn(|a| (self.grid.dims()[a].saturating_sub(place[a] * BRICK)).min(BRICK))
        };
        let Some(chunk) = &self.chunks[index] else { return };
        let (mut sum, mut bounds) = (0, None);
        for (j, brick) in chunk.bricks.iter().enumerate().filter(|(_, brick)| !brick.is_empty()) {
            let room = room(j);
            sum += brick.sum(room);
            if let Some(inner) = brick.bounds(room) {
                let first = place_in_chunk([0; 3], j).map(|n| n * BRICK);
                bounds = Some(joined(bounds, std::array::from_fn(|a| inner[a].map(|n| n + first[a]))));
            }
        }
        if sum == 0 {
            self.chunks[index] = None;
        } else if let Some(chunk) = &mut self.chunks[index] {
            let chunk = Arc::make_mut(chunk);
            (chunk.sum, chunk.bounds) = (sum, bounds);
        }
    }

    /// Places of the bricks in which it may differ from `other`: those that the two do not share. Costs what differs.
    ///
    /// # Panics
    /// If the grids have different sizes.
    pub fn changed_since(&self, other: &Self) -> Vec<[usize; 3]> {
        assert_eq!(self.grid.dims(), other.grid.dims(), "selections of grids of different sizes");
        let mut places = Vec::new();
        for (i, (a, b)) in self.chunks.iter().zip(&other.chunks).enumerate() {
            let first = self.first_brick(i);
            match (a, b) {
                (None, None) => {}
                (Some(a), Some(b)) if Arc::ptr_eq(a, b) => {}
                (Some(a), Some(b)) => {
                    let pairs = a.bricks.iter().zip(&b.bricks).enumerate();
                    places.extend(pairs.filter(|(_, (a, b))| !a.is_same(b)).map(|(j, _)| place_in_chunk(first, j)));
                }
                (Some(one), None) | (None, Some(one)) => {
                    let selected = one.bricks.iter().enumerate().filter(|(_, brick)| !brick.is_empty());
                    places.extend(selected.map(|(j, _)| place_in_chunk(first, j)));
                }
            }
        }
        places
    }

    /// Bytes of memory for what is selected; bricks that it shares with others, or with itself, count as often as they are
    /// used.
    pub fn num_bytes(&self) -> usize {
        let chunk_bytes = CHUNK * CHUNK * CHUNK * size_of::<Brick>();
        let chunks = self.chunks.iter().flatten().count() * (chunk_bytes + size_of::<Chunk>());
        chunks + self.chunks.len() * 8 + self.bricks().map(|(_, brick)| brick.num_bytes()).sum::<usize>()
    }

    fn chunk_index(&self, place: [usize; 3]) -> usize {
        let [x, y, z] = place.map(|n| n / CHUNK);
        assert!(x < self.size[0] && y < self.size[1] && z < self.size[2], "brick {place:?} outside of its grid");
        x + self.size[0] * (y + self.size[1] * z)
    }

    /// The place of a chunk's first brick.
    fn first_brick(&self, chunk: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [chunk % nx, chunk / nx % ny, chunk / (nx * ny)].map(|n| n * CHUNK)
    }
}

fn index_in_chunk(place: [usize; 3]) -> usize {
    let [x, y, z] = place.map(|n| n % CHUNK);
    x + CHUNK * (y + CHUNK * z)
}

fn place_in_chunk(first: [usize; 3], index: usize) -> [usize; 3] {
    [first[0] + index % CHUNK, first[1] + index / CHUNK % CHUNK, first[2] + index / (CHUNK * CHUNK)]
}

/// The smallest box around two.
fn joined(a: Option<VoxelBox>, b: VoxelBox) -> VoxelBox {
    let Some(a) = a else { return b };
    std::array::from_fn(|i| [a[i][0].min(b[i][0]), a[i][1].max(b[i][1])])
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;

    fn empty(dims: [usize; 3]) -> Selection {
        let grid = Grid::new(dims, DAffine3::from_scale(DVec3::new(0.5, 1.0, 2.0))).unwrap();
        Selection::empty(grid, &Arc::new(BrickPool::default()))
    }

    fn whole(selection: &Selection) -> VoxelBox {
        selection.grid().dims().map(|n| [0, n])
    }

    /// Every voxel, by the slow way.
    fn voxels(selection: &Selection) -> Vec<u8> {
        let [nx, ny, nz] = selection.grid().dims();
        (0..nx * ny * nz).map(|i| selection.get([i % nx, i / nx % ny, i / (nx * ny)])).collect()
    }

    #[test]
    fn an_edit_is_what_it_says_and_can_be_taken_back() {
        let mut selection = empty([70, 9, 17]);
        assert!(selection.is_empty() && selection.bounds().is_none());
        let ramp = |[x, y, z]: [usize; 3], _: u8| (x + 3 * y + 5 * z) as u8;
        let undo = selection.change([[2, 69], [3, 9], [4, 500]], ramp);
        let before = selection.clone();
        let mut expected = vec![0; 70 * 9 * 17];
        for (x, y, z) in (4..17).flat_map(|z| (3..9).flat_map(move |y| (2..69).map(move |x| (x, y, z)))) {
            expected[x + 70 * (y + 9 * z)] = ramp([x, y, z], 0);
        }
        assert_eq!(voxels(&selection), expected);
        assert_eq!(selection.bounds(), Some([[2, 69], [3, 9], [4, 17]]));
        let sum: f64 = expected.iter().map(|v| f64::from(*v) / 255.0).sum();
        assert!((selection.num_voxels() - sum).abs() < 1e-9 && (selection.volume_ml() - sum * 1e-3).abs() < 1e-12);

        // A second edit of one corner touches its bricks only, and the copy keeps what it had.
        let mut second = selection.change([[0, 3], [0, 4], [0, 5]], |_, _| 255);
        assert_eq!(second.places().collect::<Vec<_>>(), [[0, 0, 0]]);
        assert_eq!(selection.changed_since(&before), [[0, 0, 0]]);
        assert_eq!(voxels(&before), expected);
        selection.swap(&mut second);
        assert_eq!(voxels(&selection), expected);
        assert!(selection.changed_since(&before).is_empty());
        selection.swap(&mut second);
        assert_eq!(selection.get([0, 0, 0]), 255);
        selection.swap(&mut second);
        let mut first = undo;
        selection.swap(&mut first);
        assert!(selection.is_empty() && selection.bounds().is_none() && selection.bricks().next().is_none());
    }

    #[test]
    fn equal_bricks_are_in_memory_once() {
        let mut selection = empty([64, 64, 64]);
        // The same slope in each of 512 bricks.
        selection.change(whole(&selection), |[x, y, z], _| ((x % 8) * 30 + y % 8 + z % 8) as u8);
        let Brick::Voxels(first) = selection.brick([0, 0, 0]) else { panic!("uniform") };
        assert!(selection.bricks().all(|(_, b)| matches!(b, Brick::Voxels(v) if Arc::ptr_eq(v, first))));
        assert_eq!(selection.pool().num_bricks(), 1);
        // Bricks that nobody has any more are forgotten.
        selection.change(whole(&selection), |_, _| 9);
        assert!(selection.bricks().all(|(_, b)| matches!(b, Brick::Uniform(9))));
        assert_eq!(selection.pool().num_bricks(), 0);
    }

    #[test]
    fn beyond_the_grid_nothing_is_selected() {
        let mut selection = empty([9, 9, 9]);
        selection.change([[0, 99], [0, 99], [0, 99]], |_, _| 255);
        assert_eq!(selection.bounds(), Some([[0, 9]; 3]));
        assert_eq!(selection.num_voxels(), 729.0);
        assert!(selection.change([[5, 5], [0, 9], [0, 9]], |_, _| 0).is_empty());
        assert!(selection.change([[0, 9]; 3], |_, old| old).is_empty(), "what changes nothing is no change");
    }
}
