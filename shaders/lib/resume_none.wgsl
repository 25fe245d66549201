// A ray begins with nothing.

fn resume(tile_pixel: vec2u) -> vec4f {
    return vec4f(0.0);
}
