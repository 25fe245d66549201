//! Where a figure is seen from, and how it fills the page.

use fabrica_engine::scene::StyleTransferFunction;
use fabrica_engine::scene::{Camera, Object, Projection};
use fabrica_engine::spaces::Grid;
use fabrica_engine::volume::bricks::BRICK;
use fabrica_engine::volume::{Volume, Voxel};
use fabrica_engine::with_voxels;
use glam::DVec3;

use super::bridge;
use super::template::{CameraTemplate, Page, ProjectionName};

/// The eye's place for what has a depth: the patient's left, in front, 20° above.
const THREE_QUARTER: DVec3 = DVec3::new(-0.6, 0.72, 0.34);

/// What is thinner than this share of its next longer side is a sheet, and seen face-on.
const FLAT: f64 = 0.12;

/// Share of the frame that stays paper on either side of the object.
const MARGIN: f64 = 0.03;

/// A direction to look from and one that is up.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// From the object to the eye, a unit vector in RAS.
    pub from: DVec3,
    /// What is up in the picture.
    pub up: DVec3,
    /// Whether it looks at a sheet, face-on.
    pub is_of_sheet: bool,
}

impl View {
    /// Three quarters from the left and a little from above; a sheet is seen face-on, as atlases show its kind of slice:
    /// axial from below, coronal from the front, sagittal from the left.
    pub fn of(grid: &Grid) -> Self {
        let m = grid.world_from_index().matrix3;
        let axes = [m.x_axis, m.y_axis, m.z_axis];
        let extents: [f64; 3] = std::array::from_fn(|i| axes[i].length() * grid.dims()[i] as f64);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| extents[a].total_cmp(&extents[b]));
        let [thin, middle, long] = order;
        if extents[thin] > FLAT * extents[middle] {
            return Self { from: THREE_QUARTER.normalize(), up: DVec3::Z, is_of_sheet: false };
        }
        let normal = axes[middle].cross(axes[long]).normalize();
        let from = normal * towards(normal, [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z]);
        let is_axial = from.abs().z >= from.abs().max_element();
        let upright = if is_axial { DVec3::Y } else { DVec3::Z };
        // The slice's own edge, so that an oblique one stands straight on the page.
        let edge = [axes[middle], axes[long]].into_iter().map(DVec3::normalize);
        let edge = edge.max_by(|a, b| a.dot(upright).abs().total_cmp(&b.dot(upright).abs())).unwrap_or(upright);
        Self { from, up: edge * edge.dot(upright).signum(), is_of_sheet: true }
    }
}

/// The sign that turns `v` to the side of the one of `sides` that it follows best.
fn towards(v: DVec3, sides: [DVec3; 3]) -> f64 {
    let best = sides.into_iter().max_by(|a, b| a.dot(v).abs().total_cmp(&b.dot(v).abs()));
    best.map_or(1.0, |side| side.dot(v).signum())
}

/// A frame around an object.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// What the view's axis goes through, world mm.
    pub target_mm: DVec3,
    /// What the picture shows at the target from bottom to top, mm.
    pub height_mm: f64,
    /// Width of the picture over its height.
    pub aspect: f64,
}

impl Frame {
    /// The tightest frame, of an aspect between two limits, around balls of `radius_mm` at points in world mm (at least one), seen
    /// in perspective with the vertical field of view `fov_deg`.
    pub fn around(points: &[DVec3], radius_mm: f64, view: View, fov_deg: f64, aspects: (f64, f64)) -> Self {
        let middle = points.iter().fold(DVec3::ZERO, |sum, p| sum + *p / points.len() as f64);
        let axes = axes(view);
        // Right, up and towards the eye.
        let seen: Vec<DVec3> = points.iter().map(|p| axes.map(|a| a.dot(*p - middle)).into()).collect();
        let nearest = seen.iter().map(|p| p.z).fold(f64::NEG_INFINITY, f64::max) + radius_mm;
        let radius = seen.iter().map(|p| p.length()).fold(0.0, f64::max) + radius_mm;
        let half = (0.5 * fov_deg.to_radians()).tan();
        let (mut x, mut y, mut distance) = (0.0, 0.0, 2.0 * radius / half);
        let mut aspect = 1.0;
        // Each round centers what the last one sees and comes closer; the error shrinks by the object's depth over the
        // distance, a factor of four or more.
        for _ in 0..ROUNDS {
            let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
            for p in &seen {
                let nearness = 1.0 / (distance - p.z);
                for (i, at) in [p.x - x, p.y - y].into_iter().enumerate() {
                    low[i] = low[i].min((at - radius_mm) * nearness);
                    high[i] = high[i].max((at + radius_mm) * nearness);
                }
            }
            x += 0.5 * (low[0] + high[0]) * (distance - nearest);
            y += 0.5 * (low[1] + high[1]) * (distance - nearest);
            let [width, height] = [0, 1].map(|i| 0.5 * (high[i] - low[i]));
            aspect = (width / height).clamp(aspects.0, aspects.1);
            let filled = height.max(width / aspect) / (half * (1.0 - 2.0 * MARGIN));
            distance = nearest + (distance - nearest) * filled;
        }
        let target_mm = middle + x * axes[0] + y * axes[1];
        Self { target_mm, height_mm: 2.0 * half * distance, aspect }
    }
}

/// The view of before, moved so that the object, as large as it can be, fills the page; `reference` is what the camera's lengths
/// are relative to.
pub fn fit(camera: &CameraTemplate, page: &Page, object: &Object, reference: &Object) -> CameraTemplate {
    let (center, radius) = bridge::sphere(camera.relative_to, reference);
    let from = DVec3::from_array(camera.from).try_normalize().unwrap_or(DVec3::Y);
    let view = View { from, up: DVec3::from_array(camera.up), is_of_sheet: false };
    let aspect = page.width_mm / page.height_mm;
    // A parallel projection is seen from very far away.
    let fov_deg = match camera.projection {
        ProjectionName::Perspective => camera.fov_deg,
        ProjectionName::Orthographic => 0.1,
    };
    let reach = object.volume.grid.spacing_mm().max_element();
    let mut points = outline(object);
    for body in object.bodies() {
        let is_shown = body.regions.iter().any(|i| object.regions[*i].look.opacity > 0.0);
        if let Some(pose) = body.pose().filter(|_| is_shown) {
            let (low, high) = body.index_box(object);
            points.extend(object.volume.grid.box_corners_mm(low, high).map(|corner| pose.transform_point3(corner)));
        }
    }
    let frame = Frame::around(&points, reach, view, fov_deg, (aspect, aspect));
    CameraTemplate {
        height: frame.height_mm / radius,
        target: ((frame.target_mm - center) / radius).to_array(),
        ..camera.clone()
    }
}

/// Rounds after which a frame does not change any more.
const ROUNDS: usize = 12;

/// Right, up and towards the eye.
fn axes(view: View) -> [DVec3; 3] {
    let any = Projection::Orthographic { height_mm: 1.0 };
    match Camera::looking(DVec3::ZERO, -view.from, view.up, any) {
        Ok(camera) => [camera.right, camera.up, -camera.forward],
        Err(_) => [DVec3::X, DVec3::Z, DVec3::NEG_Y],
    }
}

/// Points in world mm whose hull is that of what an object shows, to a voxel; at least one. What is brighter than the dimmest value shown counts: surfaces lie between two voxels that may both be unseen.
pub fn outline(object: &Object) -> Vec<DVec3> {
    let volume = &object.volume;
    let threshold = dimmest_shown(object);
    let bricks = volume.bricks();
    let [nx, ny, nz] = bricks.dims;
    let ranges: Vec<(f64, f64)> = bricks
        .ranges
        .iter()
        .map(|&(a, b)| (volume.rescale.value(a), volume.rescale.value(b)))
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    // Which of a brick's voxels are transparent is not known: one that has some is not full.
    let is_opaque = volume.colors.as_ref().is_none_or(|colors| colors.iter().all(|c| c[3] > 0));
    let is_full = |x: usize, y: usize, z: usize| is_opaque && ranges[x + nx * (y + ny * z)].0 > threshold;
    let mut points = Vec::new();
    for (i, _) in ranges.iter().enumerate().filter(|(i, range)| range.1 > threshold && bricks.may_show(*i)) {
        let [x, y, z] = [i % nx, i / nx % ny, i / (nx * ny)];
        // The hull of six full neighbors contains what is between them.
        let is_inside = (1..nx - 1).contains(&x) && (1..ny - 1).contains(&y) && (1..nz - 1).contains(&z);
        if is_inside
            && is_full(x - 1, y, z)
            && is_full(x + 1, y, z)
            && is_full(x, y - 1, z)
            && is_full(x, y + 1, z)
            && is_full(x, y, z - 1)
            && is_full(x, y, z + 1)
        {
            continue;
        }
        add_row_ends(volume, [x, y, z], threshold, &mut points);
    }
    if points.is_empty() {
        let (low, high) = volume.grid.index_box();
        points.extend(volume.grid.box_corners_mm(low, high));
    }
    points
}

/// The data value above which an object's transfer function begins to show something.
fn dimmest_shown(object: &Object) -> f64 {
    let of_row = |row: StyleTransferFunction| match row.nodes.iter().position(|n| n.opacity > 0.0) {
        None => f64::INFINITY,
        Some(0) => f64::NEG_INFINITY,
        Some(i) => row.nodes[i - 1].value,
    };
    object.transfer_function.rows().map(of_row).fold(f64::INFINITY, f64::min)
}

/// Adds the first and the last voxel above `threshold` of each row of a brick.
fn add_row_ends(volume: &Volume, brick: [usize; 3], threshold: f64, points: &mut Vec<DVec3>) {
    let dims = volume.grid.dims();
    let from = brick.map(|b| b * BRICK);
    let to: [usize; 3] = std::array::from_fn(|i| (from[i] + BRICK).min(dims[i]));
    let world = volume.grid.world_from_index();
    with_voxels!(&volume.voxels, voxels => {
        for z in from[2]..to[2] {
            for y in from[1]..to[1] {
                let row = dims[0] * (y + dims[1] * z);
                let is_seen = |x: usize| volume.colors.as_ref().is_none_or(|colors| colors[row + x][3] > 0);
                let is_shown = |x: &usize| volume.rescale.value(voxels[row + x].to_f64()) > threshold && is_seen(*x);
                let ends = [(from[0]..to[0]).find(is_shown), (from[0]..to[0]).rfind(is_shown)];
                points.extend(ends.into_iter().flatten().map(|x| world.transform_point3(DVec3::new(x as f64, y as f64, z as f64))));
            }
        }
    });
}
