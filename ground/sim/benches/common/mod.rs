//! What the benchmarks share: time on a core, and `target/bench.json`.
#![allow(dead_code, reason = "each benchmark uses a part")]

use std::path::Path;

use rustix::time::{ClockId, clock_gettime};

/// Seconds that this thread has had a core, so that a busy machine does not distort a figure per core.
pub(crate) fn core_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// The middle of values in any order; there must be one.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// A quantile of values in any order; there must be one.
pub(crate) fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q).round() as usize]
}

/// A row of quantiles whose 99th percentile has a target.
pub(crate) fn row(p50: f64, p99: f64, target: f64) -> serde_json::Value {
    serde_json::json!({"p50": p50, "p99": p99, "target": target})
}

/// Of a target.
pub(crate) fn verdict(met: bool) -> &'static str {
    if met { "met" } else { "missed" }
}

/// A figure to a tenth.
pub(crate) fn tenths(value: f64) -> serde_json::Value {
    ((value * 10.0).round() / 10.0).into()
}

/// Sets one key of `target/bench.json`, keeping the others.
pub(crate) fn record(key: &str, value: serde_json::Value) -> color_eyre::Result<()> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/bench.json");
    let mut figures: serde_json::Map<String, serde_json::Value> = match std::fs::read(&path) {
        Ok(text) => serde_json::from_slice(&text)?,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => serde_json::Map::new(),
        Err(error) => return Err(error.into()),
    };
    figures.insert(key.to_owned(), value);
    std::fs::write(&path, serde_json::to_string_pretty(&figures)? + "\n")?;
    Ok(())
}
