//! The march along one ray (docs/rendering.md §6): every sample in turn, front to back, none left out.

use std::sync::Arc;

use glam::{DMat3, DVec3, DVec4};

use super::color::{Jacobian, luminance};
use super::opacity::opacity_correct;
use super::piece::classify_piece;
use super::ray::{Ray, samples};
use super::sample::{Lattice, gradient_at, sample_volume, trilinear};
use super::style::{
    Classification, RayFrame, at_node, classify, face_normal, ray_frame, shade, steepness, style_level, style_normal,
    surface_normal,
};
use crate::scene::quality::PARTS;
use crate::scene::{Camera, Quality, StyleTransferFunction};
use crate::spaces::Grid;
use crate::styles::StyleImage;

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
    /// Value → style and opacity.
    pub transfer_function: &'a StyleTransferFunction,
    /// What the transfer function's nodes refer to.
    pub styles: &'a [Arc<StyleImage>],
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

/// One ray through an object: all that its samples share.
struct Line<'a> {
    object: &'a Prepared<'a>,
    camera: &'a Camera,
    image_height: u32,
    ray: &'a Ray,
    frame: RayFrame,
    smallest_spacing_mm: f64,
    origin: DVec3,
    direction: DVec3,
}

impl<'a> Line<'a> {
    fn new(object: &'a Prepared<'a>, camera: &'a Camera, image_height: u32, ray: &'a Ray) -> Self {
        Self {
            object,
            camera,
            image_height,
            ray,
            frame: ray_frame(camera, ray.direction),
            smallest_spacing_mm: object.grid.spacing_mm().min_element(),
            origin: object.grid.index_from_world().transform_point3(ray.origin_mm),
            direction: object.grid.index_from_world().matrix3 * ray.direction,
        }
    }

    /// Index position at `t` mm.
    fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }

    fn value(&self, t: f64) -> f64 {
        sample_volume(&self.object.data, self.at(t))
    }

    /// What ĝ at `t` is taken from.
    fn slope(&self, t: f64) -> Slope {
        let (object, p) = (self.object, self.at(t));
        let to_world = object.world_gradient_from_index * (1.0 / object.gradient_max);
        match &object.colors {
            None => Slope::Value(
                gradient_at(&object.gradient_volume, object.world_gradient_from_index, p) / object.gradient_max,
            ),
            Some(colors) => Slope::Color(Jacobian::at(|q| sample_volume(&colors.gradient_volume, q), to_world, p)),
        }
    }

    /// The straight linear color at `p`: of the voxels around it, each as far as the transfer function shows it. Alpha at `p`
    /// is above 0.
    fn seen_color(&self, colors: &Colors, p: DVec3) -> DVec3 {
        let shown = trilinear(colors.voxels.dims, p, |x, y, z| {
            let opacity = classify(self.object.transfer_function, self.object.data.at(x, y, z)).opacity;
            colors.voxels.at(x, y, z) * (opacity + UNSEEN)
        });
        shown.truncate() / shown.w
    }

    /// Color and opacity of a stretch of `lengths` reference lengths that is seen at `t`, composited under `result`.
    fn see(&self, result: &mut March, t: f64, class: &Classification, gradient: DVec3, lengths: f64) {
        if class.opacity <= 0.0 {
            return;
        }
        let p = self.at(t);
        let has_data = self.object.validity.as_ref().map_or(1.0, |validity| sample_volume(validity, p));
        let face = face_normal(&self.object.grid, p);
        let n_xy = style_normal(gradient, face, self.ray.direction, &self.frame);
        let depth_mm = (self.ray.origin_mm + t * self.ray.direction - self.camera.eye_mm).dot(self.camera.forward);
        let steepness = steepness(gradient, face);
        let level = style_level(self.camera, self.image_height, depth_mm, self.smallest_spacing_mm, steepness);
        let (style, alpha_d) = shade(self.object.styles, class, n_xy, level);
        let ([red, green, blue], coverage) = match &self.object.colors {
            None => (style, 1.0),
            Some(colors) => {
                let coverage = sample_volume(&colors.voxels, p).w;
                if coverage <= 0.0 {
                    return;
                }
                ((self.seen_color(colors, p) * luminance(style)).to_array(), coverage)
            }
        };
        let alpha = opacity_correct(alpha_d * class.opacity * has_data * coverage, lengths);
        if alpha > 0.0 {
            result.num_visible += 1;
            result.rgba = composite(result.rgba, [alpha * red, alpha * green, alpha * blue, alpha]);
        }
    }
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
    let Some(samples) = samples(ray, &object.grid, step_voxels) else { return result };
    result.num_samples = samples.count;
    let line = Line::new(object, camera, image_height, ray);
    for k in 0..samples.count {
        let (start, end) = samples.piece(k);
        let t = 0.5 * (start + end);
        let class = classify(object.transfer_function, line.value(t));
        if class.opacity > 0.0 {
            let lengths = (end - start) / object.transfer_function.reference_length_mm;
            line.see(&mut result, t, &class, line.slope(t).gradient(), lengths);
            if ends(&mut result, termination) {
                break;
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
    let Some(pieces) = samples(ray, &object.grid, quality.step_voxels) else { return result };
    result.num_samples = pieces.count;
    let line = Line::new(object, camera, image_height, ray);
    let function = object.transfer_function;
    let part_mm = pieces.delta_mm / f64::from(PARTS);
    for k in 0..pieces.count {
        let (start, end) = pieces.piece(k);
        if classify_piece(function, line.value(start), line.value(end), 1.0).extinction <= 0.0 {
            continue;
        }
        if let Some(colors) = &object.colors
            && [start, end].into_iter().all(|t| sample_volume(&colors.voxels, line.at(t)).w <= 0.0)
        {
            continue;
        }
        let num_parts = ((end - start) / part_mm - 1e-9).ceil().max(1.0) as u32;
        for part in 0..num_parts {
            let a = start + f64::from(part) * part_mm;
            let b = (a + part_mm).min(end);
            let values = [line.value(a), line.value(b)];
            let slopes = [line.slope(a), line.slope(b)];
            let normals =
                [0, 1].map(|i| surface_normal(slopes[i].gradient(), face_normal(&object.grid, line.at([a, b][i]))));
            let looks = (normals[0].distance(normals[1]) / largest_turn).ceil().clamp(1.0, MAX_LOOKS);
            let lengths = (b - a) / looks / function.reference_length_mm;
            for look in 0..looks as u32 {
                let [wa, wb] = [look, look + 1].map(|i| f64::from(i) / looks);
                let between = |w: f64| values[0] + w * (values[1] - values[0]);
                let piece = classify_piece(function, between(wa), between(wb), lengths);
                let w = wa + piece.middle * (wb - wa);
                let class = at_node(function, piece.node, -(-piece.extinction).exp_m1());
                let gradient = slopes[0].towards(&slopes[1], w).gradient();
                line.see(&mut result, a + w * (b - a), &class, gradient, lengths);
                if ends(&mut result, quality.termination) {
                    return result;
                }
            }
        }
    }
    result
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
