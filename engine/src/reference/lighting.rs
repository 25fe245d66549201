//! Lighting maps (docs/rendering.md §4, thesis §3.3.1): a surface under lights, in place of a style's picture.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::style::{Classification, RayFrame};
use crate::scene::{Camera, Lighting, LightingTable};
use crate::styles::StyleImage;

/// How an object is lit, ready for rays.
#[derive(Clone, Debug)]
pub struct Lit<'a> {
    /// The lights.
    pub lighting: &'a Lighting,
    /// What light does, where no formula says it.
    pub table: Option<LightingTable>,
}

/// Straight linear RGB and α_d of a sample of class `class`, whose normal has the components `n_xy` across the ray.
pub fn lit(
    Lit { lighting, table }: &Lit<'_>,
    camera: &Camera,
    styles: &[Arc<StyleImage>],
    class: &Classification,
    n_xy: [f64; 2],
    frame: &RayFrame,
    direction: DVec3,
) -> ([f64; 3], f64) {
    let [a, b] = class.styles.map(|i| styles[i].color.map(f64::from));
    let [r, g, blue, alpha]: [f64; 4] = std::array::from_fn(|c| a[c] + class.weight * (b[c] - a[c]));
    if alpha <= 0.0 {
        return ([0.0; 3], 0.0);
    }
    let color = DVec3::new(r, g, blue) / alpha;
    let across = DVec2::from_array(n_xy);
    let across = across / across.length().max(1.0);
    let normal = across.extend((1.0 - across.length_squared()).max(0.0).sqrt());
    let brightness: f64 = lighting.lights.iter().map(|light| light.luminance()).sum();
    let (mut own, mut light_of) = (DVec3::ZERO, DVec3::ZERO);
    for light in &lighting.lights {
        let l = light.in_world(camera);
        let l = DVec3::new(l.dot(frame.right), l.dot(frame.up), -l.dot(direction));
        let h = (l + DVec3::Z).normalize_or_zero();
        let (n_l, n_h) = (normal.dot(l), normal.dot(h));
        let [ambient, diffuse, specular] =
            table.as_ref().map_or_else(|| lighting.map.terms(n_l, n_h), |table| table.at(n_l, n_h));
        let c = DVec3::from_array(light.color.map(f64::from));
        let share = if brightness > 0.0 { light.luminance() / brightness } else { 1.0 / lighting.lights.len() as f64 };
        own += share * ambient + c * diffuse;
        light_of += c * specular;
    }
    ((color * own + light_of).clamp(DVec3::ZERO, DVec3::ONE).to_array(), alpha)
}
