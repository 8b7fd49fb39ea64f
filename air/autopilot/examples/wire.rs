//! The link by hand: opens `LINE` and does what the lines on stdin say, one JSON line an answer.
//!
//! ```text
//! cargo run --release -p goshawk-autopilot --example wire -- udpout:127.0.0.1:14580
//! … wire -- tcpout:127.0.0.1:5760 ardupilot|ardupilot-nogps|px4 [KEY_FILE|- [PEER]]
//! setpoint W X Y Z THRUST     send attitude (ENU from FLU) and thrust 0..1
//! request offboard|arm|disarm|hand-back
//! read                        what is known: odometry (ENU, FLU), status, answers to requests
//! ```

use goshawk_autopilot::{AutopilotLink, Firmware, Guided, LinkConfig, SigningConfig, SigningKey};
use goshawk_core::{AttitudeThrust, NormalisedThrust, Request, Rot, Time};
use nalgebra::Quaternion;
use serde_json::{Value, json};
use std::error::Error;
use std::io::BufRead;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let address = args
        .next()
        .ok_or("usage: wire LINE [FIRMWARE [KEY_FILE|- [PEER]]], such as udpout:127.0.0.1:14580")?
        .parse()?;
    let firmware = match args.next().as_deref() {
        None | Some("px4") => Firmware::Px4,
        Some("ardupilot") => Firmware::ArduPilot(Guided::Guided),
        Some("ardupilot-nogps") => Firmware::ArduPilot(Guided::NoGps),
        Some(other) => return Err(format!("unknown firmware {other}").into()),
    };
    let key = args.next().filter(|path| path != "-").map(|path| SigningKey::load(Path::new(&path))).transpose()?;
    let peer = args.next().map(|peer| peer.parse()).transpose()?;
    let signing = key.map(|key| SigningConfig { key, stamps: None });
    let start = Instant::now();
    let clock = move || Time(start.elapsed().as_nanos() as u64);
    let config = LinkConfig { address, firmware, signing, peer, ..LinkConfig::customary("127.0.0.1:0".parse()?) };
    let link = AutopilotLink::open(config, clock)?;
    println!("{}", json!({ "listening": link.local_address().ok().map(|address| address.port()) }));
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let answer = match words.as_slice() {
            [] => break,
            ["setpoint", values @ ..] => setpoint(&link, values)?,
            ["request", what] => request(&link, what)?,
            ["read"] => read(&link, clock()),
            other => return Err(format!("unknown command {other:?}").into()),
        };
        println!("{answer}");
    }
    Ok(())
}

fn setpoint(link: &AutopilotLink, values: &[&str]) -> Result<Value, Box<dyn Error>> {
    let values: Vec<f64> = values.iter().map(|value| value.parse()).collect::<Result<_, _>>()?;
    let [w, x, y, z, thrust] = values[..] else { return Err("setpoint W X Y Z THRUST".into()) };
    let world_from_body = Rot::new_unchecked(Quaternion::new(w, x, y, z));
    let sent = link.send_setpoint(&AttitudeThrust { world_from_body, thrust: NormalisedThrust(thrust) });
    Ok(json!({ "error": sent.err().map(|error| error.to_string()) }))
}

fn request(link: &AutopilotLink, what: &str) -> Result<Value, Box<dyn Error>> {
    link.request(match what {
        "offboard" => Request::Offboard,
        "arm" => Request::Arm,
        "disarm" => Request::Disarm,
        "disarm-anyway" => Request::DisarmAnyway,
        "hand-back" => Request::HandBack,
        other => return Err(format!("unknown request {other}").into()),
    });
    Ok(json!({ "requested": what }))
}

fn read(link: &AutopilotLink, now: Time) -> Value {
    let status = link.status(now);
    let odometry = link.odometry().map(|odometry| {
        let q = odometry.world_from_body;
        json!({
            "age_s": now.since(odometry.stamp),
            "pos_world": odometry.pos_world.as_slice(),
            "vel_world": odometry.vel_world.as_slice(),
            "world_from_body": [q.w, q.i, q.j, q.k],
            "ang_vel_body": odometry.ang_vel_body.as_slice(),
            "reset_counter": odometry.reset_counter,
        })
    });
    let events: Vec<String> = link.take_peer_events().iter().map(ToString::to_string).collect();
    let acks: Vec<Value> =
        link.take_acks().iter().map(|ack| json!([ack.command.to_string(), ack.outcome.to_string()])).collect();
    json!({
        "odometry": odometry,
        "acks": acks,
        "peer_events": events,
        "problem": link.line_problem().or_else(|| status.problem()),
        "connected": status.connected,
        "armed": status.armed,
        "offboard": status.offboard,
        "failsafe": status.failsafe,
        "landed": status.landed,
        "mode": status.mode.map(|mode| mode.to_string()),
        "position": status.position,
        "position_fault": status.position_fault.map(|fault| fault.to_string()),
        "battery_fraction": status.battery_fraction,
        "round_trip_s": status.round_trip_s,
        "unsigned": status.counters.unsigned,
        "bad_signature": status.counters.bad_signature,
        "stale_signature": status.counters.stale_signature,
        "not_finite": status.counters.not_finite,
        "odometry_frame": status.counters.odometry_frame,
    })
}
