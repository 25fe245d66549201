//! What moves in the head: valves with their springs, camshafts and spark plugs.

use glam::{Vec3, vec2, vec3};

use super::material::*;
use super::{DECK, HALF_LENGTH, Part, cylinder, disc_z, turned};
use crate::specimen::painter::Paint;
use crate::specimen::sdf::*;

/// Axes of the camshafts.
pub const CAM_X: f32 = 32.0;
pub const CAM_Z: f32 = 222.0;

/// Sine and cosine of the valves' lean.
const LEAN: (f32, f32) = (0.2588, 0.9659);
/// Where the valve's axis meets the deck.
const FOOT_X: f32 = 13.0;
/// The two valves of a kind in a cylinder stand this far before and behind its axis.
const APART: f32 = 12.6;

/// The valve's frame on either side: z up along the stem from the deck, x away from the middle.
fn frame(l: Vec3) -> Vec3 {
    let (s, c) = LEAN;
    let (x, z) = (l.x.abs() - FOOT_X, l.z - DECK);
    vec3(x * c - z * s, l.y.abs() - APART, x * s + z * c)
}

/// Distance from the axis of the valves' guides.
pub fn guide_bound(l: Vec3) -> f32 {
    let v = frame(l);
    vec2(v.x, v.y).length()
}

/// How far a valve is open, mm: in each cylinder another stroke.
fn lift(i: usize, exhaust: bool) -> f32 {
    match (i, exhaust) {
        (1, false) => 7.0,
        (2, true) => 6.0,
        _ => 0.0,
    }
}

/// The lobe's direction in turns from above: it points at the tappet of an open valve.
fn lobe(i: usize, exhaust: bool) -> f32 {
    if lift(i, exhaust) > 0.0 { 0.75 } else { [0.12, 0.0, 0.38, 0.20][i] + if exhaust { 0.07 } else { 0.0 } }
}

/// What is worked into the head's casting `d`: guides and seats, wells of plugs and tappets, towers of the camshafts.
pub fn head_work(p: Vec3, l: Vec3, d: f32) -> f32 {
    let v = frame(l);
    let round = vec2(v.x, v.y).length();
    // Guides stand up from the floor; tappets slide in cups.
    let guide = smax(round - 6.4, (v.z - 36.0).abs() - 14.0, 1.0);
    let mut d = smin(d, guide, 2.0);
    // Towers with the bearings of the camshafts, between the cylinders.
    let between = (l.y.abs() - 38.0).abs();
    let tower = smax(between - 6.0, vec2(p.x.abs() - CAM_X, (p.z - CAM_Z).max(0.0)).length() - 17.0, 2.0);
    let tower = smax(tower, p.z - CAM_Z - 11.0, 1.0).max(p.y.abs() - HALF_LENGTH + 1.0).max(DECK + 40.0 - p.z);
    d = smin(d, tower, 2.0);
    d = smax(d, 10.4 - vec2(p.x.abs() - CAM_X, p.z - CAM_Z).length(), 0.5);
    // The well of the plug.
    let well = vec2(l.x, l.y).length();
    let tube = smax(well - 14.0, (p.z - DECK - 42.0).abs() - 22.0, 1.0);
    d = smin(d, tube, 3.0);
    d = smax(d, -smax(well - 10.5, DECK + 27.0 - p.z, 1.0), 1.0);
    smax(d, 3.3 - round, 0.5)
}

/// Valves, springs, camshafts, plugs.
pub fn paint(p: Vec3, paint: &mut Paint<'_>) {
    let (i, l) = cylinder(p);
    let exhaust = p.x > 0.0;
    let v = frame(l);
    let round = vec2(v.x, v.y).length();
    if round < 16.0 {
        let lift = lift(i, exhaust);
        let z = v.z + lift;
        // A trumpet-shaped head, the stem, the retainer and the tappet.
        let flare = z - 4.5;
        let neck = 3.0 + 8.6 * smoothstep(13.0, 0.0, flare) * smoothstep(16.0, 0.0, flare);
        let valve = smax((round - neck) * 0.8, smax(3.4 - z, z - 62.0, 1.0), 0.8);
        let part = if exhaust { Part::ExhaustValves } else { Part::IntakeValves };
        let retainer = disc_z(vec3(v.x, v.y, z - 55.5), 10.6, 1.8, 0.8);
        let tappet = disc_z(vec3(v.x, v.y, z - 61.5), 11.6, 1.7, 0.8);
        let skirt = smax((round - 11.0).abs() - 0.9, (z - 58.0).abs() - 5.0, 0.4);
        paint.put(spring(v, 29.0, 53.5 - lift), STEEL + 100.0, Part::Springs);
        paint.put(valve, VALVE, part);
        paint.put(retainer.min(tappet).min(skirt), STEEL, part);
    }
    // Camshafts.
    let part = if exhaust { Part::ExhaustCam } else { Part::IntakeCam };
    let c = vec2(p.x.abs() - CAM_X, p.z - CAM_Z);
    if c.length() < 24.0 {
        let shaft = smax(c.length() - 8.0, -(HALF_LENGTH - 6.0) - p.y, 1.0).max(p.y - 179.0);
        let journal = smax(c.length() - 10.0, (l.y.abs() - 38.0).abs() - 6.4, 0.8).max(p.y.abs() - HALF_LENGTH);
        let (s, k) = turned(lobe(i, exhaust));
        // The valve leans: so does its lobe's frame.
        let nose = vec2(LEAN.0 * s + LEAN.1 * k, -LEAN.0 * k + LEAN.1 * s);
        let profile = cone(vec3(c.x, 0.0, c.y), Vec3::ZERO, vec3(nose.x, 0.0, nose.y) * 8.0, 11.5, 6.8);
        let lobes = smax(profile, (l.y.abs() - APART).abs() - 5.4, 0.8);
        let d = smin(shaft.min(journal), lobes.max(p.y.abs() - HALF_LENGTH + 8.0), 1.0);
        paint.put(smax(d, 2.6 - c.length(), 0.5), STEEL, part);
    }
    paint_plug(l, paint);
}

/// A coil of five turns around the z axis between two heights.
fn spring(v: Vec3, from: f32, to: f32) -> f32 {
    let round = vec2(v.x, v.y).length();
    let turns = 5.0;
    let rise = (to - from) / turns;
    // The angle in turns.
    let half = acos((v.x / round.max(1e-3)).clamp(-1.0, 1.0)) / std::f32::consts::TAU;
    let angle = if v.y < 0.0 { 1.0 - half } else { half };
    let t = (v.z - from) / rise - angle;
    let nearest = (t - t.round()) * rise;
    let coil = vec2(round - 8.3, nearest * 0.97).length() - 1.55;
    smax(coil, (v.z - (from + to) * 0.5).abs() - (to - from) * 0.5, 0.6)
}

/// A spark plug on the axis of a cylinder.
fn paint_plug(l: Vec3, paint: &mut Paint<'_>) {
    let z = l.z - DECK;
    let round = vec2(l.x, l.y).length();
    if round > 13.0 || !(0.0..=82.0).contains(&z) {
        return;
    }
    let thread = {
        let t = z / 1.9;
        5.6 + 0.5 * ((t - t.round()).abs() * 2.0)
    };
    let body = smax(round - thread, (z - 18.0).abs() - 10.5, 0.6);
    let a = vec2(l.x.abs(), l.y.abs());
    let hex = (a.x * 0.866_025_4 + a.y * 0.5).max(a.y) - 8.6;
    let hex = smax(hex, (z - 33.5).abs() - 4.5, 0.8);
    let collar = disc_z(vec3(l.x, l.y, z - 28.4), 8.4, 1.6, 0.6);
    paint.put(body.min(hex).min(collar), STEEL, Part::Plugs);
    // Ribs on the insulator, the electrodes, the terminal.
    let rib = ((z - 46.0) / 4.0 - ((z - 46.0) / 4.0).round()).abs() * 2.0;
    let sleeve = smax(round - 4.9 - 0.7 * rib * f32::from(z < 56.0), (z - 36.0).abs() - 28.0, 1.0);
    paint.put(sleeve, CERAMIC, Part::Ceramic);
    let rod = smax(round - 1.7, (z - 36.0).abs() - 31.5, 0.5);
    let terminal = disc_z(vec3(l.x, l.y, z - 68.0), 3.6, 4.6, 1.0);
    let hook = chain(
        vec3(l.x, l.y, z),
        &[(vec3(5.0, 0.0, 8.0), 1.3), (vec3(5.0, 0.0, 2.6), 1.3), (vec3(0.0, 0.0, 2.2), 1.2)],
        0.5,
    );
    paint.put(rod.min(terminal).min(hook), VALVE, Part::Plugs);
}
