//! "What is this?": what a pixel of a picture shows, found on the CPU with one ray and without anything that would have to
//! be prepared for it.
//!
//! The method is that of A. Wiebel, F. M. Vos, D. Foerster and H.-C. Hege, *WYSIWYP: What You See Is What You Pick* (IEEE
//! TVCG 18(12), 2012): along the ray opacity piles up, and what a viewer takes for the thing that is seen is where it jumps
//! most. Theirs cuts the ray at every minimum of its slope; here a minimum counts from a depth of one half on, as the noise
//! of a scan would else cut a thick translucent body into slices.

use std::cell::{OnceCell, RefCell};
use std::ops::Range;

use glam::{DMat3, DVec3, DVec4};

use crate::reference::color::{Jacobian, premultiplied};
use crate::reference::opacity::opacity_correct;
use crate::reference::piece::classify_piece;
use crate::reference::ray::{Ray, ray_from_pixel, samples};
use crate::reference::region::{end_face, joined, where_flat};
use crate::reference::sample::{Quantity, central_differences, trilinear};
use crate::reference::style::{
    Face, RayFrame, at_node, face_normal, ray_frame, shade, steepness, style_level, style_normal,
};
use crate::scene::{Object, Scene, StyleTransferFunction};
use crate::volume::bricks::BRICK;

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Where it is: world (RAS), mm.
    pub position_mm: DVec3,
    /// The data value there (CT: HU).
    pub value: f64,
    /// ‖ĝ‖ there, from 0 to 1: steeper than G counts as 1, and a face of the volume as at least what it looks like.
    pub gradient: f64,
    /// How much of the pixel it is, from 0 to 1: the jump of the ray's opacity.
    pub opacity: f64,
    /// Node coordinate of the transfer function that is seen there: i + w is w of the way from node i to node i + 1.
    pub node: f64,
    /// The region of the object that shows most of the jump; none: what belongs to no region.
    pub region: Option<usize>,
}

/// Length of a piece of the ray, in voxels.
const STEP_VOXELS: f64 = 0.5;
/// A jump below this is nothing that a viewer could mean.
const LEAST_OPACITY: f64 = 0.01;
/// A ray whose transmittance is below this holds no jump worth picking.
const SPENT: f64 = 0.1 * LEAST_OPACITY;
/// Gauss-Hermite quadrature with three points: a Gaussian of deviation σ as samples at these multiples of it. Exact for
/// polynomials of up to the fifth degree, which is closer than the normals of a picture need.
const GAUSSIAN: [(f64, f64); 3] =
    [(-1.732_050_807_568_877_2, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732_050_807_568_877_2, 1.0 / 6.0)];
/// Up to this share of the slope before and behind it, a minimum parts two things.
const DIP: f64 = 0.5;

/// What pixel (column `x`, row `y` from the top left) of a picture of `image_size` (width, height) pixels shows of the
/// scene's first object; `None` where it shows nothing or is not in the picture, and for a scene that
/// [`Scene::validate`] refuses.
///
/// Regions count as in pictures (docs/rendering.md §8): with their shares of each place, so that a hidden one is looked through.
/// Of a jump that several of them make, the answer is about the one that shows most of it.
///
/// It reads the voxels near the ray only. Opacities are those of the picture, both ends of a piece and the style's own
/// included; normals are of data smoothed by σ_g, by quadrature at the place itself. G (and, beside wide gaps, the range of the data) comes from the volume,
/// which finds it once; a volume that was drawn has it.
pub fn pick(scene: &Scene, image_size: [u32; 2], x: u32, y: u32) -> Option<Pick> {
    let object = scene.objects.first()?;
    if x >= image_size[0] || y >= image_size[1] || scene.validate().is_err() {
        return None;
    }
    let line = Line::new(scene, object, image_size[1], ray_from_pixel(&scene.camera, image_size, x, y));
    let seen = line.march();
    let opacities: Vec<f64> = seen.iter().map(|s| s.opacity).collect();
    let jump = largest_jump(&opacities);
    let opacity: f64 = opacities[jump.clone()].iter().sum();
    if opacity < LEAST_OPACITY {
        return None;
    }
    let shown: Vec<&Shown> = seen[jump].iter().flat_map(|s| &s.shown).collect();
    let region = most_shown(&shown)?;
    let best = shown.iter().filter(|s| s.region == region).max_by(|a, b| a.opacity.total_cmp(&b.opacity))?;
    Some(Pick {
        position_mm: line.ray.origin_mm + best.t * line.ray.direction,
        value: line.field.value(line.at(best.t)),
        gradient: best.steepness.min(1.0),
        opacity,
        node: best.node,
        region,
    })
}

/// Which region shows most of a stretch, in all; none of nothing.
fn most_shown(shown: &[&Shown]) -> Option<Option<usize>> {
    let mut sums: Vec<(Option<usize>, f64)> = Vec::new();
    for part in shown {
        match sums.iter_mut().find(|(region, _)| *region == part.region) {
            Some((_, sum)) => *sum += part.opacity,
            None => sums.push((part.region, part.opacity)),
        }
    }
    sums.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(region, _)| region)
}

/// The stretch of a ray over which its opacity rises most, in a row of what each piece adds to it. Stretches are parted at
/// the minima that are at most [`DIP`] of the largest before and of what follows.
fn largest_jump(opacities: &[f64]) -> Range<usize> {
    let (mut best, mut best_sum) = (0..0, 0.0);
    let mut close = |stretch: Range<usize>| {
        let sum: f64 = opacities[stretch.clone()].iter().sum();
        if sum > best_sum {
            (best, best_sum) = (stretch, sum);
        }
    };
    // The present stretch: its first piece, its largest, and the smallest since then.
    let (mut first, mut peak, mut valley) = (0, 0.0, 0);
    for (i, &opacity) in opacities.iter().enumerate() {
        let low = opacities[valley];
        if low <= DIP * peak && low < DIP * opacity {
            close(first..valley);
            (first, peak, valley) = (valley, opacity, i);
        } else if opacity >= peak {
            (peak, valley) = (opacity, i);
        } else if opacity < low {
            valley = i;
        }
    }
    close(first..opacities.len());
    best
}

/// What a piece of the ray adds to the pixel.
#[derive(Default)]
struct Seen {
    /// Opacity, as far as what lies before it lets it through.
    opacity: f64,
    /// What it consists of.
    shown: Vec<Shown>,
}

/// What one region, or the background, shows of a piece.
struct Shown {
    region: Option<usize>,
    /// Where it is seen, mm along the ray.
    t: f64,
    /// Node coordinate of its transfer function.
    node: f64,
    /// ‖ĝ‖ there, or what a face makes of it.
    steepness: f64,
    /// Its part of the piece's opacity.
    opacity: f64,
}

/// A look at a piece of the ray, and what it would show of it if all of the place were its own.
struct Classed {
    region: Option<usize>,
    /// w: its share of the place.
    share: f64,
    /// Where it is seen, mm along the ray.
    t: f64,
    node: f64,
    /// α_u of one of its reference lengths.
    opacity: f64,
}

/// The data as pictures reconstruct them (docs/rendering.md §2), voxel by voxel as they are asked for.
struct Field<'a> {
    object: &'a Object,
    /// Smallest data value of the volume.
    least: OnceCell<f64>,
}

impl Field<'_> {
    /// The data value of a voxel; where it has none, the smallest of its neighbors', else of the volume's.
    fn voxel(&self, x: usize, y: usize, z: usize) -> f64 {
        let volume = &self.object.volume;
        let value = volume.value(x, y, z);
        if value.is_finite() {
            return value;
        }
        let [nx, ny, nz] = volume.grid.dims();
        let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
        let mut smallest = f64::INFINITY;
        for zz in around(z, nz) {
            for yy in around(y, ny) {
                for xx in around(x, nx) {
                    let neighbor = volume.value(xx, yy, zz);
                    smallest = if neighbor.is_finite() { smallest.min(neighbor) } else { smallest };
                }
            }
        }
        if smallest.is_finite() { smallest } else { *self.least.get_or_init(|| self.object.data_range().0) }
    }

    /// Data value at the index-space position `p`.
    fn value(&self, p: DVec3) -> f64 {
        trilinear(self.object.volume.grid.dims(), p, |x, y, z| self.voxel(x, y, z))
    }

    /// Premultiplied linear color at `p`, in a volume of colors.
    fn color(&self, colors: &[[u8; 4]], p: DVec3) -> DVec4 {
        let dims = self.object.volume.grid.dims();
        trilinear(dims, p, |x, y, z| premultiplied(colors[x + dims[0] * (y + dims[1] * z)]))
    }

    /// ĝ's numerator at `p`: the gradient of the data, or what the change of colors makes of it, smoothed by a Gaussian of
    /// deviation `sigma` (in voxels along each axis).
    fn gradient(&self, p: DVec3, sigma: DVec3, to_world: DMat3) -> DVec3 {
        match &self.object.volume.colors {
            None => central_differences(|p| smoothed(|p| self.value(p), p, sigma), to_world, p),
            Some(colors) => Jacobian::at(|p| smoothed(|p| self.color(colors, p), p, sigma), to_world, p).gradient(),
        }
    }

    /// Weight, from 0 to 1, of the voxels around `p` that have data, and the alpha of colors.
    fn has_data(&self, p: DVec3) -> f64 {
        let volume = &self.object.volume;
        if let Some(colors) = &volume.colors {
            return self.color(colors, p).w;
        }
        trilinear(volume.grid.dims(), p, |x, y, z| if volume.value(x, y, z).is_finite() { 1.0 } else { 0.0 })
    }
}

/// A field at `p`, smoothed by a Gaussian of deviation `sigma` (in voxels along each axis).
fn smoothed<T: Quantity>(field: impl Fn(DVec3) -> T, p: DVec3, sigma: DVec3) -> T {
    let middle = field(p);
    if sigma == DVec3::ZERO {
        return middle;
    }
    // As differences from the middle, which keep a constant.
    let mut sum = middle;
    for (z, weight_z) in GAUSSIAN {
        for (y, weight_y) in GAUSSIAN {
            for (x, weight_x) in GAUSSIAN {
                let weight = weight_x * weight_y * weight_z;
                sum = sum + (field(p + DVec3::new(x, y, z) * sigma) - middle) * weight;
            }
        }
    }
    sum
}

/// Bricks around a place, first and last along each axis, and the regions that have voxels in them.
type Nearby = ([[usize; 2]; 3], Vec<usize>);

/// One ray through an object.
struct Line<'a> {
    scene: &'a Scene,
    field: Field<'a>,
    image_height: u32,
    ray: Ray,
    frame: RayFrame,
    /// The ray in index space.
    origin: DVec3,
    direction: DVec3,
    /// d₀ of the object, mm.
    reference_length_mm: f64,
    /// What was last asked for: successive places are in the same bricks.
    nearby: RefCell<Nearby>,
}

impl<'a> Line<'a> {
    fn new(scene: &'a Scene, object: &'a Object, image_height: u32, ray: Ray) -> Self {
        let index_from_world = object.volume.grid.index_from_world();
        Self {
            scene,
            field: Field { object, least: OnceCell::new() },
            image_height,
            ray,
            frame: ray_frame(&scene.camera, ray.direction),
            origin: index_from_world.transform_point3(ray.origin_mm),
            direction: index_from_world.matrix3 * ray.direction,
            reference_length_mm: object.reference_length_mm(),
            nearby: RefCell::new(([[usize::MAX; 2]; 3], Vec::new())),
        }
    }

    /// Index position at `t` mm.
    fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }

    /// ĝ at `t`.
    fn gradient(&self, t: f64) -> DVec3 {
        let volume = &self.field.object.volume;
        let to_world = volume.grid.world_gradient_from_index();
        let sigma = DVec3::splat(self.field.object.gradient_scale_mm) / volume.grid.spacing_mm();
        self.field.gradient(self.at(t), sigma, to_world) / volume.gradient_max()
    }

    /// The transfer function and the factor of opacity of a region or, for none, of the background.
    fn look(&self, region: Option<usize>) -> (&'a StyleTransferFunction, f64) {
        let object = self.field.object;
        match region {
            None => (&object.transfer_function, 1.0),
            Some(i) => (&object.regions[i].look.transfer_function, object.regions[i].look.opacity),
        }
    }

    /// How the index position `p` is shared out: the background first, and every region that has voxels within one and a half
    /// voxels around, in the object's order.
    fn shares(&self, p: DVec3) -> Vec<(Option<usize>, f64)> {
        let object = self.field.object;
        if object.regions.is_empty() {
            return vec![(None, 1.0)];
        }
        let dims = object.volume.grid.dims();
        let around = std::array::from_fn(|axis| {
            let voxel = |x: f64| (x.max(0.0) as usize).min(dims[axis] - 1);
            [voxel(p[axis] - 1.0) / BRICK, voxel(p[axis] + 2.0) / BRICK]
        });
        let mut nearby = self.nearby.borrow_mut();
        if nearby.0 != around {
            let [xs, ys, zs] = around.map(|[first, last]| first..=last);
            let places: Vec<[usize; 3]> = zs
                .flat_map(|z| ys.clone().map(move |y| (y, z)))
                .flat_map(|(y, z)| xs.clone().map(move |x| [x, y, z]))
                .collect();
            let has_voxels = |i: &usize| {
                let selection = &object.regions[*i].selection;
                places.iter().any(|place| !selection.brick(*place).is_empty())
            };
            *nearby = (around, (0..object.regions.len()).filter(has_voxels).collect());
        }
        let membership = |i: &usize| {
            let selection = &object.regions[*i].selection;
            trilinear(dims, p, |x, y, z| f64::from(selection.get([x, y, z])) / 255.0)
        };
        let wanted: Vec<f64> = nearby.1.iter().map(membership).collect();
        let sum: f64 = wanted.iter().sum();
        let regions = nearby.1.iter().zip(&wanted).map(|(i, f)| (Some(*i), f / sum.max(1.0)));
        std::iter::once((None, (1.0 - sum).max(0.0))).chain(regions).collect()
    }

    /// What every piece of the ray adds, front to back, until nothing shows through.
    fn march(&self) -> Vec<Seen> {
        let mut seen = Vec::new();
        let Some(pieces) = samples(&self.ray, &self.field.object.volume.grid, STEP_VOXELS) else { return seen };
        let mut clear = 1.0;
        let mut front = self.field.value(self.at(pieces.t0));
        for k in 0..pieces.count {
            let (start, end) = pieces.piece(k);
            let back = self.field.value(self.at(end));
            let classed: Vec<Classed> = self
                .shares(self.at(0.5 * (start + end)))
                .into_iter()
                .map(|(region, share)| self.classify(region, share, [start, end], [front, back]))
                .collect();
            let mut piece = self.see(&classed, [start, end]);
            piece.opacity *= clear;
            piece.shown.iter_mut().for_each(|s| s.opacity *= clear);
            clear -= piece.opacity;
            seen.push(piece);
            if clear < SPENT {
                break;
            }
            front = back;
        }
        seen
    }

    /// What a look makes of the piece between two places (mm) with two values.
    fn classify(&self, region: Option<usize>, share: f64, ends: [f64; 2], values: [f64; 2]) -> Classed {
        let ([start, end], [front, back]) = (ends, values);
        let (function, factor) = self.look(region);
        // The quadrature is for what shows something.
        if factor * function.max_opacity(front.min(back), front.max(back)) <= 0.0 {
            return Classed { region, share, t: start, node: 0.0, opacity: 0.0 };
        }
        let found = classify_piece(function, front, back, (end - start) / function.reference_length_mm);
        let opacity = -(-found.extinction).exp_m1();
        Classed { region, share, t: start + found.middle * (end - start), node: found.node, opacity }
    }

    /// Opacities of a piece between two places (mm), whole and in its parts.
    fn see(&self, classed: &[Classed], [start, end]: [f64; 2]) -> Seen {
        if classed.iter().all(|c| c.share <= 0.0 || c.opacity <= 0.0) {
            return Seen::default();
        }
        let mut cut = Face { normal: DVec3::ZERO, weight: 0.0 };
        if classed.len() > 1 {
            let middle = 0.5 * (start + end);
            let shows = |region: Option<usize>| {
                let found = classed.iter().find(|c| c.region == region);
                found.map_or(0.0, |c| self.look(region).1 * c.opacity)
            };
            let shown = |p: DVec3| self.shares(p).iter().map(|(region, share)| share * shows(*region)).sum();
            let to_world = self.field.object.volume.grid.world_gradient_from_index();
            cut = end_face(shown, self.at(middle), to_world);
            // What does not end here has no face whatever the gradient, which is long in the making.
            if cut.weight > 0.0 {
                cut = where_flat(cut, self.gradient(middle).length());
            }
        }
        let parts = classed.iter().filter(|c| c.share > 0.0 && c.opacity > 0.0).map(|c| self.appearance(c, cut));
        let mut seen = Seen { opacity: 0.0, shown: parts.collect() };
        let alpha: f64 = seen.shown.iter().map(|s| s.opacity).sum();
        seen.opacity = opacity_correct(alpha.min(1.0), (end - start) / self.reference_length_mm);
        if alpha > 0.0 {
            seen.shown.iter_mut().for_each(|s| s.opacity *= seen.opacity / alpha);
        }
        seen
    }

    /// A look's part, w α, of one reference length of the object.
    fn appearance(&self, of: &Classed, cut: Face) -> Shown {
        let object = self.field.object;
        let camera = &self.scene.camera;
        let (function, factor) = self.look(of.region);
        let class = at_node(function, of.node, of.opacity);
        let (gradient, face) = (self.gradient(of.t), joined(face_normal(&object.volume.grid, self.at(of.t)), cut));
        let n_xy = style_normal(gradient, face, self.ray.direction, &self.frame);
        let depth_mm = (self.ray.origin_mm + of.t * self.ray.direction - camera.eye_mm).dot(camera.forward);
        let spacing_mm = object.volume.grid.spacing_mm().min_element();
        let steepness = steepness(gradient, face);
        let level = style_level(camera, self.image_height, depth_mm, spacing_mm, steepness);
        let (_, alpha_d) = shade(&self.scene.styles, &class, n_xy, level);
        let alpha = factor * alpha_d * of.opacity * self.field.has_data(self.at(of.t));
        let lengths = self.reference_length_mm / function.reference_length_mm;
        let opacity = of.share * opacity_correct(alpha, lengths);
        Shown { region: of.region, t: of.t, node: of.node, steepness, opacity }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DAffine3;

    use super::*;
    use crate::image_out::Picture;
    use crate::reference::Reference;
    use crate::reference::testing::{awkward_affines, looking_at, node, scene, sphere_style, volume};
    use crate::scene::{Look, Projection, Region, TransferFunctionNode};
    use crate::selection::{BrickPool, Selection};
    use crate::spaces::Grid;
    use crate::styles::{STYLE_SIZE, StyleImage, normal_from_uv};
    use crate::volume::{Rescale, Volume, Voxels};

    const ORTHO: Projection = Projection::Orthographic { height_mm: 33.0 };
    const PERSPECTIVE: Projection = Projection::Perspective { fov_y_deg: 30.0 };
    /// The pixel in the middle of it is on the view axis.
    const SIZE: [u32; 2] = [33, 33];

    fn white() -> StyleImage {
        StyleImage::flat("white", [1.0; 4])
    }

    /// Opaque from 500 on.
    fn solid() -> Vec<TransferFunctionNode> {
        vec![node(500.0, 0, 0.0), node(500.0, 0, 1.0)]
    }

    /// 500 on a sphere of `radius` mm around `center`, more inside and less outside, from 0 to 1000.
    fn ball(p: DVec3, center: DVec3, radius: f64) -> f64 {
        (500.0 + 200.0 * (radius - p.distance(center))).clamp(0.0, 1000.0)
    }

    const CENTER: DVec3 = DVec3::splat(16.0);

    /// A ball of radius 6 mm, opaque, in a shell of −400 at 12 mm; −250 is 0.75 mm to either side. Beyond that the shell
    /// has the opacity `shell` per mm. 33³ voxels of 1 mm, seen from the front (from −y) at 100 mm.
    fn ball_in_shell(shell: f64, projection: Projection) -> Scene {
        let field = |p: DVec3| {
            let r = p.distance(CENTER);
            if r < 9.5 { ball(p, CENTER, 6.0) } else { -400.0 * (1.0 - (r - 12.0).abs() / 2.0).max(0.0) }
        };
        let nodes = [vec![node(-250.0, 0, shell), node(-250.0, 0, 0.0)], solid()].concat();
        let camera = looking_at(CENTER - 100.0 * DVec3::Y, CENTER, projection);
        scene(volume([33; 3], DAffine3::IDENTITY, field), nodes, vec![white()], camera)
    }

    #[test]
    fn the_ball_is_picked_through_a_faint_shell_and_the_shell_when_it_hides_it() {
        for projection in [ORTHO, PERSPECTIVE] {
            // 1.5 mm of shell: up to a = 0.37 per mm it is less than what is left for the ball.
            for (shell, radius) in [(0.0, 6.0), (0.05, 6.0), (0.2, 6.0), (0.5, 12.75), (1.0, 12.75)] {
                let picked = pick(&ball_in_shell(shell, projection), SIZE, 16, 16).unwrap();
                let through = (1.0f64 - shell).powf(1.5);
                assert!((picked.position_mm - (CENTER - radius * DVec3::Y)).length() < 0.5, "{shell}: {picked:?}");
                let opacity = if radius == 6.0 { through } else { 1.0 - through };
                assert!((picked.opacity - opacity).abs() < 0.04, "{shell}: {picked:?} is not {opacity}");
                let (value, at) = if radius == 6.0 { (500.0, 3.0) } else { (-250.0, 0.0) };
                assert!((picked.value - value).abs() < 100.0 && (picked.node - at).abs() < 1e-6, "{picked:?}");
                assert!((0.2..=1.0).contains(&picked.gradient), "{picked:?}");
            }
        }
        // Beside the middle, at 4 mm (rows count from the top), and past it all.
        let picked = pick(&ball_in_shell(0.05, ORTHO), SIZE, 16, 12).unwrap();
        let expected = CENTER + DVec3::new(0.0, -(36.0f64 - 16.0).sqrt(), 4.0);
        assert!((picked.position_mm - expected).length() < 0.5, "{picked:?}");
        assert_eq!(pick(&ball_in_shell(0.0, ORTHO), SIZE, 16, 9), None);
        assert_eq!(pick(&ball_in_shell(1.0, ORTHO), SIZE, 1, 1), None);
    }

    #[test]
    fn positions_are_in_the_world_whatever_the_grid() {
        for affine in awkward_affines() {
            let center = affine.transform_point3(DVec3::new(24.0, 20.0, 22.0));
            let data = volume([48, 41, 45], affine, |p| ball(p, center, 6.0));
            let half_voxel = 0.5 * data.grid.spacing_mm().max_element();
            let mut turned = scene(data, solid(), vec![sphere_style()], looking_at(center, center + DVec3::X, ORTHO));
            for from in [DVec3::X, DVec3::new(-1.0, 2.0, 0.5).normalize(), DVec3::new(0.3, -0.2, -1.0).normalize()] {
                for projection in [ORTHO, PERSPECTIVE] {
                    turned.camera = looking_at(center + 60.0 * from, center, projection);
                    let picked = pick(&turned, SIZE, 16, 16).unwrap();
                    let off = picked.position_mm - (center + 6.0 * from);
                    assert!(off.length() < half_voxel, "{affine:?} from {from}: off by {off}");
                    // Aside of the axis by 3 pixels each: on its own ray, on the sphere, on the near side.
                    let ray = ray_from_pixel(&turned.camera, SIZE, 19, 13);
                    let picked = pick(&turned, SIZE, 19, 13).unwrap();
                    assert!((picked.position_mm - ray.origin_mm).cross(ray.direction).length() < 1e-9);
                    assert!((picked.position_mm.distance(center) - 6.0).abs() < half_voxel, "{picked:?}");
                    assert!((picked.position_mm - center).dot(from) > 0.0);
                }
            }
        }
    }

    #[test]
    fn what_shows_nothing_is_nothing() {
        let shown = ball_in_shell(1.0, ORTHO);
        for (size, x, y) in [(SIZE, 33, 16), (SIZE, 16, 33), ([0, 0], 0, 0), ([33, 0], 1, 0)] {
            assert_eq!(pick(&shown, size, x, y), None, "{size:?} {x} {y}");
        }
        // Away from it in perspective; in a parallel projection there is no behind.
        for (projection, is_seen) in [(PERSPECTIVE, false), (ORTHO, true)] {
            let away = looking_at(CENTER - 100.0 * DVec3::Y, CENTER - 200.0 * DVec3::Y, projection);
            assert_eq!(pick(&Scene { camera: away, ..shown.clone() }, SIZE, 16, 16).is_some(), is_seen);
        }
        // A slab of 32 voxels that takes 0.6 %, and one that takes 2 %.
        let slab = |alpha: f64| {
            let camera = looking_at(CENTER - 100.0 * DVec3::Y, CENTER, ORTHO);
            scene(volume([33; 3], DAffine3::IDENTITY, |_| 1.0), vec![node(0.0, 0, alpha)], vec![white()], camera)
        };
        assert_eq!(pick(&slab(0.006 / 33.0), SIZE, 16, 16), None);
        assert!((pick(&slab(0.02 / 33.0), SIZE, 16, 16).unwrap().opacity - 0.02).abs() < 1e-3);
        let mut faulty = shown.clone();
        faulty.objects[0].transfer_function.nodes.clear();
        assert_eq!(pick(&faulty, SIZE, 16, 16), None);
        assert_eq!(pick(&Scene { objects: Vec::new(), ..shown }, SIZE, 16, 16), None);
    }

    #[test]
    fn a_style_that_is_clear_face_on_is_picked_at_the_rim() {
        let texel = |i: usize| {
            let uv = [i % STYLE_SIZE, i / STYLE_SIZE].map(|k| (k as f64 + 0.5) / STYLE_SIZE as f64);
            let n = normal_from_uv(uv, STYLE_SIZE);
            [1.0, 1.0, 1.0, if n[0].hypot(n[1]) > 0.8 { 1.0 } else { 0.0 }]
        };
        let pixels = (0..STYLE_SIZE * STYLE_SIZE).map(texel).collect();
        let contour = Picture { width: STYLE_SIZE, height: STYLE_SIZE, pixels };
        let mut drawn = ball_in_shell(0.0, ORTHO);
        drawn.styles = vec![Arc::new(StyleImage::from_straight("contour", &contour).unwrap())];
        assert_eq!(pick(&drawn, SIZE, 16, 16), None);
        assert!(pick(&drawn, [330, 330], 165 + 57, 165).is_some());
    }

    #[test]
    fn a_camera_inside_picks_what_is_before_it() {
        let mut inside = ball_in_shell(1.0, PERSPECTIVE);
        let eye = CENTER + DVec3::new(0.0, 0.0, 9.0);
        for (target, radius) in [(CENTER + 20.0 * DVec3::Z, 11.25), (CENTER, 6.0)] {
            inside.camera = looking_at(eye, target, PERSPECTIVE);
            let picked = pick(&inside, SIZE, 16, 16).unwrap();
            assert!((picked.position_mm - (CENTER + radius * DVec3::Z)).length() < 0.5, "{picked:?}");
        }
    }

    #[test]
    fn a_slice_of_one_voxel_is_picked_from_either_side_and_along_it() {
        let grid = Grid::new([32, 32, 1], DAffine3::from_scale(DVec3::new(1.0, 1.0, 3.0))).unwrap();
        let slice = || Volume::new(grid, Voxels::U8(vec![200; 1024]), Rescale::IDENTITY, "test").unwrap();
        let center = DVec3::new(15.5, 15.5, 0.0);
        for (from, depth) in [(DVec3::Z, 1.5), (DVec3::NEG_Z, 1.5), (DVec3::NEG_X, 16.0)] {
            let camera = looking_at(center + 50.0 * from, center, ORTHO);
            let picked = pick(&scene(slice(), vec![node(0.0, 0, 1.0)], vec![white()], camera), SIZE, 16, 16).unwrap();
            let off = (picked.position_mm - (center + depth * from)).length();
            assert!(off < 0.5 * grid.spacing_mm().max_element(), "{from}: {picked:?}");
            assert!((picked.value, picked.opacity) == (200.0, 1.0) && picked.gradient > 0.01, "{picked:?}");
        }
    }

    #[test]
    fn voxels_without_data_are_not_there() {
        let mut cut = ball_in_shell(0.0, ORTHO);
        let whole = cut.objects[0].volume.clone();
        let Voxels::F64(values) = &whole.voxels else { panic!() };
        // All before y = 16 is missing, so the ball shows its cut; then all is.
        let with = |missing: &dyn Fn([usize; 3]) -> bool| {
            let at = |i: usize| [i % 33, i / 33 % 33, i / 1089];
            let gap = |(i, &v): (usize, &f64)| if missing(at(i)) { f64::NAN } else { v };
            let values = values.iter().enumerate().map(gap).collect();
            Arc::new(Volume::new(whole.grid, Voxels::F64(values), Rescale::IDENTITY, "test").unwrap())
        };
        cut.objects[0].volume = with(&|p| p[1] < 16);
        let picked = pick(&cut, SIZE, 16, 16).unwrap();
        assert!((picked.position_mm - (CENTER - 0.5 * DVec3::Y)).length() < 0.75, "{picked:?}");
        assert!(picked.value > 900.0 && picked.gradient.is_finite());
        cut.objects[0].volume = with(&|_| true);
        assert_eq!(pick(&cut, SIZE, 16, 16), None);
    }

    #[test]
    fn the_opacity_of_a_ray_is_that_of_the_picture() {
        // Translucent, with gaps and a style whose opacity depends on the normal, in a crooked grid.
        let texel = |i: usize| [1.0, 1.0, 1.0, 0.3 + 0.6 * (i % STYLE_SIZE) as f32 / STYLE_SIZE as f32];
        let pixels = (0..STYLE_SIZE * STYLE_SIZE).map(texel).collect();
        let uneven = Picture { width: STYLE_SIZE, height: STYLE_SIZE, pixels };
        let uneven = StyleImage::from_straight("uneven", &uneven).unwrap();
        let affine = awkward_affines()[4];
        let center = affine.transform_point3(DVec3::splat(15.5));
        let field =
            |p: DVec3| if p.x.sin() > 0.98 { f64::NAN } else { ball(p, center, 6.0) + 40.0 * (p.y * 0.8).sin() };
        let nodes = vec![node(100.0, 0, 0.0), node(400.0, 0, 0.3), node(420.0, 0, 0.02), node(900.0, 0, 0.1)];
        let camera = looking_at(center + DVec3::new(40.0, -50.0, 20.0), center, PERSPECTIVE);
        let drawn = scene(volume([32; 3], affine, field), nodes, vec![uneven], camera);
        let reference = Reference::new(&drawn).unwrap();
        let mut opaque: f64 = 0.0;
        for i in 0..33 {
            let line = Line::new(&drawn, &drawn.objects[0], 33, ray_from_pixel(&drawn.camera, SIZE, i, (7 * i) % 33));
            let ours: f64 = line.march().iter().map(|s| s.opacity).sum();
            let theirs = reference.pixel_with_step(SIZE, i, (7 * i) % 33, 1.0 / 64.0, 0.0)[3];
            assert!((ours - theirs).abs() < 0.02, "{i}: {ours} is not {theirs}");
            opaque = opaque.max(theirs);
        }
        assert!(opaque > 0.5, "{opaque}");
    }

    #[test]
    fn largest_jump_parts_at_deep_minima_only() {
        assert_eq!(largest_jump(&[]), 0..0);
        assert_eq!(largest_jump(&[0.0; 4]), 0..0);
        // Two bumps with nothing between them; the first is higher, the second more.
        let two = [0.0, 0.3, 0.0, 0.0, 0.1, 0.2, 0.1, 0.0];
        let jump = largest_jump(&two);
        assert!(jump.contains(&4) && jump.contains(&6) && !jump.contains(&1), "{jump:?}");
        // A thick body with noise is one thing, more than the thin sheet before it.
        let body: Vec<f64> = [0.0, 0.15, 0.0].into_iter().chain((0..40).map(|i| [0.02, 0.013][i % 2])).collect();
        assert_eq!(largest_jump(&body), 2..43);
        // A minimum counts if both sides rise to twice its height; then it is the second's first.
        assert_eq!(largest_jump(&[0.1, 0.04, 0.2, 0.2]), 1..4);
        assert_eq!(largest_jump(&[0.1, 0.06, 0.2, 0.2]), 0..4);
        assert_eq!(largest_jump(&[0.06, 0.04, 0.2, 0.2]), 0..4);
    }

    /// A region of a 33³ volume whose memberships are a field's, with `nodes` as its look.
    fn region(
        name: &str,
        drawn: &Scene,
        nodes: Vec<TransferFunctionNode>,
        membership: impl Fn([usize; 3]) -> u8 + Sync,
    ) -> Region {
        let grid = drawn.objects[0].volume.grid;
        let mut selection = Selection::empty(grid, &Arc::new(BrickPool::default()));
        selection.change(grid.dims().map(|n| [0, n]), |p, _| membership(p));
        let transfer_function = StyleTransferFunction { nodes, reference_length_mm: 1.0 };
        Region { name: name.to_owned(), selection, look: Look::plain(transfer_function), moved: None }
    }

    /// Opaque wherever it is.
    fn opaque() -> Vec<TransferFunctionNode> {
        vec![node(0.0, 0, 1.0)]
    }

    /// 33³ voxels of 1 mm and of one value, seen from the front, which show nothing but by regions.
    fn plain(background: f64) -> Scene {
        let camera = looking_at(CENTER - 100.0 * DVec3::Y, CENTER, ORTHO);
        scene(volume([33; 3], DAffine3::IDENTITY, |_| 1.0), vec![node(0.0, 0, background)], vec![white()], camera)
    }

    #[test]
    fn a_hidden_region_is_looked_through_and_a_shown_one_is_named() {
        let mut drawn = plain(0.0);
        // Two plates one behind the other: rows 5 to 9 and 20 to 24 along y.
        for (name, rows) in [("front", 5..10), ("back", 20..25)] {
            let plate = region(name, &drawn, opaque(), |[_, y, _]| if rows.contains(&y) { 255 } else { 0 });
            drawn.objects[0].regions.push(plate);
        }
        let picked = pick(&drawn, SIZE, 16, 16).unwrap();
        assert!(picked.region == Some(0) && (4.0..5.5).contains(&picked.position_mm.y), "{picked:?}");
        drawn.objects[0].regions[0].look.opacity = 0.0;
        let picked = pick(&drawn, SIZE, 16, 16).unwrap();
        assert!(picked.region == Some(1) && (19.0..20.5).contains(&picked.position_mm.y), "{picked:?}");
        // A faint one is looked through as well, and named once nothing is behind it.
        drawn.objects[0].regions[0].look.opacity = 0.02;
        assert_eq!(pick(&drawn, SIZE, 16, 16).unwrap().region, Some(1));
        drawn.objects[0].regions[1].look.opacity = 0.0;
        let picked = pick(&drawn, SIZE, 16, 16).unwrap();
        let shown = 1.0 - (1.0f64 - 0.02).powi(5);
        assert!(picked.region == Some(0) && (picked.opacity - shown).abs() < 0.003, "{picked:?} is not {shown}");
        drawn.objects[0].regions[0].look.opacity = 0.0;
        assert_eq!(pick(&drawn, SIZE, 16, 16), None);
    }

    #[test]
    fn the_background_has_what_regions_leave_of_it() {
        // A cut-out block in an opaque volume: its far side is the background's.
        let mut drawn = plain(1.0);
        assert_eq!(pick(&drawn, SIZE, 16, 16).unwrap().region, None);
        let mut block = region("block", &drawn, opaque(), |[_, y, _]| if y < 12 { 255 } else { 0 });
        block.look.opacity = 0.0;
        drawn.objects[0].regions.push(block);
        let picked = pick(&drawn, SIZE, 16, 16).unwrap();
        assert!(picked.region.is_none() && (11.0..12.5).contains(&picked.position_mm.y), "{picked:?}");
        assert!((picked.opacity - 1.0).abs() < 0.01, "{picked:?}");
    }

    #[test]
    fn at_a_border_regions_share_what_is_seen() {
        // A voxel thick and wide plates that share each voxel in 1/255: α' = 1 − (1 − Σ w α)^thickness, of which each has its part,
        // and the answer is the one that has most.
        for share in [51u8, 102, 153, 204] {
            let mut drawn = plain(0.0);
            let (faint, dense) = (vec![node(0.0, 0, 0.1)], vec![node(0.0, 0, 0.3)]);
            let inside = |y: usize| (8..25).contains(&y);
            let left = region("faint", &drawn, faint, |[_, y, _]| if inside(y) { share } else { 0 });
            let right = region("dense", &drawn, dense, |[_, y, _]| if inside(y) { 255 - share } else { 0 });
            drawn.objects[0].regions.extend([left, right]);
            let w = f64::from(share) / 255.0;
            let (a, b) = (0.1 * w, 0.3 * (1.0 - w));
            let picked = pick(&drawn, SIZE, 16, 16).unwrap();
            assert_eq!(picked.region, Some(usize::from(b > a)), "{share}: {picked:?}");
            // Both ends are half a voxel of transition on either side: 17 voxels in all.
            let shown = 1.0 - (1.0 - a - b).powi(17);
            assert!((picked.opacity - shown).abs() < 0.01, "{share}: {picked:?} is not {shown}");
        }
    }

    #[test]
    fn the_opacity_of_a_ray_through_regions_is_that_of_the_picture() {
        // Overlapping, with reference lengths of their own, faces of cut-outs and a style whose opacity depends on them.
        let texel = |i: usize| [1.0, 1.0, 1.0, 0.3 + 0.6 * (i % STYLE_SIZE) as f32 / STYLE_SIZE as f32];
        let pixels = (0..STYLE_SIZE * STYLE_SIZE).map(texel).collect();
        let uneven = Picture { width: STYLE_SIZE, height: STYLE_SIZE, pixels };
        let uneven = StyleImage::from_straight("uneven", &uneven).unwrap();
        let camera = looking_at(CENTER + DVec3::new(40.0, -50.0, 20.0), CENTER, PERSPECTIVE);
        let data = volume([33; 3], DAffine3::IDENTITY, |p| ball(p, CENTER, 10.0));
        let nodes = vec![node(100.0, 0, 0.0), node(400.0, 0, 0.1), node(900.0, 0, 0.05)];
        let mut drawn = scene(data, nodes.clone(), vec![uneven], camera);
        let mut dense = region("dense", &drawn, vec![node(300.0, 0, 0.4)], |[x, y, z]| {
            (20 * (x + y + z).saturating_sub(40)).min(255) as u8
        });
        dense.look.transfer_function.reference_length_mm = 2.5;
        let mut cut = region("cut", &drawn, nodes, |[x, _, z]| if x > 18 && z > 14 { 200 } else { 0 });
        cut.look.opacity = 0.1;
        drawn.objects[0].regions.extend([dense, cut]);
        let reference = Reference::new(&drawn).unwrap();
        let mut opaque: f64 = 0.0;
        for i in 0..33 {
            let (x, y) = (i, (7 * i) % 33);
            let line = Line::new(&drawn, &drawn.objects[0], 33, ray_from_pixel(&drawn.camera, SIZE, x, y));
            let seen = line.march();
            let ours: f64 = seen.iter().map(|s| s.opacity).sum();
            let parts: f64 = seen.iter().flat_map(|s| &s.shown).map(|s| s.opacity).sum();
            assert!((ours - parts).abs() < 1e-9, "{ours} is in parts {parts}");
            let theirs = reference.pixel_with_step(SIZE, x, y, 1.0 / 64.0, 0.0)[3];
            assert!((ours - theirs).abs() < 0.02, "{x} {y}: {ours} is not {theirs}");
            opaque = opaque.max(theirs);
        }
        assert!(opaque > 0.3, "{opaque}");
    }
}
