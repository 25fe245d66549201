//! Variants of a specimen: the same anatomy as another patient, in another position or by another scanner.

use std::fmt;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};
use crate::volume::Modality;

/// What the values of a specimen are like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Contrast {
    /// As modeled: computed tomography.
    #[default]
    Ct,
    /// As T1-weighted magnetic resonance would show it, in arbitrary units from 0: fat bright, water dark, compact bone
    /// and air black, under a slow bias field.
    Mr,
}

/// How a specimen differs from the plain one; the default is the plain one.
///
/// In text it is a list of comma-separated words, of which each is said once and in any order:
///
/// | word | meaning |
/// | --- | --- |
/// | `size=1.15` | everything 1.15 times as large (0.1 to 10) |
/// | `turn=10/0/-5` | turned by degrees about the axes to the right, to the front and upward, in this order (-180 to 180) |
/// | `drawn-in=0.5` | the turtle's head drawn into its shell (0 to 1) |
/// | `mirrored` | left and right exchanged |
/// | `without=mandible+teeth` | structures left out: what lies under them shows |
/// | `mr` | MRI-like contrast |
/// | `noise=20` | standard deviation of the noise, in the units of the values (0 to 1000) |
/// | `slope=0.97`, `offset=-30` | a scanner off its calibration: value · slope + offset (0.1 to 5, -5000 to 5000) |
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// Factor of all lengths.
    pub size: f64,
    /// Degrees about the world's axes: right (x), front (y), up (z), in this order; right-handed.
    pub turn_deg: [f64; 3],
    /// How far the turtle's head is drawn in, 0 to 1.
    pub drawn_in: f64,
    /// Left and right exchanged, before the turn.
    pub mirrored: bool,
    /// Names of structures that are left out, in lower case with hyphens for spaces, sorted, each once.
    pub missing: Vec<String>,
    /// What the values are like.
    pub contrast: Contrast,
    /// Standard deviation of the noise; `None` for the specimen's own.
    pub noise: Option<f64>,
    /// Factor of a scanner off its calibration.
    pub slope: f64,
    /// Offset of a scanner off its calibration.
    pub offset: f64,
}

impl Default for Variant {
    fn default() -> Self {
        Self {
            size: 1.0,
            turn_deg: [0.0; 3],
            drawn_in: 0.0,
            mirrored: false,
            missing: Vec::new(),
            contrast: Contrast::Ct,
            noise: None,
            slope: 1.0,
            offset: 0.0,
        }
    }
}

/// The words, for messages.
const WORDS: &str = "size=F, turn=R/A/S, drawn-in=F, mirrored, without=NAME+NAME, mr, noise=SD, slope=F, offset=V";

impl Variant {
    /// Reads the words after "specimen:NAME@N,", without the first comma.
    ///
    /// # Errors
    /// [`Error::Scene`] for a word that is not known or said twice, and for a number that is none or out of its range.
    pub fn parse(text: &str) -> Result<Self> {
        let mut variant = Self::default();
        let mut said: Vec<&str> = Vec::new();
        for word in text.split(',').map(str::trim) {
            let (key, value) = word.split_once('=').map_or((word, None), |(k, v)| (k.trim(), Some(v.trim())));
            if said.contains(&key) {
                return Err(Error::scene(format!("a specimen's \"{key}\" is given twice"), "give it once"));
            }
            let number = |from: f64, to: f64| number(key, value.unwrap_or_default(), from, to);
            match (key, value) {
                ("size", Some(_)) => variant.size = number(0.1, 10.0)?,
                ("turn", Some(text)) => variant.turn_deg = turn(text)?,
                ("drawn-in", Some(_)) => variant.drawn_in = number(0.0, 1.0)?,
                ("mirrored", None) => variant.mirrored = true,
                ("without", Some(text)) => variant.missing = names(text)?,
                ("mr", None) => variant.contrast = Contrast::Mr,
                ("noise", Some(_)) => variant.noise = Some(number(0.0, 1000.0)?),
                ("slope", Some(_)) => variant.slope = number(0.1, 5.0)?,
                ("offset", Some(_)) => variant.offset = number(-5000.0, 5000.0)?,
                _ => {
                    return Err(Error::scene(
                        format!("\"{word}\" is no variant of a specimen"),
                        format!("the variants are: {WORDS}"),
                    ));
                }
            }
            said.push(key);
        }
        Ok(variant)
    }

    /// Whether it is the plain specimen.
    pub fn is_plain(&self) -> bool {
        *self == Self::default()
    }

    /// From the plain specimen's axes to the turned one's.
    pub fn rotation(&self) -> DMat3 {
        let [r, a, s] = self.turn_deg.map(f64::to_radians);
        DMat3::from_rotation_z(s) * DMat3::from_rotation_y(a) * DMat3::from_rotation_x(r)
    }

    /// Where a point of the plain specimen lies in this variant, world mm (as far as it is moved as a whole).
    pub fn place(&self, plain: DVec3) -> DVec3 {
        let p = if self.mirrored { DVec3::new(-plain.x, plain.y, plain.z) } else { plain };
        self.rotation() * p * self.size
    }

    /// What the values are, if the plain specimen's are `plain`.
    pub fn modality(&self, plain: Modality) -> Modality {
        match self.contrast {
            Contrast::Ct => plain,
            Contrast::Mr => Modality::Mr,
        }
    }
}

/// The words in their order, without those that say nothing; empty for the plain specimen.
impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plain = Self::default();
        let [r, a, s] = self.turn_deg;
        let words = [
            (self.size != plain.size).then(|| format!("size={}", self.size)),
            (self.turn_deg != plain.turn_deg).then(|| format!("turn={r}/{a}/{s}")),
            (self.drawn_in != plain.drawn_in).then(|| format!("drawn-in={}", self.drawn_in)),
            self.mirrored.then(|| "mirrored".to_owned()),
            (!self.missing.is_empty()).then(|| format!("without={}", self.missing.join("+"))),
            (self.contrast == Contrast::Mr).then(|| "mr".to_owned()),
            self.noise.map(|sd| format!("noise={sd}")),
            (self.slope != plain.slope).then(|| format!("slope={}", self.slope)),
            (self.offset != plain.offset).then(|| format!("offset={}", self.offset)),
        ];
        f.write_str(&words.into_iter().flatten().collect::<Vec<_>>().join(","))
    }
}

fn number(key: &str, text: &str, from: f64, to: f64) -> Result<f64> {
    // Plus 0: -0 is 0.
    let parsed = text.parse::<f64>().ok().filter(|x| (from..=to).contains(x)).map(|x| x + 0.0);
    parsed.ok_or_else(|| {
        Error::scene(
            format!("\"{key}={text}\" is no variant of a specimen"),
            format!("write a number from {from} to {to}"),
        )
    })
}

fn turn(text: &str) -> Result<[f64; 3]> {
    let parts: Vec<&str> = text.split('/').collect();
    let [r, a, s] = parts[..] else {
        return Err(Error::scene(
            format!("\"turn={text}\" does not have three angles"),
            "write degrees about the axes to the right, to the front and upward, as in turn=10/0/-5",
        ));
    };
    let degrees = |text: &str| number("turn", text, -180.0, 180.0);
    Ok([degrees(r)?, degrees(a)?, degrees(s)?])
}

fn names(text: &str) -> Result<Vec<String>> {
    let mut names: Vec<String> = text.split('+').map(|n| n.trim().to_lowercase().replace(' ', "-")).collect();
    let is_name = |n: &String| !n.is_empty() && n.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
    if !names.iter().all(is_name) {
        return Err(Error::scene(
            format!("\"without={text}\" does not name structures"),
            "join their names by +, as in without=mandible+optic-nerves",
        ));
    }
    names.sort();
    names.dedup();
    Ok(names)
}

/// A specimen by name, resolution and variant: what follows "specimen:" in a template or on a command line,
/// `NAME[@N][,VARIANT]`. `Display` writes it in one way only, and that can be read again.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// "head". It need not exist: [`Request::generate`](super::Request::generate) says which do.
    pub name: String,
    /// Voxels along the longest axis.
    pub resolution: usize,
    /// How it differs from the plain one.
    pub variant: Variant,
}

impl Request {
    /// The plain specimen.
    pub fn plain(name: &str, resolution: usize) -> Self {
        Self { name: name.to_owned(), resolution, variant: Variant::default() }
    }

    /// Reads `NAME[@N][,VARIANT]`.
    ///
    /// # Errors
    /// [`Error::Scene`] for a resolution that is no number, and those of [`Variant::parse`].
    pub fn parse(text: &str) -> Result<Self> {
        let (head, variant) = text.split_once(',').map_or((text, None), |(head, rest)| (head, Some(rest)));
        let (name, resolution) = match head.split_once('@') {
            None => (head, super::DEFAULT_RESOLUTION),
            Some((name, digits)) => match digits.trim().parse() {
                Ok(n) => (name, n),
                Err(_) => {
                    return Err(Error::scene(
                        format!("\"specimen:{text}\" has no number of voxels after the @"),
                        "write for example specimen:head@128",
                    ));
                }
            },
        };
        let variant = variant.map(Variant::parse).transpose()?.unwrap_or_default();
        Ok(Self { name: name.trim().to_owned(), resolution, variant })
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)?;
        if self.resolution != super::DEFAULT_RESOLUTION {
            write!(f, "@{}", self.resolution)?;
        }
        if !self.variant.is_plain() {
            write!(f, ",{}", self.variant)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_back() {
        for text in [
            "head",
            "head@128",
            "turtle,drawn-in=0.5",
            "head@64,size=1.15,turn=10/0/-5,mirrored,without=mandible+teeth,mr,noise=20,slope=0.97,offset=-30",
        ] {
            assert_eq!(Request::parse(text).unwrap().to_string(), text);
        }
        // Order, spaces, capitals, what says nothing and -0 do not matter.
        for (text, canonical) in [
            ("head@256,mirrored,size=1.150", "head,size=1.15,mirrored"),
            ("head, without = Optic Nerves+airways + airways , mr", "head,without=airways+optic-nerves,mr"),
            ("head,turn=-0/0/0,slope=1,offset=-0,size=1e0", "head"),
            ("head,noise=0", "head,noise=0"),
        ] {
            let request = Request::parse(text).unwrap();
            assert_eq!(request.to_string(), canonical);
            assert_eq!(Request::parse(canonical).unwrap(), request);
        }
    }

    #[test]
    fn faults_say_what_to_do() {
        for (text, part) in [
            ("head@many", "specimen:head@128"),
            ("head@", "specimen:head@128"),
            ("head,", "the variants are: size=F"),
            ("head,tall", "the variants are"),
            ("head,mirrored=1", "the variants are"),
            ("head,size", "the variants are"),
            ("head,size=0", "a number from 0.1 to 10"),
            ("head,size=nan", "a number from 0.1 to 10"),
            ("head,noise=-1", "a number from 0 to 1000"),
            ("head,turn=10", "turn=10/0/-5"),
            ("head,turn=1/2/x", "a number from -180 to 180"),
            ("head,without=", "without=mandible"),
            ("head,without=a/b", "without=mandible"),
            ("head,mr,mr", "give it once"),
        ] {
            let message = Request::parse(text).unwrap_err().to_string();
            assert!(message.contains(part), "{text}: {message}");
        }
    }

    #[test]
    fn turns_go_about_the_worlds_axes_in_order() {
        let turned = |text: &str, p: DVec3| Variant::parse(text).unwrap().place(p);
        let near = |a: DVec3, b: DVec3| assert!(a.distance(b) < 1e-12, "{a} {b}");
        near(turned("turn=90/0/0", DVec3::Y), DVec3::Z);
        near(turned("turn=0/90/0", DVec3::Z), DVec3::X);
        near(turned("turn=0/0/90", DVec3::X), DVec3::Y);
        near(turned("turn=90/0/90", DVec3::Z), DVec3::X);
        near(turned("mirrored,turn=0/0/90,size=2", DVec3::X), -2.0 * DVec3::Y);
    }
}
