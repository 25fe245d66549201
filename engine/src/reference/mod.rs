//! The f64 reference renderer: the raycaster's independent twin on the CPU, written from the equations of
//! `docs/rendering.md` and from nothing else. In a frame it has no place; tests render the same scene with it and with
//! the GPU, and where the two disagree one of them has a bug. It is written to be read: no skipping, no tables, every
//! sample of every ray.
//!
//! Function names are those of the concepts (and of the shaders' functions): [`ray::ray_from_pixel`],
//! [`ray::intersect_box`], [`sample::sample_volume`], [`sample::gradient_at`], [`style::classify`],
//! [`style::ray_frame`], [`style::style_uv`], [`style::style_level`], [`style::shade`], [`opacity::opacity_correct`],
//! [`walk::composite`].

pub mod bodies;
pub mod color;
pub mod contour;
pub mod label;
pub mod lighting;
pub mod opacity;
pub mod pattern;
pub mod piece;
pub mod ray;
pub mod region;
pub mod sample;
pub mod style;
#[cfg(test)]
pub(crate) mod testing;
pub mod walk;

use rayon::prelude::*;

pub use walk::March;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::scene::{Borders, Object, Scene};
use crate::selection::DistanceField;
use crate::volume::Voxel;
use crate::volume::no_data::fill_no_data;
use crate::with_voxels;
use bodies::prepare_bodies;
use color::{Jacobian, premultiplied};
use label::Labels;
use lighting::Lit;
use ray::ray_from_pixel;
use sample::{Lattice, gradient_max, gradient_volume, sample_volume, steepest};
use walk::{Colors, Prepared};

/// Data values beyond this, of either sign, would overflow the squares of their gradients.
const LARGEST_VALUE: f64 = 1e100;

/// A scene, ready to be rendered in f64. It holds two to three f64 per voxel, ten of a volume of colors: meant for volumes of up
/// to some 128³.
#[derive(Clone, Debug)]
pub struct Reference<'a> {
    scene: &'a Scene,
    object: Option<Prepared<'a>>,
}

impl<'a> Reference<'a> {
    /// Fills the gaps, smooths the gradient volume and finds G, for the scene's object (if it has one).
    ///
    /// # Errors
    /// [`Error::Scene`] for a scene that [`Scene::validate`] refuses, or data values beyond ±1e100.
    pub fn new(scene: &'a Scene) -> Result<Self> {
        scene.validate()?;
        let object = scene.objects.first().map(|object| prepare(scene, object)).transpose()?;
        Ok(Self { scene, object })
    }

    /// Premultiplied linear RGBA of pixel (column x, row y from the top left) of a picture of `image_size` (width,
    /// height), without the background, with the scene's quality.
    pub fn pixel(&self, image_size: [u32; 2], x: u32, y: u32) -> [f64; 4] {
        let quality = self.scene.quality;
        self.march(image_size, x, y, quality.step_voxels, quality.termination).rgba
    }

    /// As [`Reference::pixel`], with samples `step_voxels` voxels apart and rays that end at a transmittance below
    /// `termination` (0: never).
    ///
    /// # Panics
    /// If the step is not positive.
    pub fn pixel_with_step(
        &self,
        image_size: [u32; 2],
        x: u32,
        y: u32,
        step_voxels: f64,
        termination: f64,
    ) -> [f64; 4] {
        self.march(image_size, x, y, step_voxels, termination).rgba
    }

    /// As [`Reference::pixel_with_step`], with the counts of samples.
    ///
    /// # Panics
    /// If the step is not positive.
    pub fn march(&self, image_size: [u32; 2], x: u32, y: u32, step_voxels: f64, termination: f64) -> March {
        assert!(step_voxels > 0.0, "a step of {step_voxels} voxels never ends");
        let Some(object) = &self.object else { return March::default() };
        let ray = ray_from_pixel(&self.scene.camera, image_size, x, y);
        walk::march(object, &self.scene.camera, image_size[1], &ray, step_voxels, termination)
    }

    /// The whole picture, row by row from the top, with the scene's quality: premultiplied linear RGBA without the
    /// background. Progress counts rows.
    ///
    /// # Errors
    /// [`Error::Scene`] for a picture without pixels, [`Error::Cancelled`] on request.
    pub fn image(&self, image_size: [u32; 2], progress: &Progress) -> Result<Vec<[f64; 4]>> {
        let quality = self.scene.quality;
        self.image_with(image_size, quality.step_voxels, quality.termination, progress)
    }

    /// As [`Reference::image`], with a step and a termination of the caller's.
    ///
    /// # Errors
    /// Also [`Error::Scene`] for a step that is not positive.
    pub fn image_with(
        &self,
        image_size: [u32; 2],
        step_voxels: f64,
        termination: f64,
        progress: &Progress,
    ) -> Result<Vec<[f64; 4]>> {
        self.rows(image_size, step_voxels, progress, |x, y| {
            self.pixel_with_step(image_size, x, y, step_voxels, termination)
        })
    }

    /// The raycaster's twin: the whole picture with the scene's quality, in pieces that are classified, cut and looked at
    /// as the GPU does with the same settings. Same result and errors as [`Reference::image`], which is the truth and not
    /// the twin.
    pub fn twin(&self, image_size: [u32; 2], progress: &Progress) -> Result<Vec<[f64; 4]>> {
        let quality = &self.scene.quality;
        let largest_turn = self.scene.objects.first().map_or(f64::INFINITY, |o| self.scene.largest_turn(o));
        self.rows(image_size, quality.step_voxels, progress, |x, y| {
            let Some(object) = &self.object else { return [0.0; 4] };
            let ray = ray_from_pixel(&self.scene.camera, image_size, x, y);
            walk::march_pieces(object, &self.scene.camera, image_size[1], &ray, quality, largest_turn).rgba
        })
    }

    fn rows(
        &self,
        [width, height]: [u32; 2],
        step_voxels: f64,
        progress: &Progress,
        pixel: impl Fn(u32, u32) -> [f64; 4] + Sync,
    ) -> Result<Vec<[f64; 4]>> {
        if width == 0 || height == 0 {
            return Err(Error::scene(
                format!("a picture of {width} × {height} pixels has nothing in it"),
                "choose at least 1 pixel a side",
            ));
        }
        if step_voxels.is_nan() || step_voxels <= 0.0 {
            return Err(Error::scene(format!("the step is {step_voxels} voxels"), "choose a positive one"));
        }
        progress.begin("reference", u64::from(height));
        let mut pixels = vec![[0.0; 4]; width as usize * height as usize];
        pixels.par_chunks_mut(width as usize).zip(0..height).try_for_each(|(row, y)| {
            progress.check()?;
            for (x, out) in (0..width).zip(row) {
                *out = pixel(x, y);
            }
            progress.advance(1)
        })?;
        Ok(pixels)
    }

    /// The object as the march reads it, for tests of single stages; `None` in an empty scene.
    pub fn prepared(&self) -> Option<&Prepared<'a>> {
        self.object.as_ref()
    }
}

fn prepare<'a>(scene: &'a Scene, object: &'a Object) -> Result<Prepared<'a>> {
    let volume = &object.volume;
    let dims = volume.grid.dims();
    let filled = fill_no_data(volume);
    let values: Vec<f64> =
        with_voxels!(filled.voxels.as_ref(), v => v.iter().map(|s| volume.rescale.value(s.to_f64())).collect());
    if let Some(value) = values.iter().find(|value| value.is_nan() || value.abs() > LARGEST_VALUE) {
        return Err(Error::scene(
            format!("the data value {value} is too large to take gradients of"),
            "rescale the volume to values within ±1e100",
        ));
    }
    let data = Lattice { dims, values };
    let validity = filled.valid.map(|valid| {
        let values = valid.iter().map(|&v| if v == 0 { 0.0 } else { 1.0 }).collect();
        Lattice { dims, values }
    });
    let world_gradient_from_index = volume.grid.world_from_index().matrix3.inverse().transpose();
    let colors = volume.colors.as_ref().map(|colors| {
        let voxels = Lattice { dims, values: colors.iter().map(|&color| premultiplied(color)).collect() };
        Colors { gradient_volume: gradient_volume(&voxels, &volume.grid, object.gradient_scale_mm), voxels }
    });
    let has_labels = scene.quality.borders == Borders::TwoLookUps && !object.regions.is_empty();
    Ok(Prepared {
        grid: volume.grid,
        gradient_volume: gradient_volume(&data, &volume.grid, object.gradient_scale_mm),
        gradient_max: match &colors {
            None => gradient_max(&data, world_gradient_from_index),
            Some(Colors { voxels, .. }) => steepest(dims, |center| {
                Jacobian::at(|p| sample_volume(voxels, p), world_gradient_from_index, center).gradient().length()
            }),
        },
        colors,
        data,
        validity,
        world_gradient_from_index,
        distances: object.distances.iter().map(|field| distances(field)).collect(),
        labels: has_labels.then(|| Labels::new(&object.regions)),
        value_range: object.data_range(),
        bodies: prepare_bodies(object),
        reference_length_mm: object.reference_length_mm(),
        styles: &scene.styles,
        lighting: object.lighting.as_ref().map(|lighting| Lit {
            lighting,
            table: lighting.map.blinn_phong().is_none().then(|| lighting.map.table()),
        }),
        has_contours: object.has_contours(),
        has_patterns: scene.has_patterns(object),
        page_height_pt: scene.page_height_mm / 25.4 * 72.0,
    })
}

/// A field of distances, mm, and the voxels along the edges of its cells.
fn distances(field: &DistanceField) -> (Lattice, glam::DVec3) {
    let values = field.values().iter().map(|mm| mm.to_f64()).collect();
    (Lattice { dims: field.dims(), values }, glam::DVec3::from_array(field.voxels().map(|n| n as f64)))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DAffine3, DMat3, DQuat, DVec3};

    use super::testing::{awkward_affines, looking_at, node, scene, sphere_style, volume};
    use super::*;
    use crate::image_out::Picture;
    use crate::scene::{Camera, Projection, TransferFunctionNode};
    use crate::spaces::Grid;
    use crate::styles::{STYLE_SIZE, StyleImage};
    use crate::volume::{Rescale, Volume, Voxels};

    const ORTHO: Projection = Projection::Orthographic { height_mm: 40.0 };

    fn white() -> StyleImage {
        StyleImage::flat("white", [1.0; 4])
    }

    /// A termination that only an opaque sample meets.
    const WHEN_OPAQUE: f64 = f64::MIN_POSITIVE;

    /// A cube of `n` voxels of 1 mm, all of α_u = `alpha` per mm, seen along +x from 100 mm before its center.
    fn slab(n: usize, alpha: f64) -> Scene {
        let camera = Camera::looking(DVec3::new(-100.0, 2.0, 2.0), DVec3::X, DVec3::Z, ORTHO).unwrap();
        scene(volume([n; 3], DAffine3::IDENTITY, |_| 1.0), vec![node(0.0, 0, alpha)], vec![white()], camera)
    }

    #[test]
    fn a_homogeneous_slab_is_exact_for_any_step() {
        let scene = slab(6, 0.3);
        let reference = Reference::new(&scene).unwrap();
        for step in [0.013, 0.1, 0.25, 0.5, 0.77, 1.0, 1.5, 2.0, 3.0, 6.0, 7.0] {
            let march = reference.march([1, 1], 0, 0, step, 0.0);
            // Rounding may cut off one more piece of no length.
            assert!((march.num_samples as f64 - (6.0 / step).ceil()).abs() <= 1.0, "{step}: {march:?}");
            let expected = 1.0 - 0.7f64.powi(6);
            assert!(march.rgba.iter().all(|c| (c - expected).abs() < 1e-12), "{step}: {march:?}");
        }
        // The opacity is one of a length, not of a number of voxels: half the reference length, twice the exponent.
        let mut denser = scene.clone();
        denser.objects[0].transfer_function.reference_length_mm = 0.5;
        let rgba = Reference::new(&denser).unwrap().pixel([1, 1], 0, 0);
        assert!((rgba[3] - (1.0 - 0.7f64.powi(12))).abs() < 1e-12);
    }

    #[test]
    fn a_ray_ends_early_and_is_divided_by_its_opacity() {
        let scene = slab(20, 0.5);
        let reference = Reference::new(&scene).unwrap();
        // 2^-10 is not below 1/1024: the eleventh sample ends the ray.
        let march = reference.march([1, 1], 0, 0, 1.0, 1.0 / 1024.0);
        assert_eq!((march.num_samples, march.num_visible), (20, 11));
        assert!(march.rgba.iter().all(|c| (c - 1.0).abs() < 1e-15), "{march:?}");
        let whole = reference.march([1, 1], 0, 0, 1.0, 0.0);
        assert_eq!(whole.num_visible, 20);
        assert!((whole.rgba[3] - (1.0 - 0.5f64.powi(20))).abs() < 1e-12);
    }

    /// A ball around the center of the grid with the radius of 10 mm. Its field is quadratic, of which trilinear
    /// central differences are exact: normals have no error.
    fn ball(affine: DAffine3, bright_in_dark: bool, camera: impl Fn(DVec3) -> Camera) -> (Scene, DVec3) {
        let size = (affine.matrix3.inverse() * DMat3::from_diagonal(DVec3::splat(30.0))).transpose();
        let dims = [size.x_axis, size.y_axis, size.z_axis].map(|row| row.length().ceil() as usize + 2);
        let center = affine.transform_point3(DVec3::from_array(dims.map(|n| (n as f64 - 1.0) / 2.0)));
        let sign = if bright_in_dark { -1.0 } else { 1.0 };
        let field = |p: DVec3| sign * p.distance_squared(center);
        // Opaque on the ball's side, clear on the other.
        let nodes: [TransferFunctionNode; 2] = if bright_in_dark {
            [node(-100.0, 0, 0.0), node(-100.0, 0, 1.0)]
        } else {
            [node(100.0, 0, 1.0), node(100.0, 0, 0.0)]
        };
        let mut scene = scene(volume(dims, affine, field), nodes.to_vec(), vec![sphere_style()], camera(center));
        scene.objects[0].gradient_scale_mm = 0.4;
        (scene, center)
    }

    /// Compares the picture of a ball with its style: each ray's n_xy from geometry alone, with quaternions.
    fn assert_shows_its_style(scene: &Scene, center: DVec3, image_size: [u32; 2]) -> (u32, f64) {
        let reference = Reference::new(scene).unwrap();
        let camera = &scene.camera;
        let (mut num_inside, mut largest_error) = (0, 0.0f64);
        for y in 0..image_size[1] {
            for x in 0..image_size[0] {
                let ray = ray_from_pixel(camera, image_size, x, y);
                let to_center = center - ray.origin_mm;
                // From the center to the ray, across it; the sphere's normal has this over the radius across the ray.
                let across = (ray.direction * to_center.dot(ray.direction) - to_center) / 10.0;
                let rgba = reference.pixel_with_step(image_size, x, y, 1.0 / 16.0, WHEN_OPAQUE);
                if across.length() > 1.01 {
                    assert_eq!(rgba, [0.0; 4], "{x} {y}");
                } else if across.length() < 0.97 {
                    let turn = DQuat::from_rotation_arc(camera.forward, ray.direction);
                    let n_xy = [across.dot(turn * camera.right), across.dot(turn * camera.up)];
                    let expected = [0.5 + 0.5 * n_xy[0], 0.5 + 0.5 * n_xy[1], 0.25, 1.0];
                    let error = (0..4).map(|c| (rgba[c] - expected[c]).abs()).fold(0.0, f64::max);
                    largest_error = largest_error.max(error);
                    num_inside += 1;
                }
            }
        }
        (num_inside, largest_error)
    }

    #[test]
    fn a_ball_shows_the_styles_own_picture() {
        for affine in awkward_affines() {
            for bright_in_dark in [true, false] {
                let eye = DVec3::new(35.0, -70.0, 25.0);
                let ortho = |c: DVec3| looking_at(c + eye, c, Projection::Orthographic { height_mm: 22.0 });
                let (scene, center) = ball(affine, bright_in_dark, ortho);
                let (num_inside, error) = assert_shows_its_style(&scene, center, [52, 48]);
                assert!(num_inside > 1000 && error < 4e-3, "{num_inside} {error} {affine:?}");

                // Far off the axis of a wide perspective, where a ball looks like an egg.
                let project = Projection::Perspective { fov_y_deg: 80.0 };
                let aside = |c: DVec3| looking_at(c + 0.4 * eye, c + DVec3::new(18.0, 6.0, 12.0), project);
                let (scene, center) = ball(affine, bright_in_dark, aside);
                let (num_inside, error) = assert_shows_its_style(&scene, center, [130, 90]);
                assert!(num_inside > 500 && error < 4e-3, "{num_inside} {error} {affine:?}");
            }
        }
    }

    #[test]
    fn a_balls_silhouette_has_its_radius() {
        let (mut row, _) = ball(DAffine3::IDENTITY, true, |c| {
            looking_at(c + DVec3::new(0.0, -80.0, 0.0), c, Projection::Orthographic { height_mm: 24.0 })
        });
        let covered = |scene: &Scene, n: u32| {
            let reference = Reference::new(scene).unwrap();
            (0..n).filter(|&x| reference.pixel_with_step([n, 1], x, 0, 1.0 / 16.0, WHEN_OPAQUE)[3] > 0.5).count() as f64
        };
        // One row of 601 pixels through the center; a row is as high as it is wide, hence the projections' sizes.
        row.camera.projection = Projection::Orthographic { height_mm: 24.0 / 601.0 };
        let diameter = covered(&row, 601) * 24.0 / 601.0;
        assert!((diameter - 20.0).abs() < 0.12, "{diameter}");
        // In perspective, where the tangent touches: tan(asin(10/80)) to either side.
        let half = 0.15f64;
        row.camera.projection = Projection::Perspective { fov_y_deg: 2.0 * (half / 601.0).atan().to_degrees() };
        let tangent = covered(&row, 601) * half / 601.0;
        assert!((tangent - (10.0f64 / 80.0).asin().tan()).abs() < 1e-3, "{tangent}");
    }

    #[test]
    fn the_march_converges_with_the_square_of_the_step() {
        // A linear ramp, translucent, from one color to another: smooth but for kinks on the steps' own boundaries.
        let styles =
            vec![StyleImage::flat("red", [1.0, 0.1, 0.0, 1.0]), StyleImage::flat("blue", [0.0, 0.2, 0.8, 0.8])];
        let camera = Camera::looking(DVec3::new(-9.0, 2.0, 2.0), DVec3::X, DVec3::Z, ORTHO).unwrap();
        let ramp = volume([17, 5, 5], DAffine3::IDENTITY, |p| p.x / 16.0);
        let scene = scene(ramp, vec![node(0.0, 0, 0.02), node(1.0, 1, 0.5)], styles, camera);
        let reference = Reference::new(&scene).unwrap();
        let at = |step: f64| reference.pixel_with_step([1, 1], 0, 0, step, 0.0);
        let exact = at(1.0 / 1024.0);
        let error = |step: f64, c: usize| (at(step)[c] - exact[c]).abs();
        for c in 0..4 {
            for step in [0.5, 0.25, 0.125] {
                let order = (error(step, c) / error(step / 2.0, c)).log2();
                assert!(order > 1.8, "channel {c}: order {order} at {step}");
            }
        }
        // The opacity against the integral itself: α = α_d(w) α_u(w), ∫ ln(1 − α) by Simpson's rule.
        let density = |w: f64| (1.0 - (1.0 - 0.2 * w) * (0.02 + 0.48 * w)).ln();
        let n = 2000;
        let simpson: f64 = (0..=n)
            .map(|i| {
                let weight = if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
                weight * density(f64::from(i) / f64::from(n)) * 16.0 / f64::from(n) / 3.0
            })
            .sum();
        let expected = 1.0 - (simpson + 0.5 * (density(0.0) + density(1.0))).exp();
        assert!((exact[3] - expected).abs() < 1e-7, "{} {expected}", exact[3]);
    }

    #[test]
    fn the_march_takes_normals_from_the_smoothed_volume() {
        // Values rise away from the viewer, and to both sides of x = 8: a valley, which smoothing rounds.
        let field = |p: DVec3| 2.0 * p.y + 3.0 * (p.x - 8.0).abs();
        let camera = Camera::looking(DVec3::new(8.3, -9.0, 4.0), DVec3::Y, DVec3::Z, ORTHO).unwrap();
        let nodes = vec![node(0.0, 0, 1.0)];
        let mut scene = scene(volume([17, 17, 9], DAffine3::IDENTITY, field), nodes, vec![sphere_style()], camera);
        for sigma in [0.0, 0.9] {
            scene.objects[0].gradient_scale_mm = sigma;
            // The valley's own profile, smoothed: |x| under a Gaussian sampled at the integers to ±4.
            let bell = |k: i32| if k == 0 { 1.0 } else { (-0.5 * (f64::from(k) / sigma).powi(2)).exp() };
            let sum: f64 = (-4..=4).map(bell).sum();
            let profile = |x: i32| (-4..=4).map(|k| bell(k) * 3.0 * f64::from((x + k).abs())).sum::<f64>() / sum;
            let between = |x: i32| 0.7 * profile(x) + 0.3 * profile(x + 1);
            let g_x = 0.5 * (between(1) - between(-1));
            // The one sample is well inside; a picture of many rows has pixels below a voxel.
            let start = Reference::new(&scene).unwrap();
            let object = start.prepared().unwrap();
            let mut ray = ray_from_pixel(&scene.camera, [999, 999], 499, 499);
            ray.t_min = 9.0 + 8.0;
            let rgba = walk::march(object, &scene.camera, 999, &ray, 0.5, WHEN_OPAQUE).rgba;
            let n_x = -g_x / g_x.hypot(2.0);
            assert!((rgba[0] - (0.5 + 0.5 * n_x)).abs() < 1e-6 && (rgba[1] - 0.5).abs() < 1e-6, "{sigma}: {rgba:?}");
        }
    }

    #[test]
    fn the_march_blurs_styles_by_pixel_size_and_gradient() {
        // A style of stripes one texel wide: white at level 0, half gray from level 1 on.
        let stripes = Picture {
            width: STYLE_SIZE,
            height: STYLE_SIZE,
            pixels: (0..STYLE_SIZE * STYLE_SIZE).map(|i| [((i + 1) % 2) as f32, 0.0, 0.0, 1.0]).collect(),
        };
        let stripes = StyleImage::from_straight("stripes", &stripes).unwrap();
        // A slope whose normal meets texel 200 in its middle.
        let n_x: f64 = (2.0 * 200.0 + 1.0 - 256.0) / 255.0;
        let outward = DVec3::new(n_x, -(1.0 - n_x * n_x).sqrt(), 0.0);
        for steepest in [1.0, 50.0, 60.0] {
            // Further back it is steeper, and sets G.
            let field = |p: DVec3| -outward.dot(p) + steepest * (p.y - 12.0).max(0.0);
            let data = volume([17, 17, 9], DAffine3::IDENTITY, field);
            let camera = Camera::looking(DVec3::new(8.0, -20.0, 4.0), DVec3::Y, DVec3::Z, ORTHO).unwrap();
            let mut scene = scene(data, vec![node(0.0, 0, 1.0)], vec![stripes.clone()], camera);
            let red = |scene: &Scene, rows: u32| {
                let reference = Reference::new(scene).unwrap();
                let object = reference.prepared().unwrap();
                let mut ray = ray_from_pixel(&scene.camera, [1, rows], 0, rows / 2);
                // The one sample is at y = 5.25, 25.25 mm from the eye.
                ray.t_min = 25.0;
                let blur = 1.0 - (1.0 / object.gradient_max / 0.02).min(1.0);
                // 1 − smoothstep(s) = smoothstep(1 − s).
                let level = 3.0 * blur * blur * (3.0 - 2.0 * blur);
                (walk::march(object, &scene.camera, rows, &ray, 0.5, WHEN_OPAQUE).rgba[0], level)
            };
            for projection in [
                Projection::Orthographic { height_mm: 1.5 * 101.0 },
                Projection::Perspective { fov_y_deg: 2.0 * (0.75 * 101.0 / 25.25f64).atan().to_degrees() },
            ] {
                // Pixels of 1.5 voxels, and of less than one.
                scene.camera.projection = projection;
                for (rows, octaves) in [(101, 1.5f64.log2()), (301, 0.0)] {
                    let (red, level) = red(&scene, rows);
                    let expected = 1.0 - 0.5 * (octaves + level).min(1.0);
                    assert!((red - expected).abs() < 1e-6, "{steepest} {projection:?} {rows}: {red} {expected}");
                }
            }
        }
    }

    #[test]
    fn the_pixel_size_is_that_of_the_depth_not_of_the_distance() {
        // A style with a bright middle, which fades from mip to mip; without a gradient it is what shows, three levels
        // blurred at least.
        let spot = |i: usize| {
            let [x, y] = [i % STYLE_SIZE, i / STYLE_SIZE].map(|k| (k as f32 - 127.5) / 127.5);
            [(1.0 - 3.0 * x.hypot(y)).max(0.0), 0.0, 0.0, 1.0]
        };
        let pixels = (0..STYLE_SIZE * STYLE_SIZE).map(spot).collect();
        let style =
            StyleImage::from_straight("spot", &Picture { width: STYLE_SIZE, height: STYLE_SIZE, pixels }).unwrap();
        let wide = Projection::Perspective { fov_y_deg: 60.0 };
        let camera = Camera::looking(DVec3::new(60.0, -20.5, 11.0), DVec3::Y, DVec3::Z, wide).unwrap();
        let data = volume([121, 23, 23], DAffine3::IDENTITY, |_| 1.0);
        let scene = scene(data, vec![node(0.0, 0, 1.0)], vec![style.clone()], camera);
        let reference = Reference::new(&scene).unwrap();
        for x in [0, 8, 16, 32] {
            let h = 30f64.to_radians().tan();
            let across = h * (2.0 * (f64::from(x) + 0.5) - 33.0) / 11.0;
            // The one sample is a quarter of a voxel along the ray behind the depth of 26 mm, well inside.
            let mut ray = ray_from_pixel(&scene.camera, [33, 11], x, 5);
            ray.t_min = 26.0 * across.hypot(1.0);
            let object = reference.prepared().unwrap();
            let rgba = walk::march(object, &scene.camera, 11, &ray, 0.5, WHEN_OPAQUE).rgba;
            let depth = 26.0 + 0.25 / across.hypot(1.0);
            let expected = style::sample_style(&style, [0.5, 0.5], 3.0 + (2.0 * h * depth / 11.0).log2());
            assert!((rgba[0] - expected[0]).abs() < 1e-9, "{x}: {rgba:?} {expected:?}");
        }
    }

    #[test]
    fn nan_voxels_never_give_nan_pixels() {
        let grid = Grid::new([8, 8, 8], awkward_affines()[4]).unwrap();
        let broken = |i: usize| match i * 2654435761 % 11 {
            0 => f32::NAN,
            1 => f32::INFINITY,
            2 => f32::NEG_INFINITY,
            n => n as f32,
        };
        let center = grid.world_from_index().transform_point3(DVec3::splat(3.5));
        let camera = looking_at(center + DVec3::new(20.0, -20.0, 9.0), center, ORTHO);
        for all in [false, true] {
            let voxels = Voxels::F32((0..512).map(|i| if all { f32::NAN } else { broken(i) }).collect());
            let volume = Volume::new(grid, voxels, Rescale { slope: -2.0, intercept: 1.0 }, "test").unwrap();
            let nodes = vec![node(-20.0, 0, 0.9), node(0.0, 0, 0.1)];
            let mut scene = scene(volume, nodes, vec![sphere_style()], camera);
            scene.objects[0].gradient_scale_mm = 0.5;
            let picture = Reference::new(&scene).unwrap().image([40, 30], &Progress::new()).unwrap();
            assert!(picture.iter().flatten().all(|c| (0.0..=1.0 + 1e-12).contains(c)));
            assert_eq!(picture.iter().any(|p| p[3] > 0.1), !all);
        }
    }

    #[test]
    fn a_voxel_without_data_is_clear_at_its_center() {
        // A ray through a row of voxels of which one is missing; opacity falls to 0 there, linearly.
        let mut values = vec![1.0; 7 * 3 * 3];
        values[3 + 7 * (1 + 3)] = f64::NAN;
        let grid = Grid::new([7, 3, 3], DAffine3::IDENTITY).unwrap();
        let volume = Volume::new(grid, Voxels::F64(values), Rescale::IDENTITY, "test").unwrap();
        let camera = Camera::looking(DVec3::new(-9.0, 1.0, 1.0), DVec3::X, DVec3::Z, ORTHO).unwrap();
        let scene = scene(volume, vec![node(0.0, 0, 0.4)], vec![white()], camera);
        let march = Reference::new(&scene).unwrap().march([1, 1], 0, 0, 1.0, 0.0);
        assert_eq!((march.num_samples, march.num_visible), (7, 6));
        assert!((march.rgba[3] - (1.0 - 0.6f64.powi(6))).abs() < 1e-12);
        // Half a voxel apart, at k ± ¼: two samples beside the gap have a weight of ¼, two of ¾.
        let half = Reference::new(&scene).unwrap().march([1, 1], 0, 0, 0.5, 0.0);
        let clear = 0.6f64.powi(5) * (1.0 - 0.4 * 0.25) * (1.0 - 0.4 * 0.75);
        assert!((half.rgba[3] - (1.0 - clear)).abs() < 1e-12);
    }

    #[test]
    fn a_ray_parallel_to_a_face_is_in_or_out() {
        let base = slab(5, 0.3);
        let at = |y: f64| {
            let mut scene = base.clone();
            scene.camera.eye_mm.y = y;
            Reference::new(&scene).unwrap().march([1, 1], 0, 0, 1.0, 0.0)
        };
        let inside = at(2.0);
        assert_eq!(inside.num_samples, 5);
        assert_eq!((at(-0.5 + 1e-9), at(4.5 - 1e-9)), (inside, inside));
        assert_eq!((at(-0.5 - 1e-9), at(4.5 + 1e-9)), (March::default(), March::default()));
        // On the face itself: finite, one or the other.
        assert!([at(-0.5), at(4.5)].iter().all(|m| *m == inside || *m == March::default()));
    }

    #[test]
    fn a_camera_inside_sees_what_is_before_it() {
        let mut scene = slab(9, 0.2);
        scene.camera =
            Camera::looking(DVec3::splat(3.5), DVec3::X, DVec3::Z, Projection::Perspective { fov_y_deg: 60.0 })
                .unwrap();
        let march = Reference::new(&scene).unwrap().march([3, 3], 1, 1, 0.5, 0.0);
        assert_eq!(march.num_samples, 10);
        assert!((march.rgba[3] - (1.0 - 0.8f64.powi(5))).abs() < 1e-12);
        // A parallel projection has no eye to be inside with.
        scene.camera.projection = ORTHO;
        assert_eq!(Reference::new(&scene).unwrap().march([3, 3], 1, 1, 0.5, 0.0).num_samples, 18);
    }

    #[test]
    fn from_a_million_sizes_away_a_tiny_angle_is_a_parallel_projection() {
        let away = DVec3::new(0.0, -1.0, 0.0);
        let distance = 30.0 * 1e6;
        let fov_y_deg = 1e-3f64;
        let height_mm = 2.0 * distance * (0.5 * fov_y_deg.to_radians()).tan();
        let project = Projection::Perspective { fov_y_deg };
        let (far, center) = ball(DAffine3::IDENTITY, true, |c| looking_at(c + distance * away, c, project));
        let mut near = far.clone();
        near.camera = looking_at(center + 50.0 * away, center, Projection::Orthographic { height_mm });
        let (far, near) = (Reference::new(&far).unwrap(), Reference::new(&near).unwrap());
        let size = [1001, 1001];
        let mut num_hit = 0;
        for y in 480..521 {
            for x in 480..521 {
                let [a, b] = [&far, &near].map(|r| r.pixel_with_step(size, x, y, 1.0 / 16.0, WHEN_OPAQUE));
                let offset = (f64::from(x) - 500.0).hypot(f64::from(y) - 500.0) * height_mm / 1001.0;
                if (offset - 10.0).abs() > 0.2 {
                    // Sample grids start at the same face but for rounding: one step's difference at most.
                    assert!((0..4).all(|c| (a[c] - b[c]).abs() < 5e-3), "{x} {y}: {a:?} {b:?}");
                }
                num_hit += usize::from(a[3] == 1.0);
            }
        }
        assert!(num_hit > 900, "{num_hit}");
    }

    #[test]
    fn image_is_its_pixels_and_stops_on_request() {
        let (scene, _) = ball(awkward_affines()[2], true, |c| looking_at(c + DVec3::new(40.0, 9.0, 5.0), c, ORTHO));
        let reference = Reference::new(&scene).unwrap();
        let progress = Progress::new();
        let picture = reference.image([17, 9], &progress).unwrap();
        assert_eq!(progress.snapshot(), ("reference".to_owned(), 9, 9));
        assert_eq!(picture[4 * 17 + 8], reference.pixel([17, 9], 8, 4));
        assert_eq!(picture[4 * 17 + 8][3], 1.0);
        assert!(matches!(reference.image([0, 9], &progress), Err(Error::Scene { .. })));
        assert!(matches!(reference.image_with([9, 9], 0.0, 0.0, &progress), Err(Error::Scene { .. })));
        progress.cancel();
        assert!(matches!(reference.image([17, 9], &progress), Err(Error::Cancelled)));
    }

    #[test]
    fn an_empty_scene_is_clear_and_a_faulty_one_refused() {
        let mut scene = slab(3, 0.5);
        scene.objects[0].volume = Arc::new(volume([3; 3], DAffine3::IDENTITY, |p| 1e200 * p.x));
        assert!(Reference::new(&scene).unwrap_err().to_string().contains("too large"));
        scene.objects[0].transfer_function.nodes.clear();
        assert!(Reference::new(&scene).is_err());
        scene.objects.clear();
        let reference = Reference::new(&scene).unwrap();
        assert!(reference.prepared().is_none());
        assert_eq!(reference.march([2, 2], 1, 1, 1.0, 0.0), March::default());
    }
}
