//! Small volumes and scenes with known content.

use std::sync::Arc;

use fabrica_engine::scene::{
    Background, Camera, Look, Meetings, Moved, Object, Projection, Quality, Region, Scene, StyleTransferFunction,
    TransferFunctionNode,
};
use fabrica_engine::selection::{BrickPool, Selection};
use fabrica_engine::spaces::Grid;
use fabrica_engine::styles::{StyleImage, StyleLibrary};
use fabrica_engine::volume::{Rescale, Volume, Voxels};
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// A volume of int16 data values given by a function of the world position in mm.
///
/// # Panics
/// If `world_from_index` is no usable affine.
pub fn volume(dims: [usize; 3], world_from_index: DAffine3, value: impl Fn(DVec3) -> f64) -> Arc<Volume> {
    let grid = Grid::new(dims, world_from_index).unwrap_or_else(|e| panic!("{e}"));
    let mut voxels = Vec::with_capacity(grid.num_voxels());
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let index = DVec3::new(x as f64, y as f64, z as f64);
                voxels.push(value(world_from_index.transform_point3(index)).round() as i16);
            }
        }
    }
    let made = Volume::new(grid, Voxels::I16(voxels), Rescale::IDENTITY, "phantom");
    Arc::new(made.unwrap_or_else(|e| panic!("{e}")))
}

/// An upright grid of cubes of `spacing` mm around the world's origin.
pub fn centered(dims: [usize; 3], spacing: DVec3) -> DAffine3 {
    let half = DVec3::from_array(dims.map(|n| (n - 1) as f64)) * 0.5;
    DAffine3::from_mat3_translation(DMat3::from_diagonal(spacing), -half * spacing)
}

/// A smooth bump of 1000 at `center`, falling to 0 at `radius`.
pub fn bump(p: DVec3, center: DVec3, radius: f64) -> f64 {
    1000.0 * (1.0 - p.distance(center) / radius).max(0.0)
}

/// The standard phantom: a lumpy, lopsided body without symmetry, 32³ voxels of 1 mm, values 0 to about 1000.
pub fn lumpy() -> Arc<Volume> {
    volume([32, 32, 32], centered([32, 32, 32], DVec3::ONE), |p| {
        let a = bump(p, DVec3::new(-3.0, 1.0, 0.0), 15.0);
        let b = bump(p, DVec3::new(7.0, -4.0, 5.0), 9.0);
        let c = bump(p, DVec3::new(2.0, 8.0, -8.0), 7.0);
        a.max(b).max(c) + 60.0 * (p.x * 0.9).sin() * (p.y * 0.7).cos() * (p.z * 0.8).sin()
    })
}

/// Axes that are neither square nor of one length.
pub fn sheared() -> DMat3 {
    DMat3::from_cols(DVec3::new(0.9, 0.1, 0.0), DVec3::new(0.2, 0.8, 0.35), DVec3::new(-0.1, 0.0, 2.0))
}

/// Moved, turned, and stretched.
pub fn pose() -> DAffine3 {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 0.5).normalize(), 0.6);
    DAffine3::from_scale_rotation_translation(DVec3::new(1.2, 0.9, 1.1), turn, DVec3::new(3.0, 9.0, 4.0))
}

/// Takes a region of the scene's object elsewhere ([`pose`]); its ghost has the look of region `ghost`, at 0.4 of its opacity.
pub fn take_away(scene: &mut Scene, region: usize, ghost: usize) {
    let regions = &mut scene.objects[0].regions;
    let ghost = Look { opacity: 0.4, ..regions[ghost].look.clone() };
    regions[region].moved = Some(Moved { pose: pose(), ghost, meetings: Meetings::default() });
}

/// A bump on grids that are not made of upright cubes, each with its name.
pub fn awkward() -> impl Iterator<Item = (&'static str, Arc<Volume>)> {
    let grids = [
        ("anisotropic", [32, 32, 8], DMat3::from_diagonal(DVec3::new(0.8, 0.9, 3.5))),
        ("left-handed", [30, 31, 32], DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))),
        ("sheared", [30, 28, 16], sheared()),
    ];
    grids.into_iter().map(|(name, dims, m)| {
        let half = DVec3::from_array(dims.map(|n| (n - 1) as f64)) * 0.5;
        let affine = DAffine3::from_mat3_translation(m, -(m * half));
        (name, volume(dims, affine, |p| bump(p, DVec3::new(-3.0, 1.0, 0.0), 13.0)))
    })
}

/// A ball of colors, 24³ voxels of 1 mm, lighter towards its middle, with an alpha for each voxel's indices.
///
/// # Panics
/// Never: the grid is a usable one.
pub fn colored(alpha: impl Fn(DVec3) -> u8) -> Arc<Volume> {
    let dims = [24; 3];
    let grid = Grid::new(dims, centered(dims, DVec3::ONE)).unwrap_or_else(|e| panic!("{e}"));
    let color = |i: usize| {
        let p = DVec3::new((i % 24) as f64, (i / 24 % 24) as f64, (i / 576) as f64);
        let light = (1.2 - p.distance(DVec3::splat(11.5)) / 11.0).clamp(0.0, 1.0);
        [(255.0 * light) as u8, (light * (60.0 + 8.0 * p.x)) as u8, (light * (250.0 - 9.0 * p.z)) as u8, alpha(p)]
    };
    let made = Volume::from_colors(grid, (0..grid.num_voxels()).map(color).collect(), "phantom");
    Arc::new(made.unwrap_or_else(|e| panic!("{e}")))
}

/// A style of the built-in library.
///
/// # Panics
/// If there is none of that name.
pub fn style(name: &str) -> Arc<StyleImage> {
    StyleLibrary::embedded().get(name).unwrap_or_else(|e| panic!("{e}"))
}

/// A scene of one volume: `nodes` are (value, style, opacity) of 1 mm, seen from the front at a field of view of 20°
/// that holds the volume's bounding sphere.
///
/// # Panics
/// If a style does not exist.
pub fn scene(volume: &Arc<Volume>, nodes: &[(f64, &str, f64)], quality: Quality) -> Scene {
    let mut styles: Vec<Arc<StyleImage>> = Vec::new();
    let nodes = nodes
        .iter()
        .map(|&(value, name, opacity)| {
            let position = styles.iter().position(|s| s.name == name).unwrap_or_else(|| {
                styles.push(style(name));
                styles.len() - 1
            });
            TransferFunctionNode { value, style: position, opacity }
        })
        .collect();
    Scene {
        objects: vec![Object {
            volume: volume.clone(),
            transfer_function: StyleTransferFunction::new(nodes, 1.0),
            regions: Vec::new(),
            lighting: None,
            gradient_scale_mm: volume.grid.spacing_mm().min_element(),
            distances: Vec::new(),
            parts: Default::default(),
        }],
        styles,
        camera: camera(volume, DVec3::new(0.3, 1.0, 0.2), Projection::Perspective { fov_y_deg: 20.0 }),
        background: Background::Transparent,
        quality,
        page_height_mm: 25.4,
    }
}

/// A camera in the direction `from` of the volume that holds its bounding sphere, S up.
///
/// # Panics
/// If `from` is 0.
pub fn camera(volume: &Volume, from: DVec3, projection: Projection) -> Camera {
    let (low, high) = volume.grid.index_box();
    let corners = volume.grid.box_corners_mm(low, high);
    let center = corners.iter().sum::<DVec3>() / 8.0;
    let radius = corners.iter().map(|c| c.distance(center)).fold(0.0, f64::max);
    let distance = match projection {
        Projection::Perspective { fov_y_deg } => radius / (0.5 * fov_y_deg.to_radians()).sin(),
        Projection::Orthographic { .. } => 2.0 * radius,
    };
    let from = from.normalize();
    Camera::looking(center + distance * from, -from, DVec3::Z, projection).unwrap_or_else(|e| panic!("{e}"))
}

/// Memberships that a function of the world position in mm gives.
pub fn selection(grid: &Grid, pool: &Arc<BrickPool>, f: impl Fn(DVec3) -> f64 + Sync) -> Selection {
    let mut selection = Selection::empty(*grid, pool);
    let world = grid.world_from_index();
    let at = |[x, y, z]: [usize; 3]| world.transform_point3(DVec3::new(x as f64, y as f64, z as f64));
    selection.change(grid.dims().map(|n| [0, n]), |voxel, _| (f(at(voxel)).clamp(0.0, 1.0) * 255.0).round() as u8);
    selection
}

/// 1 in a ball, 0 outside, with an edge of two millimeters.
pub fn ball(p: DVec3, center: DVec3, radius: f64) -> f64 {
    0.5 + 0.5 * (radius - p.distance(center))
}

/// A transfer function of these nodes, whose styles go to the scene's; "white" is one without shading.
///
/// # Panics
/// If a style does not exist.
pub fn function(scene: &mut Scene, nodes: &[(f64, &str, f64)], reference_length_mm: f64) -> StyleTransferFunction {
    let nodes = nodes.iter().map(|&(value, name, opacity)| {
        let position = scene.styles.iter().position(|s| s.name == name).unwrap_or_else(|| {
            let white = || Arc::new(StyleImage::flat("white", [1.0; 4]));
            scene.styles.push(if name == "white" { white() } else { style(name) });
            scene.styles.len() - 1
        });
        TransferFunctionNode { value, style: position, opacity }
    });
    StyleTransferFunction::new(nodes.collect(), reference_length_mm)
}

/// Adds a region to the scene's object.
///
/// # Panics
/// If a style does not exist.
pub fn add(
    scene: &mut Scene,
    selection: Selection,
    nodes: &[(f64, &str, f64)],
    d0: f64,
    tint: Option<[f32; 3]>,
    opacity: f64,
) {
    let transfer_function = function(scene, nodes, d0);
    let name = format!("region {}", scene.objects[0].regions.len() + 1);
    scene.objects[0].regions.push(Region {
        name,
        selection,
        look: Look { transfer_function, tint, opacity },
        moved: None,
    });
}
