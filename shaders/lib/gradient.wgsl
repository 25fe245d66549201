// Gradient: central differences, one voxel apart, of the (prefiltered) gradient volume.
#import bind/object
#import {pose}

// What is kept of how the data change at a place: ĝ of the volume at rest.
alias Slope = vec3f;

// ĝ in a body.
fn change_of(slope: Slope, pose: Pose) -> vec3f {
    return turned(slope, pose);
}

// ĝ = ‖g‖/G as a vector in the world.
fn gradient_at(p: vec3f) -> vec3f {
    let x = vec3f(1.0, 0.0, 0.0);
    let y = vec3f(0.0, 1.0, 0.0);
    let z = vec3f(0.0, 0.0, 1.0);
    return object.world_from_gradient_x * (gradient_sample(p + x) - gradient_sample(p - x))
        + object.world_from_gradient_y * (gradient_sample(p + y) - gradient_sample(p - y))
        + object.world_from_gradient_z * (gradient_sample(p + z) - gradient_sample(p - z));
}

fn gradient_sample(p: vec3f) -> f32 {
    return sample_volume(gradient_volume, volume_sampler, p, object.texel_scale);
}
