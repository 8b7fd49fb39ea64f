//! A library that does not load; a test program of its own, since a process holds one ONNX Runtime.

#![allow(clippy::unwrap_used)]

use std::path::Path;

use goshawk_policy::{Policy, PolicyError};

#[test]
fn a_library_that_does_not_load_is_named_and_the_next_try_may_succeed() {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models/track.onnx");
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("libonnxruntime.so");
    std::fs::write(&broken, "not a library").unwrap();
    let error = Policy::load(&model, Some(folder.path()), 1).unwrap_err();
    assert!(matches!(error, PolicyError::LibraryLoad { .. }), "{error}");
    assert!(error.to_string().contains("libonnxruntime.so"), "{error}");
    Policy::load(&model, None, 1).unwrap();
}
