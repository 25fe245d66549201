// 1-D style transfer function, tabulated: opacity and node coordinate (i + w: w of the way from node i to i+1).

struct Classified {
    opacity: f32,
    node: f32,
}

fn classify(table: texture_2d<f32>, value: f32, first: f32, scale: f32) -> Classified {
    let last = i32(textureDimensions(table).x) - 1;
    let x = clamp((value - first) * scale, 0.0, f32(last));
    let i = i32(x);
    let entry = mix(textureLoad(table, vec2i(i, 0), 0).xy, textureLoad(table, vec2i(min(i + 1, last), 0), 0).xy,
        x - f32(i));
    return Classified(entry.x, entry.y);
}
