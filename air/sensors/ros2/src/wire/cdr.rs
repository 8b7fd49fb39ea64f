//! CDR as ROS 2 sends it: four bytes that say how, then the message.

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize};

/// Little-endian plain CDR, and two bytes of options.
const HEADER: [u8; 4] = [0, 1, 0, 0];
/// A sender may fill the last word, bytes.
const MOST_PADDING: usize = 7;

/// Why bytes are not the message.
#[derive(Debug, thiserror::Error)]
pub enum CdrError {
    /// Not even the four bytes.
    #[error("{0} bytes are no CDR message")]
    Short(usize),
    /// Parameter lists, XCDR2 and what else there may be; ROS 2 sends none of them.
    #[error("encapsulation {0:02x} {1:02x} is not plain CDR")]
    Encapsulation(u8, u8),
    /// A field does not fit.
    #[error("not of this type: {0}")]
    Field(#[from] cdr_encoding::Error),
    /// More bytes than the type has.
    #[error("not of this type: {0} bytes are left over")]
    Longer(usize),
}

/// The message that `bytes` hold, of either byte order.
///
/// # Errors
/// They hold another one, or none.
pub fn decode<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, CdrError> {
    let (header, body) = bytes.split_first_chunk::<4>().ok_or(CdrError::Short(bytes.len()))?;
    let (message, used) = match header {
        [0, 0, ..] => cdr_encoding::from_bytes::<T, BigEndian>(body)?,
        [0, 1, ..] => cdr_encoding::from_bytes::<T, LittleEndian>(body)?,
        [a, b, ..] => return Err(CdrError::Encapsulation(*a, *b)),
    };
    let left = body.len() - used;
    if left > MOST_PADDING { Err(CdrError::Longer(left)) } else { Ok(message) }
}

/// `message` in little-endian CDR.
///
/// # Panics
/// Never: every message has a length, and memory takes what is written.
#[must_use]
pub fn encode(message: &impl Serialize) -> Vec<u8> {
    let mut bytes = HEADER.to_vec();
    let body = cdr_encoding::to_vec::<_, LittleEndian>(message).expect("every message has a length");
    bytes.extend_from_slice(&body);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::messages::{CameraInfo, CompressedImage, Image, MarkerArray, Odometry, PoseStamped, Stamp};
    use proptest::prelude::*;

    /// A stamp of 1 s and 2 ns and the frame `a`, 1 × 2 px of `mono8`, in big endian: worked out by hand.
    const BIG: [u8; 52] = [
        0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 2, b'a', 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0, 6, b'm', b'o',
        b'n', b'o', b'8', 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 7, 8, 0, 0,
    ];

    #[test]
    fn big_endian_and_padding_at_the_end_are_read() {
        let image: Image<'_> = decode(&BIG).unwrap();
        assert_eq!(image.header.stamp, Stamp { sec: 1, nanosec: 2 });
        assert_eq!((image.header.frame_id.as_str(), image.encoding.as_str()), ("a", "mono8"));
        assert_eq!((image.height, image.width, image.step, image.data), (2, 1, 1, &[7, 8][..]));
    }

    #[test]
    fn a_length_of_two_billion_is_refused_without_being_believed() {
        let mut bytes = BIG;
        bytes[44..48].copy_from_slice(&0x8000_0000_u32.to_be_bytes());
        assert!(matches!(decode::<Image<'_>>(&bytes), Err(CdrError::Field(_))));
        let mut info = encode(&CameraInfo::default());
        info[36..40].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(decode::<CameraInfo>(&info), Err(CdrError::Field(_))));
    }

    #[test]
    fn what_is_no_plain_cdr_or_another_type_is_refused() {
        assert!(matches!(decode::<Image<'_>>(&[0, 1]), Err(CdrError::Short(2))));
        assert!(matches!(decode::<Image<'_>>(&[0, 7, 0, 0, 1]), Err(CdrError::Encapsulation(0, 7))));
        let odometry = encode(&Odometry::default());
        assert!(matches!(decode::<PoseStamped>(&odometry), Err(CdrError::Longer(_))));
    }

    #[test]
    fn every_message_cut_anywhere_is_refused() {
        fn cuts<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> usize {
            (0..bytes.len()).filter(|&length| decode::<T>(&bytes[..length]).is_ok()).count()
        }
        assert_eq!(cuts::<Image<'_>>(&BIG[..50]), 0);
        assert_eq!(cuts::<Odometry>(&encode(&Odometry::default())), 0);
        assert_eq!(cuts::<CameraInfo>(&encode(&CameraInfo::default())), 0);
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400), big in any::<bool>()) {
            let bytes = [&[0, u8::from(!big), 0, 0], bytes.as_slice()].concat();
            let _ = decode::<Image<'_>>(&bytes);
            let _ = decode::<CompressedImage<'_>>(&bytes);
            let _ = decode::<CameraInfo>(&bytes);
            let _ = decode::<Odometry>(&bytes);
            let _ = decode::<PoseStamped>(&bytes);
            let _ = decode::<MarkerArray>(&bytes);
        }
    }
}
