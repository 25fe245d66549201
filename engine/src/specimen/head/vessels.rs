//! Arteries and veins filled with contrast: tapering tubes along anatomical courses, and smaller branches that
//! find their own way over the surface of the brain. All of it follows from fixed points and hashes.

use glam::{Vec3, vec3};

use super::{brain, skull};
use crate::specimen::sdf::*;

/// Right-handedness of the drainage: the RIGHT transverse sinus (x > 0) is dominant.
const DOMINANT: f32 = 1.0;

/// A short piece of a vessel.
pub struct Tube {
    a: Vec3,
    b: Vec3,
    ra: f32,
    rb: f32,
    /// Artery or vein.
    pub artery: bool,
}

impl Tube {
    /// Distance from its wall.
    #[inline]
    pub fn distance(&self, p: Vec3) -> f32 {
        cone(p, self.a, self.b, self.ra, self.rb)
    }

    /// Distance from the box around it: a lower bound of [`Tube::distance`].
    pub fn bound(&self, p: Vec3) -> f32 {
        let r = Vec3::splat(self.ra.max(self.rb));
        (self.a.min(self.b) - r - p).max(p - self.a.max(self.b) - r).max(Vec3::ZERO).length()
    }
}

struct Tree {
    tubes: Vec<Tube>,
    seed: u32,
}

impl Tree {
    /// A number in [0, 1), the next of its row.
    fn roll(&mut self) -> f32 {
        self.seed = self.seed.wrapping_add(1);
        unit(hash(self.seed as i32, 17, 4, 9))
    }

    /// A vessel through points with radii.
    fn course(&mut self, artery: bool, points: &[(Vec3, f32)]) {
        for w in spline(points, 5).windows(2) {
            self.tubes.push(Tube { a: w[0].0, b: w[1].0, ra: w[0].1, rb: w[1].1, artery });
        }
    }

    /// The same vessel on both sides.
    fn pair(&mut self, artery: bool, points: &[(Vec3, f32)]) {
        self.course(artery, points);
        let mirrored: Vec<_> = points.iter().map(|&(p, r)| (vec3(-p.x, p.y, p.z), r)).collect();
        self.course(artery, &mirrored);
    }

    /// A vessel that creeps over the hemisphere from `p` toward `heading`, forking as it thins out.
    fn creep(&mut self, artery: bool, mut p: Vec3, mut heading: Vec3, mut radius: f32, mut length: f32) {
        const STEP: f32 = 3.0;
        let side = if p.x < 0.0 { -1.0 } else { 1.0 };
        p = on_brain(p, side);
        let (mut bend, mut since_fork) = (0.0_f32, 0.0_f32);
        while length > 0.0 && radius > 0.68 {
            let n = normal_of(p, side);
            heading = (heading - n * heading.dot(n)).normalize_or(Vec3::Y);
            bend = 0.75 * bend + 0.32 * (self.roll() - 0.5);
            heading = (heading + n.cross(heading) * bend).normalize();
            let next = on_brain(p + heading * STEP, side);
            let thinner = radius - STEP * 0.009;
            self.tubes.push(Tube { a: p, b: next, ra: radius, rb: thinner, artery });
            (p, radius) = (next, thinner);
            length -= STEP;
            since_fork += STEP;
            if since_fork > 13.0 && radius > 0.85 && self.roll() < 0.4 {
                since_fork = 0.0;
                let turn = if self.roll() < 0.5 { 0.75 } else { -0.75 };
                let child = (heading + n.cross(heading) * turn).normalize();
                self.creep(artery, p, child, radius * 0.82, length * 0.75);
                heading = (heading - n.cross(heading) * turn * 0.4).normalize();
            }
        }
    }
}

/// Gradient of the hemisphere's hull, pointing out, on the given side.
fn normal_of(p: Vec3, side: f32) -> Vec3 {
    let f = |p: Vec3| brain::hull(vec3(p.x * side, p.y, p.z));
    let e = 0.8;
    vec3(
        f(p + Vec3::X * e) - f(p - Vec3::X * e),
        f(p + Vec3::Y * e) - f(p - Vec3::Y * e),
        f(p + Vec3::Z * e) - f(p - Vec3::Z * e),
    )
    .normalize_or(Vec3::Z)
}

/// The nearest point on the surface of the hemisphere: vessels lie in the fluid on it.
fn on_brain(mut p: Vec3, side: f32) -> Vec3 {
    for _ in 0..3 {
        p -= normal_of(p, side) * (brain::hull(vec3(p.x * side, p.y, p.z)) - 0.1);
    }
    p
}

/// The point of the cavity's wall in a direction from `from`, `inset` mm inside of it.
fn on_wall(from: Vec3, direction: Vec3, inset: f32) -> Vec3 {
    let d = direction.normalize();
    let mut t = 0.0;
    for _ in 0..60 {
        let p = from + d * t;
        t += (-skull::cavity(vec3(p.x.abs(), p.y, p.z)) - inset) * 0.7;
    }
    from + d * t
}

/// The direction in the sagittal plane that rises `degrees` (0 to 200) from the front over the top to the back.
fn sagittal(degrees: f32) -> Vec3 {
    let (s, c) = sin_cos(degrees * 0.5 * (std::f32::consts::PI / 180.0));
    vec3(0.0, c * c - s * s, 2.0 * s * c)
}

/// All vessels.
pub fn vessels() -> Vec<Tube> {
    let mut t = Tree { tubes: Vec::new(), seed: 2008 };
    arteries(&mut t);
    veins(&mut t);
    t.tubes
}

fn arteries(t: &mut Tree) {
    // Common and internal carotid, petrous bend and siphon.
    t.pair(
        true,
        &[
            (vec3(24.0, 12.0, -140.0), 3.4),
            (vec3(26.0, 11.0, -105.0), 3.6),
            (vec3(28.0, 5.0, -88.0), 3.0),
            (vec3(28.0, 3.0, -55.0), 2.5),
            (vec3(27.0, 2.0, -32.0), 2.4),
            (vec3(25.0, 8.0, -12.0), 2.4),
            (vec3(17.0, 13.0, -4.0), 2.3),
            (vec3(11.0, 19.0, 3.0), 2.3),
            (vec3(10.5, 29.0, 9.0), 2.2),
            (vec3(9.5, 28.0, 15.0), 2.1),
            (vec3(11.5, 20.0, 19.0), 2.0),
        ],
    );
    // External carotid to the superficial temporal artery and its two branches over the scalp.
    t.pair(
        true,
        &[
            (vec3(27.0, 11.0, -103.0), 2.2),
            (vec3(33.0, 17.0, -82.0), 2.1),
            (vec3(42.0, 10.0, -52.0), 1.8),
            (vec3(58.0, 3.0, -24.0), 1.6),
            (vec3(70.0, 7.0, 0.0), 1.3),
            (vec3(74.0, 8.0, 20.0), 1.1),
        ],
    );
    for ends in [
        [vec3(73.0, 8.0, 20.0), vec3(70.0, 34.0, 48.0), vec3(50.0, 66.0, 70.0), vec3(34.0, 76.0, 86.0)],
        [vec3(73.0, 8.0, 20.0), vec3(76.0, -6.0, 52.0), vec3(68.0, -22.0, 84.0), vec3(45.0, -30.0, 108.0)],
    ] {
        let scalp = |p: Vec3| {
            // Onto a level 3.6 mm above the bone, in the fat of the scalp.
            let mut p = p;
            for _ in 0..6 {
                let center = vec3(0.0, -10.0, 35.0);
                p += (p - center).normalize() * (3.8 - smin(skull::vault(p), skull::cavity(p) - 4.0, 6.0)) * 0.8;
            }
            p
        };
        let path: Vec<_> = spline(&ends.map(|p| (p, 1.0)), 5)
            .into_iter()
            .enumerate()
            .map(|(i, (p, _))| {
                let wiggle =
                    [vec3(0.0, 1.6, 0.3), vec3(0.0, 0.2, -1.2), vec3(0.0, -1.6, 0.2), vec3(0.0, 0.1, 1.2)][i % 4];
                (if i == 0 { p } else { scalp(p + wiggle) }, 1.15 - 0.025 * i as f32)
            })
            .collect();
        t.pair(true, &path);
    }
    // Facial artery: round the jaw, past the mouth, up beside the nose.
    t.pair(
        true,
        &[
            (vec3(34.0, 18.0, -80.0), 1.4),
            (vec3(44.0, 38.0, -76.0), 1.3),
            (vec3(49.0, 44.0, -64.0), 1.2),
            (vec3(36.0, 77.0, -50.0), 1.1),
            (vec3(23.0, 90.0, -34.0), 1.0),
            (vec3(16.0, 91.0, -12.0), 0.9),
            (vec3(13.0, 88.5, 8.0), 0.8),
        ],
    );
    // Vertebral arteries through the transverse processes and over the atlas to the basilar.
    t.pair(
        true,
        &[
            (vec3(19.5, -2.0, -140.0), 1.9),
            (vec3(19.5, -3.0, -64.0), 1.9),
            (vec3(26.0, -4.0, -50.0), 1.9),
            (vec3(27.0, -12.0, -37.0), 1.8),
            (vec3(17.0, -27.0, -33.0), 1.8),
            (vec3(9.0, -15.0, -28.0), 1.7),
            (vec3(4.0, -3.0, -20.0), 1.7),
            (vec3(0.0, 4.5, -12.0), 1.8),
        ],
    );
    t.course(
        true,
        &[
            (vec3(0.0, 4.5, -12.0), 2.0),
            (vec3(0.6, 7.2, -2.0), 2.0),
            (vec3(0.0, 8.0, 8.0), 1.9),
            (vec3(0.0, 7.0, 15.0), 1.8),
        ],
    );
    // The ring: anterior cerebral, communicating, posterior cerebral arteries.
    t.pair(true, &[(vec3(11.5, 20.0, 19.0), 1.4), (vec3(7.0, 26.0, 21.5), 1.3), (vec3(2.2, 31.0, 23.0), 1.3)]);
    t.course(true, &[(vec3(2.2, 31.0, 23.0), 1.0), (vec3(-2.2, 31.0, 23.0), 1.0)]);
    t.pair(true, &[(vec3(11.5, 20.0, 18.0), 1.0), (vec3(10.0, 12.0, 16.5), 0.9), (vec3(8.0, 4.5, 16.0), 1.0)]);
    t.pair(
        true,
        &[
            (vec3(2.2, 31.0, 23.0), 1.3),
            (vec3(1.8, 42.0, 30.0), 1.2),
            (vec3(1.6, 44.0, 41.0), 1.2),
            (vec3(1.6, 34.0, 54.0), 1.1),
            (vec3(1.6, 12.0, 60.5), 1.0),
            (vec3(1.6, -18.0, 61.0), 0.9),
            (vec3(1.6, -38.0, 56.0), 0.8),
        ],
    );
    t.pair(
        true,
        &[
            (vec3(0.0, 7.0, 15.0), 1.5),
            (vec3(8.0, 4.5, 16.0), 1.4),
            (vec3(15.5, -6.0, 18.0), 1.3),
            (vec3(17.0, -22.0, 20.0), 1.2),
            (vec3(14.0, -44.0, 22.0), 1.1),
            (vec3(8.0, -66.0, 26.0), 0.9),
        ],
    );
    // Superior and inferior cerebellar arteries.
    t.pair(
        true,
        &[
            (vec3(0.0, 7.5, 12.0), 1.0),
            (vec3(12.0, 2.0, 11.0), 1.0),
            (vec3(20.0, -14.0, 12.0), 0.9),
            (vec3(19.0, -32.0, 15.0), 0.8),
        ],
    );
    t.pair(
        true,
        &[
            (vec3(1.0, 6.0, -6.0), 0.9),
            (vec3(14.0, 2.0, -9.0), 0.9),
            (vec3(24.0, -14.0, -12.0), 0.8),
            (vec3(32.0, -26.0, -20.0), 0.7),
        ],
    );
    // Middle cerebral artery: to the Sylvian fissure, then branches out of it over the convexity.
    t.pair(
        true,
        &[
            (vec3(11.5, 20.0, 19.0), 1.8),
            (vec3(24.0, 22.0, 20.0), 1.7),
            (vec3(38.0, 22.0, 22.0), 1.6),
            (vec3(46.0, 12.0, 26.5), 1.5),
            (vec3(48.0, -8.0, 32.0), 1.3),
        ],
    );
    for side in [1.0_f32, -1.0] {
        let from = |y: f32| vec3(side * 44.0, y, 26.5 - 0.29 * (y - 10.0));
        for (y, up, back, length) in [
            (26.0, 1.0, 0.9, 70.0),
            (14.0, 1.0, 0.15, 75.0),
            (2.0, 1.0, -0.25, 75.0),
            (-14.0, 1.0, -0.7, 75.0),
            (-30.0, 0.5, -1.0, 60.0),
            (18.0, -0.8, -0.3, 40.0),
            (-4.0, -0.8, -0.6, 45.0),
        ] {
            let start = from(y);
            let lip = on_brain(vec3(side * 72.0, y, start.z + 2.5 * up), side);
            t.course(true, &[(start, 1.2), (start.lerp(lip, 0.45) + vec3(0.0, 3.5 * back, 1.2), 1.1), (lip, 1.4)]);
            t.creep(true, lip, vec3(0.0, back, up), 1.4, length);
        }
        // Branches of the anterior cerebral over the medial edge.
        for (p, d) in [
            (vec3(1.6, 44.0, 41.0), vec3(0.0, 1.0, 0.6)),
            (vec3(1.6, 34.0, 54.0), vec3(0.0, 0.5, 1.0)),
            (vec3(1.6, 12.0, 60.5), vec3(0.0, -0.2, 1.0)),
            (vec3(1.6, -18.0, 61.0), vec3(0.0, -0.7, 1.0)),
        ] {
            t.creep(true, vec3(p.x * side, p.y, p.z), d, 1.15, 48.0);
        }
        t.creep(true, vec3(8.0 * side, -66.0, 26.0), vec3(0.0, -1.0, 0.4), 1.15, 40.0);
    }
}

fn veins(t: &mut Tree) {
    // Superior sagittal sinus: along the crest of the vault, widening backward to the confluence.
    let hub = vec3(0.0, -10.0, 35.0);
    let mut sinus = Vec::new();
    for i in 0..=16 {
        let angle = 8.0 + 190.0 * i as f32 / 16.0;
        let r = 1.4 + 2.6 * i as f32 / 16.0;
        sinus.push((on_wall(hub, sagittal(angle), r * 0.6), r));
    }
    t.course(false, &sinus);
    let confluence = sinus[sinus.len() - 1].0;
    for side in [1.0_f32, -1.0] {
        // The dominant side takes most of the blood.
        let k: f32 = if side == DOMINANT { 1.0 } else { 0.5 };
        let mut path = vec![(confluence, 3.4 * k.max(0.6))];
        for i in 1..5 {
            // From the confluence around the back of the posterior fossa: 15° to 72° off the midline.
            let back = sagittal(19.0 * i as f32 - 4.0);
            let center = vec3(0.0, -38.0, confluence.z + 1.0);
            path.push((on_wall(center, vec3(side * back.z, -back.y, 0.0), 2.2 * k + 0.6), 4.2 * k));
        }
        path.extend([
            (vec3(side * 49.0, -26.0, -4.0), 4.0 * k),
            (vec3(side * 43.0, -20.0, -16.0), 3.9 * k),
            (vec3(side * 31.0, -13.0, -22.0), 4.0 * k.max(0.7)),
            (vec3(side * 31.0, -7.0, -38.0), 4.4 * k.max(0.75)),
            (vec3(side * 35.0, 5.0, -80.0), 5.0 * k.max(0.75)),
            (vec3(side * 33.0, 12.0, -140.0), 5.6 * k.max(0.75)),
        ]);
        t.course(false, &path);
        // Bridging veins climb the convexity to the sinus.
        for i in 0..9 {
            let angle = 30.0 + 15.0 * i as f32 + 6.0 * t.roll();
            let start = on_wall(hub, sagittal(angle), 1.5);
            let near = on_brain(start + vec3(side * 7.0, 2.0, 0.0), side);
            t.course(false, &[(start, 1.5), (near, 1.5)]);
            let sway = t.roll() - 0.35;
            t.creep(false, near, vec3(side, sway * 0.8, -0.4), 1.5, 66.0);
        }
        // The vein of Labbé, from the Sylvian fissure back to the transverse sinus.
        let labbe = vec3(side * 66.0, -8.0, 24.0);
        t.creep(false, labbe, vec3(0.0, -1.0, -0.35), 1.5, 48.0);
    }
    // Straight sinus and the deep veins that feed it.
    t.course(false, &[(vec3(0.0, -42.0, 38.0), 2.0), (vec3(0.0, -60.0, 25.0), 2.1), (confluence, 2.6)]);
    t.pair(
        false,
        &[
            (vec3(5.0, 16.0, 37.5), 0.9),
            (vec3(1.5, -8.0, 40.0), 1.1),
            (vec3(1.0, -32.0, 41.0), 1.3),
            (vec3(0.0, -42.0, 38.0), 1.8),
        ],
    );
    // External jugular vein, in the fat of the neck.
    t.pair(false, &[(vec3(56.0, 4.0, -40.0), 1.6), (vec3(51.0, 6.0, -70.0), 1.8), (vec3(47.0, 4.0, -140.0), 2.2)]);
}
