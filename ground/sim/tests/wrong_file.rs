//! Flights of airframes that are not what the vehicle file says: what is learnt on board flies them all the same.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{config, sectors, vehicle};
use goshawk_core::{ControllerOutput, Task, Time};
use goshawk_sim::pilots::fly_trial;
use goshawk_sim::trial::{Difference, Flight, Pilot, TrialConfig, Truth, Witness};

/// What the estimates came to, and how high the vehicle was.
#[derive(Default)]
struct Record {
    hover_thrust: f64,
    attitude_lag: f64,
    heights: Vec<f64>,
}

impl Witness for Record {
    fn control(&mut self, _now: Time, output: &ControllerOutput, _onboard: &dyn Pilot) {
        (self.hover_thrust, self.attitude_lag) = (output.hover_thrust, output.attitude_lag);
    }

    fn truth(&mut self, _now: Time, truth: &Truth<'_>) {
        self.heights.push(truth.vehicle.pos_world.z);
    }
}

fn fly(airframe: Difference, seed: u64) -> (Flight, Record) {
    let config = TrialConfig { airframe, ..config(Task::Navigate, 4.0, 9.0, seed) };
    let mut record = Record::default();
    let flight = fly_trial(&config, &vehicle(), Some(&mut sectors(false)), &mut record).unwrap();
    (flight, record)
}

#[test]
fn a_hover_thrust_40_percent_wrong_either_way_reaches_the_goal_at_its_height() {
    let told = vehicle().airframe.hover_thrust;
    for factor in [0.6, 1.4] {
        let hover = factor * told;
        let airframe = Difference { hover_thrust: Some(hover), ..Difference::default() };
        let mut reached = 0;
        for seed in 0..3 {
            let (flight, record) = fly(airframe, seed);
            reached += u32::from(flight.reached);
            let ground = record.heights[0];
            let highest = record.heights.iter().fold(0.0_f64, |most, z| most.max(z - ground));
            assert!(highest < 3.5, "{factor}, seed {seed}: {highest} m up");
            let off = record.hover_thrust / hover - 1.0;
            assert!(off.abs() < 0.12, "{factor}, seed {seed}: off by {off}");
        }
        assert!(reached >= 3, "{factor}: {reached} of 3");
    }
}

#[test]
fn lags_of_50_to_300_ms_reach_the_goal_with_a_file_that_says_80() {
    for lag_s in [0.05, 0.1, 0.2, 0.3] {
        let airframe = Difference { attitude_lag_s: Some(lag_s), ..Difference::default() };
        let flights = [0, 1, 2].map(|seed| fly(airframe, seed));
        let reached = flights.iter().filter(|(flight, _)| flight.reached).count();
        let learnt = flights.iter().map(|(_, record)| record.attitude_lag).sum::<f64>() / 3.0;
        assert!(reached >= 3, "{lag_s}: {reached} of 3");
        assert!((learnt / lag_s - 1.0).abs() < 0.3, "{lag_s}: {learnt}");
    }
}
