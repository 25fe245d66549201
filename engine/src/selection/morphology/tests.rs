use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::*;
use crate::selection::{Connectivity, IN, Limits, Shape};
use crate::spaces::Grid;

fn grid(dims: [usize; 3], spacing: [f64; 3], shear: f64) -> Grid {
    let mut matrix3 = DMat3::from_diagonal(DVec3::from_array(spacing));
    matrix3.z_axis.y = shear * spacing[2];
    Grid::new(dims, DAffine3 { matrix3, translation: DVec3::new(-20.0, 5.0, 3.0) }).unwrap()
}

fn ball(grid: &Grid, index: DVec3, radius_mm: f64) -> Selection {
    let center = grid.world_from_index().transform_point3(index);
    Shape::ball(center, radius_mm).select(grid, &Limits::default(), &Arc::default(), &Progress::new()).unwrap()
}

fn ball_ml(radius_mm: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius_mm.powi(3) * 1e-3
}

/// Numbers that look random.
fn noise(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    }
}

#[test]
fn a_ball_that_grows_or_shrinks_is_a_ball() {
    let progress = Progress::new();
    for (dims, spacing, shear) in [
        ([64, 64, 64], [1.0, 1.0, 1.0], 0.0),
        ([110, 80, 33], [0.6, 0.8, 2.0], 0.0),
        ([64, 76, 44], [1.0, 1.0, 1.5], 0.35),
    ] {
        let grid = grid(dims, spacing, shear);
        let index = DVec3::from_array(dims.map(|n| n as f64 / 2.0 - 0.3));
        let before = ball(&grid, index, 14.0);
        for mm in [-8.0, -3.0, -0.4, 0.0, 0.7, 2.0, 6.0] {
            let mut moved = before.clone();
            let mut undo = moved.grow_mm(mm, &progress).unwrap();
            let ratio = moved.volume_ml() / ball_ml(14.0 + mm);
            let off_mm = (ratio.cbrt() - 1.0).abs() * (14.0 + mm);
            assert!(off_mm < 0.04, "{mm} mm at spacing {spacing:?}, shear {shear}: {off_mm} mm off");
            assert!((ratio - 1.0).abs() < 0.01, "{mm} mm at spacing {spacing:?}, shear {shear}: {ratio}");
            // And round: no voxel is far from what the ball of that size has.
            let expected = ball(&grid, index, 14.0 + mm);
            let all = dims.map(|n| [0, n]);
            let worst = moved.values(all).iter().zip(expected.values(all)).map(|(a, b)| a.abs_diff(b)).max();
            assert!(worst.unwrap() < 100, "{mm} mm at spacing {spacing:?}, shear {shear}: off by {worst:?}");
            moved.swap(&mut undo);
            assert!(moved.changed_since(&before).is_empty());
        }
    }
}

#[test]
fn distances_are_those_of_brute_force() {
    // A random crisp selection: the surface lies half way to each neighbor.
    let dims = [14, 11, 9];
    for (seed, spacing, shear) in [(1, [1.0, 1.0, 1.0], 0.0), (2, [1.0, 0.7, 1.6], 0.0), (3, [1.0, 1.0, 1.0], 0.4)] {
        let grid = grid(dims, spacing, shear);
        let mut random = noise(seed);
        let is_in: Vec<bool> = (0..grid.num_voxels()).map(|_| random().is_multiple_of(40)).collect();
        let mut selection = Selection::empty(grid, &Arc::default());
        let index = |[x, y, z]: [usize; 3]| x + dims[0] * (y + dims[1] * z);
        selection.change(dims.map(|n| [0, n]), |v, _| if is_in[index(v)] { 255 } else { 0 });
        let voxels: Vec<[usize; 3]> =
            (0..grid.num_voxels()).map(|i| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])]).collect();
        let place = |v: &[usize; 3]| grid.world_from_index().transform_point3(DVec3::from_array(v.map(|n| n as f64)));
        let mut moved = selection.clone();
        let mm = 2.6;
        moved.grow_mm(mm, &Progress::new()).unwrap();
        let (mut num_wrong, mut worst) = (0, 0.0_f64);
        for voxel in voxels.iter().filter(|v| !is_in[index(**v)]) {
            // Lone voxels are octahedra between half a voxel and a voxel's diagonal wide: to their centers, less that.
            let centers = voxels.iter().filter(|v| is_in[index(**v)]).map(|v| (place(v) - place(voxel)).length());
            let nearest = centers.fold(f64::INFINITY, f64::min);
            let f = moved.get(*voxel);
            let least = 0.5 * spacing.iter().fold(f64::INFINITY, |a, b| a.min(*b)) / 3_f64.sqrt();
            let most = 0.5 * spacing.iter().fold(0.0_f64, |a, b| a.max(*b)) * 1.8;
            if nearest - most > mm + 1.0 && f > 0 || nearest - least < mm - 1.0 && f < 255 {
                num_wrong += 1;
                worst = worst.max((nearest - mm).abs());
            }
        }
        assert_eq!(num_wrong, 0, "seed {seed}: up to {worst} mm off");
    }
}

#[test]
fn what_the_grid_cuts_off_is_not_eaten_from_there() {
    let grid = grid([20, 20, 20], [1.0; 3], 0.0);
    let mut selection = Selection::empty(grid, &Arc::default());
    // The lower half of the grid, to its faces.
    selection.change([[0, 20], [0, 20], [0, 10]], |_, _| 255);
    selection.grow_mm(-3.0, &Progress::new()).unwrap();
    assert_eq!((selection.bounds(), selection.num_voxels()), (Some([[0, 20], [0, 20], [0, 7]]), 2800.0));
    selection.grow_mm(5.5, &Progress::new()).unwrap();
    assert_eq!(selection.num_voxels(), 12.5 * 400.0 + 400.0 * 0.5 / 255.0, "half a slice, rounded up");
    selection.smooth_mm(2.0, true, &Progress::new()).unwrap();
    assert!((selection.num_voxels() - 5000.0).abs() < 30.0, "{}", selection.num_voxels());
    let mut all = Selection::empty(grid, &Arc::default());
    assert!(all.grow_mm(5.0, &Progress::new()).unwrap().is_empty(), "nothing grows from nothing");
    all.invert();
    for mm in [-100.0, 100.0, 0.0] {
        assert!(all.grow_mm(mm, &Progress::new()).unwrap().is_empty(), "without a surface nothing moves");
    }
    assert!(all.smooth_mm(3.0, true, &Progress::new()).unwrap().is_empty());
    assert!(all.grow_mm(f64::NAN, &Progress::new()).is_err() && all.smooth_mm(-1.0, true, &Progress::new()).is_err());
    let mut speck = ball(&grid, DVec3::splat(9.0), 2.0);
    speck.grow_mm(-5.0, &Progress::new()).unwrap();
    assert!(speck.is_empty());
    // Farther than the grid reaches.
    let mut speck = ball(&grid, DVec3::splat(9.0), 2.0);
    speck.grow_mm(500.0, &Progress::new()).unwrap();
    assert_eq!(speck.num_voxels(), 8000.0);
}

#[test]
fn smoothing_keeps_the_volume_and_takes_stairs_away() {
    let grid = grid([70, 60, 40], [0.8, 0.8, 1.6], 0.0);
    let mut selection = ball(&grid, DVec3::new(34.0, 30.0, 20.0), 15.0);
    // Crisp, as label maps are, with specks.
    let mut random = noise(5);
    let specks: Vec<bool> = (0..grid.num_voxels()).map(|_| random().is_multiple_of(300)).collect();
    selection.change(
        [[0, 70], [0, 60], [0, 40]],
        |[x, y, z], f| {
            if (f >= IN) != specks[x + 70 * (y + 60 * z)] { 255 } else { 0 }
        },
    );
    let before = selection.num_voxels();
    let mut plain = selection.clone();
    plain.smooth_mm(1.6, false, &Progress::new()).unwrap();
    assert!((plain.num_voxels() / before - 1.0).abs() < 0.02, "{} of {before}", plain.num_voxels());
    let mut undo = selection.smooth_mm(1.6, true, &Progress::new()).unwrap();
    assert!((selection.num_voxels() / before - 1.0).abs() < 0.005, "{} of {before}", selection.num_voxels());
    let expected = ball(&grid, DVec3::new(34.0, 30.0, 20.0), 15.0);
    let all = [[0, 70], [0, 60], [0, 40]];
    let off = |s: &Selection| -> f64 {
        let pairs = s.values(all).into_iter().zip(expected.values(all));
        pairs.map(|(a, b)| f64::from(a.abs_diff(b)) / 255.0).sum::<f64>()
    };
    let after = off(&selection);
    selection.swap(&mut undo);
    assert!(after < 0.4 * off(&selection), "{after} of {}", off(&selection));
}

#[test]
fn holes_are_filled_and_tubes_are_not() {
    let grid = grid([40, 40, 40], [1.0; 3], 0.0);
    let shell = |outer: f64, inner: f64, index: DVec3| {
        let mut shell = ball(&grid, index, outer);
        shell.combine(&ball(&grid, index, inner), crate::selection::Combination::Subtract).unwrap();
        shell
    };
    let mut closed = shell(15.0, 10.0, DVec3::splat(19.4));
    let solid = ball(&grid, DVec3::splat(19.4), 15.0);
    let mut open = closed.clone();
    let mut undo = closed.fill_holes(Holes::InSpace, &Progress::new()).unwrap();
    assert!(closed.values([[0, 40]; 3]) == solid.values([[0, 40]; 3]), "soft inner borders are gone too");
    closed.swap(&mut undo);
    assert!(closed.changed_since(&open).is_empty());
    // With a way out along z there is no hole in space, but one in every slice across z that the way does not cut.
    open.change([[18, 21], [18, 21], [0, 40]], |_, _| 0);
    assert!(open.clone().fill_holes(Holes::InSpace, &Progress::new()).unwrap().is_empty());
    let mut across = open.clone();
    across.fill_holes(Holes::InSlices(2), &Progress::new()).unwrap();
    assert_eq!((across.get([19, 19, 19]), across.get([19, 19, 6])), (255, 255));
    let mut along = open.clone();
    along.fill_holes(Holes::InSlices(0), &Progress::new()).unwrap();
    assert_eq!((along.get([14, 19, 19]), along.get([19, 19, 19])), (255, 0));
    // A bowl at the face of the grid is open.
    let mut bowl = shell(15.0, 10.0, DVec3::new(19.4, 19.4, 0.0));
    assert!(bowl.fill_holes(Holes::InSpace, &Progress::new()).unwrap().is_empty());
    assert!(Selection::empty(grid, &Arc::default()).fill_holes(Holes::InSpace, &Progress::new()).unwrap().is_empty());
}

#[test]
fn islands_by_size() {
    let grid = grid([60, 40, 30], [1.0, 1.0, 1.0], 0.0);
    let mut all = Selection::empty(grid, &Arc::default());
    let balls = [(12.0, 8.0), (34.0, 10.0), (52.0, 5.0)].map(|(x, r)| ball(&grid, DVec3::new(x, 18.0, 15.0), r));
    for part in &balls {
        all.combine(part, crate::selection::Combination::Union).unwrap();
    }
    // Two voxels that share a corner only, and a soft cloud around nothing.
    all.change([[2, 3], [35, 36], [3, 4]], |_, _| 255);
    all.change([[3, 4], [36, 37], [4, 5]], |_, _| 255);
    all.change([[50, 55], [35, 38], [24, 28]], |_, _| 60);
    let islands = Islands::of(&all, Connectivity::Faces, &Progress::new()).unwrap();
    assert_eq!((islands.len(), Islands::of(&all, Connectivity::Corners, &Progress::new()).unwrap().len()), (5, 4));
    let volumes = islands.volumes_ml();
    assert!(volumes.windows(2).all(|v| v[0] >= v[1]) && (volumes[0] - balls[1].volume_ml()).abs() < 1e-9);
    assert_eq!((islands.at([34, 18, 15]), islands.at([12, 18, 15]), islands.at([22, 18, 2])), (Some(0), Some(1), None));
    assert_eq!((islands.at([52, 36, 26]), islands.at([0, 0, 0])), (None, None));
    let parts = islands.split(3);
    let whole = [[0, 60], [0, 40], [0, 30]];
    for (part, expected) in parts.iter().zip([&balls[1], &balls[0], &balls[2]]) {
        assert!(part.values(whole) == expected.values(whole), "with its soft border");
    }
    let mut largest = all.clone();
    let mut undo = largest.keep_largest(2, Connectivity::Faces, &Progress::new()).unwrap();
    assert!((largest.volume_ml() - volumes[0] - volumes[1]).abs() < 1e-9);
    largest.swap(&mut undo);
    assert!(largest.changed_since(&all).is_empty());
    largest.remove_smaller(0.3, Connectivity::Faces, &Progress::new()).unwrap();
    assert!((largest.volume_ml() - volumes[..3].iter().sum::<f64>()).abs() < 1e-9);
    let none = Selection::empty(grid, &Arc::default());
    assert!(Islands::of(&none, Connectivity::Faces, &Progress::new()).unwrap().is_empty());
}

#[test]
fn components_are_those_of_a_flood() {
    let dims = [17, 13, 10];
    for seed in 1..6 {
        let grid = grid(dims, [1.0; 3], 0.0);
        let mut random = noise(seed);
        let f: Vec<u8> = (0..grid.num_voxels()).map(|_| if random().is_multiple_of(3) { 255 } else { 0 }).collect();
        let mut selection = Selection::empty(grid, &Arc::default());
        let index = |[x, y, z]: [usize; 3]| x + dims[0] * (y + dims[1] * z);
        selection.change(dims.map(|n| [0, n]), |v, _| f[index(v)]);
        for (connectivity, most) in [(Connectivity::Faces, 1), (Connectivity::Corners, 3)] {
            let islands = Islands::of(&selection, connectivity, &Progress::new()).unwrap();
            let mut flooded = vec![None; f.len()];
            let mut num = 0;
            for first in 0..f.len() {
                if f[first] == 0 || flooded[first].is_some() {
                    continue;
                }
                let mut queue = vec![first];
                flooded[first] = Some(num);
                while let Some(i) = queue.pop() {
                    let at = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
                    for j in 0..f.len() {
                        let to = [j % dims[0], j / dims[0] % dims[1], j / (dims[0] * dims[1])];
                        let steps: Vec<usize> = (0..3).map(|a| at[a].abs_diff(to[a])).collect();
                        let touches = steps.iter().all(|s| *s <= 1) && steps.iter().sum::<usize>() <= most;
                        if touches && f[j] > 0 && flooded[j].is_none() {
                            flooded[j] = Some(num);
                            queue.push(j);
                        }
                    }
                }
                num += 1;
            }
            assert_eq!(islands.len(), num);
            for i in 0..f.len() {
                let at = |i: usize| islands.at([i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])]);
                assert_eq!(at(i).is_some(), flooded[i].is_some());
                assert_eq!(at(i) == at(i.saturating_sub(1)), flooded[i] == flooded[i.saturating_sub(1)]);
            }
        }
    }
}
