//! The faults that the stand-in can have, against the vehicle's own link over real UDP.

use super::link_tests::Bench;
use super::{OdometryFault, Px4Config, StickOverride};
use goshawk_autopilot::{AutopilotEvent, Command, Firmware, Outcome, PositionFault, Px4Mode};
use goshawk_core::Request;

#[test]
fn a_position_that_is_lost_in_flight_is_known_within_a_second() {
    let mut bench = Bench::airborne(Px4Config::default());
    assert_eq!(bench.status().position, Some(true));
    bench.px4.logic.faults.no_position = true;
    let took = bench.until("position lost", |bench| bench.status().position == Some(false));
    println!("position lost: known after {took:.2} s");
    assert!(took < 1.0, "{took}");
    assert_eq!(bench.status().position_fault, Some(PositionFault::Flags));
    bench.px4.logic.faults.no_position = false;
    let took = bench.until("position back", |bench| bench.status().position == Some(true));
    assert!((0.9..2.0).contains(&took), "{took}");
}

#[test]
fn odometry_that_contradicts_the_local_position_is_known_in_flight_and_on_the_ground_within_a_second() {
    for mut bench in [Bench::airborne(Px4Config::default()), Bench::new(Px4Config::default())] {
        bench.until("a position", |bench| bench.status().position == Some(true));
        bench.run(3.0);
        assert_eq!(bench.status().position_fault, None);
        bench.px4.logic.set_odometry_fault(Some(OdometryFault::Contradictory));
        let took = bench.until("not valid", |bench| bench.status().position == Some(false));
        assert!(took < 0.1, "{took}");
        assert_eq!(bench.status().position_fault, Some(PositionFault::Unfelt), "the accelerometer tells first");
        let fault = Some(PositionFault::Contradiction);
        let took = bench.until("contradiction", |bench| bench.status().position_fault == fault);
        assert!(took < 1.0, "{took}");
        bench.px4.logic.set_odometry_fault(None);
        let took = bench.until("agreement", |bench| bench.status().position == Some(true));
        assert!((0.9..3.0).contains(&took), "{took}");
    }
}

#[test]
fn an_autopilot_without_a_position_is_known_on_the_ground_too() {
    let mut bench = Bench::new(Px4Config::default());
    bench.px4.logic.faults.no_position = true;
    bench.until("connected", |bench| bench.status().connected);
    bench.until("no position", |bench| bench.status().position == Some(false));
    // In HOLD, which it is in, it could not arm; in OFFBOARD it could: that is what counts.
    assert_eq!(bench.status().would_arm, Some(true));
}

#[test]
fn a_refusal_to_arm_is_known_with_its_reason_before_it_is_asked_to() {
    let mut bench = Bench::new(Px4Config::default());
    bench.until("connected", |bench| bench.status().connected);
    bench.until("would arm", |bench| bench.status().would_arm == Some(true));
    bench.px4.logic.faults.unarmable = true;
    bench.until("would not arm", |bench| bench.status().would_arm == Some(false));
    let refusal = bench.link.refusal(bench.now()).unwrap();
    assert!(refusal.contains("COM_ARMABLE"), "{refusal}");
    assert_eq!(bench.ask(Firmware::Px4.command(Request::Arm)), Outcome::TemporarilyRejected);
    bench.px4.logic.faults.unarmable = false;
    bench.until("would arm", |bench| bench.status().would_arm == Some(true));
}

#[test]
fn left_in_offboard_after_a_flight_it_still_would_arm() {
    let mut bench = Bench::new(Px4Config::default());
    bench.until("connected", |bench| bench.status().connected);
    assert_eq!(bench.ask(Firmware::Px4.command(Request::Offboard)), Outcome::Accepted);
    bench.run(6.0);
    assert_eq!((bench.status().would_arm, bench.link.refusal(bench.now())), (Some(true), None));
}

#[test]
fn commands_that_are_not_answered_are_told_with_what_to_do() {
    let mut bench = Bench::new(Px4Config::default());
    bench.px4.logic.faults.deaf = true;
    bench.until("connected", |bench| bench.status().connected);
    bench.until("unanswered", |bench| bench.status().unanswered);
    let problem = bench.status().problem().unwrap();
    assert!(problem.contains("does not answer") && problem.contains("sign"), "{problem}");
    bench.px4.logic.faults.deaf = false;
    bench.until("answered", |bench| bench.status().problem().is_none());
}

#[test]
fn after_a_restart_nothing_is_sent_that_was_asked_before() {
    let mut bench = Bench::airborne(Px4Config::default());
    // A hand-back on its way when the power fails, asked for again as the controller does until it hears otherwise.
    bench.px4.logic.restart(2.5);
    bench.height = None;
    for _ in 0..2500 {
        if bench.steps.is_multiple_of(1000) && bench.status().offboard {
            bench.link.request(Request::HandBack);
        }
        bench.step();
    }
    bench.until("heard again", |bench| bench.status().counters.restarts == 1);
    bench.until("connected", |bench| bench.status().connected);
    bench.run(3.0);
    let status = bench.status();
    assert!(!status.offboard && !status.armed, "{status:?}");
    assert_eq!(bench.px4.logic.mode(), Px4Mode::Hold, "an order of before would have landed it");
    // The streams are asked for again: nobody else would.
    let before = bench.link.odometry().unwrap().stamp;
    bench.run(0.05);
    assert!(bench.link.odometry().unwrap().stamp.since(before) > 0.03);
}

#[test]
fn messages_that_nobody_knows_are_counted_and_nothing_is_lost() {
    let mut bench = Bench::new(Px4Config::default());
    bench.px4.unknown_after = Some(140);
    bench.until("connected", |bench| bench.status().connected);
    bench.run(20.0);
    let counters = bench.status().counters;
    println!("unknown messages: {} in 20 s, {} of {} lost", counters.unknown, counters.lost, counters.received);
    assert!(counters.unknown > 40 && counters.lost == 0, "{counters:?}");
}

#[test]
fn a_slow_push_of_the_sticks_takes_nothing_over_and_a_quick_one_does() {
    for (sticks, slow, quick) in [
        (StickOverride::Speed(1.0), 0.5, Some(1.2)),
        (StickOverride::Speed(-1.0), 5.0, None),
        (StickOverride::Bits(1), 5.0, None),
    ] {
        let mut bench = Bench::airborne(Px4Config { sticks, ..Px4Config::default() });
        bench.px4.logic.move_sticks(slow);
        bench.run(0.5);
        assert!(bench.status().offboard, "{sticks:?}");
        if let Some(quick) = quick {
            bench.px4.logic.move_sticks(quick);
            bench.until("taken over", |bench| !bench.status().offboard);
        }
    }
}

#[test]
fn it_arms_late_where_it_takes_its_time() {
    let mut bench = Bench::new(Px4Config::default());
    bench.px4.logic.faults.arming_delay_s = 2.0;
    bench.until("connected", |bench| bench.status().connected);
    bench.height = Some(-10.0);
    bench.run(0.2);
    assert_eq!(bench.ask(Firmware::Px4.command(Request::Offboard)), Outcome::Accepted);
    bench.link.command(Command::Arm);
    bench.run(1.5);
    assert!(!bench.status().armed);
    let took = bench.until("armed", |bench| bench.status().armed);
    assert!((0.4..0.7).contains(&took), "{took}");
    assert!(bench.link.take_events().iter().any(|(_, event)| *event == AutopilotEvent::Armed));
}
