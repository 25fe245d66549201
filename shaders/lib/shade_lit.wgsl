// A surface under lights (thesis §3.3.1): its styles say what color it is, and a lighting map what light does to it.
#import bind/lighting
#import bind/object
#import lib/nodes

// As that of lib/shade_style.
fn shade(node: f32, last_node: f32, row: u32, n_xy: vec2f, steepness: f32, level: f32, axes: Axes, ray: vec3f) -> vec4f {
    let nodes = nodes_around(node, last_node);
    let a = textureLoad(style_colors, vec2u(node_layer(nodes.first, row), 0u), 0);
    let b = textureLoad(style_colors, vec2u(node_layer(nodes.second, row), 0u), 0);
    let base = mix(a, b, nodes.weight);
    let across = n_xy / max(1.0, length(n_xy));
    let normal = vec3f(across, sqrt(max(1.0 - dot(across, across), 0.0)));
    // What there is of the surface's color, and of the lights' own.
    var own = vec3f(0.0);
    var light_of = vec3f(0.0);
    var i = 0u;
    loop {
        let light = lighting.lights[i];
        let l = vec3f(dot(light.direction, axes.right), dot(light.direction, axes.up), -dot(light.direction, ray));
        let h = l + vec3f(0.0, 0.0, 1.0);
        let found = textureSampleLevel(lighting_map, style_sampler, map_uv(dot(normal, l), dot(normal, h / max(length(h), 1e-12))), 0.0);
        own += light.share * found.x + light.color * found.y;
        light_of += light.color * found.z;
        i += 1u;
        if i >= lighting.count { break; }
    }
    let color = base.rgb / max(base.a, 1e-30);
    return base.a * vec4f(clamp(color * own + light_of, vec3f(0.0), vec3f(1.0)), 1.0);
}

// Of n·l and n·h: their ends are the centers of the outermost texels.
fn map_uv(n_l: f32, n_h: f32) -> vec2f {
    let size = f32(textureDimensions(lighting_map).x);
    let place = clamp(vec2f(0.5 + 0.5 * n_l, 1.0 - n_h), vec2f(0.0), vec2f(1.0));
    return (place * (size - 1.0) + 0.5) / size;
}
