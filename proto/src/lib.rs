//! What crosses between air and ground: the messages, and the one table of key expressions and QoS.
//!
//! Knows no transport: the names of priorities and congestion controls are Zenoh's, the mapping is the caller's.

pub mod keys;

/// The messages of `goshawk/v1/goshawk.proto`; frames and units are in its comments.
#[allow(missing_docs, clippy::pedantic)]
pub mod v1 {
    include!(concat!(env!("OUT_DIR"), "/goshawk.v1.rs"));
}

/// The encoded `google.protobuf.FileDescriptorSet` of all messages, without source comments: the schema of a log.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptor_set.bin"));

/// The protobuf package of every message; a full name is `goshawk.v1.Plan`.
pub const PACKAGE: &str = "goshawk.v1";
