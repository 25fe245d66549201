//! Bodies as the shader reads them (docs/rendering.md §9): where the parts of an object lie that were moved, and how they look
//! where they meet.

use glam::{DAffine3, DVec3};

use super::raycast::{NearPlane, small_texture, uniform};
use crate::gpu::context::GpuContext;
use crate::gpu::upload::{ResidentVolume, extent};
use crate::scene::moved::{MAX_BODIES, STRENGTH_SIZE};
use crate::scene::{Body, Camera, Meeting, Object, Role};
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
    pad0: u32,
    index_from_world_z: [f32; 3],
    pad1: u32,
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
    list: [BodyUniform; MAX_BODIES],
    count: u32,
    tiny_mm: f32,
    lowest_value: f32,
    value_scale: f32,
}
}

/// M; the identity at rest.
fn pose(body: &Body<'_>) -> DAffine3 {
    body.pose().copied().unwrap_or(DAffine3::IDENTITY)
}

/// The sphere around all bodies' boxes: center in the world and radius, mm.
pub fn bounding_sphere(object: &Object) -> (DVec3, f64) {
    let grid = &object.volume.grid;
    let corners: Vec<DVec3> = object
        .bodies()
        .iter()
        .flat_map(|body| {
            let (low, high) = body.index_box(object);
            let pose = pose(body);
            grid.box_corners_mm(low, high).map(|corner| pose.transform_point3(corner))
        })
        .collect();
    let low = corners.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = corners.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let center = 0.5 * (low + high);
    (center, corners.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max))
}

/// Pieces of a ray, at most, through all bodies; one that lies in several counts for each of them.
pub fn most_pieces(object: &Object, step_voxels: f64) -> u32 {
    let bodies = object.bodies();
    let sizes: Vec<(f64, f64)> = bodies
        .iter()
        .map(|body| {
            let (low, high) = body.index_box(object);
            ((high - low).length() / step_voxels, spacing_mm(&object.volume.grid, body))
        })
        .collect();
    let own: f64 = sizes.iter().map(|(pieces, _)| pieces).sum();
    // Where a finer body is, its pieces are everyone's.
    let finer = |mm: f64| sizes.iter().filter(move |(_, other)| *other < mm).map(|(pieces, _)| pieces).sum::<f64>();
    let shared: f64 = sizes.iter().map(|(_, mm)| finer(*mm)).sum();
    // And each stretch between two boxes' faces has a shorter piece.
    let ends = if bodies.len() > 1 { 2 * bodies.len() * bodies.len() } else { 0 };
    (own + shared).ceil() as u32 + 1 + ends as u32
}

/// `sections`: of each body its first brick, the one behind its last, and where its first is in the skip map.
pub fn bodies_uniform(
    object: &Object,
    resident: &ResidentVolume,
    camera: &Camera,
    near: &NearPlane,
    sections: impl Iterator<Item = [[usize; 3]; 3]>,
) -> BodiesUniform {
    let grid = &object.volume.grid;
    let bodies = object.bodies();
    let num_looks = 1 + object.regions.len() as u32;
    let finest = grid.spacing_mm().min_element();
    let has_ghosts = bodies.iter().any(|body| body.role == Role::Ghost);
    let made = bodies.iter().zip(sections).enumerate().map(|(i, (body, [first, behind, origin]))| {
        let rest = pose(body).inverse();
        let index = grid.index_from_world() * rest;
        let column = |v: DVec3| v.as_vec3().to_array();
        let to_index = |v: DVec3| column(index.transform_vector3(v));
        let (origin_mm, [dx, dy]) = near.plane(camera);
        // A normal goes with the inverse transpose of M, which is the transpose of M⁻¹; scaled, so that f32 has its length.
        let normal = rest.matrix3.transpose();
        let normal = normal * (1.0 / normal.to_cols_array().into_iter().fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs())));
        let (low, high) = body.index_box(object);
        let first_look = i as u32 * num_looks;
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
            first_cut_look: if has_ghosts && body.pose().is_none() {
                bodies.len() as u32 * num_looks
            } else {
                first_look
            },
            near_dy: to_index(dy),
            voxels: (finest / spacing_mm(grid, body)) as f32,
            index_from_world_x: column(index.matrix3.x_axis),
            role: match body.role {
                Role::Rest => 0,
                Role::Ghost => 1,
                Role::Moved(_) => 2,
            },
            index_from_world_y: column(index.matrix3.y_axis),
            pad0: 0,
            index_from_world_z: column(index.matrix3.z_axis),
            pad1: 0,
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
    });
    let mut list = [bytemuck::Zeroable::zeroed(); MAX_BODIES];
    list.iter_mut().zip(made).for_each(|(slot, body)| *slot = body);
    let (low, high) = object.volume.bricks().range();
    let (a, b) = (resident.encoding.texel(low), resident.encoding.texel(high));
    // Under a negative slope the smallest value is the largest number.
    let (lowest, highest) = if object.volume.rescale.slope < 0.0 { (b, a) } else { (a, b) };
    BodiesUniform {
        list,
        count: bodies.len() as u32,
        tiny_mm: (4e-7 * near.radius_mm) as f32,
        lowest_value: lowest as f32,
        value_scale: if highest == lowest { 0.0 } else { (1.0 / (highest - lowest)) as f32 },
    }
}

/// Smallest distance of neighboring voxels of a body as it lies.
fn spacing_mm(grid: &Grid, body: &Body<'_>) -> f64 {
    let world = pose(body).matrix3 * grid.world_from_index().matrix3;
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
