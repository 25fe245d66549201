// Group 0: what a frame says. One uniform block, written once per tile.

struct Frame {
    // Index-space point of the picture's center on the near plane, and its change per unit of screen x and y.
    near_origin: vec3f,
    // Length of a piece, in voxels along the ray.
    step_voxels: f32,
    near_dx: vec3f,
    termination: f32,
    near_dy: vec3f,
    // Depth of the near plane from the eye, mm.
    near_depth: f32,
    // World direction of the picture's center (unit), and its change per unit of screen x and y (0: orthographic).
    forward: vec3f,
    // Pixel size at depth 0 and its growth per mm of depth, in voxels of the object.
    footprint: f32,
    forward_dx: vec3f,
    footprint_growth: f32,
    forward_dy: vec3f,
    // Smallest spacing of the object's voxels, mm.
    voxel_mm: f32,
    // Unit camera axes in the world.
    right: vec3f,
    // Pixels in a figure point.
    pixels_per_pt: f32,
    up: vec3f,
    // Pixels along the edge of a tile of `coverage`.
    coverage_edge: u32,
    // Size of the whole picture and the first pixel of this tile.
    image_size: vec2u,
    tile_origin: vec2u,
    // First piece that this pass walks, and the first that it leaves to the next; among several bodies, in rounds of loops.
    pieces: vec2u,
    // Pixels of the picture from one pixel of this target to the next: above 1 for a sample of the picture.
    stride: vec2u,
}

@group(0) @binding(0) var<uniform> frame: Frame;
