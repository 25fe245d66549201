//! 2-D style transfer functions (thesis §3.3.5): data value and a second coordinate → style and opacity.

use std::borrow::Cow;

use super::transfer_function::validate_nodes;
use super::{StyleTransferFunction, TransferFunctionNode};
use crate::error::{Error, Result};

/// The second coordinate of a transfer function, and its rows along it. The function's own nodes are the first row. A place between
/// two rows is shared out between them as between two regions, linearly; beyond the outermost rows these go on.
#[derive(Clone, Debug, PartialEq)]
pub struct Across {
    /// What the coordinate is.
    pub axis: Axis,
    /// Where on it the function's own nodes are.
    pub at: f64,
    /// One to [`MAX_ROWS`] − 1 further rows, ascending from there.
    pub rows: Vec<Row>,
}

/// Nodes at a place on the second coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Where.
    pub at: f64,
    /// At least one node, values ascending.
    pub nodes: Vec<TransferFunctionNode>,
}

/// A second coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Axis {
    /// ‖ĝ‖: 0 where data do not change, 1 on a full edge.
    Edge,
    /// Distance to a surface, mm, below 0 inside: the position of its field in [`Object::distances`](super::Object::distances).
    Distance(usize),
    /// A number that is the same throughout, as a region's importance is.
    Even(f64),
}

/// Most rows of a function, its own nodes included.
pub const MAX_ROWS: usize = 8;

/// Rows that share out a place: the lower one, the upper one, and the share of the upper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Between {
    /// Number of the row at or below the place; 0 is the function's own.
    pub lower: usize,
    /// The next one, or the same where the lower has it all.
    pub upper: usize,
    /// Share of the upper one, in [0, 1).
    pub weight: f64,
}

impl Across {
    /// Where the rows are, ascending.
    pub fn places(&self) -> impl Iterator<Item = f64> {
        std::iter::once(self.at).chain(self.rows.iter().map(|row| row.at))
    }

    /// The rows around a place. NaN counts as below the first.
    pub fn between(&self, place: f64) -> Between {
        let places: Vec<f64> = self.places().collect();
        let above = places.partition_point(|at| *at <= place);
        match above {
            0 => Between { lower: 0, upper: 0, weight: 0.0 },
            n if n == places.len() => Between { lower: n - 1, upper: n - 1, weight: 0.0 },
            n => {
                let weight = (place - places[n - 1]) / (places[n] - places[n - 1]);
                Between { lower: n - 1, upper: if weight > 0.0 { n } else { n - 1 }, weight }
            }
        }
    }

    /// `num_distances`: fields that the object has.
    pub(super) fn validate(&self, num_styles: usize, num_distances: usize) -> Result<()> {
        let fail = |what: String, remedy: &str| Err(Error::scene(what, remedy));
        if self.rows.is_empty() || self.rows.len() >= MAX_ROWS {
            return fail(
                format!("a 2-D transfer function has {} rows", self.rows.len() + 1),
                "give it two to eight, or make it 1-D",
            );
        }
        let places: Vec<f64> = self.places().collect();
        if let Some(at) = places.iter().find(|at| !at.is_finite()) {
            return fail(format!("a row of a transfer function is at {at}"), "give a number");
        }
        if let Some(w) = places.windows(2).find(|w| w[0] >= w[1]) {
            return fail(format!("a transfer function has a row at {} after one at {}", w[1], w[0]), "let rows ascend");
        }
        match self.axis {
            Axis::Even(place) if !place.is_finite() => fail(format!("a row is wanted at {place}"), "give a number")?,
            Axis::Distance(field) if field >= num_distances => fail(
                format!("a transfer function goes by distance {field} of {num_distances}"),
                "add the distances to the object",
            )?,
            _ => {}
        }
        self.rows.iter().try_for_each(|row| validate_nodes(&row.nodes, num_styles))
    }
}

impl StyleTransferFunction {
    /// The rows by themselves, from the function's own nodes on, as 1-D functions: itself, where it is one.
    pub fn rows(&self) -> impl Iterator<Item = Self> + '_ {
        let row = |nodes: &Vec<TransferFunctionNode>| Self { nodes: nodes.clone(), across: None, ..*self };
        let further = self.across.iter().flat_map(|across| &across.rows);
        std::iter::once(&self.nodes).chain(further.map(|row| &row.nodes)).map(row)
    }

    /// A row by itself; 0 is the function's own nodes. Beyond the last row, that.
    pub fn row(&self, row: usize) -> Cow<'_, Self> {
        let Some(across) = &self.across else { return Cow::Borrowed(self) };
        let further = row.checked_sub(1).and_then(|i| across.rows.get(i).or(across.rows.last()));
        let nodes = further.map_or(&self.nodes, |row| &row.nodes);
        Cow::Owned(Self { nodes: nodes.clone(), across: None, ..*self })
    }

    /// The nodes of all rows.
    pub fn all_nodes(&self) -> impl Iterator<Item = &TransferFunctionNode> {
        self.nodes.iter().chain(self.across.iter().flat_map(|across| &across.rows).flat_map(|row| &row.nodes))
    }

    /// The same, to be changed.
    pub fn all_nodes_mut(&mut self) -> impl Iterator<Item = &mut TransferFunctionNode> {
        self.nodes.iter_mut().chain(self.across.iter_mut().flat_map(|a| &mut a.rows).flat_map(|row| &mut row.nodes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_share_out_what_is_between_them() {
        let row = |at| Row { at, nodes: Vec::new() };
        let across = Across { axis: Axis::Edge, at: -1.0, rows: vec![row(1.0), row(5.0)] };
        let found = |place| {
            let Between { lower, upper, weight } = across.between(place);
            (lower, upper, weight)
        };
        assert_eq!(found(-3.0), (0, 0, 0.0));
        assert_eq!(found(f64::NAN), (0, 0, 0.0));
        assert_eq!(found(0.0), (0, 1, 0.5));
        assert_eq!(found(1.0), (1, 1, 0.0));
        assert_eq!(found(4.0), (1, 2, 0.75));
        assert_eq!(found(5.0), (2, 2, 0.0));
        assert_eq!(found(f64::INFINITY), (2, 2, 0.0));
    }
}
