//! Speed of the vehicle's own way from a frame to a command, on one thread: on the frames of a flight in lockstep, with
//! the shipped policy. `target/bench.json`: `frame_to_command_ms`, `post_network_us`, `controller_step_us`, and what the
//! monitors of the camera's stream and of the network's answers cost, `monitors_us`, and the recorder,
//! `recorder_core_fraction`.
//!
//! The thread is scheduled as the vehicle's planner, where that is permitted: what else runs then counts as little as on
//! board. The yardstick, measured in the same run, is the network alone: a frame may take 1.15 times its median, and one
//! of a hundred 1.5 times. How near the network is to what a core can do is `ground/train/benches/network.py`'s. What comes after the network is measured twice:
//! by itself (`post_network_us`), and behind the network, which has just filled the caches with its weights
//! (`post_network_cold_us`).

mod common;

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use common::{core_seconds, quantile, record, row, verdict};
use goshawk_air::flight::realtime::Schedule;
use goshawk_autopilot::{AutopilotLink, LinkConfig};
use goshawk_core::{ControllerOutput, FlightController, FrameInput, FrameRecord, Plan, Planner, StepInput, Task, Time};
use goshawk_policy::{AnswerMonitor, Arrival, Policy, Preprocessor, StreamMonitor};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, LogWriter};
use goshawk_sim::actors::evader::Course;
use goshawk_sim::pilots::fly_trial;
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::sense::rgbd::RgbdImage;
use goshawk_sim::trial::airframe::Mount;
use goshawk_sim::trial::{Difference, EvaderKind, Pilot, PilotKind, TrialConfig, Witness, WorldSource};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::sensors;
use goshawk_vehicle::{convert, inputs};
use prost::Message;

/// All that one flight's software was given.
#[derive(Default)]
struct Flight {
    frames: Vec<(v1::Rgbd, RgbdImage)>,
    plans: Vec<(Time, Plan, FrameRecord)>,
    steps: Vec<(Time, StepInput, ControllerOutput)>,
    fov: (f64, f64),
}

impl Witness for Flight {
    fn control(&mut self, now: Time, output: &ControllerOutput, onboard: &dyn Pilot) {
        if let Some(input) = onboard.step_input() {
            self.steps.push((now, *input, *output));
        }
    }

    fn frame(&mut self, seq: u64, stamp: Time, image: &RgbdImage) {
        let message = v1::Rgbd {
            seq,
            stamp_ns: stamp.0,
            width: image.width as u32,
            height: image.height as u32,
            hfov_rad: self.fov.0,
            vfov_rad: self.fov.1,
            rgb: image.rgb.clone(),
            depth_mm: image.depth_mm.iter().flat_map(|mm| mm.to_le_bytes()).collect(),
        };
        self.frames.push((message, image.clone()));
    }

    fn plan(&mut self, ready: Time, plan: &Plan, record: Option<&FrameRecord>) {
        if let Some(record) = record {
            self.plans.push((ready, plan.clone(), record.clone()));
        }
    }
}

fn fly(vehicle: &Vehicle, policy: &mut Policy) -> color_eyre::Result<Flight> {
    let config = TrialConfig {
        pilot: PilotKind::Policy,
        task: Task::Track,
        speed_mps: 3.0,
        speed_margin_mps: 3.0,
        height_m: 1.5,
        world: WorldSource::Forest { spacing_m: 4.0 },
        evader: EvaderKind::Planned,
        course: Course::Goal,
        length_m: 40.0,
        wind_mps: 0.0,
        sensors: Sensors::default(),
        airframe: Difference::default(),
        moving: 0,
        fault: None,
        firmware: None,
        seed: 3,
    };
    let camera = Mount::of(vehicle).camera;
    let mut flight = Flight { fov: (camera.hfov_rad, camera.vfov_rad()), ..Flight::default() };
    fly_trial(&config, vehicle, Some(policy), &mut flight)?;
    Ok(flight)
}

#[derive(Default)]
struct Times {
    whole_ms: Vec<f64>,
    decode_ms: Vec<f64>,
    stream_us: Vec<f64>,
    answers_us: Vec<f64>,
    monitors_us: Vec<f64>,
    prepare_ms: Vec<f64>,
    memory_ms: Vec<f64>,
    network_ms: Vec<f64>,
    post_us: Vec<f64>,
    planner_us: Vec<f64>,
    controller_us: Vec<f64>,
    encode_us: Vec<f64>,
}

/// Each frame of the flight through everything, on this thread: message in, datagram out.
fn frames(vehicle: &Vehicle, policy: &mut Policy, flight: &Flight) -> color_eyre::Result<Times> {
    let link = AutopilotLink::open(LinkConfig::customary("127.0.0.1:0".parse()?), clock::now)?;
    let mut planner = Planner::new(vehicle.planner_config(policy.contract().model()))?;
    let mut controller = FlightController::new(vehicle.controller_config())?;
    let mut preprocessor: Option<Preprocessor> = None;
    let mut stream = StreamMonitor::new(vehicle.camera.rates());
    let mut answers = AnswerMonitor::new(policy.contract());
    let mut times = Times::default();
    let mut steps = flight.steps.iter().peekable();
    for (ready, _, logged) in &flight.plans {
        let Some((message, _)) = flight.frames.iter().find(|(m, _)| m.stamp_ns == logged.frame.odometry.stamp.0) else {
            continue;
        };
        // The controller as it was when this plan came.
        let mut last = None;
        while let Some((now, input, _)) = steps.next_if(|(now, ..)| now <= ready) {
            controller.step(*now, input, None);
            last = input.odometry;
        }
        let Some((now, input, _)) = steps.peek() else { break };
        let bytes = message.encode_to_vec();
        let begun = Instant::now();
        let frame = sensors::frame(&bytes, Time(message.stamp_ns))?;
        let decoded = Instant::now();
        let arrival = Arrival { seq: frame.seq, stamp: frame.stamp, source: 0 };
        black_box(stream.judge(&arrival, &frame.rgb, &frame.depth_mm, &sensors::moving(true, &logged.frame.odometry)));
        let print = stream.print();
        let judged = Instant::now();
        let preparing = match preprocessor.take() {
            Some(made) => made,
            None => Preprocessor::new(policy.contract(), frame.source())?,
        };
        let preparing = preprocessor.insert(preparing);
        let nearest = preparing.nearest(&frame.depth_mm)?;
        let image = preparing.run(&frame.rgb, &frame.depth_mm)?;
        let prepared = Instant::now();
        let seen = FrameInput { nearest, ..logged.frame.clone() };
        let asked = planner.see(&seen);
        let remembered = Instant::now();
        let network = policy.infer(image, asked.state())?;
        let answered = Instant::now();
        let plan = asked.answer(&network);
        let planned = Instant::now();
        black_box(answers.judge(plan.stamp, print, &network));
        let believed = Instant::now();
        let taking = StepInput { odometry: last, plan_seq: Some(plan.seq), ..*input };
        let output = controller.step(*now, &taking, Some(&plan));
        let controlled = Instant::now();
        let datagram = output.setpoint.map(|setpoint| link.setpoint_frame(&setpoint)).transpose()?;
        let ended = Instant::now();
        if black_box(datagram).is_none() {
            continue; // on the ground nothing is sent
        }
        let ms = |from: Instant, to: Instant| (to - from).as_secs_f64() * 1e3;
        times.whole_ms.push(ms(begun, ended));
        times.memory_ms.push(ms(prepared, remembered));
        times.decode_ms.push(ms(begun, decoded));
        let (stream_us, answers_us) = (1e3 * ms(decoded, judged), 1e3 * ms(planned, believed));
        times.stream_us.push(stream_us);
        times.answers_us.push(answers_us);
        times.monitors_us.push(stream_us + answers_us);
        times.prepare_ms.push(ms(judged, prepared));
        times.network_ms.push(ms(remembered, answered));
        times.post_us.push(1e3 * ms(answered, ended) - answers_us);
        times.planner_us.push(1e3 * ms(answered, planned));
        times.controller_us.push(1e3 * ms(believed, controlled));
        times.encode_us.push(1e3 * ms(controlled, ended));
    }
    Ok(times)
}

/// For each plan of the flight: from the network's answer to the datagram of the controller's step that takes it, us.
fn after_network(vehicle: &Vehicle, policy: &Policy, flight: &Flight) -> color_eyre::Result<Vec<f64>> {
    let link = AutopilotLink::open(LinkConfig::customary("127.0.0.1:0".parse()?), clock::now)?;
    let mut times_us = Vec::new();
    for _ in 0..5 {
        let mut planner = Planner::new(vehicle.planner_config(policy.contract().model()))?;
        let mut controller = FlightController::new(vehicle.controller_config())?;
        let mut steps = flight.steps.iter().peekable();
        for (ready, _, logged) in &flight.plans {
            while let Some((now, input, _)) = steps.next_if(|(now, ..)| now < ready) {
                controller.step(*now, input, None);
            }
            let Some((now, input, _)) = steps.next() else { break };
            let asked = planner.see(&logged.frame);
            let begun = Instant::now();
            let plan = asked.answer(&logged.network);
            let taking = StepInput { plan_seq: Some(plan.seq), ..*input };
            let output = controller.step(*now, &taking, Some(&plan));
            let datagram = output.setpoint.map(|setpoint| link.setpoint_frame(&setpoint)).transpose()?;
            let us = begun.elapsed().as_secs_f64() * 1e6;
            if black_box(datagram).is_some() {
                times_us.push(us);
            }
        }
    }
    Ok(times_us)
}

/// Each controller step of the flight, with its plans, us.
fn controller_steps(vehicle: &Vehicle, flight: &Flight) -> color_eyre::Result<Vec<f64>> {
    let mut times_us = Vec::new();
    for _ in 0..5 {
        let mut controller = FlightController::new(vehicle.controller_config())?;
        for (now, input, _) in &flight.steps {
            let plan = input.plan_seq.and_then(|seq| flight.plans.iter().find(|(_, plan, _)| plan.seq == seq));
            let plan = plan.map(|(_, plan, _)| plan);
            let begun = Instant::now();
            black_box(controller.step(*now, input, plan));
            times_us.push(begun.elapsed().as_secs_f64() * 1e6);
        }
    }
    Ok(times_us)
}

/// Writes the flight's log as the recorder's thread does; the share of a core for each second of flight, and MB/s.
fn recorder(flight: &Flight) -> color_eyre::Result<(f64, f64)> {
    let begun = core_seconds();
    let mut log = LogWriter::new(Vec::new())?;
    let channel = |key| Channel::of(key).ok_or_else(|| color_eyre::eyre::eyre!("no channel"));
    for (message, image) in &flight.frames {
        let png = goshawk_recorder::image::compress(&image.rgb, &image.depth_mm, message.width, message.height)?;
        log.write(Channel::RGBD, message.stamp_ns, &png.encode_to_vec())?;
    }
    for (ready, plan, made_from) in &flight.plans {
        log.write(Channel::PLANNER_INPUT, ready.0, &inputs::planner_input(made_from).encode_to_vec())?;
        log.write(channel(Key::Plan)?, ready.0, &convert::plan(plan, *ready).encode_to_vec())?;
        if let Some(target) = convert::target(0, plan) {
            log.write(channel(Key::Target)?, ready.0, &target.encode_to_vec())?;
        }
    }
    for (seq, (now, input, output)) in flight.steps.iter().enumerate() {
        log.write(
            Channel::CONTROLLER_INPUT,
            now.0,
            &inputs::controller_input(input, seq as u64, *now).encode_to_vec(),
        )?;
        let control = convert::control(seq as u64, *now, output, input.odometry.as_ref());
        log.write(channel(Key::Control)?, now.0, &control.encode_to_vec())?;
        if let Some(odometry) = input.odometry.filter(|_| seq % 2 == 0) {
            log.write(Channel::ODOMETRY, now.0, &convert::odometry(0, &odometry).encode_to_vec())?;
        }
    }
    let bytes = log.finish()?.len() as f64;
    let spent = core_seconds() - begun;
    let frames_s = flight.frames.len() as f64 / 30.0;
    Ok((spent / frames_s, bytes / frames_s / 1e6))
}

fn main() -> color_eyre::Result<()> {
    let vehicle = Vehicle::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../air/vehicles/sim.toml"))?;
    let mut policy = vehicle.load_policy(&vehicle.resolve(&vehicle.policy.model), 1)?;
    let flight = fly(&vehicle, &mut policy)?;
    for why in (Schedule { priority: vehicle.realtime.planner_priority, core: None }).try_apply() {
        println!("refused here: {why}");
    }
    let mut t = frames(&vehicle, &mut policy, &flight)?;
    println!("onboard, one thread, {} frames of a flight with the shipped policy", t.whole_ms.len());
    let line = |name: &str, unit: &str, values: &mut Vec<f64>, targets: Option<(f64, f64)>| {
        let (p50, p99) = (quantile(values, 0.5), quantile(values, 0.99));
        let said = targets.map_or_else(String::new, |(half, most)| {
            let wanted = if half.is_finite() { format!("p50 {half:.2}, p99 {most:.2}") } else { format!("p99 {most}") };
            format!("   target {wanted} {unit}: {}", verdict(p50 <= half && p99 <= most))
        });
        println!("  {name:<20} p50 {p50:7.3} {unit}, p99 {p99:7.3} {unit}{said}");
        (p50, p99)
    };
    let alone_ms = quantile(&mut t.network_ms, 0.5);
    let wanted = ((1.15 * alone_ms).min(1.5), (1.5 * alone_ms).min(3.0));
    let whole = line("frame to command", "ms", &mut t.whole_ms, Some(wanted));
    line("  message to frame", "ms", &mut t.decode_ms, None);
    line("  image to input", "ms", &mut t.prepare_ms, None);
    line("  obstacles' memory", "ms", &mut t.memory_ms, None);
    let network = line("  network, yardstick", "ms", &mut t.network_ms, None);
    let cold = line("  caches cold: rest", "us", &mut t.post_us, Some((10.0, 25.0)));
    line("    planner", "us", &mut t.planner_us, None);
    line("    controller", "us", &mut t.controller_us, None);
    line("    encode", "us", &mut t.encode_us, None);
    let monitors = line("  monitors, together", "us", &mut t.monitors_us, None);
    line("    of the stream", "us", &mut t.stream_us, None);
    line("    of the answers", "us", &mut t.answers_us, None);
    println!("  monitors             {:.2} % of the network's median", 0.1 * monitors.0 / network.0);
    let mut post_us = after_network(&vehicle, &policy, &flight)?;
    let post = line("after the network", "us", &mut post_us, Some((f64::INFINITY, 10.0)));
    let mut steps_us = controller_steps(&vehicle, &flight)?;
    let step = line("controller step", "us", &mut steps_us, Some((f64::INFINITY, 2.0)));
    let (fraction, mbps) = recorder(&flight)?;
    let met = verdict(fraction <= 0.05);
    println!("  recorder             {:.1} % of a core, {mbps:.2} MB/s   target 5 %: {met}", 100.0 * fraction);
    let wanted = serde_json::json!({"p50": wanted.0, "p99": wanted.1});
    let whole = serde_json::json!({"p50": whole.0, "p99": whole.1, "network_p50": network.0, "target": wanted});
    record("frame_to_command_ms", whole)?;
    record("post_network_us", row(post.0, post.1, 10.0))?;
    record(
        "post_network_cold_us",
        serde_json::json!({"p50": cold.0, "p99": cold.1, "target": {"p50": 10.0, "p99": 25.0}}),
    )?;
    let monitors = serde_json::json!({"p50": monitors.0, "p99": monitors.1, "network_ms_p50": network.0});
    record("monitors_us", monitors)?;
    record("controller_step_us", row(step.0, step.1, 2.0))?;
    record("recorder_core_fraction", serde_json::json!({"value": fraction, "target": 0.05}))?;
    Ok(())
}
