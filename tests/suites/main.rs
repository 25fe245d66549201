//! The suites, in one binary: linking is what costs.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod dicom;
mod estimate;
mod extremes;
mod orientation;
mod pipelines;
mod raycast;
mod readers;
mod reference;
mod templates;
mod tidy;
