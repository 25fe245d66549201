//! The window on a figure: how it is edited. Everything but `open_window` runs without a window too, in tests.

pub mod app;
pub mod files;
pub mod painter;
pub mod theme;
pub mod ui_command;
pub mod view;

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use eframe::egui::{Vec2, ViewportBuilder};
use fabrica_engine::gpu::AdapterChoice;

pub use app::Editor;
pub use ui_command::UiCommand;

/// Opens the window and stays until it is closed.
///
/// # Errors
/// One sentence where there is no display or no adapter for the window.
pub fn open_window(file: Option<PathBuf>, adapter: AdapterChoice) -> Result<()> {
    let options = eframe::NativeOptions {
        viewport: ViewportBuilder::default()
            .with_title("Fabrica")
            .with_app_id("fabrica")
            .with_inner_size(Vec2::new(1280.0, 800.0)),
        ..Default::default()
    };
    eframe::run_native("Fabrica", options, Box::new(move |cc| Ok(Box::new(Editor::new(&cc.egui_ctx, adapter, file)))))
        .map_err(|e| anyhow!("the window cannot be opened ({e}); without a display, use `fabrica render`"))
}
