//! MAVLink 2 framing: bytes to packets and back. Total: any input gives packets and typed rejects, never a panic.

use crate::messages::MavMessage;
use mavlink::{MavHeader, MavlinkVersion, Message, calculate_crc};

/// First byte of a MAVLink 2 frame.
pub const MAGIC: u8 = mavlink::MAV_STX_V2;
/// Bytes before the payload.
const HEADER: usize = 10;
/// Bytes of the checksum behind the payload.
const CHECKSUM: usize = 2;
/// Bytes of a signature behind that.
const SIGNATURE: usize = 13;
/// The flag of a packet that is signed.
const SIGNED: u8 = 0x01;

/// One message with its sender.
#[derive(Clone, Debug)]
pub struct Packet {
    /// Sender's system and component, and its sequence number.
    pub header: MavHeader,
    /// The message.
    pub message: MavMessage,
}

/// Why bytes were not a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reject {
    /// Bytes that do not begin a MAVLink 2 frame (one report for a run of them).
    Garbage,
    /// A frame that ends before its length says.
    Truncated,
    /// Incompatibility flags that we do not understand: the protocol demands that the frame be dropped.
    Flags,
    /// The checksum is wrong.
    Checksum,
    /// A message that the dialect does not hold.
    Unknown,
    /// A right checksum around a payload that does not decode, such as an enum value from the future.
    Payload,
}

/// A reject with its sender, where the frame is whole enough to tell: an id that only we do not know is no loss.
#[derive(Clone, Copy, Debug)]
pub struct Rejected {
    /// What was wrong.
    pub why: Reject,
    /// Whose it was.
    pub from: Option<MavHeader>,
}

impl From<Reject> for Rejected {
    fn from(why: Reject) -> Self {
        Self { why, from: None }
    }
}

/// The whole length of the frame that begins `bytes`, if that much of it is there to tell.
#[must_use]
pub fn frame_length(bytes: &[u8]) -> Option<usize> {
    match bytes {
        [MAGIC, payload, flags, ..] => {
            let signature = if flags & SIGNED == 0 { 0 } else { SIGNATURE };
            Some(HEADER + usize::from(*payload) + CHECKSUM + signature)
        }
        _ => None,
    }
}

/// A whole frame carries a signature.
pub(crate) fn is_signed(frame: &[u8]) -> bool {
    frame[2] & SIGNED != 0
}

/// Calls `each` for every packet and every reject in `bytes` (a datagram), in order. Signatures are skipped, not
/// checked. After a bad frame the search goes on at the next frame start.
pub fn for_each_packet(bytes: &[u8], mut each: impl FnMut(Result<Packet, Reject>)) {
    for_each_frame(bytes, true, |result| each(result.map(|(packet, _)| packet).map_err(|rejected| rejected.why)));
}

/// As [`for_each_packet`], with the bytes of each packet's frame. `whole`: nothing follows `bytes`, so that a frame that
/// does not end there is cut short; else it waits for the rest. Gives how many bytes are done with.
pub fn for_each_frame(bytes: &[u8], whole: bool, mut each: impl FnMut(Result<(Packet, &[u8]), Rejected>)) -> usize {
    let mut rest = bytes;
    while !rest.is_empty() {
        if rest[0] != MAGIC {
            each(Err(Reject::Garbage.into()));
            rest = &rest[next_magic(rest)..];
            continue;
        }
        let Some(frame) = frame_length(rest).and_then(|length| rest.get(..length)) else {
            if !whole {
                break;
            }
            each(Err(Reject::Truncated.into()));
            rest = &rest[1 + next_magic(&rest[1..])..];
            continue;
        };
        let packet = parse_frame(frame);
        // A wrong length byte makes a wrong checksum: then trust the length only if it lands on a frame start.
        let follows = rest.get(frame.len());
        if packet.is_err() && follows.is_none() && !whole {
            break; // not known yet
        }
        let lands = follows.is_none_or(|byte| *byte == MAGIC);
        let used = match packet {
            Err(Reject::Checksum | Reject::Flags | Reject::Unknown) if !lands => 1 + next_magic(&rest[1..]),
            _ => frame.len(),
        };
        let known = matches!(packet, Err(Reject::Unknown | Reject::Payload)) && lands;
        let from = known.then(|| header(frame));
        each(packet.map(|packet| (packet, frame)).map_err(|why| Rejected { why, from }));
        rest = &rest[used..];
    }
    bytes.len() - rest.len()
}

fn next_magic(bytes: &[u8]) -> usize {
    bytes.iter().position(|byte| *byte == MAGIC).unwrap_or(bytes.len())
}

/// `frame` is one whole frame, as [`frame_length`] measures it.
fn parse_frame(frame: &[u8]) -> Result<Packet, Reject> {
    let payload_end = HEADER + usize::from(frame[1]);
    if frame[2] & !SIGNED != 0 {
        return Err(Reject::Flags);
    }
    let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    let sent = u16::from_le_bytes([frame[payload_end], frame[payload_end + 1]]);
    if calculate_crc(&frame[1..payload_end], MavMessage::extra_crc(id)) != sent {
        let known = MavMessage::default_message_from_id(id).is_some();
        return Err(if known { Reject::Checksum } else { Reject::Unknown });
    }
    let message =
        MavMessage::parse(MavlinkVersion::V2, id, &frame[HEADER..payload_end]).map_err(|error| match error {
            mavlink::error::ParserError::UnknownMessage { .. } => Reject::Unknown,
            _ => Reject::Payload,
        })?;
    Ok(Packet { header: header(frame), message })
}

/// Whose a whole frame is.
fn header(frame: &[u8]) -> MavHeader {
    MavHeader { system_id: u32::from(frame[5]), component_id: frame[6], sequence: frame[4] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{HEARTBEAT_DATA, TIMESYNC_DATA};
    use crate::wire::encode::Encoder;
    use proptest::prelude::*;

    fn parse(bytes: &[u8]) -> Vec<Result<Packet, Reject>> {
        let mut all = Vec::new();
        for_each_packet(bytes, |one| all.push(one));
        all
    }

    fn frames() -> Vec<u8> {
        let encoder = Encoder::new(1, 1);
        let mut bytes = encoder.encode(&MavMessage::HEARTBEAT(HEARTBEAT_DATA::default())).raw_bytes().to_vec();
        let timesync = TIMESYNC_DATA { tc1: 0, ts1: 0x00FD_1234_5678, ..TIMESYNC_DATA::default() };
        bytes.extend_from_slice(encoder.encode(&MavMessage::TIMESYNC(timesync)).raw_bytes());
        bytes
    }

    #[test]
    fn one_datagram_may_hold_several_packets() {
        let got = parse(&frames());
        assert_eq!(got.len(), 2);
        let sequences: Vec<u8> = got.iter().map(|packet| packet.as_ref().unwrap().header.sequence).collect();
        assert_eq!(sequences, [0, 1]);
    }

    #[test]
    fn a_flipped_bit_anywhere_never_gives_a_wrong_packet_and_the_next_one_is_found() {
        let clean = frames();
        let first = frame_length(&clean).unwrap();
        for bit in 0..first * 8 {
            let mut bytes = clean.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            let good: Vec<_> = parse(&bytes).into_iter().flatten().collect();
            assert!(
                good.iter().all(|packet| matches!(packet.message, MavMessage::TIMESYNC(_))),
                "bit {bit} made a packet: {good:?}"
            );
            assert_eq!(good.len(), 1, "bit {bit} hid the next packet");
        }
    }

    #[test]
    fn a_truncated_packet_is_called_so() {
        let bytes = frames();
        let first = frame_length(&bytes).unwrap();
        for length in 1..first {
            assert_eq!(parse(&bytes[..length])[0].as_ref().unwrap_err(), &Reject::Truncated, "{length}");
        }
    }

    #[test]
    fn a_message_of_another_dialect_is_called_unknown() {
        let mut bytes = frames();
        bytes.truncate(frame_length(&bytes).unwrap());
        bytes[7..10].copy_from_slice(&[0x11, 0x22, 0x33]);
        assert_eq!(parse(&bytes)[0].as_ref().unwrap_err(), &Reject::Unknown);
    }

    proptest! {
        #[test]
        fn any_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
            let reports = parse(&bytes).len();
            prop_assert!(reports <= bytes.len());
        }

        #[test]
        fn any_payload_with_a_right_checksum_is_survived(
            id in prop_oneof![0u32..500, Just(331), Just(410), Just(436), Just(253), 0u32..20_000],
            flags in 0u8..4,
            payload in proptest::collection::vec(any::<u8>(), 0..255),
        ) {
            let mut bytes = vec![MAGIC, payload.len() as u8, flags, 0, 7, 1, 1];
            bytes.extend_from_slice(&id.to_le_bytes()[..3]);
            bytes.extend_from_slice(&payload);
            let crc = calculate_crc(&bytes[1..], MavMessage::extra_crc(id));
            bytes.extend_from_slice(&crc.to_le_bytes());
            if flags & SIGNED != 0 {
                bytes.extend_from_slice(&[0; SIGNATURE]);
            }
            prop_assert!(!parse(&bytes).is_empty());
        }

        #[test]
        fn a_stream_cut_anywhere_gives_the_same_packets(cuts in proptest::collection::vec(0usize..60, 0..6)) {
            let bytes = [frames(), frames()].concat();
            let mut ends: Vec<usize> = cuts.into_iter().map(|cut| cut.min(bytes.len())).collect();
            ends.sort_unstable();
            ends.push(bytes.len());
            let (mut held, mut begin, mut packets) = (Vec::new(), 0, 0);
            for end in ends {
                held.extend_from_slice(&bytes[begin..end]);
                begin = end;
                let used = for_each_frame(&held, false, |packet| {
                    assert!(packet.is_ok());
                    packets += 1;
                });
                held.drain(..used);
            }
            prop_assert_eq!((packets, held.len()), (4, 0));
        }

        #[test]
        fn packets_among_garbage_are_found(noise in proptest::collection::vec(0u8..0xFD, 0..40)) {
            let mut bytes = noise;
            bytes.extend_from_slice(&frames());
            prop_assert_eq!(parse(&bytes).iter().filter(|packet| packet.is_ok()).count(), 2);
        }
    }
}
