// How a ray goes through a cell that was moved without a turn, where all were (docs/rendering.md §10).
#import bind/object
#import lib/part
#import lib/through
#import {pose}

// Texels of a cell before its walls.
const CELL_TEXELS: u32 = 1u;

// The ray in the cell of an entry.
fn through(entry: u32, ray: Ray) -> Through {
    let cell = part_texel(entry).x;
    let shift = part_floats(cell);
    let origin = ray.origin + shift.xyz;
    let box = intersect_box(origin, ray.direction, vec3f(-0.5), object.box_max);
    let walls = between_walls(cell + CELL_TEXELS, u32(shift.w), ray);
    return Through(origin, ray.direction, within_both(box, walls.span), Pose(walls.enter, walls.leave));
}
