//! The simulator's end of the network: it dials the vehicle and keeps dialling.

use color_eyre::eyre::{Result, WrapErr};
use goshawk_bus::{Bus, Publisher};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use prost::Message;
use zenoh::Wait;

use super::local::Local;
use crate::trial::Scene;
use crate::world::page;

/// The session with its publishers.
pub(super) struct Session {
    bus: Bus,
    truth: Publisher,
    /// The frame in which people are told of the truth.
    local: Local,
}

impl Session {
    /// Dials `endpoint`; answers queries for the world.
    pub(super) fn dial(vehicle: &str, endpoint: &str, scene: &Scene, local: Local) -> Result<Self> {
        let bus = Bus::dial(vehicle.parse()?, endpoint)?;
        let truth = bus.publisher(Key::SimTruth)?;
        let world = local.of_world(scene.world.to_proto());
        bus.queryable(Key::SimWorld, move |query| {
            let asked = query.payload().map(|payload| payload.to_bytes().into_owned()).unwrap_or_default();
            let Ok(asked) = v1::SimWorldRequest::decode(asked.as_slice()) else { return };
            let page = page(&world, asked.first as usize).encode_to_vec();
            if let Err(e) = query.reply(query.key_expr().clone(), page).wait() {
                tracing::warn!("the world could not be sent: {e}");
            }
        })?;
        Ok(Self { bus, truth, local })
    }

    pub(super) fn publisher(&self, key: Key) -> Result<Publisher> {
        self.bus.publisher(key).wrap_err("cannot publish images")
    }

    pub(super) fn truth(&mut self, truth: v1::SimTruth) {
        self.truth.put(&self.local.of_truth(truth));
    }
}
