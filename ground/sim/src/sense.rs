//! What the vehicle senses with: camera and state estimate, as good as real ones are; and the file that says how good.

pub mod file;
pub mod odometry;
pub mod rgbd;
