//! What the controller must be told about the vehicle and its limits. SI and radians; nothing here has a default,
//! because every value is a safety limit or a property of one airframe. Typical values are those of the paper's vehicle.

use crate::control::disturbance::{Observer, ObserverConfig};
use crate::control::hover::HoldConfig;
use crate::control::lag::{AttitudeLag, LagConfig};
use crate::control::lead::LeadConfig;
use crate::control::motion::Motion;
use crate::control::plans::LadderConfig;
use crate::control::separation::SeparationConfig;
use crate::control::thrust::{HoverThrust, ThrustConfig};
use crate::control::vehicle::VehicleModel;
use crate::gaze::GazeConfig;
use crate::gaze::view::ViewConfig;
use crate::gaze::yaw::YawConfig;
use crate::mission::limits::LimitsConfig;
use crate::mission::modes::StopAction;
use crate::values::error::{ConfigError, within};

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
    /// What is looked at while the target is hidden.
    pub gaze: GazeConfig,
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

impl ControllerConfig {
    /// What is believed of the vehicle's motion before anything of it is known.
    #[must_use]
    pub fn motion(&self) -> Motion {
        Motion::new(
            Observer::new(self.observer),
            HoverThrust::new(self.thrust, self.vehicle.hover_thrust),
            AttitudeLag::new(self.lag, self.lead.tau),
        )
    }

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
        within("airframe.mass_kg", v.mass, 0.05..=25.0, "the loops are made for small quadrotors")?;
        within("airframe.hover_thrust", v.hover_thrust, 0.05..=0.9, "with more, too little is left to climb and turn")?;
        let flies = "less loses attitude authority, more than hover_thrust cannot descend";
        within("airframe.min_thrust", v.min_thrust, 0.005..=v.hover_thrust, flies)?;
        let climbs = "it must climb, and 1 is all that there is";
        within("airframe.max_thrust", v.max_thrust, v.hover_thrust + 0.05..=1.0, climbs)?;
        let tilt = "with less it cannot brake, near 90 no thrust holds the height";
        within("airframe.max_tilt_deg", v.max_tilt.to_degrees(), 5.0..=79.9, tilt)
    }

    fn validate_loops(&self) -> Result<(), ConfigError> {
        let o = &self.observer;
        within("observer.alpha1", o.alpha1, 0.1..=20.0, "a higher gain only follows noise")?;
        let damped = "with more than alpha1^2 / 2 the observer overshoots";
        within("observer.alpha2", o.alpha2, 0.01..=0.5 * o.alpha1 * o.alpha1, damped)?;
        within("observer.zeta_s", o.zeta, 0.02..=2.0, "a slower observer is no answer to a gust")?;
        within("observer.limit_mps2", o.limit, 0.0..=20.0, "no wind pushes with more than two g")?;
        within("lead.limit_mps2", self.lead.limit, 0.0..=20.0, "more than two g of lead is noise")?;
        let y = &self.yaw;
        within("yaw.max_rate_radps", y.max_rate, 0.1..=10.0, "odometry and camera are blurred beyond")?;
        within("yaw.max_acc_radps2", y.max_acc, 0.1..=100.0, "no quadrotor's yaw answers quicker")?;
        within("yaw.lag_s", y.lag, 0.0..=1.0, "a slower loop cannot be led")?;
        within("yaw.search_rate_radps", y.search_rate, 0.05..=y.max_rate, "it is a yaw rate as well")?;
        within("yaw.search_delay_s", y.search_delay, 0.0..=10.0, "by then the target is elsewhere")?;
        let slow = "navigation looks where it flies";
        within("yaw.along_velocity_speed_mps", y.along_velocity_speed, 0.1..=10.0, slow)?;
        let h = &self.hold;
        within("hold.kp", h.kp, 0.1..=20.0, "less does not hold, more oscillates with the attitude's lag")?;
        within("hold.kv", h.kv, 0.1..=20.0, "less does not brake, more oscillates with the attitude's lag")?;
        let horizontal = "less does not stop before the fence, two g is all that tilt gives";
        within("hold.max_acc_horizontal_mps2", h.max_acc_horizontal, 0.5..=20.0, horizontal)?;
        let vertical = "less does not hold the height, more than gravity cannot be had downward";
        within("hold.max_acc_vertical_mps2", h.max_acc_vertical, 0.5..=9.5, vertical)?;
        within("hold.stopped_speed_mps", h.stopped_speed, 0.05..=3.0, "a place is held only where braking has ended")
    }

    fn validate_ladder(&self) -> Result<(), ConfigError> {
        let l = &self.ladder;
        let old = "an older trajectory leads through what was not seen";
        within("ladder.missed_detection_s", l.missed_detection, 0.05..=2.0, old)?;
        within("ladder.plan_stale_s", l.plan_stale, 0.05..=1.0, "without a frame for longer it flies blind")?;
        within("ladder.no_plan_land_s", l.no_plan_land, 1.0..=120.0, "the battery is for more than waiting")?;
        let dead = "less than a few periods is none, and half a second of dead reckoning is metres";
        within("ladder.odometry_stale_s", l.odometry_stale, 0.02..=0.5, dead)?;
        within("ladder.descend_acc_mps2", l.descend_acc, 0.05..=2.0, "it is to be a gentle descent")?;
        let blind = "without odometry nothing bounds the speed: the autopilot must have it soon";
        within("ladder.hand_back_s", l.hand_back, 0.1..=10.0, blind)
    }

    fn validate_mission(&self) -> Result<(), ConfigError> {
        let m = &self.mission;
        let stream = "PX4 wants a second of setpoints first, and a start that waits long looks refused";
        within("mission.stream_before_offboard_s", m.stream_before_offboard, 1.0..=10.0, stream)?;
        within("mission.request_period_s", m.request_period, 0.1..=5.0, "a lost request must be repeated soon")?;
        let armed = "an autopilot that does not answer for longer is lost";
        within("mission.request_timeout_s", m.request_timeout, m.request_period..=30.0, armed)?;
        within("mission.takeoff_ramp_s", m.takeoff_ramp, 0.2..=10.0, "who does not lift by then is held down")?;
        within("mission.climb_speed_mps", m.climb_speed, 0.1..=5.0, "the camera does not look up")?;
        let seen = "it must be above min_target_distance_m, and farther off the target is not seen well";
        within("mission.hold_distance_m", m.hold_distance, self.separation.min_distance + 0.01..=20.0, seen)?;
        let apart = "it must be above hold_distance_m, and within sight";
        within("mission.resume_distance_m", m.resume_distance, m.hold_distance + 0.1..=50.0, apart)?;
        within("mission.goal_radius_m", m.goal_radius, 0.1..=20.0, "a goal is a place")?;
        within("mission.search_timeout_s", m.search_timeout, 1.0..=600.0, "the battery is for more than searching")?;
        within(
            "mission.descent_speed_mps",
            m.descent_speed,
            0.2..=3.0,
            "faster meets its own downwash and the ground",
        )?;
        let down = "slower hangs in the ground effect, faster than descent_speed_mps is no touch-down";
        within("mission.touchdown_speed_mps", m.touchdown_speed, 0.2..=m.descent_speed, down)?;
        within("mission.slow_height_m", m.slow_height, 0.0..=10.0, "a longer slow descent empties the battery")?;
        let sure = "shorter is a bump, longer pushes into the ground";
        within("mission.touchdown_time_s", m.touchdown_time, 0.05..=5.0, sure)
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
            gaze: GazeConfig { objectness: 0.9, target_speed: 10.0 },
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
            ("airframe.mass_kg", |c| c.vehicle.mass = 0.0),
            ("airframe.hover_thrust", |c| c.vehicle.hover_thrust = 1.0),
            ("airframe.min_thrust", |c| c.vehicle.min_thrust = 0.0),
            ("airframe.max_tilt_deg", |c| c.vehicle.max_tilt = 1.6),
            ("observer.zeta_s", |c| c.observer.zeta = f64::NAN),
            ("observer.alpha2", |c| c.observer.alpha2 = 4.6),
            ("airframe.hover_thrust_range", |c| c.thrust.least = 0.26),
            ("airframe.hover_thrust_range", |c| c.thrust.most = 0.24),
            ("lead.attitude_lag_range_s", |c| c.lag.least = 0.11),
            ("lead.attitude_lag_range_s", |c| c.lag.most = 0.09),
            ("limits.battery_start", |c| c.limits.battery_start = 0.1),
            ("camera.tilt_deg", |c| c.view.top = f64::NAN),
            ("yaw.search_rate_radps", |c| c.yaw.search_rate = 9.0),
            ("ladder.odometry_stale_s", |c| c.ladder.odometry_stale = f64::INFINITY),
            ("mission.resume_distance_m", |c| c.mission.resume_distance = 2.9),
            ("mission.stream_before_offboard_s", |c| c.mission.stream_before_offboard = 0.5),
            ("mission.touchdown_speed_mps", |c| c.mission.touchdown_speed = 0.8),
        ];
        for (name, spoil) in spoiled {
            let mut config = config();
            spoil(&mut config);
            let message = config.validate().unwrap_err().to_string();
            assert!(message.starts_with(name) && message.contains("must be"), "{message}");
        }
    }
}
