//! Pre-integration (docs/rendering.md §5) by quadrature: the twin of the GPU's table at the same step. The truth that
//! pictures are measured against does not use it: it is the point-wise march at small steps.

use super::style::classify;
use crate::scene::StyleTransferFunction;

/// κ of a material that hides everything, per reference length.
const OPAQUE_EXTINCTION: f64 = 64.0;
/// Midpoints per stretch between two nodes.
const NUM_POINTS: usize = 100;

/// What a piece of a ray shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// κ̄: mean extinction per reference length.
    pub extinction: f64,
    /// ū: mean node coordinate, weighted by what is seen.
    pub node: f64,
    /// w̄: where in the piece it is seen, 0 = front, 1 = back.
    pub middle: f64,
}

/// Classifies a piece whose value changes linearly from `front` to `back` and which is `lengths` reference lengths long.
/// A piece that shows nothing has extinction 0.
pub fn classify_piece(function: &StyleTransferFunction, front: f64, back: f64, lengths: f64) -> Piece {
    // Between two nodes everything is smooth: cut there, and put the points inside the stretches.
    let mut cuts = vec![0.0, 1.0];
    if front != back {
        let places = function.nodes.iter().map(|n| (n.value - front) / (back - front));
        cuts.extend(places.filter(|w| (0.0..1.0).contains(w)));
    }
    cuts.sort_by(f64::total_cmp);
    let (mut depth, mut total, mut weight, mut node, mut middle) = (0.0f64, 0.0, 0.0, 0.0, 0.0);
    for ends in cuts.windows(2).filter(|e| e[1] > e[0]) {
        let part = (ends[1] - ends[0]) / NUM_POINTS as f64;
        for i in 0..NUM_POINTS {
            let w = ends[0] + (i as f64 + 0.5) * part;
            let c = classify(function, front + w * (back - front));
            let kappa = if c.opacity >= 1.0 - 2f64.powi(-24) { OPAQUE_EXTINCTION } else { -(-c.opacity).ln_1p() };
            if kappa <= 0.0 {
                continue;
            }
            let share = (-depth).exp() * -(-lengths * kappa * part).exp_m1();
            depth += lengths * kappa * part;
            total += kappa * part;
            weight += share;
            node += share * c.node;
            middle += share * (w - 0.5 * part + part * seen_at(lengths * kappa * part));
        }
    }
    if weight > 0.0 {
        Piece { extinction: total, node: node / weight, middle: middle / weight }
    } else {
        Piece { extinction: total, node: classify(function, 0.5 * (front + back)).node, middle: 0.5 }
    }
}

/// Where a stretch of constant extinction and optical depth `depth` is seen, from its front (0) to its back (1):
/// 1/depth − 1/(e^depth − 1).
fn seen_at(depth: f64) -> f64 {
    if depth < 1e-4 { 0.5 - depth / 12.0 } else { 1.0 / depth - 1.0 / depth.exp_m1() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::TransferFunctionNode;

    fn ramp() -> StyleTransferFunction {
        let node = |value, opacity| TransferFunctionNode { value, style: 0, opacity };
        StyleTransferFunction::new(vec![node(0.0, 0.0), node(100.0, 0.9)], 1.0)
    }

    #[test]
    fn classify_piece_matches_the_closed_form() {
        // ∫ −ln(1−0.9w) dw = 1 + ln(0.1)/9, from either side; ū = w̄ on a ramp that is climbed, 1 − w̄ on one descended.
        let expected = 1.0 + 0.1f64.ln() / 9.0;
        let up = classify_piece(&ramp(), 0.0, 100.0, 1e-9);
        let down = classify_piece(&ramp(), 100.0, 0.0, 1e-9);
        assert!((up.extinction - expected).abs() < 1e-4 && (down.extinction - expected).abs() < 1e-4);
        assert!((up.node - up.middle).abs() < 1e-9 && (down.node - (1.0 - down.middle)).abs() < 1e-9);
        assert!((up.middle - numeric_moment() / expected).abs() < 1e-4, "{up:?}");
        // A stretch below the ramp adds nothing but its length.
        let half = classify_piece(&ramp(), -100.0, 100.0, 1e-9);
        assert!((half.extinction - 0.5 * expected).abs() < 1e-4);
        assert_eq!(classify_piece(&ramp(), -50.0, -1.0, 1.0).extinction, 0.0);
    }

    /// ∫₀¹ −w ln(1−0.9w) dw by Simpson's rule, another one than above.
    fn numeric_moment() -> f64 {
        let f = |w: f64| -w * (1.0 - 0.9 * w).ln();
        let n = 2000;
        let h = 1.0 / f64::from(n);
        let at = |i: i32| f(f64::from(i) * h);
        (0..n / 2).map(|i| h / 3.0 * (at(2 * i) + 4.0 * at(2 * i + 1) + at(2 * i + 2))).sum()
    }

    #[test]
    fn what_is_opaque_is_seen_at_its_front() {
        let thick = classify_piece(&ramp(), 0.0, 100.0, 200.0);
        let thin = classify_piece(&ramp(), 0.0, 100.0, 1e-9);
        assert!(thick.middle < 0.15 && thin.middle > 0.6 && thick.extinction == thin.extinction);
    }
}
