//! Long-lived GPU things: the adapter, shader texts and pipelines by key, volumes that live on the adapter.

pub mod context;
mod labels;
pub mod regions;
pub mod shader_library;
pub mod upload;

pub use context::{AdapterChoice, AdapterDescription, GpuContext, list_adapters};
