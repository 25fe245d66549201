//! `fabrica open`, and `fabrica` alone: the window.

use std::path::PathBuf;

use anyhow::Result;
use fabrica_engine::gpu::AdapterChoice;

#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A volume, a folder of one, a figure (JSON), or specimen:head.
    file: Option<PathBuf>,
    /// software, hardware, or a part of an adapter's name (see `fabrica adapters`): what draws the figure.
    #[arg(long, value_name = "NAME", default_value = "auto")]
    adapter: AdapterChoice,
}

/// Opens the window.
pub fn run(arguments: Arguments) -> Result<()> {
    crate::editor::open_window(arguments.file, arguments.adapter)
}
