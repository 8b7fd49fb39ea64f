//! The one table that moves the mission between its modes, every fault's line among them.

use crate::mission::modes::{Cause, Mode, StopAction};
use crate::values::types::Task;

/// What a target of the table may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Situation {
    /// The flight's task; Track when there is no flight.
    pub task: Task,
    /// The motors have been armed in this flight.
    pub was_armed: bool,
    /// A Stop has been given and is being hovered.
    pub held: bool,
    /// What Stop does.
    pub on_stop: StopAction,
}

/// Where a row of the table leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum To {
    /// This mode.
    Mode(Mode),
    /// The task's first mode.
    Begin,
    /// Down: to Stopping; before arming to Idle.
    Land,
    /// What Stop does.
    Stop,
    /// A hover; from where there is none, down.
    Hover,
}

/// One line of the table: on this event, from these modes, to there.
type Row = (Cause, &'static [Mode], To);

/// Every mode with authority but the landing.
const UNDER_WAY: &[Mode] = &[Mode::Takeoff, Mode::Track, Mode::Navigate, Mode::Search, Mode::Hold];
/// Every mode with authority.
const FLYING: &[Mode] = &[Mode::Takeoff, Mode::Track, Mode::Navigate, Mode::Search, Mode::Hold, Mode::Stopping];

/// The transition table, the most urgent event first. An event without a row for the mode changes nothing.
const TABLE: &[Row] = &[
    // authority ends
    (Cause::TouchedDown, &[Mode::Stopping], To::Mode(Mode::Landed)),
    (Cause::Disarmed, UNDER_WAY, To::Mode(Mode::Fault)),
    (Cause::ModeTakenAway, FLYING, To::Mode(Mode::Fault)),
    (Cause::OdometryLost, FLYING, To::Mode(Mode::Fault)),
    (Cause::OdometryFalse, FLYING, To::Mode(Mode::Fault)),
    (Cause::PositionLost, FLYING, To::Mode(Mode::Fault)),
    // the flight ends
    (Cause::StopCommand, UNDER_WAY, To::Stop),
    (Cause::AutopilotLost, UNDER_WAY, To::Land),
    (Cause::BatteryLow, UNDER_WAY, To::Land),
    (Cause::FenceReached, UNDER_WAY, To::Land),
    (Cause::CeilingReached, UNDER_WAY, To::Land),
    (Cause::TimeUp, UNDER_WAY, To::Land),
    (Cause::HoldCommand, UNDER_WAY, To::Hover),
    // take-off
    (Cause::OffboardRefused, &[Mode::Takeoff], To::Mode(Mode::Fault)),
    (Cause::ArmRefused, &[Mode::Takeoff], To::Mode(Mode::Fault)),
    (Cause::HeightReached, &[Mode::Takeoff], To::Begin),
    (Cause::TakeoffTimeout, &[Mode::Takeoff], To::Land),
    // the task
    (Cause::NoPlan, &[Mode::Track, Mode::Navigate, Mode::Search, Mode::Hold], To::Land),
    (Cause::CaughtUp, &[Mode::Track], To::Mode(Mode::Hold)),
    (Cause::GoalReached, &[Mode::Navigate], To::Mode(Mode::Hold)),
    (Cause::NoWay, &[Mode::Navigate], To::Mode(Mode::Hold)),
    (Cause::TargetMovedOff, &[Mode::Hold], To::Mode(Mode::Track)),
    (Cause::TargetConfirmed, &[Mode::Search], To::Mode(Mode::Track)),
    (Cause::TargetLost, &[Mode::Track, Mode::Hold], To::Mode(Mode::Search)),
    (Cause::SearchTimeout, &[Mode::Search], To::Land),
    // on the ground
    (Cause::CheckFailed, &[Mode::Ready], To::Mode(Mode::Idle)),
    (Cause::StartCommand, &[Mode::Ready], To::Mode(Mode::Takeoff)),
    (Cause::ResumeCommand, &[Mode::Hold], To::Begin),
    (Cause::ChecksPassed, &[Mode::Idle, Mode::Landed], To::Mode(Mode::Ready)),
    (Cause::FaultOver, &[Mode::Fault], To::Mode(Mode::Idle)),
];

/// Where `cause` alone leads from `mode`; none: the mode does not heed it.
#[must_use]
pub fn next(mode: Mode, cause: Cause, situation: &Situation) -> Option<Mode> {
    let row = TABLE.iter().find(|(on, from, _)| *on == cause && from.contains(&mode))?;
    let land = if situation.was_armed { Mode::Stopping } else { Mode::Idle };
    Some(match row.2 {
        To::Mode(mode) => mode,
        To::Begin if situation.task == Task::Track => Mode::Search,
        To::Begin => Mode::Navigate,
        To::Land => land,
        // A climb is no place to hover.
        To::Stop | To::Hover if !situation.was_armed || mode == Mode::Takeoff => land,
        To::Hover => Mode::Hold,
        // Whoever stops a hover means the ground.
        To::Stop if situation.held && situation.on_stop == StopAction::Hover => land,
        To::Stop => match situation.on_stop {
            StopAction::Land => Mode::Stopping,
            StopAction::Hover => Mode::Hold,
            StopAction::HandOver => Mode::Fault,
        },
    })
}

/// From `mode`, where the most urgent event that it heeds leads and why; none: stay.
#[must_use]
pub fn transition(mode: Mode, happened: Happened, situation: &Situation) -> Option<(Mode, Cause)> {
    let heeded = TABLE.iter().map(|row| row.0).filter(|cause| happened.contains(*cause));
    let mut leads = heeded.filter_map(|cause| next(mode, cause, situation).map(|to| (to, cause)));
    leads.next().filter(|(to, _)| *to != mode)
}

/// The events of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Happened(u32);

impl Happened {
    /// With `cause` if it is `so`.
    #[must_use]
    pub fn with(self, cause: Cause, so: bool) -> Self {
        Self(self.0 | u32::from(so) << cause as u32)
    }

    /// Whether `cause` is among them.
    #[must_use]
    pub fn contains(self, cause: Cause) -> bool {
        self.0 >> cause as u32 & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CHASE: Situation = Situation { task: Task::Track, was_armed: true, held: false, on_stop: StopAction::Land };

    /// Rows: `Cause::ALL`; columns: `Mode::ALL`, of a chase under way whose Stop lands. `.`: stays.
    const EXPECTED: [(Cause, &str); Cause::ALL.len()] = [
        // I R T T N S H S L F: Idle Ready Takeoff Track Navigate Search Hold Stopping Landed Fault
        (Cause::TouchedDown, ". . . . . . . Landed . ."),
        (Cause::Disarmed, ". . Fault Fault Fault Fault Fault . . ."),
        (Cause::ModeTakenAway, ". . Fault Fault Fault Fault Fault Fault . ."),
        (Cause::OdometryLost, ". . Fault Fault Fault Fault Fault Fault . ."),
        (Cause::OdometryFalse, ". . Fault Fault Fault Fault Fault Fault . ."),
        (Cause::PositionLost, ". . Fault Fault Fault Fault Fault Fault . ."),
        (Cause::StopCommand, ". . Stopping Stopping Stopping Stopping Stopping . . ."),
        (Cause::AutopilotLost, ". . Stopping Stopping Stopping Stopping Stopping . . ."),
        (Cause::BatteryLow, ". . Stopping Stopping Stopping Stopping Stopping . . ."),
        (Cause::FenceReached, ". . Stopping Stopping Stopping Stopping Stopping . . ."),
        (Cause::CeilingReached, ". . Stopping Stopping Stopping Stopping Stopping . . ."),
        (Cause::TimeUp, ". . Stopping Stopping Stopping Stopping Stopping . . ."),
        (Cause::HoldCommand, ". . Stopping Hold Hold Hold . . . ."),
        (Cause::OffboardRefused, ". . Fault . . . . . . ."),
        (Cause::ArmRefused, ". . Fault . . . . . . ."),
        (Cause::HeightReached, ". . Search . . . . . . ."),
        (Cause::TakeoffTimeout, ". . Stopping . . . . . . ."),
        (Cause::NoPlan, ". . . Stopping Stopping Stopping Stopping . . ."),
        (Cause::CaughtUp, ". . . Hold . . . . . ."),
        (Cause::GoalReached, ". . . . Hold . . . . ."),
        (Cause::NoWay, ". . . . Hold . . . . ."),
        (Cause::TargetMovedOff, ". . . . . . Track . . ."),
        (Cause::TargetConfirmed, ". . . . . Track . . . ."),
        (Cause::TargetLost, ". . . Search . . Search . . ."),
        (Cause::SearchTimeout, ". . . . . Stopping . . . ."),
        (Cause::CheckFailed, ". Idle . . . . . . . ."),
        (Cause::StartCommand, ". Takeoff . . . . . . . ."),
        (Cause::ResumeCommand, ". . . . . . Search . . ."),
        (Cause::ChecksPassed, "Ready . . . . . . . Ready ."),
        (Cause::FaultOver, ". . . . . . . . . Idle"),
    ];

    fn pairs() -> impl Iterator<Item = (Cause, Cause)> {
        let later = |i: usize| Cause::ALL[i + 1..].iter().map(move |second| (Cause::ALL[i], *second));
        (0..Cause::ALL.len()).flat_map(later)
    }

    fn only(cause: Cause) -> Happened {
        Happened::default().with(cause, true)
    }

    #[test]
    fn every_event_leads_from_every_mode_where_the_table_says() {
        for (row, (cause, expected)) in EXPECTED.iter().enumerate() {
            assert_eq!(*cause, Cause::ALL[row]);
            let expected: Vec<&str> = expected.split(' ').collect();
            assert_eq!(expected.len(), Mode::ALL.len());
            for (mode, expected) in Mode::ALL.into_iter().zip(expected) {
                let to = transition(mode, only(*cause), &CHASE);
                let got = to.map_or(".".to_owned(), |(to, _)| format!("{to:?}"));
                assert_eq!(got, expected, "{cause:?} in {mode:?}");
                assert!(to.is_none_or(|(_, why)| why == *cause));
            }
        }
    }

    #[test]
    fn of_two_events_the_more_urgent_wins_in_every_mode() {
        for (first, second) in pairs() {
            for mode in Mode::ALL {
                let both = transition(mode, only(first).with(second, true), &CHASE);
                // A hold that is held again is heeded, and leads nowhere.
                let heeded = if next(mode, first, &CHASE).is_some() { first } else { second };
                let alone = transition(mode, only(heeded), &CHASE);
                assert_eq!(both, alone, "{first:?} and {second:?} in {mode:?}");
            }
        }
    }

    #[test]
    fn stop_does_what_the_vehicle_file_says_once_it_flies() {
        let to = |mode, situation| transition(mode, only(Cause::StopCommand), &situation).map(|to| to.0);
        for (on_stop, there) in
            [(StopAction::Land, Mode::Stopping), (StopAction::Hover, Mode::Hold), (StopAction::HandOver, Mode::Fault)]
        {
            let chase = Situation { on_stop, ..CHASE };
            for mode in [Mode::Track, Mode::Navigate, Mode::Search] {
                assert_eq!(to(mode, chase), Some(there));
            }
            assert_eq!(to(Mode::Takeoff, chase), Some(Mode::Stopping));
            assert_eq!(to(Mode::Hold, chase), Some(there).filter(|there| *there != Mode::Hold));
            let held = if on_stop == StopAction::HandOver { Mode::Fault } else { Mode::Stopping };
            assert_eq!(to(Mode::Hold, Situation { held: true, ..chase }), Some(held));
        }
    }

    #[test]
    fn before_arming_whatever_would_land_goes_back_to_idle() {
        let unarmed = Situation { was_armed: false, ..CHASE };
        let lands = |cause: &Cause| next(Mode::Takeoff, *cause, &CHASE) == Some(Mode::Stopping);
        let landing: Vec<Cause> = Cause::ALL.into_iter().filter(lands).collect();
        assert!(landing.contains(&Cause::BatteryLow), "{landing:?}");
        for cause in landing {
            assert_eq!(next(Mode::Takeoff, cause, &unarmed), Some(Mode::Idle), "{cause:?}");
        }
    }

    #[test]
    fn takeoff_leads_to_the_search_or_to_the_goal() {
        let to = |task| next(Mode::Takeoff, Cause::HeightReached, &Situation { task, ..CHASE });
        assert_eq!((to(Task::Track), to(Task::Navigate)), (Some(Mode::Search), Some(Mode::Navigate)));
    }

    proptest! {
        #[test]
        fn only_a_start_in_ready_ever_begins_a_flight_and_the_pilot_always_ends_it(
            bits in 0..1u32 << Cause::ALL.len(), index in 0..10usize, was_armed in any::<bool>(), held in any::<bool>()
        ) {
            let (mode, happened) = (Mode::ALL[index], Happened(bits));
            let to = transition(mode, happened, &Situation { was_armed, held, ..CHASE });
            if let Some((to, cause)) = to {
                prop_assert_ne!(to, mode);
                prop_assert!(happened.contains(cause));
                if !mode.has_authority() && to.has_authority() {
                    prop_assert!(mode == Mode::Ready && cause == Cause::StartCommand);
                }
            }
            if mode.has_authority() && happened.contains(Cause::ModeTakenAway) {
                prop_assert!(to.is_some_and(|(to, _)| !to.has_authority()));
            }
        }
    }
}
