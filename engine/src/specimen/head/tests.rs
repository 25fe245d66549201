//! What the head promises: determinism, one anatomy at every resolution, plausible sizes and densities, and the
//! marks that tell left from right.

use std::sync::LazyLock;

use super::*;
use crate::error::Error;
use crate::specimen::tests::assert_bricks_leave_out_nothing;
use crate::specimen::{DEFAULT_RESOLUTION, NAMES, generate, version};
use crate::volume::Voxels;

static HEAD: LazyLock<Specimen> = LazyLock::new(|| generate("head", 128, &Progress::new()).unwrap());

fn hu(s: &Specimen) -> &[i16] {
    match &s.volume.voxels {
        Voxels::I16(v) => v,
        other => panic!("{}", other.type_name()),
    }
}

/// Volume of every structure in ml.
fn volumes_ml(s: &Specimen) -> Vec<f64> {
    let ml = s.labels.grid.spacing_mm().element_product() / 1000.0;
    let mut counts = vec![0_usize; s.labels.labels.len()];
    for &v in &s.labels.voxels {
        counts[usize::from(v)] += 1;
    }
    counts.into_iter().map(|n| n as f64 * ml).collect()
}

fn world(s: &Specimen, i: usize) -> Vec3 {
    let [nx, ny, _] = s.labels.grid.dims();
    let at = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
    s.labels.grid.world_from_index().transform_point3(at).as_vec3()
}

#[test]
fn every_run_and_every_number_of_threads_makes_the_same_voxels() {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let three = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let make = || generate("head", 50, &Progress::new()).unwrap();
    let (a, b) = (one.install(make), three.install(make));
    assert_eq!(a.volume.voxels, b.volume.voxels);
    assert_eq!(a.labels.voxels, b.labels.voxels);
}

/// FNV-1a over the voxels and the label map: with `VERSION`, they must stay what they are.
#[test]
fn the_voxels_are_those_of_this_version() {
    let s = generate("head", 64, &Progress::new()).unwrap();
    let voxels = hu(&s).iter().map(|v| *v as u16).chain(s.labels.voxels.iter().copied());
    let hash = voxels.fold(0xcbf2_9ce4_8422_2325_u64, |h, v| (h ^ u64::from(v)).wrapping_mul(0x0100_0000_01b3));
    assert_eq!((VERSION, format!("{hash:016x}").as_str()), (2, "e3a6aeef44e660ae"));
}

#[test]
fn the_longest_axis_has_the_resolution_asked_for() {
    for resolution in [16, 17, 33] {
        let s = generate("head", resolution, &Progress::new()).unwrap();
        let dims = s.volume.grid.dims();
        assert_eq!(dims.into_iter().max(), Some(resolution));
        assert_eq!(s.labels.grid, s.volume.grid);
        assert_eq!(s.labels.voxels.len(), s.volume.grid.num_voxels());
        assert_eq!(s.volume.grid.orientation_letters(), "RAS");
    }
    let spacing = 248.0 / DEFAULT_RESOLUTION as f64;
    assert!((0.9..1.0).contains(&spacing));
}

#[test]
fn unknown_names_and_senseless_resolutions_are_refused() {
    let text = |name: &str, n: usize| generate(name, n, &Progress::new()).unwrap_err().to_string();
    assert_eq!(text("foot", 64), "there is no specimen named \"foot\"; the specimens are: head, turtle, engine");
    for n in [0, 15, 1025] {
        assert_eq!(
            text("head", n),
            format!("a specimen cannot be made with {n} voxels along its longest axis; choose 16 to 1024")
        );
    }
    assert!(NAMES.iter().all(|name| version(name) > 0));
    let progress = Progress::new();
    progress.cancel();
    assert!(matches!(generate("head", 64, &progress), Err(Error::Cancelled)));
}

#[test]
fn structures_have_plausible_volumes() {
    let ml = volumes_ml(&HEAD);
    let of = |part: Part| ml[part as usize];
    for (i, label) in HEAD.labels.labels.iter().enumerate() {
        assert!(ml[i] > 0.0, "{} is empty", label.name);
        assert_eq!(label.id as usize, i);
    }
    let brain = of(Part::Gray) + of(Part::White) + of(Part::Cerebellum) + of(Part::Stem);
    assert!((1100.0..1500.0).contains(&brain), "brain {brain} ml");
    for (part, range) in [
        (Part::Skull, 500.0..900.0),
        (Part::Mandible, 45.0..90.0),
        (Part::Teeth, 9.0..25.0),
        (Part::Ventricles, 12.0..45.0),
        (Part::Cerebellum, 100.0..170.0),
        (Part::Eyes, 11.0..17.0),
        (Part::Lenses, 0.2..0.7),
        (Part::Airways, 40.0..140.0),
        (Part::Arteries, 12.0..50.0),
        (Part::Veins, 15.0..70.0),
    ] {
        assert!(range.contains(&of(part)), "{part:?} {} ml", of(part));
    }
}

#[test]
fn anatomy_does_not_depend_on_the_resolution() {
    let coarse = volumes_ml(&generate("head", 96, &Progress::new()).unwrap());
    let fine = volumes_ml(&HEAD);
    for (i, label) in HEAD.labels.labels.iter().enumerate() {
        // Structures of a few voxels across are counted less exactly.
        let tolerance = match fine[i] {
            ..2.0 => 0.25,
            2.0..40.0 => 0.12,
            _ => 0.03,
        };
        let ratio = coarse[i] / fine[i];
        assert!((ratio - 1.0).abs() < tolerance, "{}: {:.2} and {:.2} ml", label.name, coarse[i], fine[i]);
    }
}

#[test]
fn densities_are_those_of_the_tissues() {
    // The median per structure: partial volume at the boundaries does not move it in thick ones.
    let mut values = vec![Vec::new(); HEAD.labels.labels.len()];
    for (&label, &v) in HEAD.labels.voxels.iter().zip(hu(&HEAD)) {
        values[usize::from(label)].push(v);
    }
    let mut median = |part: Part| {
        let v = &mut values[part as usize];
        let middle = v.len() / 2;
        *v.select_nth_unstable(middle).1
    };
    for (part, range) in [
        (Part::Background, -1000..=-1000),
        (Part::Fat, -110..=-25),
        (Part::Muscle, 40..=65),
        (Part::Skull, 500..=1100),
        (Part::Mandible, 500..=1200),
        (Part::Teeth, 1300..=2400),
        (Part::Vertebrae, 450..=1000),
        (Part::Gray, 34..=44),
        (Part::White, 24..=29),
        (Part::Ventricles, 5..=12),
        (Part::Fluid, 5..=25),
        (Part::Cerebellum, 27..=41),
        (Part::Stem, 31..=36),
        (Part::Arteries, 220..=340),
        (Part::Veins, 200..=270),
        (Part::Eyes, 9..=40),
        (Part::Lenses, 50..=90),
        (Part::OpticNerves, 0..=45),
        (Part::Airways, -1010..=-850),
    ] {
        let m = median(part);
        assert!(range.contains(&m), "{part:?}: {m} HU");
    }
    assert!(hu(&HEAD).iter().all(|v| (-1024..=3071).contains(v)));
}

#[test]
fn left_and_right_can_be_told_apart() {
    let count = |test: &dyn Fn(usize, Vec3) -> bool| {
        let mut sides = [0_usize; 2];
        for i in 0..HEAD.labels.voxels.len() {
            let p = world(&HEAD, i);
            if test(i, p) {
                sides[usize::from(p.x > 0.0)] += 1;
            }
        }
        (sides[0], sides[1])
    };
    // Gold is on the right.
    let (left, right) = count(&|i, _| hu(&HEAD)[i] > 2600);
    assert!(left == 0 && right > 4, "{left} {right}");
    // The nevus stands out of the skin on the left.
    let (left, right) =
        count(&|i, p| hu(&HEAD)[i] > -700 && p.y > 60.0 && face::skin_without_nevus(asymmetry(p)) > 1.0);
    assert!(left > 1 && right == 0, "{left} {right}");
    // The right transverse sinus takes most of the blood.
    let sinus = Part::Veins as u16;
    let (left, right) =
        count(&|i, p| HEAD.labels.voxels[i] == sinus && p.x.abs() > 15.0 && p.y < -35.0 && p.z.abs() < 9.0);
    assert!(right as f32 > 1.7 * left as f32 && left > 0, "{left} {right}");
}

#[test]
fn the_mandible_is_free_of_the_skull() {
    let [nx, ny, nz] = HEAD.labels.grid.dims();
    let at = |x: usize, y: usize, z: usize| HEAD.labels.voxels[x + nx * (y + ny * z)];
    let (jaw, skull) = (Part::Mandible as u16, Part::Skull as u16);
    let touch = |a: u16, b: u16| (a == jaw && b == skull) || (a == skull && b == jaw);
    for z in 0..nz - 1 {
        for y in 0..ny - 1 {
            for x in 0..nx - 1 {
                let a = at(x, y, z);
                assert!(!touch(a, at(x + 1, y, z)) && !touch(a, at(x, y + 1, z)) && !touch(a, at(x, y, z + 1)));
            }
        }
    }
}

#[test]
fn leaving_out_far_parts_changes_no_voxel() {
    let head = Head::new();
    let full = Scope {
        surface: true,
        face: true,
        ear: true,
        skull: true,
        mandible: true,
        vertebrae: true,
        cavity: true,
        cerebrum: true,
        ventricles: true,
        cerebellum: true,
        stem: true,
        orbit: true,
        airways: true,
        muscles: true,
        teeth: (0..head.teeth.len()).collect(),
        tubes: (0..head.tubes.len()).collect(),
    };
    // Four standard deviations of noise and its clipping.
    assert_bricks_leave_out_nothing(&HEAD, &head, &PLAN, &full, 15.0, 61);
}
