//! What a file may hold, as JSON Schema; each key's range is an attribute of its field, and so in the schema. By that
//! each number of a file is checked.

use goshawk_core::{ConfigError, within};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::Value as Schema;
use toml::{Table, Value};

/// A file's schema, draft 7, which editors of TOML read.
pub(super) fn schema<T: JsonSchema>() -> Schema {
    let settings = SchemaSettings::draft07().with(|settings| settings.inline_subschemas = true);
    settings.into_generator().into_root_schema_for::<T>().to_value()
}

/// Every number of `file` lies in its range.
///
/// # Errors
/// The first that does not, by its key.
pub(super) fn check(file: &Table, schema: &Schema) -> Result<(), ConfigError> {
    table(file, schema, "")
}

fn table(file: &Table, schema: &Schema, prefix: &str) -> Result<(), ConfigError> {
    file.iter().try_for_each(|(key, value)| {
        let schema = &schema["properties"][key];
        one(value, schema, &format!("{prefix}{key}"), schema["x-why"].as_str().unwrap_or_default())
    })
}

fn one(value: &Value, schema: &Schema, key: &str, why: &str) -> Result<(), ConfigError> {
    match value {
        Value::Float(number) => within(key, *number, range(schema), why),
        Value::Integer(number) => within(key, *number as f64, range(schema), why),
        Value::Table(inner) => table(inner, schema, &format!("{key}.")),
        Value::Array(items) => items.iter().try_for_each(|item| {
            // Of several tables each has a name.
            let name = item.get("name").and_then(Value::as_str).map(|name| format!("{key} {name}"));
            one(item, &schema["items"], name.as_deref().unwrap_or(key), why)
        }),
        _ => Ok(()),
    }
}

fn range(schema: &Schema) -> std::ops::RangeInclusive<f64> {
    let bound = |name: &str, none| schema[name].as_f64().unwrap_or(none);
    bound("minimum", f64::NEG_INFINITY)..=bound("maximum", f64::INFINITY)
}
