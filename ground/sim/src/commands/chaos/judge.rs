//! What is held against each step and each log: the properties, and what the disk kept.

pub(crate) mod examine;
pub(crate) mod properties;
pub(crate) mod recorder;
