//! RLE Lossless: runs of bytes (PackBits), a plane of bytes at a time, the highest byte first. Standard: PS3.5 annex G.

use super::Decoded;
use crate::read::dicom::image::PixelFormat;

const HEADER_BYTES: usize = 64;

/// Unpacks one frame.
pub fn decode(data: &[u8], format: &PixelFormat) -> Result<Decoded, String> {
    let word = |i: usize| {
        let bytes = data.get(4 * i..4 * i + 4)?;
        Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
    };
    let (width, n) = (format.sample_bytes(), format.num_pixels());
    let num_planes = width * format.samples;
    if data.len() < HEADER_BYTES || word(0) != Some(num_planes) {
        return Err(format!("its runs are not those of {num_planes} planes of bytes"));
    }
    let mut bytes = vec![0; n * num_planes];
    let mut plane = Vec::with_capacity(n);
    for i in 0..num_planes {
        let begin = word(1 + i).unwrap_or(0);
        let end = if i + 1 < num_planes { word(2 + i).unwrap_or(0) } else { data.len() };
        let runs = data.get(begin..end).filter(|_| begin >= HEADER_BYTES).ok_or("its runs lie outside of it")?;
        plane.clear();
        unpack(runs, n, &mut plane);
        if plane.len() < n {
            return Err(format!("its runs end after {} of {n} pixels", plane.len()));
        }
        let (sample, byte) = (i / width, i % width);
        // The plane of the highest byte comes first.
        let place = if cfg!(target_endian = "little") { width - 1 - byte } else { byte };
        let at = sample * width + place;
        bytes.iter_mut().skip(at).step_by(num_planes).zip(&plane).for_each(|(to, from)| *to = *from);
    }
    Ok(Decoded { bytes, is_rgb: false, is_interleaved: true })
}

/// Appends at most `limit` bytes.
fn unpack(runs: &[u8], limit: usize, to: &mut Vec<u8>) {
    let mut at = 0;
    while let (Some(&code), true) = (runs.get(at), to.len() < limit) {
        let left = limit - to.len();
        at += 1;
        match code {
            0..=127 => {
                let end = (at + usize::from(code) + 1).min(runs.len());
                to.extend_from_slice(&runs[at..end.min(at + left)]);
                at = end;
            }
            128 => {}
            129.. => {
                let Some(&value) = runs.get(at) else { return };
                to.resize(to.len() + (257 - usize::from(code)).min(left), value);
                at += 1;
            }
        }
    }
}
