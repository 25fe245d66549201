//! The numbers that README states: `cargo bench -p fabrica-studio`. Each is the median of several runs of the program
//! itself as a cold process; ratios hold from machine to machine, times do not.

#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use fabrica_engine::Progress;
use fabrica_engine::read::{ReadOptions, read_volume};
use fabrica_engine::specimen;
use fabrica_engine::volume::{Volume, Voxels};

const RUNS: usize = 5;

fn main() {
    let folder = tempfile::tempdir().unwrap();
    let templates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../templates");
    let adapters = Command::new(env!("CARGO_BIN_EXE_fabrica")).args(["adapters", "--software"]).output().unwrap();
    println!("adapter: {}", String::from_utf8_lossy(&adapters.stdout).trim());

    let (time, made) = timed(1, || specimen::generate("head", 256, &Progress::new()).unwrap());
    let dims = made.volume.grid.dims();
    println!("specimen:head at 256 ({} x {} x {}): {} ms", dims[0], dims[1], dims[2], ms(time));

    // The specimen in a full 256³ box, as a plain int16 NIfTI.
    let cube = padded(&made.volume, [256, 256, 256]);
    let file = folder.path().join("head.nii");
    let spacing = made.volume.grid.spacing_mm().x as f32;
    write_nifti(&mut std::fs::File::create(&file).unwrap(), [256, 256, 256], spacing, &cube);
    for template in ["head.json", "head_glass.json", "head_engraving.json", "head_xray.json"] {
        let mut memory = String::new();
        let (time, ()) = timed(RUNS, || {
            let output = Command::new(env!("CARGO_BIN_EXE_fabrica"))
                .arg("render")
                .arg(templates.join(template))
                .args(["--volume", file.to_str().unwrap(), "--size", "1024x1024", "--quality", "standard"])
                .args(["--adapter", "software", "--verbose", "--out"])
                .arg(folder.path().join("out.png"))
                .output()
                .unwrap();
            let log = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(output.status.success(), "{log}");
            memory = log.lines().find(|l| l.starts_with("peak memory")).unwrap_or_default().to_owned();
        });
        println!("cold process to PNG, 256³ int16 NIfTI, 1024², standard, {template}: {} ms, {memory}", ms(time));
    }

    // A series of the size that hospitals send, gzipped: noise makes it as hard to inflate as a real scan.
    let packed = folder.path().join("series.nii.gz");
    let large = upsampled(&made.volume, [512, 512, 300]);
    let mut gzip =
        flate2::write::GzEncoder::new(std::fs::File::create(&packed).unwrap(), flate2::Compression::default());
    write_nifti(&mut gzip, [512, 512, 300], 0.5, &large);
    gzip.finish().unwrap();
    drop(large);
    let (read, _) = timed(RUNS, || read_volume(&packed, &ReadOptions::default(), &Progress::new()).unwrap());
    let (gunzip, _) = timed(RUNS, || {
        let status = Command::new("gzip").args(["-dc", packed.to_str().unwrap()]).stdout(Stdio::null()).status();
        assert!(status.unwrap().success());
    });
    println!(
        "512 x 512 x 300 int16 .nii.gz ({} MB): {} ms, gzip -dc {} ms, ratio {:.2}",
        std::fs::metadata(&packed).unwrap().len() / 1_000_000,
        ms(read),
        ms(gunzip),
        read.as_secs_f64() / gunzip.as_secs_f64()
    );

    // The same as a hospital sends it: a file a slice, in no order.
    let large = upsampled(&made.volume, [512, 512, 300]);
    let study = folder.path().join("study");
    std::fs::create_dir(&study).unwrap();
    for (z, slice) in large.chunks(512 * 512).enumerate() {
        std::fs::write(study.join(format!("{:03}.dcm", z * 7 % 300)), dicom_slice(z, slice)).unwrap();
    }
    drop(large);
    let (read, volume) = timed(RUNS, || read_volume(&study, &ReadOptions::default(), &Progress::new()).unwrap());
    assert_eq!(volume.grid.dims(), [512, 512, 300]);
    println!("300 DICOM slices of 512 x 512 int16: {} ms", ms(read));
}

/// A slice in explicit VR little endian, with what places it.
fn dicom_slice(z: usize, voxels: &[i16]) -> Vec<u8> {
    let mut bytes = [&[0; 128][..], b"DICM"].concat();
    let mut put = |group: u16, element: u16, vr: &str, value: &[u8]| {
        bytes.extend([group.to_le_bytes(), element.to_le_bytes()].concat());
        bytes.extend(vr.bytes());
        let length = value.len() as u32 + value.len() as u32 % 2;
        match vr {
            "OW" => bytes.extend([&[0; 2][..], &length.to_le_bytes()].concat()),
            _ => bytes.extend((length as u16).to_le_bytes()),
        }
        bytes.extend(value);
        bytes.resize(bytes.len() + value.len() % 2, if vr == "UI" { 0 } else { b' ' });
    };
    put(0x0002, 0x0010, "UI", b"1.2.840.10008.1.2.1");
    put(0x0008, 0x0016, "UI", b"1.2.840.10008.5.1.4.1.1.2");
    put(0x0008, 0x0060, "CS", b"CT");
    put(0x0020, 0x000e, "UI", b"1.2.3");
    put(0x0020, 0x0032, "DS", format!("0\\0\\{}", z as f64 / 2.0).as_bytes());
    put(0x0020, 0x0037, "DS", b"1\\0\\0\\0\\1\\0");
    put(0x0028, 0x0002, "US", &1u16.to_le_bytes());
    put(0x0028, 0x0004, "CS", b"MONOCHROME2");
    for (element, number) in [(0x0010, 512u16), (0x0011, 512), (0x0100, 16), (0x0101, 16), (0x0102, 15), (0x0103, 1)] {
        put(0x0028, element, "US", &number.to_le_bytes());
        if element == 0x0011 {
            put(0x0028, 0x0030, "DS", b"0.5\\0.5");
        }
    }
    put(0x7fe0, 0x0010, "OW", &voxels.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    bytes
}

fn ms(time: Duration) -> String {
    format!("{:.0}", time.as_secs_f64() * 1e3)
}

fn timed<T>(runs: usize, mut work: impl FnMut() -> T) -> (Duration, T) {
    let mut times = Vec::new();
    loop {
        let start = Instant::now();
        let result = work();
        times.push(start.elapsed());
        if times.len() == runs {
            times.sort();
            return (times[runs / 2], result);
        }
    }
}

fn hounsfield(volume: &Volume) -> &[i16] {
    match &volume.voxels {
        Voxels::I16(v) => v,
        _ => unreachable!("specimens are int16"),
    }
}

fn padded(volume: &Volume, dims: [usize; 3]) -> Vec<i16> {
    let from = volume.grid.dims();
    let v = hounsfield(volume);
    let mut cube = vec![-1000; dims[0] * dims[1] * dims[2]];
    for z in 0..from[2].min(dims[2]) {
        for y in 0..from[1].min(dims[1]) {
            let n = from[0].min(dims[0]);
            cube[dims[0] * (y + dims[1] * z)..][..n].copy_from_slice(&v[from[0] * (y + from[1] * z)..][..n]);
        }
    }
    cube
}

/// Nearest-neighbor enlargement with ±8 of hash noise.
fn upsampled(volume: &Volume, dims: [usize; 3]) -> Vec<i16> {
    let from = volume.grid.dims();
    let v = hounsfield(volume);
    let mut hash = 1u32;
    let mut large = Vec::with_capacity(dims[0] * dims[1] * dims[2]);
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            let row = from[0] * (y * from[1] / dims[1] + from[1] * (z * from[2] / dims[2]));
            for x in 0..dims[0] {
                hash = hash.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                large.push(v[row + x * from[0] / dims[0]] + (hash >> 28) as i16 - 8);
            }
        }
    }
    large
}

/// NIfTI-1 with an upright sform.
fn write_nifti(file: &mut impl std::io::Write, dims: [usize; 3], spacing: f32, voxels: &[i16]) {
    let mut header = [0u8; 352];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    for (i, n) in [3, dims[0], dims[1], dims[2], 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * i, &(n as i16).to_le_bytes());
    }
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    for i in 0..4 {
        put(76 + 4 * i, &if i == 0 { 1.0 } else { spacing }.to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(254, &1i16.to_le_bytes());
    for i in 0..3 {
        put(280 + 20 * i, &spacing.to_le_bytes());
    }
    put(344, b"n+1\0");
    file.write_all(&header).unwrap();
    for part in voxels.chunks(1 << 16) {
        let bytes: Vec<u8> = part.iter().flat_map(|v| v.to_le_bytes()).collect();
        file.write_all(&bytes).unwrap();
    }
    let _ = std::io::stdout().flush();
}
