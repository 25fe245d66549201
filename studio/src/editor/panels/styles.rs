//! The gallery: every style as a sphere, to be dragged onto a node, a material or the picture itself.

use eframe::egui::{self, Align2, FontId, Id, LayerId, Order, Pos2, Role, ScrollArea, Sense, Ui, Vec2, WidgetInfo};

use super::super::gallery::{DraggedStyle, Gallery};
use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::super::ui_command::UiCommand;
use super::curve::dress_material;
use super::regions::dress;

/// A cell: a sphere with its name below.
const CELL: Vec2 = Vec2::new(66.0, 62.0);
const SPHERE: f32 = 19.0;
/// The second group.
const ALL: &str = "All styles";

/// A style that was just made, until another one is taken.
#[derive(Clone, Debug, Default)]
pub struct Fresh {
    /// Its name; none: there is no such style.
    pub name: String,
    /// Whether it was brought into view.
    pub is_shown: bool,
}

/// The panel. `search` is what is typed into its field. Whether a style shall be made of a picture.
pub fn show(ui: &mut Ui, open: &mut OpenFigure, gallery: &Gallery, search: &mut String, fresh: &mut Fresh) -> bool {
    let mut wanted_new = false;
    ui.horizontal(|ui| {
        ui.label(theme::heading("Styles"));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let command = UiCommand::StyleFromPicture;
            wanted_new = ui.button("From picture…").on_hover_text(command.tooltip()).clicked();
            let field = theme::text_field(search).hint_text("Find a style").desired_width(f32::INFINITY);
            ui.add(field).accessible_name("Find a style");
        });
    });
    let wanted = search.to_lowercase();
    let mut used: Vec<String> = Vec::new();
    for node in open.function().into_iter().flat_map(|function| function.nodes) {
        if !used.contains(&node.style) {
            used.push(node.style.clone());
        }
    }
    let library = gallery.library().clone();
    let found = |name: &str| {
        if wanted.is_empty() {
            return Some(());
        }
        let info = library.info(name).ok()?;
        let words = format!("{} {} {}", info.title, info.tags.join(" "), info.description).to_lowercase();
        wanted.split_whitespace().all(|w| words.contains(w)).then_some(())
    };
    let mut cells = Vec::new();
    ScrollArea::vertical().id_salt("gallery").auto_shrink(false).show(ui, |ui| {
        let groups = [
            ("In this figure", used.iter().map(String::as_str).filter(|n| found(n).is_some()).collect::<Vec<_>>()),
            (ALL, library.infos().map(|i| i.name.as_str()).filter(|n| found(n).is_some()).collect()),
        ];
        for (title, names) in groups.into_iter().filter(|(_, names)| !names.is_empty()) {
            ui.label(theme::small(ui.ctx(), title));
            let columns = ((ui.available_width() / CELL.x) as usize).max(1);
            for row in names.chunks(columns) {
                ui.horizontal(|ui| {
                    ui.spacing_mut().item_spacing.x = 0.0;
                    for name in row {
                        let response = cell(ui, open, gallery, title, name, fresh.name == *name);
                        if fresh.name == *name && !fresh.is_shown && title == ALL {
                            response.scroll_to_me(Some(egui::Align::Center));
                            fresh.is_shown = true;
                        }
                        if response.clicked() || response.drag_started() {
                            *fresh = Fresh::default();
                        }
                        cells.push((response, (*name).to_owned()));
                    }
                });
            }
        }
        if wanted.is_empty() {
            return;
        }
        if library.infos().all(|i| found(&i.name).is_none()) {
            ui.label(theme::small(ui.ctx(), "No style has these words."));
        }
    });
    // Of a press and a move in one frame, egui takes the press to be where the move ended.
    if cells.iter().any(|(response, _)| response.drag_started())
        && let Some(pressed) = ui.input(|i| i.pointer.press_origin())
        && let Some((_, name)) = cells.iter().find(|(response, _)| response.rect.contains(pressed))
    {
        egui::DragAndDrop::set_payload(ui.ctx(), DraggedStyle(name.clone()));
    }
    // What is carried goes along, from wherever it comes.
    if let Some(style) = egui::DragAndDrop::payload::<DraggedStyle>(ui.ctx())
        && let Some(pointer) = ui.input(|i| i.pointer.latest_pos())
    {
        let painter = ui.ctx().layer_painter(LayerId::new(Order::Tooltip, Id::unique("dragged style")));
        gallery.paint(&painter, pointer + Vec2::splat(10.0), SPHERE, &style.0);
    }
    wanted_new
}

fn cell(
    ui: &mut Ui,
    open: &mut OpenFigure,
    gallery: &Gallery,
    group: &str,
    name: &str,
    is_fresh: bool,
) -> egui::Response {
    let (rect, _) = ui.allocate_exact_size(CELL, Sense::hover());
    let response = ui.interact(rect, Id::unique(("style", group, name)), Sense::click_and_drag());
    let title = gallery.title(name).to_owned();
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Style {title}")));
    if response.clicked() {
        match (open.node, open.chosen_region().cloned()) {
            (Some(node), _) => dress_material(open, open.function_of(), node, name),
            (None, Some(part)) => dress(open, open.object, &part, name),
            (None, None) => {}
        }
    }
    let tokens = theme::tokens(ui.ctx());
    let center = Pos2::new(rect.center().x, rect.top() + SPHERE + 3.0);
    gallery.paint(ui.painter(), center, SPHERE, name);
    if response.hovered() || is_fresh {
        ui.painter().circle_stroke(center, SPHERE + 1.5, egui::Stroke::new(2.0, tokens.accent));
    }
    let font = FontId::proportional(11.0);
    let text = short(&title, 11);
    ui.painter().text(Pos2::new(center.x, rect.bottom() - 4.0), Align2::CENTER_BOTTOM, text, font, tokens.dim);
    if !response.dragged() {
        let mut described = gallery.library().info(name).map_or(String::new(), |i| i.description.clone());
        if gallery.drawn(name) != name {
            described += &format!(" The theme draws it as {}.", gallery.title(gallery.drawn(name)));
        }
        let how = match (open.node, open.chosen_region()) {
            (Some(_), _) => "Click dresses the chosen material; or drag it",
            (None, Some(_)) => "Click dresses the chosen region; or drag it",
            (None, None) => "Drag it",
        };
        return response
            .on_hover_text(format!("{title}. {described}\n{how} onto a node, a sphere, a region or the picture."));
    }
    response
}

fn short(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).chain(['…']).collect()
}
