//! Prints what a slice of 512² pixels through 512³ voxels of int16 takes on one core, as time on the processor where the system
//! tells it (other programs do not count), else as it passes.
//!
//! `cargo run --release -p fabrica-engine --example slice_times`, on Linux under `taskset -c 0`, as else it takes all cores.

use std::time::Instant;

use fabrica_engine::slice::anatomical::{Convention, Frame, Orientation};
use fabrica_engine::slice::{Filter, Plane, Window, draw};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use glam::{DAffine3, DMat3, DVec3};

/// Nanoseconds that this thread was on a processor.
fn on_processor_ns(begun: Instant) -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let ns = stat.and_then(|s| s.split(' ').next().and_then(|ns| ns.parse().ok()));
    ns.unwrap_or(begun.elapsed().as_nanos() as f64)
}

fn main() -> Result<(), String> {
    let begun = Instant::now();
    let grid = Grid::new([512; 3], DAffine3::from_scale(DVec3::splat(0.5)))?;
    let voxels = (0..512_usize.pow(3)).map(|i| (i * 7919 % 4096) as i16 - 1024).collect();
    let volume = Volume::new(grid, Voxels::I16(voxels), Rescale::IDENTITY, "noise")?;
    let turned = DMat3::from_rotation_x(0.3) * DMat3::from_rotation_z(0.2);
    for (name, turn) in [("along the axes", DMat3::IDENTITY), ("across them", turned)] {
        for orientation in Orientation::ALL {
            let frame = Frame::of(&grid, orientation, Convention::Radiological);
            let mut times_ms: Vec<f64> = (0..25)
                .map(|i| {
                    let middle = DVec3::splat(100.0 + 3.3 * f64::from(i));
                    let (right, up) = (0.5 * (turn * frame.right), 0.5 * (turn * frame.up));
                    let origin = middle - 256.0 * (right - up);
                    let plane = Plane { origin_mm: origin, right_mm: right, down_mm: -up, size: [512; 2] };
                    let before = on_processor_ns(begun);
                    std::hint::black_box(draw(&volume, &plane, Filter::Linear, Window::of_range(-160.0, 240.0)));
                    (on_processor_ns(begun) - before) * 1e-6
                })
                .collect();
            times_ms.sort_by(f64::total_cmp);
            println!("{} {name}: median {:.1} ms, slowest {:.1} ms", orientation.name(), times_ms[12], times_ms[24]);
        }
    }
    Ok(())
}
