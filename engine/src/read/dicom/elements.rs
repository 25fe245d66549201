//! The elements of a data set that the reader knows by name. Nothing else of a header is ever kept: names, dates and numbers
//! of patients are passed over where they stand.

use dicom_core::dictionary::{DataDictionary as _, DataDictionaryEntry as _};
use dicom_core::{Tag, VR};
use dicom_dictionary_std::{StandardDataDictionary, tags};
use dicom_encoding::text::{SpecificCharacterSet, TextCodec as _};

/// What is kept of a data set besides [`SEQUENCES`].
const VALUES: &[Tag] = &[
    tags::SPECIFIC_CHARACTER_SET,
    tags::IMAGE_TYPE,
    tags::FRAME_TYPE,
    tags::SOP_CLASS_UID,
    tags::SOP_INSTANCE_UID,
    tags::MODALITY,
    tags::SERIES_DESCRIPTION,
    tags::SERIES_INSTANCE_UID,
    tags::SERIES_NUMBER,
    tags::FRAME_OF_REFERENCE_UID,
    tags::CONCATENATION_UID,
    // The order of slices at one place.
    tags::ACQUISITION_NUMBER,
    tags::INSTANCE_NUMBER,
    tags::TEMPORAL_POSITION_IDENTIFIER,
    tags::TEMPORAL_POSITION_INDEX,
    tags::ECHO_NUMBERS,
    tags::ECHO_TIME,
    tags::EFFECTIVE_ECHO_TIME,
    tags::TRIGGER_TIME,
    tags::NOMINAL_CARDIAC_TRIGGER_DELAY_TIME,
    tags::FRAME_REFERENCE_TIME,
    tags::DIFFUSION_B_VALUE,
    // Geometry.
    tags::IMAGE_POSITION_PATIENT,
    tags::IMAGE_ORIENTATION_PATIENT,
    tags::SLICE_LOCATION,
    tags::SLICE_THICKNESS,
    tags::SPACING_BETWEEN_SLICES,
    tags::PIXEL_SPACING,
    tags::IMAGER_PIXEL_SPACING,
    tags::NOMINAL_SCANNED_PIXEL_SPACING,
    tags::PIXEL_ASPECT_RATIO,
    tags::GRID_FRAME_OFFSET_VECTOR,
    // Pixels.
    tags::ROWS,
    tags::COLUMNS,
    tags::NUMBER_OF_FRAMES,
    tags::SAMPLES_PER_PIXEL,
    tags::PHOTOMETRIC_INTERPRETATION,
    tags::PLANAR_CONFIGURATION,
    tags::BITS_ALLOCATED,
    tags::BITS_STORED,
    tags::HIGH_BIT,
    tags::PIXEL_REPRESENTATION,
    tags::PIXEL_PADDING_VALUE,
    tags::PIXEL_PADDING_RANGE_LIMIT,
    tags::RESCALE_SLOPE,
    tags::RESCALE_INTERCEPT,
    tags::DOSE_GRID_SCALING,
    tags::RED_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR,
    tags::GREEN_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR,
    tags::BLUE_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR,
    tags::RED_PALETTE_COLOR_LOOKUP_TABLE_DATA,
    tags::GREEN_PALETTE_COLOR_LOOKUP_TABLE_DATA,
    tags::BLUE_PALETTE_COLOR_LOOKUP_TABLE_DATA,
    tags::EXTENDED_OFFSET_TABLE,
    tags::EXTENDED_OFFSET_TABLE_LENGTHS,
    // Segmentations.
    tags::SEGMENTATION_TYPE,
    tags::MAXIMUM_FRACTIONAL_VALUE,
    tags::SEGMENT_NUMBER,
    tags::SEGMENT_LABEL,
    tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE,
    tags::REFERENCED_SEGMENT_NUMBER,
    tags::CODE_VALUE,
    tags::LONG_CODE_VALUE,
    tags::CODING_SCHEME_DESIGNATOR,
];

/// The sequences that are kept, with what is known of their items.
const SEQUENCES: &[Tag] = &[
    tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE,
    tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE,
    tags::PLANE_POSITION_SEQUENCE,
    tags::PLANE_ORIENTATION_SEQUENCE,
    tags::PIXEL_MEASURES_SEQUENCE,
    tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE,
    tags::FRAME_CONTENT_SEQUENCE,
    tags::MR_ECHO_SEQUENCE,
    tags::MR_DIFFUSION_SEQUENCE,
    tags::CARDIAC_SYNCHRONIZATION_SEQUENCE,
    tags::TEMPORAL_POSITION_SEQUENCE,
    tags::MODALITY_LUT_SEQUENCE,
    tags::SEGMENT_SEQUENCE,
    tags::SEGMENT_IDENTIFICATION_SEQUENCE,
    tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE,
    tags::SEGMENTED_PROPERTY_TYPE_MODIFIER_CODE_SEQUENCE,
];

/// Whether the reader knows an element, and if so whether it is a sequence.
pub fn is_sequence_if_known(tag: Tag) -> Option<bool> {
    if SEQUENCES.contains(&tag) {
        Some(true)
    } else if VALUES.contains(&tag) {
        Some(false)
    } else {
        None
    }
}

/// The value representation, from the dictionary where a file does not tell.
pub fn representation(tag: Tag, stated: VR) -> VR {
    if stated != VR::UN {
        return stated;
    }
    StandardDataDictionary.by_tag(tag).map_or(VR::UN, |entry| entry.vr().relaxed())
}

#[derive(Clone, Debug)]
enum Value {
    /// In the byte order of the data set.
    Plain {
        vr: VR,
        bytes: Vec<u8>,
    },
    Items(Vec<Elements>),
}

/// The known elements of a data set or item.
#[derive(Clone, Debug, Default)]
pub struct Elements {
    values: Vec<(Tag, Value)>,
    /// Whether binary numbers have their highest byte first.
    is_big_endian: bool,
}

impl Elements {
    /// None yet.
    pub fn new(is_big_endian: bool) -> Self {
        Self { values: Vec::new(), is_big_endian }
    }

    /// Adds an element.
    pub fn push_plain(&mut self, tag: Tag, vr: VR, bytes: Vec<u8>) {
        self.values.push((tag, Value::Plain { vr, bytes }));
    }

    /// Adds a sequence.
    pub fn push_items(&mut self, tag: Tag, items: Vec<Self>) {
        self.values.push((tag, Value::Items(items)));
    }

    fn value(&self, tag: Tag) -> Option<&Value> {
        self.values.iter().find(|(t, _)| *t == tag).map(|(_, value)| value)
    }

    /// Whether there is an element, be it empty.
    pub fn has(&self, tag: Tag) -> bool {
        self.value(tag).is_some()
    }

    /// The bytes of an element as they stand in the file.
    pub fn bytes(&self, tag: Tag) -> Option<&[u8]> {
        match self.value(tag)? {
            Value::Plain { bytes, .. } => Some(bytes),
            Value::Items(_) => None,
        }
    }

    /// The items of a sequence; none if it is missing.
    pub fn items(&self, tag: Tag) -> &[Self] {
        match self.value(tag) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }

    /// The first item of a sequence.
    pub fn item(&self, tag: Tag) -> Option<&Self> {
        self.items(tag).first()
    }

    /// A text of plain letters, without the blanks around it; `None` if it is missing or empty.
    pub fn word(&self, tag: Tag) -> Option<String> {
        let bytes = self.bytes(tag)?;
        let text: String = bytes.iter().filter(|b| b.is_ascii() && **b != 0).map(|b| char::from(*b)).collect();
        let text = text.trim();
        (!text.is_empty()).then(|| text.to_owned())
    }

    /// A text in the characters of a data set, on one line, without the blanks around it.
    pub fn text(&self, tag: Tag, charset: &Charset) -> Option<String> {
        let bytes = self.bytes(tag)?;
        let text = charset.decode(bytes);
        let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        (!text.is_empty()).then_some(text)
    }

    /// The numbers of an element, whichever way they are written; a word that is no number is NaN.
    pub fn numbers(&self, tag: Tag) -> Vec<f64> {
        let Some(Value::Plain { vr, bytes }) = self.value(tag) else { return Vec::new() };
        let big = self.is_big_endian;
        match vr {
            VR::US => array(bytes, big, u16::from_le_bytes).map(f64::from).collect(),
            VR::SS => array(bytes, big, i16::from_le_bytes).map(f64::from).collect(),
            VR::UL => array(bytes, big, u32::from_le_bytes).map(f64::from).collect(),
            VR::SL => array(bytes, big, i32::from_le_bytes).map(f64::from).collect(),
            VR::FL => array(bytes, big, f32::from_le_bytes).map(f64::from).collect(),
            VR::FD => array(bytes, big, f64::from_le_bytes).collect(),
            VR::OV | VR::UV => array(bytes, big, u64::from_le_bytes).map(|n| n as f64).collect(),
            VR::OW | VR::OB | VR::UN => Vec::new(),
            _ => {
                let text = String::from_utf8_lossy(bytes);
                let text = text.trim_matches(['\0', ' ']);
                if text.is_empty() {
                    return Vec::new();
                }
                text.split('\\').map(|word| word.trim().parse().unwrap_or(f64::NAN)).collect()
            }
        }
    }

    /// Its first number, if it has one.
    pub fn number(&self, tag: Tag) -> Option<f64> {
        self.numbers(tag).first().copied().filter(|n| !n.is_nan())
    }

    /// Its first number as a count or code, if it is one.
    pub fn count(&self, tag: Tag) -> Option<u64> {
        let number = self.number(tag)?;
        (number >= 0.0 && number.fract() == 0.0 && number < 9e15).then_some(number as u64)
    }

    /// The 16-bit words of an element, whatever it is declared as.
    pub fn words16(&self, tag: Tag) -> Option<Vec<u16>> {
        Some(array(self.bytes(tag)?, self.is_big_endian, u16::from_le_bytes).collect())
    }
}

/// The numbers of an array in either byte order.
fn array<const N: usize, T>(bytes: &[u8], is_big_endian: bool, from: fn([u8; N]) -> T) -> impl Iterator<Item = T> {
    bytes.as_chunks::<N>().0.iter().map(move |chunk| {
        let mut chunk = *chunk;
        if is_big_endian {
            chunk.reverse();
        }
        from(chunk)
    })
}

/// The characters of a data set's texts.
#[derive(Clone, Debug, Default)]
pub struct Charset(Option<SpecificCharacterSet>);

impl Charset {
    /// As the data set says; what it does not say, or in several alphabets, is taken as UTF-8 if it is.
    pub fn of(elements: &Elements) -> Self {
        let code = elements.word(tags::SPECIFIC_CHARACTER_SET);
        // Of several, the last is the one that is switched to.
        let code = code.as_deref().and_then(|c| c.rsplit('\\').next()).map(str::trim);
        Self(code.filter(|c| !c.is_empty()).and_then(SpecificCharacterSet::from_code))
    }

    fn decode(&self, bytes: &[u8]) -> String {
        let decoded = self.0.as_ref().and_then(|set| set.decode(bytes).ok());
        decoded.unwrap_or_else(|| String::from_utf8_lossy(bytes).into_owned())
    }
}
