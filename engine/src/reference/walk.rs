//! The march along one ray (docs/rendering.md §6): every sample in turn, front to back, none left out.

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3, DVec4};

use super::bodies::{Crossing, Interval, PreparedBody, Shown, combine, intervals};
use super::color::{Jacobian, luminance};
use super::contour::{coverage, curvature, extent, modulated, pushed};
use super::label::Labels;
use super::lighting::{Lit, lit};
use super::opacity::opacity_correct;
use super::pattern::{Sheet, drawn};
use super::piece::{Piece, classify_piece};
use super::ray::{Ray, Samples};
use super::region::{Look, cut_face, joined, shares, smoothstep, where_flat};
use super::sample::{Lattice, gradient_at, sample_volume, trilinear, within_centers};
use super::style::{
    Classification, Face, RayFrame, at_node, bend, classify, face_normal, facing, pixel_mm, ray_frame, shade,
    steepness, style_level, style_normal, surface_normal,
};
use crate::scene::quality::PARTS;
use crate::scene::{Borders, Camera, Quality, StyleTransferFunction};
use crate::spaces::Grid;
use crate::styles::StyleImage;
use crate::styles::pattern::{CURVATURE_VOXELS, Pattern};

/// An object as the march reads it: all that depends on the volume and its look, none of the picture.
#[derive(Clone, Debug)]
pub struct Prepared<'a> {
    /// Size and place of the volume.
    pub grid: Grid,
    /// Data values, without gaps.
    pub data: Lattice,
    /// 1 where a voxel has data, 0 where not; absent where all have.
    pub validity: Option<Lattice>,
    /// F: the smoothed data that gradients are taken from.
    pub gradient_volume: Lattice,
    /// What a volume of colors has instead of styles' colors and gradients of values.
    pub colors: Option<Colors>,
    /// G: the ‖g‖, in data units per mm, that counts as 1.
    pub gradient_max: f64,
    /// M⁻ᵀ.
    pub world_gradient_from_index: DMat3,
    /// Smallest and largest data value.
    pub value_range: (f64, f64),
    /// Fields that second coordinates go by, in mm, and the voxels along the edges of their cells.
    pub distances: Vec<(Lattice, DVec3)>,
    /// For the twin of borders by two look-ups.
    pub labels: Option<Labels>,
    /// What rests, and what was moved.
    pub bodies: Vec<PreparedBody<'a>>,
    /// d₀, mm: the shortest of theirs.
    pub reference_length_mm: f64,
    /// What the transfer function's nodes refer to.
    pub styles: &'a [Arc<StyleImage>],
    /// How it is lit, in place of styles.
    pub lighting: Option<Lit<'a>>,
    /// Whether any style that a look has carries a pattern.
    pub has_patterns: bool,
    /// Whether any look draws contours.
    pub has_contours: bool,
    /// Height of the whole picture on the page, in figure points.
    pub page_height_pt: f64,
}

/// The colors of a volume, premultiplied linear RGBA.
#[derive(Clone, Debug)]
pub struct Colors {
    /// Of the voxels.
    pub voxels: Lattice<DVec4>,
    /// Smoothed, to take gradients from.
    pub gradient_volume: Lattice<DVec4>,
}

/// How data change at a place, as a share of G.
#[derive(Clone, Copy, Debug)]
enum Slope {
    Value(DVec3),
    Color(Jacobian),
}

impl Slope {
    /// `weight` of the way from this one to `other`.
    fn towards(&self, other: &Self, weight: f64) -> Self {
        match (self, other) {
            (Self::Value(a), Self::Value(b)) => Self::Value(*a + weight * (*b - *a)),
            (Self::Color(a), Self::Color(b)) => Self::Color(a.towards(b, weight)),
            _ => unreachable!("one volume, one kind of slope"),
        }
    }

    /// ĝ.
    fn gradient(&self) -> DVec3 {
        match self {
            Self::Value(gradient) => *gradient,
            Self::Color(jacobian) => jacobian.gradient(),
        }
    }
}

/// What a voxel's color counts for where the transfer function gives it no opacity.
const UNSEEN: f64 = 1e-3;

/// What a ray brought home.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct March {
    /// Premultiplied linear RGBA, without background.
    pub rgba: [f64; 4],
    /// Samples of the ray in the volume's box, those behind its early end included.
    pub num_samples: u64,
    /// Samples of opacity above 0 up to the ray's end: the ones that were composited.
    pub num_visible: u64,
}

/// `front` over `back`, both premultiplied: (C, A) ← (C, A) + (1 − A)(C', A').
pub fn composite(front: [f64; 4], back: [f64; 4]) -> [f64; 4] {
    let clear = 1.0 - front[3];
    std::array::from_fn(|c| front[c] + clear * back[c])
}

/// Where a row of a look is seen and as what.
struct SeenAt<'a> {
    /// Its own function.
    row: &'a StyleTransferFunction,
    /// What it has of the look's share.
    share: f64,
    /// Along the ray, mm.
    t: f64,
    class: Classification,
    /// ĝ there, as the body lies.
    gradient: DVec3,
    /// ĝ a lag before, where contours are drawn.
    before: Option<DVec3>,
    /// κ of the surface, faces not counted, 1/mm.
    bend: f64,
}

/// One ray through a body of an object: all that its samples share.
struct Line<'a> {
    object: &'a Prepared<'a>,
    body: &'a PreparedBody<'a>,
    camera: &'a Camera,
    image_height: u32,
    ray: &'a Ray,
    frame: RayFrame,
    origin: DVec3,
    direction: DVec3,
    /// Outward normals of the walls through which the ray comes in and goes out, if these are seen, and where, mm.
    walls: [Option<(DVec3, f64)>; 2],
    /// Where borders are found by two look-ups.
    labels: Option<&'a Labels>,
}

impl<'a> Line<'a> {
    fn new(
        object: &'a Prepared<'a>,
        body: &'a PreparedBody<'a>,
        camera: &'a Camera,
        image_height: u32,
        ray: &'a Ray,
    ) -> Self {
        let crossings = body.crossings(ray).unwrap_or_default();
        let wall = |crossing: Option<Crossing>| {
            crossing.map(|c| (body.walls[c.wall], c.t)).filter(|(wall, _)| wall.open).map(|(wall, t)| (wall.normal, t))
        };
        Self {
            object,
            body,
            camera,
            image_height,
            ray,
            walls: crossings.map(wall),
            frame: ray_frame(camera, ray.direction),
            origin: body.index_from_world.transform_point3(ray.origin_mm),
            direction: body.index_from_world.matrix3 * ray.direction,
            labels: None,
        }
    }

    /// With the borders of a setting.
    fn with_borders(self, borders: Borders) -> Self {
        let labels = self.object.labels.as_ref().filter(|_| borders == Borders::TwoLookUps);
        Self { labels, ..self }
    }

    /// How much of `t` each look has.
    fn shares(&self, t: f64) -> Vec<f64> {
        let looks = &self.body.looks;
        let Some(labels) = self.labels else { return shares(looks, self.at(t)) };
        let (own, share) = labels.share(self.at(t));
        (0..looks.len()).map(|look| if look == own { share } else { 0.0 }).collect()
    }

    /// Index position at `t` mm.
    fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }

    fn value(&self, t: f64) -> f64 {
        sample_volume(&self.object.data, self.at(t))
    }

    /// The face of the volume, or of the part of it, near `t`, as the body lies.
    fn face(&self, t: f64) -> Face {
        let of_volume = self.body.turned_face(face_normal(&self.object.grid, self.at(t)));
        // A wall counts as a face of the volume does: fully up to half a voxel behind it, and not from a voxel on.
        let of_wall = |(normal, at): &(DVec3, f64)| {
            let behind = (t - at).abs() * normal.dot(self.ray.direction).abs() / self.body.spacing_mm;
            Face { normal: *normal, weight: 1.0 - smoothstep(0.5, 1.0, behind) }
        };
        let none = Face { normal: DVec3::ZERO, weight: 0.0 };
        let [enter, leave] = self.walls.map(|wall| wall.as_ref().map_or(none, of_wall));
        // Of a sliver the face is seen that is in front.
        let leave = Face { weight: leave.weight * (1.0 - enter.weight), ..leave };
        joined(joined(of_volume, enter), leave)
    }

    /// ĝ of a slope, as the body lies.
    fn gradient(&self, slope: &Slope) -> DVec3 {
        self.body.turned(slope.gradient())
    }

    /// What ĝ at `t` is taken from, at rest.
    fn slope(&self, t: f64) -> Slope {
        self.slope_of(self.at(t))
    }

    /// What ĝ at index position `p` is taken from, at rest.
    fn slope_of(&self, p: DVec3) -> Slope {
        let object = self.object;
        let to_world = object.world_gradient_from_index * (1.0 / object.gradient_max);
        match &object.colors {
            None => Slope::Value(
                gradient_at(&object.gradient_volume, object.world_gradient_from_index, p) / object.gradient_max,
            ),
            Some(colors) => {
                let within = within_centers(colors.gradient_volume.dims, p);
                Slope::Color(Jacobian::at(|q| sample_volume(&colors.gradient_volume, q), to_world, within))
            }
        }
    }

    /// The outward normal where the data change by `slope` at `t`.
    fn normal(&self, slope: &Slope, t: f64) -> DVec3 {
        surface_normal(self.gradient(slope), self.face(t))
    }

    /// The straight linear color at `p`: of the voxels around it, each as far as the row's function shows it. Alpha at
    /// `p` is above 0.
    fn seen_color(&self, colors: &Colors, row: &StyleTransferFunction, p: DVec3) -> DVec3 {
        let shown = trilinear(colors.voxels.dims, p, |x, y, z| {
            let opacity = classify(row, self.object.data.at(x, y, z)).opacity;
            colors.voxels.at(x, y, z) * (opacity + UNSEEN)
        });
        shown.truncate() / shown.w
    }

    /// What κ_v is measured against at `t`: the slope a lag before, which is d₀. None where nobody asks.
    fn slope_before(&self, t: f64) -> Option<Slope> {
        self.object.has_contours.then(|| self.slope(t - self.object.reference_length_mm))
    }

    /// The rows that share out what a look has at `t`, with their shares; `gradient`: ĝ there.
    fn rows_at(&self, look: &Look<'_>, t: f64, gradient: DVec3) -> Vec<(usize, f64)> {
        look.rows_at(gradient.length(), |field| {
            let (distances, voxels) = &self.object.distances[field];
            sample_volume(distances, (self.at(t) + 0.5) / *voxels - 0.5)
        })
    }

    /// Straight linear color and opacity, for one reference length of the object, of what a row of a look has there.
    fn appearance(&self, look: &Look<'_>, seen: &SeenAt<'_>, cut: Face) -> Option<([f64; 3], f64)> {
        let SeenAt { row: function, t, ref class, gradient, before, bend, .. } = *seen;
        if class.opacity <= 0.0 {
            return None;
        }
        let p = self.at(t);
        let has_data = self.object.validity.as_ref().map_or(1.0, |validity| sample_volume(validity, p));
        let face = joined(self.face(t), where_flat(cut, gradient.length()));
        let n_xy = style_normal(gradient, face, self.ray.direction, &self.frame);
        let facing = facing(gradient, face, self.ray.direction);
        let depth_mm = (self.ray.origin_mm + t * self.ray.direction - self.camera.eye_mm).dot(self.camera.forward);
        let steepness = steepness(gradient, face);
        let bend = (1.0 - face.weight) * bend;
        let level = style_level(self.camera, self.image_height, depth_mm, self.body.spacing_mm, steepness, bend);
        // c, and of an ink of its own which it is and how much of it there is.
        let (mut c, mut ink, mut n_xy) = (0.0, None, n_xy);
        if let (Some(contours), Some(before)) = (function.contours, before) {
            let pixel_mm = pixel_mm(self.camera, self.image_height, depth_mm);
            let width_mm = contours.width_pt * pixel_mm * f64::from(self.image_height) / self.object.page_height_pt;
            let curvature =
                curvature(gradient, before, self.ray.direction, face.weight, self.object.reference_length_mm);
            c = extent(width_mm, curvature);
            match contours.color {
                Some(color) => {
                    let covered = coverage(width_mm, curvature, facing, pixel_mm);
                    ink = Some((DVec3::from_array(color.map(f64::from)), covered));
                }
                None => n_xy = pushed(n_xy, facing, c),
            }
        }
        let (style, alpha_d) = match &self.object.lighting {
            Some(lighting) => {
                lit(lighting, self.camera, self.object.styles, class, n_xy, &self.frame, self.ray.direction)
            }
            None => shade(self.object.styles, class, n_xy, level),
        };
        let (style, alpha_d) = match self.object.has_patterns {
            true => self.patterned(p, depth_mm, surface_normal(gradient, face), class, (style, alpha_d)),
            false => (style, alpha_d),
        };
        let (light, voxel_alpha) = match &self.object.colors {
            None => (DVec3::from_array(style), 1.0),
            Some(colors) => {
                let voxel_alpha = sample_volume(&colors.voxels, p).w;
                if voxel_alpha <= 0.0 {
                    return None;
                }
                (self.seen_color(colors, function, p) * luminance(style), voxel_alpha)
            }
        };
        let mut color = look.tint.map_or(light, |tint| tint * luminance(light.to_array()));
        let mut alpha_d = alpha_d;
        if let Some((ink, covered)) = ink {
            let inked = alpha_d + covered * (1.0 - alpha_d);
            if inked > 0.0 {
                color = ((1.0 - covered) * alpha_d * color + covered * ink) / inked;
            }
            alpha_d = inked;
        }
        let alpha_u = if function.illustrative_transparency {
            modulated(class.opacity, facing, c, gradient.length())
        } else {
            class.opacity
        };
        let alpha = look.opacity * alpha_d * alpha_u * has_data * voxel_alpha;
        let lengths = self.object.reference_length_mm / function.reference_length_mm;
        Some((color.to_array(), opacity_correct(alpha, lengths)))
    }

    /// What styles show at `p`, straight color and α_d, with the patterns that they carry. `normal`: the surface's, in the world.
    fn patterned(
        &self,
        p: DVec3,
        depth_mm: f64,
        normal: DVec3,
        class: &Classification,
        shown: ([f64; 3], f64),
    ) -> ([f64; 3], f64) {
        let (object, direction) = (self.object, self.ray.direction);
        let rest_from_index = object.grid.world_from_index().matrix3;
        let middle = 0.5 * (DVec3::from_array(object.grid.dims().map(|n| n as f64)) - 1.0);
        let pixel_mm = pixel_mm(self.camera, self.image_height, depth_mm);
        let rest_from_world = rest_from_index * self.body.index_from_world.matrix3;
        let sheet =
            Sheet::new(rest_from_index * (p - middle), normal, pixel_mm, rest_from_world, &self.frame, direction);
        let styles = class.styles.map(|i| &object.styles[i]);
        let follows = |style: &&Arc<StyleImage>| style.pattern.as_ref().is_some_and(Pattern::follows_curvature);
        let bends = if styles.iter().any(follows) {
            let index_from_rest = object.grid.index_from_world().matrix3;
            let reach_mm = CURVATURE_VOXELS * object.grid.spacing_mm().min_element();
            sheet.bends(reach_mm, |off| self.slope_of(p + index_from_rest * off).gradient().normalize_or_zero())
        } else {
            DVec2::ZERO
        };
        let light = object.lighting.as_ref().and_then(|lit| lit.lighting.lights.first());
        let light = light.map(|light| light.in_world(self.camera));
        let pixels_per_pt = f64::from(self.image_height) / object.page_height_pt;
        let [first, second] =
            styles.map(|style| drawn(style, shown, &sheet, bends, light, &self.frame, direction, pixels_per_pt));
        let share = if class.styles[0] == class.styles[1] { 0.0 } else { class.weight };
        let (a, b) = ((1.0 - share) * first.1, share * second.1);
        if a + b <= 0.0 {
            return ([0.0; 3], 0.0);
        }
        (std::array::from_fn(|c| (a * first.0[c] + b * second.0[c]) / (a + b)), a + b)
    }

    /// The face that regions make at `t`, of looks of which so much shows.
    fn cut(&self, t: f64, shown: impl Iterator<Item = f64>) -> Face {
        let looks = &self.body.cut_looks;
        if looks.len() < 2 {
            return Face { normal: DVec3::ZERO, weight: 0.0 };
        }
        let opacities: Vec<f64> = looks.iter().zip(shown).map(|(look, shown)| look.opacity * shown).collect();
        let (p, to_world) = (self.at(t), self.object.world_gradient_from_index);
        self.body.turned_face(match self.labels {
            None => cut_face(looks, p, &opacities, to_world),
            Some(labels) => labels.cut_face(p, &opacities, to_world),
        })
    }

    /// What shows of a stretch: of each look, and each of its rows there, what `seen` says. The looks share the place at `t` (mm); `cut` is the face that the regions
    /// make there. Straight color, opacity of a reference length, and what the looks have of the place.
    fn see(&self, t: f64, seen: &[Vec<SeenAt<'_>>], cut: Face) -> (DVec3, f64, f64) {
        let looks = &self.body.looks;
        let mut shown = [0.0; 4];
        let mut present = 0.0;
        for ((look, share), seen) in looks.iter().zip(self.shares(t)).zip(seen) {
            if share <= 0.0 {
                continue;
            }
            present += if look.opacity > 0.0 { share } else { 0.0 };
            for row in seen {
                if let Some(([red, green, blue], alpha)) = self.appearance(look, row, cut) {
                    let weight = share * row.share * alpha;
                    [red, green, blue, 1.0].iter().zip(&mut shown).for_each(|(c, sum)| *sum += weight * c);
                }
            }
        }
        let [r, g, b, alpha] = shown;
        let color = if alpha > 0.0 { DVec3::new(r, g, b) / alpha } else { DVec3::ZERO };
        (color, alpha.min(1.0), present)
    }

    /// A data value as a share of the volume's range.
    fn within_range(&self, value: f64) -> f64 {
        let (low, high) = self.object.value_range;
        if high > low { (value - low) / (high - low) } else { 0.0 }
    }
}

/// Composites a stretch of one color and of an opacity for `lengths` of its reference lengths under `result`.
fn add(result: &mut March, color: DVec3, alpha: f64, lengths: f64) {
    let alpha = opacity_correct(alpha, lengths);
    if alpha > 0.0 {
        result.num_visible += 1;
        let [r, g, b] = (alpha * color).to_array();
        result.rgba = composite(result.rgba, [r, g, b, alpha]);
    }
}

/// The pieces of a stretch of a ray: Δ is `step_voxels` voxels of the finest body in it.
fn pieces(object: &Prepared<'_>, interval: &Interval, ray: &Ray, step_voxels: f64) -> Samples {
    let finest = interval.bodies.iter().map(|b| object.bodies[*b].voxels_per_mm(ray)).fold(0.0, f64::max);
    let (t0, t1, delta_mm) = (interval.t0, interval.t1, step_voxels / finest);
    Samples { t0, t1, delta_mm, count: ((t1 - t0) / delta_mm).ceil() as u64 }
}

/// Marches `ray` through the object, in steps of `step_voxels` > 0 voxels along it: the model itself, true in the limit
/// of short steps. It ends when its transmittance falls below `termination` (0: never). `image_height` in pixels sets the
/// styles' mip level.
pub fn march(
    object: &Prepared<'_>,
    camera: &Camera,
    image_height: u32,
    ray: &Ray,
    step_voxels: f64,
    termination: f64,
) -> March {
    let mut result = March::default();
    let lines: Vec<Line<'_>> =
        object.bodies.iter().map(|body| Line::new(object, body, camera, image_height, ray)).collect();
    let all = intervals(&object.bodies, ray);
    let samples: Vec<Samples> = all.iter().map(|interval| pieces(object, interval, ray, step_voxels)).collect();
    result.num_samples = samples.iter().map(|s| s.count).sum();
    for (interval, samples) in all.iter().zip(samples) {
        for k in 0..samples.count {
            let (start, end) = samples.piece(k);
            let t = 0.5 * (start + end);
            let of_body = |body: &usize| {
                let line = &lines[*body];
                let value = line.value(t);
                let looks = &line.body.looks;
                let most =
                    |look: &Look<'_>| look.rows.iter().map(|row| classify(row, value).opacity).fold(0.0, f64::max);
                if looks.iter().all(|look| most(look) <= 0.0) {
                    return None;
                }
                let [here, behind] = [t, end].map(|t| line.slope(t));
                let gradient = line.gradient(&here);
                let bend = bend([line.normal(&here, t), line.normal(&behind, end)], ray.direction, end - t);
                let cut = line.cut(t, line.body.cut_looks.iter().map(most));
                let before = line.slope_before(t).map(|slope| line.gradient(&slope));
                let mut seen = Vec::with_capacity(looks.len());
                for look in looks {
                    let of_row = |(row, share): (usize, f64)| {
                        let row = &look.rows[row];
                        SeenAt { row, share, t, class: classify(row, value), gradient, before, bend }
                    };
                    seen.push(line.rows_at(look, t, gradient).into_iter().map(of_row).collect::<Vec<_>>());
                }
                let (color, alpha, share) = line.see(t, &seen, cut);
                Some(Shown { body: *body, color, alpha, share, value: line.within_range(value) })
            };
            let shown: Vec<Shown> = interval.bodies.iter().filter_map(of_body).collect();
            if !shown.is_empty() {
                let (color, alpha) = combine(&object.bodies, &shown);
                add(&mut result, color, alpha, (end - start) / object.reference_length_mm);
                if ends(&mut result, termination) {
                    return result;
                }
            }
        }
    }
    result
}

/// The raycaster's twin (docs/rendering.md §5): as [`march`], but in pieces that are classified by both of their ends, cut
/// into parts and looked at as `quality` says, and whenever the normal has turned by `largest_turn` radians.
pub fn march_pieces(
    object: &Prepared<'_>,
    camera: &Camera,
    image_height: u32,
    ray: &Ray,
    quality: &Quality,
    largest_turn: f64,
) -> March {
    let mut result = March::default();
    let lines = object
        .bodies
        .iter()
        .map(|body| Line::new(object, body, camera, image_height, ray).with_borders(quality.borders));
    let lines: Vec<Line<'_>> = lines.collect();
    for interval in intervals(&object.bodies, ray) {
        let pieces = pieces(object, &interval, ray, quality.step_voxels);
        result.num_samples += pieces.count;
        let part_mm = pieces.delta_mm / f64::from(PARTS);
        for k in 0..pieces.count {
            let (start, end) = pieces.piece(k);
            // Whatever a body shows of a piece does not depend on what others show of it.
            let shown: Vec<PieceOf<'_>> =
                interval.bodies.iter().filter_map(|body| PieceOf::new(&lines[*body], *body, start, end)).collect();
            if shown.is_empty() {
                continue;
            }
            let num_parts = ((end - start) / part_mm - 1e-9).ceil().max(1.0) as u32;
            for part in 0..num_parts {
                let a = start + f64::from(part) * part_mm;
                let b = (a + part_mm).min(end);
                let lengths = (b - a) / object.reference_length_mm;
                match &shown[..] {
                    // As many looks as it takes, each of them under those before.
                    [alone] => {
                        for look in alone.looks(a, b, largest_turn) {
                            add(&mut result, look.color, look.alpha, look.weight * lengths);
                            // Where several bodies are, a ray ends with a part.
                            if interval.bodies.len() == 1 && ends(&mut result, quality.termination) {
                                return result;
                            }
                        }
                    }
                    // Each by itself over the part, and then together as if it had been a look.
                    several => {
                        let met: Vec<Shown> = several.iter().map(|piece| piece.part(a, b, largest_turn)).collect();
                        let (color, alpha) = combine(&object.bodies, &met);
                        add(&mut result, color, alpha, lengths);
                    }
                }
                if ends(&mut result, quality.termination) {
                    return result;
                }
            }
        }
    }
    result
}

/// A piece of a ray in a body that shows something of it.
struct PieceOf<'a> {
    line: &'a Line<'a>,
    body: usize,
    /// Of each look, whether it shows something.
    shows: Vec<bool>,
    cut: Face,
    /// Where it begins and ends, mm, and the slopes a lag before these.
    ends: [f64; 2],
    before: Option<[Slope; 2]>,
}

/// A look at a part of a piece: straight color, opacity of a reference length, share of the place; `weight` of the part.
struct LookAt {
    color: DVec3,
    alpha: f64,
    share: f64,
    weight: f64,
}

impl<'a> PieceOf<'a> {
    /// None where nothing shows.
    fn new(line: &'a Line<'a>, body: usize, start: f64, end: f64) -> Option<Self> {
        let ends = [line.value(start), line.value(end)];
        // Of what shows most of its rows: which of them are there is not asked.
        let extinction = |look: &Look<'_>| {
            let of_row = |row| classify_piece(row, ends[0], ends[1], 1.0).extinction;
            look.rows.iter().map(of_row).fold(0.0, f64::max)
        };
        // What a look does not show at all does not make a piece of it.
        let shows: Vec<bool> =
            line.body.looks.iter().map(|look| look.opacity > 0.0 && extinction(look) > 0.0).collect();
        if !shows.contains(&true) {
            return None;
        }
        if let Some(colors) = &line.object.colors
            && [start, end].into_iter().all(|t| sample_volume(&colors.voxels, line.at(t)).w <= 0.0)
        {
            return None;
        }
        let opacities = line.body.cut_looks.iter().map(|look| -(-extinction(look)).exp_m1());
        let cut = line.cut(start.midpoint(end), opacities);
        let before = line.slope_before(start).zip(line.slope_before(end)).map(|(a, b)| [a, b]);
        Some(Self { line, body, shows, cut, ends: [start, end], before })
    }

    /// The part between two places (mm) in as many looks as its normal turns.
    fn looks(&self, a: f64, b: f64, largest_turn: f64) -> Vec<LookAt> {
        let line = self.line;
        let values = [line.value(a), line.value(b)];
        let slopes = [line.slope(a), line.slope(b)];
        let normals = [0, 1].map(|i| line.normal(&slopes[i], [a, b][i]));
        let bend = bend(normals, line.ray.direction, b - a);
        let looks = (normals[0].distance(normals[1]) / largest_turn).ceil().clamp(1.0, MAX_LOOKS);
        let length_mm = (b - a) / looks;
        let look = |look: u32| {
            let [wa, wb] = [look, look + 1].map(|i| f64::from(i) / looks);
            let between = |w: f64| values[0] + w * (values[1] - values[0]);
            let middle = wa.midpoint(wb);
            let edge = line.gradient(&slopes[0].towards(&slopes[1], middle));
            let of_row = |row: &'a StyleTransferFunction, share: f64, shows: bool| {
                let piece = if shows {
                    classify_piece(row, between(wa), between(wb), length_mm / row.reference_length_mm)
                } else {
                    Piece { extinction: 0.0, node: 0.0, middle: 0.5 }
                };
                let w = wa + piece.middle * (wb - wa);
                let class = at_node(row, piece.node, -(-piece.extinction).exp_m1());
                let t = a + w * (b - a);
                let gradient = line.gradient(&slopes[0].towards(&slopes[1], w));
                let within = (t - self.ends[0]) / (self.ends[1] - self.ends[0]);
                let before = self.before.as_ref().map(|[a, b]| line.gradient(&a.towards(b, within)));
                SeenAt { row, share, t, class, gradient, before, bend }
            };
            let seen = |(look, shows): (&'a Look<'a>, &bool)| -> Vec<SeenAt<'a>> {
                let rows = line.rows_at(look, a + middle * (b - a), edge);
                rows.into_iter().map(|(row, share)| of_row(&look.rows[row], share, *shows)).collect()
            };
            let seen: Vec<_> = line.body.looks.iter().zip(&self.shows).map(seen).collect();
            let (color, alpha, share) = line.see(a + middle * (b - a), &seen, self.cut);
            LookAt { color, alpha, share, weight: 1.0 / looks }
        };
        (0..looks as u32).map(look).collect()
    }

    /// All looks at a part together.
    fn part(&self, a: f64, b: f64, largest_turn: f64) -> Shown {
        let lengths = (b - a) / self.line.object.reference_length_mm;
        let mut own = March::default();
        let mut share = 0.0;
        for look in self.looks(a, b, largest_turn) {
            add(&mut own, look.color, look.alpha, look.weight * lengths);
            share += look.weight * look.share;
        }
        let [red, green, blue, opacity] = own.rgba;
        let color = if opacity > 0.0 { DVec3::new(red, green, blue) / opacity } else { DVec3::ZERO };
        let value = self.line.value(a).midpoint(self.line.value(b));
        let alpha = opacity_correct(opacity, 1.0 / lengths);
        Shown { body: self.body, color, alpha, share, value: self.line.within_range(value) }
    }
}

/// Looks at the style within one part of a piece, at most.
const MAX_LOOKS: f64 = 16.0;

/// Whether a ray is over; what it shows is then made opaque.
fn ends(result: &mut March, termination: f64) -> bool {
    let opacity = result.rgba[3];
    if 1.0 - opacity >= termination {
        return false;
    }
    result.rgba = result.rgba.map(|c| c / opacity);
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn composite_is_associative() {
        let layer = |i: f64| {
            let alpha = (0.37 * i) % 1.0;
            [alpha * ((0.71 * i) % 1.0), alpha * ((0.13 * i) % 1.0), alpha * ((0.59 * i) % 1.0), alpha]
        };
        for i in 1..200 {
            let (a, b, c) = (layer(f64::from(i)), layer(f64::from(i) + 0.4), layer(f64::from(i) * 1.7));
            let (left, right) = (composite(composite(a, b), c), composite(a, composite(b, c)));
            assert!((0..4).all(|k| (left[k] - right[k]).abs() < 1e-15), "{left:?} {right:?}");
        }
        assert_eq!(composite([0.2, 0.3, 0.4, 1.0], [1.0; 4]), [0.2, 0.3, 0.4, 1.0]);
        assert_eq!(composite([0.0; 4], [0.1, 0.2, 0.3, 0.4]), [0.1, 0.2, 0.3, 0.4]);
    }
}
