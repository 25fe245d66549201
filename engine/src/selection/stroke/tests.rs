use std::sync::Arc;

use glam::{DAffine3, DMat3};

use super::*;
use crate::selection::{Edge, ValueLimit};
use crate::spaces::Grid;
use crate::volume::{Rescale, Volume, Voxels};

fn empty(dims: [usize; 3], spacing: [f64; 3]) -> Selection {
    let grid = Grid::new(dims, DAffine3::from_scale(DVec3::from_array(spacing))).unwrap();
    Selection::empty(grid, &Arc::default())
}

fn brush(radius_mm: f64) -> Brush {
    Brush { radius_mm, profile: Profile::Hard, strength: 1.0, mode: BrushMode::Paint }
}

/// Every brick, to compare.
fn all(selection: &Selection) -> Vec<u8> {
    selection.values(selection.grid().dims().map(|n| [0, n]))
}

fn painted(selection: &Selection, brush: Brush, limits: &Limits, path: &[DVec3]) -> Selection {
    let mut stroke = Stroke::new(selection, brush, limits.clone()).unwrap();
    path.iter().for_each(|point| {
        stroke.dab_to(*point);
    });
    let live = all(stroke.selection());
    let mut painted = selection.clone();
    let mut undo = stroke.finish();
    painted.swap(&mut undo);
    assert!(all(&painted) == live, "what is shown is what is left");
    let mut undone = painted.clone();
    undone.swap(&mut undo);
    assert!(undone.changed_since(selection).is_empty(), "undone to the brick");
    painted
}

#[test]
fn a_dab_is_a_ball_and_a_stroke_a_capsule() {
    for spacing in [[1.0, 1.0, 1.0], [0.5, 0.8, 1.5]] {
        let canvas = empty([96, 64, 50], spacing);
        let middle = DVec3::new(20.0, 25.0, 24.0);
        let one = painted(&canvas, brush(10.0), &Limits::default(), &[middle]);
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 1000.0;
        assert!((one.volume_ml() * 1000.0 / ball - 1.0).abs() < 0.01, "{}", one.volume_ml());
        let end = middle + DVec3::new(12.0, 3.0, 4.0);
        let both = painted(&canvas, brush(10.0), &Limits::default(), &[middle, end]);
        let capsule = ball + std::f64::consts::PI * 100.0 * 13.0;
        assert!((both.volume_ml() * 1000.0 / capsule - 1.0).abs() < 0.01, "{}", both.volume_ml());
        // However often the pointer was sampled.
        let path: Vec<DVec3> = (0..=40).map(|i| middle.lerp(end, f64::from(i) / 40.0)).collect();
        let sampled = painted(&canvas, brush(10.0), &Limits::default(), &path);
        let most = all(&sampled).iter().zip(all(&both)).map(|(a, b)| a.abs_diff(b)).max();
        assert!(most <= Some(1), "off by {most:?}");
        // There and back is there.
        assert!(all(&painted(&canvas, brush(10.0), &Limits::default(), &[middle, end, middle])) == all(&both));
    }
}

#[test]
fn strength_profile_and_mode() {
    let canvas = empty([40, 40, 40], [1.0; 3]);
    let middle = DVec3::splat(20.0);
    let none = Limits::default();
    let soft = Brush { profile: Profile::Soft, strength: 0.5, ..brush(10.0) };
    let once = painted(&canvas, soft, &none, &[middle, middle, middle]);
    assert_eq!(once.get([20, 20, 20]), 128, "dabs of one stroke do not add up");
    assert_eq!(once.get([30, 20, 20]), 0);
    assert!(once.get([25, 20, 20]) < 80 && once.get([25, 20, 20]) > 60, "half way down: {}", once.get([25, 20, 20]));
    assert_eq!(painted(&once, soft, &none, &[middle]).get([20, 20, 20]), 128);
    let build = Brush { mode: BrushMode::Build, ..soft };
    assert_eq!(painted(&once, build, &none, &[middle]).get([20, 20, 20]), 192);
    let erase = Brush { mode: BrushMode::Erase, ..soft };
    assert_eq!(painted(&once, erase, &none, &[middle]).get([20, 20, 20]), 64);
    let full = Brush { mode: BrushMode::Erase, strength: 1.0, ..brush(14.0) };
    let erased = painted(&once, full, &none, &[middle]);
    assert!(erased.is_empty() && erased.bounds().is_none() && erased.num_bytes() < 1000);
}

#[test]
fn strokes_leave_the_volume_and_what_is_no_stroke_is_refused() {
    let canvas = empty([20, 20, 20], [1.0; 3]);
    let path = [DVec3::new(-50.0, 10.0, 10.0), DVec3::new(80.0, 10.0, 10.0), DVec3::NAN, DVec3::splat(1e300)];
    let through = painted(&canvas, brush(3.0), &Limits::default(), &path[..2]);
    assert_eq!(through.bounds(), Some([[0, 20], [7, 14], [7, 14]]));
    let mut stroke = Stroke::new(&canvas, brush(3.0), Limits::default()).unwrap();
    assert!(stroke.dab_to(path[0]).is_empty() && stroke.dab_to(path[2]).is_empty());
    drop(stroke);
    assert!(painted(&canvas, brush(3.0), &Limits::default(), &[path[3]]).is_empty());
    for bad in
        [brush(0.0), brush(f64::NAN), Brush { strength: 0.0, ..brush(1.0) }, Brush { strength: 2.0, ..brush(1.0) }]
    {
        assert!(Stroke::new(&canvas, bad, Limits::default()).is_err(), "{bad:?}");
    }
    // A brush smaller than a voxel still paints the voxel that it is in.
    assert!(painted(&canvas, brush(0.5), &Limits::default(), &[DVec3::splat(10.2)]).get([10, 10, 10]) > 128);
    let tiny = painted(&empty([1, 1, 1], [1.0; 3]), brush(4.0), &Limits::default(), &[DVec3::ZERO]);
    assert_eq!((tiny.num_voxels(), tiny.bounds()), (1.0, Some([[0, 1]; 3])));
}

#[test]
fn limits_by_value_connection_and_permission() {
    let canvas = empty([32, 32, 32], [1.0; 3]);
    // Two walls, at x = 10 to 12 and at 16 to 18, of value 100; NaN in a corner of the first.
    let value = |i: usize| if matches!(i % 32, 10..13 | 16..19) { 100.0 } else { 0.0_f32 };
    let mut voxels: Vec<f32> = (0..32 * 32 * 32).map(value).collect();
    voxels[10 + 32 * (16 + 32 * 16)] = f32::NAN;
    let scan = Arc::new(Volume::new(*canvas.grid(), Voxels::F32(voxels), Rescale::IDENTITY, "").unwrap());
    let values = ValueLimit { scan, low: 50.0, high: 200.0, edge: Edge::Crisp };
    let limits = Limits { values: Some(values), ..Limits::default() };
    let middle = DVec3::new(11.0, 16.0, 16.0);
    let both = painted(&canvas, brush(8.0), &limits, &[middle]);
    assert_eq!((both.get([11, 16, 16]), both.get([16, 16, 16]), both.get([14, 16, 16])), (255, 255, 0));
    assert_eq!(both.get([10, 16, 16]), 0, "no number is in no range");
    let connected = Limits { connected: true, ..limits.clone() };
    let one = painted(&canvas, brush(8.0), &connected, &[middle]);
    assert_eq!((one.get([11, 16, 16]), one.get([16, 16, 16])), (255, 0));
    assert_eq!(one.get([12, 20, 20]), both.get([12, 20, 20]));
    // Just beside the wall, as on its surface; and far from any.
    assert_eq!(painted(&canvas, brush(8.0), &connected, &[DVec3::new(9.4, 16.0, 16.0)]).get([11, 16, 16]), 255);
    assert!(painted(&canvas, brush(8.0), &connected, &[DVec3::new(5.0, 16.0, 16.0)]).is_empty());
    // A path touches both.
    let across = painted(&canvas, brush(3.0), &connected, &[middle, DVec3::new(17.0, 16.0, 16.0)]);
    assert_eq!((across.get([11, 16, 16]), across.get([17, 16, 16]), across.get([14, 16, 16])), (255, 255, 0));
    let upper: Arc<dyn Fn([usize; 3]) -> bool + Send + Sync> = Arc::new(|[_, _, z]: [usize; 3]| z >= 16);
    let visible = Limits { allowed: Some(upper), ..limits };
    assert_eq!(painted(&canvas, brush(8.0), &visible, &[middle]).bounds().unwrap()[2], [16, 25]);
    let elsewhere = Grid::new([32; 3], DAffine3::from_mat3(DMat3::from_diagonal(DVec3::splat(2.0)))).unwrap();
    let other = Selection::empty(elsewhere, &Arc::default());
    assert!(Stroke::new(&other, brush(8.0), connected).unwrap_err().contains("another grid"));
}
