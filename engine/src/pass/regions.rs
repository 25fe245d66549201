//! The looks of an object with regions, as the shader reads them: tables of the different opacity functions, what regions have of
//! them, which bricks show anything, and which kinds of bricks there are.

use std::sync::{Arc, Weak};

use super::may_show::MayShow;
use super::places::{LookBits, MAX_KINDS, Places, Showing};
use super::raycast::{FunctionDrawing, NodeRows, in_steps, small_texture, uniform};
use super::row_places::{BrickEdges, RowPlaces};
use super::transfer_table::{TABLE_SIZE, TransferTable};
use crate::error::Result;
use crate::gpu::context::GpuContext;
use crate::gpu::regions::{LIST_WIDTH, ResidentRegions};
use crate::gpu::upload::{ResidentVolume, extent};
use crate::scene::quality::PARTS;
use crate::scene::region::MAX_OPACITY_FUNCTIONS;
use crate::scene::{Across, Axis, Borders, Look, Object, Role, StyleTransferFunction};
use crate::selection::DistanceField;
use crate::volume::Volume;

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
    distance_scale: [f32; 3],
    pad2: f32,
}
}

/// What depends on looks and on the regions' places, but not on the camera.
#[derive(Debug)]
pub struct RegionLooks {
    lengths_mm: f64,
    leaps: bool,
    borders: Borders,
    drawn: Drawn,
    /// Some looks are more opaque than others.
    pub cuts: bool,
    /// The function of what shows first: the only one, where there are not several.
    pub function: StyleTransferFunction,
    /// Three texels a look, the looks of each body one after the other, then those of further rows.
    pub region_looks: wgpu::TextureView,
    /// Where looks have rows, what they go by: see `shaders/bind/rows.wgsl`.
    pub rows: Option<wgpu::TextureView>,
    /// Most gaps between the rows of a look.
    most_gaps: u32,
    /// The styles of the nodes, a row for each different list of them.
    pub node_layers: wgpu::TextureView,
    /// The tables, one a different function.
    pub layers: Vec<Arc<TransferTable>>,
    /// The tables, one layer each; a plain texture if there is but one function.
    pub tables: wgpu::TextureView,
    /// Between which values they may show something.
    pub may_show: MayShow,
    /// The styles of the nodes, as `node_layers` has them.
    pub(super) node_rows: NodeRows,
    /// What only several functions need.
    functions: Option<[LayerUniform; MAX_OPACITY_FUNCTIONS]>,
    /// Per body and look, the bits of its functions.
    bits: Vec<Vec<LookBits>>,
    row_places: RowPlaces,
    places: Places,
}

/// What of an object the looks are made of, to be compared.
#[derive(Debug)]
struct Drawn {
    volume: Weak<Volume>,
    background: StyleTransferFunction,
    regions: Vec<Look>,
    /// Ghosts of moved regions.
    ghosts: Vec<Option<Look>>,
    /// Which regions are shown by each body.
    bodies: Vec<Vec<usize>>,
    /// What second coordinates go by: fields of distances and, in mm, what gradients are smoothed by.
    distances: Vec<Arc<DistanceField>>,
    gradient_scale_mm: f64,
}

impl Drawn {
    fn of(object: &Object) -> Self {
        Self {
            volume: Arc::downgrade(&object.volume),
            background: object.transfer_function.clone(),
            regions: object.regions.iter().map(|r| r.look.clone()).collect(),
            ghosts: object.regions.iter().map(|r| r.moved().map(|moved| moved.ghost.clone())).collect(),
            bodies: object.bodies().into_iter().map(|body| body.regions).collect(),
            distances: object.distances.clone(),
            gradient_scale_mm: object.gradient_scale_mm,
        }
    }

    fn is(&self, object: &Object) -> bool {
        // Held weakly, the address of a volume goes to no other.
        std::ptr::eq(self.volume.as_ptr(), &*object.volume)
            && self.background == object.transfer_function
            && self.regions.iter().eq(object.regions.iter().map(|r| &r.look))
            && self.ghosts.iter().map(Option::as_ref).eq(object.regions.iter().map(|r| r.moved().map(|m| &m.ghost)))
            && self.bodies.iter().eq(object.bodies().iter().map(|body| &body.regions))
            && self.distances.iter().map(Arc::as_ptr).eq(object.distances.iter().map(Arc::as_ptr))
            && self.gradient_scale_mm == object.gradient_scale_mm
    }
}

/// Whether a look's function gives opacity to anything.
fn shows(look: &Look) -> bool {
    look.transfer_function.all_nodes().any(|n| n.opacity > 0.0)
}

/// What was made for looks: tables, so that one that changes costs one, and the edges of bricks.
#[derive(Debug, Default)]
pub struct Made {
    tables: Vec<(StyleTransferFunction, f64, Arc<TransferTable>)>,
    edges: BrickEdges,
}

/// More than that are forgotten: three steps of a refining picture.
const MAX_TABLES: usize = 3 * MAX_OPACITY_FUNCTIONS;

impl Made {
    fn table(
        &mut self,
        object: &Object,
        resident: &ResidentVolume,
        function: &StyleTransferFunction,
        lengths: f64,
    ) -> Arc<TransferTable> {
        if let Some((.., table)) = self.tables.iter().find(|(f, l, _)| *l == lengths && f.same_opacity(function)) {
            return table.clone();
        }
        let made = TransferTable::new(function, object.volume.rescale, resident.encoding, object.data_range(), lengths);
        let made = Arc::new(made);
        if self.tables.len() >= MAX_TABLES {
            self.tables.remove(0);
        }
        self.tables.push((function.clone(), lengths, made.clone()));
        made
    }
}

/// What looks have in common that are being made.
#[derive(Default)]
struct MadeLooks {
    /// How the function of what shows first is drawn.
    visible: FunctionDrawing,
    /// Whether any is drawn otherwise.
    is_drawn_unlike: bool,
    /// The different functions from value to opacity.
    layers: Vec<StyleTransferFunction>,
    /// The different lists of nodes' styles.
    node_rows: Vec<Vec<u32>>,
    texels: Vec<[f32; 4]>,
}

/// What a row of a look has of it.
struct MadeLook {
    /// d₀ of the object, mm.
    d0: f64,
    opacity: f64,
    tint: Option<[f32; 3]>,
}

impl MadeLooks {
    /// The three texels of a row of a look, and the bit of its function.
    fn row(
        &mut self,
        function: StyleTransferFunction,
        MadeLook { d0, opacity, tint }: MadeLook,
    ) -> ([[f32; 4]; 3], u32) {
        let styles: Vec<u32> = function.nodes.iter().map(|n| n.style as u32).collect();
        let row = self.node_rows.iter().position(|r| *r == styles).unwrap_or_else(|| {
            self.node_rows.push(styles);
            self.node_rows.len() - 1
        });
        let drawn = FunctionDrawing::of(&function);
        self.is_drawn_unlike |= drawn != self.visible;
        let lengths = d0 / function.reference_length_mm;
        let layer = self.layers.iter().position(|f| f.same_opacity(&function)).unwrap_or_else(|| {
            self.layers.push(function);
            self.layers.len() - 1
        });
        let ([red, green, blue], opacity) = (tint.unwrap_or_default(), 1.0 + opacity as f32);
        let [r, g, b, own] = drawn.ink;
        let texels = [
            [red, green, blue, if tint.is_some() { opacity } else { -opacity }],
            [layer as f32, lengths as f32, row as f32, drawn.contour_pt],
            [r, g, b, own + if drawn.transparency { 2.0 } else { 0.0 }],
        ];
        (texels, 1 << layer)
    }
}

/// What looks' rows go by, as `shaders/bind/rows.wgsl` has it: two texels for each look, then one for each gap between rows.
#[derive(Default)]
struct RowTexels {
    looks: Vec<[f32; 4]>,
    gaps: Vec<[f32; 4]>,
    most_gaps: u32,
}

impl RowTexels {
    /// The next look's. `first_further`: position of the look that its second row is.
    fn add(&mut self, function: &StyleTransferFunction, first_further: u32) {
        let first_gap = self.gaps.len() as f32;
        let places: Vec<f64> = function.across.iter().flat_map(|across| across.places()).collect();
        let gap = |pair: &[f64]| [pair[0] as f32, (1.0 / (pair[1] - pair[0])) as f32, 0.0, 0.0];
        self.gaps.extend(places.windows(2).map(gap));
        let num_gaps = places.len().saturating_sub(1) as u32;
        self.most_gaps = self.most_gaps.max(num_gaps);
        let mut goes_by = [0.0; 4];
        let place = match function.across.as_ref().map(|across| across.axis) {
            Some(Axis::Distance(field)) => {
                goes_by[field] = 1.0;
                -1.0
            }
            Some(Axis::Even(place)) => {
                goes_by[0] = place as f32;
                1.0
            }
            Some(Axis::Edge) | None => 0.0,
        };
        self.looks.push([first_further as f32, first_gap, num_gaps as f32, place]);
        self.looks.push(goes_by);
    }

    /// Texels along x, y, z.
    fn size(&self) -> [usize; 3] {
        [LIST_WIDTH, (self.looks.len() + self.gaps.len()).div_ceil(LIST_WIDTH).max(1), 1]
    }

    fn finish(mut self) -> Vec<[f32; 4]> {
        let [width, height, _] = self.size();
        let first = self.looks.len() as f32;
        self.looks.chunks_mut(2).for_each(|look| look[0][1] += first);
        self.looks.append(&mut self.gaps);
        self.looks.resize(width * height, [0.0; 4]);
        self.looks
    }
}

impl RegionLooks {
    /// Whether it is what [`RegionLooks::new`] would make, but for edits of selections.
    pub fn is_of(&self, object: &Object, regions: &ResidentRegions, lengths_mm: f64, leaps: bool) -> bool {
        (self.lengths_mm, self.leaps, self.borders) == (lengths_mm, leaps, regions.borders()) && self.drawn.is(object)
    }

    /// `lengths_mm`: the usual length of a part of a piece; `leaps`: whether the march leaps over empty bricks.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) where the adapter has no room.
    pub fn new(
        context: &GpuContext,
        object: &Object,
        resident: &ResidentVolume,
        regions: &ResidentRegions,
        kept: &mut Made,
        lengths_mm: f64,
        leaps: bool,
    ) -> Result<Self> {
        let background = Look::plain(object.transfer_function.clone());
        // Of each body, and of each look in it; none where it is not shown.
        let bodies = object.bodies();
        let mut shown: Vec<Vec<Option<&Look>>> = bodies
            .iter()
            .map(|body| {
                let own = (0..object.regions.len()).map(|i| body.look(object, i));
                std::iter::once((body.role == Role::Rest).then_some(&background)).chain(own).collect()
            })
            .collect();
        if bodies.iter().any(|body| body.role == Role::Ghost) {
            // All that rests, for the faces in it: where a ghost is a body of its own, the rest does not end.
            let resting = object.regions.iter().map(|r| Some(r.moved().map_or(&r.look, |moved| &moved.ghost)));
            shown.push(std::iter::once(Some(&background)).chain(resting).collect());
        }
        let all = || shown.iter().flatten();
        let d0 = object.reference_length_mm();
        // A look that shows nothing has whatever function another one has.
        let visible = all().flatten().find(|look| shows(look)).map_or(&background, |look| *look);
        let mut made = MadeLooks { visible: FunctionDrawing::of(&visible.transfer_function), ..MadeLooks::default() };
        let mut bits = Vec::new();
        let mut further = Vec::new();
        let mut rows = RowTexels::default();
        let mut all_across: Vec<&Across> = Vec::new();
        let first_further = all().count();
        for look in all() {
            let seen = look.filter(|look| shows(look));
            let function = &seen.unwrap_or(visible).transfer_function;
            let opacity = seen.map_or(0.0, |look| look.opacity);
            let tint = look.and_then(|look| look.tint);
            rows.add(function, (first_further + further.len()) as u32);
            let mut own = LookBits::default();
            if let Some(across) = &function.across {
                let known =
                    all_across.iter().position(|known| known.axis == across.axis && known.places().eq(across.places()));
                own.across = Some(known.unwrap_or_else(|| {
                    all_across.push(across);
                    all_across.len() - 1
                }));
            }
            for (i, row) in function.rows().enumerate() {
                let of_row = MadeLook { d0, opacity, tint };
                let (texels, bit) = made.row(row, of_row);
                own.of_rows.push(if opacity > 0.0 { bit } else { 0 });
                if i == 0 { made.texels.extend(texels) } else { further.push(texels) }
            }
            bits.push(own);
        }
        let MadeLooks { layers, node_rows, mut texels, is_drawn_unlike, .. } = made;
        texels.extend(further.into_iter().flatten());
        let has_rows = object.has_rows();
        let factor = |look: &Option<&Look>| look.filter(|look| shows(look)).map_or(0.0, |look| look.opacity);
        let differs = layers.len() > 1 || all().any(|look| factor(look) != factor(&shown[0][0]));
        let cuts = differs && !object.regions.is_empty();
        let layers: Vec<Arc<TransferTable>> = layers
            .iter()
            .map(|function| kept.table(object, resident, function, in_steps(lengths_mm / function.reference_length_mm)))
            .collect();
        let (two, three) = (wgpu::TextureDimension::D2, [LIST_WIDTH, texels.len().div_ceil(LIST_WIDTH), 1]);
        let float = wgpu::TextureFormat::Rgba32Float;
        texels.resize(three[0] * three[1], [0.0; 4]);
        let texels = bytemuck::cast_slice(&texels);
        let plain = |texture: wgpu::Texture| texture.create_view(&Default::default());
        let width = node_rows.iter().map(Vec::len).max().unwrap_or(1);
        let nodes: Vec<u32> = node_rows.iter().flat_map(|row| (0..width).map(|i| row[i.min(row.len() - 1)])).collect();
        let node_size = extent([width, node_rows.len(), 1]);
        let uint = wgpu::TextureFormat::R32Uint;
        let node_layers = small_texture(context, "node layers", node_size, two, uint, bytemuck::cast_slice(&nodes));
        let entries: Vec<[f32; 4]> = layers.iter().flat_map(|t| &t.entries).copied().collect();
        let has_functions = layers.len() > 1 || node_rows.len() > 1 || is_drawn_unlike || has_rows;
        let table_size = extent([TABLE_SIZE, TABLE_SIZE, layers.len()]);
        let made = small_texture(context, "transfer functions", table_size, two, float, bytemuck::cast_slice(&entries));
        let functions = has_functions.then(|| {
            // What no look has is never read.
            std::array::from_fn(|i| layer_uniform(&layers[i.min(layers.len() - 1)]))
        });
        let bits: Vec<Vec<LookBits>> = bits.chunks(1 + object.regions.len()).map(<[LookBits]>::to_vec).collect();
        // With longer steps than one leaps with, pieces reach farther out of a brick than its rows are known for.
        let row_places =
            if leaps { RowPlaces::new(object, &all_across, &mut kept.edges) } else { RowPlaces::default() };
        let places = Places::new(context, object, regions, &showing(&bits, &row_places, &layers, resident, leaps))?;
        let most_gaps = rows.most_gaps;
        let rows = has_rows.then(|| {
            let size = rows.size();
            plain(small_texture(context, "rows", extent(size), two, float, bytemuck::cast_slice(&rows.finish())))
        });
        Ok(Self {
            lengths_mm,
            leaps,
            rows,
            most_gaps,
            borders: regions.borders(),
            drawn: Drawn::of(object),
            cuts,
            function: visible.transfer_function.clone(),
            region_looks: plain(small_texture(context, "region looks", extent(three), two, float, texels)),
            node_layers: plain(node_layers),
            tables: if has_functions { arrays(&made) } else { plain(made) },
            may_show: MayShow::new(context, &layers, object, resident),
            functions,
            node_rows: NodeRows { width, styles: nodes.into() },
            bits,
            row_places,
            layers,
            places,
        })
    }

    /// Takes over what was edited of the selections since.
    ///
    /// # Errors
    /// As [`RegionLooks::new`].
    pub fn update(
        &mut self,
        context: &GpuContext,
        object: &Object,
        resident: &ResidentVolume,
        regions: &ResidentRegions,
    ) -> Result<()> {
        let showing = showing(&self.bits, &self.row_places, &self.layers, resident, self.leaps);
        if !self.places.update(context, object, regions, &showing) {
            self.places = Places::new(context, object, regions, &showing)?;
        }
        Ok(())
    }

    /// The table of the first function.
    pub fn table(&self) -> &TransferTable {
        &self.layers[0]
    }

    /// Distance to the nearest brick that shows something, and kind of brick.
    pub fn skip_map(&self) -> wgpu::TextureView {
        self.places.view()
    }

    /// See [`Places::shown`].
    pub fn shown(&self) -> Arc<[u32]> {
        self.places.shown()
    }

    /// Where the bodies' bricks are in the skip map; see [`Places::sections`].
    pub fn sections(&self) -> impl Iterator<Item = [[usize; 3]; 3]> + '_ {
        self.places.sections()
    }

    /// What only several functions need.
    pub fn functions(&self) -> Option<FunctionsUniform> {
        let layers = self.functions?;
        let masks = self.places.masks();
        let kinds = std::array::from_fn(|i| std::array::from_fn(|j| masks.get(4 * i + j).copied().unwrap_or(0)));
        Some(FunctionsUniform { layers, kinds })
    }

    /// The uniform for the atlas as it is now. `shade`: as of [`RegionLooks::rounds`].
    pub fn uniform(&self, object: &Object, regions: &ResidentRegions, shade: u32) -> RegionsUniform {
        let gradient = object.volume.grid.world_gradient_from_index();
        let edge = |field: &Arc<DistanceField>, a: usize| (field.dims()[a] * field.voxels()[a]) as f32;
        let distance_scale = |a: usize| object.distances.first().map_or(1.0, |field| 1.0 / edge(field, a));
        let column = |v: glam::DVec3| v.as_vec3().to_array();
        let [rounds_per_piece, rounds_per_look] = self.rounds(regions, shade);
        RegionsUniform {
            atlas_scale: regions.atlas_size().map(|n| 1.0 / n as f32),
            rounds_per_look,
            world_x: column(gradient.x_axis),
            rounds_per_piece,
            world_y: column(gradient.y_axis),
            pad0: 0.0,
            world_z: column(gradient.z_axis),
            pad1: 0.0,
            distance_scale: std::array::from_fn(distance_scale),
            pad2: 0.0,
        }
    }

    /// Rounds of the shader's loops that a piece takes at most, with one look a part, and that a further look takes. `shade`: those of
    /// a look at one surface.
    pub fn rounds(&self, regions: &ResidentRegions, shade: u32) -> [u32; 2] {
        // A look goes over the brick's list and the background, and so does the face of a piece; with labels the face alone.
        let list = regions.longest_list + 1;
        // Two rows of a look at a time, each after all of its gaps were gone through.
        let (rows, gaps) = if self.rows.is_some() { (2, self.most_gaps) } else { (1, 0) };
        let look = 2 + rows * (shade + gaps) * if self.borders == Borders::Exact { list } else { 1 };
        let num_layers = if self.functions.is_some() { self.layers.len() as u32 } else { 0 };
        let own = num_layers + list * (1 + gaps) + (PARTS + 1) * (1 + look);
        let num_bodies = self.drawn.bodies.len() as u32;
        if num_bodies == 1 {
            // Those of the march, of the layers that are asked whether they show the piece, and of each part.
            return [8 + own, look];
        }
        // For each body in a piece: before what is its own, the loops over all of them, which are gone through up to three times until
        // it is known what shows: stretches, leaps, values, and what is taken over.
        [48 + own, look]
    }
}

fn showing<'a>(
    bits: &'a [Vec<LookBits>],
    rows: &'a RowPlaces,
    layers: &'a [Arc<TransferTable>],
    resident: &'a ResidentVolume,
    leaps: bool,
) -> Showing<'a> {
    let shows = move |mask: u32, low: f64, high: f64| {
        let (low, high) = (resident.encoding.texel(low), resident.encoding.texel(high));
        layers.iter().enumerate().any(|(layer, table)| mask >> layer & 1 != 0 && table.shows(low, high))
    };
    Showing { bits, rows, shows: Box::new(shows), leaps }
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
