//! Convex polyhedra, cut by planes: what parts of an object are bounded by.

use glam::DVec3;

/// Points p with `normal`·p = `offset`; in front of it are those where that is larger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit length.
    pub normal: DVec3,
    /// Of the points on it, in the unit of the space that it lies in.
    pub offset: f64,
}

/// A face of a [`Polyhedron`].
#[derive(Clone, Debug, PartialEq)]
pub struct Facet {
    /// Its plane; the polyhedron is behind it.
    pub plane: Plane,
    /// Which cut made it; none for what the polyhedron was made with.
    pub cut: Option<usize>,
    /// Corners, around the plane's normal.
    pub corners: Vec<DVec3>,
}

/// A bounded convex polyhedron with a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyhedron {
    /// Its faces, each with three corners or more.
    pub facets: Vec<Facet>,
    /// What is shorter is nothing, in its unit.
    tiny: f64,
}

/// Share of a polyhedron's size that rounding makes of it.
const ROUNDING: f64 = 1e-10;

impl Plane {
    /// Through a point; none for a normal without a length.
    pub fn through(point: DVec3, normal: DVec3) -> Option<Self> {
        let normal = normal.try_normalize()?;
        point.is_finite().then(|| Self { normal, offset: normal.dot(point) })
    }

    /// How far in front of it a point is.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }

    /// Where it lies under an affine map.
    #[must_use]
    pub fn moved(&self, pose: &glam::DAffine3) -> Self {
        let normal = (pose.matrix3.inverse().transpose() * self.normal).normalize_or(self.normal);
        Self { normal, offset: normal.dot(pose.transform_point3(self.offset * self.normal)) }
    }

    /// The same points, seen from behind.
    #[must_use]
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }
}

impl Polyhedron {
    /// That with these eight corners, x fastest, then y, then z: a box, maybe sheared.
    pub fn parallelepiped(corners: [DVec3; 8]) -> Self {
        let middle = corners.iter().sum::<DVec3>() / 8.0;
        let size = corners.iter().map(|corner| corner.distance(middle)).fold(0.0, f64::max);
        let facet = |ids: [usize; 4]| {
            let mut around = ids.map(|i| corners[i]);
            let center = around.iter().sum::<DVec3>() / 4.0;
            let mut normal = (around[2] - around[0]).cross(around[3] - around[1]).normalize_or(DVec3::Z);
            if normal.dot(center - middle) < 0.0 {
                around.reverse();
                normal = -normal;
            }
            Facet { plane: Plane { normal, offset: normal.dot(center) }, cut: None, corners: around.to_vec() }
        };
        let facets = [[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]].map(facet);
        Self { facets: facets.to_vec(), tiny: ROUNDING * size }
    }

    /// All corners, those of several faces as often.
    pub fn corners(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.facets.iter().flat_map(|facet| facet.corners.iter().copied())
    }

    /// The middle of the box around it.
    pub fn middle(&self) -> DVec3 {
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = self.corners().fold(none, |(low, high), c| (low.min(c), high.max(c)));
        0.5 * (low + high)
    }

    /// The lowest and the highest corner over a plane.
    pub fn heights(&self, plane: &Plane) -> (f64, f64) {
        let none = (f64::INFINITY, f64::NEG_INFINITY);
        self.corners().map(|corner| plane.height(corner)).fold(none, |(low, high), h| (low.min(h), high.max(h)))
    }

    /// Whether a plane has something of it on either side.
    pub fn is_cut_by(&self, plane: &Plane) -> bool {
        let (low, high) = self.heights(plane);
        low < -self.tiny && high > self.tiny
    }

    /// What is behind a plane; none where that is nothing. `cut`: of the face that it makes.
    pub fn behind(&self, plane: &Plane, cut: Option<usize>) -> Option<Self> {
        let (low, high) = self.heights(plane);
        if high <= self.tiny {
            return Some(self.clone());
        }
        if low >= -self.tiny {
            return None;
        }
        let mut rim: Vec<DVec3> = Vec::new();
        let mut facets: Vec<Facet> = Vec::new();
        for facet in &self.facets {
            let mut corners = Vec::with_capacity(facet.corners.len() + 1);
            for (i, a) in facet.corners.iter().enumerate() {
                let b = facet.corners[(i + 1) % facet.corners.len()];
                let (ha, hb) = (plane.height(*a), plane.height(b));
                if ha <= self.tiny {
                    corners.push(*a);
                }
                if ha.abs() <= self.tiny {
                    rim.push(*a);
                }
                let crosses = ha.max(hb) > self.tiny && ha.min(hb) < -self.tiny;
                if crosses {
                    let on = *a + ha / (ha - hb) * (b - *a);
                    corners.push(on);
                    rim.push(on);
                }
            }
            // A face of which only an edge is left is none.
            if corners.iter().any(|corner| plane.height(*corner) < -self.tiny) && corners.len() > 2 {
                facets.push(Facet { corners, ..facet.clone() });
            }
        }
        let lid = ring(rim, plane, self.tiny);
        if lid.len() > 2 {
            facets.push(Facet { plane: *plane, cut, corners: lid });
        }
        Some(Self { facets, tiny: self.tiny })
    }

    /// Its size, in cubes of its unit.
    pub fn volume(&self) -> f64 {
        let Some(apex) = self.corners().next() else { return 0.0 };
        let of_facet = |facet: &Facet| -facet.plane.height(apex) * area(&facet.corners) / 3.0;
        self.facets.iter().map(of_facet).sum()
    }

    /// Where it lies under an affine map.
    #[must_use]
    pub fn moved(&self, pose: &glam::DAffine3) -> Self {
        let facets = self.facets.iter().map(|facet| {
            let mut corners: Vec<DVec3> = facet.corners.iter().map(|corner| pose.transform_point3(*corner)).collect();
            if pose.matrix3.determinant() < 0.0 {
                corners.reverse();
            }
            Facet { plane: facet.plane.moved(pose), cut: facet.cut, corners }
        });
        let scale = pose.matrix3.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
        Self { facets: facets.collect(), tiny: self.tiny * scale.max(1.0) }
    }
}

/// Points of a plane in their order around its normal, each once.
fn ring(points: Vec<DVec3>, plane: &Plane, tiny: f64) -> Vec<DVec3> {
    let mut ring: Vec<DVec3> = Vec::new();
    for point in points {
        if ring.iter().all(|known| known.distance(point) > 4.0 * tiny) {
            ring.push(point);
        }
    }
    let center = ring.iter().sum::<DVec3>() / ring.len().max(1) as f64;
    let (x, y) = plane.normal.any_orthonormal_pair();
    // Whichever way the pair goes, around the normal.
    let side = x.cross(y).dot(plane.normal).signum();
    let angle = |p: &DVec3| (side * (*p - center).dot(y)).atan2((*p - center).dot(x));
    ring.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    ring
}

/// Area of a plane polygon.
pub fn area(corners: &[DVec3]) -> f64 {
    let Some(first) = corners.first() else { return 0.0 };
    0.5 * corners.windows(2).map(|pair| (pair[0] - *first).cross(pair[1] - *first)).sum::<DVec3>().length()
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DQuat};

    use super::*;

    fn cube() -> Polyhedron {
        let corner = |i: usize| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
        Polyhedron::parallelepiped(std::array::from_fn(corner))
    }

    /// Every edge is that of two faces, once in either direction.
    fn is_closed(polyhedron: &Polyhedron) -> bool {
        let edges: Vec<[DVec3; 2]> = polyhedron
            .facets
            .iter()
            .flat_map(|f| (0..f.corners.len()).map(|i| [f.corners[i], f.corners[(i + 1) % f.corners.len()]]))
            .collect();
        let near = |a: DVec3, b: DVec3| a.distance(b) < 1e-8;
        edges.iter().all(|[a, b]| edges.iter().filter(|[c, d]| near(*a, *d) && near(*b, *c)).count() == 1)
    }

    #[test]
    fn oblique_cuts_leave_closed_halves_that_add_up() {
        let mut whole = vec![cube()];
        let mut state = 7u64;
        let mut number = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for cut in 0..40 {
            let normal = DVec3::new(number() - 0.5, number() - 0.5, number() - 0.5);
            let plane = Plane::through(DVec3::new(number(), number(), number()), normal).unwrap();
            let i = (number() * whole.len() as f64) as usize;
            if !whole[i].is_cut_by(&plane) {
                continue;
            }
            let (a, b) = (whole[i].behind(&plane, Some(cut)), whole[i].behind(&plane.flipped(), Some(cut)));
            let (a, b) = (a.unwrap(), b.unwrap());
            assert!((a.volume() + b.volume() - whole[i].volume()).abs() < 1e-12);
            whole[i] = a;
            whole.push(b);
        }
        assert!(whole.len() > 15, "{}", whole.len());
        assert!((whole.iter().map(Polyhedron::volume).sum::<f64>() - 1.0).abs() < 1e-11);
        for part in &whole {
            assert!(is_closed(part), "{part:#?}");
            for facet in &part.facets {
                assert!(facet.corners.iter().all(|c| facet.plane.height(*c).abs() < 1e-9));
                assert!(part.corners().all(|c| facet.plane.height(c) < 1e-9));
            }
        }
    }

    #[test]
    fn cuts_along_faces_and_through_corners() {
        let cube = cube();
        let face = Plane { normal: DVec3::X, offset: 1.0 };
        assert_eq!(cube.behind(&face, Some(0)), Some(cube.clone()));
        assert_eq!(cube.behind(&face.flipped(), Some(0)), None);
        // Through four edges: two prisms; through three corners: a corner off.
        let half = cube.behind(&Plane::through(DVec3::ZERO, DVec3::new(1.0, -1.0, 0.0)).unwrap(), Some(3)).unwrap();
        assert!(is_closed(&half) && (half.volume() - 0.5).abs() < 1e-12 && half.facets.len() == 5);
        let corner = cube.behind(&Plane::through(DVec3::X, DVec3::ONE).unwrap(), Some(4)).unwrap();
        assert!(is_closed(&corner) && (corner.volume() - 1.0 / 6.0).abs() < 1e-12 && corner.facets.len() == 4);
        assert_eq!(corner.facets.iter().filter(|f| f.cut == Some(4)).count(), 1);
    }

    #[test]
    fn a_moved_polyhedron_has_its_planes_where_its_corners_are() {
        let turn = DAffine3::from_scale_rotation_translation(
            DVec3::new(-2.0, 1.5, 0.7),
            DQuat::from_axis_angle(DVec3::ONE.normalize(), 0.8),
            DVec3::new(10.0, -3.0, 2.0),
        );
        let moved = cube().moved(&turn);
        assert!(is_closed(&moved) && (moved.volume() - 2.1).abs() < 1e-12);
        for facet in &moved.facets {
            assert!(moved.corners().all(|c| facet.plane.height(c) < 1e-12));
        }
    }
}
