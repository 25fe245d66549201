//! What a file's header says about all of its frames: their format, how many there are, which series they belong to.

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use super::elements::Charset;
use super::file::{DicomFile, PixelKind};
use super::syntax::Codec;
use crate::error::{Error, Result};
use crate::volume::Modality;

/// How colors and brightnesses are coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Photometric {
    /// Small numbers are bright.
    Monochrome1,
    /// Small numbers are dark.
    Monochrome2,
    /// Red, green, blue.
    Rgb,
    /// Luma and color differences, full range (JPEG's).
    YbrFull,
    /// The same, the differences at half the width.
    YbrFull422,
    /// Numbers of a table of colors.
    Palette,
}

/// How one pixel is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelFormat {
    /// Pixels of a row.
    pub columns: usize,
    /// Rows of a frame.
    pub rows: usize,
    /// Numbers of a pixel: 1 or 3.
    pub samples: usize,
    /// Bits that a number takes: 1, 8, 16, 32 or 64.
    pub bits_allocated: usize,
    /// Bits that belong to the number.
    pub bits_stored: usize,
    /// The highest of them.
    pub high_bit: usize,
    /// Whether numbers have a sign.
    pub is_signed: bool,
    /// Whether a frame has all reds, then all greens, then all blues.
    pub is_planar: bool,
    /// What numbers are.
    pub kind: PixelKind,
    /// What they mean.
    pub photometric: Photometric,
}

impl PixelFormat {
    /// Pixels of a frame.
    pub fn num_pixels(&self) -> usize {
        self.rows * self.columns
    }

    /// Bits of a frame that is not packed.
    pub fn frame_bits(&self) -> u64 {
        let samples = if self.photometric == Photometric::YbrFull422 { 2 } else { self.samples };
        self.num_pixels() as u64 * samples as u64 * self.bits_allocated as u64
    }

    /// Bytes of one number in memory.
    pub fn sample_bytes(&self) -> usize {
        self.bits_allocated.div_ceil(8)
    }

    /// Whether pixels become colors.
    pub fn is_color(&self) -> bool {
        !matches!(self.photometric, Photometric::Monochrome1 | Photometric::Monochrome2)
    }

    /// The numbers that may occur.
    pub fn stored_range(&self) -> (f64, f64) {
        let span = 2_f64.powi(self.bits_stored as i32);
        if self.is_signed { (-span / 2.0, span / 2.0 - 1.0) } else { (0.0, span - 1.0) }
    }
}

/// What all frames of a file share.
#[derive(Clone, Debug)]
pub struct Image {
    /// How its pixels are stored.
    pub format: PixelFormat,
    /// Frames in it.
    pub num_frames: usize,
    /// What tells its series from others; never leaves the reader.
    pub series_uid: String,
    /// What tells this picture from others; never leaves the reader.
    pub instance_uid: String,
    /// What holds the files of one divided picture together; never leaves the reader.
    pub concatenation_uid: Option<String>,
    /// The number of the series in its study: orders lists.
    pub series_number: f64,
    /// What the values mean.
    pub modality: Modality,
    /// DICOM's code of it.
    pub modality_code: String,
    /// Series Description.
    pub description: String,
    /// Whether a table that is not applied would turn its numbers into values.
    pub has_value_table: bool,
}

/// Kinds of DICOM files that hold no picture, and SOP classes by which they are known.
const WITHOUT_PICTURE: &[(&str, &str)] = &[
    ("1.2.840.10008.5.1.4.1.1.481.3", "a structure set of contours (RTSTRUCT)"),
    ("1.2.840.10008.5.1.4.1.1.481.5", "a radiotherapy plan (RTPLAN)"),
    ("1.2.840.10008.5.1.4.1.1.481.8", "a radiotherapy plan (RTPLAN)"),
    ("1.2.840.10008.5.1.4.1.1.88.", "a structured report"),
    ("1.2.840.10008.5.1.4.1.1.11.", "a presentation state"),
    ("1.2.840.10008.5.1.4.1.1.104.", "an embedded document"),
    ("1.2.840.10008.5.1.4.1.1.66.1", "a registration"),
    ("1.2.840.10008.5.1.4.1.1.66.3", "a registration"),
    ("1.2.840.10008.5.1.4.1.1.66.5", "a set of surfaces"),
    ("1.2.840.10008.5.1.4.1.1.66.6", "a set of tracts"),
    ("1.2.840.10008.5.1.4.1.1.66", "raw data of a scanner"),
    ("1.2.840.10008.5.1.4.1.1.9.", "a waveform"),
    ("1.2.840.10008.1.3.10", "an index of other files (DICOMDIR)"),
];

/// The SOP classes of segmentations: binary or fractional, and label maps.
const SEGMENTATIONS: [&str; 2] = ["1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7"];

/// Whether a file is a segmentation.
pub fn is_segmentation(file: &DicomFile) -> bool {
    file.elements.word(tags::SOP_CLASS_UID).is_some_and(|uid| SEGMENTATIONS.contains(&uid.as_str()))
}

/// Refuses a file without pixels, by the name of what it is.
///
/// # Errors
/// One sentence.
pub fn check_has_pixels(file: &DicomFile) -> Result<()> {
    if file.pixels.is_some() {
        return Ok(());
    }
    let class = file.elements.word(tags::SOP_CLASS_UID).unwrap_or_default();
    let kind = WITHOUT_PICTURE.iter().find(|(uid, _)| class == *uid || (uid.ends_with('.') && class.starts_with(uid)));
    Err(match kind {
        Some((_, name)) => Error::file(
            &file.path,
            format!("this DICOM file is {name} and holds no voxels"),
            "name the folder of the pictures that it belongs to",
        ),
        None => Error::file(
            &file.path,
            "this DICOM file ends without a picture",
            "if it should have one, copy or export it again",
        ),
    })
}

/// DICOM's codes of modalities: they are written into keys and titles, so only what is known gets there.
fn modality(code: &str) -> Modality {
    match code {
        "CT" => Modality::Ct,
        "MR" => Modality::Mr,
        "PT" => Modality::Pet,
        "NM" => Modality::Nuclear,
        "US" | "IVUS" => Modality::Ultrasound,
        "CR" | "DX" | "MG" | "XA" | "RF" | "RG" | "PX" | "IO" | "DR" => Modality::XRay,
        _ => Modality::Unknown,
    }
}

impl Image {
    /// What a file with pixels says about them.
    ///
    /// # Errors
    /// One sentence for sizes of 0, formats that DICOM does not know and pixels that the file is too short for.
    pub fn of(file: &DicomFile) -> Result<Self> {
        check_has_pixels(file)?;
        let e = &file.elements;
        let format = pixel_format(file)?;
        let num_frames = e.count(tags::NUMBER_OF_FRAMES).unwrap_or(1).max(1);
        check_size(file, &format, num_frames)?;
        let code = e.word(tags::MODALITY).unwrap_or_default();
        let is_code = (2..=8).contains(&code.len()) && code.bytes().all(|b| b.is_ascii_uppercase());
        Ok(Self {
            format,
            num_frames: usize::try_from(num_frames).unwrap_or(usize::MAX),
            series_uid: e.word(tags::SERIES_INSTANCE_UID).unwrap_or_default(),
            instance_uid: e.word(tags::SOP_INSTANCE_UID).unwrap_or_default(),
            concatenation_uid: e.word(tags::CONCATENATION_UID),
            series_number: e.number(tags::SERIES_NUMBER).unwrap_or(f64::MAX),
            modality: modality(&code),
            modality_code: if is_code { code } else { String::new() },
            description: e.text(tags::SERIES_DESCRIPTION, &Charset::of(e)).unwrap_or_default(),
            has_value_table: e.item(tags::MODALITY_LUT_SEQUENCE).is_some() && !e.has(tags::RESCALE_SLOPE),
        })
    }
}

fn pixel_format(file: &DicomFile) -> Result<PixelFormat> {
    let e = &file.elements;
    let kind = file.pixels.map_or(PixelKind::Integer, |p| p.kind);
    let fault = |what: String| Error::file(&file.path, what, "export it again from the program it came from");
    let size = |tag: Tag| e.count(tag).and_then(|n| usize::try_from(n).ok()).unwrap_or(0);
    let (columns, rows) = (size(tags::COLUMNS), size(tags::ROWS));
    if columns == 0 || rows == 0 || columns > 65_535 || rows > 65_535 {
        return Err(fault(format!("the DICOM header gives a picture of {columns} x {rows} pixels")));
    }
    let samples = e.count(tags::SAMPLES_PER_PIXEL).unwrap_or(1) as usize;
    let name = e.word(tags::PHOTOMETRIC_INTERPRETATION).unwrap_or_default();
    let photometric = match (name.as_str(), samples) {
        ("MONOCHROME1", 1) => Photometric::Monochrome1,
        ("MONOCHROME2" | "", 1) => Photometric::Monochrome2,
        ("PALETTE COLOR", 1) => Photometric::Palette,
        // What JPEG 2000 calls YBR is undone by its decoder.
        ("RGB" | "YBR_ICT" | "YBR_RCT" | "", 3) => Photometric::Rgb,
        ("YBR_FULL", 3) => Photometric::YbrFull,
        // Packed pixels are brought to full width by their decoder.
        ("YBR_FULL_422", 3) if file.syntax.codec == Codec::Native => Photometric::YbrFull422,
        ("YBR_FULL_422" | "YBR_PARTIAL_420", 3) if file.syntax.codec == Codec::Jpeg => Photometric::YbrFull,
        _ => {
            let known = ["MONOCHROME1", "MONOCHROME2", "PALETTE COLOR", "RGB", "YBR_FULL", "YBR_FULL_422", "YBR_RCT"];
            let name = known.into_iter().find(|k| *k == name).unwrap_or("an unknown coding");
            return Err(fault(format!("its pixels are {name} with {samples} numbers each, which DICOM does not know")));
        }
    };
    let bits_allocated = match kind {
        PixelKind::Integer => size(tags::BITS_ALLOCATED),
        PixelKind::Float => 32,
        PixelKind::Double => 64,
    };
    let is_known = match kind {
        PixelKind::Integer => matches!(bits_allocated, 1 | 8 | 16 | 32),
        _ => true,
    };
    if !is_known || (samples == 3 && bits_allocated != 8 && bits_allocated != 16) {
        return Err(fault(format!("its pixels take {bits_allocated} bits per number, where 1, 8, 16 or 32 are known")));
    }
    let bits_stored = match size(tags::BITS_STORED) {
        0 => bits_allocated,
        n => n.min(bits_allocated),
    };
    let high_bit = e.count(tags::HIGH_BIT).map_or(bits_stored - 1, |n| n as usize);
    let high_bit = high_bit.clamp(bits_stored - 1, bits_allocated - 1);
    let is_planar = e.count(tags::PLANAR_CONFIGURATION) == Some(1) && samples == 3;
    let is_signed = e.count(tags::PIXEL_REPRESENTATION) == Some(1);
    Ok(PixelFormat {
        columns,
        rows,
        samples,
        bits_allocated,
        bits_stored,
        high_bit,
        is_signed,
        is_planar,
        kind,
        photometric,
    })
}

/// A header is only a claim: what its file cannot hold is refused before anything is allocated for it.
fn check_size(file: &DicomFile, format: &PixelFormat, num_frames: u64) -> Result<()> {
    /// Deflate cannot pack tighter.
    const MAX_DEFLATE_RATIO: u64 = 1032;
    let Some(span) = file.pixels else { return Ok(()) };
    let cut_off = |there: u64, promised: u64| {
        Err(Error::file(
            &file.path,
            format!("the DICOM header promises {promised} bytes of pixels, but the file holds {there}"),
            "copy or export it again",
        ))
    };
    if span.num_bytes.is_none() {
        // At least the header of an item for each.
        let there = file.num_bytes.saturating_sub(span.start) / 8;
        if num_frames > there {
            return Err(Error::file(
                &file.path,
                format!("the DICOM header promises {num_frames} frames, more than the file can hold"),
                "copy or export it again",
            ));
        }
        return Ok(());
    }
    let promised = u64::try_from((u128::from(format.frame_bits()) * u128::from(num_frames)).div_ceil(8));
    let promised = promised.unwrap_or(u64::MAX);
    let there = if file.syntax.is_deflated {
        file.num_bytes.saturating_mul(MAX_DEFLATE_RATIO)
    } else {
        file.num_bytes.saturating_sub(span.start)
    };
    let stated = span.num_bytes.unwrap_or(0);
    if promised > there.min(stated) { cut_off(there.min(stated), promised) } else { Ok(()) }
}
