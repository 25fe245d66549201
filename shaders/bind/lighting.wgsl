// Group 1, only for objects that are lit (docs/rendering.md §4).

struct Light {
    // Unit vector towards it, in the world.
    direction: vec3f,
    // What its ambient part counts for among the lights'.
    share: f32,
    color: vec3f,
    pad0: f32,
}

struct Lighting {
    lights: array<Light, 4>,
    // Of the model of Blinn and Phong: ambient, diffuse, specular and shininess.
    model: vec4f,
    count: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(1) @binding(20) var<uniform> lighting: Lighting;
// Ambient, diffuse, specular by n·l (−1 in the first column) and n·h (1 in the first row, 0 in the last).
@group(1) @binding(21) var lighting_map: texture_2d<f32>;
// The color of the style of each node, premultiplied; rows as those of `node_layers`.
@group(1) @binding(22) var node_colors: texture_2d<f32>;
