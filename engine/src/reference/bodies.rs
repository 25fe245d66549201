//! Bodies (docs/rendering.md §9): where the parts of an object are that were moved, which stretches of a ray lie in which of them,
//! and what is seen where they meet.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::ray::{Ray, intersect_box};
use super::region::Look;
use super::style::Face;
use crate::scene::moved::STRENGTH_SIZE;
use crate::scene::{Meeting, Object, Role};
use crate::spaces::Grid;

/// A body, ready for rays.
#[derive(Clone, Debug)]
pub struct PreparedBody<'a> {
    /// What it is.
    pub role: Role<'a>,
    /// World (mm) to the index space of the volume as the body lies: of T = M⁻¹, then of the grid.
    pub index_from_world: DAffine3,
    /// M⁻ᵀ: what takes a plane's normal at rest to the moved plane's, but for its length.
    pub normal: DMat3,
    /// Smallest distance of neighboring voxels as they lie, mm.
    pub spacing_mm: f64,
    /// The box in index space that it shows something in.
    pub low: DVec3,
    /// Its other corner.
    pub high: DVec3,
    /// Of the background and of each region; what it does not show has an opacity of 0.
    pub looks: Vec<Look<'a>>,
    /// The same, but that what rests with it counts as shown: where faces are.
    pub cut_looks: Vec<Look<'a>>,
    /// Whether it lies elsewhere than it was found.
    pub is_moved: bool,
    /// The planes behind which it is, as they lie, and whether something shows where they cut.
    pub walls: Vec<Wall>,
}

/// A plane that cuts a body off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// Unit outward normal in the world.
    pub normal: DVec3,
    /// A point on it.
    pub point_mm: DVec3,
    /// Whether it is a face that is seen.
    pub open: bool,
}

/// Where a ray enters or leaves a body through a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// mm along the ray.
    pub t: f64,
    /// Position of the wall.
    pub wall: usize,
}

/// The bodies of an object.
pub fn prepare_bodies(object: &Object) -> Vec<PreparedBody<'_>> {
    let grid = &object.volume.grid;
    // Memberships are large, and the same for all.
    let memberships: Vec<_> = object.regions.iter().map(|r| Arc::new(Look::memberships(r))).collect();
    let looks = |has_background: bool, is_rest: bool, is_shown: &dyn Fn(usize) -> bool| -> Vec<Look<'_>> {
        let region = |i: usize| {
            let region = &object.regions[i];
            let look = region.moved().filter(|_| is_rest).map_or(&region.look, |moved| &moved.ghost);
            let opacity = if is_shown(i) { look.opacity } else { 0.0 };
            Look { opacity, ..Look::region(look, memberships[i].clone()) }
        };
        let background = Look::background(&object.transfer_function);
        let opacity = if has_background { background.opacity } else { 0.0 };
        std::iter::once(Look { opacity, ..background }).chain((0..object.regions.len()).map(region)).collect()
    };
    let mut prepared = Vec::new();
    for body in object.bodies() {
        let rest = body.pose().map_or(DAffine3::IDENTITY, DAffine3::inverse);
        let is_rest = body.pose().is_none();
        let own = |i: usize| body.regions.contains(&i);
        let (low, high) = body.index_box(object);
        prepared.push(PreparedBody {
            index_from_world: grid.index_from_world() * rest,
            normal: rest.matrix3.transpose(),
            spacing_mm: smallest_spacing_mm(grid, &rest),
            low,
            high,
            looks: looks(body.role == Role::Rest, is_rest, &own),
            cut_looks: if is_rest { looks(true, true, &|_| true) } else { looks(false, false, &own) },
            role: body.role,
            is_moved: matches!(body.role, Role::Moved(_)),
            walls: Vec::new(),
        });
    }
    let Some(cells) = object.parts.cells(grid) else { return prepared };
    // What rests is there once for each cell.
    let whole = prepared.remove(0);
    let parts = cells.iter().map(|cell| {
        let rest = cell.pose.inverse();
        let facets = cell.bounds.facets.iter().zip(&cell.open).filter(|(facet, _)| facet.cut.is_some());
        let walls = facets.map(|(facet, open)| Wall {
            normal: (rest.matrix3.transpose() * facet.plane.normal).normalize(),
            point_mm: cell.pose.transform_point3(facet.corners[0]),
            open: *open,
        });
        PreparedBody {
            index_from_world: grid.index_from_world() * rest,
            normal: rest.matrix3.transpose(),
            spacing_mm: smallest_spacing_mm(grid, &rest),
            is_moved: cell.pose != DAffine3::IDENTITY,
            walls: walls.collect(),
            ..whole.clone()
        }
    });
    parts.chain(prepared).collect()
}

fn smallest_spacing_mm(grid: &Grid, rest: &DAffine3) -> f64 {
    let world = rest.matrix3.inverse() * grid.world_from_index().matrix3;
    [world.x_axis, world.y_axis, world.z_axis].map(DVec3::length).into_iter().fold(f64::INFINITY, f64::min)
}

impl PreparedBody<'_> {
    /// A direction of the volume at rest, with its length, as the body lies.
    pub fn turned(&self, direction: DVec3) -> DVec3 {
        (self.normal * direction).normalize_or_zero() * direction.length()
    }

    /// A face of the volume at rest.
    pub fn turned_face(&self, face: Face) -> Face {
        Face { normal: self.turned(face.normal), ..face }
    }

    /// Voxels per mm along a ray.
    pub fn voxels_per_mm(&self, ray: &Ray) -> f64 {
        (self.index_from_world.matrix3 * ray.direction).length()
    }

    fn span(&self, ray: &Ray) -> Option<(f64, f64)> {
        let origin = self.index_from_world.transform_point3(ray.origin_mm);
        let (t0, t1) =
            intersect_box(origin, self.index_from_world.matrix3 * ray.direction, ray.t_min, self.low, self.high)?;
        let [enters, leaves] = self.crossings(ray)?;
        let span = (enters.map_or(t0, |c| t0.max(c.t)), leaves.map_or(t1, |c| t1.min(c.t)));
        (span.0 < span.1).then_some(span)
    }

    /// Where the ray is last to come behind a wall, and first to come in front of one; none if it is never behind all.
    pub fn crossings(&self, ray: &Ray) -> Option<[Option<Crossing>; 2]> {
        let mut found: [Option<Crossing>; 2] = [None; 2];
        for (wall, Wall { normal, point_mm, .. }) in self.walls.iter().enumerate() {
            let (height, rise) = (normal.dot(ray.origin_mm - *point_mm), normal.dot(ray.direction));
            if rise == 0.0 {
                if height > 0.0 {
                    return None;
                }
                continue;
            }
            let t = -height / rise;
            let leaves = usize::from(rise > 0.0);
            if found[leaves].is_none_or(|known| (t > known.t) == (leaves == 0)) {
                found[leaves] = Some(Crossing { t, wall });
            }
        }
        Some(found)
    }
}

/// A stretch of a ray with the same bodies throughout.
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// Where it begins and ends, mm.
    pub t0: f64,
    /// Its end.
    pub t1: f64,
    /// Which bodies are there.
    pub bodies: Vec<usize>,
}

/// What is shorter than that, as a share of its distance, is no stretch of a ray.
const TINY: f64 = 1e-12;

/// The stretches of a ray that are in a body, front to back.
pub fn intervals(bodies: &[PreparedBody<'_>], ray: &Ray) -> Vec<Interval> {
    let spans: Vec<Option<(f64, f64)>> = bodies.iter().map(|body| body.span(ray)).collect();
    let mut events: Vec<f64> = spans.iter().flatten().flat_map(|(t0, t1)| [*t0, *t1]).collect();
    events.sort_by(f64::total_cmp);
    let between = |pair: &[f64]| {
        // Neighbors have one face, but for rounding.
        if pair[1] - pair[0] < TINY * pair[1].abs() {
            return None;
        }
        let middle = pair[0].midpoint(pair[1]);
        let is_here = |span: &Option<(f64, f64)>| span.is_some_and(|(t0, t1)| t0 < middle && middle < t1);
        let bodies: Vec<usize> = (0..spans.len()).filter(|i| is_here(&spans[*i])).collect();
        (!bodies.is_empty()).then_some(Interval { t0: pair[0], t1: pair[1], bodies })
    };
    events.windows(2).filter_map(between).collect()
}

/// What a body shows of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Which body.
    pub body: usize,
    /// Straight linear color.
    pub color: DVec3,
    /// Opacity of a reference length of the object.
    pub alpha: f64,
    /// What its looks have of the place.
    pub share: f64,
    /// The data value, as a share of the way from the smallest to the largest of the volume.
    pub value: f64,
}

/// Color and opacity of a reference length where bodies meet (eqs. 2.4 to 2.7). `shown`: what each of them shows, in their order.
pub fn combine(bodies: &[PreparedBody<'_>], shown: &[Shown]) -> (DVec3, f64) {
    // The sets that are combined: color, membership, and whether it is one of those that share out the place at rest.
    let mut sets: Vec<(DVec3, f64, bool)> =
        shown.iter().map(|s| (s.color, s.alpha, !bodies[s.body].is_moved)).collect();
    let mut strongest: Option<usize> = None;
    for (i, set) in sets.iter().enumerate() {
        if !set.2 && strongest.is_none_or(|s| set.1 > sets[s].1) {
            strongest = Some(i);
        }
    }
    if let Some(s) = strongest
        && let Role::Moved(moved) = bodies[shown[s].body].role
    {
        let own_ghost = shown.iter().position(|x| x.body + 1 == shown[s].body && bodies[x.body].role == Role::Ghost);
        let background = shown.iter().position(|x| bodies[x.body].role == Role::Rest);
        let mut taken = 0.0f64;
        for (other, meeting) in [(own_ghost, &moved.meetings.ghost), (background, &moved.meetings.background)] {
            let (Some(other), Some(meeting)) = (other, meeting) else { continue };
            let membership = meets(meeting, &shown[other], &shown[s]);
            let (a, b) = (&shown[other], &shown[s]);
            let light = (a.alpha * a.color + b.alpha * b.color) / (a.alpha + b.alpha).max(1e-300);
            let color = DVec3::from_array(meeting.color.map(f64::from)) * light.dot(DVec3::new(0.2126, 0.7152, 0.0722));
            // X − Y = min(μ_X, 1 − μ_Y).
            sets[other].1 = sets[other].1.min(1.0 - membership);
            taken = taken.max(membership);
            sets.push((color, membership, false));
        }
        sets[s].1 = sets[s].1.min(1.0 - taken);
    }
    let sum: f64 = sets.iter().map(|(_, alpha, _)| alpha).sum();
    let color = sets.iter().map(|(color, alpha, _)| *alpha * *color).sum::<DVec3>();
    // What rests shares out the place, and so adds up; the rest is a union of fuzzy sets.
    let resting: f64 = sets.iter().filter(|set| set.2).map(|set| set.1).sum();
    let alpha = sets.iter().filter(|set| !set.2).map(|set| set.1).fold(resting.min(1.0), f64::max);
    (if sum > 0.0 { color / sum } else { DVec3::ZERO }, alpha)
}

/// Membership of an intersection's set (eq. 2.7), its case as a smooth step.
fn meets(meeting: &Meeting, rest: &Shown, moved: &Shown) -> f64 {
    let of_look = |s: &Shown| if s.share > 1e-6 { s.alpha / s.share } else { s.alpha / 1e-6 };
    let strength = meeting.strength.as_ref().map_or(1.0, |strength| {
        let n = STRENGTH_SIZE;
        let at = |v: f64| (v * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
        let (x, y) = (at(rest.value), at(moved.value));
        let (i, j) = (x as usize, y as usize);
        let cell = |i: usize, j: usize| f64::from(strength.cells()[i.min(n - 1) + n * j.min(n - 1)]) / 255.0;
        let (u, v) = (x - i as f64, y - j as f64);
        (cell(i, j) * (1.0 - u) + cell(i + 1, j) * u) * (1.0 - v)
            + (cell(i, j + 1) * (1.0 - u) + cell(i + 1, j + 1) * u) * v
    });
    let opacity = meeting.opacity.unwrap_or_else(|| of_look(rest).max(of_look(moved)).min(1.0));
    let membership = rest.share.min(moved.share).min(strength * opacity);
    let x = (rest.alpha.min(moved.alpha) / 1e-3).clamp(0.0, 1.0);
    membership * x * x * (3.0 - 2.0 * x)
}
