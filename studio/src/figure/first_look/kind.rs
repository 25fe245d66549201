//! What kind of data a volume holds, where its file does not say: from its values and where they lie.

use fabrica_engine::volume::statistics::Statistics;
use fabrica_engine::volume::{Modality, Volume, Voxel};
use fabrica_engine::with_voxels;
use glam::DVec3;

/// What a first look tells apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Nothing differs from anything else: constant, or without a finite voxel.
    Constant,
    /// Colors, of which the transparent ones cut out what is to be seen.
    CutOut,
    /// Colors on a dark background, as photographs of slices have them.
    Colors,
    /// Computed tomography in Hounsfield units.
    Ct {
        /// The value of blood with contrast medium, where there is enough of it to see.
        contrast: Option<f64>,
    },
    /// Numbers of structures, or a mask.
    Labels,
    /// Magnetic resonance of a body that goes on beyond the volume, as heads do at the neck.
    Body,
    /// Magnetic resonance of an organ that was cut out, as skull-stripped brains are.
    Organ,
    /// Anything else, of one material as far as the values tell.
    OneMaterial,
    /// Anything else, of a dim and a bright material.
    TwoMaterials {
        /// The data value between them.
        valley: f64,
    },
}

impl Kind {
    /// From a volume and its statistics.
    pub fn of(volume: &Volume, statistics: &Statistics) -> Self {
        if let Some(colors) = &volume.colors {
            if colors.iter().any(|c| c[3] == 0) { Self::CutOut } else { Self::Colors }
        } else if statistics.min == statistics.max {
            Self::Constant
        } else if is_ct(volume, statistics) {
            Self::Ct { contrast: contrast(statistics) }
        } else if has_few_values(statistics) || share_of_equal_neighbors(volume, statistics) > 0.75 {
            Self::Labels
        } else if volume.modality == Modality::Mr || is_of_a_body(volume, statistics) {
            // A neck or a cut torso takes more of the border than burnt-in letters or a brain that touches it.
            if share_of_border(volume, statistics.background) > 0.07 { Self::Body } else { Self::Organ }
        } else if let Some(valley) = valley(statistics) {
            Self::TwoMaterials { valley }
        } else {
            Self::OneMaterial
        }
    }
}

/// Whether a volume's values are Hounsfield units, as its file says or, where it says nothing, as they look.
pub fn is_ct(volume: &Volume, statistics: &Statistics) -> bool {
    volume.modality == Modality::Ct || (volume.modality == Modality::Unknown && is_in_hu(statistics))
}

/// Air near -1000, some of what tissue has, and nearly nothing beyond metal: no other scanner's numbers look like that.
fn is_in_hu(statistics: &Statistics) -> bool {
    let share = |low: f64, high: f64| statistics.percentile_rank(high) - statistics.percentile_rank(low);
    share(-1200.0, -800.0) > 0.5 && share(-150.0, 150.0) > 2.0 && statistics.percentile(99.9) < 4000.0
}

/// Whether a scanner for bodies made it, as far as one can tell: a medical file format, a size that bodies have, and more in it
/// than the few percent that simulations and maps of statistics show.
fn is_of_a_body(volume: &Volume, statistics: &Statistics) -> bool {
    let size = volume.grid.spacing_mm() * DVec3::from_array(volume.grid.dims().map(|n| n as f64));
    let is_medical = ["NIfTI", "NRRD", "DICOM"].iter().any(|format| volume.format.starts_with(format));
    let share = statistics.num_above_background() as f64 / statistics.num_finite.max(1) as f64;
    is_medical && (40.0..2500.0).contains(&size.max_element()) && share > 0.06
}

/// Whether hardly more values occur above the background than one can count on the fingers.
fn has_few_values(statistics: &Statistics) -> bool {
    let mut values: Vec<f64> = (0..=100).map(|p| statistics.percentile_above_background(f64::from(p))).collect();
    values.dedup();
    values.len() <= 10
}

/// The larger value of a volume that has two of them, the voxels of a mask.
pub fn mask_value(volume: &Volume, statistics: &Statistics) -> Option<f64> {
    let is_end = |value: f64| value == statistics.min || value == statistics.max;
    let has_two = with_voxels!(&volume.voxels, voxels => {
        voxels.iter().all(|v| is_end(volume.rescale.value(v.to_f64())))
    });
    has_two.then_some(statistics.max)
}

/// Of the voxels above the background that belong to something, the share that has the same value as the next one along x.
/// Images have noise, numbers of structures have none.
fn share_of_equal_neighbors(volume: &Volume, statistics: &Statistics) -> f64 {
    let filler = filler(statistics);
    let row = volume.grid.dims()[0];
    with_voxels!(&volume.voxels, voxels => {
        let (mut equal, mut all) = (0_u64, 0_u64);
        for pair in voxels.chunks(row).flat_map(|row| row.windows(2)) {
            let value = volume.rescale.value(pair[0].to_f64());
            if value > statistics.background && Some(value) != filler {
                all += 1;
                equal += u64::from(pair[0] == pair[1]);
            }
        }
        equal as f64 / all.max(1) as f64
    })
}

/// The share of the voxels on the faces of the volume that lie above `background`.
fn share_of_border(volume: &Volume, background: f64) -> f64 {
    let [nx, ny, nz] = volume.grid.dims();
    let (mut above, mut all) = (0_u64, 0_u64);
    let mut count = |x: usize, y: usize, z: usize| {
        all += 1;
        above += u64::from(volume.value(x, y, z) > background);
    };
    for y in 0..ny {
        for x in 0..nx {
            count(x, y, 0);
            count(x, y, nz - 1);
        }
        for z in 0..nz {
            count(0, y, z);
            count(nx - 1, y, z);
        }
    }
    for z in 0..nz {
        for x in 0..nx {
            count(x, 0, z);
            count(x, ny - 1, z);
        }
    }
    above as f64 / all as f64
}

/// A histogram of percent of the finite voxels, in equal bins.
fn histogram(statistics: &Statistics, low: f64, high: f64, num_bins: usize) -> Vec<f64> {
    let edge = |i: usize| low + (high - low) * i as f64 / num_bins as f64;
    let ranks: Vec<f64> = (0..=num_bins).map(|i| statistics.percentile_rank(edge(i))).collect();
    ranks.windows(2).map(|r| r[1] - r[0]).collect()
}

/// Where a smoothed histogram rises again by the largest factor: the bin of the valley, that of the peak behind it, the factor.
fn rise(histogram: &[f64]) -> Option<(usize, usize, f64)> {
    let smooth: Vec<f64> = histogram.windows(3).map(|w| 0.25 * (w[0] + 2.0 * w[1] + w[2])).collect();
    let (mut lowest, mut best) = (0, None);
    for (i, &height) in smooth.iter().enumerate() {
        if height < smooth[lowest] {
            lowest = i;
        }
        let factor = height / smooth[lowest].max(f64::MIN_POSITIVE);
        if best.is_none_or(|(_, _, f)| factor > f) {
            best = Some((lowest + 1, i + 1, factor));
        }
    }
    best
}

/// The value of blood with contrast medium: a peak between what tissue and what bone have, of more voxels than all dense bone.
fn contrast(statistics: &Statistics) -> Option<f64> {
    let (low, high, num_bins) = (100.0, 700.0, 24);
    let (_, peak, factor) = rise(&histogram(statistics, low, high, num_bins))?;
    let dense = 100.0 - statistics.percentile_rank(high);
    let blood = statistics.percentile_rank(high) - statistics.percentile_rank(350.0);
    let value = low + (high - low) * (peak as f64 + 0.5) / num_bins as f64;
    (factor > 1.4 && blood > 1.0 && dense < 0.2 * blood).then_some(value)
}

/// The value between a dim and a bright material, where the histogram has two peaks above the background.
fn valley(statistics: &Statistics) -> Option<f64> {
    const BINS: usize = 32;
    let (low, high) = (statistics.background, statistics.percentile(99.95));
    let histogram = histogram(statistics, low, high, BINS);
    // Partial volumes lie in front of the first peak.
    let highest = (0..BINS).max_by(|&a, &b| histogram[a].total_cmp(&histogram[b]))?;
    let (valley, _, factor) = rise(&histogram[highest..])?;
    let value = low + (high - low) * ((highest + valley) as f64 + 0.5) / BINS as f64;
    let share = 100.0 - statistics.percentile_rank_above_background(value);
    (factor > 1.5 && share > 2.0).then_some(value)
}

/// The value that a fifth of all voxels or more share, if any: what is left around a body that was cut out.
pub fn filler(statistics: &Statistics) -> Option<f64> {
    (0..=80)
        .step_by(5)
        .map(|p| statistics.percentile(f64::from(p)))
        .zip((20..=100).step_by(5))
        .find_map(|(value, p)| (value == statistics.percentile(f64::from(p))).then_some(value))
}
