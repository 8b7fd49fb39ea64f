//! Compiles the messages (no `protoc` needed) and turns the key table into Rust constants, both at build time: a wrong
//! table or message does not build.

use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;

use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    protocol: u32,
    key: Vec<Row>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    name: String,
    suffix: String,
    kind: String,
    from: Vec<String>,
    to: Vec<String>,
    message: String,
    #[serde(default)]
    reply: String,
    priority: String,
    congestion: String,
    express: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=goshawk");
    println!("cargo::rerun-if-changed=keys.toml");
    let out = PathBuf::from(std::env::var("OUT_DIR")?);

    let mut files = protox::compile(["goshawk/v1/goshawk.proto"], ["."])?;
    prost_build::Config::new().compile_fds(files.clone())?;
    for file in &mut files.file {
        file.source_code_info = None; // comments are for prost; every log carries the rest
    }
    std::fs::write(out.join("descriptor_set.bin"), protox::prost::Message::encode_to_vec(&files))?;

    let messages: Vec<&str> = files
        .file
        .iter()
        .flat_map(|f| &f.message_type)
        .map(protox::prost_reflect::prost_types::DescriptorProto::name)
        .collect();
    let table: Table = toml::from_str(&std::fs::read_to_string("keys.toml")?)?;
    std::fs::write(out.join("keys.rs"), generate(&table, &messages)?)?;
    Ok(())
}

/// The enum `Key` and its rows, in the table's order.
fn generate(table: &Table, messages: &[&str]) -> Result<String, Box<dyn Error>> {
    let mut variants = String::new();
    let mut all = String::new();
    let mut rows = String::new();
    for row in &table.key {
        let variant = camel(&row.name);
        writeln!(variants, "    /// `goshawk/{{vehicle}}/{}`\n    {variant},", row.suffix)?;
        write!(all, "Key::{variant}, ")?;
        writeln!(
            rows,
            "    KeyRow {{ name: {:?}, suffix: {:?}, kind: Kind::{}, from: {}, to: {}, message: {}, reply: {}, \
             priority: Priority::{}, congestion: Congestion::{}, express: {} }},",
            row.name,
            row.suffix,
            one_of(&row.kind, &["pub", "query", "liveliness"])?,
            roles(&row.from)?,
            roles(&row.to)?,
            message(&row.message, messages)?,
            message(&row.reply, messages)?,
            one_of(
                &row.priority,
                &["real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background"]
            )?,
            one_of(&row.congestion, &["drop", "block"])?,
            row.express
        )?;
    }
    let count = table.key.len();
    Ok(format!(
        "/// The table's `protocol`.\n\
         pub const PROTOCOL: u32 = {};\n\n\
         /// A row of the key table.\n\
         #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]\n\
         pub enum Key {{\n{variants}}}\n\n\
         impl Key {{\n    /// Every key, in the table's order.\n    pub const ALL: [Key; {count}] = [{all}];\n}}\n\n\
         const ROWS: [KeyRow; {count}] = [\n{rows}];\n",
        table.protocol
    ))
}

fn camel(name: &str) -> String {
    name.split('_').map(|word| word[..1].to_uppercase() + &word[1..]).collect()
}

fn one_of(value: &str, allowed: &[&str]) -> Result<String, Box<dyn Error>> {
    if allowed.contains(&value) {
        Ok(camel(value))
    } else {
        Err(format!("keys.toml: {value:?}: not one of {allowed:?}").into())
    }
}

fn roles(names: &[String]) -> Result<String, Box<dyn Error>> {
    let roles: Result<Vec<String>, _> =
        names.iter().map(|name| one_of(name, &["vehicle", "sensor", "operator", "observer"])).collect();
    Ok(format!("&[{}]", roles?.iter().map(|role| format!("Role::{role}")).collect::<Vec<_>>().join(", ")))
}

fn message(name: &str, messages: &[&str]) -> Result<String, Box<dyn Error>> {
    match name {
        "" => Ok("None".to_owned()),
        _ if messages.contains(&name) => Ok(format!("Some(\"goshawk.v1.{name}\")")),
        _ => Err(format!("keys.toml names {name:?}, which goshawk.proto does not define").into()),
    }
}
