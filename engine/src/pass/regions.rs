//! The looks of an object with regions, as the shader reads them: tables of the different opacity functions, what regions have of
//! them, which bricks show anything, and which kinds of bricks there are.

use std::collections::HashMap;
use std::sync::Arc;

use super::raycast::{in_steps, small_texture, uniform};
use super::transfer_table::{TABLE_SIZE, TransferTable};
use crate::gpu::context::GpuContext;
use crate::gpu::regions::{LIST_WIDTH, ResidentRegions};
use crate::gpu::upload::{ResidentVolume, extent};
use crate::scene::quality::PARTS;
use crate::scene::region::MAX_OPACITY_FUNCTIONS;
use crate::scene::{Object, StyleTransferFunction};

/// Kinds of bricks that are told apart, at most; the last then stands for all others.
const MAX_KINDS: usize = 256;
/// Cells along each axis of what tells whether anything shows between two values.
const CELLS: usize = 256;

uniform! {
/// `Layer` of `shaders/bind/functions.wgsl`.
pub struct LayerUniform {
    first: f32,
    scale: f32,
    jump: f32,
    last_node: f32,
    below: [f32; 3],
    pad0: f32,
    above: [f32; 3],
    pad1: f32,
}
}

uniform! {
/// `Functions` of `shaders/bind/functions.wgsl`.
pub struct FunctionsUniform {
    layers: [LayerUniform; MAX_OPACITY_FUNCTIONS],
    kinds: [[u32; 4]; MAX_KINDS / 4],
    first_cell: f32,
    cells_per_texel: f32,
    pad0: f32,
    pad1: f32,
}
}

uniform! {
/// `Regions` of `shaders/bind/regions.wgsl`.
pub struct RegionsUniform {
    atlas_scale: [f32; 3],
    rounds_per_look: u32,
    world_x: [f32; 3],
    rounds_per_piece: u32,
    world_y: [f32; 3],
    pad0: f32,
    world_z: [f32; 3],
    pad1: f32,
}
}

/// What depends on the looks and the regions' places, but not on the camera.
#[derive(Clone, Debug)]
pub struct RegionLooks {
    revision: u64,
    lengths_mm: f64,
    leaps: bool,
    looks: Vec<LookOf>,
    /// Some looks are more opaque than others.
    pub cuts: bool,
    /// Two texels a look.
    pub region_looks: wgpu::TextureView,
    /// Distance to the nearest brick that shows something, and kind of brick.
    pub skip_map: wgpu::TextureView,
    /// The styles of the nodes, a row for each different list of them.
    pub node_layers: wgpu::TextureView,
    /// The table of the first function.
    pub table: Arc<TransferTable>,
    /// The tables, one layer each; a plain texture if there is but one function.
    pub tables: wgpu::TextureView,
    /// What only several functions need.
    pub functions: Option<Functions>,
}

/// Several functions from value to opacity.
#[derive(Clone, Debug)]
pub struct Functions {
    /// Their parameters.
    pub uniform: Box<FunctionsUniform>,
    /// Per kind, whether anything shows between two values.
    pub may_show: wgpu::TextureView,
    num_layers: u32,
}

/// A look, to be compared.
#[derive(Clone, Debug, PartialEq)]
struct LookOf {
    function: StyleTransferFunction,
    tint: Option<[f32; 3]>,
    opacity: f64,
}

impl LookOf {
    /// Whether its function gives opacity to anything.
    fn shows(&self) -> bool {
        self.function.nodes.iter().any(|n| n.opacity > 0.0)
    }

    /// Factor of the opacity that its function gives.
    fn factor(&self) -> f64 {
        if self.shows() { self.opacity } else { 0.0 }
    }
}

fn looks_of(object: &Object) -> Vec<LookOf> {
    let background = LookOf { function: object.transfer_function.clone(), tint: None, opacity: 1.0 };
    let regions = object.regions.iter().map(|r| LookOf {
        function: r.transfer_function.clone(),
        tint: r.tint,
        opacity: r.opacity,
    });
    std::iter::once(background).chain(regions).collect()
}

/// Tables that were made, so that one that changes costs one.
#[derive(Debug, Default)]
pub struct Tables(Vec<(StyleTransferFunction, f64, Arc<TransferTable>)>);

/// More than that are forgotten: three steps of a refining picture.
const MAX_TABLES: usize = 3 * MAX_OPACITY_FUNCTIONS;

impl Tables {
    fn get(
        &mut self,
        object: &Object,
        resident: &ResidentVolume,
        function: &StyleTransferFunction,
        lengths: f64,
    ) -> Arc<TransferTable> {
        if let Some((.., table)) = self.0.iter().find(|(f, l, _)| *l == lengths && f.same_opacity(function)) {
            return table.clone();
        }
        let made = TransferTable::new(function, object.volume.rescale, resident.encoding, object.data_range(), lengths);
        let made = Arc::new(made);
        if self.0.len() >= MAX_TABLES {
            self.0.remove(0);
        }
        self.0.push((function.clone(), lengths, made.clone()));
        made
    }
}

impl RegionLooks {
    /// Whether it is what [`RegionLooks::new`] would make.
    pub fn is_of(&self, object: &Object, regions: &ResidentRegions, lengths_mm: f64, leaps: bool) -> bool {
        (self.revision, self.lengths_mm, self.leaps) == (regions.revision, lengths_mm, leaps)
            && self.looks == looks_of(object)
    }

    /// `lengths_mm`: the usual length of a part of a piece; `leaps`: whether the march leaps over empty bricks.
    pub fn new(
        context: &GpuContext,
        object: &Object,
        resident: &ResidentVolume,
        regions: &ResidentRegions,
        tables: &mut Tables,
        lengths_mm: f64,
        leaps: bool,
    ) -> Self {
        let looks = looks_of(object);
        let mut layers: Vec<&StyleTransferFunction> = Vec::new();
        let mut rows: Vec<Vec<u32>> = Vec::new();
        let d0 = object.reference_length_mm();
        let mut layer_of = Vec::with_capacity(looks.len());
        let mut texels: Vec<[f32; 4]> = Vec::new();
        // A look that shows nothing has whatever function another one has.
        let visible = looks.iter().find(|look| look.shows()).unwrap_or(&looks[0]);
        for look in &looks {
            let function = if look.shows() { &look.function } else { &visible.function };
            let layer = layers.iter().position(|f| f.same_opacity(function)).unwrap_or_else(|| {
                layers.push(function);
                layers.len() - 1
            });
            let styles: Vec<u32> = function.nodes.iter().map(|n| n.style as u32).collect();
            let row = rows.iter().position(|r| *r == styles).unwrap_or_else(|| {
                rows.push(styles);
                rows.len() - 1
            });
            layer_of.push(layer);
            let lengths = d0 / function.reference_length_mm;
            let ([r, g, b], opacity) = (look.tint.unwrap_or_default(), 1.0 + look.factor() as f32);
            texels.push([r, g, b, if look.tint.is_some() { opacity } else { -opacity }]);
            texels.push([layer as f32, lengths as f32, row as f32, 0.0]);
        }
        let cuts = layers.len() > 1 || looks.iter().any(|look| look.factor() != looks[0].factor());
        let tables: Vec<Arc<TransferTable>> = layers
            .iter()
            .map(|function| tables.get(object, resident, function, in_steps(lengths_mm / function.reference_length_mm)))
            .collect();
        let kinds = Kinds::new(&looks, &layer_of, regions);
        let texel = |stored| resident.encoding.texel(stored);
        let bricks = object.volume.bricks();
        let distances = if leaps {
            bricks.distances_of(|i, low, high| {
                let mask = kinds.masks[usize::from(kinds.of_brick[i])];
                let shows = |layer: usize| mask >> layer & 1 != 0 && tables[layer].shows(texel(low), texel(high));
                (0..tables.len()).any(shows)
            })
        } else {
            vec![0; bricks.ranges.len()]
        };
        let cells: Vec<u8> = distances.iter().zip(&kinds.of_brick).flat_map(|(d, kind)| [*d, *kind]).collect();
        let (two, three) = (wgpu::TextureDimension::D2, wgpu::TextureDimension::D3);
        let float = wgpu::TextureFormat::Rgba32Float;
        texels.resize(texels.len().next_multiple_of(LIST_WIDTH), [0.0; 4]);
        let look_size = extent([LIST_WIDTH, texels.len() / LIST_WIDTH, 1]);
        let plain = |texture: wgpu::Texture| texture.create_view(&Default::default());
        let width = rows.iter().map(Vec::len).max().unwrap_or(1);
        let nodes: Vec<u32> = rows.iter().flat_map(|row| (0..width).map(|i| row[i.min(row.len() - 1)])).collect();
        let node_size = extent([width, rows.len(), 1]);
        let uint = wgpu::TextureFormat::R32Uint;
        let node_layers = small_texture(context, "node layers", node_size, two, uint, bytemuck::cast_slice(&nodes));
        let skip = wgpu::TextureFormat::Rg8Uint;
        let entries: Vec<[f32; 4]> = tables.iter().flat_map(|t| &t.entries).copied().collect();
        let has_functions = layers.len() > 1 || rows.len() > 1;
        let table_size = extent([TABLE_SIZE, TABLE_SIZE, tables.len()]);
        let made = small_texture(context, "transfer functions", table_size, two, float, bytemuck::cast_slice(&entries));
        let functions = has_functions.then(|| {
            let (first_cell, cells_per_texel, may_show) = may_show(&tables, &kinds.masks, object, resident);
            let size = extent([CELLS, CELLS, kinds.masks.len()]);
            let format = wgpu::TextureFormat::R8Uint;
            let uniform = FunctionsUniform {
                layers: std::array::from_fn(|i| {
                    // What no look has is never read.
                    layer_uniform(&tables[i.min(tables.len() - 1)])
                }),
                kinds: std::array::from_fn(|i| {
                    std::array::from_fn(|j| kinds.masks.get(4 * i + j).copied().unwrap_or(0))
                }),
                first_cell,
                cells_per_texel,
                pad0: 0.0,
                pad1: 0.0,
            };
            Functions {
                uniform: Box::new(uniform),
                may_show: arrays(&small_texture(context, "may show", size, two, format, &may_show)),
                num_layers: layers.len() as u32,
            }
        });
        Self {
            revision: regions.revision,
            lengths_mm,
            leaps,
            cuts,
            region_looks: plain(small_texture(
                context,
                "region looks",
                look_size,
                two,
                float,
                bytemuck::cast_slice(&texels),
            )),
            skip_map: plain(small_texture(context, "skip map", extent(bricks.dims), three, skip, &cells)),
            node_layers: plain(node_layers),
            table: tables[0].clone(),
            tables: if has_functions { arrays(&made) } else { plain(made) },
            functions,
            looks,
        }
    }

    /// The uniform for the atlas as it is now. `gradient`: columns take a change per voxel to one per mm of the world.
    pub fn uniform(&self, regions: &ResidentRegions, gradient: glam::DMat3) -> RegionsUniform {
        let column = |v: glam::DVec3| v.as_vec3().to_array();
        let [rounds_per_piece, rounds_per_look] = self.rounds(regions);
        RegionsUniform {
            atlas_scale: regions.atlas_size().map(|n| 1.0 / n as f32),
            rounds_per_look,
            world_x: column(gradient.x_axis),
            rounds_per_piece,
            world_y: column(gradient.y_axis),
            pad0: 0.0,
            world_z: column(gradient.z_axis),
            pad1: 0.0,
        }
    }

    /// Rounds of the shader's loops that a piece takes at most, with one look a part, and that a further look takes.
    pub fn rounds(&self, regions: &ResidentRegions) -> [u32; 2] {
        // A look goes over the brick's list and the background, and so does the face of a piece.
        let list = regions.longest_list() + 1;
        let look = 2 + list;
        let num_layers = self.functions.as_ref().map_or(0, |f| f.num_layers);
        // Those of the march, of the layers that are asked whether they show the piece, and of each part.
        [6 + num_layers + list + (PARTS + 1) * (1 + look), look]
    }
}

fn arrays(texture: &wgpu::Texture) -> wgpu::TextureView {
    let dimension = Some(wgpu::TextureViewDimension::D2Array);
    texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() })
}

fn layer_uniform(table: &TransferTable) -> LayerUniform {
    let outer = |i: usize| [table.outer_extinction[i] as f32, table.outer_node[i] as f32, table.outer_middle[i] as f32];
    LayerUniform {
        first: table.first as f32,
        scale: table.scale as f32,
        jump: table.jump as f32,
        last_node: table.last_node as f32,
        below: outer(0),
        pad0: 0.0,
        above: outer(1),
        pad1: 0.0,
    }
}

/// Kinds of bricks, by the layers that may show in them.
struct Kinds {
    /// A bit for each layer.
    masks: Vec<u32>,
    of_brick: Vec<u8>,
}

impl Kinds {
    fn new(looks: &[LookOf], layer_of: &[usize], regions: &ResidentRegions) -> Self {
        let bit = |look: &u32| if looks[*look as usize].factor() > 0.0 { 1 << layer_of[*look as usize] } else { 0 };
        let mask_of = |set: &Vec<u32>| set.iter().map(bit).fold(0, |a, b| a | b);
        let mut position: HashMap<u32, u8> = HashMap::new();
        let mut masks: Vec<u32> = Vec::new();
        let kind_of_set: Vec<u8> = regions
            .sets
            .iter()
            .map(|set| {
                let mask = mask_of(set);
                *position.entry(mask).or_insert_with(|| {
                    if masks.len() < MAX_KINDS {
                        masks.push(mask);
                    } else {
                        masks[MAX_KINDS - 1] |= mask;
                    }
                    (masks.len() - 1) as u8
                })
            })
            .collect();
        let of_brick = regions.set_of_brick.iter().map(|set| kind_of_set[*set as usize]).collect();
        Self { masks, of_brick }
    }
}

/// Texel value of the first cell, cells per texel unit, and per kind whether anything shows between values in two cells. Never
/// no where something shows.
fn may_show(
    tables: &[Arc<TransferTable>],
    masks: &[u32],
    object: &Object,
    resident: &ResidentVolume,
) -> (f32, f32, Vec<u8>) {
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
    let mut shows: Vec<Vec<u8>> = Vec::new();
    for table in tables {
        let mut map = vec![0; CELLS * CELLS];
        for back in 0..CELLS {
            for front in 0..=back {
                let shown = table.shows(edge(front as isize - 1), edge(back as isize + 2));
                map[front + CELLS * back] = u8::from(shown);
                map[back + CELLS * front] = u8::from(shown);
            }
        }
        shows.push(map);
    }
    let of_kind = masks.iter().flat_map(|mask| {
        let layers: Vec<&Vec<u8>> =
            shows.iter().enumerate().filter(|(i, _)| mask >> i & 1 != 0).map(|(_, m)| m).collect();
        (0..CELLS * CELLS).map(move |i| layers.iter().fold(0, |any, map| any | map[i]))
    });
    (first as f32, per_texel as f32, of_kind.collect())
}
