// 1-D style transfer functions, pre-integrated (docs/rendering.md §5): what a piece of a ray shows, from the values at
// its front and its back.
#import bind/object
#import {function}
#import {table}

// What a look-up needs of a transfer function, besides its table.
struct Function {
    // Texel value at coordinate 0 of the table, and coordinate (0 … 1) per texel unit.
    first: f32,
    scale: f32,
    // Coordinate from which on values belong to the upper side of the jump; above 1: it has none.
    jump: f32,
    last_node: f32,
    // κ, node coordinate, and w̄ of a whole piece, of the materials that go on below and above the table.
    below: vec3f,
    above: vec3f,
    // Layer of its table, and row of its nodes' styles.
    layer: u32,
    row: u32,
#if contours
    // Width of its contours in figure points, and their color; w: 1, or 0 where it is that of the style's rim.
    contour_pt: f32,
    ink: vec4f,
#end
#if transparency
    // 1: opacity is modulated as in eq. 3.2.
    transparency: f32,
#end
}

// Place in the table, in entries, of coordinates 0 … 1. A jump of the transfer function has an entry for either side.
fn table_place(x: vec2f, jump: f32) -> vec2f {
    let cells = f32(textureDimensions(transfer_function).x - 2u);
    return x * cells + select(vec2f(0.0), vec2f(1.0), x >= vec2f(jump));
}

// Sums over the piece: κ̄, κ̄·ū and κ̄·w̄. ū: node coordinate (i + w: w of the way from node i to i + 1); w̄: where in the
// piece it is seen, 0 = front.
struct Piece {
    extinction: f32,
    node: f32,
    middle: f32,
}

// `front` and `back` are texel values. Between them the value is taken to change linearly. The part of that way which
// lies in the table's domain is looked up; before and behind it the outermost materials go on.
fn classify_piece(function: Function, front: f32, back: f32) -> Piece {
    let a = (front - function.first) * function.scale;
    let b = (back - function.first) * function.scale;
    let way = b - a;
    let constant = abs(way) < 1e-9;
    let to_ends = vec2f(-a, 1.0 - a) / select(way, 1.0, constant);
    let outside = a < 0.0 || a > 1.0;
    let enter = select(clamp(min(to_ends.x, to_ends.y), 0.0, 1.0), f32(outside), constant);
    let leave = select(clamp(max(to_ends.x, to_ends.y), 0.0, 1.0), 1.0, constant);
    let inside = leave - enter;
    let ends = clamp(vec2f(a + enter * way, a + leave * way), vec2f(0.0), vec2f(1.0));
    let found = look_up(table_place(ends, function.jump), function.layer);
    // (κ, κ·u, w̄) of what goes on before and behind.
    let below = vec3f(function.below.x, function.below.x * function.below.y, function.below.z);
    let above = vec3f(function.above.x, function.above.x * function.above.y, function.above.z);
    let before = select(below, above, a > 0.5);
    let behind = select(below, above, b > 0.5);
    let rest = 1.0 - leave;
    return Piece(
        enter * before.x + inside * found.x + rest * behind.x,
        enter * before.y + inside * found.y + rest * behind.y,
        enter * before.x * enter * before.z
            + inside * (found.x * enter + found.z * inside)
            + rest * behind.x * (leave + rest * behind.z),
    );
}

// Which of an object's functions may show something of a piece between two values, a bit each: never none where one does.
fn functions_between(front: f32, back: f32) -> u32 {
    let cells = f32(textureDimensions(may_show_map).x - 1u);
    let place = (vec2f(front, back) - object.first_cell) * object.cells_per_texel;
    return textureLoad(may_show_map, vec2u(clamp(place, vec2f(0.0), vec2f(cells))), 0).x;
}
