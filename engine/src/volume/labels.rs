//! Label maps: which structure each voxel belongs to, with the structures' names and colors.

use crate::spaces::Grid;

/// One structure of a label map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// The number that the file uses for it.
    pub id: u32,
    /// Its name ("skull").
    pub name: String,
    /// sRGB color, for tables and as a first tint.
    pub color: [u8; 3],
}

/// A partition of a grid into structures.
#[derive(Clone, Debug)]
pub struct LabelMap {
    /// Size and place in the world.
    pub grid: Grid,
    /// Per voxel, x fastest: the position in [`LabelMap::labels`] (not the id: ids may exceed 16 bits).
    pub voxels: Vec<u16>,
    /// The structures; entry 0 is what belongs to none.
    pub labels: Vec<Label>,
}
