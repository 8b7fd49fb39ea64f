//! Images in: each half into the picture's size as it comes, a pair of them on to the vehicle.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use goshawk_proto::v1;

use crate::config;
use crate::images::lens::{Map, View};
use crate::images::pairing::{Half, Pairs, Side};
use crate::images::picture::{colour, depth, expand};
use crate::tally::Refused;
use crate::wire::cdr::decode;
use crate::wire::clock::Clocks;
use crate::wire::messages::{CameraInfo, CompressedImage, Header, Image};

/// Takes the three topics of a camera.
pub struct Camera {
    view: View,
    rectified: bool,
    lens: Mutex<Option<(CameraInfo, Arc<Map>)>>,
    pairs: Mutex<Pairs>,
}

/// A message's way in: as it is, or compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Packing {
    Raw,
    Compressed,
}

impl Packing {
    /// As image_transport names topics.
    #[must_use]
    pub fn of(topic: &str) -> Self {
        let compressed = topic.ends_with("/compressed") || topic.ends_with("/compressedDepth");
        if compressed { Packing::Compressed } else { Packing::Raw }
    }
}

impl Camera {
    /// As the file has it.
    #[must_use]
    pub fn new(camera: &config::Camera) -> Self {
        let (hfov, vfov) = (camera.hfov_deg.to_radians(), camera.vfov_deg.to_radians());
        let view = View { width: camera.width, height: camera.height, hfov, vfov, rim: camera.rim };
        let within = (camera.pair_within_ms * 1e6) as u64;
        Camera { view, rectified: camera.rectified, lens: Mutex::new(None), pairs: Mutex::new(Pairs::new(within)) }
    }

    /// Takes a `camera_info`; what is looked up is worked out when it is another one than before.
    ///
    /// # Errors
    /// It is none, or the camera cannot be used; then no image is, until a better one comes.
    pub fn info(&self, bytes: &[u8]) -> Result<(), Refused> {
        let info = CameraInfo { header: Header::default(), ..decode::<CameraInfo>(bytes)? };
        let mut lens = lock(&self.lens);
        if lens.as_ref().is_some_and(|(known, _)| *known == info) {
            return Ok(());
        }
        *lens = None;
        let map = Arc::new(Map::new(&info, self.rectified, &self.view)?);
        *lens = Some((info, map));
        Ok(())
    }

    /// Takes an image; gives the pair that it completes.
    ///
    /// # Errors
    /// It is none, or not of this camera and now.
    pub fn take(&self, side: Side, packing: Packing, bytes: &[u8], now: &Clocks) -> Result<Option<v1::Rgbd>, Refused> {
        let map = lock(&self.lens).as_ref().map(|(_, map)| Arc::clone(map)).ok_or(Refused::NoLens)?;
        let half = match packing {
            Packing::Raw => {
                let image = decode::<Image<'_>>(bytes)?;
                let stamp = now.monotonic(image.header.stamp)?;
                Half { stamp, bytes: sampled(side, &image, &map)? }
            }
            Packing::Compressed => {
                let compressed = decode::<CompressedImage<'_>>(bytes)?;
                let stamp = now.monotonic(compressed.header.stamp)?;
                Half { stamp, bytes: sampled(side, &expand(&compressed)?.image(), &map)? }
            }
        };
        let Some((rgb, depth)) = lock(&self.pairs).take(side, half) else { return Ok(None) };
        let View { width, height, hfov, vfov, .. } = self.view;
        Ok(Some(v1::Rgbd {
            seq: 0,
            stamp_ns: rgb.stamp,
            width,
            height,
            hfov_rad: hfov,
            vfov_rad: vfov,
            rgb: rgb.bytes,
            depth_mm: depth.bytes,
        }))
    }

    /// Halves that never found the other, since the last time that this was asked.
    pub fn take_lost(&self) -> u64 {
        lock(&self.pairs).take_lost()
    }
}

fn sampled(side: Side, image: &Image<'_>, map: &Map) -> Result<Vec<u8>, Refused> {
    Ok(match side {
        Side::Colour => colour(image, map)?,
        Side::Depth => depth(image, map)?,
    })
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
