//! What an edit of a figure is: a value that says everything about it. A document is changed by commands only, so that every
//! change has a name, can be undone, and is the same whether it comes from a panel, a key or a test.

use std::ops::Range;

use anyhow::{Result, bail};

use super::style_settings;
use super::template::{
    Background, CameraTemplate, LightingTemplate, LookTemplate, MoveTemplate, NodeTemplate, Page, ProjectionName,
    QualityName, RegionTemplate, RestTemplate, Rgb, SelectionSlot, SelectionVoxels, ShadingTemplate, StructureTemplate,
    Template, TransferFunctionTemplate, VolumeSlot,
};
use super::theme::Themes;

/// What has a look of its own in an object: a region, or a structure in a group.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Chosen {
    /// Which region.
    pub region: usize,
    /// Which structure of a group, as the template calls it; none: the region itself.
    pub structure: Option<String>,
}

/// Whose transfer function is meant: an object's, or that of a part of it. A part that has none of its own gets a copy of what it
/// looks like at its first edit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FunctionOf {
    /// Which object.
    pub object: usize,
    /// Which part of it; none: the object itself.
    pub part: Option<Chosen>,
    /// Of whose rows which is meant; 0, where it has but one.
    pub row: usize,
}

impl FunctionOf {
    /// The object's own.
    pub fn object(object: usize) -> Self {
        Self { object, part: None, row: 0 }
    }
}

/// A structure of a group, by name, or a region itself; and where it is to be.
pub type PartMove = (Option<String>, Option<MoveTemplate>);

/// One edit. Objects, nodes and volume slots are named by their position.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// The figure's title.
    SetTitle(String),
    /// The view.
    SetCamera(CameraTemplate),
    /// Central or parallel projection.
    SetProjection(ProjectionName),
    /// What lies behind.
    SetBackground(Background),
    /// Other styles for all of the figure, by a theme's name; none: its own.
    SetTheme(Option<String>),
    /// A slider of a style, wherever the figure is drawn with that.
    SetSlider {
        /// The style's name.
        style: String,
        /// The slider's.
        slider: String,
        /// None: the style's own value.
        value: Option<f64>,
    },
    /// Size and resolution on the page.
    SetPage(Page),
    /// Accuracy of the export.
    SetQuality(QualityName),
    /// The whole transfer function of an object: an automatic look, a preset.
    SetTransferFunction {
        /// Whose.
        of: FunctionOf,
        /// The new one.
        function: TransferFunctionTemplate,
    },
    /// The rows of a transfer function: one more, one less, one elsewhere, another second coordinate or none.
    SetRows {
        /// Whose.
        of: FunctionOf,
        /// The function as it is then.
        function: TransferFunctionTemplate,
        /// What the edit is called.
        label: String,
    },
    /// A new node, put where its position belongs; beside others at the same position after them.
    InsertNode {
        /// Whose.
        of: FunctionOf,
        /// The new one.
        node: NodeTemplate,
    },
    /// Position and opacity of a node. It stays between its neighbors: a position beyond them is moved to theirs.
    MoveNode {
        /// Whose.
        of: FunctionOf,
        /// Which node.
        node: usize,
        /// Data value or percentile.
        at: f64,
        /// 0 to 1; beyond that it is moved to the nearer of the two.
        opacity: f64,
    },
    /// The style of successive nodes.
    SetStyle {
        /// Whose.
        of: FunctionOf,
        /// Which nodes.
        nodes: Range<usize>,
        /// The style's name.
        style: String,
    },
    /// Takes a node away; the last one stays.
    RemoveNode {
        /// Whose.
        of: FunctionOf,
        /// Which node.
        node: usize,
    },
    /// σ of the gradients' smoothing; `None`: one voxel.
    SetGradientScale {
        /// Of which object.
        object: usize,
        /// In mm.
        scale_mm: Option<f64>,
    },
    /// d₀: the length that the opacities are stated for; `None`: the volume's smallest spacing.
    SetReferenceLength {
        /// Whose.
        of: FunctionOf,
        /// In mm.
        length_mm: Option<f64>,
    },
    /// How an object's surfaces are drawn, besides their styles.
    SetShading {
        /// Of which object.
        object: usize,
        /// How.
        shading: ShadingTemplate,
    },
    /// How an object is lit; none: styles are their own light.
    SetLighting {
        /// Which object.
        object: usize,
        /// How.
        lighting: Option<LightingTemplate>,
    },
    /// What an object is called.
    SetName {
        /// Which object.
        object: usize,
        /// Empty: as its volume.
        name: String,
    },
    /// Whether an object is drawn.
    SetVisible {
        /// Which object.
        object: usize,
        /// Drawn or not.
        visible: bool,
    },
    /// Selections with a look: a slot, and a region of an object that draws what is in it.
    AddSelections {
        /// To which object.
        object: usize,
        /// Where they come from.
        slot: SelectionSlot,
        /// How they look.
        region: RegionTemplate,
    },
    /// Takes a region away, and its slot with it if no other uses it.
    RemoveRegion {
        /// Of which object.
        object: usize,
        /// Which region.
        region: usize,
    },
    /// How what is in no region is drawn.
    SetRest {
        /// Of which object.
        object: usize,
        /// How.
        rest: RestTemplate,
    },
    /// How a region looks, or a structure in a group.
    SetLook {
        /// Of which object.
        object: usize,
        /// Which region.
        region: usize,
        /// Which structure, by name, of a group; none: the region itself.
        structure: Option<String>,
        /// What differs from what surrounds it.
        look: LookTemplate,
    },
    /// How several structures of a group look.
    SetLooks {
        /// Of which object.
        object: usize,
        /// Which region.
        region: usize,
        /// Names, and what differs from the group's look.
        looks: Vec<(String, LookTemplate)>,
    },
    /// Where a region was moved to, or structures in it, and what that leaves behind.
    SetMove {
        /// Of which object.
        object: usize,
        /// Which region.
        region: usize,
        /// Which structures of a group, by name, or the region itself; and where to. None: of the region, where it was found, and of
        /// a structure, where its group is.
        moves: Vec<PartMove>,
        /// What the edit is called; empty: by the region's name.
        label: String,
    },
    /// How much a region matters, or structures in it: all the same.
    SetImportance {
        /// Of which object.
        object: usize,
        /// Which region.
        region: usize,
        /// Which structures of a group, by name; none: the region itself.
        structures: Vec<String>,
        /// From 0; none: as the group, of a region as usual.
        importance: Option<f64>,
    },
    /// A copy that can be painted on takes the place of a region with one structure, or of a structure of a group.
    CopyStructure {
        /// Of which object.
        object: usize,
        /// Which region.
        region: usize,
        /// Which structure of a group, by name; none: the region itself.
        structure: Option<String>,
        /// The voxels.
        slot: SelectionSlot,
        /// How they are drawn: after the group, or in the region's place.
        copy: RegionTemplate,
    },
    /// Another file in a slot of selections.
    SetSelections {
        /// Which slot.
        slot: usize,
        /// What is in it now; its name stays.
        selections: SelectionSlot,
    },
    /// What is painted in a slot of selections, in place of what was in it.
    SetVoxels {
        /// The slot's name.
        slot: String,
        /// What it is now.
        voxels: SelectionVoxels,
        /// What the edit is called.
        label: String,
    },
    /// Another file in a slot.
    SetVolume {
        /// Which slot.
        slot: usize,
        /// What is in it now.
        volume: VolumeSlot,
    },
}

impl Command {
    /// What the edit of `figure` is called in the list of undo steps: verb, object, amount.
    pub fn label(&self, figure: &Template) -> String {
        let verb = self.verb(figure);
        match self.whose_function().and_then(|of| part_name(figure, of)) {
            Some(part) => format!("{verb} ({part})"),
            None => verb,
        }
    }

    /// Whose transfer function it changes, if it changes one.
    pub fn whose_function(&self) -> Option<&FunctionOf> {
        match self {
            Self::SetTransferFunction { of, .. }
            | Self::SetRows { of, .. }
            | Self::InsertNode { of, .. }
            | Self::MoveNode { of, .. }
            | Self::SetStyle { of, .. }
            | Self::RemoveNode { of, .. }
            | Self::SetReferenceLength { of, .. } => Some(of),
            _ => None,
        }
    }

    fn verb(&self, figure: &Template) -> String {
        match self {
            Self::SetTitle(_) => "Change title".to_owned(),
            Self::SetCamera(_) => "Move view".to_owned(),
            Self::SetProjection(ProjectionName::Perspective) => "Use perspective".to_owned(),
            Self::SetProjection(ProjectionName::Orthographic) => "Use parallel projection".to_owned(),
            Self::SetBackground(_) => "Change background".to_owned(),
            Self::SetTheme(None) => "Take theme away".to_owned(),
            Self::SetTheme(Some(name)) => match Themes::built_in().named(name) {
                Ok(theme) => format!("Use theme {}", theme.title),
                Err(_) => format!("Use theme {name}"),
            },
            Self::SetSlider { style, slider, .. } => format!("Change {slider} of the style {style}"),
            Self::SetPage(page) => format!("Change page to {} x {} mm", short(page.width_mm), short(page.height_mm)),
            Self::SetQuality(_) => "Change quality".to_owned(),
            Self::SetTransferFunction { .. } => "Replace transfer function".to_owned(),
            Self::SetRows { label, .. } => label.clone(),
            Self::InsertNode { node, .. } => format!("Insert node at {}", short(node.at)),
            Self::MoveNode { at, .. } => format!("Move node to {}", short(*at)),
            Self::SetStyle { style, .. } => format!("Dress in {style}"),
            Self::RemoveNode { .. } => "Remove node".to_owned(),
            Self::SetGradientScale { .. } => "Change gradient smoothing".to_owned(),
            Self::SetReferenceLength { .. } => "Change reference length of opacity".to_owned(),
            Self::SetShading { shading, .. } => match &shading.contours {
                Some(contours) if contours.width_pt > 0.0 => {
                    format!("Draw contours of {} pt", short(contours.width_pt))
                }
                _ => "Change shading".to_owned(),
            },
            Self::SetLighting { lighting: None, .. } => "Use the styles' own light".to_owned(),
            Self::SetLighting { .. } => "Change light".to_owned(),
            Self::SetName { name, .. } => format!("Rename to {name}"),
            Self::SetVisible { visible: true, .. } => "Show object".to_owned(),
            Self::SetVisible { visible: false, .. } => "Hide object".to_owned(),
            Self::AddSelections { region, .. } => format!("Add {}", region.title()),
            Self::RemoveRegion { .. } => "Remove region".to_owned(),
            Self::SetLook { structure: Some(structure), .. } => format!("Change look of {structure}"),
            Self::SetLook { structure: None, .. } => "Change look of region".to_owned(),
            Self::SetRest { rest, .. } if rest.visible => "Show the rest".to_owned(),
            Self::SetRest { .. } => "Hide the rest".to_owned(),
            Self::SetLooks { looks, .. } if looks.len() == 1 => format!("Change look of {}", looks[0].0),
            Self::SetLooks { looks, .. } => format!("Change look of {} structures", looks.len()),
            Self::SetMove { label, .. } if !label.is_empty() => label.clone(),
            Self::SetMove { object, region, moves, .. } => match &moves[..] {
                [(Some(structure), _)] => format!("Move {structure}"),
                [(None, _), ..] => {
                    let found = figure.objects.get(*object).and_then(|o| o.regions.get(*region));
                    format!("Move {}", found.map_or("region", RegionTemplate::title))
                }
                several => format!("Move {} structures", several.len()),
            },
            Self::SetImportance { structures, importance, .. } => {
                let what = match &structures[..] {
                    [] => "region".to_owned(),
                    [structure] => structure.clone(),
                    several => format!("{} structures", several.len()),
                };
                match importance {
                    Some(importance) => format!("Set importance of {what} to {}", short(*importance)),
                    None => format!("Reset importance of {what}"),
                }
            }
            Self::CopyStructure { copy, .. } => format!("Copy {}", copy.title()),
            Self::SetSelections { selections, .. } => {
                let file = selections.file.as_deref().unwrap_or(&selections.name);
                format!("Use {}", file.rsplit(['/', '\\']).find(|part| !part.is_empty()).unwrap_or(file))
            }
            Self::SetVoxels { label, .. } => label.clone(),
            Self::SetVolume { slot, volume } => reading(figure.volumes.get(*slot), volume),
        }
    }

    /// Whether two successive edits of this kind are one undo step: views are, so that undo never wades through them,
    /// and what is typed letter by letter or found by trying.
    pub fn merges_with(&self, later: &Self) -> bool {
        use Background::Color;
        matches!(
            (self, later),
            (Self::SetCamera(_), Self::SetCamera(_))
                | (Self::SetTitle(_), Self::SetTitle(_))
                | (Self::SetBackground(Color(_)), Self::SetBackground(Color(_)))
        ) || self.colors_same_light(later)
            || self.tints_what(later)
    }

    /// Whether both differ in the color of lights alone: one that is looked for in a picker.
    fn colors_same_light(&self, later: &Self) -> bool {
        let (Self::SetLighting { object, lighting: Some(a) }, Self::SetLighting { object: o, lighting: Some(b) }) =
            (self, later)
        else {
            return false;
        };
        let mut recolored = a.clone();
        recolored.lights.iter_mut().zip(&b.lights).for_each(|(light, other)| light.color = other.color);
        object == o && a != b && recolored == *b
    }

    /// Whether both give a color to the same structures: one that is looked for in a picker.
    fn tints_what(&self, later: &Self) -> bool {
        let other_tint = |a: &LookTemplate, b: &LookTemplate| {
            let untinted = |look: &LookTemplate| LookTemplate { tint: None, ..look.clone() };
            a.tint != b.tint && untinted(a) == untinted(b)
        };
        match (self, later) {
            (
                Self::SetLook { object, region, structure, look },
                Self::SetLook { object: o, region: r, structure: s, look: l },
            ) => (object, region, structure) == (o, r, s) && other_tint(look, l),
            (Self::SetMove { object, region, moves, .. }, Self::SetMove { object: o, region: r, moves: m, .. }) => {
                let same = |((s, a), (t, b)): (&PartMove, &PartMove)| {
                    s == t && a != b && a.as_ref().map(uncolored) == b.as_ref().map(uncolored)
                };
                (object, region, moves.len()) == (o, r, m.len()) && moves.iter().zip(m).all(same)
            }
            (Self::SetLooks { object, region, looks }, Self::SetLooks { object: o, region: r, looks: l }) => {
                let same =
                    |((s, a), (t, b)): (&(String, LookTemplate), &(String, LookTemplate))| s == t && other_tint(a, b);
                (object, region, looks.len()) == (o, r, l.len()) && looks.iter().zip(l).all(same)
            }
            _ => false,
        }
    }

    /// Makes the edit.
    ///
    /// # Errors
    /// One sentence where it has no meaning; the figure is then what it was.
    pub fn apply(self, figure: &mut Template) -> Result<()> {
        let before = figure.clone();
        let outcome = self.change(figure).and_then(|()| figure.check());
        if outcome.is_err() {
            *figure = before;
        }
        outcome
    }

    fn change(self, figure: &mut Template) -> Result<()> {
        match self {
            Self::SetTitle(title) => figure.title = title,
            Self::SetCamera(camera) => {
                let numbers = [camera.from, camera.up, camera.target].concat();
                if numbers.iter().chain([&camera.fov_deg, &camera.height]).any(|n| !n.is_finite()) {
                    bail!("the view has a number that is not finite; give another one");
                }
                figure.camera = camera;
            }
            Self::SetProjection(projection) => figure.camera.projection = projection,
            Self::SetBackground(background) => figure.background = background,
            Self::SetTheme(name) => figure.theme = name,
            Self::SetSlider { style, slider, value } => {
                if value.is_some_and(|value| !value.is_finite()) {
                    bail!("the slider \"{slider}\" has no finite value; give another one");
                }
                style_settings::set(&mut figure.style_settings, &style, &slider, value);
            }
            Self::SetPage(page) => figure.figure = page,
            Self::SetQuality(quality) => figure.quality = quality,
            Self::SetTransferFunction { of, function } | Self::SetRows { of, function, .. } => {
                *function_of(figure, &of)? = function;
            }
            Self::InsertNode { of, node } => {
                let nodes = function_of(figure, &of)?.nodes_of_mut(of.row);
                let place = nodes.partition_point(|n| n.at <= node.at);
                nodes.insert(place, node);
            }
            Self::MoveNode { of, node, at, opacity } => {
                if !(at.is_finite() && opacity.is_finite()) {
                    bail!("a node cannot be at {at} with opacity {opacity}; give finite numbers");
                }
                let nodes = function_of(figure, &of)?.nodes_of_mut(of.row);
                let low = node.checked_sub(1).and_then(|i| nodes.get(i)).map_or(f64::NEG_INFINITY, |n| n.at);
                let high = nodes.get(node + 1).map_or(f64::INFINITY, |n| n.at);
                let node = node_of(nodes, node)?;
                (node.at, node.opacity) = (at.clamp(low, high), opacity.clamp(0.0, 1.0));
            }
            Self::SetStyle { of, nodes, style } => {
                let all = function_of(figure, &of)?.nodes_of_mut(of.row);
                let num_nodes = all.len();
                let Some(chosen) = all.get_mut(nodes.clone()).filter(|c| !c.is_empty()) else {
                    bail!("the transfer function has {num_nodes} nodes, not {} to {}", nodes.start + 1, nodes.end);
                };
                for node in chosen {
                    node.style.clone_from(&style);
                }
            }
            Self::RemoveNode { of, node } => {
                let nodes = function_of(figure, &of)?.nodes_of_mut(of.row);
                node_of(nodes, node)?;
                if nodes.len() == 1 {
                    bail!("a transfer function needs one node at least; make its opacity 0 instead");
                }
                nodes.remove(node);
            }
            Self::SetGradientScale { object, scale_mm } => {
                if scale_mm.is_some_and(|s| !(s.is_finite() && s >= 0.0)) {
                    bail!("gradients cannot be smoothed by {} mm; give 0 or more", scale_mm.unwrap_or_default());
                }
                object_of(figure, object)?.gradient_scale_mm = scale_mm;
            }
            Self::SetReferenceLength { of, length_mm } => {
                if length_mm.is_some_and(|l| !(l.is_finite() && l > 0.0)) {
                    bail!("opacities cannot be those of {} mm; give a positive length", length_mm.unwrap_or_default());
                }
                function_of(figure, &of)?.reference_length_mm = length_mm;
            }
            Self::SetShading { object, shading } => object_of(figure, object)?.shading = shading,
            Self::SetLighting { object, lighting } => object_of(figure, object)?.lighting = lighting,
            Self::SetName { object, name } => object_of(figure, object)?.name = name,
            Self::SetVisible { object, visible } => object_of(figure, object)?.visible = visible,
            Self::AddSelections { object, slot, region } => {
                object_of(figure, object)?.regions.push(region);
                figure.selections.push(slot);
            }
            Self::RemoveRegion { object, region } => {
                let regions = &mut object_of(figure, object)?.regions;
                region_of(regions, region)?;
                let slot = regions.remove(region).selection;
                drop_slot(figure, &slot);
            }
            Self::SetLook { object, region, structure, look } => {
                let region = region_of(&mut object_of(figure, object)?.regions, region)?;
                match structure {
                    None => region.look = look,
                    Some(structure) => set_look(region, &structure, look),
                }
            }
            Self::SetRest { object, rest } => object_of(figure, object)?.rest = rest,
            Self::SetLooks { object, region, looks } => {
                let region = region_of(&mut object_of(figure, object)?.regions, region)?;
                looks.into_iter().for_each(|(structure, look)| set_look(region, &structure, look));
            }
            Self::SetMove { object, region, moves, .. } => {
                let region = region_of(&mut object_of(figure, object)?.regions, region)?;
                moves.into_iter().for_each(|(structure, moved)| set_move(region, structure.as_deref(), moved));
            }
            Self::SetImportance { object, region, structures, importance } => {
                let region = region_of(&mut object_of(figure, object)?.regions, region)?;
                match &structures[..] {
                    [] => region.importance = importance,
                    some => some.iter().for_each(|s| change_structure(region, s, |of| of.importance = importance)),
                }
            }
            Self::CopyStructure { object, region, structure, slot, copy } => {
                let regions = &mut object_of(figure, object)?.regions;
                let original = region_of(regions, region)?;
                match structure {
                    Some(structure) => {
                        change_structure(original, &structure, |of| of.replaced_by = Some(slot.name.clone()));
                        regions.insert(region + 1, copy);
                    }
                    None => {
                        let before = std::mem::replace(original, copy).selection;
                        drop_slot(figure, &before);
                    }
                }
                figure.selections.push(slot);
            }
            Self::SetSelections { slot, selections } => match figure.selections.get_mut(slot) {
                Some(place) => *place = SelectionSlot { name: place.name.clone(), ..selections },
                None => bail!("the figure has no selections number {}", slot + 1),
            },
            Self::SetVoxels { slot: name, voxels, .. } => {
                let Some(slot) = figure.selections.iter_mut().find(|s| s.name == name) else {
                    bail!("the figure has no selections \"{name}\"");
                };
                (slot.voxels, slot.file, slot.table) = (Some(voxels), None, None);
            }
            Self::SetVolume { slot, volume } => match figure.volumes.get_mut(slot) {
                Some(place) => *place = volume,
                None => bail!("the figure has no volume number {}", slot + 1),
            },
        }
        Ok(())
    }
}

/// A move without the colors in it.
fn uncolored(moved: &MoveTemplate) -> MoveTemplate {
    let mut moved = moved.clone();
    moved.ghost.tint = None;
    for meeting in [&mut moved.meets_ghost, &mut moved.meets_background].into_iter().flatten() {
        meeting.color = Rgb([0; 3]);
    }
    moved
}

/// What a slot's next volume is: another file, or the same with what is read otherwise.
fn reading(before: Option<&VolumeSlot>, now: &VolumeSlot) -> String {
    let name = now.file.rsplit(['/', '\\']).find(|part| !part.is_empty()).unwrap_or(&now.file);
    let Some(before) = before.filter(|before| before.file == now.file) else { return format!("Use {name}") };
    let mut parts = vec![format!("Read {name}")];
    if before.raw != now.raw {
        parts.extend(now.raw.as_ref().map(|layout| format!("as {layout}")));
    }
    if before.series != now.series {
        parts.push(now.series.as_ref().map_or_else(|| "any series".to_owned(), |series| format!("series {series}")));
    }
    if before.frame != now.frame {
        parts.push(format!("frame {}", now.frame + 1));
    }
    if before.labels != now.labels {
        parts.push(if now.labels { "as structures" } else { "as values of a scan" }.to_owned());
    }
    match (before.crop, now.crop) {
        (before, now) if before == now => {}
        (None, _) => parts.push("cropped".to_owned()),
        (Some(_), Some(_)) => parts.push("cropped otherwise".to_owned()),
        (Some(_), None) => parts.push("whole".to_owned()),
    }
    if before.filters != now.filters {
        parts.push(match &now.filters[..] {
            [] => "without a filter".to_owned(),
            [filter] => format!("through a {filter}"),
            several => format!("through {} filters", several.len()),
        });
    }
    let (old, new) = (before.reduce.unwrap_or([1; 3]), now.reduce.unwrap_or([1; 3]));
    if old != new {
        parts.push(match new {
            [1, 1, 1] => "at full resolution".to_owned(),
            [2, 2, 2] => "at half resolution".to_owned(),
            [x, y, z] if x == y && y == z => format!("at 1/{x} of the resolution"),
            [x, y, z] => format!("reduced {x} x {y} x {z}"),
        });
    }
    parts.join(", ")
}

/// What the part of an object is called whose function it is; none: the object itself.
fn part_name(figure: &Template, of: &FunctionOf) -> Option<String> {
    let part = of.part.as_ref()?;
    let region = figure.objects.get(of.object)?.regions.get(part.region)?;
    Some(part.structure.clone().unwrap_or_else(|| region.title().to_owned()))
}

/// At most two decimals, none that say nothing.
fn short(number: f64) -> f64 {
    (100.0 * number).round() / 100.0
}

fn object_of(figure: &mut Template, object: usize) -> Result<&mut super::template::ObjectTemplate> {
    match figure.objects.get_mut(object) {
        Some(found) => Ok(found),
        None => bail!("the figure has no object number {}", object + 1),
    }
}

fn region_of(regions: &mut [RegionTemplate], region: usize) -> Result<&mut RegionTemplate> {
    match regions.get_mut(region) {
        Some(found) => Ok(found),
        None => bail!("the object has no region number {}", region + 1),
    }
}

/// Takes a slot away that no region uses; what was painted in it leaves room for what it was a copy of.
fn drop_slot(figure: &mut Template, slot: &str) {
    if figure.objects.iter().any(|o| o.regions.iter().any(|r| r.selection == slot)) {
        return;
    }
    figure.selections.retain(|s| s.name != slot);
    for region in figure.objects.iter_mut().flat_map(|o| &mut o.regions) {
        for structure in &mut region.structures {
            structure.replaced_by.take_if(|by| by == slot);
        }
        region.structures.retain(|s| !s.is_default());
    }
}

/// What says nothing is not kept.
fn set_look(region: &mut RegionTemplate, structure: &str, look: LookTemplate) {
    change_structure(region, structure, |of| of.look = look);
}

/// What says nothing is not kept; that a structure is where it was found says something while its group is not.
fn set_move(region: &mut RegionTemplate, structure: Option<&str>, moved: Option<MoveTemplate>) {
    let is_group_moved = region.moved.as_ref().is_some_and(MoveTemplate::is_moved);
    match structure {
        None => {
            region.moved = moved.filter(|moved| !moved.is_default());
            if !region.moved.as_ref().is_some_and(MoveTemplate::is_moved) {
                let says_nothing = |moved: &MoveTemplate| moved.is_default();
                region.structures.iter_mut().for_each(|s| drop(s.moved.take_if(|moved| says_nothing(moved))));
                region.structures.retain(|s| !s.is_default());
            }
        }
        Some(name) => {
            let moved = moved.filter(|moved| !moved.is_default() || is_group_moved);
            change_structure(region, name, |of| of.moved = moved);
        }
    }
}

fn change_structure(region: &mut RegionTemplate, structure: &str, change: impl FnOnce(&mut StructureTemplate)) {
    let structures = &mut region.structures;
    let place = structures.iter().position(|s| s.structure == structure).unwrap_or_else(|| {
        structures.push(StructureTemplate::of(structure));
        structures.len() - 1
    });
    change(&mut structures[place]);
    if structures[place].is_default() {
        structures.remove(place);
    }
}

/// The transfer function that an object, or a part of it, is drawn with; none if there is no such part. A style that takes the place
/// of all of its nodes' is theirs here.
pub fn function_at(figure: &Template, of: &FunctionOf) -> Option<TransferFunctionTemplate> {
    let object = figure.objects.get(of.object)?;
    let Some(part) = &of.part else { return Some(object.transfer_function.clone()) };
    let region = object.regions.get(part.region)?;
    let look = region.look_at(part.structure.as_deref());
    let mut function = look.transfer_function.unwrap_or_else(|| object.transfer_function.clone());
    if let Some(style) = &look.style {
        function.all_nodes_mut().for_each(|node| node.style.clone_from(style));
    }
    Some(function)
}

/// The transfer function to be edited: a part's own, made where it has none. It says all of the part's styles from then on.
fn function_of<'a>(figure: &'a mut Template, of: &FunctionOf) -> Result<&'a mut TransferFunctionTemplate> {
    let drawn = function_at(figure, of);
    let object = object_of(figure, of.object)?;
    let Some(part) = &of.part else { return Ok(&mut object.transfer_function) };
    let region = region_of(&mut object.regions, part.region)?;
    let Some(drawn) = drawn else { bail!("the object has no region number {}", part.region + 1) };
    let look = match &part.structure {
        None => &mut region.look,
        Some(name) => {
            let place = region.structures.iter().position(|s| s.structure == *name).unwrap_or_else(|| {
                region.structures.push(StructureTemplate::of(name));
                region.structures.len() - 1
            });
            &mut region.structures[place].look
        }
    };
    look.style = None;
    Ok(look.transfer_function.insert(drawn))
}

fn node_of(nodes: &mut [NodeTemplate], node: usize) -> Result<&mut NodeTemplate> {
    match nodes.get_mut(node) {
        Some(found) => Ok(found),
        None => bail!("the transfer function has no node number {}", node + 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_a_volume_otherwise_says_what_changed() {
        let slot = |change: &dyn Fn(&mut VolumeSlot)| {
            let mut slot = VolumeSlot::new("v", "/scans/head.nii".to_owned());
            change(&mut slot);
            slot
        };
        let crop = Some([[0, 8], [0, 8], [0, 8]]);
        let plain = slot(&|_| {});
        let part = slot(&|s| (s.crop, s.reduce) = (crop, Some([2; 3])));
        for (before, now, label) in [
            (&plain, &part, "Read head.nii, cropped, at half resolution"),
            (&part, &plain, "Read head.nii, whole, at full resolution"),
            (
                &part,
                &slot(&|s| (s.crop, s.reduce) = (Some([[1, 8]; 3]), Some([3; 3]))),
                "Read head.nii, cropped otherwise, at 1/3 of the resolution",
            ),
            (&plain, &slot(&|s| s.reduce = Some([2, 2, 1])), "Read head.nii, reduced 2 x 2 x 1"),
            (&plain, &slot(&|s| s.series = Some("CT Abdomen".to_owned())), "Read head.nii, series CT Abdomen"),
            (&plain, &slot(&|s| (s.frame, s.labels) = (2, true)), "Read head.nii, frame 3, as structures"),
            (&plain, &slot(&|s| s.raw = Some("4x4x4xuint8".to_owned())), "Read head.nii, as 4x4x4xuint8"),
            (&plain, &slot(&|s| s.file = "/other/foot.nii".to_owned()), "Use foot.nii"),
            (&plain, &slot(&|s| s.file = "specimen:head@64".to_owned()), "Use specimen:head@64"),
        ] {
            assert_eq!(reading(Some(before), now), label);
        }
    }
}
