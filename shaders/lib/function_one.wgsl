// The object's only function from value to opacity.
#import bind/object

fn only_function() -> Function {
    return Function(object.transfer_first, object.transfer_scale, object.jump, object.last_node,
        vec3f(object.extinction_below, object.node_below, object.middle_below),
        vec3f(object.extinction_above, object.node_above, object.middle_above), 0u, 0u);
}
