use glam::{DAffine3, DVec3};

use super::*;
use crate::spaces::Grid;
use crate::volume::labels::numbered;

fn grid(dims: [usize; 3]) -> Grid {
    Grid::new(dims, DAffine3::from_scale(DVec3::ONE)).unwrap()
}

#[test]
fn three_hundred_labels_with_large_numbers_go_there_and_back() {
    let dims = [37, 29, 23];
    let labels: Vec<Label> = [background()].into_iter().chain((1..=300).map(|i| numbered(70_000 + 999 * i))).collect();
    // Columns, specks, and the last structure without a voxel.
    let voxels: Vec<u16> = (0..37 * 29 * 23)
        .map(|i| if i % 7 == 0 { (i % 300) as u16 } else { (i % 37 / 3 + i / 37 % 29 / 5) as u16 })
        .collect();
    let map = LabelMap { grid: grid(dims), voxels, labels, notes: Vec::new() };
    let pool = Arc::default();
    let structures = from_label_maps(std::slice::from_ref(&map), &pool, &Progress::new()).unwrap();
    assert_eq!(structures.len(), 300);
    for (structure, count) in structures.iter().zip(&map.counts()[1..]) {
        assert_eq!(structure.selection.num_voxels(), *count as f64, "{}", structure.label.name);
        assert!(Arc::ptr_eq(structure.selection.pool(), &pool));
    }
    assert!(structures[299].selection.is_empty());
    let back = to_partition(&structures, &Progress::new()).unwrap();
    assert!(back.voxels == map.voxels && back.labels == map.labels && back.notes.is_empty());
    let layers = to_layers(&structures, &Progress::new()).unwrap();
    assert!(layers.len() == 1 && layers[0].voxels == map.voxels);
}

#[test]
fn overlaps_go_to_layers_or_to_the_larger_membership() {
    let pool: Arc<BrickPool> = Arc::default();
    let make = |id: u32, name: &str, voxels: VoxelBox, f: u8| {
        let mut selection = Selection::empty(grid([20, 20, 20]), &pool);
        selection.change(voxels, |_, _| f);
        Structure { label: Label { name: name.to_owned(), ..numbered(id) }, selection }
    };
    let structures = [
        make(5, "a", [[0, 12], [0, 20], [0, 20]], 200),
        make(5, "b", [[8, 20], [0, 20], [0, 20]], 255),
        make(0, "c", [[0, 20], [0, 20], [0, 20]], 127),
    ];
    let layers = to_layers(&structures, &Progress::new()).unwrap();
    assert_eq!(layers.len(), 2);
    assert_eq!(layers[0].counts()[1..], [4800, 0], "c is nowhere in");
    assert_eq!(layers[1].counts()[1..], [4800]);
    let ids: Vec<u32> = layers.iter().flat_map(|l| l.labels[1..].iter().map(|l| l.id)).collect();
    assert_eq!(ids, [5, 7, 6], "no number twice, and none is 0");
    let partition = to_partition(&structures, &Progress::new()).unwrap();
    assert_eq!(partition.counts(), [0, 3200, 4800, 0]);
    assert!(partition.notes[0].contains("1.600 ml"), "{:?}", partition.notes);
    let elsewhere = Structure { selection: Selection::empty(grid([5; 3]), &pool), ..structures[0].clone() };
    let error = to_layers(&[structures[0].clone(), elsewhere], &Progress::new()).unwrap_err();
    assert!(error.to_string().contains("different grids"), "{error}");
    assert!(to_partition(&[], &Progress::new()).is_err());
}

#[test]
fn names_that_occur_twice_get_numbers() {
    let mut names: Vec<String> = ["rib", "rib", "heart", "rib", "rib (2)", "rib (2)"].map(str::to_owned).to_vec();
    make_distinct(&mut names);
    assert_eq!(names, ["rib", "rib (3)", "heart", "rib (4)", "rib (2)", "rib (2) (2)"]);
}
