use glam::{DAffine3, DMat3};

use super::*;

fn grid(dims: [usize; 3], spacing: f64) -> Grid {
    let affine =
        DAffine3 { matrix3: DMat3::from_diagonal(DVec3::splat(spacing)), translation: DVec3::new(-20.0, -30.0, 5.0) };
    Grid::new(dims, affine).unwrap()
}

fn circle(center: DVec2, radius: f64, n: usize) -> Vec<DVec2> {
    (0..n).map(|i| center + radius * DVec2::from_angle(std::f64::consts::TAU * i as f64 / n as f64)).collect()
}

fn select(lasso: &Lasso<'_>, grid: &Grid) -> Selection {
    lasso.select(grid, &Limits::default(), &Arc::default(), &Progress::new()).unwrap()
}

#[test]
fn a_prism_of_a_parallel_view() {
    let grid = grid([80, 70, 30], 0.5);
    // 8 pixels per mm, from above.
    let view = |at: DVec3| Some(DVec3::new(8.0 * at.x + 400.0, -8.0 * at.y + 100.0, at.z));
    let middle = view(grid.world_from_index().transform_point3(DVec3::new(40.0, 35.0, 0.0))).unwrap().truncate();
    let lasso = Lasso { polygon: circle(middle, 96.0, 200), screen_from_world: &view, depth: None };
    let cylinder = select(&lasso, &grid);
    let expected = std::f64::consts::PI * 144.0 * 15.0;
    assert!((cylinder.volume_ml() * 1000.0 / expected - 1.0).abs() < 0.005, "{}", cylinder.volume_ml());
    assert_eq!(cylinder.get([40, 35, 0]), 255);
    assert!(matches!(cylinder.brick([5, 4, 1]), super::super::Brick::Uniform(255)));
    // Every voxel is what its place says.
    for (x, y) in (0..80).flat_map(|x| (0..70).map(move |y| (x, y))) {
        let mm = 0.5 * DVec2::new(x as f64 - 40.0, y as f64 - 35.0).length();
        let expected = quantized(0.5 + (12.0 - mm) / 0.5);
        assert!(cylinder.get([x, y, 13]).abs_diff(expected) < 9, "{x} {y}: {}", cylinder.get([x, y, 13]));
    }
    // Of a first surface a layer only: here everything above a slope.
    let depth = |pixel: DVec2| (pixel.x >= middle.x).then_some([8.0, 10.0]);
    let half = select(&Lasso { depth: Some(&depth), ..lasso }, &grid);
    assert_eq!(half.bounds().map(|b| (b[0][0], b[2])), Some((40, [6, 11])), "z from 8 to 10 mm");
}

#[test]
fn a_cone_of_a_perspective_view() {
    let grid = grid([90, 110, 60], 0.5);
    // The eye 60 mm above the grid's middle, looking down; 500 pixels per unit of the slope.
    let eye = grid.world_from_index().transform_point3(DVec3::new(45.0, 55.0, 180.0));
    let matrix = DMat4::from_cols_array_2d(&[
        [500.0, 0.0, 0.0, 0.0],
        [0.0, 500.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, -1.0],
        [-500.0 * eye.x, -500.0 * eye.y, 0.0, eye.z],
    ]);
    let view = projection(matrix);
    let lasso = Lasso { polygon: circle(DVec2::ZERO, 70.0, 100), screen_from_world: &view, depth: None };
    let cone = select(&lasso, &grid);
    let slope: f64 = 70.0 / 500.0;
    let [near, far] = [60.0 - 0.0 + 0.25, 90.25];
    let expected = std::f64::consts::PI * slope * slope / 3.0 * (f64::powi(far, 3) - f64::powi(near, 3));
    assert!((cone.volume_ml() * 1000.0 / expected - 1.0).abs() < 0.01, "{} of {expected}", cone.volume_ml() * 1000.0);
    // Behind the eye nothing is seen, and inside the eye nothing breaks.
    let inside = grid.world_from_index().transform_point3(DVec3::new(45.0, 55.0, 30.0));
    let from_inside = projection(DMat4::from_cols_array_2d(&[
        [500.0, 0.0, 0.0, 0.0],
        [0.0, 500.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, -1.0],
        [-500.0 * inside.x, -500.0 * inside.y, 0.0, inside.z],
    ]));
    let part = select(&Lasso { screen_from_world: &from_inside, ..lasso }, &grid);
    assert_eq!(part.bounds().map(|b| b[2]), Some([0, 30]));
}

#[test]
fn loops_and_lines() {
    let grid = grid([40, 40, 8], 1.0);
    let view = |at: DVec3| Some(at);
    let at = |x: f64, y: f64| grid.world_from_index().transform_point3(DVec3::new(x, y, 0.0)).truncate();
    // A figure of eight holds both halves; a loop that goes around twice has no hole.
    let eight = vec![at(5.0, 5.0), at(35.0, 35.0), at(35.0, 5.0), at(5.0, 35.0)];
    let both = select(&Lasso { polygon: eight, screen_from_world: &view, depth: None }, &grid);
    assert_eq!((both.get([8, 20, 4]), both.get([32, 20, 4]), both.get([20, 8, 4])), (255, 255, 0));
    let twice: Vec<DVec2> = [circle(at(20.0, 20.0), 15.0, 40), circle(at(20.0, 20.0), 8.0, 40)].concat();
    assert_eq!(select(&Lasso { polygon: twice, screen_from_world: &view, depth: None }, &grid).get([20, 20, 4]), 255);
    for nothing in
        [vec![], vec![at(1.0, 1.0); 5], vec![at(1.0, 1.0), at(5.0, 5.0)], vec![at(1.0, 1.0), at(9.0, 5.0), DVec2::NAN]]
    {
        let lasso = Lasso { polygon: nothing, screen_from_world: &view, depth: None };
        let error = lasso.select(&grid, &Limits::default(), &Arc::default(), &Progress::new()).unwrap_err();
        assert!(error.to_string().contains("encloses nothing"), "{error}");
    }
    let far = Lasso { polygon: circle(DVec2::splat(1e6), 5.0, 20), screen_from_world: &view, depth: None };
    assert!(select(&far, &grid).is_empty());
}
