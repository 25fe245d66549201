//! The transfer function as numbers: where its nodes are among the values, what lies between them, and how a node comes in.

use std::ops::Range;

use fabrica_engine::volume::statistics::Statistics;
use fabrica_engine::volume::{Modality, Volume};

use super::super::open_figure::OpenFigure;
use crate::figure::Command;
use crate::figure::command::{FunctionOf, function_at};
use crate::figure::template::{Domain, NodeTemplate, TransferFunctionTemplate};

/// Between a node's position, as its domain counts it, and data values.
#[derive(Clone, Copy)]
pub struct Positions<'a> {
    domain: Domain,
    statistics: Option<&'a Statistics>,
}

impl<'a> Positions<'a> {
    /// Of a transfer function on a volume, if it is there.
    pub fn new(function: &TransferFunctionTemplate, statistics: Option<&'a Statistics>) -> Self {
        Self { domain: function.domain, statistics }
    }

    /// The data value at a position (the position itself where nothing is known of the volume).
    pub fn value(self, at: f64) -> f64 {
        match (self.domain, self.statistics) {
            (Domain::Percentile, Some(statistics)) => statistics.percentile_above_background(at),
            _ => at,
        }
    }

    /// The position of a data value, rounded to what `resolution` (in data values) can tell apart.
    pub fn at(self, value: f64, resolution: f64) -> f64 {
        match (self.domain, self.statistics) {
            (Domain::Percentile, Some(statistics)) => {
                round_to(statistics.percentile_rank_above_background(value), 0.01)
            }
            (Domain::Percentile, None) => round_to(value.clamp(0.0, 100.0), 0.01),
            (Domain::Data, _) => round_to(value, resolution),
        }
    }

    /// What a point of a drag of a number is worth.
    pub fn speed(self) -> f64 {
        match (self.domain, self.statistics) {
            (Domain::Data, Some(s)) => ((s.max - s.min) / 1000.0).max(1e-9),
            _ => 0.1,
        }
    }

    /// What positions are.
    pub fn name(self) -> &'static str {
        match self.domain {
            Domain::Data => "value",
            Domain::Percentile => "percentile",
        }
    }

    /// What numbers of positions are followed by.
    pub fn unit(self, volume: Option<&Volume>) -> &'static str {
        match self.domain {
            Domain::Percentile => " %",
            Domain::Data => volume.map_or("", |v| v.modality.suffix()),
        }
    }
}

/// To a multiple of the power of ten at or below `resolution`.
pub fn round_to(value: f64, resolution: f64) -> f64 {
    if !(resolution.is_finite() && resolution > 0.0) {
        return value;
    }
    let digits = -resolution.log10().floor();
    // A power of ten with a positive exponent is exact, its inverse is not.
    if digits >= 0.0 {
        let scale = 10f64.powf(digits.min(15.0));
        (value * scale).round() / scale
    } else {
        let scale = 10f64.powf(-digits);
        (value / scale).round() * scale
    }
}

/// The values that matter: the volume's, without the far ends that hardly a voxel has, and all nodes.
pub fn whole_range(values: &[f64], volume: Option<(&Volume, &Statistics)>) -> (f64, f64) {
    let nodes = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    let (mut low, mut high) = match volume {
        Some((volume, s)) if volume.modality == Modality::Ct => (s.min.max(-1050.0), s.max.min(2000.0)),
        Some((_, s)) => (s.min, s.percentile(99.99).max(s.percentile_above_background(99.0))),
        None => nodes,
    };
    (low, high) = (low.min(nodes.0), high.max(nodes.1));
    let margin = 0.03 * (high - low);
    if margin > 0.0 && margin.is_finite() { (low - margin, high + margin) } else { (low - 1.0, low + 1.0) }
}

/// The opacity that the curve has at a value.
pub fn opacity_at(values: &[f64], nodes: &[NodeTemplate], value: f64) -> f64 {
    let above = values.partition_point(|v| *v <= value);
    match (above.checked_sub(1), values.get(above)) {
        (None, _) => nodes.first().map_or(0.0, |n| n.opacity),
        (Some(below), None) => nodes[below].opacity,
        (Some(below), Some(next)) => {
            let share = (value - values[below]) / (next - values[below]);
            nodes[below].opacity + share * (nodes[above].opacity - nodes[below].opacity)
        }
    }
}

/// A node on the curve at a value, in the style that is nearest there.
pub fn node_on_curve(
    positions: Positions<'_>,
    function: &TransferFunctionTemplate,
    value: f64,
    resolution: f64,
) -> NodeTemplate {
    let values: Vec<f64> = function.nodes.iter().map(|n| positions.value(n.at)).collect();
    let nearest = (0..values.len()).min_by(|a, b| (values[*a] - value).abs().total_cmp(&(values[*b] - value).abs()));
    NodeTemplate {
        at: positions.at(value, resolution),
        style: nearest.map_or_else(|| "clay".to_owned(), |i| function.nodes[i].style.clone()),
        opacity: round_to(opacity_at(&values, &function.nodes, value), 0.01).clamp(0.0, 1.0),
        extra: serde_json::Map::new(),
    }
}

/// Puts a node into the curve that is worked on at a data value, and chooses it. Without a style and an opacity of its own
/// it changes nothing of the picture.
pub fn insert_node(open: &mut OpenFigure, value: f64, resolution: f64, style: Option<String>, opacity: Option<f64>) {
    let Some(function) = open.function() else { return };
    let statistics = statistics_of(open.chosen_volume().map(|v| &**v));
    let mut node = node_on_curve(Positions::new(&function, statistics), &function, value, resolution);
    if let Some(style) = style {
        node.style = style;
    }
    if let Some(opacity) = opacity {
        node.opacity = round_to(opacity, 0.01);
    }
    let place = function.nodes.partition_point(|n| n.at <= node.at);
    open.edit(Command::InsertNode { of: open.function_of(), node });
    if open.fault.is_none() {
        open.node = Some(place);
    }
}

/// Puts a node half way from the chosen one to the next (beyond the last: as far on as the range is wide, a tenth of it).
pub fn insert_after_chosen(open: &mut OpenFigure) {
    let (Some(function), Some(number)) = (open.function(), open.node) else { return };
    let positions = Positions::new(&function, statistics_of(open.chosen_volume().map(|v| &**v)));
    let values: Vec<f64> = function.nodes.iter().map(|n| positions.value(n.at)).collect();
    let width = (values[values.len() - 1] - values[0]).max(1.0);
    let value = values.get(number + 1).map_or(values[number] + 0.1 * width, |next| 0.5 * (values[number] + next));
    insert_node(open, value, 1e-3 * width, None, None);
}

/// Successive nodes of one style.
pub fn materials(nodes: &[NodeTemplate]) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (i, node) in nodes.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if nodes[run.start].style == node.style => run.end = i + 1,
            _ => runs.push(i..i + 1),
        }
    }
    runs
}

/// Dresses the material that a node of a transfer function is of.
pub fn dress_material(open: &mut OpenFigure, of: FunctionOf, node: usize, style: &str) {
    let Some(function) = function_at(open.document.figure(), &of) else { return };
    if let Some(nodes) = materials(function.nodes_of(of.row)).into_iter().find(|run| run.contains(&node)) {
        open.edit(Command::SetStyle { of, nodes, style: style.to_owned() });
    }
}

/// What is known of a volume's values; counted when it was loaded.
pub fn statistics_of(volume: Option<&Volume>) -> Option<&Statistics> {
    volume.and_then(|v| v.known_statistics())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(at: f64, style: &str, opacity: f64) -> NodeTemplate {
        NodeTemplate { at, style: style.to_owned(), opacity, extra: serde_json::Map::new() }
    }

    #[test]
    fn materials_are_runs_of_one_style() {
        let nodes = [node(0.0, "a", 0.0), node(1.0, "a", 1.0), node(2.0, "b", 1.0), node(3.0, "a", 1.0)];
        assert_eq!(materials(&nodes), [0..2, 2..3, 3..4]);
        assert!(materials(&[]).is_empty());
    }

    #[test]
    fn a_new_node_lies_on_the_curve() {
        let nodes = vec![node(0.0, "a", 0.0), node(100.0, "b", 0.8), node(100.0, "c", 0.2)];
        let function = TransferFunctionTemplate {
            across: None,
            domain: Domain::Data,
            reference_length_mm: None,
            nodes,
            extra: serde_json::Map::new(),
        };
        let positions = Positions::new(&function, None);
        let made = |value| node_on_curve(positions, &function, value, 1.0);
        assert!((made(50.4).at, made(50.4).opacity) == (50.0, 0.4) && made(20.0).style == "a");
        assert!(made(-7.0).opacity == 0.0 && made(900.0).opacity == 0.2 && made(99.0).style == "b");
    }

    #[test]
    fn numbers_are_rounded_to_what_a_pixel_tells() {
        assert_eq!(round_to(123.456, 3.0), 123.0);
        assert_eq!(round_to(123.456, 0.3), 123.5);
        assert_eq!(round_to(123.456, 20.0), 120.0);
        assert_eq!(round_to(0.123_456, 0.001), 0.123);
        assert_eq!(round_to(1.5, 0.0), 1.5);
    }
}
