//! The rule that makes a flight a function of its log: a start begins with a controller that knows nothing of what was
//! before. (The planner keeps the same rule by [`crate::FrameInput::flight`].)

use crate::mission::config::ControllerConfig;
use crate::mission::controller::Controller;
use crate::mission::interface::{Command, ControllerOutput, StepInput};
use crate::mission::modes::Mode;
use crate::planning::plan::Plan;
use crate::values::error::ConfigError;
use crate::values::types::Time;

/// The controller, fresh with each start from `Ready`.
#[derive(Clone, Debug)]
pub struct FlightController {
    fresh: Controller,
    current: Controller,
    /// Asked first whether it would start.
    next: Controller,
}

impl FlightController {
    /// In `Idle`.
    ///
    /// # Errors
    /// A value that cannot be flown with.
    pub fn new(config: ControllerConfig) -> Result<Self, ConfigError> {
        let fresh = Controller::new(config)?;
        Ok(FlightController { current: fresh.clone(), next: fresh.clone(), fresh })
    }

    /// One tick at `now`, as [`Controller::step`]. Allocates nothing.
    pub fn step(&mut self, now: Time, input: &StepInput, plan: Option<&Plan>) -> ControllerOutput {
        if matches!(input.command, Some(Command::Start(_))) && self.current.mode() == Mode::Ready {
            let uncommanded = StepInput { command: None, ..*input };
            self.next.clone_from(&self.fresh);
            self.next.step(now, &uncommanded, plan); // to Ready, if it is
            let output = self.next.step(now, input, plan);
            if output.reply == Some(Ok(())) {
                std::mem::swap(&mut self.current, &mut self.next);
                return output;
            }
            // A refused start changes nothing: what was still to be done is done, and a change of mode is told.
            return ControllerOutput { reply: output.reply, ..self.current.step(now, &uncommanded, plan) };
        }
        self.current.step(now, input, plan)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission::interface::{AutopilotStatus, Profile, Refusal};
    use crate::mission::modes::Cause;
    use crate::shipped::controller as config;
    use crate::values::types::{Odometry, Rot, Task, Vec3};

    #[test]
    fn a_start_that_is_refused_in_ready_leaves_the_controller_as_it_is_and_tells_its_change_of_mode() {
        let mut controller = FlightController::new(config()).unwrap();
        let zero = Vec3::zeros();
        let odometry = Odometry {
            stamp: Time(1_000_000_000),
            pos_world: zero,
            vel_world: zero,
            world_from_body: Rot::identity(),
            ang_vel_body: zero,
            reset_counter: 0,
        };
        let autopilot = AutopilotStatus { connected: true, landed: Some(true), ..AutopilotStatus::default() };
        let standing =
            StepInput { odometry: Some(odometry), imu: None, plan_seq: None, autopilot, command: None, ready: true };
        assert_eq!(controller.step(Time(1_000_000_000), &standing, None).mode, Mode::Ready);
        let lost = AutopilotStatus { position: Some(false), ..autopilot };
        let command = Some(Command::Start(Profile { task: Task::Track, speed: 3.0, height: 1.5, goal: None }));
        let refused = StepInput { autopilot: lost, command, ..standing };
        let output = controller.step(Time(1_005_000_000), &refused, None);
        assert_eq!(output.reply, Some(Err(Refusal::NoPosition)));
        let told = output.transition.map(|t| (t.from, t.to, t.cause));
        assert_eq!(told, Some((Mode::Ready, Mode::Idle, Cause::CheckFailed)));
    }
}
