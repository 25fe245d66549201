//! From the bytes of a file to typed voxels: plain, gzip or zlib, either byte order, one copy in memory.
//!
//! A header is only a claim. Nothing here allocates because of one: what a plain file cannot hold is refused
//! before the first byte is read ([`ByteSource::check_holds`]), and for compressed files the buffer grows with
//! what was decoded, so that a truncated or lying file costs no more than it decodes to.

use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use bytemuck::Pod;
use flate2::bufread::{GzDecoder, ZlibDecoder};

use super::window::{Averaged, Averaging, Collector, OnGrid};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::Voxels;

/// Bytes decoded between two looks at the progress handle: fits the second-level cache, so that the zeroing
/// before and the byte swap after the decoder cost next to nothing.
const CHUNK_BYTES: usize = 256 << 10;

/// Bytes fetched from the disk at once.
const INPUT_BUFFER_BYTES: usize = 1 << 20;

/// First allocation for compressed voxels; it doubles from there.
const FIRST_BUFFER_BYTES: usize = 4 << 20;

/// Deflate cannot pack tighter than this (a 258-byte match takes at least two bits).
const MAX_DEFLATE_RATIO: u64 = 1032;

/// The type of one stored number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElementType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl ElementType {
    /// Its name as NumPy spells it.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::U64 => "uint64",
            Self::I64 => "int64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }

    /// Bytes of one number.
    pub fn num_bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

/// Byte order of stored numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Endian {
    Little,
    Big,
}

impl Endian {
    /// The machine's.
    pub const NATIVE: Self = if cfg!(target_endian = "little") { Self::Little } else { Self::Big };

    fn is_native(self) -> bool {
        self == Self::NATIVE
    }
}

/// Whether the bytes are the beginning of a gzip file.
pub fn is_gzip(head: &[u8]) -> bool {
    head.starts_with(&[0x1f, 0x8b])
}

/// Size in bytes of `dims` elements, or `None` if it does not fit 63 bits.
pub fn size_bytes(dims: &[u64], element: ElementType) -> Option<u64> {
    let mut size = element.num_bytes() as u64;
    for &n in dims {
        size = size.checked_mul(n)?;
    }
    (size <= i64::MAX as u64).then_some(size)
}

/// The decoded bytes of a file from some position on, for [`Read`]: plain, a zlib stream, or the members of a gzip file.
pub struct ByteSource {
    path: PathBuf,
    stored_bytes: u64,
    bytes: Bytes,
}

enum Bytes {
    Plain(BufReader<File>),
    Gzip(Box<GzipMembers>),
    Zlib(Box<ZlibDecoder<BufReader<File>>>),
}

impl ByteSource {
    /// Opens `path` and looks at its first bytes to see whether it is compressed.
    ///
    /// # Errors
    /// If the file cannot be opened or read.
    pub fn open(path: &Path) -> Result<Self> {
        let mut file = open_buffered(path)?;
        let is_gzip = is_gzip(file.fill_buf().map_err(|e| Error::io(path, &e))?);
        Self::from_reader(path, file, 0, is_gzip)
    }

    /// Opens `path` at byte `start`, where gzip data or plain bytes begin.
    ///
    /// # Errors
    /// If the file cannot be opened or read.
    pub fn open_at(path: &Path, start: u64, is_gzip: bool) -> Result<Self> {
        let mut file = open_buffered(path)?;
        file.seek(SeekFrom::Start(start)).map_err(|e| Error::io(path, &e))?;
        Self::from_reader(path, file, start, is_gzip)
    }

    /// Opens `path` at byte `start`, where compressed data begin: gzip if they say so, else zlib.
    ///
    /// # Errors
    /// If the file cannot be opened or read.
    pub fn open_deflated_at(path: &Path, start: u64) -> Result<Self> {
        let mut file = open_buffered(path)?;
        file.seek(SeekFrom::Start(start)).map_err(|e| Error::io(path, &e))?;
        let is_gzip = is_gzip(file.fill_buf().map_err(|e| Error::io(path, &e))?);
        let mut source = Self::from_reader(path, file, start, is_gzip)?;
        if let Bytes::Plain(file) = source.bytes {
            source.bytes = Bytes::Zlib(Box::new(ZlibDecoder::new(file)));
        }
        Ok(source)
    }

    fn from_reader(path: &Path, file: BufReader<File>, start: u64, is_gzip: bool) -> Result<Self> {
        let length = file.get_ref().metadata().map_err(|e| Error::io(path, &e))?.len();
        let bytes = if is_gzip { Bytes::Gzip(Box::new(GzipMembers::new(file))) } else { Bytes::Plain(file) };
        Ok(Self { path: path.to_owned(), stored_bytes: length.saturating_sub(start), bytes })
    }

    /// Whether the bytes come out of gzip's decompressor.
    pub fn is_gzip(&self) -> bool {
        matches!(self.bytes, Bytes::Gzip(_))
    }

    /// Whether the bytes come out of a decompressor.
    pub fn is_compressed(&self) -> bool {
        !matches!(self.bytes, Bytes::Plain(_))
    }

    /// Refuses a header that promises more than the file can hold, before anything is allocated for it.
    ///
    /// # Errors
    /// If `num_bytes` from here on exceed the file or, when it is compressed, what deflate can pack into it.
    pub fn check_holds(&self, num_bytes: u64) -> Result<()> {
        let stored = self.stored_bytes;
        if self.is_compressed() {
            if num_bytes > stored.saturating_mul(MAX_DEFLATE_RATIO) {
                return Err(Error::file(
                    &self.path,
                    format!(
                        "the header promises {num_bytes} bytes of voxels, more than {stored} compressed bytes can hold"
                    ),
                    "the header is damaged or the file is cut off: copy or download it again",
                ));
            }
        } else if num_bytes > stored {
            return Err(Error::file(
                &self.path,
                format!("the header promises {num_bytes} bytes, but the file ends after {stored} of them"),
                "copy or download it again",
            ));
        }
        Ok(())
    }

    /// Passes over `num_bytes` decoded bytes without storing them.
    ///
    /// # Errors
    /// If the file ends before, is damaged, or the work is cancelled.
    pub fn skip(&mut self, num_bytes: u64, progress: &Progress) -> Result<()> {
        if let Bytes::Plain(file) = &mut self.bytes {
            let offset = i64::try_from(num_bytes).unwrap_or(i64::MAX);
            file.seek_relative(offset).map_err(|e| Error::io(&self.path, &e))?;
            return progress.advance(num_bytes);
        }
        let mut scratch = vec![0_u8; CHUNK_BYTES];
        let mut left = num_bytes;
        while left > 0 {
            let n = left.min(CHUNK_BYTES as u64) as usize;
            let got = read_full(self, &mut scratch[..n]).map_err(|e| decode_error(&self.path, &e))?;
            if got < n {
                let done = num_bytes - left + got as u64;
                return Err(ends_early(&self.path, done, num_bytes, "before the voxels"));
            }
            left -= n as u64;
            progress.advance(n as u64)?;
        }
        Ok(())
    }

    /// Up to `num_bytes` bytes from here; fewer only where the file ends.
    ///
    /// # Errors
    /// If the file cannot be read or is damaged. A gzip file that is cut off gives what there is.
    pub fn read_up_to(&mut self, num_bytes: usize) -> Result<Vec<u8>> {
        let mut bytes = vec![0; num_bytes];
        let got = read_full(self, &mut bytes).map_err(|e| decode_error(&self.path, &e))?;
        bytes.truncate(got);
        Ok(bytes)
    }

    /// After the last voxel that is wanted: inflates the rest of compressed data, because their checksum stands at the end
    /// and a few wrong bytes are voxels like others.
    ///
    /// # Errors
    /// If the checksum says that the data are damaged, or is missing.
    pub fn finish(&mut self, progress: &Progress) -> Result<()> {
        if !self.is_compressed() {
            return Ok(());
        }
        let mut rest = vec![0; 1 << 16];
        loop {
            progress.check()?;
            match self.read(&mut rest) {
                Ok(0) => return Ok(()),
                Ok(_) => {}
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) if e.kind() == ErrorKind::UnexpectedEof => {
                    let what = "the file ends before its checksum, so nobody knows whether the data are whole";
                    return Err(Error::file(&self.path, what, "copy or download it again"));
                }
                Err(e) => return Err(decode_error(&self.path, &e)),
            }
        }
    }
}

impl Read for ByteSource {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match &mut self.bytes {
            Bytes::Plain(file) => file.read(buffer),
            Bytes::Gzip(members) => members.read(buffer),
            Bytes::Zlib(stream) => stream.read(buffer),
        }
    }
}

fn open_buffered(path: &Path) -> Result<BufReader<File>> {
    let file = File::open(path).map_err(|e| Error::io(path, &e))?;
    // Folders of masks have hundreds of small files.
    let length = file.metadata().map_or(u64::MAX, |m| m.len());
    let capacity = usize::try_from(length).unwrap_or(usize::MAX).clamp(1 << 12, INPUT_BUFFER_BYTES);
    Ok(BufReader::with_capacity(capacity, file))
}

/// The members of a gzip file, one after the other; what follows the last one (tape padding) is ignored as
/// `gzip -d` does, where flate2's own `MultiGzDecoder` calls it an error.
struct GzipMembers {
    /// `None` after the last member.
    decoder: Option<GzDecoder<BufReader<File>>>,
    is_first: bool,
    is_fresh: bool,
}

impl GzipMembers {
    fn new(file: BufReader<File>) -> Self {
        Self { decoder: Some(GzDecoder::new(file)), is_first: true, is_fresh: true }
    }
}

impl Read for GzipMembers {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        while let Some(decoder) = &mut self.decoder {
            match decoder.read(buffer) {
                Ok(0) => {
                    let Some(mut rest) = self.decoder.take().map(GzDecoder::into_inner) else { break };
                    if rest.fill_buf()?.first() == Some(&0x1f) {
                        self.decoder = Some(GzDecoder::new(rest));
                        (self.is_first, self.is_fresh) = (false, true);
                    }
                }
                Ok(n) => {
                    self.is_fresh = false;
                    return Ok(n);
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                // Not a further member but padding that happens to begin with its first byte.
                Err(_) if self.is_fresh && !self.is_first => self.decoder = None,
                Err(e) => return Err(e),
            }
        }
        Ok(0)
    }
}

/// Fills `buffer` as far as the reader goes; the end of the data, also in the middle of a gzip stream, is no error.
pub fn read_full(reader: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match reader.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}

/// Passes over `num_bytes` of a reader that knows no better way.
///
/// # Errors
/// If the data end before or are damaged.
pub fn skip_bytes(reader: &mut impl Read, num_bytes: u64, path: &Path) -> Result<()> {
    let skipped = io::copy(&mut reader.take(num_bytes), &mut io::sink()).map_err(|e| decode_error(path, &e))?;
    if skipped < num_bytes { Err(ends_early(path, skipped, num_bytes, "before the voxels")) } else { Ok(()) }
}

/// The byte of the file after `num_lines` lines from byte `start` on.
///
/// # Errors
/// If the file cannot be read or has fewer lines.
pub fn skip_lines(path: &Path, start: u64, num_lines: u64) -> Result<u64> {
    if num_lines == 0 {
        return Ok(start);
    }
    let mut file = open_buffered(path)?;
    file.seek(SeekFrom::Start(start)).map_err(|e| Error::io(path, &e))?;
    let (mut position, mut left) = (start, num_lines);
    loop {
        let buffer = file.fill_buf().map_err(|e| Error::io(path, &e))?;
        if buffer.is_empty() {
            let what = format!("the header skips {num_lines} lines, but the file has {}", num_lines - left);
            return Err(Error::file(path, what, "correct `line skip` with the program that wrote the header"));
        }
        for (i, _) in buffer.iter().enumerate().filter(|(_, b)| **b == b'\n') {
            left -= 1;
            if left == 0 {
                return Ok(position + i as u64 + 1);
            }
        }
        let n = buffer.len();
        position += n as u64;
        file.consume(n);
    }
}

/// The sentence for an error while decoding: that of one of our own readers, a damaged stream, or the operating system's
/// word.
pub(super) fn decode_error(path: &Path, error: &io::Error) -> Error {
    match error.get_ref().and_then(|inner| inner.downcast_ref::<Error>()) {
        Some(Error::File { what, remedy, path }) => return Error::file(path, what, remedy),
        Some(Error::Cancelled) => return Error::Cancelled,
        _ => {}
    }
    match error.kind() {
        ErrorKind::InvalidInput | ErrorKind::InvalidData => {
            Error::file(path, format!("the compressed data are damaged ({error})"), "copy or download it again")
        }
        _ => Error::io(path, error),
    }
}

pub(super) fn ends_early(path: &Path, got: u64, expected: u64, what: &str) -> Error {
    Error::file(path, format!("the file ends after {got} of {expected} bytes {what}"), "copy or download it again")
}

/// What to decode: the numbers of one frame, of which a window is kept.
#[derive(Clone, Copy, Debug)]
pub struct VoxelRequest {
    /// Type of the stored numbers.
    pub element: ElementType,
    /// Their byte order.
    pub endian: Endian,
    /// Size of the frame, and what is kept of it.
    pub window: OnGrid,
    /// How several voxels become one.
    pub averaging: Averaging,
    /// Whether the size was checked against a plain file, so that the memory can be taken at once.
    pub is_size_checked: bool,
}

/// Decodes binary voxels from where `reader` stands.
///
/// # Errors
/// If the data end early or are damaged, memory runs out, or the work is cancelled.
pub fn read_voxels(reader: &mut impl Read, what: VoxelRequest, path: &Path, progress: &Progress) -> Result<Voxels> {
    Ok(match what.element {
        ElementType::U8 => Voxels::U8(read_binary(reader, what, path, progress)?),
        ElementType::I8 => Voxels::I8(read_binary(reader, what, path, progress)?),
        ElementType::U16 => Voxels::U16(read_binary(reader, what, path, progress)?),
        ElementType::I16 => Voxels::I16(read_binary(reader, what, path, progress)?),
        ElementType::U32 => Voxels::U32(read_binary(reader, what, path, progress)?),
        ElementType::I32 => Voxels::I32(read_binary(reader, what, path, progress)?),
        ElementType::U64 => Voxels::U64(read_binary(reader, what, path, progress)?),
        ElementType::I64 => Voxels::I64(read_binary(reader, what, path, progress)?),
        ElementType::F32 => Voxels::F32(read_binary(reader, what, path, progress)?),
        ElementType::F64 => Voxels::F64(read_binary(reader, what, path, progress)?),
    })
}

fn read_binary<T: Pod + Averaged>(
    reader: &mut impl Read,
    what: VoxelRequest,
    path: &Path,
    progress: &Progress,
) -> Result<Vec<T>> {
    let count = what.window.num_file_voxels();
    if !what.window.is_whole() {
        let mut collector = Collector::new(what.window, what.averaging, path);
        let mut chunk = vec![T::zeroed(); count.min(CHUNK_BYTES / size_of::<T>())];
        let mut done = 0;
        while !collector.is_full() && done < count {
            let n = chunk.len().min(count - done);
            read_chunk(reader, &mut chunk[..n], done, what, path, progress)?;
            collector.push(&chunk[..n])?;
            done += n;
        }
        return Ok(collector.finish());
    }
    let mut voxels = Vec::<T>::new();
    if what.is_size_checked {
        reserve(&mut voxels, count, path)?;
    }
    while voxels.len() < count {
        let start = voxels.len();
        let n = (count - start).min(CHUNK_BYTES / size_of::<T>());
        grow(&mut voxels, n, count, path)?;
        voxels.resize(start + n, T::zeroed());
        read_chunk(reader, &mut voxels[start..], start, what, path, progress)?;
    }
    Ok(voxels)
}

/// Decodes 8-bit colors of 3 channels, or of 4 with straight alpha, pixel by pixel from where `reader` stands: as sRGB with
/// straight alpha.
///
/// # Errors
/// As [`read_voxels`].
pub fn read_colors(
    reader: &mut impl Read,
    num_channels: usize,
    window: OnGrid,
    path: &Path,
    progress: &Progress,
) -> Result<Vec<[u8; 4]>> {
    let count = window.num_file_voxels();
    let mut collector = Collector::new(window, Averaging::Mean, path);
    let chunk_voxels = CHUNK_BYTES / num_channels;
    let mut bytes = vec![0; chunk_voxels.min(count) * num_channels];
    let mut colors = Vec::with_capacity(chunk_voxels.min(count));
    let mut done = 0;
    while !collector.is_full() && done < count {
        let n = chunk_voxels.min(count - done);
        let bytes = &mut bytes[..n * num_channels];
        let got = read_full(reader, bytes).map_err(|e| decode_error(path, &e))?;
        if got < bytes.len() {
            let (got, size) = ((done * num_channels + got) as u64, (count as u64).saturating_mul(num_channels as u64));
            return Err(ends_early(path, got, size, "of voxels"));
        }
        colors.clear();
        colors.extend(
            bytes.chunks_exact(num_channels).map(|c| [c[0], c[1], c[2], if num_channels == 4 { c[3] } else { 255 }]),
        );
        collector.push(&colors)?;
        done += n;
        progress.advance(got as u64)?;
    }
    Ok(collector.finish())
}

/// Fills `chunk`, whose first voxel is number `start` of the frame.
fn read_chunk<T: Pod>(
    reader: &mut impl Read,
    chunk: &mut [T],
    start: usize,
    what: VoxelRequest,
    path: &Path,
    progress: &Progress,
) -> Result<()> {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(chunk);
    let wanted = bytes.len();
    let got = read_full(reader, bytes).map_err(|e| decode_error(path, &e))?;
    if got < wanted {
        let size = size_of::<T>() as u64;
        let done = start as u64 * size + got as u64;
        return Err(ends_early(path, done, what.window.num_file_voxels() as u64 * size, "of voxels"));
    }
    if !what.endian.is_native() {
        swap_bytes(chunk);
    }
    progress.advance(got as u64)
}

/// Makes room for `extra` more: doubling, but never beyond the `expected` total.
pub(super) fn grow<T>(voxels: &mut Vec<T>, extra: usize, expected: usize, path: &Path) -> Result<()> {
    if voxels.capacity() - voxels.len() >= extra {
        return Ok(());
    }
    let target = voxels.capacity().saturating_mul(2).max(FIRST_BUFFER_BYTES / size_of::<T>());
    let target = target.max(voxels.len() + extra).min(expected);
    let additional = target - voxels.len();
    reserve(voxels, additional, path)
}

pub(super) fn reserve<T>(voxels: &mut Vec<T>, additional: usize, path: &Path) -> Result<()> {
    voxels.try_reserve_exact(additional).map_err(|_| {
        let mebibytes = (voxels.len() + additional).saturating_mul(size_of::<T>()) >> 20;
        Error::file(
            path,
            format!("there is not enough memory for its voxels ({mebibytes} MiB)"),
            "close other programs, or crop or downsample the volume",
        )
    })
}

/// Reverses the bytes of every element in place.
fn swap_bytes<T: Pod>(values: &mut [T]) {
    match size_of::<T>() {
        2 => bytemuck::cast_slice_mut::<T, u16>(values).iter_mut().for_each(|v| *v = v.swap_bytes()),
        4 => bytemuck::cast_slice_mut::<T, u32>(values).iter_mut().for_each(|v| *v = v.swap_bytes()),
        8 => bytemuck::cast_slice_mut::<T, u64>(values).iter_mut().for_each(|v| *v = v.swap_bytes()),
        _ => {}
    }
}

/// Decodes voxels written as decimal text, separated by white space or commas: those that `pick` takes.
///
/// # Errors
/// If a word is no number of the type, the text ends early, memory runs out, or the work is cancelled.
pub fn read_text_voxels(
    reader: &mut impl BufRead,
    what: VoxelRequest,
    pick: Pick,
    path: &Path,
    progress: &Progress,
) -> Result<Voxels> {
    Ok(match what.element {
        ElementType::U8 => Voxels::U8(read_text(reader, what, pick, path, progress)?),
        ElementType::I8 => Voxels::I8(read_text(reader, what, pick, path, progress)?),
        ElementType::U16 => Voxels::U16(read_text(reader, what, pick, path, progress)?),
        ElementType::I16 => Voxels::I16(read_text(reader, what, pick, path, progress)?),
        ElementType::U32 => Voxels::U32(read_text(reader, what, pick, path, progress)?),
        ElementType::I32 => Voxels::I32(read_text(reader, what, pick, path, progress)?),
        ElementType::U64 => Voxels::U64(read_text(reader, what, pick, path, progress)?),
        ElementType::I64 => Voxels::I64(read_text(reader, what, pick, path, progress)?),
        ElementType::F32 => Voxels::F32(read_text(reader, what, pick, path, progress)?),
        ElementType::F64 => Voxels::F64(read_text(reader, what, pick, path, progress)?),
    })
}

/// Which elements of a file belong to one frame: runs of `run` elements, one in every `period`, the first at `first`.
#[derive(Clone, Copy, Debug)]
pub struct Pick {
    /// Elements before the first run.
    pub first: u64,
    /// Elements of a run.
    pub run: u64,
    /// Elements from the beginning of a run to that of the next.
    pub period: u64,
    /// Elements of the frame in all.
    pub count: usize,
}

impl Pick {
    fn takes(&self, position: u64) -> bool {
        position >= self.first && (position - self.first) % self.period < self.run
    }
}

fn read_text<T: Pod + Averaged + FromStr>(
    reader: &mut impl BufRead,
    what: VoxelRequest,
    pick: Pick,
    path: &Path,
    progress: &Progress,
) -> Result<Vec<T>> {
    /// Longer than any number that a writer prints.
    const MAX_WORD: usize = 512;
    let mut voxels = Collector::<T>::new(what.window, what.averaging, path);
    let mut word = String::new();
    let (mut position, mut num_taken) = (0_u64, 0);
    while num_taken < pick.count {
        let buffer = reader.fill_buf().map_err(|e| decode_error(path, &e))?;
        let is_end = buffer.is_empty();
        // At the end of the file a blank closes the last word.
        let text = if is_end { b" " } else { buffer };
        let num_read = text.len();
        for &byte in text {
            if !(byte.is_ascii_whitespace() || byte == b',') {
                word.push(char::from(byte));
                if word.len() > MAX_WORD {
                    return Err(not_a_number(path, &word, position));
                }
            } else if !word.is_empty() {
                if pick.takes(position) {
                    voxels.push(&[word.parse().map_err(|_| not_a_number(path, &word, position))?])?;
                    num_taken += 1;
                    if num_taken == pick.count {
                        break;
                    }
                }
                word.clear();
                position += 1;
            }
        }
        if is_end {
            break;
        }
        reader.consume(num_read);
        progress.advance(num_read as u64)?;
    }
    if num_taken < pick.count {
        return Err(Error::file(
            path,
            format!("the text ends after {num_taken} of {} voxels", pick.count),
            "copy or download it again",
        ));
    }
    Ok(voxels.finish())
}

fn not_a_number(path: &Path, word: &str, position: u64) -> Error {
    let word: String = word.chars().take(24).collect();
    Error::file(
        path,
        format!("voxel {position} is `{word}`, which is no number of the file's type"),
        "write the file again",
    )
}

/// The bytes of one frame out of a file in which frames are interleaved, for [`Read`].
pub struct PickedBytes<R> {
    reader: R,
    run_bytes: u64,
    gap_bytes: u64,
    /// Bytes left of the present run.
    left: u64,
    scratch: Vec<u8>,
    scratch_range: std::ops::Range<usize>,
}

impl<R: Read> PickedBytes<R> {
    /// Takes `pick.run` elements of `element_bytes` in every `pick.period`, the first run beginning where
    /// `reader` stands.
    pub fn new(reader: R, pick: Pick, element_bytes: usize) -> Self {
        let size = element_bytes as u64;
        Self {
            reader,
            run_bytes: pick.run * size,
            gap_bytes: (pick.period - pick.run) * size,
            left: pick.run * size,
            scratch: vec![0; CHUNK_BYTES],
            scratch_range: 0..0,
        }
    }

    fn refill(&mut self) -> io::Result<bool> {
        if self.scratch_range.is_empty() {
            let n = self.reader.read(&mut self.scratch)?;
            self.scratch_range = 0..n;
        }
        Ok(!self.scratch_range.is_empty())
    }
}

impl<R: Read> Read for PickedBytes<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        while filled < buffer.len() {
            if self.left == 0 {
                let mut gap = self.gap_bytes;
                while gap > 0 {
                    // The gap behind the last run may be missing: the caller asks for no more then.
                    if !self.refill()? {
                        return Ok(filled);
                    }
                    let n = gap.min(self.scratch_range.len() as u64);
                    self.scratch_range.start += n as usize;
                    gap -= n;
                }
                self.left = self.run_bytes;
            }
            if !self.refill()? {
                return Ok(filled);
            }
            let n = self.scratch_range.len().min(buffer.len() - filled);
            let n = (n as u64).min(self.left) as usize;
            let from = self.scratch_range.start;
            buffer[filled..filled + n].copy_from_slice(&self.scratch[from..from + n]);
            self.scratch_range.start += n;
            self.left -= n as u64;
            filled += n;
        }
        Ok(filled)
    }
}

/// The magnitudes of complex numbers (real part, imaginary part), for [`Read`]: in the type of the parts, in the machine's
/// byte order.
pub struct Magnitudes<R> {
    reader: R,
    element: ElementType,
    endian: Endian,
    bytes: Vec<u8>,
    position: usize,
}

impl<R: Read> Magnitudes<R> {
    /// Takes pairs of `element`, F32 or F64, from where `reader` stands.
    pub fn new(reader: R, element: ElementType, endian: Endian) -> Self {
        Self { reader, element, endian, bytes: Vec::new(), position: 0 }
    }

    fn refill(&mut self) -> io::Result<()> {
        let mut pairs = vec![0; CHUNK_BYTES];
        let got = read_full(&mut self.reader, &mut pairs)?;
        self.bytes.clear();
        self.position = 0;
        let size = self.element.num_bytes();
        for pair in pairs[..got].chunks_exact(2 * size) {
            let (real, imaginary) = pair.split_at(size);
            if size == 4 {
                let magnitude = self.part(real).hypot(self.part(imaginary)) as f32;
                self.bytes.extend(magnitude.to_ne_bytes());
            } else {
                self.bytes.extend(self.part(real).hypot(self.part(imaginary)).to_ne_bytes());
            }
        }
        Ok(())
    }

    fn part(&self, bytes: &[u8]) -> f64 {
        let mut little = [0; 8];
        little[..bytes.len()].copy_from_slice(bytes);
        if self.endian == Endian::Big {
            little[..bytes.len()].reverse();
        }
        match bytes.len() {
            4 => f64::from(f32::from_le_bytes([little[0], little[1], little[2], little[3]])),
            _ => f64::from_le_bytes(little),
        }
    }
}

impl<R: Read> Read for Magnitudes<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.position == self.bytes.len() {
            self.refill()?;
        }
        let n = buffer.len().min(self.bytes.len() - self.position);
        buffer[..n].copy_from_slice(&self.bytes[self.position..self.position + n]);
        self.position += n;
        Ok(n)
    }
}

/// Bytes written as pairs of hexadecimal digits, for [`Read`].
pub struct HexBytes<R> {
    reader: R,
    scratch: Vec<u8>,
    high_digit: Option<u8>,
}

impl<R: Read> HexBytes<R> {
    /// Reads digits from where `reader` stands; white space between them is ignored.
    pub fn new(reader: R) -> Self {
        Self { reader, scratch: vec![0; CHUNK_BYTES], high_digit: None }
    }
}

impl<R: Read> Read for HexBytes<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        let mut filled = 0;
        while filled == 0 {
            // At most one byte per digit comes out, with the digit that is waiting.
            let n = buffer.len().min(self.scratch.len());
            let got = self.reader.read(&mut self.scratch[..n])?;
            if got == 0 {
                break;
            }
            for &byte in &self.scratch[..got] {
                if byte.is_ascii_whitespace() {
                    continue;
                }
                let digit = char::from(byte).to_digit(16).ok_or_else(|| {
                    io::Error::new(ErrorKind::InvalidData, format!("byte 0x{byte:02x} is no hexadecimal digit"))
                })? as u8;
                if let Some(high) = self.high_digit.take() {
                    buffer[filled] = high << 4 | digit;
                    filled += 1;
                } else {
                    self.high_digit = Some(digit);
                }
            }
        }
        Ok(filled)
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Folder, gzip, zlib};
    use super::*;

    fn request(count: usize) -> VoxelRequest {
        let window = super::super::window::Window::default().on(Path::new("a"), [count, 1, 1]).unwrap();
        let (element, averaging) = (ElementType::U16, Averaging::Mean);
        VoxelRequest { element, endian: Endian::Little, window, averaging, is_size_checked: false }
    }

    #[test]
    fn a_lie_about_the_size_costs_no_memory() {
        // 2⁵⁹ voxels would end the process if anything believed it.
        let error = read_voxels(&mut &[1, 2, 3][..], request(1 << 59), Path::new("a"), &Progress::new()).unwrap_err();
        assert!(error.to_string().contains("the file ends after 3 of"), "{error}");
        let believed = VoxelRequest { is_size_checked: true, ..request(1 << 59) };
        let error = read_voxels(&mut &[1, 2, 3][..], believed, Path::new("a"), &Progress::new()).unwrap_err();
        assert!(error.to_string().contains("not enough memory"), "{error}");
    }

    #[test]
    fn growing_ends_at_exactly_the_expected_size() {
        let bytes = vec![7; 20_000_002];
        let voxels = read_voxels(&mut &bytes[..], request(10_000_001), Path::new("a"), &Progress::new()).unwrap();
        let Voxels::U16(v) = voxels else { panic!("wrong type") };
        assert_eq!((v.len(), v.capacity()), (10_000_001, 10_000_001));
        assert!(v.iter().all(|&x| x == 0x0707));
    }

    #[test]
    fn gzip_members_follow_each_other_and_padding_is_ignored() {
        let folder = Folder::new();
        for padding in [&b""[..], &[0; 600], &[0x1f], &[0x1f, 0x8b, 0, 0], b"garbage"] {
            let bytes = [&gzip(&[1, 2]), &gzip(&[]), &gzip(&[3, 4, 5]), padding].concat();
            let mut source = ByteSource::open(&folder.write("a.gz", &bytes)).unwrap();
            assert_eq!(source.read_up_to(10).unwrap(), [1, 2, 3, 4, 5]);
            source.finish(&Progress::new()).unwrap();
        }
    }

    #[test]
    fn zlib_streams_are_read_and_checked() {
        let folder = Folder::new();
        let good = zlib(&[1, 2, 3, 4]);
        let read = |bytes: &[u8]| {
            let mut source = ByteSource::open_deflated_at(&folder.write("a", bytes), 2).unwrap();
            assert!(source.is_compressed());
            // A stream this short is decoded, and its checksum looked at, at once.
            let bytes = source.read_up_to(4).map_err(|e| e.to_string())?;
            assert_eq!(bytes, [1, 2, 3, 4]);
            source.finish(&Progress::new()).map_err(|e| e.to_string())
        };
        assert_eq!(read(&[b"xx", &good[..], b"more"].concat()), Ok(()));
        assert_eq!(read(&[b"xx", &gzip(&[1, 2, 3, 4])[..]].concat()), Ok(()));
        assert!(read(&[b"xx", &good[..good.len() - 1]].concat()).unwrap_err().contains("before its checksum"));
        let mut bad = good;
        *bad.last_mut().unwrap() ^= 1;
        assert!(read(&[b"xx", &bad[..]].concat()).unwrap_err().contains("the compressed data are damaged"));
    }

    #[test]
    fn the_checksum_is_checked() {
        let folder = Folder::new();
        let good = gzip(&[1, 2, 3, 4]);
        let finish = |bytes: &[u8]| {
            let mut source = ByteSource::open(&folder.write("a.gz", bytes)).unwrap();
            assert_eq!(source.read_up_to(4).unwrap(), [1, 2, 3, 4]);
            source.finish(&Progress::new()).map_err(|e| e.to_string())
        };
        assert_eq!(finish(&good), Ok(()));
        assert!(finish(&good[..good.len() - 1]).unwrap_err().contains("before its checksum"));
        let mut bad = good.clone();
        bad[good.len() - 8] ^= 1;
        assert!(finish(&bad).unwrap_err().contains("the compressed data are damaged"));
    }

    #[test]
    fn picked_bytes_and_hex_survive_every_buffer_size() {
        let bytes: Vec<u8> = (0..60).collect();
        let pick = Pick { first: 0, run: 2, period: 5, count: 24 };
        let expected: Vec<u8> = (0..60).filter(|b| b % 5 < 2).collect();
        let digits: String = bytes.iter().map(|b| format!("{b:02X}\n")).collect();
        for size in 1..30 {
            let mut picked = PickedBytes::new(&bytes[..], pick, 1);
            let mut hex = HexBytes::new(digits.as_bytes());
            let (mut got, mut got_hex) = (Vec::<u8>::new(), Vec::<u8>::new());
            let mut buffer = vec![0; size];
            while let n @ 1.. = picked.read(&mut buffer).unwrap() {
                got.extend(&buffer[..n]);
            }
            while let n @ 1.. = hex.read(&mut buffer).unwrap() {
                got_hex.extend(&buffer[..n]);
            }
            assert_eq!(got, expected);
            assert_eq!(got_hex, bytes);
        }
    }
}
