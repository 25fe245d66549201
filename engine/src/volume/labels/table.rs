//! Names, colors and codes for the numbers of a label map, which come in a file of their own
//! ([`crate::read::label_table`]).

use std::collections::BTreeMap;

use super::{Label, LabelMap};

/// What a table says about the numbers of label maps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LabelTable {
    /// The kind of table, for users ("FreeSurfer color table").
    pub format: &'static str,
    /// By the number of the structure.
    pub entries: BTreeMap<u32, LabelTableEntry>,
    /// What the user should know about how it was read, a sentence each.
    pub notes: Vec<String>,
}

/// What a table says about one number. Tables differ in what they have: some have no colors, some no names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LabelTableEntry {
    /// The structure's name.
    pub name: Option<String>,
    /// sRGB.
    pub color: Option<[u8; 3]>,
    /// As [`super::Label::code`].
    pub code: Option<String>,
}

/// At most so many structures are listed in a note.
const MAX_LISTED: usize = 6;

impl LabelMap {
    /// Takes names, colors and codes from a table, by id. What the table does not say stays, and so does the entry for
    /// what belongs to no structure. Returns a sentence if the table lacks structures that have voxels or names.
    pub fn name_by(&mut self, table: &LabelTable) -> Option<String> {
        table.name(self.labels.iter_mut().skip(1))
    }
}

impl LabelTable {
    /// Gives structures what it says of their numbers. Returns a sentence if it lacks some of them.
    pub fn name<'a>(&self, labels: impl IntoIterator<Item = &'a mut Label>) -> Option<String> {
        let mut missing = Vec::new();
        let mut num_structures = 0;
        for label in labels {
            num_structures += 1;
            let Some(entry) = self.entries.get(&label.id) else {
                missing.push(label.id.to_string());
                continue;
            };
            if let Some(name) = &entry.name {
                label.name.clone_from(name);
            }
            label.color = entry.color.unwrap_or(label.color);
            if entry.code.is_some() {
                label.code.clone_from(&entry.code);
            }
        }
        let verb = if missing.len() == 1 { "is" } else { "are" };
        (!missing.is_empty()).then(|| {
            let n = missing.len();
            format!("Of {num_structures} structures, {n} {verb} not in the table: {}.", listed(&missing))
        })
    }
}

/// Some names, and how many more there are.
pub(super) fn listed(names: &[String]) -> String {
    let shown = names[..names.len().min(MAX_LISTED)].join(", ");
    match names.len().saturating_sub(MAX_LISTED) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}
