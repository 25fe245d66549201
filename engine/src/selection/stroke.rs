//! The brush: dabs along a path, as one edit.

use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use super::fill::{places, point, quantized, voxel_box};
use super::{BRICK, BRICK_VOXELS, BrickDiff, IN, Limits, Selection, VoxelBox};

/// How a dab fades from its center to its radius.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Profile {
    /// 1 up to the radius, with a border one voxel wide.
    #[default]
    Hard,
    /// A Gaussian with half the radius as its standard deviation, lowered so that it is 0 at the radius:
    /// (e^(−2t²) − e^(−2)) / (1 − e^(−2)), t being the distance in radii; ½ at 0.53.
    Soft,
}

/// What a brush does to the membership f of a voxel that its stroke covers to the degree c.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BrushMode {
    /// max(f, c): painting twice is painting once.
    #[default]
    Paint,
    /// f + c − f c: every stroke adds to what is there.
    Build,
    /// f (1 − c).
    Erase,
}

/// A round brush.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brush {
    /// In mm, above 0.
    pub radius_mm: f64,
    /// Its border.
    pub profile: Profile,
    /// Its coverage in the middle, above 0, up to 1.
    pub strength: f64,
    /// What it does.
    pub mode: BrushMode,
}

/// A stroke of a brush over a selection: an edited copy of it, and in the end what to [`Selection::swap`] into the original.
/// Dropping it leaves the original as it was.
///
/// A voxel is covered as much as the nearest point of the path covers it: overlapping dabs of one stroke do not add up, and the
/// result depends neither on how often the pointer was sampled nor on the speed of the hand. The part of a dab that lies beyond
/// the grid is lost.
#[derive(Debug)]
pub struct Stroke {
    before: Selection,
    now: Selection,
    brush: Brush,
    limits: Limits,
    /// Of bricks that it came across, 255 = 1.
    coverage: HashMap<[usize; 3], Box<[u8; BRICK_VOXELS]>>,
    last: Option<DVec3>,
}

impl Stroke {
    /// A stroke that has touched nothing yet.
    ///
    /// # Errors
    /// A clause if radius or strength are out of range, or the limits are of another grid.
    pub fn new(selection: &Selection, brush: Brush, limits: Limits) -> Result<Self, String> {
        limits.check(selection.grid())?;
        if !(brush.radius_mm > 0.0 && brush.radius_mm.is_finite()) {
            return Err(format!("the brush has a radius of {} mm, where it takes one above 0", brush.radius_mm));
        }
        if !(brush.strength > 0.0 && brush.strength <= 1.0) {
            return Err(format!("the brush has a strength of {}, where it takes one above 0, up to 1", brush.strength));
        }
        let (before, now) = (selection.clone(), selection.clone());
        Ok(Self { before, now, brush, limits, coverage: HashMap::new(), last: None })
    }

    /// Another radius from here on, for a pen that reports pressure. What is no radius changes nothing.
    pub fn set_radius_mm(&mut self, radius_mm: f64) {
        if radius_mm > 0.0 && radius_mm.is_finite() {
            self.brush.radius_mm = radius_mm;
        }
    }

    /// Goes on to a point in the world, or begins there. Returns the bricks that changed. A point that is not finite is left
    /// out. Takes time by the voxels that the brush sweeps over since the last point, whatever the size of the grid.
    pub fn dab_to(&mut self, point_mm: DVec3) -> Vec<[usize; 3]> {
        if !point_mm.is_finite() {
            return Vec::new();
        }
        let from_mm = self.last.replace(point_mm).unwrap_or(point_mm);
        let sweep = Sweep::new(&self.now, self.brush, from_mm, point_mm);
        let coverage = if self.limits.connected { self.connected(&sweep) } else { self.covered(&sweep) };
        let mut bricks = Vec::new();
        for (place, new) in coverage {
            let so_far = self.coverage.entry(place).or_insert_with(|| Box::new([0; BRICK_VOXELS]));
            let mut grew = false;
            for (old, new) in so_far.iter_mut().zip(new.iter()) {
                grew |= new > old;
                *old = (*old).max(*new);
            }
            if grew {
                let mut values = self.before.brick(place).values();
                values.iter_mut().zip(so_far.iter()).for_each(|(f, c)| *f = applied(self.brush.mode, *f, *c));
                bricks.push((place, self.now.pool().brick(&values)));
            }
        }
        self.now.replace(bricks).places().collect()
    }

    /// Lifts the brush: the next point begins another part of the path, with nothing painted on the way there.
    pub fn lift(&mut self) {
        self.last = None;
    }

    /// The selection with the stroke so far.
    pub fn selection(&self) -> &Selection {
        &self.now
    }

    /// The bricks as the stroke leaves them: swapped into the selection that it began with, they are what undoes it.
    pub fn finish(self) -> BrickDiff {
        let places = self.now.changed_since(&self.before);
        BrickDiff { bricks: places.into_iter().map(|place| (place, self.now.brick(place).clone())).collect() }
    }

    /// The coverage of the bricks that a sweep touches, limits included but for what hangs together.
    fn covered(&self, sweep: &Sweep) -> Vec<([usize; 3], Box<[u8; BRICK_VOXELS]>)> {
        let places = places(sweep.voxels).into_par_iter().with_min_len(8);
        let covered = places.filter(|place| sweep.may_touch(*place)).map(|place| {
            let coverage = super::fill::voxels_of(place, self.now.grid().dims(), |voxel| {
                self.limits.of(voxel, sweep.coverage(point(voxel)))
            });
            (place, coverage)
        });
        covered.filter(|(_, coverage)| coverage.iter().any(|c| *c > 0)).collect()
    }

    /// The same, of what hangs together with the path.
    fn connected(&self, sweep: &Sweep) -> Vec<([usize; 3], Box<[u8; BRICK_VOXELS]>)> {
        let voxels = sweep.voxels;
        let size = voxels.map(|[from, to]| to.saturating_sub(from));
        if size.contains(&0) {
            return Vec::new();
        }
        let mut bricks: HashMap<_, _> = self.covered(sweep).into_iter().collect();
        let at = |voxel: [usize; 3]| -> usize {
            let [x, y, z] = std::array::from_fn(|a| voxel[a] - voxels[a][0]);
            x + size[0] * (y + size[1] * z)
        };
        // A brush of less than full strength has voxels that are in, too.
        let allowed: Vec<u8> = {
            let full = Sweep { brush: Brush { strength: 1.0, profile: Profile::Hard, ..sweep.brush }, ..*sweep };
            let mut allowed = vec![0; size.iter().product()];
            allowed.par_chunks_mut(size[0] * size[1]).enumerate().for_each(|(dz, slice)| {
                for (i, value) in slice.iter_mut().enumerate() {
                    let voxel = [voxels[0][0] + i % size[0], voxels[1][0] + i / size[0], voxels[2][0] + dz];
                    let covered = full.coverage(point(voxel));
                    *value = if covered >= IN { self.limits.of(voxel, 255) } else { 0 };
                }
            });
            allowed
        };
        let mut is_reached = vec![false; allowed.len()];
        let mut queue = Vec::new();
        for middle in sweep.path() {
            // The voxels around it: the path may miss a surface by a part of a voxel.
            for voxel in super::fill::voxels_around(middle, self.now.grid().dims()) {
                let is_in_box = (0..3).all(|a| (voxels[a][0]..voxels[a][1]).contains(&voxel[a]));
                if is_in_box && allowed[at(voxel)] >= IN && !is_reached[at(voxel)] {
                    is_reached[at(voxel)] = true;
                    queue.push(voxel);
                }
            }
        }
        while let Some(voxel) = queue.pop() {
            for a in 0..3 {
                for step in [-1_isize, 1] {
                    let mut next = voxel;
                    let Some(moved) = voxel[a].checked_add_signed(step) else { continue };
                    next[a] = moved;
                    if (voxels[a][0]..voxels[a][1]).contains(&moved) && allowed[at(next)] >= IN && !is_reached[at(next)]
                    {
                        is_reached[at(next)] = true;
                        queue.push(next);
                    }
                }
            }
        }
        // What is partly in goes with what it touches.
        let is_kept = |voxel: [usize; 3]| {
            let near = |a: usize| voxel[a].saturating_sub(1).max(voxels[a][0])..(voxel[a] + 2).min(voxels[a][1]);
            is_reached[at(voxel)]
                || allowed[at(voxel)] < IN
                    && near(2).any(|z| near(1).any(|y| near(0).any(|x| is_reached[at([x, y, z])])))
        };
        for (place, coverage) in &mut bricks {
            for (i, c) in coverage.iter_mut().enumerate().filter(|(_, c)| **c > 0) {
                let offset = [i % BRICK, i / BRICK % BRICK, i / (BRICK * BRICK)];
                let voxel = std::array::from_fn(|a| place[a] * BRICK + offset[a]);
                let is_in_box = (0..3).all(|a| (voxels[a][0]..voxels[a][1]).contains(&voxel[a]));
                if !(is_in_box && is_kept(voxel)) {
                    *c = 0;
                }
            }
        }
        bricks.into_iter().collect()
    }
}

/// What becomes of a membership that is covered by `c`, 255 = 1.
fn applied(mode: BrushMode, f: u8, c: u8) -> u8 {
    let (wide_f, wide_c) = (u32::from(f), u32::from(c));
    let product = (wide_f * wide_c + 127) / 255;
    match mode {
        BrushMode::Paint => f.max(c),
        BrushMode::Build => (wide_f + wide_c - product) as u8,
        BrushMode::Erase => (wide_f - product) as u8,
    }
}

/// A brush that went straight from one point to the next.
#[derive(Clone, Copy)]
struct Sweep {
    brush: Brush,
    world_from_index: glam::DAffine3,
    index_from_world: glam::DAffine3,
    from_mm: DVec3,
    to_mm: DVec3,
    /// Half the diagonal of a brick, in mm.
    brick_reach_mm: f64,
    /// What it may touch.
    voxels: VoxelBox,
    shortest_mm: f64,
}

impl Sweep {
    fn new(selection: &Selection, brush: Brush, from_mm: DVec3, to_mm: DVec3) -> Self {
        let grid = selection.grid();
        let (world_from_index, index_from_world) = (grid.world_from_index(), grid.index_from_world());
        // Around a ball, per axis of the grid.
        let rows = index_from_world.matrix3.transpose();
        let half = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length()) * brush.radius_mm + 0.9;
        let (a, b) = (index_from_world.transform_point3(from_mm), index_from_world.transform_point3(to_mm));
        let m = world_from_index.matrix3;
        let diagonals = [[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]];
        let diagonal = diagonals.map(|d| (m * DVec3::from_array(d)).length()).into_iter().fold(0.0, f64::max);
        Self {
            brush,
            world_from_index,
            index_from_world,
            from_mm,
            to_mm,
            brick_reach_mm: 0.5 * BRICK as f64 * diagonal,
            voxels: voxel_box(a.min(b) - half, a.max(b) + half, grid.dims()),
            shortest_mm: grid.spacing_mm().min_element(),
        }
    }

    /// From the nearest point of the path to a point, in mm.
    fn offset_mm(&self, at_mm: DVec3) -> DVec3 {
        let along = self.to_mm - self.from_mm;
        let length_squared = along.length_squared();
        let t = if length_squared > 0.0 {
            ((at_mm - self.from_mm).dot(along) / length_squared).clamp(0.0, 1.0)
        } else {
            0.0
        };
        at_mm - (self.from_mm + t * along)
    }

    fn may_touch(&self, place: [usize; 3]) -> bool {
        let middle = point(place.map(|n| n * BRICK)) + 0.5 * (BRICK as f64 - 1.0);
        let distance = self.offset_mm(self.world_from_index.transform_point3(middle)).length();
        distance <= self.brush.radius_mm + self.brick_reach_mm
    }

    /// At a voxel index, 255 = 1.
    fn coverage(&self, at: DVec3) -> u8 {
        let offset = self.offset_mm(self.world_from_index.transform_point3(at));
        let distance = offset.length();
        let radius = self.brush.radius_mm;
        let coverage = match self.brush.profile {
            Profile::Hard => {
                // The voxel's extent toward the border.
                let width = if distance > 0.0 {
                    (self.world_from_index.matrix3.transpose() * (offset / distance)).length()
                } else {
                    self.shortest_mm
                };
                0.5 + (radius - distance) / width
            }
            Profile::Soft => {
                let t = (distance / radius).min(1.0);
                let floor = (-2.0_f64).exp();
                ((-2.0 * t * t).exp() - floor) / (1.0 - floor)
            }
        };
        quantized(self.brush.strength * coverage.clamp(0.0, 1.0))
    }

    /// Points of the path, in voxel indices, half a voxel apart.
    fn path(&self) -> impl Iterator<Item = DVec3> + use<> {
        let [a, b] = [self.from_mm, self.to_mm].map(|p| self.index_from_world.transform_point3(p));
        let n = (2.0 * (b - a).abs().max_element()).ceil().clamp(1.0, 1e5) as usize;
        (0..=n).map(move |i| a.lerp(b, i as f64 / n as f64))
    }
}

#[cfg(test)]
mod tests;
