//! What the onboard threads share: latest-value slots and one bounded queue. The controller waits for no other thread.

use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use goshawk_core::{
    Command, ControllerOutput, FrameRecord, History, Odometry, Plan, PlanningDemand, Refusal, StepInput, Time,
};
use goshawk_policy::AnswerFault;
use goshawk_proto::v1;
use goshawk_vehicle::sensors::Frame;
use goshawk_vehicle::slot::{Latest, Slot};

/// Reports that may wait for the telemetry thread. Chosen by eye.
pub const REPORT_QUEUE: usize = 2048;
/// That the vehicle is ready holds for so long, s: ten judgements, so that a thread that judges no more holds nothing.
const READY_FOR_S: f64 = 1.0;

/// All readiness checks held, as long as somebody still looks at them.
#[derive(Default)]
pub struct Ready {
    judged: AtomicU64,
    problem: Mutex<Option<String>>,
}

impl Ready {
    /// They were judged `now`: what is wrong, if anything.
    pub fn judge(&self, problem: Option<String>, now: Time) {
        self.judged.store(if problem.is_none() { now.0 } else { 0 }, Ordering::Relaxed);
        *lock(&self.problem) = problem;
    }

    /// They held a moment ago.
    #[must_use]
    pub fn holds(&self, now: Time) -> bool {
        let judged = self.judged.load(Ordering::Relaxed);
        judged != 0 && now.since(Time(judged)) <= READY_FOR_S
    }

    /// What was wrong when they were judged last. The controller does not ask: it waits for nobody.
    #[must_use]
    pub fn problem(&self) -> Option<String> {
        lock(&self.problem).clone()
    }
}

/// Counts what was refused.
#[derive(Clone, Default)]
pub struct Refused(Arc<AtomicU64>);

impl Refused {
    /// One more.
    pub fn count(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    /// How many since the start.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// A command on its way to the controller, with where its answer goes.
pub struct PendingCommand {
    /// Tells it from one that came in its place.
    pub number: u64,
    /// What to do.
    pub command: Command,
    /// The start profile's name; empty for a stop.
    pub profile: Arc<str>,
    /// Takes the controller's answer; never blocks it.
    pub answer: SyncSender<Result<(), Refusal>>,
}

/// A flight that begins.
pub struct Started {
    /// Its number: counts accepted starts.
    pub flight: u64,
    /// Its profile's name.
    pub profile: Arc<str>,
}

/// A plan with all that it was made from.
pub struct Planned {
    /// The answer.
    pub plan: Plan,
    /// What it was made from.
    pub record: FrameRecord,
    /// When the plan was handed to the controller.
    pub ready: Time,
    /// Time in the network, s.
    pub inference_s: f64,
    /// What is wrong with the network: then the plan is recorded, and not flown.
    pub fault: Option<AnswerFault>,
}

/// A frame without a plan.
pub struct PlanFailed {
    /// Why.
    pub why: String,
    /// What the planner had seen by then, and remembers; the network's answer is all zeros, for it gave none.
    pub seen: Option<FrameRecord>,
}

impl From<String> for Box<PlanFailed> {
    fn from(why: String) -> Self {
        Box::new(PlanFailed { why, seen: None })
    }
}

/// One fact for telemetry, log and health.
#[allow(clippy::large_enum_variant, reason = "the controller's reports lie in the queue itself: boxes are allocated")]
pub enum Report {
    /// An image arrived.
    Frame(Arc<Frame>),
    /// The planner answered one.
    Plan(Box<Planned>),
    /// The planner could not answer a frame.
    PlanFailed(Box<PlanFailed>),
    /// What the planner remembers.
    Map(v1::ObstacleMap),
    /// Odometry was taken.
    Odometry(Odometry),
    /// A controller step.
    Control {
        /// Counts steps.
        seq: u64,
        /// When.
        stamp: Time,
        /// What it was given.
        input: StepInput,
        /// What it decided.
        output: ControllerOutput,
        /// A flight begins with this step.
        started: Option<Started>,
        /// Its duration, s.
        step_s: f64,
        /// How late it began, s.
        late_s: f64,
    },
    /// A command and its reply.
    Command(v1::CommandRecord),
    /// Something to read.
    Event(v1::Severity, &'static str, String),
}

/// Everything that threads share.
pub struct Shared {
    /// Newest image.
    pub frame: Slot<Frame>,
    /// Newest plan.
    pub plan: Latest<Plan>,
    /// Newest odometry from Zenoh, where the vehicle takes it from there.
    pub odometry: Latest<Odometry>,
    /// The same, for the autopilot, where it is sent on.
    pub vision: Slot<Odometry>,
    /// What the planner plans for.
    pub demand: Latest<PlanningDemand>,
    /// Counts accepted starts: with each the planner forgets what was before.
    pub flight: AtomicU64,
    /// The last second of motion.
    pub history: Mutex<History>,
    /// A command that the controller has not taken yet.
    pub command: Mutex<Option<PendingCommand>>,
    /// Counts commands.
    pub commands: AtomicU64,
    /// Counts stops: a start that was asked for before the last one is refused.
    pub stops: AtomicU64,
    /// Whether it may start.
    pub ready: Ready,
    /// The pilot's switch stands at stop, or it is not known where: nobody else starts.
    pub barred: AtomicBool,
    /// The mission's mode, as [`v1::Mode`].
    pub mode: AtomicI32,
    /// When the autopilot was last asked to start the motors, as [`Time`]; 0: never.
    pub asked_to_arm: AtomicU64,
    /// Set once: wind up.
    pub stop: AtomicBool,
    /// Samples refused at the edge.
    pub refused_frames: Refused,
    /// Samples refused at the edge.
    pub refused_odometry: Refused,
    /// Reports dropped because the queue was full.
    pub dropped_reports: AtomicU64,
    /// Frames that were overwritten before the planner took them.
    pub skipped_frames: AtomicU64,
    reports: SyncSender<Report>,
}

impl Shared {
    /// Empty slots; reports go to `reports`.
    #[must_use]
    pub fn new(reports: SyncSender<Report>) -> Self {
        Shared {
            frame: Slot::default(),
            plan: Latest::default(),
            odometry: Latest::default(),
            vision: Slot::default(),
            demand: Latest::default(),
            flight: AtomicU64::new(0),
            history: Mutex::new(History::new()),
            command: Mutex::new(None),
            commands: AtomicU64::new(0),
            stops: AtomicU64::new(0),
            ready: Ready::default(),
            barred: AtomicBool::new(false),
            mode: AtomicI32::new(v1::Mode::Idle.into()),
            asked_to_arm: AtomicU64::new(0),
            stop: AtomicBool::new(false),
            refused_frames: Refused::default(),
            refused_odometry: Refused::default(),
            dropped_reports: AtomicU64::new(0),
            skipped_frames: AtomicU64::new(0),
            reports,
        }
    }

    /// Hands a report on, or drops and counts it. Never blocks.
    pub fn report(&self, report: Report) {
        if let Err(TrySendError::Full(_)) = self.reports.try_send(report) {
            self.dropped_reports.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The mission's mode.
    #[must_use]
    pub fn mode(&self) -> v1::Mode {
        v1::Mode::try_from(self.mode.load(Ordering::Relaxed)).unwrap_or_default()
    }

    /// A flight is under way.
    #[must_use]
    pub fn flies(&self) -> bool {
        use v1::Mode::{Hold, Navigate, Search, Stopping, Takeoff, Track};
        matches!(self.mode(), Takeoff | Track | Navigate | Search | Hold | Stopping)
    }

    /// A flight is under way, or somebody else may be flying its end: a fault in the air lasts until the motors are off.
    #[must_use]
    pub fn may_be_in_the_air(&self) -> bool {
        self.flies() || self.mode() == v1::Mode::Fault
    }

    /// Whether to wind up.
    #[must_use]
    pub fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Locks; a panic elsewhere does not make the value unusable here.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readiness_that_nobody_judges_any_more_does_not_hold() {
        let ready = Ready::default();
        assert!(!ready.holds(Time::from_secs(0.5)));
        ready.judge(None, Time::from_secs(5.0));
        assert!(ready.holds(Time::from_secs(5.9)));
        assert!(!ready.holds(Time::from_secs(6.1)));
        ready.judge(Some("camera: none".to_owned()), Time::from_secs(6.2));
        assert!(!ready.holds(Time::from_secs(6.2)));
    }
}
