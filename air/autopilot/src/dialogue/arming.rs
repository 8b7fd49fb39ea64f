//! Whether the autopilot would arm, and its own words for why not.
//!
//! SYS_STATUS has a bit for it, which PX4 judges for the mode that it is in: one that cannot take off, or waits for
//! setpoints, clears it. What decides are the checks that stand against Offboard. PX4 tells them as events, a summary
//! before and one after them. ArduPilot tells its words as text.

use crate::dialogue::events::{self, event_id};
use crate::dialogue::firmware::Firmware;
use crate::dialogue::mode::{FlightMode, Px4Mode};
use crate::messages::{EVENT_DATA, MavSysStatusSensor, SYS_STATUS_DATA};
use goshawk_core::Time;

/// PX4's number of Offboard among its navigation states, as a bit of a check's modes.
const OFFBOARD: u32 = 1 << 14;
/// A check's modes when it concerns them all.
const EVERY_MODE: u32 = u32::MAX;
/// The event that ends a report of arming checks.
const ARMING_SUMMARY: u32 = event_id("commander_arming_check_summary");
/// The event that ends a report of health checks.
const HEALTH_SUMMARY: u32 = event_id("commander_health_summary");
/// Where the summary's modes that can arm are among its arguments: after the chunk's number, errors and warnings.
const CAN_ARM: usize = 9;
/// Checks of one report; PX4 queues fewer events than this.
const CHECKS: usize = 32;
/// A text's age, s, up to which it is a reason. Chosen by eye: ArduPilot repeats its own every 30 s.
const TEXT_S: f64 = 40.0;
/// How texts begin that say why arming is, or would be, refused: PX4's, then ArduPilot's.
const REASONS: [&str; 5] = ["Preflight Fail", "Arming denied", "Disarming denied", "PreArm:", "Arm:"];

/// PX4's checks by their names, in words that say what to do.
const WORDS: [(&str, &str); 79] = [
    ("check_armable_configuration", "it is in its safety configuration (COM_ARMABLE is 0)"),
    ("check_modes_attitude", "no valid attitude estimate"),
    ("check_modes_angular_velocity", "no valid angular velocity"),
    ("check_modes_local_pos", "no valid position estimate"),
    ("check_modes_local_alt", "no valid altitude estimate"),
    ("check_estimator_missing_data", "its estimator has not begun: wait"),
    ("check_estimator_heading_not_stable", "the heading estimate is not stable: calibrate the compass"),
    ("check_estimator_hor_vel_not_stable", "the horizontal velocity is not stable: keep it still"),
    ("check_estimator_vert_vel_not_stable", "the vertical velocity is not stable: keep it still"),
    ("check_estimator_hor_pos_not_stable", "the horizontal position is not stable: keep it still"),
    ("check_estimator_hgt_not_stable", "the height is not stable: keep it still"),
    ("check_estimator_mag_interference", "strong magnetic interference"),
    ("check_estimator_gps_fix_too_low", "no GPS fix"),
    ("check_estimator_gps_num_sats_too_low", "not enough GPS satellites"),
    ("check_estimator_gps_pdop_too_high", "the GPS satellites stand badly (PDOP)"),
    ("check_estimator_gps_hor_pos_err_too_high", "the GPS position is too uncertain"),
    ("check_estimator_gps_vert_pos_err_too_high", "the GPS height is too uncertain"),
    ("check_estimator_gps_speed_acc_too_low", "the GPS speed is too uncertain"),
    ("check_estimator_gps_hor_pos_drift_too_high", "the GPS position drifts"),
    ("check_modes_cannot_takeoff", "its mode cannot take off"),
    ("check_modes_manual_control", "no radio control"),
    ("check_rc_dl_no_dllink", "no ground station"),
    ("check_estimator_heading_no_source", "nothing tells the heading: enable the compass, or another source"),
    ("check_estimator_mag_fault", "the compass contradicts the estimate: calibrate it"),
    ("check_estimator_high_accel_bias", "the accelerometer is far off: calibrate it"),
    ("check_estimator_high_gyro_bias", "the gyroscope is far off: calibrate it, and keep it still"),
    ("check_estimator_gps_not_fusing", "its estimator does not use the GPS"),
    ("check_estimator_gnss_fault", "its estimator has given the GPS up"),
    ("check_gnss_receiver_offline", "the GPS receiver is silent: see its cable and port"),
    ("check_gnss_receiver_no_fix", "no GPS fix"),
    ("check_mag_missing", "no compass: see its cable and port"),
    ("check_mag_no_data", "the compass sends nothing"),
    ("check_mag_fault", "the compass is faulty"),
    ("check_mag_not_calibrated", "the compass is not calibrated"),
    ("check_mag_consistency", "the compasses contradict each other: calibrate them, away from metal"),
    ("check_mag_sys_has_mag_missing", "fewer compasses than SYS_HAS_MAG says"),
    ("check_baro_missing", "no barometer"),
    ("check_baro_no_data", "the barometer sends nothing"),
    ("check_accel_missing", "no accelerometer"),
    ("check_accel_no_data", "the accelerometer sends nothing"),
    ("check_accel_not_calibrated", "the accelerometer is not calibrated"),
    ("check_imu_accel_inconsistent", "the accelerometers contradict each other: calibrate them"),
    ("check_gyro_missing", "no gyroscope"),
    ("check_gyro_no_data", "the gyroscope sends nothing"),
    ("check_gyro_not_calibrated", "the gyroscope is not calibrated"),
    ("check_imu_gyro_inconsistent", "the gyroscopes contradict each other: calibrate them"),
    ("check_optical_flow_sensor_invalid", "the optical flow sensor gives nothing valid"),
    ("check_distance_sensor_missing", "no distance sensor"),
    ("check_distance_sensor_invalid", "the distance sensor gives nothing valid"),
    ("check_battery_missing", "no battery is measured"),
    ("check_battery_disconnected", "the battery is disconnected"),
    ("check_battery_low", "the battery is low: change it"),
    ("check_battery_critical", "the battery is nearly empty: change it"),
    ("check_battery_emergency", "the battery is empty: change it"),
    ("check_battery_fault", "the battery says that it is faulty"),
    ("check_battery_unhealthy", "the battery says that it is worn out"),
    ("check_avionics_power_low", "its supply voltage is low"),
    ("check_avionics_power_high", "its supply voltage is high"),
    ("check_missing_system_power", "its supply is not measured"),
    ("check_system_usb_connected", "USB is plugged in: take it out"),
    ("check_system_safety_button", "the safety switch has not been pressed"),
    ("check_system_no_home_pos", "no home position"),
    ("check_system_no_global_pos", "no global position"),
    ("check_man_control_kill_engaged", "the radio's kill switch is on"),
    ("check_man_control_rtl_engaged", "the radio's return switch is on"),
    ("check_missing_fmu_sdcard", "no SD card"),
    ("check_hardfault_present", "its program crashed once: read its SD card's report and clear it"),
    ("check_cpuload_too_high", "its processor is too busy"),
    ("check_ram_usage_too_high", "its memory is nearly full"),
    ("check_escs_offline", "a motor controller is silent"),
    ("check_escs_telem_missing", "a motor controller tells nothing of itself"),
    ("check_failure_detector_arm_esc", "a motor controller did not arm"),
    ("check_failure_detector_roll", "it lies on its side: set it upright"),
    ("check_failure_detector_pitch", "it lies on its nose or tail: set it upright"),
    ("check_modes_global_pos", "no valid global position estimate"),
    ("check_modes_home_position", "no home position"),
    ("check_gf_no_home", "its geofence wants a home position"),
    ("check_parachute_missing", "no parachute"),
    ("check_open_drone_id_missing", "no remote identification"),
];

#[derive(Clone, Copy, Debug)]
struct Check {
    id: u32,
    modes: u32,
}

/// What it says of arming.
#[derive(Clone, Debug, Default)]
pub(crate) struct Arming {
    /// SYS_STATUS's bit; none: not told, or not kept by this firmware.
    bit: Option<bool>,
    /// The last whole report, with the modes that can arm; none: none has come.
    report: Option<(Vec<Check>, u32)>,
    /// The report under way.
    building: Option<(Vec<Check>, u32)>,
    /// The last reason in words.
    text: Option<(Time, String)>,
}

impl Arming {
    pub(crate) fn sys_status(&mut self, firmware: Firmware, status: &SYS_STATUS_DATA) {
        let bit = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
        // PX4 keeps the bit in the health only; ArduPilot says in the others that there is such a check.
        let kept = firmware == Firmware::Px4 || status.onboard_control_sensors_enabled.contains(bit);
        self.bit = kept.then(|| status.onboard_control_sensors_health.contains(bit));
    }

    pub(crate) fn event(&mut self, event: &EVENT_DATA) {
        let word = |at: usize| {
            let bytes = &event.arguments[at..at + 4];
            bytes.iter().rev().fold(0, |word: u32, byte| word << 8 | u32::from(*byte))
        };
        match event.id {
            ARMING_SUMMARY => self.building = Some((Vec::with_capacity(CHECKS), word(CAN_ARM))),
            HEALTH_SUMMARY => self.report = self.building.take().or(self.report.take()),
            id => {
                if let Some((checks, _)) = &mut self.building
                    && checks.len() < CHECKS
                {
                    checks.push(Check { id, modes: word(0) });
                }
            }
        }
    }

    pub(crate) fn text(&mut self, now: Time, text: &str) {
        if REASONS.iter().any(|begin| text.starts_with(begin)) {
            self.text = Some((now, text.to_owned()));
        }
    }

    /// SYS_STATUS says that it would not arm as it is.
    pub(crate) fn bit_is_clear(&self) -> bool {
        self.bit == Some(false)
    }

    /// The checks that stand against Offboard, but for the setpoints that only come with a flight; none: no report. A
    /// check of every mode is an optional one where some mode can arm.
    fn against(&self) -> Option<impl Iterator<Item = u32>> {
        let (checks, can_arm) = self.report.as_ref()?;
        let stands = move |check: &&Check| {
            let optional = check.modes == EVERY_MODE && *can_arm != 0;
            check.modes & OFFBOARD != 0 && !optional && !events::is_offboard_signal(check.id)
        };
        Some(checks.iter().filter(stands).map(|check| check.id))
    }

    /// Would it arm once it is asked, as far as it has told? `mode`: what it is in.
    pub(crate) fn would_arm(&self, mode: Option<FlightMode>) -> Option<bool> {
        match (self.against(), self.bit) {
            (Some(mut against), _) => Some(against.next().is_none()),
            (None, Some(false)) if arms_by_itself(mode) => Some(false),
            (None, Some(true)) => Some(true),
            (None, _) => None,
        }
    }

    /// Its reasons at `now`, in one line.
    pub(crate) fn reasons(&self, now: Time) -> String {
        let mut words: Vec<String> = self.against().into_iter().flatten().map(in_words).collect();
        let text = self.text.as_ref().filter(|(stamp, _)| now.since(*stamp) < TEXT_S);
        words.extend(text.map(|(_, text)| format!("\"{text}\"")));
        if words.is_empty() {
            words.push("it gives no reason: choose a mode in which it can arm, or ask a ground station".to_owned());
        }
        words.join("; ")
    }
}

/// In Offboard it waits for setpoints, and some modes never arm: there the bit says nothing of us.
fn arms_by_itself(mode: Option<FlightMode>) -> bool {
    use Px4Mode::{Land, Mission, Offboard, Return, Takeoff};
    match mode {
        Some(FlightMode::Px4(mode)) => !matches!(mode, Offboard | Land | Return | Takeoff | Mission),
        Some(FlightMode::Copter(_)) => true,
        None => false,
    }
}

fn in_words(id: u32) -> String {
    let known = WORDS.iter().find(|(name, _)| event_id(name) == id);
    known.map_or_else(|| format!("its check {id} fails"), |(_, words)| (*words).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(id: u32, arguments: &[u8]) -> EVENT_DATA {
        let mut padded = [0; 40];
        padded[..arguments.len()].copy_from_slice(arguments);
        EVENT_DATA { id, arguments: padded, ..EVENT_DATA::default() }
    }

    /// A report: can arm in `can_arm`, and these checks with their modes.
    fn report(can_arm: u32, checks: &[(u32, u32)]) -> Arming {
        let mut arming = Arming::default();
        let mut summary = vec![0; CAN_ARM];
        summary.extend(can_arm.to_le_bytes());
        arming.event(&event(ARMING_SUMMARY, &summary));
        for (id, modes) in checks {
            arming.event(&event(*id, &modes.to_le_bytes()));
        }
        assert!(arming.report.is_none(), "not whole yet");
        arming.event(&event(HEALTH_SUMMARY, &[0; 13]));
        arming
    }

    fn status(health: MavSysStatusSensor, enabled: MavSysStatusSensor) -> SYS_STATUS_DATA {
        SYS_STATUS_DATA {
            onboard_control_sensors_health: health,
            onboard_control_sensors_enabled: enabled,
            ..SYS_STATUS_DATA::default()
        }
    }

    const PREARM: MavSysStatusSensor = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK;
    const HOLD: Option<FlightMode> = Some(FlightMode::Px4(Px4Mode::Hold));

    #[test]
    fn the_recorded_reports_of_a_vehicle_that_flew_stand_against_nothing() {
        // Before the take-off: no mission, no radio, no ground station, each optional or of another mode.
        let optional = [(17_154_777, 0x8), (17_231_145, EVERY_MODE), (23_579_003, EVERY_MODE)];
        assert_eq!(report(0x807f_7bb0, &optional).would_arm(HOLD), Some(true));
        // While setpoints are missing.
        let waiting = [(17_154_777, 0x8), (19_865_031, OFFBOARD), (23_579_003, EVERY_MODE)];
        assert_eq!(report(0x807f_3bb0, &waiting).would_arm(HOLD), Some(true));
    }

    #[test]
    fn a_check_of_every_mode_counts_where_no_mode_can_arm_and_is_told_in_words() {
        let arming = report(0, &[(event_id("check_armable_configuration"), EVERY_MODE)]);
        assert_eq!(arming.would_arm(HOLD), Some(false));
        assert!(arming.reasons(Time(0)).contains("COM_ARMABLE"), "{}", arming.reasons(Time(0)));
        let unknown = report(0xff, &[(16_999_999, OFFBOARD | 1)]);
        assert_eq!(unknown.would_arm(HOLD), Some(false));
        assert!(unknown.reasons(Time(0)).contains("16999999"));
    }

    #[test]
    fn without_a_report_the_bit_counts_in_modes_that_arm() {
        let mut arming = Arming::default();
        assert_eq!(arming.would_arm(HOLD), None);
        arming.sys_status(Firmware::Px4, &status(PREARM, MavSysStatusSensor::empty()));
        assert_eq!(arming.would_arm(HOLD), Some(true));
        arming.sys_status(Firmware::Px4, &status(MavSysStatusSensor::empty(), MavSysStatusSensor::empty()));
        assert_eq!(arming.would_arm(HOLD), Some(false));
        for mode in [Px4Mode::Offboard, Px4Mode::Land] {
            assert_eq!(arming.would_arm(Some(FlightMode::Px4(mode))), None, "{mode}");
        }
    }

    #[test]
    fn ardupilots_bit_counts_where_it_has_the_check_and_its_text_is_the_reason() {
        let firmware = Firmware::ArduPilot(crate::dialogue::firmware::Guided::Guided);
        let copter = Some(FlightMode::Copter(crate::dialogue::copter::CopterMode::GUIDED));
        let mut arming = Arming::default();
        arming.sys_status(firmware, &status(MavSysStatusSensor::empty(), MavSysStatusSensor::empty()));
        assert_eq!(arming.would_arm(copter), None);
        arming.sys_status(firmware, &status(MavSysStatusSensor::empty(), PREARM));
        assert_eq!(arming.would_arm(copter), Some(false));
        arming.text(Time::from_secs(1.0), "PreArm: Compass not calibrated");
        arming.text(Time::from_secs(2.0), "Ground start");
        assert!(arming.reasons(Time::from_secs(3.0)).contains("Compass not calibrated"));
        assert!(arming.reasons(Time::from_secs(50.0)).contains("no reason"), "an old one is none");
    }
}
