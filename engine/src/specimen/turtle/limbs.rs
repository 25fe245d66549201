//! Head, neck, limbs and tail: their skin, and the bones that it follows.

use glam::{Vec3, vec2, vec3};

use super::shell;
use crate::specimen::sdf::*;

/// One of the four limbs, in mid-stride.
pub struct Limb {
    /// Shoulder or hip, elbow or knee, wrist or ankle.
    pub joints: [Vec3; 3],
    /// Its five digits: from the root to the tip, where the claw begins, and its point.
    digits: [[Vec3; 5]; 5],
    /// Radii of the skin at the joints.
    radii: [f32; 3],
    pub is_fore: bool,
    /// Center and radius of a ball around it.
    ball: (Vec3, f32),
}

/// Where the soles stand.
const GROUND_Z: f32 = -43.0;

impl Limb {
    fn new(is_fore: bool, joints: [Vec3; 3], heading: Vec3) -> Self {
        let [top, _, wrist] = joints;
        let forward = vec3(heading.x, heading.y, 0.0).normalize();
        let sideways = vec3(forward.y, -forward.x, 0.0);
        let digits = std::array::from_fn(|i| {
            let spread = (i as f32 - 2.0) * 0.36;
            let (s, c) = sin_cos(spread);
            let along = forward * c + sideways * s;
            let length = [16.0, 20.0, 21.5, 20.0, 15.5][i] * if is_fore { 1.0 } else { 1.08 };
            let root = wrist + sideways * ((i as f32 - 2.0) * 3.2) + forward * 3.0 - Vec3::Z * 2.0;
            let floor = |p: Vec3, z: f32| vec3(p.x, p.y, z);
            let knuckle = floor(root + along * (length * 0.42), mix(root.z, GROUND_Z + 3.2, 0.55));
            let middle = floor(root + along * (length * 0.74), mix(root.z, GROUND_Z + 3.2, 0.85));
            let tip = floor(root + along * length, GROUND_Z + 3.2);
            [root, knuckle, middle, tip, floor(tip + along * 7.5, GROUND_Z + 1.0)]
        });
        let middle = (top + wrist) * 0.5;
        let reach = digits.iter().flatten().chain(&joints).map(|p| (*p - middle).length()).fold(0.0, f32::max);
        let radii = [18.0, 14.0, 10.5];
        Self { joints, digits, radii, is_fore, ball: (middle, reach + 16.0) }
    }

    /// Distance from a ball around it.
    pub fn bound(&self, p: Vec3) -> f32 {
        (p - self.ball.0).length() - self.ball.1
    }

    /// Its skin, without scales.
    pub fn skin(&self, p: Vec3) -> f32 {
        let [a, b, c] = self.joints;
        let [ra, rb, rc] = self.radii;
        let calf = c + (b - c) * 0.55;
        let mut d = chain(p, &[(a, ra), (b, rb), (calf, mix(rc, rb, 0.65)), (c, rc)], 7.0);
        let foot = (self.digits[1][1] + self.digits[3][1]) * 0.5;
        d = smin(d, cone(p, c, foot + vec3(0.0, 0.0, 1.0), rc * 0.92, 6.0), 5.0);
        let mut toes = f32::MAX;
        for digit in &self.digits {
            // A web between the toes: a wide fillet.
            toes =
                smin(toes, chain(p, &[(digit[0], 5.4), (digit[1], 5.0), (digit[2], 4.3), (digit[3], 3.5)], 2.0), 5.0);
        }
        smin(d, toes, 5.0)
    }

    /// The horn of its claws.
    pub fn claws(&self, p: Vec3) -> f32 {
        self.digits.iter().map(|g| cone(p, mix3(g[2], g[3], 0.75), g[4], 2.5, 0.5)).fold(f32::MAX, f32::min)
    }

    /// Its bones.
    pub fn bones(&self, p: Vec3) -> f32 {
        let [a, b, c] = self.joints;
        let upper = long_bone(p, mix3(a, b, 0.02), mix3(a, b, 0.93), 2.9, 4.5);
        // Two bones side by side.
        let side = (c - b).cross(Vec3::Z).normalize_or(Vec3::X) * 3.1;
        let (from, to) = (mix3(b, c, 0.14), mix3(b, c, 0.9));
        let mut d = upper.min(long_bone(p, from + side, to + side, 1.8, 2.6));
        d = d.min(long_bone(p, from - side, to - side * 0.9, 2.0, 2.8));
        for digit in &self.digits {
            // A small bone of the wrist, then one of the palm and two of the toe, with joints between.
            d = d.min((p - mix3(c, digit[0], 0.75)).length() - 2.2);
            for (i, w) in digit[..4].windows(2).enumerate() {
                let ends = [2.3, 2.1, 1.9][i];
                d = d.min(long_bone(p, mix3(w[0], w[1], 0.16), mix3(w[0], w[1], 0.88), ends * 0.72, ends));
            }
            d = d.min(cone(p, mix3(digit[3], digit[4], 0.0), mix3(digit[3], digit[4], 0.6), 1.7, 0.8));
        }
        d
    }
}

fn mix3(a: Vec3, b: Vec3, t: f32) -> Vec3 {
    a + (b - a) * t
}

/// A shaft with thicker ends.
fn long_bone(p: Vec3, a: Vec3, b: Vec3, shaft: f32, ends: f32) -> f32 {
    let k = ((b - a).length() * 0.3).min(ends * 2.4);
    let d = smin(cone(p, a, b, shaft, shaft), (p - a).length() - ends, k);
    smin(d, (p - b).length() - ends, k)
}

/// All four, caught in a step: the right fore and the left hind limb reach forward.
pub fn limbs() -> [Limb; 4] {
    [
        Limb::new(
            true,
            [vec3(37.0, 56.0, -6.0), vec3(72.0, 76.0, -12.0), vec3(79.0, 104.0, -31.0)],
            vec3(0.35, 1.0, 0.0),
        ),
        Limb::new(
            true,
            [vec3(-37.0, 56.0, -6.0), vec3(-67.0, 67.0, -12.0), vec3(-79.0, 82.0, -32.0)],
            vec3(-0.9, 0.55, 0.0),
        ),
        Limb::new(
            false,
            [vec3(30.0, -60.0, -5.0), vec3(62.0, -78.0, -11.0), vec3(72.0, -104.0, -31.0)],
            vec3(0.55, -0.75, 0.0),
        ),
        Limb::new(
            false,
            [vec3(-30.0, -60.0, -5.0), vec3(-65.0, -62.0, -11.0), vec3(-77.0, -87.0, -32.0)],
            vec3(-0.95, 0.05, 0.0),
        ),
    ]
}

/// Head and neck, stretched out or drawn in.
pub struct Head {
    /// Center of the braincase.
    center: Vec3,
    /// Sine and cosine of its turn to the right.
    turn: (f32, f32),
    /// Its nod, radians.
    nod: f32,
    /// The line of the neck's vertebrae.
    neck: Line,
    /// The neck's skin.
    skin: [(Vec3, f32); 4],
}

/// Eyes in the head's frame.
const EYE: Vec3 = vec3(10.4, 10.0, 4.4);
const EYE_RADIUS: f32 = 4.7;

/// Millimeters of a unit of the head's frame.
const HEAD_MM: f32 = 1.22;

impl Head {
    pub fn new(drawn_in: f32) -> Self {
        let t = drawn_in;
        let center = mix3(vec3(7.0, 131.0, 31.0), vec3(0.0, 84.0, -8.0), t);
        let turn = sin_cos(mix(0.32, 0.0, t));
        let nod = mix(0.06, 0.0, t);
        let nape = center - mix3(vec3(6.5, 21.0, 1.0), vec3(0.0, 22.0, -2.0), t);
        let root = shell::below_ridge(60.0, 5.0);
        let points = [
            (root, 4.2),
            (mix3(vec3(0.0, 75.0, 20.0), vec3(0.0, 58.0, 14.0), t), 4.2),
            (mix3(vec3(0.0, 88.0, 13.0), vec3(0.0, 36.0, 4.0), t), 4.2),
            (mix3(vec3(0.0, 100.0, 19.0), vec3(0.0, 42.0, -8.0), t), 4.0),
            (nape, 3.8),
        ];
        let skin = [
            (vec3(0.0, 60.0, 2.0), 20.0),
            (mix3(vec3(0.0, 82.0, 3.0), vec3(0.0, 58.0, 0.0), t), 18.0),
            (mix3(vec3(0.5, 99.0, 12.0), vec3(0.0, 60.0, -4.0), t), 14.5),
            (mix3(vec3(2.5, 114.0, 24.0), vec3(0.0, 66.0, -7.0), t), 13.0),
        ];
        Self { center, turn, nod, neck: spline(&points, 8), skin }
    }

    /// A world position in the head's frame: y to the nose, z up.
    fn frame(&self, p: Vec3) -> Vec3 {
        let a = (p - self.center) / HEAD_MM;
        let (s, c) = self.turn;
        turn_x(vec3(a.x * c - a.y * s, a.x * s + a.y * c, a.z), self.nod)
    }

    /// The same with x mirrored to the positive side.
    fn half_frame(&self, p: Vec3) -> Vec3 {
        let l = self.frame(p);
        vec3(l.x.abs(), l.y, l.z)
    }

    /// Distance from a ball around the head.
    pub fn bound(&self, p: Vec3) -> f32 {
        (p - self.center).length() - 40.0
    }

    /// The skin of head and neck.
    pub fn skin(&self, p: Vec3) -> f32 {
        let neck = chain(p, &self.skin, 8.0);
        let bound = self.bound(p);
        if bound > 20.0 {
            return neck.min(bound);
        }
        let q = self.half_frame(p);
        // A blunt wedge with a flat crown, wide cheeks and a short snout.
        let mut d = ellipsoid(q - vec3(0.0, -2.0, 0.5), vec3(15.2, 19.0, 12.4));
        d = smin(d, ellipsoid(q - vec3(6.5, -5.0, -4.0), vec3(9.0, 13.0, 8.0)), 6.0);
        d = smin(d, ellipsoid(q - vec3(0.0, 15.0, -1.5), vec3(10.2, 11.5, 9.4)), 9.0);
        d = smax(d, q.z + 0.10 * q.y - 11.4, 5.0);
        d = smax(d, -(q.z + 12.5), 5.0);
        d = smin(neck / HEAD_MM, d, 9.0);
        // Brow and cheekbone frame the eye, which looks out between two lids.
        d = smin(d, cone(q, vec3(6.5, 18.0, 7.2), vec3(11.4, 4.0, 9.0), 2.0, 2.4), 4.0);
        let e = q - EYE;
        let outward = vec3(0.93, 0.30, 0.20);
        let across = e - outward * e.dot(outward);
        let rim = vec2(vec2(across.y, across.z * 1.25).length() - 4.9, e.dot(outward) - 2.6).length() - 1.25;
        d = smax(d, 5.6 - e.length(), 2.0);
        d = smin(d, rim, 2.0);
        d = d.min(e.length() - EYE_RADIUS);
        // The line of the mouth, curved up behind, and the nostrils.
        let line = q.z + 5.4 - 0.005 * (q.y - 10.0) * (q.y - 10.0) + 1.6 * bump(q.y - 26.0, 7.0);
        let open = mix(-1.2, 1.0, smoothstep(-8.0, -3.0, q.y));
        d = smax(d, open - vec2(line, d).length(), 1.2);
        d = smax(d, 1.2 - (q - vec3(2.4, 26.2, 1.6)).length(), 1.0);
        // The ear drum.
        d = smax(d, 3.2 - (q - vec3(16.6, -8.0, 0.0)).length(), 2.5);
        d * HEAD_MM
    }

    /// The horny sheath of the jaws, on a head whose skin is `skin` mm away.
    pub fn beak(&self, p: Vec3, skin: f32) -> f32 {
        let l = self.frame(p);
        let edge = smax((l.z + 5.0).abs() - 4.6, 13.0 - l.y, 3.0) * HEAD_MM;
        smax(smax(-skin - 1.8, skin, 0.5), edge, 2.0)
    }

    pub fn eyes(&self, p: Vec3) -> f32 {
        ((self.half_frame(p) - EYE).length() - EYE_RADIUS) * HEAD_MM
    }

    /// The room of the brain, in the head's frame.
    fn brain_room(l: Vec3) -> f32 {
        let case = ellipsoid(l - vec3(0.0, -4.0, 3.0), vec3(4.2, 8.0, 3.6));
        smin(case, cone(l, vec3(0.0, 3.0, 3.0), vec3(0.0, 14.0, 2.5), 2.4, 1.5), 3.0)
    }

    /// The brain.
    pub fn brain(&self, p: Vec3) -> f32 {
        (Self::brain_room(self.frame(p)) + 0.4) * HEAD_MM
    }

    /// The skull without the lower jaw, in the head's frame.
    fn cranium(q: Vec3) -> f32 {
        let roof = smax(ellipsoid(q - vec3(0.0, 2.0, -0.5), vec3(12.4, 20.0, 9.6)), -3.6 - q.z, 2.0);
        let snout = smax(ellipsoid(q - vec3(0.0, 15.5, -1.0), vec3(8.6, 9.6, 7.4)), -5.0 - q.z, 1.5);
        let mut d = smin(roof, snout, 4.0);
        // Hollow, with the brain's box in it.
        let brain = Self::brain_room(q);
        let inside = ellipsoid(q - vec3(0.0, 1.0, -2.0), vec3(9.6, 18.0, 7.4));
        d = smax(d, -inside, 1.0);
        // The eye's round window.
        d = smax(d, 6.0 - (q - EYE).length(), 1.5);
        // The temples are open from behind; a bar runs below them, and between them a crest back.
        let temple = ellipsoid(q - vec3(9.5, -14.0, 4.5), vec3(6.6, 11.0, 7.5));
        d = smax(d, -temple, 2.0);
        d = smin(d, smax(brain - 2.2, q.y - 10.0, 1.0), 2.0);
        d = smin(d, cone(q, vec3(0.0, -6.0, 6.4), vec3(0.0, -26.0, 6.0), 2.8, 1.6), 4.0);
        d = smin(
            d,
            chain(
                q,
                &[
                    (vec3(11.0, 2.0, -2.0), 2.2),
                    (vec3(12.0, -6.0, -2.0), 2.2),
                    (vec3(10.5, -13.0, -1.5), 3.0),
                    (vec3(9.6, -12.0, -5.6), 2.6),
                ],
                2.0,
            ),
            2.0,
        );
        d = smin(d, cone(q, vec3(10.5, -12.5, -1.0), vec3(3.5, -11.0, 1.0), 2.2, 2.6), 2.5);
        // The palate.
        d = smin(d, smax(ellipsoid(q - vec3(0.0, 8.0, -4.0), vec3(8.0, 17.0, 1.9)), -4.6 - q.z, 1.0), 2.0);
        // Nostrils, brain, the way of the cord.
        d = smax(d, 3.0 - (q - vec3(1.6, 25.8, 1.8)).length(), 1.0);
        d = smax(d, -brain, 0.8);
        smax(d, -cone(q, vec3(0.0, -8.0, 2.5), vec3(0.0, -26.0, 0.0), 2.2, 2.2), 0.6)
    }

    /// The lower jaw, in the head's frame.
    fn mandible(q: Vec3) -> f32 {
        let s = vec3(q.x, q.y, q.z * 0.72);
        let arch = [
            (vec3(9.4, -12.0, -7.8), 1.9),
            (vec3(10.0, -3.0, -8.6), 2.0),
            (vec3(8.8, 9.0, -8.4), 2.1),
            (vec3(5.0, 19.0, -7.8), 2.1),
            (vec3(0.0, 22.4, -7.4), 2.2),
        ];
        chain(s, &arch.map(|(p, r)| (vec3(p.x, p.y, p.z * 0.72), r)), 2.0)
    }

    /// The bones of the head: (skull without the lower jaw, lower jaw).
    pub fn bones(&self, p: Vec3) -> (f32, f32) {
        let bound = self.bound(p);
        if bound > 8.0 {
            return (bound, bound);
        }
        let q = self.half_frame(p);
        let (cranium, jaw) = (Self::cranium(q), Self::mandible(q));
        // A joint's space between them, so that the jaw comes free.
        (cranium * HEAD_MM, smax(jaw, 1.1 - cranium, 0.8) * HEAD_MM)
    }

    /// The eight vertebrae of the neck.
    pub fn vertebrae(&self, p: Vec3) -> f32 {
        beads(p, &self.neck, 8, 3.6)
    }

    /// The cord within them.
    pub fn cord(&self, p: Vec3) -> f32 {
        tube(p - Vec3::Z * 5.0, &self.neck) + 2.2
    }

    /// Where windpipe and gullet run below the vertebrae: a line from the throat into the chest.
    pub fn throat(&self) -> [Vec3; 3] {
        [self.center + vec3(-3.0, -10.0, -10.0), self.skin[2].0 - vec3(0.0, 0.0, 7.0), vec3(0.0, 70.0, -6.0)]
    }

    /// The muscles of the neck.
    pub fn muscles(&self, p: Vec3) -> f32 {
        let inner = self.skin.map(|(at, r)| (at, r - 3.6));
        let cheeks = if self.bound(p) < 8.0 {
            let q = self.half_frame(p);
            let temple = ellipsoid(q - vec3(8.5, -10.0, 1.0), vec3(5.4, 10.0, 8.5));
            temple.min(ellipsoid(q - vec3(0.0, 6.0, -9.0), vec3(7.0, 13.0, 2.4))) * HEAD_MM
        } else {
            f32::MAX
        };
        chain(p, &inner, 8.0).min(cheeks)
    }
}

/// Vertebrae along a line: `count` spools with an arch and a crest, thinner toward the end of the line as its radii
/// are.
pub fn beads(p: Vec3, line: &[(Vec3, f32)], count: usize, arch: f32) -> f32 {
    // The nearest place on the line, as a number of pieces from its begin.
    let (mut best, mut at, mut radius, mut along) = (f32::MAX, 0.0, 1.0, Vec3::Y);
    for (i, w) in line.windows(2).enumerate() {
        let ((a, ra), (b, rb)) = (w[0], w[1]);
        let (pa, ba) = (p - a, b - a);
        let h = (pa.dot(ba) / ba.length_squared()).clamp(0.0, 1.0);
        let d = (pa - ba * h).length();
        if d < best {
            (best, at, radius, along) = (d, i as f32 + h, mix(ra, rb, h), ba);
        }
    }
    if best > 16.0 {
        return best - 9.0;
    }
    let segment = at * (count as f32 / (line.len() - 1) as f32);
    let t = segment - segment.floor() - 0.5;
    // A spool: thin in its middle, with a gap to the next.
    let waist = 1.0 - 0.22 * bump(t, 0.42);
    let gap = smoothstep(0.42, 0.5, t.abs()) * 1.2;
    let body = best - radius * waist + gap;
    // The arch stands on the upper side, the crest on it.
    let up = (Vec3::Z - along * (along.z / along.length_squared())).normalize_or(Vec3::Z);
    let crest = {
        let center = p - up * (radius + arch * 0.55);
        let mut nearest = f32::MAX;
        for w in line.windows(2) {
            nearest = nearest.min(cone(center, w[0].0, w[1].0, 0.0, 0.0));
        }
        nearest - radius * 0.72 + 2.4 * smoothstep(0.22, 0.5, t.abs())
    };
    smin(body, crest, 2.0)
}

/// The line of the back's vertebrae under the carapace, and on into the tail, which curls to the LEFT.
pub fn spine() -> (Line, Line) {
    let back: Line = (0..=7).map(|i| (shell::below_ridge(60.0 - 18.0 * i as f32, 4.0), 3.6)).collect();
    let end = back[back.len() - 1].0;
    let tail = [
        (end, 3.6),
        (vec3(0.0, -82.0, 13.0), 3.4),
        (vec3(0.0, -97.0, -5.0), 3.0),
        (vec3(-3.0, -113.0, -17.0), 2.3),
        (vec3(-10.0, -126.0, -24.0), 1.7),
        (vec3(-20.0, -134.0, -28.0), 1.1),
    ];
    (spline(&back, 3), spline(&tail, 5))
}

/// The skin of the tail.
pub fn tail_skin(p: Vec3) -> f32 {
    chain(
        p,
        &[
            (vec3(0.0, -78.0, 2.0), 15.0),
            (vec3(0.0, -97.0, -8.0), 9.0),
            (vec3(-3.0, -113.0, -19.0), 6.0),
            (vec3(-10.0, -126.0, -25.0), 4.2),
            (vec3(-22.0, -136.0, -29.0), 2.0),
        ],
        6.0,
    )
}
