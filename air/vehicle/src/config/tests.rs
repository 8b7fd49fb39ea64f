use super::*;
use goshawk_autopilot::{Firmware, Guided, Status};
use goshawk_core::Extensions;

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../vehicles/sim.toml")
}

/// The shipped files with one key changed, in the one of them that has it.
fn edited(from: &str, to: &str) -> Result<Vehicle, VehicleError> {
    let Vehicle { text, tuning_text, .. } = Vehicle::load(&shipped()).unwrap();
    assert!(text.contains(from) != tuning_text.contains(from), "{from}");
    Vehicle::parse(text.replacen(from, to, 1), tuning_text.replacen(from, to, 1), Path::new("vehicle.toml"))
}

#[test]
fn the_newest_stamp_lies_beside_its_key_or_in_the_services_folder() {
    let key = Path::new("/etc/goshawk/mavlink.key");
    assert_eq!(stamps_of(key, None), Path::new("/etc/goshawk/mavlink.key.stamp"));
    assert_eq!(stamps_of(key, Some("/var/lib/goshawk".into())), Path::new("/var/lib/goshawk/mavlink.key.stamp"));
}

#[test]
fn every_shipped_vehicle_file_loads() {
    let text = std::fs::read_to_string(shipped()).unwrap();
    let vehicle = Vehicle::load(&shipped()).unwrap();
    assert!(vehicle.text == text && vehicle.tuning_text.contains("[planner.target]"));
    let files = std::fs::read_dir(shipped().parent().unwrap()).unwrap().map(|entry| entry.unwrap().path());
    let of_vehicles = |path: &PathBuf| std::fs::read_to_string(path).unwrap().contains("\n[airframe]");
    let mut loaded = files.filter(of_vehicles).map(|path| Vehicle::load(&path).unwrap().name).collect::<Vec<_>>();
    loaded.sort();
    let simulated = ["goshawk"; 4]; // sim.toml, navigate.toml, paper.toml, ardupilot-sitl.toml
    assert_eq!(loaded, [&simulated[..], &["micro-155", "x500"]].concat());
}

#[test]
fn the_vehicle_that_navigates_differs_from_the_shipped_one_in_its_policy_and_profile_alone() {
    let navigating = Vehicle::load(&shipped().with_file_name("navigate.toml")).unwrap();
    let ours = Vehicle::load(&shipped()).unwrap();
    assert_eq!(navigating.model(Task::Track), ours.model(Task::Navigate), "what it flies is what the simulator flies");
    let goal = navigating.profile(None).unwrap();
    assert!(goal.task == Task::Navigate && goal.goal.is_some());
    let rest = |vehicle: &Vehicle| {
        let mut table = toml::from_str::<toml::Table>(&vehicle.text).unwrap();
        ["policy", "profile", "default_profile"].iter().for_each(|key| drop(table.remove(*key)));
        table
    };
    assert_eq!(rest(&navigating), rest(&ours));
}

#[test]
fn the_vehicle_that_ardupilot_flies_differs_from_the_shipped_one_in_its_autopilot_alone() {
    let without_autopilot = |file: &str| {
        let text = Vehicle::load(&shipped().with_file_name(file)).unwrap().text;
        let mut table = toml::from_str::<toml::Table>(&text).unwrap();
        assert!(table.remove("autopilot").is_some());
        table
    };
    assert_eq!(without_autopilot("ardupilot-sitl.toml"), without_autopilot("sim.toml"));
}

#[test]
fn the_papers_vehicle_differs_from_the_shipped_one_in_its_policy_and_extensions_alone() {
    let table = |text: &str| toml::from_str::<toml::Table>(text).unwrap();
    let (ours, paper) =
        (Vehicle::load(&shipped()).unwrap(), Vehicle::load(&shipped().with_file_name("paper.toml")).unwrap());
    let without = |text: &str, keys: &[&str]| {
        let mut table = table(text);
        keys.iter().for_each(|key| drop(table.remove(*key)));
        table
    };
    let own = ["policy", "tuning"];
    assert_eq!(without(&ours.text, &own), without(&paper.text, &own));
    assert_eq!(without(&ours.tuning_text, &[]), without(&paper.tuning_text, &["extensions"]));
    assert_eq!(ours.tuning().extensions, Extensions::ALL);
    let switches = &table(&paper.tuning_text)["extensions"];
    let switches = switches.as_table().unwrap();
    assert!(switches.values().all(|on| on.as_bool() == Some(false)));
    let known = format!("{:?}", paper.tuning().extensions).matches("false").count();
    assert_eq!((switches.len(), known), (18, 18), "all that there are");
    assert!(ours.unkept().is_none() && paper.unkept().is_some());
    assert!(paper.model(Task::Navigate).ends_with("paper-navigate.onnx"));
    assert!(ours.model(Task::Navigate).ends_with("navigate.onnx"));
}

#[test]
fn a_tuning_file_that_is_missing_or_wrong_is_named_and_not_the_vehicle_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("kite.toml");
    let Vehicle { text, tuning_text, .. } = Vehicle::load(&shipped()).unwrap();
    std::fs::write(&path, text.replace("\"tuning.toml\"", "\"calm.toml\"")).unwrap();
    let missing = Vehicle::load(&path).unwrap_err().to_string();
    assert!(missing.starts_with("cannot read the tuning file ") && missing.contains("calm.toml"), "{missing}");
    for (from, to, why) in [
        ("kp = 2.0", "kp = 200.0", "calm.toml: hold.kp is 200; it must be 0.1 to 20"),
        ("kp = 2.0", "kq = 2.0", "calm.toml: line "),
        ("alpha2 = 2.0", "alpha2 = 4.6", "calm.toml: observer.alpha2 is 4.6; it must be 0.01 to 4.5"),
    ] {
        std::fs::write(folder.path().join("calm.toml"), tuning_text.replace(from, to)).unwrap();
        let error = Vehicle::load(&path).unwrap_err().to_string();
        assert!(error.contains(why) && !error.contains("kite.toml"), "{error}");
    }
}

#[test]
fn an_unknown_key_is_refused_by_name_and_line_in_one_line() {
    let error = edited("mass_kg", "mass_kgs").unwrap_err().to_string();
    assert!(error.contains("mass_kgs") && error.contains("line "), "{error}");
    assert_eq!(error.lines().count(), 1);
}

#[test]
fn a_missing_safety_limit_is_refused() {
    let text = std::fs::read_to_string(shipped()).unwrap();
    let limits = text.split("\n[limits]").nth(1).unwrap().lines().skip(1).take_while(|line| line.contains('='));
    let limits: Vec<&str> = limits.chain(["max_tilt_deg = 65.0", "max_thrust = 0.95"]).collect();
    assert_eq!(limits.len(), 9, "{limits:?}");
    for line in limits {
        let error = edited(&format!("{line}\n"), "\n").unwrap_err().to_string();
        assert!(error.contains(line.split(' ').next().unwrap()), "{error}");
    }
}

#[test]
fn a_policy_without_its_hash_or_a_camera_without_its_rates_is_refused() {
    let text = std::fs::read_to_string(shipped()).unwrap();
    for key in ["sha256 = ", "rate_hz = ["] {
        let line = text.lines().find(|line| line.starts_with(key)).unwrap();
        let error = edited(&format!("{line}\n"), "").unwrap_err().to_string();
        assert!(error.contains(key.split(' ').next().unwrap()), "{error}");
    }
}

#[test]
fn a_value_that_cannot_be_flown_with_is_refused_by_name() {
    let capitals = format!("\nsha256 = \"{}\" # ", "B".repeat(64));
    for (from, to, name) in [
        ("mass_kg = 0.85", "mass_kg = -1.0", "airframe.mass_kg"),
        ("hover_thrust = 0.35", "hover_thrust = nan", "hover_thrust"),
        ("rate_hz = 200.0", "rate_hz = 2.0", "realtime.controller_rate_hz"),
        ("name = \"goshawk\"", "name = \"**\"", "vehicle name"),
        ("default_profile = \"chase\"", "default_profile = \"nap\"", "nap"),
        ("listen = [\"tcp/127.0.0.1:7447\"]", "listen = []", "network.listen"),
        ("task = \"track\"", "task = \"navigate\"", "goal_m"),
        ("hover_thrust_range = [0.20, 0.55]", "hover_thrust_range = [0.40, 0.55]", "airframe.hover_thrust_range"),
        ("attitude_lag_range_s = [0.04, 0.35]", "attitude_lag_range_s = [0.04, 0.05]", "airframe.attitude_lag_range_s"),
        ("on_stop = \"land\"", "on_stop = \"loiter\"", "loiter"),
        ("max_speed_mps = 20.0", "max_speed_mps = 5.0", "profile chase: its speed"),
        ("provider = \"cpu\"", "provider = \"npu\"", "npu"),
        ("\nsha256 = \"", &capitals, "policy.sha256"),
        ("\nsha256 = \"", "\nsha256 = \"0", "policy.sha256"),
        ("rate_hz = [10.0, 65.0]", "rate_hz = [1.0, 65.0]", "camera.rate_hz"),
        ("rate_hz = [10.0, 65.0]", "rate_hz = [10.0, 1000.0]", "camera.rate_hz"),
        ("rate_hz = [10.0, 65.0]", "rate_hz = [60.0, 65.0]", "camera.rate_hz"),
        ("controller_priority = 80", "controller_priority = 40", "controller_priority"),
        ("udpin:127.0.0.1:14540", "127.0.0.1:14540", "udpin:ADDRESS:PORT"),
        ("udpin:127.0.0.1:14540", "serial:/dev/ttyACM0:57600", "57600 bit/s is too slow"),
        ("firmware = \"px4\"", "firmware = \"betaflight\"", "betaflight"),
        ("firmware = \"px4\"", "guided = \"guided\"", "autopilot.guided"),
        ("firmware = \"px4\"", "firmware = \"ardupilot\"\nguided = \"loiter\"", "loiter"),
    ] {
        let error = edited(from, to).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
    }
}

#[test]
fn the_autopilots_firmware_is_px4_unless_it_is_said() {
    let firmware = |to: &str| edited("firmware = \"px4\"", to).unwrap().autopilot.firmware();
    assert_eq!(firmware(""), Firmware::Px4);
    assert_eq!(firmware("firmware = \"ardupilot\""), Firmware::ArduPilot(Guided::Guided));
    let no_gps = "firmware = \"ardupilot\"\nguided = \"guided-nogps\"";
    assert_eq!(firmware(no_gps), Firmware::ArduPilot(Guided::NoGps));
}

#[test]
fn a_missing_file_is_named() {
    let error = Vehicle::load(Path::new("nowhere.toml")).unwrap_err().to_string();
    assert!(error.contains("nowhere.toml"), "{error}");
}

#[test]
fn an_autopilot_without_a_position_is_no_concern_where_odometry_is_our_own() {
    let lost = Status { position: Some(false), armed: true, ..Status::default() };
    let flown_by = OdometrySource::Autopilot.concerning(&lost);
    let beside = OdometrySource::Zenoh.concerning(&lost);
    assert_eq!((flown_by.position, beside.position), (Some(false), None));
    assert!(flown_by.armed && beside.armed);
}
