//! `fabrica styles`: what there is, and styles from artwork.

mod extract;

use std::path::PathBuf;

use anyhow::Result;
use fabrica_engine::styles::StyleLibrary;

use crate::figure::theme::{Theme, Themes, Wardrobe};

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

/// All that figures can be drawn in, with what is the user's own.
pub struct Owned {
    pub styles: StyleLibrary,
    pub themes: Themes,
    /// What of the user's own is left out, and why: one sentence. It is said on stderr already.
    pub fault: Option<String>,
}

impl<'a> From<&'a Owned> for Wardrobe<'a> {
    fn from(owned: &'a Owned) -> Self {
        Self { styles: &owned.styles, themes: &owned.themes }
    }
}

/// The built-in styles and themes, those of the user's folder, and those of a folder if one is named. Later styles take the place of
/// earlier ones of the same name.
pub fn wardrobe(folder: Option<&PathBuf>) -> Result<Owned> {
    let (mut styles, mut themes, mut fault) = (StyleLibrary::embedded(), Themes::built_in().clone(), None);
    if let Some(own) = own_folder().filter(|own| own.is_dir()) {
        // What the user did not name must not keep anything from being drawn.
        match styles.clone().with_folder(&own) {
            Ok(with_own) => styles = with_own,
            Err(error) => fault = Some(format!("your own styles are left out: {error}")),
        }
        match themes.clone().with_folder(&own, &styles) {
            Ok(with_own) => themes = with_own,
            Err(error) => fault = Some(format!("your own themes are left out: {error}")),
        }
    }
    if let Some(fault) = &fault {
        say!("warning: {fault}");
    }
    if let Some(folder) = folder {
        styles = styles.with_folder(folder)?;
        themes = themes.with_folder(folder, &styles)?;
    }
    Ok(Owned { styles, themes, fault })
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
    let Owned { styles: library, themes, .. } = wardrobe(arguments.styles.as_ref())?;
    if arguments.json {
        let themes: Vec<&Theme> = themes.all().iter().map(AsRef::as_ref).collect();
        let listed = serde_json::json!({"styles": library.infos().collect::<Vec<_>>(), "themes": themes});
        return super::print_line(&serde_json::to_string_pretty(&listed)?);
    }
    let styles = library.infos().map(|s| format!("{:17} {}", s.name, s.description));
    let themes = themes.all().iter().map(|t| format!("{:17} {}", t.name, t.description));
    let heading = ["", "Themes (\"theme\" in a template, or render --theme NAME):"].map(str::to_owned);
    let lines: Vec<String> = styles.chain(heading).chain(themes).collect();
    super::print_line(&lines.join("\n"))
}
