//! Pictures as the display shows them, compared pixel for pixel.

use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::Path;

/// 8-bit RGB, row after row from the top.
#[derive(Clone, PartialEq)]
pub struct Picture {
    pub width: usize,
    pub height: usize,
    rgb: Vec<u8>,
}

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

impl Region {
    /// The pixel in its middle.
    pub fn middle(self) -> [i16; 2] {
        [self.left + self.width / 2, self.top + self.height / 2].map(|n| n as i16)
    }

    /// Whether it lies in another one.
    pub fn is_in(self, other: Self) -> bool {
        self.left >= other.left
            && self.top >= other.top
            && self.left + self.width <= other.left + other.width
            && self.top + self.height <= other.top + other.height
    }
}

impl Picture {
    /// A picture of `3 · width · height` codes.
    pub fn new(width: usize, height: usize, rgb: Vec<u8>) -> Self {
        assert_eq!(rgb.len(), 3 * width * height);
        Self { width, height, rgb }
    }

    fn pixels(&self) -> &[[u8; 3]] {
        self.rgb.as_chunks::<3>().0
    }

    /// The smallest rectangle with every pixel of a color.
    pub fn bounds_of(&self, color: [u8; 3]) -> Option<Region> {
        let mut bounds: Option<[usize; 4]> = None;
        for (i, _) in self.pixels().iter().enumerate().filter(|(_, p)| **p == color) {
            let (x, y) = (i % self.width, i / self.width);
            let [left, top, right, bottom] = bounds.unwrap_or([x, y, x, y]);
            bounds = Some([left.min(x), top.min(y), right.max(x), bottom.max(y)]);
        }
        let [left, top, right, bottom] = bounds?;
        Some(Region { left, top, width: right - left + 1, height: bottom - top + 1 })
    }

    /// A part of it.
    pub fn crop(&self, region: Region) -> Self {
        let rows = self.rgb.chunks(3 * self.width).skip(region.top).take(region.height);
        let rgb = rows.flat_map(|row| &row[3 * region.left..3 * (region.left + region.width)]).copied().collect();
        Self::new(region.width, region.height, rgb)
    }

    /// What keeps it from being another one; `None` if it is.
    pub fn difference(&self, other: &Self) -> Option<String> {
        if (self.width, self.height) != (other.width, other.height) {
            return Some(format!("{}x{} instead of {}x{}", self.width, self.height, other.width, other.height));
        }
        let differs = |(a, b): (&[u8; 3], &[u8; 3])| a != b;
        let num_different = self.pixels().iter().zip(other.pixels()).filter(|p| differs(*p)).count();
        let most = self.rgb.iter().zip(&other.rgb).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or_default();
        (num_different > 0).then(|| {
            let total = self.width * self.height;
            format!("{num_different} of {total} pixels differ, by up to {most} of 255 codes")
        })
    }

    /// Writes a PNG.
    pub fn save(&self, path: &Path) {
        let file = BufWriter::new(File::create(path).unwrap());
        let mut encoder = png::Encoder::new(file, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::Fast);
        encoder.write_header().unwrap().write_image_data(&self.rgb).unwrap();
    }

    /// Reads an opaque 8-bit PNG, as figures with a background are.
    pub fn read(path: &Path) -> Self {
        let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut rgb).unwrap();
        assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
        Self::new(info.width as usize, info.height as usize, rgb)
    }
}
