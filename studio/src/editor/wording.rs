//! Faults as the window says them: where the command line names an option or a command of its own, what helps here.

use fabrica_engine::Error;
use fabrica_engine::error::{in_words, remedies};

use super::ui_command::UiCommand;

/// A fault as a sentence, with what it is about before it.
pub fn sentence(error: &anyhow::Error) -> String {
    let parts: Vec<String> =
        error.chain().map(|cause| cause.downcast_ref::<Error>().map_or_else(|| cause.to_string(), of_engine)).collect();
    parts.join(": ")
}

fn of_engine(error: &Error) -> String {
    let read_otherwise = format!("{}, \"{}\"", UiCommand::ReadOtherwise.menu(), UiCommand::ReadOtherwise.text());
    match error {
        Error::Several { path, entries } => {
            let path = path.display();
            format!(
                "it holds {} volumes: {}; choose one with {read_otherwise} ({path})",
                entries.len(),
                in_words(entries)
            )
        }
        Error::NeedsLayout { path, .. } => {
            let path = path.display();
            format!("a raw file does not say how its voxels lie; describe them with {read_otherwise} ({path})")
        }
        Error::TooLarge(fault) => {
            format!("{}; load less of it with {read_otherwise} ({})", fault.what(), fault.path.display())
        }
        Error::File { what, remedy, path } => {
            let rename = "give it a name that ends in .raw and open it: the window then asks how they lie";
            let remedy = match remedy.as_str() {
                remedies::DESCRIBE_VOXELS => format!("check what the file is; if it holds plain voxels, {rename}"),
                remedies::CONVERT_OR_DESCRIBE => format!("convert it; if it holds plain voxels, {rename}"),
                remedies::LIST_SERIES | remedies::NAME_SERIES => format!("choose one with {read_otherwise}"),
                other => other.to_owned(),
            };
            format!("{what}; {remedy} ({})", path.display())
        }
        Error::Gpu { what, remedy } if remedy == remedies::OTHER_ADAPTER => format!("{what}; update its driver"),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use anyhow::Context as _;
    use fabrica_engine::Progress;
    use fabrica_engine::read::limits::Limits;
    use fabrica_engine::read::{ReadOptions, read_volume};

    use super::*;

    #[test]
    fn no_sentence_names_an_option() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let header = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\n";
        let small = write("small.nrrd", &[&header[..], &[0; 64]].concat());
        let few = ReadOptions { limits: Limits { bytes: Some(50), edge: None }, ..ReadOptions::default() };
        let second = ReadOptions { series: Some("2".to_owned()), ..ReadOptions::default() };
        let plain = ReadOptions::default();
        let several = tempfile::tempdir().unwrap();
        for name in ["a.nrrd", "b.nrrd"] {
            let voxels: Vec<u8> = (0..64).collect();
            std::fs::write(several.path().join(name), [&header[..], &voxels].concat()).unwrap();
        }
        for (path, options, expected) in [
            (write("a.raw", &[0; 64]), &plain, "does not say how its voxels lie"),
            (write("a.nii", &[7; 1024]), &plain, "this is no NIfTI file"),
            (write("a.nrrd", &[7; 1024]), &plain, "this is no NRRD file"),
            (write("a.mha", &[7; 1024]), &plain, "this is no MetaImage file"),
            (write("a.tif", &[7; 1024]), &plain, "this is no TIFF file"),
            (write("a.npy", &[7; 1024]), &plain, "this is no NumPy file"),
            (write("a.txt", b"hello"), &plain, "no volume in a format that Fabrica reads"),
            (small.clone(), &few, "voxels take"),
            (small, &second, "there is no series 2"),
            (several.path().to_owned(), &plain, "it holds 2 volumes"),
        ] {
            let error = read_volume(&path, options, &Progress::new()).unwrap_err();
            let on_the_command_line = error.to_string();
            let said = sentence(&Err::<(), _>(error).context("the volume cannot be loaded").unwrap_err());
            assert!(on_the_command_line.contains("--") || on_the_command_line.contains('`'), "{on_the_command_line}");
            assert!(!said.contains("--") && !said.contains('`'), "{said}");
            assert!(said.starts_with("the volume cannot be loaded: ") && said.contains(expected), "{said}");
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            assert!(said.ends_with(&format!("{name})")) && said.contains("; "), "{said}");
        }
        let gpu = Error::gpu("it cannot draw", remedies::OTHER_ADAPTER);
        assert_eq!(sentence(&gpu.into()), "it cannot draw; update its driver");
        // What is none of these is as it is anywhere.
        let other = Error::file(Path::new("a"), "it is cut off", "copy it again");
        assert_eq!(sentence(&other.into()), "it is cut off; copy it again (a)");
    }
}
