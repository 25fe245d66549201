//! Lighting maps: the raycaster against the f64 reference, the defects that the comparison must notice, what is known without it, and
//! the extremes.

use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::Arc;

use fabrica_engine::Progress;
use fabrica_engine::render::RenderOptions;
use fabrica_engine::scene::{Contours, Light, LightFrame, Lighting, LightingMap, Projection, Quality, Scene};
use fabrica_engine::styles::StyleImage;
use fabrica_tests::phantom::{self, add, ball, lumpy, selection};
use fabrica_tests::renderer;
use fabrica_tests::twin::{compare, difference, draw, notices, replace, same_in_tiles_and_everywhere};
use glam::DVec3;

const SIZE: [u32; 2] = [48, 40];

const BODY: &[(f64, &str, f64)] = &[(150.0, "bone", 0.0), (300.0, "bone", 0.9), (700.0, "vessel", 1.0)];
const VEIL: &[(f64, &str, f64)] = &[(100.0, "glass", 0.0), (400.0, "wax", 0.05), (600.0, "muscle", 0.2)];

fn light(direction: DVec3, frame: LightFrame, color: [f32; 3]) -> Light {
    Light { direction: direction.normalize(), frame, color }
}

/// A lamp at the camera's upper left, a blue sky, and one from behind.
fn lights() -> Vec<Light> {
    vec![
        light(DVec3::new(-0.6, 0.7, 0.8), LightFrame::Camera, [1.0, 0.9, 0.8]),
        light(DVec3::new(0.2, 0.1, 1.0), LightFrame::World, [0.1, 0.2, 0.5]),
        light(DVec3::new(0.5, 0.0, -0.8), LightFrame::Camera, [0.3, 0.3, 0.3]),
    ]
}

fn lit(nodes: &[(f64, &str, f64)], map: LightingMap, lights: Vec<Light>, quality: Quality) -> Scene {
    let mut scene = phantom::scene(&lumpy(), nodes, quality);
    scene.objects[0].lighting = Some(Lighting { map, lights });
    scene
}

fn shiny() -> LightingMap {
    LightingMap::BlinnPhong { ambient: 0.1, diffuse: 0.7, specular: 0.5, shininess: 20.0 }
}

#[test]
fn lit_objects_draw_what_the_equations_say() {
    let mut renderer = renderer();
    for nodes in [BODY, VEIL] {
        for (name, map) in [("blinn-phong", shiny()), ("cartoon", LightingMap::Cartoon), ("metal", LightingMap::Metal)]
        {
            for quality in [Quality::DRAFT, Quality::STANDARD, Quality::FINAL] {
                for projection in
                    [Projection::Perspective { fov_y_deg: 60.0 }, Projection::Orthographic { height_mm: 40.0 }]
                {
                    let mut scene = lit(nodes, map, lights(), quality);
                    scene.camera = phantom::camera(&lumpy(), DVec3::new(-0.7, 0.5, 0.4), projection);
                    let found = compare(&mut renderer, &scene, SIZE);
                    println!("{} {name} {quality:?} {projection:?}: {found:?}", nodes[0].1);
                    found.unwrap();
                }
            }
        }
    }
}

/// With a region, contours and transparency.
fn divided(quality: Quality) -> Scene {
    let mut scene = lit(BODY, shiny(), lights(), quality);
    let round = selection(&lumpy().grid, &Arc::default(), |p| ball(p, DVec3::new(-4.0, 3.0, 1.0), 7.0));
    add(&mut scene, round, VEIL, 1.0, Some([0.9, 0.3, 0.2]), 0.8);
    scene.objects[0].transfer_function.contours = Some(Contours { width_pt: 4.0, color: Some([0.1, 0.0, 0.2]) });
    scene.objects[0].regions[0].look.transfer_function.illustrative_transparency = true;
    scene
}

#[test]
fn lit_regions_and_colors_draw_what_the_equations_say() {
    let mut renderer = renderer();
    compare(&mut renderer, &divided(Quality::STANDARD), SIZE).unwrap();
    let colored = phantom::colored(|_| 255);
    let nodes = &[(0.01, "plaster", 0.0), (0.05, "plaster", 0.9)];
    let mut scene = phantom::scene(&colored, nodes, Quality::STANDARD);
    scene.objects[0].lighting = Some(Lighting { map: shiny(), lights: lights() });
    compare(&mut renderer, &scene, SIZE).unwrap();
}

#[test]
fn defects_of_lighting_are_noticed() {
    let scene = lit(BODY, shiny(), lights(), Quality::balanced(1.0));
    let seen = |name, patch| notices(&scene, SIZE, name, patch);
    seen("only the first light", |t| replace(&t, "if i >= lighting.count", "if i >= 1u"));
    seen("ambient of each light", |t| replace(&t, "light.share * terms.x", "terms.x"));
    seen("highlights in the surface's color", |t| {
        replace(&t, "light.color * terms.y, light.color * terms.z", "light.color * (terms.y + terms.z), vec3f(0.0)")
    });
    seen("lights behind the eye in front", |t| {
        replace(&t, "-dot(light.direction, ray));", "abs(dot(light.direction, ray)));")
    });
    seen("a wider highlight", |t| replace(&t, "lighting.model.w", "0.7 * lighting.model.w"));
    seen("light through a surface", |t| replace(&t, "max(n_l, 0.0)", "abs(n_l)"));
    seen("the color of the node above", |t| replace(&t, "vec2u(nodes.first, row)", "vec2u(nodes.second, row)"));
    let scene = lit(BODY, LightingMap::Metal, lights(), Quality::balanced(1.0));
    notices(&scene, SIZE, "highlights upside down", |t| replace(&t, "1.0 - n_h", "n_h"));
    let scene = lit(BODY, LightingMap::Cartoon, lights()[..1].to_vec(), Quality::balanced(1.0));
    notices(&scene, SIZE, "light from the wrong side", |t| replace(&t, "0.5 + 0.5 * n_l", "0.5 - 0.5 * n_l"));
}

#[test]
fn a_lit_ball_is_what_a_style_of_the_same_light_draws() {
    // Seen in parallel, light that is fixed to the camera is a lit sphere: a style.
    let mut renderer = renderer();
    let map = shiny();
    let l = DVec3::new(-0.5, 0.5, FRAC_1_SQRT_2).normalize();
    let mut scene = lit(
        &[(250.0, "bone", 0.0), (300.0, "bone", 1.0)],
        map,
        vec![light(l, LightFrame::Camera, [1.0; 3])],
        Quality::FINAL,
    );
    scene.styles = vec![Arc::new(StyleImage::flat("white", [1.0; 4]))];
    scene.camera = phantom::camera(&lumpy(), DVec3::Y, Projection::Orthographic { height_mm: 40.0 });
    let by_light = draw(&mut renderer, &scene, SIZE);
    let size = 256;
    let texel = |i: usize| {
        let at = |k: usize| (k as f64 + 0.5 - 128.0) / 127.5;
        let (x, y) = (at(i % size), -at(i / size));
        let n = DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt());
        let n = n / n.length().max(1.0);
        let [a, d, s] = map.terms(n.dot(l), n.dot((l + DVec3::Z).normalize()));
        let c = (a + d + s).clamp(0.0, 1.0) as f32;
        [c, c, c, 1.0]
    };
    let picture =
        fabrica_engine::image_out::Picture { width: size, height: size, pixels: (0..size * size).map(texel).collect() };
    let mut style = StyleImage::from_straight("lit", &picture).unwrap();
    // Blur by mips is the style's alone.
    style.mips.truncate(1);
    scene.styles = vec![Arc::new(style)];
    scene.objects[0].lighting = None;
    let by_style = draw(&mut renderer, &scene, SIZE);
    let apart = difference(&by_light, &by_style);
    assert!(apart < 0.03, "{apart}");
}

#[test]
fn extreme_lights_draw_or_are_a_sentence() {
    let mut renderer = renderer();
    for (direction, color) in [
        (DVec3::NEG_Z, [1.0; 3]),
        (DVec3::Z, [1e6, 0.0, 0.0]),
        (DVec3::X, [0.0; 3]),
        (DVec3::new(1e-9, 0.0, -1.0), [1e-9; 3]),
    ] {
        for num_lights in [1, 4] {
            let lights = vec![light(direction, LightFrame::Camera, color); num_lights];
            compare(&mut renderer, &lit(BODY, shiny(), lights, Quality::STANDARD), SIZE).unwrap();
        }
    }
    let mut refused = |lights: Vec<Light>, said: &str| {
        let scene = lit(BODY, shiny(), lights, Quality::STANDARD);
        let found = renderer.render(&scene, SIZE, &RenderOptions::default(), &Progress::new()).map(|_| ());
        let found = found.unwrap_err().to_string();
        assert!(found.contains(said), "{found}");
    };
    let lamp = light(DVec3::Z, LightFrame::Camera, [1.0; 3]);
    refused(Vec::new(), "0 lights");
    refused(vec![lamp; 5], "5 lights");
    refused(vec![Light { direction: DVec3::ZERO, ..lamp }], "length 1");
    refused(vec![Light { direction: DVec3::NAN, ..lamp }], "length 1");
    refused(vec![Light { color: [-1.0, 0.0, 0.0], ..lamp }], "color");
}

#[test]
fn lit_rays_of_many_passes_draw_the_same() {
    let mut renderer = renderer();
    let mut scene = lit(VEIL, shiny(), lights(), Quality { step_voxels: 1.0 / 64.0, ..Quality::STANDARD });
    same_in_tiles_and_everywhere(&mut renderer, &scene, SIZE);
    scene.quality.step_voxels = 1.0 / 16.0;
    compare(&mut renderer, &scene, SIZE).unwrap();
}
