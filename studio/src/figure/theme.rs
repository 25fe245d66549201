//! Themes: other looks for a whole figure (thesis §3.3.7, fig. 3.11). The styles that a figure names are taken for roles
//! ("bone", "vessel"), and a theme says what each is drawn in, on which page and with which lines. The figure itself stays as it
//! is: without the theme it looks as before.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use fabrica_engine::Error;
use fabrica_engine::color::linear_from_srgb8;
use fabrica_engine::styles::StyleLibrary;
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

/// The file `styles/themes.json`, and a file of the user's own themes.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// Styles that stand for the same as another: what themes say of that holds for them.
    #[serde(default)]
    stands_for: BTreeMap<String, String>,
    themes: Vec<Theme>,
}

/// The name of a file of themes in a folder of styles.
pub const FILE_NAME: &str = "themes.json";

static BUILT_IN: LazyLock<Themes> = LazyLock::new(|| {
    // A fault here is one of the build; the tests find it.
    let file: File = serde_json::from_str(include_str!("../../../styles/themes.json")).unwrap_or_default();
    Themes { all: file.themes.into_iter().map(Arc::new).collect(), stands_for: file.stands_for }
});

/// The themes that figures can be drawn in: those that come along, and the user's own.
#[derive(Clone, Debug)]
pub struct Themes {
    all: Vec<Arc<Theme>>,
    stands_for: BTreeMap<String, String>,
}

impl Themes {
    /// Those that come along.
    pub fn built_in() -> &'static Self {
        &BUILT_IN
    }

    /// With those of the file `themes.json` of a folder of styles, if there is one: of the same form as `styles/themes.json`, after
    /// those that are there. What it says that styles stand for holds for all themes. `styles`: what there is to draw in.
    ///
    /// # Errors
    /// [`Error::File`] in one sentence if it cannot be read, is of another form, has a name that another theme has, or a style that
    /// there is not.
    pub fn with_folder(mut self, folder: &Path, styles: &StyleLibrary) -> fabrica_engine::Result<Self> {
        let path = folder.join(FILE_NAME);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(self),
            Err(error) => return Err(Error::io(&path, &error)),
        };
        let file: File = serde_json::from_str(&text).map_err(|error| {
            Error::file(&path, format!("these are no themes: {error}"), "write them as those of styles/themes.json")
        })?;
        let known = |style: &String, of: &str| match styles.info(style) {
            Ok(_) => Ok(()),
            Err(_) => Err(Error::file(
                &path,
                format!("{of} has the style \"{style}\", which there is not"),
                "see `fabrica styles` for names, or put the picture beside the file",
            )),
        };
        for (style, role) in &file.stands_for {
            known(role, &format!("what \"{style}\" stands for"))?;
            // What stands for another in turn would not be found there.
            let role = self.stands_for.get(role).unwrap_or(role).clone();
            self.stands_for.insert(style.clone(), role);
        }
        for theme in file.themes {
            let of = format!("the theme \"{}\"", theme.name);
            if theme.name.is_empty() || theme.name == NO_THEME || self.named(&theme.name).is_ok() {
                let fault = if theme.name.is_empty() || theme.name == NO_THEME { "no theme's" } else { "taken" };
                return Err(Error::file(&path, format!("the name of {of} is {fault}"), "call it something else"));
            }
            let tinted = match &theme.tints {
                Tints::Styles(styles) => Some(styles.keys()),
                Tints::Keep | Tints::Drop => None,
            };
            for style in theme.styles.values().chain(&theme.otherwise).chain(tinted.into_iter().flatten()) {
                known(style, &of)?;
            }
            theme.shading.check(&of).map_err(|fault| Error::file(&path, fault.to_string(), "change it there"))?;
            self.all.push(Arc::new(theme));
        }
        Ok(self)
    }

    /// Every theme, in the order in which they are offered.
    pub fn all(&self) -> &[Arc<Theme>] {
        &self.all
    }

    /// The theme of that name.
    ///
    /// # Errors
    /// One sentence with the names that there are.
    pub fn named(&self, name: &str) -> Result<&Arc<Theme>, String> {
        self.all.iter().find(|theme| theme.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.all.iter().map(|theme| theme.name.as_str()).collect();
            format!("there is no theme \"{name}\"; choose one of {}", names.join(", "))
        })
    }

    /// The theme that a figure is drawn in.
    ///
    /// # Errors
    /// As [`Themes::named`]; the figure can be drawn without it.
    pub fn of(&self, figure: &Template) -> Result<Option<&Arc<Theme>>, String> {
        figure.theme.as_deref().map(|name| self.named(name)).transpose()
    }

    /// The background that a figure is drawn on: its theme's, or its own.
    pub fn background(&self, figure: &Template) -> Background {
        self.of(figure).ok().flatten().and_then(|theme| theme.background).unwrap_or(figure.background)
    }

    /// The style that a theme draws where a figure names `style`: by its name, by what it stands for, or the one for all others.
    pub fn style<'a>(&'a self, theme: &'a Theme, style: &'a str) -> &'a str {
        let role = || self.stands_for.get(style).and_then(|role| theme.styles.get(role));
        theme.styles.get(style).or_else(role).or(theme.otherwise.as_ref()).map_or(style, String::as_str)
    }

    /// Whether a style lets through what lies behind it, as glass.
    pub fn is_veil(&self, style: &str) -> bool {
        const VEIL: &str = "glass";
        style == VEIL || self.stands_for.get(style).is_some_and(|role| role == VEIL)
    }
}

/// What stands for no theme where one is named.
pub const NO_THEME: &str = "none";

/// All that figures can be drawn in.
#[derive(Clone, Copy, Debug)]
pub struct Wardrobe<'a> {
    /// What templates' styles are.
    pub styles: &'a StyleLibrary,
    /// What templates' themes are.
    pub themes: &'a Themes,
}

impl<'a> From<&'a StyleLibrary> for Wardrobe<'a> {
    /// With the themes that come along.
    fn from(styles: &'a StyleLibrary) -> Self {
        Self { styles, themes: Themes::built_in() }
    }
}

impl Theme {
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
        let themes = Themes::built_in();
        for theme in themes.all() {
            assert!(!theme.title.is_empty() && !theme.description.is_empty());
            assert_eq!(themes.all().iter().filter(|other| other.name == theme.name).count(), 1, "{}", theme.name);
            theme.shading.check(&theme.name).unwrap();
            theme.styles.iter().for_each(|(role, style)| {
                known(role);
                known(style);
            });
            library.names().into_iter().for_each(|style| known(themes.style(theme, style)));
            // Each names what stands for itself, so that no shipped style is forgotten.
            let forgotten = |style: &&str| !file.stands_for.contains_key(*style) && !theme.styles.contains_key(*style);
            let forgotten: Vec<&str> = library.names().into_iter().filter(forgotten).collect();
            assert!(forgotten.is_empty(), "{} says nothing of {forgotten:?}", theme.name);
            // What is drawn is drawn in itself: a theme's own styles, named by hand, stay in the theme.
            for drawn in theme.styles.values() {
                assert!(
                    theme.styles.values().any(|style| style == themes.style(theme, drawn)),
                    "{} {drawn}",
                    theme.name
                );
            }
        }
    }

    #[test]
    fn styles_are_found_by_name_then_by_what_they_stand_for() {
        let themes = Themes::built_in();
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
            ["bone", "watercolor_bone", "tone_red", "skin", "my_own"].map(|s| themes.style(&theme, s)),
            ["ink", "ink", "wax", "skin", "my_own"]
        );
        let theme = Theme { otherwise: Some("clay".to_owned()), ..theme };
        assert_eq!(["bone", "skin", "my_own"].map(|s| themes.style(&theme, s)), ["ink", "clay", "clay"]);
        assert!(themes.named("chalk").unwrap_err().contains("choose one of"));
    }

    #[test]
    fn tints_go_to_the_style_of_the_nearest_color() {
        let themes = Themes::built_in();
        for theme in themes.all() {
            let Tints::Styles(styles) = &theme.tints else { continue };
            for (style, color) in styles {
                assert_eq!(theme.dress(color.0, false), (Some(style.as_str()), None));
                // It is drawn in itself, and not taken for a role in turn.
                assert_eq!(themes.style(theme, style), style, "{}", theme.name);
            }
        }
        let theme = themes.named("color_blind_safe").unwrap();
        let nearest = |color: [u8; 3]| theme.dress(color, false).0.unwrap();
        // Blood red and blood blue, a leaf, bone.
        assert_eq!(nearest([216, 57, 43]), "matte_vermilion");
        assert_eq!(nearest([40, 90, 190]), "matte_blue");
        assert_eq!(nearest([60, 160, 90]), "matte_green");
        assert_eq!(nearest([244, 232, 220]), "plaster");
        // What lies behind a veil stays to be seen.
        assert!(themes.is_veil("glass") && themes.is_veil("smoke") && !themes.is_veil("bone"));
        assert_eq!(theme.dress([9, 9, 9], true), (None, Some([9, 9, 9])));
        assert_eq!(themes.named("xray").unwrap().dress([9, 9, 9], false), (None, None));
    }

    #[test]
    fn own_themes_are_added_and_their_faults_named() {
        let folder = std::env::temp_dir().join(format!("fabrica-themes-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let library = StyleLibrary::embedded();
        let with = |text: &str| {
            std::fs::write(folder.join(FILE_NAME), text).unwrap();
            Themes::built_in().clone().with_folder(&folder, &library).map_err(|e| e.to_string())
        };
        let theme = |name: &str, rest: &str| {
            format!(r#"{{"themes": [{{"name": "{name}", "title": "Mine", "description": "x", "styles": {rest}}}]}}"#)
        };
        let own = with(&theme("mine", r#"{"bone": "ink", "glass": "smoke"}"#)).unwrap();
        assert_eq!(own.all().len(), Themes::built_in().all().len() + 1);
        let mine = own.named("mine").unwrap();
        assert_eq!(
            [own.style(mine, "bone"), own.style(mine, "sepia"), own.style(mine, "skin")],
            ["ink", "ink", "skin"]
        );
        let roles = r#"{"stands_for": {"moss": "chalk"}, "themes": []}"#;
        assert!(with(roles).unwrap().is_veil("moss"));
        for (text, fault) in [
            (theme("watercolor", "{}"), "the name of the theme \"watercolor\" is taken"),
            (theme("none", "{}"), "is no theme's"),
            (theme("mine", r#"{"bone": "moss"}"#), "the theme \"mine\" has the style \"moss\", which there is not"),
            (theme("mine", r#"{}, "otherwise": "moss""#), "the style \"moss\""),
            (theme("mine", r##"{}, "tints": {"styles": {"moss": "#ffffff"}}"##), "the style \"moss\""),
            (theme("mine", r#"{}, "shading": {"contours": {"width_pt": -1}}"#), "the theme \"mine\""),
            (theme("mine", r#"{}, "page": 1"#), "these are no themes"),
            (r#"{"stands_for": {"moss": "fern"}, "themes": []}"#.to_owned(), "\"fern\""),
            ("{".to_owned(), "these are no themes"),
        ] {
            let said = with(&text).unwrap_err();
            assert!(said.contains(fault) && said.contains(FILE_NAME) && !said.contains('\n'), "{text}: {said}");
        }
        // A folder without the file has no themes.
        std::fs::remove_dir_all(&folder).unwrap();
        let none = Themes::built_in().clone().with_folder(&folder, &library).unwrap();
        assert_eq!(none.all().len(), Themes::built_in().all().len());
    }
}
