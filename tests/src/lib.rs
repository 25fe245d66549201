//! What the suites share: data files, small volumes, the software adapter, picture comparison.

pub mod compare;
pub mod phantom;
pub mod twin;

use std::path::{Path, PathBuf};

use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::render::Renderer;

/// A file of the test data (`FABRICA_TEST_DATA`, else `../shared/data` beside the checkout), or None where it is not
/// there: the test then counts as skipped, under its name, in the summary of `./test`.
pub fn data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("FABRICA_TEST_DATA").map_or_else(|| checkout().join("../shared/data"), PathBuf::from);
    let file = folder.join(name);
    if file.exists() {
        return Some(file);
    }
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    eprintln!("skipped: {test} needs {name}");
    if let Some(list) = std::env::var_os("FABRICA_SKIPS") {
        use std::io::Write as _;
        let line = format!("{test} (needs {name})\n");
        let written = std::fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(list)
            .and_then(|mut f| f.write_all(line.as_bytes()));
        assert!(written.is_ok(), "a skip could not be counted");
    }
    None
}

/// The top folder of the checkout.
pub fn checkout() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// A fresh device on the software adapter, which every machine that tests has.
///
/// # Panics
/// If there is none: that is a failure, not a skip.
pub fn software() -> GpuContext {
    let context = GpuContext::new(&AdapterChoice::Software);
    let context = context.unwrap_or_else(|e| panic!("tests need a software adapter: {e}"));
    // Shown only if the test fails.
    println!("adapter: {} ({}, {})", context.adapter.name, context.adapter.backend, context.adapter.driver);
    context
}

/// A renderer on a fresh device of the software adapter.
///
/// # Panics
/// As [`software`].
pub fn renderer() -> Renderer {
    Renderer::new(software())
}
