//! JPEG: baseline, progressive and lossless, by the `jpeg-decoder` crate.

use jpeg_decoder::{ColorTransform, Decoder, PixelFormat as Packed};

use super::{Decoded, check_promise};
use crate::read::dicom::image::{Photometric, PixelFormat};

/// Unpacks one frame.
pub fn decode(data: &[u8], format: &PixelFormat) -> Result<Decoded, String> {
    let frame = frame_header(data)?;
    check_promise(frame.columns, frame.rows, frame.samples, frame.bits, format)?;
    if !frame.is_lossless && frame.bits != 8 {
        return Err(format!("it is lossy JPEG of {} bits, which Fabrica does not read", frame.bits));
    }
    let mut decoder = Decoder::new(data);
    decoder.set_max_decoding_buffer_size(format.num_pixels() * format.samples * 4);
    let is_rgb = format.photometric != Photometric::Rgb && format.samples == 3;
    if format.samples == 3 {
        // What the DICOM header says counts; most writers leave no marker of their own.
        decoder.set_color_transform(if is_rgb { ColorTransform::YCbCr } else { ColorTransform::None });
    }
    let numbers = decoder.decode().map_err(|e| format!("its JPEG data are damaged ({e})"))?;
    let width = match decoder.info().map(|info| info.pixel_format) {
        Some(Packed::L8 | Packed::RGB24) => 1,
        Some(Packed::L16) => 2,
        _ => return Err("it is JPEG of a kind that Fabrica does not read".to_owned()),
    };
    if numbers.len() != format.num_pixels() * format.samples * width {
        return Err("its JPEG data end early".to_owned());
    }
    let bytes = match (width, format.sample_bytes()) {
        (a, b) if a == b => numbers,
        (1, 2) => numbers.iter().flat_map(|&v| u16::from(v).to_ne_bytes()).collect(),
        (2, 1) => numbers.as_chunks::<2>().0.iter().map(|v| u16::from_ne_bytes(*v) as u8).collect(),
        _ => return Err("its JPEG data have other bits than the header says".to_owned()),
    };
    Ok(Decoded { bytes, is_rgb, is_interleaved: true })
}

struct FrameHeader {
    columns: usize,
    rows: usize,
    samples: usize,
    bits: usize,
    is_lossless: bool,
}

/// What the marker segment of the frame says.
fn frame_header(data: &[u8]) -> Result<FrameHeader, String> {
    let mut at = 2;
    if !data.starts_with(&[0xff, 0xd8]) {
        return Err("its data are no JPEG".to_owned());
    }
    loop {
        let Some(&[marker, code, high, low]) = data.get(at..at + 4).and_then(|b| b.first_chunk::<4>()) else {
            return Err("its JPEG data end before the picture".to_owned());
        };
        if marker != 0xff {
            return Err("its JPEG data are damaged".to_owned());
        }
        // Fill bytes.
        if code == 0xff {
            at += 1;
            continue;
        }
        let length = usize::from(u16::from_be_bytes([high, low]));
        let is_frame = matches!(code, 0xc0..=0xcf) && !matches!(code, 0xc4 | 0xc8 | 0xcc);
        if is_frame {
            let Some(&[bits, y1, y0, x1, x0, samples]) = data.get(at + 4..at + 10).and_then(|b| b.first_chunk::<6>())
            else {
                return Err("its JPEG data end before the picture".to_owned());
            };
            return Ok(FrameHeader {
                columns: usize::from(u16::from_be_bytes([x1, x0])),
                rows: usize::from(u16::from_be_bytes([y1, y0])),
                samples: usize::from(samples),
                bits: usize::from(bits),
                is_lossless: code == 0xc3,
            });
        }
        at += 2 + length.max(2);
    }
}
