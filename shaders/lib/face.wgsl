// Faces of what is drawn, where it is cut off: they are surfaces too (docs/rendering.md §4 and §10).
#import bind/object
#import {pose}

// Outward normal, in the world, of the faces near p, and how much they count: 1 on a face, 0 a voxel inside of all.
fn face_normal(p: vec3f, pose: Pose) -> vec4f {
#if faces
    var face = box_face(p, pose);
#else
    // Nothing that shows reaches a face of the volume.
    var face = vec4f(0.0);
#end
#if parts
    let enter = wall_face(p, pose.enter);
    // Of a sliver the face is seen that is in front.
    let leave = wall_face(p, pose.leave) * vec4f(1.0, 1.0, 1.0, 1.0 - enter.w);
    face = joined_faces(joined_faces(face, enter), leave);
#end
    return face;
}

#if faces
// The same of the volume's box. On an edge the faces' normals are mixed, so that nothing jumps there.
fn box_face(p: vec3f, pose: Pose) -> vec4f {
    let to_low = p + 0.5;
    let to_high = object.box_max - p;
    let weight = 1.0 - smoothstep(vec3f(0.5), vec3f(1.0), min(to_low, to_high));
    let outward = select(weight, -weight, to_low < to_high);
    let at_rest = object.face_x * outward.x + object.face_y * outward.y + object.face_z * outward.z;
    let world = turned(at_rest, pose);
    return vec4f(world / max(length(world), 1e-30), max(weight.x, max(weight.y, weight.z)));
}

#end
#if parts
// The same of a wall that cuts a part off.
fn wall_face(p: vec3f, wall: Wall) -> vec4f {
    return vec4f(wall.outward, 1.0 - smoothstep(0.5, 1.0, dot(wall.plane.xyz, p) + wall.plane.w));
}

#end
// Two faces at one place (xyz: normal, w: weight): their normals by their weights, so that nothing jumps where one begins.
fn joined_faces(a: vec4f, b: vec4f) -> vec4f {
    let normal = a.w * a.xyz + b.w * b.xyz;
    return vec4f(normal / max(length(normal), 1e-30), max(a.w, b.w));
}
