//! The raycaster on the software adapter: tiles, skipping, alpha, determinism, fallbacks. Its extremes stand in `extremes.rs`.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::gpu::context::VolumeFormats;
use fabrica_engine::image_out::{PngOptions, decode_png_straight, write_png};
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::{Background, Projection, Quality, Scene};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use fabrica_tests::phantom::{self, centered, lumpy};
use fabrica_tests::{renderer, software};
use glam::DVec3;

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

/// Whether a picture is the one that is drawn without leaping over anything.
fn leaps_like_walking(renderer: &mut Renderer, scene: &Scene, size: [u32; 2]) -> bool {
    let leaping = draw(renderer, scene, size);
    let options = RenderOptions { skip_empty: false, ..Default::default() };
    let walking = renderer.render(scene, size, &options, &Progress::new()).unwrap();
    assert!(leaping.pixels.iter().any(|p| p[3] > 0.5));
    bits(&leaping) == bits(&walking)
}

#[test]
fn skipping_changes_no_bit() {
    let mut renderer = renderer();
    for nodes in [OPAQUE, VEIL, &[(600.0, "ink", 0.0), (601.0, "ink", 1.0)]] {
        for step_voxels in [11.0, 4.0, 2.0, 1.0, 0.3] {
            let quality = Quality { step_voxels, ..Quality::STANDARD };
            let scene = phantom::scene(&lumpy(), nodes, quality);
            assert!(leaps_like_walking(&mut renderer, &scene, [96, 96]), "skipping shows at step {step_voxels}");
        }
    }
}

/// A dot far from the middle of a volume of mostly nothing, seen by some cameras: as a whole, from near by, from within.
fn dots() -> impl Iterator<Item = Scene> {
    let edge = |p: DVec3| 700.0 * (1.0 - (p - DVec3::new(-13.0, 9.0, 11.0)).length() / 5.0).max(0.0);
    let cubic = phantom::volume([44, 40, 48], centered([44, 40, 48], DVec3::ONE), edge);
    let spacing = DVec3::new(0.7, 1.0, 2.5);
    let flat = phantom::volume([60, 40, 20], centered([60, 40, 20], spacing), edge);
    [cubic, flat].into_iter().flat_map(|volume| {
        let seen = [
            (0.0, Projection::Orthographic { height_mm: 50.0 }),
            (0.0, Projection::Perspective { fov_y_deg: 50.0 }),
            (0.0, Projection::Perspective { fov_y_deg: 9.0 }),
            (70.0, Projection::Perspective { fov_y_deg: 120.0 }),
        ];
        seen.into_iter().map(move |(nearer, projection)| {
            let mut scene = phantom::scene(&volume, &[(50.0, "bone", 0.0), (90.0, "bone", 0.9)], Quality::DRAFT);
            scene.camera = phantom::camera(&volume, DVec3::new(-0.7, 0.5, 0.4), projection);
            if nearer > 0.0 {
                // Right behind the dot's back.
                scene.camera.eye_mm = DVec3::new(-13.0, 9.0, 11.0) - 1.5 * scene.camera.forward;
            } else {
                let across = DVec3::new(-13.0, 9.0, 11.0);
                let off = across - across.dot(scene.camera.forward) * scene.camera.forward;
                scene.camera.eye_mm += 0.9 * off;
            }
            scene
        })
    })
}

#[test]
fn rays_that_meet_nothing_change_no_bit() {
    let mut renderer = renderer();
    for (i, scene) in dots().enumerate() {
        assert!(leaps_like_walking(&mut renderer, &scene, [150, 90]), "scene {i}");
        // Not of all pixels, and in tiles that end anywhere.
        let whole = draw(&mut renderer, &scene, [150, 90]);
        let options = RenderOptions { stride: 4, tile: 13, ..Default::default() };
        let sample = renderer.render(&scene, [150, 90], &options, &Progress::new()).unwrap();
        let at = |x: u32, y: u32| whole.pixels[(150 * (2 + 4 * y) + 2 + 4 * x) as usize];
        let own = (0..sample.height).flat_map(|y| (0..sample.width).map(move |x| (x, y)));
        assert!(
            own.zip(&sample.pixels).all(|((x, y), p)| at(x, y).map(f32::to_bits) == p.map(f32::to_bits)),
            "scene {i}"
        );
    }
}

#[test]
fn defects_of_coverage_are_noticed() {
    let ends_early = |text: String| {
        let changed = text.replace("steps + vec2f(-2.0, 2.0)", "steps + vec2f(-2.0, -6.0)");
        assert!(changed != text);
        changed
    };
    let begins_late = |text: String| text.replace("steps + vec2f(-2.0, 2.0)", "steps + vec2f(6.0, 2.0)");
    let others_tile = |text: String| text.replace("pixel / frame.coverage_edge", "pixel / frame.coverage_edge + 1u");
    for patch in [ends_early as fn(String) -> String, begins_late, others_tile] {
        let mut patched = Renderer::with_patched_shaders(software(), patch);
        assert!(dots().any(|scene| !leaps_like_walking(&mut patched, &scene, [150, 90])));
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
    // Gradients as texels, then as differences of samples.
    for (r16_filterable, r32_filterable, gradient_bytes) in
        [(true, true, u64::MAX), (false, false, u64::MAX), (true, true, 0), (false, true, 0), (false, false, 0)]
    {
        let context = software().with_formats(VolumeFormats {
            r16_filterable,
            rgba16_filterable: r16_filterable,
            r32_filterable,
            gradient_bytes,
        });
        let image = draw(&mut Renderer::new(context), &scene, [64, 64]);
        if let Some(first) = &first {
            let pairs = first.pixels.iter().flatten().zip(image.pixels.iter().flatten());
            let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // The adapter's filter and eight loads round differently; 1e-3 of linear light is a quarter code at most.
            assert!(worst < 1e-3, "{r16_filterable}, {r32_filterable}, {gradient_bytes}: {worst}");
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
fn a_cancelled_picture_is_given_up() {
    let scene = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
    let progress = Progress::new();
    progress.cancel();
    let error = renderer().render(&scene, [64, 64], &RenderOptions::default(), &progress).unwrap_err();
    assert!(matches!(error, fabrica_engine::Error::Cancelled));
}

#[test]
fn an_empty_scene_is_its_background() {
    let mut scene = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
    scene.objects.clear();
    scene.background = Background::Color([0.25, 0.5, 1.0]);
    let image = draw(&mut renderer(), &scene, [3, 2]);
    assert_eq!(image.pixels, [[0.25, 0.5, 1.0, 1.0]; 6]);
}
