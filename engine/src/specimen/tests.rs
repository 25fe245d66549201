//! What every specimen and every variant promises: determinism, label maps that are the truth, and one anatomy at every
//! resolution.

use std::sync::LazyLock;

use glam::DVec3;
use rayon::prelude::*;

use super::painter::{BLUR_VOXELS, Model, Paint, Plan, Scanner};
use super::*;
use crate::volume::Voxels;

fn make(text: &str) -> Specimen {
    Request::parse(text).unwrap().generate(&Progress::new()).unwrap()
}

static HEAD: LazyLock<Specimen> = LazyLock::new(|| make("head@96"));
static TURTLE: LazyLock<Specimen> = LazyLock::new(|| make("turtle@112"));
static ENGINE: LazyLock<Specimen> = LazyLock::new(|| make("engine@112"));

fn values(s: &Specimen) -> &[i16] {
    match &s.volume.voxels {
        Voxels::I16(v) => v,
        other => panic!("{}", other.type_name()),
    }
}

/// Paints every `step`-th voxel of `made` with all of a model in scope, and compares: what bricks leave out must not matter. `most`
/// is what noise and its clipping may add.
pub(super) fn assert_bricks_leave_out_nothing<M: Model>(
    made: &Specimen,
    model: &M,
    plan: &'static Plan,
    all: &M::Scope,
    most: f32,
    step: usize,
) where
    M::Scope: Sync,
{
    let scanner = Scanner::new(plan, &Variant::default());
    let values = values(made);
    let grid = &made.labels.grid;
    let [nx, ny, _] = grid.dims();
    let spacing = grid.spacing_mm().x as f32;
    let bad: Vec<String> = (0..values.len())
        .into_par_iter()
        .step_by(step)
        .filter_map(|i| {
            let at = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
            let p = grid.world_from_index().transform_point3(at).as_vec3();
            let mut paint = Paint::new(BLUR_VOXELS * spacing, &scanner);
            model.paint(p, all, &mut paint);
            let label = made.labels.voxels[i];
            let off = (paint.value.clamp(-1024.0, 3071.0) - f32::from(values[i])).abs();
            (off > most || paint.part != label)
                .then(|| format!("{p} {} {} for {label} {}", paint.part, paint.value, values[i]))
        })
        .collect();
    assert!(bad.is_empty(), "{} voxels: {:#?}", bad.len(), &bad[..bad.len().min(40)]);
}

fn id(s: &Specimen, name: &str) -> u16 {
    s.labels.labels.iter().position(|l| l.name == name).unwrap_or_else(|| panic!("no {name}")) as u16
}

fn world(s: &Specimen, i: usize) -> DVec3 {
    let [nx, ny, _] = s.labels.grid.dims();
    let at = DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
    s.labels.grid.world_from_index().transform_point3(at)
}

/// Volume in mm³, centroid and box of a structure.
fn extent(s: &Specimen, name: &str) -> (f64, DVec3, DVec3, DVec3) {
    let part = id(s, name);
    let (mut n, mut sum, mut lo, mut hi) = (0.0, DVec3::ZERO, DVec3::MAX, DVec3::MIN);
    for (i, _) in s.labels.voxels.iter().enumerate().filter(|(_, v)| **v == part) {
        let p = world(s, i);
        (n, sum, lo, hi) = (n + 1.0, sum + p, lo.min(p), hi.max(p));
    }
    (n * s.labels.grid.spacing_mm().element_product(), sum / n, lo, hi)
}

/// The median value of a structure.
fn median(s: &Specimen, name: &str) -> i16 {
    let part = id(s, name);
    let mut v: Vec<i16> = s.labels.voxels.iter().zip(values(s)).filter(|(l, _)| **l == part).map(|(_, v)| *v).collect();
    assert!(!v.is_empty(), "{name} is empty");
    let middle = v.len() / 2;
    *v.select_nth_unstable(middle).1
}

#[test]
fn every_run_and_every_number_of_threads_makes_the_same_voxels() {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let three = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for text in ["turtle@50", "engine@50", "turtle@40,turn=20/-30/70,drawn-in=0.4,mirrored,mr,without=skin"] {
        let (a, b) = (one.install(|| make(text)), three.install(|| make(text)));
        assert_eq!(a.volume.voxels, b.volume.voxels, "{text}");
        assert_eq!(a.labels.voxels, b.labels.voxels, "{text}");
    }
}

#[test]
fn the_longest_axis_has_the_resolution_asked_for() {
    for name in NAMES {
        for variant in ["", ",turn=10/20/30"] {
            let s = make(&format!("{name}@33{variant}"));
            assert_eq!(s.volume.grid.dims().into_iter().max(), Some(33));
            assert_eq!(s.labels.grid, s.volume.grid);
            assert_eq!(s.labels.voxels.len(), s.volume.grid.num_voxels());
            assert_eq!(s.volume.grid.orientation_letters(), "RAS");
        }
    }
    assert_eq!(make("engine@16").volume.modality, Modality::Unknown);
}

#[test]
fn every_structure_is_there_at_every_resolution() {
    for (fine, coarse) in [(&*TURTLE, make("turtle@96")), (&*ENGINE, make("engine@96"))] {
        for (i, label) in fine.labels.labels.iter().enumerate() {
            assert_eq!(label.id as usize, i);
            let (a, ..) = extent(fine, &label.name);
            let (b, ..) = extent(&coarse, &label.name);
            assert!(a > 0.0 && b > 0.0, "{} is empty", label.name);
            // Sheets that lie along the grid, and thin things, are counted by chance.
            if ["carapace", "liver", "lungs", "muscle", "fat", "block", "crankshaft", "pistons"].contains(&&*label.name)
            {
                assert!((b / a - 1.0).abs() < 0.12, "{}: {a:.0} and {b:.0} mm³", label.name);
            }
        }
    }
}

#[test]
fn values_are_those_of_the_structures() {
    for (name, range) in [
        ("background", -1000..=-1000),
        ("scutes", 120..=480),
        ("carapace", 600..=800),
        ("plastron", 560..=800),
        ("skin", -250..=60),
        ("fat", -110..=-60),
        ("muscle", 45..=65),
        ("skull", 500..=1400),
        ("ribs", 900..=1500),
        ("pelvis", 800..=1400),
        ("forelimb bones", 700..=1400),
        ("lungs", -850..=-700),
        ("heart", 150..=310),
        ("stomach", 90..=170),
        ("liver", 110..=122),
        ("kidneys", 120..=215),
        ("bladder", 0..=20),
    ] {
        assert!(range.contains(&median(&TURTLE, name)), "{name}: {} HU", median(&TURTLE, name));
    }
    for (name, range) in [
        ("background", 0..=0),
        ("block", 800..=1040),
        ("cylinder head", 800..=1040),
        ("coolant", 300..=600),
        ("oil", 200..=420),
        ("pistons", 1300..=2080),
        ("crankshaft", 2000..=2420),
        ("flywheel", 1400..=2200),
        ("bolts", 1200..=2420),
    ] {
        assert!(range.contains(&median(&ENGINE, name)), "{name}: {}", median(&ENGINE, name));
    }
}

#[test]
fn nothing_is_cut_off_by_the_box() {
    for text in [
        "turtle@64",
        "engine@64",
        "turtle@64,turn=0/0/45",
        "engine@64,turn=30/0/10",
        "turtle@64,drawn-in=1",
        "head@64,turn=10/5/30",
    ] {
        let s = make(text);
        let [nx, ny, nz] = s.labels.grid.dims();
        for (i, label) in s.labels.voxels.iter().enumerate() {
            let at = [i % nx, i / nx % ny, i / nx / ny];
            let at_face = at.iter().zip([nx, ny, nz]).any(|(a, n)| *a == 0 || *a == n - 1);
            assert!(*label == 0 || !at_face, "{text}: {label} at {at:?}");
        }
    }
}

#[test]
fn left_and_right_can_be_told_apart() {
    let side = |s: &Specimen, name: &str| extent(s, name).1.x;
    for (name, from, to) in [
        ("liver", 3.0, 40.0),
        ("stomach", -60.0, -20.0),
        ("tail vertebrae", -30.0, -1.0),
        ("gall bladder", 20.0, 60.0),
        ("skull", 2.0, 30.0),
    ] {
        assert!((from..to).contains(&side(&TURTLE, name)), "{name}: {}", side(&TURTLE, name));
    }
    // The bite in the rim is on the right.
    let carapace = id(&TURTLE, "carapace");
    let near = |x: f64| {
        let there = |i: usize| (world(&TURTLE, i) - DVec3::new(x, -62.0, 0.0)).length() < 7.0;
        (0..TURTLE.labels.voxels.len()).filter(|&i| TURTLE.labels.voxels[i] == carapace && there(i)).count()
    };
    assert!(near(67.0) == 0 && near(-67.0) > 10, "{} {}", near(67.0), near(-67.0));
    assert!(side(&ENGINE, "intake valves") < -10.0 && side(&ENGINE, "exhaust valves") > 10.0);
    assert!(side(&ENGINE, "intake camshaft") < -10.0 && side(&ENGINE, "exhaust camshaft") > 10.0);
    assert!(extent(&ENGINE, "flywheel").1.y < -150.0 && extent(&ENGINE, "timing wheels").1.y > 150.0);
}

#[test]
fn size_belongs_to_the_grid() {
    for (plain, name, part) in [(&*HEAD, "head@96", "mandible"), (&*TURTLE, "turtle@112", "skull")] {
        let large = make(&format!("{name},size=1.25"));
        assert_eq!(large.volume.voxels, plain.volume.voxels);
        let ((a, ca, loa, hia), (b, cb, lob, hib)) = (extent(plain, part), extent(&large, part));
        assert!((b / a - 1.25_f64.powi(3)).abs() < 1e-9);
        assert!((cb - ca * 1.25).length() < 1e-9 && ((hib - lob) - (hia - loa) * 1.25).length() < 1e-9);
    }
}

#[test]
fn mirrored_is_the_same_anatomy_the_other_way_round() {
    for (plain, name) in [(&*HEAD, "head@96"), (&*TURTLE, "turtle@112"), (&*ENGINE, "engine@112")] {
        let other = make(&format!("{name},mirrored"));
        let nx = plain.labels.grid.dims()[0];
        assert_eq!(plain.labels.grid, other.labels.grid);
        let rows = plain.labels.voxels.chunks(nx).zip(other.labels.voxels.chunks(nx));
        let differ = rows.flat_map(|(a, b)| a.iter().zip(b.iter().rev())).filter(|(a, b)| a != b).count();
        // The grid's places are rounded, so a border may fall to either side.
        assert!(differ < plain.labels.voxels.len() / 10_000, "{name}: {differ}");
    }
    assert!(extent(&make("turtle@64,mirrored"), "stomach").1.x > 20.0);
}

#[test]
fn turned_labels_are_the_plain_ones_moved() {
    for (plain, name, parts) in [
        (&*HEAD, "head@96", ["skull", "mandible", "eyes", "brain white matter"]),
        (&*TURTLE, "turtle@112", ["carapace", "skull", "liver", "heart"]),
        (&*ENGINE, "engine@112", ["crankshaft", "block", "flywheel", "intake valves"]),
    ] {
        let request = Request::parse(&format!("{name},turn=25/-15/40,mirrored,size=0.8")).unwrap();
        let turned = request.generate(&Progress::new()).unwrap();
        for part in parts {
            let ((a, at, ..), (b, moved, ..)) = (extent(plain, part), extent(&turned, part));
            let off = (moved - request.variant.place(at)).length();
            assert!(off < 0.6 * turned.labels.grid.spacing_mm().x, "{name} {part}: {off:.2} mm off");
            assert!((b / a / 0.8_f64.powi(3) - 1.0).abs() < 0.15, "{name} {part}: {a:.0} and {b:.0} mm³");
        }
    }
}

#[test]
fn what_is_left_out_is_gone() {
    let without = make("head@96,without=mandible");
    let (jaw, teeth) = (id(&HEAD, "mandible"), id(&HEAD, "teeth"));
    assert!(!without.labels.voxels.contains(&jaw));
    let mut lower_teeth = 0;
    for (i, label) in HEAD.labels.voxels.iter().enumerate() {
        // A voxel away from the skull, nothing of bone is left.
        let was_lower_tooth = *label == teeth && world(&HEAD, i).z < -57.0;
        lower_teeth += usize::from(was_lower_tooth);
        if (*label == jaw || was_lower_tooth) && without.labels.voxels[i] != teeth {
            assert!(without.labels.voxels[i] != jaw && values(&without)[i] < 1000, "{}", world(&HEAD, i));
        }
        if *label == jaw && world(&HEAD, i).z < -62.0 {
            assert!(values(&without)[i] < 200, "{} at {}", values(&without)[i], world(&HEAD, i));
        }
    }
    assert!(lower_teeth > 100);
    // The upper teeth stay.
    let upper = |s: &Specimen| {
        (0..s.labels.voxels.len()).filter(|&i| s.labels.voxels[i] == teeth && world(s, i).z > -48.0).count()
    };
    assert_eq!(upper(&without), upper(&HEAD));
    // Several at once; what lies under them shows.
    let bare = make("turtle@112,without=scutes+carapace+plastron");
    for name in ["scutes", "carapace", "plastron"] {
        assert!(!bare.labels.voxels.contains(&id(&bare, name)), "{name}");
    }
    assert!(extent(&bare, "skin").0 > 1.5 * extent(&TURTLE, "skin").0);
    let gutted = make("engine@64,without=block");
    assert!(!gutted.labels.voxels.contains(&id(&gutted, "block")));
}

#[test]
fn scanners_differ_in_noise_and_calibration() {
    let plain = make("turtle@64");
    let off = make("turtle@64,slope=0.95,offset=-30");
    for (a, b) in values(&plain).iter().zip(values(&off)) {
        assert_eq!(*b, (f64::from(*a) * 0.95 - 30.0).round() as i16);
    }
    let (still, noisy) = (make("turtle@64,noise=0"), make("turtle@64,noise=20"));
    assert_eq!(plain.labels.voxels, noisy.labels.voxels);
    let (mut n, mut squares) = (0.0, 0.0);
    for (i, label) in plain.labels.voxels.iter().enumerate() {
        let d = f64::from(values(&noisy)[i]) - f64::from(values(&still)[i]);
        if *label == id(&plain, "liver") {
            (n, squares) = (n + 1.0, squares + d * d);
        }
        // Air outside stays clean.
        assert!(*label != 0 || values(&still)[i] > -1000 || d.abs() <= 1.0);
    }
    let deviation = f64::sqrt(squares / n);
    assert!((deviation - 20.0).abs() < 1.5, "{deviation}");
}

#[test]
fn magnetic_resonance_sees_fat_and_water_instead_of_density() {
    for (name, fat, muscle, hard) in [("head@96", "fat", "muscle", "teeth"), ("turtle@112", "fat", "muscle", "scutes")]
    {
        let mr = make(&format!("{name},mr"));
        assert_eq!(mr.volume.modality, Modality::Mr);
        assert!(values(&mr).iter().all(|v| *v >= 0));
        assert_eq!(median(&mr, "background"), 0);
        let (fat, muscle, hard) = (median(&mr, fat), median(&mr, muscle), median(&mr, hard));
        assert!(
            2 * fat > 3 * muscle && muscle > 200 && hard < 300,
            "{name}: fat {fat}, muscle {muscle}, teeth or horn {hard}"
        );
    }
    let mr = make("head@96,mr");
    assert_eq!(mr.labels.voxels, HEAD.labels.voxels);
    let (white, gray, water) =
        (median(&mr, "brain white matter"), median(&mr, "brain gray matter"), median(&mr, "ventricles"));
    assert!(white > gray + 80 && gray > 2 * water, "{white} {gray} {water}");
    // The bias field: the same tissue is not the same everywhere.
    let white = id(&mr, "brain white matter");
    let half = |front: bool| {
        let there = (0..mr.labels.voxels.len())
            .filter(|&i| mr.labels.voxels[i] == white && (world(&mr, i).y > -20.0) == front)
            .map(|i| f64::from(values(&mr)[i]));
        let (n, sum) = there.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
        sum / n
    };
    assert!((half(true) / half(false) - 1.0).abs() > 0.02, "{} {}", half(true), half(false));
}

#[test]
fn the_turtle_draws_its_head_in() {
    let shy = make("turtle@112,drawn-in=1");
    let (before, after) = (extent(&TURTLE, "skull"), extent(&shy, "skull"));
    assert!(after.1.y < before.1.y - 30.0 && after.3.y < 116.0, "{} {}", after.1, after.3);
    assert!((extent(&shy, "carapace").0 / extent(&TURTLE, "carapace").0 - 1.0).abs() < 0.03);
    assert!(shy.volume.grid.dims() != TURTLE.volume.grid.dims(), "the box fits what is there");
}

#[test]
fn what_cannot_be_is_refused_with_what_can() {
    for (text, part) in [
        ("unicorn", "the specimens are: head, turtle, engine"),
        ("turtle@8", "choose 16 to 1024"),
        ("turtle,without=mandible", "lower-jaw"),
        ("turtle,without=background", "its structures are"),
        ("head,drawn-in=0.5", "leave drawn-in out"),
        ("engine,mr", "leave mr out"),
    ] {
        let message = Request::parse(text).unwrap().generate(&Progress::new()).unwrap_err().to_string();
        assert!(message.contains(part), "{text}: {message}");
    }
    assert!(NAMES.iter().all(|name| version(name) > 0) && version("unicorn") == 0);
    let progress = Progress::new();
    progress.cancel();
    for name in NAMES {
        assert!(matches!(generate(name, 64, &progress), Err(Error::Cancelled)));
    }
}
