//! Selection volumes (thesis §2.3.1, §2.3.2): how much each voxel of a grid belongs to a structure, from 0 (not at all) to 1.
//!
//! Sparse, fuzzy and often edited: so they are kept in bricks of 8³ voxels, which are never changed but replaced. A copy shares
//! all of its bricks with the original, an edit makes new ones where it touches only, equal bricks are in memory once, and what
//! an edit has changed is found by comparing addresses: that is what undo steps and uploads are made of.

//!
//! What makes one: [`Shape`] and [`Lasso`] in space, a range of a scan's values ([`select_range`]), growing from seeds
//! ([`Growth`]), the structures of label maps ([`from_label_maps`]), files ([`read_selections`]). Each gives a selection of its
//! own, and [`Selection::combine`] puts it into another; only the brush ([`Stroke`]) edits in place. "In" means a membership of
//! at least 0.5 ([`IN`]) wherever there must be a border: distances, islands, holes, label maps.

mod brick;
mod combine;
mod distance_field;
mod file;
mod fill;
mod grow;
mod lasso;
mod limits;
mod morphology;
mod partition;
mod range;
mod resample;
mod runs;
mod shape;
mod stroke;
mod structures;

use std::sync::Arc;

pub use brick::{Brick, BrickPool, BrickVoxels};
pub use combine::Combination;
pub use distance_field::DistanceField;
pub use file::{read_selections, write_fractional, write_segmentation};
pub use grow::{Growth, Seeds, select_grown};
pub use lasso::{DepthRange, Lasso, ScreenFromWorld, projection};
pub use limits::{Limits, ValueLimit};
pub use morphology::{Holes, Islands};
pub use partition::{MOST_SIGMA, smooth_partition};
pub use range::{Edge, select_range};
use rayon::prelude::*;
pub use runs::Connectivity;
pub use shape::Shape;
pub use stroke::{Brush, BrushMode, Profile, Stroke};
pub use structures::{Structure, from_label_maps, make_distinct, to_layers, to_partition};

use crate::spaces::Grid;
pub use crate::volume::bricks::BRICK;
use crate::volume::{Volume, Voxel as _};
use crate::with_voxels;

/// Voxels in a brick.
pub const BRICK_VOXELS: usize = BRICK * BRICK * BRICK;

/// The smallest membership that counts as in, where something must be either in or out: 128/255, the first above 0.5.
pub const IN: u8 = 128;

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

    /// Whether every voxel is either in or out, as in a label map.
    pub fn is_crisp(&self) -> bool {
        self.bricks().all(|(_, brick)| match brick {
            Brick::Uniform(value) => *value == u8::MAX,
            Brick::Voxels(voxels) => voxels.values.iter().all(|f| matches!(f, 0 | &u8::MAX)),
        })
    }

    /// Whether nothing is selected.
    pub fn is_empty(&self) -> bool {
        self.chunks.iter().flatten().all(|chunk| chunk.sum == 0)
    }

    /// The mean data value of a scan on its grid, each voxel weighing as much as it belongs; `None` if no voxel with a number
    /// belongs, or the scan has another number of voxels.
    pub fn mean_of(&self, scan: &Volume) -> Option<f64> {
        let dims = self.grid.dims();
        if scan.grid.dims() != dims {
            return None;
        }
        let bricks: Vec<_> = self.bricks().collect();
        let sums = with_voxels!(&scan.voxels, stored => bricks.into_par_iter().with_min_len(64).map(|(place, brick)| {
            let values = brick.values();
            let [nx, ny, nz] = self.room(place);
            let (mut sum, mut weight) = (0.0, 0.0);
            for (y, z) in (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z))) {
                let row = dims[0] * (place[1] * BRICK + y + dims[1] * (place[2] * BRICK + z)) + place[0] * BRICK;
                for (f, value) in values[BRICK * (y + BRICK * z)..].iter().zip(&stored[row..row + nx]) {
                    if *f > 0 && value.is_finite() {
                        sum += f64::from(*f) * value.to_f64();
                        weight += f64::from(*f);
                    }
                }
            }
            (sum, weight)
        }).collect::<Vec<_>>());
        // One after the other, so that it is the same in every run.
        let (sum, weight) = sums.into_iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        (weight > 0.0).then(|| scan.rescale.value(sum / weight))
    }

    /// How many of its voxels ([`IN`] and above) have which of a scan's values, in `num_bins` equal bins over `range` (first and
    /// last data value; what is beyond is in the outer ones). Voxels without a number do not count; all are 0 if the scan has another
    /// number of voxels.
    pub fn histogram_of(&self, scan: &Volume, range: (f64, f64), num_bins: usize) -> Vec<u64> {
        let dims = self.grid.dims();
        if scan.grid.dims() != dims || num_bins == 0 {
            return vec![0; num_bins];
        }
        let bricks: Vec<_> = self.bricks().collect();
        let scale = if range.1 > range.0 { num_bins as f64 / (range.1 - range.0) } else { 0.0 };
        let bin = |value: f64| (((value - range.0) * scale).max(0.0) as usize).min(num_bins - 1);
        with_voxels!(&scan.voxels, stored => bricks.into_par_iter().with_min_len(64).fold(
            || vec![0; num_bins],
            |mut counts, (place, brick)| {
                let values = brick.values();
                let [nx, ny, nz] = self.room(place);
                for (y, z) in (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z))) {
                    let row = dims[0] * (place[1] * BRICK + y + dims[1] * (place[2] * BRICK + z)) + place[0] * BRICK;
                    for (f, value) in values[BRICK * (y + BRICK * z)..].iter().zip(&stored[row..row + nx]) {
                        if *f >= IN && value.is_finite() {
                            counts[bin(scan.rescale.value(value.to_f64()))] += 1;
                        }
                    }
                }
                counts
            },
        ).reduce(|| vec![0; num_bins], |a, b| a.iter().zip(&b).map(|(a, b)| a + b).collect()))
    }

    /// Whether it is a copy of another one that neither was edited since.
    pub fn is_copy_of(&self, other: &Self) -> bool {
        let same = |(a, b): (&Option<Arc<Chunk>>, &Option<Arc<Chunk>>)| match (a, b) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        self.chunks.len() == other.chunks.len() && self.chunks.iter().zip(&other.chunks).all(same)
    }

    /// Memberships of a box, x fastest.
    ///
    /// # Panics
    /// If it reaches beyond the grid.
    pub fn values(&self, voxels: VoxelBox) -> Vec<u8> {
        let dims = self.grid.dims();
        assert!((0..3).all(|a| voxels[a][1] <= dims[a]), "box {voxels:?} of {dims:?}");
        let [nx, ny, nz] = voxels.map(|[from, to]| to.saturating_sub(from));
        let mut values = vec![0; nx * ny * nz];
        for place in fill::places(voxels) {
            let brick = self.brick(place);
            if brick.is_empty() {
                continue;
            }
            let part: VoxelBox = std::array::from_fn(|a| {
                let first = place[a] * BRICK;
                [voxels[a][0].max(first), voxels[a][1].min(first + BRICK)]
            });
            for z in part[2][0]..part[2][1] {
                for y in part[1][0]..part[1][1] {
                    let start = nx * (y - voxels[1][0] + ny * (z - voxels[2][0]));
                    let row = &mut values[start + part[0][0] - voxels[0][0]..start + part[0][1] - voxels[0][0]];
                    match brick {
                        Brick::Uniform(value) => row.fill(*value),
                        Brick::Voxels(brick) => {
                            let start = BRICK * (y % BRICK + BRICK * (z % BRICK)) + part[0][0] % BRICK;
                            row.copy_from_slice(&brick.values[start..start + row.len()]);
                        }
                    }
                }
            }
        }
        values
    }

    /// Puts bricks in their places; returns what was there, of those that differ.
    ///
    /// # Panics
    /// If a place lies outside the grid.
    pub fn replace(&mut self, bricks: Vec<([usize; 3], Brick)>) -> BrickDiff {
        let differs = |(place, brick): &([usize; 3], Brick)| !self.brick(*place).is_same(brick);
        let bricks = bricks.into_iter().map(|(place, brick)| (place, self.clipped(place, brick)));
        let mut diff = BrickDiff { bricks: bricks.filter(differs).collect() };
        self.swap(&mut diff);
        diff
    }

    /// How many voxels of a brick lie in the grid, along x, y, z.
    fn room(&self, place: [usize; 3]) -> [usize; 3] {
        std::array::from_fn(|a| self.grid.dims()[a].saturating_sub(place[a] * BRICK).min(BRICK))
    }

    /// The brick with nothing beyond the grid.
    fn clipped(&self, place: [usize; 3], brick: Brick) -> Brick {
        let room = self.room(place);
        if brick.is_empty() || room == [BRICK; 3] {
            return brick;
        }
        let mut values = brick.values();
        let is_outside = |i: usize| {
            let at = [i % BRICK, i / BRICK % BRICK, i / (BRICK * BRICK)];
            (0..3).any(|a| at[a] >= room[a])
        };
        values.iter_mut().enumerate().filter(|(i, _)| is_outside(*i)).for_each(|(_, value)| *value = 0);
        self.pool.brick(&values)
    }

    /// Changes the voxels of a box, clipped to the grid: `change` gets a voxel's place and membership and gives its new one.
    /// Returns what the bricks were before. Work and memory are those of the bricks that the box touches.
    pub fn change(&mut self, voxels: VoxelBox, change: impl Fn([usize; 3], u8) -> u8 + Sync) -> BrickDiff {
        let dims = self.grid.dims();
        let voxels: VoxelBox = std::array::from_fn(|a| voxels[a].map(|n| n.min(dims[a])));
        if voxels.iter().any(|[from, to]| from >= to) {
            return BrickDiff::default();
        }
        let changed = fill::places(voxels).into_par_iter().with_min_len(16).filter_map(|place| {
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
        let room = |j: usize| self.room(place_in_chunk(first, j));
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
mod storage_tests;
#[cfg(test)]
mod tests;
