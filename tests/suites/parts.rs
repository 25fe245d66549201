//! Parts of an object: the raycaster against the f64 reference, what lies as it was, order, and the extremes.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::measure::Difference;
use fabrica_engine::pass::raycast::ShaderPatch;
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::parts::Polyhedron;
use fabrica_engine::scene::{Contours, Cut, Object, Part, Parts, Plane, Projection, Quality, Scene};
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use fabrica_tests::phantom::{self, add, ball, lumpy, selection};
use fabrica_tests::renderer;
use fabrica_tests::twin::{self, difference, replace};
use glam::{DAffine3, DQuat, DVec3};

const SIZE: [u32; 2] = [48, 40];

const BODY: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: &[(f64, &str, f64)] = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.1)];

fn draw(renderer: &mut Renderer, scene: &Scene) -> FloatImage {
    twin::draw(renderer, scene, SIZE)
}

fn compare(renderer: &mut Renderer, scene: &Scene) -> Result<Difference, String> {
    twin::compare(renderer, scene, SIZE)
}

fn notices(scene: &Scene, name: &str, patch: ShaderPatch) {
    twin::notices(scene, SIZE, name, patch);
}

fn pipeline(renderer: &mut Renderer, scene: &Scene) -> String {
    let bands = renderer.render_bands(scene, SIZE, &RenderOptions::default(), &Progress::new(), |_| Ok(()));
    bands.unwrap().pipeline
}

/// Cuts an object into `num` parts where it lies: always the largest, by planes through its middle that no axis is along.
fn cut_up(object: &Object, num: usize) -> Parts {
    let (low, high) = object.volume.grid.index_box();
    let mut bounds = vec![Polyhedron::parallelepiped(object.volume.grid.box_corners_mm(low, high))];
    let mut cuts = Vec::new();
    let normals = [DVec3::new(1.0, 0.2, -0.1), DVec3::new(-0.3, 1.0, 0.2), DVec3::new(0.1, -0.2, 1.0)];
    while bounds.len() < num {
        let volume = |i: &usize| bounds[*i].volume();
        let part = (0..bounds.len()).max_by(|a, b| volume(a).total_cmp(&volume(b))).unwrap();
        let middle = middle(&bounds[part]);
        // Across its longest side of the three.
        let extent = |normal: &DVec3| {
            let (low, high) = bounds[part].heights(&Plane::through(middle, *normal).unwrap());
            high - low
        };
        let normal = normals.into_iter().max_by(|a, b| extent(a).total_cmp(&extent(b))).unwrap();
        let plane = Plane::through(middle, normal).unwrap();
        let cut = bounds.len() - 1;
        let front = bounds[part].behind(&plane.flipped(), Some(cut)).unwrap();
        bounds[part] = bounds[part].behind(&plane, Some(cut)).unwrap();
        bounds.push(front);
        cuts.push(Cut { part, plane });
    }
    let part = |i| Part { name: format!("part {}", i + 1), pose: DAffine3::IDENTITY, hidden: false };
    Parts { cuts, list: (0..num).map(part).collect() }
}

fn middle(bounds: &Polyhedron) -> DVec3 {
    bounds.corners().sum::<DVec3>() / bounds.corners().count() as f64
}

/// Middles of the parts at rest.
fn middles(object: &Object, parts: &Parts) -> Vec<DVec3> {
    let mut apart = parts.clone();
    apart.list.iter_mut().enumerate().for_each(|(i, part)| part.pose.translation.x = 1e3 * (i + 1) as f64);
    let cells = apart.cells(&object.volume.grid).unwrap();
    let mut middles = vec![DVec3::ZERO; cells.len()];
    for cell in &cells {
        middles[(cell.pose.translation.x / 1e3).round() as usize - 1] = middle(&cell.bounds);
    }
    middles
}

/// Moves every part away from the middle of all, so far that none overlaps, and turns it a little.
fn explode(scene: &mut Scene, num: usize, degree: f64) {
    let object = &mut scene.objects[0];
    let mut parts = cut_up(object, num);
    let middles = middles(object, &parts);
    let center = middles.iter().sum::<DVec3>() / middles.len() as f64;
    for (i, (part, middle)) in parts.list.iter_mut().zip(&middles).enumerate() {
        let axis = DVec3::new((i as f64).sin(), (2.0 * i as f64).cos(), 0.4).normalize();
        part.pose = DAffine3::from_translation(degree * (*middle - center) + *middle)
            * DAffine3::from_quat(DQuat::from_axis_angle(axis, 0.2))
            * DAffine3::from_translation(-*middle);
    }
    object.parts = parts;
}

fn exploded(volume: &Arc<Volume>, nodes: &[(f64, &str, f64)], quality: Quality, num: usize) -> Scene {
    let mut scene = phantom::scene(volume, nodes, quality);
    explode(&mut scene, num, 1.0);
    scene.camera.eye_mm *= 1.5;
    scene
}

/// The same without a turn.
fn shifted(volume: &Arc<Volume>, nodes: &[(f64, &str, f64)], quality: Quality, num: usize) -> Scene {
    let mut scene = exploded(volume, nodes, quality, num);
    let object = &mut scene.objects[0];
    let middles = middles(object, &object.parts);
    for (part, middle) in object.parts.list.iter_mut().zip(middles) {
        part.pose = DAffine3::from_translation(part.pose.transform_point3(middle) - middle);
    }
    scene
}

#[test]
fn exploded_parts_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let mut failed = 0;
    for nodes in [BODY, VEIL] {
        for (quality, num) in
            [(Quality::balanced(1.0), 2), (Quality::STANDARD, 5), (Quality::STANDARD, 27), (Quality::FINAL, 3)]
        {
            for projection in
                [Projection::Perspective { fov_y_deg: 20.0 }, Projection::Orthographic { height_mm: 90.0 }]
            {
                let volume = lumpy();
                for turned in [true, false] {
                    let made = if turned { exploded } else { shifted };
                    let mut scene = made(&volume, nodes, quality, num);
                    scene.camera = phantom::camera(&volume, DVec3::new(-0.7, 0.5, 0.4), projection);
                    scene.camera.eye_mm *= 1.5;
                    let pipeline = pipeline(&mut renderer, &scene);
                    assert!(pipeline.contains(" parts") && pipeline.contains(" turned") == turned, "{pipeline}");
                    let found = compare(&mut renderer, &scene);
                    println!("{} {num} {quality:?} {projection:?} {turned}: {found:?}", nodes[0].1);
                    failed += usize::from(found.is_err());
                }
            }
        }
    }
    assert_eq!(failed, 0);
}

#[test]
fn parts_of_awkward_grids_and_poses_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let mut failed = 0;
    for (name, volume) in phantom::awkward() {
        for (which, own) in [
            ("twice as large", DAffine3::from_scale(DVec3::splat(2.0))),
            ("a third as large", DAffine3::from_scale(DVec3::splat(1.0 / 3.0))),
            ("sheared", DAffine3::from_mat3(phantom::sheared())),
            ("mirrored", DAffine3::from_scale(DVec3::new(1.0, -1.0, 1.0))),
        ] {
            let mut scene = exploded(&volume, BODY, Quality::STANDARD, 4);
            scene.objects[0].parts.list[2].pose = DAffine3::from_translation(DVec3::new(20.0, 60.0, 5.0)) * own;
            let found = compare(&mut renderer, &scene);
            println!("{name}, {which}: {found:?}");
            failed += usize::from(found.is_err());
        }
    }
    assert_eq!(failed, 0);
}

#[test]
fn whatever_an_object_has_its_parts_have() {
    let mut renderer = renderer();
    let mut with = |name: &str, scene: &Scene| {
        compare(&mut renderer, scene)
            .map_err(|e| format!("{name}: {e}"))
            .inspect(|d| println!("{name}: {d:?}"))
            .unwrap();
    };
    let mut regions = exploded(&lumpy(), BODY, Quality::STANDARD, 6);
    let pool = Arc::default();
    add(
        &mut regions,
        selection(&lumpy().grid, &pool, |p| ball(p, DVec3::ZERO, 8.0)),
        VEIL,
        2.0,
        Some([0.9, 0.3, 0.2]),
        1.0,
    );
    with("regions", &regions);
    let mut contours = exploded(&lumpy(), BODY, Quality::STANDARD, 6);
    contours.objects[0].transfer_function.contours = Some(Contours { width_pt: 1.0, color: Some([0.1, 0.0, 0.0]) });
    contours.objects[0].transfer_function.illustrative_transparency = true;
    with("contours and transparency", &contours);
    let nodes = &[(0.01, "plaster", 0.0), (0.05, "plaster", 0.9), (0.3, "porcelain", 1.0)];
    with("colors", &exploded(&phantom::colored(|p| if p.x > 20.0 { 0 } else { 255 }), nodes, Quality::STANDARD, 4));
    // Voxels without data, and a negative slope.
    let place = |i: usize| DVec3::new((i % 24) as f64, (i / 24 % 24) as f64, (i / 576) as f64);
    let value = |i: usize| {
        let p = place(i);
        if (p.x + p.y) % 7.0 == 3.0 { f32::NAN } else { (900.0 - 70.0 * p.distance(DVec3::splat(11.0))) as f32 }
    };
    let rescale = Rescale { slope: -1.0, intercept: 1000.0 };
    let grid = phantom::colored(|_| 255).grid;
    let gaps = Volume::new(grid, Voxels::F32((0..13824).map(value).collect()), rescale, "gaps").unwrap();
    with("gaps", &exploded(&Arc::new(gaps), BODY, Quality::STANDARD, 4));
}

#[test]
fn what_is_cut_and_lies_as_it_was_is_drawn_as_ever() {
    let mut renderer = renderer();
    for nodes in [BODY, VEIL] {
        let mut scene = phantom::scene(&lumpy(), nodes, Quality::STANDARD);
        let whole = draw(&mut renderer, &scene);
        scene.objects[0].parts = cut_up(&scene.objects[0], 64);
        assert_eq!(difference(&draw(&mut renderer, &scene), &whole), 0.0);
        assert!(!pipeline(&mut renderer, &scene).contains(" parts"));
        // One part of 64 that is elsewhere leaves the others what they were, but for how rays are cut into pieces.
        scene.objects[0].parts.list[63].pose = DAffine3::from_translation(DVec3::new(0.0, -500.0, 0.0));
        compare(&mut renderer, &scene).unwrap();
    }
}

#[test]
fn a_hidden_part_shows_what_is_behind_it() {
    let mut renderer = renderer();
    let mut scene = phantom::scene(&lumpy(), BODY, Quality::STANDARD);
    scene.objects[0].parts = cut_up(&scene.objects[0], 8);
    let center = 40 * 48 / 2 + 24;
    let mut seen = vec![draw(&mut renderer, &scene).pixels[center]];
    for hidden in 0..8 {
        scene.objects[0].parts.list.iter_mut().enumerate().for_each(|(i, part)| part.hidden = i == hidden);
        let found = compare(&mut renderer, &scene);
        println!("{hidden}: {found:?}");
        found.unwrap();
        seen.push(draw(&mut renderer, &scene).pixels[center]);
    }
    assert!(seen.iter().any(|pixel| *pixel != seen[0]));
    // All of them: nothing, and a warning that says so.
    scene.objects[0].parts.list.iter_mut().for_each(|part| part.hidden = true);
    let report = renderer.render_bands(&scene, SIZE, &RenderOptions::default(), &Progress::new(), |_| Ok(())).unwrap();
    assert!(report.warnings.iter().any(|w| w.contains("all 8 parts are hidden")), "{:?}", report.warnings);
    assert!(draw(&mut renderer, &scene).pixels.iter().all(|p| *p == [0.0; 4]));
}

#[test]
fn parts_are_in_front_of_each_other_as_rays_meet_them() {
    let mut renderer = renderer();
    let mut scene = exploded(&lumpy(), BODY, Quality::STANDARD, 40);
    for from in [DVec3::X, DVec3::new(-1.0, 0.1, 0.3), DVec3::new(0.2, -0.7, 1.0), DVec3::new(0.0, 0.3, -1.0)] {
        // From among them, too: the eye is close.
        for nearness in [0.6, 1.5] {
            scene.camera = phantom::camera(&lumpy(), from, Projection::Perspective { fov_y_deg: 40.0 });
            scene.camera.eye_mm *= nearness;
            let found = compare(&mut renderer, &scene);
            println!("{from} {nearness}: {found:?}");
            found.unwrap();
        }
    }
}

#[test]
fn parts_that_overlap_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let mut failed = 0;
    for nodes in [BODY, VEIL] {
        for (degree, num) in [(-0.4, 3), (-0.6, 8), (0.1, 12)] {
            let mut scene = phantom::scene(&lumpy(), nodes, Quality::STANDARD);
            explode(&mut scene, num, degree);
            assert!(pipeline(&mut renderer, &scene).contains(" bodies"));
            let found = compare(&mut renderer, &scene);
            println!("{} {degree} {num}: {found:?}", nodes[0].1);
            failed += usize::from(found.is_err());
        }
        // A selection that was moved, and goes through several parts.
        let mut scene = exploded(&lumpy(), nodes, Quality::STANDARD, 6);
        let ball = selection(&lumpy().grid, &Arc::default(), |p| ball(p, DVec3::ZERO, 8.0));
        add(&mut scene, ball, BODY, 1.0, Some([0.9, 0.3, 0.2]), 1.0);
        phantom::take_away(&mut scene, 0, 0);
        let found = compare(&mut renderer, &scene);
        println!("{} with a selection: {found:?}", nodes[0].1);
        failed += usize::from(found.is_err());
    }
    assert_eq!(failed, 0);
}

#[test]
fn empty_space_tiles_and_passes_do_not_change_a_picture_of_parts() {
    let mut renderer = renderer();
    let scene = exploded(&lumpy(), VEIL, Quality::STANDARD, 12);
    let whole = draw(&mut renderer, &scene);
    for options in [
        RenderOptions { skip_empty: false, ..RenderOptions::default() },
        RenderOptions { tile: 7, ..RenderOptions::default() },
    ] {
        let picture = renderer.render(&scene, SIZE, &options, &Progress::new()).unwrap();
        assert_eq!(difference(&picture, &whole), 0.0, "{options:?}");
    }
    let options = RenderOptions { stride: 3, ..RenderOptions::default() };
    let sample = renderer.render(&scene, SIZE, &options, &Progress::new()).unwrap();
    for (i, pixel) in sample.pixels.iter().enumerate() {
        let (x, y) = (3 * (i % sample.width as usize) + 1, 3 * (i / sample.width as usize) + 1);
        assert_eq!(*pixel, whole.pixels[y * SIZE[0] as usize + x]);
    }
    // Steps so short that a ray takes several passes.
    let mut fine = scene.clone();
    fine.quality = Quality::balanced(1.0 / 32.0);
    let picture = draw(&mut renderer, &fine);
    let mut finer = scene;
    finer.quality = Quality::balanced(1.0 / 64.0);
    let found = difference(&draw(&mut renderer, &finer), &picture);
    assert!(found < 2e-3, "{found}");
}

#[test]
fn defects_of_parts_are_noticed() {
    let body = exploded(&lumpy(), BODY, Quality::STANDARD, 8);
    notices(&body, "walls that do not cut", |text| replace(&text, "within_both(box, walls.span)", "box"));
    notices(&body, "walls without any faces", |text| replace(&text, "let seen = across.z > 0.0;", "let seen = false;"));
    notices(&body, "far walls without faces", |text| replace(&text, "wall_face(p, pose.leave)", "vec4f(0.0)"));
    notices(&body, "normals of what was turned, unturned", |text| {
        replace(&text, "let there = pose.normal * direction;", "let there = direction;")
    });
    notices(&body, "the last of a list left out", |text| {
        replace(&text, "entry >= list.y ||", "entry + 1u >= list.y ||")
    });
    notices(&body, "the front of a part not looked up anew", |text| {
        replace(
            &text,
            "            known = false;\n            met = false;\n        }\n",
            "            met = false;\n        }\n",
        )
    });
    let apart = shifted(&lumpy(), BODY, Quality::STANDARD, 8);
    notices(&apart, "shifts the other way", |text| replace(&text, "ray.origin + shift.xyz", "ray.origin - shift.xyz"));
    notices(&apart, "walls of what was shifted left out", |text| replace(&text, "u32(shift.w)", "0u"));
    let veil = exploded(&lumpy(), VEIL, Quality::STANDARD, 8);
    notices(&veil, "depths that do not begin with the part", |text| {
        replace(&text, "frame.near_depth + enter * ray.depth_per_mm, step * ray.depth_per_mm", "frame.near_depth, 0.0")
    });
    notices(&veil, "the far side of parts that ends early", |text| {
        replace(&text, "found.span.y = t;", "found.span.y = t - 0.5;")
    });
}

#[test]
fn extreme_parts_draw_or_are_refused() {
    let mut renderer = renderer();
    // A sliver of a millionth of the box, 64 parts, one of which is very far away, one tiny, and one huge.
    let mut scene = phantom::scene(&lumpy(), BODY, Quality::STANDARD);
    let plane = Plane::through(DVec3::new(16.0 - 32e-6, 0.0, 0.0), DVec3::X).unwrap();
    let part = |name: &str| Part { name: name.to_owned(), pose: DAffine3::IDENTITY, hidden: false };
    scene.objects[0].parts = Parts { cuts: vec![Cut { part: 0, plane }], list: vec![part("most"), part("sliver")] };
    scene.objects[0].parts.list[1].pose = DAffine3::from_translation(DVec3::new(9.0, 3.0, 0.0));
    compare(&mut renderer, &scene).unwrap();
    let mut scene = exploded(&lumpy(), BODY, Quality::STANDARD, 64);
    compare(&mut renderer, &scene).unwrap();
    for pose in [
        DAffine3::from_translation(DVec3::splat(1e6)),
        DAffine3::from_translation(DVec3::new(0.0, -200.0, 0.0)) * DAffine3::from_scale(DVec3::splat(0.01)),
        DAffine3::from_translation(DVec3::new(0.0, -3000.0, 0.0)) * DAffine3::from_scale(DVec3::splat(100.0)),
    ] {
        scene.objects[0].parts.list[7].pose = pose;
        let picture = draw(&mut renderer, &scene);
        assert!(picture.pixels.iter().any(|p| p[3] > 0.0), "{pose:?}");
    }
    scene.objects[0].parts.list[7].pose = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    let said = scene.validate().unwrap_err().to_string();
    assert!(said.contains("part 8") && !said.contains('\n'), "{said}");
}
