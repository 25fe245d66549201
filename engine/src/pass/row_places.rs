//! Which rows of 2-D transfer functions a brick may show: those around the second coordinates that its places have.

use std::collections::HashMap;
use std::sync::{Arc, Weak};

use glam::DVec3;
use rayon::prelude::*;

use crate::scene::{Across, Axis, Object};
use crate::volume::Volume;
use crate::volume::bricks::BRICK;
use crate::volume::edges::brick_maxima;

/// Voxels around a brick that its places include.
const BORDER: f64 = 2.0;

/// The rows of every brick, for each of an object's different second coordinates.
#[derive(Debug, Default)]
pub struct RowPlaces {
    /// Position in `sets` of each brick's; empty, where all bricks may show all rows.
    set_of_brick: Vec<u16>,
    /// A bit for each row of each second coordinate.
    sets: Vec<Vec<u8>>,
}

/// Largest edges of bricks that were found for a volume, and σ_g in mm.
#[derive(Debug, Default)]
pub struct BrickEdges(Option<(Weak<Volume>, f64, Arc<Vec<f64>>)>);

impl BrickEdges {
    fn get(&mut self, object: &Object) -> Arc<Vec<f64>> {
        // Held weakly, the address of a volume goes to no other.
        let is_known = |known: &&(Weak<Volume>, f64, Arc<Vec<f64>>)| {
            std::ptr::eq(known.0.as_ptr(), &*object.volume) && known.1 == object.gradient_scale_mm
        };
        if let Some((.., edges)) = self.0.as_ref().filter(is_known) {
            return edges.clone();
        }
        let edges = Arc::new(brick_maxima(&object.volume, object.gradient_scale_mm));
        self.0 = Some((Arc::downgrade(&object.volume), object.gradient_scale_mm, edges.clone()));
        edges
    }
}

impl RowPlaces {
    /// Of second coordinates of an object.
    pub fn new(object: &Object, across: &[&Across], edges: &mut BrickEdges) -> Self {
        if across.is_empty() {
            return Self::default();
        }
        let edges = across.iter().any(|across| across.axis == Axis::Edge).then(|| edges.get(object));
        let bricks = object.volume.bricks().dims;
        let of_brick = |i: usize| -> Vec<u8> {
            let at = DVec3::from_array(
                [i % bricks[0], i / bricks[0] % bricks[1], i / (bricks[0] * bricks[1])].map(|n| n as f64),
            );
            let (low, high) = (at * BRICK as f64 - BORDER, (at + 1.0) * BRICK as f64 + BORDER);
            let rows = |across: &&Across| {
                let (least, most) = match across.axis {
                    Axis::Even(place) => (place, place),
                    Axis::Edge => (0.0, edges.as_ref().map_or(1.0, |edges| edges[i])),
                    Axis::Distance(field) => object.distances[field].range(low, high),
                };
                // And what f32 and 16-bit texels make of it.
                let slack = 1e-3 + 1e-2 * least.abs().max(most.abs());
                let (first, last) = (across.between(least - slack).lower, across.between(most + slack).upper);
                (first..=last).fold(0u8, |mask, row| mask | 1 << row)
            };
            across.iter().map(rows).collect()
        };
        let all: Vec<Vec<u8>> = (0..bricks.iter().product()).into_par_iter().map(of_brick).collect();
        let (mut sets, mut position) = (Vec::new(), HashMap::new());
        let mut set = |set: Vec<u8>| -> Option<u16> {
            let next = u16::try_from(sets.len());
            Some(*position.entry(set).or_insert_with_key(|set| {
                sets.push(set.clone());
                next
            }))?
            .ok()
        };
        let set_of_brick: Option<Vec<u16>> = all.into_iter().map(&mut set).collect();
        // As many sets as that are not worth telling apart.
        set_of_brick.map_or_else(Self::default, |set_of_brick| Self { set_of_brick, sets })
    }

    /// Number of a brick's set.
    pub fn set_at(&self, brick: usize) -> u16 {
        self.set_of_brick.get(brick).copied().unwrap_or(0)
    }

    /// The rows of a second coordinate in a set of rows, a bit each.
    pub fn rows(&self, set: u16, across: usize) -> u8 {
        self.sets.get(usize::from(set)).and_then(|set| set.get(across)).copied().unwrap_or(u8::MAX)
    }
}
