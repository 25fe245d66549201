//! Illustration templates, version 1: the JSON file that says everything about a figure but the voxels.
//!
//! Positions and lengths of the camera are relative to the object, so that a template fits the next dataset.
//! Fields that this version does not know survive reading and writing (`extra`).

mod across;
mod filter;
mod lighting;
mod moved;
mod parts;
mod region;
mod shading;
mod voxels;

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use fabrica_engine::read::window::Window;
use fabrica_engine::read::{Numbers, ReadOptions};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::style_settings::StyleSettings;

pub use across::{AcrossTemplate, AxisName, RowTemplate};
pub use filter::FilterTemplate;
pub use lighting::{FixedTo, LightTemplate, LightingModel, LightingTemplate, MAX_BRIGHTNESS, MAX_SHININESS};
pub use moved::{GHOST_OPACITY, MeetingStrength, MeetingTemplate, MoveTemplate, SCALES};
pub use parts::{CutTemplate, PartTemplate, PartsTemplate};
pub use region::{
    IMPORTANCE, LookTemplate, RegionTemplate, RestTemplate, SelectionSlot, StructureTemplate, Tint, is_called,
};
pub use shading::{ContoursTemplate, Rgb, ShadingTemplate, Transparency};
pub use voxels::SelectionVoxels;

/// The version that this program writes.
pub const VERSION: u32 = 1;

/// A figure: volumes, their look, the view, the page.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Template {
    /// Version of the template format; this is version 1.
    pub fabrica: u32,
    /// What the figure shows.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub title: String,
    /// Slots for volumes; `--volume` fills them in order.
    pub volumes: Vec<VolumeSlot>,
    /// Slots for selections of their voxels; `--labels` fills them in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub selections: Vec<SelectionSlot>,
    /// What is drawn, from which slot and how.
    pub objects: Vec<ObjectTemplate>,
    /// Where it is seen from.
    pub camera: CameraTemplate,
    /// "transparent" or "#rrggbb".
    #[serde(default)]
    pub background: Background,
    /// A theme (`fabrica styles` lists them): other styles for all that the objects name, on a page of its own color. Default:
    /// none, all is as it says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub theme: Option<String>,
    /// Values of styles' sliders, by the style's name and the slider's, as in {"hatched": {"Spacing": 3.5}}. Default: the styles' own.
    #[serde(default, skip_serializing_if = "StyleSettings::is_empty")]
    pub style_settings: StyleSettings,
    /// The figure on the page.
    pub figure: Page,
    /// What is traded between speed and accuracy.
    #[serde(default)]
    pub quality: QualityName,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A place for a volume, with the one that the template was made with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct VolumeSlot {
    /// What objects call it.
    pub name: String,
    /// A file or folder, relative to the template, or "specimen:head", "specimen:turtle" or "specimen:engine" (a size and
    /// variants may follow: "specimen:head@128,mirrored"; `fabrica inspect --help` lists them).
    pub file: String,
    /// Which frame of a 4-D file, from 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub frame: usize,
    /// For raw files: DIMSxTYPE[,spacing][,endian], as in "256x256x128xuint8,1x1x1,little".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raw: Option<String>,
    /// Which volume of a folder or file with several: as `fabrica inspect` lists it, or a part of its name that only one has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub series: Option<String>,
    /// Its numbers are names of structures, which are drawn in their colors.
    #[serde(default, skip_serializing_if = "is_no")]
    pub labels: bool,
    /// The part that is read: first and, exclusive, last voxel along x, y, z of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop: Option<[[usize; 2]; 3]>,
    /// So many voxels of the file, along x, y, z, become one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reduce: Option<[usize; 3]>,
    /// Filters of what was read, against noise, one after the other; the file stays as it is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub filters: Vec<FilterTemplate>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl VolumeSlot {
    /// The same without filters.
    #[must_use]
    pub fn unfiltered(&self) -> Self {
        Self { filters: Vec::new(), ..self.clone() }
    }

    /// The slot `name` with a file, which is read whole, its first frame.
    pub fn new(name: &str, file: String) -> Self {
        Self {
            name: name.to_owned(),
            file,
            frame: 0,
            raw: None,
            series: None,
            labels: false,
            crop: None,
            reduce: None,
            filters: Vec::new(),
            extra: Map::new(),
        }
    }

    /// The slot with another file, or the same, which is read in another way; the name stays.
    pub fn reading(&self, file: String, options: &ReadOptions) -> Self {
        let window = options.window;
        Self {
            name: self.name.clone(),
            file,
            frame: options.frame,
            raw: options.raw.as_ref().map(ToString::to_string),
            series: options.series.clone(),
            labels: options.numbers == Numbers::Structures,
            crop: window.crop,
            reduce: (window.reduce != [1; 3]).then_some(window.reduce),
            filters: self.filters.clone(),
            extra: self.extra.clone(),
        }
    }

    /// How its file is read.
    ///
    /// # Errors
    /// One sentence for a raw layout that is none.
    pub fn options(&self) -> Result<ReadOptions> {
        let raw = self.raw.as_deref().map(str::parse).transpose();
        Ok(ReadOptions {
            frame: self.frame,
            raw: raw.map_err(|e| anyhow::anyhow!("the raw layout of the volume \"{}\": {e}", self.name))?,
            series: self.series.clone(),
            numbers: if self.labels { Numbers::Structures } else { Numbers::Values },
            window: Window { crop: self.crop, reduce: self.reduce.unwrap_or([1; 3]) },
            ..ReadOptions::default()
        })
    }

    /// Whether the same voxels are read, whatever the slot is called.
    pub fn reads_same(&self, other: &Self) -> bool {
        let read = |s: &Self| Self { name: String::new(), extra: Map::new(), ..s.clone() };
        read(self) == read(other)
    }
}

/// One object: a volume with a look.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectTemplate {
    /// What it is called. Default: the slot's name.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// The slot's name.
    pub volume: String,
    /// Whether it is drawn. One that is not still has its place: the camera is relative to it.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub visible: bool,
    /// Value → style and opacity.
    pub transfer_function: TransferFunctionTemplate,
    /// How surfaces are drawn, besides their styles.
    #[serde(default, skip_serializing_if = "ShadingTemplate::is_default")]
    pub shading: ShadingTemplate,
    /// How it is lit. Default: styles are their own light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lighting: Option<LightingTemplate>,
    /// Parts with looks of their own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<RegionTemplate>,
    /// How what belongs to none of them is drawn.
    #[serde(default, skip_serializing_if = "RestTemplate::is_default")]
    pub rest: RestTemplate,
    /// What it is cut into. Default: it is whole.
    #[serde(default, skip_serializing_if = "PartsTemplate::is_default")]
    pub parts: PartsTemplate,
    /// Standard deviation, in mm, of the Gaussian that smooths what gradients are taken from.
    /// Default: one voxel (the smallest spacing). 0: no smoothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gradient_scale_mm: Option<f64>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A 1-D style transfer function.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TransferFunctionTemplate {
    /// What the nodes' `at` counts.
    pub domain: Domain,
    /// The length in mm that opacities are stated for (d₀). Default: the volume's smallest spacing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_length_mm: Option<f64>,
    /// Ascending in `at`; between two of them style and opacity change linearly, outside they go on.
    pub nodes: Vec<NodeTemplate>,
    /// A second coordinate besides the value. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub across: Option<AcrossTemplate>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// What a transfer function's positions count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Domain {
    /// Data values (CT: HU).
    Data,
    /// Percentiles, 0 to 100, of the finite voxels above the background (Otsu's threshold; `inspect` states it).
    Percentile,
}

/// One node of a transfer function.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NodeTemplate {
    /// Data value or percentile, as the function's domain says.
    pub at: f64,
    /// Name of a lit-sphere style.
    pub style: String,
    /// Opacity, 0 to 1, of one reference length of this material.
    pub opacity: f64,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// The view, in terms of the object: lengths are in radii of the sphere around it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraTemplate {
    /// What center and radius are taken from.
    #[serde(default)]
    pub relative_to: Reference,
    /// Direction from the object to the eye: right, anterior, superior. [0, 1, 0] looks at a face from the front.
    pub from: [f64; 3],
    /// Direction that is up in the picture.
    #[serde(default = "superior")]
    pub up: [f64; 3],
    /// Central or parallel.
    #[serde(default)]
    pub projection: ProjectionName,
    /// Vertical field of view in degrees (perspective).
    #[serde(default = "default_fov")]
    pub fov_deg: f64,
    /// Height of what the picture shows at the target, in radii.
    #[serde(default = "default_height")]
    pub height: f64,
    /// What the view's axis goes through: offset from the center, in radii, right/anterior/superior.
    #[serde(default)]
    pub target: [f64; 3],
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// What a camera is placed against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Reference {
    /// The box of what the transfer function shows (in bricks of 8 voxels): margins of air do not matter.
    #[default]
    Visible,
    /// The box of the whole volume.
    Volume,
}

/// How depth is projected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ProjectionName {
    /// Central projection.
    #[default]
    Perspective,
    /// Parallel projection.
    Orthographic,
}

/// What lies behind the figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Background {
    /// Nothing: the picture has an alpha channel.
    #[default]
    Transparent,
    /// An opaque sRGB color.
    Color([u8; 3]),
}

/// Physical size and resolution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Page {
    /// Width on the page.
    pub width_mm: f64,
    /// Height on the page.
    pub height_mm: f64,
    /// Pixels per inch of an export.
    #[serde(default = "default_dpi")]
    pub dpi: f64,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A named accuracy setting (docs/rendering.md §7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum QualityName {
    /// For a look.
    Draft,
    /// Errors that nobody sees: at most 3 of 255 codes in 99.9 % of the pixels of the shipped figures.
    #[default]
    Standard,
    /// For print: at most 1 code.
    Final,
}

fn yes() -> bool {
    true
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_yes(visible: &bool) -> bool {
    *visible
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_no(yes: &bool) -> bool {
    !yes
}

fn is_zero(n: &usize) -> bool {
    *n == 0
}

fn superior() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn default_fov() -> f64 {
    20.0
}

fn default_height() -> f64 {
    2.0
}

fn default_dpi() -> f64 {
    300.0
}

impl ObjectTemplate {
    /// What people call it.
    pub fn title(&self) -> &str {
        if self.name.is_empty() { &self.volume } else { &self.name }
    }
}

impl Template {
    /// Parses the text of a template.
    ///
    /// # Errors
    /// One sentence: no JSON, another program's JSON, a newer version, a field of the wrong kind (with line and
    /// column), a number that makes no sense.
    pub fn parse(text: &str) -> Result<Self> {
        // Its version first: what a newer version calls things is not this version's business.
        let value: Value = serde_json::from_str(text)
            .map_err(|e| anyhow::anyhow!("it is not JSON ({e}); open it in a text editor or restore an older copy"))?;
        match value.get("fabrica").and_then(Value::as_u64) {
            None => bail!("it is no Fabrica template: the field \"fabrica\": 1 is missing; see `fabrica schema`"),
            Some(v) if v > u64::from(VERSION) => {
                bail!("it is a template of version {v} and this program reads version {VERSION}; update Fabrica")
            }
            Some(0) => bail!("it is a template of version 0, which never existed; see `fabrica schema`"),
            Some(_) => {}
        }
        let template: Self = serde_json::from_str(text)
            .map_err(|e| anyhow::anyhow!("it does not follow the template's schema: {e}; see `fabrica schema`"))?;
        template.check()?;
        Ok(template)
    }

    /// Reads a template file.
    ///
    /// # Errors
    /// As [`Template::parse`], or that the file cannot be read; the path comes last.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| fabrica_engine::Error::io(path, &e))?;
        // Windows editors put a byte order mark in front.
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").map_or(bytes.clone(), <[u8]>::to_vec);
        let text = String::from_utf8(bytes)
            .map_err(|_| anyhow::anyhow!("it is not UTF-8 text, so it is no template"))
            .with_context(|| format!("cannot use the template {}", path.display()))?;
        Self::parse(&text).with_context(|| format!("cannot use the template {}", path.display()))
    }

    /// The JSON text, indented, with a final line break.
    ///
    /// # Errors
    /// If a number is not finite: JSON cannot hold it.
    pub fn to_json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// The names of all files in it.
    pub fn files_mut(&mut self) -> impl Iterator<Item = &mut String> {
        let selections = self.selections.iter_mut().flat_map(SelectionSlot::files_mut);
        self.volumes.iter_mut().map(|v| &mut v.file).chain(selections)
    }

    pub(super) fn check(&self) -> Result<()> {
        let page = &self.figure;
        if ![page.width_mm, page.height_mm, page.dpi].iter().all(|n| *n > 0.0 && n.is_finite()) {
            bail!("the figure is {} x {} mm at {} dpi; give positive numbers", page.width_mm, page.height_mm, page.dpi);
        }
        for slot in &self.volumes {
            for filter in &slot.filters {
                if let Err(fault) = filter.filter().check() {
                    bail!("the volume \"{}\" is filtered: {fault}", slot.name);
                }
            }
        }
        for object in &self.objects {
            let Some(_) = self.volumes.iter().find(|v| v.name == object.volume) else {
                bail!(
                    "an object uses the volume \"{}\", which is not among the volumes; name one of: {}",
                    object.volume,
                    self.volumes.iter().map(|v| v.name.as_str()).collect::<Vec<_>>().join(", ")
                );
            };
            let whose = format!("the object \"{}\"", object.title());
            object.transfer_function.check(&whose)?;
            object.shading.check(&whose)?;
            object.lighting.as_ref().map_or(Ok(()), |lighting| lighting.check(&whose))?;
            object.parts.check(&whose)?;
        }
        region::check(self)?;
        if let Some(twice) =
            (1..self.volumes.len()).find(|i| self.volumes[..*i].iter().any(|v| v.name == self.volumes[*i].name))
        {
            bail!("two volumes are called \"{}\"; give each its own name", self.volumes[twice].name);
        }
        Ok(())
    }
}

impl TransferFunctionTemplate {
    /// Checks what the types cannot; `whose` it is begins the sentence.
    fn check(&self, whose: &str) -> Result<()> {
        check_nodes(&self.nodes, self.domain, whose)?;
        self.check_across(whose)
    }
}

/// Checks the nodes of a transfer function, or of a row of it.
fn check_nodes(nodes: &[NodeTemplate], domain: Domain, whose: &str) -> Result<()> {
    if nodes.is_empty() {
        bail!("{whose} has a transfer function without nodes; add at least one");
    }
    if let Some(n) = nodes.iter().find(|n| !n.at.is_finite()) {
        bail!("{whose} has a node at {}; give a number", n.at);
    }
    if let Some(w) = nodes.windows(2).find(|w| w[0].at > w[1].at) {
        bail!("{whose} has nodes that do not ascend ({} before {}); sort them", w[0].at, w[1].at);
    }
    if domain == Domain::Percentile
        && let Some(n) = nodes.iter().find(|n| !(0.0..=100.0).contains(&n.at))
    {
        bail!("{whose} has a node at percentile {}; percentiles go from 0 to 100", n.at);
    }
    if let Some(n) = nodes.iter().find(|n| !(0.0..=1.0).contains(&n.opacity)) {
        bail!("{whose} has a node at {} with opacity {}; opacities go from 0 to 1", n.at, n.opacity);
    }
    Ok(())
}

impl std::str::FromStr for Background {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if text == "transparent" {
            return Ok(Self::Transparent);
        }
        let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()));
        let code = digits.and_then(|d| u32::from_str_radix(d, 16).ok());
        let [_, r, g, b] = code
            .ok_or_else(|| format!("\"{text}\" is no background; write transparent or a color as #rrggbb"))?
            .to_be_bytes();
        Ok(Self::Color([r, g, b]))
    }
}

impl std::fmt::Display for Background {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Transparent => f.write_str("transparent"),
            Self::Color([r, g, b]) => write!(f, "#{r:02x}{g:02x}{b:02x}"),
        }
    }
}

impl Serialize for Background {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Background {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

impl JsonSchema for Background {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Background".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "type": "string",
            "description": "\"transparent\" or an opaque sRGB color.",
            "pattern": "^(transparent|#[0-9a-fA-F]{6})$"
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = r#"{
  "fabrica": 1,
  "future": {"a": [1, 2.5, "x"]},
  "volumes": [{"name": "v", "file": "a.nii", "later": true}],
  "objects": [{
    "volume": "v",
    "transfer_function": {"domain": "data", "nodes": [{"at": 0.1, "style": "wax", "opacity": 1.0, "tint": "red"}], "curve": 3},
    "halo": null
  }],
  "camera": {"from": [0, 1, 0], "lens": "anamorphic"},
  "figure": {"width_mm": 80, "height_mm": 60, "bleed_mm": 3}
}"#;

    #[test]
    fn unknown_fields_survive_a_rewrite() {
        let once = Template::parse(SMALL).unwrap().to_json().unwrap();
        for key in ["future", "later", "tint", "curve", "halo", "lens", "bleed_mm"] {
            assert!(once.contains(&format!("\"{key}\"")), "{key} is lost:\n{once}");
        }
        let twice = Template::parse(&once).unwrap().to_json().unwrap();
        assert_eq!(once, twice, "a rewrite must be byte-stable");
    }

    #[test]
    fn faults_are_sentences() {
        let broken = |from: &str, to: &str| Template::parse(&SMALL.replace(from, to)).unwrap_err().to_string();
        for (from, to, expected) in [
            ("\"fabrica\": 1", "\"fabrica\": 2", "version 2"),
            ("\"fabrica\": 1,", "", "no Fabrica template"),
            ("\"fabrica\": 1,", "\"fabrica\": 1", "not JSON"),
            ("\"domain\": \"data\"", "\"domain\": \"hu\"", "line"),
            ("\"volume\": \"v\"", "\"volume\": \"w\"", "\"w\""),
            ("\"opacity\": 1.0", "\"opacity\": 1.5", "opacities go from 0 to 1"),
            ("\"width_mm\": 80", "\"width_mm\": 0", "positive"),
        ] {
            let message = broken(from, to);
            assert!(message.contains(expected), "{to}: {message}");
        }
    }

    #[test]
    fn backgrounds_parse() {
        assert_eq!("#FF8000".parse(), Ok(Background::Color([255, 128, 0])));
        assert_eq!(Background::Color([255, 128, 0]).to_string(), "#ff8000");
        for bad in ["", "red", "#12345", "#12345é", "#+12345"] {
            assert!(bad.parse::<Background>().is_err(), "{bad}");
        }
    }
}
