//! Whatever comes from outside, damaged: read by the functions that read it in flight, which must refuse it or give what
//! the rest may believe. Each runs for a while (`BOLERO_RANDOM_TEST_TIME_MS`); `make fuzz` runs for longer.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::{Path, PathBuf};

use goshawk_air::network::access::Identity;
use goshawk_autopilot::wire::packet::for_each_frame;
use goshawk_autopilot::{Firmware, Guided, View, messages};
use goshawk_core::Time;
use goshawk_fuzz::run;
use goshawk_policy::Contract;
use goshawk_proto::keys::{Key, VehicleName};
use goshawk_proto::v1;
use goshawk_recorder::LogReader;
use goshawk_ros2 as ros2;
use goshawk_ros2::bridge;
use goshawk_ros2::camera::{Camera, Packing};
use goshawk_ros2::config::Kind;
use goshawk_ros2::images::pairing::Side;
use goshawk_ros2::motion::Motion;
use goshawk_ros2::wire::clock::Clocks;
use goshawk_sim::world::cloud::{self, CloudError};
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::desk;
use goshawk_vehicle::sensors;
use mavlink::{Message, calculate_crc};

/// What the seeds are stamped for.
const NOW: Time = Time(5_000_000_000);

fn scratch() -> &'static Path {
    Path::new(env!("CARGO_TARGET_TMPDIR"))
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn vehicle() -> Vehicle {
    Vehicle::load(&root().join("air/vehicles/sim.toml")).unwrap()
}

/// A refusal's message to a person is one line that says something.
fn refused(error: &impl ToString) -> bool {
    let text = error.to_string();
    assert!(!text.is_empty() && text.lines().count() == 1, "{text:?}");
    false
}

/// Takes `bytes` as a link does, in pieces of `piece`, into the view of a PX4 and of an ArduPilot. Was there a message?
fn take(bytes: &[u8], piece: usize) -> [bool; 1] {
    let mut messages = 0;
    for firmware in [Firmware::Px4, Firmware::ArduPilot(Guided::Guided)] {
        let mut view = View::new(1, 1, firmware);
        let (mut held, mut now) = (Vec::new(), NOW);
        for piece in bytes.chunks(piece) {
            held.extend_from_slice(piece);
            let used = for_each_frame(&held, false, |frame| match frame {
                Ok((packet, frame)) => {
                    assert!(frame.len() >= 12);
                    now = now.plus(0.01);
                    messages += 1;
                    view.accept(now, &packet);
                }
                Err(rejected) => view.reject(rejected.why, rejected.from),
            });
            held.drain(..used);
            assert!(held.len() <= 280 + piece.len(), "{} bytes wait for a frame's end", held.len());
        }
        if let Some(o) = view.odometry() {
            let vectors = [o.pos_world, o.vel_world, o.ang_vel_body];
            assert!(vectors.iter().all(|v| v.iter().all(|x| x.is_finite())), "{o:?}");
            assert!((o.world_from_body.norm() - 1.0).abs() < 1e-6, "{o:?}");
        }
        let battery = view.status(now).battery_fraction;
        assert!(battery.is_none_or(|fraction| (0.0..=1.0).contains(&fraction)), "{battery:?}");
        assert!(view.take_texts().len() <= 64 && view.take_events().len() <= 64);
    }
    [messages > 0]
}

/// Gives every frame the checksum that fits, so that damage reaches the messages.
fn mend(bytes: &mut [u8]) {
    let mut at = 0;
    while at + 12 <= bytes.len() {
        let end = at + 10 + usize::from(bytes[at + 1]);
        if bytes[at] != 0xFD || end + 2 > bytes.len() {
            at += 1;
            continue;
        }
        bytes[at + 2] &= 1;
        let id = u32::from_le_bytes([bytes[at + 7], bytes[at + 8], bytes[at + 9], 0]);
        let sum = calculate_crc(&bytes[at + 1..end], messages::MavMessage::extra_crc(id));
        bytes[end..end + 2].copy_from_slice(&sum.to_le_bytes());
        at = end + 2;
    }
}

#[test]
fn mavlink_stream() {
    run("mavlink", scratch(), |bytes| take(bytes, usize::from(bytes.first().copied().unwrap_or(0)) + 1));
}

#[test]
fn mavlink_messages() {
    run("mavlink_messages", scratch(), |bytes| {
        let mut bytes = bytes.to_vec();
        mend(&mut bytes);
        take(&bytes, 300)
    });
}

#[test]
fn sensors() {
    run("sensors", scratch(), |bytes| {
        let (frame, odometry) = (sensors::frame(bytes, NOW), sensors::odometry(bytes, NOW));
        let taken = [frame.is_ok(), odometry.is_ok()];
        if let Ok(frame) = frame {
            let pixels = frame.width * frame.height;
            assert!(pixels > 0 && frame.rgb.len() == 3 * pixels && frame.depth_mm.len() == pixels);
            assert!(frame.hfov.is_finite() && frame.vfov.is_finite());
            assert!(NOW.since(frame.stamp).abs() <= 1.0);
        }
        if let Ok(o) = odometry {
            let vectors = [o.pos_world, o.vel_world, o.ang_vel_body];
            assert!(vectors.iter().all(|v| v.iter().all(|x| x.is_finite())), "{o:?}");
            assert!((o.world_from_body.norm() - 1.0).abs() < 1e-6, "{o:?}");
        }
        taken
    });
}

/// When the seeds of `ros2` were stamped.
const THEN: Clocks = Clocks { monotonic: NOW.0 as i64, system: 1_700_000_000_000_000_000 };

#[test]
fn ros2() {
    let config = ros2::config::Config::load(&root().join("air/sensors/ros2/ros2.toml")).unwrap();
    let small = ros2::config::Camera { width: 16, height: 10, ..config.camera.unwrap() };
    let setup = config.odometry.unwrap();
    let good = fs::read(root().join("tests/fuzz/corpus/ros2/camera_info")).unwrap();
    run("ros2", scratch(), |bytes| {
        let lens = Camera::new(&small).info(bytes).is_ok();
        let camera = Camera::new(&small);
        camera.info(&good).unwrap();
        let [colour, depth, compressed] =
            [(Side::Colour, Packing::Raw), (Side::Depth, Packing::Raw), (Side::Colour, Packing::Compressed)].map(
                |(side, packing)| match camera.take(side, packing, bytes, &THEN) {
                    Ok(pair) => {
                        let fits = |m: &v1::Rgbd| (m.rgb.len(), m.depth_mm.len()) == (3 * 160, 2 * 160);
                        assert!(pair.as_ref().is_none_or(fits), "{pair:?}");
                        true
                    }
                    Err(why) => refused(&why),
                },
            );
        let [odometry, pose] = [Kind::Odometry, Kind::Pose].map(|kind| {
            let moved = bridge::moved(&mut Motion::new(&setup), kind, bytes, &THEN);
            if let Ok(Some(m)) = &moved {
                let vectors = [m.pos_world, m.vel_world, m.ang_vel_body];
                assert!(vectors.iter().flatten().all(|v| (v.x + v.y + v.z).is_finite()), "{m:?}");
            }
            moved.is_ok()
        });
        [lens, colour, depth, compressed, odometry, pose]
    });
}

#[test]
fn commands() {
    let vehicle = vehicle();
    run("commands", scratch(), |bytes| {
        [Key::CmdStart, Key::CmdStop].map(|key| match desk::parse(key, bytes, &vehicle) {
            Ok(parsed) => {
                assert!((1..=64).contains(&parsed.id.len()), "{parsed:?}");
                assert!(key == Key::CmdStop || vehicle.profile_names().contains(&parsed.profile), "{parsed:?}");
                true
            }
            Err((_, why)) => refused(&why),
        })
    });
}

#[test]
fn mcap() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    run("mcap", scratch(), |bytes| {
        fs::write(&path, bytes).unwrap();
        [match LogReader::open(&path) {
            Ok(log) => {
                assert!(log.damage().iter().all(|d| d.bytes.start <= d.bytes.end && d.bytes.end <= bytes.len()));
                let payloads: usize = log.entries().map(|entry| entry.payload.len()).sum();
                assert!(payloads < 1 << 28, "{payloads} bytes out of {}", bytes.len());
                true
            }
            Err(error) => refused(&error),
        }]
    });
}

/// Reads `bytes` as a cloud named `name`. The seeds have too few points for a world: what is shown is the reading.
fn cloud_of(target: &'static str, name: &str) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    run(target, scratch(), |bytes| {
        fs::write(&path, bytes).unwrap();
        [match cloud::load(&path) {
            Ok(_) => true,
            Err(error) => refused(&error) || matches!(error, CloudError::Empty { count: 1.., .. }),
        }]
    });
}

#[test]
fn ply() {
    cloud_of("ply", "cloud.ply");
}

#[test]
fn pcd() {
    cloud_of("pcd", "cloud.pcd");
}

#[test]
fn contract() {
    run("contract", scratch(), |bytes| match Contract::from_json(&String::from_utf8_lossy(bytes)) {
        Ok(contract) => {
            contract.validate().unwrap();
            let model = contract.model();
            assert!(model.v_max.is_finite() && model.a_max.is_finite() && model.width * model.height > 0);
            [true]
        }
        Err(error) => [refused(&error)],
    });
}

#[test]
fn keys() {
    run("keys", scratch(), |bytes| {
        let text = String::from_utf8_lossy(bytes);
        let key = Key::parse(&text);
        if let Some((key, vehicle)) = &key {
            assert_eq!(key.expression(vehicle), text);
        }
        let named = match text.parse::<VehicleName>() {
            Ok(name) => {
                assert!(!name.as_str().contains(['/', '*', '$', '?', '#', '@']) && !name.as_str().is_empty());
                true
            }
            Err(error) => refused(&error),
        };
        [key.is_some(), named]
    });
}

#[test]
fn vehicle_file() {
    let path = root().join("air/vehicles/sim.toml");
    let shipped = Vehicle::load(&path).unwrap();
    run("vehicle_file", scratch(), |bytes| {
        let text = String::from_utf8_lossy(bytes).into_owned();
        let vehicle = match Vehicle::parse(text.clone(), shipped.tuning_text.clone(), &path) {
            Ok(vehicle) => {
                vehicle.name.parse::<VehicleName>().unwrap();
                vehicle.controller_config().validate().unwrap();
                assert!(vehicle.profile_names().iter().all(|name| vehicle.profile(Some(name)).is_some()));
                true
            }
            Err(error) => refused(&error),
        };
        let tuning = match Vehicle::parse(shipped.text.clone(), text, &path) {
            Ok(vehicle) => {
                vehicle.tuning().validate().unwrap();
                true
            }
            Err(error) => refused(&error),
        };
        [vehicle, tuning]
    });
}

/// The seeds are an `access.toml` and a certificate; each stands for either, beside the whole other one.
#[test]
fn identity() {
    let folder = tempfile::tempdir().unwrap();
    let name: VehicleName = "kite".parse().unwrap();
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/identity");
    for file in ["ca.pem", "key.pem"] {
        fs::write(folder.path().join(file), "").unwrap();
    }
    run("identity", scratch(), |bytes| {
        [("cert.pem", "access.toml"), ("access.toml", "cert.pem")].map(|(file, other)| {
            fs::copy(corpus.join(other), folder.path().join(other)).unwrap();
            fs::write(folder.path().join(file), bytes).unwrap();
            Identity::load(folder.path(), &name).map_or_else(|error| refused(&error), |_| true)
        })
    });
}
