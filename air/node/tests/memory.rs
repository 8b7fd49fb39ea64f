//! What a ground that was away is told: what it lacks, about the alerts, in pages, bounded.

use goshawk_air::network::memory::Memory;
use goshawk_proto::v1;
use prost::Message;

/// What a page may hold, bytes.
const PAGE_BYTES: usize = 8 << 10;
const SECOND: u64 = 1_000_000_000;

fn event(at_s: u64, severity: v1::Severity, text: &str) -> v1::Event {
    v1::Event { stamp_ns: at_s * SECOND, severity: severity.into(), text: text.to_owned(), ..Default::default() }
}

fn control(stamp_ns: u64) -> v1::Control {
    v1::Control { stamp_ns, ..Default::default() }
}

/// Everything that an asker of `asked` is told, page by page.
fn all(memory: &Memory, mut asked: v1::MissedRequest) -> v1::Missed {
    let mut whole = v1::Missed::default();
    loop {
        let page = memory.page(&asked);
        assert!(page.encoded_len() < PAGE_BYTES + 64, "{} bytes", page.encoded_len());
        let stamps = page.controls.iter().map(|c| c.stamp_ns).chain(page.healths.iter().map(|h| h.stamp_ns));
        asked.after_ns = stamps.max().unwrap_or(asked.after_ns);
        (asked.session, asked.after_event) =
            (page.session, page.events.last().map_or(asked.after_event, |event| event.seq));
        whole.dropped_events = whole.dropped_events.max(page.dropped_events);
        whole.dropped_samples = page.dropped_samples;
        whole.events.extend(page.events);
        whole.controls.extend(page.controls);
        whole.healths.extend(page.healths);
        if !page.more {
            return whole;
        }
    }
}

#[test]
fn an_asker_is_told_the_events_that_it_lacks_and_of_another_session_all() {
    let mut memory = Memory::default();
    for k in 0..5 {
        memory.event(event(k, v1::Severity::Info, "told"));
    }
    let asked = v1::MissedRequest { session: memory.session(), after_event: 3, ..Default::default() };
    let seqs = |page: v1::Missed| page.events.iter().map(|event| event.seq).collect::<Vec<_>>();
    assert_eq!(seqs(memory.page(&asked)), [4, 5]);
    assert_eq!(seqs(memory.page(&v1::MissedRequest { session: 7, ..asked })), [1, 2, 3, 4, 5]);
}

#[test]
fn five_seconds_before_and_after_an_alert_are_kept_and_nothing_else() {
    let mut memory = Memory::default();
    for k in 0..600 {
        if k == 300 {
            memory.event(event(30, v1::Severity::Info, "of no matter"));
            memory.event(event(30, v1::Severity::Warning, "an alert"));
        }
        memory.control(&control(k * SECOND / 10));
        if k % 5 == 0 {
            memory.health(&v1::Health { stamp_ns: k * SECOND / 10, ..Default::default() });
        }
    }
    let told = all(&memory, v1::MissedRequest { before_ns: u64::MAX, ..Default::default() });
    let times: Vec<u64> = told.controls.iter().map(|control| control.stamp_ns / (SECOND / 10)).collect();
    assert_eq!(times, (250..=350).step_by(2).collect::<Vec<u64>>());
    assert_eq!(told.healths.len(), 21);
    let within = v1::MissedRequest { after_ns: 29 * SECOND, before_ns: 30 * SECOND, ..Default::default() };
    assert_eq!(all(&memory, within).controls.len(), 4);
}

#[test]
fn a_flood_of_events_fills_no_memory_and_what_fell_out_is_counted() {
    let mut memory = Memory::default();
    for k in 1..=10_000 {
        memory.event(event(k, v1::Severity::Warning, &"long ".repeat(if k % 2 == 0 { 1 } else { 100 })));
        for tenth in 0..10 {
            memory.control(&v1::Control { thrust_n: 1.0, ..control(k * SECOND + tenth * SECOND / 10) });
        }
    }
    let told = all(&memory, v1::MissedRequest { before_ns: u64::MAX, ..Default::default() });
    assert_eq!(told.dropped_events + told.events.len() as u64, 10_000);
    assert_eq!(told.events.last().unwrap().seq, 10_000);
    let bytes = |lengths: Vec<usize>| lengths.iter().sum::<usize>();
    assert!(told.events.len() <= 200 && bytes(told.events.iter().map(Message::encoded_len).collect()) <= 64 << 10);
    assert!(bytes(told.controls.iter().map(Message::encoded_len).collect()) <= 512 << 10);
    assert_eq!(told.dropped_samples + told.controls.len() as u64, 50_000);
}
