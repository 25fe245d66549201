//! What a template says of filters against noise, of a volume's values.

use fabrica_engine::volume::filter::Filter;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A filter of a volume after it was read; the file stays as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum FilterTemplate {
    /// Smooths everything alike.
    Gaussian {
        /// Standard deviation in mm.
        sigma_mm: f64,
    },
    /// Takes specks away.
    Median {
        /// Voxels on either side that count, 1 to 3.
        radius_voxels: usize,
    },
    /// Smooths within tissue and leaves edges.
    Anisotropic {
        /// Difference of neighboring voxels, in data units, from which on there is an edge.
        edge: f64,
        /// Steps, 1 to 100.
        iterations: u32,
    },
}

impl FilterTemplate {
    /// What the engine does.
    pub fn filter(self) -> Filter {
        match self {
            Self::Gaussian { sigma_mm } => Filter::Gaussian { sigma_mm },
            Self::Median { radius_voxels } => Filter::Median { radius_voxels },
            Self::Anisotropic { edge, iterations } => Filter::Anisotropic { edge, iterations },
        }
    }
}

impl std::fmt::Display for FilterTemplate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Gaussian { sigma_mm } => write!(f, "Gaussian of {sigma_mm} mm"),
            Self::Median { radius_voxels } => write!(f, "median of {} voxels a side", 2 * radius_voxels + 1),
            Self::Anisotropic { edge, iterations } => {
                write!(f, "diffusion of {iterations} steps up to edges of {edge}")
            }
        }
    }
}
