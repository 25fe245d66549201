//! The suites, in one binary: linking is what costs.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod borders;
mod colors;
mod contours;
mod dicom;
mod estimate;
mod extremes;
mod hostile;
mod labels;
mod lighting;
mod moved;
mod orientation;
mod parts;
mod patterns;
mod pipelines;
mod raycast;
mod readers;
mod reference;
mod regions;
mod rows;
mod shimmer;
mod templates;
mod tidy;
