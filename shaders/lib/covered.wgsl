// Which pieces of a ray may show anything, by what its tile of the picture has (docs/rendering.md §11).
#import bind/coverage
#import bind/frame
#import lib/ray

// The first piece and the one behind the last, of a ray through `pixel` that enters the volume at `enter` mm and has `num` pieces of
// `step_mm`. Rounding takes less than a piece.
fn covered_pieces(pixel: vec2u, ray: Ray, enter: f32, step_mm: f32, num: u32) -> vec2u {
    let depths = textureLoad(coverage, pixel / frame.coverage_edge, 0).xy;
    let steps = (depths / ray.depth_per_mm - enter) / step_mm;
    return min(vec2u(clamp(steps + vec2f(-2.0, 2.0), vec2f(0.0), vec2f(16777216.0))), vec2u(num));
}
