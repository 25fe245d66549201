//! Paints what `docs/images/extracted.png` begins with: three balls on a table, each in a manner of its own, in brush strokes. Nothing
//! is random: the same program makes the same picture. `scripts/extracted.sh` makes styles of the balls and skulls of the styles.
//!
//! `make_painting OUT.png` writes the painting; `make_painting OUT.png SKULL.png SKULL.png SKULL.png` writes it above the same
//! table with three pictures (square, transparent) where the balls were.

use std::path::Path;

use fabrica_engine::color::{linear_from_srgb8, premultiplied_from_straight};
use fabrica_engine::image_out::{PngOptions, read_png, save_png};
use fabrica_engine::{Error, Result};
use glam::{DVec2, DVec3};

const WIDTH: usize = 1200;
const HEIGHT: usize = 500;
/// Where wall and table meet.
const TABLE: f64 = 330.0;

/// A ball: middle and radius in pixels, and linear color of a direction.
struct Ball {
    center: DVec2,
    radius: f64,
    shading: fn(DVec3) -> DVec3,
}

/// README's commands name these circles.
const BALLS: [Ball; 3] = [
    Ball { center: DVec2::new(215.0, 290.0), radius: 150.0, shading: vermilion },
    Ball { center: DVec2::new(600.0, 265.0), radius: 170.0, shading: indigo },
    Ball { center: DVec2::new(985.0, 290.0), radius: 150.0, shading: gilded },
];

fn srgb(hex: u32) -> DVec3 {
    DVec3::from_array([hex >> 16, hex >> 8, hex].map(|c| f64::from(linear_from_srgb8((c & 255) as u8))))
}

fn smooth(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Towards the window: above, left, in front.
fn key() -> DVec3 {
    DVec3::new(-0.55, 0.62, 0.56).normalize()
}

/// Oil: warm lights, a wine-red shadow that the table lights from below, a wet highlight.
fn vermilion(n: DVec3) -> DVec3 {
    let light = n.dot(key());
    let body =
        srgb(0x3a0d18).lerp(srgb(0xb02a1c), smooth(-0.35, 0.45, light)).lerp(srgb(0xf2915c), smooth(0.4, 1.0, light));
    let below = srgb(0xa0643c) * 0.55 * (-n.y).max(0.0).powi(2);
    let half = (key() + DVec3::Z).normalize();
    let highlight = srgb(0xfff4dc) * smooth(0.965, 0.99, n.dot(half));
    (body + below + highlight).min(DVec3::ONE)
}

/// Ink and wash: paper is the light, layers of indigo the shadow, a brush line the edge.
fn indigo(n: DVec3) -> DVec3 {
    let light = n.dot(key());
    let wash = [(0.72, 0x9fb4cf), (0.35, 0x5c7fae), (-0.05, 0x2c4c82), (-0.5, 0x15264f)];
    let paper = srgb(0xf6efe0);
    let tone =
        wash.iter().fold(paper, |tone, (edge, hex)| tone.lerp(srgb(*hex), smooth(edge + 0.07, edge - 0.07, light)));
    // Light from behind leaves a strip before the line.
    let tone = tone.lerp(srgb(0x7b97bd), smooth(0.42, 0.25, n.z) * smooth(0.1, -0.3, light));
    tone.lerp(srgb(0x0d1430), smooth(0.24, 0.12, n.z))
}

/// Gouache over gold: olive shadows, a turquoise light from the right.
fn gilded(n: DVec3) -> DVec3 {
    let light = n.dot(key());
    let body = srgb(0x33300f)
        .lerp(srgb(0xa8791f), smooth(-0.3, 0.3, light))
        .lerp(srgb(0xf0c659), smooth(0.35, 0.8, light))
        .lerp(srgb(0xfff6cf), smooth(0.86, 0.97, light));
    let cool = n.dot(DVec3::new(0.86, -0.22, 0.2).normalize());
    body.lerp(srgb(0x3fa79a), 0.85 * smooth(0.72, 0.95, cool))
}

/// Linear color of the scene at a place, and what is there: a ball's number, or 3 for what is behind.
fn scene(p: DVec2, with_balls: bool) -> (DVec3, usize) {
    for (i, ball) in BALLS.iter().enumerate().filter(|_| with_balls) {
        let d = (p - ball.center) / ball.radius;
        if d.length_squared() <= 1.0 {
            let n = DVec3::new(d.x, -d.y, (1.0 - d.length_squared()).sqrt());
            return ((ball.shading)(n), i);
        }
    }
    let across = p.x / WIDTH as f64;
    let wall = srgb(0x55716c).lerp(srgb(0x2b3a40), smooth(0.1, 1.0, across)) * (0.75 + 0.35 * p.y / TABLE);
    let table = srgb(0xb98d5e).lerp(srgb(0x6d4a30), smooth(0.0, 1.0, 0.6 * across + 0.4 * (p.y - TABLE) / 170.0));
    let mut color = wall.lerp(table, smooth(TABLE - 3.0, TABLE + 3.0, p.y));
    if p.y > TABLE {
        for ball in &BALLS {
            let foot = ball.center + DVec2::new(0.62 * ball.radius, 0.9 * ball.radius);
            let d = (p - foot) / DVec2::new(1.15 * ball.radius, 0.3 * ball.radius);
            color = color.lerp(srgb(0x1d1414), 0.75 * smooth(1.15, 0.35, d.length()));
        }
    }
    (color, BALLS.len())
}

/// A number from 0 to 1 that belongs to `i`.
fn chance(i: u64, salt: u64) -> f64 {
    let mut x = i.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ salt.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 31)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 29)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// The scene in three layers of strokes, the finest last.
fn paint(with_balls: bool) -> Vec<DVec3> {
    let place = |i: usize| DVec2::new((i % WIDTH) as f64 + 0.5, (i / WIDTH) as f64 + 0.5);
    let mut canvas: Vec<DVec3> = (0..WIDTH * HEIGHT).map(|i| scene(place(i), with_balls).0).collect();
    for (layer, breadth) in [16.0, 9.0, 5.0].into_iter().enumerate() {
        let spacing = 0.55 * breadth;
        let (columns, rows) = ((WIDTH as f64 / spacing) as u64, (HEIGHT as f64 / spacing) as u64);
        let mut strokes: Vec<u64> = (0..columns * rows).collect();
        strokes.sort_by(|a, b| chance(*a, layer as u64).total_cmp(&chance(*b, layer as u64)));
        for i in strokes {
            let roll = |salt: u64| chance(i, 10 * (layer as u64 + 1) + salt);
            let at = DVec2::new((i % columns) as f64 + roll(1), (i / columns) as f64 + roll(2)) * spacing;
            let (color, what) = scene(at, with_balls);
            // Along the form: around the light on a ball, across the wall, along the table.
            let along = match BALLS.get(what) {
                Some(ball) => {
                    let lit = ball.center + ball.radius * 0.55 * DVec2::new(-0.7, -0.72);
                    (at - lit).perp().try_normalize().unwrap_or(DVec2::X)
                }
                None if at.y > TABLE => DVec2::new(1.0, 0.05).normalize(),
                None => DVec2::from_angle(-0.9 + 0.5 * roll(3)),
            };
            let color =
                (color * (0.86 + 0.28 * roll(4)) + DVec3::new(roll(5), roll(6), roll(7)) * 0.012).min(DVec3::ONE);
            let (half, thickness) = (breadth * (1.0 + roll(8)), 0.5 * breadth);
            let reach = half + thickness;
            let columns = (at.x - reach).max(0.0) as usize..((at.x + reach) as usize).min(WIDTH);
            for row in (at.y - reach).max(0.0) as usize..((at.y + reach) as usize).min(HEIGHT) {
                for column in columns.clone() {
                    let p = place(row * WIDTH + column);
                    let (u, v) = ((p - at).dot(along), (p - at).dot(along.perp()));
                    let end = (u.abs() - half).max(0.0);
                    let distance = end.hypot(v) / thickness;
                    if distance >= 1.0 || scene(p, with_balls).1 != what {
                        continue;
                    }
                    // Bristles leave streaks.
                    let bristle = 0.55 + 0.45 * chance((v * 1.3 + 64.0) as u64, i + 77);
                    let pixel = &mut canvas[row * WIDTH + column];
                    *pixel = pixel.lerp(color, 0.7 * bristle * smooth(1.0, 0.6, distance));
                }
            }
        }
    }
    canvas
}

fn opaque(canvas: &[DVec3]) -> impl Iterator<Item = [f32; 4]> {
    canvas.iter().map(|c| [c.x as f32, c.y as f32, c.z as f32, 1.0])
}

/// The painting, and below it the pictures where the balls were.
fn figure(skulls: &[String]) -> Result<Vec<[f32; 4]>> {
    let mut below: Vec<[f32; 4]> = opaque(&paint(false)).collect();
    for (ball, path) in BALLS.iter().zip(skulls) {
        let skull = read_png(Path::new(path))?;
        let corner = [ball.center.x, ball.center.y - 0.02 * ball.radius].map(|c| c as i64);
        for (i, pixel) in skull.pixels.iter().enumerate() {
            let x = corner[0] + (i % skull.width) as i64 - skull.width as i64 / 2;
            let y = corner[1] + (i / skull.width) as i64 - skull.height as i64 / 2;
            if (0..WIDTH as i64).contains(&x) && (0..HEIGHT as i64).contains(&y) {
                let behind = &mut below[y as usize * WIDTH + x as usize];
                *behind = std::array::from_fn(|c| pixel[c] + (1.0 - pixel[3]) * behind[c]);
            }
        }
    }
    let gap = vec![[1.0; 4]; 8 * WIDTH];
    Ok(opaque(&paint(true)).chain(gap).chain(below).map(premultiplied_from_straight).collect())
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (out, pixels) = match &arguments[..] {
        [out] => (out, opaque(&paint(true)).collect()),
        [out, skulls @ ..] if skulls.len() == BALLS.len() => (out, figure(skulls)?),
        _ => return Err(Error::scene("this needs a file to write, and none or three pictures", "see its first lines")),
    };
    let height = (pixels.len() / WIDTH) as u32;
    save_png(
        Path::new(out),
        WIDTH as u32,
        height,
        &pixels,
        &PngOptions { opaque: true, dpi: 144.0, ..PngOptions::default() },
    )
}
