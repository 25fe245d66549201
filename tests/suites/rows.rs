//! 2-D style transfer functions: the raycaster against the f64 reference, the defects that the comparison must notice, what is known
//! without a reference, and the extremes.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::render::RenderOptions;
use fabrica_engine::scene::across::MAX_ROWS;
use fabrica_engine::scene::{
    Across, Axis, Borders, Contours, Light, LightFrame, Lighting, LightingMap, Projection, Quality, Row, Scene,
    StyleTransferFunction,
};
use fabrica_engine::selection::DistanceField;
use fabrica_engine::volume::Volume;
use fabrica_tests::phantom::{self, add, ball, centered, function, lumpy, selection};
use fabrica_tests::renderer;
use fabrica_tests::twin::{compare, difference, draw, notices, replace, same_in_tiles_and_everywhere};
use glam::DVec3;

const SIZE: [u32; 2] = [48, 40];

/// No draft: at steps of two voxels a pixel on a silhouette may be on different sides of a row's threshold in the two.
fn qualities() -> [Quality; 3] {
    [Quality::balanced(1.0), Quality::STANDARD, Quality::FINAL]
}

type Nodes<'a> = &'a [(f64, &'a str, f64)];

const BODY: Nodes<'_> = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: Nodes<'_> = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.2)];
const STEP: Nodes<'_> = &[(200.0, "muscle", 0.0), (200.0, "muscle", 0.6)];
const NOTHING: Nodes<'_> = &[(0.0, "bone", 0.0)];

/// A function of rows, from the first one on.
fn across(scene: &mut Scene, axis: Axis, rows: &[(f64, Nodes<'_>)], d0: f64) -> StyleTransferFunction {
    let (at, nodes) = rows[0];
    let further =
        rows[1..].iter().map(|(at, nodes)| Row { at: *at, nodes: function(scene, nodes, d0).nodes }).collect();
    let own = function(scene, nodes, d0);
    StyleTransferFunction { across: Some(Across { axis, at, rows: further }), ..own }
}

/// Distances to a ball in the phantom.
fn distances(volume: &Volume, center: DVec3) -> Arc<DistanceField> {
    let round = selection(&volume.grid, &Arc::default(), |p| ball(p, center, 4.0));
    DistanceField::of(&[round], &volume.grid, &Progress::new()).unwrap()
}

fn of_rows(volume: &Arc<Volume>, axis: Axis, rows: &[(f64, Nodes<'_>)], quality: Quality) -> Scene {
    let mut scene = phantom::scene(volume, BODY, quality);
    scene.objects[0].transfer_function = across(&mut scene, axis, rows, 1.0);
    scene.objects[0].distances =
        vec![distances(volume, DVec3::new(-2.0, -3.0, 1.0)), distances(volume, DVec3::new(3.0, 1.0, -2.0))];
    scene
}

fn by_edge(quality: Quality) -> Scene {
    of_rows(&lumpy(), Axis::Edge, &[(0.05, NOTHING), (0.3, VEIL), (0.8, BODY)], quality)
}

fn by_distance(quality: Quality) -> Scene {
    of_rows(&lumpy(), Axis::Distance(0), &[(-2.0, STEP), (3.0, BODY), (9.0, VEIL)], quality)
}

/// Regions with rows and without, overlapping, one of them cut out.
fn divided(quality: Quality) -> Scene {
    let mut scene = by_edge(quality);
    let (pool, grid) = (Arc::default(), lumpy().grid);
    let round = selection(&grid, &pool, |p| ball(p, DVec3::new(-4.0, 3.0, 1.0), 7.0));
    add(&mut scene, round, BODY, 1.0, Some([0.9, 0.3, 0.2]), 1.0);
    let half = selection(&grid, &pool, |p| f64::from(u8::from(p.x + 0.3 * p.z > 2.0)));
    add(&mut scene, half, VEIL, 2.0, None, 0.7);
    let corner = selection(&grid, &pool, |p| f64::from(u8::from(p.min_element() > 1.0)));
    add(&mut scene, corner, BODY, 1.0, None, 0.0);
    let rows = across(&mut scene, Axis::Distance(1), &[(1.0, BODY), (6.0, STEP)], 2.0);
    scene.objects[0].regions[1].look.transfer_function = rows;
    let even = across(&mut scene, Axis::Even(1.25), &[(0.0, NOTHING), (1.0, VEIL), (2.0, BODY)], 1.0);
    scene.objects[0].regions[0].look.transfer_function = even;
    scene
}

fn moved(quality: Quality) -> Scene {
    let mut scene = divided(quality);
    phantom::take_away(&mut scene, 1, 0);
    scene
}

fn found(name: &str, scene: &Scene) {
    let found = compare(&mut renderer(), scene, SIZE);
    println!("{name}: {found:?}");
    found.unwrap();
}

#[test]
fn rows_draw_what_the_equations_say() {
    for quality in qualities() {
        found(&format!("edge {quality:?}"), &by_edge(quality));
        found(&format!("distance {quality:?}"), &by_distance(quality));
        let even = of_rows(&lumpy(), Axis::Even(0.4), &[(0.0, VEIL), (1.0, BODY)], quality);
        found(&format!("even {quality:?}"), &even);
        for projection in [Projection::Perspective { fov_y_deg: 60.0 }, Projection::Orthographic { height_mm: 40.0 }] {
            let mut scene = by_edge(quality);
            scene.camera = phantom::camera(&lumpy(), DVec3::new(-0.7, 0.5, 0.4), projection);
            found(&format!("edge {quality:?} {projection:?}"), &scene);
        }
    }
}

#[test]
fn rows_of_regions_draw_what_the_equations_say() {
    for quality in qualities() {
        found(&format!("regions {quality:?}"), &divided(quality));
        found(&format!("moved {quality:?}"), &moved(quality));
        let labels = Quality { borders: Borders::TwoLookUps, ..quality };
        found(&format!("regions by two look-ups {quality:?}"), &divided(labels));
    }
}

#[test]
fn rows_of_awkward_grids_and_of_colors_draw_what_the_equations_say() {
    for (name, volume) in phantom::awkward() {
        found(name, &of_rows(&volume, Axis::Distance(1), &[(-1.0, STEP), (3.0, BODY), (9.0, VEIL)], Quality::STANDARD));
        found(name, &of_rows(&volume, Axis::Edge, &[(0.0, VEIL), (0.5, BODY)], Quality::STANDARD));
    }
    let colored = phantom::colored(|p| if p.z > 12.0 { 255 } else { 140 });
    let (thin, dense): (Nodes<'_>, Nodes<'_>) =
        (&[(0.01, "plaster", 0.0), (0.05, "glass", 0.2)], &[(0.05, "plaster", 0.0), (0.3, "porcelain", 1.0)]);
    found("colors", &of_rows(&colored, Axis::Edge, &[(0.0, thin), (0.6, dense)], Quality::STANDARD));
    found("colors by distance", &of_rows(&colored, Axis::Distance(0), &[(0.0, dense), (8.0, thin)], Quality::STANDARD));
}

#[test]
fn rows_are_drawn_with_contours_transparency_and_lights() {
    for scene in [by_edge(Quality::STANDARD), divided(Quality::STANDARD), moved(Quality::STANDARD)] {
        let mut inked = scene.clone();
        let function = &mut inked.objects[0].transfer_function;
        function.contours = Some(Contours { width_pt: 4.0, color: Some([0.02, 0.01, 0.15]) });
        function.illustrative_transparency = true;
        found("contours", &inked);
        let mut lit = scene;
        let light = Light {
            direction: DVec3::new(-0.5, 0.6, 0.4).normalize(),
            frame: LightFrame::Camera,
            color: [1.0, 0.9, 0.8],
        };
        let map = LightingMap::BlinnPhong { ambient: 0.1, diffuse: 0.7, specular: 0.5, shininess: 20.0 };
        lit.objects[0].lighting = Some(Lighting { map, lights: vec![light] });
        found("lit", &lit);
    }
}

#[test]
fn defects_of_rows_are_noticed() {
    let planted = |name: &str, patch| notices(&by_edge(Quality::balanced(1.0)), SIZE, name, patch);
    planted("the lower row alone", |t| replace(&t, "row - f32(lower));", "0.0);"));
    planted("shares the wrong way around", |t| {
        replace(
            &t,
            "select(1.0 - rows.weight, rows.weight, is_upper)",
            "select(rows.weight, 1.0 - rows.weight, is_upper)",
        )
    });
    planted("upper rows by their whole share", |t| {
        replace(
            &t,
            "f * select(1.0 - rows.weight, rows.weight, is_upper)",
            "f * select(1.0 - rows.weight, 1.0, is_upper)",
        )
    });
    planted("an edge of half its strength", |t| replace(&t, "min(edge, 1.0)", "min(0.5 * edge, 1.0)"));
    planted("the edge at the stretch's front", |t| {
        replace(&t, "slope_at(stretch, 0.5, pose)", "slope_at(stretch, -0.5, pose)")
    });
    planted("the row behind the next", |t| replace(&t, "min(lower + 1u, count)", "min(lower + 2u, count)"));
    planted("a first row without its own nodes", |t| replace(&t, "look, row == 0u);", "look + 1u, row == 0u);"));
    let planted = |name: &str, patch| notices(&by_distance(Quality::balanced(1.0)), SIZE, name, patch);
    planted("distances half a cell off", |t| {
        replace(&t, "(p + 0.5) * regions.distance_scale", "(p + 1.0) * regions.distance_scale")
    });
    planted("rows all as far apart", |t| replace(&t, "(place - gap.x) * gap.y", "(place - gap.x) * 0.2"));
    let planted = |name: &str, patch| notices(&divided(Quality::balanced(1.0)), SIZE, name, patch);
    planted("regions without their rows", |t| {
        replace(&t, "let is_last = is_upper || rows.weight <= 0.0;", "let is_last = true;")
    });
    planted("regions that want a place twice", |t| {
        replace(&t, "select(0.0, f, is_last && !is_rest)", "select(f, 0.0, is_rest)")
    });
    planted("another distance", |t| replace(&t, "dot(by, textureSampleLevel", "dot(by.yxzw, textureSampleLevel"));
    // Homogeneous matter, of which a region's second row shows as much as what is around it: no face between them.
    let flat = phantom::volume([32; 3], centered([32; 3], DVec3::ONE), |_| 500.0);
    let mut even = phantom::scene(&flat, BODY, Quality::balanced(1.0));
    let round = selection(&flat.grid, &Arc::default(), |p| ball(p, DVec3::new(3.0, 12.0, 2.0), 9.0));
    add(&mut even, round, BODY, 1.0, None, 1.0);
    even.objects[0].transfer_function.nodes.iter_mut().for_each(|n| n.opacity *= 0.2);
    let dim: Vec<_> = BODY.iter().map(|(value, style, opacity)| (*value, *style, 0.2 * opacity)).collect();
    let rows = across(&mut even, Axis::Even(1.0), &[(0.0, NOTHING), (1.0, &dim)], 1.0);
    even.objects[0].regions[0].look.transfer_function = rows;
    let planted = |name: &str, patch| notices(&even, SIZE, name, patch);
    planted("faces by the first row", |t| replace(&t, "if row >= count { break; }", "if row >= 1u { break; }"));
    let labels = Quality { borders: Borders::TwoLookUps, ..Quality::balanced(1.0) };
    notices(&divided(labels), SIZE, "labels by their lower row", |t| {
        replace(&t, "if !is_upper || rows.weight <= 0.0 { break; }", "break;")
    });
}

#[test]
fn rows_that_are_alike_are_one() {
    let mut renderer = renderer();
    for axis in [Axis::Edge, Axis::Distance(1), Axis::Even(0.3)] {
        for nodes in [BODY, VEIL] {
            let two = of_rows(&lumpy(), axis, &[(0.0, nodes), (1.0, nodes)], Quality::STANDARD);
            let one = phantom::scene(&lumpy(), nodes, Quality::STANDARD);
            let apart = difference(&draw(&mut renderer, &one, SIZE), &draw(&mut renderer, &two, SIZE));
            assert!(apart < 2e-4, "{axis:?} {apart}");
        }
    }
}

#[test]
fn at_a_row_that_row_is_drawn() {
    let mut renderer = renderer();
    let one = phantom::scene(&lumpy(), BODY, Quality::STANDARD);
    let one = draw(&mut renderer, &one, SIZE);
    for place in [1.0, 2.0, 1e9] {
        let two = of_rows(&lumpy(), Axis::Even(place), &[(0.0, VEIL), (1.0, BODY)], Quality::STANDARD);
        let apart = difference(&one, &draw(&mut renderer, &two, SIZE));
        assert!(apart < 2e-4, "{place}: {apart}");
    }
}

#[test]
fn what_goes_by_distance_ends_at_it() {
    // Homogeneous matter, opaque up to 7 mm from a ball of 4: a ball of 11.
    let volume = phantom::volume([32; 3], centered([32; 3], DVec3::ONE), |_| 500.0);
    let around = |far: f64| {
        let center = DVec3::ZERO;
        let round = selection(&volume.grid, &Arc::default(), |p| ball(p, center, 4.0));
        let mut scene = phantom::scene(&volume, BODY, Quality::FINAL);
        let solid: Nodes<'_> = &[(0.0, "bone", 1.0)];
        scene.objects[0].transfer_function =
            across(&mut scene, Axis::Distance(0), &[(far - 0.01, solid), (far + 0.01, NOTHING)], 0.05);
        scene.objects[0].distances = vec![DistanceField::of(&[round], &volume.grid, &Progress::new()).unwrap()];
        scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 32.0 });
        draw(&mut renderer(), &scene, [64, 64])
    };
    for far in [7.0, 2.0, -1.5] {
        let area_mm2 = around(far).pixels.iter().map(|p| f64::from(p[3])).sum::<f64>() / 4.0;
        let radius = (area_mm2 / std::f64::consts::PI).sqrt();
        assert!((radius - (4.0 + far)).abs() < 0.12, "{far}: {radius}");
    }
}

#[test]
fn extreme_rows_draw_or_are_a_sentence() {
    let mut renderer = renderer();
    let all: Vec<(f64, Nodes<'_>)> = (0..MAX_ROWS).map(|i| (0.1 * i as f64, [VEIL, BODY, NOTHING][i % 3])).collect();
    for rows in [
        &all[..],
        &[(0.5, VEIL), (0.500_001, BODY)],
        &[(-1e9, VEIL), (1e9, BODY)],
        &[(1e9, VEIL), (2e9, BODY)],
        &[(-1e300, NOTHING), (1e300, BODY)],
    ] {
        for axis in [Axis::Edge, Axis::Distance(0)] {
            let scene = of_rows(&lumpy(), axis, rows, Quality::STANDARD);
            if rows[0].0.abs() > 1e200 {
                draw(&mut renderer, &scene, SIZE);
            } else {
                compare(&mut renderer, &scene, SIZE).unwrap_or_else(|e| panic!("{axis:?} {rows:?}: {e}"));
            }
        }
    }
    // Nothing is a surface, whatever the rows.
    let flat = phantom::volume([8; 3], centered([8; 3], DVec3::ONE), |_| 500.0);
    compare(&mut renderer, &of_rows(&flat, Axis::Edge, &[(0.0, VEIL), (0.5, BODY)], Quality::STANDARD), SIZE).unwrap();

    let mut refused = |rows: &[(f64, Nodes<'_>)], axis: Axis, about: &str| {
        let mut scene = of_rows(&lumpy(), Axis::Edge, &[(0.0, VEIL), (1.0, BODY)], Quality::STANDARD);
        let empty = rows.is_empty();
        let rows = if empty { &[(0.0, VEIL)] } else { rows };
        scene.objects[0].transfer_function = across(&mut scene, axis, rows, 1.0);
        let fault =
            renderer.render(&scene, SIZE, &RenderOptions::default(), &Progress::new()).err().unwrap().to_string();
        assert!(fault.contains(about), "{fault}");
    };
    let many: Vec<(f64, Nodes<'_>)> = (0..=MAX_ROWS).map(|i| (i as f64, BODY)).collect();
    refused(&many, Axis::Edge, "9 rows");
    refused(&[], Axis::Edge, "1 rows");
    refused(&[(0.0, VEIL), (0.0, BODY)], Axis::Edge, "ascend");
    refused(&[(0.0, VEIL), (f64::NAN, BODY)], Axis::Edge, "NaN");
    refused(&[(0.0, VEIL), (1.0, BODY)], Axis::Distance(2), "distance 2 of 2");
    refused(&[(0.0, VEIL), (1.0, BODY)], Axis::Even(f64::INFINITY), "inf");
    let mut scene = by_distance(Quality::STANDARD);
    scene.objects[0].distances = vec![scene.objects[0].distances[0].clone(); 5];
    assert!(renderer.render(&scene, SIZE, &RenderOptions::default(), &Progress::new()).is_err());
    scene.objects[0].distances = vec![distances(&flat, DVec3::ZERO)];
    assert!(renderer.render(&scene, SIZE, &RenderOptions::default(), &Progress::new()).is_err());
}

#[test]
fn rows_do_not_depend_on_tiles_or_empty_space() {
    let mut renderer = renderer();
    for scene in [by_edge(Quality::STANDARD), by_distance(Quality::STANDARD), divided(Quality::STANDARD)] {
        same_in_tiles_and_everywhere(&mut renderer, &scene, SIZE);
    }
}
