//! The brain: a folded cortex over white matter, deep nuclei, ventricles, cerebellum and stem.
//!
//! The folds are grown, not drawn: on a shell around each hemisphere a short-range-excitation,
//! long-range-inhibition pattern (the mechanism behind labyrinths) settles from hashed noise, held constant
//! across the depth of the shell, so that sulci cut in at right angles to the surface and keep an even width.
//! The great sulci are seeded where anatomy has them, and their neighbors line up with them.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec3, vec2, vec3};
use rayon::prelude::*;

use super::skull;
use crate::specimen::sdf::*;

/// Cerebrospinal fluid between inner table and brain, mm.
const FLUID_MM: f32 = 1.4;

/// Smooth outer hull of one hemisphere, sulci not yet cut.
pub fn hull(q: Vec3) -> f32 {
    smax(skull::cerebral_room(q) + FLUID_MM, 0.9 - q.x, 6.0)
}

/// Spacing of the grid on which folds grow, mm. It is independent of the voxels: every resolution has the same folds.
const CELL_MM: f32 = 2.0;
/// Lower corner of that grid for the positive side.
const ORIGIN: Vec3 = vec3(-8.0, -102.0, -20.0);
/// Cells along x, y, z.
const CELLS: [usize; 3] = [44, 102, 74];
/// Distance from one sulcus to the next, mm (what the two blurs below settle to).
const PERIOD_MM: f32 = 13.0;

/// A small bias toward sulci, in units of the pattern's strength: without it they break up into dimples, with much
/// more of it the gyri break up into islands.
const SULCAL: f32 = 0.13;

/// The fold pattern of one hemisphere.
pub struct Folds {
    /// About -1 in a sulcus, +1 on a gyral crown.
    crown: Vec<f32>,
}

fn index(x: usize, y: usize, z: usize) -> usize {
    x + CELLS[0] * (y + CELLS[1] * z)
}

fn position(i: usize) -> Vec3 {
    let (x, y, z) = (i % CELLS[0], i / CELLS[0] % CELLS[1], i / CELLS[0] / CELLS[1]);
    ORIGIN + vec3(x as f32, y as f32, z as f32) * CELL_MM
}

/// Distance from the courses of the great sulci, mm.
fn great_sulci(q: Vec3) -> f32 {
    let central = chain(
        q,
        &[
            (vec3(6.0, -16.0, 110.0), 0.0),
            (vec3(30.0, -8.0, 102.0), 0.0),
            (vec3(50.0, 0.0, 80.0), 0.0),
            (vec3(62.0, 10.0, 46.0), 0.0),
        ],
        0.1,
    );
    let sylvian =
        chain(q, &[(vec3(45.0, 42.0, 18.0), 0.0), (vec3(64.0, 10.0, 28.0), 0.0), (vec3(66.0, -34.0, 40.0), 0.0)], 0.1);
    let temporal = chain(
        q,
        &[
            (vec3(54.0, 36.0, 8.0), 0.0),
            (vec3(64.0, 0.0, 10.0), 0.0),
            (vec3(64.0, -36.0, 22.0), 0.0),
            (vec3(54.0, -58.0, 46.0), 0.0),
        ],
        0.1,
    );
    let frontal =
        chain(q, &[(vec3(24.0, 78.0, 56.0), 0.0), (vec3(27.0, 50.0, 86.0), 0.0), (vec3(27.0, 14.0, 103.0), 0.0)], 0.1);
    let parietal = chain(
        q,
        &[(vec3(44.0, -24.0, 88.0), 0.0), (vec3(34.0, -48.0, 88.0), 0.0), (vec3(26.0, -74.0, 66.0), 0.0)],
        0.1,
    );
    let cingulate = chain(
        q,
        &[
            (vec3(1.0, 55.0, 32.0), 0.0),
            (vec3(1.0, 50.0, 58.0), 0.0),
            (vec3(1.0, 10.0, 74.0), 0.0),
            (vec3(1.0, -34.0, 68.0), 0.0),
        ],
        0.1,
    );
    let occipital =
        chain(q, &[(vec3(1.0, -66.0, 68.0), 0.0), (vec3(1.0, -50.0, 30.0), 0.0), (vec3(1.0, -84.0, 26.0), 0.0)], 0.1);
    central.min(sylvian).min(temporal).min(frontal).min(parietal).min(cingulate).min(occipital)
}

/// One pass of a three-tap binomial blur along every axis: variance of half a cell² each.
fn blur(field: &mut Vec<f32>, spare: &mut Vec<f32>) {
    let [nx, ny, nz] = CELLS;
    let layer = nx * ny;
    let source: &[f32] = field;
    spare.par_chunks_mut(layer).enumerate().for_each(|(z, out)| {
        // Along z into `out`, then along y and x within the layer.
        let at = |z: usize| &source[z * layer..][..layer];
        let (below, here, above) = (at(z.saturating_sub(1)), at(z), at((z + 1).min(nz - 1)));
        let mut rows = vec![0.0; layer];
        for (((r, a), b), c) in rows.iter_mut().zip(below).zip(here).zip(above) {
            *r = 0.25 * (a + c) + 0.5 * b;
        }
        for y in 0..ny {
            let at = |y: usize| &rows[y * nx..][..nx];
            let (a, b, c) = (at(y.saturating_sub(1)), at(y), at((y + 1).min(ny - 1)));
            let mut before = 0.25 * (a[0] + c[0]) + 0.5 * b[0];
            let mut now = before;
            for x in 0..nx {
                let k = (x + 1).min(nx - 1);
                let after = 0.25 * (a[k] + c[k]) + 0.5 * b[k];
                out[y * nx + x] = 0.25 * (before + after) + 0.5 * now;
                (before, now) = (now, after);
            }
        }
    });
    std::mem::swap(field, spare);
}

/// A soft limit to ±1, steepness 1 at 0.
fn squash(u: f32) -> f32 {
    u / (1.0 + u * u).sqrt()
}

impl Folds {
    /// Grows the folds of the hemisphere of `seed`.
    pub fn grow(seed: u32) -> Self {
        let count = CELLS[0] * CELLS[1] * CELLS[2];
        // Depth below the hull and where each shell cell takes its value from: the surface 4 mm deep.
        let depth: Vec<f32> = (0..count).into_par_iter().map(|i| hull(position(i))).collect();
        let gather: Vec<Option<[f32; 3]>> = (0..count)
            .into_par_iter()
            .map(|i| {
                if !(-20.0..14.0).contains(&depth[i]) {
                    return None;
                }
                let mut p = position(i);
                for _ in 0..2 {
                    let e = 1.0;
                    let h = hull(p);
                    let g = vec3(
                        hull(p + Vec3::X * e) - hull(p - Vec3::X * e),
                        hull(p + Vec3::Y * e) - hull(p - Vec3::Y * e),
                        hull(p + Vec3::Z * e) - hull(p - Vec3::Z * e),
                    )
                    .normalize_or_zero();
                    p -= g * (h + 4.0);
                }
                Some(((p - ORIGIN) / CELL_MM).to_array())
            })
            .collect();
        let pull: Vec<f32> = (0..count)
            .into_par_iter()
            .map(|i| if gather[i].is_some() { -0.9 * bump(great_sulci(position(i)), 6.0) } else { 0.0 })
            .collect();
        let mut field: Vec<f32> = (0..count).map(|i| unit(hash(i as i32, 0, 0, seed)) * 2.0 - 1.0).collect();
        let mut spare = vec![0.0; count];
        const ROUNDS: usize = 30;
        for round in 0..ROUNDS {
            // Two blurs of σ 1 and 2.2 cells; their difference passes periods near PERIOD_MM.
            for _ in 0..2 {
                blur(&mut field, &mut spare);
            }
            let near = field.clone();
            for _ in 0..7 {
                blur(&mut field, &mut spare);
            }
            let last = round + 1 == ROUNDS;
            let response: Vec<f32> = (0..count)
                .into_par_iter()
                .map(|i| {
                    if gather[i].is_none() {
                        return 0.0;
                    }
                    near[i] - field[i]
                })
                .collect();
            let mean = {
                // In index order: the sum does not depend on the threads.
                let (sum, n) = response
                    .iter()
                    .zip(&gather)
                    .filter(|(_, g)| g.is_some())
                    .fold((0.0_f64, 0.0_f64), |(s, n), (r, _)| (s + f64::from(r * r), n + 1.0));
                (sum / n.max(1.0)).sqrt() as f32
            };
            let gain = 1.0 / mean.max(1e-6);
            field = (0..count)
                .into_par_iter()
                .map(|i| match gather[i] {
                    Some(at) => {
                        let u = trilinear(&response, at) * gain + pull[i] - SULCAL;
                        // At the end the pattern is driven to its plateaus: every sulcus is cut through.
                        squash(if last { 5.0 * u } else { 2.0 * u })
                    }
                    None => 0.0,
                })
                .collect();
        }
        // Rounded again, the plateaus become waves of even height.
        for _ in 0..2 {
            blur(&mut field, &mut spare);
        }
        Self { crown: field }
    }

    /// The pattern at a position on the positive side: cubic B-spline, so that its gradient is smooth.
    fn at(&self, q: Vec3) -> f32 {
        let g = (q - ORIGIN) / CELL_MM;
        let base = g.floor();
        let weights = |t: f32| {
            let s = 1.0 - t;
            [
                s * s * s / 6.0,
                (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
                (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
                t * t * t / 6.0,
            ]
        };
        let f = g - base;
        let (wx, wy, wz) = (weights(f.x), weights(f.y), weights(f.z));
        let b = [base.x as i32 - 1, base.y as i32 - 1, base.z as i32 - 1];
        if (0..3).any(|a| b[a] < 0 || b[a] + 3 >= CELLS[a] as i32) {
            return 1.0;
        }
        let b = b.map(|v| v as usize);
        let mut sum = 0.0;
        for (k, wz) in wz.into_iter().enumerate() {
            for (j, wy) in wy.into_iter().enumerate() {
                let row = &self.crown[index(b[0], b[1] + j, b[2] + k)..][..4];
                sum += wz * wy * (row[0] * wx[0] + row[1] * wx[1] + row[2] * wx[2] + row[3] * wx[3]);
            }
        }
        sum
    }
}

fn trilinear(field: &[f32], at: [f32; 3]) -> f32 {
    let mut base = [0; 3];
    let mut f = [0.0; 3];
    for a in 0..3 {
        let v = at[a].clamp(0.0, CELLS[a] as f32 - 1.001);
        base[a] = v as usize;
        f[a] = v - base[a] as f32;
    }
    let v = |dx: usize, dy: usize, dz: usize| field[index(base[0] + dx, base[1] + dy, base[2] + dz)];
    let row = |dy, dz| mix(v(0, dy, dz), v(1, dy, dz), f[0]);
    mix(mix(row(0, 0), row(1, 0), f[1]), mix(row(0, 1), row(1, 1), f[1]), f[2])
}

/// The parts of the brain at a position.
pub struct Parts {
    /// Surface of the cerebrum, sulci cut.
    pub cerebrum: f32,
    /// White matter inside it.
    pub white: f32,
    /// Deep gray nuclei.
    pub nuclei: f32,
}

/// The core that joins the hemispheres: thalami, hypothalamus, the stalk of the midbrain.
pub fn core(q: Vec3) -> f32 {
    ellipsoid(q - vec3(0.0, -4.0, 27.0), vec3(20.0, 25.0, 15.0))
}

/// Corpus callosum, flattened from side to side as it fans into the hemispheres.
fn callosum(q: Vec3) -> f32 {
    let s = vec3(q.x * 0.35, q.y, q.z);
    chain(
        s,
        &[
            (vec3(0.0, 27.0, 33.0), 2.2),
            (vec3(0.0, 37.0, 37.0), 4.6),
            (vec3(0.0, 34.0, 47.0), 4.2),
            (vec3(0.0, 14.0, 55.0), 3.4),
            (vec3(0.0, -14.0, 56.0), 3.2),
            (vec3(0.0, -32.0, 50.0), 4.0),
            (vec3(0.0, -38.0, 43.0), 5.0),
        ],
        3.0,
    )
}

/// Cerebrum at `p` (world mm), with the folds of its side.
pub fn cerebrum(p: Vec3, folds: &Folds) -> Parts {
    let q = vec3(p.x.abs(), p.y, p.z);
    let smooth = hull(q);
    // Depth of the folds fades out over the middle, where the callosum and the stem leave the hemisphere.
    let center = core(q).min(callosum(q));
    let u = folds.at(q);
    // From the pattern to the distance from the middle of the sulcus, mm.
    let from_sulcus = (acos(-u / 0.81)) * (PERIOD_MM / TAU);
    let depth = -smooth;
    let floor = 13.0 * smoothstep(2.0, 12.0, center);
    // Sulci gape at the surface and are slits below.
    let half_width = mix(0.75, 0.7, smoothstep(0.0, 6.0, depth));
    let slit = smax(from_sulcus - half_width, depth - floor, 2.5);
    let mut d = smax(smooth, -slit, 3.3);
    // Sylvian fissure: a slanting sheet, 20 mm deep, that frees the temporal lobe.
    let line = q.z - 26.5 + 0.29 * (q.y - 10.0) - 1.6 * noise(vec3(q.y * 0.06, q.x * 0.03, 0.5), 31);
    let sheet =
        smax(line.abs() * 0.95 - mix(0.9, 2.0, smoothstep(10.0, 44.0, q.y)), smax(42.0 - q.x, -36.0 - q.y, 3.0), 3.0);
    d = smax(d, -sheet, 4.0);
    let body = smin(smin(d, core(q), 4.0), callosum(q), 2.0);
    // Cortex is 2.8 mm thick.
    let white = smin(smax(d + 2.8, smooth + 3.0, 2.0), callosum(q), 3.0);
    let thalamus = ellipsoid(q - vec3(11.0, -11.0, 33.0), vec3(9.0, 15.0, 9.0));
    let caudate =
        chain(q, &[(vec3(14.5, 27.0, 38.0), 6.0), (vec3(16.0, 8.0, 45.0), 3.5), (vec3(18.5, -16.0, 46.0), 2.2)], 3.0);
    let putamen = ellipsoid(turn_z(q - vec3(26.0, 9.0, 30.0), 0.2), vec3(5.0, 18.0, 11.0));
    Parts { cerebrum: body, white, nuclei: thalamus.min(caudate).min(putamen) }
}

/// The ventricles: lateral with frontal, occipital and temporal horns, third, aqueduct, fourth.
pub fn ventricles(q: Vec3) -> f32 {
    let lateral = chain(
        q,
        &[
            (vec3(7.0, 33.0, 39.0), 3.6),
            (vec3(8.0, 18.0, 46.0), 4.2),
            (vec3(10.0, -8.0, 50.0), 4.0),
            (vec3(16.0, -28.0, 45.0), 5.0),
            (vec3(24.0, -40.0, 35.0), 6.8),
            (vec3(23.0, -62.0, 27.0), 2.2),
        ],
        5.0,
    );
    let horn = chain(
        q,
        &[
            (vec3(24.5, -40.0, 34.0), 5.5),
            (vec3(33.0, -26.0, 18.0), 3.4),
            (vec3(35.0, -4.0, 8.0), 3.0),
            (vec3(34.0, 14.0, 5.0), 2.2),
        ],
        4.0,
    );
    let third = smax(q.x - 1.9, ellipse(vec2(q.y + 3.0, q.z - 30.0), vec2(15.0, 11.0)), 1.5);
    let aqueduct = cone(q, vec3(0.0, -16.0, 26.0), vec3(0.0, -20.0, 4.0), 1.3, 1.6);
    let fourth = ellipsoid(q - vec3(0.0, -24.0, -4.0), vec3(8.0, 4.5, 11.0));
    smin(lateral, horn, 4.0).min(third).min(aqueduct).min(fourth)
}

/// Cerebellum before its furrows are cut.
pub fn cerebellum_hull(q: Vec3) -> f32 {
    let room = smax(skull::posterior_fossa(q) + 2.0, q.z - skull::cerebral_floor(q) + 1.5, 3.0);
    let lobes = ellipsoid(q - vec3(23.0, -48.0, -4.0), vec3(31.0, 35.0, 29.0));
    let vermis = ellipsoid(q - vec3(0.0, -44.0, 0.0), vec3(15.0, 31.0, 26.0));
    smax(room, smin(lobes, vermis, 6.0), 6.0)
}

/// Cerebellum surface and its white matter.
pub fn cerebellum(q: Vec3) -> (f32, f32) {
    let smooth = cerebellum_hull(q);
    if smooth > 4.0 {
        return (smooth, smooth + 3.0);
    }
    // Leaves fan out from the fourth ventricle: their furrows run from side to side.
    let a = vec2(-(q.y + 20.0), q.z + 4.0 - 0.08 * q.x);
    let wave = 1.2 * noise(q * 0.09, 77);
    let radius = a.length().max(6.0);
    // The octant-free angle a.y / (|a.x| + |a.y|) stands in for the true one; leaves are even enough.
    let t = a.y / (a.x.abs() + a.y.abs()).max(1.0);
    let angle = if a.x < 0.0 { t.signum() * 2.0 - t } else { t } * FRAC_PI_2 + wave * 0.05;
    let spacing = 0.105;
    let k = angle / spacing;
    let off = (k - k.round()).abs() * spacing * radius;
    // Every fourth furrow is a fissure.
    let major = (k.round() as i32).rem_euclid(4) == 0;
    let (deep, half) = if major { (8.0, 0.6) } else { (3.4, 0.3) };
    let furrow = smax(off - half, -smooth - deep, 1.0);
    let d = smax(smooth, -furrow, 1.8);
    (d, smax(d + 1.5, smooth + 4.5 - 3.0 * bump(off - spacing * radius * 0.5, 1.2), 1.5))
}

/// Midbrain, pons, medulla and the cord below.
pub fn stem(q: Vec3) -> f32 {
    let trunk = chain(
        q,
        &[
            (vec3(0.0, -6.0, 22.0), 12.0),
            (vec3(0.0, -10.0, 4.0), 11.5),
            (vec3(0.0, -14.0, -14.0), 9.5),
            (vec3(0.0, -19.5, -32.0), 6.0),
            (vec3(0.0, -21.0, -50.0), 5.4),
            (vec3(0.0, -20.0, -135.0), 5.4),
        ],
        6.0,
    );
    let pons = ellipsoid(q - vec3(0.0, -7.0, -1.0), vec3(17.0, 12.0, 13.0));
    let peduncle = cone(q, vec3(13.0, -12.0, -3.0), vec3(22.0, -30.0, -6.0), 6.5, 6.0);
    smin(smin(trunk, pons, 4.0), peduncle, 5.0)
}
