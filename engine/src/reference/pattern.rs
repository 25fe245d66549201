//! Patterns (docs/rendering.md §4): the tone of a style, drawn with lines or dots that lie in the volume at rest.

use glam::{DMat3, DVec2, DVec3, IVec3};

use super::style::RayFrame;
use crate::styles::pattern::{Direction, Pattern, Strokes};
use crate::styles::{StyleImage, normal_from_uv};

/// A surface, as a pattern sees it where a ray meets it.
#[derive(Clone, Copy, Debug)]
pub struct Sheet {
    /// From the middle of the volume, mm at rest.
    place: DVec3,
    /// Unit tangents in the world: across the ray, and away from it along the surface.
    tangents: [DVec3; 2],
    /// The same in the volume at rest.
    at_rest: [DVec3; 2],
    /// What a pixel covers of the surface along these, mm.
    pixel: DVec2,
    /// What it covers across the ray, mm.
    pixel_mm: f64,
}

/// |n·v| of the most foreshortened surface that is told from others.
const LEAST_FACING: f64 = 0.05;
/// Sine of the angle between a surface and a plane below which lines are no longer drawn denser for it.
const LEAST_STEEP: f64 = 0.125;
/// Density of ink that a layer of lines draws before the next one begins.
const LAYER: f64 = 0.6;
/// Alignment that a family may lack.
const MARGIN: f64 = 0.12;
/// What families across the first and the third axis have ahead of others: a bias, so that one family is drawn where all lie alike.
const FAVOR: [f64; 3] = [0.15, 0.0, 0.3];
/// Edge of a cell with a dot in it, in what is wanted between strokes.
const CELL: f64 = 0.7;
/// Turn of the normal, over twice the reach, below which a surface is hardly curved.
const HARDLY_CURVED: f64 = 0.3;
/// How far dots are strewn around the middle of their cells.
const STREWN: f64 = 0.35;
/// Volume up to which dots differ, in cells.
const DOT_SPREAD: f64 = 0.12;
/// Density of ink that dots can draw.
const DOT_DENSITY: f64 = 1.5;

fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

impl Sheet {
    /// At `place`, given from the middle of the volume in mm at rest. `normal`: the surface's in the world, shorter than 1 where there
    /// is hardly one; `rest_from_world`: M⁻¹ of the body; `pixel_mm`: what a pixel covers there.
    pub fn new(
        place: DVec3,
        normal: DVec3,
        pixel_mm: f64,
        rest_from_world: DMat3,
        frame: &RayFrame,
        direction: DVec3,
    ) -> Self {
        let to_eye = if normal.dot(direction) > 0.0 { -normal } else { normal };
        // Where there is no surface, one that faces the eye.
        let n = (to_eye - (1.0 - normal.length()) * direction).normalize_or_zero();
        let side = n.cross(direction);
        let side = if side.length() < 1e-3 { frame.right - frame.right.dot(n) * n } else { side };
        let across = side.normalize_or_zero();
        let tangents = [across, across.cross(n)];
        let pixel = DVec2::new(pixel_mm, pixel_mm / n.dot(direction).abs().max(LEAST_FACING));
        Self { place, tangents, at_rest: tangents.map(|t| rest_from_world * t), pixel, pixel_mm }
    }

    /// Tangents at rest, unit and orthogonal.
    fn orthonormal(&self) -> [DVec3; 2] {
        let [a, b] = self.at_rest;
        let r = a.normalize_or_zero();
        [r, (b - b.dot(r) * r).normalize_or_zero()]
    }

    /// How far a coordinate that rises by `rise` (a gradient at rest) changes across a pixel.
    fn change(&self, rise: DVec3) -> f64 {
        let [a, b] = self.at_rest;
        (DVec2::new(rise.dot(a), rise.dot(b)) * self.pixel).length()
    }

    /// The direction in which the surface bends most, as [`doubled`], from how its unit normals turn: `normal_at` an offset in mm at
    /// rest; they are compared `reach_mm` to either side.
    pub fn bends(&self, reach_mm: f64, normal_at: impl Fn(DVec3) -> DVec3) -> DVec2 {
        let [r, q] = self.orthonormal();
        let turn = |t: DVec3| normal_at(reach_mm * t) - normal_at(-reach_mm * t);
        let (along_r, along_q) = (turn(r), turn(q));
        let (a, c) = (r.dot(along_r), q.dot(along_q));
        let b = 0.5 * (r.dot(along_q) + q.dot(along_r));
        let [even, odd] = [0.5 * (a * a - c * c), b * (a + c)];
        DVec2::new(even, odd) / (0.5 * (a * a + c * c) + b * b + HARDLY_CURVED.powi(2))
    }
}

/// From 0 to x, how much bars of half the width `h` around all whole numbers cover.
fn bars(x: f64, h: f64) -> f64 {
    let nearest = (x + 0.5).floor();
    2.0 * h * nearest + (x - nearest).clamp(-h, h)
}

/// What lines across `u` cover of a pixel in which u changes by `change`, so thick that they are as dark as `tone`; `distance` is wanted
/// between them. All three in mm.
pub fn lines(u: f64, change: f64, distance: f64, tone: f64) -> f64 {
    let level = distance.clamp(1e-9, 1e9).log2();
    let leaves = smoothstep(0.0, 1.0, level - level.floor());
    let period = 2.0 * level.floor().exp2();
    let w = (change / period / 2.0).max(1e-4);
    let covered = |x: f64, h: f64| bars(x + w, h) - bars(x - w, h);
    let x = (u / period).rem_euclid(1.0);
    let all = covered(x, 0.25 * tone * (1.0 + leaves)) + covered(x + 0.5, 0.25 * tone * (1.0 - leaves));
    (all / (2.0 * w)).clamp(0.0, 1.0)
}

/// The families of planes that lines are cut by: unit normals.
fn families() -> Vec<DVec3> {
    let signs = [[1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, -1.0]];
    let faces =
        [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [-1.0, 0.0, 1.0]];
    let diagonals = signs.into_iter().chain(faces).map(|d| DVec3::from_array(d).normalize());
    DVec3::AXES.into_iter().chain(diagonals).collect()
}

/// What each family has of each of the three layers.
fn shares(direction: Direction, sheet: &Sheet, wanted: DVec2) -> Vec<(DVec3, [f64; 3])> {
    let [r, q] = sheet.orthonormal();
    let tangential = |c: DVec3| DVec2::new(c.dot(r), c.dot(q));
    if let Direction::Axis(_) = direction {
        let s = DVec3::AXES.map(|axis| smoothstep(0.15, 0.4, tangential(axis).length()));
        let (two, three) = (s[0] * s[1], s[0] * s[1] * s[2]);
        let diagonal = DVec3::ONE.normalize();
        return vec![
            (DVec3::X, [s[0], 0.0, 0.0]),
            (DVec3::Y, [1.0 - s[0], two, 0.0]),
            (DVec3::Z, [0.0, 1.0 - two, three]),
            (diagonal, [0.0, 0.0, 1.0 - three]),
        ];
    }
    let all = families();
    let layers = [wanted, -wanted, DVec2::new(-wanted.y, wanted.x)].map(|wanted| {
        let aligned: Vec<f64> = all
            .iter()
            .enumerate()
            .map(|(k, c)| {
                let t = tangential(*c);
                FAVOR.get(k).unwrap_or(&0.0) + t.length_squared() + wanted.dot(doubled(t))
            })
            .collect();
        let best = aligned.iter().copied().fold(0.0, f64::max);
        let counted: Vec<f64> = aligned.iter().map(|a| (a - best + MARGIN).max(0.0)).collect();
        let sum: f64 = counted.iter().sum();
        counted.into_iter().map(|c| c / sum).collect::<Vec<f64>>()
    });
    all.into_iter().enumerate().map(|(k, c)| (c, [layers[0][k], layers[1][k], layers[2][k]])).collect()
}

/// A direction without its sign: its length squared, at twice its angle.
fn doubled(v: DVec2) -> DVec2 {
    DVec2::new(v.x * v.x - v.y * v.y, 2.0 * v.x * v.y)
}

/// What is left free by lines of three layers of these densities.
fn free_of_lines(
    pattern: &Pattern,
    direction: Direction,
    densities: [f64; 3],
    wanted: DVec2,
    distance: f64,
    sheet: &Sheet,
) -> f64 {
    // In the axes of the pattern.
    let axes = DMat3::from_cols_array_2d(&pattern.axes().map(|a| a.to_array())).transpose();
    let turned = Sheet { place: axes * sheet.place, at_rest: sheet.at_rest.map(|t| axes * t), ..*sheet };
    let mut free = 1.0;
    for (c, shares) in shares(direction, &turned, wanted) {
        let density: f64 = shares.iter().zip(densities).map(|(share, density)| share * density).sum();
        let [a, b] = turned.at_rest;
        let steep = c.dot(a).hypot(c.dot(b)).max(LEAST_STEEP);
        free *= 1.0 - lines(c.dot(turned.place), turned.change(c), distance * steep, 1.0 - (-density).exp());
    }
    free
}

/// Four random numbers of a cell of an octave, 0 to 1 (pcg4d: Jarzynski and Olano, Hash Functions for GPU Rendering, 2020).
fn random(cell: IVec3, octave: i32) -> [f64; 4] {
    let mut v =
        [cell.x, cell.y, cell.z, octave].map(|n| (n as u32).wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let stir = |v: &mut [u32; 4]| {
        for (to, a, b) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
            v[to] = v[to].wrapping_add(v[a].wrapping_mul(v[b]));
        }
    };
    stir(&mut v);
    v = v.map(|n| n ^ (n >> 16));
    stir(&mut v);
    v.map(|n| f64::from(n >> 8) / 16_777_216.0)
}

/// What is left free by dots of a density, in cells of about `distance` mm.
fn free_of_dots(density: f64, distance: f64, sheet: &Sheet) -> f64 {
    let level = distance.clamp(1e-9, 1e9).log2();
    let leaves = smoothstep(0.0, 1.0, level - level.floor());
    let mut free = 1.0;
    for (octave, share) in [(level.floor(), density * (1.0 - leaves)), (level.floor() + 1.0, density * leaves)] {
        let size = octave.exp2();
        let x = sheet.place / size;
        let dots = share.min(DOT_DENSITY);
        let mean = 0.99355 * dots - 0.42138 * dots.powi(2) + 0.25275 * dots.powi(3) - 0.06775 * dots.powi(4);
        let mut clear = (dots - share).exp();
        for corner in 0..8 {
            let corner = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
            let cell = (x - 0.5).floor().as_ivec3() + corner;
            let [a, b, c, rank] = random(cell, octave as i32);
            let off = x - cell.as_dvec3() - 0.5 - STREWN * (2.0 * DVec3::new(a, b, c) - 1.0);
            let change = sheet.change(off.normalize_or_zero()) / size;
            let most = if mean < 0.5 * DOT_SPREAD { (2.0 * mean / DOT_SPREAD).sqrt() } else { mean / DOT_SPREAD + 0.5 };
            let volume = DOT_SPREAD * (most - rank).max(0.0);
            let radius = (volume * 0.75 / std::f64::consts::PI).cbrt();
            let seen = radius.max(0.5 * change);
            let faint = radius.powi(3) / (seen.powi(3) + 0.25 * seen * change * change).max(1e-30);
            clear *= 1.0 - faint * ((seen - off.length()) / change.max(1e-6) + 0.5).clamp(0.0, 1.0);
        }
        let far = smoothstep(0.4, 0.9, (sheet.pixel.x * sheet.pixel.y).sqrt() / size);
        free *= clear + far * ((-share).exp() - clear);
    }
    free
}

/// What a style shows, straight linear RGB and α_d, drawn with its pattern, if it has one. `bends`: as [`Sheet::bends`] has it; `light`:
/// the object's first one, in the world; `pixels_per_pt` of the page.
#[expect(clippy::too_many_arguments, reason = "what a surface is drawn by, spelled out")]
pub fn drawn(
    style: &StyleImage,
    (color, alpha): ([f64; 3], f64),
    sheet: &Sheet,
    bends: DVec2,
    light: Option<DVec3>,
    frame: &RayFrame,
    direction: DVec3,
    pixels_per_pt: f64,
) -> ([f64; 3], f64) {
    let Some(pattern) = &style.pattern else { return (color, alpha) };
    let [ink, paper] = [pattern.ink, pattern.paper].map(|c| DVec3::from_array(c.map(f64::from)));
    let bright = |c: DVec3| c.dot(DVec3::new(0.2126, 0.7152, 0.0722));
    let white = bright(paper);
    let darkness = ((white - bright(DVec3::from_array(color))) / (white - bright(ink))).clamp(0.0, 0.999);
    let density = -(1.0 - darkness).ln();
    let distance = pattern.spacing_pt * pixels_per_pt * sheet.pixel_mm;
    let free = match pattern.strokes {
        Strokes::Stipple => free_of_dots(density, CELL * distance, sheet),
        Strokes::Hatching { direction: along, layers } => {
            let first = if layers > 1 { density.min(LAYER) } else { density };
            let second = if layers > 2 { (density - first).min(LAYER) } else { density - first };
            let wanted = match along {
                Direction::Axis(_) => DVec2::ZERO,
                Direction::Light => {
                    let [x, y, z] = style.light.map(f64::from);
                    let towards = light.unwrap_or(x * frame.right + y * frame.up - z * direction);
                    let [a, b] = sheet.tangents;
                    let l = DVec2::new(towards.dot(a), towards.dot(b));
                    doubled(l) / (l.length_squared() + 0.01)
                }
                Direction::Around => -bends,
                Direction::Along => bends,
            };
            free_of_lines(pattern, along, [first, second, density - first - second], wanted, distance, sheet)
        }
    };
    let shown = free * pattern.paper_opacity;
    let opacity = 1.0 - free + shown;
    if opacity <= 0.0 {
        return ([0.0; 3], 0.0);
    }
    ((((1.0 - free) * ink + shown * paper) / opacity).to_array(), alpha * opacity)
}

/// Diameter of the sphere that a gallery shows, in figure points on its page.
const SPHERE_PT: f64 = 36.0;

/// The sphere of a style as it is drawn, at a mip level: premultiplied linear RGBA, row 0 = up; outside of the disc as at its rim. S is
/// up, and it is seen from the front.
pub fn sphere(style: &StyleImage, level: usize) -> Vec<[f32; 4]> {
    let level = level.min(style.mips.len() - 1);
    let size = style.size >> level;
    let frame = RayFrame { right: DVec3::X, up: DVec3::Z };
    let pixel = |(i, texel): (usize, &[f32; 4])| {
        let [x, y] = normal_from_uv([i % size, i / size].map(|n| (n as f64 + 0.5) / size as f64), size);
        let across = DVec2::new(x, y) / x.hypot(y).max(1.0);
        let normal = DVec3::new(across.x, -(1.0 - across.length_squared()).max(0.0).sqrt(), across.y);
        let alpha = f64::from(texel[3]);
        let straight = [0, 1, 2].map(|c| if alpha > 0.0 { f64::from(texel[c]) / alpha } else { 0.0 });
        let place = normal * (0.5 * size as f64);
        let sheet = Sheet::new(place, normal, 1.0, DMat3::IDENTITY, &frame, DVec3::Y);
        let pixels_per_pt = size as f64 / SPHERE_PT;
        let (color, alpha) =
            drawn(style, (straight, alpha), &sheet, DVec2::ZERO, None, &frame, DVec3::Y, pixels_per_pt);
        let [r, g, b] = color.map(|c| (c * alpha) as f32);
        [r, g, b, alpha as f32]
    };
    style.mips[level].iter().enumerate().map(pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_without_a_pattern_is_its_picture() {
        let mut style = StyleImage::flat("gray", [0.2, 0.2, 0.2, 0.5]);
        let all = |style: &StyleImage, is: &dyn Fn(f32) -> bool| sphere(style, 2).iter().all(|texel| is(texel[0]));
        assert!(all(&style, &|r| (r - 0.2).abs() < 1e-6));
        let strokes = Strokes::Hatching { direction: Direction::Axis(DVec3::Z), layers: 1 };
        style.pattern = Some(Pattern::new(strokes, 6.0));
        // Paper and ink, both as opaque as the sphere.
        let drawn = sphere(&style, 2);
        assert_eq!(drawn.len(), 64 * 64);
        let middle = &drawn[32 * 64..33 * 64];
        assert!(drawn.iter().any(|t| t[0] < 0.01) && drawn.iter().any(|t| t[0] > 0.45) && middle[32][3] == 0.5);
        // Level lines: along the middle row hardly anything changes.
        let [low, high] = [f32::min, f32::max].map(|f| middle[16..48].iter().map(|t| t[0]).fold(middle[32][0], f));
        assert!(high - low < 0.05, "{low} {high}");
    }
}
