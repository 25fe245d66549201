//! What the numbers of pixels become.

use dicom_core::value::PixelFragmentSequence;
use dicom_core::{DataElement, PrimitiveValue, VR};
use dicom_dictionary_std::tags;

use super::build::*;
use crate::read::testing::{Folder, Phantom, read};
use crate::volume::Volume;

fn read_one(change: impl Fn(&mut Object)) -> Volume {
    let mut object = picture([4, 1], &[0.0; 4]);
    decimals(&mut object, tags::PIXEL_SPACING, &[1.0, 1.0]);
    change(&mut object);
    Folder::new().read("a.dcm", &bytes(&object, EXPLICIT)).unwrap()
}

fn values(volume: &Volume) -> Vec<f64> {
    (0..4).map(|x| volume.value(x, 0, 0)).collect()
}

#[test]
fn slices_with_a_rescale_each_become_values() {
    // In whole numbers: exactly; else in f32.
    for (slopes, element) in [([1.0, 2.0, 3.0], "int16"), ([0.5, 0.25, 2.0], "float32"), ([2.0, 2.0, 2.0], "uint16")] {
        let mut all = slices("LPS");
        for (k, slice) in all.iter_mut().enumerate() {
            decimals(slice, tags::RESCALE_SLOPE, &[slopes[k]]);
            decimals(slice, tags::RESCALE_INTERCEPT, &[-5.0]);
            if element == "int16" {
                put(slice, tags::BITS_STORED, VR::US, 12_u16);
                put(slice, tags::HIGH_BIT, VR::US, 11_u16);
            }
        }
        let folder = Folder::new();
        write(&folder, &all, EXPLICIT);
        let volume = read(folder.path()).unwrap();
        assert_eq!(volume.voxels.type_name(), element);
        let phantom = Phantom::oriented("LPS");
        for (k, slope) in slopes.iter().enumerate() {
            assert_eq!(volume.value(2, 1, k), phantom.values[2 + 5 * (1 + 4 * k)] * slope - 5.0);
        }
    }
}

#[test]
fn bits_that_do_not_belong_are_removed_and_signs_extended() {
    // 12 bits in 16, with an overlay above them.
    let volume = read_one(|o| {
        put(o, tags::BITS_STORED, VR::US, 12_u16);
        put(o, tags::HIGH_BIT, VR::US, 11_u16);
        put(o, tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(vec![0x1001, 0x0fff, 0xf800, 0x07ff].into()));
    });
    assert_eq!(values(&volume), [1.0, 4095.0, 2048.0, 2047.0]);
    let volume = read_one(|o| {
        put(o, tags::BITS_STORED, VR::US, 12_u16);
        put(o, tags::HIGH_BIT, VR::US, 11_u16);
        put(o, tags::PIXEL_REPRESENTATION, VR::US, 1_u16);
        put(o, tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(vec![0x1001, 0x0fff, 0xf800, 0x07ff].into()));
    });
    assert_eq!((values(&volume), volume.voxels.type_name()), (vec![1.0, -1.0, -2048.0, 2047.0], "int16"));
    // In the upper bits.
    let volume = read_one(|o| {
        put(o, tags::BITS_STORED, VR::US, 12_u16);
        put(o, tags::HIGH_BIT, VR::US, 15_u16);
        put(o, tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(vec![0x1000, 0xffff, 0x0017, 0x8000].into()));
    });
    assert_eq!(values(&volume), [256.0, 4095.0, 1.0, 2048.0]);
}

#[test]
fn padding_of_a_ct_becomes_air_and_bright_padding_of_others_dark() {
    let padded = |modality: &str, padding: i16, pixels: [f64; 4]| {
        read_one(|o| {
            text(o, tags::MODALITY, VR::CS, modality);
            put(o, tags::PIXEL_REPRESENTATION, VR::US, 1_u16);
            o.put(DataElement::new(tags::PIXEL_PADDING_VALUE, VR::SS, PrimitiveValue::from(padding)));
            put(o, tags::PIXEL_DATA, VR::OW, words(&pixels));
        })
    };
    let volume = padded("CT", -2000, [-2000.0, -1024.0, 40.0, 1000.0]);
    assert_eq!(values(&volume), [-1024.0, -1024.0, 40.0, 1000.0]);
    assert!(volume.warnings.iter().any(|w| w.contains("padding")), "{:?}", volume.warnings);
    assert_eq!(values(&padded("MR", 0, [0.0, 50.0, 60.0, 70.0])), [0.0, 50.0, 60.0, 70.0]);
    assert_eq!(values(&padded("MR", 32_000, [32_000.0, 50.0, 60.0, 70.0])), [50.0, 50.0, 60.0, 70.0]);
    let none = padded("CT", -2000, [-1000.0, -1024.0, 40.0, 1000.0]);
    assert!(!none.warnings.iter().any(|w| w.contains("padding")));
    // The stored bits are fewer than padding needs.
    let volume = read_one(|o| {
        put(o, tags::BITS_STORED, VR::US, 12_u16);
        put(o, tags::HIGH_BIT, VR::US, 11_u16);
        put(o, tags::PIXEL_PADDING_VALUE, VR::US, 63_536_u16);
        put(o, tags::PIXEL_DATA, VR::OW, words(&[63_536.0, 10.0, 20.0, 4095.0]));
    });
    assert_eq!(values(&volume), [10.0, 10.0, 20.0, 4095.0]);
}

#[test]
fn negatives_are_turned_around_unless_they_are_measurements() {
    let read = |modality: &str| {
        read_one(|o| {
            text(o, tags::MODALITY, VR::CS, modality);
            text(o, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME1");
            put(o, tags::BITS_STORED, VR::US, 10_u16);
            put(o, tags::HIGH_BIT, VR::US, 9_u16);
            put(o, tags::PIXEL_DATA, VR::OW, words(&[0.0, 1.0, 1000.0, 1023.0]));
        })
    };
    assert_eq!(values(&read("DX")), [1023.0, 1022.0, 23.0, 0.0]);
    assert_eq!(values(&read("PT")), [0.0, 1.0, 1000.0, 1023.0]);
    assert!(read("DX").warnings.iter().any(|w| w.contains("(MONOCHROME1): its values were turned around")));
    assert!(read("PT").warnings.iter().any(|w| w.contains("as they were measured")));
}

#[test]
fn colors_are_colors() {
    let rgb = |photometric: &str, planar: u16, pixels: [u8; 12]| {
        let volume = read_one(|o| {
            text(o, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, photometric);
            put(o, tags::SAMPLES_PER_PIXEL, VR::US, 3_u16);
            put(o, tags::PLANAR_CONFIGURATION, VR::US, planar);
            put(o, tags::BITS_ALLOCATED, VR::US, 8_u16);
            put(o, tags::BITS_STORED, VR::US, 8_u16);
            put(o, tags::HIGH_BIT, VR::US, 7_u16);
            put(o, tags::PIXEL_DATA, VR::OB, PrimitiveValue::U8(pixels.to_vec().into()));
        });
        volume.colors.unwrap()
    };
    let expected = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 8, 7, 255]];
    assert_eq!(rgb("RGB", 0, [255, 0, 0, 0, 255, 0, 0, 0, 255, 9, 8, 7]), expected);
    assert_eq!(rgb("RGB", 1, [255, 0, 0, 9, 0, 255, 0, 8, 0, 0, 255, 7]), expected);
    let ybr = rgb("YBR_FULL", 0, [76, 85, 255, 150, 44, 21, 29, 255, 107, 8, 127, 129]);
    for (got, want) in ybr.iter().zip(expected) {
        assert!((0..3).all(|i| got[i].abs_diff(want[i]) <= 3), "{ybr:?}");
    }
    let palette = read_one(|o| {
        text(o, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "PALETTE COLOR");
        for (i, (descriptor, table)) in [
            (tags::RED_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR, tags::RED_PALETTE_COLOR_LOOKUP_TABLE_DATA),
            (tags::GREEN_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR, tags::GREEN_PALETTE_COLOR_LOOKUP_TABLE_DATA),
            (tags::BLUE_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR, tags::BLUE_PALETTE_COLOR_LOOKUP_TABLE_DATA),
        ]
        .into_iter()
        .enumerate()
        {
            put(o, descriptor, VR::US, PrimitiveValue::U16(vec![3, 10, 16].into()));
            let levels: Vec<u16> = (0..3).map(|n| if n == i { 0xff00 } else { 0 }).collect();
            put(o, table, VR::OW, PrimitiveValue::U16(levels.into()));
        }
        put(o, tags::PIXEL_DATA, VR::OW, words(&[10.0, 11.0, 12.0, 500.0]));
    });
    assert_eq!(palette.colors.unwrap(), [expected[0], expected[1], expected[2], expected[2]]);
}

#[test]
fn floats_and_single_bits_are_read() {
    let volume = read_one(|o| {
        o.remove_element(tags::PIXEL_DATA);
        put(o, tags::BITS_ALLOCATED, VR::US, 32_u16);
        put(o, tags::FLOAT_PIXEL_DATA, VR::OF, PrimitiveValue::F32(vec![0.5, -1.25, 3e9, 0.0].into()));
    });
    assert_eq!((values(&volume), volume.voxels.type_name()), (vec![0.5, -1.25, 3e9, 0.0], "float32"));
    let volume = read_one(|o| {
        put(o, tags::BITS_ALLOCATED, VR::US, 1_u16);
        put(o, tags::BITS_STORED, VR::US, 1_u16);
        put(o, tags::HIGH_BIT, VR::US, 0_u16);
        put(o, tags::PIXEL_DATA, VR::OB, PrimitiveValue::U8(vec![0b1011, 0].into()));
    });
    assert_eq!(values(&volume), [1.0, 1.0, 0.0, 1.0]);
}

/// A file whose pixels are these fragments.
fn packed(syntax: &str, fragments: Vec<Vec<u8>>, change: impl Fn(&mut Object)) -> Vec<u8> {
    let mut object = picture([4, 1], &[0.0; 4]);
    decimals(&mut object, tags::PIXEL_SPACING, &[1.0, 1.0]);
    change(&mut object);
    object.put(DataElement::new(tags::PIXEL_DATA, VR::OB, PixelFragmentSequence::new_fragments(fragments)));
    bytes(&object, syntax)
}

#[test]
fn run_lengths_are_unpacked_and_damaged_ones_refused() {
    let mut frame = vec![0; 64];
    frame[0] = 2;
    frame[4] = 64;
    frame[8] = 68;
    // High bytes 1 1 1 2, low bytes 5 6 7 8.
    frame.extend([254, 1, 0, 2]);
    frame.extend([3, 5, 6, 7, 8, 128]);
    let folder = Folder::new();
    let rle = "1.2.840.10008.1.2.5";
    let volume = folder.read("a.dcm", &packed(rle, vec![frame.clone()], |_| {})).unwrap();
    assert_eq!(values(&volume), [261.0, 262.0, 263.0, 520.0]);
    for length in (0..frame.len() - 2).step_by(2) {
        assert!(
            folder.refusal("a.dcm", &packed(rle, vec![frame[..length].to_vec()], |_| {})).contains("cannot be read")
        );
    }
}

#[test]
fn codestreams_of_another_size_are_refused() {
    let folder = Folder::new();
    let siz = |n: u32| {
        let mut b = vec![0xff, 0x4f, 0xff, 0x51, 0, 41, 0, 0];
        for v in [n, n, 0, 0, n, n, 0, 0] {
            b.extend(v.to_be_bytes());
        }
        b.extend([0, 1, 15, 1, 1, 0]);
        b
    };
    let refusal = |syntax: &str, frame: Vec<u8>| folder.refusal("a.dcm", &packed(syntax, vec![frame], |_| {}));
    let error = refusal("1.2.840.10008.1.2.4.90", siz(60_000));
    assert!(
        error.contains("it is packed as 60000 x 60000 pixels of 1 numbers, where the header says 4 x 1 of 1"),
        "{error}"
    );
    let jpeg = vec![0xff, 0xd8, 0xff, 0xc3, 0, 11, 16, 0xff, 0xff, 0xff, 0xff, 1, 1, 0x11, 0, 0];
    assert!(refusal("1.2.840.10008.1.2.4.70", jpeg).contains("packed as 65535 x 65535"));
    let jpeg_ls = vec![0xff, 0xd8, 0xff, 0xf7, 0, 11, 16, 0xff, 0xff, 0xff, 0xff, 1, 1, 0x11, 0, 0];
    assert!(refusal("1.2.840.10008.1.2.4.80", jpeg_ls).contains("packed as 65535 x 65535"));
    for syntax in ["5", "4.70", "4.80", "4.90"] {
        let error = refusal(&format!("1.2.840.10008.1.2.{syntax}"), vec![1, 2, 3, 4]);
        assert!(error.contains("the picture cannot be read"), "{error}");
    }
    let error = refusal("1.2.840.10008.1.2.4.102", vec![1, 2, 3, 4]);
    assert!(error.contains("MPEG-4") && error.contains("gdcmconv"), "{error}");
}
