//! What the data values of a volume are like: range, mean, histogram, background and percentiles.
//! Domains of transfer functions, warnings about missing data and the fit of templates come from here.
//!
//! Volumes of up to 16-bit integers are counted value by value, so everything is exact. Wider types are counted
//! in bins of the *order-preserving key* of the stored number (for floats, the bits with the sign handled), refined
//! where the voxels are: a few voxels of ±1e30 cost nothing, where equal bins over min to max would see only them.

use rayon::prelude::*;

use super::{Rescale, Volume, Voxel, Voxels};
use crate::error::Result;
use crate::progress::Progress;

/// Number of equal bins of [`Statistics::histogram`].
pub const NUM_HISTOGRAM_BINS: usize = 256;

/// Voxels between two looks at the progress handle, and of one partial sum: the mean does not depend on the
/// number of threads.
const BLOCK: usize = 1 << 16;

/// Up to so many voxels of a wide type are sorted instead of binned (1 MiB of keys).
const MAX_SORTED: u64 = 1 << 17;

/// Bits of the coarse key bins, and of the number of fine ones.
const COARSE_BITS: u32 = 16;

/// Outermost shares of the voxels, in percent, that the background threshold does not listen to: metal,
/// padding values and ±1e30 would else be the only contrast.
const OTSU_TAIL_PERCENT: f64 = 0.1;

/// Statistics of the data values (after rescale) of a volume. NaN and ±Inf are counted and otherwise left out.
///
/// A volume without a finite voxel has `num_finite` 0, an empty histogram (all bins 0), and 0 for every value.
#[derive(Clone, Debug)]
pub struct Statistics {
    /// Voxels with a finite value.
    pub num_finite: u64,
    /// Voxels that are NaN or ±Inf.
    pub num_nonfinite: u64,
    /// Smallest finite data value.
    pub min: f64,
    /// Largest finite data value.
    pub max: f64,
    /// Mean of the finite data values.
    pub mean: f64,
    /// Finite voxels in [`NUM_HISTOGRAM_BINS`] equal bins over `min..=max`; a constant volume is in bin 0.
    pub histogram: Vec<u64>,
    /// Otsu's threshold between background and foreground: the foreground is every finite value *above* it. A
    /// constant volume has its value here and counts as foreground all the same.
    pub background: f64,
    /// Voxels at or below the background; 0 for a constant volume.
    num_background: u64,
    /// Non-empty bins in ascending order of the value.
    bins: Vec<Bin>,
}

/// Voxels with neighboring values, of which only the bounds are known.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bin {
    low: f64,
    high: f64,
    /// Voxels in this bin and all before it.
    cumulative: u64,
}

impl Statistics {
    /// Counts the voxels of a volume, on all cores; the result does not depend on how many there are.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] on request.
    pub fn compute(volume: &Volume, progress: &Progress) -> Result<Self> {
        let rescale = volume.rescale;
        match &volume.voxels {
            Voxels::U8(v) => Self::compute_exact(v, 0, 1 << 8, rescale, progress),
            Voxels::I8(v) => Self::compute_exact(v, i32::from(i8::MIN), 1 << 8, rescale, progress),
            Voxels::U16(v) => Self::compute_exact(v, 0, 1 << 16, rescale, progress),
            Voxels::I16(v) => Self::compute_exact(v, i32::from(i16::MIN), 1 << 16, rescale, progress),
            Voxels::U32(v) => Self::compute_binned(v, rescale, progress),
            Voxels::I32(v) => Self::compute_binned(v, rescale, progress),
            Voxels::U64(v) => Self::compute_binned(v, rescale, progress),
            Voxels::I64(v) => Self::compute_binned(v, rescale, progress),
            Voxels::F32(v) => Self::compute_binned(v, rescale, progress),
            Voxels::F64(v) => Self::compute_binned(v, rescale, progress),
        }
    }

    /// The value that `p` percent of the finite voxels do not exceed: that of the voxel with this rank, not
    /// interpolated between two (0 gives the minimum, 100 the maximum, and `p` outside is clamped; NaN counts as 0).
    ///
    /// Exact for integers of up to 16 bits, for up to 131072 voxels and for values that more than 0.01 % of the
    /// voxels share; else the value is one whose rank is right to 0.01 % of the voxels.
    pub fn percentile(&self, p: f64) -> f64 {
        self.value_of_share(p, 0)
    }

    /// As [`Statistics::percentile`], over the voxels above the background only; 0 gives the smallest of them.
    pub fn percentile_above_background(&self, p: f64) -> f64 {
        self.value_of_share(p, self.num_background)
    }

    /// The percent of the finite voxels whose value is at most `value`. The inverse of [`Statistics::percentile`] as far as
    /// there is one: a value that many voxels share has the percentile of the last of them, one that no voxel has that of the
    /// next smaller, and within the bins of wide types it is interpolated as there.
    ///
    /// Ascends with `value`; 0 below the minimum, for NaN and for a volume without a finite voxel, 100 from the maximum on.
    pub fn percentile_rank(&self, value: f64) -> f64 {
        self.share_of_value(value, 0)
    }

    /// As [`Statistics::percentile_rank`], over the voxels above the background only; 0 at and below the background.
    pub fn percentile_rank_above_background(&self, value: f64) -> f64 {
        self.share_of_value(value, self.num_background)
    }

    /// The percentile of a value among the voxels behind the first `skipped` in ascending order.
    fn share_of_value(&self, value: f64, skipped: u64) -> f64 {
        let count = self.num_finite - skipped;
        if count == 0 || value.is_nan() {
            return 0.0;
        }
        let i = self.bins.partition_point(|bin| bin.high < value);
        let Some(bin) = self.bins.get(i) else { return 100.0 };
        let before = if i == 0 { 0 } else { self.bins[i - 1].cumulative };
        let rank = if value < bin.low {
            before as f64
        } else if value >= bin.high {
            bin.cumulative as f64
        } else {
            // Rank k of the bin's n lies at (k − ½)/n, and its percentiles end at k/n: those half a rank below are its own.
            let num_voxels = (bin.cumulative - before) as f64;
            before as f64 + (unit_position(bin.low, bin.high)(value) * num_voxels).max(0.5)
        };
        100.0 * (rank - skipped as f64).max(0.0) / count as f64
    }

    /// Finite voxels above the background (all of a constant volume).
    pub fn num_above_background(&self) -> u64 {
        self.num_finite - self.num_background
    }

    /// The percentile among the voxels behind the first `skipped` in ascending order.
    fn value_of_share(&self, p: f64, skipped: u64) -> f64 {
        let count = self.num_finite - skipped;
        if count == 0 {
            return self.max;
        }
        let share = if p.is_nan() { 0.0 } else { p.clamp(0.0, 100.0) / 100.0 };
        // Counts are far below 2⁵³; a share such as 0.07 × 100 must not end up one rank too high.
        let rank = ((share * count as f64 * (1.0 - 1e-15)).ceil() as u64).clamp(1, count) + skipped;
        if rank == self.num_finite {
            return self.max;
        }
        if rank == 1 {
            return self.min;
        }
        let i = self.bins.partition_point(|bin| bin.cumulative < rank);
        let Some(bin) = self.bins.get(i) else { return self.max };
        let before = if i == 0 { 0 } else { self.bins[i - 1].cumulative };
        let t = ((rank - before) as f64 - 0.5) / (bin.cumulative - before) as f64;
        // Not low + (high - low)·t, which overflows for a bin that spans the whole of f64.
        let value = if bin.low == bin.high { bin.low } else { bin.low * (1.0 - t) + bin.high * t };
        value.clamp(bin.low, bin.high).clamp(self.min, self.max)
    }

    fn compute_exact<T: Voxel + Into<i32>>(
        voxels: &[T],
        lowest: i32,
        num_values: usize,
        rescale: Rescale,
        progress: &Progress,
    ) -> Result<Self> {
        progress.begin("statistics", voxels.len() as u64);
        let counts = fold_blocks(
            voxels,
            progress,
            || vec![0_u64; num_values],
            |counts, block| {
                for &v in block {
                    let v: i32 = v.into();
                    counts[(v - lowest) as usize] += 1;
                }
            },
            add_counts,
        )?
        .unwrap_or_default();
        let values = counts.iter().enumerate().filter(|(_, n)| **n > 0);
        let runs: Vec<_> = values
            .map(|(i, &n)| {
                let value = data_value(rescale, f64::from(lowest + i as i32));
                (value, value, n)
            })
            .collect();
        let bins = cumulate(runs, rescale);
        let mut statistics = Self::empty(0);
        let (Some(first), Some(last)) = (bins.first(), bins.last()) else { return Ok(statistics) };
        statistics.num_finite = last.cumulative;
        (statistics.min, statistics.max) = (first.low, last.high);
        let bin_of = histogram_bin(first.low, last.high);
        let (mut before, mut sum) = (0, 0.0);
        for bin in &bins {
            let count = bin.cumulative - before;
            before = bin.cumulative;
            statistics.histogram[bin_of(bin.low)] += count;
            sum += bin.low * count as f64;
        }
        statistics.set_mean(sum);
        statistics.bins = bins;
        statistics.find_background();
        Ok(statistics)
    }

    fn compute_binned<T: Ordered>(voxels: &[T], rescale: Rescale, progress: &Progress) -> Result<Self> {
        progress.begin("statistics", 3 * voxels.len() as u64);
        let scan = fold_blocks(voxels, progress, Scan::default, Scan::add, Scan::merge)?.unwrap_or_default();
        let mut statistics = Self::empty(scan.num_nonfinite);
        let Some((low, high)) = scan.range else { return Ok(statistics) };
        statistics.num_finite = voxels.len() as u64 - scan.num_nonfinite;
        (statistics.min, statistics.max) = data_range(rescale, low.to_f64(), high.to_f64());

        // Second pass: histogram, sums and coarse bins over the range of the keys.
        let first_key = low.key();
        let key_bits = u64::BITS - (high.key() - first_key).leading_zeros();
        let keys = CoarseKeys { first: first_key, shift: key_bits.saturating_sub(COARSE_BITS) };
        let num_coarse = keys.bin(high.key()) + 1;
        let bin_of = histogram_bin(statistics.min, statistics.max);
        let is_sorted = statistics.num_finite <= MAX_SORTED;
        let counted = fold_blocks(
            voxels,
            progress,
            || Counts { histogram: vec![0; NUM_HISTOGRAM_BINS], coarse: vec![0; num_coarse], ..Counts::default() },
            |counts, block| {
                let mut sum = 0.0;
                for &v in block.iter().filter(|v| v.is_finite()) {
                    let value = data_value(rescale, v.to_f64());
                    sum += value;
                    counts.histogram[bin_of(value)] += 1;
                    let key = v.key();
                    counts.coarse[keys.bin(key)] += 1;
                    if is_sorted {
                        counts.keys.push(key);
                    }
                }
                counts.block_sums.push(sum);
            },
            Counts::merge,
        )?
        .unwrap_or_default();
        statistics.histogram = counted.histogram;
        statistics.set_mean(counted.block_sums.iter().sum());

        let runs = if is_sorted {
            sorted_runs::<T>(counted.keys, rescale)
        } else if keys.shift == 0 {
            coarse_runs::<T>(&counted.coarse, keys, rescale)
        } else {
            fine_runs(voxels, &counted.coarse, keys, statistics.num_finite, rescale, progress)?
        };
        statistics.bins = cumulate(runs, rescale);
        statistics.find_background();
        Ok(statistics)
    }

    fn empty(num_nonfinite: u64) -> Self {
        Self {
            num_finite: 0,
            num_nonfinite,
            min: 0.0,
            max: 0.0,
            mean: 0.0,
            histogram: vec![0; NUM_HISTOGRAM_BINS],
            background: 0.0,
            num_background: 0,
            bins: Vec::new(),
        }
    }

    fn set_mean(&mut self, sum: f64) {
        let mean = sum / self.num_finite as f64;
        // A sum over f64's own range is worth no more than the middle of that range.
        let mean = if mean.is_finite() { mean } else { 0.5 * self.min + 0.5 * self.max };
        self.mean = mean.clamp(self.min, self.max);
    }

    /// Otsu's threshold over the bins: the split that maximizes the variance between the classes.
    fn find_background(&mut self) {
        (self.background, self.num_background) = (self.min, 0);
        if self.min == self.max {
            return;
        }
        let mut range = (self.percentile(OTSU_TAIL_PERCENT), self.percentile(100.0 - OTSU_TAIL_PERCENT));
        // A small object in front of a constant background is all in the tail.
        if range.0 == range.1 {
            range = (self.min, self.max);
        }
        let position = unit_position(range.0, range.1);
        let level = |bin: &Bin| position((0.5 * bin.low + 0.5 * bin.high).clamp(range.0, range.1));
        let counts = || {
            let before = std::iter::once(0).chain(self.bins.iter().map(|b| b.cumulative));
            self.bins.iter().zip(before).map(|(bin, before)| (bin, (bin.cumulative - before) as f64))
        };
        let total = self.num_finite as f64;
        let total_sum: f64 = counts().map(|(bin, n)| level(bin) * n).sum();
        let (mut sum, mut best) = (0.0, None);
        // Behind the last bin there is no foreground.
        for (i, (bin, n)) in counts().enumerate().take(self.bins.len() - 1) {
            sum += level(bin) * n;
            let below = bin.cumulative as f64;
            let above = total - below;
            let variance = below * above * ((total_sum - sum) / above - sum / below).powi(2);
            if best.is_none_or(|(v, _)| variance > v) {
                best = Some((variance, i));
            }
        }
        if let Some(bin) = best.and_then(|(_, i)| self.bins.get(i)) {
            (self.background, self.num_background) = (bin.high, bin.cumulative);
        }
    }
}

/// The data value of a finite stored number. Where the rescale overflows, the largest number stands in.
fn data_value(rescale: Rescale, stored: f64) -> f64 {
    rescale.value(stored).clamp(f64::MIN, f64::MAX)
}

/// Bounds of the data values from those of the stored numbers: a negative slope swaps them.
fn data_range(rescale: Rescale, low: f64, high: f64) -> (f64, f64) {
    let (a, b) = (data_value(rescale, low), data_value(rescale, high));
    (a.min(b), a.max(b))
}

/// Where a value lies between `min` (0) and `max` (1); NaN if they are equal.
fn unit_position(min: f64, max: f64) -> impl Fn(f64) -> f64 + Copy {
    // The range of f64 itself overflows; halving only then keeps denormals exact.
    let factor = if (max - min).is_finite() { 1.0 } else { 0.5 };
    let (low, range) = (min * factor, max * factor - min * factor);
    move |value| (value * factor - low) / range
}

fn histogram_bin(min: f64, max: f64) -> impl Fn(f64) -> usize + Copy {
    let position = unit_position(min, max);
    // NaN, of a constant volume, becomes 0.
    move |value| ((position(value) * NUM_HISTOGRAM_BINS as f64) as usize).min(NUM_HISTOGRAM_BINS - 1)
}

/// Folds blocks on all cores: one accumulator per thread, not per block, as they are large.
fn fold_blocks<T: Sync, A: Send>(
    voxels: &[T],
    progress: &Progress,
    init: impl Fn() -> A + Sync,
    add: impl Fn(&mut A, &[T]) + Sync,
    merge: impl Fn(A, A) -> A + Sync,
) -> Result<Option<A>> {
    let blocks_per_thread = voxels.len().div_ceil(BLOCK).div_ceil(rayon::current_num_threads()).max(1);
    let pieces: Result<Vec<A>> = voxels
        .par_chunks(blocks_per_thread * BLOCK)
        .map(|piece| {
            let mut accumulator = init();
            for block in piece.chunks(BLOCK) {
                add(&mut accumulator, block);
                progress.advance(block.len() as u64)?;
            }
            Ok(accumulator)
        })
        .collect();
    Ok(pieces?.into_iter().reduce(merge))
}

fn add_counts(mut a: Vec<u64>, b: Vec<u64>) -> Vec<u64> {
    a.iter_mut().zip(&b).for_each(|(a, b)| *a += b);
    a
}

/// Range and missing voxels, as stored.
struct Scan<T> {
    range: Option<(T, T)>,
    num_nonfinite: u64,
}

impl<T> Default for Scan<T> {
    fn default() -> Self {
        Self { range: None, num_nonfinite: 0 }
    }
}

impl<T: Voxel> Scan<T> {
    fn add(&mut self, block: &[T]) {
        /// Independent extremes that the compiler keeps in vector registers.
        const LANES: usize = 32;
        let Some(&first) = block.iter().find(|v| v.is_finite()) else {
            self.num_nonfinite += block.len() as u64;
            return;
        };
        let (mut low, mut high, mut missing) = ([first; LANES], [first; LANES], [0_u32; LANES]);
        let (lanes, rest) = block.as_chunks::<LANES>();
        for values in lanes {
            for i in 0..LANES {
                let is_finite = values[i].is_finite();
                // Without a branch, a missing value stands for one that is known.
                let v = if is_finite { values[i] } else { first };
                low[i] = if v < low[i] { v } else { low[i] };
                high[i] = if v > high[i] { v } else { high[i] };
                missing[i] += u32::from(!is_finite);
            }
        }
        self.num_nonfinite += missing.iter().map(|&n| u64::from(n)).sum::<u64>();
        for &v in rest {
            if v.is_finite() {
                low[0] = if v < low[0] { v } else { low[0] };
                high[0] = if v > high[0] { v } else { high[0] };
            } else {
                self.num_nonfinite += 1;
            }
        }
        for i in 0..LANES {
            self.include(low[i], high[i]);
        }
    }

    fn include(&mut self, low: T, high: T) {
        let (a, b) = self.range.unwrap_or((low, high));
        self.range = Some((if low < a { low } else { a }, if high > b { high } else { b }));
    }

    fn merge(mut self, other: Self) -> Self {
        if let Some((low, high)) = other.range {
            self.include(low, high);
        }
        self.num_nonfinite += other.num_nonfinite;
        self
    }
}

/// A stored number with a key that sorts as it does.
trait Ordered: Voxel {
    /// Unsigned, ascending with the number; -0 and +0 share one.
    fn key(self) -> u64;
    /// The number of a key.
    fn from_key(key: u64) -> f64;
}

macro_rules! impl_ordered {
    ($($t:ty: $key:ident => $to:expr, $from:expr;)*) => {
        $(impl Ordered for $t {
            fn key(self) -> u64 { let $key = self; $to }
            fn from_key($key: u64) -> f64 { $from }
        })*
    };
}

const SIGN_32: u32 = 1 << 31;
const SIGN_64: u64 = 1 << 63;

impl_ordered! {
    u32: k => u64::from(k), k as f64;
    i32: k => u64::from(k.cast_unsigned() ^ SIGN_32), f64::from((k as u32 ^ SIGN_32).cast_signed());
    u64: k => k, k as f64;
    i64: k => k.cast_unsigned() ^ SIGN_64, (k ^ SIGN_64).cast_signed() as f64;
    // Floats sort by their bits once the negative ones are inverted; adding 0 turns -0 into +0.
    f32: k => {
        let bits = (k + 0.0).to_bits();
        u64::from(if bits & SIGN_32 == 0 { bits | SIGN_32 } else { !bits })
    }, {
        let bits = k as u32;
        f64::from(f32::from_bits(if bits & SIGN_32 == 0 { !bits } else { bits & !SIGN_32 }))
    };
    f64: k => {
        let bits = (k + 0.0).to_bits();
        if bits & SIGN_64 == 0 { bits | SIGN_64 } else { !bits }
    }, f64::from_bits(if k & SIGN_64 == 0 { !k } else { k & !SIGN_64 });
}

/// At most 2¹⁶ equal bins of keys from the first one on.
#[derive(Clone, Copy)]
struct CoarseKeys {
    first: u64,
    shift: u32,
}

impl CoarseKeys {
    fn bin(self, key: u64) -> usize {
        ((key - self.first) >> self.shift) as usize
    }
}

#[derive(Default)]
struct Counts {
    histogram: Vec<u64>,
    coarse: Vec<u64>,
    keys: Vec<u64>,
    block_sums: Vec<f64>,
}

impl Counts {
    fn merge(mut self, mut other: Self) -> Self {
        self.histogram = add_counts(self.histogram, other.histogram);
        self.coarse = add_counts(self.coarse, other.coarse);
        self.keys.append(&mut other.keys);
        self.block_sums.append(&mut other.block_sums);
        self
    }
}

/// Lowest and highest data value of a bin and its voxels, in ascending order of the stored number.
type Run = (f64, f64, u64);

fn sorted_runs<T: Ordered>(mut keys: Vec<u64>, rescale: Rescale) -> Vec<Run> {
    keys.sort_unstable();
    keys.chunk_by(|a, b| a == b)
        .map(|run| {
            let value = data_value(rescale, T::from_key(run[0]));
            (value, value, run.len() as u64)
        })
        .collect()
}

fn coarse_runs<T: Ordered>(counts: &[u64], keys: CoarseKeys, rescale: Rescale) -> Vec<Run> {
    let used = counts.iter().enumerate().filter(|(_, n)| **n > 0);
    used.map(|(i, &n)| {
        let value = data_value(rescale, T::from_key(keys.first + i as u64));
        (value, value, n)
    })
    .collect()
}

/// Third pass: every coarse bin is divided so that no fine one has more than about 2⁻¹⁵ of all voxels, and the
/// rest of a budget of 2¹⁷ bins goes to all of them alike.
fn fine_runs<T: Ordered>(
    voxels: &[T],
    coarse: &[u64],
    keys: CoarseKeys,
    num_finite: u64,
    rescale: Rescale,
    progress: &Progress,
) -> Result<Vec<Run>> {
    let num_used = coarse.iter().filter(|n| **n > 0).count().max(1);
    let least_bits = ((1_usize << (COARSE_BITS + 1)) / num_used).max(1).ilog2();
    // Per coarse bin: its first fine bin, and the shift of a key to the fine one.
    let mut places = Vec::with_capacity(coarse.len());
    let mut num_fine = 0_usize;
    for &count in coarse {
        let share = (count << (COARSE_BITS - 1)) / num_finite;
        let bits = if share == 0 { 0 } else { (share + 1).next_power_of_two().ilog2() };
        let bits = if count == 0 { 0 } else { bits.max(least_bits).min(keys.shift) };
        places.push((num_fine, keys.shift - bits));
        num_fine += usize::from(count > 0) << bits;
    }
    // Bounds that occur, not those of the bin: equal values stay what they are.
    let empty = FineBin { low: u64::MAX, high: 0, count: 0 };
    let bins = fold_blocks(
        voxels,
        progress,
        || vec![empty; num_fine],
        |bins, block| {
            for v in block.iter().filter(|v| v.is_finite()) {
                let key = v.key();
                let offset = key - keys.first;
                let coarse = offset >> keys.shift;
                let (first, shift) = places[coarse as usize];
                let bin = &mut bins[first + ((offset >> shift) - (coarse << (keys.shift - shift))) as usize];
                *bin = bin.merge(FineBin { low: key, high: key, count: 1 });
            }
        },
        |mut a, b| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a = a.merge(b));
            a
        },
    )?
    .unwrap_or_default();
    let value = |key| data_value(rescale, T::from_key(key));
    Ok(bins.iter().filter(|b| b.count > 0).map(|b| (value(b.low), value(b.high), b.count)).collect())
}

/// Lowest and highest key that fell into a bin, and how many did.
#[derive(Clone, Copy)]
struct FineBin {
    low: u64,
    high: u64,
    count: u64,
}

impl FineBin {
    fn merge(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high), count: self.count + other.count }
    }
}

/// Runs in ascending order of the stored number as bins in ascending order of the value.
fn cumulate(mut runs: Vec<Run>, rescale: Rescale) -> Vec<Bin> {
    if rescale.slope < 0.0 {
        runs.reverse();
    }
    let mut cumulative = 0;
    runs.into_iter()
        .map(|(a, b, count)| {
            cumulative += count;
            Bin { low: a.min(b), high: a.max(b), cumulative }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::spaces::Grid;

    fn volume(voxels: Voxels, rescale: Rescale) -> Volume {
        let grid = Grid::new([voxels.len(), 1, 1], DAffine3::IDENTITY).unwrap();
        Volume::new(grid, voxels, rescale, "test").unwrap()
    }

    fn compute(voxels: Voxels, rescale: Rescale) -> Statistics {
        let volume = volume(voxels, rescale);
        let statistics = Statistics::compute(&volume, &Progress::new()).unwrap();
        assert_eq!(statistics.histogram.len(), NUM_HISTOGRAM_BINS);
        assert_eq!(statistics.histogram.iter().sum::<u64>(), statistics.num_finite);
        statistics
    }

    /// Numbers without a pattern, from Weyl's sequence: uniform in 0..1.
    fn uniform(n: usize) -> impl Iterator<Item = f64> {
        (1..=n).map(|i| (i as f64 * 0.618_033_988_749_894_9).fract())
    }

    fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut sorted: Vec<f64> = values.filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        sorted
    }

    /// The definition of the percentile.
    fn percentile_of(sorted: &[f64], p: f64) -> f64 {
        sorted[((p / 100.0 * sorted.len() as f64).ceil() as usize).clamp(1, sorted.len()) - 1]
    }

    const PERCENTS: [f64; 11] = [0.0, 0.01, 1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0, 99.99, 100.0];

    #[test]
    fn every_type_agrees_with_sorting() {
        let stored: Vec<f64> = uniform(5000).map(|u| (u * u * 120.0).floor() + 1.0).collect();
        for rescale in [Rescale::IDENTITY, Rescale { slope: -2.5, intercept: 100.0 }] {
            let values = sorted(stored.iter().map(|&v| rescale.value(v)));
            let all = [
                Voxels::U8(stored.iter().map(|&v| v as u8).collect()),
                Voxels::I8(stored.iter().map(|&v| v as i8).collect()),
                Voxels::U16(stored.iter().map(|&v| v as u16).collect()),
                Voxels::I16(stored.iter().map(|&v| v as i16).collect()),
                Voxels::U32(stored.iter().map(|&v| v as u32).collect()),
                Voxels::I32(stored.iter().map(|&v| v as i32).collect()),
                Voxels::U64(stored.iter().map(|&v| v as u64).collect()),
                Voxels::I64(stored.iter().map(|&v| v as i64).collect()),
                Voxels::F32(stored.iter().map(|&v| v as f32).collect()),
                Voxels::F64(stored.clone()),
            ];
            let mut backgrounds = Vec::new();
            for voxels in all {
                let name = voxels.type_name();
                let s = compute(voxels, rescale);
                assert_eq!((s.num_finite, s.num_nonfinite), (5000, 0));
                assert!((s.mean - values.iter().sum::<f64>() / 5000.0).abs() < 1e-9);
                let above = sorted(values.iter().copied().filter(|&v| v > s.background));
                assert_eq!(s.num_above_background(), above.len() as u64);
                for p in PERCENTS {
                    assert_eq!(s.percentile(p), percentile_of(&values, p), "{name} {p}");
                    assert_eq!(s.percentile_above_background(p), percentile_of(&above, p), "{name} {p}");
                }
                backgrounds.push(s.background);
            }
            assert!(backgrounds.windows(2).all(|b| b[0] == b[1]), "{backgrounds:?}");
        }
    }

    #[test]
    fn ranks_invert_percentiles() {
        let s = compute(Voxels::U8((0..100).collect()), Rescale { slope: 2.0, intercept: -10.0 });
        assert_eq!(s.percentile_rank(-10.5), 0.0);
        assert_eq!(s.percentile_rank(-10.0), 1.0);
        assert_eq!(s.percentile_rank(-8.5), 1.0);
        assert_eq!(s.percentile_rank(500.0), 100.0);
        assert_eq!(s.percentile_rank_above_background(s.background), 0.0);
        assert_eq!(s.percentile_rank_above_background(s.max), 100.0);
        for p in [1.0, 25.0, 50.0, 99.0] {
            assert_eq!(s.percentile_rank(s.percentile(p)), p);
        }
        assert_eq!(compute(Voxels::F32(vec![f32::NAN; 3]), Rescale::IDENTITY).percentile_rank(0.0), 0.0);
    }

    /// Many voxels of a wide type, so that they are binned.
    fn check_binned(voxels: Voxels, values: impl Iterator<Item = f64>, rescale: Rescale) -> Statistics {
        let num_voxels = voxels.len();
        let s = compute(voxels, rescale);
        let values = sorted(values.map(|v| rescale.value(v)));
        assert_eq!((s.num_finite as usize, s.num_nonfinite as usize), (values.len(), num_voxels - values.len()));
        for p in PERCENTS {
            // The value of a rank at most 0.01 % off.
            let got = s.percentile(p);
            let (low, high) = (percentile_of(&values, p - 0.01), percentile_of(&values, p + 0.01));
            assert!((low..=high).contains(&got), "{p} %: {got} is not in {low}..={high}");
        }
        assert_eq!((s.percentile(0.0), s.percentile(100.0)), (s.min, s.max));
        let num_above = values.iter().filter(|&&v| v > s.background).count();
        assert_eq!(s.num_above_background() as usize, num_above);
        s
    }

    #[test]
    fn binned_floats_with_absurd_outliers() {
        let mut stored: Vec<f64> = uniform(400_000).map(|u| if u < 0.5 { 0.0 } else { 900.0 + 200.0 * u }).collect();
        stored[7] = 1e30;
        stored[8] = -1e30;
        stored[9] = f64::NAN;
        stored[10] = f64::NEG_INFINITY;
        stored[11] = 1e-40;
        for rescale in [Rescale::IDENTITY, Rescale { slope: -0.5, intercept: 10.0 }] {
            let single: Vec<f32> = stored.iter().map(|&v| v as f32).collect();
            let s = check_binned(Voxels::F32(single.clone()), single.iter().map(|&v| f64::from(v)), rescale);
            // Otsu does not see the outliers, and ties stay exact.
            assert!((s.num_above_background() as f64 - 200_000.0).abs() < 10.0, "{}", s.background);
            let tie = if rescale.slope > 0.0 { 25.0 } else { 75.0 };
            assert_eq!(s.percentile(tie), rescale.value(0.0));
            let s = check_binned(Voxels::F64(stored.clone()), stored.iter().copied(), rescale);
            assert_eq!(s.percentile(tie), rescale.value(0.0));
        }
    }

    #[test]
    fn binned_values_in_a_narrow_band() {
        // Differences in the last bits, as of times or large offsets.
        let stored: Vec<f64> = uniform(300_000).map(|u| 1e6 + 1e-6 * u).collect();
        check_binned(Voxels::F64(stored.clone()), stored.into_iter(), Rescale::IDENTITY);
        let mut wide: Vec<i64> = uniform(300_000).map(|u| (1 << 40) + (u * 1e7) as i64).collect();
        wide[0] = i64::MIN;
        wide[1] = i64::MAX;
        check_binned(Voxels::I64(wide.clone()), wide.iter().map(|&v| v as f64), Rescale::IDENTITY);
        let wide: Vec<i32> = uniform(300_000).map(|u| -1024 + (u * 4000.0) as i32).collect();
        let s = check_binned(Voxels::I32(wide.clone()), wide.iter().map(|&v| f64::from(v)), Rescale::IDENTITY);
        let values = sorted(wide.iter().map(|&v| f64::from(v)));
        for p in PERCENTS {
            assert_eq!(s.percentile(p), percentile_of(&values, p));
        }
    }

    #[test]
    fn ranks_invert_percentiles_whatever_the_type() {
        let integers = || uniform(5000).map(|u| (u * u * 120.0).floor() + 1.0);
        let down = Rescale { slope: -2.5, intercept: 100.0 };
        let humps = |n: usize| uniform(n).map(|u| if u < 0.5 { u } else { 900.0 + 200.0 * u });
        let all = [
            (Voxels::U8(integers().map(|v| v as u8).collect()), Rescale::IDENTITY),
            (Voxels::U16(integers().map(|v| 400 * v as u16).collect()), down),
            // Sorted, and binned; with values far from all others.
            (Voxels::F32(humps(5000).map(|v| v as f32).collect()), down),
            (Voxels::F32(humps(300_000).chain([1e30, -1e30, f64::NAN]).map(|v| v as f32).collect()), Rescale::IDENTITY),
            (Voxels::F64(humps(300_000).collect()), down),
            (Voxels::I64(uniform(300_000).map(|u| (1 << 40) + (u * 1e7) as i64).collect()), Rescale::IDENTITY),
        ];
        for (voxels, rescale) in all {
            let name = voxels.type_name();
            let all = volume(voxels, rescale);
            let s = Statistics::compute(&all, &Progress::new()).unwrap();
            let values = sorted((0..all.grid.num_voxels()).map(|i| all.value(i, 0, 0)));
            let above: Vec<f64> = values.iter().copied().filter(|&v| v > s.background).collect();
            let bin_of = |value: f64| s.bins.partition_point(|bin| bin.high < value);
            for i in (0..above.len()).step_by(97).chain([above.len() - 1]) {
                // The voxels that do not exceed it, counted; right to 0.01 % where they are binned.
                let value = above[i];
                let p = s.percentile_rank_above_background(value);
                let counted = 100.0 * above.partition_point(|&v| v <= value) as f64 / above.len() as f64;
                assert!((p - counted).abs() <= 0.01, "{name}: {value} is at {p} % and not {counted} %");
                assert_eq!(bin_of(s.percentile_above_background(p)), bin_of(value), "{name}: {value}");
            }
            for i in 0..=1000 {
                // Back to the percentile, but for the voxels that share the value or the bin.
                let p = 0.1 * f64::from(i);
                let value = s.percentile_above_background(p);
                let back = s.percentile_rank_above_background(value);
                let bin = bin_of(value);
                let share = s.bins[bin].cumulative - if bin == 0 { 0 } else { s.bins[bin - 1].cumulative };
                let tie = s.bins[bin].low == s.bins[bin].high;
                let off = 100.0 * if tie { share as f64 } else { 1.0 } / above.len() as f64 + 1e-9;
                assert!((p - off..=p + off).contains(&back), "{name}: {p} % became {back} %");
            }
            let (low, high) = (s.percentile(1.0), s.percentile(99.0));
            let line =
                (-100..=1100).map(|i| s.percentile_rank_above_background(low + 1e-3 * f64::from(i) * (high - low)));
            assert!(line.is_sorted(), "{name}: not monotone");
            assert_eq!(
                (s.percentile_rank_above_background(s.background), s.percentile_rank_above_background(s.max)),
                (0.0, 100.0)
            );
            assert_eq!(
                (
                    s.percentile_rank_above_background(f64::NEG_INFINITY),
                    s.percentile_rank_above_background(f64::INFINITY)
                ),
                (0.0, 100.0)
            );
            assert_eq!(s.percentile_rank_above_background(f64::NAN), 0.0);
        }
    }

    #[test]
    fn ranks_where_there_is_little_to_rank() {
        for voxels in [Voxels::I16(vec![-7; 99]), Voxels::F64(vec![-7.0; 99]), Voxels::F32(vec![-7.0; 200_000])] {
            let s = compute(voxels, Rescale::IDENTITY);
            assert_eq!(
                [-8.0, -7.0, -6.0, f64::NAN].map(|v| s.percentile_rank_above_background(v)),
                [0.0, 100.0, 100.0, 0.0]
            );
        }
        let none = compute(Voxels::F32(vec![f32::NAN, f32::INFINITY]), Rescale::IDENTITY);
        assert_eq!([-1.0, 0.0, 1.0, f64::NAN].map(|v| none.percentile_rank_above_background(v)), [0.0; 4]);
        // Background 0; of the four above it, one each at 110 and 120 and two at 130. Between two values: the smaller one's.
        let s = compute(Voxels::U8([vec![0; 100], vec![130, 110, 130, 120]].concat()), Rescale::IDENTITY);
        assert_eq!(s.background, 0.0);
        let values = [0.0, 109.9, 110.0, 115.0, 120.0, 129.0, 130.0, 131.0];
        assert_eq!(
            values.map(|v| s.percentile_rank_above_background(v)),
            [0.0, 0.0, 25.0, 25.0, 50.0, 50.0, 100.0, 100.0]
        );
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let stored: Vec<f32> = uniform(500_000).map(|u| (1000.0 * u) as f32 - 300.0).collect();
        let volume = volume(Voxels::F32(stored), Rescale { slope: 0.1, intercept: 3.0 });
        let with_threads = |n| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            format!("{:?}", pool.install(|| Statistics::compute(&volume, &Progress::new())).unwrap())
        };
        let one = with_threads(1);
        assert!(one == with_threads(2) && one == with_threads(5));
    }

    #[test]
    fn nothing_finite_and_nothing_but_one_value() {
        let none = compute(Voxels::F32(vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY]), Rescale::IDENTITY);
        assert_eq!((none.num_finite, none.num_nonfinite), (0, 3));
        assert_eq!((none.min, none.max, none.mean, none.background), (0.0, 0.0, 0.0, 0.0));
        assert_eq!((none.percentile(50.0), none.percentile_above_background(50.0)), (0.0, 0.0));
        for voxels in [Voxels::I16(vec![-7; 99]), Voxels::F64(vec![-7.0; 99]), Voxels::F32(vec![-7.0; 200_000])] {
            let s = compute(voxels, Rescale::IDENTITY);
            assert_eq!((s.min, s.max, s.mean, s.background), (-7.0, -7.0, -7.0, -7.0));
            assert_eq!(s.num_above_background(), s.num_finite);
            assert_eq!((s.percentile(0.0), s.percentile_above_background(30.0)), (-7.0, -7.0));
        }
    }

    #[test]
    fn the_ends_of_the_number_range() {
        for voxels in [
            Voxels::F64(vec![f64::MAX, f64::MIN, 0.0, -0.0]),
            Voxels::F64(vec![5e-324, 0.0, 1e-323, 2e-323]),
            Voxels::F32(vec![f32::MAX, f32::MIN, 1e-45, -1e-45]),
            Voxels::U64(vec![u64::MAX, 0, 1, 2]),
        ] {
            let s = compute(voxels, Rescale::IDENTITY);
            assert!(s.mean.is_finite() && (s.min..=s.max).contains(&s.mean));
            assert!(s.percentile(50.0).is_finite() && s.background < s.max);
        }
        // A rescale that overflows is held at the largest number.
        let s = compute(Voxels::F64(vec![1e300, -1e300, 1.0]), Rescale { slope: 1e200, intercept: 0.0 });
        assert_eq!((s.min, s.max), (f64::MIN, f64::MAX));
    }

    #[test]
    fn otsu_separates_two_humps_and_small_objects() {
        let humps: Vec<u16> = uniform(10_000)
            .enumerate()
            .map(|(i, u)| (if i % 3 == 0 { 3000.0 + 400.0 * u } else { 100.0 + 300.0 * u }) as u16)
            .collect();
        let s = compute(Voxels::U16(humps), Rescale { slope: 1.0, intercept: -1024.0 });
        assert_eq!((s.num_above_background(), s.background), (3334, 399.0 - 1024.0));
        let mut small = vec![0_u8; 100_000];
        small[5] = 200;
        small[6] = 201;
        let s = compute(Voxels::U8(small), Rescale::IDENTITY);
        assert_eq!((s.background, s.num_above_background(), s.percentile_above_background(0.0)), (0.0, 2, 200.0));
    }

    #[test]
    fn cancelling_stops() {
        let progress = Progress::new();
        progress.cancel();
        for voxels in [Voxels::U8(vec![1; 10]), Voxels::F32(vec![1.0; 10])] {
            let result = Statistics::compute(&volume(voxels, Rescale::IDENTITY), &progress);
            assert!(matches!(result, Err(crate::Error::Cancelled)));
        }
    }
}
