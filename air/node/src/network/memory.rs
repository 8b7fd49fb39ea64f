//! What a ground that was away has missed: the newest events, and what controller, target filter and health said about
//! each alert. It is bounded in number and bytes: the oldest falls out, and is counted.

use std::collections::VecDeque;
use std::time::{SystemTime, UNIX_EPOCH};

use goshawk_proto::v1;
use prost::Message;

/// Events that are kept: as many as a ground lists.
const EVENTS: usize = 200;
/// Bytes of them: an autopilot's text or a stranger's name may be long.
const EVENT_BYTES: usize = 64 << 10;
/// Bytes of the samples that are kept: a dozen alerts.
const SAMPLE_BYTES: usize = 512 << 10;
/// Before an alert and after it, ns: 5 s. Chosen by eye.
const AROUND_NS: u64 = 5_000_000_000;
/// A controller step and an estimate of the target so often, ns: 5 Hz.
const PERIOD_NS: u64 = 200_000_000;
/// A page, bytes. What waits for a weak link is 32 kB of this urgency, and the whole page is dropped if it does not fit.
const PAGE_BYTES: usize = 8 << 10;
/// What a message costs in a page beside itself, bytes: its tag and its length.
const HEAD_BYTES: usize = 3;

/// Something that was told, with its time.
enum Sample {
    Control(v1::Control),
    Target(v1::Target),
    Health(v1::Health),
}

impl Sample {
    fn stamp_ns(&self) -> u64 {
        match self {
            Sample::Control(control) => control.stamp_ns,
            Sample::Target(target) => target.stamp_ns,
            Sample::Health(health) => health.stamp_ns,
        }
    }

    fn size(&self) -> usize {
        match self {
            Sample::Control(control) => HEAD_BYTES + control.encoded_len(),
            Sample::Target(target) => HEAD_BYTES + target.encoded_len(),
            Sample::Health(health) => HEAD_BYTES + health.encoded_len(),
        }
    }
}

/// A queue whose oldest fall out.
struct Kept<T> {
    items: VecDeque<(usize, T)>,
    bytes: usize,
    dropped: u64,
}

impl<T> Kept<T> {
    fn new() -> Self {
        Kept { items: VecDeque::new(), bytes: 0, dropped: 0 }
    }

    /// Before those that are `later`: an image's time is told after that of steps that came since.
    fn push(&mut self, item: T, size: usize, later: impl Fn(&T) -> bool, most: usize, most_bytes: usize) {
        let behind = self.items.iter().rev().take_while(|(_, kept)| later(kept)).count();
        self.items.insert(self.items.len() - behind, (size, item));
        self.bytes += size;
        while self.items.len() > most || self.bytes > most_bytes {
            let Some((size, _)) = self.items.pop_front() else { break };
            self.bytes -= size;
            self.dropped += 1;
        }
    }
}

/// The room that is left in a page.
struct Room(usize);

impl Room {
    /// Whether so many bytes go into it; the first item always does.
    fn takes(&mut self, size: usize) -> bool {
        let fits = self.0 == PAGE_BYTES || size <= self.0;
        self.0 = if fits { self.0.saturating_sub(size) } else { self.0 };
        fits
    }
}

/// What is kept for whoever missed it.
pub struct Memory {
    session: u64,
    /// Events since the session began.
    told: u64,
    events: Kept<v1::Event>,
    /// The samples of the last [`AROUND_NS`], in case of an alert.
    recent: VecDeque<Sample>,
    samples: Kept<Sample>,
    /// What is told before is kept.
    keep_until_ns: u64,
    last_control_ns: u64,
    last_target_ns: u64,
}

impl Default for Memory {
    /// An empty one of a new session.
    fn default() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Memory {
            session: (since.as_nanos() as u64).max(1),
            told: 0,
            events: Kept::new(),
            recent: VecDeque::new(),
            samples: Kept::new(),
            keep_until_ns: 0,
            last_control_ns: 0,
            last_target_ns: 0,
        }
    }
}

impl Memory {
    /// Another number each time that the process starts.
    #[must_use]
    pub fn session(&self) -> u64 {
        self.session
    }

    /// Events since then.
    #[must_use]
    pub fn told(&self) -> u64 {
        self.told
    }

    /// Numbers an event and keeps it. A warning, an error and a change of the mode are alerts.
    pub fn event(&mut self, event: v1::Event) -> v1::Event {
        self.told += 1;
        let event = v1::Event { seq: self.told, ..event };
        let size = HEAD_BYTES + event.encoded_len();
        self.events.push(event.clone(), size, |_| false, EVENTS, EVENT_BYTES);
        if event.severity() >= v1::Severity::Warning || event.kind == "mode" {
            self.keep_until_ns = event.stamp_ns + AROUND_NS;
            for sample in std::mem::take(&mut self.recent) {
                if event.stamp_ns.saturating_sub(sample.stamp_ns()) <= AROUND_NS {
                    self.keep(sample);
                }
            }
        }
        event
    }

    /// A controller step, which counts if it is one of five a second.
    pub fn control(&mut self, control: &v1::Control) {
        if control.stamp_ns.saturating_sub(self.last_control_ns) >= PERIOD_NS {
            self.last_control_ns = control.stamp_ns;
            self.sample(Sample::Control(*control));
        }
    }

    /// An estimate of the target, likewise.
    pub fn target(&mut self, target: &v1::Target) {
        if target.stamp_ns.saturating_sub(self.last_target_ns) >= PERIOD_NS {
            self.last_target_ns = target.stamp_ns;
            self.sample(Sample::Target(target.clone()));
        }
    }

    /// A heartbeat. Its histograms are of the whole session, and long.
    pub fn health(&mut self, health: &v1::Health) {
        let mut health = health.clone();
        for latency in &mut health.latencies {
            latency.histogram.clear();
        }
        self.sample(Sample::Health(health));
    }

    fn sample(&mut self, sample: Sample) {
        let stamp_ns = sample.stamp_ns();
        if stamp_ns <= self.keep_until_ns {
            return self.keep(sample);
        }
        self.recent.push_back(sample);
        while self.recent.front().is_some_and(|oldest| stamp_ns.saturating_sub(oldest.stamp_ns()) > AROUND_NS) {
            self.recent.pop_front();
        }
    }

    fn keep(&mut self, sample: Sample) {
        let (size, stamp_ns) = (sample.size(), sample.stamp_ns());
        self.samples.push(sample, size, |kept| kept.stamp_ns() > stamp_ns, usize::MAX, SAMPLE_BYTES);
    }

    /// What the asker lacks, as much as goes into one page.
    #[must_use]
    pub fn page(&self, asked: &v1::MissedRequest) -> v1::Missed {
        let after_event = if asked.session == self.session { asked.after_event } else { 0 };
        let mut page = v1::Missed {
            session: self.session,
            dropped_events: self.events.dropped.saturating_sub(after_event),
            dropped_samples: self.samples.dropped,
            ..v1::Missed::default()
        };
        let mut room = Room(PAGE_BYTES);
        for (size, event) in self.events.items.iter().filter(|(_, event)| event.seq > after_event) {
            if !room.takes(*size) {
                page.more = true;
                return page;
            }
            page.events.push(event.clone());
        }
        let missed = |sample: &Sample| sample.stamp_ns() > asked.after_ns && sample.stamp_ns() < asked.before_ns;
        for (size, sample) in self.samples.items.iter().filter(|(_, sample)| missed(sample)) {
            if !room.takes(*size) {
                page.more = true;
                // The next page begins after a time, so what is of one time is not parted.
                let before = |stamp_ns: u64| stamp_ns < sample.stamp_ns();
                page.controls.retain(|control| before(control.stamp_ns));
                page.targets.retain(|target| before(target.stamp_ns));
                page.healths.retain(|health| before(health.stamp_ns));
                return page;
            }
            match sample {
                Sample::Control(control) => page.controls.push(*control),
                Sample::Target(target) => page.targets.push(target.clone()),
                Sample::Health(health) => page.healths.push(health.clone()),
            }
        }
        page
    }
}
