//! The figure that is open: its document, its volumes, and what is chosen in it. Panels and gestures work on this.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};

use eframe::egui::Response;
use fabrica_engine::Progress;
use fabrica_engine::scene::Scene;
use fabrica_engine::selection::{DistanceField, Structure};
use fabrica_engine::volume::Volume;
use glam::DVec3;

use super::wording;
use crate::figure::command::{Chosen, FunctionOf, function_at};
use crate::figure::sources::{self, Selections, Sources};
use crate::figure::template::{
    MoveTemplate, ObjectTemplate, Reference, RegionTemplate, SelectionSlot, TransferFunctionTemplate, VolumeSlot,
};
use crate::figure::theme::Wardrobe;
use crate::figure::{Command, Document, Template, bridge};

/// What the radius depends on that lengths are relative to.
type RadiusOf = (TransferFunctionTemplate, Reference, Arc<Volume>);

/// The most that volumes take that are kept though no slot has them now: what filters were applied to, and what undo may want.
const KEPT_BYTES: usize = 2 << 30;

/// A figure that is open.
pub struct OpenFigure {
    /// The figure with its past.
    pub document: Document,
    /// Where it is saved; none for one that a volume was dressed in, or that a shipped template began.
    pub path: Option<PathBuf>,
    /// The object that panels show.
    pub object: usize,
    /// The region of it that is chosen, if one is.
    region: Option<Chosen>,
    /// Structures of the same group that are chosen together with it.
    others: Vec<String>,
    /// The one of them that ranges go on from; none: the first.
    anchor: Option<String>,
    /// The part of an object that a style that is carried over the picture would dress.
    pub aimed: Option<(usize, Chosen)>,
    /// Whether the list of regions shall scroll to what is chosen.
    pub reveals_region: bool,
    /// The row of its transfer function that is worked on.
    pub row: usize,
    /// The node of that row that is chosen.
    pub node: Option<usize>,
    /// What went wrong with the last edit, until it is told.
    pub fault: Option<String>,
    /// Every volume that was read for it, with the slot that it was read for: undo may bring a slot back.
    volumes: Vec<(VolumeSlot, Arc<Volume>)>,
    /// All selections that were read for it, with the slot and the volume that they were read for.
    selections: Vec<(SelectionSlot, Weak<Volume>, Arc<Selections>)>,
    /// What lengths of moves are relative to, mm, and what that was found for.
    radius: RefCell<Option<(RadiusOf, f64)>>,
    /// The scene of a figure, until the figure changes.
    scene: Option<(Arc<Template>, Option<Arc<Scene>>)>,
}

impl OpenFigure {
    /// A figure with what was read for its slots (none, if it could not be).
    pub fn new(document: Document, path: Option<PathBuf>, sources: &Sources) -> Self {
        let figure = document.figure().clone();
        let volumes = figure.volumes.iter().cloned().zip(sources.volumes.iter().cloned()).collect();
        let mut open = Self {
            document,
            path,
            object: 0,
            region: None,
            others: Vec::new(),
            anchor: None,
            aimed: None,
            reveals_region: false,
            row: 0,
            node: None,
            fault: None,
            volumes,
            selections: Vec::new(),
            radius: RefCell::default(),
            scene: None,
        };
        for (slot, read) in figure.selections.iter().zip(&sources.selections) {
            if let Some(volume) = open.volume_named(&slot.volume).cloned() {
                open.keep_selections(slot.clone(), &volume, read.clone());
            }
        }
        open
    }

    /// What it is called in the title bar.
    pub fn name(&self) -> String {
        match (&self.path, &self.document.figure().title) {
            (Some(path), _) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            (None, title) if !title.is_empty() => title.clone(),
            _ => "Untitled figure".to_owned(),
        }
    }

    /// The folder that its relative file names count from.
    pub fn folder(&self) -> &Path {
        self.path.as_deref().and_then(Path::parent).unwrap_or(Path::new(""))
    }

    /// The volumes of all slots, if none is missing.
    pub fn volumes(&self) -> Option<Vec<Arc<Volume>>> {
        self.document.figure().volumes.iter().map(|slot| self.volume_of(slot).cloned()).collect()
    }

    /// The first slot whose volume was not read.
    pub fn missing(&self) -> Option<usize> {
        self.document.figure().volumes.iter().position(|slot| self.volume_of(slot).is_none())
    }

    /// Why the letters R, L, A, P, S, I of what is seen may be wrong: a volume's file does not say how it lies.
    pub fn assumed_orientation(&self) -> Option<&str> {
        let slots = &self.document.figure().volumes;
        slots.iter().filter_map(|slot| self.volume_of(slot)).find_map(|volume| volume.orientation.assumption())
    }

    /// The volume of a slot, if it was read.
    pub fn volume_of(&self, slot: &VolumeSlot) -> Option<&Arc<Volume>> {
        self.volumes.iter().find(|(read, _)| read.reads_same(slot)).map(|(_, volume)| volume)
    }

    /// The volume of the slot of that name, if it was read.
    fn volume_named(&self, name: &str) -> Option<&Arc<Volume>> {
        self.volume_of(self.document.figure().volumes.iter().find(|v| v.name == name)?)
    }

    /// The selections of a slot, if they were read for the volume that it has now.
    pub fn selections_of(&self, slot: &SelectionSlot) -> Option<&Arc<Selections>> {
        let volume = self.volume_named(&slot.volume)?;
        let is_it = |(read, of, _): &&(SelectionSlot, Weak<Volume>, _)| {
            read.reads_same(slot) && std::ptr::eq(of.as_ptr(), Arc::as_ptr(volume))
        };
        self.selections.iter().find(is_it).map(|(.., selections)| selections)
    }

    /// The first slot whose selections were not read, with its volume, which was.
    pub fn missing_selections(&self) -> Option<(SelectionSlot, Arc<Volume>)> {
        let mut slots = self.document.figure().selections.iter();
        slots.find_map(|slot| match self.selections_of(slot) {
            None => Some((slot.clone(), self.volume_named(&slot.volume)?.clone())),
            Some(_) => None,
        })
    }

    /// The first slot whose selections could not be read, and why; but for those that are `known` to be missing.
    pub fn missing_structures(&self, known: &[SelectionSlot]) -> Option<(usize, String)> {
        let slots = self.document.figure().selections.iter().enumerate();
        let mut missing = slots.filter(|(_, slot)| !known.contains(slot)).filter_map(|(number, slot)| {
            let read = self.selections_of(slot).filter(|read| read.is_missing)?;
            Some((number, read.notes.first()?.clone()))
        });
        missing.next()
    }

    /// What was read for a slot is read anew.
    pub fn forget_selections(&mut self, slot: &SelectionSlot) {
        self.selections.retain(|(read, ..)| !read.reads_same(slot));
        self.scene = None;
    }

    /// Takes what is painted in the figure as it is now for what was read: at once, as it is in memory. To be called whenever
    /// the document may have changed by itself (undo) and before anybody asks for sources.
    pub fn follow_voxels(&mut self) {
        let figure = self.document.figure().clone();
        for slot in figure.selections.iter().filter(|slot| slot.voxels.is_some()) {
            let Some(volume) = self.volume_named(&slot.volume).cloned() else { continue };
            if self.selections_of(slot).is_none()
                && let Some(painted) = sources::painted(slot, &volume)
            {
                // What it was before is in the document's past.
                self.selections.retain(|(read, ..)| read.name != slot.name || read.voxels.is_none());
                self.keep_selections(slot.clone(), &volume, painted);
            }
        }
    }

    /// Keeps selections for a slot and the volume that they were read for.
    pub fn keep_selections(&mut self, slot: SelectionSlot, volume: &Arc<Volume>, read: Arc<Selections>) {
        self.selections.push((slot, Arc::downgrade(volume), read));
        self.scene = None;
    }

    /// What was read for all slots; none if a volume is missing. Selections that are still to be read are empty.
    pub fn sources(&self) -> Option<Sources> {
        let volumes = self.volumes()?;
        let slots = self.document.figure().selections.iter();
        Some(Sources {
            volumes,
            selections: slots.map(|s| self.selections_of(s).cloned().unwrap_or_default()).collect(),
        })
    }

    /// Keeps a volume for a slot. What no slot has now is given up beyond [`KEPT_BYTES`], what filters made first, then what was kept
    /// first: undo makes or reads it again.
    pub fn keep_volume(&mut self, slot: VolumeSlot, volume: Arc<Volume>) {
        self.volumes.retain(|(read, _)| !read.reads_same(&slot));
        self.volumes.push((slot, volume));
        self.scene = None;
        let wanted = &self.document.figure().volumes;
        // The one that has just come is about to be used.
        let last = self.volumes.len() - 1;
        let is_spare = |(i, (slot, _)): &(usize, &(VolumeSlot, _))| {
            *i != last && !wanted.iter().any(|wanted| wanted.reads_same(slot))
        };
        let mut spare: Vec<usize> = self.volumes.iter().enumerate().filter(is_spare).map(|(i, _)| i).collect();
        spare.sort_by_key(|i| (!self.volumes[*i].0.filters.is_empty(), std::cmp::Reverse(*i)));
        let mut bytes = 0;
        let mut kept: Vec<bool> = vec![true; self.volumes.len()];
        for i in spare {
            bytes += self.volumes[i].1.num_bytes();
            kept[i] = bytes <= KEPT_BYTES;
        }
        let mut kept = kept.into_iter();
        self.volumes.retain(|_| kept.next().unwrap_or(true));
    }

    /// What was read for a slot before its filters, if it is still there.
    pub fn unfiltered(&self, slot: &VolumeSlot) -> Option<&Arc<Volume>> {
        self.volume_of(&slot.unfiltered())
    }

    /// The slots change their files' names, in the past as well: the figure is saved elsewhere.
    pub fn rename_files(&mut self, rename: impl Fn(&mut String)) {
        self.document.map_all(|figure| figure.files_mut().for_each(&rename));
        self.volumes.iter_mut().for_each(|(slot, _)| rename(&mut slot.file));
        self.selections.iter_mut().for_each(|(slot, ..)| slot.files_mut().for_each(&rename));
    }

    /// The object that is chosen.
    pub fn chosen(&self) -> Option<&ObjectTemplate> {
        self.document.figure().objects.get(self.object)
    }

    /// Chooses an object, and a region of it.
    pub fn choose(&mut self, object: usize, region: Option<Chosen>) {
        if (self.object, &self.region) != (object, &region) {
            (self.node, self.row) = (None, 0);
        }
        (self.object, self.region) = (object, region);
        self.others.clear();
        self.anchor = None;
    }

    /// Chooses structures of the chosen one's group as well; those that are, no longer.
    pub fn choose_too(&mut self, structure: &str) {
        let Some(Chosen { structure: Some(first), .. }) = &mut self.region else { return };
        if first == structure {
            // Another one comes first then; the last stays.
            if let Some(next) = self.others.pop() {
                *first = next;
                self.node = None;
            }
            self.anchor = None;
            return;
        }
        self.anchor = Some(structure.to_owned());
        if let Some(place) = self.others.iter().position(|other| other == structure) {
            self.others.remove(place);
        } else {
            self.others.push(structure.to_owned());
        }
    }

    /// Chooses these structures of the chosen one's group, from the one that ranges go on from; `adds`: as well.
    pub fn choose_range(&mut self, structures: Vec<String>, adds: bool) {
        let anchor = self.anchor();
        let Some(Chosen { structure: Some(first), .. }) = &mut self.region else { return };
        if !adds {
            self.others.clear();
            // What ranges go on from is in each of them.
            if let Some(anchor) = anchor.and_then(|part| part.structure).filter(|anchor| anchor != first) {
                *first = anchor;
                self.node = None;
            }
        }
        let is_new = |s: &String| s != first && !self.others.contains(s);
        let new: Vec<String> = structures.into_iter().filter(is_new).collect();
        self.others.extend(new);
    }

    /// The part that ranges in its list go on from: what was chosen last, but for ranges.
    pub fn anchor(&self) -> Option<Chosen> {
        let chosen = self.chosen_region()?;
        let anchor = self.anchor.as_ref().filter(|anchor| self.others.contains(anchor));
        let structure = anchor.or(chosen.structure.as_ref()).cloned();
        Some(Chosen { region: chosen.region, structure })
    }

    /// The region that is chosen, as long as there is one.
    pub fn chosen_region(&self) -> Option<&Chosen> {
        let regions = &self.chosen()?.regions;
        self.region.as_ref().filter(|chosen| chosen.region < regions.len())
    }

    /// The structures of a group that are chosen, the first of them first; empty where none is, or the region itself.
    pub fn chosen_structures(&self) -> impl Iterator<Item = &String> {
        let first = self.chosen_region().and_then(|chosen| chosen.structure.as_ref());
        first.into_iter().chain(first.is_some().then_some(&self.others).into_iter().flatten())
    }

    /// Whether a region, or a structure of one, is among what is chosen.
    pub fn is_chosen(&self, object: usize, part: &Chosen) -> bool {
        let region = self.chosen_region().filter(|_| self.object == object);
        region.is_some_and(|chosen| {
            chosen == part
                || chosen.region == part.region
                    && part.structure.as_ref().is_some_and(|s| self.chosen_structures().any(|other| other == s))
        })
    }

    /// Whose transfer function is worked on: what is chosen, else the object.
    pub fn function_of(&self) -> FunctionOf {
        FunctionOf { object: self.object, part: self.chosen_region().cloned(), row: self.row }
    }

    /// The row of a transfer function that is worked on, by itself.
    pub fn function(&self) -> Option<TransferFunctionTemplate> {
        Some(self.whole_function()?.row(self.row))
    }

    /// The same, with all of its rows.
    pub fn whole_function(&self) -> Option<TransferFunctionTemplate> {
        function_at(self.document.figure(), &self.function_of())
    }

    /// How many rows it has.
    pub fn num_rows(&self) -> usize {
        self.whole_function().map_or(1, |function| function.num_rows())
    }

    /// The distances from what the chosen object calls so; none while its voxels, or the volume, are not read.
    pub fn distances_from(&self, from: &str) -> Option<Arc<DistanceField>> {
        let (object, volume) = (self.chosen()?, self.chosen_volume()?);
        let structures = |region: &RegionTemplate| self.structures_of(region).map(|s| &s.structures[..]);
        let selections = bridge::measured_from(object, structures, from);
        DistanceField::of(&selections, &volume.grid, &Progress::new()).ok()
    }

    /// Works on another row of it.
    pub fn choose_row(&mut self, row: usize) {
        if self.row != row {
            (self.row, self.node) = (row, None);
        }
    }

    /// Whether the part that is chosen has a transfer function of its own.
    pub fn has_own_function(&self) -> bool {
        let own = |chosen: &Chosen| {
            let region = self.chosen()?.regions.get(chosen.region)?;
            Some(region.own_look(chosen.structure.as_deref()).transfer_function.is_some())
        };
        self.chosen_region().and_then(own).unwrap_or(false)
    }

    /// The structures of a region's selections, as far as they were read.
    pub fn structures_of(&self, region: &RegionTemplate) -> Option<&Arc<Selections>> {
        let slot = self.document.figure().selections.iter().find(|s| s.name == region.selection)?;
        self.selections_of(slot)
    }

    /// What the scene's region number `number` of the first object that is drawn comes from: the object, the part, and its voxels.
    pub fn part_at(&self, number: usize) -> Option<(usize, Chosen, &Structure)> {
        let objects = &self.document.figure().objects;
        let (object, template) = objects.iter().enumerate().find(|(_, object)| object.visible)?;
        let drawn = template.regions.iter().enumerate().flat_map(|(i, region)| {
            let structures = self.structures_of(region).map_or(&[][..], |s| &s.structures);
            bridge::drawn(region, structures).map(move |structure| (i, region, structure))
        });
        let (i, region, structure) = drawn.into_iter().nth(number)?;
        let name = region.structure.is_none().then(|| region.called(&structure.label));
        Some((object, Chosen { region: i, structure: name }, structure))
    }

    /// The structures that are chosen, with their voxels; all of a group.
    pub fn chosen_selections(&self) -> Vec<&Structure> {
        let Some(chosen) = self.chosen_region() else { return Vec::new() };
        let Some(region) = self.chosen().and_then(|o| o.regions.get(chosen.region)) else { return Vec::new() };
        let structures = self.structures_of(region).map_or(&[][..], |s| &s.structures);
        let is_it = |s: &&Structure| chosen.structure.as_ref().is_none_or(|name| region.called(&s.label) == *name);
        bridge::drawn(region, structures).filter(is_it).collect()
    }

    /// The number of its slot.
    pub fn chosen_slot(&self) -> Option<usize> {
        let name = &self.chosen()?.volume;
        self.document.figure().volumes.iter().position(|v| v.name == *name)
    }

    /// Its volume.
    pub fn chosen_volume(&self) -> Option<&Arc<Volume>> {
        self.volume_of(&self.document.figure().volumes[self.chosen_slot()?])
    }

    /// The scene that the figure is just now; `None` where it has no meaning, or a volume is missing.
    pub fn scene<'a>(&mut self, wardrobe: impl Into<Wardrobe<'a>>) -> Option<Arc<Scene>> {
        let figure = self.document.figure();
        if self.scene.as_ref().is_none_or(|(of, _)| !Arc::ptr_eq(of, figure)) {
            let scene = self
                .sources()
                .and_then(|sources| bridge::scene(figure, &sources, wardrobe, &Progress::new()).ok())
                .map(|(scene, _)| Arc::new(scene));
            self.scene = Some((figure.clone(), scene));
        }
        self.scene.as_ref().and_then(|(_, scene)| scene.clone())
    }

    /// What lengths of moves are relative to, mm; none while a volume is not read.
    pub fn radius_mm(&self) -> Option<f64> {
        let figure = self.document.figure();
        let object = figure.objects.first()?;
        // Regions have no part in it.
        let of =
            (object.transfer_function.clone(), figure.camera.relative_to, self.volume_named(&object.volume)?.clone());
        let is_known =
            |known: &(RadiusOf, f64)| (&known.0.0, known.0.1) == (&of.0, of.1) && Arc::ptr_eq(&known.0.2, &of.2);
        if let Some((_, radius_mm)) = self.radius.borrow().as_ref().filter(|known| is_known(known)) {
            return Some(*radius_mm);
        }
        let reference = bridge::reference(figure, &self.sources()?, &Progress::new()).ok()?;
        let radius_mm = bridge::radius_mm(figure, reference.as_ref());
        *self.radius.borrow_mut() = Some((of, radius_mm));
        Some(radius_mm)
    }

    /// What a region turns about, or a structure of it, world mm. None while its voxels are not read.
    pub fn center_mm(&self, object: usize, part: &Chosen) -> Option<DVec3> {
        let object = self.document.figure().objects.get(object)?;
        let region = object.regions.get(part.region)?;
        let structures = &self.structures_of(region)?.structures;
        let grid = &self.volume_named(&object.volume)?.grid;
        Some(bridge::center_mm(region, structures, part.structure.as_deref(), grid))
    }

    /// The corners, at rest, of the box whose middle that is.
    pub fn corners_mm(&self, object: usize, part: &Chosen) -> Option<[DVec3; 8]> {
        let object = self.document.figure().objects.get(object)?;
        let region = object.regions.get(part.region)?;
        let structures = &self.structures_of(region)?.structures;
        let grid = &self.volume_named(&object.volume)?.grid;
        Some(bridge::corners_mm(region, structures, part.structure.as_deref(), grid))
    }

    /// The parts of a slot that are moved by themselves, by their objects, with what they turn about.
    fn moved_of(&self, slot: &str) -> Vec<(usize, Chosen, DVec3)> {
        let mut found = Vec::new();
        for (o, object) in self.document.figure().objects.iter().enumerate() {
            for (r, region) in object.regions.iter().enumerate().filter(|(_, region)| region.selection == slot) {
                let structures = region.structures.iter().map(|s| (Some(&s.structure), s.moved.as_ref()));
                let parts = structures.chain([(None, region.moved.as_ref())]);
                for (structure, _) in parts.filter(|(_, moved)| moved.is_some_and(MoveTemplate::is_moved)) {
                    let part = Chosen { region: r, structure: structure.cloned() };
                    found.extend(self.center_mm(o, &part).map(|center| (o, part, center)));
                }
            }
        }
        found
    }

    /// Makes an edit: a step of its own, or a part of the gesture under way. Where voxels of a region change that is moved, the rest
    /// of it stays where it is: its offset follows what it turns about.
    pub fn edit(&mut self, command: Command) {
        let Command::SetVoxels { slot, label, .. } = &command else { return self.apply(command) };
        let (moved, label) = (self.moved_of(slot), label.clone());
        let is_step = !moved.is_empty() && !self.document.in_gesture();
        if is_step {
            self.document.begin();
        }
        self.apply(command);
        for (object, part, before_mm) in moved {
            let (now, radius) = (self.center_mm(object, &part), self.radius_mm());
            let template =
                self.document.figure().objects[object].regions[part.region].own_move(part.structure.as_deref());
            if let (Some(now_mm), Some(radius_mm), Some(template)) = (now, radius, template) {
                let moves = vec![(part.structure, Some(template.with_center(before_mm, now_mm, radius_mm)))];
                self.apply(Command::SetMove { object, region: part.region, moves, label: label.clone() });
            }
        }
        if is_step {
            self.document.commit();
        }
    }

    fn apply(&mut self, command: Command) {
        if let Err(error) = self.document.apply(command) {
            self.fault = Some(wording::sentence(&error));
        }
        self.follow_voxels();
        self.row = self.row.min(self.num_rows() - 1);
        let num_nodes = self.function().map_or(0, |function| function.nodes.len());
        self.node = self.node.filter(|n| *n < num_nodes);
    }

    /// Follows a widget whose value may be dragged: one drag is one step, and what is typed is one, too. `command` is the edit
    /// that its value asks for, if it changed.
    pub fn edit_by(&mut self, response: &Response, command: Option<Command>) {
        if response.drag_started() {
            self.document.begin();
        }
        // After Escape the hand may still drag: the gesture is over all the same.
        if let Some(command) = command
            && (!response.dragged() || self.document.in_gesture())
        {
            self.edit(command);
        }
        if response.drag_stopped() {
            self.document.commit();
        }
    }
}

#[cfg(test)]
mod tests {
    use fabrica_engine::selection::{BrickPool, Selection};
    use fabrica_engine::spaces::Grid;
    use fabrica_engine::styles::StyleLibrary;
    use fabrica_engine::volume::{Rescale, Voxels};
    use glam::DAffine3;

    use super::*;
    use crate::figure::template::SelectionVoxels;

    #[test]
    fn painting_on_what_was_moved_does_not_move_it() {
        let grid = Grid::new([32; 3], DAffine3::IDENTITY).unwrap();
        let volume = Volume::new(grid, Voxels::U8(vec![200; grid.num_voxels()]), Rescale::IDENTITY, "test").unwrap();
        let text = r#"{"fabrica": 1, "volumes": [{"name": "v", "file": "a.nii"}], "objects": [{"volume": "v",
            "transfer_function": {"domain": "data", "nodes": [{"at": 0, "style": "wax", "opacity": 0.5}]}}],
            "camera": {"from": [0, 1, 0]}, "figure": {"width_mm": 80, "height_mm": 60}}"#;
        let document = Document::new(Template::parse(text).unwrap());
        let mut open = OpenFigure::new(document, None, &Sources::of(vec![Arc::new(volume)]));
        let mut selection = Selection::empty(grid, &Arc::new(BrickPool::default()));
        selection.change([[4, 8], [4, 8], [4, 8]], |_, _| 255);
        let slot = SelectionSlot::painted("Part", "v", SelectionVoxels::new(selection.clone()));
        let region = RegionTemplate::of("Part", Some("Part".to_owned()));
        open.edit(Command::AddSelections { object: 0, slot, region });
        let moved =
            MoveTemplate { turn: [0.0, 40.0, 0.0], scale: 1.5, offset: [0.5, 0.0, 0.0], ..MoveTemplate::default() };
        open.edit(Command::SetMove { object: 0, region: 0, moves: vec![(None, Some(moved))], label: String::new() });
        let styles = StyleLibrary::embedded();
        let pose = |open: &mut OpenFigure| open.scene(&styles).unwrap().objects[0].regions[0].moved().unwrap().pose;
        let (before, center) = (pose(&mut open), open.center_mm(0, &Chosen::default()).unwrap());
        assert_eq!(center, DVec3::splat(5.5));
        selection.change([[20, 30], [4, 6], [4, 6]], |_, _| 255);
        let paint = |now: &Selection| Command::SetVoxels {
            slot: "Part".to_owned(),
            voxels: SelectionVoxels::new(now.clone()),
            label: "Paint Part, 40 voxels".to_owned(),
        };
        open.edit(paint(&selection));
        assert!(open.center_mm(0, &Chosen::default()).unwrap().distance(center) > 5.0);
        assert!(pose(&mut open).abs_diff_eq(before, 1e-9));
        // In the same step, also where a gesture is under way, and where nothing is left for a while.
        assert_eq!(open.document.undo_label(), Some("Paint Part, 40 voxels"));
        open.document.begin();
        open.edit(paint(&Selection::empty(grid, &Arc::new(BrickPool::default()))));
        open.edit(paint(&selection));
        open.document.commit();
        assert!(pose(&mut open).abs_diff_eq(before, 1e-9));
        while open.document.undo_label() != Some("Move Part") {
            assert!(open.document.undo());
        }
        open.follow_voxels();
        assert_eq!(open.center_mm(0, &Chosen::default()).unwrap(), center);
        assert!(pose(&mut open).abs_diff_eq(before, 1e-12));
    }
}
