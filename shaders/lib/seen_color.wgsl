// The color of what is seen at a place (docs/rendering.md §4).
#import bind/colors
#import bind/object
#import lib/opacity
#import lib/transfer_function

// What a voxel that shows nothing counts for against one that shows everything.
const UNSEEN: f32 = 1e-3;

// Premultiplied: alpha as it is interpolated, and the colors of the eight voxels around p by how much each shows, so that the dark
// around a body does not darken its surface. Spelled out: a software adapter counts the rounds of all loops.
fn seen_color(p: vec3f, function: Function) -> vec4f {
    let last = vec3i(textureDimensions(colors)) - 1;
    let q = clamp(p, vec3f(0.0), vec3f(last));
    let a = vec3i(floor(q));
    let b = min(a + 1, last);
    let w = q - vec3f(a);
    let v = 1.0 - w;
    let sum = v.z * (v.y * (v.x * shown(a.x, a.y, a.z, function) + w.x * shown(b.x, a.y, a.z, function))
            + w.y * (v.x * shown(a.x, b.y, a.z, function) + w.x * shown(b.x, b.y, a.z, function)))
        + w.z * (v.y * (v.x * shown(a.x, a.y, b.z, function) + w.x * shown(b.x, a.y, b.z, function))
            + w.y * (v.x * shown(a.x, b.y, b.z, function) + w.x * shown(b.x, b.y, b.z, function)));
#if alpha
    let alpha = sample_color(colors, p).a;
#else
    let alpha = 1.0;
#end
    return vec4f(sum.rgb * (alpha / max(sum.a, 1e-30)), alpha);
}

// A voxel's color, by how much of it shows.
fn shown(x: i32, y: i32, z: i32, function: Function) -> vec4f {
    let value = textureLoad(volume, vec3i(x, y, z), 0).x;
    return (UNSEEN + one_minus_exp(-classify_piece(function, value, value).extinction)) * textureLoad(colors, vec3i(x, y, z), 0);
}
