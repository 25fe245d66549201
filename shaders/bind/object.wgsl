// Group 1: the object that is drawn: its volume, look and skip map.

struct Object {
    // Columns take a world direction (mm) to index space.
    index_from_world_x: vec3f,
    // d₀, mm.
    reference_length: f32,
    index_from_world_y: vec3f,
    // Texel value at coordinate 0 of the transfer function's table, and coordinate (0 … 1) per texel unit.
    transfer_first: f32,
    index_from_world_z: vec3f,
    transfer_scale: f32,
    // Columns take differences of `gradient_volume` over two voxels to ĝ = g/G in the world, where it is not ĝ itself.
    world_from_gradient_x: vec3f,
    // κ, w̄ of a whole piece, and node coordinate of the materials that go on below and above the table.
    extinction_below: f32,
    world_from_gradient_y: vec3f,
    extinction_above: f32,
    world_from_gradient_z: vec3f,
    // Node coordinate of the last node.
    last_node: f32,
    // Largest index-space coordinate of the box: number of voxels − ½.
    box_max: vec3f,
    middle_below: f32,
    // 1 / number of voxels.
    texel_scale: vec3f,
    middle_above: f32,
    // World normals of the box's faces across x, y and z.
    face_x: vec3f,
    node_below: f32,
    face_y: vec3f,
    node_above: f32,
    face_z: vec3f,
    // Looks at the style per radian that the normal turns.
    looks_per_turn: f32,
    // Coordinate from which on values belong to the upper side of the transfer function's jump; above 1: it has none.
    jump: f32,
    // Width of contours, figure points.
    contour_pt: f32,
    // 1: opacity is modulated as in eq. 3.2.
    transparency: f32,
    // Texel value of the first cell of `may_show_map`, and cells per texel unit.
    first_cell: f32,
    // Color of contours; w: 1, or 0 where it is that of the style's rim.
    ink: vec4f,
    cells_per_texel: f32,
    pad0: f32,
    pad1: f32,
    pad2: f32,
}

@group(1) @binding(0) var<uniform> object: Object;
@group(1) @binding(1) var volume: texture_3d<f32>;
@group(1) @binding(2) var gradient_volume: texture_3d<f32>;
@group(1) @binding(3) var volume_sampler: sampler;
@group(1) @binding(4) var skip_map: texture_3d<u32>;
#if functions
@group(1) @binding(5) var transfer_function: texture_2d_array<f32>;
#else
@group(1) @binding(5) var transfer_function: texture_2d<f32>;
#end
@group(1) @binding(6) var node_layers: texture_2d<u32>;
@group(1) @binding(7) var styles: texture_2d_array<f32>;
@group(1) @binding(8) var style_sampler: sampler;
// Which functions may show something between two values, given by their cells: a bit each.
@group(1) @binding(17) var may_show_map: texture_2d<u32>;
