// The transfer functions' tables, interpolated by the adapter's filter.
#import bind/object

// `place`: front and back, in entries.
fn look_up(place: vec2f, layer: u32) -> vec4f {
    let size = vec2f(textureDimensions(transfer_function));
    let uv = (place + 0.5) / size;
#if functions
    return textureSampleLevel(transfer_function, style_sampler, uv, layer, 0.0);
#else
    return textureSampleLevel(transfer_function, style_sampler, uv, 0.0);
#end
}
