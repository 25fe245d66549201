//! Small DICOM files for the tests, written by dicom-rs, which shares no parser of values with the reader.

use std::io::Write as _;
use std::path::PathBuf;

use dicom_core::value::DataSetSequence;
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::tags;
use dicom_encoding::TransferSyntaxIndex as _;
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};
use dicom_transfer_syntax_registry::TransferSyntaxRegistry;
use glam::DVec3;

use crate::read::testing::{Folder, Phantom};

pub type Object = InMemDicomObject;

pub const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub const IMPLICIT: &str = "1.2.840.10008.1.2";
pub const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
pub const DEFLATED: &str = "1.2.840.10008.1.2.1.99";

/// What must never be seen outside of the files.
pub const SECRETS: [&str; 7] =
    ["Moriarty", "19010203", "PAT-4711", "1.2.826.0.1.3680043", "St. Mary", "Dr. Watson", "ACC-0815"];

pub fn put(object: &mut Object, tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) {
    object.put(DataElement::new(tag, vr, value.into()));
}

pub fn text(object: &mut Object, tag: Tag, vr: VR, value: &str) {
    put(object, tag, vr, value);
}

pub fn decimals(object: &mut Object, tag: Tag, values: &[f64]) {
    let words: Vec<String> = values.iter().map(f64::to_string).collect();
    text(object, tag, VR::DS, &words.join("\\"));
}

pub fn items(object: &mut Object, tag: Tag, items: Vec<Object>) {
    object.put(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
}

pub fn words(values: &[f64]) -> PrimitiveValue {
    PrimitiveValue::U16(values.iter().map(|v| *v as i32 as u16).collect())
}

/// A picture with everything that a patient would not want to be seen.
pub fn picture(dims: [usize; 2], pixels: &[f64]) -> Object {
    let mut o = Object::new_empty();
    text(&mut o, tags::SOP_CLASS_UID, VR::UI, "1.2.840.10008.5.1.4.1.1.2");
    text(&mut o, tags::STUDY_DATE, VR::DA, SECRETS[1]);
    text(&mut o, tags::MODALITY, VR::CS, "CT");
    text(&mut o, tags::INSTITUTION_NAME, VR::LO, SECRETS[4]);
    text(&mut o, tags::REFERRING_PHYSICIAN_NAME, VR::PN, SECRETS[5]);
    text(&mut o, tags::SERIES_DESCRIPTION, VR::LO, " Phantom 1.0 ");
    text(&mut o, tags::PATIENT_NAME, VR::PN, SECRETS[0]);
    text(&mut o, tags::PATIENT_ID, VR::LO, SECRETS[2]);
    text(&mut o, tags::ACCESSION_NUMBER, VR::SH, SECRETS[6]);
    text(&mut o, tags::SERIES_INSTANCE_UID, VR::UI, "1.2.826.0.1.3680043.1");
    put(&mut o, tags::SAMPLES_PER_PIXEL, VR::US, 1_u16);
    text(&mut o, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2");
    put(&mut o, tags::COLUMNS, VR::US, dims[0] as u16);
    put(&mut o, tags::ROWS, VR::US, dims[1] as u16);
    put(&mut o, tags::BITS_ALLOCATED, VR::US, 16_u16);
    put(&mut o, tags::BITS_STORED, VR::US, 16_u16);
    put(&mut o, tags::HIGH_BIT, VR::US, 15_u16);
    put(&mut o, tags::PIXEL_REPRESENTATION, VR::US, 0_u16);
    put(&mut o, tags::PIXEL_DATA, VR::OW, words(pixels));
    o
}

/// The slices of the phantom stored along `letters`, in that order.
pub fn slices(letters: &str) -> Vec<Object> {
    let phantom = Phantom::oriented(letters);
    let [nx, ny, nz] = phantom.dims;
    let (axes, spacing, _) = frame(&phantom);
    (0..nz)
        .map(|k| {
            let mut o = picture([nx, ny], &phantom.values[k * nx * ny..][..nx * ny]);
            text(&mut o, tags::SOP_INSTANCE_UID, VR::UI, &format!("1.2.826.0.1.3680043.1.{}", k + 1));
            // The number says nothing about the place.
            text(&mut o, tags::INSTANCE_NUMBER, VR::IS, &((k * 7 + 3) % 5).to_string());
            let (_, _, position) = frame_at(&phantom, k);
            decimals(&mut o, tags::IMAGE_POSITION_PATIENT, &position.to_array());
            decimals(&mut o, tags::IMAGE_ORIENTATION_PATIENT, &axes);
            decimals(&mut o, tags::PIXEL_SPACING, &[spacing[1], spacing[0]]);
            o
        })
        .collect()
}

pub fn frame(phantom: &Phantom) -> ([f64; 6], [f64; 3], DVec3) {
    frame_at(phantom, 0)
}

/// Directions, spacing and position of a slice of the phantom, in LPS.
pub fn frame_at(phantom: &Phantom, k: usize) -> ([f64; 6], [f64; 3], DVec3) {
    let flip = DVec3::new(-1.0, -1.0, 1.0);
    let m = phantom.world_from_index.matrix3;
    let (x, y) = (m.x_axis.normalize() * flip, m.y_axis.normalize() * flip);
    let position = phantom.world_from_index.transform_point3(DVec3::new(0.0, 0.0, k as f64)) * flip;
    ([x.x, x.y, x.z, y.x, y.y, y.z], [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()], position)
}

/// A whole file.
pub fn bytes(object: &Object, syntax: &str) -> Vec<u8> {
    let meta = FileMetaTableBuilder::new()
        .media_storage_sop_class_uid("1.2.840.10008.5.1.4.1.1.2")
        .media_storage_sop_instance_uid("1.2.826.0.1.3680043.9")
        .transfer_syntax(syntax)
        .build()
        .unwrap();
    let mut bytes = vec![0; 128];
    bytes.extend(b"DICM");
    meta.write(&mut bytes).unwrap();
    let data = data_set(object, if syntax == DEFLATED { EXPLICIT } else { syntax });
    if syntax == DEFLATED {
        let mut encoder = flate2::write::DeflateEncoder::new(bytes, flate2::Compression::default());
        encoder.write_all(&data).unwrap();
        return encoder.finish().unwrap();
    }
    bytes.extend(data);
    bytes
}

/// Without preamble and file meta information.
pub fn data_set(object: &Object, syntax: &str) -> Vec<u8> {
    let syntax = TransferSyntaxRegistry.get(syntax).unwrap();
    let mut bytes = Vec::new();
    object.write_dataset_with_ts(&mut bytes, syntax).unwrap();
    bytes
}

/// Writes slices under names that say nothing about their order.
pub fn write(folder: &Folder, objects: &[Object], syntax: &str) -> Vec<PathBuf> {
    let path =
        |i: usize, object: &Object| folder.write(&format!("IM{:03}", (i * 37 + 11) % 101), &bytes(object, syntax));
    objects.iter().enumerate().map(|(i, object)| path(i, object)).collect()
}
