//! Distances to the surface of a selection, in mm, on any grid.
//!
//! The surface is where the memberships, linear between neighboring voxels, cross ½. Every voxel beside it gets the nearest point
//! of the plane through its crossings along the axes, with the plane's normal. The nearest of these voxels is found for every
//! other by the separable Euclidean distance transform (P. Felzenszwalb and D. Huttenlocher, Distance Transforms of Sampled
//! Functions, 2012), which is exact on grids with right angles; on sheared ones neighbors then exchange what they found until
//! it is the nearest in space. The distance is that to the plane's point, less what the point is beside the foot of the
//! perpendicular, for up to half a voxel: points lie a voxel apart.

use glam::{DMat3, DVec3, Vec3};

use crate::selection::fill::{places, quantized};
use crate::selection::{IN, Selection, VoxelBox};
use crate::spaces::Grid;

/// No point is known.
const NOWHERE: u32 = u32::MAX;

/// Where ½ lies between memberships.
const HALF: f64 = 127.5;

/// How distances up to a bound are found on a grid.
pub struct Distances {
    world_from_index: DMat3,
    index_from_world: DMat3,
    spacing: DVec3,
    is_upright: bool,
    margin: [usize; 3],
    dims: [usize; 3],
}

/// The nearest point of the surface to a voxel beside it, from the voxel box's first voxel, mm.
#[derive(Clone, Copy)]
struct Foot {
    at: Vec3,
    normal: Vec3,
}

/// What becomes of a block.
pub enum Moved {
    /// All of its voxels are far from the surface.
    All(u8),
    /// x fastest.
    Voxels(Vec<u8>),
}

impl Distances {
    /// For distances up to `most_mm` and a voxel.
    pub fn new(grid: &Grid, most_mm: f64) -> Self {
        let world_from_index = grid.world_from_index().matrix3;
        let index_from_world = grid.index_from_world().matrix3;
        let spacing = grid.spacing_mm();
        let rows = index_from_world.transpose();
        let reach = most_mm + 1.5 * spacing.max_element();
        // A ball's half width along the axes of the grid, and a voxel for the crossings.
        let half = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| reach * row.length());
        let m = &world_from_index;
        let cosine = |a: DVec3, b: DVec3| (a.dot(b) / (a.length() * b.length())).abs();
        let is_upright =
            cosine(m.x_axis, m.y_axis).max(cosine(m.y_axis, m.z_axis)).max(cosine(m.x_axis, m.z_axis)) < 1e-4;
        let dims = grid.dims();
        // Beyond the grid there is nothing to look at.
        let margin = std::array::from_fn(|a| (half[a].ceil() as usize).saturating_add(2).min(dims[a]));
        Self { world_from_index, index_from_world, spacing, is_upright, margin, dims }
    }

    /// Voxels around a block that decide about it.
    pub fn margin(&self) -> [usize; 3] {
        self.margin
    }

    /// The memberships in a block of the selection whose surface has moved outward by `mm`.
    pub fn moved(&self, selection: &Selection, block: VoxelBox, mm: f64) -> Moved {
        let region = super::with_margin(block, self.margin, self.dims);
        let (mut has_in, mut has_out) = (false, false);
        for place in places(region) {
            let [low, high] = selection.brick(place).range();
            has_in |= high >= IN;
            has_out |= low < IN;
            if has_in && has_out {
                break;
            }
        }
        if !(has_in && has_out) {
            return Moved::All(if has_in { 255 } else { 0 });
        }
        let f = selection.values(region);
        let size = region.map(|[from, to]| to - from);
        let (mut nearest, feet) = self.feet(&f, size);
        if feet.is_empty() {
            return Moved::All(if f[0] >= IN { 255 } else { 0 });
        }
        self.transform(&mut nearest, size);
        if !self.is_upright {
            self.exchange(&mut nearest, &feet, size);
        }
        let [nx, ny, _] = size;
        let strides = [1, nx, nx * ny];
        let mut moved = Vec::with_capacity(block.iter().map(|[from, to]| to - from).product());
        for z in block[2][0]..block[2][1] {
            for y in block[1][0]..block[1][1] {
                for x in block[0][0]..block[0][1] {
                    let at = [x - region[0][0], y - region[1][0], z - region[2][0]];
                    let i = at[0] + nx * (at[1] + ny * at[2]);
                    let here = self.place(at);
                    let mut best = (f32::INFINITY, Vec3::Z);
                    let mut look = |id: u32| {
                        if let Some(foot) = feet.get(id as usize) {
                            let found = self.distance(here, foot);
                            best = if found.0 < best.0 { found } else { best };
                        }
                    };
                    look(nearest[i]);
                    for a in 0..3 {
                        if at[a] > 0 {
                            look(nearest[i - strides[a]]);
                        }
                        if at[a] + 1 < size[a] {
                            look(nearest[i + strides[a]]);
                        }
                    }
                    let distance = f64::from(if f[i] >= IN { -best.0 } else { best.0 });
                    let width = (self.world_from_index.transpose() * best.1.as_dvec3()).length();
                    moved.push(quantized(0.5 - (distance - mm) / width));
                }
            }
        }
        Moved::Voxels(moved)
    }

    fn place(&self, at: [usize; 3]) -> Vec3 {
        (self.world_from_index * DVec3::from_array(at.map(|n| n as f64))).as_vec3()
    }

    /// From a place to the surface near a foot, in mm, and the direction there.
    fn distance(&self, here: Vec3, foot: &Foot) -> (f32, Vec3) {
        let offset = here - foot.at;
        let height = offset.dot(foot.normal);
        let squared = offset.length_squared();
        let beside_squared = (squared - height * height).max(0.0);
        let most = 0.5 * self.spacing.max_element() as f32;
        let distance = (squared - beside_squared.min(most * most)).max(0.0).sqrt();
        let length = squared.sqrt();
        // Beside the surface the offset says nothing about its direction.
        (distance, if length > most { offset / length } else { foot.normal })
    }

    /// The voxels beside the surface, each with its foot: their numbers in place, and the feet.
    fn feet(&self, f: &[u8], size: [usize; 3]) -> (Vec<u32>, Vec<Foot>) {
        let [nx, ny, _] = size;
        let strides = [1, nx, nx * ny];
        let mut number = vec![NOWHERE; f.len()];
        let mut feet = Vec::new();
        let normal_from_plane = self.index_from_world.transpose();
        for i in 0..f.len() {
            let at = [i % nx, i / nx % ny, i / (nx * ny)];
            let here = f64::from(f[i]);
            let is_in = f[i] >= IN;
            // The plane crosses axis a where m · x = 1.
            let mut m = DVec3::ZERO;
            for a in 0..3 {
                let mut look = |j: usize, sign: f64| {
                    if (f[j] >= IN) != is_in {
                        let inverse = (f64::from(f[j]) - here) / (HALF - here);
                        if inverse > m[a].abs() {
                            m[a] = sign * inverse;
                        }
                    }
                };
                if at[a] > 0 {
                    look(i - strides[a], -1.0);
                }
                if at[a] + 1 < size[a] {
                    look(i + strides[a], 1.0);
                }
            }
            if m != DVec3::ZERO {
                let toward = normal_from_plane * m;
                let foot = toward / toward.length_squared();
                number[i] = feet.len() as u32;
                feet.push(Foot { at: self.place(at) + foot.as_vec3(), normal: toward.normalize().as_vec3() });
            }
        }
        (number, feet)
    }

    /// Gives every voxel the number of the nearest one that has one, as if the axes were at right angles.
    fn transform(&self, number: &mut [u32], size: [usize; 3]) {
        let mut squared = vec![f32::INFINITY; number.len()];
        squared.iter_mut().zip(number.iter()).filter(|(_, n)| **n != NOWHERE).for_each(|(d, _)| *d = 0.0);
        let strides = [1, size[0], size[0] * size[1]];
        let mut line = Line::default();
        for a in 0..3 {
            let step = self.spacing[a] as f32;
            let [u, v] = [[1, 2], [0, 2], [0, 1]][a];
            for j in 0..size[v] {
                for i in 0..size[u] {
                    let first = i * strides[u] + j * strides[v];
                    line.transform(&mut squared, number, first, strides[a], size[a], step * step);
                }
            }
        }
    }

    /// Lets neighbors exchange what they found, there and back, until nothing gets nearer.
    fn exchange(&self, number: &mut [u32], feet: &[Foot], size: [usize; 3]) {
        const MOST: usize = 6;
        let [nx, ny, nz] = size;
        let mut distance: Vec<f32> = vec![f32::INFINITY; number.len()];
        let squared = |at: [usize; 3], id: u32| {
            feet.get(id as usize).map_or(f32::INFINITY, |foot| (self.place(at) - foot.at).length_squared())
        };
        for (i, d) in distance.iter_mut().enumerate() {
            *d = squared([i % nx, i / nx % ny, i / (nx * ny)], number[i]);
        }
        for round in 0..MOST {
            let mut has_changed = false;
            let is_back = round % 2 == 1;
            for n in 0..number.len() {
                let i = if is_back { number.len() - 1 - n } else { n };
                let at = [i % nx, i / nx % ny, i / (nx * ny)];
                for z in at[2].saturating_sub(1)..(at[2] + 2).min(nz) {
                    for y in at[1].saturating_sub(1)..(at[1] + 2).min(ny) {
                        for x in at[0].saturating_sub(1)..(at[0] + 2).min(nx) {
                            let j = x + nx * (y + ny * z);
                            if number[j] != number[i] {
                                let d = squared(at, number[j]);
                                if d < distance[i] {
                                    (distance[i], number[i]) = (d, number[j]);
                                    has_changed = true;
                                }
                            }
                        }
                    }
                }
            }
            if !has_changed {
                break;
            }
        }
    }
}

/// The lower envelope of parabolas along a line, with room that is used again.
#[derive(Default)]
struct Line {
    heights: Vec<f32>,
    numbers: Vec<u32>,
    /// Positions of the parabolas of the envelope.
    vertices: Vec<usize>,
    /// From where each of them is the lowest.
    starts: Vec<f32>,
}

impl Line {
    fn transform(
        &mut self,
        squared: &mut [f32],
        number: &mut [u32],
        first: usize,
        stride: usize,
        len: usize,
        step_squared: f32,
    ) {
        let Self { heights, numbers, vertices, starts } = self;
        heights.clear();
        heights.extend((0..len).map(|i| squared[first + i * stride]));
        numbers.clear();
        numbers.extend((0..len).map(|i| number[first + i * stride]));
        vertices.clear();
        starts.clear();
        for (i, height) in heights.iter().enumerate().filter(|(_, h)| h.is_finite()) {
            let mut start = f32::NEG_INFINITY;
            while let Some(&last) = vertices.last() {
                let (a, b) = (last as f32, i as f32);
                // Where this parabola goes below the last one.
                start = 0.5 * ((height - heights[last]) / (step_squared * (b - a)) + a + b);
                if starts.last().is_some_and(|s| start <= *s) {
                    vertices.pop();
                    starts.pop();
                    start = f32::NEG_INFINITY;
                } else {
                    break;
                }
            }
            vertices.push(i);
            starts.push(start);
        }
        if vertices.is_empty() {
            return;
        }
        let mut lowest = 0;
        for i in 0..len {
            while lowest + 1 < vertices.len() && starts[lowest + 1] < i as f32 {
                lowest += 1;
            }
            let vertex = vertices[lowest];
            let d = i as f32 - vertex as f32;
            squared[first + i * stride] = heights[vertex] + step_squared * d * d;
            number[first + i * stride] = numbers[vertex];
        }
    }
}
