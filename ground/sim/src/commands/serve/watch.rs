//! What the simulator knows of a flight and the vehicle does not: clearance, collisions, where the target is.

use goshawk_core::{Time, Vec3};
use goshawk_proto::v1;

use crate::actors::evader::EvaderState;
use crate::trial::Truth;
use crate::trial::judge::{clearance, contact};
use crate::vehicle::quadrotor::QuadrotorState;
use crate::world::{Part, World};

/// Contacts closer together than this are one collision, s.
const ONE_COLLISION_S: f64 = 1.0;

/// An evader that is so far back on its way at once is another one, m.
const ANOTHER_M: f64 = 1.0;

/// What is around the vehicle at one instant.
pub(super) struct Surroundings<'a> {
    pub(super) world: &'a World,
    pub(super) moving: Vec<Part>,
    pub(super) evader: Option<EvaderState>,
}

/// Gathers as the flight goes on.
#[derive(Clone, Debug)]
pub(super) struct Watch {
    evader: Option<EvaderState>,
    /// What the evaders before this one ran, m.
    ran_m: f64,
    moving: Vec<Part>,
    clearance_m: f64,
    least_clearance_m: f64,
    collisions: u32,
    last_contact: Option<Time>,
    visible: bool,
    looks: u64,
    looks_in_view: u64,
    most_distance_m: f64,
}

impl Default for Watch {
    fn default() -> Self {
        Self {
            evader: None,
            ran_m: 0.0,
            moving: Vec::new(),
            clearance_m: f64::INFINITY,
            least_clearance_m: f64::INFINITY,
            collisions: 0,
            last_contact: None,
            visible: false,
            looks: 0,
            looks_in_view: 0,
            most_distance_m: 0.0,
        }
    }
}

impl Watch {
    /// Looks once. `chase`: the vehicle is in the air, and the evader has begun to run.
    pub(super) fn look(
        &mut self,
        now: Time,
        around: Surroundings<'_>,
        vehicle: &QuadrotorState,
        chase: bool,
        visible: bool,
    ) {
        let (at, Surroundings { world, moving, evader }) = (vehicle.pos_world, around);
        self.clearance_m = clearance(world, &moving, &at);
        self.visible = visible;
        if chase {
            self.least_clearance_m = self.least_clearance_m.min(self.clearance_m);
        }
        // Coming down to land is no collision with the ground.
        if contact(world, &moving, &at, self.clearance_m, evader.as_ref(), false).is_some() {
            if self.last_contact.is_none_or(|last| now.since(last) > ONE_COLLISION_S) {
                self.collisions += 1;
            }
            self.last_contact = Some(now);
        }
        if chase && let Some(evader) = evader.filter(|e| !e.arrived) {
            self.looks += 1;
            self.looks_in_view += u64::from(visible);
            self.most_distance_m = self.most_distance_m.max((evader.centre_world() - at).norm());
        }
        // Who comes back goes back by steps; another one begins anew.
        let before_m = self.evader.map_or(0.0, |evader| evader.path_m);
        if evader.is_some_and(|evader| before_m - evader.path_m > ANOTHER_M) {
            self.ran_m += before_m;
        }
        (self.evader, self.moving) = (evader, moving);
    }

    /// `goal_world`: where a navigation leads.
    pub(super) fn truth(&self, now: Time, vehicle: &QuadrotorState, goal_world: Option<Vec3>) -> v1::SimTruth {
        let &Self { evader, ref moving, clearance_m, visible, .. } = self;
        let collisions = self.collisions;
        Truth { vehicle, evader, moving, clearance_m, collisions, visible, goal_world }.to_proto(now)
    }

    /// One line for the end.
    pub(super) fn summary(&self, frames: u64, skipped_s: f64) -> String {
        let in_view = if self.looks == 0 { 0.0 } else { 100.0 * self.looks_in_view as f64 / self.looks as f64 };
        let clearance = if self.least_clearance_m.is_finite() {
            format!("{:.2} m", self.least_clearance_m)
        } else {
            "none measured".to_owned()
        };
        let mut line = self.evader.map_or(String::new(), |evader| {
            let (way, most) = (self.ran_m + evader.path_m, self.most_distance_m);
            format!("the target ran {way:.1} m, in view {in_view:.0} % of the time, at most {most:.1} m away; ")
        });
        line += &format!("least clearance {clearance}, {} collisions; {frames} images", self.collisions);
        if skipped_s > 0.0 {
            line += &format!("; this machine could not keep up: {skipped_s:.1} s were skipped");
        }
        line
    }
}
