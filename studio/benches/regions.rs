//! What selections and label maps cost: the frame rate of a scene with them as a share of the same scene's without, in one run, by
//! turns. `cargo bench -p fabrica-studio --bench regions [-- VOLUME LABELS]` (default: the head specimen and its own structures).
//! Bricks that an edit touches, and how long it takes until they are on the adapter, are measured on an empty grid of 512³.

#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use fabrica_engine::Progress;
use fabrica_engine::gpu::regions::ResidentRegions;
use fabrica_engine::gpu::{AdapterChoice, GpuContext};
use fabrica_engine::render::{RenderOptions, Renderer};
use fabrica_engine::scene::{Borders, Look, Meetings, Moved, Quality, Region, Scene};
use fabrica_engine::selection::{BrickPool, Selection};
use fabrica_engine::spaces::Grid;
use fabrica_engine::styles::StyleLibrary;
use fabrica_studio::figure::source::VolumeSource;
use fabrica_studio::figure::sources::{Sources, load_selections};
use fabrica_studio::figure::template::{SelectionSlot, VolumeSlot};
use fabrica_studio::figure::{bridge, first_look};
use glam::{DAffine3, DVec3};

const SIZE: [u32; 2] = [384, 384];
const ROUNDS: usize = 5;

fn main() {
    let paths: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let file = |i: usize| paths.get(i).map_or("specimen:head@128", String::as_str).to_owned();
    let progress = Progress::new();
    let source = VolumeSource::parse(&file(0), Path::new("")).unwrap();
    let volume = source.load(&Default::default(), &progress).unwrap();
    let slot = VolumeSlot::new(first_look::SLOT, file(0));
    let template = first_look::first_look(&volume, slot, &progress).unwrap();
    let styles = StyleLibrary::embedded();
    let (plain, _) = bridge::scene(&template, &Sources::of(vec![volume.clone()]), &styles, &progress).unwrap();
    let slot = SelectionSlot::new("labels", first_look::SLOT, file(1));
    let started = Instant::now();
    let labels = load_selections(&slot, Path::new(""), &volume, &progress).unwrap();
    println!("{} structures read and smoothed in {:.1} s", labels.structures.len(), started.elapsed().as_secs_f64());

    // The same look everywhere, so that the same samples are visible, in other colors.
    let tint = |i: usize| Some([0.2 + 0.1 * (i % 8) as f32, 0.9 - 0.1 * (i % 7) as f32, 0.3 + 0.1 * (i % 6) as f32]);
    let region = |i: usize, selection: Selection| Region {
        name: i.to_string(),
        selection,
        look: Look { tint: tint(i), ..Look::plain(plain.objects[0].transfer_function.clone()) },
        moved: None,
    };
    let with = |selections: Vec<Selection>, own_functions: bool| {
        let mut scene = plain.clone();
        let mut regions: Vec<Region> = selections.into_iter().enumerate().map(|(i, s)| region(i, s)).collect();
        if own_functions {
            for (i, region) in regions.iter_mut().enumerate() {
                // Another table each, and almost the same picture.
                region.look.transfer_function.nodes.iter_mut().for_each(|n| n.opacity *= 1.0 - 1e-4 * (i + 1) as f64);
            }
        }
        scene.objects[0].regions = regions;
        scene
    };
    let scenes: Vec<(String, Scene)> = vec![
        ("none".to_owned(), plain.clone()),
        ("1 selection".to_owned(), with(balls(&volume.grid, 1), true)),
        ("4 selections".to_owned(), with(balls(&volume.grid, 4), true)),
        ("8 selections".to_owned(), with(balls(&volume.grid, 8), true)),
        (
            format!("{} labels", labels.structures.len()),
            with(labels.structures.iter().map(|s| s.selection.clone()).collect(), false),
        ),
    ];
    // Moved by half its size, so that it lies half in what rests; and out of it.
    let mut scenes = scenes;
    for (name, share) in [("1 moved by half", 0.5), ("1 moved out", 2.0)] {
        let mut scene = with(balls(&volume.grid, 1), true);
        let region = &mut scene.objects[0].regions[0];
        let bounds = region.selection.bounds().unwrap();
        let size = bounds[1][1] - bounds[1][0];
        let shift = volume.grid.world_from_index().transform_vector3(DVec3::Y) * size as f64 * share;
        let ghost = Look { opacity: 0.15, ..region.look.clone() };
        region.moved = Some(Moved { pose: DAffine3::from_translation(shift), ghost, meetings: Meetings::default() });
        scenes.push((name.to_owned(), scene));
    }
    // Each again with borders by two look-ups.
    let scenes: Vec<(String, Scene)> = scenes
        .into_iter()
        .flat_map(|(name, scene)| {
            let quality = Quality { borders: Borders::TwoLookUps, ..scene.quality };
            let two = Scene { quality, ..scene.clone() };
            let has_regions = !scene.objects[0].regions.is_empty();
            [Some((name.clone(), scene)), has_regions.then(|| (format!("{name}, two look-ups"), two))]
        })
        .flatten()
        .collect();
    let context = || GpuContext::new(&AdapterChoice::Software).unwrap();
    let mut renderers: Vec<Renderer> = scenes.iter().map(|_| Renderer::new(context())).collect();
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
    let fastest = |times: &[f64]| times.iter().copied().fold(f64::INFINITY, f64::min);
    for ((name, _), these) in scenes.iter().zip(&times) {
        let ratio = fastest(&times[0]) / fastest(these);
        println!("{name:>28}: {:7.0} ms a frame at best, {ratio:.2} of the frame rate of none", fastest(these));
    }
    for borders in [Borders::Exact, Borders::TwoLookUps] {
        edits(&context(), borders);
    }
    frames_of_edits(context(), &plain);
}

/// Fuzzy balls in the eighths of the volume.
fn balls(grid: &Grid, count: usize) -> Vec<Selection> {
    let pool: Arc<BrickPool> = Arc::default();
    let dims = DVec3::from_array(grid.dims().map(|n| n as f64));
    // So that they just touch along the shortest axis.
    let radius = 0.2 * dims.min_element();
    (0..count)
        .map(|i| {
            let center = dims
                * DVec3::new(0.3 + 0.4 * (i & 1) as f64, 0.3 + 0.4 * (i >> 1 & 1) as f64, 0.3 + 0.4 * (i >> 2) as f64);
            let mut selection = Selection::empty(*grid, &pool);
            selection.change(grid.dims().map(|n| [0, n]), |v, _| {
                let at = DVec3::from_array(v.map(|n| n as f64));
                (255.0 * (0.5 + (radius - at.distance(center)) / 4.0).clamp(0.0, 1.0)) as u8
            });
            selection
        })
        .collect()
}

/// Dabs of a brush with a radius of 10 voxels.
fn edits(context: &GpuContext, borders: Borders) {
    let grid = Grid::new([512; 3], DAffine3::IDENTITY).unwrap();
    let mut regions = vec![Region {
        name: "painted".to_owned(),
        selection: Selection::empty(grid, &Arc::default()),
        look: Look::plain(fabrica_engine::scene::StyleTransferFunction::new(
            vec![fabrica_engine::scene::TransferFunctionNode { value: 0.0, style: 0, opacity: 1.0 }],
            1.0,
        )),
        moved: None,
    }];
    let mut resident = ResidentRegions::upload(context, [64; 3], &regions, borders, &Progress::new()).unwrap();
    let (mut edit_ms, mut upload_ms) = (Vec::new(), Vec::new());
    for i in 0..60 {
        let center = DVec3::new(100.0 + 5.0 * f64::from(i), 250.0, 300.0 + f64::from(i % 7));
        let started = Instant::now();
        let low = center - 11.0;
        let voxels = std::array::from_fn(|a| [low[a] as usize, low[a] as usize + 23]);
        regions[0].selection.change(voxels, |v, old| {
            let d = DVec3::from_array(v.map(|n| n as f64)).distance(center) / 10.0;
            old.max((255.0 * (-4.0 * d * d).exp() * f64::from(u8::from(d < 1.0))) as u8)
        });
        edit_ms.push(started.elapsed().as_secs_f64() * 1e3);
        let started = Instant::now();
        assert!(resident.update(context, [64; 3], &regions).unwrap());
        context.queue.submit([]);
        let _ = context.device.poll(eframe::wgpu::PollType::wait_indefinitely());
        upload_ms.push(started.elapsed().as_secs_f64() * 1e3);
    }
    for (what, times) in [("edit", &mut edit_ms), ("upload", &mut upload_ms)] {
        times.sort_by(f64::total_cmp);
        println!(
            "{what} of a dab of radius 10 in 512³, {borders:?}: {:.2} ms at best, {:.2} ms in the median",
            times[0], times[30]
        );
    }
}

/// What a dab costs a picture of a few pixels: all that is made anew for it, besides drawing.
fn frames_of_edits(context: GpuContext, plain: &Scene) {
    let mut scene = plain.clone();
    let volume = &scene.objects[0].volume;
    let (grid, dims) = (volume.grid, volume.grid.dims());
    let look = Look { tint: Some([0.2, 0.6, 0.9]), ..Look::plain(scene.objects[0].transfer_function.clone()) };
    let selection = Selection::empty(grid, &Arc::default());
    scene.objects[0].regions = vec![Region { name: "painted".to_owned(), selection, look, moved: None }];
    let mut renderer = Renderer::new(context);
    let mut times = [Vec::new(), Vec::new()];
    for i in 0..60 {
        let at: [usize; 3] = std::array::from_fn(|a| dims[a] / 4 + i % (dims[a] / 4));
        // By turns with a dab and without.
        if i % 2 == 0 {
            scene.objects[0].regions[0].selection.change(at.map(|n| [n, n + 20]), |_, f| f.saturating_add(i as u8 + 1));
        }
        let started = Instant::now();
        renderer.render(&scene, [8, 8], &RenderOptions::default(), &Progress::new()).unwrap();
        if i > 3 {
            times[i % 2].push(started.elapsed().as_secs_f64() * 1e3);
        }
    }
    let [with, without] = times.map(|mut t| {
        t.sort_by(f64::total_cmp);
        t[t.len() / 2]
    });
    println!("a frame of 8² pixels after a dab: {with:.2} ms in the median, without one {without:.2} ms");
}
