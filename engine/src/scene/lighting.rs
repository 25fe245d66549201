//! Lighting maps (thesis §3.3.1): how surfaces are lit where styles only say what color they are.

use glam::DVec3;

use super::Camera;
use crate::error::{Error, Result};

/// Texels a side of a lighting map.
pub const MAP_SIZE: usize = 256;
/// n·l up to which Blinn and Phong's highlights fade in (`shaders/lib/light_model.wgsl`).
const HIGHLIGHT_FADE: f64 = 0.01;
/// Lights that an object may have.
pub const MAX_LIGHTS: usize = 4;

/// How an object is lit.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// What light does to a surface.
    pub map: LightingMap,
    /// One to [`MAX_LIGHTS`].
    pub lights: Vec<Light>,
}

/// A light that is infinitely far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Unit vector towards it.
    pub direction: DVec3,
    /// What `direction` is measured in.
    pub frame: LightFrame,
    /// Linear RGB times brightness, 0 or more.
    pub color: [f32; 3],
}

/// What a light is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightFrame {
    /// The camera: x right, y up, z towards the eye.
    Camera,
    /// The world: right, anterior, superior.
    World,
}

/// What light does to a surface, by n·l and n·h: how much there is of the surface's color anyway (ambient), of its color in this light
/// (diffuse), and of the light itself (specular).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightingMap {
    /// The model of Blinn and Phong.
    BlinnPhong {
        /// Weight of the first term, 0 or more, as the next two.
        ambient: f64,
        /// Of the second, which goes with n·l.
        diffuse: f64,
        /// Of the third.
        specular: f64,
        /// Exponent of n·h in it, 0 or more.
        shininess: f64,
    },
    /// Three tones and a hard highlight.
    Cartoon,
    /// Polished metal: dark against the light's horizon, streaks of light in its own color.
    Metal,
    /// Plain colors, whatever the light.
    Unshaded,
}

/// A lighting map as pictures are drawn with it: [`MAP_SIZE`]² texels; n·l goes from −1 in the middle of the first column to 1 in that of
/// the last, n·h from 1 in the first row to 0 in the last. Bilinear in between.
#[derive(Clone, Debug, PartialEq)]
pub struct LightingTable {
    /// Ambient, diffuse, specular.
    pub texels: Vec<[f32; 3]>,
}

impl LightingMap {
    /// Ambient, diffuse, specular and shininess where it is Blinn and Phong's model or one that this is as well; these are drawn
    /// without a table.
    pub fn blinn_phong(&self) -> Option<[f64; 4]> {
        match *self {
            Self::BlinnPhong { ambient, diffuse, specular, shininess } => Some([ambient, diffuse, specular, shininess]),
            Self::Unshaded => Some([1.0, 0.0, 0.0, 1.0]),
            Self::Cartoon | Self::Metal => None,
        }
    }

    /// Ambient, diffuse and specular at n·l and n·h.
    pub fn terms(&self, n_l: f64, n_h: f64) -> [f64; 3] {
        let n_h = n_h.max(0.0);
        match *self {
            Self::BlinnPhong { ambient, diffuse, specular, shininess } => {
                // Where a highlight ends in shadow it fades: an edge there would be seen.
                let lit = n_h.powf(shininess) * (n_l / HIGHLIGHT_FADE).clamp(0.0, 1.0);
                [ambient, diffuse * n_l.max(0.0), specular * lit]
            }
            Self::Cartoon => {
                let step = |at: f64, width: f64, x: f64| ((x - at) / width + 0.5).clamp(0.0, 1.0);
                [0.34, 0.3 * step(-0.05, 0.03, n_l) + 0.32 * step(0.5, 0.03, n_l), 0.55 * step(0.97, 0.006, n_h)]
            }
            Self::Metal => {
                let streaks = 0.5 + 0.5 * (9.0 * n_h * n_h).sin();
                [0.06, 0.18 * n_l.max(0.0) + 0.75 * streaks * n_h.powf(4.0), 0.8 * n_h.powf(60.0)]
            }
            Self::Unshaded => [1.0, 0.0, 0.0],
        }
    }

    /// The map as a table.
    pub fn table(&self) -> LightingTable {
        let last = (MAP_SIZE - 1) as f64;
        let texel = |i: usize| {
            let (column, row) = ((i % MAP_SIZE) as f64, (i / MAP_SIZE) as f64);
            self.terms(2.0 * column / last - 1.0, 1.0 - row / last).map(|c| c as f32)
        };
        LightingTable { texels: (0..MAP_SIZE * MAP_SIZE).map(texel).collect() }
    }
}

impl LightingTable {
    /// Ambient, diffuse and specular at n·l and n·h.
    pub fn at(&self, n_l: f64, n_h: f64) -> [f64; 3] {
        let last = (MAP_SIZE - 1) as f64;
        let axis = |t: f64| {
            let at = (t * last).clamp(0.0, last);
            let first = at.floor().min(last - 1.0);
            (first as usize, at - first)
        };
        let ((x, wx), (y, wy)) = (axis(0.5 + 0.5 * n_l), axis(1.0 - n_h));
        let texel = |x: usize, y: usize, c: usize| f64::from(self.texels[y * MAP_SIZE + x][c]);
        std::array::from_fn(|c| {
            let above = texel(x, y, c) + wx * (texel(x + 1, y, c) - texel(x, y, c));
            let below = texel(x, y + 1, c) + wx * (texel(x + 1, y + 1, c) - texel(x, y + 1, c));
            above + wy * (below - above)
        })
    }
}

impl Light {
    /// Unit vector towards it in the world.
    pub fn in_world(&self, camera: &Camera) -> DVec3 {
        let d = self.direction;
        match self.frame {
            LightFrame::World => d,
            LightFrame::Camera => d.x * camera.right + d.y * camera.up - d.z * camera.forward,
        }
    }

    /// Rec. 709 luminance.
    pub fn luminance(&self) -> f64 {
        let [r, g, b] = self.color.map(f64::from);
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }
}

impl Lighting {
    /// Linear RGB of a sphere of `color` at its normal `n`, seen in parallel along the camera's axis (`n`: right, up, towards the eye).
    pub fn on_sphere(&self, camera: &Camera, color: DVec3, n: DVec3) -> DVec3 {
        let brightness: f64 = self.lights.iter().map(Light::luminance).sum();
        let (mut own, mut light_of) = (DVec3::ZERO, DVec3::ZERO);
        for light in &self.lights {
            let world = light.in_world(camera);
            let l = DVec3::new(world.dot(camera.right), world.dot(camera.up), -world.dot(camera.forward));
            let [a, d, s] = self.map.terms(n.dot(l), n.dot((l + DVec3::Z).normalize_or_zero()));
            let c = DVec3::from_array(light.color.map(f64::from));
            own += a * if brightness > 0.0 { light.luminance() / brightness } else { 1.0 / self.lights.len() as f64 }
                + c * d;
            light_of += c * s;
        }
        (color * own + light_of).clamp(DVec3::ZERO, DVec3::ONE)
    }

    /// How fast what is white changes with the normal, seen by `camera`; as [`StyleImage::sharpness`](crate::styles::StyleImage).
    pub fn sharpness(&self, camera: &Camera) -> f64 {
        const STEPS: i32 = 16;
        let h = 1.0 / f64::from(STEPS);
        let at = |x: f64, y: f64| {
            let n = DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt());
            self.on_sphere(camera, DVec3::ONE, n)
        };
        let (mut sum, mut count) = (0.0, 0.0);
        for (i, j) in (-STEPS..=STEPS).flat_map(|i| (-STEPS..=STEPS).map(move |j| (i, j))) {
            let (x, y) = (f64::from(i) * h, f64::from(j) * h);
            if x.hypot(y) > 1.0 - 1.5 * h {
                continue;
            }
            let [dx, dy] = [at(x + h, y) - at(x - h, y), at(x, y + h) - at(x, y - h)].map(|d| d / (2.0 * h));
            sum += (dx * dx + dy * dy).max_element();
            count += 1.0;
        }
        f64::sqrt(sum / count)
    }

    pub(super) fn validate(&self) -> Result<()> {
        let fail = |what: String, remedy: &str| Err(Error::scene(what, remedy));
        if self.lights.is_empty() || self.lights.len() > MAX_LIGHTS {
            return fail(format!("an object has {} lights", self.lights.len()), "give it one to four");
        }
        if let LightingMap::BlinnPhong { ambient, diffuse, specular, shininess } = self.map
            && [ambient, diffuse, specular, shininess].iter().any(|n| !(n.is_finite() && *n >= 0.0))
        {
            return fail(format!("an object is lit by {:?}", self.map), "give numbers of 0 or more");
        }
        for light in &self.lights {
            if !light.direction.is_normalized() {
                return fail("the direction of a light has not the length 1".into(), "give it another direction");
            }
            if light.color.iter().any(|c| !(c.is_finite() && *c >= 0.0)) {
                return fail(format!("a light has the color {:?}", light.color), "give three numbers of 0 or more");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_its_map_at_its_texels_and_linear_between() {
        let map = LightingMap::BlinnPhong { ambient: 0.1, diffuse: 0.7, specular: 0.5, shininess: 20.0 };
        let table = map.table();
        for (n_l, n_h) in [(1.0, 1.0), (0.2, 0.6), (-1.0, 0.0), (0.999, 0.98)] {
            let [a, d, s] = table.at(n_l, n_h);
            assert!((a - 0.1).abs() < 1e-6 && (d - 0.7 * f64::max(n_l, 0.0)).abs() < 3e-3, "{n_l}: {d}");
            let expected = if n_l > 0.0 { 0.5 * n_h.powf(20.0) } else { 0.0 };
            assert!((s - expected).abs() < 2e-3, "{n_h}: {s}, {expected}");
        }
        // Beyond the ends the edge goes on.
        assert_eq!(table.at(2.0, 7.0), table.at(1.0, 1.0));
        assert_eq!(table.at(-2.0, -7.0), table.at(-1.0, 0.0));
        // Lights behind a surface bring none of the map's highlights with them.
        assert_eq!(map.terms(-0.5, -0.3), [0.1, 0.0, 0.0]);
    }
}
