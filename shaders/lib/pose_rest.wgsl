// Nothing was moved: there is one body, where the volume lies.

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

fn look_in(look: u32, pose: Pose) -> u32 {
    return look;
}

// Looks besides the regions' that a place may have: the background's.
fn num_rest(pose: Pose) -> u32 {
    return 1u;
}

fn num_cut_rest(pose: Pose) -> u32 {
    return 1u;
}

fn cut_look(look: u32, pose: Pose) -> u32 {
    return look;
}
