//! `fabrica render`: template and volumes in, PNG out.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use fabrica_engine::estimate::{self, Estimate};
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::image_out::{PngOptions, save_atomic, write_png};
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::scene::{Borders, Quality};
use fabrica_engine::{Error, Progress};

use super::progress_bar::Bar;
use super::setup::{self, BordersName, parse_size, peak_memory_mb};
use super::{UsageError, volumes};
use crate::figure::template::{Background, Page, QualityName};
use crate::figure::theme::NO_THEME;
use crate::figure::{Template, bridge, sources};

#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// The template (JSON).
    template: PathBuf,
    #[command(flatten)]
    volumes: volumes::Arguments,
    /// Pixels of the picture; its dots per inch follow from the template's width in mm.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Dots per inch; the pixels follow from the template's size in mm. With --size: the width becomes pixels/dpi.
    #[arg(long, value_name = "N", value_parser = parse_positive)]
    dpi: Option<f64>,
    /// A theme, by name, in place of the template's (see `fabrica styles`); "none": none.
    #[arg(long, value_name = "NAME")]
    theme: Option<String>,
    /// transparent or #rrggbb, in place of the template's and of the theme's.
    #[arg(long, value_name = "COLOR")]
    background: Option<Background>,
    /// In place of the template's.
    #[arg(long, value_enum)]
    quality: Option<QualityName>,
    /// How the borders of regions are found (docs/rendering.md §8).
    #[arg(long, value_enum, default_value_t, conflicts_with_all = ["max_error", "budget_ms"])]
    borders: BordersName,
    /// Choose the cheapest setting whose error, of 99.9 % of the pixels, is estimated to be at most this many 8-bit codes.
    #[arg(long, value_name = "CODES", conflicts_with_all = ["quality", "budget_ms"], allow_negative_numbers = true, value_parser = parse_positive)]
    max_error: Option<f64>,
    /// Choose the most accurate setting that is expected to draw the picture in this time, on this adapter.
    #[arg(long, value_name = "T", conflicts_with = "quality", allow_negative_numbers = true, value_parser = parse_positive)]
    budget_ms: Option<f64>,
    /// software, hardware, or a part of an adapter's name (see `fabrica adapters`).
    #[arg(long, value_name = "NAME", default_value = "auto")]
    adapter: AdapterChoice,
    /// A folder of lit-sphere pictures (square PNGs or JPEGs), used beside the built-in styles.
    #[arg(long, value_name = "DIR")]
    styles: Option<PathBuf>,
    /// The PNG file to write.
    #[arg(long, value_name = "FILE.png")]
    out: PathBuf,
    /// Say what is done and how long it takes.
    #[arg(long, short)]
    verbose: bool,
}

fn parse_positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|d: &f64| d.is_finite() && *d > 0.0).ok_or_else(|| "write a positive number".to_owned())
}

/// Pixels and dpi of an export: `size` sets the pixels, `dpi` the resolution, each follows from the page otherwise.
fn pixels_and_dpi(page: &Page, size: Option<[u32; 2]>, dpi: Option<f64>) -> Result<([u32; 2], f64)> {
    const MM_PER_INCH: f64 = 25.4;
    match (size, dpi) {
        (Some(size), Some(dpi)) => Ok((size, dpi)),
        (Some(size), None) => Ok((size, f64::from(size[0]) / page.width_mm * MM_PER_INCH)),
        (None, dpi) => {
            let dpi = dpi.unwrap_or(page.dpi);
            let [w, h] = [page.width_mm, page.height_mm].map(|mm| (mm / MM_PER_INCH * dpi).round());
            let most = f64::from(fabrica_engine::render::MAX_IMAGE_EDGE);
            if !(1.0..=most).contains(&w) || !(1.0..=most).contains(&h) {
                anyhow::bail!(
                    "{} x {} mm at {dpi} dpi are {w} x {h} pixels; choose a dpi that gives 1 to {most} of them",
                    page.width_mm,
                    page.height_mm
                );
            }
            Ok(([w as u32, h as u32], dpi))
        }
    }
}

/// Says how long a stage took, if asked to.
struct Clock(Option<Instant>);

impl Clock {
    fn lap(&mut self, stage: &str) {
        if let Some(since) = &mut self.0 {
            say!("{stage}: {:.0} ms", since.elapsed().as_secs_f64() * 1e3);
            *since = Instant::now();
        }
    }
}

/// Draws the figure.
pub fn run(arguments: &Arguments, matches: &clap::ArgMatches) -> Result<()> {
    let out = &arguments.out;
    check_out(out)?;
    let replacements = arguments.volumes.replacements(matches)?;
    let wardrobe = super::styles::wardrobe(arguments.styles.as_ref())?;
    let themes = &wardrobe.themes;
    let mut template = Template::read(&arguments.template)?;
    if let Some(name) = arguments.theme.as_ref() {
        template.theme = Some(name.clone()).filter(|name| name != NO_THEME);
        if let Err(unknown) = themes.of(&template) {
            return Err(UsageError::because(format!("{unknown} or {NO_THEME}")));
        }
    }
    if let Err(unknown) = themes.of(&template) {
        say!("warning: {unknown}; the figure is drawn without it");
        template.theme = None;
    }
    let background = arguments.background.unwrap_or_else(|| themes.background(&template));
    if let Some(quality) = arguments.quality {
        template.quality = quality;
    }
    let (size, dpi) = pixels_and_dpi(&template.figure, arguments.size, arguments.dpi)?;
    let mut clock = Clock(arguments.verbose.then(Instant::now));
    let progress = Progress::new();
    let _bar = Bar::watch(&progress);

    // The adapter starts (a driver, often a compiler) while the volume is read.
    let choice = arguments.adapter.clone();
    let adapter = std::thread::spawn(move || GpuContext::new(&choice));
    let folder = arguments.template.parent().unwrap_or(Path::new(""));
    let sources = sources::load(&template, folder, &replacements, &arguments.volumes.labels, &progress)?;
    for warning in sources.warnings() {
        say!("warning: {warning}");
    }
    clock.lap("volumes");
    let (mut scene, notes) = bridge::scene(&template, &sources, &wardrobe, &progress)?;
    scene.background = bridge::background(background);
    if arguments.verbose {
        notes.iter().for_each(|note| say!("note: {note}"));
    }
    clock.lap("scene");
    scene.quality.borders = arguments.borders.into();
    let context = adapter.join().map_err(|_| anyhow::anyhow!("the graphics driver crashed; try another adapter"))??;
    clock.lap("waiting for the adapter");
    let mut renderer = Renderer::new(context);
    let adapter = renderer.context().adapter.clone();

    let estimate = match (arguments.max_error, arguments.budget_ms) {
        (Some(codes), _) => Some(estimate::for_error(&mut renderer, &scene, size, codes, &progress)),
        (_, Some(ms)) => Some(estimate::for_budget(&mut renderer, &scene, size, ms, &progress)),
        _ => None,
    };
    let estimate = estimate.transpose().context("the figure was not written")?;
    if let Some(estimate) = &estimate {
        scene.quality = estimate.quality;
        clock.lap("choosing the setting");
    }
    let setting = setting(&scene.quality, estimate.as_ref());
    let options = PngOptions {
        dpi,
        opaque: background != Background::Transparent,
        text: vec![
            ("Software".to_owned(), format!("Fabrica {}", env!("CARGO_PKG_VERSION"))),
            ("Fabrica-Setting".to_owned(), format!("{setting}; adapter {} ({})", adapter.name, adapter.backend)),
        ],
    };
    let report = save_atomic(out, |file| {
        write_png(file, size[0], size[1], &options, |rows| {
            renderer.render_bands(&scene, size, &RenderOptions::default(), &progress, |band| rows.write(band))
        })
    })
    .with_context(|| "the figure was not written".to_owned())?;
    clock.lap("drawing and writing");
    for warning in report.warnings {
        say!("warning: {warning}");
    }
    if arguments.verbose {
        say!("adapter: {} ({}, {})", adapter.name, adapter.backend, adapter.kind);
        say!("pipeline: {}", report.pipeline);
        say!("setting: {setting}");
        if let Some(mb) = peak_memory_mb() {
            say!("peak memory: {mb:.0} MB");
        }
        let mm = size.map(|n| f64::from(n) / dpi * 25.4);
        say!("{}: {} x {} pixels at {dpi:.1} dpi = {:.1} x {:.1} mm", out.display(), size[0], size[1], mm[0], mm[1]);
    }
    Ok(())
}

/// A setting in words, with what is expected of it and how that was found.
fn setting(quality: &Quality, estimate: Option<&Estimate>) -> String {
    let mut words = format!(
        "step {} voxels, style change {}, rays end at {}",
        setup::significant(quality.step_voxels),
        setup::significant(quality.style_change),
        setup::significant(quality.termination)
    );
    if quality.borders == Borders::TwoLookUps {
        words += ", borders by two look-ups";
    }
    match estimate {
        None => words += "; error not estimated",
        Some(e) => {
            words += &format!(
                "; estimated error {:.2} of 255 codes in 99.9 % of the pixels, from {} of them drawn again with a step of {}",
                e.codes,
                e.num_pixels,
                setup::significant(e.against_step)
            );
            if let Some(ms) = e.ms {
                words += &format!("; estimated time {ms:.0} ms");
            }
        }
    }
    words
}

/// What would make the last step fail is found before the first one.
fn check_out(out: &Path) -> Result<()> {
    let extension = out.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if extension != "png" {
        return Err(UsageError::because(format!("--out {} is no PNG file; give it the ending .png", out.display())));
    }
    let folder = out.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(Error::file(folder, "the folder for the picture does not exist", "create it first").into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn size_and_dpi_follow_each_other() {
        let page = Page { width_mm: 50.8, height_mm: 25.4, dpi: 300.0, extra: Default::default() };
        assert_eq!(pixels_and_dpi(&page, None, None).unwrap(), ([600, 300], 300.0));
        assert_eq!(pixels_and_dpi(&page, None, Some(100.0)).unwrap(), ([200, 100], 100.0));
        assert_eq!(pixels_and_dpi(&page, Some([400, 400]), None).unwrap(), ([400, 400], 200.0));
        assert_eq!(pixels_and_dpi(&page, Some([400, 400]), Some(72.0)).unwrap(), ([400, 400], 72.0));
        assert!(pixels_and_dpi(&page, None, Some(1e9)).is_err());
    }
}
