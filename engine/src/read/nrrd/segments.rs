//! `.seg.nrrd`: 3D Slicer's segmentations, with names, colors and terms in keys of the header.
//!
//! Format: slicer.readthedocs.io, developer guide, segmentations. Structures that overlap lie in layers along an axis of
//! kind `list`; before 2020 every structure had a layer of its own, and no key said which number it has there. The keys of
//! extents (`Segment0_Extent`, `Segmentation_ReferenceImageExtentOffset`) are bookkeeping: the header's own fields place the
//! voxels in space, also where only a part of the scan was stored.

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use super::{Encoding, Opened};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::read::label_table::{code_of, readable};
use crate::read::stream::{self, ElementType, HexBytes, VoxelRequest};
use crate::read::window::{Averaging, Window};
use crate::selection::{BRICK, BrickPool, Selection, Structure};
use crate::spaces::Grid;
use crate::volume::labels::{Label, LabelMap, LayerBuilder, background, distinct_color, numbered};
use crate::volume::{Voxel as _, Voxels};
use crate::with_voxels;

/// Voxels decoded at once.
const CHUNK_VOXELS: usize = 128 << 10;

/// Whether a key of the header belongs to a segmentation: `Segmentation_…` or `Segment7_…`.
pub fn is_of_segments(key: &str) -> bool {
    key.starts_with("Segmentation_") || number_and_field(key).is_some()
}

fn number_and_field(key: &str) -> Option<(u32, &str)> {
    let (number, field) = key.strip_prefix("Segment")?.split_once('_')?;
    Some((number.parse().ok()?, field))
}

/// What the header says about a structure.
#[derive(Default)]
struct Segment {
    name: Option<String>,
    /// The program's own name for it.
    id: Option<String>,
    color: Option<[u8; 3]>,
    /// Its number in its layer.
    value: Option<u32>,
    layer: usize,
    code: Option<String>,
}

impl Segment {
    /// As a structure that has the number `id`.
    fn into_label(self, id: u32) -> Label {
        let name = self.name.or(self.id).unwrap_or_else(|| id.to_string());
        Label { id, name, color: self.color.unwrap_or_else(|| distinct_color(id)), code: self.code }
    }
}

/// The structures by their number in the header.
fn segments(keys: &[(String, String)]) -> BTreeMap<u32, Segment> {
    let mut segments: BTreeMap<u32, Segment> = BTreeMap::new();
    for (key, value) in keys {
        let Some((number, field)) = number_and_field(key) else { continue };
        let segment = segments.entry(number).or_default();
        let value = value.trim();
        let text = || Some(readable(&unescaped(value))).filter(|t| !t.is_empty());
        match field {
            "Name" => segment.name = text(),
            "ID" => segment.id = text(),
            "Color" => segment.color = color(value),
            "LabelValue" => segment.value = value.parse().ok(),
            "Layer" => segment.layer = value.parse().unwrap_or(usize::MAX),
            "Tags" => segment.code = code(value),
            _ => {}
        }
    }
    segments
}

/// The value of a key, in which `\n` ends a line and `\\` is a backslash; lines become one.
fn unescaped(value: &str) -> String {
    let mut text = String::with_capacity(value.len());
    let mut chars = value.chars();
    while let Some(c) = chars.next() {
        match (c, (c == '\\').then(|| chars.clone().next()).flatten()) {
            ('\\', Some('n')) => text.push(' '),
            ('\\', Some('\\')) => text.push('\\'),
            _ => {
                text.push(c);
                continue;
            }
        }
        chars.next();
    }
    text
}

/// Three numbers from 0 to 1.
fn color(text: &str) -> Option<[u8; 3]> {
    let parts: Option<Vec<f64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
    let [r, g, b] = parts?[..] else { return None };
    Some([r, g, b].map(|c| (c * 255.0).round() as u8))
}

/// From `…|TerminologyEntry:context~category~type~modifier~…|…`, the concepts being `scheme^code^meaning`.
fn code(tags: &str) -> Option<String> {
    let entry = tags.split('|').find_map(|tag| tag.trim().strip_prefix("TerminologyEntry:"))?;
    let concept = |i: usize| {
        let mut parts = entry.split('~').nth(i).unwrap_or_default().split('^');
        (parts.next().unwrap_or_default(), parts.next().unwrap_or_default())
    };
    code_of(concept(2), concept(3))
}

/// Whether voxels belong to structures in part.
fn is_fractional(opened: &Opened) -> bool {
    opened.keys.iter().any(|(k, v)| k.ends_with("Representation") && v.contains("Fractional"))
}

/// Reads structures to which voxels belong in part, as [`write_fractional`](crate::selection::write_fractional) writes them, with
/// notes; nothing if voxels belong wholly to theirs. Layers are put into bricks eight slices at a time.
///
/// # Errors
/// One sentence for memberships that are no bytes, data that end early or are damaged.
pub fn read_fractional(
    path: &Path,
    opened: Opened,
    pool: &Arc<BrickPool>,
    progress: &Progress,
) -> Result<Option<(Vec<Structure>, Vec<String>)>> {
    if !is_fractional(&opened) {
        return Ok(None);
    }
    if opened.element != ElementType::U8 {
        let what = format!("its structures are fractional and of type {}", opened.entry.type_name);
        return Err(Error::file(path, what, "save it as uint8, 255 where a voxel belongs wholly"));
    }
    let (grid, notes) = (opened.entry.grid, opened.warnings.clone());
    let mut labels: BTreeMap<usize, Label> = BTreeMap::new();
    for (number, segment) in segments(&opened.keys) {
        let id = segment.value.unwrap_or(number.saturating_add(1));
        labels.entry(segment.layer).or_insert_with(|| segment.into_label(id));
    }
    let mut sinks: Vec<SlabSink> = (0..opened.entry.num_frames).map(|_| SlabSink::new(grid, pool)).collect();
    each_value(path, opened, progress, |layer, value| {
        sinks[layer].push(value as u8);
        Ok(())
    })?;
    let structures = sinks.into_iter().enumerate().map(|(layer, sink)| {
        let label = labels.remove(&layer).unwrap_or_else(|| numbered(layer as u32 + 1));
        Structure { label, selection: sink.selection }
    });
    Ok(Some((structures.collect(), notes)))
}

/// A selection that grows by slabs of bricks.
struct SlabSink {
    selection: Selection,
    /// The voxels since the last slab.
    slab: Vec<u8>,
    /// First slice of the slab.
    z: usize,
}

impl SlabSink {
    fn new(grid: Grid, pool: &Arc<BrickPool>) -> Self {
        Self { selection: Selection::empty(grid, pool), slab: Vec::new(), z: 0 }
    }

    fn push(&mut self, membership: u8) {
        self.slab.push(membership);
        let [nx, ny, nz] = self.selection.grid().dims();
        let last = (self.z + BRICK).min(nz);
        if self.slab.len() == nx * ny * (last - self.z) {
            if self.slab.iter().any(|f| *f > 0) {
                let (slab, z) = (&self.slab, self.z);
                let at = |[x, y, at_z]: [usize; 3]| slab[x + nx * (y + ny * (at_z - z))];
                self.selection.change([[0, nx], [0, ny], [z, last]], |voxel, _| at(voxel));
            }
            self.slab.clear();
            self.z = last;
        }
    }
}

/// Reads all layers, whole.
///
/// # Errors
/// One sentence for voxels that are no numbers of structures, data that end early or are damaged, and as
/// [`LayerBuilder::add`].
pub fn read(path: &Path, opened: Opened, progress: &Progress) -> Result<Vec<LabelMap>> {
    if is_fractional(&opened) {
        return Err(Error::file(
            path,
            "its structures are fractional: voxels belong to them in part",
            "export it as a binary label map",
        ));
    }
    let fault = |what: String| Error::file(path, what, "write the file again with the program that made it");
    let (grid, num_layers) = (opened.entry.grid, opened.entry.num_frames);
    let segments = segments(&opened.keys);
    let is_numbered = segments.is_empty() || segments.values().any(|s| s.value.is_some());
    let mut notes = opened.warnings.clone();
    let mut sinks = Vec::new();
    let mut masks = Vec::new();
    if is_numbered {
        let mut layers = (0..num_layers).map(|_| LayerSink::new()).collect::<Vec<_>>();
        for (number, segment) in segments {
            let value = segment.value.unwrap_or(1);
            let (shown, layer) = (segment.name.clone().unwrap_or_else(|| number.to_string()), segment.layer);
            let is_added = match layers.get_mut(layer) {
                Some(layer) => layer.name(segment.into_label(value)).map_err(fault)?,
                None => false,
            };
            if !is_added {
                notes.push(format!("The structure `{shown}` has no voxels of its own and was left out."));
            }
        }
        sinks.extend(layers.into_iter().map(Sink::Layer));
    } else {
        let mut segments = segments.into_values();
        for id in (1..).take(num_layers) {
            masks.push(segments.next().map_or_else(|| numbered(id), |s| s.into_label(id)));
            sinks.push(Sink::Mask(MaskSink::default()));
        }
    }
    let num_voxels = grid.num_voxels();
    each_value(path, opened, progress, |layer, value| match &mut sinks[layer] {
        Sink::Layer(layer) => layer.push(value, num_voxels, path),
        Sink::Mask(mask) => mask.push(value, num_voxels).map_err(fault),
    })?;
    let mut layers = Vec::new();
    let mut builder = if is_numbered { None } else { Some(LayerBuilder::new(grid).map_err(fault)?) };
    let mut masks = masks.into_iter();
    for sink in sinks {
        match (sink, &mut builder) {
            (Sink::Layer(LayerSink { voxels, labels, .. }), _) => {
                layers.push(LabelMap { grid, voxels, labels, notes: Vec::new() });
            }
            (Sink::Mask(mask), Some(builder)) => {
                if let Some(label) = masks.next() {
                    builder.add(label, &mask.runs).map_err(fault)?;
                }
            }
            (Sink::Mask(_), None) => {}
        }
    }
    layers.extend(builder.map(LayerBuilder::finish).unwrap_or_default());
    if let Some(first) = layers.first_mut() {
        first.notes = notes;
    }
    Ok(layers)
}

/// Calls `take` with the layer and the value of every voxel, in the order of the file.
fn each_value(
    path: &Path,
    mut opened: Opened,
    progress: &Progress,
    mut take: impl FnMut(usize, f64) -> Result<()>,
) -> Result<()> {
    let num_layers = opened.entry.num_frames;
    let num_voxels = opened.entry.grid.num_voxels();
    if opened.encoding == Encoding::Text {
        // Nobody writes it; a layer at a time is enough.
        for layer in 0..num_layers {
            let opened = Opened::open(path)?;
            let window = Window::default().on(path, opened.entry.grid.dims())?;
            let (_, voxels, _) = opened.read_frame(layer, window, Averaging::Nearest, progress)?;
            each_of(&voxels, |value| take(layer, value))?;
        }
        return Ok(());
    }
    // So many neighbors in the file belong to one layer.
    let run = opened.axes.pick(0, num_voxels).run;
    let element_bytes = opened.element.num_bytes();
    let num_values = num_voxels * num_layers;
    progress.begin("reading", (num_values * element_bytes) as u64);
    opened.source = opened.source.watched_by(progress);
    opened.source.skip(opened.skipped)?;
    let (mut in_run, mut layer) = (0_u64, 0);
    let mut next = |value: f64| {
        take(layer, value)?;
        in_run += 1;
        if in_run == run {
            (in_run, layer) = (0, if layer + 1 == num_layers { 0 } else { layer + 1 });
        }
        Ok(())
    };
    let mut reader: Box<dyn Read + '_> = match opened.encoding {
        Encoding::Hex => Box::new(HexBytes::new(&mut opened.source)),
        _ => Box::new(&mut opened.source),
    };
    let data_path = &opened.data_path;
    let mut bytes = vec![0; CHUNK_VOXELS.min(num_values) * element_bytes];
    let mut done = 0;
    while done < num_values {
        let count = CHUNK_VOXELS.min(num_values - done);
        let chunk = &mut bytes[..count * element_bytes];
        let got = stream::read_full(&mut reader, chunk).map_err(|e| stream::decode_error(data_path, &e))?;
        if got < chunk.len() {
            let [got, all] = [done * element_bytes + got, num_values * element_bytes].map(|n| n as u64);
            return Err(stream::ends_early(data_path, got, all, "of voxels"));
        }
        let window = Window::default().on(path, [count, 1, 1])?;
        let (element, endian, averaging) = (opened.element, opened.endian, Averaging::Nearest);
        let request = VoxelRequest { element, endian, window, averaging, is_size_checked: true };
        each_of(&stream::read_voxels(&mut &*chunk, request, data_path, progress)?, &mut next)?;
        done += count;
    }
    drop(reader);
    opened.source.finish()
}

fn each_of(voxels: &Voxels, mut take: impl FnMut(f64) -> Result<()>) -> Result<()> {
    with_voxels!(voxels, stored => stored.iter().try_for_each(|v| take(v.to_f64())))
}

/// Where the voxels of a layer go.
enum Sink {
    Layer(LayerSink),
    Mask(MaskSink),
}

/// A layer of numbers, which structures share.
struct LayerSink {
    voxels: Vec<u16>,
    labels: Vec<Label>,
    position_of: HashMap<u32, u16>,
    /// The last value and its position: neighbors are mostly alike.
    last: (f64, u16),
}

impl LayerSink {
    fn new() -> Self {
        Self { voxels: Vec::new(), labels: vec![background()], position_of: HashMap::from([(0, 0)]), last: (0.0, 0) }
    }

    /// Gives a number to a structure; false if it has it already, or is 0.
    fn name(&mut self, label: Label) -> std::result::Result<bool, String> {
        if self.position_of.contains_key(&label.id) {
            return Ok(false);
        }
        let position = u16::try_from(self.labels.len()).map_err(|_| "it has more than 65 535 structures".to_owned())?;
        self.position_of.insert(label.id, position);
        self.labels.push(label);
        Ok(true)
    }

    fn push(&mut self, value: f64, num_voxels: usize, path: &Path) -> Result<()> {
        if value != self.last.0 {
            let id = value as u32;
            if f64::from(id) != value {
                let what = format!("a voxel is {value}, which numbers no structure");
                return Err(Error::file(path, what, "save it with an integer type"));
            }
            // What no segment has is a structure too, without a name.
            let fault = |what: String| Error::file(path, what, "this is no label map: open it as a volume");
            self.name(numbered(id)).map_err(fault)?;
            self.last = (value, self.position_of[&id]);
        }
        if self.voxels.len() == self.voxels.capacity() {
            stream::grow(&mut self.voxels, 1, num_voxels, path)?;
        }
        self.voxels.push(self.last.1);
        Ok(())
    }
}

/// A layer of one structure, as runs of voxels: there may be hundreds, and each is mostly empty.
#[derive(Default)]
struct MaskSink {
    runs: Vec<Range<usize>>,
    position: usize,
}

impl MaskSink {
    fn push(&mut self, value: f64, num_voxels: usize) -> std::result::Result<(), String> {
        if value != 0.0 {
            // Runs must not take more memory than a layer: two bytes a voxel.
            let is_full = self.runs.len() > num_voxels / 8 + 1024;
            match self.runs.last_mut() {
                Some(run) if run.end == self.position => run.end += 1,
                _ if is_full => return Err("a structure is nothing but specks".to_owned()),
                _ => self.runs.push(self.position..self.position + 1),
            }
        }
        self.position += 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
