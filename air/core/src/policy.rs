//! What the network says, in the world frame.

mod activation;
pub mod decode;
pub mod lattice;
pub mod model;
pub mod state;
