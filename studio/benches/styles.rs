//! What styles cost: the frame rate of a figure with style transfer functions, contours, illustrative transparency and patterns, as a share of
//! the same figure's under Blinn-Phong, in one run, by turns. `cargo bench -p fabrica-studio --bench styles --profile dev
//! [-- TEMPLATE]` (default: the shipped head in glass, with three styles in sight).

#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use fabrica_engine::Progress;
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::scene::Scene;
use fabrica_engine::styles::StyleLibrary;
use fabrica_studio::figure::bridge;
use fabrica_studio::figure::sources;
use fabrica_studio::figure::template::{
    AcrossTemplate, AxisName, ContoursTemplate, LightingModel, LightingTemplate, Rgb, RowTemplate, Template,
    Transparency,
};

const SIZE: [u32; 2] = [384, 384];
const ROUNDS: usize = 7;

fn in_style(template: &mut Template, style: &str) {
    template.objects[0].transfer_function.nodes.iter_mut().for_each(|node| style.clone_into(&mut node.style));
}

fn main() {
    let path = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let path =
        path.map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../templates/head_glass.json"), PathBuf::from);
    let progress = Progress::new();
    let plain = Template::read(&path).unwrap();
    let sources = sources::load(&plain, path.parent().unwrap(), &[], &[], &progress).unwrap();
    let styles = StyleLibrary::embedded();
    type Change = fn(&mut Template);
    let changes: [(&str, Change); 10] = [
        ("Blinn-Phong", |t| t.objects[0].lighting = Some(LightingTemplate::new(LightingModel::BlinnPhong))),
        ("styles", |_| ()),
        ("contours", |t| t.objects[0].shading.contours = Some(ContoursTemplate::new(0.7))),
        ("inked contours", |t| {
            let ink = Some(Rgb([20, 16, 8]));
            t.objects[0].shading.contours = Some(ContoursTemplate { color: ink, ..ContoursTemplate::new(0.7) });
        }),
        ("transparency", |t| t.objects[0].shading.transparency = Some(Transparency::Illustrative)),
        ("both", |t| {
            t.objects[0].shading.contours = Some(ContoursTemplate::new(0.7));
            t.objects[0].shading.transparency = Some(Transparency::Illustrative);
        }),
        ("value x edge", |t| {
            let function = &mut t.objects[0].transfer_function;
            let row = RowTemplate { at: 0.3, nodes: function.nodes.clone(), extra: Default::default() };
            let across =
                AcrossTemplate { by: AxisName::Edge, from: None, at: 0.0, rows: vec![row], extra: Default::default() };
            function.across = Some(across);
        }),
        ("cross-hatched", |t| in_style(t, "cross_hatched")),
        ("by curvature", |t| in_style(t, "engraved_curvature")),
        ("stippled", |t| in_style(t, "stippled")),
    ];
    let scenes: Vec<Scene> = changes
        .iter()
        .map(|(_, change)| {
            let mut template = plain.clone();
            change(&mut template);
            bridge::scene(&template, &sources, &styles, &progress).unwrap().0
        })
        .collect();
    let mut renderers: Vec<Renderer> =
        scenes.iter().map(|_| Renderer::new(GpuContext::new(&AdapterChoice::Software).unwrap())).collect();
    let mut times = vec![Vec::new(); scenes.len()];
    for round in 0..=ROUNDS {
        for ((renderer, scene), times) in renderers.iter_mut().zip(&scenes).zip(&mut times) {
            let started = Instant::now();
            renderer.render(scene, SIZE, &RenderOptions::default(), &progress).unwrap();
            // The first uploads and compiles.
            if round > 0 {
                times.push(started.elapsed().as_secs_f64() * 1e3);
            }
        }
    }
    let fastest = |times: &[f64]| times.iter().copied().fold(f64::INFINITY, f64::min);
    for ((name, _), these) in changes.iter().zip(&times) {
        let ratio = fastest(&times[0]) / fastest(these);
        println!("{name:>16}: {:7.0} ms a frame at best, {ratio:.2} of the frame rate of Blinn-Phong", fastest(these));
    }
}
