//! The planner's thread: newest frame in, network, plan out. It runs whenever images come, also before a start, so
//! that readiness and the dashboard show what the policy sees.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use goshawk_core::{Plan, Planner, PlannerInput, PlanningDemand};
use goshawk_policy::{Policy, Preprocessor, Source};

use crate::clock;
use crate::sensors::Frame;
use crate::shared::{Report, Shared, lock};

/// What the thread owns.
pub struct Planning {
    /// The policy's network.
    pub policy: Policy,
    /// Its image preparation, made for the source of the last frame.
    pub preprocessor: Option<Preprocessor>,
    /// The core's planner.
    pub planner: Planner,
    /// What is planned for while the controller demands nothing.
    pub idle_demand: PlanningDemand,
}

impl Planning {
    /// Plans from each new frame until the process stops.
    pub fn run(mut self, shared: &Shared) {
        let (mut seen, mut seq) = (0, 0);
        while !shared.stopping() {
            let Some((frame, missed)) = shared.frame.wait_newer(&mut seen, Duration::from_millis(100)) else {
                continue;
            };
            shared.skipped_frames.fetch_add(missed, Ordering::Relaxed);
            match self.plan(shared, &frame, seq) {
                Ok((plan, inference_s)) => {
                    let plan = Arc::new(plan);
                    shared.plan.put(Arc::clone(&plan));
                    shared.report(Report::Plan { plan, ready: clock::now(), inference_s });
                }
                Err(why) => shared.report(Report::PlanFailed(why)),
            }
            shared.report(Report::Frame(frame));
            seq += 1;
        }
    }

    fn plan(&mut self, shared: &Shared, frame: &Frame, seq: u64) -> Result<(Plan, f64), String> {
        let (odometry, acc_world) = {
            let history = lock(&shared.history);
            (history.odometry_at(frame.stamp), history.acceleration_at(frame.stamp))
        };
        let odometry = odometry.ok_or("no odometry around the frame's stamp")?;
        let demand = shared.demand.latest().map_or(self.idle_demand, |demand| *demand);
        let state = self.planner.network_state(&odometry, acc_world, demand.speed, demand.goal_world);
        let source = Source {
            width: frame.width as u32,
            height: frame.height as u32,
            hfov_rad: frame.hfov,
            vfov_rad: frame.vfov,
        };
        let preprocessor = match self.preprocessor.take().filter(|p| p.source() == source) {
            Some(fitting) => fitting,
            None => Preprocessor::new(self.policy.contract(), source).map_err(|e| e.to_string())?,
        };
        let image =
            self.preprocessor.insert(preprocessor).run(&frame.rgb, &frame.depth_mm).map_err(|e| e.to_string())?;
        let begun = clock::now();
        let network = self.policy.infer(image, &state[..self.policy.state_len()]).map_err(|e| e.to_string())?;
        let inference_s = clock::now().since(begun);
        let input = PlannerInput {
            seq,
            odometry: &odometry,
            acc_world,
            speed: demand.speed,
            goal_world: demand.goal_world,
            network: &network,
        };
        Ok((self.planner.step(&input), inference_s))
    }
}
