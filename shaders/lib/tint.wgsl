// Colors of a volume under the light of a style.

// Rec. 709 weights of linear light.
const LUMINANCE: vec3f = vec3f(0.2126, 0.7152, 0.0722);

// Both premultiplied: the voxel's color as bright as the style is, with both opacities.
fn tint(style: vec4f, voxel: vec4f) -> vec4f {
    return vec4f(dot(LUMINANCE, style.rgb) * voxel.rgb, style.a * voxel.a);
}
