//! Signed distances (mm, negative inside) and noises that the specimens are modeled from.
//!
//! Every distance here is exact or a bound that is close to 1-Lipschitz near its surface: the painter culls
//! whole bricks by it and turns it into partial-volume coverage.

use glam::{Vec2, Vec3, vec3};

/// Quadratic smooth minimum: the union of two shapes with a fillet of about `k` mm.
#[inline]
pub fn smin(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * k * 0.25
}

/// Quadratic smooth maximum: the intersection of two shapes with an edge rounded by about `k` mm.
#[inline]
pub fn smax(a: f32, b: f32, k: f32) -> f32 {
    -smin(-a, -b, k)
}

/// Cubic Hermite step from 0 at `a` to 1 at `b`; `a > b` gives the falling step.
#[inline]
pub fn smoothstep(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Linear blend.
#[inline]
pub fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// A smooth bump of height 1 at 0 that is exactly 0 beyond ±`width`.
#[inline]
pub fn bump(x: f32, width: f32) -> f32 {
    let t = (1.0 - (x / width) * (x / width)).max(0.0);
    t * t
}

/// Ellipsoid about the origin with radii `r` (first-order distance).
#[inline]
pub fn ellipsoid(p: Vec3, r: Vec3) -> f32 {
    let a = p / r;
    let k0 = a.length();
    let k1 = (a / r).length().max(1e-6);
    k0 * (k0 - 1.0) / k1
}

/// Ellipse about the origin with radii `r` (first-order distance).
#[inline]
pub fn ellipse(p: Vec2, r: Vec2) -> f32 {
    let a = p / r;
    let k0 = a.length();
    let k1 = (a / r).length().max(1e-6);
    k0 * (k0 - 1.0) / k1
}

/// Capsule from `a` to `b` whose radius runs linearly from `ra` to `rb`.
#[inline]
pub fn cone(p: Vec3, a: Vec3, b: Vec3, ra: f32, rb: f32) -> f32 {
    let (pa, ba) = (p - a, b - a);
    let h = (pa.dot(ba) / ba.length_squared()).clamp(0.0, 1.0);
    (pa - ba * h).length() - mix(ra, rb, h)
}

/// A chain of cones through points with radii, blended over `k` mm.
pub fn chain(p: Vec3, points: &[(Vec3, f32)], k: f32) -> f32 {
    points.windows(2).fold(f32::MAX, |d, w| smin(d, cone(p, w[0].0, w[1].0, w[0].1, w[1].1), k))
}

/// A tube along a finely divided curve ([`spline`]): the plain union of its cones.
pub fn tube(p: Vec3, curve: &[(Vec3, f32)]) -> f32 {
    curve.windows(2).fold(f32::MAX, |d, w| d.min(cone(p, w[0].0, w[1].0, w[0].1, w[1].1)))
}

/// Box about the origin with half sizes `h`, its edges rounded by `r` (included in `h`).
#[inline]
pub fn rounded_box(p: Vec3, h: Vec3, r: f32) -> f32 {
    let q = p.abs() - h + Vec3::splat(r);
    q.max(Vec3::ZERO).length() + q.max_element().min(0.0) - r
}

/// Sine and cosine of an angle within ±1.6 rad (error below 1e-5). Like everything here it uses only the
/// operations that round alike on every machine, never the system's mathematics library.
#[inline]
pub fn sin_cos(angle: f32) -> (f32, f32) {
    let t = angle * angle;
    let s = angle * (1.0 + t * (-1.0 / 6.0 + t * (1.0 / 120.0 + t * (-1.0 / 5040.0 + t / 362_880.0))));
    let c = 1.0 + t * (-0.5 + t * (1.0 / 24.0 + t * (-1.0 / 720.0 + t * (1.0 / 40_320.0 - t / 3_628_800.0))));
    (s, c)
}

/// Arc cosine of a number in ±1 (error below 1e-4; Abramowitz and Stegun 4.4.45).
#[inline]
pub fn acos(x: f32) -> f32 {
    let a = x.abs().min(1.0);
    let r = (1.0 - a).sqrt() * (1.570_728_8 + a * (-0.212_114_4 + a * (0.074_261 - a * 0.018_729_3)));
    if x < 0.0 { std::f32::consts::PI - r } else { r }
}

/// `p` turned by `angle` radians about the x axis (y toward z).
#[inline]
pub fn turn_x(p: Vec3, angle: f32) -> Vec3 {
    let (s, c) = sin_cos(angle);
    vec3(p.x, c * p.y - s * p.z, s * p.y + c * p.z)
}

/// `p` turned by `angle` radians about the z axis (x toward y).
#[inline]
pub fn turn_z(p: Vec3, angle: f32) -> Vec3 {
    let (s, c) = sin_cos(angle);
    vec3(c * p.x - s * p.y, s * p.x + c * p.y, p.z)
}

/// Integer hash of a lattice point: 32 well-mixed bits.
#[inline]
pub fn hash(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ (z as u32).wrapping_mul(0xcb1a_b31f)
        ^ seed.wrapping_mul(0x9e37_79b9);
    h ^= h >> 16;
    h = h.wrapping_mul(0x7feb_352d);
    h ^= h >> 15;
    h = h.wrapping_mul(0x846c_a68b);
    h ^ (h >> 16)
}

/// A hash as a number in [0, 1).
#[inline]
pub fn unit(h: u32) -> f32 {
    (h >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Smooth value noise in [-1, 1] with features of about one unit.
pub fn noise(p: Vec3, seed: u32) -> f32 {
    let base = p.floor();
    let f = p - base;
    let w = f * f * (Vec3::splat(3.0) - 2.0 * f);
    let (x, y, z) = (base.x as i32, base.y as i32, base.z as i32);
    let at = |dx: i32, dy: i32, dz: i32| unit(hash(x + dx, y + dy, z + dz, seed)) * 2.0 - 1.0;
    let row = |dy: i32, dz: i32| mix(at(0, dy, dz), at(1, dy, dz), w.x);
    mix(mix(row(0, 0), row(1, 0), w.y), mix(row(0, 1), row(1, 1), w.y), w.z)
}

/// About a standard normal variate per lattice point (sum of four uniforms), clipped at ±3.46 σ.
#[inline]
pub fn normal(x: usize, y: usize, z: usize, seed: u32) -> f32 {
    let h = hash(x as i32, y as i32, z as i32, seed);
    let sum = (h & 0xff) + (h >> 8 & 0xff) + (h >> 16 & 0xff) + (h >> 24);
    // Four bytes have mean 510 and standard deviation 2 · 73.9 = 147.8.
    (sum as f32 - 510.0) * (1.0 / 147.8)
}

/// Points with radii along a line.
pub type Line = Vec<(Vec3, f32)>;

/// A smooth curve through points with radii: `parts` pieces between any two (Catmull-Rom).
pub fn spline(points: &[(Vec3, f32)], parts: usize) -> Line {
    let mut curve = Vec::with_capacity(points.len() * parts);
    for i in 0..points.len().saturating_sub(1) {
        let at = |k: isize| points[(i as isize + k).clamp(0, points.len() as isize - 1) as usize];
        let ((p0, _), (p1, r1), (p2, r2), (p3, _)) = (at(-1), at(0), at(1), at(2));
        for j in 0..parts {
            let t = j as f32 / parts as f32;
            let p = 0.5
                * (2.0 * p1
                    + (p2 - p0) * t
                    + (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3) * (t * t)
                    + (3.0 * p1 - p0 - 3.0 * p2 + p3) * (t * t * t));
            curve.push((p, mix(r1, r2, t)));
        }
    }
    curve.extend(points.last());
    curve
}

/// A round course along a curve, with its bounding box.
pub struct Course {
    curve: Line,
    lo: Vec3,
    hi: Vec3,
}

impl Course {
    /// Smoothly through points with radii, `parts` pieces between any two.
    pub fn new(points: &[(Vec3, f32)], parts: usize) -> Self {
        let curve = spline(points, parts);
        let box_of = |(lo, hi): (Vec3, Vec3), &(p, r): &(Vec3, f32)| (lo.min(p - r), hi.max(p + r));
        let (lo, hi) = curve.iter().fold((Vec3::MAX, Vec3::MIN), box_of);
        Self { curve, lo, hi }
    }

    /// Distance from its box: a lower bound of [`Course::distance`].
    pub fn bound(&self, p: Vec3) -> f32 {
        (self.lo - p).max(p - self.hi).max(Vec3::ZERO).length()
    }

    /// Distance from its surface; far away, from its box.
    pub fn distance(&self, p: Vec3) -> f32 {
        let bound = self.bound(p);
        if bound > 6.0 { bound } else { tube(p, &self.curve) }
    }
}

/// Cells of about one unit (Worley): the distances from the nearest and from the second nearest of points thrown one
/// into each lattice cell.
pub fn cells(p: Vec3, seed: u32) -> (f32, f32) {
    let base = p.floor();
    let (x, y, z) = (base.x as i32, base.y as i32, base.z as i32);
    let (mut first, mut second) = (f32::MAX, f32::MAX);
    for dz in -1..=1 {
        for dy in -1..=1 {
            for dx in -1..=1 {
                let h = hash(x + dx, y + dy, z + dz, seed);
                let jitter = vec3((h & 0x3ff) as f32, (h >> 10 & 0x3ff) as f32, (h >> 20 & 0x3ff) as f32) / 1023.0;
                let at = base + vec3(dx as f32, dy as f32, dz as f32) + 0.15 + 0.7 * jitter;
                let d = (p - at).length_squared();
                if d < first {
                    (first, second) = (d, first);
                } else {
                    second = second.min(d);
                }
            }
        }
    }
    (first.sqrt(), second.sqrt())
}
