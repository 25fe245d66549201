// How looks of regions draw surfaces, besides their styles (docs/rendering.md §4).
#import lib/functions
#import lib/region

// A function with how a look draws it.
fn drawn_as(function: Function, look: u32) -> Function {
    var drawn = function;
#if contours
    drawn.contour_pt = look_texel(look, 1u).w;
    drawn.ink = vec4f(look_texel(look, 2u).rgb, look_texel(look, 2u).w % 2.0);
#end
#if transparency
    drawn.transparency = f32(look_texel(look, 2u).w >= 2.0);
#end
    return drawn;
}
