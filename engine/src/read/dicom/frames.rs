//! The frames of a file, one at a time, wherever they lie: one behind the other, in fragments, in a deflated stream.

use std::io::Read;
use std::sync::OnceLock;

use super::codec::{self, Decoded};
use super::file::DicomFile;
use super::image::{Photometric, PixelFormat};
use super::syntax::Codec;
use crate::error::{Error, Result};
use dicom_dictionary_std::tags;

/// A file from which frames are read, by several threads if need be.
pub struct Frames<'a> {
    file: &'a DicomFile,
    format: PixelFormat,
    num_frames: usize,
    /// The fragments, found when the first frame is asked for.
    fragments: OnceLock<std::result::Result<Fragments, String>>,
    /// The pixels of a deflated file of several frames.
    inflated: OnceLock<std::result::Result<Vec<u8>, String>>,
}

/// Where the packed frames lie.
struct Fragments {
    /// Byte and number of bytes of each.
    places: Vec<(u64, u64)>,
    /// For every frame the first and, exclusive, last of its fragments.
    of_frame: Vec<(usize, usize)>,
}

/// Tag and length.
const ITEM_HEADER_BYTES: u64 = 8;

const REMEDY: &str = "copy or export it again";

impl<'a> Frames<'a> {
    /// The frames of a file; nothing is read yet.
    pub fn new(file: &'a DicomFile, format: PixelFormat, num_frames: usize) -> Self {
        Self { file, format, num_frames, fragments: OnceLock::new(), inflated: OnceLock::new() }
    }

    /// The numbers of a frame.
    ///
    /// # Errors
    /// One sentence if the file ends early, is damaged, or is packed in a way that nobody reads here.
    pub fn decode(&self, frame: usize) -> Result<Decoded> {
        let fault = |what: String| {
            let which = if self.num_frames > 1 { format!("frame {}", frame + 1) } else { "the picture".to_owned() };
            let remedy = match self.file.syntax.codec {
                Codec::Other(_) => "convert it to an uncompressed DICOM file (gdcmconv --raw, dcmconv)",
                _ => REMEDY,
            };
            Error::file(&self.file.path, format!("{which} cannot be read: {what}"), remedy)
        };
        let Some(span) = self.file.pixels else { return Err(fault("it is missing".to_owned())) };
        if span.num_bytes.is_some() {
            return self.native(frame, span.start);
        }
        let found = self.fragments.get_or_init(|| self.find_fragments(span.start));
        let fragments = found.as_ref().map_err(|what| fault(what.clone()))?;
        let &(begin, end) = fragments.of_frame.get(frame).ok_or_else(|| fault("it is missing".to_owned()))?;
        let mut data = Vec::new();
        for &(start, num_bytes) in &fragments.places[begin..end] {
            let mut stream = self.file.stream_from(start)?.take(num_bytes);
            let got = stream.read_to_end(&mut data).map_err(|e| Error::io(&self.file.path, &e))?;
            if (got as u64) < num_bytes {
                return Err(fault("the file ends early".to_owned()));
            }
        }
        codec::decode(self.file.syntax.codec, &data, &self.format).map_err(fault)
    }

    /// A frame that is not packed.
    fn native(&self, frame: usize, start: u64) -> Result<Decoded> {
        let path = &self.file.path;
        if let Codec::Other(name) = self.file.syntax.codec {
            return Err(Error::file(
                path,
                format!("its pixels are packed with {name}, which Fabrica does not read"),
                "convert it to an uncompressed DICOM file (gdcmconv --raw, dcmconv)",
            ));
        }
        let bits = self.format.frame_bits();
        // Frames of single bits follow each other without a gap, whatever their bytes.
        let (first_bit, end_bit) = (bits * frame as u64, bits * (frame as u64 + 1));
        let (first, end) = (first_bit / 8, end_bit.div_ceil(8));
        let num_bytes = (end - first) as usize;
        let mut bytes = Vec::new();
        let early = || Error::file(path, "the file ends before its pixels", REMEDY);
        if self.file.syntax.is_deflated && self.num_frames > 1 {
            let all = self.inflated.get_or_init(|| self.inflate(start));
            let all = all.as_ref().map_err(|what| Error::file(path, what.clone(), REMEDY))?;
            bytes.extend_from_slice(all.get(first as usize..end as usize).ok_or_else(early)?);
        } else {
            bytes
                .try_reserve_exact(num_bytes)
                .map_err(|_| Error::file(path, "there is not enough memory for it", "close other programs"))?;
            let stream = self.file.stream_from(start + first)?;
            stream.take(end - first).read_to_end(&mut bytes).map_err(|e| Error::io(path, &e))?;
            if bytes.len() < num_bytes {
                return Err(early());
            }
        }
        if self.format.bits_allocated == 1 {
            let shift = (first_bit % 8) as usize;
            let bit = |i: usize| bytes.get((i + shift) / 8).map_or(0, |byte| byte >> ((i + shift) % 8) & 1);
            bytes = (0..self.format.num_pixels()).map(bit).collect();
        } else if self.file.syntax.is_big_endian != cfg!(target_endian = "big") {
            let width = self.format.sample_bytes();
            bytes.chunks_exact_mut(width).for_each(<[u8]>::reverse);
        }
        if self.format.photometric == Photometric::YbrFull422 {
            // Two pixels share their color differences: Y Y Cb Cr.
            bytes = bytes.as_chunks::<4>().0.iter().flat_map(|[a, b, cb, cr]| [*a, *cb, *cr, *b, *cb, *cr]).collect();
            return Ok(Decoded { bytes, is_rgb: false, is_interleaved: true });
        }
        Ok(Decoded { bytes, is_rgb: false, is_interleaved: false })
    }

    fn inflate(&self, start: u64) -> std::result::Result<Vec<u8>, String> {
        let stream = self.file.stream_from(start).map_err(|_| "the file ends before its pixels".to_owned())?;
        let num_bytes = self.format.frame_bits().saturating_mul(self.num_frames as u64).div_ceil(8);
        let mut bytes = Vec::new();
        stream.take(num_bytes).read_to_end(&mut bytes).map_err(|_| "its compressed data are damaged".to_owned())?;
        Ok(bytes)
    }

    /// Finds the fragments and which of them make a frame: by their number, by the tables of offsets, or by how codestreams
    /// begin.
    fn find_fragments(&self, start: u64) -> std::result::Result<Fragments, String> {
        let gone = |_| "the file ends early".to_owned();
        let mut places = Vec::new();
        let mut table = Vec::new();
        let mut at = start;
        let mut file = std::fs::File::open(&self.file.path).map_err(gone)?;
        let mut is_table = true;
        while at + ITEM_HEADER_BYTES <= self.file.num_bytes {
            let mut header = [0; ITEM_HEADER_BYTES as usize];
            read_at(&mut file, at, &mut header).map_err(gone)?;
            let [g0, g1, e0, e1, length @ ..] = header;
            let num_bytes = u64::from(u32::from_le_bytes(length));
            match (u16::from_le_bytes([g0, g1]), u16::from_le_bytes([e0, e1])) {
                (0xfffe, 0xe000) => {}
                (0xfffe, 0xe0dd) => break,
                _ => return Err("its pieces are damaged".to_owned()),
            }
            at += ITEM_HEADER_BYTES;
            if num_bytes > self.file.num_bytes - at {
                // What is there of the last piece is no picture.
                break;
            }
            if is_table {
                let mut bytes = vec![0; num_bytes as usize];
                read_at(&mut file, at, &mut bytes).map_err(gone)?;
                table = bytes.as_chunks::<4>().0.iter().map(|b| u64::from(u32::from_le_bytes(*b))).collect();
                is_table = false;
            } else {
                places.push((at, num_bytes));
            }
            at += num_bytes;
        }
        let extended = self.file.elements.bytes(tags::EXTENDED_OFFSET_TABLE).unwrap_or_default();
        if table.is_empty() {
            table = extended.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b)).collect();
        }
        let of_frame = self.frames_of(&mut file, &places, &table);
        if of_frame.len() < self.num_frames && of_frame.is_empty() {
            return Err("its pieces are missing".to_owned());
        }
        Ok(Fragments { places, of_frame })
    }

    fn frames_of(&self, file: &mut std::fs::File, places: &[(u64, u64)], table: &[u64]) -> Vec<(usize, usize)> {
        let n = places.len();
        if self.num_frames == 1 {
            return if n == 0 { Vec::new() } else { vec![(0, n)] };
        }
        if n == self.num_frames {
            return (0..n).map(|i| (i, i + 1)).collect();
        }
        let begins: Vec<usize> = if table.len() == self.num_frames {
            // Offsets count from the header of the first fragment.
            let zero = places.first().map_or(0, |p| p.0);
            table.iter().filter_map(|offset| places.binary_search_by(|p| (p.0 - zero).cmp(offset)).ok()).collect()
        } else {
            let is_begin = |place: &(u64, u64)| {
                let mut head = [0; 2];
                read_at(file, place.0, &mut head).is_ok() && matches!(head, [0xff, 0xd8 | 0x4f])
            };
            let are_begins: Vec<bool> = places.iter().map(is_begin).collect();
            (0..n).filter(|i| are_begins[*i]).collect()
        };
        let ends = begins.iter().skip(1).copied().chain([n]);
        begins.iter().copied().zip(ends).collect()
    }
}

fn read_at(file: &mut std::fs::File, at: u64, bytes: &mut [u8]) -> std::io::Result<()> {
    use std::io::{Seek, SeekFrom};
    file.seek(SeekFrom::Start(at))?;
    file.read_exact(bytes)
}
