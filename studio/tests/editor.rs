//! The window without a window: the whole editor under egui_kittest, found by its accessible names and driven by keys and
//! pointer as a user would; figures are drawn by the software adapter.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eframe::egui::{
    Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, Rect, TouchPhase, Vec2,
};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use fabrica_engine::gpu::AdapterChoice;
use fabrica_engine::image_out::{PngOptions, save_png};
use fabrica_engine::slice::anatomical::{Convention, Orientation};
use fabrica_studio::editor::slices::SliceViews;
use fabrica_studio::editor::{Editor, Options, UiCommand};
use fabrica_studio::figure::Template;
use fabrica_studio::figure::template::{AcrossTemplate, AxisName, MoveTemplate, RegionTemplate, Tint};
use glam::DVec3;

const FIGURE: &str = r##"{
  "fabrica": 1,
  "volumes": [{"name": "v", "file": "block.raw", "raw": "16x16x16xuint8"}],
  "objects": [{"volume": "v", "transfer_function": {"domain": "data", "nodes": [{"at": 50, "style": "clay", "opacity": 0.9}]}}],
  "camera": {"from": [0.0, 1.0, 0.0], "height": 2.5},
  "background": "#ffffff",
  "figure": {"width_mm": 20.0, "height_mm": 20.0, "dpi": 100.0},
  "kept": "what this version does not know"
}"##;

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("block.raw"), vec![100u8; 4096]).unwrap();
        std::fs::write(folder.path().join("figure.json"), FIGURE).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

/// Seconds from frame to frame: two clicks in successive ones are a double click.
const STEP: f32 = 1.0 / 60.0;

fn harness(file: Option<PathBuf>) -> Harness<'static, Option<Editor>> {
    let app = move |ui: &mut eframe::egui::Ui, state: &mut Option<Editor>| {
        let ctx = ui.ctx().clone();
        let editor = state.get_or_insert_with(|| {
            let files = file.iter().cloned().collect();
            Editor::new(&ctx, Options { files, ..Options::plain(AdapterChoice::Software) })
        });
        editor.ui(ui);
    };
    Harness::builder().with_size(Vec2::new(1000.0, 700.0)).with_step_dt(STEP).build_ui_state(app, None)
}

fn editor<'a>(harness: &'a Harness<'static, Option<Editor>>) -> &'a Editor {
    harness.state().as_ref().unwrap()
}

/// Runs frames until nothing is read or drawn any more.
fn settle(harness: &mut Harness<'static, Option<Editor>>) {
    let start = Instant::now();
    harness.step();
    while editor(harness).is_busy() {
        assert!(start.elapsed() < Duration::from_secs(120), "still busy: {:?}", editor(harness).banner());
        std::thread::sleep(Duration::from_millis(5));
        harness.step();
    }
    harness.step();
}

fn opened(place: &Place) -> Harness<'static, Option<Editor>> {
    let mut harness = harness(Some(place.path("figure.json")));
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    harness
}

fn figure(harness: &Harness<'static, Option<Editor>>) -> Template {
    Template::clone(editor(harness).document().unwrap().figure())
}

fn run(harness: &mut Harness<'static, Option<Editor>>, command: UiCommand) {
    let ctx = harness.ctx.clone();
    harness.state_mut().as_mut().unwrap().run(&ctx, command);
    harness.step();
}

/// A place in the figure's frame.
const MIDDLE: Pos2 = Pos2::new(350.0, 220.0);

fn drag(harness: &mut Harness<'static, Option<Editor>>, button: PointerButton, by: Vec2, release: bool) {
    drag_with(harness, button, Modifiers::NONE, by, release);
}

fn drag_with(
    harness: &mut Harness<'static, Option<Editor>>,
    button: PointerButton,
    modifiers: Modifiers,
    by: Vec2,
    release: bool,
) {
    drag_between(harness, button, modifiers, MIDDLE, MIDDLE + by, release);
}

fn drag_between(
    harness: &mut Harness<'static, Option<Editor>>,
    button: PointerButton,
    modifiers: Modifiers,
    from: Pos2,
    to: Pos2,
    release: bool,
) {
    let press = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers };
    harness.event(Event::ModifiersChanged(modifiers));
    harness.event(Event::PointerMoved(from));
    harness.step();
    harness.event(press(from, true));
    harness.step();
    for part in 1..=4 {
        harness.event(Event::PointerMoved(from + (to - from) * (part as f32 / 4.0)));
        harness.step();
    }
    if release {
        harness.event(press(to, false));
        harness.step();
        harness.step();
    }
    harness.event(Event::ModifiersChanged(Modifiers::NONE));
}

#[test]
fn a_drag_is_one_step_that_undo_takes_back() {
    let place = Place::new();
    let mut harness = opened(&place);
    let before = figure(&harness);
    drag(&mut harness, PointerButton::Primary, Vec2::new(60.0, 0.0), true);
    let turned = figure(&harness);
    assert!(turned.camera.from != before.camera.from && turned.camera.target == before.camera.target);
    assert_eq!(editor(&harness).document().unwrap().labels().collect::<Vec<_>>(), ["Move view"]);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    harness.step();
    assert_eq!(figure(&harness), before);
    harness.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    harness.step();
    assert_eq!(figure(&harness), turned);
    drag_with(&mut harness, PointerButton::Middle, Modifiers::SHIFT, Vec2::new(0.0, 40.0), true);
    assert!(figure(&harness).camera.target != before.camera.target, "Shift pans");
    settle(&mut harness);
}

#[test]
fn escape_gives_a_drag_up() {
    let place = Place::new();
    let mut harness = opened(&place);
    let before = figure(&harness);
    drag(&mut harness, PointerButton::Primary, Vec2::new(50.0, 20.0), false);
    assert!(figure(&harness) != before);
    harness.key_press(Key::Escape);
    harness.step();
    assert_eq!(figure(&harness).to_json().unwrap(), before.to_json().unwrap());
    assert!(editor(&harness).document().unwrap().undo_label().is_none());
}

#[test]
fn every_command_can_be_reached_and_says_why_when_it_cannot() {
    let place = Place::new();
    let mut empty = harness(None);
    empty.step();
    for command in UiCommand::ALL {
        assert_eq!(editor(&empty).disabled(*command).is_some(), command.needs_figure(), "{command:?}");
    }
    let mut harness = opened(&place);
    let first = figure(&harness);
    for command in UiCommand::ALL.iter().filter(|c| !matches!(c, UiCommand::Quit | UiCommand::New)) {
        // By its name, in the palette.
        run(&mut harness, UiCommand::Palette);
        harness.step();
        let entry = harness.query_all_by_label_contains(command.text()).next();
        assert!(entry.is_some(), "{command:?} is not in the palette");
        harness.key_press(Key::Escape);
        harness.step();
        harness.step();
        run(&mut harness, *command);
        // What it asks comes from a thread.
        if *command == UiCommand::ReadOtherwise {
            settle(&mut harness);
        }
        harness.key_press(Key::Escape);
        harness.step();
        harness.step();
    }
    assert_eq!(editor(&harness).banner(), None);
    // Undoing everything gives the first figure byte for byte.
    while editor(&harness).document().unwrap().undo_label().is_some() {
        run(&mut harness, UiCommand::Undo);
    }
    assert_eq!(figure(&harness).to_json().unwrap(), first.to_json().unwrap());
    assert!(harness.unnamed_widgets().is_empty(), "widgets without a name");
    settle(&mut harness);
}

#[test]
fn the_palette_runs_what_is_typed() {
    let place = Place::new();
    let mut harness = opened(&place);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::K);
    harness.step();
    harness.step();
    harness.event(Event::Text("left si".to_owned()));
    harness.step();
    harness.key_press(Key::Enter);
    harness.step();
    harness.step();
    assert_eq!(figure(&harness).camera.from, [-1.0, 0.0, 0.0]);
    // The dialog is gone: keys are commands again.
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    harness.step();
    assert_eq!(figure(&harness).camera.from, [0.0, 1.0, 0.0]);
}

#[test]
fn what_is_saved_is_what_was_seen() {
    let place = Place::new();
    let mut harness = opened(&place);
    run(&mut harness, UiCommand::FromLeft);
    run(&mut harness, UiCommand::Projection);
    assert!(editor(&harness).document().unwrap().is_changed());
    run(&mut harness, UiCommand::Save);
    assert_eq!(editor(&harness).banner(), None);
    assert!(!editor(&harness).document().unwrap().is_changed());
    let saved = Template::read(&place.path("figure.json")).unwrap();
    assert_eq!(saved, figure(&harness));
    assert_eq!(saved.camera.from, [-1.0, 0.0, 0.0]);
    assert_eq!(saved.extra["kept"], "what this version does not know");
}

#[test]
fn a_figure_saved_elsewhere_still_finds_its_volume() {
    let place = Place::new();
    std::fs::create_dir(place.path("deeper")).unwrap();
    let target = place.path("deeper").join("copy.json");
    let mut harness = opened(&place);
    run(&mut harness, UiCommand::SaveAs);
    harness.step();
    enter(&mut harness, &target.display().to_string());
    assert_eq!(editor(&harness).banner(), None);
    let mut copy = self::harness(Some(target));
    settle(&mut copy);
    assert_eq!(editor(&copy).banner(), None);
    assert!(figure(&copy).volumes[0].file.ends_with("block.raw"));
}

#[test]
fn faults_are_said_and_lose_nothing() {
    let place = Place::new();
    std::fs::write(place.path("damaged.json"), "{\"fabrica\": 1, ").unwrap();
    let mut damaged = harness(Some(place.path("damaged.json")));
    settle(&mut damaged);
    assert!(editor(&damaged).banner().unwrap().contains("not JSON") && editor(&damaged).document().is_none());
    // Without its volume a figure opens all the same.
    std::fs::remove_file(place.path("block.raw")).unwrap();
    let mut harness = harness(Some(place.path("figure.json")));
    let start = Instant::now();
    while editor_or(&harness).is_none_or(|e| e.document().is_none()) {
        assert!(start.elapsed() < Duration::from_secs(60));
        harness.step();
    }
    settle(&mut harness);
    assert!(harness.query_all_by_label_contains("block.raw").count() > 0, "nothing says what is missing");
    assert_eq!(figure(&harness), Template::parse(FIGURE).unwrap());
    // Nowhere to write: the figure stays changed.
    run(&mut harness, UiCommand::FromAbove);
    make_unwritable(&place.path("figure.json"));
    run(&mut harness, UiCommand::Save);
    let said = editor(&harness).banner().unwrap().to_owned();
    assert!(said.contains("was not saved") && said.ends_with("Nothing was lost"), "{said}");
    assert!(editor(&harness).document().unwrap().is_changed());
}

fn editor_or<'a>(harness: &'a Harness<'static, Option<Editor>>) -> Option<&'a Editor> {
    harness.state().as_ref()
}

/// A folder in the file's place: nobody, root either, can write it.
fn make_unwritable(path: &Path) {
    std::fs::remove_file(path).unwrap();
    std::fs::create_dir(path).unwrap();
}

/// A ball of 200 in a shell of 60 in nothing, dressed in two styles.
const BALL: &str = r##"{
  "fabrica": 1,
  "volumes": [{"name": "ball", "file": "ball.raw", "raw": "16x16x16xuint8"}],
  "objects": [{"volume": "ball", "transfer_function": {"domain": "data", "nodes": [
    {"at": 20, "style": "clay", "opacity": 0.0}, {"at": 120, "style": "clay", "opacity": 0.1},
    {"at": 130, "style": "bone", "opacity": 0.9}, {"at": 180, "style": "bone", "opacity": 1.0}]}}],
  "camera": {"from": [0.0, 1.0, 0.0], "height": 2.0},
  "quality": "draft",
  "background": "#ffffff",
  "figure": {"width_mm": 20.0, "height_mm": 20.0, "dpi": 100.0}
}"##;

impl Place {
    fn with_ball() -> Self {
        let place = Self::new();
        let voxel = |i: usize| {
            let at = [i % 16, i / 16 % 16, i / 256].map(|n| n as f32 - 7.5);
            match at.iter().map(|x| x * x).sum::<f32>().sqrt() {
                r if r < 5.0 => 200u8,
                r if r < 7.0 => 60,
                _ => 0,
            }
        };
        std::fs::write(place.path("ball.raw"), (0..4096).map(voxel).collect::<Vec<u8>>()).unwrap();
        std::fs::write(place.path("figure.json"), BALL).unwrap();
        place
    }
}

type Window = Harness<'static, Option<Editor>>;

fn nodes(harness: &Window) -> Vec<(f64, String, f64)> {
    let figure = figure(harness);
    figure.objects[0].transfer_function.nodes.iter().map(|n| (n.at, n.style.clone(), n.opacity)).collect()
}

fn labels(harness: &Window) -> Vec<String> {
    editor(harness).document().unwrap().labels().map(str::to_owned).collect()
}

/// The middle of what is called so; of a field rather than of the label before it.
fn middle(harness: &Window, label: &str) -> Pos2 {
    let found = harness.query_all_by_label(label).last();
    found.unwrap_or_else(|| panic!("nothing is called {label}")).rect().center()
}

fn click(harness: &mut Window, at: Pos2) {
    let press =
        |pressed| Event::PointerButton { pos: at, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE };
    harness.event(Event::PointerMoved(at));
    harness.step();
    harness.event(press(true));
    harness.step();
    harness.event(press(false));
    harness.step();
    harness.step();
}

fn click_on(harness: &mut Window, label: &str) {
    let at = middle(harness, label);
    click(harness, at);
}

fn drag_from(harness: &mut Window, from: Pos2, to: Pos2) {
    drag_between(harness, PointerButton::Primary, Modifiers::NONE, from, to, true);
}

/// Types in place of what stands in the field that has the focus.
fn retype(harness: &mut Window, text: &str) {
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.event(Event::Text(text.to_owned()));
    harness.step();
}

/// The same, and Enter.
fn enter(harness: &mut Window, text: &str) {
    retype(harness, text);
    harness.key_press(Key::Enter);
    harness.step();
    harness.step();
}

fn undo_all(harness: &mut Window) {
    while editor(harness).document().unwrap().undo_label().is_some() {
        run(harness, UiCommand::Undo);
    }
}

#[test]
fn a_theme_is_chosen_in_one_step_and_taken_back() {
    let place = Place::with_ball();
    let mut harness = harness(Some(place.path("figure.json")));
    settle(&mut harness);
    let picture = |harness: &Window| editor(harness).picture_pixels().unwrap().0.to_vec();
    let (own, pixels) = (figure(&harness), picture(&harness));
    let choose = |harness: &mut Window, theme: &str| {
        harness.query_all_by_label("Theme").last().unwrap().scroll_to_me();
        // The panel glides there.
        harness.run_steps(40);
        click_on(harness, "Theme");
        click_on(harness, theme);
        settle(harness);
    };
    choose(&mut harness, "Chalk on black");
    assert_eq!(figure(&harness), Template { theme: Some("chalk_on_black".to_owned()), ..own.clone() });
    assert_eq!(labels(&harness), ["Use theme Chalk on black"]);
    let themed = picture(&harness);
    assert_eq!(themed[..4], [0x12, 0x15, 0x18, 255]);
    assert!(harness.query_by_label("#121518 (theme)").is_some());
    // The same again is no step.
    choose(&mut harness, "Chalk on black");
    assert_eq!(labels(&harness).len(), 1);
    choose(&mut harness, "None");
    assert_eq!(figure(&harness), own);
    assert!(picture(&harness) == pixels);
    run(&mut harness, UiCommand::Undo);
    settle(&mut harness);
    assert!(picture(&harness) == themed);
    undo_all(&mut harness);
    settle(&mut harness);
    assert!(figure(&harness) == own && picture(&harness) == pixels);
}

#[test]
fn nodes_are_dragged_inserted_copied_and_removed() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    let first = figure(&harness);
    let start = middle(&harness, "Node 3 at 130");
    drag_from(&mut harness, start, start + Vec2::new(30.0, 20.0));
    let moved = nodes(&harness)[2].clone();
    assert!(moved.0 > 140.0 && moved.0 < 180.0 && moved.2 < 0.8, "{moved:?}");
    assert_eq!(labels(&harness).len(), 1, "one drag is one step");
    // It never passes its neighbors.
    let start = middle(&harness, &format!("Node 3 at {}", moved.0));
    drag_from(&mut harness, start, start + Vec2::new(500.0, 0.0));
    assert_eq!(nodes(&harness)[2].0, 180.0);
    run(&mut harness, UiCommand::Undo);
    // Shift makes it fine.
    let start = middle(&harness, &format!("Node 3 at {}", moved.0));
    drag_between(&mut harness, PointerButton::Primary, Modifiers::SHIFT, start, start + Vec2::new(30.0, 0.0), true);
    let fine = nodes(&harness)[2].0 - moved.0;
    assert!(fine > 0.5 && fine < 0.3 * (moved.0 - 130.0), "{fine}");
    // Alt leaves a copy behind.
    let start = middle(&harness, &format!("Node 3 at {}", nodes(&harness)[2].0));
    let before = nodes(&harness);
    drag_between(&mut harness, PointerButton::Primary, Modifiers::ALT, start, start - Vec2::new(15.0, 0.0), true);
    let after = nodes(&harness);
    assert!(after.len() == 5 && after[3] == before[2] && after[2].0 < before[2].0, "{after:?}");
    // The chosen one goes with the key.
    harness.key_press(Key::Delete);
    harness.step();
    assert_eq!(nodes(&harness), before);
    // A double click puts one where it is.
    let canvas = harness.get_by_label("Plot of the transfer function").rect();
    let at = Pos2::new(middle(&harness, "Node 2 at 120").x - 40.0, canvas.center().y);
    harness.event(Event::PointerMoved(at));
    harness.step();
    click(&mut harness, at);
    click(&mut harness, at);
    let after = nodes(&harness);
    assert!(after.len() == 5 && after[1].0 > 20.0 && after[1].0 < 120.0 && after[1].1 == "clay", "{after:?}");
    assert!(after[1].2 > 0.2 && after[1].2 < 0.8, "its opacity is the pointer's: {after:?}");
    // Escape gives a drag up.
    let (start, before) = (middle(&harness, "Node 1 at 20"), nodes(&harness));
    drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, start, start - Vec2::new(30.0, 30.0), false);
    assert!(nodes(&harness) != before);
    harness.key_press(Key::Escape);
    harness.step();
    assert_eq!(nodes(&harness), before);
    undo_all(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), first.to_json().unwrap());
}

#[test]
fn numbers_are_typed_with_their_units() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    click_on(&mut harness, "Node 2 at 120");
    for (label, typed) in [("Node value", "2*55 HU"), ("Node opacity", "25 %")] {
        click_on(&mut harness, label);
        enter(&mut harness, typed);
    }
    assert_eq!(nodes(&harness)[1], (110.0, "clay".to_owned(), 0.25));
    click_on(&mut harness, "Smooth shading");
    enter(&mut harness, "2,5 mm");
    assert_eq!(figure(&harness).objects[0].gradient_scale_mm, Some(2.5));
    assert_eq!(labels(&harness).len(), 3);
}

#[test]
fn a_ball_in_a_picture_becomes_a_style() {
    let place = Place::with_ball();
    let green = vec![[0.0, 0.5, 0.1, 1.0]; 90 * 90];
    save_png(&place.path("moss.png"), 90, 90, &green, &PngOptions::default()).unwrap();
    let (files, styles) = (vec![place.path("figure.json")], place.path("styles"));
    let app = move |ui: &mut eframe::egui::Ui, state: &mut Option<Editor>| {
        let ctx = ui.ctx().clone();
        let editor = state.get_or_insert_with(|| {
            let (files, styles_folder) = (files.clone(), Some(styles.clone()));
            Editor::new(&ctx, Options { files, styles_folder, ..Options::plain(AdapterChoice::Software) })
        });
        editor.ui(ui);
    };
    let mut harness =
        Harness::builder().with_size(Vec2::new(1000.0, 700.0)).with_step_dt(STEP).build_ui_state(app, None);
    settle(&mut harness);
    let picture = place.path("moss.png").display().to_string();
    let open = |harness: &mut Window, path: &str| {
        run(harness, UiCommand::StyleFromPicture);
        harness.step();
        enter(harness, path);
        settle(harness);
    };
    open(&mut harness, &place.path("figure.json").display().to_string());
    assert!(editor(&harness).banner().unwrap().starts_with("This is neither a PNG nor a JPEG"));
    open(&mut harness, &picture);
    // A circle of 31 pixels is blurred; drawn by hand it is larger.
    assert!(harness.query_by_label_contains("Blurred").is_some());
    let canvas = harness.get_by_label("Circle around a ball").rect();
    let rim = canvas.center() + Vec2::new(0.0, canvas.height() * 31.5 / 90.0);
    drag_from(&mut harness, rim, rim + Vec2::new(0.0, canvas.height() * 10.0 / 90.0));
    assert!(harness.query_by_label_contains("Blurred").is_none());
    click_on(&mut harness, "Name");
    retype(&mut harness, "bone");
    harness.step();
    assert!(harness.query_by_label_contains("There is a style \"bone\"").is_some());
    retype(&mut harness, "Wet moss");
    let start = Instant::now();
    while !place.path("styles/Wet moss.png").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "the style is not made");
        std::thread::sleep(Duration::from_millis(5));
        harness.step();
        if harness.query_by_label("Save style").is_some() {
            click_on(&mut harness, "Save style");
        }
    }
    harness.step();
    // It dresses at once, and undo takes it off.
    click_on(&mut harness, "Node 4 at 180");
    harness.step();
    harness.step();
    click_on(&mut harness, "Style Wet moss");
    assert_eq!(nodes(&harness)[3].1, "Wet moss");
    settle(&mut harness);
    let middle = |harness: &Window| {
        let (pixels, [width, height]) = editor(harness).picture_pixels().unwrap();
        let at = 4 * (height / 2 * width + width / 2);
        [pixels[at], pixels[at + 1], pixels[at + 2]]
    };
    let [red, green, blue] = middle(&harness);
    assert!(green > 2 * red && green > blue, "{red} {green} {blue}");
    run(&mut harness, UiCommand::Undo);
    assert_eq!(nodes(&harness)[3].1, "bone");
}

#[test]
fn styles_fall_on_materials_between_nodes_and_on_the_picture() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    let brass = |harness: &Window| harness.query_all_by_label("Style Brass").next().unwrap().rect().center();
    // The gallery shows what is searched.
    click_on(&mut harness, "Find a style");
    harness.event(Event::Text("brass".to_owned()));
    harness.step();
    harness.step();
    let from = brass(&harness);
    let bone = middle(&harness, "Material 2: Bone");
    drag_from(&mut harness, from, bone);
    let styles = |harness: &Window| nodes(harness).into_iter().map(|n| n.1).collect::<Vec<_>>();
    assert_eq!(styles(&harness), ["clay", "clay", "brass", "brass"]);
    assert_eq!(labels(&harness), ["Dress in brass"]);
    run(&mut harness, UiCommand::Undo);
    // On a node it is for this node only.
    let (from, node) = (brass(&harness), middle(&harness, "Node 4 at 180"));
    drag_from(&mut harness, from, node);
    assert_eq!(styles(&harness), ["clay", "clay", "bone", "brass"]);
    run(&mut harness, UiCommand::Undo);
    // Between nodes it becomes one, on the curve.
    let canvas = harness.get_by_label("Plot of the transfer function").rect();
    let between =
        Pos2::new(0.5 * (middle(&harness, "Node 1 at 20").x + middle(&harness, "Node 2 at 120").x), canvas.center().y);
    let from = brass(&harness);
    drag_from(&mut harness, from, between);
    let after = nodes(&harness);
    assert!(after.len() == 5 && after[1].1 == "brass" && (after[1].2 - 0.05).abs() < 0.02, "{after:?}");
    run(&mut harness, UiCommand::Undo);
    // On the picture it dresses what is seen there: the ball, through the faint shell.
    let from = brass(&harness);
    drag_from(&mut harness, from, MIDDLE);
    assert_eq!(styles(&harness), ["clay", "clay", "brass", "brass"]);
    // A miss changes nothing.
    let from = brass(&harness);
    let corner = harness.query_all_by_label_contains("Figure: ").next().unwrap().rect().left_top() + Vec2::splat(5.0);
    drag_from(&mut harness, from, corner);
    assert_eq!(labels(&harness), ["Dress in brass"]);
    // A click dresses the chosen material.
    click_on(&mut harness, "Node 1 at 20");
    let at = brass(&harness);
    click(&mut harness, at);
    assert_eq!(styles(&harness), ["brass", "brass", "brass", "brass"]);
}

#[test]
fn a_click_tells_what_is_there_and_makes_a_node_of_it() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    click(&mut harness, MIDDLE);
    assert!(harness.query_by_label_contains("gradient").is_some(), "no answer");
    assert!(
        harness.query_by_label("Style Bone, node 4 of 4").is_some()
            || harness.query_by_label("Style Bone, node 3 of 4").is_some()
    );
    assert!(harness.unnamed_widgets().is_empty());
    assert!(editor(&harness).document().unwrap().undo_label().is_none(), "asking is no edit");
    let before = figure(&harness);
    click_on(&mut harness, "New node here");
    assert_eq!(nodes(&harness).len(), 5);
    assert!(harness.query_by_label_contains("gradient").is_none(), "the answer stays open");
    run(&mut harness, UiCommand::Undo);
    assert_eq!(figure(&harness), before);
    // Escape closes the answer and changes nothing.
    click(&mut harness, MIDDLE);
    assert!(harness.query_by_label_contains("gradient").is_some());
    harness.key_press(Key::Escape);
    harness.step();
    harness.step();
    assert!(harness.query_by_label_contains("gradient").is_none());
}

#[test]
fn a_click_on_a_label_map_names_the_structure() {
    let place = Place::with_ball();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: raw\nSegment0_Name:=shell\n\
                  Segment0_LabelValue:=60\nSegment1_Name:=core\nSegment1_LabelValue:=200\n\n";
    let path = place.path("ball.seg.nrrd");
    std::fs::write(&path, [header.as_bytes(), &std::fs::read(place.path("ball.raw")).unwrap()].concat()).unwrap();
    let mut harness = harness(Some(path));
    settle(&mut harness);
    assert!(figure(&harness).volumes[0].labels && editor(&harness).banner().is_none());
    assert!(
        !editor(&harness).notice().contains("Taken for"),
        "the file says what it is: {}",
        editor(&harness).notice()
    );
    let canvas = harness.get_by_label_contains("Figure: ").rect().center();
    click(&mut harness, canvas);
    // In the answer, and in the status bar under the pointer.
    assert_eq!(harness.query_all_by_label("shell (structure 60)").count(), 2);
    assert!(harness.query_by_label_contains("gradient").is_none());
    // A part of it knows its structures as well: here the ball is cut through its middle.
    run(&mut harness, UiCommand::ReadOtherwise);
    settle(&mut harness);
    click_on(&mut harness, "Part and resolution");
    (0..30).for_each(|_| harness.step());
    click_on(&mut harness, "End along y");
    enter(&mut harness, "8");
    click_on(&mut harness, "Open");
    settle(&mut harness);
    assert_eq!(figure(&harness).volumes[0].crop, Some([[0, 16], [0, 8], [0, 16]]));
    run(&mut harness, UiCommand::FromFront);
    settle(&mut harness);
    click(&mut harness, canvas);
    assert_eq!(harness.query_all_by_label("core (structure 200)").count(), 2);
}

#[test]
fn what_is_taken_for_a_mask_can_be_read_as_a_scan() {
    let place = Place::with_ball();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: raw\n\n";
    let ball = std::fs::read(place.path("ball.raw")).unwrap();
    let voxels: Vec<u8> = ball.iter().map(|v| u8::from(*v > 0)).collect();
    let path = place.path("mask.nrrd");
    std::fs::write(&path, [header.as_bytes(), &voxels].concat()).unwrap();
    let mut harness = harness(Some(path));
    settle(&mut harness);
    let notice = editor(&harness).notice().to_owned();
    assert!(
        notice.starts_with("Taken for a mask, as its only values are 0 and 1. If it is a scan: File, "),
        "{notice}"
    );
    assert!(notice.contains(UiCommand::ReadOtherwise.text()) && !notice.contains("--"), "{notice}");
    let taken = figure(&harness);
    assert!(taken.volumes[0].labels);
    run(&mut harness, UiCommand::ReadOtherwise);
    settle(&mut harness);
    click_on(&mut harness, "Values of a scan");
    assert!(harness.unnamed_widgets().is_empty());
    click_on(&mut harness, "Open");
    settle(&mut harness);
    let read = figure(&harness);
    assert!(!read.volumes[0].labels && editor(&harness).banner().is_none());
    // Its values have another look than its colors, and both came in one step.
    assert_ne!(read.objects[0].transfer_function, taken.objects[0].transfer_function);
    assert_eq!(read.objects[0].transfer_function.nodes[0].at, 0.5);
    assert_eq!(labels(&harness), ["Read mask.nrrd, as values of a scan"]);
    run(&mut harness, UiCommand::Undo);
    settle(&mut harness);
    assert_eq!(figure(&harness), taken);
}

#[test]
fn objects_are_named_and_hidden_and_history_goes_anywhere() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    harness.key_press(Key::F2);
    harness.step();
    harness.step();
    enter(&mut harness, "Skull");
    assert_eq!(figure(&harness).objects[0].name, "Skull");
    harness.key_press(Key::H);
    harness.step();
    assert!(!figure(&harness).objects[0].visible);
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None, "an empty figure is a figure");
    run(&mut harness, UiCommand::FromLeft);
    run(&mut harness, UiCommand::History);
    harness.step();
    assert!(harness.unnamed_widgets().is_empty());
    click_on(&mut harness, "Rename to Skull");
    assert!(figure(&harness).objects[0].visible && figure(&harness).camera.from == [0.0, 1.0, 0.0]);
    click_on(&mut harness, "Move view");
    assert!(!figure(&harness).objects[0].visible && figure(&harness).camera.from == [-1.0, 0.0, 0.0]);
    click_on(&mut harness, "As it was opened");
    assert_eq!(figure(&harness), Template::parse(BALL).unwrap());
    // Letters belong to a field that has the focus.
    click_on(&mut harness, "Find a style");
    harness.key_press(Key::H);
    harness.step();
    assert!(figure(&harness).objects[0].visible);
    settle(&mut harness);
}

#[test]
fn a_missing_volume_is_found_again() {
    let place = Place::with_ball();
    std::fs::create_dir_all(place.path("deep/er")).unwrap();
    std::fs::rename(place.path("ball.raw"), place.path("deep/er/ball.raw")).unwrap();
    let mut harness = harness(Some(place.path("figure.json")));
    settle(&mut harness);
    assert!(harness.query_all_by_label_contains("ball.raw").count() > 0);
    assert!(harness.unnamed_widgets().is_empty());
    // What does not need the volume works without it.
    run(&mut harness, UiCommand::FromLeft);
    click_on(&mut harness, "Node 2 at 120");
    harness.key_press(Key::Delete);
    harness.step();
    assert_eq!(nodes(&harness).len(), 3);
    click_on(&mut harness, "Search the figure's folder");
    settle(&mut harness);
    // A raw file says nothing of itself: its layout stays the slot's.
    assert_eq!(editor(&harness).banner(), None);
    assert!(figure(&harness).volumes[0].file.ends_with("deep/er/ball.raw"), "{}", figure(&harness).volumes[0].file);
    assert!(harness.query_by_label("Search the figure's folder").is_none());
    // Undo brings the missing file back, redo the found one.
    run(&mut harness, UiCommand::Undo);
    settle(&mut harness);
    harness.step();
    assert!(harness.query_by_label("Search the figure's folder").is_some());
    run(&mut harness, UiCommand::Redo);
    settle(&mut harness);
    assert!(harness.query_by_label("Search the figure's folder").is_none());
}

/// A NRRD file of bytes whose frames hold 10, 20, ... in a ball.
fn frames(place: &Place, name: &str, num_frames: usize) -> PathBuf {
    let header = format!("NRRD0004\ntype: uint8\ndimension: 4\nsizes: 16 16 16 {num_frames}\nencoding: raw\n\n");
    let ball = std::fs::read(place.path("ball.raw")).unwrap();
    let voxels = (1..=num_frames).flat_map(|f| ball.iter().map(move |v| v / 10 * f as u8).collect::<Vec<u8>>());
    let path = place.path(name);
    std::fs::write(&path, header.bytes().chain(voxels).collect::<Vec<u8>>()).unwrap();
    path
}

#[test]
fn plain_voxels_ask_for_their_layout_which_the_name_may_tell() {
    let place = Place::with_ball();
    let path = place.path("ball_16x16x16_uint8.raw");
    std::fs::rename(place.path("ball.raw"), &path).unwrap();
    let mut harness = harness(Some(path));
    settle(&mut harness);
    assert!(harness.query_by_label("How do the voxels lie?").is_some());
    assert!(harness.unnamed_widgets().is_empty());
    // What cannot be is said at once, and nothing can be opened. The field is where typing goes.
    retype(&mut harness, "16x16xuint8");
    assert!(harness.query_by_label_contains("has no three sizes").is_some());
    retype(&mut harness, "16x16x40xuint8");
    assert!(harness.query_by_label_contains("the layout needs 10240 bytes, but the file has 4096").is_some());
    harness.key_press(Key::Enter);
    harness.step();
    assert!(harness.query_by_label("How do the voxels lie?").is_some());
    retype(&mut harness, "16x16x16xuint8,2");
    harness.key_press(Key::Enter);
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    assert_eq!(figure(&harness).volumes[0].raw.as_deref(), Some("16x16x16xuint8,2x2x2,little"));
}

#[test]
fn a_layout_that_cannot_be_read_can_be_mended() {
    let place = Place::with_ball();
    // How long a compressed file is shows only when it is read.
    let path = place.path("ball.raw.gz");
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    std::io::Write::write_all(&mut encoder, &std::fs::read(place.path("ball.raw")).unwrap()).unwrap();
    std::fs::write(&path, encoder.finish().unwrap()).unwrap();
    let mut harness = harness(Some(path));
    settle(&mut harness);
    retype(&mut harness, "16x16x17xuint8");
    harness.key_press(Key::Enter);
    settle(&mut harness);
    assert!(harness.query_by_label("How do the voxels lie?").is_some() && editor(&harness).banner().is_none());
    let said = harness.query_all_by_label_contains("ball.raw.gz)").count();
    assert_eq!(said, 1, "the reason is not there");
    assert!(harness.query_by_label_contains("--").is_none());
    // What was typed is still there, and the field is where typing goes on.
    harness.key_press(Key::End);
    (0.."7xuint8".len()).for_each(|_| harness.key_press(Key::Backspace));
    harness.event(Event::Text("6xuint8".to_owned()));
    harness.step();
    harness.key_press(Key::Enter);
    settle(&mut harness);
    assert_eq!(figure(&harness).volumes[0].raw.as_deref(), Some("16x16x16xuint8,1x1x1,little"));
    assert!(harness.query_by_label("How do the voxels lie?").is_none());
}

#[test]
fn frames_are_chosen_and_undone() {
    let place = Place::with_ball();
    let mut harness = harness(Some(frames(&place, "beating.nrrd", 5)));
    settle(&mut harness);
    assert_eq!(figure(&harness).volumes[0].frame, 0);
    // The panel is longer than the window.
    harness.query_all_by_label("Frame").last().unwrap().scroll_to_me();
    (0..8).for_each(|_| harness.step());
    click_on(&mut harness, "Frame");
    enter(&mut harness, "4");
    settle(&mut harness);
    assert_eq!(figure(&harness).volumes[0].frame, 3);
    assert_eq!(labels(&harness), ["Read beating.nrrd, frame 4"]);
    run(&mut harness, UiCommand::Undo);
    settle(&mut harness);
    assert_eq!(figure(&harness).volumes[0].frame, 0);
    assert_eq!(editor(&harness).banner(), None);
}

#[test]
fn letters_that_no_file_states_are_marked() {
    let place = Place::with_ball();
    let placed = |name: &str, fields: &str| {
        let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: raw\n{fields}\n");
        let path = place.path(name);
        std::fs::write(&path, [header.into_bytes(), std::fs::read(place.path("ball.raw")).unwrap()].concat()).unwrap();
        path
    };
    let letters =
        |harness: &Window, right: &str| harness.query_all_by_label_contains(&format!(", {right} on the left")).count();
    let axes = "space directions: (1,0,0) (0,1,0) (0,0,1)\n";
    let mut known = harness(Some(placed("known.nrrd", &format!("space: RAS\n{axes}"))));
    settle(&mut known);
    run(&mut known, UiCommand::FromFront);
    assert_eq!((letters(&known, "R"), letters(&known, "R?")), (1, 0));
    // Undo of another volume brings its letters back.
    let mut assumed = harness(Some(placed("assumed.nrrd", axes)));
    settle(&mut assumed);
    run(&mut assumed, UiCommand::FromFront);
    assert_eq!((letters(&assumed, "R"), letters(&assumed, "R?")), (0, 1));
    drop_files(&mut assumed, &[place.path("known.nrrd")]);
    click_on(&mut assumed, "Use in this figure");
    settle(&mut assumed);
    assert_eq!((letters(&assumed, "R"), letters(&assumed, "R?")), (1, 0));
    run(&mut assumed, UiCommand::Undo);
    settle(&mut assumed);
    assert_eq!(letters(&assumed, "R?"), 1);
    // What is asked about its part says it as well.
    run(&mut assumed, UiCommand::ReadOtherwise);
    settle(&mut assumed);
    click_on(&mut assumed, "Part and resolution");
    (0..30).for_each(|_| assumed.step());
    assert!(assumed.query_by_label("Along x, to the right (?)").is_some());
    assert!(assumed.query_by_label_contains("The letters are assumed. The header does not name its space").is_some());
}

#[test]
fn a_part_of_a_volume_is_loaded_and_the_figure_says_so() {
    let place = Place::with_ball();
    let mut harness = harness(Some(frames(&place, "beating.nrrd", 1)));
    settle(&mut harness);
    run(&mut harness, UiCommand::ReadOtherwise);
    settle(&mut harness);
    assert!(harness.query_by_label("What is loaded").is_some());
    click_on(&mut harness, "Part and resolution");
    // It unfolds.
    (0..30).for_each(|_| harness.step());
    for (label, typed) in [("End along x", "8"), ("Reduction along z", "2")] {
        click_on(&mut harness, label);
        enter(&mut harness, typed);
    }
    assert!(harness.query_by_label_contains("8 x 16 x 8 voxels of 1 x 1 x 2 mm").is_some());
    click_on(&mut harness, "Open");
    settle(&mut harness);
    let slot = figure(&harness).volumes[0].clone();
    assert_eq!((slot.crop, slot.reduce), (Some([[0, 8], [0, 16], [0, 16]]), Some([1, 1, 2])));
    assert_eq!(labels(&harness), ["Read beating.nrrd, cropped, reduced 1 x 1 x 2"]);
    assert!(harness.query_all_by_label_contains("8 x 16 x 8 were loaded").count() > 0, "the window does not say it");
    run(&mut harness, UiCommand::Undo);
    assert_eq!(figure(&harness).volumes[0].crop, None);
}

#[test]
fn a_part_that_a_template_names_and_no_file_has_can_be_mended() {
    let place = Place::with_ball();
    let figure_with =
        BALL.replace("\"file\": \"ball.raw\"", "\"file\": \"ball.raw\", \"crop\": [[0, 0], [9, 99], [5, 2]]");
    assert_ne!(figure_with, BALL);
    std::fs::write(place.path("figure.json"), figure_with).unwrap();
    let mut harness = harness(Some(place.path("figure.json")));
    settle(&mut harness);
    assert!(harness.query_all_by_label_contains("is no part of the volume's 0..16").count() > 0);
    run(&mut harness, UiCommand::ReadOtherwise);
    settle(&mut harness);
    (0..30).for_each(|_| harness.step());
    assert!(harness.query_by_label_contains("16 x 16 x 16 voxels of").is_some(), "the whole is proposed");
    click_on(&mut harness, "Open");
    settle(&mut harness);
    assert_eq!((editor(&harness).banner(), figure(&harness).volumes[0].crop), (None, None));
}

#[test]
fn what_is_larger_than_the_memory_is_offered_in_part() {
    let place = Place::new();
    let path = place.path("huge.nrrd");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16384 16384 4096\nencoding: raw\n\n";
    std::fs::write(&path, header).unwrap();
    // The disk keeps none of these zeros.
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len((1 << 40) + header.len() as u64).unwrap();
    let mut harness = harness(Some(path));
    settle(&mut harness);
    assert!(harness.query_by_label("Load less of it?").is_some());
    // What is proposed fits.
    assert!(harness.query_by_label("Open all the same").is_none() && harness.query_by_label("Open").is_some());
    click_on(&mut harness, "All of it");
    assert!(harness.query_by_label("Open all the same").is_some());
    click_on(&mut harness, "Reduce until it fits");
    assert!(harness.query_by_label("Open all the same").is_none());
    click_on(&mut harness, "Cancel");
    assert!(harness.query_by_label("Load less of it?").is_none() && editor(&harness).document().is_none());
}

#[test]
fn a_picture_can_be_stopped_and_gone_on_with() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    run(&mut harness, UiCommand::QualityFinal);
    // The picture may be faster than the hand: until one was caught.
    let start = Instant::now();
    while harness.query_by_label("Stopped: go on").is_none() {
        assert!(start.elapsed() < Duration::from_secs(60), "there was never anything to stop");
        run(&mut harness, UiCommand::RollLeft);
        while editor(&harness).is_busy() && harness.query_by_label("Stop").is_none() {
            harness.step();
        }
        editor(&harness).painter().stop();
        settle(&mut harness);
    }
    assert_eq!(editor(&harness).banner(), None);
    click_on(&mut harness, "Stopped: go on");
    settle(&mut harness);
    assert!(harness.query_by_label_contains("Refined in").is_some());
}

#[test]
fn a_lost_device_is_replaced() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    editor(&harness).painter().lose_device();
    run(&mut harness, UiCommand::FromLeft);
    settle(&mut harness);
    assert_eq!((editor(&harness).banner(), editor(&harness).notice()), (None, "Graphics device restarted"));
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl eframe::egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|e| e.to_string())
    }
}

fn drop_files(harness: &mut Window, paths: &[PathBuf]) {
    let files = paths.iter().map(|p| std::sync::Arc::new(Dropped(p.clone())) as eframe::egui::DroppedFileHandle);
    harness.input_mut().dropped_files = files.collect();
    harness.step();
    harness.input_mut().dropped_files.clear();
    harness.step();
}

#[test]
fn dropped_files_are_opened_or_used() {
    let place = Place::with_ball();
    let nrrd = place.path("other.nrrd");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n";
    std::fs::write(&nrrd, [header.as_bytes(), &[150u8; 512]].concat()).unwrap();
    let mut harness = harness(None);
    harness.step();
    drop_files(&mut harness, &[place.path("figure.json")]);
    settle(&mut harness);
    assert_eq!(figure(&harness), Template::parse(BALL).unwrap());
    // A volume on an open figure: in it, which can be undone.
    drop_files(&mut harness, std::slice::from_ref(&nrrd));
    assert!(harness.unnamed_widgets().is_empty());
    click_on(&mut harness, "Use in this figure");
    settle(&mut harness);
    let slot = figure(&harness).volumes[0].clone();
    assert!(slot.file.ends_with("other.nrrd") && slot.raw.is_none(), "{slot:?}");
    assert!(editor(&harness).notice().contains("those of before from 0 to 200"), "{}", editor(&harness).notice());
    run(&mut harness, UiCommand::Undo);
    assert_eq!(figure(&harness), Template::parse(BALL).unwrap());
    // Or by itself.
    drop_files(&mut harness, std::slice::from_ref(&nrrd));
    click_on(&mut harness, "Open by itself");
    settle(&mut harness);
    assert_eq!(figure(&harness).volumes[0].file, nrrd.display().to_string());
    assert!(figure(&harness) != Template::parse(BALL).unwrap());
    // A figure with a volume: its look, as a new figure.
    drop_files(&mut harness, &[place.path("figure.json"), nrrd.clone()]);
    settle(&mut harness);
    assert_eq!(nodes(&harness).len(), 4);
    assert_eq!(figure(&harness).volumes[0].file, nrrd.display().to_string());
    run(&mut harness, UiCommand::Save);
    harness.step();
    assert!(harness.query_by_label("Save the figure as").is_some(), "a new figure is not written over the old one");
    assert_eq!(std::fs::read_to_string(place.path("figure.json")).unwrap(), BALL);
}

#[test]
fn what_a_crash_leaves_is_offered_and_restored() {
    let place = Place::with_ball();
    let state = place.path("state");
    let window = |file: Option<PathBuf>| {
        let state = state.clone();
        let app = move |ui: &mut eframe::egui::Ui, editor: &mut Option<Editor>| {
            let ctx = ui.ctx().clone();
            let editor = editor.get_or_insert_with(|| {
                let session = fabrica_studio::editor::session::Session::open(Some(state.clone()));
                let files = file.iter().cloned().collect();
                Editor::new(&ctx, Options { files, session, ..Options::plain(AdapterChoice::Software) })
            });
            editor.ui(ui);
        };
        Harness::builder().with_size(Vec2::new(1000.0, 700.0)).with_step_dt(STEP).build_ui_state(app, None)
    };
    let mut first = window(Some(place.path("figure.json")));
    settle(&mut first);
    run(&mut first, UiCommand::FromLeft);
    let changed = figure(&first);
    // The program goes without anybody being asked.
    first.state_mut().as_mut().unwrap().leave();
    drop(first);
    assert_eq!(Template::read(&place.path("figure.json")).unwrap(), Template::parse(BALL).unwrap());

    let mut second = window(None);
    second.step();
    assert!(second.unnamed_widgets().is_empty());
    click_on(&mut second, "Restore");
    settle(&mut second);
    assert_eq!(figure(&second), changed);
    assert!(editor(&second).document().unwrap().is_changed());
    run(&mut second, UiCommand::Save);
    assert_eq!(Template::read(&place.path("figure.json")).unwrap(), changed);
    // Saved, it is not offered again, but it is among the recent ones. The next window looks as this one was left.
    run(&mut second, UiCommand::Theme);
    run(&mut second, UiCommand::LargerText);
    let mut third = window(None);
    third.step();
    assert!(third.ctx.theme() == eframe::egui::Theme::Light && (third.ctx.zoom_factor() - 1.1).abs() < 1e-3);
    run(&mut second, UiCommand::New);
    second.step();
    assert!(second.query_by_label("Restore").is_none() && editor(&second).document().is_none());
    assert!(second.query_all_by_label_contains("figure: ").count() == 1, "no recent figure");
}

#[test]
fn saving_on_the_way_out_goes_on_to_where_one_was_going() {
    let place = Place::with_ball();
    let mut harness = harness(None);
    harness.step();
    // A new figure has no file: it is asked for in between.
    drop_files(&mut harness, &[place.path("figure.json"), place.path("ball.raw")]);
    settle(&mut harness);
    run(&mut harness, UiCommand::FromLeft);
    run(&mut harness, UiCommand::New);
    harness.step();
    click_on(&mut harness, "Save");
    enter(&mut harness, &place.path("new.json").display().to_string());
    assert!(Template::read(&place.path("new.json")).is_ok());
    assert!(editor(&harness).document().is_none(), "the start page was asked for");
}

#[test]
fn the_start_page_begins_figures_that_are_nobodys_file() {
    let mut harness = harness(None);
    harness.step();
    assert!(harness.unnamed_widgets().is_empty());
    let card = harness.query_all_by_label_contains("Skull: ").next().unwrap().rect().center();
    click(&mut harness, card);
    settle(&mut harness);
    assert_eq!(figure(&harness).title, "Skull");
    run(&mut harness, UiCommand::Save);
    harness.step();
    assert!(harness.query_by_label("Save the figure as").is_some());
    assert!(harness.unnamed_widgets().is_empty());
}

/// The same walk on every machine.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n
    }
}

#[test]
fn a_random_walk_through_the_window_can_be_undone_to_its_first_byte() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    let first = figure(&harness).to_json().unwrap();
    let commands: Vec<UiCommand> = UiCommand::ALL
        .iter()
        .copied()
        .filter(|c| !matches!(c, UiCommand::Quit | UiCommand::New | UiCommand::Save))
        .collect();
    let mut dice = Dice(7);
    for step in 0..120 {
        let place = |dice: &mut Dice| Pos2::new(20.0 + dice.below(960) as f32, 40.0 + dice.below(640) as f32);
        match dice.below(4) {
            0 => {
                let (from, to) = (place(&mut dice), place(&mut dice));
                let released = dice.below(4) > 0;
                drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, from, to, released);
                if !released {
                    harness.key_press(Key::Escape);
                    harness.step();
                    let up = Event::PointerButton {
                        pos: to,
                        button: PointerButton::Primary,
                        pressed: false,
                        modifiers: Modifiers::NONE,
                    };
                    harness.event(up);
                    harness.step();
                }
            }
            1 => {
                let at = place(&mut dice);
                click(&mut harness, at);
            }
            _ => {
                let command = commands[dice.below(commands.len())];
                run(&mut harness, command);
                // Whatever asks something is answered with no.
                harness.key_press(Key::Escape);
                harness.step();
                harness.step();
            }
        }
        // What is previewed is dropped; dabs that are left are painted.
        harness.key_press(Key::Escape);
        harness.step();
        while editor(&harness).tools().is_busy() {
            harness.step();
        }
        assert_eq!(editor(&harness).banner(), None, "step {step}");
        let document = editor(&harness).document().unwrap_or_else(|| panic!("step {step} closed the figure"));
        assert!(!document.in_gesture(), "step {step} leaves a gesture open");
        let text = document.figure().to_json().unwrap();
        assert_eq!(Template::parse(&text).unwrap(), **document.figure(), "step {step}");
        let unnamed = harness.unnamed_widgets();
        assert!(unnamed.is_empty(), "step {step}: {unnamed:?}");
    }
    assert!(editor(&harness).document().unwrap().labels().count() > 5);
    undo_all(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), first);
    settle(&mut harness);
}

/// The slices, which are shown.
fn slices(harness: &Window) -> &SliceViews {
    editor(harness).slices().unwrap()
}

/// Where a slice's picture is.
fn slice_rect(harness: &Window, orientation: Orientation) -> Rect {
    let name = format!("{} slice at", orientation.name());
    harness.query_all_by_label_contains(&name).next().unwrap_or_else(|| panic!("no {name}")).rect()
}

fn turn_wheel(harness: &mut Window, at: Pos2, notches: f32, modifiers: Modifiers) {
    harness.event(Event::PointerMoved(at));
    harness.event(Event::ModifiersChanged(modifiers));
    harness.step();
    let (unit, phase) = (MouseWheelUnit::Line, TouchPhase::Move);
    harness.event(Event::MouseWheel {
        unit,
        delta: Vec2::new(0.0, notches),
        phase,
        source: MouseWheelSource::Unknown,
        modifiers,
    });
    // egui smooths what is turned over some frames.
    for _ in 0..20 {
        harness.step();
    }
    harness.event(Event::ModifiersChanged(Modifiers::NONE));
    harness.step();
}

fn numbers(harness: &Window) -> [usize; 3] {
    Orientation::ALL.map(|orientation| slices(harness).slice(orientation).unwrap().0)
}

#[test]
fn q_shows_slices_and_the_wheel_steps_through_them() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    assert!(editor(&harness).slices().is_none());
    let before = figure(&harness);
    harness.key_press(Key::Q);
    harness.step();
    harness.step();
    settle(&mut harness);
    assert_eq!(slices(&harness).slice(Orientation::Axial), Some((8, 16)), "the middle of 16 layers");
    let unnamed = harness.unnamed_widgets();
    assert!(unnamed.is_empty(), "{unnamed:?}");
    // The middle of raw voxels is the origin; they are a millimeter apart.
    for name in [
        "Axial slice at S 0.5 mm, radiological, R on the left, L on the right",
        "Axial slice",
        "Axial position",
        "Window",
    ] {
        assert!(harness.query_all_by_label_contains(name).next().is_some(), "nothing is called {name}");
    }
    assert!(
        harness.query_all_by_label_contains("Sagittal slice at R 0.5 mm, radiological, A on the left").next().is_some()
    );
    for (i, orientation) in Orientation::ALL.into_iter().enumerate() {
        let at = slice_rect(&harness, orientation).center();
        turn_wheel(&mut harness, at, 1.0, Modifiers::NONE);
        let mut expected = [8; 3];
        expected[i] = 9;
        assert_eq!(numbers(&harness), expected, "{orientation:?}");
        turn_wheel(&mut harness, at, -1.0, Modifiers::NONE);
        assert_eq!(numbers(&harness), [8; 3], "{orientation:?}");
        // With Ctrl it comes closer to what is under the pointer.
        let off = at + Vec2::new(20.0, -10.0);
        let aim = slices(&harness).aim(off).unwrap();
        turn_wheel(&mut harness, off, 3.0, Modifiers::COMMAND);
        let closer = slices(&harness).aim(off).unwrap();
        assert!(closer.mm_per_point < 0.9 * aim.mm_per_point && closer.place_mm.distance(aim.place_mm) < 0.01);
        assert_eq!(numbers(&harness), [8; 3], "{orientation:?}");
    }
    // At the ends it stays.
    let at = slice_rect(&harness, Orientation::Coronal).center();
    turn_wheel(&mut harness, at, 100.0, Modifiers::NONE);
    assert_eq!(numbers(&harness), [8, 15, 8]);
    turn_wheel(&mut harness, at, -100.0, Modifiers::NONE);
    assert_eq!(numbers(&harness), [8, 0, 8]);
    let zoomed = slices(&harness).aim(at).unwrap().mm_per_point;
    run(&mut harness, UiCommand::Fit);
    harness.step();
    assert!(slices(&harness).aim(at).unwrap().mm_per_point > zoomed);
    harness.key_press(Key::Q);
    harness.step();
    harness.step();
    assert!(editor(&harness).slices().is_none() && harness.query_all_by_label_contains("Axial slice").next().is_none());
    undo_all(&mut harness);
    assert_eq!(figure(&harness), before);
    settle(&mut harness);
}

#[test]
fn the_crosshair_goes_where_the_hand_points() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    run(&mut harness, UiCommand::Slices);
    settle(&mut harness);
    let crosshair = |harness: &Window| slices(harness).crosshair_mm().unwrap();
    assert_eq!(crosshair(&harness).to_array(), [0.5; 3]);
    // Up and to the left in the axial slice is anterior and right.
    let axial = slice_rect(&harness, Orientation::Axial);
    let at = axial.center() + Vec2::new(-40.0, -25.0);
    let aim = slices(&harness).aim(at).unwrap();
    assert_eq!((aim.orientation, aim.view_direction.to_array()), (Orientation::Axial, [0.0, 0.0, 1.0]));
    click(&mut harness, at);
    let there = crosshair(&harness);
    let voxel = |place: DVec3| ((place - 0.5).round() + 0.5).to_array();
    assert_eq!(there.to_array(), voxel(aim.place_mm));
    assert!(there.x > 0.5 && there.y > 0.5 && there.z == 0.5, "{there}");
    assert!(slices(&harness).under().is_some_and(|under| (under.position_mm - aim.place_mm).length() < 1e-9));
    // A drag ends where it ends; given up, it was not.
    drag_from(&mut harness, axial.center(), axial.center() + Vec2::new(30.0, 0.0));
    let dragged = crosshair(&harness);
    assert!(dragged.x < 0.0 && dragged.y.abs() == 0.5 && dragged.z == 0.5, "{dragged}");
    drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, axial.center(), at, false);
    assert!(crosshair(&harness) != dragged);
    harness.key_press(Key::Escape);
    harness.step();
    assert_eq!(crosshair(&harness), dragged);
    let up =
        Event::PointerButton { pos: at, button: PointerButton::Primary, pressed: false, modifiers: Modifiers::NONE };
    harness.event(up);
    harness.step();
    assert_eq!(crosshair(&harness), dragged);
    // Shift and a move take all slices along; a bare move does not.
    let coronal = slice_rect(&harness, Orientation::Coronal).center() + Vec2::new(25.0, 12.0);
    harness.event(Event::PointerMoved(coronal));
    harness.step();
    assert_eq!(crosshair(&harness), dragged);
    harness.event(Event::ModifiersChanged(Modifiers::SHIFT));
    harness.event(Event::PointerMoved(coronal + Vec2::new(2.0, 2.0)));
    harness.step();
    harness.event(Event::ModifiersChanged(Modifiers::NONE));
    harness.step();
    let linked = crosshair(&harness);
    let aim = slices(&harness).aim(coronal + Vec2::new(2.0, 2.0)).unwrap();
    assert_eq!(linked.to_array(), voxel(aim.place_mm));
    assert!(linked.y == dragged.y && linked.z < 0.5);
    // By keys: the slice that was clicked has the focus.
    click(&mut harness, axial.center() + Vec2::new(-3.0, -3.0));
    for (key, expected) in [
        (Key::ArrowLeft, [1.5, 0.5, linked.z]),
        (Key::ArrowUp, [1.5, 1.5, linked.z]),
        (Key::ArrowRight, [0.5, 1.5, linked.z]),
        (Key::PageUp, [0.5, 1.5, linked.z + 1.0]),
        (Key::PageDown, [0.5, 1.5, linked.z]),
        (Key::ArrowDown, [0.5, 0.5, linked.z]),
    ] {
        harness.key_press(key);
        harness.step();
        harness.step();
        assert_eq!(crosshair(&harness).to_array(), expected, "{key:?}");
    }
    // The figure's camera had no part in that.
    assert!(editor(&harness).document().unwrap().undo_label().is_none());
    // By its number.
    click_on(&mut harness, "Coronal position");
    enter(&mut harness, "p 4.4 mm");
    assert_eq!((numbers(&harness)[1], crosshair(&harness).y), (3, -4.5));
    // Beside the volume it stays in it.
    click(&mut harness, axial.left_top() + Vec2::new(3.0, 3.0));
    assert_eq!(crosshair(&harness).to_array(), [7.5, 7.5, linked.z]);
    // Middle drag moves the picture and nothing else.
    let aim = slices(&harness).aim(axial.center()).unwrap();
    drag_between(
        &mut harness,
        PointerButton::Middle,
        Modifiers::NONE,
        axial.center(),
        axial.center() + Vec2::new(31.0, 17.0),
        true,
    );
    let moved = slices(&harness).aim(axial.center() + Vec2::new(31.0, 17.0)).unwrap();
    assert!(moved.place_mm.distance(aim.place_mm) < 1e-3 && crosshair(&harness).to_array() == [7.5, 7.5, linked.z]);
    settle(&mut harness);
}

#[test]
fn what_is_clicked_in_the_figure_is_looked_at_in_slices() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    run(&mut harness, UiCommand::Slices);
    settle(&mut harness);
    let rect = harness.query_all_by_label_contains("Figure: ").next().unwrap().rect();
    assert!(rect.left() > slice_rect(&harness, Orientation::Axial).center().x, "beside the axial slice");
    click(&mut harness, rect.center());
    harness.step();
    let there = slices(&harness).crosshair_mm().unwrap();
    // From the front, the ball's surface.
    assert!(there.x.abs() < 1.0 && there.z.abs() < 1.0 && (3.0..7.0).contains(&there.y), "{there}");
    // Beside the ball there is nothing to look at.
    harness.key_press(Key::Escape);
    harness.step();
    click(&mut harness, rect.left_top() + Vec2::new(40.0, 40.0));
    assert_eq!(slices(&harness).crosshair_mm(), Some(there));
    settle(&mut harness);
}

#[test]
fn windows_are_dragged_typed_and_reset() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    run(&mut harness, UiCommand::Slices);
    settle(&mut harness);
    let window = |harness: &Window| slices(harness).window().unwrap();
    let first = window(&harness);
    assert!(first.width > 50.0, "{first:?}");
    let at = slice_rect(&harness, Orientation::Sagittal).center();
    let to = at + Vec2::new(40.0, -30.0);
    drag_between(&mut harness, PointerButton::Secondary, Modifiers::NONE, at, to, true);
    let dragged = window(&harness);
    assert!(dragged.width > first.width && dragged.level < first.level, "{dragged:?}");
    drag_between(&mut harness, PointerButton::Secondary, Modifiers::NONE, at, to, false);
    assert!(window(&harness) != dragged);
    harness.key_press(Key::Escape);
    harness.step();
    assert_eq!(window(&harness), dragged);
    let up =
        Event::PointerButton { pos: to, button: PointerButton::Secondary, pressed: false, modifiers: Modifiers::NONE };
    harness.event(up);
    harness.step();
    run(&mut harness, UiCommand::SliceWindow);
    assert_eq!(window(&harness), first);
    click_on(&mut harness, "Level");
    enter(&mut harness, "2*60");
    assert_eq!((window(&harness).level, window(&harness).width), (120.0, first.width));
    // Two clicks in a row; with the one before they would be three.
    for _ in 0..30 {
        harness.step();
    }
    for _ in 0..2 {
        click(&mut harness, at);
    }
    assert_eq!(window(&harness), first);
    settle(&mut harness);
}

#[test]
fn the_side_of_slices_is_said_and_kept() {
    let place = Place::with_ball();
    let state = place.path("state");
    let window = |file: PathBuf| {
        let state = state.clone();
        let app = move |ui: &mut eframe::egui::Ui, editor: &mut Option<Editor>| {
            let ctx = ui.ctx().clone();
            let editor = editor.get_or_insert_with(|| {
                let session = fabrica_studio::editor::session::Session::open(Some(state.clone()));
                Editor::new(
                    &ctx,
                    Options { files: vec![file.clone()], session, ..Options::plain(AdapterChoice::Software) },
                )
            });
            editor.ui(ui);
        };
        Harness::builder().with_size(Vec2::new(1000.0, 700.0)).with_step_dt(STEP).build_ui_state(app, None)
    };
    let mut first = window(place.path("figure.json"));
    settle(&mut first);
    let why = editor(&first).disabled(UiCommand::SliceSides);
    assert_eq!(why, Some("Show slices first (Q)"));
    run(&mut first, UiCommand::Slices);
    settle(&mut first);
    let there = slice_rect(&first, Orientation::Coronal).center() + Vec2::new(30.0, 0.0);
    assert!(slices(&first).aim(there).unwrap().place_mm.x < 0.0, "the left is on the right");
    click_on(&mut first, "Neurological");
    first.step();
    assert!(slices(&first).aim(there).unwrap().place_mm.x > 0.0);
    for name in [
        "Axial slice at S 0.5 mm, neurological, L on the left",
        "Sagittal slice at R 0.5 mm, neurological, A on the left",
    ] {
        assert!(first.query_all_by_label_contains(name).next().is_some(), "nothing is called {name}");
    }
    // The figure has nothing to do with it.
    assert!(first.query_all_by_label_contains("Figure: ball, seen from the front, R? on the left").next().is_some());
    first.state_mut().as_mut().unwrap().leave();
    drop(first);
    let mut second = window(place.path("figure.json"));
    settle(&mut second);
    assert_eq!(slices(&second).convention, Convention::Neurological);
    run(&mut second, UiCommand::SliceSides);
    second.step();
    assert_eq!(slices(&second).convention, Convention::Radiological);
    // Without its figure there is nothing to show.
    run(&mut second, UiCommand::New);
    second.step();
    assert!(second.query_all_by_label_contains("slice at").next().is_none());
}

/// Voxels of the painted selection of that name; none where there is no such slot.
fn painted(harness: &Window, name: &str) -> Option<f64> {
    let figure = figure(harness);
    let slot = figure.selections.iter().find(|s| s.name == name)?;
    slot.voxels.as_ref().map(|voxels| voxels.selection().num_voxels())
}

#[test]
fn a_stroke_makes_a_region_and_is_one_step() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    let first = figure(&harness).to_json().unwrap();
    harness.key_press(Key::B);
    harness.step();
    // Given up, it was never there.
    drag(&mut harness, PointerButton::Primary, Vec2::new(30.0, 10.0), false);
    assert!(painted(&harness, "Selection 1").is_some_and(|n| n > 0.0));
    harness.key_press(Key::Escape);
    harness.step();
    assert_eq!(figure(&harness).to_json().unwrap(), first);
    let up = Event::PointerButton {
        pos: MIDDLE + Vec2::new(30.0, 10.0),
        button: PointerButton::Primary,
        pressed: false,
        modifiers: Modifiers::NONE,
    };
    harness.event(up);
    harness.step();
    assert_eq!(figure(&harness).to_json().unwrap(), first);
    // A stroke: a slot, a region and its voxels in one step.
    drag(&mut harness, PointerButton::Primary, Vec2::new(30.0, 10.0), true);
    settle(&mut harness);
    let one = painted(&harness, "Selection 1").unwrap();
    assert!(one > 0.0 && figure(&harness).objects[0].regions.len() == 1);
    let text = labels(&harness);
    assert!(text.len() == 1 && text[0].starts_with("Paint Selection 1, "), "{text:?}");
    let wanted = format!("Paint Selection 1, {} voxels", one.round());
    assert_eq!(text[0], wanted);
    // The next one goes into the same selection; Alt takes away.
    drag(&mut harness, PointerButton::Primary, Vec2::new(-40.0, 10.0), true);
    settle(&mut harness);
    let two = painted(&harness, "Selection 1").unwrap();
    assert!(two > one && figure(&harness).objects[0].regions.len() == 1);
    drag_with(&mut harness, PointerButton::Primary, Modifiers::ALT, Vec2::new(-40.0, 10.0), true);
    settle(&mut harness);
    assert!(painted(&harness, "Selection 1").unwrap() < two);
    assert!(labels(&harness)[2].starts_with("Erase from Selection 1, "), "{:?}", labels(&harness));
    // What is saved is read again, and the middle button turns the figure as ever.
    let text = figure(&harness).to_json().unwrap();
    assert_eq!(Template::parse(&text).unwrap(), figure(&harness));
    let from = figure(&harness).camera.from;
    drag(&mut harness, PointerButton::Middle, Vec2::new(30.0, 0.0), true);
    assert_ne!(figure(&harness).camera.from, from);
    assert!(harness.unnamed_widgets().is_empty(), "{:?}", harness.unnamed_widgets());
    undo_all(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), first);
    // Off the surface nothing is painted.
    drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, MIDDLE + Vec2::new(0.0, 1000.0), MIDDLE, true);
    harness.key_press(Key::V);
    harness.step();
    assert!(!editor(&harness).tools().takes_primary());
    settle(&mut harness);
}

#[test]
fn the_radius_and_the_menu_refine_what_was_painted() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    run(&mut harness, UiCommand::BrushTool);
    assert!(editor(&harness).disabled(UiCommand::GrowSelection).is_some());
    drag(&mut harness, PointerButton::Primary, Vec2::new(4.0, 0.0), true);
    settle(&mut harness);
    let small = painted(&harness, "Selection 1").unwrap();
    run(&mut harness, UiCommand::Undo);
    // A wider brush by Shift+drag and by a key.
    let shift = Modifiers::SHIFT;
    drag_with(&mut harness, PointerButton::Primary, shift, Vec2::new(25.0, 0.0), true);
    assert!(labels(&harness).is_empty(), "a radius is no edit: {:?}", labels(&harness));
    harness.key_press(Key::CloseBracket);
    harness.step();
    drag(&mut harness, PointerButton::Primary, Vec2::new(4.0, 0.0), true);
    settle(&mut harness);
    let large = painted(&harness, "Selection 1").unwrap();
    assert!(large > 1.5 * small, "{large} {small}");
    let mut before = large;
    for (command, grows) in
        [(UiCommand::GrowSelection, true), (UiCommand::ShrinkSelection, false), (UiCommand::InvertSelection, true)]
    {
        run(&mut harness, command);
        settle(&mut harness);
        let after = painted(&harness, "Selection 1").unwrap();
        assert_eq!(after > before, grows, "{command:?}: {before} to {after}");
        before = after;
    }
    assert_eq!(labels(&harness).len(), 4);
    // What changes nothing is said, and is no step.
    run(&mut harness, UiCommand::KeepLargest);
    settle(&mut harness);
    assert!(labels(&harness).len() <= 5);
    while labels(&harness).len() > 1 {
        run(&mut harness, UiCommand::Undo);
    }
    assert_eq!(painted(&harness, "Selection 1"), Some(large));
}

#[test]
fn the_brush_paints_in_slices() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    let first = figure(&harness).to_json().unwrap();
    run(&mut harness, UiCommand::Slices);
    run(&mut harness, UiCommand::BrushTool);
    harness.step();
    let crosshair = slices(&harness).crosshair_mm().unwrap();
    let middle = slice_rect(&harness, Orientation::Axial).center();
    drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, middle, middle + Vec2::new(12.0, 0.0), true);
    settle(&mut harness);
    assert!(painted(&harness, "Selection 1").is_some_and(|n| n > 0.0), "{:?}", editor(&harness).notice());
    assert_eq!(slices(&harness).crosshair_mm().unwrap(), crosshair, "the primary button is the brush's");
    assert!(harness.unnamed_widgets().is_empty());
    undo_all(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), first);
    settle(&mut harness);
}

#[test]
fn loops_select_what_they_go_around() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    let first = figure(&harness).to_json().unwrap();
    run(&mut harness, UiCommand::RectangleTool);
    // The left half of the ball, through everything; then its front alone.
    let middle = harness.get_by_label_contains("Figure:").rect().center();
    let (from, to) = (middle - Vec2::splat(150.0), middle + Vec2::new(0.0, 150.0));
    drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, from, to, true);
    settle(&mut harness);
    let half = painted(&harness, "Selection 1").unwrap_or_else(|| panic!("{}", editor(&harness).notice()));
    assert!(labels(&harness)[0].starts_with("Rectangle Selection 1, +"), "{:?}", labels(&harness));
    run(&mut harness, UiCommand::Undo);
    click_on(&mut harness, "Surface");
    drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, from, to, true);
    settle(&mut harness);
    let front = painted(&harness, "Selection 1").unwrap_or_else(|| panic!("{}", editor(&harness).notice()));
    assert!(front > 0.0 && front < 0.9 * half, "{front} of {half}");
    run(&mut harness, UiCommand::Undo);
    // The lasso, corner by corner; Backspace takes one back, Enter closes.
    run(&mut harness, UiCommand::LassoTool);
    for by in [Vec2::new(-40.0, -40.0), Vec2::new(40.0, -40.0), Vec2::new(0.0, 60.0), Vec2::new(-90.0, 60.0)] {
        click(&mut harness, MIDDLE + by);
    }
    harness.key_press(Key::Backspace);
    harness.step();
    harness.key_press(Key::Enter);
    settle(&mut harness);
    assert!(painted(&harness, "Selection 1").is_some_and(|n| n > 0.0), "{}", editor(&harness).notice());
    assert!(labels(&harness)[0].starts_with("Lasso Selection 1, +"), "{:?}", labels(&harness));
    run(&mut harness, UiCommand::Undo);
    // Freehand around nothing: no step.
    let corner = middle + Vec2::new(-150.0, 150.0);
    drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, corner, corner + Vec2::new(9.0, -9.0), true);
    settle(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), first);
    assert!(harness.unnamed_widgets().is_empty());
}

#[test]
fn a_region_grows_from_a_seed_until_it_is_accepted() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    let first = figure(&harness).to_json().unwrap();
    run(&mut harness, UiCommand::GrowTool);
    click(&mut harness, MIDDLE);
    settle_tools(&mut harness);
    assert!(painted(&harness, "Selection 1").is_some_and(|n| n > 0.0), "{}", editor(&harness).notice());
    assert!(labels(&harness).is_empty(), "it is looked at only");
    // More tolerance takes no less.
    let small = painted(&harness, "Selection 1").unwrap();
    drag(&mut harness, PointerButton::Primary, Vec2::new(200.0, 0.0), true);
    settle_tools(&mut harness);
    assert!(painted(&harness, "Selection 1").unwrap() >= small);
    harness.key_press(Key::Escape);
    harness.step();
    harness.step();
    assert_eq!(figure(&harness).to_json().unwrap(), first);
    click(&mut harness, MIDDLE);
    settle_tools(&mut harness);
    harness.key_press(Key::Enter);
    settle(&mut harness);
    let steps = labels(&harness);
    assert!(steps.len() == 1 && steps[0].starts_with("Grow Selection 1, ±"), "{steps:?}");
    undo_all(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), first);
}

/// Runs frames until no tool is at work.
fn settle_tools(harness: &mut Window) {
    let start = Instant::now();
    harness.step();
    while editor(harness).tools().is_busy() {
        assert!(start.elapsed() < Duration::from_secs(60), "a tool is still busy");
        std::thread::sleep(Duration::from_millis(2));
        harness.step();
    }
    harness.step();
}

/// The header of a file on the grid of the raw block, whose middle is the origin.
const BLOCK: &str = "NRRD0004\ntype: uint8\ndimension: 3\nspace: right-anterior-superior\nsizes: 16 16 16\n\
                     space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (-7.5,-7.5,-7.5)\nencoding: raw\n";

/// Writes a label map for the ball's block: slabs of a voxel along x inside the ball, "rib 1" to "rib 16".
fn ribs(place: &Place) -> PathBuf {
    let names: String = (1..=16).map(|i| format!("Segment{i}_Name:=rib {i}\nSegment{i}_LabelValue:={i}\n")).collect();
    let header = format!("{BLOCK}{names}\n");
    let ball = std::fs::read(place.path("ball.raw")).unwrap();
    let voxels: Vec<u8> = ball.iter().enumerate().map(|(i, v)| if *v > 0 { 1 + (i % 16) as u8 } else { 0 }).collect();
    let path = place.path("ribs.seg.nrrd");
    std::fs::write(&path, [header.as_bytes(), &voxels].concat()).unwrap();
    path
}

/// The ball's figure with its ribs as a group.
fn opened_with_ribs(place: &Place) -> Window {
    let path = ribs(place);
    let mut harness = opened(place);
    run(&mut harness, UiCommand::AddSelections);
    harness.step();
    enter(&mut harness, &path.display().to_string());
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    assert_eq!(figure(&harness).objects[0].regions.len(), 1);
    harness
}

fn click_with(harness: &mut Window, modifiers: Modifiers, label: &str) {
    let pos = middle(harness, label);
    harness.event(Event::ModifiersChanged(modifiers));
    harness.event(Event::PointerMoved(pos));
    harness.step();
    for pressed in [true, false] {
        harness.event(Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers });
        harness.step();
    }
    harness.event(Event::ModifiersChanged(Modifiers::NONE));
    harness.step();
}

/// The middle of a structure's row; what is chosen is named below the list again.
fn row_of(harness: &Window, name: &str) -> Pos2 {
    harness.query_all_by_label(name).next().unwrap().rect().center()
}

/// The look that the template gives a structure, without its group's.
fn own_look(harness: &Window, name: &str) -> fabrica_studio::figure::template::LookTemplate {
    figure(harness).objects[0].regions[0].own_look(Some(name))
}

#[test]
fn structures_are_found_ordered_and_changed_together() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    let listed = |harness: &Window| {
        let rows = harness.query_all_by_label_contains("rib ");
        let mut rows: Vec<(f32, String)> = rows
            .filter_map(|node| Some((node.rect().top(), node.accesskit_node().label()?)))
            .filter(|(_, label)| label.starts_with("rib "))
            .collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows.into_iter().map(|(_, label)| label).collect::<Vec<_>>()
    };
    assert!(
        listed(&harness)[..2] == ["rib 2", "rib 3"] || listed(&harness)[..2] == ["rib 1", "rib 2"],
        "{:?}",
        listed(&harness)
    );
    assert!(harness.unnamed_widgets().is_empty(), "widgets without a name");
    // The largest first: those through the middle.
    click_on(&mut harness, "Order in ribs");
    harness.step();
    click_on(&mut harness, "By volume");
    let first = listed(&harness)[0].clone();
    assert!(["rib 8", "rib 9"].contains(&first.as_str()), "{first}");
    // One types what one looks for; Escape lists all again.
    click_on(&mut harness, "Search in ribs");
    harness.event(Event::Text("RIB 1".to_owned()));
    harness.step();
    harness.step();
    assert!(listed(&harness).iter().all(|name| name.starts_with("rib 1")), "{:?}", listed(&harness));
    harness.key_press(Key::Escape);
    harness.step();
    harness.step();
    assert_eq!(listed(&harness)[0], first);
    click_on(&mut harness, "Order in ribs");
    harness.step();
    click_on(&mut harness, "As in file");
    // Several at once: one step.
    let before = labels(&harness).len();
    let rows = listed(&harness);
    let [a, b, c]: [String; 3] = std::array::from_fn(|i| rows[i].clone());
    click_on(&mut harness, &a);
    click_with(&mut harness, Modifiers::COMMAND, &c);
    click_on(&mut harness, "Opacity");
    enter(&mut harness, "25");
    assert_eq!(labels(&harness)[before..], ["Change look of 2 structures"]);
    assert_eq!([&a, &b, &c].map(|name| own_look(&harness, name).opacity), [Some(0.25), None, Some(0.25)]);
    // Ctrl takes one away again, Shift takes all in between.
    click_with(&mut harness, Modifiers::COMMAND, &c);
    click_with(&mut harness, Modifiers::SHIFT, &c);
    click_on(&mut harness, &format!("Hide {b}"));
    assert_eq!([&a, &b, &c].map(|name| own_look(&harness, name).visible), [Some(false); 3]);
    click_on(&mut harness, "Show only these");
    let hidden = |harness: &Window| {
        figure(harness).objects[0].regions[0].structures.iter().filter(|s| s.look.visible == Some(false)).count()
    };
    assert!(hidden(&harness) >= 10 && own_look(&harness, &b).visible.is_none(), "{}", hidden(&harness));
    click_on(&mut harness, "Show all");
    assert_eq!(hidden(&harness), 0);
    // Arrows go on in the list.
    click_on(&mut harness, &a);
    harness.key_press(Key::ArrowDown);
    harness.step();
    harness.step();
    assert!(harness.query_by_label(&format!("{b}: transfer function")).is_some(), "the arrow chose another one");
    harness.key_press(Key::ArrowDown);
    harness.step();
    harness.step();
    assert!(harness.query_by_label(&format!("{c}: transfer function")).is_some(), "and on");
    assert!(harness.unnamed_widgets().is_empty(), "widgets without a name");
    undo_all(&mut harness);
    assert_eq!(figure(&harness), Template::parse(BALL).unwrap());
}

#[test]
fn the_strip_is_about_the_chosen_region() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    let objects = nodes(&harness);
    let groups = figure(&harness).objects[0].regions[0].look.transfer_function.clone();
    assert!(groups.is_some(), "a group begins with a look of its own");
    click_on(&mut harness, "rib 5");
    assert!(harness.query_by_label("rib 5: transfer function").is_some());
    assert!(harness.query_by_label("Back to the group's").is_none(), "it looks as its group");
    // The first edit makes a copy for it, in the same step.
    let before = labels(&harness).len();
    click_on(&mut harness, "Node 1 at 0");
    click_on(&mut harness, "Node opacity");
    enter(&mut harness, "35");
    assert_eq!(labels(&harness)[before..], ["Move node to 0 (rib 5)"]);
    let own = own_look(&harness, "rib 5").transfer_function.unwrap();
    assert_eq!(own.nodes[0].opacity, 0.35);
    assert_eq!(figure(&harness).objects[0].regions[0].look.transfer_function, groups);
    assert_eq!(nodes(&harness), objects);
    assert!(harness.unnamed_widgets().is_empty(), "widgets without a name");
    click_on(&mut harness, "Back to the group's");
    assert!(own_look(&harness, "rib 5").transfer_function.is_none());
    // Keys and menus work on it as well; the object's is edited once the object is chosen.
    click_on(&mut harness, "Node 1 at 0");
    run(&mut harness, UiCommand::InsertNode);
    assert_eq!(own_look(&harness, "rib 5").transfer_function.unwrap().nodes.len(), 2);
    run(&mut harness, UiCommand::Undo);
    let title = figure(&harness).objects[0].title().to_owned();
    click_on(&mut harness, &title);
    assert!(harness.query_by_label("Transfer function").is_some());
    assert!(harness.query_by_label("Node 4 at 180").is_some());
}

#[test]
fn styles_fall_on_regions() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    click_on(&mut harness, "Find a style");
    harness.event(Event::Text("brass".to_owned()));
    harness.step();
    harness.step();
    let brass = |harness: &Window| harness.query_all_by_label("Style Brass").next().unwrap().rect().center();
    let objects = nodes(&harness);
    let (from, row) = (brass(&harness), row_of(&harness, "rib 5"));
    drag_from(&mut harness, from, row);
    assert_eq!(own_look(&harness, "rib 5").style.as_deref(), Some("brass"));
    assert_eq!(labels(&harness).last().unwrap(), "Change look of rib 5");
    // One with a transfer function of its own: on all of its nodes.
    click_on(&mut harness, "rib 3");
    click_on(&mut harness, "Node 1 at 0");
    click_on(&mut harness, "Node opacity");
    enter(&mut harness, "35");
    let (from, row) = (brass(&harness), row_of(&harness, "rib 3"));
    drag_from(&mut harness, from, row);
    let look = own_look(&harness, "rib 3");
    assert!(look.style.is_none(), "{look:?}");
    assert!(look.transfer_function.as_ref().unwrap().nodes.iter().all(|n| n.style == "brass"), "{look:?}");
    // On the picture: the region that is seen there, and nothing of the object.
    let from = brass(&harness);
    drag_from(&mut harness, from, MIDDLE);
    let dressed = figure(&harness).objects[0].regions[0].structures.clone();
    let dressed: Vec<_> = dressed.iter().filter(|s| s.look.style.as_deref() == Some("brass")).collect();
    assert!(
        dressed.len() == 2 && ["rib 8", "rib 9", "rib 10", "rib 11"].contains(&dressed[1].structure.as_str()),
        "{dressed:?}"
    );
    assert_eq!(nodes(&harness), objects);
}

#[test]
fn what_is_clicked_is_found_in_the_list() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    let before = figure(&harness);
    // Hidden from view by a search, and its group folded in.
    click_on(&mut harness, "Search in ribs");
    harness.event(Event::Text("rib 2".to_owned()));
    harness.step();
    click(&mut harness, MIDDLE);
    let said: Vec<_> = harness.query_all_by_label_contains("gradient").map(|n| format!("{n:?}")).collect();
    assert!(harness.query_by_label("Choose it").is_some(), "no answer: {said:?}");
    let name = ["rib 8", "rib 9", "rib 10", "rib 11"].into_iter().find(|name| harness.query_by_label(name).is_some());
    let seen: Vec<_> = harness.query_all_by_label_contains("rib").map(|n| format!("{n:?}")).collect();
    let name = name.unwrap_or_else(|| panic!("its name is not said: {seen:?}"));
    assert!(harness.unnamed_widgets().is_empty(), "widgets without a name");
    click_on(&mut harness, "Choose it");
    (0..10).for_each(|_| harness.step());
    assert!(harness.query_by_label("Choose it").is_none(), "the answer stays open");
    assert!(harness.query_by_label(&format!("Hide {name}")).is_some(), "its row is in view");
    assert!(harness.query_by_label(&format!("{name}: transfer function")).is_some());
    assert_eq!(figure(&harness), before, "asking and choosing are no edits");
    // Where it is hidden, what is behind is seen: here the rib beside it, or nothing.
    click_on(&mut harness, &format!("Hide {name}"));
    click(&mut harness, MIDDLE);
    assert_eq!(harness.query_all_by_label(name).filter(|node| node.rect().left() < 650.0).count(), 0);
}

#[test]
fn a_dropped_label_map_can_be_selections() {
    let place = Place::with_ball();
    let path = ribs(&place);
    let mut harness = opened(&place);
    drop_files(&mut harness, std::slice::from_ref(&path));
    assert!(
        harness.query_by_label("Use in this figure").is_some() && harness.query_by_label("Open by itself").is_some()
    );
    assert!(harness.unnamed_widgets().is_empty(), "widgets without a name");
    click_on(&mut harness, "Use as selections");
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    assert_eq!(labels(&harness), ["Add ribs"]);
    assert!(harness.query_by_label("ribs").is_some());
    // The same as a folder of masks, by its path.
    let folder = place.path("masks");
    std::fs::create_dir(&folder).unwrap();
    let header = format!("{BLOCK}\n");
    for (name, from) in [("left_half", 0), ("right_half", 8)] {
        let voxels: Vec<u8> = (0..4096).map(|i| u8::from((from..from + 8).contains(&(i % 16)))).collect();
        std::fs::write(folder.join(format!("{name}.nrrd")), [header.as_bytes(), &voxels].concat()).unwrap();
    }
    run(&mut harness, UiCommand::AddMasks);
    harness.step();
    enter(&mut harness, &folder.display().to_string());
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    assert_eq!(labels(&harness), ["Add ribs", "Add masks"]);
    // One that lies elsewhere is refused with the reason, and nothing is lost.
    let elsewhere = place.path("far.seg.nrrd");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nspace origin: (900,0,0)\n\
                  space directions: (1,0,0) (0,1,0) (0,0,1)\nsizes: 4 4 4\nencoding: raw\nSegment0_Name:=far\n\
                  Segment0_LabelValue:=1\n\n";
    std::fs::write(&elsewhere, [header.as_bytes(), &[1u8; 64]].concat()).unwrap();
    drop_files(&mut harness, std::slice::from_ref(&elsewhere));
    click_on(&mut harness, "Use as selections");
    settle(&mut harness);
    assert!(editor(&harness).banner().is_some_and(|b| b.contains("elsewhere")), "{:?}", editor(&harness).banner());
    assert_eq!(labels(&harness).len(), 2);
}

fn moved(harness: &Window) -> Option<MoveTemplate> {
    figure(harness).objects[0].regions[0].moved.clone()
}

#[test]
fn handles_move_turn_and_scale_what_is_chosen() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    harness.key_press(Key::B);
    harness.step();
    drag(&mut harness, PointerButton::Primary, Vec2::new(30.0, 10.0), true);
    settle_tools(&mut harness);
    let handle = "Move superior or inferior";
    // The handles are those of the tool that asks.
    assert!(harness.query_by_label(handle).is_none());
    harness.key_press(Key::V);
    harness.step();
    harness.step();
    settle(&mut harness);
    let first = figure(&harness);
    assert!(editor(&harness).disabled(UiCommand::PutBack).is_some());
    for name in [
        handle,
        "Move right or left",
        "Move in the picture's plane",
        "Turn about the axis anterior",
        "Scale about its middle",
    ] {
        let size = harness.query_all_by_label(name).last().unwrap_or_else(|| panic!("{name}")).rect().size();
        assert!(size.min_elem() >= 24.0, "{name}: {size}");
    }
    assert!(harness.unnamed_widgets().is_empty(), "{:?}", harness.unnamed_widgets());
    // Given up, nothing was moved, and the hand that still drags moves nothing.
    let (at, up) = (middle(&harness, handle), Vec2::new(0.0, -60.0));
    drag_between(&mut harness, PointerButton::Primary, Modifiers::NONE, at, at + up, false);
    assert!(moved(&harness).is_some_and(|m| m.offset[2] > 0.0 && m.offset[0] == 0.0 && m.offset[1] == 0.0));
    assert_eq!(figure(&harness).camera, first.camera);
    harness.key_press(Key::Escape);
    harness.step();
    harness.event(Event::PointerMoved(at + 2.0 * up));
    harness.step();
    assert_eq!(figure(&harness), first);
    let release =
        |pos| Event::PointerButton { pos, button: PointerButton::Primary, pressed: false, modifiers: Modifiers::NONE };
    harness.event(release(at + 2.0 * up));
    harness.step();
    harness.step();
    // A drag is a step with its length; with Ctrl in whole millimeters, with Shift a tenth as far.
    let num_steps = labels(&harness).len();
    let drag_handle = |harness: &mut Window, name: &str, modifiers: Modifiers, by: Vec2| {
        let at = middle(harness, name);
        drag_between(harness, PointerButton::Primary, modifiers, at, at + by, true);
        labels(harness).last().cloned().unwrap()
    };
    let length = |label: &str| -> f64 {
        let text = label.strip_prefix("Move Selection 1 ").unwrap_or_else(|| panic!("{label}"));
        text.strip_suffix(" mm").unwrap().parse().unwrap()
    };
    let whole = length(&drag_handle(&mut harness, handle, Modifiers::NONE, up));
    assert!(whole > 1.0 && labels(&harness).len() == num_steps + 1, "{:?}", labels(&harness));
    let offset = moved(&harness).unwrap().offset;
    run(&mut harness, UiCommand::Undo);
    assert_eq!(figure(&harness), first);
    let fine = length(&drag_handle(&mut harness, handle, Modifiers::SHIFT, up));
    assert!((fine - 0.1 * whole).abs() < 0.1, "{fine} of {whole}");
    run(&mut harness, UiCommand::Undo);
    let snapped = length(&drag_handle(&mut harness, handle, Modifiers::COMMAND, up));
    assert!((snapped - whole.round()).abs() < 1e-9, "{snapped} of {whole}");
    let snapped_offset = moved(&harness).unwrap().offset[2];
    assert!((snapped_offset / offset[2] - snapped / whole).abs() < 0.05);
    // Seen from the front, what is dragged to the right goes to the left of the body.
    drag_handle(&mut harness, "Move in the picture's plane", Modifiers::NONE, Vec2::new(25.0, 0.0));
    assert!(moved(&harness).unwrap().offset[0] < 0.0);
    // A shaft is held as well as its end, and a click on it asks nothing.
    let (a, b) = (middle(&harness, handle), middle(&harness, "Move in the picture's plane"));
    let before = moved(&harness).unwrap().offset[2];
    drag_from(&mut harness, a + 0.5 * (b - a), a + 0.5 * (b - a) + Vec2::new(0.0, 30.0));
    assert!(moved(&harness).unwrap().offset[2] < before);
    let (a, b) = (middle(&harness, handle), middle(&harness, "Move in the picture's plane"));
    click(&mut harness, a + 0.5 * (b - a));
    assert!(harness.query_by_label("New node here").is_none());
    let out = middle(&harness, "Turn about the axis anterior") - middle(&harness, "Move in the picture's plane");
    let label = drag_handle(&mut harness, "Turn about the axis anterior", Modifiers::COMMAND, 0.6 * out.rot90());
    let turn = moved(&harness).unwrap().turn;
    assert!(
        label.starts_with("Turn Selection 1 ") && turn[1] != 0.0 && turn[0].abs() + turn[2].abs() < 1e-9,
        "{label}"
    );
    assert!((turn[1] / 15.0 - (turn[1] / 15.0).round()).abs() < 1e-9, "{turn:?}");
    drag_handle(&mut harness, "Scale about its middle", Modifiers::NONE, Vec2::new(30.0, -30.0));
    assert!(moved(&harness).unwrap().scale > 1.2);
    // By keys.
    let before = moved(&harness).unwrap().turn;
    harness.query_all_by_label("Turn about the axis anterior").last().unwrap().focus();
    harness.step();
    harness.key_press(Key::ArrowRight);
    harness.step();
    harness.step();
    assert!((moved(&harness).unwrap().turn[1] - before[1] - 5.0).abs() < 1e-6);
    settle(&mut harness);
    run(&mut harness, UiCommand::PutBack);
    assert!(moved(&harness).is_none() && figure(&harness) == first);
    assert_eq!(labels(&harness).last().unwrap(), "Put Selection 1 back");
    undo_all(&mut harness);
    assert!(figure(&harness).objects[0].regions.is_empty());
}

#[test]
fn where_structures_were_moved_to_is_typed_and_what_they_meet_is_painted() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    let at = row_of(&harness, "rib 2");
    click(&mut harness, at);
    click_with(&mut harness, Modifiers::COMMAND, "rib 3");
    // Lists scroll and unfold in their time.
    let steps = |harness: &mut Window| (0..40).for_each(|_| harness.step());
    let structure = |harness: &Window, name: &str| {
        figure(harness).objects[0].regions[0].own_move(Some(name)).cloned().unwrap_or_default()
    };
    let type_into = |harness: &mut Window, field: &str, text: &str| {
        let node = harness.query_all_by_label(field).last().unwrap_or_else(|| panic!("nothing is called {field}"));
        node.scroll_to_me();
        steps(harness);
        click_on(harness, field);
        enter(harness, text);
    };
    type_into(&mut harness, "Superior", "6 mm");
    let (a, b) = (structure(&harness, "rib 2"), structure(&harness, "rib 3"));
    assert!(a.offset[2] > 0.1 && a == b, "{a:?} {b:?}");
    assert_eq!(labels(&harness).last().unwrap(), "Move 2 structures to 6.0 mm superior");
    // Turned together, they stay beside each other: another offset for each.
    type_into(&mut harness, "Turn, superior", "90");
    let (a, b) = (structure(&harness, "rib 2"), structure(&harness, "rib 3"));
    assert!((a.turn[2] - 90.0).abs() < 1e-9 && (b.turn[2] - 90.0).abs() < 1e-9, "{a:?} {b:?}");
    assert!((a.offset[0] - b.offset[0]).abs() > 1e-3 && (a.offset[1] - b.offset[1]).abs() > 1e-3, "{a:?} {b:?}");
    assert!(figure(&harness).objects[0].regions[0].moved.is_none());
    type_into(&mut harness, "Scale", "0");
    assert_eq!(structure(&harness, "rib 2").scale, 0.01);
    run(&mut harness, UiCommand::Undo);
    // Its ghost and what it meets.
    type_into(&mut harness, "Ghost opacity", "40");
    assert_eq!(structure(&harness, "rib 3").ghost.opacity, Some(0.4));
    let press = |harness: &mut Window, name: &str| {
        harness.query_all_by_label(name).last().unwrap_or_else(|| panic!("nothing is called {name}")).scroll_to_me();
        steps(harness);
        click_on(harness, name);
        harness.step();
    };
    press(&mut harness, "Color where it meets its ghost");
    assert!(structure(&harness, "rib 2").meets_ghost.is_some() && structure(&harness, "rib 3").meets_ghost.is_some());
    press(&mut harness, "By the values that meet");
    let square = "Color where it meets its ghost: strength by values, mean in %";
    steps(&mut harness);
    harness.query_by_label(square).unwrap().scroll_to_me();
    steps(&mut harness);
    let (at, steps) = (middle(&harness, square), labels(&harness).len());
    drag_from(&mut harness, at, at + Vec2::new(20.0, 10.0));
    let cells = |harness: &Window| {
        let strength = structure(harness, "rib 2").meets_ghost.unwrap().strength;
        strength.map(|s| s.0.cells().iter().map(|c| u32::from(*c)).sum::<u32>())
    };
    let painted = cells(&harness).unwrap();
    assert!(painted > 0 && labels(&harness).len() == steps + 1, "{painted} {:?}", labels(&harness));
    let to = at + Vec2::new(8.0, 4.0);
    drag_between(&mut harness, PointerButton::Secondary, Modifiers::NONE, at, to, true);
    assert!(cells(&harness).unwrap() < painted);
    assert!(harness.unnamed_widgets().is_empty(), "{:?}", harness.unnamed_widgets());
    press(&mut harness, "Reset strength");
    assert!(cells(&harness).is_none());
    press(&mut harness, "Put back");
    let kept = structure(&harness, "rib 2");
    assert!(!kept.is_moved() && kept.ghost.opacity == Some(0.4) && kept.meets_ghost.is_some());
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    undo_all(&mut harness);
}

/// The region called so, with its place among the object's.
fn region_called(harness: &Window, name: &str) -> Option<(usize, RegionTemplate)> {
    let regions = figure(harness).objects[0].regions.clone();
    regions.into_iter().enumerate().find(|(_, region)| region.title() == name)
}

/// The largest ribs are listed first.
fn by_volume(harness: &mut Window) {
    click_on(harness, "Order in ribs");
    harness.step();
    click_on(harness, "By volume");
    harness.step();
}

/// The picture in the window, without the window around it.
fn picture_pixels(harness: &Window) -> Vec<u8> {
    editor(harness).picture_pixels().unwrap().0.to_vec()
}

#[test]
fn painting_on_a_structure_of_a_label_map_edits_a_copy_of_it() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    let before = figure(&harness).to_json().unwrap();
    let drawn = picture_pixels(&harness);
    let steps = labels(&harness).len();
    by_volume(&mut harness);
    click_on(&mut harness, "rib 8");
    assert!(editor(&harness).disabled(UiCommand::GrowSelection).is_none(), "the menu works on structures as well");
    harness.key_press(Key::B);
    harness.step();
    assert!(harness.query_all_by_label_contains("Target selection").next().is_some());
    let target =
        harness.query_by_value("rib 8 (a copy)").is_some() || harness.query_by_label("rib 8 (a copy)").is_some();
    assert!(target, "the bar says what is painted into");
    // Choosing alone changes nothing; nor does a stroke that is given up.
    assert_eq!(figure(&harness).to_json().unwrap(), before);
    drag(&mut harness, PointerButton::Primary, Vec2::new(30.0, 10.0), false);
    assert!(painted(&harness, "rib 8").is_some());
    harness.key_press(Key::Escape);
    harness.step();
    let up = Event::PointerButton {
        pos: MIDDLE + Vec2::new(30.0, 10.0),
        button: PointerButton::Primary,
        pressed: false,
        modifiers: Modifiers::NONE,
    };
    harness.event(up);
    settle(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), before);
    // One step: a copy with the same look, after its group, and the stroke.
    drag(&mut harness, PointerButton::Primary, Vec2::new(30.0, 10.0), true);
    settle(&mut harness);
    let (number, copy) = region_called(&harness, "rib 8").unwrap();
    assert!(number == 1 && matches!(copy.look.tint, Some(Tint::Color(_))) && copy.look.transfer_function.is_some());
    assert_eq!(labels(&harness).len(), steps + 1);
    assert!(labels(&harness)[steps].starts_with("Paint rib 8, "), "{:?}", labels(&harness));
    assert_ne!(picture_pixels(&harness), drawn);
    let one = painted(&harness, "rib 8").unwrap();
    // Further strokes go into it. It has one row, and its group one less.
    drag(&mut harness, PointerButton::Primary, Vec2::new(-40.0, 10.0), true);
    settle(&mut harness);
    assert!(painted(&harness, "rib 8").unwrap() > one && figure(&harness).selections.len() == 2);
    assert_eq!(harness.query_all_by_label("rib 8").count(), 2, "its row, and the name above its properties");
    assert!(harness.unnamed_widgets().is_empty());
    // What is written is read as it was.
    let text = figure(&harness).to_json().unwrap();
    assert_eq!(Template::parse(&text).unwrap(), figure(&harness));
    // Back to the file's own, to the last pixel; the structure is chosen again, and painted on again.
    run(&mut harness, UiCommand::Undo);
    run(&mut harness, UiCommand::Undo);
    settle(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), before);
    assert_eq!(picture_pixels(&harness), drawn);
    harness.step();
    drag(&mut harness, PointerButton::Primary, Vec2::new(30.0, 10.0), true);
    settle(&mut harness);
    assert_eq!(painted(&harness, "rib 8"), Some(one), "{:?}", labels(&harness));
    // Undone and done again, the copy is what is painted.
    run(&mut harness, UiCommand::Undo);
    harness.step();
    run(&mut harness, UiCommand::Redo);
    harness.step();
    drag(&mut harness, PointerButton::Primary, Vec2::new(-40.0, 10.0), true);
    settle(&mut harness);
    assert!(painted(&harness, "rib 8").unwrap() > one && figure(&harness).selections.len() == 2);
    // Without the copy the group is whole again.
    let pos = row_of(&harness, "rib 8");
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Secondary, Modifiers::NONE);
        harness.event(Event::PointerMoved(pos));
        harness.event(Event::PointerButton { pos, button, pressed, modifiers });
        harness.step();
    }
    harness.step();
    // In the menu, not in the panel below.
    let button =
        harness.query_all_by_label("Remove region").map(|node| node.rect()).find(|r| r.center().distance(pos) < 250.0);
    click(&mut harness, button.unwrap().center());
    settle(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), before);
    undo_all(&mut harness);
    assert_eq!(figure(&harness), Template::parse(BALL).unwrap());
}

#[test]
fn the_menu_edits_a_copy_of_a_structure_in_one_step() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    let (before, steps) = (figure(&harness).to_json().unwrap(), labels(&harness).len());
    by_volume(&mut harness);
    click_on(&mut harness, "rib 8");
    run(&mut harness, UiCommand::GrowSelection);
    settle(&mut harness);
    assert!(painted(&harness, "rib 8").is_some_and(|n| n > 0.0), "{}", editor(&harness).notice());
    assert_eq!(labels(&harness).len(), steps + 1);
    assert!(labels(&harness)[steps].starts_with("Grow rib 8 by "), "{:?}", labels(&harness));
    run(&mut harness, UiCommand::Undo);
    settle(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), before);
}

#[test]
fn loops_replace_take_away_and_intersect() {
    let place = Place::with_ball();
    let mut harness = opened(&place);
    let first = figure(&harness).to_json().unwrap();
    run(&mut harness, UiCommand::RectangleTool);
    let middle = harness.get_by_label_contains("Figure:").rect().center();
    let far = 150.0;
    let (left, right) = (middle - Vec2::splat(far), middle + Vec2::splat(far));
    let half = |harness: &mut Window, modifiers, from: Pos2, to: Pos2| {
        drag_between(harness, PointerButton::Primary, modifiers, from, to, true);
        settle(harness);
        painted(harness, "Selection 1").unwrap_or_else(|| panic!("{}", editor(harness).notice()))
    };
    let none = Modifiers::NONE;
    let whole = half(&mut harness, none, left, right);
    run(&mut harness, UiCommand::Undo);
    let a = half(&mut harness, none, left, Pos2::new(middle.x, right.y));
    // What lies above as well: a quarter. By the key's command, and by keys that are held as the rectangle is begun.
    for modifiers in [none, Modifiers::SHIFT | Modifiers::ALT] {
        let mode = if modifiers == none { UiCommand::IntersectMode } else { UiCommand::AddMode };
        run(&mut harness, mode);
        let quarter = half(&mut harness, modifiers, left, Pos2::new(right.x, middle.y));
        assert!((quarter - 0.5 * a).abs() < 0.1 * a, "{quarter} of {a}");
        let label = labels(&harness).pop().unwrap();
        assert!(label.starts_with("Rectangle within Selection 1, \u{2212}"), "{label}");
        run(&mut harness, UiCommand::Undo);
        harness.step();
    }
    // Krita's keys. What goes around nothing leaves the selection as it is.
    harness.key_press(Key::R);
    harness.step();
    let corner = middle + Vec2::new(-150.0, 150.0);
    assert_eq!(half(&mut harness, none, corner, corner + Vec2::new(9.0, -9.0)), a);
    let other = half(&mut harness, none, Pos2::new(middle.x, left.y), right);
    assert!((other - (whole - a)).abs() < 0.1 * whole, "{other} of {whole} without {a}");
    assert!(
        labels(&harness).pop().unwrap().starts_with("Rectangle in place of Selection 1, "),
        "{:?}",
        labels(&harness)
    );
    harness.key_press(Key::A);
    harness.step();
    let all = half(&mut harness, none, left, right);
    assert!((all - whole).abs() < 1.0, "{all} of {whole}");
    harness.key_press(Key::S);
    harness.step();
    let rest = half(&mut harness, none, left, Pos2::new(middle.x, right.y));
    assert!((rest - other).abs() < 0.1 * whole, "{rest}, {other}");
    // Where it takes away, Alt adds; Shift always does.
    for modifiers in [Modifiers::ALT, Modifiers::SHIFT] {
        let again = half(&mut harness, modifiers, left, right);
        assert!((again - whole).abs() < 1.0, "{again} of {whole}");
        run(&mut harness, UiCommand::Undo);
        harness.step();
    }
    assert!(harness.unnamed_widgets().is_empty(), "{:?}", harness.unnamed_widgets());
    undo_all(&mut harness);
    assert_eq!(figure(&harness).to_json().unwrap(), first);
}

#[test]
fn ranges_of_structures_are_chosen_as_in_every_list() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    let importance =
        |harness: &Window, rib: usize| figure(harness).objects[0].regions[0].importance_of(Some(&format!("rib {rib}")));
    let shift = Modifiers::SHIFT;
    click_on(&mut harness, "rib 2");
    // Shift: from there, and again from there. Ctrl: one more, from which ranges then go on; with both, as well.
    click_with(&mut harness, shift, "rib 5");
    click_with(&mut harness, shift, "rib 3");
    assert!(harness.query_by_label("2 structures").is_some());
    click_with(&mut harness, Modifiers::COMMAND, "rib 5");
    click_with(&mut harness, Modifiers::COMMAND | shift, "rib 6");
    assert!(harness.query_by_label("4 structures").is_some());
    // All of them get what is typed, in one step.
    let before = labels(&harness).len();
    click_on(&mut harness, "Importance");
    let field = harness.query_all_by_label("Importance").map(|node| node.rect()).next_back().unwrap();
    drag_from(&mut harness, field.left_center() + Vec2::new(4.0, 0.0), field.right_center() - Vec2::new(2.0, 0.0));
    assert_eq!(
        [1, 2, 3, 4, 5, 6, 7].map(|rib| importance(&harness, rib) > 1.0),
        [false, true, true, false, true, true, false]
    );
    let said = labels(&harness).pop().unwrap();
    assert!(said.starts_with("Set importance of 4 structures to "), "{said}");
    assert!(labels(&harness).len() <= before + 2, "{:?}", labels(&harness));
    // The list tells, and is sorted by it.
    click_on(&mut harness, "Order in ribs");
    harness.step();
    click_on(&mut harness, "By importance");
    harness.step();
    let rows = [2, 3, 5, 6, 4].map(|rib| row_of(&harness, &format!("rib {rib}")).y);
    assert!(rows.is_sorted(), "{rows:?}");
    // With Shift, arrows go on as well; Ctrl+A takes all.
    click_on(&mut harness, "rib 2");
    harness.key_press_modifiers(shift, Key::ArrowDown);
    harness.step();
    harness.step();
    assert!(harness.query_by_label("2 structures").is_some());
    harness.key_press_modifiers(shift, Key::ArrowDown);
    harness.step();
    harness.step();
    assert!(harness.query_by_label("3 structures").is_some());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.step();
    harness.step();
    let count = editor(&harness).document().unwrap().figure().objects[0].regions.len();
    assert!(count == 1 && harness.query_all_by_label_contains(" structures").next().is_some());
    assert!(harness.unnamed_widgets().is_empty(), "{:?}", harness.unnamed_widgets());
    undo_all(&mut harness);
    assert_eq!(figure(&harness), Template::parse(BALL).unwrap());
}

#[test]
fn a_missing_label_map_is_asked_for() {
    let place = Place::with_ball();
    let there = ribs(&place);
    let with_ribs = BALL.replace(
        "\"objects\": [{",
        "\"selections\": [{\"name\": \"ribs\", \"volume\": \"ball\", \
        \"file\": \"nowhere.seg.nrrd\"}], \"objects\": [{ \"regions\": [{\"selection\": \"ribs\"}], ",
    );
    std::fs::write(place.path("figure.json"), with_ribs).unwrap();
    let mut harness = harness(Some(place.path("figure.json")));
    settle(&mut harness);
    assert!(harness.query_all_by_label_contains("nowhere.seg.nrrd").next().is_some());
    assert!(harness.unnamed_widgets().is_empty());
    let before = figure(&harness).to_json().unwrap();
    click_on(&mut harness, "Choose a file…");
    enter(&mut harness, &there.display().to_string());
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    assert!(figure(&harness).selections[0].file.as_ref().unwrap().ends_with("ribs.seg.nrrd"));
    assert_eq!(labels(&harness), ["Use ribs.seg.nrrd"]);
    assert!(harness.query_all_by_label("rib 2").next().is_some() && harness.query_by_label("Choose a file…").is_none());
    // Undo asks again, until one wants to hear no more of it.
    run(&mut harness, UiCommand::Undo);
    settle(&mut harness);
    harness.step();
    assert_eq!(figure(&harness).to_json().unwrap(), before);
    click_on(&mut harness, "Not now");
    assert!(harness.query_by_label("Choose a file…").is_none());
}

/// The second coordinate of the object's transfer function, if it has one.
fn across(harness: &Window) -> Option<AcrossTemplate> {
    figure(harness).objects[0].transfer_function.across.clone()
}

#[test]
fn a_function_goes_by_a_second_coordinate_whose_rows_are_edited_on_a_map() {
    let place = Place::with_ball();
    let mut harness = opened_with_ribs(&place);
    let title = figure(&harness).objects[0].title().to_owned();
    click_on(&mut harness, &title);
    let one = figure(&harness);
    assert!(across(&harness).is_none() && harness.query_by_label("Map of the transfer function").is_none());
    click_on(&mut harness, "Second coordinate");
    click_on(&mut harness, "value × edge strength");
    settle(&mut harness);
    let (own, rows) = (&one.objects[0].transfer_function.nodes, across(&harness).unwrap().rows);
    assert!(rows.len() == 1 && rows[0].nodes == *own, "rows begin alike: {rows:?}");
    assert!(harness.query_by_label("Map of the transfer function").is_some());
    assert!(harness.unnamed_widgets().is_empty(), "widgets without a name");
    // A row follows the hand, in one step.
    let before = labels(&harness).len();
    let map = harness.get_by_label("Map of the transfer function").rect();
    let from = Pos2::new(map.left() + 4.0, middle(&harness, "Row 2 at 0.5").y);
    drag_from(&mut harness, from, from - Vec2::new(0.0, 0.25 * map.height()));
    let at = across(&harness).unwrap().rows[0].at;
    assert!((at - 0.75).abs() < 0.08 && labels(&harness).len() == before + 1, "{at}");
    // What is chosen is edited: the row's own nodes, on its curve.
    click_on(&mut harness, "Node 4 at 180");
    click_on(&mut harness, "Node opacity");
    enter(&mut harness, "35");
    let function = figure(&harness).objects[0].transfer_function.clone();
    assert!(function.nodes_of(1)[3].opacity == 0.35 && function.nodes == *own, "{function:?}");
    // A node is dragged along its row.
    let node = middle(&harness, "Row 1, node 1 at 20");
    drag_from(&mut harness, node, node + Vec2::new(20.0, 0.0));
    let moved = figure(&harness).objects[0].transfer_function.clone();
    assert!(moved.nodes[0].at > 21.0 && moved.nodes_of(1) == function.nodes_of(1), "{moved:?}");
    click_on(&mut harness, "Add row");
    assert_eq!(across(&harness).unwrap().rows.len(), 2);
    click_on(&mut harness, "Row place");
    enter(&mut harness, "0.3");
    assert_eq!(across(&harness).unwrap().rows[0].at, 0.3);
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    click_on(&mut harness, "Remove row");
    assert_eq!(across(&harness).unwrap().rows.len(), 1);
    // Another coordinate keeps the rows; what distances are measured from is a region.
    click_on(&mut harness, "Second coordinate");
    click_on(&mut harness, "value × distance");
    let (by, region) = (across(&harness).unwrap(), figure(&harness).objects[0].regions[0].title().to_owned());
    assert_eq!((by.by, by.from.as_deref(), by.rows.len()), (AxisName::Distance, Some(&*region), 1));
    settle(&mut harness);
    assert_eq!(editor(&harness).banner(), None);
    click_on(&mut harness, "Second coordinate");
    click_on(&mut harness, "value alone");
    assert!(across(&harness).is_none());
    for _ in before - 1..labels(&harness).len() {
        run(&mut harness, UiCommand::Undo);
    }
    assert_eq!(figure(&harness).objects[0].transfer_function, one.objects[0].transfer_function);
    settle(&mut harness);
}
