//! The pre-integrated transfer function (docs/rendering.md §5): what a piece of a ray shows, tabulated over the values at
//! both of its ends, so that thin materials and steep ramps cost no extra samples.

use rayon::prelude::*;

use crate::gpu::upload::Encoding;
use crate::scene::{StyleTransferFunction, TransferFunctionNode};
use crate::volume::Rescale;

/// Entries along each axis of the table.
pub const TABLE_SIZE: usize = 256;
/// Cells between them, along each axis: a jump of the transfer function takes two entries, one for either side, and what
/// lies between those two is never read. (Without a jump the last entry is not used.)
const CELLS: usize = TABLE_SIZE - 2;
/// κ of a material that hides everything (α_u ≥ 1 − 2⁻²⁴), per reference length: a quarter of it is opaque in f32, and a
/// table with larger numbers in it would be interpolated badly beside them.
const OPAQUE_EXTINCTION: f64 = 64.0;
/// Cells of the running integrals that the table is made from: whole ones between two entries, so that nothing of a foot
/// that lies on an entry is smeared to its other side.
const FINE: usize = 32 * CELLS;
/// Parts that a piece is cut into to weigh what lies in front: at least, and most, for one across the whole table.
const PARTS: (usize, usize) = (8, 72);

/// A transfer function as the GPU reads it.
#[derive(Debug)]
pub struct TransferTable {
    /// (κ̄, κ̄·ū, κ̄·w̄) and an unused 0, per value at the front (x) and at the back (y) of a piece.
    pub entries: Vec<[f32; 4]>,
    /// Texel value of coordinate 0, the center of the first entry.
    pub first: f64,
    /// Coordinate (0 … 1 from first to last entry) per texel unit; negative under a negative rescale slope.
    pub scale: f64,
    /// Coordinate from which on values belong to the upper side of the jump, a little below it, so that rounding takes no
    /// value on the jump to its lower side; above 1 where there is none.
    pub jump: f64,
    /// κ of values below and above the table, where its ends go on.
    pub outer_extinction: [f64; 2],
    /// w̄ of a whole piece of either.
    pub outer_middle: [f64; 2],
    /// Node coordinates of either.
    pub outer_node: [f64; 2],
    /// Node coordinate of the last node.
    pub last_node: usize,
    /// Number of fine cells before each one (and in all) that show something.
    visible_before: Vec<u32>,
}

impl TransferTable {
    /// Tabulates over the nodes' values and a quarter of their span beyond, as far as the data go (`data`: smallest and
    /// largest data value). `lengths` is the usual length of a part of a piece, in reference lengths.
    pub fn new(
        function: &StyleTransferFunction,
        rescale: Rescale,
        encoding: Encoding,
        data: (f64, f64),
        lengths: f64,
    ) -> Self {
        let Domain { low, high, jump } = domain(function, data);
        let integrals = Integrals::new(function, low, high);
        let entries = (0..TABLE_SIZE * TABLE_SIZE)
            .into_par_iter()
            .map(|i| {
                let at = |n: usize| match jump {
                    // Just below the jump, for pieces that lie on it with both ends.
                    Some(jump) if n == jump => (n as f64 - 1e-4) / CELLS as f64,
                    Some(jump) if n > jump => (n - 1) as f64 / CELLS as f64,
                    _ => n.min(CELLS) as f64 / CELLS as f64,
                };
                integrals.piece(at(i % TABLE_SIZE), at(i / TABLE_SIZE), lengths)
            })
            .collect();
        let mut visible_before = vec![0];
        visible_before.extend(integrals.extinction.windows(2).scan(0, |count, w| {
            *count += u32::from(w[1] > w[0]);
            Some(*count)
        }));
        let texel = |value: f64| encoding.texel((value - rescale.intercept) / rescale.slope);
        let ends = [low, high].map(|value| function.classify(value));
        let scale = rescale.slope / (encoding.scale * (high - low));
        let jump = jump.map_or(2.0, |n| {
            let place = n as f64 / CELLS as f64;
            let texel = texel(low + place * (high - low));
            place - 1e-7 - 2.5e-7 * (texel * scale).abs()
        });
        let outer_extinction = ends.map(|end| extinction(end.opacity));
        Self {
            entries,
            first: texel(low),
            scale,
            jump,
            outer_extinction,
            outer_middle: outer_extinction.map(|kappa| middle_of_constant(kappa * lengths)),
            outer_node: ends.map(|end| end.node),
            last_node: function.nodes.len() - 1,
            visible_before,
        }
    }

    /// Whether a piece between texel values in `low..=high` may show something, interpolation of the table and
    /// rounding included.
    pub fn shows(&self, low: f64, high: f64) -> bool {
        let position = |texel: f64| (texel - self.first) * self.scale;
        let (a, b) = (position(low).min(position(high)), position(low).max(position(high)));
        if (a < 0.0 && self.outer_extinction[0] > 0.0) || (b > 1.0 && self.outer_extinction[1] > 0.0) {
            return true;
        }
        // The table's neighbors on both sides, and a little for f32.
        let cells = CELLS as f64;
        let fine = |x: f64| x / cells * FINE as f64;
        let from = fine((a * cells - 1e-2).floor()).floor().clamp(0.0, FINE as f64) as usize;
        let to = fine((b * cells + 1e-2).ceil()).ceil().clamp(0.0, FINE as f64) as usize;
        self.visible_before[to] > self.visible_before[from]
    }
}

/// κ: extinction per reference length of a material of opacity `alpha` per reference length.
fn extinction(alpha: f64) -> f64 {
    if alpha >= 1.0 - 2f64.powi(-24) { OPAQUE_EXTINCTION } else { -(-alpha.max(0.0)).ln_1p() }
}

/// Where a piece of one material and optical depth `depth` is seen: ∫ w e^(−depth·w) dw / ∫ e^(−depth·w) dw.
fn middle_of_constant(depth: f64) -> f64 {
    // As written it is the difference of two large numbers where the piece is thin.
    if depth < 1e-3 { 0.5 - depth / 12.0 } else { 1.0 / depth - 1.0 / depth.exp_m1() }
}

/// The values that the table covers: around the nodes, but nothing that the data do not reach, so that a node at 1e9
/// ("and above") costs no resolution where the data are.
fn domain(function: &StyleTransferFunction, data: (f64, f64)) -> Domain {
    let (first, last) = (function.nodes[0].value, function.nodes[function.nodes.len() - 1].value);
    let (low, high) = (first.clamp(data.0, data.1), last.clamp(data.0, data.1));
    let size = low.abs().max(high.abs());
    let span = if high - low > 1e-4 * size {
        high - low
    } else {
        // Nodes at one single value are a step. Its sides are as far apart as f32 tells numbers of this size apart, and a
        // ten-thousandth of the data's range.
        let least = (1e-2 * size).max(1e-4 * (data.1 - data.0));
        if least > 0.0 { least } else { 1.0 }
    };
    // Never less than a few cells beyond the nodes, so that a jump at an outermost node keeps both of its sides.
    let margin = |room: f64| room.clamp(3.0 * span / TABLE_SIZE as f64, 0.25 * span);
    let (low, high) = (low - margin(low - data.0), high + margin(data.1 - high));
    // An entry on the value where it matters most that nothing is smeared: the first jump, else the foot of the first slope.
    let nodes = function.nodes.windows(2);
    let jump =
        nodes.clone().find(|w| w[0].value == w[1].value && (w[0].opacity, w[0].style) != (w[1].opacity, w[1].style));
    let foot = nodes.clone().find(|w| w[0].opacity == 0.0 && w[1].opacity > 0.0);
    let cell = (high - low) / (CELLS - 1) as f64;
    let place = |w: &[TransferFunctionNode]| Some(w[0].value).filter(|v| (low..=high).contains(v));
    let jump = jump.and_then(place);
    let (low, jump) = match jump.or(foot.and_then(place)) {
        Some(value) => {
            let n = ((value - low) / cell).ceil();
            (value - n * cell, jump.map(|_| n as usize))
        }
        None => (low, None),
    };
    Domain { low, high: low + CELLS as f64 * cell, jump }
}

/// The values that a table covers.
struct Domain {
    low: f64,
    high: f64,
    /// The entry of the lower side of a jump; the next one is that of its upper side.
    jump: Option<usize>,
}

/// Running integrals, over the domain mapped to 0 … 1, of κ and of κ × node coordinate.
struct Integrals {
    extinction: Vec<f64>,
    node: Vec<f64>,
    function: StyleTransferFunction,
    low: f64,
    high: f64,
}

impl Integrals {
    fn new(function: &StyleTransferFunction, low: f64, high: f64) -> Self {
        let (mut sum, mut node_sum) = (0.0, 0.0);
        let mut all = Self { extinction: vec![0.0], node: vec![0.0], function: function.clone(), low, high };
        for cell in 0..FINE {
            for part in 0..4 {
                let (kappa, node) = all.at((cell as f64 + (part as f64 + 0.5) / 4.0) / FINE as f64);
                sum += kappa / (4 * FINE) as f64;
                node_sum += kappa * node / (4 * FINE) as f64;
            }
            all.extinction.push(sum);
            all.node.push(node_sum);
        }
        all
    }

    /// κ and node coordinate at a place in the domain.
    fn at(&self, x: f64) -> (f64, f64) {
        let value = self.low + x * (self.high - self.low);
        // An entry that lies on a node lies on it in spite of rounding: at a jump that decides which side it is.
        let near = 1e-9 * (self.high - self.low);
        let on = self.function.nodes.iter().map(|n| n.value).find(|v| (value - v).abs() < near);
        let c = self.function.classify(on.unwrap_or(value));
        (extinction(c.opacity), c.node)
    }

    fn read(integral: &[f64], x: f64) -> f64 {
        let cell = x * FINE as f64;
        let i = (cell as usize).min(FINE - 1);
        integral[i] + (cell - i as f64) * (integral[i + 1] - integral[i])
    }

    /// (κ̄, κ̄·ū, κ̄·w̄, 0) of a piece from `front` to `back` (places in the domain) of `lengths` reference lengths.
    fn piece(&self, front: f64, back: f64, lengths: f64) -> [f32; 4] {
        let span = back - front;
        if span != 0.0 && Self::read(&self.extinction, front) == Self::read(&self.extinction, back) {
            return [0.0; 4];
        }
        let parts = PARTS.0 + (span.abs() * (PARTS.1 - PARTS.0) as f64) as usize;
        let (mut through, mut total) = (1.0, 0.0);
        let (mut weight, mut node, mut middle) = (0.0, 0.0, 0.0);
        let point = self.at(front.midpoint(back));
        for part in 0..parts {
            let (a, b) = (part as f64 / parts as f64, (part + 1) as f64 / parts as f64);
            let (kappa, kappa_node) = if span.abs() * (FINE as f64) < parts as f64 {
                (point.0, point.0 * point.1)
            } else {
                let mean =
                    |i: &[f64]| (Self::read(i, front + b * span) - Self::read(i, front + a * span)) / (span * (b - a));
                (mean(&self.extinction), mean(&self.node))
            };
            if kappa <= 0.0 {
                continue;
            }
            // What this part adds, seen through what is in front of it.
            let depth = lengths * kappa * (b - a);
            let share = through * -(-depth).exp_m1();
            through *= (-depth).exp();
            total += kappa * (b - a);
            weight += share;
            node += share * kappa_node / kappa;
            middle += share * (a + (b - a) * middle_of_constant(depth));
        }
        if weight <= 0.0 {
            // Too thin to weigh: nothing is in front of anything.
            return [total as f32, (total * point.1) as f32, (0.5 * total) as f32, 0.0];
        }
        [total as f32, (total * node / weight) as f32, (total * middle / weight) as f32, 0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Encoding = Encoding { offset: 0.0, scale: 1.0 };

    fn function(nodes: &[(f64, f64)]) -> StyleTransferFunction {
        let node = |&(value, opacity): &(f64, f64)| TransferFunctionNode { value, style: 0, opacity };
        StyleTransferFunction::new(nodes.iter().map(node).collect(), 1.0)
    }

    fn entry(table: &TransferTable, front: f64, back: f64) -> [f32; 4] {
        let index = |v: f64| {
            let x = (v - table.first) * table.scale;
            (x * CELLS as f64).round() as usize + usize::from(x >= table.jump)
        };
        table.entries[index(front) + TABLE_SIZE * index(back)]
    }

    #[test]
    fn a_step_counts_by_the_length_behind_it() {
        let table =
            TransferTable::new(&function(&[(100.0, 0.0), (100.0, 0.5)]), Rescale::IDENTITY, PLAIN, (0.0, 1e6), 1e-9);
        let cell = 1.0 / (table.scale * CELLS as f64);
        for (front, back, share, middle) in [(-40.0, 80.0, 2.0 / 3.0, 2.0 / 3.0), (60.0, -60.0, 0.5, 0.25)] {
            let [kappa, node, w, _] = entry(&table, 100.0 + front * cell, 100.0 + back * cell);
            let expected = share * 2f32.ln();
            assert!((kappa - expected).abs() < 0.02, "{kappa} is not {expected}");
            assert!((node / kappa - 1.0).abs() < 1e-3 && (w / kappa - middle).abs() < 0.02, "{node} {w} {kappa}");
        }
        assert!(!table.shows(0.0, 100.0 - 3.0 * cell) && table.shows(0.0, 100.1) && table.shows(1e5, 2e5));
    }

    #[test]
    fn what_is_in_front_hides_what_is_behind() {
        let ramp = function(&[(0.0, 0.0), (100.0, 0.9)]);
        let at = |lengths| {
            let table = TransferTable::new(&ramp, Rescale::IDENTITY, PLAIN, (-50.0, 150.0), lengths);
            let [kappa, node, w, _] = entry(&table, 0.0, 100.0);
            (kappa, node / kappa, w / kappa)
        };
        let (thin, thick) = (at(1e-9), at(50.0));
        assert!((thin.0 - thick.0).abs() < 1e-6, "the mean extinction does not depend on the length");
        // ∫ −ln(1−0.9w) dw = 1 + ln(0.1)/9
        let expected = 1.0 + 0.1f32.ln() / 9.0;
        assert!((thin.0 - expected).abs() < 0.02, "{} is not {expected}", thin.0);
        assert!(thin.2 > 0.6 && thick.2 < 0.25 && thick.1 < thin.1, "{thin:?} {thick:?}");
    }

    #[test]
    fn a_negative_slope_turns_the_table_around() {
        let rescale = Rescale { slope: -1.0, intercept: 200.0 };
        let table = TransferTable::new(&function(&[(50.0, 0.0), (100.0, 1.0)]), rescale, PLAIN, (0.0, 200.0), 1.0);
        // Stored 150 is value 50, stored 100 is value 100.
        assert!(table.scale < 0.0 && table.shows(0.0, 110.0) && !table.shows(155.0, 200.0));
    }
}

#[cfg(test)]
mod against_quadrature {
    use super::*;
    use crate::reference::piece::classify_piece;

    /// `classify_piece` of the shader, in f64.
    fn look_up(table: &TransferTable, front: f64, back: f64) -> [f64; 3] {
        let (a, b) = ((front - table.first) * table.scale, (back - table.first) * table.scale);
        let way = b - a;
        let (enter, leave) = if way.abs() < 1e-9 {
            (f64::from(u8::from(!(0.0..=1.0).contains(&a))), 1.0)
        } else {
            let (p, q) = (-a / way, (1.0 - a) / way);
            (p.min(q).clamp(0.0, 1.0), p.max(q).clamp(0.0, 1.0))
        };
        let inside = leave - enter;
        let place = |x: f64| x * CELLS as f64 + f64::from(u8::from(x >= table.jump));
        let ends = [a + enter * way, a + leave * way].map(|x| place(x.clamp(0.0, 1.0)));
        let cell = ends.map(|x| (x as usize).min(TABLE_SIZE - 2));
        let w = [ends[0] - cell[0] as f64, ends[1] - cell[1] as f64];
        let entry =
            |i: usize, j: usize, c: usize| f64::from(table.entries[cell[0] + i + TABLE_SIZE * (cell[1] + j)][c]);
        let mix = |a: f64, b: f64, w: f64| a + w * (b - a);
        let found: [f64; 3] = std::array::from_fn(|c| {
            mix(mix(entry(0, 0, c), entry(1, 0, c), w[0]), mix(entry(0, 1, c), entry(1, 1, c), w[0]), w[1])
        });
        let outer = |x: f64| {
            let end = usize::from(x > 0.5);
            (table.outer_extinction[end], table.outer_node[end])
        };
        let middle = |x: f64| table.outer_middle[usize::from(x > 0.5)];
        let (before, behind) = (outer(a), outer(b));
        let (before, behind) = ((enter * before.0, before.1), ((1.0 - leave) * behind.0, behind.1));
        [
            before.0 + inside * found[0] + behind.0,
            before.0 * before.1 + inside * found[1] + behind.0 * behind.1,
            before.0 * enter * middle(a)
                + inside * (found[0] * enter + found[2] * inside)
                + behind.0 * (leave + (1.0 - leave) * middle(b)),
        ]
    }

    #[test]
    fn the_table_is_the_quadrature() {
        let node = |&(value, opacity): &(f64, f64)| TransferFunctionNode { value, style: 0, opacity };
        let functions: [&[(f64, f64)]; 3] = [
            &[(150.0, 0.0), (300.0, 0.9), (700.0, 1.0)],
            &[(100.0, 0.0), (400.0, 0.05), (600.0, 0.1), (600.0, 0.3)],
            &[(380.0, 0.0), (480.0, 0.95), (1400.0, 1.0), (1700.0, 1.0)],
        ];
        for nodes in functions {
            let function = StyleTransferFunction::new(nodes.iter().map(node).collect(), 1.0);
            for lengths in [0.5, 2.0] {
                let plain = Encoding { offset: 0.0, scale: 1.0 };
                let table = TransferTable::new(&function, Rescale::IDENTITY, plain, (-1000.0, 3000.0), lengths);
                let (mut worst, mut hash) = ([(0.0, 0.0, 0.0); 3], 1u32);
                for _ in 0..4000 {
                    let mut random = || {
                        hash = hash.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        f64::from(hash >> 8) / f64::from(1 << 24)
                    };
                    let front = -100.0 + 1900.0 * random();
                    let back = front + 300.0 * (random() - 0.5);
                    let found = look_up(&table, front, back);
                    let exact = classify_piece(&function, front, back, lengths);
                    let alpha = |kappa: f64| -(-kappa * lengths).exp_m1();
                    let weight = alpha(exact.extinction);
                    let errors = [
                        alpha(found[0]) - weight,
                        weight * (found[1] / found[0].max(1e-30) - exact.node),
                        weight * (found[2] / found[0].max(1e-30) - exact.middle),
                    ];
                    for (w, e) in worst.iter_mut().zip(errors) {
                        if e.abs() > w.0 {
                            *w = (e.abs(), front, back);
                        }
                    }
                }
                println!("{nodes:?} {lengths}: {worst:?}");
                // Half a cell of the table beside a jump; on the same cells where it is seen may be off by a quarter.
                assert!(worst[0].0 < 0.03 && worst[1].0 < 0.02 && worst[2].0 < 0.3, "{nodes:?} {lengths}: {worst:?}");
            }
        }
    }
}
