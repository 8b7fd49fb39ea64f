//! What lies on the wire: a node by rmw_zenoh's rules ([`node`]), whose names are those of [`graph`] and whose bytes are
//! those of [`cdr`] and [`messages`].

pub mod cdr;
pub mod clock;
pub mod graph;
pub mod messages;
pub mod node;
