//! What a volume will take before it is read, and which part of it fits where the whole does not.

use std::borrow::Cow;
use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use super::window::{OnGrid, Window};
use super::{Entry, Numbers, ReadOptions};
use crate::error::{Error, Result};
use crate::gpu::context::MOST_GRADIENT_BYTES;

/// What a volume may take. Nothing is limited by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits {
    /// Bytes, of the voxels and of what the adapter gets: a software adapter takes both from the same memory, and one with
    /// memory of its own seldom has more of it than the machine.
    pub bytes: Option<u64>,
    /// The longest axis, in voxels, of the adapter's 3-D textures.
    pub edge: Option<usize>,
}

/// What a volume takes, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cost {
    /// The voxels in memory.
    pub voxels: u64,
    /// The textures on the adapter: values, and gradients or the smoothed copy that these are taken from.
    pub adapter: u64,
}

impl Cost {
    /// Both.
    pub fn total(self) -> u64 {
        self.voxels.saturating_add(self.adapter)
    }
}

impl Entry {
    /// As it is read if its numbers are taken for this: structures are colors, with a luminance and a number each.
    pub fn taken_for(&self, numbers: Numbers) -> Cow<'_, Self> {
        if !numbers.are_structures(self) {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self { type_name: "rgba", bytes_per_voxel: 6 + 2, ..self.clone() })
    }

    /// What this volume, or a part of it, will take.
    pub fn cost(&self, part: &OnGrid) -> Cost {
        let num_voxels = part.num_voxels() as u64;
        // As `gpu::upload` chooses, and its test compares: 16 bits for small integers, else 32, and 4 × 16 for gradients (32 for the
        // smoothed copy of a volume for whose gradients there is no room); colors have 16 bits for their value and 4 × 16, twice.
        let gradients = if num_voxels.saturating_mul(8) <= MOST_GRADIENT_BYTES { 8 } else { 4 };
        let texel = match self.type_name {
            "rgb" | "rgba" => 2 + 8 + 8,
            "uint8" | "int8" | "uint16" | "int16" => 2 + gradients,
            _ => 4 + gradients,
        };
        Cost {
            voxels: num_voxels.saturating_mul(self.bytes_per_voxel as u64),
            adapter: num_voxels.saturating_mul(texel),
        }
    }
}

impl Limits {
    /// Whether a part of a volume is within them.
    pub fn admit(&self, entry: &Entry, part: &OnGrid) -> bool {
        self.bytes.is_none_or(|bytes| entry.cost(part).total() <= bytes)
            && self.edge.is_none_or(|edge| part.dims().iter().all(|n| *n <= edge))
    }

    /// The window with more reduction, by as little as it takes to be within the limits: the finest axis gives way first, so
    /// that voxels become as long as they are wide.
    pub fn fit(&self, path: &Path, entry: &Entry, window: &Window) -> Result<Window> {
        let mut fitting = *window;
        loop {
            let part = fitting.on(path, entry.grid.dims())?;
            if self.admit(entry, &part) || part.num_voxels() == 1 {
                return Ok(fitting);
            }
            let spacing = entry.grid.spacing_mm();
            let dims = part.dims();
            let over = |axis: usize| self.edge.is_some_and(|edge| dims[axis] > edge);
            let voxel = |axis: usize| spacing[axis] * fitting.reduce[axis] as f64;
            let reducible = (0..3).filter(|&i| dims[i] > 1);
            // An axis over the adapter's limit before all others.
            let next = reducible.min_by(|&a, &b| over(b).cmp(&over(a)).then(voxel(a).total_cmp(&voxel(b))));
            let Some(axis) = next else { return Ok(fitting) };
            fitting.reduce[axis] += 1;
        }
    }

    /// [`Error::TooLarge`] if what the options ask for is not within the limits.
    pub(super) fn check(&self, path: &Path, entry: &Entry, options: &ReadOptions) -> Result<()> {
        let part = options.window.on(path, entry.grid.dims())?;
        let entry = &*entry.taken_for(options.numbers);
        if self.admit(entry, &part) {
            return Ok(());
        }
        Err(Error::TooLarge(Box::new(TooLarge {
            path: path.to_owned(),
            entry: entry.clone(),
            dims: part.dims(),
            cost: entry.cost(&part),
            limits: *self,
            fitting: self.fit(path, entry, &options.window)?,
        })))
    }
}

/// A volume that takes more than it may. `Display` gives the sentence a user reads.
#[derive(Clone, Debug)]
pub struct TooLarge {
    /// Where.
    pub path: PathBuf,
    /// The volume.
    pub entry: Entry,
    /// The voxels that were asked for.
    pub dims: [usize; 3],
    /// What they take.
    pub cost: Cost,
    /// What they may take.
    pub limits: Limits,
    /// A window that fits.
    pub fitting: Window,
}

impl TooLarge {
    /// What is too large for what, as a clause without a remedy.
    pub fn what(&self) -> String {
        let [x, y, z] = self.dims;
        let voxels = format!("its {x} x {y} x {z} voxels");
        match (self.limits.bytes, self.limits.edge) {
            (Some(bytes), _) if self.cost.total() > bytes => {
                let (takes, free) = (bytes_in_words(self.cost.total()), bytes_in_words(bytes));
                format!("{voxels} take {takes} of memory, and it may take {free}")
            }
            (_, edge) => {
                format!("{voxels} are more than the {} along an axis that the adapter takes", edge.unwrap_or_default())
            }
        }
    }
}

impl Display for TooLarge {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let what = self.what();
        let [rx, ry, rz] = self.fitting.reduce;
        // A box of the same shape that fits, from the beginning.
        let share = self.limits.bytes.map_or(1.0, |bytes| bytes as f64 / self.cost.total() as f64).min(1.0).cbrt();
        let longest = self.limits.edge.unwrap_or(usize::MAX);
        let [hx, hy, hz] = self.dims.map(|n| ((n as f64 * share) as usize).clamp(1, longest));
        let path = self.path.display();
        write!(
            f,
            "{what}; reduce it with --reduce {rx}x{ry}x{rz}, or crop it, as in --crop 0:{hx}x0:{hy}x0:{hz} ({path})"
        )
    }
}

/// A number of bytes for people: "1.5 GB" (10⁹ bytes).
pub fn bytes_in_words(bytes: u64) -> String {
    let (number, unit) = match bytes {
        0..1_000 => return format!("{bytes} bytes"),
        1_000..1_000_000 => (bytes as f64 / 1e3, "kB"),
        1_000_000..1_000_000_000 => (bytes as f64 / 1e6, "MB"),
        _ => (bytes as f64 / 1e9, "GB"),
    };
    if number < 9.95 { format!("{number:.1} {unit}") } else { format!("{number:.0} {unit}") }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3, DVec3};

    use super::*;
    use crate::spaces::Grid;
    use crate::volume::{Modality, Orientation};

    fn entry(dims: [usize; 3], spacing: [f64; 3]) -> Entry {
        let affine = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::from_array(spacing)));
        Entry {
            key: String::new(),
            title: String::new(),
            format: String::new(),
            modality: Modality::Unknown,
            orientation: Orientation::Stated,
            grid: Grid::new(dims, affine).unwrap(),
            type_name: "int16",
            bytes_per_voxel: 2,
            num_frames: 1,
            num_files: 1,
            is_labels: false,
            is_localizer: false,
        }
    }

    #[test]
    fn the_finest_axis_gives_way_first() {
        let path = Path::new("a");
        let fit = |limits: Limits, entry: &Entry| limits.fit(path, entry, &Window::default()).unwrap().reduce;
        let scan = entry([512, 512, 60], [0.5, 0.5, 5.0]);
        let whole = scan.cost(&Window::default().on(path, [512, 512, 60]).unwrap());
        assert_eq!(whole, Cost { voxels: 512 * 512 * 60 * 2, adapter: 512 * 512 * 60 * 10 });
        let share = |n: u64| Limits { bytes: Some(whole.total() / n), edge: None };
        assert_eq!(fit(share(1), &scan), [1, 1, 1]);
        assert_eq!(fit(share(4), &scan), [2, 2, 1]);
        assert_eq!(fit(share(9), &scan), [3, 3, 1]);
        assert_eq!(fit(Limits { bytes: None, edge: Some(2048) }, &entry([5000, 300, 300], [1.0; 3])), [3, 1, 1]);
        // Nothing admits anything, and the search ends all the same.
        let one_voxel = fit(Limits { bytes: Some(1), edge: Some(0) }, &entry([7, 5, 3], [1.0; 3]));
        assert_eq!(Window { crop: None, reduce: one_voxel }.on(path, [7, 5, 3]).unwrap().num_voxels(), 1);
    }

    #[test]
    fn the_crop_that_is_proposed_fits() {
        let scan = entry([5000, 5000, 4000], [1.0; 3]);
        let limits = Limits { bytes: Some(23_000_000_000), edge: Some(2048) };
        let error = limits.check(Path::new("a"), &scan, &ReadOptions::default()).unwrap_err().to_string();
        let proposed = error.split("--crop ").nth(1).unwrap().split(' ').next().unwrap();
        let crop: Vec<_> = proposed.split('x').map(|r| [0, r.trim_start_matches("0:").parse().unwrap()]).collect();
        let window = Window { crop: Some(crop.try_into().unwrap()), ..Window::default() };
        assert!(limits.admit(&scan, &window.on(Path::new("a"), [5000, 5000, 4000]).unwrap()), "{error}");
    }

    #[test]
    fn bytes_have_words() {
        let words = [999, 1_500, 52_000_000, 9_949_999_999, 12_000_000_000].map(bytes_in_words);
        assert_eq!(words, ["999 bytes", "1.5 kB", "52 MB", "9.9 GB", "12 GB"]);
    }
}
