//! The filter against noise of the chosen object's volume.

use eframe::egui::{ComboBox, DragValue, Ui};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::filter::{MAX_ITERATIONS, MAX_RADIUS};

use super::properties::{parse_number, row};
use crate::figure::template::{FilterTemplate, VolumeSlot};

/// The rows, and the slot as it shall be read.
pub fn show(ui: &mut Ui, slot: &VolumeSlot, volume: &Volume) -> Option<VolumeSlot> {
    let tooltip = "Filters what was read; the file stays as it is, and undo takes it back";
    let with = |filters: Vec<FilterTemplate>| Some(VolumeSlot { filters, ..slot.clone() });
    let mut wanted = None;
    if slot.filters.len() > 1 {
        row(ui, "Noise filter", tooltip, |ui, _| ui.label(format!("{} filters", slot.filters.len())));
        return None;
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
    let changed = match shown {
        None => None,
        Some(FilterTemplate::Gaussian { sigma_mm }) => {
            let sigma = number(ui, "Width", "Standard deviation of the Gaussian", sigma_mm, " mm", 0.01, (1e-3, 1e3));
            sigma.map(|sigma_mm| FilterTemplate::Gaussian { sigma_mm })
        }
        Some(FilterTemplate::Median { radius_voxels }) => {
            let tooltip = "Voxels on either side that count";
            let radius = number(ui, "Radius", tooltip, radius_voxels as f64, " voxels", 0.02, (1.0, MAX_RADIUS as f64));
            radius.map(|radius| FilterTemplate::Median { radius_voxels: radius.round() as usize })
        }
        Some(FilterTemplate::Anisotropic { edge, iterations }) => {
            let tooltip = "Difference of neighboring voxels from which on there is an edge, in the scan's values";
            let most = volume.known_statistics().map_or(1e9, |s| s.max - s.min).max(1e-6);
            let new_edge =
                number(ui, "Edge from", tooltip, edge, volume.modality.suffix(), 1e-3 * most, (1e-6 * most, most));
            let tooltip = "More steps smooth more";
            let limits = (1.0, f64::from(MAX_ITERATIONS));
            let steps = number(ui, "Steps", tooltip, f64::from(iterations), "", 0.1, limits);
            let by_edge = new_edge.map(|edge| FilterTemplate::Anisotropic { edge, iterations });
            by_edge.or(steps.map(|n| FilterTemplate::Anisotropic { edge, iterations: n.round() as u32 }))
        }
    };
    wanted.or(changed.and_then(|filter| with(vec![filter])))
}

/// A twentieth of what the values of tissue differ by.
fn usual_edge(volume: &Volume) -> f64 {
    let edge = volume
        .known_statistics()
        .map_or(50.0, |s| (s.percentile_above_background(98.0) - s.percentile_above_background(2.0)) / 20.0);
    if edge > 0.0 { edge } else { 1.0 }
}

/// A number; its new value once it is let go, as each costs a pass over the volume.
fn number(
    ui: &mut Ui,
    label: &str,
    tooltip: &str,
    value: f64,
    suffix: &str,
    speed: f64,
    (least, most): (f64, f64),
) -> Option<f64> {
    let id = ui.scope_id().with(("noise", label));
    let mut number = ui.data(|d| d.get_temp(id)).unwrap_or(value);
    let response = row(ui, label, tooltip, |ui, label| {
        let field =
            DragValue::new(&mut number).speed(speed).range(least..=most).max_decimals(3).update_while_editing(false);
        ui.add(field.suffix(suffix).custom_parser(parse_number)).accessible_name(label).on_hover_text(tooltip)
    });
    if response.dragged() {
        ui.data_mut(|d| d.insert_temp(id, number));
        return None;
    }
    ui.data_mut(|d| d.remove_temp::<f64>(id));
    (number != value).then_some(number)
}
