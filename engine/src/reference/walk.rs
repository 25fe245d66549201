//! The march along one ray (docs/rendering.md §6): every sample in turn, front to back, none left out.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::opacity::opacity_correct;
use super::piece::classify_piece;
use super::ray::{Ray, samples};
use super::sample::{Lattice, gradient_at, sample_volume};
use super::style::{at_node, classify, face_normal, ray_frame, shade, steepness, style_level, style_normal};
use crate::scene::{Camera, StyleTransferFunction};
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
    /// G: the ‖g‖, in data units per mm, that counts as 1.
    pub gradient_max: f64,
    /// M⁻ᵀ.
    pub world_gradient_from_index: DMat3,
    /// Value → style and opacity.
    pub transfer_function: &'a StyleTransferFunction,
    /// What the transfer function's nodes refer to.
    pub styles: &'a [Arc<StyleImage>],
}

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

/// How a piece of a ray is classified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Classify {
    /// By its middle: the model itself, true in the limit of short pieces.
    Middle,
    /// By both of its ends (docs/rendering.md §5): what the raycaster does at its step.
    Ends,
}

/// Marches `ray` through the object, in steps of `step_voxels` > 0 voxels along it. It ends when its transmittance falls
/// below `termination` (0: never). `image_height` in pixels sets the styles' mip level.
pub fn march(
    object: &Prepared<'_>,
    camera: &Camera,
    image_height: u32,
    ray: &Ray,
    (step_voxels, termination): (f64, f64),
    by: Classify,
) -> March {
    let mut result = March::default();
    let Some(samples) = samples(ray, &object.grid, step_voxels) else { return result };
    result.num_samples = samples.count;
    let origin = object.grid.index_from_world().transform_point3(ray.origin_mm);
    let direction: DVec3 = object.grid.index_from_world().matrix3 * ray.direction;
    let frame = ray_frame(camera, ray.direction);
    let smallest_spacing_mm = object.grid.spacing_mm().min_element();
    let function = object.transfer_function;
    let value_at = |t: f64| sample_volume(&object.data, origin + t * direction);
    let mut front = if by == Classify::Ends { value_at(samples.t0) } else { 0.0 };

    for k in 0..samples.count {
        let (start, end) = samples.piece(k);
        let length_ratio = (end - start) / function.reference_length_mm;
        let (t, class) = match by {
            Classify::Middle => {
                let t = 0.5 * (start + end);
                (t, classify(function, value_at(t)))
            }
            Classify::Ends => {
                let back = value_at(end);
                let piece = classify_piece(function, front, back, length_ratio);
                front = back;
                let opacity = -(-piece.extinction).exp_m1();
                (start + piece.middle * (end - start), at_node(function, piece.node, opacity))
            }
        };
        if class.opacity <= 0.0 {
            continue;
        }
        let p = origin + t * direction;
        let has_data = object.validity.as_ref().map_or(1.0, |validity| sample_volume(validity, p));
        let gradient = gradient_at(&object.gradient_volume, object.world_gradient_from_index, p);
        let gradient = gradient / object.gradient_max;
        let face = face_normal(&object.grid, p);
        let n_xy = style_normal(gradient, face, ray.direction, &frame);
        let depth_mm = (ray.origin_mm + t * ray.direction - camera.eye_mm).dot(camera.forward);
        let level = style_level(camera, image_height, depth_mm, smallest_spacing_mm, steepness(gradient, face));
        let ([red, green, blue], alpha_d) = shade(object.styles, &class, n_xy, level);
        let alpha = opacity_correct(alpha_d * class.opacity * has_data, length_ratio);
        if alpha <= 0.0 {
            continue;
        }
        result.num_visible += 1;
        result.rgba = composite(result.rgba, [alpha * red, alpha * green, alpha * blue, alpha]);
        if 1.0 - result.rgba[3] < termination {
            let opacity = result.rgba[3];
            result.rgba = result.rgba.map(|c| c / opacity);
            break;
        }
    }
    result
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
