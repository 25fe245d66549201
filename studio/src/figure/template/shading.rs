//! What a template says of how surfaces are drawn, besides their styles: contours and transparency (thesis §3.3.3, §3.3.4).

use anyhow::{Result, bail};
use fabrica_engine::scene::transfer_function::MAX_CONTOUR_PT;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value};

use super::Background;

/// How surfaces are drawn, as far as it is said: of an object; of a region, what differs from that.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShadingTemplate {
    /// Lines where surfaces turn away. Default of an object: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contours: Option<ContoursTemplate>,
    /// What the transfer function's opacities mean. Default of an object: "uniform".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transparency: Option<Transparency>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// Lines where surfaces turn away, of one width on all of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContoursTemplate {
    /// Width on the page in points (1/72 inch), 0 to 72; 0: none.
    pub width_pt: f64,
    /// Their color. Default: that of each style's rim.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<Rgb>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// What becomes transparent where opacity is low.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Transparency {
    /// All alike.
    #[default]
    Uniform,
    /// What faces the eye first, and edges last, as in drawings of glass.
    Illustrative,
}

/// An sRGB color, in JSON "#rrggbb".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rgb(pub [u8; 3]);

impl ShadingTemplate {
    /// Whether it says nothing.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// This shading, and where it says nothing what `other` says.
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        Self {
            contours: self.contours.clone().or_else(|| other.contours.clone()),
            transparency: self.transparency.or(other.transparency),
            extra: self.extra.clone(),
        }
    }

    /// Checks what the types cannot; `whose` it is begins the sentence.
    pub(in crate::figure) fn check(&self, whose: &str) -> Result<()> {
        if let Some(width) = self.contours.as_ref().map(|c| c.width_pt).filter(|w| !(0.0..=MAX_CONTOUR_PT).contains(w))
        {
            bail!("{whose} has contours {width} points wide; give 0 to {MAX_CONTOUR_PT}");
        }
        Ok(())
    }
}

impl ContoursTemplate {
    /// Of the styles' rims.
    pub fn new(width_pt: f64) -> Self {
        Self { width_pt, color: None, extra: Map::new() }
    }
}

impl Serialize for Rgb {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(&Background::Color(self.0))
    }
}

impl<'de> Deserialize<'de> for Rgb {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        match text.parse() {
            Ok(Background::Color(color)) => Ok(Self(color)),
            _ => Err(serde::de::Error::custom(format!("\"{text}\" is no color; write it as #rrggbb"))),
        }
    }
}

impl JsonSchema for Rgb {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Rgb".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "type": "string",
            "description": "An sRGB color.",
            "pattern": "^#[0-9a-fA-F]{6}$"
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_said_is_inherited_and_faults_are_sentences() {
        let parse = |text: &str| serde_json::from_str::<ShadingTemplate>(text).unwrap();
        let object = parse(r##"{"contours": {"width_pt": 0.5, "color": "#102030"}, "transparency": "illustrative"}"##);
        let region = parse(r#"{"contours": {"width_pt": 0}, "hatching": 3}"#);
        let both = region.or(&object);
        assert_eq!(both.contours, Some(ContoursTemplate::new(0.0)));
        assert_eq!((both.transparency, both.extra.len()), (Some(Transparency::Illustrative), 1));
        assert!(ShadingTemplate::default().or(&object) == object && ShadingTemplate::default().is_default());
        for (width, is_fine) in [(0.0, true), (72.0, true), (-1.0, false), (73.0, false), (f64::NAN, false)] {
            let shading = ShadingTemplate { contours: Some(ContoursTemplate::new(width)), ..object.clone() };
            let checked = shading.check("the object \"head\"");
            assert_eq!(checked.is_ok(), is_fine, "{width}");
            assert!(is_fine || checked.unwrap_err().to_string().contains("points wide; give 0 to 72"));
        }
        let said = serde_json::from_str::<Rgb>("\"transparent\"").unwrap_err().to_string();
        assert!(said.contains("#rrggbb"), "{said}");
    }
}
