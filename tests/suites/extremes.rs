//! The extremes that must not break: what the rendering model demands of steps, opacities, data, grids, cameras and
//! sizes far from the usual, each held on the adapter *and* in the f64 reference. Where the published or obvious form
//! of an equation fails there, its test shows it failing beside the one that is used.

use std::fmt::Debug;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::measure::Difference;
use fabrica_engine::reference::Reference;
use fabrica_engine::render::{FloatImage, RenderOptions, RenderReport, Renderer};
use fabrica_engine::scene::{Background, Projection, Quality, Scene};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use fabrica_tests::compare::same_settings;
use fabrica_tests::phantom::{self, bump, centered, lumpy};
use fabrica_tests::twin::replace;
use fabrica_tests::{renderer, software};
use glam::{DAffine3, DMat3, DVec3, Vec3};

/// How one extreme is held.
enum Held {
    /// By this test of this file.
    Test(&'static str),
    /// Not yet: by the test that lands with this feature.
    Waits(&'static str),
}
use Held::{Test, Waits};

/// Every row of the rendering model's table of extremes: what is extreme, what is required, what holds it.
const ROWS: &[(&str, &str, &[Held])] = &[
    (
        "step 4 to 1/64 voxel; 1e5 samples on a ray",
        "error falls until the f32 floor, then stays flat; no drift",
        &[
            Test("steps_from_4_to_a_64th_voxel_fall_to_the_f32_floor_and_stay"),
            Test("a_ray_of_100_000_samples_does_not_drift"),
        ],
    ),
    (
        "opacity 1e-6 for 1e4 samples; opacity 1 everywhere",
        "1-(1-a)^n to 1e-4; first sample wins exactly",
        &[
            Test("an_opacity_of_1e_6_over_10_000_samples_adds_up"),
            Test("an_opacity_of_1_everywhere_lets_the_first_sample_win"),
        ],
    ),
    (
        "constant volume; NaN/Inf voxels; values 1e30, denormals",
        "renders, no NaN pixel, a warning that counts",
        &[
            Test("a_constant_volume_is_a_homogeneous_box"),
            Test("nan_and_infinite_voxels_are_gaps_and_are_counted"),
            Test("values_of_1e30_and_denormals_draw"),
        ],
    ),
    (
        "1-voxel-thick, 1x1x1; spacing 1e-4 and 1e4 mm, ratio 1:100; sheared/left-handed affine",
        "right place and shading, or a clear error naming the file (an affine that spans no space: the readers' tests)",
        &[
            Test("volumes_one_voxel_thick_and_a_single_voxel_draw"),
            Test("spacings_of_1e_4_and_1e4_mm_and_1_to_100_draw"),
            Test("sheared_and_left_handed_grids_at_extreme_spacings_draw"),
        ],
    ),
    (
        "camera inside; at 1e6 x the size; ray parallel to a face; looking along up; fov 1e-3 to 170 degrees; orthographic",
        "no hole, no NaN, no missing column",
        &[
            Test("a_camera_inside_sees_no_hole"),
            Test("a_camera_at_1e6_times_the_size_sees_the_same_picture"),
            Test("rays_parallel_to_a_face_miss_no_column"),
            Test("looking_along_up_has_a_picture"),
            Test("fields_of_view_from_1e_3_to_170_degrees_and_orthographic_draw"),
        ],
    ),
    (
        "T, kappa_t, kappa_s in {0, 1e-6, 1e6}; kappa_v = 0, infinite",
        "the limits exactly",
        &[Waits("contours (T, kappa_v)"), Waits("context-preserving ghosting (kappa_t, kappa_s)")],
    ),
    (
        "sliver of 1e-6 of the box; 64 parts; contradictory joints; degree 0 and 1e3",
        "finite, settles or says that it cannot, rest at 0",
        &[Waits("parts (sliver, 64 parts)"), Waits("exploded views (joints, degree)")],
    ),
    (
        "0, 1, 200 labels; anchors at one point or behind the camera",
        "no panic; dropped labels listed",
        &[Waits("labels")],
    ),
    (
        "image 0x0, 16384x16384; volume over the 3-D texture limit or GPU memory",
        "clear error or tiled/bricked; never a crash or silent downsampling",
        &[
            Test("a_picture_without_pixels_is_a_sentence"),
            Test("a_picture_16384_wide_is_tiled_in_bounded_memory"),
            Test("a_volume_over_the_3d_texture_limit_is_a_sentence"),
            Test("a_volume_over_the_gpu_memory_is_a_sentence"),
        ],
    ),
];

#[test]
fn every_row_of_the_table_has_its_test_or_the_feature_it_waits_for() {
    let mut lines = include_str!("extremes.rs").lines().peekable();
    let mut tests = Vec::new();
    while let Some(line) = lines.next() {
        if line == "#[test]"
            && let Some(name) = lines.peek().and_then(|l| l.strip_prefix("fn ")).and_then(|l| l.split_once('('))
        {
            tests.push(name.0);
        }
    }
    let mut named = vec!["every_row_of_the_table_has_its_test_or_the_feature_it_waits_for"];
    for (extreme, required, held) in ROWS {
        assert!(!held.is_empty() && !required.is_empty(), "nothing holds \"{extreme}\"");
        for one in *held {
            match one {
                Test(name) => named.push(name),
                Waits(feature) => println!("\"{extreme}\" waits for {feature}"),
            }
        }
    }
    for name in &named {
        assert!(tests.contains(name), "the table names {name}, which is no test of this file");
    }
    for test in &tests {
        assert!(named.contains(test), "{test} stands in no row of the table");
    }
}

/// A veil with a little of everything: two styles, translucent, no jump.
const VEIL: &[(f64, &str, f64)] = &[(150.0, "clay", 0.0), (400.0, "wax", 0.08), (800.0, "cool_warm", 0.3)];
const OPAQUE: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];

/// No early end: what a ray adds up to is compared, not where it stops.
const fn endless(step_voxels: f64) -> Quality {
    Quality { step_voxels, termination: 0.0, ..Quality::FINAL }
}

fn draw(renderer: &mut Renderer, scene: &Scene, size: [u32; 2]) -> FloatImage {
    let image = renderer.render(scene, size, &RenderOptions::default(), &Progress::new()).unwrap();
    assert!(image.pixels.iter().flatten().all(|v| v.is_finite()), "a pixel is not finite");
    image
}

fn report(renderer: &mut Renderer, scene: &Scene) -> RenderReport {
    renderer.render_bands(scene, [1, 1], &RenderOptions::default(), &Progress::new(), |_| Ok(())).unwrap()
}

/// The truth at the scene's step: every piece by its middle.
fn reference(scene: &Scene, size: [u32; 2]) -> Vec<[f64; 4]> {
    Reference::new(scene).unwrap().image(size, &Progress::new()).unwrap()
}

/// What the raycaster is to draw at the scene's step: every piece by its ends.
fn twin(scene: &Scene, size: [u32; 2]) -> Vec<[f64; 4]> {
    Reference::new(scene).unwrap().twin(size, &Progress::new()).unwrap()
}

/// How far apart two pictures without background are; a pixel that is not finite is a failure.
fn difference(picture: &FloatImage, reference: &[[f64; 4]]) -> Difference {
    Difference::of(picture, reference, Background::Transparent, None).unwrap()
}

/// The picture on the adapter, once it is what the reference says at the same settings, within the tolerances of
/// `compare.rs`. How much of the picture shows anything is the caller's to ask.
fn held_to_reference(
    renderer: &mut Renderer,
    scene: &Scene,
    size: [u32; 2],
    what: &dyn Debug,
) -> (FloatImage, Difference) {
    let picture = draw(renderer, scene, size);
    let found = difference(&picture, &twin(scene, size));
    println!("{what:?}: {:.4?}, {:.3} covered", found.codes, found.covered);
    let (p999, rmse) = same_settings(scene.quality.step_voxels);
    assert!(
        found.codes.p999 <= p999 && found.codes.rmse <= rmse,
        "{what:?}: the adapter and the reference differ: {found:?}"
    );
    (picture, found)
}

// ---- step 4 to 1/64 voxel; 1e5 samples on a ray

/// What the adapter's arithmetic leaves at small steps, root mean square in 8-bit codes: f32 sums of thousands of terms,
/// half-float styles, and most of all the interpolation in a table of 256² entries. Measured: 0.0205 from a step of 1/8
/// voxel on (0.001 with classification by a table of 4096 entries).
const F32_FLOOR_CODES: f64 = 0.04;

#[test]
fn steps_from_4_to_a_64th_voxel_fall_to_the_f32_floor_and_stay() {
    const SMOOTH: &[(f64, &str, f64)] =
        &[(100.0, "unshaded_blue", 0.0), (500.0, "unshaded", 0.1), (900.0, "unshaded_red", 0.3)];
    let mut renderer = renderer();
    let size = [16, 12];
    let as_f32 = |pixels: &[[f64; 4]]| FloatImage {
        width: size[0],
        height: size[1],
        pixels: pixels.iter().map(|p| p.map(|v| v as f32)).collect(),
    };
    for nodes in [SMOOTH, VEIL] {
        let mut scene = phantom::scene(&lumpy(), nodes, endless(1.0));
        scene.camera.projection = Projection::Perspective { fov_y_deg: 10.0 };
        let converged = Reference::new(&scene).unwrap();
        let converged = converged.image_with(size, 1.0 / 160.0, 0.0, &Progress::new()).unwrap();
        let (mut ours, mut exact) = (Vec::new(), Vec::new());
        for octave in -2..=6 {
            scene.quality = endless(0.5f64.powi(octave));
            // Short pieces are what their middles are: the twin's quadrature is not needed for them.
            let picture = if octave <= 1 {
                held_to_reference(&mut renderer, &scene, size, &scene.quality.step_voxels).0
            } else {
                draw(&mut renderer, &scene, size)
            };
            ours.push(difference(&picture, &converged).codes.rmse);
            exact.push(difference(&as_f32(&reference(&scene, size)), &converged).codes.rmse);
        }
        println!("adapter {ours:.5?}, reference {exact:.5?}");
        // Every halving of the step pays, in f64 to the end, in f32 until only rounding is left.
        assert!(exact[0] > 20.0 * F32_FLOOR_CODES, "there is no error to fall: {exact:?}");
        assert!(exact.windows(2).all(|w| w[1] < 0.75 * w[0]), "{exact:?}");
        assert!(ours.windows(2).all(|w| w[1] < w[0].max(F32_FLOOR_CODES)), "{ours:?}");
        if nodes == SMOOTH {
            // From there on nothing moves: a floor that rose with the number of samples would be an error that adds up.
            assert!(ours[5..].iter().all(|e| *e < F32_FLOOR_CODES), "{ours:?}");
            assert!(ours[8] < 1.5 * ours[6], "{ours:?}");
        }
    }
}

#[test]
fn a_ray_of_100_000_samples_does_not_drift() {
    // 1600 voxels, askew, through waves that would show a shift.
    let dims = [4, 4, 1600];
    let volume = phantom::volume(dims, centered(dims, DVec3::ONE), |p| 500.0 + 400.0 * (0.9 * p.z).sin());
    let nodes = [(100.0, "unshaded_blue", 0.0), (900.0, "unshaded_red", 0.002)];
    let mut scene = phantom::scene(&volume, &nodes, endless(1.0 / 12.0));
    let askew = DVec3::new(1.1e-3, -0.7e-3, 1.0);
    scene.camera = phantom::camera(&volume, askew, Projection::Orthographic { height_mm: 0.5 });
    let size = [2, 2];
    let mut renderer = renderer();
    let image = draw(&mut renderer, &scene, size);
    let exact = Reference::new(&scene).unwrap();
    assert!(exact.march(size, 0, 0, 1.0 / 64.0, 0.0).num_samples > 100_000);
    assert!(exact.march(size, 0, 0, 1.0 / 12.0, 0.0).num_samples > 19_000);
    let at = |step| exact.image_with(size, step, 0.0, &Progress::new()).unwrap();
    let (fine, finer, same) = (at(1.0 / 32.0), at(1.0 / 64.0), at(1.0 / 12.0));
    for (((found, same), fine), finer) in image.pixels.iter().zip(&same).zip(&fine).zip(&finer) {
        let apart = |a: &[f64; 4], b: &[f64; 4], c: usize| (a[c] - b[c]).abs();
        let drawn = found.map(f64::from);
        for c in 0..4 {
            // In f64 nothing moves from 5e4 to 1e5 samples that f32 could show.
            assert!(apart(fine, finer, c) < 1e-5, "{fine:?} {finer:?}");
            // 2e4 f32 sums, each off by up to half a unit in the last place of 0.5 to 1 and of either sign: some 1e-5;
            // half-float styles: 2.4e-4 of a color.
            let tolerance = if c == 3 { 1e-4 } else { 3e-4 };
            for truth in [same, finer] {
                assert!(apart(&drawn, truth, c) < tolerance, "{drawn:?} is not {truth:?}");
            }
        }
        assert!(drawn[3] > 0.5 && drawn[3] < 0.99);
    }
    // llvmpipe ends all loops of a pixel after 65 535 rounds together, without a word: longer rays are walked in passes.
    scene.quality = endless(1.0 / 64.0);
    let image = draw(&mut renderer, &scene, size);
    for (found, finer) in image.pixels.iter().zip(&finer) {
        // 1e5 f32 sums.
        assert!((0..4).all(|c| (f64::from(found[c]) - finer[c]).abs() < 5e-4), "{found:?} is not {finer:?}");
    }
    // More than a ray can hold is refused, never drawn wrong.
    scene.quality = endless(1.0 / 1024.0);
    let refused = renderer.render(&scene, size, &RenderOptions::default(), &Progress::new()).unwrap_err().to_string();
    assert!(refused.contains("samples on a ray") && refused.contains("choose a step of"), "{refused}");

    // The naive form adds the step up; in f32 that ends voxels away from where the index puts the same sample.
    let step = 1.0f32 / 63.0;
    let (mut added, mut worst_added, mut worst_indexed) = (0.5 * step, 0.0f64, 0.0f64);
    for k in 0..100_000u32 {
        let true_place = (f64::from(k) + 0.5) / 63.0;
        worst_added = worst_added.max((f64::from(added) - true_place).abs());
        worst_indexed = worst_indexed.max((f64::from((k as f32 + 0.5) * step) - true_place).abs());
        added += step;
    }
    assert!(worst_added > 0.2, "adding up does not drift here any more: {worst_added}");
    assert!(worst_indexed < 2e-4, "{worst_indexed}");
}

// ---- opacity 1e-6 for 1e4 samples; opacity 1 everywhere

/// A bar along z, homogeneous, `length` voxels of 1 mm, of opacity `alpha` per `reference_length_mm`, seen along it.
fn bar(length: usize, alpha: f64, reference_length_mm: f64, quality: Quality) -> Scene {
    let dims = [8, 8, length];
    let volume = phantom::volume(dims, centered(dims, DVec3::ONE), |_| 500.0);
    let mut scene = phantom::scene(&volume, &[(400.0, "unshaded", alpha)], quality);
    scene.objects[0].transfer_function.reference_length_mm = reference_length_mm;
    scene.camera = phantom::camera(&volume, DVec3::Z, Projection::Orthographic { height_mm: 4.0 });
    scene
}

#[test]
fn an_opacity_of_1e_6_over_10_000_samples_adds_up() {
    let alpha = 1e-6;
    let mut stable = renderer();
    let mut naive = Renderer::with_patched_shaders(software(), |text| {
        let head = "fn opacity_correct(alpha: f32, exponent: f32) -> f32 {";
        replace(&text, head, &format!("{head}\n    if alpha < 2.0 {{ return 1.0 - pow(1.0 - alpha, exponent); }}"))
    });
    // 1e4 samples of 1e-6 each: the published form is a percent off on the best of
    // adapters. 1e4 samples of a 64th of that: it stalls at 0.
    let cases = [(bar(2500, alpha, 0.25, endless(1.0)), 1e4), (bar(160, alpha, 1.0, endless(1.0 / 16.0)), 160.0)];
    for (scene, num_lengths) in cases {
        let expected = 1.0 - (1.0f64 - alpha).powf(num_lengths);
        let exact = Reference::new(&scene).unwrap();
        // Where something shows, four samples a step.
        let march = exact.march([4, 4], 1, 1, scene.quality.step_voxels / 4.0, 0.0);
        assert!(march.num_visible >= 10_000, "{march:?}");
        assert!((march.rgba[3] / expected - 1.0).abs() < 1e-9, "{march:?} is not {expected}");
        let image = draw(&mut stable, &scene, [4, 4]);
        for pixel in &image.pixels {
            let found = f64::from(pixel[3]);
            assert!((found / expected - 1.0).abs() < 1e-4, "{found} is not {expected}");
        }
        let found = f64::from(draw(&mut naive, &scene, [4, 4]).pixels[5][3]);
        let error = (found / expected - 1.0).abs();
        assert!(error > 0.01, "the naive form is only off by {error}: is it worth its place?");
    }
    assert_eq!(1.0 - (1.0f32 - 1e-6).powf(1.0 / 64.0), 0.0);
}

#[test]
fn an_opacity_of_1_everywhere_lets_the_first_sample_win() {
    let mut renderer = renderer();
    let nodes = [(-900.0, "clay", 1.0), (0.0, "wax", 1.0), (900.0, "cool_warm", 1.0)];
    for step in [4.0, 1.0, 1.0 / 64.0] {
        for termination in [0.0, Quality::FINAL.termination] {
            let mut scene =
                phantom::scene(&lumpy(), &nodes, Quality { step_voxels: step, termination, ..Quality::FINAL });
            scene.camera.projection = Projection::Perspective { fov_y_deg: 8.0 };
            let (picture, _) = held_to_reference(&mut renderer, &scene, [48, 40], &(step, termination));
            assert!(picture.pixels.iter().all(|p| p[3] == 1.0), "opaque is not opaque");
        }
        let scene = phantom::scene(&lumpy(), &nodes, Quality { step_voxels: step, ..Quality::FINAL });
        let march = Reference::new(&scene).unwrap().march([24, 20], 12, 10, step, Quality::FINAL.termination);
        assert_eq!((march.num_visible, march.rgba[3]), (1, 1.0));
    }
}

// ---- constant volume; NaN/Inf voxels; values 1e30, denormals

fn floats(dims: [usize; 3], value: impl Fn(DVec3) -> f32) -> Arc<Volume> {
    let grid = Grid::new(dims, centered(dims, DVec3::ONE)).unwrap();
    let [nx, ny, _] = dims;
    let values = (0..grid.num_voxels())
        .map(|i| value(DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64)))
        .collect();
    Arc::new(Volume::new(grid, Voxels::F32(values), Rescale::IDENTITY, "test").unwrap())
}

#[test]
fn a_constant_volume_is_a_homogeneous_box() {
    let mut renderer = renderer();
    for constant in [0.0, 500.0, -1e30, 1e30, f32::MIN_POSITIVE / 8.0] {
        let volume = floats([12, 12, 12], |_| constant);
        // Below the value, exactly on it, and a jump on it, whose upper side the value belongs to.
        let value = f64::from(constant);
        for (name, nodes) in [
            ("below", vec![(value - 2.0 * value.abs() - 1.0, "clay", 0.1)]),
            ("on", vec![(value, "clay", 0.1)]),
            ("jump", vec![(value, "vessel", 0.9), (value, "clay", 0.1)]),
        ] {
            if name == "jump" && constant.is_subnormal() {
                // f64 interpolation of this constant rounds off it, to the jump's other side: nothing to hold on to.
                continue;
            }
            let mut scene = phantom::scene(&volume, &nodes, endless(0.5));
            held_to_reference(&mut renderer, &scene, [24, 24], &(constant, name));
            scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 12.0 });
            let image = draw(&mut renderer, &scene, [8, 8]);
            let expected = 1.0 - 0.9f64.powi(12);
            let worst = image.pixels.iter().map(|p| (f64::from(p[3]) - expected).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-6, "{constant} {name}: {worst}");
            // One color, where no other face of the box is near: without a gradient there is no normal to take one from.
            let inner = |i: usize| (1..7).contains(&(i % 8)) && (1..7).contains(&(i / 8));
            let colors: Vec<_> = image.pixels.iter().enumerate().filter(|(i, _)| inner(*i)).map(|(_, p)| p).collect();
            assert!(colors.len() == 36 && colors.iter().all(|p| *p == colors[0]), "{constant} {name}");
        }
    }
    // The naive normal of no gradient is not one.
    let none = Vec3::ZERO;
    assert!((none / none.length()).is_nan() && !(none / none.length().max(1e-30)).is_nan());
}

#[test]
fn nan_and_infinite_voxels_are_gaps_and_are_counted() {
    // A column of NaN straight through along y, and outliers that must not shift anything else.
    let outlier = |i: usize| match i {
        0 => Some(f32::INFINITY),
        1 => Some(f32::NEG_INFINITY),
        5 => Some(-1e30),
        7 => Some(1e30),
        9 => Some(f32::MIN_POSITIVE / 8.0),
        _ => None,
    };
    let volume = floats([24; 3], |p| {
        let inside = |v: f64| (10.0..14.0).contains(&v);
        if inside(p.x) && inside(p.z) {
            f32::NAN
        } else {
            outlier((p.x + 24.0 * (p.y + 24.0 * p.z)) as usize).unwrap_or(500.0)
        }
    });
    let mut scene = phantom::scene(&volume, &[(400.0, "plaster", 0.5), (600.0, "plaster", 0.5)], Quality::STANDARD);
    scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 24.0 });
    let mut renderer = renderer();
    let (picture, _) = held_to_reference(&mut renderer, &scene, [48, 48], &"gaps, seen along them");
    assert_eq!(picture.pixels[24 * 48 + 24][3], 0.0, "the gap shows");
    assert!(picture.pixels[24 * 48 + 8][3] > 0.99, "what has data does not");
    let report = report(&mut renderer, &scene);
    assert!(report.warnings[0].contains("386 of 13824"), "{:?}", report.warnings);
    assert!(report.pipeline.contains("no_data"));

    // With shading, askew.
    let volume = floats([24; 3], |p| {
        if (p.x + p.y) % 7.0 == 3.0 { f32::NAN } else { (900.0 - 60.0 * p.distance(DVec3::splat(11.0))) as f32 }
    });
    held_to_reference(&mut renderer, &phantom::scene(&volume, VEIL, Quality::STANDARD), [48, 40], &"gaps, askew");

    // Nothing but gaps: nothing shows, and it is said.
    let none = floats([6; 3], |p| if p.x > 2.0 { f32::NAN } else { f32::INFINITY });
    let scene = phantom::scene(&none, &[(-1.0, "plaster", 1.0)], Quality::STANDARD);
    let (picture, _) = held_to_reference(&mut renderer, &scene, [16, 16], &"nothing but gaps");
    assert!(picture.pixels.iter().all(|p| p == &[0.0; 4]));
    let warnings = self::report(&mut renderer, &scene).warnings;
    assert!(warnings[0].contains("216 of 216"), "{warnings:?}");
}

#[test]
fn values_of_1e30_and_denormals_draw() {
    let mut renderer = renderer();
    // The same body at every magnitude is the same picture.
    let body = |p: DVec3| 900.0 - 55.0 * p.distance(DVec3::new(11.0, 12.5, 10.0));
    for (name, factor) in [("1", 1.0), ("1e27", 1e27), ("-1e27", -1e27), ("1e-42", 1e-42)] {
        let volume = floats([24; 3], |p| (factor * body(p)) as f32);
        let mut nodes: Vec<_> = VEIL.iter().map(|&(v, style, alpha)| (factor * v, style, alpha)).collect();
        if factor < 0.0 {
            nodes.reverse();
        }
        let scene = phantom::scene(&volume, &nodes, Quality::STANDARD);
        let (_, found) = held_to_reference(&mut renderer, &scene, [48, 40], &name);
        assert!(found.covered > 0.2, "{name} shows {}", found.covered);
        assert_eq!(report(&mut renderer, &scene).warnings, [""; 0], "these are numbers");
    }
    // Outliers of ±1e30 in the corners of a body of hundreds leave it as it is.
    let with_outliers = floats([24; 3], |p| match (p.x + p.y + p.z) as usize {
        0 => 1e30,
        69 => -1e30,
        _ => body(p) as f32,
    });
    let mut scene =
        phantom::scene(&with_outliers, &[(150.0, "unshaded", 0.0), (400.0, "unshaded", 0.3)], Quality::FINAL);
    scene.camera.projection = Projection::Perspective { fov_y_deg: 10.0 };
    let (picture, _) = held_to_reference(&mut renderer, &scene, [48, 40], &"outliers");
    scene.objects[0].volume = floats([24; 3], |p| body(p) as f32);
    let without = draw(&mut renderer, &scene, [48, 40]);
    let apart = picture.pixels.iter().zip(&without.pixels).filter(|(a, b)| (a[3] - b[3]).abs() > 1e-3).count();
    assert!(apart < 48 * 40 / 20, "{apart} pixels see the outliers");
    // The naive length of such a gradient is infinite and the normal gone; as a share of G it is a number.
    let naive = Vec3::new(1e30, 2e30, 0.0);
    assert_eq!(naive / naive.length(), Vec3::ZERO);
    assert!((naive / 2e30).normalize().is_normalized());
}

// ---- 1-voxel-thick, 1x1x1; spacing 1e-4 and 1e4 mm, ratio 1:100; sheared/left-handed affine

/// A constant volume is its box: close to its center every ray meets it, whatever its shape. And from afar it is the box
/// that the equations say, translucent; unshaded, because on its edges two faces' normals meet and f32 cannot say which.
fn assert_is_its_box(renderer: &mut Renderer, dims: [usize; 3], spacing: DVec3) {
    let volume = phantom::volume(dims, centered(dims, spacing), |_| 500.0);
    let mut scene = phantom::scene(&volume, &[(400.0, "clay", 1.0)], Quality::STANDARD);
    let thinnest = (0..3).map(|i| dims[i] as f64 * spacing[i]).fold(f64::INFINITY, f64::min);
    scene.objects[0].transfer_function.reference_length_mm = thinnest;
    let close = Projection::Orthographic { height_mm: 0.3 * thinnest };
    scene.camera = phantom::camera(&volume, DVec3::new(0.5, 1.0, 0.4), close);
    let (image, _) = held_to_reference(renderer, &scene, [24, 20], &(dims, spacing));
    assert!(image.pixels.iter().all(|p| p[3] == 1.0), "{dims:?} {spacing}");

    let mut scene = phantom::scene(&volume, &[(400.0, "unshaded_ochre", 0.2)], endless(1.0));
    scene.objects[0].transfer_function.reference_length_mm = thinnest;
    for from in [DVec3::new(0.5, 1.0, 0.4), DVec3::NEG_X] {
        scene.camera = phantom::camera(&volume, from, Projection::Perspective { fov_y_deg: 30.0 });
        held_to_reference(renderer, &scene, [48, 40], &(dims, spacing, from));
    }
}

#[test]
fn volumes_one_voxel_thick_and_a_single_voxel_draw() {
    let mut renderer = renderer();
    for dims in [[1, 1, 1], [64, 1, 64], [1, 1, 300], [1, 40, 40]] {
        assert_is_its_box(&mut renderer, dims, DVec3::ONE);
    }
    // A slice with something in it, seen at a slant.
    let dims = [40, 1, 36];
    let slice = phantom::volume(dims, centered(dims, DVec3::ONE), |p| bump(p, DVec3::new(3.0, 0.0, -2.0), 19.0));
    let scene = phantom::scene(&slice, VEIL, Quality::STANDARD);
    let (_, found) = held_to_reference(&mut renderer, &scene, [48, 40], &"a slice");
    assert!(found.covered > 0.1, "{found:?}");
    // Its opacity is that of its thickness at any step. Whole pieces only, as published, have none of it from a step of
    // more than one voxel on.
    let sheet = phantom::volume(dims, centered(dims, DVec3::ONE), |_| 500.0);
    for step in [4.0, 2.0, 1.5, 1.0, 0.7, 1.0 / 64.0] {
        let mut scene = phantom::scene(&sheet, &[(400.0, "unshaded", 0.25)], endless(step));
        scene.camera = phantom::camera(&sheet, DVec3::Y, Projection::Orthographic { height_mm: 8.0 });
        for pixel in draw(&mut renderer, &scene, [4, 4]).pixels {
            assert!((pixel[3] - 0.25).abs() < 1e-6, "{} at a step of {step}", pixel[3]);
        }
        assert!((Reference::new(&scene).unwrap().pixel([4, 4], 1, 2)[3] - 0.25).abs() < 1e-12);
        assert_eq!((1.0 / step).floor() == 0.0, step > 1.0);
    }
}

#[test]
fn spacings_of_1e_4_and_1e4_mm_and_1_to_100_draw() {
    let mut renderer = renderer();
    for (dims, spacing) in [
        ([16, 16, 16], DVec3::splat(1e-4)),
        ([16, 16, 16], DVec3::splat(1e4)),
        ([64, 64, 4], DVec3::new(1.0, 1.0, 100.0)),
        ([4, 64, 64], DVec3::new(100.0, 1.0, 1.0)),
        ([40, 40, 4], DVec3::new(1e-4, 1e-4, 1e-2)),
    ] {
        assert_is_its_box(&mut renderer, dims, spacing);
    }
    // With something in it: lengths that go with the spacing make one picture at every scale.
    let mut first: Option<FloatImage> = None;
    for scale in [1.0, 1e-4, 1e4] {
        let dims = [24, 26, 28];
        let volume = phantom::volume(dims, centered(dims, DVec3::splat(scale)), |p| {
            let p = p / scale;
            bump(p, DVec3::new(-3.0, 1.0, 0.0), 11.0).max(bump(p, DVec3::new(5.0, -4.0, 5.0), 7.0))
        });
        let mut scene = phantom::scene(&volume, VEIL, Quality::STANDARD);
        scene.objects[0].transfer_function.reference_length_mm = scale;
        let (picture, found) = held_to_reference(&mut renderer, &scene, [48, 40], &scale);
        assert!(found.covered > 0.1, "{found:?}");
        if let Some(first) = &first {
            let pairs = first.pixels.iter().flatten().zip(picture.pixels.iter().flatten());
            let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // The same numbers times a factor that f32 rounds: a pixel on a silhouette may move by a rounding.
            assert!(worst < 5e-3, "at {scale} mm: {worst}");
        } else {
            first = Some(picture);
        }
    }
    // 1:100, with something in it. One length of step for all directions, the smallest spacing, would need 100 samples a
    // voxel here, the largest would leap over 100 voxels there; in voxels along the ray it is one sample for each.
    let dims = [40, 40, 6];
    let spacing = DVec3::new(1.0, 1.0, 100.0);
    let volume =
        phantom::volume(dims, centered(dims, spacing), |p| bump(p / DVec3::new(1.0, 1.0, 12.0), DVec3::ZERO, 20.0));
    let mut scene = phantom::scene(&volume, VEIL, Quality::STANDARD);
    for (from, num_voxels) in [(DVec3::X, 40), (DVec3::Z, 6)] {
        scene.camera = phantom::camera(&volume, from, Projection::Orthographic { height_mm: 40.0 });
        let (_, found) = held_to_reference(&mut renderer, &scene, [40, 40], &from);
        assert!(found.covered > 0.1, "{found:?}");
        let march = Reference::new(&scene).unwrap().march([40, 40], 20, 20, 1.0, 0.0);
        assert!(march.num_samples.abs_diff(num_voxels) <= 1, "{march:?} along {from}");
    }
}

#[test]
fn sheared_and_left_handed_grids_at_extreme_spacings_draw() {
    let mut renderer = renderer();
    let sheared = DMat3::from_cols(DVec3::new(0.9, 0.1, 0.0), DVec3::new(0.6, 0.8, 0.5), DVec3::new(-0.5, 0.3, 2.0));
    let mirrored = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let grids = [
        ("left-handed", mirrored),
        ("sheared", sheared),
        ("sheared, left-handed", mirrored * sheared),
        // The z axis leans over by five times its own height.
        ("flat", DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.5, 0.2, 0.1))),
    ];
    for (name, m) in grids {
        for scale in [1.0, 1e-4, 1e4] {
            let dims = [26, 24, 22];
            let half = DVec3::from_array(dims.map(|n| (n - 1) as f64)) * 0.5;
            let m = scale * m;
            // Left of the center a ball, in front of it a smaller one: a wrong hand is a wrong picture.
            let to_index = m.inverse();
            let volume = phantom::volume(dims, DAffine3::from_mat3_translation(m, -(m * half)), |p| {
                let p = to_index * p;
                bump(p, DVec3::new(-3.0, 1.0, 0.0), 9.0).max(bump(p, DVec3::new(5.0, 5.0, 3.0), 5.0))
            });
            let mut scene = phantom::scene(&volume, VEIL, Quality::STANDARD);
            scene.objects[0].transfer_function.reference_length_mm = scale;
            scene.camera.projection = Projection::Perspective { fov_y_deg: 12.0 };
            let (_, found) = held_to_reference(&mut renderer, &scene, [48, 40], &(name, scale));
            assert!(found.covered > 0.05, "{name} {scale}: {found:?}");
        }
    }
    let flat = DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.5, 0.2, 0.0)));
    assert!(Grid::new([2, 2, 2], flat).unwrap_err().contains("do not span space"));
}

// ---- camera inside; at 1e6 x the size; ray parallel to a face; looking along up; fov 1e-3 to 170; orthographic

/// A cube of 16 mm, all of it opaque or of another opacity.
fn cube(alpha: f64) -> Scene {
    let volume = phantom::volume([16; 3], centered([16; 3], DVec3::ONE), |_| 500.0);
    phantom::scene(&volume, &[(400.0, "clay", alpha)], Quality::STANDARD)
}

#[test]
fn a_camera_inside_sees_no_hole() {
    let mut renderer = renderer();
    // In the middle of a voxel, on a voxel's center, on a corner of eight, on a face and in a corner of the box.
    let eyes = [DVec3::splat(0.123), DVec3::splat(0.5), DVec3::ZERO, DVec3::new(8.0, 1.0, 2.0), DVec3::splat(8.0)];
    for (i, eye) in eyes.into_iter().enumerate() {
        for from in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ONE] {
            let mut scene = cube(1.0);
            let volume = scene.objects[0].volume.clone();
            scene.camera = phantom::camera(&volume, from, Projection::Perspective { fov_y_deg: 80.0 });
            scene.camera.eye_mm = eye;
            let image = draw(&mut renderer, &scene, [24, 20]);
            let holes = image.pixels.iter().filter(|p| p[3] != 1.0).count();
            // On a face and in a corner some rays look out.
            if i < 3 {
                assert_eq!(holes, 0, "a hole around an eye at {eye}, looking along {from}");
            }
            scene.objects[0].transfer_function.nodes[0].opacity = 0.1;
            held_to_reference(&mut renderer, &scene, [24, 20], &(eye, from));
        }
    }
    // Inside a body, surfaces all around.
    for (eye, nodes) in [(DVec3::new(0.2, 0.1, 0.3), VEIL), (DVec3::new(6.0, 6.0, 6.0), OPAQUE)] {
        let mut scene = phantom::scene(&lumpy(), nodes, Quality::STANDARD);
        let from = DVec3::new(0.6, 0.4, 0.5);
        scene.camera = phantom::camera(&scene.objects[0].volume, from, Projection::Perspective { fov_y_deg: 100.0 });
        scene.camera.eye_mm = eye;
        let (_, found) = held_to_reference(&mut renderer, &scene, [48, 40], &eye);
        assert!(found.covered > 0.9, "{found:?}");
    }
}

/// An eye at `factor` radii of the standard phantom with the field of view that shows its bounding sphere.
fn far(base: &Scene, factor: f64) -> Scene {
    let mut scene = base.clone();
    let (low, high) = scene.objects[0].volume.grid.index_box();
    let corners = scene.objects[0].volume.grid.box_corners_mm(low, high);
    let radius = corners.iter().map(|c| c.length()).fold(0.0, f64::max);
    let distance = factor * radius;
    scene.camera.eye_mm = -scene.camera.forward * distance;
    scene.camera.projection = Projection::Perspective { fov_y_deg: 2.0 * (radius / distance).asin().to_degrees() };
    scene
}

#[test]
fn a_camera_at_1e6_times_the_size_sees_the_same_picture() {
    let mut renderer = renderer();
    let base = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
    let pictures: Vec<FloatImage> = [1e3, 1e6, 1e9]
        .into_iter()
        .map(|factor| {
            let (picture, found) = held_to_reference(&mut renderer, &far(&base, factor), [48, 40], &factor);
            assert!(found.covered > 0.1, "{found:?}");
            picture
        })
        .collect();
    // From 1e3 sizes on perspective is gone: a thousandth of the size is less than a tenth of a voxel.
    for other in &pictures[1..] {
        let pairs = pictures[0].pixels.iter().flatten().zip(other.pixels.iter().flatten());
        let apart = pairs.filter(|(a, b)| (*a - *b).abs() > 0.05).count();
        assert!(apart < 48 * 40 * 4 / 100, "a farther eye sees another picture: {apart}");
    }

    // The naive f32 ray starts at the eye: where it enters the box is then rounded to the eye's distance.
    let scene = far(&base, 1e6);
    let [eye, forward] = [scene.camera.eye_mm, scene.camera.forward];
    let naive = |t: f64| (eye.as_vec3() + t as f32 * forward.as_vec3()).as_dvec3();
    let near = eye.length() - 20.0;
    let start = (eye + near * forward).as_vec3();
    let ours = |t: f64| (start + (t - near) as f32 * forward.as_vec3()).as_dvec3();
    let error = |place: &dyn Fn(f64) -> DVec3| {
        (0..400).map(|i| near + 0.1 * f64::from(i)).map(|t| place(t).distance(eye + t * forward)).fold(0.0, f64::max)
    };
    assert!(error(&naive) > 0.5, "f32 from the eye does not collapse here any more: {}", error(&naive));
    assert!(error(&ours) < 1e-5, "{}", error(&ours));
}

#[test]
fn rays_parallel_to_a_face_miss_no_column() {
    let mut renderer = renderer();
    for from in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
        let mut scene = cube(1.0);
        let volume = scene.objects[0].volume.clone();
        scene.camera = phantom::camera(&volume, from, Projection::Orthographic { height_mm: 16.0 });
        let (image, _) = held_to_reference(&mut renderer, &scene, [32, 32], &from);
        assert!(image.pixels.iter().all(|p| p[3] == 1.0), "looking along {from}, rays parallel to faces miss the box");
        // Two pixels of 16 mm put their rays into the faces themselves, which belong to the box, and two beside it.
        scene.camera.projection = Projection::Orthographic { height_mm: 32.0 };
        let (image, _) = held_to_reference(&mut renderer, &scene, [4, 2], &(from, "in the faces"));
        let covered: Vec<f32> = image.pixels.iter().map(|p| p[3]).collect();
        assert_eq!(covered, [0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0], "looking along {from}");
        // Nearly parallel, by less than f32 can divide by.
        for tilt in [1e-6, 1e-20, 1e-35, 1e-300] {
            scene.camera = phantom::camera(&volume, from, Projection::Orthographic { height_mm: 15.9 });
            scene.camera.forward = (scene.camera.forward + tilt * scene.camera.up).normalize();
            let (image, _) = held_to_reference(&mut renderer, &scene, [16, 16], &(from, tilt));
            assert!(image.pixels.iter().all(|p| p[3] == 1.0), "a tilt of {tilt} from {from}");
        }
    }
    // The naive slab test divides: on a face that is 0/0, beside it ∞ of either sign.
    let on_face = (-0.5f32 - -0.5) / std::hint::black_box(0.0);
    assert!(on_face.is_nan());
}

#[test]
fn looking_along_up_has_a_picture() {
    let mut renderer = renderer();
    let (perspective, parallel) =
        (Projection::Perspective { fov_y_deg: 20.0 }, Projection::Orthographic { height_mm: 40.0 });
    for (nodes, from, projection) in [
        (VEIL, DVec3::Z, perspective),
        (OPAQUE, DVec3::Z, parallel),
        (OPAQUE, DVec3::NEG_Z, perspective),
        (VEIL, DVec3::NEG_Z, parallel),
        (OPAQUE, DVec3::new(1e-9, 0.0, 1.0), perspective),
        (VEIL, DVec3::new(0.0, -1e-5, 1.0), parallel),
    ] {
        // phantom::camera asks for S up.
        let mut scene = phantom::scene(&lumpy(), nodes, Quality::STANDARD);
        scene.camera = phantom::camera(&scene.objects[0].volume, from, projection);
        let camera = scene.camera;
        assert!((camera.right.cross(camera.up) + camera.forward).length() < 1e-12, "{camera:?}");
        let (_, found) = held_to_reference(&mut renderer, &scene, [48, 40], &(from, projection));
        assert!(found.covered > 0.1, "{found:?}");
    }
    // The naive frame has no right.
    assert!(DVec3::Z.cross(DVec3::Z).normalize().is_nan());
}

#[test]
fn fields_of_view_from_1e_3_to_170_degrees_and_orthographic_draw() {
    let mut renderer = renderer();
    let base = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
    let volume = base.objects[0].volume.clone();
    for projection in [
        Projection::Perspective { fov_y_deg: 1e-3 },
        Projection::Perspective { fov_y_deg: 120.0 },
        Projection::Perspective { fov_y_deg: 170.0 },
        Projection::Orthographic { height_mm: 1e-6 },
        Projection::Orthographic { height_mm: 48.0 },
        Projection::Orthographic { height_mm: 1e6 },
    ] {
        for from in [DVec3::X, DVec3::new(-0.4, 1.0, 0.3)] {
            let mut scene = base.clone();
            scene.camera = phantom::camera(&volume, from, projection);
            // Odd sizes: a column and a row through the very middle.
            let (outside, _) = held_to_reference(&mut renderer, &scene, [41, 33], &(projection, from));
            assert!(outside.pixels[16 * 41 + 20][3] > 0.9, "nothing in the middle with {projection:?} {from}");
            scene.camera.eye_mm = DVec3::new(0.2, 0.1, 0.3);
            let inside = draw(&mut renderer, &scene, [41, 33]);
            // Where all rays are one ray the mean of the pixels is no mean: a pixel's tolerance counts.
            let found = difference(&inside, &twin(&scene, [41, 33])).codes;
            assert!(
                found.p999 <= same_settings(scene.quality.step_voxels).0,
                "inside with {projection:?} {from}: {found:?}"
            );
            assert!(inside.pixels.iter().any(|p| p[3] > 0.9), "nothing seen from inside with {projection:?} {from}");
        }
    }
}

// ---- image 0x0, 16384x16384; volume over the 3-D texture limit or GPU memory

#[test]
fn a_picture_without_pixels_is_a_sentence() {
    let mut renderer = renderer();
    let scene = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
    for size in [[0, 0], [0, 10], [10, 0], [70_000, 1]] {
        let error = renderer.render(&scene, size, &RenderOptions::default(), &Progress::new()).unwrap_err();
        assert!(error.to_string().contains("cannot be drawn"), "{error}");
    }
    let exact = Reference::new(&scene).unwrap();
    for size in [[0, 0], [0, 10], [10, 0]] {
        let error = exact.image(size, &Progress::new()).unwrap_err();
        assert!(error.to_string().contains("has nothing in it"), "{error}");
    }
}

#[test]
fn a_picture_16384_wide_is_tiled_in_bounded_memory() {
    let dims = [512, 2, 2];
    let volume = phantom::volume(dims, centered(dims, DVec3::ONE), |p| 300.0 + p.x + 40.0 * p.z);
    let mut scene =
        phantom::scene(&volume, &[(0.0, "unshaded_blue", 0.0), (600.0, "unshaded_red", 0.9)], Quality::STANDARD);
    scene.camera = phantom::camera(&volume, DVec3::NEG_Y, Projection::Orthographic { height_mm: 2.0 });
    let (width, height) = (16_384, 64);
    let exact = Reference::new(&scene).unwrap();
    let mut renderer = renderer();
    let mut first = None;
    for tile in [64, 24, 1 << 20] {
        // All that is kept is one number: whoever writes the rows away needs the memory of a band.
        let (mut hash, mut rows) = (DefaultHasher::new(), 0);
        let options = RenderOptions { tile, ..Default::default() };
        renderer
            .render_bands(&scene, [width, height], &options, &Progress::new(), |band| {
                assert!(band.len() <= width as usize * tile as usize);
                for row in band.chunks(width as usize) {
                    row.iter().flatten().for_each(|v| v.to_bits().hash(&mut hash));
                    for x in [0, 63, 64, 8191, 16_383] {
                        let expected = exact.pixel([width, height], x, rows);
                        for (found, expected) in row[x as usize].iter().zip(expected) {
                            // Half-float styles.
                            assert!((f64::from(*found) - expected).abs() < 3e-4, "{x} {rows}: {found} {expected}");
                        }
                    }
                    rows += 1;
                }
                Ok(())
            })
            .unwrap();
        assert_eq!(rows, height);
        assert_eq!(*first.get_or_insert(hash.finish()), hash.finish(), "tiles of {tile} pixels show");
    }

    // The whole 16384 × 16384 would take minutes here and 4 GiB in one piece: two bands of it, then enough.
    let (progress, mut num_bands) = (Progress::new(), 0);
    let options = RenderOptions { tile: 16, ..Default::default() };
    let end = renderer.render_bands(&scene, [16_384, 16_384], &options, &progress, |band| {
        assert_eq!(band.len(), 16_384 * 16);
        num_bands += 1;
        if num_bands == 2 {
            progress.cancel();
        }
        Ok(())
    });
    assert!(matches!(end, Err(fabrica_engine::Error::Cancelled)) && num_bands == 2);
}

#[test]
fn a_volume_over_the_3d_texture_limit_is_a_sentence() {
    let mut renderer = renderer();
    let edge = renderer.context().adapter.max_volume_edge as usize;
    for dims in [[edge + 1, 1, 1], [1, edge + 1, 1], [1, 1, edge + 1]] {
        let long = phantom::volume(dims, DAffine3::IDENTITY, |_| 500.0);
        let scene = phantom::scene(&long, OPAQUE, Quality::STANDARD);
        let error = renderer.render(&scene, [8, 8], &RenderOptions::default(), &Progress::new()).unwrap_err();
        assert!(error.to_string().contains(&format!("at most {edge} along an axis")), "{error}");
        // The reference has no such limit.
        assert!(reference(&scene, [3, 3]).iter().flatten().all(|v| v.is_finite()));
    }
    // One voxel less is drawn, whole.
    let dims = [edge, 1, 1];
    let volume = phantom::volume(dims, centered(dims, DVec3::ONE), |_| 500.0);
    let mut scene = phantom::scene(&volume, &[(400.0, "clay", 1.0)], Quality::STANDARD);
    scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 0.5 });
    let size = [2 * edge as u32, 1];
    let image = renderer.render(&scene, size, &RenderOptions { tile: 1 << 20, ..Default::default() }, &Progress::new());
    assert_eq!(image.unwrap().pixels.iter().filter(|p| p[3] == 1.0).count(), 2 * edge);
}

#[test]
fn a_volume_over_the_gpu_memory_is_a_sentence() {
    let dims = [4096, 4096, 160];
    let grid = Grid::new(dims, DAffine3::IDENTITY).unwrap();
    // Zeroed memory that nobody writes costs none. The reference would take two f64 a voxel: 43 GB that no test has.
    let huge = Voxels::U8(vec![0; dims[0] * dims[1] * dims[2]]);
    let volume = Arc::new(Volume::new(grid, huge, Rescale::IDENTITY, "test").unwrap());
    let scene = phantom::scene(&volume, OPAQUE, Quality::STANDARD);
    let error = renderer().render(&scene, [8, 8], &RenderOptions::default(), &Progress::new()).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("5.0 GiB") && message.contains("it grants about"), "{message}");
    assert!(!message.contains("about 0 slices"), "{message}");
}
