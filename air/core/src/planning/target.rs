//! Where the target is: constant-velocity Kalman filter, gate, confirmation, re-acquisition (§III-C.2, eq. 10).
//!
//! The network knows better where in the image a target is than how far away, and both the better the surer it is that
//! there is one. So a detection's covariance is long along its line of sight, and large where the objectness is low.

use crate::gaze::expected::Expected;
use crate::gaze::hidden::hidden_for;
use crate::values::error::{ConfigError, within};
use crate::values::extensions::Extensions;
use crate::values::jump::Jump;
use crate::values::types::{Rival, Taken, TargetEstimate, TargetLook, Time, Vec3};
use nalgebra::{Matrix3, Matrix6};
use schemars::JsonSchema;
use serde::Deserialize;

/// The target filter's noise, gate and confirmation.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetConfig {
    /// Variance of the target's acceleration from frame to frame, (m/s²)², for each world axis.
    #[schemars(inner(range(min = 0.01, max = 1000.0)), extend("x-why" = "the filter follows noise with more, and nobody who turns with less", "x-source" = "recorded flights, notebook, What mattered: Weighing detections"))]
    pub acc_variance_mps2: [f64; 3],
    /// Variance of a detection at short range and an objectness of 1, across the line of sight, m².
    #[schemars(range(min = 0.0001, max = 10.0), extend("x-why" = "a detection is worth something, and exact never", "x-source" = "recorded flights, notebook, What mattered: Weighing detections"))]
    pub lateral_variance_m2: f64,
    /// The same along the line of sight, m².
    #[schemars(range(min = 0.0001, max = 10.0), extend("x-why" = "a detection is worth something, and exact never", "x-source" = "recorded flights, notebook, What mattered: Weighing detections"))]
    pub range_variance_m2: f64,
    /// By how many times both variances grow at an objectness of 0; before, by the root's share.
    #[schemars(range(min = 0.0, max = 1000.0), extend("x-why" = "beyond, a doubtful detection says nothing", "x-source" = "recorded flights, notebook, What mattered: Weighing detections"))]
    pub doubt: f64,
    /// Distance at which both variances have doubled, m.
    #[schemars(range(min = 0.5, max = 100.0), extend("x-why" = "depth is worse farther off", "x-source" = "chosen by eye"))]
    pub variance_distance_m: f64,
    /// Largest inconsistency of a detection, in standard deviations.
    #[schemars(range(min = 1.0, max = 20.0), extend("x-why" = "a wider gate takes all for the target", "x-source" = "chosen by eye"))]
    pub gate_sigmas: f64,
    /// Detections needed among the last confirm_of frames to believe the target.
    #[schemars(range(min = 1, max = 32), extend("x-why" = "more than confirm_of never come", "x-source" = "the paper's authors, in their published code"))]
    pub confirm_hits: u32,
    /// Frames that confirmation looks back on.
    #[schemars(range(min = 1, max = 32), extend("x-why" = "so many frames are remembered", "x-source" = "the paper's authors, in their published code"))]
    pub confirm_of: u32,
    /// Least mean objectness of the detections that confirm: foliage may look like the target now and then.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-why" = "objectness is a probability", "x-source" = "tried, notebook, What mattered: Belief"))]
    pub confirm_objectness: f64,
    /// Mean objectness that nothing but the target keeps up; then it is believed wherever it is.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-why" = "at least confirm_objectness, and a probability", "x-source" = "tried, notebook, What mattered: Belief"))]
    pub sure_objectness: f64,
    /// How long the target is believed without being seen, s.
    #[schemars(range(min = 0.05, max = 10.0), extend("x-why" = "by then it may be anywhere", "x-source" = "the paper's authors, in their published code"))]
    pub blind_time_s: f64,
    /// Largest speed of a target, m/s.
    #[schemars(range(min = 0.5, max = 30.0), extend("x-why" = "nothing that is chased runs faster", "x-source" = "the paper's authors, in their published code"))]
    pub max_speed_mps: f64,
    /// Largest acceleration of a target, m/s².
    #[schemars(range(min = 0.5, max = 50.0), extend("x-why" = "nobody turns harder", "x-source" = "chosen by eye"))]
    pub max_acc_mps2: f64,
    /// Detections farther from the lens than this are not believed, m.
    #[schemars(range(min = 1.0, max = 100.0), extend("x-why" = "the camera's depth ends before", "x-source" = "the simulated camera measures no farther"))]
    pub max_distance_m: f64,
    /// Added to the radius within which a lost target can have run, m.
    #[schemars(range(min = 0.0, max = 20.0), extend("x-why" = "a wider one takes all for the lost target", "x-source" = "chosen by eye"))]
    pub reacquire_margin_m: f64,
}

/// One detection, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// The target's centre, m.
    pub pos_world: Vec3,
    /// The line of sight from the lens to it, m.
    pub sight_world: Vec3,
    /// 0..=1.
    pub objectness: f64,
}

/// Position and velocity, normally distributed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Motion {
    pos: Vec3,
    vel: Vec3,
    /// Covariance of the position, m²,
    pos_var: Matrix3<f64>,
    /// of position and velocity,
    cross: Matrix3<f64>,
    /// of the velocity.
    vel_var: Matrix3<f64>,
}

impl Motion {
    /// x ← F x, P ← F P Fᵀ + G σ² Gᵀ with G = (dt²/2, dt) on each axis.
    fn predict(&mut self, dt: f64, acc_variance: [f64; 3]) {
        let noise = Matrix3::from_diagonal(&Vec3::from(acc_variance)) * (dt * dt);
        self.pos += self.vel * dt;
        self.pos_var +=
            (self.cross + self.cross.transpose()) * dt + self.vel_var * (dt * dt) + noise * (0.25 * dt * dt);
        self.cross += self.vel_var * dt + noise * (0.5 * dt);
        self.vel_var += noise;
    }

    /// The position is `measured` with covariance `measured_var`, positive definite.
    fn update(&mut self, measured: Vec3, measured_var: &Matrix3<f64>) {
        let Some(precision) = (self.pos_var + measured_var).try_inverse() else { return };
        let (gain_pos, gain_vel) = (self.pos_var * precision, self.cross.transpose() * precision);
        let innovation = measured - self.pos;
        self.pos += gain_pos * innovation;
        self.vel += gain_vel * innovation;
        self.vel_var = symmetric(&(self.vel_var - gain_vel * self.cross));
        self.cross -= gain_pos * self.cross;
        self.pos_var = symmetric(&(self.pos_var - gain_pos * self.pos_var));
    }
}

fn symmetric(m: &Matrix3<f64>) -> Matrix3<f64> {
    (m + m.transpose()) * 0.5
}

/// A hypothesis of one target.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Track {
    motion: Motion,
    stamp: Time,
    last_seen: Time,
    /// Bit k: was seen k frames ago.
    history: u32,
    /// Objectness of its detections, averaged over about the last `confirm_of`: to be hidden is no evidence against it.
    strength: f64,
    confirmed: bool,
    /// It began where the lost target can hardly have run.
    beyond_reach: bool,
}

/// The filter. One target, or none.
#[derive(Clone, Copy, Debug)]
pub struct TargetFilter {
    config: TargetConfig,
    extensions: Extensions,
    track: Option<Track>,
    /// The last believed target, once it is lost: where and when it was believed last.
    lost: Option<Track>,
    /// Something else that is seen while a target is believed: it takes its place if there is more evidence for it.
    rival: Option<Track>,
    /// What it made of the last frame; none: there was nothing to compare with.
    look: Option<TargetLook>,
}

/// By how much a rival's mean objectness must exceed that of the target that is held, as long as that is seen. By eye.
const STRONGER: f64 = 0.2;
/// A detection that is farther off than this, in standard deviations, counts as one of that much more variance: the
/// range of a half hidden target may be wrong by metres for some frames. Tried on recorded flights: the notebook,
/// "Weighing detections".
const OUTLIER: f64 = 2.0;

impl TargetConfig {
    /// Checks what no key says alone.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let hits = "more than confirm_of never come";
        within("planner.target.confirm_hits", f64::from(self.confirm_hits), 1.0..=f64::from(self.confirm_of), hits)?;
        let sure = "at least confirm_objectness, and a probability";
        within("planner.target.sure_objectness", self.sure_objectness, self.confirm_objectness..=1.0, sure)
    }

    /// Covariance of a detection at the end of the line of sight `sight_world`, m².
    #[must_use]
    pub fn covariance(&self, sight_world: Vec3, objectness: f64) -> Matrix3<f64> {
        let farther = 1.0 + sight_world.norm_squared() / self.variance_distance_m.powi(2);
        let larger = farther * (1.0 + self.doubt * (1.0 - objectness.clamp(0.0, 1.0)).sqrt());
        let (across, along) = (self.lateral_variance_m2 * larger, self.range_variance_m2 * larger);
        let line = sight_world.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vec3::zeros);
        Matrix3::from_diagonal_element(across) + line * line.transpose() * (along - across)
    }
}

impl Track {
    fn new(config: &TargetConfig, stamp: Time, detection: &Detection) -> Self {
        Self {
            motion: Motion {
                pos: detection.pos_world,
                vel: Vec3::zeros(),
                pos_var: config.covariance(detection.sight_world, detection.objectness),
                cross: Matrix3::zeros(),
                // Half the largest speed as one standard deviation.
                vel_var: Matrix3::from_diagonal_element((0.5 * config.max_speed_mps).powi(2)),
            },
            stamp,
            last_seen: stamp,
            history: 1,
            strength: detection.objectness,
            confirmed: false,
            beyond_reach: false,
        }
    }

    fn predict(&mut self, config: &TargetConfig, now: Time) {
        let dt = now.since(self.stamp);
        if dt > 0.0 {
            self.motion.predict(dt, config.acc_variance_mps2);
            self.stamp = now;
        }
    }

    /// |x_temp - x| of eq. 10, in standard deviations: a correction K ν measured in its own covariance K S Kᵀ has the
    /// squared length νᵀ S⁻¹ ν, so positions and velocities need no common unit and the gate widens while blind.
    fn inconsistency(&self, detection: &Detection, covariance: &Matrix3<f64>) -> f64 {
        let innovation = detection.pos_world - self.motion.pos;
        let precision = (self.motion.pos_var + covariance).try_inverse();
        precision.map_or(f64::INFINITY, |precision| innovation.dot(&(precision * innovation)).sqrt())
    }

    /// The gate of eq. 10. It is no wider for a doubtful detection than for a sure one: before a target that is hidden, a
    /// branch looks a little like it, and must not pass for it.
    fn takes(&self, config: &TargetConfig, detection: &Detection) -> bool {
        usable(config, detection)
            && self.inconsistency(detection, &config.covariance(detection.sight_world, 1.0)) <= config.gate_sigmas
    }

    fn update(&mut self, config: &TargetConfig, extensions: &Extensions, detection: &Detection) {
        let covariance = config.covariance(detection.sight_world, detection.objectness);
        let far = if extensions.outliers { self.inconsistency(detection, &covariance) / OUTLIER } else { 0.0 };
        let wrong = far.max(1.0);
        self.motion.update(detection.pos_world, &(covariance * (wrong * wrong)));
        let speed = self.motion.vel.norm();
        if speed > config.max_speed_mps {
            self.motion.vel *= config.max_speed_mps / speed;
        }
        self.last_seen = self.stamp;
    }

    /// One frame: predicts, marks the detections that are its own, and takes the surest of them, or the one that fits
    /// best, which it tells.
    fn step<const N: usize>(
        &mut self,
        (config, extensions): (&TargetConfig, &Extensions),
        now: Time,
        detections: &[Option<Detection>; N],
        consistent: &mut [bool; N],
    ) -> Option<Taken> {
        self.predict(config, now);
        let worth = |detection: &Detection| {
            if extensions.weighted_detections {
                detection.objectness
            } else {
                -self.inconsistency(detection, &config.covariance(detection.sight_world, 1.0))
            }
        };
        let mut surest: Option<&Detection> = None;
        for (detection, own) in detections.iter().zip(consistent.iter_mut()) {
            let Some(detection) = detection else { continue };
            if self.takes(config, detection) {
                *own = true;
                if surest.is_none_or(|best| worth(detection) > worth(best)) {
                    surest = Some(detection);
                }
            }
        }
        let taken = surest.map(|detection| Taken {
            innovation_world: detection.pos_world - self.motion.pos,
            sigmas: self.inconsistency(detection, &config.covariance(detection.sight_world, 1.0)),
            objectness: detection.objectness,
        });
        if let Some(detection) = surest {
            self.update(config, extensions, detection);
            self.strength += (detection.objectness - self.strength) / f64::from(config.confirm_of);
        }
        self.history = self.history << 1 | u32::from(surest.is_some());
        taken
    }

    fn is_seen_often(&self, config: &TargetConfig) -> bool {
        let window = u32::MAX >> (32 - config.confirm_of);
        (self.history & window).count_ones() >= config.confirm_hits
    }

    /// The mean objectness from which on it may be believed.
    fn least(&self, config: &TargetConfig) -> f64 {
        if self.beyond_reach { config.sure_objectness } else { config.confirm_objectness }
    }

    /// What is seen often looks like the target often enough.
    fn convinces(&self, config: &TargetConfig) -> bool {
        self.is_seen_often(config) && self.strength >= self.least(config)
    }

    /// Unconfirmed, it dies of more blank frames in a row than confirmation could have forgiven, or of old age.
    fn is_forgotten(&self, config: &TargetConfig, now: Time) -> bool {
        let blank = self.history.trailing_zeros();
        blank > config.confirm_of - config.confirm_hits || hidden_for(self.last_seen, now) > config.blind_time_s
    }

    fn estimate(&self) -> TargetEstimate {
        let m = &self.motion;
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&m.pos_var);
        covariance.fixed_view_mut::<3, 3>(0, 3).copy_from(&m.cross);
        covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&m.cross.transpose());
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&m.vel_var);
        TargetEstimate {
            stamp: self.stamp,
            pos_world: m.pos,
            vel_world: m.vel,
            covariance,
            confirmed: self.confirmed,
            last_seen: self.last_seen,
        }
    }
}

impl TargetFilter {
    /// A filter that has seen nothing.
    #[must_use]
    pub fn new(config: TargetConfig, extensions: Extensions) -> Self {
        Self { config, extensions, track: None, lost: None, rival: None, look: None }
    }

    /// The same tracks, from here on by other rules.
    pub(crate) fn with(self, config: TargetConfig, extensions: Extensions) -> Self {
        Self { config, extensions, ..self }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::new(self.config, self.extensions);
    }

    /// Moves and turns what is known along: the odometry's frame jumped, the target did not. Its covariance is nearly
    /// alike on both level axes, and stays.
    pub fn shift(&mut self, jump: &Jump) {
        for track in [&mut self.track, &mut self.lost, &mut self.rival].into_iter().flatten() {
            track.motion.pos = jump.seen(&track.motion.pos);
            track.motion.vel = jump.turned(&track.motion.vel);
        }
    }

    /// One frame at `now` with the detections that passed the objectness filter (`None`: no detection there). Marks in
    /// `consistent` which of them are of the target; all false while there is no believed target.
    pub fn step<const N: usize>(&mut self, now: Time, detections: &[Option<Detection>; N], consistent: &mut [bool; N]) {
        *consistent = [false; N];
        self.look = None;
        // Frames were missing for as long as a target is believed unseen: it is lost, as after so many blank ones. By now
        // its gate takes anything.
        if self.track.is_some_and(|track| now.since(track.stamp) > self.config.blind_time_s) {
            self.judge(now);
            self.rival = None;
        }
        if let Some(track) = &mut self.track {
            let taken = track.step((&self.config, &self.extensions), now, detections, consistent);
            let passed = consistent.iter().filter(|own| **own).count() as u32;
            self.judge(now);
            if self.extensions.rivals {
                self.compete(now, detections, consistent);
            }
            self.look = Some(TargetLook {
                detections: detections.iter().flatten().count() as u32,
                passed,
                gate_sigmas: self.config.gate_sigmas,
                taken,
                rival: self.rival(),
            });
        }
        if self.track.is_none() {
            self.acquire(now, detections);
        }
        if !self.is_confirmed() {
            *consistent = [false; N];
        }
    }

    /// What is held by mistake, or not yet believed, must not hide the true target: whatever is seen beside it becomes a
    /// rival.
    fn compete<const N: usize>(&mut self, now: Time, detections: &[Option<Detection>; N], consistent: &mut [bool; N]) {
        let Some(track) = self.track else {
            self.rival = None;
            return;
        };
        let others = std::array::from_fn(|k| detections[k].filter(|_| !consistent[k]));
        let Some(rival) = &mut self.rival else {
            self.rival = self.hypothesis(now, &others);
            return;
        };
        let mut of_rival = [false; N];
        rival.step((&self.config, &self.extensions), now, &others, &mut of_rival);
        let stronger = rival.strength > track.strength + STRONGER;
        let instead = rival.strength >= self.config.sure_objectness && !track.is_seen_often(&self.config);
        if rival.convinces(&self.config) && (!track.confirmed || stronger || instead) {
            self.track = self.rival.take().map(|rival| Track { confirmed: true, ..rival });
            self.lost = None;
            *consistent = of_rival;
        } else if rival.is_forgotten(&self.config, now) {
            self.rival = None;
        }
    }

    /// The rival, and what it lacks, by the conditions of [`Self::compete`].
    fn rival(&self) -> Option<Rival> {
        let (rival, track) = (self.rival?, self.track?);
        let instead = if track.is_seen_often(&self.config) { f64::INFINITY } else { self.config.sure_objectness };
        let place = if track.confirmed { instead.min(track.strength + STRONGER) } else { 0.0 };
        Some(Rival {
            pos_world: rival.motion.pos,
            objectness: rival.strength,
            needed: place.max(rival.least(&self.config)),
        })
    }

    /// Confirms, or gives up, the track.
    fn judge(&mut self, now: Time) {
        let Some(track) = &mut self.track else { return };
        if track.convinces(&self.config) {
            track.confirmed = true;
            self.lost = None;
        }
        if track.confirmed && hidden_for(track.last_seen, now) > self.config.blind_time_s {
            track.confirmed = false;
            self.lost = Some(*track);
            self.track = None;
        } else if !track.confirmed && track.is_forgotten(&self.config, now) {
            self.track = None;
        }
    }

    fn acquire<const N: usize>(&mut self, now: Time, detections: &[Option<Detection>; N]) {
        self.track = self.hypothesis(now, detections);
        if self.config.confirm_hits == 1 {
            self.judge(now);
        }
    }

    /// Begins at the likeliest detection that a lost target can have reached, or that looks sure by itself: what was
    /// believed of the lost one may be wrong.
    fn hypothesis<const N: usize>(&self, now: Time, detections: &[Option<Detection>; N]) -> Option<Track> {
        let sure = |detection: &Detection| detection.objectness >= self.config.sure_objectness;
        let worth = |d: &&Detection| usable(&self.config, d) && (self.is_reachable(now, d) || sure(d));
        let likeliest =
            detections.iter().flatten().filter(worth).max_by(|a, b| a.objectness.total_cmp(&b.objectness))?;
        let beyond_reach = !self.is_reachable(now, likeliest);
        Some(Track { beyond_reach, ..Track::new(&self.config, now, likeliest) })
    }

    /// The lost target, if there is one, can have run there.
    fn is_reachable(&self, now: Time, detection: &Detection) -> bool {
        self.lost.is_none_or(|lost| {
            let (hidden, margin) = (hidden_for(lost.last_seen, now), self.config.reacquire_margin_m);
            let moved = detection.pos_world - lost.motion.pos;
            let turned = moved - lost.motion.vel * now.since(lost.stamp);
            moved.norm() <= margin + self.config.max_speed_mps * hidden
                && turned.norm() <= margin + 0.5 * self.config.max_acc_mps2 * hidden * hidden
        })
    }

    /// Where the target, believed now or until it was lost, should be at `now`.
    #[must_use]
    pub fn expected(&self, now: Time) -> Option<Expected> {
        let track = self.track.filter(|track| track.confirmed).or(self.lost)?;
        Some(Expected::of(&track.estimate(), now))
    }

    /// The target is believed.
    #[must_use]
    pub fn is_confirmed(&self) -> bool {
        self.track.is_some_and(|track| track.confirmed)
    }

    /// What it made of the last frame's detections; none: it held nothing to compare them with.
    #[must_use]
    pub fn look(&self) -> Option<TargetLook> {
        self.look
    }

    /// The estimate; once lost, the place and velocity at which it was believed last; none before the first detection.
    #[must_use]
    pub fn estimate(&self) -> Option<TargetEstimate> {
        match (&self.track, &self.lost) {
            (Some(track), _) if track.confirmed => Some(track.estimate()),
            (_, Some(lost)) => Some(lost.estimate()),
            (Some(track), None) => Some(track.estimate()),
            (None, None) => None,
        }
    }
}

fn usable(config: &TargetConfig, detection: &Detection) -> bool {
    detection.sight_world.norm() <= config.max_distance_m
        && detection.pos_world.iter().all(|x| x.is_finite())
        && (0.0..=1.0).contains(&detection.objectness)
}
