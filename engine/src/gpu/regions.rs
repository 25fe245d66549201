//! Regions on the adapter: the memberships of the bricks that lie at the ends of regions, and per brick the list of regions
//! that have a part of it; or, for borders by two look-ups, the numbers of the labels of the bricks in which labels meet, and per
//! brick the list of its labels. An edit of a selection uploads the bricks that it touches.

use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::context::GpuContext;
use super::labels::{Largest, Numbered, number};
use super::upload::{TABLE_USAGE, extent, table_descriptor, write_box};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::scene::{Borders, Region};
use crate::selection::{BRICK, Brick, Selection};

/// Texels along x and y of the atlas. Along all axes a power of two: so f32 has the place of a sample exactly, and a picture does
/// not depend on which slot a brick happens to have.
const ATLAS_EDGE: usize = 512;
/// Slots along x and y of it.
const SLOTS: usize = ATLAS_EDGE / SLOT_EDGE;
/// Texels along the edge of a slot: a brick's voxels and one more on either side.
pub const SLOT_EDGE: usize = BRICK + 2;
/// Texels along z of the smallest atlas.
const LEAST_DEPTH: usize = 16;
/// Texels in a row of textures that hold lists; `LIST_WIDTH` of the shader.
pub const LIST_WIDTH: usize = 2048;
/// The slot of bricks that are wholly in a region; `WHOLE` of the shader.
pub const WHOLE: u32 = u32::MAX;
/// Voxels around a brick in which what is present counts for leaping: as far as a piece with its middle in it reaches.
const BORDER: usize = 2;
/// Voxels along the edge of a brick with that border.
const BLOCK: usize = BRICK + 2 * BORDER;

/// Memberships of a brick with a border of two voxels, x fastest; beyond the grid its edge goes on.
type Block = [u8; BLOCK * BLOCK * BLOCK];

/// What a brick has of a region.
struct Part {
    region: u32,
    /// Absent where no sample in the brick meets the region.
    held: Option<Held>,
}

/// How a region holds a brick.
enum Held {
    Whole,
    Partly(Box<Block>),
}

/// What is found of a brick before anything is uploaded.
struct Found {
    place: [usize; 3],
    parts: Vec<Part>,
    /// Whether something around it belongs to no region.
    has_rest: bool,
    /// For borders by two look-ups: what its slot would hold.
    labels: Option<Numbered>,
}

/// A brick's list in the entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct List {
    first: u32,
    count: u32,
    /// For borders by two look-ups: where its labels' numbers are.
    slot: u32,
}

impl List {
    /// That of a brick with no region around it.
    const NONE: Self = Self { first: 0, count: 0, slot: WHOLE };
}

/// The regions of an object, as the shader reads them.
#[derive(Debug)]
pub struct ResidentRegions {
    borders: Borders,
    selections: Vec<Selection>,
    /// Bricks along x, y, z.
    size: [usize; 3],
    lists: Vec<List>,
    entries: Vec<[u32; 2]>,
    /// Entries that no list has any more.
    num_stale: usize,
    free_slots: Vec<u32>,
    num_slots: u32,
    /// Texels of the atlas along z.
    atlas_depth: usize,
    format: wgpu::TextureFormat,
    atlas: wgpu::Texture,
    directory: wgpu::Texture,
    entry_rows: usize,
    entry_texture: wgpu::Texture,
    /// Position in `sets` of each brick's.
    set_of_brick: Vec<u32>,
    /// The different sets of looks (0 = background, else region + 1) that there are around bricks.
    pub sets: Vec<Vec<u32>>,
    position_of_set: HashMap<Vec<u32>, u32>,
    /// Entries of the longest list that any brick has had.
    pub longest_list: u32,
    /// Goes up by one whenever anything above changes; no two uploads have one in common.
    pub revision: u64,
    /// Bricks that changed at each of the last revisions.
    changes: VecDeque<Vec<u32>>,
}

/// Where the revisions of the next upload begin.
static NEXT_REVISION: AtomicU64 = AtomicU64::new(0);

/// Changed bricks that are remembered; beyond that it is as cheap to look at all.
const MAX_CHANGES: usize = 1 << 14;

impl Found {
    /// Slots that it needs.
    fn num_slots(&self) -> usize {
        let memberships = self.parts.iter().filter(|part| matches!(part.held, Some(Held::Partly(_)))).count();
        memberships + usize::from(self.labels.as_ref().is_some_and(|numbered| numbered.labels.len() > 1))
    }
}

impl ResidentRegions {
    /// Uploads the selections of `regions`, of a volume of so many bricks, for one kind of borders.
    ///
    /// # Errors
    /// [`Error::Gpu`] where the adapter has no room, [`Error::Cancelled`].
    pub fn upload(
        context: &GpuContext,
        size: [usize; 3],
        regions: &[Region],
        borders: Borders,
        progress: &Progress,
    ) -> Result<Self> {
        let num_bricks = size.iter().product();
        let format = match borders {
            // Every adapter filters half floats, and they hold the numbers of a brick's labels exactly.
            Borders::TwoLookUps => wgpu::TextureFormat::R16Float,
            // Memberships have 8 bits, but not every adapter filters such texels with more than 8 themselves.
            Borders::Exact if context.formats.r16_filterable => wgpu::TextureFormat::R16Unorm,
            Borders::Exact => wgpu::TextureFormat::R8Unorm,
        };
        let directory = texture(context, "regions of bricks", wgpu::TextureFormat::Rg32Uint, size)?;
        let mut resident = Self {
            borders,
            selections: Vec::new(),
            size,
            lists: vec![List::NONE; num_bricks],
            entries: nowhere(borders).to_vec(),
            num_stale: 0,
            free_slots: Vec::new(),
            num_slots: 0,
            atlas_depth: LEAST_DEPTH,
            format,
            atlas: texture(context, "memberships", format, [ATLAS_EDGE, ATLAS_EDGE, LEAST_DEPTH])?,
            directory,
            entry_rows: 1,
            entry_texture: entry_texture(context, 1)?,
            set_of_brick: vec![0; num_bricks],
            sets: vec![vec![0]],
            position_of_set: HashMap::from([(vec![0], 0)]),
            longest_list: 0,
            revision: NEXT_REVISION.fetch_add(1 << 32, Ordering::Relaxed),
            changes: VecDeque::new(),
        };
        let candidates = resident.candidates(regions);
        resident.selections = regions.iter().map(|r| r.selection.clone()).collect();
        progress.begin("regions", candidates.len() as u64);
        // In portions, so that blocks of bricks do not pile up.
        for portion in candidates.chunks(1 << 14) {
            let found = resident.find(portion);
            resident.put(context, found)?;
            progress.advance(portion.len() as u64)?;
        }
        resident.write_directory(context, [[0, size[0]], [0, size[1]], [0, size[2]]]);
        Ok(resident)
    }

    /// Uploads what has changed since. Gives back whether it could: other regions than these have to be uploaded anew.
    ///
    /// # Errors
    /// As [`ResidentRegions::upload`].
    pub fn update(&mut self, context: &GpuContext, size: [usize; 3], regions: &[Region]) -> Result<bool> {
        if self.size != size
            || regions.len() != self.selections.len()
            || regions.iter().zip(&self.selections).any(|(r, s)| r.selection.grid().dims() != s.grid().dims())
        {
            return Ok(false);
        }
        let mut places: HashSet<[usize; 3]> = HashSet::new();
        for (region, old) in regions.iter().zip(&self.selections) {
            for place in region.selection.changed_since(old) {
                places.extend(neighbors(place, self.size));
            }
        }
        if places.is_empty() {
            return Ok(true);
        }
        self.selections = regions.iter().map(|r| r.selection.clone()).collect();
        let looked_at = |place: [usize; 3]| {
            let near = |s: &Selection| neighbors(place, self.size).any(|p| !s.brick(p).is_empty());
            let present = (0..self.selections.len()).filter(|i| near(&self.selections[*i]));
            (place, present.map(|i| i as u32).collect::<Vec<_>>())
        };
        let candidates: Vec<_> = places.into_iter().map(looked_at).collect();
        let found = self.find(&candidates);
        let mut changed = [[usize::MAX, 0]; 3];
        for (place, _) in &candidates {
            for (bound, at) in changed.iter_mut().zip(place) {
                *bound = [bound[0].min(*at), bound[1].max(at + 1)];
            }
        }
        self.put(context, found)?;
        self.write_directory(context, changed);
        Ok(true)
    }

    /// Bricks that may have regions around them, with those.
    fn candidates(&self, regions: &[Region]) -> Vec<([usize; 3], Vec<u32>)> {
        let mut near: HashMap<[usize; 3], Vec<u32>> = HashMap::new();
        for (i, region) in regions.iter().enumerate() {
            for (place, _) in region.selection.bricks() {
                for p in neighbors(place, self.size) {
                    let list = near.entry(p).or_default();
                    if list.last() != Some(&(i as u32)) {
                        list.push(i as u32);
                    }
                }
            }
        }
        let mut candidates: Vec<_> = near.into_iter().collect();
        candidates.sort_unstable_by_key(|([x, y, z], _)| [*z, *y, *x]);
        candidates
    }

    fn find(&self, candidates: &[([usize; 3], Vec<u32>)]) -> Vec<Found> {
        let find = |(place, regions): &([usize; 3], Vec<u32>)| {
            let mut covered = [0u16; BLOCK * BLOCK * BLOCK];
            let mut largest = (self.borders == Borders::TwoLookUps).then(|| Largest::new(SLOT_EDGE.pow(3)));
            let part = |&region: &u32| {
                let block = block(&self.selections[region as usize], *place);
                if block.iter().all(|f| *f == 0) {
                    return None;
                }
                covered.iter_mut().zip(&block).for_each(|(sum, f)| *sum = sum.saturating_add(u16::from(*f)));
                if let Some(largest) = &mut largest {
                    largest.take(region + 1, inner_rows(&block).flatten());
                    return Some(Part { region, held: None });
                }
                let mut inner = inner_rows(&block).flatten().copied();
                let first = inner.next().unwrap_or(0);
                let uniform = inner.all(|f| f == first);
                let held = match (first, uniform) {
                    (0, true) => None,
                    (u8::MAX, true) => Some(Held::Whole),
                    _ => Some(Held::Partly(Box::new(block))),
                };
                Some(Part { region, held })
            };
            let parts = regions.iter().filter_map(part).collect();
            let labels = largest.map(|largest| number(&largest.finish(), SLOT_EDGE));
            Found { place: *place, parts, has_rest: covered.iter().any(|sum| *sum < 255), labels }
        };
        candidates.par_iter().with_min_len(8).map(find).collect()
    }

    /// Takes bricks over: their slots, entries and sets.
    fn put(&mut self, context: &GpuContext, found: Vec<Found>) -> Result<()> {
        self.revision += 1;
        let num_needed = found.iter().map(Found::num_slots).sum();
        let mut written = Vec::new();
        let first_entry = self.entries.len();
        let [nx, ny, _] = self.size;
        for Found { place: [x, y, z], .. } in &found {
            let list = std::mem::replace(&mut self.lists[x + nx * (y + ny * z)], List::NONE);
            let old = &self.entries[list.first as usize..(list.first + list.count) as usize];
            let slots = match self.borders {
                Borders::Exact => old,
                Borders::TwoLookUps => &[[0, list.slot]],
            };
            self.free_slots.extend(slots.iter().map(|[_, slot]| *slot).filter(|slot| *slot != WHOLE).map(unpacked));
            self.num_stale += old.len();
        }
        self.reserve_slots(context, num_needed)?;
        let mut changed = Vec::with_capacity(found.len());
        for Found { place: [x, y, z], parts, has_rest, labels } in found {
            let brick = x + nx * (y + ny * z);
            let set: Vec<u32> =
                has_rest.then_some(0).into_iter().chain(parts.iter().map(|part| part.region + 1)).collect();
            let next = self.sets.len() as u32;
            let position = *self.position_of_set.entry(set).or_insert_with_key(|set| {
                self.sets.push(set.clone());
                next
            });
            self.set_of_brick[brick] = position;
            changed.push(brick as u32);
            let first = self.entries.len() as u32;
            let mut slot_of_labels = WHOLE;
            for Part { region, held } in parts {
                let slot = match held {
                    None => continue,
                    Some(Held::Whole) => WHOLE,
                    Some(Held::Partly(block)) => {
                        let slot = self.new_slot();
                        written.push((slot, self.texels_of_memberships(&block)));
                        packed(slot)
                    }
                };
                self.entries.push([region + 1, slot]);
            }
            if let Some(Numbered { labels, numbers }) = labels
                && labels != [0]
            {
                let count = labels.len() as u32;
                self.entries.extend(labels.iter().map(|label| [*label, count]));
                if count > 1 {
                    let slot = self.new_slot();
                    written.push((slot, texels_of_numbers(&numbers)));
                    slot_of_labels = packed(slot);
                }
            }
            let count = self.entries.len() as u32 - first;
            if count > 0 {
                self.lists[brick] = List { first, count, slot: slot_of_labels };
            }
            self.longest_list = self.longest_list.max(count);
        }
        self.changes.push_back(changed);
        let mut num_changes: usize = self.changes.iter().map(Vec::len).sum();
        while num_changes > MAX_CHANGES {
            num_changes -= self.changes.pop_front().map_or(0, |oldest| oldest.len());
        }
        self.write_slots(context, written);
        self.write_entries(context, first_entry)
    }

    fn new_slot(&mut self) -> u32 {
        self.free_slots.pop().unwrap_or_else(|| {
            self.num_slots += 1;
            self.num_slots - 1
        })
    }

    fn bytes_per_texel(&self) -> usize {
        if self.format == wgpu::TextureFormat::R8Unorm { 1 } else { 2 }
    }

    /// What a slot holds of a region's memberships.
    fn texels_of_memberships(&self, block: &Block) -> Vec<u8> {
        // 255 becomes 65 535.
        let repeat = self.bytes_per_texel();
        inner_rows(block).flatten().flat_map(|value| std::iter::repeat_n(*value, repeat)).collect()
    }

    fn reserve_slots(&mut self, context: &GpuContext, num_needed: usize) -> Result<()> {
        let wanted = self.num_slots as usize + num_needed.saturating_sub(self.free_slots.len());
        let slots_in = |depth: usize| depth / SLOT_EDGE * SLOTS * SLOTS;
        let mut depth = self.atlas_depth;
        while slots_in(depth) < wanted {
            depth *= 2;
        }
        if depth == self.atlas_depth {
            return Ok(());
        }
        let most = context.adapter.max_volume_edge as usize;
        if depth > most {
            // The deepest power of two that it holds.
            let most = slots_in(1 << most.ilog2());
            return Err(Error::gpu(
                format!("the borders of the regions take {wanted} bricks, and the adapter holds {most}"),
                "reduce the volume, or use fewer or simpler selections",
            ));
        }
        let atlas = texture(context, "memberships", self.format, [ATLAS_EDGE, ATLAS_EDGE, depth])?;
        if self.num_slots > 0 {
            let mut encoder = context.device.create_command_encoder(&Default::default());
            let old = extent(self.atlas_size());
            encoder.copy_texture_to_texture(self.atlas.as_image_copy(), atlas.as_image_copy(), old);
            context.queue.submit([encoder.finish()]);
        }
        (self.atlas, self.atlas_depth) = (atlas, depth);
        Ok(())
    }

    /// Writes slots: those in a row of the atlas together, as each write costs.
    fn write_slots(&self, context: &GpuContext, mut written: Vec<(u32, Vec<u8>)>) {
        let texel = self.bytes_per_texel();
        written.sort_unstable_by_key(|(slot, _)| *slot);
        let in_row = |a: &(u32, Vec<u8>), b: &(u32, Vec<u8>)| b.0 == a.0 + 1 && !(b.0 as usize).is_multiple_of(SLOTS);
        for row in written.chunk_by(in_row) {
            let width = row.len() * SLOT_EDGE;
            let mut data = vec![0; width * SLOT_EDGE * SLOT_EDGE * texel];
            for (i, (_, texels)) in row.iter().enumerate() {
                for (j, texels) in texels.chunks(SLOT_EDGE * texel).enumerate() {
                    data[(j * width + i * SLOT_EDGE) * texel..][..texels.len()].copy_from_slice(texels);
                }
            }
            let slot = row[0].0 as usize;
            let origin = [slot % SLOTS, slot / SLOTS % SLOTS, slot / (SLOTS * SLOTS)].map(|n| n * SLOT_EDGE);
            write_box(context, &self.atlas, origin, [width, SLOT_EDGE, SLOT_EDGE], texel, &data);
        }
    }

    /// Writes the entries from `first` on, after throwing out those that no list has any more, if they are many.
    fn write_entries(&mut self, context: &GpuContext, mut first: usize) -> Result<()> {
        if self.num_stale > 1 << 16 && 2 * self.num_stale > self.entries.len() {
            let mut entries = Vec::with_capacity(self.entries.len() - self.num_stale);
            entries.extend(nowhere(self.borders));
            for list in self.lists.iter_mut().filter(|list| list.count > 0) {
                let old = &self.entries[list.first as usize..(list.first + list.count) as usize];
                list.first = entries.len() as u32;
                entries.extend_from_slice(old);
            }
            (self.entries, self.num_stale, first) = (entries, 0, 0);
            let [nx, ny, nz] = self.size;
            self.write_directory(context, [[0, nx], [0, ny], [0, nz]]);
        }
        let rows = self.entries.len().div_ceil(LIST_WIDTH).max(1);
        if rows > self.entry_rows {
            let limit = context.device.limits().max_texture_dimension_2d as usize;
            if rows > limit {
                return Err(Error::gpu(
                    format!("the regions' lists take {rows} rows of a texture, and the adapter holds {limit}"),
                    "reduce the volume, or use fewer regions",
                ));
            }
            self.entry_rows = (2 * rows).min(limit);
            self.entry_texture = entry_texture(context, self.entry_rows)?;
            first = 0;
        }
        // Whole rows: the start of the first is there already.
        let from = first / LIST_WIDTH * LIST_WIDTH;
        if from < self.entries.len() {
            let mut data = self.entries[from..].to_vec();
            data.resize(data.len().next_multiple_of(LIST_WIDTH), [0; 2]);
            let size = [LIST_WIDTH, data.len() / LIST_WIDTH, 1];
            write_box(context, &self.entry_texture, [0, from / LIST_WIDTH, 0], size, 8, bytemuck::cast_slice(&data));
        }
        Ok(())
    }

    /// Writes the directory of a box of bricks.
    fn write_directory(&self, context: &GpuContext, [x, y, z]: [[usize; 2]; 3]) {
        let [nx, ny, _] = self.size;
        let rows = (z[0]..z[1]).flat_map(|z| (y[0]..y[1]).map(move |y| nx * (y + ny * z)));
        let entry = |list: &List| match self.borders {
            Borders::Exact => [list.first, list.count],
            Borders::TwoLookUps => [list.first, list.slot],
        };
        let data: Vec<[u32; 2]> = rows.flat_map(|row| self.lists[row + x[0]..row + x[1]].iter().map(entry)).collect();
        let size = [x[1] - x[0], y[1] - y[0], z[1] - z[0]];
        write_box(context, &self.directory, [x[0], y[0], z[0]], size, 8, bytemuck::cast_slice(&data));
    }

    /// The borders that it was uploaded for.
    pub fn borders(&self) -> Borders {
        self.borders
    }

    /// Which of the `sets` there is around a brick.
    pub fn set_at(&self, [x, y, z]: [usize; 3]) -> u32 {
        self.set_of_brick[x + self.size[0] * (y + self.size[1] * z)]
    }

    /// Positions (x fastest) of the bricks that may have changed since an earlier revision; none where nobody remembers.
    pub fn changed_since(&self, revision: u64) -> Option<impl Iterator<Item = usize> + '_> {
        let num_revisions = usize::try_from(self.revision.checked_sub(revision)?).ok()?;
        let first = self.changes.len().checked_sub(num_revisions)?;
        Some(self.changes.range(first..).flatten().map(|brick| *brick as usize))
    }

    /// Texels of the atlas along x, y, z.
    pub fn atlas_size(&self) -> [usize; 3] {
        [ATLAS_EDGE, ATLAS_EDGE, self.atlas_depth]
    }

    /// Views of directory, entries and atlas.
    pub fn views(&self) -> [wgpu::TextureView; 3] {
        [&self.directory, &self.entry_texture, &self.atlas].map(|t| t.create_view(&Default::default()))
    }
}

/// The entries that bricks with no region around them have: labels are always looked up.
fn nowhere(borders: Borders) -> &'static [[u32; 2]] {
    match borders {
        Borders::Exact => &[],
        Borders::TwoLookUps => &[[0, 1]],
    }
}

/// What a slot holds of labels' numbers.
fn texels_of_numbers(numbers: &[u16]) -> Vec<u8> {
    numbers.iter().flat_map(|number| half::f16::from_f32(f32::from(*number)).to_le_bytes()).collect()
}

/// A slot's place in the atlas as the shader reads it: 10 bits for each axis.
fn packed(slot: u32) -> u32 {
    let n = SLOTS as u32;
    (slot % n) | ((slot / n % n) << 10) | ((slot / (n * n)) << 20)
}

fn unpacked(place: u32) -> u32 {
    let n = SLOTS as u32;
    (place & 1023) + n * (((place >> 10) & 1023) + n * (place >> 20))
}

/// A brick's place and those around it, within `size`.
fn neighbors(place: [usize; 3], size: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let range = |a: usize| place[a].saturating_sub(1)..(place[a] + 2).min(size[a]);
    let (x, y) = (range(0), range(1));
    range(2).flat_map(move |z| {
        let x = x.clone();
        y.clone().flat_map(move |y| x.clone().map(move |x| [x, y, z]))
    })
}

fn block(selection: &Selection, place: [usize; 3]) -> Block {
    let size = selection.size_in_bricks();
    let dims = selection.grid().dims();
    let around: [&Brick; 27] = std::array::from_fn(|i| {
        let offset = [i % 3, i / 3 % 3, i / 9];
        selection.brick(std::array::from_fn(|a| (place[a] + offset[a]).saturating_sub(1).min(size[a] - 1)))
    });
    if let Brick::Uniform(value) = around[13]
        && around.iter().all(|brick| matches!(brick, Brick::Uniform(v) if v == value))
    {
        return [*value; BLOCK * BLOCK * BLOCK];
    }
    // Which of the three bricks along an axis each voxel is in, and where in it.
    let along = |a: usize| -> [(usize, usize); BLOCK] {
        std::array::from_fn(|i| {
            let voxel = (place[a] * BRICK + i).saturating_sub(BORDER).min(dims[a] - 1);
            (voxel / BRICK + 1 - place[a], voxel % BRICK)
        })
    };
    let (xs, ys, zs) = (along(0), along(1), along(2));
    let mut block = [0; BLOCK * BLOCK * BLOCK];
    let mut values = block.iter_mut();
    for (bz, z) in zs {
        for (by, y) in ys {
            for ((bx, x), value) in xs.into_iter().zip(&mut values) {
                *value = around[bx + 3 * (by + 3 * bz)].get([x, y, z]);
            }
        }
    }
    block
}

/// The rows of a block that are uploaded: without its outermost voxels.
fn inner_rows(block: &Block) -> impl Iterator<Item = &[u8]> {
    let skip = (BLOCK - SLOT_EDGE) / 2;
    let rows = (skip..BLOCK - skip).flat_map(move |z| (skip..BLOCK - skip).map(move |y| BLOCK * (y + BLOCK * z)));
    rows.map(move |row| &block[row + skip..row + BLOCK - skip])
}

fn entry_texture(context: &GpuContext, rows: usize) -> Result<wgpu::Texture> {
    let (format, dimension) = (wgpu::TextureFormat::Rg32Uint, wgpu::TextureDimension::D2);
    make_texture(context, "region lists", format, [LIST_WIDTH, rows, 1], dimension)
}

fn texture(context: &GpuContext, label: &str, format: wgpu::TextureFormat, size: [usize; 3]) -> Result<wgpu::Texture> {
    make_texture(context, label, format, size, wgpu::TextureDimension::D3)
}

fn make_texture(
    context: &GpuContext,
    label: &str,
    format: wgpu::TextureFormat,
    size: [usize; 3],
    dimension: wgpu::TextureDimension,
) -> Result<wgpu::Texture> {
    let what = format!("a texture of {} x {} x {} texels for the {label}", size[0], size[1], size[2]);
    context.checked(&what, "reduce the volume, or choose another adapter", |device| {
        device.create_texture(&wgpu::TextureDescriptor {
            // A larger one takes over what it holds.
            usage: wgpu::TextureUsages::COPY_SRC | TABLE_USAGE,
            ..table_descriptor(label, extent(size), dimension, format)
        })
    })
}
