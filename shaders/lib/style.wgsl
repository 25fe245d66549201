// Surfaces as rays see them (thesis §3.3): their normals, and what these are measured against.
#import bind/frame
#import bind/object
#import {pose}

// Below this share of G a gradient is rounding noise of the 16-bit copy: no surface. From the next one on it is one.
const NO_SURFACE: f32 = 2e-4;
const SURFACE: f32 = 2e-3;
// Below this share of G the normal is partly noise.
const SHARP_SURFACE: f32 = 0.02;

struct Axes {
    right: vec3f,
    up: vec3f,
}

// The camera's axes turned by the smallest rotation that takes the view axis to the ray, so that the rim of the
// sphere is where the surface turns away from the *ray*, everywhere in a perspective picture.
fn ray_frame(ray: vec3f) -> Axes {
    let view = normalize(frame.forward);
    let half_way = (view + ray) / (1.0 + dot(view, ray));
    return Axes(frame.right - dot(frame.right, ray) * half_way, frame.up - dot(frame.up, ray) * half_way);
}

// Below this share of a ray's way along a surface, its turn is not divided by it any further.
const LEAST_WAY: f32 = 0.25;
// Texels of a style from its center to its rim.
const STYLE_RADIUS: f32 = 127.5;

// κ, 1/mm: how fast a surface turns whose outward normals are `a` and, `length_mm` along the ray, `b`. Which of its sides is bright
// does not matter, and where there is hardly a surface, there is hardly a turn.
fn bend(a: vec3f, b: vec3f, ray: vec3f, length_mm: f32) -> f32 {
    let front = a / max(length(a), 1e-30);
    let outward = b / max(length(b), 1e-30);
    let back = select(outward, -outward, dot(front, outward) < 0.0);
    let middle = front + back;
    let way = length(cross(middle, ray)) / max(length(middle), 1e-30);
    return length(a) * length(b) * length(front - back) / (max(length_mm, 1e-30) * max(way, LEAST_WAY));
}

// Mip level at an eye depth: log2 of what a pixel covers, in voxels or, on a surface that turns by `bend` (1/mm), in texels.
fn style_level(depth: f32, bend: f32, pose: Pose) -> f32 {
    let pixel = frame.footprint + depth * frame.footprint_growth;
    return log2(max(1.0, pixel * max(voxels_of(pose), STYLE_RADIUS * frame.voxel_mm * bend)));
}

// Outward normal (towards lower values, or out of a face of the box), as long as there is a surface: 1 where there is
// one, 0 where there is none. In between it moves out from the style's center: a threshold would show noise as specks.
// `face`: normal of the box's face and its weight.
fn surface_normal(g: vec3f, face: vec4f) -> vec3f {
    let blend = mix(-g / max(length(g), 1e-30), face.xyz, face.w);
    return surface_strength(steepness(g, face)) / max(length(blend), 1e-30) * blend;
}

// How much of a surface a ‖ĝ‖ is.
fn surface_strength(steepness: f32) -> f32 {
    return smoothstep(NO_SURFACE, SURFACE, steepness);
}

// ‖ĝ‖, or what a face of the volume makes of it: a face is a sharp surface.
fn steepness(g: vec3f, face: vec4f) -> f32 {
    return max(length(g), face.w * SHARP_SURFACE);
}

// |n·v| of a surface normal: 1 where there is no surface.
fn facing_of(outward: vec3f, ray: vec3f) -> f32 {
    return 1.0 - length(outward) + abs(dot(outward, ray));
}

// n_xy of an outward normal.
fn style_normal(outward: vec3f, ray: vec3f, axes: Axes) -> vec2f {
    // Towards the eye: the whole vector, not only its depth.
    let n = select(outward, -outward, dot(outward, ray) > 0.0);
    return vec2f(dot(n, axes.right), dot(n, axes.up));
}
