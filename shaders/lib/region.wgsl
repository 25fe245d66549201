// Regions (docs/rendering.md §8): which looks a place is shared out among, and what shows of a piece at all.
#import bind/regions
#import lib/transfer_function

// Rows of textures that hold lists.
const LIST_WIDTH: u32 = 2048u;
// The slot of bricks that are wholly in a region, with the voxels around them.
const WHOLE: u32 = 0xffffffffu;
const SLOT_EDGE: u32 = 10u;
// What a voxel is divided into: with the 2048 texels of the longest edge, all that f32 tells apart.
const FRACTIONS: f32 = 8192.0;

struct Look {
    function: Function,
    opacity: f32,
    // The object's d₀ in lengths of the look's own.
    lengths: f32,
    // Tint, and 1 if there is one.
    tint: vec4f,
}

fn function_of_layer(layer: u32, row: u32) -> Function {
    let l = regions.layers[layer];
    return Function(l.first, l.scale, l.jump, l.last_node, l.below, l.above, layer, row);
}

// Look 0 is the background's.
fn look_of(index: u32) -> Look {
    let place = vec2u(2u * index % LIST_WIDTH, 2u * index / LIST_WIDTH);
    let a = textureLoad(region_looks, place, 0);
    let b = textureLoad(region_looks, place + vec2u(1u, 0u), 0);
    return Look(function_of_layer(u32(a.x), u32(a.w)), a.y, a.z, b);
}

// Whether any look of a kind of brick may show something between two values: never no where one does.
fn may_show(kind: u32, front: f32, back: f32) -> bool {
    let cells = f32(textureDimensions(may_show_map).x - 1u);
    let place = (vec2f(front, back) - regions.first_cell) * regions.cells_per_texel;
    return textureLoad(may_show_map, vec2u(clamp(place, vec2f(0.0), vec2f(cells))), kind, 0).x > 0u;
}

// Of the layers that a kind of brick has, those that show something of a piece: a bit each.
fn layers_that_show(kind: u32, front: f32, back: f32) -> u32 {
    var left = regions.kinds[kind / 4u][kind % 4u];
    var found = 0u;
    loop {
        if left == 0u { break; }
        let layer = firstTrailingBit(left);
        left &= left - 1u;
        let piece = classify_piece(function_of_layer(layer, 0u), front, back);
        found |= select(0u, 1u << layer, piece.extinction > 0.0);
    }
    return found;
}

// Region and slot of an entry of a brick's list.
fn entry_of(index: u32) -> vec2u {
    return textureLoad(entries, vec2u(index % LIST_WIDTH, index / LIST_WIDTH), 0).xy;
}

// f at p, which is in the brick or half a voxel beside it.
fn membership(slot: u32, brick: vec3i, p: vec3f) -> f32 {
    let whole = slot == WHOLE;
    let at = select(slot, 0u, whole);
    let place = vec3u(at % regions.slots_x, at / regions.slots_x % regions.slots_y, at / (regions.slots_x * regions.slots_y));
    // Rounded so that the sum is exact in f32: the same for a brick in any slot.
    let within = round(clamp(p - vec3f(brick * 8), vec3f(-1.0), vec3f(8.0)) * FRACTIONS) / FRACTIONS;
    let texel = vec3f(place * SLOT_EDGE) + (within + 1.5);
    return select(textureSampleLevel(atlas, style_sampler, texel * regions.atlas_scale, 0.0).x, 1.0, whole);
}
