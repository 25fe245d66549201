//! Bodies as the shader reads them (docs/rendering.md §9): where the parts of an object lie that were moved, and how they look
//! where they meet.

use glam::{DAffine3, DVec3};

use super::parts::PartLists;
use super::raycast::{NearPlane, small_texture, uniform};
use crate::gpu::context::GpuContext;
use crate::gpu::upload::{ResidentVolume, extent};
use crate::scene::moved::{MAX_BODIES, STRENGTH_SIZE};
use crate::scene::parts::MAX_CELLS;
use crate::scene::{Body, Camera, Cell, Meeting, Object, Role};
use crate::spaces::Grid;

uniform! {
/// `Body` of `shaders/bind/bodies.wgsl`.
pub struct BodyUniform {
    near_origin: [f32; 3],
    first_look: u32,
    near_dx: [f32; 3],
    first_cut_look: u32,
    near_dy: [f32; 3],
    voxels: f32,
    index_from_world_x: [f32; 3],
    role: u32,
    index_from_world_y: [f32; 3],
    first_wall: u32,
    index_from_world_z: [f32; 3],
    num_walls: u32,
    normal_x: [f32; 3],
    pad2: u32,
    normal_y: [f32; 3],
    pad3: u32,
    normal_z: [f32; 3],
    pad4: u32,
    box_low: [f32; 3],
    pad5: u32,
    box_high: [f32; 3],
    pad6: u32,
    first_brick: [i32; 3],
    pad7: u32,
    last_brick: [i32; 3],
    pad8: u32,
    to_map: [i32; 3],
    pad9: u32,
    with_ghost: [f32; 4],
    with_background: [f32; 4],
}
}

uniform! {
/// `Bodies` of `shaders/bind/bodies.wgsl`.
pub struct BodiesUniform {
    list: [BodyUniform; MAX_SLOTS],
    count: u32,
    tiny_mm: f32,
    lowest_value: f32,
    value_scale: f32,
}
}

/// Bodies of an object with all of its parts, at most.
const MAX_SLOTS: usize = MAX_BODIES + MAX_CELLS;

/// M; the identity at rest.
fn pose(body: &Body<'_>) -> DAffine3 {
    body.pose().copied().unwrap_or(DAffine3::IDENTITY)
}

/// Corners of a body's box as it lies, world mm.
pub fn corners_mm(object: &Object, body: &Body<'_>) -> [DVec3; 8] {
    let (low, high) = body.index_box(object);
    let pose = pose(body);
    object.volume.grid.box_corners_mm(low, high).map(|corner| pose.transform_point3(corner))
}

/// The sphere around the box of points: center and radius.
pub fn sphere_around(points: &[DVec3]) -> (DVec3, f64) {
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let center = 0.5 * (low + high);
    (center, points.iter().map(|point| point.distance(center)).fold(0.0, f64::max))
}

/// Pieces of a ray, at most, through a body, and its smallest spacing as it lies, mm.
pub fn pieces_and_spacing(object: &Object, body: &Body<'_>, step_voxels: f64) -> (f64, f64) {
    let (low, high) = body.index_box(object);
    ((high - low).length() / step_voxels, spacing_mm(&object.volume.grid, body))
}

/// Pieces of a ray, at most, through bodies of these; one that lies in several counts for each of them.
pub fn most_pieces(sizes: &[(f64, f64)]) -> u32 {
    let own: f64 = sizes.iter().map(|(pieces, _)| pieces).sum();
    // Where a finer body is, its pieces are everyone's.
    let finer = |mm: f64| sizes.iter().filter(move |(_, other)| *other < mm).map(|(pieces, _)| pieces).sum::<f64>();
    let shared: f64 = sizes.iter().map(|(_, mm)| finer(*mm)).sum();
    // And each stretch between two boxes' faces has a shorter piece.
    let ends = if sizes.len() > 1 { 2 * sizes.len() * sizes.len() } else { 0 };
    (own + shared).ceil() as u32 + 1 + ends as u32
}

/// What a frame needs to know of bodies.
pub struct Lying<'a> {
    /// Whose they are.
    pub object: &'a Object,
    /// How its values are encoded.
    pub resident: &'a ResidentVolume,
    /// Where it is seen from.
    pub camera: &'a Camera,
    /// Where rays begin.
    pub near: &'a NearPlane,
    /// Its parts, each of which is a body in place of what rests.
    pub parts: Option<&'a PartLists>,
}

/// `sections`: of each body its first brick, the one behind its last, and where its first is in the skip map.
pub fn bodies_uniform(lying: &Lying<'_>, sections: impl Iterator<Item = [[usize; 3]; 3]>) -> BodiesUniform {
    let Lying { object, resident, near, .. } = *lying;
    let bodies = object.bodies();
    let has_ghosts = bodies.iter().any(|body| body.role == Role::Ghost);
    let num_looks = 1 + object.regions.len() as u32;
    let cut_of_rest = has_ghosts.then_some(bodies.len() as u32 * num_looks);
    let made = bodies.iter().zip(sections).enumerate().flat_map(|(i, (body, section))| {
        let first_look = i as u32 * num_looks;
        let first_cut_look = cut_of_rest.filter(|_| body.pose().is_none()).unwrap_or(first_look);
        let looks = [first_look, first_cut_look];
        match lying.parts.filter(|_| body.role == Role::Rest) {
            None => vec![body_uniform(lying, body, &pose(body), section, looks)],
            Some(parts) => {
                let cells = parts.cells.iter().zip(parts.walls());
                let part = |(cell, [first_wall, num_walls]): (&Cell, [u32; 2])| {
                    let role = if cell.pose == DAffine3::IDENTITY { 0 } else { 3 };
                    let whole = body_uniform(lying, body, &cell.pose, section, looks);
                    BodyUniform { role, first_wall, num_walls, ..whole }
                };
                cells.map(part).collect()
            }
        }
    });
    let mut list = [bytemuck::Zeroable::zeroed(); MAX_SLOTS];
    let mut count = 0;
    for (slot, body) in list.iter_mut().zip(made) {
        *slot = body;
        count += 1;
    }
    let (low, high) = object.volume.bricks().range();
    let (a, b) = (resident.encoding.texel(low), resident.encoding.texel(high));
    // Under a negative slope the smallest value is the largest number.
    let (lowest, highest) = if object.volume.rescale.slope < 0.0 { (b, a) } else { (a, b) };
    BodiesUniform {
        list,
        count,
        tiny_mm: (4e-7 * near.radius_mm) as f32,
        lowest_value: lowest as f32,
        value_scale: if highest == lowest { 0.0 } else { (1.0 / (highest - lowest)) as f32 },
    }
}

/// Of a body that lies under `pose`.
fn body_uniform(
    lying: &Lying<'_>,
    body: &Body<'_>,
    pose: &DAffine3,
    [first, behind, origin]: [[usize; 3]; 3],
    [first_look, first_cut_look]: [u32; 2],
) -> BodyUniform {
    let Lying { object, camera, near, .. } = *lying;
    let grid = &object.volume.grid;
    let rest = pose.inverse();
    let index = grid.index_from_world() * rest;
    let column = |v: DVec3| v.as_vec3().to_array();
    let to_index = |v: DVec3| column(index.transform_vector3(v));
    let (origin_mm, [dx, dy]) = near.plane(camera);
    // A normal goes with the inverse transpose of M, which is the transpose of M⁻¹; scaled, so that f32 has its length.
    let normal = rest.matrix3.transpose();
    let normal = normal * (1.0 / normal.to_cols_array().into_iter().fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs())));
    let (low, high) = body.index_box(object);
    let color = |meeting: Option<&Meeting>| {
        meeting.map_or([0.0; 4], |m| {
            let [r, g, b] = m.color;
            [r, g, b, m.opacity.map_or(-1.0, |opacity| 1.0 + opacity as f32)]
        })
    };
    let meetings = match body.role {
        Role::Moved(moved) => [moved.meetings.ghost.as_ref(), moved.meetings.background.as_ref()].map(color),
        Role::Rest | Role::Ghost => [[0.0; 4]; 2],
    };
    BodyUniform {
        near_origin: column(index.transform_point3(origin_mm)),
        first_look,
        near_dx: to_index(dx),
        first_cut_look,
        near_dy: to_index(dy),
        voxels: (grid.spacing_mm().min_element() / smallest_spacing_mm(grid, pose)) as f32,
        index_from_world_x: column(index.matrix3.x_axis),
        role: match body.role {
            Role::Rest => 0,
            Role::Ghost => 1,
            Role::Moved(_) => 2,
        },
        index_from_world_y: column(index.matrix3.y_axis),
        first_wall: 0,
        index_from_world_z: column(index.matrix3.z_axis),
        num_walls: 0,
        normal_x: column(normal.x_axis),
        pad2: 0,
        normal_y: column(normal.y_axis),
        pad3: 0,
        normal_z: column(normal.z_axis),
        pad4: 0,
        box_low: column(low),
        pad5: 0,
        box_high: column(high),
        pad6: 0,
        first_brick: first.map(|n| n as i32),
        pad7: 0,
        last_brick: behind.map(|n| n as i32 - 1),
        pad8: 0,
        to_map: std::array::from_fn(|a| origin[a] as i32 - first[a] as i32),
        pad9: 0,
        with_ghost: meetings[0],
        with_background: meetings[1],
    }
}

/// Smallest distance of neighboring voxels of a body as it lies.
fn spacing_mm(grid: &Grid, body: &Body<'_>) -> f64 {
    smallest_spacing_mm(grid, &pose(body))
}

/// Smallest distance of neighboring voxels under a pose.
pub fn smallest_spacing_mm(grid: &Grid, pose: &DAffine3) -> f64 {
    let world = pose.matrix3 * grid.world_from_index().matrix3;
    DVec3::new(world.x_axis.length(), world.y_axis.length(), world.z_axis.length()).min_element()
}

/// Two layers for each body; none where no body has a look of its own for what it meets.
pub fn strengths(context: &GpuContext, object: &Object) -> Option<wgpu::TextureView> {
    let bodies = object.bodies();
    let plain = vec![u8::MAX; STRENGTH_SIZE * STRENGTH_SIZE];
    let cells = |meeting: Option<&Meeting>| {
        meeting.and_then(|m| m.strength.as_ref()).map_or_else(|| plain.clone(), |strength| strength.cells().to_vec())
    };
    bodies.iter().any(|body| body.role == Role::Ghost).then(|| {
        let layers: Vec<u8> = bodies
            .iter()
            .flat_map(|body| match body.role {
                Role::Moved(m) => [cells(m.meetings.ghost.as_ref()), cells(m.meetings.background.as_ref())],
                Role::Rest | Role::Ghost => [plain.clone(), plain.clone()],
            })
            .flatten()
            .collect();
        let size = extent([STRENGTH_SIZE, STRENGTH_SIZE, 2 * bodies.len()]);
        let format = wgpu::TextureFormat::R8Unorm;
        let texture = small_texture(context, "strengths", size, wgpu::TextureDimension::D2, format, &layers);
        let dimension = Some(wgpu::TextureViewDimension::D2Array);
        texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() })
    })
}
