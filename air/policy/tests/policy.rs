//! Policies through ONNX Runtime: what loads computes what it should; what does not says why.
//!
//! Needs the library that the project's virtual environment carries (`make setup`).

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use goshawk_policy::{ContractError, Policy, PolicyError};

fn model(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/models/{name}.onnx"))
}

fn load(name: &str) -> Result<Policy, PolicyError> {
    Policy::load(&model(name), None, 1)
}

fn failure(name: &str) -> (PolicyError, String) {
    let error = load(name).unwrap_err();
    let message = error.to_string();
    assert!(message.contains(&format!("{name}.onnx")), "{message}");
    (error, message)
}

/// An image whose planes have exact means, and a state.
fn inputs(policy: &Policy) -> (Vec<f32>, Vec<f32>) {
    let plane = policy.rgbd_len() / 4;
    let rgbd = (0..4 * plane).map(|i| 0.125 * (i / plane) as f32 + if i % 2 == 0 { 0.25 } else { 0.0 }).collect();
    (rgbd, (0..policy.state_len()).map(|i| 0.5 - 0.125 * i as f32).collect())
}

/// What `make_models.py` says that the good models compute.
fn expected(state: &[f32], outputs: usize) -> Vec<f64> {
    let means = (0..4).map(|channel| 0.125 + 0.125 * f64::from(channel));
    let joined: Vec<f64> = means.chain(state.iter().map(|&v| f64::from(v))).collect();
    let weight = |i: usize, j: usize| ((7 * i + 3 * j) % 11) as f64 / 10.0 - 0.5;
    (0..outputs)
        .map(|j| j as f64 / 100.0 + joined.iter().enumerate().map(|(i, v)| v * weight(i, j)).sum::<f64>())
        .collect()
}

fn assert_computes(name: &str, channels: usize) {
    let mut policy = load(name).unwrap();
    let (rgbd, state) = inputs(&policy);
    let output = policy.infer(&rgbd, &state).unwrap();
    for (i, (found, needed)) in output.values.iter().zip(expected(&state, 15 * channels)).enumerate() {
        assert!((f64::from(*found) - needed).abs() < 1e-5, "{name} output {i}: {found}, not {needed}");
    }
    assert!(output.values[15 * channels..].iter().all(|&v| v == 0.0));
}

#[test]
fn a_tracking_policy_computes_known_values() {
    assert_computes("track", 14);
}

#[test]
fn a_navigation_policy_computes_known_values() {
    assert_computes("navigate", 10);
}

#[test]
fn inputs_are_matched_by_name_whatever_their_order() {
    assert_computes("track_swapped_inputs", 14);
}

#[test]
fn a_second_frame_does_not_see_the_first() {
    let mut policy = load("track").unwrap();
    let (rgbd, state) = inputs(&policy);
    let first = policy.infer(&rgbd, &state).unwrap();
    let other = policy.infer(&vec![0.75; rgbd.len()], &state).unwrap();
    let again = policy.infer(&rgbd, &state).unwrap();
    assert_ne!(first, other);
    assert_eq!(first, again);
}

#[test]
fn policies_run_on_several_threads_at_once_and_agree() {
    let threads: Vec<_> = (0..4)
        .map(|_| {
            std::thread::spawn(|| {
                let mut policy = load("track").unwrap();
                let (rgbd, state) = inputs(&policy);
                policy.infer(&rgbd, &state).unwrap()
            })
        })
        .collect();
    let outputs: Vec<_> = threads.into_iter().map(|thread| thread.join().unwrap()).collect();
    assert!(outputs.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn the_file_is_identified_by_its_hash_and_contract() {
    let policy = load("track").unwrap();
    let copy = tempfile::tempdir().unwrap();
    let path = copy.path().join("copy.onnx");
    std::fs::copy(model("track"), &path).unwrap();
    assert_eq!(Policy::load(&path, None, 1).unwrap().sha256(), policy.sha256());
    assert_ne!(load("navigate").unwrap().sha256(), policy.sha256());
    assert!(policy.sha256().len() == 64 && policy.sha256().bytes().all(|b| b.is_ascii_hexdigit()));
    let json: serde_json::Value = serde_json::from_str(policy.contract_json()).unwrap();
    assert_eq!(serde_json::to_value(policy.contract()).unwrap(), json);
}

#[test]
fn an_input_of_the_wrong_length_is_refused() {
    let mut policy = load("track").unwrap();
    let (rgbd, state) = inputs(&policy);
    let error = policy.infer(&rgbd[1..], &state).unwrap_err();
    assert!(matches!(error, PolicyError::Length { input: "rgbd", found: 61439, needed: 61440 }), "{error}");
    let error = policy.infer(&rgbd, &[0.0; 9]).unwrap_err();
    assert!(matches!(error, PolicyError::Length { input: "state", found: 9, needed: 13 }), "{error}");
}

#[test]
fn a_missing_file_is_a_read_error() {
    let (error, message) = failure("missing");
    assert!(matches!(error, PolicyError::Read { .. }), "{message}");
}

#[test]
fn a_file_that_is_not_onnx_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in [("text.onnx", b"not a model".as_slice()), ("empty.onnx", b"")] {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let error = Policy::load(&path, None, 1).unwrap_err();
        assert!(matches!(error, PolicyError::NotOnnx { .. }), "{error}");
        assert!(error.to_string().contains(name));
    }
}

#[test]
fn a_model_cut_short_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.onnx");
    let whole = std::fs::read(model("track")).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let error = Policy::load(&path, None, 1).unwrap_err();
    assert!(matches!(error, PolicyError::NotOnnx { .. }), "{error}");
}

#[test]
fn a_model_without_a_contract_is_refused() {
    let (error, message) = failure("no_contract");
    assert!(matches!(error, PolicyError::NoContract { .. }), "{message}");
}

#[test]
fn a_contract_of_another_version_is_refused() {
    let (error, message) = failure("wrong_version");
    let version = matches!(error, PolicyError::Contract { source: ContractError::Version { found: 1 }, .. });
    assert!(version, "{message}");
}

#[test]
fn a_contract_with_an_unknown_field_is_refused() {
    let (error, message) = failure("unknown_field");
    assert!(matches!(error, PolicyError::Contract { source: ContractError::Fields(_), .. }), "{message}");
    assert!(message.contains("unknown field `novelty`"), "{message}");
}

#[test]
fn a_contract_that_cannot_be_honoured_says_what_differs() {
    let (error, message) = failure("other_image");
    assert!(matches!(error, PolicyError::Contract { source: ContractError::Value { .. }, .. }), "{message}");
    assert!(message.contains("image.width is 320, this software needs 160"), "{message}");
}

#[test]
fn a_model_that_breaks_its_contract_says_what_it_has_and_what_is_needed() {
    let cases = [
        ("wrong_output_shape", "prediction float32[1, 10, 3, 5]", "prediction float32[1, 14, 3, 5]"),
        ("wrong_state_length", "state float32[1, 6]", "state float32[1, 13]"),
        ("wrong_input_name", "motion float32[1, 13]", "state float32[1, 13]"),
        ("wrong_output_type", "f64", "prediction float32[1, 14, 3, 5]"),
    ];
    for (name, found, needed) in cases {
        let (error, message) = failure(name);
        assert!(matches!(error, PolicyError::Shape { .. }), "{message}");
        assert!(message.contains(found) && message.contains(needed), "{message}");
    }
}

#[test]
fn a_library_that_is_not_there_is_named() {
    let error = Policy::load(&model("track"), Some(Path::new("/missing/libonnxruntime.so")), 1).unwrap_err();
    assert!(matches!(error, PolicyError::Library(_)), "{error}");
    assert!(error.to_string().contains("/missing/libonnxruntime.so"));
}

#[test]
fn another_library_than_the_loaded_one_is_refused() {
    load("track").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("libonnxruntime.so");
    std::fs::write(&path, "").unwrap();
    let error = Policy::load(&model("track"), Some(&path), 1).unwrap_err();
    assert!(matches!(error, PolicyError::AnotherLibrary { .. }), "{error}");
}

#[test]
fn a_policy_may_move_to_another_thread() {
    fn needs_send<T: Send>() {}
    needs_send::<Policy>();
}

#[test]
fn every_shipped_policy_loads_and_gives_finite_values() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    let files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    let policies: Vec<&PathBuf> = files.iter().filter(|path| path.extension().is_some_and(|e| e == "onnx")).collect();
    assert!(!policies.is_empty());
    for path in policies {
        let mut policy = Policy::load(path, None, 1).unwrap();
        let (rgbd, state) = inputs(&policy);
        let output = policy.infer(&rgbd, &state).unwrap();
        assert!(output.values.iter().all(|value| value.is_finite()), "{}", path.display());
    }
}
