//! What parts cost: the frame rate of a figure whose object is cut into parts, as a share of the same figure's with it whole, in one run, by
//! turns. `cargo bench -p fabrica-studio --bench parts --profile dev [-- TEMPLATE]` (default: the shipped skull). Exploded: parts moved apart
//! by a twentieth of the way from the middle, so that they nearly cover the same pixels.

#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use fabrica_engine::Progress;
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::scene::{Object, Scene};
use fabrica_engine::styles::StyleLibrary;
use fabrica_studio::figure::template::{CutTemplate, PartTemplate, PartsTemplate, Template};
use fabrica_studio::figure::{bridge, sources};

const SIZE: [u32; 2] = [512, 512];
const ROUNDS: usize = 7;

/// Cuts along the three axes into 4 x 4 x 4, or as many of these cuts as make `num` parts, in radii of the visible sphere.
fn cut_up(num: usize) -> PartsTemplate {
    let mut cuts = Vec::new();
    // Of each part, its box.
    let mut boxes = vec![([-0.7f64; 3], [0.7f64; 3])];
    while boxes.len() < num {
        let widest = |(low, high): &([f64; 3], [f64; 3])| (0..3).map(|a| high[a] - low[a]).fold(0.0, f64::max);
        let part = (0..boxes.len()).max_by(|a, b| widest(&boxes[*a]).total_cmp(&widest(&boxes[*b]))).unwrap();
        let (low, high) = boxes[part];
        let axis = (0..3).max_by(|a, b| (high[*a] - low[*a]).total_cmp(&(high[*b] - low[*b]))).unwrap();
        let (mut at, mut normal) = ([0.0; 3], [0.0; 3]);
        at[axis] = low[axis].midpoint(high[axis]);
        normal[axis] = 1.0;
        let (mut behind, mut front) = (boxes[part], boxes[part]);
        behind.1[axis] = at[axis];
        front.0[axis] = at[axis];
        boxes[part] = behind;
        boxes.push(front);
        cuts.push(CutTemplate { part: part + 1, at, normal, extra: Default::default() });
    }
    let list = boxes.iter().map(|(low, high)| PartTemplate {
        offset: std::array::from_fn(|a| 0.05 * low[a].midpoint(high[a])),
        ..PartTemplate::default()
    });
    PartsTemplate { cuts, list: list.collect(), extra: Default::default() }
}

fn main() {
    let path = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let path = path.map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../templates/head.json"), PathBuf::from);
    let progress = Progress::new();
    let plain = Template::read(&path).unwrap();
    let sources = sources::load(&plain, path.parent().unwrap(), &[], &[], &progress).unwrap();
    let styles = StyleLibrary::embedded();
    let mut scenes: Vec<(String, Scene)> = Vec::new();
    for num in [1, 8, 64] {
        for exploded in [false, true] {
            let mut template = plain.clone();
            let mut parts = cut_up(num);
            if !exploded {
                parts.list.iter_mut().for_each(|part| part.offset = [0.0; 3]);
            }
            template.objects[0].parts = parts;
            let scene = bridge::scene(&template, &sources, &styles, &progress).unwrap().0;
            let cells = |o: &Object| o.parts.cells(&o.volume.grid).map_or(1, |cells| cells.len());
            let name = format!(
                "{num} parts, {} ({})",
                if exploded { "exploded" } else { "at rest" },
                cells(&scene.objects[0])
            );
            scenes.push((name, scene));
        }
    }
    let mut renderers: Vec<Renderer> =
        scenes.iter().map(|_| Renderer::new(GpuContext::new(&AdapterChoice::Software).unwrap())).collect();
    let mut times = vec![Vec::new(); scenes.len()];
    for round in 0..=ROUNDS {
        for ((renderer, (_, scene)), times) in renderers.iter_mut().zip(&scenes).zip(&mut times) {
            let started = Instant::now();
            renderer.render(scene, SIZE, &RenderOptions::default(), &progress).unwrap();
            // The first uploads and compiles.
            if round > 0 {
                times.push(started.elapsed().as_secs_f64() * 1e3);
            }
        }
    }
    for ((name, _), these) in scenes.iter().zip(&times) {
        let mut ratios: Vec<f64> = times[0].iter().zip(these).map(|(whole, parts)| whole / parts).collect();
        ratios.sort_by(f64::total_cmp);
        let best = these.iter().copied().fold(f64::INFINITY, f64::min);
        println!(
            "{name:>28}: {best:6.0} ms a frame at best, {:.2} of the frame rate whole (median)",
            ratios[ratios.len() / 2]
        );
    }
}
