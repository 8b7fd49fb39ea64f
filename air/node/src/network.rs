//! Who is there, what they may do, and what they ask.

pub mod access;
pub mod commands;
pub mod memory;
pub mod missed;
pub mod switch;
pub mod visitors;
