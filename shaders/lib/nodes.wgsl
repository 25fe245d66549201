// Between which nodes of a transfer function a node coordinate lies, and which styles these have.
#import bind/object

struct Nodes {
    first: u32,
    second: u32,
    weight: f32,
}

fn nodes_around(node: f32, last_node: f32) -> Nodes {
    // Rounding must not reach past the outermost nodes.
    let within = clamp(node, 0.0, last_node);
    let first = floor(within);
    return Nodes(u32(first), u32(ceil(within)), within - first);
}

fn node_layer(node: u32, row: u32) -> u32 {
    return textureLoad(node_layers, vec2u(node, row), 0).x;
}
