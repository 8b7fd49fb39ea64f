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
        let stamps = stamps.chain(page.targets.iter().map(|t| t.stamp_ns));
        asked.after_ns = stamps.max().unwrap_or(asked.after_ns);
        (asked.session, asked.after_event) =
            (page.session, page.events.last().map_or(asked.after_event, |event| event.seq));
        whole.dropped_events = whole.dropped_events.max(page.dropped_events);
        whole.dropped_samples = page.dropped_samples;
        whole.events.extend(page.events);
        whole.controls.extend(page.controls);
        whole.targets.extend(page.targets);
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
        memory.target(&v1::Target { stamp_ns: k * SECOND / 10, confirmed: true, ..Default::default() });
        if k % 5 == 0 {
            memory.health(&v1::Health { stamp_ns: k * SECOND / 10, ..Default::default() });
        }
    }
    let told = all(&memory, v1::MissedRequest { before_ns: u64::MAX, ..Default::default() });
    let tenths = |stamps: Vec<u64>| stamps.into_iter().map(|stamp| stamp / (SECOND / 10)).collect::<Vec<u64>>();
    let want: Vec<u64> = (250..=350).step_by(2).collect();
    assert_eq!(tenths(told.controls.iter().map(|control| control.stamp_ns).collect()), want);
    assert_eq!(tenths(told.targets.iter().map(|target| target.stamp_ns).collect()), want);
    assert_eq!(told.healths.len(), 21);
    let within = v1::MissedRequest { after_ns: 29 * SECOND, before_ns: 30 * SECOND, ..Default::default() };
    assert_eq!(all(&memory, within).controls.len(), 4);
}

#[test]
fn of_an_image_that_was_taken_before_a_step_or_with_it_nothing_is_lost_between_pages() {
    for before_ns in [0, SECOND / 20] {
        let mut memory = Memory::default();
        memory.event(event(10, v1::Severity::Warning, "an alert"));
        for k in 0..26 {
            let stamp_ns = 10 * SECOND + k * SECOND / 5;
            memory.control(&control(stamp_ns));
            memory.target(&v1::Target {
                stamp_ns: stamp_ns - before_ns,
                covariance_upper: vec![1.0; 200],
                ..Default::default()
            });
        }
        let asked = v1::MissedRequest { before_ns: u64::MAX, ..Default::default() };
        assert!(memory.page(&asked).more);
        let told = all(&memory, asked);
        assert_eq!((told.controls.len(), told.targets.len()), (26, 26));
    }
}

#[test]
fn a_flood_of_events_fills_no_memory_and_what_fell_out_is_counted() {
    let mut memory = Memory::default();
    for k in 1..=10_000 {
        memory.event(event(k, v1::Severity::Warning, &"long ".repeat(if k % 2 == 0 { 1 } else { 100 })));
        for tenth in 0..10 {
            let stamp_ns = k * SECOND + tenth * SECOND / 10;
            memory.control(&v1::Control { thrust_n: 1.0, ..control(stamp_ns) });
            memory.target(&v1::Target { stamp_ns, covariance_upper: vec![1.0; 21], ..Default::default() });
        }
    }
    let told = all(&memory, v1::MissedRequest { before_ns: u64::MAX, ..Default::default() });
    assert_eq!(told.dropped_events + told.events.len() as u64, 10_000);
    assert_eq!(told.events.last().unwrap().seq, 10_000);
    let bytes = |lengths: Vec<usize>| lengths.iter().sum::<usize>();
    assert!(told.events.len() <= 200 && bytes(told.events.iter().map(Message::encoded_len).collect()) <= 64 << 10);
    let lengths = told.controls.iter().map(Message::encoded_len).chain(told.targets.iter().map(Message::encoded_len));
    assert!(bytes(lengths.collect()) <= 512 << 10);
    assert_eq!(told.dropped_samples + (told.controls.len() + told.targets.len()) as u64, 100_000);
}
