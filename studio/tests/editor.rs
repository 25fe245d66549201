//! The window without a window: the whole editor under egui_kittest, found by its accessible names and driven by keys and
//! pointer as a user would; figures are drawn by the software adapter.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use fabrica_engine::gpu::AdapterChoice;
use fabrica_studio::editor::{Editor, Options, UiCommand};
use fabrica_studio::figure::Template;

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

fn harness(file: Option<PathBuf>) -> Harness<'static, Option<Editor>> {
    let app = move |ui: &mut eframe::egui::Ui, state: &mut Option<Editor>| {
        let ctx = ui.ctx().clone();
        let editor = state.get_or_insert_with(|| {
            let files = file.iter().cloned().collect();
            Editor::new(&ctx, Options { files, ..Options::plain(AdapterChoice::Software) })
        });
        editor.ui(ui);
    };
    Harness::builder().with_size(Vec2::new(1000.0, 700.0)).build_ui_state(app, None)
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
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.event(Event::Text(target.display().to_string()));
    harness.step();
    harness.key_press(Key::Enter);
    harness.step();
    harness.step();
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
