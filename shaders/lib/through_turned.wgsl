// How a ray goes through a cell that lies anywhere (docs/rendering.md §10).
#import lib/part
#import lib/through
#import {pose}

// Texels of a cell before its walls.
const CELL_TEXELS: u32 = 9u;

// The ray in the cell of an entry.
fn through(entry: u32, ray: Ray) -> Through {
    let cell = part_texel(entry).x;
    let near = part_floats(cell);
    let dx = part_floats(cell + 1u);
    let dy = part_floats(cell + 2u);
    let x = part_floats(cell + 3u);
    let y = part_floats(cell + 4u);
    let z = part_floats(cell + 5u);
    let normal_x = part_floats(cell + 6u);
    let normal_y = part_floats(cell + 7u);
    let normal_z = part_floats(cell + 8u);
    let world = ray.world_direction;
    let origin = near.xyz + ray.screen.x * dx.xyz + ray.screen.y * dy.xyz;
    let direction = x.xyz * world.x + y.xyz * world.y + z.xyz * world.z;
    let box = intersect_box(origin, direction, vec3f(x.w, y.w, z.w), vec3f(normal_x.w, normal_y.w, normal_z.w));
    let walls = between_walls(cell + CELL_TEXELS, u32(dx.w), ray);
    let normal = mat3x3f(normal_x.xyz, normal_y.xyz, normal_z.xyz);
    let pose = part_pose(normal, near.w, walls.enter, walls.leave, mat3x3f(x.xyz, y.xyz, z.xyz));
    return Through(origin, direction, within_both(box, walls.span), pose);
}
