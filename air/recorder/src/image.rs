//! RGB-D compression for the log, without loss: what the network saw can be shown to it again. PNG, 8 bit colour and 16
//! bit depth; a frame of 160 x 96 costs about as much time as a JPEG.

use std::io::Cursor;

use goshawk_proto::v1;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageFormat, ImageReader, Limits};

use crate::error::RecorderError;

/// What decoding may allocate: far more than a network's image, whatever a damaged one says of its size.
const MOST_BYTES: u64 = 64 << 20;

/// Compresses one image: `rgb` height × width × 3, `depth_mm` height × width, 0 where nothing was measured.
///
/// # Errors
/// A buffer does not fit the size.
pub fn compress(rgb: &[u8], depth_mm: &[u16], width: u32, height: u32) -> Result<v1::CompressedRgbd, RecorderError> {
    let error = |cause: String| RecorderError::Image { width, height, cause };
    let pixels = width as usize * height as usize;
    if rgb.len() != 3 * pixels || depth_mm.len() != pixels {
        return Err(error(format!("{} bytes of colour and {} of depth", rgb.len(), 2 * depth_mm.len())));
    }
    let png = |bytes: &[u8], colour| {
        let mut png = Vec::with_capacity(bytes.len());
        PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Up)
            .write_image(bytes, width, height, colour)
            .map(|()| png)
            .map_err(|e| error(e.to_string()))
    };
    let depth: Vec<u8> = depth_mm.iter().flat_map(|mm| mm.to_ne_bytes()).collect();
    let (rgb_png, depth_png) = (png(rgb, ExtendedColorType::Rgb8)?, png(&depth, ExtendedColorType::L16)?);
    Ok(v1::CompressedRgbd { width, height, rgb_png, depth_png, ..Default::default() })
}

/// Undoes [`compress`].
///
/// # Errors
/// The bytes are not such images, or not of the size that the message says.
pub fn decompress(message: &v1::CompressedRgbd) -> Result<(Vec<u8>, Vec<u16>), RecorderError> {
    let v1::CompressedRgbd { width, height, .. } = *message;
    let error = |cause: String| RecorderError::Image { width, height, cause };
    let decode = |bytes: &[u8]| -> Result<DynamicImage, RecorderError> {
        let mut reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
        let mut limits = Limits::default();
        limits.max_alloc = Some(MOST_BYTES);
        reader.limits(limits);
        let image = reader.decode().map_err(|e| error(e.to_string()))?;
        if (image.width(), image.height()) == (width, height) {
            Ok(image)
        } else {
            Err(error(format!("the compressed image is {} x {}", image.width(), image.height())))
        }
    };
    let rgb = decode(&message.rgb_png)?.into_rgb8().into_raw();
    let depth = decode(&message.depth_png)?.into_luma16().into_raw();
    Ok((rgb, depth))
}
