//! The tuning file, and what the controller must be told about the vehicle and its limits. Nothing here has a default,
//! because every value is a safety limit or a property of one airframe.
//!
//! Each section of the vehicle file and of the tuning file is a struct of the core, and each key one field of it: the
//! unit in its name, what it does in its comment, its range with the reason, and the source of its value, in its
//! attribute. `goshawk-vehicle` reads the files by these structs, checks the ranges, and writes the JSON Schema and the
//! reference page.

use crate::control::disturbance::{Observer, ObserverConfig};
use crate::control::hover::HoldConfig;
use crate::control::lag::AttitudeLag;
use crate::control::lead::LeadConfig;
use crate::control::motion::Motion;
use crate::control::plans::LadderConfig;
use crate::control::separation::{SeparationConfig, SeparationTuning};
use crate::control::thrust::HoverThrust;
use crate::control::vehicle::Airframe;
use crate::gaze::GazeConfig;
use crate::gaze::view::ViewConfig;
use crate::gaze::yaw::YawConfig;
use crate::mission::limits::LimitsConfig;
use crate::mission::modes::StopAction;
use crate::planning::evade::EvasionConfig;
use crate::planning::planner::PlanningConfig;
use crate::values::error::{ConfigError, within};
use crate::values::extensions::Extensions;
use schemars::JsonSchema;
use serde::Deserialize;

/// Everything that the controller needs to know.
#[derive(Clone, Debug, PartialEq)]
pub struct ControllerConfig {
    /// The airframe.
    pub airframe: Airframe,
    /// Disturbance observer (eq. 14-15).
    pub observer: ObserverConfig,
    /// Lead over the attitude loop's lag.
    pub lead: LeadConfig,
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
    /// Ways aside.
    pub evasion: EvasionConfig,
    /// What goes beyond the paper.
    pub extensions: Extensions,
}

/// Take-off, holding distance, landing.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MissionConfig {
    /// How long setpoints stream before offboard is requested, s. PX4 wants at least one second.
    #[schemars(range(min = 1.0, max = 10.0), extend("x-why" = "PX4 wants a second of setpoints first, and a start that waits long looks refused", "x-source" = "PX4's second and a little"))]
    pub stream_before_offboard_s: f64,
    /// How often a request to the autopilot is repeated, s.
    #[schemars(range(min = 0.1, max = 5.0), extend("x-why" = "a lost request must be repeated soon", "x-source" = "chosen by eye"))]
    pub request_period_s: f64,
    /// When an unanswered request becomes a fault, s.
    #[schemars(range(min = 0.1, max = 30.0), extend("x-why" = "an autopilot that does not answer for longer is lost", "x-source" = "chosen by eye"))]
    pub request_timeout_s: f64,
    /// How long the thrust rises before the vehicle leaves the ground, at most, s.
    #[schemars(range(min = 0.2, max = 10.0), extend("x-why" = "who does not lift by then is held down", "x-source" = "chosen by eye"))]
    pub takeoff_ramp_s: f64,
    /// Climb speed at take-off, m/s.
    #[schemars(range(min = 0.1, max = 5.0), extend("x-why" = "the camera does not look up", "x-source" = "chosen by eye"))]
    pub climb_speed_mps: f64,
    /// Horizontal distance to the target at which to hold, m.
    #[schemars(range(min = 0.11, max = 20.0), extend("x-why" = "it must be above min_target_distance_m, and farther off the target is not seen well", "x-source" = "chosen by eye: a little over the shipped planner.chase.standoff_m"))]
    pub hold_distance_m: f64,
    /// Horizontal distance to the target at which to track again, m.
    #[schemars(range(min = 0.21, max = 50.0), extend("x-why" = "it must be above hold_distance_m, and within sight", "x-source" = "chosen by eye: 1 m over the shipped hold_distance_m"))]
    pub resume_distance_m: f64,
    /// Distance at which a goal counts as reached, m.
    #[schemars(range(min = 0.1, max = 20.0), extend("x-why" = "a goal is a place", "x-source" = "chosen by eye"))]
    pub goal_radius_m: f64,
    /// How long to search before landing, s.
    #[schemars(range(min = 1.0, max = 600.0), extend("x-why" = "the battery is for more than searching", "x-source" = "chosen by eye"))]
    pub search_timeout_s: f64,
    /// Descent speed, m/s.
    #[schemars(range(min = 0.2, max = 3.0), extend("x-why" = "faster meets its own downwash and the ground", "x-source" = "chosen by eye"))]
    pub descent_speed_mps: f64,
    /// Descent speed near the ground, m/s.
    #[schemars(range(min = 0.2, max = 3.0), extend("x-why" = "slower hangs in the ground effect, faster than descent_speed_mps is no touch-down", "x-source" = "chosen by eye"))]
    pub touchdown_speed_mps: f64,
    /// Height above the start below which the descent is slow, m.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-why" = "a longer slow descent empties the battery", "x-source" = "chosen by eye"))]
    pub slow_height_m: f64,
    /// How long the vertical speed must be near zero, while commanded down, to count as touch-down, s.
    #[schemars(range(min = 0.05, max = 5.0), extend("x-why" = "shorter is a bump, longer pushes into the ground", "x-source" = "chosen by eye"))]
    pub touchdown_time_s: f64,
    /// What Stop does.
    pub on_stop: StopAction,
}

/// The tuning file: what is chosen, not measured.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tuning {
    /// What goes beyond the paper, each with its switch; what is left out is on.
    #[serde(default)]
    pub extensions: Extensions,
    /// How to plan.
    pub planner: PlanningConfig,
    /// The disturbance observer.
    pub observer: ObserverConfig,
    /// Lead over the attitude loop's lag.
    pub lead: LeadConfig,
    /// Yaw limits and the search.
    pub yaw: YawConfig,
    /// Braking and position hold.
    pub hold: HoldConfig,
    /// The fallback ladder.
    pub ladder: LadderConfig,
    /// How the least distance to the target is kept.
    pub separation: SeparationTuning,
    /// Take-off, holding distance, landing.
    pub mission: MissionConfig,
}

impl Tuning {
    /// Checks what no key says alone.
    ///
    /// # Errors
    /// The first value that contradicts another one, by name.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.planner.validate()?;
        let (o, y, m) = (&self.observer, &self.yaw, &self.mission);
        let damped = "with more than alpha1^2 / 2 the observer overshoots";
        within("observer.alpha2", o.alpha2, 0.01..=0.5 * o.alpha1 * o.alpha1, damped)?;
        within("yaw.search_rate_radps", y.search_rate_radps, 0.05..=y.max_rate_radps, "it is a yaw rate as well")?;
        let armed = "an autopilot that does not answer for longer is lost";
        within("mission.request_timeout_s", m.request_timeout_s, m.request_period_s..=30.0, armed)?;
        let apart = "it must be above hold_distance_m, and within sight";
        within("mission.resume_distance_m", m.resume_distance_m, m.hold_distance_m + 0.1..=50.0, apart)?;
        let down = "slower hangs in the ground effect, faster than descent_speed_mps is no touch-down";
        within("mission.touchdown_speed_mps", m.touchdown_speed_mps, 0.2..=m.descent_speed_mps, down)
    }

    /// With no level acceleration above what `airframe` can hold at its greatest tilt, g tan(max_tilt): nobody counts on
    /// braking that does not come.
    #[must_use]
    pub fn within_tilt(&self, airframe: &Airframe) -> Self {
        let (mut tuning, gives) = (self.clone(), airframe.level_acc());
        for acc in [
            &mut tuning.planner.max_acc_mps2,
            &mut tuning.planner.evasion.acc_mps2,
            &mut tuning.separation.aside_acc_mps2,
            &mut tuning.hold.max_acc_horizontal_mps2,
        ] {
            *acc = acc.min(gives);
        }
        tuning
    }
}

impl ControllerConfig {
    /// Of the vehicle, what its camera shows, and the tuning, as far as the vehicle can tilt.
    #[must_use]
    pub fn new(airframe: Airframe, limits: LimitsConfig, view: ViewConfig, tuning: &Tuning) -> Self {
        let tuning = tuning.within_tilt(&airframe);
        Self {
            airframe,
            observer: tuning.observer,
            lead: if tuning.extensions.attitude_lead {
                tuning.lead
            } else {
                LeadConfig { limit_mps2: 0.0, ..tuning.lead }
            },
            yaw: tuning.yaw,
            view,
            gaze: GazeConfig { objectness: tuning.planner.target.confirm_objectness },
            hold: tuning.hold,
            ladder: tuning.ladder,
            mission: tuning.mission,
            limits,
            separation: SeparationConfig {
                min_distance: limits.min_target_distance_m,
                target_acc: tuning.planner.target.max_acc_mps2,
                max_acc: tuning.planner.max_acc_mps2,
                tuning: tuning.separation,
            },
            evasion: tuning.planner.evasion,
            extensions: tuning.extensions,
        }
    }

    /// What is believed of the vehicle's motion before anything of it is known.
    #[must_use]
    pub fn motion(&self) -> Motion {
        let (a, learnt) = (&self.airframe, &self.extensions);
        // What is not learnt has no range to move in.
        let range = |learns: bool, range: [f64; 2], begin: f64| if learns { range } else { [begin; 2] };
        let hover_range = range(learnt.learnt_hover_thrust, a.hover_thrust_range, a.hover_thrust);
        let lag_range = range(learnt.learnt_attitude_lag, a.attitude_lag_range_s, a.attitude_lag_s);
        Motion::new(
            Observer::new(self.observer),
            HoverThrust::new(hover_range, a.hover_thrust),
            AttitudeLag::new(lag_range, a.attitude_lag_s),
        )
    }

    /// Checks what no key says alone.
    ///
    /// # Errors
    /// The first value that contradicts another one, by name.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.airframe.validate()?;
        self.view.validate()?;
        let land = self.limits.battery_land;
        let first = "below battery_land a flight would end as it begins";
        within("limits.battery_start", self.limits.battery_start, land..=1.0, first)?;
        let seen = "it must be above min_target_distance_m, and farther off the target is not seen well";
        let least = self.limits.min_target_distance_m + 0.01;
        within("mission.hold_distance_m", self.mission.hold_distance_m, least..=20.0, seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;

    #[test]
    fn nobody_counts_on_more_than_the_tilt_gives() {
        let (tuning, gives) = (shipped::tuning(), 9.80665 * 25_f64.to_radians().tan());
        let level = |tuning: &Tuning| {
            let (planner, separation) = (&tuning.planner, &tuning.separation);
            let evasion = planner.evasion.acc_mps2;
            [planner.max_acc_mps2, evasion, separation.aside_acc_mps2, tuning.hold.max_acc_horizontal_mps2]
        };
        let shipped = shipped::controller();
        assert_eq!(tuning.within_tilt(&Airframe { max_tilt_deg: 65.0, ..shipped.airframe }), tuning);
        let first = Airframe { max_tilt_deg: 25.0, ..shipped.airframe };
        assert!(level(&tuning.within_tilt(&first)).iter().all(|acc| (acc - gives).abs() < 1e-3));
        let config = ControllerConfig::new(first, shipped.limits, shipped.view, &tuning);
        assert!((config.separation.max_acc - gives).abs() < 1e-3 && config.evasion.acc_mps2 < 4.6);
    }

    #[test]
    fn two_keys_that_contradict_each_other_are_refused_by_name() {
        type Spoil = fn(&mut Tuning, &mut ControllerConfig);
        assert_eq!((shipped::tuning().validate(), shipped::controller().validate()), (Ok(()), Ok(())));
        let spoiled: [(&str, Spoil); 15] = [
            ("planner.target.confirm_hits", |t, _| t.planner.target.confirm_hits = 7),
            ("planner.target.sure_objectness", |t, _| t.planner.target.sure_objectness = 0.8),
            ("planner.movers.radius_m", |t, _| t.planner.movers.radius_m[0] = 0.8),
            ("observer.alpha2", |t, _| t.observer.alpha2 = 4.6),
            ("yaw.search_rate_radps", |t, _| t.yaw.search_rate_radps = 9.0),
            ("mission.request_timeout_s", |t, _| t.mission.request_timeout_s = 0.5),
            ("mission.resume_distance_m", |t, _| t.mission.resume_distance_m = 2.9),
            ("mission.touchdown_speed_mps", |t, _| t.mission.touchdown_speed_mps = 0.8),
            ("mission.hold_distance_m", |_, c| c.mission.hold_distance_m = 1.0),
            ("airframe.min_thrust", |_, c| c.airframe.min_thrust = 0.3),
            ("airframe.max_thrust", |_, c| c.airframe.max_thrust = 0.28),
            ("airframe.hover_thrust_range", |_, c| c.airframe.hover_thrust_range[0] = 0.26),
            ("airframe.attitude_lag_range_s", |_, c| c.airframe.attitude_lag_range_s[1] = 0.09),
            ("limits.battery_start", |_, c| c.limits.battery_start = 0.1),
            ("camera.tilt_deg", |_, c| c.view.top = f64::NAN),
        ];
        for (name, spoil) in spoiled {
            let (mut tuning, mut controller) = (shipped::tuning(), shipped::controller());
            spoil(&mut tuning, &mut controller);
            let message = tuning.validate().and(controller.validate()).unwrap_err().to_string();
            assert!(message.starts_with(name) && message.contains("must be"), "{message}");
        }
    }
}
