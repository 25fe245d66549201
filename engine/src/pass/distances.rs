//! Fields of distances on the adapter, which transfer functions' second coordinates go by.

use std::sync::Arc;

use super::raycast::small_texture;
use crate::gpu::context::GpuContext;
use crate::gpu::upload::extent;
use crate::scene::Object;
use crate::selection::DistanceField;

/// The fields of the object that was drawn last.
#[derive(Debug, Default)]
pub struct Distances(Option<(Vec<Arc<DistanceField>>, wgpu::TextureView)>);

impl Distances {
    /// A texture of an object's fields, a channel each, on the cells of the first; of one texel, if there is none.
    pub fn get(&mut self, context: &GpuContext, object: &Object) -> wgpu::TextureView {
        let fields = &object.distances;
        if let Some((known, view)) = &self.0
            && known.len() == fields.len()
            && known.iter().zip(fields).all(|(a, b)| Arc::ptr_eq(a, b))
        {
            return view.clone();
        }
        // All are made alike on one grid.
        let dims = fields.first().map_or([1; 3], |field| field.dims());
        let (format, channels) = match fields.len() {
            0 | 1 => (wgpu::TextureFormat::R16Float, 1),
            2 => (wgpu::TextureFormat::Rg16Float, 2),
            _ => (wgpu::TextureFormat::Rgba16Float, 4),
        };
        let mut texels = vec![half::f16::ZERO; channels * dims.iter().product::<usize>()];
        for (channel, field) in fields.iter().enumerate() {
            let own = texels.iter_mut().skip(channel).step_by(channels);
            own.zip(field.values()).for_each(|(texel, mm)| *texel = *mm);
        }
        let bytes = bytemuck::cast_slice(&texels);
        let texture = small_texture(context, "distances", extent(dims), wgpu::TextureDimension::D3, format, bytes);
        let view = texture.create_view(&Default::default());
        self.0 = Some((fields.clone(), view.clone()));
        view
    }
}
