//! Which structure is at a place.

use glam::DVec3;

use super::{Label, LabelMap};

impl LabelMap {
    /// The structure at a place in the world (RAS mm): of the eight voxels around it, the one that most of them belong to, as
    /// interpolation weighs them. Where a surface is seen, half of them belong to none: these do not count. `None` where no
    /// structure is near.
    pub fn label_at(&self, position_mm: DVec3) -> Option<&Label> {
        let p = self.grid.index_from_world().transform_point3(position_mm);
        if !p.is_finite() {
            return None;
        }
        let dims = self.grid.dims();
        let low = p.floor();
        let share = (p - low).to_array();
        let mut weights: Vec<(u16, f64)> = Vec::with_capacity(8);
        for corner in 0..8_usize {
            let bits: [usize; 3] = std::array::from_fn(|axis| corner >> axis & 1);
            // Beyond the outermost voxels their values go on.
            let at: [usize; 3] =
                std::array::from_fn(|i| (low[i] + bits[i] as f64).clamp(0.0, (dims[i] - 1) as f64) as usize);
            let weight: f64 = (0..3).map(|i| if bits[i] == 1 { share[i] } else { 1.0 - share[i] }).product();
            let position = self.voxels[at[0] + dims[0] * (at[1] + dims[1] * at[2])];
            match weights.iter_mut().find(|(known, _)| *known == position) {
                Some((_, sum)) => *sum += weight,
                None => weights.push((position, weight)),
            }
        }
        let structures = weights.into_iter().filter(|(position, weight)| *position > 0 && *weight > 0.0);
        let (most, _) = structures.max_by(|a, b| a.1.total_cmp(&b.1))?;
        self.labels.get(usize::from(most))
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3};

    use super::super::{background, numbered};
    use super::*;
    use crate::spaces::Grid;

    #[test]
    fn a_place_has_the_structure_that_most_of_it_belongs_to() {
        // Voxels of 2 mm along x: none, 5, 5, 9; x runs to the left.
        let affine = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-2.0, 1.0, 1.0)));
        let map = LabelMap {
            grid: Grid::new([4, 1, 1], affine).unwrap(),
            voxels: vec![0, 1, 1, 2],
            labels: vec![background(), numbered(5), numbered(9)],
            notes: Vec::new(),
        };
        let at = |x: f64| map.label_at(DVec3::new(-2.0 * x, 0.2, -0.3)).map(|label| label.id);
        assert_eq!(
            [-0.4, 0.0, 0.2, 1.0, 2.4, 2.6, 3.4, 99.0].map(at),
            [None, None, Some(5), Some(5), Some(5), Some(9), Some(9), Some(9)]
        );
        assert_eq!(map.label_at(DVec3::NAN), None);
    }
}
