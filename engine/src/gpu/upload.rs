//! Volumes on the adapter: encoding, 3-D textures, the prefiltered copy.

use std::sync::Arc;

use glam::DMat3;
use rayon::prelude::*;

use super::context::GpuContext;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::scene::Object;
use crate::volume::no_data::fill_no_data;
use crate::volume::prefilter::{Prefilter, Source};
use crate::volume::{Volume, Voxel, Voxels};
use crate::with_voxels;

/// texel = (stored − offset) × scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoding {
    /// In stored numbers.
    pub offset: f64,
    /// Texel units per stored number, positive.
    pub scale: f64,
}

impl Encoding {
    /// The texel value of a stored number.
    pub fn texel(self, stored: f64) -> f64 {
        (stored - self.offset) * self.scale
    }
}

/// A volume's textures, with what the CPU side needs to use them.
#[derive(Debug)]
pub struct ResidentVolume {
    /// Trilinear source of opacity.
    pub values: wgpu::TextureView,
    /// Encoding of `values`.
    pub encoding: Encoding,
    /// ĝ in the world, in units of 1/[`GRADIENT_UNIT`]; or what it is differences of: the prefiltered copy of the values (of the colors,
    /// if there are any), or these again where σ_g = 0.
    pub gradients: wgpu::TextureView,
    /// Encoding of `gradients` that are not texels of ĝ.
    pub gradient_encoding: Option<Encoding>,
    /// Premultiplied linear RGBA of a volume of colors. Every adapter filters it, and its gradients.
    pub colors: Option<wgpu::TextureView>,
    /// Whether some of them are not opaque.
    pub alpha: bool,
    /// 1 where a voxel has data; absent where all have.
    pub validity: Option<wgpu::TextureView>,
    /// Whether the adapter filters these formats.
    pub filtered: bool,
    /// G: ‖g‖ (data units per mm) that counts as a full edge.
    pub gradient_max: f64,
    /// Voxels that are no number.
    pub num_gaps: usize,
}

/// What a texel has of a ĝ of 1 (`GRADIENT_PER_TEXEL` of `shaders/lib/gradient_texel.wgsl`): half floats keep eleven bits of gradients
/// from a millionth of G to a thousand times as much.
pub const GRADIENT_UNIT: f64 = 64.0;

/// The largest half float.
const MAX_HALF: f32 = 65504.0;

/// Bytes handed to the driver at a time: the staging copy stays small against the volume.
const SLAB_BYTES: usize = 8 << 20;

#[derive(Clone, Copy, PartialEq)]
enum Texel {
    Unorm16,
    Float32,
    ColorUnorm16,
    ColorFloat16,
    ColorFloat32,
}

impl Texel {
    fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::Unorm16 => wgpu::TextureFormat::R16Unorm,
            Self::Float32 => wgpu::TextureFormat::R32Float,
            Self::ColorUnorm16 => wgpu::TextureFormat::Rgba16Unorm,
            Self::ColorFloat16 => wgpu::TextureFormat::Rgba16Float,
            Self::ColorFloat32 => wgpu::TextureFormat::Rgba32Float,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::Unorm16 => 2,
            Self::Float32 => 4,
            Self::ColorUnorm16 | Self::ColorFloat16 => 8,
            Self::ColorFloat32 => 16,
        }
    }

    /// Texels of numbers that are theirs already: 0 … 1 for the integers.
    fn pack(self, numbers: &[f32]) -> Vec<u8> {
        match self {
            Self::Float32 | Self::ColorFloat32 => bytemuck::cast_slice(numbers).to_vec(),
            Self::Unorm16 | Self::ColorUnorm16 => {
                let codes: Vec<u16> = numbers.par_iter().map(|v| (v * 65535.0 + 0.5) as u16).collect();
                bytemuck::cast_slice(&codes).to_vec()
            }
            Self::ColorFloat16 => {
                let halves: Vec<half::f16> = numbers.par_iter().map(|v| half::f16::from_f32(*v)).collect();
                bytemuck::cast_slice(&halves).to_vec()
            }
        }
    }
}

impl ResidentVolume {
    /// Uploads an object's volume and its prefiltered copy.
    ///
    /// # Errors
    /// [`Error::Gpu`] for a volume over the adapter's limits, naming the limit; [`Error::Cancelled`].
    pub fn upload(context: &GpuContext, object: &Object, progress: &Progress) -> Result<Self> {
        let volume = &object.volume;
        let dims = volume.grid.dims();
        check_limits(context, volume)?;
        let filled = fill_no_data(volume);
        let voxels = filled.voxels.as_ref();
        let range = volume.bricks().range();
        let (texel, encoding) = choose_encoding(context, voxels, range);
        let values_texel = texel;

        let sigma = sigma_voxels(volume, object.gradient_scale_mm);
        let prefiltered = sigma.iter().any(|s| *s > 0.0);
        let num_gradient_bytes = (volume.grid.num_voxels() * Texel::ColorFloat16.bytes()) as u64;
        let may_have_texels = volume.colors.is_none() && num_gradient_bytes <= context.formats.gradient_bytes;
        // Where there is no room for them, gradients are taken from what is there.
        let texels =
            may_have_texels.then(|| create_texture(context, "gradients", dims, Texel::ColorFloat16).ok()).flatten();
        let extras = [prefiltered || texels.is_some(), volume.colors.is_some(), filled.valid.is_some()];
        let num_copies = 1 + extras.into_iter().map(u64::from).sum::<u64>();
        progress.begin("uploading", num_copies * dims[2] as u64);

        let values = make_texture(context, "volume", dims, texel)?;
        write_slabs(context, &values, dims, texel, progress, |z0, z1| {
            let plane = dims[0] * dims[1];
            encode(voxels, z0 * plane..z1 * plane, encoding, texel)
        })?;
        let values = values.create_view(&wgpu::TextureViewDescriptor::default());

        let [color_texel, smoothed_texel] = color_texels(context);
        let colors = match &volume.colors {
            None => None,
            Some(colors) => {
                let source = Source::Colors(colors);
                Some(smoothed_texture(context, "colors", source, dims, [0.0; 3], color_texel, progress)?)
            }
        };
        // As numbers of about 1, in which f32 resolves small differences; but next to outliers only scaled.
        let span = if range.1 > range.0 { range.1 - range.0 } else { 1.0 };
        let smoothed_encoding = match values_texel {
            Texel::Unorm16 => Encoding { offset: range.0, scale: 1.0 / span },
            _ => encoding,
        };
        let (gradients, gradient_encoding) = match (&volume.colors, &colors) {
            _ if let Some(texture) = &texels => {
                let Encoding { offset, scale } = smoothed_encoding;
                let source = Source::Values { voxels, offset, scale };
                let filter = Prefilter::new(source, dims, sigma);
                let per_difference = 0.5 * volume.rescale.slope / (scale * volume.gradient_max());
                let to_texel = volume.grid.world_gradient_from_index() * (per_difference * GRADIENT_UNIT);
                write_gradients(context, texture, filter, dims, to_texel, progress)?;
                (texture.create_view(&wgpu::TextureViewDescriptor::default()), None)
            }
            (Some(source), Some(colors)) => {
                let gradients = if prefiltered {
                    let source = Source::Colors(source);
                    smoothed_texture(context, "gradient volume", source, dims, sigma, smoothed_texel, progress)?
                } else {
                    colors.clone()
                };
                // Linear light is data as it is: a luminance of 1 is a texel of 1.
                (gradients, Some(Encoding { offset: 0.0, scale: volume.rescale.slope }))
            }
            _ if prefiltered => {
                // In f32 where that can be filtered: 16 bits, even of the data's own range, turn the normals of gentle slopes,
                // which a style with fine lines shows (1.2 codes where f32 has 0.1).
                let texel = if context.formats.r32_filterable { Texel::Float32 } else { texel };
                let encoding = smoothed_encoding;
                let source = Source::Values { voxels, offset: encoding.offset, scale: encoding.scale };
                (smoothed_texture(context, "gradient volume", source, dims, sigma, texel, progress)?, Some(encoding))
            }
            _ => (values.clone(), Some(encoding)),
        };

        let validity = match &filled.valid {
            None => None,
            Some(valid) => {
                let texture = make_texture(context, "validity", dims, texel)?;
                let plane = dims[0] * dims[1];
                write_slabs(context, &texture, dims, texel, progress, |z0, z1| {
                    let slab = &valid[z0 * plane..z1 * plane];
                    texel.pack(&slab.iter().map(|v| f32::from(*v) / 255.0).collect::<Vec<f32>>())
                })?;
                Some(texture.create_view(&wgpu::TextureViewDescriptor::default()))
            }
        };
        Ok(Self {
            values,
            encoding,
            gradients,
            gradient_encoding,
            colors,
            alpha: volume.colors.as_ref().is_some_and(|colors| colors.par_iter().any(|c| c[3] < 255)),
            validity,
            filtered: texel == Texel::Unorm16 || context.formats.r32_filterable,
            gradient_max: volume.gradient_max(),
            num_gaps: filled.num_gaps(),
        })
    }
}

/// A texture of what is smoothed by Gaussians of `sigma` voxels, made slab by slab.
fn smoothed_texture(
    context: &GpuContext,
    label: &str,
    source: Source<'_>,
    dims: [usize; 3],
    sigma: [f64; 3],
    texel: Texel,
    progress: &Progress,
) -> Result<wgpu::TextureView> {
    let mut filter = Prefilter::new(source, dims, sigma);
    let texture = make_texture(context, label, dims, texel)?;
    write_slabs(context, &texture, dims, texel, progress, |z0, z1| texel.pack(&filter.slab(z0, z1)))?;
    Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
}

/// Writes the gradients of what a filter makes, a voxel's central differences each, taken to texels by `to_texel`. At the edge they
/// are one-sided, still over two voxels.
fn write_gradients(
    context: &GpuContext,
    texture: &wgpu::Texture,
    mut filter: Prefilter<'_>,
    dims: [usize; 3],
    to_texel: DMat3,
    progress: &Progress,
) -> Result<()> {
    write_slabs(context, texture, dims, Texel::ColorFloat16, progress, |z0, z1| {
        let from = z0.saturating_sub(1);
        let values = filter.slab(from, (z1 + 1).min(dims[2]));
        bytemuck::cast_slice(&gradient_texels(&values, from, dims, z0..z1, to_texel)).to_vec()
    })
}

/// Texels of the gradients in the planes `z`, given the values of whole planes from plane `from` on, one beyond `z` on either side
/// where there is one.
fn gradient_texels(
    values: &[f32],
    from: usize,
    dims: [usize; 3],
    z: std::ops::Range<usize>,
    to_texel: DMat3,
) -> Vec<[half::f16; 4]> {
    let [nx, ny, nz] = dims;
    let to_texel = to_texel.as_mat3();
    let row = |y: usize, z: usize| &values[nx * (y + ny * (z - from))..][..nx];
    let mut texels = vec![[half::f16::ZERO; 4]; nx * ny * z.len()];
    texels.par_chunks_mut(nx).enumerate().for_each(|(i, out)| {
        let (y, z) = (i % ny, z.start + i / ny);
        let own = row(y, z);
        let [above, below] = [row((y + 1).min(ny - 1), z), row(y.saturating_sub(1), z)];
        let [behind, before] = [row(y, (z + 1).min(nz - 1)), row(y, z.saturating_sub(1))];
        for (x, texel) in out.iter_mut().enumerate() {
            let along_x = own[(x + 1).min(nx - 1)] - own[x.saturating_sub(1)];
            let gradient = to_texel * glam::Vec3::new(along_x, above[x] - below[x], behind[x] - before[x]);
            // Beyond what half floats hold only the direction counts.
            let largest = gradient.abs().max_element();
            let fitting = if largest > MAX_HALF { gradient * (MAX_HALF / largest) } else { gradient };
            *texel = fitting.extend(0.0).to_array().map(half::f16::from_f32);
        }
    });
    texels
}

/// How colors are kept, and how smoothed ones are, of which small differences count. Not as the file's 8 bits, which not every
/// adapter filters with more than 8, and which cannot be premultiplied. 16 bits of linear light are as good as f32 at half its size
/// (0.03 codes in hatching, at most); the 11 bits of half floats cost normals 0.6.
fn color_texels(context: &GpuContext) -> [Texel; 2] {
    let formats = context.formats;
    match (formats.rgba16_filterable, formats.r32_filterable) {
        (true, _) => [Texel::ColorUnorm16; 2],
        (false, true) => [Texel::ColorFloat16, Texel::ColorFloat32],
        (false, false) => [Texel::ColorFloat16; 2],
    }
}

/// σ_g in voxels along each index axis.
pub fn sigma_voxels(volume: &Volume, sigma_mm: f64) -> [f64; 3] {
    (glam::DVec3::splat(sigma_mm) / volume.grid.spacing_mm()).to_array()
}

fn check_limits(context: &GpuContext, volume: &Volume) -> Result<()> {
    let dims = volume.grid.dims();
    let edge = context.adapter.max_volume_edge as usize;
    if dims.iter().any(|n| *n > edge) {
        return Err(Error::gpu(
            format!(
                "the volume has {} x {} x {} voxels and the adapter {} takes 3-D textures of at most {edge} along an axis",
                dims[0], dims[1], dims[2], context.adapter.name
            ),
            "crop or downsample it, or choose another adapter",
        ));
    }
    Ok(())
}

/// Integers of up to 16 bits become 16-bit texels over their type's full range: exact. Wider integers that span
/// no more than 65 535 do as well. Everything else is float.
fn choose_encoding(context: &GpuContext, voxels: &Voxels, range: (f64, f64)) -> (Texel, Encoding) {
    let unorm = |offset: f64| (Texel::Unorm16, Encoding { offset, scale: 1.0 / 65535.0 });
    let (texel, encoding) = match voxels {
        Voxels::U8(_) => (Texel::Unorm16, Encoding { offset: 0.0, scale: 1.0 / 255.0 }),
        Voxels::I8(_) => (Texel::Unorm16, Encoding { offset: f64::from(i8::MIN), scale: 1.0 / 255.0 }),
        Voxels::U16(_) => unorm(0.0),
        Voxels::I16(_) => unorm(f64::from(i16::MIN)),
        Voxels::U32(_) | Voxels::I32(_) if range.1 - range.0 <= 65535.0 => unorm(range.0),
        // 64-bit integers beyond 2⁵³ are rounded by f64 already; near 0 they are as exact as the others.
        Voxels::U64(_) | Voxels::I64(_)
            if range.1 - range.0 <= 65535.0 && range.0.abs().max(range.1.abs()) < 2f64.powi(53) =>
        {
            unorm(range.0)
        }
        _ => {
            // Only a scale, so that f32's relative precision is kept next to outliers of 1e30, unless all values
            // sit far from 0 and close together.
            let largest = range.0.abs().max(range.1.abs());
            let (span, middle) = (range.1 - range.0, 0.5 * range.0 + 0.5 * range.1);
            let offset = if span < 1e-2 * middle.abs() { middle } else { 0.0 };
            let size = if offset == 0.0 { largest } else { span };
            let scale = if size > 0.0 && (1.0 / size).is_finite() { 1.0 / size } else { 1.0 };
            (Texel::Float32, Encoding { offset, scale })
        }
    };
    if texel == Texel::Unorm16 && !context.formats.r16_filterable {
        (Texel::Float32, encoding)
    } else {
        (texel, encoding)
    }
}

fn encode(voxels: &Voxels, part: std::ops::Range<usize>, encoding: Encoding, texel: Texel) -> Vec<u8> {
    if texel == Texel::Float32 {
        return with_voxels!(voxels, v => {
            let texels: Vec<f32> =
                v[part].par_iter().map(|s| encoding.texel(s.to_f64()) as f32).collect();
            bytemuck::cast_slice(&texels).to_vec()
        });
    }
    let codes: Vec<u16> = match voxels {
        Voxels::U8(v) => v[part].par_iter().map(|s| u16::from(*s) * 257).collect(),
        Voxels::I8(v) => v[part].par_iter().map(|s| (i16::from(*s) + 128) as u16 * 257).collect(),
        Voxels::U16(v) => return bytemuck::cast_slice(&v[part]).to_vec(),
        Voxels::I16(v) => v[part].par_iter().map(|s| (*s as u16) ^ 0x8000).collect(),
        wide => with_voxels!(wide, v => {
            v[part].par_iter().map(|s| (encoding.texel(s.to_f64()) * 65535.0 + 0.5) as u16).collect()
        }),
    };
    bytemuck::cast_slice(&codes).to_vec()
}

/// Size of a texture in GiB.
fn gib(dims: [usize; 3], texel: Texel) -> f64 {
    (dims[0] * dims[1] * dims[2] * texel.bytes()) as f64 / f64::from(1 << 30)
}

fn create_texture(context: &GpuContext, label: &str, dims: [usize; 3], texel: Texel) -> Result<wgpu::Texture> {
    let [x, y, z] = dims;
    let what = format!("a 3-D texture of {x} x {y} x {z} texels ({:.1} GiB) for the {label}", gib(dims, texel));
    context.checked(&what, "crop or downsample the volume, or choose another adapter", |device| {
        device.create_texture(&table_descriptor(label, extent(dims), wgpu::TextureDimension::D3, texel.format()))
    })
}

fn make_texture(context: &GpuContext, label: &str, dims: [usize; 3], texel: Texel) -> Result<wgpu::Texture> {
    let create = |planes: usize| create_texture(context, label, [dims[0], dims[1], planes], texel);
    create(dims[2]).map_err(|refused| {
        // wgpu does not tell the limit in bytes; what the driver grants does.
        let (mut granted, mut too_many) = (0, dims[2]);
        while too_many - granted > 1 + dims[2] / 64 {
            let middle = granted.midpoint(too_many);
            if let Ok(texture) = create(middle) {
                texture.destroy();
                granted = middle;
            } else {
                too_many = middle;
            }
        }
        let reason = refused.to_string();
        let reason = reason.split_once("; ").map_or(reason.as_str(), |(what, _)| what);
        Error::gpu(
            format!(
                "{reason}; it grants about {granted} slices of that size ({:.1} GiB) at present",
                gib([dims[0], dims[1], granted], texel)
            ),
            "crop or downsample the volume, or choose another adapter",
        )
    })
}

pub(crate) fn extent(dims: [usize; 3]) -> wgpu::Extent3d {
    wgpu::Extent3d { width: dims[0] as u32, height: dims[1] as u32, depth_or_array_layers: dims[2] as u32 }
}

/// What shaders read and the CPU writes.
pub(crate) const TABLE_USAGE: wgpu::TextureUsages =
    wgpu::TextureUsages::TEXTURE_BINDING.union(wgpu::TextureUsages::COPY_DST);

/// A texture of such a use, without mips.
pub(crate) fn table_descriptor(
    label: &str,
    size: wgpu::Extent3d,
    dimension: wgpu::TextureDimension,
    format: wgpu::TextureFormat,
) -> wgpu::TextureDescriptor<'_> {
    wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension,
        format,
        usage: TABLE_USAGE,
        view_formats: &[],
    }
}

/// Writes a box of `size` texels of `texel` bytes each, x fastest, from `origin` on.
pub(crate) fn write_box(
    context: &GpuContext,
    texture: &wgpu::Texture,
    origin: [usize; 3],
    size: [usize; 3],
    texel: usize,
    data: &[u8],
) {
    context.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x: origin[0] as u32, y: origin[1] as u32, z: origin[2] as u32 },
            aspect: wgpu::TextureAspect::All,
        },
        data,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some((size[0] * texel) as u32),
            rows_per_image: Some(size[1] as u32),
        },
        extent(size),
    );
}

fn write_slabs(
    context: &GpuContext,
    texture: &wgpu::Texture,
    dims: [usize; 3],
    texel: Texel,
    progress: &Progress,
    mut slab: impl FnMut(usize, usize) -> Vec<u8>,
) -> Result<()> {
    let row = dims[0] * texel.bytes();
    let planes = (SLAB_BYTES / (row * dims[1])).max(1);
    for z0 in (0..dims[2]).step_by(planes) {
        let z1 = (z0 + planes).min(dims[2]);
        write_box(context, texture, [0, 0, z0], [dims[0], dims[1], z1 - z0], texel.bytes(), &slab(z0, z1));
        // Submitting and waiting frees the staging copy before the next one is made.
        context.queue.submit([]);
        context
            .device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| Error::gpu(format!("the adapter stopped while a volume was uploaded: {e}"), "try again"))?;
        progress.advance((z1 - z0) as u64)?;
    }
    Ok(())
}

/// Volumes that are on the adapter already, so that a new camera or transfer function uploads nothing.
#[derive(Debug, Default)]
pub struct ResidentVolumes(Vec<(std::sync::Weak<Volume>, f64, Arc<ResidentVolume>)>);

impl ResidentVolumes {
    /// The object's volume, uploaded if need be. Volumes that nobody holds any more are let go.
    ///
    /// # Errors
    /// As [`ResidentVolume::upload`].
    pub fn get(&mut self, context: &GpuContext, object: &Object, progress: &Progress) -> Result<Arc<ResidentVolume>> {
        self.0.retain(|(volume, ..)| volume.strong_count() > 0);
        let found = self
            .0
            .iter()
            .find(|(v, sigma, _)| std::ptr::eq(v.as_ptr(), &*object.volume) && *sigma == object.gradient_scale_mm);
        if let Some((.., resident)) = found {
            return Ok(resident.clone());
        }
        let resident = Arc::new(ResidentVolume::upload(context, object, progress)?);
        self.0.push((Arc::downgrade(&object.volume), object.gradient_scale_mm, resident.clone()));
        Ok(resident)
    }
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::read::Entry;
    use crate::read::window::Window;
    use crate::spaces::Grid;
    use crate::volume::Modality;

    #[test]
    fn what_is_said_to_be_taken_is_what_the_textures_take() {
        let small = Texel::Unorm16.bytes() + Texel::ColorFloat16.bytes();
        let wide = Texel::Float32.bytes() + Texel::ColorFloat16.bytes();
        let colors = Texel::Unorm16.bytes() + 2 * Texel::ColorUnorm16.bytes();
        for (type_name, bytes) in
            [("uint8", small), ("int16", small), ("float32", wide), ("int64", wide), ("rgba", colors)]
        {
            let entry = Entry {
                key: String::new(),
                title: String::new(),
                format: String::new(),
                modality: Modality::Unknown,
                grid: Grid::new([2, 3, 4], DAffine3::IDENTITY).unwrap(),
                orientation: crate::volume::Orientation::Stated,
                type_name,
                bytes_per_voxel: 1,
                num_frames: 1,
                num_files: 1,
                is_labels: false,
                is_localizer: false,
            };
            let whole = Window::default().on(std::path::Path::new("a"), [2, 3, 4]).unwrap();
            assert_eq!(entry.cost(&whole).adapter, 24 * bytes as u64, "{type_name}");
        }
    }
}
