//! Makes the lit-sphere pictures of `styles/`, their `index.json`, and the contact sheet `docs/images/styles.png`.
//! Nothing is random: the same program makes the same bytes. Run in the repository's root:
//!
//! `cargo run --release -p fabrica-engine --example make_styles`
//!
//! A new style is a function here or in `make_styles/families.rs`, a line in `STYLES` there, and its name in `embedded![]` of
//! `engine/src/styles.rs`.
//!
//! Illustrators light from the top left: a warm key, a cool fill from the right, light from the ground, and a rim
//! light from behind at the lower right, which keeps the shadow side apart from its neighbors. Shading is computed in
//! linear light. A style is looked up by the normal alone, so a rim is also the color of contours.

#[path = "make_styles/families.rs"]
mod families;

use std::f64::consts::PI;
use std::path::Path;

use fabrica_engine::color::{
    linear_from_srgb, linear_from_srgb8, premultiplied_from_straight, straight_srgb8_from_premultiplied_linear,
};
use fabrica_engine::image_out::{Picture, PngOptions, save_atomic, save_png};
use fabrica_engine::styles::{STYLE_SIZE, StyleImage, StyleInfo, normal_from_uv, uv_from_normal};
use fabrica_engine::{Error, Result};
use glam::{DVec2, DVec3, DVec4};
use rayon::prelude::*;

/// One style: name, title, description, tags, and straight linear RGBA of a unit normal with n_z ≥ 0.
type Style = (&'static str, &'static str, &'static str, &'static [&'static str], fn(DVec3) -> DVec4);

#[rustfmt::skip]
const STYLES: &[Style] = &[
    ("plaster", "Plaster", "White matte cast with soft shadows: the neutral choice for form studies.", &["neutral", "matte", "light"], plaster),
    ("clay", "Clay", "Warm gray modeling clay, matte: form without any claim of material.", &["neutral", "matte"], clay),
    ("porcelain", "Porcelain", "Glossy white glaze with a window in it: small precious things, teeth.", &["white", "glossy"], porcelain),
    ("bone", "Bone", "Dry ivory with warm shadows: skeleton and skull.", &["anatomy", "matte"], bone),
    ("cartilage", "Cartilage", "Pearly, bluish and a little translucent: cartilage, discs, ligaments.", &["anatomy", "glossy"], cartilage),
    ("skin", "Skin", "Light flesh with a red terminator: skin and surface anatomy.", &["anatomy", "soft"], skin),
    ("skin_deep", "Deep skin", "Dark brown skin with cool lights and red depths.", &["anatomy", "soft"], skin_deep),
    ("muscle", "Muscle", "Deep red with wet highlights: muscle and heart.", &["anatomy", "wet"], muscle),
    ("organ", "Organ", "Brown red, smooth and moist: liver, spleen, kidney.", &["anatomy", "wet"], organ),
    ("brain", "Brain", "Pinkish gray, soft, moist in the lights: brain and glands.", &["anatomy", "soft"], brain),
    ("fat", "Fat", "Buttery yellow, waxy and soft: fat and marrow.", &["anatomy", "soft"], fat),
    ("vessel", "Artery", "Glossy blood red: arteries by convention.", &["anatomy", "glossy", "convention"], vessel),
    ("vein", "Vein", "Glossy blue: veins by convention.", &["anatomy", "glossy", "convention"], vein),
    ("nerve", "Nerve", "Satin yellow: nerves by convention.", &["anatomy", "satin", "convention"], nerve),
    ("lymph", "Lymph", "Satin green: lymph vessels by convention.", &["anatomy", "satin", "convention"], lymph),
    ("wax", "Wax", "Honey wax with light inside: historic anatomical models.", &["soft", "warm"], wax),
    ("steel", "Steel", "Brushed steel with a dark horizon: implants, instruments, machines.", &["metal"], steel),
    ("chrome", "Chrome", "Mirror of a bright studio: the strongest of the metals.", &["metal", "glossy"], chrome),
    ("brass", "Brass", "Yellow metal with warm reflections.", &["metal", "warm"], brass),
    ("bronze", "Bronze", "Brown metal, soft highlights: castings and busts.", &["metal", "warm"], bronze),
    ("ink", "Ink", "Paper white with a brush contour, heavier in the shadow: the line drawing.", &["line", "paper"], ink),
    ("engraving", "Engraving", "Swelling engraved lines on warm paper: the old atlas plate.", &["line", "paper", "tone"], engraving),
    ("pencil", "Pencil", "Graphite strokes in tonal steps on toothy paper.", &["line", "paper", "tone"], pencil),
    ("sepia", "Sepia wash", "Brown wash that leaves the paper for lights and darkens at its edge.", &["paper", "tone", "warm"], sepia),
    ("cartoon", "Cartoon", "Three flat tones, a hard light and a contour.", &["line", "flat", "tone"], cartoon),
    ("cool_warm", "Cool to warm", "Tone shading: warm lights, cool shadows, all edges readable.", &["tone", "technical"], cool_warm),
    ("blueprint", "Blueprint", "Prussian blue with chalk-white contours.", &["line", "technical"], blueprint),
    ("chalk", "Chalk", "White chalk at the edges on nothing: for dark pages and overlays.", &["line", "transparent"], chalk),
    ("glass", "Glass", "Clear in the middle, bright at the rim, with a window's reflection: envelopes around what matters.", &["transparent", "glossy"], glass),
    ("xray", "X-ray", "Bluish shell, dense where the ray grazes it.", &["transparent", "technical"], xray),
    ("smoke", "Smoke", "Dark graphite veil, dense at the edges: ghosts on white pages.", &["transparent"], smoke),
    ("unshaded", "Unshaded", "One warm white for all directions: plain volume rendering.", &["flat"], |_| flat("f4f1ea")),
    ("unshaded_red", "Unshaded red", "One red for all directions.", &["flat"], |_| flat("c8402f")),
    ("unshaded_ochre", "Unshaded ochre", "One ochre for all directions.", &["flat"], |_| flat("dba545")),
    ("unshaded_green", "Unshaded green", "One green for all directions.", &["flat"], |_| flat("5f9560")),
    ("unshaded_blue", "Unshaded blue", "One blue for all directions.", &["flat"], |_| flat("3568ad")),
];

// --- Light ---

/// Towards the key light: above, left, in front.
fn key() -> DVec3 {
    DVec3::new(-0.57, 0.64, 0.51).normalize()
}

/// Towards the fill light: right, a little in front.
fn fill() -> DVec3 {
    DVec3::new(0.78, 0.05, 0.45).normalize()
}

const KEY_COLOR: DVec3 = DVec3::new(1.0, 0.955, 0.89);
const FILL_COLOR: DVec3 = DVec3::new(0.80, 0.90, 1.0);
const SKY: DVec3 = DVec3::new(0.88, 0.95, 1.0);
const GROUND: DVec3 = DVec3::new(1.0, 0.86, 0.72);

/// Linear color of an `rrggbb` sRGB literal.
fn hex(code: &str) -> DVec3 {
    let channel = |i| u8::from_str_radix(&code[i..i + 2], 16).map_or(0.0, |v| linear_from_srgb(f64::from(v) / 255.0));
    DVec3::new(channel(0), channel(2), channel(4))
}

fn flat(code: &str) -> DVec4 {
    hex(code).extend(1.0)
}

fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn pow(base: DVec3, exponent: f64) -> DVec3 {
    base.max(DVec3::ZERO).powf(exponent)
}

/// |n_xy|: 0 in the middle, 1 at the rim.
fn radius(n: DVec3) -> f64 {
    n.truncate().length().min(1.0)
}

/// Schlick's 1 − cos to the fifth.
fn fresnel(n: DVec3) -> f64 {
    (1.0 - n.z).clamp(0.0, 1.0).powi(5)
}

/// Diffuse light that wraps around by `w` (0: Lambert's law, 1: a hemisphere of light), of equal total energy.
fn wrapped(cosine: f64, w: f64) -> f64 {
    let x = ((cosine + w) / (1.0 + w)).max(0.0);
    // The power keeps the turn into the shadow soft, with zero slope, whatever w is.
    x.powf(1.0 + w) / (1.0 + 0.25 * w)
}

/// GGX highlight of one light, times π·cos (so that it adds to albedo × cosine).
fn highlight(n: DVec3, light: DVec3, roughness: f64, f0: f64) -> f64 {
    let half = (light + DVec3::Z).normalize();
    let (nl, nv, nh) = (n.dot(light).max(0.0), n.z.max(1e-3), n.dot(half).max(0.0));
    let a2 = roughness.powi(4);
    let d = a2 / (PI * (nh * nh * (a2 - 1.0) + 1.0).powi(2));
    let visibility = 0.5 / (nl * (nv * nv * (1.0 - a2) + a2).sqrt() + nv * (nl * nl * (1.0 - a2) + a2).sqrt() + 1e-6);
    let f = f0 + (1.0 - f0) * (1.0 - half.z).powi(5);
    PI * d * visibility * f * nl
}

/// Rolls values above 0.75 off towards 1 and lets strong lights lose saturation, as film and pigment do.
fn shoulder(c: DVec3) -> DVec3 {
    const KNEE: f64 = 0.75;
    let roll =
        |x: f64| if x <= KNEE { x.max(0.0) } else { KNEE + (1.0 - KNEE) * (1.0 - (-(x - KNEE) / (1.0 - KNEE)).exp()) };
    let peak = c.max_element();
    let bleached = if peak > 1.0 { c.lerp(DVec3::splat(peak), ((peak - 1.0) * 0.35).min(0.6)) } else { c };
    DVec3::new(roll(bleached.x), roll(bleached.y), roll(bleached.z))
}

/// What mirrors reflect: a studio with a gradient sky, a dark horizon, a warm floor, a softbox at the key and a strip at
/// the right. `blur` (0…1) softens all edges.
fn studio(reflected: DVec3, blur: f64) -> DVec3 {
    let edge = 0.03 + 0.5 * blur;
    let height = reflected.y;
    let sky = hex("dfe6ee").lerp(hex("7f93a8"), smoothstep(0.0, 1.0, height));
    let floor = hex("2a2522").lerp(hex("b5a594"), smoothstep(-0.02 - 0.1 * blur, -1.2, height));
    let room = floor.lerp(sky, smoothstep(-edge, edge, height + 0.06));
    let strip = smoothstep(0.60 - edge, 0.66 + edge, reflected.x)
        * smoothstep(-0.75 - edge, -0.6 + edge, height)
        * smoothstep(0.0, 0.5, reflected.z + 0.75);
    room + KEY_COLOR * 2.4 * softbox(reflected, 0.55, 0.45, edge) + FILL_COLOR * 0.7 * strip
}

/// A rectangular light around the key, `width` and `height` (tangents of half angles), by reflected direction.
fn softbox(reflected: DVec3, width: f64, height: f64, edge: f64) -> f64 {
    let (u, v) = softbox_coordinates(reflected);
    let side = |x: f64, half: f64| smoothstep(half + edge, half - edge, x.abs());
    if reflected.dot(key()) <= 0.05 { 0.0 } else { side(u, width) * side(v, height) }
}

fn softbox_coordinates(reflected: DVec3) -> (f64, f64) {
    let light = key();
    let right = DVec3::Y.cross(light).normalize();
    let up = light.cross(right);
    let depth = reflected.dot(light).max(1e-3);
    (reflected.dot(right) / depth, reflected.dot(up) / depth)
}

fn reflect(n: DVec3) -> DVec3 {
    2.0 * n.z * n - DVec3::Z
}

/// A pigmented, perhaps translucent, perhaps glossy material.
struct Material {
    albedo: DVec3,
    /// How far red, green and blue light creep around the terminator: translucency.
    wrap: DVec3,
    /// Light that comes through from the far side, its color included.
    glow: DVec3,
    roughness: f64,
    /// Reflectance head-on: 0 is matte, 0.04 skin and glaze.
    gloss: f64,
    /// Broad second highlight (a wet film over soft tissue has both).
    sheen: f64,
    /// Rim light from behind.
    rim: DVec3,
    /// Light scattered along the terminator: the red seam between light and shadow on skin.
    seam: DVec3,
    /// How much the last tenth of the disc darkens towards a saturated shade: the contour.
    edge: f64,
    ambient: f64,
}

impl Material {
    fn matte(code: &str) -> Self {
        Self {
            albedo: hex(code),
            wrap: DVec3::splat(0.12),
            glow: DVec3::ZERO,
            seam: DVec3::ZERO,
            roughness: 0.6,
            gloss: 0.0,
            sheen: 0.0,
            rim: DVec3::new(0.75, 0.86, 1.0) * 0.22,
            edge: 0.45,
            ambient: 0.085,
        }
    }

    fn shade(&self, n: DVec3) -> DVec4 {
        let (k, f) = (key(), fill());
        let cosine = n.dot(k);
        let direct =
            DVec3::new(wrapped(cosine, self.wrap.x), wrapped(cosine, self.wrap.y), wrapped(cosine, self.wrap.z));
        let fill_light = wrapped(n.dot(f), 0.2) * 0.05;
        let hemisphere = GROUND.lerp(SKY, 0.5 + 0.5 * n.y) * self.ambient * (0.75 + 0.25 * n.y);
        let floor_bounce = GROUND * 0.06 * (-n.y).max(0.0).powi(2);
        // Light that bounces within shadows is colored once more each time: shadows are richer, not grayer.
        let shadow = 1.0 - direct.element_sum() / 3.0;
        let albedo = pow(self.albedo, 1.0 + 0.30 * shadow.clamp(0.0, 1.0));
        let mut color = albedo * (KEY_COLOR * direct * 1.06 + FILL_COLOR * fill_light + hemisphere + floor_bounce);

        // Through the body: strongest opposite the light, where the body is thin.
        let through = smoothstep(-0.2, 1.0, -cosine) * (0.35 + 0.65 * radius(n).powi(3));
        color += self.glow * through + self.seam * (-((cosine + 0.06) / 0.26).powi(2)).exp();

        // Contour: saturated and dark, less so where the key meets the rim.
        let rim_position = smoothstep(0.80, 1.0, radius(n));
        let contour = self.edge * rim_position * rim_position * (0.55 + 0.45 * smoothstep(0.6, -0.6, cosine));
        color *= pow(self.albedo / self.albedo.max_element(), 0.8 * contour) * (1.0 - contour);

        // Rim light sits inside the contour, at the lower right.
        let behind = DVec2::new(0.74, -0.67).dot(n.truncate());
        let band = smoothstep(0.74, 0.94, radius(n)) * smoothstep(1.02, 0.95, radius(n));
        color += self.rim * band * smoothstep(0.25, 0.95, behind) * self.albedo * (0.35 + 0.80 * self.albedo);

        if self.gloss > 0.0 {
            let specular = highlight(n, k, self.roughness, self.gloss) * 1.1
                + highlight(n, f, (self.roughness * 1.7).min(0.6), self.gloss) * 0.16;
            // Tissue is never a mirror: of the room only broad sky and floor are left, and those at the rim.
            let mirror = (0.35 * self.gloss + 0.40 * fresnel(n)) * (1.0 - self.roughness) * (1.0 - 0.8 * contour);
            color +=
                KEY_COLOR * specular.min(3.0) + GROUND.lerp(SKY, smoothstep(-0.9, 0.9, reflect(n).y)) * 0.45 * mirror;
        }
        if self.sheen > 0.0 {
            color += KEY_COLOR * self.sheen * highlight(n, k, 0.55, 0.06);
        }
        shoulder(color).extend(1.0)
    }
}

// --- Grain ---

/// Hash of a lattice point to 0…1.
fn hash(x: i64, y: i64) -> f64 {
    let mut h = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    h = (h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ (h >> 32)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((h ^ (h >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Smooth noise 0…1 with unit cells.
fn noise(p: DVec2) -> f64 {
    let cell = p.floor();
    let (x, y) = (cell.x as i64, cell.y as i64);
    let t = p - cell;
    let (u, v) = (t.x * t.x * (3.0 - 2.0 * t.x), t.y * t.y * (3.0 - 2.0 * t.y));
    let low = hash(x, y) * (1.0 - u) + hash(x + 1, y) * u;
    let high = hash(x, y + 1) * (1.0 - u) + hash(x + 1, y + 1) * u;
    low * (1.0 - v) + high * v
}

// --- Materials ---

fn plaster(n: DVec3) -> DVec4 {
    Material { wrap: DVec3::new(0.2, 0.17, 0.14), ambient: 0.11, edge: 0.4, ..Material::matte("f4f0e8") }.shade(n)
}

fn clay(n: DVec3) -> DVec4 {
    Material {
        wrap: DVec3::new(0.2, 0.16, 0.12),
        gloss: 0.02,
        roughness: 0.62,
        edge: 0.42,
        ..Material::matte("a8978a")
    }
    .shade(n)
}

fn porcelain(n: DVec3) -> DVec4 {
    let body = Material { wrap: DVec3::splat(0.26), ambient: 0.16, edge: 0.5, ..Material::matte("f4f6f7") }
        .shade(n)
        .truncate();
    let reflected = reflect(n);
    let (u, v) = softbox_coordinates(reflected);
    // A window with a cross bar, and the soft light of the room opposite.
    let bars = smoothstep(0.025, 0.055, u.abs()) * smoothstep(0.025, 0.055, v.abs());
    let window = softbox(reflected, 0.42, 0.48, 0.035) * bars;
    let mirror = 0.03 + 0.55 * fresnel(n);
    let opposite = highlight(n, DVec3::new(0.80, -0.35, 0.45).normalize(), 0.34, 0.05) * 0.22;
    let color = body * (1.0 - mirror) + studio(reflected, 0.7) * mirror + DVec3::splat(window * 0.85) + SKY * opposite;
    shoulder(color).extend(1.0)
}

fn bone(n: DVec3) -> DVec4 {
    Material {
        seam: hex("d07a3a") * 0.05,
        wrap: DVec3::new(0.32, 0.22, 0.12),
        glow: hex("8a4f22") * 0.08,
        gloss: 0.028,
        roughness: 0.46,
        sheen: 0.3,
        edge: 0.55,
        ambient: 0.095,
        ..Material::matte("efe4cd")
    }
    .shade(n)
}

fn cartilage(n: DVec3) -> DVec4 {
    Material {
        wrap: DVec3::new(0.15, 0.3, 0.42),
        glow: hex("7fb6cc") * 0.16,
        gloss: 0.05,
        roughness: 0.26,
        sheen: 0.9,
        ambient: 0.115,
        edge: 0.45,
        ..Material::matte("c9dbe0")
    }
    .shade(n)
}

fn skin(n: DVec3) -> DVec4 {
    Material {
        seam: hex("e0402c") * 0.13,
        wrap: DVec3::new(0.46, 0.18, 0.10),
        glow: hex("b0301c") * 0.09,
        gloss: 0.03,
        roughness: 0.42,
        sheen: 0.35,
        edge: 0.5,
        ambient: 0.09,
        ..Material::matte("f0bd9e")
    }
    .shade(n)
}

fn skin_deep(n: DVec3) -> DVec4 {
    Material {
        seam: hex("b83a20") * 0.05,
        wrap: DVec3::new(0.36, 0.16, 0.08),
        glow: hex("7c2414") * 0.08,
        gloss: 0.045,
        roughness: 0.36,
        sheen: 1.0,
        rim: DVec3::new(0.55, 0.75, 1.0) * 0.7,
        edge: 0.45,
        ..Material::matte("8f5a3b")
    }
    .shade(n)
}

fn muscle(n: DVec3) -> DVec4 {
    Material {
        wrap: DVec3::new(0.4, 0.08, 0.08),
        glow: hex("a01810") * 0.08,
        gloss: 0.06,
        roughness: 0.25,
        sheen: 2.0,
        rim: DVec3::new(1.0, 0.75, 0.8) * 0.5,
        edge: 0.5,
        ..Material::matte("bf3d36")
    }
    .shade(n)
}

fn organ(n: DVec3) -> DVec4 {
    Material {
        wrap: DVec3::new(0.34, 0.12, 0.14),
        glow: hex("6a1a18") * 0.10,
        gloss: 0.06,
        roughness: 0.32,
        sheen: 2.2,
        rim: DVec3::new(0.85, 0.85, 1.0) * 0.6,
        edge: 0.45,
        ..Material::matte("8d4436")
    }
    .shade(n)
}

fn brain(n: DVec3) -> DVec4 {
    Material {
        seam: hex("c83c46") * 0.06,
        wrap: DVec3::new(0.42, 0.22, 0.24),
        glow: hex("b5505a") * 0.09,
        gloss: 0.035,
        roughness: 0.3,
        sheen: 0.6,
        edge: 0.6,
        ambient: 0.10,
        ..Material::matte("e2beb5")
    }
    .shade(n)
}

fn fat(n: DVec3) -> DVec4 {
    Material {
        wrap: DVec3::new(0.55, 0.36, 0.1),
        glow: hex("d98a1e") * 0.12,
        gloss: 0.045,
        roughness: 0.36,
        sheen: 0.6,
        edge: 0.42,
        ambient: 0.095,
        ..Material::matte("f6d678")
    }
    .shade(n)
}

fn tube(code: &str, glow: &str, roughness: f64) -> Material {
    Material {
        wrap: DVec3::splat(0.16),
        glow: hex(glow) * 0.12,
        gloss: 0.06,
        roughness,
        sheen: 1.0,
        rim: DVec3::new(0.9, 0.93, 1.0) * 0.5,
        edge: 0.55,
        ..Material::matte(code)
    }
}

fn vessel(n: DVec3) -> DVec4 {
    tube("d8231c", "c01008", 0.22).shade(n)
}

fn vein(n: DVec3) -> DVec4 {
    tube("4274c8", "2a4fae", 0.22).shade(n)
}

fn nerve(n: DVec3) -> DVec4 {
    tube("efbe2e", "c87a10", 0.36).shade(n)
}

fn lymph(n: DVec3) -> DVec4 {
    tube("6fae5a", "3f8a3a", 0.36).shade(n)
}

fn wax(n: DVec3) -> DVec4 {
    Material {
        seam: hex("ff8a2a") * 0.12,
        wrap: DVec3::new(1.0, 0.52, 0.16),
        glow: hex("ff9a2c") * 0.75,
        gloss: 0.045,
        roughness: 0.3,
        sheen: 0.7,
        edge: 0.16,
        ambient: 0.09,
        ..Material::matte("f3bf72")
    }
    .shade(n)
}

// --- Metals ---

/// Reflects the studio; metals color what they reflect, and less so at grazing angles.
fn metal(n: DVec3, tint: DVec3, blur: f64, contrast: f64) -> DVec4 {
    let room = studio(reflect(n), blur);
    // A blue sky in yellow metal is olive: the more color the metal has, the more neutral the room.
    let gray = DVec3::splat(room.dot(DVec3::new(0.2126, 0.7152, 0.0722)));
    let room = room.lerp(gray, (1.0 - tint.min_element() / tint.max_element()).clamp(0.0, 1.0));
    // Contrast around middle gray, as a power: a difference would clip the horizon to a hard bar.
    let room = 0.42 * pow(room / 0.42, contrast);
    let reflectance = tint + (DVec3::ONE - tint) * fresnel(n) * 0.6;
    let glint = highlight(n, key(), 0.10 + 0.5 * blur, 0.9) * 0.25;
    let edge = 1.0 - 0.75 * smoothstep(0.90, 1.0, radius(n));
    shoulder((room * reflectance + KEY_COLOR.lerp(tint, 0.3) * glint) * edge).extend(1.0)
}

fn chrome(n: DVec3) -> DVec4 {
    metal(n, hex("eef2f6"), 0.03, 1.15)
}

fn steel(n: DVec3) -> DVec4 {
    metal(n, hex("a9b0b8"), 0.80, 1.45)
}

fn brass(n: DVec3) -> DVec4 {
    metal(n, hex("efb84e"), 0.24, 1.10)
}

fn bronze(n: DVec3) -> DVec4 {
    metal(n, hex("ad6b42"), 0.60, 1.25)
}

// --- Drawing ---

/// 1 where a brush contour lies: `thin` wide at the lit rim, `thick` in the shadow.
fn contour(n: DVec3, thin: f64, thick: f64) -> f64 {
    let shade = smoothstep(0.75, -0.75, n.truncate().dot(key().truncate().normalize()));
    let width = thin + (thick - thin) * shade;
    smoothstep(1.0 - width - 0.008, 1.0 - width + 0.008, radius(n))
}

/// Light on a drawn ball, 0…1: what tonal techniques translate.
fn tone(n: DVec3) -> f64 {
    let light = wrapped(n.dot(key()), 0.30);
    let reflected = 0.16 * smoothstep(0.5, 1.0, DVec2::new(0.74, -0.67).dot(n.truncate()));
    (0.06 + 0.92 * light + reflected).clamp(0.0, 1.0)
}

fn ink(n: DVec3) -> DVec4 {
    hex("fffdf8").lerp(hex("1c1815"), contour(n, 0.045, 0.17)).extend(1.0)
}

fn engraving(n: DVec3) -> DVec4 {
    let dark = 1.0 - tone(n);
    // Lines run around an axis that leans towards the viewer, so that they bend with the form.
    let line = |axis: DVec3, count: f64, amount: f64| {
        let phase = n.dot(axis.normalize()).clamp(-1.0, 1.0).acos() / PI * count;
        let distance = (phase - phase.round()).abs() * 2.0;
        smoothstep(amount + 0.12, amount - 0.12, distance) * smoothstep(0.01, 0.12, amount)
    };
    let first = line(DVec3::new(0.50, 0.84, -0.28), 27.0, 0.86 * smoothstep(0.04, 0.95, dark));
    let second = line(DVec3::new(-0.80, 0.50, -0.30), 27.0, 0.62 * smoothstep(0.62, 1.0, dark));
    let covered = 1.0 - (1.0 - first) * (1.0 - second) * (1.0 - contour(n, 0.018, 0.06));
    hex("fbf5e6").lerp(hex("2a211b"), covered).extend(1.0)
}

fn pencil(n: DVec3) -> DVec4 {
    let p = n.truncate() * 128.0;
    // Strokes of a slightly blunt lead: long cells along the stroke, tooth of the paper across all of them.
    let stroke = |angle: f64, offset: f64| {
        let turned = DVec2::from_angle(angle).rotate(p);
        let row = (turned.y / 3.4).floor();
        noise(DVec2::new(turned.x / 26.0 + 17.0 * hash(row as i64, 5), turned.y / 1.7 + offset))
    };
    let tooth = 0.65 * noise(p / 1.35) + 0.35 * noise(p / 2.9 + 90.0);
    let dark = 1.0 - tone(n);
    // Layers of graphite: each begins at a darker tone, which gives the steps.
    let layers = [
        (0.10, 0.34, stroke(-0.80, 0.0)),
        (0.34, 0.42, stroke(-0.62, 50.0)),
        (0.58, 0.52, stroke(-1.15, 90.0)),
        (0.80, 0.60, tooth),
    ];
    let mut covered = 0.0;
    for (begin, strength, grain) in layers {
        let pressure = smoothstep(begin - 0.08, begin + 0.24, dark);
        let deposit = strength * pressure * smoothstep(0.10, 0.80, 0.45 * grain + 0.40 * tooth + 0.30 * pressure);
        covered = 1.0 - (1.0 - covered) * (1.0 - deposit);
    }
    let line = contour(n, 0.020, 0.055) * (0.50 + 0.45 * tooth);
    covered = 1.0 - (1.0 - covered) * (1.0 - line * 0.85);
    hex("fbf9f4").lerp(hex("2b2c32"), covered.min(0.96)).extend(1.0)
}

/// Pigment on paper by absorption (Beer-Lambert): twice the wash is the square of its color.
fn wash(pigment: DVec3, density: f64) -> DVec3 {
    hex("fdf9ef") * pow(pigment, density)
}

fn sepia(n: DVec3) -> DVec4 {
    let p = n.truncate();
    let bloom = noise(p * 4.0 + 7.0) * 0.6 + noise(p * 9.0 + 31.0) * 0.4 - 0.5;
    let dark = 1.0 - tone(n);
    // Two washes with soft fronts, laid on dry, and the line where the pigment gathers at the edge.
    let first = smoothstep(0.10, 0.50, dark + 0.10 * bloom);
    let second = smoothstep(0.48, 0.90, dark + 0.14 * bloom);
    let gathered = smoothstep(0.86, 0.995, radius(n)).powi(2) * (0.35 + 0.65 * dark);
    let density = 0.06 + 0.42 * first + 0.85 * second + 0.95 * gathered;
    wash(hex("9a6a45"), density * (1.0 + 0.18 * bloom) * 1.35).extend(1.0)
}

fn cartoon(n: DVec3) -> DVec4 {
    let cosine = n.dot(key());
    let mut color = if cosine > 0.52 {
        hex("f7c873")
    } else if cosine > -0.02 {
        hex("e0923f")
    } else {
        hex("a4552b")
    };
    let half = (key() + DVec3::Z).normalize();
    if n.dot(half) > 0.972 {
        color = hex("fff6df");
    }
    color.lerp(hex("2b1710"), contour(n, 0.075, 0.14)).extend(1.0)
}

fn cool_warm(n: DVec3) -> DVec4 {
    let t = 0.5 + 0.5 * n.dot(key());
    let (cool, middle, warm) = (hex("2c4fa3"), hex("a99aa6"), hex("ffd98a"));
    let color = if t < 0.55 {
        cool.lerp(middle, smoothstep(0.05, 0.55, t))
    } else {
        middle.lerp(warm, smoothstep(0.55, 1.0, t))
    };
    let gloss = highlight(n, key(), 0.28, 0.05);
    let edge = smoothstep(0.90, 0.975, radius(n));
    shoulder((color + DVec3::splat(gloss)).lerp(hex("161f45"), 0.8 * edge)).extend(1.0)
}

fn blueprint(n: DVec3) -> DVec4 {
    let light = wrapped(n.dot(key()), 0.5);
    let color = hex("0f2f66").lerp(hex("3a6ab2"), 0.85 * light).lerp(hex("7fa9e0"), 0.25 * fresnel(n));
    color.lerp(hex("f3f8ff"), 0.96 * smoothstep(0.925, 0.945, radius(n))).extend(1.0)
}

// --- Transparent ---

fn chalk(n: DVec3) -> DVec4 {
    let p = n.truncate() * 128.0;
    let grain = 0.5 * noise(p / 2.0 + 11.0)
        + 0.3 * noise(p / 4.5)
        + 0.2 * noise(DVec2::new(p.dot(DVec2::new(0.7, 0.7)) / 18.0, p.dot(DVec2::new(-0.7, 0.7)) / 3.0));
    let rim = radius(n).powf(7.0);
    let lit = 0.16 * wrapped(n.dot(key()), 0.2).powi(2) * smoothstep(0.25, 0.75, radius(n));
    let pressure = (rim + lit).min(1.0);
    // Little pressure leaves chalk on the tooth of the board only.
    let deposit = pressure * (0.55 + 0.45 * smoothstep(0.75 - pressure, 1.05 - 0.75 * pressure, grain + 0.25));
    hex("fbfaf5").extend(deposit.clamp(0.0, 1.0))
}

/// Opacity of a thin shell: its path length grows as the view grazes it. About 0 in the middle, nearly 1 at the rim.
fn shell(n: DVec3, density: f64) -> f64 {
    const SOFT: f64 = 0.13;
    1.0 - (-density * (1.0 / (n.z + SOFT) - 0.95 / (1.0 + SOFT))).exp()
}

/// `over` on top of `under`, both straight.
fn composite(over: DVec4, under: DVec4) -> DVec4 {
    let alpha = over.w + under.w * (1.0 - over.w);
    if alpha <= 0.0 {
        return DVec4::ZERO;
    }
    ((over.truncate() * over.w + under.truncate() * under.w * (1.0 - over.w)) / alpha).extend(alpha)
}

fn glass(n: DVec3) -> DVec4 {
    let reflected = reflect(n);
    // The wall's path length: thin in the middle, long at the rim.
    let wall = 0.05 + 0.95 * shell(n, 0.20);
    let body = hex("6aa3b2").lerp(hex("d9eff3"), smoothstep(0.82, 0.97, radius(n))).extend(wall);
    let dark_line = hex("2c5562").extend(0.7 * smoothstep(0.93, 1.0, radius(n)) * smoothstep(0.6, -0.4, n.dot(key())));
    let (u, v) = softbox_coordinates(reflected);
    let bars = smoothstep(0.02, 0.06, u.abs()) * smoothstep(0.02, 0.06, v.abs());
    let window = DVec3::ONE.extend(0.92 * softbox(reflected, 0.40, 0.46, 0.05) * bars);
    // Light gathered by the ball falls on its far side.
    let gathered = DVec2::new(0.70, -0.71).dot(n.truncate());
    let crescent = smoothstep(0.62, 0.86, gathered) * smoothstep(0.985, 0.90, radius(n));
    let glow = hex("f2fdff").extend(0.62 * crescent);
    composite(window, composite(glow, composite(dark_line, body)))
}

fn xray(n: DVec3) -> DVec4 {
    let density = shell(n, 0.60);
    hex("2a6cc4").lerp(hex("c4e6ff"), smoothstep(0.15, 0.92, density)).extend(density)
}

fn smoke(n: DVec3) -> DVec4 {
    let light = wrapped(n.dot(key()), 0.8);
    hex("1d2028").lerp(hex("7d8592"), 0.7 * light).extend(0.92 * shell(n, 0.55))
}

// --- Pictures ---

/// Sub-samples a side and texel.
const NUM_SUB: usize = 6;

/// Straight linear RGBA of a style, antialiased: inside the disc all texels are covered; those beyond the outermost
/// texel centers fade to nothing (only galleries see them, the loader replaces them).
fn render(shade: fn(DVec3) -> DVec4) -> Picture {
    let size = STYLE_SIZE;
    let pixels = (0..size * size)
        .into_par_iter()
        .map(|i| {
            let (column, row) = ((i % size) as f64, (i / size) as f64);
            let center = DVec2::new(column, row) + 0.5 - size as f64 / 2.0;
            let coverage = (size as f64 / 2.0 + 0.5 - center.length()).clamp(0.0, 1.0);
            let is_rim = center.length() > (size as f64 - 1.0) / 2.0;
            let coverage = if is_rim { coverage } else { 1.0 };
            if coverage == 0.0 {
                return [0.0; 4];
            }
            let mut sum = DVec4::ZERO;
            for sub in 0..NUM_SUB * NUM_SUB {
                let offset = |k: usize| (k as f64 + 0.5) / NUM_SUB as f64;
                let uv = [column + offset(sub % NUM_SUB), row + offset(sub / NUM_SUB)].map(|v| v / size as f64);
                let n_xy = DVec2::from(normal_from_uv(uv, size)).clamp_length_max(1.0);
                let n = n_xy.extend((1.0 - n_xy.length_squared()).max(0.0).sqrt());
                let color = shade(n);
                sum += (color.truncate() * color.w).extend(color.w);
            }
            let sum = sum / (NUM_SUB * NUM_SUB) as f64;
            if sum.w <= 0.0 {
                return [0.0; 4];
            }
            (sum.truncate() / sum.w).extend(sum.w * coverage).as_vec4().to_array()
        })
        .collect();
    Picture { width: size, height: size, pixels }
}

// --- Contact sheet ---

const PANEL: usize = 64;
const MARGIN: usize = 14;
const CAPTION: usize = 22;
const COLUMNS: usize = 4;

/// 5 × 7 letters, rows from the top, for captions: the one text of this program is too little for a font.
fn glyph(letter: char) -> [u8; 7] {
    match letter {
        'a' => [0, 0, 0b01110, 0b00001, 0b01111, 0b10001, 0b01111],
        'b' => [0b10000, 0b10000, 0b11110, 0b10001, 0b10001, 0b10001, 0b11110],
        'c' => [0, 0, 0b01110, 0b10001, 0b10000, 0b10001, 0b01110],
        'd' => [0b00001, 0b00001, 0b01111, 0b10001, 0b10001, 0b10001, 0b01111],
        'e' => [0, 0, 0b01110, 0b10001, 0b11111, 0b10000, 0b01110],
        'f' => [0b00110, 0b01000, 0b11110, 0b01000, 0b01000, 0b01000, 0b01000],
        'g' => [0, 0b01111, 0b10001, 0b10001, 0b01111, 0b00001, 0b01110],
        'h' => [0b10000, 0b10000, 0b11110, 0b10001, 0b10001, 0b10001, 0b10001],
        'i' => [0b00100, 0, 0b01100, 0b00100, 0b00100, 0b00100, 0b01110],
        'k' => [0b10000, 0b10000, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010],
        'l' => [0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
        'm' => [0, 0, 0b11010, 0b10101, 0b10101, 0b10101, 0b10101],
        'n' => [0, 0, 0b11110, 0b10001, 0b10001, 0b10001, 0b10001],
        'o' => [0, 0, 0b01110, 0b10001, 0b10001, 0b10001, 0b01110],
        'p' => [0, 0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000],
        'r' => [0, 0, 0b10110, 0b11000, 0b10000, 0b10000, 0b10000],
        's' => [0, 0, 0b01111, 0b10000, 0b01110, 0b00001, 0b11110],
        't' => [0b01000, 0b01000, 0b11110, 0b01000, 0b01000, 0b01000, 0b00110],
        'u' => [0, 0, 0b10001, 0b10001, 0b10001, 0b10001, 0b01111],
        'v' => [0, 0, 0b10001, 0b10001, 0b10001, 0b01010, 0b00100],
        'w' => [0, 0, 0b10001, 0b10001, 0b10101, 0b10101, 0b01010],
        'x' => [0, 0, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001],
        'y' => [0, 0b10001, 0b10001, 0b10001, 0b01111, 0b00001, 0b01110],
        'z' => [0, 0, 0b11111, 0b00010, 0b00100, 0b01000, 0b11111],
        '_' => [0, 0, 0, 0, 0, 0, 0b11111],
        _ => [0b11111; 7],
    }
}

/// A knotted tube with grooves, seen from the front: per sub-sample of a panel (2 × 2 a pixel) its normal. Spheres
/// flatter a style; this shows how it turns over real forms.
fn knot(size: usize) -> Vec<Option<DVec3>> {
    let distance = |p: DVec3| {
        let angle = p.y.atan2(p.x);
        let ring = DVec2::new(p.truncate().length() - 0.66, p.z);
        let turned = DVec2::from_angle(angle * 1.5).rotate(ring);
        let strand = DVec2::new(turned.x.abs() - 0.235, turned.y);
        let groove = 0.012 * (strand.y.atan2(strand.x) * 3.0 + angle * 12.0).sin();
        (strand.length() - 0.165 - groove) * 0.6
    };
    let samples = size * 2;
    (0..samples * samples)
        .into_par_iter()
        .map(|i| {
            let at = |k: usize| ((k as f64 + 0.5) / samples as f64 - 0.5) * 2.16;
            let mut p = DVec3::new(at(i % samples), -at(i / samples), 1.2);
            for _ in 0..160 {
                let d = distance(p);
                if d < 2e-4 {
                    let h = 1e-4;
                    let slope = |e: DVec3| distance(p + e * h) - distance(p - e * h);
                    let n = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z)).normalize();
                    return Some(if n.z < 0.0 { (n.truncate().normalize_or_zero()).extend(0.0) } else { n });
                }
                p.z -= d;
                if p.z < -1.2 {
                    break;
                }
            }
            None
        })
        .collect()
}

fn lookup(style: &StyleImage, n: DVec3) -> DVec4 {
    let [u, v] = uv_from_normal([n.x, n.y], style.size);
    let texel = |t: f64| ((t * style.size as f64) as usize).min(style.size - 1);
    glam::Vec4::from(style.mips[0][texel(v) * style.size + texel(u)]).as_dvec4()
}

/// Each style as a sphere on white, a sphere on a dark page, and the knot on both halves.
fn contact_sheet(styles: &[StyleImage], path: &Path) -> Result<()> {
    let rows = styles.len().div_ceil(COLUMNS);
    let (cell_width, cell_height) = (3 * PANEL + MARGIN, PANEL + CAPTION + MARGIN);
    let (width, height) = (COLUMNS * cell_width + MARGIN, rows * cell_height + MARGIN);
    let (page, white, dark) = (hex("e9e7e2"), hex("ffffff"), hex("1f2329"));
    let mut pixels = vec![page; width * height];
    let knot = knot(PANEL);
    for (i, style) in styles.iter().enumerate() {
        let (left, top) = (MARGIN + i % COLUMNS * cell_width, MARGIN + i / COLUMNS * cell_height);
        for y in 0..PANEL {
            for x in 0..3 * PANEL {
                let (panel, in_panel) = (x / PANEL, x % PANEL);
                let background = if panel == 0 || (panel == 2 && in_panel >= PANEL / 2) { white } else { dark };
                let mut color = DVec3::ZERO;
                for sub in 0..4 {
                    let (column, row) = (2 * in_panel + sub % 2, 2 * y + sub / 2);
                    let normal = if panel == 2 {
                        knot[row * 2 * PANEL + column]
                    } else {
                        let at = |k: usize| ((k as f64 + 0.5) / PANEL as f64 - 1.0) * 1.07;
                        let n = DVec2::new(at(column), -at(row));
                        (n.length() <= 1.0).then(|| n.extend((1.0 - n.length_squared()).sqrt()))
                    };
                    let over = normal.map_or(DVec4::ZERO, |n| lookup(style, n));
                    color += (over.truncate() + background * (1.0 - over.w)) / 4.0;
                }
                pixels[(top + y) * width + left + x] = color;
            }
        }
        for (k, letter) in style.name.chars().enumerate() {
            for (y, bits) in glyph(letter).into_iter().enumerate() {
                for x in (0..5).filter(|x| bits >> (4 - x) & 1 == 1) {
                    for (dx, dy) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                        let descent = if matches!(letter, 'g' | 'p' | 'y') { 4 } else { 0 };
                        let (column, row) = (left + 12 * k + 2 * x + dx, top + PANEL + 5 + descent + 2 * y + dy);
                        pixels[row * width + column] = hex("3a3733");
                    }
                }
            }
        }
    }
    let pixels: Vec<[f32; 4]> = pixels.into_iter().map(|c| c.extend(1.0).as_vec4().to_array()).collect();
    let options = PngOptions { dpi: 144.0, opaque: true, ..PngOptions::default() };
    save_png(path, width as u32, height as u32, &pixels, &options)
}

fn main() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    // Another place for trials: the first argument.
    let root = std::env::args().nth(1).map_or(root, Into::into);
    let folder = root.join("styles");
    let mut infos = Vec::new();
    let mut loaded = Vec::new();
    for &(name, title, description, tags, shade) in STYLES.iter().chain(families::STYLES) {
        let picture = render(shade);
        let premultiplied: Vec<[f32; 4]> = picture.pixels.iter().copied().map(premultiplied_from_straight).collect();
        let options = PngOptions {
            dpi: 72.0,
            text: vec![
                ("Title".to_owned(), title.to_owned()),
                ("Software".to_owned(), "Fabrica make_styles".to_owned()),
            ],
            ..PngOptions::default()
        };
        let size = STYLE_SIZE as u32;
        save_png(&folder.join(format!("{name}.png")), size, size, &premultiplied, &options)?;
        // The sheet shows the 8-bit picture, as all others will see it.
        let codes = premultiplied.iter().map(|&pixel| straight_srgb8_from_premultiplied_linear(pixel));
        let pixels = codes
            .map(|[r, g, b, a]| {
                [linear_from_srgb8(r), linear_from_srgb8(g), linear_from_srgb8(b), f32::from(a) / 255.0]
            })
            .collect();
        loaded.push(StyleImage::from_straight(name, &Picture { pixels, ..picture })?);
        infos.push(StyleInfo {
            name: name.to_owned(),
            title: title.to_owned(),
            description: description.to_owned(),
            tags: tags.iter().map(|&tag| tag.to_owned()).collect(),
            file: format!("{name}.png"),
        });
    }
    let index = folder.join("index.json");
    let json =
        serde_json::to_string_pretty(&infos).map_err(|error| Error::file(&index, error.to_string(), "report this"))?;
    save_atomic(&index, |file| {
        std::io::Write::write_all(file, format!("{json}\n").as_bytes()).map_err(|error| Error::io(&index, &error))
    })?;
    contact_sheet(&loaded, &root.join("docs/images/styles.png"))
}
