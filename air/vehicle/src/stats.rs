//! Rates and latency quantiles over the last few seconds, for `health`. Fixed memory.

use goshawk_core::Time;

/// Samples that quantiles are made of.
const WINDOW: usize = 1024;
/// Below 1 µs, 2 µs, 4 µs … 0.52 s, and longer.
const BUCKETS: usize = 21;

/// The newest [`WINDOW`] samples of a duration, and a histogram of all.
pub struct Window {
    samples_s: Box<[f64; WINDOW]>,
    next: usize,
    count: u64,
    histogram: [u64; BUCKETS],
    scratch: Vec<f64>,
}

/// Quantiles of a window, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quantiles {
    /// Median.
    pub p50_s: f64,
    /// 99th percentile.
    pub p99_s: f64,
    /// Largest in the window.
    pub max_s: f64,
    /// Samples since the start.
    pub count: u64,
}

impl Default for Window {
    fn default() -> Self {
        Window {
            samples_s: Box::new([0.0; WINDOW]),
            next: 0,
            count: 0,
            histogram: [0; BUCKETS],
            scratch: Vec::with_capacity(WINDOW),
        }
    }
}

impl Window {
    /// Adds one sample.
    pub fn push(&mut self, seconds: f64) {
        self.samples_s[self.next] = seconds;
        self.next = (self.next + 1) % WINDOW;
        self.count += 1;
        let mut bucket = 0;
        while bucket < BUCKETS - 1 && seconds >= 1e-6 * f64::from(1 << bucket) {
            bucket += 1;
        }
        self.histogram[bucket] += 1;
    }

    /// How many samples since the start took less than 1 µs, then 2, 4, 8 … µs; the last: longer.
    #[must_use]
    pub fn histogram(&self) -> &[u64] {
        &self.histogram
    }

    /// Quantiles of what the window holds; zeros while it is empty.
    pub fn quantiles(&mut self) -> Quantiles {
        let held = (self.count as usize).min(WINDOW);
        if held == 0 {
            return Quantiles::default();
        }
        self.scratch.clear();
        self.scratch.extend_from_slice(&self.samples_s[..held]);
        self.scratch.sort_by(f64::total_cmp);
        let at = |q: f64| self.scratch[((held - 1) as f64 * q).round() as usize];
        Quantiles { p50_s: at(0.5), p99_s: at(0.99), max_s: at(1.0), count: self.count }
    }
}

/// Events counted between two readings.
#[derive(Default)]
pub struct RateMeter {
    count: u64,
    since: Option<Time>,
}

impl RateMeter {
    /// Counts one event.
    pub fn tick(&mut self) {
        self.count += 1;
    }

    /// Events a second since the last reading, which this one becomes.
    pub fn read(&mut self, now: Time) -> f64 {
        let rate = self.since.map_or(0.0, |since| self.count as f64 / now.since(since).max(1e-3));
        self.since = Some(now);
        self.count = 0;
        rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_newest_samples() {
        let mut window = Window::default();
        assert_eq!(window.quantiles(), Quantiles::default());
        for k in 0..=3000 {
            window.push(f64::from(k));
        }
        let q = window.quantiles();
        assert_eq!(q.max_s, 3000.0);
        assert!((q.p50_s - (3000.0 - 512.0)).abs() <= 1.0);
        assert_eq!(q.count, 3001);
    }

    #[test]
    fn the_histogram_holds_every_sample_in_powers_of_two_of_a_microsecond() {
        let mut window = Window::default();
        for seconds in [0.0, 0.9e-6, 1e-6, 3e-6, 0.1, 9.0] {
            window.push(seconds);
        }
        let filled: Vec<(usize, u64)> =
            window.histogram().iter().copied().enumerate().filter(|(_, count)| *count > 0).collect();
        assert_eq!(filled, [(0, 2), (1, 1), (2, 1), (17, 1), (20, 1)]);
    }

    #[test]
    fn a_rate_is_events_over_the_time_between_readings() {
        let mut meter = RateMeter::default();
        assert_eq!(meter.read(Time::from_secs(1.0)), 0.0);
        for _ in 0..30 {
            meter.tick();
        }
        assert!((meter.read(Time::from_secs(1.5)) - 60.0).abs() < 1e-9);
    }
}
