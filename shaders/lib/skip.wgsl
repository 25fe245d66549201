// Empty-space skipping: the skip map holds, per brick of 8³ voxels, the Chebyshev distance in bricks to the
// nearest one that shows something.

fn brick_of(p: vec3f) -> vec3i {
    return vec3i(floor((p + 0.5) * 0.125));
}

// The sample to go on with after sample k in a brick whose nearest visible brick is `distance` (≥ 1) away:
// the first one that might lie outside the block of bricks around it that is known to be empty.
fn leap(brick: vec3i, distance: u32, first: vec3f, stride: vec3f, k: u32) -> u32 {
    let reach = i32(distance) - 1;
    let low = vec3f((brick - reach) * 8) - 0.5;
    let high = vec3f((brick + reach + 1) * 8) - 0.5;
    let wall = select(low, high, stride > vec3f(0.0));
    let still = abs(stride) < vec3f(1e-30);
    let steps = select((wall - first) / select(stride, vec3f(1.0), still), vec3f(3e38), still);
    // The piece whose middle lies beyond the wall; a shorter last piece has its middle earlier, so it is never leapt
    // over, and rounding may make a leap too short but not too long.
    let next = min(min(steps.x, steps.y), steps.z) - 0.5 - 1e-3;
    return max(k + 1u, u32(clamp(ceil(next), 0.0, 16777216.0)));
}
