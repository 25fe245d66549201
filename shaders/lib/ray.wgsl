// Rays: from the picture's pixel into index space, and where the samples lie on them.
#import bind/frame
#import bind/object

struct Ray {
    // Index-space point on the near plane, and index-space direction per mm.
    origin: vec3f,
    direction: vec3f,
    // Unit direction in the world.
    world_direction: vec3f,
    // Eye depth gained per mm along the ray: the cosine to the view axis.
    depth_per_mm: f32,
    // Screen coordinates.
    screen: vec2f,
}

// Screen coordinates are in half picture heights from the center, y up, so that the field of view is vertical.
// Origins come from a near plane that f64 code on the CPU put at the front of the object: an eye 1e6 object sizes
// away costs no precision here.
fn ray_from_pixel(pixel: vec2u) -> Ray {
    let size = vec2f(frame.image_size);
    let center = vec2f(pixel) + 0.5;
    let screen = vec2f(2.0 * center.x - size.x, size.y - 2.0 * center.y) / size.y;
    let along = frame.forward + screen.x * frame.forward_dx + screen.y * frame.forward_dy;
    let per_mm = 1.0 / length(along);
    let world = along * per_mm;
    let index = object.index_from_world_x * world.x + object.index_from_world_y * world.y
        + object.index_from_world_z * world.z;
    let origin = frame.near_origin + screen.x * frame.near_dx + screen.y * frame.near_dy;
    return Ray(origin, index, world, per_mm, screen);
}

// Distances in mm at which the ray enters and leaves a box, from the near plane on; leave ≤ enter: missed.
fn intersect_box(origin: vec3f, direction: vec3f, low: vec3f, high: vec3f) -> vec2f {
    // A ray parallel to a face is inside its pair of faces everywhere or nowhere: no division by 0, no NaN.
    let parallel = abs(direction) < vec3f(1e-30);
    let inside = (origin >= low) & (origin <= high);
    let inverse = 1.0 / select(direction, vec3f(1.0), parallel);
    let a = (low - origin) * inverse;
    let b = (high - origin) * inverse;
    let far = vec3f(3e38);
    let never = select(far, -far, inside);
    let enter = select(min(a, b), never, parallel);
    let leave = select(max(a, b), -never, parallel);
    return vec2f(max(max(enter.x, enter.y), max(enter.z, 0.0)), min(min(leave.x, leave.y), leave.z));
}

// A span, measured in steps, is cut into pieces one step long, the last of them shorter, so that it is covered exactly.
fn num_pieces(steps: f32) -> u32 {
    return u32(clamp(ceil(steps), 0.0, 16777216.0));
}

// Middle of piece k, in steps. From the index, never accumulated: the same with and without skipping.
fn piece_middle(k: u32, steps: f32) -> f32 {
    return 0.5 * (f32(k) + min(f32(k + 1u), steps));
}

// End of the k-th piece counted from 1, in steps: 0 is the beginning of the span.
fn piece_end(k: u32, steps: f32) -> f32 {
    return min(f32(k), steps);
}

// Length of piece k, in steps.
fn piece_length(k: u32, steps: f32) -> f32 {
    return min(f32(k + 1u), steps) - f32(k);
}
