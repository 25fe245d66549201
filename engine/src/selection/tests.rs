//! What holds for all selections, by random edits and by brute force.

use glam::{DAffine3, DMat3, DVec3};

use super::*;
use crate::progress::Progress;
use crate::volume::Rescale;
use crate::volume::Voxels;

fn grid(dims: [usize; 3]) -> Grid {
    Grid::new(dims, DAffine3::from_scale(DVec3::new(0.5, 1.0, 2.0))).unwrap()
}

/// Numbers that look random.
fn noise(seed: u64) -> impl FnMut(usize) -> usize {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move |below| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % below
    }
}

fn all(selection: &Selection) -> Vec<u8> {
    selection.values(selection.grid().dims().map(|n| [0, n]))
}

/// Boxes of random memberships, overlapping.
fn random(dims: [usize; 3], pool: &Arc<BrickPool>, seed: u64) -> Selection {
    let mut next = noise(seed);
    let mut selection = Selection::empty(grid(dims), pool);
    for _ in 0..12 {
        let voxels = dims.map(|n| {
            let from = next(n);
            [from, from + 1 + next(n)]
        });
        let (value, spread) = (next(256), [0, 0, 40][next(3)]);
        selection.change(voxels, |[x, y, z], _| (value + (x * 31 + y * 17 + z * 7) % (spread + 1)).min(255) as u8);
    }
    selection
}

/// Bounds, sum and ranges of bricks from the voxels alone.
fn assert_metadata(selection: &Selection) {
    let dims = selection.grid().dims();
    let values = all(selection);
    let sum: u64 = values.iter().map(|f| u64::from(*f)).sum();
    assert!((selection.num_voxels() - sum as f64 / 255.0).abs() < 1e-9);
    assert_eq!(selection.is_empty(), sum == 0);
    let mut bounds: Option<VoxelBox> = None;
    for (i, _) in values.iter().enumerate().filter(|(_, f)| **f > 0) {
        let at = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
        bounds = Some(joined(bounds, at.map(|n| [n, n + 1])));
    }
    assert_eq!(selection.bounds(), bounds);
    for place in fill::places(dims.map(|n| [0, n])) {
        let brick = selection.brick(place);
        let inside = brick.values();
        assert_eq!(brick.range(), [*inside.iter().min().unwrap(), *inside.iter().max().unwrap()]);
        let room = selection.room(place);
        for (i, f) in inside.iter().enumerate() {
            let at = [i % BRICK, i / BRICK % BRICK, i / (BRICK * BRICK)];
            assert!(*f == 0 || (0..3).all(|a| at[a] < room[a]), "nothing is selected beyond the grid");
        }
    }
}

#[test]
fn a_thousand_edits_leave_true_metadata_and_can_all_be_taken_back() {
    let dims = [70, 33, 90];
    let pool = Arc::new(BrickPool::default());
    let progress = Progress::new();
    let mut next = noise(7);
    let mut selection = Selection::empty(grid(dims), &pool);
    let mut undo = Vec::new();
    let mut states = Vec::new();
    for i in 0..1000 {
        states.push(selection.clone());
        let at = DVec3::new(next(40) as f64, next(40) as f64, next(190) as f64);
        let diff = match next(12) {
            0 => selection.combine(&random(dims, &pool, i), Combination::Intersect).unwrap(),
            1 => selection.invert(),
            2 => selection.combine(&random(dims, &pool, i), Combination::Subtract).unwrap(),
            3 if i % 10 == 0 => selection.grow_mm(next(5) as f64 - 2.0, &progress).unwrap(),
            4 if i % 10 == 0 => selection.smooth_mm(1.0, true, &progress).unwrap(),
            5 => selection.keep_largest(2, Connectivity::Faces, &progress).unwrap(),
            6 => selection.fill_holes(Holes::InSpace, &progress).unwrap(),
            n => {
                let mode = [BrushMode::Paint, BrushMode::Build, BrushMode::Erase][n % 3];
                let brush = Brush { radius_mm: 1.0 + next(9) as f64, profile: Profile::Soft, strength: 0.9, mode };
                let mut stroke = Stroke::new(&selection, brush, Limits::default()).unwrap();
                stroke.dab_to(at);
                stroke.dab_to(at + DVec3::new(3.0, -2.0, 9.0));
                let mut diff = stroke.finish();
                selection.swap(&mut diff);
                diff
            }
        };
        undo.push(diff);
        if i % 25 == 0 {
            assert_metadata(&selection);
        }
    }
    for (mut diff, state) in undo.into_iter().zip(states).rev() {
        selection.swap(&mut diff);
        assert!(selection.changed_since(&state).is_empty(), "undone to the brick");
    }
    assert!(selection.is_empty() && selection.bricks().next().is_none());
}

#[test]
fn combinations_are_those_of_each_voxel_and_obey_their_laws() {
    use Combination::{Intersect, Replace, Subtract, Union};
    let dims = [75, 20, 66];
    let pool = Arc::new(BrickPool::default());
    let combined = |a: &Selection, b: &Selection, how| {
        let mut result = a.clone();
        result.combine(b, how).unwrap();
        assert_metadata(&result);
        result
    };
    let not = |a: &Selection| {
        let mut inverse = a.clone();
        inverse.invert();
        inverse
    };
    for seed in 1..5 {
        let [a, b, c] = [0, 10, 20].map(|n| random(dims, &pool, seed + n));
        let foreign = random(dims, &Arc::default(), seed + 10);
        for how in [Replace, Union, Intersect, Subtract] {
            let result = combined(&a, &b, how);
            let expected: Vec<u8> = all(&a).into_iter().zip(all(&b)).map(|(a, b)| how.of(a, b)).collect();
            assert!(all(&result) == expected, "{how:?}");
            assert!(all(&combined(&a, &foreign, how)) == expected, "{how:?} of another pool");
        }
        let same = |a: &Selection, b: &Selection| assert!(a.changed_since(b).is_empty());
        same(&combined(&a, &b, Union), &combined(&b, &a, Union));
        same(&combined(&a, &b, Intersect), &combined(&b, &a, Intersect));
        same(&combined(&combined(&a, &b, Union), &c, Union), &combined(&a, &combined(&b, &c, Union), Union));
        same(&combined(&a, &combined(&a, &b, Intersect), Union), &a);
        same(&combined(&a, &combined(&a, &b, Union), Intersect), &a);
        same(
            &combined(&a, &combined(&b, &c, Union), Intersect),
            &combined(&combined(&a, &b, Intersect), &combined(&a, &c, Intersect), Union),
        );
        same(&not(&combined(&a, &b, Union)), &combined(&not(&a), &not(&b), Intersect));
        same(&combined(&a, &b, Subtract), &combined(&a, &not(&b), Intersect));
        same(&not(&not(&a)), &a);
        assert_metadata(&not(&a));
        let nothing = Selection::empty(grid(dims), &pool);
        same(&combined(&a, &nothing, Union), &a);
        same(&combined(&a, &nothing, Intersect), &nothing);
        same(&combined(&nothing, &a, Subtract), &nothing);
        same(&combined(&a, &not(&nothing), Intersect), &a);
        assert!(a.clone().combine(&a, Union).unwrap().is_empty(), "what changes nothing is no change");
    }
    let (mut a, other) = (random(dims, &pool, 1), Selection::empty(grid([75, 20, 65]), &pool));
    assert!(a.clone().combine(&other, Union).unwrap_err().contains("different grids"));
    let moved = Grid::new(dims, DAffine3::from_translation(DVec3::ONE)).unwrap();
    assert!(a.combine(&Selection::empty(moved, &pool), Union).is_err());
}

#[test]
fn a_voxel_alone() {
    let progress = Progress::new();
    let mut one = Selection::empty(grid([1, 1, 1]), &Arc::default());
    one.invert();
    assert_eq!((one.num_voxels(), one.volume_ml(), one.bounds()), (1.0, 1e-3, Some([[0, 1]; 3])));
    for edit in 0..5 {
        let mut edited = one.clone();
        match edit {
            0 => edited.grow_mm(3.0, &progress),
            1 => edited.grow_mm(-3.0, &progress),
            2 => edited.smooth_mm(3.0, true, &progress),
            3 => edited.fill_holes(Holes::InSlices(2), &progress),
            _ => edited.keep_largest(1, Connectivity::Corners, &progress),
        }
        .unwrap();
        assert_eq!(edited.num_voxels(), 1.0, "edit {edit}");
    }
    one.invert();
    assert!(one.is_empty() && one.mean_of(&scan([1, 1, 1], vec![5.0])).is_none());
}

fn scan(dims: [usize; 3], values: Vec<f32>) -> Volume {
    Volume::new(grid(dims), Voxels::F32(values), Rescale::IDENTITY, "").unwrap()
}

#[test]
fn ranges_select_what_their_bounds_say() {
    let dims = [37, 30, 21];
    let mut next = noise(3);
    // Even regions, so that bricks lie wholly in and out, with noise, gaps and infinities.
    let values: Vec<f32> = (0..37 * 30 * 21)
        .map(|i| match next(90) {
            0 => f32::NAN,
            1 => f32::INFINITY,
            2 => next(1000) as f32,
            _ => {
                if i % 37 > 20 {
                    500.0
                } else {
                    100.0
                }
            }
        })
        .collect();
    let volume = scan(dims, values.clone());
    let whole = Volume::new(
        grid(dims),
        Voxels::I16(values.iter().map(|v| *v as i16).collect()),
        Rescale { slope: -2.0, intercept: 10.0 },
        "",
    )
    .unwrap();
    let (pool, progress) = (Arc::default(), Progress::new());
    for [low, high] in [
        [300.0, 800.0],
        [f64::NEG_INFINITY, 100.0],
        [500.0, f64::INFINITY],
        [90.0, 110.0],
        [2000.0, 3000.0],
        [5.0, 1.0],
        [-1e9, 1e9],
    ] {
        for edge in [Edge::Crisp, Edge::PartialVolume, Edge::Linear(60.0)] {
            for (volume, range) in [(&volume, [low, high]), (&whole, [10.0 - 2.0 * high, 10.0 - 2.0 * low])] {
                let selected = select_range(volume, range, edge, &pool, &progress).unwrap();
                for (i, f) in all(&selected).into_iter().enumerate() {
                    let value = volume.value(i % 37, i / 37 % 30, i / (37 * 30));
                    let is_in = value.is_finite() && value >= range[0] && value <= range[1];
                    assert_eq!(f >= IN, is_in, "{value} in {range:?}, {edge:?}");
                    assert!(edge != Edge::Crisp || f == 0 || f == 255);
                    assert!(value.is_finite() || f == 0);
                }
            }
        }
    }
    let all_in = select_range(&whole, [-1e9, 1e9], Edge::PartialVolume, &pool, &progress).unwrap();
    assert_eq!(all_in.num_voxels(), f64::from(37 * 30 * 21));
}

#[test]
fn steep_slopes_that_end_below_a_bound_select_nothing() {
    // Air, a skin of 0, fat: no bone, though half the way from air to skin is steeper than from skin to bone.
    let values =
        (0..20 * 8 * 8).map(|i| [-1000.0, -1000.0, -600.0, -100.0, 0.0, -50.0][(i % 20_usize).min(5)]).collect();
    let skin = scan([20, 8, 8], values);
    let bone = select_range(&skin, [150.0, 3000.0], Edge::PartialVolume, &Arc::default(), &Progress::new()).unwrap();
    assert!(bone.is_empty());
    let body = select_range(&skin, [-300.0, 3000.0], Edge::PartialVolume, &Arc::default(), &Progress::new()).unwrap();
    assert_eq!((body.get([2, 4, 4]), body.get([3, 4, 4]), body.get([4, 4, 4])), (0, 255, 255));
    let fat = select_range(&skin, [-700.0, -90.0], Edge::PartialVolume, &Arc::default(), &Progress::new()).unwrap();
    assert_eq!((fat.get([2, 4, 4]), fat.get([4, 4, 4]), fat.get([6, 4, 4])), (184, 0, 0));
}

#[test]
fn partial_volume_is_the_part_beyond_the_surface() {
    // The distance from a slanting plane, in voxels: the surface cuts voxels wherever it likes.
    let dims = [40, 40, 40];
    let grid = Grid::new(dims, DAffine3::from_mat3(DMat3::IDENTITY)).unwrap();
    let normal = DVec3::new(0.2, 0.5, 0.84).normalize();
    let value = |i: usize| {
        (100.0 * (normal.dot(DVec3::new((i % 40) as f64, (i / 40 % 40) as f64, (i / 1600) as f64)) - 29.3)) as f32
    };
    let voxels = Voxels::F32((0..64_000).map(value).collect());
    let volume = Volume::new(grid, voxels, Rescale::IDENTITY, "").unwrap();
    let half = select_range(&volume, [0.0, 1e9], Edge::PartialVolume, &Arc::default(), &Progress::new()).unwrap();
    // By counting points in every voxel.
    let fine = |x: usize| -> f64 {
        let mut inside = 0;
        for i in 0..8000 {
            let at = DVec3::new((i % 20) as f64, (i / 20 % 20) as f64, (i / 400) as f64) / 20.0 - 0.475;
            inside += usize::from(normal.dot(at + DVec3::new(x as f64, 20.0, 22.0)) >= 29.3);
        }
        inside as f64 / 8000.0
    };
    for x in 0..40 {
        let f = f64::from(half.get([x, 20, 22])) / 255.0;
        assert!((f - fine(x)).abs() < 0.1, "voxel {x}: {f} for {}", fine(x));
    }
    let mean = half.mean_of(&volume).unwrap();
    let (sum, weight) = (0..64_000).fold((0.0, 0.0), |(sum, weight), i| {
        let f = f64::from(half.get([i % 40, i / 40 % 40, i / 1600]));
        (sum + f * f64::from(value(i)), weight + f)
    });
    assert!((mean - sum / weight).abs() < 1e-6);
}

#[test]
fn histograms_count_the_voxels_that_are_in() {
    let dims = [37, 20, 21];
    let selection = random(dims, &Arc::new(BrickPool::default()), 8);
    let mut next = noise(21);
    let values: Vec<f32> =
        (0..37 * 20 * 21).map(|_| if next(50) == 0 { f32::NAN } else { next(1000) as f32 / 4.0 - 20.0 }).collect();
    let counts = selection.histogram_of(&scan(dims, values.clone()), (0.0, 200.0), 16);
    let mut expected = vec![0u64; 16];
    for (f, value) in all(&selection).into_iter().zip(values) {
        if f >= IN && value.is_finite() {
            // What is beyond the range is in the outer bins.
            expected[((value / 12.5).floor().max(0.0) as usize).min(15)] += 1;
        }
    }
    assert!(counts == expected && counts.iter().all(|n| *n > 0), "{counts:?} {expected:?}");
    assert_eq!(selection.histogram_of(&scan([4, 1, 1], vec![1.0; 4]), (0.0, 1.0), 3), [0; 3]);
    // One value is one bin.
    let constant = selection.histogram_of(&scan(dims, vec![7.0; 37 * 20 * 21]), (7.0, 7.0), 4);
    assert!(constant[0] > 0 && constant[1..] == [0; 3], "{constant:?}");
}

#[test]
fn copies_are_known_until_one_is_edited() {
    let selection = random([20, 20, 20], &Arc::new(BrickPool::default()), 3);
    let mut copy = selection.clone();
    assert!(copy.is_copy_of(&selection));
    copy.invert();
    assert!(!copy.is_copy_of(&selection));
}
