//! Styles: pictures of a lit sphere, from which a normal takes its color and its directional opacity (thesis §3.3;
//! Sloan et al. 2001). The studio shows them in its gallery; the renderer uploads each as one array layer with the
//! mips made here, and the f64 reference reads the same floats.
//!
//! Files are square PNGs or JPEGs, straight-alpha sRGB, row 0 = up, the sphere touching the edges. They come from
//! `styles/` (compiled in; made by `cargo run --release -p fabrica-engine --example make_styles`) and from a folder
//! of the user's own, where [`extract`] makes some from artwork.

pub mod extract;
pub mod file;
pub mod pattern;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use crate::color;
use crate::error::{Error, Result};
use crate::image_in;
use crate::image_out::Picture;
use file::{Slider, SliderValues, StyleFile};
use pattern::Pattern;

/// Texels a side of every loaded style. All have the same, because they are layers of one texture array.
pub const STYLE_SIZE: usize = 256;
/// Levels of a loaded style: 256² down to 1².
pub const NUM_STYLE_MIPS: usize = STYLE_SIZE.ilog2() as usize + 1;

/// A style, ready for sampling.
#[derive(Clone, Debug, PartialEq)]
pub struct StyleImage {
    /// The name that transfer functions refer to.
    pub name: String,
    /// Texels a side of level 0; a power of two.
    pub size: usize,
    /// Level 0 first, each `(size >> level)²` premultiplied linear RGBA, row 0 = up; the last is one texel.
    pub mips: Vec<Vec<[f32; 4]>>,
    /// How fast the style changes with the normal: root mean square over the disc of ‖∂c/∂n_xy‖, c being the channel of
    /// premultiplied linear RGBA that changes fastest there. 0 for a flat style, about 1 for a matte one, 27 for hatching.
    pub sharpness: f64,
    /// What color it is under any light: premultiplied linear RGBA, the mean of the disc in which colors count by the square of their
    /// luminance, as shadows say little of a material.
    pub color: [f32; 4],
    /// Unit vector, (right, up, towards the eye), in which it is brightest.
    pub light: [f32; 3],
    /// What its tone is drawn with, if it is not painted.
    pub pattern: Option<Pattern>,
}

/// What a gallery shows beside the sphere.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StyleInfo {
    /// The name that transfer functions refer to: the file's stem.
    pub name: String,
    /// Human-readable title.
    pub title: String,
    /// One line on the look and its use.
    pub description: String,
    /// Words to search by.
    #[serde(default)]
    pub tags: Vec<String>,
    /// File name, within the folder that the style comes from.
    pub file: String,
}

/// Where the center of a normal's color lies in a style image: `n_xy` = (right, up) components of the unit shading
/// normal in the ray's frame, |n_xy| ≤ 1; result (u, v) in 0…1, v downwards, (0, 0) the outer corner of the first
/// texel, as texture units take it. |n_xy| = 1 lands on the center of the outermost texel: x = n_x·(size−1)/2 + size/2,
/// y = size/2 − n_y·(size−1)/2 in texels. For the mip levels the same (u, v) is used.
pub fn uv_from_normal(n_xy: [f64; 2], size: usize) -> [f64; 2] {
    let scale = (size as f64 - 1.0) / (2.0 * size as f64);
    [0.5 + n_xy[0] * scale, 0.5 - n_xy[1] * scale]
}

/// Inverse of [`uv_from_normal`]: the n_xy whose color texture coordinate `uv` holds. |n_xy| > 1 outside the disc.
pub fn normal_from_uv(uv: [f64; 2], size: usize) -> [f64; 2] {
    let scale = 2.0 * size as f64 / (size as f64 - 1.0);
    [(uv[0] - 0.5) * scale, (0.5 - uv[1]) * scale]
}

impl StyleImage {
    /// A style from a square picture of a sphere that touches the edges: straight linear RGBA, row 0 = up. A picture of
    /// another size than [`STYLE_SIZE`] is resampled; what lies outside the disc is never used.
    ///
    /// # Errors
    /// [`Error::Scene`] if the picture is not square or smaller than 16 pixels.
    pub fn from_straight(name: &str, picture: &Picture) -> Result<Self> {
        let size = picture.width;
        if size != picture.height || size < 16 {
            return Err(Error::scene(
                format!("the style \"{name}\" has {} × {} pixels", picture.width, picture.height),
                "a style is a square picture of at least 16 pixels a side, filled by a sphere",
            ));
        }
        let mut straight = picture.pixels.clone();
        extend_radially(&mut straight, size);
        let mut level: Vec<[f32; 4]> = straight.into_iter().map(color::premultiplied_from_straight).collect();
        if size != STYLE_SIZE {
            level = resample(&level, size, STYLE_SIZE);
            // Resampled texels beyond the rim mix several directions; give them the rim's color again.
            extend_radially(&mut level, STYLE_SIZE);
        }
        Ok(Self::from_texels(name, level))
    }

    /// A style of one color for all directions: premultiplied linear RGBA.
    pub fn flat(name: &str, rgba: [f32; 4]) -> Self {
        Self::from_texels(name, vec![rgba; STYLE_SIZE * STYLE_SIZE])
    }

    fn from_texels(name: &str, texels: Vec<[f32; 4]>) -> Self {
        let sharpness = sharpness(&texels, STYLE_SIZE);
        let color = color_of(&texels, STYLE_SIZE);
        let mips = mips_of(texels, STYLE_SIZE);
        let light = light_of(&mips[LIGHT_MIP]);
        Self { name: name.to_owned(), size: STYLE_SIZE, mips, sharpness, color, light, pattern: None }
    }
}

/// [`StyleImage::color`] of a style's premultiplied texels.
fn color_of(texels: &[[f32; 4]], size: usize) -> [f32; 4] {
    let center = (size as f64 - 1.0) / 2.0;
    let is_inside = |i: usize| ((i % size) as f64 - center).hypot((i / size) as f64 - center) <= center;
    let (mut light, mut weights, mut alphas, mut count) = ([0.0; 3], 0.0, 0.0, 0.0);
    for texel in (0..texels.len()).filter(|i| is_inside(*i)).map(|i| texels[i].map(f64::from)) {
        let [r, g, b, alpha] = texel;
        alphas += alpha;
        count += 1.0;
        if alpha > 0.0 {
            let luminance = (0.2126 * r + 0.7152 * g + 0.0722 * b) / alpha;
            // Never nothing: black is a color.
            let weight = luminance * luminance + 1e-9;
            light = std::array::from_fn(|c| light[c] + weight * texel[c]);
            weights += weight * alpha;
        }
    }
    let alpha = alphas / count;
    let [r, g, b] = light.map(|c| if weights > 0.0 { (c / weights * alpha) as f32 } else { 0.0 });
    [r, g, b, alpha as f32]
}

/// The mip that lights are looked for in: highlights and noise of a texel do not matter.
const LIGHT_MIP: usize = 3;

/// [`StyleImage::light`] of a square of premultiplied texels: where it is bright on average, above its mean.
fn light_of(texels: &[[f32; 4]]) -> [f32; 3] {
    let size = texels.len().isqrt();
    let inside = (0..texels.len()).filter_map(|i| {
        let uv = [i % size, i / size].map(|n| (n as f64 + 0.5) / size as f64);
        let n = normal_from_uv(uv, size);
        let [r, g, b, _] = texels[i];
        (n[0].hypot(n[1]) <= 1.0).then_some((n, pattern::luminance([r, g, b])))
    });
    let inside: Vec<([f64; 2], f64)> = inside.collect();
    let mean = inside.iter().map(|(_, light)| light).sum::<f64>() / inside.len() as f64;
    let (mut x, mut y, mut sum) = (0.0, 0.0, 1e-9);
    for (n, light) in inside {
        let above = (light - mean).max(0.0);
        (x, y, sum) = (x + above * n[0], y + above * n[1], sum + above);
    }
    let (x, y) = (x / sum, y / sum);
    [x, y, (1.0 - x * x - y * y).max(0.0).sqrt()].map(|c| c as f32)
}

/// [`StyleImage::sharpness`] of a style's texels, by central differences.
fn sharpness(texels: &[[f32; 4]], size: usize) -> f64 {
    let center = (size as f64 - 1.0) / 2.0;
    let (mut sum, mut count) = (0.0, 0usize);
    for row in 1..size - 1 {
        for column in 1..size - 1 {
            if (column as f64 - center).hypot(row as f64 - center) > center - 1.0 {
                continue;
            }
            let at = |x: usize, y: usize, channel: usize| f64::from(texels[y * size + x][channel]);
            let steepest = (0..4)
                .map(|c| {
                    let across = at(column + 1, row, c) - at(column - 1, row, c);
                    let down = at(column, row + 1, c) - at(column, row - 1, c);
                    across * across + down * down
                })
                .fold(0.0, f64::max);
            sum += steepest;
            count += 1;
        }
    }
    // Texels per unit of n_xy, over a difference of two texels.
    (sum / count as f64).sqrt() * center / 2.0
}

/// Gives every texel outside the disc (|n_xy| > 1) the color of the outermost texel in its direction whose center is in
/// the disc, so that neither filtering nor mips mix in what is painted outside.
fn extend_radially(texels: &mut [[f32; 4]], size: usize) {
    let center = (size as f64 - 1.0) / 2.0;
    // In texels from the center; the small slack keeps the axes' last texels inside in spite of rounding.
    let is_inside = |x: f64, y: f64| x * x + y * y <= center * center * (1.0 + 1e-9);
    for row in 0..size {
        for column in 0..size {
            let (x, y) = (column as f64 - center, row as f64 - center);
            if is_inside(x, y) {
                continue;
            }
            let r = x.hypot(y);
            // Inwards from the rim by quarter texels, until the nearest texel center is in the disc.
            let mut distance = center;
            let (rim_x, rim_y) = loop {
                let near = |v: f64| (v / r * distance + center).round();
                let (rim_x, rim_y) = (near(x), near(y));
                if is_inside(rim_x - center, rim_y - center) {
                    break (rim_x as usize, rim_y as usize);
                }
                distance -= 0.25;
            };
            texels[row * size + column] = texels[rim_y * size + rim_x];
        }
    }
}

/// Resamples a square picture so that |n_xy| = 1 stays on the outermost texel centers: tent filter, as wide as the
/// coarser of the two grids.
fn resample(texels: &[[f32; 4]], old_size: usize, new_size: usize) -> Vec<[f32; 4]> {
    let ratio = (old_size as f64 - 1.0) / (new_size as f64 - 1.0);
    let radius = ratio.max(1.0);
    let taps: Vec<Vec<(usize, f32)>> = (0..new_size)
        .map(|i| {
            let center = i as f64 * ratio;
            let first = (center - radius).ceil().max(0.0) as usize;
            let last = ((center + radius).floor() as usize).min(old_size - 1);
            let weights: Vec<f64> = (first..=last).map(|k| 1.0 - (k as f64 - center).abs() / radius).collect();
            let sum: f64 = weights.iter().sum();
            (first..=last).zip(weights).map(|(k, w)| (k, (w / sum) as f32)).collect()
        })
        .collect();
    let mix = |taps: &[(usize, f32)], texel: &dyn Fn(usize) -> [f32; 4]| {
        taps.iter().fold([0.0; 4], |sum: [f32; 4], &(k, w)| {
            let t = texel(k);
            std::array::from_fn(|c| sum[c] + w * t[c])
        })
    };
    let narrowed: Vec<[f32; 4]> =
        (0..old_size * new_size).map(|i| mix(&taps[i % new_size], &|k| texels[i / new_size * old_size + k])).collect();
    (0..new_size * new_size).map(|i| mix(&taps[i / new_size], &|k| narrowed[k * new_size + i % new_size])).collect()
}

/// Box mips of a premultiplied linear picture, down to one texel.
fn mips_of(level: Vec<[f32; 4]>, size: usize) -> Vec<Vec<[f32; 4]>> {
    let mut mips = vec![level];
    let mut half = size / 2;
    while half >= 1 {
        let above = &mips[mips.len() - 1];
        let width = half * 2;
        let level = (0..half * half)
            .map(|i| {
                let first = i / half * 2 * width + i % half * 2;
                let four = [above[first], above[first + 1], above[first + width], above[first + width + 1]];
                std::array::from_fn(|c| (four[0][c] + four[1][c] + four[2][c] + four[3][c]) * 0.25)
            })
            .collect();
        mips.push(level);
        half /= 2;
    }
    mips
}

macro_rules! embedded {
    ($($name:literal),* $(,)?) => {
        /// The PNGs of `styles/`, by name. `styles/index.json` has the same names (a test compares).
        const EMBEDDED: &[(&str, &[u8])] =
            &[$(($name, include_bytes!(concat!("../../styles/", $name, ".png")))),*];
    };
}

embedded![
    "plaster",
    "clay",
    "porcelain",
    "bone",
    "cartilage",
    "skin",
    "skin_deep",
    "muscle",
    "organ",
    "brain",
    "fat",
    "vessel",
    "vein",
    "nerve",
    "lymph",
    "wax",
    "steel",
    "chrome",
    "brass",
    "bronze",
    "ink",
    "engraving",
    "pencil",
    "sepia",
    "cartoon",
    "cool_warm",
    "blueprint",
    "chalk",
    "glass",
    "xray",
    "smoke",
    "unshaded",
    "unshaded_red",
    "unshaded_ochre",
    "unshaded_green",
    "unshaded_blue",
    "watercolor_gray",
    "watercolor_bone",
    "watercolor_skin",
    "watercolor_muscle",
    "watercolor_organ",
    "watercolor_brain",
    "watercolor_fat",
    "watercolor_vessel",
    "watercolor_vein",
    "watercolor_nerve",
    "watercolor_green",
    "watercolor_veil",
    "chalk_white",
    "chalk_red",
    "chalk_blue",
    "chalk_yellow",
    "chalk_green",
    "chalk_rose",
    "chalk_veil",
    "engraving_black",
    "engraving_red",
    "engraving_blue",
    "engraving_brown",
    "ink_veil",
    "film",
    "film_soft",
    "tone_gray",
    "tone_red",
    "tone_blue",
    "tone_yellow",
    "tone_green",
    "tone_orange",
    "matte_orange",
    "matte_sky",
    "matte_green",
    "matte_yellow",
    "matte_blue",
    "matte_vermilion",
    "matte_purple",
    "plate_veil",
];

/// The style files of `styles/`, by name.
const EMBEDDED_FILES: &[(&str, &str)] = &[
    ("hatched", include_str!("../../styles/hatched.json")),
    ("cross_hatched", include_str!("../../styles/cross_hatched.json")),
    ("engraved_light", include_str!("../../styles/engraved_light.json")),
    ("engraved_curvature", include_str!("../../styles/engraved_curvature.json")),
    ("stippled", include_str!("../../styles/stippled.json")),
    ("hatched_red", include_str!("../../styles/hatched_red.json")),
    ("hatched_veil", include_str!("../../styles/hatched_veil.json")),
];

static EMBEDDED_INDEX: LazyLock<Vec<StyleInfo>> = LazyLock::new(|| {
    // A fault here is one of the build; the test of the index finds it.
    serde_json::from_str(include_str!("../../styles/index.json")).unwrap_or_default()
});

/// All styles that can be used: the embedded ones, and those of the user's folders. Images are decoded when first
/// asked for, and kept.
#[derive(Debug)]
pub struct StyleLibrary {
    entries: Vec<Entry>,
    decoded: Mutex<HashMap<String, Arc<StyleImage>>>,
}

impl Clone for StyleLibrary {
    fn clone(&self) -> Self {
        let decoded = self.decoded.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Self { entries: self.entries.clone(), decoded: Mutex::new(decoded) }
    }
}

#[derive(Clone, Debug)]
struct Entry {
    info: StyleInfo,
    source: Source,
}

#[derive(Clone, Debug)]
enum Source {
    Embedded(&'static [u8]),
    EmbeddedFile(&'static str),
    File(PathBuf),
}

impl Default for StyleLibrary {
    fn default() -> Self {
        Self::embedded()
    }
}

impl StyleLibrary {
    /// The styles that come with the program, in the gallery's order.
    pub fn embedded() -> Self {
        let entries = EMBEDDED_INDEX
            .iter()
            .filter_map(|info| {
                let (_, bytes) = EMBEDDED.iter().find(|(name, _)| *name == info.name)?;
                Some(Entry { info: info.clone(), source: Source::Embedded(bytes) })
            })
            .chain(EMBEDDED_FILES.iter().filter_map(|(name, text)| {
                let file = StyleFile::parse(name, text).ok()?;
                let info = StyleInfo {
                    name: (*name).to_owned(),
                    title: file.title,
                    description: file.description,
                    tags: file.tags,
                    file: format!("{name}.json"),
                };
                Some(Entry { info, source: Source::EmbeddedFile(text) })
            }))
            .collect();
        Self { entries, decoded: Mutex::default() }
    }

    /// Adds the PNGs, JPEGs and style files (JSON) of a folder, by file stem, in alphabetical order, pictures first; a name that is
    /// already there is replaced, in its place. The files are read when asked for, so a damaged one troubles only who uses it.
    ///
    /// # Errors
    /// [`Error::File`] if the folder cannot be listed.
    pub fn with_folder(self, folder: &Path) -> Result<Self> {
        let io_error = |error: std::io::Error| Error::io(folder, &error);
        let mut paths = Vec::new();
        for entry in fs::read_dir(folder).map_err(io_error)? {
            let path = entry.map_err(io_error)?.path();
            let is_hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
            if (image_in::is_named_as_picture(&path) || is_style_file(&path)) && !is_hidden && path.is_file() {
                paths.push(path);
            }
        }
        // A style file may be beside the picture of its name, in whose place it is then.
        paths.sort_by_key(|path| (is_style_file(path), path.clone()));
        Ok(paths.iter().fold(self, |library, path| library.with_file(path)))
    }

    /// Adds one picture or style file under its file's stem; a name that is already there is replaced, in its place. The file is read when asked
    /// for.
    pub fn with_file(mut self, path: &Path) -> Self {
        let (Some(stem), Some(file)) = (path.file_stem(), path.file_name()) else { return self };
        let name = stem.to_string_lossy().into_owned();
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let info = StyleInfo {
            name: name.clone(),
            title: name.clone(),
            description: format!("Your own style, from {}.", folder.display()),
            tags: vec!["own".to_owned()],
            file: file.to_string_lossy().into_owned(),
        };
        let entry = Entry { info, source: Source::File(path.to_owned()) };
        // Whatever was made of the old one.
        self.decoded.get_mut().unwrap_or_else(PoisonError::into_inner).clear();
        match self.entries.iter_mut().find(|old| old.info.name == name) {
            Some(old) => *old = entry,
            None => self.entries.push(entry),
        }
        self
    }

    /// Whether a style of this name comes with the program.
    pub fn is_embedded(name: &str) -> bool {
        EMBEDDED.iter().any(|(known, _)| *known == name) || EMBEDDED_FILES.iter().any(|(known, _)| *known == name)
    }

    /// All names, in the gallery's order.
    pub fn names(&self) -> Vec<&str> {
        self.entries.iter().map(|entry| entry.info.name.as_str()).collect()
    }

    /// All descriptions, in the gallery's order.
    pub fn infos(&self) -> impl ExactSizeIterator<Item = &StyleInfo> {
        self.entries.iter().map(|entry| &entry.info)
    }

    /// The description of one style.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unknown name, with the names that come near.
    pub fn info(&self, name: &str) -> Result<&StyleInfo> {
        Ok(&self.entry(name)?.info)
    }

    /// The image of a style.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unknown name, with the names that come near; [`Error::File`] if the user's file cannot be
    /// read or is not a square PNG or JPEG of at least 16 pixels a side.
    pub fn get(&self, name: &str) -> Result<Arc<StyleImage>> {
        self.with_values(name, &SliderValues::new())
    }

    /// The image of a style with these values of its sliders; those that it leaves out are the style's own.
    ///
    /// # Errors
    /// As [`StyleLibrary::get`]; [`Error::Scene`] also for a slider that the style has not, or a value beyond its ends.
    pub fn with_values(&self, name: &str, values: &SliderValues) -> Result<Arc<StyleImage>> {
        let entry = self.entry(name)?;
        let key = if values.is_empty() { name.to_owned() } else { format!("{name}\n{values:?}") };
        let decoded = || self.decoded.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(image) = decoded().get(&key) {
            return Ok(Arc::clone(image));
        }
        // Decoded without the lock: two threads may do it twice, none waits for the disk.
        let image = match (&entry.source, self.style_file(entry)?) {
            (_, Some(file)) => file.image(name, &*self.sphere(entry, &file)?, values)?,
            (_, None) if !values.is_empty() => {
                let called = values.keys().next().map_or("", String::as_str);
                return Err(Error::scene(format!("the style \"{name}\" has no slider \"{called}\""), "it has none"));
            }
            (Source::Embedded(bytes), None) => decode(name, bytes, Path::new(&entry.info.file))?,
            (Source::File(path), None) => decode(name, &fs::read(path).map_err(|e| Error::io(path, &e))?, path)?,
            (Source::EmbeddedFile(_), None) => unreachable!("a style file is one"),
        };
        let mut decoded = decoded();
        // A slider that is dragged leaves many behind.
        if decoded.keys().filter(|key| key.contains('\n')).count() >= MOST_VARIANTS {
            decoded.retain(|key, _| !key.contains('\n'));
        }
        Ok(Arc::clone(decoded.entry(key).or_insert(Arc::new(image))))
    }

    /// The sliders of a style: none of a picture.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unknown name or a style file that cannot be read.
    pub fn sliders(&self, name: &str) -> Result<Vec<Slider>> {
        Ok(self.style_file(self.entry(name)?)?.map_or_else(Vec::new, |file| file.sliders))
    }

    fn style_file(&self, entry: &Entry) -> Result<Option<StyleFile>> {
        let name = &entry.info.name;
        match &entry.source {
            Source::EmbeddedFile(text) => StyleFile::parse(name, text).map(Some),
            Source::File(path) if is_style_file(path) => {
                let text = fs::read_to_string(path).map_err(|error| Error::io(path, &error))?;
                StyleFile::parse(name, &text).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// The picture that a style file is made of: one beside it, or another style's, which is no file.
    fn sphere(&self, entry: &Entry, file: &StyleFile) -> Result<Arc<StyleImage>> {
        let (name, sphere) = (&entry.info.name, &file.sphere);
        if let Source::File(path) = &entry.source
            && image_in::is_named_as_picture(Path::new(sphere))
        {
            let path = path.with_file_name(sphere);
            let bytes = fs::read(&path).map_err(|error| Error::io(&path, &error))?;
            return Ok(Arc::new(decode(name, &bytes, &path)?));
        }
        let other = self.entry(sphere)?;
        // A style file in the place of the picture of its name may be made of that.
        if other.info.name == *name || self.style_file(other)?.is_some() {
            return Err(Error::scene(
                format!("the style \"{name}\" is made of \"{sphere}\", which is itself made of another"),
                "name a picture beside the style file, or a style that is one",
            ));
        }
        self.get(sphere)
    }

    fn entry(&self, name: &str) -> Result<&Entry> {
        self.entries.iter().find(|entry| entry.info.name == name).ok_or_else(|| {
            let near = self.near(name);
            let remedy = if near.is_empty() {
                format!("choose one of {}", self.names().join(", "))
            } else {
                format!("did you mean {}?", near.join(" or "))
            };
            Error::scene(format!("there is no style \"{name}\""), remedy)
        })
    }

    /// Up to three names that differ little from `name` or contain it.
    fn near(&self, name: &str) -> Vec<&str> {
        let wanted = name.trim().to_lowercase();
        let mut near: Vec<(usize, &str)> = self
            .entries
            .iter()
            .map(|entry| entry.info.name.as_str())
            .filter_map(|known| {
                let lower = known.to_lowercase();
                let distance = edit_distance(&wanted, &lower);
                let contains = wanted.len() >= 3 && (lower.contains(&wanted) || wanted.contains(&lower));
                (contains || distance <= 1 + wanted.chars().count() / 4).then_some((distance, known))
            })
            .collect();
        near.sort();
        near.into_iter().take(3).map(|(_, known)| known).collect()
    }
}

/// Styles with other values of their sliders that a library keeps.
const MOST_VARIANTS: usize = 32;

/// Whether a file is a style file by its name; a folder's lists of styles and themes are none.
fn is_style_file(path: &Path) -> bool {
    let is_list = path.file_name().is_some_and(|name| name == "index.json" || name == "themes.json");
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json")) && !is_list
}

/// Whether a style can be called so: the name becomes that of a file on any system.
///
/// # Errors
/// [`Error::Scene`] with what is wrong.
pub fn check_name(name: &str) -> Result<()> {
    const MOST: usize = 64;
    let is_plain = |c: char| c.is_alphanumeric() || " _-+()'.".contains(c);
    let ends_well = name.trim() == name && !name.starts_with('.') && !name.ends_with('.');
    // Devices of Windows, which no file there can be called after, whatever follows the dot.
    let stem = name.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let numbered = |s: &str| stem.strip_prefix(s).is_some_and(|n| n.len() == 1 && n != "0" && n.parse::<u8>().is_ok());
    let is_device = ["con", "prn", "aux", "nul"].contains(&stem.as_str()) || numbered("com") || numbered("lpt");
    if !name.is_empty() && name.chars().count() <= MOST && name.chars().all(is_plain) && ends_well && !is_device {
        return Ok(());
    }
    Err(Error::scene(
        format!("a style cannot be called \"{name}\""),
        format!("choose a name of up to {MOST} letters, digits, spaces, - and _"),
    ))
}

fn decode(name: &str, bytes: &[u8], path: &Path) -> Result<StyleImage> {
    let picture = image_in::decode_straight(bytes, path)?;
    StyleImage::from_straight(name, &picture).map_err(|error| match error {
        Error::Scene { what, remedy } => Error::file(path, what, remedy),
        other => other,
    })
}

/// Levenshtein distance in characters.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_out::{PngOptions, save_png};

    /// A picture whose straight red and green are n_x and n_y (0…1), outside the disc blue.
    fn normals(size: usize) -> Picture {
        let pixels = (0..size * size)
            .map(|i| {
                let uv = [(i % size) as f64 + 0.5, (i / size) as f64 + 0.5].map(|v| v / size as f64);
                let [x, y] = normal_from_uv(uv, size);
                if x * x + y * y > 1.0 + 1e-9 {
                    [0.0, 0.0, 1.0, 0.0]
                } else {
                    [(x * 0.5 + 0.5) as f32, (y * 0.5 + 0.5) as f32, 0.0, 1.0]
                }
            })
            .collect();
        Picture { width: size, height: size, pixels }
    }

    fn bilinear(image: &StyleImage, n_xy: [f64; 2]) -> [f64; 4] {
        let [u, v] = uv_from_normal(n_xy, image.size);
        let (x, y) = (u * image.size as f64 - 0.5, v * image.size as f64 - 0.5);
        let texel = |i: f64, j: f64| {
            let at = |v: f64| (v as usize).min(image.size - 1);
            image.mips[0][at(j) * image.size + at(i)].map(f64::from)
        };
        let (i, j) = (x.floor(), y.floor());
        let (fx, fy) = (x - i, y - j);
        std::array::from_fn(|c| {
            (texel(i, j)[c] * (1.0 - fx) + texel(i + 1.0, j)[c] * fx) * (1.0 - fy)
                + (texel(i, j + 1.0)[c] * (1.0 - fx) + texel(i + 1.0, j + 1.0)[c] * fx) * fy
        })
    }

    #[test]
    fn a_styles_color_is_that_of_its_lights() {
        let close = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
        assert!(close(StyleImage::flat("x", [0.2, 0.1, 0.3, 0.5]).color, [0.2, 0.1, 0.3, 0.5]));
        assert!(close(StyleImage::flat("black", [0.0, 0.0, 0.0, 1.0]).color, [0.0, 0.0, 0.0, 1.0]));
        assert!(close(StyleImage::flat("nothing", [0.0; 4]).color, [0.0; 4]));
        // Half in light, half in a tenth of it: a hundredth of the weight.
        let half =
            |i: usize| if i % STYLE_SIZE < STYLE_SIZE / 2 { [0.5, 0.4, 0.3, 1.0] } else { [0.05, 0.04, 0.03, 1.0] };
        let texels = (0..STYLE_SIZE * STYLE_SIZE).map(half).collect();
        let [r, ..] = StyleImage::from_texels("half", texels).color;
        assert!((r - (0.5 + 0.01 * 0.05) / 1.01).abs() < 1e-3, "{r}");
    }

    #[test]
    fn the_rim_lands_on_outermost_texel_centers() {
        for size in [16, 256] {
            let n = size as f64;
            assert_eq!(uv_from_normal([1.0, 0.0], size), [(n - 0.5) / n, 0.5]);
            assert_eq!(uv_from_normal([0.0, 1.0], size), [0.5, 0.5 / n]);
            assert_eq!(uv_from_normal([0.0, 0.0], size), [0.5, 0.5]);
            let [x, y] = normal_from_uv(uv_from_normal([0.3, -0.7], size), size);
            assert!((x - 0.3).abs() < 1e-12 && (y + 0.7).abs() < 1e-12);
        }
    }

    #[test]
    fn normals_come_back_at_every_size() {
        for size in [16, 100, 256, 257, 512, 1000] {
            let image = StyleImage::from_straight("n", &normals(size)).unwrap();
            assert_eq!(image.size, STYLE_SIZE);
            assert_eq!(image.mips.len(), NUM_STYLE_MIPS);
            for (level, texels) in image.mips.iter().enumerate() {
                assert_eq!(texels.len(), (STYLE_SIZE >> level).pow(2));
                assert!(texels.iter().all(|t| t[2] == 0.0 && (t[3] - 1.0).abs() < 1e-5), "{size}: blue from outside");
            }
            // The rim is radially constant beyond the last texel center, a texel of the coarser grid at most.
            let tolerance = 1.5 / (size.min(256) as f64);
            for k in 0..48 {
                let angle = f64::from(k) * 0.131;
                for r in [0.0, 0.5, 0.9, 1.0] {
                    let n = [r * angle.cos(), r * angle.sin()];
                    let [red, green, ..] = bilinear(&image, n);
                    let tolerance = if r < 0.95 && size >= 256 { 2e-3 } else { tolerance };
                    assert!((red * 2.0 - 1.0 - n[0]).abs() < 2.0 * tolerance, "{size} {n:?} {red}");
                    assert!((green * 2.0 - 1.0 - n[1]).abs() < 2.0 * tolerance, "{size} {n:?} {green}");
                }
            }
            // Symmetric, so its mean is the middle.
            let [r, g, ..] = image.mips[NUM_STYLE_MIPS - 1][0];
            assert!((r - 0.5).abs() < 1e-3 && (g - 0.5).abs() < 1e-3);
        }
    }

    #[test]
    fn mips_mix_premultiplied() {
        let mut level = vec![[0.0; 4]; 4];
        level[0] = [0.8, 0.4, 0.0, 1.0];
        assert_eq!(mips_of(level, 2)[1], [[0.2, 0.1, 0.0, 0.25]]);
        assert_eq!(StyleImage::flat("f", [0.1, 0.2, 0.3, 0.5]).mips[NUM_STYLE_MIPS - 1], [[0.1, 0.2, 0.3, 0.5]]);
    }

    #[test]
    fn the_index_has_every_style() {
        let infos: Vec<StyleInfo> = serde_json::from_str(include_str!("../../styles/index.json")).unwrap();
        let names: Vec<&str> = infos.iter().map(|info| info.name.as_str()).collect();
        let embedded: Vec<&str> = EMBEDDED.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, embedded, "run the example make_styles and list the names in embedded![]");
        let library = StyleLibrary::embedded();
        let files = EMBEDDED_FILES.iter().map(|(name, _)| *name);
        assert_eq!(library.names(), names.iter().copied().chain(files).collect::<Vec<_>>());
        assert!(names.len() >= 14);
        for info in library.infos() {
            let is_file = EMBEDDED_FILES.iter().any(|(name, _)| *name == info.name);
            assert_eq!(info.file, format!("{}.{}", info.name, if is_file { "json" } else { "png" }));
            assert!(!info.title.is_empty() && !info.description.is_empty() && !info.tags.is_empty());
            let image = library.get(&info.name).unwrap();
            assert!(Arc::ptr_eq(&image, &library.get(&info.name).unwrap()));
            assert!(image.mips.iter().flatten().flatten().all(|v| (0.0..=1.0).contains(v)), "{}", info.name);
            assert!(image.mips.iter().flatten().all(|t| t[..3].iter().all(|c| *c <= t[3])));
        }
        for (name, bytes) in EMBEDDED {
            assert!(bytes.len() < 150_000, "{name}: {} bytes", bytes.len());
        }
    }

    #[test]
    fn light_comes_from_the_top_left() {
        let library = StyleLibrary::embedded();
        for name in ["porcelain", "bone", "skin", "muscle", "clay", "brain", "wax"] {
            let image = library.get(name).unwrap();
            let light = |n: [f64; 2]| bilinear(&image, n)[..3].iter().sum::<f64>();
            assert!(light([-0.5, 0.5]) > 1.3 * light([0.5, -0.5]), "{name}");
        }
    }

    #[test]
    fn transparent_styles_are_clear_in_the_middle() {
        let library = StyleLibrary::embedded();
        for name in ["chalk", "glass", "xray"] {
            let image = library.get(name).unwrap();
            let opacity = |n: [f64; 2]| bilinear(&image, n)[3];
            assert!(opacity([0.1, -0.1]) < 0.15 && opacity([0.69, -0.69]) > 0.6, "{name}");
        }
    }

    #[test]
    fn a_folder_adds_and_shadows() {
        let folder = tempfile::tempdir().unwrap();
        let save = |name: &str, width: u32, height: u32, pixel: [f32; 4]| {
            let pixels = vec![pixel; (width * height) as usize];
            save_png(&folder.path().join(name), width, height, &pixels, &PngOptions::default()).unwrap();
        };
        save("ink.png", 16, 16, [1.0, 0.0, 0.0, 1.0]);
        save("Mine.PNG", 64, 64, [0.0, 0.5, 0.0, 0.5]);
        save("wide.png", 64, 32, [0.0; 4]);
        save("tiny.png", 15, 15, [0.0; 4]);
        fs::write(folder.path().join("broken.png"), b"no").unwrap();
        fs::write(folder.path().join("notes.txt"), b"no").unwrap();

        let count = StyleLibrary::embedded().names().len();
        let library = StyleLibrary::embedded().with_folder(folder.path()).unwrap();
        let names = library.names();
        assert_eq!(names.len(), count + 4, "{names:?}");
        assert_eq!(&names[count..], ["Mine", "broken", "tiny", "wide"]);
        assert_eq!(library.get("ink").unwrap().mips[0][9000], [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(library.info("ink").unwrap().tags, ["own"]);
        let mine = library.get("Mine").unwrap();
        assert!((mine.mips[3][5][3] - 128.0 / 255.0).abs() < 1e-6);
        let message = |name: &str| library.get(name).unwrap_err().to_string();
        assert!(message("wide").contains("64 × 32") && message("wide").ends_with("wide.png)"));
        assert!(message("tiny").contains("at least 16"));
        assert!(message("broken").contains("neither a PNG nor a JPEG"));
        assert!(StyleLibrary::embedded().with_folder(&folder.path().join("none")).is_err());
    }

    #[test]
    fn style_files_of_a_folder_are_styles_with_sliders() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
        let pixels = vec![[0.5, 0.25, 0.0, 1.0]; 256];
        save_png(&folder.path().join("ball.png"), 16, 16, &pixels, &PngOptions::default()).unwrap();
        let dots = r#""pattern": {"strokes": "stipple", "spacing_pt": 2},
            "sliders": [{"name": "Spacing", "of": "pattern.spacing_pt", "min": 1, "max": 4, "value": 2}]"#;
        write("dots.json", &format!(r#"{{"sphere": "ball.png", {dots}}}"#));
        write("ink.json", &format!(r#"{{"sphere": "plaster", {dots}}}"#));
        write("lost.json", r#"{"sphere": "nowhere.png"}"#);
        write("unknown.json", r#"{"sphere": "plasterr"}"#);
        write("nested.json", r#"{"sphere": "dots"}"#);
        write("itself.json", r#"{"sphere": "itself"}"#);
        write("broken.json", "{");
        write("index.json", "[]");
        let library = StyleLibrary::embedded().with_folder(folder.path()).unwrap();
        assert!(!library.names().contains(&"index"));
        let dots = library.get("dots").unwrap();
        assert_eq!(dots.pattern.as_ref().unwrap().spacing_pt, 2.0);
        assert!((dots.mips[0][0][0] - color::linear_from_srgb8(188)).abs() < 0.02, "{:?}", dots.mips[0][0]);
        assert_eq!(library.sliders("dots").unwrap()[0].name, "Spacing");
        let wide = SliderValues::from([("Spacing".to_owned(), 4.0)]);
        let wider = library.with_values("dots", &wide).unwrap();
        assert_eq!(wider.pattern.as_ref().unwrap().spacing_pt, 4.0);
        assert!(Arc::ptr_eq(&wider, &library.with_values("dots", &wide).unwrap()));
        assert!(library.get("ink").unwrap().pattern.is_some(), "a style file shadows a picture");
        assert_eq!(library.sliders("bone").unwrap(), []);
        assert!(library.with_values("bone", &wide).unwrap_err().to_string().contains("no slider \"Spacing\""));
        let message = |name: &str| library.get(name).unwrap_err().to_string();
        assert!(message("lost").contains("nowhere.png"), "{}", message("lost"));
        assert!(message("unknown").contains("did you mean plaster"));
        assert!(message("nested").contains("itself made of another") && message("itself").contains("itself made of"));
        assert!(message("broken").contains("the style file \"broken\" cannot be read"));
    }

    #[test]
    fn an_unknown_name_is_answered_with_near_ones() {
        let library = StyleLibrary::embedded();
        let message = |name: &str| library.get(name).unwrap_err().to_string();
        assert_eq!(message("porcelan"), "there is no style \"porcelan\"; did you mean porcelain?");
        assert!(message("Muscle").contains("did you mean muscle"));
        let all = message("zzzzzzzzzz");
        assert!(all.contains("choose one of") && all.contains("ink") && all.contains("clay"), "{all}");
        assert_eq!(edit_distance("kitten", "sitting"), 3);
    }
}
