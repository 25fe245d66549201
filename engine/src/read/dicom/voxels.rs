//! From the numbers of a frame to voxels: bits, signs, rescale, inversion, padding, colors.

use super::codec::Decoded;
use super::file::PixelKind;
use super::image::{Photometric, PixelFormat};
use super::slices::Slice;
use crate::read::window::Averaged;
use crate::volume::{Modality, Rescale};

/// The element type of a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// As in [`crate::volume::Voxels`].
    U8,
    /// As in [`crate::volume::Voxels`].
    I8,
    /// As in [`crate::volume::Voxels`].
    U16,
    /// As in [`crate::volume::Voxels`].
    I16,
    /// As in [`crate::volume::Voxels`].
    U32,
    /// As in [`crate::volume::Voxels`].
    I32,
    /// As in [`crate::volume::Voxels`].
    F32,
    /// As in [`crate::volume::Voxels`].
    F64,
    /// sRGB and alpha.
    Rgb,
}

/// What the voxels of a stack become.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Their type.
    pub element: Element,
    /// From voxels to data values.
    pub rescale: Rescale,
    /// Whether every slice has its own rescale, which is applied while reading.
    pub is_rescaled: bool,
    /// Whether small numbers are the bright ones and shall not be.
    pub is_inverted: bool,
    /// Whether small numbers are the bright ones and stay so.
    is_negative: bool,
    /// Whether the voxels may be padding.
    pub has_padding: bool,
    /// Whether padding is air.
    pub is_ct: bool,
}

impl Target {
    /// The narrowest type that holds the values of all slices exactly; f32 where there is none.
    pub fn of<'a>(format: &PixelFormat, modality: Modality, slices: impl Iterator<Item = &'a Slice> + Clone) -> Self {
        let rescale = slices.clone().next().map_or(Rescale::IDENTITY, |s| s.rescale);
        let is_uniform = slices.clone().all(|s| s.rescale == rescale);
        let has_padding = slices.clone().any(|s| s.padding.is_some());
        // Values that are measurements stay what they are; only of pictures is the look what matters.
        let is_measured = matches!(modality, Modality::Ct | Modality::Pet | Modality::Nuclear);
        let is_negative = format.photometric == Photometric::Monochrome1;
        let is_inverted = is_negative && !is_measured && format.kind == PixelKind::Integer;
        let stored = match (format.kind, format.bits_allocated, format.is_signed) {
            (PixelKind::Float, ..) => Element::F32,
            (PixelKind::Double, ..) => Element::F64,
            _ if format.is_color() => Element::Rgb,
            (_, 1, _) | (_, 8, false) => Element::U8,
            (_, 8, true) => Element::I8,
            (_, 16, false) => Element::U16,
            (_, 16, true) => Element::I16,
            (_, _, false) => Element::U32,
            (_, _, true) => Element::I32,
        };
        let (low, high) = format.stored_range();
        let fits_i16 = |s: &Slice| {
            let Rescale { slope, intercept } = s.rescale;
            let ends = [low, high].map(|v| s.rescale.value(v));
            slope.fract() == 0.0 && intercept.fract() == 0.0 && ends.iter().all(|v| v.abs() < 32_768.0)
        };
        let mut slices = slices;
        let all_fit_i16 = slices.all(fits_i16);
        let (element, is_rescaled) = match stored {
            Element::Rgb => (Element::Rgb, false),
            _ if is_uniform && rescale.slope.is_finite() && rescale.intercept.is_finite() => {
                // Padding in numbers that are turned around could not be told from others.
                (if has_padding && is_inverted { Element::F32 } else { stored }, false)
            }
            Element::F64 => (Element::F64, true),
            _ if !has_padding && all_fit_i16 => (Element::I16, true),
            _ => (Element::F32, true),
        };
        let rescale = if is_rescaled || element == Element::Rgb { Rescale::IDENTITY } else { rescale };
        let is_ct = modality == Modality::Ct;
        Self { element, rescale, is_rescaled, is_inverted, is_negative, has_padding, is_ct }
    }

    /// What a segmentation becomes.
    pub fn labels() -> Self {
        Self {
            element: Element::U16,
            rescale: Rescale::IDENTITY,
            is_rescaled: false,
            is_inverted: false,
            is_negative: false,
            has_padding: false,
            is_ct: false,
        }
    }

    /// As [`crate::read::Entry::type_name`].
    pub fn type_name(&self) -> &'static str {
        match self.element {
            Element::U8 => "uint8",
            Element::I8 => "int8",
            Element::U16 => "uint16",
            Element::I16 => "int16",
            Element::U32 => "uint32",
            Element::I32 => "int32",
            Element::F32 => "float32",
            Element::F64 => "float64",
            Element::Rgb => "rgb",
        }
    }

    /// As [`crate::read::Entry::bytes_per_voxel`]: colors have a luminance beside them.
    pub fn bytes_per_voxel(&self) -> usize {
        match self.element {
            Element::U8 | Element::I8 => 1,
            Element::U16 | Element::I16 => 2,
            Element::U32 | Element::I32 | Element::F32 => 4,
            Element::F64 => 8,
            Element::Rgb => 6,
        }
    }

    /// What the user shall know.
    pub fn note(&self) -> Option<String> {
        if self.is_inverted {
            Some("The picture is stored as a negative (MONOCHROME1): its values were turned around.".to_owned())
        } else if self.is_negative {
            Some(
                "The picture is shown as a negative elsewhere (MONOCHROME1): its values are as they were measured."
                    .to_owned(),
            )
        } else {
            None
        }
    }

    /// The same for voxels that are averaged or interpolated: padding must be told from numbers until it is filled.
    pub fn with_gaps(mut self) -> Self {
        if self.has_padding && !matches!(self.element, Element::F32 | Element::F64 | Element::Rgb) {
            self.element = Element::F32;
        }
        self
    }
}

/// A type that voxels may have.
pub trait Number: Averaged + bytemuck::Pod + PartialOrd {
    /// Whether it can hold the mark of padding.
    const HAS_NAN: bool;
    /// From a number that fits; NaN is padding.
    fn from_value(value: f64) -> Self;
    /// As f64.
    fn value(self) -> f64;
}

macro_rules! impl_number {
    ($($t:ty: $nan:literal),*) => {
        $(impl Number for $t {
            const HAS_NAN: bool = $nan;
            fn from_value(value: f64) -> Self { value as $t }
            fn value(self) -> f64 { self as f64 }
        })*
    };
}
impl_number!(u8: false, i8: false, u16: false, i16: false, u32: false, i32: false, f32: true, f64: true);

/// Fills `to`, a slice of the volume, with the numbers of a frame. Padding becomes NaN where the type has it, and else stays.
pub fn convert<T: Number>(decoded: &Decoded, format: &PixelFormat, target: &Target, slice: &Slice, to: &mut [T]) {
    let bytes = &decoded.bytes;
    let rescale = if target.is_rescaled { slice.rescale } else { Rescale::IDENTITY };
    match format.kind {
        PixelKind::Float => {
            let numbers = bytes.as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_ne_bytes(*b)));
            to.iter_mut().zip(numbers).for_each(|(to, v)| *to = T::from_value(rescale.value(v)));
        }
        PixelKind::Double => {
            let numbers = bytes.as_chunks::<8>().0.iter().map(|b| f64::from_ne_bytes(*b));
            to.iter_mut().zip(numbers).for_each(|(to, v)| *to = T::from_value(rescale.value(v)));
        }
        PixelKind::Integer => {
            let is_plain = !target.is_rescaled
                && !target.is_inverted
                && format.bits_stored == format.bits_allocated.max(8)
                && size_of::<T>() == format.sample_bytes()
                && !T::HAS_NAN;
            if is_plain {
                // The bits as they are: signed or not is a matter of the type.
                let to: &mut [u8] = bytemuck::cast_slice_mut(to);
                let n = to.len().min(bytes.len());
                to[..n].copy_from_slice(&bytes[..n]);
                return;
            }
            let bits = Bits::of(format, target, slice);
            match format.sample_bytes() {
                1 => bits.convert(bytes.iter().map(|b| u32::from(*b)), rescale, to),
                2 => bits.convert(
                    bytes.as_chunks::<2>().0.iter().map(|b| u32::from(u16::from_ne_bytes(*b))),
                    rescale,
                    to,
                ),
                _ => bits.convert(bytes.as_chunks::<4>().0.iter().map(|b| u32::from_ne_bytes(*b)), rescale, to),
            }
        }
    }
}

/// Where the bits of a number lie in what is stored, and what they mean.
struct Bits {
    /// To bring the highest bit to the top, and from there the lowest to the bottom.
    left: u32,
    right: u32,
    is_signed: bool,
    /// What a number is subtracted from to turn a negative around.
    inverted_from: Option<i64>,
    padding: Option<(i64, i64)>,
    /// To bring what is stored, with all its bits, to the top.
    whole: u32,
}

impl Bits {
    fn of(format: &PixelFormat, target: &Target, slice: &Slice) -> Self {
        let (low, high) = format.stored_range();
        Self {
            left: 31 - format.high_bit as u32,
            right: 32 - format.bits_stored as u32,
            is_signed: format.is_signed,
            inverted_from: target.is_inverted.then_some((low + high) as i64),
            padding: slice.padding.map(|(a, b)| (a as i64, b as i64)),
            whole: 32 - 8 * format.sample_bytes() as u32,
        }
    }

    fn convert<T: Number>(&self, stored: impl Iterator<Item = u32>, rescale: Rescale, to: &mut [T]) {
        let extend = |word: u32, left: u32, right: u32| {
            if self.is_signed { i64::from((word << left) as i32 >> right) } else { i64::from((word << left) >> right) }
        };
        for (to, word) in to.iter_mut().zip(stored) {
            let number = extend(word, self.left, self.right);
            if let Some((low, high)) = self.padding {
                // Padding may lie outside of the bits that are stored.
                let whole = extend(word, self.whole, self.whole);
                let is_padding = (low..=high).contains(&whole) || (low..=high).contains(&number);
                if is_padding {
                    *to = if T::HAS_NAN { T::from_value(f64::NAN) } else { T::from_value(low as f64) };
                    continue;
                }
            }
            let number = self.inverted_from.map_or(number, |sum| sum - number);
            *to = T::from_value(rescale.value(number as f64));
        }
    }
}

/// The colors of a frame.
pub struct Colors {
    /// Of palettes, the color of every number from `first` on.
    pub palette: Vec<[u8; 4]>,
    /// The number of the palette's first color.
    pub first: i64,
}

impl Colors {
    /// Fills `to` with the colors of a frame's pixels.
    pub fn convert(&self, decoded: &Decoded, format: &PixelFormat, to: &mut [[u8; 4]]) {
        let width = format.sample_bytes();
        let n = format.num_pixels();
        let shift = format.bits_stored.saturating_sub(8);
        let number = |i: usize| -> i64 {
            match decoded.bytes.get(i * width..(i + 1) * width) {
                Some(&[a]) => i64::from(a),
                Some(&[a, b]) => i64::from(u16::from_ne_bytes([a, b])),
                _ => 0,
            }
        };
        if format.photometric == Photometric::Palette {
            let is_signed = format.is_signed;
            for (i, to) in to.iter_mut().enumerate() {
                let n = number(i);
                let n = match (is_signed, width) {
                    (true, 1) => i64::from(n as i8),
                    (true, _) => i64::from(n as i16),
                    _ => n & ((1 << format.bits_stored.min(16)) - 1),
                };
                let at = (n - self.first).clamp(0, self.palette.len() as i64 - 1);
                *to = self.palette.get(at as usize).copied().unwrap_or([0, 0, 0, 255]);
            }
            return;
        }
        let is_planar = format.is_planar && !decoded.is_interleaved;
        let is_ybr = matches!(format.photometric, Photometric::YbrFull | Photometric::YbrFull422) && !decoded.is_rgb;
        let byte = |i: usize| (number(i) >> shift).clamp(0, 255) as u8;
        for (i, to) in to.iter_mut().enumerate() {
            let [a, b, c]: [u8; 3] = std::array::from_fn(|k| byte(if is_planar { k * n + i } else { 3 * i + k }));
            let [r, g, b] = if is_ybr { rgb_from_ybr(a, b, c) } else { [a, b, c] };
            *to = [r, g, b, 255];
        }
    }
}

/// Full-range ITU-R BT.601, as JPEG has it.
fn rgb_from_ybr(y: u8, cb: u8, cr: u8) -> [u8; 3] {
    let (y, cb, cr) = (f32::from(y), f32::from(cb) - 128.0, f32::from(cr) - 128.0);
    [y + 1.402 * cr, y - 0.344_136 * cb - 0.714_136 * cr, y + 1.772 * cb].map(|v| v.round().clamp(0.0, 255.0) as u8)
}
