//! Fabrica's engine: volumes, scenes, the wgpu raycaster and its f64 reference, image files.
//! It knows no window and no physics; `ARCHITECTURE.md` has the map.

pub mod error;
pub mod progress;
pub mod spaces;
pub mod volume;

pub use error::{Error, Result};
pub use progress::Progress;
