//! Patterns of styles: the raycaster against the f64 reference, the defects that the comparison must notice, what is known without a
//! reference (patterns stay on what they are drawn on, and are as dark as the tone that they stand for), and the extremes.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::reference::pattern::lines;
use fabrica_engine::render::{FloatImage, RenderOptions};
use fabrica_engine::scene::{Contours, Light, LightFrame, Lighting, LightingMap, Projection, Quality, Scene};
use fabrica_engine::styles::StyleImage;
use fabrica_engine::styles::pattern::{Direction, Pattern, Strokes};
use fabrica_engine::volume::Volume;
use fabrica_tests::phantom::{self, add, ball, centered, lumpy, selection};
use fabrica_tests::renderer;
use fabrica_tests::twin::{compare, difference, draw, notices, replace, same_in_tiles_and_everywhere};
use glam::{DQuat, DVec3};

const SIZE: [u32; 2] = [48, 40];

const BODY: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: &[(f64, &str, f64)] = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.2)];

const SECTIONS: Strokes = Strokes::Hatching { direction: Direction::Axis(DVec3::new(0.2, -0.3, 1.0)), layers: 3 };
const LIGHT: Strokes = Strokes::Hatching { direction: Direction::Light, layers: 2 };
const AROUND: Strokes = Strokes::Hatching { direction: Direction::Around, layers: 3 };
const ALONG: Strokes = Strokes::Hatching { direction: Direction::Along, layers: 1 };

/// Gives all styles of a scene the same pattern. A picture of 40 pixels is 72 points high.
fn with(mut scene: Scene, pattern: &Pattern) -> Scene {
    for style in &mut scene.styles {
        Arc::make_mut(style).pattern = Some(pattern.clone());
    }
    scene
}

/// Brown on buff, of which half is seen through.
fn of(strokes: Strokes) -> Pattern {
    let pattern = Pattern::new(strokes, 9.0);
    Pattern { ink: [0.1, 0.05, 0.02], paper: [0.9, 0.8, 0.7], paper_opacity: 0.5, ..pattern }
}

fn drawn(nodes: &[(f64, &str, f64)], strokes: Strokes, quality: Quality) -> Scene {
    with(phantom::scene(&lumpy(), nodes, quality), &of(strokes))
}

#[test]
fn patterns_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for strokes in [SECTIONS, LIGHT, AROUND, ALONG, Strokes::Stipple] {
        for (nodes, quality) in
            [(BODY, Quality::DRAFT), (BODY, Quality::STANDARD), (BODY, Quality::FINAL), (VEIL, Quality::STANDARD)]
        {
            let found = compare(&mut renderer, &drawn(nodes, strokes, quality), SIZE);
            println!("{} {strokes:?} {quality:?}: {found:?}", nodes[0].1);
            found.unwrap();
        }
    }
}

#[test]
fn patterns_of_awkward_grids_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for (name, volume) in phantom::awkward() {
        for (strokes, projection) in [
            (SECTIONS, Projection::Perspective { fov_y_deg: 50.0 }),
            (AROUND, Projection::Orthographic { height_mm: 40.0 }),
            (Strokes::Stipple, Projection::Perspective { fov_y_deg: 50.0 }),
        ] {
            let mut scene = with(phantom::scene(&volume, BODY, Quality::STANDARD), &of(strokes));
            scene.camera = phantom::camera(&volume, DVec3::new(-0.7, 0.5, 0.4), projection);
            let found = compare(&mut renderer, &scene, SIZE);
            println!("{name} {strokes:?}: {found:?}");
            found.unwrap();
        }
    }
}

/// Regions, each with a pattern of its own or none, one of them moved, turned and stretched, with its ghost left behind.
fn divided(strokes: [Strokes; 2], is_moved: bool) -> Scene {
    let mut scene = phantom::scene(&lumpy(), BODY, Quality::STANDARD);
    scene.styles.iter_mut().for_each(|style| Arc::make_mut(style).pattern = Some(of(strokes[0])));
    let pool = Arc::default();
    let grid = lumpy().grid;
    let round = selection(&grid, &pool, |p| ball(p, DVec3::new(-4.0, 3.0, 1.0), 7.0));
    add(&mut scene, round, &[(150.0, "clay", 0.0), (300.0, "clay", 1.0)], 1.0, Some([0.9, 0.3, 0.2]), 1.0);
    let half = selection(&grid, &pool, |p| f64::from(u8::from(p.x + 0.3 * p.z > 2.0)));
    add(&mut scene, half, &[(150.0, "plaster", 0.0), (350.0, "fat", 0.8)], 2.0, None, 0.7);
    for style in &mut scene.styles {
        if style.name == "clay" || style.name == "fat" {
            Arc::make_mut(style).pattern = Some(Pattern { spacing_pt: 14.0, ..Pattern::new(strokes[1], 1.0) });
        }
    }
    if is_moved {
        phantom::take_away(&mut scene, 0, 1);
    }
    scene
}

#[test]
fn patterns_of_regions_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for (strokes, is_moved) in [
        ([SECTIONS, LIGHT], false),
        ([AROUND, Strokes::Stipple], false),
        ([SECTIONS, AROUND], true),
        ([Strokes::Stipple, LIGHT], true),
    ] {
        let found = compare(&mut renderer, &divided(strokes, is_moved), SIZE);
        println!("{strokes:?} {is_moved}: {found:?}");
        found.unwrap();
    }
}

/// Lights, contours, transparency and a volume of colors, all with patterns.
fn everything(strokes: Strokes) -> Scene {
    let colored = phantom::colored(|p| if p.z > 12.0 { 255 } else { 140 });
    let nodes = &[(0.01, "plaster", 0.0), (0.05, "glass", 0.6), (0.3, "porcelain", 1.0)];
    let mut scene = with(phantom::scene(&colored, nodes, Quality::STANDARD), &of(strokes));
    let object = &mut scene.objects[0];
    object.transfer_function.contours = Some(Contours { width_pt: 4.0, color: Some([0.02, 0.01, 0.15]) });
    object.transfer_function.illustrative_transparency = true;
    let direction = DVec3::new(-0.6, 0.7, 0.8).normalize();
    object.lighting = Some(Lighting {
        map: LightingMap::BlinnPhong { ambient: 0.1, diffuse: 0.7, specular: 0.5, shininess: 20.0 },
        lights: vec![Light { direction, frame: LightFrame::World, color: [1.0, 0.9, 0.8] }],
    });
    scene
}

#[test]
fn patterns_draw_what_the_equations_say_with_all_else() {
    let mut renderer = renderer();
    for strokes in [LIGHT, AROUND, Strokes::Stipple] {
        let scene = everything(strokes);
        let found = compare(&mut renderer, &scene, SIZE);
        println!("{strokes:?}: {found:?}");
        found.unwrap();
        let mut lit = drawn(BODY, strokes, Quality::STANDARD);
        lit.objects[0].lighting = scene.objects[0].lighting.clone();
        compare(&mut renderer, &lit, SIZE).unwrap();
    }
}

#[test]
fn defects_of_patterns_are_noticed() {
    let balanced = Quality::balanced(1.0);
    let sections = drawn(BODY, SECTIONS, balanced);
    let in_sections = |name, patch| notices(&sections, SIZE, name, patch);
    in_sections("patterns from a corner of the volume", |t| {
        replace(&t, "to_rest * (p - patterns.middle)", "to_rest * (p - 2.0 * patterns.middle)")
    });
    in_sections("a spacing in pixels", |t| replace(&t, "what.z * frame.pixels_per_pt", "what.z"));
    in_sections("lines that are not smoothed", |t| {
        replace(&t, "max(0.5 * change / period, vec4f(1e-4))", "vec4f(1e-4)")
    });
    in_sections("smoothed without foreshortening", |t| replace(&t, "pixel_mm / foreshortened)", "pixel_mm)"));
    in_sections("lines that do not give way", |t| replace(&t, "0.25 * tone * (1.0 - leaves)", "0.25 * tone"));
    in_sections("one layer only", |t| replace(&t, "select(1e9, LAYER, what.y > 1.0)", "1e9"));
    in_sections("paper as opaque as ink", |t| replace(&t, "mix(1.0, what.w, free)", "1.0"));
    let light = drawn(BODY, LIGHT, balanced);
    notices(&light, SIZE, "light from the eye", |t| replace(&t, "axes.up * light.y", "axes.right * light.y"));
    notices(&light, SIZE, "families without margin", |t| replace(&t, "MARGIN: f32 = 0.12", "MARGIN: f32 = 0.02"));
    let around = drawn(BODY, AROUND, balanced);
    notices(&around, SIZE, "lines along in place of around", |t| {
        replace(&t, "select(wanted, -wanted", "select(wanted, wanted")
    });
    notices(&around, SIZE, "normals compared to one side", |t| replace(&t, "select(1.0, -1.0, (i & 1u) == 1u)", "1.0"));
    let stipple = drawn(BODY, Strokes::Stipple, balanced);
    notices(&stipple, SIZE, "dots that are not strewn", |t| replace(&t, "STREWN: f32 = 0.35", "STREWN: f32 = 0.0"));
    notices(&stipple, SIZE, "one octave of dots", |t| replace(&t, "select(0u, 2u, is_stipple)", "0u"));
    notices(&stipple, SIZE, "small dots as dark as large ones", |t| replace(&t, "1.0 - faint * clamp", "1.0 - clamp"));
    notices(&divided([SECTIONS, LIGHT], false), SIZE, "one pattern for both ends of nodes", |t| {
        replace(&t, "drawn_with(select(first, second, i == 1u)", "drawn_with(select(first, first, i == 1u)")
    });
    notices(&divided([SECTIONS, AROUND], true), SIZE, "patterns that a moved part leaves behind", |t| {
        replace(
            &t,
            "let index = pose.to_index * direction;",
            "let index = mat3x3f(object.index_from_world_x,
            object.index_from_world_y, object.index_from_world_z) * direction;",
        )
    });
    let mut lit = drawn(BODY, LIGHT, balanced);
    lit.objects[0].lighting = everything(LIGHT).objects[0].lighting.clone();
    notices(&lit, SIZE, "the light of the sphere for a lit object", |t| replace(&t, "light.w > 0.5", "light.w > 2.0"));
}

/// A ball of 12 mm radius, of one tone whatever its normal, seen in parallel: 20 mm on `height` pixels, 72 points.
fn toned(pattern: &Pattern, tone: f32, from: DVec3) -> (Arc<Volume>, Scene) {
    let dims = [64; 3];
    let volume =
        phantom::volume(dims, centered(dims, DVec3::splat(0.5)), |p| 500.0 + 100.0 * (12.0 - p.length()).max(-4.0));
    let mut scene = phantom::scene(&volume, &[(450.0, "bone", 0.0), (450.0, "bone", 1.0)], Quality::STANDARD);
    scene.objects[0].transfer_function.reference_length_mm = 0.01;
    let mut style = StyleImage::flat("bone", [tone, tone, tone, 1.0]);
    style.pattern = Some(pattern.clone());
    scene.styles = vec![Arc::new(style)];
    scene.camera = phantom::camera(&volume, from, Projection::Orthographic { height_mm: 20.0 });
    (volume, scene)
}

/// Mean of the pixels within 7 mm of the middle of a picture 20 mm high.
fn mean(picture: &FloatImage, size: u32) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (i, pixel) in picture.pixels.iter().enumerate() {
        let at = [i as u32 % size, i as u32 / size].map(|n| (f64::from(n) + 0.5) / f64::from(size) * 20.0 - 10.0);
        if at[0].hypot(at[1]) < 7.0 {
            sum += f64::from(pixel[0]);
            count += 1.0;
        }
    }
    sum / count
}

#[test]
fn a_pattern_is_as_dark_as_the_tone_it_stands_for() {
    let mut renderer = renderer();
    let size = 200;
    for strokes in [SECTIONS, LIGHT, AROUND, ALONG, Strokes::Stipple] {
        for tone in [0.85, 0.5, 0.2] {
            let (_, scene) = toned(&Pattern::new(strokes, 2.0), tone, DVec3::new(0.3, 1.0, 0.2));
            let found = mean(&draw(&mut renderer, &scene, [size; 2]), size);
            println!("{strokes:?}: {tone} is drawn as {found:.4}");
            assert!((found - f64::from(tone)).abs() < 0.03, "{strokes:?} {tone} {found}");
        }
    }
}

#[test]
fn lines_are_exactly_as_dark_and_change_octave_without_a_jump() {
    for tone in [0.0, 0.1, 0.5, 0.9, 1.0] {
        for distance in [0.3, 1.0, 1.4, 1.999, 7.0] {
            // Over whole periods; with pixels finer than lines and coarser.
            for change in [0.01, 0.4, 30.0] {
                let n = 1600;
                let sum: f64 = (0..n).map(|i| lines(f64::from(i) * 8.0 / f64::from(n), change, distance, tone)).sum();
                assert!((sum / f64::from(n) - tone).abs() < 3e-3, "{tone} {distance} {change}: {}", sum / f64::from(n));
            }
        }
        for octave in [0.25, 1.0, 2.0] {
            for i in 0..100 {
                let at = |distance: f64| lines(0.043 * f64::from(i), 0.05, distance, tone);
                assert!((at(octave * (1.0 - 1e-9)) - at(octave)).abs() < 1e-6);
            }
        }
        // Finer than a pixel tells apart: the tone itself, without a trace of lines.
        for i in 0..50 {
            assert!((lines(0.173 * f64::from(i), 64.0, 1.0, tone) - tone).abs() < 2e-2);
        }
    }
}

#[test]
fn a_pattern_stays_on_what_it_is_drawn_on() {
    let mut renderer = renderer();
    let size = 240u32;
    for strokes in [SECTIONS, AROUND, Strokes::Stipple] {
        let pattern = Pattern::new(strokes, 4.0);
        let from = DVec3::new(0.3, 1.0, 0.2);
        let turned = DQuat::from_rotation_z(0.06) * from;
        let (_, before) = toned(&pattern, 0.5, from);
        let (_, after) = toned(&pattern, 0.5, turned);
        let [a, b] = [&before, &after].map(|scene| draw(&mut renderer, scene, [size; 2]));
        let mm = 20.0 / f64::from(size);
        let (mut stayed, mut swum, mut count) = (0.0, 0.0, 0.0);
        for y in 0..size {
            for x in 0..size {
                let [u, v] = [x, y].map(|n| (f64::from(n) + 0.5) * mm - 10.0);
                // The ball ends 12.5 mm from its center.
                let depth = 12.5f64.powi(2) - u * u - v * v;
                if u.hypot(v) > 6.0 {
                    continue;
                }
                let point = u * before.camera.right - v * before.camera.up - depth.sqrt() * before.camera.forward;
                let [p, q] =
                    [point.dot(after.camera.right), -point.dot(after.camera.up)].map(|n| (n + 10.0) / mm - 0.5);
                let pixel = |x: f64, y: f64| f64::from(b.pixels[y as usize * size as usize + x as usize][0]);
                let (i, j) = (p.floor(), q.floor());
                let row = |j: f64| pixel(i, j) + (p - i) * (pixel(i + 1.0, j) - pixel(i, j));
                let there = row(j) + (q - j) * (row(j + 1.0) - row(j));
                let here = f64::from(a.pixels[(y * size + x) as usize][0]);
                stayed += (here - there).abs();
                swum += (here - pixel(f64::from(x), f64::from(y))).abs();
                count += 1.0;
            }
        }
        let [stayed, swum] = [stayed, swum].map(|sum| sum / count);
        println!("{strokes:?}: {stayed} on the surface, {swum} on the page");
        // Sections across the axis that the camera turns about hardly move on the page.
        assert!(stayed < 0.06 && stayed < 0.5 * swum, "{strokes:?} {stayed} {swum}");
    }
}

#[test]
fn extreme_patterns_draw_or_are_a_sentence() {
    let mut renderer = renderer();
    for strokes in [SECTIONS, LIGHT, AROUND, Strokes::Stipple] {
        for spacing in [1e-6, 0.02, 144.0] {
            let pattern = Pattern { spacing_pt: spacing, ..of(strokes) };
            let scene = with(phantom::scene(&lumpy(), BODY, Quality::STANDARD), &pattern);
            let found = compare(&mut renderer, &scene, SIZE);
            println!("{strokes:?} {spacing}: {found:?}");
            found.unwrap();
        }
        // No surface anywhere.
        let flat = phantom::volume([8; 3], centered([8; 3], DVec3::ONE), |_| 500.0);
        compare(&mut renderer, &with(phantom::scene(&flat, VEIL, Quality::STANDARD), &of(strokes)), SIZE).unwrap();
        // From very far and very near.
        let mut far = drawn(BODY, strokes, Quality::STANDARD);
        far.camera.eye_mm *= 1e5;
        far.camera.projection = Projection::Perspective { fov_y_deg: 4e-4 };
        draw(&mut renderer, &far, SIZE);
        for height_mm in [1e-3, 1e5] {
            let mut scene = drawn(BODY, strokes, Quality::STANDARD);
            scene.camera.projection = Projection::Orthographic { height_mm };
            draw(&mut renderer, &scene, [8, 8]);
        }
    }
    let refused = |change: &dyn Fn(&mut Pattern)| {
        let mut pattern = of(SECTIONS);
        change(&mut pattern);
        let scene = with(phantom::scene(&lumpy(), BODY, Quality::STANDARD), &pattern);
        renderer.render(&scene, SIZE, &RenderOptions::default(), &Progress::new()).unwrap_err().to_string()
    };
    let mut refused = refused;
    for spacing in [0.0, -1.0, f64::NAN, 1e6] {
        let sentence = refused(&|p| p.spacing_pt = spacing);
        assert!(sentence.contains("the style \"bone\" has a spacing"), "{sentence}");
    }
    assert!(refused(&|p| p.paper = p.ink).contains("not brighter than its ink"));
    assert!(refused(&|p| p.ink[0] = f32::NAN).contains("color"));
    assert!(refused(&|p| p.paper_opacity = 1.5).contains("opacity 1.5"));
    assert!(refused(&|p| p.strokes = Strokes::Hatching { direction: Direction::Light, layers: 4 }).contains("4 ways"));
    let nowhere = Strokes::Hatching { direction: Direction::Axis(DVec3::ZERO), layers: 1 };
    assert!(refused(&|p| p.strokes = nowhere).contains("no axis"));
}

#[test]
fn patterns_do_not_depend_on_tiles_or_empty_space() {
    let mut renderer = renderer();
    for scene in [drawn(VEIL, AROUND, Quality::STANDARD), divided([SECTIONS, Strokes::Stipple], true)] {
        same_in_tiles_and_everywhere(&mut renderer, &scene, SIZE);
    }
}

#[test]
fn a_pattern_that_nothing_is_drawn_with_changes_nothing() {
    let mut renderer = renderer();
    let plain = phantom::scene(&lumpy(), BODY, Quality::STANDARD);
    let mut scene = plain.clone();
    let mut unused = StyleImage::flat("unused", [0.5, 0.5, 0.5, 1.0]);
    unused.pattern = Some(of(SECTIONS));
    scene.styles.push(Arc::new(unused));
    assert_eq!(draw(&mut renderer, &plain, SIZE).pixels, draw(&mut renderer, &scene, SIZE).pixels);
    // But one that is used does.
    let drawn = drawn(BODY, SECTIONS, Quality::STANDARD);
    assert!(difference(&draw(&mut renderer, &plain, SIZE), &draw(&mut renderer, &drawn, SIZE)) > 0.1);
}
