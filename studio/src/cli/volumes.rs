//! `--volume`, with the options of reading that belong to the one before them.

use std::path::Path;

use anyhow::Result;
use clap::ArgMatches;
use fabrica_engine::read::ReadOptions;
use fabrica_engine::read::raw::RawLayout;

use super::UsageError;
use super::reading::{parse_crop, parse_gigabytes, parse_reduce};
use crate::figure::source::VolumeSource;
use crate::figure::sources::Replacement;

#[derive(clap::Args, Debug)]
#[group(skip)]
pub struct Arguments {
    /// A file, folder or specimen:NAME[@N][,VARIANT] in place of the template's volume; repeat it to fill further slots.
    #[arg(long, value_name = "FILE_OR_DIR")]
    volume: Vec<String>,
    /// Layout of the raw file in the --volume before it: DIMSxTYPE[,spacing][,endian], as in
    /// 256x256x128xuint8,1x1x1,little.
    #[arg(long, value_name = "LAYOUT")]
    raw: Vec<RawLayout>,
    /// Which volume of several in the --volume before it: a number, or a part of its name (see `fabrica inspect`).
    #[arg(long, value_name = "NAME")]
    series: Vec<String>,
    /// Frame, from 0, of the 4-D file in the --volume before it.
    #[arg(long, value_name = "N")]
    frame: Vec<usize>,
    /// Part of the --volume before it, in voxels: first:end along x, y and z, as in 0:256x0:512x40:90.
    #[arg(long, value_name = "BOX", value_parser = parse_crop)]
    crop: Vec<[[usize; 2]; 3]>,
    /// So many voxels of the --volume before it become one: a number for all axes, or three, as in 2x2x1.
    #[arg(long, value_name = "N", value_parser = parse_reduce)]
    reduce: Vec<[usize; 3]>,
    /// A label map, or selections, in place of the template's own; repeat it to fill further places.
    #[arg(long, value_name = "FILE_OR_DIR")]
    pub labels: Vec<String>,
    /// The most memory that the --volume before it may take here and on the adapter, in GB; what is free unless it is given.
    #[arg(long, value_name = "GB", value_parser = parse_gigabytes)]
    memory: Vec<u64>,
}

impl Arguments {
    /// The replacements in order; relative paths count from the current folder.
    ///
    /// # Errors
    /// A usage error: an option without a volume before it, or twice for one volume.
    pub fn replacements(&self, matches: &ArgMatches) -> Result<Vec<Replacement>> {
        let mut replacements = Vec::new();
        for text in &self.volume {
            let source = VolumeSource::parse(text, Path::new("")).map_err(|e| UsageError::because(e.to_string()))?;
            replacements.push(Replacement { source, options: ReadOptions::default() });
        }
        assign(&mut replacements, matches, "raw", &self.raw, |options, raw| options.raw = Some(raw.clone()))?;
        assign(&mut replacements, matches, "series", &self.series, |options, name| {
            options.series = Some(name.clone())
        })?;
        assign(&mut replacements, matches, "frame", &self.frame, |options, frame| options.frame = *frame)?;
        assign(&mut replacements, matches, "crop", &self.crop, |options, crop| options.window.crop = Some(*crop))?;
        assign(&mut replacements, matches, "reduce", &self.reduce, |options, n| options.window.reduce = *n)?;
        assign(&mut replacements, matches, "memory", &self.memory, |options, n| options.limits.bytes = Some(*n))?;
        Ok(replacements)
    }
}

/// Gives each value of an option to the volume that stands before it.
fn assign<T>(
    replacements: &mut [Replacement],
    matches: &ArgMatches,
    option: &str,
    values: &[T],
    set: impl Fn(&mut ReadOptions, &T),
) -> Result<()> {
    let places = |id: &str| matches.indices_of(id).map(Iterator::collect::<Vec<_>>).unwrap_or_default();
    let volumes = places("volume");
    let mut has_it = vec![false; replacements.len()];
    for (place, value) in places(option).into_iter().zip(values) {
        let before = volumes.iter().filter(|v| **v < place).count();
        let owner = before.checked_sub(1).ok_or_else(|| {
            UsageError::because(format!("--{option} has no --volume before it; put it after its --volume"))
        })?;
        if std::mem::replace(&mut has_it[owner], true) {
            return Err(UsageError::because(format!("one --volume has two --{option}; give it one")));
        }
        set(&mut replacements[owner].options, value);
    }
    Ok(())
}
