//! Style files: `name.json` beside or in place of a picture. One names a sphere, what its tone is drawn with, and the sliders that it
//! has (docs/rendering.md §4, "Style files").

use std::collections::BTreeMap;

use glam::DVec3;
use serde::Deserialize;

use super::StyleImage;
use super::pattern::{Direction, Pattern, Strokes, luminance};
use crate::color::linear_from_srgb8;
use crate::error::{Error, Result};

/// Values of a style's sliders, by name: what differs from the file's own.
pub type SliderValues = BTreeMap<String, f64>;

/// A style file as it was read.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StyleFile {
    /// Human-readable title; the file's name, if there is none.
    #[serde(default)]
    pub title: String,
    /// One line on the look and its use.
    #[serde(default)]
    pub description: String,
    /// Words to search by.
    #[serde(default)]
    pub tags: Vec<String>,
    /// A picture beside the file, with its ending, or another style's name.
    pub sphere: String,
    /// What the sphere's tone is drawn with.
    #[serde(default)]
    pattern: Option<PatternFile>,
    /// What the user can change.
    #[serde(default)]
    pub sliders: Vec<Slider>,
}

/// A number of a style that the user can change.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slider {
    /// What it is called.
    pub name: String,
    /// What it is of.
    pub of: Knob,
    /// The smallest value.
    pub min: f64,
    /// The largest one.
    pub max: f64,
    /// The style's own.
    pub value: f64,
}

/// What a slider changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum Knob {
    /// Spacing of strokes, in figure points.
    #[serde(rename = "pattern.spacing_pt")]
    Spacing,
    /// How many ways lines cross, 1 to 3; whole numbers.
    #[serde(rename = "pattern.layers")]
    Layers,
    /// Opacity of the paper, 0 to 1.
    #[serde(rename = "pattern.paper_opacity")]
    PaperOpacity,
    /// Degrees that the sphere's hue is turned by.
    #[serde(rename = "sphere.hue")]
    Hue,
    /// What is added to the sphere's lightness, which goes from 0 to 1.
    #[serde(rename = "sphere.lightness")]
    Lightness,
    /// Factor of the sphere's lightness about the middle.
    #[serde(rename = "sphere.contrast")]
    Contrast,
    /// Factor of the sphere's opacity, 0 to 1.
    #[serde(rename = "sphere.opacity")]
    Opacity,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct PatternFile {
    strokes: StrokesFile,
    #[serde(default)]
    direction: DirectionFile,
    #[serde(default = "one")]
    layers: u32,
    spacing_pt: f64,
    #[serde(default = "black")]
    ink: String,
    #[serde(default = "white")]
    paper: String,
    #[serde(default = "opaque")]
    paper_opacity: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum StrokesFile {
    Hatching,
    Stipple,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
enum DirectionFile {
    Named(NamedDirection),
    Axis([f64; 3]),
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum NamedDirection {
    Light,
    Around,
    Along,
}

impl Default for DirectionFile {
    fn default() -> Self {
        Self::Axis([0.0, 0.0, 1.0])
    }
}

fn one() -> u32 {
    1
}

fn black() -> String {
    "#000000".to_owned()
}

fn white() -> String {
    "#ffffff".to_owned()
}

fn opaque() -> f64 {
    1.0
}

impl PatternFile {
    fn pattern(&self, name: &str) -> Result<Pattern> {
        let strokes = match self.strokes {
            StrokesFile::Stipple => Strokes::Stipple,
            StrokesFile::Hatching => {
                let direction = match self.direction {
                    DirectionFile::Axis(axis) => Direction::Axis(DVec3::from_array(axis)),
                    DirectionFile::Named(NamedDirection::Light) => Direction::Light,
                    DirectionFile::Named(NamedDirection::Around) => Direction::Around,
                    DirectionFile::Named(NamedDirection::Along) => Direction::Along,
                };
                Strokes::Hatching { direction, layers: self.layers }
            }
        };
        Ok(Pattern {
            strokes,
            spacing_pt: self.spacing_pt,
            ink: color(name, &self.ink)?,
            paper: color(name, &self.paper)?,
            paper_opacity: self.paper_opacity,
        })
    }
}

/// Linear RGB of "#rrggbb".
fn color(name: &str, text: &str) -> Result<[f32; 3]> {
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6);
    let number = digits.and_then(|digits| u32::from_str_radix(digits, 16).ok());
    let number = number.ok_or_else(|| {
        Error::scene(format!("the style \"{name}\" has the color \"{text}\""), "give colors as \"#rrggbb\"")
    })?;
    Ok([16, 8, 0].map(|shift| linear_from_srgb8((number >> shift) as u8)))
}

impl StyleFile {
    /// Reads the text of a file; what is of no use is refused here. `name`: of the style.
    ///
    /// # Errors
    /// [`Error::Scene`] for a text that is not a style file, or with values that no style has.
    pub fn parse(name: &str, text: &str) -> Result<Self> {
        let file: Self = serde_json::from_str(text).map_err(|error| {
            Error::scene(format!("the style file \"{name}\" cannot be read: {error}"), "correct it, or take it away")
        })?;
        for (i, slider) in file.sliders.iter().enumerate() {
            let Slider { name: called, of, min, max, value } = slider;
            let fail = |what: String| {
                Err(Error::scene(
                    format!("the slider \"{called}\" of the style \"{name}\" {what}"),
                    "correct the style file",
                ))
            };
            if !(min.is_finite() && max.is_finite() && min < max && (*min..=*max).contains(value)) {
                return fail(format!("goes from {min} to {max} and is at {value}"));
            }
            if file.sliders[..i].iter().any(|other| other.name == *called) {
                return fail("is there twice".to_owned());
            }
            let is_of_pattern = matches!(of, Knob::Spacing | Knob::Layers | Knob::PaperOpacity);
            if is_of_pattern && file.pattern.is_none() {
                return fail("is of a pattern, which the style has not".to_owned());
            }
        }
        if let Some(pattern) = &file.pattern {
            pattern.pattern(name)?.validate(name)?;
        }
        // At both ends of every slider: none leads to what cannot be drawn.
        file.drawn(name, &SliderValues::new())?;
        for slider in &file.sliders {
            for end in [slider.min, slider.max] {
                file.drawn(name, &SliderValues::from([(slider.name.clone(), end)]))?;
            }
        }
        Ok(file)
    }

    /// The pattern with these values, and how the sphere is adjusted.
    fn drawn(&self, name: &str, values: &SliderValues) -> Result<(Option<Pattern>, Adjustment)> {
        let known = |called: &String| self.sliders.iter().find(|slider| slider.name == *called);
        for (called, value) in values {
            let Some(slider) = known(called) else {
                let all: Vec<&str> = self.sliders.iter().map(|slider| slider.name.as_str()).collect();
                let remedy =
                    if all.is_empty() { "it has none".to_owned() } else { format!("it has {}", all.join(", ")) };
                return Err(Error::scene(format!("the style \"{name}\" has no slider \"{called}\""), remedy));
            };
            if !(slider.min..=slider.max).contains(value) {
                return Err(Error::scene(
                    format!("the slider \"{called}\" of the style \"{name}\" is at {value}"),
                    format!("choose a value from {} to {}", slider.min, slider.max),
                ));
            }
        }
        let mut pattern = self.pattern.as_ref().map(|pattern| pattern.pattern(name)).transpose()?;
        let mut adjustment = Adjustment::NONE;
        for slider in &self.sliders {
            let value = values.get(&slider.name).copied().unwrap_or(slider.value);
            match (slider.of, &mut pattern) {
                (Knob::Spacing, Some(pattern)) => pattern.spacing_pt = value,
                (Knob::PaperOpacity, Some(pattern)) => pattern.paper_opacity = value,
                (Knob::Layers, Some(pattern)) => {
                    if let Strokes::Hatching { layers, .. } = &mut pattern.strokes {
                        *layers = value.round() as u32;
                    }
                }
                (Knob::Hue, _) => adjustment.hue_deg = value,
                (Knob::Lightness, _) => adjustment.lightness = value,
                (Knob::Contrast, _) => adjustment.contrast = value,
                (Knob::Opacity, _) => adjustment.opacity = value,
                (_, None) => {}
            }
        }
        pattern.as_ref().map_or(Ok(()), |pattern| pattern.validate(name))?;
        adjustment.validate(name)?;
        Ok((pattern, adjustment))
    }

    /// The style, of its sphere, with these values of its sliders.
    ///
    /// # Errors
    /// [`Error::Scene`] for a slider that there is not, or a value beyond its ends.
    pub fn image(&self, name: &str, sphere: &StyleImage, values: &SliderValues) -> Result<StyleImage> {
        let (pattern, adjustment) = self.drawn(name, values)?;
        let mut image = if adjustment == Adjustment::NONE {
            StyleImage { name: name.to_owned(), ..sphere.clone() }
        } else {
            StyleImage::from_texels(name, sphere.mips[0].iter().map(|texel| adjustment.of(*texel)).collect())
        };
        image.pattern = pattern;
        Ok(image)
    }
}

/// What sliders do to a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Adjustment {
    hue_deg: f64,
    lightness: f64,
    contrast: f64,
    opacity: f64,
}

impl Adjustment {
    const NONE: Self = Self { hue_deg: 0.0, lightness: 0.0, contrast: 1.0, opacity: 1.0 };

    fn validate(&self, name: &str) -> Result<()> {
        let is_good = (-360.0..=360.0).contains(&self.hue_deg)
            && (-1.0..=1.0).contains(&self.lightness)
            && (0.0..=10.0).contains(&self.contrast)
            && (0.0..=1.0).contains(&self.opacity);
        if is_good {
            return Ok(());
        }
        Err(Error::scene(
            format!("a slider of the style \"{name}\" goes too far"),
            "keep hue within 360°, lightness within 1, contrast from 0 to 10 and opacity from 0 to 1",
        ))
    }

    /// Of a premultiplied texel. Lightness is the cube root of luminance; a color keeps its hue as long as it fits.
    fn of(&self, texel: [f32; 4]) -> [f32; 4] {
        let alpha = texel[3];
        if alpha <= 0.0 {
            return texel;
        }
        let straight = DVec3::from_array([texel[0], texel[1], texel[2]].map(|c| f64::from(c / alpha)));
        // About the gray axis.
        let axis = DVec3::ONE.normalize();
        let (sin, cos) = self.hue_deg.to_radians().sin_cos();
        let turned = straight * cos + axis.cross(straight) * sin + axis * (axis.dot(straight) * (1.0 - cos));
        let turned = turned.max(DVec3::ZERO);
        let bright = luminance(turned.as_vec3().to_array());
        // The hue turns at the same luminance.
        let wanted = luminance(straight.as_vec3().to_array()).cbrt();
        let wanted = (0.5 + self.contrast * (wanted - 0.5) + self.lightness).clamp(0.0, 1.0).powi(3);
        let scaled = if bright > 1e-9 { turned * (wanted / bright) } else { DVec3::splat(wanted) };
        let scaled = scaled.min(DVec3::ONE).as_vec3();
        let alpha = alpha * self.opacity as f32;
        [scaled.x * alpha, scaled.y * alpha, scaled.z * alpha, alpha]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r##"{"sphere": "plaster",
        "pattern": {"strokes": "hatching", "direction": "light", "layers": 2, "spacing_pt": 3, "ink": "#402010"},
        "sliders": [
            {"name": "Spacing", "of": "pattern.spacing_pt", "min": 1, "max": 9, "value": 3},
            {"name": "Light", "of": "sphere.lightness", "min": -0.5, "max": 0.5, "value": 0}]}"##;

    #[test]
    fn sliders_change_what_they_are_of() {
        let file = StyleFile::parse("mine", FILE).unwrap();
        let gray = StyleImage::flat("gray", [0.2, 0.2, 0.2, 1.0]);
        let image = |values: &[(&str, f64)]| {
            let values = values.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
            file.image("mine", &gray, &values)
        };
        let plain = image(&[]).unwrap();
        assert_eq!((plain.name.as_str(), plain.mips[0][0]), ("mine", [0.2, 0.2, 0.2, 1.0]));
        let pattern = plain.pattern.unwrap();
        assert_eq!(pattern.spacing_pt, 3.0);
        assert_eq!(pattern.strokes, Strokes::Hatching { direction: Direction::Light, layers: 2 });
        assert!(pattern.ink[0] > pattern.ink[1] && pattern.ink[1] > pattern.ink[2]);
        let wider = image(&[("Spacing", 8.0), ("Light", 0.25)]).unwrap();
        assert_eq!(wider.pattern.unwrap().spacing_pt, 8.0);
        let lighter = (0.2f64.cbrt() + 0.25).powi(3);
        assert!((f64::from(wider.mips[0][0][1]) - lighter).abs() < 1e-5, "{:?}", wider.mips[0][0]);
        let sentence = |values| image(values).unwrap_err().to_string();
        assert!(sentence(&[("Depth", 1.0)]).contains("no slider \"Depth\"; it has Spacing, Light"));
        assert!(sentence(&[("Spacing", 0.0)]).contains("is at 0; choose a value from 1 to 9"));
    }

    #[test]
    fn a_hue_turns_at_the_same_luminance() {
        let turn = |hue_deg: f64| Adjustment { hue_deg, ..Adjustment::NONE }.of([0.3, 0.2, 0.2, 1.0]);
        let [r, g, b, _] = turn(120.0);
        assert!(g > r && g > b && (r - b).abs() < 1e-6, "{r} {g} {b}");
        assert!((luminance([r, g, b]) - luminance([0.3, 0.2, 0.2])).abs() < 1e-6);
        let half = Adjustment { opacity: 0.5, ..Adjustment::NONE }.of([0.3, 0.2, 0.2, 1.0]);
        assert!(half.iter().zip([0.15, 0.1, 0.1, 0.5]).all(|(a, b)| (a - b).abs() < 1e-6), "{half:?}");
        assert_eq!(turn(0.0).map(|c| (c * 1e5).round()), [30_000.0, 20_000.0, 20_000.0, 100_000.0]);
        assert_eq!(Adjustment { contrast: 0.0, ..Adjustment::NONE }.of([0.0; 4]), [0.0; 4]);
    }

    #[test]
    fn what_is_no_style_file_is_a_sentence() {
        let sentence = |from: &str, to: &str| {
            assert!(FILE.contains(from), "{from}");
            StyleFile::parse("mine", &FILE.replace(from, to)).unwrap_err().to_string()
        };
        assert!(sentence("\"sphere\": \"plaster\",", "").contains("missing field `sphere`"));
        assert!(sentence("{\"sphere\"", "[\"sphere\"").contains("cannot be read"));
        assert!(sentence("\"spacing_pt\": 3", "\"spacing_pt\": 0").contains("a spacing of 0 points"));
        assert!(sentence("\"min\": 1,", "\"min\": 0,").contains("a spacing of 0 points"));
        assert!(sentence("\"value\": 3", "\"value\": 30").contains("goes from 1 to 9 and is at 30"));
        assert!(sentence("\"Light\"", "\"Spacing\"").contains("is there twice"));
        assert!(sentence("sphere.lightness", "sphere.weight").contains("unknown variant"));
        assert!(sentence("#402010", "brown").contains("the color \"brown\""));
        assert!(sentence("-0.5", "-5").contains("goes too far"));
        assert!(sentence("\"layers\": 2", "\"layers\": 9").contains("9 ways"));
        assert!(sentence("\"strokes\"", "\"stokes\"").contains("unknown field"));
    }
}
