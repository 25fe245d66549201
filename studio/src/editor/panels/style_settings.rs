//! The sliders of the styles that the chosen object is drawn with.

use eframe::egui::{Slider, Ui};
use fabrica_engine::styles::file::Knob;

use super::super::open_figure::OpenFigure;
use super::super::theme;
use super::properties::row;
use crate::figure::Command;
use crate::figure::style_settings::styles_of;
use crate::figure::theme::Wardrobe;

/// The rows: nothing where no style has sliders.
pub fn show(ui: &mut Ui, open: &mut OpenFigure, Wardrobe { styles: library, themes }: Wardrobe<'_>) {
    let Some(object) = open.chosen() else { return };
    for style in styles_of(open.document.figure(), object, themes) {
        // A style file that cannot be read is a fault of the picture, which says so.
        let sliders = library.sliders(&style).unwrap_or_default();
        if sliders.is_empty() {
            continue;
        }
        let title = library.info(&style).map_or(style.clone(), |info| info.title.clone());
        ui.label(theme::small(ui.ctx(), format!("Style {title}")));
        for slider in sliders {
            let said = open.document.figure().style_settings.get(&style).and_then(|s| s.get(&slider.name)).copied();
            let mut value = said.unwrap_or(slider.value);
            let set = |value| Command::SetSlider { style: style.clone(), slider: slider.name.clone(), value };
            let response = row(ui, &slider.name, tooltip(slider.of), |ui, label| {
                ui.spacing_mut().slider_width = 90.0;
                let mut shown = Slider::new(&mut value, slider.min..=slider.max).max_decimals(2);
                if slider.of == Knob::Layers {
                    shown = shown.integer();
                }
                ui.add(shown).accessible_name(format!("{label} of {title}")).on_hover_text(tooltip(slider.of))
            });
            open.edit_by(&response, response.changed().then(|| set(Some(value))));
            let mut is_reset = false;
            response.context_menu(|ui| {
                let button = eframe::egui::Button::new("Reset to the style's own");
                if ui.add_enabled(said.is_some(), button).clicked() {
                    is_reset = true;
                    ui.close();
                }
            });
            if is_reset {
                open.edit(set(None));
            }
        }
    }
}

fn tooltip(of: Knob) -> &'static str {
    match of {
        Knob::Spacing => {
            "Distance of strokes on the page, in points. Fixed on the object, it is met within a half and twice as much"
        }
        Knob::Layers => "How many ways lines cross where it is dark",
        Knob::PaperOpacity => "How opaque the paper between strokes is",
        Knob::Hue => "Degrees that the style's hue is turned by",
        Knob::Lightness => "How much lighter the style is than its picture",
        Knob::Contrast => "How much stronger light and shade are than in its picture",
        Knob::Opacity => "How opaque the style is, of its picture's opacity",
    }
}
