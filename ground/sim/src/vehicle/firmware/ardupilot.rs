//! ArduPilot's JSON interface: its simulation sends the servos' pulses over UDP, we answer each packet with the motion
//! after the time step that the packet asks for, as a line of JSON. ArduPilot simulates the sensors itself and waits
//! for each answer.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use goshawk_autopilot::frames::{frd_from_flu, ned_from_enu, ned_from_frd};
use goshawk_core::Vec3;
use serde::Serialize;

use super::{Firmware, FirmwareError, Sensed, patience, throttle};
use crate::vehicle::quadrotor::Throttles;

/// The first two bytes of a packet of 16 servos, and of 32.
const MAGIC_16: u16 = 18_458;
const MAGIC_32: u16 = 29_569;
const HEADER: usize = 8;
/// The longest step that a packet may ask for, ms.
const MOST_STEPS: u64 = 20;

/// The motors' pulses of one time step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Servos {
    /// Steps of 1 ms until the answer.
    steps: u64,
    frame: u32,
    throttles: Throttles,
}

/// What ArduPilot reads; the names are the interface's own.
#[derive(Serialize)]
struct Answer {
    /// Physics' time, s.
    timestamp: f64,
    imu: Inertial,
    /// From where the vehicle began, north-east-down, m.
    position: [f64; 3],
    /// Roll, pitch and yaw, rad, for versions that read no quaternion.
    attitude: [f64; 3],
    /// (w, x, y, z), NED from FRD.
    quaternion: [f64; 4],
    /// North-east-down, m/s.
    velocity: [f64; 3],
}

#[derive(Serialize)]
struct Inertial {
    /// rad/s, FRD.
    gyro: [f64; 3],
    /// Specific force, m/s², FRD.
    accel_body: [f64; 3],
}

/// The listening end, and ArduPilot once it has sent.
pub struct ArduPilotJson {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    servos: Option<Servos>,
    /// Steps left of the packet that is being flown.
    left: u64,
    silent: bool,
    origin_world: Option<Vec3>,
    news: Vec<String>,
}

impl ArduPilotJson {
    /// Listens at `address`; ArduPilot sends to UDP 9002 of the host that `--model JSON:HOST` names.
    ///
    /// # Errors
    /// The port is in use or cannot be bound.
    pub fn listen(address: SocketAddr) -> Result<Self, FirmwareError> {
        let socket = UdpSocket::bind(address).map_err(FirmwareError::of(address))?;
        Ok(Self { socket, peer: None, servos: None, left: 0, silent: false, origin_world: None, news: Vec::new() })
    }

    /// Where it listens, with the port that the system chose if the address said 0.
    ///
    /// # Errors
    /// The socket does not say.
    pub fn local_address(&self) -> std::io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    fn throttles(&self) -> Throttles {
        self.servos.map_or([0.0; 4], |servos| servos.throttles)
    }

    /// The next packet; none: it has not come in time.
    fn receive(&mut self) -> Option<Servos> {
        let wait = self.servos.filter(|_| !self.silent).map_or(Duration::ZERO, |servos| patience(&servos.throttles));
        let deadline = Instant::now() + wait;
        let mut buffer = [0_u8; 256];
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let waits = !left.is_zero();
            if self.socket.set_nonblocking(!waits).is_err() {
                return None;
            }
            if waits && self.socket.set_read_timeout(Some(left)).is_err() {
                return None;
            }
            match self.socket.recv_from(&mut buffer) {
                Ok((length, from)) => {
                    let Some(servos) = read(&buffer[..length]) else { continue };
                    if self.peer != Some(from) {
                        self.news.push(format!("ArduPilot has connected from {from}"));
                        self.peer = Some(from);
                        self.servos = None;
                    }
                    return Some(servos);
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(_) => return None,
            }
        }
    }

    fn answer(&mut self, step: u64, sensed: &Sensed<'_>) {
        let Some(peer) = self.peer else { return };
        let truth = sensed.truth;
        let origin = *self.origin_world.get_or_insert(truth.pos_world);
        let attitude = ned_from_frd(&truth.world_from_body);
        let (roll, pitch, yaw) = attitude.euler_angles();
        let answer = Answer {
            timestamp: step as f64 * 1e-3,
            imu: Inertial {
                gyro: frd_from_flu(sensed.imu.ang_vel_body).into(),
                accel_body: frd_from_flu(sensed.imu.force_body).into(),
            },
            position: ned_from_enu(truth.pos_world - origin).into(),
            attitude: [roll, pitch, yaw],
            quaternion: [attitude.w, attitude.i, attitude.j, attitude.k],
            velocity: ned_from_enu(truth.vel_world).into(),
        };
        let line = serde_json::to_string(&answer).expect("finite numbers under fixed names");
        // A datagram that is lost is asked for again: ArduPilot repeats its packet.
        let _ = self.socket.send_to(format!("\n{line}\n").as_bytes(), peer);
    }
}

impl Firmware for ArduPilotJson {
    fn step(&mut self, step: u64, sensed: &Sensed<'_>) -> Throttles {
        if self.left == 0 {
            if self.servos.is_some() && !self.silent {
                self.answer(step, sensed);
            }
            match self.receive() {
                Some(servos) => {
                    let repeated = self.servos.is_some_and(|last| last.frame == servos.frame);
                    self.servos = Some(servos);
                    self.silent = false;
                    // A packet that is sent again asks for the answer that was lost.
                    self.left = if repeated { 0 } else { servos.steps };
                }
                None => {
                    if let Some(servos) = self.servos.as_mut().filter(|_| !self.silent) {
                        servos.throttles = [0.0; 4];
                        self.silent = true;
                        self.news.push("ArduPilot is silent: the rotors stand until it speaks".to_owned());
                    }
                }
            }
        }
        self.left = self.left.saturating_sub(1);
        self.throttles()
    }

    fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }
}

/// A packet's servos; none: it is no packet of ArduPilot's.
fn read(bytes: &[u8]) -> Option<Servos> {
    let word = |at: usize| bytes.get(at..at + 2).map(|two| u16::from_le_bytes([two[0], two[1]]));
    let servos = match word(0)? {
        MAGIC_16 => 16,
        MAGIC_32 => 32,
        _ => return None,
    };
    if bytes.len() != HEADER + 2 * servos {
        return None;
    }
    let rate_hz = u64::from(word(2)?.max(1));
    let frame = u32::from(word(4)?) | u32::from(word(6)?) << 16;
    let mut throttles = [0.0; 4];
    for (i, one) in throttles.iter_mut().enumerate() {
        *one = throttle((f64::from(word(HEADER + 2 * i)?) - 1000.0) * 1e-3);
    }
    Some(Servos { steps: (1000 / rate_hz).clamp(1, MOST_STEPS), frame, throttles })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packet(magic: u16, rate_hz: u16, frame: u32, pulses: &[u16]) -> Vec<u8> {
        let mut bytes = [magic, rate_hz].iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<_>>();
        bytes.extend(frame.to_le_bytes());
        bytes.extend(pulses.iter().flat_map(|pulse| pulse.to_le_bytes()));
        bytes
    }

    #[test]
    fn a_packet_says_the_time_step_and_the_first_four_pulses() {
        let mut pulses = [0; 16];
        pulses[..4].copy_from_slice(&[1000, 1500, 2000, 2100]);
        let wanted = Servos { steps: 2, frame: 70_000, throttles: [0.0, 0.5, 1.0, 1.0] };
        assert_eq!(read(&packet(MAGIC_16, 400, 70_000, &pulses)), Some(wanted));
        assert_eq!(read(&packet(MAGIC_16, 1200, 1, &pulses)).unwrap().steps, 1);
        assert_eq!(read(&packet(MAGIC_32, 0, 1, &[0; 32])).unwrap().steps, MOST_STEPS);
        assert_eq!(read(&packet(MAGIC_32, 400, 1, &pulses)), None);
        assert_eq!(read(&packet(7, 400, 1, &pulses)), None);
    }

    proptest! {
        #[test]
        fn any_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..100)) {
            prop_assert!(read(&bytes).is_none_or(|servos| servos.throttles.iter().all(|t| (0.0..=1.0).contains(t))));
        }
    }
}
