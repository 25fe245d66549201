// What a stretch of a ray shows of an object with regions (docs/rendering.md §8): each look by its share of the place.
#import lib/region
#import lib/skip
#import lib/stretch
#import lib/tint

// ‖ĝ‖ up to which the end of a region makes a face, and from which on the data's own surface does.
const NO_MATERIAL_EDGE: f32 = 0.025;
const MATERIAL_EDGE: f32 = 0.05;
// Change over a voxel, as a share of what shows, from which on the end of a region is a face and no transition.
const SHARP_END: f32 = 0.25;
// Opacity that is 1 but for the rounding of shares.
const OPAQUE: f32 = 0.999999;

fn seen(stretch: Stretch, march: March, shows: u32) -> Seen {
    let p = march.first + along(stretch, 0.5) * march.stride;
    let size = vec3i(textureDimensions(directory));
    let brick = clamp(brick_of(p), vec3i(0), size - 1);
    let list = textureLoad(directory, brick, 0).xy;
    let cut = cut_face(stretch, p, brick, list, shows);
    var shown = vec4f(0.0);
    // What the regions want of the place.
    var wanted = 0.0;
    var i = 0u;
    loop {
        let is_rest = i >= list.y;
        let entry = entry_of(list.x + i);
        let look = look_of(select(entry.x, 0u, is_rest));
        let f = select(membership(entry.y, brick, p), max(1.0 - wanted, 0.0), is_rest);
        wanted += select(f, 0.0, is_rest);
        loop {
            if f <= 0.0 || (shows >> look.function.layer & 1u) == 0u { break; }
            let piece = classify_piece(look.function, value_at(stretch, 0.0), value_at(stretch, 1.0));
            let found = appearance(piece, look.function, stretch, march, cut);
            let color = found.style.rgb / max(found.style.a, 1e-30);
            let tinted = mix(color, dot(LUMINANCE, color) * look.tint.rgb, look.tint.a);
            let alpha = opacity_correct(look.opacity * found.alpha, look.lengths);
            shown += f * alpha * vec4f(tinted, 1.0);
            break;
        }
        i += 1u;
        if is_rest { break; }
    }
    shown /= max(wanted, 1.0);
    return Seen(shown, select(shown.a, 1.0, shown.a > OPAQUE));
}

// The face of what shows where it ends with a region rather than by its own values: outward normal in the world, and weight.
fn cut_face(stretch: Stretch, p: vec3f, brick: vec3i, list: vec2u, shows: u32) -> vec4f {
    let flat = 1.0 - smoothstep(NO_MATERIAL_EDGE, MATERIAL_EDGE, length(slope_at(stretch, 0.5)));
    // What the regions want of the place half a voxel before and behind it along each axis, and how much of that shows.
    var wanted_before = vec3f(0.0);
    var wanted_behind = vec3f(0.0);
    var shown_before = vec3f(0.0);
    var shown_behind = vec3f(0.0);
    var i = 0u;
    loop {
        if i > list.y || list.y == 0u || flat <= 0.0 { break; }
        let is_rest = i == list.y;
        let entry = entry_of(list.x + i);
        let look = look_of(select(entry.x, 0u, is_rest));
        let piece = classify_piece(look.function, value_at(stretch, 0.0), value_at(stretch, 1.0));
        let shown = (shows >> look.function.layer & 1u) != 0u;
        let opacity = select(0.0, look.opacity * one_minus_exp(-piece.extinction), shown);
        let before = select(memberships(entry.y, brick, p, -0.5), max(1.0 - wanted_before, vec3f(0.0)), is_rest);
        let behind = select(memberships(entry.y, brick, p, 0.5), max(1.0 - wanted_behind, vec3f(0.0)), is_rest);
        wanted_before += before;
        wanted_behind += behind;
        shown_before += opacity * before;
        shown_behind += opacity * behind;
        i += 1u;
    }
    let a = shown_before / max(wanted_before, vec3f(1.0));
    let b = shown_behind / max(wanted_behind, vec3f(1.0));
    let most = max(max(max(a.x, a.y), a.z), max(max(b.x, b.y), b.z));
    let change = b - a;
    let world = regions.world_x * change.x + regions.world_y * change.y + regions.world_z * change.z;
    let weight = flat * smoothstep(0.0, SHARP_END, length(change) / max(most, 1e-30));
    return vec4f(-world / max(length(world), 1e-30), weight);
}

// f half a voxel beside p along x, y and z.
fn memberships(slot: u32, brick: vec3i, p: vec3f, offset: f32) -> vec3f {
    return vec3f(
        membership(slot, brick, p + vec3f(offset, 0.0, 0.0)),
        membership(slot, brick, p + vec3f(0.0, offset, 0.0)),
        membership(slot, brick, p + vec3f(0.0, 0.0, offset)),
    );
}
