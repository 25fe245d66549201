// ĝ by central differences, one voxel apart, of the (smoothed) volume: for volumes too large for texels of their own.
#import bind/object

// ĝ = g/G in the world, at rest. Beyond the outer voxel centers that of the edge goes on.
fn gradient_at(p: vec3f) -> vec3f {
    let within = clamp(p, vec3f(0.0), object.box_max - 0.5);
    return object.world_from_gradient_x * gradient_difference(within, vec3f(1.0, 0.0, 0.0))
        + object.world_from_gradient_y * gradient_difference(within, vec3f(0.0, 1.0, 0.0))
        + object.world_from_gradient_z * gradient_difference(within, vec3f(0.0, 0.0, 1.0));
}

fn gradient_difference(p: vec3f, unit: vec3f) -> f32 {
    return gradient_sample(p + unit) - gradient_sample(p - unit);
}

fn gradient_sample(p: vec3f) -> f32 {
    return sample_volume(gradient_volume, volume_sampler, p, object.texel_scale);
}
