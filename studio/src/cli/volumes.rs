//! `--volume`, with the `--raw` and `--frame` that belong to the one before them.

use std::path::Path;

use anyhow::Result;
use clap::ArgMatches;
use fabrica_engine::read::ReadOptions;

use super::UsageError;
use crate::figure::bridge::Replacement;
use crate::figure::source::VolumeSource;

#[derive(clap::Args, Debug)]
#[group(skip)]
pub struct Arguments {
    /// A file, folder or specimen:NAME[@N][,VARIANT] in place of the template's volume; repeat it to fill further slots.
    #[arg(long, value_name = "FILE_OR_DIR")]
    volume: Vec<String>,
    /// Layout of the raw file in the --volume before it: DIMSxTYPE[,spacing][,endian], as in
    /// 256x256x128xuint8,1x1x1,little.
    #[arg(long, value_name = "LAYOUT")]
    raw: Vec<String>,
    /// Frame, from 0, of the 4-D file in the --volume before it.
    #[arg(long, value_name = "N")]
    frame: Vec<usize>,
}

impl Arguments {
    /// The replacements in order; relative paths count from the current folder.
    ///
    /// # Errors
    /// A usage error: an option without a volume before it, or twice for one volume, or a malformed layout.
    pub fn replacements(&self, matches: &ArgMatches) -> Result<Vec<Replacement>> {
        let places = |id: &str| matches.indices_of(id).map(Iterator::collect::<Vec<_>>).unwrap_or_default();
        let volumes = places("volume");
        let owner = |option: &str, place: usize| -> Result<usize> {
            let before = volumes.iter().filter(|v| **v < place).count();
            before.checked_sub(1).ok_or_else(|| {
                UsageError::because(format!("{option} has no --volume before it; put it after its --volume"))
            })
        };
        let mut replacements = Vec::new();
        for text in &self.volume {
            let source = VolumeSource::parse(text, Path::new("")).map_err(|e| UsageError::because(e.to_string()))?;
            replacements.push(Replacement { source, options: ReadOptions::default() });
        }
        for (place, text) in places("raw").into_iter().zip(&self.raw) {
            let slot = &mut replacements[owner("--raw", place)?].options.raw;
            let layout = text.parse().map_err(|e| UsageError::because(format!("--raw {text}: {e}")))?;
            if slot.replace(layout).is_some() {
                return Err(UsageError::because("one --volume has two --raw; give it one"));
            }
        }
        let mut framed = vec![false; replacements.len()];
        for (place, frame) in places("frame").into_iter().zip(&self.frame) {
            let slot = owner("--frame", place)?;
            if std::mem::replace(&mut framed[slot], true) {
                return Err(UsageError::because("one --volume has two --frame; give it one"));
            }
            replacements[slot].options.frame = *frame;
        }
        Ok(replacements)
    }
}
