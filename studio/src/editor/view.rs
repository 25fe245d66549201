//! The view as gestures change it: pure functions from one camera to the next. Angles and lengths are the figure's own
//! (radii of the object's sphere), so that a drag feels the same on a mouse and on a whale.

use fabrica_engine::spaces::direction_letters;
use glam::{DQuat, DVec3};

use crate::figure::template::{CameraTemplate, ProjectionName};

/// Radians that a drag across the figure's height turns.
const TURN_PER_HEIGHT: f64 = std::f64::consts::PI;
/// The nearest that the eye comes to looking along the vertical, radians: closer, up would flip.
const POLE: f64 = 0.01;
/// The picture's height in radii, at least and at most.
const HEIGHTS: (f64, f64) = (0.01, 50.0);

/// From the object to the eye, to the right of the picture, and up in it: unit vectors in RAS.
pub fn axes(camera: &CameraTemplate) -> (DVec3, DVec3, DVec3) {
    let from = DVec3::from_array(camera.from).try_normalize().unwrap_or(DVec3::Y);
    let up = DVec3::from_array(camera.up);
    let right = up.cross(from).try_normalize().unwrap_or_else(|| from.any_orthonormal_vector());
    (from, right, from.cross(right))
}

/// Turns the eye around the target, as a turntable does: `dx`, `dy` = the drag in heights of the figure, right and down.
#[must_use]
pub fn orbit(camera: &CameraTemplate, dx: f64, dy: f64) -> CameraTemplate {
    let (from, right, _) = axes(camera);
    let vertical = DVec3::from_array(camera.up).try_normalize().unwrap_or(DVec3::Z);
    // The object follows the hand: dragging to the right brings its left side… into view, so the eye goes left.
    let yaw = DQuat::from_axis_angle(vertical, -dx * TURN_PER_HEIGHT);
    let angle = vertical.angle_between(from);
    let pitch = (-dy * TURN_PER_HEIGHT).clamp(POLE - angle, std::f64::consts::PI - POLE - angle);
    let pitch = DQuat::from_axis_angle(right, pitch);
    CameraTemplate { from: (yaw * (pitch * from)).to_array(), ..camera.clone() }
}

/// Rolls the picture around the view's axis by `angle` radians, counterclockwise.
#[must_use]
pub fn roll(camera: &CameraTemplate, angle: f64) -> CameraTemplate {
    let (from, _, up) = axes(camera);
    CameraTemplate { up: (DQuat::from_axis_angle(from, -angle) * up).to_array(), ..camera.clone() }
}

/// Moves the object with the hand: `dx`, `dy` in heights of the figure, right and down.
#[must_use]
pub fn pan(camera: &CameraTemplate, dx: f64, dy: f64) -> CameraTemplate {
    let (_, right, up) = axes(camera);
    let target = DVec3::from_array(camera.target) + camera.height * (-dx * right + dy * up);
    CameraTemplate { target: target.to_array(), ..camera.clone() }
}

/// Makes the picture `factor` times as large, keeping in place what is at (`x`, `y`), heights of the figure right and up of
/// its middle.
#[must_use]
pub fn dolly(camera: &CameraTemplate, factor: f64, [x, y]: [f64; 2]) -> CameraTemplate {
    let height = (camera.height / factor).clamp(HEIGHTS.0, HEIGHTS.1);
    let (_, right, up) = axes(camera);
    let target = DVec3::from_array(camera.target) + (camera.height - height) * (x * right + y * up);
    CameraTemplate { height, target: target.to_array(), ..camera.clone() }
}

/// The whole object in the middle, from where it is seen.
#[must_use]
pub fn fit(camera: &CameraTemplate) -> CameraTemplate {
    CameraTemplate { height: 2.0, target: [0.0; 3], ..camera.clone() }
}

/// Looks from one of the six sides. `direction`: from the object to the eye.
#[must_use]
pub fn from_side(camera: &CameraTemplate, direction: DVec3) -> CameraTemplate {
    // Seen from above or below, the front of the body is up in the picture.
    let up = if direction.z.abs() > 0.5 { DVec3::Y } else { DVec3::Z };
    CameraTemplate { from: direction.to_array(), up: up.to_array(), ..camera.clone() }
}

/// The other projection.
pub fn other(projection: ProjectionName) -> ProjectionName {
    match projection {
        ProjectionName::Perspective => ProjectionName::Orthographic,
        ProjectionName::Orthographic => ProjectionName::Perspective,
    }
}

/// From where the object is seen, in words: "seen from the front left and above".
pub fn side(camera: &CameraTemplate) -> String {
    let (from, ..) = axes(camera);
    let clear = |x: f64, words: [&'static str; 2]| {
        if x > 0.38 {
            Some(words[0])
        } else if x < -0.38 {
            Some(words[1])
        } else {
            None
        }
    };
    let around = [clear(from.y, ["front", "back"]), clear(from.x, ["right", "left"])];
    let around: Vec<&str> = around.into_iter().flatten().collect();
    let height = clear(from.z, ["above", "below"]);
    match (around.is_empty(), height) {
        (true, Some(height)) => format!("seen from {height}"),
        (_, Some(height)) => format!("seen from the {} and {height}", around.join(" ")),
        (_, None) => format!("seen from the {}", around.join(" ")),
    }
}

/// At the left, right, top and bottom of the picture: towards which side of the body each lies, the letter that fits best
/// first, and those that come near to it (an oblique view has "AL").
pub fn letters(camera: &CameraTemplate) -> [String; 4] {
    let (_, right, up) = axes(camera);
    [-right, right, up, -up].map(direction_letters)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> CameraTemplate {
        serde_json::from_str(r#"{"from": [0, 1, 0], "fov_deg": 30}"#).unwrap()
    }

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        DVec3::from_array(a).distance(DVec3::from_array(b)) < 1e-9
    }

    #[test]
    fn a_face_seen_from_the_front_has_its_right_on_the_left() {
        assert_eq!(letters(&camera()), ["R", "L", "S", "I"]);
        let above = from_side(&camera(), DVec3::Z);
        assert_eq!(letters(&above), ["L", "R", "A", "P"]);
        let left = from_side(&above, DVec3::NEG_X);
        assert_eq!(letters(&left), ["A", "P", "S", "I"]);
        assert_eq!(letters(&roll(&camera(), std::f64::consts::FRAC_PI_2)), ["S", "I", "L", "R"]);
    }

    #[test]
    fn sides_are_said_in_words() {
        for (from, words) in [
            ([0.0, 1.0, 0.0], "seen from the front"),
            ([-0.6, 0.75, 0.35], "seen from the front left"),
            ([0.6, -0.75, -0.7], "seen from the back right and below"),
            ([0.1, 0.0, 1.0], "seen from above"),
        ] {
            assert_eq!(side(&CameraTemplate { from, ..camera() }), words);
        }
    }

    #[test]
    fn oblique_views_have_two_letters() {
        let oblique = CameraTemplate { from: [-0.7, 0.7, 0.0], ..camera() };
        assert_eq!(letters(&oblique), ["RA", "LP", "S", "I"]);
    }

    #[test]
    fn the_object_follows_the_hand() {
        // Half a turn per height: a quarter to the right shows the side that was on the left.
        let turned = orbit(&camera(), 0.5, 0.0);
        assert!(near(turned.from, [1.0, 0.0, 0.0]), "{:?}", turned.from);
        // Dragging down shows the top.
        assert!(orbit(&camera(), 0.0, 0.2).from[2] > 0.5);
        // It never goes over the pole, and back is back.
        let high = orbit(&camera(), 0.0, 30.0);
        assert!(high.from[2] > 0.99 && high.from[2] < 1.0 && high.from[1] > 0.0, "{:?}", high.from);
        let back = orbit(&orbit(&camera(), 0.3, 0.0), -0.3, 0.0);
        assert!(near(back.from, camera().from));
        let moved = pan(&camera(), 0.25, 0.0);
        // From the front, the picture's right is the body's left.
        assert!(near(moved.target, [0.5, 0.0, 0.0]), "{:?}", moved.target);
    }

    #[test]
    fn what_is_under_the_pointer_stays_there() {
        let at = [0.3, -0.2];
        let place = |c: &CameraTemplate| {
            let (_, right, up) = axes(c);
            DVec3::from_array(c.target) + c.height * (at[0] * right + at[1] * up)
        };
        for factor in [0.5, 1.1, 4.0] {
            let near = dolly(&camera(), factor, at);
            assert!((near.height - 2.0 / factor).abs() < 1e-12);
            assert!(place(&near).distance(place(&camera())) < 1e-12);
        }
        assert_eq!(dolly(&camera(), 1e9, at).height, HEIGHTS.0);
        assert_eq!(fit(&dolly(&camera(), 3.0, at)), camera());
    }
}
