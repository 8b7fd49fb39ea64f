//! The controller again.

use std::collections::BTreeMap;

use color_eyre::eyre::Result;
use goshawk_core::{Command, FlightController, Imu, Odometry, Plan, StepInput, Time};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, Entry};
use goshawk_vehicle::convert;
use goshawk_vehicle::inputs::{imu_from, odometry_from, step_input};

use super::compare::{Difference, keep_first};
use super::plans::key_channel;
use super::{Outcome, Recording};

/// The controller on a log's records.
pub(super) struct Again<'a> {
    plans: &'a BTreeMap<u64, Plan>,
    controller: FlightController,
    odometry: Option<Odometry>,
    imu: Option<Imu>,
    /// Sequence number of the last step.
    last: Option<u64>,
    answer: v1::Control,
}

impl<'a> Again<'a> {
    /// In the state that a log begins with. `plans`: by their numbers.
    pub(super) fn new(recording: &Recording, plans: &'a BTreeMap<u64, Plan>) -> Result<Self> {
        let controller = FlightController::new(recording.vehicle.controller_config())?;
        Ok(Again { plans, controller, odometry: None, imu: None, last: None, answer: v1::Control::default() })
    }

    /// Takes a record in: the answer, if it is the input of a step. What lacks goes to `missing`.
    pub(super) fn take(&mut self, entry: &Entry, missing: &mut Vec<String>) -> Option<&v1::Control> {
        if let Some(message) = entry.decode::<v1::Odometry>(Channel::ODOMETRY) {
            self.odometry = odometry_from(&message);
        } else if let Some(message) = entry.decode::<v1::Imu>(Channel::IMU) {
            self.imu = imu_from(&message);
        } else if let Some(message) = entry.decode::<v1::ControllerInput>(Channel::CONTROLLER_INPUT) {
            self.step(&message, missing);
            return Some(&self.answer);
        }
        None
    }

    fn step(&mut self, message: &v1::ControllerInput, missing: &mut Vec<String>) {
        let (input, now) = (step_input(message, self.odometry, self.imu), Time(message.stamp_ns));
        if let Some(last) = self.last.filter(|last| message.seq != last + 1) {
            missing.push(format!("controller steps {} to {}", last + 1, message.seq.saturating_sub(1)));
        }
        if message.odometry_ns != input.odometry.map(|o| o.stamp.0) {
            missing.push(format!("the odometry of controller step {}", message.seq));
        }
        if message.imu_ns != input.imu.map(|imu| imu.stamp.0) {
            missing.push(format!("the inertial sample of controller step {}", message.seq));
        }
        let plan = input.plan_seq.and_then(|seq| self.plans.get(&seq));
        if self.last.is_none() && matches!(input.command, Some(Command::Start(_))) {
            // On board the log begins with the start, which was accepted in Ready.
            self.controller.step(now, &StepInput { command: None, ..input }, plan);
        }
        let output = self.controller.step(now, &input, plan);
        self.last = Some(message.seq);
        self.answer = convert::control(message.seq, now, &output, self.odometry.as_ref());
    }
}

/// Makes each controller step again from what it was given, with the plans made again, and compares.
pub(super) fn again(recording: &Recording, plans: &BTreeMap<u64, Plan>, outcome: &mut Outcome) -> Result<()> {
    let control = key_channel(Key::Control)?;
    let mut again = Again::new(recording, plans)?;
    let mut unanswered = None;
    for entry in recording.log.entries() {
        if again.take(&entry, &mut outcome.missing).is_some() {
            // The last one of a log that was cut off may be without.
            outcome.missing.extend(unanswered.take().map(lacks));
            unanswered = again.last;
            continue;
        }
        let Some(logged) = entry.decode::<v1::Control>(control) else { continue };
        if again.last != Some(logged.seq) {
            outcome.missing.push(format!("the input of controller step {}", logged.seq));
            continue;
        }
        if logged.disturbance_limit_mps2 == 0.0 {
            again.answer.disturbance_limit_mps2 = 0.0; // a log from before it was told
        }
        unanswered = None;
        if let Some([field, said, replayed]) = outcome.controls.compare(&logged, &again.answer) {
            let (stamp_ns, at_s) = (logged.stamp_ns, recording.since_begin(logged.stamp_ns));
            let what = format!("control {}", logged.seq);
            let found = Difference { stamp_ns, at_s, what, field, logged: said, replayed };
            keep_first(&mut outcome.first_difference, found);
        }
    }
    outcome.missing.extend(unanswered.filter(|_| recording.log.is_closed()).map(lacks));
    Ok(())
}

fn lacks(seq: u64) -> String {
    format!("the answer of controller step {seq}")
}
