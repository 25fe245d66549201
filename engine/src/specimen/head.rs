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

use glam::{DVec3, Vec3, vec3};

use super::Specimen;
use super::painter::{self, Model, Paint, Plan, Structure, bone, structure};
use super::sdf::*;
use super::variant::Variant;
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Modality;

/// See [`super::version`].
pub const VERSION: u32 = 2;

const AIR_HU: f32 = -1000.0;

/// What the head is, apart from its shape.
pub const PLAN: Plan = Plan {
    name: "head",
    bounds: (DVec3::new(-100.0, -106.0, -122.0), DVec3::new(100.0, 126.0, 126.0)),
    cut_z: Some(-122.0),
    air: AIR_HU,
    noise: 4.0,
    noise_range: 900.0,
    modality: Modality::Ct,
    structures: &STRUCTURES,
};

/// Structures by their position in the label table, which is also their id.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u16)]
enum Part {
    #[cfg_attr(not(test), expect(dead_code, reason = "what nothing is painted on"))]
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

impl From<Part> for u16 {
    fn from(part: Part) -> Self {
        part as Self
    }
}

/// Names, colors and magnetic resonance signals, in the order of [`Part`].
static STRUCTURES: [Structure; 21] = [
    structure("background", [0, 0, 0], 0.0),
    structure("skin", [224, 172, 140], 430.0),
    structure("fat", [240, 212, 128], 900.0),
    structure("muscle", [168, 66, 56], 330.0),
    bone("skull", [232, 222, 196], 1250.0),
    bone("mandible", [216, 202, 166], 1350.0),
    structure("teeth", [250, 248, 238], 20.0),
    bone("vertebrae", [206, 194, 158], 1000.0),
    structure("cartilage", [150, 196, 214], 260.0),
    structure("brain gray matter", [206, 158, 150], 390.0),
    structure("brain white matter", [244, 232, 220], 560.0),
    structure("ventricles", [92, 148, 206], 110.0),
    structure("cerebrospinal fluid", [160, 206, 232], 120.0),
    structure("cerebellum", [196, 134, 150], 440.0),
    structure("brain stem", [222, 190, 150], 530.0),
    structure("arteries", [200, 32, 36], 620.0),
    structure("veins", [46, 76, 168], 560.0),
    structure("eyes", [236, 238, 244], 130.0),
    structure("lenses", [170, 214, 236], 300.0),
    structure("optic nerves", [240, 220, 96], 480.0),
    structure("airways", [120, 132, 144], 0.0),
];

/// Which parts can matter anywhere in a brick.
#[derive(Default)]
pub struct Scope {
    surface: bool,
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

pub struct Head {
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
}

impl Model for Head {
    type Scope = Scope;

    fn scope(&self, center: Vec3, radius: f32) -> Option<Scope> {
        let p = asymmetry(center);
        let q = vec3(p.x.abs(), p.y, p.z);
        // Distances are bounds only approximately: a quarter more than the brick's radius, and the blur.
        let r = radius * 1.3 + 2.5;
        let skin = face::skin(p);
        if skin > r {
            return None;
        }
        let room = skull::cavity(q);
        let inside = room < -r;
        let near = |d: f32| d < r;
        let front = center + Vec3::splat(radius);
        Some(Scope {
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
        })
    }

    fn paint(&self, world: Vec3, s: &Scope, paint: &mut Paint<'_>) {
        let p = asymmetry(world);
        let q = vec3(p.x.abs(), p.y, p.z);
        let skin = if s.surface { face::skin(p) } else { -100.0 };
        if skin > paint.blur {
            return;
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
            self.paint_orbit(q, skin, paint);
        }
        if s.skull {
            let d = smax(skull::skull(p), skin + 2.0, 1.0);
            self.paint_bone(p, d, 1250.0, Part::Skull, paint);
            self.paint_bone(p, skull::hyoid(q), 900.0, Part::Skull, paint);
        }
        if s.mandible {
            self.paint_bone(p, skull::mandible(q), 1350.0, Part::Mandible, paint);
        }
        if s.vertebrae {
            self.paint_bone(p, skull::vertebrae(q), 1000.0, Part::Vertebrae, paint);
        }
        for &i in &s.teeth {
            let tooth = &self.teeth[i];
            // The lower teeth stand in the mandible and go with it.
            if tooth.is_lower() && paint.lacks(Part::Mandible) {
                continue;
            }
            let (crown, root) = tooth.distance(p);
            paint.put(root, 1600.0, Part::Teeth);
            paint.put(crown, if tooth.gold { 3000.0 } else { 2350.0 }, Part::Teeth);
            if !tooth.gold {
                paint.tint(crown + 1.6, 1700.0, Part::Teeth);
            }
        }
        if s.airways {
            paint.put(face::airways(p, skin).max(-skull::cavity(q) - 1.0), AIR_HU, Part::Airways);
        }
        if s.cavity || s.stem {
            self.paint_brain(p, q, s, paint);
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
    }
}

impl Head {
    /// Compact tables over spongy bone (in the vault: the diploe).
    fn paint_bone(&self, p: Vec3, d: f32, compact: f32, part: Part, paint: &mut Paint<'_>) {
        if d > 4.0 {
            return;
        }
        paint.put(d, compact + 120.0 * noise(p * 0.12, 21), part);
        if d < 0.0 {
            let sponge = noise(p * 0.35, 22) + 0.6 * noise(p * 0.8, 23);
            paint.tint(d + skull::TABLE_MM, 400.0 + 110.0 * sponge, part);
        }
    }

    fn paint_orbit(&self, q: Vec3, skin: f32, paint: &mut Paint<'_>) {
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
        paint.tint(globe + 1.2, 12.0, Part::Eyes);
        paint.put(ellipsoid(e - vec3(0.0, 6.6, 0.0), vec3(4.7, 2.3, 4.7)), 82.0, Part::Lenses);
    }

    fn paint_brain(&self, p: Vec3, q: Vec3, s: &Scope, paint: &mut Paint<'_>) {
        paint.put(skull::cavity(q), 9.0, Part::Fluid);
        if s.stem {
            // The sac of the cord stays a millimeter off the bone.
            paint.put(skull::spinal_canal(q) + 1.0, 9.0, Part::Fluid);
            paint.put(brain::stem(q), 33.0, Part::Stem);
        }
        if s.cerebellum {
            let (surface, white) = brain::cerebellum(q);
            paint.put(surface, 41.0, Part::Cerebellum);
            paint.tint(white, 28.0, Part::Cerebellum);
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
pub fn generate(resolution: usize, variant: &Variant, progress: &Progress) -> Result<Specimen> {
    let head = Head::new();
    progress.check()?;
    painter::generate(&head, &PLAN, resolution, variant, progress)
}
