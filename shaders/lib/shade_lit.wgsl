// A surface under lights (thesis §3.3.1): its styles say what color it is, and a model or a map what light does to it.
#import bind/lighting
#import bind/object
#import lib/nodes
#import {light}

// As that of lib/shade_style.
fn shade(node: f32, last_node: f32, row: u32, n_xy: vec2f, steepness: f32, level: f32, axes: Axes, ray: vec3f) -> vec4f {
    let nodes = nodes_around(node, last_node);
    let a = textureLoad(node_colors, vec2u(nodes.first, row), 0);
    let b = textureLoad(node_colors, vec2u(nodes.second, row), 0);
    let base = mix(a, b, nodes.weight);
    let across = n_xy / max(1.0, length(n_xy));
    let normal = vec3f(across, sqrt(max(1.0 - dot(across, across), 0.0)));
    var light = under_light(lighting.lights[0], normal, axes, ray);
#if several_lights
    var i = 1u;
    loop {
        if i >= lighting.count { break; }
        let more = under_light(lighting.lights[i], normal, axes, ray);
        light.own += more.own;
        light.of_light += more.of_light;
        i += 1u;
    }
#end
    let color = base.rgb / max(base.a, 1e-30);
    return base.a * vec4f(clamp(color * light.own + light.of_light, vec3f(0.0), vec3f(1.0)), 1.0);
}

// What light leaves of a surface's color, and brings of its own.
struct UnderLight {
    own: vec3f,
    of_light: vec3f,
}

fn under_light(light: Light, normal: vec3f, axes: Axes, ray: vec3f) -> UnderLight {
    let l = vec3f(dot(light.direction, axes.right), dot(light.direction, axes.up), -dot(light.direction, ray));
    let h = l + vec3f(0.0, 0.0, 1.0);
    let terms = light_terms(dot(normal, l), dot(normal, h / max(length(h), 1e-12)));
    return UnderLight(light.share * terms.x + light.color * terms.y, light.color * terms.z);
}
