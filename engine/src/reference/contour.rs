//! Contours and illustrative transparency (docs/rendering.md §4; thesis §3.3.3, §3.3.4).

use glam::DVec3;

use super::style::surface_strength;

/// Below this extent in |n·v| there is no contour.
const NO_CONTOUR: f64 = 1e-4;

/// Below this share of a ray's way along a surface, its turn is not divided by it any further.
const LEAST_ALONG: f64 = 0.5;

/// κ_v, in 1/mm: how fast the surface's normal turns along the ray, from the ĝ here and `lag_mm` before. Faces, of weight `face`, are
/// flat.
pub fn curvature(gradient: DVec3, before: DVec3, direction: DVec3, face: f64, lag_mm: f64) -> f64 {
    let strength = surface_strength(gradient.length()) * surface_strength(before.length());
    if strength <= 0.0 {
        return 0.0;
    }
    let (a, b) = (gradient.normalize(), before.normalize());
    let chord = a.distance(b).min(a.distance(-b));
    let along = a.cross(direction).length().max(LEAST_ALONG);
    (1.0 - face) * strength * 2.0 * (chord / 2.0).asin() / (lag_mm * along)
}

/// c: up to which |n·v| a surface of curvature κ_v is on a contour of `width_mm` (eq. 3.1); all of it, where it is more curved than
/// the contour is wide.
pub fn extent(width_mm: f64, curvature: f64) -> f64 {
    let x = (width_mm * curvature).clamp(0.0, 1.0);
    let c = (x * (2.0 - x)).sqrt();
    if c < NO_CONTOUR { 0.0 } else { c }
}

/// n_xy pushed out to the rim of the style where a surface whose |n·v| is `facing` is on a contour of extent `c`.
pub fn pushed(n_xy: [f64; 2], facing: f64, c: f64) -> [f64; 2] {
    let r = n_xy[0].hypot(n_xy[1]);
    if c == 0.0 || facing >= c || r == 0.0 {
        return n_xy;
    }
    let delta = 1.0 - (c - facing) / c;
    let pushed = (r / delta.max(1e-4)).min(1.0);
    n_xy.map(|n| n * pushed / r)
}

/// How much of a contour of `width_mm` a pixel of `pixel_mm` sees where |n·v| is `facing`: its silhouette is 1 − √(1 − (n·v)²) radii
/// of curvature away.
pub fn coverage(width_mm: f64, curvature: f64, facing: f64, pixel_mm: f64) -> f64 {
    if curvature <= 0.0 {
        return 0.0;
    }
    let to_silhouette_mm = facing * facing / (1.0 + (1.0 - facing * facing).max(0.0).sqrt()) / curvature;
    ((width_mm - to_silhouette_mm) / pixel_mm + 0.5).clamp(0.0, 1.0)
}

/// α_u as eq. 3.2 modulates it: where a surface faces the eye and the data hardly change it is less, on contours it is more.
pub fn modulated(alpha_u: f64, facing: f64, c: f64, steepness: f64) -> f64 {
    if alpha_u <= 0.0 {
        return 0.0;
    }
    alpha_u.powf(0.5 + (facing - c).max(0.0) * (1.0 - steepness.min(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curvature_of_a_sphere_is_one_over_its_radius() {
        // Along a ray that touches a sphere of 5 mm, the normals turn by atan(s / 5).
        let normal = |s: f64| DVec3::new(s, 5.0, 0.0);
        for lag in [1e-3, 0.1, 1.0] {
            let found = curvature(normal(0.0), normal(-lag), DVec3::X, 0.0, lag);
            assert!((found - (lag / 5.0).atan() / lag).abs() < 1e-12, "{lag} {found}");
        }
        // Where it goes into the sphere, it goes less far along it: 4 mm beside the center, 3 mm before its middle.
        let inside = |s: f64| DVec3::new(s - 3.0, 4.0, 0.0);
        let found = curvature(inside(0.0), inside(-1e-4), DVec3::X, 0.0, 1e-4);
        assert!((found - 0.2).abs() < 1e-4, "{found}");
        // Which side of the surface is bright does not matter; flat things, faces and noise have none.
        assert_eq!(curvature(DVec3::X, -DVec3::X, DVec3::Z, 0.0, 1.0), 0.0);
        assert_eq!(curvature(DVec3::X, DVec3::X, DVec3::Z, 0.0, 1.0), 0.0);
        assert_eq!(curvature(DVec3::X, DVec3::Y, DVec3::Z, 1.0, 1.0), 0.0);
        assert_eq!(curvature(DVec3::X, DVec3::ZERO, DVec3::Z, 0.0, 1.0), 0.0);
        assert_eq!(curvature(DVec3::X, 2e-4 * DVec3::Y, DVec3::Z, 0.0, 1.0), 0.0);
        assert!((curvature(DVec3::X, DVec3::Y, DVec3::Z, 0.0, 0.5) - std::f64::consts::PI).abs() < 1e-12);
    }

    #[test]
    fn a_contour_is_as_wide_on_any_sphere() {
        // At the inner edge of the contour, `width` from the silhouette of a sphere of this radius.
        for (radius, width) in [(3.0, 0.2), (50.0, 0.2), (1e4, 0.2), (0.5, 0.4)] {
            let across: f64 = radius - width;
            let facing = (1.0 - (across / radius).powi(2)).sqrt();
            assert!((extent(width, 1.0 / radius) - facing).abs() < 1e-9, "{radius}");
            assert!((coverage(width, 1.0 / radius, facing, 0.01) - 0.5).abs() < 1e-6, "{radius}");
            let r = across / radius;
            // On the edge nothing moves, on the silhouette all is rim.
            let n = [0.6 * r, -0.8 * r];
            let on_edge = pushed(n, facing, extent(width, 1.0 / radius));
            assert!((on_edge[0] - n[0]).abs() < 1e-6 && (on_edge[1] - n[1]).abs() < 1e-6);
            let outside = pushed([0.5994, -0.7992], 0.999f64.mul_add(-0.999, 1.0).sqrt() * 0.5 * facing, facing);
            assert!((outside[0].hypot(outside[1]) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn limits_are_exact() {
        for width in [0.0, 1e-6, 1.0, 1e6] {
            for curvature in [0.0, 1e-6, 1.0, 1e6, f64::MAX] {
                let c = extent(width, curvature);
                assert!((0.0..=1.0).contains(&c));
                for facing in [0.0, 1e-9, 0.5, 1.0] {
                    let w = coverage(width, curvature, facing, 0.1);
                    assert!((0.0..=1.0).contains(&w), "{width} {curvature} {facing}: {w}");
                    let r = (1.0f64 - facing * facing).sqrt();
                    let n = pushed([r, 0.0], facing, c);
                    assert!(n[0] >= r && n[0] <= 1.0 && n[1] == 0.0);
                    for steepness in [0.0, 0.3, 1.0, 7.0] {
                        assert_eq!(modulated(0.0, facing, c, steepness), 0.0);
                        assert_eq!(modulated(1.0, facing, c, steepness), 1.0);
                        let some = modulated(0.25, facing, c, steepness);
                        assert!((0.125..=0.5).contains(&some), "{some}");
                    }
                }
            }
        }
        assert_eq!((extent(0.0, f64::MAX), extent(1e6, 1e6), extent(3.0, 1.0)), (0.0, 1.0, 1.0));
        // On a contour, and where the data change most, as opaque as it gets; flat and facing, least.
        assert_eq!(modulated(0.25, 0.2, 0.5, 0.0), 0.5);
        assert_eq!(modulated(0.25, 1.0, 0.0, 1.0), 0.5);
        assert_eq!(modulated(0.25, 1.0, 0.0, 0.0), 0.125);
    }
}
