//! Style transfer functions (thesis §3.3.2): data value, and a second coordinate if wanted, → lit-sphere style and opacity.

use super::Across;
use crate::error::{Error, Result};

/// One node: from here on towards the next node, style and opacity change linearly into the next one's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransferFunctionNode {
    /// Data value (CT: HU).
    pub value: f64,
    /// Position of the style in [`Scene::styles`](super::Scene::styles).
    pub style: usize,
    /// α_u: opacity, in [0, 1], of one reference length of this material, before the style's own α_d.
    pub opacity: f64,
}

/// Nodes in ascending value. Below the first and above the last node their style and opacity go on.
/// Two nodes at one value are a jump.
#[derive(Clone, Debug, PartialEq)]
pub struct StyleTransferFunction {
    /// At least one node, values ascending.
    pub nodes: Vec<TransferFunctionNode>,
    /// d₀ in mm: the length that opacities are stated for.
    pub reference_length_mm: f64,
    /// Lines where surfaces turn away, if there are any.
    pub contours: Option<Contours>,
    /// Whether opacity is modulated as in eq. 3.2: what is flat or homogeneous becomes transparent first, contours last.
    pub illustrative_transparency: bool,
    /// A second coordinate, of which the nodes above are the first row; none: the function is 1-D.
    pub across: Option<Across>,
}

/// Lines of controlled width where surfaces turn away from the eye (thesis §3.3.3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contours {
    /// T: width on the page, in figure points (1/72 inch); above 0.
    pub width_pt: f64,
    /// Linear RGB; none: the rim of the style, in the direction of the normal.
    pub color: Option<[f32; 3]>,
}

/// The widest contours, in points: an inch.
pub const MAX_CONTOUR_PT: f64 = 72.0;

/// What a transfer function says about one value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Classified {
    /// α_u at the value.
    pub opacity: f64,
    /// Node coordinate: i + w means "w of the way from node i's style to node i+1's".
    pub node: f64,
}

impl StyleTransferFunction {
    /// A 1-D function without contours, of opacity as its nodes have it.
    pub fn new(nodes: Vec<TransferFunctionNode>, reference_length_mm: f64) -> Self {
        Self { nodes, reference_length_mm, contours: None, illustrative_transparency: false, across: None }
    }

    /// Evaluates its own nodes exactly, in f64, no further row. NaN is treated as below the first node.
    pub fn classify(&self, value: f64) -> Classified {
        let last = self.nodes.len() - 1;
        let above = self.nodes.partition_point(|n| n.value <= value);
        match above {
            0 => Classified { opacity: self.nodes[0].opacity, node: 0.0 },
            i if i > last => Classified { opacity: self.nodes[last].opacity, node: last as f64 },
            i => {
                let (a, b) = (&self.nodes[i - 1], &self.nodes[i]);
                let w = (value - a.value) / (b.value - a.value);
                Classified { opacity: a.opacity + w * (b.opacity - a.opacity), node: (i - 1) as f64 + w }
            }
        }
    }

    /// Whether its own nodes give the same opacity and style to every value, one by one, however these are drawn.
    pub fn classifies_as(&self, other: &Self) -> bool {
        self.nodes == other.nodes && self.reference_length_mm == other.reference_length_mm
    }

    /// Whether its own nodes give the same opacity to every value as those of `other` do, one by one, whatever the styles.
    pub fn same_opacity(&self, other: &Self) -> bool {
        let alike =
            |(a, b): (&TransferFunctionNode, &TransferFunctionNode)| a.value == b.value && a.opacity == b.opacity;
        self.reference_length_mm == other.reference_length_mm
            && self.nodes.len() == other.nodes.len()
            && self.nodes.iter().zip(&other.nodes).all(alike)
    }

    /// Largest opacity of any value in `low..=high`, both sides of jumps included, in any row.
    pub fn max_opacity(&self, low: f64, high: f64) -> f64 {
        let of_row = |row: Self| {
            let inside = row.nodes.iter().filter(|n| (low..=high).contains(&n.value)).map(|n| n.opacity);
            inside.fold(row.classify(low).opacity.max(row.classify(high).opacity), f64::max)
        };
        self.rows().map(of_row).fold(0.0, f64::max)
    }

    /// `num_distances`: fields of distances that the object has.
    pub(super) fn validate(&self, num_styles: usize, num_distances: usize) -> Result<()> {
        let fail = |what: String, remedy: &str| Err(Error::scene(what, remedy));
        validate_nodes(&self.nodes, num_styles)?;
        if !(self.reference_length_mm.is_finite() && self.reference_length_mm > 0.0) {
            return fail(
                format!("the reference length of opacity is {} mm", self.reference_length_mm),
                "give a positive length",
            );
        }
        if let Some(Contours { width_pt, color }) = self.contours {
            if !(width_pt > 0.0 && width_pt <= MAX_CONTOUR_PT) {
                return fail(
                    format!("contours are {width_pt} points wide"),
                    "give a width above 0 and up to 72 points, or none",
                );
            }
            if color.is_some_and(|color| color.iter().any(|c| !(0.0..=1.0).contains(c))) {
                return fail("a color of contours is outside of 0 to 1".into(), "give a color as \"#rrggbb\"");
            }
        }
        self.across.as_ref().map_or(Ok(()), |across| across.validate(num_styles, num_distances))
    }
}

/// Checks the nodes of a function or of a row of it.
pub(super) fn validate_nodes(nodes: &[TransferFunctionNode], num_styles: usize) -> Result<()> {
    let fail = |what: String, remedy: &str| Err(Error::scene(what, remedy));
    if nodes.is_empty() {
        return fail("the transfer function has no node".into(), "add at least one");
    }
    if nodes.len() > MAX_NODES {
        return fail(format!("the transfer function has {} nodes", nodes.len()), "keep to at most 1024 of them");
    }
    for node in nodes {
        if !node.value.is_finite() {
            return fail("a transfer function node has a value that is not finite".into(), "give a number");
        }
        if !(0.0..=1.0).contains(&node.opacity) {
            return fail(format!("the opacity {} is not in 0 to 1", node.opacity), "choose one from 0 to 1");
        }
        if node.style >= num_styles {
            return fail(
                format!("a node refers to style {} of {num_styles}", node.style),
                "add the style to the scene",
            );
        }
    }
    if nodes.windows(2).any(|w| w[0].value > w[1].value) {
        return fail("the transfer function's nodes do not ascend".into(), "sort them by value");
    }
    Ok(())
}

/// The node table is a texture row of this width at most.
pub const MAX_NODES: usize = 1024;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classify_is_linear_between_nodes_and_constant_outside() {
        let node = |value, style, opacity| TransferFunctionNode { value, style, opacity };
        let tf = StyleTransferFunction::new(
            vec![node(0.0, 0, 0.0), node(10.0, 1, 1.0), node(10.0, 2, 0.25), node(20.0, 3, 0.5)],
            1.0,
        );
        assert_eq!(tf.classify(-5.0), Classified { opacity: 0.0, node: 0.0 });
        assert_eq!(tf.classify(2.5), Classified { opacity: 0.25, node: 0.25 });
        assert_eq!(tf.classify(10.0), Classified { opacity: 0.25, node: 2.0 }, "a jump belongs to its upper side");
        assert_eq!(tf.classify(15.0), Classified { opacity: 0.375, node: 2.5 });
        assert_eq!(tf.classify(1e9), Classified { opacity: 0.5, node: 3.0 });
        assert_eq!(tf.classify(f64::NAN).node, 0.0);
    }
}
