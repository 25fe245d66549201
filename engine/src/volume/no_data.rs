//! Voxels that are no number (NaN, ±Inf): what stands in for them, and where they are.

use std::borrow::Cow;

use rayon::prelude::*;

use super::{Volume, Voxel, Voxels};

/// A volume's voxels with every gap filled, as all interpolation reads them.
#[derive(Debug)]
pub struct Filled<'a> {
    /// The stored numbers; a voxel without data carries the smallest finite value of its 26 neighbors, else the
    /// smallest of the volume (0 if there is none at all).
    pub voxels: Cow<'a, Voxels>,
    /// Per voxel whether it has data (255) or not (0); absent where all have.
    pub valid: Option<Vec<u8>>,
}

impl Filled<'_> {
    /// Number of voxels without data.
    pub fn num_gaps(&self) -> usize {
        self.valid.as_ref().map_or(0, |v| v.iter().filter(|&&b| b == 0).count())
    }
}

/// Fills the gaps; borrows the voxels where there is none, which is the case for every integer type.
pub fn fill_no_data(volume: &Volume) -> Filled<'_> {
    match &volume.voxels {
        Voxels::F32(v) => match fill(v, volume) {
            Some((filled, valid)) => Filled { voxels: Cow::Owned(Voxels::F32(filled)), valid: Some(valid) },
            None => Filled { voxels: Cow::Borrowed(&volume.voxels), valid: None },
        },
        Voxels::F64(v) => match fill(v, volume) {
            Some((filled, valid)) => Filled { voxels: Cow::Owned(Voxels::F64(filled)), valid: Some(valid) },
            None => Filled { voxels: Cow::Borrowed(&volume.voxels), valid: None },
        },
        _ => Filled { voxels: Cow::Borrowed(&volume.voxels), valid: None },
    }
}

fn fill<T: Voxel + Default>(stored: &[T], volume: &Volume) -> Option<(Vec<T>, Vec<u8>)> {
    if stored.par_iter().all(|v| v.is_finite()) {
        return None;
    }
    // "Smallest" means smallest data value, which a negative slope turns around.
    let smaller = |a: T, b: T| if (a < b) == (volume.rescale.slope > 0.0) { a } else { b };
    let finite = |v: &T| v.is_finite().then_some(*v);
    let least = stored.par_iter().filter_map(finite).reduce_with(smaller).unwrap_or_default();
    let [nx, ny, nz] = volume.grid.dims();
    let mut filled = stored.to_vec();
    let mut valid = vec![255u8; stored.len()];
    for (i, v) in stored.iter().enumerate() {
        if v.is_finite() {
            continue;
        }
        let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
        let mut best: Option<T> = None;
        for zz in z.saturating_sub(1)..(z + 2).min(nz) {
            for yy in y.saturating_sub(1)..(y + 2).min(ny) {
                for xx in x.saturating_sub(1)..(x + 2).min(nx) {
                    if let Some(n) = finite(&stored[xx + nx * (yy + ny * zz)]) {
                        best = Some(best.map_or(n, |b| smaller(b, n)));
                    }
                }
            }
        }
        filled[i] = best.unwrap_or(least);
        valid[i] = 0;
    }
    Some((filled, valid))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spaces::Grid;
    use crate::volume::Rescale;

    #[test]
    fn gaps_take_their_smallest_neighbor() {
        let mut v = vec![5.0f32; 27];
        v[13] = f32::NAN;
        v[0] = 2.0;
        let grid = Grid::new([3, 3, 3], glam::DAffine3::IDENTITY).unwrap();
        for (slope, expected) in [(1.0, 2.0), (-1.0, 5.0)] {
            let rescale = Rescale { slope, intercept: 0.0 };
            let volume = Volume::new(grid, Voxels::F32(v.clone()), rescale, "test").unwrap();
            let filled = fill_no_data(&volume);
            assert_eq!(filled.num_gaps(), 1);
            let Voxels::F32(f) = filled.voxels.as_ref() else { panic!() };
            assert_eq!(f[13], expected);
        }
    }

    #[test]
    fn nothing_but_gaps_is_zero() {
        let grid = Grid::new([2, 1, 1], glam::DAffine3::IDENTITY).unwrap();
        let gaps = Voxels::F64(vec![f64::NAN, f64::INFINITY]);
        let volume = Volume::new(grid, gaps, Rescale::IDENTITY, "test").unwrap();
        let filled = fill_no_data(&volume);
        assert_eq!(filled.num_gaps(), 2);
        assert_eq!(filled.voxels.as_ref(), &Voxels::F64(vec![0.0, 0.0]));
    }
}
