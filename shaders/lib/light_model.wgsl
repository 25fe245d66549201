// What light does to a surface, by the model of Blinn and Phong (docs/rendering.md §4).
#import bind/lighting

// n·l up to which highlights fade in.
const HIGHLIGHT_FADE: f32 = 0.01;

// Ambient, diffuse and specular.
fn light_terms(n_l: f32, n_h: f32) -> vec3f {
    let highlight = pow(clamp(n_h, 1e-30, 1.0), lighting.model.w) * clamp(n_l / HIGHLIGHT_FADE, 0.0, 1.0);
    return lighting.model.xyz * vec3f(1.0, max(n_l, 0.0), highlight);
}
