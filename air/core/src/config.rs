//! What the controller must be told about the vehicle and its limits. SI and radians; nothing here has a default,
//! because every value is a safety limit or a property of one airframe. Typical values are those of the paper's vehicle.

use crate::error::{ConfigError, check, not_negative, positive};
use crate::lag::LagConfig;
use crate::limits::LimitsConfig;
use crate::mission::StopAction;
use crate::separation::SeparationConfig;
use crate::thrust::ThrustConfig;
use crate::types::{GRAVITY, Newtons, NormalisedThrust};
use crate::view::ViewConfig;

/// Everything that the controller needs to know.
#[derive(Clone, Debug, PartialEq)]
pub struct ControllerConfig {
    /// The airframe.
    pub vehicle: VehicleModel,
    /// Bounds of the hover thrust that is learnt in flight.
    pub thrust: ThrustConfig,
    /// Disturbance observer (eq. 14-15).
    pub observer: ObserverConfig,
    /// Lead over the attitude loop's lag.
    pub lead: LeadConfig,
    /// Bounds of the lag that is learnt in flight.
    pub lag: LagConfig,
    /// Yaw limits and the search.
    pub yaw: YawConfig,
    /// What the camera shows.
    pub view: ViewConfig,
    /// Braking and position hold.
    pub hold: HoldConfig,
    /// The fallback ladder's timings.
    pub ladder: LadderConfig,
    /// Take-off, holding distance, landing.
    pub mission: MissionConfig,
    /// What no flight may exceed.
    pub limits: LimitsConfig,
    /// The least distance to the target.
    pub separation: SeparationConfig,
}

/// The airframe as the controller sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleModel {
    /// Take-off mass, kg (0.85).
    pub mass: f64,
    /// Normalised thrust that hovers, 0..1; where the estimate begins.
    pub hover_thrust: f64,
    /// Least normalised thrust in flight; keeps attitude authority (0.05).
    pub min_thrust: f64,
    /// Most normalised thrust in flight, up to 1.
    pub max_thrust: f64,
    /// Largest commanded tilt, rad (45 deg); below 80 deg.
    pub max_tilt: f64,
}

/// Gains of the high-gain observer (eq. 15). See `disturbance.rs` for the region in which the loop is stable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObserverConfig {
    /// alpha1 (3).
    pub alpha1: f64,
    /// alpha2 (2); at most alpha1² / 2.
    pub alpha2: f64,
    /// zeta, s (0.2).
    pub zeta: f64,
    /// Largest disturbance believed, m/s² (6).
    pub limit: f64,
}

/// Lead: f̈ + tau·f⃛.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeadConfig {
    /// The attitude loop's first-order lag, s; where the estimate begins.
    pub tau: f64,
    /// Largest lead, m/s² (6).
    pub limit: f64,
}

/// Yaw limits and the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YawConfig {
    /// Largest yaw rate, rad/s (2.5).
    pub max_rate: f64,
    /// Largest yaw acceleration, rad/s² (10).
    pub max_acc: f64,
    /// The yaw loop's lag, s: the command leads the plan by rate·lag; 0: no lead.
    pub lag: f64,
    /// Yaw rate of the sweep for a lost target, rad/s (1.0).
    pub search_rate: f64,
    /// How long to look where the target was lost before sweeping, s (1.5).
    pub search_delay: f64,
    /// Navigation: speed above which yaw follows the velocity, below it the goal, m/s (1).
    pub along_velocity_speed: f64,
}

/// Braking and position hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldConfig {
    /// Position gain, 1/s² (2).
    pub kp: f64,
    /// Velocity gain, 1/s (2.5).
    pub kv: f64,
    /// Largest horizontal acceleration of hold and brake, m/s² (6).
    pub max_acc_horizontal: f64,
    /// Largest vertical acceleration of hold and brake, m/s² (4).
    pub max_acc_vertical: f64,
    /// Speed below which braking becomes position hold, m/s (0.5).
    pub stopped_speed: f64,
}

/// When each rung of the fallback ladder takes over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LadderConfig {
    /// Track: how old the last chosen trajectory may get while frames without a choice arrive, s (0.6).
    pub missed_detection: f64,
    /// How old the last chosen trajectory may get when no frame at all arrives, s (0.3).
    pub plan_stale: f64,
    /// How long to hold without any plan before landing, s (20).
    pub no_plan_land: f64,
    /// Age of odometry beyond which it is not flown on, s (0.2).
    pub odometry_stale: f64,
    /// Net downward acceleration while descending without odometry, m/s² (0.3).
    pub descend_acc: f64,
    /// How long to descend without odometry before handing back, s (1.5).
    pub hand_back: f64,
}

/// Take-off, holding distance, landing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionConfig {
    /// How long setpoints stream before offboard is requested, s (1.2).
    pub stream_before_offboard: f64,
    /// How often a request is repeated, s (1).
    pub request_period: f64,
    /// When an unanswered request becomes a fault, s (5).
    pub request_timeout: f64,
    /// How long the thrust rises before the vehicle leaves the ground, at most, s (2).
    pub takeoff_ramp: f64,
    /// Climb speed at take-off, m/s (1).
    pub climb_speed: f64,
    /// Horizontal distance to the target at which to hold, m (2).
    pub hold_distance: f64,
    /// Horizontal distance at which to track again, m (3).
    pub resume_distance: f64,
    /// Distance at which a goal counts as reached, m (1.5).
    pub goal_radius: f64,
    /// How long to search before landing, s (60).
    pub search_timeout: f64,
    /// Descent speed, m/s (0.7).
    pub descent_speed: f64,
    /// Descent speed near the ground, m/s (0.35).
    pub touchdown_speed: f64,
    /// Height above the start below which the descent is slow, m (1).
    pub slow_height: f64,
    /// How long the vertical speed must be near zero, while commanded down, to count as touch-down, s (0.4).
    pub touchdown_time: f64,
    /// What Stop does.
    pub on_stop: StopAction,
}

impl VehicleModel {
    /// Normalised thrust for a collective force, clamped to 0..=`max_thrust`.
    #[must_use]
    pub fn normalised(&self, force: Newtons) -> NormalisedThrust {
        NormalisedThrust((force.0 / (self.mass * GRAVITY) * self.hover_thrust).clamp(0.0, self.max_thrust))
    }

    /// Collective force of a normalised thrust.
    #[must_use]
    pub fn force(&self, thrust: NormalisedThrust) -> Newtons {
        Newtons(thrust.0 / self.hover_thrust * self.mass * GRAVITY)
    }
}

impl ControllerConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value that cannot be flown with, by name.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.validate_vehicle()?;
        self.thrust.validate(&self.vehicle)?;
        self.lag.validate(self.lead.tau)?;
        self.limits.validate()?;
        self.separation.validate()?;
        self.view.validate()?;
        self.validate_loops()?;
        self.validate_ladder()?;
        self.validate_mission()
    }

    fn validate_vehicle(&self) -> Result<(), ConfigError> {
        let v = &self.vehicle;
        positive("vehicle.mass", v.mass)?;
        check("vehicle.hover_thrust", v.hover_thrust, "above 0 and below 1", |x| x > 0.0 && x < 1.0)?;
        check("vehicle.min_thrust", v.min_thrust, "above 0 and below hover_thrust", |x| x > 0.0 && x < v.hover_thrust)?;
        check("vehicle.max_thrust", v.max_thrust, "above hover_thrust and at most 1", |x| {
            x > v.hover_thrust && x <= 1.0
        })?;
        check("vehicle.max_tilt", v.max_tilt, "above 0 and below 80 degrees", |x| x > 0.0 && x < 80_f64.to_radians())
    }

    fn validate_loops(&self) -> Result<(), ConfigError> {
        let o = &self.observer;
        positive("observer.alpha1", o.alpha1)?;
        check("observer.alpha2", o.alpha2, "above 0 and at most alpha1^2 / 2, or the observer overshoots", |x| {
            x > 0.0 && x <= 0.5 * o.alpha1 * o.alpha1
        })?;
        positive("observer.zeta", o.zeta)?;
        not_negative("observer.limit", o.limit)?;
        not_negative("lead.limit", self.lead.limit)?;
        let y = &self.yaw;
        positive("yaw.max_rate", y.max_rate)?;
        positive("yaw.max_acc", y.max_acc)?;
        check("yaw.lag", y.lag, "0 to 1 s", |x| (0.0..=1.0).contains(&x))?;
        check("yaw.search_rate", y.search_rate, "above 0 and at most max_rate", |x| x > 0.0 && x <= y.max_rate)?;
        not_negative("yaw.search_delay", y.search_delay)?;
        positive("yaw.along_velocity_speed", y.along_velocity_speed)?;
        let h = &self.hold;
        positive("hold.kp", h.kp)?;
        positive("hold.kv", h.kv)?;
        positive("hold.max_acc_horizontal", h.max_acc_horizontal)?;
        check("hold.max_acc_vertical", h.max_acc_vertical, "above 0 and below gravity", |x| x > 0.0 && x < GRAVITY)?;
        positive("hold.stopped_speed", h.stopped_speed)
    }

    fn validate_ladder(&self) -> Result<(), ConfigError> {
        let l = &self.ladder;
        positive("ladder.missed_detection", l.missed_detection)?;
        positive("ladder.plan_stale", l.plan_stale)?;
        positive("ladder.no_plan_land", l.no_plan_land)?;
        positive("ladder.odometry_stale", l.odometry_stale)?;
        check("ladder.descend_acc", l.descend_acc, "above 0 and at most 2 m/s2", |x| x > 0.0 && x <= 2.0)?;
        positive("ladder.hand_back", l.hand_back)
    }

    fn validate_mission(&self) -> Result<(), ConfigError> {
        let m = &self.mission;
        check("mission.stream_before_offboard", m.stream_before_offboard, "at least 1 s", |x| x >= 1.0)?;
        positive("mission.request_period", m.request_period)?;
        positive("mission.request_timeout", m.request_timeout)?;
        positive("mission.takeoff_ramp", m.takeoff_ramp)?;
        positive("mission.climb_speed", m.climb_speed)?;
        check("mission.hold_distance", m.hold_distance, "above limits.min_target_distance", |x| {
            x > self.separation.min_distance
        })?;
        check("mission.resume_distance", m.resume_distance, "above hold_distance", |x| x > m.hold_distance)?;
        positive("mission.goal_radius", m.goal_radius)?;
        positive("mission.search_timeout", m.search_timeout)?;
        positive("mission.descent_speed", m.descent_speed)?;
        check("mission.touchdown_speed", m.touchdown_speed, "at least 0.2 m/s and at most descent_speed", |x| {
            x >= 0.2 && x <= m.descent_speed
        })?;
        not_negative("mission.slow_height", m.slow_height)?;
        positive("mission.touchdown_time", m.touchdown_time)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn config() -> ControllerConfig {
        ControllerConfig {
            vehicle: VehicleModel {
                mass: 0.85,
                hover_thrust: 0.25,
                min_thrust: 0.03,
                max_thrust: 1.0,
                max_tilt: 45_f64.to_radians(),
            },
            thrust: ThrustConfig { least: 0.13, most: 0.42 },
            observer: ObserverConfig { alpha1: 3.0, alpha2: 2.0, zeta: 0.2, limit: 6.0 },
            lead: LeadConfig { tau: 0.1, limit: 6.0 },
            lag: LagConfig { least: 0.04, most: 0.35 },
            yaw: YawConfig {
                max_rate: 2.5,
                max_acc: 10.0,
                lag: 0.0,
                search_rate: 1.0,
                search_delay: 1.5,
                along_velocity_speed: 1.0,
            },
            view: ViewConfig { top: 0.63 },
            hold: HoldConfig { kp: 2.0, kv: 2.5, max_acc_horizontal: 6.0, max_acc_vertical: 4.0, stopped_speed: 0.5 },
            ladder: LadderConfig {
                missed_detection: 0.6,
                plan_stale: 0.3,
                no_plan_land: 20.0,
                odometry_stale: 0.2,
                descend_acc: 0.3,
                hand_back: 1.5,
            },
            mission: MissionConfig {
                stream_before_offboard: 1.2,
                request_period: 1.0,
                request_timeout: 5.0,
                takeoff_ramp: 2.0,
                climb_speed: 1.0,
                hold_distance: 3.0,
                resume_distance: 4.0,
                goal_radius: 1.5,
                search_timeout: 60.0,
                descent_speed: 0.7,
                touchdown_speed: 0.35,
                slow_height: 1.0,
                touchdown_time: 0.4,
                on_stop: StopAction::Land,
            },
            limits: LimitsConfig {
                fence_radius: 100.0,
                ceiling: 20.0,
                max_speed: 12.0,
                max_time: 600.0,
                battery_start: 0.3,
                battery_land: 0.15,
            },
            separation: SeparationConfig { min_distance: 2.0, target_acc: 8.0, max_acc: 10.0 },
        }
    }

    #[test]
    fn a_value_that_cannot_be_flown_with_is_refused_by_name() {
        assert_eq!(config().validate(), Ok(()));
        type Spoil = fn(&mut ControllerConfig);
        let spoiled: [(&str, Spoil); 17] = [
            ("vehicle.mass", |c| c.vehicle.mass = 0.0),
            ("vehicle.hover_thrust", |c| c.vehicle.hover_thrust = 1.0),
            ("vehicle.min_thrust", |c| c.vehicle.min_thrust = 0.0),
            ("vehicle.max_tilt", |c| c.vehicle.max_tilt = 1.6),
            ("observer.zeta", |c| c.observer.zeta = f64::NAN),
            ("observer.alpha2", |c| c.observer.alpha2 = 4.6),
            ("thrust.least", |c| c.thrust.least = 0.26),
            ("thrust.most", |c| c.thrust.most = 0.24),
            ("lag.least", |c| c.lag.least = 0.11),
            ("lag.most", |c| c.lag.most = 0.09),
            ("limits.battery_start", |c| c.limits.battery_start = 0.1),
            ("view.top", |c| c.view.top = f64::NAN),
            ("yaw.search_rate", |c| c.yaw.search_rate = 9.0),
            ("ladder.odometry_stale", |c| c.ladder.odometry_stale = f64::INFINITY),
            ("mission.resume_distance", |c| c.mission.resume_distance = 2.9),
            ("mission.stream_before_offboard", |c| c.mission.stream_before_offboard = 0.5),
            ("mission.touchdown_speed", |c| c.mission.touchdown_speed = 0.8),
        ];
        for (name, spoil) in spoiled {
            let mut config = config();
            spoil(&mut config);
            let message = config.validate().unwrap_err().to_string();
            assert!(message.starts_with(name) && message.contains("must be"), "{message}");
        }
    }

    #[test]
    fn normalised_thrust_hovers_at_the_weight_and_is_clamped() {
        let vehicle = config().vehicle;
        let weight = Newtons(0.85 * GRAVITY);
        assert!((vehicle.normalised(weight).0 - 0.25).abs() < 1e-12);
        assert!((vehicle.force(vehicle.normalised(weight)).0 - weight.0).abs() < 1e-12);
        assert_eq!(vehicle.normalised(Newtons(1e6)).0, 1.0);
        assert_eq!(vehicle.normalised(Newtons(-1.0)).0, 0.0);
    }
}
