use super::super::testing::Folder;
use super::*;

fn read(text: impl AsRef<[u8]>) -> LabelTable {
    read_label_table(&Folder::new().write("table.txt", text.as_ref())).unwrap()
}

fn refusal(text: impl AsRef<[u8]>) -> String {
    let sentence = read_label_table(&Folder::new().write("table.txt", text.as_ref())).unwrap_err().to_string();
    assert!(sentence.contains("; ") && sentence.contains("table.txt"), "{sentence}");
    sentence
}

fn entry(table: &LabelTable, id: u32) -> (&str, [u8; 3], &str) {
    let entry = &table.entries[&id];
    (entry.name.as_deref().unwrap_or(""), entry.color.unwrap_or_default(), entry.code.as_deref().unwrap_or(""))
}

const SLICER: &str = "# Color table file C:/Data/Segmentation-label_ColorTable.ctbl\n# 4 values\n\
    0 Background 0 0 0 0\n1 artery 216 101 79 255\n2 bone 241 214 145 255\n3 connective_tissue 111 184 210 255\n";
const SLICER_CSV: &str = "LabelValue,Name,Color_R,Color_G,Color_B,Color_A,Category_CodingScheme,Category_CodeValue,\
    Category_CodeMeaning,Type_CodingScheme,Type_CodeValue,Type_CodeMeaning,TypeModifier_CodingScheme,\
    TypeModifier_CodeValue,TypeModifier_CodeMeaning\n\
    1,\"kidney, left\",185,102,83,255,SCT,123037004,Anatomical Structure,SCT,64033007,Kidney,SCT,7771000,Left\n\
    10,,127,127,127,255,SCT,123037004,Anatomical Structure,SCT,64033007,Kidney,SCT,24028007,Right\n\
    12,liver,,,,,SCT,123037004,,SCT,10200004,Liver,,,\n7,lump,1,2,3,255,SCT,85756007,Tissue,SCT,85756007,Tissue,,,\n";
const ITK_SNAP: &str = "################################################\n# ITK-SnAP Label Description File\n\
    # File format: \n# IDX   -R-  -G-  -B-  -A--  VIS MSH  LABEL\n\
    ################################################\n    0     0    0    0        0  0  0    \"Clear Label\"\n\
    \x20   1   255    0    0        1  1  1    \"Label one (l1)\"\n  614454277 10 20 30 255 1 1 \u{201c}Thalamus\u{201d}\n\
    \x20   3    51   51  255      0.5  1  1    Caudate nucleus\n";
const FREESURFER: &str = "#$Id: FreeSurferColorLUT.txt,v 1.70 $\n\n#No. Label Name:                 R   G   B   A\n\n\
    0   Unknown                                 0   0   0   0\n2   Left-Cerebral-White-Matter 245 245 245 0\n\
    17  Left-Hippocampus                        220 216 20  0   1\n\n1035 ctx_lh_insula  255 192 32  0\n";

#[test]
fn slicers_tables() {
    let table = read(SLICER);
    assert_eq!(table.format, "3D Slicer color table");
    assert_eq!(entry(&table, 3), ("connective tissue", [111, 184, 210], ""));
    assert_eq!((table.entries.len(), table.notes.len()), (4, 0));
    // Against the format, names with blanks.
    let blanks = read("# Color table file a\n3 rib 12 left 111 184 210 255\n");
    assert_eq!(entry(&blanks, 3), ("rib 12 left", [111, 184, 210], ""));

    let table = read(SLICER_CSV);
    assert_eq!(table.format, "3D Slicer color table (CSV)");
    assert_eq!(entry(&table, 1), ("kidney, left", [185, 102, 83], "SCT:64033007+SCT:7771000"));
    assert_eq!(entry(&table, 10), ("Right Kidney", [127; 3], "SCT:64033007+SCT:24028007"));
    assert_eq!(entry(&table, 12), ("liver", [0; 3], "SCT:10200004"));
    assert_eq!(table.entries[&12].color, None);
    // What nobody described is "tissue", which names nothing.
    assert_eq!(entry(&table, 7), ("lump", [1, 2, 3], ""));
    assert!(refusal("# Color procedural file a\n0 0 0 0\n").contains("continuous color scale"));
}

#[test]
fn itk_snaps_descriptions() {
    let table = read(ITK_SNAP);
    assert_eq!(table.format, "ITK-SNAP label descriptions");
    assert_eq!(entry(&table, 1), ("Label one (l1)", [255, 0, 0], ""));
    assert_eq!(entry(&table, 614_454_277), ("Thalamus", [10, 20, 30], ""));
    assert_eq!(entry(&table, 3), ("Caudate nucleus", [51, 51, 255], ""));
    // Without its head, the lines tell.
    let lines: String = ITK_SNAP.lines().filter(|l| !l.starts_with('#')).map(|l| format!("{l}\n")).collect();
    assert_eq!(read(lines), table);
}

#[test]
fn freesurfers_table_and_its_opacities() {
    let table = read(FREESURFER);
    assert_eq!(table.format, "FreeSurfer color table");
    assert_eq!(entry(&table, 2), ("Left-Cerebral-White-Matter", [245; 3], ""));
    assert_eq!(entry(&table, 17), ("Left-Hippocampus", [220, 216, 20], ""));
    assert_eq!(entry(&table, 1035), ("ctx_lh_insula", [255, 192, 32], ""));
    // Without a head, opacities of 0 are FreeSurfer's, and others Slicer's, who writes blanks as underscores.
    let lines = |text: &str| text.lines().filter(|l| !l.starts_with('#')).map(|l| format!("{l}\n")).collect::<String>();
    assert_eq!(read(lines(FREESURFER)), table);
    assert_eq!(read(lines(SLICER)), read(SLICER));
    // SimNIBS separates by tabulators and has blanks in its names; other programs leave the opacity out.
    let table = read("#No.\tLabel Name:\tR\tG\tB\tA\n1\tWhite Matter\t230\t230\t210\t0\n");
    assert_eq!(entry(&table, 1), ("White Matter", [230, 230, 210], ""));
    assert_eq!(entry(&read("1 12 255 0 7\n"), 1), ("12", [255, 0, 7], ""));
}

#[test]
fn json_in_the_shapes_that_programs_write() {
    for text in [
        r#"{"1": "spleen", "2": "liver"}"#,
        r#"{"labels": {"background": 0, "spleen": 1, "liver": 2, "both": [1, 2]}}"#,
        r#"{"labels": {"0": "background", "1": "spleen", "2": "liver"}, "channel_names": {"0": "CT"}}"#,
        r#"[{"id": 1, "name": "spleen", "acronym": "SP"}, {"id": 2, "name": "liver"}]"#,
        r#"{"spleen": {"id": 1}, "liver": {"id": "2"}}"#,
    ] {
        let table = read(text);
        assert_eq!((entry(&table, 1).0, entry(&table, 2).0), ("spleen", "liver"), "{text}");
    }
    let table = read(
        r##"{"1": {"name": "a", "color": "#ff8000"}, "2": {"name": "b", "color": [1, 2, 3, 255]},
        "3": {"SegmentLabel": "c", "recommendedDisplayRGBValue": [9, 8, 7],
              "SegmentedPropertyTypeCodeSequence": {"CodeValue": "10200004", "CodingSchemeDesignator": "SCT"}}}"##,
    );
    assert_eq!(entry(&table, 1), ("a", [255, 128, 0], ""));
    assert_eq!(entry(&table, 2), ("b", [1, 2, 3], ""));
    assert_eq!(entry(&table, 3), ("c", [9, 8, 7], "SCT:10200004"));
    assert!(refusal("{\"1\": \"a\",\n\"2\": }").contains("line 2 of the table is no JSON"));
    assert!(refusal(r#"{"spleen": -1}"#).contains("the entry `spleen`"));
    assert!(refusal(r#"{"1": {"name": "a", "color": [300, 0, 0]}}"#).contains("the entry `1`"));
    assert!(refusal("[]").contains("has no entry"));
}

#[test]
fn columns_with_and_without_a_head() {
    // BIDS.
    let table = read("index\tname\tabbreviation\tcolor\n1\tGray Matter\tGM\t#ff53bb\n2\tWhite Matter\tWM\t#2f8bbd\n");
    assert_eq!(entry(&table, 2), ("White Matter", [0x2f, 0x8b, 0xbd], ""));
    for text in
        ["id,name\n7,left lung\n", "Label;Structure\n7;left lung\n", "7,left lung\n", "7\tleft lung\n", "7 left lung\n"]
    {
        assert_eq!(entry(&read(text), 7).0, "left lung", "{text}");
    }
    // A spreadsheet's: a mark, numbers with a point, an empty last line, colors to 1.
    let table = read("\u{feff}ID,Label,Red,Green,Blue\r\n1.0,a,0.5,0,1\r\n2.0,b,1,1,0\r\n,,,,\r\n");
    assert_eq!(entry(&table, 1), ("a", [128, 0, 255], ""));
    assert_eq!(entry(&table, 2), ("b", [255, 255, 0], ""));
}

#[test]
fn every_encoding_and_line_end() {
    let text = "1 Stœr 10 20 30 0\n2 Muñón 40 50 60 0\n";
    let table = read(text);
    let utf16: Vec<u16> = text.encode_utf16().collect();
    let little = [&[0xff, 0xfe][..], &utf16.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>()].concat();
    let big = [&[0xfe, 0xff][..], &utf16.iter().flat_map(|w| w.to_be_bytes()).collect::<Vec<u8>>()].concat();
    assert_eq!(read(little), table);
    assert_eq!(read(big), table);
    assert_eq!(read(text.replace('\n', "\r\n")), table);
    assert_eq!(read(text.replace('\n', "\r")), table);
    assert_eq!(read(format!("\u{feff}{text}")), table);
    assert_eq!(entry(&read(b"2 Mu\xf1\xf3n 40 50 60 0\n"), 2).0, "Muñón");
}

#[test]
fn what_is_wrong_is_said_with_its_line() {
    assert!(
        refusal("# Color table file a\n1 a 1 2 3 255\n\n2 b 1 2\n").contains("line 4 of the table, `2 b 1 2`, is not")
    );
    assert!(refusal("1 a 1 2 3 0\n2 b 1 2 300 0\n").contains("line 2 of the table"));
    assert!(refusal(format!("{ITK_SNAP}nonsense\n")).contains("line 10 of the table"));
    assert!(refusal(format!("{SLICER_CSV}-4,a\n")).contains("has no number of a structure"));
    assert!(refusal("id,name,color\n1,a,reddish\n").contains("line 2 of the table, `1,a,reddish`"));
    assert!(refusal("1,a\nb,c\n").contains("line 2 of the table"));
    for text in [&b"hello\n"[..], b"1 2 3\n", b"\x1f\x8b\x00\x01", b"NRRD0004\ntype: uchar\n", b"<xml/>", b"1\n2\n"] {
        assert!(refusal(text).contains("no table of labels that Fabrica knows"), "{text:?}");
    }
    assert!(refusal("").contains("has no entry") && refusal("# only words\n").contains("has no entry"));
    assert!(refusal(vec![b'\n'; (16 << 20) + 1]).contains("longer than 16 MiB"));
    let folder = Folder::new();
    assert!(read_label_table(folder.path()).unwrap_err().to_string().contains("this is no file"));
    assert!(read_label_table(Path::new("/no/such.ctbl")).unwrap_err().to_string().contains("no such file"));
}

#[test]
fn the_last_of_two_lines_counts() {
    let table = read("1 a 1 2 3 0\n2 b 4 5 6 0\n1 c 7 8 9 0\n");
    assert_eq!(entry(&table, 1), ("c", [7, 8, 9], ""));
    assert_eq!(table.notes, ["The number 1 comes twice in the table; the last line counts."]);
}

#[test]
fn damage_anywhere_is_an_error_or_a_table() {
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    };
    let folder = Folder::new();
    let json = r##"{"labels": {"1": {"name": "a", "color": "#ff8000"}, "2": {"color": [1, 2, 3]}}}"##;
    for text in [SLICER, SLICER_CSV, ITK_SNAP, FREESURFER, json] {
        for _ in 0..400 {
            let mut bytes = text.as_bytes().to_vec();
            for _ in 0..1 + random() % 8 {
                let at = random() % bytes.len().max(1);
                bytes.resize(bytes.len().max(1), b'1');
                match random() % 4 {
                    0 => bytes[at] = random() as u8,
                    1 => drop(bytes.remove(at)),
                    2 => bytes.insert(at, b"\t \n\",;#0e-\xc3"[random() % 11]),
                    _ => bytes.truncate(at + 1),
                }
            }
            let _ = read_label_table(&folder.write("a.txt", &bytes));
        }
    }
    for _ in 0..300 {
        let bytes: Vec<u8> = (0..random() % 200).map(|_| random() as u8).collect();
        let _ = read_label_table(&folder.write("a.txt", &bytes));
    }
    let _ = read_label_table(&folder.write("a.txt", &[b'['; 1 << 16])).unwrap_err();
}
