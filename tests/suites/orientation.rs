//! Left is left: from every storage order to the picture.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::read::{ReadOptions, read_volume};
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::{Projection, Quality};
use fabrica_engine::volume::Volume;
use fabrica_tests::{data, phantom, renderer};
use glam::{DAffine3, DMat3, DVec3};

/// Three balls around a gray one: red to the patient's right, green to the front, blue on top.
fn marked(world_from_index: DAffine3, dims: [usize; 3]) -> Arc<Volume> {
    phantom::volume(dims, world_from_index, |p| {
        let ball = |center: DVec3, value: f64| if p.distance(center) < 4.5 { value } else { 0.0 };
        ball(DVec3::X * 11.0, 300.0)
            .max(ball(DVec3::Y * 11.0, 500.0))
            .max(ball(DVec3::Z * 11.0, 700.0))
            .max(ball(DVec3::ZERO, 900.0))
    })
}

const LOOKS: &[(f64, &str, f64)] = &[
    (199.0, "unshaded_red", 0.0),
    (200.0, "unshaded_red", 1.0),
    (400.0, "unshaded_red", 1.0),
    (400.0, "unshaded_green", 1.0),
    (600.0, "unshaded_green", 1.0),
    (600.0, "unshaded_blue", 1.0),
    (800.0, "unshaded_blue", 1.0),
    (800.0, "unshaded", 1.0),
];

const NUM_PIXELS: usize = 65;

fn look(renderer: &mut Renderer, volume: &Arc<Volume>, from: DVec3) -> FloatImage {
    let mut scene = phantom::scene(volume, LOOKS, Quality::FINAL);
    // No prefilter: the balls are sharp and unshaded.
    scene.objects[0].gradient_scale_mm = 0.0;
    scene.camera = phantom::camera(volume, from, Projection::Orthographic { height_mm: 32.5 });
    let size = [NUM_PIXELS as u32, NUM_PIXELS as u32];
    renderer.render(&scene, size, &RenderOptions::default(), &Progress::new()).unwrap()
}

/// Color channel that dominates at a place in mm from the picture's center, right and up: 'r', 'g', 'b' or '-'.
fn color_at(image: &FloatImage, right_mm: f64, up_mm: f64) -> char {
    let x = (NUM_PIXELS as f64 / 2.0 + right_mm / 0.5) as usize;
    let y = (NUM_PIXELS as f64 / 2.0 - up_mm / 0.5) as usize;
    let [r, g, b, a] = image.pixels[y * NUM_PIXELS + x];
    if a < 0.5 {
        return '-';
    }
    [(r, 'r'), (g, 'g'), (b, 'b')].into_iter().max_by(|p, q| p.0.total_cmp(&q.0)).unwrap().1
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
        let half = DVec3::splat(15.5);
        let volume = marked(DAffine3::from_mat3_translation(m, -(m * half)), [32, 32, 32]);
        assert_eq!(volume.grid.orientation_letters(), letters);
        // From the front: the patient's right is on the left of the picture.
        let front = look(&mut renderer, &volume, DVec3::Y);
        assert_eq!(color_at(&front, -11.0, 0.0), 'r', "{letters} from the front");
        assert_eq!(color_at(&front, 11.0, 0.0), '-', "{letters} from the front");
        assert_eq!(color_at(&front, 0.0, 11.0), 'b', "{letters} from the front");
        assert_eq!(color_at(&front, 0.0, 0.0), 'g', "{letters} from the front");
        // From behind, right is right.
        let back = look(&mut renderer, &volume, DVec3::NEG_Y);
        assert_eq!(color_at(&back, 11.0, 0.0), 'r', "{letters} from behind");
        // From the patient's right: the face looks to the right of the picture.
        let side = look(&mut renderer, &volume, DVec3::X);
        assert_eq!((color_at(&side, 11.0, 0.0), color_at(&side, 0.0, 11.0)), ('g', 'b'), "{letters} from the right");
        assert_eq!(color_at(&side, 0.0, 0.0), 'r', "{letters} from the right");
    }
}

#[test]
fn sheared_and_anisotropic_grids_keep_their_place() {
    let mut renderer = renderer();
    let tilted = DMat3::from_cols(DVec3::new(0.9, 0.1, 0.0), DVec3::new(0.0, 0.8, 0.35), DVec3::new(0.0, 0.0, 2.0));
    let dims = [40, 44, 20];
    let half = DVec3::from_array(dims.map(|n| (n - 1) as f64)) * 0.5;
    let volume = marked(DAffine3::from_mat3_translation(tilted, -(tilted * half)), dims);
    let front = look(&mut renderer, &volume, DVec3::Y);
    assert_eq!((color_at(&front, -11.0, 0.0), color_at(&front, 0.0, 11.0)), ('r', 'b'));
    assert_eq!(color_at(&front, 0.0, 0.0), 'g');
}

#[test]
fn a_mirrored_volume_is_noticed() {
    // Planted: the same voxels under an affine with x turned around must fail the checks above.
    let grid = DAffine3::from_translation(DVec3::splat(-15.5));
    let right = marked(grid, [32, 32, 32]);
    let mut wrong = (*right).clone();
    let mirrored = DAffine3::from_mat3_translation(axes("LAS"), DVec3::new(15.5, -15.5, -15.5));
    wrong.grid = fabrica_engine::spaces::Grid::new([32, 32, 32], mirrored).unwrap();
    let front = look(&mut renderer(), &Arc::new(wrong), DVec3::Y);
    assert_ne!(color_at(&front, -11.0, 0.0), 'r');
    assert_eq!(color_at(&front, 11.0, 0.0), 'r');
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
