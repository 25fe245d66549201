// A stretch of a ray that is looked at once: what the data say at its ends, and what one look shows of it.
#import bind/frame
#import bind/object
#import lib/face
#import lib/opacity
#import {shade}
#import lib/style
#import lib/transfer_function
#import {gradient}
#import {pose}
#import {no_data}
#if contours
#import lib/contour
#end
#if transparency
#import lib/modulated
#end
#if patterns
#import lib/pattern
#end
#if colors
#import lib/seen_color
#import lib/strongest_change
#import lib/tint
#end

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

fn edge_at(p: vec3f, pose: Pose) -> Edge {
    let value = sample_volume(volume, volume_sampler, p, object.texel_scale);
#if colors
    let gradient = gradient_at(p);
    return Edge(value, gradient, surface_normal(turned(strongest_change(gradient), pose), face_normal(p, pose)));
#else
    let gradient = turned(gradient_at(p), pose);
    return Edge(value, gradient, surface_normal(gradient, face_normal(p, pose)));
#end
}

// Look `index` of the 1/share looks at a part of piece k, which goes from `before` to `place` (in steps from the piece's front).
struct Stretch {
    edge: Edge,
    next: Edge,
    piece: f32,
    before: f32,
    place: f32,
    index: f32,
    share: f32,
#if contours
    // What κ_v is measured against.
    lagged: Lagged,
#end
}

#if contours
// How the data change a lag before the front and the back of a piece (ĝ at rest, or the colors' change), and its length in steps.
struct Lagged {
    front: Slope,
    back: Slope,
    length: f32,
}

// ĝ a lag before a place, in steps from the piece's front.
fn slope_before(lagged: Lagged, steps: f32, pose: Pose) -> vec3f {
    return change_of(lagged.front + steps / lagged.length * (lagged.back - lagged.front), pose);
}
#end

// What all stretches of a ray through a body have in common.
struct March {
    pose: Pose,
    // Index position of the first piece's front, and the change of a step.
    first: vec3f,
    stride: vec3f,
    // Unit direction in the world, and what normals are measured against along it.
    direction: vec3f,
    axes: Axes,
    // Eye depth of the first piece's front, mm, and the change of a step.
    depth: f32,
    depth_per_step: f32,
    // Length of a step, mm.
    step_mm: f32,
}

#if cuts
// ‖ĝ‖ up to which the end of a region makes a face, and from which on the data's own surface does.
const NO_MATERIAL_EDGE: f32 = 0.025;
const MATERIAL_EDGE: f32 = 0.05;
#end

// What is seen: a style's premultiplied color, and the opacity of a reference length, data's and style's together.
struct Seen {
    style: vec4f,
    alpha: f32,
#if meetings
    // How much of the place its looks have.
    share: f32,
#end
}

// The same of one look, before its tint.
struct Appearance {
    style: vec4f,
    alpha: f32,
#if contours
    // The color of a contour, and its share of what is seen.
    ink: vec4f,
#end
}

// The straight color `color` of what is seen, with what it has of a contour's.
fn inked(color: vec3f, found: Appearance) -> vec3f {
#if contours
    return mix(color, found.ink.rgb, found.ink.w);
#else
    return color;
#end
}

// The value a share `w` (0 … 1) of the stretch's way behind its front.
fn value_at(stretch: Stretch, w: f32) -> f32 {
    return mix(stretch.edge.value, stretch.next.value, (stretch.index + w) * stretch.share);
}

// ĝ there.
fn slope_at(stretch: Stretch, w: f32, pose: Pose) -> vec3f {
    let within = (stretch.index + w) * stretch.share;
#if colors
    return turned(strongest_change(stretch.edge.gradient + within * (stretch.next.gradient - stretch.edge.gradient)), pose);
#else
    return mix(stretch.edge.gradient, stretch.next.gradient, within);
#end
}

// That place, in steps along the ray.
fn along(stretch: Stretch, w: f32) -> f32 {
    return stretch.piece + mix(stretch.before, stretch.place, (stretch.index + w) * stretch.share);
}

// What a look shows of the stretch as which `piece` classifies it. `cut`: normal and weight of a face where a region ends.
fn appearance(piece: Piece, function: Function, stretch: Stretch, march: March, cut: vec4f) -> Appearance {
    let w = piece.middle / max(piece.extinction, 1e-30);
    let steps = along(stretch, w);
    let p = march.first + steps * march.stride;
    let node = piece.node / max(piece.extinction, 1e-30);
    let slope = slope_at(stretch, w, march.pose);
#if cuts
    let flatness = 1.0 - smoothstep(NO_MATERIAL_EDGE, MATERIAL_EDGE, length(slope));
    let face = joined_faces(face_normal(p, march.pose), vec4f(cut.xyz, cut.w * flatness));
#else
    let face = face_normal(p, march.pose);
#end
#if lit
    let level = 0.0;
#else
    let turns = (1.0 - face.w) * bend(stretch.edge.normal, stretch.next.normal, march.direction,
        (stretch.place - stretch.before) * march.step_mm);
    let level = style_level(march.depth + steps * march.depth_per_step, turns, march.pose);
#end
    let outward = surface_normal(slope, face);
    var n_xy = style_normal(outward, march.direction, march.axes);
#if contours
    let depth = march.depth + steps * march.depth_per_step;
    let pixel_mm = (frame.footprint + depth * frame.footprint_growth) * frame.voxel_mm;
    let width_mm = function.contour_pt * frame.pixels_per_pt * pixel_mm;
    let before = slope_before(stretch.lagged, steps - stretch.piece, march.pose);
    let bend = curvature(slope, before, march.direction, face.w, object.reference_length);
    let extent = contour_extent(width_mm, bend);
    let facing = facing_of(outward, march.direction);
    let covered = select(0.0, contour_coverage(width_mm, bend, facing, pixel_mm), function.ink.w > 0.0 && width_mm > 0.0);
    n_xy = select(pushed_out(n_xy, facing, extent), n_xy, function.ink.w > 0.0);
#else
    let extent = 0.0;
#end
#if patterns
    let shaded = shade(node, function.last_node, function.row, n_xy, steepness(slope, face), level, march.axes,
        march.direction);
    let eye_depth = march.depth + steps * march.depth_per_step;
    let covered_mm = (frame.footprint + eye_depth * frame.footprint_growth) * frame.voxel_mm;
    let style = patterned(shaded, node, function.last_node, function.row, p, outward, covered_mm, march.pose, march.axes,
        march.direction);
#else
    let style = shade(node, function.last_node, function.row, n_xy, steepness(slope, face), level, march.axes,
        march.direction);
#end
#if colors
    let voxel = seen_color(p, function);
    let colored = tint(style, voxel);
    let voxel_alpha = voxel.a;
#else
    let colored = style;
    let voxel_alpha = 1.0;
#end
#if transparency
    let plain = one_minus_exp(-piece.extinction);
    let shifted = modulated(plain, facing_of(outward, march.direction), extent, length(slope));
    let alpha_u = select(plain, shifted, function.transparency > 0.0);
#else
    let alpha_u = one_minus_exp(-piece.extinction);
#end
#if contours
    let alpha_d = mix(style.a, 1.0, covered);
    let ink = vec4f(function.ink.rgb, covered / max(alpha_d, 1e-30));
    return Appearance(colored, alpha_d * voxel_alpha * alpha_u * validity_at(p), ink);
#else
    return Appearance(colored, colored.a * alpha_u * validity_at(p));
#end
}
