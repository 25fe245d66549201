//! `fabrica inspect`: what a volume is, for people and for scripts.

mod structures;

use std::path::Path;

use anyhow::Result;
use fabrica_engine::read;
use fabrica_engine::volume::statistics::Statistics;
use fabrica_engine::volume::{Volume, type_in_words};
use fabrica_engine::{Error, Progress};
use serde::Serialize;
use structures::Listing;

use super::progress_bar::Bar;
use super::{UsageError, print_line, reading, survey};
use crate::figure::source::VolumeSource;

/// What `--help` says about specimens: here, and nowhere else.
const SPECIMENS: &str = "\
Specimens are data sets that Fabrica makes itself, with their label maps: specimen:NAME[@N][,WORD]...

  NAME    head, turtle or engine
  N       voxels along the longest axis, 16 to 1024 (default 256)
  WORD    how it differs from the plain one; each at most once, in any order:
    size=F          F times as large
    turn=R/A/S      degrees about the axes right, front and up, in this order
    drawn-in=F      the turtle's head drawn in: 0 (stretched out) to 1
    mirrored        left and right exchanged
    without=A+B     structures left out, named as inspect lists them, - for spaces;
                    the lower teeth go with the mandible
    mr              MRI-like contrast with a bias field (not the engine: metal)
    noise=SD        standard deviation of the noise, in units of the values
    slope=F         values times F ...
    offset=V        ... plus V: a scanner off its calibration

  For example: specimen:head@128,size=1.15,turn=10/0/-5,without=mandible,noise=20

A specimen goes wherever a volume goes: as an argument, after --volume, and in a template.";

#[derive(clap::Args, Debug)]
#[command(after_long_help = SPECIMENS)]
pub struct Arguments {
    /// A volume file, a folder, or specimen:NAME[@N][,VARIANT] (--help lists them).
    file_or_dir: String,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reading: reading::Arguments,
    /// Only list the volumes that there are, and what they take, without reading them.
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    labels: structures::Arguments,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    format: String,
    modality: String,
    dims: [usize; 3],
    num_frames: usize,
    spacing_mm: [f64; 3],
    size_mm: [f64; 3],
    orientation: String,
    /// Whether the file says it; else it was assumed, and a warning says how.
    orientation_known: bool,
    obliquity_deg: f64,
    left_handed: bool,
    /// Rows of the 4×4 matrix without its last.
    world_from_index: [[f64; 4]; 3],
    datatype: &'static str,
    rescale_slope: f64,
    rescale_intercept: f64,
    bytes: usize,
    num_finite: u64,
    num_nonfinite: u64,
    min: f64,
    max: f64,
    mean: f64,
    /// Otsu's threshold: percentiles in templates are of the finite voxels above it.
    background: f64,
    num_above_background: u64,
    percentiles: Vec<Percentile>,
    /// Counts of equal bins from min to max.
    histogram: Vec<u64>,
    warnings: Vec<String>,
    /// Of the label map that was asked for, or is the volume itself.
    #[serde(flatten)]
    listing: Listing,
}

#[derive(Serialize)]
struct Percentile {
    percent: f64,
    all: f64,
    above_background: f64,
}

const PERCENTS: [f64; 9] = [0.1, 1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0, 99.9];

/// Reads and reports.
pub fn run(arguments: &Arguments) -> Result<()> {
    let source =
        VolumeSource::parse(&arguments.file_or_dir, Path::new("")).map_err(|e| UsageError::because(e.to_string()))?;
    let progress = Progress::new();
    let bar = Bar::watch(&progress);
    let options = arguments.reading.options();
    if let (true, VolumeSource::Path(path)) = (arguments.list, &source) {
        let entries = read::survey(path, &options, &progress)?;
        drop(bar);
        return survey::print(&entries, options.window, arguments.json);
    }
    let volume = match source.load(&options, &progress) {
        // Who asks what is there gets to see it.
        Err(error) => match error.downcast_ref() {
            Some(Error::Several { entries, .. }) => {
                drop(bar);
                return survey::print(entries, options.window, arguments.json);
            }
            _ => return Err(error),
        },
        Ok(volume) => volume,
    };
    let mut report = report(&volume, volume.statistics(&progress)?);
    let numbers = arguments.reading.numbers();
    let (listing, guess) = Listing::of(&arguments.labels, &source, &options, numbers, &volume, &progress)?;
    report.listing = listing;
    report.warnings.extend(guess.map(|guess| format!("{guess} {}", reading::AS_SCAN)));
    drop(bar);
    print_line(&if arguments.json { serde_json::to_string_pretty(&report)? } else { in_words(&report) })
}

fn report(volume: &Volume, statistics: &Statistics) -> Report {
    let grid = &volume.grid;
    let affine = grid.world_from_index();
    let spacing = grid.spacing_mm();
    let row = |i: usize| [affine.x_axis[i], affine.y_axis[i], affine.z_axis[i], affine.translation[i]];
    Report {
        format: volume.format.clone(),
        modality: format!("{:?}", volume.modality).to_lowercase(),
        dims: grid.dims(),
        num_frames: volume.num_frames,
        spacing_mm: spacing.to_array(),
        size_mm: std::array::from_fn(|i| spacing[i] * grid.dims()[i] as f64),
        orientation: grid.orientation_letters(),
        orientation_known: volume.orientation.is_known(),
        obliquity_deg: grid.obliquity_deg(),
        left_handed: grid.is_left_handed(),
        world_from_index: [row(0), row(1), row(2)],
        datatype: if volume.colors.is_some() { "colors" } else { volume.voxels.type_name() },
        rescale_slope: volume.rescale.slope,
        rescale_intercept: volume.rescale.intercept,
        bytes: volume.num_bytes(),
        num_finite: statistics.num_finite,
        num_nonfinite: statistics.num_nonfinite,
        min: statistics.min,
        max: statistics.max,
        mean: statistics.mean,
        background: statistics.background,
        num_above_background: statistics.num_above_background(),
        percentiles: PERCENTS
            .map(|percent| Percentile {
                percent,
                all: statistics.percentile(percent),
                above_background: statistics.percentile_above_background(percent),
            })
            .into(),
        histogram: statistics.histogram.clone(),
        warnings: volume.warnings.clone(),
        listing: Listing::default(),
    }
}

/// Up to six significant digits, without the noise of binary fractions.
fn short(x: f64) -> String {
    if x != 0.0 && (x.abs() >= 1e7 || x.abs() < 1e-4) {
        return format!("{x:.4e}");
    }
    let digits = 5 - (x.abs().max(1.0).log10().floor() as i32);
    let text = format!("{x:.*}", digits.clamp(0, 6) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

fn in_words(r: &Report) -> String {
    let by = |v: &[f64; 3]| v.map(short).join(" x ");
    let mut lines = vec![
        format!(
            "{}, {} x {} x {} voxels, {}{}",
            r.format,
            r.dims[0],
            r.dims[1],
            r.dims[2],
            type_in_words(r.datatype),
            if r.num_frames > 1 { format!(", {} frames", r.num_frames) } else { String::new() }
        ),
        format!("spacing     {} mm; size {} mm", by(&r.spacing_mm), by(&r.size_mm)),
        format!(
            "orientation {}{}{}{}",
            r.orientation,
            if r.orientation_known { "" } else { " (assumed: the file does not say)" },
            if r.obliquity_deg > 0.05 { format!(", oblique by {:.1} degrees", r.obliquity_deg) } else { String::new() },
            if r.left_handed { ", left-handed grid" } else { "" }
        ),
    ];
    if !r.listing.is_of_volume {
        lines.extend(values_in_words(r));
    }
    lines.extend(r.warnings.iter().map(|w| format!("warning: {w}")));
    lines.extend(r.listing.in_words());
    lines.join("\n")
}

/// What the values are like; of numbers of structures, nothing of it has a meaning.
fn values_in_words(r: &Report) -> Vec<String> {
    let mut lines = vec![format!("values      {} to {}, mean {}", short(r.min), short(r.max), short(r.mean))];
    if (r.rescale_slope, r.rescale_intercept) != (1.0, 0.0) {
        lines.push(format!("rescale     value = stored x {} + {}", r.rescale_slope, r.rescale_intercept));
    }
    lines.push(format!(
        "background  {} and below (Otsu); {} of {} finite voxels lie above it",
        short(r.background),
        r.num_above_background,
        r.num_finite
    ));
    lines.push(format!("{:>12} {:>12} {:>18}", "percentile", "all voxels", "above background"));
    for p in &r.percentiles {
        lines.push(format!("{:>12} {:>12} {:>18}", p.percent, short(p.all), short(p.above_background)));
    }
    lines.push(format!("histogram   {} to {}, height logarithmic", short(r.min), short(r.max)));
    lines.extend(histogram(&r.histogram));
    lines
}

/// Bars of 64 columns and 6 rows of eighth blocks.
fn histogram(bins: &[u64]) -> Vec<String> {
    const ROWS: usize = 6;
    const BLOCKS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let columns: Vec<f64> =
        bins.chunks(bins.len().div_ceil(64).max(1)).map(|c| (c.iter().sum::<u64>() as f64).ln_1p()).collect();
    let highest = columns.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    (0..ROWS)
        .rev()
        .map(|row| {
            let bar = |h: &f64| {
                let eighths = h / highest * (8 * ROWS) as f64 - (8 * row) as f64;
                BLOCKS[eighths.round().clamp(0.0, 8.0) as usize]
            };
            format!("  |{}|", columns.iter().map(bar).collect::<String>())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (x, text) in [(0.0, "0"), (0.7370000001, "0.737"), (-1024.0, "-1024"), (1e30, "1.0000e30"), (255.0, "255")]
        {
            assert_eq!(short(x), text);
        }
    }
}
