//! Regions: the raycaster against the f64 reference, the defects that the comparison must notice, what is shared out without a
//! seam, edits, and the extremes.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::gpu::context::VolumeFormats;
use fabrica_engine::measure::Difference;
use fabrica_engine::pass::raycast::ShaderPatch;
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::{Object, Projection, Quality, Scene};
use fabrica_engine::selection::{BrickPool, Selection};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use fabrica_tests::phantom::{self, add, ball, centered, function, lumpy, selection};
use fabrica_tests::twin::{self, ENDLESS, difference, replace};
use fabrica_tests::{renderer, software};
use glam::{DAffine3, DVec3};

const SIZE: [u32; 2] = [48, 40];

pub const BODY: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
pub const VEIL: &[(f64, &str, f64)] = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.1)];
pub const SOLID: &[(f64, &str, f64)] = &[(250.0, "clay", 0.0), (350.0, "steel", 0.8)];
pub const THIN: &[(f64, &str, f64)] = &[(100.0, "clay", 0.001), (900.0, "cool_warm", 0.02)];

/// A body with a fuzzy ball, a crisp half that overlaps it, and a cut-out corner.
pub fn divided(volume: &Arc<Volume>, nodes: &[(f64, &str, f64)], quality: Quality) -> Scene {
    let mut scene = phantom::scene(volume, nodes, quality);
    let pool = Arc::default();
    let grid = &volume.grid;
    add(&mut scene, selection(grid, &pool, |p| ball(p, DVec3::new(-4.0, 3.0, 1.0), 7.0)), SOLID, 1.0, None, 1.0);
    let half = selection(grid, &pool, |p| f64::from(u8::from(p.x + 0.3 * p.z > 2.0)));
    add(&mut scene, half, VEIL, 2.0, Some([0.2, 0.6, 0.9]), 0.7);
    let corner = selection(grid, &pool, |p| f64::from(u8::from(p.min_element() > 1.0)));
    add(&mut scene, corner, BODY, 1.0, None, 0.0);
    scene
}

fn draw(renderer: &mut Renderer, scene: &Scene) -> FloatImage {
    twin::draw(renderer, scene, SIZE)
}

fn compare(renderer: &mut Renderer, scene: &Scene) -> Result<Difference, String> {
    twin::compare(renderer, scene, SIZE)
}

#[test]
fn regions_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for nodes in [BODY, VEIL, THIN] {
        for quality in [Quality::DRAFT, Quality::STANDARD, Quality::FINAL] {
            for projection in
                [Projection::Perspective { fov_y_deg: 20.0 }, Projection::Orthographic { height_mm: 40.0 }]
            {
                let volume = lumpy();
                let mut scene = divided(&volume, nodes, quality);
                scene.camera = phantom::camera(&volume, DVec3::new(-0.7, 0.5, 0.4), projection);
                let found = compare(&mut renderer, &scene);
                println!("{} {quality:?} {projection:?}: {found:?}", nodes[0].1);
                found.unwrap();
            }
        }
    }
}

#[test]
fn regions_of_awkward_grids_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for (name, volume) in phantom::awkward() {
        let found = compare(&mut renderer, &divided(&volume, BODY, Quality::STANDARD));
        println!("{name}: {found:?}");
        found.unwrap();
    }
}

#[test]
fn regions_of_colors_and_of_volumes_with_gaps_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let dims = [24; 3];
    let grid = Grid::new(dims, centered(dims, DVec3::ONE)).unwrap();
    let place = |i: usize| DVec3::new((i % 24) as f64, (i / 24 % 24) as f64, (i / 576) as f64);
    let nodes = &[(0.01, "plaster", 0.0), (0.05, "plaster", 0.9), (0.3, "porcelain", 1.0)];
    let colored = phantom::colored(|_| 255);
    let mut scene = phantom::scene(&colored, nodes, Quality::STANDARD);
    let pool = Arc::default();
    add(
        &mut scene,
        selection(&grid, &pool, |p| ball(p, DVec3::new(5.0, 2.0, 1.0), 7.0)),
        nodes,
        1.0,
        Some([0.9, 0.2, 0.1]),
        1.0,
    );
    add(&mut scene, selection(&grid, &pool, |p| 0.1 * p.z), &[(0.1, "wax", 0.1)], 1.0, None, 0.8);
    compare(&mut renderer, &scene).unwrap();

    let value = |i: usize| {
        let p = place(i);
        if (p.x + p.y) % 7.0 == 3.0 { f32::NAN } else { (900.0 - 70.0 * p.distance(DVec3::splat(11.0))) as f32 }
    };
    let volume = Volume::new(grid, Voxels::F32((0..13824).map(value).collect()), Rescale::IDENTITY, "test").unwrap();
    compare(&mut renderer, &divided(&Arc::new(volume), THIN, Quality::STANDARD)).unwrap();
}

#[test]
fn adapters_without_filters_draw_regions_alike() {
    let scene = divided(&lumpy(), BODY, Quality::STANDARD);
    let mut context = software();
    context.formats = VolumeFormats { r16_filterable: false, r32_filterable: false, ..context.formats };
    // Where memberships have 8 bits only, so has a software adapter's filter.
    let found = compare(&mut Renderer::new(context), &scene);
    println!("{found:?}");
    found.unwrap();
}

/// What is planted must be noticed.
fn planted(name: &str, patch: ShaderPatch) {
    notices(&divided(&lumpy(), BODY, Quality::balanced(1.0)), name, patch);
}

fn notices(scene: &Scene, name: &str, patch: ShaderPatch) {
    twin::notices(scene, SIZE, name, patch);
}

#[test]
fn defects_of_regions_are_noticed() {
    planted("a region that is a voxel off", |t| replace(&t, "(within + 1.0)", "(within + 2.0)"));
    planted("overlaps that are counted twice", |t| replace(&t, "shown /= max(wanted, 1.0);", ""));
    planted("a background everywhere", |t| replace(&t, "max(1.0 - wanted, 0.0), is_rest);", "1.0, is_rest);"));
    planted("d₀ of the background for all", |t| replace(&t, "found.alpha, of_function.y)", "found.alpha, 1.0)"));
    planted("no tint", |t| replace(&t, "color, tint.w < 0.0)", "color, true)"));
    planted("opacities left out", |t| {
        replace(&t, "opacity_correct((abs(tint.w) - 1.0) * found", "opacity_correct(found")
    });
    planted("the first look for all", |t| replace(&t, "select(entry.x, 0u, is_rest)", "0u * entry.x"));
}

/// A body whose regions differ in color, and if so asked in opacity, alone.
pub fn tinted(nodes: &[(f64, &str, f64)], factors: [f64; 2], quality: Quality) -> Scene {
    let volume = lumpy();
    let mut scene = phantom::scene(&volume, nodes, quality);
    let pool = Arc::default();
    let one = selection(&volume.grid, &pool, |p| ball(p, DVec3::new(-4.0, 3.0, 1.0), 7.0));
    add(&mut scene, one, nodes, 1.0, Some([0.9, 0.3, 0.1]), factors[0]);
    let half = selection(&volume.grid, &pool, |p| f64::from(u8::from(p.x + 0.3 * p.z > 2.0)));
    add(&mut scene, half, nodes, 1.0, Some([0.2, 0.6, 0.9]), factors[1]);
    add(&mut scene, selection(&volume.grid, &pool, |p| 0.1 * p.y), nodes, 1.0, None, 1.0);
    scene
}

#[test]
fn tints_of_one_function_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for nodes in [BODY, VEIL, THIN] {
        for factors in [[1.0, 1.0], [0.3, 0.0]] {
            let found = compare(&mut renderer, &tinted(nodes, factors, Quality::STANDARD));
            println!("{} {factors:?}: {found:?}", nodes[0].1);
            found.unwrap();
        }
    }
    // What is hidden needs no function of its own: a background of no opacity, as the studio makes it.
    let mut scene = tinted(BODY, [1.0, 0.5], Quality::STANDARD);
    scene.objects[0].transfer_function.nodes.iter_mut().for_each(|n| n.opacity = 0.0);
    let report = renderer.render_bands(&scene, SIZE, &RenderOptions::default(), &Progress::new(), |_| Ok(())).unwrap();
    assert!(report.pipeline.ends_with("regions cuts"), "{}", report.pipeline);
    compare(&mut renderer, &scene).unwrap();
    let scene = tinted(VEIL, [0.7, 0.4], Quality::balanced(1.0));
    let planted: [(&str, ShaderPatch); 4] = [
        ("no tints", |t| replace(&t, "plain * color + dot(LUMINANCE, color) * tints.rgb", "(plain + tints.a) * color")),
        ("no opacities", |t| replace(&t, "f * (abs(look.w) - 1.0)", "f")),
        ("tints for all", |t| replace(&t, "select(weight, 0.0, look.w < 0.0)", "weight")),
        ("no overlaps", |t| replace(&t, "(plain + tints.a) / max(wanted, 1.0)", "plain + tints.a")),
    ];
    for (name, patch) in planted {
        notices(&scene, name, patch);
    }
}

/// A box of one value, of which a ball is left out: its walls have no gradient but that of the memberships.
pub fn hollow() -> Scene {
    let volume = phantom::volume([24; 3], centered([24; 3], DVec3::ONE), |_| 500.0);
    let mut scene = phantom::scene(&volume, &[(0.0, "clay", 0.9)], Quality::STANDARD);
    let pool = Arc::default();
    let bite = selection(&volume.grid, &pool, |p| ball(p, DVec3::new(4.0, 12.0, 6.0), 11.0));
    add(&mut scene, bite, SOLID, 1.0, None, 0.0);
    let core = selection(&volume.grid, &pool, |p| ball(p, DVec3::ZERO, 7.0));
    add(&mut scene, core, &[(0.0, "engraving", 0.7)], 1.0, Some([0.9, 0.3, 0.2]), 1.0);
    scene
}

#[test]
fn where_a_region_ends_in_the_midst_of_tissue_there_is_a_face() {
    let scene = hollow();
    let found = compare(&mut renderer(), &scene);
    println!("{found:?}");
    found.unwrap();
    notices(&scene, "no cut faces", |t| {
        replace(&t, "let weight = smoothstep(0.0, SHARP_END", "let weight = 0.0 * smoothstep(0.0, SHARP_END")
    });
    notices(&scene, "cut faces that face inwards", |t| replace(&t, "vec4f(-world /", "vec4f(world /"));
}

#[test]
fn a_selection_that_looks_like_its_surroundings_does_not_show() {
    let mut renderer = renderer();
    for nodes in [BODY, VEIL, THIN] {
        let plain = phantom::scene(&lumpy(), nodes, ENDLESS);
        let whole = draw(&mut renderer, &plain);
        let mut scene = plain.clone();
        let pool = Arc::default();
        let grid = lumpy().grid;
        // Fuzzy, crisp, and two that meet and overlap.
        add(&mut scene, selection(&grid, &pool, |p| ball(p, DVec3::new(-3.0, 4.0, 0.0), 8.0)), nodes, 1.0, None, 1.0);
        add(&mut scene, selection(&grid, &pool, |p| f64::from(u8::from(p.z > 0.0))), nodes, 1.0, None, 1.0);
        add(&mut scene, selection(&grid, &pool, |p| 0.4 - 0.1 * p.z), nodes, 1.0, None, 1.0);
        let found = difference(&draw(&mut renderer, &scene), &whole);
        println!("{}: {found}", nodes[0].1);
        assert!(found < 2e-5, "{}: {found}", nodes[0].1);
    }
}

/// A box of one value, 16 voxels of 1 mm, seen along y from the front.
fn homogeneous(alpha: f64) -> Scene {
    let volume = phantom::volume([16; 3], centered([16; 3], DVec3::ONE), |_| 500.0);
    let mut scene = phantom::scene(&volume, &[(0.0, "clay", alpha)], Quality::FINAL);
    scene.objects[0].transfer_function = function(&mut scene, &[(0.0, "white", alpha)], 1.0);
    scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 8.0 });
    scene
}

#[test]
fn slabs_of_two_regions_let_through_what_both_do() {
    let mut renderer = renderer();
    // The front half, in mm of its own d₀; the background behind it.
    for (front, d0, factor) in [(0.05, 1.0, 1.0), (0.2, 4.0, 1.0), (0.2, 1.0, 0.25), (0.9, 1.0, 0.0), (1.0, 1.0, 1.0)] {
        let mut scene = homogeneous(0.1);
        let grid = scene.objects[0].volume.grid;
        let half = selection(&grid, &Arc::default(), |p| f64::from(u8::from(p.y > 0.0)));
        add(&mut scene, half, &[(0.0, "white", front)], d0, None, factor);
        let picture = draw(&mut renderer, &scene);
        // Across the border, a voxel wide, the shares mix linearly: ∫ ln(1 − α(w)) dw in between.
        let per_mm = |alpha: f64| 1.0 - (1.0 - alpha).powf(1.0 / d0.min(1.0));
        let (a, b) = (1.0 - (1.0 - factor * front).powf(1.0 / d0), per_mm(0.1));
        let mixed: f64 =
            (0..10000).map(|i| (i as f64 + 0.5) / 1e4).map(|w| (1.0 - w * a - (1.0 - w) * b).ln()).sum::<f64>() / 1e4;
        let expected = 1.0 - ((1.0 - a).ln() * 7.5 + mixed + (1.0 - b).ln() * 7.5).exp();
        let found = f64::from(picture.pixels[(SIZE[0] / 2 + SIZE[0] * (SIZE[1] / 2)) as usize][3]);
        println!("{front} {d0} {factor}: {found} for {expected}");
        assert!((found - expected).abs() < 2e-4, "{front} {d0} {factor}: {found} for {expected}");
    }
}

#[test]
fn an_edit_draws_what_a_fresh_start_draws() {
    let volume = lumpy();
    let mut scene = divided(&volume, BODY, Quality::STANDARD);
    let mut kept = renderer();
    let before = draw(&mut kept, &scene);
    for step in 0..4 {
        let region = &mut scene.objects[0].regions[step % 2];
        let center = 8 + 4 * step;
        region.selection.change([[center, center + 9], [2, 30], [4, 20]], |[x, _, z], f| {
            if step % 2 == 0 { f.saturating_add((16 * (x % 8) + z) as u8) } else { f / 3 }
        });
        let fresh = draw(&mut renderer(), &scene);
        let found = draw(&mut kept, &scene);
        assert_eq!(difference(&found, &fresh), 0.0, "step {step}");
        assert!(difference(&found, &before) > 0.05, "the edit does not show");
    }
    // Regions that come and go.
    let last = scene.objects[0].regions.pop().unwrap();
    let fewer = draw(&mut kept, &scene);
    assert_eq!(difference(&fewer, &draw(&mut renderer(), &scene)), 0.0);
    scene.objects[0].regions.insert(0, last);
    assert_eq!(difference(&draw(&mut kept, &scene), &draw(&mut renderer(), &scene)), 0.0);
    scene.objects[0].regions.clear();
    let plain = phantom::scene(&volume, BODY, Quality::STANDARD);
    assert_eq!(difference(&draw(&mut kept, &scene), &draw(&mut renderer(), &plain)), 0.0);
}

#[test]
fn leaping_changes_nothing_of_regions() {
    let mut renderer = renderer();
    let volume = phantom::volume([72, 40, 40], centered([72, 40, 40], DVec3::ONE), |p| {
        phantom::bump(p, DVec3::new(-22.0, 0.0, 0.0), 9.0).max(phantom::bump(p, DVec3::new(24.0, 4.0, 3.0), 8.0))
    });
    let mut scene = phantom::scene(&volume, &[(2000.0, "bone", 0.0), (2001.0, "bone", 1.0)], Quality::STANDARD);
    let right = selection(&volume.grid, &Arc::default(), |p| f64::from(u8::from(p.x > 3.0)));
    add(&mut scene, right, BODY, 1.0, None, 1.0);
    let all = RenderOptions { skip_empty: false, ..RenderOptions::default() };
    let [leapt, walked] = [RenderOptions::default(), all]
        .map(|options| renderer.render(&scene, SIZE, &options, &Progress::new()).unwrap());
    assert_eq!(difference(&leapt, &walked), 0.0);
    let shown = leapt.pixels.iter().filter(|p| p[3] > 0.5).count();
    assert!(shown > 20, "{shown}");
}

#[test]
fn extremes_of_regions() {
    let mut renderer = renderer();
    let volume = lumpy();
    let grid = volume.grid;
    let pool: Arc<BrickPool> = Arc::default();
    let plain = draw(&mut renderer, &phantom::scene(&volume, BODY, ENDLESS));
    // Nothing selected, and everything.
    let mut scene = phantom::scene(&volume, BODY, ENDLESS);
    add(&mut scene, Selection::empty(grid, &pool), SOLID, 1.0, Some([1.0, 0.0, 0.0]), 1.0);
    let found = difference(&draw(&mut renderer, &scene), &plain);
    // Steel, which no place has, is sharper than bone: parts are looked at more often.
    assert!(found < 1e-3, "{found}");
    let mut scene = phantom::scene(&volume, SOLID, ENDLESS);
    add(&mut scene, selection(&grid, &pool, |_| 1.0), BODY, 1.0, None, 1.0);
    let found = difference(&draw(&mut renderer, &scene), &plain);
    assert!(found < 1e-3, "{found}");
    // A membership of 1/255, which must neither vanish nor count as whole.
    let mut scene = homogeneous(0.0);
    let faint = selection(&scene.objects[0].volume.grid, &pool, |_| 1.0 / 255.0);
    add(&mut scene, faint, &[(0.0, "white", 0.5)], 1.0, None, 1.0);
    let found = draw(&mut renderer, &scene).pixels[(SIZE[0] / 2 + SIZE[0] * (SIZE[1] / 2)) as usize][3];
    let expected = 1.0 - (1.0 - 0.5f32 / 255.0).powi(16);
    assert!((found - expected).abs() < 1e-4, "{found} for {expected}");
    // One voxel, at the corner of the grid, and a volume of one voxel.
    let mut scene = divided(&volume, BODY, Quality::STANDARD);
    let mut corner = Selection::empty(grid, &pool);
    corner.change([[31, 32]; 3], |_, _| 255);
    add(&mut scene, corner, &[(0.0, "steel", 1.0)], 1.0, None, 1.0);
    compare(&mut renderer, &scene).unwrap();
    let tiny = phantom::volume([1; 3], DAffine3::IDENTITY, |_| 500.0);
    let mut scene = phantom::scene(&tiny, SOLID, Quality::STANDARD);
    let alone = draw(&mut renderer, &scene);
    // The rest shows nothing, so that what is drawn is the region's.
    scene.objects[0].transfer_function.nodes.iter_mut().for_each(|n| n.opacity = 0.0);
    add(&mut scene, selection(&tiny.grid, &pool, |_| 1.0), SOLID, 1.0, None, 1.0);
    let found = difference(&draw(&mut renderer, &scene), &alone);
    assert!(found < 1e-3 && alone.pixels.iter().any(|p| p[3] > 0.5), "{found}");
    // 300 structures, some in one brick.
    let mut scene = phantom::scene(&volume, BODY, Quality::STANDARD);
    let cell = |p: DVec3| {
        let [x, y, z] = (p + 16.0).to_array().map(|x| (x / 4.6) as usize);
        x + 7 * (y + 7 * z)
    };
    for i in 0..300 {
        let one = selection(&grid, &pool, |p| f64::from(u8::from(cell(p) == i)));
        let tint = [(i % 7) as f32 / 6.0, (i % 11) as f32 / 10.0, (i % 13) as f32 / 12.0];
        add(&mut scene, one, BODY, 1.0, Some(tint), 1.0);
    }
    compare(&mut renderer, &scene).unwrap();
}

#[test]
fn regions_that_make_no_sense_are_a_sentence() {
    let volume = lumpy();
    let fault = |change: &dyn Fn(&mut Object)| {
        let mut scene = divided(&volume, BODY, Quality::STANDARD);
        change(&mut scene.objects[0]);
        scene.validate().unwrap_err().to_string()
    };
    let other = Grid::new([32; 3], centered([32; 3], DVec3::splat(2.0))).unwrap();
    let message = fault(&|o| o.regions[1].selection = Selection::empty(other, &Arc::default()));
    assert!(message.contains("region 2") && message.contains("another grid"), "{message}");
    let message = fault(&|o| o.regions[0].look.opacity = f64::NAN);
    assert!(message.contains("opacity"), "{message}");
    let message = fault(&|o| o.regions[0].look.tint = Some([0.0, 2.0, 0.0]));
    assert!(message.contains("tint"), "{message}");
    let message = fault(&|o| {
        for i in 0..32 {
            let mut region = o.regions[0].clone();
            region.look.transfer_function.nodes[0].value = f64::from(i);
            o.regions.push(region);
        }
    });
    assert!(message.contains("32 is the most"), "{message}");
}
