//! The bones of the head: skull, mandible, teeth and the upper cervical spine.
//!
//! Functions take `q`, the position with x mirrored to the positive side, unless they say `p`.

use std::sync::LazyLock;

use glam::{Vec2, Vec3, vec2, vec3};

use crate::specimen::sdf::*;

/// Thickness of the compact table of a bone, mm: spongy bone begins this deep.
pub const TABLE_MM: f32 = 1.8;

/// The egg of the braincase (outer table), before it is opened to the face and the base: two ellipsoids, a wide
/// parietal one and a narrower frontal one.
pub fn vault(q: Vec3) -> f32 {
    let parietal = ellipsoid(q - vec3(0.0, -21.0, 40.0), vec3(71.0, 70.0, 73.5));
    let frontal = ellipsoid(q - vec3(0.0, 28.5, 49.0), vec3(57.0, 60.0, 61.0));
    smin(parietal, frontal, 24.0)
}

/// Height of the floor under the cerebrum: the orbital roofs in front, the sella in the middle, the tentorium
/// behind, which slopes down to the sides.
pub fn cerebral_floor(q: Vec3) -> f32 {
    let tent = smoothstep(-18.0, -66.0, q.y);
    20.0 + 15.0 * smoothstep(20.0, 42.0, q.y) - 13.0 * tent - 6.0 * tent * smoothstep(10.0, 45.0, q.x)
}

/// The part of the cranial cavity above orbits, sella and tentorium.
fn supratentorial(q: Vec3) -> f32 {
    smax(vault(q) + 6.2, (cerebral_floor(q) - q.z) * 0.8, 12.0)
}

/// The middle fossa, where the temporal lobe lies.
fn temporal_fossa(q: Vec3) -> f32 {
    ellipsoid(turn_z(q - vec3(43.0, 8.0, 17.0), 0.12), vec3(20.5, 39.0, 18.0))
}

/// The room of the cerebrum.
pub fn cerebral_room(q: Vec3) -> f32 {
    smin(supratentorial(q), temporal_fossa(q), 7.0)
}

/// The room of cerebellum and brain stem below the tentorium.
pub fn posterior_fossa(q: Vec3) -> f32 {
    // Its long axis rises backward, as the nuchal plane under it does.
    let fossa = ellipsoid(turn_x(q - vec3(0.0, -45.0, -4.0), 0.32), vec3(53.0, 41.0, 28.0));
    smax(fossa, q.z - 26.0, 8.0)
}

/// The way of the brain stem from the sella to the foramen magnum, and on down the spinal canal.
fn stem_room(q: Vec3) -> f32 {
    let upper = cone(q, vec3(0.0, -8.0, 18.0), vec3(0.0, -18.0, -26.0), 19.0, 15.5);
    smin(upper, cone(q, vec3(0.0, -19.0, -22.0), vec3(0.0, -21.0, -42.0), 15.5, 11.0), 6.0)
}

/// The cranial cavity: the inner table of the skull.
pub fn cavity(q: Vec3) -> f32 {
    smin(smin(cerebral_room(q), posterior_fossa(q), 5.0), stem_room(q), 6.0)
}

/// One orbit: a cone from the rim to the optic canal, its rim a rounded square about 40 x 34 mm.
pub fn orbit(q: Vec3) -> f32 {
    let apex = vec3(13.0, 31.0, 19.0);
    let axis = (vec3(35.0, 82.0, 15.0) - apex).normalize();
    let a = q - apex;
    let h = a.dot(axis);
    let side = axis.cross(Vec3::Z).normalize();
    let up = side.cross(axis);
    let s = vec2(a.dot(side), a.dot(up) + a.dot(side) * 0.12);
    let t = (h / 50.0).max(0.0);
    // The walls open quickly behind and run nearly parallel toward the rim.
    let r = mix(3.0, 20.0, t / (0.42 + 0.58 * t));
    // A superellipse: squarer than a circle, wider than high.
    let m = vec2(s.x / 1.07, s.y / 0.93).abs();
    let n = (m.x * m.x * m.x * m.x + m.y * m.y * m.y * m.y).sqrt().sqrt();
    smax((n - r) * 0.85, -h - 1.0, 3.0)
}

/// The pear-shaped nasal opening and the nasal cavity behind it, both sides.
pub fn nasal_cavity(q: Vec3) -> f32 {
    // Widest just above the floor, narrow under the nasal bones.
    let pear = |r0: f32, r1: f32, top: f32| {
        let (a, b) = (vec2(6.0, -19.0), vec2(1.5, top));
        let (pa, ba) = (vec2(q.x, q.z) - a, b - a);
        let h = (pa.dot(ba) / ba.length_squared()).clamp(0.0, 1.0);
        (pa - ba * h).length() - mix(r0, r1, h)
    };
    let front = smax(pear(7.0, 3.0, 2.0), (q.y - 80.0).abs() - 30.0, 2.0);
    let back = smax(pear(9.0, 4.0, 16.0), (q.y - 58.0).abs() - 27.0, 6.0);
    smin(front, back, 4.0)
}

/// The maxillary sinus.
pub fn maxillary_sinus(q: Vec3) -> f32 {
    let body = ellipsoid(q - vec3(30.0, 60.0, -18.0), vec3(10.0, 14.0, 12.0));
    smax(body, 4.5 - orbit(q), 3.0)
}

/// Frontal, ethmoid and sphenoid air cells.
pub fn midline_sinuses(p: Vec3) -> f32 {
    let q = vec3(p.x.abs(), p.y, p.z);
    // The frontal sinus is never symmetric: its septum stands off the midline.
    let f = vec3((p.x - 2.0).abs(), p.y, p.z);
    let frontal = ellipsoid(turn_x(f - vec3(9.0, 86.0, 34.0), -0.25), vec3(8.5, 3.8, 10.0));
    let sphenoid = ellipsoid(q - vec3(6.5, 20.0, 4.0), vec3(5.6, 11.0, 8.5));
    // Ethmoid: two rows of small cells between the orbits.
    let e = vec3(q.x - 7.5, q.y - 56.0, q.z - 15.0);
    let cell =
        vec3(e.x, e.y - (e.y / 9.0).round().clamp(-2.0, 2.0) * 9.0, e.z - (e.z / 9.0).round().clamp(-1.0, 0.0) * 9.0);
    let ethmoid = smax(ellipsoid(cell, vec3(3.2, 3.9, 3.9)), 2.6 - orbit(q), 1.0);
    frontal.min(sphenoid).min(ethmoid)
}

/// The zygomatic arch is modeled with z halved: a round tube becomes an upright strap, and the distance stays a
/// lower bound.
const STRAP: Vec3 = vec3(1.0, 1.0, 0.55);

static ARCH: LazyLock<Vec<(Vec3, f32)>> = LazyLock::new(|| {
    let points = [
        (vec3(53.0, 62.0, -8.0), 3.4),
        (vec3(62.0, 48.0, -8.0), 2.7),
        (vec3(65.5, 32.0, -6.0), 2.4),
        (vec3(65.0, 17.0, -2.5), 2.5),
        (vec3(60.0, 4.0, 2.0), 3.2),
    ];
    spline(&points.map(|(p, r)| (p * STRAP, r)), 4)
});

/// Zygomatic bone with its free-standing arch.
fn zygoma(q: Vec3) -> f32 {
    let body = ellipsoid(turn_z(q - vec3(46.0, 66.0, -9.0), -0.75), vec3(12.0, 7.0, 11.0));
    let rim = cone(q, vec3(30.0, 80.0, -6.0), vec3(48.0, 69.0, -3.0), 4.5, 5.0);
    let lateral =
        chain(q, &[(vec3(50.0, 66.0, -4.0), 6.0), (vec3(52.5, 63.0, 14.0), 4.5), (vec3(50.0, 69.0, 31.0), 5.5)], 4.0);
    let buttress = cone(q, vec3(47.0, 63.0, -13.0), vec3(35.0, 64.0, -31.0), 7.0, 6.0);
    // The arch is a strap: 4 mm thick, 8 mm high.
    let arch = tube(q * STRAP, &ARCH);
    smin(smin(smin(body, rim, 6.0), smin(lateral, buttress, 4.0), 7.0), arch, 3.0)
}

/// Upper jaw: body, tooth-bearing process, spine.
fn maxilla(q: Vec3) -> f32 {
    let body = ellipsoid(q - vec3(12.0, 60.0, -14.0), vec3(32.0, 29.0, 26.0));
    let arch = ellipse(vec2(q.x, q.y - 44.0), vec2(27.0, 44.0)).abs() - 5.5;
    let alveolar = smax(smax(arch, (q.z + 34.0).abs() - 9.0, 5.0), 36.0 - q.y, 5.0);
    let palate = smax(
        smax(ellipse(vec2(q.x, q.y - 44.0), vec2(27.0, 44.0)), (q.z + 30.0 + 0.004 * q.x * q.x).abs() - 2.5, 2.0),
        34.0 - q.y,
        3.0,
    );
    let frontal_process = cone(q, vec3(9.0, 86.0, 24.0), vec3(17.0, 85.0, -10.0), 4.0, 6.0);
    // The canine fossa hollows the front below the orbit.
    let fossa = ellipsoid(q - vec3(29.0, 92.0, -18.0), vec3(13.0, 10.0, 12.0));
    let body = smax(smax(body, -fossa, 8.0), (-38.0 - q.z).max(36.0 - q.y), 6.0);
    smin(smin(smin(body, alveolar, 6.0), frontal_process, 6.0), palate, 3.0)
}

/// Depth and half width of the sutures, mm.
const SUTURE_MM: f32 = 0.85;

/// Distance from the coronal, sagittal and lambdoid sutures of the vault, whose surface is `d` mm away.
fn suture(q: Vec3, d: f32) -> f32 {
    if d.abs() > 3.0 || q.z < 8.0 {
        return 3.0;
    }
    // Each runs near a plane; the wiggle is that of interlocking bone.
    let coronal = q.y - 24.0 + 0.16 * (q.z - 100.0);
    let sagittal = if coronal < 0.0 && q.y > -78.0 { q.x - 0.4 } else { 4.0 };
    let lambdoid = if q.z < 84.0 { (q.y + 76.0 - 0.011 * q.x * q.x) * 0.8 + 0.24 * (q.z - 80.0) } else { 6.0 };
    let near = coronal.abs().min(sagittal.abs()).min(lambdoid.abs());
    if near > 6.0 {
        return 3.0;
    }
    let wiggle = 1.3 * noise(q * 0.23, 41) + 0.8 * noise(q * 0.55, 42);
    let coronal = if q.z > 20.0 { coronal } else { 4.0 };
    let line = (coronal + wiggle).abs().min((sagittal + wiggle).abs()).min((lambdoid + wiggle).abs());
    vec2(line * 0.8, d).length()
}

/// Skull without the mandible: negative in bone.
pub fn skull(p: Vec3) -> f32 {
    let q = vec3(p.x.abs(), p.y, p.z);
    let room = cavity(q);
    // Behind, the bone follows the posterior fossa in one sweep.
    let mut d = smin(smin(vault(q), posterior_fossa(q) - 3.5, 24.0), room - 4.0, 6.0);
    d = smax(d, SUTURE_MM - suture(q, d), 0.6);
    // High on the vault nothing else is near.
    if q.z > 60.0 {
        return smax(d, -room, 1.5).min(q.z - 46.0);
    }
    // The egg is cut below: the base rises from the foramen magnum to the face.
    let base = mix(-27.0, -16.0, smoothstep(-40.0, 20.0, q.y)) + 0.42 * (-32.0 - q.y).max(0.0);
    d = smax(d, base - 3.0 - q.z, 10.0);
    // Temporal fossa: the narrowing behind the orbit that the temporalis fills.
    d = smax(d, -ellipsoid(q - vec3(67.0, 46.0, 8.0), vec3(19.0, 25.0, 34.0)), 14.0);
    d = smin(d, room - 3.0, 5.0);
    // Mastoid, occipital condyle, styloid.
    d = smin(d, cone(q, vec3(55.0, -14.0, -4.0), vec3(52.0, -8.0, -25.0), 13.0, 6.0), 8.0);
    d = smin(d, ellipsoid(q - vec3(16.0, -12.0, -28.0), vec3(5.5, 10.0, 5.5)), 5.0);
    d = smin(d, cone(q, vec3(45.0, 2.0, -14.0), vec3(40.0, 10.0, -38.0), 2.8, 1.2), 3.0);
    // Occiput: nuchal lines and the external protuberance.
    d = smin(d, ellipsoid(q - vec3(0.0, -86.0, 2.0), vec3(10.0, 6.0, 7.0)), 12.0);
    // Sphenoid body, clivus, pterygoid plates.
    d = smin(d, ellipsoid(q - vec3(0.0, 22.0, 5.0), vec3(18.0, 18.0, 14.0)), 8.0);
    d = smin(d, cone(q * vec3(0.6, 1.0, 1.0), vec3(0.0, 18.0, 4.0), vec3(0.0, 2.0, -22.0), 7.0, 5.0), 6.0);
    d = smin(d, rounded_box(q - vec3(15.0, 31.0, -16.0), vec3(2.0, 8.0, 17.0), 1.5), 4.0);

    // The face.
    let brow =
        chain(q, &[(vec3(7.0, 85.0, 31.0), 7.5), (vec3(28.0, 83.5, 36.0), 6.5), (vec3(48.0, 72.0, 31.0), 5.5)], 5.0);
    d = smin(d, brow, 10.0);
    d = smin(d, maxilla(q), 6.0);
    d = smin(d, zygoma(q), 6.0);
    let piriform = nasal_cavity(q);
    d = smax(d, -piriform, 1.5);
    d = smax(d, -orbit(q), 2.5);
    // The nasal bones roof the opening; they come after it is cut.
    let nasal = cone(vec3(q.x * 0.75, q.y, q.z), vec3(0.0, 83.0, 29.0), vec3(0.0, 95.0, 4.0), 6.5, 4.2);
    let nasal = smax(nasal, -smax(nasal + 2.8, q.z - 18.0, 3.0), 1.0);
    // They end in an edge, where the cartilage begins.
    let nasal = smax(nasal, 6.0 - q.z, 1.5);
    d = smin(d, smax(nasal, 80.0 - q.y, 2.0), 3.0);
    d = smin(d, cone(q, vec3(0.0, 86.0, -29.0), vec3(0.0, 95.0, -26.5), 4.0, 1.2), 3.0);
    // Septum (vomer and the plate of the ethmoid) and turbinates.
    let septum = smax(smax(p.x.abs() - 0.9, (q.y - 57.0).abs() - 24.0, 1.0), (q.z + 4.0).abs() - 24.0, 1.0);
    let lower = ellipsoid(q - vec3(9.5, 62.0, -19.0), vec3(1.6, 20.0, 3.4));
    let middle = ellipsoid(q - vec3(7.0, 58.0, -4.0), vec3(1.4, 18.0, 4.0));
    d = d.min(septum).min(lower).min(middle);

    // Openings.
    d = smax(d, -maxillary_sinus(q), 1.5);
    d = smax(d, -midline_sinuses(p), 1.0);
    d = smax(d, -cone(q, vec3(76.0, -1.0, 1.0), vec3(46.0, 2.0, -1.0), 4.0, 3.0), 2.0);
    d = smax(d, -room, 1.5);
    let foramen = ellipse(vec2(q.x, q.y + 20.0), vec2(15.0, 17.5));
    d = smax(d, -smax(foramen, (q.z + 30.0).abs() - 14.0, 2.0), 2.5);
    // Carotid canal and jugular foramen.
    d = smax(d, -cone(q, vec3(27.0, 2.0, -34.0), vec3(25.0, 8.0, -10.0), 3.4, 3.4), 1.5);
    d = smax(d, -cone(q, vec3(30.0, -8.0, -34.0), vec3(29.0, -14.0, -14.0), 5.0, 5.0), 2.0);
    // 2.5 mm of joint space and soft tissue against the lower jaw, so that it comes free.
    let jaw = mandible(q);
    if jaw < 6.0 {
        d = smax(d, 2.5 - jaw, 1.0);
    }
    d
}

/// The lower jaw.
pub fn mandible(q: Vec3) -> f32 {
    // Far below and in front nothing else is needed: a cheap bound first.
    let bound = rounded_box(q - vec3(0.0, 45.0, -46.0), vec3(60.0, 50.0, 52.0), 5.0);
    if bound > 12.0 {
        return bound;
    }
    // Body: a standing strip along a U in plan, its lower border rising 23° to the angle.
    let plan = ellipse(vec2(q.x, q.y - 10.0), vec2(47.0, 74.0));
    let low = -90.0 + (84.0 - q.y) * 0.40;
    let top = -63.0 + (84.0 - q.y) * 0.13;
    let (mid, half) = ((low + top) * 0.5, (top - low) * 0.5);
    // The strip leans in below the molars.
    let lean = (q.z - mid) * 0.10;
    let s = vec2(plan + 1.0 - lean, (q.z - mid) * 0.93);
    let strip = {
        let e = s.abs() - vec2(5.4, half) + Vec2::splat(4.5);
        e.max(Vec2::ZERO).length() + e.max_element().min(0.0) - 4.5
    };
    let body = smax(strip, 14.0 - q.y, 6.0);
    let chin = ellipsoid(q - vec3(7.0, 83.0, -84.0), vec3(13.0, 6.5, 7.0));
    // Ramus: a plate 32 mm long and 7 mm thick with two processes and the notch between them.
    let plate = rounded_box(turn_x(q - vec3(48.0, 25.0, -42.0), 0.10), vec3(3.2, 15.5, 20.0), 3.0);
    let angle = ellipsoid(q - vec3(47.5, 19.0, -56.0), vec3(4.6, 12.0, 9.0));
    let neck = chain(
        q,
        &[(vec3(48.5, 18.0, -40.0), 4.6), (vec3(49.5, 13.5, -20.0), 3.8), (vec3(50.5, 11.5, -10.5), 4.0)],
        3.0,
    );
    let condyle = cone(q, vec3(44.5, 10.5, -9.3), vec3(56.0, 12.0, -9.6), 4.0, 4.0);
    let coronoid = chain(
        q,
        &[(vec3(48.0, 32.0, -36.0), 4.6), (vec3(48.4, 36.0, -24.0), 3.6), (vec3(49.0, 37.5, -12.5), 1.7)],
        4.0,
    );
    let mut d = smin(body, chin, 7.0);
    d = smin(d, smin(plate, angle, 5.0), 6.0);
    d = smin(d, neck, 6.0);
    d = smin(d, condyle, 3.0);
    smin(d, coronoid, 7.0)
}

/// One tooth, laid out on its dental arch.
pub struct Tooth {
    /// Center of the crown, world mm.
    center: Vec3,
    /// Along the arch, away from the midline.
    along: Vec3,
    /// Toward cheek and lips.
    outward: Vec3,
    /// From the crown to the root.
    rootward: Vec3,
    /// Half of the crown's size along, outward, rootward.
    half: Vec3,
    /// Length of the root from the crown's center.
    root: f32,
    /// 0 incisor, 1 canine, 2 premolar, 3 molar.
    kind: u8,
    /// Whether the crown is the gold one.
    pub gold: bool,
    /// Bounding box, world mm.
    pub bounds: (Vec3, Vec3),
}

/// Crown widths along the arch from the midline, mm, seven teeth (the third molars never came).
const UPPER_WIDTHS: [f32; 7] = [8.6, 6.8, 7.8, 7.1, 6.9, 10.4, 9.8];
const LOWER_WIDTHS: [f32; 7] = [5.4, 6.0, 7.0, 7.1, 7.2, 11.0, 10.5];

/// All 28 teeth. The gold crown is the patient's right upper first premolar.
pub fn teeth() -> Vec<Tooth> {
    let mut teeth = Vec::new();
    for upper in [true, false] {
        let (radii, cy, widths) =
            if upper { (vec2(28.0, 47.0), 44.0, UPPER_WIDTHS) } else { (vec2(25.5, 45.0), 43.5, LOWER_WIDTHS) };
        // Millimeters of arch per radian of the ellipse's parameter.
        let speed = |a: f32| {
            let (s, c) = sin_cos(a);
            vec2(radii.x * s, radii.y * c).length()
        };
        for side in [1.0_f32, -1.0] {
            let mut angle = std::f32::consts::FRAC_PI_2;
            for (i, width) in widths.into_iter().enumerate() {
                // Walk half a tooth, place it, walk the other half.
                let mut walk = |mm: f32| {
                    for _ in 0..16 {
                        angle -= mm / 16.0 / speed(angle);
                    }
                };
                walk(width * 0.5);
                let at = |a: f32| {
                    let (s, c) = sin_cos(a);
                    vec3(side * radii.x * c, cy + radii.y * s, 0.0)
                };
                walk(width * 0.5);
                let half_angle = {
                    // The middle of the tooth, found again from its end.
                    let mut a = angle;
                    for _ in 0..16 {
                        a += width * 0.5 / 16.0 / speed(a);
                    }
                    a
                };
                let tangent = (at(half_angle - 0.01) - at(half_angle + 0.01)).normalize();
                let mut outward = vec3(tangent.y, -tangent.x, 0.0) * side;
                if outward.dot(at(half_angle) - vec3(0.0, cy, 0.0)) < 0.0 {
                    outward = -outward;
                }
                let kind = [0, 0, 1, 2, 2, 3, 3][i];
                let height: f32 = [9.6, 8.8, 10.2, 8.2, 7.6, 7.2, 7.0][i] * if upper { 1.0 } else { 0.92 };
                let thick: f32 = [6.2, 5.8, 7.6, 8.8, 8.8, 10.6, 10.2][i] * if upper { 1.0 } else { 0.92 };
                let root: f32 = [13.5, 13.0, 17.0, 14.0, 14.0, 13.0, 12.5][i] + height * 0.5;
                // The curve of Spee: the row rises toward the molars. Upper front teeth overlap the lower by 2 mm.
                let spee = if i > 2 { (i as f32 - 2.0) * 0.45 } else { 0.0 };
                let edge = if upper {
                    [-54.0, -53.2, -54.2, -52.6, -52.4, -52.2, -52.0][i]
                } else {
                    [-52.2, -52.2, -51.6, -52.8, -52.7, -52.5, -52.4][i]
                } + spee;
                let rootward = if upper { Vec3::Z } else { -Vec3::Z };
                // Front teeth lean outward with their crowns.
                let lean = if kind < 2 { if upper { 0.22 } else { 0.12 } } else { 0.0 };
                let rootward = (rootward - outward * lean).normalize();
                let across = tangent;
                let out = (outward - rootward * outward.dot(rootward)).normalize();
                let z = edge + if upper { height * 0.5 } else { -height * 0.5 };
                let center = at(half_angle) + Vec3::Z * z;
                let half = vec3(width * 0.5 - 0.12, thick * 0.5, height * 0.5);
                let tip = center + rootward * root;
                let reach = Vec3::splat(half.x.max(half.y) + 2.0);
                teeth.push(Tooth {
                    center,
                    along: across,
                    outward: out,
                    rootward,
                    half,
                    root,
                    kind,
                    gold: upper && side > 0.0 && i == 3,
                    bounds: (center.min(tip) - reach, center.max(tip) + reach),
                });
            }
        }
    }
    teeth
}

impl Tooth {
    /// Whether it stands in the mandible.
    pub fn is_lower(&self) -> bool {
        self.rootward.z < 0.0
    }

    /// Distances of crown and root at a world position.
    pub fn distance(&self, p: Vec3) -> (f32, f32) {
        let a = p - self.center;
        let l = vec3(a.dot(self.along), a.dot(self.outward), a.dot(self.rootward));
        let h = self.half;
        // From the edge (-1) to the neck (+1) of the crown.
        let t = (l.z / h.z).clamp(-1.0, 1.0);
        let (wide, thick) = match self.kind {
            // Incisors: a blade that is wide at the edge and thick at the neck.
            0 => (mix(1.0, 0.80, smoothstep(-0.2, 1.0, t)), mix(0.30, 1.0, smoothstep(-1.1, 0.6, t))),
            1 => (
                mix(0.62, 0.80, smoothstep(-1.0, -0.3, t)) + 0.2 * bump(t + 0.15, 0.9),
                mix(0.38, 1.0, smoothstep(-1.1, 0.5, t)),
            ),
            _ => (mix(1.0, 0.84, smoothstep(-0.2, 1.0, t)), mix(0.90, 0.88, t) + 0.1 * bump(t, 1.0)),
        };
        let size = vec3(h.x * wide, h.y * thick, h.z);
        let round = (size.x.min(size.y) * 0.75).min(3.2);
        let mut crown = rounded_box(l, size, round);
        if self.kind >= 2 {
            // Cusps: the chewing surface is grooved along the row and, on molars, across it.
            let across = if self.kind == 3 { bump(l.x, 1.6) } else { 0.0 };
            let groove = 1.3 * bump(l.y, 2.2).max(across);
            crown = smax(crown, -(l.z + h.z - groove), 0.8);
        }
        let neck = h.z * 0.7;
        let root = if self.kind == 3 {
            let m = vec3(l.x.abs(), l.y, l.z);
            cone(m, vec3(h.x * 0.35, 0.0, neck), vec3(h.x * 0.55, 0.0, self.root), h.x * 0.5, 1.1)
        } else {
            cone(l * vec3(1.0, 0.85, 1.0), vec3(0.0, 0.0, neck), vec3(0.0, 0.0, self.root), h.x.min(h.y) * 0.78, 1.0)
        };
        (crown, root)
    }
}

/// The canal of the spinal cord, from the foramen magnum down.
pub fn spinal_canal(q: Vec3) -> f32 {
    cone(q, vec3(0.0, -21.0, -32.0), vec3(0.0, -20.0, -140.0), 10.0, 8.5)
}

/// The upper cervical spine: atlas, axis with its dens, C3 and C4.
pub fn vertebrae(q: Vec3) -> f32 {
    let bound = rounded_box(q - vec3(0.0, -20.0, -80.0), vec3(42.0, 45.0, 50.0), 5.0);
    if bound > 12.0 {
        return bound;
    }
    let canal = spinal_canal(q);
    // Atlas: a ring with two lateral masses and long transverse processes.
    let a = q - vec3(0.0, -18.0, -41.0);
    let flat = vec2(ellipse(vec2(a.x, a.y), vec2(20.0, 20.0)), a.z * 0.9);
    let ring = flat.length() - 3.6;
    let mass = ellipsoid(a - vec3(18.0, 4.0, 1.0), vec3(6.5, 10.0, 6.5));
    let transverse = cone(a, vec3(20.0, 2.0, 0.0), vec3(37.0, 0.0, -1.0), 4.0, 3.6);
    let mut d = smin(smin(ring, mass, 3.0), transverse, 3.0);
    // Axis: the dens stands up into the ring, in front of the cord.
    let dens = cone(q, vec3(0.0, -4.5, -60.0), vec3(0.0, -5.5, -37.0), 6.0, 4.2);
    let dens = smax(dens, -(flat.length() - 5.2), 1.0);
    let level = |z: f32, y: f32, size: f32| {
        let v = q - vec3(0.0, y, z);
        let body = smax(ellipse(vec2(v.x, v.y), vec2(10.5, 8.0) * size), v.z.abs() - 6.2, 3.0);
        let pillar =
            smax(ellipse(vec2(v.x - 17.0, v.y + 11.0), vec2(6.0, 7.0)), (v.z + 0.5 * (v.y + 11.0)).abs() - 6.8, 3.0);
        let pedicle = cone(v, vec3(9.0, -3.0, 1.0), vec3(16.0, -11.0, 0.0), 3.2, 3.4);
        let process = cone(v, vec3(10.0, 1.0, -1.0), vec3(24.0, -2.0, -3.0), 3.0, 3.0);
        let lamina = cone(v, vec3(15.0, -15.0, 0.0), vec3(1.0, -30.5, -3.0), 3.8, 3.8);
        let spine = cone(v, vec3(0.0, -30.0, -3.0), vec3(2.5, -29.0 - 15.0 * size, -10.0), 3.8, 2.8);
        smin(smin(smin(body, pillar, 2.0), smin(pedicle, process, 2.0), 2.0), smin(lamina, spine, 2.0), 2.0)
    };
    d = d
        .min(smin(dens, level(-64.0, -3.0, 1.05), 3.0))
        .min(level(-84.5, -1.0, 0.85))
        .min(level(-104.0, 0.0, 0.9))
        .min(level(-123.0, 0.0, 0.95));
    // Vertebral artery canals.
    d = smax(d, -cone(q, vec3(19.5, -2.0, -130.0), vec3(19.5, -3.0, -60.0), 2.4, 2.4), 1.0);
    smax(d, -canal, 1.5)
}

/// The hyoid bone, the horseshoe above the larynx.
pub fn hyoid(q: Vec3) -> f32 {
    chain(q, &[(vec3(0.0, 42.0, -101.0), 4.0), (vec3(12.0, 37.0, -100.0), 3.0), (vec3(19.0, 18.0, -96.0), 1.8)], 2.0)
}
