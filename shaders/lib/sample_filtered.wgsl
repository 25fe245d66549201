// Trilinear reconstruction by the adapter's filter; voxel centers at integer index, clamped to the edge.

fn sample_volume(data: texture_3d<f32>, filtering: sampler, p: vec3f, texel_scale: vec3f) -> f32 {
    return textureSampleLevel(data, filtering, (p + 0.5) * texel_scale, 0.0).x;
}
