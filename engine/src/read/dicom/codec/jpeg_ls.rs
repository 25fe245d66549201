//! JPEG-LS, lossless and near-lossless, by hand: no crate does it without a C++ library and CMake. Standard: ITU-T T.87, whose
//! names (A, B, C, N, J, k, Ra to Rd) are kept where it has them.

use super::{Decoded, check_promise};
use crate::read::dicom::image::PixelFormat;

/// Lengths of runs, as powers of two (T.87, A.2.1).
const J: [u32; 32] =
    [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 9, 10, 11, 12, 13, 14, 15];

const ENDS_EARLY: &str = "its JPEG-LS data end early";

/// Unpacks one frame.
pub fn decode(data: &[u8], format: &PixelFormat) -> Result<Decoded, String> {
    let stream = Stream::parse(data, format)?;
    let width = format.sample_bytes();
    let mut bytes = vec![0; format.num_pixels() * format.samples * width];
    let (n, samples) = (format.columns, format.samples);
    let mut put = |sample: usize, row: usize, line: &[i32]| {
        let start = row * n * samples * width;
        let places = bytes[start..].chunks_exact_mut(width).skip(sample).step_by(samples);
        for (to, number) in places.zip(line) {
            match width {
                1 => to[0] = *number as u8,
                2 => to.copy_from_slice(&(*number as u16).to_ne_bytes()),
                _ => to.copy_from_slice(&number.to_ne_bytes()),
            }
        }
    };
    for scan in &stream.scans {
        let mut coder = Coder::new(&stream, scan.near, scan.data)?;
        // Per component the line above and the present one, with a number before and behind, and the index of runs.
        let mut lines: Vec<([Vec<i32>; 2], usize)> =
            scan.samples.iter().map(|_| ([vec![0; n + 2], vec![0; n + 2]], 0)).collect();
        for row in 0..format.rows {
            for (sample, ([above, line], run_index)) in scan.samples.iter().zip(&mut lines) {
                line[0] = above[1];
                above[n + 1] = above[n];
                coder.line(above, line, run_index)?;
                put(*sample, row, &line[1..=n]);
                std::mem::swap(above, line);
            }
        }
    }
    Ok(Decoded { bytes, is_rgb: false, is_interleaved: true })
}

/// The marker segments.
struct Stream<'a> {
    max_value: i32,
    thresholds: Option<[i32; 3]>,
    reset: i32,
    scans: Vec<Scan<'a>>,
}

struct Scan<'a> {
    /// The components in it.
    samples: Vec<usize>,
    near: i32,
    data: &'a [u8],
}

impl<'a> Stream<'a> {
    fn parse(data: &'a [u8], format: &PixelFormat) -> Result<Self, String> {
        if !data.starts_with(&[0xff, 0xd8]) {
            return Err("its data are no JPEG-LS".to_owned());
        }
        let mut stream = Self { max_value: 0, thresholds: None, reset: 64, scans: Vec::new() };
        let mut components: Vec<u8> = Vec::new();
        let mut at = 2;
        let mut num_decoded = 0;
        while num_decoded < format.samples {
            let Some(&[0xff, code, high, low]) = data.get(at..at + 4).and_then(|b| b.first_chunk::<4>()) else {
                return Err(ENDS_EARLY.to_owned());
            };
            if code == 0xff {
                at += 1;
                continue;
            }
            let length = usize::from(u16::from_be_bytes([high, low]));
            let segment = data.get(at + 4..(at + 2 + length).max(at + 4)).ok_or(ENDS_EARLY)?;
            let word = |i: usize| -> Result<usize, String> {
                let bytes = segment.get(i..i + 2).ok_or(ENDS_EARLY)?;
                Ok(usize::from(u16::from_be_bytes([bytes[0], bytes[1]])))
            };
            at += 2 + length.max(2);
            match code {
                0xf7 => {
                    let [bits, num_components] = [0, 5].map(|i| usize::from(segment.get(i).copied().unwrap_or(0)));
                    check_promise(word(3)?, word(1)?, num_components, bits, format)?;
                    if !(2..=16).contains(&bits) {
                        return Err(format!("it is JPEG-LS of {bits} bits, where 2 to 16 are possible"));
                    }
                    stream.max_value = (1 << bits) - 1;
                    components = segment[6.min(segment.len())..].chunks_exact(3).map(|c| c[0]).collect();
                }
                0xf8 if segment.first() == Some(&1) => {
                    let [max, a, b, c, reset] = [word(1)?, word(3)?, word(5)?, word(7)?, word(9)?].map(|n| n as i32);
                    if max != 0 {
                        stream.max_value = max;
                    }
                    if [a, b, c] != [0; 3] {
                        stream.thresholds = Some([a, b, c]);
                    }
                    if reset != 0 {
                        stream.reset = reset.max(3);
                    }
                }
                0xda => {
                    let num = usize::from(segment.first().copied().unwrap_or(0));
                    let tail = segment.get(1 + 2 * num..4 + 2 * num).ok_or(ENDS_EARLY)?;
                    let (near, interleave) = (i32::from(tail[0]), tail[1]);
                    if interleave > 1 && num > 1 {
                        return Err("it is JPEG-LS interleaved by pixels, which Fabrica does not read".to_owned());
                    }
                    if (0..num).any(|i| segment[2 + 2 * i] != 0) {
                        return Err("it is JPEG-LS with a table of values, which Fabrica does not read".to_owned());
                    }
                    let samples: Option<Vec<usize>> =
                        (0..num).map(|i| components.iter().position(|c| *c == segment[1 + 2 * i])).collect();
                    let samples = samples.filter(|s| !s.is_empty()).ok_or("its JPEG-LS data are damaged")?;
                    let rest = data.get(at..).ok_or(ENDS_EARLY)?;
                    let end = rest.windows(2).position(|w| w[0] == 0xff && w[1] >= 0x80).unwrap_or(rest.len());
                    num_decoded += samples.len();
                    stream.scans.push(Scan { samples, near, data: &rest[..end] });
                    at += end;
                }
                0xdd => return Err("it is JPEG-LS with restart markers, which Fabrica does not read".to_owned()),
                _ => {}
            }
        }
        Ok(stream)
    }
}

/// A context of prediction errors.
#[derive(Clone, Copy)]
struct Context {
    a: i32,
    b: i32,
    c: i32,
    n: i32,
}

struct Coder<'a> {
    bits: Bits<'a>,
    max_value: i32,
    near: i32,
    /// 2 NEAR + 1: what one step of an error is worth.
    unit: i32,
    range: i32,
    /// Bits of an error.
    qbpp: u32,
    limit: u32,
    reset: i32,
    thresholds: [i32; 3],
    contexts: Vec<Context>,
    /// For the ends of runs: by whether the line above goes on as the run does; `b` counts negative errors.
    run_contexts: [Context; 2],
}

fn bits_of(n: i32) -> u32 {
    // Smallest b with 2^b >= n.
    (n.max(1) as u32).next_power_of_two().trailing_zeros()
}

impl<'a> Coder<'a> {
    fn new(stream: &Stream, near: i32, data: &'a [u8]) -> Result<Self, String> {
        let max = stream.max_value;
        if max < 1 || near > 255.min(max / 2) {
            return Err("its JPEG-LS data are damaged".to_owned());
        }
        let unit = 2 * near + 1;
        let range = (max + 2 * near) / unit + 1;
        let bpp = bits_of(max + 1).max(2);
        let clamp = |x: i32, low: i32| if x > max || x < low { low } else { x };
        let thresholds = stream.thresholds.unwrap_or_else(|| {
            let of = |t: [i32; 3]| {
                let t1 = clamp(t[0], near + 1);
                let t2 = clamp(t[1], t1);
                [t1, t2, clamp(t[2], t2)]
            };
            if max >= 128 {
                let factor = (max.min(4095) + 128) / 256;
                of([factor + 2 + 3 * near, 4 * factor + 3 + 5 * near, 17 * factor + 4 + 7 * near])
            } else {
                let factor = 256 / (max + 1);
                of([2.max(3 / factor + 3 * near), 3.max(7 / factor + 5 * near), 4.max(21 / factor + 7 * near)])
            }
        });
        let fresh = Context { a: ((range + 32) / 64).max(2), b: 0, c: 0, n: 1 };
        Ok(Self {
            bits: Bits { data, at: 0, held: 0, num_held: 0, was_ff: false, num_missing: 0 },
            max_value: max,
            near,
            unit,
            range,
            qbpp: bits_of(range),
            limit: 2 * (bpp + bpp.max(8)),
            reset: stream.reset,
            thresholds,
            contexts: vec![fresh; 365],
            run_contexts: [fresh; 2],
        })
    }

    /// Decodes `line[1..=n]` from the line above it; both have a number before and one behind.
    fn line(&mut self, above: &[i32], line: &mut [i32], run_index: &mut usize) -> Result<(), String> {
        let n = line.len() - 2;
        let mut x = 1;
        while x <= n {
            let (ra, rb, rc, rd) = (line[x - 1], above[x], above[x - 1], above[x + 1]);
            let gradients = [rd - rb, rb - rc, rc - ra];
            if gradients.iter().all(|d| d.abs() <= self.near) {
                x = self.run(above, line, x, run_index)?;
                continue;
            }
            line[x] = self.regular(ra, rb, rc, gradients)?;
            x += 1;
        }
        if self.bits.is_past_end() { Err(ENDS_EARLY.to_owned()) } else { Ok(()) }
    }

    fn quantize(&self, d: i32) -> i32 {
        let [t1, t2, t3] = self.thresholds;
        let q = match d.abs() {
            m if m <= self.near => 0,
            m if m < t1 => 1,
            m if m < t2 => 2,
            m if m < t3 => 3,
            _ => 4,
        };
        if d < 0 { -q } else { q }
    }

    /// The number with this prediction and error.
    fn reconstruct(&self, prediction: i32, error: i32) -> i32 {
        let mut value = prediction + error * self.unit;
        let period = self.range * self.unit;
        if value < -self.near {
            value += period;
        } else if value > self.max_value + self.near {
            value -= period;
        }
        value.clamp(0, self.max_value)
    }

    fn regular(&mut self, ra: i32, rb: i32, rc: i32, gradients: [i32; 3]) -> Result<i32, String> {
        let [q1, q2, q3] = gradients.map(|d| self.quantize(d));
        let q = 81 * q1 + 9 * q2 + q3;
        let sign = if q < 0 { -1 } else { 1 };
        let median = if rc >= ra.max(rb) {
            ra.min(rb)
        } else if rc <= ra.min(rb) {
            ra.max(rb)
        } else {
            ra + rb - rc
        };
        let index = q.unsigned_abs() as usize;
        let Context { a, b, c, n } = self.contexts[index];
        let prediction = (median + sign * c).clamp(0, self.max_value);
        let k = golomb_parameter(n, a);
        let mapped = self.bits.golomb(k, self.limit, self.qbpp)?;
        let error = if self.near == 0 && k == 0 && 2 * b <= -n {
            if mapped % 2 == 1 { (mapped - 1) / 2 } else { -(mapped / 2) - 1 }
        } else if mapped % 2 == 0 {
            mapped / 2
        } else {
            -((mapped + 1) / 2)
        };
        self.contexts[index] = Context { a, b, c, n }.after(error, self.unit, self.reset);
        Ok(self.reconstruct(prediction, sign * error))
    }

    /// A run from `x` on and the number that ends it; returns where it goes on.
    fn run(&mut self, above: &[i32], line: &mut [i32], mut x: usize, run_index: &mut usize) -> Result<usize, String> {
        let n = line.len() - 2;
        let ra = line[x - 1];
        loop {
            let length = 1_usize << J[*run_index];
            if self.bits.take(1) == 1 {
                let count = length.min(n + 1 - x);
                line[x..x + count].fill(ra);
                x += count;
                if count == length {
                    *run_index = (*run_index + 1).min(31);
                }
                if x > n {
                    return Ok(x);
                }
            } else {
                let count = self.bits.take(J[*run_index]) as usize;
                if x + count > n {
                    return Err("its JPEG-LS data are damaged".to_owned());
                }
                line[x..x + count].fill(ra);
                x += count;
                break;
            }
            if self.bits.is_past_end() {
                return Err(ENDS_EARLY.to_owned());
            }
        }
        let rb = above[x];
        let goes_on = (ra - rb).abs() <= self.near;
        let (prediction, sign) = if goes_on { (ra, 1) } else { (rb, if ra > rb { -1 } else { 1 }) };
        let kind = i32::from(goes_on);
        let context = self.run_contexts[usize::from(goes_on)];
        let k = golomb_parameter(context.n, context.a + kind * (context.n >> 1));
        let mapped = self.bits.golomb(k, self.limit - J[*run_index] - 1, self.qbpp)?;
        let doubled = mapped + kind;
        let is_odd = doubled % 2 == 1;
        let size = (doubled + i32::from(is_odd)) / 2;
        let error = if (k != 0 || 2 * context.b >= context.n) == is_odd { -size } else { size };
        let mut next = context;
        next.b += i32::from(error < 0);
        next.a += (mapped + 1 - kind) >> 1;
        if next.n == self.reset {
            (next.a, next.b, next.n) = (next.a >> 1, next.b >> 1, next.n >> 1);
        }
        next.n += 1;
        self.run_contexts[usize::from(goes_on)] = next;
        line[x] = self.reconstruct(prediction, sign * error);
        *run_index = run_index.saturating_sub(1);
        Ok(x + 1)
    }
}

impl Context {
    /// What is known after another error (T.87, A.6).
    fn after(mut self, error: i32, unit: i32, reset: i32) -> Self {
        self.b += error * unit;
        self.a += error.abs();
        if self.n == reset {
            self.a >>= 1;
            self.b = if self.b >= 0 { self.b >> 1 } else { -((1 - self.b) >> 1) };
            self.n >>= 1;
        }
        self.n += 1;
        if self.b <= -self.n {
            self.b = (self.b + self.n).max(1 - self.n);
            self.c = (self.c - 1).max(-128);
        } else if self.b > 0 {
            self.b = (self.b - self.n).min(0);
            self.c = (self.c + 1).min(127);
        }
        self
    }
}

/// k: the smallest with n 2ᵏ ≥ a.
fn golomb_parameter(n: i32, a: i32) -> u32 {
    (0..24).find(|k| i64::from(n) << k >= i64::from(a)).unwrap_or(24)
}

/// The bits of a scan: a byte behind 0xff has only seven.
struct Bits<'a> {
    data: &'a [u8],
    at: usize,
    held: u64,
    num_held: u32,
    was_ff: bool,
    /// Bits that were asked for behind the end, which are 0.
    num_missing: u32,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.num_held <= 48 {
            let (byte, width) = match self.data.get(self.at) {
                Some(&byte) => (byte, if self.was_ff { 7 } else { 8 }),
                None => {
                    self.num_missing = self.num_missing.saturating_add(8);
                    (0, 8)
                }
            };
            self.at += 1;
            self.was_ff = byte == 0xff;
            self.held |= u64::from(byte & if width == 7 { 0x7f } else { 0xff }) << (64 - width - self.num_held);
            self.num_held += width;
        }
    }

    /// Whether bits were used that are not there; those that are held in advance do not count.
    fn is_past_end(&self) -> bool {
        self.num_missing > self.num_held + 8
    }

    fn take(&mut self, count: u32) -> u32 {
        if count == 0 {
            return 0;
        }
        if self.num_held < count {
            self.fill();
        }
        let bits = (self.held >> (64 - count)) as u32;
        self.held <<= count;
        self.num_held -= count;
        bits
    }

    /// A number in the limited Golomb code (T.87, A.5.3).
    fn golomb(&mut self, k: u32, limit: u32, qbpp: u32) -> Result<i32, String> {
        let longest = limit.saturating_sub(qbpp + 1);
        let mut zeros = 0;
        while self.take(1) == 0 {
            zeros += 1;
            if zeros > longest {
                let fault = if self.is_past_end() { ENDS_EARLY } else { "its JPEG-LS data are damaged" };
                return Err(fault.to_owned());
            }
        }
        let value = if zeros < longest {
            (u64::from(zeros) << k) | u64::from(self.take(k))
        } else {
            u64::from(self.take(qbpp)) + 1
        };
        i32::try_from(value).ok().filter(|v| *v < 1 << 24).ok_or_else(|| "its JPEG-LS data are damaged".to_owned())
    }
}
