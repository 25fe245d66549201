//! Files byte by byte, for what no crate writes, and files of the `tiff` crate, as a second opinion.

use std::io::Cursor;

use glam::DVec3;
use tiff::encoder::{Compression, TiffEncoder, colortype};
use tiff::tags::Predictor;

use super::super::stream::{ElementType, Endian};
use super::super::testing::{ALL_TYPES, Folder, encode, read, read_frame, torture, zlib};
use super::super::window::Window;
use super::super::{ReadOptions, read_labels, read_volume, survey};
use crate::progress::Progress;
use crate::volume::{Rescale, Voxels};

/// A value of a tag.
#[derive(Clone)]
enum Value {
    Short(Vec<u16>),
    Long(Vec<u32>),
    Ratio(u32, u32),
    Text(String),
    Bytes(Vec<u8>),
}

/// A page: its tags but for those of its strips, and the strips.
#[derive(Clone)]
struct PageFile {
    tags: Vec<(u16, Value)>,
    strips: Vec<Vec<u8>>,
    is_tiled: bool,
}

impl PageFile {
    fn new(width: u32, height: u32, bits: u16, strips: Vec<Vec<u8>>) -> Self {
        let rows = height.div_ceil(strips.len() as u32);
        let tags = vec![
            (256, Value::Long(vec![width])),
            (257, Value::Long(vec![height])),
            (258, Value::Short(vec![bits])),
            (278, Value::Long(vec![rows])),
        ];
        Self { tags, strips, is_tiled: false }
    }

    fn with(mut self, tag: u16, value: Value) -> Self {
        self.tags.retain(|(t, _)| *t != tag);
        self.tags.push((tag, value));
        self
    }

    fn code(self, tag: u16, value: u16) -> Self {
        self.with(tag, Value::Short(vec![value]))
    }
}

fn number(n: u64, width: usize, endian: Endian) -> Vec<u8> {
    let mut bytes = n.to_le_bytes()[..width].to_vec();
    if endian == Endian::Big {
        bytes.reverse();
    }
    bytes
}

/// The pages as a file: for each the strips, long values, the directory.
fn file(pages: &[PageFile], endian: Endian, is_big: bool) -> Vec<u8> {
    let offset_width = if is_big { 8 } else { 4 };
    let mut bytes = if endian == Endian::Little { b"II".to_vec() } else { b"MM".to_vec() };
    bytes.extend(number(if is_big { 43 } else { 42 }, 2, endian));
    if is_big {
        bytes.extend(number(8, 2, endian));
        bytes.extend([0; 2]);
    }
    let mut link = bytes.len();
    bytes.extend(vec![0; offset_width]);
    for page in pages {
        let mut offsets = Vec::new();
        for strip in &page.strips {
            offsets.push(bytes.len() as u32);
            bytes.extend(strip);
        }
        let counts = page.strips.iter().map(|s| s.len() as u32).collect();
        let (offset_tag, count_tag) = if page.is_tiled { (324, 325) } else { (273, 279) };
        let mut tags = page.tags.clone();
        tags.extend([(offset_tag, Value::Long(offsets)), (count_tag, Value::Long(counts))]);
        tags.sort_by_key(|(tag, _)| *tag);
        let mut entries = Vec::new();
        for (tag, value) in &tags {
            let (kind, count, data): (u64, usize, Vec<u8>) = match value {
                Value::Short(v) => (3, v.len(), v.iter().flat_map(|n| number(u64::from(*n), 2, endian)).collect()),
                Value::Long(v) => (4, v.len(), v.iter().flat_map(|n| number(u64::from(*n), 4, endian)).collect()),
                Value::Ratio(a, b) => (5, 1, [a, b].iter().flat_map(|n| number(u64::from(**n), 4, endian)).collect()),
                Value::Text(t) => (2, t.len() + 1, [t.as_bytes(), b"\0"].concat()),
                Value::Bytes(b) => (7, b.len(), b.clone()),
            };
            entries.extend(number(u64::from(*tag), 2, endian));
            entries.extend(number(kind, 2, endian));
            entries.extend(number(count as u64, offset_width, endian));
            let mut inline = data;
            if inline.len() > offset_width {
                let at = bytes.len() as u64;
                bytes.extend(&inline);
                inline = number(at, offset_width, endian);
            }
            inline.resize(offset_width, 0);
            entries.extend(inline);
        }
        let at = number(bytes.len() as u64, offset_width, endian);
        bytes[link..link + offset_width].copy_from_slice(&at);
        bytes.extend(number(tags.len() as u64, if is_big { 8 } else { 2 }, endian));
        bytes.extend(entries);
        link = bytes.len();
        bytes.extend(vec![0; offset_width]);
    }
    bytes
}

fn little(pages: &[PageFile]) -> Vec<u8> {
    file(pages, Endian::Little, false)
}

/// A gray page of bytes.
fn gray(width: u32, bytes: &[u8]) -> PageFile {
    PageFile::new(width, bytes.len() as u32 / width, 8, vec![bytes.to_vec()])
}

fn described(text: &str, pages: usize) -> Vec<u8> {
    let mut all: Vec<_> = (0..pages as u8).map(|i| gray(2, &[4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3])).collect();
    all[0] = all[0]
        .clone()
        .with(270, Value::Text(text.to_owned()))
        .with(282, Value::Ratio(2, 1))
        .with(283, Value::Ratio(4, 1));
    little(&all)
}

#[test]
fn every_type_byte_order_and_size_of_offsets() {
    let folder = Folder::new();
    let values: Vec<f64> = (0..24).map(f64::from).collect();
    for element in ALL_TYPES {
        let (format, bits) = match element {
            ElementType::F32 | ElementType::F64 => (3, 8 * element.num_bytes()),
            ElementType::I8 | ElementType::I16 | ElementType::I32 | ElementType::I64 => (2, 8 * element.num_bytes()),
            _ => (1, 8 * element.num_bytes()),
        };
        for (endian, is_big) in
            [(Endian::Little, false), (Endian::Big, false), (Endian::Little, true), (Endian::Big, true)]
        {
            let pages: Vec<_> = values
                .chunks(6)
                .map(|slice| {
                    let strips = slice.chunks(3).map(|row| encode(row, element, endian)).collect();
                    PageFile::new(3, 2, bits as u16, strips).code(339, format)
                })
                .collect();
            let volume = folder.read("a.tif", &file(&pages, endian, is_big)).unwrap();
            assert_eq!(volume.grid.dims(), [3, 2, 4]);
            assert_eq!(volume.voxels.type_name(), element.name());
            assert_eq!((volume.value(1, 0, 0), volume.value(0, 1, 2), volume.value(2, 1, 3)), (1.0, 15.0, 23.0));
            assert_eq!(volume.format, if is_big { "BigTIFF" } else { "TIFF" });
        }
    }
}

#[test]
fn axes_are_those_of_axial_images_and_not_mirrored() {
    let folder = Folder::new();
    let volume = folder.read("a.tif", &little(&[gray(3, &[0; 6]), gray(3, &[0; 6])])).unwrap();
    assert_eq!(volume.grid.orientation_letters(), "LPS");
    assert!(volume.grid.world_from_index().matrix3.determinant() > 0.0);
    let middle = volume.grid.world_from_index().transform_point3(DVec3::new(1.0, 0.5, 0.5));
    assert!(middle.length() < 1e-12);
    let warnings = volume.warnings.join(" ");
    assert!(!volume.orientation.is_known());
    assert!(warnings.contains("no patient space") && warnings.contains("1 mm is assumed"), "{warnings}");
}

fn encoder(
    out: &mut Cursor<Vec<u8>>,
    compression: Compression,
    predictor: Predictor,
) -> TiffEncoder<&mut Cursor<Vec<u8>>, tiff::encoder::TiffKindStandard> {
    TiffEncoder::new(out).unwrap().with_compression(compression).with_predictor(predictor)
}

#[test]
fn what_the_tiff_crate_writes_is_read() {
    let folder = Folder::new();
    let (width, height) = (37, 21);
    let bytes: Vec<u8> = (0..width * height).map(|i| (i * i / 7) as u8).collect();
    let words: Vec<u16> = (0..width * height).map(|i| (i * 77) as u16).collect();
    let floats: Vec<f32> = (0..width * height).map(|i| (i as f32).sin()).collect();
    let colors: Vec<u8> = (0..width * height * 3).map(|i| (i * 5) as u8).collect();
    for compression in
        [Compression::Uncompressed, Compression::Lzw, Compression::Deflate(Default::default()), Compression::Packbits]
    {
        for predictor in [Predictor::None, Predictor::Horizontal] {
            let read = |out: Cursor<Vec<u8>>| folder.read("a.tif", &out.into_inner()).unwrap();
            let mut out = Cursor::new(Vec::new());
            encoder(&mut out, compression, predictor).write_image::<colortype::Gray8>(width, height, &bytes).unwrap();
            assert_eq!(read(out).voxels, Voxels::U8(bytes.clone()));
            let mut out = Cursor::new(Vec::new());
            encoder(&mut out, compression, predictor).write_image::<colortype::Gray16>(width, height, &words).unwrap();
            assert_eq!(read(out).voxels, Voxels::U16(words.clone()));
            let mut out = Cursor::new(Vec::new());
            encoder(&mut out, compression, predictor).write_image::<colortype::RGB8>(width, height, &colors).unwrap();
            let expected: Vec<_> = colors.chunks(3).map(|c| [c[0], c[1], c[2], 255]).collect();
            assert_eq!(read(out).colors, Some(expected));
            if predictor == Predictor::None {
                let mut out = Cursor::new(Vec::new());
                encoder(&mut out, compression, predictor)
                    .write_image::<colortype::Gray32Float>(width, height, &floats)
                    .unwrap();
                assert_eq!(read(out).voxels, Voxels::F32(floats.clone()));
            }
        }
    }
}

#[test]
fn the_floating_point_predictor() {
    // 1.0 and 2.0 are 3f800000 and 40000000: the highest bytes first, as differences.
    let shuffled = [0x3f_u8, 0x40, 0x80, 0, 0, 0, 0, 0];
    let mut differences = shuffled;
    (1..8).for_each(|i| differences[i] = shuffled[i].wrapping_sub(shuffled[i - 1]));
    let page = PageFile::new(2, 1, 32, vec![zlib(&differences)]).code(339, 3).code(259, 8).code(317, 3);
    for endian in [Endian::Little, Endian::Big] {
        let volume = Folder::new().read("a.tif", &file(std::slice::from_ref(&page), endian, false)).unwrap();
        assert_eq!(volume.voxels, Voxels::F32(vec![1.0, 2.0]));
    }
}

#[test]
fn few_bits_and_white_at_zero() {
    let folder = Folder::new();
    let read = |page: PageFile| folder.read("a.tif", &little(&[page])).unwrap().voxels;
    let two_rows = |bits, rows: [&[u8]; 2]| PageFile::new(3, 2, bits, rows.map(<[u8]>::to_vec).to_vec());
    assert_eq!(read(two_rows(1, [&[0b1010_0000], &[0b0110_0000]])), Voxels::U8(vec![1, 0, 1, 0, 1, 1]));
    assert_eq!(read(two_rows(4, [&[0x12, 0x30], &[0xab, 0xc0]])), Voxels::U8(vec![1, 2, 3, 10, 11, 12]));
    let twelve = two_rows(12, [&[0x12, 0x3a, 0xbc, 0xff, 0xf0], &[0, 0, 0, 0, 0]]);
    assert_eq!(read(twelve), Voxels::U16(vec![0x123, 0xabc, 0xfff, 0, 0, 0]));
    let half = PageFile::new(1, 1, 16, vec![vec![0, 0x3e]]).code(339, 3);
    assert_eq!(read(half), Voxels::F32(vec![1.5]));
    assert_eq!(read(two_rows(1, [&[0b1010_0000], &[0b0110_0000]]).code(262, 0)), Voxels::U8(vec![0, 1, 0, 1, 0, 0]));
    assert_eq!(read(gray(2, &[0, 255, 1, 7]).code(262, 0)), Voxels::U8(vec![255, 0, 254, 248]));
}

#[test]
fn colors_of_every_kind() {
    let folder = Folder::new();
    let read = |page: PageFile| folder.read("a.tif", &little(&[page])).unwrap();
    let rgb = |bits: u16, samples: usize, bytes: &[u8]| {
        let page = PageFile::new(2, 1, bits, vec![bytes.to_vec()]).code(262, 2).code(277, samples as u16);
        page.with(258, Value::Short(vec![bits; samples]))
    };
    let colors = |page: PageFile| read(page).colors.unwrap();
    assert_eq!(colors(rgb(8, 3, &[1, 2, 3, 4, 5, 6])), [[1, 2, 3, 255], [4, 5, 6, 255]]);
    let four = rgb(8, 4, &[1, 2, 3, 9, 10, 20, 30, 100]);
    assert_eq!(colors(four.clone()), [[1, 2, 3, 255], [10, 20, 30, 255]]);
    assert_eq!(colors(four.clone().code(338, 2)), [[1, 2, 3, 9], [10, 20, 30, 100]]);
    assert_eq!(colors(four.code(338, 1)), [[28, 57, 85, 9], [26, 51, 77, 100]]);
    let deep = read(rgb(16, 3, &[0, 0, 0xff, 0xff, 0, 0x80, 1, 1, 2, 2, 3, 3]));
    assert_eq!(deep.colors.unwrap(), [[0, 255, 128, 255], [1, 2, 3, 255]]);
    assert!(deep.warnings.join(" ").contains("of which 8 are kept"));
    let mut planar = rgb(8, 3, &[]).code(284, 2);
    planar.strips = vec![vec![1, 4], vec![2, 5], vec![3, 6]];
    assert_eq!(colors(planar), [[1, 2, 3, 255], [4, 5, 6, 255]]);
    // Two bits, four colors: black, red, half-bright green, white.
    let table = [0, 0xffff, 0, 0xffff, 0, 0, 0x8080, 0xffff, 0, 0, 0, 0xffff];
    let palette = PageFile::new(4, 1, 2, vec![vec![0b0001_1011]]).code(262, 3).with(320, Value::Short(table.to_vec()));
    let painted = read(palette.clone());
    assert_eq!(painted.colors.unwrap(), [[0, 0, 0, 255], [255, 0, 0, 255], [0, 128, 0, 255], [255; 4]]);
    assert!(painted.warnings.join(" ").contains("colors of a table"));
    let ramp: Vec<u16> = [0, 100, 200, 300].repeat(3);
    assert_eq!(read(palette.clone().with(320, Value::Short(ramp))).voxels, Voxels::U8(vec![0, 1, 2, 3]));
    let short = palette.with(320, Value::Short(vec![0; 11]));
    assert!(folder.refusal("a.tif", &little(&[short])).contains("too short"));
}

#[test]
fn tiles_and_planes_are_put_together() {
    let folder = Folder::new();
    // 20 x 18 in tiles of 16: two across and two down, padded with 99.
    let at = |x: usize, y: usize| if x < 20 && y < 18 { (x + 7 * y) as u8 } else { 99 };
    let tile = |tx: usize, ty: usize| (0..256).map(|i| at(16 * tx + i % 16, 16 * ty + i / 16)).collect::<Vec<u8>>();
    let mut page = PageFile::new(20, 18, 8, vec![tile(0, 0), tile(1, 0), tile(0, 1), tile(1, 1)]);
    page.is_tiled = true;
    let page = page.code(322, 16).code(323, 16);
    let volume = folder.read("a.tif", &little(&[page])).unwrap();
    let expected = (0..360).map(|i| at(i % 20, i / 20)).collect();
    assert_eq!(volume.voxels, Voxels::U8(expected));
    // Components of gray are frames.
    let two = PageFile::new(2, 1, 8, vec![vec![1, 10, 2, 20]]).code(277, 2).with(258, Value::Short(vec![8, 8]));
    let mut planar = two.clone().code(284, 2);
    planar.strips = vec![vec![1, 2], vec![10, 20]];
    for page in [two.clone(), planar] {
        let path = folder.write("a.tif", &little(&[page]));
        assert_eq!((read(&path).unwrap().voxels, read(&path).unwrap().num_frames), (Voxels::U8(vec![1, 2]), 2));
        assert_eq!(read_frame(&path, 1).unwrap().voxels, Voxels::U8(vec![10, 20]));
    }
    // But alpha beside gray is none.
    assert_eq!(folder.read("a.tif", &little(&[two.code(338, 2)])).unwrap().num_frames, 1);
}

/// 8 x 8 gray pixels 0, 4, 8, ..., by libjpeg.
const JPEG_RAMP: &str = "\
    ffd8ffe000104a46494600010100000100010000ffdb00430001010101010101010101010101010101010101010101010101\
    010101010101010101010101010101010101010101010101010101010101010101010101010101ffc0000b08000800080101\
    1100ffc40014000100000000000000000000000000000005ffc4001c100000060300000000000000000000000000070a2634\
    45526371ffda0008010100003f003cb64dc4761635bcd43fffd9";

/// 8 x 8 pixels of sRGB 200, 40, 90, by libjpeg.
const JPEG_RED: &str = "\
    ffd8ffe000104a46494600010100000100010000ffdb00430002010101010102010101020202020204030202020205040403\
    04060506060605060606070908060709070606080b08090a0a0a0a0a06080b0c0b0a0c090a0a0affdb004301020202020202\
    050303050a0706070a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a0a\
    0a0a0a0a0a0a0a0affc00011080008000803011100021101031101ffc40014000100000000000000000000000000000008ff\
    c40014100100000000000000000000000000000000ffc4001501010100000000000000000000000000000409ffc400141101\
    00000000000000000000000000000000ffda000c03010002110311003f003b8ea60fffd9";

#[test]
fn jpeg_strips() {
    let hex = |text: &str| -> Vec<u8> {
        (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).unwrap()).collect()
    };
    let folder = Folder::new();
    let ramp = PageFile::new(8, 8, 8, vec![hex(JPEG_RAMP)]).code(259, 7);
    let Voxels::U8(voxels) = folder.read("a.tif", &little(std::slice::from_ref(&ramp))).unwrap().voxels else {
        panic!()
    };
    assert!(voxels.iter().enumerate().all(|(i, v)| v.abs_diff(4 * i as u8) <= 2), "{voxels:?}");
    let plain = PageFile::new(8, 8, 8, vec![hex(JPEG_RED)]).code(259, 7).code(277, 3).code(262, 6);
    let plain = plain.with(258, Value::Short(vec![8; 3]));
    let colors = folder.read("a.tif", &little(&[plain])).unwrap().colors.unwrap();
    assert!(
        colors.iter().all(|c| c.iter().zip([200, 40, 90, 255]).all(|(a, b)| a.abs_diff(b) <= 3)),
        "{:?}",
        colors[0]
    );
    // The tables apart: everything before the frame header.
    let whole = hex(JPEG_RAMP);
    let split = whole.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    let tables = [&whole[..split], &[0xff, 0xd9]].concat();
    let mut apart = ramp.with(347, Value::Bytes(tables));
    apart.strips = vec![[&[0xff, 0xd8], &whole[split..]].concat()];
    assert_eq!(folder.read("a.tif", &little(&[apart.clone()])).unwrap().voxels, Voxels::U8(voxels));
    let other = PageFile::new(9, 8, 8, apart.strips.clone()).code(259, 7);
    assert!(folder.refusal("a.tif", &little(&[other])).contains("damaged"));
    torture("a.tif", &little(&[apart]), usize::MAX);
}

#[test]
fn hyperstacks_of_imagej() {
    let folder = Folder::new();
    let text = "ImageJ=1.53t\nimages=12\nchannels=2\nslices=3\nframes=2\nhyperstack=true\nunit=micron\nspacing=2.5\n";
    let path = folder.write("a.tif", &described(text, 12));
    let entry = survey(&path, &ReadOptions::default(), &Progress::new()).unwrap().remove(0);
    assert_eq!((entry.format.as_str(), entry.num_frames, entry.grid.dims()), ("ImageJ TIFF", 4, [2, 2, 3]));
    let spacing = entry.grid.spacing_mm();
    assert!(spacing.distance(DVec3::new(0.5e-3, 0.25e-3, 2.5e-3)) < 1e-12, "{spacing}");
    // Page = channel + 2 * (slice + 3 * time); frame = channel + 2 * time.
    for frame in 0..4 {
        let volume = read_frame(&path, frame).unwrap();
        for z in 0..3 {
            let page = frame % 2 + 2 * (z + 3 * (frame / 2));
            assert_eq!(volume.value(1, 0, z), (4 * page + 1) as f64);
        }
    }
    assert!(read_frame(&path, 4).is_err());
    // Signed 16-bit numbers, as ImageJ keeps them.
    let text = "ImageJ=1.53t\nimages=2\nslices=2\ncf=0\nc0=-32768.0\nc1=1.0\nvunit=Gray Value\n";
    let volume = folder.read("a.tif", &described(text, 2)).unwrap();
    assert_eq!((volume.rescale, volume.value(0, 0, 1)), (Rescale { slope: 1.0, intercept: -32768.0 }, -32764.0));
    let odd = folder.read("a.tif", &described("ImageJ=1.53t\nimages=4\nslices=3\n", 4)).unwrap();
    assert_eq!(odd.grid.dims(), [2, 2, 4]);
    assert!(odd.warnings.join(" ").contains("each is taken as a slice"));
}

#[test]
fn stacks_with_a_single_directory() {
    let folder = Folder::new();
    let text = "ImageJ=1.53t\nimages=3\nslices=3\n";
    // The pixels of all images stand at the end of the file, as ImageJ puts them.
    let mut bytes = little(&[PageFile::new(2, 2, 16, vec![vec![]]).with(270, Value::Text(text.to_owned()))]);
    let entry =
        |bytes: &[u8], tag: u16| bytes.windows(4).position(|w| w == [tag as u8, (tag >> 8) as u8, 4, 0]).unwrap();
    let (offset, count, end) = (entry(&bytes, 273), entry(&bytes, 279), bytes.len() as u32);
    bytes[offset + 8..offset + 12].copy_from_slice(&end.to_le_bytes());
    bytes[count + 8..count + 12].copy_from_slice(&8_u32.to_le_bytes());
    bytes.extend((0..12_u16).flat_map(u16::to_le_bytes));
    let volume = folder.read("a.tif", &bytes).unwrap();
    assert_eq!(volume.voxels, Voxels::U16((0..12).collect()));
    bytes.pop();
    assert!(folder.refusal("a.tif", &bytes).contains("says that it has 3 images, but holds one"));
}

#[test]
fn sizes_of_ome() {
    let folder = Folder::new();
    let text = "<?xml version=\"1.0\"?><OME><Image><Pixels ID=\"Pixels:0\" DimensionOrder=\"XYZTC\" SizeC=\"2\" SizeT=\"1\" \
                SizeX=\"2\" SizeY=\"2\" SizeZ=\"3\" PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.5\" PhysicalSizeZ=\"0.002\" \
                PhysicalSizeZUnit=\"mm\"><TiffData/></Pixels></Image></OME>";
    let path = folder.write("a.ome.tif", &described(text, 6));
    let volume = read_frame(&path, 1).unwrap();
    assert_eq!((volume.format.as_str(), volume.num_frames, volume.grid.dims()), ("OME-TIFF", 2, [2, 2, 3]));
    assert!(volume.grid.spacing_mm().distance(DVec3::new(0.5e-3, 0.5e-3, 2e-3)) < 1e-12);
    assert_eq!(volume.value(0, 0, 1), 16.0);
}

#[test]
fn resolution_in_centimeters_is_a_size_and_that_of_prints_is_none() {
    let folder = Folder::new();
    let spacing = |x: u32, y: u32, unit: u16| {
        let page = gray(2, &[0; 4]).with(282, Value::Ratio(x, 1)).with(283, Value::Ratio(y, 1)).code(296, unit);
        folder.read("a.tif", &little(&[page])).unwrap().grid.spacing_mm()
    };
    assert!(spacing(1000, 500, 3).distance(DVec3::new(0.01, 0.02, 0.01)) < 1e-12);
    assert!(spacing(2540, 2540, 2).distance(DVec3::splat(0.01)) < 1e-12);
    assert_eq!(spacing(300, 300, 2), DVec3::ONE);
    assert_eq!(spacing(72, 72, 2), DVec3::ONE);
}

#[test]
fn thumbnails_are_left_out_and_other_sizes_are_refused() {
    let folder = Folder::new();
    let pages = [gray(2, &[1, 2, 3, 4]), gray(1, &[9]).with(254, Value::Long(vec![1])), gray(2, &[5, 6, 7, 8])];
    let volume = folder.read("a.tif", &little(&pages)).unwrap();
    assert_eq!(volume.voxels, Voxels::U8((1..=8).collect()));
    assert!(volume.warnings.join(" ").contains("1 pages that are smaller copies"));
    let pages = [gray(2, &[1, 2, 3, 4]), gray(2, &[1, 2, 3, 4]), gray(1, &[9])];
    assert!(
        folder
            .refusal("a.tif", &little(&pages))
            .contains("page 3 has 1 x 1 pixels of 8 bits, where the first has 2 x 2")
    );
}

#[test]
fn only_the_window_is_decoded() {
    let folder = Folder::new();
    let mut pages: Vec<_> = (0..5_u8).map(|i| gray(2, &[i, i + 10, i + 20, i + 30])).collect();
    // A broken page outside of the window is not looked at.
    pages[0] = gray(2, &[1, 2]).with(257, Value::Long(vec![2])).code(278, 2).code(259, 8);
    let path = folder.write("a.tif", &little(&pages));
    assert!(read(&path).is_err());
    let window = Window { crop: Some([[1, 2], [0, 2], [2, 4]]), ..Window::default() };
    let options = ReadOptions { window, ..ReadOptions::default() };
    let volume = read_volume(&path, &options, &Progress::new()).unwrap();
    assert_eq!(volume.voxels, Voxels::U8(vec![12, 32, 13, 33]));
    let window = Window { reduce: [2; 3], crop: Some([[0, 2], [0, 2], [1, 3]]) };
    let options = ReadOptions { window, ..ReadOptions::default() };
    let layers = read_labels(&path, &options, &Progress::new()).unwrap();
    assert_eq!(layers[0].labels[usize::from(layers[0].voxels[0])].id, 32);
}

#[test]
fn what_is_not_read_is_named() {
    let folder = Folder::new();
    let page = || gray(2, &[1, 2, 3, 4]);
    for (page, expected) in [
        (page().code(259, 50000), "page 1 is compressed with zstd"),
        (page().code(259, 4), "compressed as a fax"),
        (page().code(262, 5), "is CMYK"),
        (page().code(258, 24), "more than its 4 stored bytes"),
        (page().code(339, 5), "sample format 5"),
        (page().with(257, Value::Long(vec![3])).code(278, 3), "promises 6 bytes of pixels"),
        (page().with(257, Value::Long(vec![0])), "promises 2 x 0 pixels"),
        (
            page().with(256, Value::Long(vec![u32::MAX])).with(257, Value::Long(vec![u32::MAX])),
            "promises 4294967295 x 4294967295 pixels",
        ),
        (page().with(258, Value::Short(vec![8, 16])).code(277, 2), "different numbers of bits"),
        (page().code(259, 8), "page 1 are damaged"),
        (page().code(259, 5), "page 1 are damaged"),
        (page().code(259, 32773), "page 1 are damaged"),
    ] {
        let refusal = folder.refusal("a.tif", &little(&[page]));
        assert!(refusal.contains(expected), "{expected}: {refusal}");
    }
    assert!(folder.refusal("a.tif", &[7; 100]).contains("this is no TIFF file"));
    assert!(folder.refusal("a.tif", b"II*\0\0\0\0\0").contains("no page"));
    // A directory that names itself as the next.
    let mut circle = little(&[page()]);
    let length = circle.len();
    let first = circle[4..8].to_vec();
    circle[length - 4..].copy_from_slice(&first);
    assert!(folder.refusal("a.tif", &circle).contains("run in a circle"));
    // A strip of zeros that inflates to far more than the page.
    let bomb = PageFile::new(2, 2, 8, vec![zlib(&vec![0; 1 << 20])]).code(259, 8);
    assert!(folder.read("a.tif", &little(&[bomb])).is_ok());
}

#[test]
fn damage_anywhere_gives_a_sentence() {
    let rows = |bytes: &[u8]| bytes.chunks(4).map(zlib).collect::<Vec<_>>();
    let page = |first: u8| {
        let bytes: Vec<u8> = (first..first + 16).collect();
        PageFile::new(4, 4, 8, rows(&bytes)).code(259, 8).code(317, 2)
    };
    let text = "ImageJ=1.53t\nimages=2\nslices=2\nunit=mm\nspacing=2\n";
    let pages = [page(0).with(270, Value::Text(text.to_owned())).with(282, Value::Ratio(3, 1)), page(20)];
    torture("a.tif", &little(&pages), usize::MAX);
    torture("a.tif", &file(&pages, Endian::Big, true), usize::MAX);
    let table: Vec<u16> = (0..12).map(|i| i * 999).collect();
    let palette = PageFile::new(4, 4, 2, vec![vec![0x1b; 4]]).code(262, 3).with(320, Value::Short(table));
    torture("a.tif", &little(&[palette]), usize::MAX);
    let mut out = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut out).unwrap().with_compression(Compression::Lzw);
    encoder.write_image::<colortype::Gray16>(5, 4, &(0..20).collect::<Vec<u16>>()).unwrap();
    torture("a.tif", &out.into_inner(), usize::MAX);
}
