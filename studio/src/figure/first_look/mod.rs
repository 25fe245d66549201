//! The first picture of a volume that nobody has dressed yet: a template from what kind of data it is.

mod kind;
#[cfg(test)]
mod phantoms;

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use fabrica_engine::read::limits::Limits;
use fabrica_engine::read::{self, Numbers, ReadOptions};
use fabrica_engine::styles::StyleLibrary;
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::statistics::Statistics;
use fabrica_engine::{Error, Progress};
use glam::DVec3;
use serde_json::Map;

use self::kind::Kind;
pub use self::kind::is_ct;
use super::bridge;
use super::framing::{self, Frame, View};
use super::source::{VolumeSource, within_memory};
use super::template::{
    Background, CameraTemplate, Domain, LookTemplate, NodeTemplate, ObjectTemplate, Page, ProjectionName, QualityName,
    Reference, RegionTemplate, Template, TransferFunctionTemplate, VERSION, VolumeSlot,
};

/// Width of the page in mm: two columns of a journal.
const PAGE_WIDTH_MM: f64 = 173.0;

/// The page's height in mm, at least and at most.
const PAGE_HEIGHTS_MM: (f64, f64) = (60.0, 230.0);

/// Vertical field of view.
const FOV_DEG: f64 = 30.0;

/// The name of the slot of a first look's volume.
pub const SLOT: &str = "volume";

/// What people call a file: its name without folders and extensions; a specimen's own.
fn name(file: &str) -> String {
    let file = file.strip_prefix("specimen:").map_or(file, |s| s.split(['@', ',']).next().unwrap_or(s));
    let last = file.rsplit(['/', '\\']).find(|part| !part.is_empty()).unwrap_or(file);
    last.split('.').find(|part| !part.is_empty()).unwrap_or(last).to_owned()
}

/// A volume with its first look.
pub struct Opened {
    /// The figure, whose slot says how the volume was read.
    pub figure: Template,
    /// The volume; a label map in the colors of its structures.
    pub volume: Arc<Volume>,
    /// Why its numbers were taken for names of structures, where no file says that they are: a sentence.
    pub guess: Option<String>,
}

/// Reads what a slot names (relative to the current folder), if it is within `limits`, and gives it a first look. `numbers` says
/// what its numbers are taken for; without a word, label maps are read as the colors of their structures, those that say that
/// they are and those that look like it.
///
/// # Errors
/// One sentence from the reader.
pub fn open(mut slot: VolumeSlot, numbers: Option<Numbers>, limits: Limits, progress: &Progress) -> Result<Opened> {
    let source = VolumeSource::parse(&slot.file, Path::new(""))?;
    let options = ReadOptions { limits, ..slot.options()? };
    let read = |numbers| source.load(&ReadOptions { numbers, ..options.clone() }, progress);
    let numbers = if slot.labels { Some(Numbers::Structures) } else { numbers };
    let mut guess = None;
    let volume = match (&source, numbers) {
        (VolumeSource::Specimen(_), None) => read(Numbers::Values)?,
        (_, Some(numbers)) => read(numbers)?,
        (VolumeSource::Path(_), None) => {
            let volume = match read(Numbers::AsStated) {
                // Structures that cannot be read, or whose colors are too many, are drawn as numbers.
                Err(error) if is_about_the_volume(&error) => read(Numbers::Values)?,
                other => other?,
            };
            let why = if volume.colors.is_none() { taken_for_labels(&volume, progress)? } else { None };
            let structures = why.is_some().then(|| in_colors(&volume, &options, &read));
            match structures {
                Some(Ok(colors)) => {
                    guess = why;
                    colors
                }
                Some(Err(error)) if matches!(error.downcast_ref(), Some(Error::Cancelled)) => return Err(error),
                _ => volume,
            }
        }
    };
    slot.labels = !volume.labels.is_empty();
    if let VolumeSource::Path(path) = &source {
        name_the_folder(&mut slot, path, &volume, progress)?;
    }
    Ok(Opened { figure: first_look(&volume, slot, progress)?, volume, guess })
}

/// Whether another way of reading may help: not where somebody has to choose, or wants no more.
fn is_about_the_volume(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(Error::File { .. } | Error::TooLarge(_)))
}

/// The structures of a volume of numbers that is in memory; read once more where several voxels became one, as numbers have no
/// mean.
fn in_colors(
    volume: &Volume,
    options: &ReadOptions,
    read: &impl Fn(Numbers) -> Result<Arc<Volume>>,
) -> Result<Arc<Volume>> {
    if options.window.reduce != [1; 3] {
        return read(Numbers::Structures);
    }
    Ok(Arc::new(read::in_structures_colors(volume, &within_memory(options).limits)?))
}

/// Why the numbers of a volume are taken for names of structures, in a sentence, if they are: they look like it.
///
/// # Errors
/// [`Error::Cancelled`] on request.
pub fn taken_for_labels(volume: &Volume, progress: &Progress) -> Result<Option<String>> {
    let statistics = volume.statistics(progress)?;
    if Kind::of(volume, statistics) != Kind::Labels {
        return Ok(None);
    }
    Ok(Some(match kind::mask_value(volume, statistics) {
        Some(value) => format!("Taken for a mask, as its only values are {} and {value}.", statistics.min),
        None => "Taken for a label map, as its values look like numbers of structures.".to_owned(),
    }))
}

/// A slice that stands for its series is named by their folder: the names of slices are often identifiers of the scan, and one
/// slice that is missing shall not take the figure with it.
fn name_the_folder(slot: &mut VolumeSlot, path: &Path, volume: &Volume, progress: &Progress) -> Result<()> {
    let Some(folder) = path.parent().and_then(Path::to_str).filter(|f| !f.is_empty()) else { return Ok(()) };
    let is_slice = ["DICOM", "TIFF slices", "PNG slices"].contains(&volume.format.as_str());
    if !path.is_file() || !is_slice || slot.series.is_some() {
        return Ok(());
    }
    let Ok(entries) = read::survey(Path::new(folder), &ReadOptions::default(), progress) else { return Ok(()) };
    let mut same = entries.iter().filter(|e| {
        e.num_files > 1 && e.grid == volume.grid && e.title == volume.description && e.num_frames == volume.num_frames
    });
    if let (Some(series), None) = (same.next(), same.next()) {
        folder.clone_into(&mut slot.file);
        slot.series = (entries.len() > 1).then(|| series.key.clone());
    }
    Ok(())
}

/// What `volume`, which `slot` names, is dressed in by the kind of data that it is.
///
/// # Errors
/// [`fabrica_engine::Error::Cancelled`] on request.
pub fn look(volume: &Volume, slot: &VolumeSlot, progress: &Progress) -> Result<ObjectTemplate> {
    let statistics = volume.statistics(progress)?;
    let (kind, view) = (Kind::of(volume, statistics), View::of(&volume.grid));
    let object = Look::of(kind, view, volume, statistics).object(&slot.name);
    // A folder is seldom called after what is in it.
    let named = Some(volume.description.clone()).filter(|d| !d.is_empty()).unwrap_or_else(|| name(&slot.file));
    Ok(ObjectTemplate { name: named, ..object })
}

/// A template for `volume`, which `slot` names: a look by the kind of data, seen so that it fills the page.
///
/// # Errors
/// [`fabrica_engine::Error::Cancelled`] on request.
pub fn first_look(volume: &Arc<Volume>, slot: VolumeSlot, progress: &Progress) -> Result<Template> {
    let view = View::of(&volume.grid);
    let object = look(volume, &slot, progress)?;
    let mut template = Template {
        fabrica: VERSION,
        title: String::new(),
        volumes: vec![slot],
        selections: Vec::new(),
        objects: vec![object],
        camera: CameraTemplate {
            relative_to: Reference::Visible,
            from: rounded(view.from, 3),
            up: rounded(view.up, 3),
            projection: ProjectionName::Perspective,
            fov_deg: FOV_DEG,
            height: 2.0,
            target: [0.0; 3],
            extra: Default::default(),
        },
        background: Background::Color([255; 3]),
        theme: None,
        style_settings: Default::default(),
        figure: Page { width_mm: PAGE_WIDTH_MM, height_mm: PAGE_WIDTH_MM, dpi: 300.0, extra: Default::default() },
        quality: QualityName::Standard,
        extra: Default::default(),
    };
    fill_page(&mut template, view, volume, progress)?;
    Ok(template)
}

/// Sets camera and page so that what the template shows fills the page.
fn fill_page(template: &mut Template, view: View, volume: &Arc<Volume>, progress: &Progress) -> Result<()> {
    let object = bridge::object(&template.objects[0], volume, &StyleLibrary::embedded(), progress)?;
    let (center, radius) = bridge::sphere(Reference::Visible, &object);
    let (lowest, highest) = PAGE_HEIGHTS_MM;
    let aspects = (PAGE_WIDTH_MM / highest, PAGE_WIDTH_MM / lowest);
    // Interpolation reaches from a voxel to its neighbors.
    let reach = volume.grid.spacing_mm().max_element();
    let frame = Frame::around(&framing::outline(&object), reach, view, FOV_DEG, aspects);
    template.camera.height = round(frame.height_mm / radius, 3);
    template.camera.target = rounded((frame.target_mm - center) / radius, 3);
    template.figure.height_mm = round(PAGE_WIDTH_MM / frame.aspect, 1);
    Ok(())
}

/// Value or percentile, style, opacity of a voxel.
type Node = (f64, &'static str, f64);

/// How a kind of data is dressed.
struct Look {
    domain: Domain,
    nodes: Vec<Node>,
    gradient_scale_mm: Option<f64>,
}

impl Look {
    /// In HU.
    fn ct(nodes: Vec<Node>) -> Self {
        Self { domain: Domain::Data, nodes, gradient_scale_mm: None }
    }

    /// In percentiles of what is above the background and brighter than what is left around a body that was cut out.
    fn percentiles(nodes: &[Node], statistics: &Statistics) -> Self {
        let first = kind::filler(statistics).map_or(0.0, |v| statistics.percentile_rank_above_background(v));
        let at = |percentile: f64| round(first + percentile * (100.0 - first) / 100.0, 2);
        let nodes = nodes.iter().map(|&(percentile, style, opacity)| (at(percentile), style, opacity)).collect();
        Self { domain: Domain::Percentile, nodes, gradient_scale_mm: None }
    }

    fn of(kind: Kind, view: View, volume: &Volume, statistics: &Statistics) -> Self {
        match kind {
            Kind::Ct { .. } if view.is_of_sheet => Self::ct(CT_SHEET.to_vec()),
            Kind::Body | Kind::Organ | Kind::OneMaterial | Kind::TwoMaterials { .. } if view.is_of_sheet => {
                Self::tones(statistics)
            }
            // A white cast leaves colors as they are.
            Kind::CutOut => Self {
                domain: Domain::Data,
                nodes: vec![(0.0, "plaster", 1.0)],
                // Most come from numbers of structures: what shades them is smoothed more than an image is.
                gradient_scale_mm: Some(2.0 * volume.grid.spacing_mm().min_element()),
            },
            Kind::Colors => {
                // Otsu's threshold lies among the colors: of these, the dark ones are far above what is black.
                let (dark, seen) = (0.1 * statistics.background, 0.5 * statistics.background);
                let filler = kind::filler(statistics).filter(|value| *value < statistics.background);
                let dark = filler.map_or(dark, |value| dark.max(value));
                let seen = seen.max(2.0 * dark);
                let nodes = vec![(round(dark, 5), "plaster", 0.0), (round(seen, 5), "plaster", 0.9)];
                Self { domain: Domain::Data, nodes, gradient_scale_mm: None }
            }
            Kind::Constant => Self::percentiles(&[(0.0, "clay", 0.9)], statistics),
            Kind::Ct { contrast } => Self::ct(ct_nodes(contrast)),
            Kind::Labels => {
                // Half way to the lowest number, where the edge of a mask lies. Otsu's background would take some with it.
                let after_lowest =
                    statistics.percentile_rank(statistics.min) + 50.0 / statistics.num_finite.max(1) as f64;
                let edge = 0.5 * (statistics.min + statistics.percentile(after_lowest));
                Self {
                    domain: Domain::Data,
                    nodes: vec![(edge, "plaster", 0.0), (edge, "plaster", 1.0)],
                    // Numbers jump at every border: what shades them is smoothed a little more than an image is.
                    gradient_scale_mm: Some(1.5 * volume.grid.spacing_mm().min_element()),
                }
            }
            Kind::Body => Self::percentiles(&[(0.0, "skin", 0.0), (10.0, "skin", 0.9)], statistics),
            Kind::Organ => Self::percentiles(&[(2.0, "brain", 0.0), (15.0, "brain", 0.9)], statistics),
            Kind::OneMaterial => Self::percentiles(&[(0.0, "clay", 0.0), (20.0, "clay", 0.9)], statistics),
            Kind::TwoMaterials { valley } => {
                let valley = statistics.percentile_rank_above_background(valley);
                // The first material's partial volumes make its skin; its inside is left out.
                Self {
                    domain: Domain::Percentile,
                    nodes: vec![
                        (0.0, "clay", 0.0),
                        (round(0.08 * valley, 2), "clay", 0.25),
                        (round(0.2 * valley, 2), "clay", 0.25),
                        (round(0.3 * valley, 2), "clay", 0.0),
                        (round(valley, 2), "brass", 0.0),
                        (round(valley + 0.3 * (100.0 - valley), 2), "brass", 0.95),
                    ],
                    gradient_scale_mm: None,
                }
            }
        }
    }

    /// From dark to bright, for slices that are seen face-on: there is no surface to see.
    fn tones(statistics: &Statistics) -> Self {
        // Of all voxels: where one tissue is much brighter than the rest, the others lie below the background's threshold.
        let tones = [
            (55.0, "clay", 0.0),
            (68.0, "clay", 0.6),
            (75.0, "clay", 0.95),
            (88.0, "plaster", 0.95),
            (99.0, "porcelain", 1.0),
        ];
        let nodes = tones.map(|(percentile, style, opacity)| (statistics.percentile(percentile), style, opacity));
        Self { domain: Domain::Data, nodes: nodes.to_vec(), gradient_scale_mm: None }
    }

    /// The object of a template.
    fn object(&self, volume: &str) -> ObjectTemplate {
        let node = |&(at, style, opacity): &Node| NodeTemplate {
            at,
            style: style.to_owned(),
            opacity,
            extra: Default::default(),
        };
        ObjectTemplate {
            name: String::new(),
            visible: true,
            volume: volume.to_owned(),
            regions: Vec::new(),
            rest: Default::default(),
            parts: Default::default(),
            shading: Default::default(),
            lighting: None,
            transfer_function: TransferFunctionTemplate {
                domain: self.domain,
                // A voxel: so a film, which is as thick as the scanner's blur, is as dense at every resolution.
                reference_length_mm: None,
                nodes: self.nodes.iter().map(node).collect(),
                across: None,
                extra: Default::default(),
            },
            gradient_scale_mm: self.gradient_scale_mm,
            extra: Default::default(),
        }
    }
}

/// What a CT's cut face is made of, in HU.
const CT_SHEET: [Node; 7] = [
    (-500.0, "skin", 0.0),
    (-200.0, "fat", 0.95),
    (-60.0, "fat", 0.95),
    (20.0, "muscle", 0.95),
    (90.0, "organ", 0.95),
    (220.0, "bone", 0.95),
    (1500.0, "porcelain", 1.0),
];

/// Bone, or blood with contrast medium and bone, under the outline of the skin; in HU.
fn ct_nodes(contrast: Option<f64>) -> Vec<Node> {
    // Dense where the ray grazes it, so that skin and lungs are drawn by their contours and a table is hardly seen; with a
    // tint of skin beneath.
    let mut nodes = vec![
        (-450.0, "smoke", 0.0),
        (-330.0, "smoke", 0.5),
        (-250.0, "smoke", 0.5),
        (-200.0, "skin", 0.1),
        (-160.0, "skin", 0.1),
        (-140.0, "skin", 0.0),
    ];
    match contrast {
        None => nodes.extend([(150.0, "bone", 0.0), (250.0, "bone", 0.6), (350.0, "bone", 0.95)]),
        // Ribs are as dense as this blood: only what is denser is bone for sure.
        Some(blood) => nodes.extend([
            (round(0.5 * blood, 0), "vessel", 0.0),
            (round(0.75 * blood, 0), "vessel", 0.8),
            (round(1.3 * blood, 0), "vessel", 0.95),
            (round(1.5 * blood, 0), "bone", 0.95),
        ]),
    }
    // Teeth, then metal.
    nodes.extend([(1500.0, "porcelain", 1.0), (2600.0, "porcelain", 1.0), (3000.0, "steel", 1.0)]);
    nodes
}

fn round(value: f64, digits: i32) -> f64 {
    let factor = 10_f64.powi(digits);
    (value * factor).round() / factor
}

fn rounded(v: DVec3, digits: i32) -> [f64; 3] {
    // Plus 0: no "-0.0" in the file.
    v.to_array().map(|x| round(x, digits) + 0.0)
}

/// A region with all structures in the slot `selection` of a volume: each solid within its borders, in its own color. What they
/// measure does not matter, as what a structure is has been decided already.
pub fn of_selections(selection: &str, volume: &Volume) -> RegionTemplate {
    let transfer_function = TransferFunctionTemplate {
        domain: Domain::Data,
        reference_length_mm: Some(volume.grid.spacing_mm().min_element()),
        nodes: vec![NodeTemplate { at: 0.0, style: "plaster".to_owned(), opacity: 0.9, extra: Map::new() }],
        across: None,
        extra: Map::new(),
    };
    let look = LookTemplate { transfer_function: Some(transfer_function), ..LookTemplate::default() };
    RegionTemplate { look, ..RegionTemplate::of(selection, None) }
}

#[cfg(test)]
mod tests {
    use fabrica_engine::scene::Scene;
    use fabrica_engine::spaces::Grid;
    use fabrica_engine::volume::{Modality, Rescale, Voxels};
    use glam::DAffine3;

    use super::*;
    use crate::figure::sources::Sources;

    fn look_of(volume: &Arc<Volume>) -> Template {
        let template = first_look(volume, VolumeSlot::new(SLOT, "a \"b\".nii".to_owned()), &Progress::new()).unwrap();
        // What is written can be read.
        Template::parse(&template.to_json().unwrap()).unwrap()
    }

    fn scene_of(template: &Template, volume: &Arc<Volume>) -> Scene {
        bridge::scene(template, &Sources::of(vec![volume.clone()]), &StyleLibrary::embedded(), &Progress::new())
            .unwrap()
            .0
    }

    fn styles(template: &Template) -> Vec<&str> {
        template.objects[0].transfer_function.nodes.iter().map(|n| n.style.as_str()).collect()
    }

    /// The picture's coordinates (-1 to 1 on either axis) of the extremes of the voxels above `edge`: left, bottom, right, top.
    fn extent(template: &Template, volume: &Arc<Volume>, edge: f64) -> [f64; 4] {
        let camera = scene_of(template, volume).camera;
        let aspect = template.figure.width_mm / template.figure.height_mm;
        let [nx, ny, nz] = volume.grid.dims();
        let mut extent = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for (x, y, z) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (x, y, z)))) {
            if volume.value(x, y, z) <= edge {
                continue;
            }
            let voxel = DVec3::new(x as f64, y as f64, z as f64);
            let p = volume.grid.world_from_index().transform_point3(voxel) - camera.eye_mm;
            let scale = camera.half_height() * p.dot(camera.forward);
            let at = [p.dot(camera.right) / scale / aspect, p.dot(camera.up) / scale];
            for i in 0..2 {
                extent[i] = extent[i].min(at[i]);
                extent[i + 2] = extent[i + 2].max(at[i]);
            }
        }
        extent
    }

    #[test]
    fn every_kind_of_data_gets_its_look() {
        for (name, volume, domain, style) in [
            ("ct", phantoms::ct(Modality::Unknown), Domain::Data, "bone"),
            ("stated ct", phantoms::ct(Modality::Ct), Domain::Data, "bone"),
            ("contrast", phantoms::contrast(), Domain::Data, "vessel"),
            ("organ", phantoms::organ(), Domain::Percentile, "brain"),
            ("body", phantoms::body(Modality::Unknown), Domain::Percentile, "skin"),
            ("stated mr", phantoms::body(Modality::Mr), Domain::Percentile, "skin"),
            ("casting", phantoms::casting(), Domain::Percentile, "clay"),
            ("inlay", phantoms::inlay(), Domain::Percentile, "brass"),
            ("labels", phantoms::labels(), Domain::Data, "plaster"),
            ("mask", phantoms::mask(), Domain::Data, "plaster"),
            ("photograph", phantoms::photograph(), Domain::Data, "plaster"),
            ("atlas", phantoms::atlas(), Domain::Data, "plaster"),
        ] {
            let figure = look_of(&volume);
            assert_eq!(figure.objects[0].transfer_function.domain, domain, "{name}");
            assert!(styles(&figure).contains(&style), "{name}: {:?}", styles(&figure));
            assert_eq!(styles(&figure).contains(&"vessel"), name == "contrast", "{name}");
            assert_eq!(figure.volumes[0].file, "a \"b\".nii");
            assert!(!scene_of(&figure, &volume).objects[0].shows_nothing(), "{name}");
        }
    }

    #[test]
    fn every_structure_of_a_label_map_is_solid() {
        let volume = phantoms::labels();
        let statistics = volume.statistics(&Progress::new()).unwrap();
        let [nx, ny, nz] = volume.grid.dims();
        let values = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        let lowest = values.map(|[x, y, z]| volume.value(x, y, z)).filter(|v| *v > 0.0).fold(f64::INFINITY, f64::min);
        assert!(lowest < statistics.background, "Otsu's threshold takes structures for background");
        let scene = scene_of(&look_of(&volume), &volume);
        let function = &scene.objects[0].transfer_function;
        assert_eq!([0.0, lowest, statistics.max].map(|v| function.max_opacity(v, v)), [0.0, 1.0, 1.0]);
    }

    #[test]
    fn colors_are_cut_out_of_the_dark_or_by_their_alpha() {
        let shown = |volume: &Arc<Volume>, at: [usize; 3]| {
            let value = volume.value(at[0], at[1], at[2]);
            scene_of(&look_of(volume), volume).objects[0].transfer_function.max_opacity(value, value)
        };
        let photograph = phantoms::photograph();
        assert_eq!(shown(&photograph, [0; 3]), 0.0);
        assert!(shown(&photograph, [16; 3]) > 0.2 && shown(&photograph, [26, 16, 16]) == 0.9);
        assert_eq!(shown(&phantoms::atlas(), [10, 16, 16]), 1.0, "black is a color");
        // What is transparent takes no room on the page.
        let figure = look_of(&phantoms::atlas());
        assert!(scene_of(&figure, &phantoms::atlas()).camera.half_height() > 0.0);
        assert!(figure.camera.height < 3.0, "{}", figure.camera.height);
    }

    #[test]
    fn what_is_seen_fills_the_page_and_is_not_cut_off() {
        for (name, volume, edge) in [
            ("ct", phantoms::ct(Modality::Unknown), -500.0),
            ("organ", phantoms::organ(), 300.0),
            ("body", phantoms::body(Modality::Mr), 300.0),
            ("labels", phantoms::labels(), 0.5),
            ("rod", phantoms::rod([200, 12, 12]), 70.0),
            ("column", phantoms::rod([12, 12, 200]), 70.0),
            ("sheet", phantoms::rod([90, 70, 3]), 70.0),
        ] {
            let figure = look_of(&volume);
            let [left, bottom, right, top] = extent(&figure, &volume, edge);
            assert!(
                left.min(bottom) > -1.0 && right.max(top) < 1.0,
                "{name} is cut off: {left} {bottom} {right} {top}"
            );
            let filled = (right - left).max(top - bottom) / 2.0;
            assert!(filled > 0.8, "{name} fills {filled}");
            assert!((left + right).abs() < 0.1 && (bottom + top).abs() < 0.1, "{name} is not in the middle");
            assert!((60.0..=230.0).contains(&figure.figure.height_mm), "{name}: {} mm", figure.figure.height_mm);
        }
        assert!(look_of(&phantoms::rod([12, 12, 200])).figure.height_mm > 200.0, "a column has a tall page");
    }

    #[test]
    fn fitting_finds_the_same_frame_again_from_any_other() {
        for volume in [phantoms::ct(Modality::Unknown), phantoms::casting()] {
            let figure = look_of(&volume);
            let lost = CameraTemplate { height: 0.3, target: [0.5, -1.0, 0.2], ..figure.camera.clone() };
            let object = scene_of(&figure, &volume).objects.remove(0);
            let found = framing::fit(&lost, &figure.figure, &object, &object);
            let apart = DVec3::from_array(found.target).distance(DVec3::from_array(figure.camera.target));
            assert!((found.height - figure.camera.height).abs() < 0.01 && apart < 0.01, "{found:?}");
            // From far away, parallel lines frame a little less.
            let parallel = CameraTemplate { projection: ProjectionName::Orthographic, ..lost };
            let parallel = framing::fit(&parallel, &figure.figure, &object, &object);
            assert!((0.7..1.0).contains(&(parallel.height / found.height)), "{parallel:?}");
        }
    }

    #[test]
    fn a_sheet_is_seen_face_on_and_upright() {
        let sagittal = DAffine3::from_cols_array(&[0., 1., 0., 0., 0., 1., 1., 0., 0., 0., 0., 0.]);
        for (affine, from, up) in [
            (DAffine3::IDENTITY, [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]),
            (sagittal, [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            (DAffine3::from_rotation_x(std::f64::consts::FRAC_PI_2), [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
        ] {
            let figure = look_of(&phantoms::slice(affine));
            assert_eq!((figure.camera.from, figure.camera.up), (from, up));
            assert!(styles(&figure).contains(&"porcelain"), "a slice is seen by its tones");
        }
        assert!(look_of(&phantoms::organ()).camera.from[2] > 0.3, "a body is seen from above");
    }

    #[test]
    fn volumes_without_anything_have_a_look_all_the_same() {
        let grid = Grid::new([4, 3, 2], DAffine3::IDENTITY).unwrap();
        for value in [0.0, -3.0, f32::NAN, f32::INFINITY] {
            let volume = Volume::new(grid, Voxels::F32(vec![value; 24]), Rescale::IDENTITY, "NIfTI-1").unwrap();
            let volume = Arc::new(volume);
            scene_of(&look_of(&volume), &volume);
        }
        let half = Voxels::F32((0..24).map(|i| if i < 12 { f32::NAN } else { 1e30 * i as f32 }).collect());
        let volume = Arc::new(Volume::new(grid, half, Rescale::IDENTITY, "test").unwrap());
        assert!(!scene_of(&look_of(&volume), &volume).objects[0].shows_nothing());
    }

    #[test]
    fn what_is_left_around_a_body_is_not_seen() {
        // Zeros around values of both signs: Otsu's threshold lies below them.
        let volume = phantoms::signed();
        let figure = look_of(&volume);
        let scene = scene_of(&figure, &volume);
        assert_eq!(scene.objects[0].transfer_function.max_opacity(-0.01, 0.0), 0.0);
        assert!(!scene.objects[0].shows_nothing());
    }
}
