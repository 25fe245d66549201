//! `specimen:engine`: an inline four with two overhead camshafts as industrial CT would show it, modeled in
//! millimeters from signed distances: castings of aluminum with bores, jackets and channels, and what moves in them,
//! of steel.
//!
//! World frame: y runs along the crankshaft toward the front of the engine (belt and fan), z along the bores upward,
//! x > 0 is the RIGHT as seen from the flywheel, where the exhaust leaves; the origin lies on the crankshaft, midway
//! between the second and the third cylinder. The box is 200 x 394 x 352 mm.
//!
//! Values are those of a scanner that was set up for metal: air 0, aluminum 1000, steel 2400.
//!
//! Marks that tell left from right, so that a mirrored picture is noticed:
//! - intake, oil gallery and the pad of the oil filter are on the LEFT, exhaust and the belt's tensioner on the RIGHT;
//! - front (belt, pulley) and rear (flywheel) differ.

mod bottom;
mod castings;
#[cfg(test)]
mod tests;
mod top;

use glam::{DVec3, Vec3, vec3};

use super::Specimen;
use super::painter::{self, Model, Paint, Plan, Structure, structure};
use super::sdf::*;
use super::variant::Variant;
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Modality;

/// See [`super::version`].
pub const VERSION: u32 = 1;

/// What the engine is, apart from its shape.
pub const PLAN: Plan = Plan {
    name: "engine",
    bounds: (DVec3::new(-100.0, -194.0, -92.0), DVec3::new(100.0, 200.0, 260.0)),
    cut_z: None,
    air: 0.0,
    noise: 16.0,
    noise_range: 400.0,
    modality: Modality::Unknown,
    structures: &STRUCTURES,
};

/// Structures by their position in the label table, which is also their id.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u16)]
enum Part {
    Block = 1,
    CylinderHead,
    Cover,
    Pan,
    Liners,
    Gaskets,
    Coolant,
    Oil,
    Pistons,
    Rings,
    Pins,
    Rods,
    Crank,
    Caps,
    Flywheel,
    Wheels,
    IntakeValves,
    ExhaustValves,
    Springs,
    IntakeCam,
    ExhaustCam,
    Plugs,
    Ceramic,
    Bolts,
}

impl From<Part> for u16 {
    fn from(part: Part) -> Self {
        part as Self
    }
}

/// Names and colors, in the order of [`Part`].
static STRUCTURES: [Structure; 25] = [
    structure("background", [0, 0, 0], 0.0),
    structure("block", [172, 178, 184], 0.0),
    structure("cylinder head", [192, 196, 198], 0.0),
    structure("cam cover", [156, 44, 40], 0.0),
    structure("oil pan", [92, 98, 104], 0.0),
    structure("liners", [122, 132, 142], 0.0),
    structure("gaskets", [60, 60, 64], 0.0),
    structure("coolant", [72, 168, 132], 0.0),
    structure("oil", [196, 148, 48], 0.0),
    structure("pistons", [214, 214, 208], 0.0),
    structure("piston rings", [96, 92, 90], 0.0),
    structure("piston pins", [136, 148, 164], 0.0),
    structure("connecting rods", [150, 128, 96], 0.0),
    structure("crankshaft", [112, 118, 128], 0.0),
    structure("bearing caps", [126, 134, 130], 0.0),
    structure("flywheel", [86, 88, 94], 0.0),
    structure("timing wheels", [184, 152, 72], 0.0),
    structure("intake valves", [92, 140, 192], 0.0),
    structure("exhaust valves", [196, 108, 64], 0.0),
    structure("valve springs", [206, 184, 88], 0.0),
    structure("intake camshaft", [112, 136, 164], 0.0),
    structure("exhaust camshaft", [164, 128, 108], 0.0),
    structure("spark plugs", [176, 172, 160], 0.0),
    structure("plug insulators", [244, 242, 236], 0.0),
    structure("bolts", [70, 74, 82], 0.0),
];

/// Values of the materials.
mod material {
    pub const ALUMINUM: f32 = 1000.0;
    pub const LINER: f32 = 1500.0;
    pub const PISTON: f32 = 2050.0;
    pub const IRON: f32 = 2150.0;
    pub const STEEL: f32 = 2400.0;
    pub const VALVE: f32 = 2550.0;
    pub const CERAMIC: f32 = 1450.0;
    pub const COOLANT: f32 = 380.0;
    pub const OIL: f32 = 300.0;
    pub const RUBBER: f32 = 520.0;
}

/// From one cylinder to the next, mm.
const PITCH: f32 = 76.0;
/// Radius of the bores and of the crank.
const BORE: f32 = 30.0;
const CRANK: f32 = 28.0;
/// From the crankpin to the piston pin.
const ROD: f32 = 96.0;
/// Top of the block and of the cylinder head.
const DECK: f32 = 148.0;
const HEAD_TOP: f32 = 214.0;
/// Half the length of the block.
const HALF_LENGTH: f32 = 154.0;

/// A position by its cylinder: the number of the cylinder, 0 at the rear, and y from its axis.
fn cylinder(p: Vec3) -> (usize, Vec3) {
    let i = (p.y / PITCH + 1.5).round().clamp(0.0, 3.0);
    (i as usize, vec3(p.x, p.y - (i - 1.5) * PITCH, p.z))
}

/// Sine and cosine of the crank's angle at a cylinder: outer pins stand opposite the inner ones, all 40° past dead
/// center.
fn crank_angle(i: usize) -> (f32, f32) {
    let (s, c) = sin_cos(0.70);
    if i == 0 || i == 3 { (s, c) } else { (-s, -c) }
}

/// A cylinder along y about the origin.
fn disc_y(p: Vec3, radius: f32, half: f32, edge: f32) -> f32 {
    smax((p.x * p.x + p.z * p.z).sqrt() - radius, p.y.abs() - half, edge)
}

/// A cylinder along z about the origin.
fn disc_z(p: Vec3, radius: f32, half: f32, edge: f32) -> f32 {
    smax((p.x * p.x + p.y * p.y).sqrt() - radius, p.z.abs() - half, edge)
}

/// Which parts can matter anywhere in a brick.
#[derive(Default)]
pub struct Scope {
    castings: bool,
    bottom: bool,
    cylinders: bool,
    top: bool,
    ends: bool,
    bolts: bool,
}

pub struct Engine;

impl Model for Engine {
    type Scope = Scope;

    fn scope(&self, p: Vec3, radius: f32) -> Option<Scope> {
        let r = radius * 1.2 + 3.0;
        let hull = castings::hull(p);
        let ends = bottom::ends_bound(p);
        let bolts = castings::outer_bolts(p);
        if hull.min(ends).min(bolts) > r {
            return None;
        }
        Some(Scope {
            castings: hull < r,
            bottom: p.z < 45.0 + r && hull < r,
            cylinders: p.z < DECK + r && hull < r,
            // The camshafts reach out of the castings to their wheels.
            top: p.z > DECK - 6.0 - r && hull.min(ends) < r,
            ends: ends < r,
            bolts: true,
        })
    }

    fn paint(&self, p: Vec3, s: &Scope, paint: &mut Paint<'_>) {
        if s.castings {
            castings::paint(p, paint);
        }
        if s.cylinders {
            bottom::paint_cylinder(p, paint);
        }
        if s.bottom || s.ends {
            bottom::paint_crank(p, paint);
        }
        if s.top {
            top::paint(p, paint);
        }
        if s.ends {
            bottom::paint_ends(p, paint);
        }
        if s.bolts {
            castings::paint_bolts(p, paint);
        }
    }
}

/// Makes the engine with `resolution` voxels along its longest axis.
pub fn generate(resolution: usize, variant: &Variant, progress: &Progress) -> Result<Specimen> {
    painter::generate(&Engine, &PLAN, resolution, variant, progress)
}

/// Sine and cosine of an angle in turns, 0 to 1.5.
fn turned(turns: f32) -> (f32, f32) {
    let t = turns - turns.round();
    // Within a quarter of a turn the series is good; the other half mirrors it.
    let fold = if t.abs() > 0.25 { 0.5 * t.signum() - t } else { t };
    let (s, c) = sin_cos(fold * std::f32::consts::TAU);
    (s, if t.abs() > 0.25 { -c } else { c })
}
