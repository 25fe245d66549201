//! What a template says of selected parts: where their voxels come from, and how they look.

use anyhow::{Result, bail};
use fabrica_engine::selection::MOST_SIGMA;
use fabrica_engine::volume::labels::Label;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{MoveTemplate, ObjectTemplate, SelectionVoxels, ShadingTemplate, Template, TransferFunctionTemplate};

/// A place for selections: a label map, or other selections of a volume's voxels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SelectionSlot {
    /// What regions call it.
    pub name: String,
    /// The slot of the volume whose voxels are selected.
    pub volume: String,
    /// A label map (a file or folder, relative to the template; "specimen:…" for that specimen's own), or selections that
    /// `fabrica select` wrote.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// A single structure, called as the slot, that was painted: in place of a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voxels: Option<SelectionVoxels>,
    /// Names and colors for its numbers, where the label map has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<String>,
    /// Standard deviation, in voxels, of the Gaussian that smooths the borders of its structures, all of them together; 0 leaves
    /// them as they are, up to 4. Default: 1 for selections of whole voxels, as label maps are, else 0, as for what was painted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smooth_voxels: Option<f64>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A selected part of an object, or several, with a look of its own. Regions and what is left of the object share out its volume:
/// what is in a region is not drawn as the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RegionTemplate {
    /// What it is called. Default: the structure's name, else the slot's.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// The slot of its selections.
    pub selection: String,
    /// Name, code ("SCT:10200004") or number of the structure in it; without one all of them, which is a group.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub structure: Option<String>,
    /// How it looks; of a group, how those look that have no look of their own.
    #[serde(default, skip_serializing_if = "LookTemplate::is_default")]
    pub look: LookTemplate,
    /// The structures of a group that look different.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub structures: Vec<StructureTemplate>,
    /// Where it was moved to, a group as a whole. Default: it is drawn where it lies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<MoveTemplate>,
    /// How much it matters to what the figure tells, 0 or more; of a group, that of its structures that have none of their own.
    /// 2-D transfer functions may go by it. Default: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub importance: Option<f64>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A structure of a group, with what its look has that the group's has not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StructureTemplate {
    /// Its name, code or number.
    pub structure: String,
    /// What differs.
    #[serde(default, skip_serializing_if = "LookTemplate::is_default")]
    pub look: LookTemplate,
    /// Where it was moved to by itself, in place of where its group was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<MoveTemplate>,
    /// How much it matters to what the figure tells, 0 or more. Default: as its group.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub importance: Option<f64>,
    /// The slot of the selections that were painted on a copy of it and are drawn in its place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replaced_by: Option<String>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// What belongs to no region of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RestTemplate {
    /// Whether it is drawn; the regions are, anyway.
    #[serde(default = "yes")]
    pub visible: bool,
    /// Factor, 0 to 1, of its opacity.
    #[serde(default = "whole")]
    pub opacity: f64,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// How much a part matters of which nothing is said.
pub const IMPORTANCE: f64 = 1.0;

fn yes() -> bool {
    true
}

fn whole() -> f64 {
    1.0
}

impl Default for RestTemplate {
    fn default() -> Self {
        Self { visible: true, opacity: 1.0, extra: Map::new() }
    }
}

impl RestTemplate {
    /// Whether it says nothing.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Factor of opacity, 0 where it is not drawn.
    pub fn factor(&self) -> f64 {
        if self.visible { self.opacity } else { 0.0 }
    }
}

/// A look, as far as it differs from that of what surrounds it: the group, else the object.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LookTemplate {
    /// Whether it is drawn; what is not is cut out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visible: Option<bool>,
    /// Factor, 0 to 1, of opacity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opacity: Option<f64>,
    /// The color that takes the place of the styles' own, lit as they are. Default: "own" in a group, "none" elsewhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tint: Option<Tint>,
    /// Name of the style that takes the place of all of the transfer function's. A group's does not where a structure has a
    /// transfer function of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub style: Option<String>,
    /// Value → style and opacity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transfer_function: Option<TransferFunctionTemplate>,
    /// How surfaces are drawn, besides their styles.
    #[serde(default, skip_serializing_if = "ShadingTemplate::is_default")]
    pub shading: ShadingTemplate,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A color in place of the styles'.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tint {
    /// The styles' own colors.
    None,
    /// The structure's color in its label map.
    Own,
    /// An sRGB color.
    Color([u8; 3]),
}

impl SelectionSlot {
    /// The slot `name` for what a file has of a volume's voxels.
    pub fn new(name: &str, volume: &str, file: String) -> Self {
        let (name, volume) = (name.to_owned(), volume.to_owned());
        Self { name, volume, file: Some(file), voxels: None, table: None, smooth_voxels: None, extra: Map::new() }
    }

    /// The slot `name` for what is painted of a volume's voxels.
    pub fn painted(name: &str, volume: &str, voxels: SelectionVoxels) -> Self {
        Self { file: None, voxels: Some(voxels), ..Self::new(name, volume, String::new()) }
    }

    /// What it is read from, for whoever waits.
    pub fn title(&self) -> &str {
        self.file.as_deref().unwrap_or(&self.name)
    }

    /// Whether the same voxels are read, whatever the slot is called.
    pub fn reads_same(&self, other: &Self) -> bool {
        // What was painted is called as its slot.
        let is_alike = self.voxels.is_none() || self.name == other.name;
        let read = |s: &Self| Self { name: String::new(), extra: Map::new(), ..s.clone() };
        is_alike && read(self) == read(other)
    }

    /// Names of files in it.
    pub fn files_mut(&mut self) -> impl Iterator<Item = &mut String> {
        self.file.as_mut().into_iter().chain(self.table.as_mut())
    }
}

impl LookTemplate {
    /// Whether it says nothing.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// This look, and where it says nothing what `other` says; a transfer function of its own has styles of its own.
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        Self {
            visible: self.visible.or(other.visible),
            opacity: self.opacity.or(other.opacity),
            tint: self.tint.or(other.tint),
            style: self.style.clone().or_else(|| match self.transfer_function {
                Some(_) => None,
                None => other.style.clone(),
            }),
            transfer_function: self.transfer_function.clone().or_else(|| other.transfer_function.clone()),
            shading: self.shading.or(&other.shading),
            extra: self.extra.clone(),
        }
    }

    pub(super) fn check(&self, whose: &str) -> Result<()> {
        if let Some(opacity) = self.opacity.filter(|o| !(0.0..=1.0).contains(o)) {
            bail!("{whose} has opacity {opacity}; opacities go from 0 to 1");
        }
        self.shading.check(whose)?;
        self.transfer_function.as_ref().map_or(Ok(()), |function| function.check(whose))
    }
}

impl RegionTemplate {
    /// All or one of the structures in the slot `selection`, looking as what surrounds them.
    pub fn of(selection: &str, structure: Option<String>) -> Self {
        Self {
            name: String::new(),
            selection: selection.to_owned(),
            structure,
            look: LookTemplate::default(),
            structures: Vec::new(),
            moved: None,
            importance: None,
            extra: Map::new(),
        }
    }

    /// What it is called.
    pub fn title(&self) -> &str {
        match (&self.name, &self.structure) {
            (name, _) if !name.is_empty() => name,
            (_, Some(structure)) => structure,
            _ => &self.selection,
        }
    }

    /// What the template calls a structure of it: as it does already, else by its name.
    pub fn called(&self, label: &Label) -> String {
        let is_it = |s: &&StructureTemplate| is_called(label, &s.structure);
        self.structures.iter().find(is_it).map_or_else(|| label.name.clone(), |s| s.structure.clone())
    }

    /// The look of the region itself or, by the name that the template gives it, of a structure in it.
    pub fn look_at(&self, structure: Option<&str>) -> LookTemplate {
        match structure {
            None => self.look.clone(),
            Some(_) => self.own_look(structure).or(&self.look),
        }
    }

    /// What is said of the region itself or of a structure in it, without what that has from its group.
    pub fn own_look(&self, structure: Option<&str>) -> LookTemplate {
        let Some(name) = structure else { return self.look.clone() };
        self.structures.iter().find(|s| s.structure == name).map_or_else(LookTemplate::default, |s| s.look.clone())
    }

    /// How much the region itself matters or, by the name that the template gives it, a structure in it.
    pub fn importance_of(&self, structure: Option<&str>) -> f64 {
        let own = structure.and_then(|name| self.structures.iter().find(|s| s.structure == name)?.importance);
        own.or(self.importance).unwrap_or(IMPORTANCE)
    }

    /// Whether something that was painted on a copy is drawn in place of a structure in it.
    pub fn is_replaced(&self, label: &Label) -> bool {
        self.structures.iter().any(|s| s.replaced_by.is_some() && is_called(label, &s.structure))
    }

    /// Where the region itself was moved to or, by the name that the template gives it, a structure in it by itself.
    pub fn own_move(&self, structure: Option<&str>) -> Option<&MoveTemplate> {
        match structure {
            None => self.moved.as_ref(),
            Some(name) => self.structures.iter().find(|s| s.structure == name)?.moved.as_ref(),
        }
    }
}

impl StructureTemplate {
    /// A structure of which nothing is said.
    pub fn of(structure: &str) -> Self {
        Self {
            structure: structure.to_owned(),
            look: LookTemplate::default(),
            moved: None,
            importance: None,
            replaced_by: None,
            extra: Map::new(),
        }
    }

    /// Whether it says nothing.
    pub fn is_default(&self) -> bool {
        self.look.is_default()
            && self.moved.is_none()
            && self.importance.is_none()
            && self.replaced_by.is_none()
            && self.extra.is_empty()
    }
}

/// Whether a structure has this name, code or number.
pub fn is_called(label: &Label, name: &str) -> bool {
    label.name == name || label.code.as_deref() == Some(name) || label.id.to_string() == name
}

/// Checks what the types cannot.
pub(super) fn check(template: &Template) -> Result<()> {
    for (i, slot) in template.selections.iter().enumerate() {
        if !template.volumes.iter().any(|v| v.name == slot.volume) {
            let names: Vec<&str> = template.volumes.iter().map(|v| v.name.as_str()).collect();
            bail!(
                "the selections \"{}\" are of the volume \"{}\", which is not among the volumes; name one of: {}",
                slot.name,
                slot.volume,
                names.join(", ")
            );
        }
        if let Some(sigma) = slot.smooth_voxels.filter(|s| !(0.0..=MOST_SIGMA).contains(s)) {
            bail!("the selections \"{}\" are smoothed by {sigma} voxels; choose 0 to {MOST_SIGMA}", slot.name);
        }
        if slot.file.is_some() == slot.voxels.is_some() {
            let has =
                if slot.file.is_some() { "a file and painted voxels" } else { "neither a file nor painted voxels" };
            bail!("the selections \"{}\" have {has}; give one of the two", slot.name);
        }
        if template.selections[..i].iter().any(|s| s.name == slot.name) {
            bail!("two places for selections are called \"{}\"; give each its own name", slot.name);
        }
    }
    template.objects.iter().try_for_each(|object| check_regions(template, object))
}

fn check_regions(template: &Template, object: &ObjectTemplate) -> Result<()> {
    if !(0.0..=1.0).contains(&object.rest.opacity) {
        bail!("the rest of \"{}\" has opacity {}; opacities go from 0 to 1", object.title(), object.rest.opacity);
    }
    for region in &object.regions {
        let title = region.title();
        let Some(slot) = template.selections.iter().find(|s| s.name == region.selection) else {
            let names: Vec<&str> = template.selections.iter().map(|s| s.name.as_str()).collect();
            bail!(
                "the region \"{title}\" uses the selections \"{}\", which are not there; name one of: {}",
                region.selection,
                names.join(", ")
            );
        };
        if slot.volume != object.volume {
            bail!(
                "the region \"{title}\" selects voxels of \"{}\" in an object of \"{}\"; use selections of that volume",
                slot.volume,
                object.volume
            );
        }
        region.look.check(&format!("the region \"{title}\""))?;
        if let Some(moved) = &region.moved {
            moved.check(&format!("the region \"{title}\""))?;
        }
        check_importance(region.importance, &format!("the region \"{title}\""))?;
        for structure in &region.structures {
            let whose = format!("the structure \"{}\"", structure.structure);
            check_importance(structure.importance, &whose)?;
            if let Some(slot) = structure.replaced_by.as_ref()
                && !template.selections.iter().any(|s| s.name == *slot && s.voxels.is_some())
            {
                bail!("{whose} is replaced by the selections \"{slot}\", which are not painted here; leave that out");
            }
            structure.look.check(&whose)?;
            structure.moved.as_ref().map_or(Ok(()), |moved| moved.check(&whose))?;
        }
    }
    Ok(())
}

fn check_importance(importance: Option<f64>, whose: &str) -> Result<()> {
    match importance.filter(|i| !(i.is_finite() && *i >= 0.0)) {
        Some(importance) => bail!("{whose} has importance {importance}; give a number that is 0 or more"),
        None => Ok(()),
    }
}

impl std::str::FromStr for Tint {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "none" => Ok(Self::None),
            "own" => Ok(Self::Own),
            _ => match text.parse() {
                Ok(super::Background::Color(color)) => Ok(Self::Color(color)),
                _ => Err(format!("\"{text}\" is no tint; write own, none or a color as #rrggbb")),
            },
        }
    }
}

impl std::fmt::Display for Tint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::Own => f.write_str("own"),
            Self::Color([r, g, b]) => write!(f, "#{r:02x}{g:02x}{b:02x}"),
        }
    }
}

impl Serialize for Tint {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Tint {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

impl JsonSchema for Tint {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Tint".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "type": "string",
            "description": "\"own\": the structure's color in its label map; \"none\": the styles' own colors; or an sRGB color.",
            "pattern": "^(own|none|#[0-9a-fA-F]{6})$"
        })
    }
}
