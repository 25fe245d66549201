//! The figure that is edited: its present, its past (undo), its undone future (redo), what is on the disk. One step per
//! gesture, within a budget of memory.
//!
//! A step keeps the figure as it was. Figures are a few kilobytes of plain data (volumes are shared outside of them, and copies of
//! painted voxels share the bricks that are alike), so that whole copies are cheaper to get right than inverse commands, and
//! undoing everything gives the first figure byte for byte.

use std::collections::VecDeque;
use std::sync::Arc;

use anyhow::Result;

use super::command::Command;
use super::template::{SelectionVoxels, Template};

/// Memory that past figures may take, in bytes: of voxels, what a step does not share with the next.
const BUDGET: usize = 64 << 20;

#[derive(Clone, Debug)]
struct Step {
    label: String,
    /// The figure before the step (undo) or after it (redo).
    figure: Arc<Template>,
    bytes: usize,
}

/// A gesture that is not finished: a drag with the button still down.
#[derive(Clone, Debug)]
struct Gesture {
    before: Arc<Template>,
    label: Option<String>,
}

/// A figure with its past and its undone future.
#[derive(Clone, Debug)]
pub struct Document {
    figure: Arc<Template>,
    undo: VecDeque<Step>,
    redo: Vec<Step>,
    gesture: Option<Gesture>,
    /// The last command, while nothing else has happened since: what a later one may merge with.
    last: Option<Command>,
    /// What is on the disk, if it was ever there.
    saved: Option<Arc<Template>>,
    budget: usize,
}

impl Document {
    /// A document without a past, as if just saved.
    pub fn new(figure: Template) -> Self {
        let saved = figure.clone();
        Self::recovered(figure, Some(saved))
    }

    /// A document without a past, after a crash: `saved` is what the disk holds (none: nothing that can be read), against
    /// which the figure counts as changed.
    pub fn recovered(figure: Template, saved: Option<Template>) -> Self {
        Self {
            saved: saved.map(Arc::new),
            figure: Arc::new(figure),
            undo: VecDeque::new(),
            redo: Vec::new(),
            gesture: None,
            last: None,
            budget: BUDGET,
        }
    }

    /// The figure as it is now.
    pub fn figure(&self) -> &Arc<Template> {
        &self.figure
    }

    /// Whether it is another one than on the disk.
    pub fn is_changed(&self) -> bool {
        self.saved.as_ref() != Some(&self.figure)
    }

    /// Takes note that the figure, as it is now, was written.
    pub fn mark_saved(&mut self) {
        self.saved = Some(self.figure.clone());
    }

    /// Changes the figure and its past and future alike: no edit, but another way to say the same (files have other names
    /// from another folder).
    pub fn map_all(&mut self, change: impl Fn(&mut Template)) {
        let past = self.undo.iter_mut().chain(&mut self.redo).map(|step| &mut step.figure);
        for figure in past.chain([&mut self.figure]).chain(&mut self.saved) {
            change(Arc::make_mut(figure));
        }
        self.last = None;
    }

    /// Memory that the past takes, in bytes, near enough: what counts against its budget.
    pub fn undo_bytes(&self) -> usize {
        self.undo.iter().map(|step| step.bytes).sum()
    }

    /// What undo would take back.
    pub fn undo_label(&self) -> Option<&str> {
        self.undo.back().map(|step| step.label.as_str())
    }

    /// What redo would bring again.
    pub fn redo_label(&self) -> Option<&str> {
        self.redo.last().map(|step| step.label.as_str())
    }

    /// The undo steps' labels, oldest first.
    pub fn labels(&self) -> impl Iterator<Item = &str> {
        self.undo.iter().map(|step| step.label.as_str())
    }

    /// The undone steps' labels, the one that redo brings first.
    pub fn undone_labels(&self) -> impl Iterator<Item = &str> {
        self.redo.iter().rev().map(|step| step.label.as_str())
    }

    /// Makes an edit: a step of its own, or a part of the gesture that is under way. An edit that changes nothing is none.
    ///
    /// # Errors
    /// What the command says; nothing has then happened.
    pub fn apply(&mut self, command: Command) -> Result<()> {
        let (label, kept) = (command.label(&self.figure), command.clone());
        let mut figure = Template::clone(&self.figure);
        command.apply(&mut figure)?;
        if figure == *self.figure {
            return Ok(());
        }
        let before = std::mem::replace(&mut self.figure, Arc::new(figure));
        match &mut self.gesture {
            Some(gesture) => gesture.label = Some(label),
            None => {
                let merges = self.last.as_ref().is_some_and(|last| last.merges_with(&kept)) && self.redo.is_empty();
                if !merges {
                    self.push(label, before);
                }
                self.redo.clear();
                self.last = Some(kept);
            }
        }
        Ok(())
    }

    /// Begins a gesture: what is applied until [`Document::commit`] is one step. One that is under way is committed first.
    pub fn begin(&mut self) {
        self.commit();
        self.gesture = Some(Gesture { before: self.figure.clone(), label: None });
    }

    /// Ends a gesture, with one undo step if it changed anything.
    pub fn commit(&mut self) {
        let Some(gesture) = self.gesture.take() else { return };
        let Some(label) = gesture.label.filter(|_| gesture.before != self.figure) else { return };
        self.push(label, gesture.before);
        self.redo.clear();
        self.last = None;
    }

    /// Gives a gesture up: the figure is again what it was at its start.
    pub fn abort(&mut self) {
        if let Some(gesture) = self.gesture.take() {
            self.figure = gesture.before;
        }
    }

    /// Whether a gesture is under way.
    pub fn in_gesture(&self) -> bool {
        self.gesture.is_some()
    }

    /// Whether a gesture is under way that has changed something: a hand that only rests has not.
    pub fn in_motion(&self) -> bool {
        self.gesture.as_ref().is_some_and(|g| g.label.is_some())
    }

    /// Takes the last step back (a gesture under way is aborted instead); whether there was one.
    pub fn undo(&mut self) -> bool {
        if self.in_gesture() {
            self.abort();
            return true;
        }
        let Some(step) = self.undo.pop_back() else { return false };
        let now = std::mem::replace(&mut self.figure, step.figure);
        self.redo.push(Step { label: step.label, bytes: size(&now, &self.figure), figure: now });
        self.last = None;
        true
    }

    /// Brings the last undone step again; whether there was one.
    pub fn redo(&mut self) -> bool {
        if self.in_gesture() {
            return false;
        }
        let Some(step) = self.redo.pop() else { return false };
        let before = std::mem::replace(&mut self.figure, step.figure);
        self.push(step.label, before);
        self.last = None;
        true
    }

    fn push(&mut self, label: String, before: Arc<Template>) {
        let bytes = size(&before, &self.figure);
        self.undo.push_back(Step { label, figure: before, bytes });
        let mut all = self.undo_bytes();
        while all > self.budget
            && let Some(oldest) = self.undo.pop_front()
        {
            all -= oldest.bytes;
        }
    }
}

/// What a figure takes beside the next, near enough.
fn size(figure: &Template, next: &Template) -> usize {
    let regions = || figure.objects.iter().flat_map(|o| &o.regions);
    let looks = || regions().flat_map(|r| std::iter::once(&r.look).chain(r.structures.iter().map(|s| &s.look)));
    let functions = looks().filter_map(|look| look.transfer_function.as_ref());
    let nodes: usize =
        figure.objects.iter().map(|o| &o.transfer_function).chain(functions).map(|f| f.all_nodes().count()).sum();
    let moves = regions().flat_map(|r| r.moved.iter().chain(r.structures.iter().filter_map(|s| s.moved.as_ref())));
    let meetings = moves.flat_map(|m| [&m.meets_ghost, &m.meets_background]).flatten();
    let strengths = meetings.filter(|m| m.strength.is_some()).count();
    let painted = |figure: &'_ Template| {
        let slots = figure.selections.iter().filter_map(|s| Some((s.name.clone(), s.voxels.clone()?)));
        slots.collect::<Vec<_>>()
    };
    let after = painted(next);
    let own = |(name, voxels): (String, SelectionVoxels)| match after.iter().find(|(other, _)| *other == name) {
        Some((_, other)) => voxels.unshared_bytes(other),
        None => voxels.selection().num_bytes(),
    };
    2048 + 256 * (nodes + looks().count()) + 4096 * strengths + painted(figure).into_iter().map(own).sum::<usize>()
}

#[cfg(test)]
mod tests {
    use fabrica_engine::scene::moved::{STRENGTH_SIZE, Strength};
    use fabrica_engine::selection::{BrickPool, Brush, BrushMode, Limits, Profile, Selection, Stroke};
    use fabrica_engine::spaces::Grid;
    use glam::DAffine3;

    use super::*;
    use crate::figure::command::{Chosen, FunctionOf, function_at};
    use crate::figure::template::{
        AcrossTemplate, AxisName, Background, ContoursTemplate, LightTemplate, LightingModel, LightingTemplate,
        LookTemplate, MeetingStrength, MeetingTemplate, MoveTemplate, NodeTemplate, ProjectionName, QualityName,
        RegionTemplate, RestTemplate, Rgb, RowTemplate, SelectionSlot, ShadingTemplate, Tint, TransferFunctionTemplate,
        Transparency, VolumeSlot,
    };

    fn figure() -> Template {
        Template::parse(include_str!("../../../templates/head_glass.json")).unwrap()
    }

    fn part(region: usize, structure: Option<&str>) -> FunctionOf {
        FunctionOf { object: 0, part: Some(Chosen { region, structure: structure.map(str::to_owned) }), row: 0 }
    }

    fn camera(document: &Document, height: f64) -> Command {
        Command::SetCamera(crate::figure::template::CameraTemplate { height, ..document.figure().camera.clone() })
    }

    #[test]
    fn a_gesture_is_one_step_and_can_be_given_up() {
        let mut document = Document::new(figure());
        document.begin();
        for height in [1.9, 1.8, 1.7] {
            document.apply(camera(&document, height)).unwrap();
        }
        document.commit();
        assert_eq!(document.labels().collect::<Vec<_>>(), ["Move view"]);
        document.begin();
        document.apply(Command::SetTitle("Another".to_owned())).unwrap();
        document.abort();
        assert!(document.figure().title == figure().title && document.figure().camera.height == 1.7);
        // A gesture that comes back to where it began is none.
        document.begin();
        document.apply(camera(&document, 3.0)).unwrap();
        document.apply(camera(&document, 1.7)).unwrap();
        document.commit();
        assert_eq!(document.labels().count(), 1);
        assert!(document.undo() && !document.undo() && !document.is_changed());
        assert_eq!(document.redo_label(), Some("Move view"));
        assert!(document.redo() && document.figure().camera.height == 1.7 && document.is_changed());
    }

    #[test]
    fn views_merge_and_a_new_edit_clears_redo() {
        let mut document = Document::new(figure());
        for height in [1.9, 1.8, 1.7] {
            document.apply(camera(&document, height)).unwrap();
        }
        document.apply(Command::SetQuality(QualityName::Draft)).unwrap();
        document.apply(camera(&document, 1.0)).unwrap();
        assert_eq!(document.labels().collect::<Vec<_>>(), ["Move view", "Change quality", "Move view"]);
        document.undo();
        document.undo();
        document.apply(Command::SetTitle("New".to_owned())).unwrap();
        assert!(document.redo_label().is_none());
        // What changes nothing is no step.
        document.apply(Command::SetTitle("New".to_owned())).unwrap();
        assert_eq!(document.labels().count(), 2);
    }

    #[test]
    fn what_has_no_meaning_changes_nothing() {
        let mut document = Document::new(figure());
        let node = NodeTemplate { at: f64::NAN, style: "bone".to_owned(), opacity: 0.5, extra: Default::default() };
        let camera = crate::figure::template::CameraTemplate { fov_deg: f64::NAN, ..figure().camera };
        for bad in [
            Command::MoveNode { of: FunctionOf::object(0), node: 99, at: 1.0, opacity: 0.5 },
            Command::MoveNode { of: FunctionOf::object(0), node: 0, at: f64::NAN, opacity: 0.5 },
            Command::MoveNode { of: FunctionOf::object(7), node: 0, at: 1.0, opacity: 0.5 },
            Command::InsertNode { of: FunctionOf::object(0), node },
            Command::RemoveNode { of: FunctionOf::object(0), node: 99 },
            Command::MoveNode { of: part(0, None), node: 0, at: 1.0, opacity: 0.5 },
            Command::RemoveNode { of: part(3, Some("liver")), node: 0 },
            Command::SetGradientScale { object: 0, scale_mm: Some(-1.0) },
            Command::SetCamera(camera),
            Command::SetPage(crate::figure::template::Page { width_mm: 0.0, ..figure().figure }),
        ] {
            let said = document.apply(bad.clone()).unwrap_err().to_string();
            assert!(!said.contains('\n') && said.contains(';') || said.contains("number"), "{bad:?}: {said}");
            assert_eq!(**document.figure(), figure(), "{bad:?}");
        }
        assert!(document.undo_label().is_none());
    }

    #[test]
    fn a_part_gets_its_own_function_at_its_first_edit_in_the_same_step() {
        let mut document = Document::new(figure());
        let volume = figure().volumes[0].name.clone();
        let slot = SelectionSlot::new("organs", &volume, "labels.nii.gz".to_owned());
        let mut region = RegionTemplate::of("organs", None);
        region.look.style = Some("wax".to_owned());
        document.apply(Command::AddSelections { object: 0, slot, region }).unwrap();
        let objects = figure().objects[0].transfer_function.clone();
        let liver = part(0, Some("liver"));
        // As it looks: the object's curve in the group's style.
        let before = function_at(document.figure(), &liver).unwrap();
        assert!(before.nodes.iter().all(|n| n.style == "wax") && before.nodes.len() == objects.nodes.len());
        document
            .apply(Command::MoveNode { of: liver.clone(), node: 0, at: objects.nodes[0].at, opacity: 0.33 })
            .unwrap();
        let mut expected = before.clone();
        expected.nodes[0].opacity = 0.33;
        assert_eq!(function_at(document.figure(), &liver).unwrap(), expected);
        assert!(document.undo_label().is_some_and(|label| label.ends_with(" (liver)")));
        // Nobody else's changed; its styles are its own from now on.
        assert_eq!(document.figure().objects[0].transfer_function, objects);
        assert_eq!(function_at(document.figure(), &part(0, Some("spleen"))).unwrap(), before);
        document.apply(Command::SetStyle { of: liver.clone(), nodes: 0..1, style: "clay".to_owned() }).unwrap();
        assert_eq!(function_at(document.figure(), &liver).unwrap().nodes[0].style, "clay");
        document.undo();
        document.undo();
        assert!(document.figure().objects[0].regions[0].structures.is_empty());
        // Of the group itself: all that have none of their own.
        document.apply(Command::RemoveNode { of: part(0, None), node: 0 }).unwrap();
        assert_eq!(function_at(document.figure(), &liver).unwrap().nodes.len(), objects.nodes.len() - 1);
        assert!(document.figure().objects[0].regions[0].look.style.is_none());
    }

    #[test]
    fn a_move_is_one_step_by_drag_and_its_colors_merge() {
        let mut document = Document::new(figure());
        let volume = figure().volumes[0].name.clone();
        let slot = SelectionSlot::new("organs", &volume, "labels.nii.gz".to_owned());
        let region = RegionTemplate::of("organs", Some("liver".to_owned()));
        document.apply(Command::AddSelections { object: 0, slot, region }).unwrap();
        let before = document.figure().to_json().unwrap();
        let set = |moved: Option<MoveTemplate>, label: &str| Command::SetMove {
            object: 0,
            region: 0,
            moves: vec![(None, moved)],
            label: label.to_owned(),
        };
        let to = |x: f64| MoveTemplate { offset: [x, 0.0, 0.0], ..MoveTemplate::default() };
        document.begin();
        for x in [0.1, 0.2, 0.3] {
            document.apply(set(Some(to(x)), &format!("Move liver {:.1} mm", 80.0 * x))).unwrap();
        }
        document.commit();
        assert_eq!(document.undo_label(), Some("Move liver 24.0 mm"));
        // A color that is looked for in a picker is one step, another length is not.
        let meets = |gray: u8| MoveTemplate { meets_ghost: Some(MeetingTemplate::new([gray; 3])), ..to(0.3) };
        for gray in [1, 2, 3] {
            document.apply(set(Some(meets(gray)), "")).unwrap();
        }
        document.apply(set(Some(MoveTemplate { scale: 2.0, ..meets(3) }), "")).unwrap();
        let labels: Vec<&str> = document.labels().skip(1).collect();
        assert_eq!(labels, ["Move liver 24.0 mm", "Move liver", "Move liver"]);
        // Nothing is said of what moves nothing.
        document.apply(set(Some(MoveTemplate::default()), "Put liver back")).unwrap();
        assert!(document.figure().objects[0].regions[0].moved.is_none());
        for _ in 0..4 {
            document.undo();
        }
        assert_eq!(document.figure().to_json().unwrap(), before);
        let said = document.apply(set(Some(MoveTemplate { scale: 0.0, ..to(0.1) }), "")).unwrap_err().to_string();
        assert_eq!(said, "the region \"liver\" is scaled by 0; give a factor from 0.01 to 100");
        assert_eq!(document.figure().to_json().unwrap(), before);
    }

    #[test]
    fn the_oldest_steps_go_when_the_budget_is_full() {
        let mut document = Document::new(figure());
        document.budget = 10 * size(document.figure(), document.figure());
        for i in 0..50 {
            document.apply(Command::SetName { object: 0, name: i.to_string() }).unwrap();
        }
        assert_eq!(document.labels().count(), 10);
        while document.undo() {}
        assert_eq!(document.figure().objects[0].name, "39");
    }

    fn empty() -> Selection {
        let grid = Grid::new([40, 40, 40], DAffine3::IDENTITY).unwrap();
        Selection::empty(grid, &Arc::new(BrickPool::default()))
    }

    #[test]
    fn two_hundred_strokes_stay_within_the_budget_and_go_back_to_the_first_byte() {
        let first = figure().to_json().unwrap();
        let mut document = Document::new(figure());
        let grid = Grid::new([512; 3], DAffine3::from_scale(glam::DVec3::splat(0.5))).unwrap();
        let mut selection = Selection::empty(grid, &Arc::new(BrickPool::default()));
        let mut all = 0;
        for i in 0..200 {
            let brush = Brush { radius_mm: 6.0, profile: Profile::Soft, strength: 1.0, mode: BrushMode::Paint };
            document.begin();
            if i == 0 {
                let volume = document.figure().volumes[0].name.clone();
                let slot = SelectionSlot::painted("s", &volume, SelectionVoxels::new(selection.clone()));
                let region = RegionTemplate::of("s", Some("s".to_owned()));
                document.apply(Command::AddSelections { object: 0, slot, region }).unwrap();
            }
            let mut stroke = Stroke::new(&selection, brush, Limits::default()).unwrap();
            for j in 0..20 {
                let [x, y, z] = [20 + i * 37 % 200, 20 + j * 4, 20 + i * 53 % 200].map(|n| n as f64);
                stroke.dab_to(glam::DVec3::new(x, y, z));
                let (slot, label) = ("s".to_owned(), format!("Paint s, {i}"));
                let voxels = SelectionVoxels::new(stroke.selection().clone());
                document.apply(Command::SetVoxels { slot, voxels, label }).unwrap();
            }
            document.commit();
            selection = stroke.selection().clone();
            all += selection.num_bytes();
        }
        let last = document.figure().to_json().unwrap();
        let bytes = document.undo_bytes();
        println!("200 strokes: {:.1} MB of undo, {:.1} MB in whole copies", bytes as f64 / 1e6, all as f64 / 1e6);
        assert!(document.labels().count() == 200 && bytes < BUDGET && bytes < all / 10, "{bytes} of {all}");
        assert!(bytes > 200 * 10_000, "voxels count: {bytes}");
        while document.undo() {}
        assert_eq!(document.figure().to_json().unwrap(), first);
        while document.redo() {}
        assert_eq!(document.figure().to_json().unwrap(), last);
        assert!(document.undo_bytes().abs_diff(bytes) < bytes / 100);
    }

    #[test]
    fn importance_is_of_regions_and_of_structures_in_them() {
        let mut document = Document::new(figure());
        let volume = figure().volumes[0].name.clone();
        let slot = SelectionSlot::new("organs", &volume, "labels.nii.gz".to_owned());
        document.apply(Command::AddSelections { object: 0, slot, region: RegionTemplate::of("organs", None) }).unwrap();
        let before = document.figure().to_json().unwrap();
        let set = |structures: &[&str], importance| Command::SetImportance {
            object: 0,
            region: 0,
            structures: structures.iter().map(|s| (*s).to_owned()).collect(),
            importance,
        };
        document.apply(set(&["liver", "spleen"], Some(2.5))).unwrap();
        document.apply(set(&[], Some(0.5))).unwrap();
        let labels: Vec<&str> = document.labels().skip(1).collect();
        assert_eq!(labels, ["Set importance of 2 structures to 2.5", "Set importance of region to 0.5"]);
        let of = |document: &Document, name| document.figure().objects[0].regions[0].importance_of(name);
        assert_eq!(
            [Some("liver"), Some("spleen"), Some("aorta"), None].map(|s| of(&document, s)),
            [2.5, 2.5, 0.5, 0.5]
        );
        // It stays with the names, whatever the data are.
        let next = VolumeSlot::new(&volume, "next.nii".to_owned());
        document.apply(Command::SetVolume { slot: 0, volume: next }).unwrap();
        let again = Template::parse(&document.figure().to_json().unwrap()).unwrap();
        assert_eq!(again.objects[0].regions[0].importance_of(Some("liver")), 2.5);
        assert!(document.undo());
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            let said = document.apply(set(&["liver"], Some(bad))).unwrap_err().to_string();
            assert!(said.contains("the structure \"liver\"") && said.contains("0 or more"), "{said}");
        }
        document.apply(set(&["liver", "spleen"], None)).unwrap();
        document.apply(set(&[], None)).unwrap();
        assert_eq!(document.figure().to_json().unwrap(), before, "what says nothing is not written");
        while document.undo() {}
        assert_eq!(document.figure().to_json().unwrap(), figure().to_json().unwrap());
    }

    #[test]
    fn a_copy_takes_the_place_of_a_structure_until_it_is_removed() {
        let mut document = Document::new(figure());
        let volume = figure().volumes[0].name.clone();
        let slot = SelectionSlot::new("organs", &volume, "labels.nii.gz".to_owned());
        document.apply(Command::AddSelections { object: 0, slot, region: RegionTemplate::of("organs", None) }).unwrap();
        let before = document.figure().to_json().unwrap();
        let copy = |region, structure: Option<&str>, name: &str| Command::CopyStructure {
            object: 0,
            region,
            structure: structure.map(str::to_owned),
            slot: SelectionSlot::painted(name, &volume, SelectionVoxels::new(empty())),
            copy: RegionTemplate::of(name, Some(name.to_owned())),
        };
        document.apply(copy(0, Some("liver"), "liver")).unwrap();
        let regions = |document: &Document| {
            let regions = &document.figure().objects[0].regions;
            regions.iter().map(|r| r.selection.clone()).collect::<Vec<_>>()
        };
        assert_eq!(regions(&document), ["organs", "liver"]);
        assert_eq!(document.figure().objects[0].regions[0].structures[0].replaced_by.as_deref(), Some("liver"));
        // Without its copy, what is in the file is drawn again.
        document.apply(Command::RemoveRegion { object: 0, region: 1 }).unwrap();
        assert_eq!(document.figure().to_json().unwrap(), before);
        // A region with one structure is replaced, and its file with it, if it has no other use.
        let slot = SelectionSlot::new("tumor", &volume, "tumor.seg.nrrd".to_owned());
        let region = RegionTemplate::of("tumor", Some("tumor".to_owned()));
        document.apply(Command::AddSelections { object: 0, slot, region }).unwrap();
        document.apply(copy(1, None, "tumor 2")).unwrap();
        assert_eq!(regions(&document), ["organs", "tumor 2"]);
        assert_eq!(document.figure().selections.iter().map(|s| &s.name).collect::<Vec<_>>(), ["organs", "tumor 2"]);
        // A template that names what is not there is refused.
        let text = document.figure().to_json().unwrap();
        let text = text.replacen(
            "\"regions\": [\n        {",
            "\"regions\": [\n        {\n          \"structures\": \
            [{ \"structure\": \"liver\", \"replaced_by\": \"nothing\" }],",
            1,
        );
        let said = Template::parse(&text).unwrap_err().to_string();
        assert!(said.contains("\"liver\" is replaced by the selections \"nothing\""), "{said}");
        while document.undo() {}
        assert_eq!(document.figure().to_json().unwrap(), figure().to_json().unwrap());
    }

    /// A linear congruential generator: the same walk on every machine.
    struct Dice(u64);

    impl Dice {
        fn below(&mut self, n: usize) -> usize {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 33) as usize) % n
        }

        fn number(&mut self) -> f64 {
            // Now and then one that makes no sense.
            match self.below(60) {
                0 => f64::NAN,
                1 => f64::INFINITY,
                2 => -1e300,
                _ => 1000.0 * (self.below(10_000) as f64 / 5000.0 - 1.0),
            }
        }

        fn look(&mut self) -> LookTemplate {
            LookTemplate {
                visible: [None, Some(false)][self.below(2)],
                opacity: [None, Some(self.below(12) as f64 / 10.0)][self.below(2)],
                tint: [None, Some(Tint::Own), Some(Tint::Color([self.below(256) as u8; 3]))][self.below(3)],
                shading: if self.below(3) == 0 { self.shading() } else { ShadingTemplate::default() },
                ..LookTemplate::default()
            }
        }

        fn shading(&mut self) -> ShadingTemplate {
            let color = (self.below(2) == 0).then(|| Rgb([self.below(256) as u8; 3]));
            let width_pt = self.number().abs() / 20.0;
            ShadingTemplate {
                contours: (self.below(2) == 0).then(|| ContoursTemplate { color, ..ContoursTemplate::new(width_pt) }),
                transparency: [None, Some(Transparency::Illustrative)][self.below(2)],
                ..ShadingTemplate::default()
            }
        }

        fn lighting(&mut self) -> LightingTemplate {
            let model = [LightingModel::BlinnPhong, LightingModel::Metal][self.below(2)];
            let light = LightTemplate::from([self.number(), self.number(), 1.0]);
            LightingTemplate { lights: vec![light; self.below(6)], ..LightingTemplate::new(model) }
        }

        fn movement(&mut self) -> MoveTemplate {
            let mut meeting = || {
                let cells = vec![self.below(256) as u8; STRENGTH_SIZE * STRENGTH_SIZE];
                let strength = Strength::new(cells).map(|strength| MeetingStrength(Arc::new(strength)));
                let strength = strength.filter(|_| self.below(2) == 0);
                (self.below(2) == 0)
                    .then(|| MeetingTemplate { strength, ..MeetingTemplate::new([self.below(256) as u8; 3]) })
            };
            let (meets_ghost, meets_background) = (meeting(), meeting());
            MoveTemplate {
                offset: [self.number() / 1000.0, 0.0, 0.25],
                turn: [0.0, self.number(), 0.0],
                scale: [1.0, 0.0, 0.5, f64::NAN, 2.0][self.below(5)],
                ghost: self.look(),
                meets_ghost,
                meets_background,
                ..MoveTemplate::default()
            }
        }

        fn command(&mut self, document: &Document) -> Command {
            let node = self.below(9);
            let object = usize::from(self.below(20) == 0);
            let structure = [None, Some("liver".to_owned())][self.below(2)].clone();
            let part = (self.below(2) == 0).then(|| Chosen { region: self.below(2), structure });
            let of = FunctionOf { object, part, row: self.below(2) };
            match self.below(31) {
                0 => Command::SetTitle(format!("Figure {}", self.below(5))),
                1 => camera(document, self.number().abs()),
                2 => Command::SetProjection([ProjectionName::Perspective, ProjectionName::Orthographic][self.below(2)]),
                3 => Command::SetQuality([QualityName::Draft, QualityName::Final][self.below(2)]),
                4 => Command::InsertNode {
                    of,
                    node: NodeTemplate {
                        at: self.number(),
                        style: "wax".to_owned(),
                        opacity: self.below(12) as f64 / 10.0,
                        extra: Default::default(),
                    },
                },
                5 => Command::RemoveNode { of, node },
                6 => Command::SetStyle { of, nodes: node..node + self.below(3), style: "clay".to_owned() },
                7 => Command::SetGradientScale { object, scale_mm: Some(self.number()) },
                8 => Command::SetPage(crate::figure::template::Page {
                    width_mm: self.number(),
                    ..document.figure().figure.clone()
                }),
                9 => Command::SetReferenceLength { of, length_mm: Some(self.number()) },
                10 => Command::SetName { object, name: ["", "Skull"][self.below(2)].to_owned() },
                11 => Command::SetVisible { object, visible: self.below(2) == 0 },
                12 => {
                    let other = Background::Color([self.below(256) as u8; 3]);
                    Command::SetBackground([Background::Transparent, other][self.below(2)])
                }
                13 => {
                    let shipped = Template::parse(include_str!("../../../templates/head_xray.json")).unwrap();
                    Command::SetTransferFunction { of, function: shipped.objects[0].transfer_function.clone() }
                }
                14 => {
                    let volume =
                        VolumeSlot { file: format!("{}.nii", self.below(9)), ..document.figure().volumes[0].clone() };
                    Command::SetVolume { slot: self.below(2), volume }
                }
                15 => {
                    let name = ["organs", "bones"][self.below(2)];
                    let structure = [None, Some("liver".to_owned())][self.below(2)].clone();
                    let volume = document.figure().volumes[0].name.clone();
                    let slot = SelectionSlot::new(name, &volume, "labels.nii.gz".to_owned());
                    Command::AddSelections { object, slot, region: RegionTemplate::of(name, structure) }
                }
                16 => Command::RemoveRegion { object, region: self.below(2) },
                17 => {
                    let structure = [None, Some("liver".to_owned())][self.below(2)].clone();
                    Command::SetLook { object, region: self.below(2), structure, look: self.look() }
                }
                18 => {
                    let looks = vec![("liver".to_owned(), self.look()), ("spleen".to_owned(), self.look())];
                    Command::SetLooks { object, region: self.below(2), looks }
                }
                20 => {
                    let slot = ["organs", "bones"][self.below(2)].to_owned();
                    let painted = document.figure().selections.iter().find_map(|s| s.voxels.clone());
                    let mut selection = painted.map_or_else(empty, |voxels| voxels.selection().clone());
                    let at = self.below(30);
                    selection.change([[at, at + 9], [3, 9 + at], [0, 20]], |_, f| f.max(at as u8 * 8));
                    Command::SetVoxels { slot, voxels: SelectionVoxels::new(selection), label: "Paint".to_owned() }
                }
                21 => {
                    let moved = (self.below(4) > 0).then(|| self.movement());
                    let label = ["", "Turn Liver 3.0°"][self.below(2)].to_owned();
                    let structure = [None, Some("liver".to_owned())][self.below(2)].clone();
                    Command::SetMove { object, region: self.below(2), moves: vec![(structure, moved)], label }
                }
                23 => {
                    let structures = [vec![], vec!["liver".to_owned()], vec!["liver".to_owned(), "spleen".to_owned()]];
                    let importance = [None, Some(self.number()), Some(3.0)][self.below(3)];
                    let structures = structures[self.below(3)].clone();
                    Command::SetImportance { object, region: self.below(2), structures, importance }
                }
                24 => {
                    let structure = [None, Some("liver".to_owned())][self.below(2)].clone();
                    let (name, volume) = (["copy", "other"][self.below(2)], &document.figure().volumes[0].name);
                    let slot = SelectionSlot::painted(name, volume, SelectionVoxels::new(empty()));
                    let copy = RegionTemplate::of(name, Some(name.to_owned()));
                    Command::CopyStructure { object, region: self.below(2), structure, slot, copy }
                }
                25 => {
                    let volume = document.figure().volumes[0].name.clone();
                    let file = format!("{}.nii.gz", self.below(9));
                    Command::SetSelections { slot: self.below(2), selections: SelectionSlot::new("any", &volume, file) }
                }
                19 => {
                    let rest = RestTemplate { visible: self.below(2) == 0, ..RestTemplate::default() };
                    Command::SetRest { object, rest }
                }
                26 => Command::SetShading { object, shading: self.shading() },
                27 => Command::SetLighting { object, lighting: (self.below(3) > 0).then(|| self.lighting()) },
                28 => Command::SetTheme([None, Some("xray"), Some("unknown")][self.below(3)].map(str::to_owned)),
                29 => {
                    let value = [None, Some(2.5), Some(f64::NAN)][self.below(3)];
                    Command::SetSlider { style: "hatched".to_owned(), slider: "Spacing".to_owned(), value }
                }
                30 => {
                    let function = function_at(document.figure(), &of)
                        .unwrap_or_else(|| document.figure().objects[0].transfer_function.clone());
                    let function = match (&function.across, self.below(4)) {
                        (None, _) => TransferFunctionTemplate {
                            across: Some(AcrossTemplate {
                                by: AxisName::ALL[self.below(3)],
                                from: Some("liver".to_owned()),
                                at: self.number(),
                                rows: vec![RowTemplate {
                                    at: 2000.0,
                                    nodes: function.nodes.clone(),
                                    extra: Default::default(),
                                }],
                                extra: Default::default(),
                            }),
                            ..function
                        },
                        (_, 0) => function.without_row(self.below(3)),
                        (_, 1) => function.with_row_at(self.below(3), self.number()),
                        _ => function.with_row(self.number()).0,
                    };
                    Command::SetRows { of, function, label: "Change rows".to_owned() }
                }
                _ => Command::MoveNode { of, node, at: self.number(), opacity: self.number() },
            }
        }
    }

    /// What kind of command it is. A new one has to be thought of here, and in the dice.
    fn kind(command: &Command) -> usize {
        match command {
            Command::SetTitle(_) => 0,
            Command::SetCamera(_) => 1,
            Command::SetProjection(_) => 2,
            Command::SetBackground(_) => 3,
            Command::SetPage(_) => 4,
            Command::SetQuality(_) => 5,
            Command::SetTransferFunction { .. } => 6,
            Command::InsertNode { .. } => 7,
            Command::MoveNode { .. } => 8,
            Command::SetStyle { .. } => 9,
            Command::RemoveNode { .. } => 10,
            Command::SetGradientScale { .. } => 11,
            Command::SetReferenceLength { .. } => 12,
            Command::SetName { .. } => 13,
            Command::SetVisible { .. } => 14,
            Command::SetVolume { .. } => 15,
            Command::AddSelections { .. } => 16,
            Command::RemoveRegion { .. } => 17,
            Command::SetLook { .. } => 18,
            Command::SetLooks { .. } => 19,
            Command::SetRest { .. } => 20,
            Command::SetVoxels { .. } => 21,
            Command::SetMove { .. } => 22,
            Command::SetImportance { .. } => 23,
            Command::CopyStructure { .. } => 24,
            Command::SetSelections { .. } => 25,
            Command::SetShading { .. } => 26,
            Command::SetLighting { .. } => 27,
            Command::SetTheme(_) => 28,
            Command::SetSlider { .. } => 29,
            Command::SetRows { .. } => 30,
        }
    }

    /// Whether it changes the function of a part: a structure in a group, or the region itself.
    fn part_kind(command: &Command) -> Option<usize> {
        let part = command.whose_function()?.part.as_ref()?;
        Some(2 * kind(command) + usize::from(part.structure.is_some()))
    }

    #[test]
    fn a_random_walk_keeps_the_figure_whole_and_can_be_undone_to_its_first_byte() {
        let first = figure().to_json().unwrap();
        let mut done = [0; 31];
        // Each kind that edits a function, on regions and on structures as well.
        let mut done_on_parts = [0; 62];
        for seed in 0..20 {
            let mut dice = Dice(seed);
            let mut document = Document::new(figure());
            let mut refused = 0;
            for _ in 0..300 {
                match dice.below(12) {
                    0 => drop(document.undo()),
                    1 => drop(document.redo()),
                    2 => document.begin(),
                    3 => document.commit(),
                    4 => document.abort(),
                    _ => {
                        let command = dice.command(&document);
                        let (kind, part_kind) = (kind(&command), part_kind(&command));
                        let outcome = document.apply(command);
                        refused += usize::from(outcome.is_err());
                        done[kind] += usize::from(outcome.is_ok());
                        if let (Some(kind), true) = (part_kind, outcome.is_ok()) {
                            done_on_parts[kind] += 1;
                        }
                    }
                }
                // What can be edited can be saved and read again, and says the same.
                let text = document.figure().to_json().unwrap();
                assert_eq!(Template::parse(&text).unwrap(), **document.figure(), "seed {seed}");
            }
            assert!((10..200).contains(&refused), "{refused}");
            document.commit();
            // The walk may have ended among undone steps.
            while document.redo() {}
            let last = document.figure().to_json().unwrap();
            let mut steps = 0;
            while document.undo() {
                steps += 1;
            }
            assert_eq!(document.figure().to_json().unwrap(), first, "seed {seed}");
            assert!(steps > 20, "{steps}");
            while document.redo() {}
            assert_eq!(document.figure().to_json().unwrap(), last, "seed {seed}");
        }
        assert!(done.iter().all(|n| *n > 0), "never done: {done:?}");
        for kind in [6, 7, 8, 9, 10, 12, 30] {
            assert!(done_on_parts[2 * kind] > 0 && done_on_parts[2 * kind + 1] > 0, "{kind}: {done_on_parts:?}");
        }
    }
}
