// Group 1, only for objects with moved regions (docs/rendering.md §9).

struct Body {
    // The near plane in the index space of the volume as the body lies; see Frame.
    near_origin: vec3f,
    // Position of its looks, and of those whose ends make faces in it.
    first_look: u32,
    near_dx: vec3f,
    first_cut_look: u32,
    near_dy: vec3f,
    // The object's smallest spacing, over the body's.
    voxels: f32,
    // Columns take a world direction (mm) to that index space.
    index_from_world_x: vec3f,
    // 0: the rest; 1: a ghost of the next body; 2: moved; 3: a part of the rest that was moved.
    role: u32,
    index_from_world_y: vec3f,
    // Of a part: its walls, three texels each of `parts`.
    first_wall: u32,
    index_from_world_z: vec3f,
    num_walls: u32,
    // Columns take a normal of the volume at rest to the body's, but for its length.
    normal_x: vec3f,
    pad2: u32,
    normal_y: vec3f,
    pad3: u32,
    normal_z: vec3f,
    pad4: u32,
    // The box in index space outside of which it shows nothing.
    box_low: vec3f,
    pad5: u32,
    box_high: vec3f,
    pad6: u32,
    // Its first brick and its last, and what takes a brick to its place in the skip map.
    first_brick: vec3i,
    pad7: u32,
    last_brick: vec3i,
    pad8: u32,
    to_map: vec3i,
    pad9: u32,
    // How it looks where it meets its ghost, and the background: a color, and 1 + opacity, −1 if that is the denser one's, 0 if there
    // is nothing special.
    with_ghost: vec4f,
    with_background: vec4f,
}

struct Bodies {
    list: array<Body, 144>,
    count: u32,
    // What is shorter than that, in mm along a ray, is no stretch of it.
    tiny_mm: f32,
    // Texel value of the smallest data value, and 1 / (the largest's − that).
    lowest_value: f32,
    value_scale: f32,
}

@group(1) @binding(18) var<uniform> bodies: Bodies;
#if meetings
// How much of a meeting shows, by the value at rest (x) and the moved one (y): two layers for each body, with its ghost and with the
// background.
@group(1) @binding(19) var strengths: texture_2d_array<f32>;
#end
