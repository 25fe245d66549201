//! What a template says of lights, for objects that are lit and do not show their styles' own (thesis §3.3.1).

use anyhow::{Result, bail};
use fabrica_engine::color::linear_from_srgb8;
use fabrica_engine::scene::lighting::MAX_LIGHTS;
use fabrica_engine::scene::{Light, LightFrame, Lighting, LightingMap};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::Rgb;

/// Most that highlights' exponent may be: sharper ones fall between the texels of a lighting map.
pub const MAX_SHININESS: f64 = 100.0;
/// The brightest light.
pub const MAX_BRIGHTNESS: f64 = 10.0;

/// How an object is lit; its styles then say only what color it is: that of their lights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LightingTemplate {
    /// What light does to surfaces.
    pub model: LightingModel,
    /// Of Blinn-Phong: how much there is of the surface's color anyway.
    #[serde(default = "ambient")]
    pub ambient: f64,
    /// Of Blinn-Phong: how much of the surface's color light brings out.
    #[serde(default = "diffuse")]
    pub diffuse: f64,
    /// Of Blinn-Phong: how much of the light itself is seen in highlights.
    #[serde(default = "specular")]
    pub specular: f64,
    /// Of Blinn-Phong: exponent of the highlights, 1 to 100; large: small and sharp.
    #[serde(default = "shininess")]
    pub shininess: f64,
    /// One to four. Default: one from the camera's upper left.
    #[serde(default = "one_light", skip_serializing_if = "is_one_light")]
    pub lights: Vec<LightTemplate>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A lighting map (thesis Fig. 3.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LightingModel {
    /// Ambient, diffuse and specular light.
    BlinnPhong,
    /// Three tones and a hard highlight.
    Cartoon,
    /// Polished metal in the color of the light.
    Metal,
    /// No light at all: plain colors.
    Unshaded,
}

/// A light that is infinitely far away.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LightTemplate {
    /// Direction towards it, of any length: for "camera" right, up, towards the eye; for "object" right, anterior, superior.
    pub from: [f64; 3],
    /// What it is fixed to.
    #[serde(default)]
    pub fixed_to: FixedTo,
    /// Its color. Default: white.
    #[serde(default = "white")]
    pub color: Rgb,
    /// Factor, 0 to 10, of the color's light.
    #[serde(default = "one")]
    pub brightness: f64,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// What a light is fixed to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FixedTo {
    /// It stays where it is in the picture when the view turns.
    #[default]
    Camera,
    /// It turns with the object.
    Object,
}

fn ambient() -> f64 {
    0.18
}

fn diffuse() -> f64 {
    0.75
}

fn specular() -> f64 {
    0.3
}

fn shininess() -> f64 {
    24.0
}

fn one() -> f64 {
    1.0
}

fn white() -> Rgb {
    Rgb([255; 3])
}

fn one_light() -> Vec<LightTemplate> {
    vec![LightTemplate::from([-0.55, 0.6, 0.8])]
}

fn is_one_light(lights: &Vec<LightTemplate>) -> bool {
    *lights == one_light()
}

impl LightTemplate {
    /// A white light that is fixed to the camera.
    pub fn from(from: [f64; 3]) -> Self {
        Self { from, fixed_to: FixedTo::Camera, color: white(), brightness: 1.0, extra: Map::new() }
    }
}

impl LightingTemplate {
    /// A model with its usual numbers and one light.
    pub fn new(model: LightingModel) -> Self {
        Self {
            model,
            ambient: ambient(),
            diffuse: diffuse(),
            specular: specular(),
            shininess: shininess(),
            lights: one_light(),
            extra: Map::new(),
        }
    }

    /// What light does to surfaces.
    fn map(&self) -> LightingMap {
        let Self { ambient, diffuse, specular, shininess, .. } = *self;
        match self.model {
            LightingModel::BlinnPhong => LightingMap::BlinnPhong { ambient, diffuse, specular, shininess },
            LightingModel::Cartoon => LightingMap::Cartoon,
            LightingModel::Metal => LightingMap::Metal,
            LightingModel::Unshaded => LightingMap::Unshaded,
        }
    }

    /// The lights as the scene has them.
    pub fn lighting(&self) -> Lighting {
        let light = |light: &LightTemplate| Light {
            direction: DVec3::from_array(light.from).normalize_or(DVec3::Z),
            frame: match light.fixed_to {
                FixedTo::Camera => LightFrame::Camera,
                FixedTo::Object => LightFrame::World,
            },
            color: light.color.0.map(|c| linear_from_srgb8(c) * light.brightness as f32),
        };
        Lighting { map: self.map(), lights: self.lights.iter().map(light).collect() }
    }

    /// Checks what the types cannot; `whose` it is begins the sentence.
    pub(super) fn check(&self, whose: &str) -> Result<()> {
        for (name, value) in [("ambient", self.ambient), ("diffuse", self.diffuse), ("specular", self.specular)] {
            if !(0.0..=1.0).contains(&value) {
                bail!("{whose} has {name} light of {value}; give 0 to 1");
            }
        }
        if !(1.0..=MAX_SHININESS).contains(&self.shininess) {
            bail!("{whose} has highlights of exponent {}; give 1 to {MAX_SHININESS}", self.shininess);
        }
        if self.lights.is_empty() || self.lights.len() > MAX_LIGHTS {
            bail!("{whose} has {} lights; give it one to {MAX_LIGHTS}", self.lights.len());
        }
        for light in &self.lights {
            let from = DVec3::from_array(light.from);
            if !(from.is_finite() && from.length() > 1e-12) {
                bail!("{whose} has a light from nowhere; give a direction");
            }
            if !(0.0..=MAX_BRIGHTNESS).contains(&light.brightness) {
                bail!("{whose} has a light of brightness {}; give 0 to {MAX_BRIGHTNESS}", light.brightness);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_said_is_usual_and_faults_are_sentences() {
        let parse = |text: &str| serde_json::from_str::<LightingTemplate>(text);
        let plain = parse(r#"{"model": "blinn-phong"}"#).unwrap();
        assert_eq!(plain, LightingTemplate::new(LightingModel::BlinnPhong));
        assert!(plain.check("x").is_ok() && !serde_json::to_string(&plain).unwrap().contains("lights"));
        for (text, said) in [
            (r#"{"model": "cartoon", "ambient": 2}"#, "ambient light of 2"),
            (r#"{"model": "cartoon", "shininess": 0}"#, "exponent 0"),
            (r#"{"model": "metal", "lights": []}"#, "0 lights"),
            (r#"{"model": "metal", "lights": [{"from": [0, 0, 0]}]}"#, "from nowhere"),
            (r#"{"model": "metal", "lights": [{"from": [0, 0, 1], "brightness": -1}]}"#, "brightness -1"),
        ] {
            let found = parse(text).unwrap().check("the object \"x\"").unwrap_err().to_string();
            assert!(found.contains(said), "{found}");
        }
        assert!(parse(r#"{"model": "phong"}"#).is_err());
    }
}
