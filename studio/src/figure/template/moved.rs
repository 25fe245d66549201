//! What a template says of a region that was moved: where to, the ghost that it leaves, and where it meets others.

use std::io::{Read as _, Write as _};
use std::sync::Arc;

use anyhow::{Result, bail};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use fabrica_engine::scene::moved::{STRENGTH_SIZE, Strength};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use glam::{DAffine3, DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{LookTemplate, Rgb};

/// Opacity of a ghost that nothing is said of, unless its region has less.
pub const GHOST_OPACITY: f64 = 0.15;
/// The smallest and the largest scale.
pub const SCALES: (f64, f64) = (0.01, 100.0);
/// The longest offset, in radii: beyond that nobody finds it.
const LONGEST_OFFSET: f64 = 1000.0;

/// Where a region was moved to from where it was found, all of it together, and what that leaves there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MoveTemplate {
    /// Right, anterior, superior, in radii of the sphere that the camera's lengths are relative to.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset: [f64; 3],
    /// A rotation vector about the center of the box around its voxels: its direction is the axis (right-handed), its length the
    /// angle in degrees.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub turn: [f64; 3],
    /// Factor of its size, from the same center, 0.01 to 100.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f64,
    /// How the place is drawn that it left. Default: as the region looks, with an opacity of at most 0.15.
    #[serde(default, skip_serializing_if = "LookTemplate::is_default")]
    pub ghost: LookTemplate,
    /// How it looks where it overlaps its own ghost. Default: both are seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub meets_ghost: Option<MeetingTemplate>,
    /// How it looks where it overlaps what else lies there. Default: both are seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub meets_background: Option<MeetingTemplate>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// How a moved region looks where it overlaps something.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MeetingTemplate {
    /// An sRGB color.
    pub color: Rgb,
    /// Opacity, 0 to 1, of a reference length. Default: as opaque as the more opaque one of those who meet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opacity: Option<f64>,
    /// How much of the color shows, by the two values that meet. Default: all of it for any two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strength: Option<MeetingStrength>,
    /// Fields of other versions, kept as they are.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A function of two data values, each over the range of the data: 64 x 64 cells. In JSON: gzipped and in base64.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeetingStrength(pub Arc<Strength>);

pub(super) fn one() -> f64 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
pub(super) fn is_one(n: &f64) -> bool {
    *n == 1.0
}

pub(super) fn is_zero(v: &[f64; 3]) -> bool {
    *v == [0.0; 3]
}

impl Default for MoveTemplate {
    fn default() -> Self {
        Self {
            offset: [0.0; 3],
            turn: [0.0; 3],
            scale: 1.0,
            ghost: LookTemplate::default(),
            meets_ghost: None,
            meets_background: None,
            extra: Map::new(),
        }
    }
}

impl MoveTemplate {
    /// Whether it says nothing.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Whether it moves anything.
    pub fn is_moved(&self) -> bool {
        !(is_zero(&self.offset) && is_zero(&self.turn) && is_one(&self.scale))
    }

    /// The rotation.
    pub fn rotation(&self) -> DMat3 {
        let turn = DVec3::from_array(self.turn);
        let angle_deg = turn.length();
        if angle_deg > 0.0 { DMat3::from_axis_angle(turn / angle_deg, angle_deg.to_radians()) } else { DMat3::IDENTITY }
    }

    /// M(x) = c + offset + R s (x − c), of the world (RAS mm) into itself; identity where it moves nothing.
    ///
    /// `center_mm`: c, the middle of the box around the region's voxels; `radius_mm`: of the sphere that offsets are relative to.
    pub fn pose(&self, center_mm: DVec3, radius_mm: f64) -> DAffine3 {
        if !self.is_moved() {
            return DAffine3::IDENTITY;
        }
        let matrix3 = self.rotation() * self.scale;
        let offset_mm = radius_mm * DVec3::from_array(self.offset);
        // In this order, what is only pushed has the same pose whatever its center.
        DAffine3 { matrix3, translation: offset_mm + (center_mm - matrix3 * center_mm) }
    }

    /// The same pose, with another center: what was painted to the region, or erased, does not move the rest of it.
    #[must_use]
    pub fn with_center(&self, before_mm: DVec3, now_mm: DVec3, radius_mm: f64) -> Self {
        if !self.is_moved() || radius_mm <= 0.0 {
            return self.clone();
        }
        let by = before_mm - now_mm;
        let offset = DVec3::from_array(self.offset) + (by - self.rotation() * self.scale * by) / radius_mm;
        Self { offset: offset.to_array(), ..self.clone() }
    }

    /// How a ghost looks whose region (or structure of one) looks so: hidden with it, unless it says otherwise.
    pub fn ghost_of(&self, look: &LookTemplate) -> LookTemplate {
        let opacity = self.ghost.opacity.unwrap_or(look.opacity.unwrap_or(1.0).min(GHOST_OPACITY));
        LookTemplate { opacity: Some(opacity), ..self.ghost.or(look) }
    }

    pub(super) fn check(&self, whose: &str) -> Result<()> {
        if self.offset.iter().chain(&self.turn).any(|n| !n.is_finite()) {
            bail!("{whose} is moved by something that is no number; give finite ones");
        }
        if DVec3::from_array(self.offset).length() > LONGEST_OFFSET {
            bail!("{whose} is moved by more than {LONGEST_OFFSET} radii; give a shorter offset");
        }
        if !(SCALES.0..=SCALES.1).contains(&self.scale) {
            bail!("{whose} is scaled by {}; give a factor from {} to {}", self.scale, SCALES.0, SCALES.1);
        }
        let meetings = self.meets_ghost.iter().chain(&self.meets_background);
        if let Some(opacity) = meetings.filter_map(|m| m.opacity).find(|o| !(0.0..=1.0).contains(o)) {
            bail!("{whose} meets others with opacity {opacity}; opacities go from 0 to 1");
        }
        self.ghost.check(&format!("the ghost of {whose}"))
    }
}

impl MeetingTemplate {
    /// Of a color, for any two values.
    pub fn new(color: [u8; 3]) -> Self {
        Self { color: Rgb(color), opacity: None, strength: None, extra: Map::new() }
    }
}

impl Serialize for MeetingStrength {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
        let data = gzip.write_all(self.0.cells()).and_then(|()| gzip.finish()).map_err(serde::ser::Error::custom)?;
        serializer.serialize_str(&STANDARD.encode(data))
    }
}

impl<'de> Deserialize<'de> for MeetingStrength {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        read_strength(&String::deserialize(deserializer)?).map_err(|what| {
            serde::de::Error::custom(format!("the strength of a meeting cannot be read: {what}; restore an older copy"))
        })
    }
}

/// A clause where the text is damaged.
fn read_strength(text: &str) -> std::result::Result<MeetingStrength, String> {
    const COUNT: usize = STRENGTH_SIZE * STRENGTH_SIZE;
    let packed = STANDARD.decode(text).map_err(|e| format!("its base64 is damaged ({e})"))?;
    let mut cells = Vec::with_capacity(COUNT);
    // A byte more than there may be: what is longer is noticed, and takes no more memory than that.
    let unpacked = GzDecoder::new(&packed[..]).take(COUNT as u64 + 1).read_to_end(&mut cells);
    unpacked.map_err(|e| format!("it cannot be unpacked ({e})"))?;
    let count = cells.len();
    let strength = Strength::new(cells).ok_or_else(|| {
        let than = if count > COUNT { "more" } else { "fewer" };
        format!("it has {than} cells than {STRENGTH_SIZE} x {STRENGTH_SIZE}")
    })?;
    Ok(MeetingStrength(Arc::new(strength)))
}

impl JsonSchema for MeetingStrength {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "MeetingStrength".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "type": "string",
            "description": "64 x 64 bytes, gzipped and in base64: how much shows (255 = all), by the value at rest (along x, x fastest) \
                            and the moved one (along y), each from the smallest to the largest of the data."
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strength() -> MeetingStrength {
        let cells = (0..STRENGTH_SIZE * STRENGTH_SIZE).map(|i| (i * 7 % 251) as u8).collect();
        MeetingStrength(Arc::new(Strength::new(cells).unwrap()))
    }

    #[test]
    fn a_pose_turns_and_scales_about_the_center_and_then_moves() {
        let moved =
            MoveTemplate { offset: [0.5, 0.0, -1.0], turn: [0.0, 0.0, 90.0], scale: 2.0, ..MoveTemplate::default() };
        let center = DVec3::new(10.0, 20.0, 30.0);
        let pose = moved.pose(center, 100.0);
        let near = |p: DVec3, to: [f64; 3]| {
            assert!(pose.transform_point3(p).distance(DVec3::from_array(to)) < 1e-9, "{p}");
        };
        near(center, [60.0, 20.0, -70.0]);
        // Anterior of the center becomes left of it, twice as far: right-handed about superior.
        near(center + 3.0 * DVec3::Y, [54.0, 20.0, -70.0]);
        near(center + DVec3::Z, [60.0, 20.0, -68.0]);
        assert_eq!(MoveTemplate::default().pose(center, 100.0), DAffine3::IDENTITY);
        // A full turn is none, but for rounding.
        let full = MoveTemplate { turn: [0.0, 360.0, 0.0], ..MoveTemplate::default() };
        assert!(full.pose(center, 1.0).abs_diff_eq(DAffine3::IDENTITY, 1e-9));
    }

    #[test]
    fn another_center_keeps_the_pose() {
        let moved =
            MoveTemplate { offset: [0.2, 0.1, 0.4], turn: [40.0, -20.0, 10.0], scale: 0.7, ..MoveTemplate::default() };
        let (a, b) = (DVec3::new(3.0, -8.0, 1.0), DVec3::new(-30.0, 5.0, 22.0));
        let again = moved.with_center(a, b, 80.0);
        assert!(again.pose(b, 80.0).abs_diff_eq(moved.pose(a, 80.0), 1e-9));
        assert!((DVec3::from_array(again.offset) - DVec3::from_array(moved.offset)).length() > 0.01);
        // What is only pushed has no center to care for.
        let pushed = MoveTemplate { offset: [1.0, 0.0, 0.0], ..MoveTemplate::default() };
        assert!(pushed.with_center(a, b, 80.0).offset == pushed.offset);
    }

    #[test]
    fn a_move_goes_through_text_and_back() {
        let meets = MeetingTemplate { strength: Some(strength()), ..MeetingTemplate::new([255, 128, 0]) };
        let moved = MoveTemplate {
            offset: [0.25, 0.0, 0.0],
            ghost: LookTemplate { opacity: Some(0.3), ..LookTemplate::default() },
            meets_ghost: Some(meets),
            meets_background: Some(MeetingTemplate::new([1, 2, 3])),
            ..MoveTemplate::default()
        };
        let text = serde_json::to_string(&moved).unwrap();
        assert_eq!(serde_json::from_str::<MoveTemplate>(&text).unwrap(), moved);
        assert!(text.contains("\"#ff8000\"") && !text.contains("turn") && !text.contains("scale"), "{text}");
        assert_eq!(serde_json::to_string(&MoveTemplate::default()).unwrap(), "{}");
        let later = r##"{"path":[1,2],"meets_ghost":{"color":"#000000","glow":true}}"##;
        let kept: MoveTemplate = serde_json::from_str(later).unwrap();
        let kept = serde_json::to_string(&kept).unwrap();
        assert!(kept.contains("path") && kept.contains("glow"), "{kept}");
    }

    #[test]
    fn faults_are_sentences() {
        let whose = "the region \"Brain\"";
        for (moved, part) in [
            (MoveTemplate { scale: 0.0, ..MoveTemplate::default() }, "scaled by 0;"),
            (MoveTemplate { scale: f64::NAN, ..MoveTemplate::default() }, "scaled by NaN"),
            (MoveTemplate { scale: -1.0, ..MoveTemplate::default() }, "scaled by -1"),
            (MoveTemplate { scale: 100.5, ..MoveTemplate::default() }, "scaled by 100.5"),
            (MoveTemplate { offset: [0.0, f64::INFINITY, 0.0], ..MoveTemplate::default() }, "no number"),
            (MoveTemplate { turn: [f64::NAN, 0.0, 0.0], ..MoveTemplate::default() }, "no number"),
            (MoveTemplate { offset: [1e9, 0.0, 0.0], ..MoveTemplate::default() }, "more than 1000 radii"),
            (
                MoveTemplate {
                    ghost: LookTemplate { opacity: Some(2.0), ..LookTemplate::default() },
                    ..MoveTemplate::default()
                },
                "the ghost of the region \"Brain\" has opacity 2",
            ),
        ] {
            let said = moved.check(whose).unwrap_err().to_string();
            assert!(said.contains(part) && said.contains(';') && !said.contains('\n'), "{said}");
        }
        for scale in [0.01, 1.0, 100.0] {
            MoveTemplate { scale, ..MoveTemplate::default() }.check(whose).unwrap();
        }
        let gzip = |count: usize| {
            let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
            gzip.write_all(&vec![0; count]).unwrap();
            STANDARD.encode(gzip.finish().unwrap())
        };
        for (text, part) in [
            ("?".to_owned(), "base64"),
            ("AAAA".to_owned(), "unpacked"),
            (gzip(100), "fewer cells"),
            (gzip(50_000_000), "more cells"),
        ] {
            let said = serde_json::from_value::<MeetingStrength>(text.into()).unwrap_err().to_string();
            assert!(said.starts_with("the strength of a meeting") && said.contains(part), "{said}");
        }
        let said = serde_json::from_str::<Rgb>("\"transparent\"").unwrap_err().to_string();
        assert!(said.contains("is no color"), "{said}");
    }

    #[test]
    fn a_ghost_is_faint_and_follows_the_look_else() {
        let look = LookTemplate {
            visible: Some(false),
            opacity: Some(0.9),
            style: Some("wax".to_owned()),
            ..LookTemplate::default()
        };
        let ghost = MoveTemplate::default().ghost_of(&look);
        assert_eq!((ghost.visible, ghost.opacity, ghost.style.as_deref()), (Some(false), Some(0.15), Some("wax")));
        let faint = LookTemplate { opacity: Some(0.03), ..LookTemplate::default() };
        assert_eq!(MoveTemplate::default().ghost_of(&faint).opacity, Some(0.03));
        let own = LookTemplate { visible: Some(true), opacity: Some(0.5), ..LookTemplate::default() };
        let moved = MoveTemplate { ghost: own, ..MoveTemplate::default() };
        assert_eq!((moved.ghost_of(&look).visible, moved.ghost_of(&look).opacity), (Some(true), Some(0.5)));
    }
}
