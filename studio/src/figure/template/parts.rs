//! What a template says of an object that is cut into parts.

use anyhow::{Result, bail};
use fabrica_engine::scene::parts::MAX_PARTS;
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::MoveTemplate;
use super::moved::{is_one, is_zero, one};

/// How an object is cut into convex parts, and where these lie.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartsTemplate {
    /// In their order: each goes through one part, and makes one more.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cuts: Vec<CutTemplate>,
    /// The first is what is there before the first cut; each cut leaves what is in front of its plane to the next. At most 64. Those
    /// that nothing is said of lie where they were found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub list: Vec<PartTemplate>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A cut along a plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CutTemplate {
    /// Number of the part that it goes through, counted from 1.
    pub part: usize,
    /// A point of the plane: right, anterior, superior of the center of the sphere that the camera's lengths are relative to, in its
    /// radii.
    #[serde(default)]
    pub at: [f64; 3],
    /// Which way the plane faces: right, anterior, superior.
    pub normal: [f64; 3],
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A part of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartTemplate {
    /// What it is called. Default: "part" and its number.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Where it was moved to: right, anterior, superior, in radii of that sphere.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset: [f64; 3],
    /// A rotation vector about the middle of the box around it: its direction is the axis (right-handed), its length the angle in
    /// degrees.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub turn: [f64; 3],
    /// Factor of its size, from the same middle, 0.01 to 100.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f64,
    /// It is not drawn.
    #[serde(default, skip_serializing_if = "is_false")]
    pub hidden: bool,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_false(b: &bool) -> bool {
    !*b
}

impl Default for PartTemplate {
    fn default() -> Self {
        Self { name: String::new(), offset: [0.0; 3], turn: [0.0; 3], scale: 1.0, hidden: false, extra: Map::new() }
    }
}

impl PartTemplate {
    /// Where it was moved to, as a region is.
    pub fn as_move(&self) -> MoveTemplate {
        MoveTemplate { offset: self.offset, turn: self.turn, scale: self.scale, ..MoveTemplate::default() }
    }
}

impl PartsTemplate {
    /// Whether it says nothing.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// How many parts there are; none for an object that is whole.
    pub fn count(&self) -> usize {
        if self.cuts.is_empty() && self.list.is_empty() { 0 } else { self.cuts.len() + 1 }
    }

    /// What is said of part `i`, counted from 0.
    pub fn part(&self, i: usize) -> PartTemplate {
        self.list.get(i).cloned().unwrap_or_default()
    }

    /// What part `i` is called.
    pub fn title(&self, i: usize) -> String {
        let name = self.list.get(i).map_or("", |part| part.name.as_str());
        if name.is_empty() { format!("part {}", i + 1) } else { name.to_owned() }
    }

    /// Checks what the types cannot; `whose` they are begins the sentence.
    pub(super) fn check(&self, whose: &str) -> Result<()> {
        if self.count().max(self.list.len()) > MAX_PARTS {
            let count = self.count().max(self.list.len());
            bail!("{whose} is cut into {count} parts, and {MAX_PARTS} is the most; cut it less often");
        }
        if self.list.len() > self.count() {
            let (cuts, listed) = (self.cuts.len(), self.list.len());
            bail!("{whose} has {cuts} cuts, which make {} parts, and {listed} are listed; leave some out", cuts + 1);
        }
        for (i, cut) in self.cuts.iter().enumerate() {
            let [number, most] = [i + 1, i + 1];
            if !(1..=most).contains(&cut.part) {
                bail!(
                    "cut {number} of {whose} goes through part {}, and there are {most} then; name one of them",
                    cut.part
                );
            }
            let normal = DVec3::from_array(cut.normal);
            if !DVec3::from_array(cut.at).is_finite() || normal.try_normalize().is_none() {
                bail!("cut {number} of {whose} has no plane; give a point and a normal other than 0 0 0");
            }
        }
        for (i, part) in self.list.iter().enumerate() {
            part.as_move().check(&format!("\"{}\" of {whose}", self.title(i)))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_told_in_a_sentence() {
        let cut = |part, normal| CutTemplate { part, at: [0.0; 3], normal, extra: Map::new() };
        let x = [1.0, 0.0, 0.0];
        let said = |parts: PartsTemplate| parts.check("the object \"head\"").unwrap_err().to_string();
        let with = |cuts: Vec<CutTemplate>, list: Vec<PartTemplate>| PartsTemplate { cuts, list, extra: Map::new() };
        with(vec![cut(1, x), cut(2, x)], vec![]).check("it").unwrap();
        for (parts, words) in [
            (with(vec![cut(1, x); 64], vec![]), "is cut into 65 parts, and 64 is the most"),
            (with(vec![], vec![PartTemplate::default(); 2]), "0 cuts, which make 1 parts, and 2 are listed"),
            (
                with(vec![cut(1, x), cut(3, x)], vec![]),
                "cut 2 of the object \"head\" goes through part 3, and there are 2",
            ),
            (with(vec![cut(1, [0.0; 3])], vec![]), "cut 1 of the object \"head\" has no plane"),
            (
                with(vec![cut(1, x)], vec![PartTemplate { scale: 0.0, ..PartTemplate::default() }]),
                "\"part 1\" of the object \"head\" is scaled by 0; give a factor from 0.01 to 100",
            ),
            (
                with(vec![], vec![PartTemplate { offset: [f64::NAN; 3], ..PartTemplate::default() }]),
                "is moved by something that is no number",
            ),
            (
                with(vec![], vec![PartTemplate { offset: [1e9, 0.0, 0.0], ..PartTemplate::default() }]),
                "is moved by more than 1000 radii",
            ),
        ] {
            let said = said(parts);
            assert!(said.contains(words) && !said.contains('\n'), "{said}");
        }
    }
}
