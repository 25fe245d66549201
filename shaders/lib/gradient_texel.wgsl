// ĝ from texels of its own: what central differences, one voxel apart, are at the voxels' centers. Between these they are linear,
// as the trilinear volume's own are.
#import bind/object

// ĝ per texel (GRADIENT_UNIT of gpu/upload.rs).
const GRADIENT_PER_TEXEL: f32 = 1.0 / 64.0;

// ĝ = g/G in the world, at rest. Beyond the outer voxel centers that of the edge goes on.
fn gradient_at(p: vec3f) -> vec3f {
    return GRADIENT_PER_TEXEL * textureSampleLevel(gradient_volume, style_sampler, (p + 0.5) * object.texel_scale, 0.0).xyz;
}
