// Borders of regions by two look-ups (docs/rendering.md §8): the label of the nearest voxel, and how far the interpolated label is
// from it. A brick numbers its labels.
#import lib/region

// The brick of a place, the entry of its label number 0, and where its numbers are.
struct Labels {
    brick: vec3i,
    first: u32,
    slot: u32,
}

fn labels_at(p: vec3f) -> Labels {
    let brick = clamp(brick_of(p), vec3i(0), vec3i(textureDimensions(directory)) - 1);
    let found = textureLoad(directory, brick, 0).xy;
    return Labels(brick, found.x, found.y);
}

// The number of the label nearest to a place, and the share that its look has there.
struct Label {
    number: u32,
    share: f32,
}

// At p, which is in the brick or half a voxel beside it.
fn label_in(labels: Labels, p: vec3f) -> Label {
    let within = round(clamp(p - vec3f(labels.brick * 8), vec3f(-1.0), vec3f(8.0)) * FRACTIONS) / FRACTIONS;
    let texel = slot_origin(labels.slot) + (within + 1.0);
    let linear = textureSampleLevel(atlas, style_sampler, texel * regions.atlas_scale, 0.0).x;
    let nearest = textureLoad(atlas, vec3i(texel), 0).x;
    let t = abs(linear - nearest);
    let is_one = labels.slot == WHOLE;
    return Label(select(u32(nearest), 0u, is_one), select(max(1.0 - 4.0 * t * t, 0.0), 1.0, is_one));
}
