//! Fabrica's studio: the document and its templates, and the `fabrica` program as a library
//! (`main` only hands over the arguments, so that everything is testable without a process).

pub mod cli;
pub mod editor;
pub mod figure;
mod memory;
