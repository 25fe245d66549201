//! What counts as the same picture. The comparison itself is the engine's (`fabrica_engine::measure`); tolerances stand
//! here, each with where it comes from.

use fabrica_engine::measure::Difference;
use fabrica_engine::render::FloatImage;
use fabrica_engine::scene::{Background, Object, Scene};

/// What f32 arithmetic, the pre-integrated table of 256² entries, half-float styles and 16-bit gradient texels may cost
/// at equal step and termination, at steps of up to one voxel: 99.9th percentile and root mean square in 8-bit codes.
/// Measured over the phantoms and the specimen (`suites/reference.rs` prints them): at most 1.6 and 0.16, where materials
/// jump inside one cell of the table; 0.1 and 0.03 on smooth ones.
pub const SAME_SETTINGS_CODES: (f64, f64) = (2.0, 0.2);
/// The same at draft's two voxels a step and more, where one piece crosses many cells: at most 3.8; and 0.72 for one
/// pixel of 31 codes on a silhouette of 1920, where the two are on different sides of a threshold (0.33 without).
pub const SAME_DRAFT_CODES: (f64, f64) = (5.0, 1.0);

/// What a jump between two materials adds to the percentile: values in the cell of the table below it show a mixture of
/// both. Measured at the phantoms' jump at 600: 3.8 in all at up to one voxel a step, 5.3 at two.
pub const JUMP_CODES: f64 = 2.0;

/// Whether a GPU picture without background is what the reference's twin says at the same settings.
///
/// # Errors
/// The difference, where it is above the tolerance; a sentence, where there is nothing in the picture to compare, a
/// pixel is not finite, or the sizes differ.
pub fn agrees(picture: &FloatImage, reference: &[[f64; 4]], scene: &Scene) -> Result<Difference, String> {
    let (p999, rmse) = if scene.quality.step_voxels <= 1.0 { SAME_SETTINGS_CODES } else { SAME_DRAFT_CODES };
    let d = Difference::of(picture, reference, Background::Transparent, None).map_err(|e| e.to_string())?;
    if d.covered < 0.05 {
        return Err(format!("only {:.1} % of the picture show anything", 100.0 * d.covered));
    }
    let jumps = |o: &Object| o.transfer_function.nodes.windows(2).any(|w| w[0].value == w[1].value);
    let p999 = p999 + if scene.objects.iter().any(jumps) { JUMP_CODES } else { 0.0 };
    if d.codes.p999 > p999 || d.codes.rmse > rmse {
        return Err(format!("{d:?}"));
    }
    Ok(d)
}
