//! From a template and its volumes to the engine's scene: percentiles become values, names become styles, the
//! relative camera becomes one in world millimeters.

use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use fabrica_engine::Progress;
use fabrica_engine::color::linear_from_srgb8;
use fabrica_engine::scene::{
    self, Camera, Look, Object, Projection, Quality, Region, Scene, StyleTransferFunction, TransferFunctionNode,
};
use fabrica_engine::selection::Structure;
use fabrica_engine::styles::{StyleImage, StyleLibrary};
use fabrica_engine::volume::Volume;
use glam::DVec3;

use super::sources::Sources;
use super::template::{
    Background, CameraTemplate, Domain, ObjectTemplate, ProjectionName, QualityName, Reference, RegionTemplate,
    RestTemplate, Template, Tint, TransferFunctionTemplate, is_called,
};

/// The scene of a template with what was read for its slots, and what the user might want to know about how it came about, a
/// sentence each.
///
/// # Errors
/// One sentence: an unknown style, a number that makes no sense.
pub fn scene(
    template: &Template,
    sources: &Sources,
    styles: &StyleLibrary,
    progress: &Progress,
) -> Result<(Scene, Vec<String>)> {
    let mut notes = Vec::new();
    let mut used: Vec<Arc<StyleImage>> = Vec::new();
    let mut objects = Vec::new();
    for object in &template.objects {
        let slot = template.volumes.iter().position(|v| v.name == object.volume);
        let volume =
            slot.and_then(|i| sources.volumes.get(i)).context("a volume slot of the template is empty; fill it")?;
        let mut making = Making { volume, styles, used: &mut used, notes: &mut notes, progress };
        let mut made = making.object(object)?;
        for region in &object.regions {
            let slot = template.selections.iter().position(|s| s.name == region.selection);
            let structures = slot
                .and_then(|i| sources.selections.get(i))
                .with_context(|| format!("the selections \"{}\" were not read", region.selection))?;
            made.regions.extend(making.regions(region, object, &structures.structures)?);
        }
        objects.push(made);
    }
    let camera = camera(&template.camera, reference(template, sources, styles, progress)?.as_ref())?;
    let mut visible = template.objects.iter().map(|o| o.visible);
    objects.retain(|_| visible.next().unwrap_or(true));
    let scene = Scene {
        camera,
        objects,
        styles: used,
        background: match template.background {
            Background::Transparent => scene::Background::Transparent,
            Background::Color(rgb) => scene::Background::Color(rgb.map(linear_from_srgb8)),
        },
        quality: quality(template.quality),
    };
    scene.validate()?;
    Ok((scene, notes))
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
    Making { volume, styles, used, notes, progress }.object(template)
}

/// What the camera's lengths are relative to: the first object as its own transfer function shows it. Its regions have no part in
/// that, so that the view stays where it is when something is painted or hidden.
///
/// # Errors
/// As [`scene`], for what concerns the object.
pub fn reference(
    template: &Template,
    sources: &Sources,
    styles: &StyleLibrary,
    progress: &Progress,
) -> Result<Option<Object>> {
    let Some(first) = template.objects.first() else { return Ok(None) };
    let slot = template.volumes.iter().position(|v| v.name == first.volume);
    let volume =
        slot.and_then(|i| sources.volumes.get(i)).context("a volume slot of the template is empty; fill it")?;
    let plain = ObjectTemplate { rest: RestTemplate::default(), regions: Vec::new(), ..first.clone() };
    object(&plain, volume, styles, progress).map(Some)
}

/// An object of a scene in the making.
struct Making<'a> {
    volume: &'a Arc<Volume>,
    styles: &'a StyleLibrary,
    /// The scene's styles so far.
    used: &'a mut Vec<Arc<StyleImage>>,
    notes: &'a mut Vec<String>,
    progress: &'a Progress,
}

impl Making<'_> {
    fn object(&mut self, template: &ObjectTemplate) -> Result<Object> {
        if template.transfer_function.domain == Domain::Percentile {
            let background = self.volume.statistics(self.progress)?.background;
            self.notes.push(format!(
                "percentiles of \"{}\" are of its finite voxels above the background, {background:.6}",
                template.volume
            ));
        }
        let mut transfer_function = self.function(&template.transfer_function, None)?;
        // α_u is linear between nodes: a factor of all of it is one of theirs.
        transfer_function.nodes.iter_mut().for_each(|n| n.opacity *= template.rest.factor());
        Ok(Object {
            volume: self.volume.clone(),
            transfer_function,
            regions: Vec::new(),
            gradient_scale_mm: template
                .gradient_scale_mm
                .unwrap_or_else(|| self.volume.grid.spacing_mm().min_element()),
        })
    }

    /// `style`: takes the place of its nodes' own.
    fn function(&mut self, template: &TransferFunctionTemplate, style: Option<&str>) -> Result<StyleTransferFunction> {
        let value: Box<dyn Fn(f64) -> f64> = match template.domain {
            Domain::Data => Box::new(|at| at),
            Domain::Percentile => {
                let statistics = self.volume.statistics(self.progress)?;
                Box::new(|at| statistics.percentile_above_background(at))
            }
        };
        let mut nodes = Vec::with_capacity(template.nodes.len());
        for node in &template.nodes {
            let style = self.styles.get(style.unwrap_or(&node.style))?;
            let position = self.used.iter().position(|s| Arc::ptr_eq(s, &style)).unwrap_or_else(|| {
                self.used.push(style);
                self.used.len() - 1
            });
            nodes.push(TransferFunctionNode { value: value(node.at), style: position, opacity: node.opacity });
        }
        let voxel_mm = self.volume.grid.spacing_mm().min_element();
        Ok(StyleTransferFunction { nodes, reference_length_mm: template.reference_length_mm.unwrap_or(voxel_mm) })
    }

    /// The structures of a region. One that these selections do not have is a note: templates go to other data.
    fn regions(
        &mut self,
        template: &RegionTemplate,
        object: &ObjectTemplate,
        structures: &[Structure],
    ) -> Result<Vec<Region>> {
        let mut regions = Vec::new();
        for structure in drawn(template, structures) {
            let label = &structure.label;
            let look = template.look_at(Some(&template.called(label)));
            let tint = match look.tint.unwrap_or(if template.structure.is_none() { Tint::Own } else { Tint::None }) {
                Tint::None => None,
                Tint::Own => Some(label.color),
                Tint::Color(color) => Some(color),
            };
            let visible = look.visible.unwrap_or(true);
            let function = look.transfer_function.as_ref().unwrap_or(&object.transfer_function);
            regions.push(Region {
                name: label.name.clone(),
                selection: structure.selection.clone(),
                look: Look {
                    transfer_function: self.function(function, look.style.as_deref())?,
                    tint: tint.map(|color| color.map(linear_from_srgb8)),
                    opacity: if visible { look.opacity.unwrap_or(1.0) } else { 0.0 },
                },
                moved: None,
            });
        }
        if regions.is_empty() {
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
}

/// The structures that a region draws, in the order of the scene's regions.
pub fn drawn<'a>(template: &RegionTemplate, structures: &'a [Structure]) -> impl Iterator<Item = &'a Structure> {
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
