use super::super::{background, numbered};
use super::*;

/// A label map with `ids[i]` as the position and number of voxel i.
fn map(dims: [usize; 3], world_from_index: DAffine3, voxels: Vec<u16>) -> LabelMap {
    let grid = Grid::new(dims, world_from_index).unwrap();
    let last = voxels.iter().copied().max().unwrap_or(0);
    let labels = (0..=u32::from(last)).map(|id| if id == 0 { background() } else { numbered(id) }).collect();
    LabelMap { grid, voxels, labels, notes: Vec::new() }
}

/// Every voxel another number, from 1.
fn all_different(dims: [usize; 3], world_from_index: DAffine3) -> LabelMap {
    map(dims, world_from_index, (1..=(dims[0] * dims[1] * dims[2]) as u16).collect())
}

fn scaled(x: f64, y: f64, z: f64, at: [f64; 3]) -> DAffine3 {
    DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::new(x, y, z)), DVec3::from_array(at))
}

#[test]
fn the_same_grid_is_taken_as_it_is() {
    let labels = all_different([3, 4, 2], scaled(1.0, 2.0, 3.0, [10.0, -20.0, 5.0]));
    let before = labels.voxels.clone();
    // Off by the rounding of another program.
    let grid = Grid::new([3, 4, 2], scaled(1.000_01, 2.0, 3.0, [10.000_3, -20.0, 5.0])).unwrap();
    let (after, note) = labels.resampled_to(&grid).unwrap();
    assert_eq!((after.voxels, after.grid, note), (before, grid, None));
}

#[test]
fn turned_and_swapped_axes_lose_nothing_and_need_no_note() {
    let labels = all_different([3, 4, 2], scaled(1.0, 1.0, 1.0, [0.0; 3]));
    // x to the back, y down, z to the left.
    let m = DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::NEG_X);
    let pil = Grid::new([4, 2, 3], DAffine3::from_mat3_translation(m, DVec3::new(2.0, 3.0, 1.0))).unwrap();
    let (turned, note) = labels.clone().resampled_to(&pil).unwrap();
    assert_eq!(note, None);
    let back = turned.clone().resampled_to(&labels.grid).unwrap().0;
    assert_eq!(back.voxels, labels.voxels);
    // The voxel at R 2, A 3, S 1 is the last of the map and the first of the turned one.
    assert_eq!((labels.voxels[23], turned.voxels[0]), (24, 24));
    assert_eq!(turned.counts(), labels.counts());
}

#[test]
fn a_section_of_the_scan_goes_to_its_place() {
    // As 3D Slicer stores a segmentation: only the part with structures.
    let part = map([2, 1, 1], scaled(2.0, 2.0, 2.0, [4.0, 2.0, 0.0]), vec![1, 2]);
    let scan = Grid::new([5, 3, 1], scaled(2.0, 2.0, 2.0, [0.0; 3])).unwrap();
    let (whole, note) = part.resampled_to(&scan).unwrap();
    assert_eq!((whole.voxels, note), (vec![0, 0, 0, 0, 0, 0, 0, 1, 2, 0, 0, 0, 0, 0, 0], None));
    let shifted = map([5, 1, 1], scaled(2.0, 2.0, 2.0, [6.0, 0.0, 0.0]), vec![1, 1, 2, 2, 3]);
    let (cut, note) = shifted.resampled_to(&scan).unwrap();
    assert_eq!(cut.voxels[..5], [0, 0, 0, 1, 1]);
    assert_eq!(note.unwrap(), "60.0 % of the label map's labeled voxels lie outside the scan and were cut off.");
}

#[test]
fn another_spacing_takes_the_nearest_and_says_so() {
    // Twice as fine.
    let labels = all_different([2, 2, 1], scaled(2.0, 2.0, 2.0, [0.0; 3]));
    let fine = Grid::new([4, 4, 2], scaled(1.0, 1.0, 1.0, [-0.5; 3])).unwrap();
    let (resampled, note) = labels.resampled_to(&fine).unwrap();
    assert_eq!(resampled.voxels[..16], [1, 1, 2, 2, 1, 1, 2, 2, 3, 3, 4, 4, 3, 3, 4, 4]);
    assert_eq!(resampled.voxels[..16], resampled.voxels[16..]);
    assert_eq!(note.unwrap(), "The label map has another grid (2 x 2 x 2 mm) than the scan; it was resampled.");
    // Three times as coarse: what falls between the middles vanishes, and is named.
    let labels = all_different([3, 1, 1], scaled(1.0, 3.0, 3.0, [0.0; 3]));
    let coarse = Grid::new([1, 1, 1], scaled(3.0, 3.0, 3.0, [1.0, 0.0, 0.0])).unwrap();
    let (resampled, note) = labels.resampled_to(&coarse).unwrap();
    assert_eq!((resampled.voxels, resampled.labels.len()), (vec![2], 4));
    assert!(note.unwrap().ends_with("; some structures are too thin for the scan's voxels and vanished (1, 3)."));
    // Turned by half a radian, most of it outside.
    let labels = map([10, 10, 10], scaled(1.0, 1.0, 1.0, [0.0; 3]), vec![1; 1000]);
    let turned = DAffine3::from_rotation_z(0.5);
    let (resampled, note) = labels.resampled_to(&Grid::new([5, 20, 10], turned).unwrap()).unwrap();
    let mut num_inside = 0;
    for (i, v) in resampled.voxels.iter().enumerate() {
        let world = turned.transform_point3(DVec3::new((i % 5) as f64, (i / 5 % 20) as f64, (i / 100) as f64));
        let is_inside = (-0.5..9.5).contains(&world.x) && (-0.5..9.5).contains(&world.y);
        assert_eq!(*v == 1, is_inside, "{world}");
        num_inside += usize::from(is_inside);
    }
    assert_eq!(num_inside, 260);
    assert!(note.unwrap().contains("% of its labeled voxels lie outside the scan and were cut off"));
}

#[test]
fn no_overlap_is_refused_with_both_places() {
    let labels = map([2, 2, 2], scaled(1.0, 1.0, 1.0, [100.0, 0.0, 0.0]), vec![1; 8]);
    let scan = Grid::new([10, 10, 10], scaled(1.0, 1.0, 1.0, [0.0; 3])).unwrap();
    let clause = labels.resampled_to(&scan).unwrap_err();
    assert_eq!(
        clause,
        "the label map lies elsewhere: its structures take R 100 to 102, A -1 to 2, S -1 to 2 mm, the scan takes \
         R -1 to 10, A -1 to 10, S -1 to 10 mm"
    );
    // Boxes that overlap do not help where the structures lie elsewhere; an empty map lies nowhere and is taken.
    let corner = map([20, 1, 1], scaled(1.0, 1.0, 1.0, [0.0; 3]), [vec![0; 15], vec![1; 5]].concat());
    assert!(corner.clone().resampled_to(&scan).is_err());
    let empty = LabelMap { voxels: vec![0; 20], ..corner.clone() };
    assert_eq!(empty.resampled_to(&scan).unwrap().0.counts(), [1000, 0]);
    // Of several layers, one may lie outside.
    let inside = map([1, 1, 1], scaled(1.0, 1.0, 1.0, [0.0; 3]), vec![1]);
    let (layers, note) = resample_layers(vec![corner, inside], &scan).unwrap();
    assert_eq!((layers[0].counts()[1], layers[1].counts()[1]), (0, 1));
    assert!(note.unwrap().starts_with("83.3 % of the label map's"));
}

#[test]
fn statistics_in_the_world() {
    let mut voxels = vec![0; 60];
    // x 1 to 3, y 2, z 0 and one at x 4, y 3, z 2.
    voxels[11..14].fill(1);
    voxels[59] = 1;
    let mut labels = map([5, 4, 3], scaled(-1.0, 2.0, 3.0, [10.0, 20.0, 30.0]), voxels);
    labels.labels.push(numbered(9));
    let [_, one, none] = labels.statistics()[..] else { panic!() };
    assert_eq!((one.num_voxels, one.volume_ml), (4, 0.024));
    assert_eq!(one.index_box, Some([[1, 2, 0], [4, 3, 2]]));
    let [min, max] = one.box_mm.unwrap();
    assert_eq!((min.to_array(), max.to_array()), ([5.5, 23.0, 28.5], [9.5, 27.0, 37.5]));
    assert_eq!(one.centroid_mm.unwrap().to_array(), [7.5, 24.5, 31.5]);
    assert_eq!((none.num_voxels, none.index_box, none.box_mm, none.centroid_mm), (0, None, None, None));
}
