//! Moved regions (thesis §2.3.2; docs/rendering.md §9): where a selection was moved to, the ghost that it leaves, and how it looks where
//! it meets others.

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use super::region::Look;
use super::{Object, Region};
use crate::error::{Error, Result};

/// Where a region was moved to.
#[derive(Clone, Debug, PartialEq)]
pub struct Moved {
    /// M: world (mm) to world; any invertible affine map. Regions with equal poses and meetings are one body.
    pub pose: DAffine3,
    /// How the place is drawn that it left.
    pub ghost: Look,
    /// How it looks where it meets others.
    pub meetings: Meetings,
}

/// Intersection transfer functions (eqs. 2.6, 2.7) of a moved region: with its own ghost, and with what else is at rest.
/// None: both are seen, by eqs. 2.4 and 2.5.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Meetings {
    /// α_GS, c_GS.
    pub ghost: Option<Meeting>,
    /// α_BS, c_BS.
    pub background: Option<Meeting>,
}

/// An intersection transfer function, in one color under the light of the styles of those who meet.
#[derive(Clone, Debug, PartialEq)]
pub struct Meeting {
    /// Linear RGB, 0 to 1.
    pub color: [f32; 3],
    /// Opacity of a reference length of the object, 0 to 1; none: as opaque as the more opaque one of those who meet.
    pub opacity: Option<f64>,
    /// Factor of that, by the two values that meet. None: 1 everywhere.
    pub strength: Option<Arc<Strength>>,
}

/// Cells along each axis of a [`Strength`].
pub const STRENGTH_SIZE: usize = 64;

/// How much of a meeting shows, by the value at rest (along x, x fastest) and the moved one (along y), each over the data's range:
/// `STRENGTH_SIZE`² numbers of 1/255, bilinear between the cells' middles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Strength(Vec<u8>);

impl Strength {
    /// Of `STRENGTH_SIZE`² numbers; none of another count.
    pub fn new(cells: Vec<u8>) -> Option<Self> {
        (cells.len() == STRENGTH_SIZE * STRENGTH_SIZE).then_some(Self(cells))
    }

    /// The numbers.
    pub fn cells(&self) -> &[u8] {
        &self.0
    }
}

/// What moves as one, or rests: the unit that rays walk through.
#[derive(Clone, Debug, PartialEq)]
pub struct Body<'a> {
    /// Which part of the object it is.
    pub role: Role<'a>,
    /// Positions of the regions that it shows.
    pub regions: Vec<usize>,
}

/// What a body is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role<'a> {
    /// The background, regions at rest, and ghosts that nothing special happens to.
    Rest,
    /// Ghosts of the next body, which has meetings.
    Ghost,
    /// Moved regions.
    Moved(&'a Moved),
}

/// Most bodies of an object.
pub const MAX_BODIES: usize = 16;

impl Region {
    /// How it was moved; none where it lies as it was found.
    pub fn moved(&self) -> Option<&Moved> {
        self.moved.as_ref().filter(|moved| moved.pose != DAffine3::IDENTITY)
    }
}

impl Object {
    /// The bodies, of which the first is at rest: each ghost that is a body of its own comes before the body whose it is.
    pub fn bodies(&self) -> Vec<Body<'_>> {
        let mut moved: Vec<(&Moved, Vec<usize>)> = Vec::new();
        let mut resting = Vec::new();
        for (i, region) in self.regions.iter().enumerate() {
            let Some(own) = region.moved() else {
                resting.push(i);
                continue;
            };
            // One too many is enough to be refused.
            if moved.len() > MAX_BODIES {
                break;
            }
            match moved.iter_mut().find(|(m, _)| (m.pose, &m.meetings) == (own.pose, &own.meetings)) {
                Some((_, regions)) => regions.push(i),
                None => moved.push((own, vec![i])),
            }
            if own.meetings == Meetings::default() {
                resting.push(i);
            }
        }
        let mut bodies = vec![Body { role: Role::Rest, regions: resting }];
        for (moved, regions) in moved {
            if moved.meetings != Meetings::default() {
                bodies.push(Body { role: Role::Ghost, regions: regions.clone() });
            }
            bodies.push(Body { role: Role::Moved(moved), regions });
        }
        bodies
    }
}

impl<'a> Body<'a> {
    /// M; none at rest.
    pub fn pose(&self) -> Option<&'a DAffine3> {
        match self.role {
            Role::Moved(moved) => Some(&moved.pose),
            Role::Rest | Role::Ghost => None,
        }
    }

    /// How it shows region `i` of the object; none where it does not.
    pub fn look<'o>(&self, object: &'o Object, i: usize) -> Option<&'o Look> {
        let region = &object.regions[i];
        self.regions.contains(&i).then(|| match (self.role, region.moved()) {
            (Role::Rest | Role::Ghost, Some(moved)) => &moved.ghost,
            _ => &region.look,
        })
    }

    /// The box in index space outside of which it shows nothing, clipped to the volume's: all of it at rest, else what memberships
    /// of its regions reach by interpolation. The second is nowhere above the first where it shows nothing at all.
    pub fn index_box(&self, object: &Object) -> (DVec3, DVec3) {
        let whole = object.volume.grid.index_box();
        if self.role == Role::Rest {
            return whole;
        }
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = self.regions.iter().filter_map(|i| object.regions[*i].selection.bounds()).fold(
            none,
            |(low, high), bounds| {
                let at = |i: usize| DVec3::from_array(bounds.map(|b| b[i] as f64));
                (low.min(at(0) - 1.0), high.max(at(1)))
            },
        );
        if low.x > high.x { (DVec3::ZERO, DVec3::ZERO) } else { (low.max(whole.0), high.min(whole.1)) }
    }
}

/// The smallest and largest factors of length that a pose may have.
const SCALES: (f64, f64) = (1e-3, 1e3);

/// Refuses poses that nothing can be drawn in. `what`: what has it, as a sentence names it; `kind`: as advice does.
pub(super) fn check_pose(pose: &DAffine3, what: &str, kind: &str) -> Result<()> {
    let m = pose.matrix3;
    if !(m.is_finite() && pose.translation.is_finite()) {
        return Err(Error::scene(format!("{what} is moved by something that is no number"), "move it back and again"));
    }
    // The lengths that unit vectors get: Frobenius norms bound the largest, and 1/the smallest.
    let norm = |m: glam::DMat3| m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
    let (most, least) = (norm(m), 1.0 / norm(m.inverse()));
    if !(least >= 0.5 * SCALES.0 && most <= 2.0 * SCALES.1) {
        return Err(Error::scene(
            format!("{what} is scaled by a factor of {:.3e}", if least < SCALES.0 { least } else { most }),
            format!("choose one from 0.001 to 1000, or hide {kind}"),
        ));
    }
    Ok(())
}

pub(super) fn validate(object: &Object) -> Result<()> {
    for region in &object.regions {
        let Some(moved) = &region.moved else { continue };
        check_pose(&moved.pose, &format!("the region \"{}\"", region.name), "the region")?;
        let fail =
            |what: String, remedy: &str| Err(Error::scene(format!("the region \"{}\" {what}", region.name), remedy));
        let strengths = [&moved.meetings.ghost, &moved.meetings.background];
        if strengths.into_iter().flatten().any(|m| m.color.iter().any(|c| !(0.0..=1.0).contains(c))) {
            return fail("meets others in a color that is none".to_owned(), "choose colors from 0 to 1");
        }
        let mut opacities = strengths.into_iter().flatten().filter_map(|m| m.opacity);
        if let Some(opacity) = opacities.find(|opacity| !(0.0..=1.0).contains(opacity)) {
            return fail(format!("meets others with an opacity of {opacity}"), "choose one from 0 to 1");
        }
    }
    let num_bodies = object.bodies().len();
    if num_bodies > MAX_BODIES {
        return Err(Error::scene(
            format!(
                "{num_bodies} parts of the object are moved differently, ghosts that meet them included, and {MAX_BODIES} is the most"
            ),
            "move some of them together",
        ));
    }
    Ok(())
}
