// The raycaster of objects with moved regions (docs/rendering.md §9): as raycast.wgsl, for several bodies that may lie in one
// another. A ray is cut where it enters and leaves bodies; in between, all that are there are walked through side by side.
//
// The loops are those of raycast.wgsl, each with one more over the bodies, tested at their ends: a software adapter goes through what
// follows a `break` once more. What finds the next stretch of the ray is in the innermost, as the others take a round for nothing
// wherever they are begun. Arrays are indexed by bodies.
#import bind/bodies
#import bind/frame
#import bind/object
#import bind/regions
#import lib/composite
#import lib/cut_face
#import lib/face
#import lib/fullscreen
#import lib/meeting
#import lib/opacity
#import lib/looks
#import lib/ray
#import lib/skip
#import lib/stretch
#import {pose}
#import {bodies}
#import {seen}
#import {sampling}
#import {resume}
#if functions
#import lib/functions
#end
#if parts
#import lib/part
#end

// What is farther than anything, mm.
const NEVER: f32 = 3e38;

@vertex
fn vs_raycast(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    return fullscreen_triangle(vertex);
}

@fragment
fn fs_raycast(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2u(position.xy) * frame.stride + frame.tile_origin;
    let ray = ray_from_pixel(pixel);
    let axes = ray_frame(ray.world_direction);
    // Of each body that may be met: the ray in its index space, and where (mm) it enters and leaves its box.
    var origins: array<vec3f, MAX_BODIES>;
    var directions: array<vec3f, MAX_BODIES>;
    var spans: array<vec2f, MAX_BODIES>;
#if parts
    // Which bodies these are.
    var ids: array<u32, MAX_BODIES>;
    let list = list_of(pixel);
    let num_bodies = list.y - list.x;
#else
    let num_bodies = bodies.count;
#end
    var i = 0u;
    loop {
#if parts
        let id = part_texel(list.x + i).x;
        ids[i] = id;
        let walls = between_walls(bodies.list[id].first_wall, bodies.list[id].num_walls, ray).span;
#else
        let id = i;
        let walls = vec2f(-NEVER, NEVER);
#end
        origins[i] = body_origin(id, ray.screen);
        directions[i] = body_direction(id, ray.world_direction);
        let span = intersect_box(origins[i], directions[i], bodies.list[id].box_low, bodies.list[id].box_high);
        spans[i] = vec2f(max(span.x, walls.x), min(span.y, walls.y));
        i += 1u;
        if i >= num_bodies { break; }
    }
    // What is left for looks beyond one a part, so that a software adapter never ends the loops by itself: besides pieces, there are
    // the ends of the stretches.
    var spare = i32(MAX_ROUNDS) - i32(frame.pieces.y - frame.pieces.x)
        - i32((2u * num_bodies + 2u) * (3u * num_bodies + 8u));
    var accumulated = resume(vec2u(position.xy));

    // The stretch of the ray that is walked through: from where to where, mm, with which bodies, and what a step of it is, mm.
    var begin = 0.0;
    var end = 0.0;
    var bodies_here = 0u;
    var step = 1.0;
    var steps = 0.0;
    // Rounds that the stretches before took, at most.
    var base = 0u;
    // The piece, and how many the stretch has for this pass, and in all.
    var k = 0u;
    var count = 0u;
    var num_all = 0u;
    var is_over = 1.0 - accumulated.a < frame.termination || num_bodies == 0u;

    // Of each body: the values at the front and at the back of piece k; `known`: a bit for each whose front is known.
    var fronts: array<f32, MAX_BODIES>;
    var backs: array<f32, MAX_BODIES>;
    var known = 0u;
#if alpha
    var front_alphas: array<f32, MAX_BODIES>;
    var back_alphas: array<f32, MAX_BODIES>;
#end
    // The kind of brick, then the functions that may show something of the piece, then those that do.
    var shows: array<u32, MAX_BODIES>;
    var faces: array<vec4f, MAX_BODIES>;
#if contours
    var lags: array<Lagged, MAX_BODIES>;
#end
    // At the part boundary that was reached last; `met`: the bodies for which it is the front of piece k.
    var edges: array<Edge, MAX_BODIES>;
    var met = 0u;
    loop {
        // The bodies that show something of piece k.
        var visible = 0u;
        // Those of which a brick with something in it is there.
        var present = 0u;
        loop {
            loop {
                loop {
                    // The next stretch with the same bodies.
                    if k < count || is_over { break; }
                    base += num_all * countOneBits(bodies_here) * regions.rounds_per_piece;
                    begin = NEVER;
                    var n = 0u;
                    loop {
                        let enter = max(spans[n].x, end);
                        begin = select(begin, min(begin, enter), spans[n].y > enter + bodies.tiny_mm);
                        n += 1u;
                        if n >= num_bodies { break; }
                    }
                    end = NEVER;
                    bodies_here = 0u;
                    var fastest = 0.0;
                    n = 0u;
                    loop {
                        let span = spans[n];
                        let is_real = span.y > max(span.x, begin) + bodies.tiny_mm;
                        let is_here = is_real && span.x <= begin + bodies.tiny_mm;
                        end = select(end, min(end, select(span.x, span.y, is_here)), is_real);
                        bodies_here |= select(0u, 1u << n, is_here);
                        fastest = select(fastest, max(fastest, length(directions[n])), is_here);
                        n += 1u;
                        if n >= num_bodies { break; }
                    }
                    is_over = begin >= NEVER || base >= frame.pieces.y;
                    // Δ in mm so that a step is `step_voxels` voxels of the finest body.
                    step = frame.step_voxels / max(fastest, 1e-30);
                    steps = select((end - begin) / step, 0.0, is_over);
                    num_all = num_pieces(steps);
                    // A piece belongs to the pass in whose rounds it begins.
                    let each = max(countOneBits(bodies_here), 1u) * regions.rounds_per_piece;
                    count = min(num_all, (max(frame.pieces.y, base) - base + each - 1u) / each);
                    k = min((max(frame.pieces.x, base) - base + each - 1u) / each, count);
                    known = 0u;
                    met = 0u;
                }
                if k >= count { break; }
                present = 0u;
                var next = count;
                var left = bodies_here;
                loop {
                    let b = firstTrailingBit(left);
                    left &= left - 1u;
#if parts
                    let body = ids[b];
#else
                    let body = b;
#end
                    let first = origins[b] + begin * directions[b];
                    let stride = step * directions[b];
                    let brick = brick_in_body(first + piece_middle(k, steps) * stride, body);
                    let cell = skip_cell_of(brick, body);
                    shows[b] = cell.y;
                    present |= select(0u, 1u << b, cell.x == 0u);
                    next = min(next, leap(brick, max(cell.x, 1u), first, stride, k));
                    if left == 0u { break; }
                }
                if present != 0u { break; }
                k = next;
                known = 0u;
                met = 0u;
            }
            if k >= count { break; }
            let waiting = present & ~known;
            var left = present;
            loop {
                let b = firstTrailingBit(left);
                left &= left - 1u;
                let is_known = (known >> b & 1u) != 0u;
                let p = place_in(origins[b], directions[b], begin + piece_end(select(k, k + 1u, is_known), steps) * step);
                let value = sample_volume(volume, volume_sampler, p, object.texel_scale);
                let front = select(value, fronts[b], is_known);
                fronts[b] = front;
                backs[b] = value;
#if functions
                let candidates = may_show(shows[b], front, value);
                shows[b] = candidates;
                var shown = candidates != 0u;
#else
                var shown = classify_piece(only_function(), front, value).extinction > 0.0;
#end
#if alpha
                let alpha = sample_color(colors, p).a;
                let front_alpha = select(alpha, front_alphas[b], is_known);
                front_alphas[b] = front_alpha;
                back_alphas[b] = alpha;
                shown = shown && max(front_alpha, alpha) > 0.0;
#end
                visible |= select(0u, 1u << b, shown && waiting == 0u);
                if left == 0u { break; }
            }
            known |= present;
            if visible != 0u { break; }
            if waiting == 0u {
                // Nothing here: on, with the backs as fronts.
                k += 1u;
                known = present;
                met = 0u;
                left = present;
                loop {
                    let b = firstTrailingBit(left);
                    left &= left - 1u;
                    fronts[b] = backs[b];
#if alpha
                    front_alphas[b] = back_alphas[b];
#end
                    if left == 0u { break; }
                }
            }
        }
        if visible == 0u { break; }

        let exponent = step / object.reference_length;
        let length_k = piece_length(k, steps);
        let num_parts = num_pieces(length_k * f32(PARTS));
#if functions
        var asked = visible;
        loop {
            let b = firstTrailingBit(asked);
            asked &= asked - 1u;
            shows[b] = layers_that_show(shows[b], fronts[b], backs[b]);
            visible &= select(~(1u << b), 0xffffffffu, shows[b] != 0u);
            if asked == 0u { break; }
        }
#end
        var ending = select(visible, 1u, visible == 0u);
        loop {
            let b = firstTrailingBit(ending);
            ending &= ending - 1u;
#if parts
            let body = ids[b];
#else
            let body = b;
#end
            let middle = place_in(origins[b], directions[b], begin + piece_middle(k, steps) * step);
            faces[b] = cut_face(middle, fronts[b], backs[b], faces_of(shows[b], body), pose_of(body, ray));
#if contours
            let before_front = begin + f32(k) * step - object.reference_length;
            let before_back = begin + piece_end(k + 1u, steps) * step - object.reference_length;
            lags[b] = Lagged(gradient_at(place_in(origins[b], directions[b], before_front)),
                gradient_at(place_in(origins[b], directions[b], before_back)), length_k);
#end
            if ending == 0u { break; }
        }
        var j = u32(visible != 0u && (visible & ~met) == 0u);
        loop {
            let place = part_boundary(j, length_k);
            let before = part_boundary(max(j, 1u) - 1u, length_k);
            let exponent_j = exponent * (place - before);
            var meeting = nothing_meets();
            // What the last body shows: all there is, where it is alone.
            var own = vec4f(0.0);
            // Where nothing is left that shows, any: it counts for nothing.
            var left = select(visible, 1u, visible == 0u);
            loop {
                let b = firstTrailingBit(left);
                left &= left - 1u;
#if parts
                let body = ids[b];
#else
                let body = b;
#end
                let march = March(pose_of(body, ray), origins[b] + begin * directions[b], step * directions[b], ray.world_direction,
                    axes, frame.near_depth + begin * ray.depth_per_mm, step * ray.depth_per_mm, step);
                let edge = edges[b];
                let next = edge_at(march.first + (f32(k) + place) * march.stride, march.pose);
                let wanted = select(num_looks(edge.normal, next.normal), 1u, j == 0u);
                let looks = select(1u, wanted, spare >= 0);
                spare -= i32((wanted - 1u) * regions.rounds_per_look);
                let share = 1.0 / f32(looks);
                own = vec4f(0.0);
                var part_of = 0.0;
                var n = 0u;
                loop {
#if contours
                    let stretch = Stretch(edge, next, f32(k), before, place, f32(n), share, lags[b]);
#else
                    let stretch = Stretch(edge, next, f32(k), before, place, f32(n), share);
#end
                    let found = seen(stretch, march, shown_layers(shows[b]), faces[b]);
                    own = composite(own, found.style, opacity_correct(found.alpha, exponent_j * share));
#if meetings
                    part_of += share * found.share;
#end
                    n += 1u;
                    if n >= looks { break; }
                }
                edges[b] = next;
                own = select(own, vec4f(0.0), j == 0u);
                let alpha = opacity_correct(own.a, 1.0 / max(exponent_j, 1e-30));
                meeting = joined_by(meeting, body, Shown(own.rgb / max(own.a, 1e-30), alpha, part_of, 0.5 * (edge.value + next.value)));
                if left == 0u { break; }
            }
            let seen_here = what_meets(meeting);
            let is_one = (visible & (visible - 1u)) == 0u;
            let alpha = select(opacity_correct(seen_here.a, exponent_j), own.a, is_one);
            let color = select(seen_here.rgb, own.rgb / max(own.a, 1e-30), is_one);
            accumulated = composite(accumulated, vec4f(color, 1.0), select(alpha, 0.0, j == 0u || visible == 0u));
            j += 1u;
            if j > num_parts || visible == 0u || 1.0 - accumulated.a < frame.termination { break; }
        }
        if 1.0 - accumulated.a < frame.termination { break; }
        met = visible;
        k += 1u;
        known = present;
        var left = present;
        loop {
            let b = firstTrailingBit(left);
            left &= left - 1u;
            fronts[b] = backs[b];
#if alpha
            front_alphas[b] = back_alphas[b];
#end
            if left == 0u { break; }
        }
    }
    if 1.0 - accumulated.a < frame.termination {
        accumulated /= accumulated.a;
    }
    return accumulated;
}

// Index position at t mm.
fn place_in(origin: vec3f, direction: vec3f, t: f32) -> vec3f {
    return origin + t * direction;
}

// Index position, as a body lies, of the pixel's ray on the near plane.
fn body_origin(b: u32, screen: vec2f) -> vec3f {
    return bodies.list[b].near_origin + screen.x * bodies.list[b].near_dx + screen.y * bodies.list[b].near_dy;
}

// Its change per mm.
fn body_direction(b: u32, world: vec3f) -> vec3f {
    return bodies.list[b].index_from_world_x * world.x + bodies.list[b].index_from_world_y * world.y
        + bodies.list[b].index_from_world_z * world.z;
}

// Functions that show something of a piece, where there are several; else the only one, in whatever kind of brick.
fn shown_layers(shows: u32) -> u32 {
#if functions
    return shows;
#else
    return 1u;
#end
}

// Functions whose ends make faces in a body.
fn faces_of(shows: u32, b: u32) -> u32 {
    let is_shared = bodies.list[b].first_cut_look != bodies.list[b].first_look;
    return select(shown_layers(shows), 0xffffffffu, is_shared);
}

// The brick of a place: one of those that the body has, whatever rounding says.
fn brick_in_body(p: vec3f, body: u32) -> vec3i {
    return clamp(brick_of(p), bodies.list[body].first_brick, bodies.list[body].last_brick);
}

// What the skip map has of it.
fn skip_cell_of(brick: vec3i, body: u32) -> vec4u {
    return textureLoad(skip_map, brick + bodies.list[body].to_map, 0);
}
