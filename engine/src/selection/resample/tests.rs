use glam::{DAffine3, DMat3};

use super::*;
use crate::selection::{Limits, Shape};

fn grid(dims: [usize; 3], spacing: f64, origin: f64) -> Grid {
    let affine = DAffine3 { matrix3: DMat3::from_diagonal(DVec3::splat(spacing)), translation: DVec3::splat(origin) };
    Grid::new(dims, affine).unwrap()
}

#[test]
fn sizes_survive_finer_and_coarser_grids() {
    let (pool, progress) = (Arc::default(), Progress::new());
    let fine = grid([64; 3], 1.0, 0.0);
    let ball = Shape::ball(DVec3::splat(31.3), 20.0).select(&fine, &Limits::default(), &pool, &progress).unwrap();
    for (spacing, n) in [(0.7, 91), (1.0, 60), (2.3, 28), (5.0, 14)] {
        let other = grid([n; 3], spacing, 0.2);
        let (resampled, note) = ball.resampled_to(&other, &pool, &progress).unwrap();
        let ratio = resampled.volume_ml() / ball.volume_ml();
        assert!((ratio - 1.0).abs() < 0.01, "spacing {spacing}: {ratio}");
        assert_eq!(note.is_some(), spacing > 2.0 || (ratio - 1.0).abs() >= 1e-3, "{note:?}");
    }
}

#[test]
fn the_same_voxels_in_another_order_are_copied() {
    let (pool, progress) = (Arc::default(), Progress::new());
    let one = grid([20, 12, 9], 1.0, 0.0);
    let selection =
        Shape::ball(DVec3::new(9.0, 5.0, 4.0), 5.0).select(&one, &Limits::default(), &pool, &progress).unwrap();
    // x from right to left, y and z swapped.
    let matrix3 = DMat3::from_cols(DVec3::NEG_X, DVec3::Z, DVec3::Y);
    let turned = Grid::new([20, 9, 12], DAffine3 { matrix3, translation: DVec3::new(19.0, 0.0, 0.0) }).unwrap();
    let (resampled, note) = selection.resampled_to(&turned, &pool, &progress).unwrap();
    assert!(note.is_none() && resampled.num_voxels() == selection.num_voxels());
    for i in 0..20 * 12 * 9 {
        let [x, y, z] = [i % 20, i / 20 % 12, i / 240];
        assert_eq!(resampled.get([19 - x, z, y]), selection.get([x, y, z]));
    }
    let (same, note) = selection.resampled_to(&one, &pool, &progress).unwrap();
    assert!(note.is_none() && same.changed_since(&selection).is_empty(), "of one pool, not even a brick is new");
    let far = grid([5; 3], 1.0, 500.0);
    assert!(selection.resampled_to(&far, &pool, &progress).unwrap_err().to_string().contains("outside of the grid"));
    let nothing = Selection::empty(one, &pool);
    assert!(nothing.resampled_to(&far, &pool, &progress).unwrap().0.is_empty());
}
