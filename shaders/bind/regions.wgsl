// Group 1, only for objects with regions (docs/rendering.md §8): the looks, and how the volume is shared out among them.

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

struct Regions {
    layers: array<Layer, 32>,
    // Per kind of brick, four in a vector: a bit for each layer that may show in it.
    kinds: array<vec4u, 64>,
    // Texel value of the first cell of `may_show_map`, and cells per texel unit.
    first_cell: f32,
    cells_per_texel: f32,
    // Bricks along x and y of the atlas.
    slots_x: u32,
    slots_y: u32,
    // 1 / its texels.
    atlas_scale: vec3f,
    // Rounds of loops, at most, that a look takes beyond a part's first, and that a piece takes in all with one look a part.
    rounds_per_look: u32,
    // Columns take a change per voxel to one per mm of the world.
    world_x: vec3f,
    rounds_per_piece: u32,
    world_y: vec3f,
    pad0: f32,
    world_z: vec3f,
    pad1: f32,
}

@group(1) @binding(11) var<uniform> regions: Regions;
// Per brick: its first entry, and how many there are.
@group(1) @binding(12) var directory: texture_3d<u32>;
// Region and slot, row by row.
@group(1) @binding(13) var entries: texture_2d<u32>;
// Memberships of bricks of 8³ voxels and of the voxels around them: 10³ texels a slot.
@group(1) @binding(14) var atlas: texture_3d<f32>;
// Two texels a region, row by row: layer, opacity, object's d₀ / its d₀, row of node_layers; tint and whether it has one.
@group(1) @binding(15) var region_looks: texture_2d<f32>;
// Per kind of brick: whether anything shows between two values, given by their cells.
@group(1) @binding(16) var may_show_map: texture_2d_array<u32>;
