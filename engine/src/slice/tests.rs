use std::f64::consts::PI;

use glam::{DAffine3, DMat3};

use super::anatomical::{Convention, Frame, Orientation};
use super::*;
use crate::progress::Progress;
use crate::spaces::direction_letters;
use crate::specimen;
use crate::volume::Voxels;

/// Voxels of 0.7 x 1.1 x 3 mm, mirrored, sheared and turned.
fn crooked(dims: [usize; 3]) -> Grid {
    let shear = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.1, -0.3, 1.0));
    let turn = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_z(-0.2);
    let matrix = turn * shear * DMat3::from_diagonal(DVec3::new(-0.7, 1.1, 3.0));
    Grid::new(dims, DAffine3 { matrix3: matrix, translation: DVec3::new(12.0, -30.0, 5.0) }).unwrap()
}

fn indices(dims: [usize; 3]) -> impl Iterator<Item = DVec3> {
    let [nx, ny, nz] = dims;
    (0..nx * ny * nz).map(move |i| DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64))
}

fn samples<T: Texel>(field: Field<'_, T>, plane: &Plane, filter: Filter) -> Vec<Sample<T::Value>>
where
    T::Value: Send,
{
    resample(field, plane, filter, |_, sample| Some(sample)).into_iter().map(Option::unwrap).collect()
}

/// Pixels in the world plane across `normal` through the middle of a grid, `mm` apart, so many that they reach beyond it.
fn plane_through(grid: &Grid, normal: DVec3, mm: f64) -> Plane {
    let (right, down) = normal.any_orthonormal_pair();
    let middle = DVec3::from_array(grid.dims().map(|n| 0.5 * (n as f64 - 1.0)));
    let half = 0.5 * (grid.spacing_mm() * DVec3::from_array(grid.dims().map(|n| n as f64))).length() + 2.0;
    let n = (2.0 * half / mm).ceil() as usize;
    let origin = grid.world_from_index().transform_point3(middle) - half * (right + down);
    Plane { origin_mm: origin, right_mm: mm * right, down_mm: mm * down, size: [n, n + 3] }
}

#[test]
fn a_linear_field_comes_back_exactly_and_goes_on_at_the_edges() {
    let dims = [9, 7, 5];
    let grid = crooked(dims);
    let field = |p: DVec3| 3.0 * p.x - 2.0 * p.y + 0.25 * p.z + 7.0;
    let voxels: Vec<f64> = indices(dims).map(|i| field(grid.world_from_index().transform_point3(i))).collect();
    for (normal, mm) in [(DVec3::Z, 0.31), (DVec3::new(0.3, -0.5, 0.8).normalize(), 0.2), (DVec3::X, 0.45)] {
        let plane = plane_through(&grid, normal, mm);
        let got = samples(Field { grid: &grid, voxels: &voxels }, &plane, Filter::Linear);
        assert_eq!(got.len(), plane.size[0] * plane.size[1]);
        let mut counts = [0, 0, 0];
        for (i, sample) in got.into_iter().enumerate() {
            let p = plane.at((i % plane.size[0]) as f64, (i / plane.size[0]) as f64);
            let index = grid.index_from_world().transform_point3(p);
            let last = DVec3::from_array(dims.map(|n| n as f64 - 1.0));
            let beyond = (index - index.clamp(DVec3::ZERO, last)).abs().max_element();
            let nearest = grid.world_from_index().transform_point3(index.clamp(DVec3::ZERO, last));
            if (beyond - 0.5).abs() < 1e-6 {
                continue;
            }
            match sample {
                Sample::Data(value) => {
                    assert!((value - field(nearest)).abs() < 1e-11 && beyond < 0.5, "{value} at {index}")
                }
                Sample::Outside => assert!(beyond > 0.5, "nothing at {index}"),
                Sample::Gap => panic!("a gap at {index}"),
            }
            counts[usize::from(beyond > 0.0) + usize::from(beyond > 0.5)] += 1;
        }
        assert!(counts.iter().all(|n| *n > 40), "within, at the edges, outside: {counts:?}");
    }
}

#[test]
fn the_nearest_voxel_has_its_own_value() {
    let dims = [5, 4, 3];
    let grid = crooked(dims);
    let voxels: Vec<u16> = (0..60).map(|i| i * i).collect();
    let plane = plane_through(&grid, DVec3::Y, 0.23);
    let got = samples(Field { grid: &grid, voxels: &voxels }, &plane, Filter::Nearest);
    let mut seen = 0;
    for (i, sample) in got.into_iter().enumerate() {
        let p = plane.at((i % plane.size[0]) as f64, (i / plane.size[0]) as f64);
        let index = grid.index_from_world().transform_point3(p);
        let nearest = index.round();
        if (index - nearest).abs().max_element() > 0.499 {
            continue;
        }
        let inside = nearest.cmpge(DVec3::ZERO).all() && nearest.cmplt(DVec3::from_array(dims.map(|n| n as f64))).all();
        let voxel = || voxels[(nearest.x + 5.0 * (nearest.y + 4.0 * nearest.z)) as usize];
        let expected = if inside { Sample::Data(f64::from(voxel())) } else { Sample::Outside };
        assert_eq!(sample, expected, "{index}");
        seen += usize::from(inside);
    }
    assert!(seen > 100);
}

/// A row of voxels 1 mm apart, and pixels along it.
fn row<T: Texel>(voxels: &[T], first: f64, step: f64, n: usize, filter: Filter) -> Vec<Sample<T::Value>>
where
    T::Value: Send,
{
    let grid = Grid::new([voxels.len(), 1, 1], DAffine3::IDENTITY).unwrap();
    let plane = Plane { origin_mm: first * DVec3::X, right_mm: step * DVec3::X, down_mm: 0.1 * DVec3::Y, size: [n, 1] };
    samples(Field { grid: &grid, voxels }, &plane, filter)
}

#[test]
fn voxels_without_a_value_are_gaps_up_to_half_way() {
    use Sample::{Data, Gap, Outside};
    let voxels = [1.0, f32::NAN, 3.0, f32::INFINITY];
    let got = row(&voxels, -0.6, 0.2, 21, Filter::Linear);
    let place = |p: f64| ((p + 0.6) / 0.2).round() as usize;
    assert_eq!((got[place(-0.6)], got[place(-0.4)], got[place(3.4)]), (Outside, Data(1.0), Gap));
    for (p, expected) in [(0.0, Data(1.0)), (0.4, Data(1.0)), (0.6, Gap), (1.0, Gap), (1.4, Gap), (1.6, Data(3.0))] {
        assert_eq!(got[place(p)], expected, "{p}");
    }
    assert_eq!((got[place(2.4)], got[place(2.6)]), (Data(3.0), Gap));
    assert_eq!(row(&voxels, 0.0, 1.0, 3, Filter::Nearest), [Data(1.0), Gap, Data(3.0)]);
    let grid = Grid::new([4, 1, 1], DAffine3::IDENTITY).unwrap();
    let volume =
        Volume::new(grid, Voxels::F32(voxels.to_vec()), Rescale { slope: 2.0, intercept: 5.0 }, "test").unwrap();
    assert_eq!(value_at(&volume, 0.4 * DVec3::X, Filter::Linear), Data(7.0));
    assert_eq!(value_at(&volume, 1.1 * DVec3::X, Filter::Linear), Gap);
    assert_eq!(value_at(&volume, 9.0 * DVec3::X, Filter::Linear), Outside);
}

#[test]
fn what_is_shown_small_is_a_mean() {
    // Stripes of one voxel would be all or nothing.
    let stripes: Vec<u8> = (0..64).map(|i| 200 * (i % 2)).collect();
    for sample in &row(&stripes, 1.5, 4.0, 16, Filter::Linear)[..15] {
        assert_eq!(*sample, Sample::Data(100.0));
    }
    let ramp: Vec<f64> = (0..64).map(|i| 3.0 * f64::from(i)).collect();
    for (i, sample) in row(&ramp, 3.0, 2.7, 22, Filter::Linear).into_iter().enumerate() {
        let Sample::Data(value) = sample else { panic!("{i}") };
        assert!((value - 3.0 * (3.0 + 2.7 * i as f64)).abs() < 1e-9, "{i}: {value}");
    }
    assert_eq!(row(&stripes, 1.0, 4.0, 2, Filter::Nearest), [Sample::Data(200.0); 2]);
}

#[test]
fn windows_go_from_black_to_white() {
    let window = Window { level: 40.0, width: 400.0 };
    let grays = [-1000.0, -160.0, 40.0, 140.0, 240.0, 3000.0, f64::INFINITY].map(|v| window.gray(v));
    assert_eq!(grays, [0, 0, 128, 191, 255, 255, 255]);
    assert_eq!(Window::of_range(-160.0, 240.0), window);
    let constant = Window::of_range(7.0, 7.0);
    assert_eq!([6.9, 7.0, 7.1].map(|v| constant.gray(v)), [0, 128, 255]);
    assert!(Window::of_range(0.0, 0.0).width > 0.0);
}

#[test]
fn volumes_become_pictures() {
    let grid = Grid::new([3, 2, 1], DAffine3::IDENTITY).unwrap();
    let plane = Plane { origin_mm: DVec3::new(0.0, 1.0, 0.0), right_mm: DVec3::X, down_mm: -DVec3::Y, size: [4, 2] };
    let rescale = Rescale { slope: -1.0, intercept: 0.0 };
    let voxels = Voxels::F32(vec![0.0, -50.0, -100.0, f32::NAN, -100.0, 0.0]);
    let volume = Volume::new(grid, voxels, rescale, "test").unwrap();
    let gray = |g: u8| [g, g, g, 255];
    let picture = draw(&volume, &plane, Filter::Nearest, Window::of_range(0.0, 100.0));
    // y goes up, rows go down; the first pixel is hatched.
    let expected = [HATCH, gray(255), gray(0), [0; 4], gray(0), gray(128), gray(255), [0; 4]];
    assert_eq!(picture, expected);
    let (red, clear) = ([255, 0, 0, 255], [0, 255, 0, 0]);
    let colors = Volume::from_colors(grid, vec![red, clear, red, red, red, clear], "test").unwrap();
    let picture = draw(&colors, &plane, Filter::Linear, Window::of_range(0.0, 1.0));
    assert_eq!(picture, [red, red, [0; 4], [0; 4], red, [0; 4], red, [0; 4]]);
    // Half way to nothing it is half there, and still red.
    let between = Plane { origin_mm: DVec3::new(0.5, 0.0, 0.0), size: [1, 1], ..plane };
    assert_eq!(draw(&colors, &between, Filter::Linear, Window::of_range(0.0, 1.0)), [[255, 0, 0, 128]]);
}

#[test]
fn selections_are_laid_over_with_an_outline() {
    // A block of members in the middle, whose border is half way between voxel centers.
    let dims = [8, 8, 1];
    let grid = Grid::new(dims, DAffine3::IDENTITY).unwrap();
    let inside = |i: DVec3| i.x >= 2.0 && i.x <= 5.0 && i.y >= 2.0 && i.y <= 5.0;
    let members: Vec<u8> = indices(dims).map(|i| if inside(i) { 255 } else { 0 }).collect();
    let plane = Plane { origin_mm: DVec3::ZERO, right_mm: DVec3::X, down_mm: DVec3::Y, size: [8, 8] };
    let field = Field { grid: &grid, voxels: &members };
    let tint = Tint { color: [200, 100, 0], opacity: 0.5, outlined: true };
    let mut picture = vec![[100, 100, 100, 255]; 64];
    picture[3 + 8 * 3] = [0; 4];
    lay_over(&mut picture, &plane, field, tint);
    let at = |x: usize, y: usize| picture[x + 8 * y];
    assert_eq!((at(0, 0), at(1, 3), at(6, 5)), ([100, 100, 100, 255], [100, 100, 100, 255], [100, 100, 100, 255]));
    assert_eq!((at(2, 2), at(5, 3), at(4, 5)), ([200, 100, 0, 255], [200, 100, 0, 255], [200, 100, 0, 255]));
    // Within, half of each; on nothing, half of the color alone.
    assert_eq!((at(4, 4), at(3, 3)), ([150, 100, 50, 255], [200, 100, 0, 128]));
    let mut plain = vec![[100, 100, 100, 255]; 64];
    lay_over(&mut plain, &plane, field, Tint { outlined: false, ..tint });
    assert_eq!(plain[2 + 8 * 2], [150, 100, 50, 255]);
}

/// The same body, stored with its index axes in another order and some of them the other way.
fn stored_otherwise(volume: &Volume, order: [usize; 3], reversed: [bool; 3], turn: DMat3) -> Volume {
    let dims = volume.grid.dims();
    let new_dims = order.map(|axis| dims[axis]);
    let old_index = |index: DVec3| {
        let mut old = DVec3::ZERO;
        for (i, axis) in order.into_iter().enumerate() {
            old[axis] = if reversed[i] { new_dims[i] as f64 - 1.0 - index[i] } else { index[i] };
        }
        old
    };
    let origin = old_index(DVec3::ZERO);
    let columns = DVec3::AXES.map(|axis| old_index(axis) - origin);
    let to_old = DAffine3 { matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]), translation: origin };
    let world = DAffine3::from_mat3(turn) * volume.grid.world_from_index() * to_old;
    let voxels =
        indices(new_dims).map(old_index).map(|i| volume.value(i.x as usize, i.y as usize, i.z as usize) as f32);
    let voxels = Voxels::F32(voxels.collect());
    Volume::new(Grid::new(new_dims, world).unwrap(), voxels, Rescale::IDENTITY, "test").unwrap()
}

#[test]
fn what_is_on_the_right_is_where_the_letter_says() {
    let head = specimen::generate("head", 64, &Progress::new()).unwrap().volume;
    let as_stored = |volume: &Volume| {
        let dims = volume.grid.dims();
        let value = |i: &DVec3| volume.value(i.x as usize, i.y as usize, i.z as usize);
        let brightest = indices(dims).max_by(|a, b| value(a).total_cmp(&value(b))).unwrap();
        volume.grid.world_from_index().transform_point3(brightest)
    };
    // The gold crown: on the patient's right, and in front.
    let gold = as_stored(&head);
    assert!(gold.x > 5.0 && gold.y > 5.0, "{gold}");
    let oblique = DMat3::from_rotation_y(0.3) * DMat3::from_rotation_z(0.35);
    for (order, reversed, turn) in [
        ([0, 1, 2], [false; 3], DMat3::IDENTITY),
        ([0, 1, 2], [true, false, false], DMat3::IDENTITY),
        ([0, 1, 2], [true, true, false], DMat3::IDENTITY),
        ([1, 2, 0], [false, true, true], DMat3::IDENTITY),
        ([2, 0, 1], [true, false, true], oblique),
        ([0, 1, 2], [true, false, false], oblique),
    ] {
        let volume = stored_otherwise(&head, order, reversed, turn);
        let case = format!("{}, {:.0}°", volume.grid.orientation_letters(), volume.grid.obliquity_deg());
        assert_eq!(volume.grid.is_left_handed(), volume.grid.world_from_index().matrix3.determinant() < 0.0);
        let gold = turn * gold;
        assert!(as_stored(&volume).distance(gold) < 1e-9, "{case}: another place");
        for convention in [Convention::Radiological, Convention::Neurological] {
            for orientation in Orientation::ALL {
                let frame = Frame::of(&volume.grid, orientation, convention);
                let [across, along] = frame.extent_mm(&volume.grid);
                let size = [across, along].map(|[low, high]| (high - low).ceil() as usize);
                let corner = across[0] * frame.right + along[1] * frame.up + frame.position_mm(gold) * frame.normal;
                let plane = Plane { origin_mm: corner, right_mm: frame.right, down_mm: -frame.up, size };
                let picture = draw(&volume, &plane, Filter::Linear, Window::of_range(-1000.0, 6000.0));
                let (at, _) = picture.iter().enumerate().max_by_key(|(_, p)| p[0]).unwrap();
                let seen = plane.at((at % size[0]) as f64, (at / size[0]) as f64);
                assert!(seen.distance(gold) < 4.0, "{case} {orientation:?}: gold seen at {seen}, is at {gold}");
                let letter = |v: DVec3| direction_letters(v).chars().next().unwrap();
                let on_the_left = at % size[0] < size[0] / 2;
                let side = if on_the_left { letter(-frame.right) } else { letter(frame.right) };
                let (expected, left) = match (orientation, convention) {
                    (Orientation::Sagittal, _) => ('A', true),
                    (_, Convention::Radiological) => ('R', true),
                    (_, Convention::Neurological) => ('R', false),
                };
                assert_eq!((side, on_the_left), (expected, left), "{case} {orientation:?} {convention:?}");
                assert_eq!(letter(frame.up), if orientation == Orientation::Axial { 'A' } else { 'S' }, "{case}");
                let ahead = [["S", "I"], ["P", "P"], ["R", "R"]][orientation as usize];
                let ahead = if convention == Convention::Radiological { ahead[0] } else { ahead[1] };
                let ahead = if (orientation, convention) == (Orientation::Coronal, Convention::Neurological) {
                    "A"
                } else {
                    ahead
                };
                assert!(direction_letters(frame.view_direction()).starts_with(ahead), "{case} {orientation:?}");
            }
        }
    }
}

#[test]
fn frames_are_the_patients_or_the_slices_own() {
    let spacing = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 3.0));
    let grid = |matrix: DMat3| {
        Grid::new([20, 30, 10], DAffine3 { matrix3: matrix, translation: DVec3::new(5.0, 6.0, 7.0) }).unwrap()
    };
    // Less than a degree: the patient's axes, exactly.
    let upright = grid(DMat3::from_rotation_x(0.9 * PI / 180.0) * spacing);
    let frame = Frame::of(&upright, Orientation::Axial, Convention::Radiological);
    assert_eq!((frame.right, frame.up, frame.normal), (DVec3::NEG_X, DVec3::Y, DVec3::Z));
    assert!((frame.step_mm - 3.0).abs() < 1e-3 && frame.num_slices == 10);
    // More: its own, and every slice's middle is a layer of voxels.
    for grid in [grid(DMat3::from_rotation_x(0.3) * spacing), crooked([20, 30, 10])] {
        for orientation in Orientation::ALL {
            for convention in [Convention::Radiological, Convention::Neurological] {
                let frame = Frame::of(&grid, orientation, convention);
                assert!(frame.right.dot(frame.up).abs() < 1e-12 && (frame.normal.length() - 1.0).abs() < 1e-12);
                assert!(frame.right.cross(frame.up).dot(frame.normal).abs() > 1.0 - 1e-12);
                let across =
                    grid.nearest_world_axes().iter().position(|n| *n == [2, 1, 0][orientation as usize]).unwrap();
                assert_eq!(frame.num_slices, grid.dims()[across]);
                for place in indices(grid.dims()) {
                    let position = frame.position_mm(grid.world_from_index().transform_point3(place));
                    let slice = frame.slice_at(position);
                    let n = place[across] as usize;
                    assert!(slice == n || slice == frame.num_slices - 1 - n, "{orientation:?} {place}: {slice}");
                    assert!((frame.slice_mm(slice) - position).abs() < 1e-9);
                    // On another slice it is the same voxel but for that index.
                    let moved = frame.moved_to(grid.world_from_index().transform_point3(place), frame.slice_mm(0));
                    let mut by = grid.index_from_world().transform_point3(moved) - place;
                    assert!((by[across].abs() - slice as f64).abs() < 1e-9, "{place} {slice} {by}");
                    by[across] = 0.0;
                    assert!(by.length() < 1e-9, "{place}: {by}");
                }
            }
        }
    }
    let frame = Frame::of(&upright, Orientation::Coronal, Convention::Neurological);
    assert_eq!(
        (frame.slice_at(f64::NEG_INFINITY), frame.slice_at(f64::INFINITY), frame.slice_at(f64::NAN)),
        (0, 29, 0)
    );
    let moved = frame.moved_to(DVec3::new(1.0, 2.0, 3.0), 9.0);
    assert!(moved.distance(DVec3::new(1.0, 9.0, 3.0)) < 1e-12);
    let [[left, right], [bottom, top]] = frame.extent_mm(&grid(spacing));
    assert_eq!([left, right, bottom, top], [4.5, 24.5, 5.5, 35.5]);
    // A sheet is seen as it lies, at any angle.
    let sheet = Grid::new([20, 30, 1], DAffine3::from_mat3(DMat3::from_rotation_x(0.01))).unwrap();
    let frame = Frame::of(&sheet, Orientation::Axial, Convention::Radiological);
    assert!(frame.normal.distance(DMat3::from_rotation_x(0.01) * DVec3::Z) < 1e-12);
    assert_eq!(frame.range_mm()[0], frame.range_mm()[1]);
}
