//! Union, intersection, difference and complement, brick by brick: what is uniform or shared costs nothing.

use rayon::prelude::*;

use super::{Brick, BrickDiff, Selection, place_in_chunk};
use crate::volume::labels::same_grid;

/// How a selection is put into another: memberships a (what is there) and b (what comes) become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Combination {
    /// b.
    Replace,
    /// max(a, b).
    Union,
    /// min(a, b).
    Intersect,
    /// min(a, 1 − b). What is half in both stays half in: a soft border minus itself leaves its middle.
    Subtract,
}

impl Combination {
    /// Of two memberships, 255 = 1.
    pub fn of(self, a: u8, b: u8) -> u8 {
        match self {
            Self::Replace => b,
            Self::Union => a.max(b),
            Self::Intersect => a.min(b),
            Self::Subtract => a.min(255 - b),
        }
    }
}

impl Selection {
    /// Puts `other` into this selection. Returns what the bricks were before. Costs the chunks that either has and does not
    /// share with the other.
    ///
    /// # Errors
    /// A clause if they are selections of different grids; see [`Selection::resampled_to`].
    pub fn combine(&mut self, other: &Self, how: Combination) -> Result<BrickDiff, String> {
        if !same_grid(&self.grid, &other.grid) {
            let words = |s: &Self| {
                let ([x, y, z], mm) = (s.grid.dims(), s.grid.spacing_mm());
                format!("{x} x {y} x {z} voxels of {:.3} x {:.3} x {:.3} mm", mm.x, mm.y, mm.z)
            };
            return Err(format!(
                "the selections lie on different grids ({} and {}) or in different places",
                words(self),
                words(other)
            ));
        }
        let this = &*self;
        let is_shared_pool = std::sync::Arc::ptr_eq(&self.pool, &other.pool);
        let num_bricks = self.size_in_bricks();
        let bricks: Vec<([usize; 3], Brick)> = (0..this.chunks.len())
            .into_par_iter()
            .flat_map_iter(|i| {
                let (a, b) = (&this.chunks[i], &other.chunks[i]);
                let is_unchanged = match (a, b, how) {
                    (None, None, _) | (None, _, Combination::Intersect | Combination::Subtract) => true,
                    (_, None, Combination::Union | Combination::Subtract) => true,
                    (Some(a), Some(b), Combination::Subtract) => a.sum == 0 || b.sum == 0,
                    (Some(a), Some(b), _) => std::sync::Arc::ptr_eq(a, b),
                    _ => false,
                };
                let range = if is_unchanged { 0..0 } else { 0..super::CHUNK.pow(3) };
                let first = this.first_brick(i);
                range.filter_map(move |j| {
                    let place = place_in_chunk(first, j);
                    if (0..3).any(|axis| place[axis] >= num_bricks[axis]) {
                        return None;
                    }
                    let of = |chunk: &Option<std::sync::Arc<super::Chunk>>| {
                        chunk.as_ref().map_or(Brick::EMPTY, |chunk| chunk.bricks[j].clone())
                    };
                    let (a, b) = (of(a), of(b));
                    let b = if is_shared_pool { b } else { this.adopted(b) };
                    let combined = this.combined(&a, &b, how);
                    (!combined.is_same(&a)).then_some((place, combined))
                })
            })
            .collect();
        Ok(self.replace(bricks))
    }

    /// A brick of another pool as one of this.
    fn adopted(&self, brick: Brick) -> Brick {
        match brick {
            Brick::Uniform(_) => brick,
            Brick::Voxels(voxels) => self.pool.brick(&voxels.values),
        }
    }

    fn combined(&self, a: &Brick, b: &Brick, how: Combination) -> Brick {
        use Combination::{Intersect, Replace, Subtract, Union};
        match (how, a, b) {
            (Replace, _, _) => b.clone(),
            (_, Brick::Uniform(a), Brick::Uniform(b)) => Brick::Uniform(how.of(*a, *b)),
            (Union | Intersect, _, _) if a.is_same(b) => a.clone(),
            // What leaves the other as it is, and what takes it all.
            (Union | Subtract, _, Brick::Uniform(0)) | (Intersect, _, Brick::Uniform(255)) => a.clone(),
            (Union, Brick::Uniform(0), _) | (Intersect, Brick::Uniform(255), _) => b.clone(),
            (Union, Brick::Uniform(255), _) | (Union, _, Brick::Uniform(255)) => Brick::Uniform(255),
            (Intersect | Subtract, Brick::Uniform(0), _)
            | (Intersect, _, Brick::Uniform(0))
            | (Subtract, _, Brick::Uniform(255)) => Brick::EMPTY,
            _ => {
                let mut values = a.values();
                values.iter_mut().zip(b.values()).for_each(|(a, b)| *a = how.of(*a, b));
                self.pool.brick(&values)
            }
        }
    }

    /// 1 − f everywhere in the grid. Returns what the bricks were before. Costs every brick of the grid, most of them next to
    /// nothing.
    pub fn invert(&mut self) -> BrickDiff {
        let dims = self.grid.dims();
        let bricks = super::fill::places(dims.map(|n| [0, n])).into_par_iter().with_min_len(256).map(|place| {
            let inverted = match self.brick(place) {
                Brick::Uniform(value) => Brick::Uniform(255 - value),
                Brick::Voxels(voxels) => self.pool.brick(&voxels.values.map(|value| 255 - value)),
            };
            (place, inverted)
        });
        let bricks = bricks.collect();
        self.replace(bricks)
    }
}
