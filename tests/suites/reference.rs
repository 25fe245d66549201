//! The GPU raycaster against the f64 reference at the same settings, and the proof that the comparison can fail.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::measure::Difference;
use fabrica_engine::pass::raycast::ShaderPatch;
use fabrica_engine::render::Renderer;
use fabrica_engine::scene::{Background, Projection, Quality, Scene};
use fabrica_engine::spaces::Grid;
use fabrica_engine::specimen;
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use fabrica_tests::phantom::{self, centered, lumpy};
use fabrica_tests::renderer;
use fabrica_tests::twin::{self, replace};
use glam::{DAffine3, DMat3, DVec3};

const SIZE: [u32; 2] = [48, 40];

fn compare(renderer: &mut Renderer, scene: &Scene) -> Result<Difference, String> {
    assert_eq!(scene.background, Background::Transparent);
    twin::compare(renderer, scene, SIZE)
}

const OPAQUE: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: &[(f64, &str, f64)] =
    &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.1), (600.0, "metal", 0.3)];
const THIN: &[(f64, &str, f64)] = &[(100.0, "clay", 0.001), (900.0, "cool_warm", 0.02)];

fn known(nodes: &[(f64, &'static str, f64)]) -> Vec<(f64, &'static str, f64)> {
    nodes.iter().map(|&(v, s, o)| (v, if s == "metal" { "steel" } else { s }, o)).collect()
}

#[test]
fn the_raycaster_draws_what_the_equations_say() {
    let mut renderer = renderer();
    for nodes in [OPAQUE, VEIL, THIN] {
        for quality in [Quality::DRAFT, Quality::STANDARD, Quality::FINAL] {
            for projection in [
                Projection::Perspective { fov_y_deg: 20.0 },
                Projection::Perspective { fov_y_deg: 75.0 },
                Projection::Orthographic { height_mm: 40.0 },
            ] {
                let volume = lumpy();
                let mut scene = phantom::scene(&volume, &known(nodes), quality);
                scene.camera = phantom::camera(&volume, DVec3::new(-0.7, 0.5, 0.4), projection);
                let found = compare(&mut renderer, &scene);
                println!("{quality:?} {projection:?}: {found:?}");
                found.unwrap();
            }
        }
    }
}

#[test]
fn awkward_grids_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let sheared = DMat3::from_cols(DVec3::new(0.9, 0.1, 0.0), DVec3::new(0.2, 0.8, 0.35), DVec3::new(-0.1, 0.0, 2.0));
    let grids = [
        ("anisotropic", [32, 32, 8], DMat3::from_diagonal(DVec3::new(0.8, 0.9, 3.5))),
        ("left-handed", [30, 31, 32], DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))),
        ("sheared", [30, 28, 16], sheared),
        ("turned", [30, 30, 30], DMat3::from_rotation_z(0.6) * DMat3::from_rotation_x(-0.9)),
    ];
    for (name, dims, m) in grids {
        let half = DVec3::from_array(dims.map(|n| (n - 1) as f64)) * 0.5;
        let affine = DAffine3::from_mat3_translation(m, -(m * half));
        let volume = phantom::volume(dims, affine, |p| {
            phantom::bump(p, DVec3::new(-3.0, 1.0, 0.0), 13.0).max(phantom::bump(p, DVec3::new(6.0, -4.0, 5.0), 8.0))
        });
        for nodes in [OPAQUE, THIN] {
            let found = compare(&mut renderer, &phantom::scene(&volume, &known(nodes), Quality::STANDARD));
            println!("{name}: {found:?}");
            found.unwrap();
        }
    }
}

#[test]
fn gradient_scales_and_gaps_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for gradient_scale_mm in [0.0, 0.3, 2.5] {
        let mut scene = phantom::scene(&lumpy(), OPAQUE, Quality::STANDARD);
        scene.objects[0].gradient_scale_mm = gradient_scale_mm;
        compare(&mut renderer, &scene).unwrap_or_else(|e| panic!("σ_g = {gradient_scale_mm}: {e}"));
    }
    let grid = Grid::new([20; 3], centered([20; 3], DVec3::ONE)).unwrap();
    let values: Vec<f32> = (0..8000)
        .map(|i| DVec3::new((i % 20) as f64, (i / 20 % 20) as f64, (i / 400) as f64))
        .map(
            |p| if (p.x + p.y) % 7.0 == 3.0 { f32::NAN } else { (900.0 - 70.0 * p.distance(DVec3::splat(9.0))) as f32 },
        )
        .collect();
    let volume = Arc::new(Volume::new(grid, Voxels::F32(values), Rescale::IDENTITY, "test").unwrap());
    compare(&mut renderer, &phantom::scene(&volume, THIN, Quality::STANDARD)).unwrap();
}

#[test]
fn the_specimen_draws_what_the_equations_say() {
    let head = Arc::new(specimen::generate("head", 64, &Progress::new()).unwrap().volume);
    let nodes = [(-700.0, "glass", 0.0), (-300.0, "glass", 0.1), (200.0, "bone", 0.02), (500.0, "bone", 0.9)];
    let mut scene = phantom::scene(&head, &nodes, Quality::STANDARD);
    scene.camera.projection = Projection::Perspective { fov_y_deg: 14.0 };
    let found = compare(&mut renderer(), &scene);
    println!("{found:?}");
    found.unwrap();
}

/// What is planted, and the scene that must notice.
fn planted(name: &str, patch: ShaderPatch, nodes: &[(f64, &'static str, f64)]) {
    // One voxel a step: there a wrong step shows more than at a finer one.
    let scene = phantom::scene(&lumpy(), nodes, Quality::balanced(1.0));
    twin::notices(&scene, SIZE, name, patch);
}

#[test]
fn a_wrong_opacity_correction_is_noticed() {
    planted(
        "opacity × length",
        |t| {
            replace(
                &t,
                "return one_minus_exp(exponent * ln_one_minus(alpha));",
                "return min(1.0, alpha * exponent * 1.1);",
            )
        },
        THIN,
    );
}

#[test]
fn a_swapped_gradient_axis_is_noticed() {
    planted("swapped axes", |t| replace(&t, "object.texel_scale, 0.0).xyz", "object.texel_scale, 0.0).yxz"), OPAQUE);
}

#[test]
fn the_wrong_half_of_the_lit_sphere_is_noticed() {
    planted("upside down", |t| replace(&t, "vec2f(on_disc.x, -on_disc.y)", "vec2f(on_disc.x, on_disc.y)"), OPAQUE);
    planted("inside out", |t| replace(&t, "dot(outward, ray) > 0.0", "dot(outward, ray) < 0.0"), OPAQUE);
}

#[test]
fn a_dead_early_termination_is_noticed() {
    planted("no division", |t| replace(&t, "accumulated /= accumulated.a;", "accumulated *= 0.97;"), OPAQUE);
}

#[test]
fn a_half_sample_shift_is_noticed() {
    planted("shift", |t| replace(&t, "select(k, k + 1u, known)", "k"), OPAQUE);
}

#[test]
fn a_leap_too_far_is_noticed() {
    planted("leap", |t| replace(&t, "i32(distance) - 1;", "i32(distance) + 1;"), OPAQUE);
}

#[test]
fn a_normal_that_is_looked_at_only_once_is_noticed() {
    // Hatching, translucent: many lines of it pass within one part.
    const HATCHED: &[(f64, &str, f64)] = &[(150.0, "engraving", 0.0), (700.0, "engraving", 0.2)];
    planted("one look", |t| replace(&t, "1.0, f32(MAX_LOOKS)", "1.0, 1.0"), HATCHED);
}
