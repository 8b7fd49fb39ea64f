//! The planner's thread: newest frame in, network, plan out. It runs whenever images come, also before a start, so
//! that readiness and the dashboard show what the policy sees.

use std::sync::atomic::Ordering;
use std::time::Duration;

use goshawk_core::{
    ANCHORS, FrameInput, FrameRecord, MAX_CHANNELS, NetworkOutput, Plan, Planner, PlanningDemand, Time,
};
use goshawk_policy::{AnswerMonitor, Policy, Preprocessor};
use goshawk_vehicle::sensors::Frame;
use goshawk_vehicle::{clock, convert};

use crate::flight::realtime::Schedule;
use crate::flight::shared::{PlanFailed, Planned, Report, Shared, lock};

/// What is remembered about the vehicle is told so often, s: it is for people.
const MAP_PERIOD_S: f64 = 1.0;

/// What the thread owns.
pub struct Planning {
    /// The policy's network.
    pub policy: Policy,
    /// Watches what it answers.
    pub answers: AnswerMonitor,
    /// The rim of its image in which depth may be missing, pixels.
    pub depth_rim_px: usize,
    /// Its image preparation, made for the source of the last frame.
    pub preprocessor: Option<Preprocessor>,
    /// The core's planner.
    pub planner: Planner,
    /// What is planned for while the controller demands nothing.
    pub idle_demand: PlanningDemand,
    /// How the thread is scheduled.
    pub schedule: Schedule,
}

impl Planning {
    /// Plans from each new frame until the process stops.
    pub fn run(mut self, shared: &Shared) {
        self.schedule.apply("planner");
        let (mut seen, mut seq) = (0, 0);
        let (mut maps, mut mapped) = (0, Time(0));
        while !shared.stopping() {
            let Some((frame, missed)) = shared.frame.wait_newer(&mut seen, Duration::from_millis(100)) else {
                continue;
            };
            shared.skipped_frames.fetch_add(missed, Ordering::Relaxed);
            if frame.fault.is_some() {
                // What is not to be believed is shown and logged, and not flown: the last plan expires.
                shared.report(Report::Frame(frame));
                continue;
            }
            let planned = self.plan(shared, &frame, seq);
            let print = frame.print;
            shared.report(Report::Frame(frame));
            match planned {
                Ok((plan, record, inference_s)) => {
                    let fault = self.answers.judge(plan.stamp, print, &record.network);
                    if fault.is_none() {
                        shared.plan.put(plan.clone());
                    }
                    let ready = clock::now();
                    let map = if ready.since(mapped) >= MAP_PERIOD_S {
                        convert::obstacle_map(maps, ready, &self.planner, &record.frame)
                    } else {
                        None
                    };
                    shared.report(Report::Plan(Box::new(Planned { plan, record, ready, inference_s, fault })));
                    if let Some(map) = map {
                        (maps, mapped) = (maps + 1, ready);
                        shared.report(Report::Map(map));
                    }
                }
                Err(failed) => shared.report(Report::PlanFailed(failed)),
            }
            seq += 1;
        }
    }

    fn plan(&mut self, shared: &Shared, frame: &Frame, seq: u64) -> Result<(Plan, FrameRecord, f64), Box<PlanFailed>> {
        let flight = shared.flight.load(Ordering::Acquire);
        let (odometry, acc_world) = {
            let history = lock(&shared.history);
            (history.odometry_at(frame.stamp), history.acceleration_at(frame.stamp))
        };
        let odometry = odometry.ok_or_else(|| "no odometry around the frame's stamp".to_owned())?;
        let demand = shared.demand.latest().unwrap_or(self.idle_demand);
        let source = frame.source();
        let preprocessor = match self.preprocessor.take().filter(|p| p.source() == source) {
            Some(fitting) => fitting,
            None => Preprocessor::new(self.policy.contract(), source)
                .map_err(|e| e.to_string())?
                .with_rim(self.depth_rim_px),
        };
        let preprocessor = self.preprocessor.insert(preprocessor);
        let nearest = preprocessor.nearest(&frame.depth_mm).map_err(|e| e.to_string())?;
        let image = preprocessor.run(&frame.rgb, &frame.depth_mm).map_err(|e| e.to_string())?;
        let frame = FrameInput::new(flight, seq, &odometry, acc_world, &demand, nearest);
        let begun = clock::now();
        let asked = self.planner.see(&frame);
        let state = *asked.state();
        let network = match self.policy.infer(image, &state) {
            Ok(network) => network,
            Err(error) => {
                let network = NetworkOutput { values: [0.0; MAX_CHANNELS * ANCHORS] };
                let seen = Some(FrameRecord { frame, state, network });
                return Err(Box::new(PlanFailed { why: error.to_string(), seen }));
            }
        };
        let inference_s = clock::now().since(begun);
        let plan = asked.answer(&network);
        Ok((plan, FrameRecord { frame, state, network }, inference_s))
    }
}
