//! What every fuzz target does: a damaged file is read, or refused with one sentence, and what was read holds together.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use fabrica_engine::Progress;
use fabrica_engine::read::limits::Limits;
use fabrica_engine::read::{ReadOptions, label_table, read_labels, read_volume, survey};

/// No mutated header may ask for more: what it asks for is then refused, as it is for users.
const MOST_BYTES: u64 = 64 << 20;

/// A folder of this process, in memory where there is such a place, with a data file for headers that name one.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let shm = Path::new("/dev/shm");
        let base = if shm.is_dir() { shm.to_owned() } else { std::env::temp_dir() };
        let folder = base.join(format!("fabrica-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("no folder to work in");
        folder
    })
}

fn file(name: &str, data: &[u8]) -> PathBuf {
    let folder = folder().join(name.replace('.', "_"));
    std::fs::create_dir_all(&folder).expect("no folder to work in");
    let path = folder.join(name);
    std::fs::write(&path, data).expect("no place to work in");
    if name.ends_with(".mhd") {
        std::fs::write(folder.join("a.raw"), [7; 4096]).expect("no place to work in");
    }
    path
}

fn one_sentence(error: &fabrica_engine::Error) {
    let text = error.to_string();
    assert!(!text.is_empty() && text.lines().count() == 1, "{text:?}");
}

/// Surveys and reads a volume, and as a label map.
pub fn read(name: &str, data: &[u8]) {
    let path = file(name, data);
    let limits = Limits { bytes: Some(MOST_BYTES), edge: None };
    let options = ReadOptions { limits, ..ReadOptions::default() };
    let progress = Progress::new();
    match survey(&path, &options, &progress) {
        Ok(entries) => assert!(!entries.is_empty()),
        Err(error) => one_sentence(&error),
    }
    match read_volume(&path, &options, &progress) {
        Ok(volume) => {
            assert_eq!(volume.voxels.len(), volume.grid.num_voxels());
            assert!(volume.num_bytes() as u64 <= MOST_BYTES);
            assert!(volume.colors.as_ref().is_none_or(|c| c.len() == volume.grid.num_voxels()));
        }
        Err(error) => return one_sentence(&error),
    }
    // Every second input, as it is all read anew.
    if data.len() % 2 == 1 {
        return;
    }
    match read_labels(&path, &options, &progress) {
        Ok(layers) => {
            for map in layers {
                assert_eq!(map.voxels.len(), map.grid.num_voxels());
                assert!(map.voxels.iter().all(|v| usize::from(*v) < map.labels.len()));
            }
        }
        Err(error) => one_sentence(&error),
    }
}

/// Reads names and colors of structures.
pub fn read_label_table(name: &str, data: &[u8]) {
    if let Err(error) = label_table::read_label_table(&file(name, data)) {
        one_sentence(&error);
    }
}

/// Parses a template; one that parses is written and parsed again as it was.
#[cfg(feature = "template")]
pub fn parse_template(data: &[u8]) {
    use fabrica_studio::figure::Template;
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(template) = Template::parse(text) {
        let written = template.to_json().expect("what was parsed can be written");
        assert_eq!(Template::parse(&written).expect("what was written can be parsed"), template);
    }
}
