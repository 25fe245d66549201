//! What the commands that draw begin with, and what those that measure end with: arguments' kinds, a template's scene
//! on an adapter, places to write to, the memory that it took.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::ArgMatches;
use fabrica_engine::gpu::context::AdapterDescription;
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::image_out::{save_atomic, write_npy};
use fabrica_engine::render::Renderer;
use fabrica_engine::scene::{Borders, Quality, Scene};
use fabrica_engine::{Error, Progress};
use serde::Serialize;

use super::volumes;
use crate::figure::template::{QualityName, Template};
use crate::figure::{bridge, sources};

/// WIDTHxHEIGHT in pixels.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let edges = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match edges {
        Some([w, h]) if w > 0 && h > 0 => Ok([w, h]),
        _ => Err("write it as WIDTHxHEIGHT in pixels, for example 1024x768".to_owned()),
    }
}

/// The most memory that this process ever held, where the system tells (Linux), in 10⁶ bytes.
pub fn peak_memory_mb() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()? * 1024.0 / 1e6)
}

/// A template's scene, and an adapter to draw it with.
pub struct Stage {
    /// The template as read.
    pub template: Template,
    /// Its scene, with the template's own quality.
    pub scene: Scene,
    /// A renderer on the adapter; nothing is uploaded yet.
    pub renderer: Renderer,
}

impl Stage {
    /// Reads the template and its volumes and opens the adapter; `styles` is a folder of styles beside the built-in ones. Warnings go
    /// to stderr.
    ///
    /// # Errors
    /// One sentence about the template, a volume or the adapter; a usage error from the options of volumes.
    pub fn load(
        template: &Path,
        volumes: &volumes::Arguments,
        adapter: &AdapterChoice,
        styles: Option<&PathBuf>,
        matches: &ArgMatches,
        progress: &Progress,
    ) -> Result<Self> {
        let replacements = volumes.replacements(matches)?;
        let folder = template.parent().unwrap_or(Path::new(""));
        let template = Template::read(template)?;
        let renderer = Renderer::new(GpuContext::new(adapter)?);
        let sources = sources::load(&template, folder, &replacements, &volumes.labels, progress)?;
        for warning in sources.warnings() {
            say!("warning: {warning}");
        }
        let (scene, _) = bridge::scene(&template, &sources, &super::styles::wardrobe(styles)?, progress)?;
        Ok(Self { template, scene, renderer })
    }

    /// Voxels of the scene's volume along its index axes; zeros without one.
    pub fn dims(&self) -> [usize; 3] {
        self.scene.objects.first().map_or([0; 3], |object| object.volume.grid.dims())
    }
}

/// An adapter as the reports name it.
#[derive(Clone, Debug, Serialize)]
pub struct Adapter {
    /// The driver's name of the device.
    pub name: String,
    /// "vulkan", "metal", "dx12", "gl".
    pub backend: String,
    /// "software", "discrete", "integrated", "virtual", "other".
    pub kind: String,
    /// Driver and its version.
    pub driver: String,
}

impl From<&AdapterDescription> for Adapter {
    fn from(a: &AdapterDescription) -> Self {
        Self { name: a.name.clone(), backend: a.backend.clone(), kind: a.kind.clone(), driver: a.driver.clone() }
    }
}

/// The name of a setting that has one, whatever its borders.
pub fn quality_name(quality: Quality) -> Option<&'static str> {
    let quality = Quality { borders: Borders::Exact, ..quality };
    [QualityName::Draft, QualityName::Standard, QualityName::Final]
        .into_iter()
        .find_map(|name| (bridge::quality(name) == quality).then_some(name_of(name)))
}

/// How the borders of regions are found, as options write it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum BordersName {
    /// As the figure means them: by the memberships of all regions.
    #[default]
    Exact,
    /// By the nearest voxel's label and the interpolated one: one look a place, with gaps between regions.
    TwoLookUps,
}

impl From<BordersName> for Borders {
    fn from(name: BordersName) -> Self {
        match name {
            BordersName::Exact => Self::Exact,
            BordersName::TwoLookUps => Self::TwoLookUps,
        }
    }
}

impl From<Borders> for BordersName {
    fn from(borders: Borders) -> Self {
        match borders {
            Borders::Exact => Self::Exact,
            Borders::TwoLookUps => Self::TwoLookUps,
        }
    }
}

/// A quality's name as templates and options write it.
pub fn name_of(name: QualityName) -> &'static str {
    match name {
        QualityName::Draft => "draft",
        QualityName::Standard => "standard",
        QualityName::Final => "final",
    }
}

/// A small number as people write it: 1/1024 where it is one over a whole number.
pub fn fraction_text(number: f64) -> String {
    let inverse = 1.0 / number;
    if inverse.is_finite() && inverse.fract() == 0.0 && inverse > 1.0 {
        format!("1/{inverse}")
    } else {
        number.to_string()
    }
}

/// A number to three digits, without trailing zeros.
pub fn significant(number: f64) -> String {
    let digits = (2 - number.abs().log10().floor() as i32).clamp(0, 9) as usize;
    let text = format!("{number:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Whether a report can be written to `path`, asked before the work whose result it holds. Leaves nothing behind.
///
/// # Errors
/// One sentence.
pub fn check_writable(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(Error::file(folder, "the folder for the report does not exist", "create it first").into());
    }
    // The file is begun and given up.
    match save_atomic(path, |_| Err::<(), Error>(Error::Cancelled)) {
        Ok(()) | Err(Error::Cancelled) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// Writes a text whole or not at all.
///
/// # Errors
/// One sentence with the path.
pub fn save_text(path: &Path, text: &str) -> Result<()> {
    use std::io::Write as _;
    Ok(save_atomic(path, |file| file.write_all(text.as_bytes()).map_err(|e| Error::io(path, &e)))?)
}

/// Writes a picture as NumPy's `.npy`, whole or not at all: float32 (height, width, 4), premultiplied linear RGBA, row 0 = top.
///
/// # Errors
/// One sentence with the path.
pub fn save_npy(path: &Path, [width, height]: [u32; 2], pixels: &[[f32; 4]]) -> Result<()> {
    Ok(save_atomic(path, |file| write_npy(file, width, height, pixels).map_err(|e| Error::io(path, &e)))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_parse() {
        assert_eq!(parse_size("10x20"), Ok([10, 20]));
        for bad in ["", "10", "0x5", "10x", "-1x2", "1e3x2", "10x20x30"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn settings_have_names() {
        assert_eq!(quality_name(Quality::DRAFT), Some("draft"));
        let mut odd = Quality::FINAL;
        odd.step_voxels = 0.3;
        assert_eq!(quality_name(odd), None);
        let two = Quality { borders: Borders::TwoLookUps, ..Quality::DRAFT };
        assert_eq!((quality_name(two), two.borders.into()), (Some("draft"), BordersName::TwoLookUps));
        assert_eq!(fraction_text(1.0 / 8192.0), "1/8192");
        assert_eq!(fraction_text(0.3), "0.3");
        assert_eq!(fraction_text(0.0), "0");
    }
}
