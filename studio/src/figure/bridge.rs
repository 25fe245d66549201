//! From a template and its volumes to the engine's scene: percentiles become values, names become styles, the
//! relative camera becomes one in world millimeters.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use fabrica_engine::Progress;
use fabrica_engine::color::linear_from_srgb8;
use fabrica_engine::read::ReadOptions;
use fabrica_engine::read::limits::Limits;
use fabrica_engine::scene::{
    self, Camera, Object, Projection, Quality, Scene, StyleTransferFunction, TransferFunctionNode,
};
use fabrica_engine::styles::{StyleImage, StyleLibrary};
use fabrica_engine::volume::Volume;
use glam::DVec3;

use super::source::VolumeSource;
use super::template::{
    Background, CameraTemplate, Domain, ObjectTemplate, ProjectionName, QualityName, Reference, Template, VolumeSlot,
};

/// A volume that takes the place of a template's own.
#[derive(Clone, Debug)]
pub struct Replacement {
    /// Where it comes from.
    pub source: VolumeSource,
    /// How to read it.
    pub options: ReadOptions,
}

/// Loads the volume of each slot: the replacements in order, then what the template names (relative to `folder`).
///
/// # Errors
/// One sentence; more replacements than slots.
pub fn load_volumes(
    template: &Template,
    folder: &Path,
    replacements: &[Replacement],
    progress: &Progress,
) -> Result<Vec<Arc<Volume>>> {
    if replacements.len() > template.volumes.len() {
        bail!(
            "{} volumes are given and the template has {} slot{}; leave out the last ones",
            replacements.len(),
            template.volumes.len(),
            if template.volumes.len() == 1 { "" } else { "s" }
        );
    }
    template
        .volumes
        .iter()
        .enumerate()
        .map(|(i, slot)| {
            if let Some(r) = replacements.get(i) {
                return r.source.load(&r.options, progress);
            }
            load_slot(slot, folder, Limits::default(), progress)
        })
        .collect()
}

/// Loads what a template names in a slot (relative to `folder`), if it is within `limits` (none given: within what is free).
///
/// # Errors
/// One sentence.
pub fn load_slot(slot: &VolumeSlot, folder: &Path, limits: Limits, progress: &Progress) -> Result<Arc<Volume>> {
    VolumeSource::parse(&slot.file, folder)?
        .load(&ReadOptions { limits, ..slot.options()? }, progress)
        .with_context(|| format!("the template's volume \"{}\" cannot be loaded", slot.name))
}

/// The scene of a template with its volumes (one per slot), and what the user might want to know about how it came
/// about, a sentence each.
///
/// # Errors
/// One sentence: an unknown style, a number that makes no sense.
pub fn scene(
    template: &Template,
    volumes: &[Arc<Volume>],
    styles: &StyleLibrary,
    progress: &Progress,
) -> Result<(Scene, Vec<String>)> {
    let mut notes = Vec::new();
    let mut used: Vec<Arc<StyleImage>> = Vec::new();
    let mut objects = Vec::new();
    for object in &template.objects {
        let slot = template.volumes.iter().position(|v| v.name == object.volume);
        let volume = slot.and_then(|i| volumes.get(i)).context("a volume slot of the template is empty; fill it")?;
        objects.push(make_object(object, volume, styles, &mut used, &mut notes, progress)?);
    }
    let camera = camera(&template.camera, objects.first())?;
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
    make_object(template, volume, styles, &mut Vec::new(), &mut Vec::new(), progress)
}

fn make_object(
    template: &ObjectTemplate,
    volume: &Arc<Volume>,
    styles: &StyleLibrary,
    used: &mut Vec<Arc<StyleImage>>,
    notes: &mut Vec<String>,
    progress: &Progress,
) -> Result<Object> {
    let function = &template.transfer_function;
    let voxel_mm = volume.grid.spacing_mm().min_element();
    let value: Box<dyn Fn(f64) -> f64> = match function.domain {
        Domain::Data => Box::new(|at| at),
        Domain::Percentile => {
            let statistics = volume.statistics(progress)?;
            notes.push(format!(
                "percentiles of \"{}\" are of its finite voxels above the background, {:.6}",
                template.volume, statistics.background
            ));
            Box::new(|at| statistics.percentile_above_background(at))
        }
    };
    let mut nodes = Vec::with_capacity(function.nodes.len());
    for node in &function.nodes {
        let style = styles.get(&node.style)?;
        let position = used.iter().position(|s| Arc::ptr_eq(s, &style)).unwrap_or_else(|| {
            used.push(style);
            used.len() - 1
        });
        nodes.push(TransferFunctionNode { value: value(node.at), style: position, opacity: node.opacity });
    }
    Ok(Object {
        volume: volume.clone(),
        transfer_function: StyleTransferFunction {
            nodes,
            reference_length_mm: function.reference_length_mm.unwrap_or(voxel_mm),
        },
        regions: Vec::new(),
        gradient_scale_mm: template.gradient_scale_mm.unwrap_or(voxel_mm),
    })
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
