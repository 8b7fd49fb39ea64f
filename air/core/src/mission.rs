//! The mission's states, and the one function that moves between them.

use crate::types::Task;

/// What the vehicle is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Not ready.
    #[default]
    Idle,
    /// Start would be accepted.
    Ready,
    /// Streaming, arming, climbing.
    Takeoff,
    /// Chasing the target.
    Track,
    /// Flying to the goal.
    Navigate,
    /// The target is lost: hover, look for it.
    Search,
    /// Caught up, or the goal is reached.
    Hold,
    /// Braking, descending, touching down.
    Stopping,
    /// On the ground after a flight, motors stopped.
    Landed,
    /// Authority ended; the autopilot or its pilot flies.
    Fault,
}

impl Mode {
    /// All modes.
    pub const ALL: [Mode; 10] = [
        Mode::Idle,
        Mode::Ready,
        Mode::Takeoff,
        Mode::Track,
        Mode::Navigate,
        Mode::Search,
        Mode::Hold,
        Mode::Stopping,
        Mode::Landed,
        Mode::Fault,
    ];

    /// Setpoints are sent: from the take-off's stream to the landing's disarming.
    #[must_use]
    pub fn has_authority(self) -> bool {
        matches!(self, Mode::Takeoff | Mode::Track | Mode::Navigate | Mode::Search | Mode::Hold | Mode::Stopping)
    }
}

/// The rung of the fallback ladder, from the best down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Fallback {
    /// A fresh plan is flown, or the mode needs none.
    #[default]
    None,
    /// The plan expired: braking.
    PlanExpiredBrake,
    /// Stopped, holding position for want of a plan.
    HoldPosition,
    /// Odometry is stale: level, gently descending.
    OdometryStaleDescend,
    /// Authority is handed back to the autopilot.
    HandBack,
}

/// Why a transition was made; displays as a sentence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cause {
    /// All readiness checks hold.
    ChecksPassed,
    /// A readiness check failed.
    CheckFailed,
    /// The operator's Start.
    StartCommand,
    /// The operator's Stop.
    StopCommand,
    /// The take-off height is reached.
    HeightReached,
    /// The target is confirmed and a trajectory to it is chosen.
    TargetConfirmed,
    /// The target has not been seen for too long.
    TargetLost,
    /// Closer to the target than the hold distance.
    CaughtUp,
    /// The target went away again.
    TargetMovedOff,
    /// Within the goal's radius.
    GoalReached,
    /// No plan for too long.
    NoPlan,
    /// The search found nothing.
    SearchTimeout,
    /// The autopilot did not accept offboard.
    OffboardRefused,
    /// The autopilot did not arm.
    ArmRefused,
    /// The take-off height was not reached in time.
    TakeoffTimeout,
    /// Offboard ended without our asking: pilot or failsafe.
    ModeTakenAway,
    /// Disarmed without our asking.
    Disarmed,
    /// Odometry stayed stale.
    OdometryLost,
    /// Landed and disarmed.
    TouchedDown,
}

impl std::fmt::Display for Cause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Cause::ChecksPassed => "all readiness checks hold",
            Cause::CheckFailed => "a readiness check failed",
            Cause::StartCommand => "the operator's Start",
            Cause::StopCommand => "the operator's Stop",
            Cause::HeightReached => "the take-off height is reached",
            Cause::TargetConfirmed => "the target is confirmed",
            Cause::TargetLost => "the target has not been seen for too long",
            Cause::CaughtUp => "caught up with the target",
            Cause::TargetMovedOff => "the target moved off",
            Cause::GoalReached => "the goal is reached",
            Cause::NoPlan => "no plan arrived for too long",
            Cause::SearchTimeout => "the search found nothing",
            Cause::OffboardRefused => "the autopilot did not accept offboard",
            Cause::ArmRefused => "the autopilot did not arm",
            Cause::TakeoffTimeout => "the take-off height was not reached in time",
            Cause::ModeTakenAway => "offboard was taken away by the pilot or a failsafe",
            Cause::Disarmed => "disarmed without our asking",
            Cause::OdometryLost => "odometry stayed stale",
            Cause::TouchedDown => "landed and disarmed",
        })
    }
}

/// What decides a transition. Each is judged by the controller in every step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Facts {
    /// The flight's task; Track when there is no flight.
    pub task: Task,
    /// An acceptable Start was given in this step.
    pub start: bool,
    /// Stop was given in this step.
    pub stop: bool,
    /// Readiness, the core's own part included.
    pub ready: bool,
    /// The motors have been armed in this flight.
    pub was_armed: bool,
    /// They were armed in this flight and are not now.
    pub disarmed: bool,
    /// Offboard was on in this flight and is not now.
    pub mode_taken: bool,
    /// Odometry has been stale for longer than we may fly without.
    pub odometry_lost: bool,
    /// The autopilot did not follow a take-off request.
    pub refused: Option<Cause>,
    /// The climb takes too long.
    pub takeoff_timeout: bool,
    /// The climb is over.
    pub height_reached: bool,
    /// The target is confirmed and a fresh trajectory to it is at hand.
    pub target_chosen: bool,
    /// The target is lost, and the vehicle has braked.
    pub target_lost: bool,
    /// Within the hold distance and closing.
    pub caught_up: bool,
    /// Beyond the resume distance.
    pub moved_off: bool,
    /// Within the goal's radius.
    pub goal_reached: bool,
    /// No plan of any kind for too long.
    pub no_plan: bool,
    /// Searched for too long.
    pub search_timeout: bool,
    /// The fault is over: disarmed, and shown for long enough.
    pub fault_over: bool,
}

/// The transition table: from `mode`, where `facts` lead and why; none: stay. The first line that applies wins.
#[must_use]
pub fn transition(mode: Mode, facts: &Facts) -> Option<(Mode, Cause)> {
    if mode.has_authority() {
        if facts.disarmed {
            return Some(match mode {
                Mode::Stopping => (Mode::Landed, Cause::TouchedDown),
                _ => (Mode::Fault, Cause::Disarmed),
            });
        }
        if facts.mode_taken {
            return Some((Mode::Fault, Cause::ModeTakenAway));
        }
        if facts.odometry_lost {
            return Some((Mode::Fault, Cause::OdometryLost));
        }
        if facts.stop && mode != Mode::Stopping {
            let to = if facts.was_armed { Mode::Stopping } else { Mode::Idle };
            return Some((to, Cause::StopCommand));
        }
    }
    let rows: &[(bool, Mode, Cause)] = match mode {
        Mode::Idle => &[(facts.ready, Mode::Ready, Cause::ChecksPassed)],
        Mode::Ready => {
            &[(!facts.ready, Mode::Idle, Cause::CheckFailed), (facts.start, Mode::Takeoff, Cause::StartCommand)]
        }
        Mode::Takeoff => {
            let next = if facts.task == Task::Track { Mode::Search } else { Mode::Navigate };
            if let Some(cause) = facts.refused {
                return Some((Mode::Fault, cause));
            }
            &[
                (facts.height_reached, next, Cause::HeightReached),
                (facts.takeoff_timeout, Mode::Stopping, Cause::TakeoffTimeout),
            ]
        }
        Mode::Track => &[
            (facts.no_plan, Mode::Stopping, Cause::NoPlan),
            (facts.caught_up, Mode::Hold, Cause::CaughtUp),
            (facts.target_lost, Mode::Search, Cause::TargetLost),
        ],
        Mode::Navigate => {
            &[(facts.no_plan, Mode::Stopping, Cause::NoPlan), (facts.goal_reached, Mode::Hold, Cause::GoalReached)]
        }
        Mode::Search => &[
            (facts.no_plan, Mode::Stopping, Cause::NoPlan),
            (facts.target_chosen, Mode::Track, Cause::TargetConfirmed),
            (facts.search_timeout, Mode::Stopping, Cause::SearchTimeout),
        ],
        Mode::Hold if facts.task == Task::Track => &[
            (facts.no_plan, Mode::Stopping, Cause::NoPlan),
            (facts.moved_off && facts.target_chosen, Mode::Track, Cause::TargetMovedOff),
            (facts.target_lost, Mode::Search, Cause::TargetLost),
        ],
        Mode::Hold | Mode::Stopping => &[],
        Mode::Landed => &[(facts.ready, Mode::Ready, Cause::ChecksPassed)],
        Mode::Fault => &[(facts.fault_over, Mode::Idle, Cause::Disarmed)],
    };
    rows.iter().find(|row| row.0).map(|row| (row.1, row.2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const QUIET: Facts = Facts {
        task: Task::Track,
        start: false,
        stop: false,
        ready: true,
        was_armed: true,
        disarmed: false,
        mode_taken: false,
        odometry_lost: false,
        refused: None,
        takeoff_timeout: false,
        height_reached: false,
        target_chosen: false,
        target_lost: false,
        caught_up: false,
        moved_off: false,
        goal_reached: false,
        no_plan: false,
        search_timeout: false,
        fault_over: false,
    };

    #[test]
    fn stop_lands_from_every_airborne_mode_and_does_nothing_on_the_ground() {
        let stop = Facts { stop: true, ..QUIET };
        for mode in Mode::ALL {
            let to = transition(mode, &stop).map(|t| t.0);
            match mode {
                Mode::Stopping => assert_eq!(to, None),
                m if m.has_authority() => assert_eq!(to, Some(Mode::Stopping)),
                _ => assert_ne!(to, Some(Mode::Stopping)),
            }
        }
        assert_eq!(transition(Mode::Takeoff, &Facts { was_armed: false, ..stop }).unwrap().0, Mode::Idle);
    }

    #[test]
    fn the_pilot_wins_over_stop_and_over_every_other_fact() {
        let facts = Facts { mode_taken: true, stop: true, caught_up: true, odometry_lost: true, ..QUIET };
        for mode in Mode::ALL.into_iter().filter(|m| m.has_authority()) {
            assert_eq!(transition(mode, &facts), Some((Mode::Fault, Cause::ModeTakenAway)));
        }
    }

    #[test]
    fn takeoff_leads_to_the_search_or_to_the_goal() {
        let up = Facts { height_reached: true, ..QUIET };
        assert_eq!(transition(Mode::Takeoff, &up), Some((Mode::Search, Cause::HeightReached)));
        let navigate = Facts { task: Task::Navigate, ..up };
        assert_eq!(transition(Mode::Takeoff, &navigate), Some((Mode::Navigate, Cause::HeightReached)));
    }

    #[test]
    fn disarming_ends_a_landing_well_and_any_other_flight_in_a_fault() {
        let facts = Facts { disarmed: true, ..QUIET };
        assert_eq!(transition(Mode::Stopping, &facts), Some((Mode::Landed, Cause::TouchedDown)));
        assert_eq!(transition(Mode::Track, &facts), Some((Mode::Fault, Cause::Disarmed)));
    }

    #[test]
    fn a_reached_goal_is_held_until_stop() {
        let there = Facts { task: Task::Navigate, goal_reached: true, ..QUIET };
        assert_eq!(transition(Mode::Navigate, &there), Some((Mode::Hold, Cause::GoalReached)));
        let later = Facts { task: Task::Navigate, moved_off: true, target_chosen: true, target_lost: true, ..QUIET };
        assert_eq!(transition(Mode::Hold, &later), None);
    }

    fn facts() -> impl Strategy<Value = Facts> {
        (any::<u32>(), any::<bool>()).prop_map(|(bits, track)| {
            let bit = |k: u32| bits >> k & 1 == 1;
            Facts {
                task: if track { Task::Track } else { Task::Navigate },
                start: bit(0),
                stop: bit(1),
                ready: bit(2),
                was_armed: bit(3),
                disarmed: bit(4),
                mode_taken: bit(5),
                odometry_lost: bit(6),
                refused: bit(7).then_some(Cause::ArmRefused),
                takeoff_timeout: bit(8),
                height_reached: bit(9),
                target_chosen: bit(10),
                target_lost: bit(11),
                caught_up: bit(12),
                moved_off: bit(13),
                goal_reached: bit(14),
                no_plan: bit(15),
                search_timeout: bit(16),
                fault_over: bit(17),
            }
        })
    }

    proptest! {
        #[test]
        fn only_a_start_in_ready_ever_begins_a_flight(facts in facts(), index in 0..10usize) {
            let mode = Mode::ALL[index];
            if let Some((to, cause)) = transition(mode, &facts) {
                prop_assert_ne!(to, mode);
                if !mode.has_authority() && to.has_authority() {
                    prop_assert!(mode == Mode::Ready && facts.start && facts.ready && cause == Cause::StartCommand);
                }
                if to == Mode::Landed {
                    prop_assert!(facts.disarmed);
                }
            }
        }
    }
}
