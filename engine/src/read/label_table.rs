//! Tables that name and color the numbers of label maps: 3D Slicer's two, ITK-SNAP's, FreeSurfer's, JSON, CSV and TSV
//! with or without a head (BIDS among them).
//!
//! The kind is decided by content: people rename these files as they like, and `.txt` is any of four of them. Opacities
//! are read past in all of them: FreeSurfer writes 0 for "opaque", ITK-SNAP 0 to 1 or, by some writers, to 255.

mod caret;
mod delimited;
mod json;

pub(super) use caret::parse as parse_caret;

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use crate::error::{Error, Result};
use crate::volume::labels::{LabelTable, LabelTableEntry};

/// A longer file is no table.
const MAX_BYTES: u64 = 16 << 20;

/// More entries than any atlas has.
const MAX_ENTRIES: usize = 1 << 18;

const FREESURFER: &str = "FreeSurfer color table";

const FORMATS: &str = "3D Slicer (.ctbl, .csv), ITK-SNAP, FreeSurfer, JSON, or columns `id` and `name`";

/// Reads a table of any known kind. Where a number comes twice, the last line counts, and a note says so.
///
/// # Errors
/// [`Error::File`] with one sentence if the file cannot be read, is longer than 16 MiB, is no table that is known, has
/// no entry, or has a line that makes no sense (with its number).
pub fn read_label_table(path: &Path) -> Result<LabelTable> {
    let text = text_of(path)?;
    let mut table = Builder::new(path, "");
    parse(&text, &mut table)?;
    table.finish()
}

/// The file as text with `\n` line ends: UTF-8, UTF-16 with a mark, or else Latin-1.
fn text_of(path: &Path) -> Result<String> {
    let io = |e| Error::io(path, &e);
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        return Err(Error::file(path, "this is no file, where a table of labels is one", "name a table"));
    }
    let mut bytes = Vec::new();
    File::open(path).map_err(io)?.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(Error::file(path, "the file is longer than 16 MiB, which no table of labels is", "name a table"));
    }
    let words = |from_bytes: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = bytes[2..].chunks_exact(2).map(|b| from_bytes([b[0], b[1]])).collect();
        String::from_utf16_lossy(&words)
    };
    let text = match &bytes[..] {
        [0xff, 0xfe, ..] => words(u16::from_le_bytes),
        [0xfe, 0xff, ..] => words(u16::from_be_bytes),
        _ if bytes.contains(&0) => return Err(unknown(path)),
        _ => {
            let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
            std::str::from_utf8(bytes).map_or_else(|_| bytes.iter().copied().map(char::from).collect(), str::to_owned)
        }
    };
    Ok(text.replace("\r\n", "\n").replace('\r', "\n"))
}

fn unknown(path: &Path) -> Error {
    Error::file(path, "this is no table of labels that Fabrica knows", format!("write it as one of {FORMATS}"))
}

fn parse(text: &str, table: &mut Builder<'_>) -> Result<()> {
    if text.trim_start().starts_with(['{', '[']) {
        return json::parse(text, table);
    }
    let head: Vec<String> =
        text.lines().map(str::trim).filter(|l| l.starts_with('#')).take(64).map(str::to_lowercase).collect();
    let head_says = |words: &str| head.iter().any(|line| line.contains(words));
    if head_says("color procedural file") {
        let what = "this is a continuous color scale, which names no structures";
        return Err(Error::file(table.path, what, "name a table with one line per structure"));
    }
    let lines: Vec<(usize, &str)> =
        (1..).zip(text.lines().map(str::trim)).filter(|(_, l)| !l.is_empty() && !l.starts_with('#')).collect();
    let Some(&(_, first)) = lines.first() else {
        return Err(Error::file(table.path, "the table of labels has no entry", "write one line per structure"));
    };
    // Neither writer's head is optional, and each names its program.
    if head_says("itk-snap label") {
        parse_itk_snap(&lines, table)
    } else if head_says("color table file") {
        parse_named(&lines, Some(Writer::Slicer), table)
    } else if head_says("no. label name") || head_says("freesurfer") {
        parse_named(&lines, Some(Writer::FreeSurfer), table)
    } else if let Some(columns) = delimited::Columns::find(first) {
        delimited::parse(columns, &lines[1..], table)
    } else if itk_snap_line(first).is_some() {
        parse_itk_snap(&lines, table)
    } else if named_line(first, Writer::FreeSurfer).is_some_and(|l| l.color.is_some()) {
        parse_named(&lines, None, table)
    } else if let Some(columns) = delimited::Columns::without_head(first) {
        delimited::parse(columns, &lines, table)
    } else {
        Err(unknown(table.path))
    }
}

/// Who writes lines of number, name, color.
#[derive(Clone, Copy, PartialEq)]
enum Writer {
    /// `index name R G B A`, opacities from 0 to 255.
    Slicer,
    /// `id name R G B A`, at times with a column for the tissue.
    FreeSurfer,
}

struct NamedLine<'a> {
    id: &'a str,
    name: String,
    /// As written; `None` where the line has none.
    color: Option<[&'a str; 3]>,
    opacity: Option<&'a str>,
}

/// The parts of `id name R G B [A [tissue]]`, the name being one word or, against both formats, several.
fn named_line(line: &str, writer: Writer) -> Option<NamedLine<'_>> {
    // Between tabulators, names may have blanks.
    let fields: Vec<&str> = line.split('\t').map(str::trim).filter(|w| !w.is_empty()).collect();
    let words = if fields.len() >= 5 { fields } else { line.split_whitespace().collect() };
    let is_number = |w: &&str| w.parse::<f64>().is_ok();
    let n = words.len();
    // Of a line of five to seven words the second is the name whatever it looks like.
    let color_at = if writer == Writer::FreeSurfer && (5..=7).contains(&n) && words[2..5].iter().all(is_number) {
        2
    } else if n >= 6 && words[n - 4..].iter().all(is_number) {
        n - 4
    } else if n >= 5 && words[n - 3..].iter().all(is_number) {
        n - 3
    } else {
        return None;
    };
    let name = words[1..color_at].join(" ");
    let [r, g, b] = words[color_at..color_at + 3] else { return None };
    parse_id(words[0])?;
    Some(NamedLine { id: words[0], name, color: Some([r, g, b]), opacity: words.get(color_at + 3).copied() })
}

/// Without a head that tells the writer, opacities do: FreeSurfer's are 0, which would hide everything in Slicer.
fn parse_named(lines: &[(usize, &str)], writer: Option<Writer>, table: &mut Builder<'_>) -> Result<()> {
    let writer = writer.unwrap_or_else(|| {
        let is_shown = |line: &str| {
            let opacity = named_line(line, Writer::FreeSurfer).and_then(|l| l.opacity?.parse::<f64>().ok());
            opacity.is_some_and(|a| a > 0.0)
        };
        let num_shown = lines.iter().filter(|(_, line)| is_shown(line)).count();
        if 2 * num_shown > lines.len() { Writer::Slicer } else { Writer::FreeSurfer }
    });
    table.table.format = match writer {
        Writer::Slicer => "3D Slicer color table",
        Writer::FreeSurfer => FREESURFER,
    };
    for &(number, line) in lines {
        let Some(NamedLine { id, name, color, .. }) = named_line(line, writer) else {
            return Err(bad_line(table.path, number, line, "is not `id name R G B A`"));
        };
        let color = color.map(|c| parse_color(c, table.path, number, line)).transpose()?;
        let id = parse_id(id).ok_or_else(|| bad_line(table.path, number, line, "does not begin with a number"))?;
        table.add(id, Some(name), color, None)?;
    }
    Ok(())
}

/// The parts of `IDX R G B A VIS MSH "LABEL"`; the last three numbers may be missing.
fn itk_snap_line(line: &str) -> Option<(&str, [&str; 3], &str)> {
    const QUOTES: [char; 4] = ['"', '\'', '“', '”'];
    let numbers_and_name = match line.find(QUOTES) {
        Some(quote) => Some((&line[..quote], &line[quote..])),
        // Written by hand: seven numbers, then the name.
        None => {
            let mut rest = line;
            for _ in 0..7 {
                rest = rest.trim_start().split_once(char::is_whitespace).map_or("", |(_, after)| after);
            }
            (!rest.is_empty()).then(|| line.split_at(line.len() - rest.len()))
        }
    };
    let (numbers, name) = numbers_and_name?;
    let words: Vec<&str> = numbers.split_whitespace().collect();
    let [id, r, g, b, ..] = words[..] else { return None };
    let is_good = words.len() <= 7 && words.iter().all(|w| w.parse::<f64>().is_ok());
    is_good.then(|| (id, [r, g, b], name.trim().trim_matches(QUOTES).trim()))
}

fn parse_itk_snap(lines: &[(usize, &str)], table: &mut Builder<'_>) -> Result<()> {
    table.table.format = "ITK-SNAP label descriptions";
    for &(number, line) in lines {
        let parts = itk_snap_line(line).and_then(|(id, color, name)| Some((parse_id(id)?, color, name)));
        let Some((id, color, name)) = parts else {
            return Err(bad_line(table.path, number, line, "is not `IDX R G B A VIS MSH \"LABEL\"`"));
        };
        let color = parse_color(color, table.path, number, line)?;
        table.add(id, Some(name.to_owned()), Some(color), None)?;
    }
    Ok(())
}

/// A structure's number; data frames write `12.0`.
fn parse_id(word: &str) -> Option<u32> {
    let number: f64 = word.trim().parse().ok()?;
    let id = number as u32;
    (f64::from(id) == number).then_some(id)
}

/// Three numbers from 0 to 255, or in a table that has no others, from 0 to 1.
fn parse_color(words: [&str; 3], path: &Path, number: usize, line: &str) -> Result<[f64; 3]> {
    color_of(words.map(|w| w.trim().parse().unwrap_or(f64::NAN)))
        .ok_or_else(|| bad_line(path, number, line, "has a color that is not three numbers from 0 to 255"))
}

fn color_of(numbers: [f64; 3]) -> Option<[f64; 3]> {
    numbers.iter().all(|c| (0.0..=255.0).contains(c)).then_some(numbers)
}

/// `#rrggbb`, with or without the sign, and with an opacity that is dropped.
fn parse_hex_color(text: &str) -> Option<[f64; 3]> {
    let digits = text.trim().trim_start_matches('#');
    if !matches!(digits.len(), 6 | 8) || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    let code = u32::from_str_radix(&digits[..6], 16).ok()?;
    Some([16, 8, 0].map(|shift| f64::from(code >> shift & 255)))
}

/// A name as people write it: underscores stand for blanks where programs do not allow them. One program's table, folder of
/// masks and label map give one name to a structure, then.
pub(super) fn readable(name: &str) -> String {
    name.replace('_', " ").trim().to_owned()
}

fn bad_line(path: &Path, number: usize, line: &str, what: &str) -> Error {
    let shown: String = line.chars().filter(|c| !c.is_control()).take(40).collect();
    Error::file(path, format!("line {number} of the table, `{shown}`, {what}"), "correct or remove it")
}

/// A concept of a terminology: its scheme ("SCT") and its code there.
pub(super) type Concept<'a> = (&'a str, &'a str);

/// [`crate::volume::labels::Label::code`] of a type and what modifies it, "SCT:64033007+SCT:7771000" for a left kidney.
pub(super) fn code_of(type_: Concept<'_>, modifier: Concept<'_>) -> Option<String> {
    // 3D Slicer writes "tissue" for whatever nobody described.
    const TISSUE: Concept<'_> = ("SCT", "85756007");
    let written = |(scheme, code): Concept<'_>| match (scheme.trim(), code.trim()) {
        ("", _) | (_, "") => None,
        (scheme, code) => Some(format!("{scheme}:{code}")),
    };
    let code = written(type_).filter(|_| (type_.0.trim(), type_.1.trim()) != TISSUE)?;
    Some(written(modifier).map_or(code.clone(), |m| format!("{code}+{m}")))
}

/// A table while it is read.
struct Builder<'a> {
    path: &'a Path,
    table: LabelTable,
    /// Colors as they are written: whether they end at 1 or at 255 is known at the end only.
    colors: Vec<(u32, [f64; 3])>,
    repeated: Vec<u32>,
}

impl<'a> Builder<'a> {
    fn new(path: &'a Path, format: &'static str) -> Self {
        Self { path, table: LabelTable { format, ..LabelTable::default() }, colors: Vec::new(), repeated: Vec::new() }
    }

    fn add(&mut self, id: u32, name: Option<String>, color: Option<[f64; 3]>, code: Option<String>) -> Result<()> {
        let name = name.map(|n| n.trim().to_owned()).filter(|n| !n.is_empty());
        if self.table.entries.insert(id, LabelTableEntry { name, color: None, code }).is_some() {
            self.repeated.push(id);
        }
        self.colors.extend(color.map(|c| (id, c)));
        if self.colors.len().max(self.table.entries.len()) > MAX_ENTRIES {
            let what = format!("the table has more than {MAX_ENTRIES} entries, which no atlas has");
            return Err(Error::file(self.path, what, "name a table of labels"));
        }
        Ok(())
    }

    fn finish(mut self) -> Result<LabelTable> {
        if self.table.entries.is_empty() {
            return Err(Error::file(self.path, "the table of labels has no entry", "write one line per structure"));
        }
        let all = || self.colors.iter().flat_map(|(_, c)| c);
        let scale = if all().all(|c| *c <= 1.0) && all().any(|c| c.fract() != 0.0) { 255.0 } else { 1.0 };
        for (id, color) in &self.colors {
            if let Some(entry) = self.table.entries.get_mut(id) {
                entry.color = Some(color.map(|c| (c * scale).round() as u8));
            }
        }
        // FreeSurfer's names are identifiers that its users know.
        if self.table.format != FREESURFER {
            self.table.entries.values_mut().for_each(|e| e.name = e.name.as_deref().map(readable));
        }
        self.repeated.sort_unstable();
        self.repeated.dedup();
        if let Some(id) = self.repeated.first() {
            let what = match self.repeated.len() {
                1 => format!("The number {id} comes twice in the table"),
                n => format!("{n} numbers, of them {id}, come twice in the table"),
            };
            self.table.notes.push(format!("{what}; the last line counts."));
        }
        Ok(self.table)
    }
}

#[cfg(test)]
mod tests;
