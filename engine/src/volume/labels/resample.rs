//! Label maps on the grid of a scan.
//!
//! A voxel of the scan takes the label at its middle, whatever the two grids: numbers of structures have no mean. Where the
//! scan is coarser, that keeps the volumes of structures right on average, thin ones become ragged, and what the scan's
//! voxels miss altogether is named in the note; a majority would lose thin structures everywhere, not only at random.

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

use super::table::listed;
use super::{Label, LabelMap};
use crate::spaces::Grid;

/// Grids agree if no corner is off by more than this many voxels: two programs' roundings of the same affine stay below it
/// over hundreds of slices, and no voxel gets another label.
const TOLERANCE: f64 = 0.01;

/// How the voxels of two grids relate.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fit {
    /// They are the same.
    Same,
    /// Voxel centers coincide, with axes turned or swapped or with another section: nothing is lost by copying.
    Lattice,
    /// Anything else.
    Other,
}

impl LabelMap {
    /// The label map on another grid: as it is if the grids agree within 0.01 voxels, copied without loss if they differ by
    /// the order and direction of their axes or by their section, else by the label nearest to each voxel's middle. The
    /// note, if any, is a sentence about what that changed.
    ///
    /// # Errors
    /// A clause with both places if no voxel of a structure lies in `grid`.
    pub fn resampled_to(self, grid: &Grid) -> Result<(Self, Option<String>), String> {
        let (mut layers, note) = resample_layers(vec![self], grid)?;
        let layer = layers.pop().ok_or("there is no label map")?;
        Ok((layer, note))
    }
}

/// [`LabelMap::resampled_to`] for the layers of one label map, with one note for all.
///
/// # Errors
/// A clause with both places if no voxel of a structure in any layer lies in `grid`.
pub fn resample_layers(layers: Vec<LabelMap>, grid: &Grid) -> Result<(Vec<LabelMap>, Option<String>), String> {
    let fits: Vec<Fit> = layers.iter().map(|layer| fit(&layer.grid, grid)).collect();
    let (mut num_labeled, mut num_inside) = (0, 0);
    let mut insides = Vec::new();
    for (layer, fit) in layers.iter().zip(&fits) {
        let labeled = layer.counts()[1..].iter().sum::<u64>();
        let inside = if *fit == Fit::Same { vec![] } else { inside_counts(layer, grid) };
        num_labeled += labeled;
        num_inside += if *fit == Fit::Same { labeled } else { inside.iter().skip(1).sum() };
        insides.push(inside);
    }
    if num_labeled > 0 && num_inside == 0 {
        return Err(elsewhere(&layers, grid));
    }
    let spacing = layers.iter().zip(&fits).find(|(_, fit)| **fit == Fit::Other).map(|(l, _)| l.grid.spacing_mm());
    let (mut resampled, mut vanished) = (Vec::new(), Vec::new());
    for ((layer, fit), inside) in layers.into_iter().zip(fits).zip(insides) {
        if fit == Fit::Same {
            resampled.push(LabelMap { grid: *grid, ..layer });
            continue;
        }
        let voxels = nearest(&layer, grid);
        let layer = LabelMap { grid: *grid, voxels, ..layer };
        let is_lost = |((_, inside), after): &((&Label, u64), u64)| *inside > 0 && *after == 0;
        let all = layer.labels.iter().zip(inside).zip(layer.counts()).skip(1);
        vanished.extend(all.filter(is_lost).map(|((label, _), _)| label.name.clone()));
        resampled.push(layer);
    }
    Ok((resampled, note(spacing, num_labeled, num_inside, &vanished)))
}

fn note(spacing: Option<DVec3>, num_labeled: u64, num_inside: u64, vanished: &[String]) -> Option<String> {
    let mut parts = Vec::new();
    if let Some(spacing) = spacing {
        let by = spacing.to_array().map(mm).join(" x ");
        parts.push(format!("The label map has another grid ({by} mm) than the scan; it was resampled"));
    }
    if num_inside < num_labeled {
        let percent = 100.0 * (num_labeled - num_inside) as f64 / num_labeled as f64;
        let share = if percent < 0.1 { "less than 0.1".to_owned() } else { format!("{percent:.1}") };
        let whose = if parts.is_empty() { "the label map's" } else { "its" };
        parts.push(format!("{share} % of {whose} labeled voxels lie outside the scan and were cut off"));
    }
    if !vanished.is_empty() {
        let what = if vanished.len() == 1 { "a structure is" } else { "some structures are" };
        parts.push(format!("{what} too thin for the scan's voxels and vanished ({})", listed(vanished)));
    }
    let mut text = parts.join("; ");
    if let Some(first) = text.get(..1).map(str::to_uppercase) {
        text.replace_range(..1, &first);
    }
    (!text.is_empty()).then(|| text + ".")
}

/// Whether two grids have the same voxels.
pub fn same_grid(a: &Grid, b: &Grid) -> bool {
    fit(a, b) == Fit::Same
}

fn fit(source: &Grid, target: &Grid) -> Fit {
    let source_from_target = source.index_from_world() * target.world_from_index();
    let rounded = DAffine3 {
        matrix3: DMat3::from_cols(
            source_from_target.matrix3.x_axis.round(),
            source_from_target.matrix3.y_axis.round(),
            source_from_target.matrix3.z_axis.round(),
        ),
        translation: source_from_target.translation.round(),
    };
    let last = DVec3::from_array(target.dims().map(|n| n as f64 - 1.0));
    let is_near = |map: &DAffine3| {
        (0..8).all(|corner| {
            let at = last * DVec3::from_array(std::array::from_fn(|i| f64::from(corner >> i & 1)));
            let off = source_from_target.transform_point3(at) - map.transform_point3(at);
            // Written so that NaN is not near.
            off.abs().max_element() <= TOLERANCE
        })
    };
    if source.dims() == target.dims() && is_near(&DAffine3::IDENTITY) {
        Fit::Same
    } else if rounded.matrix3.determinant().abs() == 1.0 && is_permutation(&rounded.matrix3) && is_near(&rounded) {
        Fit::Lattice
    } else {
        Fit::Other
    }
}

/// Whether each column of a matrix of whole numbers follows one axis by one step.
fn is_permutation(m: &DMat3) -> bool {
    [m.x_axis, m.y_axis, m.z_axis].iter().all(|c| c.length_squared() == 1.0)
}

/// How many voxels of each structure have their middle in `grid`.
fn inside_counts(map: &LabelMap, grid: &Grid) -> Vec<u64> {
    let [nx, ny, nz] = map.grid.dims();
    let target_from_source = grid.index_from_world() * map.grid.world_from_index();
    let (min, max) = grid.index_box();
    let none = || vec![0_u64; map.labels.len()];
    let add_slice = |mut counts: Vec<u64>, (z, slice): (usize, &[u16])| {
        for (y, row) in slice.chunks(nx).enumerate() {
            if row.iter().all(|&v| v == 0) {
                continue;
            }
            let start = target_from_source.transform_point3(DVec3::new(0.0, y as f64, z as f64));
            for (x, v) in row.iter().enumerate().filter(|(_, v)| **v != 0) {
                let at = start + x as f64 * target_from_source.matrix3.x_axis;
                if at.cmpge(min).all() && at.cmple(max).all() {
                    counts[usize::from(*v)] += 1;
                }
            }
        }
        counts
    };
    let slices = map.voxels.par_chunks(nx * ny).enumerate().with_min_len(nz.div_ceil(64));
    slices.fold(none, add_slice).reduce(none, |mut a, b| {
        a.iter_mut().zip(&b).for_each(|(a, b)| *a += b);
        a
    })
}

/// The label at the middle of every voxel of `grid`; outside the map, none.
fn nearest(map: &LabelMap, grid: &Grid) -> Vec<u16> {
    let [nx, ny, _] = grid.dims();
    let [sx, sy, sz] = map.grid.dims();
    let size = DVec3::new(sx as f64, sy as f64, sz as f64);
    let source_from_target = map.grid.index_from_world() * grid.world_from_index();
    let mut voxels = vec![0; grid.num_voxels()];
    voxels.par_chunks_mut(nx * ny).enumerate().for_each(|(z, slice)| {
        for (y, row) in slice.chunks_mut(nx).enumerate() {
            let start = source_from_target.transform_point3(DVec3::new(0.0, y as f64, z as f64)) + 0.5;
            for (x, v) in row.iter_mut().enumerate() {
                let at = start + x as f64 * source_from_target.matrix3.x_axis;
                if at.cmpge(DVec3::ZERO).all() && at.cmplt(size).all() {
                    let [i, j, k] = at.to_array().map(|c| c as usize);
                    *v = map.voxels[i + sx * (j + sy * k)];
                }
            }
        }
    });
    voxels
}

/// The clause for a label map that lies beside its scan.
fn elsewhere(layers: &[LabelMap], grid: &Grid) -> String {
    let labeled = layers.iter().flat_map(|layer| layer.statistics().into_iter().skip(1).filter_map(|s| s.box_mm));
    let structures = labeled.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default();
    let (min, max) = grid.index_box();
    let corners = grid.box_corners_mm(min, max);
    let scan = [DVec3::min, DVec3::max].map(|f| corners.into_iter().reduce(f).unwrap_or_default());
    let place = |[min, max]: [DVec3; 2]| {
        let axis = |(i, name)| format!("{name} {} to {}", mm(f64::round(min[i])), mm(f64::round(max[i])));
        [(0, "R"), (1, "A"), (2, "S")].map(axis).join(", ")
    };
    format!(
        "the label map lies elsewhere: its structures take {} mm, the scan takes {} mm",
        place(structures),
        place(scan)
    )
}

/// Up to three decimals.
fn mm(x: f64) -> String {
    // Without a sign before 0.
    let text = format!("{:.3}", (x * 1000.0).round() / 1000.0 + 0.0);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests;
