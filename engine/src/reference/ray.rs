//! Rays and their samples (docs/rendering.md §3): from a pixel to the distances at which the volume is looked at.

use glam::{DMat3, DVec3};

use crate::scene::{Camera, Projection};
use crate::spaces::Grid;

/// A ray in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where t = 0 is, in mm.
    pub origin_mm: DVec3,
    /// Unit direction, away from the viewer.
    pub direction: DVec3,
    /// Where the ray begins, in mm along it: 0, or −∞ in a parallel projection.
    pub t_min: f64,
}

/// The ray through the center of pixel (column x, row y from the top left) of a picture of `image_size` (width,
/// height) pixels.
pub fn ray_from_pixel(camera: &Camera, image_size: [u32; 2], x: u32, y: u32) -> Ray {
    let [width, height] = image_size.map(f64::from);
    let s_x = (2.0 * (f64::from(x) + 0.5) - width) / height;
    let s_y = (height - 2.0 * (f64::from(y) + 0.5)) / height;
    let across = s_x * camera.right + s_y * camera.up;
    match camera.projection {
        Projection::Perspective { fov_y_deg } => {
            let h = (fov_y_deg.to_radians() / 2.0).tan();
            Ray { origin_mm: camera.eye_mm, direction: (camera.forward + h * across).normalize(), t_min: 0.0 }
        }
        Projection::Orthographic { height_mm } => Ray {
            origin_mm: camera.eye_mm + height_mm / 2.0 * across,
            direction: camera.forward,
            t_min: f64::NEG_INFINITY,
        },
    }
}

/// The part t₀ < t₁ (units of `direction`, t ≥ `t_min`) of the line `origin` + t `direction` that lies in the box from
/// `low` to `high`, its faces included; all in one space. `None` if it misses the box or only touches it.
pub fn intersect_box(origin: DVec3, direction: DVec3, t_min: f64, low: DVec3, high: DVec3) -> Option<(f64, f64)> {
    let (mut t0, mut t1) = (t_min, f64::INFINITY);
    for axis in 0..3 {
        let (o, d) = (origin[axis], direction[axis]);
        if d == 0.0 {
            // Parallel to these two faces: between them all the way, or never.
            if o < low[axis] || o > high[axis] {
                return None;
            }
            continue;
        }
        let (a, b) = ((low[axis] - o) / d, (high[axis] - o) / d);
        t0 = t0.max(a.min(b));
        t1 = t1.min(a.max(b));
    }
    (t0 < t1 && t0.is_finite() && t1.is_finite()).then_some((t0, t1))
}

/// The samples of a ray: the middles of the pieces that the span t₀ … t₁ is cut into, each Δ long but the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Samples {
    /// Where the ray enters the volume's box (or begins in it), in mm along the ray.
    pub t0: f64,
    /// Where it leaves the box.
    pub t1: f64,
    /// Δ: length of a whole piece in mm.
    pub delta_mm: f64,
    /// How many pieces there are.
    pub count: u64,
}

impl Samples {
    /// Both ends of piece `k` in mm along the ray.
    pub fn piece(&self, k: u64) -> (f64, f64) {
        let start = self.t0 + k as f64 * self.delta_mm;
        (start, (self.t0 + (k + 1) as f64 * self.delta_mm).min(self.t1))
    }
}

/// The samples of `ray` in the box of `grid`, `step_voxels` > 0 voxels apart along the ray. None where it misses.
pub fn samples(ray: &Ray, grid: &Grid, step_voxels: f64) -> Option<Samples> {
    let index_from_world: DMat3 = grid.index_from_world().matrix3;
    let origin = grid.index_from_world().transform_point3(ray.origin_mm);
    let direction = index_from_world * ray.direction;
    let (low, high) = grid.index_box();
    let (t0, t1) = intersect_box(origin, direction, ray.t_min, low, high)?;
    let delta_mm = step_voxels / direction.length();
    let count = ((t1 - t0) / delta_mm).ceil() as u64;
    Some(Samples { t0, t1, delta_mm, count })
}

#[cfg(test)]
mod tests {
    use super::super::testing::awkward_affines;
    use super::*;

    fn camera(projection: Projection) -> Camera {
        Camera::looking(DVec3::new(1.0, -20.0, 3.0), DVec3::new(0.1, 1.0, -0.2), DVec3::Z, projection).unwrap()
    }

    #[test]
    fn ray_from_pixel_spans_the_field_of_view() {
        let c = camera(Projection::Perspective { fov_y_deg: 40.0 });
        // The rays through the top and the bottom edge enclose the field of view: with 10⁶ rows, but for a pixel.
        let (top, bottom) = (ray_from_pixel(&c, [1, 1_000_000], 0, 0), ray_from_pixel(&c, [1, 1_000_000], 0, 999_999));
        assert!((top.direction.angle_between(bottom.direction).to_degrees() - 40.0).abs() < 1e-4);
        assert!(top.direction.dot(c.up) > 0.3 && bottom.direction.dot(c.up) < -0.3);
        // The middle of an odd picture is the view axis; the eye is the origin.
        let middle = ray_from_pixel(&c, [5, 3], 2, 1);
        assert!((middle.direction - c.forward).length() < 1e-15);
        assert_eq!((middle.origin_mm, middle.t_min), (c.eye_mm, 0.0));
        // Square pixels: a step to the right is as long as one down, seen on the plane at distance 1.
        let plane = |x, y| {
            let d = ray_from_pixel(&c, [80, 30], x, y).direction;
            let d = d / d.dot(c.forward);
            [d.dot(c.right), d.dot(c.up)]
        };
        let (a, b, d) = (plane(10, 7), plane(11, 7), plane(10, 8));
        let pixel = 2.0 * 20f64.to_radians().tan() / 30.0;
        assert!((b[0] - a[0] - pixel).abs() < 1e-14 && (a[1] - d[1] - pixel).abs() < 1e-14);
    }

    #[test]
    fn ray_from_pixel_is_parallel_without_perspective() {
        let c = camera(Projection::Orthographic { height_mm: 6.0 });
        let (a, b) = (ray_from_pixel(&c, [4, 3], 0, 0), ray_from_pixel(&c, [4, 3], 3, 2));
        assert_eq!((a.direction, a.t_min), (c.forward, f64::NEG_INFINITY));
        // 2 mm pixels: three to the right, two down.
        assert!((b.origin_mm - a.origin_mm - 6.0 * c.right + 4.0 * c.up).length() < 1e-13);
        assert!((a.origin_mm - c.eye_mm - (-3.0 * c.right + 2.0 * c.up)).length() < 1e-13);
    }

    #[test]
    fn intersect_box_from_everywhere() {
        let (low, high) = (DVec3::splat(-0.5), DVec3::new(3.5, 4.5, 5.5));
        let hit = |o: [f64; 3], d: [f64; 3], t_min| intersect_box(o.into(), d.into(), t_min, low, high);
        assert_eq!(hit([-2.5, 1.0, 1.0], [1.0, 0.0, 0.0], 0.0), Some((2.0, 6.0)));
        assert_eq!(hit([5.5, 1.0, 1.0], [-2.0, -0.0, 0.0], 0.0), Some((1.0, 3.0)));
        // From inside, with and without a beginning; from behind.
        assert_eq!(hit([1.5, 1.0, 1.0], [1.0, 0.0, 0.0], 0.0), Some((0.0, 2.0)));
        assert_eq!(hit([1.5, 1.0, 1.0], [1.0, 0.0, 0.0], f64::NEG_INFINITY), Some((-2.0, 2.0)));
        assert_eq!(hit([9.0, 1.0, 1.0], [1.0, 0.0, 0.0], 0.0), None);
        // Parallel to a face: on it, just outside, just inside.
        assert_eq!(hit([-1.5, -0.5, 1.0], [1.0, 0.0, 0.0], 0.0), Some((1.0, 5.0)));
        assert_eq!(hit([-1.5, -0.5 - 1e-12, 1.0], [1.0, 0.0, 0.0], 0.0), None);
        assert_eq!(hit([-1.5, 4.5 - 1e-12, 1.0], [1.0, 0.0, 0.0], 0.0), Some((1.0, 5.0)));
        // Across an edge, and past it.
        assert_eq!(hit([-1.5, 0.5, 1.0], [1.0, -1.0, 0.0], 0.0), None);
        assert!(hit([-1.5, 1.5, 1.0], [1.0, -1.0, 0.0], 0.0).is_some());
    }

    #[test]
    fn samples_are_even_in_voxels() {
        for affine in awkward_affines() {
            let grid = Grid::new([9, 10, 11], affine).unwrap();
            let center = affine.transform_point3(DVec3::new(4.0, 4.5, 5.0));
            for direction in [DVec3::X, DVec3::new(1.0, -2.0, 0.5).normalize(), DVec3::NEG_Z] {
                let ray = Ray { origin_mm: center - 1000.0 * direction, direction, t_min: 0.0 };
                for step in [0.25, 0.7, 1.0, 3.0] {
                    let s = samples(&ray, &grid, step).unwrap();
                    let index = |t: f64| affine.inverse().transform_point3(ray.origin_mm + t * direction);
                    let (start, end) = s.piece(0);
                    assert!(
                        (index(start).distance(index(end)) - step.min(index(s.t0).distance(index(s.t1)))).abs() < 1e-9
                    );
                    // The pieces cover the span from face to face, without gap or overlap.
                    let (low, high) = grid.index_box();
                    let depth = |t: f64| (index(t) - low).min(high - index(t)).min_element();
                    assert!(depth(s.piece(0).0).abs() < 1e-9 && depth(s.piece(s.count - 1).1).abs() < 1e-9);
                    assert!((1..s.count).all(|k| s.piece(k).0 == s.piece(k - 1).1));
                }
            }
        }
    }

    #[test]
    fn samples_of_a_thin_span_are_one_piece_of_its_length() {
        let grid = Grid::new([1, 1, 1], glam::DAffine3::IDENTITY).unwrap();
        let ray = Ray { origin_mm: DVec3::new(-5.0, 0.0, 0.0), direction: DVec3::X, t_min: 0.0 };
        for step in [1.0, 1.9, 2.0, 64.0] {
            let s = samples(&ray, &grid, step).unwrap();
            assert_eq!((s.count, s.piece(0)), (1, (4.5, 5.5)));
        }
        let s = samples(&ray, &grid, 0.75).unwrap();
        assert_eq!((s.count, s.piece(1)), (2, (5.25, 5.5)));
    }
}
