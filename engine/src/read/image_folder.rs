//! A folder of numbered images (TIFF or PNG), each a slice; one of them stands for all.
//!
//! The slices are the files that differ in one number only, in its order. A missing number is refused, as the slices behind
//! it would lie in the wrong place. The axes are those of images ([`super::slices`]); slices are as far apart as columns.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::slices::{self, PixelKind};
use super::stream::{self, ElementType};
use super::tiff;
use super::{Entry, ReadOptions, VolumeReader, check_frame, grid_of, has_extension};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{Modality, Rescale, Volume};

/// Numbered images in a folder that a single one of them stands for; two may lie side by side for any reason.
const MIN_SIBLINGS: usize = 3;

/// Reads folders of images, and the slices that a PNG file stands for.
pub struct ImageFolderReader;

impl VolumeReader for ImageFolderReader {
    fn name(&self) -> &'static str {
        "TIFF or PNG slices"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["png"]
    }

    fn recognizes(&self, path: &Path, head: &[u8]) -> bool {
        if !head.is_empty() {
            return head.starts_with(b"\x89PNG\r\n\x1a\n");
        }
        path.is_dir() && files_of(path).is_ok_and(|(files, num_others)| files.len() > 1 && files.len() > num_others)
    }

    fn survey(&self, path: &Path, _options: &ReadOptions, progress: &Progress) -> Result<Vec<Entry>> {
        Ok(vec![Stack::open(path, progress)?.entry])
    }

    fn read(&self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        Stack::open(path, progress)?.read(path, options, progress)
    }
}

/// The images of the more frequent format, unordered, and how many other files there are. Hidden files do not count.
fn files_of(folder: &Path) -> Result<(Vec<PathBuf>, usize)> {
    let (mut tiffs, mut pngs, mut num_others) = (Vec::new(), Vec::new(), 0);
    for entry in std::fs::read_dir(folder).map_err(|e| Error::io(folder, &e))? {
        let path = entry.map_err(|e| Error::io(folder, &e))?.path();
        let is_hidden = path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(b"."));
        if is_hidden || !path.is_file() {
            continue;
        }
        let is_zipped = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
        if !is_zipped && (has_extension(&path, "tif") || has_extension(&path, "tiff")) {
            tiffs.push(path);
        } else if !is_zipped && has_extension(&path, "png") {
            pngs.push(path);
        } else {
            num_others += 1;
        }
    }
    if tiffs.len() < pngs.len() {
        std::mem::swap(&mut tiffs, &mut pngs);
    }
    Ok((tiffs, num_others + pngs.len()))
}

/// What a file with one image is.
pub enum Standing {
    /// One of these slices, which it stands for.
    Slice(Box<Stack>),
    /// By itself, with a sentence if there are others that are numbered as it is.
    Alone(Option<String>),
}

/// Whether a file with one image stands for those in its folder that are numbered as it is.
///
/// # Errors
/// [`Error::Cancelled`] on request; what makes no volume is a reason to be alone.
pub fn standing_of(path: &Path, progress: &Progress) -> Result<Standing> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let numbered = numbered_like(path, folder);
    let n = numbered.len();
    if n < MIN_SIBLINGS {
        return Ok(Standing::Alone(None));
    }
    let mut warnings = Vec::new();
    let stack = in_order(folder, numbered, &mut warnings).and_then(|files| Stack::of(path, files, warnings, progress));
    match stack {
        Ok(mut stack) => {
            stack.warnings.push(format!(
                "The file is one of {n} numbered slices in its folder, which were read as one volume; to read it alone, copy it \
                 into a folder of its own."
            ));
            Ok(Standing::Slice(Box::new(stack)))
        }
        Err(Error::Cancelled) => Err(Error::Cancelled),
        Err(Error::File { what, .. }) => Ok(Standing::Alone(Some(format!(
            "{n} images in its folder are numbered as this one, but make no volume together: {what}."
        )))),
        Err(_) => Ok(Standing::Alone(None)),
    }
}

/// The images in the folder of `path` that differ from it in one number only, itself included: the largest such set.
fn numbered_like(path: &Path, folder: &Path) -> Vec<PathBuf> {
    let is_png = has_extension(path, "png");
    let is_alike = |other: &PathBuf| {
        let is_image = ["png", "tif", "tiff"].iter().any(|e| has_extension(other, e));
        is_image && has_extension(other, "png") == is_png && other.is_file()
    };
    let names: Vec<(String, String)> = numbers_in(path).into_iter().map(|name| name.around).collect();
    let mut sets: Vec<Vec<PathBuf>> = vec![Vec::new(); names.len()];
    for other in std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).filter(is_alike) {
        for Name { around, .. } in numbers_in(&other) {
            if let Some(i) = names.iter().position(|own| *own == around) {
                sets[i].push(other.clone());
            }
        }
    }
    sets.into_iter().max_by_key(Vec::len).unwrap_or_default()
}

/// Slices whose headers are understood and fit together.
pub struct Stack {
    /// As the survey shows it.
    pub entry: Entry,
    files: Vec<PathBuf>,
    kind: PixelKind,
    warnings: Vec<String>,
}

impl Stack {
    /// Of a folder, or of what a PNG file stands for.
    fn open(path: &Path, progress: &Progress) -> Result<Self> {
        if path.is_file() {
            return match standing_of(path, progress)? {
                Standing::Slice(stack) => Ok(*stack),
                // Only a damaged file has a fault of its own.
                Standing::Alone(note) => Err(survey_png(path).err().unwrap_or_else(|| {
                    let what = note.map_or_else(
                        || "this is a single PNG picture, not a volume".to_owned(),
                        |note| format!("this is a single PNG picture: {}", note.trim_end_matches('.')),
                    );
                    Error::file(path, what, "name a folder of numbered slices, or one of them")
                })),
            };
        }
        let (files, _) = files_of(path)?;
        let mut warnings = Vec::new();
        let files = in_order(path, files, &mut warnings)?;
        Self::of(path, files, warnings, progress)
    }

    /// Of files in their order; `folder` is what the user named.
    fn of(folder: &Path, files: Vec<PathBuf>, mut warnings: Vec<String>, progress: &Progress) -> Result<Self> {
        let Some(first) = files.first() else {
            return Err(Error::file(folder, "the folder has no images", "name a folder of numbered TIFF or PNG files"));
        };
        progress.begin("looking through the folder", files.len() as u64);
        let wanted = survey(first, progress)?;
        for file in &files {
            let slice = survey(file, progress)?;
            if (slice.size, slice.kind) != (wanted.size, wanted.kind) {
                let of = |s: &tiff::Slice| format!("{} x {} pixels of {}", s.size[0], s.size[1], s.kind.name());
                return Err(Error::file(
                    file,
                    format!("this slice has {}, where the first has {}", of(&slice), of(&wanted)),
                    "keep the slices of one volume alone in their folder",
                ));
            }
            if slice.num_pages > 1 {
                return Err(Error::file(
                    file,
                    format!("this slice has {} pages", slice.num_pages),
                    "open the file itself, or keep files of one page in the folder",
                ));
            }
            progress.advance(1)?;
        }
        let [width, height] = wanted.size;
        let dims = [width, height, files.len() as u64];
        let x = wanted.spacing_mm[0];
        warnings.push(match x {
            None => "The files do not give the voxel size; 1 mm is assumed.".to_owned(),
            Some(_) => "The files do not give the distance of slices; that of the columns is assumed.".to_owned(),
        });
        let x = x.unwrap_or(1.0);
        let spacing = DVec3::new(x, wanted.spacing_mm[1].unwrap_or(x), x);
        let entry = Entry {
            key: String::new(),
            title: String::new(),
            format: if has_extension(first, "png") { "PNG slices" } else { "TIFF slices" }.to_owned(),
            modality: Modality::Unknown,
            grid: grid_of(folder, dims, slices::world_without_patient(dims, spacing))?,
            orientation: slices::no_patient(),
            type_name: wanted.kind.name(),
            bytes_per_voxel: wanted.kind.bytes_per_voxel(),
            num_frames: 1,
            num_files: files.len(),
            is_labels: false,
            is_localizer: false,
        };
        Ok(Self { entry, files, kind: wanted.kind, warnings })
    }

    /// Reads the part that the options take.
    ///
    /// # Errors
    /// If a file is damaged, or on request.
    pub fn read(self, path: &Path, options: &ReadOptions, progress: &Progress) -> Result<Volume> {
        check_frame(path, options.frame, 1)?;
        let Self { entry, files, kind, warnings } = self;
        let decode = |z: usize| {
            let file = &files[z];
            if has_extension(file, "png") { read_png(file) } else { tiff::read_slice(file, progress) }
        };
        slices::read(path, &entry, kind, Rescale::IDENTITY, warnings, options, progress, decode)
    }
}

fn survey(file: &Path, progress: &Progress) -> Result<tiff::Slice> {
    if has_extension(file, "png") { Ok(survey_png(file)?.1) } else { tiff::survey_slice(file, progress) }
}

/// The number in a name that counts, with what stands before and after it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Name {
    around: (String, String),
    number: u64,
}

/// All ways to take a name as a number and what is around it.
fn numbers_in(path: &Path) -> Vec<Name> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut names = Vec::new();
    let mut start = 0;
    while let Some(first) = name[start..].find(|c: char| c.is_ascii_digit()).map(|i| start + i) {
        let end = name[first..].find(|c: char| !c.is_ascii_digit()).map_or(name.len(), |i| first + i);
        if let Ok(number) = name[first..end].parse() {
            names.push(Name { around: (name[..first].to_owned(), name[end..].to_owned()), number });
        }
        start = end;
    }
    names
}

/// The slices in their order: the largest set of files that differ in one number only.
fn in_order(folder: &Path, files: Vec<PathBuf>, warnings: &mut Vec<String>) -> Result<Vec<PathBuf>> {
    let mut sets = std::collections::HashMap::<(String, String), Vec<(u64, PathBuf)>>::new();
    for file in &files {
        for Name { around, number } in numbers_in(file) {
            sets.entry(around).or_default().push((number, file.clone()));
        }
    }
    let largest = sets.into_iter().max_by(|(a, x), (b, y)| x.len().cmp(&y.len()).then_with(|| b.cmp(a)));
    let Some((_, mut set)) = largest.filter(|(_, set)| 2 * set.len() > files.len()) else {
        return Err(Error::file(
            folder,
            "the images in the folder are not numbered in one way, so nobody knows their order",
            "name them like slice_001.tif, slice_002.tif",
        ));
    };
    set.sort();
    let num_left_out = files.len() - set.len();
    if num_left_out > 0 {
        let kept: Vec<_> = set.iter().map(|(_, p)| p).collect();
        let left_out = files.iter().filter(|f| !kept.contains(f)).min();
        let name = left_out.and_then(|f| f.file_name()).unwrap_or_default().to_string_lossy();
        warnings.push(format!("{num_left_out} images that are not numbered like the others were left out, as {name}."));
    }
    let steps: Vec<u64> = set.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
    let step = steps.iter().copied().min().unwrap_or(1);
    if step == 0 {
        return Err(Error::file(
            folder,
            format!(
                "two images in the folder have the number {}",
                set[steps.iter().position(|s| *s == 0).unwrap_or(0)].0
            ),
            "keep the slices of one volume alone in their folder",
        ));
    }
    if let Some(i) = steps.iter().position(|s| *s != step) {
        let [first, last] = [0, set.len() - 1].map(|i| set[i].0);
        return Err(Error::file(
            folder,
            format!("of the slices {first} to {last}, number {} is missing", set[i].0 + step),
            "add it, or number the slices anew to go without",
        ));
    }
    Ok(set.into_iter().map(|(_, path)| path).collect())
}

type PngReader = png::Reader<BufReader<File>>;

/// An open PNG file and what it is as a slice.
fn survey_png(path: &Path) -> Result<(PngReader, tiff::Slice)> {
    let file = File::open(path).map_err(|e| Error::io(path, &e))?;
    let mut decoder = png::Decoder::new_with_limits(BufReader::new(file), png::Limits { bytes: 64 << 20 });
    decoder.set_transformations(png::Transformations::EXPAND);
    let reader = decoder.read_info().map_err(|e| png_error(path, &e))?;
    let (width, height) = reader.info().size();
    let kind = match reader.output_color_type() {
        (png::ColorType::Grayscale | png::ColorType::GrayscaleAlpha, png::BitDepth::Sixteen) => {
            PixelKind::Values(ElementType::U16)
        }
        (png::ColorType::Grayscale | png::ColorType::GrayscaleAlpha, _) => PixelKind::Values(ElementType::U8),
        (png::ColorType::Rgba, _) => PixelKind::Rgba,
        _ => PixelKind::Rgb,
    };
    let size = [width, height].map(u64::from);
    Ok((reader, tiff::Slice { size, kind, spacing_mm: [None; 2], num_pages: 1 }))
}

/// The pixels of a PNG file, as [`slices::read`] takes them.
fn read_png(path: &Path) -> Result<Vec<u8>> {
    let (mut reader, slice) = survey_png(path)?;
    let (color, depth) = reader.output_color_type();
    let channels = color.samples();
    let sample_bytes = if depth == png::BitDepth::Sixteen { 2 } else { 1 };
    let [width, height] = slice.size.map(|n| n as usize);
    let mut pixels = Vec::new();
    let num_bytes = width.saturating_mul(height).saturating_mul(slice.kind.num_bytes());
    // Deflate cannot pack tighter; what a header promises beyond is not there.
    let length = std::fs::metadata(path).map_err(|e| Error::io(path, &e))?.len();
    if (width as u64 * height as u64).div_ceil(8) > length.saturating_mul(1032) {
        return Err(Error::file(
            path,
            format!("the image promises {width} x {height} pixels, more than the file can hold"),
            "copy or download it again",
        ));
    }
    stream::reserve(&mut pixels, num_bytes, path)?;
    while let Some(row) = reader.next_row().map_err(|e| png_error(path, &e))? {
        for pixel in row.data().chunks_exact(channels * sample_bytes) {
            let eight_bits = |c: usize| match pixel[c * sample_bytes..][..sample_bytes] {
                [high, low] => ((u32::from(u16::from_be_bytes([high, low])) * 255 + 32767) / 65535) as u8,
                [byte] => byte,
                _ => 0,
            };
            match slice.kind {
                PixelKind::Values(_) if sample_bytes == 2 => {
                    pixels.extend(u16::from_be_bytes([pixel[0], pixel[1]]).to_ne_bytes());
                }
                PixelKind::Values(_) => pixels.push(pixel[0]),
                PixelKind::Rgb => pixels.extend([eight_bits(0), eight_bits(1), eight_bits(2), 255]),
                PixelKind::Rgba => pixels.extend([eight_bits(0), eight_bits(1), eight_bits(2), eight_bits(3)]),
            }
        }
    }
    if pixels.len() < num_bytes {
        return Err(Error::file(path, "the image ends early", "copy or download it again"));
    }
    Ok(pixels)
}

fn png_error(path: &Path, error: &png::DecodingError) -> Error {
    match error {
        png::DecodingError::IoError(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Error::io(path, e),
        _ => Error::file(path, format!("the PNG file is damaged ({error})"), "copy or download it again"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Folder, read};
    use super::super::window::Window;
    use super::super::{read_volume, survey};
    use super::*;
    use crate::volume::Voxels;

    fn png_of(width: u32, color: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let row = width as usize * color.samples() * if depth == png::BitDepth::Sixteen { 2 } else { 1 };
        let mut encoder = png::Encoder::new(&mut bytes, width, (data.len() / row) as u32);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        bytes
    }

    fn gray(data: &[u8]) -> Vec<u8> {
        png_of(2, png::ColorType::Grayscale, png::BitDepth::Eight, data)
    }

    fn tiff_of(width: u32, height: u32, data: &[u16]) -> Vec<u8> {
        let mut out = std::io::Cursor::new(Vec::new());
        let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut out).unwrap();
        encoder.write_image::<::tiff::encoder::colortype::Gray16>(width, height, data).unwrap();
        out.into_inner()
    }

    #[test]
    fn numbers_give_the_order() {
        let folder = Folder::new();
        for i in 8..12_u16 {
            folder.write(&format!("scan2_rec{i}.tif"), &tiff_of(2, 1, &[10 * i, 10 * i + 1]));
        }
        folder.write(".hidden", b"x");
        folder.write("log.txt", b"x");
        let volume = read(folder.path()).unwrap();
        assert_eq!(volume.voxels, Voxels::U16(vec![80, 81, 90, 91, 100, 101, 110, 111]));
        assert_eq!((volume.grid.dims(), volume.format.as_str()), ([2, 1, 4], "TIFF slices"));
        assert!(!volume.orientation.is_known());
        let entry = survey(folder.path(), &ReadOptions::default(), &Progress::new()).unwrap().remove(0);
        assert_eq!((entry.num_files, entry.type_name), (4, "uint16"));
        // A preview beside them is left out and named.
        folder.write("scan2_spr.tif", &tiff_of(3, 1, &[1, 2, 3]));
        let warnings = read(folder.path()).unwrap().warnings.join(" ");
        assert!(warnings.contains("left out, as scan2_spr.tif"), "{warnings}");
        let window = Window { crop: Some([[1, 2], [0, 1], [1, 3]]), ..Window::default() };
        let options = ReadOptions { window, ..ReadOptions::default() };
        let part = read_volume(folder.path(), &options, &Progress::new()).unwrap();
        assert_eq!(part.voxels, Voxels::U16(vec![91, 101]));
    }

    #[test]
    fn a_numbered_slice_stands_for_its_folder() {
        let folder = Folder::new();
        for i in 1..=4_u8 {
            folder.write(&format!("slice_{i}.png"), &gray(&[10 * i, 0]));
            folder.write(&format!("cut {i}.tif"), &tiff_of(2, 1, &[10 * u16::from(i), 1]));
        }
        for name in ["slice_3.png", "cut 2.tif"] {
            let path = folder.path().join(name);
            let volume = read(&path).unwrap();
            assert_eq!((volume.grid.dims(), volume.value(0, 0, 3)), ([2, 1, 4], 40.0), "{name}");
            let warnings = volume.warnings.join(" ");
            assert!(warnings.contains("one of 4 numbered slices in its folder"), "{warnings}");
            let entry = survey(&path, &ReadOptions::default(), &Progress::new()).unwrap().remove(0);
            assert_eq!((entry.num_files, entry.grid), (4, volume.grid));
        }
        // Of those that make no volume together, a TIFF file is one by itself, and it is said why.
        folder.write("slice_5.png", &gray(&[1, 2, 3, 4]));
        std::fs::remove_file(folder.path().join("cut 3.tif")).unwrap();
        let volume = read(&folder.path().join("cut 1.tif")).unwrap();
        assert_eq!((volume.grid.dims(), volume.value(0, 0, 0)), ([2, 1, 1], 10.0));
        let warnings = volume.warnings.join(" ");
        assert!(warnings.contains("make no volume together: of the slices 1 to 4, number 3 is missing"), "{warnings}");
        // A single PNG is a picture of something.
        let refusal = read(&folder.path().join("slice_1.png")).unwrap_err().to_string();
        assert!(refusal.contains("make no volume together: this slice has 2 x 2 pixels"), "{refusal}");
        // Two pictures are seldom a volume, and one with pages is one by itself.
        std::fs::remove_file(folder.path().join("cut 4.tif")).unwrap();
        let volume = read(&folder.path().join("cut 1.tif")).unwrap();
        assert_eq!((volume.grid.dims(), volume.warnings.iter().any(|w| w.contains("numbered"))), ([2, 1, 1], false));
        let alone = Folder::new();
        assert!(alone.refusal("picture.png", &gray(&[7, 8])).contains("a single PNG picture, not a volume"));
        assert!(alone.refusal("b.png", b"hello").contains("the PNG file is damaged"));
    }

    #[test]
    fn pngs_of_every_kind() {
        use png::{BitDepth, ColorType};
        for (color, depth, data, expected) in [
            (ColorType::Grayscale, BitDepth::Eight, &[1, 2][..], Ok(Voxels::U8(vec![1, 2, 1, 2]))),
            (ColorType::GrayscaleAlpha, BitDepth::Eight, &[1, 9, 2, 9], Ok(Voxels::U8(vec![1, 2, 1, 2]))),
            (ColorType::Grayscale, BitDepth::Sixteen, &[1, 2, 3, 4], Ok(Voxels::U16(vec![258, 772, 258, 772]))),
            (ColorType::Rgb, BitDepth::Eight, &[1, 2, 3, 4, 5, 6], Err([[1, 2, 3, 255], [4, 5, 6, 255]])),
            (ColorType::Rgba, BitDepth::Eight, &[1, 2, 3, 4, 5, 6, 7, 8], Err([[1, 2, 3, 4], [5, 6, 7, 8]])),
        ] {
            let folder = Folder::new();
            for name in ["a1.png", "a2.png"] {
                folder.write(name, &png_of(2, color, depth, data));
            }
            let volume = read(folder.path()).unwrap();
            match expected {
                Ok(voxels) => assert_eq!(volume.voxels, voxels),
                Err(colors) => assert_eq!(volume.colors.unwrap(), colors.repeat(2)),
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let folder = Folder::new();
        let refusal = || read(folder.path()).unwrap_err().to_string();
        for i in [1, 2, 3, 5] {
            folder.write(&format!("a{i:03}.png"), &gray(&[i, 0]));
        }
        assert!(refusal().contains("of the slices 1 to 5, number 4 is missing"), "{}", refusal());
        folder.write("a004.png", &gray(&[1, 2, 3, 4]));
        assert!(refusal().contains("this slice has 2 x 2 pixels of uint8, where the first has 2 x 1"), "{}", refusal());
        assert!(refusal().contains("a004.png"));
        folder.write("a004.png", &gray(&[1, 2])[..40]);
        assert!(refusal().contains("damaged"), "{}", refusal());
        folder.write("a004.png", &gray(&[1, 2]));
        assert!(read(folder.path()).is_ok());
        folder.write("a4.png", &gray(&[1, 2]));
        assert!(refusal().contains("have the number 4"), "{}", refusal());

        let unnumbered = Folder::new();
        for name in ["a.png", "b.png", "c.png"] {
            unnumbered.write(name, &gray(&[1, 2]));
        }
        assert!(read(unnumbered.path()).unwrap_err().to_string().contains("not numbered in one way"));
        let others = Folder::new();
        others.write("a1.png", &gray(&[1, 2]));
        others.write("notes.txt", b"x");
        assert!(read(others.path()).unwrap_err().to_string().contains("this is a folder without a volume"));
    }

    #[test]
    fn damage_gives_a_sentence() {
        let folder = Folder::new();
        folder.write("a1.png", &gray(&[1, 2]));
        let good = gray(&[1, 2]);
        for i in 0..good.len() {
            for value in [0, 1, 0x7f, 0xff] {
                let mut changed = good.clone();
                changed[i] = value;
                folder.write("a2.png", &changed);
                assert!(read(folder.path()).map_or(0, |v| v.num_bytes()) < 1 << 20);
            }
            folder.write("a2.png", &good[..i]);
            assert!(read(folder.path()).is_err() || i + 16 > good.len());
        }
    }
}
