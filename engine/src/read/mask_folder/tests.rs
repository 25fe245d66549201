use glam::{DAffine3, DVec3};

use super::super::testing::{ElementType, Endian, Folder, NiftiFile, Phantom, gzip};
use super::super::{read_labels, read_volume, survey};
use super::*;

/// A NIfTI file of 40 × 40 × 4 voxels of 2 mm.
fn nifti(at_mm: f64, element: ElementType, value: impl Fn([usize; 3]) -> f64) -> Vec<u8> {
    let dims = [40, 40, 4];
    let world_from_index =
        DAffine3::from_scale_rotation_translation(DVec3::splat(2.0), glam::DQuat::IDENTITY, DVec3::splat(at_mm));
    let values = (0..40 * 40 * 4).map(|i| value([i % 40, i / 40 % 40, i / 1600])).collect();
    NiftiFile::new(1, &Phantom { dims, world_from_index, values }, element, Endian::Little).bytes()
}

fn block(from: usize, to: usize) -> impl Fn([usize; 3]) -> f64 {
    move |[x, _, _]| f64::from(u8::from((from..to).contains(&x)))
}

fn noise([x, y, z]: [usize; 3]) -> f64 {
    ((x * 7919 + y * 104_729 + z * 1_299_709) % 251) as f64
}

fn layers(folder: &Folder) -> Result<Vec<LabelMap>> {
    read_labels(folder.path(), &ReadOptions::default(), &Progress::new())
}

#[test]
fn masks_become_layers_with_the_names_of_their_files() {
    let folder = Folder::new();
    folder.write("rib_left_10.nii.gz", &gzip(&nifti(0.0, ElementType::U8, block(0, 10))));
    // Other programs write masks as reals, or with 255.
    folder.write("rib_left_2.nii", &nifti(0.0, ElementType::F32, |at| 255.0 * block(5, 20)(at)));
    folder.write("Empty.nii.gz", &gzip(&nifti(0.0, ElementType::I16, |_| 0.0)));
    folder.write("heart.nii.gz", &gzip(&nifti(0.0, ElementType::U8, block(20, 40))));
    // What is no volume, and another system's bookkeeping, do not count.
    folder.write("statistics.json", b"{}");
    folder.write("._heart.nii.gz", b"Mac OS X");
    let entries = survey(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap();
    assert_eq!(entries.len(), 1);
    assert_eq!((entries[0].title.as_str(), entries[0].is_labels, entries[0].num_files), ("4 masks", true, 4));
    let layers = layers(&folder).unwrap();
    let names = |layer: &LabelMap| layer.labels.iter().map(|l| format!("{} {}", l.id, l.name)).collect::<Vec<_>>();
    assert_eq!(names(&layers[0]), ["0 background", "1 Empty", "2 heart", "3 rib left 2"]);
    assert_eq!(names(&layers[1]), ["0 background", "4 rib left 10"]);
    assert_eq!(layers[0].counts(), [800, 0, 3200, 2400]);
    assert_eq!(layers[1].counts(), [4800, 1600]);
    assert_eq!(layers[0].notes, Vec::<String>::new());
    let volume = read_volume(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap();
    assert_eq!((volume.value(3, 0, 0), volume.value(7, 0, 0), volume.value(30, 0, 0)), (0.0, 3.0, 2.0));
    assert!(volume.warnings[0].contains("1 of the masks overlap others"), "{:?}", volume.warnings);
    assert_eq!(volume.source.as_deref(), Some(folder.path()));
}

#[test]
fn scans_are_listed_to_choose_from() {
    let folder = Folder::new();
    folder.write("T1.nii.gz", &gzip(&nifti(0.0, ElementType::U8, noise)));
    folder.write("T2.nii", &nifti(0.0, ElementType::I16, |at| 2.0 * noise(at)));
    let refusal = |r: Result<Volume>| r.unwrap_err().to_string();
    let read = |series: Option<&str>| {
        let options = ReadOptions { series: series.map(str::to_owned), ..ReadOptions::default() };
        read_volume(folder.path(), &options, &Progress::new())
    };
    let entries = survey(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap();
    assert_eq!(entries.iter().map(|e| e.key.as_str()).collect::<Vec<_>>(), ["T1.nii.gz", "T2.nii"]);
    assert!(entries.iter().all(|e| !e.is_labels));
    assert!(refusal(read(None)).contains("it holds 2 volumes: 1: T1, "));
    for series in ["T2.nii", "T2", "2"] {
        assert_eq!(read(Some(series)).unwrap().value(1, 0, 0), 2.0 * noise([1, 0, 0]), "{series}");
    }
    assert!(refusal(read(Some("FLAIR"))).contains("there is no series \"FLAIR\" among its 2"));
    assert!(refusal(read(Some("T"))).contains("is a part of the names of several series"));
    // With masks beside them, label maps are the masks, and a volume has to be chosen still.
    folder.write("lesion.nii.gz", &gzip(&nifti(0.0, ElementType::U8, block(0, 3))));
    assert_eq!(layers(&folder).unwrap()[0].counts(), [5920, 480]);
    let entries = survey(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap();
    assert_eq!(entries.iter().map(|e| e.title.as_str()).collect::<Vec<_>>(), ["T1", "T2", "1 mask"]);
    assert!(refusal(read(None)).contains("3: 1 mask"));
    assert_eq!(read(Some("masks")).unwrap().value(0, 0, 0), 1.0);
    // A damaged scan does not keep the others from being read.
    let flair = gzip(&nifti(0.0, ElementType::U8, noise));
    folder.write("FLAIR.nii.gz", &flair[..flair.len() * 3 / 4]);
    assert_eq!(read(Some("T1")).unwrap().value(1, 0, 0), noise([1, 0, 0]));
    assert!(layers(&folder).unwrap_err().to_string().contains("FLAIR.nii.gz"));
}

#[test]
fn other_grids_are_resampled_with_a_note_or_refused_with_the_file() {
    let folder = Folder::new();
    for name in ["a.nii.gz", "b.nii.gz"] {
        folder.write(name, &gzip(&nifti(0.0, ElementType::U8, block(0, 3))));
    }
    folder.write("c.nii.gz", &gzip(&nifti(1.0, ElementType::U8, block(10, 12))));
    let read = layers(&folder).unwrap();
    assert_eq!(read[0].counts()[2], 480 * 2 / 3);
    assert_eq!(
        read[0].notes,
        [
            "1 of 3 masks, the first being c.nii.gz: It has another grid (2 x 2 x 2 mm) than the others; it was resampled."
        ]
    );
    folder.write("c.nii.gz", &gzip(&nifti(900.0, ElementType::U8, block(10, 12))));
    let refusal = layers(&folder).unwrap_err().to_string();
    assert!(refusal.contains("the mask lies elsewhere") && refusal.contains("c.nii.gz"), "{refusal}");
    // What is no mask in voxels that were not looked at before is refused when it is read.
    folder.write(
        "c.nii.gz",
        &gzip(&nifti(0.0, ElementType::U8, |at| if at[2] == 2 { 0.0 } else { block(0, 9)(at) + 1.0 })),
    );
    let refusal = layers(&folder).unwrap_err().to_string();
    assert!(
        refusal.contains("this is no mask: it has the values 2 and 1") && refusal.contains("c.nii.gz"),
        "{refusal}"
    );
}

#[test]
fn folders_of_other_things_are_not_taken() {
    let folder = Folder::new();
    let is_taken = || FolderReader.recognizes(folder.path(), &[]);
    folder.write("a.nii.gz", b"1");
    folder.write("b.dcm", b"1");
    folder.write("c.tif", b"1");
    folder.write(".d.nii", b"1");
    assert!(!is_taken());
    folder.write("e.mha", b"1");
    assert!(is_taken());
    // None of them can be read.
    assert!(survey(folder.path(), &ReadOptions::default(), &Progress::new()).is_err());
}

#[test]
fn names_are_counted_and_written_as_people_do() {
    let mut names = ["rib_10.nii", "rib_9.nii", "Rib_1.nii.gz", "aorta.mha"];
    names.sort_by(|a, b| natural_order(a, b));
    assert_eq!(names, ["aorta.mha", "Rib_1.nii.gz", "rib_9.nii", "rib_10.nii"]);
    assert_eq!(stem_of("adrenal_gland_left.nii.gz"), "adrenal gland left");
    assert_eq!(stem_of("Aorta.MHA"), "Aorta");
    assert_eq!(stem_of(".nii"), "");
}
