// What light does to a surface, from a map (docs/rendering.md §4).
#import bind/lighting

// Ambient, diffuse and specular.
fn light_terms(n_l: f32, n_h: f32) -> vec3f {
    // The map's ends are the centers of the outermost texels.
    let size = f32(textureDimensions(lighting_map).x);
    let place = clamp(vec2f(0.5 + 0.5 * n_l, 1.0 - n_h), vec2f(0.0), vec2f(1.0));
    return textureSampleLevel(lighting_map, style_sampler, (place * (size - 1.0) + 0.5) / size, 0.0).xyz;
}
