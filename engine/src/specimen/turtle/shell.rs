//! The shell: carapace and plastron of bone, joined by the bridges, under horny scutes.

use std::f32::consts::PI;

use glam::{Vec3, vec2, vec3};

use crate::specimen::sdf::*;

/// Half axes of the carapace's dome, mm. Its rim lies in the plane z = 0.
pub const DOME: Vec3 = vec3(71.0, 98.0, 57.0);
/// Thickness of the wall of the shell, horn included, mm.
pub const WALL_MM: f32 = 6.5;
/// Thickness of the scutes, mm.
pub const HORN_MM: f32 = 1.8;
/// The plane of the belly.
const BELLY_Z: f32 = -24.0;

/// What is farther away than any blur reaches.
const FAR: f32 = 1e3;

/// The shell is a little wider behind.
fn widened(p: Vec3) -> Vec3 {
    vec3(p.x / (1.0 - 0.0008 * p.y.clamp(-110.0, 110.0)), p.y, p.z)
}

/// The upper half of the body, without relief.
fn dome(p: Vec3) -> f32 {
    ellipsoid(widened(p), DOME)
}

/// The lower half: a flat belly with rounded sides.
fn keel(p: Vec3) -> f32 {
    smax(ellipsoid(widened(p), vec3(DOME.x, DOME.y, 36.0)), BELLY_Z - p.z, 14.0)
}

/// What the shell encloses, itself included: the smooth hull of the trunk.
pub fn hull(p: Vec3) -> f32 {
    if p.z > 0.0 { dome(p) } else { keel(p) }
}

/// Where the vertebral scutes meet the costal ones, as the sine of the angle to the side, over the sine of the angle
/// to the front: a zigzag, so that both are hexagons.
const ZIGZAG: [(f32, f32); 9] = [
    (-0.97, 0.74),
    (-0.70, 0.30),
    (-0.48, 0.46),
    (-0.25, 0.32),
    (-0.02, 0.48),
    (0.22, 0.32),
    (0.45, 0.46),
    (0.67, 0.31),
    (0.95, 0.72),
];

/// Sine of the elevation at which the marginal scutes end.
const MARGINAL: f32 = 0.27;
/// Marginal scutes on either side, and half the width of the nuchal scute between them in front, radians.
const NUM_MARGINALS: f32 = 11.0;
const NUCHAL: f32 = 0.085;

fn zigzag(y: f32) -> f32 {
    let i = ZIGZAG[1..8].iter().position(|k| y < k.0).unwrap_or(7);
    let ((y0, s0), (y1, s1)) = (ZIGZAG[i], ZIGZAG[i + 1]);
    mix(s0, s1, ((y - y0) / (y1 - y0)).clamp(0.0, 1.0))
}

/// How far the scutes' surface stands above the smooth dome: every scute a low pyramid with rings of growth and a
/// groove around it, under a flaring rim whose marginals stand apart like teeth behind.
fn relief(p: Vec3) -> f32 {
    let n = (widened(p) / DOME).normalize_or(Vec3::Z);
    let x = n.x.abs();
    let ring = (1.0 - n.y * n.y).max(1e-4).sqrt();
    let flat = (1.0 - n.z * n.z).max(1e-4).sqrt();
    // The angle from the front along the rim, in marginals.
    let around = acos((n.y / flat).clamp(-1.0, 1.0));
    let count = (around - NUCHAL) * (NUM_MARGINALS / (PI - NUCHAL));
    let part = if count < 0.0 { 0.5 } else { count - count.floor() };
    let to_marginal = (n.z - MARGINAL) * 62.0 / flat;
    let border = if to_marginal < 0.0 {
        let nearest = if count < 0.0 { -count } else { part.min(1.0 - part) };
        (-to_marginal).min(nearest * 23.0 * flat)
    } else {
        let cos = (n.z / ring).max(0.35);
        let to_vertebral = (x / ring - zigzag(n.y)) * 62.0 * ring / cos;
        // Odd knots are borders between vertebrals, even ones between costals.
        let first = if to_vertebral < 0.0 { 1 } else { 2 };
        let across = ZIGZAG[1..8].iter().skip(first - 1).step_by(2).map(|k| (n.y - k.0).abs()).fold(1.0, f32::min);
        to_marginal.min(to_vertebral.abs() * 0.9).min(across * 84.0 / ring)
    };
    let is_marginal = to_marginal < 0.0;
    let pyramid = if is_marginal { 1.0 } else { 3.6 } * smoothstep(0.0, if is_marginal { 6.0 } else { 17.0 }, border);
    let turn = border / 4.4;
    let turn = turn - turn.floor();
    let rings =
        0.42 * (4.0 * turn * (1.0 - turn) - 1.0) * smoothstep(2.0, 5.0, border) * smoothstep(20.0, 12.0, border);
    let groove = -1.8 * bump(border, 3.0);
    let ridge = 1.6 * bump(n.x, 0.10) * smoothstep(0.3, 0.6, n.z);
    // The rim flares, most of all behind; there each marginal ends in a point.
    let behind = smoothstep(1.5, 2.6, around);
    let low = smoothstep(0.36, -0.05, n.z);
    let flare = low * low * (4.5 + 5.0 * behind + 1.5 * behind * (4.0 * part * (1.0 - part) - 0.5));
    pyramid + rings + groove + ridge + flare
}

/// A healed bite in the rim behind, on the RIGHT.
fn notch(p: Vec3) -> f32 {
    (p - vec3(67.0, -62.0, -2.0)).length() - 9.0
}

/// The carapace: (the horn and bone, the bone alone).
pub fn carapace(p: Vec3) -> (f32, f32) {
    let smooth = dome(p);
    if !(-16.0..=14.0).contains(&smooth) || p.z < -14.0 {
        return (FAR, FAR);
    }
    let outer = (smooth - relief(p)) * 0.88;
    let inner = smooth + WALL_MM;
    // The edge rises over neck and tail.
    let edge = -5.0 + 8.0 * smoothstep(62.0, 98.0, p.y) + 5.0 * smoothstep(-70.0, -98.0, p.y);
    let wall = smax(smax(outer, -inner, 1.5), edge - p.z, 4.0);
    let wall = smax(wall, -notch(p), 2.0);
    (wall, smax(smax(wall, outer + HORN_MM, 1.0), -notch(p) - HORN_MM, 1.0))
}

/// Where the lower wall is bone: the plate under the belly and the two bridges; elsewhere limbs, neck and tail
/// come out.
fn plate(p: Vec3) -> f32 {
    let front = smoothstep(40.0, 88.0, p.y);
    let outline = ellipse(vec2(p.x, p.y), vec2(mix(49.0, 46.0, front), 88.0));
    let outline = smax(outline, -((p.truncate() - vec2(0.0, -97.0)).length() - 15.0), 5.0);
    smin(outline, p.y.abs() - 31.0, 18.0)
}

/// The plastron with its bridges: (horn and bone, bone alone).
pub fn plastron(p: Vec3) -> (f32, f32) {
    let smooth = keel(p);
    if p.z > 14.0 || !(-14.0..=10.0).contains(&smooth) {
        return (FAR, FAR);
    }
    // A seam that wanders along the middle, and five across.
    let mut border = (p.x + 2.2 * noise(vec3(0.0, p.y * 0.05, 0.5), 31)).abs();
    let side = p.x.abs();
    for (y, slope) in [(62.0, 0.55), (35.0, -0.12), (6.0, -0.06), (-27.0, 0.06), (-55.0, -0.38)] {
        border = border.min((p.y - y + slope * side).abs());
    }
    // And those along the bridges.
    let bridge = vec2(side - 47.0 - 0.003 * p.y * p.y, 0.0).length();
    border = border.min(bridge.max(p.y.abs() - 36.0));
    let turn = border / 4.4;
    let turn = turn - turn.floor();
    let rings = 0.25 * (4.0 * turn * (1.0 - turn) - 1.0) * smoothstep(1.5, 4.0, border) * smoothstep(16.0, 9.0, border);
    let outer = smooth - rings + 1.4 * bump(border, 2.8);
    let wall = smax(outer, -smooth - 5.5, 1.5);
    let wall = smax(smax(wall, plate(p), 3.0), p.z - 3.0, 2.0);
    (wall, smax(wall, outer + HORN_MM, 1.0))
}

/// The room within the bones, for what lies inside.
pub fn room(p: Vec3) -> f32 {
    hull(p) + WALL_MM
}

/// The depth below the carapace's inner face of a point under it (0 at the face, negative in the room).
pub fn under_dome(p: Vec3) -> f32 {
    dome(p) + WALL_MM
}

/// The point on the midline `depth` mm below the inner face of the carapace.
pub fn below_ridge(y: f32, depth: f32) -> Vec3 {
    let t = (y / (DOME.y - WALL_MM)).clamp(-0.98, 0.98);
    vec3(0.0, y, (DOME.z - WALL_MM) * (1.0 - t * t).sqrt() - depth)
}
