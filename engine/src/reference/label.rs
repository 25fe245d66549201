//! Borders of regions by two look-ups (docs/rendering.md §8): which label a place has, and how much of it its look has.

use std::collections::{BTreeMap, HashMap};

use glam::{DMat3, DVec3};

use super::region::{end_face, smoothstep};
use super::sample::trilinear;
use super::style::Face;
use crate::scene::Region;
use crate::volume::bricks::BRICK;

/// Change of what shows from one look to another, as a share of the larger, from which on their border is a face.
const DIFFERENT: f64 = 0.25;

/// The labels of an object's voxels: 0 = background, else region + 1; and their numbers, brick by brick.
#[derive(Clone, Debug)]
pub struct Labels {
    dims: [usize; 3],
    bricks: [usize; 3],
    of_voxel: Vec<u32>,
    numbers: Vec<HashMap<u32, f64>>,
}

impl Labels {
    /// Of regions, of which there is one at least.
    pub fn new(regions: &[Region]) -> Self {
        let dims = regions[0].selection.grid().dims();
        let [nx, ny, _] = dims;
        let of_voxel: Vec<u32> = (0..dims.iter().product())
            .map(|i: usize| label(regions.iter().map(|r| r.selection.get([i % nx, i / nx % ny, i / (nx * ny)]))))
            .collect();
        let bricks = dims.map(|n| n.div_ceil(BRICK));
        let mut labels = Self { dims, bricks, of_voxel, numbers: Vec::new() };
        let [bx, by, _] = bricks;
        labels.numbers =
            (0..bricks.iter().product()).map(|i| labels.numbered([i % bx, i / bx % by, i / (bx * by)])).collect();
        labels
    }

    /// The label of a voxel; beyond the grid its edge goes on.
    fn at(&self, voxel: [i64; 3]) -> u32 {
        let [x, y, z]: [usize; 3] = std::array::from_fn(|a| voxel[a].clamp(0, self.dims[a] as i64 - 1) as usize);
        self.of_voxel[x + self.dims[0] * (y + self.dims[1] * z)]
    }

    /// The numbers of the labels of a brick and of the voxels around it.
    fn numbered(&self, brick: [usize; 3]) -> HashMap<u32, f64> {
        let low = brick.map(|b| (b * BRICK) as i64 - 1);
        let edge = BRICK as i64 + 2;
        let mut neighbors: BTreeMap<(u32, u32), i64> = BTreeMap::new();
        let mut pieces: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for i in 0..edge.pow(3) {
            let offset = [i % edge, i / edge % edge, i / (edge * edge)];
            let voxel: [i64; 3] = std::array::from_fn(|a| low[a] + offset[a]);
            let own = self.at(voxel);
            pieces.insert(own, vec![own]);
            for axis in (0..3).filter(|axis| offset[*axis] + 1 < edge) {
                let mut next = voxel;
                next[axis] += 1;
                let other = self.at(next);
                if other != own {
                    *neighbors.entry((own.min(other), own.max(other))).or_default() += 1;
                }
            }
        }
        let mut pairs: Vec<_> = neighbors.into_iter().collect();
        pairs.sort_by_key(|&(pair, count)| (-count, pair));
        // Pieces of the path by their first labels: two ends meet where they are those of different pieces.
        let mut pieces: Vec<Vec<u32>> = pieces.into_values().collect();
        for ((a, b), _) in pairs {
            let with_end = |label: u32| pieces.iter().position(|p| p[0] == label || p[p.len() - 1] == label);
            if let (Some(i), Some(j)) = (with_end(a), with_end(b))
                && i != j
            {
                let mut second = pieces.remove(i.max(j));
                let first = &mut pieces[i.min(j)];
                if first[0] == a || first[0] == b {
                    first.reverse();
                }
                if second[0] != a && second[0] != b {
                    second.reverse();
                }
                first.append(&mut second);
            }
        }
        for piece in &mut pieces {
            if piece[0] > piece[piece.len() - 1] {
                piece.reverse();
            }
        }
        pieces.sort();
        pieces.into_iter().flatten().zip(0..).map(|(label, number)| (label, f64::from(number))).collect()
    }

    /// The brick of an index position, for [`Labels::share`].
    fn brick(&self, p: DVec3) -> &HashMap<u32, f64> {
        let at = ((p + 0.5) / BRICK as f64).floor().to_array();
        let [x, y, z]: [usize; 3] = std::array::from_fn(|a| (at[a].max(0.0) as usize).min(self.bricks[a] - 1));
        &self.numbers[x + self.bricks[0] * (y + self.bricks[1] * z)]
    }

    /// The label nearest to `p`, in numbers of a brick, and the share that its look has.
    fn look_up(&self, numbers: &HashMap<u32, f64>, p: DVec3) -> (usize, f64) {
        let nearest = self.at((p + 0.5).floor().to_array().map(|x| x as i64));
        let linear =
            trilinear(self.dims, p, |x, y, z| numbers[&self.of_voxel[x + self.dims[0] * (y + self.dims[1] * z)]]);
        let t = (linear - numbers[&nearest]).abs();
        (nearest as usize, (1.0 - (2.0 * t).powi(2)).max(0.0))
    }

    /// w of the look that index position `p` has: its position among the looks, and how much it has; all others have nothing.
    pub fn share(&self, p: DVec3) -> (usize, f64) {
        self.look_up(self.brick(p), p)
    }

    /// The face at `p` of what shows, where a region ends. `opacities` = how much of each look shows here, `to_world` = M⁻ᵀ.
    pub fn cut_face(&self, p: DVec3, opacities: &[f64], to_world: DMat3) -> Face {
        let numbers = self.brick(p);
        let places = DVec3::AXES.into_iter().flat_map(|e| [p - 0.5 * e, p + 0.5 * e]);
        let nearest: Vec<f64> = places.map(|p| opacities[self.look_up(numbers, p).0]).collect();
        let most = nearest.iter().copied().fold(0.0, f64::max);
        let least = nearest.iter().copied().fold(f64::INFINITY, f64::min);
        let differ = if most > 0.0 { smoothstep(0.0, DIFFERENT, (most - least) / most) } else { 0.0 };
        let shown = |p: DVec3| {
            let (look, share) = self.look_up(numbers, p);
            share * opacities[look]
        };
        let face = end_face(shown, p, to_world);
        Face { weight: differ * face.weight, ..face }
    }
}

/// The look with the largest share of a voxel with these memberships: of equal ones the first region, the background last.
fn label(memberships: impl Iterator<Item = u8>) -> u32 {
    let memberships: Vec<i32> = memberships.map(i32::from).collect();
    let rest = (255 - memberships.iter().sum::<i32>()).max(0);
    let most = memberships.iter().copied().max().unwrap_or(0);
    if rest > most { 0 } else { 1 + memberships.iter().position(|f| *f == most).unwrap_or(0) as u32 }
}
