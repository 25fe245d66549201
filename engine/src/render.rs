//! From a scene to pixels: tiles on the adapter, bands of rows to whoever wants them, so that a picture of any size
//! needs the memory of a band. Tiled equals untiled bit for bit: a tile knows its place in the whole picture.

use std::time::Instant;

use crate::error::{Error, Result};
use crate::gpu::context::{GpuContext, TARGET_FORMAT};
use crate::gpu::regions::ResidentRegions;
use crate::gpu::upload::ResidentVolumes;
use crate::pass::parts::PartLists;
use crate::pass::raycast::{FrameUniform, Picture, RaycastObject, RaycastPass, ShaderPatch};
use crate::progress::Progress;
use crate::scene::{Background, Borders, Object, Scene};

/// A picture in memory: premultiplied linear RGBA, row 0 = top.
#[derive(Clone, Debug, PartialEq)]
pub struct FloatImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width × height` pixels.
    pub pixels: Vec<[f32; 4]>,
}

/// How a picture is put together; the pixels do not depend on it.
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// Largest edge of a tile in pixels. Tiles are what progress, cancellation and a driver's patience count.
    pub tile: u32,
    /// How long the adapter may work on a tile, ms: tiles are made as small as that takes, by how long others took. Not at
    /// once: the first of a picture that is harder than the last one's take longer.
    pub tile_ms: f64,
    /// Leap over empty bricks; off only in tests and measurements.
    pub skip_empty: bool,
    /// Draw only every `stride`-th pixel, across and down, from the one in the middle of the first `stride` on: a sample
    /// of the picture, of [`sampled_size`] pixels, each bit for bit the picture's.
    pub stride: u32,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self { tile: 1024, tile_ms: 60.0, skip_empty: true, stride: 1 }
    }
}

/// What a render did, for whoever wants to know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RenderReport {
    /// The pipeline key, empty for a scene without objects.
    pub pipeline: String,
    /// Sentences for the user (voxels without data).
    pub warnings: Vec<String>,
}

/// Edges of a sample of a picture of `size` pixels; see [`RenderOptions::stride`].
pub fn sampled_size(size: [u32; 2], stride: u32) -> [u32; 2] {
    // At least one, however small the picture is.
    size.map(|n| (n + stride - 1 - offset(n, stride)) / stride)
}

/// The first pixel of a sample along an edge of `n` pixels.
fn offset(n: u32, stride: u32) -> u32 {
    (stride / 2).min(n - 1)
}

/// The largest edge of a picture.
pub const MAX_IMAGE_EDGE: u32 = 65_535;

/// Renders scenes on one adapter; keeps volumes, styles and pipelines between pictures.
#[derive(Debug)]
pub struct Renderer {
    context: GpuContext,
    volumes: ResidentVolumes,
    /// Those of the object that was drawn last, for each kind of borders that it was drawn with.
    regions: [Option<ResidentRegions>; 2],
    raycast: RaycastPass,
    /// How long a pixel took of the tile that took longest, of the last picture, ms.
    pixel_ms: Option<f64>,
}

/// The smallest that tiles get for taking long.
const FEWEST_ROWS: u32 = 4;
const FEWEST_COLUMNS: u32 = 64;
/// Pixels of the first tiles of all.
const FIRST_PIXELS: f64 = 16384.0;
/// Heights are multiples of this where they are as large: what software adapters share out among processors.
const TILE_STEP: u32 = 64;
/// Bytes of a band, whatever its tiles take.
const BAND_BYTES: u64 = 64 << 20;

struct TileSlot {
    edges: [u32; 2],
    target: (wgpu::Texture, wgpu::TextureView),
    /// What rays that take more than one pass are gathered in, by turns with `target`.
    other: Option<(wgpu::Texture, wgpu::TextureView)>,
    buffer: wgpu::Buffer,
    pending: Option<Pending>,
}

/// Where a band lies in its picture.
#[derive(Clone, Copy)]
struct Place {
    /// Of the whole picture, in pixels.
    size: [u32; 2],
    /// See [`RenderOptions::stride`].
    stride: u32,
    /// Width of a tile at most, and the band's first row, in pixels of the sample.
    columns: u32,
    y: u32,
}

/// A tile that is done.
struct Drawn {
    asked: Instant,
    pixels: u32,
}

struct Pending {
    asked: Instant,
    x: u32,
    size: [u32; 2],
    mapped: std::sync::mpsc::Receiver<std::result::Result<(), wgpu::BufferAsyncError>>,
}

const BYTES_PER_PIXEL: u32 = 16;

impl Renderer {
    /// A renderer on an open adapter.
    pub fn new(context: GpuContext) -> Self {
        let raycast = RaycastPass::new(&context, None);
        Self { context, volumes: ResidentVolumes::default(), regions: Default::default(), raycast, pixel_ms: None }
    }

    /// A renderer whose shader texts go through `patch`: tests plant defects with it.
    pub fn with_patched_shaders(context: GpuContext, patch: ShaderPatch) -> Self {
        let raycast = RaycastPass::new(&context, Some(patch));
        Self { context, volumes: ResidentVolumes::default(), regions: Default::default(), raycast, pixel_ms: None }
    }

    /// The adapter that it draws with.
    pub fn context(&self) -> &GpuContext {
        &self.context
    }

    /// Draws the scene into `width × height` pixels and hands them over in bands of whole rows from top to bottom:
    /// premultiplied linear RGBA over the scene's background.
    ///
    /// # Errors
    /// [`Error::Scene`] for a scene or size without meaning, [`Error::Gpu`] for what the adapter refuses,
    /// [`Error::Cancelled`], and whatever `band` returns.
    pub fn render_bands(
        &mut self,
        scene: &Scene,
        size: [u32; 2],
        options: &RenderOptions,
        progress: &Progress,
        mut band: impl FnMut(&[[f32; 4]]) -> Result<()>,
    ) -> Result<RenderReport> {
        scene.validate()?;
        check_size(size[0], size[1])?;
        let stride = options.stride.max(1);
        let [width, height] = sampled_size(size, stride);
        let mut report = RenderReport { pipeline: String::new(), warnings: Vec::new() };
        let object = match scene.objects.first() {
            None => None,
            Some(object) => {
                let resident = self.volumes.get(&self.context, object, progress)?;
                if resident.num_gaps > 0 {
                    report.warnings.push(format!(
                        "{} of {} voxels are no number (NaN or infinite) and count as no data",
                        resident.num_gaps,
                        object.volume.grid.num_voxels()
                    ));
                }
                let borders = scene.quality.borders;
                let parts = PartLists::new(object, &scene.camera, size);
                // Rows of transfer functions and bodies have looks, which a list of no regions has room for as well.
                let needs_looks = object.has_rows() || parts.as_ref().is_some_and(|parts| parts.side_by_side);
                let regions = self.resident_regions(object, borders, needs_looks, progress)?;
                let picture = Picture { parts: parts.as_ref(), skip_empty: options.skip_empty, size, stride };
                let prepared = self.raycast.prepare(&self.context, scene, object, &resident, regions.as_ref(), picture);
                self.regions[borders as usize] = regions;
                let prepared = prepared?;
                report.pipeline = prepared.key.to_string();
                let parts = &object.parts.list;
                if !parts.is_empty() && parts.iter().all(|part| part.hidden) && object.bodies().len() == 1 {
                    report.warnings.push(format!("the picture is empty: all {} parts are hidden", parts.len()));
                } else if object.shows_nothing() {
                    let (low, high) = object.data_range();
                    let nodes = &object.transfer_function.nodes;
                    report.warnings.push(format!(
                        "the picture is empty: the transfer function shows nothing of data from {low:.6} to {high:.6} (its \
                         nodes go from {:.6} to {:.6})",
                        nodes[0].value,
                        nodes[nodes.len() - 1].value
                    ));
                }
                Some(prepared)
            }
        };
        let most = options.tile.clamp(1, self.context.device.limits().max_texture_dimension_2d);
        let most = most.min((BAND_BYTES / u64::from(width * BYTES_PER_PIXEL)).max(u64::from(FEWEST_ROWS)) as u32);
        progress.begin("rendering", u64::from(width) * u64::from(height));
        let mut slots: Vec<TileSlot> = Vec::new();
        let mut rows = Vec::new();
        let (mut y, mut slowest) = (0, 0.0f64);
        while y < height {
            let edges = self.tile_edges(options, [width.min(most), height.min(most)]);
            let num_rows = edges[1].min(height - y);
            rows.resize(width as usize * num_rows as usize, [0.0f32; 4]);
            match &object {
                None => {
                    rows.fill([0.0; 4]);
                    progress.advance(rows.len() as u64)?;
                }
                Some(object) => {
                    if slots.first().is_none_or(|slot| slot.edges != edges) {
                        // Two: one is drawn while the other is read.
                        slots = (0..2).map(|_| self.tile_slot(edges, object.num_passes > 1)).collect();
                    }
                    let frame = self.raycast.frame(scene, object, size);
                    let place = Place { size, stride, columns: edges[0], y };
                    let pixel_ms = self.draw_band(object, frame, &mut slots, place, &mut rows, progress)?;
                    slowest = slowest.max(pixel_ms);
                    self.pixel_ms = Some(pixel_ms);
                }
            }
            put_over(scene.background, &mut rows);
            band(&rows)?;
            y += num_rows;
        }
        if object.is_some() {
            self.pixel_ms = Some(slowest);
        }
        Ok(report)
    }

    /// The edges of tiles, `most` at most, that take as long as they may, if their pixels take what others took. As wide as that goes:
    /// software adapters share squares of 64 pixels out among processors.
    fn tile_edges(&self, options: &RenderOptions, most: [u32; 2]) -> [u32; 2] {
        let pixels = match self.pixel_ms {
            _ if options.tile_ms == f64::INFINITY => f64::INFINITY,
            None => FIRST_PIXELS,
            Some(pixel_ms) => options.tile_ms / pixel_ms.max(1e-9),
        };
        let rows = ((pixels / f64::from(most[0])) as u32).max(FEWEST_ROWS);
        let columns = ((pixels / f64::from(rows)) as u32).max(FEWEST_COLUMNS);
        [columns.min(most[0]), if rows > TILE_STEP { rows - rows % TILE_STEP } else { rows }.min(most[1])]
    }

    /// [`Renderer::render_bands`] into memory.
    ///
    /// # Errors
    /// As there.
    pub fn render(
        &mut self,
        scene: &Scene,
        size: [u32; 2],
        options: &RenderOptions,
        progress: &Progress,
    ) -> Result<FloatImage> {
        check_size(size[0], size[1])?;
        let [width, height] = sampled_size(size, options.stride.max(1));
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        self.render_bands(scene, size, options, progress, |band| {
            pixels.extend_from_slice(band);
            Ok(())
        })?;
        Ok(FloatImage { width, height, pixels })
    }

    /// The object's regions as they are on the adapter, brought up to date; none if it has none and needs no looks.
    fn resident_regions(
        &mut self,
        object: &Object,
        borders: Borders,
        needs_looks: bool,
        progress: &Progress,
    ) -> Result<Option<ResidentRegions>> {
        if object.regions.is_empty() && !needs_looks {
            self.regions = Default::default();
            return Ok(None);
        }
        let size = object.volume.bricks().dims;
        if let Some(mut known) = self.regions[borders as usize].take() {
            if known.update(&self.context, size, &object.regions)? {
                return Ok(Some(known));
            }
            // Another object: what it has of the other kind is of no use either.
            self.regions = Default::default();
        }
        Ok(Some(ResidentRegions::upload(&self.context, size, &object.regions, borders, progress)?))
    }

    fn tile_slot(&self, edges: [u32; 2], several_passes: bool) -> TileSlot {
        let [width, height] = edges;
        let target = || {
            self.context.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("tile"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: TARGET_FORMAT,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                    | wgpu::TextureUsages::COPY_SRC
                    | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            })
        };
        let viewed = |texture: wgpu::Texture| {
            let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
            (texture, view)
        };
        let (target, other) = (viewed(target()), several_passes.then(|| viewed(target())));
        let buffer = self.context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("tile readback"),
            size: u64::from(row_pitch(width)) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        TileSlot { edges, target, other, buffer, pending: None }
    }

    /// Draws a band. Gives back how long a pixel took of the tile that took longest, ms.
    fn draw_band(
        &self,
        object: &RaycastObject,
        frame: FrameUniform,
        slots: &mut [TileSlot],
        Place { size, stride, columns, y }: Place,
        band: &mut [[f32; 4]],
        progress: &Progress,
    ) -> Result<f64> {
        let [width, _] = sampled_size(size, stride);
        let num_slots = slots.len();
        let (mut slowest, mut free) = (0.0f64, Instant::now());
        // Tiles are drawn one after the other: one begins when it is asked for or the one before it is done.
        let mut took = |tile: Option<Drawn>| {
            let Some(Drawn { asked, pixels }) = tile else { return };
            let begun = asked.max(free);
            free = Instant::now();
            slowest = slowest.max((free - begun).as_secs_f64() * 1e3 / f64::from(pixels));
        };
        let mut next = 0;
        let rows = band.len() as u32 / width;
        for x in (0..width).step_by(columns as usize) {
            let slot = &mut slots[next];
            took(self.collect(slot, width, band, progress)?);
            let tile = [columns.min(width - x), rows];
            let first = [0, 1].map(|i| [x, y][i] * stride + offset(size[i], stride));
            let frame = frame.for_tile(first, stride);
            let asked = Instant::now();
            let mut encoder = self.context.device.create_command_encoder(&Default::default());
            self.raycast.draw(&self.context, &mut encoder, object, frame, &slot.target.1, tile, None);
            for pass in 1..object.num_passes {
                // The uniform of one pass is written over that of the one before: each is submitted by itself.
                self.context.queue.submit([encoder.finish()]);
                progress.check()?;
                encoder = self.context.device.create_command_encoder(&Default::default());
                if let Some(other) = &mut slot.other {
                    std::mem::swap(&mut slot.target, other);
                    let gathered = Some(&other.1);
                    let frame = frame.for_pass(pass);
                    self.raycast.draw(&self.context, &mut encoder, object, frame, &slot.target.1, tile, gathered);
                }
            }
            encoder.copy_texture_to_buffer(
                slot.target.0.as_image_copy(),
                wgpu::TexelCopyBufferInfo {
                    buffer: &slot.buffer,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: 0,
                        bytes_per_row: Some(row_pitch(tile[0])),
                        rows_per_image: None,
                    },
                },
                wgpu::Extent3d { width: tile[0], height: tile[1], depth_or_array_layers: 1 },
            );
            self.context.queue.submit([encoder.finish()]);
            let (sender, mapped) = std::sync::mpsc::channel();
            let bytes = u64::from(row_pitch(tile[0])) * u64::from(tile[1]);
            slot.buffer.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
                // The receiver is gone only when the picture was given up.
                let _ = sender.send(result);
            });
            slot.pending = Some(Pending { asked, x, size: tile, mapped });
            next = (next + 1) % num_slots;
        }
        // The oldest first.
        for i in 0..num_slots {
            took(self.collect(&mut slots[(next + i) % num_slots], width, band, progress)?);
        }
        Ok(slowest)
    }

    /// Waits for the tile in `slot`, if any, and copies it into its band.
    fn collect(
        &self,
        slot: &mut TileSlot,
        width: u32,
        band: &mut [[f32; 4]],
        progress: &Progress,
    ) -> Result<Option<Drawn>> {
        let Some(pending) = slot.pending.take() else { return Ok(None) };
        let lost = |why: String| Error::gpu(format!("the adapter stopped while drawing: {why}"), "try again");
        loop {
            match pending.mapped.try_recv() {
                Ok(result) => break result.map_err(|e| lost(e.to_string()))?,
                Err(std::sync::mpsc::TryRecvError::Empty) => {}
                Err(std::sync::mpsc::TryRecvError::Disconnected) => return Err(lost("no answer".to_owned())),
            }
            let poll =
                wgpu::PollType::Wait { submission_index: None, timeout: Some(std::time::Duration::from_secs(5)) };
            match self.context.device.poll(poll) {
                // OpenGL reports a timeout on work of several seconds: go on waiting.
                Ok(_) | Err(wgpu::PollError::Timeout) => {}
                Err(e) => return Err(lost(e.to_string())),
            }
        }
        let [tile_width, tile_height] = pending.size;
        let pitch = row_pitch(tile_width) as usize;
        {
            let bytes = slot
                .buffer
                .slice(..pitch as u64 * u64::from(tile_height))
                .get_mapped_range()
                .map_err(|e| lost(e.to_string()))?;
            for row in 0..tile_height as usize {
                let from = &bytes[row * pitch..][..tile_width as usize * BYTES_PER_PIXEL as usize];
                let to = &mut band[row * width as usize + pending.x as usize..][..tile_width as usize];
                bytemuck::cast_slice_mut::<_, u8>(to).copy_from_slice(from);
            }
        }
        slot.buffer.unmap();
        let pixels = tile_width * tile_height;
        progress.advance(u64::from(pixels))?;
        Ok(Some(Drawn { asked: pending.asked, pixels }))
    }
}

fn check_size(width: u32, height: u32) -> Result<()> {
    if width == 0 || height == 0 || width > MAX_IMAGE_EDGE || height > MAX_IMAGE_EDGE {
        return Err(Error::scene(
            format!("a picture of {width} x {height} pixels cannot be drawn"),
            format!("choose a size from 1 x 1 to {MAX_IMAGE_EDGE} x {MAX_IMAGE_EDGE}"),
        ));
    }
    Ok(())
}

fn row_pitch(width: u32) -> u32 {
    (width * BYTES_PER_PIXEL).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

/// Puts premultiplied pixels over a background.
pub(crate) fn put_over(background: Background, pixels: &mut [[f32; 4]]) {
    if let Background::Color(color) = background {
        for pixel in pixels {
            let through = 1.0 - pixel[3];
            *pixel = [pixel[0] + through * color[0], pixel[1] + through * color[1], pixel[2] + through * color[2], 1.0];
        }
    }
}
