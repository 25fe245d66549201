//! The raycaster on the software adapter: tiles, skipping, alpha, determinism, fallbacks, limits.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::gpu::context::VolumeFormats;
use fabrica_engine::gpu::shader_library::RaycastKey;
use fabrica_engine::image_out::{PngOptions, decode_png_straight, write_png};
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::{Background, Projection, Quality, Scene};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use fabrica_tests::phantom::{self, centered, lumpy};
use fabrica_tests::{renderer, software};
use glam::{DAffine3, DVec3};

const OPAQUE: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: &[(f64, &str, f64)] = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (800.0, "muscle", 0.3)];

fn draw(renderer: &mut Renderer, scene: &Scene, size: [u32; 2]) -> FloatImage {
    renderer.render(scene, size, &RenderOptions::default(), &Progress::new()).unwrap()
}

fn bits(image: &FloatImage) -> Vec<u32> {
    image.pixels.iter().flatten().map(|v| v.to_bits()).collect()
}

#[test]
fn tiled_equals_untiled_bit_for_bit() {
    let mut renderer = renderer();
    for nodes in [OPAQUE, VEIL] {
        let scene = phantom::scene(&lumpy(), nodes, Quality::STANDARD);
        let size = [101, 67];
        let whole = renderer.render(&scene, size, &RenderOptions { tile: 128, ..Default::default() }, &Progress::new());
        let whole = bits(&whole.unwrap());
        for tile in [1 << 20, 32, 19, 64] {
            let options = RenderOptions { tile, ..Default::default() };
            let tiled = renderer.render(&scene, size, &options, &Progress::new()).unwrap();
            assert!(bits(&tiled) == whole, "tiles of {tile} pixels show");
        }
    }
}

#[test]
fn the_tile_comparison_sees_one_wrong_ray() {
    // Planted: a picture one pixel wider has other rays; if this passed as equal, the test above could not fail.
    let mut renderer = renderer();
    let scene = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
    let (a, b) = (draw(&mut renderer, &scene, [64, 64]), draw(&mut renderer, &scene, [66, 64]));
    let cropped: Vec<_> = b.pixels.chunks(66).flat_map(|row| row[1..65].to_vec()).collect();
    let shifted =
        FloatImage { width: 64, height: 64, pixels: b.pixels.chunks(66).flat_map(|r| r[..64].to_vec()).collect() };
    assert!(bits(&a) != bits(&shifted));
    // … and the same rays in a wider picture are the same up to the rounding of their screen coordinate.
    let worst = a.pixels.iter().flatten().zip(cropped.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 0.05, "{worst}");
}

#[test]
fn skipping_changes_no_bit() {
    let mut renderer = renderer();
    for nodes in [OPAQUE, VEIL, &[(600.0, "ink", 0.0), (601.0, "ink", 1.0)]] {
        for step_voxels in [2.0, 1.0, 0.3] {
            let quality = Quality { step_voxels, ..Quality::STANDARD };
            let scene = phantom::scene(&lumpy(), nodes, quality);
            let leaping = draw(&mut renderer, &scene, [96, 96]);
            let options = RenderOptions { skip_empty: false, ..Default::default() };
            let walking = renderer.render(&scene, [96, 96], &options, &Progress::new()).unwrap();
            assert!(bits(&leaping) == bits(&walking), "skipping shows at step {step_voxels}");
            assert!(leaping.pixels.iter().any(|p| p[3] > 0.5));
        }
    }
}

#[test]
fn two_runs_and_two_devices_agree_bit_for_bit() {
    let scene = phantom::scene(&lumpy(), VEIL, Quality::FINAL);
    let (mut one, mut two) = (renderer(), renderer());
    let first = bits(&draw(&mut one, &scene, [80, 60]));
    assert!(first == bits(&draw(&mut one, &scene, [80, 60])));
    assert!(first == bits(&draw(&mut two, &scene, [80, 60])));
}

#[test]
fn alpha_solves_back_from_black_and_white() {
    let mut renderer = renderer();
    let mut scene = phantom::scene(&lumpy(), VEIL, Quality::STANDARD);
    let clear = draw(&mut renderer, &scene, [64, 64]);
    scene.background = Background::Color([0.0; 3]);
    let black = draw(&mut renderer, &scene, [64, 64]);
    scene.background = Background::Color([1.0; 3]);
    let white = draw(&mut renderer, &scene, [64, 64]);
    let mut partial = 0;
    for ((c, b), w) in clear.pixels.iter().zip(&black.pixels).zip(&white.pixels) {
        for i in 0..3 {
            assert!((1.0 - (w[i] - b[i]) - c[3]).abs() < 1e-5, "{c:?} {b:?} {w:?}");
            assert!((b[i] - c[i]).abs() < 1e-6);
        }
        partial += usize::from(c[3] > 0.05 && c[3] < 0.95);
    }
    assert!(partial > 100, "nothing translucent was tested");
    // The file keeps it: straight alpha, so that color × alpha is the picture over black.
    let mut file = Vec::new();
    write_png(&mut file, 64, 64, &PngOptions::default(), |rows| rows.write(&clear.pixels)).unwrap();
    let straight = decode_png_straight(&file, std::path::Path::new("memory")).unwrap();
    for (s, c) in straight.pixels.iter().zip(&clear.pixels) {
        assert!((s[3] - c[3]).abs() <= 0.5 / 255.0 + 1e-6);
        if c[3] > 0.1 {
            for i in 0..3 {
                assert!((s[i] * s[3] - c[i]).abs() < 0.012, "{s:?} {c:?}");
            }
        }
    }
}

#[test]
fn every_sampling_path_draws_the_same_picture() {
    let scene = phantom::scene(&lumpy(), VEIL, Quality::STANDARD);
    let mut first: Option<FloatImage> = None;
    for (r16_filterable, r32_filterable) in [(true, true), (false, true), (false, false)] {
        let context = software().with_formats(VolumeFormats { r16_filterable, r32_filterable });
        let image = draw(&mut Renderer::new(context), &scene, [64, 64]);
        if let Some(first) = &first {
            let pairs = first.pixels.iter().flatten().zip(image.pixels.iter().flatten());
            let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // The adapter's filter and eight loads round differently; 1e-3 of linear light is a quarter code at most.
            assert!(worst < 1e-3, "16-bit filter {r16_filterable}, float filter {r32_filterable}: {worst}");
        } else {
            first = Some(image);
        }
    }
}

#[test]
fn every_voxel_type_draws_the_same_picture() {
    let grid = Grid::new([16, 16, 16], centered([16, 16, 16], DVec3::ONE)).unwrap();
    let values: Vec<f64> = (0..4096)
        .map(|i| DVec3::new((i % 16) as f64, (i / 16 % 16) as f64, (i / 256) as f64) - 7.5)
        .map(|p| (120.0 - 12.0 * (p - DVec3::new(1.0, 2.0, -1.0)).length()).round().max(0.0))
        .collect();
    macro_rules! as_type {
        ($variant:ident, $t:ty) => {
            Voxels::$variant(values.iter().map(|v| *v as $t).collect())
        };
    }
    let plain = Rescale::IDENTITY;
    // The last two state the same values through a rescale, once turned around.
    let cases = [
        (as_type!(U8, u8), plain),
        (as_type!(I8, i8), plain),
        (as_type!(U16, u16), plain),
        (as_type!(I16, i16), plain),
        (as_type!(U32, u32), plain),
        (as_type!(I32, i32), plain),
        (as_type!(U64, u64), plain),
        (as_type!(I64, i64), plain),
        (as_type!(F32, f32), plain),
        (as_type!(F64, f64), plain),
        (Voxels::I16(values.iter().map(|v| *v as i16 * 4 - 100).collect()), Rescale { slope: 0.25, intercept: 25.0 }),
        (Voxels::U8(values.iter().map(|v| 255 - *v as u8).collect()), Rescale { slope: -1.0, intercept: 255.0 }),
    ];
    let mut renderer = renderer();
    let mut first: Option<FloatImage> = None;
    for (voxels, rescale) in cases {
        let name = voxels.type_name();
        let volume = Arc::new(Volume::new(grid, voxels, rescale, "test").unwrap());
        let nodes = [(20.0, "wax", 0.0), (60.0, "wax", 0.4), (110.0, "vessel", 1.0)];
        let image = draw(&mut renderer, &phantom::scene(&volume, &nodes, Quality::STANDARD), [48, 48]);
        assert!(image.pixels.iter().any(|p| p[3] > 0.9));
        if let Some(first) = &first {
            let pairs = first.pixels.iter().flatten().zip(image.pixels.iter().flatten());
            let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 4e-3, "{name} with {rescale:?}: {worst}");
        } else {
            first = Some(image);
        }
    }
}

#[test]
fn voxels_without_data_are_gaps_not_faults() {
    let grid = Grid::new([24, 24, 24], centered([24, 24, 24], DVec3::ONE)).unwrap();
    let mut values = vec![500.0f32; 24 * 24 * 24];
    // A column of NaN straight through along y, and outliers that must not shift anything else.
    for y in 0..24 {
        for x in 10..14 {
            for z in 10..14 {
                values[x + 24 * (y + 24 * z)] = f32::NAN;
            }
        }
    }
    values[0] = f32::INFINITY;
    values[5] = -1e30;
    values[7] = 1e30;
    values[9] = f32::MIN_POSITIVE / 8.0;
    let volume = Arc::new(Volume::new(grid, Voxels::F32(values), Rescale::IDENTITY, "test").unwrap());
    let mut scene = phantom::scene(&volume, &[(400.0, "plaster", 0.5), (600.0, "plaster", 0.5)], Quality::STANDARD);
    scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 24.0 });
    let mut renderer = renderer();
    let mut pixels = Vec::new();
    let report = renderer
        .render_bands(&scene, [48, 48], &RenderOptions::default(), &Progress::new(), |band| {
            pixels.extend_from_slice(band);
            Ok(())
        })
        .unwrap();
    assert!(pixels.iter().flatten().all(|v| v.is_finite()));
    assert_eq!(pixels[24 * 48 + 24][3], 0.0, "the gap shows");
    assert!(pixels[24 * 48 + 8][3] > 0.99, "what has data does not");
    assert!(report.warnings[0].contains("385 of 13824"), "{:?}", report.warnings);
    assert!(report.pipeline.contains("no_data"));
}

#[test]
fn degenerate_volumes_draw() {
    let mut renderer = renderer();
    let cases: [([usize; 3], DVec3); 7] = [
        ([1, 1, 1], DVec3::ONE),
        ([64, 1, 64], DVec3::ONE),
        ([1, 1, 300], DVec3::ONE),
        ([16, 16, 16], DVec3::splat(1e-4)),
        ([16, 16, 16], DVec3::splat(1e4)),
        ([64, 64, 4], DVec3::new(1.0, 1.0, 100.0)),
        ([4, 64, 64], DVec3::new(100.0, 1.0, 1.0)),
    ];
    for (dims, spacing) in cases {
        let volume = phantom::volume(dims, centered(dims, spacing), |_| 500.0);
        let mut scene = phantom::scene(&volume, &[(400.0, "clay", 1.0)], Quality::STANDARD);
        scene.objects[0].transfer_function.reference_length_mm = spacing.min_element();
        let thinnest = (0..3).map(|i| dims[i] as f64 * spacing[i]).fold(f64::INFINITY, f64::min);
        let close = Projection::Orthographic { height_mm: 0.3 * thinnest };
        scene.camera = phantom::camera(&volume, DVec3::new(0.5, 1.0, 0.4), close);
        let image = draw(&mut renderer, &scene, [40, 40]);
        // A constant volume is its box: every ray close to its center meets it, whatever its shape.
        assert!(image.pixels.iter().all(|p| p[3] == 1.0), "{dims:?} {spacing}");
    }
}

#[test]
fn extreme_cameras_draw() {
    let volume = lumpy();
    let mut renderer = renderer();
    let base = phantom::scene(&volume, OPAQUE, Quality::STANDARD);
    let near = draw(&mut renderer, &base, [64, 64]);
    // 1e6 times as far with the field of view that shows the same: the same picture but for perspective.
    let far = |factor: f64| {
        let mut scene = base.clone();
        let (low, high) = volume.grid.index_box();
        let corners = volume.grid.box_corners_mm(low, high);
        let radius = corners.iter().map(|c| c.length()).fold(0.0, f64::max);
        let distance = factor * radius;
        scene.camera.eye_mm = -scene.camera.forward * distance;
        scene.camera.projection = Projection::Perspective { fov_y_deg: 2.0 * (radius / distance).asin().to_degrees() };
        scene
    };
    let (a, b) = (draw(&mut renderer, &far(1e3), [64, 64]), draw(&mut renderer, &far(1e6), [64, 64]));
    let apart = a.pixels.iter().flatten().zip(b.pixels.iter().flatten()).filter(|(a, b)| (*a - *b).abs() > 0.05);
    assert!(apart.count() < 64 * 64 * 4 / 100, "an eye at 1e6 sizes sees another picture");
    assert!(near.pixels.iter().any(|p| p[3] > 0.9) && b.pixels.iter().any(|p| p[3] > 0.9));
    for projection in [
        Projection::Perspective { fov_y_deg: 1e-3 },
        Projection::Perspective { fov_y_deg: 170.0 },
        Projection::Orthographic { height_mm: 1e-6 },
        Projection::Orthographic { height_mm: 1e6 },
    ] {
        for from in [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::Y, DVec3::ONE] {
            let mut scene = base.clone();
            scene.camera = phantom::camera(&volume, from, projection);
            let outside = draw(&mut renderer, &scene, [33, 21]);
            scene.camera.eye_mm = DVec3::new(0.2, 0.1, 0.3);
            let inside = draw(&mut renderer, &scene, [33, 21]);
            assert!(outside.pixels.iter().chain(&inside.pixels).flatten().all(|v| v.is_finite()), "{projection:?}");
            assert!(inside.pixels.iter().any(|p| p[3] > 0.9), "nothing seen from inside with {projection:?} {from}");
        }
    }
}

#[test]
fn an_eye_inside_has_no_hole_and_parallel_rays_no_missing_column() {
    let volume = phantom::volume([16, 16, 16], centered([16, 16, 16], DVec3::ONE), |_| 500.0);
    let mut scene = phantom::scene(&volume, &[(400.0, "clay", 1.0)], Quality::STANDARD);
    let mut renderer = renderer();
    for from in [DVec3::X, DVec3::NEG_Y, DVec3::Z] {
        scene.camera = phantom::camera(&volume, from, Projection::Orthographic { height_mm: 16.0 });
        let image = draw(&mut renderer, &scene, [64, 64]);
        let holes = image.pixels.iter().filter(|p| p[3] < 0.99).count();
        assert_eq!(holes, 0, "looking along {from}, rays parallel to faces miss the box");
        scene.camera = phantom::camera(&volume, from, Projection::Perspective { fov_y_deg: 100.0 });
        scene.camera.eye_mm = DVec3::splat(0.123);
        let image = draw(&mut renderer, &scene, [64, 64]);
        assert_eq!(image.pixels.iter().filter(|p| p[3] < 0.99).count(), 0, "a hole around an eye inside");
    }
}

#[test]
fn tiny_opacities_add_up() {
    // α = 1e-6 per millimeter over 10⁴ samples: 1−(1−α)^n; naive f32 stalls at 0.
    let dims = [8, 8, 2500];
    let volume = phantom::volume(dims, centered(dims, DVec3::ONE), |_| 500.0);
    let mut scene =
        phantom::scene(&volume, &[(400.0, "unshaded", 1e-6)], Quality { step_voxels: 0.25, termination: 1e-4 });
    scene.camera = phantom::camera(&volume, DVec3::Z, Projection::Orthographic { height_mm: 4.0 });
    let image = draw(&mut renderer(), &scene, [4, 4]);
    let expected = 1.0 - (1.0 - 1e-6f64).powi(2500);
    let found = f64::from(image.pixels[5][3]);
    assert!((found - expected).abs() < 1e-4 * expected, "{found} is not {expected}");
    let naive = 1.0 - (1.0f32 - 1e-8).powf(0.25);
    assert_eq!(naive, 0.0, "the naive form does not fail here any more: is the test still worth its place?");
    // … and α = 1: the first sample wins exactly.
    for node in &mut scene.objects[0].transfer_function.nodes {
        node.opacity = 1.0;
    }
    assert!(draw(&mut renderer(), &scene, [4, 4]).pixels.iter().all(|p| p[3] == 1.0));
}

#[test]
fn what_cannot_be_drawn_is_a_sentence() {
    let mut renderer = renderer();
    let scene = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
    for size in [[0, 10], [10, 0], [70_000, 1]] {
        let error = renderer.render(&scene, size, &RenderOptions::default(), &Progress::new()).unwrap_err();
        assert!(error.to_string().contains("cannot be drawn"), "{error}");
    }
    let progress = Progress::new();
    progress.cancel();
    let error = renderer.render(&scene, [64, 64], &RenderOptions::default(), &progress).unwrap_err();
    assert!(matches!(error, fabrica_engine::Error::Cancelled));
    // Longer than any 3-D texture of this adapter.
    let edge = renderer.context().adapter.max_volume_edge as usize;
    let dims = [edge + 1, 1, 1];
    let long = phantom::volume(dims, DAffine3::IDENTITY, |_| 0.0);
    let scene = phantom::scene(&long, OPAQUE, Quality::STANDARD);
    let error = renderer.render(&scene, [8, 8], &RenderOptions::default(), &Progress::new()).unwrap_err();
    assert!(error.to_string().contains(&format!("at most {edge} along an axis")), "{error}");
}

#[test]
fn an_empty_scene_is_its_background() {
    let mut scene = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
    scene.objects.clear();
    scene.background = Background::Color([0.25, 0.5, 1.0]);
    let image = draw(&mut renderer(), &scene, [3, 2]);
    assert_eq!(image.pixels, [[0.25, 0.5, 1.0, 1.0]; 6]);
}

#[test]
fn a_scene_without_a_feature_has_no_code_for_it() {
    for key in RaycastKey::all() {
        let text = key.wgsl().unwrap();
        assert_eq!(text.contains("var validity:"), key.no_data, "{key}");
        assert_eq!(text.contains("textureSampleLevel(data"), key.filtered, "{key}");
    }
}

#[test]
fn a_volume_over_the_memory_limit_is_refused() {
    let dims = [4096, 4096, 160];
    let grid = Grid::new(dims, DAffine3::IDENTITY).unwrap();
    // Zeroed memory that nobody writes costs none.
    let huge = Voxels::U8(vec![0; dims[0] * dims[1] * dims[2]]);
    let volume = Arc::new(Volume::new(grid, huge, Rescale::IDENTITY, "test").unwrap());
    let scene = phantom::scene(&volume, OPAQUE, Quality::STANDARD);
    let error = renderer().render(&scene, [8, 8], &RenderOptions::default(), &Progress::new()).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("5.0 GiB") && message.contains("it grants about"), "{message}");
    assert!(!message.contains("about 0 slices"), "{message}");
}
