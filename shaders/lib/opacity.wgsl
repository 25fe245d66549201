// Opacity of a segment from the opacity of the reference length: 1 − (1−α)^(Δ/d₀).
// WGSL has neither expm1 nor log1p; as published the form stalls at 0 for α below 6e-8.

fn opacity_correct(alpha: f32, exponent: f32) -> f32 {
    if alpha >= 1.0 - 5.9604645e-8 { return 1.0; }
    if alpha <= 0.0 { return 0.0; }
    return one_minus_exp(exponent * ln_one_minus(alpha));
}

// ln(1−α)
fn ln_one_minus(alpha: f32) -> f32 {
    let series = -alpha * (1.0 + alpha * (0.5 + alpha * (1.0 / 3.0 + alpha * (0.25 + alpha * 0.2))));
    return select(log(1.0 - alpha), series, alpha < 0.0625);
}

// 1−exp(x)
fn one_minus_exp(x: f32) -> f32 {
    let series = -x * (1.0 + x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0)));
    return select(1.0 - exp(x), series, abs(x) < 0.0625);
}
