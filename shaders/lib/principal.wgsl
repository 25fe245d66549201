// The direction in which a surface bends most, from how its normals turn (docs/rendering.md §4).
#import bind/object
#import bind/patterns
#import {gradient}
#if colors
#import lib/strongest_change
#end

// Below this turn, in radians over twice the reach, a surface is hardly curved.
const HARDLY_CURVED: f32 = 0.3;

// The unit normal of the volume at rest.
fn normal_at(p: vec3f) -> vec3f {
#if colors
    let g = strongest_change(gradient_at(p));
#else
    let g = gradient_at(p);
#end
    return g / max(length(g), 1e-30);
}

// Twice the angle, as a vector no longer than 1, between the direction in which the surface bends most and the first of two of its
// tangents at rest; shorter where it bends alike in all directions, or hardly.
fn principal_direction(p: vec3f, first: vec3f, second: vec3f) -> vec2f {
    let r = first / max(length(first), 1e-30);
    let off = second - dot(second, r) * r;
    let q = off / max(length(off), 1e-30);
    let to_index = mat3x3f(object.index_from_world_x, object.index_from_world_y, object.index_from_world_z);
    var turns = mat2x3f();
    var i = 0u;
    loop {
        let tangent = select(r, q, i >= 2u);
        let sign = select(1.0, -1.0, (i & 1u) == 1u);
        let m = sign * normal_at(p + to_index * (sign * patterns.reach * tangent));
        turns[0] += select(m, vec3f(0.0), i >= 2u);
        turns[1] += select(vec3f(0.0), m, i >= 2u);
        i += 1u;
        if i >= 4u { break; }
    }
    let a = dot(r, turns[0]);
    let c = dot(q, turns[1]);
    let b = 0.5 * (dot(r, turns[1]) + dot(q, turns[0]));
    let doubled = vec2f(0.5 * (a * a - c * c), b * (a + c));
    return doubled / (0.5 * (a * a + c * c) + b * b + HARDLY_CURVED * HARDLY_CURVED);
}
