//! Counting what is the same, and naming the first field that is not.

use std::fmt::Debug;

use prost::Message;
use serde::Serialize;

/// How many were compared, and how many are the same bit for bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Count {
    /// Compared.
    pub of: u64,
    /// The same.
    pub same: u64,
}

/// One difference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// The vehicle's clock.
    pub stamp_ns: u64,
    /// Since the log's beginning, s.
    pub at_s: f64,
    /// Such as "control 12".
    pub what: String,
    /// Path of the first field that differs.
    pub field: String,
    /// In the log.
    pub logged: String,
    /// Now.
    pub replayed: String,
}

impl Count {
    /// Compares two messages as they are encoded; gives the first field that differs.
    pub fn compare<M: Message + Debug>(&mut self, logged: &M, replayed: &M) -> Option<[String; 3]> {
        self.of += 1;
        if logged.encode_to_vec() == replayed.encode_to_vec() {
            self.same += 1;
            return None;
        }
        Some(first_field(logged, replayed))
    }
}

/// Keeps the earlier of two differences.
pub(super) fn keep_first(held: &mut Option<Difference>, found: Difference) {
    if held.as_ref().is_none_or(|held| found.stamp_ns < held.stamp_ns) {
        *held = Some(found);
    }
}

/// Path, first and second value of the first field in which two values of a type differ. It is found in their pretty
/// `Debug` text, which names every field and tells floats apart to the last bit.
pub(super) fn first_field(a: &impl Debug, b: &impl Debug) -> [String; 3] {
    let (a, b) = (format!("{a:#?}"), format!("{b:#?}"));
    let mut path: Vec<(usize, &str)> = Vec::new();
    let mut items: Vec<usize> = Vec::new();
    for (a, b) in a.lines().zip(b.lines()) {
        let depth = (a.len() - a.trim_start().len()) / 4;
        path.retain(|(held, _)| *held < depth);
        items.truncate(depth + 1);
        items.resize(depth + 1, 0);
        let (a, b) = (a.trim().trim_end_matches(','), b.trim().trim_end_matches(','));
        let named = a.split_once(": ").filter(|(name, _)| !name.contains(['"', ' ']));
        if let Some((name, _)) = named {
            path.push((depth, name));
        }
        if a != b {
            let value = |text: &str| text.split_once(": ").map_or(text, |(_, value)| value).to_owned();
            let mut field: Vec<String> = path.iter().map(|(_, name)| (*name).to_owned()).collect();
            if named.is_none() {
                field.push(items[depth].to_string());
            }
            return [field.join("."), value(a), value(b)];
        }
        if named.is_none() && !a.starts_with([']', '}', ')']) {
            items[depth] += 1;
        }
    }
    ["length".to_owned(), format!("{} lines", a.lines().count()), format!("{} lines", b.lines().count())]
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_proto::v1;

    #[test]
    fn the_first_field_that_differs_is_named_with_both_values() {
        let candidate = |cost| v1::Candidate { cost, ..Default::default() };
        let plan = |cost| v1::Plan { candidates: vec![candidate(1.0), candidate(cost)], ..Default::default() };
        let mut count = Count::default();
        assert_eq!(count.compare(&plan(2.0), &plan(2.0)), None);
        let [field, logged, replayed] = count.compare(&plan(2.0), &plan(3.0)).unwrap();
        assert!(field.starts_with("candidates") && field.ends_with("cost"), "{field}");
        assert_eq!((logged.as_str(), replayed.as_str()), ("2.0", "3.0"));
        let control =
            |x: f64| v1::Control { acc_des_world: Some(v1::Vec3 { x, y: 0.0, z: 0.0 }), ..Default::default() };
        let last_bit = f64::from_bits(1.0f64.to_bits() + 1);
        let [field, ..] = count.compare(&control(1.0), &control(last_bit)).unwrap();
        assert_eq!(field, "acc_des_world.x");
        assert_eq!(count, Count { of: 3, same: 1 });
    }
}
