//! The window on a figure: how it is edited. Everything but `open_window` runs without a window too, in tests.

pub mod app;
pub mod autosave;
pub mod dialogs;
pub mod file_dialog;
pub mod files;
pub mod filter_preview;
pub mod find_file;
pub mod gallery;
mod gizmo;
mod movable;
pub mod open_figure;
pub mod painter;
pub mod panels;
pub mod recovery;
pub mod session;
pub mod slices;
mod style_from_picture;
pub mod theme;
pub mod timings;
pub mod tools;
pub mod ui_command;
pub mod view;
pub mod viewport;
pub mod volume_choice;
pub mod wording;

use anyhow::{Result, anyhow};
use eframe::egui::{Vec2, ViewportBuilder};

pub use app::{Editor, Options};
pub use ui_command::UiCommand;

/// Opens the window and stays until it is closed.
///
/// # Errors
/// One sentence where there is no display or no adapter for the window.
pub fn open_window(options: Options) -> Result<()> {
    let native = eframe::NativeOptions {
        viewport: ViewportBuilder::default()
            .with_title("Fabrica")
            .with_app_id("fabrica")
            .with_inner_size(Vec2::new(1280.0, 800.0))
            .with_min_inner_size(Vec2::new(720.0, 480.0)),
        ..Default::default()
    };
    eframe::run_native("Fabrica", native, Box::new(move |cc| Ok(Box::new(Editor::new(&cc.egui_ctx, options)))))
        .map_err(|e| anyhow!("the window cannot be opened ({e}); without a display, use `fabrica render`"))
}
