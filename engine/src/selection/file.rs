//! Selections in files.
//!
//! Binary ones are `.seg.nrrd` files as 3D Slicer writes them (slicer.readthedocs.io, developer guide, segmentations): numbers of
//! structures, in layers along a first axis of kind `list` where structures overlap, with names, colors and terms in keys of
//! the header. Degrees of membership are lost there: a voxel is in from ½ on.
//!
//! Fractional ones keep them: uint8, 255 = 1, along a first axis of kind `list` one value per selection (a plain volume for a
//! single selection), with the same keys and `Segmentation_SourceRepresentation:=Fractional labelmap`, 3D Slicer's name for what
//! such voxels are. Slicer's own readers of segmentations know binary ones only: there, a fractional file opens as a volume (with
//! several components), from which a threshold of 128 makes segments. `Segment0_LabelValue` is the number of the structure.

use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use flate2::Compression;
use flate2::write::GzEncoder;
use rayon::prelude::*;

use super::{BrickPool, Structure, from_label_maps, make_distinct, to_layers};
use crate::error::{Error, Result};
use crate::image_out::save_atomic;
use crate::progress::Progress;
use crate::read::{ReadOptions, nrrd, read_labels};
use crate::spaces::Grid;
use crate::volume::labels::{Label, resample_layers};
use crate::volume_out::nrrd_place;

/// Writes selections of one grid as a binary segmentation, gzipped. Numbers that occur twice are changed, as
/// [`to_layers`] says; the type is the smallest that holds them all. The file appears whole or not at all.
///
/// # Errors
/// As [`to_layers`], [`Error::File`] if it cannot be written, [`Error::Cancelled`] on request.
pub fn write_segmentation(path: &Path, structures: &[Structure], progress: &Progress) -> Result<()> {
    let layers = to_layers(structures, progress)?;
    let labels = || layers.iter().enumerate().flat_map(|(layer, map)| map.labels[1..].iter().map(move |l| (layer, l)));
    let largest = labels().map(|(_, label)| label.id).max().unwrap_or(0);
    let (type_name, width) = match largest {
        0..=0xff => ("uint8", 1),
        0x100..=0xffff => ("uint16", 2),
        _ => ("uint32", 4),
    };
    // In the order in which they came, which the layers do not keep.
    let position = |label: &Label| structures.iter().position(|s| s.label.name == label.name).unwrap_or(usize::MAX);
    let mut sorted: Vec<_> = labels().collect();
    sorted.sort_by_key(|(_, label)| position(label));
    let keys: String = sorted.iter().enumerate().map(|(i, (layer, label))| keys_of(i, *layer, label)).collect();
    let Some(first) = layers.first() else { return Ok(()) };
    let header = header(&first.grid, type_name, layers.len(), "Binary labelmap", &keys);
    let slice_len = first.grid.dims()[0] * first.grid.dims()[1];
    write(path, &header, first.grid.dims()[2], progress, |z, out| {
        out.resize(slice_len * layers.len() * width, 0);
        out.par_chunks_mut(layers.len() * width).with_min_len(1 << 12).enumerate().for_each(|(i, voxel)| {
            for (layer, number) in layers.iter().zip(voxel.chunks_mut(width)) {
                let position = layer.voxels[slice_len * z + i];
                let id = if position == 0 { 0 } else { layer.labels[usize::from(position)].id };
                number.copy_from_slice(&id.to_le_bytes()[..width]);
            }
        });
    })
}

/// Writes selections of one grid with their degrees of membership, gzipped, so that [`read_selections`] gives the very same. The
/// file appears whole or not at all.
///
/// # Errors
/// [`Error::Scene`] if there is none or the grids differ, [`Error::File`] if it cannot be written, [`Error::Cancelled`] on
/// request.
pub fn write_fractional(path: &Path, structures: &[Structure], progress: &Progress) -> Result<()> {
    let grid = *super::structures::checked_grid(structures)?;
    let keys: String = structures.iter().enumerate().map(|(i, s)| keys_of(i, i, &s.label)).collect();
    let header = header(&grid, "uint8", structures.len(), "Fractional labelmap", &keys);
    let [nx, ny, nz] = grid.dims();
    let n = structures.len();
    write(path, &header, nz, progress, |z, out| {
        out.clear();
        out.resize(nx * ny * n, 0);
        for (i, structure) in structures.iter().enumerate() {
            let Some([x, y, z_bounds]) = structure.selection.bounds() else { continue };
            if (z_bounds[0]..z_bounds[1]).contains(&z) {
                let values = structure.selection.values([x, y, [z, z + 1]]);
                for (row, at_y) in values.chunks(x[1] - x[0]).zip(y[0]..) {
                    row.iter().zip(x[0]..).for_each(|(f, at_x)| out[n * (at_x + nx * at_y) + i] = *f);
                }
            }
        }
    })
}

/// The header up to its empty line.
fn header(grid: &Grid, type_name: &str, num_layers: usize, representation: &str, keys: &str) -> String {
    let [nx, ny, nz] = grid.dims();
    let (directions, origin) = nrrd_place(grid);
    let (dimension, list_size, list_direction, list_kind) = match num_layers {
        1 => (3, String::new(), "", ""),
        n => (4, format!("{n} "), "none ", "list "),
    };
    // Slicer before 5.2 looks for the second name.
    format!(
        "NRRD0004\ntype: {type_name}\ndimension: {dimension}\nspace: right-anterior-superior\n\
         sizes: {list_size}{nx} {ny} {nz}\nspace directions: {list_direction}{directions}\nspace origin: {origin}\n\
         kinds: {list_kind}domain domain domain\nendian: little\nencoding: gzip\n\
         Segmentation_SourceRepresentation:={representation}\nSegmentation_MasterRepresentation:={representation}\n\
         Segmentation_ContainedRepresentationNames:={representation}|\n\
         Segmentation_ReferenceImageExtentOffset:=0 0 0\n{keys}\n"
    )
}

/// What the header says about structure `i`, a line each.
fn keys_of(i: usize, layer: usize, label: &Label) -> String {
    // A key ends with its line.
    let plain = |text: &str| text.replace('\\', "\\\\").replace(['\n', '\r'], " ");
    let color = label.color.map(|c| format!("{:.6}", f64::from(c) / 255.0)).join(" ");
    let mut keys = format!(
        "Segment{i}_ID:=Segment_{}\nSegment{i}_Name:={}\nSegment{i}_Color:={color}\nSegment{i}_LabelValue:={}\n\
         Segment{i}_Layer:={layer}\nSegment{i}_NameAutoGenerated:=0\nSegment{i}_ColorAutoGenerated:=0\n",
        i + 1,
        plain(&label.name),
        label.id,
    );
    if let Some(code) = &label.code {
        // scheme^code^meaning of category, type and modifier.
        let concept = |text: Option<&str>| {
            let (scheme, value) = text.and_then(|t| t.split_once(':')).unwrap_or_default();
            format!("{}^{}^", plain(scheme), plain(value))
        };
        let mut parts = code.splitn(2, '+');
        let kind = parts.next().and_then(|t| t.split_once(':')).unwrap_or_default();
        keys += &format!(
            "Segment{i}_Tags:=TerminologyEntry:Segmentation category and type - 3D Slicer General Anatomy list~\
             SCT^123037004^Anatomical Structure~{}^{}^{}~{}~Anatomic codes - DICOM master list~^^~^^|\n",
            plain(kind.0),
            plain(kind.1),
            plain(&label.name).replace(['^', '~', '|'], " "),
            concept(parts.next()),
        );
    }
    keys
}

/// Header and gzipped slices, which `fill` puts into a buffer of bytes.
fn write(
    path: &Path,
    header: &str,
    num_slices: usize,
    progress: &Progress,
    mut fill: impl FnMut(usize, &mut Vec<u8>),
) -> Result<()> {
    progress.begin("writing", num_slices as u64);
    save_atomic(path, |file| {
        let io = |e| Error::io(path, &e);
        file.write_all(header.as_bytes()).map_err(io)?;
        let mut gzip = GzEncoder::new(file, Compression::default());
        let mut slice = Vec::new();
        for z in 0..num_slices {
            fill(z, &mut slice);
            gzip.write_all(&slice).map_err(io)?;
            progress.advance(1)?;
        }
        gzip.finish().map_err(io)?;
        Ok(())
    })
}

/// Reads selections from a fractional file, or one for every structure of a label map in any format that
/// [`read_labels`] knows, on the grid of a scan. Names that occur twice get a number. With notes, a sentence each, on what
/// putting them on that grid has changed and on how they were read.
///
/// # Errors
/// As [`read_labels`]; [`Error::File`] if nothing of them lies in the grid; [`Error::Cancelled`] on request.
pub fn read_selections(
    path: &Path,
    grid: &Grid,
    pool: &Arc<BrickPool>,
    progress: &Progress,
) -> Result<(Vec<Structure>, Vec<String>)> {
    let mut notes: Vec<String> = Vec::new();
    let mut add = |note: String| {
        if !notes.contains(&note) {
            notes.push(note);
        }
    };
    let Some((mut structures, read_notes)) = nrrd::read_fractional(path, pool, progress)? else {
        let layers = read_labels(path, &ReadOptions::default(), progress)?;
        layers.iter().flat_map(|layer| layer.notes.clone()).for_each(&mut add);
        let elsewhere = |what| Error::file(path, what, "name the label map that belongs to the scan");
        let (layers, note) = resample_layers(layers, grid).map_err(elsewhere)?;
        note.into_iter().for_each(&mut add);
        return Ok((from_label_maps(&layers, pool, progress)?, notes));
    };
    read_notes.into_iter().for_each(&mut add);
    for structure in &mut structures {
        let resampled = structure.selection.resampled_to(grid, pool, progress);
        let (selection, note) = resampled.map_err(|error| match error {
            Error::Scene { what, remedy } => Error::file(path, what, remedy),
            other => other,
        })?;
        structure.selection = selection;
        note.into_iter().for_each(&mut add);
    }
    let mut names: Vec<String> = structures.iter().map(|s| s.label.name.clone()).collect();
    make_distinct(&mut names);
    structures.iter_mut().zip(names).for_each(|(s, name)| s.label.name = name);
    Ok((structures, notes))
}

#[cfg(test)]
mod tests;
