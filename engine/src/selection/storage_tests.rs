//! What selections are made of: bricks, their sharing and their metadata.

use glam::{DAffine3, DVec3};

use super::*;

fn empty(dims: [usize; 3]) -> Selection {
    let grid = Grid::new(dims, DAffine3::from_scale(DVec3::new(0.5, 1.0, 2.0))).unwrap();
    Selection::empty(grid, &Arc::new(BrickPool::default()))
}

fn whole(selection: &Selection) -> VoxelBox {
    selection.grid().dims().map(|n| [0, n])
}

/// Every voxel, by the slow way.
fn voxels(selection: &Selection) -> Vec<u8> {
    let [nx, ny, nz] = selection.grid().dims();
    (0..nx * ny * nz).map(|i| selection.get([i % nx, i / nx % ny, i / (nx * ny)])).collect()
}

#[test]
fn an_edit_is_what_it_says_and_can_be_taken_back() {
    let mut selection = empty([70, 9, 17]);
    assert!(selection.is_empty() && selection.bounds().is_none());
    let ramp = |[x, y, z]: [usize; 3], _: u8| (x + 3 * y + 5 * z) as u8;
    let undo = selection.change([[2, 69], [3, 9], [4, 500]], ramp);
    let before = selection.clone();
    let mut expected = vec![0; 70 * 9 * 17];
    for (x, y, z) in (4..17).flat_map(|z| (3..9).flat_map(move |y| (2..69).map(move |x| (x, y, z)))) {
        expected[x + 70 * (y + 9 * z)] = ramp([x, y, z], 0);
    }
    assert_eq!(voxels(&selection), expected);
    assert_eq!(selection.bounds(), Some([[2, 69], [3, 9], [4, 17]]));
    let sum: f64 = expected.iter().map(|v| f64::from(*v) / 255.0).sum();
    assert!((selection.num_voxels() - sum).abs() < 1e-9 && (selection.volume_ml() - sum * 1e-3).abs() < 1e-12);

    // A second edit of one corner touches its bricks only, and the copy keeps what it had.
    let mut second = selection.change([[0, 3], [0, 4], [0, 5]], |_, _| 255);
    assert_eq!(second.places().collect::<Vec<_>>(), [[0, 0, 0]]);
    assert_eq!(selection.changed_since(&before), [[0, 0, 0]]);
    assert_eq!(voxels(&before), expected);
    selection.swap(&mut second);
    assert_eq!(voxels(&selection), expected);
    assert!(selection.changed_since(&before).is_empty());
    selection.swap(&mut second);
    assert_eq!(selection.get([0, 0, 0]), 255);
    selection.swap(&mut second);
    let mut first = undo;
    selection.swap(&mut first);
    assert!(selection.is_empty() && selection.bounds().is_none() && selection.bricks().next().is_none());
}

#[test]
fn equal_bricks_are_in_memory_once() {
    let mut selection = empty([64, 64, 64]);
    // The same slope in each of 512 bricks.
    selection.change(whole(&selection), |[x, y, z], _| ((x % 8) * 30 + y % 8 + z % 8) as u8);
    let Brick::Voxels(first) = selection.brick([0, 0, 0]) else { panic!("uniform") };
    assert!(selection.bricks().all(|(_, b)| matches!(b, Brick::Voxels(v) if Arc::ptr_eq(v, first))));
    assert_eq!(selection.pool().num_bricks(), 1);
    // Bricks that nobody has any more are forgotten.
    selection.change(whole(&selection), |_, _| 9);
    assert!(selection.bricks().all(|(_, b)| matches!(b, Brick::Uniform(9))));
    assert_eq!(selection.pool().num_bricks(), 0);
}

#[test]
fn beyond_the_grid_nothing_is_selected() {
    let mut selection = empty([9, 9, 9]);
    selection.change([[0, 99], [0, 99], [0, 99]], |_, _| 255);
    assert_eq!(selection.bounds(), Some([[0, 9]; 3]));
    assert_eq!(selection.num_voxels(), 729.0);
    assert!(selection.change([[5, 5], [0, 9], [0, 9]], |_, _| 0).is_empty());
    assert!(selection.change([[0, 9]; 3], |_, old| old).is_empty(), "what changes nothing is no change");
}
