//! What a figure says of the sliders that its styles have.

use std::collections::{BTreeMap, BTreeSet};

use fabrica_engine::styles::file::SliderValues;

use super::template::{LookTemplate, ObjectTemplate, Template, TransferFunctionTemplate};
use super::theme::Themes;

/// Values of sliders, by the style's name and the slider's.
pub type StyleSettings = BTreeMap<String, SliderValues>;

/// Puts a slider of a style at a value; none: at the style's own.
pub fn set(settings: &mut StyleSettings, style: &str, slider: &str, value: Option<f64>) {
    match value {
        Some(value) => {
            settings.entry(style.to_owned()).or_default().insert(slider.to_owned(), value);
        }
        None => {
            if let Some(values) = settings.get_mut(style) {
                values.remove(slider);
            }
            settings.retain(|_, values| !values.is_empty());
        }
    }
}

/// The styles that an object is drawn with, as the figure's theme has them.
pub fn styles_of(figure: &Template, object: &ObjectTemplate, themes: &Themes) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let add_function = |function: &TransferFunctionTemplate, names: &mut BTreeSet<String>| {
        names.extend(function.all_nodes().map(|node| node.style.clone()));
    };
    add_function(&object.transfer_function, &mut names);
    let mut add_look = |look: &LookTemplate| {
        names.extend(look.style.clone());
        if let Some(function) = &look.transfer_function {
            add_function(function, &mut names);
        }
    };
    for region in &object.regions {
        add_look(&region.look);
        region.structures.iter().for_each(|structure| add_look(&structure.look));
    }
    let theme = themes.of(figure).ok().flatten();
    names.into_iter().map(|name| theme.map_or(name.as_str(), |theme| themes.style(theme, &name)).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_at_the_styles_own_value_is_not_said() {
        let mut settings = StyleSettings::new();
        set(&mut settings, "hatched", "Spacing", Some(4.0));
        set(&mut settings, "hatched", "Contrast", Some(1.5));
        assert_eq!(settings["hatched"]["Spacing"], 4.0);
        set(&mut settings, "hatched", "Spacing", None);
        set(&mut settings, "hatched", "Spacing", None);
        set(&mut settings, "stippled", "Spacing", None);
        assert_eq!(settings["hatched"].len(), 1);
        set(&mut settings, "hatched", "Contrast", None);
        assert!(settings.is_empty());
    }

    #[test]
    fn styles_of_an_object_are_those_that_it_is_drawn_with() {
        let mut figure = crate::figure::shipped::SHIPPED[0].figure();
        let names = |figure: &Template| styles_of(figure, &figure.objects[0], Themes::built_in());
        assert!(names(&figure).contains("bone"), "{:?}", names(&figure));
        figure.theme = Some("xray".to_owned());
        assert!(!names(&figure).contains("bone"), "{:?}", names(&figure));
    }
}
