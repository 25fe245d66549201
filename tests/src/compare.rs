//! Comparing pictures, in the terms of `docs/rendering.md`: premultiplied linear RGBA before rounding, and 8-bit sRGB
//! codes over the worse of black and white. Tolerances stand here, each with where it comes from.

use fabrica_engine::color::srgb_from_linear;
use fabrica_engine::render::FloatImage;

/// The largest error, in 8-bit codes, that f32 arithmetic, a table of 4096 entries, half-float styles and 16-bit
/// gradient texels cause at equal step and termination. Measured over the phantoms and the specimen: at most 0.30, and
/// 0.12 root mean square; single pixels on a silhouette reach 5, which the percentile leaves out. See
/// `suites/reference.rs`, which prints what it finds.
pub const SAME_SETTINGS_P999_CODES: f64 = 0.5;
/// Root mean square over the picture, same origin.
pub const SAME_SETTINGS_RMSE_CODES: f64 = 0.2;

/// How far two pictures are apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Root mean square in 8-bit codes.
    pub rmse_codes: f64,
    /// 99.9th percentile of the pixels' largest channel difference, in 8-bit codes.
    pub p999_codes: f64,
    /// Largest difference in 8-bit codes.
    pub max_codes: f64,
    /// Root mean square of premultiplied linear RGBA.
    pub rmse_linear: f64,
    /// Share of pixels where either picture shows anything.
    pub covered: f64,
}

/// Compares a picture without background with the reference's pixels.
///
/// # Panics
/// If the sizes differ or a pixel is not finite: no tolerance covers that.
pub fn difference(picture: &FloatImage, reference: &[[f64; 4]]) -> Difference {
    assert_eq!(picture.pixels.len(), reference.len(), "pictures of different sizes");
    let mut codes = Vec::with_capacity(reference.len());
    let (mut squares, mut linear, mut covered) = (0.0, 0.0, 0usize);
    for (a, b) in picture.pixels.iter().zip(reference) {
        let a = a.map(f64::from);
        assert!(a.iter().chain(b).all(|v| v.is_finite()), "a pixel is not finite: {a:?} against {b:?}");
        let mut worst: f64 = 0.0;
        for background in [0.0, 1.0] {
            let over = |p: &[f64; 4], i: usize| 255.0 * srgb_from_linear((p[i] + (1.0 - p[3]) * background).max(0.0));
            for i in 0..3 {
                worst = worst.max((over(&a, i) - over(b, i)).abs());
            }
        }
        codes.push(worst);
        squares += worst * worst;
        linear += (0..4).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>() / 4.0;
        covered += usize::from(a[3] > 0.0 || b[3] > 0.0);
    }
    let n = codes.len() as f64;
    codes.sort_by(f64::total_cmp);
    Difference {
        rmse_codes: (squares / n).sqrt(),
        p999_codes: codes[((codes.len() - 1) as f64 * 0.999) as usize],
        max_codes: codes[codes.len() - 1],
        rmse_linear: (linear / n).sqrt(),
        covered: covered as f64 / n,
    }
}

/// Whether a GPU picture is what the reference says at the same settings.
///
/// # Errors
/// The difference, where it is above the tolerance, or where there is nothing in the picture to compare.
pub fn agrees(picture: &FloatImage, reference: &[[f64; 4]]) -> Result<Difference, String> {
    let d = difference(picture, reference);
    if d.covered < 0.05 {
        return Err(format!("only {:.1} % of the picture show anything", 100.0 * d.covered));
    }
    if d.p999_codes > SAME_SETTINGS_P999_CODES || d.rmse_codes > SAME_SETTINGS_RMSE_CODES {
        return Err(format!("{d:?}"));
    }
    Ok(d)
}
