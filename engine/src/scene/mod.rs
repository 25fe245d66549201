//! The scene: plain, resolved data that the GPU passes and the f64 reference both read.
//! The studio makes it from a document; nothing in here knows files, templates or a window.

pub mod across;
pub mod camera;
pub mod lighting;
pub mod moved;
pub mod parts;
pub mod quality;
pub mod region;
pub mod transfer_function;

use std::sync::Arc;

use glam::DVec3;

pub use across::{Across, Axis, Row};
pub use camera::{Camera, Projection};
pub use lighting::{Light, LightFrame, Lighting, LightingMap, LightingTable};
pub use moved::{Body, Meeting, Meetings, Moved, Role};
pub use parts::{Cell, Cut, Part, Parts, Plane};
pub use quality::{Borders, Quality};
pub use region::{Look, Region};
pub use transfer_function::{Contours, StyleTransferFunction, TransferFunctionNode};

use crate::error::{Error, Result};
use crate::selection::DistanceField;
use crate::styles::StyleImage;
use crate::styles::pattern::Pattern;
use crate::volume::Volume;
use crate::volume::bricks::BRICK;

/// Everything that a picture depends on, but its size.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What is drawn. This stage of the raycaster draws at most one object (an empty scene is its background).
    pub objects: Vec<Object>,
    /// Lit-sphere images that the transfer functions refer to by position.
    pub styles: Vec<Arc<StyleImage>>,
    /// Where it is seen from.
    pub camera: Camera,
    /// What is behind it.
    pub background: Background,
    /// Accuracy settings.
    pub quality: Quality,
    /// Height of the picture on the page, mm: what widths in figure points are measured against.
    pub page_height_mm: f64,
}

/// A volume with its look.
#[derive(Clone, Debug)]
pub struct Object {
    /// The data; shared, so that a scene is cheap to make for each frame.
    pub volume: Arc<Volume>,
    /// Value → style and opacity, of what belongs to no region.
    pub transfer_function: StyleTransferFunction,
    /// Parts of the volume with looks of their own.
    pub regions: Vec<Region>,
    /// How surfaces are lit, if they are: styles then say only what color they have. None: styles are their light.
    pub lighting: Option<Lighting>,
    /// σ_g: standard deviation, in mm, of the Gaussian that smooths the copy which gradients are taken from;
    /// 0 = central differences of the volume itself.
    pub gradient_scale_mm: f64,
    /// Distances to surfaces that transfer functions go by, at most [`MAX_DISTANCES`].
    pub distances: Vec<Arc<DistanceField>>,
    /// What it is cut into.
    pub parts: Parts,
}

/// Most fields of distances of an object: the channels of a texture.
pub const MAX_DISTANCES: usize = 4;

/// What lies behind the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// Nothing: the picture has an alpha channel.
    Transparent,
    /// An opaque color, linear RGB.
    Color([f32; 3]),
}

/// Opacity below which a part of an object does not count when it is framed.
const FRAMED_OPACITY: f64 = 0.01;

impl Object {
    /// Smallest and largest data value of the volume.
    pub fn data_range(&self) -> (f64, f64) {
        let (a, b) = self.volume.bricks().range();
        let (a, b) = (self.volume.rescale.value(a), self.volume.rescale.value(b));
        (a.min(b), a.max(b))
    }

    /// The transfer functions of the background, of all regions, and of the ghosts of moved ones.
    pub fn transfer_functions(&self) -> impl Iterator<Item = &StyleTransferFunction> {
        let of_regions = self.regions.iter().flat_map(|region| {
            let ghost = region.moved().map(|moved| &moved.ghost.transfer_function);
            std::iter::once(&region.look.transfer_function).chain(ghost)
        });
        std::iter::once(&self.transfer_function).chain(of_regions)
    }

    /// Whether any of its transfer functions has a second coordinate.
    pub fn has_rows(&self) -> bool {
        self.transfer_functions().any(|f| f.across.is_some())
    }

    /// Whether any of its transfer functions draws contours.
    pub fn has_contours(&self) -> bool {
        self.transfer_functions().any(|f| f.contours.is_some())
    }

    /// Whether any of its transfer functions modulates opacity as eq. 3.2 does.
    pub fn has_illustrative_transparency(&self) -> bool {
        self.transfer_functions().any(|f| f.illustrative_transparency)
    }

    /// Whether no transfer function gives opacity to any value of the volume.
    pub fn shows_nothing(&self) -> bool {
        let (low, high) = self.data_range();
        let background = self.transfer_function.max_opacity(low, high);
        let hidden = |look: &Look| look.max_opacity(low, high) <= 0.0;
        let is_hidden = |r: &Region| hidden(&r.look) && r.moved().is_none_or(|moved| hidden(&moved.ghost));
        background <= 0.0 && self.regions.iter().all(|r| r.selection.is_empty() || is_hidden(r))
    }

    /// d₀ in mm of the whole object: the shortest of its transfer functions'.
    pub fn reference_length_mm(&self) -> f64 {
        self.transfer_functions().map(|f| f.reference_length_mm).fold(f64::INFINITY, f64::min)
    }

    /// Largest opacity that anything in a brick has whose data values are `low..=high`.
    fn max_opacity(&self, place: [usize; 3], low: f64, high: f64) -> f64 {
        let mut covered = false;
        let mut largest = 0.0f64;
        for region in &self.regions {
            let [least, most] = region.selection.brick(place).range();
            covered |= least == u8::MAX;
            if most > 0 {
                largest = largest.max(region.look.max_opacity(low, high));
            }
        }
        if covered { largest } else { largest.max(self.transfer_function.max_opacity(low, high)) }
    }

    /// The index box of the bricks in which something shows (opacity above 0.01), clipped to the volume; the whole volume
    /// where nothing does.
    pub fn visible_index_box(&self) -> (DVec3, DVec3) {
        let bricks = self.volume.bricks();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (i, &(a, b)) in bricks.ranges.iter().enumerate() {
            let (a, b) = (self.volume.rescale.value(a), self.volume.rescale.value(b));
            let [nx, ny, _] = bricks.dims;
            let place = [i % nx, i / nx % ny, i / (nx * ny)];
            if bricks.may_show(i) && self.max_opacity(place, a.min(b), a.max(b)) > FRAMED_OPACITY {
                let at = place.map(|n| (n * BRICK) as f64 - 0.5);
                low = low.min(DVec3::from_array(at));
                high = high.max(DVec3::from_array(at) + BRICK as f64);
            }
        }
        let whole = self.volume.grid.index_box();
        if low.x > high.x { whole } else { (low, high.min(whole.1)) }
    }
}

/// Most samples on a ray: above this, f32 no longer tells where on the ray they are.
const MAX_SAMPLES: f64 = 1e6;

impl Scene {
    /// How far, in radians, the normal of an object's surface may turn between two looks at its style: what the quality
    /// allows the sharpest style that the object uses. Infinite where all are flat.
    pub fn largest_turn(&self, object: &Object) -> f64 {
        let nodes = object.transfer_functions().flat_map(StyleTransferFunction::all_nodes);
        let sharpest = match &object.lighting {
            Some(lighting) => lighting.sharpness(&self.camera),
            None => nodes.map(|n| self.styles[n.style].sharpness).fold(0.0, f64::max),
        };
        self.quality.style_change / sharpest
    }

    /// The patterns of the styles that an object uses.
    pub fn patterns<'a>(&'a self, object: &'a Object) -> impl Iterator<Item = &'a Pattern> {
        let nodes = object.transfer_functions().flat_map(StyleTransferFunction::all_nodes);
        nodes.filter_map(|node| self.styles[node.style].pattern.as_ref())
    }

    /// Whether any style that an object uses carries a pattern.
    pub fn has_patterns(&self, object: &Object) -> bool {
        self.patterns(object).next().is_some()
    }

    /// Width on the page of a pixel of a picture of `image_height` pixels, in figure points (1/72 inch).
    pub fn pixel_pt(&self, image_height: u32) -> f64 {
        self.page_height_mm / 25.4 * 72.0 / f64::from(image_height.max(1))
    }

    /// Checks what types cannot: every node has a style, values and lengths are finite, nodes ascend.
    ///
    /// # Errors
    /// [`Error::Scene`] with the first fault.
    pub fn validate(&self) -> Result<()> {
        if self.objects.len() > 1 {
            return Err(Error::scene(
                format!("the scene has {} objects and this version draws one", self.objects.len()),
                "remove all but one",
            ));
        }
        self.camera.validate()?;
        if !(self.camera.eye_mm.is_finite() && self.camera.forward.is_finite()) {
            return Err(Error::scene("the camera is infinitely far away", "give it a larger field of view or height"));
        }
        self.quality.validate()?;
        for style in &self.styles {
            style.pattern.as_ref().map_or(Ok(()), |pattern| pattern.validate(&style.name))?;
        }
        if !(self.page_height_mm.is_finite() && self.page_height_mm > 0.0) {
            return Err(Error::scene(
                format!("the figure is {} mm high on the page", self.page_height_mm),
                "give a positive height",
            ));
        }
        for object in &self.objects {
            if !(object.gradient_scale_mm.is_finite() && object.gradient_scale_mm >= 0.0) {
                return Err(Error::scene(
                    format!("the gradient scale is {} mm", object.gradient_scale_mm),
                    "give 0 or a positive number",
                ));
            }
            validate_distances(object)?;
            for function in object.transfer_functions() {
                function.validate(self.styles.len(), object.distances.len())?;
            }
            region::validate(object)?;
            parts::validate(object)?;
            object.lighting.as_ref().map_or(Ok(()), Lighting::validate)?;
            let diagonal = DVec3::from_array(object.volume.grid.dims().map(|n| n as f64)).length();
            let samples = diagonal / self.quality.step_voxels * f64::from(quality::PARTS);
            if samples > MAX_SAMPLES {
                return Err(Error::scene(
                    format!(
                        "a step of {} voxels puts {samples:.0} samples on a ray through this volume, and a ray holds {MAX_SAMPLES}",
                        self.quality.step_voxels
                    ),
                    format!(
                        "choose a step of {:.3} voxels or more",
                        diagonal / MAX_SAMPLES * f64::from(quality::PARTS)
                    ),
                ));
            }
        }
        Ok(())
    }
}

fn validate_distances(object: &Object) -> Result<()> {
    if object.distances.len() > MAX_DISTANCES {
        return Err(Error::scene(
            format!("the object goes by {} distances, and {MAX_DISTANCES} is the most", object.distances.len()),
            "let functions go by the same structures",
        ));
    }
    if object.distances.iter().any(|field| field.volume_dims() != object.volume.grid.dims()) {
        return Err(Error::scene(
            "distances are those of another grid than the volume's",
            "make them of its selections",
        ));
    }
    Ok(())
}
