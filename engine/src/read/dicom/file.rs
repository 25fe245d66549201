//! One DICOM file: from its first byte to its pixels, without them.
//!
//! dicom-rs decodes the headers of elements; the walk over them is our own, because a header's lengths are only claims: here an
//! element takes the memory that the file can fill, sequences nest no deeper than [`MAX_DEPTH`], and what is not known by name
//! is passed over.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use dicom_core::header::{DataElementHeader, SequenceItemHeader};
use dicom_core::{Tag, VR};
use dicom_dictionary_std::tags;
use dicom_encoding::transfer_syntax::DynDecoder;
use flate2::bufread::DeflateDecoder;

use super::elements::{Elements, is_sequence_if_known, representation};
use super::syntax::Syntax;
use crate::error::{Error, Result};

/// Sequences in sequences that a header may have.
const MAX_DEPTH: usize = 12;

/// The largest element that is kept: offset tables of a hundred thousand frames fit.
const MAX_VALUE_BYTES: u64 = 16 << 20;

const ITEM_DELIMITER: Tag = Tag(0xfffe, 0xe00d);
const SEQUENCE_DELIMITER: Tag = Tag(0xfffe, 0xe0dd);

/// A header takes one or two of these.
const BUFFER_BYTES: usize = 8 << 10;

/// Where the pixels of a file are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelSpan {
    /// Byte of the data stream (of the file, or of what it inflates to) at which they begin.
    pub start: u64,
    /// Their bytes, `None` where they lie in fragments.
    pub num_bytes: Option<u64>,
    /// What they are.
    pub kind: PixelKind,
}

/// The three elements that hold pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelKind {
    /// Pixel Data.
    Integer,
    /// Float Pixel Data.
    Float,
    /// Double Float Pixel Data.
    Double,
}

/// A file whose header was read.
#[derive(Debug)]
pub struct DicomFile {
    /// Where it is.
    pub path: PathBuf,
    /// What of its header is known by name.
    pub elements: Elements,
    /// How it is written.
    pub syntax: Syntax,
    /// Its pixels, if it has any.
    pub pixels: Option<PixelSpan>,
    /// Byte of the file at which the data set begins, behind the file meta information.
    pub data_start: u64,
    /// Bytes of the file.
    pub num_bytes: u64,
}

/// Why a file is not used.
#[derive(Debug)]
pub enum Unusable {
    /// It does not look like DICOM.
    NotDicom,
    /// It does, but cannot be read.
    Faulty(Error),
}

/// Whether the bytes begin a DICOM file; those without a preamble are recognized by their first elements.
pub fn is_dicom(head: &[u8]) -> bool {
    head.get(128..132) == Some(b"DICM") || begins_data_set(head)
}

/// Whether the bytes are elements of a data set, in ascending order, from one of the groups with which files begin.
fn begins_data_set(head: &[u8]) -> bool {
    let mut at = 0;
    let mut last = Tag(0, 0);
    for i in 0..3 {
        let Some(h) = head.get(at..at + 8) else { return false };
        let tag = Tag(u16::from_le_bytes([h[0], h[1]]), u16::from_le_bytes([h[2], h[3]]));
        let is_plausible = if i == 0 {
            (tag.0 == 2 && tag.1 <= 2) || (tag.0 == 8 && tag.1 <= 0x18)
        } else {
            tag > last && tag.0 <= 0x20 && tag.0.is_multiple_of(2)
        };
        if !is_plausible {
            return false;
        }
        let is_explicit = VR::from_binary([h[4], h[5]]).is_some();
        let length = if is_explicit {
            u32::from(u16::from_le_bytes([h[6], h[7]]))
        } else {
            u32::from_le_bytes([h[4], h[5], h[6], h[7]])
        };
        if length > 1024 || !length.is_multiple_of(2) {
            return false;
        }
        // Long forms (OB of the file meta version) have their length behind.
        let is_long = is_explicit && matches!(&h[4..6], b"OB" | b"UN" | b"SQ");
        let extra = if is_long {
            let Some(l) = head.get(at + 8..at + 12) else { return false };
            4 + u32::from_le_bytes([l[0], l[1], l[2], l[3]]) as usize
        } else {
            length as usize
        };
        at = at.saturating_add(8).saturating_add(extra);
        last = tag;
    }
    true
}

impl DicomFile {
    /// Reads the header of a file.
    ///
    /// # Errors
    /// If it is no DICOM file, cannot be read, ends within its header or nests too deeply.
    pub fn open(path: &Path) -> std::result::Result<Self, Unusable> {
        let io = |e: io::Error| Unusable::Faulty(Error::io(path, &e));
        let file = File::open(path).map_err(io)?;
        let metadata = file.metadata().map_err(io)?;
        // Pipes and devices never end.
        if !metadata.is_file() {
            return Err(Unusable::NotDicom);
        }
        let num_bytes = metadata.len();
        let mut reader = BufReader::with_capacity(BUFFER_BYTES, file);
        let head = reader.fill_buf().map_err(io)?;
        let has_preamble = head.get(128..132) == Some(b"DICM");
        if !has_preamble && !begins_data_set(head) {
            return Err(Unusable::NotDicom);
        }
        let mut start = if has_preamble { 132 } else { 0 };
        reader.seek(SeekFrom::Start(start)).map_err(io)?;
        let mut source = Source { bytes: Bytes::Plain(reader), position: start, end: num_bytes };
        let fault = |f: Fault| Unusable::Faulty(f.into_error(path));

        let mut stated = None;
        let meta_decoder = decoder(true, false);
        while !source.is_at_end().map_err(io)? {
            start = source.position;
            let header = source.header(&meta_decoder).map_err(fault)?;
            if header.tag.0 != 2 {
                break;
            }
            let length = header.len.get().ok_or(Fault::Damaged).map_err(fault)?;
            if header.tag == tags::TRANSFER_SYNTAX_UID {
                let uid = source.value(u64::from(length)).map_err(fault)?;
                stated = Some(String::from_utf8_lossy(&uid).trim_matches(['\0', ' ']).to_owned());
            } else {
                source.skip(u64::from(length)).map_err(fault)?;
            }
            start = source.position;
        }
        let mut syntax = Syntax::from_uid(stated.as_deref());
        let Bytes::Plain(mut reader) = source.bytes else { return Err(fault(Fault::Damaged)) };
        reader.seek(SeekFrom::Start(start)).map_err(io)?;
        let bytes = if syntax.is_deflated {
            Bytes::Deflated(Box::new(BufReader::new(DeflateDecoder::new(reader))))
        } else {
            // Some writers state one syntax and write another: the first element shows which it is.
            let head = reader.fill_buf().map_err(io)?;
            if let Some(letters) = head.get(4..6) {
                let is_explicit = VR::from_binary([letters[0], letters[1]]).is_some();
                if !syntax.is_big_endian {
                    syntax.is_explicit = is_explicit;
                }
            }
            Bytes::Plain(reader)
        };
        let is_deflated = syntax.is_deflated;
        let mut source = if is_deflated {
            Source { bytes, position: 0, end: u64::MAX }
        } else {
            Source { bytes, position: start, end: num_bytes }
        };
        let mut walk = Walk {
            decoder: decoder(syntax.is_explicit, syntax.is_big_endian),
            implicit: decoder(false, false),
            is_big_endian: syntax.is_big_endian,
            pixels: None,
        };
        let elements = walk.data_set(&mut source, None, 0, false).map_err(fault)?;
        Ok(Self { path: path.to_owned(), elements, syntax, pixels: walk.pixels, data_start: start, num_bytes })
    }

    /// The data stream from a byte of it on, as [`PixelSpan`] counts them.
    ///
    /// # Errors
    /// If the file cannot be read or ends before.
    pub fn stream_from(&self, start: u64) -> Result<Box<dyn Read>> {
        let io = |e: io::Error| Error::io(&self.path, &e);
        let mut file = File::open(&self.path).map_err(io)?;
        if !self.syntax.is_deflated {
            file.seek(SeekFrom::Start(start)).map_err(io)?;
            return Ok(Box::new(file));
        }
        file.seek(SeekFrom::Start(self.data_start)).map_err(io)?;
        let mut inflated = DeflateDecoder::new(BufReader::new(file));
        let skipped = io::copy(&mut (&mut inflated).take(start), &mut io::sink())
            .map_err(|e| Fault::from(e).into_error(&self.path))?;
        if skipped < start {
            return Err(Fault::EndsEarly.into_error(&self.path));
        }
        Ok(Box::new(inflated))
    }
}

/// What can be wrong with a header.
#[derive(Debug)]
enum Fault {
    EndsEarly,
    Damaged,
    TooDeep,
    Io(io::Error),
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Self::EndsEarly,
            // What inflating says about bytes that nobody deflated.
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => Self::Damaged,
            _ => Self::Io(error),
        }
    }
}

impl Fault {
    fn into_error(self, path: &Path) -> Error {
        let what = match self {
            Self::EndsEarly => "the DICOM file ends within its header",
            Self::Damaged => "the DICOM header is damaged",
            Self::TooDeep => "the DICOM header nests sequences too deeply",
            Self::Io(error) => return Error::io(path, &error),
        };
        Error::file(path, what, "copy or export it again")
    }
}

type Walked<T> = std::result::Result<T, Fault>;

/// The bytes of a data set and where one stands in them.
struct Source {
    bytes: Bytes,
    position: u64,
    /// The position that no byte can have.
    end: u64,
}

enum Bytes {
    Plain(BufReader<File>),
    Deflated(Box<BufReader<DeflateDecoder<BufReader<File>>>>),
}

impl Read for Source {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = match &mut self.bytes {
            Bytes::Plain(reader) => reader.read(buffer)?,
            Bytes::Deflated(reader) => reader.read(buffer)?,
        };
        self.position += n as u64;
        Ok(n)
    }
}

impl Source {
    fn is_at_end(&mut self) -> io::Result<bool> {
        Ok(match &mut self.bytes {
            Bytes::Plain(reader) => reader.fill_buf()?.is_empty(),
            Bytes::Deflated(reader) => reader.fill_buf()?.is_empty(),
        })
    }

    fn header(&mut self, decoder: &DynDecoder<dyn Read>) -> Walked<DataElementHeader> {
        // dicom-rs wraps the cause of a failure; whether the bytes ran out is all that matters here.
        decoder.decode_header(self).map(|(header, _)| header).map_err(|_| self.fault_here())
    }

    fn item_header(&mut self, decoder: &DynDecoder<dyn Read>) -> Walked<SequenceItemHeader> {
        decoder.decode_item_header(self).map_err(|_| self.fault_here())
    }

    fn fault_here(&mut self) -> Fault {
        match self.is_at_end() {
            Ok(true) => Fault::EndsEarly,
            Ok(false) => Fault::Damaged,
            Err(error) => error.into(),
        }
    }

    /// A value of a claimed length: its memory grows with what is there.
    fn value(&mut self, num_bytes: u64) -> Walked<Vec<u8>> {
        if num_bytes > self.end.saturating_sub(self.position) {
            return Err(Fault::EndsEarly);
        }
        let mut bytes = Vec::new();
        (&mut *self).take(num_bytes).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < num_bytes { Err(Fault::EndsEarly) } else { Ok(bytes) }
    }

    fn skip(&mut self, num_bytes: u64) -> Walked<()> {
        if num_bytes > self.end.saturating_sub(self.position) {
            return Err(Fault::EndsEarly);
        }
        if let Bytes::Plain(reader) = &mut self.bytes {
            reader.seek_relative(i64::try_from(num_bytes).map_err(|_| Fault::EndsEarly)?)?;
            self.position += num_bytes;
            return Ok(());
        }
        let skipped = io::copy(&mut (&mut *self).take(num_bytes), &mut io::sink())?;
        if skipped < num_bytes { Err(Fault::EndsEarly) } else { Ok(()) }
    }
}

fn decoder(is_explicit: bool, is_big_endian: bool) -> DynDecoder<dyn Read> {
    use dicom_encoding::decode::explicit_be::ExplicitVRBigEndianDecoder;
    use dicom_encoding::decode::explicit_le::ExplicitVRLittleEndianDecoder;
    use dicom_encoding::decode::implicit_le::ImplicitVRLittleEndianDecoder;
    match (is_explicit, is_big_endian) {
        (true, true) => Box::<ExplicitVRBigEndianDecoder>::default(),
        (true, false) => Box::<ExplicitVRLittleEndianDecoder>::default(),
        (false, _) => Box::<ImplicitVRLittleEndianDecoder<_>>::default(),
    }
}

/// The walk over a data set.
struct Walk {
    decoder: DynDecoder<dyn Read>,
    /// For what is of unknown representation: such sequences are written without representations inside.
    implicit: DynDecoder<dyn Read>,
    is_big_endian: bool,
    pixels: Option<PixelSpan>,
}

impl Walk {
    /// The elements up to `end` (to the delimiter of an item, or at depth 0 to the pixels or the end of the file).
    fn data_set(&mut self, source: &mut Source, end: Option<u64>, depth: usize, is_implicit: bool) -> Walked<Elements> {
        let mut elements = Elements::new(self.is_big_endian && !is_implicit);
        if depth > MAX_DEPTH {
            return Err(Fault::TooDeep);
        }
        loop {
            if end.is_some_and(|end| source.position >= end) {
                return Ok(elements);
            }
            if depth == 0 && source.is_at_end()? {
                return Ok(elements);
            }
            let header = source.header(if is_implicit { &self.implicit } else { &self.decoder })?;
            let tag = header.tag;
            match tag {
                ITEM_DELIMITER => return Ok(elements),
                // Delimiters of what was of known length: some writers leave them.
                SEQUENCE_DELIMITER => continue,
                _ => {}
            }
            if depth == 0
                && let Some(kind) = pixel_kind(tag)
            {
                let num_bytes = header.len.get().map(u64::from);
                self.pixels = Some(PixelSpan { start: source.position, num_bytes, kind });
                return Ok(elements);
            }
            let vr = representation(tag, header.vr);
            let is_known_sequence = is_sequence_if_known(tag);
            let is_items_implicit = is_implicit || header.vr == VR::UN;
            match (header.len.get().map(u64::from), is_known_sequence) {
                (length, Some(true)) if vr == VR::SQ || length.is_none() => {
                    let end = length.map(|n| source.position.saturating_add(n));
                    let items = self.items(source, end, depth, is_items_implicit)?;
                    elements.push_items(tag, items);
                }
                (Some(length), Some(false)) if vr != VR::SQ && length <= MAX_VALUE_BYTES => {
                    let bytes = source.value(length)?;
                    elements.push_plain(tag, vr, bytes);
                }
                (Some(length), _) => source.skip(length)?,
                (None, _) => drop(self.items(source, None, depth, is_items_implicit)?),
            }
        }
    }

    /// The items of a sequence up to `end` or to its delimiter.
    fn items(
        &mut self,
        source: &mut Source,
        end: Option<u64>,
        depth: usize,
        is_implicit: bool,
    ) -> Walked<Vec<Elements>> {
        let mut items = Vec::new();
        loop {
            if end.is_some_and(|end| source.position >= end) {
                return Ok(items);
            }
            match source.item_header(if is_implicit { &self.implicit } else { &self.decoder })? {
                SequenceItemHeader::Item { len } => {
                    let item_end = len.get().map(|n| source.position.saturating_add(u64::from(n)));
                    items.push(self.data_set(source, item_end, depth + 1, is_implicit)?);
                }
                SequenceItemHeader::SequenceDelimiter => return Ok(items),
                SequenceItemHeader::ItemDelimiter => {}
            }
        }
    }
}

fn pixel_kind(tag: Tag) -> Option<PixelKind> {
    match tag {
        tags::PIXEL_DATA => Some(PixelKind::Integer),
        tags::FLOAT_PIXEL_DATA => Some(PixelKind::Float),
        tags::DOUBLE_FLOAT_PIXEL_DATA => Some(PixelKind::Double),
        _ => None,
    }
}
