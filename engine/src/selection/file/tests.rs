use glam::{DAffine3, DMat3, DVec3};

use super::*;
use crate::selection::{Limits, Selection, Shape};
use crate::volume::labels::numbered;

fn grid() -> Grid {
    let matrix3 = DMat3::from_rotation_z(0.3) * DMat3::from_diagonal(DVec3::new(0.7, 0.9, 1.25));
    Grid::new([33, 26, 19], DAffine3 { matrix3, translation: DVec3::new(-12.3, 4.56, 100.1) }).unwrap()
}

fn balls(spots: &[(u32, &str, f64, f64)]) -> Vec<Structure> {
    let pool = Arc::default();
    let ball = |&(id, name, x, radius): &(u32, &str, f64, f64)| {
        let center = grid().world_from_index().transform_point3(DVec3::new(x, 13.0, 9.0));
        let selection =
            Shape::ball(center, radius).select(&grid(), &Limits::default(), &pool, &Progress::new()).unwrap();
        let code = (id == 7).then(|| "SCT:64033007+SCT:7771000".to_owned());
        Structure { label: Label { name: name.to_owned(), code, ..numbered(id) }, selection }
    };
    spots.iter().map(ball).collect()
}

fn voxels(selection: &Selection) -> Vec<u8> {
    selection.values(selection.grid().dims().map(|n| [0, n]))
}

#[test]
fn fractional_files_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    let all = balls(&[(7, "left \\ kidney: a=b", 9.0, 6.0), (70_000, "Leber ü", 20.0, 7.0), (3, "far", 900.0, 4.0)]);
    for structures in [&all[..], &all[..1], &all[2..]] {
        write_fractional(&path, structures, &Progress::new()).unwrap();
        let (back, notes) = read_selections(&path, &grid(), &Arc::default(), &Progress::new()).unwrap();
        assert!(notes.is_empty(), "{notes:?}");
        assert_eq!(back.len(), structures.len());
        for (back, structure) in back.iter().zip(structures) {
            assert_eq!(back.label, structure.label);
            assert!(voxels(&back.selection) == voxels(&structure.selection));
        }
    }
    // On a grid with fewer and larger voxels the volume stays.
    let coarse = Grid::new([12, 10, 19], grid().world_from_index() * DAffine3::from_scale(DVec3::new(2.9, 2.9, 1.0)));
    write_fractional(&path, &all[..2], &Progress::new()).unwrap();
    let (back, notes) = read_selections(&path, &coarse.unwrap(), &Arc::default(), &Progress::new()).unwrap();
    assert!(notes.iter().any(|n| n.contains("another grid")), "{notes:?}");
    assert!((back[0].selection.volume_ml() / all[0].selection.volume_ml() - 1.0).abs() < 0.02);
    let far = Grid::new([9; 3], DAffine3::from_translation(DVec3::splat(5000.0))).unwrap();
    let error = read_selections(&path, &far, &Arc::default(), &Progress::new()).unwrap_err();
    assert!(error.to_string().contains("outside of the grid"), "{error}");
    // As label maps they are refused, and cut short they are damaged.
    let error = read_labels(&path, &ReadOptions::default(), &Progress::new()).unwrap_err();
    assert!(error.to_string().contains("fractional"), "{error}");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 40]).unwrap();
    assert!(read_selections(&path, &grid(), &Arc::default(), &Progress::new()).is_err());
}

#[test]
fn binary_files_keep_names_colors_codes_and_overlaps() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.seg.nrrd");
    for ids in [[7, 9, 200], [7, 300, 65_535], [7, 70_000, u32::MAX]] {
        let structures = balls(&[(ids[0], "one", 9.0, 6.0), (ids[1], "two", 12.0, 6.0), (ids[2], "three", 25.0, 5.0)]);
        write_segmentation(&path, &structures, &Progress::new()).unwrap();
        let header = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
        let type_name = if ids[2] < 256 {
            "uint8"
        } else if ids[2] < 65_536 {
            "uint16"
        } else {
            "uint32"
        };
        assert!(
            header.contains(&format!("type: {type_name}\n")) && header.contains("sizes: 2 33 26 19"),
            "{header:.200}"
        );
        let (back, notes) = read_selections(&path, &grid(), &Arc::default(), &Progress::new()).unwrap();
        assert!(notes.is_empty(), "{notes:?}");
        assert_eq!(back.len(), 3);
        for structure in &structures {
            let same = back.iter().find(|b| b.label == structure.label).unwrap();
            let crisp: Vec<u8> = voxels(&structure.selection).iter().map(|f| if *f > 127 { 255 } else { 0 }).collect();
            assert!(voxels(&same.selection) == crisp);
        }
    }
    // Two of one name, one empty.
    let twice = balls(&[(1, "rib", 9.0, 4.0), (2, "rib", 25.0, 4.0), (3, "none", 900.0, 4.0)]);
    write_segmentation(&path, &twice, &Progress::new()).unwrap();
    let (back, _) = read_selections(&path, &grid(), &Arc::default(), &Progress::new()).unwrap();
    let names: Vec<&str> = back.iter().map(|s| s.label.name.as_str()).collect();
    assert_eq!(names, ["rib", "rib (2)", "none"]);
    assert!(back[2].selection.is_empty());
    assert!(write_segmentation(&path, &[], &Progress::new()).unwrap_err().to_string().contains("no selection"));
    let progress = Progress::new();
    progress.cancel();
    assert!(matches!(write_fractional(&folder.path().join("b.nrrd"), &twice, &progress), Err(Error::Cancelled)));
    assert!(!folder.path().join("b.nrrd").exists());
}
