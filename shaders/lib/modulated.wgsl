// Illustrative transparency (thesis eq. 3.2).

// α_u where |n·v| is `facing` and a contour reaches up to `c`: less of it where the surface faces the eye and the data hardly
// change, more on contours. 0 and 1 stay.
fn modulated(alpha_u: f32, facing: f32, c: f32, steepness: f32) -> f32 {
    let exponent = 0.5 + max(facing - c, 0.0) * (1.0 - min(steepness, 1.0));
    return select(pow(alpha_u, exponent), 0.0, alpha_u <= 0.0);
}
