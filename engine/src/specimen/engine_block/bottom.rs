//! What turns and slides below the head: crankshaft, rods, pistons, flywheel and timing wheels.

use glam::{Vec3, vec2, vec3};

use super::material::*;
use super::{BORE, CRANK, HALF_LENGTH, PITCH, Part, ROD, crank_angle, cylinder, disc_y, disc_z, top};
use crate::specimen::painter::Paint;
use crate::specimen::sdf::*;

/// Height of the piston pin over the crankshaft at a cylinder.
fn pin_height(i: usize) -> f32 {
    let (s, c) = crank_angle(i);
    CRANK * c + (ROD * ROD - CRANK * CRANK * s * s).sqrt()
}

/// Half the length of a crankpin.
const PIN: f32 = 14.0;

/// The crankshaft of one cylinder: the pin, its two webs with counterweights, and half of each main journal.
fn crankshaft(p: Vec3, i: usize, l: Vec3) -> f32 {
    let (s, c) = crank_angle(i);
    // The throw's frame: z toward the crankpin.
    let a = vec3(l.x * c - l.z * s, l.y, l.x * s + l.z * c);
    let pin = disc_y(a - vec3(0.0, 0.0, CRANK), 16.0, PIN + 2.0, 1.0);
    let journal = smax(vec2(l.x, l.z).length() - 20.0, p.y.abs() - HALF_LENGTH - 14.0, 1.0);
    let journal = smax(journal, PIN + 4.0 - l.y.abs(), 1.0);
    let cheek = {
        let thick = (l.y.abs() - (PIN + 6.2)).abs() - 5.4;
        let neck = cone(vec3(a.x, 0.0, a.z), vec3(0.0, 0.0, -4.0), vec3(0.0, 0.0, CRANK), 24.0, 20.0);
        let fan = smax(vec2(a.x, a.z + 6.0).length() - 41.0, (a.z + 8.0).max(a.x.abs() - 36.0), 8.0);
        smax(smin(neck, fan, 6.0), thick, 2.5)
    };
    let d = smin(smin(pin, journal, 1.5), cheek, 2.0);
    // A drilling for oil from the main journal to the pin.
    let drill = cone(a, vec3(0.0, -PITCH * 0.5, 0.0), vec3(0.0, 0.0, CRANK), 2.4, 2.4);
    smax(d, -drill, 0.6)
}

/// The rod of a cylinder: an I-beam between its two eyes.
fn rod(i: usize, l: Vec3) -> f32 {
    let (s, c) = crank_angle(i);
    let big = vec3(CRANK * s, 0.0, CRANK * c);
    let small = vec3(0.0, 0.0, pin_height(i));
    let axis = (small - big) / ROD;
    let a = l - big;
    // The rod's frame: z from the big eye to the small one.
    let r = vec3(a.x * axis.z - a.z * axis.x, a.y, a.x * axis.x + a.z * axis.z);
    let t = (r.z / ROD).clamp(0.0, 1.0);
    let beam = rounded_box(r - vec3(0.0, 0.0, ROD * 0.5), vec3(mix(13.0, 8.5, t), 6.6, ROD * 0.5 - 8.0), 2.0);
    let groove = (r.y.abs() - 6.6).abs() - 4.0;
    let groove = smax(smax(groove, r.x.abs() - mix(8.5, 4.5, t), 2.0), (r.z - ROD * 0.5).abs() - 25.0, 4.0);
    let beam = smax(beam, -groove, 1.2);
    let eyes = disc_y(r, 23.0, 12.5, 1.5).min(disc_y(r - vec3(0.0, 0.0, ROD), 14.5, 11.0, 1.5));
    // The cap's bolts stand beside the big eye.
    let ears = rounded_box(vec3(r.x.abs() - 21.0, r.y, r.z), vec3(6.0, 8.0, 13.0), 2.0);
    let d = smin(smin(beam, eyes, 5.0), ears, 3.0);
    let holes = (vec2(r.x, r.z).length() - 16.8).min(vec2(r.x, r.z - ROD).length() - 9.4);
    let split = (r.z).abs() - 0.5;
    smax(smax(d, -holes, 0.6), -split.max(17.0 - r.x.abs()), 0.3)
}

/// The pistons with pins and rings, and the rods.
pub fn paint_cylinder(p: Vec3, paint: &mut Paint<'_>) {
    let (i, l) = cylinder(p);
    let pin_z = pin_height(i);
    let a = vec3(l.x, l.y, l.z - pin_z);
    let around = vec2(l.x, l.y).length();
    if around < BORE + 4.0 && a.z.abs() < 40.0 {
        let crown = 24.0 - 1.8 * bump(around, 22.0);
        let mut d = smax(around - BORE + 0.7, smax(a.z - crown, -24.0 - a.z, 1.5), 1.5);
        // Hollow from below, with a boss for the pin; the skirt is cut away over it.
        let hollow = smax(smax(around - BORE + 5.0, a.z - 13.0, 5.0), 0.0 - 30.0 - a.z, 2.0);
        let boss = smax(vec2(a.x, a.z).length() - 14.0, 11.5 - l.y.abs(), 2.0);
        d = smax(d, -smax(hollow, -boss, 2.0), 1.5);
        let window = smax(vec2(a.x, a.z + 22.0).length() - 17.0, 24.0 - l.y.abs(), 3.0);
        d = smax(d, -window, 3.0);
        d = smax(d, 8.6 - vec2(a.x, a.z).length(), 0.5);
        let groove = ((a.z - 14.0) / 5.0).round().clamp(-1.0, 1.0);
        let ring_z = (a.z - 14.0 - groove * 5.0).abs() - 1.3;
        paint.put(d, PISTON, Part::Pistons);
        paint.put(smax(ring_z, (around - BORE + 2.4).abs() - 2.4, 0.4), IRON, Part::Rings);
    }
    paint.put(rod(i, l), STEEL, Part::Rods);
    let pin = disc_y(a, 8.4, 25.0, 1.0);
    paint.put(smax(pin, 4.4 - vec2(a.x, a.z).length(), 0.5), STEEL + 60.0, Part::Pins);
}

/// Crankshaft and bearing caps.
pub fn paint_crank(p: Vec3, paint: &mut Paint<'_>) {
    let (i, l) = cylinder(p);
    if p.z < 50.0 && p.y.abs() < HALF_LENGTH + 2.0 {
        // A cap under every main bearing, also at the ends.
        let w = (l.y.abs() - PITCH * 0.5).abs();
        let cap = rounded_box(vec3(p.x, w, p.z + 15.0), vec3(40.0, 8.0, 15.0), 3.0);
        let cap = smax(cap, 21.6 - vec2(p.x, p.z).length(), 0.6);
        let cap = smax(cap, p.y.abs() - HALF_LENGTH, 0.6);
        paint.put(cap, IRON, Part::Caps);
        let bolt = vec3(p.x.abs() - 31.0, w, -p.z - 30.0);
        let head = disc_z(bolt, 6.5, 5.0, 1.0).min(disc_z(bolt + vec3(0.0, 0.0, 24.0), 4.0, 26.0, 1.0));
        paint.put(smax(head, p.y.abs() - HALF_LENGTH, 0.6), STEEL, Part::Bolts);
    }
    let shaft = if p.y.abs() < HALF_LENGTH {
        crankshaft(p, i, l)
    } else {
        smax(vec2(p.x, p.z).length() - 16.0, p.y.abs() - 188.0, 1.0)
    };
    paint.put(shaft, STEEL, Part::Crank);
}

/// Where the crank's wheels and the belt are.
pub fn ends_bound(p: Vec3) -> f32 {
    let rear = disc_y(p - vec3(0.0, -170.0, 0.0), 88.0, 14.0, 1.0);
    let front = rounded_box(p - vec3(0.0, 174.0, 96.0), vec3(66.0, 18.0, 150.0), 2.0);
    rear.min(front)
}

/// A toothed wheel about the y axis.
fn toothed(p: Vec3, radius: f32, teeth: f32, half: f32) -> f32 {
    let r = vec2(p.x, p.z).length();
    // The angle as a number of teeth.
    let angle = acos((p.x / r.max(1e-3)).clamp(-1.0, 1.0)) * (teeth / std::f32::consts::TAU);
    let t = (angle - angle.round()).abs() * 2.0;
    let edge = radius - 1.8 * smoothstep(0.35, 0.65, t);
    smax((r - edge) * 0.8, p.y.abs() - half, 0.8)
}

/// Flywheel with its ring gear at the rear; at the front the wheels of the camshafts, the crank and the tensioner, the
/// belt around them, and the pulley.
pub fn paint_ends(p: Vec3, paint: &mut Paint<'_>) {
    if p.y < 0.0 {
        let a = p - vec3(0.0, -170.0, 0.0);
        let r = vec2(a.x, a.z).length();
        let mut d = toothed(a, 84.0, 96.0, 6.0).min(disc_y(a, 76.0, 9.0, 2.0));
        // A dished face, windows, and the bolts of the crank.
        d = smax(d, -smax((r - 52.0).abs() - 15.0, a.y.abs() - 20.0, 1.0).max(-(a.y + 4.0)), 3.0);
        for k in 0..6 {
            let (s, c) = super::turned(k as f32 / 6.0);
            d = smax(d, 9.0 - vec2(a.x - 52.0 * c, a.z - 52.0 * s).length(), 1.5);
            let (s, c) = super::turned((k as f32 + 0.5) / 6.0);
            let bolt = disc_y(a - vec3(24.0 * c, -11.0, 24.0 * s), 4.6, 5.0, 0.8);
            paint.put(bolt, STEEL, Part::Bolts);
        }
        paint.put(d, IRON, Part::Flywheel);
        return;
    }
    let a = p - vec3(0.0, 170.0, 0.0);
    let spokes = |q: Vec3, radius: f32| {
        let mut d = f32::MAX;
        for k in 0..5 {
            let (s, c) = super::turned(k as f32 / 5.0 + 0.05);
            d = d.min(vec2(q.x - radius * 0.58 * c, q.z - radius * 0.58 * s).length() - radius * 0.20);
        }
        d
    };
    let mut wheels = f32::MAX;
    for side in [1.0, -1.0] {
        let q = a - vec3(side * top::CAM_X, 0.0, top::CAM_Z);
        if vec2(q.x, q.z).length() < 40.0 {
            let wheel = toothed(q, 27.5, 36.0, 7.0);
            wheels = wheels.min(smax(wheel, -spokes(q, 27.5), 1.0));
        }
    }
    wheels = wheels.min(toothed(a, 16.0, 20.0, 7.0));
    // The tensioner, on its bolt.
    wheels = wheels.min(disc_y(a - vec3(36.0, 0.0, 92.0), 15.0, 7.0, 1.0));
    paint.put(disc_y(a - vec3(36.0, -5.0, 92.0), 4.5, 14.0, 0.8), STEEL, Part::Bolts);
    paint.put(wheels, STEEL - 80.0, Part::Wheels);
    // The belt: a band around all of them.
    let line = [
        vec2(-16.5, 2.0),
        vec2(-top::CAM_X - 28.0, top::CAM_Z - 4.0),
        vec2(-top::CAM_X, top::CAM_Z + 28.5),
        vec2(top::CAM_X, top::CAM_Z + 28.5),
        vec2(top::CAM_X + 28.0, top::CAM_Z - 6.0),
        vec2(20.0, 92.0),
        vec2(16.5, 0.0),
    ];
    let at = vec3(a.x, 0.0, a.z);
    let belt = line
        .windows(2)
        .map(|w| cone(at, vec3(w[0].x, 0.0, w[0].y), vec3(w[1].x, 0.0, w[1].y), 1.6, 1.6))
        .fold(f32::MAX, f32::min);
    let around_cams = [1.0, -1.0].map(|s| (vec2(a.x - s * top::CAM_X, a.z - top::CAM_Z).length() - 28.8).abs() - 1.6);
    let around_cams = smax(around_cams[0].min(around_cams[1]), top::CAM_Z - 4.0 - a.z, 1.0);
    let around_cams = around_cams.max(top::CAM_X - a.x.abs());
    let around_crank = smax((vec2(a.x, a.z).length() - 17.6).abs() - 1.6, a.z - 2.0, 1.0);
    let no_chords = if a.z > top::CAM_Z && a.x.abs() > top::CAM_X { f32::MAX } else { belt };
    let belt = smax(no_chords.min(around_cams).min(around_crank), a.y.abs() - 8.0, 0.8);
    paint.put(belt, RUBBER, Part::Gaskets);
    // The pulley of the crank, grooved.
    let b = p - vec3(0.0, 184.0, 0.0);
    let groove = ((b.y / 4.0) - (b.y / 4.0).round()).abs() * 4.0;
    let pulley = smax(vec2(b.x, b.z).length() - 42.0 - 0.9 * groove, b.y.abs() - 6.0, 1.0);
    let dish = smax((vec2(b.x, b.z).length() - 26.0).abs() - 9.0, -b.y - 2.0, 2.0);
    paint.put(smax(pulley, -dish, 1.5), IRON, Part::Wheels);
    paint.put(disc_y(b - vec3(0.0, 5.0, 0.0), 9.0, 3.0, 1.0), STEEL, Part::Bolts);
}
