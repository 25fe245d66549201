//! What a NIfTI file says about being a label map: its intent, and the table of names and colors that Connectome Workbench
//! and automatic segmentations put into an extension of the header.

use std::path::Path;

use super::{Endian, Fields, Header};
use crate::read::label_table::parse_caret;
use crate::read::stream::ByteSource;
use crate::volume::labels::LabelTable;

/// NIFTI_INTENT_LABEL.
const INTENT_LABEL: i64 = 1002;

/// More than the longest table needs.
const MAX_EXTENSION_BYTES: u64 = 4 << 20;

/// Whether the header's intent is a label map.
pub fn is_intent(header: &Header, head: &[u8]) -> bool {
    let is_wide = header.layout.version == 2;
    let fields = Fields { bytes: head, endian: header.endian, is_wide };
    header.analyze.is_none() && fields.code(if is_wide { 504 } else { 68 }) == INTENT_LABEL
}

/// The table in the extensions between the header and the voxels at `data_start`. What cannot be read is none: the voxels
/// do not depend on it.
pub fn table(path: &Path, header: &Header, data_start: u64) -> Option<LabelTable> {
    let begin = header.layout.num_bytes;
    if header.is_pair || data_start <= begin as u64 + 4 {
        return None;
    }
    let bytes = ByteSource::open(path).ok()?.read_up_to(data_start.min(MAX_EXTENSION_BYTES) as usize).ok()?;
    let [has_extensions, _, _, _, rest @ ..] = bytes.get(begin..)? else { return None };
    let mut rest = if *has_extensions == 0 { return None } else { rest };
    // Size with these eight bytes, code, content; whoever counts wrongly ends the list.
    while let Some((size, _)) = rest.split_first_chunk() {
        let size = match header.endian {
            Endian::Little => u32::from_le_bytes(*size),
            Endian::Big => u32::from_be_bytes(*size),
        };
        let Some(content) = rest.get(8..(size as usize).min(rest.len())) else { break };
        if let Some(table) = parse_caret(path, content) {
            return Some(table);
        }
        rest = &rest[(size as usize).min(rest.len())..];
    }
    None
}

#[cfg(test)]
mod tests {
    use crate::progress::Progress;
    use crate::read::testing::{ElementType, Endian, Folder, NiftiFile, Phantom};
    use crate::read::{ReadOptions, read_labels, survey};

    const XML: &str = "<?xml version=\"1.0\"?><CaretExtension><VolumeInformation Index=\"0\"><LabelTable>\n\
        <Label Key=\"-1\" Red=\"0\" Green=\"0\" Blue=\"0\" Alpha=\"0\"><![CDATA[???]]></Label>\n\
        <Label Key=\"7\" Red=\"1\" Green=\"0\" Blue=\"0.5\" Alpha=\"1\"><![CDATA[kidney_left]]></Label>\n\
        <Label Key='8' Red='0.2' Green='1' Blue='0'>heart &amp; aorta</Label></LabelTable></CaretExtension>";

    fn file(extension: &[u8], version: u8, endian: Endian) -> Vec<u8> {
        let mut nifti = NiftiFile::new(version, &Phantom::oriented("RAS"), ElementType::U8, endian);
        let voxels = std::mem::take(&mut nifti.voxels);
        let begin = if version == 1 { 348 } else { 540 };
        nifti.vox_offset = (begin + 4 + extension.len()) as f64;
        let mut bytes = nifti.bytes();
        bytes[begin] = 1;
        bytes[begin + 4..].copy_from_slice(extension);
        bytes.extend(voxels);
        bytes
    }

    fn extension(content: &[u8], endian: Endian) -> Vec<u8> {
        let words = [content.len() as u32 + 8, 0];
        let words = words.map(|w| if endian == Endian::Big { w.to_be_bytes() } else { w.to_le_bytes() });
        [&words.concat(), content].concat()
    }

    #[test]
    fn names_and_colors_of_an_extension() {
        let folder = Folder::new();
        for (version, endian) in [(1, Endian::Little), (1, Endian::Big), (2, Endian::Little)] {
            let both = [extension(b"a comment", endian), extension(XML.as_bytes(), endian)].concat();
            let path = folder.write("a.nii", &file(&both, version, endian));
            let (options, progress) = (ReadOptions::default(), Progress::new());
            assert!(survey(&path, &options, &progress).unwrap()[0].is_labels);
            let labels = &read_labels(&path, &options, &progress).unwrap()[0];
            let label = |id: u32| labels.labels.iter().find(|l| l.id == id).unwrap();
            assert_eq!((label(7).name.as_str(), label(7).color), ("kidney left", [255, 0, 128]));
            assert_eq!((label(8).name.as_str(), label(8).color), ("heart & aorta", [51, 255, 0]));
            assert_eq!(label(9).name, "9");
            assert_eq!(labels.voxels[7], 7);
        }
    }

    #[test]
    fn the_intent_makes_a_label_map_and_damaged_extensions_do_not_matter() {
        let folder = Folder::new();
        let (options, progress) = (ReadOptions::default(), Progress::new());
        let is_labels = |bytes: &[u8]| survey(&folder.write("a.nii", bytes), &options, &progress).unwrap()[0].is_labels;
        let mut plain = NiftiFile::new(1, &Phantom::oriented("RAS"), ElementType::U8, Endian::Little).bytes();
        assert!(!is_labels(&plain));
        plain[68..70].copy_from_slice(&1002_i16.to_le_bytes());
        assert!(is_labels(&plain));
        let good = extension(XML.as_bytes(), Endian::Little);
        for i in 0..good.len() {
            for value in [0, b'<', b'"', 0xff] {
                let mut bad = good.clone();
                bad[i] = value;
                let path = folder.write("a.nii", &file(&bad, 1, Endian::Little));
                assert_eq!(read_labels(&path, &options, &progress).unwrap()[0].voxels.len(), 60);
            }
        }
    }
}
