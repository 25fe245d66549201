//! What counts as the same picture. The comparison itself is the engine's (`fabrica_engine::measure`); tolerances stand
//! here, each with where it comes from.

use fabrica_engine::measure::Difference;
use fabrica_engine::render::FloatImage;
use fabrica_engine::scene::{Background, Scene};

/// What f32 arithmetic, the pre-integrated table of 256² entries, half-float styles and 16-bit gradient texels may cost
/// at equal settings, at steps of up to two voxels: 99.9th percentile and root mean square in 8-bit codes. Measured over the
/// phantoms and the specimen (`suites/reference.rs` prints them): at most 1.7 and 0.11; 0.3 and 0.03 at final.
pub const SAME_SETTINGS_CODES: (f64, f64) = (2.0, 0.15);
/// The same at steps above two voxels, where one piece crosses many cells and a pixel on a silhouette may be on different
/// sides of a threshold in the two.
pub const SAME_COARSE_CODES: (f64, f64) = (5.0, 1.0);

/// The tolerance at a step in voxels.
pub fn same_settings(step_voxels: f64) -> (f64, f64) {
    if step_voxels <= 2.0 { SAME_SETTINGS_CODES } else { SAME_COARSE_CODES }
}

/// Whether a GPU picture without background is what the reference's twin says at the same settings.
///
/// # Errors
/// The difference, where it is above the tolerance; a sentence, where there is nothing in the picture to compare, a
/// pixel is not finite, or the sizes differ.
pub fn agrees(picture: &FloatImage, reference: &[[f64; 4]], scene: &Scene) -> Result<Difference, String> {
    let (p999, rmse) = same_settings(scene.quality.step_voxels);
    let d = Difference::of(picture, reference, Background::Transparent, None).map_err(|e| e.to_string())?;
    if d.covered < 0.05 {
        return Err(format!("only {:.1} % of the picture show anything", 100.0 * d.covered));
    }
    if d.codes.p999 > p999 || d.codes.rmse > rmse {
        return Err(format!("{d:?}"));
    }
    Ok(d)
}
