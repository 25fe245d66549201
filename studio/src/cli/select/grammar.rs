//! What stands after `--add`, `--subtract` and `--intersect`: words, for people and scripts alike. Knows no volume.

use std::str::FromStr;

/// What `--help` says about it: here, and nowhere else.
pub const HELP: &str = "\
Steps are done in their order. --name begins the next selection; what comes before the first --name is \"Selection 1\".

What --add, --subtract and --intersect take:
  range LOW..HIGH [crisp|edge=N]        voxels by value, either bound may be left out: \"range 150..\"; borders cut
                                        voxels in part, not at all (crisp), or fade over N units
  ball R,A,S r=MM                       in mm; a place may be a voxel instead: 120,80,44vox
  box R,A,S size=MM,MM,MM [turn=R,A,S]  around its middle; turned by degrees about the axes right, front, up
  grow R,A,S... tolerance=N [barred=R,A,S]... [corners] [crisp]
                                        what hangs together with the seeds and is at most N away from their values;
                                        within=LOW..HIGH in place of tolerance=N: values in a range
  labels FILE_OR_DIR[:NAME,NAME...]     structures of a label map by name or number, all without names; read as by
                                        `inspect --labels`; also specimen:NAME and files that select wrote
  selection NAME                        an earlier one of this command

Examples:
  fabrica select ct.nii.gz --name bone --add \"range 200..\" --keep-largest --fill-holes -o bone.seg.nrrd
  fabrica select ct/ --name liver --add \"labels seg.nii.gz:liver\" --smooth-mm 1.5 \\
                     --name tumor --add \"grow 41,-20,310 tolerance=30\" --intersect \"selection liver\" -o liver.nrrd
  fabrica select ct.nii.gz --labels masks/ --grow-mm 1 --json

FILE.seg.nrrd is a segmentation for 3D Slicer and others: voxels are in or out (from one half on), overlaps lie in layers.
Any other FILE.nrrd keeps how far each voxel is in, as uint8 (255 = wholly).";

/// A place in the scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// RAS, mm.
    Mm([f64; 3]),
    /// Of the grid, from 0.
    Voxel([f64; 3]),
}

/// Values from a lower to an upper bound.
pub type Bounds = [f64; 2];

/// What a step puts in.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Voxels by value.
    Range { bounds: Bounds, border: Border },
    /// A ball.
    Ball { center: Place, radius_mm: f64 },
    /// A box.
    Cuboid { center: Place, size_mm: [f64; 3], turn_deg: [f64; 3] },
    /// A region that grows from seeds.
    Grow { seeds: Vec<Place>, barred: Vec<Place>, reach: Reach, corners: bool, border: Border },
    /// Structures of a label map: its file, with names behind a colon perhaps.
    Labels(String),
    /// An earlier selection.
    Selection(String),
}

/// How a border lies in voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Border {
    #[default]
    PartialVolume,
    Crisp,
    /// Over so many units of the values.
    Linear(f64),
}

/// Which values a region grows over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// At most so far from those of the seeds.
    Tolerance(f64),
    /// In a range.
    Within(Bounds),
}

impl FromStr for Source {
    type Err = String;

    /// # Errors
    /// A clause that quotes the word at fault.
    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let (kind, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        let rest = rest.trim();
        let words = rest.split_whitespace();
        match kind {
            "range" => range(words.collect()),
            "ball" | "sphere" => ball(words.collect()),
            "box" => cuboid(words.collect()),
            "grow" => grow(words.collect()),
            "labels" if !rest.is_empty() => Ok(Self::Labels(rest.to_owned())),
            "labels" => Err("`labels` takes a file: labels FILE[:NAME,NAME...]".to_owned()),
            "selection" if !rest.is_empty() => Ok(Self::Selection(rest.to_owned())),
            "selection" => Err("`selection` takes a name: selection NAME".to_owned()),
            _ => Err(format!("`{kind}` is none of range, ball, box, grow, labels and selection")),
        }
    }
}

fn range(words: Vec<&str>) -> Result<Source, String> {
    let [first, more @ ..] = &words[..] else { return Err("`range` takes bounds: range 150..3000".to_owned()) };
    let bounds = bounds(first)?;
    let mut border = Border::default();
    for word in more {
        match word.split_once('=') {
            None if *word == "crisp" => border = Border::Crisp,
            Some(("edge", n)) => border = Border::Linear(positive("edge", n)?),
            _ => return Err(unknown(word, "range LOW..HIGH [crisp|edge=N]")),
        }
    }
    Ok(Source::Range { bounds, border })
}

fn ball(words: Vec<&str>) -> Result<Source, String> {
    const USE: &str = "ball R,A,S r=MM";
    let (mut center, mut radius_mm) = (None, None);
    for word in words {
        match word.split_once('=') {
            Some(("r", n)) => radius_mm = Some(positive("r", n)?),
            None if center.is_none() => center = Some(place(word)?),
            _ => return Err(unknown(word, USE)),
        }
    }
    match (center, radius_mm) {
        (Some(center), Some(radius_mm)) => Ok(Source::Ball { center, radius_mm }),
        _ => Err(format!("a ball takes its center and its radius: {USE}")),
    }
}

fn cuboid(words: Vec<&str>) -> Result<Source, String> {
    const USE: &str = "box R,A,S size=MM,MM,MM [turn=R,A,S]";
    let (mut center, mut size_mm, mut turn_deg) = (None, None, [0.0; 3]);
    for word in words {
        match word.split_once('=') {
            Some(("size", n)) => size_mm = Some(triple(n)?).filter(|s| s.iter().all(|n| *n > 0.0)),
            Some(("turn", n)) => turn_deg = triple(n)?,
            None if center.is_none() => center = Some(place(word)?),
            _ => return Err(unknown(word, USE)),
        }
    }
    match (center, size_mm) {
        (Some(center), Some(size_mm)) => Ok(Source::Cuboid { center, size_mm, turn_deg }),
        _ => Err(format!("a box takes its center and three sizes above 0: {USE}")),
    }
}

fn grow(words: Vec<&str>) -> Result<Source, String> {
    const USE: &str = "grow R,A,S... tolerance=N [barred=R,A,S]... [corners] [crisp]";
    let (mut seeds, mut barred, mut reach) = (Vec::new(), Vec::new(), None);
    let (mut corners, mut border) = (false, Border::default());
    for word in words {
        let new = match word.split_once('=') {
            Some(("tolerance", n)) => {
                let tolerance = number(n).filter(|n| *n >= 0.0);
                let tolerance = tolerance.ok_or_else(|| format!("`{word}` is no number of at least 0"))?;
                Some(Reach::Tolerance(tolerance))
            }
            Some(("within", n)) => Some(Reach::Within(bounds(n)?)),
            Some(("barred", n)) => {
                barred.push(place(n)?);
                None
            }
            None if word == "corners" => {
                corners = true;
                None
            }
            None if word == "crisp" => {
                border = Border::Crisp;
                None
            }
            None => {
                seeds.push(place(word)?);
                None
            }
            Some(_) => return Err(unknown(word, USE)),
        };
        if new.is_some() && std::mem::replace(&mut reach, new).is_some() {
            return Err("growing takes one of tolerance=N and within=LOW..HIGH".to_owned());
        }
    }
    match reach {
        Some(reach) if !seeds.is_empty() => Ok(Source::Grow { seeds, barred, reach, corners, border }),
        _ => Err(format!("growing takes a seed, and how far values may be from its value: {USE}")),
    }
}

fn unknown(word: &str, usage: &str) -> String {
    format!("`{word}` is one word too many or none of: {usage}")
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|n: &f64| n.is_finite())
}

fn positive(name: &str, text: &str) -> Result<f64, String> {
    number(text).filter(|n| *n > 0.0).ok_or_else(|| format!("`{name}={text}` takes a number above 0"))
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| number(n.trim())).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| format!("`{text}` is not three numbers with commas"))
}

fn place(text: &str) -> Result<Place, String> {
    match text.strip_suffix("vox") {
        Some(voxel) => Ok(Place::Voxel(triple(voxel)?)),
        None => Ok(Place::Mm(triple(text.strip_suffix("mm").unwrap_or(text))?)),
    }
}

fn bounds(text: &str) -> Result<Bounds, String> {
    let fault = || format!("`{text}` is no range: write LOW..HIGH, LOW.. or ..HIGH");
    let (low, high) = text.split_once("..").ok_or_else(fault)?;
    if low.is_empty() && high.is_empty() {
        return Err(fault());
    }
    let bound = |text: &str, open: f64| if text.is_empty() { Some(open) } else { number(text) };
    let low = bound(low, f64::NEG_INFINITY).ok_or_else(fault)?;
    let high = bound(high, f64::INFINITY).ok_or_else(fault)?;
    if low > high {
        return Err(format!("no value lies in `{text}`: the lower bound comes first"));
    }
    Ok([low, high])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Source {
        text.parse().unwrap_or_else(|e| panic!("{text}: {e}"))
    }

    #[test]
    fn what_there_is_parses() {
        let range = |bounds, border| Source::Range { bounds, border };
        assert_eq!(parsed("range 150..3000"), range([150.0, 3000.0], Border::PartialVolume));
        assert_eq!(parsed(" range -1e3.. crisp "), range([-1000.0, f64::INFINITY], Border::Crisp));
        assert_eq!(parsed("range ..-200.5 edge=20"), range([f64::NEG_INFINITY, -200.5], Border::Linear(20.0)));
        assert_eq!(
            parsed("sphere 10,20,-30 r=15"),
            Source::Ball { center: Place::Mm([10.0, 20.0, -30.0]), radius_mm: 15.0 }
        );
        assert_eq!(
            parsed("ball 10,20,30vox r=1.5"),
            Source::Ball { center: Place::Voxel([10.0, 20.0, 30.0]), radius_mm: 1.5 }
        );
        assert_eq!(
            parsed("box 1,2,3mm size=4,5,6 turn=0,0,45"),
            Source::Cuboid { center: Place::Mm([1.0, 2.0, 3.0]), size_mm: [4.0, 5.0, 6.0], turn_deg: [0.0, 0.0, 45.0] }
        );
        assert_eq!(
            parsed("grow 1,2,3 4,5,6vox tolerance=0 barred=7,8,9 corners crisp"),
            Source::Grow {
                seeds: vec![Place::Mm([1.0, 2.0, 3.0]), Place::Voxel([4.0, 5.0, 6.0])],
                barred: vec![Place::Mm([7.0, 8.0, 9.0])],
                reach: Reach::Tolerance(0.0),
                corners: true,
                border: Border::Crisp,
            }
        );
        assert!(matches!(
            parsed("grow 1,2,3 within=100..300"),
            Source::Grow { reach: Reach::Within([100.0, 300.0]), corners: false, .. }
        ));
        assert_eq!(
            parsed("labels my seg.nii.gz:left kidney,spleen"),
            Source::Labels("my seg.nii.gz:left kidney,spleen".into())
        );
        assert_eq!(parsed("selection left kidney"), Source::Selection("left kidney".into()));
    }

    #[test]
    fn what_is_wrong_is_quoted() {
        for (text, word) in [
            ("", "none of range"),
            ("cube 1,2,3", "`cube`"),
            ("range", "takes bounds"),
            ("range 5", "`5`"),
            ("range ..", "`..`"),
            ("range 9..5", "lower bound comes first"),
            ("range a..5", "`a..5`"),
            ("range nan..5", "`nan..5`"),
            ("range 1..5 soft", "`soft`"),
            ("range 1..5 edge=0", "`edge=0`"),
            ("ball 1,2,3", "center and its radius"),
            ("ball r=3", "center and its radius"),
            ("ball 1,2 r=3", "`1,2`"),
            ("ball 1,2,3 r=-3", "`r=-3`"),
            ("ball 1,2,3 4,5,6 r=3", "`4,5,6`"),
            ("ball 1,2,inf r=3", "`1,2,inf`"),
            ("box 1,2,3", "three sizes"),
            ("box 1,2,3 size=1,0,1", "three sizes"),
            ("grow 1,2,3", "how far values"),
            ("grow tolerance=5", "takes a seed"),
            ("grow 1,2,3 tolerance=-1", "`tolerance=-1`"),
            ("grow 1,2,3 tolerance=1 within=1..2", "one of tolerance"),
            ("grow 1,2,3 tol=5", "`tol=5`"),
            ("labels", "takes a file"),
            ("selection ", "takes a name"),
        ] {
            let error = text.parse::<Source>().unwrap_err();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
