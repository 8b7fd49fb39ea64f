//! MAVLink 2 signing: what we send is signed, and what comes is believed only if it is.
//!
//! A signature is a link id, a time stamp (48 bits, 10 µs since 2015-01-01) and the first 6 bytes of SHA-256 over key
//! and frame. A stream (link, system, component) is believed only while its stamps rise, and a new one only if it is
//! not more than a minute behind the newest stamp known. So who stamps a frame must also send it before the next one of
//! its stream is stamped: the control thread, which waits for nobody, has a stream of its own.

use crate::messages::{MavMessage, RADIO_STATUS_DATA};
use crate::wire::error::AutopilotError;
use crate::wire::packet::is_signed;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};
use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// 2015-01-01 in seconds since 1970.
const EPOCH_S: u64 = 1_420_070_400;
/// Stamps a second.
const PER_SECOND: u64 = 100_000;
/// How far behind a new stream's first stamp may be: a minute, as MAVLink's signing says.
const NEW_STREAM: u64 = 60 * PER_SECOND;
/// How often the newest stamp is written down, s. Chosen by eye.
const SAVE_EVERY_S: f64 = 10.0;
/// Whoever writes it down looks so often whether it is time. Chosen by eye.
const LOOK: Duration = Duration::from_millis(50);
/// Streams remembered; each has shown a right signature.
const STREAMS: usize = 64;
/// The largest stamp: it has 48 bits.
const LARGEST: u64 = (1 << 48) - 1;
/// Bytes of a signature's value.
const VALUE: usize = 6;

/// The stream that a frame of ours belongs to; the value is its link id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Stream {
    /// What any thread sends, one after the other.
    Housekeeping = 0,
    /// What the control thread alone sends.
    Setpoints = 1,
}

/// The secret that both sides hold. It is never printed.
#[derive(Clone, PartialEq, Eq)]
pub struct SigningKey([u8; 32]);

impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SigningKey(…)")
    }
}

impl SigningKey {
    /// A key of these bytes.
    #[must_use]
    pub fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Reads a key file: 32 bytes, or 64 hexadecimal digits and at most white space around them.
    ///
    /// # Errors
    /// The file cannot be read, is neither, or is all zero, which is how ArduPilot says "no key".
    pub fn load(path: &Path) -> Result<Self, AutopilotError> {
        let error = |why: String| AutopilotError::SigningKey { path: path.to_owned(), why };
        let bytes = std::fs::read(path).map_err(|source| error(source.to_string()))?;
        let key = <[u8; 32]>::try_from(bytes.as_slice()).ok().or_else(|| hexadecimal(&bytes));
        match key {
            None => Err(error(format!(
                "it holds {} bytes: neither a key of 32 bytes nor its 64 hexadecimal digits",
                bytes.len()
            ))),
            Some(key) if key == [0; 32] => Err(error("it is all zero, which means no key".to_owned())),
            Some(key) => Ok(Self(key)),
        }
    }
}

fn hexadecimal(bytes: &[u8]) -> Option<[u8; 32]> {
    let digits = bytes.trim_ascii();
    let mut key = [0; 32];
    if digits.len() != 2 * key.len() {
        return None;
    }
    for (byte, pair) in key.iter_mut().zip(digits.chunks_exact(2)) {
        let digit = |c: u8| char::from(c).to_digit(16).map(|digit| digit as u8);
        *byte = 16 * digit(pair[0])? + digit(pair[1])?;
    }
    Some(key)
}

/// What the link signs with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SigningConfig {
    /// The secret.
    pub key: SigningKey,
    /// Where the newest stamp is kept over a restart; none: nowhere, the wall clock alone counts.
    pub stamps: Option<PathBuf>,
}

/// Signs; shared by threads, without a lock.
#[derive(Debug)]
pub(crate) struct Signer {
    key: SigningKey,
    newest: AtomicU64,
    wall: fn() -> u64,
}

impl Signer {
    /// Begins at `wall`, or after `saved` if the wall clock is behind it, as on a computer without a battery for its
    /// clock: then what may have been used since the last saving is skipped.
    pub(crate) fn new(key: SigningKey, saved: Option<u64>, wall: fn() -> u64) -> Self {
        let skipped = |saved: u64| saved.saturating_add(2 * SAVE_EVERY_S as u64 * PER_SECOND).min(LARGEST);
        let begin = match saved {
            Some(saved) if saved >= wall() => skipped(saved),
            _ => wall(),
        };
        Self { key, newest: AtomicU64::new(begin), wall }
    }

    /// The newest stamp used or heard.
    pub(crate) fn newest(&self) -> u64 {
        self.newest.load(Ordering::Relaxed)
    }

    /// Serialises a message and signs it with a stamp above all before it.
    pub(crate) fn sign(&self, raw: &mut MAVLinkV2MessageRaw, header: MavHeader, message: &MavMessage, stream: Stream) {
        self.newest.fetch_max((self.wall)(), Ordering::Relaxed);
        let stamp = self.newest.fetch_add(1, Ordering::Relaxed) + 1;
        raw.serialize_message_for_signing(header, message);
        *raw.signature_link_id_mut() = stream as u8;
        raw.signature_timestamp_bytes_mut().copy_from_slice(&stamp.to_le_bytes()[..6]);
        let mut value = [0; VALUE];
        raw.calculate_signature(&self.key.0, &mut value);
        raw.signature_value_mut().copy_from_slice(&value);
    }
}

/// What a frame's signature says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// To be believed.
    Good,
    /// There is none.
    Unsigned,
    /// Of another key, or of a changed frame.
    Wrong,
    /// Right, but of a stamp that was used before, or of a new stream far behind: a repetition, or a sender that has
    /// not heard us yet and goes by a clock that is behind.
    Stale,
}

/// Judges the frames that come.
#[derive(Debug, Default)]
pub(crate) struct Verifier {
    streams: HashMap<(u8, u8, u8), u64>,
}

impl Verifier {
    /// `frame` is one whole frame with a right checksum.
    pub(crate) fn judge(&mut self, signer: &Signer, frame: &[u8]) -> Verdict {
        if !is_signed(frame) {
            // Telemetry radios put their own messages between the others and know no keys.
            let radio = frame[7..10] == RADIO_STATUS_DATA::ID.to_le_bytes()[..3];
            return if radio { Verdict::Good } else { Verdict::Unsigned };
        }
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.as_mut_slice()[..frame.len()].copy_from_slice(frame);
        let mut value = [0; VALUE];
        raw.calculate_signature(&signer.key.0, &mut value);
        if value != raw.signature_value() {
            return Verdict::Wrong;
        }
        let stamp = raw.signature_timestamp();
        let stream = (raw.signature_link_id(), frame[5], frame[6]);
        let stale = match self.streams.get(&stream) {
            Some(last) => stamp <= *last,
            None => stamp.saturating_add(NEW_STREAM) < signer.newest() || self.streams.len() == STREAMS,
        };
        if stale {
            return Verdict::Stale;
        }
        self.streams.insert(stream, stamp);
        signer.newest.fetch_max(stamp, Ordering::Relaxed);
        Verdict::Good
    }
}

/// The wall clock as a stamp; 0 before 2015.
pub(crate) fn wall_clock() -> u64 {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let stamp = (since_1970.as_micros() / 10).saturating_sub(u128::from(EPOCH_S * PER_SECOND));
    u64::try_from(stamp).unwrap_or(LARGEST).min(LARGEST)
}

/// The stamp that was saved; none: none was, or it is not to be read, which a line of the log tells.
pub(crate) fn saved_stamp(path: &Path) -> Option<u64> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
        Err(error) => {
            tracing::warn!(path = %path.display(), %error, "the saved signing time stamp cannot be read");
            return None;
        }
    };
    let stamp = text.trim().parse().ok().filter(|stamp| *stamp <= LARGEST);
    if stamp.is_none() {
        tracing::warn!(path = %path.display(), "the saved signing time stamp is no number: the wall clock counts");
    }
    stamp
}

/// Saves the newest stamp as soon as one was used, and then every [`SAVE_EVERY_S`], until `ended`.
pub(crate) fn keep_stamps(path: &Path, signer: &Signer, ended: &Receiver<()>) {
    let (unused, mut failed, mut saved) = (signer.newest(), false, None::<Instant>);
    while ended.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
        if signer.newest() == unused || saved.is_some_and(|at| at.elapsed().as_secs_f64() < SAVE_EVERY_S) {
            continue;
        }
        saved = Some(Instant::now());
        match save_stamp(path, signer.newest()) {
            Ok(()) => failed = false,
            // Signing goes on; after a restart with a wrong wall clock the autopilot would refuse us for a while.
            Err(error) if !std::mem::replace(&mut failed, true) => {
                tracing::warn!(path = %path.display(), %error, "the signing time stamp cannot be saved");
            }
            Err(_) => {}
        }
    }
}

/// Replaces the saved stamp, whole or not at all.
pub(crate) fn save_stamp(path: &Path, stamp: u64) -> std::io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    std::fs::write(&beside, format!("{stamp}\n"))?;
    std::fs::rename(&beside, path)
}

#[cfg(test)]
mod tests;
