//! The figure: what is edited (the template), where its volumes come from, and how it becomes a scene.

pub mod bridge;
pub mod source;
pub mod template;

pub use template::Template;
