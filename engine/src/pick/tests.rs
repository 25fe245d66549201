use std::sync::Arc;

use glam::DAffine3;

use super::*;
use crate::image_out::Picture;
use crate::progress::Progress;
use crate::reference::Reference;
use crate::reference::testing::{awkward_affines, looking_at, node, scene, sphere_style, volume};
use crate::scene::{
    Across, Axis, Look, Meeting, Meetings, Moved, Projection, Region, Row, StyleTransferFunction, TransferFunctionNode,
};
use crate::selection::{BrickPool, DistanceField, Selection};
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
fn rows_of_functions_are_met_where_they_show() {
    let camera = looking_at(CENTER - 100.0 * DVec3::Y, CENTER, ORTHO);
    let (solid, nothing) = (vec![node(0.0, 0, 1.0)], vec![node(0.0, 0, 0.0)]);
    let mut scene = scene(volume([33; 3], DAffine3::IDENTITY, |_| 500.0), solid.clone(), vec![white()], camera);
    let object = &mut scene.objects[0];
    let grid = object.volume.grid;
    let mut selection = Selection::empty(grid, &Arc::default());
    selection.change([[0, 33]; 3], |voxel, _| {
        let r = DVec3::from_array(voxel.map(|n| n as f64)).distance(CENTER);
        (255.0 * (4.5 - r).clamp(0.0, 1.0)) as u8
    });
    object.distances = vec![DistanceField::of(&[selection], &grid, &Progress::new()).unwrap()];
    // Up to 6 mm from a ball of 4, by what shows there.
    let row = |at: f64, nodes: &Vec<TransferFunctionNode>| Row { at, nodes: nodes.clone() };
    object.transfer_function.across = Some(Across { axis: Axis::Distance(0), at: 5.9, rows: vec![row(6.1, &nothing)] });
    let picked = pick(&scene, SIZE, 16, 16).unwrap();
    assert!((picked.position_mm - (CENTER - 10.0 * DVec3::Y)).length() < 0.5 && picked.row == 0, "{picked:?}");
    // By a number that is the same throughout: all of the volume, or nothing of it.
    let function = &mut scene.objects[0].transfer_function;
    function.nodes = nothing;
    function.across = Some(Across { axis: Axis::Even(1.0), at: 0.0, rows: vec![row(1.0, &solid)] });
    let picked = pick(&scene, SIZE, 16, 16).unwrap();
    assert!((picked.position_mm.y + 0.5).abs() < 0.5 && picked.row == 1, "{picked:?}");
    if let Some(across) = &mut scene.objects[0].transfer_function.across {
        across.axis = Axis::Even(0.0);
    }
    assert_eq!(pick(&scene, SIZE, 16, 16), None);
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
    let field = |p: DVec3| if p.x.sin() > 0.98 { f64::NAN } else { ball(p, center, 6.0) + 40.0 * (p.y * 0.8).sin() };
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
    let transfer_function = StyleTransferFunction::new(nodes, 1.0);
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

/// Moved by `pose`, with a ghost of an opacity.
fn moved(mut region: Region, pose: DAffine3, ghost: f64) -> Region {
    let ghost = Look { opacity: ghost, ..region.look.clone() };
    region.moved = Some(Moved { pose, ghost, meetings: Meetings::default() });
    region
}

/// A plate of rows 20 to 24 along y, from 19.5 to 24.5 mm.
fn plate(drawn: &Scene, nodes: Vec<TransferFunctionNode>) -> Region {
    region("plate", drawn, nodes, |[_, y, _]| if (20..25).contains(&y) { 255 } else { 0 })
}

#[test]
fn what_was_moved_is_met_where_it_is_drawn_and_its_ghost_where_it_was() {
    let drawn = plain(0.0);
    let about = |m: DAffine3| DAffine3::from_translation(CENTER) * m * DAffine3::from_translation(-CENTER);
    // Towards the eye and out of the volume; away; half as large, so that it begins 1.75 mm behind the middle; half around.
    for (pose, front) in [
        (DAffine3::from_translation(DVec3::new(0.0, -40.0, 0.0)), -20.5),
        (DAffine3::from_translation(DVec3::new(2.0, 60.0, -3.0)), 79.5),
        (about(DAffine3::from_scale(DVec3::splat(0.5))), 17.75),
        (about(DAffine3::from_rotation_z(std::f64::consts::PI)), 7.5),
    ] {
        for meets in [None, Some(Meeting { color: [1.0, 0.0, 0.0], opacity: None, strength: None })] {
            let mut scene = drawn.clone();
            let mut plate = moved(plate(&drawn, opaque()), pose, 0.0);
            plate.moved.as_mut().unwrap().meetings.background = meets.clone();
            scene.objects[0].regions.push(plate);
            let picked = pick(&scene, SIZE, 16, 16).unwrap();
            assert!((picked.region, picked.is_ghost) == (Some(0), false), "{picked:?}");
            assert!((picked.position_mm.y - front).abs() < 0.6 && picked.opacity > 0.99, "{front}: {picked:?}");
            // Where it is painted on: in the volume, on the face that the eye sees.
            assert!(picked.rest_mm.distance(pose.inverse().transform_point3(picked.position_mm)) < 1e-9, "{picked:?}");
            let at_rest = if front == 7.5 { 24.5 } else { 19.5 };
            assert!((picked.rest_mm.y - at_rest).abs() < 0.8, "{picked:?}");
            // Away from there, or looked through, the ghost shows where it was.
            let region = &mut scene.objects[0].regions[0];
            region.look.opacity = 0.0;
            region.moved.as_mut().unwrap().ghost.opacity = 0.5;
            let picked = pick(&scene, SIZE, 16, 16).unwrap();
            assert!((picked.region, picked.is_ghost) == (Some(0), true), "{picked:?}");
            assert!((19.0..=22.0).contains(&picked.position_mm.y), "{picked:?}");
            assert!(picked.rest_mm.distance(picked.position_mm) < 1e-9);
            assert!((picked.opacity - (1.0 - 0.5f64.powi(5))).abs() < 0.02, "{picked:?}");
        }
    }
}

#[test]
fn the_place_that_was_left_is_the_background_s_no_more() {
    // An opaque block of which the front is moved to the right: one looks on what was behind it.
    let mut drawn = plain(1.0);
    let front = region("front", &drawn, opaque(), |[_, y, _]| if y < 12 { 255 } else { 0 });
    let pose = DAffine3::from_translation(DVec3::new(8.0, -50.0, 0.0));
    drawn.objects[0].regions.push(moved(front, pose, 0.0));
    let left = pick(&drawn, SIZE, 3, 16).unwrap();
    assert!(left.region.is_none() && (11.0..12.5).contains(&left.position_mm.y), "{left:?}");
    let right = pick(&drawn, SIZE, 20, 16).unwrap();
    assert!(right.region == Some(0) && (right.position_mm.y + 50.5).abs() < 0.6, "{right:?}");
    assert!((right.rest_mm - right.position_mm - DVec3::new(-8.0, 50.0, 0.0)).length() < 1e-9);
}

#[test]
fn where_a_region_overlaps_its_ghost_the_stronger_one_counts() {
    // 5 mm of it and of its ghost, of which 3 mm are both.
    for (alpha, ghost) in [(0.1, 0.5), (0.3, 1.0), (0.2, 0.0)] {
        let mut drawn = plain(0.0);
        let pose = DAffine3::from_translation(DVec3::new(0.0, 2.0, 0.0));
        let plate = plate(&drawn, vec![node(0.0, 0, alpha)]);
        drawn.objects[0].regions.push(moved(plate, pose, ghost));
        let picked = pick(&drawn, SIZE, 16, 16).unwrap();
        let clear = (1.0f64 - alpha * ghost).powi(2) * (1.0f64 - alpha).powi(5);
        assert!((picked.opacity - (1.0 - clear)).abs() < 0.01, "{picked:?} is not {}", 1.0 - clear);
        assert!(!picked.is_ghost || ghost == 1.0, "{picked:?}");
    }
}

#[test]
fn the_opacity_of_a_ray_through_bodies_is_that_of_the_picture() {
    let camera = looking_at(CENTER + DVec3::new(40.0, -50.0, 20.0), CENTER, PERSPECTIVE);
    let data = volume([33; 3], DAffine3::IDENTITY, |p| ball(p, CENTER, 10.0));
    let nodes = vec![node(100.0, 0, 0.0), node(400.0, 0, 0.2), node(900.0, 0, 0.05)];
    let texel = |i: usize| [1.0, 1.0, 1.0, 0.3 + 0.6 * (i % STYLE_SIZE) as f32 / STYLE_SIZE as f32];
    let pixels = (0..STYLE_SIZE * STYLE_SIZE).map(texel).collect();
    let uneven = Picture { width: STYLE_SIZE, height: STYLE_SIZE, pixels };
    let uneven = StyleImage::from_straight("uneven", &uneven).unwrap();
    for style in [white(), uneven] {
        let mut drawn = scene(data.clone(), nodes.clone(), vec![style], camera);
        let half = region("half", &drawn, nodes.clone(), |[x, _, _]| if x > 16 { 255 } else { 0 });
        let top = region("top", &drawn, nodes.clone(), |[x, _, z]| if x <= 16 && z > 18 { 200 } else { 0 });
        let turn = DAffine3::from_translation(DVec3::new(6.0, 0.0, 3.0))
            * DAffine3::from_axis_angle(DVec3::new(1.0, 1.0, 0.0).normalize(), 0.3);
        let lift = DAffine3::from_translation(DVec3::new(0.0, 0.0, 5.0));
        drawn.objects[0].regions.extend([moved(half, turn, 0.3), moved(top, lift, 0.5)]);
        let reference = Reference::new(&drawn).unwrap();
        let mut opaque: f64 = 0.0;
        for i in 0..33 {
            let (x, y) = (i, (7 * i) % 33);
            let line = Line::new(&drawn, &drawn.objects[0], 33, ray_from_pixel(&drawn.camera, SIZE, x, y));
            let ours: f64 = line.march().iter().map(|s| s.opacity).sum();
            let theirs = reference.pixel_with_step(SIZE, x, y, 1.0 / 64.0, 0.0)[3];
            assert!((ours - theirs).abs() < 0.03, "{x} {y}: {ours} is not {theirs}");
            opaque = opaque.max(theirs);
        }
        assert!(opaque > 0.3, "{opaque}");
    }
}
