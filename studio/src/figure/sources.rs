//! What a figure is made from: volumes and selections, read from where its slots name them.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use fabrica_engine::read::ReadOptions;
use fabrica_engine::read::label_table::read_label_table;
use fabrica_engine::read::limits::Limits;
use fabrica_engine::selection::{BrickPool, Selection, Structure, from_label_maps, read_selections, smooth_partition};
use fabrica_engine::specimen::Request;
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::labels::{Label, resample_layers, same_grid};
use fabrica_engine::{Error, Progress};

use super::source::{VolumeSource, cached_structures};
use super::template::{FilterTemplate, SelectionSlot, Template, VolumeSlot};

/// A volume that takes the place of a template's own.
#[derive(Clone, Debug)]
pub struct Replacement {
    /// Where it comes from.
    pub source: VolumeSource,
    /// How to read it.
    pub options: ReadOptions,
}

/// What borders of whole voxels are smoothed by, in voxels, unless the slot says otherwise: as little as takes their stairs.
const CRISP_SIGMA: f64 = 1.0;

/// The color of what was painted, where its region has none: an orange that most people tell from others.
const PAINTED: [u8; 3] = [0xe6, 0x9f, 0x00];

/// What is read for the slots of a figure.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    /// A volume for each slot.
    pub volumes: Vec<Arc<Volume>>,
    /// The structures of each slot of selections, on its volume's grid.
    pub selections: Vec<Arc<Selections>>,
}

/// The structures of a slot of selections.
#[derive(Clone, Debug, Default)]
pub struct Selections {
    /// Each with its voxels.
    pub structures: Vec<Structure>,
    /// Whether they could not be read; the notes say why.
    pub is_missing: bool,
    /// What the user should know about how they were read, a sentence each.
    pub notes: Vec<String>,
}

impl Sources {
    /// Volumes without selections.
    pub fn of(volumes: Vec<Arc<Volume>>) -> Self {
        Self { volumes, selections: Vec::new() }
    }

    /// What the user should know about how everything was read, a sentence each.
    pub fn warnings(&self) -> impl Iterator<Item = &String> {
        self.volumes.iter().flat_map(|v| &v.warnings).chain(self.selections.iter().flat_map(|s| &s.notes))
    }
}

/// Reads what a template names (relative to `folder`); `volumes` and `labels` come in place of the first of its slots.
///
/// # Errors
/// One sentence; more replacements than slots.
pub fn load(
    template: &Template,
    folder: &Path,
    volumes: &[Replacement],
    labels: &[String],
    progress: &Progress,
) -> Result<Sources> {
    let volumes = load_volumes(template, folder, volumes, progress)?;
    if labels.len() > template.selections.len() {
        bail!(
            "{} label maps are given and the template has {} of {}; leave out the last ones",
            labels.len(),
            if template.selections.len() == 1 { "one place" } else { "places" },
            template.selections.len()
        );
    }
    let mut sources = Sources { volumes, selections: Vec::new() };
    for (i, slot) in template.selections.iter().enumerate() {
        let of = template.volumes.iter().position(|v| v.name == slot.volume).and_then(|v| sources.volumes.get(v));
        let volume = of.with_context(|| format!("the volume of the selections \"{}\" is missing", slot.name))?.clone();
        let loaded = match labels.get(i) {
            Some(file) => {
                let slot = SelectionSlot { file: Some(file.clone()), voxels: None, table: None, ..slot.clone() };
                load_selections(&slot, Path::new(""), &volume, progress)?
            }
            None => load_selections(slot, folder, &volume, progress)?,
        };
        sources.selections.push(loaded);
    }
    Ok(sources)
}

/// Reads the selections of a slot (its files relative to `folder`), onto the grid of its volume.
///
/// # Errors
/// One sentence.
pub fn load_selections(
    slot: &SelectionSlot,
    folder: &Path,
    volume: &Volume,
    progress: &Progress,
) -> Result<Arc<Selections>> {
    if let Some(painted) = painted(slot, volume) {
        return Ok(painted);
    }
    let pool = Arc::new(BrickPool::default());
    let read = || -> Result<Selections> {
        let table = slot.table.as_ref().map(|table| read_label_table(&folder.join(table))).transpose()?;
        let source = slot.file.as_ref().map(|file| VolumeSource::parse(file, folder)).transpose()?;
        let (mut structures, mut notes) = match source {
            None => {
                let voxels = slot.voxels.as_ref().context("nothing is in it; give it a file")?;
                match voxels.selection().resampled_to(&volume.grid, &pool, progress) {
                    Ok((selection, note)) => {
                        let changed =
                            format!("\"{}\" was painted on other voxels and is resampled to these.", slot.name);
                        (vec![structure(slot, selection)], [changed].into_iter().chain(note).collect())
                    }
                    Err(error @ Error::Cancelled) => return Err(error.into()),
                    Err(_) => {
                        let lost = "was painted elsewhere: nothing of it lies in this volume, so it is left out";
                        (Vec::new(), vec![format!("\"{}\" {lost}.", slot.name)])
                    }
                }
            }
            Some(VolumeSource::Path(path)) => read_selections(&path, &volume.grid, &pool, progress)?,
            Some(VolumeSource::Specimen(request)) => of_specimen(&request, volume, &pool, progress)?,
        };
        if let Some(table) = &table {
            notes.extend(table.name(structures.iter_mut().map(|s| &mut s.label)));
        }
        let is_crisp = || structures.iter().all(|s| s.selection.is_crisp());
        if structures.is_empty() {
            return Ok(Selections { structures, notes, ..Selections::default() });
        }
        let stairs = || slot.voxels.is_none() && is_crisp();
        let sigma = slot.smooth_voxels.unwrap_or_else(|| if stairs() { CRISP_SIGMA } else { 0.0 });
        let structures = smooth_partition(&structures, sigma, progress)?;
        Ok(Selections { structures, notes, ..Selections::default() })
    };
    read().map(Arc::new).with_context(|| format!("the template's selections \"{}\" cannot be loaded", slot.name))
}

/// The structures of a specimen on the grid of a volume, with notes on how they got there.
fn of_specimen(
    request: &Request,
    volume: &Volume,
    pool: &Arc<BrickPool>,
    progress: &Progress,
) -> Result<(Vec<Structure>, Vec<String>)> {
    if let Some(file) = cached_structures(request, progress)? {
        match read_selections(&file, &volume.grid, pool, progress) {
            // A damaged cache is as good as none.
            Err(error) if !matches!(error, Error::Cancelled) => {}
            read => return Ok(read?),
        }
    }
    let layers = vec![request.generate(progress)?.labels];
    let (layers, note) = resample_layers(layers, &volume.grid).map_err(anyhow::Error::msg)?;
    Ok((from_label_maps(&layers, pool, progress)?, note.into_iter().collect()))
}

/// What was painted on the very voxels of its volume and is not smoothed: there at once. Nothing else.
pub fn painted(slot: &SelectionSlot, volume: &Volume) -> Option<Arc<Selections>> {
    let voxels = slot.voxels.as_ref().filter(|_| slot.smooth_voxels.unwrap_or(0.0) == 0.0)?;
    let selection = voxels.selection();
    same_grid(selection.grid(), &volume.grid).then(|| {
        let structures = vec![structure(slot, selection.clone())];
        Arc::new(Selections { structures, ..Selections::default() })
    })
}

/// The structure that was painted in a slot.
fn structure(slot: &SelectionSlot, selection: Selection) -> Structure {
    Structure { label: Label { id: 1, name: slot.name.clone(), color: PAINTED, code: None }, selection }
}

/// Loads the volume of each slot: the replacements in order, then what the template names (relative to `folder`).
fn load_volumes(
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
                return filtered(slot, r.source.load(&r.options, progress)?, progress);
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
    let read = || {
        let volume =
            VolumeSource::parse(&slot.file, folder)?.load(&ReadOptions { limits, ..slot.options()? }, progress)?;
        filtered(slot, volume, progress)
    };
    read().with_context(|| format!("the template's volume \"{}\" cannot be loaded", slot.name))
}

/// What was read for a slot, after its filters.
///
/// # Errors
/// One sentence; that it was cancelled.
pub fn filtered(slot: &VolumeSlot, volume: Arc<Volume>, progress: &Progress) -> Result<Arc<Volume>> {
    let apply = |volume: Arc<Volume>, filter: &FilterTemplate| filter.filter().apply(&volume, progress).map(Arc::new);
    Ok(slot.filters.iter().try_fold(volume, apply)?)
}

#[cfg(test)]
mod tests {
    use fabrica_engine::selection::{Limits as Where, Shape};
    use fabrica_engine::spaces::Grid;
    use fabrica_engine::volume::{Rescale, Voxels};
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::figure::template::SelectionVoxels;

    #[test]
    fn what_was_painted_goes_to_other_data_where_it_can() {
        let grid = |scale: f64, by: f64| {
            let affine = DAffine3::from_translation(DVec3::splat(by)) * DAffine3::from_scale(DVec3::splat(scale));
            Grid::new([40; 3], affine).unwrap()
        };
        let volume = |grid: Grid| {
            let voxels = Voxels::U8(vec![1; grid.num_voxels()]);
            Volume::new(grid, voxels, Rescale::IDENTITY, "test").unwrap()
        };
        let pool = Arc::new(BrickPool::default());
        let ball = Shape::ball(DVec3::splat(20.0), 9.0);
        let ball = ball.select(&grid(1.0, 0.0), &Where::default(), &pool, &Progress::new()).unwrap();
        let slot = SelectionSlot::painted("Ball", "v", SelectionVoxels::new(ball.clone()));
        let load = |grid| load_selections(&slot, Path::new(""), &volume(grid), &Progress::new()).unwrap();
        let same = load(grid(1.0, 0.0));
        assert!(same.notes.is_empty() && same.structures[0].selection.changed_since(&ball).is_empty());
        assert_eq!(same.structures[0].label.name, "Ball");
        let finer = load(grid(0.8, 4.0));
        assert!(finer.notes[0].contains("resampled"), "{:?}", finer.notes);
        let ml = finer.structures[0].selection.volume_ml();
        assert!((ml / ball.volume_ml() - 1.0).abs() < 0.02, "{ml} of {} ml", ball.volume_ml());
        let elsewhere = load(grid(1.0, 500.0));
        assert!(elsewhere.structures.is_empty() && elsewhere.notes[0].contains("left out"), "{:?}", elsewhere.notes);
    }
}
