//! `fabrica styles extract`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::image_in;
use fabrica_engine::image_out::{PngOptions, save_png};
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::styles::extract::{self, Alpha, Extracted, NormalPair, Options, SHARP_RADIUS_PX};
use fabrica_engine::styles::{StyleImage, StyleLibrary, check_name, uv_from_normal};
use fabrica_engine::{Error, Progress};

use super::super::UsageError;
use super::super::progress_bar::Bar;
use crate::figure::template::Background;
use crate::figure::{bridge, shipped, sources};

#[derive(clap::Args, Debug)]
#[command(group = clap::ArgGroup::new("from").required(true).args(["circle", "normals"]))]
#[command(group = clap::ArgGroup::new("to").required(true).multiple(true).args(["name", "out"]))]
pub struct Arguments {
    /// The picture: a PNG (8 or 16 bits, with or without alpha) or a JPEG.
    image: PathBuf,
    /// The circle that a ball fills, in pixels: its middle from the left and from the top, and its radius.
    #[arg(long, value_name = "X,Y,R", value_parser = numbers::<3>, allow_hyphen_values = true)]
    circle: Option<[f64; 3]>,
    /// Places whose normal is known, in place of a circle: pixel x, y and the normal's components to the right and up; or a JSON file
    /// with a list of such fours. Give it again for each place; some twenty make a good style.
    #[arg(long, value_name = "X,Y,NX,NY|FILE.json", allow_hyphen_values = true)]
    normals: Vec<String>,
    /// How far colors go to gray, 0 to 1.
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    desaturate: f64,
    /// Make the style so bright that its lights are white (all colors by one factor).
    #[arg(long)]
    relight: bool,
    /// Let the style be transparent where the picture is; otherwise this is filled from around it.
    #[arg(long)]
    keep_alpha: bool,
    /// What the style is called. Without --out it is written into your own styles, which all commands and the window know.
    #[arg(long)]
    name: Option<String>,
    /// The PNG file to write, or a folder for it; templates call the style by the file's name.
    #[arg(long, short, value_name = "FILE.png")]
    out: Option<PathBuf>,
    /// Also draw the style's sphere beside the head specimen dressed in it.
    #[arg(long, value_name = "FILE.png")]
    preview: Option<PathBuf>,
    /// What draws the preview: software, hardware, or a part of an adapter's name.
    #[arg(long, value_name = "NAME", default_value = "auto")]
    adapter: AdapterChoice,
    /// Say how long it takes.
    #[arg(long, short)]
    verbose: bool,
}

/// N numbers with commas between.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values: Option<Vec<f64>> = text.split(',').map(|t| t.trim().parse().ok()).collect();
    values.and_then(|v| v.try_into().ok()).ok_or_else(|| format!("write {N} numbers with commas between"))
}

/// Makes the style, and its preview.
pub fn run(arguments: &Arguments) -> Result<()> {
    let (name, out) = target(arguments)?;
    if let Some(preview) = &arguments.preview {
        check_png("--preview", preview)?;
    }
    let alpha = if arguments.keep_alpha { Alpha::Keep } else { Alpha::Fill };
    let options = Options { desaturate: arguments.desaturate, relight: arguments.relight, alpha };
    let begun = Instant::now();
    let pairs = pairs(&arguments.normals)?;
    let picture = image_in::read_straight(&arguments.image)?;
    let read = begun.elapsed();
    let begun = Instant::now();
    let found = match arguments.circle {
        Some([x, y, radius]) => extract::extract_circle(&picture, [x, y], radius, &options),
        None => extract::extract_normals(&picture, &pairs, &options),
    };
    let found = found.with_context(|| format!("no style can be made of {}", arguments.image.display()))?;
    if arguments.verbose {
        say!("reading: {:.0} ms", read.as_secs_f64() * 1e3);
        say!("extracting: {:.0} ms", begun.elapsed().as_secs_f64() * 1e3);
    }
    report(arguments, &found);
    extract::save(&found, &out)?;
    super::super::print_line(&format!("{name}: {}", out.display()))?;
    if let Some(preview) = &arguments.preview {
        draw_preview(&name, &out, preview, &arguments.adapter).context("the style was written, its preview was not")?;
    }
    Ok(())
}

/// The style's name and file.
fn target(arguments: &Arguments) -> Result<(String, PathBuf)> {
    let file_of = |name: &str| format!("{name}.png");
    let (name, out) = match (&arguments.name, &arguments.out) {
        (Some(name), None) => {
            check_name(name).map_err(|e| UsageError::because(e.to_string()))?;
            if StyleLibrary::is_embedded(name) {
                return Err(UsageError::because(format!(
                    "\"{name}\" is a built-in style; choose another name, or a folder of your own with --out"
                )));
            }
            let folder = super::own_folder().ok_or_else(|| {
                UsageError::because("there is no folder for your own styles here; name a file with --out")
            })?;
            std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, &e))?;
            (name.clone(), folder.join(file_of(name)))
        }
        (Some(name), Some(out)) if out.is_dir() => (name.clone(), out.join(file_of(name))),
        (None, Some(out)) if out.is_dir() => {
            return Err(UsageError::because(format!("--out {} is a folder; add --name", out.display())));
        }
        (name, out) => {
            let out = out.clone().unwrap_or_default();
            check_png("--out", &out)?;
            let stem = out.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            if let Some(name) = name.as_ref().filter(|name| **name != stem) {
                return Err(UsageError::because(format!(
                    "templates would call the style \"{stem}\", by its file, not \"{name}\"; give --out a folder, or leave out --name"
                )));
            }
            (stem, out)
        }
    };
    check_name(&name).map_err(|e| UsageError::because(e.to_string()))?;
    Ok((name, out))
}

fn check_png(option: &str, path: &Path) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    Err(UsageError::because(format!("{option} {} is no PNG file; give it the ending .png", path.display())))
}

/// The pairs of all `--normals`.
fn pairs(texts: &[String]) -> Result<Vec<NormalPair>> {
    let mut fours = Vec::new();
    for text in texts {
        if let Ok(four) = numbers::<4>(text) {
            fours.push(four);
            continue;
        }
        let path = Path::new(text);
        let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        if !is_json {
            return Err(UsageError::because(format!(
                "--normals {text} is neither a JSON file nor four numbers: pixel x, y, and the normal's part to the right and up"
            )));
        }
        let json = std::fs::read_to_string(path).map_err(|e| Error::io(path, &e))?;
        let list: Vec<[f64; 4]> = serde_json::from_str(&json).map_err(|e| {
            Error::file(
                path,
                format!("this is no list of pixels with their normals: {e}"),
                "write it as [[x, y, nx, ny], ...]",
            )
        })?;
        fours.extend(list);
    }
    Ok(fours.into_iter().map(|[x, y, nx, ny]| NormalPair { pixel: [x, y], n_xy: [nx, ny] }).collect())
}

/// What the user shall know of the style.
fn report(arguments: &Arguments, found: &Extracted) {
    if let Some([.., radius]) = arguments.circle.filter(|[.., radius]| *radius < SHARP_RADIUS_PX) {
        say!("warning: a radius of {radius} pixels makes a blurred style; {SHARP_RADIUS_PX} or more are better");
    }
    if found.filled > 0.0 {
        let what = if arguments.circle.is_some() { "is not seen in the picture" } else { "is far from every pair" };
        say!("note: {:.1} % of the sphere {what} and was filled from around it", 100.0 * found.filled);
    }
    const MOST: usize = 5;
    for contradiction in found.contradictions.iter().take(MOST) {
        let [a, b] = contradiction.pairs.map(|i| i + 1);
        say!(
            "warning: pairs {a} and {b} have one normal and differ by {:.0} of 255 codes; they were averaged",
            contradiction.codes
        );
    }
    if found.contradictions.len() > MOST {
        say!("warning: {} more pairs contradict each other", found.contradictions.len() - MOST);
    }
}

/// Pixels a side of each half of a preview.
const PREVIEW: u32 = 400;

fn draw_preview(name: &str, style: &Path, preview: &Path, adapter: &AdapterChoice) -> Result<()> {
    let progress = Progress::new();
    let _bar = Bar::watch(&progress);
    let mut template =
        shipped::SHIPPED.iter().find(|s| s.name == "head").context("the head figure is missing")?.figure();
    for node in template.objects.iter_mut().flat_map(|object| object.transfer_function.all_nodes_mut()) {
        node.style = name.to_owned();
    }
    template.background = Background::Color([255; 3]);
    let styles = StyleLibrary::embedded().with_file(style);
    let sources = sources::load(&template, Path::new(""), &[], &[], &progress)?;
    let (scene, _) = bridge::scene(&template, &sources, &styles, &progress)?;
    let mut renderer = Renderer::new(GpuContext::new(adapter)?);
    let head = renderer.render(&scene, [PREVIEW; 2], &RenderOptions::default(), &progress)?;
    let image = styles.get(name)?;
    let edge = PREVIEW as usize;
    let pixels: Vec<[f32; 4]> = (0..2 * edge * edge)
        .map(|i| {
            let (x, y) = (i % (2 * edge), i / (2 * edge));
            if x >= edge { head.pixels[y * edge + x - edge] } else { sphere_at(&image, [x, y], edge) }
        })
        .collect();
    Ok(save_png(preview, 2 * PREVIEW, PREVIEW, &pixels, &PngOptions { opaque: true, ..PngOptions::default() })?)
}

/// A pixel of the style's sphere in the middle of white paper of `edge` pixels a side, premultiplied linear.
fn sphere_at(style: &StyleImage, pixel: [usize; 2], edge: usize) -> [f32; 4] {
    let (radius, middle) = (0.42 * edge as f64, 0.5 * edge as f64);
    let [x, y] = pixel.map(|i| i as f64 + 0.5 - middle);
    let length = x.hypot(y);
    let coverage = (radius + 0.5 - length).clamp(0.0, 1.0) as f32;
    let n_xy = [x, -y].map(|v| v / length.max(radius));
    let texel = uv_from_normal(n_xy, style.size).map(|v| (v * style.size as f64 - 0.5).max(0.0));
    let [(x, fx), (y, fy)] = texel.map(|v| {
        let whole = (v as usize).min(style.size - 2);
        (whole, (v - whole as f64) as f32)
    });
    let at = |x: usize, y: usize| style.mips[0][y * style.size + x];
    let four = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
    let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
    let color: [f32; 4] = std::array::from_fn(|c| four.iter().zip(weights).map(|(t, w)| w * t[c]).sum());
    color.map(|c| coverage * c + 1.0 - coverage * color[3])
}
