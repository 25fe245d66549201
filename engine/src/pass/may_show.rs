//! Between which values which transfer functions may show anything: what the march asks where it looks for something.

use std::sync::Arc;

use super::raycast::small_texture;
use super::transfer_table::TransferTable;
use crate::gpu::context::GpuContext;
use crate::gpu::upload::{ResidentVolume, extent};
use crate::scene::Object;

/// Cells along each axis.
const CELLS: usize = 256;

/// The map of `shaders/bind/object.wgsl`, and where values are in it.
#[derive(Clone, Debug)]
pub struct MayShow {
    /// Texel value of the first cell.
    pub first_cell: f32,
    pub cells_per_texel: f32,
    /// By the cells of two values, a bit for each function.
    pub map: wgpu::TextureView,
}

impl MayShow {
    /// Of an object that these functions show.
    pub fn new(
        context: &GpuContext,
        tables: &[Arc<TransferTable>],
        object: &Object,
        resident: &ResidentVolume,
    ) -> Self {
        let (low, high) = object.volume.bricks().range();
        let (low, high) = (resident.encoding.texel(low), resident.encoding.texel(high));
        // The values that the tables tell apart; what lies beyond is in the outermost cells.
        let ends = tables.iter().map(|t| {
            let (a, b) = (t.first, t.first + 1.0 / t.scale);
            (a.min(b), a.max(b))
        });
        let (from, to) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let (from, to) = (from.max(low), to.min(high));
        let to = if to > from { to } else { from + 1.0 };
        let per_texel = (CELLS - 2) as f64 / (to - from);
        let first = from - 1.0 / per_texel;
        // A cell on either side, for rounding.
        let edge = |cell: isize| match cell {
            ..=0 => low.min(first),
            c if c >= CELLS as isize => high.max(to),
            c => first + c as f64 / per_texel,
        };
        let mut cells = vec![0u32; CELLS * CELLS];
        for back in 0..CELLS {
            for front in 0..=back {
                let (low, high) = (edge(front as isize - 1), edge(back as isize + 2));
                let bit = |(layer, table): (usize, &Arc<TransferTable>)| u32::from(table.shows(low, high)) << layer;
                let shown = tables.iter().enumerate().map(bit).fold(0, |a, b| a | b);
                cells[front + CELLS * back] = shown;
                cells[back + CELLS * front] = shown;
            }
        }
        let (two, uint) = (wgpu::TextureDimension::D2, wgpu::TextureFormat::R32Uint);
        let texture =
            small_texture(context, "may show", extent([CELLS, CELLS, 1]), two, uint, bytemuck::cast_slice(&cells));
        Self {
            first_cell: first as f32,
            cells_per_texel: per_texel as f32,
            map: texture.create_view(&Default::default()),
        }
    }
}
