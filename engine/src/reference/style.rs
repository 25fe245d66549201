//! Style transfer functions (docs/rendering.md §4): from a data value and a gradient to the color and the directional
//! opacity of a sample.

use std::sync::Arc;

use glam::DVec3;

use crate::scene::{Camera, Projection, StyleTransferFunction};
use crate::spaces::Grid;
use crate::styles::{STYLE_SIZE, StyleImage};

/// Up to this ‖ĝ‖ there is no surface, and the style's center is shown.
pub const NO_SURFACE: f64 = 2e-4;
/// From this ‖ĝ‖ on there is a surface; in between, the normal moves out from the style's center.
pub const SURFACE: f64 = 2e-3;
/// ‖ĝ‖ from which on a style is not blurred for its normal's noise.
const SHARP: f64 = 0.02;
/// Mip levels of blur where the gradient vanishes.
const BLUR_LEVELS: f64 = 3.0;
/// Below this share of a ray's way along a surface, its turn is not divided by it any further.
const LEAST_WAY: f64 = 0.25;
/// Texels of a style from its center to its rim.
const RADIUS_TEXELS: f64 = 0.5 * STYLE_SIZE as f64 - 0.5;

/// What a transfer function says about one data value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Classification {
    /// α_u: opacity of one reference length, before the style's own.
    pub opacity: f64,
    /// Positions, in the scene's styles, of the two styles to mix.
    pub styles: [usize; 2],
    /// Share of the second style, in [0, 1).
    pub weight: f64,
    /// Node coordinate: i + w is w of the way from node i to node i + 1.
    pub node: f64,
}

/// The styles at a node coordinate, with an opacity.
pub fn at_node(function: &StyleTransferFunction, node: f64, opacity: f64) -> Classification {
    let last = function.nodes.len() - 1;
    let below = (node.max(0.0) as usize).min(last);
    let styles = [function.nodes[below].style, function.nodes[(below + 1).min(last)].style];
    Classification { opacity, styles, weight: node - below as f64, node }
}

/// Evaluates the transfer function at a data value.
///
/// # Panics
/// If the function has no node.
pub fn classify(function: &StyleTransferFunction, value: f64) -> Classification {
    let nodes = &function.nodes;
    // The last node at or below the value: of a jump's two nodes the upper.
    let Some(below) = nodes.iter().rposition(|node| node.value <= value) else {
        return Classification { opacity: nodes[0].opacity, styles: [nodes[0].style; 2], weight: 0.0, node: 0.0 };
    };
    let a = &nodes[below];
    match nodes.get(below + 1) {
        None => Classification { opacity: a.opacity, styles: [a.style; 2], weight: 0.0, node: below as f64 },
        Some(b) => {
            let weight = (value - a.value) / (b.value - a.value);
            let opacity = a.opacity + (b.opacity - a.opacity) * weight;
            Classification { opacity, styles: [a.style, b.style], weight, node: below as f64 + weight }
        }
    }
}

/// What normals are measured against along one ray: unit vectors, orthogonal to it and to each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayFrame {
    /// Towards the right of a style.
    pub right: DVec3,
    /// Towards the top of a style.
    pub up: DVec3,
}

/// The camera's right and up, turned by the smallest rotation that takes its view axis to the unit `direction`.
pub fn ray_frame(camera: &Camera, direction: DVec3) -> RayFrame {
    let f = camera.forward;
    let turned = |a: DVec3| a - a.dot(direction) / (1.0 + f.dot(direction)) * (f + direction);
    RayFrame { right: turned(camera.right), up: turned(camera.up) }
}

/// A face of the volume's box near a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Unit normal in the world, out of the volume.
    pub normal: DVec3,
    /// How much it counts: 1 on the face, 0 from one voxel inside on.
    pub weight: f64,
}

/// The faces near index position `p` in a volume of `grid`.
pub fn face_normal(grid: &Grid, p: DVec3) -> Face {
    let (low, high) = grid.index_box();
    let m = grid.world_gradient_from_index();
    let (mut normal, mut weight) = (DVec3::ZERO, 0.0f64);
    for axis in 0..3 {
        let (to_low, to_high) = (p[axis] - low[axis], high[axis] - p[axis]);
        let x = ((to_low.min(to_high) - 0.5) / 0.5).clamp(0.0, 1.0);
        let f = 1.0 - x * x * (3.0 - 2.0 * x);
        // A plane's normal goes by the inverse transpose; each face's is made a unit before those of an edge are mixed.
        normal += m.col(axis).normalize() * if to_low < to_high { -f } else { f };
        weight = weight.max(f);
    }
    Face { normal: normal.normalize_or_zero(), weight }
}

/// Outward normal of the surface at a sample, unit where there is one, 0 where there is none, and shorter than 1 where
/// there is hardly one. `gradient` = ĝ, in the world.
pub fn surface_normal(gradient: DVec3, face: Face) -> DVec3 {
    let outward = -gradient.normalize_or_zero();
    let outward = (outward + face.weight * (face.normal - outward)).normalize_or_zero();
    surface_strength(steepness(gradient, face)) * outward
}

/// How much of a surface a ‖ĝ‖ is: 0 for noise, 1 for a surface.
pub fn surface_strength(steepness: f64) -> f64 {
    let x = ((steepness - NO_SURFACE) / (SURFACE - NO_SURFACE)).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// |n·v| of a surface normal: 1 where there is no surface.
pub fn facing(gradient: DVec3, face: Face, direction: DVec3) -> f64 {
    let normal = surface_normal(gradient, face);
    1.0 - normal.length() + normal.dot(direction).abs()
}

/// n_xy: the right and up components, in the ray's frame, of the surface normal, turned towards the viewer.
pub fn style_normal(gradient: DVec3, face: Face, direction: DVec3, frame: &RayFrame) -> [f64; 2] {
    let outward = surface_normal(gradient, face);
    // v = −direction. The whole vector is turned: the style's picture is the same for either side of a surface.
    let facing = if outward.dot(-direction) >= 0.0 { outward } else { -outward };
    [facing.dot(frame.right), facing.dot(frame.up)]
}

/// ‖ĝ‖, or what a face of the volume makes of it: a face is a sharp surface.
pub fn steepness(gradient: DVec3, face: Face) -> f64 {
    gradient.length().max(face.weight * SHARP)
}

/// Texture coordinates (0…1, v downwards) of a normal in a style of `size` texels a side.
pub fn style_uv(n_xy: [f64; 2], size: usize) -> [f64; 2] {
    let length = n_xy[0].hypot(n_xy[1]).max(1.0);
    let radius = 0.5 - 0.5 / size as f64;
    [0.5 + n_xy[0] / length * radius, 0.5 - n_xy[1] / length * radius]
}

/// How much of the world a pixel covers at `depth_mm` along the view axis from the eye, mm. `image_height` in pixels.
pub fn pixel_mm(camera: &Camera, image_height: u32, depth_mm: f64) -> f64 {
    let height_mm = match camera.projection {
        Projection::Perspective { fov_y_deg } => 2.0 * (fov_y_deg.to_radians() / 2.0).tan() * depth_mm,
        Projection::Orthographic { height_mm } => height_mm,
    };
    height_mm / f64::from(image_height)
}

/// κ, in 1/mm: how fast a surface turns, from its outward normals ([`surface_normal`]) at two places of a ray of this unit `direction`,
/// `length_mm` > 0 apart. Which of its sides is bright does not matter, and where there is hardly a surface, there is hardly a turn.
pub fn bend(normals: [DVec3; 2], direction: DVec3, length_mm: f64) -> f64 {
    let [a, b] = normals.map(DVec3::normalize_or_zero);
    let b = if a.dot(b) < 0.0 { -b } else { b };
    let along = (a + b).normalize_or_zero().cross(direction).length().max(LEAST_WAY);
    normals[0].length() * normals[1].length() * a.distance(b) / (length_mm * along)
}

/// λ: the mip level of a style, not yet limited to the levels there are. `image_height` in pixels, `depth_mm` along the
/// view axis from the eye, `smallest_spacing_mm` of the volume, `normalized_gradient` = ‖ĝ‖, `bend` = κ of the surface in 1/mm.
pub fn style_level(
    camera: &Camera,
    image_height: u32,
    depth_mm: f64,
    smallest_spacing_mm: f64,
    normalized_gradient: f64,
    bend: f64,
) -> f64 {
    let pixel_mm = pixel_mm(camera, image_height, depth_mm);
    let covered = (pixel_mm / smallest_spacing_mm).max(pixel_mm * bend * RADIUS_TEXELS);
    let s = (normalized_gradient / SHARP).clamp(0.0, 1.0);
    let sharpness = s * s * (3.0 - 2.0 * s);
    covered.max(1.0).log2() + BLUR_LEVELS * (1.0 - sharpness)
}

/// Premultiplied linear RGBA of a style at texture coordinates: bilinear, linear between two mips, clamped to the edges
/// and to the levels there are.
pub fn sample_style(image: &StyleImage, uv: [f64; 2], level: f64) -> [f64; 4] {
    let last = image.mips.len() - 1;
    let level = level.clamp(0.0, last as f64);
    let fine = level.floor() as usize;
    let [a, b] = [fine, (fine + 1).min(last)].map(|l| sample_mip(&image.mips[l], image.size >> l, uv));
    mix(a, b, level - fine as f64)
}

fn sample_mip(texels: &[[f32; 4]], size: usize, uv: [f64; 2]) -> [f64; 4] {
    let axis = |t: f64| {
        let at = (t * size as f64 - 0.5).clamp(0.0, (size - 1) as f64);
        let first = at.floor() as usize;
        (first, (first + 1).min(size - 1), at - first as f64)
    };
    let ((x0, x1, wx), (y0, y1, wy)) = (axis(uv[0]), axis(uv[1]));
    let texel = |x: usize, y: usize| texels[y * size + x].map(f64::from);
    mix(mix(texel(x0, y0), texel(x1, y0), wx), mix(texel(x0, y1), texel(x1, y1), wx), wy)
}

fn mix(a: [f64; 4], b: [f64; 4], weight: f64) -> [f64; 4] {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * weight)
}

/// Straight linear RGB and the directional opacity α_d of a sample: the two styles of its class, looked up at the
/// normal `n_xy` and mip `level`, mixed premultiplied. Black where nothing shows.
pub fn shade(styles: &[Arc<StyleImage>], class: &Classification, n_xy: [f64; 2], level: f64) -> ([f64; 3], f64) {
    let [a, b] = class.styles.map(|i| sample_style(&styles[i], style_uv(n_xy, styles[i].size), level));
    let [red, green, blue, alpha] = mix(a, b, class.weight);
    if alpha <= 0.0 {
        return ([0.0; 3], 0.0);
    }
    ([red / alpha, green / alpha, blue / alpha], alpha)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::super::testing::{node, sphere_style};
    use super::*;

    fn camera() -> Camera {
        Camera::looking(
            DVec3::new(5.0, -40.0, 7.0),
            DVec3::new(0.2, 1.0, 0.3),
            DVec3::Z,
            Projection::Perspective { fov_y_deg: 90.0 },
        )
        .unwrap()
    }

    const NONE: Face = Face { normal: DVec3::X, weight: 0.0 };

    #[test]
    fn face_normal_is_the_cut_of_the_box() {
        let sheared = glam::DAffine3::from_mat3(glam::DMat3::from_cols(
            DVec3::new(1.0, 0.0, 0.0),
            DVec3::new(0.5, 1.0, 0.0),
            DVec3::new(0.0, 0.0, 2.0),
        ));
        let grid = Grid::new([10, 10, 10], sheared).unwrap();
        let on_top = face_normal(&grid, DVec3::new(4.0, 4.0, 9.5));
        assert_eq!((on_top.normal, on_top.weight), (DVec3::Z, 1.0));
        // The face across x is no longer across the world's x: its normal is orthogonal to the two other axes.
        let left = face_normal(&grid, DVec3::new(-0.25, 4.0, 4.0));
        assert!(left.normal.dot(DVec3::new(0.5, 1.0, 0.0)).abs() < 1e-12 && left.normal.x < 0.0 && left.weight == 1.0);
        assert_eq!(face_normal(&grid, DVec3::new(4.0, 0.5, 4.0)).weight, 0.0);
        // On the face the data's gradient does not matter, whichever way it points.
        let frame = RayFrame { right: DVec3::X, up: DVec3::Y };
        let seen = |g: DVec3| style_normal(g, on_top, DVec3::NEG_Z, &frame);
        assert_eq!((seen(DVec3::X), seen(DVec3::NEG_Y), seen(DVec3::ZERO)), ([0.0; 2], [0.0; 2], [0.0; 2]));
    }

    #[test]
    fn classify_between_outside_and_on_a_jump() {
        let function = StyleTransferFunction::new(
            vec![node(0.0, 3, 0.0), node(8.0, 1, 1.0), node(8.0, 2, 0.25), node(20.0, 0, 0.5)],
            1.0,
        );
        let class = |v| classify(&function, v);
        assert_eq!(class(-5.0), Classification { opacity: 0.0, styles: [3, 3], weight: 0.0, node: 0.0 });
        assert_eq!(class(2.0), Classification { opacity: 0.25, styles: [3, 1], weight: 0.25, node: 0.25 });
        assert_eq!(class(8.0), Classification { opacity: 0.25, styles: [2, 0], weight: 0.0, node: 2.0 });
        assert_eq!(class(14.0), Classification { opacity: 0.375, styles: [2, 0], weight: 0.5, node: 2.5 });
        assert_eq!(class(20.0), Classification { opacity: 0.5, styles: [0, 0], weight: 0.0, node: 3.0 });
        assert_eq!(class(1e300), Classification { opacity: 0.5, styles: [0, 0], weight: 0.0, node: 3.0 });
    }

    #[test]
    fn ray_frame_is_the_smallest_rotation() {
        let c = camera();
        for (x, y) in [(0.0, 0.0), (0.9, -0.3), (-1.0, 1.0), (30.0, 2.0)] {
            let d = (c.forward + x * c.right + y * c.up).normalize();
            let frame = ray_frame(&c, d);
            let turn = DQuat::from_rotation_arc(c.forward, d);
            assert!((frame.right - turn * c.right).length() < 1e-9);
            assert!((frame.up - turn * c.up).length() < 1e-9);
            // |n_xy| = 1 ⇔ n·v = 0.
            for i in 0..50 {
                let around = DQuat::from_axis_angle(d, f64::from(i)) * frame.right;
                let on_rim = style_normal(around, NONE, d, &frame);
                assert!((on_rim[0].hypot(on_rim[1]) - 1.0).abs() < 1e-9);
                let n = (around + 0.05 * f64::from(i) * d).normalize();
                let n_xy = style_normal(n, NONE, d, &frame);
                assert!((n_xy[0].powi(2) + n_xy[1].powi(2) + n.dot(d).powi(2) - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn style_normal_faces_the_viewer() {
        let frame = RayFrame { right: DVec3::X, up: DVec3::Z };
        let normal = |g: [f64; 3], g_max: f64| style_normal(DVec3::from(g) / g_max, NONE, DVec3::Y, &frame);
        // Values fall towards the viewer (at −y) and to the right: the outward normal already faces.
        let close = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-15 && (a[1] - b[1]).abs() < 1e-15;
        assert!(close(normal([-3.0, 4.0, 0.0], 1.0), [0.6, 0.0]));
        // The same surface from its other side: the whole vector turns.
        assert!(close(normal([3.0, -4.0, 0.0], 1.0), [0.6, 0.0]));
        assert!(close(normal([0.0, 4.0, -3.0], 1.0), [0.0, 0.6]));
        // On the rim the outward normal stays as it is.
        assert_eq!(normal([-2.0, 0.0, 0.0], 1.0), [1.0, 0.0]);
        assert_eq!(normal([2.0, 0.0, 0.0], 1.0), [-1.0, 0.0]);
        // No surface.
        assert_eq!(normal([0.0; 3], 1.0), [0.0, 0.0]);
        assert_eq!(normal([-2e-4, 0.0, 0.0], 1.0), [0.0, 0.0]);
        assert!((normal([-1.1e-3, 0.0, 0.0], 1.0)[0] - 0.5).abs() < 1e-12);
        assert_eq!(normal([-2e-3, 0.0, 0.0], 1.0), [1.0, 0.0]);
        assert_eq!(normal([-3.0, 0.0, 0.0], 1e6), [0.0, 0.0]);
    }

    #[test]
    fn style_uv_puts_the_rim_on_the_outermost_centers() {
        assert_eq!(style_uv([0.0, 0.0], 256), [0.5, 0.5]);
        assert_eq!(style_uv([1.0, 0.0], 256), [255.5 / 256.0, 0.5]);
        assert_eq!(style_uv([0.0, 1.0], 256), [0.5, 0.5 / 256.0]);
        assert_eq!(style_uv([0.0, -7.0], 256), [0.5, 255.5 / 256.0]);
    }

    #[test]
    fn style_level_counts_octaves() {
        let ortho = Camera { projection: Projection::Orthographic { height_mm: 400.0 }, ..camera() };
        assert!((style_level(&ortho, 100, 1e9, 1.0, 1.0, 0.0) - 2.0).abs() < 1e-12);
        assert_eq!(style_level(&ortho, 4000, 1e9, 1.0, 0.02, 0.0), 0.0);
        assert_eq!(style_level(&ortho, 4000, 1e9, 1.0, 0.0, 0.0), 3.0);
        assert_eq!(style_level(&ortho, 4000, 1e9, 1.0, 0.01, 0.0), 1.5);
        // Perspective of 90°: 200 mm high at a depth of 100 mm.
        assert!((style_level(&camera(), 100, 100.0, 0.25, 1.0, 0.0) - 3.0).abs() < 1e-12);
        assert_eq!(style_level(&camera(), 100, 0.0, 0.25, 1.0, 0.0), 0.0);
        // A ball of 10 mm in pixels of 0.1 mm: each is 1.275 texels of the disc. What covers more counts.
        let on_ball = style_level(&ortho, 4000, 1e9, 1.0, 1.0, 0.1);
        assert!((on_ball - 1.275f64.log2()).abs() < 1e-12, "{on_ball}");
        assert!((style_level(&ortho, 100, 1e9, 1.0, 1.0, 0.001) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn bend_of_a_sphere_is_one_over_its_radius() {
        let normal = |x: f64, y: f64| DVec3::new(x, y, 0.0).normalize();
        // Along rays that touch a sphere of 5 mm and go into it, 4 mm beside its center; halfway in the middle of the two places.
        for (x, y, radius) in [(0.0, 5.0, 5.0), (-3.0, 4.0, 5.0), (-4.8, 1.4, 5.0)] {
            let found = bend([normal(x - 5e-5, y), normal(x + 5e-5, y)], DVec3::X, 1e-4);
            assert!((found * radius - 1.0).abs() < 1e-6, "{x} {found}");
        }
        // Towards its middle the ray goes less far along it than is divided by.
        assert!(bend([normal(-5.0, 0.01), normal(-4.9, 0.01)], DVec3::X, 0.1) < 0.01);
        // Neither the bright side nor a flat surface nor noise turns.
        assert_eq!(bend([DVec3::Y, -DVec3::Y], DVec3::X, 0.1), 0.0);
        assert_eq!(bend([DVec3::Y, DVec3::Y], DVec3::X, 0.1), 0.0);
        assert_eq!(bend([DVec3::ZERO, DVec3::Y], DVec3::X, 0.1), 0.0);
        let weak = bend([0.1 * normal(-0.1, 5.0), normal(0.0, 5.0)], DVec3::X, 0.1);
        assert!((weak - 0.02).abs() < 1e-4, "{weak}");
    }

    #[test]
    fn sample_style_meets_texels_and_mips() {
        let image = sphere_style();
        let texel = |level: usize, x: usize, y: usize| image.mips[level][y * (image.size >> level) + x].map(f64::from);
        let uv = |x: f64, y: f64, size: f64| [(x + 0.5) / size, (y + 0.5) / size];
        assert_eq!(sample_style(&image, uv(100.0, 60.0, 256.0), 0.0), texel(0, 100, 60));
        assert_eq!(sample_style(&image, uv(20.0, 30.0, 64.0), 2.0), texel(2, 20, 30));
        // Halfway between texels, and between mips; both ends clamp.
        let between = sample_style(&image, uv(100.5, 60.0, 256.0), -1.0);
        assert!((between[0] - 0.5 * (texel(0, 100, 60)[0] + texel(0, 101, 60)[0])).abs() < 1e-12);
        let at = uv(20.0, 30.0, 64.0);
        let (two, three) = (sample_style(&image, at, 2.0), sample_style(&image, at, 3.0));
        assert!((sample_style(&image, at, 2.25)[1] - (0.75 * two[1] + 0.25 * three[1])).abs() < 1e-12);
        assert_eq!(sample_style(&image, at, 99.0), texel(8, 0, 0));
        assert_eq!(sample_style(&image, [0.0, 1.0], 0.0), texel(0, 0, 255));
    }

    #[test]
    fn shade_mixes_premultiplied() {
        let flat = |rgba| Arc::new(StyleImage::flat("flat", rgba));
        let styles = [flat([1.0, 0.0, 0.0, 1.0]), flat([0.0, 0.0, 0.25, 0.25]), flat([0.0; 4])];
        let class = Classification { opacity: 1.0, styles: [0, 1], weight: 0.5, node: 0.5 };
        let (color, alpha) = shade(&styles, &class, [0.3, 0.2], 0.0);
        assert_eq!((color, alpha), ([0.8, 0.0, 0.2], 0.625));
        let clear = Classification { opacity: 1.0, styles: [2, 2], weight: 0.0, node: 0.0 };
        assert_eq!(shade(&styles, &clear, [0.0, 0.0], 0.0), ([0.0; 3], 0.0));
    }
}
