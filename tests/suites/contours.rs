//! Contours and illustrative transparency: the raycaster against the f64 reference, the defects that the comparison must notice, what
//! is known without a reference, and the extremes.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::scene::{Borders, Contours, Object, Projection, Quality, Scene};
use fabrica_engine::styles::StyleImage;
use fabrica_tests::phantom::{self, add, ball, centered, lumpy, selection};
use fabrica_tests::renderer;
use fabrica_tests::twin::{compare, difference, draw, notices, replace, same_in_tiles_and_everywhere};
use glam::DVec3;

const SIZE: [u32; 2] = [48, 40];

const BODY: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: &[(f64, &str, f64)] = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.2)];

/// Of the style's rim.
const RIM: Contours = Contours { width_pt: 5.0, color: None };
/// Of a color of their own.
const INK: Contours = Contours { width_pt: 4.0, color: Some([0.02, 0.01, 0.15]) };

/// The standard phantom with contours; a picture of 40 pixels is 72 points high.
fn drawn(nodes: &[(f64, &str, f64)], contours: Option<Contours>, transparency: bool, quality: Quality) -> Scene {
    let mut scene = phantom::scene(&lumpy(), nodes, quality);
    scene.objects[0].transfer_function.contours = contours;
    scene.objects[0].transfer_function.illustrative_transparency = transparency;
    scene
}

#[test]
fn contours_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for nodes in [BODY, VEIL] {
        for (contours, transparency) in
            [(Some(RIM), false), (Some(INK), false), (None, true), (Some(RIM), true), (Some(INK), true)]
        {
            for quality in [Quality::DRAFT, Quality::STANDARD, Quality::FINAL] {
                let scene = drawn(nodes, contours, transparency, quality);
                let found = compare(&mut renderer, &scene, SIZE);
                println!("{} {contours:?} {transparency} {quality:?}: {found:?}", nodes[0].1);
                found.unwrap();
            }
        }
    }
}

#[test]
fn contours_of_awkward_grids_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for (name, volume) in phantom::awkward() {
        let mut scene = phantom::scene(&volume, BODY, Quality::STANDARD);
        scene.objects[0].transfer_function.contours = Some(INK);
        scene.objects[0].transfer_function.reference_length_mm = 0.7;
        for projection in [Projection::Perspective { fov_y_deg: 50.0 }, Projection::Orthographic { height_mm: 40.0 }] {
            scene.camera = phantom::camera(&volume, DVec3::new(-0.7, 0.5, 0.4), projection);
            let found = compare(&mut renderer, &scene, SIZE);
            println!("{name} {projection:?}: {found:?}");
            found.unwrap();
        }
    }
}

/// Regions of which each is drawn in its own way, and what is left without contours.
fn divided(quality: Quality) -> Scene {
    let mut scene = drawn(BODY, None, false, quality);
    let pool = Arc::default();
    let grid = lumpy().grid;
    let round = selection(&grid, &pool, |p| ball(p, DVec3::new(-4.0, 3.0, 1.0), 7.0));
    add(&mut scene, round, BODY, 1.0, Some([0.9, 0.3, 0.2]), 1.0);
    let half = selection(&grid, &pool, |p| f64::from(u8::from(p.x + 0.3 * p.z > 2.0)));
    add(&mut scene, half, VEIL, 2.0, None, 0.7);
    let corner = selection(&grid, &pool, |p| f64::from(u8::from(p.min_element() > 1.0)));
    add(&mut scene, corner, BODY, 1.0, None, 0.0);
    let looks: Vec<_> = scene.objects[0].regions.iter_mut().map(|r| &mut r.look.transfer_function).collect();
    for (function, (contours, transparency)) in looks.into_iter().zip([(Some(INK), false), (Some(RIM), true)]) {
        function.contours = contours;
        function.illustrative_transparency = transparency;
    }
    scene
}

/// One of its regions moved, turned and stretched, with its ghost left behind.
fn moved(quality: Quality) -> Scene {
    let mut scene = divided(quality);
    phantom::take_away(&mut scene, 0, 1);
    scene
}

#[test]
fn contours_of_regions_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for quality in [Quality::DRAFT, Quality::STANDARD, Quality::FINAL] {
        let by_labels = Quality { borders: Borders::TwoLookUps, ..quality };
        for (name, scene) in [
            ("regions", divided(quality)),
            ("moved", moved(quality)),
            ("tints", tinted(quality)),
            ("regions by two look-ups", divided(by_labels)),
            ("tints by two look-ups", tinted(by_labels)),
        ] {
            let found = compare(&mut renderer, &scene, SIZE);
            println!("{name} {quality:?}: {found:?}");
            found.unwrap();
        }
    }
}

/// Regions that differ in tint alone, all with contours.
fn tinted(quality: Quality) -> Scene {
    let mut scene = drawn(BODY, Some(INK), true, quality);
    let grid = lumpy().grid;
    let round = selection(&grid, &Arc::default(), |p| ball(p, DVec3::new(-4.0, 3.0, 1.0), 7.0));
    add(&mut scene, round, BODY, 1.0, Some([0.9, 0.3, 0.2]), 0.8);
    scene.objects[0].regions[0].look.transfer_function = scene.objects[0].transfer_function.clone();
    scene
}

#[test]
fn contours_of_volumes_of_colors_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let colored = phantom::colored(|p| if p.z > 12.0 { 255 } else { 140 });
    let nodes = &[(0.01, "plaster", 0.0), (0.05, "glass", 0.6), (0.3, "porcelain", 1.0)];
    for contours in [RIM, INK] {
        let mut scene = phantom::scene(&colored, nodes, Quality::STANDARD);
        scene.objects[0].transfer_function.contours = Some(contours);
        scene.objects[0].transfer_function.illustrative_transparency = true;
        let found = compare(&mut renderer, &scene, SIZE);
        println!("{contours:?}: {found:?}");
        found.unwrap();
    }
}

/// Thin plates, whose normals turn over within a lag.
fn plates(quality: Quality) -> Scene {
    let volume = phantom::volume([32; 3], centered([32; 3], DVec3::ONE), |p| {
        500.0 + 400.0 * (2.1 * p.y + 0.7 * (0.3 * p.x).sin() + 0.02 * p.z * p.z).sin()
    });
    let mut scene = phantom::scene(&volume, VEIL, quality);
    scene.objects[0].transfer_function.contours = Some(INK);
    scene.objects[0].gradient_scale_mm = 0.3;
    scene
}

#[test]
fn defects_of_contours_are_noticed() {
    let quality = Quality::balanced(1.0);
    let rim = drawn(BODY, Some(RIM), true, quality);
    let ink = drawn(BODY, Some(INK), false, quality);
    let veil = drawn(VEIL, Some(INK), true, quality);
    let in_rim = |name, patch| notices(&rim, SIZE, name, patch);
    let in_ink = |name, patch| notices(&ink, SIZE, name, patch);
    in_ink("a lag behind in place of before", |t| replace(&t, "steps) - lag)", "steps) + lag)"));
    in_ink("a lag of half the length", |t| {
        replace(&t, "object.reference_length / march.step_mm;", "0.5 * object.reference_length / march.step_mm;")
    });
    in_ink("a width in pixels", |t| replace(&t, "function.contour_pt * frame.pixels_per_pt", "function.contour_pt"));
    in_ink("an edge that is not smoothed", |t| replace(&t, "/ pixel_mm + 0.5", "/ pixel_mm * 1e6 + 0.5"));
    in_ink("turns are not divided by the way along", |t| replace(&t, "length(cross(a, ray))", "1.0"));
    notices(&plates(quality), SIZE, "opposite normals count as turned", |t| {
        replace(&t, "min(length(a - b), length(a + b))", "length(a - b)")
    });
    in_rim("the published root falls again", |t| {
        replace(&t, "clamp(width_mm * curvature, 0.0, 1.0)", "clamp(width_mm * curvature, 0.0, 2.0)")
    });
    in_rim("pushed from |n·v| = c on by half", |t| {
        replace(&t, "facing / max(c, NO_CONTOUR)", "2.0 * facing / max(c, NO_CONTOUR)")
    });
    in_rim("transparency without its ½", |t| replace(&t, "0.5 + max(facing", "max(facing"));
    notices(&veil, SIZE, "transparency does not know contours", |t| replace(&t, "max(facing - c, 0.0)", "facing"));
    notices(&veil, SIZE, "an ink as transparent as the style", |t| {
        replace(&t, "mix(style.a, 1.0, covered)", "style.a")
    });
    notices(&divided(quality), SIZE, "one ink for all", |t| {
        replace(&t, "drawn.contour_pt = look_texel(look, 1u).w", "drawn.contour_pt = 4.0")
    });
    notices(&moved(quality), SIZE, "a lag in the index space of what rests", |t| {
        replace(&t, "before_back))", "before_front))")
    });
}

/// Balls of two sizes side by side, of a field whose normals are exact, seen in parallel.
fn two_balls() -> Scene {
    let affine = centered([96, 48, 48], DVec3::splat(0.5));
    let height = |p: DVec3, center: DVec3, radius: f64| 100.0 * (1.0 + radius - p.distance(center));
    let volume = phantom::volume([96, 48, 48], affine, |p| {
        let large = height(p, DVec3::new(-11.0, 0.0, 0.0), 10.0);
        let small = height(p, DVec3::new(12.0, 0.0, 0.0), 3.0);
        large.max(small).max(-500.0)
    });
    let mut scene = phantom::scene(&volume, &[(99.0, "bone", 0.0), (101.0, "bone", 1.0)], Quality::STANDARD);
    scene.objects[0].transfer_function.reference_length_mm = 0.5;
    scene.styles = vec![Arc::new(StyleImage::flat("white", [1.0; 4]))];
    scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 24.0 });
    scene
}

/// Widths, in mm, of the dark line along the middle row at the outer edges of both balls.
fn line_widths(renderer: &mut Renderer, scene: &Scene) -> [f64; 2] {
    // 20 pixels a millimeter; seen from the front, the right of the world is on the left.
    let size = [960, 480];
    let picture = draw(renderer, scene, size);
    let row = &picture.pixels[240 * 960..241 * 960];
    // How much of the line is in each half, one side of the ball each: half of both edges.
    let darkness = |pixels: &[[f32; 4]]| pixels.iter().map(|p| f64::from(p[3] - p[0])).sum::<f64>() / 2.0 / 20.0;
    [darkness(&row[..480]), darkness(&row[480..])]
}

#[test]
fn a_contour_is_as_wide_on_a_small_ball_as_on_a_large_one() {
    let mut renderer = renderer();
    let mut scene = two_balls();
    // 24 mm on 72 points: 3 points are a millimeter.
    for width_pt in [1.5, 3.0] {
        scene.objects[0].transfer_function.contours = Some(Contours { width_pt, color: Some([0.0; 3]) });
        let [small, large] = line_widths(&mut renderer, &scene);
        println!("{width_pt} pt: {small} and {large} mm");
        let expected = width_pt / 3.0;
        assert!((large / expected - 1.0).abs() < 0.1 && (small / expected - 1.0).abs() < 0.1, "{small} {large}");
    }
    // And half as wide on a page of twice the height.
    scene.page_height_mm *= 2.0;
    let [_, large] = line_widths(&mut renderer, &scene);
    assert!((large / 0.5 - 1.0).abs() < 0.1, "{large}");
}

#[test]
fn opaque_and_absent_things_stay_so_whatever_the_transparency() {
    let mut renderer = renderer();
    // With an opacity of 1 the style alone says how opaque it is; with 0 nothing shows: as without the modulation.
    for nodes in [&[(200.0, "bone", 0.0), (200.0, "bone", 1.0)], &[(200.0, "bone", 1.0), (200.0, "bone", 0.0)]] {
        let plain = draw(&mut renderer, &drawn(nodes, None, false, Quality::STANDARD), SIZE);
        let modulated = draw(&mut renderer, &drawn(nodes, None, true, Quality::STANDARD), SIZE);
        // Pieces across the jump are in between.
        assert!(difference(&plain, &modulated) < 0.02, "{}", difference(&plain, &modulated));
    }
}

#[test]
fn extreme_contours_draw_or_are_a_sentence() {
    let mut renderer = renderer();
    let plain = draw(&mut renderer, &drawn(BODY, None, false, Quality::STANDARD), SIZE);
    for color in [None, Some([0.0; 3])] {
        // Too narrow to be seen: as without. (The edge's smoothing draws the silhouette's own half pixel in ink.)
        let narrow = drawn(BODY, Some(Contours { width_pt: 1e-6, color: None }), false, Quality::STANDARD);
        assert!(difference(&plain, &draw(&mut renderer, &narrow, SIZE)) < 0.02);
        let wide = drawn(BODY, Some(Contours { width_pt: 72.0, color }), true, Quality::STANDARD);
        compare(&mut renderer, &wide, SIZE).unwrap();
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e6] {
            let scene = drawn(BODY, Some(Contours { width_pt: bad, color }), false, Quality::STANDARD);
            let refused = renderer.render(&scene, SIZE, &RenderOptions::default(), &Progress::new());
            assert!(refused.unwrap_err().to_string().contains("points wide"), "{bad}");
        }
    }
    let too_bright = Some(Contours { width_pt: 1.0, color: Some([2.0, 0.0, 0.0]) });
    let refused = renderer.render(
        &drawn(BODY, too_bright, false, Quality::STANDARD),
        SIZE,
        &Default::default(),
        &Progress::new(),
    );
    assert!(refused.is_err());
    // No surface anywhere, values beyond everything, lags longer than the volume.
    let flat = phantom::volume([8; 3], centered([8; 3], DVec3::ONE), |_| 500.0);
    let mut scene = phantom::scene(&flat, VEIL, Quality::STANDARD);
    for (contours, d0) in [(RIM, 1e-6), (INK, 1e6), (RIM, 1.0)] {
        let function = &mut scene.objects[0].transfer_function;
        (function.contours, function.reference_length_mm) = (Some(contours), d0);
        function.illustrative_transparency = true;
        compare(&mut renderer, &scene, SIZE).unwrap();
    }
    let mut far = drawn(BODY, Some(INK), false, Quality::STANDARD);
    far.camera.eye_mm *= 1e5;
    far.camera.projection = Projection::Perspective { fov_y_deg: 4e-4 };
    draw(&mut renderer, &far, SIZE);
    far.page_height_mm = f64::NAN;
    assert!(renderer.render(&far, SIZE, &RenderOptions::default(), &Progress::new()).is_err());
}

#[test]
fn contours_do_not_depend_on_tiles_passes_or_empty_space() {
    let mut renderer = renderer();
    for scene in [drawn(BODY, Some(INK), true, Quality::STANDARD), divided(Quality::STANDARD), moved(Quality::STANDARD)]
    {
        same_in_tiles_and_everywhere(&mut renderer, &scene, SIZE);
    }
}

#[test]
fn a_region_drawn_as_its_surroundings_is_not_seen() {
    let mut renderer = renderer();
    let plain = drawn(BODY, Some(INK), true, Quality::STANDARD);
    let mut scene = plain.clone();
    let object: &mut Object = &mut scene.objects[0];
    let round = selection(&object.volume.grid, &Arc::default(), |p| ball(p, DVec3::new(-4.0, 3.0, 1.0), 7.0));
    let function = object.transfer_function.clone();
    add(&mut scene, round, BODY, 1.0, None, 1.0);
    scene.objects[0].regions[0].look.transfer_function = function;
    let apart = difference(&draw(&mut renderer, &plain, SIZE), &draw(&mut renderer, &scene, SIZE));
    assert!(apart < 2e-5, "{apart}");
}
