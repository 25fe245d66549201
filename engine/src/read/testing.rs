//! Small files for the readers' tests: an asymmetric phantom in any orientation, and writers that put the fields
//! of a header one after the other as the standards list them, so that they share no offset with the readers.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};

use super::{ReadOptions, read_volume};
use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;

pub use super::stream::{ElementType, Endian};

/// Voxels of the phantom along R, A, S: all different.
pub const RAS_DIMS: [usize; 3] = [5, 4, 3];
const RAS_SPACING: [f64; 3] = [0.75, 1.5, 2.25];
const RAS_ORIGIN: [f64; 3] = [-10.0, 20.0, -30.5];

pub const ALL_TYPES: [ElementType; 10] = [
    ElementType::U8,
    ElementType::I8,
    ElementType::U16,
    ElementType::I16,
    ElementType::U32,
    ElementType::I32,
    ElementType::U64,
    ElementType::I64,
    ElementType::F32,
    ElementType::F64,
];

/// Value of the phantom at its voxel (r, a, s): different everywhere, at most 59.
pub fn phantom_value(ras: [usize; 3]) -> f64 {
    (ras[0] + 5 * ras[1] + 20 * ras[2]) as f64
}

/// The phantom stored along `letters` ("PIL": x to the back, y down, z to the left).
pub struct Phantom {
    pub dims: [usize; 3],
    pub world_from_index: DAffine3,
    /// x fastest.
    pub values: Vec<f64>,
}

impl Phantom {
    pub fn oriented(letters: &str) -> Self {
        let axes: Vec<(usize, bool)> = letters
            .chars()
            .map(|c| match c {
                'R' => (0, false),
                'L' => (0, true),
                'A' => (1, false),
                'P' => (1, true),
                'S' => (2, false),
                _ => (2, true),
            })
            .collect();
        let dims: [usize; 3] = std::array::from_fn(|i| RAS_DIMS[axes[i].0]);
        let mut columns = [DVec3::ZERO; 3];
        let mut translation = DVec3::from_array(RAS_ORIGIN);
        for (column, &(axis, is_flipped)) in columns.iter_mut().zip(&axes) {
            column[axis] = if is_flipped { -RAS_SPACING[axis] } else { RAS_SPACING[axis] };
            if is_flipped {
                translation[axis] += (RAS_DIMS[axis] - 1) as f64 * RAS_SPACING[axis];
            }
        }
        let mut values = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let mut ras = [0; 3];
                    for (index, &(axis, is_flipped)) in [x, y, z].into_iter().zip(&axes) {
                        ras[axis] = if is_flipped { RAS_DIMS[axis] - 1 - index } else { index };
                    }
                    values.push(phantom_value(ras));
                }
            }
        }
        let matrix3 = DMat3::from_cols(columns[0], columns[1], columns[2]);
        Self { dims, world_from_index: DAffine3 { matrix3, translation }, values }
    }

    /// Checks that every voxel of `volume` has the phantom's value at its place in the world.
    pub fn assert_in_world(volume: &Volume) {
        let [nx, ny, nz] = volume.grid.dims();
        assert_eq!(nx * ny * nz, 60);
        let mut sum = 0.0;
        for (x, y, z) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (x, y, z)))) {
            let world = volume.grid.world_from_index().transform_point3(DVec3::new(x as f64, y as f64, z as f64));
            let ras = (world - DVec3::from_array(RAS_ORIGIN)) / DVec3::from_array(RAS_SPACING);
            assert!((ras - ras.round()).abs().max_element() < 1e-4, "{ras}");
            let value = volume.value(x, y, z);
            assert_eq!(value, phantom_value(ras.round().as_uvec3().to_array().map(|i| i as usize)), "at {world}");
            sum += value;
        }
        assert_eq!(sum, 59.0 * 60.0 / 2.0);
    }
}

/// All 48 ways to store a volume along the axes of the world.
pub fn all_orientations() -> Vec<String> {
    let mut all = Vec::new();
    for p in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        for flips in 0..8 {
            all.push((0..3).map(|i| [["R", "L"], ["A", "P"], ["S", "I"]][p[i]][flips >> i & 1]).collect());
        }
    }
    all
}

/// Numbers as bytes of a type.
pub fn encode(values: &[f64], element: ElementType, endian: Endian) -> Vec<u8> {
    let mut bytes = Vec::new();
    for &v in values {
        let start = bytes.len();
        match element {
            ElementType::U8 => bytes.extend((v as u8).to_le_bytes()),
            ElementType::I8 => bytes.extend((v as i8).to_le_bytes()),
            ElementType::U16 => bytes.extend((v as u16).to_le_bytes()),
            ElementType::I16 => bytes.extend((v as i16).to_le_bytes()),
            ElementType::U32 => bytes.extend((v as u32).to_le_bytes()),
            ElementType::I32 => bytes.extend((v as i32).to_le_bytes()),
            ElementType::U64 => bytes.extend((v as u64).to_le_bytes()),
            ElementType::I64 => bytes.extend((v as i64).to_le_bytes()),
            ElementType::F32 => bytes.extend((v as f32).to_le_bytes()),
            ElementType::F64 => bytes.extend(v.to_le_bytes()),
        }
        if endian == Endian::Big {
            bytes[start..].reverse();
        }
    }
    bytes
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A NIfTI file field by field.
#[derive(Clone)]
pub struct NiftiFile {
    pub version: u8,
    pub endian: Endian,
    pub dim: [i64; 8],
    pub datatype: i16,
    pub pixdim: [f64; 8],
    pub vox_offset: f64,
    pub slope: f64,
    pub inter: f64,
    pub units: u8,
    pub qform_code: i16,
    pub sform_code: i16,
    pub quatern: [f64; 3],
    pub qoffset: [f64; 3],
    pub srow: [[f64; 4]; 3],
    pub magic: [u8; 4],
    pub voxels: Vec<u8>,
}

impl NiftiFile {
    /// The phantom with an sform.
    pub fn new(version: u8, phantom: &Phantom, element: ElementType, endian: Endian) -> Self {
        let [x, y, z] = phantom.dims.map(|n| n as i64);
        let m = phantom.world_from_index;
        let datatype = match element {
            ElementType::U8 => 2,
            ElementType::I16 => 4,
            ElementType::I32 => 8,
            ElementType::F32 => 16,
            ElementType::F64 => 64,
            ElementType::I8 => 256,
            ElementType::U16 => 512,
            ElementType::U32 => 768,
            ElementType::I64 => 1024,
            ElementType::U64 => 1280,
        };
        Self {
            version,
            endian,
            dim: [3, x, y, z, 1, 1, 1, 1],
            datatype,
            pixdim: [1.0; 8],
            vox_offset: if version == 1 { 352.0 } else { 544.0 },
            slope: 0.0,
            inter: 0.0,
            units: 2,
            qform_code: 0,
            sform_code: 1,
            quatern: [0.0; 3],
            qoffset: [0.0; 3],
            srow: std::array::from_fn(|r| {
                [m.matrix3.row(r).x, m.matrix3.row(r).y, m.matrix3.row(r).z, m.translation[r]]
            }),
            magic: [b'n', b'+', b'0' + version, 0],
            voxels: encode(&phantom.values, element, endian),
        }
    }

    /// Moves the affine from the sform to the qform.
    pub fn with_qform(mut self, world_from_index: DAffine3) -> Self {
        let m = world_from_index.matrix3;
        let spacing = [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()];
        let qfac = m.determinant().signum();
        let rotation = DMat3::from_cols(m.x_axis / spacing[0], m.y_axis / spacing[1], m.z_axis / spacing[2] * qfac);
        let q = glam::DQuat::from_mat3(&rotation);
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        self.quatern = [q.x * sign, q.y * sign, q.z * sign];
        self.qoffset = world_from_index.translation.to_array();
        self.pixdim = [qfac, spacing[0], spacing[1], spacing[2], 1.0, 1.0, 1.0, 1.0];
        (self.qform_code, self.sform_code) = (1, 0);
        self
    }

    pub fn header(&self) -> Vec<u8> {
        let mut w = FieldWriter { bytes: Vec::new(), endian: self.endian, is_wide: self.version == 2 };
        let srow = self.srow.concat();
        if self.version == 1 {
            w.int32(348);
            w.zeros(10 + 18 + 4 + 2 + 1 + 1);
            w.sizes(&self.dim);
            w.zeros(12 + 2);
            w.int16(self.datatype);
            w.int16(0);
            w.zeros(2);
            w.reals(&self.pixdim);
            w.reals(&[self.vox_offset, self.slope, self.inter]);
            w.zeros(2 + 1);
            w.bytes.push(self.units);
            w.zeros(16 + 8 + 80 + 24);
            w.int16(self.qform_code);
            w.int16(self.sform_code);
            w.reals(&self.quatern);
            w.reals(&self.qoffset);
            w.reals(&srow);
            w.zeros(16);
            w.bytes.extend(self.magic);
            assert_eq!(w.bytes.len(), 348);
        } else {
            w.int32(540);
            w.bytes.extend(self.magic);
            w.bytes.extend(b"\r\n\x1a\n");
            w.int16(self.datatype);
            w.int16(0);
            w.sizes(&self.dim);
            w.zeros(24);
            w.reals(&self.pixdim);
            w.sizes(&[self.vox_offset as i64]);
            w.reals(&[self.slope, self.inter]);
            w.zeros(32 + 16 + 80 + 24);
            w.int32(i32::from(self.qform_code));
            w.int32(i32::from(self.sform_code));
            w.reals(&self.quatern);
            w.reals(&self.qoffset);
            w.reals(&srow);
            w.zeros(4);
            w.int32(i32::from(self.units));
            w.zeros(4 + 16 + 1 + 15);
            assert_eq!(w.bytes.len(), 540);
        }
        w.bytes
    }

    /// Header, four bytes for "no extension", voxels.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = self.header();
        bytes.extend([0; 4]);
        if self.vox_offset.is_finite() && self.vox_offset > bytes.len() as f64 {
            bytes.resize(self.vox_offset as usize, 0xee);
        }
        bytes.extend(&self.voxels);
        bytes
    }
}

struct FieldWriter {
    bytes: Vec<u8>,
    endian: Endian,
    is_wide: bool,
}

impl FieldWriter {
    fn put<const N: usize>(&mut self, mut little: [u8; N]) {
        if self.endian == Endian::Big {
            little.reverse();
        }
        self.bytes.extend(little);
    }
    fn zeros(&mut self, n: usize) {
        self.bytes.resize(self.bytes.len() + n, 0);
    }
    fn int16(&mut self, v: i16) {
        self.put(v.to_le_bytes());
    }
    fn int32(&mut self, v: i32) {
        self.put(v.to_le_bytes());
    }
    fn sizes(&mut self, values: &[i64]) {
        for v in values {
            if self.is_wide { self.put(v.to_le_bytes()) } else { self.put((*v as i16).to_le_bytes()) }
        }
    }
    fn reals(&mut self, values: &[f64]) {
        for v in values {
            if self.is_wide { self.put(v.to_le_bytes()) } else { self.put((*v as f32).to_le_bytes()) }
        }
    }
}

/// A folder for the files of one test.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// Writes and reads a file.
    pub fn read(&self, name: &str, bytes: &[u8]) -> Result<Volume> {
        read(&self.write(name, bytes))
    }

    /// The sentence with which a file is refused, which must be one and name the file.
    pub fn refusal(&self, name: &str, bytes: &[u8]) -> String {
        let sentence = self.read(name, bytes).expect_err(name).to_string();
        assert!(sentence.contains("; ") && sentence.contains('('), "no remedy or no path: {sentence}");
        sentence
    }
}

pub fn read(path: &Path) -> Result<Volume> {
    read_volume(path, &ReadOptions::default(), &Progress::new())
}

pub fn read_frame(path: &Path, frame: usize) -> Result<Volume> {
    read_volume(path, &ReadOptions { frame, ..ReadOptions::default() }, &Progress::new())
}

/// Reads every truncation of a file and every change of one byte of its first `num_bytes`: none may panic, or take
/// the memory that a changed size asks for.
pub fn torture(name: &str, bytes: &[u8], num_bytes: usize) {
    let folder = Folder::new();
    for length in 0..bytes.len() {
        let path = folder.write(name, &bytes[..length]);
        assert!(read(&path).is_err() || length + 64 > bytes.len(), "truncated to {length} bytes");
    }
    let mut changed = bytes.to_vec();
    for i in 0..num_bytes.min(bytes.len()) {
        for value in [0x00, 0x01, 0x20, 0x7f, 0x80, 0xff] {
            changed[i] = value;
            let path = folder.write(name, &changed);
            if let Ok(volume) = read(&path) {
                assert_eq!(volume.voxels.len(), volume.grid.num_voxels());
                assert!(volume.num_bytes() < 1 << 20);
            }
        }
        changed[i] = bytes[i];
    }
}
