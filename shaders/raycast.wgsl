// The raycaster: one object, 1-D style transfer function, into a tile of the picture.
// Result: premultiplied linear RGBA in f32, background not included.
//
// Structure (nested loops, because a software adapter runs both sides of every `if` but ends loops early): A leaps over
// empty bricks, B goes on until a piece shows something, C walks the parts of that piece and looks at its surface as
// often as its normal turns; around and around.
#import bind/frame
#import bind/object
#import lib/composite
#import lib/face
#import lib/fullscreen
#import {gradient}
#import lib/opacity
#import lib/ray
#import lib/skip
#import lib/style
#import lib/transfer_function
#import {sampling}
#import {no_data}
#import {resume}
#if colors
#import lib/seen_color
#import lib/strongest_change
#import lib/tint
#end

// Parts of a piece that shows something.
const PARTS: u32 = 4u;
// Looks at the style within one part of a piece, at most.
const MAX_LOOKS: u32 = 16u;
// Software adapters end a shader's loops silently after 65 535 rounds, summed over the nest.
const MAX_ROUNDS: u32 = 65000u;

@vertex
fn vs_raycast(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    return fullscreen_triangle(vertex);
}

@fragment
fn fs_raycast(@builtin(position) position: vec4f) -> @location(0) vec4f {
    // The picture's integer pixel: every tiling computes the same ray, bit for bit.
    let pixel = vec2u(position.xy) * frame.stride + frame.tile_origin;
    let ray = ray_from_pixel(pixel);
    let span = intersect_box(ray.origin, ray.direction, object.box_max);
    // Δ in mm so that a step is `step_voxels` voxels long in index space, whatever the spacing.
    let step = frame.step_voxels / length(ray.direction);
    let steps = (span.y - span.x) / step;
    let count = min(num_pieces(steps), frame.pieces.y);
    let first = ray.origin + span.x * ray.direction;
    let stride = step * ray.direction;
    let axes = ray_frame(ray.world_direction);
    let exponent = step / object.reference_length;
    // What is left for looks beyond one a part, so that a software adapter never ends the loops by itself.
    let walked = count - min(frame.pieces.x, count);
    var spare = i32(MAX_ROUNDS) - i32(walked * (5u + 2u * PARTS));

    var accumulated = resume(vec2u(position.xy));
    var k = select(frame.pieces.x, count, 1.0 - accumulated.a < frame.termination);
    // The value at the front of piece k, once it is known: after a leap it is sampled first.
    var front = 0.0;
    var known = false;
#if alpha
    // Alpha there.
    var front_alpha = 0.0;
#end
    // Value, gradient and normal at the part boundary that was reached last; `met`: it is the front of piece k.
#if colors
    var edge = Edge(0.0, mat3x4f(), vec3f(0.0));
#else
    var edge = Edge(0.0, vec3f(0.0), vec3f(0.0));
#end
    var met = false;
    loop {
        var visible = false;
        var back = 0.0;
#if alpha
        var back_alpha = 0.0;
#end
        loop {
            loop {
                if k >= count { break; }
                let brick = brick_of(first + piece_middle(k, steps) * stride);
                let distance = textureLoad(skip_map, brick, 0).x;
                if distance == 0u { break; }
                k = leap(brick, distance, first, stride, k);
                known = false;
                met = false;
            }
            if k >= count { break; }
            let boundary = piece_end(select(k, k + 1u, known), steps);
            back = sample_volume(volume, volume_sampler, first + boundary * stride, object.texel_scale);
            visible = known && classify_piece(front, back).extinction > 0.0;
#if alpha
            back_alpha = sample_color(colors, first + boundary * stride).a;
            visible = visible && max(front_alpha, back_alpha) > 0.0;
#end
            if visible { break; }
            k += u32(known);
            known = true;
            front = back;
#if alpha
            front_alpha = back_alpha;
#end
            met = false;
        }
        if !visible { break; }

        let length_k = piece_length(k, steps);
        let num_parts = num_pieces(length_k * f32(PARTS));
        var ended = false;
        var j = u32(met);
        loop {
            let place = part_boundary(j, length_k);
            let next = edge_at(first + (f32(k) + place) * stride);
            let before = part_boundary(max(j, 1u) - 1u, length_k);
            // At the front of the piece there is nothing yet to look at: one look at no length.
            let wanted = select(num_looks(edge.normal, next.normal), 1u, j == 0u);
            let looks = select(1u, wanted, spare >= 0);
            spare -= i32(wanted);
            var i = 0u;
            loop {
                let share = 1.0 / f32(looks);
                let piece = classify_piece(mix(edge.value, next.value, f32(i) * share),
                    mix(edge.value, next.value, f32(i + 1u) * share));
                let seen = piece.middle / max(piece.extinction, 1e-30);
                let w = (f32(i) + seen) * share;
                let along = f32(k) + mix(before, place, w);
                let p = first + along * stride;
                let depth = frame.near_depth + (span.x + along * step) * ray.depth_per_mm;
#if colors
                let gradient = strongest_change(edge.gradient + w * (next.gradient - edge.gradient));
                let style = tint(shade(piece.node / max(piece.extinction, 1e-30), gradient, face_normal(p),
                    ray.world_direction, axes, style_level(depth)), seen_color(p));
#else
                let style = shade(piece.node / max(piece.extinction, 1e-30), mix(edge.gradient, next.gradient, w),
                    face_normal(p), ray.world_direction, axes, style_level(depth));
#end
                let alpha = style.a * one_minus_exp(-piece.extinction) * validity_at(p);
                let opacity = opacity_correct(alpha, exponent * (place - before) * share);
                accumulated = composite(accumulated, style, select(opacity, 0.0, j == 0u));
                i += 1u;
                if 1.0 - accumulated.a < frame.termination {
                    accumulated /= accumulated.a;
                    ended = true;
                }
                if i >= looks || ended { break; }
            }
            edge = next;
            j += 1u;
            if j > num_parts || ended { break; }
        }
        if ended { break; }
        met = true;
        front = back;
#if alpha
        front_alpha = back_alpha;
#end
        k += 1u;
    }
    return accumulated;
}

// What the data say at the boundary of two parts.
struct Edge {
    value: f32,
#if colors
    gradient: mat3x4f,
#else
    gradient: vec3f,
#end
    normal: vec3f,
}

fn edge_at(p: vec3f) -> Edge {
    let gradient = gradient_at(p);
    let value = sample_volume(volume, volume_sampler, p, object.texel_scale);
#if colors
    return Edge(value, gradient, surface_normal(strongest_change(gradient), face_normal(p)));
#else
    return Edge(value, gradient, surface_normal(gradient, face_normal(p)));
#end
}

// Place of boundary j of the parts of a piece, in steps from its front.
fn part_boundary(j: u32, length_k: f32) -> f32 {
    return min(f32(j) / f32(PARTS), length_k);
}

// How often the style is looked at between two normals.
fn num_looks(a: vec3f, b: vec3f) -> u32 {
    return u32(clamp(ceil(length(b - a) * object.looks_per_turn), 1.0, f32(MAX_LOOKS)));
}
