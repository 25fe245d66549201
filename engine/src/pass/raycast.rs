//! The raycast pass: uniforms from the scene (all camera geometry in f64), tabulated transfer function, skip map,
//! style array, pipeline per key.

use std::collections::HashMap;
use std::sync::{Arc, Weak};

use glam::DVec3;
use wgpu::util::DeviceExt as _;

use super::bodies::{Lying, bodies_uniform, corners_mm, most_pieces, pieces_and_spacing, sphere_around, strengths};
use super::coverage::Coverage;
use super::distances::Distances;
use super::may_show::MayShow;
use super::parts::PartLists;
use super::patterns::BoundPatterns;
use super::regions::{Made, RegionLooks};
use super::transfer_table::{TABLE_SIZE, TransferTable};
use crate::error::{Error, Result, remedies};
use crate::gpu::context::{GpuContext, TARGET_FORMAT};
use crate::gpu::regions::ResidentRegions;
use crate::gpu::shader_library::{FEW_BODIES, RaycastKey};
use crate::gpu::upload::{ResidentVolume, extent, table_descriptor};
use crate::scene::lighting::{MAP_SIZE, MAX_LIGHTS};
use crate::scene::quality::{MAX_ROUNDS, PARTS, rounds_per_look};
use crate::scene::{
    Borders, Camera, Light, Lighting, LightingMap, Object, Projection, Quality, Scene, StyleTransferFunction,
};
use crate::spaces::Grid;
use crate::styles::StyleImage;
use crate::styles::pattern::Pattern;
use crate::volume::Volume;
use crate::volume::bricks::{self, MAX_RIM_STEP};

/// A `repr(C)` block that a shader reads, with the names and offsets of its fields for the test that compares them.
macro_rules! uniform {
    ($(#[$doc:meta])* pub struct $name:ident { $($field:ident: $type:ty,)* }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($field: $type,)* }

        impl $name {
            /// Name and byte offset of each field.
            pub const FIELDS: &[(&str, usize)] = &[$((stringify!($field), std::mem::offset_of!($name, $field))),*];
        }
    };
}

pub(super) use uniform;

uniform! {
/// `Frame` of `shaders/bind/frame.wgsl`; a test holds the layout against the shader's.
pub struct FrameUniform {
    near_origin: [f32; 3],
    step_voxels: f32,
    near_dx: [f32; 3],
    termination: f32,
    near_dy: [f32; 3],
    near_depth: f32,
    forward: [f32; 3],
    footprint: f32,
    forward_dx: [f32; 3],
    footprint_growth: f32,
    forward_dy: [f32; 3],
    voxel_mm: f32,
    right: [f32; 3],
    pixels_per_pt: f32,
    up: [f32; 3],
    coverage_edge: u32,
    image_size: [u32; 2],
    tile_origin: [u32; 2],
    pieces: [u32; 2],
    stride: [u32; 2],
}
}

uniform! {
/// `Object` of `shaders/bind/object.wgsl`.
pub struct ObjectUniform {
    index_from_world_x: [f32; 3],
    reference_length: f32,
    index_from_world_y: [f32; 3],
    transfer_first: f32,
    index_from_world_z: [f32; 3],
    transfer_scale: f32,
    world_from_gradient_x: [f32; 3],
    extinction_below: f32,
    world_from_gradient_y: [f32; 3],
    extinction_above: f32,
    world_from_gradient_z: [f32; 3],
    last_node: f32,
    box_max: [f32; 3],
    middle_below: f32,
    texel_scale: [f32; 3],
    middle_above: f32,
    face_x: [f32; 3],
    node_below: f32,
    face_y: [f32; 3],
    node_above: f32,
    face_z: [f32; 3],
    looks_per_turn: f32,
    jump: f32,
    contour_pt: f32,
    transparency: f32,
    first_cell: f32,
    ink: [f32; 4],
    cells_per_texel: f32,
    pad0: f32,
    pad1: f32,
    pad2: f32,
}
}

uniform! {
/// `Light` of `shaders/bind/lighting.wgsl`.
pub struct LightUniform {
    direction: [f32; 3],
    share: f32,
    color: [f32; 3],
    pad0: f32,
}
}

uniform! {
/// `Lighting` of `shaders/bind/lighting.wgsl`.
pub struct LightingUniform {
    lights: [LightUniform; MAX_LIGHTS],
    model: [f32; 4],
    count: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}
}

fn lighting_uniform(lighting: &Lighting, camera: &Camera) -> LightingUniform {
    let brightness: f64 = lighting.lights.iter().map(Light::luminance).sum();
    let light = |i: usize| {
        let light = lighting.lights.get(i)?;
        let share = if brightness > 0.0 { light.luminance() / brightness } else { 1.0 / lighting.lights.len() as f64 };
        let direction = light.in_world(camera).as_vec3().to_array();
        Some(LightUniform { direction, share: share as f32, color: light.color, pad0: 0.0 })
    };
    let lights = std::array::from_fn(|i| light(i).unwrap_or_else(bytemuck::Zeroable::zeroed));
    let model = lighting.map.blinn_phong().unwrap_or_default().map(|n| n as f32);
    LightingUniform { lights, model, count: lighting.lights.len() as u32, pad0: 0, pad1: 0, pad2: 0 }
}

/// The plane at the front of all that is drawn where rays begin, found in f64: from there on f32 only has to resolve what is drawn,
/// however far the eye is.
#[derive(Clone, Copy, Debug)]
pub struct NearPlane {
    /// From the eye, mm.
    pub depth_mm: f64,
    /// Radius of the sphere around all that is drawn.
    pub radius_mm: f64,
    /// Half the height of the picture on the plane, mm.
    half_height_mm: f64,
}

impl NearPlane {
    /// In front of a sphere, given its center and radius in mm.
    pub fn new(camera: &Camera, (center, radius_mm): (DVec3, f64)) -> Self {
        let front = (center - camera.eye_mm).dot(camera.forward) - radius_mm;
        let (depth_mm, half_height_mm) = match camera.projection {
            Projection::Perspective { .. } => (front.max(0.0), camera.half_height() * front.max(0.0)),
            Projection::Orthographic { .. } => (front, camera.half_height()),
        };
        Self { depth_mm, radius_mm, half_height_mm }
    }

    /// Its point in the middle of the picture, in world mm, and the changes per unit of screen x and y.
    pub fn plane(&self, camera: &Camera) -> (DVec3, [DVec3; 2]) {
        let across = [camera.right, camera.up].map(|axis| self.half_height_mm * axis);
        (camera.eye_mm + self.depth_mm * camera.forward, across)
    }
}

impl FrameUniform {
    /// Of a picture of `image_size` pixels.
    pub fn new(scene: &Scene, grid: &Grid, near: &NearPlane, image_size: [u32; 2]) -> Self {
        let (camera, quality) = (&scene.camera, &scene.quality);
        let to_index = |v: DVec3| grid.index_from_world().transform_vector3(v).as_vec3().to_array();
        let spread = match camera.projection {
            Projection::Perspective { .. } => camera.half_height(),
            Projection::Orthographic { .. } => 0.0,
        };
        let (near_center, [dx, dy]) = near.plane(camera);
        let (footprint, growth) = camera.pixel_footprint_mm(image_size[1]);
        let voxel = grid.spacing_mm().min_element();
        Self {
            near_origin: grid.index_from_world().transform_point3(near_center).as_vec3().to_array(),
            step_voxels: quality.step_voxels as f32,
            near_dx: to_index(dx),
            termination: quality.termination as f32,
            near_dy: to_index(dy),
            near_depth: near.depth_mm as f32,
            forward: camera.forward.as_vec3().to_array(),
            footprint: (footprint / voxel) as f32,
            forward_dx: (spread * camera.right).as_vec3().to_array(),
            footprint_growth: (growth / voxel) as f32,
            forward_dy: (spread * camera.up).as_vec3().to_array(),
            voxel_mm: voxel as f32,
            right: camera.right.as_vec3().to_array(),
            pixels_per_pt: (1.0 / scene.pixel_pt(image_size[1])) as f32,
            up: camera.up.as_vec3().to_array(),
            coverage_edge: 1,
            image_size,
            tile_origin: [0, 0],
            pieces: [0, u32::MAX],
            stride: [1, 1],
        }
    }

    /// The same frame for the tile whose first pixel is `tile_origin`, and of whose pixels only every `stride`-th is drawn,
    /// across and down.
    #[must_use]
    pub fn for_tile(mut self, tile_origin: [u32; 2], stride: u32) -> Self {
        self.tile_origin = tile_origin;
        self.stride = [stride; 2];
        self
    }

    /// The same frame for pass `pass` of those that long rays need.
    #[must_use]
    pub fn for_pass(mut self, pass: u32) -> Self {
        let length = self.pieces[1] - self.pieces[0];
        self.pieces = [pass * length, (pass + 1) * length];
        self
    }
}

/// What an object is prepared for.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// The object's parts as it shows them; none of an object that is whole.
    pub parts: Option<&'a PartLists>,
    /// Whether the march leaps over empty bricks: otherwise every brick counts as occupied, for tests and measurements.
    pub skip_empty: bool,
    /// Edges of the whole picture in pixels.
    pub size: [u32; 2],
    /// Of how many of these one is drawn, across and down.
    pub stride: u32,
}

/// An object ready to be drawn.
#[derive(Debug)]
pub struct RaycastObject {
    /// Which pipeline draws it.
    pub key: RaycastKey,
    bind_group: wgpu::BindGroup,
    grid: Grid,
    near: NearPlane,
    coverage: Coverage,
    /// Passes that its longest ray needs, one after the other.
    pub num_passes: u32,
    /// Pieces of a ray that a pass walks; among several bodies, rounds of loops.
    units_per_pass: u32,
}

#[derive(Debug)]
struct Pipeline {
    pipeline: wgpu::RenderPipeline,
    object_layout: wgpu::BindGroupLayout,
}

/// The pass with its pipelines and caches.
#[derive(Debug)]
pub struct RaycastPass {
    frame_layout: wgpu::BindGroupLayout,
    frame_buffer: wgpu::Buffer,
    frame_group: wgpu::BindGroup,
    resume_layout: wgpu::BindGroupLayout,
    /// What pipelines that go on have where there is nothing to go on from: a texel of nothing.
    nothing: wgpu::TextureView,
    pipelines: HashMap<RaycastKey, Pipeline>,
    styles: Option<(Vec<Arc<StyleImage>>, wgpu::TextureView)>,
    lighting_map: Option<(LightingMap, wgpu::TextureView)>,
    looks: Vec<Look>,
    made: Made,
    distances: Distances,
    region_looks: Vec<RegionLooks>,
    patch: Option<ShaderPatch>,
}

/// What an object is drawn with, besides its volume and the styles.
struct Bound {
    uniform: ObjectUniform,
    skip_map: wgpu::TextureView,
    /// The bricks that may show something, where they are known; of several bodies, those of the first.
    shown: Option<Arc<[u32]>>,
    transfer_function: wgpu::TextureView,
    node_layers: wgpu::TextureView,
    node_rows: NodeRows,
    may_show: wgpu::TextureView,
    /// Whether what shows may reach the faces of the volume.
    at_faces: bool,
    /// With regions only.
    shared: Option<Shared>,
    /// What a pass may walk of a ray: pieces or, among several bodies, rounds of loops.
    units_per_pass: u32,
    /// How many of these a piece takes of a body.
    units_per_piece: u32,
}

/// What regions add.
struct Shared {
    uniform: wgpu::Buffer,
    /// Bindings 12 and following of `shaders/bind/regions.wgsl`.
    textures: [wgpu::TextureView; 4],
    /// Binding 16, of `shaders/bind/functions.wgsl`.
    functions: Option<wgpu::Buffer>,
    /// Bindings 25 and 26, of `shaders/bind/rows.wgsl`.
    rows: Option<[wgpu::TextureView; 2]>,
    cuts: bool,
    bodies: Option<MovedBodies>,
}

/// The styles of functions' nodes, a row for each different list of them.
#[derive(Clone, Debug)]
pub(super) struct NodeRows {
    /// Nodes in a row.
    pub width: usize,
    /// Of each node.
    pub styles: Arc<[u32]>,
}

/// What moved regions add: bindings 18 and 19 of `shaders/bind/bodies.wgsl`.
struct MovedBodies {
    count: usize,
    uniform: wgpu::Buffer,
    strengths: Option<wgpu::TextureView>,
}

/// Looks of objects with regions that are kept: the steps of a refining picture.
const MAX_REGION_LOOKS: usize = 4;

/// Looks that are kept, a megabyte each: the steps of a refining picture, a few undos.
const MAX_LOOKS: usize = 12;

/// What depends on an object's volume and transfer function but not on the camera: made anew only when they change, so
/// that a turning camera pays nothing for it.
#[derive(Clone, Debug)]
struct Look {
    volume: Weak<Volume>,
    function: StyleTransferFunction,
    /// Usual length of a part of a piece, in reference lengths.
    lengths: f64,
    /// How many bricks farther than its border pieces may reach out of one; none where they leap over nothing.
    reach: Option<u8>,
    table: Arc<TransferTable>,
    transfer_function: wgpu::TextureView,
    skip_map: wgpu::TextureView,
    /// Positions of the bricks that may show something.
    shown: Option<Arc<[u32]>>,
    may_show: MayShow,
}

/// Changes the WGSL text of a pipeline before it is compiled: how tests plant a defect.
pub type ShaderPatch = fn(String) -> String;

impl RaycastPass {
    /// A pass without pipelines; they are made, from a patched text if so asked, when a scene first needs them.
    pub fn new(context: &GpuContext, patch: Option<ShaderPatch>) -> Self {
        let device = &context.device;
        let frame_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("frame"),
            entries: &[entry(0, uniform_binding())],
        });
        let unfilterable = wgpu::TextureSampleType::Float { filterable: false };
        let resume_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("resume"),
            entries: &[entry(0, texture_binding(unfilterable, wgpu::TextureViewDimension::D2))],
        });
        let frame_buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("frame"),
            size: size_of::<FrameUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let frame_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame"),
            layout: &frame_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: frame_buffer.as_entire_binding() }],
        });
        let one = wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 };
        let nothing = small_texture(context, "nothing", one, wgpu::TextureDimension::D2, TARGET_FORMAT, &[0; 16]);
        Self {
            frame_layout,
            frame_buffer,
            frame_group,
            resume_layout,
            nothing: nothing.create_view(&Default::default()),
            pipelines: HashMap::new(),
            styles: None,
            lighting_map: None,
            looks: Vec::new(),
            made: Made::default(),
            distances: Distances::default(),
            region_looks: Vec::new(),
            patch,
        }
    }

    /// Binds an object of the scene for a picture: its volume, table, skip map and styles.
    ///
    /// # Errors
    /// [`Error::Gpu`] where the adapter refuses the shader or a resource.
    pub fn prepare(
        &mut self,
        context: &GpuContext,
        scene: &Scene,
        object: &Object,
        resident: &ResidentVolume,
        regions: Option<&ResidentRegions>,
        picture: Picture<'_>,
    ) -> Result<RaycastObject> {
        let Picture { parts, skip_empty, size, stride } = picture;
        let key = RaycastKey {
            filtered: resident.filtered,
            table_filtered: context.formats.r32_filterable,
            no_data: resident.validity.is_some(),
            colors: resident.colors.is_some(),
            alpha: resident.alpha,
            sampled_gradients: resident.colors.is_none() && resident.gradient_encoding.is_some(),
            regions: false,
            labels: false,
            functions: false,
            rows: false,
            cuts: false,
            bodies: false,
            many_bodies: false,
            meetings: false,
            parts: false,
            turned: false,
            faces: true,
            contours: object.has_contours(),
            transparency: object.has_illustrative_transparency(),
            lit: object.lighting.is_some(),
            lighting_map: object.lighting.as_ref().is_some_and(|lighting| lighting.map.blinn_phong().is_none()),
            several_lights: object.lighting.as_ref().is_some_and(|lighting| lighting.lights.len() > 1),
            patterns: scene.has_patterns(object),
            curvature: scene.patterns(object).any(Pattern::follows_curvature),
            resumed: false,
        };
        let device = &context.device;
        let volume = &object.volume;
        let grid = volume.grid;
        let step_voxels = scene.quality.step_voxels;
        let reach = skip_empty.then(|| bricks::reach(step_voxels));
        let sphere = parts.map_or_else(
            || sphere_around(&object.bodies().iter().flat_map(|body| corners_mm(object, body)).collect::<Vec<_>>()),
            |parts| parts.sphere,
        );
        let near = NearPlane::new(&scene.camera, sphere);
        let labels = regions.is_some_and(|regions| regions.borders() == Borders::TwoLookUps);
        let bound = match regions {
            None => self.bind_look(context, scene, object, resident, reach),
            Some(regions) => {
                // What there is in a brick is known for no longer pieces.
                let leaps = reach == Some(0);
                self.bind_regions(context, scene, object, resident, regions, &near, (parts, leaps))?
            }
        };
        let key = match &bound.shared {
            None => key,
            Some(s) => RaycastKey {
                regions: true,
                labels,
                functions: s.functions.is_some(),
                rows: s.rows.is_some(),
                cuts: s.cuts || s.bodies.is_some(),
                bodies: s.bodies.is_some(),
                many_bodies: s.bodies.as_ref().is_some_and(|b| b.count > FEW_BODIES),
                resumed: s.bodies.is_some(),
                meetings: s.bodies.as_ref().is_some_and(|b| b.strengths.is_some()),
                ..key
            },
        };
        let part_lists = match parts {
            None => None,
            Some(parts) => Some(parts.upload(context, object, &scene.camera, &near)?),
        };
        let key = RaycastKey {
            parts: parts.is_some(),
            turned: parts.is_some_and(PartLists::are_turned),
            faces: bound.at_faces || key.bodies,
            ..key
        };
        let coverage = match (parts, &bound.shown) {
            (Some(parts), _) => parts.coverage(size),
            (None, Some(shown)) if !key.bodies => {
                let [nx, ny, _] = volume.bricks().dims.map(|n| n as u32);
                let places = shown.iter().map(|i| [i % nx, i / nx % ny, i / (nx * ny)].map(|n| n as usize));
                Coverage::of_bricks(places, &grid, &scene.camera, &near, size, stride)
            }
            _ => Coverage::of_tiles(size, size[0].max(size[1]), |_| true),
        };
        let uniform = uniform_buffer(context, "object", bytemuck::bytes_of(&bound.uniform));
        let styles = self.style_array(context, &scene.styles)?;
        let filter = if key.filtered { wgpu::FilterMode::Linear } else { wgpu::FilterMode::Nearest };
        let volume_sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("volume"),
            mag_filter: filter,
            min_filter: filter,
            ..Default::default()
        });
        let style_sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("style"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let num_pieces = match parts {
            Some(parts) => parts.most_pieces(object, step_voxels),
            None => {
                let bodies = object.bodies();
                let sizes: Vec<_> = bodies.iter().map(|body| pieces_and_spacing(object, body, step_voxels)).collect();
                most_pieces(&sizes)
            }
        };
        let num_units = u64::from(num_pieces) * u64::from(bound.units_per_piece);
        let num_passes = num_units.div_ceil(u64::from(bound.units_per_pass)) as u32;
        if num_passes > 1 {
            self.pipeline(context, RaycastKey { resumed: true, ..key })?;
        }
        let lighting =
            object.lighting.as_ref().map(|lighting| self.lighting(context, scene, lighting, &bound.node_rows));
        let pipeline = self.pipeline(context, key)?;
        let mut entries = vec![
            wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
            texture_entry(1, &resident.values),
            texture_entry(2, &resident.gradients),
            wgpu::BindGroupEntry { binding: 3, resource: wgpu::BindingResource::Sampler(&volume_sampler) },
            texture_entry(4, &bound.skip_map),
            texture_entry(5, &bound.transfer_function),
            texture_entry(6, &bound.node_layers),
            texture_entry(7, &styles),
            wgpu::BindGroupEntry { binding: 8, resource: wgpu::BindingResource::Sampler(&style_sampler) },
            texture_entry(17, &bound.may_show),
        ];
        entries.extend(resident.validity.as_ref().map(|v| texture_entry(9, v)));
        entries.extend(resident.colors.as_ref().map(|c| texture_entry(10, c)));
        if let Some(shared) = &bound.shared {
            entries.push(wgpu::BindGroupEntry { binding: 11, resource: shared.uniform.as_entire_binding() });
            entries.extend((12..).zip(&shared.textures).map(|(i, view)| texture_entry(i, view)));
            if let Some(uniform) = &shared.functions {
                entries.push(wgpu::BindGroupEntry { binding: 16, resource: uniform.as_entire_binding() });
            }
            if let Some(rows) = &shared.rows {
                entries.extend((25..).zip(rows).map(|(i, view)| texture_entry(i, view)));
            }
            if let Some(bodies) = &shared.bodies {
                entries.push(wgpu::BindGroupEntry { binding: 18, resource: bodies.uniform.as_entire_binding() });
                entries.extend(bodies.strengths.as_ref().map(|view| texture_entry(19, view)));
            }
        }
        if let Some((uniform, map, colors)) = &lighting {
            entries.push(texture_entry(22, colors));
            entries.push(wgpu::BindGroupEntry { binding: 20, resource: uniform.as_entire_binding() });
            entries.extend(map.as_ref().map(|map| texture_entry(21, map)));
        }
        let patterns = key.patterns.then(|| BoundPatterns::new(context, scene, object));
        if let Some(patterns) = &patterns {
            entries.push(wgpu::BindGroupEntry { binding: 23, resource: patterns.uniform.as_entire_binding() });
            entries.push(texture_entry(24, &patterns.table));
        }
        entries.extend(part_lists.as_ref().map(|view| texture_entry(27, view)));
        let depths = key.is_whole().then(|| coverage.upload(context));
        entries.extend(depths.as_ref().map(|view| texture_entry(28, view)));
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("object"),
            layout: &pipeline.object_layout,
            entries: &entries,
        });
        Ok(RaycastObject { key, bind_group, grid, near, coverage, num_passes, units_per_pass: bound.units_per_pass })
    }

    /// What an object without regions is drawn with.
    fn bind_look(
        &mut self,
        context: &GpuContext,
        scene: &Scene,
        object: &Object,
        resident: &ResidentVolume,
        reach: Option<u8>,
    ) -> Bound {
        let lengths = in_steps(usual_length_mm(scene, object) / object.transfer_function.reference_length_mm);
        let Look { table, transfer_function, skip_map, shown, may_show, .. } =
            self.look(context, object, resident, lengths, reach);
        let layers: Vec<u32> = object.transfer_function.nodes.iter().map(|n| n.style as u32).collect();
        let node_layers = small_texture(
            context,
            "node layers",
            extent([layers.len(), 1, 1]),
            wgpu::TextureDimension::D2,
            wgpu::TextureFormat::R32Uint,
            bytemuck::cast_slice(&layers),
        );
        Bound {
            uniform: object_uniform(scene, object, resident, (&table, &may_show), &object.transfer_function),
            skip_map,
            shown,
            may_show: may_show.map,
            at_faces: reaches_faces(scene, object, resident, std::slice::from_ref(&table)),
            node_rows: NodeRows { width: layers.len(), styles: layers.into() },
            transfer_function,
            node_layers: node_layers.create_view(&Default::default()),
            shared: None,
            units_per_pass: Quality::pieces_per_pass(looking(scene, object)),
            units_per_piece: 1,
        }
    }

    /// What an object with regions is drawn with.
    #[expect(clippy::too_many_arguments, reason = "what a draw needs, spelled out")]
    fn bind_regions(
        &mut self,
        context: &GpuContext,
        scene: &Scene,
        object: &Object,
        resident: &ResidentVolume,
        regions: &ResidentRegions,
        near: &NearPlane,
        (parts, leaps): (Option<&PartLists>, bool),
    ) -> Result<Bound> {
        let lengths_mm = in_steps(usual_length_mm(scene, object));
        let known = self.region_looks.iter().position(|looks| looks.is_of(object, regions, lengths_mm, leaps));
        let i = match known {
            Some(i) => i,
            None => {
                let looks = RegionLooks::new(context, object, resident, regions, &mut self.made, lengths_mm, leaps)?;
                if self.region_looks.len() >= MAX_REGION_LOOKS {
                    self.region_looks.remove(0);
                }
                self.region_looks.push(looks);
                self.region_looks.len() - 1
            }
        };
        let looks = &mut self.region_looks[i];
        looks.update(context, object, resident, regions)?;
        let [rounds_per_piece, _] = looks.rounds(regions, looking(scene, object));
        let uniform = looks.uniform(object, regions, looking(scene, object));
        let functions =
            looks.functions().map(|uniform| uniform_buffer(context, "functions", bytemuck::bytes_of(&uniform)));
        let has_moved = match parts {
            Some(parts) => parts.side_by_side,
            None => object.regions.iter().any(|region| region.moved().is_some()),
        };
        let bodies = has_moved.then(|| {
            let uniform =
                bodies_uniform(&Lying { object, resident, camera: &scene.camera, near, parts }, looks.sections());
            MovedBodies {
                count: parts.map_or_else(|| object.bodies().len(), PartLists::most_bodies),
                uniform: uniform_buffer(context, "bodies", bytemuck::bytes_of(&uniform)),
                strengths: strengths(context, object),
            }
        });
        let rows = looks.rows.clone().map(|rows| [rows, self.distances.get(context, object)]);
        let [directory, entries, atlas] = regions.views();
        Ok(Bound {
            uniform: object_uniform(scene, object, resident, (looks.table(), &looks.may_show), &looks.function),
            may_show: looks.may_show.map.clone(),
            at_faces: reaches_faces(scene, object, resident, &looks.layers),
            node_rows: looks.node_rows.clone(),
            skip_map: looks.skip_map(),
            shown: leaps.then(|| looks.shown()),
            transfer_function: looks.tables.clone(),
            node_layers: looks.node_layers.clone(),
            shared: Some(Shared {
                uniform: uniform_buffer(context, "regions", bytemuck::bytes_of(&uniform)),
                textures: [directory, entries, atlas, looks.region_looks.clone()],
                functions,
                rows,
                cuts: looks.cuts,
                bodies,
            }),
            units_per_pass: if has_moved { MAX_ROUNDS / 4 * 3 } else { (MAX_ROUNDS / 2 / rounds_per_piece).max(1) },
            units_per_piece: if has_moved { rounds_per_piece } else { 1 },
        })
    }

    /// The frame uniform for an object, before it is narrowed to a tile.
    pub fn frame(&self, scene: &Scene, object: &RaycastObject, image_size: [u32; 2]) -> FrameUniform {
        let (pieces, coverage_edge) = ([0, object.units_per_pass], object.coverage.edge);
        FrameUniform { pieces, coverage_edge, ..FrameUniform::new(scene, &object.grid, &object.near, image_size) }
    }

    /// Records the drawing of one tile into the lower-index corner of `target`. `gathered`: what the passes before have
    /// drawn of it, in all but the first.
    #[expect(clippy::too_many_arguments, reason = "a draw call, spelled out")]
    pub fn draw(
        &self,
        context: &GpuContext,
        encoder: &mut wgpu::CommandEncoder,
        object: &RaycastObject,
        frame: FrameUniform,
        target: &wgpu::TextureView,
        size: [u32; 2],
        gathered: Option<&wgpu::TextureView>,
    ) {
        context.queue.write_buffer(&self.frame_buffer, 0, bytemuck::bytes_of(&frame));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("raycast"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        let key = RaycastKey { resumed: gathered.is_some() || object.key.resumed, ..object.key };
        pass.set_pipeline(&self.pipelines[&key].pipeline);
        pass.set_bind_group(0, &self.frame_group, &[]);
        pass.set_bind_group(1, &object.bind_group, &[]);
        if key.resumed {
            let group = context.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("resume"),
                layout: &self.resume_layout,
                entries: &[texture_entry(0, gathered.unwrap_or(&self.nothing))],
            });
            pass.set_bind_group(2, &group, &[]);
        }
        pass.set_viewport(0.0, 0.0, size[0] as f32, size[1] as f32, 0.0, 1.0);
        // One triangle over the tile each: what is not covered costs nothing.
        for [x, y, width, height] in object.coverage.boxes(frame.tile_origin, frame.stride, size) {
            pass.set_scissor_rect(x, y, width, height);
            pass.draw(0..3, 0..1);
        }
    }

    fn pipeline(&mut self, context: &GpuContext, key: RaycastKey) -> Result<&Pipeline> {
        if !self.pipelines.contains_key(&key) {
            let made = make_pipeline(context, [&self.frame_layout, &self.resume_layout], key, self.patch)?;
            self.pipelines.insert(key, made);
        }
        Ok(&self.pipelines[&key])
    }

    fn look(
        &mut self,
        context: &GpuContext,
        object: &Object,
        resident: &ResidentVolume,
        lengths: f64,
        reach: Option<u8>,
    ) -> Look {
        // A volume that nobody holds any more may have left its address to another one.
        self.looks.retain(|look| look.volume.strong_count() > 0);
        let known = self.looks.iter().find(|look| {
            std::ptr::eq(look.volume.as_ptr(), &*object.volume)
                && look.function.classifies_as(&object.transfer_function)
                && look.lengths == lengths
                && look.reach == reach
        });
        if let Some(known) = known {
            return known.clone();
        }
        let (function, rescale) = (&object.transfer_function, object.volume.rescale);
        let table = TransferTable::new(function, rescale, resident.encoding, object.data_range(), lengths);
        let transfer_function = small_texture(
            context,
            "transfer function",
            extent([TABLE_SIZE, TABLE_SIZE, 1]),
            wgpu::TextureDimension::D2,
            wgpu::TextureFormat::Rgba32Float,
            bytemuck::cast_slice(&table.entries),
        );
        let bricks = object.volume.bricks();
        let distances = match reach {
            Some(reach) => {
                let texel = |stored| resident.encoding.texel(stored);
                bricks.distances(reach, |low, high| table.shows(texel(low), texel(high)))
            }
            None => vec![0; bricks.ranges.len()],
        };
        let skip_map = small_texture(
            context,
            "skip map",
            extent(bricks.dims),
            wgpu::TextureDimension::D3,
            wgpu::TextureFormat::R8Uint,
            &distances,
        );
        let table = Arc::new(table);
        let look = Look {
            volume: Arc::downgrade(&object.volume),
            function: function.clone(),
            lengths,
            reach,
            shown: reach.map(|_| nearest(&distances)),
            may_show: MayShow::new(context, std::slice::from_ref(&table), object, resident),
            table,
            transfer_function: transfer_function.create_view(&Default::default()),
            skip_map: skip_map.create_view(&Default::default()),
        };
        if self.looks.len() >= MAX_LOOKS {
            self.looks.remove(0);
        }
        self.looks.push(look.clone());
        look
    }

    /// What lights add: bindings 20 to 22 of `shaders/bind/lighting.wgsl`.
    fn lighting(
        &mut self,
        context: &GpuContext,
        scene: &Scene,
        lighting: &Lighting,
        nodes: &NodeRows,
    ) -> (wgpu::Buffer, Option<wgpu::TextureView>, wgpu::TextureView) {
        let view = lighting.map.blinn_phong().is_none().then(|| self.lighting_map(context, lighting.map));
        let colors: Vec<[f32; 4]> = nodes.styles.iter().map(|style| scene.styles[*style as usize].color).collect();
        let colors = small_texture(
            context,
            "node colors",
            extent([nodes.width, nodes.styles.len() / nodes.width, 1]),
            wgpu::TextureDimension::D2,
            wgpu::TextureFormat::Rgba32Float,
            bytemuck::cast_slice(&colors),
        );
        let uniform =
            uniform_buffer(context, "lighting", bytemuck::bytes_of(&lighting_uniform(lighting, &scene.camera)));
        (uniform, view, colors.create_view(&Default::default()))
    }

    fn lighting_map(&mut self, context: &GpuContext, map: LightingMap) -> wgpu::TextureView {
        let known = self.lighting_map.as_ref().filter(|(known, _)| *known == map);
        let view = known.map(|(_, view)| view.clone()).unwrap_or_else(|| {
            let texels: Vec<half::f16> =
                map.table().texels.iter().flat_map(|[a, d, s]| [*a, *d, *s, 0.0].map(half::f16::from_f32)).collect();
            let texture = small_texture(
                context,
                "lighting map",
                extent([MAP_SIZE, MAP_SIZE, 1]),
                wgpu::TextureDimension::D2,
                wgpu::TextureFormat::Rgba16Float,
                bytemuck::cast_slice(&texels),
            );
            texture.create_view(&Default::default())
        });
        self.lighting_map = Some((map, view.clone()));
        view
    }

    fn style_array(&mut self, context: &GpuContext, styles: &[Arc<StyleImage>]) -> Result<wgpu::TextureView> {
        if let Some((held, view)) = &self.styles
            && held.len() == styles.len()
            && held.iter().zip(styles).all(|(a, b)| Arc::ptr_eq(a, b))
        {
            return Ok(view.clone());
        }
        let view = upload_styles(context, styles)?;
        self.styles = Some((styles.to_vec(), view.clone()));
        Ok(view)
    }
}

/// Whether anything that these functions show may reach the faces of the volume.
fn reaches_faces(scene: &Scene, object: &Object, resident: &ResidentVolume, tables: &[Arc<TransferTable>]) -> bool {
    let (low, high) = object.volume.bricks().rim;
    let [low, high] = [low, high].map(|stored| resident.encoding.texel(stored));
    scene.quality.step_voxels > MAX_RIM_STEP || tables.iter().any(|table| table.shows(low, high))
}

/// Positions of the bricks at a distance of 0.
pub(super) fn nearest(distances: &[u8]) -> Arc<[u32]> {
    (0..).zip(distances).filter(|(_, distance)| **distance == 0).map(|(i, _)| i).collect()
}

/// Rounds of loops that a look at an object takes.
fn looking(scene: &Scene, object: &Object) -> u32 {
    rounds_per_look(object.lighting.is_some(), scene.has_patterns(object))
}

/// Length, in mm, of a part of a piece along the view's axis: exact for cubic voxels and parallel rays, near for others.
fn usual_length_mm(scene: &Scene, object: &Object) -> f64 {
    let voxels_per_mm = object.volume.grid.index_from_world().transform_vector3(scene.camera.forward).length();
    scene.quality.step_voxels / f64::from(PARTS) / voxels_per_mm
}

/// In steps of 1 %, so that turning around cubic voxels asks for one table only.
pub(super) fn in_steps(length: f64) -> f64 {
    ((length.log2() * 64.0).round() / 64.0).exp2()
}

/// `function`: the only one, with its `table`; several have their own parameters.
fn object_uniform(
    scene: &Scene,
    object: &Object,
    resident: &ResidentVolume,
    (table, may_show): (&TransferTable, &MayShow),
    function: &StyleTransferFunction,
) -> ObjectUniform {
    let drawn = FunctionDrawing::of(function);
    let grid = &object.volume.grid;
    let column = |v: DVec3| v.as_vec3().to_array();
    let to_index = grid.index_from_world().matrix3;
    // Central difference over two voxels → texels per voxel → data units per voxel → per mm → share of G.
    let per_texel = resident
        .gradient_encoding
        .map_or(0.0, |encoding| 0.5 * object.volume.rescale.slope / (encoding.scale * resident.gradient_max));
    let faces = grid.world_gradient_from_index();
    let gradient = faces * per_texel;
    let dims = DVec3::from_array(grid.dims().map(|n| n as f64));
    ObjectUniform {
        index_from_world_x: column(to_index.x_axis),
        reference_length: object.reference_length_mm() as f32,
        index_from_world_y: column(to_index.y_axis),
        transfer_first: table.first as f32,
        index_from_world_z: column(to_index.z_axis),
        transfer_scale: table.scale as f32,
        world_from_gradient_x: column(gradient.x_axis),
        extinction_below: table.outer_extinction[0] as f32,
        world_from_gradient_y: column(gradient.y_axis),
        extinction_above: table.outer_extinction[1] as f32,
        world_from_gradient_z: column(gradient.z_axis),
        last_node: table.last_node as f32,
        box_max: column(dims - 0.5),
        middle_below: table.outer_middle[0] as f32,
        texel_scale: column(dims.recip()),
        middle_above: table.outer_middle[1] as f32,
        face_x: column(faces.x_axis.normalize()),
        node_below: table.outer_node[0] as f32,
        face_y: column(faces.y_axis.normalize()),
        node_above: table.outer_node[1] as f32,
        face_z: column(faces.z_axis.normalize()),
        looks_per_turn: (1.0 / scene.largest_turn(object)) as f32,
        jump: table.jump as f32,
        contour_pt: drawn.contour_pt,
        transparency: f32::from(u8::from(drawn.transparency)),
        first_cell: may_show.first_cell,
        ink: drawn.ink,
        cells_per_texel: may_show.cells_per_texel,
        pad0: 0.0,
        pad1: 0.0,
        pad2: 0.0,
    }
}

/// How a function is drawn, as the shader has it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct FunctionDrawing {
    /// Width of contours in figure points, 0 without any.
    pub contour_pt: f32,
    /// Their color; the last is 1, or 0 where they have that of the style's rim.
    pub ink: [f32; 4],
    /// Whether opacity is modulated as in eq. 3.2.
    pub transparency: bool,
}

impl FunctionDrawing {
    pub fn of(function: &StyleTransferFunction) -> Self {
        let color = function.contours.and_then(|contours| contours.color);
        let [r, g, b] = color.unwrap_or_default();
        Self {
            contour_pt: function.contours.map_or(0.0, |contours| contours.width_pt as f32),
            ink: [r, g, b, f32::from(u8::from(color.is_some()))],
            transparency: function.illustrative_transparency,
        }
    }
}

fn make_pipeline(
    context: &GpuContext,
    [frame_layout, resume_layout]: [&wgpu::BindGroupLayout; 2],
    key: RaycastKey,
    patch: Option<ShaderPatch>,
) -> Result<Pipeline> {
    let text = key.wgsl().map_err(|e| Error::gpu(e, "report this fault of the program"))?;
    let text = match patch {
        Some(patch) => patch(text),
        None => text,
    };
    let remedy = remedies::OTHER_ADAPTER;
    context.checked(&format!("the shader \"{key}\""), remedy, |device| {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("raycast"),
            source: wgpu::ShaderSource::Wgsl(text.into()),
        });
        let volume = texture_binding(wgpu::TextureSampleType::Float { filterable: key.filtered }, VIEW_3D);
        let filterable = texture_binding(wgpu::TextureSampleType::Float { filterable: true }, VIEW_3D);
        let volume_sampler = wgpu::BindingType::Sampler(if key.filtered {
            wgpu::SamplerBindingType::Filtering
        } else {
            wgpu::SamplerBindingType::NonFiltering
        });
        let table = wgpu::TextureSampleType::Float { filterable: key.table_filtered };
        let arrays = wgpu::TextureViewDimension::D2Array;
        let mut entries = vec![
            entry(0, uniform_binding()),
            entry(1, volume),
            entry(2, if key.sampled_gradients { volume } else { filterable }),
            entry(3, volume_sampler),
            entry(4, texture_binding(wgpu::TextureSampleType::Uint, VIEW_3D)),
            entry(5, texture_binding(table, if key.functions { arrays } else { wgpu::TextureViewDimension::D2 })),
            entry(6, texture_binding(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2)),
            entry(
                7,
                texture_binding(
                    wgpu::TextureSampleType::Float { filterable: true },
                    wgpu::TextureViewDimension::D2Array,
                ),
            ),
            entry(8, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
            entry(17, texture_binding(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2)),
        ];
        if key.no_data {
            entries.push(entry(9, volume));
        }
        if key.colors {
            entries.push(entry(10, filterable));
        }
        if key.regions {
            let flat = wgpu::TextureViewDimension::D2;
            let unfilterable = wgpu::TextureSampleType::Float { filterable: false };
            entries.extend([
                entry(11, uniform_binding()),
                entry(12, texture_binding(wgpu::TextureSampleType::Uint, VIEW_3D)),
                entry(13, texture_binding(wgpu::TextureSampleType::Uint, flat)),
                entry(14, filterable),
                entry(15, texture_binding(unfilterable, flat)),
            ]);
        }
        if key.functions {
            entries.push(entry(16, uniform_binding()));
        }
        if key.rows {
            let unfilterable = wgpu::TextureSampleType::Float { filterable: false };
            entries.push(entry(25, texture_binding(unfilterable, wgpu::TextureViewDimension::D2)));
            entries.push(entry(26, filterable));
        }
        if key.lit {
            let filtered = wgpu::TextureSampleType::Float { filterable: true };
            entries.push(entry(20, uniform_binding()));
            if key.lighting_map {
                entries.push(entry(21, texture_binding(filtered, wgpu::TextureViewDimension::D2)));
            }
            let unfilterable = wgpu::TextureSampleType::Float { filterable: false };
            entries.push(entry(22, texture_binding(unfilterable, wgpu::TextureViewDimension::D2)));
        }
        if key.patterns {
            let unfilterable = wgpu::TextureSampleType::Float { filterable: false };
            entries.push(entry(23, uniform_binding()));
            entries.push(entry(24, texture_binding(unfilterable, wgpu::TextureViewDimension::D2)));
        }
        if key.parts {
            entries.push(entry(27, texture_binding(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2)));
        }
        if key.is_whole() {
            let unfilterable = wgpu::TextureSampleType::Float { filterable: false };
            entries.push(entry(28, texture_binding(unfilterable, wgpu::TextureViewDimension::D2)));
        }
        if key.bodies {
            entries.push(entry(18, uniform_binding()));
        }
        if key.meetings {
            let filtered = wgpu::TextureSampleType::Float { filterable: true };
            entries.push(entry(19, texture_binding(filtered, arrays)));
        }
        let object_layout = device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("object"), entries: &entries });
        let layouts = [Some(frame_layout), Some(&object_layout), Some(resume_layout)];
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("raycast"),
            bind_group_layouts: &layouts[..if key.resumed { 3 } else { 2 }],
            immediate_size: 0,
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("raycast"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vs_raycast"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("fs_raycast"),
                compilation_options: Default::default(),
                targets: &[Some(TARGET_FORMAT.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        Pipeline { pipeline, object_layout }
    })
}

const VIEW_3D: wgpu::TextureViewDimension = wgpu::TextureViewDimension::D3;

fn entry(binding: u32, ty: wgpu::BindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::FRAGMENT, ty, count: None }
}

fn uniform_binding() -> wgpu::BindingType {
    wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

fn texture_binding(
    sample_type: wgpu::TextureSampleType,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindingType {
    wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false }
}

fn texture_entry(binding: u32, view: &wgpu::TextureView) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) }
}

pub(super) fn small_texture(
    context: &GpuContext,
    label: &str,
    size: wgpu::Extent3d,
    dimension: wgpu::TextureDimension,
    format: wgpu::TextureFormat,
    data: &[u8],
) -> wgpu::Texture {
    let descriptor = table_descriptor(label, size, dimension, format);
    context.device.create_texture_with_data(&context.queue, &descriptor, wgpu::util::TextureDataOrder::LayerMajor, data)
}

pub(super) fn uniform_buffer(context: &GpuContext, label: &str, contents: &[u8]) -> wgpu::Buffer {
    context.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some(label),
        contents,
        usage: wgpu::BufferUsages::UNIFORM,
    })
}

/// One array layer per style with its own mips, half floats (11 bits where 8-bit sRGB has 8).
fn upload_styles(context: &GpuContext, styles: &[Arc<StyleImage>]) -> Result<wgpu::TextureView> {
    let first = styles.first().ok_or_else(|| Error::scene("the scene has no style", "give its nodes a style"))?;
    if let Some(odd) = styles.iter().find(|s| s.size != first.size || s.mips.len() != first.mips.len()) {
        return Err(Error::scene(
            format!("the style \"{}\" is {} pixels wide and others {}", odd.name, odd.size, first.size),
            "give all styles one size",
        ));
    }
    let limit = context.device.limits().max_texture_array_layers as usize;
    if styles.len() > limit {
        return Err(Error::gpu(
            format!("the scene uses {} styles and the adapter holds {limit}", styles.len()),
            "use fewer styles",
        ));
    }
    let data: Vec<half::f16> =
        styles.iter().flat_map(|s| s.mips.iter().flatten().flat_map(|texel| texel.map(half::f16::from_f32))).collect();
    let descriptor = wgpu::TextureDescriptor {
        label: Some("styles"),
        size: extent([first.size, first.size, styles.len()]),
        mip_level_count: first.mips.len() as u32,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let texture = context.device.create_texture_with_data(
        &context.queue,
        &descriptor,
        wgpu::util::TextureDataOrder::LayerMajor,
        bytemuck::cast_slice(&data),
    );
    Ok(texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    }))
}
