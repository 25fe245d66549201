//! What patterns of styles add to an object: bindings 23 and 24 of `shaders/bind/patterns.wgsl`.

use glam::DVec3;

use super::raycast::{small_texture, uniform, uniform_buffer};
use crate::gpu::context::GpuContext;
use crate::gpu::upload::extent;
use crate::scene::{Object, Scene};
use crate::styles::StyleImage;
use crate::styles::pattern::{CURVATURE_VOXELS, Direction, Strokes, luminance};

uniform! {
/// `Patterns` of `shaders/bind/patterns.wgsl`.
pub struct PatternsUniform {
    rest_from_index_x: [f32; 3],
    reach: f32,
    rest_from_index_y: [f32; 3],
    pad0: f32,
    rest_from_index_z: [f32; 3],
    pad1: f32,
    middle: [f32; 3],
    pad2: f32,
}
}

/// Texels of a style in the table.
const ROWS: usize = 6;

pub(super) struct BoundPatterns {
    pub uniform: wgpu::Buffer,
    pub table: wgpu::TextureView,
}

impl BoundPatterns {
    pub fn new(context: &GpuContext, scene: &Scene, object: &Object) -> Self {
        let grid = &object.volume.grid;
        let column = |v: DVec3| v.as_vec3().to_array();
        let to_rest = grid.world_from_index().matrix3;
        let middle = 0.5 * (DVec3::from_array(grid.dims().map(|n| n as f64)) - 1.0);
        let uniform = PatternsUniform {
            rest_from_index_x: column(to_rest.x_axis),
            reach: (CURVATURE_VOXELS * grid.spacing_mm().min_element()) as f32,
            rest_from_index_y: column(to_rest.y_axis),
            pad0: 0.0,
            rest_from_index_z: column(to_rest.z_axis),
            pad1: 0.0,
            middle: column(middle),
            pad2: 0.0,
        };
        // Texel by texel, as rows lie one after the other.
        let columns: Vec<[[f32; 4]; ROWS]> = scene.styles.iter().map(|style| texels(scene, object, style)).collect();
        let rows: Vec<[f32; 4]> = (0..ROWS).flat_map(|row| columns.iter().map(move |column| column[row])).collect();
        let table = small_texture(
            context,
            "patterns",
            extent([columns.len(), ROWS, 1]),
            wgpu::TextureDimension::D2,
            wgpu::TextureFormat::Rgba32Float,
            bytemuck::cast_slice(&rows),
        );
        Self {
            uniform: uniform_buffer(context, "patterns", bytemuck::bytes_of(&uniform)),
            table: table.create_view(&Default::default()),
        }
    }
}

fn texels(scene: &Scene, object: &Object, style: &StyleImage) -> [[f32; 4]; ROWS] {
    let Some(pattern) = &style.pattern else { return [[0.0; 4]; ROWS] };
    let (kind, layers) = match pattern.strokes {
        Strokes::Hatching { direction: Direction::Axis(_), layers } => (1.0, layers),
        Strokes::Hatching { direction: Direction::Light, layers } => (2.0, layers),
        Strokes::Hatching { direction: Direction::Around, layers } => (3.0, layers),
        Strokes::Hatching { direction: Direction::Along, layers } => (4.0, layers),
        Strokes::Stipple => (5.0, 1),
    };
    let color = |[r, g, b]: [f32; 3]| [r, g, b, luminance([r, g, b]) as f32];
    let axis = |v: DVec3| v.as_vec3().extend(0.0).to_array();
    let [first, second, _] = pattern.axes();
    let light = match object.lighting.as_ref().and_then(|lighting| lighting.lights.first()) {
        Some(light) => light.in_world(&scene.camera).as_vec3().extend(1.0).to_array(),
        None => {
            let [x, y, z] = style.light;
            [x, y, z, 0.0]
        }
    };
    let what = [kind, layers as f32, pattern.spacing_pt as f32, pattern.paper_opacity as f32];
    [what, color(pattern.ink), color(pattern.paper), axis(first), axis(second), light]
}
