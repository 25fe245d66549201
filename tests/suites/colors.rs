//! Volumes of colors: the raycaster against the f64 reference, the defects that the comparison must notice, what colors share
//! with plain values, and the extremes.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::color::linear_from_srgb8;
use fabrica_engine::gpu::context::VolumeFormats;
use fabrica_engine::measure::Difference;
use fabrica_engine::pass::raycast::ShaderPatch;
use fabrica_engine::pick::pick;
use fabrica_engine::reference::Reference;
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::{Background, Projection, Quality, Scene};
use fabrica_engine::spaces::Grid;
use fabrica_engine::specimen;
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use fabrica_tests::phantom::{self, bump, centered};
use fabrica_tests::twin::{self, replace};
use fabrica_tests::{renderer, software};
use glam::{DAffine3, DMat3, DVec3};

const SIZE: [u32; 2] = [48, 40];

/// A volume of the colors that a function of the world position in mm gives.
fn colored(dims: [usize; 3], affine: DAffine3, color: impl Fn(DVec3) -> [u8; 4]) -> Arc<Volume> {
    let grid = Grid::new(dims, affine).unwrap();
    let place = |i: usize| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])].map(|n| n as f64);
    let at = |i: usize| color(affine.transform_point3(DVec3::from_array(place(i))));
    Arc::new(Volume::from_colors(grid, (0..grid.num_voxels()).map(at).collect(), "test").unwrap())
}

fn code(value: f64) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// A lumpy body on black, of colors that differ in hue, and in places in nothing else.
fn body(p: DVec3) -> [u8; 4] {
    let bumps = bump(p, DVec3::new(-3.0, 1.0, 0.0), 15.0).max(bump(p, DVec3::new(7.0, -4.0, 5.0), 9.0)) / 1000.0;
    let wave = |k: DVec3| 0.5 + 0.45 * (p.dot(k)).sin();
    let light = (2.5 * bumps).min(1.0);
    [
        code(light * wave(DVec3::new(0.5, 0.1, 0.2))),
        code(light * wave(DVec3::new(-0.1, 0.4, 0.3))),
        code(light * wave(DVec3::new(0.2, -0.3, 0.5))),
        255,
    ]
}

/// The same within a soft edge of alpha, with garbage where nothing is seen.
fn cut_out(p: DVec3) -> [u8; 4] {
    let alpha = code(((11.0 - (p * DVec3::new(1.0, 0.8, 1.2)).length()) / 3.0).clamp(0.0, 1.0));
    let [r, g, b, _] = body(p);
    if alpha == 0 { [255, 0, 255, 0] } else { [r.max(40), g.max(40), b.max(40), alpha] }
}

fn lumpy(color: impl Fn(DVec3) -> [u8; 4]) -> Arc<Volume> {
    colored([32; 3], centered([32; 3], DVec3::ONE), color)
}

const OPAQUE: &[(f64, &str, f64)] = &[(0.01, "plaster", 0.0), (0.05, "plaster", 0.9), (0.3, "porcelain", 1.0)];
const VEIL: &[(f64, &str, f64)] = &[(0.01, "glass", 0.0), (0.1, "wax", 0.05), (0.2, "clay", 0.1), (0.2, "steel", 0.3)];
/// Whatever the value: what alpha alone cuts out.
const ALL: &[(f64, &str, f64)] = &[(0.0, "clay", 0.8)];

fn draw(renderer: &mut Renderer, scene: &Scene) -> FloatImage {
    twin::draw(renderer, scene, SIZE)
}

fn compare(renderer: &mut Renderer, scene: &Scene) -> Result<Difference, String> {
    twin::compare(renderer, scene, SIZE)
}

#[test]
fn colors_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for (name, color) in [("body", body as fn(DVec3) -> [u8; 4]), ("cut out", cut_out)] {
        let volume = lumpy(color);
        for nodes in [OPAQUE, VEIL, ALL] {
            for (quality, gradient_scale_mm) in
                [(Quality::DRAFT, 1.0), (Quality::STANDARD, 0.0), (Quality::STANDARD, 2.5), (Quality::FINAL, 1.0)]
            {
                let mut scene = phantom::scene(&volume, nodes, quality);
                scene.objects[0].gradient_scale_mm = gradient_scale_mm;
                let found = compare(&mut renderer, &scene);
                println!("{name} {} {quality:?} {gradient_scale_mm}: {found:?}", nodes[0].1);
                found.unwrap();
            }
        }
    }
}

#[test]
fn colors_on_awkward_grids_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let sheared = DMat3::from_cols(DVec3::new(0.9, 0.1, 0.0), DVec3::new(0.2, 0.8, 0.35), DVec3::new(-0.1, 0.0, 2.0));
    for (name, dims, m) in [
        ("anisotropic", [32, 32, 8], DMat3::from_diagonal(DVec3::new(0.8, 0.9, 3.5))),
        ("left-handed and sheared", [30, 28, 16], DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)) * sheared),
        ("tiny", [30, 30, 30], DMat3::from_diagonal(DVec3::splat(1e-4)) * DMat3::from_rotation_z(0.6)),
        ("huge", [30, 30, 30], DMat3::from_diagonal(DVec3::splat(1e4))),
    ] {
        let half = DVec3::from_array(dims.map(|n| (n - 1) as f64)) * 0.5;
        let affine = DAffine3::from_mat3_translation(m, -(m * half));
        let unit = m.determinant().abs().cbrt();
        for color in [body, cut_out] {
            let volume = colored(dims, affine, |p| color(p / unit));
            let mut scene = phantom::scene(&volume, OPAQUE, Quality::STANDARD);
            scene.objects[0].transfer_function.reference_length_mm = unit;
            let found = compare(&mut renderer, &scene);
            println!("{name}: {found:?}");
            found.unwrap();
        }
    }
}

#[test]
fn a_label_maps_colors_draw_what_the_equations_say() {
    let head = specimen::generate("head", 48, &Progress::new()).unwrap();
    let volume = Arc::new(Volume::from_labels(&head.labels).unwrap());
    let found = compare(&mut renderer(), &phantom::scene(&volume, ALL, Quality::STANDARD));
    println!("{found:?}");
    found.unwrap();
}

fn planted(name: &str, patch: ShaderPatch, color: fn(DVec3) -> [u8; 4], nodes: &[(f64, &'static str, f64)]) {
    twin::notices(&phantom::scene(&lumpy(color), nodes, Quality::balanced(1.0)), SIZE, name, patch);
}

#[test]
fn swapped_channels_are_noticed() {
    planted("bgr", |t| replace(&t, "* voxel.rgb", "* voxel.bgr"), body, OPAQUE);
}

#[test]
fn averaging_encoded_colors_is_noticed() {
    let patch = |t: String| {
        // (γ of 2.2; colors here are opaque.)
        let t = replace(
            &t,
            "* textureLoad(colors, vec3i(x, y, z), 0);",
            "* pow(textureLoad(colors, vec3i(x, y, z), 0), vec4f(1.0 / 2.2));",
        );
        replace(&t, "sum.rgb * (alpha / max(sum.a, 1e-30))", "pow(sum.rgb / max(sum.a, 1e-30), vec3f(2.2))")
    };
    planted("average of sRGB", patch, body, OPAQUE);
}

#[test]
fn voxels_that_count_though_unseen_are_noticed() {
    planted("unseen", |t| replace(&t, "UNSEEN: f32 = 1e-3", "UNSEEN: f32 = 1.0"), body, OPAQUE);
}

#[test]
fn alpha_that_does_not_count_is_noticed() {
    planted("alpha ignored", |t| replace(&t, "style.a * voxel.a)", "style.a)"), cut_out, ALL);
    planted("alpha twice", |t| replace(&t, "style.rgb) * voxel.rgb", "style.rgb) * voxel.rgb * voxel.a"), cut_out, ALL);
}

#[test]
fn normals_of_luminance_alone_are_noticed() {
    planted(
        "luminance",
        |t| replace(&t, "var along = select(b, a", "var along = BRIGHTNESS * j; let unused = select(b, a"),
        body,
        OPAQUE,
    );
    planted("an axis", |t| replace(&t, "to_x.x * x + to_y.x * y", "to_x.x * y + to_y.x * x"), body, OPAQUE);
    planted(
        "half as steep",
        |t| replace(&t, "return COLOR_DISTANCE *", "return 0.01 * COLOR_DISTANCE *"),
        body,
        OPAQUE,
    );
}

#[test]
fn a_style_gives_its_luminance_only() {
    planted(
        "the style's color",
        |t| replace(&t, "dot(LUMINANCE, style.rgb) *", "style.rgb *"),
        body,
        &[(0.05, "vessel", 0.9)],
    );
}

#[test]
fn grays_are_their_values_pictures_times_their_color() {
    let gray = |p: DVec3| {
        let [v, ..] = body(p);
        [v, v, v, 255]
    };
    let colors = lumpy(gray);
    let values = Volume::new(colors.grid, colors.voxels.clone(), colors.rescale, "test").unwrap();
    let mut renderer = renderer();
    // An outline that is translucent shows each difference of normals.
    for style in ["smoke", "plaster"] {
        let iso = f64::from(linear_from_srgb8(120));
        let nodes = [(iso, style, 0.0), (iso, style, 1.0)];
        let scene = phantom::scene(&colors, &nodes, Quality::FINAL);
        let mut plain = scene.clone();
        plain.objects[0].volume = Arc::new(values.clone());
        assert!((colors.gradient_max() / values.gradient_max() - 1.0).abs() < 1e-4, "G");
        let (colored, plain) = (draw(&mut renderer, &scene), draw(&mut renderer, &plain));
        let mut largest = 0.0f32;
        for (c, p) in colored.pixels.iter().zip(&plain.pixels) {
            largest = largest.max((c[3] - p[3]).abs());
            assert!((c[0] - c[1]).abs() < 1e-5 && (c[0] - c[2]).abs() < 1e-5, "{style}: {c:?} is not gray");
        }
        println!("{style}: opacity {largest}");
        assert!(largest < 1e-3, "{style}: opacities differ by {largest}");
    }
    // In one gray the picture is the plain one's light times it.
    let one = colored([12; 3], centered([12; 3], DVec3::ONE), |_| [188, 188, 188, 255]);
    let plain = Volume::new(one.grid, one.voxels.clone(), one.rescale, "test").unwrap();
    let colored = draw(&mut renderer, &phantom::scene(&one, ALL, Quality::STANDARD));
    let plain = draw(&mut renderer, &phantom::scene(&Arc::new(plain), ALL, Quality::STANDARD));
    let gray = linear_from_srgb8(188);
    for (c, p) in colored.pixels.iter().zip(&plain.pixels) {
        let light = 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2];
        assert!((c[1] - gray * light).abs() < 2e-4 && (c[3] - p[3]).abs() < 2e-4, "{c:?} {p:?}");
    }
}

#[test]
fn every_sampling_path_draws_the_same_colors() {
    // Hatching on gentle slopes shows what rounding does to normals.
    let hatched: &[(f64, &str, f64)] = &[(0.02, "engraving", 0.0), (0.1, "engraving", 0.3)];
    let gentle = |p: DVec3| {
        let at = |k: f64| code(0.75 + 0.15 * (p.x * 0.02 * k + p.y * 0.013 + p.z * 0.03).sin());
        if p.length() > 10.0 { [0, 0, 0, 255] } else { [at(1.0), at(2.0), at(-1.0), 255] }
    };
    for (color, nodes) in [(cut_out as fn(DVec3) -> [u8; 4], VEIL), (body, hatched), (gentle, hatched)] {
        let mut scene = phantom::scene(&lumpy(color), nodes, Quality::STANDARD);
        scene.objects[0].gradient_scale_mm = 1.5;
        let mut first: Option<Vec<[f64; 4]>> = None;
        for [r16_filterable, rgba16_filterable, r32_filterable] in
            [[true, true, true], [true, true, false], [true, false, true], [false, false, false]]
        {
            let formats = VolumeFormats { r16_filterable, rgba16_filterable, r32_filterable, gradient_bytes: 0 };
            let image = draw(&mut Renderer::new(software().with_formats(formats)), &scene);
            let Some(first) = &first else {
                first = Some(image.pixels.iter().map(|p| p.map(f64::from)).collect());
                continue;
            };
            let found = Difference::of(&image, first, Background::Transparent, None).unwrap().codes;
            println!("{}, {formats:?}: {found:?}", nodes[0].1);
            // Half floats have 11 bits.
            assert!(found.p999 < 2.0 && found.rmse < 0.15, "{formats:?}: {found:?}");
        }
    }
}

#[test]
fn extreme_colors_draw() {
    let mut renderer = renderer();
    let unit = DAffine3::IDENTITY;
    let constant = colored([9, 8, 7], unit, |_| [200, 40, 90, 255]);
    let single = colored([1; 3], unit, |_| [10, 250, 90, 128]);
    let black = colored([9; 3], centered([9; 3], DVec3::ONE), |p| [0, 0, 0, if p.length() < 3.0 { 255 } else { 0 }]);
    let same_light = colored([16; 3], unit, |p| if p.x < 7.5 { [255, 0, 0, 255] } else { [0, 146, 0, 255] });
    for (name, volume) in [("constant", &constant), ("single", &single), ("black", &black), ("same light", &same_light)]
    {
        for gradient_scale_mm in [0.0, 1.0, 1e6] {
            // A single voxel's faces turn within less than a voxel: on them, plain values are as far off.
            let nodes = if name == "single" { &[(0.0, "unshaded", 0.8)] } else { ALL };
            let mut scene = phantom::scene(volume, nodes, Quality::STANDARD);
            scene.objects[0].gradient_scale_mm = gradient_scale_mm;
            compare(&mut renderer, &scene).unwrap_or_else(|e| panic!("{name}, {gradient_scale_mm} mm: {e}"));
        }
    }
    assert_eq!(constant.gradient_max(), 1.0);
    assert!(black.gradient_max() > 0.4, "alpha has an edge of its own: {}", black.gradient_max());
    let nothing = colored([20; 3], unit, |_| [255, 255, 255, 0]);
    let scene = phantom::scene(&nothing, ALL, Quality::STANDARD);
    assert!(draw(&mut renderer, &scene).pixels.iter().all(|p| *p == [0.0; 4]));
    assert!(Reference::new(&scene).unwrap().twin(SIZE, &Progress::new()).unwrap().iter().all(|p| *p == [0.0; 4]));
    assert_eq!(pick(&scene, SIZE, 24, 20), None);
}

#[test]
fn leaping_over_what_is_transparent_changes_no_pixel() {
    let volume = colored([40; 3], centered([40; 3], DVec3::ONE), cut_out);
    let scene = phantom::scene(&volume, ALL, Quality::STANDARD);
    let mut renderer = renderer();
    let everywhere = RenderOptions { skip_empty: false, ..RenderOptions::default() };
    let all = renderer.render(&scene, SIZE, &everywhere, &Progress::new()).unwrap();
    assert_eq!(draw(&mut renderer, &scene), all);
}

#[test]
fn a_click_on_a_color_finds_what_the_picture_shows() {
    let volume = lumpy(cut_out);
    let mut scene = phantom::scene(&volume, ALL, Quality::FINAL);
    scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 40.0 });
    let picked = pick(&scene, SIZE, 24, 20).unwrap();
    // The soft edge of alpha lies from 8 to 11, the ellipsoid's half axis along y is 0.8⁻¹ of it.
    assert!((10.0..14.0).contains(&picked.position_mm.y), "{picked:?}");
    assert!(picked.gradient > 0.1 && picked.value > 0.01, "{picked:?}");
    assert_eq!(pick(&scene, SIZE, 4, 20), None);
    let opacity = draw(&mut renderer(), &scene).pixels[24 + 20 * SIZE[0] as usize][3];
    assert!((picked.opacity - f64::from(opacity)).abs() < 0.02, "{picked:?} {opacity}");
}

#[test]
fn colors_over_plain_values_are_kept_apart() {
    // The same luminances without colors have another picture; colors never leak into it.
    let volume = lumpy(body);
    let plain =
        Volume::new(volume.grid, volume.voxels.clone(), Rescale { slope: 1.0 / 65535.0, intercept: 0.0 }, "test");
    let plain = plain.unwrap();
    assert!(matches!(plain.voxels, Voxels::U16(_)) && plain.colors.is_none());
    let mut renderer = renderer();
    let colored = draw(&mut renderer, &phantom::scene(&volume, OPAQUE, Quality::STANDARD));
    let gray = draw(&mut renderer, &phantom::scene(&Arc::new(plain), OPAQUE, Quality::STANDARD));
    let chroma = |image: &FloatImage| image.pixels.iter().map(|p| (p[0] - p[2]).abs()).fold(0.0, f32::max);
    assert!(chroma(&colored) > 1.5 * chroma(&gray), "{} {}", chroma(&colored), chroma(&gray));
}
