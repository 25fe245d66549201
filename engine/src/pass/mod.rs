//! Passes: what is drawn in a frame, each with its per-frame data.

pub mod bodies;
mod coverage;
mod distances;
mod may_show;
pub mod parts;
pub mod patterns;
pub mod places;
pub mod raycast;
pub mod regions;
mod row_places;
pub mod transfer_table;
