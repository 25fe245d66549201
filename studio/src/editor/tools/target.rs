//! What is painted into: a selection of the chosen object, or a new one.

use std::sync::Arc;

use fabrica_engine::selection::{BrickPool, Combination, Selection};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::labels::same_grid;

use super::super::open_figure::OpenFigure;
use crate::figure::Command;
use crate::figure::command::Chosen;
use crate::figure::template::{LookTemplate, ObjectTemplate, RegionTemplate, SelectionSlot, SelectionVoxels, Tint};

/// Colors that most people tell apart: M. Okabe and K. Ito, *Color Universal Design* (2008), without black and with the
/// brighter ones first.
const COLORS: [[u8; 3]; 7] = [
    [0xe6, 0x9f, 0x00],
    [0x56, 0xb4, 0xe9],
    [0x00, 0x9e, 0x73],
    [0xf0, 0xe4, 0x42],
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0xcc, 0x79, 0xa7],
];

/// What is edited.
#[derive(Clone)]
pub struct Target {
    /// Its slot.
    pub slot: String,
    /// What it is called.
    pub title: String,
    /// As it was before the edit.
    pub before: Selection,
    /// The volume whose voxels it selects.
    pub volume: Arc<Volume>,
    is_new: bool,
}

/// The painted selections of the chosen object: slots, and what their regions are called.
pub fn all(open: &OpenFigure) -> Vec<(String, String)> {
    let slots = &open.document.figure().selections;
    let is_painted = |region: &&RegionTemplate| slots.iter().any(|s| s.name == region.selection && s.voxels.is_some());
    let regions = open.chosen().map_or(&[][..], |object| &object.regions);
    regions.iter().filter(is_painted).map(|r| (r.selection.clone(), r.title().to_owned())).collect()
}

impl Target {
    /// The selection of that slot; without one, a new one.
    ///
    /// # Errors
    /// A sentence about why there is none.
    pub fn of(open: &OpenFigure, slot: Option<&str>) -> Result<Self, String> {
        let (Some(object), Some(volume)) = (open.chosen(), open.chosen_volume().cloned()) else {
            return Err("The object has no volume to paint on".to_owned());
        };
        let figure = open.document.figure();
        let known = slot.and_then(|name| figure.selections.iter().find(|s| s.name == name && s.voxels.is_some()));
        let Some(known) = known else { return Ok(Self::new(open, object, volume)) };
        let title = all(open).into_iter().find(|(slot, _)| *slot == known.name).map(|(_, title)| title);
        let title = title.ok_or("That selection belongs to another object; choose the object first")?;
        // On other voxels it was resampled, if it could be.
        let read = open.selections_of(known).and_then(|read| read.structures.first());
        let before = read.map(|structure| structure.selection.clone());
        let before = before.filter(|selection| same_grid(selection.grid(), &volume.grid));
        let before = before.ok_or("That selection is not there yet; wait until it is read")?;
        Ok(Self { slot: known.name.clone(), title, before, volume, is_new: false })
    }

    fn new(open: &OpenFigure, object: &ObjectTemplate, volume: Arc<Volume>) -> Self {
        let figure = open.document.figure();
        let is_free = |name: &String| {
            figure.selections.iter().all(|s| s.name != *name) && object.regions.iter().all(|r| r.title() != name)
        };
        let slot = (1..).map(|i| format!("Selection {i}")).find(is_free).unwrap_or_default();
        let before = Selection::empty(volume.grid, &Arc::new(BrickPool::default()));
        Self { title: slot.clone(), slot, before, volume, is_new: true }
    }

    /// Whether the figure has it still as it was before the edit.
    pub fn is_current(&self, open: &OpenFigure) -> bool {
        let slot = open.document.figure().selections.iter().find(|s| s.name == self.slot);
        let same = |read: &Selection| {
            same_grid(read.grid(), self.before.grid()) && read.changed_since(&self.before).is_empty()
        };
        match slot.filter(|s| s.voxels.is_some()) {
            None => self.is_new && slot.is_none(),
            Some(slot) => {
                let read = open.selections_of(slot).and_then(|read| read.structures.first());
                !self.is_new && read.is_some_and(|structure| same(&structure.selection))
            }
        }
    }

    /// Puts a new selection with a region of its own into the figure: a part of the gesture under way.
    pub fn add(&mut self, open: &mut OpenFigure) {
        if !std::mem::take(&mut self.is_new) {
            return;
        }
        let Some(object) = open.chosen() else { return };
        let used = |color: &[u8; 3]| object.regions.iter().any(|r| r.look.tint == Some(Tint::Color(*color)));
        let color = COLORS.iter().find(|color| !used(color)).unwrap_or(&COLORS[object.regions.len() % COLORS.len()]);
        let look = LookTemplate { tint: Some(Tint::Color(*color)), ..LookTemplate::default() };
        let region = RegionTemplate { look, ..RegionTemplate::of(&self.slot, Some(self.slot.clone())) };
        let (number, place) = (open.object, object.regions.len());
        let slot = SelectionSlot::painted(&self.slot, &object.volume, SelectionVoxels::new(self.before.clone()));
        open.edit(Command::AddSelections { object: number, slot, region });
        open.choose(number, Some(Chosen { region: place, structure: None }));
    }

    /// Makes the selection what it is now.
    pub fn set(&self, open: &mut OpenFigure, now: Selection, label: String) {
        let voxels = SelectionVoxels::new(now);
        open.edit(Command::SetVoxels { slot: self.slot.clone(), voxels, label });
    }
}

/// How something is put into a selection.
pub fn combination(erases: bool) -> Combination {
    if erases { Combination::Subtract } else { Combination::Union }
}

/// What an edit that adds or takes away is called.
pub fn label(verb: &str, title: &str, erases: bool, num_voxels: f64) -> String {
    let count = grouped(num_voxels.abs().round() as u64);
    let what = if num_voxels.abs().round() == 1.0 { "voxel" } else { "voxels" };
    match (verb, erases) {
        ("Paint", true) => format!("Erase from {title}, {count} {what}"),
        (_, true) => format!("{verb} out of {title}, {count} {what}"),
        _ => format!("{verb} {title}, {count} {what}"),
    }
}

/// "4 812".
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_called_by_what_they_did() {
        assert_eq!(label("Paint", "Brain", false, 4812.4), "Paint Brain, 4 812 voxels");
        assert_eq!(label("Paint", "Brain", true, -1.0), "Erase from Brain, 1 voxel");
        assert_eq!(label("Lasso", "Table", true, -1_234_567.0), "Lasso out of Table, 1 234 567 voxels");
        assert_eq!(grouped(12), "12");
    }
}
