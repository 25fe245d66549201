//! DICOM from real scanners and programs: what the table of the data folder's README says of each file, and whether scans and
//! their segmentations lie on each other in the world.

use std::collections::BTreeMap;
use std::path::Path;

use fabrica_engine::progress::Progress;
use fabrica_engine::read::{ReadOptions, read_labels, read_volume, survey};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::labels::LabelMap;
use glam::{DVec3, dvec3};

/// What a file or folder must be like.
struct Expected {
    path: &'static str,
    dims: [usize; 3],
    spacing: DVec3,
    letters: &'static str,
    element: &'static str,
    range: (f64, f64),
}

#[rustfmt::skip]
const EXPECTED: &[Expected] = &[
    row("ct_abdomen_j2k_dicom", [512, 512, 20], dvec3(0.9765625, 0.9765625, 2.0), "LPS", "uint16", (-1024.0, 1839.0)),
    row("pet_wb_dicom", [128, 128, 299], dvec3(3.5378182, 3.5378182, 3.375), "LPS", "int16", (0.0, 66260.8)),
    row("pet_seg_dicom", [128, 128, 9], dvec3(3.537818, 3.537818, 3.375), "LPS", "uint8", (0.0, 2.0)),
    row("dicom_odd/emri_small.dcm", [64, 64, 10], dvec3(1.0, 1.0, 1.2), "LPS", "uint16", (0.0, 467.0)),
    row("dicom_odd/emri_small_big_endian.dcm", [64, 64, 10], dvec3(1.0, 1.0, 1.2), "LPS", "uint16", (0.0, 467.0)),
    row("dicom_odd/emri_small_RLE.dcm", [64, 64, 10], dvec3(1.0, 1.0, 1.2), "LPS", "uint16", (0.0, 467.0)),
    row("dicom_odd/emri_small_jpeg_ls_lossless.dcm", [64, 64, 10], dvec3(1.0, 1.0, 1.2), "LPS", "uint16", (0.0, 467.0)),
    // Its fragments are cut by their padding only: all frames are whole.
    row("dicom_odd/emri_small_jpeg_2k_lossless_too_short.dcm", [64, 64, 10], dvec3(1.0, 1.0, 1.2), "LPS", "uint16", (0.0, 467.0)),
    row("dicom_odd/eCT_Supplemental.dcm", [512, 512, 2], dvec3(0.388672, 0.388672, 10.0), "RPI", "uint16", (-1024.0, 172.0)),
    row("dicom_odd/liver.dcm", [512, 512, 3], dvec3(0.810547, 0.810547, 1.0), "LPS", "uint8", (0.0, 1.0)),
    row("dicom_odd/liver_nonbyte_aligned.dcm", [510, 510, 3], dvec3(0.810547, 0.810547, 1.0), "LPS", "uint8", (0.0, 1.0)),
    row("dicom_odd/parametric_map_float.dcm", [128, 128, 1], dvec3(0.661468, 0.661468, 5.0), "LPS", "float32", (0.0, 0.941579)),
    row("dicom_odd/bad_sequence.dcm", [512, 512, 1], dvec3(0.287109375, 0.287109375, 1.0), "LPS", "uint16", (-1011.0, 1243.0)),
    row("dicom_odd/explicit_VR-UN.dcm", [512, 512, 1], dvec3(0.859375, 0.859375, 0.859375), "LAI", "int16", (-1024.0, 1186.0)),
    row("dicom_odd/JPEG2000_UNC.dcm", [256, 1024, 1], dvec3(2.26, 2.26, 2.26), "LPS", "int16", (-30.0, 245.0)),
    // Colors: the values are luminances.
    row("dicom_odd/SC_rgb_2frame.dcm", [100, 100, 2], dvec3(1.0, 1.0, 1.0), "LPS", "uint16", (0.0, 1.0)),
    row("dicom_odd/OT-PAL-8-face.dcm", [640, 480, 1], dvec3(1.0, 1.0, 1.0), "LPS", "uint16", (0.0, 1.0)),
];

const fn row(
    path: &'static str,
    dims: [usize; 3],
    spacing: DVec3,
    letters: &'static str,
    element: &'static str,
    range: (f64, f64),
) -> Expected {
    Expected { path, dims, spacing, letters, element, range }
}

fn read(path: &Path) -> Volume {
    read_volume(path, &ReadOptions::default(), &Progress::new()).unwrap_or_else(|e| panic!("{e}"))
}

fn assert_is(volume: &Volume, expected: &Expected) {
    let path = expected.path;
    assert_eq!(volume.grid.dims(), expected.dims, "{path}");
    assert!((volume.grid.spacing_mm() - expected.spacing).abs().max_element() < 1e-5, "{path}");
    assert_eq!(volume.grid.orientation_letters(), expected.letters, "{path}");
    assert_eq!(volume.voxels.type_name(), expected.element, "{path}");
    let statistics = volume.statistics(&Progress::new()).unwrap();
    // The table has six digits.
    let tolerance = 1e-5 * (expected.range.0.abs() + expected.range.1.abs());
    let (min, max) = (statistics.min, statistics.max);
    assert!(
        (min - expected.range.0).abs() < tolerance && (max - expected.range.1).abs() < tolerance,
        "{path}: {min} {max}"
    );
}

#[test]
fn real_dicom_is_what_the_table_says() {
    for expected in EXPECTED {
        let Some(path) = fabrica_tests::data(expected.path) else { continue };
        assert_is(&read(&path), expected);
    }
}

#[test]
fn a_series_in_an_archive_is_what_the_table_says() {
    let Some(archive) = fabrica_tests::data("ct_chest_dicom.tar.xz") else { return };
    let folder = tempfile::tempdir().unwrap();
    let unpacked = std::process::Command::new("tar").arg("-xJf").arg(&archive).arg("-C").arg(folder.path()).status();
    assert!(unpacked.is_ok_and(|s| s.success()), "this test needs tar and xz");
    let expected =
        row("ct_chest_dicom", [512, 512, 110], dvec3(0.78125, 0.78125, 1.0), "LPS", "uint16", (-1000.0, 1758.0));
    let volume = read(folder.path());
    assert_is(&volume, &expected);
    assert_eq!(volume.warnings, Vec::<String>::new());
    // The order of the files is not that of the slices: those next to each other are much more alike than others.
    let difference = |a: usize, b: usize| -> f64 {
        (0..512).step_by(8).map(|i| (volume.value(i, 256, a) - volume.value(i, 256, b)).abs()).sum()
    };
    let near: f64 = (0..109).map(|z| difference(z, z + 1)).sum();
    let far: f64 = (0..109).map(|z| difference(z, (z + 37) % 110)).sum();
    assert!(4.0 * near < far, "{near} {far}");
}

#[test]
fn a_picture_is_the_same_however_it_is_packed() {
    let Some(plain) = fabrica_tests::data("dicom_odd/emri_small.dcm") else { return };
    let plain = read(&plain);
    for packed in ["big_endian", "RLE", "jpeg_ls_lossless", "jpeg_2k_lossless_too_short"] {
        let Some(path) = fabrica_tests::data(&format!("dicom_odd/emri_small_{packed}.dcm")) else { continue };
        assert!(read(&path).voxels == plain.voxels, "{packed}");
    }
}

/// The mean of `volume` per label of `map` (0: none), at the voxel centers of the map, turned around along some axes.
fn mean_by_label(volume: &Volume, map: &LabelMap, is_turned: [bool; 3]) -> BTreeMap<u32, f64> {
    let [nx, ny, nz] = map.grid.dims();
    let mut sums: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    let index_from_map = volume.grid.index_from_world() * map.grid.world_from_index();
    for (i, label) in map.voxels.iter().enumerate() {
        let turn = |axis: usize, at: usize, n: usize| if is_turned[axis] { n - 1 - at } else { at } as f64;
        let at = DVec3::new(turn(0, i % nx, nx), turn(1, i / nx % ny, ny), turn(2, i / nx / ny, nz));
        let index = index_from_map.transform_point3(at).round();
        let dims = DVec3::from_array(volume.grid.dims().map(|n| n as f64));
        if index.cmpge(DVec3::ZERO).all() && index.cmplt(dims).all() {
            let [x, y, z] = index.to_array().map(|v| v as usize);
            let sum = sums.entry(map.labels[usize::from(*label)].id).or_default();
            *sum = (sum.0 + volume.value(x, y, z), sum.1 + 1.0);
        }
    }
    sums.into_iter().map(|(id, (sum, count))| (id, sum / count)).collect()
}

#[test]
fn a_segmentation_lies_on_its_scan() {
    let Some(pet) = fabrica_tests::data("pet_wb_dicom") else { return };
    let Some(segmentation) = fabrica_tests::data("pet_seg_dicom") else { return };
    let pet = read(&pet);
    let layers = read_labels(&segmentation, &ReadOptions::default(), &Progress::new()).unwrap();
    assert_eq!(layers.len(), 1);
    let names: Vec<_> = layers[0].labels.iter().map(|l| (l.name.as_str(), l.code.as_deref())).collect();
    let expected = [
        ("background", None),
        ("Neoplasm, Primary", Some("SRT:M-80003")),
        ("Neoplasm, Secondary", Some("SRT:M-80006")),
    ];
    assert_eq!(names, expected);
    let means = mean_by_label(&pet, &layers[0], [false; 3]);
    assert!(means[&1] > 10.0 * means[&0] && means[&2] > 5.0 * means[&0], "{means:?}");
    // The same must notice a segmentation that is the wrong way around.
    // The tumors are nearly as tall above as below.
    for (turned, share) in [([true, false, false], 0.8), ([false, true, false], 0.8), ([false, false, true], 0.98)] {
        let wrong = mean_by_label(&pet, &layers[0], turned);
        assert!(wrong[&1] + wrong[&2] < share * (means[&1] + means[&2]), "{turned:?} {means:?} {wrong:?}");
    }
}

#[test]
fn labels_of_another_format_lie_on_the_scan() {
    let Some(ct) = fabrica_tests::data("ct_abdomen_j2k_dicom") else { return };
    let Some(labels) = fabrica_tests::data("ct_abdomen_j2k_seg.nii.gz") else { return };
    let ct = read(&ct);
    let map = read_labels(&labels, &ReadOptions::default(), &Progress::new()).unwrap().remove(0);
    let corners = |grid: fabrica_engine::spaces::Grid| {
        let (min, max) = grid.index_box();
        let corners = grid.box_corners_mm(min, max);
        let low = corners.iter().copied().reduce(DVec3::min).unwrap();
        let high = corners.iter().copied().reduce(DVec3::max).unwrap();
        [low, high]
    };
    let (a, b) = (corners(ct.grid), corners(map.grid));
    assert!((0..2).all(|i| (a[i] - b[i]).abs().max_element() < 0.01), "{a:?} {b:?}");
    // TotalSegmentator's numbers: liver 5, vertebrae 26 to 50, lungs 10 to 14.
    let means = mean_by_label(&ct, &map, [false; 3]);
    let of = |range: std::ops::RangeInclusive<u32>| means.range(range).map(|(_, mean)| *mean).collect::<Vec<_>>();
    assert!(of(5..=5).iter().all(|hu| (30.0..200.0).contains(hu)), "{means:?}");
    assert!(!of(26..=50).is_empty() && of(26..=50).iter().all(|hu| *hu > 100.0), "{means:?}");
    assert!(of(10..=14).iter().all(|hu| *hu < -300.0), "{means:?}");
    // The liver is where it is on neither another side nor the back.
    for turned in [[true, false, false], [false, true, false]] {
        let wrong = mean_by_label(&ct, &map, turned);
        assert!(wrong[&5] < means[&5] - 30.0, "{turned:?} {wrong:?}");
    }
}

#[test]
fn one_file_stands_for_its_series_and_a_tree_is_listed() {
    let Some(pet) = fabrica_tests::data("pet_wb_dicom") else { return };
    let whole = read(&pet);
    let one = read(&pet.join("000010.dcm"));
    assert!(one.voxels == whole.voxels && one.grid == whole.grid);
    let Some(odd) = fabrica_tests::data("dicom_odd") else { return };
    let entries = survey(&odd, &ReadOptions::default(), &Progress::new()).unwrap();
    let mut keys: Vec<_> = entries.iter().map(|e| e.key.as_str()).collect();
    assert!(keys.len() >= 9, "{keys:?}");
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), entries.len());
    // One of them is a volume, the rest are pictures.
    let volume = read(&odd);
    assert_eq!(volume.grid.dims(), [64, 64, 10]);
    assert!(volume.warnings.iter().any(|w| w.contains("9 other series were left out")), "{:?}", volume.warnings);
}
