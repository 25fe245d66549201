//! Where an object with regions shows something, brick by brick, for each of its bodies: how far the nearest brick is that does, and
//! which of the opacity functions there may be. An edit of a selection costs what it touches.

use std::collections::HashMap;
use std::sync::Arc;

use super::raycast::{nearest, small_texture};
use super::row_places::RowPlaces;
use crate::error::{Error, Result};
use crate::gpu::context::GpuContext;
use crate::gpu::regions::ResidentRegions;
use crate::gpu::upload::{extent, write_box};
use crate::scene::Object;
use crate::volume::bricks::{BRICK, chebyshev_distances, occupy};

/// Kinds of bricks that are told apart, at most; the last then stands for all others.
pub const MAX_KINDS: usize = 256;

/// What the march asks of bricks.
#[derive(Debug)]
pub struct Places {
    revision: u64,
    kinds: Kinds,
    sections: Vec<Section>,
    texture: wgpu::Texture,
}

/// What tells bricks apart.
#[derive(Debug, Default)]
struct Kinds {
    /// A bit for each opacity function that may show something.
    masks: Vec<u32>,
    position: HashMap<u32, u8>,
}

/// The bricks of a body.
#[derive(Debug)]
struct Section {
    /// First brick and the one behind the last, along each axis.
    bricks: [[usize; 2]; 3],
    /// Where the first is in the texture.
    origin: [usize; 3],
    /// In the section, x fastest.
    distances: Vec<u8>,
    kinds: Vec<u8>,
    /// Kinds of sets of looks with sets of rows, as far as they are known.
    kind_of_sets: HashMap<(u32, u16), u8>,
}

/// What decides whether a brick shows something.
pub struct Showing<'a> {
    /// Per body and look, the functions that it shows by.
    pub bits: &'a [Vec<LookBits>],
    /// Which rows of looks bricks may show.
    pub rows: &'a RowPlaces,
    /// Whether anything shows of stored numbers from low to high, by the functions of these bits.
    pub shows: Box<dyn Fn(u32, f64, f64) -> bool + Sync + 'a>,
    /// Whether the march leaps over empty bricks: otherwise none counts as empty.
    pub leaps: bool,
}

/// The functions that a look shows by, a bit each; none where it shows nothing.
#[derive(Clone, Debug, Default)]
pub struct LookBits {
    /// Of each of its rows.
    pub of_rows: Vec<u32>,
    /// Which of the object's second coordinates it has.
    pub across: Option<usize>,
}

impl LookBits {
    /// Of the rows in a set of them.
    fn in_rows(&self, rows: &RowPlaces, set: u16) -> u32 {
        let shown = self.across.map_or(u8::MAX, |across| rows.rows(set, across));
        let bits = self.of_rows.iter().enumerate().filter(|(row, _)| shown >> row & 1 != 0);
        bits.fold(0, |all, (_, bit)| all | bit)
    }
}

impl Section {
    fn size(&self) -> [usize; 3] {
        self.bricks.map(|[from, to]| to - from)
    }

    /// Position of a brick in it.
    fn index(&self, place: [usize; 3]) -> Option<usize> {
        let size = self.size();
        let inside = (0..3).all(|a| (self.bricks[a][0]..self.bricks[a][1]).contains(&place[a]));
        let at = |a: usize| place[a] - self.bricks[a][0];
        inside.then(|| at(0) + size[0] * (at(1) + size[1] * at(2)))
    }

    /// The brick at a position.
    fn place(&self, i: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size();
        let at = [i % nx, i / nx % ny, i / (nx * ny)];
        std::array::from_fn(|a| at[a] + self.bricks[a][0])
    }
}

/// The bricks that each body may show something of.
fn bricks_of(object: &Object) -> Vec<[[usize; 2]; 3]> {
    let most = object.volume.bricks().dims;
    let of_body = |(low, high): (glam::DVec3, glam::DVec3)| {
        std::array::from_fn(|a| {
            let from = ((low[a] + 0.5).max(0.0) / BRICK as f64) as usize;
            // One brick of nothing, where there is nothing.
            [from, ((high[a] + 0.5) / BRICK as f64).ceil().clamp((from + 1) as f64, most[a] as f64) as usize]
        })
    };
    object.bodies().iter().map(|body| of_body(body.index_box(object))).collect()
}

impl Places {
    /// Finds it all.
    ///
    /// # Errors
    /// [`Error::Gpu`] where the adapter has no texture as large.
    pub fn new(
        context: &GpuContext,
        object: &Object,
        regions: &ResidentRegions,
        showing: &Showing<'_>,
    ) -> Result<Self> {
        let most = context.adapter.max_volume_edge as usize;
        let whole = object.volume.bricks().dims;
        let mut kinds = Kinds::default();
        let mut sections: Vec<Section> = Vec::new();
        // One on another along z, as far as the adapter goes; then beside them.
        let (mut size, mut at) = ([0; 3], [0; 3]);
        for bricks in bricks_of(object) {
            let own: [usize; 3] = bricks.map(|[from, to]| to - from);
            if at[2] + own[2] > most {
                at = [at[0] + whole[0], 0, 0];
            }
            let none = Vec::new();
            let mut section =
                Section { bricks, origin: at, distances: none.clone(), kinds: none, kind_of_sets: HashMap::new() };
            at[2] += own[2];
            size = std::array::from_fn(|a| size[a].max(section.origin[a] + own[a]));
            let bits = &showing.bits[sections.len()];
            let mut known = std::mem::take(&mut section.kind_of_sets);
            let places = (0..own.iter().product()).map(|i| section.place(i));
            section.kinds =
                places.map(|place| kinds.at(place, whole, &mut known, regions, bits, showing.rows)).collect();
            section.kind_of_sets = known;
            if showing.leaps {
                let is_occupied =
                    |i: usize| occupied(object, section.place(i), kinds.masks[usize::from(section.kinds[i])], showing);
                section.distances = chebyshev_distances(own, is_occupied);
            } else {
                section.distances = vec![0; section.kinds.len()];
            }
            sections.push(section);
        }
        if size[0] > most {
            return Err(Error::gpu(
                format!("the moved parts take a map of {} bricks, and the adapter holds {most}", size[0]),
                "move fewer of them, or reduce the volume",
            ));
        }
        let (format, dimension) = (wgpu::TextureFormat::Rg8Uint, wgpu::TextureDimension::D3);
        let nothing = vec![0; 2 * size.iter().product::<usize>()];
        let texture = small_texture(context, "skip map", extent(size), dimension, format, &nothing);
        let places = Self { revision: regions.revision, kinds, sections, texture };
        places.sections.iter().for_each(|section| places.write(context, section, section.bricks));
        Ok(places)
    }

    /// Takes edits of selections over. Gives back whether it could: otherwise it has to be made anew. A brick that shows nothing any
    /// more still counts as one that might.
    pub fn update(
        &mut self,
        context: &GpuContext,
        object: &Object,
        regions: &ResidentRegions,
        showing: &Showing<'_>,
    ) -> bool {
        if self.revision == regions.revision {
            return true;
        }
        let Some(changed) = regions.changed_since(self.revision) else { return false };
        let changed: Vec<[usize; 3]> = {
            let [nx, ny, _] = object.volume.bricks().dims;
            changed.map(|i| [i % nx, i / nx % ny, i / (nx * ny)]).collect()
        };
        if !self.sections.iter().map(|s| s.bricks).eq(bricks_of(object)) {
            return false;
        }
        let mut sections = std::mem::take(&mut self.sections);
        for (section, bits) in sections.iter_mut().zip(showing.bits) {
            let whole = object.volume.bricks().dims;
            let mut touched = [[usize::MAX, 0]; 3];
            let mut farther = false;
            for place in &changed {
                let Some(i) = section.index(*place) else { continue };
                let kind = self.kinds.at(*place, whole, &mut section.kind_of_sets, regions, bits, showing.rows);
                section.kinds[i] = kind;
                let size = section.size();
                let at: [usize; 3] = std::array::from_fn(|a| place[a] - section.bricks[a][0]);
                if showing.leaps && occupied(object, *place, self.kinds.masks[usize::from(kind)], showing) {
                    farther |= occupy(&mut section.distances, size, at);
                }
                for (bound, at) in touched.iter_mut().zip(place) {
                    *bound = [bound[0].min(*at), bound[1].max(at + 1)];
                }
            }
            if touched[0][0] != usize::MAX {
                self.write(context, section, if farther { section.bricks } else { touched });
            }
        }
        self.sections = sections;
        self.revision = regions.revision;
        true
    }

    fn write(&self, context: &GpuContext, section: &Section, bricks: [[usize; 2]; 3]) {
        let [x, y, z] = bricks;
        let mut data = Vec::with_capacity(2 * bricks.iter().map(|[from, to]| to - from).product::<usize>());
        for k in z[0]..z[1] {
            for j in y[0]..y[1] {
                let Some(row) = section.index([x[0], j, k]) else { continue };
                let cells = row..row + x[1] - x[0];
                let pairs = section.distances[cells.clone()].iter().zip(&section.kinds[cells]);
                data.extend(pairs.flat_map(|(distance, kind)| [*distance, *kind]));
            }
        }
        let origin = std::array::from_fn(|a| section.origin[a] + bricks[a][0] - section.bricks[a][0]);
        write_box(context, &self.texture, origin, bricks.map(|[from, to]| to - from), 2, &data);
    }

    /// Per kind of brick, at most [`MAX_KINDS`]: a bit for each opacity function that may show something in it.
    pub fn masks(&self) -> &[u32] {
        &self.kinds.masks
    }

    /// Distance to the nearest brick that shows something, and kind of brick.
    pub fn view(&self) -> wgpu::TextureView {
        self.texture.create_view(&Default::default())
    }

    /// Positions of the bricks that the first body, which lies over all of them, may show something of.
    pub fn shown(&self) -> Arc<[u32]> {
        self.sections.first().map_or_else(|| Arc::from([]), |section| nearest(&section.distances))
    }

    /// Per body: its first brick, the one behind its last, and where its first is in the map.
    pub fn sections(&self) -> impl Iterator<Item = [[usize; 3]; 3]> + '_ {
        self.sections.iter().map(|s| [s.bricks.map(|b| b[0]), s.bricks.map(|b| b[1]), s.origin])
    }
}

impl Kinds {
    /// The kind of a brick at a place among `whole` bricks, for looks with these bits. `known`: kinds that were found.
    fn at(
        &mut self,
        place: [usize; 3],
        whole: [usize; 3],
        known: &mut HashMap<(u32, u16), u8>,
        regions: &ResidentRegions,
        bits: &[LookBits],
        rows: &RowPlaces,
    ) -> u8 {
        let [x, y, z] = place;
        let sets = (regions.set_at(place), rows.set_at(x + whole[0] * (y + whole[1] * z)));
        *known.entry(sets).or_insert_with(|| {
            let looks = &regions.sets[sets.0 as usize];
            let mask = looks.iter().map(|look| bits[*look as usize].in_rows(rows, sets.1)).fold(0, |a, b| a | b);
            let masks = &mut self.masks;
            *self.position.entry(mask).or_insert_with(|| {
                if masks.len() < MAX_KINDS {
                    masks.push(mask);
                } else {
                    masks[MAX_KINDS - 1] |= mask;
                }
                (masks.len() - 1) as u8
            })
        })
    }
}

fn occupied(object: &Object, [x, y, z]: [usize; 3], mask: u32, showing: &Showing<'_>) -> bool {
    let bricks = object.volume.bricks();
    let i = x + bricks.dims[0] * (y + bricks.dims[1] * z);
    let (low, high) = bricks.ranges[i];
    mask != 0 && bricks.may_show(i) && (showing.shows)(mask, low, high)
}
