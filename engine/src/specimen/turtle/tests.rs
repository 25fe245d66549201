//! What is particular to the turtle.

use rayon::prelude::*;

use super::*;
use crate::specimen::painter::{BLUR_VOXELS, Scanner};
use crate::volume::Voxels;

#[test]
fn leaving_out_far_parts_changes_no_voxel() {
    let made = generate(64, &Variant::default(), &Progress::new()).unwrap();
    let Voxels::I16(hu) = &made.volume.voxels else { panic!() };
    let turtle = Turtle::new(0.0);
    let scanner = Scanner::new(&PLAN, &Variant::default());
    let full = Scope {
        surface: true,
        shell: true,
        trunk: true,
        head: true,
        neck: true,
        tail: true,
        limbs: (0..4).collect(),
        vessels: (0..turtle.organs.vessels.len()).collect(),
    };
    let [nx, ny, _] = made.labels.grid.dims();
    let spacing = made.labels.grid.spacing_mm().x as f32;
    let bad: Vec<String> = (0..hu.len())
        .into_par_iter()
        .step_by(5)
        .filter_map(|i| {
            let at = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
            let p = made.labels.grid.world_from_index().transform_point3(at).as_vec3();
            let mut paint = Paint::new(BLUR_VOXELS * spacing, &scanner);
            turtle.paint(p, &full, &mut paint);
            // Four standard deviations of noise and its clipping.
            let off = (paint.value - f32::from(hu[i])).abs();
            (off > 15.0 || paint.part != made.labels.voxels[i])
                .then(|| format!("{p} {} {} for {} {}", paint.part, paint.value, made.labels.voxels[i], hu[i]))
        })
        .collect();
    assert!(bad.is_empty(), "{} voxels: {:#?}", bad.len(), &bad[..bad.len().min(40)]);
}
