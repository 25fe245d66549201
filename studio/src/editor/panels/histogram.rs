//! How many voxels have which value, as a curve to look at.

use std::sync::Arc;

use eframe::egui::Context;
use fabrica_engine::Progress;
use fabrica_engine::selection::{Selection, Structure};
use fabrica_engine::volume::statistics::Statistics;
use fabrica_engine::volume::{Volume, Voxels};

use super::super::files::Job;
use super::super::open_figure::OpenFigure;

/// The highest that the curve goes: a little room is left above.
const TOP: f64 = 0.96;

/// Counts of equally wide values.
pub struct Histogram {
    /// The value in the middle of the first bin.
    first: f64,
    /// Between the middles of two bins.
    width: f64,
    counts: Vec<u64>,
    /// The most in a bin; linearly, the background's bins do not count: they alone would flatten everything else.
    most: u64,
    most_above_background: u64,
}

impl Histogram {
    /// Of a volume's values. Where they are so few integers that bins would be empty between them, a bin for each.
    pub fn of(volume: &Volume, statistics: &Statistics) -> Self {
        Self::from_bins(volume, statistics, &statistics.histogram)
    }

    /// Of as many bins as the volume's histogram has, of some of its values.
    fn from_bins(volume: &Volume, statistics: &Statistics, bins: &[u64]) -> Self {
        let range = statistics.max - statistics.min;
        let is_integer = !matches!(volume.voxels, Voxels::F32(_) | Voxels::F64(_));
        let num_steps = (range / volume.rescale.slope.abs()).round() as usize;
        let (first, width, counts) = if is_integer && num_steps < bins.len() {
            let mut counts = vec![0; num_steps + 1];
            for (i, n) in bins.iter().enumerate() {
                // The bin of the integer k is the one that k of the steps fall into.
                counts[(i * num_steps).div_ceil(bins.len()).min(num_steps)] += n;
            }
            (statistics.min, volume.rescale.slope.abs(), counts)
        } else {
            let width = range / bins.len() as f64;
            (statistics.min + 0.5 * width, width, bins.to_vec())
        };
        let most = counts.iter().copied().max().unwrap_or(0);
        // All of a bin must be above.
        let low = |i: usize| first + (i as f64 - 0.5) * width;
        let foreground = counts.iter().enumerate().filter(|(i, _)| low(*i) > statistics.background);
        let most_above_background = foreground.map(|(_, n)| *n).max().unwrap_or(most);
        Self { first, width, counts, most, most_above_background }
    }

    /// The height, 0 to 1, of the curve at a value.
    pub fn height(&self, value: f64, logarithmic: bool) -> f64 {
        let place = (value - self.first) / self.width;
        let last = self.counts.len() as f64 - 1.0;
        // A single value is a line.
        if !(place >= -0.5 && place <= last + 0.5) {
            return 0.0;
        }
        let scaled = |n: u64| if logarithmic { (n as f64).ln_1p() } else { n as f64 };
        let most = scaled(if logarithmic { self.most } else { self.most_above_background }.max(1));
        let below = place.floor().clamp(0.0, last);
        let at = |place: f64| scaled(self.counts[place.min(last) as usize]);
        let share = (place - below).clamp(0.0, 1.0);
        TOP * ((at(below) + share * (at(below + 1.0) - at(below))) / most).min(1.0)
    }
}

/// The values inside what is chosen, counted on a thread.
#[derive(Default)]
pub struct Inside {
    /// What is counted, or was: the volume, the structures' slot and their names.
    of: Option<(Arc<Volume>, Vec<Selection>)>,
    counting: Option<Job<Vec<u64>>>,
    counted: Option<Histogram>,
}

impl Inside {
    /// The histogram of what is chosen now, as soon as it is counted; none where nothing is.
    pub fn of_chosen(&mut self, ctx: &Context, open: &OpenFigure) -> Option<&Histogram> {
        let chosen = open.chosen_selections();
        let Some(volume) = open.chosen_volume().filter(|_| !chosen.is_empty()) else {
            *self = Self::default();
            return None;
        };
        let statistics = volume.known_statistics()?;
        let is_same = |(of, selections): &(Arc<Volume>, Vec<Selection>)| {
            let same = |(a, b): (&Selection, &&Structure)| a.is_copy_of(&b.selection);
            Arc::ptr_eq(of, volume) && selections.len() == chosen.len() && selections.iter().zip(&chosen).all(same)
        };
        if !self.of.as_ref().is_some_and(is_same) {
            let selections: Vec<Selection> = chosen.iter().map(|s| s.selection.clone()).collect();
            self.of = Some((volume.clone(), selections.clone()));
            self.counted = None;
            let (volume, ctx) = (volume.clone(), ctx.clone());
            let (range, num_bins) = ((statistics.min, statistics.max), statistics.histogram.len());
            let count = move |_: &Progress| {
                let mut counts = vec![0; num_bins];
                for selection in &selections {
                    let own = selection.histogram_of(&volume, range, num_bins);
                    counts.iter_mut().zip(own).for_each(|(sum, n)| *sum += n);
                }
                Ok(counts)
            };
            self.counting = Some(Job::start("Histogram".to_owned(), move || ctx.request_repaint(), count));
        }
        if let Some(Ok(counts)) = self.counting.as_ref().and_then(Job::finished) {
            self.counting = None;
            self.counted = Some(Histogram::from_bins(volume, statistics, &counts));
        }
        self.counted.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use fabrica_engine::spaces::Grid;
    use fabrica_engine::volume::Rescale;
    use glam::DAffine3;

    use super::*;

    fn histogram(voxels: Voxels, slope: f64) -> Histogram {
        let grid = Grid::new([voxels.len(), 1, 1], DAffine3::IDENTITY).unwrap();
        let volume = Volume::new(grid, voxels, Rescale { slope, intercept: 0.0 }, "test").unwrap();
        Histogram::of(&volume, volume.statistics(&Progress::new()).unwrap())
    }

    #[test]
    fn few_integers_have_a_bin_each() {
        // 101 values in 256 bins: every second one would be empty.
        for slope in [1.0, -0.5] {
            let even = histogram(Voxels::U8((0..=100).collect()), slope);
            assert_eq!(even.counts, vec![1; 101], "{slope}");
            assert!((even.height(50.0 * slope, false) - TOP).abs() < 1e-12);
            assert_eq!(even.height(102.0 * slope, true), 0.0);
        }
        let constant = histogram(Voxels::U8(vec![7; 9]), 1.0);
        assert!(constant.height(7.0, true) > 0.9 && constant.height(9.0, true) == 0.0);
    }

    #[test]
    fn the_background_does_not_flatten_the_rest() {
        let mut values = vec![0i16; 100_000];
        values.extend((1000..2000).flat_map(|v| [v, v]));
        let many = histogram(Voxels::I16(values), 1.0);
        assert!(many.counts.len() == 256 && many.height(1500.0, false) > 0.8 && many.height(1500.0, true) < 0.5);
        assert_eq!(many.height(f64::NAN, true), 0.0);
    }
}
