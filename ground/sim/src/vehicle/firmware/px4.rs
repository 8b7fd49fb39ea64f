//! PX4's simulator interface: we listen, its `simulator_mavlink` dials. HIL_SENSOR, HIL_GPS and HIL_STATE_QUATERNION
//! go out, HIL_ACTUATOR_CONTROLS come in. In lockstep PX4's clock is the stamp of the newest HIL_SENSOR, and physics
//! waits for the rotors that it makes of it.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use goshawk_autopilot::frames::{frd_from_flu, ned_from_enu, ned_from_frd};
use goshawk_autopilot::messages::{
    COMMAND_LONG_DATA, HIL_ACTUATOR_CONTROLS_DATA, HIL_GPS_DATA, HIL_SENSOR_DATA, HIL_STATE_QUATERNION_DATA,
    HilSensorUpdatedFlags as Updated, MavCmd, MavMessage, MavModeFlag,
};
use goshawk_autopilot::wire::encode::Encoder;
use goshawk_autopilot::wire::packet::for_each_frame;
use goshawk_core::{GRAVITY, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::earth::{air, field_world, geodetic};
use super::{Firmware, FirmwareError, Sensed, patience, throttle};
use crate::vehicle::quadrotor::Throttles;

/// PX4's clock at the first step, µs: it takes 0 for no time at all.
const FIRST_US: u64 = 1_000_000;
/// Steps of 1 ms between samples.
const IMU_STEPS: u64 = super::IMU_STEPS as u64;
const MAGNETOMETER_STEPS: u64 = 12;
const BAROMETER_STEPS: u64 = 20;
const GNSS_STEPS: u64 = 100;
/// A fix is this old when it comes: what PX4's own start for this interface tells its estimator (EKF2_GPS_DELAY, since
/// 2026 SENS_GPS0_DELAY).
const GNSS_DELAY_STEPS: u64 = 10;
/// What an accelerometer measures at most, m/s²: 16 g less a margin. Beyond it PX4 takes a push for its contrary.
const RANGE_MPS2: f64 = 150.0;
/// Noise of a sample: gauss, hPa, m and m/s. A receiver with corrections; the estimate then wanders by centimetres.
const MAGNETOMETER_G: f64 = 0.002;
const BAROMETER_HPA: f64 = 0.01;
const GNSS_M: f64 = 0.1;
const GNSS_MPS: f64 = 0.05;
/// HIL_STATE_QUATERNION's number, by which PX4 asks for it.
const STATE_ID: f32 = 115.0;
/// A send that takes longer finds nobody who reads.
const SEND_PATIENCE: Duration = Duration::from_secs(1);

/// The listening end, and PX4 once it has dialled.
pub struct Px4Hil {
    listener: TcpListener,
    encoder: Encoder,
    line: Option<Line>,
    rng: ChaCha8Rng,
    fixes: VecDeque<(u64, HIL_GPS_DATA)>,
    /// What is left of a push beyond the range, m/s²: later samples feel it, as on softer feet.
    owed_frd: Vec3,
    news: Vec<String>,
}

/// One PX4 that has dialled.
struct Line {
    stream: TcpStream,
    held: Vec<u8>,
    throttles: Throttles,
    armed: bool,
    /// Commands have come: from now on physics waits for them.
    answers: bool,
    /// Steps between two HIL_STATE_QUATERNION; none: nobody asked.
    state_steps: Option<u64>,
    /// Its first step: one that starts anew begins its time anew.
    begun: u64,
}

impl Px4Hil {
    /// Listens at `address`; PX4 dials TCP 4560 of its own host unless PX4_SIM_HOSTNAME says otherwise. `seed`: of the
    /// sensors' noise.
    ///
    /// # Errors
    /// The port is in use or cannot be bound.
    pub fn listen(address: SocketAddr, seed: u64) -> Result<Self, FirmwareError> {
        let listener = TcpListener::bind(address).map_err(FirmwareError::of(address))?;
        listener.set_nonblocking(true).map_err(FirmwareError::of(address))?;
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Ok(Self {
            listener,
            encoder: Encoder::new(1, 200),
            line: None,
            rng,
            fixes: VecDeque::new(),
            owed_frd: Vec3::zeros(),
            news: Vec::new(),
        })
    }

    /// Where it listens, with the port that the system chose if the address said 0.
    ///
    /// # Errors
    /// The socket does not say.
    pub fn local_address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    fn accept(&mut self, step: u64) {
        let Ok((stream, from)) = self.listener.accept() else { return };
        let usable = stream.set_nodelay(true).is_ok() && stream.set_write_timeout(Some(SEND_PATIENCE)).is_ok();
        if usable {
            self.news.push(format!("PX4 has connected from {from}"));
            self.fixes.clear();
            self.owed_frd = Vec3::zeros();
            self.line = Some(Line {
                stream,
                held: Vec::new(),
                throttles: [0.0; 4],
                armed: false,
                answers: false,
                state_steps: None,
                begun: step - step % GNSS_STEPS,
            });
        }
    }

    fn noise(&mut self, std: f64) -> Vec3 {
        Vec3::from_fn(|_, _| std * self.rng.sample::<f64, _>(StandardNormal))
    }

    /// What is due at `step`.
    fn messages(&mut self, step: u64, sensed: &Sensed<'_>, state_steps: Option<u64>) -> Vec<MavMessage> {
        let mut out = Vec::new();
        if step.is_multiple_of(GNSS_STEPS) {
            let fix = self.fix(step, sensed);
            self.fixes.push_back((step + GNSS_DELAY_STEPS, fix));
        }
        if let Some((_, fix)) = self.fixes.pop_front_if(|(due, _)| *due <= step) {
            out.push(MavMessage::HIL_GPS(HIL_GPS_DATA { time_usec: stamp(step), ..fix }));
        }
        if state_steps.is_some_and(|every| step.is_multiple_of(every)) {
            out.push(MavMessage::HIL_STATE_QUATERNION(state(step, sensed)));
        }
        // The sample comes last: it moves PX4's clock on, and PX4 then has what else belongs to this instant.
        out.push(MavMessage::HIL_SENSOR(self.sample(step, sensed)));
        out
    }

    fn sample(&mut self, step: u64, sensed: &Sensed<'_>) -> HIL_SENSOR_DATA {
        let pushed = frd_from_flu(sensed.imu.force_body) + self.owed_frd;
        let force = pushed.map(|axis| axis.clamp(-RANGE_MPS2, RANGE_MPS2));
        self.owed_frd = pushed - force;
        let rate = frd_from_flu(sensed.imu.ang_vel_body);
        let field_body = sensed.truth.world_from_body.inverse_transform_vector(&field_world());
        let field = frd_from_flu(field_body) + self.noise(MAGNETOMETER_G);
        let altitude = geodetic(sensed.truth.pos_world).2;
        let (pressure, temperature) = air(altitude);
        let mut updated = Updated::HIL_SENSOR_UPDATED_XACC
            | Updated::HIL_SENSOR_UPDATED_YACC
            | Updated::HIL_SENSOR_UPDATED_ZACC
            | Updated::HIL_SENSOR_UPDATED_XGYRO
            | Updated::HIL_SENSOR_UPDATED_YGYRO
            | Updated::HIL_SENSOR_UPDATED_ZGYRO;
        if step.is_multiple_of(MAGNETOMETER_STEPS) {
            updated |=
                Updated::HIL_SENSOR_UPDATED_XMAG | Updated::HIL_SENSOR_UPDATED_YMAG | Updated::HIL_SENSOR_UPDATED_ZMAG;
        }
        if step.is_multiple_of(BAROMETER_STEPS) {
            updated |= Updated::HIL_SENSOR_UPDATED_ABS_PRESSURE
                | Updated::HIL_SENSOR_UPDATED_PRESSURE_ALT
                | Updated::HIL_SENSOR_UPDATED_TEMPERATURE;
        }
        HIL_SENSOR_DATA {
            time_usec: stamp(step),
            xacc: force.x as f32,
            yacc: force.y as f32,
            zacc: force.z as f32,
            xgyro: rate.x as f32,
            ygyro: rate.y as f32,
            zgyro: rate.z as f32,
            xmag: field.x as f32,
            ymag: field.y as f32,
            zmag: field.z as f32,
            abs_pressure: (pressure + self.noise(BAROMETER_HPA).x) as f32,
            diff_pressure: 0.0,
            pressure_alt: altitude as f32,
            temperature: temperature as f32,
            fields_updated: updated,
            id: 0,
        }
    }

    fn fix(&mut self, step: u64, sensed: &Sensed<'_>) -> HIL_GPS_DATA {
        let pos_world = sensed.truth.pos_world + self.noise(GNSS_M);
        let vel = ned_from_enu(sensed.truth.vel_world + self.noise(GNSS_MPS));
        let (latitude, longitude, altitude) = geodetic(pos_world);
        let ground_speed = vel.x.hypot(vel.y);
        HIL_GPS_DATA {
            time_usec: stamp(step),
            lat: (latitude * 1e7) as i32,
            lon: (longitude * 1e7) as i32,
            alt: (altitude * 1e3) as i32,
            eph: 30,
            epv: 40,
            vel: (ground_speed * 100.0) as u16,
            vn: (vel.x * 100.0) as i16,
            ve: (vel.y * 100.0) as i16,
            vd: (vel.z * 100.0) as i16,
            cog: (vel.y.atan2(vel.x).to_degrees().rem_euclid(360.0) * 100.0) as u16,
            fix_type: 3,
            satellites_visible: 16,
            id: 0,
            yaw: 0, // not measured
        }
    }
}

impl Firmware for Px4Hil {
    fn step(&mut self, step: u64, sensed: &Sensed<'_>) -> Throttles {
        if self.line.is_none() {
            self.accept(step);
        }
        let Some(mut line) = self.line.take() else { return [0.0; 4] };
        if step.is_multiple_of(IMU_STEPS) {
            let messages = self.messages(step - line.begun, sensed, line.state_steps);
            let frames: Vec<u8> = messages.iter().flat_map(|m| self.encoder.encode(m).raw_bytes().to_vec()).collect();
            if let Err(gone) = line.exchange(&frames, &mut self.news) {
                self.news.push(format!("PX4 has gone ({gone}): the rotors stand, and the next one may connect"));
                return [0.0; 4];
            }
        }
        let throttles = line.throttles;
        self.line = Some(line);
        throttles
    }

    fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }
}

impl Line {
    /// Sends a sample with what goes with it, and waits for the rotors that PX4 makes of it.
    fn exchange(&mut self, frames: &[u8], news: &mut Vec<String>) -> std::io::Result<()> {
        // What came unasked is older than this sample.
        self.stream.set_nonblocking(true)?;
        while self.receive(news)?.is_some() {}
        self.stream.set_nonblocking(false)?;
        self.stream.write_all(frames)?;
        if !self.answers {
            return Ok(());
        }
        let deadline = Instant::now() + patience(&self.throttles);
        while let Some(left) = deadline.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
            self.stream.set_read_timeout(Some(left))?;
            if self.receive(news)? == Some(true) {
                return Ok(());
            }
        }
        if self.throttles != [0.0; 4] {
            self.throttles = [0.0; 4];
            news.push("PX4 is silent: the rotors stand until it speaks".to_owned());
        }
        Ok(())
    }

    /// Reads once. None: nothing was there; else whether rotor commands were among it.
    fn receive(&mut self, news: &mut Vec<String>) -> std::io::Result<Option<bool>> {
        let mut buffer = [0_u8; 2048];
        let length = match self.stream.read(&mut buffer) {
            Ok(0) => return Err(ErrorKind::ConnectionReset.into()),
            Ok(length) => length,
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {
                return Ok(None);
            }
            Err(e) => return Err(e),
        };
        self.held.extend_from_slice(&buffer[..length]);
        let mut messages = Vec::new();
        let used = for_each_frame(&self.held, false, |frame| {
            messages.extend(frame.map(|(packet, _)| packet.message));
        });
        self.held.drain(..used);
        let mut commands = false;
        for message in &messages {
            match message {
                MavMessage::HIL_ACTUATOR_CONTROLS(controls) => {
                    self.take_controls(controls, news);
                    commands = true;
                }
                MavMessage::COMMAND_LONG(command) => self.take_command(command),
                _ => {}
            }
        }
        Ok(Some(commands))
    }

    fn take_controls(&mut self, controls: &HIL_ACTUATOR_CONTROLS_DATA, news: &mut Vec<String>) {
        let armed = controls.mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        if armed != self.armed {
            self.armed = armed;
            news.push(format!("PX4 has {}", if armed { "armed" } else { "disarmed" }));
        }
        self.answers = true;
        self.throttles = std::array::from_fn(|i| if armed { throttle(f64::from(controls.controls[i])) } else { 0.0 });
    }

    fn take_command(&mut self, command: &COMMAND_LONG_DATA) {
        if command.command != MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL || command.param1 != STATE_ID {
            return;
        }
        // 0 is our own rate, -1 is never; a sample's worth is the least there is.
        let steps = f64::from(command.param2) * 1e-3;
        self.state_steps = (steps >= 0.0).then(|| (steps as u64).next_multiple_of(IMU_STEPS).max(IMU_STEPS));
    }
}

/// PX4's clock at a step, µs.
fn stamp(step: u64) -> u64 {
    FIRST_US + step * 1000
}

/// The truth, for PX4's own log.
fn state(step: u64, sensed: &Sensed<'_>) -> HIL_STATE_QUATERNION_DATA {
    let truth = sensed.truth;
    let attitude = ned_from_frd(&truth.world_from_body);
    let rate = frd_from_flu(truth.ang_vel_body);
    let vel = ned_from_enu(truth.vel_world);
    let force = frd_from_flu(sensed.imu.force_body) * (1000.0 / GRAVITY);
    let (latitude, longitude, altitude) = geodetic(truth.pos_world);
    HIL_STATE_QUATERNION_DATA {
        time_usec: stamp(step),
        attitude_quaternion: [attitude.w as f32, attitude.i as f32, attitude.j as f32, attitude.k as f32],
        rollspeed: rate.x as f32,
        pitchspeed: rate.y as f32,
        yawspeed: rate.z as f32,
        lat: (latitude * 1e7) as i32,
        lon: (longitude * 1e7) as i32,
        alt: (altitude * 1e3) as i32,
        vx: (vel.x * 100.0) as i16,
        vy: (vel.y * 100.0) as i16,
        vz: (vel.z * 100.0) as i16,
        ind_airspeed: 0,
        true_airspeed: (truth.vel_world.norm() * 100.0) as u16,
        xacc: force.x as i16,
        yacc: force.y as i16,
        zacc: force.z as i16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::imu::ImuSample;
    use crate::vehicle::quadrotor::{Quadrotor, QuadrotorParameters};
    use std::path::Path;

    #[test]
    fn what_a_real_px4_sent_is_read_to_the_last_message() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/px4-hil.bin");
        let recorded = std::fs::read(file).unwrap();
        let (mut frames, mut unread) = (Vec::new(), 0);
        for_each_frame(&recorded, true, |frame| match frame {
            Ok((_, bytes)) => frames.push(bytes.to_vec()),
            Err(_) => unread += 1,
        });
        assert_eq!((frames.len(), unread), (550, 0));

        let mut hil = Px4Hil::listen((std::net::Ipv4Addr::LOCALHOST, 0).into(), 1).unwrap();
        let mut px4 = TcpStream::connect(hil.local_address().unwrap()).unwrap();
        px4.set_nodelay(true).unwrap();
        let answering = std::thread::spawn(move || {
            let mut sample = [0; 1024];
            for frame in frames {
                assert_ne!(px4.read(&mut sample).unwrap(), 0);
                px4.write_all(&frame).unwrap();
            }
            px4
        });
        let quad = Quadrotor::new(QuadrotorParameters::default(), Vec3::zeros(), 0.0);
        let sensed = Sensed { truth: quad.state(), imu: ImuSample::ideal(quad.state()) };
        let (mut flown, mut news) = (Vec::new(), Vec::new());
        // The first samples are not waited for, so that there may be more of them than answers.
        for step in 0.. {
            if answering.is_finished() {
                break;
            }
            flown.push(hil.step(step * IMU_STEPS, &sensed));
            news.extend(hil.take_news());
        }
        answering.join().unwrap();
        assert!(flown[..20].iter().all(|throttles| *throttles == [0.0; 4]), "disarmed");
        assert!(flown.iter().flatten().all(|throttle| (0.0..=1.0).contains(throttle)));
        let hover = flown.iter().filter(|throttles| throttles.iter().all(|t| (0.15..0.7).contains(t))).count();
        assert!(hover > 100, "{hover} of {}", flown.len());
        assert!(news.iter().any(|line| line == "PX4 has armed"), "{news:?}");
        assert!(hil.line.unwrap().state_steps.is_some(), "it asked for the truth");
    }

    /// The samples that one PX4 hears from a step on, and whatever else came with them.
    fn heard(hil: &mut Px4Hil, steps: std::ops::Range<u64>, sensed: &Sensed<'_>) -> Vec<MavMessage> {
        let mut px4 = TcpStream::connect(hil.local_address().unwrap()).unwrap();
        let (mut bytes, mut messages) = (Vec::new(), Vec::new());
        for step in steps.step_by(IMU_STEPS as usize) {
            hil.step(step, sensed);
        }
        hil.line = None; // so that the stream ends
        px4.read_to_end(&mut bytes).unwrap();
        for_each_frame(&bytes, false, |frame| messages.extend(frame.map(|(packet, _)| packet.message)));
        messages
    }

    fn samples(messages: &[MavMessage]) -> Vec<&HIL_SENSOR_DATA> {
        let sensed = messages.iter().map(|message| match message {
            MavMessage::HIL_SENSOR(sample) => Some(sample),
            _ => None,
        });
        sensed.flatten().collect()
    }

    #[test]
    fn a_px4_that_starts_again_begins_its_time_again_and_a_fix_is_as_old_as_it_believes() {
        let mut hil = Px4Hil::listen((std::net::Ipv4Addr::LOCALHOST, 0).into(), 1).unwrap();
        let quad = Quadrotor::new(QuadrotorParameters::default(), Vec3::zeros(), 0.0);
        let sensed = Sensed { truth: quad.state(), imu: ImuSample::ideal(quad.state()) };
        for begun in [0, 10_000, 34_567 * IMU_STEPS] {
            let messages = heard(&mut hil, begun..begun + 400, &sensed);
            let (first, mut fixes) = (samples(&messages)[0].time_usec, 0);
            assert!((FIRST_US..FIRST_US + 100_000).contains(&first), "{first} after {begun} steps");
            for pair in messages.windows(2) {
                if let [MavMessage::HIL_GPS(fix), MavMessage::HIL_SENSOR(sample)] = pair {
                    assert_eq!(fix.time_usec, sample.time_usec);
                    let late_us = (fix.time_usec - FIRST_US) % (GNSS_STEPS * 1000);
                    assert!((10_000..10_000 + IMU_STEPS * 1000).contains(&late_us), "{late_us}");
                    fixes += 1;
                }
            }
            assert!(fixes >= 3, "{fixes} of {}", messages.len());
        }
    }

    #[test]
    fn a_push_beyond_the_accelerometers_range_is_felt_whole_in_samples_within_it() {
        let mut hil = Px4Hil::listen((std::net::Ipv4Addr::LOCALHOST, 0).into(), 1).unwrap();
        let quad = Quadrotor::new(QuadrotorParameters::default(), Vec3::zeros(), 0.0);
        let push = ImuSample { force_body: Vec3::new(0.0, -200.0, 400.0), ..ImuSample::ideal(quad.state()) };
        let still = ImuSample { force_body: Vec3::zeros(), ..push };
        let mut felt = Vec3::zeros();
        for (step, imu) in [push, still, still, still].into_iter().enumerate() {
            let sample = hil.sample(step as u64 * IMU_STEPS, &Sensed { truth: quad.state(), imu });
            let force = Vec3::new(sample.xacc.into(), sample.yacc.into(), sample.zacc.into());
            assert!(force.amax() <= RANGE_MPS2, "{force}");
            felt += force;
        }
        assert!((felt - frd_from_flu(push.force_body)).norm() < 1e-3, "{felt}");
    }
}
