//! Firmware that simulates its own vehicle, such as PX4's SIH: the world, the camera and the truth follow the pose that
//! it tells over MAVLink.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use color_eyre::eyre::{Result, bail};
use goshawk_autopilot::{Address, AutopilotLink, LinkConfig};
use goshawk_core::{GRAVITY, Odometry, Rot, Time, Vec3};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;

use super::local::Local;
use crate::vehicle::quadrotor::{Quadrotor, QuadrotorState};
use crate::world::World;

/// Our component id: a second companion computer, beside the vehicle's own.
const COMPONENT_ID: u8 = 192;
/// The newest pose is led by its own motion for so long at most, s; then the vehicle stands still there.
const LEAD_S: f64 = 0.2;
/// The feet of a vehicle that is no higher than this above where it would stand touch the ground, m.
const STANDS_M: f64 = 0.05;

/// The pose of a vehicle that somebody else simulates.
pub(super) struct External {
    link: AutopilotLink,
    local: Local,
    silent: bool,
}

impl External {
    /// Waits at `address` for the firmware's first pose: there the vehicle stands at `start_world`, looking along
    /// `heading_rad`.
    pub(super) fn meet(
        address: &Address,
        vehicle: &Vehicle,
        start_world: &Vec3,
        heading_rad: f64,
        stop: &AtomicBool,
    ) -> Result<Self> {
        let config = LinkConfig { address: address.clone(), peer: None, component_id: COMPONENT_ID, ..vehicle.link()? };
        let link = AutopilotLink::open(config, clock::now)?;
        super::say(&format!("waiting for the firmware's pose at {address}; Ctrl-C ends"));
        let first = loop {
            if let Some(first) = link.odometry() {
                break first;
            }
            if stop.load(Ordering::Relaxed) {
                bail!("no pose came at {address}: does the firmware send MAVLink there?");
            }
            std::thread::sleep(Duration::from_millis(50));
        };
        let turn = heading_rad - first.world_from_body.euler_angles().2;
        let origin = start_world - Rot::from_axis_angle(&Vec3::z_axis(), turn) * first.pos_world;
        Ok(Self { link, local: Local::at(origin, turn), silent: false })
    }

    pub(super) fn local(&self) -> Local {
        self.local
    }

    /// Puts `quad` where the firmware says that it is at `now`.
    pub(super) fn place(&mut self, quad: &mut Quadrotor, now: Time, world: &World) {
        let Some(pose) = self.link.odometry() else { return };
        let age_s = now.since(pose.stamp);
        if (age_s > LEAD_S) != self.silent {
            self.silent = !self.silent;
            super::say(&format!(
                "the firmware's pose {}",
                if self.silent { "has stopped: the vehicle stands" } else { "is back" }
            ));
        }
        let led = led(&pose, age_s.clamp(0.0, LEAD_S));
        let force_body = self.link.imu().map(|imu| imu.specific_force_body);
        let acc = force_body.map_or_else(Vec3::zeros, |force| led.world_from_body * force - Vec3::z() * GRAVITY);
        let pos_world = self.local.in_world(led.pos_world);
        let turn = self.local.world_from_local();
        let standing_m = world.ground_height(pos_world.x, pos_world.y) + quad.parameters().leg_m + STANDS_M;
        quad.put(QuadrotorState {
            pos_world,
            vel_world: if self.silent { Vec3::zeros() } else { turn * led.vel_world },
            acc_world: turn * acc,
            world_from_body: turn * led.world_from_body,
            ang_vel_body: led.ang_vel_body,
            on_ground: pos_world.z < standing_m,
        });
    }
}

/// A pose `dt_s` later, if its motion lasts.
fn led(pose: &Odometry, dt_s: f64) -> Odometry {
    Odometry {
        pos_world: pose.pos_world + pose.vel_world * dt_s,
        world_from_body: pose.world_from_body * Rot::from_scaled_axis(pose.ang_vel_body * dt_s),
        ..*pose
    }
}
