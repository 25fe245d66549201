//! Tables in columns between commas, semicolons or tabulators.

use super::{Builder, bad_line, code_of, color_of, parse_hex_color, parse_id};
use crate::error::Result;

/// What the head of a table calls its columns, without case, blanks being underscores.
const ID_NAMES: [&str; 10] =
    ["labelvalue", "label_value", "index", "id", "idx", "label_id", "value", "number", "no", "label"];
const NAME_NAMES: [&str; 10] = [
    "name",
    "label_name",
    "labelname",
    "structure",
    "structure_name",
    "region",
    "region_name",
    "roi",
    "label",
    "description",
];
const COLOR_NAMES: [[&str; 3]; 3] = [["color_r", "color_g", "color_b"], ["r", "g", "b"], ["red", "green", "blue"]];
const HEX_NAMES: [&str; 4] = ["color", "colour", "hex", "color_hex_triplet"];

/// Which column is what, from 0.
pub struct Columns {
    delimiter: char,
    format: &'static str,
    id: usize,
    name: Option<usize>,
    color: Option<[usize; 3]>,
    hex: Option<usize>,
    /// Scheme, code and meaning of 3D Slicer's types and their modifiers.
    terms: [[Option<usize>; 3]; 2],
}

impl Columns {
    /// From the head of a table; `None` if the line is none.
    pub fn find(line: &str) -> Option<Self> {
        let delimiter = delimiter_of(line)?;
        let names: Vec<String> = split(line, delimiter)
            .map(|n| n.to_lowercase().replace([' ', '-'], "_").trim_end_matches('.').to_owned())
            .collect();
        let place = |name: &str| names.iter().position(|n| n == name);
        let id = ID_NAMES.iter().find_map(|n| place(n))?;
        let name = NAME_NAMES.iter().filter_map(|n| place(n)).find(|&p| p != id);
        let color = COLOR_NAMES.iter().find_map(|[r, g, b]| Some([place(r)?, place(g)?, place(b)?]));
        let hex = HEX_NAMES.iter().find_map(|n| place(n));
        let term = |of: &str| ["codingscheme", "codevalue", "codemeaning"].map(|part| place(&format!("{of}_{part}")));
        let is_slicer = names[id] == "labelvalue" || names[id] == "label_value";
        let format = if is_slicer { "3D Slicer color table (CSV)" } else { "table with columns" };
        Some(Self { delimiter, format, id, name, color, hex, terms: [term("type"), term("typemodifier")] })
    }

    /// Of a table that begins with an entry: `id,name`, or where blanks separate, `id name`; `None` if the line is none.
    pub fn without_head(line: &str) -> Option<Self> {
        let delimiter = delimiter_of(line).unwrap_or(' ');
        let mut fields = split(line, delimiter);
        parse_id(&fields.next()?)?;
        let is_name = fields.next().is_some_and(|n| n.contains(char::is_alphabetic));
        let format = "table of numbers and names";
        is_name.then_some(Self {
            delimiter,
            format,
            id: 0,
            name: Some(1),
            color: None,
            hex: None,
            terms: [[None; 3]; 2],
        })
    }
}

fn delimiter_of(line: &str) -> Option<char> {
    let most = |d: &char| line.matches(*d).count();
    ['\t', ',', ';'].into_iter().filter(|d| most(d) > 0).max_by_key(most)
}

/// The fields of a line; between quotation marks, of which two stand for one, delimiters count for nothing. Where
/// blanks separate, there are two.
fn split(line: &str, delimiter: char) -> impl Iterator<Item = String> {
    if delimiter == ' ' {
        let (first, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        return vec![first.to_owned(), rest.trim().trim_matches('"').to_owned()].into_iter();
    }
    let mut fields = vec![String::new()];
    let (mut is_quoted, mut characters) = (false, line.chars().peekable());
    while let Some(c) = characters.next() {
        match (c, fields.last_mut()) {
            ('"', Some(field)) if is_quoted && characters.peek() == Some(&'"') => {
                field.push('"');
                characters.next();
            }
            ('"', _) => is_quoted = !is_quoted,
            (c, _) if c == delimiter && !is_quoted => fields.push(String::new()),
            (c, Some(field)) => field.push(c),
            (_, None) => {}
        }
    }
    fields.iter_mut().for_each(|f| *f = f.trim().to_owned());
    fields.into_iter()
}

/// Reads the lines after the head.
pub fn parse(columns: Columns, lines: &[(usize, &str)], table: &mut Builder<'_>) -> Result<()> {
    table.table.format = columns.format;
    for &(number, line) in lines {
        let fields: Vec<String> = split(line, columns.delimiter).collect();
        if fields.iter().all(String::is_empty) {
            continue;
        }
        let bad = |what: &str| bad_line(table.path, number, line, what);
        let field = |at: Option<usize>| at.and_then(|i| fields.get(i)).map(String::as_str).unwrap_or_default();
        let id = parse_id(field(Some(columns.id))).ok_or_else(|| bad("has no number of a structure"))?;
        let parts = columns.color.map(|c| c.map(|i| field(Some(i))));
        let color = if let Some(parts) = parts.filter(|p| p.iter().any(|w| !w.is_empty())) {
            let color = color_of(parts.map(|w| w.parse().unwrap_or(f64::NAN)));
            Some(color.ok_or_else(|| bad("has a color that is not three numbers from 0 to 255"))?)
        } else if let Some(hex) = Some(field(columns.hex)).filter(|w| !w.is_empty()) {
            Some(parse_hex_color(hex).ok_or_else(|| bad("has a color that is not written as #rrggbb"))?)
        } else {
            None
        };
        let [[type_scheme, type_code, type_meaning], [scheme, code, meaning]] = columns.terms.map(|t| t.map(field));
        let mut name = field(columns.name).to_owned();
        if name.is_empty() {
            // Slicer takes names for a convenience: what a structure is, stands in the terms.
            name = format!("{meaning} {type_meaning}");
        }
        table.add(id, Some(name), color, code_of((type_scheme, type_code), (scheme, code)))?;
    }
    Ok(())
}
