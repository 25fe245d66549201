//! `fabrica open`, and `fabrica` alone: the window.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use fabrica_engine::gpu::AdapterChoice;

use crate::editor::session::Session;
use crate::editor::{Options, open_window};

#[derive(clap::Args, Debug, Default)]
pub struct Arguments {
    /// A figure (JSON), a volume, a folder of one, a specimen (specimen:head, specimen:turtle, specimen:engine), or a figure and the volume that it shall show.
    files: Vec<PathBuf>,
    /// software, hardware, or a part of an adapter's name (see `fabrica adapters`): what draws the figure.
    #[arg(long, value_name = "NAME", default_value = "auto")]
    adapter: AdapterChoice,
    /// A folder of lit-sphere pictures (square PNGs or JPEGs), used beside the built-in styles.
    #[arg(long, value_name = "DIR")]
    styles: Option<PathBuf>,
    /// At the end, write how fast the window was (JSON).
    #[arg(long, value_name = "FILE")]
    timings: Option<PathBuf>,
}

/// Opens the window.
pub fn run(arguments: Arguments) -> Result<()> {
    let begun = Instant::now();
    let session = Session::open(Session::default_folder());
    let wardrobe = super::styles::wardrobe(arguments.styles.as_ref())?;
    open_window(Options {
        adapter: arguments.adapter,
        files: arguments.files,
        styles: wardrobe.styles,
        themes: wardrobe.themes,
        fault: wardrobe.fault,
        styles_folder: arguments.styles.or_else(|| session.styles_folder()),
        session,
        system_dialogs: true,
        timings: arguments.timings.map(|path| (path, begun)),
    })
}
