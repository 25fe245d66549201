//! `fabrica adapters`.

use anyhow::{Result, bail};
use fabrica_engine::gpu::context::NO_ADAPTER;
use fabrica_engine::gpu::list_adapters;

#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// List software adapters only.
    #[arg(long)]
    software: bool,
}

/// Lists what wgpu finds; finding nothing is a failure, so that scripts can ask.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut adapters = list_adapters();
    adapters.retain(|a| !arguments.software || a.kind == "software");
    if arguments.json {
        super::print_line(&serde_json::to_string_pretty(&adapters)?)?;
    } else {
        for a in &adapters {
            let filters = match (a.filters_16_bit, a.filters_float) {
                (true, true) => "filters 16-bit and float volumes",
                (true, false) => "filters 16-bit volumes",
                (false, true) => "filters float volumes",
                (false, false) => "does not filter volumes (slower)",
            };
            super::print_line(&format!(
                "{} ({}, {}; {}): volumes up to {} voxels along an axis, {filters}",
                a.name, a.backend, a.kind, a.driver, a.max_volume_edge
            ))?;
        }
    }
    if adapters.is_empty() {
        bail!("{}; {}", NO_ADAPTER.0, NO_ADAPTER.1);
    }
    Ok(())
}
