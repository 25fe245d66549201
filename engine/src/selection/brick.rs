//! Bricks of memberships, and the pool in which equal ones are found.

use std::collections::HashMap;
use std::hash::{BuildHasher as _, RandomState};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use super::{BRICK, BRICK_VOXELS, VoxelBox};

/// Memberships of 8³ voxels.
#[derive(Clone, Debug)]
pub enum Brick {
    /// All alike.
    Uniform(u8),
    /// One each; not all alike.
    Voxels(Arc<BrickVoxels>),
}

/// Memberships that are not all alike, with what is often asked of them.
#[derive(Debug)]
pub struct BrickVoxels {
    /// x fastest, 255 = 1.
    pub values: [u8; BRICK_VOXELS],
    /// Smallest membership.
    pub low: u8,
    /// Largest membership.
    pub high: u8,
    sum: u64,
    bounds: VoxelBox,
}

impl BrickVoxels {
    fn new(values: &[u8; BRICK_VOXELS]) -> Self {
        let (mut low, mut high, mut sum) = (u8::MAX, 0, 0);
        let mut bounds = [[BRICK, 0]; 3];
        for (i, &value) in values.iter().enumerate() {
            low = low.min(value);
            high = high.max(value);
            sum += u64::from(value);
            if value > 0 {
                for (bound, at) in bounds.iter_mut().zip([i % BRICK, i / BRICK % BRICK, i / (BRICK * BRICK)]) {
                    *bound = [bound[0].min(at), bound[1].max(at + 1)];
                }
            }
        }
        Self { values: *values, low, high, sum, bounds }
    }
}

impl Brick {
    /// Nothing in it is selected.
    pub const EMPTY: Self = Self::Uniform(0);

    /// Membership of a voxel, by its place in the brick.
    pub fn get(&self, [x, y, z]: [usize; 3]) -> u8 {
        match self {
            Self::Uniform(value) => *value,
            Self::Voxels(voxels) => voxels.values[x + BRICK * (y + BRICK * z)],
        }
    }

    /// Memberships, x fastest.
    pub fn values(&self) -> [u8; BRICK_VOXELS] {
        match self {
            Self::Uniform(value) => [*value; BRICK_VOXELS],
            Self::Voxels(voxels) => voxels.values,
        }
    }

    /// Smallest and largest membership.
    pub fn range(&self) -> [u8; 2] {
        match self {
            Self::Uniform(value) => [*value; 2],
            Self::Voxels(voxels) => [voxels.low, voxels.high],
        }
    }

    /// Whether nothing in it is selected.
    pub fn is_empty(&self) -> bool {
        matches!(self, Self::Uniform(0))
    }

    /// Whether it is the very same: uniform of one membership, or one place in memory.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Uniform(a), Self::Uniform(b)) => a == b,
            (Self::Voxels(a), Self::Voxels(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }

    /// Memory beyond the brick itself.
    pub(super) fn num_bytes(&self) -> usize {
        match self {
            Self::Uniform(_) => 0,
            // And the two counters of an Arc.
            Self::Voxels(_) => size_of::<BrickVoxels>() + 2 * size_of::<usize>(),
        }
    }

    /// Sum of memberships of a brick of which `room` voxels lie in the grid.
    pub(super) fn sum(&self, room: [usize; 3]) -> u64 {
        match self {
            Self::Uniform(value) => u64::from(*value) * room.iter().product::<usize>() as u64,
            Self::Voxels(voxels) => voxels.sum,
        }
    }

    /// The smallest box around its memberships above 0, within `room` voxels.
    pub(super) fn bounds(&self, room: [usize; 3]) -> Option<VoxelBox> {
        match self {
            Self::Uniform(0) => None,
            Self::Uniform(_) => Some(room.map(|n| [0, n])),
            Self::Voxels(voxels) => Some(voxels.bounds),
        }
    }
}

/// Where bricks are made, so that equal ones are made once.
#[derive(Debug, Default)]
pub struct BrickPool {
    found: Mutex<Found>,
    hasher: RandomState,
}

#[derive(Debug, Default)]
struct Found {
    /// By the hash of their memberships; of bricks with one hash the last.
    bricks: HashMap<u64, Weak<BrickVoxels>>,
    /// How many there may be before those that nobody has are thrown out.
    most: usize,
}

/// So few are not worth a search for those that nobody has.
const FEW: usize = 1024;

impl BrickPool {
    /// The brick of these memberships: one that somebody has already, if there is one.
    pub fn brick(&self, values: &[u8; BRICK_VOXELS]) -> Brick {
        if values.iter().all(|value| *value == values[0]) {
            return Brick::Uniform(values[0]);
        }
        let hash = self.hasher.hash_one(&values[..]);
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = found.bricks.get(&hash).and_then(Weak::upgrade)
            && known.values == *values
        {
            return Brick::Voxels(known);
        }
        let made = Arc::new(BrickVoxels::new(values));
        found.bricks.insert(hash, Arc::downgrade(&made));
        if found.bricks.len() > found.most.max(FEW) {
            found.bricks.retain(|_, brick| brick.strong_count() > 0);
            found.most = 2 * found.bricks.len();
        }
        Brick::Voxels(made)
    }

    /// Different bricks that somebody has.
    pub fn num_bricks(&self) -> usize {
        let found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        found.bricks.values().filter(|brick| brick.strong_count() > 0).count()
    }
}
