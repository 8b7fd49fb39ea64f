//! Who came and who was turned away, for the events: whose links come and go, and what Zenoh says of refused handshakes
//! and messages.
//!
//! Zenoh tells of a refusal only in its own trace, so a layer of the process's subscriber listens there. It runs on
//! Zenoh's threads: it writes one line into a bounded table and returns.

use std::fmt::Write as _;
use std::sync::{Arc, Mutex};

use goshawk_core::Time;
use goshawk_proto::v1;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

use crate::clock;
use crate::shared::lock;

/// Different lines that are told apart at a time; further ones share one.
const KEPT: usize = 32;
/// The same line is told again so often, s.
const AGAIN_S: f64 = 10.0;
/// One that has not come for so long is forgotten, s.
const FORGOTTEN_S: f64 = 60.0;
const ACCESS: &str = "zenoh::net::routing::interceptor::access_control";
const HANDSHAKES: [&str; 2] = ["zenoh_link_tls", "zenoh_link_commons::quic"];

struct Note {
    severity: v1::Severity,
    text: String,
    /// Since it was last told.
    count: u64,
    told: Option<Time>,
    last: Time,
}

/// What there is to tell. Clones share it.
#[derive(Clone, Default)]
pub struct Visitors {
    table: Arc<Mutex<Vec<Note>>>,
}

impl Visitors {
    /// What its layer is to hear; for a filter before it.
    #[must_use]
    pub fn concerns(metadata: &Metadata<'_>) -> bool {
        let target = metadata.target();
        let handshake = || HANDSHAKES.iter().any(|prefix| target.starts_with(prefix));
        target == ACCESS || (*metadata.level() <= Level::WARN && handshake())
    }

    /// Notes one line: a warning where somebody was turned away.
    pub fn note(&self, severity: v1::Severity, text: &str, now: Time) {
        let mut table = lock(&self.table);
        let known = |table: &[Note], text: &str| table.iter().position(|note| note.text == text);
        let full = table.len() >= KEPT && known(&table, text).is_none();
        let (severity, text) = if full { (v1::Severity::Warning, "further peers") } else { (severity, text) };
        match known(&table, text) {
            Some(k) => {
                table[k].count += 1;
                table[k].last = now;
            }
            None => table.push(Note { severity, text: text.to_owned(), count: 1, told: None, last: now }),
        }
    }

    /// What is to be told now.
    pub fn take(&self, now: Time) -> Vec<(v1::Severity, String)> {
        let mut table = lock(&self.table);
        table.retain(|note| note.count > 0 || now.since(note.last) < FORGOTTEN_S);
        table
            .iter_mut()
            .filter(|note| note.count > 0 && note.told.is_none_or(|told| now.since(told) >= AGAIN_S))
            .map(|note| {
                note.told = Some(now);
                let count = std::mem::take(&mut note.count);
                let text = if count == 1 { note.text.clone() } else { format!("{} ({count} times)", note.text) };
                (note.severity, text)
            })
            .collect()
    }
}

impl<S: Subscriber> Layer<S> for Visitors {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut message = Message::default();
        event.record(&mut message);
        let line = if event.metadata().target() == ACCESS { denied(&message.0) } else { failed(&message.0) };
        if let Some(line) = line {
            self.note(v1::Severity::Warning, &line, clock::now());
        }
    }
}

/// The message alone, cut short.
#[derive(Default)]
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        if field.name() == "message" {
            let _ = write!(self.0, "{value:?}");
        }
    }
}

/// From `ID on SUBJECT is unauthorized to ACTION on KEY`; none: it was no note.
fn denied(message: &str) -> Option<String> {
    let (who, what) = message.split_once(" is unauthorized to ")?;
    let who = match who.split_once("CertCommonName(").and_then(|(_, rest)| rest.split_once(')')) {
        Some((name, _)) => name.to_owned(),
        None => {
            let id = who.trim_start_matches("Using cached result: ").split(' ').next().unwrap_or(who);
            format!("a peer without a certificate ({id})")
        }
    };
    let what = what.replace(" (ingress)", "").to_lowercase();
    Some(format!("{who} may not {what}").chars().take(160).collect())
}

/// A connection that showed no certificate, or one that is not good.
fn failed(message: &str) -> Option<String> {
    let why = message.split(" Hint:").next().unwrap_or(message).trim_end_matches('.');
    // The port is another one each time.
    let words: Vec<&str> = why.split_whitespace().map(without_port).collect();
    Some(format!("a connection was refused: {}", words.join(" ")).chars().take(160).collect())
}

fn without_port(word: &str) -> &str {
    let bare = word.trim_end_matches([':', ',']);
    match bare.parse::<std::net::SocketAddr>() {
        Ok(_) => bare.rsplit_once(':').map_or(bare, |(host, _)| host),
        Err(_) => word,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_note_names_the_peer_by_its_certificate() {
        let message = "3fa on Interface(lo)+CertCommonName(observer.bob)+tls+3fa is unauthorized to Query (ingress) on \
                       goshawk/kite/cmd/start";
        assert_eq!(denied(message).unwrap(), "observer.bob may not query on goshawk/kite/cmd/start");
        assert_eq!(denied("3fa on tls is authorized to Put on goshawk/kite/in/rgbd"), None);
    }

    #[test]
    fn a_flood_of_refusals_is_a_line_each_ten_seconds() {
        let visitors = Visitors::default();
        let at = Time::from_secs;
        let refuse = |now| visitors.note(v1::Severity::Warning, "bob may not query", now);
        for k in 0..100_000 {
            refuse(at(f64::from(k) * 1e-4));
        }
        assert_eq!(visitors.take(at(10.0))[0].1, "bob may not query (100000 times)");
        refuse(at(10.1));
        assert!(visitors.take(at(11.0)).is_empty());
        assert_eq!(visitors.take(at(20.0))[0].1, "bob may not query");
    }

    #[test]
    fn ten_thousand_different_peers_fill_no_memory() {
        let visitors = Visitors::default();
        for k in 0..10_000 {
            visitors.note(v1::Severity::Warning, &format!("peer {k}"), Time::from_secs(1.0));
        }
        let told = visitors.take(Time::from_secs(1.0));
        assert_eq!(told.len(), KEPT + 1);
        assert_eq!(told[KEPT].1, format!("further peers ({} times)", 10_000 - KEPT));
    }
}
