// Directions of the volume at rest in a body or part that lies elsewhere: `Pose` has what takes them there.

// A normal or gradient of the volume at rest, with its length, as it lies.
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
