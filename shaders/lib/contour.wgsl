// Contours: lines where a surface turns away from the eye, as wide on all of them (docs/rendering.md §4; thesis §3.3.3).
#import lib/style

// Below this extent in |n·v| there is no contour.
const NO_CONTOUR: f32 = 1e-4;

// Below this share of a ray's way along a surface, its turn is not divided by it any further.
const LEAST_ALONG: f32 = 0.5;

// κ_v, 1/mm: how fast the normal turns along the ray, from the ĝ here and `lag_mm` before. Faces are flat.
fn curvature(g: vec3f, before: vec3f, ray: vec3f, face_weight: f32, lag_mm: f32) -> f32 {
    let a = g / max(length(g), 1e-30);
    let b = before / max(length(before), 1e-30);
    let strength = surface_strength(length(g)) * surface_strength(length(before));
    let half_chord = 0.5 * min(length(a - b), length(a + b));
    return (1.0 - face_weight) * strength * 2.0 * arcsine(half_chord) / (lag_mm * max(length(cross(a, ray)), LEAST_ALONG));
}

// For 0 to √½, to 1e-6 of it: software adapters' own is off by 1e-4.
fn arcsine(x: f32) -> f32 {
    let y = x * x;
    return x * (0.99999932 + y * (0.16676094 + y * (0.07292635 + y * (0.06088737 + y * (0.09635391 * y - 0.02421635)))));
}

// c: up to which |n·v| a surface is on a contour (eq. 3.1).
fn contour_extent(width_mm: f32, curvature: f32) -> f32 {
    let x = clamp(width_mm * curvature, 0.0, 1.0);
    let c = sqrt(x * (2.0 - x));
    return select(c, 0.0, c < NO_CONTOUR);
}

// n_xy, moved out to the rim of the style where |n·v| is `facing` on a contour of extent `c`.
fn pushed_out(n_xy: vec2f, facing: f32, c: f32) -> vec2f {
    let r = length(n_xy);
    let delta = max(min(1.0, facing / max(c, NO_CONTOUR)), 1e-4);
    return n_xy * select(min(1.0, r / delta) / max(r, 1e-30), 1.0, facing >= c || r == 0.0);
}

// How much of the contour a pixel sees: the silhouette is 1 − √(1 − (n·v)²) radii of curvature away.
fn contour_coverage(width_mm: f32, curvature: f32, facing: f32, pixel_mm: f32) -> f32 {
    let squared = facing * facing;
    let to_silhouette = squared / (1.0 + sqrt(max(1.0 - squared, 0.0)));
    // Divided by κ_v and by the pixel: not at once, as both may be tiny.
    let covered = (width_mm - to_silhouette / max(curvature, 1e-20)) / pixel_mm + 0.5;
    return select(clamp(covered, 0.0, 1.0), 0.0, curvature <= 0.0);
}
