//! The regions of an object: selected parts with looks of their own, and in a group each of its structures.

use std::sync::Arc;

use eframe::egui::{self, ScrollArea, Sense, Ui, Vec2};
use fabrica_engine::selection::Structure;

use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::objects::draw_eye;
use super::properties::{number, row};
use crate::figure::Command;
use crate::figure::sources::Selections;
use crate::figure::template::{LookTemplate, ObjectTemplate, RegionTemplate, Tint};

/// What is chosen of an object: a region, or a structure in a group.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chosen {
    /// Which region.
    pub region: usize,
    /// Which structure, by name.
    pub structure: Option<String>,
}

/// From so many structures on, one types what one looks for.
const SEARCHED: usize = 8;
/// Height of a list of structures before it scrolls.
const LIST_HEIGHT: f32 = 220.0;
const ROW: f32 = 26.0;

/// The regions of an object, below its row.
pub fn list(ui: &mut Ui, open: &mut OpenFigure, object: usize) {
    let figure = open.document.figure().clone();
    for (i, region) in figure.objects[object].regions.iter().enumerate() {
        let slot = figure.selections.iter().find(|s| s.name == region.selection);
        let selections = slot.and_then(|slot| open.selections_of(slot)).cloned();
        match &region.structure {
            Some(name) => {
                let found = selections.as_ref().and_then(|s| find(&s.structures, name)).cloned();
                ui.indent(("region", i), |ui| {
                    let chosen = Chosen { region: i, structure: None };
                    line(ui, open, object, region, &chosen, region.title(), found.as_ref(), &region.look);
                });
            }
            None => group(ui, open, object, i, region, selections.as_ref()),
        }
    }
    if !figure.objects[object].regions.is_empty() {
        rest(ui, open, object, &figure.objects[object]);
    }
}

fn find<'a>(structures: &'a [Structure], name: &str) -> Option<&'a Structure> {
    let called = |s: &&Structure| {
        s.label.name == name || s.label.code.as_deref() == Some(name) || s.label.id.to_string() == name
    };
    structures.iter().find(called)
}

/// A group: its own row, and once it is unfolded those of its structures.
fn group(
    ui: &mut Ui,
    open: &mut OpenFigure,
    object: usize,
    index: usize,
    region: &RegionTemplate,
    selections: Option<&Arc<Selections>>,
) {
    let id = ui.make_persistent_id(("group", object, index));
    let state = egui::collapsing_header::CollapsingState::load_with_default_open(ui.ctx(), id, true);
    let count = selections.map_or(0, |s| s.structures.len());
    let header = state.show_header(ui, |ui| {
        let chosen = Chosen { region: index, structure: None };
        let title = match selections {
            Some(_) => format!("{} ({count})", region.title()),
            None => format!("{} (reading…)", region.title()),
        };
        line(ui, open, object, region, &chosen, &title, None, &region.look);
    });
    header.body(|ui| {
        let Some(selections) = selections else { return };
        if selections.structures.is_empty() {
            let why = selections.notes.first().map_or("There are no structures in it.", String::as_str);
            ui.add(egui::Label::new(theme::small(ui.ctx(), why)).wrap());
            return;
        }
        let filter_id = id.with("search");
        let mut wanted: String = ui.data(|d| d.get_temp(filter_id)).unwrap_or_default();
        if count > SEARCHED {
            ui.horizontal(|ui| {
                let field =
                    theme::text_field(&mut wanted).hint_text("Search").desired_width(ui.available_width() - 76.0);
                ui.add(field).accessible_name(format!("Search in {}", region.title()));
                ui.data_mut(|d| d.insert_temp(filter_id, wanted.clone()));
                let listed = || names(&selections.structures, &wanted);
                if ui.small_button("All").on_hover_text("Show all that are listed").clicked() {
                    open.edit(show_all(object, index, region, listed(), true));
                }
                if ui.small_button("None").on_hover_text("Hide all that are listed").clicked() {
                    open.edit(show_all(object, index, region, listed(), false));
                }
            });
        }
        let shown: Vec<&Structure> = selections.structures.iter().filter(|s| matches(s, &wanted)).collect();
        if shown.is_empty() {
            ui.label(theme::small(ui.ctx(), "None is called so."));
        }
        ScrollArea::vertical().id_salt(id.with("list")).max_height(LIST_HEIGHT).show_rows(
            ui,
            ROW,
            shown.len(),
            |ui, range| {
                for structure in &shown[range] {
                    let name = &structure.label.name;
                    let chosen = Chosen { region: index, structure: Some(name.clone()) };
                    let look = region.look_of(&[name]);
                    line(ui, open, object, region, &chosen, name, Some(structure), &look);
                }
            },
        );
    });
}

fn matches(structure: &Structure, wanted: &str) -> bool {
    wanted.split_whitespace().all(|word| structure.label.name.to_lowercase().contains(&word.to_lowercase()))
}

fn names(structures: &[Structure], wanted: &str) -> Vec<String> {
    structures.iter().filter(|s| matches(s, wanted)).map(|s| s.label.name.clone()).collect()
}

fn show_all(object: usize, index: usize, region: &RegionTemplate, names: Vec<String>, visible: bool) -> Command {
    let look = |name: String| {
        let own = own_look(region, Some(&name));
        (name, with_visible(own, &region.look, visible))
    };
    Command::SetLooks { object, region: index, looks: names.into_iter().map(look).collect() }
}

/// What is said of a structure, or of the region itself, without what it has from its group.
fn own_look(region: &RegionTemplate, structure: Option<&str>) -> LookTemplate {
    match structure {
        None => region.look.clone(),
        Some(name) => {
            region.structures.iter().find(|s| s.structure == name).map_or_else(Default::default, |s| s.look.clone())
        }
    }
}

/// The look, visible or not, without saying what its group says anyway.
fn with_visible(look: LookTemplate, group: &LookTemplate, visible: bool) -> LookTemplate {
    LookTemplate { visible: (visible != group.visible.unwrap_or(true)).then_some(visible), ..look }
}

/// A row: eye, color, name, volume.
#[expect(clippy::too_many_arguments, reason = "all that a row says")]
fn line(
    ui: &mut Ui,
    open: &mut OpenFigure,
    object: usize,
    region: &RegionTemplate,
    chosen: &Chosen,
    title: &str,
    structure: Option<&Structure>,
    look: &LookTemplate,
) {
    let tokens = theme::tokens(ui.ctx());
    let is_chosen = open.object == object && open.chosen_region() == Some(chosen);
    let visible = look.visible.unwrap_or(true);
    let fill = if is_chosen { tokens.selected } else { tokens.panel };
    egui::Frame::new().fill(fill).corner_radius(4).show(ui, |ui| {
        ui.horizontal(|ui| {
            ui.set_height(ROW - 4.0);
            let label = format!("{} {title}", if visible { "Hide" } else { "Show" });
            if draw_eye(ui, &label, visible) {
                let structure = chosen.structure.clone();
                let own = own_look(region, structure.as_deref());
                let around = if structure.is_some() { region.look.clone() } else { LookTemplate::default() };
                let look = with_visible(own, &around, !visible);
                open.edit(Command::SetLook { object, region: chosen.region, structure, look });
            }
            let is_group = region.structure.is_none();
            let color = match look.tint.unwrap_or(if is_group { Tint::Own } else { Tint::None }) {
                Tint::Own => structure.map(|s| s.label.color),
                Tint::Color(color) => Some(color),
                Tint::None => None,
            };
            let (rect, _) = ui.allocate_exact_size(Vec2::splat(14.0), Sense::hover());
            match color {
                Some([r, g, b]) => ui.painter().circle_filled(rect.center(), 6.0, egui::Color32::from_rgb(r, g, b)),
                None => ui.painter().circle_stroke(rect.center(), 6.0, egui::Stroke::new(1.0, tokens.dim)),
            };
            let text = egui::RichText::new(title);
            let text = if visible { text } else { text.color(tokens.dim) };
            let volume = structure.map_or(String::new(), |s| in_ml(s.selection.volume_ml()));
            let button = egui::Button::new(text)
                .frame(false)
                .right_text(theme::small(ui.ctx(), &volume))
                .min_size(Vec2::new(ui.available_width(), ROW - 4.0))
                .truncate();
            let response = ui.add(button);
            if response.clicked() {
                open.choose(object, Some(chosen.clone()));
            }
            response.context_menu(|ui| {
                if chosen.structure.is_none() && ui.button("Remove region").clicked() {
                    open.choose(object, None);
                    open.edit(Command::RemoveRegion { object, region: chosen.region });
                    ui.close();
                }
                if let Some(only) = chosen.structure.clone()
                    && ui.button("Show only this").clicked()
                {
                    open.edit(show_only(open, object, chosen.region, region, &only));
                    ui.close();
                }
            });
        });
    });
}

fn show_only(open: &OpenFigure, object: usize, index: usize, region: &RegionTemplate, only: &str) -> Command {
    let slot = open.document.figure().selections.iter().find(|s| s.name == region.selection);
    let structures =
        slot.and_then(|slot| open.selections_of(slot)).map(|s| names(&s.structures, "")).unwrap_or_default();
    let look = |name: String| {
        let own = own_look(region, Some(&name));
        let look = with_visible(own, &region.look, name == only);
        (name, look)
    };
    Command::SetLooks { object, region: index, looks: structures.into_iter().map(look).collect() }
}

/// What is in no region.
fn rest(ui: &mut Ui, open: &mut OpenFigure, object: usize, template: &ObjectTemplate) {
    ui.indent("rest", |ui| {
        ui.horizontal(|ui| {
            let visible = template.rest.visible;
            if draw_eye(ui, if visible { "Hide the rest" } else { "Show the rest" }, visible) {
                let rest = crate::figure::template::RestTemplate { visible: !visible, ..template.rest.clone() };
                open.edit(Command::SetRest { object, rest });
            }
            ui.add_space(18.0);
            let text = egui::RichText::new("The rest");
            let text = if visible { text } else { text.color(theme::tokens(ui.ctx()).dim) };
            ui.label(text).on_hover_text("What belongs to no region of this object");
        });
    });
}

fn in_ml(ml: f64) -> String {
    match ml {
        m if m >= 99.5 => format!("{m:.0} ml"),
        m if m >= 0.95 => format!("{m:.1} ml"),
        m => format!("{m:.3} ml"),
    }
}

/// How the chosen region or structure looks.
pub fn look(ui: &mut Ui, open: &mut OpenFigure, styles: &[&str]) {
    let Some(Chosen { region: index, structure }) = open.chosen_region().cloned() else { return };
    let object = open.object;
    let Some(region) = open.chosen().and_then(|o| o.regions.get(index)).cloned() else { return };
    let own = own_look(&region, structure.as_deref());
    let look = if structure.is_some() { own.or(&region.look) } else { own.clone() };
    let set = |look: LookTemplate| Command::SetLook { object, region: index, structure: structure.clone(), look };
    ui.label(structure.as_deref().unwrap_or(region.title()));
    let mut percent = 100.0 * look.opacity.unwrap_or(1.0);
    let response = number(ui, "Opacity", "Factor of its opacity; 0 cuts it out", &mut percent, " %", 0.5);
    let changed = LookTemplate { opacity: Some((percent / 100.0).clamp(0.0, 1.0)), ..own.clone() };
    open.edit_by(&response, response.changed().then(|| set(changed)));
    let is_group = region.structure.is_none();
    let tint = look.tint.unwrap_or(if is_group { Tint::Own } else { Tint::None });
    row(ui, "Color", "A color in place of the styles' own, lit as they are", |ui, label| {
        let text = |tint: Tint| match tint {
            Tint::None => "The style's",
            Tint::Own => "The label map's",
            Tint::Color(_) => "This one",
        };
        let color = match tint {
            Tint::Color(color) => color,
            _ => [230, 159, 0],
        };
        let combo = egui::ComboBox::from_id_salt("tint").selected_text(text(tint)).show_ui(ui, |ui| {
            for choice in [Tint::Own, Tint::None, Tint::Color(color)] {
                if ui.selectable_label(choice == tint, text(choice)).clicked() {
                    open.edit(set(LookTemplate { tint: Some(choice), ..own.clone() }));
                }
            }
        });
        combo.response.accessible_name(label);
        if let Tint::Color(mut color) = tint {
            let response = ui.color_edit_button_srgb(&mut color).accessible_name("Region color");
            if response.changed() {
                open.edit(set(LookTemplate { tint: Some(Tint::Color(color)), ..own.clone() }));
            }
        }
    });
    row(ui, "Style", "The style that takes the place of all of the transfer function's", |ui, label| {
        let shown = look.style.as_deref().unwrap_or("As the nodes");
        let combo = egui::ComboBox::from_id_salt("region style").selected_text(shown).show_ui(ui, |ui| {
            let mut choose = |ui: &mut Ui, style: Option<&str>, text: &str| {
                if ui.selectable_label(look.style.as_deref() == style, text).clicked() {
                    open.edit(set(LookTemplate { style: style.map(str::to_owned), ..own.clone() }));
                }
            };
            choose(ui, None, "As the nodes");
            for style in styles {
                choose(ui, Some(style), style);
            }
        });
        combo.response.accessible_name(label);
    });
    if ui.add_enabled(!own.is_default(), egui::Button::new("Look like its surroundings")).clicked() {
        open.edit(set(LookTemplate::default()));
    }
}
