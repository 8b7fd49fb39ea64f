//! Who flies the simulated vehicle: the stand-in, or real firmware by the vehicle's rotors.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use clap::{Args, ValueEnum};
use color_eyre::eyre::{Result, bail, ensure};
use goshawk_autopilot::{Address, Firmware as Kind};
use goshawk_core::{NormalisedThrust, Rot, Time, Vec3};
use goshawk_vehicle::config::Vehicle;

use super::external::External;
use super::local::Local;
use super::mishap::{MishapArgs, Mishaps};
use crate::sense::file::Sensors;
use crate::sense::odometry::Estimator;
use crate::sense::rgbd::mix;
use crate::vehicle::firmware::{ArduPilotJson, Firmware, Process, Px4Hil, Sensed, Strapped};
use crate::vehicle::imu::Imu;
use crate::vehicle::px4::{Px4Config, Px4Udp, VehicleState};
use crate::vehicle::quadrotor::{Quadrotor, STEP_S};
use crate::world::World;

const ESTIMATE_STEPS: u64 = 10;
/// The stand-in's IMU averages over this long, as it is streamed, s.
const STREAMED_PERIOD_S: f64 = 0.008;

/// Which autopilot flies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Which {
    /// The simulator's own imitation of a PX4.
    StandIn,
    /// A PX4 that you have built, over its simulator interface (MAVLink over TCP).
    Px4,
    /// An `ArduPilot` that you have built, over its JSON interface (UDP).
    #[value(name = "ardupilot")]
    ArduPilot,
    /// Firmware that simulates its own vehicle (PX4's SIH): world, camera and truth follow its pose.
    External,
}

/// The autopilot, and what goes wrong with the stand-in.
#[derive(Debug, Args)]
pub(super) struct AutopilotArgs {
    /// Who flies: the stand-in, or firmware that you have built and start beside this (docs/how-to/firmware.md).
    #[arg(long, value_enum, default_value = "stand-in")]
    autopilot: Which,
    /// Where firmware finds the simulator; absent: 127.0.0.1 and the firmware's own port, 4560 (px4) or 9002 (ardupilot).
    #[arg(long, value_name = "ADDRESS:PORT")]
    firmware_at: Option<SocketAddr>,
    /// Start the firmware too: the folder of its source tree or of its build.
    #[arg(long, value_name = "DIR")]
    firmware: Option<PathBuf>,
    /// With --autopilot external: where its MAVLink is met. Not the vehicle's own line: PX4 sends a ground station's to
    /// udpin:127.0.0.1:14550.
    #[arg(long, value_name = "LINK")]
    pose: Option<Address>,
    #[command(flatten)]
    mishaps: MishapArgs,
}

/// Where a vehicle starts, and how it stands there.
#[derive(Clone, Copy)]
pub(super) struct Start {
    pub(super) pos_world: Vec3,
    pub(super) heading_rad: f64,
}

impl AutopilotArgs {
    /// The autopilot of a vehicle, and where it is met, for a person. Waits for an external one until `stop`.
    pub(super) fn open(
        &self,
        vehicle: &Vehicle,
        mavlink_port: Option<u16>,
        sensors: &Sensors,
        seed: u64,
        start: Start,
        stop: &AtomicBool,
    ) -> Result<(Autopilot, String)> {
        let imu = Imu::new(sensors.imu, mix(seed, 15));
        ensure!(
            self.pose.is_some() == (self.autopilot == Which::External),
            "--autopilot external and --pose LINK belong together: it says where the firmware tells its pose"
        );
        if self.autopilot == Which::StandIn {
            ensure!(
                self.firmware_at.is_none() && self.firmware.is_none(),
                "--firmware and --firmware-at are for --autopilot px4 or ardupilot"
            );
            return self.stand_in(vehicle, mavlink_port, sensors, imu, seed);
        }
        ensure!(
            !self.mishaps.any() && mavlink_port.is_none(),
            "--mishap, --attitude-lag, --man-override-spd and --mavlink-port are for the stand-in: real firmware is set by \
             its own parameters"
        );
        if let Some(pose) = &self.pose {
            ensure!(
                self.firmware_at.is_none() && self.firmware.is_none(),
                "--firmware and --firmware-at are for --autopilot px4 or ardupilot"
            );
            let external = External::meet(pose, vehicle, &start.pos_world, start.heading_rad, stop)?;
            return Ok((Autopilot::External(Box::new(external)), format!("pose from {pose}")));
        }
        ensure!(
            self.firmware.is_none() || self.firmware_at.is_none(),
            "--firmware starts it at its own port: leave out --firmware-at"
        );
        let local = |port| self.firmware_at.unwrap_or((Ipv4Addr::LOCALHOST, port).into());
        let (firmware, at): (Box<dyn Firmware>, _) = match (self.autopilot, vehicle.autopilot.firmware()) {
            (Which::Px4, Kind::Px4) => {
                let hil = Px4Hil::listen(local(4560), mix(seed, 16))?;
                let at = format!("PX4 awaited at TCP {}", hil.local_address()?);
                (Box::new(hil), at)
            }
            (Which::ArduPilot, Kind::ArduPilot(_)) => {
                let json = ArduPilotJson::listen(local(9002))?;
                let at = format!("ArduPilot awaited at UDP {}", json.local_address()?);
                (Box::new(json), at)
            }
            (_, other) => bail!(
                "the vehicle file's [autopilot] firmware is {other}: give --vehicle-file the file of the firmware that flies"
            ),
        };
        let process = match (&self.firmware, self.autopilot) {
            (None, _) => None,
            (Some(tree), Which::Px4) => Some(Process::px4(tree, 0)?),
            (Some(tree), _) => Some(Process::ardupilot(tree, 0)?),
        };
        let in_the_loop = InTheLoop {
            firmware,
            process,
            imu: Strapped::new(imu),
            start_world: start.pos_world,
            met: false,
            over: None,
        };
        Ok((Autopilot::Firmware(Box::new(in_the_loop)), at))
    }

    fn stand_in(
        &self,
        vehicle: &Vehicle,
        mavlink_port: Option<u16>,
        sensors: &Sensors,
        imu: Imu,
        seed: u64,
    ) -> Result<(Autopilot, String)> {
        let Address::UdpIn(mut mavlink) = vehicle.autopilot.link else {
            bail!(
                "the simulated PX4 speaks UDP: set autopilot.link to udpin:ADDRESS:PORT, not {}",
                vehicle.autopilot.link
            );
        };
        ensure!(
            vehicle.autopilot.firmware() == Kind::Px4 && vehicle.autopilot.signing_key_file.is_none(),
            "the simulated autopilot is a PX4 without a signing key: change [autopilot] firmware or signing_key_file"
        );
        if let Some(port) = mavlink_port {
            mavlink.set_port(port);
        }
        let config = Px4Config {
            hover_thrust: NormalisedThrust(vehicle.airframe.hover_thrust),
            sticks: self.mishaps.sticks(),
            ..Px4Config::default()
        };
        let stand_in = StandIn {
            px4: Px4Udp::open(config, SocketAddr::new(mavlink.ip(), 0), Some(mavlink))?,
            mishaps: Mishaps::new(&self.mishaps),
            estimator: Estimator::new(sensors.odometry, mix(seed, 11)),
            imu,
            error: Misbelief::default(),
        };
        Ok((Autopilot::StandIn(Box::new(stand_in)), format!("autopilot to UDP {mavlink}")))
    }

    /// What the command line says of the stand-in's inner loops, and of what befalls it.
    pub(super) fn mishaps(&self) -> &MishapArgs {
        &self.mishaps
    }
}

/// Real firmware, and the process where it was started here.
pub(super) struct InTheLoop {
    firmware: Box<dyn Firmware>,
    process: Option<Process>,
    imu: Strapped,
    start_world: Vec3,
    /// It has connected at least once.
    met: bool,
    /// Why there is nobody to wait for; none: it runs, or somebody else starts it.
    over: Option<String>,
}

/// Who flies.
pub(super) enum Autopilot {
    StandIn(Box<StandIn>),
    Firmware(Box<InTheLoop>),
    External(Box<External>),
}

/// One instant of the simulation.
#[derive(Clone, Copy)]
pub(super) struct Instant<'a> {
    pub(super) now: Time,
    /// Since the start, steps of [`STEP_S`].
    pub(super) step: u64,
    pub(super) airborne_since: Option<Time>,
    pub(super) wind_world: Vec3,
    pub(super) world: &'a World,
}

impl Autopilot {
    /// The frame in which it reckons where it is.
    pub(super) fn local(&self) -> Local {
        match self {
            Self::StandIn(_) => Local::world(),
            Self::Firmware(it) => Local::at(it.start_world, 0.0),
            Self::External(external) => external.local(),
        }
    }

    /// Why nobody will ever fly; none: somebody does, or may yet.
    pub(super) fn over(&self) -> Option<&str> {
        if let Self::Firmware(it) = self { it.over.as_deref() } else { None }
    }

    /// Flies `quad` for one step of physics.
    pub(super) fn fly(&mut self, quad: &mut Quadrotor, at: &Instant<'_>) {
        let ground = |x, y| at.world.ground_height(x, y);
        match self {
            Self::StandIn(stand_in) => {
                let output = stand_in.step(quad, at);
                quad.step(STEP_S, output.demand.as_ref(), at.wind_world, ground);
            }
            Self::External(external) => external.place(quad, at.now, at.world),
            Self::Firmware(it) => {
                let InTheLoop { firmware, process, imu, met, over, .. } = it.as_mut();
                let truth = quad.state();
                let sensed = Sensed { truth, imu: imu.measure(truth) };
                let throttles = firmware.step(at.step, &sensed);
                for news in firmware.take_news() {
                    *met = true;
                    super::say(&news);
                }
                if let Some(status) = process.as_mut().and_then(Process::ended) {
                    let words = process.take().map(|process| process.last_words()).unwrap_or_default();
                    let text = format!("the firmware has ended ({status}): {words}");
                    if *met {
                        super::say(&text);
                    } else {
                        *over = Some(text);
                    }
                }
                quad.drive(STEP_S, &throttles, at.wind_world, ground);
            }
        }
    }
}

/// How the state estimate errs.
#[derive(Clone, Copy, Debug, Default)]
struct Misbelief {
    pos_world: Vec3,
    vel_world: Vec3,
    turn_world: Rot,
    jumps: u8,
}

/// The stand-in with its estimator.
pub(super) struct StandIn {
    px4: Px4Udp,
    mishaps: Mishaps,
    estimator: Estimator,
    imu: Imu,
    /// The newest estimate less the truth of its time.
    error: Misbelief,
}

impl StandIn {
    fn step(&mut self, quad: &Quadrotor, at: &Instant<'_>) -> crate::vehicle::px4::Px4Output {
        let truth = quad.state();
        if at.step.is_multiple_of(ESTIMATE_STEPS) {
            let estimate = self.estimator.estimate(at.now, truth);
            self.error = Misbelief {
                pos_world: estimate.pos_world - truth.pos_world,
                vel_world: estimate.vel_world - truth.vel_world,
                turn_world: estimate.world_from_body * truth.world_from_body.inverse(),
                jumps: estimate.reset_counter as u8, // MAVLink counts modulo 256
            };
        }
        self.mishaps.strike(at.now, at.airborne_since, &mut self.px4);
        let sensed = VehicleState {
            pos_world: truth.pos_world + self.error.pos_world,
            vel_world: truth.vel_world + self.error.vel_world,
            world_from_body: self.error.turn_world * truth.world_from_body,
            ang_vel_body: truth.ang_vel_body,
            imu: self.imu.measure(truth, STREAMED_PERIOD_S),
            on_ground: truth.on_ground,
            battery_fraction: quad.battery_fraction(),
            reset_counter: self.error.jumps,
        };
        self.px4.poll(at.now, &sensed)
    }
}
