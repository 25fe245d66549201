//! Which values are black and white in slices.

use eframe::egui::Vec2;
use fabrica_engine::slice::Window;
use fabrica_engine::volume::Volume;

use crate::figure::first_look::is_ct;

/// Half the air and all the organs: what every radiologist's workstation begins with.
const SOFT_TISSUE: Window = Window { level: 40.0, width: 400.0 };
const CT_PRESETS: [(&str, Window); 3] = [
    ("Bone", Window { level: 400.0, width: 1800.0 }),
    ("Lung", Window { level: -600.0, width: 1500.0 }),
    ("Brain", Window { level: 40.0, width: 80.0 }),
];
/// Points of a drag to the side that make the window 2.7 times as wide.
const DRAG_PER_E: f32 = 200.0;
/// Points of a drag up or down that move the level by the whole window.
const DRAG_PER_WIDTH: f32 = 300.0;

/// The window that suits a volume: soft tissue in CT; else from the darkest percent of the voxels to the brightest of those above
/// the background.
pub fn of_volume(volume: &Volume) -> Window {
    // Files are counted when they are read; what was made otherwise is shown as bytes are.
    let Some(statistics) = volume.known_statistics() else { return Window::of_range(0.0, 255.0) };
    if is_ct(volume, statistics) {
        return SOFT_TISSUE;
    }
    let (low, high) = (statistics.percentile(1.0), statistics.percentile_above_background(99.0));
    if low < high { Window::of_range(low, high) } else { Window::of_range(statistics.min, statistics.max) }
}

/// Windows by name; none is the one that suits the volume.
pub fn presets(volume: &Volume) -> Vec<(&'static str, Option<Window>)> {
    let Some(statistics) = volume.known_statistics() else { return vec![("Automatic", None)] };
    let whole = ("All values", Some(Window::of_range(statistics.min, statistics.max)));
    if is_ct(volume, statistics) {
        let others = CT_PRESETS.into_iter().map(|(name, window)| (name, Some(window)));
        [("Soft tissue", None)].into_iter().chain(others).chain([whole]).collect()
    } else {
        vec![("Automatic", None), whole]
    }
}

/// The window after a drag: to the right it is wider, up it is brighter.
#[must_use]
pub fn dragged(window: Window, by: Vec2) -> Window {
    let level = window.level + window.width * f64::from(by.y / DRAG_PER_WIDTH);
    let width = window.width * f64::from(by.x / DRAG_PER_E).exp();
    Window { level, width: width.clamp(least_width(level), f64::MAX) }
}

/// A window narrower than this is a threshold that moves with rounding.
pub fn least_width(level: f64) -> f64 {
    (level.abs() * 1e-9).max(1e-9)
}

/// Decimals that tell a hundredth of a window.
pub fn decimals(width: f64) -> usize {
    (2.0 - width.log10().floor()).clamp(0.0, 9.0) as usize
}

#[cfg(test)]
mod tests {
    use fabrica_engine::Progress;
    use fabrica_engine::spaces::Grid;
    use fabrica_engine::volume::{Modality, Rescale, Voxels};
    use glam::DAffine3;

    use super::*;

    fn volume(values: Vec<f32>) -> Volume {
        let grid = Grid::new([values.len(), 1, 1], DAffine3::IDENTITY).unwrap();
        let volume = Volume::new(grid, Voxels::F32(values), Rescale::IDENTITY, "test").unwrap();
        volume.statistics(&Progress::new()).unwrap();
        volume
    }

    #[test]
    fn a_window_suits_what_the_values_are() {
        let mut ct = volume((-1000..3000).map(|v| v as f32).collect());
        ct.modality = Modality::Ct;
        assert_eq!(of_volume(&ct), SOFT_TISSUE);
        assert_eq!(presets(&ct).len(), 5);
        // Much dark background and one bright voxel: neither decides.
        let mut values = vec![0.0; 5000];
        values.extend((0..1000).map(|v| 500.0 + v as f32));
        values.push(1e6);
        let mr = volume(values);
        let window = of_volume(&mr);
        let (low, high) = (window.level - 0.5 * window.width, window.level + 0.5 * window.width);
        assert!(low.abs() < 1.0 && (1400.0..1600.0).contains(&high), "{low} to {high}");
        assert_eq!(presets(&mr).len(), 2);
        let constant = of_volume(&volume(vec![7.0; 9]));
        assert!(constant.width > 0.0 && constant.gray(7.0) == 128);
        assert!(of_volume(&volume(vec![f32::NAN; 9])).width > 0.0);
    }

    #[test]
    fn drags_widen_and_brighten() {
        let window = Window { level: 40.0, width: 400.0 };
        let right = dragged(window, Vec2::new(50.0, 0.0));
        assert!(right.width > window.width && right.level == window.level);
        let back = dragged(right, Vec2::new(-50.0, 0.0));
        assert!((back.width - window.width).abs() < 1e-9);
        assert!(dragged(window, Vec2::new(0.0, -30.0)).gray(40.0) > window.gray(40.0));
        let narrow = dragged(window, Vec2::new(-1e6, 0.0));
        assert!(narrow.width > 0.0 && dragged(narrow, Vec2::new(1e9, 0.0)).width.is_finite());
        assert_eq!([4000.0, 400.0, 80.0, 1.0, 0.01].map(decimals), [0, 0, 1, 2, 4]);
    }
}
