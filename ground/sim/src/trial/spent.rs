//! What a pilot's modules cost: processor time of its own thread, so that what else the machine does hardly counts.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// Of one frame, s, by the modules of the paper's comparison. A network that perceives and plans at once is perception.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spent {
    /// From the image to what is in it.
    pub perception_s: f64,
    /// Taking it into a map.
    pub mapping_s: f64,
    /// From there to a trajectory.
    pub planning_s: f64,
    /// The last step of the controller.
    pub control_s: f64,
}

impl Spent {
    /// All of it, s.
    #[must_use]
    pub fn total_s(&self) -> f64 {
        self.perception_s + self.mapping_s + self.planning_s + self.control_s
    }
}

/// Measures one module after the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopwatch(Duration);

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self(now())
    }

    /// Since the start or the last call, s.
    pub(crate) fn lap(&mut self) -> f64 {
        let now = now();
        let passed = now.saturating_sub(self.0);
        self.0 = now;
        passed.as_secs_f64()
    }
}

fn now() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_counted_and_sleep_is_not() {
        let mut watch = Stopwatch::start();
        std::thread::sleep(Duration::from_millis(50));
        let slept_s = watch.lap();
        let sum = std::hint::black_box((0..3_000_000u64).fold(0, |sum, i| sum ^ std::hint::black_box(i)));
        let worked_s = watch.lap();
        assert!(slept_s < 0.02 && worked_s > 0.0, "{slept_s} s asleep, {worked_s} s at work ({sum})");
    }
}
