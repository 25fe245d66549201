//! Where the time of a frame goes: the same figure with parts of its shader taken out, by turns in one run. `cargo bench -p fabrica-studio
//! --bench profile --profile dev [-- TEMPLATE]` (default: the shipped skull under the lights of Blinn and Phong). A share is what a frame
//! saves without it, so that shares need not add up: what is taken out may have hidden or fed something else.

#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use fabrica_engine::Progress;
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::pass::raycast::ShaderPatch;
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::styles::StyleLibrary;
use fabrica_studio::figure::template::{LightingModel, LightingTemplate, Template};
use fabrica_studio::figure::{bridge, sources};

const SIZE: [u32; 2] = [512, 512];
const ROUNDS: usize = 9;

/// The text with `from` replaced, which has to be in it.
fn without(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the shader has no \"{from}\"");
    text.replace(from, to)
}

const PATCHES: [(&str, ShaderPatch); 8] = [
    ("whole", |t| t),
    ("nothing but the launch", |t| {
        let rest = "return vec4f(0.0);\n}\nfn rest(position: vec4f, pixel: vec2u, ray: Ray, axes: Axes) -> vec4f {\n";
        without(&t, "    var accumulated = resume(", &format!("    {rest}    var accumulated = resume("))
    }),
    ("rays without pieces", |t| without(&t, "let count = covered.y;", "let count = covered.y * 0u;")),
    ("leaps to the first brick", |t| {
        without(&t, "if cell.x == 0u { break; }", "if cell.x == 0u { k = count; break; }")
    }),
    ("search up to the first piece", |t| {
        without(
            &t,
            "        if !visible { break; }\n",
            "        if visible { accumulated = vec4f(back); }\n        break;\n",
        )
    }),
    ("one part a piece, not four", |t| without(&t, "const PARTS: u32 = 4u;", "const PARTS: u32 = 1u;")),
    ("no gradients", |t| without(&t, "let gradient = turned(gradient_at(p), pose);", "let gradient = p;")),
    ("no light or style", |t| {
        let call = "shade(node, function.last_node, function.row, n_xy, steepness(slope, face), level, march.axes,\n        march.direction)";
        without(&t, call, "vec4f(node + n_xy.x, n_xy.y, level, 1.0)")
    }),
];

fn main() {
    let path = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let is_ours = path.is_none();
    let path = path.map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../templates/head.json"), PathBuf::from);
    let progress = Progress::new();
    let mut template = Template::read(&path).unwrap();
    if is_ours {
        template.objects[0].lighting = Some(LightingTemplate::new(LightingModel::BlinnPhong));
    }
    let sources = sources::load(&template, path.parent().unwrap(), &[], &[], &progress).unwrap();
    let scene = bridge::scene(&template, &sources, &StyleLibrary::embedded(), &progress).unwrap().0;
    let context = || GpuContext::new(&AdapterChoice::Software).unwrap();
    let mut renderers = PATCHES.map(|(_, patch)| Renderer::with_patched_shaders(context(), patch));
    let mut least = [f64::INFINITY; PATCHES.len()];
    for round in 0..=ROUNDS {
        for (renderer, least) in renderers.iter_mut().zip(&mut least) {
            let started = Instant::now();
            renderer.render(&scene, SIZE, &RenderOptions::default(), &progress).unwrap();
            // The first uploads and compiles.
            if round > 0 {
                *least = least.min(started.elapsed().as_secs_f64() * 1e3);
            }
        }
    }
    for ((name, _), ms) in PATCHES.iter().zip(least) {
        println!("{name:>30}: {ms:7.1} ms, {:3.0} % of the whole frame", 100.0 * ms / least[0]);
    }
}
