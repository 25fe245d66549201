// How bodies lie in the world, and which looks they show (docs/rendering.md §9).
#import bind/bodies
#import lib/ray
#import lib/turned
#if patterns
#import bind/patterns
#end
#if parts
#import lib/part
#import lib/wall
#end

// What a body has of its own where it is looked at: read once, as a software adapter reads uniforms number by number where their
// place differs from pixel to pixel.
struct Pose {
    // Takes a normal of the volume at rest to the body's, but for its length.
    normal: mat3x3f,
    voxels: f32,
    first_look: u32,
    first_cut_look: u32,
    is_rest: bool,
#if parts
    enter: Wall,
    leave: Wall,
#end
#if patterns
    // Takes a direction in the world (mm) to index space.
    to_index: mat3x3f,
#end
}

fn pose_of(body: u32, ray: Ray) -> Pose {
    var pose: Pose;
    pose.normal = mat3x3f(bodies.list[body].normal_x, bodies.list[body].normal_y, bodies.list[body].normal_z);
    pose.voxels = bodies.list[body].voxels;
    pose.first_look = bodies.list[body].first_look;
    pose.first_cut_look = bodies.list[body].first_cut_look;
    pose.is_rest = bodies.list[body].role == 0u || bodies.list[body].role == 3u;
#if parts
    let walls = between_walls(bodies.list[body].first_wall, bodies.list[body].num_walls, ray);
    pose.enter = walls.enter;
    pose.leave = walls.leave;
#end
#if patterns
    pose.to_index = mat3x3f(bodies.list[body].index_from_world_x, bodies.list[body].index_from_world_y,
        bodies.list[body].index_from_world_z);
#end
    return pose;
}

// The object's smallest spacing, over that of a body.
fn voxels_of(pose: Pose) -> f32 {
    return pose.voxels;
}

// Position of a look as a body shows it.
fn look_in(look: u32, pose: Pose) -> u32 {
    return pose.first_look + look;
}

// Looks besides the regions' that a place may have: the background's, in what rests alone.
fn num_rest(pose: Pose) -> u32 {
    return u32(pose.is_rest);
}

fn num_cut_rest(pose: Pose) -> u32 {
    return u32(pose.is_rest || pose.first_cut_look != pose.first_look);
}

// Position of a look whose ends make faces in a body: a ghost that is a body of its own has those of all that rests.
fn cut_look(look: u32, pose: Pose) -> u32 {
    return pose.first_cut_look + look;
}
