//! What is chosen and can be moved: a region, a group, or structures of it, which stay together.

use glam::{DMat3, DQuat, DVec3};

use super::open_figure::OpenFigure;
use crate::figure::Command;
use crate::figure::bridge::drawn;
use crate::figure::command::{Chosen, PartMove};
use crate::figure::template::{MoveTemplate, RegionTemplate, SCALES};

/// What is moved, as it is.
#[derive(Clone)]
pub struct Movable {
    /// Of which object.
    pub object: usize,
    /// Which region.
    pub region: usize,
    /// What it is called.
    pub title: String,
    /// The structures of a group, or the region itself with those in it that are moved by themselves; at least one.
    pub parts: Vec<Part>,
    /// What offsets are relative to, mm.
    pub radius_mm: f64,
    /// What it is turned about: where the middle of the region is now, or of all structures that are chosen; world, mm.
    pub pivot_mm: DVec3,
}

/// A part of what is moved.
#[derive(Clone)]
pub struct Part {
    /// Which structure of a group, as the template calls it; none: the region itself.
    pub structure: Option<String>,
    /// Where it is.
    pub moved: MoveTemplate,
    /// c, of the part at rest, mm.
    pub center_mm: DVec3,
}

/// What is done to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Moved, mm.
    By(DVec3),
    /// Turned about its pivot: a rotation vector along axes of the body, degrees.
    Turn(DVec3),
    /// Scaled from its pivot.
    Scale(f64),
    /// Put back to where it was found.
    Back,
}

impl Movable {
    /// What is chosen, if it can be moved.
    pub fn chosen(open: &OpenFigure) -> Option<Self> {
        let (object, chosen) = (open.object, open.chosen_region()?.clone());
        let figure = open.document.figure();
        // What is picked and moved is of the object that is drawn.
        if figure.objects.iter().position(|o| o.visible) != Some(object) {
            return None;
        }
        let radius_mm = open.radius_mm().filter(|radius| *radius > 0.0)?;
        let region = &figure.objects[object].regions[chosen.region];
        let names: Vec<String> = open.chosen_structures().cloned().collect();
        let title = match &names[..] {
            [] => region.title().to_owned(),
            [name] => name.clone(),
            several => format!("{} structures", several.len()),
        };
        let is_whole = names.is_empty();
        let with_own = region.structures.iter().filter(|s| is_whole && s.moved.is_some());
        let wanted = std::iter::once(None).filter(|_| is_whole).chain(names.into_iter().map(Some));
        let wanted = wanted.chain(with_own.map(|s| Some(s.structure.clone())));
        let part = |structure| Part::of(open, object, chosen.region, region, structure, radius_mm);
        let parts: Vec<Part> = wanted.filter_map(part).collect();
        let pivots = &parts[..if is_whole { parts.len().min(1) } else { parts.len() }];
        let pivot_mm = pivots.iter().map(|part| part.middle_mm(radius_mm)).sum::<DVec3>() / pivots.len() as f64;
        (!parts.is_empty()).then_some(Self { object, region: chosen.region, title, parts, radius_mm, pivot_mm })
    }

    /// The edges of the boxes around the parts, where they are: world, mm.
    pub fn edges_mm(&self, open: &OpenFigure) -> Vec<[DVec3; 2]> {
        let mut edges = Vec::new();
        for part in &self.parts {
            let chosen = Chosen { region: self.region, structure: part.structure.clone() };
            let Some(corners) = open.corners_mm(self.object, &chosen) else { continue };
            let pose = part.moved.pose(part.center_mm, self.radius_mm);
            let corners = corners.map(|corner| pose.transform_point3(corner));
            for (i, bit) in (0..8).flat_map(|i| [1, 2, 4].map(|bit| (i, bit))).filter(|(i, bit)| i & bit == 0) {
                edges.push([corners[i], corners[i | bit]]);
            }
        }
        edges
    }

    /// Where the first part is.
    pub fn moved(&self) -> &MoveTemplate {
        &self.parts[0].moved
    }

    /// Whether any of it is moved.
    pub fn is_moved(&self) -> bool {
        self.parts.iter().any(|part| part.moved.is_moved())
    }

    /// What the parts' moves become, and what the step is called.
    pub fn changed(&self, change: Change) -> (Vec<PartMove>, String) {
        let label = match change {
            Change::By(mm) => format!("Move {} {:.1} mm", self.title, mm.length()),
            Change::Turn(deg) => {
                // About an axis of the body, its sign says which way.
                let along = deg.abs().max_element();
                let angle = if (deg.length() - along).abs() < 1e-9 { deg.element_sum() } else { deg.length() };
                format!("Turn {} {angle:.1}°", self.title)
            }
            Change::Scale(factor) => format!("Scale {} × {factor:.2}", self.title),
            Change::Back => format!("Put {} back", self.title),
        };
        let moves = self.parts.iter().map(|part| (part.structure.clone(), Some(self.part_changed(part, change))));
        (moves.collect(), label)
    }

    fn part_changed(&self, part: &Part, change: Change) -> MoveTemplate {
        let moved = &part.moved;
        let offset = DVec3::from_array(moved.offset);
        // Where its middle is from what all are turned about.
        let arm_mm = part.middle_mm(self.radius_mm) - self.pivot_mm;
        let with_arm = |now_mm: DVec3| match arm_mm.length() > 1e-6 {
            true => (offset + (now_mm - arm_mm) / self.radius_mm).to_array(),
            false => moved.offset,
        };
        match change {
            Change::By(mm) => MoveTemplate { offset: (offset + mm / self.radius_mm).to_array(), ..moved.clone() },
            Change::Turn(deg) => {
                let by = rotation(deg);
                let turn = DQuat::from_mat3(&(by * moved.rotation())).to_scaled_axis();
                let turn = turn.to_array().map(f64::to_degrees);
                MoveTemplate { turn, offset: with_arm(by * arm_mm), ..moved.clone() }
            }
            Change::Scale(factor) => {
                let scale = (moved.scale * factor).clamp(SCALES.0, SCALES.1);
                MoveTemplate { scale, offset: with_arm(factor * arm_mm), ..moved.clone() }
            }
            Change::Back => MoveTemplate { offset: [0.0; 3], turn: [0.0; 3], scale: 1.0, ..moved.clone() },
        }
    }

    /// The edit.
    pub fn command(&self, change: Change) -> Command {
        let (moves, label) = self.changed(change);
        Command::SetMove { object: self.object, region: self.region, moves, label }
    }

    /// The edit, called by where it ends: one that is made bit by bit.
    pub fn command_to(&self, change: Change, verb: &str, to: &str) -> Command {
        let (moves, _) = self.changed(change);
        let label = format!("{verb} {} to {to}", self.title);
        Command::SetMove { object: self.object, region: self.region, moves, label }
    }

    /// Makes the edit: a step of its own, or a part of the gesture under way.
    pub fn apply(&self, open: &mut OpenFigure, change: Change) {
        open.edit(self.command(change));
    }

    /// The edit of what else is said of all parts' moves.
    pub fn with(&self, label: &str, change: &dyn Fn(MoveTemplate) -> MoveTemplate) -> Command {
        let moves = self.parts.iter().map(|part| (part.structure.clone(), Some(change(part.moved.clone()))));
        let label = format!("{label} of {}", self.title);
        Command::SetMove { object: self.object, region: self.region, moves: moves.collect(), label }
    }
}

/// Of a rotation vector, degrees.
pub fn rotation(deg: DVec3) -> DMat3 {
    MoveTemplate { turn: deg.to_array(), ..MoveTemplate::default() }.rotation()
}

impl Part {
    fn of(
        open: &OpenFigure,
        object: usize,
        number: usize,
        region: &RegionTemplate,
        structure: Option<String>,
        radius_mm: f64,
    ) -> Option<Self> {
        let center_of = |structure: Option<String>| open.center_mm(object, &Chosen { region: number, structure });
        let is_it = |s: &&fabrica_engine::selection::Structure| {
            structure.as_ref().is_none_or(|name| region.called(&s.label) == *name)
        };
        let structures = &open.structures_of(region)?.structures;
        // What has no voxels is nowhere.
        drawn(region, structures).filter(is_it).find(|s| !s.selection.is_empty())?;
        let center_mm = center_of(structure.clone())?;
        let own = region.own_move(structure.as_deref()).cloned();
        let moved = own.or_else(|| {
            // Where its group is, as a move of its own.
            let moved = region.moved.as_ref().filter(|moved| moved.is_moved())?;
            Some(moved.with_center(center_of(None)?, center_mm, radius_mm))
        });
        Some(Self { structure, moved: moved.unwrap_or_default(), center_mm })
    }

    /// Where its middle is now, mm.
    fn middle_mm(&self, radius_mm: f64) -> DVec3 {
        self.center_mm + radius_mm * DVec3::from_array(self.moved.offset)
    }
}
