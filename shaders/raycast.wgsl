// The raycaster: one object, 1-D style transfer function, into a tile of the picture.
// Result: premultiplied linear RGBA in f32, background not included.
//
// Structure (three phases in nested loops, because a software adapter runs both sides of every `if`
// but ends loops early): A leaps over empty bricks, B samples until something is visible,
// C shades and composites that one sample; around and around.
#import bind/frame
#import bind/object
#import lib/composite
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
    let num_samples = num_pieces(steps);
    let first = ray.origin + span.x * ray.direction;
    let stride = step * ray.direction;
    let axes = ray_frame(ray.world_direction);
    let exponent = step / object.reference_length;

    var accumulated = vec4f(0.0);
    var k = 0u;
    loop {
        var visible = false;
        var p = vec3f(0.0);
        var material = Classified(0.0, 0.0);
        loop {
            loop {
                if k >= num_samples { break; }
                p = first + piece_middle(k, steps) * stride;
                let brick = brick_of(p);
                let distance = textureLoad(skip_map, brick, 0).x;
                if distance == 0u { break; }
                k = leap(brick, distance, first, stride, k);
            }
            if k >= num_samples { break; }
            let value = sample_volume(volume, volume_sampler, p, object.texel_scale);
            material = classify(transfer_function, value, object.transfer_first, object.transfer_scale);
            material.opacity *= validity_at(p);
            if material.opacity > 0.0 {
                visible = true;
                break;
            }
            k += 1u;
        }
        if !visible { break; }

        let g = gradient_at(p);
        let depth = frame.near_depth + (span.x + piece_middle(k, steps) * step) * ray.depth_per_mm;
        let style = shade(material.node, g, ray.world_direction, axes, style_level(depth));
        accumulated = composite(accumulated, style, opacity_correct(style.a * material.opacity, exponent * piece_length(k, steps)));
        k += 1u;
        if 1.0 - accumulated.a < frame.termination {
            accumulated /= accumulated.a;
            break;
        }
    }
    return accumulated;
}
