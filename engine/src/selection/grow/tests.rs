use glam::{DAffine3, DVec3};

use super::*;
use crate::spaces::Grid;
use crate::volume::Rescale;

fn scan(dims: [usize; 3], voxels: Voxels) -> Arc<Volume> {
    let grid = Grid::new(dims, DAffine3::from_scale(DVec3::ONE)).unwrap();
    Arc::new(Volume::new(grid, voxels, Rescale::IDENTITY, "").unwrap())
}

fn region(scan: &Arc<Volume>, seeds: &Seeds, tolerance: f64) -> Vec<u8> {
    let grown = select_grown(scan, seeds, tolerance, Edge::Crisp, &Arc::default(), &Progress::new()).unwrap();
    grown.values(scan.grid.dims().map(|n| [0, n]))
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

/// What hangs together with a voxel within a range, by looking at all pairs again and again.
fn flooded(values: &[i16], dims: [usize; 3], seed: usize, range: [f64; 2], most: usize) -> Vec<u8> {
    let at = |i: usize| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
    let fits = |i: usize| (range[0]..=range[1]).contains(&f64::from(values[i]));
    let mut is_in = vec![0; values.len()];
    is_in[seed] = 255;
    let mut has_changed = true;
    while has_changed {
        has_changed = false;
        for i in 0..values.len() {
            if is_in[i] == 0 && fits(i) {
                let near = (0..values.len()).any(|j| {
                    let steps: Vec<usize> = (0..3).map(|a| at(i)[a].abs_diff(at(j)[a])).collect();
                    is_in[j] > 0 && steps.iter().all(|s| *s <= 1) && steps.iter().sum::<usize>() <= most
                });
                if near {
                    is_in[i] = 255;
                    has_changed = true;
                }
            }
        }
    }
    is_in
}

#[test]
fn every_tolerance_is_a_flood_at_that_tolerance() {
    let dims = [9, 8, 7];
    for seed in 1..5 {
        let mut random = noise(seed);
        let values: Vec<i16> = (0..dims.iter().product()).map(|_| (random() % 200) as i16 - 100).collect();
        let volume = scan(dims, Voxels::I16(values.clone()));
        for (connectivity, most) in [(Connectivity::Faces, 1), (Connectivity::Corners, 3)] {
            let seeds = Seeds { connectivity, ..Seeds::at([4, 4, 3]) };
            let mut growth = Growth::new(&volume, &seeds).unwrap();
            assert_eq!(growth.step(), 1.0);
            let first = 4 + 9 * (4 + 8 * 3);
            let center = f64::from(values[first]);
            // Up, and down again without growing.
            for tolerance in [0.0, 20.0, 47.0, 80.0, 200.0, 60.0, 33.0] {
                assert!(growth.grow(tolerance, usize::MAX, &Progress::new()).unwrap());
                let grown = growth.region(tolerance, Edge::Crisp, &Arc::default(), &Progress::new()).unwrap();
                let expected = flooded(&values, dims, first, [center - tolerance, center + tolerance], most);
                assert!(grown.values(dims.map(|n| [0, n])) == expected, "seed {seed}, tolerance {tolerance}");
                let num = expected.iter().filter(|v| **v > 0).count() as u64;
                assert_eq!(growth.num_voxels(tolerance), num);
                assert_eq!(growth.share(tolerance), num as f64 / 504.0);
            }
        }
    }
}

#[test]
fn growing_in_steps_is_growing_at_once() {
    let dims = [20, 17, 12];
    let mut random = noise(9);
    let voxels = Voxels::F32((0..dims.iter().product()).map(|_| (random() % 1000) as f32 * 0.37).collect());
    let volume = scan(dims, voxels);
    let seeds = Seeds { barred: vec![[0, 0, 0], [19, 16, 11]], ..Seeds::at([10, 8, 6]) };
    let whole = region(&volume, &seeds, 150.0);
    let mut growth = Growth::new(&volume, &seeds).unwrap();
    let mut last = 0;
    while !growth.grow(150.0, 37, &Progress::new()).unwrap() {
        assert!(growth.num_voxels(150.0) >= last, "it only grows");
        last = growth.num_voxels(150.0);
    }
    let grown = growth.region(150.0, Edge::Crisp, &Arc::default(), &Progress::new()).unwrap();
    assert!(grown.values(dims.map(|n| [0, n])) == whole);
    let progress = Progress::new();
    progress.cancel();
    let mut stopped = Growth::new(&volume, &seeds).unwrap();
    assert!(matches!(stopped.grow(150.0, usize::MAX, &progress), Err(Error::Cancelled)));
    assert!(
        stopped.grow(150.0, usize::MAX, &Progress::new()).unwrap()
            && stopped.num_voxels(150.0) == growth.num_voxels(150.0)
    );
}

#[test]
fn barred_seeds_share_what_seeds_would_have() {
    // Two rooms of 100 with a door of 90 between them.
    let dims = [21, 5, 5];
    let value = |i: usize| match i % 21 {
        10 if i / 21 == 12 => 90,
        10 => 0,
        _ => 100,
    };
    let volume = scan(dims, Voxels::I16((0..21 * 25).map(value).collect()));
    let left = Seeds::at([3, 2, 2]);
    assert_eq!(region(&volume, &left, 9.0).iter().filter(|f| **f > 0).count(), 250);
    assert_eq!(region(&volume, &left, 10.0).iter().filter(|f| **f > 0).count(), 501, "through the door");
    let barred = Seeds { barred: vec![[17, 2, 2]], ..left.clone() };
    let kept = region(&volume, &barred, 10.0);
    assert!(kept.iter().enumerate().all(|(i, f)| *f == 0 || i % 21 <= 10), "the other room is barred");
    assert!(kept.iter().enumerate().all(|(i, f)| *f > 0 || i % 21 >= 10), "this room is not");
    let mut growth = Growth::new(&volume, &left).unwrap();
    growth.grow(100.0, usize::MAX, &Progress::new()).unwrap();
    assert_eq!(growth.leak(50.0), Some((10.0, [250, 501])));
    // Both seeds, or a range.
    let range = Seeds { within: Some([90.0, 110.0]), ..left.clone() };
    assert_eq!(region(&volume, &range, 0.0).iter().filter(|f| **f > 0).count(), 501);
    let both = Seeds { seeds: vec![[3, 2, 2], [10, 2, 2]], ..left };
    assert_eq!(region(&volume, &both, 0.0).iter().filter(|f| **f > 0).count(), 501);
}

#[test]
fn edges_are_soft_and_gaps_are_never_reached() {
    let dims = [16, 9, 9];
    // A ramp from 0 to 150; a wall of no numbers at x = 12, and what is behind it.
    let value = |i: usize| if i % 16 == 12 { f32::NAN } else { (i % 16) as f32 * 10.0 };
    let volume = scan(dims, Voxels::F32((0..16 * 81).map(value).collect()));
    let seeds = Seeds::at([4, 4, 4]);
    let soft = select_grown(&volume, &seeds, 31.0, Edge::PartialVolume, &Arc::default(), &Progress::new()).unwrap();
    let row: Vec<u8> = (0..16).map(|x| soft.get([x, 4, 4])).collect();
    // The surface lies at values 9 and 71: 0.1 voxels beyond the centers of voxels 1 and 7.
    assert_eq!(row[1..8], [153, 255, 255, 255, 255, 255, 153]);
    assert_eq!((row[0], row[8]), (0, 0));
    let softer = select_grown(&volume, &seeds, 37.0, Edge::PartialVolume, &Arc::default(), &Progress::new()).unwrap();
    assert_eq!([softer.get([0, 4, 4]), softer.get([1, 4, 4]), softer.get([8, 4, 4])], [51, 255, 51]);
    let all = region(&volume, &seeds, 1e9);
    assert_eq!(all.iter().filter(|f| **f > 0).count(), 12 * 81, "not through the gap");
    assert!(Growth::new(&volume, &Seeds::at([12, 0, 0])).unwrap_err().contains("no value at the seed"));
    assert!(Growth::new(&volume, &Seeds::at([16, 0, 0])).unwrap_err().contains("outside of the scan"));
    assert!(Growth::new(&volume, &Seeds { seeds: vec![], ..seeds.clone() }).unwrap_err().contains("no seed"));
    let backwards = Seeds { within: Some([2.0, 1.0]), ..seeds };
    assert!(Growth::new(&volume, &backwards).unwrap_err().contains("no value lies"));
    let one = scan([1, 1, 1], Voxels::U8(vec![7]));
    assert_eq!(region(&one, &Seeds::at([0, 0, 0]), 0.0), [255]);
}
