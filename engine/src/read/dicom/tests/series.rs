//! Which files belong together, and what of them is seen outside.

use dicom_core::VR;
use dicom_dictionary_std::tags;

use super::build::*;
use crate::progress::Progress;
use crate::read::testing::{Folder, Phantom, read};
use crate::read::window::Window;
use crate::read::{ReadOptions, read_volume, survey};

fn series(description: &str, uid: &str, letters: &str) -> Vec<Object> {
    let mut all = slices(letters);
    for (i, slice) in all.iter_mut().enumerate() {
        text(slice, tags::SERIES_DESCRIPTION, VR::LO, description);
        text(slice, tags::SERIES_INSTANCE_UID, VR::UI, &format!("1.2.826.0.1.3680043.2.{uid}"));
        text(slice, tags::SOP_INSTANCE_UID, VR::UI, &format!("1.2.826.0.1.3680043.2.{uid}.{i}"));
    }
    all
}

fn choose(folder: &Folder, wanted: &str) -> crate::Result<crate::volume::Volume> {
    let options = ReadOptions { series: Some(wanted.to_owned()), ..ReadOptions::default() };
    read_volume(folder.path(), &options, &Progress::new())
}

#[test]
fn several_series_are_listed_and_one_is_chosen() {
    let folder = Folder::new();
    let all = [series("Bone 1.0", "2", "LPS"), series("Soft 3.0", "1", "PIL"), series("Bone 1.0", "3", "ASR")].concat();
    write(&folder, &all, EXPLICIT);
    let entries = survey(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap();
    let keys: Vec<_> = entries.iter().map(|e| e.key.as_str()).collect();
    assert_eq!(
        keys,
        ["CT Soft 3.0 4x3x5 1.50x2.25x0.75", "CT Bone 1.0 5x4x3 0.75x1.50x2.25", "CT Bone 1.0 4x3x5 1.50x2.25x0.75"]
    );
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("it holds 3 volumes: 1: CT Soft 3.0") && error.contains("--series"), "{error}");
    for wanted in ["1", "soft", keys[0], keys[1], keys[2], "3"] {
        Phantom::assert_in_world(&choose(&folder, wanted).unwrap());
    }
    assert_eq!(choose(&folder, "SOFT").unwrap().description, "Soft 3.0");
    assert!(
        choose(&folder, "bone")
            .unwrap_err()
            .to_string()
            .contains("\"bone\" is a part of the names of several series: CT Bone 1.0")
    );
    assert!(choose(&folder, "lung").unwrap_err().to_string().contains("there is no series \"lung\" among its 3"));
    assert!(choose(&folder, "4").is_err());
}

#[test]
fn series_that_look_alike_are_numbered_by_their_uid() {
    let folder = Folder::new();
    write(&folder, &[series("A", "7", "LPS"), series("A", "5", "LPS")].concat(), EXPLICIT);
    let entries = survey(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap();
    let keys: Vec<_> = entries.iter().map(|e| e.key.as_str()).collect();
    assert_eq!(keys, ["CT A 5x4x3 0.75x1.50x2.25", "CT A 5x4x3 0.75x1.50x2.25 #2"]);
}

#[test]
fn scout_views_and_copies_do_not_get_in_the_way() {
    let folder = Folder::new();
    let all = series("Head", "1", "LPS");
    write(&folder, &all, EXPLICIT);
    let mut scout = series("Scout", "2", "PIL").remove(0);
    text(&mut scout, tags::IMAGE_TYPE, VR::CS, "ORIGINAL\\PRIMARY\\LOCALIZER");
    folder.write("scout", &bytes(&scout, EXPLICIT));
    folder.write("copy of a slice", &bytes(&all[1], EXPLICIT));
    folder.write("notes.txt", b"nothing");
    folder.write("DICOMDIR", &bytes(&all[1], EXPLICIT)[..300]);
    folder.write("cut.dcm", &bytes(&all[1], EXPLICIT)[..500]);
    let volume = read(folder.path()).unwrap();
    Phantom::assert_in_world(&volume);
    assert_eq!(
        volume.warnings,
        [
            "1 damaged DICOM file was left out.",
            "1 other series was left out: label maps, localizers, single pictures or few slices."
        ]
    );
}

#[test]
fn trees_are_walked_once_whatever_links_say() {
    let folder = Folder::new();
    let deep = folder.path().join("a/b/c");
    std::fs::create_dir_all(&deep).unwrap();
    for (i, slice) in slices("LPS").iter().enumerate() {
        std::fs::write(deep.join(format!("{i}.IMA")), bytes(slice, IMPLICIT)).unwrap();
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(folder.path(), deep.join("back")).unwrap();
        std::os::unix::fs::symlink("loop", deep.join("loop")).unwrap();
    }
    Phantom::assert_in_world(&read(folder.path()).unwrap());
}

#[test]
fn nothing_of_a_patient_leaves_the_reader() {
    let folder = Folder::new();
    write(&folder, &[series("Head", "1", "LPS"), series("Neck", "2", "ASR")].concat(), EXPLICIT);
    let entries = survey(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap();
    let mut seen = format!("{entries:?}");
    seen += &format!("{:?}", choose(&folder, "1").unwrap());
    seen += &read(folder.path()).unwrap_err().to_string();
    let whole = bytes(&slices("LPS")[0], EXPLICIT);
    for length in (100..whole.len()).step_by(7) {
        let other = Folder::new();
        if let Err(error) = other.read("a.dcm", &whole[..length]) {
            seen += &error.to_string();
        }
    }
    for secret in SECRETS {
        assert!(!seen.contains(secret), "{secret} is seen");
    }
}

#[test]
fn a_window_decodes_its_slices_only() {
    let folder = Folder::new();
    let paths = write(&folder, &slices("LPS"), EXPLICIT);
    // The last slice lacks its last pixels, which only those notice who read them... or its size.
    let window = Window { crop: Some([[1, 4], [0, 4], [0, 2]]), reduce: [1, 2, 2] };
    let options = ReadOptions { window, ..ReadOptions::default() };
    let volume = read_volume(&paths[0], &options, &Progress::new()).unwrap();
    assert_eq!(volume.grid.dims(), [3, 2, 1]);
    let phantom = Phantom::oriented("LPS");
    let at = |i: usize, j: usize, k: usize| phantom.values[i + 5 * (j + 4 * k)];
    let mean = (at(1, 0, 0) + at(1, 1, 0) + at(1, 0, 1) + at(1, 1, 1)) / 4.0;
    assert_eq!(volume.value(0, 0, 0), mean.round());
}

#[test]
fn a_scout_view_does_not_stand_for_a_series_that_was_refused() {
    let folder = Folder::new();
    let mut all = series("Head", "1", "LPS");
    // The middle one is pushed aside.
    decimals(&mut all[1], tags::IMAGE_POSITION_PATIENT, &[500.0, 0.0, -28.25]);
    write(&folder, &all, EXPLICIT);
    folder.write("scout", &bytes(&series("Scout", "2", "PIL")[0], EXPLICIT));
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("shifted sideways"), "{error}");
    let mut structures = picture([1, 1], &[0.0]);
    structures.remove_element(tags::PIXEL_DATA);
    let folder = Folder::new();
    write(&folder, &[slices("LPS"), vec![structures]].concat(), EXPLICIT);
    Phantom::assert_in_world(&read(folder.path()).unwrap());
}
