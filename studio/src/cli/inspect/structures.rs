//! The structures of a label map: what they are called, how large they are, where they lie, what a scan is in them.

use std::path::Path;

use anyhow::Result;
use fabrica_engine::error::printable;
use fabrica_engine::read::label_table::read_label_table;
use fabrica_engine::read::{Numbers, ReadOptions, choose, read_labels, survey};
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::labels::{Label, LabelMap, StructureStatistics, resample_layers};
use fabrica_engine::{Error, Progress};
use serde::Serialize;

use super::short;
use crate::figure::first_look;
use crate::figure::source::VolumeSource;

/// Where label maps and their names come from.
#[derive(clap::Args, Debug)]
#[group(skip)]
pub struct Arguments {
    /// A label map of the volume: a file or a folder with a mask per structure. Without a value, the volume is one itself.
    #[arg(long, value_name = "FILE_OR_DIR", num_args = 0..=1, default_missing_value = "")]
    labels: Option<String>,
    /// Names and colors of its structures: a table of 3D Slicer, ITK-SNAP or FreeSurfer, JSON, or CSV.
    #[arg(long, value_name = "FILE")]
    label_table: Option<String>,
}

/// What was found, for `--json` too.
#[derive(Default, Serialize)]
pub struct Listing {
    #[serde(skip_serializing_if = "Vec::is_empty")]
    structures: Vec<Structure>,
    /// Label maps that the structures lie in; more than one where structures overlap.
    #[serde(skip_serializing_if = "Option::is_none")]
    num_label_layers: Option<usize>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    label_notes: Vec<String>,
    /// Whether they are what the volume's own numbers name.
    #[serde(skip)]
    pub is_of_volume: bool,
}

#[derive(Serialize)]
struct Structure {
    /// Which label map it lies in, from 0.
    layer: usize,
    id: u32,
    name: String,
    color: String,
    code: Option<String>,
    num_voxels: u64,
    volume_ml: f64,
    /// Smallest and largest R, A, S in mm.
    box_mm: Option<[[f64; 3]; 2]>,
    centroid_mm: Option<[f64; 3]>,
    /// The scan's, in it.
    mean: Option<f64>,
}

impl Listing {
    /// The structures of the label map that is asked for, on the grid of `volume`; of `volume` itself if it is one; else
    /// nothing. `numbers` says whether it is one; without a word, its file and its values do. With a sentence if it is one by
    /// its values alone.
    pub fn of(
        arguments: &Arguments,
        source: &VolumeSource,
        options: &ReadOptions,
        numbers: Option<Numbers>,
        volume: &Volume,
        progress: &Progress,
    ) -> Result<(Self, Option<String>)> {
        let table = arguments.label_table.as_ref().map(|t| read_label_table(Path::new(t))).transpose()?;
        let other = arguments.labels.as_deref().filter(|path| !path.is_empty()).map(Path::new);
        let is_asked = arguments.labels.is_some() || table.is_some() || numbers == Some(Numbers::Structures);
        let mut guess = None;
        let layers = match (other, source) {
            (Some(path), _) => Some(read_labels(path, &ReadOptions::default(), progress)?),
            (None, VolumeSource::Path(path)) if is_asked => Some(read_labels(path, options, progress)?),
            (None, VolumeSource::Path(_)) if numbers == Some(Numbers::Values) => None,
            (None, VolumeSource::Path(path)) if is_label_map(path, options, progress)? => {
                Some(read_labels(path, options, progress)?)
            }
            (None, VolumeSource::Path(path)) => {
                let why = first_look::taken_for_labels(volume, progress)?.filter(|_| volume.colors.is_none());
                // Where several voxels became one, their numbers are means.
                let is_whole = options.window.reduce == [1; 3];
                let read = || match is_whole {
                    true => {
                        LabelMap::from_volume(volume).ok().map(|layer| vec![LabelMap { notes: Vec::new(), ..layer }])
                    }
                    false => read_labels(path, options, progress).ok(),
                };
                let layers = why.as_ref().and_then(|_| read());
                guess = why.filter(|_| layers.is_some());
                layers
            }
            // The cache holds the volume only; its label map comes from making it.
            (None, VolumeSource::Specimen(request)) => Some(vec![request.generate(progress)?.labels]),
        };
        let Some(mut layers) = layers else { return Ok((Self::default(), None)) };
        let mut notes: Vec<String> = Vec::new();
        // What is said of every layer is said once.
        let mut add = |new: Vec<String>| {
            new.into_iter().for_each(|n| {
                if !notes.contains(&n) {
                    notes.push(n)
                }
            })
        };
        add(table.iter().flat_map(|t| t.notes.clone()).collect());
        for layer in &mut layers {
            add(std::mem::take(&mut layer.notes));
            add(table.as_ref().and_then(|t| layer.name_by(t)).into_iter().collect());
        }
        if let Some(path) = other {
            let elsewhere = |what| Error::file(path, what, "name the label map that belongs to the scan");
            let (resampled, note) = resample_layers(layers, &volume.grid).map_err(elsewhere)?;
            layers = resampled;
            add(note.into_iter().collect());
        }
        // In a label map alone, means would be those of its numbers.
        let has_scan = other.is_some() || matches!(source, VolumeSource::Specimen(_));
        let mut structures = Vec::new();
        for (i, layer) in layers.iter().enumerate() {
            let means = if has_scan { layer.means(volume).unwrap_or_default() } else { Vec::new() };
            structures.extend(structures_of(i, layer, &means));
        }
        // What was said of the volume is no news of its numbers.
        notes.retain(|note| has_scan || !volume.warnings.contains(note));
        let listing =
            Self { structures, num_label_layers: Some(layers.len()), label_notes: notes, is_of_volume: !has_scan };
        Ok((listing, guess))
    }

    /// Lines for people: structures by size, the empty ones by name, notes.
    pub fn in_words(&self) -> Vec<String> {
        let mut lines = Vec::new();
        let num_layers = self.num_label_layers.unwrap_or(1);
        let (used, empty): (Vec<_>, Vec<_>) = self.structures.iter().partition(|s| s.num_voxels > 0);
        if !self.structures.is_empty() {
            let layers = match num_layers {
                1 => String::new(),
                n => format!(" in {n} layers, as they overlap"),
            };
            lines.push(format!("structures  {}{layers}", used.len()));
        }
        if !used.is_empty() {
            let width = used.iter().map(|s| s.name.chars().count()).max().unwrap_or(0).clamp(4, 40);
            let row = |id: &str, name: &str, color: &str, ml: &str, voxels: &str, mean: &str, code: &str| {
                let line = format!("{id:>12}  {name:width$}  {color:7} {ml:>10} {voxels:>10} {mean:>9}  {code}");
                line.trim_end().to_owned()
            };
            let has_means = used.iter().any(|s| s.mean.is_some());
            let has_codes = used.iter().any(|s| s.code.is_some());
            let head = |word: &'static str, is_shown: bool| if is_shown { word } else { "" };
            lines.push(row("id", "name", "color", "ml", "voxels", head("mean", has_means), head("code", has_codes)));
            lines.extend(used.iter().map(|s| {
                let id = if num_layers > 1 { format!("{}:{}", s.layer, s.id) } else { s.id.to_string() };
                let mean = s.mean.map(short).unwrap_or_default();
                let ml = format!("{:.*}", if s.volume_ml < 1.0 { 3 } else { 1 }, s.volume_ml);
                let code = s.code.clone().map(printable).unwrap_or_default();
                row(&id, &printable(s.name.clone()), &s.color, &ml, &s.num_voxels.to_string(), &mean, &code)
            }));
        }
        if !empty.is_empty() {
            let names: Vec<_> = empty.iter().map(|s| printable(s.name.clone())).collect();
            lines.push(format!("empty       {}: {}", empty.len(), names.join(", ")));
        }
        lines.extend(self.label_notes.iter().map(|n| format!("note: {n}")));
        lines
    }
}

/// Whether the file says so; numbers alone may be anything.
fn is_label_map(path: &Path, options: &ReadOptions, progress: &Progress) -> Result<bool> {
    let entries = survey(path, options, progress)?;
    Ok(choose(path, &entries, options.series.as_deref(), false).is_ok_and(|(entry, _)| entry.is_labels))
}

fn structures_of(layer: usize, labels: &LabelMap, means: &[Option<f64>]) -> Vec<Structure> {
    let structure = |(i, (label, s)): (usize, (&Label, StructureStatistics))| {
        let [r, g, b] = label.color;
        Structure {
            layer,
            id: label.id,
            name: label.name.clone(),
            color: format!("#{r:02x}{g:02x}{b:02x}"),
            code: label.code.clone(),
            num_voxels: s.num_voxels,
            volume_ml: s.volume_ml,
            box_mm: s.box_mm.map(|b| b.map(|corner| corner.to_array())),
            centroid_mm: s.centroid_mm.map(|c| c.to_array()),
            mean: means.get(i).copied().flatten(),
        }
    };
    labels.labels.iter().zip(labels.statistics()).enumerate().skip(1).map(structure).collect()
}
