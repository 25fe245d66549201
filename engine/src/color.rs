//! Color at the edges of the engine: sRGB to linear light and back, straight and premultiplied alpha.
//! Everything inside shades and composites in premultiplied linear light (f32); sRGB exists only in files and on
//! the screen. Style images are decoded, and pictures written, through this file.
//!
//! The transfer function is the one of IEC 61966-2-1, exactly: no 2.2 power, no polynomial.

use std::sync::LazyLock;

/// Encoded value below which sRGB is a straight line (IEC 61966-2-1).
const SRGB_KNEE: f64 = 0.040_45;
/// Linear value of the same knee, as printed in the standard.
const LINEAR_KNEE: f64 = 0.003_130_8;

/// Linear light of an sRGB-encoded value; both 0…1. Values outside are extended (the line below 0, the power
/// above 1), NaN stays NaN.
pub fn linear_from_srgb(encoded: f64) -> f64 {
    if encoded <= SRGB_KNEE { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// sRGB-encoded value of linear light; both 0…1, extended as in [`linear_from_srgb`].
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= LINEAR_KNEE { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Linear light of an 8-bit sRGB code.
pub fn linear_from_srgb8(code: u8) -> f32 {
    LINEAR_OF_CODE[usize::from(code)]
}

/// The 8-bit sRGB code nearest to `linear`: round(255·srgb), halves up, clamped to 0…255. NaN gives 0 (writers
/// refuse it before). Equal to the exact formula for every f32, at the price of one table look-up.
pub fn srgb8_from_linear(linear: f32) -> u8 {
    CODES.code(linear)
}

/// Linear luminance, 0 to 1, of an sRGB color: Rec. 709 weights, which sum to 1.
pub fn luminance_of_srgb8(rgb: [u8; 3]) -> f32 {
    let [r, g, b] = rgb.map(linear_from_srgb8);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Straight linear color of a premultiplied one; alpha ≤ 0 gives transparent black.
pub fn straight_from_premultiplied(rgba: [f32; 4]) -> [f32; 4] {
    let [r, g, b, a] = rgba;
    if a > 0.0 { [r / a, g / a, b / a, a] } else { [0.0; 4] }
}

/// Premultiplied linear color of a straight one.
pub fn premultiplied_from_straight(rgba: [f32; 4]) -> [f32; 4] {
    let [r, g, b, a] = rgba;
    [r * a, g * a, b * a, a]
}

/// Straight linear color of an 8-bit straight sRGB texel (alpha is linear in a PNG).
pub fn straight_linear_from_srgb8(rgba: [u8; 4]) -> [f32; 4] {
    let [r, g, b, a] = rgba;
    [linear_from_srgb8(r), linear_from_srgb8(g), linear_from_srgb8(b), f32::from(a) / 255.0]
}

/// Premultiplied linear color of an 8-bit straight sRGB texel.
pub fn premultiplied_linear_from_srgb8(rgba: [u8; 4]) -> [f32; 4] {
    premultiplied_from_straight(straight_linear_from_srgb8(rgba))
}

/// The 8-bit straight sRGB texel nearest to a premultiplied linear color. Values are clamped to 0…1 (a color
/// brighter than its alpha clips); where alpha rounds to 0, the color is 0 too.
pub fn straight_srgb8_from_premultiplied_linear(rgba: [f32; 4]) -> [u8; 4] {
    let [r, g, b, a] = rgba;
    let alpha = (a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    if alpha == 0 {
        return [0; 4];
    }
    let codes = &*CODES;
    [codes.code(r / a), codes.code(g / a), codes.code(b / a), alpha]
}

/// Linear light of each 8-bit code.
static LINEAR_OF_CODE: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| linear_from_srgb(code as f64 / 255.0) as f32));

static CODES: LazyLock<CodeTable> = LazyLock::new(CodeTable::new);

/// Mantissa bits that choose a cell: 128 cells an octave are at most 0.78 % wide, and two code thresholds are never
/// closer than 0.89 % (2.4/(1.055·255), at white), so a cell holds one threshold at most.
const CELL_BITS: u32 = 7;
/// Smallest tabled value, 2^-13: the first threshold (code ½ → 1) is 1.52e-4 = 2^-12.7.
const FIRST_EXPONENT: u32 = 127 - 13;
const NUM_CELLS: usize = 13 << CELL_BITS;

/// f32 → 8-bit sRGB by cells of the float's own logarithmic grid.
struct CodeTable {
    /// Per cell: the smallest f32 that gets the next code, or infinity.
    threshold: [f32; NUM_CELLS],
    /// Per cell: the code below that threshold.
    base: [u8; NUM_CELLS],
}

impl CodeTable {
    fn new() -> Self {
        // thresholds[k]: smallest f32 whose exact code is ≥ k + 1. Found from the inverse formula, then moved by
        // ulps until the forward formula agrees, so that the table *is* the forward formula.
        let thresholds: [f32; 255] = std::array::from_fn(|k| {
            let mut t = linear_from_srgb((k as f64 + 0.5) / 255.0) as f32;
            while exact_code(t) > k {
                t = t.next_down();
            }
            while exact_code(t) <= k {
                t = t.next_up();
            }
            t
        });
        let mut table = Self { threshold: [f32::INFINITY; NUM_CELLS], base: [0; NUM_CELLS] };
        for cell in 0..NUM_CELLS {
            let first = f32::from_bits((FIRST_EXPONENT << 23) + ((cell as u32) << (23 - CELL_BITS)));
            let below = thresholds.partition_point(|&t| t <= first);
            table.base[cell] = below as u8;
            table.threshold[cell] = thresholds.get(below).copied().unwrap_or(f32::INFINITY);
        }
        table
    }

    #[inline]
    fn code(&self, linear: f32) -> u8 {
        const FIRST: f32 = f32::from_bits(FIRST_EXPONENT << 23);
        const LAST: f32 = 1.0_f32.next_down();
        #[expect(clippy::manual_clamp, reason = "max drops NaN, so that the index is in range for every bit pattern")]
        let x = linear.max(FIRST).min(LAST);
        let cell = ((x.to_bits() - (FIRST_EXPONENT << 23)) >> (23 - CELL_BITS)) as usize;
        self.base[cell] + u8::from(x >= self.threshold[cell])
    }
}

/// round(255·srgb(linear)), halves up: what [`CodeTable`] must equal.
fn exact_code(linear: f32) -> usize {
    (255.0 * srgb_from_linear(f64::from(linear).clamp(0.0, 1.0)) + 0.5) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_codes_roundtrip() {
        for code in 0..=255_u8 {
            let encoded = f64::from(code) / 255.0;
            assert!((srgb_from_linear(linear_from_srgb(encoded)) - encoded).abs() < 1e-7, "{code}");
            assert_eq!(srgb8_from_linear(linear_from_srgb8(code)), code);
            for alpha in [1_u8, 2, 17, 128, 254, 255] {
                let texel = [code, 255 - code, code / 2, alpha];
                assert_eq!(straight_srgb8_from_premultiplied_linear(premultiplied_linear_from_srgb8(texel)), texel);
            }
        }
        assert_eq!(linear_from_srgb(0.0), 0.0);
        assert_eq!(linear_from_srgb(1.0), 1.0);
        // IEC 61966-2-1, middle gray: 50 % sRGB is 21.4 % light.
        assert!((linear_from_srgb(0.5) - 0.214_041).abs() < 1e-6);
    }

    #[test]
    fn table_equals_the_formula() {
        let mut x = 0.0_f32;
        for k in 0..255 {
            // around each threshold, where alone the two could differ (both are monotonic)
            let mut t = linear_from_srgb((f64::from(k) + 0.5) / 255.0) as f32;
            for _ in 0..8 {
                t = t.next_down();
            }
            for _ in 0..16 {
                assert_eq!(usize::from(srgb8_from_linear(t)), exact_code(t), "{t}");
                t = t.next_up();
            }
        }
        while x < 1.1 {
            assert_eq!(usize::from(srgb8_from_linear(x)), exact_code(x), "{x}");
            x += 1.7e-6;
        }
        for x in [-1.0, -0.0, f32::MIN_POSITIVE, 1e-30, 1.0, 2.0, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(usize::from(srgb8_from_linear(x)), exact_code(x), "{x}");
        }
        assert_eq!(srgb8_from_linear(f32::NAN), 0);
    }

    #[test]
    fn transparent_has_no_color_and_bright_clips() {
        assert_eq!(straight_srgb8_from_premultiplied_linear([0.3, 0.2, 0.1, 0.0]), [0; 4]);
        assert_eq!(straight_srgb8_from_premultiplied_linear([1e-4, 1e-4, 1e-4, 1e-3]), [0; 4]);
        assert_eq!(straight_srgb8_from_premultiplied_linear([2.0, -1.0, 0.5, 0.5]), [255, 0, 255, 128]);
        assert_eq!(straight_from_premultiplied([0.3, 0.2, 0.1, 0.0]), [0.0; 4]);
        assert_eq!(
            straight_from_premultiplied(premultiplied_from_straight([0.5, 0.25, 1.0, 0.5])),
            [0.5, 0.25, 1.0, 0.5]
        );
    }
}
