// Nothing was moved: there is one body, where the volume lies.
#import lib/whole_looks

struct Pose {
    body: u32,
}

fn turned(direction: vec3f, pose: Pose) -> vec3f {
    return direction;
}

#if patterns
// A direction in the world, in the volume at rest.
fn at_rest(direction: vec3f, pose: Pose) -> vec3f {
    return direction;
}

#end
fn voxels_of(pose: Pose) -> f32 {
    return 1.0;
}
