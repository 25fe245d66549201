// One triangle that covers the render target.

fn fullscreen_triangle(vertex: u32) -> vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}
