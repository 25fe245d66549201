// Regions (docs/rendering.md §8): which looks a place is shared out among.
#import bind/regions
#import lib/skip

// Texels in a row of textures that hold lists.
const LIST_WIDTH: u32 = 2048u;
// The slot of bricks that are wholly in a region, with the voxels around them.
const WHOLE: u32 = 0xffffffffu;
const SLOT_EDGE: u32 = 10u;
// What a voxel is divided into: with the 2048 texels of the longest edge, all that f32 tells apart.
const FRACTIONS: f32 = 8192.0;

// The brick of a place, first entry of its list, and how many there are.
struct List {
    brick: vec3i,
    first: u32,
    count: u32,
}

fn list_at(p: vec3f) -> List {
    let brick = clamp(brick_of(p), vec3i(0), vec3i(textureDimensions(directory)) - 1);
    let found = textureLoad(directory, brick, 0).xy;
    return List(brick, found.x, found.y);
}

// Look and slot of an entry of a brick's list.
fn entry_of(index: u32) -> vec2u {
    return textureLoad(entries, vec2u(index % LIST_WIDTH, index / LIST_WIDTH), 0).xy;
}

// A texel of a look; 0 is the background's.
fn look_texel(look: u32, texel: u32) -> vec4f {
    let index = 3u * look + texel;
    return textureLoad(region_looks, vec2u(index % LIST_WIDTH, index / LIST_WIDTH), 0);
}

// Index position in the atlas of the middle of the voxel before a slot's first.
fn slot_origin(slot: u32) -> vec3f {
    return vec3f((vec3u(slot) >> vec3u(0u, 10u, 20u) & vec3u(1023u)) * SLOT_EDGE) + 0.5;
}

// f at p, which is in the brick or half a voxel beside it.
fn membership(slot: u32, brick: vec3i, p: vec3f) -> f32 {
    // Rounded so that the sum is exact in f32: the same for a brick in any slot.
    let within = round(clamp(p - vec3f(brick * 8), vec3f(-1.0), vec3f(8.0)) * FRACTIONS) / FRACTIONS;
    let texel = slot_origin(slot) + (within + 1.0);
    return select(textureSampleLevel(atlas, style_sampler, texel * regions.atlas_scale, 0.0).x, 1.0, slot == WHOLE);
}
