//! Makes a schedule small while the same property still fails: fewer faults, shorter and simpler ones, a plain setting.

use color_eyre::eyre::Result;

use super::flight::Flown;
use super::judge::properties::Property;
use super::schedule::{Fault, Kind, Odometry, OnStop, Schedule, Setting, Task};

/// Flights that a shrinking may take.
const FLIGHTS: usize = 300;
/// After the violation nothing matters, but for what is read from the log in the end, s.
const AFTER_S: f64 = 0.5;

/// The shortest flight of a schedule, s.
const SHORTEST_S: f64 = 1.0;

/// The smallest that was found, and what came of it.
pub struct Shrunk {
    /// Smallest schedule.
    pub schedule: Schedule,
    /// Its flight.
    pub flown: Flown,
    /// Flights that it took.
    pub flights: usize,
}

struct Search<'a> {
    fly: &'a dyn Fn(&Schedule) -> Result<Flown>,
    property: Property,
    best: (Schedule, Flown),
    flights: usize,
}

/// Shrinks `schedule`, in whose flight `flown` a property failed.
pub fn shrink(
    schedule: &Schedule,
    flown: &Flown,
    property: Property,
    fly: &dyn Fn(&Schedule) -> Result<Flown>,
) -> Shrunk {
    let mut search = Search { fly, property, best: (schedule.clone(), flown.clone()), flights: 0 };
    loop {
        let before = search.best.0.clone();
        search.fewer();
        search.plainer();
        search.shorter();
        search.simpler();
        if search.best.0 == before || search.flights >= FLIGHTS {
            let (schedule, flown) = search.best;
            return Shrunk { schedule, flown, flights: search.flights };
        }
    }
}

impl Search<'_> {
    /// Takes `schedule` if the property fails in it too. One that no vehicle can fly, such as a goal beyond the fence, is
    /// none.
    fn attempt(&mut self, schedule: Schedule) -> bool {
        if schedule == self.best.0 || self.flights >= FLIGHTS {
            return false;
        }
        self.flights += 1;
        let Ok(flown) = (self.fly)(&schedule) else { return false };
        let fails = flown.violation.as_ref().is_some_and(|violation| violation.property == self.property);
        if fails {
            self.best = (schedule, flown);
        }
        fails
    }

    /// Delta debugging: drops ever smaller parts of the faults.
    fn fewer(&mut self) {
        let mut part = self.best.0.faults.len().div_ceil(2);
        while part > 0 {
            let mut from = 0;
            while from < self.best.0.faults.len() {
                let mut schedule = self.best.0.clone();
                schedule.faults.drain(from..(from + part).min(schedule.faults.len()));
                if !self.attempt(schedule) {
                    from += part;
                }
            }
            part /= 2;
        }
    }

    /// One plain value of the setting after the other.
    fn plainer(&mut self) {
        let changes: [fn(&mut Setting); 7] = [
            |s| s.wind_mps = 0.0,
            |s| s.fence_m = 200.0,
            |s| s.ceiling_m = 30.0,
            |s| s.task = Task::Navigate,
            |s| s.on_stop = OnStop::Land,
            |s| s.odometry = Odometry::Autopilot,
            |s| s.scene = 0,
        ];
        for change in changes {
            let mut schedule = self.best.0.clone();
            change(&mut schedule.setting);
            self.attempt(schedule);
        }
    }

    fn shorter(&mut self) {
        let ends_s = self.best.1.violation.as_ref().map_or(f64::INFINITY, |violation| violation.at_s + AFTER_S);
        let mut schedule = self.best.0.clone();
        schedule.setting.length_s = round(schedule.setting.length_s.min(ends_s), 10.0).max(SHORTEST_S);
        self.attempt(schedule);
        for index in 0..self.best.0.faults.len() {
            while self.change(index, |fault| Fault { for_s: round(fault.for_s / 2.0, 1000.0), ..fault }) {}
        }
    }

    fn simpler(&mut self) {
        for index in 0..self.best.0.faults.len() {
            let whole = |kind: Kind| kind.with_number(|x| round(x, 10.0));
            self.change(index, |fault| Fault { at_s: round(fault.at_s, 1.0), ..fault });
            self.change(index, |fault| Fault { at_s: round(fault.at_s, 10.0), ..fault });
            self.change(index, |fault| Fault { for_s: round(fault.for_s, 10.0), ..fault });
            self.change(index, |fault| Fault { what: whole(fault.what), ..fault });
        }
    }

    fn change(&mut self, index: usize, change: impl Fn(Fault) -> Fault) -> bool {
        let mut schedule = self.best.0.clone();
        schedule.faults[index] = change(schedule.faults[index]);
        self.attempt(schedule)
    }
}

/// To `parts` of one.
fn round(x: f64, parts: f64) -> f64 {
    (x * parts).round() / parts
}
