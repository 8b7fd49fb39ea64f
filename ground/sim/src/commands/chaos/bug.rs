//! Bugs put around the controller on purpose, to show that the properties find them. None of them is in flight code.

use goshawk_core::{
    AttitudeThrust, Cause, Command, ControllerOutput, Fallback, FlightController, Mode, Plan, Refusal, Rot, StepInput,
    Time, Vec3,
};

/// What is wrong with the controller as the chaos flight sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Bug {
    /// A Stop in flight is answered and not obeyed.
    DeafToStop,
    /// For half a second after the pilot took the mode, setpoints go on.
    SetpointAfterAuthority,
    /// Without odometry it falls silent.
    SilentWhenBlind,
    /// While it brakes for want of a plan it tilts to 80 degrees.
    TiltBeyondLimit,
    /// Each 500th step is not logged.
    UnloggedStep,
    /// The battery's end leads to a fault instead of a landing.
    WrongTransition,
    /// A Start is answered as refused, and flown.
    RefusedStart,
}

impl Bug {
    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> String {
        clap::ValueEnum::to_possible_value(&self).map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// For how long setpoints go on, s.
const GOES_ON_S: f64 = 0.5;

/// A controller with a bug around it, or without.
pub(super) struct Bugged<C> {
    inner: C,
    bug: Option<Bug>,
    last: Option<AttitudeThrust>,
    taken: Option<Time>,
    mode: Mode,
}

impl<C> Bugged<C> {
    pub(super) fn new(inner: C, bug: Option<Bug>) -> Self {
        Self { inner, bug, last: None, taken: None, mode: Mode::Idle }
    }
}

impl Bugged<FlightController> {
    pub(super) fn step(&mut self, now: Time, input: &StepInput, plan: Option<&Plan>) -> ControllerOutput {
        let stopped = input.command == Some(Command::Stop) && self.mode.has_authority();
        let deaf = stopped && self.bug == Some(Bug::DeafToStop);
        let heard = StepInput { command: input.command.filter(|_| !deaf), ..*input };
        let mut output = self.inner.step(now, &heard, plan);
        if deaf {
            output.reply = Some(Ok(()));
        }
        let starts = matches!(input.command, Some(Command::Start(_))) && output.reply == Some(Ok(()));
        if starts && self.bug == Some(Bug::RefusedStart) {
            output.reply = Some(Err(Refusal::ChecksFailed));
        }
        self.spoil(now, &mut output);
        self.mode = output.mode;
        self.last = output.setpoint.or(self.last);
        output
    }

    fn spoil(&mut self, now: Time, output: &mut ControllerOutput) {
        match self.bug {
            Some(Bug::SetpointAfterAuthority) => {
                if output.transition.is_some_and(|t| t.cause == Cause::ModeTakenAway) {
                    self.taken = Some(now);
                }
                if self.taken.is_some_and(|taken| now.since(taken) < GOES_ON_S) {
                    output.setpoint = output.setpoint.or(self.last);
                }
            }
            Some(Bug::SilentWhenBlind) if output.fallback == Fallback::OdometryStaleDescend => output.setpoint = None,
            Some(Bug::TiltBeyondLimit) if output.fallback == Fallback::PlanExpiredBrake => {
                let tilted = Rot::from_axis_angle(&Vec3::x_axis(), 80f64.to_radians());
                output.setpoint =
                    output.setpoint.map(|setpoint| AttitudeThrust { world_from_body: tilted, ..setpoint });
            }
            Some(Bug::WrongTransition) => {
                if let Some(t) = output.transition.as_mut().filter(|t| t.cause == Cause::BatteryLow) {
                    (t.to, output.mode, output.setpoint) = (Mode::Fault, Mode::Fault, None);
                }
            }
            _ => {}
        }
    }
}
