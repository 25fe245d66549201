//! The properties of the chosen object, of the page and of the view: a row each, a number with its unit always.

use eframe::egui::{self, CollapsingHeader, ComboBox, DragValue, Response, Ui, WidgetText};
use fabrica_engine::read::limits::bytes_in_words;
use fabrica_engine::volume::{Volume, type_in_words};
use glam::DVec3;

use super::super::filter_preview::FilterPreview;
use super::super::movable::Movable;
use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::super::ui_command::UiCommand;
use super::{lighting, moves, noise, regions, shading, style_settings};
use crate::figure::Command;
use crate::figure::template::{Background, Page, ProjectionName, QualityName, VolumeSlot};
use crate::figure::theme::{Themes, Wardrobe};

/// Width of the labels.
const LABEL: f32 = 104.0;
const MM_PER_INCH: f64 = 25.4;

/// A number as people type it: with a unit, with a decimal comma, with signs of sums and products ("2*3 mm").
pub fn parse_number(text: &str) -> Option<f64> {
    let text = text.replace(['\u{2212}', '–'], "-").replace(',', ".");
    let text: String = text.chars().filter(|c| "0123456789.+-*/eE ".contains(*c)).collect();
    let text = text.trim().trim_end_matches(['e', 'E', ' ']);
    if let Ok(number) = text.parse::<f64>() {
        return Some(number).filter(|n| n.is_finite());
    }
    sum(&text.replace(' ', ""))
}

fn sum(text: &str) -> Option<f64> {
    // The last sign that is between two terms, not the first's own and not an exponent's.
    let sign = text.char_indices().rev().find(|(i, c)| {
        let before = text[..*i].chars().next_back();
        matches!(c, '+' | '-') && before.is_some_and(|b| b.is_ascii_digit() || b == '.')
    });
    let number = match sign {
        Some((i, '+')) => sum(&text[..i])? + product(&text[i + 1..])?,
        Some((i, _)) => sum(&text[..i])? - product(&text[i + 1..])?,
        None => product(text)?,
    };
    Some(number).filter(|n| n.is_finite())
}

fn product(text: &str) -> Option<f64> {
    match text.rfind(['*', '/']) {
        Some(i) if text[i..].starts_with('*') => Some(product(&text[..i])? * text[i + 1..].parse::<f64>().ok()?),
        Some(i) => Some(product(&text[..i])? / text[i + 1..].parse::<f64>().ok()?),
        None => text.parse().ok(),
    }
}

/// A number with at most three decimals, and none that say nothing.
pub fn shorter(number: f64) -> String {
    let text = format!("{number:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

pub(super) fn row<R>(ui: &mut Ui, label: &str, tooltip: &str, add: impl FnOnce(&mut Ui, &str) -> R) -> R {
    ui.horizontal(|ui| {
        let text = egui::Label::new(theme::small(ui.ctx(), label)).truncate();
        ui.allocate_ui_with_layout(
            egui::Vec2::new(LABEL, theme::ROW),
            egui::Layout::left_to_right(egui::Align::Center),
            |ui| {
                ui.set_min_width(LABEL);
                ui.add(text).on_hover_text(tooltip);
            },
        );
        add(ui, label)
    })
    .inner
}

/// A number that can be dragged and typed.
pub(super) fn number(ui: &mut Ui, label: &str, tooltip: &str, value: &mut f64, suffix: &str, speed: f64) -> Response {
    row(ui, label, tooltip, |ui, label| {
        let field = DragValue::new(value).speed(speed).suffix(suffix).max_decimals(3).update_while_editing(false);
        ui.add(field.custom_parser(parse_number)).accessible_name(label).on_hover_text(tooltip)
    })
}

fn section(ui: &mut Ui, title: &str, open: bool, add: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(WidgetText::from(theme::heading(title))).default_open(open).show_unindented(ui, add);
}

/// What is asked for that is no edit.
pub enum Wanted {
    /// A command of the window.
    Command(UiCommand),
    /// Another theme may be chosen soon.
    Themes,
    /// Slot number so-and-so read in another way.
    Reading(usize, Box<VolumeSlot>),
}

/// What the rows of filters show besides the figure.
pub struct Filtering<'a> {
    /// What a filter does to a slice.
    pub preview: &'a mut FilterPreview,
    /// Where that is, world (RAS) mm; none: in the volume's middle.
    pub place_mm: Option<DVec3>,
    /// The slot that is being read, and its number.
    pub pending: Option<(usize, &'a VolumeSlot)>,
}

/// The panel, and what is asked for in it.
pub fn show(
    ui: &mut Ui,
    open: &mut OpenFigure,
    styles: &[&str],
    wardrobe: Wardrobe<'_>,
    filtering: Filtering<'_>,
) -> Option<Wanted> {
    let mut wanted = None;
    if open.chosen_region().is_some() {
        section(ui, "Region", true, |ui| regions::look(ui, open, styles));
        if let Some(movable) = Movable::chosen(open) {
            section(ui, "Move", true, |ui| moves::show(ui, open, &movable, styles));
        }
    }
    section(ui, "Appearance", true, |ui| {
        appearance(ui, open);
        shading::show(ui, open);
        lighting::show(ui, open);
        style_settings::show(ui, open, wardrobe);
    });
    let mut chooses_theme = false;
    section(ui, "Figure", true, |ui| chooses_theme = page(ui, open, wardrobe.themes));
    section(ui, "View", false, |ui| view(ui, open));
    section(ui, "Source", true, |ui| wanted = source(ui, open, filtering));
    if chooses_theme {
        wanted = wanted.or(Some(Wanted::Themes));
    }
    wanted
}

fn appearance(ui: &mut Ui, open: &mut OpenFigure) {
    let Some(object) = open.chosen().cloned() else { return };
    let voxel = open.chosen_volume().map_or(1.0, |v| v.grid.spacing_mm().min_element());
    let index = open.object;
    let Some(function) = open.function() else { return };
    let of = open.function_of();
    let mut length = function.reference_length_mm.unwrap_or(voxel);
    let tooltip =
        "The length of material that the opacities are stated for. Longer: the figure becomes more transparent";
    let response = number(ui, "Opacity is per", tooltip, &mut length, " mm", 0.01 * voxel);
    let longest = Command::SetReferenceLength { of: of.clone(), length_mm: Some(length.max(1e-6)) };
    open.edit_by(&response, response.changed().then_some(longest));
    reset(&response, function.reference_length_mm.is_some())
        .then(|| open.edit(Command::SetReferenceLength { of, length_mm: None }));
    let mut scale = object.gradient_scale_mm.unwrap_or(voxel);
    let tooltip = "How far the shading is smoothed: more for noisy or coarse scans. 0: not at all";
    let response = number(ui, "Smooth shading", tooltip, &mut scale, " mm", 0.01 * voxel);
    let smoothed = Command::SetGradientScale { object: index, scale_mm: Some(scale.max(0.0)) };
    open.edit_by(&response, response.changed().then_some(smoothed));
    reset(&response, object.gradient_scale_mm.is_some())
        .then(|| open.edit(Command::SetGradientScale { object: index, scale_mm: None }));
}

/// In the field's context menu, where a double click would begin to type.
fn reset(response: &Response, is_set: bool) -> bool {
    let mut wanted = false;
    response.context_menu(|ui| {
        if ui.add_enabled(is_set, egui::Button::new("Reset to one voxel")).clicked() {
            wanted = true;
            ui.close();
        }
    });
    wanted
}

/// The rows of the page; whether the list of themes has just been opened.
fn page(ui: &mut Ui, open: &mut OpenFigure, themes: &Themes) -> bool {
    let figure = open.document.figure().clone();
    let page = &figure.figure;
    let mut title = figure.title.clone();
    let response = row(ui, "Title", "What the figure shows", |ui, label| {
        ui.add(theme::text_field(&mut title).desired_width(f32::INFINITY)).accessible_name(label)
    });
    if response.changed() {
        open.edit(Command::SetTitle(title));
    }
    let (mut width, mut height, mut dpi) = (page.width_mm, page.height_mm, page.dpi);
    let fields = [
        ("Width", "Width on the page", &mut width, " mm", 0.5),
        ("Height", "Height on the page", &mut height, " mm", 0.5),
        ("Resolution", "Pixels per inch of an export", &mut dpi, " dpi", 1.0),
    ];
    let mut changed = None;
    for (label, tooltip, value, suffix, speed) in fields {
        let response = number(ui, label, tooltip, value, suffix, speed);
        if response.changed() {
            *value = value.clamp(1.0, 10_000.0);
        }
        if response.changed() || response.drag_started() || response.drag_stopped() {
            changed = Some(response);
        }
    }
    if let Some(response) = changed {
        let page = Page { width_mm: width, height_mm: height, dpi, ..page.clone() };
        open.edit_by(&response, response.changed().then_some(Command::SetPage(page)));
    }
    let pixels = [page.width_mm, page.height_mm].map(|mm| (mm / MM_PER_INCH * page.dpi).round());
    ui.label(theme::small(ui.ctx(), format!("{} x {} pixels when exported", pixels[0], pixels[1])));
    let chooses_theme = theme_row(ui, open, themes, figure.theme.as_deref());
    match themes.of(&figure).ok().flatten().and_then(|theme| theme.background) {
        Some(of_theme) => background_of_theme(ui, of_theme),
        None => background(ui, open, figure.background),
    }
    row(ui, "Quality", "What is traded between speed and accuracy, here and in exports", |ui, label| {
        let names = [QualityName::Draft, QualityName::Standard, QualityName::Final];
        let text = |q: QualityName| match q {
            QualityName::Draft => "Draft",
            QualityName::Standard => "Standard",
            QualityName::Final => "Final",
        };
        let combo = ComboBox::from_id_salt("quality").selected_text(text(figure.quality)).show_ui(ui, |ui| {
            for name in names {
                if ui.selectable_label(name == figure.quality, text(name)).clicked() {
                    open.edit(Command::SetQuality(name));
                }
            }
        });
        combo.response.accessible_name(label)
    });
    chooses_theme
}

/// The row of themes; whether its list has just been opened.
fn theme_row(ui: &mut Ui, open: &mut OpenFigure, themes: &Themes, chosen: Option<&str>) -> bool {
    let tooltip = "Other styles for all of the figure. Its own come back with None";
    row(ui, "Theme", tooltip, |ui, label| {
        let text = match chosen.map(|name| (name, themes.named(name))) {
            None => "None".to_owned(),
            Some((_, Ok(theme))) => theme.title.clone(),
            Some((name, Err(_))) => format!("{name} (unknown)"),
        };
        let combo = ComboBox::from_id_salt("theme").selected_text(text).height(400.0).show_ui(ui, |ui| {
            if ui.selectable_label(chosen.is_none(), "None").on_hover_text("The figure's own styles").clicked()
                && chosen.is_some()
            {
                open.edit(Command::SetTheme(None));
            }
            for theme in themes.all() {
                let is_chosen = chosen == Some(&theme.name);
                let item = ui.selectable_label(is_chosen, &theme.title).on_hover_text(&theme.description);
                if item.clicked() && !is_chosen {
                    open.edit(Command::SetTheme(Some(theme.name.clone())));
                }
            }
        });
        combo.response.accessible_name(label);
        let is_open = combo.inner.is_some();
        let id = ui.scope_id().with("theme is open");
        let was_open = ui.data_mut(|data| std::mem::replace(data.get_temp_mut_or_default::<bool>(id), is_open));
        is_open && !was_open
    })
}

/// What is seen in place of the figure's own background.
fn background_of_theme(ui: &mut Ui, background: Background) {
    let tooltip = "The theme's. The figure's own comes back with the theme None";
    row(ui, "Background", tooltip, |ui, _| {
        if let Background::Color(rgb) = background {
            let (rect, _) = ui.allocate_exact_size(egui::Vec2::new(28.0, 14.0), egui::Sense::hover());
            let [r, g, b] = rgb;
            ui.painter().rect_filled(rect, 2.0, egui::Color32::from_rgb(r, g, b));
        }
        let text = theme::small(ui.ctx(), format!("{background} (theme)"));
        ui.add(egui::Label::new(text).truncate()).on_hover_text(tooltip);
    });
}

fn background(ui: &mut Ui, open: &mut OpenFigure, background: Background) {
    row(ui, "Background", "What lies behind: nothing, or a color", |ui, label| {
        let mut transparent = background == Background::Transparent;
        if ui.checkbox(&mut transparent, "Transparent").changed() {
            let other = if transparent { Background::Transparent } else { Background::Color([255; 3]) };
            open.edit(Command::SetBackground(other));
        }
        if let Background::Color(mut rgb) = background {
            let response = ui.color_edit_button_srgb(&mut rgb).accessible_name(format!("{label} color"));
            // The picker stays open while one looks for the color: what is found in one go is one step.
            if response.changed() {
                open.edit(Command::SetBackground(Background::Color(rgb)));
            }
        }
    });
}

fn view(ui: &mut Ui, open: &mut OpenFigure) {
    let camera = open.document.figure().camera.clone();
    row(ui, "Projection", "Parallel lines meet, or stay parallel", |ui, _| {
        let names = [(ProjectionName::Perspective, "Perspective"), (ProjectionName::Orthographic, "Parallel")];
        for (name, text) in names {
            if ui.selectable_label(camera.projection == name, text).clicked() {
                open.edit(Command::SetProjection(name));
            }
        }
    });
    if camera.projection == ProjectionName::Perspective {
        let mut fov = camera.fov_deg;
        let tooltip = "Vertical angle of view: small for a distant, calm view, large for a near one";
        let response = number(ui, "Field of view", tooltip, &mut fov, "°", 0.2);
        let camera = crate::figure::template::CameraTemplate { fov_deg: fov.clamp(1.0, 120.0), ..camera.clone() };
        open.edit_by(&response, response.changed().then_some(Command::SetCamera(camera)));
    }
    let mut height = camera.height;
    let tooltip = "What the figure shows from bottom to top, in radii of the sphere around the object";
    let response = number(ui, "Shown height", tooltip, &mut height, " radii", 0.01);
    let camera = crate::figure::template::CameraTemplate { height: height.clamp(0.01, 50.0), ..camera };
    open.edit_by(&response, response.changed().then_some(Command::SetCamera(camera)));
}

fn source(ui: &mut Ui, open: &OpenFigure, filtering: Filtering<'_>) -> Option<Wanted> {
    let mut wanted = None;
    let number = open.chosen_slot();
    let slot = number.map(|n| (n, &open.document.figure().volumes[n]));
    if let Some((_, slot)) = slot {
        let name = std::path::Path::new(&slot.file).file_name().unwrap_or_default().to_string_lossy().into_owned();
        ui.add(egui::Label::new(name).truncate()).on_hover_text(&slot.file);
    }
    match open.chosen_volume() {
        Some(volume) => {
            for line in description(volume) {
                ui.label(theme::small(ui.ctx(), line));
            }
            if let Some((number, slot)) = slot.filter(|_| volume.num_frames > 1) {
                wanted = frame(ui, slot, volume.num_frames).map(|slot| Wanted::Reading(number, Box::new(slot)));
            }
            if let Some((number, slot)) = slot.filter(|_| volume.colors.is_none()) {
                // What is being read already is what is set.
                let slot = filtering.pending.filter(|(of, _)| *of == number).map_or(slot, |(_, pending)| pending);
                let set = noise::show(ui, slot, volume);
                match (set.filter, open.unfiltered(slot)) {
                    (Some(filter), Some(unfiltered)) => {
                        filtering.preview.show(ui, unfiltered, filter, filtering.place_mm);
                    }
                    _ => filtering.preview.close(),
                }
                wanted = set.wanted.map(|slot| Wanted::Reading(number, Box::new(slot))).or(wanted);
            }
            for warning in &volume.warnings {
                ui.add(egui::Label::new(theme::small(ui.ctx(), warning)).wrap());
            }
        }
        None => {
            ui.label(theme::small(ui.ctx(), "The volume was not found."));
        }
    }
    for command in [UiCommand::ReplaceVolume, UiCommand::ReadOtherwise] {
        if ui.button(command.text()).on_hover_text(command.tooltip()).clicked() {
            wanted = Some(Wanted::Command(command));
        }
    }
    wanted
}

/// Which frame of several; the slot with another one, once the number is let go.
fn frame(ui: &mut Ui, slot: &VolumeSlot, num_frames: usize) -> Option<VolumeSlot> {
    // Every number on the way would be read: the one that is dragged is remembered until the end.
    let id = ui.scope_id().with("frame");
    let mut number = ui.data(|d| d.get_temp(id)).unwrap_or(slot.frame + 1);
    let tooltip = "Which point in time, or component, of the file is drawn";
    let response = row(ui, "Frame", tooltip, |ui, label| {
        let field = DragValue::new(&mut number).range(1..=num_frames).update_while_editing(false);
        ui.add(field.suffix(format!(" of {num_frames}")).custom_parser(parse_number)).accessible_name(label)
    });
    if response.dragged() {
        ui.data_mut(|d| d.insert_temp(id, number));
        return None;
    }
    ui.data_mut(|d| d.remove_temp::<usize>(id));
    (number != slot.frame + 1).then(|| VolumeSlot { frame: number - 1, ..slot.clone() })
}

fn description(volume: &Volume) -> Vec<String> {
    let [x, y, z] = volume.grid.dims();
    let mm = volume.grid.spacing_mm();
    let kind = match (&volume.colors, volume.labels.iter().map(|layer| layer.labels.len() - 1).sum()) {
        (None, _) => type_in_words(volume.voxels.type_name()).to_owned(),
        (Some(_), 0) => "colors".to_owned(),
        (Some(_), 1) => "colors of 1 structure".to_owned(),
        (Some(_), n) => format!("colors of {n} structures"),
    };
    let mut lines = vec![
        format!("{x} x {y} x {z} voxels"),
        format!("of {} x {} x {} mm", shorter(mm.x), shorter(mm.y), shorter(mm.z)),
        format!("{}, {kind}, {}", volume.format, bytes_in_words(volume.num_bytes() as u64)),
    ];
    if !volume.description.is_empty() {
        lines.insert(0, volume.description.clone());
    }
    if let (Some(s), None) = (volume.known_statistics(), &volume.colors) {
        let kind =
            Some(volume.modality.abbreviation()).filter(|k| !k.is_empty()).map_or(String::new(), |k| format!("{k}, "));
        let unit = volume.modality.suffix();
        lines.push(format!("{kind}values {} to {}{unit}", shorter(s.min), shorter(s.max)));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_people_type_them() {
        for (text, number) in [
            ("12", 12.0),
            ("12,5 mm", 12.5),
            ("\u{2212}160 HU", -160.0),
            ("2*3 mm", 6.0),
            ("173/2", 86.5),
            ("100-7+1", 94.0),
            ("1e-3", 1e-3),
            ("-5--2", -3.0),
            (" 96 % ", 96.0),
        ] {
            assert_eq!(parse_number(text), Some(number), "{text}");
        }
        assert_eq!([173.0, 86.7, 0.968_75, -1000.0].map(shorter), ["173", "86.7", "0.969", "-1000"]);
        for text in ["", "mm", "1//2", "1/0", "*", "1e999"] {
            assert_eq!(parse_number(text), None, "{text}");
        }
    }
}
