// How a part lies in the world, and the walls through which a ray comes in and goes out (docs/rendering.md §10).

#import lib/turned
#import lib/wall
#import lib/whole_looks
#if patterns
#import bind/patterns
#end

struct Pose {
    // Takes a normal of the volume at rest to the part's, but for its length.
    normal: mat3x3f,
    // The object's smallest spacing, over the part's.
    voxels: f32,
    enter: Wall,
    leave: Wall,
#if patterns
    // Takes a direction in the world (mm) to index space.
    to_index: mat3x3f,
#end
}

// `to_index`: takes a direction in the world (mm) to index space.
fn part_pose(normal: mat3x3f, voxels: f32, enter: Wall, leave: Wall, to_index: mat3x3f) -> Pose {
#if patterns
    return Pose(normal, voxels, enter, leave, to_index);
#else
    return Pose(normal, voxels, enter, leave);
#end
}

fn voxels_of(pose: Pose) -> f32 {
    return pose.voxels;
}
