//! Volumes as scanners, simulations and segmentation tools make them, in small.

use std::sync::Arc;

use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::{Modality, Rescale, Volume, Voxels};
use glam::{DAffine3, DVec3};

/// A grid of 1 to 2 mm whose values are `value` of the place from the middle, in voxels, and a noise of -1 to 1.
fn volume(dims: [usize; 3], format: &str, value: impl Fn(DVec3, f64) -> f64) -> Volume {
    let middle = DVec3::from_array(dims.map(|n| 0.5 * (n as f64 - 1.0)));
    let voxel = |i: usize| {
        let p = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])].map(|n| n as f64);
        // Weyl's sequence has no pattern that matters here.
        value(DVec3::from_array(p) - middle, 2.0 * (i as f64 * 0.618_033_988_749_894_9).fract() - 1.0) as f32
    };
    let voxels = Voxels::F32((0..dims.iter().product()).map(voxel).collect());
    let grid = Grid::new(dims, DAffine3::from_scale(DVec3::new(1.0, 1.5, 2.0))).unwrap();
    Volume::new(grid, voxels, Rescale::IDENTITY, format).unwrap()
}

/// Tissue with a shell of bone, in air; HU.
pub fn ct(modality: Modality) -> Arc<Volume> {
    let mut ct = volume([40; 3], "NIfTI-1", |p, noise| match p.length() {
        r if r > 16.0 => -1000.0 + 15.0 * noise,
        r if (9.0..12.0).contains(&r) => 900.0 + 300.0 * noise,
        _ => 40.0 + 60.0 * noise,
    });
    ct.modality = modality;
    Arc::new(ct)
}

/// Tissue around a heart full of contrast medium, in air; HU.
pub fn contrast() -> Arc<Volume> {
    Arc::new(volume([40; 3], "NIfTI-1", |p, noise| match p.length() {
        r if r > 16.0 => -1000.0 + 15.0 * noise,
        r if r < 9.0 => 430.0 + 60.0 * noise,
        _ => 40.0 + 90.0 * noise,
    }))
}

/// Magnetic resonance of something cut out.
pub fn organ() -> Arc<Volume> {
    Arc::new(volume([48; 3], "NIfTI-1", |p, noise| if p.length() > 17.0 { 0.0 } else { 600.0 + 200.0 * noise }))
}

/// Magnetic resonance of something that goes on at both ends.
pub fn body(modality: Modality) -> Arc<Volume> {
    let mut body =
        volume(
            [48; 3],
            "NRRD",
            |p, noise| {
                if p.truncate().length() > 18.0 { 20.0 + 20.0 * noise } else { 600.0 + 200.0 * noise }
            },
        );
    body.modality = modality;
    Arc::new(body)
}

/// One material from another kind of scanner.
pub fn casting() -> Arc<Volume> {
    Arc::new(volume([32; 3], "raw", |p, noise| if p.length() > 12.0 { 5.0 * noise } else { 140.0 + 30.0 * noise }))
}

/// The same with a denser core.
pub fn inlay() -> Arc<Volume> {
    Arc::new(volume([32; 3], "raw", |p, noise| match p.length() {
        r if r > 12.0 => 5.0 * noise,
        r if r < 5.0 => 230.0 + 10.0 * noise,
        _ => 140.0 + 30.0 * noise,
    }))
}

/// Many structures, in blocks of 8 voxels.
pub fn labels() -> Arc<Volume> {
    Arc::new(volume([48; 3], "NIfTI-1", |p, _| {
        let block = (p / 8.0).floor() + 3.0;
        if p.length() > 20.0 { 0.0 } else { 1.0 + block.x + 6.0 * block.y + 36.0 * block.z }
    }))
}

/// One structure.
pub fn mask() -> Arc<Volume> {
    Arc::new(volume([24; 3], "NIfTI-1", |p, _| f64::from(p.length() < 8.0)))
}

/// A bar of one material that is as long as its volume.
pub fn rod(dims: [usize; 3]) -> Arc<Volume> {
    Arc::new(volume(dims, "raw", |p, noise| {
        let inside = p.abs().cmplt(DVec3::from_array(dims.map(|n| 0.5 * n as f64 - 1.0)));
        // A sheet of three voxels has no margin across.
        if inside.x && inside.y { 140.0 + 30.0 * noise } else { 5.0 * noise }
    }))
}

/// One slice of a body, placed by `affine`.
pub fn slice(affine: DAffine3) -> Arc<Volume> {
    let mut slice = volume([32, 32, 1], "NIfTI-1", |p, noise| {
        if p.length() > 12.0 { 5.0 + 5.0 * noise } else { 300.0 - 10.0 * p.length() + 20.0 * noise }
    });
    slice.grid = Grid::new([32, 32, 1], affine).unwrap();
    Arc::new(slice)
}

/// Values of both signs within zeros.
pub fn signed() -> Arc<Volume> {
    Arc::new(volume([40; 3], "NIfTI-1", |p, noise| if p.length() > 15.0 { 0.0 } else { noise }))
}

/// A volume of the colors that `color` gives to places from the middle, in voxels.
fn colors(color: impl Fn(DVec3) -> [u8; 4]) -> Arc<Volume> {
    let dims = [32; 3];
    let place = |i: usize| [i % 32, i / 32 % 32, i / 1024].map(|n| n as f64 - 15.5);
    let colors = (0..32 * 32 * 32).map(|i| color(DVec3::from_array(place(i)))).collect();
    Arc::new(Volume::from_colors(Grid::new(dims, DAffine3::IDENTITY).unwrap(), colors, "NIfTI-1").unwrap())
}

/// Photographs of slices, on a black that is not quite one.
pub fn photograph() -> Arc<Volume> {
    colors(|p| match p.length() {
        r if r > 13.0 => [(p.x.abs() * 0.3) as u8, 3, 4, 255],
        r if r > 7.0 => [190, 120, 90, 255],
        _ => [130, 40, 30, 255],
    })
}

/// The colors of an atlas' structures, one of them black, and nothing around.
pub fn atlas() -> Arc<Volume> {
    colors(|p| {
        if p.length() > 12.0 {
            [90, 200, 90, 0]
        } else if p.x > 0.0 {
            [60, 90, 200, 255]
        } else {
            [0, 0, 0, 255]
        }
    })
}
