// Parts of an object (docs/rendering.md §10): which of them a ray may meet, and where it goes through one.
#import bind/parts
#import lib/ray
#import {pose}

const PART_ROW: u32 = 2048u;
// Texels of a cell before its walls, and of a wall.
const CELL_TEXELS: u32 = 9u;
const WALL_TEXELS: u32 = 3u;
// What a cell takes of a pass beside its pieces, in pieces: its walls.
const UNITS_PER_CELL: u32 = 8u;
const UNBOUNDED: f32 = 3e38;

// A cell as a ray goes through it: where it begins in index space, its change per mm, and where it is inside, mm.
struct Through {
    origin: vec3f,
    direction: vec3f,
    span: vec2f,
    pose: Pose,
}

// Where a ray is behind all walls, mm, and those that it comes in and goes out through.
struct Between {
    span: vec2f,
    enter: Wall,
    leave: Wall,
}

fn part_texel(i: u32) -> vec4u {
    return textureLoad(parts, vec2u(i % PART_ROW, i / PART_ROW), 0);
}

fn part_floats(i: u32) -> vec4f {
    return bitcast<vec4f>(part_texel(i));
}

// First entry of the list of a pixel's tile, and the one behind its last.
fn list_of(pixel: vec2u) -> vec2u {
    let tiling = part_texel(0u);
    let tile = pixel / tiling.x;
    return part_texel(1u + tile.x + tile.y * tiling.y).xy;
}

// The walls of which the first is at texel `first`.
fn between_walls(first: u32, num_walls: u32, ray: Ray) -> Between {
    let nothing = Wall(vec3f(0.0), vec4f(0.0, 0.0, 0.0, UNBOUNDED));
    var found = Between(vec2f(-UNBOUNDED, UNBOUNDED), nothing, nothing);
    let behind = first + WALL_TEXELS * num_walls;
    var i = first;
    loop {
        // Where there are no walls, there is a round that counts for nothing.
        let is_wall = i < behind;
        let plane = part_floats(i);
        let across = part_floats(i + 1u);
        let seen = across.z > 0.0;
        let wall = Wall(plane.xyz, select(nothing.plane, part_floats(i + 2u), seen));
        let height = plane.w + dot(ray.screen, across.xy);
        let rise = dot(plane.xyz, ray.world_direction);
        let parallel = abs(rise) < 1e-12;
        let t = select(-height / select(rise, 1.0, parallel), select(-UNBOUNDED, UNBOUNDED, height > 0.0), parallel);
        let enters = is_wall && (rise < 0.0 || parallel) && t > found.span.x;
        let leaves = is_wall && rise > 0.0 && !parallel && t < found.span.y;
        if enters {
            found.span.x = t;
            found.enter = wall;
        }
        if leaves {
            found.span.y = t;
            found.leave = wall;
        }
        i += WALL_TEXELS;
        if i >= behind { break; }
    }
    return found;
}

#if bodies
#else
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
    let span = vec2f(max(box.x, walls.span.x), min(box.y, walls.span.y));
    let normal = mat3x3f(normal_x.xyz, normal_y.xyz, normal_z.xyz);
    let pose = part_pose(normal, near.w, walls.enter, walls.leave, mat3x3f(x.xyz, y.xyz, z.xyz));
    return Through(origin, direction, span, pose);
}
#end
