//! The filter against noise of the chosen object's volume.

use eframe::egui::{ComboBox, DragValue, Ui};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::filter::{MAX_ITERATIONS, MAX_RADIUS};

use super::properties::{parse_number, row};
use crate::figure::template::{FilterTemplate, VolumeSlot};

/// What is set in the rows.
pub struct Filtering {
    /// The slot as it shall be read.
    pub wanted: Option<VolumeSlot>,
    /// The filter as it stands, also while a number of it is dragged.
    pub filter: Option<FilterTemplate>,
}

/// The rows of a slot as it is, or as it is being filtered.
pub fn show(ui: &mut Ui, slot: &VolumeSlot, volume: &Volume) -> Filtering {
    let tooltip = "Filters what was read; the file stays as it is, and undo takes it back";
    let with = |filters: Vec<FilterTemplate>| Some(VolumeSlot { filters, ..slot.clone() });
    let mut wanted = None;
    if slot.filters.len() > 1 {
        row(ui, "Noise filter", tooltip, |ui, _| ui.label(format!("{} filters", slot.filters.len())));
        return Filtering { wanted, filter: None };
    }
    let shown = slot.filters.first().copied();
    row(ui, "Noise filter", tooltip, |ui, label| {
        let text = |filter: Option<&FilterTemplate>| match filter {
            None => "None",
            Some(FilterTemplate::Gaussian { .. }) => "Gaussian",
            Some(FilterTemplate::Median { .. }) => "Median",
            Some(FilterTemplate::Anisotropic { .. }) => "Keep edges",
        };
        let combo = ComboBox::from_id_salt("noise").selected_text(text(shown.as_ref())).show_ui(ui, |ui| {
            let voxel = volume.grid.spacing_mm().min_element();
            let choices = [
                None,
                Some(FilterTemplate::Gaussian { sigma_mm: (voxel * 100.0).round().max(1.0) / 100.0 }),
                Some(FilterTemplate::Median { radius_voxels: 1 }),
                Some(FilterTemplate::Anisotropic { edge: usual_edge(volume), iterations: 10 }),
            ];
            for choice in choices {
                let is_shown = text(choice.as_ref()) == text(shown.as_ref());
                if ui.selectable_label(is_shown, text(choice.as_ref())).clicked() && !is_shown {
                    wanted = with(choice.into_iter().collect());
                }
            }
        });
        combo.response.accessible_name(label).on_hover_text(tooltip);
    });
    // As it stands, and whether a number of it was let go.
    let set = shown.map(|filter| match filter {
        FilterTemplate::Gaussian { sigma_mm } => {
            let tooltip = "Standard deviation of the Gaussian";
            let (sigma_mm, is_set) = number(ui, "Width", tooltip, sigma_mm, " mm", 0.01, (1e-3, 1e3));
            (FilterTemplate::Gaussian { sigma_mm }, is_set)
        }
        FilterTemplate::Median { radius_voxels } => {
            let tooltip = "Voxels on either side that count";
            let limits = (1.0, MAX_RADIUS as f64);
            let (radius, is_set) = number(ui, "Radius", tooltip, radius_voxels as f64, " voxels", 0.02, limits);
            (FilterTemplate::Median { radius_voxels: radius.round() as usize }, is_set)
        }
        FilterTemplate::Anisotropic { edge, iterations } => {
            let tooltip = "Difference of neighboring voxels from which on there is an edge, in the scan's values";
            let most = volume.known_statistics().map_or(1e9, |s| s.max - s.min).max(1e-6);
            let (edge, has_edge) =
                number(ui, "Edge from", tooltip, edge, volume.modality.suffix(), 1e-3 * most, (1e-6 * most, most));
            let limits = (1.0, f64::from(MAX_ITERATIONS));
            let (steps, has_steps) =
                number(ui, "Steps", "More steps smooth more", f64::from(iterations), "", 0.1, limits);
            (FilterTemplate::Anisotropic { edge, iterations: steps.round() as u32 }, has_edge || has_steps)
        }
    });
    let filter = set.map(|(filter, _)| filter);
    let is_set = set.is_some_and(|(_, is_set)| is_set) && filter != shown;
    Filtering { wanted: wanted.or_else(|| filter.filter(|_| is_set).and_then(|filter| with(vec![filter]))), filter }
}

/// A twentieth of what the values of tissue differ by.
fn usual_edge(volume: &Volume) -> f64 {
    let edge = volume
        .known_statistics()
        .map_or(50.0, |s| (s.percentile_above_background(98.0) - s.percentile_above_background(2.0)) / 20.0);
    if edge > 0.0 { edge } else { 1.0 }
}

/// A number as it stands, and whether it is let go: each costs a pass over the volume.
fn number(
    ui: &mut Ui,
    label: &str,
    tooltip: &str,
    value: f64,
    suffix: &str,
    speed: f64,
    (least, most): (f64, f64),
) -> (f64, bool) {
    let id = ui.scope_id().with(("noise", label));
    let mut number = ui.data(|d| d.get_temp(id)).unwrap_or(value);
    let response = row(ui, label, tooltip, |ui, label| {
        let field =
            DragValue::new(&mut number).speed(speed).range(least..=most).max_decimals(3).update_while_editing(false);
        ui.add(field.suffix(suffix).custom_parser(parse_number)).accessible_name(label).on_hover_text(tooltip)
    });
    if response.dragged() {
        ui.data_mut(|d| d.insert_temp(id, number));
        return (number, false);
    }
    ui.data_mut(|d| d.remove_temp::<f64>(id));
    (number, true)
}
