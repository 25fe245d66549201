//! MetaImage: `.mha` with the voxels attached, `.mhd` with the voxels in files of their own.
//!
//! Lines of `Key = Value` end with `ElementDataFile`. Documentation: itk.org, "MetaIO"; where it and ITK's reader differ,
//! files follow ITK, and so does this reader: the world is LPS, which becomes RAS; every N numbers of `TransformMatrix`
//! are the direction of one axis; `CenterOfRotation` moves nothing. Dimensions above the third are frames, and so are
//! components, unless they are 3 or 4 bytes: those are colors.

use std::io::BufReader;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use super::parts::{self, Part, Parts};
use super::stream::{self, ByteSource, ElementType, Endian, Pick, PickedBytes, VoxelRequest};
use super::window::Averaging;
use super::{Entry, ReadOptions, VolumeReader, absurd_size, check_frame, color_volume_of, grid_of, volume_of};
use crate::error::{Error, Result, remedies};
use crate::progress::Progress;
use crate::volume::{Modality, Orientation, Rescale, Volume};

/// A header longer than this is none; lists of files are the longest.
const MAX_HEADER_BYTES: usize = 4 << 20;

/// More lines than MetaIO knows keys, comments included.
const MAX_FIELDS: usize = 1000;

/// How a header may begin: MetaIO writes `ObjectType` or, before it, a comment; people write what they need.
const FIRST_KEYS: [&str; 5] = ["objecttype", "ndims", "comment", "objectsubtype", "dimsize"];

/// Reads MetaImage, attached and detached, in one or several data files.
pub struct MetaImageReader;

impl VolumeReader for MetaImageReader {
    fn name(&self) -> &'static str {
        "MetaImage"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["mha", "mhd"]
    }

    fn recognizes(&self, _path: &Path, head: &[u8]) -> bool {
        let head = String::from_utf8_lossy(head);
        let first = head.lines().map(str::trim).find(|l| !l.is_empty()).and_then(split_line);
        first.is_some_and(|(key, _)| FIRST_KEYS.contains(&key.as_str())) && head.contains("NDims")
    }

    fn survey(&self, path: &Path, _options: &ReadOptions, progress: &Progress) -> Result<Vec<Entry>> {
        Ok(vec![Opened::open(path, progress)?.entry])
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        Opened::open(path, progress)?.read(path, options, progress)
    }
}

/// A file whose header is understood and whose voxels are there as far as the sizes of the files tell.
struct Opened {
    entry: Entry,
    element: ElementType,
    endian: Endian,
    /// Numbers of one voxel, side by side.
    num_channels: u64,
    is_color: bool,
    source: Source,
    rescale: Rescale,
    warnings: Vec<String>,
}

/// Where the numbers come from.
enum Source {
    Binary(Parts),
    Text(ByteSource),
}

impl Opened {
    fn open(path: &Path, progress: &Progress) -> Result<Self> {
        let header = Header::read(path)?;
        let mut warnings = Vec::new();
        header.check_object(path)?;
        let sizes = header.sizes(path)?;
        let (element, is_array) = header.element_type(path)?;
        let num_channels = match header.get("elementnumberofchannels") {
            None if is_array => return Err(fault(path, "the header does not give ElementNumberOfChannels")),
            None => 1,
            Some(text) => text
                .parse()
                .ok()
                .filter(|&n: &u64| n > 0)
                .ok_or_else(|| fault(path, format!("the number of channels `{text}` is none")))?,
        };
        let is_color = matches!(num_channels, 3 | 4) && element == ElementType::U8 && header.is_binary();

        let dims: [u64; 3] = std::array::from_fn(|i| sizes.get(i).copied().unwrap_or(1));
        let all: Vec<u64> = sizes.iter().copied().chain([num_channels]).collect();
        let size = stream::size_bytes(&all, element).ok_or_else(|| absurd_size(path, &all))?;
        let (world_from_index, orientation) = header.world_from_index(path, dims, sizes.len(), &mut warnings)?;
        let (source, num_files) = header.source(path, &sizes, size, element, progress)?;
        let num_frames = sizes.iter().skip(3).product::<u64>() * if is_color { 1 } else { num_channels };
        let entry = Entry {
            key: String::new(),
            title: String::new(),
            format: if header.is_local() { "MetaImage" } else { "MetaImage, detached header" }.to_owned(),
            modality: header.modality(),
            grid: grid_of(path, dims, world_from_index)?,
            orientation,
            type_name: match (is_color, num_channels) {
                (true, 3) => "rgb",
                (true, _) => "rgba",
                _ => element.name(),
            },
            bytes_per_voxel: if is_color { 6 } else { element.num_bytes() },
            num_frames: usize::try_from(num_frames).unwrap_or(usize::MAX),
            num_files,
            is_labels: false,
            is_localizer: false,
        };
        let rescale = if is_color { Rescale::IDENTITY } else { header.rescale(path, &mut warnings)? };
        let endian = header.endian(path)?;
        Ok(Self { entry, element, endian, num_channels, is_color, source, rescale, warnings })
    }

    fn read(self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        let Self { entry, element, endian, num_channels, is_color, source, rescale, warnings } = self;
        check_frame(path, options.frame, entry.num_frames)?;
        let window = options.window.on(path, entry.grid.dims())?;
        // Components of a color make no frames.
        let channels_in_frames = if is_color { 1 } else { num_channels };
        let (time, channel) = (options.frame as u64 / channels_in_frames, options.frame as u64 % channels_in_frames);
        let count = entry.grid.num_voxels();
        let size = element.num_bytes() as u64;
        let first = time * count as u64 * num_channels + channel;
        let pick = if num_channels == 1 {
            Pick { first, run: count as u64, period: count as u64, count }
        } else {
            Pick { first, run: 1, period: num_channels, count }
        };
        let is_size_checked = matches!(&source, Source::Binary(parts) if !parts.is_compressed());
        let request = VoxelRequest { element, endian, window, averaging: Averaging::Mean, is_size_checked };
        let end = (first - channel + count as u64 * num_channels) * size;
        progress.begin("reading", if matches!(source, Source::Text(_)) { 0 } else { end });
        let fill = |voxels| volume_of(path, &entry, window, voxels, rescale, warnings.clone());
        let mut parts = match source {
            Source::Binary(parts) => parts,
            Source::Text(source) => {
                let mut text = BufReader::new(source);
                return fill(stream::read_text_voxels(&mut text, request, pick, path, progress)?);
            }
        };
        parts.skip(first * size)?;
        if is_color {
            let colors = stream::read_colors(&mut parts, num_channels as usize, window, path, progress)?;
            parts.finish()?;
            return color_volume_of(path, &entry, window, colors, warnings);
        }
        let voxels = if num_channels == 1 {
            stream::read_voxels(&mut parts, request, path, progress)?
        } else {
            stream::read_voxels(&mut PickedBytes::new(&mut parts, pick, element.num_bytes()), request, path, progress)?
        };
        parts.finish()?;
        fill(voxels)
    }
}

/// The lines of a header by key (lower case), as text.
struct Header {
    fields: Vec<(String, String)>,
    /// The lines behind `ElementDataFile = LIST`.
    files: Vec<String>,
    /// Where attached voxels begin.
    num_bytes: u64,
}

impl Header {
    fn read(path: &Path) -> Result<Self> {
        let mut source = ByteSource::open(path)?;
        let mut bytes = Vec::new();
        let mut header = Self { fields: Vec::new(), files: Vec::new(), num_bytes: 0 };
        let (mut position, mut is_list) = (0, false);
        loop {
            let Some(length) = bytes[position..].iter().position(|&b| b == b'\n') else {
                let more = if bytes.len() < MAX_HEADER_BYTES { source.read_up_to(16 << 10)? } else { Vec::new() };
                if more.is_empty() && position < bytes.len() && bytes.len() < MAX_HEADER_BYTES {
                    // The last line of a detached header may do without its end.
                    bytes.push(b'\n');
                } else if more.is_empty() {
                    break;
                }
                bytes.extend(more);
                continue;
            };
            let line = String::from_utf8_lossy(&bytes[position..position + length]).trim().to_owned();
            position += length + 1;
            if is_list {
                if !line.is_empty() {
                    header.files.push(line);
                }
                continue;
            }
            if line.is_empty() {
                continue;
            }
            let Some(field) = split_line(&line) else {
                if header.fields.is_empty() {
                    break;
                }
                let shown: String = line.chars().take(40).collect();
                let what = format!("the header line `{shown}` is no `Key = Value`");
                return Err(fault(path, what));
            };
            let is_last = field.0 == "elementdatafile";
            header.fields.push(field);
            header.num_bytes = position as u64;
            is_list = is_last && header.is_list();
            if is_last && !is_list || header.fields.len() == MAX_FIELDS {
                break;
            }
        }
        if header.fields.is_empty() || header.get("ndims").is_none() {
            return Err(Error::file(
                path,
                "this is no MetaImage file: its header has no NDims",
                remedies::DESCRIBE_VOXELS,
            ));
        }
        if header.get("elementdatafile").is_none() {
            return Err(Error::file(
                path,
                "the header does not say where the voxels are (ElementDataFile)",
                "copy or download it again",
            ));
        }
        Ok(header)
    }

    fn get(&self, key: &str) -> Option<&str> {
        self.fields.iter().find(|(k, _)| k == key).map(|(_, value)| value.as_str())
    }

    /// The value of the first of several names for one thing.
    fn first_of(&self, keys: &[&str]) -> Option<&str> {
        keys.iter().find_map(|key| self.get(key))
    }

    fn flag(&self, path: &Path, keys: &[&str], default: bool) -> Result<bool> {
        let Some(text) = self.first_of(keys) else { return Ok(default) };
        match text.to_lowercase().as_str() {
            "true" | "t" | "1" | "yes" => Ok(true),
            "false" | "f" | "0" | "no" => Ok(false),
            _ => Err(fault(path, format!("`{text}` is neither True nor False"))),
        }
    }

    /// The numbers of the first of these keys, which must be `count`.
    fn numbers(&self, path: &Path, keys: &[&str], count: usize) -> Result<Option<Vec<f64>>> {
        let Some(text) = self.first_of(keys) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
        let numbers = numbers.filter(|n| n.len() == count && n.iter().all(|v| v.is_finite()));
        let broken = || fault(path, format!("`{text}` in the header is not {count} numbers"));
        numbers.map(Some).ok_or_else(broken)
    }

    fn is_local(&self) -> bool {
        self.get("elementdatafile").is_some_and(|f| f.eq_ignore_ascii_case("local"))
    }

    fn is_list(&self) -> bool {
        let file = self.get("elementdatafile").unwrap_or_default();
        file.split_whitespace().next().is_some_and(|w| w.eq_ignore_ascii_case("list"))
    }

    fn is_binary(&self) -> bool {
        // MetaIO takes binary voxels for granted in images.
        !self.get("binarydata").is_some_and(|t| matches!(t.to_lowercase().as_str(), "false" | "f" | "0" | "no"))
    }

    fn check_object(&self, path: &Path) -> Result<()> {
        match self.get("objecttype") {
            Some(object) if !object.eq_ignore_ascii_case("image") => Err(Error::file(
                path,
                format!("this MetaIO file holds an object of type {object}, not an image"),
                "name an image",
            )),
            _ => Ok(()),
        }
    }

    /// Voxels along every dimension, 2 or more of them.
    fn sizes(&self, path: &Path) -> Result<Vec<u64>> {
        let text = self.get("ndims").unwrap_or_default();
        let num_dims = text.parse().ok().filter(|n| (2..=10).contains(n));
        let num_dims: usize = num_dims
            .ok_or_else(|| fault(path, format!("the header promises {text} dimensions, where an image has 2 to 10")))?;
        let text = self.get("dimsize").ok_or_else(|| fault(path, "the header has no DimSize"))?;
        let sizes: Option<Vec<u64>> = text.split_whitespace().map(|w| w.parse().ok().filter(|&n| n > 0)).collect();
        sizes
            .filter(|s| s.len() == num_dims)
            .ok_or_else(|| fault(path, format!("the sizes `{text}` are not {num_dims} numbers of voxels")))
    }

    /// The type of a number, and whether the header calls its voxels arrays of them.
    fn element_type(&self, path: &Path) -> Result<(ElementType, bool)> {
        let name = self.get("elementtype").ok_or_else(|| fault(path, "the header has no ElementType"))?;
        let upper = name.to_uppercase();
        let single = upper.strip_suffix("_ARRAY");
        let element = match single.unwrap_or(&upper) {
            "MET_UCHAR" => ElementType::U8,
            "MET_CHAR" => ElementType::I8,
            "MET_USHORT" => ElementType::U16,
            "MET_SHORT" => ElementType::I16,
            // Long has 32 bits in MetaIO, whatever the machine.
            "MET_UINT" | "MET_ULONG" => ElementType::U32,
            "MET_INT" | "MET_LONG" => ElementType::I32,
            "MET_ULONG_LONG" => ElementType::U64,
            "MET_LONG_LONG" => ElementType::I64,
            "MET_FLOAT" => ElementType::F32,
            "MET_DOUBLE" => ElementType::F64,
            _ => return Err(fault(path, format!("the voxel type `{name}` is none that Fabrica reads"))),
        };
        Ok((element, single.is_some()))
    }

    fn endian(&self, path: &Path) -> Result<Endian> {
        let is_big = self.flag(path, &["binarydatabyteordermsb", "elementbyteordermsb"], false)?;
        Ok(if is_big { Endian::Big } else { Endian::Little })
    }

    fn modality(&self) -> Modality {
        match self.get("modality") {
            Some("MET_MOD_CT") => Modality::Ct,
            Some("MET_MOD_MR") => Modality::Mr,
            _ => Modality::Unknown,
        }
    }

    fn rescale(&self, path: &Path, warnings: &mut Vec<String>) -> Result<Rescale> {
        let number = |key: &str, default| Ok(self.numbers(path, &[key], 1)?.map_or(default, |n| n[0]));
        let slope: f64 = number("elementtointensityfunctionslope", 1.0)?;
        let intercept: f64 = number("elementtointensityfunctionoffset", 0.0)?;
        let rescale = Rescale { slope: if slope == 0.0 { 1.0 } else { slope }, intercept };
        if rescale != Rescale::IDENTITY {
            warnings.push(format!(
                "The header rescales values by slope {slope} and offset {intercept}; programs on ITK leave that out."
            ));
        }
        Ok(rescale)
    }

    /// The affine to RAS mm of an image of `num_dims` dimensions.
    fn world_from_index(
        &self,
        path: &Path,
        dims: [u64; 3],
        num_dims: usize,
        warnings: &mut Vec<String>,
    ) -> Result<(DAffine3, Orientation)> {
        let spacing = self.spacing(path, num_dims, warnings)?;
        let mm = self.mm_per_unit(warnings);
        let place = ["offset", "position", "origin"];
        let offset = self.numbers(path, &place, num_dims)?;
        let directions = ["transformmatrix", "rotation", "orientation"];
        let matrix = self.numbers(path, &directions, num_dims * num_dims)?;
        let orientation = self.orientation(num_dims, matrix.as_deref());
        let spatial = num_dims.min(3);
        let mut columns = [DVec3::X, DVec3::Y, DVec3::Z];
        if let Some(matrix) = &matrix {
            for (axis, column) in columns.iter_mut().enumerate().take(spatial) {
                let direction = &matrix[axis * num_dims..][..spatial];
                *column = DVec3::from_array(std::array::from_fn(|i| direction.get(i).copied().unwrap_or(0.0)));
            }
            if num_dims == 2 {
                columns[2] = columns[0].cross(columns[1]);
            }
        }
        // Without a place of its own, as for plain voxels, the middle is the origin.
        let middle = || {
            let half = DVec3::from_array(dims.map(|n| (n - 1) as f64 / 2.0)) * spacing;
            -(columns[0] * half.x + columns[1] * half.y + columns[2] * half.z)
        };
        let offset = offset.map_or_else(middle, |o| {
            DVec3::from_array(std::array::from_fn(|i| o.get(i).copied().filter(|_| i < spatial).unwrap_or(0.0)))
        });
        let ras_from_lps = DMat3::from_diagonal(DVec3::new(-mm, -mm, mm));
        let matrix = DMat3::from_cols(columns[0], columns[1], columns[2]) * DMat3::from_diagonal(spacing);
        let world = DAffine3 { matrix3: ras_from_lps * matrix, translation: ras_from_lps * offset };
        Ok((world, orientation))
    }

    /// Whether the header says how the axes lie in the body. Letters without a matrix: MetaIO's documentation reads them one
    /// way, ITK's files the other; for RAI and LPS both mean LPS, as that is what writers of either mean by them. `?` is how
    /// MetaIO writes that it does not know, beside a matrix that nobody set.
    fn orientation(&self, num_dims: usize, matrix: Option<&[f64]>) -> Orientation {
        let letters = self.get("anatomicalorientation").unwrap_or_default().to_uppercase();
        let says_nothing = letters.is_empty() || letters.contains('?');
        let is_identity =
            |m: &[f64]| m.iter().enumerate().all(|(i, v)| *v == f64::from(u8::from(i % (num_dims + 1) == 0)));
        let is_stated = match matrix {
            Some(matrix) => !(letters.contains('?') && is_identity(matrix)),
            None => letters == "RAI" || letters == "LPS",
        };
        if is_stated && num_dims > 2 {
            return Orientation::Stated;
        }
        Orientation::Assumed(if says_nothing || num_dims < 3 {
            "The header does not place the volume in a patient: LPS is assumed, so left and right may be swapped."
                .to_owned()
        } else {
            format!(
                "The header names the orientation {letters} without a TransformMatrix, which programs read in opposite ways; \
                 LPS is assumed, so left and right may be swapped."
            )
        })
    }

    fn spacing(&self, path: &Path, num_dims: usize, warnings: &mut Vec<String>) -> Result<DVec3> {
        let stored = self.numbers(path, &["elementspacing", "elementsize"], num_dims)?;
        let Some(stored) = stored else {
            warnings.push("The header does not give the voxel size; 1 mm is assumed.".to_owned());
            return Ok(DVec3::ONE);
        };
        let spatial = &stored[..num_dims.min(3)];
        if spatial.contains(&0.0) {
            warnings.push("The header gives a voxel size of 0; 1 mm is assumed.".to_owned());
        }
        if spatial.iter().any(|s| *s < 0.0) {
            warnings.push("The header gives a negative voxel size; its sign is ignored.".to_owned());
        }
        let one = |i: usize| spatial.get(i).map_or(1.0, |s| if *s == 0.0 { 1.0 } else { s.abs() });
        Ok(DVec3::new(one(0), one(1), one(2)))
    }

    fn mm_per_unit(&self, warnings: &mut Vec<String>) -> f64 {
        match self.get("distanceunits").map(str::to_lowercase).as_deref() {
            None | Some("mm" | "?" | "") => 1.0,
            Some("um") => 1e-3,
            Some("cm") => 10.0,
            Some(other) => {
                warnings.push(format!("The unit of length `{other}` is not known; mm are assumed."));
                1.0
            }
        }
    }

    /// The voxels, `size` bytes decoded, and how many files they and the header are.
    fn source(
        &self,
        path: &Path,
        sizes: &[u64],
        size: u64,
        element: ElementType,
        progress: &Progress,
    ) -> Result<(Source, usize)> {
        let is_deflated = self.flag(path, &["compresseddata"], false)?;
        let paths = self.data_paths(path, sizes)?;
        let bytes_each = size / paths.len() as u64;
        let num_files = paths.len() + usize::from(!self.is_local());
        if !self.is_binary() {
            let [data] = &paths[..] else {
                return Err(fault(path, "voxels as text are in one file or behind the header"));
            };
            let mut source = ByteSource::open(data)?;
            if self.is_local() {
                source.skip(self.num_bytes, &Progress::new())?;
            }
            // Every number takes a digit and a blank.
            let least = (size / element.num_bytes() as u64).saturating_mul(2).saturating_sub(1);
            source.check_holds(least)?;
            return Ok((Source::Text(source), num_files));
        }
        if self.is_local() {
            let mut source = ByteSource::open(path)?;
            if source.is_gzip() {
                if is_deflated {
                    let what = "the whole file is compressed and its voxels are once more";
                    return Err(Error::file(path, what, "decompress it with gunzip"));
                }
                source.skip(self.num_bytes, progress)?;
                source.check_holds(size)?;
                return Ok((Source::Binary(Parts::of_source(source, size, progress)), 1));
            }
        }
        let parts = paths.into_iter().map(|data| {
            let start = self.data_start(path, &data, bytes_each, is_deflated)?;
            Ok(Part { path: data, start, is_deflated })
        });
        let parts: Vec<Part> = parts.collect::<Result<_>>()?;
        if let ([part], true, Some(text)) = (&parts[..], is_deflated, self.get("compresseddatasize")) {
            let length = std::fs::metadata(&part.path).map_err(|e| Error::io(&part.path, &e))?.len();
            let stored = length.saturating_sub(part.start);
            if text.parse().is_ok_and(|promised: u64| promised > stored) {
                return Err(Error::file(
                    &part.path,
                    format!("the header promises {text} compressed bytes, but the file ends after {stored} of them"),
                    "copy or download it again",
                ));
            }
        }
        Ok((Source::Binary(Parts::open(parts, bytes_each, progress)?), num_files))
    }

    /// Byte of a data file at which the voxels begin.
    fn data_start(&self, path: &Path, data: &Path, num_bytes: u64, is_deflated: bool) -> Result<u64> {
        let local = if self.is_local() { self.num_bytes } else { 0 };
        let Some(text) = self.get("headersize") else { return Ok(local) };
        match text.parse::<i64>() {
            Ok(0) => Ok(local),
            Ok(n @ 1..) => Ok(n.unsigned_abs()),
            Ok(-1) if !is_deflated => {
                let length = std::fs::metadata(data).map_err(|e| Error::io(data, &e))?.len();
                // A file that is too short is found out when it is asked for the bytes.
                Ok(length.checked_sub(num_bytes).map_or(0, |start| start.max(local)))
            }
            Ok(-1) => Err(fault(path, "HeaderSize -1 has no meaning for compressed voxels")),
            _ => Err(fault(path, format!("the header size `{text}` is no number of bytes"))),
        }
    }

    /// The files with the voxels, in their order, each with as many of them.
    fn data_paths(&self, path: &Path, sizes: &[u64]) -> Result<Vec<std::path::PathBuf>> {
        if self.is_local() {
            return Ok(vec![path.to_owned()]);
        }
        let text = self.get("elementdatafile").unwrap_or_default();
        let words: Vec<&str> = text.split_whitespace().collect();
        if self.is_list() {
            // Of the dimensions, those of one file may be given; else a file is a slice.
            let last = sizes.len() - 1;
            let inner = words.get(1).map_or(Some(last), |w| w.trim_end_matches(['d', 'D']).parse().ok());
            let inner = inner.filter(|n| (1..=last).contains(n)).unwrap_or(last);
            let count: u64 = sizes[inner..].iter().product();
            let given = self.files.len() as u64;
            if given != count {
                return Err(Error::file(
                    path,
                    format!("the header lists {given} files, where the sizes take {count}"),
                    "correct the list or DimSize",
                ));
            }
            return self.files.iter().map(|name| parts::data_file(path, name)).collect();
        }
        // A name may hold blanks and percent signs: a pattern is what no file is called.
        let is_file = parts::data_file(path, text).is_ok();
        if let ([pattern, range @ ..], true) = (&words[..], text.contains('%') && !is_file) {
            let count = sizes.last().copied().unwrap_or(1);
            let numbers: Option<Vec<i64>> = range.iter().map(|w| w.parse().ok()).collect();
            let numbers = numbers.filter(|n| n.len() <= 3).ok_or_else(|| {
                fault(path, format!("`{text}` is no pattern with its first number, last number and step"))
            })?;
            let first = numbers.first().copied().unwrap_or(1);
            let last = numbers.get(1).copied().unwrap_or(first.saturating_add_unsigned(count - 1));
            let step = numbers.get(2).copied().unwrap_or(1);
            let names =
                parts::files_of_pattern(pattern, [first, last, step], count).map_err(|what| fault(path, what))?;
            return names.iter().map(|name| parts::data_file(path, name)).collect();
        }
        Ok(vec![parts::data_file(path, text)?])
    }
}

/// `Key = Value` (or with a colon), the key in lower case.
fn split_line(line: &str) -> Option<(String, String)> {
    let (key, value) = line.split_once(['=', ':'])?;
    let key = key.trim();
    let is_key = !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    is_key.then(|| (key.to_lowercase(), value.trim().to_owned()))
}

fn fault(path: &Path, what: impl Into<String>) -> Error {
    Error::file(path, what, "correct the header with the program that wrote it")
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        ALL_TYPES, Folder, Phantom, all_orientations, encode, gzip, read, read_frame, torture, zlib,
    };
    use super::super::window::Window;
    use super::super::{read_labels, survey};
    use super::*;

    fn type_name(element: ElementType) -> &'static str {
        match element {
            ElementType::U8 => "MET_UCHAR",
            ElementType::I8 => "MET_CHAR",
            ElementType::U16 => "MET_USHORT",
            ElementType::I16 => "MET_SHORT",
            ElementType::U32 => "MET_UINT",
            ElementType::I32 => "MET_INT",
            ElementType::U64 => "MET_ULONG_LONG",
            ElementType::I64 => "MET_LONG_LONG",
            ElementType::F32 => "MET_FLOAT",
            ElementType::F64 => "MET_DOUBLE",
        }
    }

    /// Header lines as ITK writes them, without the last one.
    fn header(phantom: &Phantom, element: ElementType) -> String {
        let m = phantom.world_from_index;
        let lps = DVec3::new(-1.0, -1.0, 1.0);
        let columns = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis];
        let numbers = |v: DVec3| v.to_array().map(|c| c.to_string()).join(" ");
        let directions = columns.map(|c| numbers(c.normalize() * lps)).join(" ");
        let spacing = columns.map(|c| c.length().to_string()).join(" ");
        let dims = phantom.dims.map(|n| n.to_string()).join(" ");
        format!(
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nTransformMatrix = {directions}\nOffset = {}\n\
             CenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI\nElementSpacing = {spacing}\nDimSize = {dims}\n\
             ElementType = {}\n",
            numbers(m.translation * lps),
            type_name(element)
        )
    }

    fn local(header: &str, voxels: &[u8]) -> Vec<u8> {
        [header.as_bytes(), b"ElementDataFile = LOCAL\n", voxels].concat()
    }

    /// The phantom of small numbers in bytes.
    fn bytes_of(phantom: &Phantom) -> Vec<u8> {
        encode(&phantom.values, ElementType::U8, Endian::Little)
    }

    #[test]
    fn every_orientation_lies_where_itk_puts_it() {
        let folder = Folder::new();
        for letters in all_orientations() {
            let phantom = Phantom::oriented(&letters);
            let volume = folder.read("a.mha", &local(&header(&phantom, ElementType::U8), &bytes_of(&phantom))).unwrap();
            assert_eq!(volume.grid.orientation_letters(), letters);
            assert_eq!(volume.warnings, Vec::<String>::new());
            Phantom::assert_in_world(&volume);
        }
    }

    #[test]
    fn rows_of_the_matrix_are_axes() {
        // Turned by 30 degrees about z: no symmetric matrix, so that a transposed one is noticed.
        let (sin, cos) = 30_f64.to_radians().sin_cos();
        let folder = Folder::new();
        let text = format!(
            "NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\nElementSpacing = 1 2 3\nOffset = 7 8 9\n\
             TransformMatrix = {cos} {sin} 0 {} {cos} 0 0 0 1\n",
            -sin
        );
        let grid = folder.read("a.mha", &local(&text, &[0; 60])).unwrap().grid;
        let step = grid.world_from_index().transform_vector3(DVec3::X);
        assert!(step.distance(DVec3::new(-cos, -sin, 0.0)) < 1e-12, "{step}");
        assert_eq!(grid.world_from_index().translation, DVec3::new(-7.0, -8.0, 9.0));
    }

    #[test]
    fn every_type_byte_order_and_packing() {
        let folder = Folder::new();
        let phantom = Phantom::oriented("PIR");
        for element in ALL_TYPES {
            for (endian, msb) in [(Endian::Little, "False"), (Endian::Big, "True")] {
                for key in ["BinaryDataByteOrderMSB", "ElementByteOrderMSB"] {
                    let text = format!("{}{key} = {msb}\n", header(&phantom, element));
                    let voxels = encode(&phantom.values, element, endian);
                    let packed = zlib(&voxels);
                    let deflated = format!("{text}CompressedData = True\nCompressedDataSize = {}\n", packed.len());
                    folder.write("voxels.raw", &voxels);
                    folder.write("voxels.zraw", &packed);
                    for (name, bytes) in [
                        ("a.mha", local(&text, &voxels)),
                        ("b.mha", local(&deflated, &packed)),
                        ("c.mha", local(&deflated, &gzip(&voxels))),
                        ("d.mha.gz", gzip(&local(&text, &voxels))),
                        ("e.mhd", format!("{text}ElementDataFile = voxels.raw").into_bytes()),
                        ("f.mhd", format!("{deflated}ElementDataFile = voxels.zraw\n").into_bytes()),
                        ("g.mhd", format!("{text}ElementDataFile = C:\\scans\\voxels.raw\r\n").into_bytes()),
                    ] {
                        let volume = folder.read(name, &bytes).unwrap();
                        Phantom::assert_in_world(&volume);
                        assert_eq!(volume.voxels.bytes_per_voxel(), element.num_bytes(), "{name}");
                    }
                }
            }
            let digits: Vec<_> = phantom.values.iter().map(f64::to_string).collect();
            let text = header(&phantom, element).replace("BinaryData = True", "BinaryData = False");
            Phantom::assert_in_world(&folder.read("a.mha", &local(&text, digits.join(" ").as_bytes())).unwrap());
        }
    }

    #[test]
    fn slices_in_files_of_their_own() {
        let folder = Folder::new();
        let phantom = Phantom::oriented("RSA");
        let [x, y, z] = phantom.dims;
        let voxels = bytes_of(&phantom);
        let mut names = Vec::new();
        for (i, slice) in voxels.chunks(x * y).enumerate() {
            let bytes = [b"head", slice].concat();
            names.push(folder.write(&format!("s {}.raw", i + 5), &bytes).file_name().unwrap().to_owned());
            folder.write(&format!("t{:03}.raw", 2 * i + 5), &bytes);
            folder.write(&format!("u{i}.zraw"), &zlib(slice));
        }
        let list = names.iter().map(|n| n.to_string_lossy()).collect::<Vec<_>>().join("\n");
        let text = header(&phantom, ElementType::U8);
        let packed = format!("{text}CompressedData = True\n");
        let last = 2 * z + 3;
        for (name, bytes) in [
            ("a.mhd", format!("{text}HeaderSize = 4\nElementDataFile = LIST\n{list}\n")),
            ("b.mhd", format!("{text}HeaderSize = -1\nElementDataFile = LIST 2\n{list}")),
            ("c.mhd", format!("{text}HeaderSize = -1\nElementDataFile = t%03d.raw 5 {last} 2\n")),
            ("d.mhd", format!("{packed}ElementDataFile = u%d.zraw 0\n")),
        ] {
            let path = folder.write(name, bytes.as_bytes());
            Phantom::assert_in_world(&read(&path).unwrap());
            let entry = &survey(&path, &ReadOptions::default(), &Progress::new()).unwrap()[0];
            assert_eq!(entry.num_files, z + 1);
        }
        let bad = format!("{text}ElementDataFile = t%03d.raw 5 {last} 1\n");
        assert!(folder.refusal("e.mhd", bad.as_bytes()).contains("files, where it takes"));
        let short = format!("{text}ElementDataFile = LIST\nt005.raw\n");
        assert!(folder.refusal("e.mhd", short.as_bytes()).contains("lists 1 files"));
        let missing = format!("{text}ElementDataFile = t%03d.raw 6 {} 1\n", 5 + z);
        assert!(folder.refusal("e.mhd", missing.as_bytes()).contains("t006.raw, is missing"));
        let huge = "NDims = 3\nDimSize = 1 1 999999999999\nElementType = MET_UCHAR\nElementDataFile = t%d 1\n";
        assert!(folder.refusal("e.mhd", huge.as_bytes()).contains("files, where it takes"));
    }

    #[test]
    fn frames_are_further_dimensions_and_components() {
        let folder = Folder::new();
        let text = "NDims = 4\nDimSize = 2 1 1 3\nElementSpacing = 1 2 3 4\nOffset = 1 2 3 4\n\
                    TransformMatrix = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\nElementType = MET_SHORT\n";
        let voxels = |n: u32| encode(&(0..n).map(f64::from).collect::<Vec<_>>(), ElementType::I16, Endian::Little);
        let path = folder.write("a.mha", &local(text, &voxels(6)));
        let third = read_frame(&path, 2).unwrap();
        assert_eq!((third.num_frames, third.value(0, 0, 0), third.value(1, 0, 0)), (3, 4.0, 5.0));
        assert_eq!(third.grid.world_from_index().translation, DVec3::new(-1.0, -2.0, 3.0));
        assert!(read_frame(&path, 3).is_err());
        let text = format!("{text}ElementNumberOfChannels = 2\n");
        let path = folder.write("b.mha", &local(&text, &voxels(12)));
        for frame in 0..6 {
            let volume = read_frame(&path, frame).unwrap();
            let first = (frame / 2 * 4 + frame % 2) as f64;
            assert_eq!((volume.num_frames, volume.value(0, 0, 0), volume.value(1, 0, 0)), (6, first, first + 2.0));
        }
    }

    #[test]
    fn bytes_by_three_or_four_are_colors() {
        let folder = Folder::new();
        for channels in [3_u8, 4] {
            let text = format!(
                "NDims = 3\nDimSize = 2 1 2\nElementSpacing = 1 1 1\nElementNumberOfChannels = {channels}\n\
                 ElementType = MET_UCHAR_ARRAY\n"
            );
            let bytes: Vec<u8> = (0..4 * channels).collect();
            let path = folder.write("a.mha", &local(&text, &bytes));
            let alpha = |i: u8| if channels == 4 { channels * i + 3 } else { 255 };
            let pixel = |i: u8| [channels * i, channels * i + 1, channels * i + 2, alpha(i)];
            let volume = read(&path).unwrap();
            assert_eq!(volume.colors, Some([0, 1, 2, 3].map(pixel).to_vec()));
            let entry = &survey(&path, &ReadOptions::default(), &Progress::new()).unwrap()[0];
            assert_eq!(entry.type_name, if channels == 3 { "rgb" } else { "rgba" });
            assert_eq!((entry.num_frames, entry.bytes_per_voxel * 4), (1, volume.num_bytes()));
            let window = Window { crop: Some([[1, 2], [0, 1], [0, 2]]), ..Window::default() };
            let options = ReadOptions { window, ..ReadOptions::default() };
            let part = super::super::read_volume(&path, &options, &Progress::new()).unwrap();
            assert_eq!(part.colors, Some([1, 3].map(pixel).to_vec()));
        }
    }

    #[test]
    fn labels_are_not_averaged() {
        let folder = Folder::new();
        let text = "NDims = 3\nDimSize = 2 2 2\nElementSpacing = 1 1 1\nElementType = MET_UCHAR\n";
        let path = folder.write("a.mha", &local(text, &[0, 0, 0, 0, 0, 0, 0, 9]));
        let window = Window { reduce: [2; 3], ..Window::default() };
        let options = ReadOptions { window, ..ReadOptions::default() };
        let layers = read_labels(&path, &options, &Progress::new()).unwrap();
        assert_eq!(layers[0].labels[usize::from(layers[0].voxels[0])].id, 9);
    }

    #[test]
    fn an_image_of_two_dimensions_is_one_slice() {
        let folder = Folder::new();
        let text = "NDims = 2\nDimSize = 3 2\nElementSpacing = 2 4\nTransformMatrix = 0 1 -1 0\nOffset = 5 6\n\
                    ElementType = MET_UCHAR\n";
        let volume = folder.read("a.mha", &local(text, &[1, 2, 3, 4, 5, 6])).unwrap();
        assert_eq!((volume.grid.dims(), volume.value(2, 1, 0)), ([3, 2, 1], 6.0));
        let world = volume.grid.world_from_index();
        assert_eq!(world.transform_point3(DVec3::new(1.0, 1.0, 0.0)), DVec3::new(-1.0, -8.0, 0.0));
    }

    #[test]
    fn what_the_header_leaves_out_or_leaves_open_is_said() {
        let folder = Folder::new();
        let text = "NDims = 3\nDimSize = 2 1 1\nElementType = MET_UCHAR\n";
        let warnings = |more: &str| folder.read("a.mha", &local(&format!("{text}{more}"), &[1, 2])).unwrap().warnings;
        let plain = warnings("").join(" ");
        assert!(plain.contains("1 mm is assumed") && plain.contains("left and right may be swapped"), "{plain}");
        assert!(warnings("AnatomicalOrientation = RPI\n").join(" ").contains("the orientation RPI without"));
        assert!(warnings("ElementSpacing = 1 -1 0\n").join(" ").contains("sign is ignored"));
        let text = format!("{text}ElementSpacing = 1 1 1\nOffset = 0 0 0\nModality = MET_MOD_CT\nDistanceUnits = um\n");
        let rescaled = format!("{text}ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = -10\n");
        let volume = folder.read("a.mha", &local(&rescaled, &[1, 2])).unwrap();
        assert_eq!((volume.value(1, 0, 0), volume.modality), (-6.0, Modality::Ct));
        assert!((volume.grid.spacing_mm().x - 1e-3).abs() < 1e-12);
        assert!(volume.warnings.join(" ").contains("rescales"));
    }

    #[test]
    fn faults_of_the_header_get_a_sentence() {
        let folder = Folder::new();
        let text = "NDims = 3\nDimSize = 2 1 1\nElementType = MET_UCHAR\n";
        for (from, to, expected) in [
            ("NDims = 3", "NDims = 0", "promises 0 dimensions"),
            ("NDims = 3", "NDims = 2", "are not 2 numbers of voxels"),
            ("2 1 1", "2 0 1", "are not 3 numbers of voxels"),
            ("2 1 1", "3 1 1", "promises 3 bytes, but the file ends after 2"),
            ("2 1 1", "4294967296 4294967296 4294967296", "more than any file holds"),
            ("MET_UCHAR", "MET_STRING", "`MET_STRING` is none"),
            ("MET_UCHAR", "MET_UCHAR_ARRAY", "does not give ElementNumberOfChannels"),
            ("NDims", "ObjectType = Tube\nNDims", "an object of type Tube"),
            ("NDims", "TransformMatrix = 1 0 0\nNDims", "is not 9 numbers"),
            ("NDims", "TransformMatrix = 1 0 0 1 0 0 0 0 1\nNDims", "singular"),
            ("NDims", "Offset = 1 nan 0\nNDims", "is not 3 numbers"),
            ("NDims", "CompressedData = maybe\nNDims", "neither True nor False"),
            ("NDims", "CompressedData = True\nCompressedDataSize = 99\nNDims", "promises 99 compressed bytes"),
            ("NDims", "CompressedData = True\nNDims", "damaged"),
            ("NDims", "HeaderSize = -7\nNDims", "is no number of bytes"),
            ("ElementType", "nonsense\nElementType", "`nonsense` is no `Key = Value`"),
        ] {
            let refusal = folder.refusal("a.mha", &local(&text.replacen(from, to, 1), &[1, 2]));
            assert!(refusal.contains(expected), "{refusal}");
        }
        assert!(folder.refusal("a.mha", text.as_bytes()).contains("where the voxels are"));
        assert!(folder.refusal("a.mha", &[7; 1024]).contains("this is no MetaImage file"));
        let gone = format!("{text}ElementDataFile = gone.raw\n");
        assert!(folder.refusal("a.mhd", gone.as_bytes()).contains("gone.raw, is missing"));
    }

    #[test]
    fn a_bomb_costs_no_more_than_it_holds() {
        let folder = Folder::new();
        let text = "NDims = 3\nDimSize = 3000 3000 3000\nElementType = MET_FLOAT\nCompressedData = True\n";
        assert!(folder.refusal("a.mha", &local(text, &zlib(&[0; 1000]))).contains("compressed bytes can hold"));
    }

    #[test]
    fn damage_anywhere_gives_a_sentence() {
        let phantom = Phantom::oriented("RAS");
        let text = header(&phantom, ElementType::U8);
        torture("a.mha", &local(&text, &bytes_of(&phantom)), 540);
        let deflated = format!("{text}CompressedData = True\n");
        torture("a.mha", &local(&deflated, &zlib(&bytes_of(&phantom))), usize::MAX);
    }
}
