//! Label maps of real files: names from headers and tables, folders of masks, other grids.

use std::path::Path;
use std::time::Instant;

use fabrica_engine::progress::Progress;
use fabrica_engine::read::{ReadOptions, read_labels, read_volume, survey};
use fabrica_engine::volume::labels::{LabelMap, LabelTable, LabelTableEntry};

fn layers(path: &Path) -> Vec<LabelMap> {
    read_labels(path, &ReadOptions::default(), &Progress::new()).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn single(path: &Path) -> LabelMap {
    let mut layers = layers(path);
    assert_eq!(layers.len(), 1);
    layers.remove(0)
}

/// The number at every voxel.
fn ids(map: &LabelMap) -> Vec<u32> {
    map.voxels.iter().map(|v| map.labels[usize::from(*v)].id).collect()
}

#[test]
fn a_folder_of_117_masks_is_one_label_map() {
    let Some(folder) = fabrica_tests::data("ct_abdomen_3mm_masks") else { return };
    let entries = survey(&folder, &ReadOptions::default(), &Progress::new()).unwrap();
    assert_eq!(entries.len(), 1);
    assert_eq!((entries[0].title.as_str(), entries[0].is_labels, entries[0].num_files), ("117 masks", true, 117));
    let start = Instant::now();
    let masks = single(&folder);
    println!("117 masks in {:.2} s", start.elapsed().as_secs_f64());
    assert_eq!((masks.grid.dims(), masks.labels.len(), &masks.notes), ([122, 101, 30], 118, &vec![]));
    let counts = masks.counts();
    assert_eq!(counts[1..].iter().filter(|n| **n > 0).count(), 40);
    assert_eq!(masks.labels[1].name, "adrenal gland left");
    // Every mask is what its file holds.
    let numbers = read_volume(&folder, &ReadOptions::default(), &Progress::new()).unwrap();
    for (label, count) in masks.labels.iter().zip(&counts).skip(1) {
        let file = folder.join(format!("{}.nii.gz", label.name.replace(' ', "_")));
        let alone = read_volume(&file, &ReadOptions::default(), &Progress::new()).unwrap();
        let mut num_inside = 0;
        for z in 0..30 {
            for y in 0..101 {
                for x in 0..122 {
                    let is_inside = alone.value(x, y, z) != 0.0;
                    let v = masks.voxels[x + 122 * (y + 101 * z)];
                    assert_eq!(masks.labels[usize::from(v)].id == label.id, is_inside, "{}", label.name);
                    assert_eq!(numbers.value(x, y, z) == f64::from(label.id), is_inside);
                    num_inside += u64::from(is_inside);
                }
            }
        }
        assert_eq!(num_inside, *count, "{}", label.name);
    }
}

#[test]
fn masks_and_a_label_map_of_one_scan_agree_by_name() {
    // Not voxel for voxel: the masks are of the segmentation's fast model at 3 mm, the label map of the one at 1.5 mm.
    let (Some(folder), Some(file)) =
        (fabrica_tests::data("ct_abdomen_3mm_masks"), fabrica_tests::data("ct_abdomen_3mm_slab_labels.nii.gz"))
    else {
        return;
    };
    let (masks, map) = (single(&folder), single(&file));
    let (mask_counts, map_counts) = (masks.counts(), map.counts());
    let mut num_compared = 0;
    for (i, mask) in masks.labels.iter().enumerate().skip(1).filter(|(i, _)| mask_counts[*i] > 0) {
        // The names stand in the header of the label map.
        let j = map.labels.iter().position(|l| l.name == mask.name).unwrap_or_else(|| panic!("no {}", mask.name));
        let both = masks.voxels.iter().zip(&map.voxels).filter(|(a, b)| (usize::from(**a), usize::from(**b)) == (i, j));
        let dice = 2.0 * both.count() as f64 / (mask_counts[i] + map_counts[j]) as f64;
        assert!(dice > 0.8, "{}: {dice}", mask.name);
        num_compared += 1;
    }
    assert_eq!(num_compared, 40);
    let id_of = |name: &str| map.labels.iter().find(|l| l.name == name).map(|l| l.id);
    assert_eq!((id_of("spleen"), id_of("liver"), id_of("costal cartilages")), (Some(1), Some(5), Some(117)));
}

#[test]
fn names_stand_in_the_headers_of_automatic_segmentations() {
    for (name, num_structures) in [
        ("ct_abdomen_j2k_seg.nii.gz", 31),
        ("mr_abdomen_slab_labels.nii.gz", 23),
        ("ct_abdomen_3mm_slab_labels.nii.gz", 41),
    ] {
        let Some(path) = fabrica_tests::data(name) else { continue };
        assert!(survey(&path, &ReadOptions::default(), &Progress::new()).unwrap()[0].is_labels);
        let map = single(&path);
        let unnamed: Vec<_> = map.labels.iter().filter(|l| l.name == l.id.to_string()).collect();
        assert!(unnamed.is_empty(), "{unnamed:?}");
        assert_eq!(map.labels.len() - 1, num_structures, "{name}");
        let liver = map.labels.iter().position(|l| l.name == "liver").unwrap();
        let statistics = map.statistics()[liver];
        // Livers are on the right and weigh a kilogram or two; these are sections.
        assert!((50.0..2500.0).contains(&statistics.volume_ml), "{name}: {statistics:?}");
        let spleen = map.labels.iter().position(|l| l.name == "spleen").unwrap();
        assert!(statistics.centroid_mm.unwrap().x > map.statistics()[spleen].centroid_mm.unwrap().x, "{name}");
    }
}

#[test]
fn numbers_beyond_8_bits_take_their_names_from_a_table() {
    let Some(path) = fabrica_tests::data("macaque_labels.nii.gz") else { return };
    assert!(survey(&path, &ReadOptions::default(), &Progress::new()).unwrap()[0].is_labels);
    let mut map = single(&path);
    let scan = read_volume(&path, &ReadOptions::default(), &Progress::new()).unwrap();
    assert_eq!(map.labels.last().unwrap().id, 1605);
    for (i, id) in ids(&map).into_iter().enumerate().step_by(997) {
        let [nx, ny, _] = map.grid.dims();
        assert_eq!(scan.value(i % nx, i / nx % ny, i / nx / ny), f64::from(id));
    }
    let entry = LabelTableEntry { name: Some("last".to_owned()), color: Some([1, 2, 3]), code: None };
    let table =
        LabelTable { entries: [(1605, entry), (99_999, LabelTableEntry::default())].into(), ..LabelTable::default() };
    let note = map.name_by(&table).unwrap();
    let last = map.labels.last().unwrap();
    assert_eq!((last.name.as_str(), last.color), ("last", [1, 2, 3]));
    assert!(note.starts_with(&format!(
        "Of {} structures, {} are not in the table: ",
        map.labels.len() - 1,
        map.labels.len() - 2
    )));
}

#[test]
fn a_label_map_in_another_orientation_comes_back_exactly() {
    let (Some(ras), Some(pil)) = (fabrica_tests::data("orient_RAS.nii.gz"), fabrica_tests::data("orient_PIL.nii.gz"))
    else {
        return;
    };
    // The head's bright voxels as a label map, which the two files have at the same places in the world.
    let bright = |path: &Path| {
        let volume = read_volume(path, &ReadOptions::default(), &Progress::new()).unwrap();
        let [nx, ny, nz] = volume.grid.dims();
        let mut voxels = Vec::new();
        for z in 0..nz {
            for y in 0..ny {
                voxels.extend((0..nx).map(|x| (volume.value(x, y, z) / 10.0) as u16));
            }
        }
        let labels = (0..10).map(|id| fabrica_engine::volume::labels::Label {
            id,
            name: id.to_string(),
            color: [0; 3],
            code: None,
        });
        LabelMap { grid: volume.grid, voxels, labels: labels.collect(), notes: Vec::new() }
    };
    let (ras, pil) = (bright(&ras), bright(&pil));
    let (turned, note) = pil.clone().resampled_to(&ras.grid).unwrap();
    assert_eq!(note, None);
    assert!(turned.voxels == ras.voxels);
    let (back, note) = turned.resampled_to(&pil.grid).unwrap();
    assert!(note.is_none() && back.voxels == pil.voxels);
}

#[test]
fn labels_go_onto_their_scan_and_no_other() {
    let (Some(labels), Some(slab), Some(whole)) = (
        fabrica_tests::data("ct_abdomen_3mm_slab_labels.nii.gz"),
        fabrica_tests::data("ct_abdomen_3mm_slab.nii.gz"),
        fabrica_tests::data("ct_abdomen_3mm.nii.gz"),
    ) else {
        return;
    };
    let (map, progress) = (single(&labels), Progress::new());
    let read = |path: &Path| read_volume(path, &ReadOptions::default(), &progress).unwrap();
    let slab = read(&slab);
    let (same, note) = map.clone().resampled_to(&slab.grid).unwrap();
    assert!(note.is_none() && same.voxels == map.voxels);
    let liver = map.labels.iter().position(|l| l.name == "liver").unwrap();
    let mean = same.means(&slab).unwrap()[liver].unwrap();
    assert!((mean - 45.291).abs() < 0.001, "{mean} HU");
    // A section: the whole scan is longer, on the same lattice. (The slab's header has the whole's origin, not its own, so
    // the values under the labels are others.)
    let (section, note) = map.clone().resampled_to(&read(&whole).grid).unwrap();
    assert!(note.is_none() && section.counts()[1..] == map.counts()[1..]);
    // A head lies further down than this abdomen.
    let Some(head) = fabrica_tests::data("spm152.nii.gz") else { return };
    let clause = map.resampled_to(&read(&head).grid).unwrap_err();
    assert!(clause.contains("the label map lies elsewhere") && clause.contains("S 93 to 183 mm"), "{clause}");
}
