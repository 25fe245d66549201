//! `specimen:turtle`: a pond turtle in mid-stride as a contrast-enhanced CT would show it, modeled in millimeters from
//! signed distances. Shell, body, organs and bones are separate structures, made to be taken apart.
//!
//! World frame: the origin lies in the middle of the carapace's rim plane, x > 0 is the animal's RIGHT, y > 0 its head,
//! z > 0 its back. The box is 228 x 312 x 116 mm; the carapace is 200 mm long.
//!
//! Marks that tell left from right, so that a mirrored picture is noticed:
//! - a healed bite in the rim of the carapace behind, on the RIGHT;
//! - the tail curls to the LEFT;
//! - the large lobe of the liver lies on the RIGHT, the stomach on the LEFT;
//! - the RIGHT fore limb reaches forward, and the head looks to the RIGHT.

mod limbs;
mod organs;
mod shell;
#[cfg(test)]
mod tests;

use glam::{DVec3, Vec3, vec3};

use self::limbs::{Head, Limb};
use super::Specimen;
use super::painter::{self, Model, Paint, Plan, Structure, bone, structure};
use super::sdf::*;
use super::variant::Variant;
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Modality;

/// See [`super::version`].
pub const VERSION: u32 = 1;

const AIR_HU: f32 = -1000.0;

/// What the turtle is, apart from its shape.
pub const PLAN: Plan = Plan {
    name: "turtle",
    bounds: (DVec3::new(-114.0, -142.0, -50.0), DVec3::new(114.0, 170.0, 66.0)),
    cut_z: None,
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
    Scutes = 1,
    Carapace,
    Plastron,
    Skin,
    Horn,
    Fat,
    Muscle,
    Skull,
    Jaw,
    Neck,
    Back,
    TailBones,
    Ribs,
    Shoulder,
    Pelvis,
    ForeBones,
    HindBones,
    Brain,
    Cord,
    Eyes,
    Trachea,
    Lungs,
    Heart,
    Vessels,
    Gullet,
    Stomach,
    Intestine,
    Liver,
    Gall,
    Kidneys,
    Bladder,
}

impl From<Part> for u16 {
    fn from(part: Part) -> Self {
        part as Self
    }
}

/// Names, colors and magnetic resonance signals, in the order of [`Part`].
static STRUCTURES: [Structure; 32] = [
    structure("background", [0, 0, 0], 0.0),
    structure("scutes", [108, 88, 46], 70.0),
    bone("carapace", [196, 176, 128], 800.0),
    bone("plastron", [222, 196, 126], 800.0),
    structure("skin", [118, 132, 84], 420.0),
    structure("beak and claws", [84, 70, 52], 60.0),
    structure("fat", [240, 212, 128], 900.0),
    structure("muscle", [168, 66, 56], 330.0),
    bone("skull", [236, 228, 204], 1500.0),
    bone("lower jaw", [218, 204, 168], 1500.0),
    bone("neck vertebrae", [206, 194, 158], 1500.0),
    bone("back vertebrae", [196, 182, 142], 1500.0),
    bone("tail vertebrae", [186, 172, 132], 1500.0),
    bone("ribs", [228, 214, 178], 1500.0),
    bone("shoulder girdle", [212, 206, 182], 1500.0),
    bone("pelvis", [202, 196, 168], 1500.0),
    bone("forelimb bones", [240, 232, 210], 1500.0),
    bone("hindlimb bones", [230, 220, 194], 1500.0),
    structure("brain", [206, 158, 150], 480.0),
    structure("spinal cord", [238, 220, 120], 500.0),
    structure("eyes", [236, 238, 244], 130.0),
    structure("windpipe", [160, 198, 212], 0.0),
    structure("lungs", [222, 150, 156], 60.0),
    structure("heart", [176, 36, 40], 520.0),
    structure("vessels", [206, 44, 40], 640.0),
    structure("gullet", [196, 128, 96], 380.0),
    structure("stomach", [214, 146, 108], 280.0),
    structure("intestine", [222, 168, 124], 340.0),
    structure("liver", [128, 60, 44], 500.0),
    structure("gall bladder", [78, 136, 84], 760.0),
    structure("kidneys", [150, 70, 62], 400.0),
    structure("bladder", [224, 206, 110], 110.0),
];

/// Which parts can matter anywhere in a brick.
#[derive(Default)]
pub struct Scope {
    /// Whether the skin outside the shell is near; else everything is within.
    surface: bool,
    shell: bool,
    /// Whether the room within the shell is near.
    trunk: bool,
    head: bool,
    neck: bool,
    tail: bool,
    limbs: Vec<usize>,
    vessels: Vec<usize>,
}

pub struct Turtle {
    head: Head,
    limbs: [Limb; 4],
    back: Line,
    tail: Line,
    organs: organs::Courses,
}

impl Turtle {
    fn new(drawn_in: f32) -> Self {
        let head = Head::new(drawn_in);
        let (back, tail) = limbs::spine();
        let organs = organs::Courses::new(&head);
        Self { head, limbs: limbs::limbs(), back, tail, organs }
    }

    /// The skin, scales left out: the trunk within the shell's hull, and what comes out of it.
    fn skin(&self, p: Vec3, s: &Scope) -> f32 {
        let mut d = shell::hull(p) + 5.0;
        if s.neck {
            d = smin(d, self.head.skin(p), 6.0);
        }
        for &i in &s.limbs {
            d = smin(d, self.limbs[i].skin(p), 7.0);
        }
        if s.tail {
            d = smin(d, limbs::tail_skin(p), 8.0);
        }
        d
    }
}

/// Bounds of what belongs to the neck with the head, and to the tail.
fn neck_bound(p: Vec3) -> f32 {
    (p - vec3(3.0, 110.0, 12.0)).length() - 68.0
}

fn tail_bound(p: Vec3) -> f32 {
    (p - vec3(-8.0, -98.0, 0.0)).length() - 56.0
}

impl Model for Turtle {
    type Scope = Scope;

    fn scope(&self, center: Vec3, radius: f32) -> Option<Scope> {
        let p = center;
        // Distances are bounds only approximately: a quarter more than the brick's radius, and the blur.
        let r = radius * 1.3 + 3.0;
        let near = |d: f32| d < r + 6.0;
        let mut s = Scope {
            neck: near(neck_bound(p)),
            tail: near(tail_bound(p)),
            limbs: (0..4).filter(|&i| near(self.limbs[i].bound(p))).collect(),
            ..Scope::default()
        };
        let hull = shell::hull(p);
        let skin = self.skin(p, &s);
        // Claws stand out of the skin, and the rim out of the hull.
        if skin > r + 9.0 && hull > r + 12.0 {
            return None;
        }
        s.surface = skin > -r - 8.0;
        s.shell = hull > -r - 12.0 && hull < r + 14.0;
        s.trunk = hull < r;
        s.head = self.head.bound(p) < r;
        s.vessels = (0..self.organs.vessels.len()).filter(|&i| self.organs.vessels[i].bound(p) < r).collect();
        Some(s)
    }

    fn paint(&self, p: Vec3, s: &Scope, paint: &mut Paint<'_>) {
        let q = vec3(p.x.abs(), p.y, p.z);
        let hull = shell::hull(p);
        let mut skin = if s.surface { self.skin(p, s) } else { -60.0 };
        if skin.abs() < 3.0 && hull > -2.0 {
            // Scales: plates with grooves between.
            let (first, second) = cells(p * 0.27, 61);
            skin -= 0.7 * smoothstep(0.0, 0.30, second - first) - 0.45;
        }
        if skin < paint.blur {
            self.paint_body(p, q, skin, s, paint);
        }
        if s.neck {
            let beak = self.head.beak(p, skin);
            paint.put(beak, 240.0, Part::Horn);
        }
        for &i in &s.limbs {
            paint.put(self.limbs[i].claws(p), 260.0, Part::Horn);
        }
        if s.shell {
            self.paint_shell(p, paint);
        }
        if s.trunk {
            // Ribs are grown into the carapace.
            self.paint_bone(p, organs::ribs(q), Part::Ribs, paint);
        }
    }
}

impl Turtle {
    fn paint_shell(&self, p: Vec3, paint: &mut Paint<'_>) {
        let sponge = 90.0 * noise(p * 0.4, 62) + 40.0 * noise(p * 0.9, 63);
        let (plastron, plate) = shell::plastron(p);
        paint.put(plastron, 330.0, Part::Scutes);
        paint.put(plate, 760.0 + sponge, Part::Plastron);
        let (carapace, dome) = shell::carapace(p);
        paint.put(carapace, 330.0, Part::Scutes);
        paint.put(dome, 760.0 + sponge, Part::Carapace);
    }

    fn paint_body(&self, p: Vec3, q: Vec3, skin: f32, s: &Scope, paint: &mut Paint<'_>) {
        paint.put(skin, 45.0, Part::Skin);
        let grain = noise(p * 0.25, 64);
        paint.put(skin + 1.8, -96.0 + 8.0 * grain, Part::Fat);
        let flesh = 55.0 + 7.0 * grain;
        for &i in &s.limbs {
            paint.put(smax(self.limbs[i].skin(p) + 3.0, skin + 2.6, 1.0), flesh, Part::Muscle);
        }
        if s.neck {
            paint.put(smax(self.head.muscles(p), skin + 2.6, 1.0), flesh, Part::Muscle);
        }
        if s.tail {
            paint.put(smax(limbs::tail_skin(p) + 3.0, skin + 2.4, 1.0), flesh, Part::Muscle);
        }
        if s.trunk {
            self.paint_trunk(p, q, skin, flesh, paint);
        }
        if s.neck {
            self.paint_neck(p, skin, s, paint);
        }
        if !s.vessels.is_empty() {
            let vessel = s.vessels.iter().map(|&i| self.organs.vessels[i].distance(p)).fold(f32::MAX, f32::min);
            paint.put(smax(vessel, skin + 2.0, 0.5), 330.0, Part::Vessels);
        }
        for &i in &s.limbs {
            let limb = &self.limbs[i];
            self.paint_bone(p, limb.bones(p), if limb.is_fore { Part::ForeBones } else { Part::HindBones }, paint);
        }
        if s.tail {
            self.paint_bone(p, limbs::beads(p, &self.tail, 13, 2.4), Part::TailBones, paint);
        }
    }

    fn paint_trunk(&self, p: Vec3, q: Vec3, skin: f32, flesh: f32, paint: &mut Paint<'_>) {
        let room = shell::room(p);
        let within = smax(room + 1.0, skin + 2.5, 1.0);
        paint.put(smax(organs::girdle_muscles(q), within, 2.0), flesh, Part::Muscle);
        // Lungs: froth, and their tubes.
        let lungs = organs::lungs(q);
        paint.put(lungs, -790.0 + 60.0 * noise(p * 0.3, 65), Part::Lungs);
        if lungs < 3.0 {
            let tubes = self.organs.bronchi.iter().map(|t| t.distance(p)).fold(f32::MAX, f32::min);
            paint.tint(smax(tubes - 0.7, lungs, 0.5), -120.0, Part::Lungs);
            paint.tint(smax(tubes + 0.5, lungs, 0.5), -950.0, Part::Lungs);
        }
        paint.put(organs::kidneys(q), 210.0, Part::Kidneys);
        paint.put(organs::bladder(p).max(within), 8.0, Part::Bladder);
        // Walls around what has been eaten.
        let colon = smax(self.organs.colon.distance(p), skin + 2.0, 1.0);
        paint.put(colon, 60.0, Part::Intestine);
        paint.tint(colon + 1.8, 15.0 + 40.0 * noise(p * 0.2, 66), Part::Intestine);
        let intestine = self.organs.intestine.distance(p);
        paint.put(intestine, 70.0, Part::Intestine);
        paint.tint(intestine + 1.6, 150.0, Part::Intestine);
        let stomach = self.organs.stomach.distance(p);
        paint.put(stomach, 70.0, Part::Stomach);
        paint.tint(stomach + 2.2, 165.0, Part::Stomach);
        paint.put(organs::liver(p).max(within), 118.0 + 4.0 * noise(p * 0.3, 67), Part::Liver);
        paint.put(organs::gall_bladder(p), 12.0, Part::Gall);
        let (heart, chambers) = organs::heart(p);
        paint.put(heart, 110.0, Part::Heart);
        paint.tint(chambers + 2.4, 300.0, Part::Heart);
        self.paint_bone(p, organs::shoulder_girdle(q), Part::Shoulder, paint);
        self.paint_bone(p, organs::pelvis(q), Part::Pelvis, paint);
        let back = limbs::beads(p, &self.back, 10, 3.0);
        self.paint_bone(p, back, Part::Back, paint);
        paint.put(tube(p - Vec3::Z * 4.4, &self.back) + 1.7, 35.0, Part::Cord);
    }

    fn paint_neck(&self, p: Vec3, skin: f32, s: &Scope, paint: &mut Paint<'_>) {
        let gullet = self.organs.gullet.distance(p);
        paint.put(gullet, 65.0, Part::Gullet);
        paint.tint(gullet + 1.6, 20.0, Part::Gullet);
        let trachea = self.organs.trachea.distance(p);
        // Rings of cartilage.
        paint.put(trachea, 110.0, Part::Trachea);
        paint.tint(trachea + 1.1, AIR_HU, Part::Trachea);
        self.paint_bone(p, self.head.vertebrae(p), Part::Neck, paint);
        paint.put(self.head.cord(p), 35.0, Part::Cord);
        if s.head {
            let (skull, jaw) = self.head.bones(p);
            self.paint_bone(p, smax(skull, skin + 1.2, 0.8), Part::Skull, paint);
            self.paint_bone(p, smax(jaw, skin + 1.2, 0.8), Part::Jaw, paint);
            paint.put(self.head.brain(p), 38.0, Part::Brain);
            let eye = self.head.eyes(p);
            paint.put(eye, 60.0, Part::Eyes);
            paint.tint(eye + 1.2, 14.0, Part::Eyes);
        }
    }

    /// Compact bone; in thick ones it is spongy inside.
    fn paint_bone(&self, p: Vec3, d: f32, part: Part, paint: &mut Paint<'_>) {
        if d > 4.0 {
            return;
        }
        paint.put(d, 1500.0 + 80.0 * noise(p * 0.15, 68), part);
        if d < -1.0 {
            paint.tint(d + 2.2, 1180.0 + 80.0 * noise(p * 0.5, 69), part);
        }
    }
}

/// Makes the turtle with `resolution` voxels along its longest axis.
pub fn generate(resolution: usize, variant: &Variant, progress: &Progress) -> Result<Specimen> {
    let turtle = Turtle::new(variant.drawn_in as f32);
    painter::generate(&turtle, &PLAN, resolution, variant, progress)
}
