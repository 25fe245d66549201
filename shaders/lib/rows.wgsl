// The rows of 2-D transfer functions (docs/rendering.md §4): a place between two of them is shared out.
#import bind/object
#import bind/regions
#import bind/rows
#import lib/region
#import lib/stretch

// The looks of the rows at or below a place and above it, and the share of the upper one.
struct Rows {
    lower: u32,
    upper: u32,
    weight: f32,
}

fn row_texel(index: u32) -> vec4f {
    return textureLoad(row_places, vec2u(index % LIST_WIDTH, index / LIST_WIDTH), 0);
}

// Look of row `row` of a look: the first is its own.
fn look_of_row(look: u32, row: u32) -> u32 {
    return select(u32(row_texel(2u * look).x) + row - 1u, look, row == 0u);
}

fn num_rows(look: u32) -> u32 {
    return 1u + u32(row_texel(2u * look).z);
}

// The second coordinate of a look at p, where ‖ĝ‖ is `edge`.
fn second_coordinate(kind: f32, by: vec4f, p: vec3f, edge: f32) -> f32 {
    let distance = dot(by, textureSampleLevel(distances, style_sampler, (p + 0.5) * regions.distance_scale, 0.0));
    return select(select(by.x, distance, kind < 0.0), min(edge, 1.0), kind == 0.0);
}

fn rows_at(look: u32, p: vec3f, edge: f32) -> Rows {
    let gaps = row_texel(2u * look);
    let place = second_coordinate(gaps.w, row_texel(2u * look + 1u), p, edge);
    let count = u32(gaps.z);
    // Number of the row, with the share of the way to the next one.
    var row = 0.0;
    var i = 0u;
    loop {
        let gap = row_texel(u32(gaps.y) + i);
        row += select(0.0, clamp((place - gap.x) * gap.y, 0.0, 1.0), i < count);
        i += 1u;
        if i >= count { break; }
    }
    let lower = u32(row);
    return Rows(look_of_row(look, lower), look_of_row(look, min(lower + 1u, count)), row - f32(lower));
}

// ‖ĝ‖ in the middle of a stretch.
fn edge_at_middle(stretch: Stretch, pose: Pose) -> f32 {
    return length(slope_at(stretch, 0.5, pose));
}
