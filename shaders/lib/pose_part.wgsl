// How a part lies in the world, and the walls through which a ray comes in and goes out (docs/rendering.md §10).

#import lib/wall
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

// A normal or gradient of the volume at rest, with its length, in a part.
fn turned(direction: vec3f, pose: Pose) -> vec3f {
    let there = pose.normal * direction;
    return there * (length(direction) / max(length(there), 1e-30));
}

#if patterns
// A direction in the world, in the volume at rest.
fn at_rest(direction: vec3f, pose: Pose) -> vec3f {
    let index = pose.to_index * direction;
    return patterns.rest_from_index_x * index.x + patterns.rest_from_index_y * index.y + patterns.rest_from_index_z * index.z;
}

#end
fn voxels_of(pose: Pose) -> f32 {
    return pose.voxels;
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
