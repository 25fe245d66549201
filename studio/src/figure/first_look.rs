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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use fabrica_engine::spaces::Grid;
    use fabrica_engine::styles::StyleLibrary;
    use fabrica_engine::volume::{Rescale, Voxels};
    use glam::DAffine3;

    use super::*;
    use crate::figure::bridge;
    use crate::figure::template::Domain;

    /// A ball of `inside` in `outside`.
    fn ball(outside: i16, inside: i16, modality: Modality) -> Volume {
        let voxel = |i: usize| {
            let p = [i % 16, i / 16 % 16, i / 256].map(|n| n as f64 - 7.5);
            let near = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            if near > 6.0 { outside } else { inside - near as i16 }
        };
        let grid = Grid::new([16; 3], DAffine3::IDENTITY).unwrap();
        let mut volume =
            Volume::new(grid, Voxels::I16((0..4096).map(voxel).collect()), Rescale::IDENTITY, "test").unwrap();
        volume.modality = modality;
        volume
    }

    #[test]
    fn every_kind_of_data_shows_something_in_its_own_domain() {
        for (outside, inside, modality, domain) in [
            (-1000, 900, Modality::Ct, Domain::Data),
            (-1000, 900, Modality::Unknown, Domain::Data),
            (0, 200, Modality::Unknown, Domain::Percentile),
            (-1000, 900, Modality::Mr, Domain::Percentile),
            (0, 200, Modality::Mr, Domain::Percentile),
        ] {
            let volume = ball(outside, inside, modality);
            let figure = first_look(&volume, "a \"b\".nii", &Progress::new()).unwrap();
            assert_eq!(figure.objects[0].transfer_function.domain, domain, "{outside} {modality:?}");
            assert_eq!(figure.volumes[0].file, "a \"b\".nii");
            let volumes = [Arc::new(volume)];
            let (scene, _) = bridge::scene(&figure, &volumes, &StyleLibrary::embedded(), &Progress::new()).unwrap();
            assert!(!scene.objects[0].shows_nothing(), "{outside} {modality:?}");
        }
    }
}
