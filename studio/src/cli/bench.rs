//! `fabrica bench`: how long a frame takes while the camera changes. Its options and JSON fields (docs/bench.md) are what
//! other programs are compared through, so they stay.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use fabrica_engine::Progress;
use fabrica_engine::gpu::AdapterChoice;
use fabrica_engine::measure::{median, samples_per_ray};
use fabrica_engine::render::RenderOptions;
use fabrica_engine::scene::{Camera, Quality, Scene};
use glam::{DQuat, DVec3};
use serde::Serialize;

use super::progress_bar::Bar;
use super::setup::{self, Adapter, BordersName, Stage};
use super::{print_line, volumes};
use crate::figure::bridge;
use crate::figure::template::QualityName;

const AFTER_HELP: &str = "\
The first frame (upload, compilation) is timed alone, then N more, each from a new direction.
JSON: fabrica, template, title, dims, size, frames, orbit_deg, quality {name, step_voxels, style_change, termination,
borders}, adapter {name, backend, kind, driver}, samples_per_ray, first_ms, median_ms, min_ms, max_ms, frame_ms [N],
peak_memory_mb (null where the system does not tell). docs/bench.md says what each means.";

#[derive(clap::Args, Debug)]
#[command(after_long_help = AFTER_HELP)]
pub struct Arguments {
    /// The template (JSON).
    template: PathBuf,
    #[command(flatten)]
    volumes: volumes::Arguments,
    /// Frames that are timed after the first one.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Degrees that the camera changes between two frames, around the object's up axis.
    #[arg(long, value_name = "DEG", default_value_t = 3.0, value_parser = parse_angle, allow_negative_numbers = true)]
    orbit: f64,
    /// Pixels of the picture.
    #[arg(long, value_name = "WxH", value_parser = setup::parse_size, default_value = "1024x1024")]
    size: [u32; 2],
    /// In place of the template's.
    #[arg(long, value_enum)]
    quality: Option<QualityName>,
    /// Step in voxels, in place of the quality's; style change and termination then go with it, as far as they are not given.
    #[arg(long, value_name = "VOXELS", value_parser = parse_number)]
    step: Option<f64>,
    /// How much a style may change between two looks, in place of the quality's (docs/rendering.md §5).
    #[arg(long, value_name = "C", value_parser = parse_number)]
    style_change: Option<f64>,
    /// Transmittance below which rays end, in place of the quality's.
    #[arg(long, value_name = "T", value_parser = parse_number)]
    termination: Option<f64>,
    /// How the borders of regions are found (docs/rendering.md §8).
    #[arg(long, value_enum, default_value_t)]
    borders: BordersName,
    /// software, hardware, or a part of an adapter's name (see `fabrica adapters`).
    #[arg(long, value_name = "NAME", default_value = "auto")]
    adapter: AdapterChoice,
    /// A folder of lit-sphere pictures (square PNGs or JPEGs), used beside the built-in styles.
    #[arg(long, value_name = "DIR")]
    styles: Option<PathBuf>,
    /// Write all numbers into this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the first frame into this file: float32 (height, width, 4), premultiplied linear RGBA over the template's background,
    /// row 0 = top.
    #[arg(long, value_name = "FILE.npy")]
    picture: Option<PathBuf>,
}

fn parse_number(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|n: &f64| n.is_finite()).ok_or_else(|| "write a number".to_owned())
}

impl Arguments {
    /// The accuracy setting, `name` being the quality that it begins with.
    fn setting(&self, name: QualityName) -> Quality {
        let named = self.step.map_or(bridge::quality(name), Quality::balanced);
        Quality {
            style_change: self.style_change.unwrap_or(named.style_change),
            termination: self.termination.unwrap_or(named.termination),
            borders: self.borders.into(),
            ..named
        }
    }
}

fn parse_angle(text: &str) -> Result<f64, String> {
    let angle = text.parse().ok().filter(|a: &f64| a.is_finite());
    angle.ok_or_else(|| "write a number of degrees, for example 3".to_owned())
}

/// What `--json` writes; docs/bench.md describes each field.
#[derive(Serialize)]
struct Report {
    fabrica: &'static str,
    template: String,
    title: String,
    dims: [usize; 3],
    size: [u32; 2],
    frames: u32,
    orbit_deg: f64,
    quality: Setting,
    adapter: Adapter,
    samples_per_ray: f64,
    first_ms: f64,
    median_ms: f64,
    min_ms: f64,
    max_ms: f64,
    frame_ms: Vec<f64>,
    peak_memory_mb: Option<f64>,
}

#[derive(Serialize)]
struct Setting {
    name: QualityName,
    step_voxels: f64,
    style_change: f64,
    termination: f64,
    borders: BordersName,
}

impl Setting {
    fn quality(&self) -> Quality {
        let Self { step_voxels, style_change, termination, borders, .. } = *self;
        Quality { step_voxels, style_change, termination, borders: borders.into() }
    }
}

/// Draws and reports.
pub fn run(arguments: &Arguments, matches: &clap::ArgMatches) -> Result<()> {
    for path in [&arguments.json, &arguments.picture].into_iter().flatten() {
        setup::check_writable(path)?;
    }
    let progress = Progress::new();
    let bar = Bar::watch(&progress);
    let Stage { template, mut scene, mut renderer } = Stage::load(
        &arguments.template,
        &arguments.volumes,
        &arguments.adapter,
        arguments.styles.as_ref(),
        matches,
        &progress,
    )?;
    let name = arguments.quality.unwrap_or(template.quality);
    scene.quality = arguments.setting(name);
    let (pivot, axis) = (center_mm(&scene), up_axis(template.camera.up));
    let first_camera = scene.camera;
    let mut frame_ms = Vec::with_capacity(arguments.frames as usize);
    let (mut first_ms, mut samples) = (0.0, 0.0);
    progress.begin("drawing", u64::from(arguments.frames) + 1);
    for frame in 0..=arguments.frames {
        let angle = (arguments.orbit * f64::from(frame)).to_radians();
        scene.camera = turned(&first_camera, pivot, axis, angle);
        let start = Instant::now();
        let picture = renderer.render(&scene, arguments.size, &RenderOptions::default(), &Progress::new())?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        if frame == 0 {
            first_ms = ms;
            if let Some(path) = &arguments.picture {
                setup::save_npy(path, arguments.size, &picture.pixels)?;
            }
        } else {
            frame_ms.push(ms);
            samples += samples_per_ray(&scene, arguments.size);
        }
        progress.advance(1)?;
    }
    drop(bar);

    let report = Report {
        fabrica: env!("CARGO_PKG_VERSION"),
        template: arguments.template.display().to_string(),
        dims: scene.objects.first().map_or([0; 3], |object| object.volume.grid.dims()),
        title: template.title,
        size: arguments.size,
        frames: arguments.frames,
        orbit_deg: arguments.orbit,
        quality: Setting {
            name,
            step_voxels: scene.quality.step_voxels,
            style_change: scene.quality.style_change,
            termination: scene.quality.termination,
            borders: arguments.borders,
        },
        adapter: Adapter::from(&renderer.context().adapter),
        samples_per_ray: samples / f64::from(arguments.frames),
        first_ms,
        median_ms: median(&mut frame_ms.clone()),
        min_ms: frame_ms.iter().copied().fold(f64::INFINITY, f64::min),
        max_ms: frame_ms.iter().copied().fold(0.0, f64::max),
        frame_ms,
        peak_memory_mb: setup::peak_memory_mb(),
    };
    print_line(&in_words(&report))?;
    if let Some(path) = &arguments.json {
        setup::save_text(path, &(serde_json::to_string_pretty(&report)? + "\n"))?;
    }
    Ok(())
}

fn in_words(r: &Report) -> String {
    let mut lines = vec![
        format!("adapter      {} ({}, {}, {})", r.adapter.name, r.adapter.driver, r.adapter.backend, r.adapter.kind),
        format!(
            "picture      {} x {} pixels of {} x {} x {} voxels, {} (step {} voxels, style change {}, rays end at {}{})",
            r.size[0],
            r.size[1],
            r.dims[0],
            r.dims[1],
            r.dims[2],
            setup::quality_name(r.quality.quality()).unwrap_or("a setting of its own"),
            r.quality.step_voxels,
            setup::significant(r.quality.style_change),
            setup::fraction_text(r.quality.termination),
            if r.quality.borders == BordersName::Exact { "" } else { ", borders by two look-ups" }
        ),
        format!("first frame  {:.1} ms, upload and compilation included", r.first_ms),
        format!(
            "frames       {}, {} degrees apart: median {:.2} ms, min {:.2}, max {:.2}",
            r.frames, r.orbit_deg, r.median_ms, r.min_ms, r.max_ms
        ),
        format!("samples      {:.1} per ray", r.samples_per_ray),
    ];
    if let Some(mb) = r.peak_memory_mb {
        lines.push(format!("peak memory  {mb:.0} MB"));
    }
    lines.join("\n")
}

/// The middle of what the scene shows.
fn center_mm(scene: &Scene) -> DVec3 {
    let Some(object) = scene.objects.first() else { return DVec3::ZERO };
    let (low, high) = object.visible_index_box();
    object.volume.grid.world_from_index().transform_point3(0.5 * (low + high))
}

fn up_axis(up: [f64; 3]) -> DVec3 {
    DVec3::from_array(up).try_normalize().unwrap_or(DVec3::Z)
}

/// The camera, moved rigidly by `angle` radians around the line through `pivot` along the unit vector `axis`.
fn turned(camera: &Camera, pivot: DVec3, axis: DVec3, angle: f64) -> Camera {
    let turn = DQuat::from_axis_angle(axis, angle);
    Camera {
        eye_mm: pivot + turn * (camera.eye_mm - pivot),
        forward: turn * camera.forward,
        right: turn * camera.right,
        up: turn * camera.up,
        projection: camera.projection,
    }
}

#[cfg(test)]
mod tests {
    use fabrica_engine::scene::Projection;

    use super::*;

    #[test]
    fn a_step_brings_what_goes_with_it() {
        use clap::Parser as _;
        #[derive(clap::Parser, Debug)]
        struct Line {
            #[command(flatten)]
            arguments: Arguments,
        }
        let setting = |options: &[&str]| {
            let line = ["bench", "figure.json"].iter().chain(options).copied();
            Line::try_parse_from(line).unwrap().arguments.setting(QualityName::Final)
        };
        assert_eq!(setting(&[]), Quality::FINAL);
        assert_eq!(setting(&["--step", "2"]), Quality::DRAFT);
        let only = setting(&["--termination", "0.01", "--style-change", "3"]);
        assert_eq!(only, Quality { termination: 0.01, style_change: 3.0, ..Quality::FINAL });
        assert_eq!(
            setting(&["--step", "0.5", "--style-change", "1"]),
            Quality { style_change: 1.0, ..Quality::STANDARD }
        );
    }

    #[test]
    fn the_camera_changes_around_the_object() {
        let projection = Projection::Perspective { fov_y_deg: 20.0 };
        let pivot = DVec3::new(10.0, 20.0, 30.0);
        let eye = pivot + DVec3::new(0.0, -100.0, 25.0);
        let camera = Camera::looking(eye, pivot - eye, DVec3::Z, projection).unwrap();
        let quarter = turned(&camera, pivot, up_axis([0.0, 0.0, 2.0]), std::f64::consts::FRAC_PI_2);
        assert!((quarter.eye_mm - (pivot + DVec3::new(100.0, 0.0, 25.0))).length() < 1e-9, "{quarter:?}");
        let expected = Camera::looking(quarter.eye_mm, pivot - quarter.eye_mm, DVec3::Z, projection).unwrap();
        assert!((quarter.right - expected.right).length() < 1e-12 && (quarter.up - expected.up).length() < 1e-12);
        // Looking along the axis, the picture changes instead.
        let above = Camera::looking(pivot + DVec3::Z, DVec3::NEG_Z, DVec3::Y, projection).unwrap();
        let half = turned(&above, pivot, DVec3::Z, std::f64::consts::PI);
        assert!((half.right + above.right).length() < 1e-12 && (half.eye_mm - above.eye_mm).length() < 1e-12);
        assert_eq!(up_axis([0.0; 3]), DVec3::Z);
    }
}
