//! What crosses between the rooms: plain values, their mathematics, errors.

pub mod error;
pub mod extensions;
pub mod geometry;
pub mod history;
pub mod jump;
pub mod quintic;
pub mod types;
