//! The figure: what is edited (the template), by which commands, where its volumes come from, and how it becomes a scene.

pub mod bridge;
pub mod command;
pub mod document;
pub mod first_look;
pub mod framing;
pub mod shipped;
pub mod source;
pub mod sources;
pub mod style_settings;
pub mod template;
pub mod theme;

pub use command::Command;
pub use document::Document;
pub use template::Template;
