// Lit-sphere styles (thesis §3.3): the normal, seen along the ray, picks a color and directional opacity.
#import bind/object
#import lib/nodes
#import lib/style

// Below this share of G the normal is partly noise: the style is read up to NOISE_LEVELS mips blurrier.
const NOISE_LEVELS: f32 = 3.0;

// Premultiplied color and α_d of a node coordinate (of nodes 0 … last_node, whose styles are in a row of `node_layers`), where the
// surface's ‖ĝ‖ is `steepness`. `level`: mip level that a pixel asks for.
fn shade(node: f32, last_node: f32, row: u32, n_xy: vec2f, steepness: f32, level: f32, axes: Axes, ray: vec3f) -> vec4f {
    let uv = style_uv(n_xy);
    let blurred = level + NOISE_LEVELS * (1.0 - smoothstep(0.0, SHARP_SURFACE, steepness));
    let nodes = nodes_around(node, last_node);
    let last = node_layer(nodes.second, row);
    var layer = node_layer(nodes.first, row);
    // Of one style, where both nodes have it: a software adapter ends loops early, and goes through both sides of an `if`.
    var share = select(1.0 - nodes.weight, 1.0, layer == last);
    var found = vec4f(0.0);
    loop {
        found += share * textureSampleLevel(styles, style_sampler, uv, layer, blurred);
        if layer == last { break; }
        layer = last;
        share = nodes.weight;
    }
    return found;
}

// |n_xy| = 1 lands on the outermost texel centers of the disc.
fn style_uv(n_xy: vec2f) -> vec2f {
    let on_disc = n_xy / max(1.0, length(n_xy));
    let size = f32(textureDimensions(styles).x);
    return 0.5 + vec2f(on_disc.x, -on_disc.y) * (0.5 - 0.5 / size);
}
