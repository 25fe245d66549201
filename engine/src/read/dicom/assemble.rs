//! From the slices of a stack to the voxels of a volume: decoded side by side, each straight into its place.

use std::collections::BTreeMap;
use std::path::Path;

use bytemuck::Pod;
use dicom_dictionary_std::tags;
use rayon::prelude::*;

use super::file::DicomFile;
use super::frames::Frames;
use super::geometry::Plane;
use super::image::Photometric;
use super::series::Stack;
use super::slices::Slice;
use super::voxels::{Colors, Element, Number, Target, convert};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::read::stream::reserve;
use crate::read::window::{Averaged, Averaging, Collector, OnGrid};
use crate::volume::{Rescale, Volume, Voxels};

/// Slices that are decoded at a time where only parts of them are kept.
const BATCH: usize = 16;

/// The volume of a stack's frame.
pub fn volume(
    path: &Path,
    files: &[DicomFile],
    stack: &Stack,
    frame: usize,
    window: OnGrid,
    progress: &Progress,
) -> Result<Volume> {
    let slices = &stack.slices.frames[frame];
    let planes = &stack.slices.planes[window.range(2)];
    let has_between = planes.iter().any(|p| matches!(p, Plane::Between(..)));
    let target = if has_between || !window.is_whole() { stack.target.with_gaps() } else { stack.target };
    progress.begin("reading", planes.len() as u64 * slice_bytes(stack));
    let reader =
        Reader { path, stack, target, slices, planes, window, progress, frames: frames_of(files, stack, slices) };
    let mut warnings = stack.slices.warnings.clone();
    let voxels = match target.element {
        Element::U8 => Voxels::U8(reader.numbers(&mut warnings)?),
        Element::I8 => Voxels::I8(reader.numbers(&mut warnings)?),
        Element::U16 => Voxels::U16(reader.numbers(&mut warnings)?),
        Element::I16 => Voxels::I16(reader.numbers(&mut warnings)?),
        Element::U32 => Voxels::U32(reader.numbers(&mut warnings)?),
        Element::I32 => Voxels::I32(reader.numbers(&mut warnings)?),
        Element::F32 => Voxels::F32(reader.numbers(&mut warnings)?),
        Element::F64 => Voxels::F64(reader.numbers(&mut warnings)?),
        Element::Rgb => {
            let colors = reader.colors(files)?;
            return super::super::color_volume_of(path, &stack.entry, window, colors, warnings);
        }
    };
    super::super::volume_of(path, &stack.entry, window, voxels, target.rescale, warnings)
}

fn slice_bytes(stack: &Stack) -> u64 {
    (stack.format.num_pixels() * stack.target.bytes_per_voxel()) as u64
}

fn frames_of<'a>(files: &'a [DicomFile], stack: &Stack, slices: &[Slice]) -> BTreeMap<usize, Frames<'a>> {
    let mut frames = BTreeMap::new();
    for slice in slices {
        frames.entry(slice.file).or_insert_with(|| {
            let file = &files[slice.file];
            let count = file.elements.count(tags::NUMBER_OF_FRAMES).unwrap_or(1).max(1) as usize;
            Frames::new(file, stack.format, count)
        });
    }
    frames
}

fn out_of_memory(path: &Path, num_bytes: usize) -> Error {
    let what = format!("there is not enough memory for its voxels ({} MiB)", num_bytes >> 20);
    Error::file(path, what, "close other programs, or crop or downsample the volume")
}

struct Reader<'a> {
    path: &'a Path,
    stack: &'a Stack,
    target: Target,
    slices: &'a [Slice],
    /// Those in the window.
    planes: &'a [Plane],
    window: OnGrid,
    progress: &'a Progress,
    frames: BTreeMap<usize, Frames<'a>>,
}

impl Reader<'_> {
    fn numbers<T: Number>(&self, warnings: &mut Vec<String>) -> Result<Vec<T>> {
        let mut voxels = self.collect(&|plane, to: &mut [T]| self.fill_plane(plane, to))?;
        if self.target.has_padding && self.fill_padding(&mut voxels) {
            warnings.push("Pixels outside of the scanned field (padding) were given the smallest value.".to_owned());
        }
        Ok(voxels)
    }

    /// The planes of the window, each filled by `fill`.
    fn collect<T: Averaged + Pod>(&self, fill: &(dyn Fn(Plane, &mut [T]) -> Result<()> + Sync)) -> Result<Vec<T>> {
        let n = self.stack.format.num_pixels();
        let step = |plane: &Plane, to: &mut [T]| {
            self.progress.check()?;
            fill(*plane, to)?;
            self.progress.advance(slice_bytes(self.stack))
        };
        if self.window.is_whole() {
            // Zeros from the system take no memory until a slice is decoded into them: a file that promises more slices than
            // it has ends the work early.
            let mut voxels = bytemuck::allocation::try_zeroed_vec(n * self.planes.len())
                .map_err(|()| out_of_memory(self.path, n * self.planes.len() * size_of::<T>()))?;
            voxels.par_chunks_exact_mut(n).zip(self.planes).try_for_each(|(to, plane)| step(plane, to))?;
            return Ok(voxels);
        }
        let mut collector = Collector::new(self.window, Averaging::Mean, self.path);
        collector.skip(self.window.range(2).start * n);
        for batch in self.planes.chunks(BATCH) {
            let slices: Vec<Vec<T>> = batch
                .par_iter()
                .map(|plane| {
                    let mut slice = Vec::new();
                    reserve(&mut slice, n, self.path)?;
                    slice.resize(n, T::zeroed());
                    step(plane, &mut slice)?;
                    Ok(slice)
                })
                .collect::<Result<_>>()?;
            slices.iter().try_for_each(|slice| collector.push(slice))?;
        }
        Ok(collector.finish())
    }

    fn fill_plane<T: Number>(&self, plane: Plane, to: &mut [T]) -> Result<()> {
        match plane {
            Plane::At(i) => self.fill_slice(i, to),
            Plane::Between(i, share) => {
                self.fill_slice(i, to)?;
                let mut next = vec![T::from_value(0.0); to.len()];
                self.fill_slice(i + 1, &mut next)?;
                for (a, b) in to.iter_mut().zip(next) {
                    let mean = a.value() + (b.value() - a.value()) * share;
                    *a = T::from_value(if T::HAS_NAN { mean } else { mean.round() });
                }
                Ok(())
            }
        }
    }

    fn fill_slice<T: Number>(&self, i: usize, to: &mut [T]) -> Result<()> {
        let slice = &self.slices[i];
        let Some(frames) = self.frames.get(&slice.file) else { return Ok(()) };
        let decoded = frames.decode(slice.frame)?;
        convert(&decoded, &self.stack.format, &self.target, slice, to);
        Ok(())
    }

    /// Gives padding the smallest value that was measured: outside of the scanned field is air, not far below it. In other
    /// modalities than CT only bright padding is in the way. Whether there was any.
    fn fill_padding<T: Number>(&self, voxels: &mut [T]) -> bool {
        let padding = self.slices.iter().filter_map(|s| s.padding).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        let Some((low, high)) = padding else { return false };
        // Of types with NaN padding is that, of others its own value.
        let is_padding = |v: &T| if T::HAS_NAN { v.value().is_nan() } else { (low..=high).contains(&v.value()) };
        let (least, num_padding) = voxels
            .par_iter()
            .fold(
                || (f64::INFINITY, 0_usize),
                |(least, n), v| if is_padding(v) { (least, n + 1) } else { (least.min(v.value()), n) },
            )
            .reduce(|| (f64::INFINITY, 0), |a, b| (a.0.min(b.0), a.1 + b.1));
        if num_padding == 0 {
            return false;
        }
        let rescale = if self.target.is_rescaled { self.slices[0].rescale } else { Rescale::IDENTITY };
        let stored = rescale.value(low);
        let value = if !least.is_finite() {
            stored
        } else if self.target.is_ct {
            least
        } else {
            least.min(stored)
        };
        let value = T::from_value(value);
        voxels.par_iter_mut().filter(|v| is_padding(v)).for_each(|v| *v = value);
        true
    }

    fn colors(&self, files: &[DicomFile]) -> Result<Vec<[u8; 4]>> {
        let fill = |plane: Plane, to: &mut [[u8; 4]]| {
            // Between two slices the nearer one: colors of tables and overlays have no mean.
            let i = match plane {
                Plane::At(i) => i,
                Plane::Between(i, share) => i + usize::from(share > 0.5),
            };
            let slice = &self.slices[i];
            let Some(frames) = self.frames.get(&slice.file) else { return Ok(()) };
            let decoded = frames.decode(slice.frame)?;
            palette(&files[slice.file], self.stack.format.photometric)?.convert(&decoded, &self.stack.format, to);
            Ok(())
        };
        self.collect(&fill)
    }
}

/// The palette of a file that has one.
fn palette(file: &DicomFile, photometric: Photometric) -> Result<Colors> {
    if photometric != Photometric::Palette {
        return Ok(Colors { palette: Vec::new(), first: 0 });
    }
    let fault = || Error::file(&file.path, "the table of its colors is missing or damaged", "export it again");
    let tables = [
        (tags::RED_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR, tags::RED_PALETTE_COLOR_LOOKUP_TABLE_DATA),
        (tags::GREEN_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR, tags::GREEN_PALETTE_COLOR_LOOKUP_TABLE_DATA),
        (tags::BLUE_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR, tags::BLUE_PALETTE_COLOR_LOOKUP_TABLE_DATA),
    ];
    let mut first = 0;
    let mut channels = Vec::new();
    for (descriptor, data) in tables {
        let words = file.elements.words16(descriptor).ok_or_else(fault)?;
        let [count, start, bits] = words[..] else { return Err(fault()) };
        let count = if count == 0 { 65_536 } else { usize::from(count) };
        first = i64::from(start as i16);
        let bytes = file.elements.bytes(data).ok_or_else(fault)?;
        // Tables of 8 bits are written as bytes or, as in the standard's early days, as words.
        let channel: Vec<u8> = if bits == 8 && bytes.len() < 2 * count {
            bytes.to_vec()
        } else {
            let shift = if bits == 16 { 8 } else { 0 };
            file.elements.words16(data).ok_or_else(fault)?.iter().map(|w| (w >> shift).min(255) as u8).collect()
        };
        if channel.len() < count {
            return Err(fault());
        }
        channels.push(channel);
    }
    let [red, green, blue] = &channels[..] else { return Err(fault()) };
    let n = red.len().min(green.len()).min(blue.len());
    Ok(Colors { palette: (0..n).map(|i| [red[i], green[i], blue[i], 255]).collect(), first })
}
