//! From slices somewhere in space to an even stack: order, frames, spacing, tilt, gaps.
//!
//! Slices are sorted by their place along the normal of their planes; instance numbers order only what has no place. Where
//! slices are missing or uneven, new ones are interpolated, and the user is told: pictures of a body with a step in it, or of
//! one that is compressed where slices are missing, would be wrong without anyone noticing.

use glam::{DAffine3, DMat3, DVec3};

use super::slices::{NUM_ORDERS, ORDER_NAMES, Slice};
use crate::volume::Orientation;

/// Why slices make no volume: what, remedy.
pub type Clause = (String, String);

/// A slice of the volume, from those of the files.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plane {
    /// One as it is.
    At(usize),
    /// Between that one and the next, at this share of the way.
    Between(usize, f64),
}

/// Slices that make an even stack.
#[derive(Clone, Debug)]
pub struct Arranged {
    /// Of every frame the slices in the order of the stack.
    pub frames: Vec<Vec<Slice>>,
    /// The slices of the volume.
    pub planes: Vec<Plane>,
    /// From voxels to RAS mm.
    pub world_from_index: DAffine3,
    /// Whether the files say how it lies in the body.
    pub orientation: Orientation,
    /// What the user shall know.
    pub warnings: Vec<String>,
}

/// Deviations from an even stack that are rounding: a share of the spacing, and mm.
const ROUNDING: (f64, f64) = (0.01, 0.01);

/// Deviations, as a share of the spacing, that are let pass with a note.
const TOLERATED: f64 = 0.1;

/// Gaps that a warning names.
const MAX_NAMED: usize = 4;

/// Of the slices of a volume, at most so many may be interpolated for each that is there.
const MAX_INTERPOLATED: f64 = 1.0;

/// A tilt that is no rounding, in degrees.
const MIN_TILT_DEG: f64 = 0.1;

/// Arranges slices of one orientation, size and pixel spacing; several stacks if they differ in something that tells them
/// apart at the same places.
pub fn arrange(slices: Vec<Slice>) -> Vec<Result<Arranged, Clause>> {
    let is_placed = slices.iter().all(|s| s.position.is_some() && s.axes.is_some());
    if !is_placed {
        return vec![arrange_unplaced(slices)];
    }
    let Some(placed) = Placed::of(slices) else { return Vec::new() };
    if placed.is_even_in_number() {
        return vec![placed.arrange()];
    }
    // Some places have more slices than others: several acquisitions, echoes, or kinds of pictures in one series.
    for parts in placed.partitions() {
        if parts.len() > 1 && parts.iter().all(Placed::is_even_in_number) {
            return parts.into_iter().map(Placed::arrange).collect();
        }
    }
    let most = placed.places.iter().map(|p| p.1.len()).max().unwrap_or(0);
    let least = placed.places.iter().map(|p| p.1.len()).min().unwrap_or(0);
    vec![Err((
        format!(
            "of {} places in the stack some have {least} slices and some {most}, and nothing tells which belong together",
            placed.places.len()
        ),
        "take the slices of other acquisitions out of the folder".to_owned(),
    ))]
}

/// Slices by their place along the normal.
struct Placed {
    row: DVec3,
    column: DVec3,
    spacing: [f64; 2],
    is_spacing_known: bool,
    /// Place in mm and the slices there, in ascending order.
    places: Vec<(f64, Vec<Slice>)>,
}

impl Placed {
    fn of(slices: Vec<Slice>) -> Option<Self> {
        let first = slices.first()?;
        let [row, column] = first.axes?;
        let (spacing, is_spacing_known) = (first.spacing.unwrap_or([1.0; 2]), first.spacing.is_some());
        let normal = row.cross(column).normalize();
        let mut at: Vec<(f64, Slice)> = slices.into_iter().filter_map(|s| Some((s.position?.dot(normal), s))).collect();
        at.sort_by(|a, b| a.0.total_cmp(&b.0));
        let same = 0.01 * spacing[0].min(spacing[1]);
        let mut places: Vec<(f64, Vec<Slice>)> = Vec::new();
        for (place, slice) in at {
            match places.last_mut() {
                Some((last, there)) if place - *last <= same => there.push(slice),
                _ => places.push((place, vec![slice])),
            }
        }
        for (_, there) in &mut places {
            there.sort_by(|a, b| order_of(a).partial_cmp(&order_of(b)).unwrap_or(std::cmp::Ordering::Equal));
        }
        Some(Self { row, column, spacing, is_spacing_known, places })
    }

    fn is_even_in_number(&self) -> bool {
        self.places.windows(2).all(|p| p[0].1.len() == p[1].1.len())
    }

    /// Every way to part the slices by something that differs between them.
    fn partitions(&self) -> Vec<Vec<Self>> {
        let all: Vec<&Slice> = self.places.iter().flat_map(|p| &p.1).collect();
        let part = |same: &dyn Fn(&Slice, &Slice) -> bool| -> Vec<Self> {
            let mut parts: Vec<Vec<Slice>> = Vec::new();
            for slice in &all {
                match parts.iter_mut().find(|p| same(&p[0], slice)) {
                    Some(part) => part.push((*slice).clone()),
                    None => parts.push(vec![(*slice).clone()]),
                }
            }
            parts.into_iter().filter_map(Self::of).collect()
        };
        let mut partitions = vec![part(&|a, b| a.image_type == b.image_type)];
        for i in 0..NUM_ORDERS {
            partitions.push(part(&|a, b| a.order[i] == b.order[i]));
        }
        partitions.push(part(&|a, b| a.image_type == b.image_type && a.order == b.order));
        partitions
    }

    fn arrange(self) -> Result<Arranged, Clause> {
        let mut warnings = Vec::new();
        if !self.is_spacing_known {
            warnings.push(NO_SPACING.to_owned());
        }
        let normal = self.row.cross(self.column).normalize();
        let num_frames = self.places.first().map_or(0, |p| p.1.len());
        let places: Vec<f64> = self.places.iter().map(|p| p.0).collect();
        let firsts: Vec<&Slice> = self.places.iter().filter_map(|p| p.1.first()).collect();
        let positions: Vec<DVec3> = firsts.iter().filter_map(|s| s.position).collect();
        let Some(&origin) = positions.first() else { return Err(no_slices()) };
        let (planes, step) = if places.len() == 1 {
            let stated = firsts[0].stated_step;
            (vec![Plane::At(0)], stated.unwrap_or(f64::midpoint(self.spacing[0], self.spacing[1])))
        } else {
            planes(&places, &mut warnings)?
        };
        // How the stack leans: sideways mm per mm along the normal.
        let lean = match (places.as_slice(), positions.last()) {
            ([first, .., last], Some(end)) => (*end - origin) / (last - first),
            _ => normal,
        };
        let sideways = |i: usize| (positions[i] - (origin + lean * (places[i] - places[0]))).length();
        let deviation = (0..positions.len()).map(sideways).fold(0.0, f64::max);
        if deviation > 0.5 * self.spacing[0].min(self.spacing[1]) {
            return Err((
                format!("its slices are shifted sideways against each other by up to {deviation:.2} mm"),
                "they make no straight stack: reformat the series, or choose another".to_owned(),
            ));
        }
        let tilt = lean.normalize().dot(normal).clamp(-1.0, 1.0).acos().to_degrees();
        let lean = if tilt > 1e-3 { lean } else { normal };
        if tilt > MIN_TILT_DEG {
            warnings.push(format!(
                "The slices lean by {tilt:.1}° against their stack (gantry tilt), which the volume keeps in its shape."
            ));
        }
        let mut frames = vec![Vec::with_capacity(places.len()); num_frames];
        for (_, there) in self.places {
            for (frame, slice) in frames.iter_mut().zip(there) {
                frame.push(slice);
            }
        }
        if num_frames > 1 {
            let what = (0..NUM_ORDERS).find(|&i| frames.windows(2).any(|f| f[0][0].order[i] != f[1][0].order[i]));
            let by = what.map_or("instance number", |i| ORDER_NAMES[i]);
            warnings
                .push(format!("Each place has {num_frames} slices, which became frames in the order of their {by}."));
        }
        let world_from_index = ras(self.row * self.spacing[0], self.column * self.spacing[1], lean * step, origin);
        Ok(Arranged { frames, planes, world_from_index, orientation: Orientation::Stated, warnings })
    }
}

const NO_SPACING: &str = "The file does not say how large its pixels are: 1 mm was assumed.";

fn no_slices() -> Clause {
    ("it has no slices".to_owned(), "choose another series".to_owned())
}

/// Slices of which nobody says where they lie.
pub fn unplaced() -> Orientation {
    Orientation::Assumed(
        "The file does not say how it lies in the body: right, left, front and back may be wrong.".to_owned(),
    )
}

/// What orders slices of one place.
fn order_of(slice: &Slice) -> ([f64; NUM_ORDERS], f64) {
    (slice.order, slice.number)
}

/// The affine of an index with these steps and origin, all of them in LPS.
pub fn ras(x: DVec3, y: DVec3, z: DVec3, origin: DVec3) -> DAffine3 {
    let flip = DVec3::new(-1.0, -1.0, 1.0);
    DAffine3 { matrix3: DMat3::from_cols(x * flip, y * flip, z * flip), translation: origin * flip }
}

/// The even stack through at least two ascending places, and its step in mm.
pub fn planes(places: &[f64], warnings: &mut Vec<String>) -> Result<(Vec<Plane>, f64), Clause> {
    let steps: Vec<f64> = places.windows(2).map(|p| p[1] - p[0]).collect();
    let n = places.len();
    let length = places[n - 1] - places[0];
    let mean = length / (n - 1) as f64;
    // Rounding puts slices off to both sides: of an even stack between them, each is off by half of that.
    let off = places.iter().enumerate().map(|(i, p)| p - places[0] - mean * i as f64);
    let (least_off, most_off) = off.fold((0.0, 0.0), |(a, b): (f64, f64), off| (a.min(off), b.max(off)));
    let deviation = (most_off - least_off) / 2.0;
    let all = || (0..n).map(Plane::At).collect();
    if deviation <= (ROUNDING.0 * mean).max(ROUNDING.1) {
        return Ok((all(), mean));
    }
    if deviation <= TOLERATED * mean {
        warnings.push(format!(
            "The slices lie up to {deviation:.3} mm off their places in an even stack, which was let pass."
        ));
        return Ok((all(), mean));
    }
    // The finest step that is no exception.
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let step = sorted[(n - 1) / 10];
    let (least, most) = (sorted[0], sorted[n - 2]);
    // Steps of that kind, averaged: positions are rounded.
    let alike: Vec<f64> = steps.iter().copied().filter(|s| (s / step - 1.0).abs() <= TOLERATED).collect();
    let step = alike.iter().sum::<f64>() / alike.len().max(1) as f64;
    let num_planes = (length / step).round() + 1.0;
    if num_planes > (1.0 + MAX_INTERPOLATED) * n as f64 {
        return Err((
            format!("its {n} slices lie {least:.2} to {most:.2} mm apart, too unevenly for a volume"),
            "add the slices that are missing, or take those that belong to another stack out of the folder".to_owned(),
        ));
    }
    // A last even step that is not whole is stretched a little: the stack ends where its slices end.
    let step = length / (num_planes - 1.0);
    let mut planes = Vec::new();
    let mut num_between = 0;
    let mut below = 0;
    for i in 0..num_planes as usize {
        let place = places[0] + step * i as f64;
        while below + 2 < n && places[below + 1] <= place {
            below += 1;
        }
        let share = (place - places[below]) / (places[below + 1] - places[below]);
        let off = share.min(1.0 - share) * (places[below + 1] - places[below]);
        planes.push(if off > TOLERATED * step {
            num_between += 1;
            Plane::Between(below, share)
        } else {
            Plane::At(below + usize::from(share > 0.5))
        });
    }
    let is_whole = steps.iter().all(|s| (s / step - (s / step).round()).abs() <= TOLERATED);
    warnings.push(if is_whole {
        let gaps: Vec<usize> =
            (0..n - 1).filter(|&i| (steps[i] / step).round() > 1.0).map(|i| i + 1).collect();
        let mut gaps: Vec<String> = gaps.iter().map(usize::to_string).collect();
        if gaps.len() > MAX_NAMED {
            gaps[MAX_NAMED..].fill("...".to_owned());
            gaps.truncate(MAX_NAMED + 1);
        }
        let missing = if num_between == 1 { "slice is" } else { "slices are" };
        format!(
            "{num_between} of {} {missing} missing (after slice {}) and interpolated from the neighbors.",
            planes.len(),
            gaps.join(", ")
        )
    } else {
        format!(
            "The slices lie {least:.2} to {most:.2} mm apart: {num_between} of {} were interpolated to make an even stack \
             of {step:.2} mm.",
            planes.len()
        )
    });
    Ok((planes, step))
}

/// Slices of which nobody says where they lie: in the order of their locations or, failing that, of their numbers.
fn arrange_unplaced(mut slices: Vec<Slice>) -> Result<Arranged, Clause> {
    let mut warnings = Vec::new();
    let Some(first) = slices.first() else { return Err(no_slices()) };
    let [row, column] = first.axes.unwrap_or([DVec3::X, DVec3::Y]);
    let spacing = first.spacing.unwrap_or_else(|| {
        warnings.push(NO_SPACING.to_owned());
        [1.0; 2]
    });
    let origin = first.position.unwrap_or(DVec3::ZERO);
    let stated = first.stated_step;
    let has_axes = first.axes.is_some();
    let mut locations: Vec<f64> = slices.iter().filter_map(|s| s.location).collect();
    locations.sort_by(f64::total_cmp);
    let is_located = locations.len() == slices.len() && locations.windows(2).all(|l| l[1] > l[0]) && slices.len() > 1;
    let key = |s: &Slice| if is_located { s.location.unwrap_or(0.0) } else { s.number };
    slices.sort_by(|a, b| key(a).total_cmp(&key(b)));
    let (planes, step) = if is_located {
        planes(&locations, &mut warnings)?
    } else {
        let step = stated.unwrap_or_else(|| {
            if slices.len() > 1 {
                warnings.push(
                    "The file does not say how far apart its slices lie: as far as its pixels was assumed.".to_owned(),
                );
            }
            f64::midpoint(spacing[0], spacing[1])
        });
        ((0..slices.len()).map(Plane::At).collect(), step)
    };
    // One slice whose rows and columns have directions lies as they say, wherever that is.
    let orientation = if has_axes && slices.len() == 1 { Orientation::Stated } else { unplaced() };
    let world_from_index = ras(row * spacing[0], column * spacing[1], row.cross(column) * step, origin);
    Ok(Arranged { frames: vec![slices], planes, world_from_index, orientation, warnings })
}
