//! Damaged files, made from good ones with fixed seeds: every reader must refuse each with one sentence or read it, and neither
//! panic nor take memory that the file does not justify. A few seconds of what `scripts/fuzz.sh` does for hours.

use std::io::{Read as _, Write as _};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use fabrica_engine::Progress;
use fabrica_engine::read::limits::Limits;
use fabrica_engine::read::{ReadOptions, label_table, read_labels, read_volume, survey};
use fabrica_studio::figure::Template;

/// Small good files of the data folder, one or two for every reader, and how many damaged ones are made of each.
const SEEDS: [(&str, usize); 17] = [
    ("edge_minimal_be.nii.gz", 400),
    ("edge_5d_small.nii", 400),
    ("edge_low_res_7x5x3.nii.gz", 400),
    ("edge_analyze.hdr", 200),
    ("rgba32_thalamus_paqd.nii.gz", 30),
    ("one_slice_oblique.nrrd", 200),
    ("square2d.mhd", 300),
    ("ct_lung_mask.mha", 60),
    ("fuel.nii.gz", 100),
    ("pet_seg_dicom/", 150),
    ("dicom_odd/emri_small_RLE.dcm", 150),
    ("dicom_odd/emri_small_jpeg_ls_lossless.dcm", 100),
    ("dicom_odd/emri_small.dcm", 150),
    ("dicom_odd/parametric_map_float.dcm", 150),
    ("dicom_odd/SC_rgb_2frame.dcm", 150),
    ("dicom_odd/explicit_VR-UN.dcm", 30),
    ("dicom_odd/liver_nonbyte_aligned.dcm", 60),
];

/// A deterministic generator (splitmix64).
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Changes a file as broken disks, broken writers and people with bad intentions do, mostly near its beginning.
fn damage(bytes: &mut Vec<u8>, dice: &mut Dice) {
    const NUMBERS: [u64; 10] =
        [0, 1, u64::MAX, 0x7fff, 0x8000, 0x7fff_ffff, 0x8000_0000, 0x7fff_ffff_ffff_ffff, 1 << 63, 0x7ff8 << 48];
    for _ in 0..=dice.below(4) {
        if bytes.is_empty() {
            return;
        }
        let reach = if dice.below(4) > 0 { bytes.len().min(1024) } else { bytes.len() };
        let at = dice.below(reach);
        match dice.below(8) {
            0 => bytes[at] ^= 1 << dice.below(8),
            1 => bytes[at] = dice.next() as u8,
            2 => bytes.truncate(at),
            3 => {
                let number = NUMBERS[dice.below(NUMBERS.len())];
                let little = number.to_le_bytes();
                let width = [1, 2, 4, 8][dice.below(4)];
                let mut number = little[..width].to_vec();
                if dice.below(2) == 0 {
                    number.reverse();
                }
                for (b, n) in bytes[at..].iter_mut().zip(number) {
                    *b = n;
                }
            }
            4 => {
                let end = (at + 1 + dice.below(64)).min(bytes.len());
                let copy = bytes[at..end].to_vec();
                bytes.splice(at..at, copy);
            }
            5 => {
                let end = (at + 1 + dice.below(64)).min(bytes.len());
                bytes.drain(at..end);
            }
            // Where there is text, its digits.
            6 => match bytes[..reach].iter().skip(at).position(u8::is_ascii_digit) {
                Some(i) => bytes[at + i] = b"0123456789-.e"[dice.below(13)],
                None => bytes[at] = 0,
            },
            _ => {
                let from = dice.below(bytes.len());
                let n = dice.below(32).min(bytes.len() - at.max(from));
                bytes.copy_within(from..from + n, at);
            }
        }
    }
}

fn assert_sentence(error: &fabrica_engine::Error) {
    let text = error.to_string();
    assert!(!text.is_empty() && text.lines().count() == 1, "no sentence: {text:?}");
}

/// Reads a damaged file in every way; what was read must hold together.
fn read_all(path: &Path) {
    let limits = Limits { bytes: Some(64 << 20), edge: None };
    let options = ReadOptions { limits, ..ReadOptions::default() };
    let progress = Progress::new();
    match survey(path, &options, &progress) {
        Ok(entries) => assert!(!entries.is_empty(), "a survey of nothing"),
        Err(error) => assert_sentence(&error),
    }
    match read_volume(path, &options, &progress) {
        Ok(volume) => {
            assert_eq!(volume.voxels.len(), volume.grid.num_voxels());
            assert!(volume.num_bytes() <= 64 << 20, "more than the limit");
        }
        Err(error) => return assert_sentence(&error),
    }
    match read_labels(path, &options, &progress) {
        Ok(layers) => {
            for map in layers {
                assert!(map.voxels.iter().all(|v| usize::from(*v) < map.labels.len()), "a structure without a name");
            }
        }
        Err(error) => assert_sentence(&error),
    }
}

/// Runs `check` on damaged copies of `bytes`; a panic names the copy.
fn on_damaged(name: &str, bytes: &[u8], count: usize, check: impl Fn(&[u8])) {
    for seed in 0..count as u64 {
        let mut dice = Dice(seed.wrapping_mul(0x1234_5678_9abc_def1));
        let mut damaged = bytes.to_vec();
        damage(&mut damaged, &mut dice);
        let outcome = catch_unwind(AssertUnwindSafe(|| check(&damaged)));
        assert!(outcome.is_ok(), "{name}, seed {seed}");
    }
}

fn gunzipped(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut plain = Vec::new();
    flate2::read::MultiGzDecoder::new(bytes).read_to_end(&mut plain).ok()?;
    Some(plain)
}

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn damaged_volumes_are_read_or_refused_with_a_sentence() {
    for (name, count) in SEEDS {
        let Some(mut source) = fabrica_tests::data(name.trim_end_matches('/')) else { continue };
        if source.is_dir() {
            source = std::fs::read_dir(&source).unwrap().next().unwrap().unwrap().path();
        }
        let bytes = std::fs::read(&source).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(source.file_name().unwrap());
        if name == "square2d.mhd" {
            std::fs::write(folder.path().join("2D_2x2_square_object_at_(1,3).raw"), [1; 120]).unwrap();
        }
        let write = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            read_all(&path);
        };
        on_damaged(name, &bytes, count, write);
        // Behind an intact checksum, the header and the voxels.
        if let Some(plain) = gunzipped(&bytes) {
            on_damaged(name, &plain, count, |damaged| write(&gzipped(damaged)));
        }
    }
}

#[test]
fn damaged_label_tables_are_read_or_refused_with_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    for table in [
        "# Color table file\n# 3 values\n0 Background 0 0 0 0\n1 left_kidney 185 102 83 255\n2 liver 221 130 101 255\n",
        "LabelValue,Name,Color_R,Color_G,Color_B,Color_A\n1,\"Kidney, left\",185,102,83,255\n2,Liver,221,130,101,255\n",
        "# ITK-SnAP Label Description File\n0 0 0 0 0 0 0 \"Clear Label\"\n1 255 0 0 1 1 1 \"Left kidney\"\n",
        "#No. Label Name: R G B A\n0 Unknown 0 0 0 0\n2 Left-Cerebral-White-Matter 245 245 245 0\n",
    ] {
        on_damaged("label table", table.as_bytes(), 300, |damaged| {
            std::fs::write(&path, damaged).unwrap();
            if let Err(error) = label_table::read_label_table(&path) {
                assert_sentence(&error);
            }
        });
    }
}

#[test]
fn damaged_templates_are_parsed_or_refused() {
    for shipped in fabrica_studio::figure::shipped::SHIPPED {
        let text = shipped.figure().to_json().unwrap();
        on_damaged("template", text.as_bytes(), 300, |damaged| {
            let Ok(text) = std::str::from_utf8(damaged) else { return };
            if let Ok(template) = Template::parse(text) {
                let written = template.to_json().unwrap();
                assert_eq!(Template::parse(&written).unwrap(), template);
            }
        });
    }
}
