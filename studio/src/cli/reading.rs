//! How a volume is read, as options say it: which of several, which frame, which part, and how finely.

use anyhow::Result;
use fabrica_engine::read::limits::Limits;
use fabrica_engine::read::raw::RawLayout;
use fabrica_engine::read::window::Window;
use fabrica_engine::read::{Numbers, ReadOptions};

/// The options of a command that reads one volume.
#[derive(clap::Args, Clone, Debug, Default)]
#[group(skip)]
pub struct Arguments {
    /// Layout of a raw file: DIMSxTYPE[,spacing][,endian], as in 256x256x128xuint8,1x1x1,little.
    #[arg(long, value_name = "LAYOUT")]
    raw: Option<RawLayout>,
    /// Which volume of a folder or file with several: its number in the list that `fabrica inspect` prints, or a part of its
    /// name that only one has.
    #[arg(long, value_name = "NAME")]
    series: Option<String>,
    /// Frame, from 0, of a 4-D file.
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: usize,
    /// Part that is read, in voxels of the file: first:end along x, y and z, the end being left out, as in 0:256x0:512x40:90.
    #[arg(long, value_name = "BOX", value_parser = parse_crop)]
    crop: Option<[[usize; 2]; 3]>,
    /// So many voxels become one: a number for all axes, or three, as in 2x2x1.
    #[arg(long, value_name = "N", value_parser = parse_reduce)]
    reduce: Option<[usize; 3]>,
    /// What its numbers are: values of a scan, or names of structures (labels). Without it, what the file says and its values
    /// look like.
    #[arg(long = "as", value_name = "WHAT", value_enum)]
    taken_for: Option<TakenFor>,
    /// The most memory that it may take here and on the adapter, in GB; what is free unless it is given.
    #[arg(long, value_name = "GB", value_parser = parse_gigabytes)]
    memory: Option<u64>,
}

/// How a guess is overruled.
pub const AS_SCAN: &str = "If it is a scan, add --as scan.";

/// What numbers are, on a command line.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum TakenFor {
    /// Values of a scan.
    Scan,
    /// Names of structures.
    Labels,
}

impl Arguments {
    /// What the numbers are taken for, if it is said.
    pub fn numbers(&self) -> Option<Numbers> {
        Some(match self.taken_for? {
            TakenFor::Scan => Numbers::Values,
            TakenFor::Labels => Numbers::Structures,
        })
    }

    /// How to read, as numbers.
    pub fn options(&self) -> ReadOptions {
        ReadOptions {
            frame: self.frame,
            raw: self.raw.clone(),
            series: self.series.clone(),
            window: Window { crop: self.crop, reduce: self.reduce.unwrap_or([1; 3]) },
            limits: Limits { bytes: self.memory, edge: None },
            ..ReadOptions::default()
        }
    }
}

/// first:endxfirst:endxfirst:end.
///
/// # Errors
/// A clause.
pub fn parse_crop(text: &str) -> Result<[[usize; 2]; 3], String> {
    let range = |word: &str| {
        let (first, end) = word.split_once(':')?;
        Some([first.trim().parse().ok()?, end.trim().parse().ok()?]).filter(|[first, end]: &[usize; 2]| first < end)
    };
    let ranges: Option<Vec<_>> = text.split('x').map(range).collect();
    ranges
        .and_then(|r| r.try_into().ok())
        .ok_or_else(|| "write it as first:end for x, y and z, for example 0:256x0:512x40:90".to_owned())
}

/// One number, or three.
///
/// # Errors
/// A clause.
pub fn parse_reduce(text: &str) -> Result<[usize; 3], String> {
    let numbers: Option<Vec<usize>> =
        text.split('x').map(|n| n.trim().parse().ok().filter(|n| (1..=64).contains(n))).collect();
    match numbers.as_deref() {
        Some(&[all]) => Ok([all; 3]),
        Some(&[x, y, z]) => Ok([x, y, z]),
        _ => {
            Err("write how many voxels become one, 1 to 64, for all axes or for three, for example 2 or 2x2x1"
                .to_owned())
        }
    }
}

/// GB to bytes.
///
/// # Errors
/// A clause.
pub fn parse_gigabytes(text: &str) -> Result<u64, String> {
    let gigabytes = text.parse().ok().filter(|g: &f64| g.is_finite() && *g > 0.0);
    gigabytes.map(|g| (g * 1e9) as u64).ok_or_else(|| "write a number of GB, for example 12".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_parse() {
        assert_eq!(parse_crop("0:256x0:512x40:90"), Ok([[0, 256], [0, 512], [40, 90]]));
        for bad in ["", "0:1", "0:1x0:1", "5:5x0:1x0:1", "0-1x0-1x0-1", "0:1x0:1x0:1x0:1"] {
            assert!(parse_crop(bad).is_err(), "{bad}");
        }
        assert_eq!((parse_reduce("2"), parse_reduce("2x2x1")), (Ok([2; 3]), Ok([2, 2, 1])));
        for bad in ["", "0", "2x2", "65", "-1", "1.5"] {
            assert!(parse_reduce(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_gigabytes("1.5"), Ok(1_500_000_000));
    }
}
