//! `fabrica inspect --list`: what a file or folder offers, and what it, or a part of it, would take, from headers alone.

use anyhow::Result;
use fabrica_engine::read::Entry;
use fabrica_engine::read::limits::bytes_in_words;
use fabrica_engine::read::window::Window;
use fabrica_engine::volume::type_in_words;
use serde::Serialize;

use super::print_line;
use crate::memory;

/// One volume of the list.
#[derive(Serialize)]
struct Row<'a> {
    /// What `--series` takes.
    number: usize,
    /// What `--series` and templates take.
    series: &'a str,
    description: &'a str,
    format: &'a str,
    modality: &'a str,
    dims: [usize; 3],
    spacing_mm: [f64; 3],
    datatype: &'a str,
    num_frames: usize,
    num_files: usize,
    is_labels: bool,
    /// Voxels in memory.
    bytes: u64,
    /// Textures on the adapter.
    adapter_bytes: u64,
}

/// Prints the list.
///
/// # Errors
/// Only if the terminal is gone.
pub fn print(entries: &[Entry], window: Window, json: bool) -> Result<()> {
    let rows: Vec<_> = (1..).zip(entries).map(|(number, entry)| row(number, entry, window)).collect();
    if json {
        return print_line(&serde_json::to_string_pretty(&rows)?);
    }
    for (row, entry) in rows.iter().zip(entries) {
        let (files, labels) = (plural(row.num_files, "file"), if row.is_labels { ", label map" } else { "" });
        print_line(&format!(
            "{}  {} ({}, {}, {files}{labels}); takes {} and {} on the adapter",
            row.number,
            entry.in_words(),
            row.format,
            type_in_words(row.datatype),
            bytes_in_words(row.bytes),
            bytes_in_words(row.adapter_bytes)
        ))?;
    }
    if let Some(free) = memory::free_bytes() {
        print_line(&format!("{} of memory are free.", bytes_in_words(free)))?;
    }
    if entries.len() > 1 {
        print_line("Choose one with --series and its number, or a part of its name.")
    } else {
        Ok(())
    }
}

fn plural(n: usize, noun: &str) -> String {
    if n == 1 { format!("1 {noun}") } else { format!("{n} {noun}s") }
}

fn row(number: usize, entry: &Entry, window: Window) -> Row<'_> {
    // A crop that is no part of this volume asks about others.
    let part = window.on(std::path::Path::new(""), entry.grid.dims());
    let part = part.or_else(|_| Window::default().on(std::path::Path::new(""), entry.grid.dims()));
    let cost = part.map(|part| entry.cost(&part));
    let (bytes, adapter_bytes) = cost.map_or((0, 0), |c| (c.voxels, c.adapter));
    Row {
        number,
        series: &entry.key,
        description: &entry.title,
        format: &entry.format,
        modality: entry.modality.abbreviation(),
        dims: entry.grid.dims(),
        spacing_mm: entry.grid.spacing_mm().to_array(),
        datatype: entry.type_name,
        num_frames: entry.num_frames,
        num_files: entry.num_files,
        is_labels: entry.is_labels,
        bytes,
        adapter_bytes,
    }
}
