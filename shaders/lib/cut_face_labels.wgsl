// Faces where what shows ends with a region, by two look-ups of labels at each place (docs/rendering.md §8).
#import lib/cut_face
#import lib/label

// Outward normal in the world, and weight, at the middle p of a piece with these values at its ends.
fn cut_face(p: vec3f, front: f32, back: f32, shows: u32, pose: Pose) -> vec4f {
    let labels = labels_at(p);
    let x = vec3f(0.5, 0.0, 0.0);
    let y = vec3f(0.0, 0.5, 0.0);
    let z = vec3f(0.0, 0.0, 0.5);
    let before_x = label_in(labels, p - x);
    let before_y = label_in(labels, p - y);
    let before_z = label_in(labels, p - z);
    let behind_x = label_in(labels, p + x);
    let behind_y = label_in(labels, p + y);
    let behind_z = label_in(labels, p + z);
    let before = vec3u(before_x.number, before_y.number, before_z.number);
    let behind = vec3u(behind_x.number, behind_y.number, behind_z.number);
    // How much the looks nearest to these places show.
    var own_before = vec3f(0.0);
    var own_behind = vec3f(0.0);
    let count = entry_of(labels.first).y;
    var i = 0u;
    loop {
        let opacity = shown_of(cut_look(entry_of(labels.first + i).x, pose), front, back, shows);
        own_before = select(own_before, vec3f(opacity), before == vec3u(i));
        own_behind = select(own_behind, vec3f(opacity), behind == vec3u(i));
        i += 1u;
        if i >= count { break; }
    }
    let a = own_before * vec3f(before_x.share, before_y.share, before_z.share);
    let b = own_behind * vec3f(behind_x.share, behind_y.share, behind_z.share);
    let change = b - a;
    let at_rest = regions.world_x * change.x + regions.world_y * change.y + regions.world_z * change.z;
    let world = turned(at_rest, pose);
    let densest = largest(max(own_before, own_behind));
    // Every border is a gap, but between looks that show alike it is no face.
    let differ = smoothstep(0.0, SHARP_END, (densest + largest(-min(own_before, own_behind))) / max(densest, 1e-30));
    let weight = differ * smoothstep(0.0, SHARP_END, length(change) / max(largest(max(a, b)), 1e-30));
    return vec4f(-world / max(length(world), 1e-30), weight);
}

fn largest(v: vec3f) -> f32 {
    return max(max(v.x, v.y), v.z);
}
