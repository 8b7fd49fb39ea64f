//! What the files may hold, for editors as JSON Schema and for readers as a page. Both come from the sections' structs.

use std::fmt::Write;

use goshawk_core::Tuning;
use serde_json::{Map, Value};

use super::Vehicle;
use super::schema::schema;

/// The vehicle file's schema.
#[must_use]
pub fn vehicle_schema() -> Value {
    schema::<Vehicle>()
}

/// The tuning file's schema.
#[must_use]
pub fn tuning_schema() -> Value {
    schema::<Tuning>()
}

/// Every key of both files, as Markdown.
#[must_use]
pub fn markdown() -> String {
    let mut page = String::from(
        "# The vehicle file\n\n\
         <!-- Generated from the structs that read the files: do not edit. Change the source, then run `make docs`. -->\n\n\
         A vehicle file holds what is measured on one vehicle, such as `air/vehicles/sim.toml`. It names a tuning file, \
         such as `air/vehicles/tuning.toml`, which holds how it flies. Every key is required unless it says *optional*. An \
         unknown key is an error, and so is a number outside its range. The last column says where the value comes from: \
         yours, or that of the shipped files. The notebook is `ground/train/NOTEBOOK.md`.\n",
    );
    for (title, schema) in
        [("Keys of the vehicle file", vehicle_schema()), ("Keys of the tuning file", tuning_schema())]
    {
        let _ = writeln!(page, "\n## {title}");
        section(&mut page, "", &schema);
    }
    page
}

fn section(page: &mut String, name: &str, schema: &Value) {
    let required = |key: &str| schema["required"].as_array().is_some_and(|keys| keys.iter().any(|k| k == key));
    let empty = Map::new();
    let keys = schema["properties"].as_object().unwrap_or(&empty);
    let (inner, plain): (Vec<_>, Vec<_>) = keys.iter().partition(|(_, key)| rows(key).is_some());
    if !name.is_empty() {
        let _ = writeln!(page, "\n### `{name}`\n\n{}", text(schema));
    }
    if !plain.is_empty() {
        let _ = writeln!(page, "\n| key | value | meaning | range, and why | from |\n|---|---|---|---|---|");
    }
    for (key, schema) in plain {
        let optional = if required(key) { "" } else { ", *optional*" };
        let source = schema["x-source"].as_str().unwrap_or_default();
        let (kind, text, bounds) = (kind(schema), text(schema), bounds(schema));
        let _ = writeln!(page, "| `{key}` | {kind}{optional} | {text} | {bounds} | {source} |");
    }
    for (key, schema) in inner {
        let dotted = if name.is_empty() { key.clone() } else { format!("{}.{key}", name.trim_matches(['[', ']'])) };
        let Some((rows, many)) = rows(schema) else { continue };
        section(page, &if many { format!("[[{dotted}]]") } else { format!("[{dotted}]") }, rows);
    }
}

/// A table's own schema, and whether there are many of it; none: it is no table.
fn rows(schema: &Value) -> Option<(&Value, bool)> {
    [(schema, false), (&schema["items"], true)].into_iter().find(|(schema, _)| schema["properties"].is_object())
}

fn text(schema: &Value) -> String {
    schema["description"].as_str().unwrap_or_default().replace('\n', " ").replace('|', "\\|")
}

fn kind(schema: &Value) -> String {
    let named = |kind: &str| match kind {
        "string" => "text".to_owned(),
        "boolean" => "true or false".to_owned(),
        "integer" => "whole number".to_owned(),
        kind => kind.to_owned(),
    };
    if let Some(words) = choices(schema) {
        return words;
    }
    let kind = &schema["type"];
    let kind = kind.as_str().or_else(|| kind.get(0)?.as_str()).unwrap_or_default();
    if kind != "array" {
        return named(kind);
    }
    let each = kind_of_items(schema);
    schema["minItems"].as_u64().map_or_else(|| format!("list of {each}s"), |count| format!("{count} {each}s"))
}

fn kind_of_items(schema: &Value) -> String {
    kind(&schema["items"])
}

/// The words that a key may have.
fn choices(schema: &Value) -> Option<String> {
    let inner = |any: &'static str| schema[any].as_array()?.iter().find_map(choices);
    let quoted = |words: Vec<&str>| words.iter().map(|word| format!("`\"{word}\"`")).collect::<Vec<_>>().join(", ");
    let listed = |values: &Vec<Value>| quoted(values.iter().filter_map(Value::as_str).collect());
    if let Some(values) = schema["enum"].as_array() {
        return Some(listed(values));
    }
    let consts = |values: &Vec<Value>| values.iter().filter_map(|v| v["const"].as_str()).map(str::to_owned).collect();
    let words: Vec<String> = schema["oneOf"].as_array().map(consts).unwrap_or_default();
    if words.is_empty() { inner("anyOf") } else { Some(quoted(words.iter().map(String::as_str).collect())) }
}

fn bounds(schema: &Value) -> String {
    let of = if schema["items"]["minimum"].is_number() { &schema["items"] } else { schema };
    match (of["minimum"].as_f64(), of["maximum"].as_f64(), schema["x-why"].as_str()) {
        (Some(least), Some(most), Some(why)) => format!("{least} to {most}: {why}"),
        _ => String::new(),
    }
}
