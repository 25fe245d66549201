//! The window itself, on a display of its own, with a real mouse and keyboard as far as it can tell: what the tests without a
//! window leave out is the way from the server to the editor and back to the screen. Pictures of it are kept for people in
//! the folder that `cargo test -p fabrica-studio --test window -- --nocapture` names.
//!
//! Nothing waits for a time: everything is done when it is seen, in the window or on the disk.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod desk;
mod display;
mod layout;
mod picture;

use std::path::{Path, PathBuf};

use fabrica_studio::editor::{UiCommand, view};
use fabrica_studio::figure::Template;
use fabrica_studio::figure::template::QualityName;
use glam::DVec3;

use desk::{BACKGROUND, Desk};
use display::{Button, Place, key};
use layout::Layout;

/// A figure of a ball with a nose, which looks different from everywhere.
const FIGURE: &str = r##"{
  "fabrica": 1,
  "volumes": [{"name": "v", "file": "ball.raw", "raw": "32x32x32xuint8"}],
  "objects": [{"volume": "v", "transfer_function": {"domain": "data", "nodes": [
    {"at": 50, "style": "clay", "opacity": 0.0}, {"at": 100, "style": "clay", "opacity": 0.95}]}}],
  "camera": {"from": [0.0, 1.0, 0.0], "height": 2.0},
  "quality": "standard",
  "background": "#BACKGROUND",
  "figure": {"width_mm": 30.0, "height_mm": 20.0, "dpi": 100.0},
  "kept": "what this version does not know"
}"##;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [red, green, blue] = BACKGROUND;
        let figure = FIGURE.replace("BACKGROUND", &format!("{red:02x}{green:02x}{blue:02x}"));
        std::fs::write(folder.path().join("figure.json"), figure).unwrap();
        std::fs::write(folder.path().join("ball.raw"), ball_with_nose()).unwrap();
        Self(folder)
    }

    fn figure(&self) -> PathBuf {
        self.0.path().join("figure.json")
    }

    /// Another figure beside it, on the same volume.
    fn write(&self, name: &str, figure: &Template) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, figure.to_json().unwrap()).unwrap();
        path
    }
}

/// Pixels to the right and down.
const DRAG: Place = [180, 60];
/// What must at least arrive of a drag.
const LEAST_SHARE: f64 = 0.98;

/// How much of the drag the camera has followed, checked to have been on its way.
fn share_turned(before: &Template, after: &Template, height: usize) -> f64 {
    let [dx, dy] = DRAG.map(|n| f64::from(n) / height as f64);
    let after = DVec3::from_array(after.camera.from);
    let astray = |share: f64| {
        let meant = DVec3::from_array(view::orbit(&before.camera, share * dx, share * dy).from);
        after.angle_between(meant).to_degrees()
    };
    let shares = (0..=100).map(|i| f64::from(i) / 100.0);
    let share = shares.min_by(|a, b| astray(*a).total_cmp(&astray(*b))).unwrap();
    assert!(astray(share) < 3.0, "{after} is {}° beside the way", astray(share));
    share
}

fn ball_with_nose() -> Vec<u8> {
    let inside = |at: [f32; 3], middle: [f32; 3], radius: f32| {
        radius - at.iter().zip(middle).map(|(a, m)| (a - m).powi(2)).sum::<f32>().sqrt()
    };
    let voxel = |i: usize| {
        let at = [i % 32, i / 32 % 32, i / 1024].map(|n| n as f32);
        let depth = inside(at, [15.5, 15.5, 15.5], 11.0).max(inside(at, [19.0, 25.0, 19.0], 5.0));
        (100.0 + 60.0 * depth).clamp(0.0, 200.0) as u8
    };
    (0..32 * 32 * 32).map(voxel).collect()
}

fn read(figure: &Path) -> Template {
    Template::read(figure).unwrap()
}

/// Presses Ctrl and a key.
fn command(desk: &Desk, letter: char) {
    desk.display.keys(&[key::CONTROL], letter.into());
}

/// Saves, and waits until the file is as it should be.
fn save_until(desk: &mut Desk, figure: &Path, what: &str, mut is_right: impl FnMut(&Template) -> bool) -> Template {
    command(desk, 's');
    desk.until(what, |_| {
        let saved = read(figure);
        if is_right(&saved) { Ok(saved) } else { Err(format!("the file has {:?}", saved.camera)) }
    })
}

fn offset([x, y]: Place, by: Place) -> Place {
    [x + by[0], y + by[1]]
}

#[test]
fn a_figure_is_turned_saved_and_opened_again() {
    let folder = Folder::new();
    let mut desk = Desk::new("turned");
    let figure = folder.figure();
    let original = read(&figure);
    desk.open(&figure);
    desk.keep("first-picture");
    let first = desk.until_drawn(&figure);
    desk.keep_still("opened");

    // The figure is inside of what its twin calls the figure.
    let region = Layout::of(&figure).region("Figure: ");
    let frame = desk.frame().unwrap();
    assert!(frame.is_in(region), "{frame:?} is not in {region:?}");

    let middle = region.middle();
    desk.drag(Button::Left, middle, offset(middle, DRAG));
    desk.keep("while-turned");
    let turned = save_until(&mut desk, &figure, "the turned figure on the disk", |saved| *saved != original);
    let mut expected = original.clone();
    expected.camera.from = turned.camera.from;
    assert_eq!(turned, expected, "the eye's direction is all that a drag changes");
    let share = share_turned(&original, &turned, frame.height);
    assert!(share > LEAST_SHARE, "{share} of the drag has turned the figure");
    let seen = desk.until_drawn(&figure);
    desk.keep_still("turned");
    assert!(seen.difference(&first).is_some());

    // One drag is one step, back and forth.
    command(&desk, 'z');
    desk.until_shown("the figure before the drag", &first);
    save_until(&mut desk, &figure, "the figure of before on the disk", |saved| *saved == original);
    desk.display.keys(&[key::CONTROL, key::SHIFT], 'z'.into());
    desk.until_shown("the turned figure again", &seen);
    save_until(&mut desk, &figure, "the turned figure on the disk again", |saved| *saved == turned);

    // A style is carried from the gallery to the material's sphere.
    let twin = Layout::of(&figure);
    desk.carry(twin.middle("Style Porcelain"), twin.middle("Material 1: Clay"));
    let mut expected = turned.clone();
    for node in &mut expected.objects[0].transfer_function.nodes {
        node.style = "porcelain".to_owned();
    }
    let seen = desk.until_drawn(&folder.write("dressed.json", &expected));
    desk.keep_still("dressed");
    let dressed = save_until(&mut desk, &figure, "the dressed figure on the disk", |saved| *saved == expected);

    command(&desk, 'q');
    assert_eq!(desk.exit_code(), Some(0));
    desk.open(&figure);
    desk.until_shown("the saved figure in a new window", &seen);
    desk.keep_still("opened-again");
    command(&desk, 'q');
    assert_eq!(desk.exit_code(), Some(0));
    assert_eq!(read(&figure), dressed, "looking changes nothing");
}

#[test]
fn closing_with_changes_asks_and_cancel_stays() {
    let folder = Folder::new();
    let mut desk = Desk::new("asked");
    let figure = folder.write("draft.json", &Template { quality: QualityName::Draft, ..read(&folder.figure()) });
    let original = std::fs::read(&figure).unwrap();
    let window = desk.open(&figure);
    desk.until_drawn(&figure);

    // A change without the mouse: a command by its name.
    let before = desk.keep_still("opened");
    let frame = desk.frame().unwrap();
    command(&desk, 'k');
    desk.until_changed("the palette", frame, &before);
    desk.keep_still("palette");
    desk.display.type_text("left si");
    desk.keep_still("typed");
    desk.display.keys(&[], key::ENTER);
    let mut left = read(&figure);
    left.camera.from = [-1.0, 0.0, 0.0];
    let left = desk.until_drawn(&folder.write("left.json", &left));

    let before = desk.keep_still("from-the-left");
    desk.display.ask_to_close(window);
    desk.until_changed("the question", frame, &before);
    desk.keep_still("question");
    let mut twin = Layout::of(&figure);
    twin.run(UiCommand::FromLeft);
    twin.run(UiCommand::Quit);
    desk.display.click(twin.middle("Cancel"));
    desk.until_shown("the figure as before the question", &left);
    assert!(desk.is_running() && desk.display.window() == Some(window));

    // The wheel still does what it does, and the question comes again.
    desk.display.move_to(frame.middle());
    desk.display.wheel(2);
    desk.until("the wheel to bring the figure closer", |desk| {
        desk.picture()?.difference(&left).map(|_| ()).ok_or_else(|| "nothing has changed".to_owned())
    });
    desk.keep("closer");
    command(&desk, 'q');
    desk.until("the question again", |desk| {
        if desk.frame().is_err() { Ok(()) } else { Err("the figure is not behind a question".to_owned()) }
    });
    desk.keep_still("question-again");
    desk.display.click(twin.middle("Do not save"));
    assert_eq!(desk.exit_code(), Some(0));
    assert_eq!(std::fs::read(&figure).unwrap(), original, "nothing was written");
}
