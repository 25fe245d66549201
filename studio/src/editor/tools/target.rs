//! What is painted into: a selection of the chosen object, a new one, or a copy of a structure that comes from a file.

use std::sync::Arc;

use fabrica_engine::selection::{BrickPool, Selection};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::labels::{Label, same_grid};

use super::super::open_figure::OpenFigure;
use super::Mode;
use crate::figure::bridge::drawn;
use crate::figure::command::Chosen;
use crate::figure::template::{
    IMPORTANCE, LookTemplate, ObjectTemplate, RegionTemplate, SelectionSlot, SelectionVoxels, Tint,
};
use crate::figure::{Command, Template};

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

/// What is meant to be painted into.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Aim {
    /// A selection that is yet to be made.
    #[default]
    New,
    /// What is painted in the slot of this name.
    Painted(String),
    /// A structure of the chosen object that comes from a file. Files are not written to: a copy of it takes its place.
    Copy(Chosen),
}

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
    origin: Origin,
}

/// Where a target comes from.
#[derive(Clone)]
enum Origin {
    /// The figure has it.
    Known,
    /// The figure does not have it yet.
    New,
    /// The figure has it as a structure from a file: this part, and how its copy is drawn.
    Copy(Chosen, Box<RegionTemplate>),
}

/// The painted selections of the chosen object: slots, and what their regions are called.
pub fn all(open: &OpenFigure) -> Vec<(String, String)> {
    let slots = &open.document.figure().selections;
    let is_painted = |region: &&RegionTemplate| slots.iter().any(|s| s.name == region.selection && s.voxels.is_some());
    let regions = open.chosen().map_or(&[][..], |object| &object.regions);
    regions.iter().filter(is_painted).map(|r| (r.selection.clone(), r.title().to_owned())).collect()
}

/// What tools are aimed at by choosing the region that is chosen; none where that is a group, or nothing.
pub fn chosen(open: &OpenFigure) -> Option<Aim> {
    let part = open.chosen_region()?;
    let region = open.chosen()?.regions.get(part.region)?;
    let slot = open.document.figure().selections.iter().find(|s| s.name == region.selection)?;
    if slot.voxels.is_some() {
        return Some(Aim::Painted(slot.name.clone()));
    }
    (part.structure.is_some() || region.structure.is_some()).then(|| Aim::Copy(part.clone()))
}

/// What that structure of the chosen object is called; none where it is not drawn.
pub fn title(open: &OpenFigure, part: &Chosen) -> Option<String> {
    let region = open.chosen()?.regions.get(part.region)?;
    let structures = &open.structures_of(region)?.structures;
    let is_it = |name: &String| drawn(region, structures).any(|s| region.called(&s.label) == *name);
    match &part.structure {
        Some(name) => is_it(name).then(|| name.clone()),
        None => drawn(region, structures).next().map(|_| region.title().to_owned()),
    }
}

/// The structure of a group, with its object, that is drawn as what was painted in this slot.
pub fn original(figure: &Template, slot: &str) -> Option<(usize, Chosen)> {
    figure.objects.iter().enumerate().find_map(|(object, template)| {
        template.regions.iter().enumerate().find_map(|(region, group)| {
            let is_it = |by: &Option<String>| by.as_deref() == Some(slot);
            let structure = group.structures.iter().find(|s| is_it(&s.replaced_by))?.structure.clone();
            Some((object, Chosen { region, structure: Some(structure) }))
        })
    })
}

/// The region that is drawn in place of a structure of the chosen object.
pub fn copy(open: &OpenFigure, part: &Chosen) -> Option<Chosen> {
    let regions = &open.chosen()?.regions;
    let structures = &regions.get(part.region)?.structures;
    let slot = structures.iter().find(|s| Some(&s.structure) == part.structure.as_ref())?.replaced_by.as_ref()?;
    let region = regions.iter().position(|r| r.selection == *slot)?;
    Some(Chosen { region, structure: None })
}

impl Target {
    /// What is aimed at; a new one where that is gone.
    ///
    /// # Errors
    /// A sentence about why there is none.
    pub fn of(open: &OpenFigure, aim: &Aim) -> Result<Self, String> {
        let (Some(object), Some(volume)) = (open.chosen(), open.chosen_volume().cloned()) else {
            return Err("The object has no volume to paint on".to_owned());
        };
        let figure = open.document.figure();
        let known = match aim {
            Aim::New => None,
            Aim::Painted(name) => figure.selections.iter().find(|s| s.name == *name && s.voxels.is_some()),
            Aim::Copy(part) => return Self::copy(open, object, part, volume),
        };
        let Some(known) = known else { return Ok(Self::new(open, object, volume)) };
        let title = all(open).into_iter().find(|(slot, _)| *slot == known.name).map(|(_, title)| title);
        let title = title.ok_or("That selection belongs to another object; choose the object first")?;
        // On other voxels it was resampled, if it could be.
        let read = open.selections_of(known).and_then(|read| read.structures.first());
        let before = read.map(|structure| structure.selection.clone());
        let before = before.filter(|selection| same_grid(selection.grid(), &volume.grid));
        let before = before.ok_or("That selection is not there yet; wait until it is read")?;
        Ok(Self { slot: known.name.clone(), title, before, volume, origin: Origin::Known })
    }

    /// A copy of a structure as it is drawn: its borders as they were smoothed, its look, where it was moved to.
    fn copy(open: &OpenFigure, object: &ObjectTemplate, part: &Chosen, volume: Arc<Volume>) -> Result<Self, String> {
        let gone = "That structure is not there; choose another one, or a new selection";
        let region = object.regions.get(part.region).ok_or(gone)?;
        let read = open.structures_of(region).ok_or("That structure is not there yet; wait until it is read")?;
        let is_it = |label: &Label| part.structure.as_ref().is_none_or(|name| region.called(label) == *name);
        let found = drawn(region, &read.structures).find(|s| is_it(&s.label)).ok_or(gone)?;
        let title = part.structure.clone().unwrap_or_else(|| region.title().to_owned());
        let used = &open.document.figure().selections;
        let is_free = |name: &String| used.iter().all(|s| s.name != *name);
        let others = (2..).map(|i| format!("{title} {i}"));
        let slot = std::iter::once(title.clone()).chain(others).find(is_free).unwrap_or_default();
        let name = part.structure.as_deref();
        let mut look = region.look_at(name);
        // Its own color is that of its label map, which the copy has not.
        let is_own = look.tint == Some(Tint::Own) || look.tint.is_none() && region.structure.is_none();
        if is_own {
            look.tint = Some(Tint::Color(found.label.color));
        }
        let moved = match name.and_then(|_| region.own_move(name)).or(region.moved.as_ref()) {
            Some(moved) if name.is_some() && region.own_move(name).is_none() => {
                // Where its group is, about its own middle.
                let center =
                    |structure: Option<String>| open.center_mm(open.object, &Chosen { region: part.region, structure });
                let centers = center(None).zip(center(part.structure.clone())).zip(open.radius_mm());
                centers.map(|((group, own), radius_mm)| moved.with_center(group, own, radius_mm))
            }
            moved => moved.cloned(),
        };
        let importance = Some(region.importance_of(name)).filter(|importance| *importance != IMPORTANCE);
        let copy = RegionTemplate {
            name: if slot == title { String::new() } else { title.clone() },
            look,
            moved,
            importance,
            ..RegionTemplate::of(&slot, Some(slot.clone()))
        };
        let before = found.selection.clone();
        Ok(Self { slot, title, before, volume, origin: Origin::Copy(part.clone(), Box::new(copy)) })
    }

    fn new(open: &OpenFigure, object: &ObjectTemplate, volume: Arc<Volume>) -> Self {
        let figure = open.document.figure();
        let is_free = |name: &String| {
            figure.selections.iter().all(|s| s.name != *name) && object.regions.iter().all(|r| r.title() != name)
        };
        let slot = (1..).map(|i| format!("Selection {i}")).find(is_free).unwrap_or_default();
        let before = Selection::empty(volume.grid, &Arc::new(BrickPool::default()));
        Self { title: slot.clone(), slot, before, volume, origin: Origin::New }
    }

    /// Whether the figure has it still as it was before the edit.
    pub fn is_current(&self, open: &OpenFigure) -> bool {
        let slot = open.document.figure().selections.iter().find(|s| s.name == self.slot);
        let same = |read: &Selection| {
            same_grid(read.grid(), self.before.grid()) && read.changed_since(&self.before).is_empty()
        };
        match (&self.origin, slot) {
            (Origin::New, slot) => slot.is_none(),
            (Origin::Copy(part, _), slot) => {
                let now = Self::of(open, &Aim::Copy(part.clone()));
                slot.is_none() && now.is_ok_and(|now| now.title == self.title && same(&now.before))
            }
            (Origin::Known, slot) => {
                let read = slot.filter(|s| s.voxels.is_some()).and_then(|slot| open.selections_of(slot));
                read.and_then(|read| read.structures.first()).is_some_and(|structure| same(&structure.selection))
            }
        }
    }

    /// Puts a selection that is not in the figure yet into it, with a region of its own: a part of the gesture under way.
    pub fn add(&mut self, open: &mut OpenFigure) {
        let Some(object) = open.chosen() else { return };
        match std::mem::replace(&mut self.origin, Origin::Known) {
            Origin::Known => return,
            Origin::New => {}
            Origin::Copy(Chosen { region, structure }, copy) => {
                let slot =
                    SelectionSlot::painted(&self.slot, &object.volume, SelectionVoxels::new(self.before.clone()));
                let number = open.object;
                // In the place of a region, after a group.
                let place = region + usize::from(structure.is_some());
                open.edit(Command::CopyStructure { object: number, region, structure, slot, copy: *copy });
                open.choose(number, Some(Chosen { region: place, structure: None }));
                return;
            }
        }
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

/// What an edit by a tool is called.
pub fn named(verb: &str, title: &str, mode: Mode) -> String {
    match mode {
        Mode::Add => format!("{verb} {title}"),
        Mode::Subtract => format!("{verb} out of {title}"),
        Mode::Replace => format!("{verb} in place of {title}"),
        Mode::Intersect => format!("{verb} within {title}"),
    }
}

/// What a stroke is called.
pub fn stroke(title: &str, erases: bool, num_voxels: f64) -> String {
    let count = grouped(num_voxels.abs().round() as u64);
    let what = if num_voxels.abs().round() == 1.0 { "voxel" } else { "voxels" };
    let verb = if erases { "Erase from" } else { "Paint" };
    format!("{verb} {title}, {count} {what}")
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
        assert_eq!(stroke("Brain", false, 4812.4), "Paint Brain, 4 812 voxels");
        assert_eq!(stroke("Brain", true, -1.0), "Erase from Brain, 1 voxel");
        assert_eq!(named("Lasso", "Table", Mode::Subtract), "Lasso out of Table");
        assert_eq!(grouped(1_234_567), "1 234 567");
        assert_eq!(grouped(12), "12");
    }
}
