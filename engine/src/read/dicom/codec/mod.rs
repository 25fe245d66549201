//! Packed pixels: one frame's bytes to its numbers.
//!
//! Every decoder gets what the DICOM header promised and refuses a codestream that promises something else, so that nothing is
//! allocated on a codestream's own word.

mod jpeg;
mod jpeg2000;
mod jpeg_ls;
mod rle;

use super::image::PixelFormat;
use super::syntax::Codec;

/// A frame's numbers, pixel by pixel, each in `sample_bytes` bytes of the machine's order.
pub struct Decoded {
    /// The numbers.
    pub bytes: Vec<u8>,
    /// Whether luma and color differences became red, green and blue.
    pub is_rgb: bool,
    /// Whether a pixel's numbers stand together, whatever the header says.
    pub is_interleaved: bool,
}

/// Pixels that a byte of a codestream can stand for. The air around a patient packs a thousandfold; what promises more than
/// this is a bomb.
const MAX_PIXELS_PER_BYTE: usize = 20_000;

/// Unpacks one frame.
///
/// # Errors
/// A clause for damaged or truncated data, and for what a codec here cannot do.
pub fn decode(codec: Codec, data: &[u8], format: &PixelFormat) -> Result<Decoded, String> {
    if data.is_empty() {
        return Err("it has no data".to_owned());
    }
    if format.num_pixels() / MAX_PIXELS_PER_BYTE > data.len() {
        return Err(format!("{} bytes cannot hold {} x {} pixels", data.len(), format.columns, format.rows));
    }
    match codec {
        Codec::Native => {
            let bytes = usize::try_from(format.frame_bits().div_ceil(8)).unwrap_or(usize::MAX);
            let data = data.get(..bytes).ok_or("it ends early")?;
            Ok(Decoded { bytes: data.to_vec(), is_rgb: false, is_interleaved: false })
        }
        Codec::Rle => rle::decode(data, format),
        Codec::Jpeg => jpeg::decode(data, format),
        Codec::JpegLs => jpeg_ls::decode(data, format),
        Codec::Jpeg2000 => jpeg2000::decode(data, format),
        Codec::Other(name) => Err(format!("it is packed with {name}, which Fabrica does not read")),
    }
}

/// Refuses a codestream that is not what the DICOM header promises.
fn check_promise(columns: usize, rows: usize, samples: usize, bits: usize, format: &PixelFormat) -> Result<(), String> {
    if (columns, rows, samples) != (format.columns, format.rows, format.samples) {
        return Err(format!(
            "it is packed as {columns} x {rows} pixels of {samples} numbers, where the header says {} x {} of {}",
            format.columns, format.rows, format.samples
        ));
    }
    if bits == 0 || bits > format.bits_allocated {
        return Err(format!("it is packed with {bits} bits, where the header says {}", format.bits_allocated));
    }
    Ok(())
}
