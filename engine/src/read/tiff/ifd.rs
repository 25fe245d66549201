//! The directories of a TIFF file: classic and BigTIFF, either byte order. Standard: TIFF 6.0; BigTIFF as in libtiff.
//!
//! No value is read before its size was checked against the file, and all directories together may not ask for more
//! bytes than the file has (pages may share values, but real files have little to share).

use std::collections::HashSet;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::super::stream::Endian;
use crate::error::{Error, Result, remedies};
use crate::progress::Progress;

/// More than any adapter takes of a slice; packed pixels may say so with next to no bytes.
const MAX_PIXELS: u64 = 1 << 30;

/// What the numbers of a sample are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleFormat {
    Unsigned,
    Signed,
    Float,
}

/// Everything about one page but its pixels.
#[derive(Clone, Debug)]
pub struct Page {
    pub width: u64,
    pub height: u64,
    pub bits: u16,
    /// Numbers of one pixel.
    pub num_samples: u16,
    pub format: SampleFormat,
    pub photometric: u16,
    pub compression: u16,
    pub predictor: u16,
    pub fill_order: u16,
    pub orientation: u16,
    /// Whether every sample has chunks of its own.
    pub is_planar: bool,
    /// What the samples beyond those of the color are.
    pub extra_samples: Vec<u64>,
    /// Width and height of a strip or tile.
    pub chunk: [u64; 2],
    pub is_tiled: bool,
    pub offsets: Vec<u64>,
    pub byte_counts: Vec<u64>,
    /// Red, green, blue of every palette entry, 16 bits each, one channel after the other.
    pub palette: Vec<u16>,
    pub jpeg_tables: Vec<u8>,
    /// Whether it is a smaller copy of another page, or its mask.
    pub is_auxiliary: bool,
    /// Pixels per unit along x and y.
    pub resolution: Option<[f64; 2]>,
    pub resolution_unit: u16,
    pub description: String,
}

/// An open TIFF file.
pub struct Tiff {
    path: PathBuf,
    file: BufReader<File>,
    pub length: u64,
    pub endian: Endian,
    pub is_big: bool,
    /// Bytes that values may still take.
    budget: u64,
}

/// Whether the bytes begin a TIFF file.
pub fn is_tiff(head: &[u8]) -> bool {
    [&b"II*\0"[..], b"MM\0*", b"II+\0\x08\0\0\0", b"MM\0+\0\x08\0\0"].iter().any(|magic| head.starts_with(magic))
}

impl Tiff {
    /// Opens a file and reads its directories.
    ///
    /// # Errors
    /// If it is no TIFF file, is damaged, or a page is what no volume can be made of.
    pub fn open(path: &Path, progress: &Progress) -> Result<(Self, Vec<Page>)> {
        let file = File::open(path).map_err(|e| Error::io(path, &e))?;
        let length = file.metadata().map_err(|e| Error::io(path, &e))?.len();
        let file = BufReader::with_capacity(4 << 10, file);
        let mut tiff =
            Self { path: path.to_owned(), file, length, endian: Endian::Little, is_big: false, budget: length };
        let head = tiff.bytes_at(0, length.min(16))?;
        if !is_tiff(&head) {
            return Err(Error::file(
                path,
                "this is no TIFF file: it does not begin with its mark",
                remedies::DESCRIBE_VOXELS,
            ));
        }
        tiff.endian = if head[0] == b'I' { Endian::Little } else { Endian::Big };
        tiff.is_big = head[2] == 43 || head[3] == 43;
        let first = if tiff.is_big { head.get(8..16) } else { head.get(4..8) };
        let mut next = first.map_or(0, |bytes| tiff.number(bytes));
        let (mut seen, mut pages) = (HashSet::new(), Vec::new());
        while next != 0 {
            progress.check()?;
            if !seen.insert(next) {
                return Err(tiff.fault("the directories of its pages run in a circle"));
            }
            let entries;
            (entries, next) = tiff.directory(next)?;
            let page = tiff.page(&entries, pages.len())?;
            pages.push(page);
        }
        if pages.is_empty() {
            return Err(tiff.fault("the file has no page"));
        }
        Ok((tiff, pages))
    }

    /// `num_bytes` from byte `start` on.
    ///
    /// # Errors
    /// If the file ends before.
    pub fn bytes_at(&mut self, start: u64, num_bytes: u64) -> Result<Vec<u8>> {
        if start.checked_add(num_bytes).is_none_or(|end| end > self.length) {
            return Err(Error::file(
                &self.path,
                format!("{num_bytes} bytes at byte {start} lie beyond its end at {}", self.length),
                "copy or download it again",
            ));
        }
        let io = |e| Error::io(&self.path, &e);
        self.file.seek(SeekFrom::Start(start)).map_err(io)?;
        let mut bytes = vec![0; num_bytes as usize];
        self.file.read_exact(&mut bytes).map_err(io)?;
        Ok(bytes)
    }

    fn fault(&self, what: impl Into<String>) -> Error {
        Error::file(&self.path, what, "copy or download it again")
    }

    fn number(&self, bytes: &[u8]) -> u64 {
        let fold = |n: u64, b: &u8| n << 8 | u64::from(*b);
        if self.endian == Endian::Little { bytes.iter().rev().fold(0, fold) } else { bytes.iter().fold(0, fold) }
    }

    /// The entries of a directory, and where the next one is.
    fn directory(&mut self, start: u64) -> Result<(Vec<Field>, u64)> {
        let (count_bytes, entry_bytes, inline) = if self.is_big { (8, 20, 8) } else { (2, 12, 4) };
        let head = self.bytes_at(start, count_bytes)?;
        let count = self.number(&head);
        // Tags are 16-bit numbers and appear once.
        if count > 65536 {
            return Err(self.fault(format!("a directory promises {count} entries")));
        }
        self.spend(count * entry_bytes)?;
        let bytes = self.bytes_at(start + count_bytes, count * entry_bytes + inline)?;
        let (entries, next) = bytes.split_at((count * entry_bytes) as usize);
        let mut fields = Vec::new();
        for entry in entries.chunks_exact(entry_bytes as usize) {
            let value = &entry[entry.len() - inline as usize..];
            fields.push(Field {
                tag: self.number(&entry[..2]) as u16,
                kind: self.number(&entry[2..4]) as u16,
                count: self.number(&entry[4..entry.len() - inline as usize]),
                inline: value.to_vec(),
            });
        }
        Ok((fields, self.number(next)))
    }

    /// Takes bytes from the budget.
    fn spend(&mut self, num_bytes: u64) -> Result<()> {
        let left = self.budget.checked_sub(num_bytes);
        self.budget = left.ok_or_else(|| self.fault("its directories promise more than the file holds"))?;
        Ok(())
    }

    /// The bytes of a field's value.
    fn value(&mut self, field: &Field) -> Result<Vec<u8>> {
        let width = match field.kind {
            1 | 2 | 6 | 7 => 1,
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16 | 17 | 18 => 8,
            other => return Err(self.fault(format!("tag {} has the unknown type {other}", field.tag))),
        };
        let num_bytes = field.count.saturating_mul(width);
        if num_bytes <= field.inline.len() as u64 {
            return Ok(field.inline[..num_bytes as usize].to_vec());
        }
        self.spend(num_bytes)?;
        let start = self.number(&field.inline);
        self.bytes_at(start, num_bytes)
    }

    fn integers(&mut self, fields: &[Field], tag: u16) -> Result<Vec<u64>> {
        let Some(field) = fields.iter().find(|f| f.tag == tag) else { return Ok(Vec::new()) };
        let width = match field.kind {
            1 | 6 | 7 => 1,
            3 | 8 => 2,
            4 | 9 | 13 => 4,
            16..=18 => 8,
            _ => return Err(self.fault(format!("tag {tag} is no integer"))),
        };
        let bytes = self.value(field)?;
        Ok(bytes.chunks_exact(width).map(|b| self.number(b)).collect())
    }

    fn integer(&mut self, fields: &[Field], tag: u16) -> Result<Option<u64>> {
        Ok(self.integers(fields, tag)?.first().copied())
    }

    fn code(&mut self, fields: &[Field], tag: u16, default: u16) -> Result<u16> {
        Ok(self.integer(fields, tag)?.map_or(default, |n| u16::try_from(n).unwrap_or(u16::MAX)))
    }

    /// A positive fraction.
    fn ratio(&mut self, fields: &[Field], tag: u16) -> Result<Option<f64>> {
        let Some(field) = fields.iter().find(|f| f.tag == tag && f.kind == 5) else { return Ok(None) };
        let bytes = self.value(field)?;
        let Some((top, bottom)) = bytes.get(..8).map(|b| b.split_at(4)) else { return Ok(None) };
        let ratio = self.number(top) as f64 / self.number(bottom) as f64;
        Ok((ratio.is_finite() && ratio > 0.0).then_some(ratio))
    }

    fn raw(&mut self, fields: &[Field], tag: u16) -> Result<Vec<u8>> {
        fields.iter().find(|f| f.tag == tag).map_or(Ok(Vec::new()), |field| self.value(field))
    }

    fn page(&mut self, fields: &[Field], index: usize) -> Result<Page> {
        let number = index + 1;
        let width = self.integer(fields, 256)?.unwrap_or(0);
        let height = self.integer(fields, 257)?.unwrap_or(0);
        if width == 0 || height == 0 || width.checked_mul(height).is_none_or(|n| n > MAX_PIXELS) {
            return Err(self.fault(format!("page {number} promises {width} x {height} pixels")));
        }
        let bits = self.integers(fields, 258)?;
        if bits.iter().any(|b| *b != bits[0]) {
            return Err(Error::file(
                &self.path,
                format!("the samples of page {number} have different numbers of bits"),
                "save it with as many bits for every channel",
            ));
        }
        let formats = self.integers(fields, 339)?;
        let format = match formats.first().copied() {
            // 4 is "not known": bytes as they are.
            None | Some(1 | 4) => SampleFormat::Unsigned,
            Some(2) => SampleFormat::Signed,
            Some(3) => SampleFormat::Float,
            Some(other) => {
                return Err(Error::file(
                    &self.path,
                    format!("the sample format {other} of page {number} is none that Fabrica reads (complex numbers?)"),
                    "save it as integers or floating-point numbers",
                ));
            }
        };
        let is_tiled = fields.iter().any(|f| f.tag == 324);
        let offsets = self.integers(fields, if is_tiled { 324 } else { 273 })?;
        let byte_counts = self.integers(fields, if is_tiled { 325 } else { 279 })?;
        let chunk = if is_tiled {
            [self.integer(fields, 322)?.unwrap_or(0), self.integer(fields, 323)?.unwrap_or(0)]
        } else {
            [width, self.integer(fields, 278)?.unwrap_or(height).min(height)]
        };
        let subfile = self.integer(fields, 254)?.unwrap_or(0);
        let old_subfile = self.integer(fields, 255)?.unwrap_or(0);
        let palette = self.integers(fields, 320)?.into_iter().map(|n| n as u16).collect();
        let resolution = self.ratio(fields, 282)?.zip(self.ratio(fields, 283)?).map(|(x, y)| [x, y]);
        let mut page = Page {
            width,
            height,
            bits: bits.first().map_or(1, |b| u16::try_from(*b).unwrap_or(u16::MAX)),
            num_samples: self.code(fields, 277, 1)?,
            format,
            photometric: self.code(fields, 262, 1)?,
            compression: self.code(fields, 259, 1)?,
            predictor: self.code(fields, 317, 1)?,
            fill_order: self.code(fields, 266, 1)?,
            orientation: self.code(fields, 274, 1)?,
            is_planar: self.code(fields, 284, 1)? == 2,
            extra_samples: self.integers(fields, 338)?,
            chunk,
            is_tiled,
            offsets,
            byte_counts,
            palette,
            jpeg_tables: self.raw(fields, 347)?,
            is_auxiliary: subfile & 5 != 0 || old_subfile == 2,
            resolution,
            resolution_unit: self.code(fields, 296, 2)?,
            description: String::from_utf8_lossy(&self.raw(fields, 270)?).trim_end_matches('\0').to_owned(),
        };
        if page.num_samples < 2 {
            page.is_planar = false;
        }
        // Old writers leave the counts of uncompressed strips out.
        if page.byte_counts.is_empty() && page.compression == 1 && page.offsets.len() == 1 {
            page.byte_counts = vec![page.num_bytes()];
        }
        if page.bits == 0 || page.num_samples == 0 {
            return Err(self.fault(format!("page {number} has {} samples of {} bits", page.num_samples, page.bits)));
        }
        self.check_chunks(&page, number)?;
        Ok(page)
    }

    /// Whether there are as many chunks as the sizes say, within the file, with room for the pixels.
    fn check_chunks(&self, page: &Page, number: usize) -> Result<()> {
        let [across, down] = page.chunks_across_down();
        let planes = if page.is_planar { u64::from(page.num_samples) } else { 1 };
        let expected = across.checked_mul(down).and_then(|n| n.checked_mul(planes));
        let given = page.offsets.len();
        if page.chunk.contains(&0) || expected != Some(given as u64) || page.byte_counts.len() != given || given == 0 {
            return Err(self.fault(format!("page {number} has {given} strips or tiles, which do not make up its size")));
        }
        let mut stored = 0_u64;
        for (&offset, &count) in page.offsets.iter().zip(&page.byte_counts) {
            if offset.checked_add(count).is_none_or(|end| end > self.length) {
                return Err(self.fault(format!("the pixels of page {number} lie beyond the end of the file")));
            }
            stored = stored.saturating_add(count);
        }
        // None of the compressions packs a byte of pixels tighter.
        let ratio = if page.compression == 1 { 1 } else { 4096 };
        let (num_bytes, most) = (page.num_bytes(), stored.saturating_mul(ratio));
        if num_bytes > most {
            return Err(self.fault(format!(
                "page {number} promises {num_bytes} bytes of pixels, more than its {stored} stored bytes can hold"
            )));
        }
        Ok(())
    }
}

impl Page {
    /// Strips or tiles along x and y.
    pub fn chunks_across_down(&self) -> [u64; 2] {
        let [w, h] = self.chunk.map(|n| n.max(1));
        [self.width.div_ceil(w), self.height.div_ceil(h)]
    }

    /// Bytes of all its samples as they are packed.
    pub fn num_bytes(&self) -> u64 {
        let planes = if self.is_planar { u64::from(self.num_samples) } else { 1 };
        self.row_bytes(self.width).saturating_mul(self.height).saturating_mul(planes)
    }

    /// Bytes of a row of packed samples (of one plane).
    pub fn row_bytes(&self, width: u64) -> u64 {
        let samples = if self.is_planar { 1 } else { u64::from(self.num_samples) };
        width.saturating_mul(samples).saturating_mul(u64::from(self.bits)).div_ceil(8)
    }
}

/// An entry of a directory.
struct Field {
    tag: u16,
    kind: u16,
    count: u64,
    /// The value, or where it is.
    inline: Vec<u8>,
}
