//! What turns a camera frame into the raw network output: preprocessing, the policy's contract, ONNX inference.
//!
//! ```text
//! RGB-D bytes ─► Preprocessor::run ─► Policy::infer ─► goshawk_core::NetworkOutput
//!                                        ▲ state (goshawk_core::Asked::state)
//! ```
//! Knows nothing of transports, autopilots or logs.

pub mod answers;
pub mod contract;
pub mod golden;
pub mod library;
pub mod policy;
pub mod preprocess;
pub mod provider;
pub mod stream;

pub use answers::{AnswerFault, AnswerMonitor};
pub use contract::{Contract, ContractError};
pub use golden::{Golden, GoldenError};
pub use library::LibraryError;
pub use policy::{Policy, PolicyError};
pub use preprocess::{PreprocessError, Preprocessor, Source};
pub use provider::Provider;
pub use stream::{Arrival, Moving, RateLimits, StreamFault, StreamMonitor};
