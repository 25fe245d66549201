//! Where in a picture anything may be seen: which of its tiles have something behind them that shows, and how far away it is. Rays are
//! sent through these tiles only, and each begins and ends with what its tile has (docs/rendering.md §11). The pixels do not depend on it.

use glam::DVec3;

use super::raycast::{NearPlane, small_texture};
use crate::gpu::context::GpuContext;
use crate::gpu::upload::extent;
use crate::scene::{Camera, Projection};
use crate::spaces::Grid;
use crate::volume::bricks::BRICK;

/// Pixels along the edge of a tile of what is drawn, and tiles along that of a picture, at most.
const TILE: u32 = 16;
const MAX_TILES: u32 = 256;
/// Pixels that rounding may put a brick off.
const MARGIN: f64 = 0.05;

/// Tiles of a picture that rays are sent through.
#[derive(Clone, Debug)]
pub struct Coverage {
    /// Pixels of the picture along the edge of a tile.
    pub edge: u32,
    /// Tiles along the edges of the picture.
    tiles: [usize; 2],
    /// Of each tile, row by row: how far behind the near plane anything begins and ends, mm along the view axis; nothing: [∞, −∞].
    depths: Vec<[f32; 2]>,
    /// Boxes of tiles that have something, each in one of them: first pixel and the one behind the last, along x and y.
    boxes: Vec<[[u32; 2]; 2]>,
}

impl Coverage {
    /// All of a picture of `size` pixels, or what of its tiles `edge` pixels wide (row by row) `is_covered`.
    pub fn of_tiles(size: [u32; 2], edge: u32, is_covered: impl Fn(usize) -> bool) -> Self {
        let tiles = size.map(|n| n.div_ceil(edge) as usize);
        let depth =
            |i| if is_covered(i) { [f32::NEG_INFINITY, f32::INFINITY] } else { [f32::INFINITY, f32::NEG_INFINITY] };
        Self::new(size, edge, (0..tiles[0] * tiles[1]).map(depth).collect())
    }

    /// What bricks may show, of a picture of `size` pixels of which every `stride`-th is drawn.
    pub fn of_bricks(
        bricks: impl Iterator<Item = [usize; 3]>,
        grid: &Grid,
        camera: &Camera,
        near: &NearPlane,
        size: [u32; 2],
        stride: u32,
    ) -> Self {
        let edge = (TILE * stride).max(size[0].max(size[1]).div_ceil(MAX_TILES));
        let tiles = size.map(|n| n.div_ceil(edge) as usize);
        let mut depths = vec![[f32::INFINITY, f32::NEG_INFINITY]; tiles[0] * tiles[1]];
        // Camera axes: of a brick's middle, and of half of what a voxel adds to a box around it.
        let world = grid.world_from_index();
        let axes = [camera.right, camera.up, camera.forward];
        let per_voxel = axes.map(|axis| (world.matrix3.transpose() * axis).abs());
        let last = DVec3::from_array(grid.dims().map(|n| n as f64)) - 0.5;
        // Pixels a mm, at a depth of 1 mm where things look smaller far away.
        let scale = 0.5 * f64::from(size[1]) / camera.half_height();
        let middle = size.map(|n| 0.5 * f64::from(n));
        let is_parallel = matches!(camera.projection, Projection::Orthographic { .. });
        for brick in bricks {
            let low = DVec3::from_array(brick.map(|b| (b * BRICK) as f64)) - 0.5;
            let high = (low + BRICK as f64).min(last);
            let (center, half) = (world.transform_point3(0.5 * (low + high)) - camera.eye_mm, 0.5 * (high - low));
            let around = |a: usize| {
                let (at, reach) = (center.dot(axes[a]), per_voxel[a].dot(half));
                [at - reach, at + reach]
            };
            let depth = around(2);
            if !is_parallel && depth[1] < 0.0 {
                continue; // behind the eye
            }
            let behind = |at: f64, depth: f64| if is_parallel { at } else { at / depth };
            let is_in_front = is_parallel || depth[0] > 1e-6 * near.radius_mm;
            let pixels = |a: usize, sign: f64| {
                let [from, to] = around(a);
                // The end of the box that is farther out on its side is where it is nearer to the eye.
                let outer = [behind(from, depth[usize::from(from >= 0.0)]), behind(to, depth[usize::from(to < 0.0)])];
                let ends = outer.map(|at| middle[a] + sign * scale * at);
                let first = ((ends[0].min(ends[1]) - MARGIN) / f64::from(edge)).floor();
                let behind_last = ((ends[0].max(ends[1]) + MARGIN) / f64::from(edge)).floor() + 1.0;
                let within = |tile: f64| tile.clamp(0.0, tiles[a] as f64) as usize;
                if is_in_front { within(first)..within(behind_last) } else { 0..tiles[a] }
            };
            let (columns, rows) = (pixels(0, 1.0), pixels(1, -1.0));
            let [from, to] = depth.map(|depth| depth - near.depth_mm);
            for row in rows {
                for reach in &mut depths[row * tiles[0]..][columns.clone()] {
                    *reach = [reach[0].min(from as f32), reach[1].max(to as f32)];
                }
            }
        }
        Self::new(size, edge, depths)
    }

    fn new(size: [u32; 2], edge: u32, depths: Vec<[f32; 2]>) -> Self {
        let tiles = size.map(|n| n.div_ceil(edge) as usize);
        let mut boxes: Vec<[[usize; 2]; 2]> = Vec::new();
        // Those that the row before ends.
        let mut open = 0..0;
        for (y, row) in depths.chunks(tiles[0]).enumerate() {
            let first = boxes.len();
            let mut x = 0;
            for run in row.chunk_by(|a, b| (a[0] <= a[1]) == (b[0] <= b[1])) {
                let across = [x, x + run.len()];
                x += run.len();
                if run[0][0] > run[0][1] {
                    continue;
                }
                // The same as above: one box with it, at the end of the list with the others of this row.
                let above = open.clone().find(|i| boxes[*i] == [across, [boxes[*i][1][0], y]]);
                let from = above.map_or(y, |i| std::mem::take(&mut boxes[i])[1][0]);
                boxes.push([across, [from, y + 1]]);
            }
            open = first..boxes.len();
        }
        boxes.retain(|[x, _]| x[0] < x[1]);
        let pixels = |[from, to]: [usize; 2], n: u32| [from as u32 * edge, (to as u32 * edge).min(n)];
        let boxes = boxes.into_iter().map(|[x, y]| [pixels(x, size[0]), pixels(y, size[1])]).collect();
        Self { edge, tiles, depths, boxes }
    }

    /// Boxes (x, y, width, height) in the pixels of a target that hold what is covered, if its first pixel is `origin` of the picture
    /// and its next are `stride` pixels of the picture away, `size` of them.
    pub fn boxes(&self, origin: [u32; 2], stride: [u32; 2], size: [u32; 2]) -> impl Iterator<Item = [u32; 4]> + '_ {
        self.boxes.iter().filter_map(move |bounds| {
            let within = |a: usize| bounds[a].map(|at| at.saturating_sub(origin[a]).div_ceil(stride[a]).min(size[a]));
            let [x, y] = [within(0), within(1)];
            (x[0] < x[1] && y[0] < y[1]).then(|| [x[0], y[0], x[1] - x[0], y[1] - y[0]])
        })
    }

    /// Binding 28 of `shaders/bind/coverage.wgsl`.
    pub fn upload(&self, context: &GpuContext) -> wgpu::TextureView {
        // Shaders may not have infinities, and divide this.
        let depths: Vec<[f32; 2]> = self.depths.iter().map(|depth| depth.map(|d| d.clamp(-1e30, 1e30))).collect();
        let texture = small_texture(
            context,
            "coverage",
            extent([self.tiles[0], self.tiles[1], 1]),
            wgpu::TextureDimension::D2,
            wgpu::TextureFormat::Rg32Float,
            bytemuck::cast_slice(&depths),
        );
        texture.create_view(&Default::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_hold_what_is_covered_once() {
        let size = [90, 70];
        // A ring, a bar beside it, and a lone tile; rows that go on, that end, and that begin anew.
        let rows = [".####.", ".#..#.", ".#..##", ".####.", "#....."];
        let is_covered = |x: u32, y: u32| rows[(y / 15) as usize].as_bytes()[(x / 15) as usize] == b'#';
        let coverage = Coverage::of_tiles(size, 15, |i| rows[i / 6].as_bytes()[i % 6] == b'#');
        for (origin, stride, drawn) in [([0, 0], 1, size), ([7, 31], 1, [20, 30]), ([1, 2], 4, [23, 17])] {
            let mut times = vec![0; (drawn[0] * drawn[1]) as usize];
            for [x, y, width, height] in coverage.boxes(origin, [stride; 2], drawn) {
                for at in (y..y + height).flat_map(|y| (x..x + width).map(move |x| x + drawn[0] * y)) {
                    times[at as usize] += 1;
                }
            }
            for (i, times) in (0..).zip(times) {
                let place = [i % drawn[0], i / drawn[0]];
                let [x, y] = [0, 1].map(|a| origin[a] + stride * place[a]);
                assert_eq!(times, u32::from(is_covered(x, y)), "{x}, {y}");
            }
        }
        assert_eq!(Coverage::of_tiles(size, 15, |_| true).boxes([0, 0], [1; 2], size).count(), 1);
        assert_eq!(Coverage::of_tiles(size, 15, |_| false).boxes([0, 0], [1; 2], size).count(), 0);
    }
}
