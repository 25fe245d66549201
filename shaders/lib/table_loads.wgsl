// The transfer functions' tables, interpolated by hand, for adapters that cannot filter f32.
#import bind/object

// `place`: front and back, in entries.
fn look_up(place: vec2f, layer: u32) -> vec4f {
    let last = vec2i(textureDimensions(transfer_function)) - 1;
    let i = vec2i(place);
    let w = place - vec2f(i);
    let j = min(i + 1, last);
    let near = mix(table_entry(i, layer), table_entry(vec2i(j.x, i.y), layer), w.x);
    let far = mix(table_entry(vec2i(i.x, j.y), layer), table_entry(j, layer), w.x);
    return mix(near, far, w.y);
}

fn table_entry(place: vec2i, layer: u32) -> vec4f {
#if functions
    return textureLoad(transfer_function, place, layer, 0);
#else
    return textureLoad(transfer_function, place, 0);
#end
}
