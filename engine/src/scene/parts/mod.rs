//! Parts (thesis §4.4.5; docs/rendering.md §10): convex pieces that an object is cut into, and where each of them lies.

pub mod polyhedron;

use glam::DAffine3;

pub use polyhedron::{Facet, Plane, Polyhedron};

use super::moved::check_pose;
use super::{Meetings, Object, Region};
use crate::error::{Error, Result};
use crate::spaces::Grid;

/// A part of an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// What it is called, for messages.
    pub name: String,
    /// M: world (mm) to world; any invertible affine map.
    pub pose: DAffine3,
    /// It is not drawn.
    pub hidden: bool,
}

/// A cut through one part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Position of the part that it goes through: what is behind the plane stays that part.
    pub part: usize,
    /// Where it cuts, at rest, in world mm.
    pub plane: Plane,
}

/// How an object is cut up. Each cut makes a part more: cut i leaves what is in front of its plane to part i + 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// In their order.
    pub cuts: Vec<Cut>,
    /// One more than there are cuts; none for an object that is whole.
    pub list: Vec<Part>,
}

/// Most parts of an object.
pub const MAX_PARTS: usize = 64;

/// Most cells of an object: parts that are drawn, and what they are divided into where a face of one is open and closed.
pub const MAX_CELLS: usize = 128;

/// What is drawn as a whole: a part, several that lie together, or what a part is divided into so that each of its faces is open or
/// closed as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// M.
    pub pose: DAffine3,
    /// Its bounds at rest, world mm; faces of cuts have a `cut`, the others are the volume's own.
    pub bounds: Polyhedron,
    /// The planes of all cuts that led to it, those that it does not reach as well: it is behind each.
    pub behind: Vec<Plane>,
    /// Of each of its facets, whether something else or nothing is behind it: a face that is seen.
    pub open: Vec<bool>,
}

impl Parts {
    /// What each part is bounded by at rest, world mm; none for one that a cut left nothing of.
    pub fn bounds(&self, grid: &Grid) -> Vec<Option<Polyhedron>> {
        let mut bounds = vec![None; self.list.len()];
        if let Some(first) = bounds.first_mut() {
            *first = Some(whole(grid));
        }
        for (i, cut) in self.cuts.iter().enumerate() {
            let Some(whole) = bounds.get_mut(cut.part).and_then(Option::take) else { continue };
            bounds[cut.part] = whole.behind(&cut.plane, Some(i));
            if let Some(front) = bounds.get_mut(i + 1) {
                *front = whole.behind(&cut.plane.flipped(), Some(i));
            }
        }
        bounds
    }

    /// The parts that are drawn, those with the same pose as one where they fill what a cut divided. None for an object that is whole,
    /// or cut and lies as it was: one that has no parts as far as a picture goes.
    pub fn cells(&self, grid: &Grid) -> Option<Vec<Cell>> {
        if self.list.is_empty() {
            return None;
        }
        let mut leaves = vec![Leaf { bounds: whole(grid), part: 0, behind: Vec::new() }];
        // What was there before each cut, so that cuts can be taken back.
        let mut before = Vec::with_capacity(self.cuts.len());
        for (i, cut) in self.cuts.iter().enumerate() {
            let Some(at) = leaves.iter().position(|leaf| leaf.part == cut.part) else { continue };
            let (behind, front) = (
                leaves[at].bounds.behind(&cut.plane, Some(i)),
                leaves[at].bounds.behind(&cut.plane.flipped(), Some(i)),
            );
            before.push((i, leaves[at].clone()));
            let of_front: Vec<Plane> = leaves[at].behind.iter().copied().chain([cut.plane.flipped()]).collect();
            leaves[at].behind.push(cut.plane);
            // A part that a cut misses is empty.
            match behind {
                Some(bounds) => leaves[at].bounds = bounds,
                None => drop(leaves.remove(at)),
            }
            leaves.extend(front.map(|bounds| Leaf { bounds, part: i + 1, behind: of_front }));
        }
        // The last cut is the first whose two sides are still whole parts.
        for (i, whole) in before.into_iter().rev() {
            let side = |part: usize| leaves.iter().position(|leaf| leaf.part == part);
            let (behind, front) = (side(whole.part), side(i + 1));
            let is_drawn_alike = match (behind, front) {
                (Some(a), Some(b)) => self.list[leaves[a].part].lies_as(&self.list[leaves[b].part]),
                (None, _) | (_, None) => false,
            };
            // Cut again since, a side is no longer what this cut made of it.
            let is_uncut = |at: Option<usize>, plane: Plane| {
                at.is_some_and(|at| whole.bounds.behind(&plane, Some(i)).as_ref() == Some(&leaves[at].bounds))
            };
            let plane = self.cuts[i].plane;
            if is_drawn_alike && is_uncut(behind, plane) && is_uncut(front, plane.flipped()) {
                let (Some(a), Some(b)) = (behind, front) else { continue };
                leaves[a].bounds = whole.bounds;
                leaves[a].behind = whole.behind;
                leaves.remove(b);
            }
        }
        let drawn = leaves.into_iter().filter(|leaf| !self.list[leaf.part].hidden);
        let mut cells: Vec<Cell> = drawn
            .map(|leaf| Cell {
                pose: self.list[leaf.part].pose,
                open: Vec::new(),
                bounds: leaf.bounds,
                behind: leaf.behind,
            })
            .collect();
        divide(&mut cells);
        open(&mut cells);
        let is_whole =
            |cell: &Cell| cell.pose == DAffine3::IDENTITY && cell.bounds.facets.iter().all(|facet| facet.cut.is_none());
        (!matches!(&cells[..], [cell] if is_whole(cell))).then_some(cells)
    }
}

/// All of a volume.
fn whole(grid: &Grid) -> Polyhedron {
    let (low, high) = grid.index_box();
    Polyhedron::parallelepiped(grid.box_corners_mm(low, high))
}

impl Part {
    /// Whether it is drawn with another one as if they were one.
    fn lies_as(&self, other: &Self) -> bool {
        self.hidden == other.hidden && (self.hidden || self.pose == other.pose)
    }
}

#[derive(Clone, Debug)]
struct Leaf {
    bounds: Polyhedron,
    behind: Vec<Plane>,
    part: usize,
}

/// Share of a facet's area that counts as none of it.
const NO_AREA: f64 = 1e-9;

/// Area that two facets of one cut have in common.
fn common_area(a: &Facet, b: &Facet) -> f64 {
    if a.cut.is_none() || a.cut != b.cut || a.plane.normal.dot(b.plane.normal) > 0.0 {
        return 0.0;
    }
    // b's polygon, clipped by the sides of a's.
    let mut corners = b.corners.clone();
    for (i, from) in a.corners.iter().enumerate() {
        let to = a.corners[(i + 1) % a.corners.len()];
        let outward = (to - *from).cross(a.plane.normal);
        let Some(side) = Plane::through(*from, outward) else { continue };
        let mut left = Vec::with_capacity(corners.len() + 1);
        for (j, p) in corners.iter().enumerate() {
            let q = corners[(j + 1) % corners.len()];
            let (hp, hq) = (side.height(*p), side.height(q));
            if hp <= 0.0 {
                left.push(*p);
            }
            if (hp > 0.0) != (hq > 0.0) {
                left.push(*p + hp / (hp - hq) * (q - *p));
            }
        }
        corners = left;
    }
    polyhedron::area(&corners)
}

/// Divides cells until each face is, as a whole, one behind which the same body goes on or not.
fn divide(cells: &mut Vec<Cell>) {
    let mut i = 0;
    while i < cells.len() {
        let Some(plane) = divider(cells, i) else {
            i += 1;
            continue;
        };
        let cell = cells[i].clone();
        // Closed, as what it divides lies together.
        let number = Some(usize::MAX - cells.len());
        let half = |plane: &Plane| {
            let behind = cell.behind.iter().copied().chain([*plane]).collect();
            Some(Cell { bounds: cell.bounds.behind(plane, number)?, behind, ..cell.clone() })
        };
        let (Some(a), Some(b)) = (half(&plane), half(&plane.flipped())) else {
            i += 1;
            continue;
        };
        if cells.len() >= MAX_CELLS {
            return;
        }
        cells[i] = a;
        cells.push(b);
        // What was seen as a whole may be partly closed now.
        i = 0;
    }
}

/// Area of a facet behind which the same body goes on.
fn closed_area(cells: &[Cell], own: &Cell, facet: &Facet) -> f64 {
    let others = cells.iter().filter(|other| other.pose == own.pose).flat_map(|other| &other.bounds.facets);
    others.map(|other| common_area(facet, other)).sum()
}

/// A plane that divides cell `i` where one of its faces is partly closed.
fn divider(cells: &[Cell], i: usize) -> Option<Plane> {
    let own = &cells[i];
    for facet in &own.bounds.facets {
        let whole = polyhedron::area(&facet.corners);
        let is_partial = |area: f64| area > NO_AREA * whole && area < (1.0 - NO_AREA) * whole;
        if !is_partial(closed_area(cells, own, facet)) {
            continue;
        }
        let divides = |plane: &Plane| {
            let heights = facet.corners.iter().map(|corner| plane.height(*corner));
            let (low, high) = heights.fold((0.0f64, 0.0f64), |(low, high), h| (low.min(h), high.max(h)));
            low.min(-high).abs() > NO_AREA * whole.sqrt() && low < 0.0 && high > 0.0 && own.bounds.is_cut_by(plane)
        };
        for other in cells.iter().filter(|other| other.pose == own.pose) {
            if other.bounds.facets.iter().any(|closed| is_partial(common_area(facet, closed)))
                && let Some(plane) = other.bounds.facets.iter().map(|side| side.plane).find(divides)
            {
                return Some(plane);
            }
        }
    }
    None
}

/// Says which faces are open.
fn open(cells: &mut [Cell]) {
    let is_open = |own: &Cell, facet: &Facet| {
        facet.cut.is_some() && closed_area(cells, own, facet) < 0.5 * polyhedron::area(&facet.corners)
    };
    let all: Vec<Vec<bool>> =
        cells.iter().map(|cell| cell.bounds.facets.iter().map(|facet| is_open(cell, facet)).collect()).collect();
    cells.iter_mut().zip(all).for_each(|(cell, open)| cell.open = open);
}

/// Checks what types cannot: every cut goes through a part, poses are invertible.
pub(super) fn validate(object: &Object) -> Result<()> {
    let meets = |region: &Region| region.moved().is_some_and(|moved| moved.meetings != Meetings::default());
    if let Some(region) = object.regions.iter().find(|region| meets(region)).filter(|_| !object.parts.list.is_empty()) {
        return Err(Error::scene(
            format!(
                "the region \"{}\" has a color of its own where it meets others, and the object is cut into parts",
                region.name
            ),
            "leave out one of the two",
        ));
    }
    check(&object.parts, &object.volume.grid)
}

fn check(parts: &Parts, grid: &Grid) -> Result<()> {
    if parts.list.is_empty() && parts.cuts.is_empty() {
        return Ok(());
    }
    if parts.list.len() > MAX_PARTS {
        return Err(Error::scene(
            format!("the object is cut into {} parts, and {MAX_PARTS} is the most", parts.list.len()),
            "cut it less often",
        ));
    }
    if parts.list.len() != parts.cuts.len() + 1 {
        return Err(Error::scene(
            format!(
                "{} cuts make {} parts, and {} are named",
                parts.cuts.len(),
                parts.cuts.len() + 1,
                parts.list.len()
            ),
            "name one part more than there are cuts",
        ));
    }
    for part in &parts.list {
        check_pose(&part.pose, &format!("the part \"{}\"", part.name), "the part")?;
    }
    let mut bounds = vec![whole(grid)];
    for (i, cut) in parts.cuts.iter().enumerate() {
        let Plane { normal, offset } = cut.plane;
        if !(normal.is_finite() && offset.is_finite() && (normal.length() - 1.0).abs() < 1e-6) {
            return Err(Error::scene(
                format!("cut {} has a plane without a direction ({normal}, {offset})", i + 1),
                "give it a normal other than zero",
            ));
        }
        let Some(whole) = bounds.get(cut.part) else {
            return Err(Error::scene(
                format!("cut {} goes through part {}, and there are {} then", i + 1, cut.part + 1, bounds.len()),
                "let it go through a part that an earlier cut made",
            ));
        };
        let halves = [cut.plane, cut.plane.flipped()].map(|plane| whole.behind(&plane, Some(i)));
        let ([Some(behind), Some(front)], true) = (halves, whole.is_cut_by(&cut.plane)) else {
            return Err(Error::scene(
                format!("cut {} goes past the part \"{}\"", i + 1, parts.list[cut.part].name),
                "move its plane into the part, or remove it",
            ));
        };
        bounds[cut.part] = behind;
        bounds.push(front);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn grid() -> Grid {
        Grid::new([16, 16, 16], DAffine3::IDENTITY).unwrap()
    }

    /// Cut in the middle along x, each half along y, and each quarter along z: eighths, numbered by what they are in front of.
    fn eighths(pose: impl Fn(usize) -> DAffine3) -> Parts {
        let middle = 7.5;
        let cut = |part: usize, normal: DVec3| Cut { part, plane: Plane { normal, offset: middle } };
        let cuts = vec![
            cut(0, DVec3::X),
            cut(0, DVec3::Y),
            cut(1, DVec3::Y),
            cut(0, DVec3::Z),
            cut(1, DVec3::Z),
            cut(2, DVec3::Z),
            cut(3, DVec3::Z),
        ];
        let list = (0..8).map(|i| Part { name: format!("part {i}"), pose: pose(i), hidden: false }).collect();
        Parts { cuts, list }
    }

    fn away(by: f64) -> DAffine3 {
        DAffine3::from_translation(DVec3::splat(by))
    }

    #[test]
    fn what_lies_as_it_was_is_whole() {
        let parts = eighths(|_| DAffine3::IDENTITY);
        check(&parts, &grid()).unwrap();
        assert_eq!(parts.cells(&grid()), None);
        assert_eq!(Parts::default().cells(&grid()), None);
        let together = eighths(|_| away(3.0)).cells(&grid()).unwrap();
        assert!(together.len() == 1 && together[0].open.iter().all(|open| !open));
        assert_eq!(eighths(|i| away(i as f64)).cells(&grid()).unwrap().len(), 8);
    }

    #[test]
    fn a_missing_eighth_leaves_three_open_faces() {
        for hidden in [false, true] {
            let mut parts = eighths(|i| away(if i == 5 && !hidden { 9.0 } else { 0.0 }));
            parts.list[5].hidden = hidden;
            let cells = parts.cells(&grid()).unwrap();
            let resting: Vec<&Cell> = cells.iter().filter(|cell| cell.pose == DAffine3::IDENTITY).collect();
            let volume: f64 = resting.iter().map(|cell| cell.bounds.volume()).sum();
            assert!((volume - 7.0 * 512.0).abs() < 1e-6, "{volume}");
            let area: f64 = resting
                .iter()
                .flat_map(|cell| cell.bounds.facets.iter().zip(&cell.open))
                .filter(|(_, open)| **open)
                .map(|(facet, _)| polyhedron::area(&facet.corners))
                .sum();
            assert!((area - 3.0 * 64.0).abs() < 1e-6, "{area}");
            assert!(resting.len() < 8 && cells.len() - resting.len() == usize::from(!hidden), "{}", cells.len());
        }
    }

    #[test]
    fn bad_parts_say_what_is_wrong() {
        let sentence = |change: &dyn Fn(&mut Parts)| {
            let mut parts = eighths(|_| DAffine3::IDENTITY);
            change(&mut parts);
            check(&parts, &grid()).unwrap_err().to_string()
        };
        let has = |change: &dyn Fn(&mut Parts), words: &str| {
            let said = sentence(change);
            assert!(said.contains(words), "{said}");
        };
        has(&|p| p.list.resize(65, p.list[0].clone()), "65 parts, and 64 is the most");
        has(&|p| p.list.truncate(7), "7 cuts make 8 parts, and 7 are named");
        has(&|p| p.cuts[2].plane.offset = 100.0, "cut 3 goes past the part \"part 1\"");
        has(&|p| p.cuts[6].part = 7, "cut 7 goes through part 8, and there are 7 then");
        has(&|p| p.cuts[1].plane.normal = DVec3::ZERO, "cut 2 has a plane without a direction");
        has(&|p| p.cuts[1].plane.normal = DVec3::NAN, "cut 2 has a plane without a direction");
        has(
            &|p| p.list[3].pose.translation.x = f64::NAN,
            "the part \"part 3\" is moved by something that is no number",
        );
        has(&|p| p.list[4].pose.matrix3 = glam::DMat3::ZERO, "the part \"part 4\" is scaled by a factor of");
    }
}
