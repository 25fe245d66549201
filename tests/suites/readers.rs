//! The readers on real files from public repositories: sizes, types, ranges and above all places in the world, as
//! other programs see them (the table of the data folder's README). Files that are not volumes get a sentence.

use std::path::Path;

use fabrica_engine::progress::Progress;
use fabrica_engine::read::{ReadOptions, read_volume, survey};
use fabrica_engine::volume::statistics::Statistics;
use fabrica_engine::volume::{Rescale, Volume};
use glam::DVec3;

/// What a file must be like.
struct Expected {
    file: &'static str,
    dims: [usize; 3],
    num_frames: usize,
    letters: &'static str,
    element: &'static str,
    /// Of the data values of all frames.
    range: (f64, f64),
}

#[rustfmt::skip]
const EXPECTED: &[Expected] = &[
    row("avf_float.nii.gz", [74, 93, 20], 1, "RAS", "float32", (0.0, 2509.89)),
    row("avf_float.nrrd", [74, 93, 20], 1, "RAS", "float32", (0.0, 2509.89)),
    row("be_float.nii.gz", [64, 64, 21], 1, "LAS", "float32", (-8.71075, 18.5825)),
    row("be_int16.nii", [33, 41, 25], 1, "LAS", "int16", (-610.0, 30393.0)),
    row("brain_skullstripped_eun.nii.gz", [256, 190, 151], 1, "RAS", "uint8", (0.0, 180.0)),
    row("ct_abdomen_3mm.nii.gz", [122, 101, 112], 1, "RAS", "int32", (-1207.0, 3382.0)),
    row("ct_abdomen_3mm_slab.nii.gz", [122, 101, 30], 1, "RAS", "int16", (-1100.0, 1207.0)),
    row("ct_abdomen_3mm_slab_labels.nii.gz", [122, 101, 30], 1, "RAS", "uint8", (0.0, 117.0)),
    row("ct_abdomen_j2k_seg.nii.gz", [512, 512, 20], 1, "LAS", "uint8", (0.0, 117.0)),
    row("ct_head_gantry_tilt.nii.gz", [306, 422, 54], 1, "RAS", "uint8", (-1024.0, 789.0)),
    row("cta_heart_aorta.nii.gz", [120, 126, 164], 1, "LPS", "int16", (-1078.0, 3343.0)),
    row("cta_heart_aorta_aorta.nii.gz", [120, 126, 164], 1, "LPS", "uint8", (0.0, 1.0)),
    row("cta_heart_aorta_aorta_true_lumen.nii.gz", [120, 126, 164], 1, "LPS", "uint8", (0.0, 1.0)),
    row("cta_heart_aorta_vertebrae_T12.nii.gz", [120, 126, 164], 1, "LPS", "uint8", (0.0, 1.0)),
    row("cta_heart_aorta_T716_aorta_true_false_lumen.nii.gz", [120, 126, 164], 1, "LPS", "uint8", (0.0, 2.0)),
    row("ct_lung.mha", [115, 157, 129], 1, "LPS", "int16", (-1255.0, 1474.0)),
    row("ct_lung_mask.mha", [115, 157, 129], 1, "LPS", "uint8", (0.0, 1.0)),
    row("ct_lung_small.mha", [57, 78, 64], 1, "LPS", "int16", (-1130.0, 1379.0)),
    row("complex64.nii.gz", [64, 64, 44], 1, "RAS", "float32", (0.0, 2.71314e7)),
    row("edge_5d_small.nii", [1, 2, 3], 3, "PSR", "uint8", (0.076919, 0.780245)),
    row("edge_analyze.hdr", [62, 41, 34], 1, "RAS", "uint8", (0.0, 255.0)),
    row("edge_analyze.img", [62, 41, 34], 1, "RAS", "uint8", (0.0, 255.0)),
    row("edge_low_res_7x5x3.nii.gz", [7, 5, 3], 1, "RAS", "uint8", (0.0, 1.0)),
    row("edge_minimal_be.nii.gz", [64, 64, 10], 1, "LAS", "uint8", (0.0, 63.0)),
    row("edge_surface_163842x1x1.nii.gz", [163_842, 1, 1], 1, "LAS", "float32", (-13.653, 38.2033)),
    row("edge_with_extension_be.nii.gz", [161, 191, 151], 1, "LPI", "uint8", (0.0, 1.0)),
    row("fetal_brain_T2.nrrd", [117, 159, 126], 1, "LPS", "float32", (0.0, 710.678)),
    row("fuel.nii.gz", [64, 33, 32], 1, "RAS", "uint8", (0.0, 255.0)),
    row("labels256_LIA.nii.gz", [256, 256, 256], 1, "LIA", "uint8", (0.0, 2.0)),
    row("le_float.nii.gz", [64, 64, 21], 1, "LAS", "float32", (-8.71075, 18.5825)),
    row("macaque_labels.nii.gz", [168, 206, 128], 1, "RAS", "int16", (0.0, 1605.0)),
    row("macaque_t1.nii.gz", [168, 206, 128], 1, "RAS", "uint8", (0.0, 255.0)),
    row("mpld_asl_4d.nii.gz", [64, 64, 24], 25, "LAS", "float32", (0.0, 2839.0)),
    row("mr_abdomen_slab.nii.gz", [117, 91, 20], 1, "LPS", "int16", (-47.0, 833.0)),
    row("mr_abdomen_slab_labels.nii.gz", [117, 91, 20], 1, "LPS", "uint8", (0.0, 49.0)),
    row("one_slice_oblique.nii.gz", [192, 192, 1], 1, "PIR", "uint16", (0.0, 836.0)),
    row("one_slice_oblique.nrrd", [192, 192, 1], 1, "PIR", "uint16", (0.0, 836.0)),
    row("orient_RAS.nii.gz", [64, 79, 67], 1, "RAS", "uint8", (0.0, 92.5539)),
    row("orient_LPS.nii.gz", [64, 79, 67], 1, "LPS", "uint8", (0.0, 92.5539)),
    row("orient_ASR.nii.gz", [79, 67, 64], 1, "ASR", "uint8", (0.0, 92.5539)),
    row("orient_PIL.nii.gz", [79, 67, 64], 1, "PIL", "uint8", (0.0, 92.5539)),
    row("pcasl_4d.nii.gz", [52, 68, 20], 10, "RAS", "int16", (0.0, 2640.0)),
    row("scaled_4d.nii", [17, 21, 3], 20, "LAS", "int16", (629.826, 5571.62)),
    row("someones_anatomy.nii.gz", [57, 67, 56], 1, "RAS", "uint8", (6.67836, 96.5554)),
    row("someones_epi_oblique.nii.gz", [53, 61, 33], 1, "RAS", "uint8", (7.74255, 103.767)),
    row("square2d.mhd", [5, 6, 1], 1, "LPS", "float32", (0.0, 1.0)),
    row("spm152.nii.gz", [207, 256, 215], 1, "RAS", "uint8", (0.0, 90.7391)),
    row("spm152_tissue.nii.gz", [207, 256, 215], 1, "RAS", "uint8", (0.0, 3.0)),
    row("stroke_FLAIR.nii.gz", [124, 160, 140], 1, "RAS", "uint8", (0.0, 255.0)),
    row("stroke_FLAIR.nrrd", [124, 160, 140], 1, "RAS", "uint8", (0.0, 255.0)),
    row("stroke_T1.nii.gz", [124, 160, 140], 1, "RAS", "uint8", (0.0, 252.0)),
    row("stroke_T2.nii.gz", [124, 160, 140], 1, "RAS", "uint8", (0.0, 503.969)),
    row("stroke_lesion.nii.gz", [124, 160, 140], 1, "RAS", "uint8", (0.0, 3.0)),
    row("t1_nifti2.nii.gz", [91, 109, 91], 1, "LAS", "float32", (0.0, 255.0)),
    row("vectors_V1.nii.gz", [84, 92, 56], 3, "LAS", "float32", (-0.999996, 0.999994)),
];

const fn row(
    file: &'static str,
    dims: [usize; 3],
    num_frames: usize,
    letters: &'static str,
    element: &'static str,
    range: (f64, f64),
) -> Expected {
    Expected { file, dims, num_frames, letters, element, range }
}

fn read_frame(path: &Path, frame: usize) -> Volume {
    read_volume(path, &ReadOptions { frame, ..ReadOptions::default() }, &Progress::new())
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn read(path: &Path) -> Volume {
    read_frame(path, 0)
}

fn read_as(path: &Path, layout: &str) -> fabrica_engine::Result<Volume> {
    read_volume(path, &ReadOptions { raw: Some(layout.parse()?), ..ReadOptions::default() }, &Progress::new())
}

fn range(volume: &Volume) -> (f64, f64) {
    let statistics = volume.statistics(&Progress::new()).unwrap();
    (statistics.min, statistics.max)
}

#[test]
fn real_files_are_what_the_table_says() {
    for expected in EXPECTED {
        let Some(path) = fabrica_tests::data(expected.file) else { continue };
        let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
        for frame in 0..expected.num_frames {
            let volume = read_frame(&path, frame);
            assert_eq!(volume.grid.dims(), expected.dims, "{}", expected.file);
            assert_eq!(volume.num_frames, expected.num_frames, "{}", expected.file);
            assert_eq!(volume.grid.orientation_letters(), expected.letters, "{}", expected.file);
            assert_eq!(volume.voxels.type_name(), expected.element, "{}", expected.file);
            let statistics = volume.statistics(&Progress::new()).unwrap();
            assert_eq!(statistics.num_nonfinite, 0, "{}", expected.file);
            (min, max) = (min.min(statistics.min), max.max(statistics.max));
        }
        // The table has six digits.
        let tolerance = 1e-5 * (expected.range.0.abs() + expected.range.1.abs());
        assert!((min - expected.range.0).abs() < tolerance, "{}: minimum {min}", expected.file);
        assert!((max - expected.range.1).abs() < tolerance, "{}: maximum {max}", expected.file);
    }
}

#[test]
fn a_frame_too_many_is_refused_with_the_number_of_frames() {
    let Some(path) = fabrica_tests::data("pcasl_4d.nii.gz") else { return };
    let options = ReadOptions { frame: 10, ..ReadOptions::default() };
    let error = read_volume(&path, &options, &Progress::new()).unwrap_err().to_string();
    assert!(error.contains("there is no frame 10: the file has 10 frames; choose 0 to 9"), "{error}");
}

/// The voxel of `volume` at a world position, which must be the center of one.
fn value_at(volume: &Volume, world: DVec3) -> f64 {
    let index = volume.grid.index_from_world().transform_point3(world);
    assert!((index - index.round()).abs().max_element() < 1e-3, "no voxel center: {index}");
    let [x, y, z] = index.round().to_array().map(|i| i as usize);
    volume.value(x, y, z)
}

#[test]
fn one_head_in_four_orientations_agrees_in_the_world() {
    let Some(reference) = fabrica_tests::data("orient_RAS.nii.gz") else { return };
    let reference = read(&reference);
    for letters in ["LPS", "ASR", "PIL"] {
        let Some(path) = fabrica_tests::data(&format!("orient_{letters}.nii.gz")) else { continue };
        let other = read(&path);
        assert_eq!(other.grid.num_voxels(), reference.grid.num_voxels());
        let [nx, ny, nz] = other.grid.dims();
        let mut num_bright = 0;
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let world =
                        other.grid.world_from_index().transform_point3(DVec3::new(x as f64, y as f64, z as f64));
                    let value = other.value(x, y, z);
                    assert_eq!(value, value_at(&reference, world), "{letters} at {world}");
                    num_bright += usize::from(value > 50.0);
                }
            }
        }
        assert!(num_bright > 50_000, "an empty head agrees with anything");
    }
}

/// Two files of one volume: the same voxels at the same places.
fn assert_twins(a: &str, b: &str) {
    let (Some(a), Some(b)) = (fabrica_tests::data(a), fabrica_tests::data(b)) else { return };
    let (a, b) = (read(&a), read(&b));
    assert!(a.voxels == b.voxels, "the voxels differ");
    assert_eq!(a.rescale, b.rescale);
    let (p, q) = (a.grid.world_from_index(), b.grid.world_from_index());
    for corner in a.grid.box_corners_mm(DVec3::ZERO, DVec3::from_array(a.grid.dims().map(|n| n as f64))) {
        let moved = q.transform_point3(p.inverse().transform_point3(corner));
        assert!(moved.distance(corner) < 1e-3, "{corner} became {moved}");
    }
}

#[test]
fn volumes_of_colors_keep_their_colors() {
    for (file, dims, letters, type_name, alphas) in [
        ("rgb24_ct_perfusion.nii.gz", [256, 286, 15], "LAS", "rgb", (255, 255)),
        ("rgba32_thalamus_paqd.nii.gz", [59, 43, 31], "RAS", "rgba", (0, 255)),
    ] {
        let Some(path) = fabrica_tests::data(file) else { continue };
        let entry = survey(&path, &ReadOptions::default(), &Progress::new()).unwrap().remove(0);
        assert_eq!((entry.type_name, entry.num_frames), (type_name, 1));
        let volume = read(&path);
        assert_eq!((volume.grid.dims(), volume.grid.orientation_letters().as_str()), (dims, letters));
        let colors = volume.colors.as_ref().unwrap();
        assert_eq!(colors.len(), volume.grid.num_voxels());
        let (min, max) = colors.iter().fold((255, 0), |(min, max), c| (min.min(c[3]), max.max(c[3])));
        assert_eq!(min, alphas.0, "{file}");
        assert!(max > 0 && max <= alphas.1, "{file}: {max}");
        assert!(colors.iter().any(|c| c[0] != c[1] || c[1] != c[2]), "{file} is gray");
    }
}

#[test]
fn metaimages_of_one_scan_agree() {
    // The small one is the half of the large one: what is bone in one is at the same place in the other.
    let (Some(large), Some(small)) = (fabrica_tests::data("ct_lung.mha"), fabrica_tests::data("ct_lung_small.mha"))
    else {
        return;
    };
    let (large, small) = (read(&large), read(&small));
    let spacing = large.grid.spacing_mm();
    assert!(spacing.distance(DVec3::new(1.366, 1.366, 2.5)) < 1e-9, "{spacing}");
    let [nx, ny, nz] = small.grid.dims();
    let (mut sum, mut count) = (0.0, 0.0);
    for (x, y, z) in (2..nz - 2).flat_map(|z| (2..ny - 2).flat_map(move |y| (2..nx - 2).map(move |x| (x, y, z)))) {
        let world = small.grid.world_from_index().transform_point3(DVec3::new(x as f64, y as f64, z as f64));
        let index = large.grid.index_from_world().transform_point3(world).round();
        let [i, j, k] = index.to_array().map(|c| c as usize);
        sum += (small.value(x, y, z) - large.value(i, j, k)).abs();
        count += 1.0;
    }
    assert!(sum / count < 120.0, "they differ by {} HU", sum / count);
}

#[test]
fn nrrd_and_nifti_of_one_volume_agree() {
    assert_twins("avf_float.nrrd", "avf_float.nii.gz");
    assert_twins("stroke_FLAIR.nrrd", "stroke_FLAIR.nii.gz");
    assert_twins("one_slice_oblique.nrrd", "one_slice_oblique.nii.gz");
}

#[test]
fn both_byte_orders_of_one_volume_agree() {
    assert_twins("be_float.nii.gz", "le_float.nii.gz");
}

#[test]
fn the_letter_r_is_on_the_right() {
    // The MNI head with letters burned in through all slices, whiter than anything else: an R, which has half
    // as many voxels again as the L, and the L, whose stem has to be towards the right to be legible from below.
    let Some(path) = fabrica_tests::data("t1_nifti2.nii.gz") else { return };
    let volume = read(&path);
    let [nx, ny, nz] = volume.grid.dims();
    let (mut right, mut left) = (Vec::new(), Vec::new());
    for (x, y, z) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (x, y, z)))) {
        if volume.value(x, y, z) >= 254.0 {
            let world = volume.grid.world_from_index().transform_point3(DVec3::new(x as f64, y as f64, z as f64));
            if world.x > 10.0 {
                right.push(world)
            } else if world.x < -10.0 {
                left.push(world)
            }
        }
    }
    assert!(left.len() > 10_000 && right.len() as f64 > 1.3 * left.len() as f64, "{} {}", left.len(), right.len());
    let middle_y = left.iter().map(|p| p.y).sum::<f64>() / left.len() as f64;
    let mean_x = |is_upper: bool| {
        let part: Vec<_> = left.iter().filter(|p| (p.y > middle_y) == is_upper).map(|p| p.x).collect();
        part.iter().sum::<f64>() / part.len() as f64
    };
    assert!(mean_x(true) > mean_x(false) + 5.0, "{} {}", mean_x(true), mean_x(false));
}

#[test]
fn a_tilted_gantry_keeps_its_shear() {
    let Some(path) = fabrica_tests::data("ct_head_gantry_tilt.nii.gz") else { return };
    let volume = read(&path);
    let m = volume.grid.world_from_index().matrix3;
    let cosine = m.y_axis.normalize().dot(m.z_axis.normalize());
    assert!((cosine.acos().to_degrees() - 71.5).abs() < 0.1, "{}", cosine.acos().to_degrees());
    assert!(volume.warnings.iter().any(|w| w.contains("the sform is used")), "{:?}", volume.warnings);
}

#[test]
fn a_volume_without_a_place_says_so() {
    let Some(path) = fabrica_tests::data("edge_minimal_be.nii.gz") else { return };
    let warnings = read(&path).warnings;
    assert!(warnings.iter().any(|w| w.contains("left and right may be swapped")), "{warnings:?}");
}

#[test]
fn every_mask_of_a_folder_is_read() {
    let Some(folder) = fabrica_tests::data("ct_abdomen_3mm_masks") else { return };
    let (mut num_masks, mut num_used) = (0, 0);
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if !path.to_string_lossy().ends_with(".nii.gz") {
            continue;
        }
        let mask = read(&path);
        assert_eq!(mask.grid.dims(), [122, 101, 30]);
        num_masks += 1;
        num_used += usize::from(range(&mask) == (0.0, 1.0));
    }
    assert_eq!((num_masks, num_used), (117, 40));
}

#[test]
fn raw_files_need_a_layout() {
    let Some(fuel) = fabrica_tests::data("fuel_64x33x32_uint8.raw") else { return };
    let error = read_volume(&fuel, &ReadOptions::default(), &Progress::new()).unwrap_err().to_string();
    assert!(error.contains("--raw 64x33x32xuint8,1x1x1,little"), "{error}");
    let raw = read_as(&fuel, "64x33x32xuint8").unwrap();
    assert_eq!(raw.rescale, Rescale::IDENTITY);
    assert_eq!(range(&raw), (0.0, 255.0));
    if let Some(nifti) = fabrica_tests::data("fuel.nii.gz") {
        assert!(read(&nifti).voxels == raw.voxels);
    }
    let error = read_as(&fuel, "64x33x32xuint16").unwrap_err().to_string();
    assert!(error.contains("needs 135168 bytes, but the file has 67584"), "{error}");
    if let Some(engine) = fabrica_tests::data("engine_256x256x128_uint8.raw") {
        let engine = read_as(&engine, "256x256x128xuint8").unwrap();
        assert_eq!((engine.grid.dims(), range(&engine)), ([256, 256, 128], (0.0, 255.0)));
    }
}

#[test]
fn what_is_no_scalar_volume_is_refused_with_a_sentence() {
    for (file, expected) in [
        ("edge_not_nifti.nii", "this is no NIfTI file"),
        ("2D_2x2_square_object_at_(1,3).raw", "a raw file does not say how its voxels lie"),
        ("matcaps/matcap-gold.png", "this is a single PNG picture, not a volume"),
        ("edge_analyze_missing_img.hdr", "edge_analyze_missing_img.img, is missing"),
        ("README.md", "no volume in a format that Fabrica reads"),
    ] {
        let Some(path) = fabrica_tests::data(file) else { continue };
        let error = read_volume(&path, &ReadOptions::default(), &Progress::new()).expect_err(file).to_string();
        assert!(error.contains(expected) && error.contains("; "), "{error}");
        assert!(error.ends_with(&format!("({})", path.display())), "{error}");
    }
}

#[test]
fn statistics_of_a_ct_separate_body_from_air() {
    let Some(path) = fabrica_tests::data("ct_abdomen_3mm.nii.gz") else { return };
    let ct = Statistics::compute(&read(&path), &Progress::new()).unwrap();
    assert_eq!((ct.min, ct.max, ct.num_nonfinite), (-1207.0, 3382.0, 0));
    assert!((-700.0..-300.0).contains(&ct.background), "{}", ct.background);
    // Half of the body is soft tissue and fat.
    assert!((-120.0..80.0).contains(&ct.percentile_above_background(50.0)));
    assert!(ct.percentile(1.0) < -900.0 && ct.percentile(99.9) > 200.0);
}
