// Parts of an object (docs/rendering.md §10): which of them a ray may meet, and where it goes through one.
#import bind/parts
#import lib/ray
#import lib/wall

const PART_ROW: u32 = 2048u;
// Texels of a wall.
const WALL_TEXELS: u32 = 3u;
const UNBOUNDED: f32 = 3e38;

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
