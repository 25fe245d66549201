// The raycaster: one object, whole or its parts one after the other, into a tile of the picture.
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
#import lib/opacity
#import lib/looks
#import lib/ray
#import lib/skip
#import lib/stretch
#import {seen}
#import {sampling}
#import {resume}
#if functions
#import lib/functions
#end
#if regions
#import bind/regions
#end
#if cuts
#import lib/cut_face
#end
#if parts
#import {through}
#else
#import lib/covered
#end

@vertex
fn vs_raycast(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    return fullscreen_triangle(vertex);
}

@fragment
fn fs_raycast(@builtin(position) position: vec4f) -> @location(0) vec4f {
    // The picture's integer pixel: every tiling computes the same ray, bit for bit.
    let pixel = vec2u(position.xy) * frame.stride + frame.tile_origin;
    let ray = ray_from_pixel(pixel);
    let axes = ray_frame(ray.world_direction);
    var accumulated = resume(vec2u(position.xy));
#if parts
    // The part that is walked through, and its pieces; the entry of the tile's list that is next.
    var march: March;
    var steps = 0.0;
    var count = 0u;
    var k = 0u;
    let list = list_of(pixel);
    var entry = list.x;
    // What the parts before took, as pieces.
    var base = 0u;
    var is_over = 1.0 - accumulated.a < frame.termination;
    let walked = frame.pieces.y - frame.pieces.x;
#else
    let span = intersect_box(ray.origin, ray.direction, vec3f(-0.5), object.box_max);
    let march = march_of(ray, axes, ray.origin, ray.direction, span.x, Pose(0u));
    let steps = (span.y - span.x) / march.step_mm;
    let all = min(num_pieces(steps), frame.pieces.y);
    let walked = all - min(frame.pieces.x, all);
    let covered = covered_pieces(pixel, ray, span.x, march.step_mm, all);
    let count = covered.y;
    var k = select(max(frame.pieces.x, covered.x), count, 1.0 - accumulated.a < frame.termination);
#end
    // What is left for looks beyond one a part, so that a software adapter never ends the loops by itself.
#if regions
    var spare = i32(MAX_ROUNDS) - i32(walked * regions.rounds_per_piece);
#else
    var spare = i32(MAX_ROUNDS) - i32(walked * ROUNDS_PER_PIECE);
#end
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
#if contours
    // What κ_v is measured against: d₀, in steps, before the front and the back of the piece.
    var lagged: Lagged;
#end
    loop {
        var visible = false;
        var back = 0.0;
#if functions
        // Which kind of brick the piece is in, and the functions that may show something of it.
        var kind = 0u;
        var candidates = 0u;
#end
#if alpha
        var back_alpha = 0.0;
#end
#if parts
        loop {
#end
        loop {
            loop {
                if k >= count { break; }
                let brick = brick_of(march.first + piece_middle(k, steps) * march.stride);
                let cell = textureLoad(skip_map, brick, 0);
#if functions
                kind = cell.y;
#end
                if cell.x == 0u { break; }
                k = leap(brick, cell.x, march.first, march.stride, k);
                known = false;
                met = false;
            }
            if k >= count { break; }
            let boundary = piece_end(select(k, k + 1u, known), steps);
            back = sample_volume(volume, volume_sampler, march.first + boundary * march.stride, object.texel_scale);
#if functions
            candidates = may_show(kind, front, back);
            visible = known && candidates != 0u;
#else
            visible = known && functions_between(front, back) != 0u;
#end
#if alpha
            back_alpha = sample_color(colors, march.first + boundary * march.stride).a;
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
#if parts
            if visible || is_over { break; }
            // On into the next part.
            loop {
                is_over = entry >= list.y || base >= frame.pieces.y;
                if is_over { break; }
                let part = through(entry, ray);
                entry += 1u;
                march = march_of(ray, axes, part.origin, part.direction, part.span.x, part.pose);
                steps = max(part.span.y - part.span.x, 0.0) / march.step_mm;
                let all = num_pieces(steps);
                count = min(all, max(frame.pieces.y, base) - base);
                k = min(max(frame.pieces.x, base) - base, count);
                base += all + UNITS_PER_CELL;
                if k < count { break; }
            }
            known = false;
            met = false;
        }
#end
        if !visible { break; }

        let length_k = piece_length(k, steps);
        let exponent = march.step_mm / object.reference_length;
#if functions
        // What a look shows of a piece does not depend on what others show of it.
        let shows = layers_that_show(candidates, front, back);
#else
        let shows = u32(classify_piece(only_function(), front, back).extinction > 0.0);
#end
        let num_parts = select(0u, num_pieces(length_k * f32(PARTS)), shows != 0u);
#if cuts
        let cut = cut_face(march.first + piece_middle(k, steps) * march.stride, front, back, shows, march.pose);
#else
        let cut = vec4f(0.0);
#end
#if contours
        let lag = object.reference_length / march.step_mm;
        lagged.length = length_k;
        var e = u32(met);
        loop {
            lagged.front = lagged.back;
            lagged.back = gradient_at(march.first + (piece_end(k + e, steps) - lag) * march.stride);
            e += 1u;
            if e > 1u { break; }
        }
#end
        var ended = false;
        var j = u32(met);
        loop {
            let place = part_boundary(j, length_k);
            let next = edge_at(march.first + (f32(k) + place) * march.stride, march.pose);
            let before = part_boundary(max(j, 1u) - 1u, length_k);
            // At the front of the piece there is nothing yet to look at: one look at no length.
            let wanted = select(num_looks(edge.normal, next.normal), 1u, j == 0u);
            let looks = select(1u, wanted, spare >= 0);
#if regions
            spare -= i32((wanted - 1u) * regions.rounds_per_look);
#else
            spare -= i32(wanted * ROUNDS_PER_LOOK);
#end
            var i = 0u;
            loop {
                let share = 1.0 / f32(looks);
#if contours
                let stretch = Stretch(edge, next, f32(k), before, place, f32(i), share, lagged);
#else
                let stretch = Stretch(edge, next, f32(k), before, place, f32(i), share);
#end
                let found = seen(stretch, march, shows, cut);
                let opacity = opacity_correct(found.alpha, exponent * (place - before) * share);
                accumulated = composite(accumulated, found.style, select(opacity, 0.0, j == 0u || shows == 0u));
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
        // Of a piece that shows nothing after all, no boundary was looked at.
        met = shows != 0u;
        front = back;
#if alpha
        front_alpha = back_alpha;
#end
        k += 1u;
    }
    return accumulated;
}

// The march of a ray that enters a body at `enter` mm.
fn march_of(ray: Ray, axes: Axes, origin: vec3f, direction: vec3f, enter: f32, pose: Pose) -> March {
    // Δ in mm so that a step is `step_voxels` voxels long in index space, whatever the spacing.
    let step = frame.step_voxels / length(direction);
    return March(pose, origin + enter * direction, step * direction, ray.world_direction, axes,
        frame.near_depth + enter * ray.depth_per_mm, step * ray.depth_per_mm, step);
}
