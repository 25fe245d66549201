// How bodies lie in the world, and which looks they show (docs/rendering.md §9).
#import bind/bodies

// A normal or gradient of the volume at rest, with its length, in a body.
fn turned(direction: vec3f, body: u32) -> vec3f {
    let b = bodies.list[body];
    let there = b.normal_x * direction.x + b.normal_y * direction.y + b.normal_z * direction.z;
    return there * (length(direction) / max(length(there), 1e-30));
}

// The object's smallest spacing, over that of a body.
fn voxels_of(body: u32) -> f32 {
    return bodies.list[body].voxels;
}

// Position of a look as a body shows it.
fn look_in(look: u32, body: u32) -> u32 {
    return bodies.list[body].first_look + look;
}

// Position of a look whose ends make faces in a body: a ghost that is a body of its own has those of all that rests.
fn cut_look(look: u32, body: u32) -> u32 {
    return bodies.list[body].first_cut_look + look;
}
