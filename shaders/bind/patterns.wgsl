// Group 1, only for objects whose styles carry patterns (docs/rendering.md §4).

struct Patterns {
    // Columns take a change in index space to mm of the volume at rest.
    rest_from_index_x: vec3f,
    // How far apart, mm, normals are compared for the curvature.
    reach: f32,
    rest_from_index_y: vec3f,
    pad0: f32,
    rest_from_index_z: vec3f,
    pad1: f32,
    // The middle of the volume, in index space.
    middle: vec3f,
    pad2: f32,
}

@group(1) @binding(23) var<uniform> patterns: Patterns;
// A column a style: what it is drawn with (none, sections, across the light, around, along, stipple), layers, spacing in figure
// points, opacity of paper; ink and its luminance; paper and its luminance; the first axis; the second; the light, and 1 if it is in
// the world, 0 in the frame of the ray.
@group(1) @binding(24) var pattern_table: texture_2d<f32>;
