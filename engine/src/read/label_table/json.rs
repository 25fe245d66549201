//! Tables in JSON: `{"1": "spleen"}`, the other way round as nnU-Net writes them, either of them under "labels", and
//! lists of objects, as atlases come.

use serde_json::{Map, Value};

use super::{Builder, code_of, color_of, parse_hex_color, parse_id};
use crate::error::{Error, Result};

const ID_KEYS: [&str; 5] = ["id", "index", "label", "value", "labelID"];
const NAME_KEYS: [&str; 4] = ["name", "SegmentLabel", "label", "description"];
const COLOR_KEYS: [&str; 5] = ["color", "rgb", "rgb_triplet", "recommendedDisplayRGBValue", "color_hex_triplet"];

/// Reads a table that begins with a brace or bracket.
pub fn parse(text: &str, table: &mut Builder<'_>) -> Result<()> {
    table.table.format = "JSON table";
    let value: Value = serde_json::from_str(text).map_err(|e| {
        Error::file(table.path, format!("line {} of the table is no JSON ({e})", e.line()), "correct it with an editor")
    })?;
    match &value {
        Value::Object(all) => match all.get("labels") {
            Some(Value::Object(labels)) => parse_map(labels, table),
            Some(Value::Array(labels)) => parse_list(labels, table),
            _ => parse_map(all, table),
        },
        Value::Array(list) => parse_list(list, table),
        _ => Err(super::unknown(table.path)),
    }
}

/// Numbers as keys, or names as keys.
fn parse_map(map: &Map<String, Value>, table: &mut Builder<'_>) -> Result<()> {
    for (key, value) in map {
        match (parse_id(key), value) {
            (Some(id), Value::String(name)) => table.add(id, Some(name.clone()), None, None)?,
            (Some(id), Value::Object(fields)) => add_fields(id, None, fields, table)?,
            (None, Value::Number(_)) => {
                let id = id_of(value).ok_or_else(|| bad_entry(table, key))?;
                table.add(id, Some(key.clone()), None, None)?;
            }
            (None, Value::Object(fields)) => {
                let id = id_in(fields).ok_or_else(|| bad_entry(table, key))?;
                add_fields(id, Some(key), fields, table)?;
            }
            // nnU-Net's regions: a name for several numbers together.
            (None, Value::Array(_)) => {}
            _ => return Err(bad_entry(table, key)),
        }
    }
    Ok(())
}

fn parse_list(list: &[Value], table: &mut Builder<'_>) -> Result<()> {
    for (number, value) in (1..).zip(list) {
        let fields = value.as_object().and_then(|fields| Some((id_in(fields)?, fields)));
        let (id, fields) = fields.ok_or_else(|| bad_entry(table, &number.to_string()))?;
        add_fields(id, None, fields, table)?;
    }
    Ok(())
}

fn add_fields(id: u32, name: Option<&str>, fields: &Map<String, Value>, table: &mut Builder<'_>) -> Result<()> {
    let text = |value: &Value| value.as_str().map(str::to_owned);
    let name = name.map(str::to_owned).or_else(|| NAME_KEYS.iter().find_map(|k| text(fields.get(*k)?)));
    let color = match COLOR_KEYS.iter().find_map(|k| fields.get(*k)).filter(|v| !v.is_null()) {
        Some(value) => Some(color_in(value).ok_or_else(|| bad_entry(table, &id.to_string()))?),
        None => None,
    };
    // As dcmqi describes segments.
    let part = |of: &str, part: &str| fields.get(of).and_then(|t| t.get(part)).and_then(Value::as_str).unwrap_or("");
    let [kind, modifier] = ["SegmentedPropertyTypeCodeSequence", "SegmentedPropertyTypeModifierCodeSequence"]
        .map(|of| (part(of, "CodingSchemeDesignator"), part(of, "CodeValue")));
    table.add(id, name, color, code_of(kind, modifier))
}

fn id_in(fields: &Map<String, Value>) -> Option<u32> {
    ID_KEYS.iter().find_map(|k| id_of(fields.get(*k)?))
}

fn id_of(value: &Value) -> Option<u32> {
    match value {
        Value::Number(_) => u32::try_from(value.as_u64()?).ok(),
        Value::String(text) => parse_id(text),
        _ => None,
    }
}

fn color_in(value: &Value) -> Option<[f64; 3]> {
    match value {
        Value::String(text) => parse_hex_color(text),
        Value::Array(numbers) => {
            let [r, g, b, ..] = &numbers[..] else { return None };
            color_of([r, g, b].map(|c| c.as_f64().unwrap_or(f64::NAN)))
        }
        _ => None,
    }
}

fn bad_entry(table: &Builder<'_>, key: &str) -> Error {
    let shown: String = key.chars().take(40).collect();
    Error::file(
        table.path,
        format!("the entry `{shown}` of the table does not give a structure's number and name, or its color"),
        "write it as {\"1\": \"spleen\"} or {\"1\": {\"name\": \"spleen\", \"color\": \"#9d6ca2\"}}",
    )
}
