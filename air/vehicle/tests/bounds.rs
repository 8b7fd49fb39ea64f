//! Every number of the vehicle file and the tuning file has bounds: the tests walk the shipped files and the schemas, so
//! that a new key without them fails.

#![allow(clippy::unwrap_used)]

use std::ops::Range;
use std::path::{Path, PathBuf};

use goshawk_vehicle::config::{Vehicle, reference};
use serde_json::Value;

/// One number in the file's text.
struct Number {
    key: String,
    at: Range<usize>,
}

/// The shipped vehicle file with every key that it leaves out or commented, and the tuning file, as one text.
fn text() -> String {
    let shipped = Vehicle::load(&root().join("air/vehicles/sim.toml")).unwrap();
    let whole = shipped.text.replace("# controller_core", "controller_core");
    assert_ne!(whole, shipped.text);
    let profile = "name = \"goal\"\ntask = \"navigate\"\nspeed_mps = 4.0\nheight_m = 2.0\ngoal_m = [9.0, -1.0, 1.5]\n";
    format!("{whole}\n[[profile]]\n{profile}{TUNING}{}", shipped.tuning_text)
}

/// Where the tuning file begins.
const TUNING: &str = "\n# tuning\n";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Every number of `text`, also those in lists, with its key.
fn numbers(text: &str) -> Vec<Number> {
    let mut found = Vec::new();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let code = line.split('#').next().unwrap();
        if let Some((key, value)) = code.split_once('=').filter(|(_, value)| !value.contains('"')) {
            let mut at = start + key.len() + 1;
            for part in value.split_inclusive(['[', ',', ']', ' ', '\n']) {
                let word = part.trim_end_matches(['[', ',', ']', ' ', '\n']);
                if word.parse::<f64>().is_ok() {
                    found.push(Number { key: key.trim().to_owned(), at: at..at + word.len() });
                }
                at += part.len();
            }
        }
        start += line.len();
    }
    found
}

fn with(text: &str, number: &Number, value: &str) -> String {
    [&text[..number.at.start], value, &text[number.at.end..]].concat()
}

/// Why the file is refused; none: it is loaded, and flown with by any policy that fits the camera.
fn refusal(text: String) -> Option<String> {
    let (vehicle, tuning) = text.split_once(TUNING).unwrap();
    Vehicle::parse(vehicle.to_owned(), tuning.to_owned(), Path::new("vehicle.toml"))
        .err()
        .map(|error| error.to_string())
}

#[test]
fn every_number_of_both_files_has_an_upper_and_a_lower_bound() {
    let text = text();
    assert_eq!(refusal(text.clone()), None);
    let numbers = numbers(&text);
    assert!(numbers.len() > 80, "{}", numbers.len());
    for number in &numbers {
        let whole = text[number.at.clone()].parse::<u64>().is_ok();
        let wrong: &[&str] =
            if whole { &["1000000000", "-1000000000"] } else { &["1e9", "1e300", "-1e9", "nan", "inf"] };
        for value in wrong {
            let why = refusal(with(&text, number, value)).unwrap_or_else(|| panic!("{} = {value} flies", number.key));
            assert!(why.contains(&number.key), "{} = {value}: {why}", number.key);
        }
    }
}

#[test]
fn milliseconds_typed_for_seconds_are_refused_and_asked_about() {
    let text = text();
    let times: Vec<Number> = numbers(&text).into_iter().filter(|number| number.key.ends_with("_s")).collect();
    assert!(times.len() > 20, "{}", times.len());
    for number in times {
        let seconds: f64 = text[number.at.clone()].parse().unwrap();
        let why = refusal(with(&text, &number, &format!("{:?}", 1000.0 * seconds)));
        let why = why.unwrap_or_else(|| panic!("{} ms for {} flies", 1000.0 * seconds, number.key));
        assert!(why.contains(&number.key) && why.contains("not milliseconds?"), "{why}");
    }
}

#[test]
fn a_limit_so_wide_that_it_limits_nothing_is_refused_with_its_range_and_reason() {
    let text = text();
    for (key, value, range, reason) in [
        ("odometry_stale_s", "1e9", "0.02 to 0.5", "dead reckoning"),
        ("plan_stale_s", "60.0", "0.05 to 1", "flies blind"),
        ("fence_radius_m", "1e300", "1 to 10000", "battery"),
        ("threads", "1000000", "1 to 64", "only wait"),
        ("gate_sigmas", "21.0", "1 to 20", "takes all for the target"),
        ("max_acc_mps2", "31.0", "1 to 30", "no airframe gives"),
        ("remember_within_m", "11.0", "0 to 10", "never be forgotten"),
    ] {
        let number = numbers(&text).into_iter().find(|number| number.key == key).unwrap();
        let why = refusal(with(&text, &number, value)).unwrap();
        assert!(why.contains(&format!("{key} is ")) && why.contains(range) && why.contains(reason), "{why}");
        assert_eq!(why.lines().count(), 1);
    }
}

/// Each key of a schema with its dotted name.
fn keys<'a>(schema: &'a Value, name: &str, found: &mut Vec<(String, &'a Value)>) {
    for (key, schema) in schema["properties"].as_object().into_iter().flatten() {
        let name = format!("{name}{key}");
        for inner in [schema, &schema["items"]] {
            keys(inner, &format!("{name}."), found);
        }
        found.push((name, schema));
    }
}

#[test]
fn every_key_says_what_it_does_and_every_number_has_bounds_their_reason_and_a_source() {
    let schemas = [reference::vehicle_schema(), reference::tuning_schema()];
    let mut found = Vec::new();
    for schema in &schemas {
        assert_eq!(schema["additionalProperties"], false);
        keys(schema, "", &mut found);
    }
    assert!(found.len() > 100, "{}", found.len());
    for (name, schema) in found {
        assert!(schema["description"].as_str().is_some_and(|text| text.len() > 5), "{name} says nothing");
        let number = if schema["items"].is_object() { &schema["items"] } else { schema };
        let kind = number["type"].as_str().or(number["type"][0].as_str()).unwrap_or_default();
        if ["number", "integer"].contains(&kind) {
            assert!(number["minimum"].is_number() && number["maximum"].is_number(), "{name} has no bounds");
            assert!(schema["x-why"].as_str().is_some_and(|why| why.len() > 5), "{name} has no reason for its bounds");
            assert!(schema["x-source"].as_str().is_some_and(|from| from.len() > 5), "{name}: where is it from?");
        }
    }
}
