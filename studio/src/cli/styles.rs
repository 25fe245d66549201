//! `fabrica styles`.

use std::path::PathBuf;

use anyhow::Result;
use fabrica_engine::styles::{StyleInfo, StyleLibrary};

#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A folder of lit-sphere pictures (square PNGs) to list as well.
    #[arg(long, value_name = "DIR")]
    styles: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The built-in styles, and those of a folder if one is named.
pub fn library(folder: Option<&PathBuf>) -> Result<StyleLibrary> {
    let embedded = StyleLibrary::embedded();
    Ok(match folder {
        Some(folder) => embedded.with_folder(folder)?,
        None => embedded,
    })
}

/// Lists names and descriptions.
pub fn run(arguments: &Arguments) -> Result<()> {
    let library = library(arguments.styles.as_ref())?;
    if arguments.json {
        return super::print_line(&serde_json::to_string_pretty(&library.infos().collect::<Vec<&StyleInfo>>())?);
    }
    let lines: Vec<String> = library.infos().map(|s| format!("{:16} {}", s.name, s.description)).collect();
    super::print_line(&lines.join("\n"))
}
