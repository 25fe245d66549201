//! A ray through an object: what every piece of it adds to the pixel, and which part of the object that is.

use std::cell::RefCell;

use glam::{DAffine3, DMat3, DVec3};

use super::SPENT;
use super::field::Field;
use crate::reference::opacity::opacity_correct;
use crate::reference::piece::classify_piece;
use crate::reference::ray::{Ray, Samples, intersect_box};
use crate::reference::region::{end_face, joined, where_flat};
use crate::reference::sample::trilinear;
use crate::reference::style::{
    Face, RayFrame, at_node, bend, face_normal, ray_frame, shade, steepness, style_level, style_normal, surface_normal,
};
use crate::scene::across::Between;
use crate::scene::{Across, Axis, Body, Object, Role, Scene, StyleTransferFunction};
use crate::volume::bricks::BRICK;

/// Length of a piece of the ray, in voxels.
const STEP_VOXELS: f64 = 0.5;
/// Mean opacity of a style's picture from which on none of it is clear: rounding in the means is below.
const SOLID: f32 = 1.0 - 1e-6;

/// What a piece of the ray adds to the pixel.
#[derive(Default)]
pub struct Seen {
    /// Opacity, as far as what lies before it lets it through.
    pub opacity: f64,
    /// What it consists of.
    pub shown: Vec<Shown>,
}

/// What one region, or the background, shows of a piece.
pub struct Shown {
    /// Which part of the object's: at rest, a ghost, or moved.
    pub part: usize,
    /// Which region of it; none: the background.
    pub region: Option<usize>,
    /// Where it is seen, mm along the ray.
    pub t: f64,
    /// Row of its transfer function.
    pub row: usize,
    /// Node coordinate in it.
    pub node: f64,
    /// Its part of the piece's opacity.
    pub opacity: f64,
    /// Both ends of the piece, mm along the ray.
    ends: [f64; 2],
}

/// A row of a look at a piece of the ray, and what it would show of it if all of the place were its own.
struct Classed {
    region: Option<usize>,
    row: usize,
    /// Its share of the place.
    share: f64,
    /// Where it is seen, mm along the ray.
    t: f64,
    node: f64,
    /// α_u of one of its reference lengths.
    opacity: f64,
    /// That of whichever row of its look shows most.
    most: f64,
}

/// How a place is shared out: the background's share, and regions'.
type Shares = Vec<(Option<usize>, f64)>;

/// The bricks around a place, and what regions have in them.
#[derive(Default)]
struct Nearby {
    /// First and last along each axis; none before anything was asked for.
    around: Option<[[usize; 2]; 3]>,
    /// The regions that have voxels in them.
    regions: Vec<usize>,
    /// How every place in them is shared out, if all are alike.
    even: Option<Shares>,
}

/// A body (docs/rendering.md §9) along the ray.
struct Part<'a> {
    body: Body<'a>,
    /// Which regions it shows; for all of them: an object without moves has one part that shows everything.
    own: Option<Vec<bool>>,
    /// The ray in the volume's index space, as the body lies.
    origin: DVec3,
    direction: DVec3,
    /// What takes a plane's normal at rest to that of the plane as it lies, but for its length.
    normal: Option<DMat3>,
    /// Smallest distance of neighboring voxels as they lie, mm.
    spacing_mm: f64,
    /// Where the ray is in its box, mm.
    span: Option<(f64, f64)>,
    /// What was last asked for: successive places are in the same bricks.
    nearby: RefCell<Nearby>,
}

impl<'a> Part<'a> {
    fn new(object: &Object, body: Body<'a>, ray: &Ray, is_alone: bool) -> Self {
        let grid = &object.volume.grid;
        let rest = body.pose().map(DAffine3::inverse);
        let index_from_world = rest.map_or(grid.index_from_world(), |rest| grid.index_from_world() * rest);
        let (origin, direction) =
            (index_from_world.transform_point3(ray.origin_mm), index_from_world.matrix3 * ray.direction);
        let spacing_mm = body.pose().map_or(grid.spacing_mm().min_element(), |pose| {
            let axes = pose.matrix3 * grid.world_from_index().matrix3;
            [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::length).into_iter().fold(f64::INFINITY, f64::min)
        });
        let (low, high) = body.index_box(object);
        let own = (!is_alone).then(|| {
            let mut own = vec![false; object.regions.len()];
            body.regions.iter().for_each(|i| own[*i] = true);
            own
        });
        Self {
            span: intersect_box(origin, direction, ray.t_min, low, high),
            normal: rest.map(|rest| rest.matrix3.transpose()),
            nearby: RefCell::default(),
            body,
            own,
            origin,
            direction,
            spacing_mm,
        }
    }

    /// Index position at `t` mm.
    fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }

    /// A direction of the volume at rest, with its length, as the body lies.
    fn turned(&self, direction: DVec3) -> DVec3 {
        self.normal.map_or(direction, |m| (m * direction).normalize_or_zero() * direction.length())
    }

    fn turned_face(&self, face: Face) -> Face {
        Face { normal: self.turned(face.normal), ..face }
    }

    /// Whether it shows a region or, for none, the background.
    fn shows(&self, region: Option<usize>) -> bool {
        match (region, &self.own) {
            (_, None) => true,
            (None, _) => self.body.role == Role::Rest,
            (Some(i), Some(own)) => own[i],
        }
    }

    /// The transfer function and the factor of opacity of a region or, for none, of the background. What rests beside it counts as
    /// well, shown or not: it makes no end.
    fn look<'o>(&self, object: &'o Object, region: Option<usize>) -> (&'o StyleTransferFunction, f64) {
        let is_moved = matches!(self.body.role, Role::Moved(_));
        let hidden = is_moved && !self.shows(region);
        let (function, factor) = match region.map(|i| &object.regions[i]) {
            None => (&object.transfer_function, 1.0),
            Some(region) => {
                let look = region.moved().filter(|_| !is_moved).map_or(&region.look, |moved| &moved.ghost);
                (&look.transfer_function, look.opacity)
            }
        };
        (function, if hidden { 0.0 } else { factor })
    }

    /// How the index position `p` is shared out: the background first, and every region that has voxels within one and a half
    /// voxels around, in the object's order.
    fn shares(&self, object: &Object, p: DVec3) -> Shares {
        if object.regions.is_empty() {
            return vec![(None, 1.0)];
        }
        let dims = object.volume.grid.dims();
        self.look_around(object, p);
        let nearby = self.nearby.borrow();
        if let Some(even) = &nearby.even {
            return even.clone();
        }
        let membership = |i: &usize| {
            let selection = &object.regions[*i].selection;
            trilinear(dims, p, |x, y, z| f64::from(selection.get([x, y, z])) / 255.0)
        };
        let wanted: Vec<f64> = nearby.regions.iter().map(membership).collect();
        shared_out(&nearby.regions, &wanted)
    }

    /// Finds what is near the index position `p`.
    fn look_around(&self, object: &Object, p: DVec3) {
        let dims = object.volume.grid.dims();
        let around = std::array::from_fn(|axis| {
            let voxel = |x: f64| (x.max(0.0) as usize).min(dims[axis] - 1);
            [voxel(p[axis] - 1.0) / BRICK, voxel(p[axis] + 2.0) / BRICK]
        });
        let mut nearby = self.nearby.borrow_mut();
        if nearby.around == Some(around) {
            return;
        }
        let [xs, ys, zs] = around.map(|[first, last]| first..=last);
        let places: Vec<[usize; 3]> = zs
            .flat_map(|z| ys.clone().map(move |y| (y, z)))
            .flat_map(|(y, z)| xs.clone().map(move |x| [x, y, z]))
            .collect();
        let has_voxels = |i: &usize| {
            let selection = &object.regions[*i].selection;
            places.iter().any(|place| !selection.brick(*place).is_empty())
        };
        let regions: Vec<usize> = (0..object.regions.len()).filter(has_voxels).collect();
        // The one membership that a region has in all of the bricks, if it has one.
        let even = |i: &usize| {
            let selection = &object.regions[*i].selection;
            let [low, high] = selection.brick(places[0]).range();
            let is_even = low == high && places[1..].iter().all(|place| selection.brick(*place).range() == [low; 2]);
            is_even.then_some(f64::from(low) / 255.0)
        };
        let wanted: Option<Vec<f64>> = regions.iter().map(even).collect();
        *nearby = Nearby { around: Some(around), even: wanted.map(|wanted| shared_out(&regions, &wanted)), regions };
    }

    /// Whether nothing that it shows can end near the index position `p` because a region does: all have the same share around it.
    fn is_even(&self, object: &Object, p: DVec3) -> bool {
        self.look_around(object, p);
        self.nearby.borrow().even.is_some()
    }
}

/// Regions that want more of a place than there is get their shares, and the background what they leave.
fn shared_out(regions: &[usize], wanted: &[f64]) -> Shares {
    let sum: f64 = wanted.iter().sum();
    let regions = regions.iter().zip(wanted).map(|(i, f)| (Some(*i), f / sum.max(1.0)));
    std::iter::once((None, (1.0 - sum).max(0.0))).chain(regions).collect()
}

/// One ray through an object.
pub struct Line<'a> {
    scene: &'a Scene,
    object: &'a Object,
    field: Field<'a>,
    parts: Vec<Part<'a>>,
    image_height: u32,
    /// The ray in the world.
    pub ray: Ray,
    frame: RayFrame,
    /// d₀ of the object, mm.
    reference_length_mm: f64,
    /// Whether a style is opaque wherever it is looked at, of each.
    is_solid: Vec<bool>,
}

impl<'a> Line<'a> {
    /// `image_height`: pixels.
    pub fn new(scene: &'a Scene, object: &'a Object, image_height: u32, ray: Ray) -> Self {
        let bodies = object.bodies();
        let is_alone = bodies.len() == 1 && object.regions.iter().all(|region| region.moved().is_none());
        let is_solid = |style: &crate::styles::StyleImage| {
            style.mips.last().and_then(|mip| mip.first()).is_some_and(|mean| mean[3] >= SOLID)
        };
        Self {
            scene,
            object,
            field: Field::of(object),
            parts: bodies.into_iter().map(|body| Part::new(object, body, &ray, is_alone)).collect(),
            image_height,
            frame: ray_frame(&scene.camera, ray.direction),
            ray,
            reference_length_mm: object.reference_length_mm(),
            is_solid: scene.styles.iter().map(|style| is_solid(style)).collect(),
        }
    }

    /// Where something that is shown is in the volume as it was read, world mm.
    pub fn rest_mm(&self, of: &Shown) -> DVec3 {
        self.object.volume.grid.world_from_index().transform_point3(self.parts[of.part].at(of.t))
    }

    /// The data value of something that is shown.
    pub fn value(&self, of: &Shown) -> f64 {
        self.field.value(self.parts[of.part].at(of.t))
    }

    /// Whether it is where a region was that is moved.
    pub fn is_ghost(&self, of: &Shown) -> bool {
        let is_moved = |i: usize| self.object.regions[i].moved().is_some();
        of.region.is_some_and(is_moved) && !matches!(self.parts[of.part].body.role, Role::Moved(_))
    }

    /// ‖ĝ‖ of something that is shown, or what a face makes of it.
    pub fn steepness(&self, of: &Shown) -> f64 {
        let part = &self.parts[of.part];
        let values = of.ends.map(|t| self.field.value(part.at(t)));
        let classed = self.classify_all(part, of.ends, values);
        let gradient = self.gradient(part, of.t);
        steepness(gradient, self.face(part, of.t, self.cut(part, &classed, of.ends)))
    }

    /// The stretches of the ray that are in the same parts throughout, front to back: in pieces, and which parts those are.
    fn stretches(&self) -> Vec<(Samples, Vec<usize>)> {
        let spans: Vec<Option<(f64, f64)>> = self.parts.iter().map(|part| part.span).collect();
        let mut ends: Vec<f64> = spans.iter().flatten().flat_map(|(t0, t1)| [*t0, *t1]).collect();
        ends.sort_by(f64::total_cmp);
        let between = |pair: &[f64]| {
            let (t0, t1) = (pair[0], pair[1]);
            let middle = t0.midpoint(t1);
            let is_here = |i: &usize| spans[*i].is_some_and(|(near, far)| near < middle && middle < far);
            let here: Vec<usize> = (0..spans.len()).filter(is_here).collect();
            let delta = |i: &usize| STEP_VOXELS / self.parts[*i].direction.length();
            let delta_mm = here.iter().map(delta).fold(f64::INFINITY, f64::min);
            let count = ((t1 - t0) / delta_mm).ceil() as u64;
            (!here.is_empty() && t0 < t1).then_some((Samples { t0, t1, delta_mm, count }, here))
        };
        ends.windows(2).filter_map(between).collect()
    }

    /// What every piece of the ray adds, front to back, until nothing shows through.
    pub fn march(&self) -> Vec<Seen> {
        let mut seen = Vec::new();
        let mut clear = 1.0;
        for (pieces, here) in self.stretches() {
            let value = |i: &usize, t: f64| self.field.value(self.parts[*i].at(t));
            let mut fronts: Vec<f64> = here.iter().map(|i| value(i, pieces.t0)).collect();
            for k in 0..pieces.count {
                let (start, end) = pieces.piece(k);
                let backs: Vec<f64> = here.iter().map(|i| value(i, end)).collect();
                let mut piece = self.see(&here, [start, end], &fronts, &backs);
                piece.opacity *= clear;
                piece.shown.iter_mut().for_each(|s| s.opacity *= clear);
                clear -= piece.opacity;
                seen.push(piece);
                if clear < SPENT {
                    return seen;
                }
                fronts = backs;
            }
        }
        seen
    }

    /// Opacities of a piece between two places (mm) with these values at both ends for each of the parts that are there, whole and
    /// in what it consists of.
    fn see(&self, here: &[usize], ends: [f64; 2], fronts: &[f64], backs: &[f64]) -> Seen {
        let mut shown: Vec<Shown> = Vec::new();
        // What rests shares out the place and adds up; what was moved is united with it (eq. 2.5).
        let (mut at_rest, mut most) = (0.0f64, 0.0f64);
        for (n, i) in here.iter().enumerate() {
            let part = &self.parts[*i];
            let classed = self.classify_all(part, ends, [fronts[n], backs[n]]);
            let is_seen = |c: &&Classed| c.share > 0.0 && c.opacity > 0.0 && part.shows(c.region);
            let solid = classed.iter().filter(is_seen).all(|c| self.is_solid(part, c));
            let cut = if solid { None } else { Some(self.cut(part, &classed, ends)) };
            let before = shown.len();
            shown.extend(classed.iter().filter(is_seen).map(|c| self.appearance(*i, c, cut, ends)));
            let alpha: f64 = shown[before..].iter().map(|s| s.opacity).sum();
            match part.body.role {
                Role::Moved(_) => most = most.max(alpha),
                Role::Rest | Role::Ghost => at_rest += alpha,
            }
        }
        let alpha = at_rest.min(1.0).max(most).min(1.0);
        let opacity = opacity_correct(alpha, (ends[1] - ends[0]) / self.reference_length_mm);
        // Each has as much of it as it has of the color (eq. 2.4).
        let sum: f64 = shown.iter().map(|s| s.opacity).sum();
        if sum > 0.0 {
            shown.iter_mut().for_each(|s| s.opacity *= opacity / sum);
        }
        Seen { opacity, shown }
    }

    /// What all looks around make of a piece; none of them where nothing shows whatever the shares.
    fn classify_all(&self, part: &Part<'a>, ends: [f64; 2], values: [f64; 2]) -> Vec<Classed> {
        let middle = part.at(0.5 * (ends[0] + ends[1]));
        let shares = part.shares(self.object, middle);
        let mut classed = Vec::with_capacity(shares.len());
        for (region, share) in shares {
            let (function, factor) = part.look(self.object, region);
            let shows = |row: &StyleTransferFunction| {
                factor * row.max_opacity(values[0].min(values[1]), values[0].max(values[1])) > 0.0
            };
            match &function.across {
                Some(across) if share > 0.0 && shows(function) => {
                    let Between { lower, upper, weight } = across.between(self.second_coordinate(part, across, middle));
                    let rows: Vec<_> =
                        function.rows().map(|row| self.classify(&row, shows(&row), ends, values)).collect();
                    let most = rows.iter().map(|row| row.0).fold(0.0, f64::max);
                    for (row, of_row) in [(lower, 1.0 - weight), (upper, weight)] {
                        let (opacity, t, node) = rows[row];
                        classed.push(Classed { region, row, share: share * of_row, t, node, opacity, most });
                    }
                }
                _ => {
                    // The quadrature is for what shows something.
                    let (opacity, t, node) = self.classify(function, shows(function), ends, values);
                    classed.push(Classed { region, row: 0, share, t, node, opacity, most: opacity });
                }
            }
        }
        classed
    }

    /// Where a place (index space) is on the second coordinate of a function.
    fn second_coordinate(&self, part: &Part<'a>, across: &Across, p: DVec3) -> f64 {
        match across.axis {
            Axis::Even(place) => place,
            Axis::Edge => self.gradient_at(part, p).length().min(1.0),
            Axis::Distance(field) => {
                let field = &self.object.distances[field];
                let [nx, ny, _] = field.dims();
                let cell = (p + 0.5) / DVec3::from_array(field.voxels().map(|n| n as f64)) - 0.5;
                trilinear(field.dims(), cell, |x, y, z| field.values()[x + nx * (y + ny * z)].to_f64())
            }
        }
    }

    /// What a row makes of the piece between two places (mm) with two values, if anything: opacity of one of its reference lengths,
    /// where it is seen (mm), and node coordinate.
    fn classify(
        &self,
        row: &StyleTransferFunction,
        shows: bool,
        [start, end]: [f64; 2],
        [front, back]: [f64; 2],
    ) -> (f64, f64, f64) {
        if !shows {
            return (0.0, start, 0.0);
        }
        let found = classify_piece(row, front, back, (end - start) / row.reference_length_mm);
        (-(-found.extinction).exp_m1(), start + found.middle * (end - start), found.node)
    }

    /// Whether all styles that are seen there are opaque: its normal does not matter then.
    fn is_solid(&self, part: &Part<'a>, of: &Classed) -> bool {
        let class = at_node(&part.look(self.object, of.region).0.row(of.row), of.node, of.opacity);
        class.styles.iter().all(|style| self.is_solid[*style])
    }

    /// The face that regions make at the middle of a piece, as the part lies, where the data have none of their own.
    fn cut(&self, part: &Part<'a>, classed: &[Classed], [start, end]: [f64; 2]) -> Face {
        let none = Face { normal: DVec3::ZERO, weight: 0.0 };
        let shows = |c: &Classed| part.look(self.object, c.region).1 * c.most;
        let middle = 0.5 * (start + end);
        let is_alike = classed.windows(2).all(|pair| shows(&pair[0]) == shows(&pair[1]));
        if is_alike || part.is_even(self.object, part.at(middle)) {
            return none;
        }
        let found: Vec<(Option<usize>, f64)> = classed.iter().map(|c| (c.region, shows(c))).collect();
        let of = |region: Option<usize>| found.iter().find(|f| f.0 == region).map_or(0.0, |f| f.1);
        let shown = |p: DVec3| part.shares(self.object, p).iter().map(|(region, share)| share * of(*region)).sum();
        let to_world = self.object.volume.grid.world_gradient_from_index();
        let cut = part.turned_face(end_face(shown, part.at(middle), to_world));
        // What does not end here has no face whatever the gradient, which is long in the making.
        if cut.weight > 0.0 { where_flat(cut, self.gradient(part, middle).length()) } else { none }
    }

    /// ĝ at `t`, as the part lies.
    fn gradient(&self, part: &Part<'a>, t: f64) -> DVec3 {
        self.gradient_at(part, part.at(t))
    }

    /// ĝ at an index position, as the part lies.
    fn gradient_at(&self, part: &Part<'a>, p: DVec3) -> DVec3 {
        let volume = &self.object.volume;
        let to_world = volume.grid.world_gradient_from_index();
        let sigma = DVec3::splat(self.object.gradient_scale_mm) / volume.grid.spacing_mm();
        part.turned(self.field.gradient(p, sigma, to_world) / volume.gradient_max())
    }

    /// The face at `t` of the volume and of regions, as the part lies.
    fn face(&self, part: &Part<'a>, t: f64, cut: Face) -> Face {
        joined(part.turned_face(face_normal(&self.object.volume.grid, part.at(t))), cut)
    }

    /// A look's share, w α, of one reference length of the object. `cut`: the face that regions make; none where all styles are
    /// opaque.
    fn appearance(&self, number: usize, of: &Classed, cut: Option<Face>, ends: [f64; 2]) -> Shown {
        let part = &self.parts[number];
        let camera = &self.scene.camera;
        let (function, factor) = part.look(self.object, of.region);
        let alpha_d = cut.map_or(1.0, |cut| {
            let class = at_node(&function.row(of.row), of.node, of.opacity);
            let gradient = self.gradient(part, of.t);
            let face = self.face(part, of.t, cut);
            let n_xy = style_normal(gradient, face, self.ray.direction, &self.frame);
            let depth_mm = (self.ray.origin_mm + of.t * self.ray.direction - camera.eye_mm).dot(camera.forward);
            let normals = ends.map(|t| {
                let face = part.turned_face(face_normal(&self.object.volume.grid, part.at(t)));
                surface_normal(self.gradient(part, t), face)
            });
            let bend = (1.0 - face.weight) * bend(normals, self.ray.direction, ends[1] - ends[0]);
            let steepness = steepness(gradient, face);
            let level = style_level(camera, self.image_height, depth_mm, part.spacing_mm, steepness, bend);
            shade(&self.scene.styles, &class, n_xy, level).1
        });
        let alpha = factor * alpha_d * of.opacity * self.field.has_data(part.at(of.t));
        let lengths = self.reference_length_mm / function.reference_length_mm;
        let opacity = of.share * opacity_correct(alpha, lengths);
        Shown { part: number, region: of.region, t: of.t, row: of.row, node: of.node, opacity, ends }
    }
}
