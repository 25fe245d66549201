// Group 2, only for rays with more pieces than one pass may walk: what the passes before have gathered.

@group(2) @binding(0) var gathered: texture_2d<f32>;

fn resume(tile_pixel: vec2u) -> vec4f {
    return textureLoad(gathered, tile_pixel, 0);
}
