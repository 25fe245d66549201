//! Where slices lie.

use dicom_core::VR;
use dicom_dictionary_std::tags;
use glam::DVec3;

use super::build::*;
use crate::read::testing::{Folder, Phantom, all_orientations, read};

#[test]
fn the_phantom_lies_where_it_is_in_every_orientation_and_syntax() {
    for (i, letters) in all_orientations().iter().enumerate() {
        let folder = Folder::new();
        let syntax = [EXPLICIT, IMPLICIT, BIG_ENDIAN, DEFLATED][i % 4];
        let paths = write(&folder, &slices(letters), syntax);
        let volume = read(folder.path()).unwrap();
        Phantom::assert_in_world(&volume);
        assert_eq!(volume.warnings, Vec::<String>::new(), "{letters}");
        assert!(volume.orientation.is_known());
        // One slice stands for its series.
        Phantom::assert_in_world(&read(&paths[1]).unwrap());
    }
}

#[test]
fn slices_without_a_place_are_known_to_lie_anywhere() {
    // Without positions, the directions of rows and columns do not tell which end is up; without those, nothing does.
    for (tags, num_slices, is_known) in [
        (&[tags::IMAGE_POSITION_PATIENT][..], 3, false),
        (&[tags::IMAGE_POSITION_PATIENT], 1, true),
        (&[tags::IMAGE_POSITION_PATIENT, tags::IMAGE_ORIENTATION_PATIENT], 1, false),
    ] {
        let folder = Folder::new();
        let mut slices = slices("LPS");
        slices.truncate(num_slices);
        for slice in &mut slices {
            assert!(tags.iter().all(|tag| slice.remove_element(*tag)));
        }
        write(&folder, &slices, EXPLICIT);
        let volume = read(folder.path()).unwrap();
        assert_eq!(volume.orientation.is_known(), is_known, "{num_slices} without {tags:?}");
        assert_eq!(volume.warnings.iter().any(|w| w.contains("how it lies in the body")), !is_known);
    }
}

#[test]
fn files_without_preamble_and_meta_are_read() {
    for syntax in [EXPLICIT, IMPLICIT] {
        let folder = Folder::new();
        for (i, slice) in slices("LPS").iter().enumerate() {
            folder.write(&format!("{i}.bin"), &data_set(slice, syntax));
        }
        Phantom::assert_in_world(&read(folder.path()).unwrap());
    }
}

#[test]
fn an_enhanced_object_is_sorted_by_the_places_of_its_frames() {
    for letters in ["LPS", "PIL", "ASR"] {
        let phantom = Phantom::oriented(letters);
        let [nx, ny, nz] = phantom.dims;
        let order: Vec<usize> = (0..nz).map(|k| (k * 2 + 1) % nz).collect();
        let order = if nz % 2 == 0 { (0..nz).rev().collect() } else { order };
        let pixels: Vec<f64> = order.iter().flat_map(|k| phantom.values[k * nx * ny..][..nx * ny].to_vec()).collect();
        let mut o = picture([nx, ny], &pixels);
        text(&mut o, tags::NUMBER_OF_FRAMES, VR::IS, &nz.to_string());
        let (axes, spacing, _) = frame(&phantom);
        let item = |fill: &dyn Fn(&mut Object)| {
            let mut item = Object::new_empty();
            fill(&mut item);
            item
        };
        let shared = item(&|shared| {
            items(
                shared,
                tags::PLANE_ORIENTATION_SEQUENCE,
                vec![item(&|i| decimals(i, tags::IMAGE_ORIENTATION_PATIENT, &axes))],
            );
            items(
                shared,
                tags::PIXEL_MEASURES_SEQUENCE,
                vec![item(&|i| decimals(i, tags::PIXEL_SPACING, &[spacing[1], spacing[0]]))],
            );
            items(
                shared,
                tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE,
                vec![item(&|i| {
                    decimals(i, tags::RESCALE_SLOPE, &[2.0]);
                    decimals(i, tags::RESCALE_INTERCEPT, &[-10.0]);
                })],
            );
        });
        let per_frame = order.iter().map(|&k| {
            let (_, _, position) = frame_at(&phantom, k);
            item(&|frame| {
                items(
                    frame,
                    tags::PLANE_POSITION_SEQUENCE,
                    vec![item(&|i| decimals(i, tags::IMAGE_POSITION_PATIENT, &position.to_array()))],
                );
            })
        });
        items(&mut o, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, vec![shared]);
        items(&mut o, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, per_frame.collect());
        for syntax in [EXPLICIT, IMPLICIT, DEFLATED] {
            let folder = Folder::new();
            let mut volume = folder.read("enhanced.dcm", &bytes(&o, syntax)).unwrap();
            assert_eq!((volume.rescale.slope, volume.rescale.intercept), (2.0, -10.0));
            volume.rescale = crate::volume::Rescale::IDENTITY;
            Phantom::assert_in_world(&volume);
        }
    }
}

/// Slices of 4 x 4 pixels of 1 mm at these places, each of one value: its place's hundredfold.
fn stack(places: &[f64], sideways: impl Fn(f64) -> f64) -> Vec<Object> {
    let slice = |(i, z): (usize, &f64)| {
        let mut o = picture([4, 4], &[z * 100.0; 16]);
        text(&mut o, tags::SOP_INSTANCE_UID, VR::UI, &format!("1.2.826.0.1.3680043.7.{i}"));
        decimals(&mut o, tags::IMAGE_POSITION_PATIENT, &[0.0, sideways(*z), *z]);
        decimals(&mut o, tags::IMAGE_ORIENTATION_PATIENT, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        decimals(&mut o, tags::PIXEL_SPACING, &[1.0, 1.0]);
        o
    };
    places.iter().enumerate().map(slice).collect()
}

fn read_stack(places: &[f64], sideways: impl Fn(f64) -> f64) -> crate::Result<crate::volume::Volume> {
    let folder = Folder::new();
    write(&folder, &stack(places, sideways), EXPLICIT);
    read(folder.path())
}

#[test]
fn a_tilted_gantry_makes_a_sheared_volume() {
    let volume = read_stack(&[0.0, 2.0, 4.0, 6.0], |z| 0.25 * z).unwrap();
    let step = volume.grid.world_from_index().matrix3.z_axis;
    assert!((step - DVec3::new(0.0, -0.5, 2.0)).length() < 1e-9, "{step}");
    assert!(volume.warnings[0].contains("lean by 14.0°"), "{:?}", volume.warnings);
    // Shifted by no rule.
    let error = read_stack(&[0.0, 2.0, 4.0, 6.0], |z| if z == 4.0 { 3.0 } else { 0.0 }).unwrap_err().to_string();
    assert!(error.contains("shifted sideways against each other by up to 3.00 mm"), "{error}");
}

#[test]
fn missing_slices_are_interpolated_and_named() {
    let volume = read_stack(&[0.0, 1.0, 2.0, 3.0, 6.0, 7.0, 8.0], |_| 0.0).unwrap();
    assert_eq!(volume.grid.dims(), [4, 4, 9]);
    for z in 0..9 {
        assert_eq!(volume.value(1, 2, z), 100.0 * z as f64);
    }
    let expected = "2 of 9 slices are missing (after slice 4) and interpolated from the neighbors.";
    assert_eq!(volume.warnings, [expected]);
    // A volume that would be invented for the most part is none.
    let far = [0.0, 1.0, 2.0, 9.0, 10.0, 19.0, 20.0];
    let error = read_stack(&far, |_| 0.0).unwrap_err().to_string();
    assert!(error.contains("too unevenly") && error.contains("add the slices that are missing"), "{error}");
}

#[test]
fn uneven_slices_are_made_even_and_rounding_is_let_pass() {
    let volume = read_stack(&[0.0, 1.0, 2.0, 3.0, 4.5, 6.0, 7.5], |_| 0.0).unwrap();
    let last = volume.grid.dims()[2] - 1;
    let top = volume.grid.world_from_index().transform_point3(DVec3::new(0.0, 0.0, last as f64));
    assert!((top.z - 7.5).abs() < 1e-9, "{top}");
    for z in 0..=last {
        let place = volume.grid.world_from_index().transform_point3(DVec3::new(0.0, 0.0, z as f64)).z;
        assert!((volume.value(0, 0, z) - 100.0 * place).abs() <= 10.0, "{z}");
    }
    assert!(volume.warnings[0].contains("The slices lie 1.00 to 1.50 mm apart"), "{:?}", volume.warnings);
    // Positions in tenths of a millimeter of slices 0.625 mm apart.
    let volume = read_stack(&[0.0, 0.6, 1.3, 1.9, 2.5, 3.1, 3.8], |_| 0.0).unwrap();
    assert_eq!(volume.grid.dims()[2], 7);
    assert!(volume.warnings[0].contains("off their places"), "{:?}", volume.warnings);
    assert_eq!(read_stack(&[0.0, 1.0, 2.001, 3.0], |_| 0.0).unwrap().warnings, Vec::<String>::new());
    // A far-off slice.
    let error = read_stack(&[0.0, 1.0, 2.0, 400.0], |_| 0.0).unwrap_err().to_string();
    assert!(error.contains("1.00 to 398.00 mm apart, too unevenly"), "{error}");
}

#[test]
fn a_single_slice_is_a_volume_of_one() {
    let volume = read_stack(&[5.0], |_| 0.0).unwrap();
    assert_eq!(volume.grid.dims(), [4, 4, 1]);
    assert_eq!(volume.grid.world_from_index().translation, DVec3::new(0.0, -0.0, 5.0));
}

#[test]
fn several_slices_at_each_place_are_frames() {
    let mut all = Vec::new();
    for time in [2.0, 1.0, 3.0] {
        for (i, mut slice) in stack(&[0.0, 1.0, 2.0], |_| 0.0).into_iter().enumerate() {
            text(&mut slice, tags::SOP_INSTANCE_UID, VR::UI, &format!("1.2.826.0.1.3680043.8.{time}{i}"));
            text(&mut slice, tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS, &time.to_string());
            put(&mut slice, tags::PIXEL_DATA, VR::OW, words(&[time * 10.0 + i as f64; 16]));
            all.push(slice);
        }
    }
    let folder = Folder::new();
    write(&folder, &all, EXPLICIT);
    for frame in 0..3 {
        let volume = crate::read::testing::read_frame(folder.path(), frame).unwrap();
        assert_eq!((volume.num_frames, volume.grid.dims()), (3, [4, 4, 3]));
        assert_eq!(volume.value(0, 0, 2), (frame + 1) as f64 * 10.0 + 2.0);
        assert!(volume.warnings[0].contains("3 slices, which became frames in the order of their time point"));
    }
    // One slice too few, and nothing tells the rest apart.
    let odd: Vec<Object> = all[..8]
        .iter()
        .cloned()
        .map(|mut s| {
            s.remove_element(tags::TEMPORAL_POSITION_IDENTIFIER);
            s
        })
        .collect();
    let folder = Folder::new();
    write(&folder, &odd, EXPLICIT);
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("some have 2 slices and some 3"), "{error}");
}
