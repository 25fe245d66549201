//! The steps that led here, to go back to any of them.

use eframe::egui::{ScrollArea, Ui};

use super::super::open_figure::OpenFigure;
use super::super::theme;

/// The panel.
pub fn show(ui: &mut Ui, open: &mut OpenFigure) {
    ui.label(theme::heading("History"));
    let past: Vec<String> = open.document.labels().map(str::to_owned).collect();
    let future: Vec<String> = open.document.undone_labels().map(str::to_owned).collect();
    // How many steps forward (negative: back) the click asks for.
    let mut by = 0isize;
    ScrollArea::vertical().id_salt("history").max_height(180.0).auto_shrink([false, true]).stick_to_bottom(true).show(
        ui,
        |ui| {
            if ui.selectable_label(past.is_empty(), "As it was opened").clicked() {
                by = -(past.len() as isize);
            }
            for (i, label) in past.iter().enumerate() {
                if ui.selectable_label(i + 1 == past.len(), label).clicked() {
                    by = i as isize + 1 - past.len() as isize;
                }
            }
            for (i, label) in future.iter().enumerate() {
                let text = theme::small(ui.ctx(), label);
                if ui.selectable_label(false, text).on_hover_text("Undone; click to bring it again").clicked() {
                    by = i as isize + 1;
                }
            }
        },
    );
    for _ in 0..by.unsigned_abs() {
        let _ = if by < 0 { open.document.undo() } else { open.document.redo() };
    }
}
