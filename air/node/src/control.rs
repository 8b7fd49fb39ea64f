//! The controller's thread: a fixed rate on the monotonic clock, whatever else happens. It sends a setpoint at every
//! step while it has authority.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use goshawk_autopilot::AutopilotLink;
use goshawk_core::{Controller, ControllerInput, Odometry, Plan, Time};

use crate::clock;
use crate::config::OdometrySource;
use crate::convert;
use crate::sensors;
use crate::shared::{PendingCommand, Report, Shared, lock};

/// What the thread owns.
pub struct Control {
    /// The core's controller.
    pub controller: Controller,
    /// The autopilot.
    pub link: Arc<AutopilotLink>,
    /// Where odometry comes from.
    pub source: OdometrySource,
    /// Steps a second.
    pub rate_hz: f64,
}

impl Control {
    /// Steps until the process stops.
    pub fn run(mut self, shared: &Shared) {
        let period = 1.0 / self.rate_hz;
        let mut due = clock::now();
        let mut odometry: Option<Odometry> = None;
        let mut seq = 0;
        while !shared.stopping() {
            clock::sleep_until(due);
            let now = clock::now();
            let late_s = now.since(due).max(0.0);
            // After a stall, go on from now: a burst of late steps helps nobody.
            due = if late_s > 5.0 * period { now.plus(period) } else { due.plus(period) };
            self.take_odometry(shared, &mut odometry);
            let plan = shared.plan.latest();
            self.step(shared, seq, now, odometry.as_ref(), plan.as_deref(), late_s);
            seq += 1;
        }
    }

    fn take_odometry(&self, shared: &Shared, odometry: &mut Option<Odometry>) {
        let newest = match self.source {
            OdometrySource::Autopilot => self.link.odometry(),
            OdometrySource::Zenoh => shared.odometry.latest().map(|o| *o),
        };
        let Some(newest) = newest.filter(|o| odometry.is_none_or(|held| o.stamp > held.stamp)) else { return };
        match sensors::plausible(newest) {
            Ok(good) => {
                lock(&shared.history).push_odometry(&good);
                *odometry = Some(good);
                shared.report(Report::Odometry(good));
            }
            Err(_) => shared.refused_odometry.count(),
        }
    }

    fn step(
        &mut self,
        shared: &Shared,
        seq: u64,
        now: Time,
        odometry: Option<&Odometry>,
        plan: Option<&Plan>,
        late_s: f64,
    ) {
        let status = self.link.status(now);
        let pending: Option<PendingCommand> = lock(&shared.command).take();
        let output = self.controller.step(
            now,
            &ControllerInput {
                odometry,
                plan,
                autopilot: status.core(),
                command: pending.as_ref().map(|pending| pending.command),
                ready: shared.ready.load(Ordering::Relaxed),
            },
        );
        if let Some(setpoint) = &output.setpoint {
            // A setpoint that could not be sent is counted by the link; the next one follows in a period.
            let _ = self.link.send_setpoint(setpoint);
        }
        if let Some(request) = output.request {
            self.link.request(request);
        }
        shared.mode.store(convert::mode(output.mode).into(), Ordering::Relaxed);
        if let (Some(pending), Some(reply)) = (pending, output.reply) {
            let _ = pending.answer.try_send(reply); // an asker that gave up is no concern of ours
        }
        lock(&shared.history).push_acceleration(now, output.acc_des_world);
        if output.planning != shared.demand.latest().as_deref().copied()
            && let Some(demand) = output.planning
        {
            shared.demand.put(Arc::new(demand));
        }
        if let Some(t) = output.transition {
            shared.report(Report::Event(
                goshawk_proto::v1::Severity::Info,
                "mode",
                format!("{:?} → {:?}: {}", t.from, t.to, t.cause),
            ));
        }
        let step_s = clock::now().since(now);
        let report =
            Report::Control { seq, stamp: now, output: Box::new(output), odometry: odometry.copied(), step_s, late_s };
        shared.report(report);
    }
}
