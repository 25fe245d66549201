use super::super::super::testing::{Folder, gzip};
use super::*;
use crate::read::{ReadOptions, read_labels, read_volume, survey};

/// Two structures that overlap in the second layer's, and one that shares the first layer.
const KEYS: &str = "Segment0_Color:=0.694118 0.478431 0.396078\nSegment0_Extent:=0 1 0 1 0 1\nSegment0_ID:=Segment_1\n\
    Segment0_LabelValue:=1\nSegment0_Layer:=0\nSegment0_Name:=Head: outside\n\
    Segment0_Tags:=Segmentation.Status:inprogress|TerminologyEntry:Segmentation category and type~\
    SCT^123037004^Anatomical Structure~SCT^64033007^Kidney~SCT^7771000^Left~Anatomic codes~^^~^^|\n\
    Segment1_Color:=0 1 0\nSegment1_LabelValue:=1\nSegment1_Layer:=1\nSegment1_Name:=Mass\n\
    Segment1_Tags:=TerminologyEntry:a~SCT^85756007^Tissue~SCT^85756007^Tissue~^^~~^^~^^|\n\
    Segment10_LabelValue:=7\nSegment10_Layer:=0\nSegment10_ID:=Segment_3\n\
    Segment2_LabelValue:=3\nSegment2_Layer:=5\nSegment2_Name:=Lost\n\
    Segmentation_ReferenceImageExtentOffset:=35 86 -1\nSegmentation_MasterRepresentation:=Binary labelmap\n";

fn nrrd(
    type_name: &str,
    sizes: &str,
    directions: &str,
    kinds: &str,
    encoding: &str,
    keys: &str,
    data: &[u8],
) -> Vec<u8> {
    let dimension = sizes.split_whitespace().count();
    let header = format!(
        "NRRD0004\n# comment\ntype: {type_name}\ndimension: {dimension}\nspace: left-posterior-superior\nsizes: {sizes}\n\
         space directions: {directions}\nkinds: {kinds}\nendian: big\nencoding: {encoding}\nspace origin: (10,20,30)\n{keys}\n"
    );
    [header.as_bytes(), data].concat()
}

/// 3 × 2 × 1 voxels in two layers, the layers along the first axis, as 3D Slicer writes them.
fn overlapping(encoding: &str, data: &[u8]) -> Vec<u8> {
    let directions = "none (2,0,0) (0,2,0) (0,0,2)";
    nrrd("unsigned char", "2 3 2 1", directions, "list domain domain domain", encoding, KEYS, data)
}

const INTERLEAVED: [u8; 12] = [0, 0, 1, 0, 1, 1, 7, 1, 0, 0, 9, 1];

fn read(bytes: &[u8]) -> Result<Vec<LabelMap>> {
    let folder = Folder::new();
    read_labels(&folder.write("a.seg.nrrd", bytes), &ReadOptions::default(), &Progress::new())
}

fn names(layer: &LabelMap) -> Vec<(u32, &str)> {
    layer.labels.iter().map(|l| (l.id, l.name.as_str())).collect()
}

#[test]
fn layers_names_colors_and_codes() {
    let hex: String = INTERLEAVED.iter().map(|b| format!("{b:02x}")).collect();
    let text: String = INTERLEAVED.iter().map(|b| format!("{b} ")).collect();
    for (encoding, data) in [
        ("raw", INTERLEAVED.to_vec()),
        ("gzip", gzip(&INTERLEAVED)),
        ("hex", hex.into_bytes()),
        ("ascii", text.into_bytes()),
    ] {
        let layers = read(&overlapping(encoding, &data)).unwrap();
        assert_eq!(layers.len(), 2, "{encoding}");
        assert_eq!(names(&layers[0]), [(0, "background"), (1, "Head: outside"), (7, "Segment 3"), (9, "9")]);
        assert_eq!(layers[0].voxels, [0, 1, 1, 2, 0, 3]);
        assert_eq!(names(&layers[1]), [(0, "background"), (1, "Mass")]);
        assert_eq!(layers[1].voxels, [0, 0, 1, 1, 0, 1]);
        let head = &layers[0].labels[1];
        assert_eq!((head.color, head.code.as_deref()), ([177, 122, 101], Some("SCT:64033007+SCT:7771000")));
        assert_eq!((layers[1].labels[1].color, &layers[1].labels[1].code), ([0, 255, 0], &None));
        assert_eq!(layers[0].notes, ["The structure `Lost` has no voxels of its own and was left out."]);
        // The origin is where the stored part begins, whatever its place in the reference image.
        assert_eq!(layers[0].grid.world_from_index().translation.to_array(), [-10.0, -20.0, 30.0]);
    }
}

#[test]
fn layers_along_the_last_axis_and_wide_numbers() {
    let layered: Vec<u8> = (0..2).flat_map(|l| (0..6).map(move |i| INTERLEAVED[2 * i + l])).collect();
    let wide: Vec<u8> = layered.iter().flat_map(|b| [1, *b]).collect();
    let directions = "(2,0,0) (0,2,0) (0,0,2) none";
    let bytes = nrrd("ushort", "3 2 1 2", directions, "domain domain domain list", "gzip", KEYS, &gzip(&wide));
    let layers = read(&bytes).unwrap();
    assert_eq!(layers[1].labels.iter().map(|l| l.id).collect::<Vec<_>>(), [0, 1, 256, 257]);
    assert_eq!(layers[1].voxels, [2, 2, 3, 3, 2, 3]);
}

#[test]
fn a_segmentation_of_one_layer_is_a_label_map_and_a_volume() {
    let bytes = nrrd(
        "unsigned char",
        "3 2 1",
        "(2,0,0) (0,2,0) (0,0,2)",
        "domain domain domain",
        "raw",
        KEYS,
        &[0, 1, 7, 7, 1, 0],
    );
    let folder = Folder::new();
    let path = folder.write("a.seg.nrrd", &bytes);
    let (options, progress) = (ReadOptions::default(), Progress::new());
    assert!(survey(&path, &options, &progress).unwrap()[0].is_labels);
    let volume = read_volume(&path, &options, &progress).unwrap();
    assert_eq!(volume.value(2, 0, 0), 7.0);
    let layers = read_labels(&path, &options, &progress).unwrap();
    assert_eq!((layers.len(), layers[0].voxels.as_slice()), (1, &[0, 1, 2, 2, 1, 0][..]));
    // Of voxels that become one, the label of the middle.
    let window = Window { crop: Some([[0, 3], [1, 2], [0, 1]]), reduce: [3, 1, 1] };
    let layers = read_labels(&path, &ReadOptions { window, ..options }, &progress).unwrap();
    assert_eq!((layers[0].grid.dims(), layers[0].voxels.as_slice()), ([1, 1, 1], &[1][..]));
    assert!(layers[0].notes.iter().any(|n| n.contains("were loaded")), "{:?}", layers[0].notes);
}

#[test]
fn a_mask_per_structure_as_written_before_2020() {
    let keys = "Segment0_Name:=a\nSegment0_Color:=1 0 0\nSegment1_Name:=b\nSegment2_Name:=c\n";
    let directions = "none (2,0,0) (0,2,0) (0,0,2)";
    // c overlaps a; b lies apart; nothing is d.
    let data = [1, 0, 0, 0, 1, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let bytes = nrrd("uchar", "4 3 2 1", directions, "list domain domain domain", "raw", keys, &data);
    let layers = read(&bytes).unwrap();
    assert_eq!(names(&layers[0]), [(0, "background"), (1, "a"), (2, "b"), (4, "4")]);
    assert_eq!(layers[0].voxels, [1, 1, 2, 0, 0, 0]);
    assert_eq!(
        (names(&layers[1]), &layers[1].voxels[..]),
        (vec![(0, "background"), (3, "c")], &[0, 1, 0, 0, 0, 0][..])
    );
}

#[test]
fn what_is_no_label_map_is_refused() {
    let refusal = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
    let plain = |type_name: &str, keys: &str, data: &[u8]| {
        nrrd(type_name, "1 1 1", "(2,0,0) (0,2,0) (0,0,2)", "domain domain domain", "raw", keys, data)
    };
    let fractional = KEYS.replace("Binary", "Fractional");
    assert!(refusal(&plain("uchar", &fractional, &[9])).contains("its structures are fractional"));
    assert!(refusal(&plain("signed char", KEYS, &[0xff])).contains("a voxel is -1, which numbers no structure"));
    assert!(refusal(&plain("float", KEYS, &0.5_f32.to_be_bytes())).contains("a voxel is 0.5"));
    let short = overlapping("gzip", &gzip(&INTERLEAVED[..7]));
    assert!(refusal(&short).contains("ends after 7 of 12 bytes of voxels"), "{}", refusal(&short));
}

#[test]
fn damage_anywhere_gives_a_sentence() {
    let good = overlapping("gzip", &gzip(&INTERLEAVED));
    for i in 0..good.len() {
        let _ = read(&good[..i]);
        for value in [0x00, 0x20, b'9', b'_', 0xff] {
            let mut bytes = good.clone();
            bytes[i] = value;
            if let Ok(layers) = read(&bytes) {
                assert!(layers.iter().all(|l| l.voxels.len() == l.grid.num_voxels() && l.voxels.len() < 1 << 20));
            }
        }
    }
}
