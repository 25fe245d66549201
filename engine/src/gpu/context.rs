//! Which adapter draws, and what it can do. wgpu is asked, never the files of a driver.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{Error, Result};

/// What the user wants to draw with.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// Hardware if there is any, else software.
    #[default]
    Auto,
    /// A CPU implementation (Mesa's llvmpipe, WARP): slower, the same on every machine.
    Software,
    /// A real GPU or nothing.
    Hardware,
    /// The first adapter whose name contains this text, whatever its case.
    Named(String),
}

impl std::str::FromStr for AdapterChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        Ok(match text {
            "auto" => Self::Auto,
            "software" => Self::Software,
            "hardware" => Self::Hardware,
            name => Self::Named(name.to_owned()),
        })
    }
}

/// An adapter as `fabrica adapters` lists it.
#[derive(Clone, Debug, serde::Serialize)]
pub struct AdapterDescription {
    /// The driver's name of the device.
    pub name: String,
    /// "vulkan", "metal", "dx12", "gl".
    pub backend: String,
    /// "software", "discrete", "integrated", "virtual", "other".
    pub kind: String,
    /// Driver and its version.
    pub driver: String,
    /// Largest edge of a 3-D texture in texels.
    pub max_volume_edge: u32,
    /// Whether 16-bit volumes are kept as 16-bit textures and filtered by the adapter.
    pub filters_16_bit: bool,
    /// Whether 32-bit float volumes are filtered by the adapter (otherwise by eight loads).
    pub filters_float: bool,
}

/// How voxels are kept on the adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VolumeFormats {
    /// R16Unorm can be created and filtered.
    pub r16_filterable: bool,
    /// Rgba16Unorm can be created and filtered.
    pub rgba16_filterable: bool,
    /// R32Float (and so Rgba32Float) can be filtered.
    pub r32_filterable: bool,
    /// The most bytes that gradients may take as texels of their own; those of larger volumes are differences of samples.
    pub gradient_bytes: u64,
}

/// A device with its queue.
#[derive(Debug)]
pub struct GpuContext {
    /// Creates resources.
    pub device: wgpu::Device,
    /// Takes work.
    pub queue: wgpu::Queue,
    /// What was chosen.
    pub adapter: AdapterDescription,
    /// What it can filter.
    pub formats: VolumeFormats,
    lost: Arc<AtomicBool>,
}

/// Format of what passes draw: premultiplied linear, f32.
pub const TARGET_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// What is wrong and what to do where wgpu finds nothing that can draw.
pub const NO_ADAPTER: (&str, &str) = (
    "there is no graphics adapter that can draw",
    "install a Vulkan driver (Debian, Ubuntu: apt install mesa-vulkan-drivers; macOS and Windows have theirs)",
);

/// 512 voxels along each edge. Software adapters have no textures larger than that.
pub(crate) const MOST_GRADIENT_BYTES: u64 = 1 << 30;

const OPTIONAL_FEATURES: wgpu::Features =
    wgpu::Features::TEXTURE_FORMAT_16BIT_NORM.union(wgpu::Features::FLOAT32_FILTERABLE);

fn enumerate(backends: wgpu::Backends) -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    let instance = wgpu::Instance::new(descriptor);
    let mut adapters = pollster::block_on(instance.enumerate_adapters(backends));
    // An adapter that cannot draw into f32 pixels (OpenGL in wgpu 30) cannot draw our pictures.
    adapters.retain(|a| {
        let target = a.get_texture_format_features(TARGET_FORMAT);
        target.allowed_usages.contains(wgpu::TextureUsages::RENDER_ATTACHMENT)
    });
    adapters
}

/// Every adapter that wgpu finds, the native interfaces first, OpenGL last.
fn all_adapters() -> Vec<wgpu::Adapter> {
    let mut adapters = enumerate(wgpu::Backends::PRIMARY);
    adapters.extend(enumerate(wgpu::Backends::GL));
    adapters
}

/// Describes every adapter that wgpu finds; empty where there is none.
pub fn list_adapters() -> Vec<AdapterDescription> {
    all_adapters().iter().map(|a| describe(a, formats_of(a))).collect()
}

fn formats_of(adapter: &wgpu::Adapter) -> VolumeFormats {
    let filterable = |format| {
        adapter.get_texture_format_features(format).flags.contains(wgpu::TextureFormatFeatureFlags::FILTERABLE)
    };
    let features = adapter.features();
    VolumeFormats {
        r16_filterable: features.contains(wgpu::Features::TEXTURE_FORMAT_16BIT_NORM)
            && filterable(wgpu::TextureFormat::R16Unorm),
        rgba16_filterable: features.contains(wgpu::Features::TEXTURE_FORMAT_16BIT_NORM)
            && filterable(wgpu::TextureFormat::Rgba16Unorm),
        r32_filterable: features.contains(wgpu::Features::FLOAT32_FILTERABLE)
            && filterable(wgpu::TextureFormat::R32Float),
        gradient_bytes: MOST_GRADIENT_BYTES,
    }
}

fn describe(adapter: &wgpu::Adapter, formats: VolumeFormats) -> AdapterDescription {
    let info = adapter.get_info();
    let kind = match info.device_type {
        wgpu::DeviceType::Cpu => "software",
        wgpu::DeviceType::DiscreteGpu => "discrete",
        wgpu::DeviceType::IntegratedGpu => "integrated",
        wgpu::DeviceType::VirtualGpu => "virtual",
        // Mesa's OpenGL does not say that it runs on the CPU.
        wgpu::DeviceType::Other if info.name.contains("llvmpipe") => "software",
        wgpu::DeviceType::Other => "other",
    };
    AdapterDescription {
        name: info.name,
        backend: info.backend.to_string(),
        kind: kind.to_owned(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        max_volume_edge: adapter.limits().max_texture_dimension_3d,
        filters_16_bit: formats.r16_filterable,
        filters_float: formats.r32_filterable,
    }
}

fn fits(choice: &AdapterChoice, adapter: &AdapterDescription) -> bool {
    match choice {
        AdapterChoice::Auto => true,
        AdapterChoice::Software => adapter.kind == "software",
        AdapterChoice::Hardware => adapter.kind != "software",
        AdapterChoice::Named(name) => adapter.name.to_lowercase().contains(&name.to_lowercase()),
    }
}

impl GpuContext {
    /// Opens the adapter of choice.
    ///
    /// # Errors
    /// [`Error::Gpu`] where none fits (with the list of those that exist) or the driver gives no device.
    pub fn new(choice: &AdapterChoice) -> Result<Self> {
        // The native interfaces first, and OpenGL only where they have nothing that fits: starting it takes time.
        let mut seen = Vec::new();
        for backends in [wgpu::Backends::PRIMARY, wgpu::Backends::GL] {
            let mut candidates: Vec<_> = enumerate(backends)
                .into_iter()
                .map(|a| (describe(&a, formats_of(&a)), a))
                .inspect(|(d, _)| seen.push(format!("{} ({}, {})", d.name, d.backend, d.kind)))
                .filter(|(d, _)| fits(choice, d))
                .collect();
            let rank = |kind: &str| ["discrete", "integrated", "virtual", "other"].iter().position(|k| *k == kind);
            candidates.sort_by_key(|(d, _)| rank(&d.kind).unwrap_or(usize::MAX));
            if let Some((description, adapter)) = candidates.into_iter().next() {
                return Self::open(&adapter, description);
            }
        }
        if seen.is_empty() {
            return Err(Error::gpu(NO_ADAPTER.0, NO_ADAPTER.1));
        }
        Err(Error::gpu(
            match choice {
                AdapterChoice::Named(name) => format!("no graphics adapter is called \"{name}\""),
                AdapterChoice::Software => "there is no software adapter".to_owned(),
                _ => "there is no hardware adapter".to_owned(),
            },
            format!("choose one of: {}", seen.join(", ")),
        ))
    }

    fn open(adapter: &wgpu::Adapter, description: AdapterDescription) -> Result<Self> {
        let request = wgpu::DeviceDescriptor {
            label: Some("fabrica"),
            required_features: adapter.features() & OPTIONAL_FEATURES,
            required_limits: adapter.limits(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&request)).map_err(|e| {
            Error::gpu(
                format!("the adapter {} gives no device: {e}", description.name),
                "update its driver or choose another adapter",
            )
        })?;
        let lost = Arc::new(AtomicBool::new(false));
        let flag = lost.clone();
        device.set_device_lost_callback(move |_, _| flag.store(true, Ordering::Relaxed));
        Ok(Self { device, queue, formats: formats_of(adapter), adapter: description, lost })
    }

    /// Whether the device is gone (a driver's reset, a sleeping laptop): nothing works with it any more, a new context may.
    pub fn is_lost(&self) -> bool {
        // What was lost is told when the device is asked how it is.
        let _ = self.device.poll(wgpu::PollType::Poll);
        self.lost.load(Ordering::Relaxed)
    }

    /// The same context made to believe that the adapter filters less than it does: tests force the slower paths.
    #[must_use]
    pub fn with_formats(mut self, formats: VolumeFormats) -> Self {
        self.formats = formats;
        self
    }

    /// Runs `create`, turning what the driver refuses (memory, limits) into an error that says what it was for.
    ///
    /// # Errors
    /// [`Error::Gpu`] with the driver's reason.
    pub fn checked<T>(&self, what: &str, remedy: &str, create: impl FnOnce(&wgpu::Device) -> T) -> Result<T> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let made = create(&self.device);
        let faults = [
            pollster::block_on(internal.pop()),
            pollster::block_on(validation.pop()),
            pollster::block_on(memory.pop()),
        ];
        match faults.into_iter().flatten().next() {
            None => Ok(made),
            Some(fault) => {
                let reason = fault.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
                Err(Error::gpu(format!("the adapter {} refuses {what}: {reason}", self.adapter.name), remedy))
            }
        }
    }
}
