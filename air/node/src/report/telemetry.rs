//! One thread that turns reports into telemetry, log records and health. It alone encodes, publishes and records, so
//! that planner and controller never wait for a network or a disk.

use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use goshawk_autopilot::{AutopilotLink, Outcome};
use goshawk_bus::{Bus, BusError, Publisher};
use goshawk_core::{ControllerOutput, Imu, Mode, Odometry, OdometryFault, Time};
use goshawk_proto::keys::{Key, PROTOCOL};
use goshawk_proto::v1;
use goshawk_recorder::Channel;
use goshawk_vehicle::config::{OdometrySource, Switch};
use goshawk_vehicle::sensors::Frame;
use goshawk_vehicle::{clock, convert, inputs, switch};

use crate::flight::shared::{PlanFailed, Planned, REPORT_QUEUE, Report, Shared, Started, lock};
use crate::network::access::INSECURE;
use crate::network::memory::Memory;
use crate::network::visitors::Visitors;
use crate::report::flightlog::FlightLog;
use crate::report::health::{self, Facts};
use crate::report::preview::Preview;

/// Reports are looked for so often; what one look finds leaves together, which is most of what sending costs. Waiting
/// for them instead would make whoever reports wake this thread, under a lock.
const POLL: Duration = Duration::from_millis(20);
/// `tel/control` so often, s: 50 Hz.
const CONTROL_PERIOD_S: f64 = 0.02;
/// Readiness is judged so often, s.
const CHECK_PERIOD_S: f64 = 0.1;
/// `tel/health` so often, s.
const HEALTH_PERIOD_S: f64 = 0.5;
/// After a recording failed, the disk is tried again so often, s. Chosen by eye.
const ROOM_PERIOD_S: f64 = 2.0;

/// What never changes in `health`.
pub struct Identity {
    /// The vehicle's name.
    pub vehicle: String,
    /// The default profile first.
    pub profiles: Vec<String>,
    /// Of the policy file.
    pub policy_sha256: String,
    /// Why the policy did not answer its golden images as it should; none: it did.
    pub warm_up_failed: Option<String>,
    /// The vehicle file's `limits.battery_start`.
    pub battery_start: f64,
    /// Whose odometry is flown by.
    pub source: OdometrySource,
    /// The pilot's switch, where there is one.
    pub switch: Option<Switch>,
    /// Whether the frames were checked as mounted; none: the vehicle file asks for no check.
    pub mounting: Option<Result<(), String>>,
    /// Whoever connects may fly the vehicle.
    pub insecure: bool,
    /// What is amiss as long as the process runs, by what it concerns: told at its start and in each flight's log.
    pub warnings: [(&'static str, Option<String>); 2],
}

struct Publishers {
    plan: Publisher,
    map: Publisher,
    control: Publisher,
    target: Publisher,
    health: Publisher,
    event: Publisher,
}

#[derive(Default)]
struct Sequences {
    control: u64,
    target: u64,
    health: u64,
    odometry: u64,
}

/// The thread's state.
pub struct Telemetry {
    publishers: Publishers,
    preview: Preview,
    link: Arc<AutopilotLink>,
    log: FlightLog,
    visitors: Visitors,
    /// For whoever was away.
    memory: Arc<Mutex<Memory>>,
    identity: Identity,
    facts: Facts,
    sequences: Sequences,
    /// The flight that the log is of, as [`Shared::flight`].
    flight: u64,
    profile: String,
    checks: Vec<v1::Check>,
    /// Of the autopilot, as far as they have been told.
    restarts: u64,
    /// The autopilot does not stand by the position that is flown by.
    position_lost: bool,
    last_imu: Option<Time>,
    last_control: Time,
    last_check: Time,
    last_health: Time,
    last_room: Time,
}

impl Telemetry {
    /// Declares the publishers.
    ///
    /// # Errors
    /// Zenoh refused a declaration.
    pub fn new(
        bus: &Bus,
        link: Arc<AutopilotLink>,
        log: FlightLog,
        visitors: Visitors,
        identity: Identity,
        memory: Arc<Mutex<Memory>>,
    ) -> Result<Self, BusError> {
        if identity.insecure {
            visitors.note(v1::Severity::Warning, "", INSECURE, clock::now());
        }
        Ok(Telemetry {
            publishers: Publishers {
                plan: bus.publisher(Key::Plan)?,
                map: bus.publisher(Key::Map)?,
                control: bus.publisher(Key::Control)?,
                target: bus.publisher(Key::Target)?,
                health: bus.publisher(Key::Health)?,
                event: bus.publisher(Key::Event)?,
            },
            preview: Preview::new(bus)?,
            link,
            log,
            visitors,
            memory,
            profile: identity.profiles.first().cloned().unwrap_or_default(),
            facts: Facts {
                warm_up_failed: identity.warm_up_failed.clone(),
                source: identity.source,
                mounting: identity.mounting.clone(),
                recorder_failed: Some("the log folder is being tried".to_owned()),
                ..Facts::default()
            },
            identity,
            sequences: Sequences::default(),
            flight: 0,
            checks: Vec::new(),
            restarts: 0,
            position_lost: false,
            last_imu: None,
            last_control: Time(0),
            last_check: Time(0),
            last_health: Time(0),
            last_room: Time(0),
        })
    }

    /// Works until the process stops, then finishes the log.
    pub fn run(mut self, reports: &Receiver<Report>, shared: &Shared) {
        self.tell_warnings();
        loop {
            let stopping = shared.stopping();
            // No more than may wait: who cannot keep up must still say how the vehicle is.
            for report in reports.try_iter().take(REPORT_QUEUE) {
                self.take(report);
            }
            if stopping {
                break;
            }
            self.periodic(shared, clock::now());
            std::thread::sleep(POLL);
        }
        self.log.close();
    }

    fn take(&mut self, report: Report) {
        match report {
            Report::Frame(frame) => self.take_frame(&frame),
            Report::Plan(planned) => self.take_plan(&planned),
            Report::Map(map) => {
                self.publishers.map.put(&map);
                self.log.record(Key::Map, Time(map.stamp_ns), map);
            }
            Report::PlanFailed(failed) => self.take_failed(*failed),
            Report::Odometry(odometry) => {
                self.facts.odometry = Some(odometry.stamp);
                self.facts.odometry_rate.tick();
                self.record_odometry(&odometry);
            }
            Report::Control { seq, stamp, input, output, started, step_s, late_s } => {
                self.facts.controller_rate.tick();
                self.facts.controller_step.push(step_s);
                self.facts.controller_late.push(late_s);
                if let Some(started) = started {
                    self.begin_flight(&started, input.odometry.as_ref());
                }
                self.record_imu(input.imu.as_ref());
                self.log.record_on(Channel::CONTROLLER_INPUT, stamp, inputs::controller_input(&input, seq, stamp));
                self.take_control(seq, stamp, &output, input.odometry.as_ref());
            }
            Report::Command(record) => self.take_command(record),
            Report::Event(severity, kind, text) => self.event(severity, kind, text),
        }
    }

    /// Opens the log; what the flight's first step saw comes first.
    fn begin_flight(&mut self, started: &Started, odometry: Option<&Odometry>) {
        self.flight = started.flight;
        self.last_imu = None;
        started.profile.as_ref().clone_into(&mut self.profile);
        self.facts.recorder_failed = self.log.open(&started.profile).err();
        self.tell_warnings();
        if let Some(odometry) = odometry {
            self.record_odometry(odometry);
        }
    }

    /// Each flight's log says what was amiss all the while, such as that others could have posed as the autopilot.
    fn tell_warnings(&mut self) {
        for (kind, why) in self.identity.warnings.clone() {
            if let Some(why) = why {
                self.event(v1::Severity::Warning, kind, why);
            }
        }
    }

    fn record_odometry(&mut self, odometry: &Odometry) {
        let message = convert::odometry(self.sequences.odometry, odometry);
        self.sequences.odometry += 1;
        self.log.record_on(Channel::ODOMETRY, odometry.stamp, message);
    }

    /// A sample is recorded with the first step that sees it.
    fn record_imu(&mut self, imu: Option<&Imu>) {
        if let Some(new) = imu.filter(|imu| self.last_imu != Some(imu.stamp)) {
            self.last_imu = Some(new.stamp);
            self.log.record_on(Channel::IMU, new.stamp, inputs::imu(new));
        }
    }

    fn take_plan(&mut self, planned: &Planned) {
        let Planned { plan, record, ready, inference_s, fault } = planned;
        self.facts.answer_fault = *fault;
        self.facts.plan = Some(*ready);
        self.facts.plan_failed = None;
        self.facts.planner_rate.tick();
        self.facts.frame_to_plan.push(ready.since(plan.stamp));
        self.facts.inference.push(*inference_s);
        // A plan that was in the making when the flight began is of the time before.
        let of_flight = record.frame.flight == self.flight;
        if of_flight {
            self.log.record_on(Channel::PLANNER_INPUT, *ready, inputs::planner_input(record));
        }
        let message = convert::plan(plan, *ready);
        self.publishers.plan.put(&message);
        if of_flight {
            self.log.record(Key::Plan, *ready, message);
        }
        if let Some(message) = convert::target(self.sequences.target, plan) {
            self.sequences.target += 1;
            self.publishers.target.put(&message);
            lock(&self.memory).target(&message);
            if of_flight {
                self.log.record(Key::Target, *ready, message);
            }
        }
    }

    /// The planner remembers what it saw, so that a replay needs it, too.
    fn take_failed(&mut self, failed: PlanFailed) {
        if let Some(record) = failed.seen.filter(|record| record.frame.flight == self.flight) {
            let input = v1::PlannerInput { prediction: Vec::new(), ..inputs::planner_input(&record) };
            self.log.record_on(Channel::PLANNER_INPUT, clock::now(), input);
        }
        self.facts.plan_failed = Some(failed.why);
    }

    fn take_frame(&mut self, frame: &Arc<Frame>) {
        self.facts.frame = Some(frame.stamp);
        self.facts.camera_fault = frame.fault;
        self.facts.camera_rate.tick();
        self.log.record_frame(frame);
        self.preview.show(frame, clock::now());
    }

    fn take_control(&mut self, seq: u64, stamp: Time, output: &ControllerOutput, odometry: Option<&Odometry>) {
        let message = convert::control(seq, stamp, output, odometry);
        // Before the first odometry there is nothing to show: health says what is missing.
        if odometry.is_some() && stamp.since(self.last_control) >= CONTROL_PERIOD_S {
            self.last_control = stamp;
            // On the wire the sequence counts what was sent, so that the ground can count what was lost.
            let sent = v1::Control { seq: self.sequences.control, ..message };
            self.publishers.control.put(&sent);
            lock(&self.memory).control(&sent);
            self.sequences.control += 1;
        }
        self.log.record(Key::Control, stamp, message);
        self.take_odometry_fault(output.odometry_fault);
        if let Some(t) = output.transition {
            self.event(v1::Severity::Info, "mode", format!("{:?} → {:?}: {}", t.from, t.to, t.cause));
        }
        if output.transition.is_some() && matches!(output.mode, Mode::Landed | Mode::Idle | Mode::Ready) {
            self.log.finish_soon(stamp);
        }
    }

    /// Says what is false about the odometry when it shows, and when it is over.
    fn take_odometry_fault(&mut self, fault: Option<OdometryFault>) {
        let before = std::mem::replace(&mut self.facts.odometry_fault, fault);
        match (before, fault) {
            (before, Some(fault)) if before != Some(fault) => {
                self.event(v1::Severity::Warning, "odometry", fault.to_string());
            }
            (Some(before), None) if !before.is_passing() => {
                self.event(v1::Severity::Info, "odometry", "no contradiction any more".to_owned());
            }
            _ => {}
        }
    }

    fn take_command(&mut self, record: v1::CommandRecord) {
        let accepted = record.reply.as_ref().is_some_and(|reply| reply.accepted);
        let reply = record.reply.as_ref().map_or(String::new(), |reply| reply.reason.clone());
        let text = format!("{} {}: {reply}", record.verb, if accepted { "accepted" } else { "refused" });
        self.log.record_on(Channel::COMMAND, Time(record.stamp_ns), record);
        self.event(v1::Severity::Info, "command", text);
    }

    fn event(&mut self, severity: v1::Severity, kind: &str, text: String) {
        match severity {
            v1::Severity::Warning => tracing::warn!("{kind}: {text}"),
            v1::Severity::Error => tracing::error!("{kind}: {text}"),
            _ => tracing::info!("{kind}: {text}"),
        }
        let stamp = clock::now();
        let (severity, kind) = (severity.into(), kind.to_owned());
        let message = lock(&self.memory).event(v1::Event { stamp_ns: stamp.0, severity, kind, text, seq: 0 });
        self.publishers.event.put(&message);
        self.log.record(Key::Event, stamp, message);
    }

    fn periodic(&mut self, shared: &Shared, now: Time) {
        if now.since(self.last_check) >= CHECK_PERIOD_S {
            self.last_check = now;
            self.check(shared, now);
        }
        if now.since(self.last_health) >= HEALTH_PERIOD_S {
            self.last_health = now;
            self.publish_health(shared, now);
        }
    }

    fn check(&mut self, shared: &Shared, now: Time) {
        if let Some(why) = self.log.poll(now) {
            self.event(v1::Severity::Error, "recorder", format!("recording stopped: {why}; the flight goes on"));
            self.facts.recorder_failed = Some(why);
        }
        if let Some(why) = self.log.hangs(now) {
            self.event(v1::Severity::Error, "recorder", why.clone());
            self.facts.recorder_failed = Some(why);
        }
        self.try_the_disk_again(now);
        for ack in self.link.take_acks() {
            let good = ack.outcome == Outcome::Accepted;
            let severity = if good { v1::Severity::Info } else { v1::Severity::Warning };
            self.event(severity, "autopilot", format!("{}: {}", ack.command, ack.outcome));
        }
        for (_, event) in self.link.take_events() {
            if let Some(words) = event.words() {
                let severity = if event.is_trouble() { v1::Severity::Warning } else { v1::Severity::Info };
                self.event(severity, "autopilot", words.to_owned());
            }
        }
        for event in self.link.take_peer_events() {
            let severity = if event.is_through_the_peer() { v1::Severity::Info } else { v1::Severity::Warning };
            self.event(severity, "mavlink", event.to_string());
        }
        for text in self.link.take_texts() {
            self.event(v1::Severity::Info, "autopilot", text.text);
        }
        for (severity, text) in self.visitors.take(now) {
            self.event(severity, "network", text);
        }
        self.facts.line = self.link.line_problem();
        if let Some(switch) = &self.identity.switch {
            let problem = switch::problem(now, switch, self.link.radio().as_ref());
            self.facts.switch = Some(problem.map_or(Ok(()), Err));
        }
        self.facts.refusal = self.link.refusal(now);
        let mode = shared.mode();
        self.facts.waits = matches!(mode, v1::Mode::Idle | v1::Mode::Ready);
        let refused = (shared.refused_frames.total(), shared.refused_odometry.total());
        let (status, battery_start) = (self.link.status(now), self.identity.battery_start);
        if status.counters.restarts > self.restarts {
            self.restarts = status.counters.restarts;
            let text = "it has started again: nothing that it was asked before is asked again";
            self.event(v1::Severity::Error, "autopilot", text.to_owned());
        }
        let checks = health::checks(&self.facts, &status, refused, battery_start, now);
        let position = health::position_problem(self.facts.source, &status);
        let newly_lost = position.as_ref().filter(|_| !self.position_lost);
        for check in &checks {
            let before = self.checks.iter().find(|c| c.name == check.name).map(|c| c.ok);
            match (before, check.ok) {
                (Some(true), false) => {
                    self.event(v1::Severity::Warning, "readiness", format!("{}: {}", check.name, check.reason));
                }
                (Some(false), true) => self.event(v1::Severity::Info, "readiness", format!("{}: good", check.name)),
                // Odometry was doubted already; that the autopilot now says so itself is news.
                (Some(false), false) if check.name == "odometry" => {
                    if let Some(why) = newly_lost {
                        self.event(v1::Severity::Warning, "readiness", format!("odometry: {why}"));
                    }
                }
                _ => {}
            }
        }
        self.position_lost = position.is_some();
        shared.ready.judge(health::first_problem(&checks), clock::now());
        self.checks = checks;
    }

    /// A failed recording keeps the vehicle from starting only as long as the disk takes nothing.
    fn try_the_disk_again(&mut self, now: Time) {
        let due = now.since(self.last_room) >= ROOM_PERIOD_S;
        if self.facts.recorder_failed.is_none() || self.log.under_way() || !due {
            return;
        }
        if let Some(told) = self.log.has_room() {
            self.last_room = now;
            self.facts.recorder_failed = told.err();
        }
    }

    fn publish_health(&mut self, shared: &Shared, now: Time) {
        let status = self.link.status(now);
        let (session, events) = {
            let memory = lock(&self.memory);
            (memory.session(), memory.told())
        };
        let drops = |name: &str, count: u64| v1::Drops { name: name.to_owned(), count };
        let message = v1::Health {
            seq: self.sequences.health,
            stamp_ns: now.0,
            mode: shared.mode.load(Ordering::Relaxed),
            ready: self.checks.iter().all(|check| check.ok),
            faults: self.faults(),
            checks: self.checks.clone(),
            rates: health::rates(&mut self.facts, now),
            latencies: health::latencies(&mut self.facts),
            drops: vec![
                drops("frames_skipped", shared.skipped_frames.load(Ordering::Relaxed)),
                drops("frames_refused", shared.refused_frames.total()),
                drops("odometry_refused", shared.refused_odometry.total()),
                drops("reports_dropped", shared.dropped_reports.load(Ordering::Relaxed)),
                drops("log_dropped", self.log.dropped()),
                drops("mavlink_lost", status.counters.lost),
            ],
            vehicle: self.identity.vehicle.clone(),
            profile: self.profile.clone(),
            policy_sha256: self.identity.policy_sha256.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            battery_fraction: status.battery_fraction,
            log_path: self.log.path(),
            autopilot: status.mode.map_or_else(|| "not heard".to_owned(), |mode| mode.to_string()),
            profiles: self.identity.profiles.clone(),
            protocol: PROTOCOL,
            session,
            events,
            stops: shared.stops.load(Ordering::Relaxed),
        };
        self.sequences.health += 1;
        self.publishers.health.put(&message);
        lock(&self.memory).health(&message);
        self.log.record(Key::Health, now, message);
    }

    fn faults(&self) -> Vec<String> {
        let failing = self.checks.iter().filter(|c| !c.ok).map(|c| format!("{}: {}", c.name, c.reason));
        let insecure = self.identity.insecure.then(|| format!("network: {INSECURE}"));
        let told = |(kind, why): &(&str, Option<String>)| why.as_ref().map(|why| format!("{kind}: {why}"));
        let warned = self.identity.warnings.iter().filter_map(told);
        failing.chain(insecure).chain(warned).collect()
    }
}
