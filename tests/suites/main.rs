//! The suites, in one binary: linking is what costs.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod colors;
mod estimate;
mod extremes;
mod labels;
mod orientation;
mod pipelines;
mod raycast;
mod readers;
mod reference;
mod templates;
mod tidy;
