//! The table of Caret and Connectome Workbench: `<Label Key="1" Red="0.5" …>name</Label>`, in XML that is part of other
//! files. Only these elements are looked for.

use std::path::Path;

use super::{Builder, parse_id};
use crate::volume::labels::LabelTable;

/// The table in an XML text, if it has one.
pub fn parse(path: &Path, xml: &[u8]) -> Option<LabelTable> {
    let text = String::from_utf8_lossy(xml);
    let (_, table_text) = text.split_once("<LabelTable")?;
    // Further tables are those of further frames.
    let table_text = table_text.split("</LabelTable").next()?;
    let mut table = Builder::new(path, "Caret label table");
    for element in table_text.split("<Label ").skip(1) {
        let (attributes, content) = element.split_once('>')?;
        // -1 is what belongs to no label there.
        let Some(id) = attribute(attributes, "Key").and_then(parse_id) else { continue };
        let part = |name: &str| attribute(attributes, name)?.parse::<f64>().ok().filter(|c| (0.0..=1.0).contains(c));
        let color = part("Red").zip(part("Green")).zip(part("Blue")).map(|((r, g), b)| [r, g, b].map(|c| c * 255.0));
        let content = content.split("</Label").next()?.trim();
        let name = match content.strip_prefix("<![CDATA[") {
            Some(verbatim) => verbatim.trim_end_matches("]]>").to_owned(),
            None => content.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&"),
        };
        table.add(id, Some(name), color, None).ok()?;
    }
    table.finish().ok()
}

fn attribute<'a>(attributes: &'a str, name: &str) -> Option<&'a str> {
    let at = attributes.match_indices(name).find(|(at, _)| {
        let is_word = attributes[..*at].chars().next_back().is_none_or(char::is_whitespace);
        is_word && attributes[at + name.len()..].trim_start().starts_with('=')
    })?;
    let value = attributes[at.0 + name.len()..].trim_start().strip_prefix('=')?.trim_start();
    let quote = value.chars().next().filter(|q| matches!(q, '"' | '\''))?;
    value[1..].split(quote).next()
}
