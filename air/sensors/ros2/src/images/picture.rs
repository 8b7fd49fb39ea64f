//! Colour and depth as ROS 2 has them, taken by a [`Map`] into what `in/rgbd` carries.

use std::io::Cursor;

use image::{ImageReader, Limits};

use crate::images::lens::Map;
use crate::wire::messages::{CompressedImage, Image};

/// Memory that one compressed image may ask for, bytes: 4096 x 4096 of 16 bit and as much again.
const MOST_MEMORY: u64 = 128 << 20;
/// What `compressed_depth_image_transport` puts before the file, bytes.
const DEPTH_HEADER: usize = 12;

/// Why an image cannot be used.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum PictureError {
    /// Neither colour nor depth, or the other of them.
    #[error("encoding {0:?} is no {1}")]
    Encoding(String, &'static str),
    /// Not the camera that `camera_info` is of.
    #[error("it is {0} x {1}, and camera_info says {2} x {3}")]
    Size(u32, u32, u32, u32),
    /// Fewer bytes than rows of that length have.
    #[error("{bytes} bytes are not {height} rows of {step}")]
    Data {
        /// There are so many.
        bytes: usize,
        /// px.
        height: u32,
        /// Bytes a row.
        step: u32,
    },
    /// The file in it is damaged, or too large.
    #[error("the file in it cannot be read: {0}")]
    File(String),
}

/// Bytes a pixel, and where red, green and blue are in it; none: no colour.
fn layout(encoding: &str) -> Option<(usize, [usize; 3])> {
    Some(match encoding {
        "rgb8" => (3, [0, 1, 2]),
        "bgr8" => (3, [2, 1, 0]),
        "rgba8" => (4, [0, 1, 2]),
        "bgra8" => (4, [2, 1, 0]),
        "mono8" | "8UC1" => (1, [0, 0, 0]),
        _ => return None,
    })
}

fn error_of(encoding: &str, wanted: &'static str) -> PictureError {
    PictureError::Encoding(encoding.chars().take(40).collect(), wanted)
}

/// The first byte of each pixel that is asked for is within the data.
fn check(image: &Image<'_>, map: &Map, pixel: usize) -> Result<(), PictureError> {
    if (image.width, image.height) != (map.width, map.height) {
        return Err(PictureError::Size(image.width, image.height, map.width, map.height));
    }
    let (bytes, step) = (image.data.len(), image.step as usize);
    let enough = step >= pixel * image.width as usize && step.checked_mul(image.height as usize) == Some(bytes);
    enough.then_some(()).ok_or(PictureError::Data { bytes, height: image.height, step: image.step })
}

/// The picture's colours, three bytes a pixel.
///
/// # Errors
/// It is no colour image of that camera.
pub fn colour(image: &Image<'_>, map: &Map) -> Result<Vec<u8>, PictureError> {
    let (pixel, places) = layout(&image.encoding).ok_or_else(|| error_of(&image.encoding, "colour"))?;
    check(image, map, pixel)?;
    let mut out = Vec::with_capacity(3 * map.colour.len());
    for samples in &map.colour {
        let at = samples.map(|(column, row)| row as usize * image.step as usize + column as usize * pixel);
        out.extend(places.map(|place| {
            let sum: u32 = at.iter().map(|at| u32::from(image.data[at + place])).sum();
            ((sum + 2) / 4) as u8
        }));
    }
    Ok(out)
}

/// The picture's depth, mm, little-endian; 0: not measured.
///
/// # Errors
/// It is no depth image of that camera.
pub fn depth(image: &Image<'_>, map: &Map) -> Result<Vec<u8>, PictureError> {
    let (metres, pixel) = match image.encoding.as_str() {
        "16UC1" | "mono16" => (false, 2),
        "32FC1" => (true, 4),
        other => return Err(error_of(other, "depth")),
    };
    check(image, map, pixel)?;
    let mut out = Vec::with_capacity(2 * map.depth.len());
    for &place in &map.depth {
        let Some((column, row)) = place else {
            out.extend([0; 2]);
            continue;
        };
        let at = row as usize * image.step as usize + column as usize * pixel;
        let mut bytes = [0; 4];
        bytes[..pixel].copy_from_slice(&image.data[at..at + pixel]);
        if image.is_bigendian != 0 {
            bytes[..pixel].reverse();
        }
        let mm = if metres {
            let mm = 1000.0 * f32::from_le_bytes(bytes);
            if mm > 0.0 && mm < 65_535.5 { mm.round() as u16 } else { 0 }
        } else {
            u16::from_le_bytes([bytes[0], bytes[1]])
        };
        out.extend(mm.to_le_bytes());
    }
    Ok(out)
}

/// A compressed image's pixels, of `rgb8` or `16UC1`.
#[derive(Debug)]
pub struct Expanded {
    width: u32,
    height: u32,
    encoding: &'static str,
    step: u32,
    data: Vec<u8>,
}

impl Expanded {
    /// As an image that came so.
    #[must_use]
    pub fn image(&self) -> Image<'_> {
        let (width, height, step) = (self.width, self.height, self.step);
        Image { width, height, step, encoding: self.encoding.to_owned(), data: &self.data, ..Image::default() }
    }
}

/// The pixels of a JPEG or PNG file, and of depth by `compressed_depth_image_transport`.
///
/// # Errors
/// It is neither, or damaged.
pub fn expand(compressed: &CompressedImage<'_>) -> Result<Expanded, PictureError> {
    let file = if compressed.format.contains("compressedDepth") {
        if compressed.format.starts_with("32FC1") || compressed.format.contains("rvl") {
            return Err(error_of(&compressed.format, "PNG of 16UC1: set its format to png, or send raw depth"));
        }
        compressed.data.get(DEPTH_HEADER..).unwrap_or_default()
    } else {
        compressed.data
    };
    let broken = |e: &dyn ToString| PictureError::File(e.to_string().replace('\n', " "));
    let mut reader = ImageReader::new(Cursor::new(file)).with_guessed_format().map_err(|e| broken(&e))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(4096);
    limits.max_image_height = Some(4096);
    limits.max_alloc = Some(MOST_MEMORY);
    reader.limits(limits);
    let image = reader.decode().map_err(|e| broken(&e))?;
    let (width, height) = (image.width(), image.height());
    Ok(match image {
        image::DynamicImage::ImageLuma16(depth) => Expanded {
            width,
            height,
            encoding: "16UC1",
            step: 2 * width,
            data: depth.into_raw().into_iter().flat_map(u16::to_le_bytes).collect(),
        },
        other => Expanded { width, height, encoding: "rgb8", step: 3 * width, data: other.into_rgb8().into_raw() },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::lens::tests::{VIEW, pinhole};
    use image::{DynamicImage, ImageFormat};
    use proptest::prelude::*;

    fn map() -> Map {
        Map::new(&pinhole(1), false, &VIEW).unwrap()
    }

    fn image<'a>(encoding: &str, step: u32, data: &'a [u8]) -> Image<'a> {
        Image { width: 4, height: 2, step, encoding: encoding.to_owned(), data, ..Image::default() }
    }

    #[test]
    fn every_colour_encoding_gives_red_green_blue_and_rows_may_be_padded() {
        for (encoding, pixel, wanted) in [
            ("rgb8", vec![1, 2, 3], [1, 2, 3]),
            ("bgr8", vec![1, 2, 3], [3, 2, 1]),
            ("rgba8", vec![1, 2, 3, 9], [1, 2, 3]),
            ("bgra8", vec![1, 2, 3, 9], [3, 2, 1]),
            ("mono8", vec![7], [7, 7, 7]),
        ] {
            let row = [pixel.repeat(4), vec![99; 5]].concat();
            let data = row.repeat(2);
            assert_eq!(colour(&image(encoding, row.len() as u32, &data), &map()).unwrap(), wanted.repeat(8));
        }
    }

    #[test]
    fn depth_is_in_millimetres_and_zero_where_it_is_not_a_number() {
        let metres = [1.25_f32, f32::NAN, -1.0, f32::INFINITY, 0.0, 65.0, 70.0, 0.0004];
        let wanted: Vec<u8> = [1250_u16, 0, 0, 0, 0, 65_000, 0, 0].iter().flat_map(|mm| mm.to_le_bytes()).collect();
        let little: Vec<u8> = metres.iter().flat_map(|m| m.to_le_bytes()).collect();
        let big: Vec<u8> = metres.iter().flat_map(|m| m.to_be_bytes()).collect();
        assert_eq!(depth(&image("32FC1", 16, &little), &map()).unwrap(), wanted);
        assert_eq!(depth(&Image { is_bigendian: 1, ..image("32FC1", 16, &big) }, &map()).unwrap(), wanted);
        let mm: Vec<u8> = (0..8_u16).flat_map(|k| (1000 * k).to_le_bytes()).collect();
        assert_eq!(depth(&image("16UC1", 8, &mm), &map()).unwrap(), mm);
    }

    #[test]
    fn the_wrong_encoding_size_or_length_is_refused() {
        let data = [0; 24];
        let good = || image("rgb8", 12, &data);
        assert!(colour(&good(), &map()).is_ok());
        for bad in [
            image("yuv422", 12, &data),
            image("16UC1", 12, &data),
            Image { width: 2, ..good() },
            image("rgb8", 11, &data),
            image("rgb8", u32::MAX, &data),
            image("rgb8", 12, &data[..23]),
            image("rgb8", 12, &[]),
        ] {
            assert!(colour(&bad, &map()).is_err(), "{bad:?}");
        }
        assert!(depth(&good(), &map()).is_err());
    }

    fn png(image: &DynamicImage) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, ImageFormat::Png).unwrap();
        file.into_inner()
    }

    #[test]
    fn compressed_colour_and_depth_are_read() {
        let rgb = image::RgbImage::from_fn(4, 2, |x, y| image::Rgb([x as u8, y as u8, 9]));
        let file = png(&DynamicImage::ImageRgb8(rgb.clone()));
        let sent = CompressedImage { format: "rgb8; png compressed".to_owned(), data: &file, ..Default::default() };
        assert_eq!(colour(&expand(&sent).unwrap().image(), &map()).unwrap(), rgb.into_raw());
        let mm = image::ImageBuffer::from_fn(4, 2, |x, y| image::Luma([(1000 * x + y) as u16]));
        let file = [vec![0; 12], png(&DynamicImage::ImageLuma16(mm.clone()))].concat();
        let format = "16UC1; compressedDepth png".to_owned();
        let sent = CompressedImage { format, data: &file, ..Default::default() };
        let wanted: Vec<u8> = mm.into_raw().into_iter().flat_map(u16::to_le_bytes).collect();
        assert_eq!(depth(&expand(&sent).unwrap().image(), &map()).unwrap(), wanted);
        for format in ["32FC1; compressedDepth png", "16UC1; compressedDepth rvl"] {
            assert!(expand(&CompressedImage { format: format.to_owned(), ..sent.clone() }).is_err());
        }
        assert!(expand(&CompressedImage { data: &file[12..40], ..CompressedImage::default() }).is_err());
    }

    proptest! {
        #[test]
        fn no_image_panics(
            width in 0..6_u32, height in 0..4_u32, step in 0..40_u32, kind in 0..6_usize,
            data in proptest::collection::vec(any::<u8>(), 0..100),
        ) {
            let encoding = ["rgb8", "bgra8", "mono8", "16UC1", "32FC1", ""][kind];
            let image = Image { height, width, ..image(encoding, step, &data) };
            let _ = colour(&image, &map());
            let _ = depth(&image, &map());
            let _ = expand(&CompressedImage { data: &data, ..CompressedImage::default() });
        }
    }
}
