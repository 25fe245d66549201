//! Filters of a volume's values against noise. They make a new volume; files are never touched.

use rayon::prelude::*;

use super::no_data::fill_no_data;
use super::prefilter::{Prefilter, Source};
use super::{Derived, Volume, Voxel, Voxels};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::with_voxels;

/// A filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Filter {
    /// Convolution with a Gaussian.
    Gaussian {
        /// Standard deviation, mm, above 0.
        sigma_mm: f64,
    },
    /// The median of a box around each voxel: takes specks away and leaves straight edges.
    Median {
        /// Voxels on either side, 1 to [`MAX_RADIUS`].
        radius_voxels: usize,
    },
    /// Anisotropic diffusion (Perona and Malik 1990, with their g = 1/(1 + (d/K)²)): smooths within tissue, hardly across edges.
    Anisotropic {
        /// K: difference of neighboring voxels, in data units, from which on there is an edge; above 0.
        edge: f64,
        /// Steps, 1 to [`MAX_ITERATIONS`], each as long as is stable.
        iterations: u32,
    },
}

/// The largest box of a median has 7³ voxels.
pub const MAX_RADIUS: usize = 3;
/// More steps change hardly anything.
pub const MAX_ITERATIONS: u32 = 100;
/// The widest Gaussian, in voxels of the axis.
const MAX_SIGMA_VOXELS: f64 = 64.0;

impl Filter {
    /// The volume with its values filtered, in single precision and rounded to the stored type. Beyond the edges the outermost voxels
    /// go on; a voxel without data has none afterwards, and counts for its neighbors as what stands in for it.
    ///
    /// # Errors
    /// [`Error::Scene`] for a volume of colors and for settings that make no sense, [`Error::Cancelled`].
    pub fn apply(&self, volume: &Volume, progress: &Progress) -> Result<Volume> {
        self.check()?;
        if volume.colors.is_some() {
            return Err(Error::scene("the volume has colors, and filters are for values", "read it without a filter"));
        }
        let filled = fill_no_data(volume);
        let dims = volume.grid.dims();
        let smooth = match *self {
            Self::Gaussian { sigma_mm } => {
                let sigma = volume.grid.spacing_mm().to_array().map(|h| (sigma_mm / h).min(MAX_SIGMA_VOXELS));
                gaussian(&filled.voxels, dims, sigma, progress)?
            }
            Self::Median { radius_voxels } => median(&filled.voxels, dims, radius_voxels, progress)?,
            Self::Anisotropic { edge, iterations } => {
                let edge = edge / volume.rescale.slope.abs();
                let spacing = volume.grid.spacing_mm().to_array();
                diffuse(&filled.voxels, dims, spacing, edge, iterations, progress)?
            }
        };
        Ok(Volume { voxels: stored(&volume.voxels, &smooth), derived: Derived::default(), ..volume.clone() })
    }

    /// What [`Filter::apply`] makes of a box of a volume alone: voxels from the first to, exclusive, the last along each index axis
    /// (within the volume, at least one). What lies around it counts as far as it matters: Gaussians are cut at 4σ, and diffusion is
    /// cut at four standard deviations of what it would be without edges. Where voxels without data are next to none, what stands in
    /// for them is the box's.
    ///
    /// # Errors
    /// As [`Filter::apply`].
    pub fn apply_to_box(&self, volume: &Volume, wanted: [[usize; 2]; 3], progress: &Progress) -> Result<Volume> {
        self.check()?;
        let (dims, reach) = (volume.grid.dims(), self.reach(volume.grid.spacing_mm().to_array()));
        let around: [[usize; 2]; 3] = std::array::from_fn(|i| {
            let [first, end] = wanted[i];
            [first.saturating_sub(reach[i]), (end + reach[i]).min(dims[i])]
        });
        let inner = std::array::from_fn(|i| wanted[i].map(|n| n - around[i][0]));
        Ok(self.apply(&volume.cropped(around), progress)?.cropped(inner))
    }

    /// How far away, in voxels along each axis of voxels so far apart (mm), a voxel counts.
    fn reach(&self, spacing: [f64; 3]) -> [usize; 3] {
        match *self {
            Self::Gaussian { sigma_mm } => {
                spacing.map(|h| (4.0 * (sigma_mm / h).min(MAX_SIGMA_VOXELS)).ceil() as usize)
            }
            Self::Median { radius_voxels } => [radius_voxels; 3],
            Self::Anisotropic { iterations, .. } => {
                let (weights, step) = diffusion(spacing);
                weights.map(|weight| {
                    let variance = 2.0 * f64::from(step * weight) * f64::from(iterations);
                    (4.0 * variance.sqrt()).ceil().min(f64::from(iterations)) as usize
                })
            }
        }
    }

    /// Whether its settings make sense.
    ///
    /// # Errors
    /// [`Error::Scene`] with the first that does not.
    pub fn check(&self) -> Result<()> {
        let fail = |what: String, remedy: String| Err(Error::scene(what, remedy));
        match *self {
            Self::Gaussian { sigma_mm } if !(sigma_mm > 0.0 && sigma_mm.is_finite()) => {
                fail(format!("a Gaussian of {sigma_mm} mm smooths nothing"), "give a width above 0".into())
            }
            Self::Median { radius_voxels } if !(1..=MAX_RADIUS).contains(&radius_voxels) => fail(
                format!("a median of {radius_voxels} voxels on either side is not offered"),
                format!("give 1 to {MAX_RADIUS}"),
            ),
            Self::Anisotropic { edge, .. } if !(edge > 0.0 && edge.is_finite()) => {
                fail(format!("an edge of {edge} keeps nothing apart"), "give a difference above 0".into())
            }
            Self::Anisotropic { iterations, .. } if !(1..=MAX_ITERATIONS).contains(&iterations) => {
                fail(format!("{iterations} steps of diffusion are not offered"), format!("give 1 to {MAX_ITERATIONS}"))
            }
            _ => Ok(()),
        }
    }
}

/// Planes that are worked on between two looks at whether it was cancelled.
const SLAB: usize = 8;

fn gaussian(voxels: &Voxels, dims: [usize; 3], sigma: [f64; 3], progress: &Progress) -> Result<Vec<f32>> {
    let mut prefilter = Prefilter::new(Source::Values { voxels, offset: 0.0, scale: 1.0 }, dims, sigma);
    let mut smooth = Vec::with_capacity(dims.iter().product());
    progress.begin("smoothing", dims[2] as u64);
    for z in (0..dims[2]).step_by(SLAB) {
        let end = (z + SLAB).min(dims[2]);
        smooth.extend(prefilter.slab(z, end));
        progress.advance((end - z) as u64)?;
    }
    Ok(smooth)
}

fn singles(voxels: &Voxels) -> Vec<f32> {
    with_voxels!(voxels, v => v.par_iter().map(|s| s.to_f64() as f32).collect())
}

fn median(voxels: &Voxels, [nx, ny, nz]: [usize; 3], radius: usize, progress: &Progress) -> Result<Vec<f32>> {
    let values = singles(voxels);
    let mut smooth = vec![0.0f32; values.len()];
    progress.begin("median", nz as u64);
    // The voxels of an axis within the box around `at`; beyond the edge it goes on.
    let around = |at: usize, n: usize| (0..=2 * radius).map(move |k| (at + k).saturating_sub(radius).min(n - 1));
    smooth.par_chunks_mut(nx * ny).enumerate().try_for_each(|(z, plane)| {
        let mut near = Vec::with_capacity((2 * radius + 1).pow(3));
        for (i, out) in plane.iter_mut().enumerate() {
            near.clear();
            for zz in around(z, nz) {
                for yy in around(i / nx, ny) {
                    let row = nx * (yy + ny * zz);
                    near.extend(around(i % nx, nx).map(|xx| values[row + xx]));
                }
            }
            let middle = near.len() / 2;
            *out = *near.select_nth_unstable_by(middle, f32::total_cmp).1;
        }
        progress.advance(1)
    })?;
    Ok(smooth)
}

/// What differences across each axis count for, and the length of a step of diffusion.
fn diffusion(spacing: [f64; 3]) -> ([f32; 3], f32) {
    // Differences across longer axes are those of the same slope over a longer way, and count for less.
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let weights = spacing.map(|h| ((finest / h) * (finest / h)) as f32);
    // Stable, and never beyond the neighbors' values, as long as the weights' sum is at most 1.
    (weights, 1.0 / (1.0 + 2.0 * weights.iter().sum::<f32>()))
}

fn diffuse(
    voxels: &Voxels,
    [nx, ny, nz]: [usize; 3],
    spacing: [f64; 3],
    edge: f64,
    iterations: u32,
    progress: &Progress,
) -> Result<Vec<f32>> {
    let mut values = singles(voxels);
    let mut next = values.clone();
    let (weights, step) = diffusion(spacing);
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let slopes = spacing.map(|h| (finest / h / edge) as f32);
    progress.begin("diffusion", u64::from(iterations) * nz as u64);
    for _ in 0..iterations {
        next.par_chunks_mut(nx * ny).enumerate().try_for_each(|(z, plane)| {
            for (i, out) in plane.iter_mut().enumerate() {
                let (x, y) = (i % nx, i / nx);
                let at = i + nx * ny * z;
                let own = values[at];
                let flow = |axis: usize, there: bool, to: usize| {
                    if !there {
                        return 0.0;
                    }
                    let difference = values[to] - own;
                    let slope = difference * slopes[axis];
                    weights[axis] * difference / (1.0 + slope * slope)
                };
                let sum = flow(0, x > 0, at.wrapping_sub(1))
                    + flow(0, x + 1 < nx, at + 1)
                    + flow(1, y > 0, at.wrapping_sub(nx))
                    + flow(1, y + 1 < ny, at + nx)
                    + flow(2, z > 0, at.wrapping_sub(nx * ny))
                    + flow(2, z + 1 < nz, at + nx * ny);
                *out = own + step * sum;
            }
            progress.advance(1)
        })?;
        std::mem::swap(&mut values, &mut next);
    }
    Ok(values)
}

/// Numbers in the type of `like`; where that has no data there is none.
fn stored(like: &Voxels, numbers: &[f32]) -> Voxels {
    macro_rules! integers {
        ($kind:ident, $type:ty) => {
            // `as` saturates, so that rounding up never wraps around.
            Voxels::$kind(numbers.par_iter().map(|n| n.round() as $type).collect())
        };
    }
    match like {
        Voxels::U8(_) => integers!(U8, u8),
        Voxels::I8(_) => integers!(I8, i8),
        Voxels::U16(_) => integers!(U16, u16),
        Voxels::I16(_) => integers!(I16, i16),
        Voxels::U32(_) => integers!(U32, u32),
        Voxels::I32(_) => integers!(I32, i32),
        Voxels::U64(_) => integers!(U64, u64),
        Voxels::I64(_) => integers!(I64, i64),
        Voxels::F32(v) => {
            Voxels::F32(v.par_iter().zip(numbers).map(|(v, n)| if v.is_finite() { *n } else { *v }).collect())
        }
        Voxels::F64(v) => Voxels::F64(
            v.par_iter().zip(numbers).map(|(v, n)| if v.is_finite() { f64::from(*n) } else { *v }).collect(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::spaces::Grid;
    use crate::volume::Rescale;

    const N: usize = 24;

    fn volume(spacing: DVec3, value: impl Fn([usize; 3]) -> f64) -> Volume {
        let grid = Grid::new([N; 3], DAffine3::from_scale(spacing)).unwrap();
        let voxels = (0..N * N * N).map(|i| value([i % N, i / N % N, i / (N * N)]) as i16).collect();
        Volume::new(grid, Voxels::I16(voxels), Rescale { slope: 2.0, intercept: -7.0 }, "test").unwrap()
    }

    const ALL: [Filter; 3] = [
        Filter::Gaussian { sigma_mm: 1.3 },
        Filter::Median { radius_voxels: 2 },
        Filter::Anisotropic { edge: 60.0, iterations: 20 },
    ];

    /// Noise without a seed to forget: the same for the same voxel.
    fn noise([x, y, z]: [usize; 3]) -> f64 {
        let h = (x as u32).wrapping_mul(0x9e37_79b9)
            ^ (y as u32).wrapping_mul(0x85eb_ca6b)
            ^ (z as u32).wrapping_mul(0xc2b2_ae35);
        let h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
        f64::from((h ^ (h >> 12)) % 1000) / 1000.0 - 0.5
    }

    #[test]
    fn constants_stay_and_noise_goes() {
        for filter in ALL {
            let flat = volume(DVec3::ONE, |_| 41.0);
            let same = filter.apply(&flat, &Progress::new()).unwrap();
            assert!(same.voxels == flat.voxels && same.rescale == flat.rescale, "{filter:?}");
            let noisy = volume(DVec3::new(1.0, 0.8, 1.5), |p| 200.0 + 40.0 * noise(p));
            let spread = |v: &Volume| {
                let values: Vec<f64> = (0..N * N * N).map(|i| v.value(i % N, i / N % N, i / (N * N))).collect();
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
            };
            let filtered = filter.apply(&noisy, &Progress::new()).unwrap();
            assert!(spread(&filtered) < 0.45 * spread(&noisy), "{filter:?}: {} {}", spread(&filtered), spread(&noisy));
        }
    }

    #[test]
    fn edges_stay_where_they_shall() {
        let edge = |p: [usize; 3]| if p[0] < N / 2 { 0.0 } else { 1000.0 };
        let step = |filter: Filter| {
            let filtered = filter.apply(&volume(DVec3::ONE, |p| edge(p) + 20.0 * noise(p)), &Progress::new()).unwrap();
            (filtered.value(N / 2, 9, 11) - filtered.value(N / 2 - 1, 9, 11)) / 2000.0
        };
        assert!(step(ALL[0]) < 0.4 && step(ALL[1]) > 0.97 && step(ALL[2]) > 0.95, "{:?}", ALL.map(step));
        // A speck is gone with the median.
        let speck = volume(DVec3::ONE, |p| if p == [9, 9, 9] { 900.0 } else { 10.0 });
        let filtered = Filter::Median { radius_voxels: 1 }.apply(&speck, &Progress::new()).unwrap();
        assert_eq!(filtered.value(9, 9, 9), 13.0);
    }

    #[test]
    fn a_gaussian_is_as_wide_in_millimeters_along_every_axis() {
        let spacing = DVec3::new(0.5, 1.0, 0.75);
        let impulse = volume(spacing, |p| if p == [12; 3] { 30_000.0 } else { 0.0 });
        let filtered = Filter::Gaussian { sigma_mm: 1.5 }.apply(&impulse, &Progress::new()).unwrap();
        let own = filtered.rescale;
        let stored = |x: usize, y: usize, z: usize| (filtered.value(x, y, z) - own.intercept) / own.slope;
        let peak = stored(12, 12, 12);
        for (along, h) in [(stored(14, 12, 12), 1.0f64), (stored(12, 13, 12), 1.0), (stored(12, 12, 14), 1.5)] {
            let expected = (-0.5 * (h / 1.5).powi(2)).exp();
            assert!((along / peak - expected).abs() < 0.02, "{along} {peak} {expected}");
        }
    }

    #[test]
    fn a_box_alone_is_what_it_is_of_the_whole() {
        let noisy = volume(DVec3::new(1.0, 0.8, 1.5), |p| 200.0 + 5.0 * p[0] as f64 + 80.0 * noise(p));
        for filter in ALL.into_iter().chain([Filter::Anisotropic { edge: 30.0, iterations: 3 }]) {
            let whole = filter.apply(&noisy, &Progress::new()).unwrap();
            // In the middle, on a corner, and a single layer.
            for wanted in [[[9, 15], [8, 12], [10, 13]], [[0, 4], [20, 24], [0, 1]], [[0, 24], [0, 24], [12, 13]]] {
                let part = filter.apply_to_box(&noisy, wanted, &Progress::new()).unwrap();
                let first = wanted.map(|w| w[0]);
                for i in 0..part.grid.num_voxels() {
                    let [nx, ny, _] = part.grid.dims();
                    let [x, y, z] = [i % nx, i / nx % ny, i / (nx * ny)];
                    let (a, b) = (part.value(x, y, z), whole.value(x + first[0], y + first[1], z + first[2]));
                    // Values are rounded to steps of 2.
                    assert!((a - b).abs() <= 2.0, "{filter:?} {wanted:?} {x} {y} {z}: {a} {b}");
                }
                let corner = noisy.grid.world_from_index().transform_point3(DVec3::from_array(first.map(|n| n as f64)));
                assert!(part.grid.world_from_index().translation.distance(corner) < 1e-9);
            }
        }
    }

    #[test]
    fn gaps_stay_gaps_and_nonsense_is_a_sentence() {
        let grid = Grid::new([5; 3], DAffine3::IDENTITY).unwrap();
        let voxels = Voxels::F32((0..125).map(|i| if i == 62 { f32::NAN } else { 3.0 }).collect());
        let gappy = Volume::new(grid, voxels, Rescale::IDENTITY, "test").unwrap();
        for filter in ALL {
            let filtered = filter.apply(&gappy, &Progress::new()).unwrap();
            assert!(filtered.value(2, 2, 2).is_nan() && (filtered.value(1, 2, 2) - 3.0).abs() < 1e-5, "{filter:?}");
        }
        for bad in [
            Filter::Gaussian { sigma_mm: 0.0 },
            Filter::Gaussian { sigma_mm: f64::NAN },
            Filter::Median { radius_voxels: 0 },
            Filter::Median { radius_voxels: 9 },
            Filter::Anisotropic { edge: -1.0, iterations: 3 },
            Filter::Anisotropic { edge: 1.0, iterations: 0 },
        ] {
            assert!(matches!(bad.apply(&gappy, &Progress::new()), Err(Error::Scene { .. })), "{bad:?}");
        }
        let colored = Volume::from_colors(grid, vec![[9, 9, 9, 255]; 125], "test").unwrap();
        assert!(ALL[0].apply(&colored, &Progress::new()).unwrap_err().to_string().contains("colors"));
        let cancelled = Progress::new();
        cancelled.cancel();
        for filter in ALL {
            assert!(matches!(filter.apply(&gappy, &cancelled), Err(Error::Cancelled)), "{filter:?}");
        }
        // Integers saturate.
        let full = Voxels::U8(vec![255; 125]);
        let bright = Volume::new(grid, full, Rescale::IDENTITY, "test").unwrap();
        assert_eq!(ALL[0].apply(&bright, &Progress::new()).unwrap().value(2, 2, 2), 255.0);
    }
}
