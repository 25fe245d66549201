// A cell of an object's parts as a ray goes through it.
#import {pose}

// What a cell takes of a pass beside its pieces, in pieces: its walls.
const UNITS_PER_CELL: u32 = 8u;

// Where the ray begins in index space, its change per mm, and where it is inside, mm.
struct Through {
    origin: vec3f,
    direction: vec3f,
    span: vec2f,
    pose: Pose,
}

fn within_both(a: vec2f, b: vec2f) -> vec2f {
    return vec2f(max(a.x, b.x), min(a.y, b.y));
}
