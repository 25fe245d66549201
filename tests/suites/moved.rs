//! Moved regions: the raycaster against the f64 reference, what their poses and meetings must do, and the extremes.

use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::measure::Difference;
use fabrica_engine::pass::raycast::ShaderPatch;
use fabrica_engine::reference::Reference;
use fabrica_engine::render::{FloatImage, RenderOptions, Renderer};
use fabrica_engine::scene::moved::{STRENGTH_SIZE, Strength};
use fabrica_engine::scene::{Look, Meeting, Meetings, Moved, Projection, Quality, Scene};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use fabrica_tests::phantom::{self, add, ball, bump, centered, function, lumpy, selection};
use fabrica_tests::renderer;
use fabrica_tests::twin::{self, ENDLESS, difference, replace};
use glam::{DAffine3, DQuat, DVec3};

const SIZE: [u32; 2] = [48, 40];

const BODY: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: &[(f64, &str, f64)] = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.1)];
const SOLID: &[(f64, &str, f64)] = &[(250.0, "clay", 0.0), (350.0, "steel", 0.8)];
const THIN: &[(f64, &str, f64)] = &[(100.0, "clay", 0.001), (900.0, "cool_warm", 0.02)];

fn draw(renderer: &mut Renderer, scene: &Scene) -> FloatImage {
    twin::draw(renderer, scene, SIZE)
}

fn compare(renderer: &mut Renderer, scene: &Scene) -> Result<Difference, String> {
    twin::compare(renderer, scene, SIZE)
}

fn notices(scene: &Scene, name: &str, patch: ShaderPatch) {
    twin::notices(scene, SIZE, name, patch);
}

/// Turned around its middle and shifted.
fn pose(center: DVec3, shift: DVec3, scale: f64) -> DAffine3 {
    let turn = DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 0.7);
    let to_center = DAffine3::from_translation(-center);
    DAffine3::from_scale_rotation_translation(DVec3::splat(scale), turn, center + shift) * to_center
}

/// Moves the last region; `ghost`: the nodes of its ghost's look.
fn move_last(scene: &mut Scene, pose: DAffine3, ghost: &[(f64, &str, f64)], meetings: Meetings) {
    let ghost = Look { opacity: 0.8, tint: Some([0.9, 0.4, 0.4]), ..Look::plain(function(scene, ghost, 1.5)) };
    let moved = Moved { pose, ghost, meetings };
    scene.objects[0].regions.last_mut().unwrap().moved = Some(moved);
}

pub fn meetings() -> Meetings {
    let cells = (0..STRENGTH_SIZE * STRENGTH_SIZE).map(|i| (i % STRENGTH_SIZE * 4) as u8);
    Meetings {
        ghost: Some(Meeting { color: [0.1, 0.3, 1.0], opacity: Some(0.7), strength: None }),
        background: Some(Meeting {
            color: [1.0, 0.8, 0.1],
            opacity: None,
            strength: Strength::new(cells.collect()).map(Arc::new),
        }),
    }
}

/// A body with a fuzzy ball that was moved so that it half overlaps where it was, and half sticks out; beside it a region at rest.
pub fn taken(volume: &Arc<Volume>, nodes: &[(f64, &str, f64)], quality: Quality, meetings: Meetings) -> Scene {
    let mut scene = phantom::scene(volume, nodes, quality);
    let (pool, grid) = (Arc::default(), &volume.grid);
    let corner = selection(grid, &pool, |p| f64::from(u8::from(p.z > 6.0)));
    add(&mut scene, corner, VEIL, 2.0, Some([0.2, 0.6, 0.9]), 0.7);
    let center = DVec3::new(-4.0, 3.0, 1.0);
    add(&mut scene, selection(grid, &pool, |p| ball(p, center, 7.0)), SOLID, 1.0, None, 0.9);
    move_last(&mut scene, pose(center, DVec3::new(-7.0, 6.0, 3.0), 1.0), THIN, meetings);
    scene
}

#[test]
fn a_moved_selection_draws_what_the_equations_say() {
    let mut renderer = renderer();
    let mut failed = 0;
    for nodes in [BODY, VEIL, THIN] {
        for (quality, met) in [
            (Quality::balanced(1.0), Meetings::default()),
            (Quality::STANDARD, Meetings::default()),
            (Quality::STANDARD, meetings()),
            (Quality::FINAL, meetings()),
        ] {
            for projection in
                [Projection::Perspective { fov_y_deg: 20.0 }, Projection::Orthographic { height_mm: 48.0 }]
            {
                let volume = lumpy();
                let mut scene = taken(&volume, nodes, quality, met.clone());
                scene.camera = phantom::camera(&volume, DVec3::new(-0.7, 0.5, 0.4), projection);
                let found = compare(&mut renderer, &scene);
                println!("{} {quality:?} {projection:?} {}: {found:?}", nodes[0].1, met.ghost.is_some());
                failed += usize::from(found.is_err());
            }
        }
    }
    assert_eq!(failed, 0);
}

#[test]
fn moved_selections_of_awkward_grids_and_poses_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let mut failed = 0;
    for (name, volume) in phantom::awkward() {
        let center = DVec3::new(-4.0, 3.0, 1.0);
        let shift = DVec3::new(-3.0, 4.0, 5.0);
        for (which, pose) in [
            ("turned", pose(center, shift, 1.0)),
            ("twice as large", pose(center, shift, 2.0)),
            ("a third as large", pose(center, shift, 1.0 / 3.0)),
            ("sheared", pose(center, shift, 1.0) * DAffine3::from_mat3(phantom::sheared())),
            ("mirrored", pose(center, shift, 1.0) * DAffine3::from_scale(DVec3::new(1.0, -1.0, 1.0))),
        ] {
            let mut scene = taken(&volume, BODY, Quality::STANDARD, meetings());
            scene.objects[0].regions[1].moved.as_mut().unwrap().pose = pose;
            let found = compare(&mut renderer, &scene);
            println!("{name}, {which}: {found:?}");
            failed += usize::from(found.is_err());
        }
    }
    assert_eq!(failed, 0);
}

#[test]
fn several_bodies_at_one_place_draw_what_the_equations_say() {
    // Three moved balls, two of which meet in the third's ghost; a group of two that moves as one; one function for all, and many.
    let volume = lumpy();
    let mut renderer = renderer();
    for (nodes, met) in [(VEIL, Meetings::default()), (VEIL, meetings()), (BODY, meetings())] {
        let mut scene = phantom::scene(&volume, nodes, Quality::STANDARD);
        let pool = Arc::default();
        for (i, center) in [[-5.0, 2.0, 0.0], [5.0, -3.0, 4.0], [1.0, 6.0, -6.0], [0.0, -6.0, -3.0]].iter().enumerate()
        {
            let center = DVec3::from_array(*center);
            let own = [nodes, SOLID, VEIL, nodes][i];
            let part = selection(&volume.grid, &pool, |p| ball(p, center, 5.5));
            add(&mut scene, part, own, 1.0, [None, Some([0.8, 0.2, 0.1])][i % 2], 0.9);
            // The last two go together.
            let to = [DVec3::ZERO, DVec3::new(-2.0, 1.0, 1.0), DVec3::ZERO, DVec3::ZERO][i] - center;
            let pose = if i < 2 { pose(center, to, 1.0) } else { pose(DVec3::ZERO, DVec3::new(0.0, 3.0, 8.0), 1.2) };
            move_last(&mut scene, pose, nodes, met.clone());
        }
        assert_eq!(scene.objects[0].bodies().len(), if met.ghost.is_some() { 7 } else { 4 });
        let found = compare(&mut renderer, &scene);
        println!("{} {}: {found:?}", nodes[0].1, met.ghost.is_some());
        found.unwrap();
    }
}

#[test]
fn moved_parts_of_colors_and_of_volumes_with_gaps_draw_what_the_equations_say() {
    let mut renderer = renderer();
    let dims = [24; 3];
    let grid = Grid::new(dims, centered(dims, DVec3::ONE)).unwrap();
    let place = |i: usize| DVec3::new((i % 24) as f64, (i / 24 % 24) as f64, (i / 576) as f64);
    let nodes = &[(0.01, "plaster", 0.0), (0.05, "plaster", 0.9), (0.3, "porcelain", 1.0)];
    let colored = phantom::colored(|p| if p.x > 20.0 { 0 } else { 255 });
    let mut scene = phantom::scene(&colored, nodes, Quality::STANDARD);
    let center = DVec3::new(5.0, 2.0, 1.0);
    add(
        &mut scene,
        selection(&grid, &Arc::default(), |p| ball(p, center, 7.0)),
        nodes,
        1.0,
        Some([0.9, 0.2, 0.1]),
        1.0,
    );
    move_last(&mut scene, pose(center, DVec3::new(4.0, 5.0, 3.0), 1.0), &[(0.1, "wax", 0.1)], meetings());
    compare(&mut renderer, &scene).unwrap();

    let value = |i: usize| {
        let p = place(i);
        if (p.x + p.y) % 7.0 == 3.0 { f32::NAN } else { (900.0 - 70.0 * p.distance(DVec3::splat(11.0))) as f32 }
    };
    let rescale = Rescale { slope: -1.0, intercept: 1000.0 };
    let volume = Volume::new(grid, Voxels::F32((0..13824).map(value).collect()), rescale, "test").unwrap();
    compare(&mut renderer, &taken(&Arc::new(volume), THIN, Quality::STANDARD, meetings())).unwrap();
}

#[test]
fn defects_of_moved_selections_are_noticed() {
    let mut scene = taken(&lumpy(), VEIL, Quality::balanced(1.0), meetings());
    // A ghost to meet with.
    let ghost = Look::plain(function(&mut scene, BODY, 1.0));
    scene.objects[0].regions[1].moved.as_mut().unwrap().ghost = ghost;
    let planted: [(&str, ShaderPatch); 13] = [
        ("normals as at rest", |t| {
            replace(&t, "return there * (length(direction) / max(length(there), 1e-30));", "return direction;")
        }),
        ("the looks of the rest", |t| replace(&t, "pose.first_look + look", "look")),
        ("what is moved adds up", |t| replace(&t, "max(rest.a, most)", "rest.a + most")),
        ("what rests is a union", |t| replace(&t, "max(rest.a, most)", "max(0.7 * rest.a, most)")),
        ("meetings are not taken out", |t| {
            replace(&t, "min(s.alpha, 1.0 - max(with_ghost, with_background))", "s.alpha")
        }),
        ("the background stays where it meets", |t| {
            replace(&t, "min(met.background.alpha, 1.0 - with_background)", "met.background.alpha")
        }),
        ("one strength everywhere", |t| replace(&t, "strength * opacity", "opacity")),
        ("the strength's axes exchanged", |t| {
            replace(&t, "vec2f(rest.value, moved.value)", "vec2f(moved.value, rest.value)")
        }),
        ("the opacity of the denser", |t| {
            replace(&t, "select(kind - 1.0, min(denser, 1.0), kind < 0.0)", "min(denser, 1.0)")
        }),
        ("the color of the other meeting", |t| {
            replace(&t, "bodies.list[met.strongest].with_ghost)", "bodies.list[met.strongest].with_background)")
        }),
        ("meetings beyond the selection", |t| replace(&t, "min(min(rest.share, moved.share),", "min(rest.share,")),
        ("stretches that begin where the last began", |t| {
            replace(&t, "frame.near_depth + begin * ray.depth_per_mm", "frame.near_depth")
        }),
        ("stretches that begin in the wrong place", |t| {
            replace(&t, "origins[b] + begin * directions[b]", "origins[b] + 1.02 * begin * directions[b]")
        }),
    ];
    for (name, patch) in planted {
        let mut scene = scene.clone();
        if name.starts_with("meetings are") || name.starts_with("the background stays") {
            // All of the selection's place is the meeting's.
            let moved = scene.objects[0].regions[1].moved.as_mut().unwrap();
            moved.meetings.background.as_mut().unwrap().strength = None;
            let dense = function(&mut scene, &[(0.0, "clay", 0.7)], 1.0);
            scene.objects[0].transfer_function = dense.clone();
            scene.objects[0].regions[1].look = Look { tint: Some([0.0, 1.0, 0.0]), ..Look::plain(dense) };
        }
        // Depth only says how blurred styles are.
        if name.starts_with("stretches that begin where") {
            scene.camera =
                phantom::camera(&lumpy(), DVec3::new(0.3, 1.0, 0.2), Projection::Perspective { fov_y_deg: 100.0 });
            scene.objects[0].transfer_function =
                function(&mut scene, &[(150.0, "engraving", 0.0), (300.0, "engraving", 0.9)], 1.0);
        }
        notices(&scene, name, patch);
    }
    // A body of larger voxels blurs its styles less, where its surfaces are so flat that their curvature blurs none.
    let flat =
        phantom::volume([32; 3], centered([32; 3], DVec3::ONE), |p| bump(p, DVec3::new(40.0, -150.0, 20.0), 300.0));
    let mut scene = taken(&flat, VEIL, Quality::STANDARD, Meetings::default());
    let look = function(&mut scene, &[(0.0, "engraving", 0.9)], 1.0);
    scene.objects[0].regions[1].look = Look::plain(look);
    scene.objects[0].regions[1].moved.as_mut().unwrap().pose = pose(DVec3::new(-4.0, 3.0, 1.0), DVec3::ZERO, 0.25);
    notices(&scene, "styles as sharp as at rest", |t| replace(&t, "return pose.voxels;", "return 1.0;"));
}

#[test]
fn what_was_not_moved_is_drawn_as_ever() {
    let mut renderer = renderer();
    let mut scene = taken(&lumpy(), VEIL, Quality::STANDARD, meetings());
    scene.objects[0].regions[1].moved.as_mut().unwrap().pose = DAffine3::IDENTITY;
    let mut plain = scene.clone();
    plain.objects[0].regions[1].moved = None;
    let (report, there) = (pipeline(&mut renderer, &scene), draw(&mut renderer, &scene));
    assert_eq!((report, difference(&there, &draw(&mut renderer, &plain))), (pipeline(&mut renderer, &plain), 0.0));
}

fn pipeline(renderer: &mut Renderer, scene: &Scene) -> String {
    let (options, progress) = (RenderOptions::default(), Progress::new());
    renderer.render_bands(scene, SIZE, &options, &progress, |_| Ok(())).unwrap().pipeline
}

/// All of a volume as one region, in a look of its own; the background shows nothing.
fn whole(nodes: &[(f64, &str, f64)]) -> Scene {
    let volume = lumpy();
    let mut scene = phantom::scene(&volume, &[(0.0, "unshaded", 0.0)], ENDLESS);
    add(&mut scene, selection(&volume.grid, &Arc::default(), |_| 1.0), nodes, 1.0, None, 1.0);
    scene
}

#[test]
fn all_of_a_volume_moved_is_the_volume_seen_from_elsewhere() {
    // Neither needs the reference: a camera that moves along sees the same, whatever the pose.
    let mut renderer = renderer();
    for nodes in [BODY, VEIL] {
        for projection in [Projection::Perspective { fov_y_deg: 20.0 }, Projection::Orthographic { height_mm: 48.0 }] {
            // The box of what rests cuts rays into other pieces: short ones, whose errors are small.
            let mut scene = whole(nodes);
            scene.quality = Quality { termination: 1e-6, ..Quality::balanced(1.0 / 8.0) };
            scene.camera = phantom::camera(&lumpy(), DVec3::new(-0.7, 0.5, 0.4), projection);
            let at_rest = draw(&mut renderer, &scene);
            for shift in [DVec3::new(3.0, -5.0, 2.0), DVec3::new(900.0, 400.0, -5000.0)] {
                let pose = pose(DVec3::ZERO, shift, 1.0);
                let mut moved = scene.clone();
                move_last(&mut moved, pose, &[(0.0, "white", 0.0)], Meetings::default());
                moved.camera.eye_mm = pose.transform_point3(scene.camera.eye_mm);
                for (axis, at_rest) in [
                    (&mut moved.camera.forward, scene.camera.forward),
                    (&mut moved.camera.right, scene.camera.right),
                    (&mut moved.camera.up, scene.camera.up),
                ] {
                    *axis = pose.transform_vector3(at_rest);
                }
                let found = difference(&draw(&mut renderer, &moved), &at_rest);
                println!("{} {projection:?} {shift}: {found}", nodes[0].1);
                // With what rests it is drawn from farther away, which takes digits; those of normals that are close together tell how
                // much a style is blurred (0.0022 at most).
                assert!(found < if shift.length() < 10.0 { 3e-3 } else { 2e-2 }, "{found}");
            }
        }
    }
}

#[test]
fn opacities_of_what_meets_are_those_of_the_thesis() {
    // Slabs of one value: the rest 10 mm thick, of which the far half of the picture's middle is moved into the near one.
    let volume = phantom::volume([10; 3], centered([10; 3], DVec3::ONE), |_| 500.0);
    for (rest, own) in [(0.1, 0.3), (0.3, 0.1)] {
        let mut scene = phantom::scene(&volume, &[(0.0, "unshaded", rest)], ENDLESS);
        scene.objects[0].transfer_function = function(&mut scene, &[(0.0, "white", rest)], 1.0);
        let far = selection(&volume.grid, &Arc::default(), |p| f64::from(u8::from(p.y < 0.0)));
        add(&mut scene, far, &[(0.0, "white", own)], 1.0, None, 1.0);
        let ghost = Look { opacity: 0.0, ..scene.objects[0].regions[0].look.clone() };
        let pose = DAffine3::from_translation(DVec3::new(0.0, 5.0, 0.0));
        scene.objects[0].regions[0].moved = Some(Moved { pose, ghost, meetings: Meetings::default() });
        scene.camera = phantom::camera(&volume, DVec3::Y, Projection::Orthographic { height_mm: 4.0 });
        let picture = draw(&mut renderer(), &scene);
        let center = picture.pixels[(picture.width * (picture.height / 2) + picture.width / 2) as usize][3];
        // Five millimeters in which both are, but for the two voxels of interpolation at the selection's end, where neither is
        // whole: eq. 2.5's maximum.
        let most = |d: f64| 1.0 - (1.0 - f64::max(rest, own)).powf(d);
        assert!((most(4.0)..most(5.5)).contains(&f64::from(center)), "{center} {}", most(5.0));
        // And the reference at a tenth of the step.
        let exact = Reference::new(&scene).unwrap().pixel_with_step(SIZE, SIZE[0] / 2, SIZE[1] / 2, 0.02, 0.0)[3];
        assert!((f64::from(center) - exact).abs() < 2e-3, "{center} {exact}");
    }
}

#[test]
fn empty_space_tiles_and_passes_do_not_change_a_picture() {
    let mut renderer = renderer();
    let scene = taken(&lumpy(), VEIL, Quality::STANDARD, meetings());
    let whole = draw(&mut renderer, &scene);
    for options in [
        RenderOptions { skip_empty: false, ..RenderOptions::default() },
        RenderOptions { tile: 7, ..RenderOptions::default() },
    ] {
        let picture = renderer.render(&scene, SIZE, &options, &Progress::new()).unwrap();
        assert_eq!(difference(&picture, &whole), 0.0, "{options:?}");
    }
    // Steps so short that a ray takes several passes.
    let mut fine = scene.clone();
    fine.quality = Quality::balanced(1.0 / 32.0);
    let picture = draw(&mut renderer, &fine);
    let found = difference(&picture, &whole);
    println!("{found}");
    assert!(found < 0.03, "{found}");
    let mut finer = scene;
    finer.quality = Quality::balanced(1.0 / 64.0);
    let found = difference(&draw(&mut renderer, &finer), &picture);
    assert!(found < 2e-3, "{found}");
}

#[test]
fn an_edit_of_a_moved_selection_is_drawn_as_a_fresh_upload() {
    let mut edited = renderer();
    let mut scene = taken(&lumpy(), VEIL, Quality::STANDARD, meetings());
    draw(&mut edited, &scene);
    for i in 0..4 {
        let at = 2 + 6 * i;
        scene.objects[0].regions[1].selection.change([[at, at + 7], [4, 20], [9, 15]], |_, f| f.max(200));
        if i == 2 {
            scene.objects[0].regions[0].selection.change([[0, 32], [0, 32], [20, 32]], |_, _| 0);
        }
        let found = difference(&draw(&mut edited, &scene), &draw(&mut renderer(), &scene));
        assert_eq!(found, 0.0, "{i}");
    }
}

#[test]
fn extreme_poses_draw_or_are_refused() {
    let mut renderer = renderer();
    let with = |pose: DAffine3| {
        let mut scene = taken(&lumpy(), VEIL, Quality::STANDARD, meetings());
        scene.objects[0].regions[1].moved.as_mut().unwrap().pose = pose;
        scene
    };
    let center = DVec3::new(-4.0, 3.0, 1.0);
    for (name, pose) in [
        ("a hundredth as large", pose(center, DVec3::new(0.0, 20.0, 0.0), 0.01)),
        ("a hundred times as large", pose(center, DVec3::ZERO, 100.0)),
        ("far away", pose(center, DVec3::splat(1e6), 1.0)),
        ("a hair's breadth", DAffine3::from_translation(DVec3::splat(1e-12))),
        ("around the camera", pose(center, DVec3::new(20.0, 100.0, 15.0), 3.0)),
    ] {
        let picture = draw(&mut renderer, &with(pose));
        assert!(picture.pixels.iter().any(|p| p[3] > 0.0), "{name}");
    }
    for (pose, expected) in [
        (pose(center, DVec3::ZERO, 0.0), "scaled"),
        (pose(center, DVec3::ZERO, 1e-5), "scaled"),
        (pose(center, DVec3::ZERO, 1e9), "scaled"),
        (DAffine3::from_translation(DVec3::new(0.0, f64::NAN, 0.0)), "no number"),
        (DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)), "scaled"),
    ] {
        let said = with(pose).validate().unwrap_err().to_string();
        assert!(said.contains(expected) && said.contains("region 2") && !said.contains('\n'), "{said}");
    }
    // Nothing selected, and as many bodies as there may be, of which the last is one too many.
    let mut scene = phantom::scene(&lumpy(), VEIL, Quality::DRAFT);
    let pool = Arc::default();
    add(&mut scene, selection(&lumpy().grid, &pool, |_| 0.0), SOLID, 1.0, None, 1.0);
    move_last(&mut scene, pose(center, DVec3::splat(3.0), 1.0), THIN, meetings());
    draw(&mut renderer, &scene);
    for i in 0..14 {
        let middle = DVec3::new(f64::from(i) - 7.0, 0.0, 3.0);
        add(&mut scene, selection(&lumpy().grid, &pool, |p| ball(p, middle, 2.5)), SOLID, 1.0, None, 1.0);
        let met = Meetings::default();
        move_last(&mut scene, pose(middle, DVec3::new(0.0, 3.0 + 0.5 * f64::from(i), 4.0), 1.0), THIN, met);
        if i == 12 {
            compare(&mut renderer, &scene).unwrap();
        }
    }
    let said = scene.validate().unwrap_err().to_string();
    assert!(said.contains("17 parts") && said.contains("together"), "{said}");
}
