//! From a template and its volumes to the engine's scene: percentiles become values, names become styles, the
//! relative camera becomes one in world millimeters.

use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use fabrica_engine::Progress;
use fabrica_engine::color::linear_from_srgb8;
use fabrica_engine::scene::across::Between;
use fabrica_engine::scene::parts::Polyhedron;
use fabrica_engine::scene::{
    self, Across, Axis, Camera, Contours, Cut, Look, Meeting, Meetings, Moved, Object, Part, Parts, Plane, Projection,
    Quality, Region, Row, Scene, StyleTransferFunction, TransferFunctionNode,
};
use fabrica_engine::selection::{DistanceField, Selection, Structure};
use fabrica_engine::spaces::Grid;
use fabrica_engine::styles::{StyleImage, StyleLibrary};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::labels::Label;
use glam::{DAffine3, DVec3};

use super::sources::Sources;
use super::style_settings::StyleSettings;
use super::template::{
    AxisName, Background, CameraTemplate, CutTemplate, Domain, IMPORTANCE, LightingTemplate, LookTemplate,
    MeetingTemplate, MoveTemplate, NodeTemplate, ObjectTemplate, PartsTemplate, ProjectionName, QualityName, Reference,
    RegionTemplate, ShadingTemplate, Template, Tint, TransferFunctionTemplate, Transparency, is_called,
};
use super::theme::{Theme, Wardrobe};

/// The scene of a template with what was read for its slots, and what the user might want to know about how it came about, a
/// sentence each.
///
/// # Errors
/// One sentence: an unknown style, a number that makes no sense.
pub fn scene<'a>(
    template: &Template,
    sources: &Sources,
    wardrobe: impl Into<Wardrobe<'a>>,
    progress: &Progress,
) -> Result<(Scene, Vec<String>)> {
    let wardrobe = wardrobe.into();
    let reference = reference(template, sources, progress)?;
    let (center_mm, radius_mm) =
        reference.as_ref().map_or((DVec3::ZERO, 1.0), |object| sphere(template.camera.relative_to, object));
    let mut notes = Vec::new();
    let theme = wardrobe.themes.of(template).unwrap_or_else(|unknown| {
        notes.push(format!("{unknown}; the figure is drawn without it"));
        None
    });
    let mut used: Vec<Arc<StyleImage>> = Vec::new();
    let mut objects = Vec::new();
    for object in &template.objects {
        let distances = distances(template, object, sources, &mut notes, progress)?;
        let slot = template.volumes.iter().position(|v| v.name == object.volume);
        let volume =
            slot.and_then(|i| sources.volumes.get(i)).context("a volume slot of the template is empty; fill it")?;
        let mut making = Making {
            volume,
            wardrobe,
            theme: theme.map(Arc::as_ref),
            settings: Some(&template.style_settings),
            used: &mut used,
            notes: &mut notes,
            radius_mm,
            poses: Vec::new(),
            distances: distances.iter().map(|(from, _)| from.as_str()).collect(),
            progress,
        };
        let mut made = making.object(object)?;
        made.distances = distances.iter().map(|(_, field)| field.clone()).collect();
        made.parts = parts(&object.parts, &volume.grid, center_mm, radius_mm);
        for region in &object.regions {
            let slot = template.selections.iter().position(|s| s.name == region.selection);
            let structures = slot
                .and_then(|i| sources.selections.get(i))
                .with_context(|| format!("the selections \"{}\" were not read", region.selection))?;
            made.regions.extend(making.regions(region, object, &structures.structures)?);
        }
        objects.push(made);
    }
    let camera = camera(&template.camera, reference.as_ref())?;
    let mut visible = template.objects.iter().map(|o| o.visible);
    objects.retain(|_| visible.next().unwrap_or(true));
    let scene = Scene {
        camera,
        objects,
        styles: used,
        background: background(wardrobe.themes.background(template)),
        quality: quality(template.quality),
        page_height_mm: template.figure.height_mm,
    };
    scene.validate()?;
    Ok((scene, notes))
}

/// A template's background as a scene's.
pub fn background(background: Background) -> scene::Background {
    match background {
        Background::Transparent => scene::Background::Transparent,
        Background::Color(rgb) => scene::Background::Color(rgb.map(linear_from_srgb8)),
    }
}

/// The settings behind a quality's name.
pub fn quality(name: QualityName) -> Quality {
    match name {
        QualityName::Draft => Quality::DRAFT,
        QualityName::Standard => Quality::STANDARD,
        QualityName::Final => Quality::FINAL,
    }
}

/// One object by itself: what a first look is framed by.
///
/// # Errors
/// As [`scene`], for what concerns the object.
pub(super) fn object(
    template: &ObjectTemplate,
    volume: &Arc<Volume>,
    styles: &StyleLibrary,
    progress: &Progress,
) -> Result<Object> {
    let (used, notes) = (&mut Vec::new(), &mut Vec::new());
    let (wardrobe, theme, poses, distances) = (styles.into(), None, Vec::new(), Vec::new());
    Making { volume, wardrobe, theme, settings: None, used, notes, radius_mm: 1.0, poses, distances, progress }
        .object(template)
}

/// What the camera's lengths are relative to: the first object as its own transfer function shows it, in whatever styles. Its regions
/// have no part in that, so that the view stays where it is when something is painted or hidden.
///
/// # Errors
/// One sentence: a volume that is missing, or [`fabrica_engine::Error::Cancelled`].
pub fn reference(template: &Template, sources: &Sources, progress: &Progress) -> Result<Option<Object>> {
    let Some(first) = template.objects.first() else { return Ok(None) };
    let slot = template.volumes.iter().position(|v| v.name == first.volume);
    let volume =
        slot.and_then(|i| sources.volumes.get(i)).context("a volume slot of the template is empty; fill it")?;
    let value = values(volume, first.transfer_function.domain, progress)?;
    let nodes = |of: &[NodeTemplate]| -> Vec<TransferFunctionNode> {
        of.iter().map(|n| TransferFunctionNode { value: value(n.at), style: 0, opacity: n.opacity }).collect()
    };
    let voxel_mm = volume.grid.spacing_mm().min_element();
    let d0 = first.transfer_function.reference_length_mm.unwrap_or(voxel_mm);
    // Any row may show something, wherever it is.
    let across = first.transfer_function.across.as_ref().map(|across| {
        let rows = across.rows.iter().map(|row| Row { at: row.at, nodes: nodes(&row.nodes) });
        Across { axis: Axis::Even(0.0), at: across.at, rows: rows.collect() }
    });
    let own = StyleTransferFunction::new(nodes(&first.transfer_function.nodes), d0);
    let transfer_function = StyleTransferFunction { across, ..own };
    let gradient_scale_mm = first.gradient_scale_mm.unwrap_or(voxel_mm);
    Ok(Some(Object {
        volume: volume.clone(),
        transfer_function,
        regions: Vec::new(),
        lighting: None,
        gradient_scale_mm,
        distances: Vec::new(),
        parts: Parts::default(),
    }))
}

/// From what a transfer function's positions count to data values.
fn values<'a>(volume: &'a Volume, domain: Domain, progress: &Progress) -> Result<Box<dyn Fn(f64) -> f64 + 'a>> {
    Ok(match domain {
        Domain::Data => Box::new(|at| at),
        Domain::Percentile => {
            let statistics = volume.statistics(progress)?;
            Box::new(|at| statistics.percentile_above_background(at))
        }
    })
}

/// An object of a scene in the making.
struct Making<'a> {
    volume: &'a Arc<Volume>,
    wardrobe: Wardrobe<'a>,
    /// What the template's styles are drawn in.
    theme: Option<&'a Theme>,
    /// Where the styles' sliders are; none: at the styles' own values.
    settings: Option<&'a StyleSettings>,
    /// The scene's styles so far.
    used: &'a mut Vec<Arc<StyleImage>>,
    notes: &'a mut Vec<String>,
    /// What lengths of moves are relative to.
    radius_mm: f64,
    /// Where regions were moved to so far.
    poses: Vec<DAffine3>,
    /// What the object's distances are measured from.
    distances: Vec<&'a str>,
    progress: &'a Progress,
}

/// Poses that differ by less, in mm and of their matrices, are the same.
const SAME_POSE: f64 = 1e-7;

impl Making<'_> {
    fn object(&mut self, template: &ObjectTemplate) -> Result<Object> {
        if template.transfer_function.domain == Domain::Percentile {
            let background = self.volume.statistics(self.progress)?.background;
            self.notes.push(format!(
                "percentiles of \"{}\" are of its finite voxels above the background, {background:.6}",
                template.volume
            ));
        }
        let mut transfer_function = self.function(&template.transfer_function, None, &template.shading, IMPORTANCE)?;
        // α_u is linear between nodes: a factor of all of it is one of theirs.
        transfer_function.all_nodes_mut().for_each(|n| n.opacity *= template.rest.factor());
        Ok(Object {
            volume: self.volume.clone(),
            transfer_function,
            regions: Vec::new(),
            lighting: template.lighting.as_ref().map(LightingTemplate::lighting),
            gradient_scale_mm: template
                .gradient_scale_mm
                .unwrap_or_else(|| self.volume.grid.spacing_mm().min_element()),
            distances: Vec::new(),
            parts: Parts::default(),
        })
    }

    /// `style`: takes the place of its nodes' own. `importance`: of the part that is drawn.
    fn function(
        &mut self,
        template: &TransferFunctionTemplate,
        style: Option<&str>,
        shading: &ShadingTemplate,
        importance: f64,
    ) -> Result<StyleTransferFunction> {
        let value = values(self.volume, template.domain, self.progress)?;
        let mut nodes = |of: &[NodeTemplate]| -> Result<Vec<TransferFunctionNode>> {
            let mut nodes = Vec::with_capacity(of.len());
            for node in of {
                let named = style.unwrap_or(&node.style);
                let Wardrobe { styles, themes } = self.wardrobe;
                let drawn = self.theme.map_or(named, |theme| themes.style(theme, named));
                let style = match self.settings.and_then(|settings| settings.get(drawn)) {
                    Some(values) => styles.with_values(drawn, values)?,
                    None => styles.get(drawn)?,
                };
                let position = self.used.iter().position(|s| Arc::ptr_eq(s, &style)).unwrap_or_else(|| {
                    self.used.push(style);
                    self.used.len() - 1
                });
                nodes.push(TransferFunctionNode { value: value(node.at), style: position, opacity: node.opacity });
            }
            Ok(nodes)
        };
        let mut own = nodes(&template.nodes)?;
        let across = match &template.across {
            None => None,
            Some(across) => {
                let rows = across.rows.iter().map(|row| Ok(Row { at: row.at, nodes: nodes(&row.nodes)? }));
                let rows = rows.collect::<Result<Vec<Row>>>()?;
                let from = across.from.as_deref().unwrap_or_default();
                let field = self.distances.iter().position(|name| *name == from);
                let axis = match (across.by, field) {
                    (AxisName::Edge, _) => Axis::Edge,
                    (AxisName::Importance, _) => Axis::Even(importance),
                    (AxisName::Distance, Some(field)) => Axis::Distance(field),
                    (AxisName::Distance, None) => bail!("there are no distances from \"{from}\"; name another region"),
                };
                let across = Across { axis, at: across.at, rows };
                if matches!(axis, Axis::Even(_)) { only_around(across, importance, &mut own) } else { Some(across) }
            }
        };
        let voxel_mm = self.volume.grid.spacing_mm().min_element();
        let shading = self.theme.map_or_else(|| shading.clone(), |theme| shading.or(&theme.shading));
        Ok(StyleTransferFunction {
            contours: shading.contours.as_ref().filter(|contours| contours.width_pt > 0.0).map(|contours| Contours {
                width_pt: contours.width_pt,
                color: contours.color.map(|color| color.0.map(linear_from_srgb8)),
            }),
            illustrative_transparency: shading.transparency == Some(Transparency::Illustrative),
            across,
            ..StyleTransferFunction::new(own, template.reference_length_mm.unwrap_or(voxel_mm))
        })
    }

    /// The structures of a region. One that these selections do not have is a note: templates go to other data.
    fn regions(
        &mut self,
        template: &RegionTemplate,
        object: &ObjectTemplate,
        structures: &[Structure],
    ) -> Result<Vec<Region>> {
        let mut regions: Vec<Region> = Vec::new();
        for structure in drawn(template, structures) {
            let label = &structure.label;
            let name = template.called(label);
            let look = template.look_at(Some(&name));
            let own = template.own_move(Some(&name));
            let importance = template.importance_of(Some(&name));
            let moved = match own.or(template.moved.as_ref()).filter(|moved| moved.is_moved()) {
                None => None,
                Some(moved) => {
                    let center_mm = center_mm(template, structures, own.map(|_| name.as_str()), &self.volume.grid);
                    let ghost = self.look(&moved.ghost_of(&look), template, object, label, importance)?;
                    let pose = moved.pose(center_mm, self.radius_mm);
                    // What was moved together is one body; it has one pose to the last bit.
                    let known = self.poses.iter().find(|known| known.abs_diff_eq(pose, SAME_POSE)).copied();
                    let pose = known.unwrap_or_else(|| {
                        self.poses.push(pose);
                        pose
                    });
                    Some(Moved { pose, ghost, meetings: meetings(moved) })
                }
            };
            let look = self.look(&look, template, object, label, importance)?;
            regions.push(Region { name: label.name.clone(), selection: structure.selection.clone(), look, moved });
        }
        // What is drawn otherwise is not missing.
        if regions.is_empty() && meant(template, structures).next().is_none() {
            self.notes.push(match &template.structure {
                Some(structure) => {
                    format!(
                        "the selections \"{}\" have no structure \"{structure}\": it is not drawn",
                        template.selection
                    )
                }
                None => format!("the selections \"{}\" have no structures: none is drawn", template.selection),
            });
        }
        Ok(regions)
    }

    /// How a structure of a region is drawn that has this look.
    fn look(
        &mut self,
        look: &LookTemplate,
        template: &RegionTemplate,
        object: &ObjectTemplate,
        label: &Label,
        importance: f64,
    ) -> Result<Look> {
        let tint = match look.tint.unwrap_or(if template.structure.is_none() { Tint::Own } else { Tint::None }) {
            Tint::None => None,
            Tint::Own => Some(label.color),
            Tint::Color(color) => Some(color),
        };
        let function = look.transfer_function.as_ref().unwrap_or(&object.transfer_function);
        let own = look.style.as_deref();
        let is_veil = || function.all_nodes().any(|node| self.wardrobe.themes.is_veil(own.unwrap_or(&node.style)));
        let (style, tint) = match (self.theme, tint) {
            (Some(theme), Some(color)) => theme.dress(color, is_veil()),
            (_, tint) => (None, tint),
        };
        let visible = look.visible.unwrap_or(true);
        Ok(Look {
            transfer_function: self.function(function, style.or(own), &look.shading.or(&object.shading), importance)?,
            tint: tint.map(|color| color.map(linear_from_srgb8)),
            opacity: if visible { look.opacity.unwrap_or(1.0) } else { 0.0 },
        })
    }
}

/// Of rows by a number that is the same throughout, those that it is between: but nodes (`own`), where it is at one or beyond all.
fn only_around(across: Across, place: f64, own: &mut Vec<TransferFunctionNode>) -> Option<Across> {
    let Between { lower, upper, .. } = across.between(place);
    let mut rows = across.rows;
    rows.insert(0, Row { at: across.at, nodes: std::mem::take(own) });
    rows.truncate(upper + 1);
    let mut around = rows.split_off(lower).into_iter();
    let first = around.next()?;
    *own = first.nodes;
    let rows: Vec<Row> = around.collect();
    (!rows.is_empty()).then_some(Across { axis: across.axis, at: first.at, rows })
}

/// What the functions of an object measure distances from, each with its field.
fn distances(
    template: &Template,
    object: &ObjectTemplate,
    sources: &Sources,
    notes: &mut Vec<String>,
    progress: &Progress,
) -> Result<Vec<(String, Arc<DistanceField>)>> {
    let looks =
        object.regions.iter().flat_map(|r| std::iter::once(&r.look).chain(r.structures.iter().map(|s| &s.look)));
    let functions =
        std::iter::once(&object.transfer_function).chain(looks.filter_map(|l| l.transfer_function.as_ref()));
    let wanted = functions.filter_map(|f| f.across.as_ref().filter(|a| a.by == AxisName::Distance)?.from.as_ref());
    let mut found: Vec<(String, Arc<DistanceField>)> = Vec::new();
    for from in wanted {
        if found.iter().any(|(known, _)| known == from) {
            continue;
        }
        let structures = |region: &RegionTemplate| {
            let slot = template.selections.iter().position(|s| s.name == region.selection)?;
            Some(&sources.selections.get(slot)?.structures[..])
        };
        let selections = measured_from(object, structures, from);
        if selections.is_empty() {
            notes.push(format!(
                "there is no \"{from}\" to measure distances from: everything counts as far away from it"
            ));
        }
        let slot = template.volumes.iter().position(|v| v.name == object.volume);
        let grid =
            &slot.and_then(|i| sources.volumes.get(i)).context("a volume slot of the template is empty; fill it")?.grid;
        found.push((from.clone(), DistanceField::of(&selections, grid, progress)?));
    }
    Ok(found)
}

/// The voxels of what is called so: of all that is drawn of a region, or of a structure in a group. `structures`: those of a region's
/// selections, as far as they were read.
pub fn measured_from<'a>(
    object: &ObjectTemplate,
    structures: impl Fn(&RegionTemplate) -> Option<&'a [Structure]>,
    from: &str,
) -> Vec<Selection> {
    let drawn = |region| drawn(region, structures(region).unwrap_or_default());
    let voxels = |s: &Structure| s.selection.clone();
    if let Some(region) = object.regions.iter().find(|region| region.title() == from) {
        return drawn(region).map(voxels).collect();
    }
    let groups = object.regions.iter().filter(|region| region.structure.is_none());
    groups.flat_map(drawn).filter(|s| is_called(&s.label, from)).take(1).map(voxels).collect()
}

/// What an object is cut into. `center_mm`, `radius_mm`: what lengths are relative to.
fn parts(template: &PartsTemplate, grid: &Grid, center_mm: DVec3, radius_mm: f64) -> Parts {
    let cut = |cut: &CutTemplate| {
        let normal = DVec3::from_array(cut.normal).normalize_or_zero();
        let at = center_mm + radius_mm * DVec3::from_array(cut.at);
        Cut { part: cut.part.saturating_sub(1), plane: Plane { normal, offset: normal.dot(at) } }
    };
    let part = |i| {
        let name = template.title(i);
        Part { name, pose: DAffine3::IDENTITY, hidden: template.part(i).hidden }
    };
    let mut parts =
        Parts { cuts: template.cuts.iter().map(cut).collect(), list: (0..template.count()).map(part).collect() };
    let poses: Vec<DAffine3> = parts
        .bounds(grid)
        .iter()
        .enumerate()
        .map(|(i, bounds)| {
            template.part(i).as_move().pose(bounds.as_ref().map_or(center_mm, Polyhedron::middle), radius_mm)
        })
        .collect();
    parts.list.iter_mut().zip(poses).for_each(|(part, pose)| part.pose = pose);
    parts
}

/// How a moved region looks where it meets others.
fn meetings(moved: &MoveTemplate) -> Meetings {
    let meeting = |meeting: &MeetingTemplate| Meeting {
        color: meeting.color.0.map(linear_from_srgb8),
        opacity: meeting.opacity,
        strength: meeting.strength.as_ref().map(|strength| strength.0.clone()),
    };
    Meetings {
        ghost: moved.meets_ghost.as_ref().map(meeting),
        background: moved.meets_background.as_ref().map(meeting),
    }
}

/// What a region turns about or, by the name that the template gives it, a structure of it, world mm: the middle of the box around all
/// of its voxels; of the grid, where it has none.
pub fn center_mm(template: &RegionTemplate, structures: &[Structure], structure: Option<&str>, grid: &Grid) -> DVec3 {
    let (low, high) = index_box(template, structures, structure, grid);
    grid.world_from_index().transform_point3(0.5 * (low + high))
}

/// The corners of that box, at rest: bit 0 of their number is x, bit 1 y, bit 2 z.
pub fn corners_mm(
    template: &RegionTemplate,
    structures: &[Structure],
    structure: Option<&str>,
    grid: &Grid,
) -> [DVec3; 8] {
    let (low, high) = index_box(template, structures, structure, grid);
    let corner = |i: usize| DVec3::from_array(std::array::from_fn(|a| if i >> a & 1 == 1 { high[a] } else { low[a] }));
    std::array::from_fn(|i| grid.world_from_index().transform_point3(corner(i)))
}

/// From voxel to voxel, index space.
fn index_box(
    template: &RegionTemplate,
    structures: &[Structure],
    structure: Option<&str>,
    grid: &Grid,
) -> (DVec3, DVec3) {
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    let is_meant = |s: &&Structure| structure.is_none_or(|name| template.called(&s.label) == name);
    // With what a copy is drawn in place of: a group that was moved stays where it is when one of it is painted on.
    let selections = meant(template, structures).filter(is_meant);
    for bounds in selections.filter_map(|structure| structure.selection.bounds()) {
        low = low.min(DVec3::from_array(bounds.map(|b| b[0] as f64)));
        high = high.max(DVec3::from_array(bounds.map(|b| b[1] as f64 - 1.0)));
    }
    if low.x > high.x { grid.index_box() } else { (low, high) }
}

/// What lengths of moves are relative to, mm: as those of the camera.
///
/// `reference`: what the function of that name says of the template.
pub fn radius_mm(template: &Template, reference: Option<&Object>) -> f64 {
    reference.map_or(1.0, |object| sphere(template.camera.relative_to, object).1)
}

/// The structures that a region draws, in the order of the scene's regions.
pub fn drawn<'a>(template: &RegionTemplate, structures: &'a [Structure]) -> impl Iterator<Item = &'a Structure> {
    meant(template, structures).filter(|s| !template.is_replaced(&s.label))
}

/// The same, with those that a painted copy is drawn in place of.
pub fn meant<'a>(template: &RegionTemplate, structures: &'a [Structure]) -> impl Iterator<Item = &'a Structure> {
    let most = if template.structure.is_some() { 1 } else { usize::MAX };
    let wanted = template.structure.clone();
    structures.iter().filter(move |s| wanted.as_deref().is_none_or(|wanted| is_called(&s.label, wanted))).take(most)
}

/// Center and radius, in world mm, of the sphere that a camera's lengths are relative to.
pub(super) fn sphere(relative_to: Reference, object: &Object) -> (DVec3, f64) {
    let (low, high) = match relative_to {
        Reference::Volume => object.volume.grid.index_box(),
        Reference::Visible => object.visible_index_box(),
    };
    let corners = object.volume.grid.box_corners_mm(low, high);
    let center = corners.iter().sum::<DVec3>() / 8.0;
    (center, corners.iter().map(|c| c.distance(center)).fold(0.0, f64::max))
}

fn camera(template: &CameraTemplate, object: Option<&Object>) -> Result<Camera> {
    let (center, radius) = object.map_or((DVec3::ZERO, 1.0), |object| sphere(template.relative_to, object));
    if !(template.height > 0.0 && template.height.is_finite()) {
        bail!("the camera shows a height of {} radii; give a positive number", template.height);
    }
    // Scaled first: lengths beyond 1e154 have squares that are no numbers.
    let from = DVec3::from_array(template.from);
    let from = (from / from.abs().max_element())
        .try_normalize()
        .context("the camera's \"from\" has no direction; give three numbers, not all 0, from the object to the eye")?;
    if template.projection == ProjectionName::Perspective && !(template.fov_deg > 0.0 && template.fov_deg < 180.0) {
        bail!("the camera's field of view is {} degrees; give one between 0 and 180", template.fov_deg);
    }
    let target = center + radius * DVec3::from_array(template.target);
    let (projection, distance) = match template.projection {
        ProjectionName::Perspective => {
            let half = (0.5 * template.fov_deg.to_radians()).tan();
            (Projection::Perspective { fov_y_deg: template.fov_deg }, 0.5 * template.height * radius / half)
        }
        ProjectionName::Orthographic => {
            (Projection::Orthographic { height_mm: template.height * radius }, 2.0 * radius)
        }
    };
    Ok(Camera::looking(target + distance * from, -from, DVec3::from_array(template.up), projection)?)
}

#[cfg(test)]
mod tests {
    use fabrica_engine::selection::{BrickPool, Selection};
    use fabrica_engine::volume::{Rescale, Voxels};

    use super::*;
    use crate::figure::sources::Selections;
    use crate::figure::template::{SelectionSlot, StructureTemplate, Tint};

    #[test]
    fn rows_by_importance_are_those_around_it() {
        let nodes = |value: f64| vec![TransferFunctionNode { value, style: 0, opacity: 0.5 }];
        let across = || Across {
            axis: Axis::Even(0.0),
            at: 0.0,
            rows: [1.0, 2.0].map(|at| Row { at, nodes: nodes(at) }).to_vec(),
        };
        let found = |place: f64| {
            let mut own = nodes(0.0);
            let rows = only_around(across(), place, &mut own).map(|a| (a.at, a.rows.iter().map(|r| r.at).collect()));
            (own[0].value, rows)
        };
        assert_eq!(found(-1.0), (0.0, None));
        assert_eq!(found(0.25), (0.0, Some((0.0, vec![1.0]))));
        assert_eq!(found(1.0), (1.0, None));
        assert_eq!(found(1.5), (1.0, Some((1.0, vec![2.0]))));
        assert_eq!(found(9.0), (2.0, None));
    }

    /// A volume of 32³ voxels of 2 mm, all shown, with two boxes in a label map.
    fn figure() -> (Template, Sources) {
        let grid = Grid::new([32; 3], DAffine3::from_scale(DVec3::splat(2.0))).unwrap();
        let voxels = Voxels::U8(vec![200; grid.num_voxels()]);
        let volume = Arc::new(Volume::new(grid, voxels, Rescale::IDENTITY, "test").unwrap());
        let text = r#"{"fabrica": 1, "volumes": [{"name": "v", "file": "a.nii"}],
            "objects": [{"volume": "v", "transfer_function": {"domain": "data", "nodes": [{"at": 0, "style": "wax", "opacity": 0.5}]}}],
            "camera": {"from": [0, 1, 0]}, "figure": {"width_mm": 80, "height_mm": 60}}"#;
        let mut template = Template::parse(text).unwrap();
        template.selections.push(SelectionSlot::new("organs", "v", "labels.nii".to_owned()));
        template.objects[0].regions.push(RegionTemplate::of("organs", None));
        let structure = |name: &str, color: [u8; 3], bounds: [[usize; 2]; 3]| {
            let mut selection = Selection::empty(grid, &Arc::new(BrickPool::default()));
            selection.change(bounds, |_, _| 255);
            Structure { label: Label { id: 1, name: name.to_owned(), color, code: None }, selection }
        };
        let liver = structure("liver", [255, 0, 0], [[4, 8], [10, 12], [0, 5]]);
        let spleen = structure("spleen", [0, 0, 255], [[12, 14], [10, 20], [2, 7]]);
        let selections = Selections { structures: vec![liver, spleen], ..Selections::default() };
        (template, Sources { volumes: vec![volume], selections: vec![Arc::new(selections)] })
    }

    fn made(template: &Template, sources: &Sources) -> Scene {
        scene(template, sources, &StyleLibrary::embedded(), &Progress::new()).unwrap().0
    }

    #[test]
    fn a_theme_changes_styles_page_lines_and_tints_and_nothing_is_left_of_it() {
        let (template, sources) = figure();
        let mut document = crate::figure::Document::new(template);
        let own = made(document.figure(), &sources);
        // All that is in it but voxels.
        let facts = |scene: &Scene| {
            let object = |o: &Object| {
                let regions =
                    o.regions.iter().map(|r| (r.name.clone(), r.look.clone(), r.moved.clone())).collect::<Vec<_>>();
                format!("{:?} {regions:?} {:?} {}", o.transfer_function, o.lighting, o.gradient_scale_mm)
            };
            let objects: Vec<String> = scene.objects.iter().map(object).collect();
            let styles: Vec<&str> = scene.styles.iter().map(|s| s.name.as_str()).collect();
            format!("{:?} {objects:?} {styles:?} {:?} {:?}", scene.camera, scene.background, scene.quality)
        };
        let set = |document: &mut crate::figure::Document, name: Option<&str>| {
            document.apply(crate::figure::Command::SetTheme(name.map(str::to_owned))).unwrap();
        };
        set(&mut document, Some("color_blind_safe"));
        assert_eq!(document.undo_label(), Some("Use theme Color-blind safe"));
        let themed = made(document.figure(), &sources);
        let names = |scene: &Scene| scene.styles.iter().map(|style| style.name.clone()).collect::<Vec<_>>();
        assert_eq!(
            (names(&own), names(&themed)),
            (vec!["wax".to_owned()], ["matte_yellow", "matte_vermilion", "matte_blue"].map(str::to_owned).to_vec())
        );
        assert_eq!(themed.background, scene::Background::Color([1.0; 3]));
        let (was, is) = (&own.objects[0], &themed.objects[0]);
        assert!(was.transfer_function.contours.is_none());
        assert_eq!(is.transfer_function.contours.as_ref().unwrap().width_pt, 0.45);
        assert_eq!(was.transfer_function.nodes, is.transfer_function.nodes);
        let tints = |object: &Object| object.regions.iter().map(|r| r.look.tint).collect::<Vec<_>>();
        assert_eq!(tints(was), [Some([1.0, 0.0, 0.0]), Some([0.0, 0.0, 1.0])]);
        assert_eq!(tints(is), [None, None]);
        let style = |i: usize| themed.styles[is.regions[i].look.transfer_function.nodes[0].style].name.as_str();
        assert_eq!([style(0), style(1)], ["matte_vermilion", "matte_blue"]);
        // What the object itself says of lines holds, and so does the view.
        let mut ours = (**document.figure()).clone();
        ours.objects[0].shading.contours = Some(crate::figure::template::ContoursTemplate::new(0.0));
        assert!(made(&ours, &sources).objects[0].transfer_function.contours.is_none());
        assert_eq!(themed.camera, own.camera);
        // And back, one way and the other.
        set(&mut document, None);
        assert_eq!(facts(&made(document.figure(), &sources)), facts(&own));
        set(&mut document, Some("xray"));
        assert!(made(document.figure(), &sources).objects[0].regions.iter().all(|r| r.look.tint.is_none()));
        assert!(document.undo() && facts(&made(document.figure(), &sources)) == facts(&own));
        // A theme of somebody else's.
        set(&mut document, Some("impasto"));
        let (drawn, notes) = scene(document.figure(), &sources, &StyleLibrary::embedded(), &Progress::new()).unwrap();
        assert!(facts(&drawn) == facts(&own) && notes.len() == 1, "{notes:?}");
        assert!(notes[0].starts_with("there is no theme \"impasto\"") && notes[0].ends_with("without it"), "{notes:?}");
    }

    #[test]
    fn a_group_moves_as_one_about_the_middle_of_all_of_it() {
        let (mut template, sources) = figure();
        let moved = MoveTemplate {
            offset: [0.0, 0.5, 0.0],
            turn: [0.0, 0.0, 180.0],
            scale: 0.5,
            meets_ghost: Some(MeetingTemplate::new([255, 0, 255])),
            ..MoveTemplate::default()
        };
        template.objects[0].regions[0].moved = Some(moved);
        let scene = made(&template, &sources);
        let object = &scene.objects[0];
        let moves: Vec<&Moved> = object.regions.iter().map(|r| r.moved().unwrap()).collect();
        assert_eq!((moves[0].pose, &moves[0].meetings), (moves[1].pose, &moves[1].meetings));
        // At rest, their ghost, and they.
        assert_eq!(object.bodies().len(), 3);
        // The box of both: voxels 4 to 13, 10 to 19 and 0 to 6; the sphere around 64 mm of all sides.
        let center = DVec3::new(17.0, 29.0, 6.0);
        let offset = DVec3::Y * 0.5 * 32.0 * 3f64.sqrt();
        let pose = moves[0].pose;
        assert!(pose.transform_point3(center).distance(center + offset) < 1e-9);
        let right = center + DVec3::new(8.0, 0.0, 2.0);
        assert!(pose.transform_point3(right).distance(center + offset + DVec3::new(-4.0, 0.0, 1.0)) < 1e-9);
        // Each ghost has the color of its structure, faintly.
        for (moved, tint) in moves.iter().zip([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) {
            assert_eq!((moved.ghost.tint, moved.ghost.opacity), (Some(tint), 0.15));
        }
        assert_eq!(moves[0].meetings.ghost.as_ref().unwrap().color, [1.0, 0.0, 1.0]);
    }

    #[test]
    fn what_moves_nothing_is_not_moved_and_ghosts_may_be_hidden() {
        let (mut template, sources) = figure();
        let ghost = LookTemplate { visible: Some(false), tint: Some(Tint::None), ..LookTemplate::default() };
        let rests = MoveTemplate { ghost, ..MoveTemplate::default() };
        template.objects[0].regions[0].moved = Some(rests.clone());
        assert!(made(&template, &sources).objects[0].regions.iter().all(|r| r.moved.is_none()));
        template.objects[0].regions[0].moved = Some(MoveTemplate { scale: 1.5, ..rests });
        let scene = made(&template, &sources);
        let ghost = &scene.objects[0].regions[1].moved().unwrap().ghost;
        assert!(ghost.opacity == 0.0 && ghost.tint.is_none(), "{ghost:?}");
        assert_eq!(scene.objects[0].regions[1].look.opacity, 1.0);
    }

    #[test]
    fn a_structure_of_a_group_is_moved_by_itself() {
        let (mut template, sources) = figure();
        let region = &mut template.objects[0].regions[0];
        region.moved = Some(MoveTemplate { offset: [0.0, 0.5, 0.0], ..MoveTemplate::default() });
        let own = MoveTemplate { turn: [90.0, 0.0, 0.0], ..MoveTemplate::default() };
        region.structures.push(StructureTemplate { moved: Some(own), ..StructureTemplate::of("spleen") });
        let poses = |template: &Template| -> Vec<Option<DAffine3>> {
            let scene = made(template, &sources);
            scene.objects[0].regions.iter().map(|r| r.moved().map(|m| m.pose)).collect()
        };
        let found = poses(&template);
        assert_eq!(found[0].unwrap().matrix3, glam::DMat3::IDENTITY);
        // About its own middle: voxels 12 to 13, 10 to 19 and 2 to 6.
        let center = DVec3::new(25.0, 29.0, 8.0);
        let at = found[1].unwrap().transform_point3(center + DVec3::Y);
        assert!(at.distance(center + DVec3::Z) < 1e-9, "{at}");
        // What says that it is where it was found does not follow its group.
        template.objects[0].regions[0].structures[0].moved = Some(MoveTemplate::default());
        let found = poses(&template);
        assert!(found[0].is_some() && found[1].is_none());
        // Both by the same, each about its middle and then to where the whole would bring it: one body.
        let region = &mut template.objects[0].regions[0];
        let whole = MoveTemplate { turn: [10.0, 20.0, 30.0], scale: 0.9, ..MoveTemplate::default() };
        let center_of = |region: &RegionTemplate, name: Option<&str>| {
            center_mm(region, &sources.selections[0].structures, name, &sources.volumes[0].grid)
        };
        let radius_mm = 32.0 * 3f64.sqrt();
        region.moved = Some(whole.clone());
        region.structures[0].moved =
            Some(whole.with_center(center_of(region, None), center_of(region, Some("spleen")), radius_mm));
        assert!(DVec3::from_array(region.structures[0].moved.as_ref().unwrap().offset).length() > 0.01);
        let found = poses(&template);
        assert_eq!(found[0], found[1]);
    }

    #[test]
    fn an_empty_region_turns_about_the_middle_of_the_volume() {
        let (template, sources) = figure();
        let region = RegionTemplate::of("organs", Some("kidney".to_owned()));
        let grid = &sources.volumes[0].grid;
        assert_eq!(center_mm(&region, &sources.selections[0].structures, None, grid), DVec3::splat(31.0));
        assert_eq!(template.objects[0].regions.len(), 1);
    }
}
