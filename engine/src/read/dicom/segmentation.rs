//! Segmentations (SEG): binary, fractional and label map, as label maps with names, colors and codes.
//!
//! A frame is one slice of one structure, and only slices with something in them need to be there: the grid spans the places
//! that occur. Structures that overlap go to different layers, each to the first in which it has room.

use std::collections::{BTreeMap, HashMap};

use dicom_dictionary_std::tags;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::elements::{Charset, Elements};
use super::file::DicomFile;
use super::frames::Frames;
use super::geometry::{Arranged, ras, unplaced};
use super::image::Image;
use super::series::{Stack, segmentation_stack};
use super::slices::{Slice, slices_of};
use crate::color::srgb8_from_linear;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::read::label_table::code_of;
use crate::read::stream::reserve;
use crate::read::window::Window;
use crate::read::{Entry, grid_of, window_labels};
use crate::spaces::Grid;
use crate::volume::labels::{Label, LabelMap, distinct_color};
use crate::volume::{Modality, Orientation};

/// Empty slices there may be for each that is not.
const MAX_SPARSENESS: f64 = 200.0;

/// Layers beyond which a file is no segmentation of anything.
const MAX_LAYERS: usize = 64;

/// A place off the even stack, as a share of the spacing, that is rounding.
const ROUNDING: f64 = 0.1;

const REMEDY: &str = "export it again from the program it came from";

/// The segmentation as it shows in a list.
///
/// # Errors
/// One sentence if its frames make no stack.
pub fn stack_of(index: usize, file: &DicomFile, image: &Image) -> Result<Stack> {
    let layout = Layout::of(file, image)?;
    let is_narrow = layout.labels.iter().all(|l| l.id < 256);
    let entry = Entry {
        key: String::new(),
        title: image.description.clone(),
        format: "DICOM segmentation".to_owned(),
        modality: Modality::Unknown,
        grid: layout.grid,
        orientation: layout.orientation.clone(),
        type_name: if is_narrow { "uint8" } else { "uint16" },
        bytes_per_voxel: if is_narrow { 1 } else { 2 },
        num_frames: 1,
        num_files: 1,
        is_labels: true,
        is_localizer: false,
    };
    let world_from_index = layout.grid.world_from_index();
    let slices = Arranged {
        frames: Vec::new(),
        planes: Vec::new(),
        world_from_index,
        orientation: layout.orientation,
        warnings: Vec::new(),
    };
    Ok(segmentation_stack(index, image, entry, slices))
}

/// The layers of a segmentation, those voxels of them that the window takes.
///
/// # Errors
/// One sentence if frames are damaged or missing, or there is not enough memory.
pub fn layers(file: &DicomFile, window: Window, progress: &Progress) -> Result<Vec<LabelMap>> {
    let image = Image::of(file)?;
    let layout = Layout::of(file, &image)?;
    let frames = Frames::new(file, image.format, image.num_frames);
    progress.begin("reading", image.num_frames as u64);
    let full = if layout.kind == Kind::LabelMap {
        vec![layout.label_map(file, &frames, progress)?]
    } else {
        layout.segments(file, &frames, progress)?
    };
    full.into_iter().map(|map| window_labels(&file.path, map, window)).collect()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Binary,
    /// Above this a voxel belongs to the structure.
    Fractional(u32),
    LabelMap,
}

/// Where the frames of a segmentation belong.
struct Layout {
    grid: Grid,
    orientation: Orientation,
    kind: Kind,
    /// Of every frame the slice of the grid.
    planes: Vec<usize>,
    /// Of every frame the number of the structure.
    segments: Vec<u32>,
    /// The structures that the file describes, by number.
    labels: Vec<Label>,
}

impl Layout {
    fn of(file: &DicomFile, image: &Image) -> Result<Self> {
        let e = &file.elements;
        let kind = match e.word(tags::SEGMENTATION_TYPE).as_deref() {
            Some("LABELMAP") => Kind::LabelMap,
            Some("FRACTIONAL") => {
                let max = e.count(tags::MAXIMUM_FRACTIONAL_VALUE).unwrap_or(255);
                Kind::Fractional(u32::try_from(max).unwrap_or(255).div_ceil(2).max(1))
            }
            _ => Kind::Binary,
        };
        let per_frame = e.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE);
        let shared = e.item(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE);
        let segments: Vec<u32> = (0..image.num_frames)
            .map(|frame| {
                let item = [per_frame.get(frame), shared]
                    .into_iter()
                    .flatten()
                    .find_map(|groups| groups.item(tags::SEGMENT_IDENTIFICATION_SEQUENCE));
                let number = item.and_then(|item| item.count(tags::REFERENCED_SEGMENT_NUMBER));
                number.and_then(|n| u32::try_from(n).ok()).unwrap_or(1)
            })
            .collect();
        let slices = slices_of(0, file, image)?;
        let (planes, num_planes, world_from_index) = places(file, &slices, &segments)?;
        let dims = [image.format.columns, image.format.rows, num_planes].map(|n| n as u64);
        let grid = grid_of(&file.path, dims, world_from_index)?;
        let is_placed = slices.iter().all(|s| s.position.is_some() && s.axes.is_some());
        let orientation = if is_placed { Orientation::Stated } else { unplaced() };
        Ok(Self { grid, orientation, kind, planes, segments, labels: labels(file) })
    }

    /// The structure of a number; one that the file does not describe is called by it.
    fn label(&self, number: u32) -> Label {
        let known = self.labels.iter().find(|l| l.id == number).cloned();
        known.unwrap_or_else(|| Label {
            id: number,
            name: number.to_string(),
            color: distinct_color(number),
            code: None,
        })
    }

    fn background() -> Label {
        Label { id: 0, name: "background".to_owned(), color: [0; 3], code: None }
    }

    fn empty_layer(&self, file: &DicomFile) -> Result<Vec<u16>> {
        let mut voxels = Vec::new();
        reserve(&mut voxels, self.grid.num_voxels(), &file.path)?;
        voxels.resize(self.grid.num_voxels(), 0);
        Ok(voxels)
    }

    /// Frames whose numbers are those of structures.
    fn label_map(&self, file: &DicomFile, frames: &Frames, progress: &Progress) -> Result<LabelMap> {
        let mut voxels = self.empty_layer(file)?;
        let mut labels = vec![Self::background()];
        let mut position_of = HashMap::from([(0_u32, 0_u16)]);
        for label in self.labels.iter().filter(|l| l.id != 0) {
            position_of.insert(label.id, labels.len() as u16);
            labels.push(label.clone());
        }
        let n = self.grid.dims()[0] * self.grid.dims()[1];
        for (frame, plane) in self.planes.iter().enumerate() {
            progress.advance(1)?;
            let decoded = frames.decode(frame)?.bytes;
            let is_wide = decoded.len() == 2 * n;
            let number = |i: usize| match (is_wide, &decoded[..]) {
                (true, bytes) => u32::from(u16::from_ne_bytes([bytes[2 * i], bytes[2 * i + 1]])),
                (false, bytes) => bytes.get(i).map_or(0, |b| u32::from(*b)),
            };
            for (i, to) in voxels[plane * n..][..n].iter_mut().enumerate() {
                let id = number(i);
                *to = *position_of.entry(id).or_insert_with(|| {
                    labels.push(self.label(id));
                    (labels.len() - 1) as u16
                });
            }
        }
        Ok(LabelMap { grid: self.grid, voxels, labels, notes: Vec::new() })
    }

    /// Frames that belong to one structure each.
    fn segments(&self, file: &DicomFile, frames: &Frames, progress: &Progress) -> Result<Vec<LabelMap>> {
        let n = self.grid.dims()[0] * self.grid.dims()[1];
        let mut frames_of: BTreeMap<u32, Vec<usize>> = self.labels.iter().map(|l| (l.id, Vec::new())).collect();
        for (frame, segment) in self.segments.iter().enumerate() {
            frames_of.entry(*segment).or_default().push(frame);
        }
        frames_of.remove(&0);
        if frames_of.len() >= usize::from(u16::MAX) {
            return Err(Error::file(&file.path, "it has more structures than a label map can tell apart", REMEDY));
        }
        let threshold = match self.kind {
            Kind::Fractional(half) => half,
            _ => 1,
        };
        let mut layers: Vec<(Vec<u16>, Vec<Label>)> = vec![(self.empty_layer(file)?, vec![Self::background()])];
        for (segment, numbers) in frames_of {
            let masks: Vec<(usize, Vec<u8>)> = numbers
                .par_iter()
                .map(|&frame| {
                    progress.advance(1)?;
                    Ok((self.planes[frame], frames.decode(frame)?.bytes))
                })
                .collect::<Result<_>>()?;
            let inside = |mask: &[u8], i: usize| mask.get(i).is_some_and(|v| u32::from(*v) >= threshold);
            let has_room = |voxels: &[u16]| {
                masks.iter().all(|(plane, mask)| {
                    voxels[plane * n..][..n].iter().enumerate().all(|(i, v)| *v == 0 || !inside(mask, i))
                })
            };
            let layer = match layers.iter().position(|(voxels, _)| has_room(voxels)) {
                Some(layer) => layer,
                None if layers.len() == MAX_LAYERS => {
                    let what = format!("more than {MAX_LAYERS} of its structures overlap at one place");
                    return Err(Error::file(&file.path, what, "save them in several files"));
                }
                None => {
                    layers.push((self.empty_layer(file)?, vec![Self::background()]));
                    layers.len() - 1
                }
            };
            let (voxels, labels) = &mut layers[layer];
            let position = labels.len() as u16;
            labels.push(self.label(segment));
            for (plane, mask) in &masks {
                for (i, v) in voxels[plane * n..][..n].iter_mut().enumerate() {
                    if inside(mask, i) {
                        *v = position;
                    }
                }
            }
        }
        Ok(layers
            .into_iter()
            .map(|(voxels, labels)| LabelMap { grid: self.grid, voxels, labels, notes: Vec::new() })
            .collect())
    }
}

/// Of every frame its slice of the grid, the number of slices, and where they lie.
fn places(file: &DicomFile, slices: &[Slice], segments: &[u32]) -> Result<(Vec<usize>, usize, DAffine3)> {
    let fault = |what: String| Error::file(&file.path, what, REMEDY);
    let Some(first) = slices.first() else { return Err(fault("it has no frames".to_owned())) };
    let [row, column] = first.axes.unwrap_or([DVec3::X, DVec3::Y]);
    let [dx, dy] = first.spacing.unwrap_or([1.0; 2]);
    let normal = row.cross(column).normalize();
    let stated = first.stated_step;
    let is_placed = slices.iter().all(|s| s.position.is_some());
    if !is_placed {
        // Slices of one structure follow each other.
        let mut count_of: HashMap<u32, usize> = HashMap::new();
        let next = |segment: &u32| {
            let count = count_of.entry(*segment).or_default();
            *count += 1;
            *count - 1
        };
        let planes: Vec<usize> = segments.iter().map(next).collect();
        let num_planes = planes.iter().max().map_or(1, |m| m + 1);
        let step = stated.unwrap_or(f64::midpoint(dx, dy));
        return Ok((planes, num_planes, ras(row * dx, column * dy, normal * step, DVec3::ZERO)));
    }
    let is_same = |a: [DVec3; 2]| (a[0] - row).length() < 0.01 && (a[1] - column).length() < 0.01;
    if slices.iter().any(|s| s.axes.is_some_and(|a| !is_same(a))) {
        return Err(fault("its frames lie in several directions".to_owned()));
    }
    let positions: Vec<DVec3> = slices.iter().filter_map(|s| s.position).collect();
    let at: Vec<f64> = positions.iter().map(|p| p.dot(normal)).collect();
    let mut sorted = at.clone();
    sorted.sort_by(f64::total_cmp);
    let same = 0.01 * dx.min(dy);
    sorted.dedup_by(|b, a| *b - *a <= same);
    let (low, length) = (sorted[0], sorted[sorted.len() - 1] - sorted[0]);
    let gap = sorted.windows(2).map(|p| p[1] - p[0]).reduce(f64::min);
    let is_even = |step: f64| {
        let number = (length / step).round().max(1.0);
        // The step as the ends have it: the stated one may be rounded.
        let step = if length > 0.0 { length / number } else { step };
        sorted.iter().all(|p| ((p - low) / step - ((p - low) / step).round()).abs() <= ROUNDING).then_some(step)
    };
    // Files state the distance of slices or their thickness; the least gap decides where neither fits.
    let candidates = [stated, gap, gap.map(|g| g / 2.0)];
    let step = candidates.into_iter().flatten().filter(|s| gap.is_none_or(|g| *s <= g * 1.1)).find_map(is_even);
    let step = match (step, gap) {
        (Some(step), _) => step,
        (None, None) => stated.unwrap_or(f64::midpoint(dx, dy)),
        (None, Some(_)) => return Err(fault("its slices lie unevenly".to_owned())),
    };
    let num_planes = (length / step).round() + 1.0;
    if num_planes > MAX_SPARSENESS * sorted.len() as f64 {
        return Err(fault(format!("its {} slices are spread over {length:.0} mm", sorted.len())));
    }
    let ends = |p: f64| at.iter().position(|a| (a - p).abs() <= same).map(|i| positions[i]);
    let origin = ends(low).unwrap_or(positions[0]);
    let lean = match ends(low + length) {
        Some(end) if length > 0.0 => (end - origin) / length,
        _ => normal,
    };
    let planes = at.iter().map(|p| ((p - low) / step).round() as usize).collect();
    Ok((planes, num_planes as usize, ras(row * dx, column * dy, lean * step, origin)))
}

/// The structures that the file describes.
fn labels(file: &DicomFile) -> Vec<Label> {
    let e = &file.elements;
    let charset = Charset::of(e);
    let mut labels: Vec<Label> = e
        .items(tags::SEGMENT_SEQUENCE)
        .iter()
        .filter_map(|item| {
            let id = u32::try_from(item.count(tags::SEGMENT_NUMBER)?).ok().filter(|id| *id <= u32::from(u16::MAX))?;
            let name = item.text(tags::SEGMENT_LABEL, &charset).unwrap_or_else(|| id.to_string());
            let color = match item.numbers(tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE)[..] {
                [l, a, b] => srgb_from_lab(l, a, b),
                _ => distinct_color(id),
            };
            let kind = item.item(tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE);
            // Which side it is on, for one.
            let modifier = kind.and_then(|kind| kind.item(tags::SEGMENTED_PROPERTY_TYPE_MODIFIER_CODE_SEQUENCE));
            let concept = |code: Option<&Elements>| {
                let code = code?;
                let value = code.word(tags::CODE_VALUE).or_else(|| code.word(tags::LONG_CODE_VALUE))?;
                Some((code.word(tags::CODING_SCHEME_DESIGNATOR)?, value))
            };
            let words = [concept(kind), concept(modifier)].map(Option::unwrap_or_default);
            let [kind, modifier] = words.each_ref().map(|(scheme, value)| (scheme.as_str(), value.as_str()));
            let code = code_of(kind, modifier);
            Some(Label { id, name, color, code })
        })
        .collect();
    labels.sort_by_key(|l| l.id);
    labels.dedup_by_key(|l| l.id);
    labels
}

/// CIELab (white D50) in DICOM's 16-bit codes as sRGB.
fn srgb_from_lab(l: f64, a: f64, b: f64) -> [u8; 3] {
    const WHITE: DVec3 = DVec3::new(0.9642, 1.0, 0.8249);
    /// Columns: what X, Y and Z of D50 contribute to linear sRGB, adapted to D65 (Bradford).
    const COLUMNS: [DVec3; 3] = [
        DVec3::new(3.133_856_1, -0.978_768_4, 0.071_945_3),
        DVec3::new(-1.616_866_7, 1.916_141_5, -0.228_991_4),
        DVec3::new(-0.490_614_6, 0.033_454, 1.405_242_7),
    ];
    let (l, a, b) = (l / 65_535.0 * 100.0, a / 65_535.0 * 255.0 - 128.0, b / 65_535.0 * 255.0 - 128.0);
    let y = (l + 16.0) / 116.0;
    let f = |t: f64| if t > 6.0 / 29.0 { t.powi(3) } else { 3.0 * (6.0_f64 / 29.0).powi(2) * (t - 4.0 / 29.0) };
    let xyz = WHITE * DVec3::new(f(y + a / 500.0), f(y), f(y - b / 200.0));
    let rgb = COLUMNS[0] * xyz.x + COLUMNS[1] * xyz.y + COLUMNS[2] * xyz.z;
    rgb.to_array().map(|v| srgb8_from_linear(v.clamp(0.0, 1.0) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lab_codes_are_the_colors_that_they_mean() {
        let codes = |l: f64, a: f64, b: f64| {
            [l / 100.0 * 65_535.0, (a + 128.0) / 255.0 * 65_535.0, (b + 128.0) / 255.0 * 65_535.0]
        };
        // sRGB white, black, middle gray and red as CIELab under D50 (Lindbloom).
        for (lab, rgb) in [
            ([100.0, 0.0, 0.0], [255, 255, 255]),
            ([0.0, 0.0, 0.0], [0, 0, 0]),
            ([53.585, 0.0, 0.0], [128, 128, 128]),
            ([54.29, 80.81, 69.89], [255, 0, 0]),
        ] {
            let [l, a, b] = codes(lab[0], lab[1], lab[2]);
            let got = srgb_from_lab(l, a, b);
            assert!((0..3).all(|i| got[i].abs_diff(rgb[i]) <= 1), "{got:?} for {rgb:?}");
        }
    }
}
