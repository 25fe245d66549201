//! From the stored bytes of a page to its pixels: compression, predictor, byte order, packing, colors.
//!
//! Every buffer has the size that the page's header gives, which was checked against what is stored.

use std::io::Read;
use std::path::Path;

use flate2::bufread::ZlibDecoder;
use half::f16;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::super::slices::PixelKind;
use super::super::stream::{self, ElementType, Endian};
use super::ifd::{Page, SampleFormat, Tiff};
use crate::error::{Error, Result};

/// No compression packs a byte tighter.
const MAX_RATIO: u64 = 4096;

const WHITE_IS_ZERO: u16 = 0;
const BLACK_IS_ZERO: u16 = 1;
const RGB: u16 = 2;
const PALETTE: u16 = 3;
const YCBCR: u16 = 6;

/// What the pixels of a page become, and of how many components each is a frame.
///
/// # Errors
/// If Fabrica does not read such pixels.
pub fn kind_of(path: &Path, page: &Page, number: usize) -> Result<(PixelKind, u16)> {
    let refuse = |what: String, remedy: &str| Err(Error::file(path, format!("page {number} {what}"), remedy));
    let compression = match page.compression {
        1 | 5 | 7 | 8 | 32773 | 32946 => None,
        2..=4 => Some("as a fax"),
        6 => Some("with old-style JPEG"),
        34712 => Some("with JPEG 2000"),
        50000 => Some("with zstd"),
        50001 => Some("with WebP"),
        34925 => Some("with LZMA"),
        _ => Some("in a way that TIFF does not define"),
    };
    if let Some(how) = compression {
        return refuse(
            format!("is compressed {how} (TIFF compression {}), which Fabrica does not read", page.compression),
            "save it with LZW or deflate",
        );
    }
    if page.bits < 8 && page.fill_order == 2 {
        return refuse("has its bits in reverse order".to_owned(), "save it with 8 bits a pixel");
    }
    let color_bits = matches!(page.bits, 8 | 16) && page.format == SampleFormat::Unsigned;
    match (page.photometric, page.num_samples) {
        (RGB, 3..=4) | (YCBCR, 3) if color_bits && (page.photometric == RGB || page.compression == 7) => {
            let has_alpha = page.num_samples == 4 && matches!(page.extra_samples.first(), Some(1 | 2));
            return Ok((if has_alpha { PixelKind::Rgba } else { PixelKind::Rgb }, 1));
        }
        (PALETTE, 1) if page.bits <= 8 && !page.palette.is_empty() => {
            if page.palette.len() < 3 << page.bits {
                return refuse("has a table of colors that is too short".to_owned(), "copy or download it again");
            }
            if !is_gray_ramp(page) {
                return Ok((PixelKind::Rgb, 1));
            }
        }
        (WHITE_IS_ZERO | BLACK_IS_ZERO | PALETTE, _) => {}
        (RGB | YCBCR, _) => {
            let (samples, bits) = (page.num_samples, page.bits);
            return refuse(format!("has colors of {samples} x {bits} bits"), "save it as RGB with 8 bits a channel");
        }
        (other, _) => {
            let name = match other {
                4 => "a mask".to_owned(),
                5 => "CMYK".to_owned(),
                8..=10 => "Lab".to_owned(),
                _ => format!("of the kind {other}"),
            };
            return refuse(format!("is {name}, which Fabrica does not read"), "save it as gray or RGB");
        }
    }
    let element = match (page.format, page.bits) {
        (SampleFormat::Unsigned, 1 | 2 | 4 | 8) => ElementType::U8,
        (SampleFormat::Unsigned, 12 | 16) => ElementType::U16,
        (SampleFormat::Unsigned, 32) => ElementType::U32,
        (SampleFormat::Unsigned, 64) => ElementType::U64,
        (SampleFormat::Signed, 8) => ElementType::I8,
        (SampleFormat::Signed, 16) => ElementType::I16,
        (SampleFormat::Signed, 32) => ElementType::I32,
        (SampleFormat::Signed, 64) => ElementType::I64,
        (SampleFormat::Float, 16 | 32) => ElementType::F32,
        (SampleFormat::Float, 64) => ElementType::F64,
        (_, bits) => {
            return refuse(
                format!("has numbers of {bits} bits, which Fabrica does not read"),
                "save it with 8, 16 or 32",
            );
        }
    };
    let num_alphas = u16::from(matches!(page.extra_samples.first(), Some(1 | 2)));
    Ok((PixelKind::Values(element), page.num_samples.saturating_sub(num_alphas).max(1)))
}

/// Whether the palette says no more than the numbers do.
fn is_gray_ramp(page: &Page) -> bool {
    let n = 1 << page.bits;
    let (red, rest) = page.palette.split_at(n);
    red == &rest[..n] && red == &rest[n..2 * n] && red.is_sorted()
}

/// The pixels of a page: numbers of `kind` in the machine's byte order (component `component`), or RGBA.
///
/// # Errors
/// If the stored bytes are damaged or too few, or there is not enough memory.
pub fn decode(
    tiff: &mut Tiff,
    path: &Path,
    page: &Page,
    number: usize,
    kind: PixelKind,
    component: u16,
) -> Result<Vec<u8>> {
    let num_planes = if page.is_planar { usize::from(page.num_samples) } else { 1 };
    let per_pixel = if page.is_planar { 1 } else { usize::from(page.num_samples) };
    let wanted = match kind {
        PixelKind::Values(_) if page.is_planar => usize::from(component)..usize::from(component) + 1,
        _ => 0..num_planes,
    };
    let num_pixels = page.width as usize * page.height as usize;
    let mut planes = Vec::new();
    for plane in wanted {
        planes.push(unpack(page, plane_bytes(tiff, path, page, number, plane)?, per_pixel));
    }
    let out_bytes = num_pixels * kind.num_bytes();
    let sample_bytes = unpacked_bytes(page);
    let first = planes.first().map_or(&[][..], Vec::as_slice);
    match kind {
        PixelKind::Values(_) => {
            let mut pixels = if per_pixel == 1 {
                std::mem::take(&mut planes[0])
            } else {
                let start = usize::from(component) * sample_bytes;
                let mut picked = reserve(path, out_bytes)?;
                for pixel in first.chunks_exact(per_pixel * sample_bytes) {
                    picked.extend_from_slice(&pixel[start..start + sample_bytes]);
                }
                picked
            };
            if page.photometric == WHITE_IS_ZERO {
                invert(page, &mut pixels);
            }
            Ok(pixels)
        }
        PixelKind::Rgb | PixelKind::Rgba => {
            let mut pixels = reserve(path, out_bytes)?;
            let eight_bits = |bytes: &[u8]| match bytes {
                [low, high] => {
                    let v = u32::from(u16::from_ne_bytes([*low, *high]));
                    ((v * 255 + 32767) / 65535) as u8
                }
                _ => bytes.first().copied().unwrap_or(0),
            };
            for i in 0..num_pixels {
                let sample = |channel: usize| {
                    let (plane, at) = if page.is_planar { (channel, i) } else { (0, i * per_pixel + channel) };
                    let bytes = planes.get(plane).and_then(|p| p.get(at * sample_bytes..(at + 1) * sample_bytes));
                    eight_bits(bytes.unwrap_or_default())
                };
                if page.photometric == PALETTE {
                    let (index, n) = (usize::from(sample(0)), 1_usize << page.bits);
                    let channel = |c: usize| eight_bits(&page.palette[c * n + index.min(n - 1)].to_ne_bytes());
                    pixels.extend([channel(0), channel(1), channel(2), 255]);
                    continue;
                }
                let mut color = [sample(0), sample(1), sample(2), 255];
                if kind == PixelKind::Rgba {
                    color[3] = sample(3);
                    if page.extra_samples.first() == Some(&1) {
                        // Colors that were multiplied by alpha: TIFF's "associated".
                        let alpha = u32::from(color[3]).max(1);
                        (0..3)
                            .for_each(|c| color[c] = ((u32::from(color[c]) * 255 + alpha / 2) / alpha).min(255) as u8);
                    }
                }
                pixels.extend(color);
            }
            Ok(pixels)
        }
    }
}

fn reserve(path: &Path, num_bytes: usize) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    stream::reserve(&mut bytes, num_bytes, path)?;
    Ok(bytes)
}

/// One plane: rows without padding but to whole bytes, in the machine's byte order.
fn plane_bytes(tiff: &mut Tiff, path: &Path, page: &Page, number: usize, plane: usize) -> Result<Vec<u8>> {
    let damaged = |what: &str| {
        Error::file(path, format!("the pixels of page {number} are damaged ({what})"), "copy or download it again")
    };
    let [across, down] = page.chunks_across_down();
    let [chunk_width, chunk_height] = page.chunk;
    let samples = if page.is_planar { 1 } else { usize::from(page.num_samples) };
    let row_bytes = page.row_bytes(page.width) as usize;
    let chunk_row = page.row_bytes(chunk_width);
    if across > 1 && !(chunk_width * samples as u64 * u64::from(page.bits)).is_multiple_of(8) {
        return Err(damaged("tiles end within a byte"));
    }
    let num_bytes = row_bytes * page.height as usize;
    let mut bytes = reserve(path, num_bytes)?;
    for (i, (y, x)) in (0..down).flat_map(|y| (0..across).map(move |x| (y, x))).enumerate() {
        let i = i + plane * (across * down) as usize;
        let rows_here = chunk_height.min(page.height - y * chunk_height);
        let rows = if page.is_tiled { chunk_height } else { rows_here };
        let expected = chunk_row.saturating_mul(rows);
        let (offset, count) = (page.offsets[i], page.byte_counts[i]);
        if expected > count.saturating_mul(if page.compression == 1 { 1 } else { MAX_RATIO }) {
            return Err(damaged("a strip or tile is too short"));
        }
        let stored = tiff.bytes_at(offset, if page.compression == 1 { expected } else { count })?;
        let mut chunk = reserve(path, expected as usize)?;
        decompress(page, &stored, expected as usize, &mut chunk, [chunk_width, rows], samples)
            .map_err(|what| damaged(&what))?;
        if x == 0 {
            bytes.resize(bytes.len() + rows_here as usize * row_bytes, 0);
        }
        for row in chunk.chunks_exact_mut((chunk_row as usize).max(1)) {
            to_native(page, tiff.endian, row, samples);
        }
        let start = page.row_bytes(x * chunk_width) as usize;
        let used = (row_bytes - start).min(chunk_row as usize);
        for (row, from) in (0..rows_here as usize).zip(chunk.chunks_exact((chunk_row as usize).max(1))) {
            let at = (y as usize * chunk_height as usize + row) * row_bytes + start;
            bytes[at..at + used].copy_from_slice(&from[..used]);
        }
    }
    Ok(bytes)
}

/// Decodes a strip or tile into `bytes`, which has room for the `expected` ones: memory is touched only as far as it is
/// decoded.
fn decompress(
    page: &Page,
    stored: &[u8],
    expected: usize,
    bytes: &mut Vec<u8>,
    size: [u64; 2],
    samples: usize,
) -> std::result::Result<(), String> {
    match page.compression {
        1 => bytes.extend_from_slice(&stored[..expected.min(stored.len())]),
        5 => {
            let mut decoder = weezl::decode::Decoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8);
            let (mut read, mut piece) = (0, vec![0; 64 << 10]);
            while bytes.len() < expected {
                let result = decoder.decode_bytes(&stored[read..], &mut piece);
                read += result.consumed_in;
                let n = result.consumed_out.min(expected - bytes.len());
                bytes.extend_from_slice(&piece[..n]);
                match result.status {
                    Ok(weezl::LzwStatus::Ok) if result.consumed_in + result.consumed_out > 0 => {}
                    Ok(_) => break,
                    // Some writers leave the mark of the end out, or follow it with anything.
                    Err(_) if bytes.len() == expected => {}
                    Err(e) => return Err(e.to_string()),
                }
            }
        }
        8 | 32946 => {
            let mut decoder = ZlibDecoder::new(stored);
            decoder.by_ref().take(expected as u64).read_to_end(bytes).map_err(|e| e.to_string())?;
            // Padding may follow; the checksum comes with the end, if the end is here.
            decoder.read(&mut [0; 1]).map_err(|e| e.to_string())?;
        }
        32773 => unpack_bits(stored, expected, bytes),
        7 => *bytes = decode_jpeg(page, stored, size, samples)?,
        other => return Err(format!("compression {other}")),
    }
    if bytes.len() < expected { Err("a strip or tile ends early".to_owned()) } else { Ok(()) }
}

/// PackBits (TIFF 6.0, section 9): up to `expected` bytes.
fn unpack_bits(stored: &[u8], expected: usize, bytes: &mut Vec<u8>) {
    let mut at = 0;
    while let Some(&head) = stored.get(at).filter(|_| bytes.len() < expected) {
        let (n, left) = (i8::from_ne_bytes([head]), expected - bytes.len());
        at += 1;
        let rest = &stored[at..];
        if n >= 0 {
            let length = n as usize + 1;
            bytes.extend_from_slice(&rest[..length.min(left).min(rest.len())]);
            at = (at + length).min(stored.len());
        } else if let (true, Some(&byte)) = (n != -128, rest.first()) {
            let length = (1 - isize::from(n)).unsigned_abs();
            bytes.resize(bytes.len() + length.min(left), byte);
            at += 1;
        }
    }
}

/// A JPEG stream, whose tables may stand apart, as gray or RGB of the chunk's size.
fn decode_jpeg(
    page: &Page,
    stored: &[u8],
    [width, height]: [u64; 2],
    samples: usize,
) -> std::result::Result<Vec<u8>, String> {
    if page.bits != 8 {
        return Err(format!("JPEG of {} bits", page.bits));
    }
    // Tables and data each begin and end as a JPEG file of their own.
    let tables = page.jpeg_tables.strip_suffix(&[0xff, 0xd9]).unwrap_or(&page.jpeg_tables);
    let joined;
    let whole = if tables.is_empty() {
        stored
    } else {
        joined = [tables, stored.get(2..).unwrap_or_default()].concat();
        &joined
    };
    let mut decoder = JpegDecoder::new(ZCursor::new(whole));
    decoder.decode_headers().map_err(|e| e.to_string())?;
    let found = decoder.info().map(|i| (u64::from(i.width), u64::from(i.height)));
    if found.is_none_or(|(w, h)| w != width || h < height.min(page.height) || h > height) {
        return Err("a strip or tile is JPEG of another size".to_owned());
    }
    // TIFF says what the channels are, whatever JPEG's own marks say.
    let out = match (samples, page.photometric) {
        (1, _) => ColorSpace::Luma,
        (3, YCBCR) => ColorSpace::RGB,
        _ => decoder.input_colorspace().ok_or("JPEG without colors")?,
    };
    decoder.set_options(DecoderOptions::default().jpeg_set_out_colorspace(out));
    let mut bytes = decoder.decode().map_err(|e| e.to_string())?;
    let expected = (width * height) as usize * samples;
    if bytes.len() < expected {
        return Err("a strip or tile is JPEG of another size".to_owned());
    }
    bytes.truncate(expected);
    Ok(bytes)
}

/// Undoes predictor and byte order of a row.
fn to_native(page: &Page, endian: Endian, row: &mut [u8], samples: usize) {
    let width = usize::from(page.bits / 8);
    if page.predictor == 3 && page.format == SampleFormat::Float && matches!(width, 2 | 4 | 8) {
        // Adobe's: differences of bytes, the highest byte of every number first.
        for i in samples..row.len() {
            row[i] = row[i].wrapping_add(row[i - samples]);
        }
        let count = row.len() / width;
        let shuffled = row.to_vec();
        for (i, number) in row.chunks_exact_mut(width).enumerate() {
            for (byte, at) in number.iter_mut().zip(0..) {
                let significance = if cfg!(target_endian = "little") { width - 1 - at } else { at };
                *byte = shuffled[significance * count + i];
            }
        }
        return;
    }
    // 12-bit numbers are packed, highest bit first, whatever the byte order.
    if endian != Endian::NATIVE && width > 1 && page.bits.is_multiple_of(8) {
        row.chunks_exact_mut(width).for_each(<[u8]>::reverse);
    }
    if page.predictor != 2 {
        return;
    }
    macro_rules! accumulate {
        ($t:ty) => {{
            const N: usize = size_of::<$t>();
            let number = |row: &[u8], i: usize| <$t>::from_ne_bytes(std::array::from_fn(|k| row[i * N + k]));
            for i in samples..row.len() / N {
                let sum = number(row, i).wrapping_add(number(row, i - samples));
                row[i * N..(i + 1) * N].copy_from_slice(&sum.to_ne_bytes());
            }
        }};
    }
    match page.bits {
        8 => accumulate!(u8),
        16 => accumulate!(u16),
        32 => accumulate!(u32),
        64 => accumulate!(u64),
        _ => {}
    }
}

/// Bytes of a sample after [`unpack`].
fn unpacked_bytes(page: &Page) -> usize {
    match (page.format, page.bits) {
        (SampleFormat::Float, 16) => 4,
        (_, 12) => 2,
        (_, bits) => usize::from(bits.div_ceil(8)),
    }
}

/// Packed numbers in whole bytes: fewer than 8 bits as bytes, 12 as 16, half floats as floats.
fn unpack(page: &Page, bytes: Vec<u8>, samples: usize) -> Vec<u8> {
    let row_samples = page.width as usize * samples;
    let rows = bytes.chunks_exact((page.row_bytes(page.width) as usize).max(1));
    match (page.format, page.bits) {
        (SampleFormat::Float, 16) => {
            let halves = bytes.chunks_exact(2).map(|b| f16::from_ne_bytes([b[0], b[1]]).to_f32());
            halves.flat_map(f32::to_ne_bytes).collect()
        }
        (_, bits @ (1 | 2 | 4)) => {
            let bits = usize::from(bits);
            let number =
                |row: &[u8], i: usize| row[i * bits / 8] >> (8 - bits - i * bits % 8) & ((1 << bits) - 1) as u8;
            rows.flat_map(|row| (0..row_samples).map(move |i| number(row, i))).collect()
        }
        (_, 12) => {
            let number = |row: &[u8], i: usize| {
                let (at, is_odd) = (i * 3 / 2, i % 2 == 1);
                let pair = u16::from_be_bytes([row[at], row[at + 1]]);
                if is_odd { pair & 0xfff } else { pair >> 4 }
            };
            rows.flat_map(|row| (0..row_samples).flat_map(move |i| number(row, i).to_ne_bytes())).collect()
        }
        _ => bytes,
    }
}

/// Numbers that are white at 0, the other way round; floats have no white and stay.
fn invert(page: &Page, pixels: &mut [u8]) {
    match (page.format, page.bits) {
        (SampleFormat::Float, _) => {}
        (_, bits @ (1 | 2 | 4)) => pixels.iter_mut().for_each(|p| *p ^= ((1_u16 << bits) - 1) as u8),
        (_, 12) => pixels.chunks_exact_mut(2).for_each(|p| {
            let inverted = 0xfff - u16::from_ne_bytes([p[0], p[1]]).min(0xfff);
            p.copy_from_slice(&inverted.to_ne_bytes());
        }),
        _ => pixels.iter_mut().for_each(|p| *p = !*p),
    }
}
