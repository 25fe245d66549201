// Front-to-back over (thesis eq. 4.1), premultiplied linear.

// `style` is premultiplied by its own opacity; it goes in with `opacity` instead.
fn composite(front: vec4f, style: vec4f, opacity: f32) -> vec4f {
    let color = style.rgb / max(style.a, 1e-30);
    return front + (1.0 - front.a) * opacity * vec4f(color, 1.0);
}
