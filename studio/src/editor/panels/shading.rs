//! How surfaces are drawn besides their styles, of the chosen region or structures, else of the object: contours and transparency.

use eframe::egui::{ComboBox, DragValue, Ui};
use fabrica_engine::scene::transfer_function::MAX_CONTOUR_PT;

use super::super::open_figure::OpenFigure;
use super::properties::{parse_number, row};
use super::regions;
use crate::figure::Command;
use crate::figure::template::{ContoursTemplate, LookTemplate, Rgb, ShadingTemplate, Transparency};

/// Width of contours that were not there before, in points: a fine pen's.
const FINE_PT: f64 = 0.5;
/// A sepia so dark that it prints as black.
const INK: [u8; 3] = [30, 22, 18];

/// Edits whatever is chosen.
struct Edit<'a> {
    open: &'a mut OpenFigure,
    /// What is said of it itself.
    own: ShadingTemplate,
}

impl Edit<'_> {
    fn command(&self, change: impl Fn(ShadingTemplate) -> ShadingTemplate) -> Command {
        let object = self.open.object;
        let of_look = |look: LookTemplate| LookTemplate { shading: change(look.shading.clone()), ..look };
        regions::change_chosen(self.open, of_look)
            .unwrap_or_else(|| Command::SetShading { object, shading: change(self.own.clone()) })
    }

    fn make(&mut self, change: impl Fn(ShadingTemplate) -> ShadingTemplate) {
        let command = self.command(change);
        self.open.edit(command);
    }
}

/// The rows.
pub fn show(ui: &mut Ui, open: &mut OpenFigure) {
    let Some(object) = open.chosen() else { return };
    let of_object = object.shading.clone();
    let (own, shown) = match open.chosen_region().and_then(|part| Some((object.regions.get(part.region)?, part))) {
        None => (of_object.clone(), of_object),
        Some((region, part)) => {
            let structure = part.structure.as_deref();
            (region.own_look(structure).shading, region.look_at(structure).shading.or(&of_object))
        }
    };
    let mut edit = Edit { open, own };
    contours(ui, &mut edit, shown.contours.filter(|c| c.width_pt > 0.0));
    transparency(ui, &mut edit, shown.transparency.unwrap_or_default());
}

fn contours(ui: &mut Ui, edit: &mut Edit<'_>, shown: Option<ContoursTemplate>) {
    let tooltip = "Lines where surfaces turn away, of one width on the page whatever their size";
    let with =
        |contours: Option<ContoursTemplate>| move |shading| ShadingTemplate { contours: contours.clone(), ..shading };
    row(ui, "Contours", tooltip, |ui, label| {
        let mut drawn = shown.is_some();
        if ui.checkbox(&mut drawn, "").on_hover_text(tooltip).accessible_name(label).changed() {
            edit.make(with(Some(ContoursTemplate::new(if drawn { FINE_PT } else { 0.0 }))));
        }
        let Some(contours) = &shown else { return };
        let mut width_pt = contours.width_pt;
        let field =
            DragValue::new(&mut width_pt).speed(0.02).suffix(" pt").max_decimals(2).range(0.05..=MAX_CONTOUR_PT);
        let response =
            ui.add(field.update_while_editing(false).custom_parser(parse_number)).accessible_name("Contour width");
        let wider = edit.command(with(Some(ContoursTemplate { width_pt, ..contours.clone() })));
        edit.open.edit_by(&response, response.changed().then_some(wider));
    });
    let Some(contours) = shown else { return };
    row(ui, "Line color", "What contours are drawn in", |ui, label| {
        let text = if contours.color.is_some() { "This one" } else { "The style's rim" };
        let colored = |color: Option<Rgb>| with(Some(ContoursTemplate { color, ..contours.clone() }));
        let combo = ComboBox::from_id_salt("line color").selected_text(text).show_ui(ui, |ui| {
            for (color, text) in [(None, "The style's rim"), (Some(contours.color.unwrap_or(Rgb(INK))), "This one")] {
                if ui.selectable_label(contours.color.is_some() == color.is_some(), text).clicked() {
                    edit.make(colored(color));
                }
            }
        });
        combo.response.accessible_name(label);
        if let Some(Rgb(mut color)) = contours.color
            && ui.color_edit_button_srgb(&mut color).accessible_name("Contour color").changed()
        {
            edit.make(colored(Some(Rgb(color))));
        }
    });
}

fn transparency(ui: &mut Ui, edit: &mut Edit<'_>, shown: Transparency) {
    let tooltip = "What becomes transparent where opacity is low: all alike, or what faces the eye first and edges last, as in \
                   drawings of glass";
    row(ui, "Transparency", tooltip, |ui, label| {
        let text = |transparency: Transparency| match transparency {
            Transparency::Uniform => "Uniform",
            Transparency::Illustrative => "Illustrative",
        };
        let combo = ComboBox::from_id_salt("transparency").selected_text(text(shown)).show_ui(ui, |ui| {
            for choice in [Transparency::Uniform, Transparency::Illustrative] {
                if ui.selectable_label(choice == shown, text(choice)).clicked() {
                    edit.make(|shading| ShadingTemplate { transparency: Some(choice), ..shading });
                }
            }
        });
        combo.response.accessible_name(label).on_hover_text(tooltip);
    });
}
