//! What holds everything: block, cylinder head, cam cover and oil pan, with their channels, and the bolts between.

use glam::{Vec2, Vec3, vec2, vec3};

use super::material::*;
use super::{BORE, DECK, HALF_LENGTH, HEAD_TOP, PITCH, Part, cylinder, disc_y, disc_z, top};
use crate::specimen::painter::Paint;
use crate::specimen::sdf::*;

/// Lower faces of block and pan.
const SKIRT: f32 = -38.0;
const PAN_FLOOR: f32 = -80.0;
/// Where the cam cover ends.
const COVER_TOP: f32 = 250.0;

/// A box from `lo` to `hi` with rounded edges.
fn slab(p: Vec3, lo: Vec3, hi: Vec3, round: f32) -> f32 {
    rounded_box(p - (lo + hi) * 0.5, (hi - lo) * 0.5, round)
}

/// Half the width of the block at a height: a crankcase under the cylinders.
fn half_width(z: f32) -> f32 {
    mix(64.0, 46.0, smoothstep(18.0, 62.0, z))
}

/// Everything that is cast, filled.
pub fn hull(p: Vec3) -> f32 {
    let q = vec3(p.x.abs(), p.y.abs(), p.z);
    let below = slab(q, vec3(-72.0, -HALF_LENGTH - 5.0, PAN_FLOOR), vec3(72.0, HALF_LENGTH + 5.0, 64.0), 4.0);
    let above = slab(q, vec3(-74.0, -HALF_LENGTH - 5.0, 30.0), vec3(74.0, HALF_LENGTH + 5.0, COVER_TOP), 4.0);
    let sides = slab(p, vec3(-96.0, -146.0, -36.0), vec3(96.0, 146.0, 214.0), 4.0);
    below.min(above).min(sides)
}

/// The outside of the block.
fn block(p: Vec3, l: Vec3) -> f32 {
    let wide = p.x.abs() - half_width(p.z);
    let mut d = smax(wide * 0.92, p.y.abs() - HALF_LENGTH, 8.0);
    d = smax(d, (p.z - DECK).max(SKIRT - p.z), 1.5);
    // Ribs on the crankcase, bosses of the head bolts down the sides, the flanges of deck and skirt.
    let half = vec3(p.x.abs(), l.y.abs(), p.z);
    let boss = cone(half, vec3(45.0, PITCH * 0.5, 40.0), vec3(45.0, PITCH * 0.5, DECK), 8.5, 8.5);
    d = smin(d, smax(boss, p.y.abs() - HALF_LENGTH, 2.0), 5.0);
    let rib =
        smax(l.y.abs() - 2.6, smax((p.x.abs() - 68.0).max(44.0 - p.x.abs()), (p.z - 14.0).abs() - 48.0, 4.0), 2.0);
    d = smin(d, rib, 5.0);
    let skirt = slab(p, vec3(-72.0, -HALF_LENGTH - 3.0, SKIRT), vec3(72.0, HALF_LENGTH + 3.0, SKIRT + 8.0), 2.0);
    d = smin(d, skirt, 4.0);
    // Engine mounts on both sides, the pad of the oil filter on the left.
    let mount = slab(vec3(p.x.abs(), p.y, p.z), vec3(50.0, -26.0, -2.0), vec3(82.0, 26.0, 24.0), 5.0);
    d = smin(d, mount, 8.0);
    let pad = disc_x(p - vec3(-62.0, 92.0, -4.0), 24.0, 12.0);
    // The tensioner's boss at the front.
    let boss = disc_y(p - vec3(36.0, HALF_LENGTH + 4.0, 92.0), 8.0, 8.0, 1.0);
    smin(smin(d, pad, 5.0), boss, 4.0)
}

/// A cylinder along x about the origin.
fn disc_x(p: Vec3, radius: f32, half: f32) -> f32 {
    smax(vec2(p.y, p.z).length() - radius, p.x.abs() - half, 2.0)
}

/// The room of the crank: between the walls that carry the bearings.
fn crankcase(p: Vec3, l: Vec3) -> f32 {
    let inner = smax(p.x.abs() - 55.0, smax(p.z - 40.0, SKIRT - 12.0 - p.z, 10.0), 14.0);
    // A web stands between two cylinders and at either end.
    let web = (l.y.abs() - PITCH * 0.5 + 7.5).max(p.y.abs() - HALF_LENGTH + 9.0);
    // Under the bearing the webs leave room for the caps.
    smax(inner, web, 4.0)
}

/// The jacket around the four liners.
fn jacket(l: Vec3, p: Vec3) -> f32 {
    let around = vec2(l.x, l.y).length();
    let outer = smin(around - 41.5, smax(p.x.abs() - 30.0, p.y.abs() - 1.5 * PITCH, 4.0), 6.0);
    let d = smax(outer, 35.6 - around, 1.5);
    smax(d, (p.z - 94.0).abs() - 44.0, 5.0)
}

/// Galleries of oil: a long one in the left side of the block, and a drilling from it to every main bearing.
fn oil(p: Vec3, l: Vec3) -> f32 {
    let main = smax(vec2(p.x + 52.0, p.z - 30.0).length() - 5.0, p.y.abs() - HALF_LENGTH + 6.0, 1.0);
    let drill = cone(vec3(p.x, l.y.abs() - PITCH * 0.5, p.z), vec3(-52.0, 0.0, 30.0), vec3(-16.0, 0.0, 12.0), 2.6, 2.6);
    // One rises to the camshafts at the rear.
    let riser =
        cone(p, vec3(-52.0, -HALF_LENGTH + 12.0, 30.0), vec3(-40.0, -HALF_LENGTH + 10.0, HEAD_TOP - 14.0), 3.0, 3.0);
    main.min(drill).min(riser)
}

/// The ports of the head: intake on the left, exhaust on the right, from the flange down to the valve's seat.
fn port(p: Vec3, l: Vec3) -> f32 {
    let q = vec3(p.x.abs(), l.y, p.z);
    let course = [
        (vec3(14.5, 0.0, DECK + 9.0), 10.5),
        (vec3(22.0, 0.0, DECK + 19.0), 10.0),
        (vec3(40.0, 0.0, DECK + 28.0), 11.0),
        (vec3(88.0, 0.0, DECK + 33.0), 12.5),
    ];
    chain(q, &course, 6.0)
}

/// The flanges on the head's sides, a short pipe to each port.
fn runners(p: Vec3, l: Vec3) -> f32 {
    let q = vec3(p.x.abs(), l.y, p.z);
    let reach = if p.x > 0.0 { 76.0 } else { 84.0 };
    let pipe = smax(cone(q, vec3(40.0, 0.0, DECK + 28.0), vec3(90.0, 0.0, DECK + 33.0), 15.0, 16.5), q.x - reach, 2.0);
    let flange = slab(vec3(q.x, q.y, q.z - DECK - 31.5), vec3(reach - 7.0, -27.0, -15.0), vec3(reach, 27.0, 15.0), 6.0);
    let rail = slab(vec3(q.x, p.y, q.z - DECK - 31.5), vec3(reach - 6.0, -132.0, -9.0), vec3(reach, 132.0, 9.0), 4.0);
    smin(smin(pipe, flange, 4.0), rail, 3.0)
}

/// The combustion chamber, a shallow roof over each bore.
fn chamber(l: Vec3) -> f32 {
    let roof = l.z - DECK - 12.0 + 0.42 * l.x.abs();
    smax(smax(vec2(l.x, l.y).length() - BORE + 1.0, roof * 0.9, 3.0), DECK - 2.0 - l.z, 0.5)
}

/// The water of the head.
fn head_jacket(p: Vec3, l: Vec3) -> f32 {
    let d = smax(p.x.abs() - 38.0, p.y.abs() - HALF_LENGTH + 12.0, 6.0);
    let d = smax(d, (p.z - DECK - 27.0).abs() - 11.0, 5.0);
    let d = smax(d, 5.0 - port(p, l), 2.0);
    let d = smax(d, 6.5 - chamber(l), 2.0);
    // Walls around plug and bolts.
    let plug = vec2(l.x, l.y).length();
    let bolt = vec2(p.x.abs() - 40.0, l.y.abs() - PITCH * 0.5).length();
    let guide = top::guide_bound(l);
    smax(smax(d, 15.0 - plug, 2.0), (10.0 - bolt).max(7.0 - guide), 2.0)
}

fn head(p: Vec3, l: Vec3) -> f32 {
    let body = slab(p, vec3(-58.0, -HALF_LENGTH, DECK + 1.2), vec3(58.0, HALF_LENGTH, HEAD_TOP), 4.0);
    let body = smax(body, (p.x.abs() - 50.0) - 0.35 * (p.z - DECK - 20.0).abs(), 4.0);
    smin(body, runners(p, l), 5.0)
}

/// The room of the camshafts, above the head's floor.
fn cam_room(p: Vec3) -> f32 {
    let floor =
        slab(p, vec3(-51.0, -HALF_LENGTH + 7.0, DECK + 46.0), vec3(51.0, HALF_LENGTH - 7.0, HEAD_TOP + 12.0), 3.0);
    floor.min(cover_profile(p, 5.0))
}

/// The cover: two domes over the camshafts and a valley for the plugs, `inset` mm inside its outer face.
fn cover_profile(p: Vec3, inset: f32) -> f32 {
    let domes = vec2(p.x.abs() - 32.0, p.z - (HEAD_TOP + 8.0)).length() - 25.0;
    let middle = vec2((p.x.abs() - 22.0).max(0.0), (p.z - HEAD_TOP - 9.0).max(0.0)).length() - 2.0;
    let shape = smin(domes, middle, 8.0);
    let ends = p.y.abs() - HALF_LENGTH + 1.0;
    smax(smax(shape, ends, 8.0) + inset, HEAD_TOP + 1.2 - p.z, 1.0)
}

fn cover(p: Vec3, l: Vec3) -> f32 {
    let mut d = smax(cover_profile(p, 0.0), -cover_profile(p, 4.2), 1.0);
    // Its flange, the wells of the plugs, fins along the domes, the filler cap at the front of the left dome.
    d = smin(
        d,
        smax(
            slab(p, vec3(-58.0, -HALF_LENGTH, HEAD_TOP + 1.2), vec3(58.0, HALF_LENGTH, HEAD_TOP + 6.5), 2.0),
            -cover_profile(p, 4.2),
            1.0,
        ),
        2.0,
    );
    let well = vec2(l.x, l.y).length();
    d = smin(d, smax(well - 14.5, smax(p.z - HEAD_TOP - 14.0, HEAD_TOP - 30.0 - p.z, 1.0), 1.0), 3.0);
    let dome_fins = {
        let fin = (p.x.abs() - 32.0) / 8.0;
        let fin = (fin - fin.round()).abs() * 8.0 - 1.2;
        smax(smax(fin, cover_profile(p, -2.4), 0.8), p.y.abs() - HALF_LENGTH + 22.0, 2.0)
    };
    d = smin(d, smax(dome_fins, 18.0 - p.x.abs(), 1.0), 1.5);
    let cap = disc_z(p - vec3(-32.0, 108.0, HEAD_TOP + 33.0), 15.0, 6.0, 2.0);
    d = smin(d, cap, 2.0);
    smax(d, 11.0 - well, 0.8)
}

fn pan(p: Vec3) -> (f32, f32) {
    let deep = smoothstep(-10.0, -50.0, p.y);
    let floor = mix(-58.0, PAN_FLOOR + 2.0, deep);
    let shape = |inset: f32| {
        let wide = p.x.abs() - mix(62.0, 50.0, smoothstep(SKIRT, PAN_FLOOR, p.z));
        smax(smax(wide, p.y.abs() - HALF_LENGTH + 3.0, 8.0), (floor - p.z) * 0.8, 8.0) + inset
    };
    let wall = smax(shape(0.0).max(p.z - SKIRT + 1.0), -shape(3.6), 1.0);
    let flange = slab(p, vec3(-72.0, -HALF_LENGTH - 3.0, SKIRT - 7.0), vec3(72.0, HALF_LENGTH + 3.0, SKIRT - 1.0), 2.0);
    let flange = smax(flange, -shape(3.6), 1.0);
    let plug = disc_y(p - vec3(0.0, -HALF_LENGTH + 1.0, PAN_FLOOR + 12.0), 8.0, 5.0, 1.0);
    let bath = smax(shape(3.6), p.z + 62.0, 0.8);
    (smin(smin(wall, flange, 2.0), plug, 1.5), bath)
}

/// All castings, with what flows in them.
pub fn paint(p: Vec3, paint: &mut Paint<'_>) {
    let (_, l) = cylinder(p);
    let grain = 14.0 * noise(p * 0.35, 81);
    let bore = vec2(l.x, l.y).length() - BORE;
    if p.z < DECK + 8.0 {
        let mut d = block(p, l);
        d = smax(d, -crankcase(p, l), 2.0);
        d = smax(d, -smax(bore, 20.0 - p.z, 1.0), 1.0);
        let jacket = jacket(l, p);
        let oil = oil(p, l);
        // Main bearings.
        d = smax(d, 25.0 - vec2(p.x, p.z).length(), 0.8);
        // The oil returns from the head through passages on the right.
        let back = vec2(p.x - 50.0, l.y).length() - 4.5;
        d = smax(d, -smax(back, 44.0 - p.z, 1.0), 0.8);
        paint.put(smax(smax(d, -jacket, 1.0), -oil, 0.8), ALUMINUM + grain, Part::Block);
        paint.put(jacket, COOLANT, Part::Coolant);
        paint.put(smax(oil, d, 0.5), OIL, Part::Oil);
        // Liners.
        let liner = smax(smax(bore - 4.0, -bore, 0.5), (p.z - 87.0).abs() - 60.5, 1.0);
        paint.put(liner, LINER, Part::Liners);
        paint_pan(p, grain, paint);
    }
    if p.z > DECK - 6.0 {
        paint_head(p, l, bore, grain, paint);
    }
}

fn paint_pan(p: Vec3, grain: f32, paint: &mut Paint<'_>) {
    if p.z > SKIRT + 6.0 {
        return;
    }
    let (wall, bath) = pan(p);
    paint.put(bath, OIL, Part::Oil);
    paint.put(wall, ALUMINUM + grain, Part::Pan);
}

fn paint_head(p: Vec3, l: Vec3, bore: f32, grain: f32, paint: &mut Paint<'_>) {
    // The head gasket, open at the bores.
    let gasket = smax((p.z - DECK - 0.6).abs() - 1.2, smax(p.x.abs() - 48.0, p.y.abs() - HALF_LENGTH, 2.0), 0.5);
    paint.put(smax(gasket, -bore, 0.5), RUBBER + 500.0, Part::Gaskets);
    let mut d = head(p, l);
    d = smax(d, -chamber(l), 1.0);
    d = smax(d, -port(p, l), 1.0);
    d = smax(d, -cam_room(p), 2.0);
    d = top::head_work(p, l, d);
    let water = head_jacket(p, l);
    paint.put(smax(d, -water, 1.0), ALUMINUM + grain, Part::CylinderHead);
    paint.put(water, COOLANT, Part::Coolant);
    paint.put(
        smax(
            smax(
                (p.z - HEAD_TOP - 0.6).abs() - 1.0,
                slab(p, vec3(-57.0, -HALF_LENGTH, 0.0), vec3(57.0, HALF_LENGTH, 400.0), 1.0),
                0.5,
            ),
            51.0 - p.x.abs(),
            0.5,
        ),
        RUBBER,
        Part::Gaskets,
    );
    paint.put(cover(p, l), ALUMINUM * 0.98 + grain, Part::Cover);
}

/// A hexagonal head with a washer on a shaft along +z from the origin: the washer's face is at z = 0.
fn hex_bolt(p: Vec3, radius: f32, shaft: f32) -> f32 {
    let a = vec2(p.x.abs(), p.y.abs());
    let hex = (a.x * 0.866_025_4 + a.y * 0.5).max(a.y) - radius * 1.55;
    let head = smax(hex, (p.z - radius * 0.75).abs() - radius * 0.75, 0.8);
    let washer = smax(a.length() - radius * 2.1, (p.z - 0.6).abs() - 0.9, 0.5);
    let rod = smax(a.length() - radius, (p.z + shaft * 0.5).abs() - shaft * 0.5, 0.5);
    head.min(washer).min(rod)
}

/// Bolts of the oil pan and of the cover, spaced along both sides.
fn spaced(y: f32, spacing: f32, count: f32) -> f32 {
    let i = (y / spacing - 0.5).round().clamp(-count, count - 1.0) + 0.5;
    y - i * spacing
}

/// Distance from all bolts that stand out of the castings.
pub fn outer_bolts(p: Vec3) -> f32 {
    let q = vec3(p.x.abs(), p.y, p.z);
    let pan = vec3(q.x - 67.5, spaced(p.y, 38.0, 4.0), SKIRT - 7.0 - p.z);
    let cover = vec3(q.x - 55.0, spaced(p.y, 50.0, 3.0), p.z - HEAD_TOP - 6.5);
    hex_bolt(pan, 3.4, 10.0).min(hex_bolt(cover, 3.4, 20.0))
}

/// Bolts of the covers, the long ones that hold the head, and those of the flanges.
pub fn paint_bolts(p: Vec3, paint: &mut Paint<'_>) {
    let (_, l) = cylinder(p);
    let mut d = outer_bolts(p);
    if p.z > 30.0 && p.z < HEAD_TOP {
        let half = vec3(p.x.abs() - 40.0, l.y.abs() - PITCH * 0.5, p.z - DECK - 46.0);
        // The last row stands inside the end walls.
        let half = if p.y.abs() > 1.6 * PITCH { vec3(half.x, p.y.abs() - 1.5 * PITCH - 31.0, half.z) } else { half };
        d = d.min(hex_bolt(half, 4.6, 112.0));
        let reach = if p.x > 0.0 { 76.0 } else { 84.0 };
        let flange = Vec2::new(l.y.abs() - 22.0, p.z - DECK - 31.5);
        let stud = vec3(flange.x, flange.y, p.x.abs() - reach);
        d = d.min(hex_bolt(stud, 3.2, 16.0));
    }
    paint.put(d, STEEL, Part::Bolts);
}
