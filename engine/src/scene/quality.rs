//! Accuracy settings: what a user trades for speed.

use crate::error::{Error, Result};

/// Step and early termination of the march.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Distance of two samples, in voxels along the ray (so that 1:100 voxels are sampled evenly).
    pub step_voxels: f64,
    /// ε_t: a ray ends when its transmittance falls below this; its color is then divided by its opacity.
    pub termination: f64,
}

impl Quality {
    /// Two voxels a step, ε_t = 1/256.
    pub const DRAFT: Self = Self { step_voxels: 2.0, termination: 1.0 / 256.0 };
    /// One voxel a step, ε_t = 1/1024.
    pub const STANDARD: Self = Self { step_voxels: 1.0, termination: 1.0 / 1024.0 };
    /// Half a voxel a step, ε_t = 1/8192.
    pub const FINAL: Self = Self { step_voxels: 0.5, termination: 1.0 / 8192.0 };

    pub(crate) fn validate(&self) -> Result<()> {
        let step = self.step_voxels;
        // Below 1/1024 voxel a ray through 4096 voxels has more samples than f32 can number.
        if !(step.is_finite() && (1.0 / 1024.0..=64.0).contains(&step)) {
            return Err(Error::scene(format!("the step is {step} voxels"), "choose one between 1/1024 and 64 voxels"));
        }
        if !(0.0..1.0).contains(&self.termination) {
            return Err(Error::scene(
                format!("rays would end at a transmittance of {}", self.termination),
                "choose a number from 0 up to, not including, 1",
            ));
        }
        Ok(())
    }
}
