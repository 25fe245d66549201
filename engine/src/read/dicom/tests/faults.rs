//! Files that are damaged, or something else.

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::tags;

use super::build::*;
use crate::read::testing::{Folder, read, torture};

#[test]
fn no_damage_makes_it_panic_or_take_memory() {
    torture("a.dcm", &bytes(&slices("LPS")[0], EXPLICIT), 900);
    torture("a", &data_set(&slices("LPS")[0], IMPLICIT), 300);
    torture("a.dcm", &bytes(&slices("LPS")[0], DEFLATED), 250);
    torture("a.dcm", &bytes(&super::segments::segmentation(), EXPLICIT), 400);
}

#[test]
fn faults_have_sentences() {
    let folder = Folder::new();
    let slice = || slices("LPS").remove(0);
    let refusal = |change: &dyn Fn(&mut Object)| {
        let mut object = slice();
        change(&mut object);
        folder.refusal("a.dcm", &bytes(&object, EXPLICIT))
    };
    assert!(folder.refusal("b.dcm", &[7; 1024]).contains("this is no DICOM file"));
    let whole = bytes(&slice(), EXPLICIT);
    assert!(folder.refusal("a.dcm", &whole[..600]).contains("the DICOM file ends within its header"));
    assert!(
        folder
            .refusal("a.dcm", &whole[..whole.len() - 6])
            .contains("promises 40 bytes of pixels, but the file holds 34")
    );
    assert!(refusal(&|o| put(o, tags::COLUMNS, VR::US, 0_u16)).contains("a picture of 0 x 4 pixels"));
    assert!(refusal(&|o| put(o, tags::BITS_ALLOCATED, VR::US, 12_u16)).contains("12 bits per number"));
    assert!(refusal(&|o| put(o, tags::ROWS, VR::US, 60_000_u16)).contains("bytes of pixels, but the file holds 40"));
    assert!(refusal(&|o| text(o, tags::NUMBER_OF_FRAMES, VR::IS, "2000000000")).contains("but the file holds 40"));
    for spacing in ["0\\1", "-1\\1", "nan\\1"] {
        assert!(
            refusal(&|o| text(o, tags::PIXEL_SPACING, VR::DS, spacing)).contains("which no pixels are"),
            "{spacing}"
        );
    }
    assert!(refusal(&|o| text(o, tags::IMAGE_POSITION_PATIENT, VR::DS, "inf\\1\\1")).contains("nowhere in space"));
    assert!(
        refusal(&|o| decimals(o, tags::IMAGE_ORIENTATION_PATIENT, &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]))
            .contains("right angles")
    );
    let structures = |o: &mut Object| {
        o.remove_element(tags::PIXEL_DATA);
        text(o, tags::SOP_CLASS_UID, VR::UI, "1.2.840.10008.5.1.4.1.1.481.3");
    };
    assert!(refusal(&structures).contains("a structure set of contours (RTSTRUCT)"));
    assert!(refusal(&|o| assert!(o.remove_element(tags::PIXEL_DATA))).contains("ends without a picture"));
    let other = |syntax: &str| {
        let mut bytes = bytes(&slice(), EXPLICIT);
        let at = bytes.windows(EXPLICIT.len()).position(|w| w == EXPLICIT.as_bytes()).unwrap();
        // The element has an even length, so one more letter fits.
        bytes.splice(at..at + EXPLICIT.len() + 1, syntax.bytes());
        folder.refusal("a.dcm", &bytes)
    };
    assert!(other("1.2.840.10008.1.2.X ").contains("packed with a private transfer syntax"));
    assert!(folder.refusal("a.dcm", &crate::read::testing::gzip(&whole)).contains("compressed with gzip"));
}

#[test]
fn sequences_nest_only_so_deep_and_lengths_are_not_believed() {
    let mut bytes = bytes(&slices("LPS")[0], EXPLICIT);
    // A group that comes before all others, so that nothing else is read.
    let end = bytes.windows(4).position(|w| w == [8, 0, 0x16, 0]).unwrap();
    let mut deep = bytes[..end].to_vec();
    for _ in 0..100_000 {
        deep.extend([8, 0, 0x06, 0, b'S', b'Q', 0, 0, 0xff, 0xff, 0xff, 0xff]);
        deep.extend([0xfe, 0xff, 0, 0xe0, 0xff, 0xff, 0xff, 0xff]);
    }
    let folder = Folder::new();
    assert!(folder.refusal("a.dcm", &deep).contains("nests sequences too deeply"));
    // Four gibibytes of a modality.
    bytes.truncate(end);
    bytes.extend([8, 0, 0x60, 0, b'U', b'N', 0, 0, 0xfe, 0xff, 0xff, 0xff, 1, 2, 3]);
    assert!(folder.refusal("a.dcm", &bytes).contains("ends within its header"));
}

#[test]
fn a_deflate_bomb_is_refused() {
    let mut object = slices("LPS").remove(0);
    put(&mut object, tags::ROWS, VR::US, 60_000_u16);
    put(&mut object, tags::COLUMNS, VR::US, 60_000_u16);
    let folder = Folder::new();
    assert!(folder.refusal("a.dcm", &bytes(&object, DEFLATED)).contains("bytes of pixels, but the file holds"));
    // A comment of 64 MiB that packs to 64 KiB is passed over.
    let mut object = slices("LPS").remove(0);
    put(&mut object, tags::ICON_IMAGE_SEQUENCE, VR::OB, PrimitiveValue::U8(vec![0; 64 << 20].into()));
    assert!(folder.read("b.dcm", &bytes(&object, DEFLATED)).is_ok());
}

#[cfg(unix)]
#[test]
fn a_folder_that_cannot_be_read_says_so() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = Folder::new();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    std::fs::set_permissions(&inner, std::fs::Permissions::from_mode(0o000)).unwrap();
    let error = read(&inner).unwrap_err().to_string();
    std::fs::set_permissions(&inner, std::fs::Permissions::from_mode(0o755)).unwrap();
    assert!(error.contains("folder"), "{error}");
}
