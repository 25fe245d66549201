//! The first picture of a volume that nobody has dressed yet: a template from what kind of data it is.

use anyhow::Result;
use fabrica_engine::Progress;
use fabrica_engine::volume::{Modality, Volume};

use super::template::Template;

/// A template for `volume`, which is read from `file` (as templates name it).
///
/// CT, in HU, gets bone under a veil of skin; else percentiles of what is above the background: MR a surface in the style of
/// a brain, anything else one of clay.
///
/// # Errors
/// [`fabrica_engine::Error::Cancelled`] on request.
pub fn first_look(volume: &Volume, file: &str, progress: &Progress) -> Result<Template> {
    let statistics = volume.statistics(progress)?;
    let is_ct = match volume.modality {
        Modality::Ct => true,
        // Air at -1000 and something as dense as bone: no other scanner's numbers look like that.
        Modality::Unknown => statistics.min < -500.0 && statistics.max > 200.0,
        Modality::Mr => false,
    };
    let function = if is_ct {
        r#"{"domain": "data", "reference_length_mm": 1.0, "nodes": [
            {"at": -420, "style": "glass", "opacity": 0}, {"at": -250, "style": "glass", "opacity": 0.12},
            {"at": -150, "style": "glass", "opacity": 0.12}, {"at": -100, "style": "glass", "opacity": 0},
            {"at": 160, "style": "bone", "opacity": 0}, {"at": 300, "style": "bone", "opacity": 0.9},
            {"at": 1600, "style": "porcelain", "opacity": 1}]}"#
    } else if volume.modality == Modality::Mr {
        r#"{"domain": "percentile", "nodes": [
            {"at": 5, "style": "brain", "opacity": 0}, {"at": 20, "style": "brain", "opacity": 0.9}]}"#
    } else {
        r#"{"domain": "percentile", "nodes": [
            {"at": 5, "style": "clay", "opacity": 0}, {"at": 25, "style": "clay", "opacity": 0.9}]}"#
    };
    let text = format!(
        r##"{{"fabrica": 1, "volumes": [{{"name": "volume", "file": {}}}],
            "objects": [{{"volume": "volume", "transfer_function": {function}}}],
            "camera": {{"from": [-0.6, 0.75, 0.35], "fov_deg": 30, "height": 2}},
            "background": "#ffffff", "figure": {{"width_mm": 173, "height_mm": 173, "dpi": 300}}}}"##,
        serde_json::to_string(file)?
    );
    Template::parse(&text)
}
