//! The estimate of a setting's error against the true one, and what the choice of a setting promises.

use std::sync::Arc;

use fabrica_engine::estimate::{Estimate, for_budget, for_error, of_quality};
use fabrica_engine::measure::Converged;
use fabrica_engine::reference::Reference;
use fabrica_engine::render::{FloatImage, RenderOptions, sampled_size};
use fabrica_engine::scene::{Background, Projection, Quality, Scene};
use fabrica_engine::{Error, Progress, specimen};
use fabrica_tests::phantom::{self, lumpy};
use fabrica_tests::renderer;

const OPAQUE: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const HATCHED: &[(f64, &str, f64)] = &[(150.0, "engraving", 0.0), (700.0, "engraving", 0.2)];
const SIZE: [u32; 2] = [64, 48];

fn scene(nodes: &[(f64, &'static str, f64)], background: Background) -> Scene {
    Scene { background, ..phantom::scene(&lumpy(), nodes, Quality::FINAL) }
}

#[test]
fn an_error_bound_is_met_and_not_by_far() {
    let mut renderer = renderer();
    let progress = Progress::new();
    for (nodes, background) in [(OPAQUE, Background::Color([1.0; 3])), (HATCHED, Background::Transparent)] {
        let mut scene = scene(nodes, background);
        let converged = Converged::of(&scene, SIZE, &progress).unwrap();
        let mut steps = Vec::new();
        for bound in [0.8, 1.5, 3.0] {
            let estimate = for_error(&mut renderer, &scene, SIZE, bound, &progress).unwrap();
            scene.quality = estimate.quality;
            let picture = renderer.render(&scene, SIZE, &RenderOptions::default(), &progress).unwrap();
            let truth = converged.difference(&picture, background).unwrap().codes.p999;
            println!("bound {bound}: {estimate:?}, true {truth}");
            assert!(truth <= bound, "the bound of {bound} codes is not kept: {truth}");
            // What the floor holds against the adapter counts where the error is as small as it is.
            assert!(truth.max(0.3) > bound / 4.0, "{truth} is timid for a bound of {bound}");
            assert!((0.5..2.0).contains(&(estimate.codes / truth.max(0.3))), "{estimate:?} is not {truth}");
            steps.push(estimate.quality.step_voxels);
        }
        assert!(steps.is_sorted(), "a looser bound has a longer step: {steps:?}");
    }
}

#[test]
fn a_quality_has_the_error_that_a_bound_finds_for_it() {
    let mut renderer = renderer();
    let progress = Progress::new();
    for (nodes, background) in [(OPAQUE, Background::Color([1.0; 3])), (HATCHED, Background::Transparent)] {
        let scene = scene(nodes, background);
        let mut of = |quality| of_quality(&mut renderer, &Scene { quality, ..scene.clone() }, SIZE, &progress).unwrap();
        let [draft, standard, last] = [Quality::DRAFT, Quality::STANDARD, Quality::FINAL].map(&mut of);
        println!("draft {draft:?}\nstandard {standard:?}\nfinal {last:?}");
        assert!(draft.codes > 2.0 * standard.codes && standard.codes > last.codes && last.codes >= 0.3);
        for ours in [draft, last] {
            // A bound that this setting just keeps, and no coarser one.
            let bound = ours.codes / 0.75 * (1.0 + 1e-9);
            let theirs = for_error(&mut renderer, &scene, SIZE, bound, &progress).unwrap();
            assert!((ours.codes - theirs.codes).abs() < 1e-6, "{ours:?} is not {theirs:?}");
            let steps = |e: &Estimate| (e.quality.step_voxels, e.against_step, e.num_pixels);
            assert_eq!(steps(&ours), steps(&theirs));
        }
    }
    // Hatching that is hardly ever looked at is no better for a short step.
    let [seen, blind] = [0.25, 100.0].map(|style_change| {
        let quality = Quality { style_change, ..Quality::FINAL };
        let hatched = Scene { quality, ..scene(HATCHED, Background::Transparent) };
        of_quality(&mut renderer, &hatched, SIZE, &progress).unwrap()
    });
    assert!(blind.against_step == seen.against_step && blind.codes > seen.codes, "{blind:?} {seen:?}");
    let at = |quality| Scene { quality, ..scene(OPAQUE, Background::Transparent) };
    let finest = at(Quality::balanced(1.0 / 1024.0));
    let said = of_quality(&mut renderer, &finest, SIZE, &progress).unwrap_err().to_string();
    assert!(said.contains("no finer one to be compared with"), "{said}");
    progress.cancel();
    let cancelled = of_quality(&mut renderer, &at(Quality::DRAFT), SIZE, &progress);
    assert!(matches!(cancelled, Err(Error::Cancelled)));
}

#[test]
fn what_cannot_be_had_is_refused_with_what_can() {
    let mut renderer = renderer();
    let progress = Progress::new();
    let scene = scene(OPAQUE, Background::Transparent);
    let said = for_error(&mut renderer, &scene, SIZE, 1e-3, &progress).unwrap_err().to_string();
    let best: f64 = said.split("the best is ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((0.3..1.0).contains(&best) && said.ends_with("ask for that or more"), "{said}");
    assert!(for_error(&mut renderer, &scene, SIZE, best, &progress).is_ok(), "the best that was offered is refused");
    let said = for_budget(&mut renderer, &scene, SIZE, 1e-3, &progress).unwrap_err().to_string();
    assert!(said.contains("cannot be drawn in 0.001 ms; the fastest that can be had takes "), "{said}");
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(for_error(&mut renderer, &scene, SIZE, bad, &progress), Err(Error::Scene { .. })), "{bad}");
        assert!(matches!(for_budget(&mut renderer, &scene, SIZE, bad, &progress), Err(Error::Scene { .. })), "{bad}");
    }
    progress.cancel();
    assert!(matches!(for_error(&mut renderer, &scene, SIZE, 1.0, &progress), Err(Error::Cancelled)));
}

#[test]
fn a_budget_buys_accuracy() {
    let mut renderer = renderer();
    let progress = Progress::new();
    let scene = scene(HATCHED, Background::Transparent);
    // An hour is enough for the finest; how much less is enough is for the machine to say, and no test.
    let most = for_budget(&mut renderer, &scene, SIZE, 3.6e6, &progress).unwrap();
    assert!(most.quality == Quality::balanced(1.0 / 16.0) && most.ms.is_some() && most.codes < 1.0, "{most:?}");
}

#[test]
fn a_sample_is_the_pictures_own_pixels() {
    let mut renderer = renderer();
    let scene = scene(OPAQUE, Background::Color([0.2, 0.3, 0.4]));
    for size in [[61, 47], [3, 2], [1, 1]] {
        let whole = renderer.render(&scene, size, &RenderOptions::default(), &Progress::new()).unwrap();
        for stride in [1, 2, 5] {
            let options = RenderOptions { stride, tile: 7, ..RenderOptions::default() };
            let sample = renderer.render(&scene, size, &options, &Progress::new()).unwrap();
            let [width, height] = sampled_size(size, stride);
            assert_eq!(
                ([sample.width, sample.height], sample.pixels.len()),
                ([width, height], (width * height) as usize)
            );
            let first = size.map(|n| (stride / 2).min(n - 1));
            for (i, pixel) in (0..width * height).zip(&sample.pixels) {
                let [x, y] = [first[0] + i % width * stride, first[1] + i / width * stride];
                assert_eq!(whole.pixels[(y * size[0] + x) as usize], *pixel, "{size:?} {stride} {x} {y}");
            }
        }
    }
}

#[test]
fn a_step_of_one_voxel_is_five_times_as_exact_as_plain_sampling() {
    let head = Arc::new(specimen::generate("head", 128, &Progress::new()).unwrap().volume);
    let sharp = [
        (-300.0, "unshaded_ochre", 0.0),
        (-250.0, "unshaded_ochre", 0.9),
        (300.0, "unshaded", 0.9),
        (400.0, "unshaded", 1.0),
    ];
    let translucent = [
        (-900.0, "unshaded_blue", 0.0),
        (-400.0, "unshaded_blue", 0.1),
        (0.0, "unshaded_red", 0.02),
        (1600.0, "unshaded", 0.2),
    ];
    let (mut renderer, progress) = (renderer(), Progress::new());
    for nodes in [sharp, translucent] {
        let mut scene = phantom::scene(&head, &nodes, Quality { termination: 1e-6, ..Quality::balanced(1.0) });
        scene.camera.projection = Projection::Perspective { fov_y_deg: 14.0 };
        let converged = Converged::of(&scene, SIZE, &progress).unwrap();
        let picture = renderer.render(&scene, SIZE, &RenderOptions::default(), &progress).unwrap();
        let ours = converged.difference(&picture, scene.background).unwrap().codes.rmse;
        let plain = Reference::new(&scene).unwrap().image_with(SIZE, 1.0, 0.0, &progress).unwrap();
        let plain =
            FloatImage { width: SIZE[0], height: SIZE[1], pixels: plain.iter().map(|p| p.map(|c| c as f32)).collect() };
        let plain = converged.difference(&plain, scene.background).unwrap().codes.rmse;
        println!("step 1, unshaded: {plain:.3} codes by the middles of the pieces, {ours:.3} as it is drawn");
        assert!(plain > 1.0 && ours < plain / 5.0, "{ours} is not a fifth of {plain}");
    }
}
