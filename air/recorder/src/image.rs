//! RGB-D compression for the log: JPEG colour (lossy), 16-bit PNG depth (exact).

use goshawk_proto::v1;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageFormat};

use crate::error::RecorderError;

const JPEG_QUALITY: u8 = 85;

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
    let mut rgb_jpeg = Vec::with_capacity(8 * 1024);
    JpegEncoder::new_with_quality(&mut rgb_jpeg, JPEG_QUALITY)
        .encode(rgb, width, height, ExtendedColorType::Rgb8)
        .map_err(|e| error(e.to_string()))?;
    let depth: Vec<u8> = depth_mm.iter().flat_map(|mm| mm.to_ne_bytes()).collect();
    let mut depth_png = Vec::with_capacity(16 * 1024);
    PngEncoder::new_with_quality(&mut depth_png, CompressionType::Fast, FilterType::Up)
        .write_image(&depth, width, height, ExtendedColorType::L16)
        .map_err(|e| error(e.to_string()))?;
    Ok(v1::CompressedRgbd { width, height, rgb_jpeg, depth_png, ..Default::default() })
}

/// Undoes [`compress`]: colour approximately, depth exactly.
///
/// # Errors
/// The bytes are not such images, or not of the size that the message says.
pub fn decompress(message: &v1::CompressedRgbd) -> Result<(Vec<u8>, Vec<u16>), RecorderError> {
    let v1::CompressedRgbd { width, height, .. } = *message;
    let error = |cause: String| RecorderError::Image { width, height, cause };
    let decode = |bytes: &[u8], format| {
        let image = image::load_from_memory_with_format(bytes, format).map_err(|e| error(e.to_string()))?;
        if (image.width(), image.height()) == (width, height) {
            Ok(image)
        } else {
            Err(error(format!("the compressed image is {} x {}", image.width(), image.height())))
        }
    };
    let rgb = decode(&message.rgb_jpeg, ImageFormat::Jpeg)?.into_rgb8().into_raw();
    let depth = decode(&message.depth_png, ImageFormat::Png)?.into_luma16().into_raw();
    Ok((rgb, depth))
}
