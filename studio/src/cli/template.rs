//! `fabrica template`: the first look of a bare volume, as a template to edit and draw.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use fabrica_engine::{Error, Progress};

use super::progress_bar::Bar;
use super::{UsageError, reading, setup};
use crate::figure::first_look;
use crate::figure::source::VolumeSource;
use crate::figure::template::VolumeSlot;

#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A volume file, a folder, or specimen:NAME[@N][,VARIANT] (`fabrica inspect --help` lists them).
    volume: String,
    #[command(flatten)]
    reading: reading::Arguments,
    /// The template to write.
    #[arg(long, value_name = "FILE.json")]
    out: PathBuf,
}

/// Writes the template.
pub fn run(arguments: &Arguments) -> Result<()> {
    let out = &arguments.out;
    check_out(out)?;
    let source = VolumeSource::parse(&arguments.volume, Path::new(""))
        .map_err(|e: anyhow::Error| UsageError::because(e.to_string()))?;
    let options = arguments.reading.options();
    let progress = Progress::new();
    let _bar = Bar::watch(&progress);

    let slot = VolumeSlot::new(first_look::SLOT, String::new()).reading(arguments.volume.clone(), &options);
    let first_look::Opened { mut figure, volume, guess } =
        first_look::open(slot, arguments.reading.numbers(), options.limits, &progress)?;
    for warning in &volume.warnings {
        say!("warning: {warning}");
    }
    guess.iter().for_each(|guess| say!("warning: {guess} {}", reading::AS_SCAN));
    if let VolumeSource::Path(_) = &source {
        // The first look may name the folder of a slice.
        let slot = &mut figure.volumes[0];
        slot.file = name_in_template(Path::new(&slot.file), out)?;
    }
    setup::save_text(out, &figure.to_json()?).context("the template was not written")
}

/// What a template at `out` calls a file: relative where the file lies beside or below it, so that both can move.
fn name_in_template(file: &Path, out: &Path) -> Result<String> {
    let absolute = |path: &Path| std::path::absolute(path).map_err(|e| Error::io(path, &e));
    let (file, out) = (absolute(file)?, absolute(out)?);
    let name = out.parent().and_then(|folder| file.strip_prefix(folder).ok()).unwrap_or(&file);
    let name = name.to_str().context("the path is not UTF-8, and templates are; rename the file")?;
    Ok(name.to_owned())
}

/// What would make the last step fail is found before the first one.
fn check_out(out: &Path) -> Result<()> {
    if !out.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
        return Err(UsageError::because(format!("--out {} is no template; give it the ending .json", out.display())));
    }
    setup::check_writable(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_beside_and_below_the_template_are_named_from_it() {
        let name = |file: &str, out: &str| name_in_template(Path::new(file), Path::new(out)).unwrap();
        assert_eq!(name("/a/scan.nii", "/a/figure.json"), "scan.nii");
        assert_eq!(name("/a/data/scan.nii", "/a/figure.json"), "data/scan.nii");
        assert_eq!(name("/b/scan.nii", "/a/figure.json"), "/b/scan.nii");
        assert_eq!(name("scan.nii", "figure.json"), "scan.nii");
    }
}
