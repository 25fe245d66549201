//! Styles that come in families: one technique in the hues that illustrators keep for materials, so that a theme
//! (`styles/themes.json`) has something for each of them.

use glam::{DVec2, DVec3, DVec4};

use super::{Material, Style, composite, contour, fresnel, hash, hex, highlight, key, noise, radius, shell, shoulder};
use super::{smoothstep, tone, wash, wrapped};

#[rustfmt::skip]
pub const STYLES: &[Style] = &[
    ("watercolor_gray", "Watercolor gray", "Neutral tint on white paper: what takes its color from elsewhere.", &["watercolor", "paper", "neutral"], |n| watercolor(n, "98938f", "6b6a78", 0.9)),
    ("watercolor_bone", "Watercolor bone", "Raw sienna in the shadows, paper in the lights: bone.", &["watercolor", "paper", "anatomy"], |n| watercolor(n, "d8b273", "8a6a78", 0.85)),
    ("watercolor_skin", "Watercolor skin", "Rose and ocher with violet shadows: skin.", &["watercolor", "paper", "anatomy"], |n| watercolor(n, "eda886", "a8606f", 1.0)),
    ("watercolor_muscle", "Watercolor muscle", "Light red, deeper where it pools: muscle and heart.", &["watercolor", "paper", "anatomy"], |n| watercolor(n, "d2604f", "7a2440", 1.15)),
    ("watercolor_organ", "Watercolor organ", "Brown madder: liver, spleen, kidney.", &["watercolor", "paper", "anatomy"], |n| watercolor(n, "b8684e", "5e2a3c", 1.15)),
    ("watercolor_brain", "Watercolor brain", "Pale rose over gray: brain and glands.", &["watercolor", "paper", "anatomy"], |n| watercolor(n, "dfa9a4", "7c6488", 0.95)),
    ("watercolor_fat", "Watercolor fat", "Gamboge with warm shadows: fat and marrow.", &["watercolor", "paper", "anatomy"], |n| watercolor(n, "f0c85a", "b86a34", 1.0)),
    ("watercolor_vessel", "Watercolor artery", "Vermilion: arteries by convention.", &["watercolor", "paper", "anatomy", "convention"], |n| watercolor(n, "e04a36", "8c1a30", 1.35)),
    ("watercolor_vein", "Watercolor vein", "Cobalt blue: veins by convention.", &["watercolor", "paper", "anatomy", "convention"], |n| watercolor(n, "5a8fd0", "2c3f8c", 1.35)),
    ("watercolor_nerve", "Watercolor nerve", "Cadmium yellow with olive shadows: nerves by convention.", &["watercolor", "paper", "anatomy", "convention"], |n| watercolor(n, "f0c22e", "a06a1c", 1.25)),
    ("watercolor_green", "Watercolor green", "Sap green: lymph vessels, cartilage, what must stand apart.", &["watercolor", "paper"], |n| watercolor(n, "86b070", "35606a", 1.1)),
    ("watercolor_veil", "Watercolor veil", "Blue gray wash on nothing that darkens at its edge: envelopes on white pages.", &["watercolor", "transparent"], watercolor_veil),
    ("chalk_white", "White chalk", "White chalk on a blackboard that hides what is behind.", &["chalk", "dark", "line"], |n| chalk_on_board(n, "f7f4ea")),
    ("chalk_red", "Red chalk", "Red chalk on a blackboard: arteries and muscle.", &["chalk", "dark", "line"], |n| chalk_on_board(n, "f2705e")),
    ("chalk_blue", "Blue chalk", "Light blue chalk on a blackboard: veins.", &["chalk", "dark", "line"], |n| chalk_on_board(n, "74b4f2")),
    ("chalk_yellow", "Yellow chalk", "Yellow chalk on a blackboard: nerves and fat.", &["chalk", "dark", "line"], |n| chalk_on_board(n, "f4d668")),
    ("chalk_green", "Green chalk", "Green chalk on a blackboard: lymph and cartilage.", &["chalk", "dark", "line"], |n| chalk_on_board(n, "92d48c")),
    ("chalk_rose", "Rose chalk", "Rose chalk on a blackboard: skin, organs, brain.", &["chalk", "dark", "line"], |n| chalk_on_board(n, "f0aca0")),
    ("chalk_veil", "Chalk veil", "A thin line of chalk at the edge of nothing: envelopes on dark pages.", &["chalk", "transparent", "line"], chalk_veil),
    ("engraving_black", "Engraving in black", "Fine lines over a tone of black brown ink: bone, and all that is not in color.", &["line", "paper", "tone"], |n| engraved(n, "241a14", "fbf5e6")),
    ("engraving_red", "Engraving in red", "Fine lines over a tone of red ink: arteries and muscle of a plate in two inks.", &["line", "paper", "tone"], |n| engraved(n, "9c2a1c", "f8e3d2")),
    ("engraving_blue", "Engraving in blue", "Fine lines over a tone of blue ink: veins of a plate in two inks.", &["line", "paper", "tone"], |n| engraved(n, "234a86", "e6e9e4")),
    ("engraving_brown", "Engraving in brown", "Fine lines over a tone of light brown ink: soft parts of a plate.", &["line", "paper", "tone"], |n| engraved(n, "7c5233", "f7ead2")),
    ("ink_veil", "Ink veil", "A brown pen line at the edge of nothing: envelopes on paper.", &["line", "transparent"], ink_veil),
    ("film", "Film", "Gray white, denser than the X-ray: bone and metal on a radiograph.", &["transparent", "technical", "dark"], |n| film(n, "8fa6ba", "ffffff", 1.5, 0.30)),
    ("film_soft", "Soft film", "A faint gray blue shadow: soft parts on a radiograph.", &["transparent", "technical", "dark"], |n| film(n, "2a4a6a", "8fb4d2", 0.30, 0.01)),
    ("tone_gray", "Tone gray", "Tone shading in gray, cool shadows and warm lights: housings and bone.", &["tone", "technical"], |n| toned(n, "d6d3cb")),
    ("tone_red", "Tone red", "Tone shading in red.", &["tone", "technical"], |n| toned(n, "dc4a38")),
    ("tone_blue", "Tone blue", "Tone shading in blue.", &["tone", "technical"], |n| toned(n, "3f86d8")),
    ("tone_yellow", "Tone yellow", "Tone shading in yellow.", &["tone", "technical"], |n| toned(n, "ecc040")),
    ("tone_green", "Tone green", "Tone shading in green.", &["tone", "technical"], |n| toned(n, "5fae72")),
    ("tone_orange", "Tone orange", "Tone shading in orange.", &["tone", "technical"], |n| toned(n, "e8945a")),
    ("matte_orange", "Matte orange", "Orange of the palette of Okabe and Ito, which color-blind eyes tell apart.", &["color-blind", "matte"], |n| told_apart(n, "e69f00")),
    ("matte_sky", "Matte sky blue", "Sky blue of the palette of Okabe and Ito.", &["color-blind", "matte"], |n| told_apart(n, "56b4e9")),
    ("matte_green", "Matte bluish green", "Bluish green of the palette of Okabe and Ito.", &["color-blind", "matte"], |n| told_apart(n, "009e73")),
    ("matte_yellow", "Matte yellow", "Yellow of the palette of Okabe and Ito.", &["color-blind", "matte"], |n| told_apart(n, "f0e442")),
    ("matte_blue", "Matte blue", "Blue of the palette of Okabe and Ito.", &["color-blind", "matte"], |n| told_apart(n, "0072b2")),
    ("matte_vermilion", "Matte vermilion", "Vermilion of the palette of Okabe and Ito.", &["color-blind", "matte"], |n| told_apart(n, "d55e00")),
    ("matte_purple", "Matte reddish purple", "Reddish purple of the palette of Okabe and Ito.", &["color-blind", "matte"], |n| told_apart(n, "cc79a7")),
    ("plate_veil", "Plate veil", "Warm flesh-colored film with a brown edge: skin around what a plate is about.", &["anatomy", "transparent"], plate_veil),
];

/// Two washes on white paper: a pigment, and a second one that flows into its shadows.
fn watercolor(n: DVec3, pigment: &str, shadow: &str, strength: f64) -> DVec4 {
    let p = n.truncate();
    let bloom = noise(p * 3.1 + 7.0) * 0.55 + noise(p * 7.3 + 31.0) * 0.45 - 0.5;
    // Heavy pigment settles in the paper's hollows.
    let grain = noise(p * 52.0 + 3.0) * 0.6 + noise(p * 27.0 + 60.0) * 0.4 - 0.5;
    let dark = 1.0 - tone(n);
    let first = smoothstep(0.20, 0.46, dark + 0.18 * bloom);
    let second = smoothstep(0.52, 0.90, dark + 0.24 * bloom);
    // The line where a wash dried: at the rim, and faintly at the front of the first wash.
    let rim = smoothstep(0.84, 0.99, radius(n)).powi(2) * (0.40 + 0.60 * smoothstep(0.05, 0.6, dark));
    let front = (-((dark + 0.18 * bloom - 0.31) / 0.04).powi(2)).exp();
    let flow = 1.0 + 0.30 * bloom + 0.22 * grain;
    let light = strength * flow * (0.05 + 0.44 * first + 0.34 * second + 0.10 * front);
    let deep = strength * flow * 0.38 * second * smoothstep(0.4, 1.0, dark) + 0.95 * strength * rim;
    let paper = wash(hex(pigment), light);
    (paper * hex(shadow).powf(deep * 0.75)).extend(1.0)
}

fn watercolor_veil(n: DVec3) -> DVec4 {
    let p = n.truncate();
    let bloom = noise(p * 3.7 + 19.0) * 0.6 + noise(p * 8.9) * 0.4 - 0.5;
    let edge = smoothstep(0.72, 0.99, radius(n)).powi(2);
    let alpha = (0.04 + 0.10 * smoothstep(0.1, 0.9, 1.0 - tone(n)) + 0.72 * edge) * (1.0 + 0.5 * bloom);
    hex("8fa6b8").lerp(hex("4d6482"), edge).extend(alpha.clamp(0.0, 1.0))
}

/// Chalk on a board, rubbed in the half-tones, pressed at the edges and in the lights.
fn chalk_on_board(n: DVec3, chalk: &str) -> DVec4 {
    let p = n.truncate() * 128.0;
    let turned = DVec2::from_angle(-0.85).rotate(p);
    let stroke = noise(DVec2::new(turned.x / 20.0 + 13.0 * hash((turned.y / 3.0).floor() as i64, 9), turned.y / 2.2));
    let grain = 0.45 * noise(p / 1.7 + 11.0) + 0.25 * noise(p / 4.1) + 0.30 * stroke;
    let lit = wrapped(n.dot(key()), 0.10);
    let line = smoothstep(0.90, 0.985, radius(n)) * (0.45 + 0.40 * noise(p / 9.0 + 70.0));
    let pressure = (0.02 + 0.78 * lit.powf(1.5) + line).min(1.0);
    let rubbed = 0.30 * pressure;
    let pressed = pressure * smoothstep(0.58 - 0.70 * pressure, 1.26 - 0.70 * pressure, grain + 0.12);
    hex("121518").lerp(hex(chalk), (rubbed + 0.75 * pressed).clamp(0.0, 1.0)).extend(1.0)
}

fn chalk_veil(n: DVec3) -> DVec4 {
    let grain = noise(n.truncate() * 58.0 + 5.0) * 0.6 + noise(n.truncate() * 21.0) * 0.4;
    let rim = smoothstep(0.80, 1.0, radius(n)).powi(2);
    hex("f4f2ea").extend((0.02 + 0.85 * rim * (0.45 + 0.75 * grain)).clamp(0.0, 0.95))
}

/// An ink on toned paper, as in an aquatint: fine lines over a tone that carries the form. Lines alone tear on what is nearly flat,
/// where the normal says little of the direction.
fn engraved(n: DVec3, ink: &str, paper: &str) -> DVec4 {
    let dark = 1.0 - tone(n);
    let line = |axis: DVec3, count: f64, amount: f64| {
        let phase = n.dot(axis.normalize()).clamp(-1.0, 1.0).acos() / std::f64::consts::PI * count;
        let distance = (phase - phase.round()).abs() * 2.0;
        smoothstep(amount + 0.22, amount - 0.22, distance) * smoothstep(0.01, 0.20, amount)
    };
    let first = line(DVec3::new(0.42, 0.88, -0.24), 38.0, 0.75 * smoothstep(0.10, 0.95, dark));
    let second = line(DVec3::new(-0.80, 0.50, -0.30), 38.0, 0.55 * smoothstep(0.62, 1.0, dark));
    let lines = 1.0 - (1.0 - 0.62 * first) * (1.0 - 0.45 * second);
    let aquatint = 0.90 * smoothstep(0.06, 0.90, dark);
    let covered = 1.0 - (1.0 - lines) * (1.0 - aquatint) * (1.0 - 0.9 * contour(n, 0.02, 0.06));
    hex(paper).lerp(hex(ink), covered).extend(1.0)
}

fn ink_veil(n: DVec3) -> DVec4 {
    let shade = smoothstep(0.75, -0.75, n.truncate().dot(key().truncate().normalize()));
    let line = smoothstep(0.87 - 0.05 * shade, 0.97, radius(n));
    hex("4a382b").extend(0.02 + (0.62 + 0.28 * shade) * line)
}

/// What a beam that meets a body leaves: denser where the path is longer, and never quite nothing in the middle of what is dense.
fn film(n: DVec3, thin: &str, thick: &str, density: f64, floor: f64) -> DVec4 {
    let wall = floor + (1.0 - floor) * shell(n, 0.55 * density);
    hex(thin).lerp(hex(thick), smoothstep(0.2, 0.95, wall)).extend(wall)
}

/// Tone shading (Gooch et al. 1998): the hue goes from a warm light to a cool dark version of itself, and a fine dark line ends it.
fn toned(n: DVec3, code: &str) -> DVec4 {
    let color = hex(code);
    let t = 0.5 + 0.5 * n.dot(key());
    let cool = hex("24406e") * 0.55 + color * 0.16;
    let warm = color * 0.92 + hex("fff0c8") * 0.16;
    let body = cool.lerp(color, smoothstep(0.16, 0.92, t)).lerp(warm, smoothstep(0.86, 1.0, t));
    let edge = smoothstep(0.915, 0.975, radius(n));
    shoulder(body + 0.55 * highlight(n, key(), 0.30, 0.05)).lerp(hex("10182c"), 0.85 * edge).extend(1.0)
}

/// Matte, with shadows that keep the hue: the color is the message.
fn told_apart(n: DVec3, code: &str) -> DVec4 {
    let material = Material { wrap: DVec3::splat(0.35), ambient: 0.17, edge: 0.7, ..Material::matte(code) };
    material.shade(n)
}

fn plate_veil(n: DVec3) -> DVec4 {
    let film = hex("e9b795").lerp(hex("b9764f"), smoothstep(0.7, 0.97, radius(n))).extend(0.08 + 0.80 * shell(n, 0.28));
    let line = hex("5a3524").extend(0.65 * smoothstep(0.93, 1.0, radius(n)) * (1.0 - 0.5 * fresnel(n)));
    composite(line, film)
}
