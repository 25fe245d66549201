//! Label maps: which structure each voxel belongs to, with the structures' names and colors.

mod layers;
mod place;
mod resample;
mod statistics;
mod table;

use std::collections::HashMap;
use std::f64::consts::TAU;

pub use layers::LayerBuilder;
pub use resample::{resample_layers, same_grid};
pub use statistics::StructureStatistics;
pub use table::{LabelTable, LabelTableEntry};

use super::{Volume, Voxel as _};
use crate::color::srgb8_from_linear;
use crate::spaces::Grid;
use crate::with_voxels;

/// One structure of a label map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// The number that the file uses for it; structures in different layers of one file may have the same.
    pub id: u32,
    /// Its name ("skull").
    pub name: String,
    /// sRGB color, for tables and as a first tint.
    pub color: [u8; 3],
    /// What it is called in a terminology, as "SCHEME:CODE" ("SCT:10200004" for the liver), where the file says so; with
    /// what tells it from others of its type, as "SCT:64033007+SCT:7771000" for a left kidney.
    pub code: Option<String>,
}

/// A partition of a grid into structures.
#[derive(Clone, Debug)]
pub struct LabelMap {
    /// Size and place in the world.
    pub grid: Grid,
    /// Per voxel, x fastest: the position in [`LabelMap::labels`] (not the id: ids may exceed 16 bits).
    pub voxels: Vec<u16>,
    /// The structures; entry 0 is what belongs to none. Some may have no voxels.
    pub labels: Vec<Label>,
    /// What the user should know about how it was read, a sentence each.
    pub notes: Vec<String>,
}

impl LabelMap {
    /// The numbers of an integer volume, its rescale applied, as structures that are called by them: "7". 0 is none of them.
    ///
    /// # Errors
    /// A clause if a number is no integer from 0 to 2³² − 1, or if there are more than 65 535 of them.
    pub fn from_volume(volume: &Volume) -> Result<Self, String> {
        let mut position_of = HashMap::from([(0_u32, 0_u16)]);
        let mut voxels = Vec::with_capacity(volume.grid.num_voxels());
        with_voxels!(&volume.voxels, stored => {
            // Neighbors are mostly alike.
            let mut last = (f64::NAN, 0);
            for number in stored.iter().map(|s| volume.rescale.value(s.to_f64())) {
                if number != last.0 {
                    let id = number as u32;
                    if f64::from(id) != number {
                        return Err(format!("a voxel is {number}, which numbers no structure"));
                    }
                    let next = position_of.len();
                    let position = *position_of.entry(id).or_insert(next as u16);
                    if next > usize::from(u16::MAX) {
                        return Err("it has more than 65 535 different numbers: this is no label map".to_owned());
                    }
                    last = (number, position);
                }
                voxels.push(last.1);
            }
        });
        let mut ids: Vec<(u32, u16)> = position_of.into_iter().collect();
        ids.sort_unstable();
        let mut order = vec![0; ids.len()];
        ids.iter().zip(0..).for_each(|(&(_, found), sorted)| order[usize::from(found)] = sorted);
        voxels.iter_mut().for_each(|v| *v = order[usize::from(*v)]);
        let label = |&(id, _): &(u32, u16)| if id == 0 { background() } else { numbered(id) };
        let labels = ids.iter().map(label).collect();
        Ok(Self { grid: volume.grid, voxels, labels, notes: volume.warnings.clone() })
    }
}

/// The entry for what belongs to no structure.
pub(crate) fn background() -> Label {
    Label { id: 0, name: "background".to_owned(), color: [0; 3], code: None }
}

/// A structure of which only the number is known.
pub(crate) fn numbered(id: u32) -> Label {
    Label { id, name: id.to_string(), color: distinct_color(id), code: None }
}

/// A color for a structure of which only the number is known: equally light and colorful (OKLCH), beginning with a warm one,
/// neighboring numbers with hues far apart (the golden angle) in three steps of lightness; 0 is black.
pub fn distinct_color(id: u32) -> [u8; 3] {
    if id == 0 {
        return [0; 3];
    }
    let turns = (f64::from(id - 1) * 0.618_033_988_749_895 + 0.125).fract();
    let (sin, cos) = (turns * TAU).sin_cos();
    let (light, chroma) = [(0.78, 0.11), (0.70, 0.12), (0.86, 0.09)][(id as usize - 1) % 3];
    let (a, b) = (chroma * cos, chroma * sin);
    // B. Ottosson, A perceptual color space for image processing, 2020.
    let [l, m, s] = [
        light + 0.396_337_777_4 * a + 0.215_803_757_3 * b,
        light - 0.105_561_345_8 * a - 0.063_854_172_8 * b,
        light - 0.089_484_177_5 * a - 1.291_485_548 * b,
    ]
    .map(|x| x * x * x);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701 * s,
    ]
    .map(|x| srgb8_from_linear(x.clamp(0.0, 1.0) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighboring_numbers_have_colors_that_one_tells_apart() {
        let colors: Vec<_> = (1..=117).map(distinct_color).collect();
        for (i, a) in colors.iter().enumerate() {
            assert!(a.iter().max().unwrap() > &120, "{a:?} is dark");
            for b in &colors[i + 1..(i + 8).min(colors.len())] {
                let apart: i32 = a.iter().zip(b).map(|(x, y)| (i32::from(*x) - i32::from(*y)).abs()).sum();
                assert!(apart > 25, "{a:?} and {b:?}");
            }
        }
        assert_eq!(distinct_color(0), [0; 3]);
        distinct_color(u32::MAX);
    }
}
