//! JPEG 2000, lossless and lossy, by the `hayro-jpeg2000` crate, which has no unsafe code.

use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};

use super::{Decoded, check_promise};
use crate::read::dicom::image::PixelFormat;

/// Numbers beyond these bits are not exact in the decoder's f32.
const MAX_BITS: usize = 24;

/// Unpacks one frame.
pub fn decode(data: &[u8], format: &PixelFormat) -> Result<Decoded, String> {
    let size = Size::find(data).ok_or("its JPEG 2000 data are damaged or end early")?;
    check_promise(size.columns, size.rows, size.samples, size.bits, format)?;
    if size.bits > MAX_BITS {
        return Err(format!("it is JPEG 2000 of {} bits, which Fabrica does not read", size.bits));
    }
    // Strict: what a lenient decoder makes of half the data looks like a picture.
    let settings = DecodeSettings { resolve_palette_indices: false, strict: true, target_resolution: None };
    let fault = |e: &dyn std::fmt::Display| format!("its JPEG 2000 data are damaged ({e})");
    let image = Image::new(&data[size.codestream..], &settings).map_err(|e| fault(&e))?;
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(|e| fault(&e))?;
    let components = decoded.components();
    let n = format.num_pixels();
    if components.len() != format.samples || components.iter().any(|c| c.samples().len() != n) {
        return Err("its JPEG 2000 data are of another size than they say".to_owned());
    }
    // The decoder lifts signed numbers as it does unsigned ones.
    let lift = if size.is_signed { 1_i64 << (size.bits - 1) } else { 0 };
    let (low, high) = if size.is_signed { (-lift, lift - 1) } else { (0, (1_i64 << size.bits) - 1) };
    let width = format.sample_bytes();
    let mut bytes = vec![0; n * format.samples * width];
    for (i, component) in components.iter().enumerate() {
        let places = bytes.chunks_exact_mut(width).skip(i).step_by(format.samples);
        for (to, from) in places.zip(component.samples()) {
            let number = (from.round() as i64 - lift).clamp(low, high);
            match width {
                1 => to[0] = number as u8,
                2 => to.copy_from_slice(&(number as u16).to_ne_bytes()),
                _ => to.copy_from_slice(&(number as u32).to_ne_bytes()),
            }
        }
    }
    Ok(Decoded { bytes, is_rgb: true, is_interleaved: true })
}

/// What the codestream says of itself (its SIZ marker segment).
struct Size {
    /// Byte at which the codestream begins.
    codestream: usize,
    columns: usize,
    rows: usize,
    samples: usize,
    bits: usize,
    is_signed: bool,
}

impl Size {
    fn find(data: &[u8]) -> Option<Self> {
        // Some writers wrap the codestream in the boxes of a JP2 file.
        const START: [u8; 4] = [0xff, 0x4f, 0xff, 0x51];
        let codestream =
            if data.starts_with(&START) { 0 } else { data.windows(4).take(4096).position(|w| w == START)? };
        let siz = data.get(codestream + 4..)?;
        let word = |at: usize| {
            let bytes = siz.get(at..at + 4)?;
            Some(u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
        };
        let [x_end, y_end, x_start, y_start] = [word(4)?, word(8)?, word(12)?, word(16)?];
        let samples = usize::from(u16::from_be_bytes([*siz.get(36)?, *siz.get(37)?]));
        let component = |i: usize| siz.get(38 + 3 * i..41 + 3 * i);
        let first = component(0)?;
        // All alike, none of them coarser than the picture.
        if (0..samples.min(4)).any(|i| component(i) != Some(&[first[0], 1, 1])) {
            return None;
        }
        Some(Self {
            codestream,
            columns: x_end.checked_sub(x_start)?,
            rows: y_end.checked_sub(y_start)?,
            samples,
            bits: usize::from(first[0] & 0x7f) + 1,
            is_signed: first[0] & 0x80 != 0,
        })
    }
}
