// How a piece of a ray that shows something is cut into parts, and how often each is looked at (docs/rendering.md §5).
#import bind/object

// Parts of a piece that shows something.
const PARTS: u32 = 4u;
// Looks at the style within one part of a piece, at most.
const MAX_LOOKS: u32 = 16u;
// Software adapters end a shader's loops silently after 65 535 rounds, summed over the nest.
const MAX_ROUNDS: u32 = 65000u;
#if patterns
// Rounds that a look takes: its own, one for each light, those of the curvature, and of two patterns.
const ROUNDS_PER_LOOK: u32 = 23u;
#end
#if only_lit
// Rounds that a look takes: its own, and one for each light.
const ROUNDS_PER_LOOK: u32 = 5u;
#end
#if neither_lit_nor_patterns
// Rounds that a look takes: its own, and those of two styles.
const ROUNDS_PER_LOOK: u32 = 3u;
#end
// Rounds that a piece takes without regions, with one look a part: a leap, two looks for something that shows, the ends of three
// loops, the lags of contours; and a part its end and its look.
const ROUNDS_PER_PIECE: u32 = 7u + (1u + ROUNDS_PER_LOOK) * PARTS;

// Place of boundary j of the parts of a piece, in steps from its front.
fn part_boundary(j: u32, length_k: f32) -> f32 {
    return min(f32(j) / f32(PARTS), length_k);
}

// How often the style is looked at between two normals.
fn num_looks(a: vec3f, b: vec3f) -> u32 {
    return u32(clamp(ceil(length(b - a) * object.looks_per_turn), 1.0, f32(MAX_LOOKS)));
}
