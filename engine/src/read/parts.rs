//! Voxels that lie in one or several files, part after part: `LIST` and patterns of MetaImage and NRRD.

use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::stream::ByteSource;
use crate::error::{Error, Result};
use crate::progress::Progress;

/// One file and where its bytes begin.
#[derive(Clone, Debug)]
pub struct Part {
    /// The file.
    pub path: PathBuf,
    /// The byte at which the voxels, or the compressed data, begin.
    pub start: u64,
    /// Whether they are compressed (zlib or gzip).
    pub is_deflated: bool,
}

impl Part {
    fn open(&self) -> Result<ByteSource> {
        if self.is_deflated {
            ByteSource::open_deflated_at(&self.path, self.start)
        } else {
            ByteSource::open_at(&self.path, self.start, false)
        }
    }
}

/// The decoded bytes of all parts, of which each has as many, as one stream.
pub struct Parts {
    parts: Vec<Part>,
    bytes_each: u64,
    progress: Progress,
    next: usize,
    /// The part that is being read, and how much of it is to come.
    current: Option<(ByteSource, u64)>,
}

impl Parts {
    /// Parts of `bytes_each` decoded bytes, at least 1. Every file is asked for its size, and none is read.
    ///
    /// # Errors
    /// If a file is missing or cannot hold its part.
    pub fn open(parts: Vec<Part>, bytes_each: u64, progress: &Progress) -> Result<Self> {
        for part in &parts {
            progress.check()?;
            part.open()?.check_holds(bytes_each)?;
        }
        Ok(Self { parts, bytes_each, progress: progress.clone(), next: 0, current: None })
    }

    /// One part that is open already.
    pub fn of_source(source: ByteSource, num_bytes: u64, progress: &Progress) -> Self {
        let current = Some((source, num_bytes));
        Self { parts: Vec::new(), bytes_each: num_bytes, progress: progress.clone(), next: 0, current }
    }

    /// The same, heard through another handle.
    pub fn watched_by(mut self, progress: &Progress) -> Self {
        self.progress = progress.clone();
        self
    }

    /// Whether any part is compressed.
    pub fn is_compressed(&self) -> bool {
        self.parts.iter().any(|p| p.is_deflated) || self.current.as_ref().is_some_and(|(s, _)| s.is_compressed())
    }

    /// Passes over `num_bytes`; parts that lie within are not even opened.
    ///
    /// # Errors
    /// If a file cannot be read, is damaged, or the work is cancelled.
    pub fn skip(&mut self, num_bytes: u64) -> Result<()> {
        let progress = self.progress.clone();
        let mut left = num_bytes;
        while left > 0 {
            if self.current.as_ref().is_none_or(|(_, in_part)| *in_part == 0) && left >= self.bytes_each {
                if self.next == self.parts.len() {
                    break;
                }
                self.next += 1;
                left -= self.bytes_each;
                progress.advance(self.bytes_each)?;
                continue;
            }
            if !self.next_or_current()? {
                break;
            }
            let Some((source, in_part)) = &mut self.current else { break };
            let n = left.min(*in_part);
            source.skip(n, &progress)?;
            *in_part -= n;
            left -= n;
        }
        Ok(())
    }

    /// After the last voxel that is wanted: [`ByteSource::finish`] of the part that was read last.
    ///
    /// # Errors
    /// As [`ByteSource::finish`].
    pub fn finish(&mut self) -> Result<()> {
        if let Some((source, _)) = &mut self.current {
            source.finish(&self.progress)?;
        }
        Ok(())
    }

    /// Sees to it that there is a part with bytes to come; false after the last one.
    fn next_or_current(&mut self) -> Result<bool> {
        if self.current.as_ref().is_some_and(|(_, left)| *left > 0) {
            return Ok(true);
        }
        let Some(part) = self.parts.get(self.next) else { return Ok(false) };
        self.current = Some((part.open()?, self.bytes_each));
        self.next += 1;
        Ok(true)
    }
}

impl Read for Parts {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() || !self.next_or_current().map_err(io::Error::other)? {
            return Ok(0);
        }
        let progress = self.progress.clone();
        let Some((source, left)) = &mut self.current else { return Ok(0) };
        let n = buffer.len().min(usize::try_from(*left).unwrap_or(usize::MAX));
        let got = source.read(&mut buffer[..n])?;
        *left -= got as u64;
        // The last part is finished by the caller, who may want less of it.
        if *left == 0 && self.next < self.parts.len() {
            source.finish(&progress).map_err(io::Error::other)?;
        }
        Ok(got)
    }
}

/// The file that a header beside it names: as named, else, for names from another computer, under its last name in the
/// header's folder.
///
/// # Errors
/// If there is none, or it is no file.
pub fn data_file(header: &Path, name: &str) -> Result<PathBuf> {
    let folder = header.parent().unwrap_or(Path::new(""));
    let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let candidates = [folder.join(name), folder.join(name.replace('\\', "/")), folder.join(last)];
    candidates.into_iter().find(|p| p.is_file()).ok_or_else(|| {
        Error::file(header, format!("the file with its voxels, {name}, is missing"), "put it beside the header")
    })
}

/// More slices than any scan has; names are made for no more.
const MAX_FILES: u64 = 1 << 20;

/// The files of a pattern: `slice%03d.raw` with numbers from `first` to `last` in steps.
///
/// # Errors
/// A clause if it is no pattern, or does not name `count` files.
pub fn files_of_pattern(
    pattern: &str,
    [first, last, step]: [i64; 3],
    count: u64,
) -> std::result::Result<Vec<String>, String> {
    let (before, width, after) = split_pattern(pattern)
        .ok_or_else(|| format!("`{pattern}` is no pattern with one number, like slice%03d.raw"))?;
    let named = if step == 0 || (last < first) != (step < 0) && last != first {
        0
    } else {
        (i128::from(last) - i128::from(first)) / i128::from(step) + 1
    };
    if named != i128::from(count) || count > MAX_FILES {
        return Err(format!(
            "the pattern `{pattern} {first} {last} {step}` names {named} files, where it takes {count}"
        ));
    }
    let number = |i: u64| i128::from(first) + i128::from(step) * i128::from(i);
    Ok((0..count)
        .map(|i| match width {
            Width::Zeros(n) => format!("{before}{:0n$}{after}", number(i)),
            Width::Blanks(n) => format!("{before}{:n$}{after}", number(i)),
        })
        .collect())
}

#[derive(Clone, Copy)]
enum Width {
    Zeros(usize),
    Blanks(usize),
}

/// What stands before and after the one number of a printf pattern, and its width.
fn split_pattern(pattern: &str) -> Option<(String, Width, String)> {
    let start = pattern.match_indices('%').find(|&(i, _)| {
        let before = pattern[..i].bytes().rev().take_while(|&b| b == b'%').count();
        before % 2 == 0 && pattern.as_bytes().get(i + 1) != Some(&b'%')
    })?;
    let rest = &pattern[start.0 + 1..];
    let end = rest.find(['d', 'i', 'u'])?;
    let digits = &rest[..end];
    // A width that no file name has is a mistake or worse.
    let width = if digits.is_empty() { 0 } else { digits.parse().ok().filter(|&w: &usize| w < 64)? };
    let width = if digits.starts_with('0') { Width::Zeros(width) } else { Width::Blanks(width) };
    let after = &rest[end + 1..];
    let plain = |text: &str| text.replace("%%", "%");
    (!after.replace("%%", "").contains('%')).then(|| (plain(&pattern[..start.0]), width, plain(after)))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Folder, zlib};
    use super::*;

    #[test]
    fn patterns_are_those_of_printf() {
        let files = |pattern, range, count| files_of_pattern(pattern, range, count).map(|f| f.join(","));
        assert_eq!(files("a%03d.raw", [9, 11, 1], 3).unwrap(), "a009.raw,a010.raw,a011.raw");
        assert_eq!(files("a%d.raw", [9, 13, 2], 3).unwrap(), "a9.raw,a11.raw,a13.raw");
        assert_eq!(files("a%d.raw", [3, 1, -1], 3).unwrap(), "a3.raw,a2.raw,a1.raw");
        assert_eq!(files("%%%3i%%", [7, 7, 1], 1).unwrap(), "%  7%");
        for (pattern, range, count) in [
            ("a.raw", [1, 1, 1], 1),
            ("a%s.raw", [1, 1, 1], 1),
            ("a%99d", [1, 1, 1], 1),
            ("a%d%d", [1, 1, 1], 1),
            ("%%d", [1, 1, 1], 1),
        ] {
            assert!(files(pattern, range, count).unwrap_err().contains("is no pattern"), "{pattern}");
        }
        for range in [[1, 4, 1], [1, 3, 0], [3, 1, 1], [i64::MIN, i64::MAX, 1]] {
            assert!(files("a%d", range, 3).unwrap_err().contains("where it takes 3"), "{range:?}");
        }
    }

    #[test]
    fn parts_are_one_stream() {
        let folder = Folder::new();
        let progress = Progress::new();
        let part =
            |name: &str, bytes: &[u8], start, is_deflated| Part { path: folder.write(name, bytes), start, is_deflated };
        let parts =
            vec![part("a", b"xx0123", 2, false), part("b", &zlib(b"4567"), 0, true), part("c", b"89abXX", 0, false)];
        for skipped in 0..12 {
            let mut stream = Parts::open(parts.clone(), 4, &progress).unwrap();
            stream.skip(skipped as u64).unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).unwrap();
            stream.finish().unwrap();
            assert_eq!(text, "0123456789ab"[skipped..]);
        }
        assert!(Parts::open(parts, 5, &progress).is_err());
    }
}
