//! What is particular to the engine.

use rayon::prelude::*;

use super::*;
use crate::specimen::painter::{BLUR_VOXELS, Scanner};
use crate::volume::Voxels;

#[test]
fn leaving_out_far_parts_changes_no_voxel() {
    let made = generate(64, &Variant::default(), &Progress::new()).unwrap();
    let Voxels::I16(values) = &made.volume.voxels else { panic!() };
    let scanner = Scanner::new(&PLAN, &Variant::default());
    let full = Scope { castings: true, bottom: true, cylinders: true, top: true, ends: true, bolts: true };
    let [nx, ny, _] = made.labels.grid.dims();
    let spacing = made.labels.grid.spacing_mm().x as f32;
    let bad: Vec<String> = (0..values.len())
        .into_par_iter()
        .step_by(5)
        .filter_map(|i| {
            let at = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
            let p = made.labels.grid.world_from_index().transform_point3(at).as_vec3();
            let mut paint = Paint::new(BLUR_VOXELS * spacing, &scanner);
            Engine.paint(p, &full, &mut paint);
            // Four standard deviations of noise and its clipping.
            let off = (paint.value - f32::from(values[i])).abs();
            (off > 64.0 || paint.part != made.labels.voxels[i])
                .then(|| format!("{p} {} {} for {} {}", paint.part, paint.value, made.labels.voxels[i], values[i]))
        })
        .collect();
    assert!(bad.is_empty(), "{} voxels: {:#?}", bad.len(), &bad[..bad.len().min(40)]);
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
