//! Segmentations.

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::tags;
use glam::DVec3;

use super::build::*;
use crate::progress::Progress;
use crate::read::testing::{Folder, read};
use crate::read::{ReadOptions, read_labels};

fn item(fill: impl Fn(&mut Object)) -> Object {
    let mut item = Object::new_empty();
    fill(&mut item);
    item
}

/// Three structures on slices of 3 x 3 pixels: two that overlap and one elsewhere; slice 1 of 4 is empty.
pub fn segmentation() -> Object {
    // Structure, place, pixels.
    let frames: [(u16, f64, u16); 5] = [
        (1, 12.0, 0b000_000_111),
        (1, 16.0, 0b000_000_001),
        (2, 12.0, 0b000_001_001),
        (3, 18.0, 0b100_000_000),
        (1, 18.0, 0b011_000_000),
    ];
    let mut o = picture([3, 3], &[]);
    text(&mut o, tags::SOP_CLASS_UID, VR::UI, "1.2.840.10008.5.1.4.1.1.66.4");
    text(&mut o, tags::MODALITY, VR::CS, "SEG");
    text(&mut o, tags::SEGMENTATION_TYPE, VR::CS, "BINARY");
    text(&mut o, tags::NUMBER_OF_FRAMES, VR::IS, "5");
    put(&mut o, tags::BITS_ALLOCATED, VR::US, 1_u16);
    put(&mut o, tags::BITS_STORED, VR::US, 1_u16);
    put(&mut o, tags::HIGH_BIT, VR::US, 0_u16);
    // Nine bits a frame: none but the first begins with a byte.
    let bits: u64 = frames.iter().enumerate().map(|(i, f)| u64::from(f.2) << (9 * i)).sum();
    put(&mut o, tags::PIXEL_DATA, VR::OB, PrimitiveValue::U8(bits.to_le_bytes()[..6].to_vec().into()));
    let names = ["liver", "tumor", "Milz"];
    let segments = (1_u16..).zip(names).map(|(number, name)| {
        item(|s| {
            put(s, tags::SEGMENT_NUMBER, VR::US, number);
            text(s, tags::SEGMENT_LABEL, VR::LO, name);
            let code = item(|c| {
                text(c, tags::CODE_VALUE, VR::SH, "10200004");
                text(c, tags::CODING_SCHEME_DESIGNATOR, VR::SH, "SCT");
                let side = item(|m| {
                    text(m, tags::CODE_VALUE, VR::SH, "7771000");
                    text(m, tags::CODING_SCHEME_DESIGNATOR, VR::SH, "SCT");
                });
                if number == 2 {
                    items(c, tags::SEGMENTED_PROPERTY_TYPE_MODIFIER_CODE_SEQUENCE, vec![side]);
                }
            });
            items(s, tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE, vec![code]);
            let lab = PrimitiveValue::U16(vec![65_535, 0x8080, 0x8080].into());
            put(s, tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE, VR::US, lab);
        })
    });
    items(&mut o, tags::SEGMENT_SEQUENCE, segments.collect());
    let shared = item(|g| {
        let axes = item(|i| decimals(i, tags::IMAGE_ORIENTATION_PATIENT, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]));
        items(g, tags::PLANE_ORIENTATION_SEQUENCE, vec![axes]);
        let measures = item(|i| {
            decimals(i, tags::PIXEL_SPACING, &[0.5, 0.75]);
            decimals(i, tags::SLICE_THICKNESS, &[2.0]);
        });
        items(g, tags::PIXEL_MEASURES_SEQUENCE, vec![measures]);
    });
    items(&mut o, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, vec![shared]);
    let per_frame = frames.iter().map(|(segment, z, _)| {
        item(|g| {
            let position = item(|i| decimals(i, tags::IMAGE_POSITION_PATIENT, &[1.0, 2.0, *z]));
            items(g, tags::PLANE_POSITION_SEQUENCE, vec![position]);
            let number = item(|i| put(i, tags::REFERENCED_SEGMENT_NUMBER, VR::US, *segment));
            items(g, tags::SEGMENT_IDENTIFICATION_SEQUENCE, vec![number]);
        })
    });
    items(&mut o, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, per_frame.collect());
    o
}

fn layers(object: &Object, syntax: &str) -> Vec<crate::volume::labels::LabelMap> {
    let folder = Folder::new();
    read_labels(&folder.write("seg.dcm", &bytes(object, syntax)), &ReadOptions::default(), &Progress::new()).unwrap()
}

#[test]
fn structures_that_overlap_are_layers_and_the_rest_is_where_it_is() {
    for syntax in [EXPLICIT, IMPLICIT, DEFLATED] {
        let layers = layers(&segmentation(), syntax);
        assert_eq!(layers.len(), 2);
        let grid = layers[0].grid;
        assert_eq!(grid.dims(), [3, 3, 4]);
        assert_eq!(grid.world_from_index().transform_point3(DVec3::ZERO), DVec3::new(-1.0, -2.0, 12.0));
        assert_eq!(grid.spacing_mm(), DVec3::new(0.75, 0.5, 2.0));
        let names: Vec<_> = layers[0].labels.iter().map(|l| (l.id, l.name.as_str())).collect();
        assert_eq!(names, [(0, "background"), (1, "liver"), (3, "Milz")]);
        assert_eq!(layers[0].voxels[..9], [1, 1, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(layers[0].voxels[9..18], [0; 9]);
        assert_eq!(layers[0].voxels[18..27], [1, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(layers[0].voxels[27..], [0, 0, 0, 0, 0, 0, 1, 1, 2]);
        assert_eq!(
            (layers[1].labels[1].name.as_str(), &layers[1].voxels[..9]),
            ("tumor", &[1, 0, 0, 1, 0, 0, 0, 0, 0][..])
        );
        let liver = &layers[0].labels[1];
        assert_eq!(liver.code.as_deref(), Some("SCT:10200004"));
        assert_eq!(layers[1].labels[1].code.as_deref(), Some("SCT:10200004+SCT:7771000"), "which side is lost");
        assert!(liver.color.iter().all(|c| *c >= 253), "{:?}", liver.color);
    }
}

#[test]
fn as_a_volume_it_has_the_numbers_of_the_first_layer() {
    let folder = Folder::new();
    let path = folder.write("seg.dcm", &bytes(&segmentation(), EXPLICIT));
    let volume = read(&path).unwrap();
    assert_eq!((volume.value(8 % 3, 2, 3), volume.voxels.type_name()), (3.0, "uint8"));
    assert!(volume.warnings[0].contains("of 2 layers this is the first"));
    let entries = crate::read::survey(&path, &ReadOptions::default(), &Progress::new()).unwrap();
    assert!(entries[0].is_labels && entries[0].key.starts_with("SEG Phantom 1.0 3x3x4"), "{}", entries[0].key);
}

#[test]
fn fractions_are_cut_at_half_and_label_maps_are_numbers() {
    let mut fractions = segmentation();
    text(&mut fractions, tags::SEGMENTATION_TYPE, VR::CS, "FRACTIONAL");
    put(&mut fractions, tags::MAXIMUM_FRACTIONAL_VALUE, VR::US, 200_u16);
    for (tag, bits) in [(tags::BITS_ALLOCATED, 8_u16), (tags::BITS_STORED, 8), (tags::HIGH_BIT, 7)] {
        put(&mut fractions, tag, VR::US, bits);
    }
    let mut pixels = vec![0_u8; 46];
    pixels[..4].copy_from_slice(&[99, 100, 200, 1]);
    put(&mut fractions, tags::PIXEL_DATA, VR::OB, PrimitiveValue::U8(pixels.clone().into()));
    assert_eq!(layers(&fractions, EXPLICIT)[0].voxels[..4], [0, 1, 1, 0]);
    let mut numbers = fractions;
    text(&mut numbers, tags::SEGMENTATION_TYPE, VR::CS, "LABELMAP");
    text(&mut numbers, tags::SOP_CLASS_UID, VR::UI, "1.2.840.10008.5.1.4.1.1.66.7");
    text(&mut numbers, tags::NUMBER_OF_FRAMES, VR::IS, "1");
    pixels[..4].copy_from_slice(&[0, 3, 1, 77]);
    put(&mut numbers, tags::PIXEL_DATA, VR::OB, PrimitiveValue::U8(pixels[..10].to_vec().into()));
    let map = &layers(&numbers, EXPLICIT)[0];
    let names: Vec<_> = map.voxels[..4].iter().map(|v| map.labels[usize::from(*v)].name.as_str()).collect();
    assert_eq!(names, ["background", "Milz", "liver", "77"]);
}
