//! Opacity of a segment (docs/rendering.md §5), the closed form in f64. Used once per visible sample, between shading
//! and compositing.

/// From this opacity on a sample is opaque whatever the segment's length: the last f32 below 1.
const OPAQUE: f64 = 1.0 - 1.0 / (1 << 24) as f64;

/// α' = 1 − (1 − α)^r: the opacity of a segment of `length_ratio` r = Δ/d₀ reference lengths, if one reference length
/// has opacity `alpha`. Opaque from α ≥ 1 − 2⁻²⁴ on; 0 for α ≤ 0.
pub fn opacity_correct(alpha: f64, length_ratio: f64) -> f64 {
    if alpha >= OPAQUE {
        1.0
    } else if alpha <= 0.0 {
        0.0
    } else {
        -(length_ratio * (-alpha).ln_1p()).exp_m1()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacity_correct_is_the_power_law() {
        for alpha in [1e-3, 0.01, 0.1, 0.5, 0.9, 0.999] {
            // A whole number of reference lengths, against a product that knows no logarithm.
            let mut clear = 1.0;
            for n in 1..=50 {
                clear *= 1.0 - alpha;
                assert!((opacity_correct(alpha, f64::from(n)) - (1.0 - clear)).abs() < 1e-12, "{alpha} {n}");
            }
            // n segments of 1/n reference length make one reference length.
            for n in [2, 3, 7, 1000] {
                let part = opacity_correct(alpha, 1.0 / f64::from(n));
                assert!((1.0 - (1.0 - part).powi(n) - alpha).abs() < 1e-12, "{alpha} {n}");
            }
        }
    }

    #[test]
    fn opacity_correct_keeps_the_digits_of_small_opacities() {
        // 10⁴ samples of α = 1e-6: 1 − (1 − 1e-6)^10⁴ by the binomial series, whose fourth term is below 1e-9.
        let (a, n) = (1e-6f64, 1e4f64);
        let series = n * a * (1.0 - (n - 1.0) / 2.0 * a * (1.0 - (n - 2.0) / 3.0 * a * (1.0 - (n - 3.0) / 4.0 * a)));
        assert!((opacity_correct(a, n) - series).abs() < 1e-12);
        let mut total = 0.0;
        for _ in 0..10_000 {
            total += (1.0 - total) * opacity_correct(a, 1.0);
        }
        assert!((total - series).abs() < 1e-12);
        assert!((opacity_correct(1e-12, 0.5) / 5e-13 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn opacity_correct_at_its_ends() {
        assert_eq!(opacity_correct(0.0, 1.0), 0.0);
        assert_eq!(opacity_correct(-1.0, 1.0), 0.0);
        assert_eq!(opacity_correct(1.0, 1e-9), 1.0);
        assert_eq!(opacity_correct(1.0 - 0.5f64.powi(24), 1e-9), 1.0);
        assert!(opacity_correct(1.0 - 0.5f64.powi(23), 1e-9) < 1e-7);
    }

    #[test]
    fn the_series_for_f32_agree_with_the_closed_form() {
        // The page's two series, in f64: their truncation stays below three roundings of an f32.
        for i in 1..=1000 {
            let a = f64::from(i) / 1000.0 / 16.0;
            let ln = -a * (1.0 + a * (0.5 + a * (1.0 / 3.0 + a * (0.25 + a / 5.0))));
            assert!((ln / (-a).ln_1p() - 1.0).abs() < 2e-7);
            let x = -a;
            let one_minus_exp = -x * (1.0 + x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0)));
            assert!((one_minus_exp / -x.exp_m1() - 1.0).abs() < 2e-7);
        }
    }
}
