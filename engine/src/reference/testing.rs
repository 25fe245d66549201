//! What the reference's tests share: small volumes, grids and a style that shows its own normals.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::sample::Lattice;
use crate::image_out::Picture;
use crate::scene::{
    Background, Camera, Object, Projection, Quality, Scene, StyleTransferFunction, TransferFunctionNode,
};
use crate::spaces::Grid;
use crate::styles::{STYLE_SIZE, StyleImage, normal_from_uv};
use crate::volume::{Rescale, Volume, Voxels};

/// A field sampled at voxel centers (index space).
pub(crate) fn lattice(dims: [usize; 3], field: impl Fn(DVec3) -> f64) -> Lattice {
    let [nx, ny, _] = dims;
    let center = |i: usize| DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
    Lattice { dims, values: (0..dims.iter().product()).map(|i| field(center(i))).collect() }
}

/// Upright, anisotropic, turned, sheared and left-handed.
pub(crate) fn awkward_affines() -> [DAffine3; 5] {
    let turn = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-1.1);
    let scale = DMat3::from_diagonal(DVec3::new(0.5, 0.8, 1.25));
    let shear = DMat3::from_cols(DVec3::new(1.0, 0.1, 0.0), DVec3::new(0.3, 0.9, -0.2), DVec3::new(0.0, 0.25, 1.2));
    let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let offset = DVec3::new(10.0, -20.0, 30.0);
    [DMat3::IDENTITY, scale, turn * scale, shear, mirror * turn * shear]
        .map(|m| DAffine3 { matrix3: m, translation: offset })
}

/// A transfer function node.
pub(crate) fn node(value: f64, style: usize, opacity: f64) -> TransferFunctionNode {
    TransferFunctionNode { value, style, opacity }
}

/// An opaque style whose red and green tell n_x and n_y.
pub(crate) fn sphere_style() -> StyleImage {
    let texel = |i: usize| {
        let uv = [i % STYLE_SIZE, i / STYLE_SIZE].map(|k| (k as f64 + 0.5) / STYLE_SIZE as f64);
        let n = normal_from_uv(uv, STYLE_SIZE);
        [0.5 + 0.5 * n[0] as f32, 0.5 + 0.5 * n[1] as f32, 0.25, 1.0]
    };
    let pixels = (0..STYLE_SIZE * STYLE_SIZE).map(texel).collect();
    StyleImage::from_straight("sphere", &Picture { width: STYLE_SIZE, height: STYLE_SIZE, pixels }).unwrap()
}

/// A volume of f64 voxels from a field of *world* positions.
pub(crate) fn volume(dims: [usize; 3], affine: DAffine3, field: impl Fn(DVec3) -> f64) -> Volume {
    let values = lattice(dims, |p| field(affine.transform_point3(p))).values;
    Volume::new(Grid::new(dims, affine).unwrap(), Voxels::F64(values), Rescale::IDENTITY, "test").unwrap()
}

/// A scene with one object; opacities are those of 1 mm.
pub(crate) fn scene(
    volume: Volume,
    nodes: Vec<TransferFunctionNode>,
    styles: Vec<StyleImage>,
    camera: Camera,
) -> Scene {
    let transfer_function = StyleTransferFunction::new(nodes, 1.0);
    Scene {
        objects: vec![Object {
            volume: Arc::new(volume),
            transfer_function,
            regions: Vec::new(),
            lighting: None,
            gradient_scale_mm: 0.0,
            distances: Vec::new(),
            parts: Default::default(),
        }],
        styles: styles.into_iter().map(Arc::new).collect(),
        camera,
        background: Background::Transparent,
        quality: Quality::FINAL,
        page_height_mm: 25.4,
    }
}

/// A camera at `eye_mm` that looks at `target_mm`, S up.
pub(crate) fn looking_at(eye_mm: DVec3, target_mm: DVec3, projection: Projection) -> Camera {
    Camera::looking(eye_mm, target_mm - eye_mm, DVec3::Z, projection).unwrap()
}
