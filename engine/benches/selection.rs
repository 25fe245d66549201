//! What editing selections costs: `cargo bench -p fabrica-engine --bench selection`. Medians; on one thread where it says so.

#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use fabrica_engine::Progress;
use fabrica_engine::selection::{
    BrickDiff, Brush, BrushMode, Edge, Growth, Holes, Islands, Limits, Profile, Seeds, Selection, Shape, Stroke,
    from_label_maps, select_range,
};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::labels::{Label, LabelMap, distinct_color};
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use glam::{DAffine3, DVec3};

fn main() {
    let one = rayon_on(1);
    let grid = |n: usize| Grid::new([n; 3], DAffine3::from_scale(DVec3::ONE)).unwrap();
    let progress = Progress::new();

    for n in [128, 512, 1024] {
        let mut selection = Selection::empty(grid(n), &Arc::default());
        one.install(|| {
            let brush = brush(10.0);
            let (mut times, mut metadata) = (Vec::new(), 0.0);
            for i in 0..200 {
                let at = DVec3::new(20.0 + f64::from(i % 40) * 2.1, 40.3, 50.7 + f64::from(i / 40) * 5.0);
                let start = Instant::now();
                let mut stroke = Stroke::new(&selection, brush, Limits::default()).unwrap();
                stroke.dab_to(at);
                let mut undo = stroke.finish();
                selection.swap(&mut undo);
                metadata += selection.volume_ml() + selection.bounds().unwrap()[0][0] as f64;
                times.push(start.elapsed());
            }
            println!(
                "dab of radius 10 with metadata in {n}³, one thread: {} (checked {metadata:.0})",
                ms(median(times))
            );
        });
    }

    // Strokes of some hundred points along spirals, each an undo step.
    let mut selection = Selection::empty(grid(512), &Arc::default());
    let mut undo: Vec<BrickDiff> = Vec::new();
    let mut dabs = Vec::new();
    for i in 0..200_i32 {
        let mut stroke = Stroke::new(&selection, brush(10.0), Limits::default()).unwrap();
        for step in 0..60 {
            let t = f64::from(i) * 0.37 + f64::from(step) * 0.05;
            let at = DVec3::new(256.0 + 180.0 * t.cos(), 256.0 + 180.0 * (1.3 * t).sin(), 40.0 + 2.1 * f64::from(i));
            let start = Instant::now();
            stroke.dab_to(at);
            dabs.push(start.elapsed());
        }
        let mut diff = stroke.finish();
        selection.swap(&mut diff);
        undo.push(diff);
    }
    let bytes: usize = undo.iter().map(BrickDiff::num_bytes).sum();
    println!(
        "200 strokes of 60 points in 512³: {:.1} MB of undo, {:.1} MB selection, {} a point",
        bytes as f64 / 1e6,
        selection.num_bytes() as f64 / 1e6,
        ms(median(dabs))
    );

    let map = structures(512, 117);
    let start = Instant::now();
    let made = from_label_maps(std::slice::from_ref(&map), &Arc::default(), &progress).unwrap();
    println!("{} structures of a 512³ label map: {}", made.len(), ms(start.elapsed()));
    drop((made, map));

    for n in [256, 512] {
        let center = DVec3::splat(n as f64 / 2.0);
        let ball = Shape::ball(center, n as f64 * 0.4);
        let start = Instant::now();
        let selection = ball.select(&grid(n), &Limits::default(), &Arc::default(), &progress).unwrap();
        println!("ball in {n}³: {}", ms(start.elapsed()));
        for mm in [2.0, -2.0, 10.0] {
            let mut moved = selection.clone();
            let start = Instant::now();
            moved.grow_mm(mm, &progress).unwrap();
            println!("its surface moved by {mm} mm in {n}³: {}", ms(start.elapsed()));
        }
        let mut smoothed = selection.clone();
        let start = Instant::now();
        smoothed.smooth_mm(2.0, true, &progress).unwrap();
        println!("smoothed by 2 mm in {n}³: {}", ms(start.elapsed()));
        let start = Instant::now();
        Islands::of(&selection, Default::default(), &progress).unwrap().kept(|i| i == 0);
        println!("islands in {n}³: {}", ms(start.elapsed()));
        let start = Instant::now();
        smoothed.fill_holes(Holes::InSpace, &progress).unwrap();
        println!("holes in {n}³: {}", ms(start.elapsed()));
    }

    let scan = Arc::new(scan(256));
    scan.bricks();
    let start = Instant::now();
    let range = select_range(&scan, [300.0, 5000.0], Edge::PartialVolume, &Arc::default(), &progress).unwrap();
    println!("range in 256³: {}, {:.0} ml", ms(start.elapsed()), range.volume_ml());
    let mut growth = Growth::new(&scan, &Seeds::at([128; 3])).unwrap();
    let start = Instant::now();
    growth.grow(700.0, usize::MAX, &progress).unwrap();
    println!("growing to {} voxels in 256³: {}", growth.num_voxels(700.0), ms(start.elapsed()));
    for tolerance in [200.0, 500.0] {
        let start = Instant::now();
        let region = growth.region(tolerance, Edge::PartialVolume, &Arc::default(), &progress).unwrap();
        println!("its region at another tolerance: {}, {:.0} ml", ms(start.elapsed()), region.volume_ml());
    }
}

fn brush(radius_mm: f64) -> Brush {
    Brush { radius_mm, profile: Profile::Hard, strength: 1.0, mode: BrushMode::Paint }
}

fn rayon_on(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

/// Cells around points on a grid of points, as compact as organs are.
fn structures(n: usize, num: usize) -> LabelMap {
    let grid = Grid::new([n; 3], DAffine3::from_scale(DVec3::ONE)).unwrap();
    let cell = n as f64 / 5.0;
    let voxels = (0..n * n * n).map(|i| {
        let at = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / (n * n)) as f64) / cell;
        let inside = (at - at.floor() - 0.5).length() < 0.48;
        let [x, y, z] = at.to_array().map(|c| c as usize);
        if inside { 1 + ((x + 5 * (y + 5 * z)) % num) as u16 } else { 0 }
    });
    let voxels = voxels.collect();
    let label = |id: u32| Label { id, name: format!("structure {id}"), color: distinct_color(id), code: None };
    LabelMap { grid, voxels, labels: (0..=num as u32).map(label).collect(), notes: Vec::new() }
}

/// A bright middle in noise.
fn scan(n: usize) -> Volume {
    let grid = Grid::new([n; 3], DAffine3::from_scale(DVec3::ONE)).unwrap();
    let mut state = 1_u64;
    let voxels = (0..n * n * n).map(|i| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let at = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / (n * n)) as f64) / n as f64 - 0.5;
        (1000.0 * (1.0 - 2.0 * at.length())) as i16 + (state % 60) as i16
    });
    Volume::new(grid, Voxels::I16(voxels.collect()), Rescale::IDENTITY, "").unwrap()
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort();
    times[times.len() / 2]
}

fn ms(time: Duration) -> String {
    format!("{:.2} ms", time.as_secs_f64() * 1e3)
}
