//! Fabrica's engine: volumes, scenes, the wgpu raycaster and its f64 reference, image files.
//! It knows no window and no physics; `ARCHITECTURE.md` has the map.

pub mod color;
pub mod error;
pub mod estimate;
pub mod gpu;
pub mod image_in;
pub mod image_out;
pub mod measure;
pub mod pass;
pub mod pick;
pub mod progress;
pub mod read;
pub mod reference;
pub mod render;
pub mod scene;
pub mod selection;
pub mod slice;
pub mod spaces;
pub mod specimen;
pub mod styles;
pub mod volume;
pub mod volume_out;

pub use error::{Error, Result};
pub use progress::Progress;
/// The one wgpu of the tree, for those who share a device with the engine or look into its shaders.
pub use wgpu;
