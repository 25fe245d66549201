//! `specimen:head`: an adult head and upper neck as a contrast-enhanced CT would show it, modeled in
//! millimeters from signed distances.
//!
//! World frame: the origin lies midway between the ear canals, z = 0 is the Frankfort plane (ear canals and
//! lower orbital rims), x > 0 is the patient's RIGHT, y > 0 the front. The box is 200 x 232 x 248 mm.
//!
//! Marks that tell left from right, so that a mirrored picture is noticed:
//! - a nevus (a 6 mm bump of skin) on the LEFT cheek (x < 0);
//! - a gold crown (HU 3000) on the RIGHT upper first premolar (x > 0);
//! - the RIGHT transverse sinus is twice as wide as the left one.

mod brain;
mod face;
mod skull;
#[cfg(test)]
mod tests;
mod vessels;

use glam::{DAffine3, DMat3, DVec3, Vec3, vec3};
use rayon::prelude::*;

use super::Specimen;
use super::sdf::*;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;
use crate::volume::labels::{Label, LabelMap};
use crate::volume::{Modality, Rescale, Volume, Voxels};

/// See [`super::version`].
pub const VERSION: u32 = 2;

/// The box of the specimen, world mm.
const BOX_MIN: DVec3 = DVec3::new(-100.0, -106.0, -122.0);
const BOX_MAX: DVec3 = DVec3::new(100.0, 126.0, 126.0);

/// Standard deviation of the noise in tissue, HU. Air outside stays clean.
const NOISE_HU: f32 = 4.0;

/// Width of a boundary in voxels, from nothing to full coverage: 1.5 voxels at half maximum, as a scanner's point
/// spread would leave it. Sharper edges alias, and normals from central differences show terraces.
const BLUR_VOXELS: f32 = 2.2;

const AIR_HU: f32 = -1000.0;

/// Structures by their position in the label table, which is also their id.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u16)]
enum Part {
    Background,
    Skin,
    Fat,
    Muscle,
    Skull,
    Mandible,
    Teeth,
    Vertebrae,
    Cartilage,
    Gray,
    White,
    Ventricles,
    Fluid,
    Cerebellum,
    Stem,
    Arteries,
    Veins,
    Eyes,
    Lenses,
    OpticNerves,
    Airways,
}

/// Names and colors, in the order of [`Part`].
const TABLE: [(&str, [u8; 3]); 21] = [
    ("background", [0, 0, 0]),
    ("skin", [224, 172, 140]),
    ("fat", [240, 212, 128]),
    ("muscle", [168, 66, 56]),
    ("skull", [232, 222, 196]),
    ("mandible", [216, 202, 166]),
    ("teeth", [250, 248, 238]),
    ("vertebrae", [206, 194, 158]),
    ("cartilage", [150, 196, 214]),
    ("brain gray matter", [206, 158, 150]),
    ("brain white matter", [244, 232, 220]),
    ("ventricles", [92, 148, 206]),
    ("cerebrospinal fluid", [160, 206, 232]),
    ("cerebellum", [196, 134, 150]),
    ("brain stem", [222, 190, 150]),
    ("arteries", [200, 32, 36]),
    ("veins", [46, 76, 168]),
    ("eyes", [236, 238, 244]),
    ("lenses", [170, 214, 236]),
    ("optic nerves", [240, 220, 96]),
    ("airways", [120, 132, 144]),
];

/// What accumulates at one voxel: parts are painted over each other with their coverage.
struct Paint {
    hu: f32,
    part: Part,
    /// 1 / width of the blur at a boundary, 1/mm.
    sharpness: f32,
}

impl Paint {
    /// Coverage of a part whose surface is `d` mm away: a smooth step over [`BLUR_VOXELS`].
    fn cover(&self, d: f32) -> f32 {
        let t = (0.5 - d * self.sharpness).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    fn put(&mut self, d: f32, hu: f32, part: Part) {
        let c = self.cover(d);
        if c > 0.0 {
            self.hu += (hu - self.hu) * c;
            if d <= 0.0 {
                self.part = part;
            }
        }
    }

    /// Changes the density of what is there without changing its name.
    fn tint(&mut self, d: f32, hu: f32) {
        self.hu += (hu - self.hu) * self.cover(d);
    }
}

/// Which parts can matter anywhere in a brick.
#[derive(Default)]
struct Scope {
    surface: bool,
    outside: bool,
    face: bool,
    ear: bool,
    skull: bool,
    mandible: bool,
    vertebrae: bool,
    cavity: bool,
    cerebrum: bool,
    ventricles: bool,
    cerebellum: bool,
    stem: bool,
    orbit: bool,
    airways: bool,
    muscles: bool,
    teeth: Vec<usize>,
    tubes: Vec<usize>,
}

struct Head {
    folds: [brain::Folds; 2],
    teeth: Vec<skull::Tooth>,
    tubes: Vec<vessels::Tube>,
}

/// No head is symmetric: nose and chin stand a little to the left, the right occiput a little further back.
fn asymmetry(p: Vec3) -> Vec3 {
    let face = smoothstep(40.0, 100.0, p.y);
    vec3(
        p.x + face * (1.2 * smoothstep(40.0, -20.0, p.z) - 0.6 * smoothstep(-30.0, -90.0, p.z)),
        p.y + 1.5 * smoothstep(-50.0, 50.0, p.x) * smoothstep(-20.0, -90.0, p.y),
        p.z + 0.6 * smoothstep(-40.0, 40.0, p.x) * face,
    )
}

impl Head {
    fn new() -> Self {
        let (right, left) = rayon::join(|| brain::Folds::grow(7), || brain::Folds::grow(8));
        Self { folds: [right, left], teeth: skull::teeth(), tubes: vessels::vessels() }
    }

    fn scope(&self, center: Vec3, radius: f32) -> Scope {
        let p = asymmetry(center);
        let q = vec3(p.x.abs(), p.y, p.z);
        // Distances are bounds only approximately: a quarter more than the brick's radius, and the blur.
        let r = radius * 1.3 + 2.5;
        let skin = face::skin(p);
        if skin > r {
            return Scope { outside: true, ..Scope::default() };
        }
        let room = skull::cavity(q);
        let inside = room < -r;
        let near = |d: f32| d < r;
        let front = center + Vec3::splat(radius);
        Scope {
            outside: false,
            surface: skin > -r - 14.0,
            face: front.y > 60.0,
            ear: near((q - vec3(72.0, -8.0, 3.0)).length() - 45.0),
            skull: !inside && near(skull::skull(p).min(skull::hyoid(q))),
            mandible: near(skull::mandible(q)),
            vertebrae: near(skull::vertebrae(q)),
            cavity: near(room),
            cerebrum: near(brain::hull(q)) || near(brain::core(q)),
            ventricles: near(brain::ventricles(q)),
            cerebellum: near(brain::cerebellum_hull(q)),
            stem: near(brain::stem(q)) || near(skull::spinal_canal(q)),
            orbit: near(skull::orbit(q)) || near((q - face::EYE).length() - 16.0),
            airways: near(face::airways(p, -100.0)),
            muscles: !inside,
            tubes: (0..self.tubes.len()).filter(|&i| self.tubes[i].bound(p) < r).collect(),
            teeth: (0..self.teeth.len())
                .filter(|&i| {
                    let (lo, hi) = self.teeth[i].bounds;
                    let away = (lo - p).max(p - hi).max(Vec3::ZERO);
                    away.length() < r
                })
                .collect(),
        }
    }

    fn sample(&self, world: Vec3, blur: f32, s: &Scope) -> (f32, Part) {
        let p = asymmetry(world);
        let q = vec3(p.x.abs(), p.y, p.z);
        let mut paint = Paint { hu: AIR_HU, part: Part::Background, sharpness: 1.0 / blur };
        let skin = if s.surface { face::skin(p) } else { -100.0 };
        if skin > blur {
            return (AIR_HU, Part::Background);
        }
        // Skin and what lies under it everywhere.
        paint.put(skin, 35.0, Part::Skin);
        let grain = noise(p * 0.22, 11);
        paint.put(skin + 2.0, -98.0 + 8.0 * grain, Part::Fat);
        if s.muscles {
            // Depth of the fat: thin on the scalp, thick over cheeks and nape.
            let cheek = bump((q - vec3(40.0, 62.0, -35.0)).length(), 38.0);
            let neck = smoothstep(-50.0, -90.0, p.z);
            let fat = 3.6 + 6.5 * cheek + 2.5 * neck;
            // Deep to it muscle in bundles, with fat in the planes between them.
            let bundles =
                1.1 - 7.0 * (noise(p * vec3(0.085, 0.085, 0.05), 5) + 0.35 * noise(p * vec3(0.2, 0.2, 0.09), 6)).abs();
            let filler = smax(skin + fat, bundles, 1.0);
            let muscle = smax(face::muscles(q), skin + 2.8, 1.0).min(filler);
            paint.put(muscle, 52.0 + 6.0 * grain, Part::Muscle);
        }
        if s.ear || s.face || p.z < -90.0 {
            paint.put(smax(face::cartilage(q), skin + 0.9, 0.5), 120.0, Part::Cartilage);
        }
        if s.orbit {
            self.paint_orbit(q, skin, &mut paint);
        }
        if s.skull {
            let d = smax(skull::skull(p), skin + 2.0, 1.0);
            self.paint_bone(p, d, 1250.0, Part::Skull, &mut paint);
            self.paint_bone(p, skull::hyoid(q), 900.0, Part::Skull, &mut paint);
        }
        if s.mandible {
            self.paint_bone(p, skull::mandible(q), 1350.0, Part::Mandible, &mut paint);
        }
        if s.vertebrae {
            self.paint_bone(p, skull::vertebrae(q), 1000.0, Part::Vertebrae, &mut paint);
        }
        for &i in &s.teeth {
            let tooth = &self.teeth[i];
            let (crown, root) = tooth.distance(p);
            paint.put(root, 1600.0, Part::Teeth);
            paint.put(crown, if tooth.gold { 3000.0 } else { 2350.0 }, Part::Teeth);
            if !tooth.gold {
                paint.tint(crown + 1.6, 1700.0);
            }
        }
        if s.airways {
            paint.put(face::airways(p, skin).max(-skull::cavity(q) - 1.0), AIR_HU, Part::Airways);
        }
        if s.cavity || s.stem {
            self.paint_brain(p, q, s, &mut paint);
        }
        if !s.tubes.is_empty() {
            let (mut artery, mut vein) = (f32::MAX, f32::MAX);
            for &i in &s.tubes {
                let tube = &self.tubes[i];
                let nearest = if tube.artery { &mut artery } else { &mut vein };
                *nearest = nearest.min(tube.distance(p));
            }
            paint.put(smax(vein, skin + 1.5, 0.5), 260.0, Part::Veins);
            paint.put(smax(artery, skin + 1.5, 0.5), 330.0, Part::Arteries);
        }
        (paint.hu, paint.part)
    }

    /// Compact tables over spongy bone (in the vault: the diploe).
    fn paint_bone(&self, p: Vec3, d: f32, compact: f32, part: Part, paint: &mut Paint) {
        if d > 4.0 {
            return;
        }
        paint.put(d, compact + 120.0 * noise(p * 0.12, 21), part);
        if d < 0.0 {
            let sponge = noise(p * 0.35, 22) + 0.6 * noise(p * 0.8, 23);
            paint.tint(d + skull::TABLE_MM, 400.0 + 110.0 * sponge);
        }
    }

    fn paint_orbit(&self, q: Vec3, skin: f32, paint: &mut Paint) {
        let e = q - face::EYE;
        let socket = skull::orbit(q);
        let globe = {
            let ball = e.length() - face::EYE_RADIUS;
            // The cornea bulges from the front.
            smin(ball, (e - vec3(0.0, 5.2, 0.0)).length() - 7.7, 1.5)
        };
        // Fat fills the socket behind the lids.
        paint.put(smax(smax(socket, q.y - face::EYE.y - 6.0, 2.0), skin + 2.0, 1.0), -95.0, Part::Fat);
        paint.put(face::eye_muscles(q), 55.0, Part::Muscle);
        let nerve = chain(
            q,
            &[
                (vec3(30.5, 62.0, 15.5), 2.2),
                (vec3(24.0, 48.0, 17.5), 1.9),
                (vec3(13.0, 31.0, 19.0), 1.9),
                (vec3(0.5, 17.0, 20.5), 2.2),
            ],
            3.0,
        );
        paint.put(nerve, 38.0, Part::OpticNerves);
        // Coats of the eye, vitreous, lens.
        paint.put(globe, 62.0, Part::Eyes);
        paint.tint(globe + 1.2, 12.0);
        paint.put(ellipsoid(e - vec3(0.0, 6.6, 0.0), vec3(4.7, 2.3, 4.7)), 82.0, Part::Lenses);
    }

    fn paint_brain(&self, p: Vec3, q: Vec3, s: &Scope, paint: &mut Paint) {
        paint.put(skull::cavity(q), 9.0, Part::Fluid);
        if s.stem {
            // The sac of the cord stays a millimeter off the bone.
            paint.put(skull::spinal_canal(q) + 1.0, 9.0, Part::Fluid);
            paint.put(brain::stem(q), 33.0, Part::Stem);
        }
        if s.cerebellum {
            let (surface, white) = brain::cerebellum(q);
            paint.put(surface, 41.0, Part::Cerebellum);
            paint.tint(white, 28.0);
        }
        if s.cerebrum {
            let parts = brain::cerebrum(p, &self.folds[usize::from(p.x < 0.0)]);
            paint.put(parts.cerebrum, 42.0, Part::Gray);
            paint.put(parts.white, 26.0, Part::White);
            paint.put(smax(parts.nuclei, parts.cerebrum + 1.0, 1.0), 40.0, Part::Gray);
        }
        if s.ventricles {
            paint.put(brain::ventricles(q), 8.0, Part::Ventricles);
        }
    }
}

/// Makes the head with `resolution` voxels along its longest axis.
pub fn generate(resolution: usize, progress: &Progress) -> Result<Specimen> {
    let size = BOX_MAX - BOX_MIN;
    let spacing = size.max_element() / resolution as f64;
    let dims = size.to_array().map(|mm| ((mm / spacing).round() as usize).max(1));
    let [nx, ny, nz] = dims;
    progress.begin("generating specimen:head", nz as u64);
    // Centered in the box: halving the resolution keeps the anatomy where it is.
    let extent = DVec3::new((nx - 1) as f64, (ny - 1) as f64, (nz - 1) as f64) * spacing;
    let origin = (BOX_MIN + BOX_MAX - extent) * 0.5;
    let affine = DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(spacing)), origin);
    let broken = |what: String| Error::scene(what, "choose another resolution");
    let grid = Grid::new(dims, affine).map_err(broken)?;

    let head = Head::new();
    progress.check()?;

    // Bricks of about 8 mm.
    let edge = ((8.0 / spacing).floor() as usize).clamp(1, 16);
    let blur = BLUR_VOXELS * spacing as f32;
    let at = |x: f64, y: f64, z: f64| (origin + DVec3::new(x, y, z) * spacing).as_vec3();
    let mut hu = vec![AIR_HU as i16; nx * ny * nz];
    let mut labels = vec![0_u16; nx * ny * nz];
    hu.par_chunks_mut(nx * ny * edge).zip(labels.par_chunks_mut(nx * ny * edge)).enumerate().try_for_each(
        |(slab, (hu, labels))| -> Result<()> {
            let z0 = slab * edge;
            let depth = hu.len() / (nx * ny);
            for y0 in (0..ny).step_by(edge) {
                progress.check()?;
                for x0 in (0..nx).step_by(edge) {
                    let (x1, y1) = ((x0 + edge).min(nx), (y0 + edge).min(ny));
                    let middle = |a: usize, b: usize| (a + b - 1) as f64 * 0.5;
                    let center = at(middle(x0, x1), middle(y0, y1), middle(z0, z0 + depth));
                    let half = DVec3::new((x1 - x0) as f64, (y1 - y0) as f64, depth as f64) * (0.5 * spacing);
                    let scope = head.scope(center, half.length() as f32);
                    if scope.outside {
                        continue;
                    }
                    for z in 0..depth {
                        for y in y0..y1 {
                            for x in x0..x1 {
                                let (value, part) = head.sample(at(x as f64, y as f64, (z0 + z) as f64), blur, &scope);
                                let tissue = ((value - AIR_HU) / 900.0).clamp(0.0, 1.0);
                                let noise = NOISE_HU * tissue * normal(x, y, z0 + z, 99);
                                let i = x + nx * (y + ny * z);
                                hu[i] = (value + noise).round().clamp(-1024.0, 3071.0) as i16;
                                labels[i] = part as u16;
                            }
                        }
                    }
                }
            }
            progress.advance(depth as u64)
        },
    )?;

    let mut volume = Volume::new(grid, Voxels::I16(hu), Rescale::IDENTITY, "specimen").map_err(broken)?;
    volume.modality = Modality::Ct;
    let labels = LabelMap {
        grid,
        voxels: labels,
        labels: TABLE
            .iter()
            .zip(0..)
            .map(|(&(name, color), id)| Label { id, name: name.to_owned(), color, code: None })
            .collect(),
        notes: Vec::new(),
    };
    Ok(Specimen { volume, labels })
}
