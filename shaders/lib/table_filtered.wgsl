// The transfer function's table, interpolated by the adapter's filter.
#import bind/object

// `ends`: front and back, 0 … 1 from the first entry's center to the last one's.
fn look_up(ends: vec2f) -> vec4f {
    let size = vec2f(textureDimensions(transfer_function));
    return textureSampleLevel(transfer_function, style_sampler, (table_place(ends) + 0.5) / size, 0.0);
}
