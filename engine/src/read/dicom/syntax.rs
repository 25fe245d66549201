//! How a file is written: byte order, representations, and the codec of its pixels.

use dicom_encoding::TransferSyntaxIndex as _;
use dicom_transfer_syntax_registry::TransferSyntaxRegistry;

/// How the pixels are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Codec {
    /// One after the other.
    Native,
    /// Run lengths, a byte plane at a time.
    Rle,
    /// JPEG: baseline, extended, progressive, lossless.
    Jpeg,
    /// JPEG-LS, lossless or near it.
    JpegLs,
    /// JPEG 2000.
    Jpeg2000,
    /// One that nobody reads here, by its name.
    Other(&'static str),
}

/// The transfer syntax of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Syntax {
    /// Whether elements state their representation.
    pub is_explicit: bool,
    /// Whether numbers have their highest byte first.
    pub is_big_endian: bool,
    /// Whether the data set is deflated as a whole.
    pub is_deflated: bool,
    /// The packing of the pixels.
    pub codec: Codec,
}

impl Syntax {
    /// The syntax that a file states; one that states none is plain.
    pub fn from_uid(uid: Option<&str>) -> Self {
        let plain = Self { is_explicit: true, is_big_endian: false, is_deflated: false, codec: Codec::Native };
        let Some(uid) = uid else { return plain };
        let packed = |codec| Self { codec, ..plain };
        match uid.strip_prefix("1.2.840.10008.1.2") {
            Some("") => Self { is_explicit: false, ..plain },
            Some(".1") => plain,
            Some(".2") => Self { is_big_endian: true, ..plain },
            Some(".1.99") => Self { is_deflated: true, ..plain },
            Some(".5") => packed(Codec::Rle),
            Some(".4.80" | ".4.81") => packed(Codec::JpegLs),
            Some(".4.90" | ".4.91") => packed(Codec::Jpeg2000),
            Some(".4.50" | ".4.51" | ".4.53" | ".4.55" | ".4.57" | ".4.70") => packed(Codec::Jpeg),
            _ => {
                let known = TransferSyntaxRegistry.get(uid).map(|syntax| syntax.name());
                packed(Codec::Other(known.unwrap_or("a private transfer syntax")))
            }
        }
    }
}
