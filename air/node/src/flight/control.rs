//! The controller's thread: a fixed rate on the monotonic clock, whatever else happens. It sends a setpoint at every
//! step while it has authority. After its start it allocates nothing and waits for no other thread: what another one is
//! just writing, it takes a step later.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use goshawk_autopilot::{AutopilotLink, Glance};
use goshawk_core::{
    Command, ControllerOutput, FlightController, Odometry, Plan, PlanningDemand, Request, StepInput, Time,
};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::OdometrySource;
use goshawk_vehicle::convert;
use goshawk_vehicle::sensors;
use goshawk_vehicle::slot::try_lock;

use crate::flight::realtime;
use crate::flight::shared::{PendingCommand, Report, Shared, Started};

/// What the thread begins with.
pub struct Control {
    /// The core's controller.
    pub controller: FlightController,
    /// The autopilot.
    pub link: Arc<AutopilotLink>,
    /// Where odometry comes from.
    pub source: OdometrySource,
    /// Steps a second.
    pub rate_hz: f64,
    /// How it is scheduled; none: as the process is.
    pub schedule: Option<realtime::Schedule>,
}

/// The newest of everything that has come.
#[derive(Default)]
struct Held {
    glance: Option<Glance>,
    from_zenoh: Option<Odometry>,
    odometry: Option<Odometry>,
    /// Not in the shared history yet.
    unpushed: Option<Odometry>,
    plan: Option<Plan>,
    demand: Option<PlanningDemand>,
    plan_generation: u64,
    odometry_generation: u64,
    /// Counts accepted starts.
    flight: u64,
}

impl Control {
    /// Steps until the process stops.
    pub fn run(mut self, shared: &Shared) {
        if let Some(schedule) = self.schedule {
            schedule.apply("control");
        }
        let period = 1.0 / self.rate_hz;
        let mut due = clock::now();
        let mut held = Held::default();
        let mut seq = 0;
        while !shared.stopping() {
            clock::sleep_until(due);
            let now = clock::now();
            let late_s = now.since(due).max(0.0);
            // After a stall, go on from now: a burst of late steps helps nobody.
            due = if late_s > 5.0 * period { now.plus(period) } else { due.plus(period) };
            held.glance = self.link.glance(now).or(held.glance);
            self.take_odometry(shared, &mut held);
            shared.plan.try_update(&mut held.plan_generation, &mut held.plan);
            self.step(shared, seq, now, &mut held, late_s);
            seq += 1;
        }
    }

    fn take_odometry(&self, shared: &Shared, held: &mut Held) {
        let newest = match self.source {
            OdometrySource::Autopilot => held.glance.and_then(|glance| glance.odometry),
            OdometrySource::Zenoh => {
                shared.odometry.try_update(&mut held.odometry_generation, &mut held.from_zenoh);
                held.from_zenoh
            }
        };
        if let Some(newest) = newest.filter(|o| held.odometry.is_none_or(|last| o.stamp > last.stamp)) {
            match sensors::plausible(newest) {
                Ok(good) => {
                    let good = good.with_unsigned_zeros();
                    (held.odometry, held.unpushed) = (Some(good), Some(good));
                    shared.report(Report::Odometry(good));
                }
                Err(_) => shared.refused_odometry.count(),
            }
        }
        if held.unpushed.is_some()
            && let Some(mut history) = try_lock(&shared.history)
            && let Some(sample) = held.unpushed.take()
        {
            history.push_odometry(&sample);
        }
    }

    fn step(&mut self, shared: &Shared, seq: u64, now: Time, held: &mut Held, late_s: f64) {
        let pending: Option<PendingCommand> = try_lock(&shared.command).and_then(|mut slot| slot.take());
        let input = StepInput {
            odometry: held.odometry,
            imu: held.glance.and_then(|glance| glance.imu).map(|imu| imu.with_unsigned_zeros()),
            plan_seq: held.plan.as_ref().map(|plan| plan.seq),
            autopilot: held.glance.map_or_else(Default::default, |glance| self.source.concerning(&glance.status)),
            command: pending.as_ref().map(|pending| pending.command),
            ready: shared.ready.holds(now),
        };
        let output = self.controller.step(now, &input, held.plan.as_ref());
        self.act(held, &output);
        if output.request == Some(Request::Arm) {
            shared.asked_to_arm.store(now.0, Ordering::Relaxed);
        }
        shared.mode.store(convert::mode(output.mode).into(), Ordering::Relaxed);
        if let Some(mut history) = try_lock(&shared.history) {
            history.push_acceleration(now, output.acc_kept_world);
        }
        let start = matches!(input.command, Some(Command::Start(_))) && output.reply == Some(Ok(()));
        held.flight += u64::from(start);
        let flight = held.flight;
        let started = pending.as_ref().filter(|_| start);
        let started = started.map(|pending| Started { flight, profile: Arc::clone(&pending.profile) });
        let step_s = clock::now().since(now);
        shared.report(Report::Control { seq, stamp: now, input, output, started, step_s, late_s });
        if start {
            // After the report: in the log, all that the planner answers in this flight comes after its first step.
            shared.flight.store(flight, Ordering::Release);
        }
        if let (Some(pending), Some(reply)) = (pending, output.reply) {
            let _ = pending.answer.try_send(reply); // an asker that gave up is no concern of ours
        }
        if let Some(demand) = output.planning.filter(|demand| held.demand != Some(*demand))
            && shared.demand.try_put(demand)
        {
            held.demand = Some(demand);
        }
    }

    fn act(&self, held: &Held, output: &ControllerOutput) {
        if let Some(setpoint) = &output.setpoint
            && let Some(peer) = held.glance.and_then(|glance| glance.peer)
        {
            // A setpoint that could not be sent is counted by the link; the next one follows in a period.
            let _ = self.link.send_setpoint_to(peer, setpoint);
        }
        if let Some(request) = output.request {
            self.link.request(request);
        }
    }
}
