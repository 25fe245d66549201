// The raycaster: one object, 1-D style transfer function, into a tile of the picture.
// Result: premultiplied linear RGBA in f32, background not included.
//
// Structure (three phases in nested loops, because a software adapter runs both sides of every `if`
// but ends loops early): A leaps over empty bricks, B goes on until a piece shows something,
// C shades and composites that one piece; around and around.
#import bind/frame
#import bind/object
#import lib/composite
#import lib/face
#import lib/fullscreen
#import lib/gradient
#import lib/opacity
#import lib/ray
#import lib/skip
#import lib/style
#import lib/transfer_function
#import {sampling}
#import {no_data}

@vertex
fn vs_raycast(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    return fullscreen_triangle(vertex);
}

@fragment
fn fs_raycast(@builtin(position) position: vec4f) -> @location(0) vec4f {
    // The picture's integer pixel: every tiling computes the same ray, bit for bit.
    let pixel = vec2u(position.xy) + frame.tile_origin;
    let ray = ray_from_pixel(pixel);
    let span = intersect_box(ray.origin, ray.direction, object.box_max);
    // Δ in mm so that a step is `step_voxels` voxels long in index space, whatever the spacing.
    let step = frame.step_voxels / length(ray.direction);
    let steps = (span.y - span.x) / step;
    let count = num_pieces(steps);
    let first = ray.origin + span.x * ray.direction;
    let stride = step * ray.direction;
    let axes = ray_frame(ray.world_direction);
    let exponent = step / object.reference_length;

    var accumulated = vec4f(0.0);
    var k = 0u;
    // The value at the front of piece k, once it is known: after a leap it is sampled first.
    var front = 0.0;
    var known = false;
    loop {
        var visible = false;
        var back = 0.0;
        var piece = Piece(0.0, 0.0, 0.0);
        loop {
            loop {
                if k >= count { break; }
                let brick = brick_of(first + piece_middle(k, steps) * stride);
                let distance = textureLoad(skip_map, brick, 0).x;
                if distance == 0u { break; }
                k = leap(brick, distance, first, stride, k);
                known = false;
            }
            if k >= count { break; }
            let boundary = piece_end(select(k, k + 1u, known), steps);
            back = sample_volume(volume, volume_sampler, first + boundary * stride, object.texel_scale);
            piece = classify_piece(front, back);
            if known && piece.extinction > 0.0 {
                visible = true;
                break;
            }
            k += u32(known);
            known = true;
            front = back;
        }
        if !visible { break; }

        let along = f32(k) + piece.middle / piece.extinction * piece_length(k, steps);
        let p = first + along * stride;
        let depth = frame.near_depth + (span.x + along * step) * ray.depth_per_mm;
        let style = shade(piece.node / piece.extinction, gradient_at(p), face_normal(p), ray.world_direction, axes,
            style_level(depth));
        let alpha = style.a * one_minus_exp(-piece.extinction) * validity_at(p);
        accumulated = composite(accumulated, style, opacity_correct(alpha, exponent * piece_length(k, steps)));
        front = back;
        k += 1u;
        if 1.0 - accumulated.a < frame.termination {
            accumulated /= accumulated.a;
            break;
        }
    }
    return accumulated;
}
