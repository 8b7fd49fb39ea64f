//! Messages to bytes.

use crate::messages::MavMessage;
use crate::wire::signing::{Signer, Stream};
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Gives one component's messages their header, sequence number and, where there is a key, signature. Shared by
/// threads.
#[derive(Debug)]
pub struct Encoder {
    system_id: u8,
    component_id: u8,
    sequence: AtomicU8,
    signer: Option<Arc<Signer>>,
}

impl Encoder {
    /// An encoder for the component that sends, without a key.
    #[must_use]
    pub fn new(system_id: u8, component_id: u8) -> Self {
        Self { system_id, component_id, sequence: AtomicU8::new(0), signer: None }
    }

    pub(crate) fn signed(self, signer: Option<Arc<Signer>>) -> Self {
        Self { signer, ..self }
    }

    /// The frame of `message`; `raw_bytes()` of it is what goes into a datagram.
    #[must_use]
    pub fn encode(&self, message: &MavMessage) -> MAVLinkV2MessageRaw {
        self.encode_in(Stream::Housekeeping, message)
    }

    /// [`Self::encode`], signed as part of `stream`.
    pub(crate) fn encode_in(&self, stream: Stream, message: &MavMessage) -> MAVLinkV2MessageRaw {
        let sequence = self.sequence.fetch_add(1, Ordering::Relaxed);
        let header = MavHeader { system_id: u32::from(self.system_id), component_id: self.component_id, sequence };
        let mut raw = MAVLinkV2MessageRaw::new();
        match &self.signer {
            Some(signer) => signer.sign(&mut raw, header, message, stream),
            None => raw.serialize_message(header, message),
        }
        raw
    }
}
