//! Room for the next flight: the oldest logs go when there are too many.

use std::path::{Path, PathBuf};

/// How a log's time begins; a `d` is any digit.
const DATE: &[u8] = b"dddd-dd-ddT";

/// Removes the oldest logs of `folder` until those that are left hold at most `keep_bytes`; returns what it removed.
/// A log is a file named `prefixTIME.mcap`, so the first by name is the oldest. Nothing else is touched: no log of another
/// vehicle whose name begins alike. What cannot be read or removed is passed over.
#[must_use]
pub fn rotate(folder: &Path, prefix: &str, keep_bytes: u64) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut logs: Vec<(PathBuf, u64)> = entries
        .flatten()
        .filter(|entry| {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            name.strip_prefix(prefix).and_then(|name| name.strip_suffix(".mcap")).is_some_and(is_time)
        })
        .filter_map(|entry| Some((entry.path(), entry.metadata().ok().filter(std::fs::Metadata::is_file)?.len())))
        .collect();
    logs.sort();
    let mut held: u64 = logs.iter().map(|(_, bytes)| bytes).sum();
    let mut removed = Vec::new();
    for (path, bytes) in logs {
        if held <= keep_bytes {
            break;
        }
        if std::fs::remove_file(&path).is_ok() {
            held -= bytes;
            removed.push(path);
        }
    }
    removed
}

fn is_time(name: &str) -> bool {
    let fits = |(byte, form): (u8, &u8)| if *form == b'd' { byte.is_ascii_digit() } else { byte == *form };
    name.len() > DATE.len() && name.bytes().zip(DATE).all(fits)
}
