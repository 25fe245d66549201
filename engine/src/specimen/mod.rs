//! Specimens: data sets that are made by code, so that the program has something worth drawing before the
//! user opens a file. They are deterministic: the same name and resolution give the same voxels, always.

mod head;
mod sdf;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::Volume;
use crate::volume::labels::LabelMap;

/// A volume and the structures in it, on the same grid.
#[derive(Clone, Debug)]
pub struct Specimen {
    /// The voxels (HU).
    pub volume: Volume,
    /// Which structure each voxel belongs to.
    pub labels: LabelMap,
}

/// Voxels along the longest axis unless the user says otherwise (head: 0.97 mm).
pub const DEFAULT_RESOLUTION: usize = 256;

/// The specimens there are.
pub const NAMES: [&str; 1] = ["head"];

/// Coarsest and finest grid that is made, in voxels along the longest axis.
const RESOLUTIONS: std::ops::RangeInclusive<usize> = 16..=1024;

/// Makes the specimen `name` with `resolution` voxels along its longest axis.
///
/// # Errors
/// [`Error::Scene`] for an unknown name or a resolution outside 16 to 1024; [`Error::Cancelled`].
pub fn generate(name: &str, resolution: usize, progress: &Progress) -> Result<Specimen> {
    if version(name) == 0 {
        return Err(Error::scene(
            format!("there is no specimen named \"{name}\""),
            format!("the specimens are: {}", NAMES.join(", ")),
        ));
    }
    if !RESOLUTIONS.contains(&resolution) {
        return Err(Error::scene(
            format!("a specimen cannot be made with {resolution} voxels along its longest axis"),
            format!("choose {} to {}", RESOLUTIONS.start(), RESOLUTIONS.end()),
        ));
    }
    head::generate(resolution, progress)
}

/// Version of the voxels of a specimen, part of any cache key: it is raised whenever they change. 0 for a name
/// that does not exist.
pub fn version(name: &str) -> u32 {
    match name {
        "head" => head::VERSION,
        _ => 0,
    }
}
