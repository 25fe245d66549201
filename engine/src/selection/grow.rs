//! Growing from seeds: what hangs together with them and has values like theirs.
//!
//! How unlike the seeds a path to a voxel must become at least (the minimax or bottleneck cost of the voxel) is found once, by
//! a flood that takes the voxels in the order of that cost; which voxels belong at a tolerance is then a threshold of it. The
//! flood goes as far as the tolerance asks and goes on where it stopped when that is raised.

use std::sync::Arc;

use rayon::prelude::*;

use super::fill::{Filling, filled, voxels_of};
use super::range::Range;
use super::{BRICK, BRICK_VOXELS, BrickPool, Connectivity, Edge, IN, Selection};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Volume, Voxels};

/// What a region grows from.
#[derive(Clone, Debug, PartialEq)]
pub struct Seeds {
    /// Voxels that belong to the region: at least one.
    pub seeds: Vec<[usize; 3]>,
    /// Voxels that do not: what hangs together with one of them at a lower cost than with a seed, or at the same cost on a
    /// shorter way, is left out. Seeds come first where both are one voxel.
    pub barred: Vec<[usize; 3]>,
    /// Data values that belong at no cost, from the lowest to the highest; those of the seeds, of several all between them,
    /// unless it is given.
    pub within: Option<[f64; 2]>,
    /// Which voxels hang together.
    pub connectivity: Connectivity,
}

impl Seeds {
    /// One seed with values like its own.
    pub fn at(seed: [usize; 3]) -> Self {
        Self { seeds: vec![seed], barred: Vec::new(), within: None, connectivity: Connectivity::Faces }
    }
}

/// Costs that are told apart; 15 bits.
const NUM_LEVELS: usize = (1 << 15) - 1;

/// Set where a voxel belongs to a barred one.
const BARRED: u16 = 1 << 15;

/// Nothing has come there.
const UNREACHED: u16 = u16::MAX;

/// Bits of a coordinate in the queues.
const BITS: u32 = 21;

/// A region that grows. The cost of a voxel is the largest distance of a data value to the interval of those that belong at no
/// cost, on the path to a seed where that is smallest, in steps of [`Growth::step`]. Voxels without a number are never reached.
///
/// Memory: two bytes a voxel in the bricks that the flood has come to, and eight for each voxel at its front.
#[derive(Debug)]
pub struct Growth {
    scan: Arc<Volume>,
    center: [f64; 2],
    step: f64,
    connectivity: Connectivity,
    bricks: Vec<Option<Box<[u16; BRICK_VOXELS]>>>,
    size: [usize; 3],
    /// Voxels to go on from, by the level at which they were reached: a queue each, and where its rest begins.
    queues: Vec<Vec<u64>>,
    level: usize,
    head: usize,
    /// Voxels of the region by level.
    counts: Vec<u64>,
}

impl Growth {
    /// A region that consists of its seeds as yet.
    ///
    /// # Errors
    /// A clause if there is no seed, one lies outside of the scan or where the scan has no number, or the range is empty.
    pub fn new(scan: &Arc<Volume>, seeds: &Seeds) -> std::result::Result<Self, String> {
        let dims = scan.grid.dims();
        if seeds.seeds.is_empty() {
            return Err("there is no seed to grow from".to_owned());
        }
        if dims.iter().any(|n| *n > 1 << BITS) {
            return Err("the scan has an axis of more than 2 097 152 voxels".to_owned());
        }
        for &[x, y, z] in seeds.seeds.iter().chain(&seeds.barred) {
            if x >= dims[0] || y >= dims[1] || z >= dims[2] {
                let [nx, ny, nz] = dims;
                return Err(format!("the seed at voxel {x}, {y}, {z} lies outside of the scan's {nx} x {ny} x {nz}"));
            }
            if !scan.value(x, y, z).is_finite() {
                return Err(format!("the scan has no value at the seed, voxel {x}, {y}, {z}"));
            }
        }
        let values = || seeds.seeds.iter().map(|&[x, y, z]| scan.value(x, y, z));
        let center = seeds
            .within
            .unwrap_or_else(|| [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]);
        if center[0].is_nan() || center[1].is_nan() || center[0] > center[1] {
            return Err(format!("no value lies from {} to {}", center[0], center[1]));
        }
        let (low, high) = scan.bricks().range();
        let (a, b) = (scan.rescale.value(low), scan.rescale.value(high));
        let most = (center[0] - a.min(b)).max(a.max(b) - center[1]).max(0.0);
        let finest = most / (NUM_LEVELS - 1) as f64;
        let is_whole = !matches!(scan.voxels, Voxels::F32(_) | Voxels::F64(_));
        // Of whole numbers, whole steps: then levels are costs, exactly.
        let unit = scan.rescale.slope.abs();
        let step = if is_whole && seeds.within.is_none() { unit * (finest / unit).ceil().max(1.0) } else { finest };
        let size = dims.map(|n| n.div_ceil(BRICK));
        let mut growth = Self {
            scan: scan.clone(),
            center,
            step: if step > 0.0 { step } else { 1.0 },
            connectivity: seeds.connectivity,
            bricks: vec![None; size.iter().product()],
            size,
            queues: vec![Vec::new(); NUM_LEVELS],
            level: 0,
            head: 0,
            counts: vec![0; NUM_LEVELS],
        };
        seeds.seeds.iter().for_each(|seed| growth.claim(*seed, 0, 0));
        seeds.barred.iter().for_each(|seed| growth.claim(*seed, 0, BARRED));
        Ok(growth)
    }

    /// The scan that it grows in.
    pub fn scan(&self) -> &Arc<Volume> {
        &self.scan
    }

    /// Data values that belong at no cost, lowest and highest.
    pub fn center(&self) -> [f64; 2] {
        self.center
    }

    /// Steps in which costs are told apart, in units of the values; for scans of whole numbers with fewer than 32 767 of
    /// them the unit itself, so that tolerances are exact.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The level of a cost or a tolerance.
    fn level_of(&self, cost: f64) -> usize {
        // A hair below a whole step is that step: rounding is no cost.
        ((cost / self.step - 1e-6).ceil().max(0.0) as usize).min(NUM_LEVELS - 1)
    }

    /// Lets the region grow to all that belongs at a tolerance, by at most `most` voxels (of those that are barred, too). Returns
    /// whether it is complete. Near voxels at equal costs come first, so what is there so far can be shown.
    ///
    /// # Errors
    /// [`Error::Cancelled`] on request; the region is then in a state to go on from.
    pub fn grow(&mut self, tolerance: f64, most: usize, progress: &Progress) -> Result<bool> {
        /// Voxels between two looks at whether to stop.
        const CHECK: usize = 1 << 14;
        let last = self.level_of(tolerance);
        let mut num = 0;
        while self.level <= last {
            while let Some(&packed) = self.queues[self.level].get(self.head) {
                if num >= most {
                    return Ok(false);
                }
                if num % CHECK == 0 {
                    progress.advance(CHECK as u64)?;
                }
                self.head += 1;
                num += 1;
                self.spread(packed);
            }
            if self.level == NUM_LEVELS - 1 {
                break;
            }
            self.queues[self.level] = Vec::new();
            self.head = 0;
            self.level += 1;
        }
        Ok(true)
    }

    fn spread(&mut self, packed: u64) {
        let mask = (1 << BITS) - 1;
        let voxel = [packed & mask, packed >> BITS & mask, packed >> (2 * BITS)].map(|n| n as usize);
        let owner = self.at(voxel) & BARRED;
        let (dims, connectivity) = (self.scan.grid.dims(), self.connectivity);
        let mut visit = |step: [isize; 3]| {
            let mut next = [0; 3];
            for a in 0..3 {
                match voxel[a].checked_add_signed(step[a]).filter(|n| *n < dims[a]) {
                    Some(n) => next[a] = n,
                    None => return,
                }
            }
            if self.at(next) != UNREACHED {
                return;
            }
            let value = self.scan.value(next[0], next[1], next[2]);
            if value.is_finite() {
                let cost = (self.center[0] - value).max(value - self.center[1]).max(0.0);
                // Paths never get cheaper.
                let level = self.level_of(cost).max(self.level);
                self.claim(next, level, owner);
            }
        };
        match connectivity {
            Connectivity::Faces => {
                for step in [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]] {
                    visit(step);
                }
            }
            Connectivity::Corners => {
                for i in (0..27).filter(|i| *i != 13) {
                    visit([i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]);
                }
            }
        }
    }

    fn brick_index(&self, voxel: [usize; 3]) -> usize {
        let [x, y, z] = voxel.map(|n| n / BRICK);
        x + self.size[0] * (y + self.size[1] * z)
    }

    fn at(&self, voxel: [usize; 3]) -> u16 {
        self.bricks[self.brick_index(voxel)].as_ref().map_or(UNREACHED, |brick| brick[index_in_brick(voxel)])
    }

    /// Gives a voxel its level and its owner, unless it has them.
    fn claim(&mut self, voxel: [usize; 3], level: usize, owner: u16) {
        let index = self.brick_index(voxel);
        let brick = self.bricks[index].get_or_insert_with(|| Box::new([UNREACHED; BRICK_VOXELS]));
        let claimed = &mut brick[index_in_brick(voxel)];
        if *claimed != UNREACHED {
            return;
        }
        *claimed = level as u16 | owner;
        if owner == 0 {
            self.counts[level] += 1;
        }
        let [x, y, z] = voxel.map(|n| n as u64);
        self.queues[level].push(x | y << BITS | z << (2 * BITS));
    }

    /// How many voxels belong at a tolerance, of those that the region has grown to.
    pub fn num_voxels(&self, tolerance: f64) -> u64 {
        self.counts[..=self.level_of(tolerance)].iter().sum()
    }

    /// The share of the scan's voxels that belong at a tolerance: a region that takes more than a quarter has mostly leaked.
    pub fn share(&self, tolerance: f64) -> f64 {
        self.num_voxels(tolerance) as f64 / self.scan.grid.num_voxels() as f64
    }

    /// The tolerance, up to `most`, at which the region grows most suddenly, and its voxels below and at it: where it leaks, if
    /// the second is many times the first. Of what it has grown to.
    pub fn leak(&self, most: f64) -> Option<(f64, [u64; 2])> {
        let mut below = 0;
        let mut worst = None;
        for (level, count) in self.counts[..=self.level_of(most)].iter().enumerate() {
            if below > 0 && *count > 0 {
                let ratio = *count as f64 / below as f64;
                if worst.is_none_or(|(known, _)| ratio > known) {
                    worst = Some((ratio, (level as f64 * self.step, [below, below + count])));
                }
            }
            below += count;
        }
        worst.map(|(_, leak)| leak)
    }

    /// The region at a tolerance, as far as it has grown. With an edge that is not crisp, its voxels have at least ½ of what
    /// their value makes them, and voxels beside it less than ½, as in [`select_range`](super::select_range).
    ///
    /// # Errors
    /// [`Error::Cancelled`] on request.
    pub fn region(&self, tolerance: f64, edge: Edge, pool: &Arc<BrickPool>, progress: &Progress) -> Result<Selection> {
        let last = self.level_of(tolerance) as u16;
        let is_in = |level: u16| level <= last;
        let kinds: Vec<Kind> = self
            .bricks
            .par_iter()
            .map(|brick| match brick {
                None => Kind::Out,
                Some(levels) if levels.iter().all(|l| is_in(*l)) => Kind::In,
                Some(levels) if levels.iter().any(|l| is_in(*l)) => Kind::Mixed,
                Some(_) => Kind::Out,
            })
            .collect();
        let dims = self.scan.grid.dims();
        let range = Range { low: self.center[0] - tolerance.max(0.0), high: self.center[1] + tolerance.max(0.0), edge };
        let place = |i: usize| [i % self.size[0], i / self.size[0] % self.size[1], i / (self.size[0] * self.size[1])];
        let neighbors = |i: usize| {
            let at = place(i);
            (0..3).flat_map(move |a| [-1_isize, 1].map(move |step| (a, step))).filter_map(move |(a, step)| {
                let mut next = at;
                next[a] = at[a].checked_add_signed(step).filter(|n| *n < self.size[a])?;
                Some(next[0] + self.size[0] * (next[1] + self.size[1] * next[2]))
            })
        };
        let has_edge = edge != Edge::Crisp;
        let places: Vec<[usize; 3]> = (0..kinds.len())
            .filter(|i| kinds[*i] != Kind::Out || has_edge && neighbors(*i).any(|n| kinds[n] != Kind::Out))
            .map(place)
            .collect();
        progress.begin("selecting", places.len() as u64);
        filled(self.scan.grid, pool, places, progress, |place| {
            let i = place[0] + self.size[0] * (place[1] + self.size[1] * place[2]);
            if kinds[i] == Kind::In && (!has_edge || neighbors(i).all(|n| kinds[n] == Kind::In)) {
                return Filling::Uniform(255);
            }
            Filling::Voxels(voxels_of(place, dims, |voxel| {
                let level = self.at(voxel);
                if is_in(level) {
                    return if has_edge { range.membership(&self.scan, voxel).max(IN) } else { 255 };
                }
                // What is barred borders the region as a cut does.
                if !has_edge || level & BARRED != 0 && level != UNREACHED {
                    return 0;
                }
                let touches = (0..3).any(|a| {
                    [-1_isize, 1].into_iter().any(|step| {
                        let mut next = voxel;
                        let Some(n) = voxel[a].checked_add_signed(step).filter(|n| *n < dims[a]) else {
                            return false;
                        };
                        next[a] = n;
                        is_in(self.at(next))
                    })
                });
                if touches { range.membership(&self.scan, voxel).min(IN - 1) } else { 0 }
            }))
        })
    }
}

/// How much of a brick belongs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    In,
    Mixed,
    Out,
}

fn index_in_brick(voxel: [usize; 3]) -> usize {
    let [x, y, z] = voxel.map(|n| n % BRICK);
    x + BRICK * (y + BRICK * z)
}

/// A region at once: all that hangs together with the seeds at a tolerance.
///
/// # Errors
/// [`Error::Scene`] as [`Growth::new`], [`Error::Cancelled`] on request.
pub fn select_grown(
    scan: &Arc<Volume>,
    seeds: &Seeds,
    tolerance: f64,
    edge: Edge,
    pool: &Arc<BrickPool>,
    progress: &Progress,
) -> Result<Selection> {
    if tolerance.is_nan() || tolerance < 0.0 {
        return Err(Error::scene(format!("{tolerance} is no tolerance"), "give a number of at least 0"));
    }
    let mut growth = Growth::new(scan, seeds).map_err(|what| Error::scene(what, "put the seed into the structure"))?;
    progress.begin("growing", 0);
    growth.grow(tolerance, usize::MAX, progress)?;
    growth.region(tolerance, edge, pool, progress)
}

#[cfg(test)]
mod tests;
