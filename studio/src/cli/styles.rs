//! `fabrica styles`: what there is, and styles from artwork.

mod extract;

use std::path::PathBuf;

use anyhow::Result;
use fabrica_engine::styles::StyleLibrary;

use crate::figure::theme;

use crate::editor::session::Session;

#[derive(clap::Args, Debug)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// A folder of lit-sphere pictures (square PNGs or JPEGs) to list as well.
    #[arg(long, value_name = "DIR")]
    styles: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(clap::Subcommand, Debug)]
enum Command {
    /// Make a style of a ball in a picture (PNG or JPEG), or of places whose normal is known.
    Extract(extract::Arguments),
}

/// The built-in styles, those of the user's folder, and those of a folder if one is named; later ones take the place of earlier ones
/// of the same name.
pub fn library(folder: Option<&PathBuf>) -> Result<StyleLibrary> {
    let mut library = StyleLibrary::embedded();
    if let Some(own) = own_folder().filter(|own| own.is_dir()) {
        // What the user did not name must not keep anything from being drawn.
        match library.clone().with_folder(&own) {
            Ok(with_own) => library = with_own,
            Err(error) => say!("warning: your own styles are left out: {error}"),
        }
    }
    Ok(match folder {
        Some(folder) => library.with_folder(folder)?,
        None => library,
    })
}

/// Where styles are kept that the program made for the user.
pub fn own_folder() -> Option<PathBuf> {
    Session::open(Session::default_folder()).styles_folder()
}

/// Lists names and descriptions of styles and themes, or makes a style.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(Command::Extract(arguments)) = &arguments.command {
        return extract::run(arguments);
    }
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
