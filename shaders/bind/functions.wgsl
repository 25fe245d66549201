// Group 1, only for objects whose looks have several functions from value to opacity.

// The tables' parameters; see `Function`.
struct Layer {
    first: f32,
    scale: f32,
    jump: f32,
    last_node: f32,
    below: vec3f,
    pad0: f32,
    above: vec3f,
    pad1: f32,
}

struct Functions {
    layers: array<Layer, 32>,
    // Per kind of brick, four in a vector: a bit for each layer that may show in it.
    kinds: array<vec4u, 64>,
}

@group(1) @binding(16) var<uniform> functions: Functions;
