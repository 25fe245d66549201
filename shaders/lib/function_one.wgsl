// The object's only function from value to opacity.
#import bind/object

fn only_function() -> Function {
    var function: Function;
    function.first = object.transfer_first;
    function.scale = object.transfer_scale;
    function.jump = object.jump;
    function.last_node = object.last_node;
    function.below = vec3f(object.extinction_below, object.node_below, object.middle_below);
    function.above = vec3f(object.extinction_above, object.node_above, object.middle_above);
#if contours
    function.contour_pt = object.contour_pt;
    function.ink = object.ink;
#end
#if transparency
    function.transparency = object.transparency;
#end
    return function;
}
