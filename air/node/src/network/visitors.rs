//! Who came and who was turned away, for the events: whose links come and go, and what Zenoh says of refused handshakes
//! and messages.
//!
//! Zenoh tells of a refusal only in its own trace, so a layer of the process's subscriber listens there. It runs on
//! Zenoh's threads: it writes one line into a bounded table and returns.

use std::cell::Cell;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::sync::{Arc, Mutex};

use goshawk_bus::{Bus, BusError};
use goshawk_core::Time;
use goshawk_proto::v1;
use goshawk_vehicle::clock;
use tracing::field::{Field, Visit};
use tracing::{Event, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;
use zenoh_link_tls::REFUSED;

use crate::flight::shared::lock;
use crate::network::access;

/// Different lines that are told apart at a time; further ones share one.
const KEPT: usize = 64;
/// Of these, of one peer.
const KEPT_OF_ONE: usize = 6;
/// The same line is told again so often, s. Chosen by eye.
const AGAIN_S: f64 = 10.0;
/// A line's length.
const LONGEST: usize = 200;
/// Peers whose names are known.
const NAMED: usize = 256;
/// The last thing that Zenoh works out of a key.
const LAST_FORESEEN: &str = "Declare Liveliness Subscriber (ingress)";
/// One that has not come for so long is forgotten, s. Chosen by eye.
const FORGOTTEN_S: f64 = 60.0;
const ACCESS: &str = "zenoh::net::routing::interceptor::access_control";

struct Note {
    severity: v1::Severity,
    who: String,
    text: String,
    /// Since it was last told.
    count: u64,
    told: Option<Time>,
    last: Time,
}

/// What there is to tell, and who is connected. Clones share it.
#[derive(Clone, Default)]
pub struct Visitors {
    table: Arc<Mutex<Vec<Note>>>,
    /// Zenoh's number of a peer, and what to call it.
    peers: Arc<Mutex<HashMap<String, String>>>,
}

thread_local! {
    /// Zenoh is working out what a peer may do with a key, on this thread: it says so of each thing, and nobody asked.
    static FORESEEING: Cell<bool> = const { Cell::new(false) };
}

impl Visitors {
    /// What its layer is to hear; for a filter before it.
    #[must_use]
    pub fn concerns(metadata: &Metadata<'_>) -> bool {
        metadata.target() == ACCESS || metadata.target() == REFUSED
    }

    /// Notes one line about `who`: a warning where it was turned away.
    pub fn note(&self, severity: v1::Severity, who: &str, text: &str, now: Time) {
        let mut table = lock(&self.table);
        let known = |table: &[Note], text: &str| table.iter().position(|note| note.text == text);
        let of_one = table.iter().filter(|note| note.who == who).count();
        let (who, text) = match (known(&table, text), table.len() < KEPT, of_one < KEPT_OF_ONE) {
            (Some(_), ..) | (None, true, true) => (who, text.to_owned()),
            (None, true, false) => (who, format!("{who}: further refusals")),
            (None, false, _) => ("", "further peers".to_owned()),
        };
        match known(&table, &text) {
            Some(k) => {
                table[k].count += 1;
                table[k].last = now;
            }
            None => table.push(Note { severity, who: who.to_owned(), text, count: 1, told: None, last: now }),
        }
    }

    /// Keeps note of whose links come and go, as far as they are of another host or show a certificate.
    ///
    /// # Errors
    /// Zenoh refused the declaration.
    pub fn watch(&self, bus: &Bus) -> Result<(), BusError> {
        let (came, went) = (self.clone(), self.clone());
        bus.watch_links(
            move |link| {
                if let Some(who) = access::visitor(link.name, link.address) {
                    came.came(link.id, &who, clock::now());
                }
            },
            move |id| went.went(id, clock::now()),
        )
    }

    /// A peer is connected; Zenoh's words of it name only its number.
    pub fn came(&self, id: String, who: &str, now: Time) {
        self.note(v1::Severity::Info, who, &format!("{who} is connected"), now);
        let mut peers = lock(&self.peers);
        if peers.len() < NAMED || peers.contains_key(&id) {
            peers.insert(id, who.to_owned());
        }
    }

    /// It is not any more.
    pub fn went(&self, id: &str, now: Time) {
        if let Some(who) = lock(&self.peers).remove(id) {
            self.note(v1::Severity::Info, &who, &format!("{who} is gone"), now);
        }
    }

    /// From `[Using cached result: ]ID [on SUBJECT ]is unauthorized to ACTION on KEY`; none: nobody was refused.
    fn denied(&self, message: &str) -> Option<(String, String)> {
        let message = match message.strip_prefix("Using cached result: ") {
            Some(cached) => cached,
            None if message.starts_with("ACL (ingress)") => {
                FORESEEING.set(true);
                return None;
            }
            None if FORESEEING.get() => {
                FORESEEING.set(!message.contains(LAST_FORESEEN));
                return None;
            }
            None => message,
        };
        let (who, what) = message.split_once(" is unauthorized to ")?;
        let (action, key) = what.split_once(" (ingress) on ")?;
        if action.starts_with("Undeclare") {
            return None;
        }
        let id = who.split(' ').next().unwrap_or(who);
        let who = lock(&self.peers).get(id).cloned().unwrap_or_else(|| format!("peer {id}"));
        let text = format!("{who} may not {} on {key}", action.to_lowercase());
        Some((who, text))
    }

    /// What is to be told now.
    #[must_use]
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
        let refused = event.metadata().target() == REFUSED;
        let line = if refused { Some(failed(&message.0)) } else { self.denied(&message.0) };
        if let Some((who, text)) = line {
            let text: String = text.chars().take(LONGEST).collect();
            self.note(v1::Severity::Warning, &who, &text, clock::now());
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

/// A connection that showed no certificate, or one that is not good: `ADDRESS was refused: REASON`.
fn failed(message: &str) -> (String, String) {
    let (who, _) = message.split_once(' ').unwrap_or(("", message));
    (who.to_owned(), message.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_names_the_peer_by_its_certificate() {
        let visitors = Visitors::default();
        visitors.came("3fa".to_owned(), "observer.bob", Time(0));
        let refused = "observer.bob may not query on goshawk/kite/cmd/start";
        let message =
            "3fa on CertCommonName(observer.bob)+tls is unauthorized to Query (ingress) on goshawk/kite/cmd/start";
        assert_eq!(visitors.denied(message).unwrap().1, refused);
        let cached = "Using cached result: 3fa is unauthorized to Query (ingress) on goshawk/kite/cmd/start";
        assert_eq!(visitors.denied(cached).unwrap().1, refused);
        assert_eq!(visitors.denied("3fa on tls is authorized to Put (ingress) on goshawk/kite/in/rgbd"), None);
        assert_eq!(visitors.denied("3fa on tls is unauthorized to Put (egress) on goshawk/kite/in/rgbd"), None);
    }

    #[test]
    fn what_zenoh_only_foresees_is_no_refusal() {
        let visitors = Visitors::default();
        let say =
            |words: &str| visitors.denied(&format!("3fa on tls is unauthorized to {words} on goshawk/kite/tel/plan"));
        assert_eq!(visitors.denied("ACL (ingress): caching permissions for `goshawk/kite/tel/plan` ..."), None);
        for foreseen in ["Query (ingress)", "Put (ingress)", "Liveliness Query (ingress)", LAST_FORESEEN] {
            assert_eq!(say(foreseen), None, "{foreseen}");
        }
        assert_eq!(say("Put (ingress)").unwrap().1, "peer 3fa may not put on goshawk/kite/tel/plan");
    }

    #[test]
    fn a_flood_of_refusals_is_a_line_each_ten_seconds() {
        let visitors = Visitors::default();
        let at = Time::from_secs;
        let refuse = |now| visitors.note(v1::Severity::Warning, "bob", "bob may not query", now);
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
            visitors.note(v1::Severity::Warning, &format!("{k}"), &format!("peer {k}"), Time::from_secs(1.0));
        }
        let told = visitors.take(Time::from_secs(1.0));
        assert_eq!(told.len(), KEPT + 1);
        assert_eq!(told[KEPT].1, format!("further peers ({} times)", 10_000 - KEPT));
    }

    #[test]
    fn one_peer_takes_no_line_from_another() {
        let visitors = Visitors::default();
        for k in 0..10_000 {
            visitors.note(v1::Severity::Warning, "bob", &format!("bob may not {k}"), Time::from_secs(1.0));
        }
        visitors.note(v1::Severity::Warning, "eve", "eve may not", Time::from_secs(1.0));
        let told = visitors.take(Time::from_secs(1.0));
        assert_eq!(told.len(), KEPT_OF_ONE + 2);
        assert_eq!(told[KEPT_OF_ONE].1, format!("bob: further refusals ({} times)", 10_000 - KEPT_OF_ONE));
        assert_eq!(told[KEPT_OF_ONE + 1].1, "eve may not");
    }
}
