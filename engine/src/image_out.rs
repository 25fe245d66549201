//! Publication pictures: a PNG writer that takes rows as they are rendered, so that a figure of 16 384² pixels never
//! sits in memory whole, a file saver that never leaves half a file, and the reader for what they wrote (also for
//! style images). The last station of a frame: after measuring, nothing else touches the pixels.
//!
//! Pixels come premultiplied and linear, and leave as straight-alpha 8-bit sRGB, rounded to nearest, undithered.
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Cursor, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use png::text_metadata::{ITXtChunk, TEXtChunk};
use rayon::prelude::*;

use crate::color;
use crate::error::{Error, Result};

/// How a PNG is written.
#[derive(Clone, Debug, PartialEq)]
pub struct PngOptions {
    /// Pixels per inch on the page; written as whole pixels per meter, round(dpi/0.0254): 300 → 11 811.
    pub dpi: f64,
    /// Write RGB without an alpha channel. Every pixel must then be opaque (alpha ≥ 1 − 1/510).
    pub opaque: bool,
    /// Keyword and text of metadata chunks ("Software", "Fabrica-Setting"): ASCII goes into tEXt, all else into iTXt.
    /// A keyword has 1 to 79 printable ASCII characters, without spaces at its ends or two together.
    pub text: Vec<(String, String)>,
}

impl Default for PngOptions {
    fn default() -> Self {
        Self { dpi: 300.0, opaque: false, text: Vec::new() }
    }
}

/// Takes the rows of a PNG from the top; [`write_png`] hands it out.
pub struct PngRows<'a, W: Write> {
    stream: png::StreamWriter<'a, W>,
    width: usize,
    height: usize,
    opaque: bool,
    rows_taken: usize,
    codes: Vec<u8>,
}

/// Writes one PNG of `width` × `height` pixels; `produce` hands over the rows as it makes them.
///
/// # Errors
/// [`Error::Scene`] for an extent of 0 or above PNG's 2³¹−1, a dpi that is not positive and finite, metadata that PNG
/// cannot hold, or rows that are missing at the end; [`Error::File`] if `writer` fails; what `produce` returns.
pub fn write_png<W: Write, T>(
    writer: W,
    width: u32,
    height: u32,
    options: &PngOptions,
    produce: impl FnOnce(&mut PngRows<'_, W>) -> Result<T>,
) -> Result<T> {
    const LARGEST: u32 = i32::MAX as u32;
    if width == 0 || height == 0 || width > LARGEST || height > LARGEST {
        return Err(Error::scene(
            format!("a picture of {width} × {height} pixels cannot be written"),
            format!("ask for 1 to {LARGEST} pixels a side"),
        ));
    }
    let per_meter = (options.dpi / 0.0254).round();
    if !(1.0..=f64::from(LARGEST)).contains(&per_meter) {
        return Err(Error::scene(
            format!("a resolution of {} dpi has no meaning", options.dpi),
            "ask for one between 0.02 and 50 000 000, such as 300",
        ));
    }

    let mut encoder = png::Encoder::new(writer, width, height);
    // A print figure is kept, not streamed: a third larger than the default, ten times as fast.
    encoder.set_compression(png::Compression::Fast);
    encoder.set_color(if options.opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
    encoder.set_depth(png::BitDepth::Eight);
    let per_meter = per_meter as u32;
    encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: per_meter, yppu: per_meter, unit: png::Unit::Meter }));
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    // What the PNG specification asks for beside sRGB, for readers that know only gAMA and cHRM.
    let chromaticity = |x, y| (png::ScaledFloat::from_scaled(x), png::ScaledFloat::from_scaled(y));
    encoder.set_source_gamma(png::ScaledFloat::from_scaled(45_455));
    encoder.set_source_chromaticities(png::SourceChromaticities {
        white: chromaticity(31_270, 32_900),
        red: chromaticity(64_000, 33_000),
        green: chromaticity(30_000, 60_000),
        blue: chromaticity(15_000, 6_000),
    });
    let mut png = encoder.write_header().map_err(|error| stream_error(&error))?;
    for (keyword, text) in &options.text {
        check_text(keyword, text)?;
        if text.is_ascii() {
            png.write_text_chunk(&TEXtChunk::new(keyword.clone(), text.clone()))
        } else {
            png.write_text_chunk(&ITXtChunk::new(keyword.clone(), text.clone()))
        }
        .map_err(|error| stream_error(&error))?;
    }

    let value = produce_rows(&mut png, width, height, options.opaque, produce)?;
    png.finish().map_err(|error| stream_error(&error))?;
    Ok(value)
}

/// The pixel chunks of [`write_png`]; a function of its own because the stream borrows the writer until it is gone.
fn produce_rows<W: Write, T>(
    png: &mut png::Writer<W>,
    width: u32,
    height: u32,
    opaque: bool,
    produce: impl FnOnce(&mut PngRows<'_, W>) -> Result<T>,
) -> Result<T> {
    let mut rows = PngRows {
        stream: png.stream_writer().map_err(|error| stream_error(&error))?,
        width: width as usize,
        height: height as usize,
        opaque,
        rows_taken: 0,
        codes: Vec::new(),
    };
    let value = produce(&mut rows)?;
    if rows.rows_taken != rows.height {
        return Err(Error::scene(
            format!("the picture has {} rows and only {} were written", rows.height, rows.rows_taken),
            "write them all before finishing",
        ));
    }
    rows.stream.finish().map_err(|error| stream_error(&error))?;
    Ok(value)
}

impl<W: Write> PngRows<'_, W> {
    /// Appends whole rows: premultiplied linear RGBA, row 0 = top, any number of rows a call.
    ///
    /// # Errors
    /// [`Error::Scene`] for a part of a row, a row too many, a NaN or infinite pixel, or a transparent pixel in a
    /// picture without alpha (the row and column are named; nothing of this call is written); [`Error::File`] if
    /// the writer fails.
    pub fn write(&mut self, rows: &[[f32; 4]]) -> Result<()> {
        let num_rows = rows.len() / self.width;
        if num_rows * self.width != rows.len() || self.rows_taken + num_rows > self.height {
            return Err(Error::scene(
                format!(
                    "{} pixels do not fit a picture {} wide with {} rows left",
                    rows.len(),
                    self.width,
                    self.height - self.rows_taken
                ),
                "hand over whole rows, each once",
            ));
        }
        let row_bytes = self.width * if self.opaque { 3 } else { 4 };
        self.codes.resize(num_rows * row_bytes, 0);
        let fault = self
            .codes
            .par_chunks_exact_mut(row_bytes)
            .zip(rows.par_chunks_exact(self.width))
            .enumerate()
            .find_map_first(|(i, (bytes, pixels))| {
                convert_row(pixels, self.opaque, bytes).err().map(|(x, why)| (self.rows_taken + i, x, why))
            });
        if let Some((row, column, why)) = fault {
            return Err(Error::scene(
                format!("the pixel in row {row}, column {column} is {why}"),
                "this is a fault of the rendering: nothing was saved; report it with the document",
            ));
        }
        self.rows_taken += num_rows;
        self.stream.write_all(&self.codes).map_err(|error| stream_error(&png::EncodingError::IoError(error)))
    }
}

/// Writes a whole picture to `path`, atomically: `pixels` premultiplied linear, `height` rows of `width`, row 0 = top.
///
/// # Errors
/// As [`write_png`] and [`save_atomic`].
pub fn save_png(path: &Path, width: u32, height: u32, pixels: &[[f32; 4]], options: &PngOptions) -> Result<()> {
    save_atomic(path, |file| write_png(file, width, height, options, |rows| rows.write(pixels)))
}

/// Converts one row; on a fault the column and what is wrong with the pixel.
fn convert_row(pixels: &[[f32; 4]], opaque: bool, bytes: &mut [u8]) -> std::result::Result<(), (usize, &'static str)> {
    // A sum is NaN or infinite if any of its terms is (or, wrongly, beyond 1e38: then the slow path clears it).
    if !pixels.iter().fold(0.0_f32, |sum, [r, g, b, a]| sum + (r + g + b + a) * 0.0).eq(&0.0) {
        if let Some(x) = pixels.iter().position(|pixel| pixel.iter().any(|v| v.is_nan())) {
            return Err((x, "not a number"));
        }
        if let Some(x) = pixels.iter().position(|pixel| pixel.iter().any(|v| v.is_infinite())) {
            return Err((x, "infinite"));
        }
    }
    if opaque {
        for (x, (pixel, out)) in pixels.iter().zip(bytes.as_chunks_mut::<3>().0).enumerate() {
            let [r, g, b, a] = color::straight_srgb8_from_premultiplied_linear(*pixel);
            if a != 255 {
                return Err((x, "transparent in a picture saved without transparency"));
            }
            *out = [r, g, b];
        }
    } else {
        for (pixel, out) in pixels.iter().zip(bytes.as_chunks_mut::<4>().0) {
            *out = color::straight_srgb8_from_premultiplied_linear(*pixel);
        }
    }
    Ok(())
}

/// Refuses metadata that PNG cannot hold.
fn check_text(keyword: &str, text: &str) -> Result<()> {
    let printable = keyword.bytes().all(|c| (0x20..0x7f).contains(&c));
    if !(1..=79).contains(&keyword.len()) || !printable || keyword.trim() != keyword || keyword.contains("  ") {
        return Err(Error::scene(
            format!("{keyword:?} cannot be a keyword of picture metadata"),
            "use 1 to 79 printable ASCII characters with single spaces inside only",
        ));
    }
    if text.contains('\0') {
        return Err(Error::scene(
            format!("the metadata {keyword:?} holds a zero character"),
            "remove it: PNG text ends there",
        ));
    }
    Ok(())
}

/// A fault of the writer under [`write_png`], which knows no path; [`save_atomic`] replaces it by one that does.
fn stream_error(error: &png::EncodingError) -> Error {
    let path = Path::new("the PNG being written");
    match error {
        png::EncodingError::IoError(error) => Error::io(path, error),
        other => Error::file(path, other.to_string(), "report this: it is a fault of the program"),
    }
}

/// The file that [`save_atomic`] hands out: buffered, and it remembers its first fault.
pub struct AtomicFile {
    file: BufWriter<File>,
    fault: Option<io::Error>,
}

impl AtomicFile {
    fn remember<T>(&mut self, result: io::Result<T>) -> io::Result<T> {
        if let Err(error) = &result
            && error.kind() != io::ErrorKind::Interrupted
            && self.fault.is_none()
        {
            self.fault = Some(match error.raw_os_error() {
                Some(code) => io::Error::from_raw_os_error(code),
                None => io::Error::new(error.kind(), error.to_string()),
            });
        }
        result
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let result = self.file.write(bytes);
        self.remember(result)
    }

    fn flush(&mut self) -> io::Result<()> {
        let result = self.file.flush();
        self.remember(result)
    }
}

/// Removes the temporary file unless it was renamed: also when the writer panics.
struct Temporary(Option<PathBuf>);

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(path) = &self.0 {
            // The fault that led here is the one to report.
            let _ = fs::remove_file(path);
        }
    }
}

/// Writes a picture as NumPy's `.npy`, version 1.0: float32 of this machine's byte order in C order, (height, width, 4), row 0 = top,
/// each pixel as it is (numpy.org, `numpy.lib.format`).
///
/// # Errors
/// What `writer` returns; [`io::ErrorKind::InvalidInput`] unless there are `width` × `height` pixels.
pub fn write_npy(mut writer: impl Write, width: u32, height: u32, pixels: &[[f32; 4]]) -> io::Result<()> {
    if pixels.len() as u64 != u64::from(width) * u64::from(height) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "the picture has another size than its pixels"));
    }
    let order = if cfg!(target_endian = "big") { '>' } else { '<' };
    let mut header = format!("{{'descr': '{order}f4', 'fortran_order': False, 'shape': ({height}, {width}, 4), }}");
    // The array begins at a multiple of 64 bytes; the header's last byte is a line feed.
    let num_spaces = 63 - (NPY_PREFIX.len() + 2 + header.len()) % 64;
    header.push_str(&" ".repeat(num_spaces));
    header.push('\n');
    writer.write_all(NPY_PREFIX)?;
    writer.write_all(&(header.len() as u16).to_le_bytes())?;
    writer.write_all(header.as_bytes())?;
    writer.write_all(bytemuck::cast_slice(pixels))
}

/// Magic and version of a `.npy` file; the header's length and the header follow.
const NPY_PREFIX: &[u8] = b"\x93NUMPY\x01\x00";

/// Writes a file whole or not at all: `write` fills a hidden temporary file in the same folder, which is then renamed
/// to `path`. What was there before stays until that moment, and stays if anything fails.
///
/// # Errors
/// What `write` returns (cancelling too), or [`Error::File`] with `path` if the disk fails.
pub fn save_atomic<T>(path: &Path, write: impl FnOnce(&mut AtomicFile) -> Result<T>) -> Result<T> {
    static COUNTER: AtomicU64 = AtomicU64::new(0);
    let Some(name) = path.file_name() else {
        return Err(Error::file(path, "this does not name a file", "give a file name"));
    };
    if path.is_dir() {
        return Err(Error::io(path, &io::ErrorKind::IsADirectory.into()));
    }
    let counter = COUNTER.fetch_add(1, Ordering::Relaxed);
    let temporary_name = format!(".{}.tmp-{}-{counter}", name.to_string_lossy(), std::process::id());
    let temporary_path = path.with_file_name(temporary_name);

    let io_error = |error: io::Error| Error::not_written(path, &error);
    let file = OpenOptions::new().write(true).create_new(true).open(&temporary_path).map_err(io_error)?;
    let mut temporary = Temporary(Some(temporary_path.clone()));
    let mut atomic = AtomicFile { file: BufWriter::with_capacity(256 << 10, file), fault: None };
    let result = write(&mut atomic);
    let AtomicFile { file, fault } = atomic;
    if let Some(fault) = fault {
        // Dropping the buffer would try to write it again.
        drop(file.into_parts());
        return Err(io_error(fault));
    }
    let value = result?;
    let file = file.into_inner().map_err(|error| io_error(error.into_error()))?;
    // Without this a crash of the machine could leave the new name on an empty file.
    file.sync_all().map_err(io_error)?;
    drop(file);
    fs::rename(&temporary_path, path).map_err(io_error)?;
    temporary.0 = None;
    Ok(value)
}

/// A decoded picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` linear RGBA, row 0 = top; premultiplied or straight as the function that made it says.
    pub pixels: Vec<[f32; 4]>,
}

/// Decodes a PNG (gray, RGB, palette, with or without alpha, up to 16 bits) to premultiplied linear RGBA.
/// `path` is only for messages. Values are taken as sRGB whatever color space the file names.
///
/// # Errors
/// [`Error::File`] if the bytes are not a whole PNG, or one of more than 16 384² pixels.
pub fn decode_png(bytes: &[u8], path: &Path) -> Result<Picture> {
    let mut picture = decode_png_straight(bytes, path)?;
    for pixel in &mut picture.pixels {
        *pixel = color::premultiplied_from_straight(*pixel);
    }
    Ok(picture)
}

/// [`decode_png`] of a file.
///
/// # Errors
/// As [`decode_png`], and [`Error::File`] if the file cannot be read.
pub fn read_png(path: &Path) -> Result<Picture> {
    decode_png(&fs::read(path).map_err(|error| Error::io(path, &error))?, path)
}

/// [`decode_png`] with straight alpha: the color of transparent texels is kept.
///
/// # Errors
/// As [`decode_png`].
pub fn decode_png_straight(bytes: &[u8], path: &Path) -> Result<Picture> {
    const MOST_PIXELS: usize = 16_384 * 16_384;
    let damaged = |error: png::DecodingError| {
        Error::file(path, format!("this is not a whole PNG: {error}"), "save it again as PNG")
    };
    let too_large = || Error::file(path, "this PNG has more than 16 384² pixels", "scale it down");

    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    if width.checked_mul(height).is_none_or(|n| n > MOST_PIXELS) {
        return Err(too_large());
    }
    let mut raw = vec![0; reader.output_buffer_size().ok_or_else(too_large)?];
    let info = reader.next_frame(&mut raw).map_err(damaged)?;
    raw.truncate(info.buffer_size());

    let linear: Vec<f32>;
    let alpha: Vec<f32>;
    let num_channels = info.color_type.samples();
    // Color and alpha of a sample are different functions; both are tabled by converting every sample twice only
    // for 16 bits, where files are rare.
    if info.bit_depth == png::BitDepth::Sixteen {
        let values = raw.as_chunks::<2>().0.iter().map(|&pair| f64::from(u16::from_be_bytes(pair)) / 65_535.0);
        alpha = values.clone().map(|v| v as f32).collect();
        linear = values.map(|v| color::linear_from_srgb(v) as f32).collect();
    } else {
        alpha = raw.iter().map(|&code| f32::from(code) / 255.0).collect();
        linear = raw.iter().map(|&code| color::linear_from_srgb8(code)).collect();
    }
    let pixels = linear
        .chunks_exact(num_channels)
        .zip(alpha.chunks_exact(num_channels))
        .map(|(c, a)| match num_channels {
            1 => [c[0], c[0], c[0], 1.0],
            2 => [c[0], c[0], c[0], a[1]],
            3 => [c[0], c[1], c[2], 1.0],
            _ => [c[0], c[1], c[2], a[3]],
        })
        .collect();
    Ok(Picture { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn encode(width: u32, height: u32, pixels: &[[f32; 4]], options: &PngOptions) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        write_png(&mut bytes, width, height, options, |rows| rows.write(pixels))?;
        Ok(bytes)
    }

    /// Chunk types and contents, in order; checks that the file ends with IEND.
    fn chunks(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
        let mut chunks = Vec::new();
        let mut rest = &bytes[8..];
        while !rest.is_empty() {
            let length = u32::from_be_bytes(rest[..4].try_into().unwrap()) as usize;
            chunks.push((String::from_utf8(rest[4..8].to_vec()).unwrap(), rest[8..8 + length].to_vec()));
            rest = &rest[12 + length..];
        }
        assert_eq!(chunks.last().unwrap().0, "IEND");
        chunks
    }

    fn chunk(bytes: &[u8], name: &str) -> Option<Vec<u8>> {
        chunks(bytes).into_iter().find(|(found, _)| found == name).map(|(_, data)| data)
    }

    /// A picture like ours: a shaded ball with a soft transparent rim, fine grain inside, on nothing.
    fn ball(size: usize) -> Vec<[f32; 4]> {
        let mut hash = 1_u32;
        (0..size * size)
            .map(|i| {
                let (x, y) =
                    ((i % size) as f32 / size as f32 * 2.5 - 1.25, (i / size) as f32 / size as f32 * 2.5 - 1.25);
                let r2 = x * x + y * y;
                hash = hash.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let grain = 1.0 + 0.02 * ((hash >> 8) as f32 / (1 << 24) as f32 - 0.5);
                let a = ((1.0 - r2) * 8.0).clamp(0.0, 1.0);
                let shade = (0.2 + 0.7 * (1.0 - r2).max(0.0).sqrt() - 0.3 * x - 0.3 * y).max(0.02) * grain;
                [a * shade, a * shade * 0.6, a * shade * shade * 0.5, a]
            })
            .collect()
    }

    #[test]
    fn what_is_written_is_read_back() {
        // 700 rows of 1000 pixels: several blocks, several batches in small calls
        let (width, height) = (1000, 700);
        let pixels: Vec<[f32; 4]> = ball(1000).into_iter().take(width * height).collect();
        let bytes = encode(1000, 700, &pixels, &PngOptions::default()).unwrap();
        let picture = decode_png(&bytes, Path::new("a")).unwrap();
        assert_eq!((picture.width, picture.height), (width, height));
        for (&wanted, &found) in pixels.iter().zip(&picture.pixels) {
            let codes = color::straight_srgb8_from_premultiplied_linear(wanted);
            assert_eq!(found, color::premultiplied_linear_from_srgb8(codes));
        }
        let opaque: Vec<[f32; 4]> = pixels.iter().map(|&[r, g, b, _]| [r, g, b, 1.0]).collect();
        let bytes = encode(1000, 700, &opaque, &PngOptions { opaque: true, ..PngOptions::default() }).unwrap();
        assert_eq!(chunk(&bytes, "IHDR").unwrap()[9], 2);
        let picture = decode_png(&bytes, Path::new("a")).unwrap();
        for (&wanted, &found) in opaque.iter().zip(&picture.pixels) {
            let codes = color::straight_srgb8_from_premultiplied_linear(wanted);
            assert_eq!(found, color::premultiplied_linear_from_srgb8(codes));
        }
    }

    #[test]
    fn bytes_do_not_depend_on_calls() {
        let pixels = ball(300);
        let whole = encode(300, 300, &pixels, &PngOptions::default()).unwrap();
        let mut by_rows = Vec::new();
        write_png(&mut by_rows, 300, 300, &PngOptions::default(), |rows| {
            pixels.chunks(300 * 37).try_for_each(|some| rows.write(some))
        })
        .unwrap();
        assert!(whole == by_rows);
    }

    #[test]
    fn alpha_solves_back_from_black_and_white() {
        let pixels: Vec<[f32; 4]> = (1..=255)
            .map(|i| {
                let a = i as f32 / 255.0;
                [0.8 * a, 0.3 * a, 0.05 * a, a]
            })
            .collect();
        let picture = decode_png(&encode(255, 1, &pixels, &PngOptions::default()).unwrap(), Path::new("a")).unwrap();
        for (wanted, &[r, g, b, a]) in pixels.iter().zip(&picture.pixels) {
            let over = |background: f32| [r, g, b].map(|c| c + (1.0 - a) * background);
            let (black, white) = (over(0.0), over(1.0));
            for channel in 0..3 {
                let solved = 1.0 - (white[channel] - black[channel]);
                assert!((solved - wanted[3]).abs() < 1e-5);
                // half a code of straight color is at most 0.0045 of linear light
                assert!((black[channel] - wanted[channel]).abs() < 0.0045 * wanted[3] + 1e-6);
            }
        }
    }

    #[test]
    fn chunks_for_print() {
        let text = vec![("Software".to_owned(), "Fabrica".to_owned()), ("Title".to_owned(), "Schädel, ½".to_owned())];
        let options = PngOptions { text, ..PngOptions::default() };
        let bytes = encode(1, 1, &[[0.5, 0.5, 0.5, 1.0]], &options).unwrap();
        let mut wanted = 11_811_u32.to_be_bytes().repeat(2);
        wanted.push(1);
        assert_eq!(chunk(&bytes, "pHYs").unwrap(), wanted);
        assert_eq!(chunk(&bytes, "sRGB").unwrap(), [0]);
        assert_eq!(chunk(&bytes, "gAMA").unwrap(), 45_455_u32.to_be_bytes());
        assert_eq!(chunk(&bytes, "cHRM").unwrap().len(), 32);
        assert_eq!(chunk(&bytes, "tEXt").unwrap(), b"Software\0Fabrica");
        assert!(String::from_utf8(chunk(&bytes, "iTXt").unwrap()).unwrap().ends_with("Schädel, ½"));
        let picture = decode_png(&bytes, Path::new("a")).unwrap();
        assert_eq!((picture.width, picture.height), (1, 1));
        let order: Vec<String> = chunks(&bytes).into_iter().map(|(name, _)| name).collect();
        assert_eq!(order.first().unwrap(), "IHDR");
        let data = order.iter().position(|name| name == "IDAT").unwrap();
        assert!(["pHYs", "sRGB", "gAMA", "cHRM"].iter().all(|n| order.iter().position(|o| o == n).unwrap() < data));
    }

    #[test]
    fn what_cannot_be_written_is_refused() {
        let options = PngOptions::default();
        let opaque = PngOptions { opaque: true, ..PngOptions::default() };
        let message = |result: Result<Vec<u8>>| result.unwrap_err().to_string();
        assert!(message(encode(0, 4, &[], &options)).contains("0 × 4"));
        assert!(message(encode(4, 0, &[], &options)).contains("4 × 0"));
        let mut pixels = vec![[0.5, 0.5, 0.5, 1.0]; 12];
        assert!(encode(4, 3, &pixels, &options).is_ok());
        assert!(message(encode(4, 4, &pixels, &options)).contains("only 3"));
        assert!(message(encode(4, 2, &pixels, &options)).contains("do not fit"));
        assert!(message(encode(5, 3, &pixels, &options)).contains("do not fit"));
        pixels[6][1] = f32::NAN;
        assert!(message(encode(4, 3, &pixels, &options)).contains("row 1, column 2 is not a number"));
        pixels[6][1] = f32::NEG_INFINITY;
        assert!(message(encode(4, 3, &pixels, &opaque)).contains("row 1, column 2 is infinite"));
        pixels[6][1] = f32::MAX;
        assert!(encode(4, 3, &pixels, &options).is_ok());
        pixels[6] = [0.1, 0.1, 0.1, 0.9];
        assert!(message(encode(4, 3, &pixels, &opaque)).contains("without transparency"));
        for dpi in [0.0, -300.0, f64::NAN, f64::INFINITY] {
            assert!(message(encode(1, 1, &[[0.0; 4]], &PngOptions { dpi, ..PngOptions::default() })).contains("dpi"));
        }
        for keyword in ["", " a", "a  b", "ä", &"x".repeat(80)] {
            let text = vec![(keyword.to_owned(), String::new())];
            assert!(
                message(encode(1, 1, &[[0.0; 4]], &PngOptions { text, ..PngOptions::default() })).contains("keyword")
            );
        }
    }

    #[test]
    fn transparent_pixels_carry_no_color() {
        let bytes = encode(2, 1, &[[0.2, 0.1, 0.0, 0.0], [1e-5, 0.0, 0.0, 1e-3]], &PngOptions::default()).unwrap();
        assert_eq!(decode_png_straight(&bytes, Path::new("a")).unwrap().pixels, [[0.0; 4]; 2]);
    }

    #[test]
    fn a_file_is_whole_or_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("figure.png");
        save_png(&path, 1, 1, &[[1.0; 4]], &PngOptions::default()).unwrap();
        let before = fs::read(&path).unwrap();
        // a fault half way, a cancel and a panic leave the old file and nothing else
        assert!(save_png(&path, 1, 1, &[[f32::NAN; 4]], &PngOptions::default()).is_err());
        let cancelled = save_atomic(&path, |file| -> Result<()> {
            file.write_all(b"half").unwrap();
            Err(Error::Cancelled)
        });
        assert!(matches!(cancelled, Err(Error::Cancelled)));
        let panicked = std::panic::catch_unwind(|| save_atomic(&path, |_| -> Result<()> { panic!("planted") }));
        assert!(panicked.is_err());
        assert_eq!(fs::read(&path).unwrap(), before);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        assert_eq!(read_png(&path).unwrap().pixels, [[1.0; 4]]);

        let message = |path: &Path| save_png(path, 1, 1, &[[1.0; 4]], &PngOptions::default()).unwrap_err().to_string();
        assert!(message(folder.path()).contains("a folder"));
        let nowhere = message(&folder.path().join("missing").join("a.png"));
        assert!(nowhere.contains("there is no such folder") && nowhere.ends_with("a.png)"), "{nowhere}");
        let through = message(&path.join("a.png"));
        #[cfg(unix)]
        assert!(through.contains("leads through a file"), "{through}");
        let long = message(&folder.path().join("x".repeat(300)));
        #[cfg(target_os = "linux")]
        assert!(long.contains("shorter"), "{long}");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_named() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::StorageFull.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let error = write_png(Full, 1, 1, &PngOptions::default(), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("disk is full"), "{error}");
        // through the buffer of save_atomic the fault comes late, but not never
        let file = OpenOptions::new().write(true).open("/dev/full").unwrap();
        let mut atomic = AtomicFile { file: BufWriter::with_capacity(16, file), fault: None };
        assert!(atomic.write_all(&[0; 64]).is_err());
        assert_eq!(atomic.fault.unwrap().kind(), io::ErrorKind::StorageFull);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_leaves_the_old_file_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("Head.json");
        fs::write(&path, "old").unwrap();
        // The fault comes at once (small buffer), or when the buffer is emptied at the end.
        for capacity in [16, 256 << 10] {
            let error = save_atomic(&path, |file| {
                let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
                file.file = BufWriter::with_capacity(capacity, full);
                file.write_all(&[b'x'; 64]).map_err(|e| Error::io(&path, &e))
            })
            .unwrap_err();
            let wanted = format!(
                "the disk is full; free some space or choose another place; the file there is as it was ({})",
                path.display()
            );
            assert_eq!(error.to_string(), wanted);
            assert_eq!(fs::read_to_string(&path).unwrap(), "old");
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "a temporary file stayed");
        }
    }

    #[test]
    fn why_nothing_can_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("Head.json");
        let message = |kind: io::ErrorKind| Error::not_written(&path, &kind.into()).to_string();
        let all = [
            (io::ErrorKind::StorageFull, "disk is full"),
            (io::ErrorKind::QuotaExceeded, "used up"),
            (io::ErrorKind::ReadOnlyFilesystem, "only be read"),
            (io::ErrorKind::PermissionDenied, "not permitted"),
        ];
        for (kind, part) in all {
            let text = message(kind);
            assert!(text.contains(part) && text.ends_with("Head.json)") && !text.contains("as it was"), "{text}");
        }
        fs::write(&path, "old").unwrap();
        assert!(all.iter().all(|(kind, _)| message(*kind).contains("; the file there is as it was")));
    }

    #[test]
    fn sixteen_bits_gray_and_palette_are_read() {
        let make = |color: png::ColorType, depth: png::BitDepth, palette: Option<&[u8]>, data: &[u8]| {
            let mut bytes = Vec::new();
            let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
            encoder.set_color(color);
            encoder.set_depth(depth);
            if let Some(palette) = palette {
                encoder.set_palette(palette.to_vec());
            }
            encoder.write_header().unwrap().write_image_data(data).unwrap();
            decode_png(&bytes, Path::new("a")).unwrap().pixels[0]
        };
        use png::BitDepth::{Eight, Sixteen};
        assert_eq!(make(png::ColorType::Grayscale, Eight, None, &[255]), [1.0; 4]);
        assert_eq!(make(png::ColorType::GrayscaleAlpha, Eight, None, &[255, 51]), [0.2; 4]);
        assert_eq!(make(png::ColorType::Indexed, Eight, Some(&[255, 0, 0]), &[0]), [1.0, 0.0, 0.0, 1.0]);
        let [r, g, b, a] = make(png::ColorType::Rgba, Sixteen, None, &[0x80, 0, 0xff, 0xff, 0, 0, 0x80, 0]);
        assert!((a - 0.500_008).abs() < 1e-6 && (g - a).abs() < 1e-7 && b == 0.0);
        assert!((r / a - linear_half()).abs() < 1e-5);
        assert!(decode_png(b"no png", Path::new("b")).unwrap_err().to_string().contains("not a whole PNG"));
    }

    #[test]
    fn an_array_has_its_shape_and_its_numbers() {
        let pixels: Vec<[f32; 4]> = (0..6u8).map(|i| std::array::from_fn(|c| f32::from(i) + 0.1 * c as f32)).collect();
        let mut bytes = Vec::new();
        write_npy(&mut bytes, 3, 2, &pixels).unwrap();
        // As numpy.lib.format has it: the header says its length, and the numbers begin at a multiple of 64.
        let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        assert_eq!((&bytes[..8], start % 64, bytes[start - 1]), (&b"\x93NUMPY\x01\x00"[..], 0, b'\n'));
        let header = std::str::from_utf8(&bytes[10..start]).unwrap();
        assert!(header.contains("'shape': (2, 3, 4)") && header.contains("f4'"), "{header}");
        let numbers: Vec<f32> = bytes[start..].chunks(4).map(|b| f32::from_ne_bytes(b.try_into().unwrap())).collect();
        assert_eq!(numbers, pixels.concat());
        // It is an array to the reader of volumes as well.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        fs::write(&path, &bytes).unwrap();
        let read = crate::read::read_volume(&path, &Default::default(), &crate::Progress::new()).unwrap();
        assert_eq!(read.grid.dims(), [4, 3, 2]);
        assert_eq!(write_npy(&mut bytes, 3, 3, &pixels).unwrap_err().kind(), io::ErrorKind::InvalidInput);
    }

    fn linear_half() -> f32 {
        color::linear_from_srgb(f64::from(0x8000) / 65_535.0) as f32
    }
}
