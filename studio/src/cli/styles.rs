//! `fabrica styles`.

use std::path::PathBuf;

use anyhow::Result;
use fabrica_engine::styles::StyleLibrary;

use crate::figure::theme;

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

/// Lists names and descriptions of styles and themes.
pub fn run(arguments: &Arguments) -> Result<()> {
    let library = library(arguments.styles.as_ref())?;
    if arguments.json {
        let listed = serde_json::json!({"styles": library.infos().collect::<Vec<_>>(), "themes": theme::all()});
        return super::print_line(&serde_json::to_string_pretty(&listed)?);
    }
    let styles = library.infos().map(|s| format!("{:17} {}", s.name, s.description));
    let themes = theme::all().iter().map(|t| format!("{:17} {}", t.name, t.description));
    let heading = ["", "Themes (\"theme\" in a template, or render --theme NAME):"].map(str::to_owned);
    let lines: Vec<String> = styles.chain(heading).chain(themes).collect();
    super::print_line(&lines.join("\n"))
}
