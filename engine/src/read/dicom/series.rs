//! Which files belong together: series, and in them stacks of one orientation, size and kind.

use std::collections::HashSet;
use std::path::Path;

use glam::DVec3;

use super::file::DicomFile;
use super::geometry::{Arranged, Clause, arrange};
use super::image::{Image, PixelFormat, is_segmentation};
use super::slices::{Slice, slices_of};
use super::voxels::Target;
use crate::error::{Error, Result};
use crate::read::{Entry, grid_of};

/// Slices that make a volume, and what the user sees of it in a list.
#[derive(Debug)]
pub struct Stack {
    /// As the survey shows it.
    pub entry: Entry,
    /// How its pixels are stored.
    pub format: PixelFormat,
    /// Its slices.
    pub slices: Arranged,
    /// What its voxels become.
    pub target: Target,
    /// What orders lists and tells series apart; never leaves the reader.
    order: (f64, String),
    /// DICOM's code of the modality, for the key.
    code: String,
    /// The segmentation that it is, by the number of its file.
    pub segmentation: Option<usize>,
}

/// Slices that agree in all that a volume needs them to.
struct Group {
    slices: Vec<Slice>,
    image: Image,
    /// What holds its slices together besides what is compared.
    owner: String,
}

/// How far directions of one stack may differ (0.3°).
const SAME_DIRECTION: f64 = 5e-3;

impl Group {
    fn takes(&self, slice: &Slice, image: &Image, owner: &str) -> bool {
        let first = &self.slices[0];
        let same_direction = |a: DVec3, b: DVec3| (a - b).length() <= SAME_DIRECTION;
        let same_axes = match (first.axes, slice.axes) {
            (Some(a), Some(b)) => same_direction(a[0], b[0]) && same_direction(a[1], b[1]),
            (None, None) => true,
            _ => false,
        };
        let same_spacing = match (first.spacing, slice.spacing) {
            (Some(a), Some(b)) => (0..2).all(|i| (a[i] / b[i] - 1.0).abs() <= 1e-3),
            (None, None) => true,
            _ => false,
        };
        self.owner == owner
            && self.image.format == image.format
            && self.image.modality_code == image.modality_code
            && first.is_localizer == slice.is_localizer
            && same_axes
            && same_spacing
    }
}

/// What was found in files: volumes, and why some files make none.
#[derive(Default)]
pub struct Found {
    /// In the order of the list.
    pub stacks: Vec<Stack>,
    /// Titles of series that should make a volume and do not, and why.
    pub faults: Vec<(String, Error)>,
    /// Faults of files whose header or size is not what it should be.
    pub damaged: Vec<Error>,
    /// What the files without pixels are.
    pub without_pixels: Vec<Error>,
}

/// Sorts files into stacks. `path` is what the user named, for errors.
pub fn find(path: &Path, files: &[DicomFile]) -> Found {
    let mut found = Found::default();
    let mut groups: Vec<Group> = Vec::new();
    let mut seen = HashSet::new();
    for (index, file) in files.iter().enumerate() {
        let image = match Image::of(file) {
            Ok(image) => image,
            Err(error) if file.pixels.is_none() => {
                found.without_pixels.push(error);
                continue;
            }
            Err(error) => {
                found.damaged.push(error);
                continue;
            }
        };
        // The same picture twice, as copies in folders are.
        if !image.instance_uid.is_empty() && !seen.insert(image.instance_uid.clone()) {
            continue;
        }
        if is_segmentation(file) {
            match super::segmentation::stack_of(index, file, &image) {
                Ok(stack) => found.stacks.push(stack),
                Err(error) => found.faults.push((image.description.clone(), error)),
            }
            continue;
        }
        // A file of many frames is a series of its own, unless it says that it is a part of one.
        let folder = file.path.parent().map(|p| p.to_string_lossy().into_owned()).unwrap_or_default();
        let owner = match (&image.concatenation_uid, image.num_frames) {
            (Some(uid), _) => uid.clone(),
            (None, 2..) => file.path.to_string_lossy().into_owned(),
            _ if image.series_uid.is_empty() => folder,
            _ => image.series_uid.clone(),
        };
        match slices_of(index, file, &image) {
            Ok(slices) => {
                for slice in slices {
                    match groups.iter_mut().rev().find(|g| g.takes(&slice, &image, &owner)) {
                        Some(group) => group.slices.push(slice),
                        None => groups.push(Group { slices: vec![slice], image: image.clone(), owner: owner.clone() }),
                    }
                }
            }
            Err(error) => found.damaged.push(error),
        }
    }
    for group in groups {
        let Group { slices, image, .. } = group;
        for arranged in arrange(slices) {
            match arranged.map_err(|c| clause(path, c)).and_then(|slices| stack(path, &image, slices)) {
                Ok(stack) => found.stacks.push(stack),
                Err(error) => found.faults.push((image.description.clone(), error)),
            }
        }
    }
    found.stacks.sort_by(|a, b| {
        let number = a.order.0.total_cmp(&b.order.0);
        number.then_with(|| a.order.1.cmp(&b.order.1))
    });
    name(&mut found.stacks);
    found
}

fn clause(path: &Path, (what, remedy): Clause) -> Error {
    Error::file(path, what, remedy)
}

fn stack(path: &Path, image: &Image, mut slices: Arranged) -> Result<Stack> {
    let format = image.format;
    let dims = [format.columns, format.rows, slices.planes.len()].map(|n| n as u64);
    let grid = grid_of(path, dims, slices.world_from_index)?;
    let target = Target::of(&format, image.modality, slices.frames.iter().flatten());
    if image.has_value_table {
        slices
            .warnings
            .push("A table of values in the file was not applied: the values are as they are stored.".to_owned());
    }
    slices.warnings.extend(target.note());
    let files: HashSet<usize> = slices.frames.iter().flatten().map(|s| s.file).collect();
    let entry = Entry {
        key: String::new(),
        title: image.description.clone(),
        format: "DICOM".to_owned(),
        modality: image.modality,
        grid,
        orientation: slices.orientation.clone(),
        type_name: target.type_name(),
        bytes_per_voxel: target.bytes_per_voxel(),
        num_frames: slices.frames.len(),
        num_files: files.len(),
        is_labels: false,
        is_localizer: slices.frames.iter().flatten().all(|s| s.is_localizer),
    };
    Ok(Stack {
        entry,
        format,
        slices,
        target,
        order: (image.series_number, image.series_uid.clone()),
        code: image.modality_code.clone(),
        segmentation: None,
    })
}

/// A stack that is a segmentation.
pub fn segmentation_stack(index: usize, image: &Image, entry: Entry, slices: Arranged) -> Stack {
    Stack {
        entry,
        format: image.format,
        slices,
        target: Target::labels(),
        order: (image.series_number, image.series_uid.clone()),
        code: "SEG".to_owned(),
        segmentation: Some(index),
    }
}

/// Gives every stack a key of its own: made of what may be known of it, and numbered where that is alike.
fn name(stacks: &mut [Stack]) {
    let mut given: Vec<String> = Vec::new();
    for stack in stacks {
        let [x, y, z] = stack.entry.grid.dims();
        let s = stack.entry.grid.spacing_mm();
        let words = [
            stack.code.as_str(),
            &stack.entry.title,
            &format!("{x}x{y}x{z}"),
            &format!("{:.2}x{:.2}x{:.2}", s.x, s.y, s.z),
        ];
        let words: Vec<&str> = words.into_iter().filter(|w| !w.is_empty()).collect();
        let key = words.join(" ");
        let num_alike = given.iter().filter(|k| **k == key).count();
        given.push(key.clone());
        stack.entry.key = if num_alike == 0 { key } else { format!("{key} #{}", num_alike + 1) };
    }
}
