use super::*;
use crate::dialogue::firmware::{Firmware, Guided};
use goshawk_core::Request;

fn due(commands: &mut Commands, seconds: f64) -> Option<COMMAND_LONG_DATA> {
    match commands.due(Time::from_secs(seconds), 1, 1) {
        Some(MavMessage::COMMAND_LONG(long)) => Some(long),
        Some(other) => panic!("{other:?}"),
        None => None,
    }
}

fn ack(command: MavCmd, result: MavResult) -> COMMAND_ACK_DATA {
    COMMAND_ACK_DATA { command, result, ..COMMAND_ACK_DATA::default() }
}

#[test]
fn a_command_is_repeated_until_answered_and_then_given_up() {
    let mut commands = Commands::default();
    commands.submit(Command::Arm);
    for attempt in 0..ATTEMPTS {
        let long = due(&mut commands, f64::from(attempt) * 0.3).expect("due");
        assert_eq!(long.confirmation, attempt);
        assert!(due(&mut commands, f64::from(attempt) * 0.3 + 0.1).is_none());
    }
    assert!(due(&mut commands, 2.0).is_none());
    let answers = commands.take_answers();
    assert_eq!(answers.len(), 1);
    assert_eq!(answers[0].outcome, Outcome::NoAnswer);
}

#[test]
fn requests_have_the_parameters_that_each_firmware_takes() {
    let (guided, no_gps) = (Firmware::ArduPilot(Guided::Guided), Firmware::ArduPilot(Guided::NoGps));
    let cases = [
        (Firmware::Px4, Request::Offboard, MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 6.0, 0.0]),
        (Firmware::Px4, Request::HandBack, MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, 6.0]),
        (Firmware::Px4, Request::Arm, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0]),
        (Firmware::Px4, Request::Disarm, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, 0.0, 0.0]),
        (guided, Request::Offboard, MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, 0.0]),
        (no_gps, Request::Offboard, MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 20.0, 0.0]),
        (no_gps, Request::HandBack, MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 9.0, 0.0]),
        (guided, Request::Arm, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0]),
        (guided, Request::Disarm, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, 0.0, 0.0]),
        (guided, Request::DisarmAnyway, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, 21196.0, 0.0]),
    ];
    for (firmware, request, id, params) in cases {
        let mut commands = Commands::default();
        commands.submit(firmware.command(request));
        let long = due(&mut commands, 1.0).unwrap();
        assert_eq!((long.command, [long.param1, long.param2, long.param3]), (id, params), "{firmware} {request:?}");
    }
}

#[test]
fn streams_are_asked_for_one_by_one() {
    let mut commands = Commands::default();
    commands.submit(Command::Stream { message: 331, hz: 100.0 });
    commands.submit(Command::Stream { message: 31, hz: 125.0 });
    let first = due(&mut commands, 0.0).unwrap();
    assert_eq!((first.param1, first.param2), (331.0, 10_000.0));
    assert!(due(&mut commands, 0.01).is_none());
    let accepted = ack(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, MavResult::MAV_RESULT_ACCEPTED);
    assert!(commands.answered(Time::from_secs(0.02), &accepted).is_some());
    assert_eq!(due(&mut commands, 0.02).unwrap().param2, 8_000.0);
}

#[test]
fn handing_back_replaces_an_unanswered_offboard() {
    let mut commands = Commands::default();
    commands.submit(Firmware::Px4.command(Request::Offboard));
    assert!(due(&mut commands, 0.0).is_some());
    commands.submit(Firmware::Px4.command(Request::HandBack));
    assert_eq!(due(&mut commands, 0.001).unwrap().param2, 4.0);
    assert!(due(&mut commands, 0.002).is_none());
}

#[test]
fn an_answer_to_nothing_is_ignored() {
    let mut commands = Commands::default();
    let stray = ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_ACCEPTED);
    assert!(commands.answered(Time(0), &stray).is_none());
    commands.submit(Command::Arm);
    assert!(commands.answered(Time(0), &stray).is_none(), "not sent yet");
}

#[test]
fn what_is_never_answered_is_known_until_something_is() {
    let mut commands = Commands::default();
    commands.submit(Command::TellChecks);
    let mut now = Time::from_secs(1.0);
    while !commands.is_idle() {
        commands.due(now, 1, 1);
        now = now.plus(0.3);
    }
    assert!(!commands.unanswered(), "not every firmware answers that one");
    commands.submit(Command::Arm);
    while !commands.is_idle() {
        commands.due(now, 1, 1);
        now = now.plus(0.3);
    }
    assert!(commands.unanswered());
    commands.submit(Command::Stream { message: 30, hz: 10.0 });
    commands.due(now, 1, 1);
    let ack = COMMAND_ACK_DATA { command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, ..COMMAND_ACK_DATA::default() };
    commands.answered(now, &ack);
    assert!(!commands.unanswered());
}

#[test]
fn orders_are_given_up_in_a_silence_and_questions_are_not() {
    let mut commands = Commands::default();
    commands.submit(Command::Arm);
    commands.submit(Command::Stream { message: 30, hz: 10.0 });
    commands.drop_orders(Time::from_secs(1.0));
    let sent = commands.due(Time::from_secs(1.0), 1, 1).unwrap();
    assert!(matches!(sent, MavMessage::COMMAND_LONG(c) if c.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL));
    assert_eq!(commands.take_answers()[0].outcome, Outcome::NoAnswer);
}
