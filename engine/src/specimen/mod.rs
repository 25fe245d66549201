//! Specimens: data sets that are made by code, so that the program has something worth drawing before the
//! user opens a file. They are deterministic: the same request gives the same voxels, always. Each comes with its label
//! map, the ground truth of what its voxels show, and in variants ([`Variant`]).

mod engine_block;
mod head;
mod painter;
mod sdf;
#[cfg(test)]
mod tests;
mod turtle;
mod variant;

pub use variant::{Contrast, Request, Variant};

use self::painter::Plan;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::labels::LabelMap;
use crate::volume::{Modality, Volume};

/// A volume and the structures in it, on the same grid.
#[derive(Clone, Debug)]
pub struct Specimen {
    /// The voxels (HU; of a machine, the units of its scanner).
    pub volume: Volume,
    /// Which structure each voxel belongs to.
    pub labels: LabelMap,
}

/// Voxels along the longest axis unless the user says otherwise (head: 0.97 mm).
pub const DEFAULT_RESOLUTION: usize = 256;

/// The specimens there are.
pub const NAMES: [&str; 3] = ["head", "turtle", "engine"];

/// Coarsest and finest grid that is made, in voxels along the longest axis.
const RESOLUTIONS: std::ops::RangeInclusive<usize> = 16..=1024;

/// Makes the plain specimen `name` with `resolution` voxels along its longest axis.
///
/// # Errors
/// [`Error::Scene`] for an unknown name or a resolution outside 16 to 1024; [`Error::Cancelled`].
pub fn generate(name: &str, resolution: usize, progress: &Progress) -> Result<Specimen> {
    Request::plain(name, resolution).generate(progress)
}

/// What a specimen is, apart from its shape.
fn plan(name: &str) -> Option<&'static Plan> {
    match name {
        "head" => Some(&head::PLAN),
        "turtle" => Some(&turtle::PLAN),
        "engine" => Some(&engine_block::PLAN),
        _ => None,
    }
}

impl Request {
    /// Makes it.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unknown name, a resolution outside 16 to 1024, a structure that the specimen does not
    /// have, and a variant that it cannot have; [`Error::Cancelled`].
    pub fn generate(&self, progress: &Progress) -> Result<Specimen> {
        self.check()?;
        let make = match self.name.as_str() {
            "turtle" => turtle::generate,
            "engine" => engine_block::generate,
            _ => head::generate,
        };
        make(self.resolution, &self.variant, progress)
    }

    /// What the values of it will be; unknown for a name that does not exist.
    pub fn modality(&self) -> Modality {
        plan(&self.name).map_or(Modality::Unknown, |plan| self.variant.modality(plan.modality))
    }

    /// What [`Request::generate`] would refuse.
    ///
    /// # Errors
    /// Those of [`Request::generate`], but for cancellation.
    pub fn check(&self) -> Result<()> {
        let Some(plan) = plan(&self.name) else {
            return Err(Error::scene(
                format!("there is no specimen named \"{}\"", self.name),
                format!("the specimens are: {}", NAMES.join(", ")),
            ));
        };
        if !RESOLUTIONS.contains(&self.resolution) {
            return Err(Error::scene(
                format!("a specimen cannot be made with {} voxels along its longest axis", self.resolution),
                format!("choose {} to {}", RESOLUTIONS.start(), RESOLUTIONS.end()),
            ));
        }
        if let Some(name) = self.variant.missing.iter().find(|name| plan.find(name).is_none()) {
            let names: Vec<String> = plan.structures[1..].iter().map(|s| s.name.replace(' ', "-")).collect();
            return Err(Error::scene(
                format!("specimen:{} has no structure named \"{name}\" to leave out", self.name),
                format!("its structures are: {}", names.join(", ")),
            ));
        }
        if self.variant.drawn_in != 0.0 && self.name != "turtle" {
            return Err(Error::scene(
                format!("specimen:{} has no shell to be drawn into", self.name),
                "leave drawn-in out",
            ));
        }
        if self.variant.contrast == Contrast::Mr && plan.modality != Modality::Ct {
            return Err(Error::scene(
                format!("specimen:{} is of metal, which gives no signal in magnetic resonance", self.name),
                "leave mr out",
            ));
        }
        Ok(())
    }
}

/// Version of the voxels of a specimen, part of any cache key: it is raised whenever they change. 0 for a name
/// that does not exist.
pub fn version(name: &str) -> u32 {
    match name {
        "head" => head::VERSION,
        "turtle" => turtle::VERSION,
        "engine" => engine_block::VERSION,
        _ => 0,
    }
}
