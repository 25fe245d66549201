//! `fabrica measure`: what accuracy costs on this scene and this adapter, as a table, as JSON and as a plot.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use fabrica_engine::Progress;
use fabrica_engine::gpu::AdapterChoice;
use fabrica_engine::measure::{Converged, Deviation, Row, default_settings, measure};
use fabrica_engine::scene::Quality;
use serde::Serialize;

use super::plot::{self, Plot};
use super::progress_bar::Bar;
use super::setup::{self, Adapter, BordersName, Stage};
use super::{UsageError, print_line, volumes};
use crate::memory;

const AFTER_HELP: &str = "\
Each setting gets the median time of a frame, the samples on a ray, and the error against the f64 reference,
refined until it stands still. A figure with regions has its named qualities once more with borders by two
look-ups, as \"two\" (docs/rendering.md §8). * marks the Pareto front: nothing else is as fast and as accurate.
The reference is slow and takes memory: measure small volumes (128 voxels a side) and small pictures.
docs/bench.md has the fields of the JSON.";

#[derive(clap::Args, Debug)]
#[command(after_long_help = AFTER_HELP)]
pub struct Arguments {
    /// The template (JSON).
    template: PathBuf,
    #[command(flatten)]
    volumes: volumes::Arguments,
    /// Pixels of the picture.
    #[arg(long, value_name = "WxH", value_parser = setup::parse_size, default_value = "128x128")]
    size: [u32; 2],
    /// Frames whose times make the median of a setting; one more is drawn before.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: u32,
    /// software, hardware, or a part of an adapter's name (see `fabrica adapters`).
    #[arg(long, value_name = "NAME", default_value = "auto")]
    adapter: AdapterChoice,
    /// Write all numbers into this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Draw error against time into this file, an SVG or a PNG by its ending.
    #[arg(long, value_name = "FILE.svg|png")]
    plot: Option<PathBuf>,
    /// Write the refined reference into this file, for other programs to be compared with: float32 (height, width, 4),
    /// premultiplied linear RGBA without background, row 0 = top, NaN where it did not settle.
    #[arg(long, value_name = "FILE.npy")]
    reference: Option<PathBuf>,
    /// A folder of lit-sphere pictures (square PNGs or JPEGs), used beside the built-in styles.
    #[arg(long, value_name = "DIR")]
    styles: Option<PathBuf>,
}

/// What `--json` writes.
#[derive(Serialize)]
struct Report {
    fabrica: &'static str,
    template: String,
    title: String,
    dims: [usize; 3],
    size: [u32; 2],
    frames: u32,
    adapter: Adapter,
    reference: ReferenceReport,
    settings: Vec<Setting>,
    peak_memory_mb: Option<f64>,
}

#[derive(Serialize)]
struct ReferenceReport {
    seconds: f64,
    num_pixels: usize,
    num_unsettled: usize,
}

#[derive(Serialize)]
struct Setting {
    step_voxels: f64,
    style_change: f64,
    termination: f64,
    quality: Option<&'static str>,
    borders: BordersName,
    ms: f64,
    samples_per_ray: f64,
    codes: Deviation,
    linear: Deviation,
    pareto: bool,
}

impl From<&Row> for Setting {
    fn from(row: &Row) -> Self {
        Self {
            step_voxels: row.quality.step_voxels,
            style_change: row.quality.style_change,
            termination: row.quality.termination,
            quality: setup::quality_name(row.quality),
            borders: row.quality.borders.into(),
            ms: row.ms,
            samples_per_ray: row.samples_per_ray,
            codes: row.difference.codes,
            linear: row.difference.linear,
            pareto: row.pareto,
        }
    }
}

/// Measures and reports.
pub fn run(arguments: &Arguments, matches: &clap::ArgMatches) -> Result<()> {
    let kind = arguments.plot.as_deref().map(plot_kind).transpose()?;
    for path in [&arguments.json, &arguments.plot, &arguments.reference].into_iter().flatten() {
        setup::check_writable(path)?;
    }
    let progress = Progress::new();
    let bar = Bar::watch(&progress);
    let Arguments { template, volumes, adapter, styles, .. } = arguments;
    let mut stage = Stage::load(template, volumes, adapter, styles.as_ref(), matches, &progress)?;
    check_memory(&stage)?;
    let start = Instant::now();
    let converged = Converged::of(&stage.scene, arguments.size, &progress)?;
    let seconds = start.elapsed().as_secs_f64();
    // Before the measurements: it took the time, and whoever stops them has it.
    if let Some(path) = &arguments.reference {
        setup::save_npy(path, converged.size, &settled_pixels(&converged))?;
    }
    let settings = default_settings(&stage.scene);
    let rows = measure(&mut stage.renderer, &stage.scene, &converged, &settings, arguments.frames, &progress)?;
    drop(bar);

    let report = Report {
        fabrica: env!("CARGO_PKG_VERSION"),
        template: arguments.template.display().to_string(),
        title: stage.template.title.clone(),
        dims: stage.dims(),
        size: arguments.size,
        frames: arguments.frames,
        adapter: Adapter::from(&stage.renderer.context().adapter),
        reference: ReferenceReport {
            seconds,
            num_pixels: converged.pixels.len(),
            num_unsettled: converged.num_unsettled,
        },
        settings: rows.iter().map(Setting::from).collect(),
        peak_memory_mb: setup::peak_memory_mb(),
    };
    print_line(&table(&report))?;
    if let Some(path) = &arguments.json {
        setup::save_text(path, &(serde_json::to_string_pretty(&report)? + "\n"))?;
    }
    if let (Some(path), Some(kind)) = (&arguments.plot, kind) {
        let svg = plot_of(&report).svg();
        match kind {
            plot::Kind::Svg => setup::save_text(path, &svg)?,
            plot::Kind::Png => plot::save_png(path, &svg).context("the plot was not written")?,
        }
    }
    Ok(())
}

/// The reference's pixels, NaN where they did not settle.
fn settled_pixels(converged: &Converged) -> Vec<[f32; 4]> {
    let pixels = converged.pixels.iter().zip(&converged.unsettled);
    pixels.map(|(pixel, unsettled)| if *unsettled { [f32::NAN; 4] } else { pixel.map(|c| c as f32) }).collect()
}

fn plot_kind(path: &Path) -> Result<plot::Kind> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "svg" => Ok(plot::Kind::Svg),
        "png" => Ok(plot::Kind::Png),
        _ => Err(UsageError::because(format!(
            "--plot {} is neither SVG nor PNG; give it the ending .svg or .png",
            path.display()
        ))),
    }
}

/// The reference keeps three f64 a voxel and makes a fourth on the way: better refused than killed.
fn check_memory(stage: &Stage) -> Result<()> {
    let needed_mb = stage.dims().map(|n| n as f64).iter().product::<f64>() * 4.0 * 8.0 / 1e6;
    match memory::free_bytes().map(|bytes| bytes as f64 / 1e6) {
        Some(free_mb) if needed_mb > free_mb => bail!(
            "the reference needs {:.1} GB for this volume and {:.1} GB are free; measure a smaller volume",
            needed_mb / 1e3,
            free_mb / 1e3
        ),
        _ => Ok(()),
    }
}

fn table(report: &Report) -> String {
    let mut lines = vec![
        format!(
            "{} ({}, {}, {}); {} x {} pixels, median of {} frames",
            report.adapter.name,
            report.adapter.driver,
            report.adapter.backend,
            report.adapter.kind,
            report.size[0],
            report.size[1],
            report.frames
        ),
        reference_line(report),
        String::new(),
        format!("{:42}{:>8}{:>10}{:>30}{:>30}", "", "time", "samples", "error, 8-bit codes", "error, linear x 1000"),
        format!(
            "  {:>8} {:>6} {:>8}  {:12} {:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}",
            "step", "change", "end", "", "ms/frame", "per ray", "RMSE", "p99.9", "max", "RMSE", "p99.9", "max"
        ),
    ];
    for s in &report.settings {
        let mut line = format!(
            "{} {:>8} {:>6} {:>8}  {:12} {:>10.3}{:>10.1}",
            if s.pareto { '*' } else { ' ' },
            s.step_voxels,
            setup::significant(s.style_change),
            setup::fraction_text(s.termination),
            match s.borders {
                BordersName::Exact => s.quality.unwrap_or_default().to_owned(),
                BordersName::TwoLookUps => format!("{} two", s.quality.unwrap_or_default()),
            },
            s.ms,
            s.samples_per_ray
        );
        for deviation in [s.codes.rmse, s.codes.p999, s.codes.max] {
            line += &format!("{deviation:>10.3}");
        }
        for deviation in [s.linear.rmse, s.linear.p999, s.linear.max] {
            line += &format!("{:>10.3}", deviation * 1e3);
        }
        lines.push(line);
    }
    lines.join("\n")
}

fn reference_line(report: &Report) -> String {
    format!(
        "reference: {} of {} pixels did not settle and are left out; {:.1} s",
        report.reference.num_unsettled, report.reference.num_pixels, report.reference.seconds
    )
}

fn plot_of(report: &Report) -> Plot {
    let title = if report.title.is_empty() { &report.template } else { &report.title };
    let reference = &report.reference;
    Plot {
        title: format!("{title}: accuracy against time"),
        notes: vec![
            format!("{}, {}, {}", report.adapter.name, report.adapter.backend, report.adapter.kind),
            format!(
                "{} × {} × {} voxels, {} × {} pixels, median of {} frames; {} of {} pixels ({:.2} %) left out as unsettled",
                report.dims[0],
                report.dims[1],
                report.dims[2],
                report.size[0],
                report.size[1],
                report.frames,
                reference.num_unsettled,
                reference.num_pixels,
                100.0 * reference.num_unsettled as f64 / reference.num_pixels as f64
            ),
        ],
        points: report
            .settings
            .iter()
            // The plot is about steps and style changes.
            .filter(|s| s.borders == BordersName::Exact)
            .map(|s| plot::Point {
                ms: s.ms,
                p999: s.codes.p999,
                rmse: s.codes.rmse,
                // Rounded, so that settings with the same ratio have the same mark.
                relative_change: {
                    let ratio = s.style_change / Quality::balanced(s.step_voxels).style_change;
                    (1e3 * ratio).round() / 1e3
                },
                name: s.quality,
                step: s.step_voxels,
            })
            .collect(),
    }
}
