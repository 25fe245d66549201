//! Label maps as selections, and selections as label maps.

use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::{BRICK, BRICK_VOXELS, Brick, BrickPool, IN, Selection, VoxelBox};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::labels::{Label, LabelMap, LayerBuilder, background, same_grid};

/// A selection with what a structure of a label map has.
#[derive(Clone, Debug)]
pub struct Structure {
    /// Number, name, color, and what it is called in a terminology.
    pub label: Label,
    /// Its voxels.
    pub selection: Selection,
}

/// A selection for every structure of the layers of a label map, in their order, empty ones too: 1 where it is labeled. A name that
/// occurred before gets a number: "rib (2)". The voxels are looked at once, and bricks that are alike are in memory once.
///
/// # Errors
/// [`Error::Cancelled`] on request.
pub fn from_label_maps(layers: &[LabelMap], pool: &Arc<BrickPool>, progress: &Progress) -> Result<Vec<Structure>> {
    let mut structures = Vec::new();
    for layer in layers {
        structures.extend(of_layer(layer, pool, progress)?);
    }
    let mut names: Vec<String> = structures.iter().map(|s: &Structure| s.label.name.clone()).collect();
    make_distinct(&mut names);
    structures.iter_mut().zip(names).for_each(|(structure, name)| structure.label.name = name);
    Ok(structures)
}

/// Gives names that occurred before a number, from 2, that nothing else has.
pub fn make_distinct(names: &mut [String]) {
    let mut taken: std::collections::HashSet<String> = names.iter().cloned().collect();
    let mut seen = std::collections::HashSet::new();
    let mut last: HashMap<String, usize> = HashMap::new();
    for name in names {
        if seen.insert(name.clone()) {
            continue;
        }
        let number = last.entry(name.clone()).or_insert(1);
        let renamed = loop {
            *number += 1;
            let renamed = format!("{name} ({number})");
            if taken.insert(renamed.clone()) {
                break renamed;
            }
        };
        seen.insert(renamed.clone());
        *name = renamed;
    }
}

/// The position of a structure, and its voxels in the brick at a place.
type OfBrick = (u16, [usize; 3], Brick);

fn of_layer(layer: &LabelMap, pool: &Arc<BrickPool>, progress: &Progress) -> Result<Vec<Structure>> {
    let dims = layer.grid.dims();
    let places = super::fill::places(dims.map(|n| [0, n]));
    progress.begin("selecting", places.len() as u64);
    let found: Result<Vec<Vec<OfBrick>>> = places
        .into_par_iter()
        .with_min_len(64)
        .map(|place| {
            progress.advance(1)?;
            Ok(of_brick(layer, place, pool))
        })
        .collect();
    let mut bricks: Vec<Vec<([usize; 3], Brick)>> = vec![Vec::new(); layer.labels.len()];
    for (position, place, brick) in found?.into_iter().flatten() {
        if let Some(bricks) = bricks.get_mut(usize::from(position)) {
            bricks.push((place, brick));
        }
    }
    let structures = layer.labels.iter().zip(bricks).skip(1).map(|(label, bricks)| {
        let mut selection = Selection::empty(layer.grid, pool);
        selection.replace(bricks);
        Structure { label: label.clone(), selection }
    });
    Ok(structures.collect())
}

/// The structures of a brick.
fn of_brick(layer: &LabelMap, place: [usize; 3], pool: &Arc<BrickPool>) -> Vec<OfBrick> {
    let dims = layer.grid.dims();
    let first = place.map(|n| n * BRICK);
    let room: [usize; 3] = std::array::from_fn(|a| BRICK.min(dims[a] - first[a]));
    let row = |y: usize, z: usize| {
        let start = first[0] + dims[0] * (first[1] + y + dims[1] * (first[2] + z));
        &layer.voxels[start..start + room[0]]
    };
    let rows = || (0..room[2]).flat_map(|z| (0..room[1]).map(move |y| (y, z)));
    let common = row(0, 0)[0];
    if rows().all(|(y, z)| row(y, z).iter().all(|v| *v == common)) {
        // What reaches beyond the grid is clipped where it is put.
        return if common == 0 { Vec::new() } else { vec![(common, place, Brick::Uniform(255))] };
    }
    let mut masks: Vec<(u16, [u8; BRICK_VOXELS])> = Vec::new();
    for (y, z) in rows() {
        for (x, position) in row(y, z).iter().enumerate().filter(|(_, p)| **p != 0) {
            // Neighbors are mostly alike, so it is mostly the last.
            let known = masks.iter().rposition(|(p, _)| p == position);
            let known = known.unwrap_or_else(|| {
                masks.push((*position, [0; BRICK_VOXELS]));
                masks.len() - 1
            });
            masks[known].1[x + BRICK * (y + BRICK * z)] = 255;
        }
    }
    masks.into_iter().map(|(position, mask)| (position, place, pool.brick(&mask))).collect()
}

/// Selections of one grid as layers of label maps, in which each voxel has at most one structure: those with a membership of
/// at least ½. Structures that overlap go to further layers, so nothing is lost but the degrees of membership. A layer never
/// has a number twice: what would, and what has the number 0, gets the next number that is free.
///
/// # Errors
/// [`Error::Scene`] if the grids differ, there are more than 32 layers, or memory runs out; [`Error::Cancelled`] on request.
pub fn to_layers(structures: &[Structure], progress: &Progress) -> Result<Vec<LabelMap>> {
    let fault = |what: String| Error::scene(what, "write them in several files");
    let grid = *checked_grid(structures)?;
    let mut builder = LayerBuilder::new(grid).map_err(fault)?;
    progress.begin("layering", structures.len() as u64);
    let mut used: std::collections::HashSet<u32> = std::collections::HashSet::from([0]);
    let mut next = structures.iter().map(|s| s.label.id).max().unwrap_or(0);
    for structure in structures {
        progress.advance(1)?;
        let mut label = structure.label.clone();
        if !used.insert(label.id) {
            next = (1..=u32::MAX).map(|n| next.wrapping_add(n)).find(|id| !used.contains(id)).unwrap_or(u32::MAX);
            label.id = next;
            used.insert(next);
        }
        let runs = runs(&structure.selection);
        builder.add(label, &runs).map_err(fault)?;
    }
    Ok(builder.finish())
}

/// The voxels that are in, as runs of positions in memory.
fn runs(selection: &Selection) -> Vec<std::ops::Range<usize>> {
    let Some([x, y, z]) = selection.bounds() else { return Vec::new() };
    let [nx, ny, _] = selection.grid().dims();
    let slices: Vec<Vec<std::ops::Range<usize>>> = (z[0]..z[1])
        .into_par_iter()
        .map(|at_z| {
            let values = selection.values([x, y, [at_z, at_z + 1]]);
            let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
            for (row, at_y) in values.chunks(x[1] - x[0]).zip(y[0]..) {
                let mut start = x[0] + nx * (at_y + ny * at_z);
                for run in row.chunk_by(|a, b| (*a >= IN) == (*b >= IN)) {
                    if run[0] >= IN {
                        runs.push(start..start + run.len());
                    }
                    start += run.len();
                }
            }
            runs
        })
        .collect();
    slices.into_iter().flatten().collect()
}

/// One label map of selections of one grid: each voxel belongs to that with the largest membership, the first of equal ones, if
/// that is at least ½. The note says how much of the others was lost to overlaps. Positions are those of `structures`, from 1.
///
/// # Errors
/// [`Error::Scene`] if the grids differ or there are more than 65 535; [`Error::Cancelled`] on request.
pub fn to_partition(structures: &[Structure], progress: &Progress) -> Result<LabelMap> {
    let grid = *checked_grid(structures)?;
    if structures.len() > usize::from(u16::MAX) {
        return Err(Error::scene("there are more than 65 535 structures", "write them in several files"));
    }
    let dims = grid.dims();
    let mut voxels = vec![0_u16; grid.num_voxels()];
    progress.begin("partitioning", dims[2].div_ceil(BRICK) as u64);
    let num_lost: Result<u64> = voxels
        .par_chunks_mut(dims[0] * dims[1] * BRICK)
        .enumerate()
        .map(|(slab, voxels)| {
            progress.advance(1)?;
            let z = [slab * BRICK, (slab * BRICK + BRICK).min(dims[2])];
            let mut best = vec![0_u8; voxels.len()];
            let mut num_lost = 0;
            for (structure, position) in structures.iter().zip(1_u16..) {
                let Some(bounds) = structure.selection.bounds() else { continue };
                let part: VoxelBox = [bounds[0], bounds[1], [bounds[2][0].max(z[0]), bounds[2][1].min(z[1])]];
                if part[2][0] >= part[2][1] {
                    continue;
                }
                let [nx, ny, _] = part.map(|[from, to]| to - from);
                let values = structure.selection.values(part);
                for (i, f) in values.into_iter().enumerate().filter(|(_, f)| *f >= IN) {
                    let [x, y, at_z] = [i % nx + part[0][0], i / nx % ny + part[1][0], i / (nx * ny) + part[2][0]];
                    let at = x + dims[0] * (y + dims[1] * (at_z - z[0]));
                    num_lost += u64::from(best[at] > 0);
                    if f > best[at] {
                        (best[at], voxels[at]) = (f, position);
                    }
                }
            }
            Ok(num_lost)
        })
        .sum();
    let mut notes = Vec::new();
    let num_lost = num_lost?;
    if num_lost > 0 {
        let ml = num_lost as f64 * grid.world_from_index().matrix3.determinant().abs() * 1e-3;
        notes.push(format!("Structures overlap by {ml:.3} ml, which went to the one with the largest membership."));
    }
    let labels = [background()].into_iter().chain(structures.iter().map(|s| s.label.clone())).collect();
    Ok(LabelMap { grid, voxels, labels, notes })
}

pub(super) fn checked_grid(structures: &[Structure]) -> Result<&crate::spaces::Grid> {
    let Some(first) = structures.first() else {
        return Err(Error::scene("there is no selection", "make one first"));
    };
    let grid = first.selection.grid();
    match structures.iter().find(|s| !same_grid(s.selection.grid(), grid)) {
        Some(other) => Err(Error::scene(
            format!("the selections `{}` and `{}` lie on different grids", first.label.name, other.label.name),
            "resample one of them",
        )),
        None => Ok(grid),
    }
}

#[cfg(test)]
mod tests;
