//! What lies within the shell: girdles, ribs and organs.

use glam::{Vec3, vec3};

use super::limbs::Head;
use super::shell;
use crate::specimen::sdf::*;

/// The eight pairs of ribs along the inside of the carapace, heads at the spine.
pub fn ribs(q: Vec3) -> f32 {
    let depth = shell::under_dome(q);
    if !(-12.0..=6.0).contains(&depth) || q.z < 2.0 || q.y.abs() > 62.0 {
        return 1e3;
    }
    let i = ((q.y + 1.0) / 14.0 - 0.5).round().clamp(-4.0, 3.0) + 0.5;
    // They fan out a little toward the sides.
    let course = i * 14.0 * (1.0 + 0.0022 * q.x) - 1.0;
    let arch = 3.6 * bump(q.x, 15.0);
    let width = mix(2.5, 1.7, smoothstep(10.0, 62.0, q.x));
    let d = ((q.y - course).powi(2) + (depth + 1.6 + arch).powi(2)).sqrt() - width;
    smax(d, 9.0 - q.z, 3.0)
}

/// Shoulder blade, its branch to the midline and the coracoid behind it.
pub fn shoulder_girdle(q: Vec3) -> f32 {
    let socket = vec3(35.0, 53.0, -6.0);
    let blade = chain(q, &[(socket, 5.6), (vec3(30.0, 51.0, 10.0), 3.0), (vec3(23.0, 47.0, 31.0), 3.2)], 4.0);
    let branch = chain(q, &[(socket, 5.0), (vec3(20.0, 50.0, -12.0), 2.6), (vec3(5.5, 46.0, -14.5), 2.8)], 3.0);
    let flat = vec3(q.x, q.y, q.z * 1.8);
    let coracoid = chain(
        flat,
        &[(vec3(34.0, 51.0, -12.0), 4.5), (vec3(25.0, 38.0, -24.0), 3.4), (vec3(14.0, 22.0, -28.0), 7.0)],
        4.0,
    );
    smin(smin(blade, branch, 3.0), coracoid * 0.75, 3.0)
}

/// Ilium, pubis and ischium.
pub fn pelvis(q: Vec3) -> f32 {
    let socket = vec3(28.0, -59.0, -5.0);
    let ilium = chain(q, &[(socket, 6.0), (vec3(22.0, -64.0, 8.0), 3.6), (vec3(10.0, -68.0, 24.0), 4.2)], 4.0);
    let flat = vec3(q.x, q.y, q.z * 1.8);
    let pubis = chain(
        flat,
        &[(vec3(25.0, -57.0, -15.0), 4.4), (vec3(13.0, -44.0, -26.0), 6.4), (vec3(3.0, -46.0, -26.0), 5.0)],
        4.0,
    );
    let ischium = chain(
        flat,
        &[(vec3(24.0, -64.0, -15.0), 4.2), (vec3(12.0, -73.0, -26.0), 5.0), (vec3(3.0, -70.0, -26.0), 4.4)],
        4.0,
    );
    smin(ilium, smin(pubis, ischium, 3.0) * 0.75, 4.0)
}

/// The muscles inside the trunk: at the girdles, between them and the plastron.
pub fn girdle_muscles(q: Vec3) -> f32 {
    let breast = ellipsoid(q - vec3(22.0, 42.0, -13.0), vec3(24.0, 30.0, 8.0));
    let blade = cone(q, vec3(33.0, 55.0, -2.0), vec3(26.0, 50.0, 22.0), 11.0, 6.0);
    let hip = ellipsoid(q - vec3(24.0, -60.0, -10.0), vec3(22.0, 24.0, 11.0));
    let ilium = cone(q, vec3(26.0, -62.0, 0.0), vec3(14.0, -68.0, 20.0), 10.0, 6.0);
    breast.min(blade).min(hip).min(ilium)
}

/// Both lungs, under the carapace beside the spine, as far down as the other organs let them.
pub fn lungs(q: Vec3) -> f32 {
    let lobe = ellipsoid(q - vec3(26.0, -4.0, 24.0), vec3(25.0, 50.0, 24.0));
    let roof = shell::under_dome(q) + 4.5;
    let column = 6.5 - q.x;
    smax(smax(lobe, roof, 5.0), smax(column, 12.0 + 0.10 * q.y - q.z, 6.0), 6.0)
}

/// The tubes of the lungs: a stem with branches, for one side.
fn bronchi() -> Vec<Course> {
    let mut all = Vec::new();
    for side in [1.0_f32, -1.0] {
        let at = |x: f32, y: f32, z: f32| vec3(side * x, y, z);
        all.push(Course::new(
            &[
                (vec3(0.0, 52.0, 6.0), 2.6),
                (at(14.0, 38.0, 16.0), 2.4),
                (at(23.0, 10.0, 24.0), 2.0),
                (at(22.0, -34.0, 26.0), 1.2),
            ],
            6,
        ));
        for i in 0..5 {
            let y = 26.0 - 12.0 * i as f32;
            all.push(Course::new(
                &[(at(20.0, y + 4.0, 23.0), 1.4), (at(32.0, y - 2.0, 25.0), 1.2), (at(42.0, y - 6.0, 18.0), 0.8)],
                4,
            ));
        }
    }
    all
}

/// The courses of hollow organs.
pub struct Courses {
    /// Windpipe; its tubes in the lungs.
    pub trachea: Course,
    pub bronchi: Vec<Course>,
    pub gullet: Course,
    pub stomach: Course,
    pub intestine: Course,
    pub colon: Course,
    pub vessels: Vec<Course>,
}

impl Courses {
    pub fn new(head: &Head) -> Self {
        let [throat, neck, chest] = head.throat();
        let right = vec3(4.0, 0.0, 1.0);
        let left = vec3(-4.5, 0.0, 0.0);
        let trachea =
            Course::new(&[(throat, 2.4), (neck + right, 2.7), (chest + right, 2.8), (vec3(0.0, 52.0, 6.0), 2.9)], 8);
        let gullet = Course::new(
            &[
                (throat + left, 2.6),
                (neck + left, 3.0),
                (chest + left, 3.4),
                (vec3(-10.0, 48.0, 0.0), 4.0),
                (vec3(-24.0, 38.0, 4.0), 5.0),
            ],
            6,
        );
        // The stomach lies on the LEFT.
        let stomach = Course::new(
            &[
                (vec3(-24.0, 38.0, 4.0), 5.0),
                (vec3(-36.0, 26.0, 3.0), 9.0),
                (vec3(-43.0, 6.0, 0.0), 11.0),
                (vec3(-38.0, -14.0, -4.0), 10.0),
                (vec3(-22.0, -20.0, -8.0), 7.0),
                (vec3(-6.0, -14.0, -9.0), 5.0),
            ],
            8,
        );
        let intestine = Course::new(
            &[
                (vec3(-6.0, -14.0, -9.0), 4.6),
                (vec3(12.0, -12.0, -11.0), 4.6),
                (vec3(33.0, -20.0, -9.0), 4.6),
                (vec3(40.0, -32.0, -3.0), 4.6),
                (vec3(26.0, -32.0, -9.0), 4.6),
                (vec3(6.0, -26.0, -12.0), 4.6),
                (vec3(-16.0, -34.0, -11.0), 4.6),
                (vec3(-34.0, -34.0, -5.0), 4.6),
                (vec3(-40.0, -44.0, 2.0), 4.6),
                (vec3(-26.0, -44.0, 0.0), 4.6),
                (vec3(-8.0, -38.0, -2.0), 4.6),
                (vec3(10.0, -40.0, 0.0), 4.6),
                (vec3(28.0, -42.0, 3.0), 4.6),
                (vec3(37.0, -46.0, 8.0), 4.8),
            ],
            6,
        );
        let colon = Course::new(
            &[
                (vec3(37.0, -46.0, 8.0), 4.8),
                (vec3(30.0, -34.0, 10.0), 6.2),
                (vec3(8.0, -26.0, 6.0), 6.6),
                (vec3(-12.0, -32.0, 8.0), 6.2),
                (vec3(-10.0, -52.0, 8.0), 5.4),
                (vec3(-2.0, -72.0, 2.0), 5.0),
                (vec3(0.0, -92.0, -10.0), 4.0),
            ],
            6,
        );
        Self { trachea, bronchi: bronchi(), gullet, stomach, intestine, colon, vessels: vessels(throat, neck) }
    }
}

/// The great arteries and veins.
fn vessels(throat: Vec3, neck: Vec3) -> Vec<Course> {
    let mut all = Vec::new();
    let aorta = |y: f32| shell::below_ridge(y, 11.5);
    // Two arches around the gullet meet under the spine.
    for side in [1.0_f32, -1.0] {
        let at = |x: f32, y: f32, z: f32| vec3(side * x, y, z);
        all.push(Course::new(
            &[
                (at(1.5, 36.0, -6.0), 2.6),
                (at(8.0, 46.0, 2.0), 2.4),
                (at(11.0, 40.0, 16.0), 2.3),
                (at(5.0, 20.0, 30.0), 2.3),
                (aorta(-2.0), 2.5),
            ],
            8,
        ));
        // To the neck and head.
        all.push(Course::new(
            &[
                (at(4.0, 42.0, -4.0), 1.8),
                (at(7.0, 66.0, -3.0), 1.7),
                (neck + at(7.0, 0.0, 1.0), 1.5),
                (throat + at(7.0, 0.0, 4.0), 1.2),
            ],
            8,
        ));
        // To the limbs.
        all.push(Course::new(
            &[
                (at(6.0, 50.0, -3.0), 1.8),
                (at(26.0, 58.0, -2.0), 1.7),
                (at(46.0, 60.0, -4.0), 1.5),
                (at(66.0, 68.0, -8.0), 1.2),
            ],
            8,
        ));
        all.push(Course::new(
            &[
                (aorta(-58.0), 1.9),
                (at(12.0, -62.0, 14.0), 1.8),
                (at(24.0, -66.0, 4.0), 1.7),
                (at(42.0, -67.0, -3.0), 1.5),
                (at(60.0, -70.0, -7.0), 1.2),
            ],
            8,
        ));
        // To lungs and kidneys.
        all.push(Course::new(
            &[
                (at(3.0, 36.0, -2.0), 2.1),
                (at(14.0, 36.0, 10.0), 1.9),
                (at(26.0, 14.0, 18.0), 1.5),
                (at(27.0, -22.0, 20.0), 1.0),
            ],
            8,
        ));
        all.push(Course::new(&[(aorta(-50.0), 1.7), (at(8.0, -52.0, 24.0), 1.5), (at(15.0, -54.0, 19.0), 1.3)], 6));
        // The veins of the belly run from the hips through the liver to the heart.
        all.push(Course::new(
            &[
                (at(26.0, -54.0, -16.0), 1.6),
                (at(20.0, -20.0, -17.5), 1.7),
                (at(20.0, 6.0, -12.0), 1.9),
                (at(6.0, 22.0, -3.0), 2.2),
            ],
            8,
        ));
    }
    let along: Vec<(Vec3, f32)> = (0..=5).map(|i| (aorta(-2.0 - 13.0 * i as f32), 2.5 - 0.14 * i as f32)).collect();
    all.push(Course::new(&along, 5));
    all
}

/// The heart: a ventricle behind two atria.
pub fn heart(p: Vec3) -> (f32, f32) {
    let ventricle = ellipsoid(p - vec3(1.0, 26.0, -11.0), vec3(11.0, 9.5, 8.0));
    let atria = ellipsoid(p - vec3(9.5, 35.0, -7.0), vec3(8.0, 7.5, 7.0))
        .min(ellipsoid(p - vec3(-8.5, 35.0, -7.0), vec3(7.0, 7.0, 6.5)));
    let groove = 0.8 * bump(ventricle - atria, 2.2);
    (smin(ventricle, atria, 2.0) + groove, ventricle.min(atria))
}

/// The liver: a large lobe on the RIGHT, a small one on the left, a bridge between, hollowed for the heart.
pub fn liver(p: Vec3) -> f32 {
    let right = ellipsoid(turn_z(p - vec3(31.0, 8.0, -2.0), -0.18), vec3(21.0, 33.0, 13.0));
    let left = ellipsoid(turn_z(p - vec3(-20.0, 17.0, -8.0), 0.3), vec3(19.0, 20.0, 9.0));
    let bridge = ellipsoid(p - vec3(4.0, 8.0, -11.0), vec3(18.0, 10.0, 6.5));
    let d = smin(smin(right, bridge, 6.0), left, 6.0);
    // Cut into lobules at its rear edge.
    let cut = 2.2 * bump(noise(vec3(p.x * 0.11, p.y * 0.05, 0.0), 51), 0.22) * smoothstep(10.0, -14.0, p.y);
    let (heart, _) = heart(p);
    smax(smax(d + cut, 2.2 - heart, 2.0), -12.0 + p.z - 0.12 * p.x.abs(), 5.0)
}

/// The gall bladder, in the right lobe's rear edge.
pub fn gall_bladder(p: Vec3) -> f32 {
    ellipsoid(p - vec3(40.0, -19.0, -8.0), vec3(5.0, 7.0, 5.0))
}

/// The kidneys, lobed, against the carapace behind the lungs.
pub fn kidneys(q: Vec3) -> f32 {
    let d = ellipsoid(turn_z(q - vec3(16.0, -61.0, 17.0), 0.25), vec3(8.0, 14.0, 8.0));
    d + 0.9 * bump(noise(q * vec3(0.12, 0.3, 0.2), 52), 0.25)
}

/// The urinary bladder.
pub fn bladder(p: Vec3) -> f32 {
    smin(
        ellipsoid(p - vec3(2.0, -54.0, -11.0), vec3(14.0, 11.0, 7.5)),
        ellipsoid(p - vec3(-6.0, -50.0, -11.0), vec3(12.0, 9.0, 7.0)),
        5.0,
    )
}
