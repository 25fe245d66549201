//! `fabrica select`: selections of a volume by steps, into a file, with what they measure.

mod grammar;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, anyhow};
use clap::ArgMatches;
use fabrica_engine::error::printable;
use fabrica_engine::selection::{
    BrickPool, Combination, Connectivity, Edge, Holes, Limits, Seeds, Selection, Shape, Structure, from_label_maps,
    make_distinct, read_selections, select_grown, select_range, write_fractional, write_segmentation,
};
use fabrica_engine::specimen::Request;
use fabrica_engine::volume::Volume;
use fabrica_engine::volume::labels::{Label, distinct_color, resample_layers};
use fabrica_engine::{Error, Progress};
use glam::{DMat3, DVec3};
use grammar::{Border, Place, Reach, Source};
use serde::Serialize;

use super::progress_bar::Bar;
use super::{UsageError, print_line, reading};
use crate::figure::source::VolumeSource;

#[derive(clap::Args, Debug)]
#[command(after_long_help = grammar::HELP)]
pub struct Arguments {
    /// A volume file, a folder, or specimen:NAME[@N][,VARIANT].
    file_or_dir: String,
    /// Begin the next selection.
    #[arg(long, value_name = "NAME")]
    name: Vec<String>,
    /// Add to the selection: "range 150..3000", "ball R,A,S r=MM", "labels FILE:liver" ... (--help lists them all).
    #[arg(long, value_name = "WHAT", allow_hyphen_values = true)]
    add: Vec<Source>,
    /// Take from the selection.
    #[arg(long, value_name = "WHAT", allow_hyphen_values = true)]
    subtract: Vec<Source>,
    /// Keep of the selection only this part.
    #[arg(long, value_name = "WHAT", allow_hyphen_values = true)]
    intersect: Vec<Source>,
    /// Begin a selection for each structure of a label map; the steps behind it are done to all of them, up to the next
    /// --name or --labels.
    #[arg(long, value_name = "FILE[:NAME,...]")]
    labels: Vec<String>,
    /// Select what was not.
    #[arg(long, num_args = 0, action = clap::ArgAction::Append, default_missing_value = "true", value_name = "")]
    invert: Vec<bool>,
    /// Move the surface outward.
    #[arg(long, value_name = "MM", value_parser = parse_mm, allow_negative_numbers = true)]
    grow_mm: Vec<f64>,
    /// Move the surface inward.
    #[arg(long, value_name = "MM", value_parser = parse_mm, allow_negative_numbers = true)]
    shrink_mm: Vec<f64>,
    /// Smooth with a Gaussian of this standard deviation; the volume stays, as a whole.
    #[arg(long, value_name = "MM", value_parser = parse_mm, allow_negative_numbers = true)]
    smooth_mm: Vec<f64>,
    /// Fill what is enclosed: in space, or in every slice across an axis of the grid (x, y or z).
    #[arg(long, num_args = 0..=1, default_missing_value = "space", value_name = "AXIS", value_parser = parse_holes)]
    fill_holes: Vec<Holes>,
    /// Keep the largest island, or the N largest.
    #[arg(long, num_args = 0..=1, default_missing_value = "1", value_name = "N")]
    keep_largest: Vec<usize>,
    /// Take islands of less than this volume out.
    #[arg(long, value_name = "ML", value_parser = parse_mm, allow_negative_numbers = true)]
    remove_smaller: Vec<f64>,
    /// Where to write the selections: FILE.seg.nrrd (in or out) or FILE.nrrd (how far in).
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print what they measure as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reading: reading::Arguments,
}

/// A number of at least 0.
fn parse_mm(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| n.is_finite() && *n >= 0.0);
    number.ok_or_else(|| "write a number of at least 0".to_owned())
}

fn parse_holes(text: &str) -> Result<Holes, String> {
    match text {
        "space" => Ok(Holes::InSpace),
        "x" => Ok(Holes::InSlices(0)),
        "y" => Ok(Holes::InSlices(1)),
        "z" => Ok(Holes::InSlices(2)),
        _ => Err("write x, y or z for slices across that axis of the grid, or nothing".to_owned()),
    }
}

/// One thing to do.
#[derive(Clone, Debug)]
enum Step {
    Name(String),
    Labels(String),
    Put(Combination, Source),
    Invert,
    GrowMm(f64),
    SmoothMm(f64),
    FillHoles(Holes),
    KeepLargest(usize),
    RemoveSmaller(f64),
}

impl Arguments {
    /// The steps in the order of the command line.
    fn steps(&self, matches: &ArgMatches) -> Vec<Step> {
        let mut steps: Vec<(usize, Step)> = Vec::new();
        let mut add = |option: &str, of_option: Vec<Step>| {
            let places = matches.indices_of(option).map(Iterator::collect::<Vec<_>>).unwrap_or_default();
            steps.extend(places.into_iter().zip(of_option));
        };
        let put = |how: Combination, sources: &[Source]| sources.iter().map(|s| Step::Put(how, s.clone())).collect();
        add("name", self.name.iter().cloned().map(Step::Name).collect());
        add("labels", self.labels.iter().cloned().map(Step::Labels).collect());
        add("add", put(Combination::Union, &self.add));
        add("subtract", put(Combination::Subtract, &self.subtract));
        add("intersect", put(Combination::Intersect, &self.intersect));
        add("invert", self.invert.iter().map(|_| Step::Invert).collect());
        add("grow_mm", self.grow_mm.iter().map(|mm| Step::GrowMm(*mm)).collect());
        add("shrink_mm", self.shrink_mm.iter().map(|mm| Step::GrowMm(-mm)).collect());
        add("smooth_mm", self.smooth_mm.iter().map(|mm| Step::SmoothMm(*mm)).collect());
        add("fill_holes", self.fill_holes.iter().map(|holes| Step::FillHoles(*holes)).collect());
        add("keep_largest", self.keep_largest.iter().map(|n| Step::KeepLargest(*n)).collect());
        add("remove_smaller", self.remove_smaller.iter().map(|ml| Step::RemoveSmaller(*ml)).collect());
        steps.sort_by_key(|(place, _)| *place);
        steps.into_iter().map(|(_, step)| step).collect()
    }

    /// Which kind of file is to be written.
    fn is_binary(&self) -> Result<bool> {
        let Some(path) = &self.out else { return Ok(false) };
        let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
        if !name.ends_with(".nrrd") {
            let shown = path.display();
            return Err(UsageError::because(format!(
                "selections are written as NRRD; end the file's name in .seg.nrrd (in or out) or .nrrd (how far in) ({shown})"
            )));
        }
        Ok(name.ends_with(".seg.nrrd"))
    }
}

/// Reads, does the steps, writes and reports.
pub fn run(arguments: &Arguments, matches: &ArgMatches) -> Result<()> {
    let source =
        VolumeSource::parse(&arguments.file_or_dir, Path::new("")).map_err(|e| UsageError::because(e.to_string()))?;
    let is_binary = arguments.is_binary()?;
    let steps = arguments.steps(matches);
    if steps.iter().all(|step| matches!(step, Step::Name(_))) {
        let what = "there is nothing to select; add a step, for example --add \"range 150..\"";
        return Err(UsageError::because(what));
    }
    let progress = Progress::new();
    let bar = Bar::watch(&progress);
    let volume = source.load(&arguments.reading.options(), &progress)?;
    let mut work = Work { volume, pool: Arc::default(), done: Vec::new(), first: 0, notes: Vec::new(), progress };
    for step in steps {
        work.take(step)?;
    }
    let Work { volume, done, mut notes, progress, .. } = work;
    for structure in done.iter().filter(|s| s.selection.is_empty()) {
        notes.push(format!("The selection `{}` is empty.", printable(structure.label.name.clone())));
    }
    if let Some(path) = &arguments.out {
        let write = if is_binary { write_segmentation } else { write_fractional };
        write(path, &done, &progress)?;
    }
    let report = Report { selections: done.iter().map(|s| Measured::of(s, &volume)).collect(), notes };
    drop(bar);
    print_line(&if arguments.json { serde_json::to_string_pretty(&report)? } else { report.in_words() })
}

/// What the steps work on.
struct Work {
    volume: Arc<Volume>,
    pool: Arc<BrickPool>,
    done: Vec<Structure>,
    /// From which selection on steps apply.
    first: usize,
    notes: Vec<String>,
    progress: Progress,
}

impl Work {
    fn take(&mut self, step: Step) -> Result<()> {
        match step {
            Step::Name(name) => self.begin(name)?,
            Step::Labels(text) => {
                let structures = self.structures(&text)?;
                self.first = self.done.len();
                self.done.extend(structures);
                // An atlas and what was named before may share names.
                let mut names: Vec<String> = self.done.iter().map(|s| s.label.name.clone()).collect();
                make_distinct(&mut names);
                self.done.iter_mut().zip(names).for_each(|(s, name)| s.label.name = name);
            }
            step => {
                if self.done.is_empty() {
                    self.begin("Selection 1".to_owned())?;
                }
                let what = match &step {
                    Step::Put(_, source) => Some(self.made(source)?),
                    _ => None,
                };
                let progress = &self.progress;
                for Structure { selection, .. } in &mut self.done[self.first..] {
                    match (&step, &what) {
                        (Step::Put(how, _), Some(what)) => selection.combine(what, *how).map_err(|e| anyhow!(e))?,
                        (Step::GrowMm(mm), _) => selection.grow_mm(*mm, progress)?,
                        (Step::SmoothMm(mm), _) => selection.smooth_mm(*mm, true, progress)?,
                        (Step::FillHoles(holes), _) => selection.fill_holes(*holes, progress)?,
                        (Step::KeepLargest(n), _) => selection.keep_largest(*n, Connectivity::Faces, progress)?,
                        (Step::RemoveSmaller(ml), _) => selection.remove_smaller(*ml, Connectivity::Faces, progress)?,
                        _ => selection.invert(),
                    };
                }
            }
        }
        Ok(())
    }

    fn begin(&mut self, name: String) -> Result<()> {
        if self.done.iter().any(|s| s.label.name == name) {
            return Err(UsageError::because(format!("there are two selections `{name}`; give each its own --name")));
        }
        self.first = self.done.len();
        let id = self.done.iter().map(|s| s.label.id).max().unwrap_or(0).saturating_add(1);
        let label = Label { id, name, color: distinct_color(id), code: None };
        self.done.push(Structure { label, selection: Selection::empty(self.volume.grid, &self.pool) });
        Ok(())
    }

    /// What a step puts in, as a selection.
    fn made(&mut self, source: &Source) -> Result<Selection> {
        let grid = self.volume.grid;
        let none = Limits::default();
        let at_mm = |place: &Place| match *place {
            Place::Mm(mm) => DVec3::from_array(mm),
            Place::Voxel(at) => grid.world_from_index().transform_point3(DVec3::from_array(at)),
        };
        let edge = |border: &Border| match *border {
            Border::PartialVolume => Edge::PartialVolume,
            Border::Crisp => Edge::Crisp,
            Border::Linear(width) => Edge::Linear(width),
        };
        Ok(match source {
            Source::Range { bounds, border } => {
                select_range(&self.volume, *bounds, edge(border), &self.pool, &self.progress)?
            }
            Source::Ball { center, radius_mm } => {
                Shape::ball(at_mm(center), *radius_mm).select(&grid, &none, &self.pool, &self.progress)?
            }
            Source::Cuboid { center, size_mm, turn_deg } => {
                let [x, y, z] = turn_deg.map(f64::to_radians);
                let axes = DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
                let shape = Shape::cuboid(at_mm(center), DVec3::from_array(*size_mm), axes);
                shape.select(&grid, &none, &self.pool, &self.progress)?
            }
            Source::Grow { seeds, barred, reach, corners, border } => {
                let voxels = |places: &[Place]| places.iter().map(|p| self.voxel(at_mm(p))).collect::<Result<Vec<_>>>();
                let (within, tolerance) = match *reach {
                    Reach::Tolerance(tolerance) => (None, tolerance),
                    Reach::Within(bounds) => (Some(bounds), 0.0),
                };
                let connectivity = if *corners { Connectivity::Corners } else { Connectivity::Faces };
                let seeds = Seeds { seeds: voxels(seeds)?, barred: voxels(barred)?, within, connectivity };
                select_grown(&self.volume, &seeds, tolerance, edge(border), &self.pool, &self.progress)?
            }
            Source::Labels(text) => {
                let mut all = Selection::empty(grid, &self.pool);
                for structure in self.structures(text)? {
                    all.combine(&structure.selection, Combination::Union).map_err(|e| anyhow!(e))?;
                }
                all
            }
            Source::Selection(name) => {
                let known = self.done[..].iter().find(|s| s.label.name == *name);
                let fault =
                    || UsageError::because(format!("there is no selection `{name}` before its use; name it first"));
                known.ok_or_else(fault)?.selection.clone()
            }
        })
    }

    /// The voxel that a seed lies in.
    fn voxel(&self, mm: DVec3) -> Result<[usize; 3]> {
        let at = self.volume.grid.index_from_world().transform_point3(mm).round();
        let dims = self.volume.grid.dims();
        if (0..3).any(|a| !(at[a] >= 0.0 && at[a] < dims[a] as f64)) {
            let [x, y, z] = mm.to_array();
            return Err(Error::scene(
                format!("the seed {x}, {y}, {z} mm lies outside of the scan"),
                "see where the scan lies with `fabrica inspect`, or name a voxel: 120,80,44vox",
            )
            .into());
        }
        Ok(at.to_array().map(|n| n as usize))
    }

    /// The structures of FILE[:NAME,NAME...] on the volume's grid.
    fn structures(&mut self, text: &str) -> Result<Vec<Structure>> {
        let (file, names) = split_names(text);
        let (structures, notes) = match file.strip_prefix("specimen:") {
            Some(specimen) => {
                let request = Request::parse(specimen).map_err(|e| UsageError::because(e.to_string()))?;
                let labels = request.generate(&self.progress)?.labels;
                let elsewhere = |what: String| anyhow!("{what}; name the specimen that the volume is ({file})");
                let (layers, note) = resample_layers(vec![labels], &self.volume.grid).map_err(elsewhere)?;
                (from_label_maps(&layers, &self.pool, &self.progress)?, note.into_iter().collect())
            }
            None => read_selections(Path::new(file), &self.volume.grid, &self.pool, &self.progress)?,
        };
        for note in notes {
            if !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
        let Some(names) = names else { return Ok(structures) };
        let mut chosen = Vec::new();
        for name in names.split(',').map(str::trim) {
            let by_name = structures.iter().find(|s| s.label.name == name);
            let found = by_name.or_else(|| structures.iter().find(|s| s.label.id.to_string() == name));
            chosen.push(found.cloned().ok_or_else(|| {
                let some: Vec<&str> = structures.iter().map(|s| s.label.name.as_str()).take(8).collect();
                let what = format!(
                    "it has no structure `{name}`; the first of its {} are {}",
                    structures.len(),
                    some.join(", ")
                );
                Error::file(Path::new(file), what, "list them all with `fabrica inspect`")
            })?);
        }
        Ok(chosen)
    }
}

/// The file, and the names behind its last colon. What exists as it stands has none.
fn split_names(text: &str) -> (&str, Option<&str>) {
    match text.rsplit_once(':') {
        Some((file, names)) if file != "specimen" && !names.contains(['/', '\\']) && !Path::new(text).exists() => {
            (file, Some(names))
        }
        _ => (text, None),
    }
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    selections: Vec<Measured>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Measured {
    name: String,
    color: String,
    code: Option<String>,
    /// Voxels that are partly in count in part.
    num_voxels: f64,
    volume_ml: f64,
    /// First and, exclusive, last voxel along x, y, z.
    index_box: Option<[[usize; 2]; 3]>,
    /// Smallest and largest R, A, S of that box of voxels, mm.
    box_mm: Option<[[f64; 3]; 2]>,
    /// The scan's, voxels that are partly in weighing so much.
    mean: Option<f64>,
}

impl Measured {
    fn of(structure: &Structure, volume: &Volume) -> Self {
        let Structure { label, selection } = structure;
        let [r, g, b] = label.color;
        let box_mm = selection.bounds().map(|bounds| {
            let corner = |end: usize| DVec3::from_array(bounds.map(|b| b[end] as f64 - 0.5));
            let corners = selection.grid().box_corners_mm(corner(0), corner(1));
            [DVec3::min, DVec3::max].map(|f| corners.into_iter().reduce(f).unwrap_or_default().to_array())
        });
        Self {
            name: label.name.clone(),
            color: format!("#{r:02x}{g:02x}{b:02x}"),
            code: label.code.clone(),
            num_voxels: selection.num_voxels(),
            volume_ml: selection.volume_ml(),
            index_box: selection.bounds(),
            box_mm,
            mean: selection.mean_of(volume),
        }
    }
}

impl Report {
    fn in_words(&self) -> String {
        let width = self.selections.iter().map(|s| s.name.chars().count()).max().unwrap_or(0).clamp(4, 40);
        let mut lines = vec![format!("{:width$} {:>12} {:>10}  R, A, S in mm", "name", "ml", "mean")];
        for s in &self.selections {
            let range = |a: usize| match s.box_mm {
                Some([low, high]) => format!("{:.1} to {:.1}", low[a], high[a]),
                None => "none".to_owned(),
            };
            let mean = s.mean.map(|m| format!("{m:.1}")).unwrap_or_default();
            let place = if s.box_mm.is_some() { [0, 1, 2].map(range).join(", ") } else { "empty".to_owned() };
            lines.push(format!("{:width$} {:>12.3} {mean:>10}  {place}", printable(s.name.clone()), s.volume_ml));
        }
        lines.extend(self.notes.iter().map(|n| format!("note: {n}")));
        lines.join("\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_behind_the_last_colon() {
        assert_eq!(split_names("a.nii.gz:liver,spleen"), ("a.nii.gz", Some("liver,spleen")));
        assert_eq!(split_names("a.nii.gz"), ("a.nii.gz", None));
        assert_eq!(split_names("specimen:head@64"), ("specimen:head@64", None));
        assert_eq!(split_names("specimen:head@64:skull"), ("specimen:head@64", Some("skull")));
        assert_eq!(split_names("C:\\scans\\a.nii"), ("C:\\scans\\a.nii", None));
    }
}
