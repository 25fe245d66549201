//! The frames of a file: for each where it lies, what its numbers mean and what tells it from others at the same place.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use glam::DVec3;

use super::elements::Elements;
use super::file::{DicomFile, PixelKind};
use super::image::{Image, PixelFormat};
use crate::error::{Error, Result};
use crate::volume::Rescale;

/// One frame of a file.
#[derive(Clone, Debug)]
pub struct Slice {
    /// Number of its file.
    pub file: usize,
    /// Number of the frame in the file.
    pub frame: usize,
    /// Middle of its first pixel, in LPS mm.
    pub position: Option<DVec3>,
    /// Directions of its rows and of its columns, of length 1, in LPS.
    pub axes: Option<[DVec3; 2]>,
    /// Distance of neighboring columns and of neighboring rows, in mm.
    pub spacing: Option<[f64; 2]>,
    /// Distance to the next slice as the file states it, in mm.
    pub stated_step: Option<f64>,
    /// Place along the stack where there is no position.
    pub location: Option<f64>,
    /// From stored numbers to data values.
    pub rescale: Rescale,
    /// Stored numbers that stand for no measurement, first and last.
    pub padding: Option<(f64, f64)>,
    /// What orders slices of one place, most telling first.
    pub order: [f64; NUM_ORDERS],
    /// Whether it says that it is a scout view.
    pub is_localizer: bool,
    /// The kind of picture ("ORIGINAL\PRIMARY\M"): tells magnitudes from phases.
    pub image_type: String,
    /// Place in the acquisition, as the last resort.
    pub number: f64,
}

/// How many numbers order slices of one place; the names are those of [`ORDER_NAMES`].
pub const NUM_ORDERS: usize = 7;

/// What the numbers of [`Slice::order`] are.
pub const ORDER_NAMES: [&str; NUM_ORDERS] =
    ["time point", "trigger time", "reference time", "b-value", "acquisition", "echo", "echo time"];

/// The frames of file number `index`.
///
/// # Errors
/// One sentence for spacings and directions that are none.
pub fn slices_of(index: usize, file: &DicomFile, image: &Image) -> Result<Vec<Slice>> {
    let e = &file.elements;
    let shared = e.item(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE);
    let per_frame = e.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE);
    let offsets = e.numbers(tags::GRID_FRAME_OFFSET_VECTOR);
    let whole_frame = FrameGroups { frame: None, shared, root: e };
    let axes = whole_frame.axes(file)?;
    let spacing = whole_frame.spacing(file)?;
    let is_common = per_frame.is_empty();
    (0..image.num_frames)
        .map(|frame| {
            let groups = FrameGroups { frame: per_frame.get(frame), shared, root: e };
            let axes = if is_common { axes } else { groups.axes(file)? };
            let spacing = if is_common { spacing } else { groups.spacing(file)? };
            let mut position = groups.position(file)?;
            // Radiotherapy doses: one position, and how far each frame is from it.
            if let (Some(p), Some([row, column]), Some(offset)) = (position, axes, offsets.get(frame)) {
                let first = offsets.first().copied().unwrap_or(0.0);
                position = Some(p + row.cross(column) * (offset - if first == p.z { first } else { 0.0 }));
            } else if image.num_frames > 1 && is_common {
                position = None;
            }
            let number = |sequence: Option<Tag>, tag: Tag| groups.number(sequence, tag);
            let content = Some(tags::FRAME_CONTENT_SEQUENCE);
            let order = [
                number(content, tags::TEMPORAL_POSITION_INDEX)
                    .or_else(|| number(None, tags::TEMPORAL_POSITION_IDENTIFIER)),
                number(Some(tags::CARDIAC_SYNCHRONIZATION_SEQUENCE), tags::NOMINAL_CARDIAC_TRIGGER_DELAY_TIME)
                    .or_else(|| number(None, tags::TRIGGER_TIME)),
                number(None, tags::FRAME_REFERENCE_TIME),
                number(Some(tags::MR_DIFFUSION_SEQUENCE), tags::DIFFUSION_B_VALUE)
                    .or_else(|| number(None, tags::DIFFUSION_B_VALUE)),
                number(None, tags::ACQUISITION_NUMBER),
                number(None, tags::ECHO_NUMBERS),
                number(Some(tags::MR_ECHO_SEQUENCE), tags::EFFECTIVE_ECHO_TIME)
                    .or_else(|| number(None, tags::ECHO_TIME)),
            ];
            let image_type = e.word(tags::IMAGE_TYPE).unwrap_or_default();
            Ok(Slice {
                file: index,
                frame,
                position,
                axes,
                spacing,
                stated_step: groups.step(),
                location: number(None, tags::SLICE_LOCATION),
                rescale: groups.rescale(),
                padding: padding(file, &image.format),
                order: order.map(|n| n.unwrap_or(0.0)),
                is_localizer: image_type.contains("LOCALIZER"),
                image_type,
                number: number(None, tags::INSTANCE_NUMBER).unwrap_or(0.0) + frame as f64,
            })
        })
        .collect()
}

/// Where the properties of a frame are looked for: its own item, the item that all frames share, the data set itself.
struct FrameGroups<'a> {
    frame: Option<&'a Elements>,
    shared: Option<&'a Elements>,
    root: &'a Elements,
}

impl FrameGroups<'_> {
    /// The numbers of an element, in a sequence of the frame or of all frames, else in the data set itself.
    fn numbers(&self, sequence: Option<Tag>, tag: Tag) -> Vec<f64> {
        if let Some(sequence) = sequence {
            for groups in [self.frame, self.shared].into_iter().flatten() {
                if let Some(item) = groups.item(sequence)
                    && item.has(tag)
                {
                    return item.numbers(tag);
                }
            }
        }
        self.root.numbers(tag)
    }

    fn number(&self, sequence: Option<Tag>, tag: Tag) -> Option<f64> {
        self.numbers(sequence, tag).first().copied().filter(|n| n.is_finite())
    }

    fn position(&self, file: &DicomFile) -> Result<Option<DVec3>> {
        let numbers = self.numbers(Some(tags::PLANE_POSITION_SEQUENCE), tags::IMAGE_POSITION_PATIENT);
        let [x, y, z] = numbers[..] else { return Ok(None) };
        let position = DVec3::new(x, y, z);
        // Scanners are not kilometers large.
        if position.is_finite() && position.abs().max_element() < 1e7 {
            return Ok(Some(position));
        }
        Err(Error::file(&file.path, "the DICOM header puts the slice nowhere in space", "export it again"))
    }

    fn axes(&self, file: &DicomFile) -> Result<Option<[DVec3; 2]>> {
        let numbers = self.numbers(Some(tags::PLANE_ORIENTATION_SEQUENCE), tags::IMAGE_ORIENTATION_PATIENT);
        let [a, b, c, d, e, f] = numbers[..] else { return Ok(None) };
        let [row, column] = [DVec3::new(a, b, c), DVec3::new(d, e, f)];
        let are_axes =
            (row.length() - 1.0).abs() < 0.05 && (column.length() - 1.0).abs() < 0.05 && row.dot(column).abs() < 0.05;
        if are_axes {
            return Ok(Some([row.normalize(), column.normalize()]));
        }
        // Some writers fill in zeros where they do not know.
        if row == DVec3::ZERO && column == DVec3::ZERO {
            return Ok(None);
        }
        Err(Error::file(
            &file.path,
            "the directions of its rows and columns are not at right angles",
            "export it again from the program it came from",
        ))
    }

    fn spacing(&self, file: &DicomFile) -> Result<Option<[f64; 2]>> {
        let mut numbers = self.numbers(Some(tags::PIXEL_MEASURES_SEQUENCE), tags::PIXEL_SPACING);
        for tag in [tags::IMAGER_PIXEL_SPACING, tags::NOMINAL_SCANNED_PIXEL_SPACING, tags::PIXEL_ASPECT_RATIO] {
            if numbers.is_empty() {
                numbers = self.numbers(None, tag);
            }
        }
        // The distance of rows comes first.
        let [y, x] = numbers[..] else { return Ok(None) };
        if [x, y].iter().all(|s| s.is_finite() && *s > 0.0) {
            return Ok(Some([x, y]));
        }
        Err(Error::file(
            &file.path,
            format!("its pixels are spaced by {y} x {x} mm, which no pixels are"),
            "correct the header with the program it came from",
        ))
    }

    fn step(&self) -> Option<f64> {
        [tags::SPACING_BETWEEN_SLICES, tags::SLICE_THICKNESS]
            .into_iter()
            .filter_map(|tag| self.number(Some(tags::PIXEL_MEASURES_SEQUENCE), tag))
            // Some writers give the spacing a sign.
            .map(f64::abs)
            .find(|step| *step > 0.0)
    }

    fn rescale(&self) -> Rescale {
        let transformation = Some(tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE);
        let number = |tag| self.number(transformation, tag);
        let slope = number(tags::RESCALE_SLOPE).or_else(|| number(tags::DOSE_GRID_SCALING)).unwrap_or(1.0);
        // A slope of 0 would leave nothing; writers mean that there is none.
        let slope = if slope == 0.0 { 1.0 } else { slope };
        Rescale { slope, intercept: number(tags::RESCALE_INTERCEPT).unwrap_or(0.0) }
    }
}

/// The padding value is written like a pixel, whatever representation the element has.
fn padding(file: &DicomFile, format: &PixelFormat) -> Option<(f64, f64)> {
    if format.kind != PixelKind::Integer || format.is_color() {
        return None;
    }
    let number = |tag: Tag| {
        let word = *file.elements.words16(tag)?.first()?;
        Some(if format.is_signed { f64::from(word as i16) } else { f64::from(word) })
    };
    let first = number(tags::PIXEL_PADDING_VALUE)?;
    let last = number(tags::PIXEL_PADDING_RANGE_LIMIT).unwrap_or(first);
    Some((first.min(last), first.max(last)))
}
