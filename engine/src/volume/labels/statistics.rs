//! Where the structures of a label map lie and how large they are.

use glam::DVec3;
use rayon::prelude::*;

use super::LabelMap;
use crate::volume::{Volume, Voxel as _};
use crate::with_voxels;

/// Size and place of a structure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StructureStatistics {
    /// Voxels that belong to it.
    pub num_voxels: u64,
    /// Their volume in milliliters.
    pub volume_ml: f64,
    /// Its first and last voxel along x, y, z of the grid; `None` for a structure without voxels.
    pub index_box: Option<[[usize; 3]; 2]>,
    /// Smallest and largest R, A, S, in mm, of the corners of that box of voxels: on an oblique grid more than the structure.
    pub box_mm: Option<[DVec3; 2]>,
    /// The mean position of its voxels, RAS mm.
    pub centroid_mm: Option<DVec3>,
}

/// What is summed up for a structure.
#[derive(Clone, Copy)]
struct Sums {
    count: u64,
    /// Of the voxels' indices.
    index: [u64; 3],
    first: [usize; 3],
    last: [usize; 3],
}

impl Sums {
    const NONE: Self = Self { count: 0, index: [0; 3], first: [usize::MAX; 3], last: [0; 3] };

    /// The voxels `x .. x + n` of a row.
    fn add_run(&mut self, [x, y, z]: [usize; 3], n: usize) {
        self.count += n as u64;
        let of_run = [n * x + n * (n - 1) / 2, n * y, n * z];
        (0..3).for_each(|i| self.index[i] += of_run[i] as u64);
        self.extend([x, y, z], [x + n - 1, y, z]);
    }

    fn extend(&mut self, first: [usize; 3], last: [usize; 3]) {
        for i in 0..3 {
            self.first[i] = self.first[i].min(first[i]);
            self.last[i] = self.last[i].max(last[i]);
        }
    }

    fn merge(&mut self, other: &Self) {
        self.count += other.count;
        (0..3).for_each(|i| self.index[i] += other.index[i]);
        self.extend(other.first, other.last);
    }
}

impl LabelMap {
    /// How many voxels each of [`LabelMap::labels`] has, in their order.
    pub fn counts(&self) -> Vec<u64> {
        self.sums().iter().map(|s| s.count).collect()
    }

    /// Size and place of each of [`LabelMap::labels`], in their order. Slices are summed up in parallel.
    pub fn statistics(&self) -> Vec<StructureStatistics> {
        let affine = self.grid.world_from_index();
        let voxel_ml = affine.matrix3.determinant().abs() / 1000.0;
        let statistics = |s: &Sums| {
            let is_used = s.count > 0;
            let at = |index: [usize; 3]| DVec3::from_array(index.map(|i| i as f64));
            let box_mm = || {
                let corners = self.grid.box_corners_mm(at(s.first) - 0.5, at(s.last) + 0.5);
                let [min, max] = [DVec3::min, DVec3::max].map(|f| corners.into_iter().reduce(f).unwrap_or_default());
                [min, max]
            };
            let mean = || DVec3::from_array(s.index.map(|i| i as f64 / s.count as f64));
            StructureStatistics {
                num_voxels: s.count,
                volume_ml: s.count as f64 * voxel_ml,
                index_box: is_used.then_some([s.first, s.last]),
                box_mm: is_used.then(box_mm),
                centroid_mm: is_used.then(|| affine.transform_point3(mean())),
            }
        };
        self.sums().iter().map(statistics).collect()
    }

    fn sums(&self) -> Vec<Sums> {
        let [nx, ny, nz] = self.grid.dims();
        let none = || vec![Sums::NONE; self.labels.len()];
        let slices = self.voxels.par_chunks(nx * ny).enumerate().with_min_len(nz.div_ceil(64));
        let add_slice = |mut sums: Vec<Sums>, (z, slice): (usize, &[u16])| {
            for (y, row) in slice.chunks(nx).enumerate() {
                let mut x = 0;
                for run in row.chunk_by(|a, b| a == b) {
                    if let Some(of_structure) = sums.get_mut(usize::from(run[0])) {
                        of_structure.add_run([x, y, z], run.len());
                    }
                    x += run.len();
                }
            }
            sums
        };
        slices.fold(none, add_slice).reduce(none, |mut a, b| {
            a.iter_mut().zip(&b).for_each(|(a, b)| a.merge(b));
            a
        })
    }

    /// The mean of a scan on the same grid in each of [`LabelMap::labels`], in data values; `None` for a structure without
    /// finite voxels.
    ///
    /// # Errors
    /// A clause if the scan has not as many voxels along x, y, z.
    pub fn means(&self, scan: &Volume) -> Result<Vec<Option<f64>>, String> {
        if scan.grid.dims() != self.grid.dims() {
            return Err("the label map and the scan have different grids".to_owned());
        }
        let mut sums = vec![(0.0, 0_u64); self.labels.len()];
        with_voxels!(&scan.voxels, stored => {
            for (structure, value) in self.voxels.iter().zip(stored) {
                if let Some((sum, count)) = sums.get_mut(usize::from(*structure)).filter(|_| value.is_finite()) {
                    *sum += value.to_f64();
                    *count += 1;
                }
            }
        });
        Ok(sums.iter().map(|&(sum, n)| (n > 0).then(|| scan.rescale.value(sum / n as f64))).collect())
    }
}
