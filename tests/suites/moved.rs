//! Moved regions: the raycaster against the f64 reference, what their poses and meetings must do, and the extremes.

use std::sync::Arc;

use fabrica_engine::measure::Difference;
use fabrica_engine::pass::raycast::ShaderPatch;
use fabrica_engine::render::{FloatImage, Renderer};
use fabrica_engine::scene::moved::{STRENGTH_SIZE, Strength};
use fabrica_engine::scene::{Look, Meeting, Meetings, Moved, Projection, Quality, Scene};
use fabrica_engine::volume::Volume;
use fabrica_tests::phantom::{self, add, ball, function, lumpy, selection};
use fabrica_tests::renderer;
use fabrica_tests::twin::{self};
use glam::{DAffine3, DQuat, DVec3};

const SIZE: [u32; 2] = [48, 40];

const BODY: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: &[(f64, &str, f64)] = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.1)];
const SOLID: &[(f64, &str, f64)] = &[(250.0, "clay", 0.0), (350.0, "steel", 0.8)];
const THIN: &[(f64, &str, f64)] = &[(100.0, "clay", 0.001), (900.0, "cool_warm", 0.02)];

fn draw(renderer: &mut Renderer, scene: &Scene) -> FloatImage {
    twin::draw(renderer, scene, SIZE)
}

fn compare(renderer: &mut Renderer, scene: &Scene) -> Result<Difference, String> {
    twin::compare(renderer, scene, SIZE)
}

fn notices(scene: &Scene, name: &str, patch: ShaderPatch) {
    twin::notices(scene, SIZE, name, patch);
}

/// Turned around its middle and shifted.
fn pose(center: DVec3, shift: DVec3, scale: f64) -> DAffine3 {
    let turn = DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.7);
    let to_center = DAffine3::from_translation(-center);
    DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, center + shift) * to_center
}

/// Moves the last region; `ghost`: the nodes of its ghost's look.
fn move_last(scene: &mut Scene, pose: DAffine3, ghost: &[(f64, &str, f64)], meetings: Meetings) {
    let ghost = Look { opacity: 0.8, tint: Some([0.9, 0.4, 0.4]), ..Look::plain(function(scene, ghost, 1.5)) };
    let moved = Moved { pose, ghost, meetings };
    scene.objects[0].regions.last_mut().unwrap().moved = Some(moved);
}

fn meetings() -> Meetings {
    let cells = (0..STRENGTH_SIZE * STRENGTH_SIZE).map(|i| (i % STRENGTH_SIZE * 4) as u8);
    Meetings {
        ghost: Some(Meeting { color: [0.1, 0.3, 1.0], strength: None }),
        background: Some(Meeting { color: [1.0, 0.8, 0.1], strength: Strength::new(cells.collect()).map(Arc::new) }),
    }
}

/// A body with a fuzzy ball that was moved so that it half overlaps where it was, and half sticks out; beside it a region at rest.
fn taken(volume: &Arc<Volume>, nodes: &[(f64, &str, f64)], quality: Quality, meetings: Meetings) -> Scene {
    let mut scene = phantom::scene(volume, nodes, quality);
    let (pool, grid) = (Arc::default(), &volume.grid);
    let corner = selection(grid, &pool, |p| f64::from(u8::from(p.z > 6.0)));
    add(&mut scene, corner, VEIL, 2.0, Some([0.2, 0.6, 0.9]), 0.7);
    let center = DVec3::new(-4.0, 3.0, 1.0);
    add(&mut scene, selection(grid, &pool, |p| ball(p, center, 7.0)), SOLID, 1.0, None, 0.9);
    move_last(&mut scene, pose(center, DVec3::new(-7.0, 6.0, 3.0), 1.0), THIN, meetings);
    scene
}

#[test]
fn a_moved_selection_draws_what_the_equations_say() {
    let mut renderer = renderer();
    for nodes in [BODY, VEIL, THIN] {
        for (quality, met) in [
            (Quality::DRAFT, Meetings::default()),
            (Quality::STANDARD, Meetings::default()),
            (Quality::STANDARD, meetings()),
            (Quality::FINAL, meetings()),
        ] {
            for projection in
                [Projection::Perspective { fov_y_deg: 20.0 }, Projection::Orthographic { height_mm: 48.0 }]
            {
                let volume = lumpy();
                let mut scene = taken(&volume, nodes, quality, met.clone());
                scene.camera = phantom::camera(&volume, DVec3::new(-0.7, 0.5, 0.4), projection);
                let found = compare(&mut renderer, &scene);
                println!("{} {quality:?} {projection:?} {}: {found:?}", nodes[0].1, met.ghost.is_some());
                found.unwrap();
            }
        }
    }
}
