// Group 1, only for objects with regions (docs/rendering.md §8): how the volume is shared out among them.

struct Regions {
    // 1 / texels of the atlas.
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
    // 1 / voxels along the edges of the texture of distances, cells that stick out of the volume included.
    distance_scale: vec3f,
    pad2: f32,
}

@group(1) @binding(11) var<uniform> regions: Regions;
// Per brick: its first entry, and how many there are.
@group(1) @binding(12) var directory: texture_3d<u32>;
// Region, and place in the atlas in slots: 10 bits for each axis.
@group(1) @binding(13) var entries: texture_2d<u32>;
// Memberships of bricks of 8³ voxels and of the voxels around them: 10³ texels a slot.
@group(1) @binding(14) var atlas: texture_3d<f32>;
// Three texels a look, row by row of the texture: tint, and 1 + opacity, negative if there is no tint; layer, object's d₀ / its d₀, row of
// node_layers, width of contours in figure points; the color of these, and 1 if that is their own, plus 2 if opacity is modulated.
@group(1) @binding(15) var region_looks: texture_2d<f32>;
