//! Passes: what is drawn in a frame, each with its per-frame data.

pub mod bodies;
pub mod patterns;
pub mod places;
pub mod raycast;
pub mod regions;
pub mod transfer_table;
