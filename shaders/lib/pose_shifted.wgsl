// Parts that were moved without a turn: only the walls through which a ray comes in and goes out are a part's own (docs/rendering.md §10).

#import lib/wall
#import lib/whole_looks

struct Pose {
    enter: Wall,
    leave: Wall,
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
