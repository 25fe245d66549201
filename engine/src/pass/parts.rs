//! Parts as the shader reads them (docs/rendering.md §10): what their cells are, in which order rays meet them, and which of them the
//! rays of a tile of the picture may meet at all.

use glam::{DMat3, DVec2, DVec3};

use super::bodies::{self, pieces_and_spacing, smallest_spacing_mm, sphere_around};
use super::coverage::Coverage;
use super::raycast::{NearPlane, small_texture};
use crate::error::{Error, Result};
use crate::gpu::context::GpuContext;
use crate::gpu::upload::extent;
use crate::scene::parts::{Facet, Polyhedron};
use crate::scene::{Camera, Cell, Object, Plane, Projection};

/// Texels in a row, of a cell before its walls, and of a wall (`shaders/lib/part.wgsl`).
const ROW: usize = 2048;
const WALL_TEXELS: u32 = 3;
/// Those of a cell that lies anywhere (`shaders/lib/through_turned.wgsl`), and of one where all were only shifted.
const CELL_TEXELS: u32 = 9;
const SHIFTED_CELL_TEXELS: u32 = 1;
/// Bodies that rays of a tile may meet where they walk through several side by side (`shaders/lib/bodies_most.wgsl`).
const MAX_SIDE_BY_SIDE: usize = 32;
/// What a cell takes of a pass beside its pieces, in pieces (`shaders/lib/through.wgsl`).
const UNITS_PER_CELL: u32 = 8;
/// Pixels along the edge of a tile, and tiles along that of a picture, at most.
const TILE: u32 = 16;
const MAX_TILES: u32 = 256;

/// The parts of an object as a picture shows them.
#[derive(Debug)]
pub struct PartLists {
    /// What is drawn of them.
    pub cells: Vec<Cell>,
    /// Whether rays walk through several bodies side by side: cells overlap, or lie around one another so that none of them is first, or
    /// regions were moved as well.
    pub side_by_side: bool,
    /// The sphere around all that is drawn: center in the world and radius, mm.
    pub sphere: (DVec3, f64),
    /// Pixels along the edge of a tile, and tiles along those of the picture.
    edge: u32,
    tiles: [usize; 2],
    /// Of each cell, how far from the eye it begins and ends along the view's axis, mm; and how far a ray gets in index space at most
    /// while it gets 1 mm deeper.
    reaches: Vec<([f64; 2], f64)>,
    /// Per tile, what rays may meet there, front to back unless it is side by side: cells and, behind the last of these, other bodies.
    lists: Vec<Vec<usize>>,
}

/// A picture that rays are for.
struct View<'a> {
    camera: &'a Camera,
    size: [u32; 2],
}

impl View<'_> {
    /// On which side of a plane what is nearer to the eye lies: above 0 in front of the plane, 0 where no ray crosses it.
    fn side(&self, plane: &Plane) -> f64 {
        match self.camera.projection {
            Projection::Perspective { .. } => plane.height(self.camera.eye_mm),
            Projection::Orthographic { .. } => -plane.normal.dot(self.camera.forward),
        }
    }

    /// Directions that get 1 mm deeper, of rays at the corners of the picture: what is linear in a ray's is largest of one of these.
    fn corners(&self) -> impl Iterator<Item = DVec3> {
        let Camera { right, up, forward, .. } = *self.camera;
        let half = match self.camera.projection {
            Projection::Perspective { .. } => self.camera.half_height(),
            Projection::Orthographic { .. } => 0.0,
        };
        let aspect = f64::from(self.size[0]) / f64::from(self.size[1]);
        let signs = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
        signs.into_iter().map(move |(x, y)| forward + half * (x * aspect * right + y * up))
    }

    /// The outline of points in the world; none where one of them is not in front of the eye.
    fn outline(&self, points: impl Iterator<Item = DVec3>) -> Option<Vec<DVec2>> {
        let camera = self.camera;
        let height = f64::from(self.size[1]);
        let project = |p: DVec3| {
            let from_eye = p - camera.eye_mm;
            let depth = match camera.projection {
                Projection::Perspective { .. } => from_eye.dot(camera.forward),
                Projection::Orthographic { .. } => 1.0,
            };
            let half = camera.half_height() * depth;
            (depth > 1e-6 * from_eye.length()).then(|| {
                let screen = DVec2::new(from_eye.dot(camera.right), -from_eye.dot(camera.up)) / half;
                0.5 * (screen * height + DVec2::new(f64::from(self.size[0]), height))
            })
        };
        points.map(project).collect::<Option<Vec<_>>>().map(outline)
    }
}

/// The convex outline of points, in their order around it.
fn outline(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| (a.x, a.y).partial_cmp(&(b.x, b.y)).unwrap_or(std::cmp::Ordering::Equal));
    points.dedup();
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(p - a) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain
    };
    let mut around = half(&mut points.iter().copied());
    let back = half(&mut points.iter().rev().copied());
    around.pop();
    around.extend(back);
    around.pop();
    if around.is_empty() { points } else { around }
}

/// Pixels that rounding may put an outline off.
const MARGIN: f64 = 0.01;

/// Corners of the box around points.
fn box_around(points: &[DVec2]) -> (DVec2, DVec2) {
    let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    points.iter().fold(none, |(low, high), p| (low.min(*p), high.max(*p)))
}

/// Whether a side of an outline has all of a box behind it, in pixels.
fn is_beside(outline: &[DVec2], low: DVec2, high: DVec2) -> bool {
    let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
    let beyond = |a: DVec2, b: DVec2| {
        let outward = -(b - a).perp();
        corners.iter().all(|corner| outward.dot(*corner - a) > MARGIN * outward.length())
    };
    outline.len() > 2 && (0..outline.len()).any(|i| beyond(outline[i], outline[(i + 1) % outline.len()]))
}

/// Positions of the tiles that an outline has something of.
fn tiles_of(outline: Option<&[DVec2]>, edge: u32, tiles: [usize; 2]) -> Vec<usize> {
    let edge = f64::from(edge);
    let (low, high) = outline.map_or((DVec2::NEG_INFINITY, DVec2::INFINITY), box_around);
    // What is beside the picture ends before its first tile, or begins behind its last.
    let [x, y] = [0, 1].map(|a| {
        let first = ((low[a] - MARGIN) / edge).floor().clamp(0.0, tiles[a] as f64) as usize;
        let behind = ((high[a] + MARGIN) / edge + 1.0).floor().clamp(0.0, tiles[a] as f64) as usize;
        first..behind
    });
    let all = y.flat_map(|j| x.clone().map(move |i| (i, j)));
    let is_touched = |(i, j): &(usize, usize)| {
        let corner = DVec2::new(*i as f64, *j as f64) * edge;
        outline.is_none_or(|outline| !is_beside(outline, corner, corner + edge))
    };
    all.filter(is_touched).map(|(i, j)| i + tiles[0] * j).collect()
}

/// How two cells lie to each other, for all rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// A ray that meets both meets this one first.
    First,
    Second,
    /// No ray meets both.
    Either,
    /// They may have a place in common.
    Overlap,
}

/// A cell as it lies.
struct Placed {
    hull: Polyhedron,
    /// What it is behind: its faces, and the planes of all cuts that led to it.
    planes: Vec<Plane>,
}

/// By the planes of both: a ray goes from the eye's side of a plane that separates them to the other. Where two such planes say
/// different things, no ray meets both.
fn order(a: &Placed, b: &Placed, view: &View<'_>, tiny: f64) -> Order {
    let (mut is_apart, mut first, mut second) = (false, false, false);
    for (own, other, swapped) in [(a, b, false), (b, a, true)] {
        for plane in own.planes.iter().filter(|plane| other.hull.heights(plane).0 >= -tiny) {
            is_apart = true;
            let side = view.side(plane);
            // In front of the plane is `other`.
            let other_first = side > 0.0;
            if side != 0.0 {
                first |= other_first == swapped;
                second |= other_first != swapped;
            } else {
                (first, second) = (true, true);
            }
        }
    }
    match (is_apart, first, second) {
        (false, ..) => Order::Overlap,
        (true, true, false) => Order::First,
        (true, false, true) => Order::Second,
        (true, ..) => Order::Either,
    }
}

/// Positions of cells, so that each comes before those behind it. None where some overlap, or each of several is behind another.
fn front_to_back(placed: &[Placed], outlines: &[Option<Vec<DVec2>>], view: &View<'_>, tiny: f64) -> Option<Vec<usize>> {
    let n = placed.len();
    let mut behind = vec![Vec::new(); n];
    let mut waits_for = vec![0usize; n];
    for a in 0..n {
        for b in a + 1..n {
            if let (Some(x), Some(y)) = (&outlines[a], &outlines[b])
                && !boxes_touch(x, y)
            {
                continue;
            }
            let (near, far) = match order(&placed[a], &placed[b], view, tiny) {
                Order::First => (a, b),
                Order::Second => (b, a),
                Order::Either => continue,
                Order::Overlap => return None,
            };
            behind[near].push(far);
            waits_for[far] += 1;
        }
    }
    let mut sorted = Vec::with_capacity(n);
    let mut ready: std::collections::BTreeSet<usize> = (0..n).filter(|i| waits_for[*i] == 0).collect();
    while let Some(i) = ready.pop_first() {
        sorted.push(i);
        for far in &behind[i] {
            waits_for[*far] -= 1;
            if waits_for[*far] == 0 {
                ready.insert(*far);
            }
        }
    }
    (sorted.len() == n).then_some(sorted)
}

fn boxes_touch(a: &[DVec2], b: &[DVec2]) -> bool {
    let ((a_low, a_high), (b_low, b_high)) = (box_around(a), box_around(b));
    a_low.cmple(b_high + MARGIN).all() && b_low.cmple(a_high + MARGIN).all()
}

/// The faces that cuts made, and whether they are seen.
fn walls(cell: &Cell) -> impl Iterator<Item = (&Facet, bool)> {
    cell.bounds.facets.iter().zip(cell.open.iter().copied()).filter(|(facet, _)| facet.cut.is_some())
}

/// The texels of a cell and its walls, as `shaders/lib/part.wgsl` and what goes through cells read them; `turned`: where not all cells
/// were only shifted.
fn texels(cell: &Cell, turned: bool, object: &Object, camera: &Camera, near: &NearPlane) -> Vec<[f32; 4]> {
    let grid = &object.volume.grid;
    let rest = cell.pose.inverse();
    let index = grid.index_from_world() * rest;
    let spacing = smallest_spacing_mm(grid, &cell.pose);
    let (origin_mm, [dx, dy]) = near.plane(camera);
    let (low, high) = grid.index_box();
    // Scaled, so that f32 has the length of what a normal becomes.
    let normal = rest.matrix3.transpose();
    let normal = normal * (1.0 / normal.to_cols_array().into_iter().fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs())));
    let walls: Vec<_> = walls(cell).collect();
    let texel = |v: DVec3, w: f64| v.extend(w).as_vec4().to_array();
    let to_index = |v: DVec3| index.transform_vector3(v);
    let shift = -grid.index_from_world().transform_vector3(cell.pose.translation);
    let mut texels = vec![texel(shift, walls.len() as f64)];
    let anywhere = [
        texel(index.transform_point3(origin_mm), grid.spacing_mm().min_element() / spacing),
        texel(to_index(dx), walls.len() as f64),
        texel(to_index(dy), 0.0),
        texel(index.matrix3.x_axis, low.x),
        texel(index.matrix3.y_axis, low.y),
        texel(index.matrix3.z_axis, low.z),
        texel(normal.x_axis, high.x),
        texel(normal.y_axis, high.y),
        texel(normal.z_axis, high.z),
    ];
    if turned {
        texels = anywhere.to_vec();
    }
    for (facet, open) in walls {
        let plane = facet.plane.moved(&cell.pose);
        let outward = plane.normal;
        texels.push(texel(outward, plane.height(origin_mm)));
        texels.push([outward.dot(dx) as f32, outward.dot(dy) as f32, f32::from(u8::from(open)), 0.0]);
        // How far behind the plane an index position is, in voxels as they lie.
        let world = index.inverse();
        let to_plane = -world.matrix3.transpose() * outward / spacing;
        texels.push(texel(to_plane, -plane.height(world.translation) / spacing));
    }
    texels
}

impl PartLists {
    /// Of a picture of `size` pixels; none of an object that is whole, or cut and lies as it was.
    pub fn new(object: &Object, camera: &Camera, size: [u32; 2]) -> Option<Self> {
        let cells = object.parts.cells(&object.volume.grid)?;
        let view = View { camera, size };
        let place = |cell: &Cell| {
            let hull = cell.bounds.moved(&cell.pose);
            let planes = hull.facets.iter().map(|facet| facet.plane);
            let planes = planes.chain(cell.behind.iter().map(|plane| plane.moved(&cell.pose))).collect();
            Placed { hull, planes }
        };
        let placed: Vec<Placed> = cells.iter().map(place).collect();
        let others: Vec<[DVec3; 8]> =
            object.bodies()[1..].iter().map(|body| bodies::corners_mm(object, body)).collect();
        let of_cells = placed.iter().map(|p| view.outline(p.hull.corners()));
        let outlines: Vec<_> =
            of_cells.chain(others.iter().map(|corners| view.outline(corners.iter().copied()))).collect();
        let corners: Vec<DVec3> =
            placed.iter().flat_map(|p| p.hull.corners()).chain(others.into_iter().flatten()).collect();
        let sphere = if corners.is_empty() { (camera.eye_mm + camera.forward, 0.5) } else { sphere_around(&corners) };
        let sorted =
            front_to_back(&placed, &outlines, &view, 1e-9 * sphere.1).filter(|_| outlines.len() == cells.len());
        let side_by_side = sorted.is_none();
        let edge = TILE.max(size[0].max(size[1]).div_ceil(MAX_TILES));
        let tiles = size.map(|n| n.div_ceil(edge) as usize);
        let reach = |(cell, placed): (&Cell, &Placed)| {
            let depths = placed.hull.corners().map(|corner| (corner - camera.eye_mm).dot(camera.forward));
            let ends = depths.fold([f64::INFINITY, f64::NEG_INFINITY], |a, d| [a[0].min(d), a[1].max(d)]);
            let index = object.volume.grid.index_from_world() * cell.pose.inverse();
            (ends, view.corners().map(|ray| index.transform_vector3(ray).length()).fold(0.0, f64::max))
        };
        let reaches = cells.iter().zip(&placed).map(reach).collect();
        let mut lists: Vec<Vec<usize>> = vec![Vec::new(); tiles[0] * tiles[1]];
        for i in sorted.unwrap_or_else(|| (0..outlines.len()).collect()) {
            for tile in tiles_of(outlines[i].as_deref(), edge, tiles) {
                lists[tile].push(i);
            }
        }
        Some(Self { cells, side_by_side, sphere, edge, tiles, reaches, lists })
    }

    /// The tiles of a picture of `size` pixels that have any.
    pub fn coverage(&self, size: [u32; 2]) -> Coverage {
        Coverage::of_tiles(size, self.edge, |tile| !self.lists[tile].is_empty())
    }

    /// Whether rays take them for parts that may lie anywhere: some were not only shifted, or they are walked side by side.
    fn lie_anywhere(&self) -> bool {
        self.side_by_side || self.cells.iter().any(|cell| cell.pose.matrix3 != DMat3::IDENTITY)
    }

    /// Whether a pipeline that walks one after the other has to turn them.
    pub fn are_turned(&self) -> bool {
        !self.side_by_side && self.lie_anywhere()
    }

    /// Texels of a cell before its walls.
    fn cell_texels(&self) -> u32 {
        if self.lie_anywhere() { CELL_TEXELS } else { SHIFTED_CELL_TEXELS }
    }

    /// The longest of the lists.
    pub fn most_bodies(&self) -> usize {
        self.lists.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Pieces that a ray has at most, with what its cells take.
    pub fn most_pieces(&self, object: &Object, step_voxels: f64) -> u32 {
        let grid = &object.volume.grid;
        let cells = self.cells.iter().map(|cell| {
            let corners: Vec<DVec3> =
                cell.bounds.corners().map(|corner| grid.index_from_world().transform_point3(corner)).collect();
            let longest = corners.iter().flat_map(|a| corners.iter().map(move |b| a.distance(*b))).fold(0.0, f64::max);
            (longest / step_voxels, smallest_spacing_mm(grid, &cell.pose))
        });
        let bodies = object.bodies();
        let others = bodies[1..].iter().map(|body| pieces_and_spacing(object, body, step_voxels));
        let sizes: Vec<(f64, f64)> = cells.chain(others).collect();
        let of_list = |list: &Vec<usize>| {
            let own: Vec<(f64, f64)> = list.iter().map(|i| sizes[*i]).collect();
            if self.side_by_side {
                bodies::most_pieces(&own)
            } else {
                // No place is in two of them.
                let reaches = || list.iter().map(|i| self.reaches[*i]);
                let begin = reaches().map(|(ends, _)| ends[0]).fold(f64::INFINITY, f64::min);
                let end = reaches().map(|(ends, _)| ends[1]).fold(f64::NEG_INFINITY, f64::max);
                let fastest = reaches().map(|(_, per_mm)| per_mm).fold(0.0, f64::max);
                let pieces = own.iter().map(|(pieces, _)| pieces).sum::<f64>();
                let pieces = pieces.min((end - begin).max(0.0) * fastest / step_voxels);
                pieces.ceil() as u32 + list.len() as u32 * (1 + UNITS_PER_CELL)
            }
        };
        self.lists.iter().map(of_list).max().unwrap_or(0)
    }

    /// Where the cells begin in the texture.
    fn starts(&self) -> Vec<u32> {
        let mut at = (1 + self.lists.len() + self.lists.iter().map(Vec::len).sum::<usize>()) as u32;
        let mut starts = Vec::with_capacity(self.cells.len());
        for cell in &self.cells {
            starts.push(at);
            at += self.cell_texels() + WALL_TEXELS * walls(cell).count() as u32;
        }
        starts
    }

    /// Per cell, the texel of its first wall, and how many walls it has.
    pub fn walls(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let starts = self.starts().into_iter();
        starts.zip(&self.cells).map(|(start, cell)| [start + self.cell_texels(), walls(cell).count() as u32])
    }

    /// Binding 27 of `shaders/bind/parts.wgsl`.
    ///
    /// # Errors
    /// [`Error::Gpu`] where the lists take more than the adapter holds.
    pub fn upload(
        &self,
        context: &GpuContext,
        object: &Object,
        camera: &Camera,
        near: &NearPlane,
    ) -> Result<wgpu::TextureView> {
        if self.side_by_side && self.most_bodies() > MAX_SIDE_BY_SIDE {
            let count = self.most_bodies();
            return Err(Error::scene(
                format!("{count} parts lie behind one another where some overlap, and {MAX_SIDE_BY_SIDE} is the most"),
                "move them apart, or hide some",
            ));
        }
        let starts = self.starts();
        let mut data: Vec<[u32; 4]> = vec![[self.edge, self.tiles[0] as u32, 0, 0]];
        let mut entry = 1 + self.lists.len() as u32;
        for list in &self.lists {
            data.push([entry, entry + list.len() as u32, 0, 0]);
            entry += list.len() as u32;
        }
        let entry_of = |i: &usize| if self.side_by_side { *i as u32 } else { starts[*i] };
        data.extend(self.lists.iter().flatten().map(|i| [entry_of(i), 0, 0, 0]));
        let cells = self.cells.iter().flat_map(|cell| texels(cell, self.lie_anywhere(), object, camera, near));
        data.extend(cells.map(|texel| texel.map(f32::to_bits)));
        let rows = data.len().div_ceil(ROW);
        let most = context.device.limits().max_texture_dimension_2d as usize;
        if rows > most {
            return Err(Error::gpu(
                format!("lists of parts take {rows} rows of a texture, and the adapter holds {most}"),
                "cut the object less often, or draw a smaller picture",
            ));
        }
        data.resize(rows * ROW, [0; 4]);
        let texture = small_texture(
            context,
            "parts",
            extent([ROW, rows, 1]),
            wgpu::TextureDimension::D2,
            wgpu::TextureFormat::Rgba32Uint,
            bytemuck::cast_slice(&data),
        );
        Ok(texture.create_view(&Default::default()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_those_that_an_outline_touches() {
        let square = |low: f64, high: f64| {
            outline(vec![DVec2::new(low, low), DVec2::new(high, low), DVec2::new(low, high), DVec2::new(high, high)])
        };
        let tiles = |points: &[DVec2]| tiles_of(Some(points), 16, [4, 3]);
        assert_eq!(tiles(&square(17.0, 30.0)), [5]);
        assert_eq!(tiles(&square(10.0, 20.0)), [0, 1, 4, 5]);
        // On an edge: those on both of its sides.
        assert_eq!(tiles(&square(20.0, 32.0)), [5, 6, 9, 10]);
        assert_eq!(tiles(&square(-90.0, -3.0)), [] as [usize; 0]);
        assert_eq!(tiles(&square(70.0, 90.0)), [] as [usize; 0]);
        assert_eq!(tiles(&square(-1e300, 1e300)).len(), 12);
        assert_eq!(tiles_of(None, 16, [4, 3]).len(), 12);
        // A sliver from corner to corner leaves out what its box has beside it.
        let sliver = outline(vec![DVec2::new(2.0, 0.0), DVec2::new(46.0, 40.0), DVec2::new(46.5, 40.0)]);
        assert_eq!(tiles(&sliver), [0, 1, 5, 6, 10]);
    }
}
