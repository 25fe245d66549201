//! What a template says of a transfer function's second coordinate (thesis §3.3.5).

use anyhow::{Result, bail};
use fabrica_engine::scene::across::MAX_ROWS;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{NodeTemplate, TransferFunctionTemplate};

/// A second coordinate of a transfer function, and the rows of nodes along it. The function's own nodes are the first row; a place
/// between two rows is shared out between them, beyond the outermost these go on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AcrossTemplate {
    /// What the coordinate is.
    pub by: AxisName,
    /// For distances: the title of the region, or the name of the structure, whose surface they are measured from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// Where on it the function's own nodes are.
    #[serde(default)]
    pub at: f64,
    /// Further rows, ascending from there; eight in all at most.
    pub rows: Vec<RowTemplate>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// What a second coordinate is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum AxisName {
    /// How steeply data change: 0 in homogeneous matter, 1 on the scan's sharpest edges.
    Edge,
    /// Distance in mm from the surface of a region, below 0 inside of it.
    Distance,
    /// How much the part matters that is drawn: a region's importance.
    Importance,
}

/// Nodes at a place on the second coordinate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RowTemplate {
    /// Where.
    pub at: f64,
    /// Ascending in `at`.
    pub nodes: Vec<NodeTemplate>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

impl AxisName {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Edge, Self::Distance, Self::Importance];

    /// What it is called.
    pub fn title(self) -> &'static str {
        match self {
            Self::Edge => "edge strength",
            Self::Distance => "distance",
            Self::Importance => "importance",
        }
    }

    /// Behind a number on it.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Distance => " mm",
            Self::Edge | Self::Importance => "",
        }
    }
}

impl AcrossTemplate {
    /// Where the rows are, ascending.
    pub fn places(&self) -> Vec<f64> {
        std::iter::once(self.at).chain(self.rows.iter().map(|row| row.at)).collect()
    }
}

impl TransferFunctionTemplate {
    /// How many rows it has: 1, if it goes by values alone.
    pub fn num_rows(&self) -> usize {
        1 + self.across.as_ref().map_or(0, |across| across.rows.len())
    }

    /// The nodes of a row; of the last, beyond it.
    pub fn nodes_of(&self, row: usize) -> &Vec<NodeTemplate> {
        let further = self.across.as_ref().zip(row.checked_sub(1));
        let found = further.and_then(|(across, i)| across.rows.get(i).or(across.rows.last()));
        found.map_or(&self.nodes, |row| &row.nodes)
    }

    /// The same, to be changed.
    pub fn nodes_of_mut(&mut self, row: usize) -> &mut Vec<NodeTemplate> {
        let Some(i) = row.min(self.num_rows() - 1).checked_sub(1) else { return &mut self.nodes };
        match self.across.as_mut().and_then(|across| across.rows.get_mut(i)) {
            Some(row) => &mut row.nodes,
            None => &mut self.nodes,
        }
    }

    /// The nodes of all rows.
    pub fn all_nodes(&self) -> impl Iterator<Item = &NodeTemplate> {
        self.nodes.iter().chain(self.across.iter().flat_map(|across| &across.rows).flat_map(|row| &row.nodes))
    }

    /// The same, to be changed.
    pub fn all_nodes_mut(&mut self) -> impl Iterator<Item = &mut NodeTemplate> {
        let further = self.across.iter_mut().flat_map(|across| &mut across.rows);
        self.nodes.iter_mut().chain(further.flat_map(|row| &mut row.nodes))
    }

    /// It with a row's nodes alone.
    #[must_use]
    pub fn row(&self, row: usize) -> Self {
        Self { nodes: self.nodes_of(row).clone(), across: None, ..self.clone() }
    }

    /// It with another row at a place of the second coordinate, which has what is drawn there most; unchanged without a coordinate or
    /// room. And which row that is.
    #[must_use]
    pub fn with_row(&self, at: f64) -> (Self, usize) {
        let mut made = self.clone();
        let Some(across) = made.across.as_mut().filter(|across| across.rows.len() + 1 < MAX_ROWS) else {
            return (made, 0);
        };
        let places = across.places();
        let nearest = (0..places.len()).min_by(|a, b| (places[*a] - at).abs().total_cmp(&(places[*b] - at).abs()));
        let nodes = self.nodes_of(nearest.unwrap_or(0)).clone();
        let place = places.partition_point(|other| *other <= at);
        if place == 0 {
            let first =
                RowTemplate { at: across.at, nodes: std::mem::replace(&mut made.nodes, nodes), extra: Map::new() };
            across.rows.insert(0, first);
            across.at = at;
        } else {
            across.rows.insert(place - 1, RowTemplate { at, nodes, extra: Map::new() });
        }
        (made, place)
    }

    /// It without a row; without a second coordinate, if but one is left.
    #[must_use]
    pub fn without_row(&self, row: usize) -> Self {
        let mut made = self.clone();
        let Some(across) = &mut made.across else { return made };
        match row.checked_sub(1) {
            Some(i) if i < across.rows.len() => drop(across.rows.remove(i)),
            Some(_) => {}
            None if across.rows.is_empty() => {}
            None => {
                let first = across.rows.remove(0);
                (across.at, made.nodes) = (first.at, first.nodes);
            }
        }
        if across.rows.is_empty() {
            made.across = None;
        }
        made
    }

    /// It with a row at another place, between its neighbors.
    #[must_use]
    pub fn with_row_at(&self, row: usize, at: f64) -> Self {
        let mut made = self.clone();
        let Some(across) = &mut made.across else { return made };
        let places = across.places();
        let gap = 1e-3 * (places[places.len() - 1] - places[0]).abs().max(1e-3);
        let low = row.checked_sub(1).and_then(|i| places.get(i)).map_or(f64::NEG_INFINITY, |place| place + gap);
        let high = places.get(row + 1).map_or(f64::INFINITY, |place| place - gap);
        let at = at.max(low).min(high.max(low));
        match row.checked_sub(1) {
            None => across.at = at,
            Some(i) => {
                if let Some(row) = across.rows.get_mut(i) {
                    row.at = at;
                }
            }
        }
        made
    }

    /// Checks what the types cannot of the second coordinate; `whose` it is begins the sentence.
    pub(super) fn check_across(&self, whose: &str) -> Result<()> {
        let Some(across) = &self.across else { return Ok(()) };
        if across.rows.is_empty() || across.rows.len() >= MAX_ROWS {
            bail!("{whose} has a 2-D transfer function of {} rows; give it two to {MAX_ROWS}", across.rows.len() + 1);
        }
        let places = across.places();
        if let Some(at) = places.iter().find(|at| !at.is_finite()) {
            bail!("{whose} has a row at {at}; give a number");
        }
        if let Some(w) = places.windows(2).find(|w| w[0] >= w[1]) {
            bail!("{whose} has rows that do not ascend ({} before {}); sort them", w[0], w[1]);
        }
        if across.by == AxisName::Distance && across.from.as_ref().is_none_or(String::is_empty) {
            bail!("{whose} goes by distance from nothing; name a region in \"from\"");
        }
        across.rows.iter().try_for_each(|row| super::check_nodes(&row.nodes, self.domain, whose))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Domain, NodeTemplate};
    use super::*;

    fn function(places: &[f64]) -> TransferFunctionTemplate {
        let nodes = |at: f64| vec![NodeTemplate { at, style: "wax".into(), opacity: 0.5, extra: Map::new() }];
        let row = |at: &f64| RowTemplate { at: *at, nodes: nodes(*at), extra: Map::new() };
        TransferFunctionTemplate {
            domain: Domain::Data,
            reference_length_mm: None,
            nodes: nodes(places[0]),
            across: (places.len() > 1).then(|| AcrossTemplate {
                by: AxisName::Edge,
                from: None,
                at: places[0],
                rows: places[1..].iter().map(row).collect(),
                extra: Map::new(),
            }),
            extra: Map::new(),
        }
    }

    fn rows(function: &TransferFunctionTemplate) -> Vec<(f64, f64)> {
        let places = function.across.as_ref().map_or(vec![0.0], AcrossTemplate::places);
        places.into_iter().enumerate().map(|(i, at)| (at, function.nodes_of(i)[0].at)).collect()
    }

    #[test]
    fn rows_come_and_go_at_their_places() {
        let two = function(&[0.0, 1.0]);
        let (below, at) = two.with_row(-1.0);
        assert_eq!((rows(&below), at), (vec![(-1.0, 0.0), (0.0, 0.0), (1.0, 1.0)], 0));
        let (between, at) = two.with_row(0.7);
        assert_eq!((rows(&between), at), (vec![(0.0, 0.0), (0.7, 1.0), (1.0, 1.0)], 1));
        let (above, at) = two.with_row(2.0);
        assert_eq!((rows(&above), at), (vec![(0.0, 0.0), (1.0, 1.0), (2.0, 1.0)], 2));
        assert_eq!(below.without_row(0), two);
        assert_eq!(above.without_row(2), two);
        let one = two.without_row(0);
        assert_eq!((one.across.is_none(), one.nodes[0].at), (true, 1.0));
        let mut full = two;
        for i in 0..9 {
            full = full.with_row(2.0 + f64::from(i)).0;
        }
        assert_eq!(full.num_rows(), MAX_ROWS);
    }

    #[test]
    fn rows_stay_between_their_neighbors() {
        let three = function(&[0.0, 1.0, 2.0]);
        for (row, at) in [(0, 5.0), (1, -3.0), (1, 9.0), (2, 0.0)] {
            let moved = three.with_row_at(row, at);
            let places = moved.across.as_ref().unwrap().places();
            assert!(places.windows(2).all(|w| w[0] < w[1]), "{places:?}");
        }
        assert_eq!(rows(&three.with_row_at(1, 1.5))[1], (1.5, 1.0));
    }

    #[test]
    fn faults_are_sentences() {
        let fault = |f: TransferFunctionTemplate| f.check_across("the object").unwrap_err().to_string();
        assert!(fault(function(&[1.0, 1.0])).contains("ascend"));
        assert!(fault(function(&[0.0, f64::NAN])).contains("NaN"));
        assert!(fault(function(&(0..9).map(f64::from).collect::<Vec<_>>())).contains("9 rows"));
        let mut distance = function(&[0.0, 1.0]);
        distance.across.as_mut().unwrap().by = AxisName::Distance;
        assert!(fault(distance).contains("from nothing"));
    }
}
