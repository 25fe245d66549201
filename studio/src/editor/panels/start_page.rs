//! What there is before a figure is open: places to begin, what was open last, what a crash left behind.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use eframe::egui::{
    self, Align2, Color32, ColorImage, Context, FontId, Pos2, Rect, Role, ScrollArea, Sense, Stroke, StrokeKind,
    TextureHandle, TextureOptions, Ui, Vec2, WidgetInfo,
};
use fabrica_engine::image_out::{Picture, decode_png, read_png};

use super::super::gallery::straight;
use super::super::recovery::Orphan;
use super::super::session::Recent;
use super::super::theme;
use super::super::ui_command::UiCommand;
use crate::figure::shipped::{SHIPPED, titles};

/// What was chosen.
#[derive(Clone, Debug, PartialEq)]
pub enum Choice {
    /// A command.
    Run(UiCommand),
    /// A file, or a specimen.
    Open(PathBuf),
    /// A figure that comes with the program, by its place among [`SHIPPED`].
    Shipped(usize),
    /// Takes a recent figure off the list.
    Forget(PathBuf),
    /// Opens what a crash left behind, by its place in the list.
    Restore(usize),
    /// Throws it away.
    Discard(usize),
}

/// Pictures by the name of their file.
#[derive(Default)]
pub struct Pictures(HashMap<String, Option<TextureHandle>>);

impl Pictures {
    /// The picture, decoded when first asked for; none where it cannot be.
    fn get(
        &mut self,
        ctx: &Context,
        name: &str,
        read: impl FnOnce() -> fabrica_engine::Result<Picture>,
    ) -> Option<&TextureHandle> {
        let entry = self.0.entry(name.to_owned()).or_insert_with(|| {
            let picture = read().ok()?;
            let pixels = picture.pixels.iter().map(|p| straight(*p, 1.0)).collect();
            let image = ColorImage::new([picture.width, picture.height], pixels);
            Some(ctx.load_texture(name, image, TextureOptions::LINEAR))
        });
        entry.as_ref()
    }

    /// Forgets what it knows: files have changed.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

/// What the page shows that is not built in.
pub struct Contents<'a> {
    /// Newest first.
    pub recents: &'a [Recent],
    /// Newest first.
    pub orphans: &'a [Orphan],
}

/// Data sets to begin with: the specimen's name, what the button calls it, what it says of it.
const SPECIMENS: [(&str, &str, &str); 3] = [
    ("head", "a head", "A CT that Fabrica makes itself"),
    ("turtle", "a turtle", "A CT that Fabrica makes itself: shell, organs and bones"),
    ("engine", "an engine", "An industrial CT that Fabrica makes itself: castings of aluminum, steel within"),
];

/// A card: a picture with two lines below.
const CARD: Vec2 = Vec2::new(216.0, 264.0);
const PICTURE: f32 = 216.0;

/// The page.
pub fn show(ui: &mut Ui, contents: &Contents<'_>, pictures: &mut Pictures) -> Option<Choice> {
    let mut choice = None;
    let tokens = theme::tokens(ui.ctx());
    let frame = egui::Frame::new().fill(tokens.panel).inner_margin(24);
    egui::Panel::left("start").exact_size(270.0).resizable(false).frame(frame).show(ui, |ui| {
        ui.heading("Fabrica");
        ui.label(theme::small(ui.ctx(), "Illustrations from volume data"));
        ui.add_space(12.0);
        let wide = Vec2::new(ui.available_width(), 34.0);
        let open = egui::RichText::new("Open…").color(theme::ON_FILLED);
        if ui.add(egui::Button::new(open).fill(tokens.filled).min_size(wide)).clicked() {
            choice = Some(Choice::Run(UiCommand::Open));
        }
        if ui.add(egui::Button::new("Open folder…").min_size(wide)).clicked() {
            choice = Some(Choice::Run(UiCommand::OpenFolder));
        }
        ui.add_space(8.0);
        drop_area(ui);
        ui.add_space(16.0);
        ui.label(theme::heading("Try it"));
        for (name, title, hint) in SPECIMENS {
            let button = egui::Button::new(format!("Specimen: {title}")).min_size(wide);
            if ui.add(button).on_hover_text(hint).clicked() {
                choice = Some(Choice::Open(PathBuf::from(format!("specimen:{name}"))));
            }
        }
    });
    egui::CentralPanel::default().frame(egui::Frame::new().fill(tokens.canvas).inner_margin(24)).show(ui, |ui| {
        ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            recovered(ui, contents.orphans, &mut choice);
            if !contents.recents.is_empty() {
                ui.label(theme::heading("Recent figures").size(16.0));
                cards(ui, contents.recents, |ui, recent| recent_card(ui, recent, pictures, &mut choice));
                ui.add_space(16.0);
            }
            ui.label(theme::heading("Start from a template").size(16.0));
            ui.label(theme::small(ui.ctx(), "A look and a layout. Open it, then drop your own volume onto it"));
            let (of_own, opens): (Vec<usize>, Vec<usize>) =
                (0..SHIPPED.len()).partition(|i| SHIPPED[*i].needs.is_some());
            cards(ui, &opens, |ui, i| shipped_card(ui, *i, pictures, &mut choice));
            ui.add_space(16.0);
            ui.label(theme::heading("For a scan of your own").size(16.0));
            ui.label(theme::small(
                ui.ctx(),
                "These come without data. Open one, then choose your scan and its label map",
            ));
            cards(ui, &of_own, |ui, i| shipped_card(ui, *i, pictures, &mut choice));
        });
    });
    choice
}

fn drop_area(ui: &mut Ui) {
    let tokens = theme::tokens(ui.ctx());
    let (rect, _) = ui.allocate_exact_size(Vec2::new(ui.available_width(), 96.0), Sense::hover());
    let corners = [rect.left_top(), rect.right_top(), rect.right_bottom(), rect.left_bottom(), rect.left_top()];
    let stroke = Stroke::new(1.0, tokens.border);
    ui.painter().extend(egui::Shape::dashed_line(&corners, stroke, 4.0, 4.0));
    let lines = [
        ("Drop files or a folder anywhere", 13.0, tokens.text),
        ("NIfTI, NRRD, DICOM, raw voxels, figures", 11.0, tokens.dim),
    ];
    for (i, (text, size, color)) in lines.into_iter().enumerate() {
        let at = rect.center() + Vec2::Y * (20.0 * i as f32 - 10.0);
        ui.painter().text(at, Align2::CENTER_CENTER, text, FontId::proportional(size), color);
    }
}

fn recovered(ui: &mut Ui, orphans: &[Orphan], choice: &mut Option<Choice>) {
    if orphans.is_empty() {
        return;
    }
    let tokens = theme::tokens(ui.ctx());
    ui.label(theme::heading("Recovered figures").size(16.0).color(tokens.warning));
    ui.label(theme::small(ui.ctx(), "Fabrica ended before these were saved"));
    for (i, orphan) in orphans.iter().enumerate() {
        egui::Frame::new().fill(tokens.panel).corner_radius(4).inner_margin(10).show(ui, |ui| {
            ui.horizontal(|ui| {
                match &orphan.content {
                    Ok(found) => {
                        ui.vertical(|ui| {
                            ui.label(
                                egui::RichText::new(format!("{}, {}", found.title, ago(orphan.saved_at))).strong(),
                            );
                            ui.label(theme::small(ui.ctx(), found.steps.join(" · ")));
                        });
                        if ui.button("Restore").on_hover_text("Opens it as it was; save it where you like").clicked() {
                            *choice = Some(Choice::Restore(i));
                        }
                    }
                    Err(why) => {
                        ui.label(theme::small(ui.ctx(), why));
                    }
                }
                if ui.button("Discard").on_hover_text("Throws these changes away for good").clicked() {
                    *choice = Some(Choice::Discard(i));
                }
            });
        });
    }
    ui.add_space(16.0);
}

fn cards<T>(ui: &mut Ui, items: &[T], mut card: impl FnMut(&mut Ui, &T)) {
    let columns = ((ui.available_width() + 16.0) / (CARD.x + 16.0)).floor().max(1.0) as usize;
    for row in items.chunks(columns) {
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 16.0;
            for item in row {
                card(ui, item);
            }
        });
        ui.add_space(8.0);
    }
}

fn recent_card(ui: &mut Ui, recent: &Recent, pictures: &mut Pictures, choice: &mut Option<Choice>) {
    let picture = recent.thumbnail.as_ref().and_then(|file| {
        let name = file.display().to_string();
        pictures.get(ui.ctx(), &name, || read_png(file))
    });
    let there = recent.is_there;
    let below = if there { format!("{}, {}", ago(recent.opened), recent.page) } else { "Not found".to_owned() };
    let response = card(ui, picture, &recent.title, &below, !there);
    let response = response.on_hover_text(recent.path.display().to_string());
    if response.clicked() {
        *choice = Some(Choice::Open(recent.path.clone()));
    }
    response.context_menu(|ui| {
        if ui.button("Take off this list").clicked() {
            *choice = Some(Choice::Forget(recent.path.clone()));
            ui.close();
        }
    });
}

fn shipped_card(ui: &mut Ui, i: usize, pictures: &mut Pictures, choice: &mut Option<Choice>) {
    let shipped = &SHIPPED[i];
    let picture = pictures.get(ui.ctx(), shipped.name, || decode_png(shipped.picture, Path::new(shipped.name)));
    let response = card(ui, picture, &titles()[i], shipped.description, false);
    let response = match shipped.needs {
        Some(needs) => response.on_hover_text(format!("Needs data of your own: {needs}")),
        None => response,
    };
    if response.clicked() {
        *choice = Some(Choice::Shipped(i));
    }
}

fn card(ui: &mut Ui, picture: Option<&TextureHandle>, title: &str, below: &str, faulty: bool) -> egui::Response {
    let tokens = theme::tokens(ui.ctx());
    let (rect, response) = ui.allocate_exact_size(CARD, Sense::click());
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("{title}: {below}")));
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 4.0, tokens.panel);
    let top = Rect::from_min_size(rect.min, Vec2::new(rect.width(), PICTURE)).shrink(1.0);
    if let Some(picture) = picture {
        // As much of its middle as fills the place.
        let [w, h] = picture.size().map(|n| n as f32);
        let scale = (top.width() / w).max(top.height() / h);
        let part = Rect::from_center_size(Pos2::new(0.5, 0.5), top.size() / (scale * Vec2::new(w, h)));
        painter.image(picture.id(), top, part, Color32::WHITE);
    }
    let at = rect.left_top() + Vec2::new(10.0, PICTURE + 6.0);
    painter.text(at, Align2::LEFT_TOP, title, FontId::proportional(13.0), tokens.text);
    let color = if faulty { tokens.warning } else { tokens.dim };
    painter.text(at + Vec2::Y * 19.0, Align2::LEFT_TOP, below, FontId::proportional(11.0), color);
    let edge = if response.hovered() || response.has_focus() { tokens.accent } else { tokens.hairline };
    painter.rect_stroke(rect.shrink(0.5), 4.0, Stroke::new(1.5, edge), StrokeKind::Inside);
    response
}

/// How long ago, in words.
fn ago(time: SystemTime) -> String {
    let seconds = time.elapsed().map_or(0, |d| d.as_secs());
    let (n, unit) = match seconds {
        0..60 => return "just now".to_owned(),
        60..3600 => (seconds / 60, "minute"),
        3600..86_400 => (seconds / 3600, "hour"),
        _ => (seconds / 86_400, "day"),
    };
    format!("{n} {unit}{} ago", if n == 1 { "" } else { "s" })
}
