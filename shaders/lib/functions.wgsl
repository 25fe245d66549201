// Several functions from value to opacity (docs/rendering.md §8): which one a look has, and what shows of a piece at all.
#import bind/functions
#import lib/transfer_function

fn function_of_layer(layer: u32, row: u32) -> Function {
    let l = functions.layers[layer];
    var function: Function;
    function.first = l.first;
    function.scale = l.scale;
    function.jump = l.jump;
    function.last_node = l.last_node;
    function.below = l.below;
    function.above = l.above;
    function.layer = layer;
    function.row = row;
    return function;
}

// Of the functions that a kind of brick has, those that may show something between two values, a bit each: never none where one
// does.
fn may_show(kind: u32, front: f32, back: f32) -> u32 {
    return functions_between(front, back) & functions.kinds[kind / 4u][kind % 4u];
}

// Of some functions, those that do show something of a piece.
fn layers_that_show(candidates: u32, front: f32, back: f32) -> u32 {
    var left = candidates;
    var found = 0u;
    loop {
        if left == 0u { break; }
        let layer = firstTrailingBit(left);
        left &= left - 1u;
        let piece = classify_piece(function_of_layer(layer, 0u), front, back);
        found |= select(0u, 1u << layer, piece.extinction > 0.0);
    }
    return found;
}
