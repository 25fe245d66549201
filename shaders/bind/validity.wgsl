// Group 1, only for volumes with voxels that are no number: how far a position rests on real data.
#import bind/object

@group(1) @binding(9) var validity: texture_3d<f32>;

// Trilinear weight of the corners that have data.
fn validity_at(p: vec3f) -> f32 {
    return sample_volume(validity, volume_sampler, p, object.texel_scale);
}
