//! The shipped policies, their cards, their golden images and the shipped vehicle file agree with each other.

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use goshawk_policy::{Golden, GoldenError, Policy, PolicyError, golden};
use sha2::{Digest, Sha256};

/// In 8 bits, as vehicles fly them, and as they were trained.
const SHIPPED: [&str; 4] = ["track", "navigate", "track-32bit", "navigate-32bit"];

fn air() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn model(name: &str) -> PathBuf {
    air().join(format!("models/{name}.onnx"))
}

fn sha256(path: &Path) -> String {
    Sha256::digest(std::fs::read(path).unwrap()).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn each_card_carries_the_hashes_of_its_model_and_of_its_golden_images() {
    for name in SHIPPED {
        let card = std::fs::read_to_string(model(name).with_extension("md")).unwrap();
        let (own, images) = (sha256(&model(name)), sha256(&Golden::path(&model(name))));
        assert!(card.contains(&format!("| model | `{own}` |")), "{name}: {own}");
        assert!(card.contains(&format!("| golden images | `{images}` |")), "{name}: {images}");
    }
}

#[test]
fn the_shipped_vehicle_file_pins_the_policy_that_it_names() {
    let text = std::fs::read_to_string(air().join("vehicles/sim.toml")).unwrap();
    assert!(text.contains(&format!("sha256 = \"{}\"", sha256(&model("track")))));
}

#[test]
fn each_shipped_policy_answers_its_golden_images_as_when_they_were_made() {
    for name in SHIPPED {
        let mut policy = Policy::load(&model(name), None, 1).unwrap();
        let worst = golden::warm_up(&mut policy, &model(name)).unwrap();
        assert!(worst < 1e-3, "{name}: {worst}");
    }
}

#[test]
fn a_policy_that_answers_otherwise_is_told_by_image() {
    let mut policy = Policy::load(&model("track"), None, 1).unwrap();
    let mut golden = Golden::load(&model("track")).unwrap();
    golden.frames[1].answer[17] += 0.5;
    let worst = golden.check(&mut policy).unwrap();
    assert!(worst > 0.02, "a single number off in 8 bits is no other network, but it is counted: {worst}");
    golden.frames[1].answer.iter_mut().for_each(|number| *number = 1.3 * *number + 0.3);
    let error = golden.check(&mut policy).unwrap_err();
    assert!(matches!(error, GoldenError::Answer { frame: 1, .. }), "{error}");
    let navigate = Golden::load(&model("navigate")).unwrap().check(&mut policy).unwrap_err();
    assert!(matches!(navigate, GoldenError::Form(_)), "{navigate}");
}

#[test]
fn another_file_than_the_pinned_one_is_refused_with_both_hashes() {
    let policy = Policy::load(&model("track"), None, 1).unwrap();
    policy.pinned(&model("track"), &sha256(&model("track"))).unwrap();
    let error = policy.pinned(&model("track"), &sha256(&model("navigate"))).unwrap_err();
    assert!(matches!(error, PolicyError::Pin { .. }));
    let message = error.to_string();
    assert!(message.contains(&sha256(&model("track"))) && message.contains(&sha256(&model("navigate"))), "{message}");
    assert!(message.contains("policy.sha256") && message.lines().count() == 1, "{message}");
}
