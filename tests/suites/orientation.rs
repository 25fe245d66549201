//! Left is left: from every storage order to the picture.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::read::{ReadOptions, read_volume};
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::{Projection, Quality};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::Volume;
use fabrica_tests::{data, phantom, renderer};
use glam::{DAffine3, DMat3, DVec3};

/// A ball 11 mm from the center towards `direction`, in a grid of 32³ voxels or whatever `dims` say.
fn marked(world_from_index: DAffine3, dims: [usize; 3], direction: DVec3) -> Arc<Volume> {
    phantom::volume(dims, world_from_index, |p| if p.distance(direction * 11.0) < 4.5 { 500.0 } else { 0.0 })
}

const NUM_PIXELS: usize = 65;

fn look(renderer: &mut Renderer, volume: &Arc<Volume>, from: DVec3) -> FloatImage {
    let nodes = [(199.0, "unshaded", 0.0), (200.0, "unshaded", 1.0)];
    let mut scene = phantom::scene(volume, &nodes, Quality::STANDARD);
    scene.camera = phantom::camera(volume, from, Projection::Orthographic { height_mm: 32.5 });
    let size = [NUM_PIXELS as u32, NUM_PIXELS as u32];
    renderer.render(&scene, size, &RenderOptions::default(), &Progress::new()).unwrap()
}

/// Center of what is drawn, in mm right and up of the picture's center, rounded.
fn place(image: &FloatImage) -> (i32, i32) {
    let (mut x, mut y, mut n) = (0.0, 0.0, 0.0);
    for (i, pixel) in image.pixels.iter().enumerate().filter(|(_, p)| p[3] > 0.5) {
        assert!(pixel[3] <= 1.0);
        x += (i % NUM_PIXELS) as f64 + 0.5 - NUM_PIXELS as f64 / 2.0;
        y += NUM_PIXELS as f64 / 2.0 - (i / NUM_PIXELS) as f64 - 0.5;
        n += 1.0;
    }
    assert!(n > 100.0, "{n} pixels drawn");
    ((0.5 * x / n).round() as i32, (0.5 * y / n).round() as i32)
}

/// Direction to the eye, what it is called, and where the marks to the patient's right, front and top must be.
type View = (DVec3, &'static str, [(i32, i32); 3]);

const VIEWS: [View; 5] = [
    (DVec3::Y, "the front: the patient's right is on the left of the picture", [(-11, 0), (0, 0), (0, 11)]),
    (DVec3::NEG_Y, "behind: right is right", [(11, 0), (0, 0), (0, 11)]),
    (DVec3::X, "the patient's right: the face looks to the right", [(0, 0), (11, 0), (0, 11)]),
    (DVec3::NEG_X, "the patient's left: the face looks to the left", [(0, 0), (-11, 0), (0, 11)]),
    (DVec3::Z, "above, where the front is up: right is right", [(11, 0), (0, 11), (0, 0)]),
];

fn check_views(renderer: &mut Renderer, world_from_index: DAffine3, dims: [usize; 3]) -> Result<(), String> {
    for (i, direction) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
        let volume = marked(world_from_index, dims, direction);
        for (from, name, expected) in VIEWS {
            let found = place(&look(renderer, &volume, from));
            if found != expected[i] {
                return Err(format!(
                    "mark {} from {name}: at {found:?} instead of {:?}",
                    "RAS".as_bytes()[i] as char,
                    expected[i]
                ));
            }
        }
    }
    Ok(())
}

/// The axes that an orientation's letters name, as columns.
fn axes(letters: &str) -> DMat3 {
    let axis = |c: char| match c {
        'R' => DVec3::X,
        'L' => DVec3::NEG_X,
        'A' => DVec3::Y,
        'P' => DVec3::NEG_Y,
        'S' => DVec3::Z,
        _ => DVec3::NEG_Z,
    };
    let c: Vec<DVec3> = letters.chars().map(axis).collect();
    DMat3::from_cols(c[0], c[1], c[2])
}

#[test]
fn every_storage_order_shows_the_patient_the_same_way() {
    let mut renderer = renderer();
    for letters in ["RAS", "LPS", "LAS", "RPI", "ASR", "PIL", "SRP", "IAL"] {
        let m = axes(letters);
        let affine = DAffine3::from_mat3_translation(m, -(m * DVec3::splat(15.5)));
        assert_eq!(marked(affine, [32; 3], DVec3::X).grid.orientation_letters(), letters);
        check_views(&mut renderer, affine, [32; 3]).unwrap_or_else(|e| panic!("{letters}: {e}"));
    }
}

#[test]
fn sheared_and_anisotropic_grids_keep_their_place() {
    let tilted = DMat3::from_cols(DVec3::new(0.9, 0.1, 0.0), DVec3::new(0.0, 0.8, 0.35), DVec3::new(0.0, 0.0, 2.0));
    let dims = [40, 44, 20];
    let half = DVec3::from_array(dims.map(|n| (n - 1) as f64)) * 0.5;
    check_views(&mut renderer(), DAffine3::from_mat3_translation(tilted, -(tilted * half)), dims).unwrap();
}

#[test]
fn a_mirrored_volume_is_noticed() {
    // Planted: the voxels of one grid under the affine of its mirror image.
    let straight = marked(DAffine3::from_translation(DVec3::splat(-15.5)), [32; 3], DVec3::X);
    let mut wrong = (*straight).clone();
    let mirrored = DAffine3::from_mat3_translation(axes("LAS"), DVec3::new(15.5, -15.5, -15.5));
    wrong.grid = Grid::new([32; 3], mirrored).unwrap();
    assert_eq!(place(&look(&mut renderer(), &Arc::new(wrong), DVec3::Y)), (11, 0));
}

#[test]
fn real_heads_in_four_orders_make_one_picture() {
    let mut renderer = renderer();
    let mut first: Option<FloatImage> = None;
    for letters in ["RAS", "LPS", "ASR", "PIL"] {
        let Some(file) = data(&format!("orient_{letters}.nii.gz")) else { return };
        let volume = Arc::new(read_volume(&file, &ReadOptions::default(), &Progress::new()).unwrap());
        assert_eq!(volume.grid.orientation_letters(), letters);
        let mut scene = phantom::scene(&volume, &[(25.0, "skin", 0.0), (40.0, "skin", 0.6)], Quality::FINAL);
        scene.camera = phantom::camera(&volume, DVec3::new(0.7, 1.0, 0.3), Projection::Perspective { fov_y_deg: 25.0 });
        let image = renderer.render(&scene, [64, 64], &RenderOptions::default(), &Progress::new()).unwrap();
        assert!(image.pixels.iter().any(|p| p[3] > 0.95));
        if let Some(first) = &first {
            // The same samples on another axis order: only the filter's and the prefilter's rounding differ.
            let pairs = first.pixels.iter().flatten().zip(image.pixels.iter().flatten());
            let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 0.01, "{letters}: {worst}");
        } else {
            first = Some(image);
        }
    }
}
