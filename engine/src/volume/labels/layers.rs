//! From masks, which may overlap, to label maps, in which they cannot.

use std::ops::Range;

use super::{Label, LabelMap, background};
use crate::spaces::Grid;

/// Structures that overlap more deeply are no anatomy, and each layer takes two bytes a voxel.
const MAX_LAYERS: usize = 32;

/// Puts masks into layers: each into the first in which its voxels are free.
pub struct LayerBuilder {
    grid: Grid,
    layers: Vec<LabelMap>,
}

impl LayerBuilder {
    /// No mask yet: one layer in which nothing belongs to a structure.
    ///
    /// # Errors
    /// A clause if there is not enough memory for a layer.
    pub fn new(grid: Grid) -> Result<Self, String> {
        Ok(Self { grid, layers: vec![empty_layer(grid)?] })
    }

    /// Adds a structure whose voxels are `runs` of positions in the grid's memory order; without any it is kept by name.
    ///
    /// # Errors
    /// A clause if it fits none of 32 layers, a layer has 65 535 structures, or memory runs out.
    pub fn add(&mut self, label: Label, runs: &[Range<usize>]) -> Result<(), String> {
        let is_free = |layer: &LabelMap| runs.iter().all(|run| layer.voxels[run.clone()].iter().all(|&v| v == 0));
        let place = match self.layers.iter().position(is_free) {
            Some(place) => place,
            None if self.layers.len() < MAX_LAYERS => {
                self.layers.push(empty_layer(self.grid)?);
                self.layers.len() - 1
            }
            None => return Err(format!("more than {MAX_LAYERS} of its structures overlap in one place")),
        };
        let layer = &mut self.layers[place];
        let position =
            u16::try_from(layer.labels.len()).map_err(|_| "it has more than 65 535 structures".to_owned())?;
        layer.labels.push(label);
        runs.iter().for_each(|run| layer.voxels[run.clone()].fill(position));
        Ok(())
    }

    /// The layers, at least one.
    pub fn finish(self) -> Vec<LabelMap> {
        self.layers
    }
}

fn empty_layer(grid: Grid) -> Result<LabelMap, String> {
    let mut voxels = Vec::new();
    let n = grid.num_voxels();
    voxels.try_reserve_exact(n).map_err(|_| format!("there is not enough memory for its {} MiB", n >> 19))?;
    voxels.resize(n, 0);
    Ok(LabelMap { grid, voxels, labels: vec![background()], notes: Vec::new() })
}
