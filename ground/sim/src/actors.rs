//! What moves in the world besides the vehicle: the evader, the body that it is seen as, and moving obstacles.

pub mod evader;
pub mod moving;
pub mod person;
