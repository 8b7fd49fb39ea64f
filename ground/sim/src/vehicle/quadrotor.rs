//! A quadrotor as a rigid body: four lagging rotors in X, drag, a sagging battery, the ground, and the inner loops of
//! its autopilot. In: attitude and normalised thrust, as the real autopilot takes them. Deterministic.

mod load;
mod loops;
mod mixer;
mod parameters;
mod wind;

use goshawk_core::{AttitudeThrust, GRAVITY, Rot, Vec3};
use nalgebra::{UnitQuaternion, Vector3};

pub use load::LoadParameters;
pub use parameters::{BatteryParameters, LoopParameters, QuadrotorParameters};
pub use wind::Wind;

/// The step that the physics is meant to be run at, s.
pub const STEP_S: f64 = 1e-3;

/// Thrust fraction of an idling rotor: an armed rotor never stops.
const IDLE_FRACTION: f64 = 0.005;

/// Commands to the four rotors, each 0..=1, in the order of PX4's and ArduPilot's quadrotor X: front right, rear left,
/// front left, rear right. The first two turn counterclockwise seen from above, the others clockwise.
pub type Throttles = [f64; 4];

/// Where among [`Throttles`] the rotors of the body are, which go around: front left, front right, rear right, rear left.
const THROTTLE_OF: [usize; 4] = [2, 0, 3, 1];

/// Which way the rotors turn.
#[derive(Clone, Copy)]
enum Turning {
    /// As the mixer's own.
    Own,
    /// As [`Throttles`] says, the other way round.
    Standard,
}

/// The true motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuadrotorState {
    /// Centre of mass, m.
    pub pos_world: Vec3,
    /// Velocity, m/s.
    pub vel_world: Vec3,
    /// Acceleration over the last step, m/s².
    pub acc_world: Vec3,
    /// Attitude.
    pub world_from_body: Rot,
    /// Angular velocity, rad/s.
    pub ang_vel_body: Vec3,
    /// The feet touch the ground.
    pub on_ground: bool,
}

impl QuadrotorState {
    /// All of it is numbers.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let vectors = [&self.pos_world, &self.vel_world, &self.acc_world, &self.ang_vel_body];
        vectors.iter().flat_map(|vector| vector.iter()).chain(self.world_from_body.coords.iter()).all(|x| x.is_finite())
    }
}

/// A quadrotor in flight.
#[derive(Clone, Debug)]
pub struct Quadrotor {
    parameters: QuadrotorParameters,
    state: QuadrotorState,
    /// Speed of each rotor over its speed at full static thrust.
    rotor_speed: [f64; 4],
    /// Charge left, 0..1.
    charge: f64,
    rate_loop: loops::RateLoop,
    saturated: bool,
    mixer: mixer::Mixer,
    load: Option<load::Load>,
}

impl Quadrotor {
    /// A quadrotor that stands at `pos_world` (its centre of mass), rotors still, battery full.
    #[must_use]
    pub fn new(parameters: QuadrotorParameters, pos_world: Vec3, yaw_rad: f64) -> Self {
        let mixer = mixer::Mixer::new(parameters.arm_m, parameters.yaw_torque_m);
        Self {
            state: QuadrotorState {
                pos_world,
                vel_world: Vec3::zeros(),
                acc_world: Vec3::zeros(),
                world_from_body: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad),
                ang_vel_body: Vec3::zeros(),
                on_ground: false,
            },
            rotor_speed: [0.0; 4],
            charge: 1.0,
            rate_loop: loops::RateLoop::default(),
            saturated: false,
            mixer,
            load: parameters.load.map(|load| load::Load::new(load, pos_world)),
            parameters,
        }
    }

    /// The true motion now.
    #[must_use]
    pub fn state(&self) -> &QuadrotorState {
        &self.state
    }

    /// The numbers it was made with.
    #[must_use]
    pub fn parameters(&self) -> &QuadrotorParameters {
        &self.parameters
    }

    /// Charge left, 0..1.
    #[must_use]
    pub fn battery_fraction(&self) -> f64 {
        self.charge
    }

    /// Moves the vehicle and gives it a velocity, for a contact solved elsewhere.
    pub fn set_motion(&mut self, pos_world: Vec3, vel_world: Vec3) {
        self.state.pos_world = pos_world;
        self.state.vel_world = vel_world;
    }

    /// Puts the vehicle into a motion that is simulated elsewhere.
    pub fn put(&mut self, state: QuadrotorState) {
        self.state = state;
    }

    /// Advances by `dt_s` (at most a few ms). `demand`: none is disarmed, the rotors stop. `wind_world`: the air's
    /// velocity, m/s. `ground_m`: height of the ground at (x, y).
    pub fn step(
        &mut self,
        dt_s: f64,
        demand: Option<&AttitudeThrust>,
        wind_world: Vec3,
        ground_m: impl Fn(f64, f64) -> f64,
    ) {
        self.spin_rotors(dt_s, demand);
        self.move_on(dt_s, Turning::Own, wind_world, ground_m);
    }

    /// As [`Quadrotor::step`], with somebody else's inner loops and mixer: each rotor follows its own command.
    pub fn drive(&mut self, dt_s: f64, throttles: &Throttles, wind_world: Vec3, ground_m: impl Fn(f64, f64) -> f64) {
        let voltage = self.drain(dt_s);
        let exponent = 0.5 * self.parameters.thrust_exponent();
        let speed_des = THROTTLE_OF.map(|i| throttles[i].clamp(0.0, 1.0).powf(exponent) * voltage);
        self.follow(dt_s, speed_des);
        self.move_on(dt_s, Turning::Standard, wind_world, ground_m);
    }

    /// Moves the body by what the rotors, the air and the ground do to it.
    fn move_on(&mut self, dt_s: f64, turning: Turning, wind_world: Vec3, ground_m: impl Fn(f64, f64) -> f64) {
        let (thrust_n, mut torque_body) = self.mixer.wrench(&self.rotor_forces());
        if let Turning::Standard = turning {
            torque_body.z = -torque_body.z;
        }
        let p = &self.parameters;
        let s = &mut self.state;

        let drag_world = {
            let air_body = s.world_from_body.inverse() * (s.vel_world - wind_world);
            let drag_body =
                p.rotor_drag_npmps.component_mul(&air_body) + air_body * (p.body_drag_npmps2 * air_body.norm());
            -(s.world_from_body * drag_body)
        };
        let load_world = self.load.as_mut().map_or_else(Vec3::zeros, |load| {
            load.step(dt_s, s.pos_world, s.vel_world, ground_m(s.pos_world.x, s.pos_world.y))
        });
        let force_world = s.world_from_body * (Vector3::z() * thrust_n) + drag_world + load_world;
        s.acc_world = force_world / p.mass_kg - Vector3::z() * GRAVITY;
        s.pos_world += s.vel_world * dt_s + s.acc_world * (0.5 * dt_s * dt_s);
        s.vel_world += s.acc_world * dt_s;

        let momentum_body = p.inertia_kgm2.component_mul(&s.ang_vel_body);
        let ang_acc = (torque_body - s.ang_vel_body.cross(&momentum_body)).component_div(&p.inertia_kgm2);
        s.ang_vel_body += ang_acc * dt_s;
        s.world_from_body *= UnitQuaternion::from_scaled_axis(s.ang_vel_body * dt_s);
        s.world_from_body.renormalize_fast();

        self.touch_ground(dt_s, &ground_m);
    }

    /// Drains the battery, and gives the voltage over a full, unloaded pack's: a rotor's speed follows it.
    fn drain(&mut self, dt_s: f64) -> f64 {
        let p = &self.parameters;
        let power: f64 = self.rotor_speed.iter().map(|w| w.powi(3)).sum::<f64>() * 0.25;
        let hover_power = (1.0 / p.thrust_to_weight).powf(1.5);
        self.charge = (self.charge - power / hover_power * dt_s / p.battery.hover_endurance_s).max(0.0);
        1.0 - p.battery.discharge_drop * (1.0 - self.charge) - p.battery.load_drop * power
    }

    /// Lets the rotors follow their speeds.
    fn follow(&mut self, dt_s: f64, speed_des: [f64; 4]) {
        let follow = 1.0 - (-dt_s / self.parameters.rotor_lag_s).exp();
        for (speed, des) in self.rotor_speed.iter_mut().zip(speed_des) {
            *speed += (des - *speed) * follow;
        }
    }

    /// Runs the inner loops and lets the rotors follow; drains the battery.
    fn spin_rotors(&mut self, dt_s: f64, demand: Option<&AttitudeThrust>) {
        let voltage = self.drain(dt_s);
        let p = &self.parameters;
        let rotor_max_n = 0.25 * p.max_thrust().0;
        let mut speed_des = [0.0; 4];
        if let Some(demand) = demand {
            let collective_n = p.force(demand.thrust).0;
            let rate_des = loops::rate_demand(&p.loops, self.state.world_from_body, demand.world_from_body);
            if self.state.on_ground && collective_n < 0.3 * p.weight().0 {
                self.rate_loop.reset();
            }
            let ang_acc = self.rate_loop.step(&p.loops, rate_des, self.state.ang_vel_body, self.saturated, dt_s);
            let ang_acc =
                if self.state.on_ground && collective_n < 0.3 * p.weight().0 { Vec3::zeros() } else { ang_acc };
            let torque = p.inertia_kgm2.component_mul(&ang_acc);
            let mixed = self.mixer.mix(collective_n, torque, IDLE_FRACTION * rotor_max_n, rotor_max_n);
            self.saturated = mixed.saturated;
            for (speed, force) in speed_des.iter_mut().zip(mixed.force_n) {
                *speed = (force / rotor_max_n).sqrt() * voltage;
            }
        } else {
            self.rate_loop.reset();
        }
        self.follow(dt_s, speed_des);
    }

    /// Thrust of each rotor, N.
    fn rotor_forces(&self) -> [f64; 4] {
        let rotor_max_n = 0.25 * self.parameters.max_thrust().0;
        self.rotor_speed.map(|w| rotor_max_n * w * w)
    }

    /// Feet on the ground: no bounce, Coulomb friction, and the body settles onto the slope keeping its heading.
    fn touch_ground(&mut self, dt_s: f64, ground_m: &impl Fn(f64, f64) -> f64) {
        let p = &self.parameters;
        let s = &mut self.state;
        let height = ground_m(s.pos_world.x, s.pos_world.y);
        let depth = height + p.leg_m - s.pos_world.z;
        s.on_ground = depth >= 0.0;
        if !s.on_ground {
            return;
        }
        let reach = 0.1;
        let slope_x = (ground_m(s.pos_world.x + reach, s.pos_world.y) - height) / reach;
        let slope_y = (ground_m(s.pos_world.x, s.pos_world.y + reach) - height) / reach;
        let normal = Vec3::new(-slope_x, -slope_y, 1.0).normalize();

        s.pos_world.z += depth;
        let into = -s.vel_world.dot(&normal);
        if into > 0.0 {
            s.vel_world += normal * into;
            let sliding = s.vel_world - normal * s.vel_world.dot(&normal);
            let slow = (p.ground_friction * into).max(p.ground_friction * GRAVITY * dt_s);
            let speed = sliding.norm();
            s.vel_world -= sliding * (slow / speed.max(slow).max(f64::MIN_POSITIVE));
        }
        // Four feet level the body within about 50 ms as long as it presses on them.
        let z_world = s.world_from_body * Vector3::z();
        if let Some(levelling) = UnitQuaternion::rotation_between(&z_world, &normal) {
            let part = UnitQuaternion::from_scaled_axis(levelling.scaled_axis() * (dt_s / 0.05).min(1.0));
            s.world_from_body = part * s.world_from_body;
        }
        s.ang_vel_body *= (-dt_s / 0.02).exp();
    }
}
