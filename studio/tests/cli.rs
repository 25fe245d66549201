//! The program as a user runs it: files in, files out, sentences, exit codes.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fabrica_engine::image_out::{PngOptions, save_png};
use fabrica_engine::styles::StyleLibrary;

const TEMPLATE: &str = r#"{
  "fabrica": 1,
  "volumes": [{"name": "v", "file": "block.raw", "raw": "8x8x8xuint8"}],
  "objects": [{"volume": "v", "transfer_function": {"domain": "data", "nodes": [{"at": 50, "style": "clay", "opacity": 0.9}]}}],
  "camera": {"from": [0.5, 1, 0.4], "height": 2.5},
  "background": "transparent",
  "figure": {"width_mm": 12.7, "height_mm": 12.7, "dpi": 100}
}"#;

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("block.raw"), [100u8; 512]).unwrap();
        std::fs::write(folder.path().join("figure.json"), TEMPLATE).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_fabrica"))
            .args(arguments)
            .current_dir(self.folder.path())
            .env("FABRICA_CACHE", self.path("cache"))
            .env("FABRICA_STATE", self.path("state"))
            // No test opens a window on somebody's desk.
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET")
            .output()
            .unwrap()
    }

    /// Runs what must fail; the one sentence it says.
    fn fails(&self, arguments: &[&str], code: i32) -> String {
        let output = self.run(arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
        assert!(!message.contains("panicked"), "{message}");
        message
    }
}

/// Width, height, color type and pixels per meter from a PNG's chunks.
fn png_facts(path: &Path) -> (u32, u32, u8, u32) {
    let bytes = std::fs::read(path).unwrap();
    let word = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    let phys = bytes.windows(4).position(|w| w == b"pHYs").unwrap();
    assert!(bytes.windows(4).any(|w| w == b"sRGB"));
    (word(16), word(20), bytes[25], word(phys + 4))
}

#[test]
fn render_writes_the_figure_at_its_physical_size() {
    let place = Place::new();
    let picture = place.path("a.png");
    let render = |more: &[&str]| {
        let mut arguments = vec!["render", "figure.json", "--out", "a.png", "--adapter", "software"];
        arguments.extend(more);
        let output = place.run(&arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        png_facts(&picture)
    };
    assert_eq!(render(&[]), (50, 50, 6, 3937));
    assert_eq!(render(&["--dpi", "200"]), (100, 100, 6, 7874));
    assert_eq!(render(&["--size", "40x20"]), (40, 20, 6, 3150));
    assert_eq!(render(&["--size", "40x20", "--dpi", "300"]), (40, 20, 6, 11811));
    // An opaque background needs no alpha channel.
    assert_eq!(render(&["--background", "#204060"]), (50, 50, 2, 3937));
    let first = std::fs::read(&picture).unwrap();
    render(&["--background", "#204060"]);
    assert_eq!(first, std::fs::read(&picture).unwrap(), "the same command writes the same bytes");
    assert_eq!(std::fs::read_dir(place.folder.path()).unwrap().count(), 3, "nothing is left beside the picture");
}

#[test]
fn a_theme_is_an_option_a_field_and_if_unknown_a_warning() {
    let place = Place::new();
    let drawn = |template: &str, options: &[&str]| {
        let mut arguments = vec!["render", template, "--out", "theme.png"];
        arguments.extend(options);
        let output = place.run(&arguments);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{options:?}: {said}");
        (std::fs::read(place.path("theme.png")).unwrap(), png_facts(&place.path("theme.png")).2, said)
    };
    const RGB: u8 = 2;
    const RGBA: u8 = 6;
    let (own, kind, _) = drawn("figure.json", &[]);
    assert_eq!(kind, RGBA);
    let (themed, kind, said) = drawn("figure.json", &["--theme", "watercolor"]);
    assert!(themed != own && kind == RGB && !said.contains("theme"), "{said}");
    // The background of the command line has the last word.
    let (clear, kind, _) = drawn("figure.json", &["--theme", "watercolor", "--background", "transparent"]);
    assert!(clear != own && clear != themed && kind == RGBA);
    let with = |theme: &str| TEMPLATE.replace("\"fabrica\": 1,", &format!("\"fabrica\": 1, \"theme\": \"{theme}\","));
    std::fs::write(place.path("themed.json"), with("watercolor")).unwrap();
    assert!(drawn("themed.json", &[]).0 == themed && drawn("themed.json", &["--theme", "none"]).0 == own);
    std::fs::write(place.path("unknown.json"), with("impasto")).unwrap();
    let (picture, _, said) = drawn("unknown.json", &[]);
    assert!(picture == own && said.contains("warning: there is no theme \"impasto\"; choose one of"), "{said}");
    let message = place.fails(&["render", "figure.json", "--theme", "impasto", "--out", "no.png"], 2);
    assert!(message.contains("choose one of anatomical_plate,") && message.contains("or none"), "{message}");
}

#[test]
fn own_themes_are_listed_and_drawn_and_their_faults_said() {
    let place = Place::new();
    let own = |name: &str, style: &str| {
        format!(
            r##"{{"themes": [{{"name": "{name}", "title": "Forest", "description": "Moss on bark.",
            "styles": {{"plaster": "{style}"}}, "background": "#2b2118"}}]}}"##
        )
    };
    let render = |options: &[&str]| {
        let output = place.run(&[&["render", "figure.json", "--out", "own.png"], options].concat());
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    // Among the user's own, and in a folder that is named.
    std::fs::create_dir_all(place.path("state/styles")).unwrap();
    std::fs::create_dir(place.path("more")).unwrap();
    std::fs::write(place.path("state/styles/themes.json"), own("forest", "organ")).unwrap();
    std::fs::write(place.path("more/themes.json"), own("meadow", "nerve")).unwrap();
    let listed = place.run(&["styles", "--styles", "more"]).stdout;
    let listed = String::from_utf8(listed).unwrap();
    assert!(listed.contains("\nforest            Moss on bark.\nmeadow "), "{listed}");
    assert_eq!(render(&[]).0, Some(0));
    let plain = std::fs::read(place.path("own.png")).unwrap();
    let is_quiet = |(code, said): (Option<i32>, String)| code == Some(0) && !said.contains("theme");
    assert!(is_quiet(render(&["--theme", "forest"])));
    let forest = std::fs::read(place.path("own.png")).unwrap();
    assert!(is_quiet(render(&["--theme", "meadow", "--styles", "more"])));
    let meadow = std::fs::read(place.path("own.png")).unwrap();
    assert!(plain != forest && forest != meadow && png_facts(&place.path("own.png")).2 == 2);
    assert!(
        place.fails(&["render", "figure.json", "--theme", "meadow", "--out", "no.png"], 2).contains("forest or none")
    );
    // Faults: of what was not named a warning, of what was named an error.
    std::fs::write(place.path("state/styles/themes.json"), own("watercolor", "organ")).unwrap();
    let (code, said) = render(&[]);
    let words = "warning: your own themes are left out: ";
    assert!(code == Some(0) && said.contains(words) && said.contains("\"watercolor\" is taken"), "{said}");
    std::fs::write(place.path("more/themes.json"), own("meadow", "daisy")).unwrap();
    let said = place.fails(&["styles", "--styles", "more"], 1);
    assert!(said.contains("the theme \"meadow\" has the style \"daisy\", which there is not"), "{said}");
}

#[test]
fn a_chosen_setting_is_stated_with_its_error() {
    let place = Place::new();
    for (option, number) in [("--max-error", "2"), ("--budget-ms", "1e6")] {
        let render = ["render", "figure.json", "--out", "a.png", "--adapter", "software", "--verbose"];
        let output = place.run(&[&render[..], &[option, number]].concat());
        let log = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{log}");
        let setting = log.lines().find_map(|l| l.strip_prefix("setting: ")).unwrap();
        for word in
            ["step ", "style change", "estimated error", "codes in 99.9 % of the pixels", "drawn again with a step"]
        {
            assert!(setting.contains(word), "no \"{word}\" in {setting}");
        }
        assert_eq!(setting.contains("estimated time"), option == "--budget-ms", "{setting}");
        // The picture says the same.
        let bytes = std::fs::read(place.path("a.png")).unwrap();
        assert!(bytes.windows(setting.len()).any(|w| w == setting.as_bytes()), "the picture does not say: {setting}");
    }
}

#[test]
fn volumes_fill_the_slots() {
    let place = Place::new();
    std::fs::write(place.path("other.raw"), [100u8; 64]).unwrap();
    let arguments = ["render", "figure.json", "--volume", "other.raw", "--raw", "4x4x4xuint8", "--out", "b.png"];
    let output = place.run(&arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let message =
        place.fails(&["render", "figure.json", "--raw", "4x4x4xuint8", "--volume", "other.raw", "--out", "b.png"], 2);
    assert!(message.contains("no --volume before it"), "{message}");
    let twice = ["render", "figure.json", "--volume", "other.raw", "--volume", "other.raw", "--out", "b.png"];
    assert!(place.fails(&twice, 1).contains("1 slot"));
    let message = place.fails(&["render", "figure.json", "--volume", "none.nii", "--out", "b.png"], 1);
    assert!(message.contains("none.nii"), "{message}");
}

#[test]
fn a_bare_volume_gets_a_template_that_can_be_drawn() {
    let place = Place::new();
    // Two frames of a bright block, one voxel from the edge; the second one is brighter.
    let block = |i: usize, value: u8| {
        let inside = [i % 8, i / 8 % 8, i / 64 % 8].iter().all(|n| (1..7).contains(n));
        if inside { value + (i * 7 % 32) as u8 } else { 0 }
    };
    std::fs::create_dir(place.path("data")).unwrap();
    std::fs::write(place.path("data/scan.raw"), (0..512).map(|i| block(i, 100)).collect::<Vec<u8>>()).unwrap();
    let layout = "8x8x8xuint8,2x2x2,little";
    let output = place.run(&["template", "data/scan.raw", "--raw", layout, "--out", "look.json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let template = json_file(&place.path("look.json"));
    assert_eq!(template["volumes"][0]["file"], "data/scan.raw", "named from the template's folder");
    assert_eq!(template["volumes"][0]["raw"], layout);
    assert_eq!(template["background"], "#ffffff");
    let render = ["render", "look.json", "--out", "a.png", "--adapter", "software", "--dpi", "10"];
    let output = place.run(&render);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(png_facts(&place.path("a.png")).0, 68, "173 mm at 10 dpi");

    // NRRD with a frame axis.
    let header = "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 8 8 8 2\nencoding: raw\n\n";
    let frames = (0..1024).map(|i| block(i, if i < 512 { 100 } else { 150 }));
    std::fs::write(place.path("frames.nrrd"), header.bytes().chain(frames).collect::<Vec<u8>>()).unwrap();
    let output = place.run(&["template", "frames.nrrd", "--frame", "1", "--out", "look.json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(json_file(&place.path("look.json"))["volumes"][0]["frame"], 1);
    assert!(place.run(&render).status.success());

    let output = place.run(&["template", "specimen:head@32", "--out", "look.json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(json_file(&place.path("look.json"))["volumes"][0]["file"], "specimen:head@32");
}

#[test]
fn specimens_need_no_file_and_are_cached() {
    let place = Place::new();
    let arguments = ["render", "figure.json", "--volume", "specimen:head@32", "--out", "c.png"];
    assert!(place.run(&arguments).status.success());
    let cached = std::fs::read_dir(place.path("cache")).unwrap().next().unwrap().unwrap().path();
    let first = std::fs::read(place.path("c.png")).unwrap();
    assert!(place.run(&arguments).status.success());
    assert_eq!(first, std::fs::read(place.path("c.png")).unwrap(), "from the cache comes the same picture");
    // A damaged cache costs time, not the picture.
    std::fs::write(&cached, b"NRRD0004\nnonsense").unwrap();
    assert!(place.run(&arguments).status.success());
    assert_eq!(first, std::fs::read(place.path("c.png")).unwrap());
    assert!(place.fails(&["inspect", "specimen:unicorn"], 1).contains("head"));
    assert!(place.fails(&["inspect", "specimen:head@x"], 2).contains("specimen:head@128"));
    assert!(place.fails(&["inspect", "specimen:head,tall"], 2).contains("mirrored"));
    assert!(place.fails(&["inspect", "specimen:head@32,without=tail"], 1).contains("mandible"));
}

#[test]
fn faults_are_one_sentence_and_leave_nothing() {
    let place = Place::new();
    for (arguments, code, expected) in [
        (vec!["render", "nowhere.json", "--out", "a.png"], 1, "nowhere.json"),
        (vec!["render", "figure.json", "--out", "a.jpg"], 2, "ending .png"),
        (vec!["render", "figure.json", "--out", "no/such/a.png"], 1, "create it first"),
        (vec!["render", "figure.json"], 2, "--out"),
        (vec!["render", "figure.json", "--out", "a.png", "--size", "0x5"], 2, "1024x768"),
        (vec!["render", "figure.json", "--out", "a.png", "--dpi", "0"], 2, "positive"),
        (vec!["render", "figure.json", "--out", "a.png", "--dpi", "1e9"], 1, "dpi"),
        (vec!["render", "figure.json", "--out", "a.png", "--background", "mauve"], 2, "#rrggbb"),
        (vec!["render", "figure.json", "--out", "a.png", "--quality", "best"], 2, "standard"),
        (vec!["render", "figure.json", "--out", "a.png", "--adapter", "Voodoo"], 1, "choose one of"),
        (vec!["render", "figure.json", "--out", "a.png", "--max-error", "-1"], 2, "positive"),
        (vec!["render", "figure.json", "--out", "a.png", "--max-error", "1", "--budget-ms", "9"], 2, "--budget-ms"),
        (vec!["render", "figure.json", "--out", "a.png", "--budget-ms", "9", "--quality", "draft"], 2, "--quality"),
        (vec!["render", "figure.json", "--out", "a.png", "--max-error", "1e-9"], 1, "the best is"),
        (vec!["render", "figure.json", "--out", "a.png", "--budget-ms", "1e-9"], 1, "the fastest that can be had"),
        (vec!["render", "block.raw", "--out", "a.png"], 1, "template"),
        (vec!["template", "nowhere.nii", "--out", "a.json"], 1, "nowhere.nii"),
        (vec!["template", "block.raw", "--out", "a.json"], 1, "--raw"),
        (vec!["template", "block.raw", "--raw", "nonsense", "--out", "a.json"], 2, "nonsense"),
        (vec!["template", "block.raw", "--out", "a.png"], 2, "ending .json"),
        (vec!["template", "block.raw", "--out", "no/such/a.json"], 1, "create it first"),
        (vec!["template", "specimen:head@x", "--out", "a.json"], 2, "specimen:head@128"),
        (vec!["inspect", "block.raw"], 1, "--raw"),
        (vec!["inspect", "block.raw", "--raw", "9x9x9xuint8"], 1, "512"),
        (vec!["inspect", "block.raw", "--raw", "nonsense"], 2, "nonsense"),
        (
            vec!["inspect", "block.raw", "--raw", "8x8x8xuint8", "--crop", "0:9x0:8x0:8"],
            1,
            "no part of the volume's 0..8",
        ),
        (vec!["inspect", "block.raw", "--raw", "8x8x8xuint8", "--memory", "1e-6"], 1, "--reduce 2x2x2"),
        (vec!["inspect", "block.raw", "--reduce", "0"], 2, "2x2x1"),
        (vec!["measure", "nowhere.json"], 1, "nowhere.json"),
        (vec!["measure", "figure.json", "--plot", "a.pdf"], 2, ".svg or .png"),
        (vec!["measure", "figure.json", "--plot", "no/such/a.svg"], 1, "create it first"),
        (vec!["measure", "figure.json", "--json", "no/such/a.json"], 1, "create it first"),
        (vec!["measure", "figure.json", "--json", "."], 1, "not name a file"),
        (vec!["measure", "figure.json", "--size", "16"], 2, "1024x768"),
        (vec!["measure", "figure.json", "--frames", "0"], 2, "--frames"),
        (vec!["measure", "figure.json", "--adapter", "Voodoo"], 1, "choose one of"),
        (vec!["measure", "figure.json", "--raw", "8x8x8xuint8"], 2, "no --volume before it"),
        (vec!["render", "figure.json", "--out", "a.png", "--borders", "blocky"], 2, "two-look-ups"),
        (vec!["render", "figure.json", "--out", "a.png", "--max-error", "1", "--borders", "exact"], 2, "--borders"),
        (vec!["bench", "figure.json", "--json", "no/such/a.json"], 1, "create it first"),
        (vec!["bench", "figure.json", "--orbit", "nan"], 2, "degrees"),
        (vec!["bench", "figure.json", "--quality", "best"], 2, "standard"),
        (vec!["bench", "figure.json", "--size", "70000x1"], 1, "65535"),
        (vec!["fly"], 2, "fly"),
        (vec![], 1, "without a display"),
        (vec!["open", "figure.json"], 1, "without a display"),
    ] {
        let message = place.fails(&arguments, code);
        assert!(message.contains(expected), "{arguments:?}: {message}");
        if code == 1 {
            // What is to be known of a volume that could be read comes before it.
            let faults = message.lines().filter(|line| !line.starts_with("warning: "));
            assert_eq!(faults.count(), 1, "{arguments:?}: {message}");
        }
    }
    assert_eq!(std::fs::read_dir(place.folder.path()).unwrap().count(), 2, "a failed command leaves nothing");
}

#[test]
fn inspect_schema_and_adapters_speak_json() {
    let place = Place::new();
    let json = |arguments: &[&str]| -> serde_json::Value {
        let output = place.run(arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let report = json(&["inspect", "block.raw", "--raw", "8x8x8xuint8,0.5x0.5x2", "--json"]);
    assert_eq!(report["dims"], serde_json::json!([8, 8, 8]));
    assert_eq!(report["spacing_mm"], serde_json::json!([0.5, 0.5, 2.0]));
    assert_eq!((&report["orientation"], &report["orientation_known"]), (&"RAS".into(), &false.into()));
    assert_eq!(report["datatype"], "uint8");
    assert_eq!((report["min"].as_f64(), report["num_nonfinite"].as_u64()), (Some(100.0), Some(0)));
    let specimen = json(&["inspect", "specimen:head@32", "--json"]);
    assert_eq!((&specimen["modality"], &specimen["orientation_known"]), (&"ct".into(), &true.into()));
    assert!(specimen["structures"].to_string().contains("skull"));
    let part = ["--raw", "8x8x8xuint8", "--crop", "0:4x0:8x0:8", "--reduce", "2"];
    let part = json(&[&["inspect", "block.raw", "--json"], &part[..]].concat());
    assert_eq!(
        (&part["dims"], &part["spacing_mm"]),
        (&serde_json::json!([2, 4, 4]), &serde_json::json!([2.0, 2.0, 2.0]))
    );
    assert!(part["warnings"].to_string().contains("2 x 4 x 4 were loaded (a part, reduced)"));
    let list = json(&["inspect", "block.raw", "--raw", "8x8x8xuint8", "--list", "--json"]);
    assert_eq!(
        (&list[0]["number"], &list[0]["bytes"], &list[0]["adapter_bytes"]),
        (&1.into(), &512.into(), &5120.into())
    );
    let variant = json(&["inspect", "specimen:turtle@32,mr,size=2,without=scutes", "--json"]);
    assert_eq!(variant["modality"], "mr");
    assert!((variant["size_mm"][1].as_f64().unwrap() - 624.0).abs() < 1.0, "{}", variant["size_mm"]);
    let scutes = variant["structures"].as_array().unwrap().iter().find(|s| s["name"] == "scutes").unwrap();
    assert_eq!(scutes["volume_ml"], 0.0);
    // From the cache as well.
    assert_eq!(json(&["inspect", "specimen:turtle@32,size=2,mr,without=scutes", "--json"])["modality"], "mr");
    assert_eq!(json(&["inspect", "specimen:engine@32", "--json"])["modality"], "unknown");
    let schema = json(&["schema"]);
    assert!(schema["properties"]["objects"].is_object() && schema["required"].to_string().contains("fabrica"));
    let styles = json(&["styles", "--json"]);
    assert!(styles["styles"].as_array().unwrap().len() >= 8);
    assert!(styles["themes"].as_array().unwrap().iter().any(|theme| theme["name"] == "watercolor"));
    let adapters = json(&["adapters", "--json", "--software"]);
    assert_eq!(adapters[0]["kind"], "software");
    let words = place.run(&["inspect", "block.raw", "--raw", "8x8x8xuint8"]);
    let words = String::from_utf8(words.stdout).unwrap();
    assert!(words.contains("orientation RAS (assumed: the file does not say)"), "{words}");
    let words = String::from_utf8(place.run(&["inspect", "specimen:head@32"]).stdout).unwrap();
    assert!(words.contains("orientation RAS\n"), "{words}");
}

#[test]
fn inspect_lists_the_structures_of_label_maps() {
    let place = Place::new();
    // 4 x 1 x 1 voxels of 10 mm: nothing, 1, 1, 2; and another two, further on.
    let segmentation = |origin: &str| {
        format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 1 1\nspace: RAS\nspace directions: (10,0,0) (0,10,0) (0,0,10)\n\
             space origin: ({origin},0,0)\nencoding: ascii\nSegment0_Name:=left\u{1b} lung\nSegment0_LabelValue:=1\n\
             Segment0_Color:=1 0 0.5\nSegment1_Name:=heart\nSegment1_LabelValue:=2\nSegment2_Name:=spleen\n\
             Segment2_LabelValue:=3\n\n0 1 1 2\n"
        )
    };
    std::fs::write(place.path("a.seg.nrrd"), segmentation("0")).unwrap();
    std::fs::write(place.path("part.seg.nrrd"), segmentation("20")).unwrap();
    std::fs::write(place.path("far.seg.nrrd"), segmentation("900")).unwrap();
    std::fs::write(place.path("table.txt"), "1 Lung 10 20 30 0\n2 Heart 40 50 60 0\n").unwrap();
    let plain = segmentation("0").replace("Segment", "Other").replace("0 1 1 2", "100 50 70 200");
    std::fs::write(place.path("scan.nrrd"), plain).unwrap();
    // So few values look like a label map's.
    let scan = ["inspect", "scan.nrrd", "--as", "scan"];
    let json = |more: &[&str]| -> serde_json::Value {
        let output = place.run(&[&scan[..], more, &["--json"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    assert!(json(&[]).get("structures").is_none());
    let report = json(&["--labels", "a.seg.nrrd"]);
    let lung = &report["structures"][0];
    assert_eq!((&lung["id"], &lung["color"], &lung["num_voxels"]), (&1.into(), &"#ff0080".into(), &2.into()));
    assert_eq!((&lung["mean"], &lung["volume_ml"]), (&60.0.into(), &2.0.into()));
    assert_eq!(report["structures"][2]["num_voxels"], 0);
    let report = json(&["--labels", "part.seg.nrrd", "--label-table", "table.txt"]);
    assert_eq!(report["structures"][0]["name"], "Lung");
    assert_eq!(report["structures"][0]["color"], "#0a141e");
    let notes = report["label_notes"].to_string();
    assert!(notes.contains("Of 3 structures, 1 is not in the table: 3.") && notes.contains("66.7 %"), "{notes}");
    assert!(
        place.fails(&[&scan[..], &["--labels", "far.seg.nrrd"]].concat(), 1).contains("the label map lies elsewhere")
    );
    assert!(place.fails(&[&scan[..], &["--label-table", "scan.nrrd"]].concat(), 1).contains("no table of labels"));
    // A label map alone, by what it says of itself and by what is said of it.
    for arguments in [&["inspect", "a.seg.nrrd"][..], &["inspect", "a.seg.nrrd", "--labels"]] {
        let words = String::from_utf8(place.run(arguments).stdout).unwrap();
        assert!(words.contains("structures  2") && words.contains("empty       1: spleen"), "{words}");
        assert!(words.contains("left\u{fffd} lung") && !words.contains('\u{1b}'), "{words}");
        // What is said of values means nothing of numbers of structures.
        assert!(!words.contains("Otsu") && !words.contains("percentile") && !words.contains("mean "), "{words}");
        assert!(words.contains("4 x 1 x 1 voxels, 8-bit unsigned integers"), "{words}");
    }
    let report: serde_json::Value =
        serde_json::from_slice(&place.run(&["inspect", "a.seg.nrrd", "--json"]).stdout).unwrap();
    assert!(report["datatype"] == "uint8" && report["histogram"].is_array() && report["structures"].is_array());
}

#[test]
fn what_is_taken_for_a_label_map_is_said_and_can_be_overruled() {
    let place = Place::new();
    let voxels: Vec<u8> = (0..512_u32).map(|i| u8::from(i % 8 > 3)).collect();
    std::fs::write(place.path("mask.raw"), voxels).unwrap();
    let mask = ["inspect", "mask.raw", "--raw", "8x8x8xuint8"];
    let words = |more: &[&str]| String::from_utf8(place.run(&[&mask[..], more].concat()).stdout).unwrap();
    let taken = words(&[]);
    assert!(
        taken.contains("Taken for a mask, as its only values are 0 and 1. If it is a scan, add --as scan."),
        "{taken}"
    );
    assert!(taken.contains("structures  1") && !taken.contains("Otsu"), "{taken}");
    let scan = words(&["--as", "scan"]);
    assert!(scan.contains("Otsu") && !scan.contains("structures") && !scan.contains("Taken"), "{scan}");
    let labels = words(&["--as", "labels"]);
    assert!(labels.contains("structures  1") && !labels.contains("Taken"), "{labels}");
    for (more, is_labels) in [(&[][..], true), (&["--as", "scan"], false)] {
        let arguments = [&["template", "mask.raw", "--raw", "8x8x8xuint8", "--out", "mask.json"][..], more].concat();
        let output = place.run(&arguments);
        assert!(output.status.success());
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(said.contains("add --as scan"), is_labels, "{said}");
        assert_eq!(json_file(&place.path("mask.json"))["volumes"][0]["labels"] == true, is_labels);
    }
}

#[test]
fn a_picture_stands_for_the_slices_beside_it() {
    let place = Place::new();
    std::fs::create_dir(place.path("slices")).unwrap();
    for i in 1..=5_u8 {
        let file = std::fs::File::create(place.path(&format!("slices/cut_{i:02}.png"))).unwrap();
        let mut encoder = png::Encoder::new(file, 4, 4);
        encoder.set_color(png::ColorType::Grayscale);
        let pixels: Vec<u8> = (0..16).map(|p| p * i * 3).collect();
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    }
    let output = place.run(&["inspect", "slices/cut_02.png"]);
    let words = String::from_utf8(output.stdout).unwrap();
    assert!(words.starts_with("PNG slices, 4 x 4 x 5 voxels, 8-bit unsigned integers"), "{words}");
    assert!(words.contains("warning: The file is one of 5 numbered slices"), "{words}");
    // One slice that is missing later shall not take the figure with it.
    let output = place.run(&["template", "slices/cut_02.png", "--out", "figure_of_slices.json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(json_file(&place.path("figure_of_slices.json"))["volumes"][0]["file"], "slices");
}

#[test]
fn a_ball_in_a_picture_becomes_a_style() {
    let place = Place::new();
    // Green in the light, in front of red.
    let pixel = |i: u32| {
        let (x, y) = (f64::from(i % 120) - 49.5, f64::from(i / 120) - 49.5);
        let green = (0.5 - 0.01 * y) as f32;
        if x.hypot(y) < 40.0 { [0.0, green, 0.0, 1.0] } else { [1.0, 0.0, 0.0, 1.0] }
    };
    let pixels: Vec<[f32; 4]> = (0..120 * 100).map(pixel).collect();
    save_png(&place.path("ball.png"), 120, 100, &pixels, &PngOptions::default()).unwrap();
    let extract = |arguments: &[&str]| place.run(&[&["styles", "extract", "ball.png"], arguments].concat());
    let output = extract(&["--circle", "50,50,40", "--out", "moss.png", "--verbose"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && said.contains("extracting: "), "{said}");
    let style = StyleLibrary::embedded().with_file(&place.path("moss.png")).get("moss").unwrap();
    assert!(style.mips[0].iter().all(|t| t[0] < 1e-3 && t[3] > 0.999), "what is behind the ball has no say");
    let green_at = |row: usize| style.mips[0][row * style.size + style.size / 2][1];
    assert!(
        (green_at(4) - 0.88).abs() < 0.03 && (green_at(127) - 0.5).abs() < 0.01,
        "{} {}",
        green_at(4),
        green_at(127)
    );
    // By its name alone it is among the user's own, which every command knows.
    assert!(extract(&["--circle", "50,50,40", "--name", "lichen", "--relight"]).status.success());
    let listed = String::from_utf8(place.run(&["styles"]).stdout).unwrap();
    assert!(listed.contains("\nlichen  "), "{listed}");
    for (arguments, code, words) in [
        (&["--circle", "50,50,1", "--out", "x.png"][..], 1, "too small for a style"),
        (&["--circle", "-900,50,40", "--out", "x.png"], 1, "wholly off the picture of 120 × 100 pixels"),
        (&["--circle", "50,50,40", "--out", "x.png", "--desaturate", "nan"], 1, "give a number from 0 to 1"),
        (&["--circle", "50,50,40", "--name", "bone"], 2, "is a built-in style"),
        (&["--circle", "50,50,40", "--name", "../x", "--out", "."], 2, "cannot be called"),
        (&["--circle", "50,50,40"], 2, "--name"),
        (&["--normals", "50,50,0,0", "--out", "x.png"], 1, "1 different normals are too few"),
        (&["--normals", "none.json", "--out", "x.png"], 1, "no such file"),
        (&["--normals", "50,50", "--out", "x.png"], 2, "neither a JSON file nor four numbers"),
    ] {
        let output = extract(arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(code) && said.contains(words), "{arguments:?}: {said}");
        assert!(!place.path("x.png").exists());
    }
}

#[test]
fn help_names_every_option() {
    let place = Place::new();
    for (command, words) in [
        (
            vec!["--help"],
            vec!["open", "render", "template", "measure", "bench", "inspect", "select", "adapters", "styles", "schema"],
        ),
        (
            vec!["render", "--help"],
            vec![
                "--volume",
                "--raw",
                "--frame",
                "--series",
                "--crop",
                "--reduce",
                "--memory",
                "--size",
                "--dpi",
                "--background",
                "--quality",
                "--adapter",
                "--out",
                "--max-error",
                "--budget-ms",
            ],
        ),
        (
            vec!["inspect", "--help"],
            vec![
                "--json",
                "--raw",
                "--series",
                "--frame",
                "--crop",
                "--reduce",
                "--memory",
                "--list",
                "--as",
                "--labels",
                "--label-table",
            ],
        ),
        (
            vec!["select", "--help"],
            vec![
                "--name",
                "--add",
                "--subtract",
                "--intersect",
                "--labels",
                "--invert",
                "--grow-mm",
                "--shrink-mm",
                "--smooth-mm",
                "--fill-holes",
                "--keep-largest",
                "--remove-smaller",
                "--out",
                "--json",
                "--raw",
                "tolerance=N",
                "range LOW..HIGH",
                "turn=R,A,S",
            ],
        ),
        (vec!["template", "--help"], vec!["--raw", "--series", "--frame", "--crop", "--reduce", "--memory", "--out"]),
        (
            vec!["measure", "--help"],
            vec!["--volume", "--raw", "--frame", "--size", "--frames", "--adapter", "--json", "--plot"],
        ),
        (
            vec!["bench", "--help"],
            vec!["--volume", "--frames", "--orbit", "--size", "--quality", "--adapter", "--json", "median_ms"],
        ),
    ] {
        let output = place.run(&command);
        assert!(output.status.success());
        let text = String::from_utf8(output.stdout).unwrap();
        for word in words {
            assert!(text.contains(word), "{command:?} does not mention {word}");
        }
    }
}

/// What `fabrica select` prints as JSON.
fn selected(place: &Place, arguments: &[&str]) -> serde_json::Value {
    let output = place.run(&[&["select"], arguments, &["--json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn select_takes_steps_in_their_order() {
    let place = Place::new();
    let skull = "specimen:head@48";
    let ml = |report: &serde_json::Value, i: usize| report["selections"][i]["volume_ml"].as_f64().unwrap();
    // The specimen's structures are the truth; its bone by value is nearly that.
    let report = selected(
        &place,
        &[
            skull,
            "--name",
            "bone",
            "--add",
            "range 250..",
            "--name",
            "truth",
            "--add",
            "labels specimen:head@48:skull,mandible,vertebrae",
            "--name",
            "both",
            "--add",
            "selection bone",
            "--intersect",
            "selection truth",
            "--name",
            "rest",
            "--add",
            "selection both",
            "--invert",
            "--out",
            "all.nrrd",
        ],
    );
    let names: Vec<_> = report["selections"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["bone", "truth", "both", "rest"]);
    assert!(ml(&report, 2) > 0.5 * ml(&report, 1) && ml(&report, 2) <= ml(&report, 0), "{report}");
    let mean = report["selections"][0]["mean"].as_f64().unwrap();
    assert!(mean > 250.0 && report["selections"][3]["mean"].as_f64().unwrap() < mean, "{report}");
    // What was written is what was measured, read back on the same scan.
    let again = selected(&place, &[skull, "--labels", "all.nrrd"]);
    for i in 0..4 {
        assert_eq!(report["selections"][i], again["selections"][i]);
    }
    // The order counts: growing before and after another is taken away.
    let ball = "ball 8,8,8 r=20";
    let hole = "ball 8,8,8 r=10";
    let first = selected(&place, &[skull, "--add", ball, "--grow-mm", "6", "--subtract", hole]);
    let last = selected(&place, &[skull, "--add", ball, "--subtract", hole, "--grow-mm", "6"]);
    assert!(ml(&first, 0) < ml(&last, 0) - 2.0, "{first} {last}");
    assert_eq!(first["selections"][0]["name"], "Selection 1");
    let filled = selected(&place, &[skull, "--add", ball, "--subtract", hole, "--fill-holes", "--shrink-mm", "1"]);
    let ball_ml = 4.0 / 3.0 * std::f64::consts::PI * 19_f64.powi(3) * 1e-3;
    // A ball of seven voxels across: a 25th of its volume is a 15th of a voxel on its radius.
    assert!((ml(&filled, 0) / ball_ml - 1.0).abs() < 0.04, "{filled}");
    // For 3-D Slicer, and for inspect.
    let output = place.run(&[
        "select",
        skull,
        "--labels",
        "specimen:head@48:skull,cerebellum",
        "--smooth-mm",
        "2",
        "-o",
        "two.seg.nrrd",
    ]);
    let words = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && words.contains("skull") && words.contains("R, A, S in mm"), "{words}");
    let output = place.run(&["inspect", skull, "--labels", "two.seg.nrrd", "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let structures = report["structures"].as_array().unwrap();
    assert_eq!((structures.len(), &structures[1]["name"]), (2, &"cerebellum".into()));
    assert!(structures.iter().all(|s| s["num_voxels"].as_u64() > Some(100)));
}

#[test]
fn select_refuses_with_a_sentence() {
    let place = Place::new();
    let block = ["select", "block.raw", "--raw", "8x8x8xuint8"];
    let usage = |more: &[&str]| place.fails(&[&block[..], more].concat(), 2);
    assert!(usage(&[]).contains("nothing to select"));
    assert!(usage(&["--name", "a"]).contains("nothing to select"));
    assert!(usage(&["--add", "cube 1,2,3"]).contains("`cube` is none of range"));
    assert!(usage(&["--add", "range 1..", "-o", "a.nii.gz"]).contains(".seg.nrrd"));
    assert!(usage(&["--grow-mm", "-1"]).contains("at least 0"));
    assert!(usage(&["--name", "a", "--name", "b", "--name", "a", "--add", "range 1.."]).contains("two selections `a`"));
    assert!(usage(&["--add", "selection later"]).contains("no selection `later`"));
    let fault = |more: &[&str]| place.fails(&[&block[..], more].concat(), 1);
    assert!(fault(&["--add", "grow 99,0,0 tolerance=1"]).contains("outside of the scan"));
    assert!(fault(&["--add", "labels none.nii.gz:liver"]).contains("no such file"));
    std::fs::write(place.path("other.raw"), [1u8; 512]).unwrap();
    assert!(fault(&["--add", "range 1..", "-o", "missing/a.nrrd"]).contains("no such folder"));
    // Nothing selected is no fault, but said.
    let report =
        selected(&place, &["block.raw", "--raw", "8x8x8xuint8", "--add", "range 200..", "-o", "none.seg.nrrd"]);
    assert_eq!(report["selections"][0]["volume_ml"], 0.0);
    assert!(report["notes"][0].as_str().unwrap().contains("`Selection 1` is empty"), "{report}");
}

#[test]
fn select_on_a_scan_with_its_label_map() {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let data = std::env::var_os("FABRICA_TEST_DATA").map_or_else(beside, PathBuf::from);
    if !data.is_dir() {
        eprintln!("skipped: no test data; set FABRICA_TEST_DATA");
        return;
    }
    let place = Place::new();
    let file = |name: &str| data.join(name).to_str().unwrap().to_owned();
    let (scan, labels) = (file("ct_abdomen_3mm_slab.nii.gz"), file("ct_abdomen_3mm_slab_labels.nii.gz"));
    let report = selected(&place, &[&scan, "--labels", &labels, "-o", "all.seg.nrrd"]);
    let structures = report["selections"].as_array().unwrap();
    assert!(structures.len() > 20, "{}", structures.len());
    let again = selected(&place, &[&scan, "--labels", "all.seg.nrrd"]);
    for structure in structures {
        let same = again["selections"].as_array().unwrap().iter().find(|s| s["name"] == structure["name"]).unwrap();
        assert_eq!((&same["volume_ml"], &same["mean"]), (&structure["volume_ml"], &structure["mean"]));
    }
    let liver = format!("labels {labels}:liver");
    let steps = [&scan, "--name", "liver", "--add", &liver, "--smooth-mm", "3", "--keep-largest", "-o", "liver.nrrd"];
    let smooth = selected(&place, &steps);
    let before = structures.iter().find(|s| s["name"] == "liver").unwrap()["volume_ml"].as_f64().unwrap();
    let after = smooth["selections"][0]["volume_ml"].as_f64().unwrap();
    assert!((after / before - 1.0).abs() < 0.03, "{before} ml became {after}");
    // Growing from a voxel of the liver takes tissue like it, and stops at what is unlike.
    let seed = "grow 90,170,130 tolerance=40";
    let grown = selected(&place, &[&scan, "--add", seed, "--intersect", &liver]);
    let share = grown["selections"][0]["volume_ml"].as_f64().unwrap() / before;
    assert!((0.5..1.0).contains(&share), "{share} of the liver is like its middle");
    let other = file("mr_abdomen_slab_labels.nii.gz");
    let output = place.run(&["select", &scan, "--labels", &other]);
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("lies elsewhere"));
}

fn json_file(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[test]
fn borders_are_a_setting_of_figures_with_regions() {
    let place = Place::new();
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../templates/head_brain.json");
    let small = std::fs::read_to_string(shipped).unwrap().replace("specimen:head@160", "specimen:head@24");
    std::fs::write(place.path("brain.json"), small).unwrap();
    let run = |arguments: &[&str]| {
        let output = place.run(&[arguments, &["--adapter", "software"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat()
    };
    let render = |borders: &str, out: &str| {
        run(&["render", "brain.json", "--size", "32x32", "--borders", borders, "--out", out, "--verbose"])
    };
    let words = render("two-look-ups", "two.png");
    assert!(words.contains("borders by two look-ups") && words.contains("regions labels"), "{words}");
    let words = render("exact", "exact.png");
    assert!(!words.contains("look-ups") && !words.contains("labels"), "{words}");
    assert_ne!(std::fs::read(place.path("two.png")).unwrap(), std::fs::read(place.path("exact.png")).unwrap());
    let bench = ["bench", "brain.json", "--size", "16x16", "--frames", "1", "--json", "b.json", "--borders"];
    assert!(run(&[&bench[..], &["two-look-ups"]].concat()).contains("borders by two look-ups"));
    assert_eq!(json_file(&place.path("b.json"))["quality"]["borders"], "two-look-ups");
    let table = run(&["measure", "brain.json", "--size", "8x8", "--frames", "1", "--json", "m.json"]);
    assert!(table.contains("standard two"), "{table}");
    let report = json_file(&place.path("m.json"));
    let two: Vec<_> =
        report["settings"].as_array().unwrap().iter().filter(|s| s["borders"] == "two-look-ups").collect();
    assert_eq!(two.iter().map(|s| s["quality"].as_str().unwrap()).collect::<Vec<_>>(), ["draft", "standard", "final"]);
    assert!(two.iter().all(|s| s["codes"]["rmse"].as_f64().unwrap() > 1.0), "{two:?}");
}

#[test]
fn measure_says_what_accuracy_costs() {
    let place = Place::new();
    let common = ["measure", "figure.json", "--size", "16x12", "--frames", "2", "--adapter", "software"];
    let run = |more: &[&str]| {
        let output = place.run(&[&common[..], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let table = run(&["--json", "m.json", "--plot", "m.svg"]);
    for word in ["ms/frame", "per ray", "p99.9", "draft", "standard", "final", "1/16384", "did not settle", "\n* "] {
        assert!(table.contains(word), "no {word} in\n{table}");
    }
    let report = json_file(&place.path("m.json"));
    assert_eq!((&report["size"], &report["dims"]), (&serde_json::json!([16, 12]), &serde_json::json!([8, 8, 8])));
    assert_eq!((report["frames"].as_u64(), report["reference"]["num_pixels"].as_u64()), (Some(2), Some(192)));
    assert_eq!(report["adapter"]["kind"], "software");
    let settings = report["settings"].as_array().unwrap();
    assert!(settings.len() >= 27);
    let names: Vec<&str> = settings.iter().filter_map(|s| s["quality"].as_str()).collect();
    assert_eq!(names, ["draft", "standard", "final"]);
    assert!(settings.iter().any(|s| s["pareto"] == true));
    for s in settings {
        assert!(s["ms"].as_f64().unwrap() > 0.0 && s["samples_per_ray"].as_f64().unwrap() > 0.0, "{s}");
        for measure in ["codes", "linear"] {
            let [rmse, p999, max] = ["rmse", "p999", "max"].map(|k| s[measure][k].as_f64().unwrap());
            assert!(rmse <= max && p999 <= max, "{s}");
        }
    }
    // Smaller steps, more samples.
    let samples = |i: usize| settings[i]["samples_per_ray"].as_f64().unwrap();
    assert!(samples(settings.len() - 1) > 8.0 * samples(0));
    let svg = std::fs::read_to_string(place.path("m.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("time per frame (ms)") && !svg.contains("NaN"));
    assert!(svg.contains(report["adapter"]["name"].as_str().unwrap()));
    // Others are compared with the reference: it is the picture, in linear light and without background.
    run(&["--plot", "m.png", "--reference", "r.npy"]);
    let bench =
        ["bench", "figure.json", "--size", "16x12", "--frames", "1", "--adapter", "software", "--step", "0.0625"];
    let output = place.run(&[&bench[..], &["--picture", "p.npy", "--json", "b.json"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains("a setting of its own"));
    let quality = &json_file(&place.path("b.json"))["quality"];
    assert_eq!([&quality["step_voxels"], &quality["style_change"]], [0.0625, 0.125]);
    let [reference, picture] = ["r.npy", "p.npy"].map(|name| {
        let bytes = std::fs::read(place.path(name)).unwrap();
        let numbers = &bytes[bytes.len() - 16 * 12 * 16..];
        let floats: Vec<f32> = numbers.chunks(4).map(|b| f32::from_ne_bytes(b.try_into().unwrap())).collect();
        floats
    });
    let num_unsettled = reference.iter().filter(|c| c.is_nan()).count() as u64 / 4;
    assert_eq!(Some(num_unsettled), report["reference"]["num_unsettled"].as_u64());
    assert!(reference.chunks(4).any(|p| p[3] == 0.0) && reference.chunks(4).any(|p| p[3] > 0.5));
    // The figure has no background, so both have none.
    let worst = picture.iter().zip(&reference).map(|(p, r)| (p - r).abs()).filter(|d| !d.is_nan()).fold(0.0, f32::max);
    assert!(worst < 2e-3, "{worst}");
    let (width, height, color_type, _) = png_facts(&place.path("m.png"));
    assert_eq!((width, height, color_type), (1800, 1200, 2));
}

#[test]
fn bench_times_a_turning_camera() {
    let place = Place::new();
    let common =
        ["bench", "figure.json", "--size", "16x16", "--frames", "3", "--adapter", "software", "--json", "b.json"];
    let run = |more: &[&str]| {
        let output = place.run(&[&common[..], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let words = String::from_utf8(output.stdout).unwrap();
        assert!(words.contains("first frame") && words.contains("median") && words.contains("per ray"), "{words}");
        json_file(&place.path("b.json"))
    };
    let report = run(&["--orbit", "-10"]);
    // Other programs are compared through these fields: none may go, none may change its name.
    let fields: Vec<&String> = report.as_object().unwrap().keys().collect();
    assert_eq!(
        fields,
        [
            "fabrica",
            "template",
            "title",
            "dims",
            "size",
            "frames",
            "orbit_deg",
            "quality",
            "adapter",
            "samples_per_ray",
            "first_ms",
            "median_ms",
            "min_ms",
            "max_ms",
            "frame_ms",
            "peak_memory_mb",
        ]
    );
    assert_eq!(report["quality"]["name"], "standard");
    assert_eq!((report["frames"].as_u64(), report["orbit_deg"].as_f64()), (Some(3), Some(-10.0)));
    let times: Vec<f64> = report["frame_ms"].as_array().unwrap().iter().map(|t| t.as_f64().unwrap()).collect();
    let [median, min, max] = ["median_ms", "min_ms", "max_ms"].map(|k| report[k].as_f64().unwrap());
    assert!(times.len() == 3 && times.contains(&median) && min <= median && median <= max, "{report}");
    assert!(report["first_ms"].as_f64().unwrap() > 0.0);
    let finer = run(&["--quality", "final"]);
    assert_eq!(finer["quality"]["name"], "final");
    let ratio = finer["samples_per_ray"].as_f64().unwrap() / report["samples_per_ray"].as_f64().unwrap();
    assert!((1.5..2.5).contains(&ratio), "{ratio}");
}

/// What identifies a patient and must not leave the header of a scan.
const PLANTED: [&str; 9] = [
    "PLANTEDNAME",
    "PLANTED-ID",
    "19770131",
    "PLANTED HOSPITAL",
    "PLANTEDDOCTOR",
    "PLANTEDACCESS",
    "1.2.3.777",
    "1.2.3.888",
    "PLANTED COMMENT",
];

/// One slice of a CT series, with all that a hospital writes into it.
fn slice_with_identifiers(series: &str, description: &str, number: usize) -> Vec<u8> {
    let mut bytes = vec![0; 128];
    bytes.extend(b"DICM");
    let mut put = |group: u16, element: u16, vr: &str, value: &[u8]| {
        let mut value = value.to_vec();
        if value.len() % 2 == 1 {
            value.push(if vr == "UI" || vr == "OW" { 0 } else { b' ' });
        }
        bytes.extend(group.to_le_bytes());
        bytes.extend(element.to_le_bytes());
        bytes.extend(vr.bytes());
        if vr == "OW" {
            bytes.extend([0, 0]);
            bytes.extend((value.len() as u32).to_le_bytes());
        } else {
            bytes.extend((value.len() as u16).to_le_bytes());
        }
        bytes.extend(value);
    };
    put(0x0002, 0x0010, "UI", b"1.2.840.10008.1.2.1");
    put(0x0008, 0x0016, "UI", b"1.2.840.10008.5.1.4.1.1.2");
    put(0x0008, 0x0018, "UI", format!("1.2.3.777.{series}.{number}").as_bytes());
    put(0x0008, 0x0020, "DA", b"19770131");
    put(0x0008, 0x0050, "SH", b"PLANTEDACCESS");
    put(0x0008, 0x0060, "CS", b"CT");
    put(0x0008, 0x0080, "LO", b"PLANTED HOSPITAL");
    put(0x0008, 0x0090, "PN", b"PLANTEDDOCTOR^A");
    put(0x0008, 0x103e, "LO", description.as_bytes());
    put(0x0010, 0x0010, "PN", b"PLANTEDNAME^ANNA");
    put(0x0010, 0x0020, "LO", b"PLANTED-ID");
    put(0x0010, 0x4000, "LT", b"PLANTED COMMENT");
    put(0x0020, 0x000d, "UI", b"1.2.3.777");
    put(0x0020, 0x000e, "UI", format!("1.2.3.888.{series}").as_bytes());
    put(0x0020, 0x0032, "DS", format!("0\\0\\{number}").as_bytes());
    put(0x0020, 0x0037, "DS", b"1\\0\\0\\0\\1\\0");
    put(0x0028, 0x0002, "US", &1u16.to_le_bytes());
    put(0x0028, 0x0004, "CS", b"MONOCHROME2");
    put(0x0028, 0x0010, "US", &8u16.to_le_bytes());
    put(0x0028, 0x0011, "US", &8u16.to_le_bytes());
    put(0x0028, 0x0030, "DS", b"1\\1");
    for (element, value) in [(0x0100, 16u16), (0x0101, 16), (0x0102, 15), (0x0103, 1)] {
        put(0x0028, element, "US", &value.to_le_bytes());
    }
    let pixels: Vec<u8> = (0..64i16)
        .flat_map(|i| {
            let inside = (1..7).contains(&(i % 8)) && (1..7).contains(&(i / 8)) && (1..7).contains(&number);
            (if inside { 300 + i } else { -1000 }).to_le_bytes()
        })
        .collect();
    put(0x7fe0, 0x0010, "OW", &pixels);
    bytes
}

#[test]
fn nothing_that_identifies_a_patient_leaves_the_header() {
    let place = Place::new();
    for (series, description) in [("1", "Head thin"), ("2", "Head thick")] {
        let folder = place.path(&format!("study/{series}"));
        std::fs::create_dir_all(&folder).unwrap();
        for number in 0..8 {
            let bytes = slice_with_identifiers(series, description, number);
            std::fs::write(folder.join(format!("{number}.dcm")), bytes).unwrap();
        }
    }
    // One slice stands for its series, and its name is nobody's business.
    let output = place.run(&["template", "study/1/3.dcm", "--out", "slice.json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(json_file(&place.path("slice.json"))["volumes"][0]["file"], "study/1");
    let mut said = Vec::new();
    for arguments in [
        vec!["inspect", "study"],
        vec!["inspect", "study", "--list", "--json"],
        vec!["inspect", "study", "--series", "thin"],
        vec!["inspect", "study", "--series", "thick", "--json"],
        vec!["template", "study", "--series", "thin", "--out", "look.json"],
        vec!["render", "look.json", "--out", "a.png", "--adapter", "software", "--dpi", "10", "--verbose"],
        vec!["template", "study", "--series", "head", "--out", "b.json"],
    ] {
        let output = place.run(&arguments);
        assert!(output.status.success() || arguments.contains(&"head"), "{}", String::from_utf8_lossy(&output.stderr));
        said.extend(output.stdout);
        said.extend(output.stderr);
    }
    let template = std::fs::read(place.path("look.json")).unwrap();
    assert!(String::from_utf8_lossy(&template).contains("Head thin"), "the description is what names the series");
    assert!(String::from_utf8_lossy(&said).contains("Head thick"));
    for bytes in [said, template, std::fs::read(place.path("a.png")).unwrap()] {
        let text = String::from_utf8_lossy(&bytes);
        for planted in PLANTED {
            assert!(!text.contains(planted), "{planted} got out");
        }
    }
    // The test can fail: the words are in the file.
    let slice = String::from_utf8_lossy(&slice_with_identifiers("1", "", 0)).into_owned();
    assert!(PLANTED.iter().all(|planted| slice.contains(planted)));
}
