//! NIfTI-1 and NIfTI-2: `.nii`, `.nii.gz` and the pair `.hdr` + `.img`; and Analyze 7.5, the pair that NIfTI grew out of.
//!
//! The header is parsed by hand from one offset table per version. The world comes from the sform, else the
//! qform, else the voxel sizes; NIfTI's world is RAS already. Standard: nifti1.h and nifti2.h (nifti.nimh.nih.gov).
//! Analyze has no world: x is taken as left, as SPM does, and its `originator`, if it is a voxel, as the origin.

mod labels;

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};

use super::stream::{self, ByteSource, ElementType, Endian, Magnitudes, VoxelRequest};
use super::window::Averaging;
use super::{
    Entry, ReadOptions, VolumeReader, absurd_size, check_frame, color_volume_of, grid_of, numbers_as_labels, volume_of,
};
use crate::error::{Error, Result, remedies};
use crate::progress::Progress;
use crate::spaces::Grid;
use crate::volume::labels::{LabelMap, LabelTable};
use crate::volume::{Modality, Orientation, Rescale, Volume};

/// Reads NIfTI-1, NIfTI-2 and NIfTI pairs.
pub struct NiftiReader;

impl VolumeReader for NiftiReader {
    fn name(&self) -> &'static str {
        "NIfTI"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["nii", "hdr", "img"]
    }

    fn recognizes(&self, _path: &Path, head: &[u8]) -> bool {
        Layout::find(head).is_some() || is_analyze(head)
    }

    fn survey(&self, path: &Path, _options: &ReadOptions, _progress: &Progress) -> Result<Vec<Entry>> {
        Ok(vec![Opened::open(path)?.entry])
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        Opened::open(path)?.read(path, options, progress)
    }

    fn read_labels(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<LabelMap>> {
        let mut layers = numbers_as_labels(self, path, options, progress)?;
        if let Some(table) = Opened::open(path)?.label_table {
            // What the file's own table lacks has a number and is no news.
            layers.iter_mut().for_each(|layer| drop(layer.name_by(&table)));
        }
        Ok(layers)
    }
}

/// What a voxel is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Number(ElementType),
    /// Real and imaginary part.
    Complex(ElementType),
    /// So many bytes, 3 or 4.
    Color(usize),
}

impl Content {
    /// The type of its parts and how many there are.
    fn parts(self) -> (ElementType, usize) {
        match self {
            Self::Number(element) => (element, 1),
            Self::Complex(element) => (element, 2),
            Self::Color(n) => (ElementType::U8, n),
        }
    }
}

/// A file whose header is understood and whose voxels are there as far as the file's size tells.
struct Opened {
    header: Header,
    entry: Entry,
    content: Content,
    data_path: PathBuf,
    data_start: u64,
    /// The data file from its beginning.
    source: ByteSource,
    warnings: Vec<String>,
    rescale: Rescale,
    /// Names and colors of a label map.
    label_table: Option<LabelTable>,
}

impl Opened {
    fn open(path: &Path) -> Result<Self> {
        // Of a pair, the voxels may be named as well as the header.
        let header_path = match sibling(path, "img", "hdr") {
            Sibling::Is(header) => header,
            Sibling::Missing(header) => return Err(missing_partner(path, &header)),
            Sibling::NotOfAPair => path.to_owned(),
        };
        let mut source = ByteSource::open(&header_path)?;
        let head = source.read_up_to(Layout::V2.num_bytes)?;
        let header = Header::parse(&header_path, &head)?;

        let (data_path, data_start) = if header.is_pair {
            match sibling(&header_path, "hdr", "img") {
                Sibling::Is(image) => (image, header.data_start(path, 0)?),
                Sibling::Missing(image) => return Err(missing_partner(path, &image)),
                Sibling::NotOfAPair => {
                    return Err(Error::file(
                        path,
                        "the header says that the voxels are in an .img file, but it is not named .hdr",
                        "rename it to .hdr beside its .img",
                    ));
                }
            }
        } else {
            (header_path, header.data_start(path, header.layout.num_bytes as u64)?)
        };
        let mut warnings = Vec::new();
        let shape = header.shape(path, &mut warnings)?;
        let content = header.content(path)?;
        let (element, num_parts) = content.parts();
        if let Content::Complex(_) = content {
            warnings.push("The voxels are complex numbers, of which the magnitude is shown.".to_owned());
        }
        let (world_from_index, orientation) = header.world_from_index(path, shape.dims, &mut warnings)?;
        let rescale = match (content, header.rescale(&mut warnings)) {
            (Content::Number(_), rescale) => rescale,
            // Both parts of a number times the slope; a sum with an intercept has no meaning.
            (Content::Complex(_), rescale) => Rescale { slope: rescale.slope.abs(), intercept: 0.0 },
            (Content::Color(_), _) => Rescale::IDENTITY,
        };

        let [x, y, z] = shape.dims;
        let all = [x, y, z, shape.num_frames, num_parts as u64];
        let absurd = || absurd_size(path, &all);
        let end = stream::size_bytes(&all, element).and_then(|n| n.checked_add(data_start)).ok_or_else(absurd)?;
        let source = ByteSource::open(&data_path)?;
        source.check_holds(end)?;
        let label_table = labels::table(&data_path, &header, data_start);
        let entry = Entry {
            key: String::new(),
            title: String::new(),
            format: header.format().to_owned(),
            modality: Modality::Unknown,
            grid: grid_of(path, shape.dims, world_from_index)?,
            orientation,
            type_name: match content {
                Content::Color(3) => "rgb",
                Content::Color(_) => "rgba",
                _ => element.name(),
            },
            bytes_per_voxel: if matches!(content, Content::Color(_)) { 6 } else { element.num_bytes() },
            num_frames: usize::try_from(shape.num_frames).unwrap_or(usize::MAX),
            num_files: 1 + usize::from(header.is_pair),
            is_labels: matches!(content, Content::Number(_))
                && (label_table.is_some() || labels::is_intent(&header, &head)),
            is_localizer: false,
        };
        Ok(Self { header, entry, content, data_path, data_start, source, warnings, rescale, label_table })
    }

    fn read(self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        let Self { header, entry, content, data_path, data_start, mut source, warnings, rescale, .. } = self;
        check_frame(path, options.frame, entry.num_frames)?;
        let window = options.window.on(path, entry.grid.dims())?;
        let (element, num_parts) = content.parts();
        let frame_bytes = (entry.grid.num_voxels() * element.num_bytes() * num_parts) as u64;
        let frame_start = data_start + options.frame as u64 * frame_bytes;
        progress.begin("reading", frame_start + frame_bytes);
        source.skip(frame_start, progress)?;
        let endian = header.endian;
        let averaging = if entry.is_labels { Averaging::Nearest } else { Averaging::Mean };
        let request = VoxelRequest { element, endian, window, averaging, is_size_checked: !source.is_gzip() };
        if let Content::Color(num_channels) = content {
            let colors = stream::read_colors(&mut source, num_channels, window, &data_path, progress)?;
            source.finish(progress)?;
            return color_volume_of(path, &entry, window, colors, warnings);
        }
        let voxels = if let Content::Complex(_) = content {
            let mut magnitudes = Magnitudes::new(&mut source, element, endian);
            let request = VoxelRequest { endian: Endian::NATIVE, ..request };
            stream::read_voxels(&mut magnitudes, request, &data_path, progress)?
        } else {
            stream::read_voxels(&mut source, request, &data_path, progress)?
        };
        source.finish(progress)?;
        volume_of(path, &entry, window, voxels, rescale, warnings)
    }
}

/// Where the fields of a header version lie, in bytes, and how wide the version's numbers are.
#[derive(Debug, PartialEq)]
struct Layout {
    version: u8,
    num_bytes: usize,
    magic: usize,
    dim: usize,
    datatype: usize,
    pixdim: usize,
    vox_offset: usize,
    scl_slope: usize,
    scl_inter: usize,
    xyzt_units: usize,
    qform_code: usize,
    sform_code: usize,
    quatern: usize,
    qoffset: usize,
    srow: usize,
}

impl Layout {
    const V1: Self = Self {
        version: 1,
        num_bytes: 348,
        magic: 344,
        dim: 40,
        datatype: 70,
        pixdim: 76,
        vox_offset: 108,
        scl_slope: 112,
        scl_inter: 116,
        xyzt_units: 123,
        qform_code: 252,
        sform_code: 254,
        quatern: 256,
        qoffset: 268,
        srow: 280,
    };
    const V2: Self = Self {
        version: 2,
        num_bytes: 540,
        magic: 4,
        dim: 16,
        datatype: 12,
        pixdim: 104,
        vox_offset: 168,
        scl_slope: 176,
        scl_inter: 184,
        xyzt_units: 500,
        qform_code: 344,
        sform_code: 348,
        quatern: 352,
        qoffset: 376,
        srow: 400,
    };

    /// The version whose magic the bytes carry, and whether it is the magic of a pair.
    fn find(head: &[u8]) -> Option<(&'static Self, bool)> {
        for layout in [&Self::V1, &Self::V2] {
            let digit = b'0' + layout.version;
            match head.get(layout.magic..layout.magic + 4) {
                Some([b'n', b'+', d, 0]) if *d == digit => return Some((layout, false)),
                Some([b'n', b'i', d, 0]) if *d == digit => return Some((layout, true)),
                _ => {}
            }
        }
        None
    }
}

/// Whether the bytes are a header of the format before NIfTI: its size, but no magic.
fn is_analyze(head: &[u8]) -> bool {
    let size = head.get(..4).and_then(|b| b.try_into().ok()).map(i32::from_le_bytes);
    Layout::find(head).is_none() && head.len() >= 348 && size.is_some_and(|s| s == 348 || s.swap_bytes() == 348)
}

/// The fields that matter, as f64 and i64 whatever the version and byte order.
#[derive(Debug)]
struct Header {
    layout: &'static Layout,
    is_pair: bool,
    /// The format before NIfTI; what stands at the places of NIfTI's own fields is something else.
    analyze: Option<Analyze>,
    endian: Endian,
    dim: [i64; 8],
    datatype: i64,
    pixdim: [f64; 8],
    vox_offset: f64,
    scl_slope: f64,
    scl_inter: f64,
    xyzt_units: i64,
    qform_code: i64,
    sform_code: i64,
    quatern: DVec3,
    qoffset: DVec3,
    srow: [[f64; 4]; 3],
}

/// What Analyze 7.5 has in place of a world.
#[derive(Debug)]
struct Analyze {
    /// Which way its slices run, 0 as SPM takes all of them.
    orient: u8,
    /// SPM's origin, a voxel counted from 1.
    originator: [i64; 3],
}

/// Numbers out of a header that is known to be long enough.
struct Fields<'a> {
    bytes: &'a [u8],
    endian: Endian,
    is_wide: bool,
}

impl Fields<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut bytes: [u8; N] = std::array::from_fn(|i| self.bytes.get(at + i).copied().unwrap_or(0));
        if self.endian == Endian::Big {
            bytes.reverse();
        }
        bytes
    }

    fn i16(&self, at: usize) -> i64 {
        i64::from(i16::from_le_bytes(self.bytes(at)))
    }

    /// A code: 16 bits in version 1, 32 in version 2.
    fn code(&self, at: usize) -> i64 {
        if self.is_wide { i64::from(i32::from_le_bytes(self.bytes(at))) } else { self.i16(at) }
    }

    /// A size: 16 bits in version 1, 64 in version 2; the `i`-th of an array.
    fn size(&self, at: usize, i: usize) -> i64 {
        if self.is_wide { i64::from_le_bytes(self.bytes(at + 8 * i)) } else { self.i16(at + 2 * i) }
    }

    /// A real number: 32 bits in version 1, 64 in version 2; the `i`-th of an array.
    fn real(&self, at: usize, i: usize) -> f64 {
        if self.is_wide {
            f64::from_le_bytes(self.bytes(at + 8 * i))
        } else {
            f64::from(f32::from_le_bytes(self.bytes(at + 4 * i)))
        }
    }

    fn vector(&self, at: usize) -> DVec3 {
        DVec3::new(self.real(at, 0), self.real(at, 1), self.real(at, 2))
    }
}

/// Size of one frame and how many there are.
struct Shape {
    dims: [u64; 3],
    num_frames: u64,
}

impl Header {
    fn parse(path: &Path, head: &[u8]) -> Result<Self> {
        let is_analyze = is_analyze(head);
        let Some((layout, is_pair)) = Layout::find(head).or(is_analyze.then_some((&Layout::V1, true))) else {
            return Err(if head.len() < Layout::V1.num_bytes {
                Error::file(
                    path,
                    format!("the file ends after {} of the 348 bytes of a NIfTI header", head.len()),
                    "copy or download it again",
                )
            } else {
                Error::file(
                    path,
                    "this is no NIfTI file: neither a NIfTI-1 nor a NIfTI-2 header begins it",
                    remedies::DESCRIBE_VOXELS,
                )
            });
        };
        if head.len() < layout.num_bytes {
            return Err(Error::file(
                path,
                format!("the file ends after {} of the {} bytes of its header", head.len(), layout.num_bytes),
                "copy or download it again",
            ));
        }
        let is_wide = layout.version == 2;
        let fields = |endian| Fields { bytes: head, endian, is_wide };
        // The size of the header tells the byte order; writers that leave it out still have 1 to 7 dimensions.
        let size = |endian| i64::from(i32::from_le_bytes(fields(endian).bytes(0)));
        let num_dims = |endian| fields(endian).size(layout.dim, 0);
        let expected = layout.num_bytes as i64;
        let endian = if size(Endian::Little) == expected {
            Endian::Little
        } else if size(Endian::Big) == expected {
            Endian::Big
        } else if (1..=7).contains(&num_dims(Endian::Little)) {
            Endian::Little
        } else {
            Endian::Big
        };
        let f = fields(endian);
        Ok(Self {
            layout,
            is_pair,
            analyze: is_analyze
                .then(|| Analyze { orient: head[252], originator: std::array::from_fn(|i| f.i16(253 + 2 * i)) }),
            endian,
            dim: std::array::from_fn(|i| f.size(layout.dim, i)),
            datatype: f.i16(layout.datatype),
            pixdim: std::array::from_fn(|i| f.real(layout.pixdim, i)),
            vox_offset: if is_wide { f.size(layout.vox_offset, 0) as f64 } else { f.real(layout.vox_offset, 0) },
            scl_slope: f.real(layout.scl_slope, 0),
            scl_inter: f.real(layout.scl_inter, 0),
            xyzt_units: if is_wide { f.code(layout.xyzt_units) } else { i64::from(head[layout.xyzt_units]) },
            qform_code: f.code(layout.qform_code),
            sform_code: f.code(layout.sform_code),
            quatern: f.vector(layout.quatern),
            qoffset: f.vector(layout.qoffset),
            srow: std::array::from_fn(|row| std::array::from_fn(|i| f.real(layout.srow, 4 * row + i))),
        })
    }

    fn format(&self) -> &'static str {
        if self.analyze.is_some() {
            return "Analyze 7.5";
        }
        match (self.layout.version, self.is_pair) {
            (1, false) => "NIfTI-1",
            (1, true) => "NIfTI-1 pair",
            (_, false) => "NIfTI-2",
            (_, true) => "NIfTI-2 pair",
        }
    }

    /// Byte of the first voxel in the data file, not before `min`.
    fn data_start(&self, path: &Path, min: u64) -> Result<u64> {
        let offset = self.vox_offset;
        // Some writers leave the offset of a single file 0 and mean the usual place: header, 4 bytes, voxels.
        if offset == 0.0 && min > 0 {
            return Ok(min + 4);
        }
        if !(offset >= min as f64 && offset < 9e18 && offset.fract() == 0.0) {
            return Err(Error::file(
                path,
                format!("the header puts the voxels at byte {offset}, where they cannot be"),
                "correct vox_offset with the program that wrote the file",
            ));
        }
        Ok(offset as u64)
    }

    fn shape(&self, path: &Path, warnings: &mut Vec<String>) -> Result<Shape> {
        let num_dims = self.dim[0];
        if !(1..=7).contains(&num_dims) {
            return Err(Error::file(
                path,
                format!("the header promises {num_dims} dimensions, where NIfTI has 1 to 7"),
                "the header is damaged: copy or download it again",
            ));
        }
        let mut dims = [1_u64; 7];
        for (i, n) in dims.iter_mut().enumerate().take(num_dims as usize) {
            let stored = self.dim[i + 1];
            // Writers leave 0 for further dimensions that they do not use, but never for x, y, z.
            *n = if stored == 0 && i > 2 { 1 } else { u64::try_from(stored).unwrap_or(0) };
            if *n == 0 {
                return Err(Error::file(
                    path,
                    format!("the header gives {stored} voxels for dimension {}", i + 1),
                    "the header is damaged: copy or download it again",
                ));
            }
        }
        let [x, y, z, frames @ ..] = dims;
        let num_frames = frames.iter().try_fold(1_u64, |n, &f| n.checked_mul(f));
        let num_frames = num_frames.ok_or_else(|| absurd_size(path, &dims))?;
        let mut dims = [x, y, z];
        // FreeSurfer's surface values do not fit 16 bits on one axis, so it writes them under these sizes.
        if dims == [27307, 1, 6] {
            dims = [163_842, 1, 1];
            warnings.push("The file holds values of a FreeSurfer surface, a row of vertices, not a volume.".to_owned());
        }
        Ok(Shape { dims, num_frames })
    }

    fn content(&self, path: &Path) -> Result<Content> {
        let element = match self.datatype {
            2 => ElementType::U8,
            4 => ElementType::I16,
            8 => ElementType::I32,
            16 => ElementType::F32,
            64 => ElementType::F64,
            256 => ElementType::I8,
            512 => ElementType::U16,
            768 => ElementType::U32,
            1024 => ElementType::I64,
            1280 => ElementType::U64,
            // SPM's additions to Analyze.
            130 if self.analyze.is_some() => ElementType::I8,
            132 if self.analyze.is_some() => ElementType::U16,
            136 if self.analyze.is_some() => ElementType::U32,
            32 => return Ok(Content::Complex(ElementType::F32)),
            1792 => return Ok(Content::Complex(ElementType::F64)),
            // Whether colors of Analyze lie pixel by pixel or plane by plane, its writers never agreed on.
            128 if self.analyze.is_none() => return Ok(Content::Color(3)),
            2304 if self.analyze.is_none() => return Ok(Content::Color(4)),
            other => {
                let (name, remedy) = match other {
                    1 => ("single bits", "convert it to uint8"),
                    128 => ("colors in Analyze 7.5", "convert it to NIfTI"),
                    1536 => ("128-bit floating-point numbers", "convert it to float64"),
                    2048 => ("complex256 numbers", "save the magnitude as float64"),
                    _ => ("", "convert it to one of NIfTI's integer or floating-point types"),
                };
                let what = if name.is_empty() {
                    format!("the voxel type {other} is none that NIfTI defines")
                } else {
                    format!("the voxels are {name} (NIfTI type {other}), which Fabrica does not render")
                };
                return Err(Error::file(path, what, remedy));
            }
        };
        Ok(Content::Number(element))
    }

    fn rescale(&self, warnings: &mut Vec<String>) -> Rescale {
        let (slope, mut intercept) = (self.scl_slope, self.scl_inter);
        if self.analyze.is_some() {
            // Here SPM keeps a slope, others nothing or anything.
            intercept = 0.0;
            if slope.is_finite() && slope != 0.0 && slope != 1.0 {
                warnings.push(format!("Values are rescaled by {slope}, where SPM keeps the slope of an Analyze file."));
            }
        }
        if slope == 0.0 {
            return Rescale::IDENTITY;
        }
        if !(slope.is_finite() && intercept.is_finite()) {
            warnings.push(format!(
                "The header rescales values by slope {slope} and intercept {intercept}; the stored numbers are used."
            ));
            return Rescale::IDENTITY;
        }
        Rescale { slope, intercept }
    }

    /// Millimeters of the header's unit of length.
    fn mm_per_unit(&self, warnings: &mut Vec<String>) -> f64 {
        match self.xyzt_units & 7 {
            1 => 1000.0,
            0 | 2 => 1.0,
            3 => 1e-3,
            other => {
                warnings.push(format!("The header's unit of length has the unknown code {other}; mm are assumed."));
                1.0
            }
        }
    }

    fn world_from_index(
        &self,
        path: &Path,
        dims: [u64; 3],
        warnings: &mut Vec<String>,
    ) -> Result<(DAffine3, Orientation)> {
        if let Some(analyze) = &self.analyze {
            return self.analyze_world(path, analyze, dims, warnings);
        }
        let mm = self.mm_per_unit(warnings);
        let scaled = |a: DAffine3| DAffine3 { matrix3: a.matrix3 * mm, translation: a.translation * mm };
        let qform = (self.qform_code > 0).then(|| self.qform());
        if self.sform_code > 0 {
            let sform = scaled(self.sform());
            // A code without a matrix (all zeros) happens; the qform is the better word then.
            if Grid::new([1; 3], sform).is_ok() {
                if let Some(difference_mm) = qform.and_then(|q| visible_difference_mm(sform, scaled(q?), dims)) {
                    warnings.push(format!(
                        "The header places the volume twice, and sform and qform differ by up to {difference_mm:.1} mm; \
                         the sform is used."
                    ));
                }
                return Ok((sform, Orientation::Stated));
            }
            if qform.is_none() {
                return Err(Error::file(
                    path,
                    "the sform matrix of the header is singular or not finite, and there is no qform",
                    "correct the header with the program that wrote it",
                ));
            }
            warnings.push("The sform matrix of the header is unusable; the qform is used.".to_owned());
        }
        let spacing = self.spacing(path, warnings)?;
        if let Some(qform) = qform {
            return qform.map(|q| (scaled(q), Orientation::Stated)).ok_or_else(|| {
                Error::file(
                    path,
                    "the qform of the header is not finite",
                    "correct the header with the program that wrote it",
                )
            });
        }
        // Programs agree on x to the left here, the storage order of Analyze (SPM, FSL, nibabel), but not on more.
        let assumed = "The header has neither sform nor qform: x is taken as left, and left and right may be swapped.";
        let steps = DVec3::new(-spacing.x, spacing.y, spacing.z);
        let center = DVec3::from_array(dims.map(|n| (n - 1) as f64 / 2.0)) * steps;
        let world = scaled(DAffine3 { matrix3: DMat3::from_diagonal(steps), translation: -center });
        Ok((world, Orientation::Assumed(assumed.to_owned())))
    }

    fn analyze_world(
        &self,
        path: &Path,
        analyze: &Analyze,
        dims: [u64; 3],
        warnings: &mut Vec<String>,
    ) -> Result<(DAffine3, Orientation)> {
        let spacing = self.spacing(path, warnings)?;
        let assumed = "Analyze 7.5 does not tell left from right: x is taken as left, as SPM does, so left and right may be swapped.";
        if analyze.orient != 0 {
            let code = analyze.orient;
            warnings
                .push(format!("The header gives the slice direction {code}, which is ignored, as most programs do."));
        }
        let steps = DVec3::new(-spacing.x, spacing.y, spacing.z);
        let is_voxel = (0..3).all(|i| u64::try_from(analyze.originator[i]).is_ok_and(|o| (1..=dims[i]).contains(&o)));
        let origin = if is_voxel {
            DVec3::from_array(analyze.originator.map(|o| (o - 1) as f64))
        } else {
            DVec3::from_array(dims.map(|n| (n - 1) as f64 / 2.0))
        };
        let world = DAffine3 { matrix3: DMat3::from_diagonal(steps), translation: -(origin * steps) };
        Ok((world, Orientation::Assumed(assumed.to_owned())))
    }

    fn sform(&self) -> DAffine3 {
        let row = |i: usize| DVec3::new(self.srow[i][0], self.srow[i][1], self.srow[i][2]);
        DAffine3 {
            matrix3: DMat3::from_cols(row(0), row(1), row(2)).transpose(),
            translation: DVec3::new(self.srow[0][3], self.srow[1][3], self.srow[2][3]),
        }
    }

    /// The rotation by a quaternion (its real part is left out of the file), voxel sizes, and z mirrored if
    /// `pixdim[0]` is negative; `None` if it is not finite.
    fn qform(&self) -> Option<DAffine3> {
        let v = self.quatern;
        let rest = 1.0 - v.length_squared();
        // Rounding makes the vector of a half turn a little too long: nifti1.h normalizes it and takes 0.
        let (a, v) = if rest < 1e-7 { (0.0, v.normalize_or_zero()) } else { (rest.sqrt(), v) };
        let [b, c, d] = v.to_array();
        let rotation_rows = DMat3::from_cols(
            DVec3::new(a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)),
            DVec3::new(2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)),
            DVec3::new(2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - b * b - c * c),
        );
        let qfac = if self.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
        let [x, y, z] = [1, 2, 3].map(|i| if self.pixdim[i] == 0.0 { 1.0 } else { self.pixdim[i].abs() });
        let steps = DMat3::from_diagonal(DVec3::new(x, y, z * qfac));
        let qform = DAffine3 { matrix3: rotation_rows.transpose() * steps, translation: self.qoffset };
        (v.is_finite() && qform.is_finite()).then_some(qform)
    }

    /// Voxel sizes, where the world hangs on them: 0 becomes 1 and a sign is dropped, as other programs do.
    fn spacing(&self, path: &Path, warnings: &mut Vec<String>) -> Result<DVec3> {
        let stored = DVec3::new(self.pixdim[1], self.pixdim[2], self.pixdim[3]);
        if !stored.is_finite() {
            return Err(Error::file(
                path,
                "the voxel size in the header is not a finite number",
                "correct pixdim with the program that wrote the file",
            ));
        }
        let spacing = stored.to_array().map(|s| if s == 0.0 { 1.0 } else { s.abs() });
        let num_dims = usize::try_from(self.dim[0]).unwrap_or(0).min(3);
        if stored.to_array()[..num_dims].contains(&0.0) {
            warnings.push("The header gives a voxel size of 0; 1 mm is assumed.".to_owned());
        }
        if stored.min_element() < 0.0 {
            warnings.push("The header gives a negative voxel size; its sign is ignored.".to_owned());
        }
        Ok(DVec3::from_array(spacing))
    }
}

/// How far the two affines place a corner voxel apart, if that is more than half of the smallest voxel edge.
fn visible_difference_mm(a: DAffine3, b: DAffine3, dims: [u64; 3]) -> Option<f64> {
    let last = dims.map(|n| (n - 1) as f64);
    let corners = (0..8).map(|i| DVec3::from_array(std::array::from_fn(|axis| f64::from(i >> axis & 1) * last[axis])));
    let difference = corners.map(|c| a.transform_point3(c).distance(b.transform_point3(c))).fold(0.0, f64::max);
    let m = a.matrix3;
    let edge = m.x_axis.length().min(m.y_axis.length()).min(m.z_axis.length());
    (difference > 0.5 * edge).then_some(difference)
}

enum Sibling {
    /// The path is not named like this half of a pair.
    NotOfAPair,
    /// The other half, which exists.
    Is(PathBuf),
    /// The name that the other half should have.
    Missing(PathBuf),
}

/// The other half of a pair: `name.hdr` for `name.img`, also with `.gz`.
fn sibling(path: &Path, own: &str, other: &str) -> Sibling {
    let is = |p: &Path, e: &str| p.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
    let plain = if is(path, "gz") { path.with_extension("") } else { path.to_owned() };
    if !is(&plain, own) {
        return Sibling::NotOfAPair;
    }
    let expected = plain.with_extension(other);
    let names = [other.to_owned(), format!("{other}.gz"), other.to_uppercase()];
    names.iter().map(|e| plain.with_extension(e)).find(|p| p.is_file()).map_or(Sibling::Missing(expected), Sibling::Is)
}

fn missing_partner(path: &Path, missing: &Path) -> Error {
    let name = missing.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Error::file(path, format!("the other half of this pair, {name}, is missing"), "put both files into one folder")
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        ALL_TYPES, Folder, NiftiFile, Phantom, all_orientations, encode, gzip, read, read_frame, torture,
    };
    use super::*;
    use crate::volume::Voxels;

    fn plain(letters: &str) -> NiftiFile {
        NiftiFile::new(1, &Phantom::oriented(letters), ElementType::U8, Endian::Little)
    }

    #[test]
    fn every_orientation_by_sform_and_by_qform() {
        let folder = Folder::new();
        for letters in all_orientations() {
            let phantom = Phantom::oriented(&letters);
            for version in [1, 2] {
                let file = NiftiFile::new(version, &phantom, ElementType::I16, Endian::Little);
                for file in [file.clone(), file.with_qform(phantom.world_from_index)] {
                    let volume = folder.read("a.nii", &file.bytes()).unwrap();
                    assert_eq!(volume.grid.orientation_letters(), letters);
                    assert_eq!(volume.warnings, Vec::<String>::new());
                    Phantom::assert_in_world(&volume);
                }
            }
        }
    }

    #[test]
    fn every_type_version_and_byte_order() {
        let folder = Folder::new();
        let phantom = Phantom::oriented("PIR");
        for element in ALL_TYPES {
            for (version, endian) in [(1, Endian::Little), (1, Endian::Big), (2, Endian::Little), (2, Endian::Big)] {
                let bytes = NiftiFile::new(version, &phantom, element, endian).bytes();
                for bytes in [gzip(&bytes), bytes] {
                    let volume = folder.read("a.nii", &bytes).unwrap();
                    Phantom::assert_in_world(&volume);
                    assert_eq!(volume.voxels.bytes_per_voxel(), element.num_bytes());
                    assert_eq!(volume.format, format!("NIfTI-{version}"));
                }
            }
        }
        let negative = NiftiFile {
            voxels: encode(&[-5.0; 60], ElementType::I16, Endian::Big),
            ..NiftiFile::new(1, &phantom, ElementType::I16, Endian::Big)
        };
        assert_eq!(folder.read("a.nii", &negative.bytes()).unwrap().voxels, Voxels::I16(vec![-5; 60]));
    }

    #[test]
    fn an_oblique_sheared_matrix_is_kept() {
        let mut file = plain("RAS");
        file.srow = [[0.9, 0.1, 0.0, -1.0], [-0.1, 0.9, 0.5, 2.0], [0.0, 0.0, 3.0, 3.0]];
        let grid = Folder::new().read("a.nii", &file.bytes()).unwrap().grid;
        let p = grid.world_from_index().transform_point3(DVec3::new(1.0, 2.0, 3.0));
        assert!((p - DVec3::new(0.1, 5.2, 12.0)).length() < 1e-6, "{p}");
    }

    #[test]
    fn sform_before_qform_with_a_warning_where_they_differ() {
        let folder = Folder::new();
        let phantom = Phantom::oriented("LPS");
        let mut file = plain("LPS");
        let with_qform = |shift_mm: f64| {
            let mut moved = phantom.world_from_index;
            moved.translation.x += shift_mm;
            NiftiFile { sform_code: 1, ..plain("LPS").with_qform(moved) }
        };
        let same = folder.read("a.nii", &with_qform(1e-3).bytes()).unwrap();
        assert_eq!(same.warnings, Vec::<String>::new());
        let moved = folder.read("a.nii", &with_qform(12.0).bytes()).unwrap();
        Phantom::assert_in_world(&moved);
        assert!(moved.warnings[0].contains("differ by up to 12.0 mm; the sform is used"), "{:?}", moved.warnings);
        // A code without a matrix: the qform, or a refusal.
        let empty = NiftiFile { srow: [[0.0; 4]; 3], ..with_qform(0.0) };
        let volume = folder.read("a.nii", &empty.bytes()).unwrap();
        Phantom::assert_in_world(&volume);
        assert!(volume.warnings[0].contains("the qform is used"));
        file.srow[1][2] = f64::NAN;
        assert!(folder.refusal("a.nii", &file.bytes()).contains("sform matrix"));
    }

    #[test]
    fn voxel_sizes_alone_place_the_volume_like_analyze() {
        let folder = Folder::new();
        let mut file = plain("RAS");
        file.sform_code = 0;
        file.pixdim = [0.0, 2.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0];
        let volume = folder.read("a.nii", &file.bytes()).unwrap();
        assert_eq!(volume.grid.orientation_letters(), "LAS");
        assert_eq!(volume.grid.spacing_mm(), DVec3::new(2.0, 3.0, 4.0));
        let middle = volume.grid.world_from_index().transform_point3(DVec3::new(2.0, 1.5, 1.0));
        assert_eq!(middle, DVec3::ZERO);
        assert!(volume.warnings[0].contains("left and right may be swapped"));
        file.pixdim = [0.0, 0.0, -3.0, 4.0, 0.0, 0.0, 0.0, 0.0];
        let volume = folder.read("a.nii", &file.bytes()).unwrap();
        assert_eq!(volume.grid.spacing_mm(), DVec3::new(1.0, 3.0, 4.0));
        assert!(volume.warnings.iter().any(|w| w.contains("1 mm is assumed")), "{:?}", volume.warnings);
        assert!(volume.warnings.iter().any(|w| w.contains("sign is ignored")), "{:?}", volume.warnings);
        for broken in [f64::NAN, f64::INFINITY] {
            file.pixdim[2] = broken;
            assert!(folder.refusal("a.nii", &file.bytes()).contains("voxel size in the header is not a finite number"));
        }
    }

    #[test]
    fn units_become_millimeters() {
        let folder = Folder::new();
        for (units, factor) in [(0, 1.0), (1, 1000.0), (2, 1.0), (3, 1e-3), (2 | 8, 1.0)] {
            let phantom = Phantom::oriented("ASR");
            let base = NiftiFile { units, ..plain("ASR") };
            for file in [base.clone(), base.with_qform(phantom.world_from_index)] {
                let got = folder.read("a.nii", &file.bytes()).unwrap().grid.world_from_index();
                let expected = phantom.world_from_index;
                assert!((got.matrix3.col(0) - expected.matrix3.col(0) * factor).length() < 1e-6 * factor);
                assert!((got.translation - expected.translation * factor).length() < 1e-5 * factor);
            }
        }
    }

    #[test]
    fn slope_and_intercept() {
        let folder = Folder::new();
        let rescale = |slope, inter| {
            let volume = folder.read("a.nii", &NiftiFile { slope, inter, ..plain("RAS") }.bytes()).unwrap();
            (volume.rescale, volume.warnings.len())
        };
        assert_eq!(rescale(2.0, -1024.0), (Rescale { slope: 2.0, intercept: -1024.0 }, 0));
        assert_eq!(rescale(-0.5, 3.0), (Rescale { slope: -0.5, intercept: 3.0 }, 0));
        assert_eq!(rescale(0.0, 7.0), (Rescale::IDENTITY, 0));
        assert_eq!(rescale(f64::NAN, 0.0), (Rescale::IDENTITY, 1));
        assert_eq!(rescale(1.0, f64::INFINITY), (Rescale::IDENTITY, 1));
    }

    #[test]
    fn one_frame_of_several() {
        let folder = Folder::new();
        for endian in [Endian::Little, Endian::Big] {
            let mut file = NiftiFile::new(2, &Phantom::oriented("RAS"), ElementType::I16, endian);
            file.dim = [5, 5, 4, 3, 2, 3, 1, 1];
            let frames: Vec<f64> = (0..6).flat_map(|f| (0..60).map(move |i| f64::from(100 * f + i))).collect();
            file.voxels = encode(&frames, ElementType::I16, endian);
            for bytes in [gzip(&file.bytes()), file.bytes()] {
                let path = folder.write("a.nii", &bytes);
                for frame in 0..6 {
                    let volume = read_frame(&path, frame).unwrap();
                    assert_eq!(volume.num_frames, 6);
                    assert_eq!(volume.value(4, 3, 2), (100 * frame + 59) as f64);
                    assert_eq!(volume.value(0, 0, 0), (100 * frame) as f64);
                }
                let refusal = read_frame(&path, 6).unwrap_err().to_string();
                assert!(refusal.contains("there is no frame 6: the file has 6 frames; choose 0 to 5"), "{refusal}");
            }
        }
    }

    #[test]
    fn the_voxels_begin_where_the_header_says() {
        let folder = Folder::new();
        for vox_offset in [0.0, 352.0, 368.0, 5000.0] {
            let file = NiftiFile { vox_offset, ..plain("SAR") };
            Phantom::assert_in_world(&folder.read("a.nii", &file.bytes()).unwrap());
            Phantom::assert_in_world(&folder.read("a.nii", &gzip(&file.bytes())).unwrap());
        }
        for vox_offset in [-352.0, 100.0, 352.5, 1e18, 3e38, f64::NAN, f64::INFINITY] {
            let bytes = NiftiFile { vox_offset: 352.0, ..plain("SAR") }.bytes();
            let mut bytes = bytes;
            bytes[108..112].copy_from_slice(&(vox_offset as f32).to_le_bytes());
            let refusal = folder.refusal("a.nii", &bytes);
            assert!(refusal.contains("where they cannot be") || refusal.contains("promises"), "{refusal}");
        }
    }

    #[test]
    fn pairs_are_read_from_either_half() {
        let folder = Folder::new();
        let file = NiftiFile { magic: *b"ni1\0", vox_offset: 0.0, ..plain("PIL") };
        let header = folder.write("a.hdr", &file.header());
        assert!(read(&header).unwrap_err().to_string().contains("a.img, is missing"));
        let image = folder.write("a.img", &file.voxels);
        for path in [&header, &image] {
            let volume = read(path).unwrap();
            Phantom::assert_in_world(&volume);
            assert_eq!(volume.format, "NIfTI-1 pair");
        }
        std::fs::remove_file(&image).unwrap();
        folder.write("a.img.gz", &gzip(&file.voxels));
        Phantom::assert_in_world(&read(&header).unwrap());
        let alone = folder.refusal("b.nii", &file.bytes());
        assert!(alone.contains("not named .hdr"), "{alone}");
        let image = folder.write("c.img", &file.voxels);
        assert!(read(&image).unwrap_err().to_string().contains("c.hdr, is missing"));
    }

    #[test]
    fn analyze_is_read_with_a_warning() {
        let folder = Folder::new();
        for endian in [Endian::Little, Endian::Big] {
            let phantom = Phantom::oriented("LAS");
            let file = NiftiFile {
                magic: [0; 4],
                pixdim: [0.0, 0.75, 1.5, 2.25, 0.0, 0.0, 0.0, 0.0],
                units: 0,
                vox_offset: 0.0,
                ..NiftiFile::new(1, &phantom, ElementType::I16, endian)
            };
            folder.write("a.img", &file.voxels);
            let mut header = file.header();
            // What NIfTI puts there has another meaning.
            header[252..].fill(0);
            let middle = folder.read("a.hdr", &header).unwrap();
            assert_eq!((middle.format.as_str(), middle.grid.orientation_letters()), ("Analyze 7.5", "LAS".to_owned()));
            assert!(middle.warnings.join(" ").contains("left and right may be swapped"));
            assert_eq!(middle.value(4, 3, 2), phantom.values[59]);
            let corner = middle.grid.world_from_index().translation;
            assert_eq!(corner, DVec3::new(1.5, -2.25, -2.25));
            for (i, voxel) in [2_i16, 3, 1].into_iter().enumerate() {
                let bytes = if endian == Endian::Big { voxel.to_be_bytes() } else { voxel.to_le_bytes() };
                header[253 + 2 * i..255 + 2 * i].copy_from_slice(&bytes);
            }
            let at_origin = folder.read("a.hdr", &header).unwrap().grid.world_from_index();
            assert_eq!(at_origin.transform_point3(DVec3::new(1.0, 2.0, 0.0)), DVec3::ZERO);
            let colors = NiftiFile { datatype: 128, ..file }.header();
            assert!(folder.refusal("a.hdr", &colors).contains("colors in Analyze 7.5"));
        }
    }

    #[test]
    fn colors_and_complex_numbers() {
        let folder = Folder::new();
        for (datatype, n) in [(128, 3_usize), (2304, 4)] {
            let voxels: Vec<u8> = (0..60 * n).map(|i| i as u8).collect();
            for bytes in [NiftiFile { datatype, voxels: voxels.clone(), ..plain("RAS") }.bytes()] {
                for bytes in [gzip(&bytes), bytes] {
                    let volume = folder.read("a.nii", &bytes).unwrap();
                    let colors = volume.colors.unwrap();
                    let alpha = |c: &[u8]| c.get(3).copied().unwrap_or(255);
                    assert!(colors.iter().zip(voxels.chunks(n)).all(|(a, b)| a[..3] == b[..3] && a[3] == alpha(b)));
                }
            }
        }
        for (datatype, element) in [(32, ElementType::F32), (1792, ElementType::F64)] {
            for endian in [Endian::Little, Endian::Big] {
                let pairs: Vec<f64> = (0..60).flat_map(|i| [3.0 * f64::from(i), -4.0 * f64::from(i)]).collect();
                let file = NiftiFile {
                    datatype,
                    slope: -2.0,
                    inter: 7.0,
                    voxels: encode(&pairs, element, endian),
                    ..NiftiFile::new(1, &Phantom::oriented("RAS"), element, endian)
                };
                let volume = folder.read("a.nii", &file.bytes()).unwrap();
                assert_eq!((volume.value(1, 0, 0), volume.value(4, 3, 2)), (10.0, 590.0));
                assert_eq!(volume.voxels.bytes_per_voxel(), element.num_bytes());
                assert!(volume.warnings.join(" ").contains("the magnitude is shown"));
                let short = &file.bytes()[..file.bytes().len() - 1];
                assert!(folder.refusal("a.nii", short).contains("ends after"));
            }
        }
    }

    #[test]
    fn types_that_are_no_scalars_are_named() {
        let folder = Folder::new();
        for (datatype, name) in [(1, "single bits"), (1536, "128-bit"), (2048, "complex256")] {
            let refusal = folder.refusal("a.nii", &NiftiFile { datatype, ..plain("RAS") }.bytes());
            assert!(refusal.contains(name), "{refusal}");
        }
        for datatype in [0, 3, -4, 255] {
            let refusal = folder.refusal("a.nii", &NiftiFile { datatype, ..plain("RAS") }.bytes());
            assert!(refusal.contains(&format!("the voxel type {datatype} is none")), "{refusal}");
        }
    }

    #[test]
    fn hostile_sizes_are_refused_before_any_allocation() {
        let folder = Folder::new();
        let cases: [([i64; 8], &str); 9] = [
            ([3, 32767, 32767, 32767, 1, 1, 1, 1], "promises"),
            ([7, 32767, 32767, 32767, 32767, 32767, 32767, 32767], "more than any file holds"),
            ([3, 0, 4, 3, 1, 1, 1, 1], "0 voxels for dimension 1"),
            ([3, 5, -4, 3, 1, 1, 1, 1], "-4 voxels for dimension 2"),
            ([4, 5, 4, 3, -1, 1, 1, 1], "-1 voxels for dimension 4"),
            ([0, 5, 4, 3, 1, 1, 1, 1], "promises 0 dimensions"),
            ([8, 5, 4, 3, 1, 1, 1, 1], "promises 8 dimensions"),
            ([-3, 5, 4, 3, 1, 1, 1, 1], "promises -3 dimensions"),
            ([3, 5, 4, 4, 1, 1, 1, 1], "promises 432 bytes, but the file ends after 412"),
        ];
        for (dim, expected) in cases {
            let refusal = folder.refusal("a.nii", &NiftiFile { dim, ..plain("RAS") }.bytes());
            assert!(refusal.contains(expected), "{refusal}");
        }
        let wide = NiftiFile::new(2, &Phantom::oriented("RAS"), ElementType::F64, Endian::Little);
        for dim in [[3, i64::MAX, i64::MAX, 2, 1, 1, 1, 1], [3, 1 << 40, 1 << 20, 1, 1, 1, 1, 1]] {
            for bytes in [gzip(&NiftiFile { dim, ..wide.clone() }.bytes()), NiftiFile { dim, ..wide.clone() }.bytes()] {
                let refusal = folder.refusal("a.nii", &bytes);
                assert!(refusal.contains("promises"), "{refusal}");
            }
        }
        // Just within what deflate could hold: found out while decoding.
        let refusal =
            folder.refusal("a.nii", &gzip(&NiftiFile { dim: [3, 5, 4, 300, 1, 1, 1, 1], ..plain("RAS") }.bytes()));
        assert!(refusal.contains("ends after 60 of 6000 bytes of voxels"), "{refusal}");
    }

    #[test]
    fn further_dimensions_of_0_and_trailing_bytes_are_harmless() {
        let folder = Folder::new();
        let file = NiftiFile { dim: [4, 5, 4, 3, 0, 0, 0, 0], ..plain("RAS") };
        let mut bytes = file.bytes();
        bytes.extend([0; 100]);
        let volume = folder.read("a.nii", &bytes).unwrap();
        assert_eq!(volume.num_frames, 1);
        Phantom::assert_in_world(&volume);
        Phantom::assert_in_world(&folder.read("a.nii", &gzip(&bytes)).unwrap());
        let flat = NiftiFile { dim: [2, 5, 12, 0, 0, 0, 0, 0], ..plain("RAS") };
        assert_eq!(folder.read("a.nii", &flat.bytes()).unwrap().grid.dims(), [5, 12, 1]);
    }

    #[test]
    fn damage_anywhere_gives_a_sentence() {
        for version in [1, 2] {
            let file = NiftiFile::new(version, &Phantom::oriented("RAS"), ElementType::I16, Endian::Little);
            torture("a.nii", &file.bytes(), 540);
            torture("a.nii.gz", &gzip(&file.bytes()), usize::MAX);
        }
    }

    #[test]
    fn a_size_of_the_header_that_is_left_out_does_not_hide_the_byte_order() {
        for endian in [Endian::Little, Endian::Big] {
            let mut bytes = NiftiFile::new(1, &Phantom::oriented("RSA"), ElementType::F32, endian).bytes();
            bytes[..4].fill(0);
            Phantom::assert_in_world(&Folder::new().read("a.nii", &bytes).unwrap());
        }
    }
}
