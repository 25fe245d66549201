//! Pictures that people bring along: PNG and JPEG, told apart by their content.

use std::fs;
use std::path::Path;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::color;
use crate::error::{Error, Result};
use crate::image_out::{Picture, decode_png_straight};

/// How the names of pictures end that can be read, in lower case.
pub const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];
/// A larger side is refused before anything is allocated.
const MOST_EDGE: usize = 16_384;

/// Whether a file is called as pictures are.
pub fn is_named_as_picture(path: &Path) -> bool {
    path.extension().is_some_and(|e| EXTENSIONS.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// [`decode_straight`] of a file.
///
/// # Errors
/// As [`decode_straight`], and [`Error::File`] if the file cannot be read.
pub fn read_straight(path: &Path) -> Result<Picture> {
    decode_straight(&fs::read(path).map_err(|error| Error::io(path, &error))?, path)
}

/// Decodes a PNG (as [`decode_png_straight`]) or a JPEG (8 bits; gray, YCbCr, RGB, CMYK and YCCK as Adobe writes them) to
/// straight linear RGBA. Values are taken as sRGB whatever profile the file names, CMYK as complements of RGB, and a picture lies
/// as it is stored, whatever turn its EXIF asks for. `path` is only for messages.
///
/// # Errors
/// [`Error::File`] if the bytes are of another format, damaged, or have more than 16 384 pixels a side (JPEG).
pub fn decode_straight(bytes: &[u8], path: &Path) -> Result<Picture> {
    if bytes.starts_with(b"\x89PNG") {
        return decode_png_straight(bytes, path);
    }
    if bytes.starts_with(&[0xff, 0xd8, 0xff]) {
        return decode_jpeg(bytes, path);
    }
    let known = [
        (&b"GIF8"[..], 0, "a GIF"),
        (b"BM", 0, "a BMP"),
        (b"II*\0", 0, "a TIFF"),
        (b"MM\0*", 0, "a TIFF"),
        (b"8BPS", 0, "a Photoshop file"),
        (b"WEBP", 8, "a WebP"),
        (b"ftypavif", 4, "an AVIF"),
        (b"ftyphei", 4, "a HEIF"),
        (b"#?RADIANCE", 0, "a Radiance HDR"),
        (&[0x76, 0x2f, 0x31, 0x01], 0, "an OpenEXR"),
    ];
    let found = known.iter().find(|(magic, at, _)| bytes.get(*at..).is_some_and(|rest| rest.starts_with(magic)));
    Err(match found {
        Some((_, _, name)) => {
            Error::file(path, format!("this is {name}, not a PNG or JPEG"), "save the picture as one of these")
        }
        None => Error::file(path, "this is neither a PNG nor a JPEG", "choose a picture of one of these formats"),
    })
}

fn decode_jpeg(bytes: &[u8], path: &Path) -> Result<Picture> {
    let damaged = |error: String| {
        Error::file(path, format!("this is not a whole JPEG: {error}"), "save it again as a JPEG of 8 bits, or as PNG")
    };
    let options = DecoderOptions::default().set_max_width(MOST_EDGE).set_max_height(MOST_EDGE).set_strict_mode(true);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| damaged(e.to_string()))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| damaged("it has no size".to_owned()))?;
    let is_gray = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let out = if is_gray { ColorSpace::Luma } else { ColorSpace::RGB };
    decoder.set_options(options.jpeg_set_out_colorspace(out));
    let codes = decoder.decode().map_err(|e| damaged(e.to_string()))?;
    let linear = color::linear_from_srgb8;
    let pixels: Vec<[f32; 4]> = if is_gray {
        codes.iter().map(|&code| [linear(code), linear(code), linear(code), 1.0]).collect()
    } else {
        codes.as_chunks::<3>().0.iter().map(|&[r, g, b]| [linear(r), linear(g), linear(b), 1.0]).collect()
    };
    if pixels.len() != width * height {
        return Err(damaged("pixels are missing".to_owned()));
    }
    Ok(Picture { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::srgb_from_linear;

    /// The codes of the left and right half of a small picture.
    fn codes(bytes: &[u8]) -> [[f64; 3]; 2] {
        let picture = decode_straight(bytes, Path::new("x.jpg")).unwrap();
        assert_eq!((picture.width, picture.height), (16, 8));
        let at = |x: usize| std::array::from_fn(|c| 255.0 * srgb_from_linear(f64::from(picture.pixels[3 * 16 + x][c])));
        [at(3), at(12)]
    }

    #[test]
    fn jpegs_of_all_colors_are_read() {
        for (bytes, expected) in [
            (&include_bytes!("image_in/color.jpg")[..], [[200.0, 100.0, 50.0], [20.0, 90.0, 180.0]]),
            (include_bytes!("image_in/gray.jpg"), [[200.0; 3], [60.0; 3]]),
            // Inks of 0, 60, 80, 20 % and of 80, 20, 0, 0 %.
            (include_bytes!("image_in/cmyk.jpg"), [[204.0, 81.6, 40.8], [51.0, 204.0, 255.0]]),
            (include_bytes!("image_in/ycck.jpg"), [[204.0, 81.6, 40.8], [51.0, 204.0, 255.0]]),
        ] {
            for (found, expected) in codes(bytes).iter().flatten().zip(expected.iter().flatten()) {
                assert!((found - expected).abs() < 5.0, "{found} {expected}");
            }
        }
    }

    #[test]
    fn what_is_no_picture_is_named() {
        let message = |bytes: &[u8]| decode_straight(bytes, Path::new("x")).unwrap_err().to_string();
        assert_eq!(message(b""), "this is neither a PNG nor a JPEG; choose a picture of one of these formats (x)");
        assert!(message(b"RIFF\0\0\0\0WEBPVP8 ").starts_with("this is a WebP, not a PNG or JPEG; save the picture"));
        let whole = include_bytes!("image_in/color.jpg");
        for length in [3, 20, whole.len() / 2] {
            assert!(message(&whole[..length]).contains("not a whole JPEG"), "{length}: {}", message(&whole[..length]));
        }
        assert!(message(b"\x89PNG\r\n\x1a\n").contains("not a whole PNG"));
        assert!(is_named_as_picture(Path::new("a.JPeG")) && !is_named_as_picture(Path::new("png")));
    }
}
