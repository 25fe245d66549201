// Trilinear reconstruction by eight loads, for adapters that cannot filter the volume's format.

fn sample_volume(data: texture_3d<f32>, filtering: sampler, p: vec3f, texel_scale: vec3f) -> f32 {
    let last = vec3i(textureDimensions(data)) - 1;
    let q = clamp(p, vec3f(0.0), vec3f(last));
    let base = vec3i(floor(q));
    let w = q - vec3f(base);
    let next = min(base + 1, last);
    let c00 = mix(load(data, base.x, base.y, base.z), load(data, next.x, base.y, base.z), w.x);
    let c10 = mix(load(data, base.x, next.y, base.z), load(data, next.x, next.y, base.z), w.x);
    let c01 = mix(load(data, base.x, base.y, next.z), load(data, next.x, base.y, next.z), w.x);
    let c11 = mix(load(data, base.x, next.y, next.z), load(data, next.x, next.y, next.z), w.x);
    return mix(mix(c00, c10, w.y), mix(c01, c11, w.y), w.z);
}

fn load(data: texture_3d<f32>, x: i32, y: i32, z: i32) -> f32 {
    return textureLoad(data, vec3i(x, y, z), 0).x;
}
