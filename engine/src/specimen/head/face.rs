//! The outside of the head: skin, face, ears and neck; muscles, cartilages and airways.
//!
//! The skin is modeled as a sculptor does: large masses first, blended over centimeters, then features added
//! and cut with small fillets. Functions take `q`, the position with x mirrored to the positive side, unless
//! they say `p`.

use std::sync::LazyLock;

use glam::{Vec3, vec2, vec3};

use super::skull;
use crate::specimen::sdf::*;

/// Beyond this distance from its bounding sphere a feature is replaced by that bound, mm.
const FAR_MM: f32 = 12.0;

/// Center of the eyeball.
pub const EYE: Vec3 = vec3(32.0, 72.5, 15.0);

/// Radius of the eyeball, mm.
pub const EYE_RADIUS: f32 = 12.0;

/// Outer surface of the skin. `p` is in world mm: the nevus of the left cheek (x < 0) is part of it.
pub fn skin(p: Vec3) -> f32 {
    let d = skin_without_nevus(p);
    let nevus = p - *NEVUS;
    if nevus.length_squared() < 64.0 { smin(d, ellipsoid(nevus, vec3(3.1, 2.7, 3.1)), 1.4) } else { d }
}

/// The skin as it would be on both sides.
pub fn skin_without_nevus(p: Vec3) -> f32 {
    let q = vec3(p.x.abs(), p.y, p.z);
    // Scalp: 6 mm over the vault, 5 on the forehead.
    let mut d = skull::vault(q) - 6.0;
    d = smin(d, neck(q), 16.0);
    // Occiput and the muscles below it.
    d = smin(d, ellipsoid(q - vec3(0.0, -51.0, -12.0), vec3(57.0, 44.0, 42.0)), 20.0);

    // Middle and lower face.
    let midface = ellipsoid(q - vec3(0.0, 26.0, -12.0), vec3(63.0, 65.0, 66.0));
    let muzzle = ellipsoid(q - vec3(0.0, 56.0, -52.0), vec3(38.0, 40.0, 34.0));
    let chin = ellipsoid(q - vec3(0.0, 80.0, -82.0), vec3(19.0, 15.5, 13.0));
    let jaw = chain(
        q,
        &[
            (vec3(16.0, 78.0, -80.0), 13.0),
            (vec3(40.0, 42.0, -66.0), 13.0),
            (vec3(49.0, 17.0, -53.0), 13.0),
            (vec3(55.0, 6.0, -15.0), 13.0),
        ],
        8.0,
    );
    let floor = ellipsoid(q - vec3(0.0, 40.0, -66.0), vec3(36.0, 44.0, 22.0));
    d = smin(d, midface, 26.0);
    d = smin(d, muzzle, 20.0);
    d = smin(d, smin(jaw, floor, 16.0), 14.0);
    d = smin(d, chin, 14.0);
    // Cheekbone and its arch.
    d = smin(d, ellipsoid(turn_z(q - vec3(45.0, 63.0, -9.0), -0.7), vec3(17.0, 12.0, 13.0)), 16.0);
    let arch = chain(
        q,
        &[
            (vec3(50.0, 63.0, -7.0), 9.0),
            (vec3(61.5, 45.0, -8.0), 7.5),
            (vec3(64.5, 28.0, -6.0), 7.0),
            (vec3(63.0, 4.0, 1.0), 8.0),
        ],
        6.0,
    );
    d = smin(d, arch, 18.0);
    // Outer rim of the orbit and the temporalis behind it.
    d = smin(
        d,
        chain(q, &[(vec3(50.0, 62.0, -4.0), 8.0), (vec3(51.0, 62.0, 14.0), 7.2), (vec3(49.0, 68.0, 30.0), 8.0)], 5.0),
        12.0,
    );
    d = smin(d, ellipsoid(q - vec3(52.0, 34.0, 22.0), vec3(17.0, 32.0, 32.0)), 16.0);
    // Cheek pad.
    d = smin(d, ellipsoid(q - vec3(37.0, 66.0, -34.0), vec3(17.0, 17.0, 24.0)), 18.0);
    // Brow: ridge from the glabella to the outer corner.
    let brow =
        chain(q, &[(vec3(0.0, 87.5, 30.0), 7.0), (vec3(26.0, 86.5, 34.0), 7.0), (vec3(46.0, 74.0, 31.0), 7.0)], 6.0);
    d = smin(d, brow, 12.0);
    if p.y > 45.0 {
        d = features(q, d);
    }
    d = ear_onto(q, d);
    d
}

/// Eyes, nose, mouth and the small relief of the face, worked into the mass `d`.
fn features(q: Vec3, mut d: f32) -> f32 {
    // Eye sockets and lids.
    let e = q - EYE;
    if e.length() < 34.0 + FAR_MM {
        let socket = ellipsoid(q - vec3(32.5, 95.0, 15.0), vec3(18.0, 13.5, 12.0));
        d = smax(d, -socket, 13.0);
        // Toward the nose the socket is deepest.
        d = smax(d, -ellipsoid(q - vec3(18.5, 94.0, 17.5), vec3(5.5, 7.0, 7.0)), 9.0);
        let along = e.x / 15.5;
        // The closed fissure: an arc below the middle of the globe, its outer corner a little higher.
        let fissure = -5.6 + 4.0 * along * along + 1.0 * along;
        let below = e.z - fissure;
        // The upper lid laps over the lower one by half a millimeter.
        let lap = 0.55 * smoothstep(-0.5, 0.7, below) * smoothstep(9.0, 2.0, below);
        let lids = ellipsoid(e - vec3(0.0, 0.4, 0.4), vec3(16.4, 14.4, 13.6)) - lap;
        d = smin(d, lids, 8.0);
        if e.y > 0.0 {
            // Lines are drawn on the surface as it is here: tubes along it, half sunk in.
            let lash = vec2(below, d).length();
            let fold = vec2(e.z - (7.8 - 5.4 * along * along + 0.8 * along), d).length();
            d = smax(d, mix(-1.0, 1.05, smoothstep(1.08, 0.85, along.abs())) - lash, 1.0);
            // Upper crease, where the lid folds back under the brow.
            d = smax(d, mix(-2.4, 0.35, smoothstep(1.0, 0.45, along.abs())) - fold, 2.4);
        }
    }
    // Nose.
    if (q - vec3(0.0, 104.0, -8.0)).length() < 44.0 + FAR_MM {
        d = nose(q, d);
    }
    // Mouth.
    if (q - vec3(0.0, 96.0, -52.0)).length() < 38.0 + FAR_MM {
        d = mouth(q, d);
    }
    // Crease from the wing of the nose past the corner of the mouth.
    let fold = chain(
        q,
        &[(vec3(20.0, 98.0, -20.0), 0.4), (vec3(28.0, 93.0, -36.0), 0.6), (vec3(34.5, 86.0, -52.0), -1.2)],
        2.0,
    );
    d = smax(d, -fold, 8.0);
    d
}

/// The nevus, a bump 6 mm across on the patient's LEFT cheek (x < 0): where it sits on the skin, world mm.
static NEVUS: LazyLock<Vec3> = LazyLock::new(|| {
    let mut at = vec3(-37.0, 110.0, -27.0);
    for _ in 0..40 {
        at.y -= 0.7 * skin_without_nevus(at);
    }
    at
});

fn nose(q: Vec3, mut d: f32) -> f32 {
    let s = vec3(q.x * 0.86, q.y, q.z);
    let bridge =
        chain(s, &[(vec3(0.0, 85.5, 25.0), 7.0), (vec3(0.0, 97.0, 6.0), 7.0), (vec3(0.0, 107.5, -11.0), 7.5)], 8.0);
    d = smin(d, bridge, 10.0);
    let tip = ellipsoid(q - vec3(2.0, 110.0, -16.0), vec3(7.6, 8.5, 7.4));
    d = smin(d, tip, 6.0);
    // Base and wings.
    d = smin(d, ellipsoid(q - vec3(0.0, 100.0, -17.0), vec3(12.0, 11.0, 9.0)), 6.0);
    let wing = ellipsoid(turn_z(q - vec3(11.0, 100.5, -20.6), 0.35), vec3(5.8, 9.8, 6.6));
    d = smin(d, wing, 6.5);
    // Groove above and behind the wing.
    let groove = chain(
        q,
        &[(vec3(13.5, 111.0, -12.5), 0.4), (vec3(19.5, 102.5, -13.0), 0.8), (vec3(20.5, 95.0, -22.0), 0.8)],
        3.0,
    );
    d = smax(d, -groove, 4.0);
    // Columella.
    d = smin(d, cone(q, vec3(0.0, 110.0, -21.0), vec3(0.0, 99.0, -27.0), 3.2, 4.0), 4.0);
    // Nostrils lead up and back into the cavity.
    let nostril =
        chain(q, &[(vec3(7.4, 105.0, -30.0), 2.6), (vec3(7.0, 103.0, -24.5), 3.2), (vec3(5.0, 98.0, -19.0), 2.6)], 2.0);
    smax(d, -nostril, 1.8)
}

/// Depth of the line between the lips at a distance from the midline: the arc they follow, mm of y.
fn lip_arc(x: f32) -> f32 {
    0.0105 * x * x + 0.0000065 * x * x * x * x
}

fn mouth(q: Vec3, mut d: f32) -> f32 {
    // The lips sit on the curve of the teeth.
    d = smin(d, ellipsoid(q - vec3(0.0, 80.0, -49.0), vec3(27.0, 20.5, 17.0)), 10.0);
    // Straighten the arc of the lips: l.y counts from the line between them.
    let x = q.x;
    let l = vec3(x, q.y - 98.6 + lip_arc(x), q.z + 52.5);
    let corner = 26.0;
    let taper = smoothstep(corner, 6.0, x);
    let fade = smoothstep(corner + 2.0, corner - 8.0, x);
    // Philtrum.
    let philtrum = cone(q, vec3(0.0, 107.5, -29.5), vec3(0.0, 107.8, -42.5), 2.2, 3.0);
    d = smax(d, -philtrum, 4.0);
    // Upper lip: cupid's bow lifts it at 5 mm from the midline and dips in the middle.
    let bow = 2.2 * bump(x - 6.0, 9.0) - 0.8 * bump(x, 5.0);
    let upper = vec2(l.y - 1.0, (l.z - 3.2 * taper - bow * 0.7) * mix(1.7, 1.0, taper)).length() - mix(2.0, 5.0, taper);
    let lower = vec2(l.y - 0.4, (l.z + 4.4 * taper + 0.6) * mix(1.6, 0.86, taper)).length()
        - mix(2.0, 5.6, smoothstep(corner, 4.0, x));
    let end = x - corner;
    d = smin(d, smax(upper, end, 4.0), 4.0);
    d = smin(d, smax(lower, end + 1.5, 4.0), 4.5);
    // The line between the lips: slightly waved.
    let line_z = 0.9 * bump(x - 5.0, 7.0) - 0.5 - 0.0016 * x * x;
    let slit = (l.z - line_z).abs();
    let slit = smax(slit - 0.45 * fade - 0.1, (2.2 - l.y).max(end), 1.0);
    d = smax(d, -slit, 1.6);
    // Corners are drawn in.
    d = smax(d, -ellipsoid(q - vec3(corner + 1.5, 95.0, -53.0), vec3(2.6, 3.0, 2.6)), 4.0);
    // Groove between lower lip and chin.
    let sulcus = cone(q, vec3(0.0, 105.0, -69.0), vec3(14.0, 102.0, -67.5), 4.0, 2.5);
    smax(d, -sulcus, 8.0)
}

/// Neck: a leaning column with the two sternocleidomastoids and the larynx.
fn neck(q: Vec3) -> f32 {
    let t = smoothstep(-40.0, -130.0, q.z);
    let center = mix(-18.0, -12.0, t);
    let column = ellipse(vec2(q.x, q.y - center), vec2(mix(49.0, 52.0, t), mix(53.0, 55.0, t))) * 0.95;
    let column = smax(column, q.z + 25.0, 20.0);
    let cord = cone(q, vec3(55.0, -12.0, -25.0), vec3(24.0, 37.0, -135.0), 9.0, 8.5);
    let larynx = ellipsoid(q - vec3(0.0, 40.0, -122.0), vec3(13.0, 14.0, 18.0));
    smin(smin(column, cord, 10.0), larynx, 14.0)
}

/// Center of the outer ear's bounding sphere and its radius, mm.
const EAR: (Vec3, f32) = (vec3(76.0, -10.0, 3.0), 44.0);

/// Position in the frame of the auricle: x backward along it, y up along it, z out of its face.
/// The auricle leans back by 12° and stands off the head by 22°.
fn ear_frame(q: Vec3) -> Vec3 {
    let a = turn_x(q - vec3(70.5, -1.0, 1.0), 0.21);
    let (s, c) = sin_cos(0.38);
    // Backward direction leaves the head: (sin, -cos).
    vec3(a.x * s - a.y * c, a.z, a.x * c + a.y * s)
}

/// The rolled rim of the auricle, from its root in the concha over the top and down to the lobule (ear frame).
static HELIX: LazyLock<Vec<(Vec3, f32)>> = LazyLock::new(|| {
    spline(
        &[
            (vec3(6.0, 2.0, -4.0), 1.6),
            (vec3(0.5, 7.5, 0.5), 2.0),
            (vec3(-1.0, 17.0, 2.0), 2.4),
            (vec3(3.5, 26.5, 2.2), 2.6),
            (vec3(12.0, 31.0, 2.0), 2.7),
            (vec3(21.0, 28.0, 1.8), 2.6),
            (vec3(27.5, 19.0, 1.4), 2.4),
            (vec3(28.5, 8.0, 1.0), 2.2),
            (vec3(25.0, -3.0, 0.6), 2.0),
            (vec3(19.0, -13.0, 0.0), 2.0),
        ],
        4,
    )
});

/// The cartilage-backed shape of the auricle.
pub fn ear(q: Vec3) -> f32 {
    let l = ear_frame(q);
    let outline = {
        let upper = ellipse(vec2(l.x - 13.0, l.y - 11.0), vec2(17.0, 20.5));
        let lower = ellipse(vec2(l.x - 8.0, l.y + 12.0), vec2(10.5, 17.0));
        smin(upper, lower, 12.0)
    };
    // The sheet: dished at the concha, rising to the antihelix, falling to the scapha.
    let r = vec2((l.x - 7.5) / 9.5, (l.y - 0.5) / 12.5).length();
    let dish = -8.0 * smoothstep(1.05, 0.35, r);
    let sheet = smax(outline, ((l.z - dish) * 0.75).abs() - 1.7, 2.5);
    let helix = tube(l, &HELIX);
    let lobule = ellipsoid(l - vec3(7.5, -22.0, -0.5), vec3(9.0, 9.0, 3.2));
    let antihelix = chain(
        l,
        &[
            (vec3(11.0, -11.0, 0.5), 2.4),
            (vec3(18.0, -3.0, 1.0), 2.4),
            (vec3(19.0, 8.0, 1.2), 2.5),
            (vec3(16.0, 16.0, 0.8), 2.2),
            (vec3(10.0, 23.0, 0.0), 1.6),
        ],
        2.0,
    );
    let crus = cone(l, vec3(17.0, 14.0, 0.8), vec3(5.0, 15.5, 0.0), 2.2, 1.2);
    let tragus = ellipsoid(l - vec3(-1.0, -2.0, 0.5), vec3(3.4, 5.0, 3.0));
    let antitragus = ellipsoid(l - vec3(8.0, -12.5, 0.8), vec3(4.0, 2.6, 2.6));
    let mut d = smin(sheet, helix, 2.0);
    d = smin(d, lobule, 5.0);
    d = smin(d, smin(antihelix, crus, 3.0), 3.0);
    smin(d, tragus.min(antitragus), 3.0)
}

fn ear_onto(q: Vec3, d: f32) -> f32 {
    let bound = (q - EAR.0).length() - EAR.1;
    if bound > FAR_MM {
        return d.min(bound);
    }
    let d = smin(d, ear(q), 5.0);
    smax(d, -ear_canal(q), 2.0)
}

/// The auditory canal, open to the concha.
pub fn ear_canal(q: Vec3) -> f32 {
    cone(q, vec3(76.0, -4.0, 1.0), vec3(50.0, 1.0, -0.5), 3.4, 2.6)
}

/// Cartilage: septum and tip of the nose, auricle, thyroid cartilage.
pub fn cartilage(q: Vec3) -> f32 {
    let septum = smax(q.x - 1.0, smax((q.y - 98.0).abs() - 11.0, (q.z + 9.0).abs() - 14.0, 2.0), 0.5);
    let septum = smax(septum, (vec2(q.y - 84.0, q.z - 22.0).dot(vec2(0.80, 0.60)) - 14.0).max(-27.0 - q.z), 1.0);
    let alar = ellipsoid(q - vec3(4.5, 108.0, -16.5), vec3(5.0, 5.5, 4.5));
    let nose = smax(septum.min(alar), 84.0 - q.y, 1.0);
    let thyroid = smax(
        (ellipse(vec2(q.x, q.y - 22.0), vec2(17.0, 24.0))).abs() - 1.8,
        smax((q.z + 121.0).abs() - 11.0, 18.0 - q.y, 1.0),
        1.0,
    );
    let mut d = nose.min(thyroid);
    if (q - EAR.0).length() < EAR.1 {
        d = d.min(ear(q) + 1.3);
    }
    d
}

/// Air inside the head: nose, sinuses, throat, windpipe, the slit of the mouth, ear canals. `p` in world mm and
/// its distance from the skin, which only nostrils and ear canals pierce.
pub fn airways(p: Vec3, skin: f32) -> f32 {
    let q = vec3(p.x.abs(), p.y, p.z);
    // A millimeter of mucosa lines the bone; it also covers septum and turbinates.
    let nasal = skull::nasal_cavity(q) + 1.2;
    let septum = smax(p.x.abs() - 2.0, q.y - 110.0, 1.0);
    let lower = ellipsoid(q - vec3(9.5, 62.0, -19.0), vec3(2.8, 22.0, 5.0));
    let middle = ellipsoid(q - vec3(7.0, 58.0, -4.0), vec3(2.6, 20.0, 5.4));
    let nasal = smax(nasal, -(septum.min(lower).min(middle)), 1.0);
    let vestibule = chain(
        q,
        &[
            (vec3(7.4, 105.0, -31.0), 2.4),
            (vec3(7.0, 103.0, -24.5), 3.0),
            (vec3(5.0, 97.0, -18.0), 2.8),
            (vec3(5.0, 84.0, -14.0), 3.6),
        ],
        3.0,
    );
    let sinuses = (skull::maxillary_sinus(q) + 1.0).min(skull::midline_sinuses(p) + 0.6);
    let flat = vec3(q.x * 0.62, q.y, q.z);
    let throat = chain(
        flat,
        &[
            (vec3(0.0, 34.0, -8.0), 6.5),
            (vec3(0.0, 19.0, -26.0), 6.0),
            (vec3(0.0, 15.0, -60.0), 5.0),
            (vec3(0.0, 20.0, -95.0), 6.0),
            (vec3(0.0, 22.0, -135.0), 7.0),
        ],
        6.0,
    );
    // A film of air above the tongue.
    let tongue = ellipsoid(q - vec3(0.0, 52.0, -58.0), vec3(23.0, 37.0, 21.0));
    let mouth = smax((tongue - 1.2).abs() - 1.2, smax(-45.0 - q.z, q.x - 19.0, 2.0), 1.0);
    smax(nasal.min(sinuses).min(throat).min(mouth), skin + 4.0, 2.0).min(vestibule).min(ear_canal(q))
}

/// Muscles with a surface of their own, before the fat between them.
pub fn muscles(q: Vec3) -> f32 {
    let masseter = chain(
        q,
        &[(vec3(58.0, 50.0, -12.0), 7.0), (vec3(56.0, 34.0, -34.0), 8.0), (vec3(53.0, 19.0, -56.0), 7.0)],
        5.0,
    );
    // Temporalis: fans over the side of the vault and dives under the arch to the coronoid.
    let fan = smax(skull::vault(q) - 5.0, ellipsoid(q - vec3(66.0, 22.0, 30.0), vec3(26.0, 52.0, 48.0)), 4.0);
    let dive = cone(q, vec3(55.0, 38.0, 16.0), vec3(50.0, 36.0, -14.0), 9.0, 6.0);
    let cord = cone(q, vec3(54.0, -12.0, -26.0), vec3(23.0, 33.0, -135.0), 9.0, 8.5);
    let nape = ellipse(vec2(q.x - 22.0, q.y + 42.0), vec2(24.0, 21.0));
    let nape = smax(nape, q.z + 12.0, 8.0);
    let deep = smax(ellipse(vec2(q.x - 22.0, q.y + 5.0), vec2(24.0, 18.0)), q.z + 32.0, 6.0);
    let tongue = ellipsoid(q - vec3(0.0, 52.0, -58.0), vec3(23.0, 37.0, 21.0));
    let floor = smax(ellipsoid(q - vec3(0.0, 42.0, -80.0), vec3(32.0, 40.0, 12.0)), -98.0 - q.z, 3.0);
    let pterygoid = cone(q, vec3(20.0, 33.0, -14.0), vec3(43.0, 20.0, -50.0), 7.0, 6.0);
    let lips = smax(ellipse(vec2(q.x, q.y - 50.0), vec2(33.0, 50.0)).abs() - 3.4, (q.z + 52.0).abs() - 15.0, 3.0);
    let lips = smax(lips, 60.0 - q.y, 6.0);
    masseter.min(fan).min(dive).min(cord).min(nape).min(deep).min(tongue).min(floor).min(pterygoid).min(lips)
}

/// The four straight muscles of the eye.
pub fn eye_muscles(q: Vec3) -> f32 {
    let apex = vec3(14.5, 34.0, 18.5);
    [vec3(10.5, 0.0, 0.0), vec3(-10.5, 0.0, 0.0), vec3(0.0, 0.0, 10.5), vec3(0.0, 0.0, -10.5)]
        .into_iter()
        .map(|side| {
            let belly = EYE + side * 1.12 + vec3(0.0, -10.0, 0.0);
            chain(q, &[(apex + side * 0.28, 1.6), (belly, 2.5), (EYE + side * 1.18 + vec3(0.0, 2.0, 0.0), 1.1)], 2.0)
        })
        .fold(f32::MAX, f32::min)
}
