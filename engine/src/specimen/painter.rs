//! What all specimens share: parts painted over each other with their coverage, brick by brick, and the scanner that
//! takes the picture (its blur, noise, contrast and calibration).

use glam::{DAffine3, DMat3, DVec3, Vec3, vec3};
use rayon::prelude::*;

use super::Specimen;
use super::sdf::{noise, normal};
use super::variant::{Contrast, Variant};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::spaces::Grid;
use crate::volume::labels::{Label, LabelMap};
use crate::volume::{Modality, Rescale, Volume, Voxels};

/// Width of a boundary in voxels, from nothing to full coverage: 1.5 voxels at half maximum, as a scanner's point
/// spread would leave it. Sharper edges alias, and normals from central differences show terraces.
pub const BLUR_VOXELS: f32 = 2.2;

/// Value of air in a magnetic resonance image.
const MR_AIR: f32 = 0.0;

/// Standard deviation of the noise in a magnetic resonance image unless a variant says otherwise; fat has 900.
const MR_NOISE: f32 = 12.0;

/// Edge of the cells in which a turned specimen's extent is looked for, mm.
const CELL_MM: f64 = 6.0;

/// One structure of a specimen.
pub struct Structure {
    /// Its name.
    pub name: &'static str,
    /// Its sRGB color.
    pub color: [u8; 3],
    /// Two densities and the magnetic resonance signals that they stand for (clamped beyond them): what is modeled in
    /// HU is seen by another scanner. Equal densities mean one signal throughout.
    pub signal: [(f32, f32); 2],
}

/// A [`Structure`] of one signal.
pub const fn structure(name: &'static str, color: [u8; 3], signal: f32) -> Structure {
    Structure { name, color, signal: [(0.0, signal), (0.0, signal)] }
}

/// A bone: its compact part is black to magnetic resonance, its marrow is fat.
pub const fn bone(name: &'static str, color: [u8; 3], compact: f32) -> Structure {
    Structure { name, color, signal: [(400.0, 520.0), (compact, 35.0)] }
}

/// What a kind of specimen is, apart from its shape.
pub struct Plan {
    /// As in `specimen:NAME`.
    pub name: &'static str,
    /// The box of the plain specimen, mm; symmetric in x, so that a mirrored one fits.
    pub bounds: (DVec3, DVec3),
    /// The plane z = mm where the specimen ends at the box's floor, if it does; a turned one shows it as a cut face.
    pub cut_z: Option<f32>,
    /// Value of what is around it.
    pub air: f32,
    /// Standard deviation of the noise unless a variant says otherwise. Air outside stays clean.
    pub noise: f32,
    /// How far above air a value has all the noise.
    pub noise_range: f32,
    /// What the values are, and what magnetic resonance would be.
    pub modality: Modality,
    /// The structures; entry 0 is the background.
    pub structures: &'static [Structure],
}

impl Plan {
    /// The position of the structure that a variant calls `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.structures.iter().skip(1).position(|s| s.name.replace(' ', "-") == name).map(|i| i + 1)
    }
}

/// A shape: where which structure is, in mm.
pub trait Model: Sync {
    /// Which parts can matter anywhere in a brick.
    type Scope;

    /// What can matter within `radius` mm of `center`; `None` if there is only air.
    fn scope(&self, center: Vec3, radius: f32) -> Option<Self::Scope>;

    /// Paints what is at `p`.
    fn paint(&self, p: Vec3, scope: &Self::Scope, paint: &mut Paint<'_>);
}

/// What accumulates at one voxel: parts are painted over each other with their coverage.
pub struct Paint<'a> {
    /// The value so far.
    pub value: f32,
    /// The structure that owns the voxel's center so far.
    pub part: u16,
    /// Width of a boundary, mm.
    pub blur: f32,
    /// 1 / width of the blur at a boundary, 1/mm.
    sharpness: f32,
    scanner: &'a Scanner,
}

/// What decides about the value of a structure.
pub struct Scanner {
    structures: &'static [Structure],
    air: f32,
    is_mr: bool,
    /// Bits of the structures that are left out.
    missing: u64,
}

impl Scanner {
    /// The scanner of a variant.
    pub fn new(plan: &Plan, variant: &Variant) -> Self {
        let is_mr = variant.contrast == Contrast::Mr;
        let air = if is_mr { MR_AIR } else { plan.air };
        let missing = variant.missing.iter().filter_map(|name| plan.find(name)).fold(0, |m, i| m | 1 << i);
        Self { structures: plan.structures, air, is_mr, missing }
    }

    fn value(&self, value: f32, part: u16) -> f32 {
        if !self.is_mr {
            return value;
        }
        let [(from, low), (to, high)] = self.structures[usize::from(part)].signal;
        if from == to { low } else { low + (high - low) * ((value - from) / (to - from)).clamp(0.0, 1.0) }
    }
}

impl<'a> Paint<'a> {
    /// Nothing but air yet; `blur` mm wide boundaries.
    pub fn new(blur: f32, scanner: &'a Scanner) -> Self {
        Self { value: scanner.air, part: 0, blur, sharpness: 1.0 / blur, scanner }
    }

    /// Coverage of a part whose surface is `d` mm away: a smooth step over [`BLUR_VOXELS`].
    #[inline]
    fn cover(&self, d: f32) -> f32 {
        let t = (0.5 - d * self.sharpness).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// Whether the variant leaves a part out.
    pub fn lacks(&self, part: impl Into<u16>) -> bool {
        self.scanner.missing >> part.into() & 1 != 0
    }

    /// Paints a part whose surface is `d` mm away over what is there.
    #[inline]
    pub fn put(&mut self, d: f32, value: f32, part: impl Into<u16>) {
        let c = self.cover(d);
        if c > 0.0 {
            let part = part.into();
            if self.lacks(part) {
                return;
            }
            self.value += (self.scanner.value(value, part) - self.value) * c;
            if d <= 0.0 {
                self.part = part;
            }
        }
    }

    /// Changes the density within a part without giving it another name.
    #[inline]
    pub fn tint(&mut self, d: f32, value: f32, part: impl Into<u16>) {
        let c = self.cover(d);
        if c > 0.0 {
            let part = part.into();
            if !self.lacks(part) {
                self.value += (self.scanner.value(value, part) - self.value) * c;
            }
        }
    }

    /// Takes away what lies beyond a cut whose face is `d` mm away (negative where the specimen stays).
    fn cut(&mut self, d: f32) {
        self.value += (self.scanner.air - self.value) * (1.0 - self.cover(d));
        if d > 0.0 {
            self.part = 0;
        }
    }
}

/// Where a point of the world lies in the plain specimen. The size is not part of it: it belongs to the grid.
struct Pose {
    /// The plain specimen's axes in the turned one's frame; `None` if it is not turned.
    turn: Option<DMat3>,
    mirrored: bool,
}

impl Pose {
    fn new(variant: &Variant) -> Self {
        let turn = (variant.turn_deg != [0.0; 3]).then(|| variant.rotation());
        Self { turn, mirrored: variant.mirrored }
    }

    fn plain(&self, p: DVec3) -> Vec3 {
        let mut q = self.turn.map_or(p, |turn| turn.transpose() * p).as_vec3();
        if self.mirrored {
            q = vec3(-q.x, q.y, q.z);
        }
        q
    }
}

/// The box of a specimen that is posed otherwise than its plan says: that of the cells with anything in them.
fn tight_bounds<M: Model>(model: &M, plan: &Plan, pose: &Pose, progress: &Progress) -> Result<(DVec3, DVec3)> {
    let (lo, hi) = plan.bounds;
    let corner = |i: usize| {
        let pick = |bit: usize, a: f64, b: f64| if i >> bit & 1 == 0 { a } else { b };
        let p = DVec3::new(pick(0, lo.x, hi.x), pick(1, lo.y, hi.y), pick(2, lo.z, hi.z));
        pose.turn.map_or(p, |turn| turn * p)
    };
    let (from, to) = (1..8).map(corner).fold((corner(0), corner(0)), |(a, b), p| (a.min(p), b.max(p)));
    let cells = ((to - from) / CELL_MM).ceil().to_array().map(|n| n as usize + 1);
    let half = DVec3::splat(0.5 * CELL_MM);
    let radius = half.length() as f32;
    let occupied = |x: usize, y: usize, z: usize| {
        let center = from + half + DVec3::new(x as f64, y as f64, z as f64) * CELL_MM;
        let p = pose.plain(center);
        let beyond_cut = plan.cut_z.is_some_and(|z| p.z < z - radius);
        (!beyond_cut && model.scope(p, radius).is_some()).then_some(center)
    };
    let slices: Vec<Option<(DVec3, DVec3)>> = (0..cells[2])
        .into_par_iter()
        .map(|z| {
            let rows = (0..cells[1]).flat_map(|y| (0..cells[0]).map(move |x| (x, y)));
            rows.filter_map(|(x, y)| occupied(x, y, z)).fold(None, |found: Option<(DVec3, DVec3)>, p| {
                Some(found.map_or((p, p), |(a, b)| (a.min(p), b.max(p))))
            })
        })
        .collect();
    progress.check()?;
    let all = slices.into_iter().flatten().reduce(|(a, b), (c, d)| (a.min(c), b.max(d)));
    Ok(all.map_or((from, to), |(a, b)| (a - half, b + half)))
}

/// Makes a specimen with `resolution` voxels along its longest axis.
pub fn generate<M: Model>(
    model: &M,
    plan: &Plan,
    resolution: usize,
    variant: &Variant,
    progress: &Progress,
) -> Result<Specimen> {
    let pose = Pose::new(variant);
    let is_posed = pose.turn.is_some() || variant.drawn_in != 0.0;
    let (box_min, box_max) =
        if is_posed { tight_bounds(model, plan, &pose, progress)? } else { (plan.bounds.0, plan.bounds.1) };
    let size = box_max - box_min;
    let spacing = size.max_element() / resolution as f64;
    let dims = size.to_array().map(|mm| ((mm / spacing).round() as usize).max(1));
    let [nx, ny, nz] = dims;
    progress.begin(&format!("generating specimen:{}", plan.name), nz as u64);
    // Centered in the box: halving the resolution keeps the anatomy where it is.
    let extent = DVec3::new((nx - 1) as f64, (ny - 1) as f64, (nz - 1) as f64) * spacing;
    let origin = (box_min + box_max - extent) * 0.5;
    // Everything is modeled in the millimeters of the plain specimen; only the grid knows another size.
    let affine = DAffine3::from_mat3_translation(
        DMat3::from_diagonal(DVec3::splat(spacing * variant.size)),
        origin * variant.size,
    );
    let broken = |what: String| Error::scene(what, "choose another resolution");
    let grid = Grid::new(dims, affine).map_err(broken)?;

    // Bricks of about 8 mm.
    let edge = ((8.0 / spacing).floor() as usize).clamp(1, 16);
    let blur = BLUR_VOXELS * spacing as f32;
    let scanner = Scanner::new(plan, variant);
    let signal = Signal::new(plan, variant, size);
    let at = |x: f64, y: f64, z: f64| pose.plain(origin + DVec3::new(x, y, z) * spacing);
    let cut = plan.cut_z.filter(|_| pose.turn.is_some());
    let mut voxels = vec![signal.stored(scanner.air); nx * ny * nz];
    let mut labels = vec![0_u16; nx * ny * nz];
    voxels.par_chunks_mut(nx * ny * edge).zip(labels.par_chunks_mut(nx * ny * edge)).enumerate().try_for_each(
        |(slab, (voxels, labels))| -> Result<()> {
            let z0 = slab * edge;
            let depth = voxels.len() / (nx * ny);
            for y0 in (0..ny).step_by(edge) {
                progress.check()?;
                for x0 in (0..nx).step_by(edge) {
                    let (x1, y1) = ((x0 + edge).min(nx), (y0 + edge).min(ny));
                    let middle = |a: usize, b: usize| (a + b - 1) as f64 * 0.5;
                    let center = at(middle(x0, x1), middle(y0, y1), middle(z0, z0 + depth));
                    let half = DVec3::new((x1 - x0) as f64, (y1 - y0) as f64, depth as f64) * (0.5 * spacing);
                    let Some(scope) = model.scope(center, half.length() as f32) else { continue };
                    for z in 0..depth {
                        for y in y0..y1 {
                            for x in x0..x1 {
                                let p = at(x as f64, y as f64, (z0 + z) as f64);
                                let mut paint = Paint::new(blur, &scanner);
                                model.paint(p, &scope, &mut paint);
                                if let Some(cut) = cut {
                                    paint.cut(cut - p.z);
                                }
                                let i = x + nx * (y + ny * z);
                                voxels[i] = signal.seen(paint.value, [x, y, z0 + z], spacing);
                                labels[i] = paint.part;
                            }
                        }
                    }
                }
            }
            progress.advance(depth as u64)
        },
    )?;

    let mut volume = Volume::new(grid, Voxels::I16(voxels), Rescale::IDENTITY, "specimen").map_err(broken)?;
    volume.modality = variant.modality(plan.modality);
    let label = |(s, id): (&Structure, u32)| Label { id, name: s.name.to_owned(), color: s.color, code: None };
    let labels = LabelMap {
        grid,
        voxels: labels,
        labels: plan.structures.iter().zip(0..).map(label).collect(),
        notes: Vec::new(),
    };
    Ok(Specimen { volume, labels })
}

/// From what is there to the stored number: bias field, noise, calibration.
struct Signal {
    air: f32,
    noise: f32,
    noise_range: f32,
    range: (f32, f32),
    /// Wave number of the bias field, 1/mm.
    bias: Option<f32>,
    calibration: Option<(f64, f64)>,
}

impl Signal {
    fn new(plan: &Plan, variant: &Variant, size: DVec3) -> Self {
        let is_mr = variant.contrast == Contrast::Mr;
        Self {
            air: if is_mr { MR_AIR } else { plan.air },
            noise: variant.noise.map_or(if is_mr { MR_NOISE } else { plan.noise }, |sd| sd as f32),
            noise_range: if is_mr { 150.0 } else { plan.noise_range },
            range: if is_mr { (0.0, 4095.0) } else { (-1024.0, 3071.0) },
            bias: is_mr.then(|| 2.0 / size.max_element() as f32),
            calibration: (variant.slope != 1.0 || variant.offset != 0.0).then_some((variant.slope, variant.offset)),
        }
    }

    /// Noise is that of the scanner: it belongs to the voxel, not to the place in the specimen.
    fn seen(&self, mut value: f32, [x, y, z]: [usize; 3], spacing: f64) -> i16 {
        let tissue = ((value - self.air) / self.noise_range).clamp(0.0, 1.0);
        if let Some(wave) = self.bias {
            let at = vec3(x as f32, y as f32, z as f32) * (spacing as f32 * wave);
            value *= 1.0 + 0.22 * noise(at + Vec3::splat(0.4), 71);
        }
        let noise = self.noise * tissue * normal(x, y, z, 99);
        self.stored(value + noise)
    }

    fn stored(&self, value: f32) -> i16 {
        let raw = value.round().clamp(self.range.0, self.range.1);
        match self.calibration {
            None => raw as i16,
            Some((slope, offset)) => (f64::from(raw) * slope + offset).round() as i16,
        }
    }
}
