//! TIFF: stacks of pages, classic and BigTIFF, of ImageJ and of OME.
//!
//! Pages are slices from the first to the last; channels and times are frames, the channel counted fastest. Without a
//! patient the axes are those of axial images ([`super::slices`]). Read by hand and not with the `tiff` crate, as stacks
//! come with palettes and with ImageJ's single directory for thousands of slices, and as hostile sizes have to be found
//! before anything is decoded; the crate writes the files of the tests instead.

mod codec;
mod ifd;
mod notes;
#[cfg(test)]
mod tests;

use std::path::Path;

use glam::DVec3;

pub use ifd::is_tiff;
use ifd::{Page, Tiff};
use notes::Notes;

use super::image_folder::{self, Standing};
use super::slices::{self, PixelKind};
use super::{Entry, ReadOptions, VolumeReader, check_frame, grid_of};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Modality, Rescale, Volume};

/// Reads TIFF files.
pub struct TiffReader;

impl VolumeReader for TiffReader {
    fn name(&self) -> &'static str {
        "TIFF"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["tif", "tiff"]
    }

    fn recognizes(&self, _path: &Path, head: &[u8]) -> bool {
        is_tiff(head)
    }

    fn survey(&self, path: &Path, _options: &ReadOptions, progress: &Progress) -> Result<Vec<Entry>> {
        Ok(vec![match Opened::open(path, progress)? {
            Opened::Pages(stack) => stack.entry,
            Opened::Files(slices) => slices.entry,
        }])
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        match Opened::open(path, progress)? {
            Opened::Pages(stack) => stack.read(path, options, progress),
            Opened::Files(slices) => slices.read(path, options, progress),
        }
    }
}

/// What a file is.
enum Opened {
    /// All there is.
    Pages(Box<Stack>),
    /// One slice of several files, which it stands for.
    Files(Box<image_folder::Stack>),
}

impl Opened {
    fn open(path: &Path, progress: &Progress) -> Result<Self> {
        let mut stack = Stack::open(path, progress)?;
        if stack.entry.grid.dims()[2] == 1 && stack.entry.num_frames == 1 {
            match image_folder::standing_of(path, progress)? {
                Standing::Slice(slices) => return Ok(Self::Files(slices)),
                Standing::Alone(note) => stack.warnings.extend(note),
            }
        }
        Ok(Self::Pages(Box::new(stack)))
    }
}

/// One page as a slice among others.
pub struct Slice {
    /// Width and height.
    pub size: [u64; 2],
    /// What its pixels are.
    pub kind: PixelKind,
    /// Spacing along x and y as far as it is known.
    pub spacing_mm: [Option<f64>; 2],
    /// Pages in the file.
    pub num_pages: usize,
}

/// Looks at a file that is one slice of several.
///
/// # Errors
/// As [`read_slice`], without decoding.
pub fn survey_slice(path: &Path, progress: &Progress) -> Result<Slice> {
    let (_, pages) = Tiff::open(path, progress)?;
    let (kind, _) = codec::kind_of(path, &pages[0], 1)?;
    let spacing = Notes::of(&pages[0]).spacing_mm;
    let num_pages = pages.iter().filter(|p| !p.is_auxiliary).count();
    Ok(Slice { size: [pages[0].width, pages[0].height], kind, spacing_mm: [spacing[0], spacing[1]], num_pages })
}

/// The pixels of the first page, as [`slices::read`] takes them.
///
/// # Errors
/// If the file is damaged or its pixels are none that Fabrica reads.
pub fn read_slice(path: &Path, progress: &Progress) -> Result<Vec<u8>> {
    let (mut tiff, pages) = Tiff::open(path, progress)?;
    let (kind, _) = codec::kind_of(path, &pages[0], 1)?;
    codec::decode(&mut tiff, path, &pages[0], 1, kind, 0)
}

/// A file whose directories are understood.
struct Stack {
    entry: Entry,
    tiff: Tiff,
    /// The pages that are slices, with their numbers in the file; one if the others lie behind it.
    pages: Vec<(usize, Page)>,
    /// Images that lie behind the first page without a directory of their own.
    is_contiguous: bool,
    kind: PixelKind,
    num_components: u64,
    num_channels: u64,
    num_times: u64,
    order: [u8; 3],
    rescale: Rescale,
    warnings: Vec<String>,
}

impl Stack {
    fn open(path: &Path, progress: &Progress) -> Result<Self> {
        let (tiff, all) = Tiff::open(path, progress)?;
        let num_all = all.len();
        let mut pages: Vec<_> = (1..).zip(all).filter(|(_, page)| !page.is_auxiliary).collect();
        if pages.is_empty() {
            let what = "all its pages are smaller copies or masks of others";
            return Err(Error::file(path, what, "save the pages themselves"));
        }
        let mut notes = Notes::of(&pages[0].1);
        let mut warnings = std::mem::take(&mut notes.warnings);
        if pages.len() < num_all {
            warnings.push(format!("{} pages that are smaller copies or masks were left out.", num_all - pages.len()));
        }
        let (number, first) = &pages[0];
        let (kind, num_components) = codec::kind_of(path, first, *number)?;
        let looks = |p: &Page| (p.width, p.height, p.bits, p.format, p.num_samples, p.photometric);
        for (number, page) in &pages[1..] {
            let (kind_here, _) = codec::kind_of(path, page, *number)?;
            if looks(page) != looks(first) || kind_here != kind {
                return Err(Error::file(
                    path,
                    format!(
                        "page {number} has {} x {} pixels of {} bits, where the first has {} x {} of {}{}",
                        page.width,
                        page.height,
                        page.bits,
                        first.width,
                        first.height,
                        first.bits,
                        if kind_here == kind { "" } else { ", and another kind of pixel" }
                    ),
                    "save the slices of one volume alone",
                ));
            }
        }
        let num_images = notes.num_images.unwrap_or(1);
        let is_contiguous = pages.len() == 1 && num_images > 1;
        if is_contiguous {
            check_contiguous(path, &tiff, first, num_images)?;
        }
        let num_pages = if is_contiguous { num_images } else { pages.len() as u64 };
        let [width, height] = [first.width, first.height];

        // OME counts the samples of a color as channels.
        let samples = u64::from(first.num_samples);
        let is_ome = notes.format == "OME-TIFF";
        let mut num_channels = if is_ome && notes.num_channels.is_multiple_of(samples) {
            notes.num_channels / samples
        } else {
            notes.num_channels
        };
        let mut num_times = notes.num_frames;
        let others = num_channels.checked_mul(num_times).filter(|n| num_pages.is_multiple_of(*n));
        let promised = notes.num_slices.unwrap_or_else(|| others.map_or(0, |n| num_pages / n));
        if others.and_then(|n| n.checked_mul(promised)) != Some(num_pages) {
            warnings.push(format!(
                "The file says that it has {promised} slices, {num_channels} channels and {num_times} times, but it has \
                 {num_pages} pages; each is taken as a slice."
            ));
            (num_channels, num_times) = (1, 1);
        }
        let depth = num_pages / (num_channels * num_times);
        let [sx, sy, sz] = notes.spacing_mm;
        if sx.is_none() {
            warnings.push("The file does not give the voxel size; 1 mm is assumed.".to_owned());
        } else if sz.is_none() && depth > 1 {
            warnings.push("The file does not give the distance of slices; that of the columns is assumed.".to_owned());
        }
        let x = sx.unwrap_or(1.0);
        let spacing = DVec3::new(x, sy.unwrap_or(x), sz.unwrap_or(x));
        if first.orientation != 1 {
            let code = first.orientation;
            warnings.push(format!(
                "The file asks viewers to turn its pages (orientation {code}); they are read as stored."
            ));
        }
        let is_color = !matches!(kind, PixelKind::Values(_));
        if is_color && first.bits == 16 {
            warnings.push("The colors have 16 bits a channel, of which 8 are kept.".to_owned());
        }
        if is_color && first.photometric == 3 {
            warnings.push("The numbers of the file stand for colors of a table, and these are shown.".to_owned());
        }
        if !is_color && first.photometric == 0 {
            warnings.push("The file has white at 0; its numbers were inverted.".to_owned());
        }
        let rescale = match notes.calibration {
            Some([intercept, slope]) if !is_color => Rescale { slope, intercept },
            _ => Rescale::IDENTITY,
        };
        let dims = [width, height, depth];
        let num_components = u64::from(num_components);
        let num_frames = num_channels * num_times * num_components;
        let entry = Entry {
            key: String::new(),
            title: String::new(),
            format: if notes.format == "TIFF" && tiff.is_big { "BigTIFF" } else { notes.format }.to_owned(),
            modality: Modality::Unknown,
            grid: grid_of(path, dims, slices::world_without_patient(dims, spacing))?,
            orientation: slices::no_patient(),
            type_name: kind.name(),
            bytes_per_voxel: kind.bytes_per_voxel(),
            num_frames: usize::try_from(num_frames).unwrap_or(usize::MAX),
            num_files: 1,
            is_labels: false,
            is_localizer: false,
        };
        if is_contiguous {
            pages.truncate(1);
        }
        Ok(Self {
            entry,
            tiff,
            pages,
            is_contiguous,
            kind,
            num_components,
            num_channels,
            num_times,
            order: notes.order,
            rescale,
            warnings,
        })
    }

    fn read(mut self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        check_frame(path, options.frame, self.entry.num_frames)?;
        let (component, frame) =
            (options.frame as u64 % self.num_components, options.frame as u64 / self.num_components);
        let (channel, time) = (frame % self.num_channels, frame / self.num_channels);
        let depth = self.entry.grid.dims()[2] as u64;
        let entry = self.entry.clone();
        let warnings = std::mem::take(&mut self.warnings);
        let (kind, rescale) = (self.kind, self.rescale);
        let decode = |z: usize| {
            let (mut index, mut stride) = (0, 1);
            for axis in self.order {
                let (at, size) = match axis {
                    b'c' => (channel, self.num_channels),
                    b't' => (time, self.num_times),
                    _ => (z as u64, depth),
                };
                index += at * stride;
                stride *= size;
            }
            let (number, page) = if self.is_contiguous {
                let mut page = self.pages[0].1.clone();
                let start = page.offsets[0] + index * page.num_bytes();
                page.chunk[1] = page.height;
                (page.offsets, page.byte_counts) = (vec![start], vec![page.num_bytes()]);
                (index as usize + 1, page)
            } else {
                self.pages[index as usize].clone()
            };
            codec::decode(&mut self.tiff, path, &page, number, kind, component as u16)
        };
        slices::read(path, &entry, kind, rescale, warnings, options, progress, decode)
    }
}

/// Whether `num_images` lie one behind the other, as ImageJ writes stacks beyond 4 GB.
fn check_contiguous(path: &Path, tiff: &Tiff, first: &Page, num_images: u64) -> Result<()> {
    let is_one_piece = !first.is_tiled
        && !first.is_planar
        && first.compression == 1
        && first.offsets.windows(2).zip(&first.byte_counts).all(|(pair, count)| pair[0] + count == pair[1]);
    let end = first.num_bytes().checked_mul(num_images).and_then(|n| n.checked_add(first.offsets[0]));
    if is_one_piece && end.is_some_and(|end| end <= tiff.length) {
        return Ok(());
    }
    Err(Error::file(
        path,
        format!("the file says that it has {num_images} images, but holds one"),
        "copy or download it again",
    ))
}
