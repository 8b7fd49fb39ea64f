//! What arrives from the camera and the odometry, validated once, here at the edge. Inside, values are good.

use goshawk_core::{Odometry, Rot, Time, Vec3};
use goshawk_policy::{Moving, Source, StreamFault};
use goshawk_proto::v1;
use prost::Message;

/// One RGB-D frame with plausible shape and stamp.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Counted by the source.
    pub seq: u64,
    /// Middle of the exposure.
    pub stamp: Time,
    /// px.
    pub width: usize,
    /// px.
    pub height: usize,
    /// rad.
    pub hfov: f64,
    /// rad.
    pub vfov: f64,
    /// height × width × 3.
    pub rgb: Vec<u8>,
    /// height × width, along the optical axis; 0: no measurement.
    pub depth_mm: Vec<u16>,
    /// Tells this picture from others, once it was judged.
    pub print: u64,
    /// What was wrong with the stream when it came: then it is shown and logged, and not planned from.
    pub fault: Option<StreamFault>,
}

impl Frame {
    /// Where it comes from, for the preprocessor.
    #[must_use]
    pub fn source(&self) -> Source {
        Source { width: self.width as u32, height: self.height as u32, hfov_rad: self.hfov, vfov_rad: self.vfov }
    }
}

/// Why a sample was refused. Refused samples are counted and otherwise as if they had not come.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SampleError {
    /// Not the expected message.
    #[error("malformed payload")]
    Malformed,
    /// A field is missing.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// NaN, infinite or beyond belief.
    #[error("{0} is not plausible")]
    Implausible(&'static str),
    /// A buffer does not fit the image's size.
    #[error("an image of {width} x {height} with {rgb} bytes of colour and {depth} of depth")]
    Shape {
        /// px.
        width: u32,
        /// px.
        height: u32,
        /// bytes.
        rgb: usize,
        /// bytes.
        depth: usize,
    },
    /// The stamp is in the future by more than 50 ms, or over a second old: not this host's monotonic clock.
    #[error("the stamp is not of this host's monotonic clock")]
    Stamp,
}

/// More pixels than a camera of 1920 x 1200 has are no image.
const MAX_PIXELS: usize = 1920 * 1200;

/// Decodes and validates an image message received at `now`.
///
/// # Errors
/// See [`SampleError`].
pub fn frame(payload: &[u8], now: Time) -> Result<Frame, SampleError> {
    let m = v1::Rgbd::decode(payload).map_err(|_| SampleError::Malformed)?;
    let pixels = m.width as usize * m.height as usize;
    if pixels == 0 || pixels > MAX_PIXELS || m.rgb.len() != 3 * pixels || m.depth_mm.len() != 2 * pixels {
        let (width, height, rgb, depth) = (m.width, m.height, m.rgb.len(), m.depth_mm.len());
        return Err(SampleError::Shape { width, height, rgb, depth });
    }
    if !(m.hfov_rad > 0.1 && m.hfov_rad < 3.0 && m.vfov_rad > 0.1 && m.vfov_rad < 3.0) {
        return Err(SampleError::Implausible("the field of view"));
    }
    Ok(Frame {
        seq: m.seq,
        stamp: stamp(m.stamp_ns, now)?,
        width: m.width as usize,
        height: m.height as usize,
        hfov: m.hfov_rad,
        vfov: m.vfov_rad,
        rgb: m.rgb,
        depth_mm: m.depth_mm.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect(),
        print: 0,
        fault: None,
    })
}

/// Decodes and validates an odometry message received at `now`.
///
/// # Errors
/// See [`SampleError`].
pub fn odometry(payload: &[u8], now: Time) -> Result<Odometry, SampleError> {
    let m = v1::Odometry::decode(payload).map_err(|_| SampleError::Malformed)?;
    let quat = m.world_from_body.ok_or(SampleError::Missing("world_from_body"))?;
    let quat = nalgebra::Quaternion::new(quat.w, quat.x, quat.y, quat.z);
    if !(quat.norm() - 1.0).abs().lt(&0.01) {
        return Err(SampleError::Implausible("world_from_body"));
    }
    plausible(Odometry {
        stamp: stamp(m.stamp_ns, now)?,
        pos_world: vector(m.pos_world, "pos_world")?,
        vel_world: vector(m.vel_world, "vel_world")?,
        world_from_body: Rot::from_quaternion(quat),
        ang_vel_body: vector(m.ang_vel_body, "ang_vel_body")?,
        reset_counter: m.reset_counter,
    })
}

/// An odometry sample from any source, if it is finite and believable.
///
/// # Errors
/// Names the first field that is not.
pub fn plausible(o: Odometry) -> Result<Odometry, SampleError> {
    let good = |v: Vec3, limit: f64| v.iter().all(|x| x.is_finite()) && v.norm() < limit;
    if !good(o.pos_world, 1e5) {
        Err(SampleError::Implausible("pos_world"))
    } else if !good(o.vel_world, 100.0) {
        Err(SampleError::Implausible("vel_world"))
    } else if !good(o.ang_vel_body, 100.0) {
        Err(SampleError::Implausible("ang_vel_body"))
    } else if !o.world_from_body.coords.iter().all(|x| x.is_finite()) {
        Err(SampleError::Implausible("world_from_body"))
    } else {
        Ok(o)
    }
}

/// How the vehicle moves, for the camera's monitor.
#[must_use]
pub fn moving(flying: bool, odometry: &Odometry) -> Moving {
    Moving { flying, speed_mps: odometry.vel_world.norm(), rate_radps: odometry.ang_vel_body.norm() }
}

fn vector(v: Option<v1::Vec3>, name: &'static str) -> Result<Vec3, SampleError> {
    v.map(|v| Vec3::new(v.x, v.y, v.z)).ok_or(SampleError::Missing(name))
}

fn stamp(ns: u64, now: Time) -> Result<Time, SampleError> {
    let age = now.since(Time(ns));
    if (-0.05..1.0).contains(&age) { Ok(Time(ns)) } else { Err(SampleError::Stamp) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NOW: Time = Time(5_000_000_000);

    fn image() -> v1::Rgbd {
        v1::Rgbd {
            seq: 3,
            stamp_ns: NOW.0 - 1000,
            width: 4,
            height: 2,
            hfov_rad: 1.57,
            vfov_rad: 1.08,
            rgb: vec![7; 24],
            depth_mm: [0x34, 0x12].repeat(8),
        }
    }

    fn motion() -> v1::Odometry {
        let zero = Some(v1::Vec3::default());
        v1::Odometry {
            seq: 1,
            stamp_ns: NOW.0,
            pos_world: zero,
            vel_world: zero,
            world_from_body: Some(v1::Quat { w: 1.0, ..Default::default() }),
            ang_vel_body: zero,
            reset_counter: 0,
        }
    }

    #[test]
    fn a_good_frame_is_taken_with_depth_in_little_endian() {
        let got = frame(&image().encode_to_vec(), NOW).unwrap();
        assert_eq!((got.width, got.height, got.depth_mm[7]), (4, 2, 0x1234));
    }

    #[test]
    fn a_frame_of_the_wrong_size_or_clock_is_refused() {
        let shape = |m: v1::Rgbd| matches!(frame(&m.encode_to_vec(), NOW), Err(SampleError::Shape { .. }));
        assert!(shape(v1::Rgbd { width: 5, ..image() }));
        assert!(shape(v1::Rgbd { width: 0, rgb: vec![], depth_mm: vec![], ..image() }));
        assert!(shape(v1::Rgbd { width: u32::MAX, height: u32::MAX, ..image() }));
        for stamp_ns in [0, NOW.0 + 1_000_000_000, u64::MAX] {
            assert_eq!(frame(&v1::Rgbd { stamp_ns, ..image() }.encode_to_vec(), NOW), Err(SampleError::Stamp));
        }
        let fov = v1::Rgbd { hfov_rad: f64::NAN, ..image() };
        assert!(matches!(frame(&fov.encode_to_vec(), NOW), Err(SampleError::Implausible(_))));
    }

    #[test]
    fn odometry_with_nan_or_without_a_unit_quaternion_is_refused() {
        assert!(odometry(&motion().encode_to_vec(), NOW).is_ok());
        let nan = Some(v1::Vec3 { x: f64::NAN, y: 0.0, z: 0.0 });
        for bad in [
            v1::Odometry { pos_world: nan, ..motion() },
            v1::Odometry { vel_world: nan, ..motion() },
            v1::Odometry { ang_vel_body: nan, ..motion() },
            v1::Odometry { world_from_body: Some(v1::Quat::default()), ..motion() },
            v1::Odometry { world_from_body: Some(v1::Quat { w: f64::NAN, ..Default::default() }), ..motion() },
        ] {
            assert!(matches!(odometry(&bad.encode_to_vec(), NOW), Err(SampleError::Implausible(_))));
        }
        let missing = v1::Odometry { vel_world: None, ..motion() };
        assert_eq!(odometry(&missing.encode_to_vec(), NOW), Err(SampleError::Missing("vel_world")));
    }

    proptest! {
        #[test]
        fn no_bytes_from_the_network_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let _ = frame(&bytes, NOW);
            let _ = odometry(&bytes, NOW);
        }
    }
}
