//! Where the window's widgets are: the same editor at the same size under egui_kittest, which knows them by their names.

use std::path::Path;
use std::time::{Duration, Instant};

use eframe::egui::{Ui, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use fabrica_engine::gpu::AdapterChoice;
use fabrica_studio::editor::{Editor, Options, UiCommand};

use crate::display::{Place, SIZE};
use crate::picture::Region;

/// The window's twin. What is done to the window must be done to it as well where it changes the layout.
pub struct Layout {
    harness: Harness<'static, Option<Editor>>,
}

impl Layout {
    /// The layout once a figure is open.
    pub fn of(file: &Path) -> Self {
        let file = file.to_owned();
        let app = move |ui: &mut Ui, state: &mut Option<Editor>| {
            let ctx = ui.ctx().clone();
            let editor = state.get_or_insert_with(|| {
                let files = vec![file.clone()];
                Editor::new(&ctx, Options { files, ..Options::plain(AdapterChoice::Software) })
            });
            editor.ui(ui);
        };
        let size = Vec2::from(SIZE.map(f32::from));
        let mut layout = Self { harness: Harness::builder().with_size(size).build_ui_state(app, None) };
        let start = Instant::now();
        while layout.harness.state().as_ref().is_none_or(|editor| editor.document().is_none()) {
            assert!(start.elapsed() < Duration::from_secs(60), "the window's twin does not open the figure");
            std::thread::sleep(Duration::from_millis(5));
            layout.harness.step();
        }
        layout.settle();
        layout
    }

    /// Runs a command, as the menu would.
    pub fn run(&mut self, command: UiCommand) {
        let ctx = self.harness.ctx.clone();
        self.harness.state_mut().as_mut().unwrap().run(&ctx, command);
        self.settle();
    }

    /// The rectangle of the one widget of this name, or whose name has this in it.
    pub fn region(&self, label: &str) -> Region {
        let mut found: Vec<_> = self.harness.query_all_by_label(label).collect();
        if found.is_empty() {
            found = self.harness.query_all_by_label_contains(label).collect();
        }
        assert_eq!(found.len(), 1, "widgets named \"{label}\"");
        let rect = found[0].rect();
        let [left, top, width, height] =
            [rect.left(), rect.top(), rect.width(), rect.height()].map(|n| n.round() as usize);
        Region { left, top, width, height }
    }

    /// The middle of the one widget of this name, or whose name has this in it: where to click.
    pub fn middle(&self, label: &str) -> Place {
        self.region(label).middle()
    }

    /// Menus and dialogs find their place in the frame after the one in which they open.
    fn settle(&mut self) {
        for _ in 0..4 {
            self.harness.step();
        }
    }
}
