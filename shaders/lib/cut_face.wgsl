// Faces where what shows ends with a region rather than by its own values (docs/rendering.md §8). Once a piece: a software adapter
// goes through it whether it is needed or not.
#import lib/region
#import lib/transfer_function
#import {pose}
#if functions
#import lib/functions
#end
#if rows
#import lib/rows
#end

// Change over a voxel, as a share of what shows, from which on the end of a region is a face and no transition.
const SHARP_END: f32 = 0.25;

#if labels
#import lib/cut_face_labels
#else
// Outward normal in the world, and weight, at the middle p of a piece with these values at its ends.
fn cut_face(p: vec3f, front: f32, back: f32, shows: u32, pose: Pose) -> vec4f {
    let list = list_at(p);
    // What the regions want of the place half a voxel before and behind it along each axis, and how much of that shows.
    var wanted_before = vec3f(0.0);
    var wanted_behind = vec3f(0.0);
    var shown_before = vec3f(0.0);
    var shown_behind = vec3f(0.0);
    var i = 0u;
    loop {
        let is_rest = i >= list.count;
        let entry = entry_of(list.first + i);
        let opacity = shown_of(cut_look(select(entry.x, 0u, is_rest), pose), front, back, shows);
        let before = select(memberships(entry.y, list.brick, p, -0.5), max(1.0 - wanted_before, vec3f(0.0)), is_rest);
        let behind = select(memberships(entry.y, list.brick, p, 0.5), max(1.0 - wanted_behind, vec3f(0.0)), is_rest);
        wanted_before += before;
        wanted_behind += behind;
        shown_before += opacity * before;
        shown_behind += opacity * behind;
        i += 1u;
        if i >= list.count + num_cut_rest(pose) { break; }
    }
    let a = shown_before / max(wanted_before, vec3f(1.0));
    let b = shown_behind / max(wanted_behind, vec3f(1.0));
    let most = max(max(max(a.x, a.y), a.z), max(max(b.x, b.y), b.z));
    let change = b - a;
    let at_rest = regions.world_x * change.x + regions.world_y * change.y + regions.world_z * change.z;
    let world = turned(at_rest, pose);
    let weight = smoothstep(0.0, SHARP_END, length(change) / max(most, 1e-30));
    return vec4f(-world / max(length(world), 1e-30), weight);
}

#end
// How much of a look shows, without its style; up to a factor, where all have one function.
fn shown_of(look: u32, front: f32, back: f32, shows: u32) -> f32 {
    let opacity = abs(look_texel(look, 0u).w) - 1.0;
#if rows
    // Of what shows most of its rows: which of them are there is not asked.
    let count = num_rows(look);
    var most = 0.0;
    var row = 0u;
    loop {
        let layer = u32(look_texel(look_of_row(look, row), 1u).x);
        let piece = classify_piece(function_of_layer(layer, 0u), front, back);
        most = max(most, select(0.0, opacity * one_minus_exp(-piece.extinction), (shows >> layer & 1u) != 0u));
        row += 1u;
        if row >= count { break; }
    }
    return most;
#end
#if plain_functions
    let layer = u32(look_texel(look, 1u).x);
    let piece = classify_piece(function_of_layer(layer, 0u), front, back);
    return select(0.0, opacity * one_minus_exp(-piece.extinction), (shows >> layer & 1u) != 0u);
#end
#if no_functions
    return opacity;
#end
}

#if labels
#else
// f half a voxel beside p along x, y and z.
fn memberships(slot: u32, brick: vec3i, p: vec3f, offset: f32) -> vec3f {
    return vec3f(
        membership(slot, brick, p + vec3f(offset, 0.0, 0.0)),
        membership(slot, brick, p + vec3f(0.0, offset, 0.0)),
        membership(slot, brick, p + vec3f(0.0, 0.0, offset)),
    );
}
#end
