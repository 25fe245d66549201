//! NRRD: `.nrrd` with the voxels attached, `.nhdr` with the voxels in a file of their own.
//!
//! Format: teem.sourceforge.net/nrrd/format.html. A text header of `field: value` lines ends at an empty line.
//! The patient spaces LPS and LAS become RAS; one axis that is not spatial (time, components) becomes frames.

mod segments;

use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::parts::{self, Part, Parts};
use super::stream::{self, ByteSource, ElementType, Endian, HexBytes, Pick, PickedBytes, VoxelRequest};
use super::window::{Averaging, OnGrid};
use super::{
    Entry, HEAD_BYTES, ReadOptions, VolumeReader, absurd_size, check_frame, color_volume_of, grid_of,
    numbers_as_labels, volume_of, window_labels,
};
use crate::error::{Error, Result, remedies};
use crate::progress::Progress;
use crate::selection::{BrickPool, Structure};
use crate::volume::labels::LabelMap;
use crate::volume::{Modality, Orientation, Rescale, Volume, Voxels};

/// A header longer than this is none: the longest in the wild are segmentations with hundreds of entries.
const MAX_HEADER_BYTES: usize = 16 << 20;

/// Reads NRRD with attached and with detached header.
pub struct NrrdReader;

impl VolumeReader for NrrdReader {
    fn name(&self) -> &'static str {
        "NRRD"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["nrrd", "nhdr"]
    }

    fn recognizes(&self, _path: &Path, head: &[u8]) -> bool {
        head.starts_with(b"NRRD000")
    }

    fn survey(&self, path: &Path, _options: &ReadOptions, _progress: &Progress) -> Result<Vec<Entry>> {
        Ok(vec![Opened::open(path)?.entry])
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        let opened = Opened::open(path)?;
        check_frame(path, options.frame, opened.entry.num_frames)?;
        let window = options.window.on(path, opened.entry.grid.dims())?;
        if let Some(num_channels) = opened.num_channels {
            return opened.read_colors(path, num_channels, window, progress);
        }
        let averaging = if opened.entry.is_labels { Averaging::Nearest } else { Averaging::Mean };
        let (entry, voxels, warnings) = opened.read_frame(options.frame, window, averaging, progress)?;
        volume_of(path, &entry, window, voxels, Rescale::IDENTITY, warnings)
    }

    fn read_labels(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Vec<LabelMap>> {
        let opened = Opened::open(path)?;
        if !opened.entry.is_labels {
            return numbers_as_labels(self, path, options, progress);
        }
        let layers = segments::read(path, opened, progress)?;
        layers.into_iter().map(|layer| window_labels(path, layer, options.window)).collect()
    }
}

/// The selections of a file whose voxels belong to structures in part, with notes; nothing if it is another file.
///
/// # Errors
/// As [`VolumeReader::read_labels`].
pub fn read_fractional(
    path: &Path,
    pool: &Arc<BrickPool>,
    progress: &Progress,
) -> Result<Option<(Vec<Structure>, Vec<String>)>> {
    let is_nrrd = path.is_file() && NrrdReader.recognizes(path, &ByteSource::open(path)?.read_up_to(HEAD_BYTES)?);
    if is_nrrd { segments::read_fractional(path, Opened::open(path)?, pool, progress) } else { Ok(None) }
}

/// A file whose header is understood and whose voxels are there as far as the file's size tells.
struct Opened {
    entry: Entry,
    axes: Axes,
    element: ElementType,
    encoding: Encoding,
    endian: Endian,
    data_path: PathBuf,
    /// Bytes to pass over behind the decompressor.
    skipped: u64,
    /// The data files from where the voxels begin.
    source: Parts,
    /// Bytes of a color, which come before any other axis.
    num_channels: Option<usize>,
    warnings: Vec<String>,
    /// The header's keys that describe segments.
    keys: Vec<(String, String)>,
}

impl Opened {
    fn open(path: &Path) -> Result<Self> {
        let header = Header::read(path)?;
        let mut warnings = Vec::new();
        let axes = header.axes(path, &mut warnings)?;
        let (world_from_index, orientation) = header.world_from_index(path, &axes, &mut warnings)?;
        let element = header.element_type(path)?;
        let encoding = header.encoding(path)?;
        let endian = header.endian(path, element, encoding, &mut warnings)?;

        let size = stream::size_bytes(&axes.sizes, element).ok_or_else(|| absurd_size(path, &axes.sizes))?;
        let skipped = if encoding == Encoding::Gzip { header.byte_skip(path)?.unwrap_or(0) } else { 0 };
        let (source, data_path, num_data_files) = if let Some(names) = header.file_names(path, &axes.sizes)? {
            let (data_path, count) = (parts::data_file(path, &names[0])?, names.len());
            (header.open_files(path, &names, size, encoding)?, data_path, count)
        } else {
            let (data_path, data_start) = header.data_place(path, size, encoding)?;
            let source = ByteSource::open_at(&data_path, data_start, encoding == Encoding::Gzip)?;
            source.check_holds(encoding.min_stored_bytes(size, element).saturating_add(skipped))?;
            // Text has any length.
            (Parts::of_source(source, u64::MAX, &Progress::new()), data_path, 1)
        };
        let num_channels = header.num_channels(&axes, element, encoding);
        if num_channels.is_none() && header.is_color(&axes) {
            warnings.push("The voxels are colors; the frames are their channels.".to_owned());
        }
        let is_detached = data_path != path;
        let entry = Entry {
            key: String::new(),
            title: header.get("content").unwrap_or_default().to_owned(),
            format: if is_detached { "NRRD, detached header" } else { "NRRD" }.to_owned(),
            modality: Modality::Unknown,
            grid: grid_of(path, axes.dims, world_from_index)?,
            orientation,
            type_name: match num_channels {
                Some(3) => "rgb",
                Some(_) => "rgba",
                None => element.name(),
            },
            bytes_per_voxel: if num_channels.is_some() { 6 } else { element.num_bytes() },
            num_frames: match num_channels {
                Some(_) => 1,
                None => usize::try_from(axes.num_frames).unwrap_or(usize::MAX),
            },
            num_files: num_data_files + usize::from(is_detached),
            is_labels: !header.keys.is_empty(),
            is_localizer: false,
        };
        let keys = header.keys;
        Ok(Self { entry, axes, element, encoding, endian, data_path, skipped, source, num_channels, warnings, keys })
    }

    fn read_colors(self, path: &Path, num_channels: usize, window: OnGrid, progress: &Progress) -> Result<Volume> {
        let mut source = self.source.watched_by(progress);
        progress.begin("reading", (self.entry.grid.num_voxels() * num_channels) as u64);
        source.skip(self.skipped)?;
        let colors = stream::read_colors(&mut source, num_channels, window, &self.data_path, progress)?;
        source.finish()?;
        color_volume_of(path, &self.entry, window, colors, self.warnings)
    }

    fn read_frame(
        self,
        frame: usize,
        window: OnGrid,
        averaging: Averaging,
        progress: &Progress,
    ) -> Result<(Entry, Voxels, Vec<String>)> {
        let Self { entry, axes, element, encoding, endian, data_path, skipped, source, warnings, .. } = self;
        let mut source = source.watched_by(progress);
        let pick = axes.pick(frame as u64, entry.grid.num_voxels());
        let element_bytes = element.num_bytes() as u64;
        let is_size_checked = encoding != Encoding::Gzip;
        let request = VoxelRequest { element, endian, window, averaging, is_size_checked };
        // Text and hexadecimal digits are counted as they are stored.
        progress.begin("reading", if encoding.is_text() { 0 } else { pick.count as u64 * element_bytes });
        let is_contiguous = pick.run == pick.count as u64;
        let voxels = match encoding {
            Encoding::Raw | Encoding::Gzip => {
                source.skip(skipped + pick.first * element_bytes)?;
                if is_contiguous {
                    stream::read_voxels(&mut source, request, &data_path, progress)?
                } else {
                    let mut picked = PickedBytes::new(&mut source, pick, element.num_bytes());
                    stream::read_voxels(&mut picked, request, &data_path, progress)?
                }
            }
            Encoding::Text => {
                stream::read_text_voxels(&mut BufReader::new(&mut source), request, pick, &data_path, progress)?
            }
            Encoding::Hex => {
                let mut bytes = HexBytes::new(&mut source);
                stream::skip_bytes(&mut bytes, pick.first * element_bytes, &data_path)?;
                let mut picked = PickedBytes::new(bytes, pick, element.num_bytes());
                stream::read_voxels(&mut picked, request, &data_path, progress)?
            }
        };
        source.finish()?;
        Ok((entry, voxels, warnings))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Raw,
    Gzip,
    Text,
    Hex,
}

impl Encoding {
    fn is_text(self) -> bool {
        matches!(self, Self::Text | Self::Hex)
    }

    /// The fewest bytes before decompression that `size` bytes of voxels can take: a digit and a blank for a
    /// number, two digits for a byte.
    fn min_stored_bytes(self, size: u64, element: ElementType) -> u64 {
        match self {
            Self::Raw | Self::Gzip => size,
            Self::Text => (size / element.num_bytes() as u64).saturating_mul(2).saturating_sub(1),
            Self::Hex => size.saturating_mul(2),
        }
    }
}

/// The fields of a header by name (lower case, without blanks: `datafile` and `data file` are one), as text.
struct Header {
    fields: Vec<(String, String)>,
    /// Those of the user's own keys that describe segments, as they are written.
    keys: Vec<(String, String)>,
    /// The lines behind `data file: LIST`.
    files: Vec<String>,
    /// Where attached voxels begin.
    num_bytes: u64,
}

/// The spatial axes and the one of the frames.
#[derive(Debug)]
struct Axes {
    /// Elements along every axis of the file, fastest first.
    sizes: Vec<u64>,
    /// Which axes of the file are x, y, z.
    spatial: [usize; 3],
    dims: [u64; 3],
    /// Which axis of the file counts frames.
    frame_axis: Option<usize>,
    num_frames: u64,
}

impl Axes {
    fn pick(&self, frame: u64, count: usize) -> Pick {
        // The sizes multiply to a number that was checked before.
        let run = self.frame_axis.map_or(count as u64, |axis| self.sizes[..axis].iter().product());
        Pick { first: frame * run, run, period: run * self.num_frames, count }
    }
}

impl Header {
    fn read(path: &Path) -> Result<Self> {
        let mut source = ByteSource::open(path)?;
        if source.is_gzip() {
            return Err(Error::file(
                path,
                "the whole file is compressed, where NRRD compresses the voxels only",
                "decompress it with gunzip",
            ));
        }
        let mut bytes = Vec::new();
        let mut end = None;
        let mut num_searched = 0_usize;
        while end.is_none() && bytes.len() < MAX_HEADER_BYTES {
            let more = source.read_up_to(64 << 10)?;
            if more.is_empty() {
                break;
            }
            bytes.extend_from_slice(&more);
            end = header_end(&bytes, num_searched.saturating_sub(3));
            num_searched = bytes.len();
        }
        if !bytes.starts_with(b"NRRD000") {
            return Err(Error::file(
                path,
                "this is no NRRD file: it does not begin with NRRD000",
                remedies::DESCRIBE_VOXELS,
            ));
        }
        if end.is_none() && bytes.len() >= MAX_HEADER_BYTES {
            return Err(Error::file(path, "its header has no end", "copy or download it again"));
        }
        // A detached header may do without the empty line.
        let (text_end, num_bytes) = end.unwrap_or((bytes.len(), bytes.len()));
        let text = String::from_utf8_lossy(&bytes[..text_end]);
        let (mut fields, mut keys, mut files) = (Vec::new(), Vec::new(), Vec::new());
        let mut lines = text.lines().skip(1).map(str::trim);
        while let Some(line) = lines.next() {
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let Some((name, value)) = line.split_once(':') else {
                let shown: String = line.chars().take(40).collect();
                return Err(Error::file(
                    path,
                    format!("the header line `{shown}` is no field"),
                    "write it as `field: value`, or end the header with an empty line",
                ));
            };
            // `key:=value` is the user's own.
            if let Some(value) = value.strip_prefix('=') {
                if segments::is_of_segments(name) {
                    keys.push((name.to_owned(), value.to_owned()));
                }
                continue;
            }
            let name: String = name.to_lowercase().split_whitespace().collect();
            let value = value.trim().to_owned();
            // A list of files goes on to the end of the header in lines that are no fields.
            let is_list = name == "datafile" && is_list_of_files(&value);
            fields.push((name, value));
            if is_list {
                files = lines.map(str::to_owned).filter(|l| !l.is_empty()).collect();
                break;
            }
        }
        Ok(Self { fields, keys, files, num_bytes: num_bytes as u64 })
    }

    fn get(&self, name: &str) -> Option<&str> {
        self.fields.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    fn require(&self, path: &Path, name: &str) -> Result<&str> {
        self.get(name).ok_or_else(|| fault(path, format!("the header has no field `{name}`")))
    }

    fn element_type(&self, path: &Path) -> Result<ElementType> {
        let name = self.require(path, "type")?;
        let words: Vec<_> = name.split_whitespace().map(str::to_lowercase).collect();
        Ok(match words.join(" ").as_str() {
            "signed char" | "int8" | "int8_t" => ElementType::I8,
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => ElementType::U8,
            "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => ElementType::I16,
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => ElementType::U16,
            "int" | "signed int" | "int32" | "int32_t" => ElementType::I32,
            "uint" | "unsigned int" | "uint32" | "uint32_t" => ElementType::U32,
            "longlong"
            | "long long"
            | "long long int"
            | "signed long long"
            | "signed long long int"
            | "int64"
            | "int64_t" => ElementType::I64,
            "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => ElementType::U64,
            "float" => ElementType::F32,
            "double" => ElementType::F64,
            // `char` has a sign on some machines only; the format leaves it out on purpose.
            _ => return Err(fault(path, format!("the voxel type `{name}` is none that Fabrica reads"))),
        })
    }

    fn encoding(&self, path: &Path) -> Result<Encoding> {
        let name = self.require(path, "encoding")?.to_lowercase();
        Ok(match name.as_str() {
            "raw" => Encoding::Raw,
            "gzip" | "gz" => Encoding::Gzip,
            "txt" | "text" | "ascii" => Encoding::Text,
            "hex" => Encoding::Hex,
            "bzip2" | "bz2" => {
                return Err(Error::file(
                    path,
                    "the voxels are compressed with bzip2, which Fabrica does not read",
                    "save it with gzip encoding (unu save -f nrrd -e gzip)",
                ));
            }
            _ => return Err(fault(path, format!("the encoding `{name}` is none that Fabrica reads"))),
        })
    }

    fn endian(
        &self,
        path: &Path,
        element: ElementType,
        encoding: Encoding,
        warnings: &mut Vec<String>,
    ) -> Result<Endian> {
        match self.get("endian").map(str::to_lowercase).as_deref() {
            Some("little") => Ok(Endian::Little),
            Some("big") => Ok(Endian::Big),
            Some(other) => Err(fault(path, format!("the byte order `{other}` is neither little nor big"))),
            None => {
                if element.num_bytes() > 1 && encoding != Encoding::Text {
                    warnings.push("The header does not give the byte order; little endian is assumed.".to_owned());
                }
                Ok(Endian::Little)
            }
        }
    }

    fn axes(&self, path: &Path, warnings: &mut Vec<String>) -> Result<Axes> {
        let num_axes: usize = self.require(path, "dimension")?.parse().unwrap_or(0);
        if !(3..=4).contains(&num_axes) {
            let given = self.get("dimension").unwrap_or_default();
            return Err(Error::file(
                path,
                format!("the data have dimension {given}, where a volume has 3, or 4 with frames"),
                "slice or join it into a volume (unu slice, unu join)",
            ));
        }
        let text = self.require(path, "sizes")?;
        let sizes: Option<Vec<u64>> = text.split_whitespace().map(|w| w.parse().ok().filter(|&n| n > 0)).collect();
        let sizes = sizes
            .filter(|s| s.len() == num_axes)
            .ok_or_else(|| fault(path, format!("the sizes `{text}` are not {num_axes} numbers of voxels")))?;
        let frame_axis = self.frame_axis(path, num_axes, warnings)?;
        let mut spatial = (0..num_axes).filter(|&axis| Some(axis) != frame_axis);
        let spatial = [(); 3].map(|()| spatial.next().unwrap_or(0));
        Ok(Axes {
            dims: spatial.map(|axis| sizes[axis]),
            num_frames: frame_axis.map_or(1, |axis| sizes[axis]),
            sizes,
            spatial,
            frame_axis,
        })
    }

    /// The one axis of four that is not spatial: that without a direction, else by its kind, else the last.
    fn frame_axis(&self, path: &Path, num_axes: usize, warnings: &mut Vec<String>) -> Result<Option<usize>> {
        let directions = self.directions(path, num_axes)?;
        let kinds: Vec<_> = self.get("kinds").unwrap_or_default().split_whitespace().map(str::to_lowercase).collect();
        let is_domain = |kind: &String| matches!(kind.as_str(), "domain" | "space" | "???" | "none");
        let by_kind: Vec<_> =
            if kinds.len() == num_axes { (0..num_axes).filter(|&i| !is_domain(&kinds[i])).collect() } else { vec![] };
        let others = match &directions {
            // Of the time forms of a space, the time axis has a direction that leaves the three of space.
            Some(d) => (0..num_axes)
                .filter(|&i| d[i].as_ref().is_none_or(|v| v.len() == 4 && v[..3].iter().all(|&c| c == 0.0)))
                .collect(),
            None => by_kind,
        };
        match (num_axes, &others[..]) {
            (3, []) => Ok(None),
            (4, &[axis]) => Ok(Some(axis)),
            (4, []) if directions.is_none() => {
                warnings.push("The header does not say which axis counts frames; the last one is taken.".to_owned());
                Ok(Some(3))
            }
            _ => Err(Error::file(
                path,
                format!("{} of its {num_axes} axes are spatial, where a volume has 3", num_axes - others.len()),
                "slice or join it into a volume (unu slice, unu join)",
            )),
        }
    }

    /// `space directions` per axis of the file; `None` for an axis without one. `None` without the field.
    fn directions(&self, path: &Path, num_axes: usize) -> Result<Option<Vec<Option<Vec<f64>>>>> {
        let Some(text) = self.get("spacedirections") else { return Ok(None) };
        let broken = || fault(path, format!("the space directions `{text}` are not {num_axes} vectors or `none`"));
        let mut directions = Vec::new();
        let mut rest = text.trim();
        while !rest.is_empty() {
            if let Some(after) = rest.strip_prefix("none") {
                directions.push(None);
                rest = after.trim_start();
            } else {
                let end = rest.find(')').ok_or_else(broken)?;
                let vector = parse_vector(&rest[..=end]).ok_or_else(broken)?;
                // Old writers give an axis without direction a vector of NaN.
                directions.push((!vector.iter().all(|c| c.is_nan())).then_some(vector));
                rest = rest[end + 1..].trim_start();
            }
        }
        if directions.len() != num_axes {
            return Err(broken());
        }
        Ok(Some(directions))
    }

    /// The affine to RAS mm.
    fn world_from_index(
        &self,
        path: &Path,
        axes: &Axes,
        warnings: &mut Vec<String>,
    ) -> Result<(DAffine3, Orientation)> {
        let (ras_from_space, mut orientation) = self.ras_from_space(path)?;
        let broken = |name: &str, text: &str| fault(path, format!("the {name} `{text}` is not a vector of numbers"));
        let mm = self.mm_per_unit("spaceunits", &[0, 1, 2], warnings);
        let origin = match self.get("spaceorigin") {
            Some(text) => {
                let v = parse_vector(text).ok_or_else(|| broken("space origin", text))?;
                let [x, y, z, ..] = v[..] else { return Err(broken("space origin", text)) };
                DVec3::new(x, y, z)
            }
            None => DVec3::ZERO,
        };
        let matrix = if let Some(directions) = self.directions(path, axes.sizes.len())? {
            let mut columns = [DVec3::ZERO; 3];
            for (column, &axis) in columns.iter_mut().zip(&axes.spatial) {
                let Some([x, y, z, ..]) = directions[axis].as_deref() else {
                    return Err(fault(path, "the space directions have fewer than 3 components".to_owned()));
                };
                *column = DVec3::new(*x, *y, *z);
            }
            DMat3::from_diagonal(mm) * DMat3::from_cols(columns[0], columns[1], columns[2])
        } else {
            if orientation.is_known() {
                let space = self.get("space").unwrap_or_default();
                orientation = Orientation::Assumed(format!(
                    "The header names the space {space}, but not how the axes lie in it: they are taken in its order, so left \
                     and right may be swapped."
                ));
            }
            let units = self.mm_per_unit("units", &axes.spatial, warnings);
            DMat3::from_diagonal(self.spacings(path, axes, warnings)? * units)
        };
        let world = DAffine3 { matrix3: ras_from_space * matrix, translation: ras_from_space * (mm * origin) };
        Ok((world, orientation))
    }

    fn ras_from_space(&self, path: &Path) -> Result<(DMat3, Orientation)> {
        const ASSUMED: &str = "left and right may be swapped";
        let mirror = |x, y| DMat3::from_diagonal(DVec3::new(x, y, 1.0));
        let assumed = Orientation::Assumed;
        let Some(name) = self.get("space") else {
            if self.get("spacedimension").is_some_and(|n| n != "3" && n != "4") {
                return Err(fault(path, "the space of the volume has not 3 dimensions".to_owned()));
            }
            let why = format!("The header does not name its space; RAS is assumed, so {ASSUMED}.");
            return Ok((mirror(1.0, 1.0), assumed(why)));
        };
        let lower = name.to_lowercase();
        // A further time axis changes nothing in space.
        let spatial = lower.strip_suffix("-time").unwrap_or(&lower);
        match spatial {
            "ras" | "rast" | "right-anterior-superior" => Ok((mirror(1.0, 1.0), Orientation::Stated)),
            "las" | "last" | "left-anterior-superior" => Ok((mirror(-1.0, 1.0), Orientation::Stated)),
            "lps" | "lpst" | "left-posterior-superior" => Ok((mirror(-1.0, -1.0), Orientation::Stated)),
            "scanner-xyz" | "3d-right-handed" => {
                let why = format!("The space `{name}` does not tell left from right; RAS is assumed, so {ASSUMED}.");
                Ok((mirror(1.0, 1.0), assumed(why)))
            }
            // Of the two handednesses that of the object is known: LAS keeps it, RAS would mirror it.
            "3d-left-handed" => {
                let why = format!("The space `{name}` does not tell left from right; LAS is assumed, so {ASSUMED}.");
                Ok((mirror(-1.0, 1.0), assumed(why)))
            }
            _ => Err(fault(path, format!("the space `{name}` is none of RAS, LAS and LPS"))),
        }
    }

    /// Spacing of the spatial axes in the header's unit, 1 where it is not given.
    fn spacings(&self, path: &Path, axes: &Axes, warnings: &mut Vec<String>) -> Result<DVec3> {
        let Some(text) = self.get("spacings") else {
            warnings.push("The header does not give the voxel size; 1 mm is assumed.".to_owned());
            return Ok(DVec3::ONE);
        };
        let spacings: Option<Vec<f64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
        let spacings = spacings
            .filter(|s| s.len() == axes.sizes.len())
            .ok_or_else(|| fault(path, format!("the spacings `{text}` are not one number per axis")))?;
        let spacing = axes.spatial.map(|axis| spacings[axis]);
        // NaN is how NRRD writes "not known".
        if spacing.iter().any(|s| s.is_nan() || *s == 0.0) {
            warnings.push("The header gives no voxel size for an axis; 1 mm is assumed.".to_owned());
        }
        Ok(DVec3::from_array(spacing.map(|s| if s.is_nan() || s == 0.0 { 1.0 } else { s })))
    }

    /// Millimeters per unit of the quoted names in a field, for the entries `which`.
    fn mm_per_unit(&self, name: &str, which: &[usize; 3], warnings: &mut Vec<String>) -> DVec3 {
        let names: Vec<_> = self.get(name).unwrap_or_default().split('"').skip(1).step_by(2).collect();
        let factors = which.map(|i| match names.get(i).map(|u| u.trim().to_lowercase()).as_deref() {
            None | Some("mm" | "millimeter" | "millimeters" | "millimetre" | "") => 1.0,
            Some("m" | "meter" | "meters" | "metre") => 1000.0,
            Some("cm" | "centimeter" | "centimeters") => 10.0,
            Some("um" | "µm" | "μm" | "micron" | "microns" | "micrometer" | "micrometers") => 1e-3,
            Some("nm" | "nanometer" | "nanometers") => 1e-6,
            Some(other) => {
                warnings.push(format!("The unit of length `{other}` is not known; mm are assumed."));
                1.0
            }
        });
        DVec3::from_array(factors)
    }

    fn line_skip(&self, path: &Path) -> Result<u64> {
        let Some(text) = self.get("lineskip") else { return Ok(0) };
        text.parse().map_err(|_| fault(path, format!("the line skip `{text}` is no number of lines")))
    }

    /// Bytes before the voxels (inside the compressed data if there are any); `None` for -1, "from the end".
    fn byte_skip(&self, path: &Path) -> Result<Option<u64>> {
        match self.get("byteskip") {
            None => Ok(Some(0)),
            Some("-1") => Ok(None),
            Some(text) => {
                let n = text.parse().ok().filter(|&n: &u64| n < 1 << 62);
                n.map(Some).ok_or_else(|| fault(path, format!("the byte skip `{text}` is no number of bytes")))
            }
        }
    }

    /// Whether the axis that is not spatial is a color.
    fn is_color(&self, axes: &Axes) -> bool {
        let kinds: Vec<_> = self.get("kinds").unwrap_or_default().split_whitespace().map(str::to_lowercase).collect();
        axes.frame_axis.is_some_and(|axis| kinds.get(axis).is_some_and(|kind| kind.contains("color")))
    }

    /// How many bytes side by side are a color, if the voxels are such.
    fn num_channels(&self, axes: &Axes, element: ElementType, encoding: Encoding) -> Option<usize> {
        let kind = self.get("kinds")?.split_whitespace().next()?.to_lowercase();
        let num_channels = match kind.as_str() {
            "rgb-color" | "3-color" => 3,
            "rgba-color" | "4-color" => 4,
            _ => return None,
        };
        let is_first = axes.frame_axis == Some(0) && axes.num_frames == num_channels;
        // Numbers of segments are no colors, whatever their axis is called.
        let is_plain = self.keys.is_empty() && element == ElementType::U8 && !encoding.is_text();
        (is_first && is_plain).then_some(num_channels as usize)
    }

    /// The names of the data files, if there are several: in the order of the voxels, each with as many of them.
    fn file_names(&self, path: &Path, sizes: &[u64]) -> Result<Option<Vec<String>>> {
        let Some(text) = self.get("datafile").filter(|t| is_list_of_files(t)) else { return Ok(None) };
        let words: Vec<_> = text.split_whitespace().collect();
        let is_list = words[0] == "LIST";
        // How many axes a file has; without a word all but the last.
        let inner = words.get(if is_list { 1 } else { 4 }).map_or(Some(sizes.len() - 1), |w| w.parse().ok());
        let inner = inner.filter(|n| (1..=sizes.len()).contains(n));
        let inner = inner.ok_or_else(|| fault(path, format!("the data file `{text}` has a wrong number of axes")))?;
        let count: u64 = sizes[inner..].iter().product();
        if is_list {
            let given = self.files.len() as u64;
            if given != count {
                return Err(Error::file(
                    path,
                    format!("the header lists {given} files, where the sizes take {count}"),
                    "correct the list or the sizes",
                ));
            }
            return Ok(Some(self.files.clone()));
        }
        let numbers: Option<Vec<i64>> = words[1..4].iter().map(|w| w.parse().ok()).collect();
        let Some([first, last, step]) = numbers.as_deref() else {
            return Err(fault(path, format!("`{text}` is no pattern with its first number, last number and step")));
        };
        let names = parts::files_of_pattern(words[0], [*first, *last, *step], count);
        Ok(Some(names.map_err(|what| fault(path, what))?))
    }

    /// Several data files as one.
    fn open_files(&self, path: &Path, names: &[String], size: u64, encoding: Encoding) -> Result<Parts> {
        let byte_skip = self.byte_skip(path)?;
        let is_deflated = encoding == Encoding::Gzip;
        if encoding.is_text() || is_deflated && byte_skip != Some(0) {
            let what = "its voxels are in several files, as text or behind other compressed bytes";
            return Err(Error::file(path, what, "join them into one file (unu save -f nrrd)"));
        }
        let bytes_each = size / names.len() as u64;
        let part = |name: &String| {
            let data = parts::data_file(path, name)?;
            let start = match byte_skip {
                Some(skip) => stream::skip_lines(&data, 0, self.line_skip(path)?)?.saturating_add(skip),
                None => {
                    let length = std::fs::metadata(&data).map_err(|e| Error::io(&data, &e))?.len();
                    length.saturating_sub(bytes_each)
                }
            };
            Ok(Part { path: data, start, is_deflated })
        };
        Parts::open(names.iter().map(part).collect::<Result<_>>()?, bytes_each, &Progress::new())
    }

    /// The file with the voxels and the byte at which they, or the compressed data, begin.
    fn data_place(&self, path: &Path, size: u64, encoding: Encoding) -> Result<(PathBuf, u64)> {
        let (data_path, mut start) = match self.get("datafile") {
            None => (path.to_owned(), self.num_bytes),
            Some(name) => (parts::data_file(path, name)?, 0),
        };
        let length = std::fs::metadata(&data_path).map_err(|e| Error::io(&data_path, &e))?.len();
        let byte_skip = self.byte_skip(path)?;
        if byte_skip.is_none() {
            if encoding != Encoding::Raw {
                return Err(fault(path, "byte skip -1 has a meaning for raw encoding only".to_owned()));
            }
            let room = length.saturating_sub(start);
            if size > room {
                return Err(Error::file(
                    &data_path,
                    format!("the header promises {size} bytes of voxels, but the file has {room}"),
                    "copy or download it again",
                ));
            }
            return Ok((data_path, length - size));
        }
        start = stream::skip_lines(&data_path, start, self.line_skip(path)?)?;
        if encoding != Encoding::Gzip {
            start = start.saturating_add(byte_skip.unwrap_or(0));
        }
        Ok((data_path, start))
    }
}

/// Whether the voxels are in several files: `LIST` and their names, or a pattern with a range (`slice%03d.raw 1 20 1`).
fn is_list_of_files(data_file: &str) -> bool {
    let words: Vec<_> = data_file.split_whitespace().collect();
    words.first() == Some(&"LIST") || (words.len() >= 4 && data_file.contains('%'))
}

/// Where the header's text ends and where the voxels after its empty line begin; `from` was searched before.
fn header_end(bytes: &[u8], from: usize) -> Option<(usize, usize)> {
    (from..bytes.len()).find_map(|i| match &bytes[i..] {
        [b'\n', b'\n', ..] => Some((i, i + 2)),
        [b'\n', b'\r', b'\n', ..] => Some((i, i + 3)),
        _ => None,
    })
}

/// `(1, 2.5, -3e1)` as numbers, of which there are at most 4.
fn parse_vector(text: &str) -> Option<Vec<f64>> {
    let inner = text.trim().strip_prefix('(')?.strip_suffix(')')?;
    let numbers: Option<Vec<f64>> = inner.split(',').map(|w| w.trim().parse().ok()).collect();
    numbers.filter(|n| n.len() <= 4)
}

fn fault(path: &Path, what: String) -> Error {
    Error::file(path, what, "correct the header with the program that wrote it")
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        ALL_TYPES, Folder, Phantom, all_orientations, encode, gzip, phantom_value, read, read_frame, torture,
    };
    use super::*;

    const TYPE_NAMES: [&str; 10] = [
        "unsigned char",
        "signed char",
        "ushort",
        "short int",
        "uint32_t",
        "int",
        "unsigned long long int",
        "longlong",
        "float",
        "double",
    ];

    /// `space directions` and `space origin` of an affine in a space that is RAS but for the signs.
    fn place(world_from_index: DAffine3, signs: [f64; 3]) -> String {
        let signs = DVec3::from_array(signs);
        let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
        let m = world_from_index.matrix3;
        format!(
            "space directions: {} {} {}\nspace origin: {}\n",
            vector(signs * m.x_axis),
            vector(signs * m.y_axis),
            vector(signs * m.z_axis),
            vector(signs * world_from_index.translation)
        )
    }

    fn nrrd(header: &str, data: &[u8]) -> Vec<u8> {
        [format!("NRRD0005\n# a comment: with a colon\n{header}\n").as_bytes(), data].concat()
    }

    /// The phantom as uint8, with `extra` lines.
    fn phantom_file(encoding: &str, extra: &str, data: &[u8]) -> Vec<u8> {
        let place = place(Phantom::oriented("RAS").world_from_index, [1.0; 3]);
        let header =
            format!("type: uint8\ndimension: 3\nsizes: 5 4 3\nspace: RAS\n{place}encoding: {encoding}\n{extra}");
        nrrd(&header, data)
    }

    fn phantom_bytes() -> Vec<u8> {
        encode(&Phantom::oriented("RAS").values, ElementType::U8, Endian::Little)
    }

    #[test]
    fn voxels_in_several_files() {
        let folder = Folder::new();
        for (i, slice) in phantom_bytes().chunks(20).enumerate() {
            folder.write(&format!("s{}.raw", i + 1), &[b"head\n", slice].concat());
            folder.write(&format!("s{}.gz", i + 1), &gzip(slice));
            for (j, row) in slice.chunks(5).enumerate() {
                folder.write(&format!("r{:02}", 2 * (4 * i + j)), row);
            }
        }
        for (encoding, fields) in [
            ("raw", "line skip: 1\ndata file: LIST\ns1.raw\ns2.raw\ns3.raw\n"),
            ("raw", "byte skip: 5\ndata file: s%d.raw 1 3 1\n"),
            ("raw", "byte skip: -1\ndata file: s%d.raw 1 3 1 2\n"),
            ("raw", "data file: r%02d 0 22 2 1\n"),
            ("gzip", "data file: LIST 2\ns1.gz\ns2.gz\ns3.gz\n"),
        ] {
            let path = folder.write("a.nhdr", &phantom_file(encoding, fields, b""));
            Phantom::assert_in_world(&read(&path).unwrap());
            let num_files = Opened::open(&path).unwrap().entry.num_files;
            assert_eq!(num_files, if fields.contains("r%02d") { 13 } else { 4 });
        }
    }

    #[test]
    fn colors_in_front_are_colors() {
        let folder = Folder::new();
        for (kind, n) in [("RGB-color", 3), ("RGBA-color", 4), ("3-color", 3), ("4-color", 4)] {
            let bytes: Vec<u8> = (0..8 * n).collect();
            for (encoding, data) in [("raw", bytes.clone()), ("gzip", gzip(&bytes))] {
                let header = format!(
                    "type: uint8\ndimension: 4\nsizes: {n} 2 2 2\nkinds: {kind} domain domain domain\n\
                     spacings: nan 1 1 1\nencoding: {encoding}\n"
                );
                let volume = folder.read("a.nrrd", &nrrd(&header, &data)).unwrap();
                let color = |c: &[u8]| [c[0], c[1], c[2], c.get(3).copied().unwrap_or(255)];
                assert_eq!(volume.colors.unwrap(), bytes.chunks(usize::from(n)).map(color).collect::<Vec<_>>());
                assert_eq!(volume.num_frames, 1);
            }
        }
        // Other colors, and colors plane by plane, stay frames and are said to be channels.
        for (kinds, sizes) in
            [("HSV-color domain domain domain", "3 2 2 2"), ("domain domain domain RGB-color", "2 2 2 3")]
        {
            let header = format!(
                "type: uint8\ndimension: 4\nsizes: {sizes}\nkinds: {kinds}\nspacings: 1 1 1 1\nencoding: raw\n"
            );
            let volume = folder.read("a.nrrd", &nrrd(&header, &[0; 24])).unwrap();
            assert!(volume.colors.is_none() && volume.num_frames == 3);
            assert!(volume.warnings.join(" ").contains("the frames are their channels"));
        }
    }

    #[test]
    fn every_orientation_in_every_space() {
        let folder = Folder::new();
        for letters in all_orientations() {
            let phantom = Phantom::oriented(&letters);
            let [x, y, z] = phantom.dims;
            for (space, signs) in [
                ("RAS", [1.0, 1.0, 1.0]),
                ("right-anterior-superior", [1.0, 1.0, 1.0]),
                ("left-posterior-superior", [-1.0, -1.0, 1.0]),
                ("LPS", [-1.0, -1.0, 1.0]),
                ("Left-Anterior-Superior", [-1.0, 1.0, 1.0]),
            ] {
                let place = place(phantom.world_from_index, signs);
                let header = format!(
                    "type: short\ndimension: 3\nspace: {space}\nsizes: {x} {y} {z}\n{place}endian: little\nencoding: raw\n"
                );
                let data = encode(&phantom.values, ElementType::I16, Endian::Little);
                let volume = folder.read("a.nrrd", &nrrd(&header, &data)).unwrap();
                assert_eq!(volume.grid.orientation_letters(), letters);
                assert_eq!(volume.warnings, Vec::<String>::new());
                Phantom::assert_in_world(&volume);
            }
        }
    }

    #[test]
    fn every_type_byte_order_and_encoding() {
        let folder = Folder::new();
        let phantom = Phantom::oriented("RAS");
        let place = place(phantom.world_from_index, [-1.0, -1.0, 1.0]);
        for (element, type_name) in ALL_TYPES.into_iter().zip(TYPE_NAMES) {
            for (endian, order) in [(Endian::Little, "little"), (Endian::Big, "big")] {
                let data = encode(&phantom.values, element, endian);
                let text: String = phantom.values.iter().map(|v| format!("{v}\n")).collect();
                let hex: String = data.iter().map(|b| format!("{b:02x}")).collect();
                for (encoding, stored) in [
                    ("raw", data.clone()),
                    ("gzip", gzip(&data)),
                    ("ascii", text.into_bytes()),
                    ("hex", hex.into_bytes()),
                ] {
                    let header = format!(
                        "type: {type_name}\ndimension: 3\nspace: LPS\nsizes: 5 4 3\n{place}endian: {order}\nencoding: {encoding}\n"
                    );
                    let volume = folder.read("a.nrrd", &nrrd(&header, &stored)).unwrap();
                    Phantom::assert_in_world(&volume);
                    assert_eq!(volume.voxels.bytes_per_voxel(), element.num_bytes());
                }
            }
        }
    }

    #[test]
    fn frames_on_any_axis() {
        let folder = Folder::new();
        for frame_axis in 0..4 {
            let mut sizes = vec![5, 4, 3];
            sizes.insert(frame_axis, 2);
            let mut directions = vec!["(0.75,0,0)", "(0,1.5,0)", "(0,0,2.25)"];
            directions.insert(frame_axis, "none");
            let mut kinds = vec!["domain"; 3];
            kinds.insert(frame_axis, "list");
            let mut values = Vec::new();
            for i in 0..120 {
                let mut rest = i;
                let mut index: Vec<usize> = sizes.iter().map(|&n| (rest % n, rest /= n).0).collect();
                let frame = index.remove(frame_axis);
                values.push(phantom_value([index[0], index[1], index[2]]) + 100.0 * frame as f64);
            }
            let data = encode(&values, ElementType::U16, Endian::Big);
            let text: String = values.iter().map(|v| format!("{v} ")).collect();
            let hex: String = data.iter().map(|b| format!("{b:02x}")).collect();
            let sizes = sizes.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
            for (encoding, stored) in
                [("raw", data.clone()), ("gz", gzip(&data)), ("txt", text.into_bytes()), ("hex", hex.into_bytes())]
            {
                let header = format!(
                    "type: uint16\ndimension: 4\nspace: RAS\nsizes: {sizes}\nspace directions: {}\nkinds: {}\n\
                     space origin: (-10,20,-30.5)\nendian: big\nencoding: {encoding}\n",
                    directions.join(" "),
                    kinds.join(" "),
                );
                let path = folder.write("a.nrrd", &nrrd(&header, &stored));
                Phantom::assert_in_world(&read(&path).unwrap());
                let second = read_frame(&path, 1).unwrap();
                assert_eq!((second.num_frames, second.value(4, 3, 2), second.value(1, 0, 0)), (2, 159.0, 101.0));
                assert!(read_frame(&path, 2).unwrap_err().to_string().contains("the file has 2 frames"));
            }
        }
    }

    #[test]
    fn the_time_form_of_a_space_counts_frames() {
        let header = "type: uint8\ndimension: 4\nspace: left-posterior-superior-time\nsizes: 5 4 3 1\n\
            space directions: (-0.75,0,0,0) (0,-1.5,0,0) (0,0,2.25,0) (0,0,0,2)\nspace origin: (10,-20,-30.5,0)\nencoding: raw\n";
        Phantom::assert_in_world(&Folder::new().read("a.nrrd", &nrrd(header, &phantom_bytes())).unwrap());
    }

    #[test]
    fn spacings_without_a_space_are_ras() {
        let folder = Folder::new();
        let header = "type: uchar\ndimension: 3\nsizes: 5 4 3\nspacings: 0.5 2 nan\nencoding: raw\n";
        let volume = folder.read("a.nrrd", &nrrd(header, &phantom_bytes())).unwrap();
        assert_eq!(volume.grid.spacing_mm(), DVec3::new(0.5, 2.0, 1.0));
        assert_eq!(volume.grid.orientation_letters(), "RAS");
        assert_eq!(volume.warnings.len(), 2, "{:?}", volume.warnings);
    }

    #[test]
    fn units_become_millimeters() {
        let folder = Folder::new();
        let read_with =
            |extra: &str| folder.read("a.nrrd", &phantom_file("raw", extra, &phantom_bytes())).unwrap().grid;
        let micro = read_with("space units: \"um\" \"um\" \"um\"\n");
        assert!((micro.spacing_mm() - DVec3::new(0.75e-3, 1.5e-3, 2.25e-3)).length() < 1e-12);
        assert!((micro.world_from_index().translation.x + 0.01).abs() < 1e-12);
        assert_eq!(read_with("space units: \"m\" \"m\" \"m\"\n").spacing_mm(), DVec3::new(750.0, 1500.0, 2250.0));
        assert_eq!(read_with("space units: \"mm\" \"mm\" \"mm\"\n").spacing_mm(), DVec3::new(0.75, 1.5, 2.25));
    }

    #[test]
    fn detached_headers_and_skips() {
        let folder = Folder::new();
        let data = phantom_bytes();
        let two_lines = [b"one\ntwo\nxyz".as_slice(), &data].concat();
        let cases: [(&str, &str, Vec<u8>); 6] = [
            ("raw", "", data.clone()),
            ("raw", "byte skip: -1\n", [&[9; 33], data.as_slice()].concat()),
            ("raw", "byteskip: 33\n", [&[9; 33], data.as_slice()].concat()),
            ("raw", "line skip: 2\nbyte skip: 3\n", two_lines.clone()),
            ("gzip", "byte skip: 11\n", gzip(&two_lines)),
            ("gzip", "line skip: 1\n", [b"a line\n".as_slice(), &gzip(&data)].concat()),
        ];
        for (encoding, extra, stored) in cases {
            folder.write("voxels.bin", &stored);
            let header = phantom_file(encoding, &format!("key:=value\n{extra}data file: voxels.bin\n"), b"");
            // With and without the empty line at the end, and with Windows line ends.
            let text = String::from_utf8(header).unwrap();
            for text in [text.clone(), text.trim_end().to_owned(), text.replace('\n', "\r\n")] {
                Phantom::assert_in_world(&folder.read("a.nhdr", text.as_bytes()).unwrap());
            }
        }
        let refusal = |data_file: &str| folder.refusal("a.nhdr", &phantom_file("raw", data_file, b"a.raw\nb.raw\n"));
        assert!(refusal("data file: none.raw\n").contains("none.raw, is missing"));
        assert!(refusal("data file: LIST\n").contains("lists 0 files, where the sizes take 3"));
        assert!(refusal("datafile: a%03d.raw 1 4 1\n").contains("names 4 files, where it takes 3"));
        assert!(refusal("datafile: a%03d.raw 1 3 1\n").contains("a001.raw, is missing"));
        assert!(refusal("datafile: a%03d.raw 1 3 1 9\n").contains("a wrong number of axes"));
        // Counted from the end, the voxels may not reach into the header.
        assert!(refusal("byte skip: -1\n").contains("promises 60 bytes of voxels, but the file has 12"));
        assert!(refusal("line skip: 9999\n").contains("the header skips 9999 lines"));
    }

    #[test]
    fn what_cannot_be_read_is_refused_with_a_sentence() {
        let folder = Folder::new();
        let good = String::from_utf8(phantom_file("raw", "", b"")).unwrap();
        for (from, to, expected) in [
            ("encoding: raw", "encoding: bzip2", "compressed with bzip2"),
            ("encoding: raw", "encoding: zrl", "the encoding `zrl` is none"),
            ("encoding: raw", "content: a", "no field `encoding`"),
            ("type: uint8", "type: block", "the voxel type `block` is none"),
            ("type: uint8", "type: char", "the voxel type `char` is none"),
            ("dimension: 3", "dimension: 2", "the data have dimension 2"),
            ("dimension: 3", "dimension: 5", "the data have dimension 5"),
            ("dimension: 3", "dimension: 4", "are not 4 numbers"),
            ("sizes: 5 4 3", "sizes: 5 4", "are not 3 numbers"),
            ("sizes: 5 4 3", "sizes: 5 0 3", "are not 3 numbers"),
            ("sizes: 5 4 3", "sizes: 5 -4 3", "are not 3 numbers"),
            ("sizes: 5 4 3", "sizes: 5 4 4", "promises 80 bytes, but the file ends after 60"),
            ("sizes: 5 4 3", "sizes: 99999999999 99999999999 3", "more than any file holds"),
            ("space: RAS", "space: RAI", "the space `RAI` is none of RAS, LAS and LPS"),
            ("(0.75,0,0)", "(0.75,0)", "fewer than 3 components"),
            ("(0.75,0,0)", "none", "2 of its 3 axes are spatial"),
            ("(0.75,0,0)", "(0,0,0)", "do not span space"),
            ("(0.75,0,0)", "(inf,0,0)", "not finite"),
            ("(0.75,0,0)", "(a,0,0)", "are not 3 vectors"),
            ("space origin: (-10,20,-30.5)", "space origin: (nan,20,0)", "not finite"),
            ("space origin: (-10,20,-30.5)", "space origin: 10 20 0", "not a vector"),
            ("space: RAS", "nonsense", "the header line `nonsense` is no field"),
        ] {
            let changed = good.replacen(from, to, 1);
            assert_ne!(changed, good, "{from}");
            let refusal = folder.refusal("a.nrrd", &[changed.as_bytes(), &phantom_bytes()].concat());
            assert!(refusal.contains(expected), "{to}: {refusal}");
        }
        let text = |words: &str| folder.refusal("a.nrrd", &phantom_file("ascii", "", words.as_bytes()));
        assert!(text(&"1 ".repeat(60).replacen('1', "x", 1)).contains("voxel 0 is `x`"));
        assert!(text(&"1 ".repeat(60).replacen('1', "256", 1)).contains("voxel 0 is `256`"));
        assert!(text(&"111 ".repeat(59)).contains("the text ends after 59 of 60 voxels"));
        assert!(text("1 1").contains("promises 119 bytes"));
        assert!(folder.refusal("a.nrrd", &phantom_file("hex", "", &[b'g'; 120])).contains("no hexadecimal digit"));
        assert!(folder.refusal("a.nrrd", &gzip(good.as_bytes())).contains("the whole file is compressed"));
        let short = phantom_file("gzip", "", &gzip(&phantom_bytes()[..50]));
        assert!(folder.refusal("a.nrrd", &short).contains("ends after 50 of 60 bytes of voxels"));
    }

    #[test]
    fn damage_anywhere_gives_a_sentence() {
        torture("a.nrrd", &phantom_file("raw", "", &phantom_bytes()), 400);
        torture("a.nrrd", &phantom_file("gzip", "", &gzip(&phantom_bytes())), usize::MAX);
    }
}
