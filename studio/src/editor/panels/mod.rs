//! The panels: each shows a part of the open figure and edits it through commands.

pub mod curve;
pub mod function_map;
mod histogram;
pub mod history;
mod lighting;
pub mod moves;
mod noise;
pub mod objects;
pub mod plot;
pub mod properties;
pub mod regions;
mod shading;
pub mod start_page;
mod strength;
pub mod style_settings;
pub mod styles;
pub mod transfer_function;
