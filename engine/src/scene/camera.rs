//! The camera in world space, and the one place where its geometry is done in f64.

use glam::DVec3;

use crate::error::{Error, Result};

/// How depth is projected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Central projection with the *vertical* field of view; another aspect widens or narrows the picture.
    Perspective {
        /// Angle between the top and the bottom edge of the picture, degrees, 0 < fov < 180.
        fov_y_deg: f64,
    },
    /// Parallel projection.
    Orthographic {
        /// World size of the picture's height in mm.
        height_mm: f64,
    },
}

/// Eye, axes and projection. The axes are an orthonormal right-handed frame: right × up = −forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// World position of the eye in mm (orthographic: rays start there too, but look behind it as well).
    pub eye_mm: DVec3,
    /// Unit view axis.
    pub forward: DVec3,
    /// Unit direction of the picture's right edge.
    pub right: DVec3,
    /// Unit direction of the picture's top edge.
    pub up: DVec3,
    /// Central or parallel.
    pub projection: Projection,
}

impl Camera {
    /// A camera at `eye_mm` that looks along `forward` with `up` pointing up in the picture. Where `up` is
    /// parallel to the view (looking along up), the world axis least parallel to it takes its place: S, then A.
    ///
    /// # Errors
    /// [`Error::Scene`] for a view direction of length 0 or positions that are not finite.
    pub fn looking(eye_mm: DVec3, forward: DVec3, up: DVec3, projection: Projection) -> Result<Self> {
        let forward = forward
            .try_normalize()
            .filter(|f| f.is_finite() && eye_mm.is_finite())
            .ok_or_else(|| Error::scene("the camera has no view direction", "give a view that is not 0 0 0"))?;
        let right = [up, DVec3::Z, DVec3::Y]
            .into_iter()
            .filter_map(|u| u.try_normalize())
            .map(|u| forward.cross(u))
            .find(|r| r.length() > 1e-6)
            .map_or(DVec3::X, DVec3::normalize);
        Ok(Self { eye_mm, forward, right, up: right.cross(forward).normalize(), projection })
    }

    /// Half the picture's height: the tangent of half the field of view (perspective) or mm (orthographic).
    pub fn half_height(&self) -> f64 {
        match self.projection {
            Projection::Perspective { fov_y_deg } => (0.5 * fov_y_deg.to_radians()).tan(),
            Projection::Orthographic { height_mm } => 0.5 * height_mm,
        }
    }

    /// Size of a pixel in mm at distance 0 (`.0`) and its growth per mm of depth (`.1`), for a picture of
    /// `height_px` rows.
    pub fn pixel_footprint_mm(&self, height_px: u32) -> (f64, f64) {
        let pixel = 2.0 * self.half_height() / f64::from(height_px);
        match self.projection {
            Projection::Perspective { .. } => (0.0, pixel),
            Projection::Orthographic { .. } => (pixel, 0.0),
        }
    }

    pub(crate) fn validate(&self) -> Result<()> {
        let ok = match self.projection {
            Projection::Perspective { fov_y_deg } => fov_y_deg > 0.0 && fov_y_deg < 180.0,
            Projection::Orthographic { height_mm } => height_mm > 0.0 && height_mm.is_finite(),
        };
        if ok {
            Ok(())
        } else {
            Err(match self.projection {
                Projection::Perspective { fov_y_deg } => Error::scene(
                    format!("the camera's field of view is {fov_y_deg} degrees"),
                    "give one between 0 and 180",
                ),
                Projection::Orthographic { height_mm } => {
                    Error::scene(format!("the camera shows a height of {height_mm} mm"), "give a positive one")
                }
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looking_along_up_has_a_frame() {
        for forward in [DVec3::Z, DVec3::NEG_Z, DVec3::Y] {
            let c =
                Camera::looking(DVec3::ZERO, forward, forward, Projection::Orthographic { height_mm: 1.0 }).unwrap();
            assert!((c.right.cross(c.up) + c.forward).length() < 1e-12, "{c:?}");
        }
        // Looking to the back (posterior) with S up: the patient's left is on the right-hand side of the picture.
        let c =
            Camera::looking(DVec3::ZERO, DVec3::NEG_Y, DVec3::Z, Projection::Orthographic { height_mm: 1.0 }).unwrap();
        assert!((c.right - DVec3::NEG_X).length() < 1e-12);
    }
}
