// Group 1, only for volumes of colors: premultiplied linear RGBA, which every adapter filters, whatever it does with values.
#import bind/object

@group(1) @binding(10) var colors: texture_3d<f32>;

// Trilinear reconstruction; voxel centers at integer index, clamped to the edge.
fn sample_color(field: texture_3d<f32>, p: vec3f) -> vec4f {
    return textureSampleLevel(field, style_sampler, (p + 0.5) * object.texel_scale, 0.0);
}
