// The transfer function's table, interpolated by hand, for adapters that cannot filter f32.
#import bind/object

// `ends`: front and back, 0 … 1 from the first entry's center to the last one's.
fn look_up(ends: vec2f) -> vec4f {
    let last = vec2i(textureDimensions(transfer_function)) - 1;
    let x = table_place(ends);
    let i = vec2i(x);
    let w = x - vec2f(i);
    let j = min(i + 1, last);
    let near = mix(textureLoad(transfer_function, i, 0), textureLoad(transfer_function, vec2i(j.x, i.y), 0), w.x);
    let far = mix(textureLoad(transfer_function, vec2i(i.x, j.y), 0), textureLoad(transfer_function, j, 0), w.x);
    return mix(near, far, w.y);
}
