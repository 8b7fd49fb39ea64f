//! From two pictures to one image: which belong together, their pixels, their lenses.

pub mod lens;
pub mod pairing;
pub mod picture;
