use super::*;
use crate::messages::HEARTBEAT_DATA;

/// 2026 or so.
const NOW: u64 = 36_000_000_000_000;

fn now() -> u64 {
    NOW
}

fn key(first: u8) -> SigningKey {
    let mut bytes = [7; 32];
    bytes[0] = first;
    SigningKey::new(bytes)
}

fn signer(first: u8) -> Signer {
    Signer::new(key(first), None, now)
}

fn frame(signer: &Signer, component_id: u8) -> MAVLinkV2MessageRaw {
    let header = MavHeader { system_id: 1, component_id, sequence: 0 };
    let mut raw = MAVLinkV2MessageRaw::new();
    signer.sign(&mut raw, header, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()), Stream::Housekeeping);
    raw
}

#[test]
fn what_one_side_signs_the_other_believes_once() {
    let (ours, theirs) = (signer(1), signer(1));
    let mut verifier = Verifier::default();
    let (first, second) = (frame(&theirs, 1), frame(&theirs, 1));
    assert_eq!(verifier.judge(&ours, first.raw_bytes()), Verdict::Good);
    assert_eq!(verifier.judge(&ours, first.raw_bytes()), Verdict::Stale, "a repetition");
    assert_eq!(verifier.judge(&ours, second.raw_bytes()), Verdict::Good);
    assert_eq!(verifier.judge(&ours, first.raw_bytes()), Verdict::Stale, "an older one");
}

#[test]
fn another_key_a_changed_bit_and_no_signature_are_told_apart() {
    let (ours, theirs) = (signer(1), signer(1));
    let mut verifier = Verifier::default();
    assert_eq!(verifier.judge(&ours, frame(&signer(2), 1).raw_bytes()), Verdict::Wrong);
    let good = frame(&theirs, 1);
    for bit in 0..good.raw_bytes().len() * 8 {
        let mut bytes = good.raw_bytes().to_vec();
        bytes[bit / 8] ^= 1 << (bit % 8);
        // The length, and whether there is a signature, are the framing's to judge, with the checksum.
        if !matches!(bit / 8, 0..=2) {
            assert_eq!(verifier.judge(&ours, &bytes), Verdict::Wrong, "bit {bit}");
        }
    }
    let mut unsigned = MAVLinkV2MessageRaw::new();
    unsigned.serialize_message(MavHeader::default(), &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
    assert_eq!(verifier.judge(&ours, unsigned.raw_bytes()), Verdict::Unsigned);
    unsigned = MAVLinkV2MessageRaw::new();
    unsigned.serialize_message(MavHeader::default(), &MavMessage::RADIO_STATUS(RADIO_STATUS_DATA::default()));
    assert_eq!(verifier.judge(&ours, unsigned.raw_bytes()), Verdict::Good, "a radio knows no keys");
}

#[test]
fn a_new_stream_may_be_a_minute_behind_and_not_more() {
    let ours = signer(1);
    let behind = |seconds: u64| Signer { newest: AtomicU64::new(NOW - seconds * PER_SECOND), key: key(1), wall: || 0 };
    let mut verifier = Verifier::default();
    assert_eq!(verifier.judge(&ours, frame(&behind(59), 1).raw_bytes()), Verdict::Good);
    assert_eq!(verifier.judge(&ours, frame(&behind(61), 2).raw_bytes()), Verdict::Stale);
}

#[test]
fn the_newest_stamp_heard_is_followed() {
    let ours = signer(1);
    let ahead = Signer { newest: AtomicU64::new(NOW + 500 * PER_SECOND), key: key(1), wall: || 0 };
    assert_eq!(Verifier::default().judge(&ours, frame(&ahead, 1).raw_bytes()), Verdict::Good);
    assert!(frame(&ours, 191).signature_timestamp() > NOW + 500 * PER_SECOND);
}

#[test]
fn streams_are_forgotten_by_nobody_and_do_not_grow_without_end() {
    let (ours, theirs) = (signer(1), signer(1));
    let mut verifier = Verifier::default();
    let good = (0..=255).filter(|id| verifier.judge(&ours, frame(&theirs, *id).raw_bytes()) == Verdict::Good).count();
    assert_eq!(good, STREAMS);
}

#[test]
fn stamps_rise_whatever_the_wall_clock_does() {
    let begin = |saved| Signer::new(key(1), saved, now).newest();
    assert_eq!(begin(None), NOW);
    assert_eq!(begin(Some(NOW - 1)), NOW, "a clock that is right needs no help");
    assert_eq!(begin(Some(NOW + 5)), NOW + 5 + 20 * PER_SECOND, "one that went back goes on after what was used");
    assert_eq!(begin(Some(LARGEST)), LARGEST);
    let signer = signer(1);
    let stamps: Vec<u64> = (0..3).map(|_| frame(&signer, 1).signature_timestamp()).collect();
    assert_eq!(stamps, [NOW + 1, NOW + 2, NOW + 3], "in one 10 µs too");
}

#[test]
fn a_saved_stamp_is_read_back_and_nonsense_is_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("key.stamp");
    assert_eq!(saved_stamp(&path), None);
    save_stamp(&path, NOW).unwrap();
    assert_eq!(saved_stamp(&path), Some(NOW));
    for nonsense in ["", "soon", "-1", "281474976710656"] {
        std::fs::write(&path, nonsense).unwrap();
        assert_eq!(saved_stamp(&path), None, "{nonsense:?}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
}

#[test]
fn a_key_file_holds_32_bytes_or_their_digits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("key");
    let load = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        SigningKey::load(&path)
    };
    let bytes: [u8; 32] = std::array::from_fn(|k| k as u8 * 8);
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(load(&bytes).unwrap(), SigningKey::new(bytes));
    assert_eq!(load(format!("{digits}\n").as_bytes()).unwrap(), SigningKey::new(bytes));
    assert_eq!(load(digits.to_uppercase().as_bytes()).unwrap(), SigningKey::new(bytes));
    for bad in [&b""[..], b"a passphrase", &digits.as_bytes()[1..], digits.replace('8', "x").as_bytes(), &[0; 32]] {
        let error = load(bad).unwrap_err().to_string();
        assert!(error.contains("key") && error.lines().count() == 1, "{error}");
    }
    let missing = SigningKey::load(Path::new("/nowhere/key")).unwrap_err().to_string();
    assert!(missing.contains("/nowhere/key"), "{missing}");
    assert_eq!(format!("{:?}", SigningKey::new(bytes)), "SigningKey(…)", "a log shows no key");
}
