//! The IMU: the true specific force and angular velocity with offsets and noise.

use goshawk_core::{GRAVITY, Rot, Time, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::Deserialize;

use crate::vehicle::quadrotor::QuadrotorState;

/// Errors of an accelerometer and a gyroscope.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuConfig {
    /// Noise density of the accelerometer, m/s²/√Hz.
    pub acc_density: f64,
    /// Noise density of the gyroscope, rad/s/√Hz.
    pub gyro_density: f64,
    /// Standard deviation of each axis' constant offset, m/s².
    pub acc_bias_mps2: f64,
    /// Standard deviation of each axis' constant offset, rad/s.
    pub gyro_bias_radps: f64,
}

/// One measurement, body frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// Acceleration less gravity, m/s²: +g upward at rest.
    pub force_body: Vec3,
    /// Angular velocity, rad/s.
    pub ang_vel_body: Vec3,
}

impl ImuSample {
    /// Without any error. The ground's push at rest cancels gravity exactly.
    #[must_use]
    pub fn ideal(truth: &QuadrotorState) -> Self {
        let acc_world = if truth.on_ground { Vec3::zeros() } else { truth.acc_world };
        let up = Vec3::new(0.0, 0.0, GRAVITY);
        Self {
            force_body: truth.world_from_body.inverse_transform_vector(&(acc_world + up)),
            ang_vel_body: truth.ang_vel_body,
        }
    }

    /// Without any error, the mean over the time between two states, `dt_s` apart: what moved the body and turned it is
    /// felt, a push of the ground and a slide along it too.
    #[must_use]
    pub fn between(before: &QuadrotorState, after: &QuadrotorState, dt_s: f64) -> Self {
        let turned = (before.world_from_body.inverse() * after.world_from_body).scaled_axis();
        let midway = before.world_from_body * Rot::from_scaled_axis(0.5 * turned);
        let acc_world = (after.vel_world - before.vel_world) / dt_s;
        let up = Vec3::new(0.0, 0.0, GRAVITY);
        Self { force_body: midway.inverse_transform_vector(&(acc_world + up)), ang_vel_body: turned / dt_s }
    }

    /// As the vehicle's software knows it, taken at `stamp`.
    #[must_use]
    pub fn at(&self, stamp: Time) -> goshawk_core::Imu {
        goshawk_core::Imu { stamp, specific_force_body: self.force_body, ang_vel_body: self.ang_vel_body }
    }
}

/// Measures; the same seed makes the same errors.
#[derive(Clone, Debug)]
pub struct Imu {
    config: ImuConfig,
    acc_bias: Vec3,
    gyro_bias: Vec3,
    rng: ChaCha8Rng,
}

impl Imu {
    /// An IMU whose offsets are drawn from `seed`.
    #[must_use]
    pub fn new(config: ImuConfig, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut bias = |std: f64| Vec3::from_fn(|_, _| std * rng.sample::<f64, _>(StandardNormal));
        let (acc_bias, gyro_bias) = (bias(config.acc_bias_mps2), bias(config.gyro_bias_radps));
        Self { config, acc_bias, gyro_bias, rng }
    }

    /// The mean over the last `dt_s` (above 0), taken as the present truth.
    pub fn measure(&mut self, truth: &QuadrotorState, dt_s: f64) -> ImuSample {
        self.spoil(ImuSample::ideal(truth), dt_s)
    }

    /// What it makes of a mean over `dt_s` (above 0).
    pub fn spoil(&mut self, ideal: ImuSample, dt_s: f64) -> ImuSample {
        // White noise of density n, averaged over dt, has the standard deviation n / √dt.
        let scale = 1.0 / dt_s.sqrt();
        ImuSample {
            force_body: ideal.force_body + self.acc_bias + self.noise(self.config.acc_density * scale),
            ang_vel_body: ideal.ang_vel_body + self.gyro_bias + self.noise(self.config.gyro_density * scale),
        }
    }

    fn noise(&mut self, std: f64) -> Vec3 {
        Vec3::from_fn(|_, _| std * self.rng.sample::<f64, _>(StandardNormal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sense::file::Sensors;
    use crate::vehicle::quadrotor::{Quadrotor, QuadrotorParameters};

    #[test]
    fn what_it_feels_integrates_to_how_the_vehicle_moved_and_turned_on_the_ground_and_off_it() {
        let parameters = QuadrotorParameters::default();
        let mut quad = Quadrotor::new(parameters.clone(), Vec3::new(0.0, 0.0, parameters.leg_m), 0.3);
        let slope = |x: f64, _: f64| 0.08 * x;
        let start = *quad.state();
        let (mut vel_world, mut attitude) = (start.vel_world, start.world_from_body);
        for step in 0..1500 {
            let before = *quad.state();
            let throttle = 0.6 * (f64::from(step) / 1500.0);
            quad.drive(1e-3, &[throttle, throttle, 1.01 * throttle, throttle], Vec3::zeros(), slope);
            let felt = ImuSample::between(&before, quad.state(), 1e-3);
            let turned = felt.ang_vel_body * 1e-3;
            let force_world = attitude * Rot::from_scaled_axis(0.5 * turned) * felt.force_body;
            vel_world += (force_world - Vec3::z() * GRAVITY) * 1e-3;
            attitude *= Rot::from_scaled_axis(turned);
        }
        assert!(quad.state().vel_world.norm() > 1.0, "it has taken off");
        assert!((vel_world - quad.state().vel_world).norm() < 1e-6, "{vel_world}");
        assert!(attitude.angle_to(&quad.state().world_from_body) < 1e-6);
    }

    #[test]
    fn at_rest_it_measures_gravity_with_the_noise_of_its_data_sheet() {
        let truth = *Quadrotor::new(QuadrotorParameters::default(), Vec3::zeros(), 0.3).state();
        let config = Sensors::default().imu;
        let mut imu = Imu::new(config, 5);
        let samples: Vec<Vec3> = (0..20_000).map(|_| imu.measure(&truth, 0.01).force_body).collect();
        let mean = samples.iter().sum::<Vec3>() / samples.len() as f64;
        assert!((mean - Vec3::new(0.0, 0.0, GRAVITY)).norm() < 4.0 * config.acc_bias_mps2, "{mean}");
        let spread = samples.iter().map(|s| (s - mean).norm_squared()).sum::<f64>() / (3.0 * samples.len() as f64);
        let wanted = config.acc_density / 0.1;
        assert!((spread.sqrt() / wanted - 1.0).abs() < 0.02, "{spread} {wanted}");
        assert_eq!(Imu::new(config, 5).measure(&truth, 0.01), Imu::new(config, 5).measure(&truth, 0.01));
    }
}
