//! What is particular to the engine.

use super::*;
use crate::specimen::tests::assert_bricks_leave_out_nothing;

#[test]
fn leaving_out_far_parts_changes_no_voxel() {
    let made = generate(64, &Variant::default(), &Progress::new()).unwrap();
    let full = Scope { castings: true, bottom: true, cylinders: true, top: true, ends: true, bolts: true };
    // Four standard deviations of noise and its clipping.
    assert_bricks_leave_out_nothing(&made, &Engine, &PLAN, &full, 64.0, 5);
}

#[test]
fn turns_are_angles() {
    for i in -20..=60 {
        let turns = i as f32 / 40.0;
        let (s, c) = turned(turns);
        let angle = f64::from(turns) * std::f64::consts::TAU;
        assert!((f64::from(s) - angle.sin()).abs() < 1e-4 && (f64::from(c) - angle.cos()).abs() < 1e-4, "{turns}");
    }
}

#[test]
fn valves_do_not_meet_pistons() {
    // The space between what is open and what comes up.
    let made = generate(112, &Variant::default(), &Progress::new()).unwrap();
    let [nx, ny, nz] = made.labels.grid.dims();
    let at = |x: usize, y: usize, z: usize| made.labels.voxels[x + nx * (y + ny * z)];
    let is_valve = |v: u16| v == Part::IntakeValves as u16 || v == Part::ExhaustValves as u16;
    for z in 0..nz - 1 {
        for y in 0..ny {
            for x in 0..nx {
                assert!(!(at(x, y, z) == Part::Pistons as u16 && is_valve(at(x, y, z + 1))), "{x} {y} {z}");
            }
        }
    }
}
