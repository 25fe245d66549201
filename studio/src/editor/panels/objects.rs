//! The list of objects: what is drawn, under which name. This version has one of them.

use eframe::egui::{self, Key, Role, Sense, Ui, Vec2, WidgetInfo};

use super::super::gallery::Gallery;
use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::regions;
use crate::figure::Command;

/// The panel. `renaming` is the object whose name is typed, with what is typed so far.
pub fn show(ui: &mut Ui, open: &mut OpenFigure, gallery: &Gallery, renaming: &mut Option<(usize, String)>) {
    ui.label(theme::heading("Objects"));
    // The properties below want their place, too.
    let height = (0.58 * ui.available_height()).max(160.0);
    let area = egui::ScrollArea::vertical().id_salt("objects").max_height(height);
    area.show(ui, |ui| rows(ui, open, gallery, renaming, (height - LIST_SURROUNDINGS).max(90.0)));
    open.reveals_region = false;
}

/// What is above and below a list of structures: its object, its group, its search and the rest.
const LIST_SURROUNDINGS: f32 = 170.0;

fn rows(
    ui: &mut Ui,
    open: &mut OpenFigure,
    gallery: &Gallery,
    renaming: &mut Option<(usize, String)>,
    list_height: f32,
) {
    let objects = open.document.figure().objects.clone();
    for (i, object) in objects.iter().enumerate() {
        let tokens = theme::tokens(ui.ctx());
        let fill = if i == open.object && open.chosen_region().is_none() { tokens.selected } else { tokens.panel };
        egui::Frame::new().fill(fill).corner_radius(4).inner_margin(4).show(ui, |ui| {
            ui.horizontal(|ui| {
                let label = if object.visible { "Hide object" } else { "Show object" };
                if draw_eye(ui, label, object.visible) {
                    open.edit(Command::SetVisible { object: i, visible: !object.visible });
                }
                // The first that hides what is behind it: later ones are rarely more than spots.
                let nodes = &object.transfer_function.nodes;
                let style = nodes.iter().find(|n| n.opacity > 0.5).or(nodes.first());
                let style = style.map_or("clay", |n| n.style.as_str());
                let (rect, _) = ui.allocate_exact_size(Vec2::splat(22.0), Sense::hover());
                gallery.paint(ui.painter(), rect.center(), 10.0, style);
                name(ui, open, i, object.title(), object.visible, renaming);
            });
        });
        regions::list(ui, open, i, list_height);
    }
}

/// An eye, open or closed, called `label`; whether it was clicked.
pub(super) fn draw_eye(ui: &mut Ui, label: &str, visible: bool) -> bool {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(24.0), Sense::click());
    response.widget_info(|| WidgetInfo::selected(Role::CheckBox, true, visible, label));
    let tokens = theme::tokens(ui.ctx());
    let color = if visible { tokens.text } else { tokens.dim };
    let stroke = egui::Stroke::new(1.5, color);
    let painter = ui.painter();
    // An eye: two arcs and a pupil; struck through where it is closed.
    let c = rect.center();
    let arc = |sign: f32| {
        let points: Vec<_> = (0..=12)
            .map(|i| i as f32 / 6.0 - 1.0)
            .map(|t| c + Vec2::new(8.0 * t, sign * 5.0 * (1.0 - t * t)))
            .collect();
        egui::epaint::PathShape::line(points, stroke)
    };
    painter.add(arc(1.0));
    painter.add(arc(-1.0));
    if visible {
        painter.circle_filled(c, 2.5, color);
    } else {
        painter.line_segment([c + Vec2::new(-7.0, 6.0), c + Vec2::new(7.0, -6.0)], stroke);
    }
    response.on_hover_text(label).clicked()
}

fn name(
    ui: &mut Ui,
    open: &mut OpenFigure,
    object: usize,
    title: &str,
    visible: bool,
    renaming: &mut Option<(usize, String)>,
) {
    if let Some((_, text)) = renaming.as_mut().filter(|(which, _)| *which == object) {
        let field = ui.add(theme::text_field(text).desired_width(f32::INFINITY)).accessible_name("Object name");
        if !field.has_focus() && !field.lost_focus() {
            field.request_focus();
        }
        if ui.input(|i| i.key_pressed(Key::Escape)) {
            *renaming = None;
        } else if field.lost_focus() {
            let name = text.trim().to_owned();
            *renaming = None;
            open.edit(Command::SetName { object, name });
        }
        return;
    }
    let text = egui::RichText::new(title);
    let text = if visible { text } else { text.color(theme::tokens(ui.ctx()).dim) };
    let width = ui.available_width();
    let label = egui::Button::new(text).frame(false).right_text("").min_size(Vec2::new(width, 22.0)).truncate();
    let response = ui.add(label).accessible_name(title).on_hover_text("Double-click or F2: rename");
    if response.clicked() {
        open.choose(object, None);
    }
    if response.double_clicked() {
        *renaming = Some((object, title.to_owned()));
    }
}
