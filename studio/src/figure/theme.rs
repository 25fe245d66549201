//! Themes: other looks for a whole figure (thesis §3.3.7, fig. 3.11). The styles that a figure names are taken for roles
//! ("bone", "vessel"), and a theme says what each is drawn in, on which page and with which lines. The figure itself stays as it
//! is: without the theme it looks as before.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use fabrica_engine::color::linear_from_srgb8;
use serde::{Deserialize, Serialize};

use super::template::{Background, Rgb, ShadingTemplate, Template};

/// What a figure is drawn in when it has this theme.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Theme {
    /// What templates call it.
    pub name: String,
    /// What people call it.
    pub title: String,
    /// One line on the look and its use.
    pub description: String,
    /// A style that figures name → the style that is drawn.
    pub styles: BTreeMap<String, String>,
    /// What all others are drawn in; none: they stay.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub otherwise: Option<String>,
    /// In place of the figure's own; none: that stays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub background: Option<Background>,
    /// What holds where neither a region nor its object says anything.
    #[serde(default, skip_serializing_if = "ShadingTemplate::is_default")]
    pub shading: ShadingTemplate,
    /// What becomes of tints.
    #[serde(default, skip_serializing_if = "Tints::is_default")]
    pub tints: Tints,
}

/// What a theme makes of the tints of regions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tints {
    /// They stay.
    #[default]
    Keep,
    /// There are none: all is drawn in the styles' own colors.
    Drop,
    /// What has a tint is drawn in one of these styles instead: the one whose color here comes nearest to it. A tint would leave of a
    /// style's colors its light alone: no paper between washes, no ink on paper.
    Styles(BTreeMap<String, Rgb>),
}

impl Tints {
    fn is_default(&self) -> bool {
        *self == Self::Keep
    }
}

/// The file `styles/themes.json`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// Styles that stand for the same as another: what themes say of that holds for them.
    stands_for: BTreeMap<String, String>,
    themes: Vec<Theme>,
}

static FILE: LazyLock<File> = LazyLock::new(|| {
    // A fault here is one of the build; the tests find it.
    serde_json::from_str(include_str!("../../../styles/themes.json")).unwrap_or_default()
});

/// Every theme, in the order in which they are offered.
pub fn all() -> &'static [Theme] {
    &FILE.themes
}

/// The theme of that name.
///
/// # Errors
/// One sentence with the names that there are.
pub fn named(name: &str) -> Result<&'static Theme, String> {
    all().iter().find(|theme| theme.name == name).ok_or_else(|| {
        let names: Vec<&str> = all().iter().map(|theme| theme.name.as_str()).collect();
        format!("there is no theme \"{name}\"; choose one of {}", names.join(", "))
    })
}

/// The theme that a figure is drawn in.
///
/// # Errors
/// As [`named`]; the figure can be drawn without it.
pub fn of(figure: &Template) -> Result<Option<&'static Theme>, String> {
    figure.theme.as_deref().map(named).transpose()
}

/// The background that a figure is drawn on: its theme's, or its own.
pub fn background(figure: &Template) -> Background {
    of(figure).ok().flatten().and_then(|theme| theme.background).unwrap_or(figure.background)
}

impl Theme {
    /// The style that is drawn where a figure names `style`: by its name, by what it stands for, or the one for all others.
    pub fn style<'a>(&'a self, style: &'a str) -> &'a str {
        let role = || FILE.stands_for.get(style).and_then(|role| self.styles.get(role));
        self.styles.get(style).or_else(role).or(self.otherwise.as_ref()).map_or(style, String::as_str)
    }

    /// The style and the tint of something that has the tint `color`; `is_veil`: its styles let through what lies behind, as no
    /// style that stands for a tint does. No style: those that it names.
    pub fn dress(&self, color: [u8; 3], is_veil: bool) -> (Option<&str>, Option<[u8; 3]>) {
        match &self.tints {
            Tints::Drop => (None, None),
            Tints::Styles(styles) if !is_veil => {
                let distance = |of: &Rgb| difference(of.0, color);
                let nearest = styles.iter().min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
                (nearest.map(|(style, _)| style.as_str()), None)
            }
            Tints::Keep | Tints::Styles(_) => (None, Some(color)),
        }
    }
}

/// Whether a style lets through what lies behind it, as glass.
pub fn is_veil(style: &str) -> bool {
    const VEIL: &str = "glass";
    style == VEIL || FILE.stands_for.get(style).is_some_and(|role| role == VEIL)
}

/// How different two sRGB colors look: squared distance in Oklab (Ottosson 2020), whose hues count four times their lightness, as tints
/// are told apart by hue when they are shaded.
fn difference(a: [u8; 3], b: [u8; 3]) -> f64 {
    let [a, b] = [a, b].map(oklab);
    let d: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
    0.25 * d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

fn oklab(color: [u8; 3]) -> [f64; 3] {
    let [r, g, b] = color.map(|c| f64::from(linear_from_srgb8(c)));
    let l = (0.412_221_470_8 * r + 0.536_332_536_3 * g + 0.051_445_992_9 * b).cbrt();
    let m = (0.211_903_498_2 * r + 0.680_699_545_1 * g + 0.107_396_956_6 * b).cbrt();
    let s = (0.088_302_461_9 * r + 0.281_718_837_6 * g + 0.629_978_700_5 * b).cbrt();
    [
        0.210_454_255_3 * l + 0.793_617_785_0 * m - 0.004_072_046_8 * s,
        1.977_998_495_1 * l - 2.428_592_205_0 * m + 0.450_593_709_9 * s,
        0.025_904_037_1 * l + 0.782_771_766_2 * m - 0.808_675_766_0 * s,
    ]
}

#[cfg(test)]
mod tests {
    use fabrica_engine::styles::StyleLibrary;

    use super::*;

    #[test]
    fn every_themes_styles_exist() {
        // Parsed here, as a fault in the file would leave no theme at all.
        let file: File = serde_json::from_str(include_str!("../../../styles/themes.json")).unwrap();
        let library = StyleLibrary::embedded();
        let known = |name: &str| assert!(library.info(name).is_ok(), "there is no style {name}");
        assert!(file.themes.len() >= 7);
        for (style, role) in &file.stands_for {
            known(style);
            known(role);
            assert!(!file.stands_for.contains_key(role), "{style} stands for {role}, which stands for another");
        }
        for theme in all() {
            assert!(!theme.title.is_empty() && !theme.description.is_empty());
            assert_eq!(all().iter().filter(|other| other.name == theme.name).count(), 1, "{}", theme.name);
            theme.shading.check(&theme.name).unwrap();
            theme.styles.iter().for_each(|(role, style)| {
                known(role);
                known(style);
            });
            library.names().into_iter().for_each(|style| known(theme.style(style)));
            // Each names what stands for itself, so that no shipped style is forgotten.
            let forgotten = |style: &&str| !file.stands_for.contains_key(*style) && !theme.styles.contains_key(*style);
            let forgotten: Vec<&str> = library.names().into_iter().filter(forgotten).collect();
            assert!(forgotten.is_empty(), "{} says nothing of {forgotten:?}", theme.name);
            // What is drawn is drawn in itself: a theme's own styles, named by hand, stay in the theme.
            for drawn in theme.styles.values() {
                assert!(theme.styles.values().any(|style| style == theme.style(drawn)), "{} {drawn}", theme.name);
            }
        }
    }

    #[test]
    fn styles_are_found_by_name_then_by_what_they_stand_for() {
        let theme = Theme {
            styles: [("bone", "ink"), ("vessel", "wax")].map(|(a, b)| (a.to_owned(), b.to_owned())).into(),
            ..Theme {
                name: "test".to_owned(),
                title: "Test".to_owned(),
                description: String::new(),
                styles: BTreeMap::new(),
                otherwise: None,
                background: None,
                shading: ShadingTemplate::default(),
                tints: Tints::Keep,
            }
        };
        assert_eq!(
            ["bone", "watercolor_bone", "tone_red", "skin", "my_own"].map(|s| theme.style(s)),
            ["ink", "ink", "wax", "skin", "my_own"]
        );
        let theme = Theme { otherwise: Some("clay".to_owned()), ..theme };
        assert_eq!(["bone", "skin", "my_own"].map(|s| theme.style(s)), ["ink", "clay", "clay"]);
        assert!(named("chalk").unwrap_err().contains("choose one of"));
    }

    #[test]
    fn tints_go_to_the_style_of_the_nearest_color() {
        for theme in all() {
            let Tints::Styles(styles) = &theme.tints else { continue };
            for (style, color) in styles {
                assert_eq!(theme.dress(color.0, false), (Some(style.as_str()), None));
                // It is drawn in itself, and not taken for a role in turn.
                assert_eq!(theme.style(style), style, "{}", theme.name);
            }
        }
        let theme = named("color_blind_safe").unwrap();
        let nearest = |color: [u8; 3]| theme.dress(color, false).0.unwrap();
        // Blood red and blood blue, a leaf, bone.
        assert_eq!(nearest([216, 57, 43]), "matte_vermilion");
        assert_eq!(nearest([40, 90, 190]), "matte_blue");
        assert_eq!(nearest([60, 160, 90]), "matte_green");
        assert_eq!(nearest([244, 232, 220]), "plaster");
        // What lies behind a veil stays to be seen.
        assert!(is_veil("glass") && is_veil("smoke") && !is_veil("bone"));
        assert_eq!(theme.dress([9, 9, 9], true), (None, Some([9, 9, 9])));
        assert_eq!(named("xray").unwrap().dress([9, 9, 9], false), (None, None));
    }
}
