//! The first thing that is seen along a ray, regions included: what a hand means that paints on the picture.
//!
//! Opacities are the transfer functions' (styles that are transparent by themselves count as they are stated there), in steps of
//! half a voxel; as in `engine::pick`, the thing that is meant is the stretch of the ray that adds most.

use fabrica_engine::reference::ray::{Ray, intersect_box};
use fabrica_engine::scene::Object;
use glam::DVec3;

/// Steps in voxels.
const STEP: f64 = 0.5;
/// Nothing behind this transmittance is seen.
const SPENT: f64 = 0.01;
/// Less than this is nothing that anybody means.
const LEAST: f64 = 0.02;
/// Up to this share of the slope before and behind it, a dip parts two things.
const DIP: f64 = 0.5;

/// How far along a ray, in mm, the thing begins that is seen most of; none where nothing is.
pub fn depth_mm(object: &Object, ray: &Ray) -> Option<f64> {
    let index = object.volume.grid.index_from_world();
    let (origin, direction) = (index.transform_point3(ray.origin_mm), index.transform_vector3(ray.direction));
    let (low, high) = object.volume.grid.index_box();
    let (near, far) = intersect_box(origin, direction, ray.t_min, low, high)?;
    let step = STEP / direction.length();
    let mut transmittance = 1.0;
    // The stretch so far: what it adds, its largest part, where half of it is there, the dip since then.
    let (mut best, mut found) = (LEAST, None);
    let (mut sum, mut peak, mut peak_at, mut dip) = (0.0, 0.0, near, f64::INFINITY);
    let num_steps = ((far - near) / step).ceil() as usize;
    for i in 0..num_steps {
        let t = near + (i as f64 + 0.5) * step;
        let opacity = transmittance * opacity(object, origin + t * direction, step);
        if peak > 0.0 && dip <= DIP * peak && opacity * DIP > dip {
            (sum, peak, dip) = (0.0, 0.0, f64::INFINITY);
        }
        sum += opacity;
        if opacity > peak {
            (peak, peak_at, dip) = (opacity, t, f64::INFINITY);
        }
        dip = dip.min(opacity);
        if sum > best {
            (best, found) = (sum, Some(peak_at));
        }
        transmittance -= opacity;
        if transmittance < SPENT {
            break;
        }
    }
    found
}

/// Opacity of a step at a place in the grid.
fn opacity(object: &Object, at: DVec3, step_mm: f64) -> f64 {
    let volume = &object.volume;
    let dims = volume.grid.dims();
    let clamped = |a: usize| at[a].clamp(0.0, (dims[a] - 1) as f64);
    let first: [usize; 3] = std::array::from_fn(|a| (clamped(a) as usize).min(dims[a].saturating_sub(2)));
    let (mut value, mut weights) = (0.0, 0.0);
    for corner in 0..8 {
        let voxel: [usize; 3] = std::array::from_fn(|a| (first[a] + (corner >> a & 1)).min(dims[a] - 1));
        let weight: f64 = (0..3)
            .map(|a| {
                let along = clamped(a) - first[a] as f64;
                if corner >> a & 1 == 1 { along } else { 1.0 - along }
            })
            .product();
        let there = volume.value(voxel[0], voxel[1], voxel[2]);
        if weight > 0.0 && there.is_finite() {
            value += weight * there;
            weights += weight;
        }
    }
    if weights <= 0.0 {
        return 0.0;
    }
    value /= weights;
    let nearest: [usize; 3] = std::array::from_fn(|a| clamped(a).round() as usize);
    let mut rest = 1.0;
    let mut opacity = 0.0;
    let mut add = |share: f64, alpha: f64, length_mm: f64| {
        opacity += share * (1.0 - (1.0 - alpha.clamp(0.0, 1.0)).powf(step_mm / length_mm));
    };
    for region in &object.regions {
        let share = f64::from(region.selection.get(nearest)) / 255.0;
        if share > 0.0 {
            let share = share.min(rest);
            rest -= share;
            let function = &region.look.transfer_function;
            add(share, region.look.opacity * function.classify(value).opacity, function.reference_length_mm);
        }
    }
    let function = &object.transfer_function;
    add(rest, function.classify(value).opacity, function.reference_length_mm);
    opacity.min(1.0)
}

/// Whether anything of an object is drawn otherwise than its voxels alone would be: with it `engine::pick`, which knows no
/// regions, is at its end.
pub fn has_hidden_parts(object: &Object) -> bool {
    let own = &object.transfer_function;
    object.regions.iter().any(|region| region.look.opacity < 1.0 || !region.look.transfer_function.same_opacity(own))
}
