//! Regions: selected parts of an object's volume that have a look of their own (docs/rendering.md §8).

use super::moved::{self, Moved};
use super::{Object, StyleTransferFunction};
use crate::error::{Error, Result};
use crate::selection::Selection;
use crate::volume::labels::same_grid;

/// How the part of a volume is drawn that belongs to a region.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Value → style and opacity.
    pub transfer_function: StyleTransferFunction,
    /// Linear RGB, 0 to 1, that takes the place of the styles' own colors, which are left as its light: their luminance.
    pub tint: Option<[f32; 3]>,
    /// Factor, 0 to 1, of the opacity of a reference length: at 0 the part is cut out.
    pub opacity: f64,
}

impl Look {
    /// That of a transfer function alone.
    pub fn plain(transfer_function: StyleTransferFunction) -> Self {
        Self { transfer_function, tint: None, opacity: 1.0 }
    }

    /// Largest opacity of any value in `low..=high`.
    pub fn max_opacity(&self, low: f64, high: f64) -> f64 {
        self.opacity * self.transfer_function.max_opacity(low, high)
    }
}

/// A selection of the object's volume. With the background, which is what no region has, the regions
/// share out the volume: where several want more of a voxel than there is, each gets its share.
#[derive(Clone, Debug)]
pub struct Region {
    /// What it is called, for messages.
    pub name: String,
    /// How much each voxel belongs to it, on the volume's grid.
    pub selection: Selection,
    /// How it is drawn.
    pub look: Look,
    /// Where it was moved to; none: it is drawn where it lies.
    pub moved: Option<Moved>,
}

/// Most regions of an object: a label map of 16 bits has no more structures, and no brick a longer list.
pub const MAX_REGIONS: usize = 65_535;

/// Different functions from value to opacity that an object may have, its background's and all rows included: each is a megabyte on the
/// adapter and a bit of the shader's mask. Styles and tints do not count.
pub const MAX_OPACITY_FUNCTIONS: usize = 32;

pub(super) fn validate(object: &Object) -> Result<()> {
    if object.regions.len() > MAX_REGIONS {
        return Err(Error::scene(
            format!("the object has {} regions, and {MAX_REGIONS} is the most", object.regions.len()),
            "join some of them",
        ));
    }
    for region in &object.regions {
        let fail =
            |what: String, remedy: &str| Err(Error::scene(format!("the region \"{}\" {what}", region.name), remedy));
        let (own, grid) = (region.selection.grid(), &object.volume.grid);
        if !same_grid(own, grid) {
            let [a, b] = [own.dims(), grid.dims()].map(|d| format!("{} x {} x {}", d[0], d[1], d[2]));
            return fail(
                format!("selects voxels of another grid ({a}) than the volume's ({b})"),
                "resample the selection onto the volume",
            );
        }
        for look in std::iter::once(&region.look).chain(region.moved.as_ref().map(|moved| &moved.ghost)) {
            if !(0.0..=1.0).contains(&look.opacity) {
                return fail(format!("has an opacity of {}", look.opacity), "choose one from 0 to 1");
            }
            if look.tint.is_some_and(|tint| tint.iter().any(|c| !(0.0..=1.0).contains(c))) {
                return fail(format!("has a tint of {:?}", look.tint.unwrap_or_default()), "choose colors from 0 to 1");
            }
        }
    }
    moved::validate(object)?;
    let mut functions: Vec<StyleTransferFunction> = Vec::new();
    for function in object.transfer_functions().flat_map(StyleTransferFunction::rows) {
        if !functions.iter().any(|f| f.same_opacity(&function)) {
            functions.push(function);
        }
    }
    if functions.len() > MAX_OPACITY_FUNCTIONS {
        return Err(Error::scene(
            format!(
                "the object has {} different opacity functions, and {MAX_OPACITY_FUNCTIONS} is the most",
                functions.len()
            ),
            "let regions share their nodes' values and opacities; styles, tints and the region's opacity are free",
        ));
    }
    Ok(())
}
