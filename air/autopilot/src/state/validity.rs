//! Whether the autopilot's estimator stands by its horizontal position and velocity. It goes on sending numbers when it
//! does not: a PX4 without GPS invents a standstill and flies on it. Of PX4 three messages tell: ESTIMATOR_STATUS in its
//! flags, ODOMETRY in its variances and its quality, and before October 2022 LOCAL_POSITION_NED by its absence. Of
//! ArduPilot one does: EKF_STATUS_REPORT in its flags. Two more faults are that the motions told contradict each other
//! (`contradiction`), or the accelerometer (`inertial`).

use crate::dialogue::firmware::Firmware;
use crate::messages::{ESTIMATOR_STATUS_DATA, EkfStatusFlags, EstimatorStatusFlags, MavMessage, ODOMETRY_DATA};
use goshawk_core::Time;
use std::fmt;

/// A witness must say so for this long, s: two reports of the unasked 1 Hz, three of the asked 10 Hz.
const LOST_AFTER_S: f64 = 0.2;
/// And say otherwise for this long before it is believed again, s: a filter that has just begun to take measurements
/// still moves. Chosen by eye.
const BACK_AFTER_S: f64 = 1.0;
/// LOCAL_POSITION_NED is missed after this, s: PX4 streams it at 30 Hz, until October 2022 only while position and
/// velocity were valid. One of later streams it always, so that its absence says nothing.
const LOCAL_SILENT_S: f64 = 1.0;
/// ODOMETRY younger than this shows that the line works, s. Chosen by eye.
const ODOMETRY_FRESH_S: f64 = 0.3;
/// Standard deviations beyond these are no position to fly among trees by: 5 m, and 2 m/s. GPS gives 0.2 and 0.1.
const LARGEST_VARIANCE: (f32, f32) = (25.0, 4.0);
/// Rows of x and y on the diagonal of a 6 x 6 upper triangle.
const HORIZONTAL: [usize; 2] = [0, 6];

/// What its position lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PositionFault {
    /// ESTIMATOR_STATUS or EKF_STATUS_REPORT: no horizontal velocity or no horizontal position, or one that is held
    /// constant in the air.
    Flags,
    /// ODOMETRY calls itself failed, or its variances are not there or too large.
    Variance,
    /// LOCAL_POSITION_NED has stopped.
    LocalPosition,
    /// ODOMETRY and LOCAL_POSITION_NED tell of two motions.
    Contradiction,
    /// ODOMETRY's velocity changes as the accelerometer did not feel.
    Unfelt,
}

impl fmt::Display for PositionFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Flags => "its estimator says that the horizontal position is not valid",
            Self::Variance => "its odometry calls itself failed, or is uncertain by more than 5 m or 2 m/s",
            Self::Contradiction => "its ODOMETRY and its LOCAL_POSITION_NED contradict each other",
            Self::Unfelt => "its velocity changes as its accelerometer does not feel",
            Self::LocalPosition => "it has stopped telling its local position, which it does without a valid one",
        })
    }
}

/// One message's word, debounced.
#[derive(Clone, Copy, Debug, Default)]
struct Witness {
    /// The debounced word; none: it has said nothing.
    valid: Option<bool>,
    /// It has said the contrary since then.
    contrary: Option<Time>,
}

impl Witness {
    fn says(&mut self, now: Time, valid: bool) {
        let Some(held) = self.valid else {
            self.valid = Some(valid);
            return;
        };
        if held == valid {
            self.contrary = None;
            return;
        }
        let since = *self.contrary.get_or_insert(now);
        if now.since(since) >= if valid { BACK_AFTER_S } else { LOST_AFTER_S } {
            (self.valid, self.contrary) = (Some(valid), None);
        }
    }
}

/// What is known of the estimate's validity.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Validity {
    flags: Witness,
    variance: Witness,
    /// Newest LOCAL_POSITION_NED and ODOMETRY.
    local: Option<Time>,
    odometry: Option<Time>,
}

impl Validity {
    /// Takes a message that arrived `now`; `flies`: the landed detector says that it is in the air.
    pub(crate) fn take(&mut self, now: Time, message: &MavMessage, firmware: Firmware, flies: bool) {
        match message {
            MavMessage::ESTIMATOR_STATUS(status) => self.flags.says(now, solved(status, flies)),
            MavMessage::EKF_STATUS_REPORT(report) => self.flags.says(now, navigates(report.flags, flies)),
            MavMessage::ODOMETRY(odometry) => {
                self.odometry = Some(now);
                if firmware == Firmware::Px4 {
                    self.variance.says(now, certain(odometry));
                }
            }
            MavMessage::LOCAL_POSITION_NED(_) => self.local = Some(now),
            _ => {}
        }
    }

    /// What is wrong at `now`.
    pub(crate) fn fault(&self, now: Time) -> Option<PositionFault> {
        let older = |at: Option<Time>, limit: f64| at.is_some_and(|at| now.since(at) > limit);
        let streams = self.odometry.is_some() && !older(self.odometry, ODOMETRY_FRESH_S);
        if self.flags.valid == Some(false) {
            Some(PositionFault::Flags)
        } else if self.variance.valid == Some(false) {
            Some(PositionFault::Variance)
        } else if streams && older(self.local, LOCAL_SILENT_S) {
            Some(PositionFault::LocalPosition)
        } else {
            None
        }
    }

    /// Whether it stands by its position; none: no message has said.
    pub(crate) fn position(&self, now: Time) -> Option<bool> {
        match self.fault(now) {
            Some(_) => Some(false),
            None => self.flags.valid.or(self.variance.valid),
        }
    }
}

/// On the ground PX4 sets the constant-position flag beside all the good ones (recorded); in the air it is an invention.
fn solved(status: &ESTIMATOR_STATUS_DATA, flies: bool) -> bool {
    let has = |flag| status.flags.contains(flag);
    let position =
        has(EstimatorStatusFlags::ESTIMATOR_POS_HORIZ_REL) || has(EstimatorStatusFlags::ESTIMATOR_POS_HORIZ_ABS);
    let invented = flies && has(EstimatorStatusFlags::ESTIMATOR_CONST_POS_MODE);
    has(EstimatorStatusFlags::ESTIMATOR_VELOCITY_HORIZ) && position && !invented
}

/// As ArduPilot judges by itself: before the take-off a position that it will have is enough, in the air it must have
/// one, and not one that is held constant (`Copter::position_ok`).
fn navigates(flags: EkfStatusFlags, flies: bool) -> bool {
    let any = |wanted| flags.intersects(wanted);
    let position = any(EkfStatusFlags::EKF_POS_HORIZ_REL | EkfStatusFlags::EKF_POS_HORIZ_ABS);
    let predicted = any(EkfStatusFlags::EKF_PRED_POS_HORIZ_REL | EkfStatusFlags::EKF_PRED_POS_HORIZ_ABS);
    if flies {
        position && any(EkfStatusFlags::EKF_VELOCITY_HORIZ) && !any(EkfStatusFlags::EKF_CONST_POS_MODE)
    } else {
        position || predicted
    }
}

fn certain(odometry: &ODOMETRY_DATA) -> bool {
    let within = |covariance: &[f32; 21], largest: f32| {
        // A NaN fails this comparison too.
        HORIZONTAL.iter().all(|row| (0.0..=largest).contains(&covariance[*row]))
    };
    odometry.quality >= 0
        && within(&odometry.pose_covariance, LARGEST_VARIANCE.0)
        && within(&odometry.velocity_covariance, LARGEST_VARIANCE.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialogue::firmware::Guided;
    use crate::messages::{EKF_STATUS_REPORT_DATA, LOCAL_POSITION_NED_DATA};

    /// As recorded of a real PX4: on the ground, in flight, and in flight without a range to the ground.
    const HEALTHY: [(u16, bool); 3] = [(1023, false), (895, true), (831, true)];

    fn flags(bits: u16) -> MavMessage {
        let flags = EstimatorStatusFlags::from_bits_retain(bits);
        MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA { flags, ..ESTIMATOR_STATUS_DATA::default() })
    }

    fn odometry(position: f32, velocity: f32, quality: i8) -> MavMessage {
        let mut message = ODOMETRY_DATA { quality, ..ODOMETRY_DATA::default() };
        message.pose_covariance = [f32::NAN; 21];
        message.velocity_covariance = [f32::NAN; 21];
        for row in HORIZONTAL {
            (message.pose_covariance[row], message.velocity_covariance[row]) = (position, velocity);
        }
        MavMessage::ODOMETRY(message)
    }

    /// Says it at 10 Hz for so long.
    fn hear(validity: &mut Validity, from: f64, seconds: f64, message: &MavMessage, flies: bool) {
        for step in 0..(seconds * 10.0).round() as u32 {
            validity.take(Time::from_secs(from + 0.1 * f64::from(step)), message, Firmware::Px4, flies);
        }
    }

    #[test]
    fn the_flags_of_a_healthy_recorded_flight_are_valid() {
        for (bits, flies) in HEALTHY {
            let mut validity = Validity::default();
            assert_eq!(validity.position(Time::from_secs(1.0)), None);
            hear(&mut validity, 1.0, 1.0, &flags(bits), flies);
            assert_eq!(validity.position(Time::from_secs(2.0)), Some(true), "{bits}");
        }
    }

    #[test]
    fn flags_without_a_horizontal_position_or_velocity_are_believed_after_a_moment() {
        for bits in [1023 & !2, 1023 & !(8 | 16), 128 | 1 | 4 | 32] {
            let mut validity = Validity::default();
            hear(&mut validity, 1.0, 1.0, &flags(1023), false);
            hear(&mut validity, 2.0, 0.1, &flags(bits), false);
            assert_eq!(validity.position(Time::from_secs(2.0)), Some(true), "one report is none");
            hear(&mut validity, 2.1, 0.3, &flags(bits), false);
            assert_eq!(validity.fault(Time::from_secs(2.3)), Some(PositionFault::Flags), "{bits}");
            hear(&mut validity, 3.0, 0.8, &flags(1023), false);
            assert_eq!(validity.position(Time::from_secs(3.8)), Some(false));
            hear(&mut validity, 3.8, 0.5, &flags(1023), false);
            assert_eq!(validity.position(Time::from_secs(4.3)), Some(true));
        }
    }

    #[test]
    fn a_constant_position_is_no_fault_on_the_ground_and_one_in_the_air() {
        let mut validity = Validity::default();
        hear(&mut validity, 1.0, 1.0, &flags(1023), false);
        hear(&mut validity, 2.0, 1.0, &flags(1023), true);
        assert_eq!(validity.position(Time::from_secs(3.0)), Some(false));
    }

    fn report(bits: u16) -> MavMessage {
        let flags = EkfStatusFlags::from_bits_retain(bits);
        MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA { flags, ..EKF_STATUS_REPORT_DATA::default() })
    }

    #[test]
    fn of_ardupilot_a_position_to_come_is_enough_on_the_ground_and_one_that_is_there_in_the_air() {
        const HAS: u16 = 1 | 2 | 4 | 8 | 16 | 32 | 256 | 512;
        for (bits, ground, air) in [
            (HAS, true, true),
            (HAS | 1 << 15, true, true),     // its GPS glitches, and it flies on what it has
            (HAS & !(16 | 512), true, true), // optical flow: relative
            (1 | 4 | 32 | 128 | 512, true, false), // just started, GPS is there
            (1 | 4 | 32 | 128, false, false), // no GPS
            (HAS | 128, true, false),
            (HAS & !2, true, false),
            (HAS & !(8 | 16), true, false),
            (1024, false, false),
            (0, false, false),
        ] {
            for (flies, valid) in [(false, ground), (true, air)] {
                let mut validity = Validity::default();
                hear(&mut validity, 1.0, 1.0, &report(HAS), flies);
                hear(&mut validity, 2.0, 1.0, &report(bits), flies);
                assert_eq!(validity.position(Time::from_secs(3.0)), Some(valid), "{bits}, in the air: {flies}");
            }
        }
    }

    #[test]
    fn two_reports_of_the_unasked_rate_are_enough() {
        let mut validity = Validity::default();
        for (second, bits) in [(1.0, 1023), (2.0, 1023), (3.0, 165), (4.0, 165)] {
            validity.take(Time::from_secs(second), &flags(bits), Firmware::Px4, false);
        }
        assert_eq!(validity.position(Time::from_secs(4.0)), Some(false));
    }

    #[test]
    fn odometry_that_is_uncertain_or_says_that_it_failed_is_not_valid() {
        let good = odometry(0.045, 0.017, 0); // recorded
        for bad in [
            odometry(f32::NAN, 0.01, 0),
            odometry(0.04, f32::NAN, 0),
            odometry(26.0, 0.01, 0),
            odometry(0.04, 0.01, -1),
        ] {
            let mut validity = Validity::default();
            hear(&mut validity, 1.0, 1.0, &good, true);
            assert_eq!(validity.position(Time::from_secs(2.0)), Some(true));
            hear(&mut validity, 2.0, 0.5, &bad, true);
            assert_eq!(validity.fault(Time::from_secs(2.5)), Some(PositionFault::Variance));
        }
        // Another firmware's covariances mean what they mean.
        let mut validity = Validity::default();
        validity.take(Time::from_secs(1.0), &odometry(f32::NAN, 0.0, 0), Firmware::ArduPilot(Guided::Guided), true);
        assert_eq!(validity.position(Time::from_secs(1.0)), None);
    }

    #[test]
    fn a_local_position_that_stops_while_odometry_goes_on_is_not_valid() {
        let mut validity = Validity::default();
        let local = MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA::default());
        hear(&mut validity, 1.0, 1.0, &odometry(0.04, 0.01, 0), true);
        assert_eq!(validity.position(Time::from_secs(2.0)), Some(true), "one that never came says nothing");
        hear(&mut validity, 1.0, 1.0, &local, true);
        hear(&mut validity, 2.0, 1.2, &odometry(0.04, 0.01, 0), true);
        assert_eq!(validity.fault(Time::from_secs(3.1)), Some(PositionFault::LocalPosition));
        // A line that is cut says nothing of the estimator.
        assert_eq!(validity.fault(Time::from_secs(5.0)), None);
    }
}
