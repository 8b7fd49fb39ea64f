//! Sensor image to network input, the same rules as the training side (`tests/vectors/preprocess.json`).
//!
//! First the network's size. Colour: box average, areas weighted where the sizes do not divide, rounded to whole values
//! of 0..=255. Depth: millimetres; the source pixel under each target pixel's centre. That image of bytes and millimetres
//! is all that the network's input follows from, so it is what a log keeps ([`Preprocessor::at_network_size`]).
//!
//! Then the rim, if the vehicle has one ([`Preprocessor::with_rim`]): depth lenses that see less than the image leave its
//! border without measurements, and what has none looks free and far to the network.
//!
//! Then the input. Colour: divided by 255. Depth: 0 and whatever is nearer than `min_m` are no measurement;
//! each filling pass gives a pixel without one the nearest of its 3 x 3 neighbours as they were before the pass; what
//! still has none becomes `max_m`; clipped to `max_m` and divided by it. Nothing is allocated after construction.

use std::ops::Range;

use goshawk_core::planning::nearest::{COLUMNS, Nearest, ROWS};

use crate::contract::{Contract, Depth, Image};

/// Largest relative difference between the source's field of view and the policy's. Chosen by eye.
pub const FIELD_OF_VIEW_TOLERANCE: f64 = 0.02;

/// Stands for "no measurement" while filling: it never wins a minimum.
const NONE: u16 = u16::MAX;
/// The farthest measurement: beyond every `max_m`, so what a sensor at full scale says is clipped either way.
const FARTHEST: u16 = NONE - 1;

/// A source of images, as it says of itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Source {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Horizontal field of view, rad.
    pub hfov_rad: f64,
    /// Vertical field of view, rad.
    pub vfov_rad: f64,
}

/// Why an image cannot be prepared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PreprocessError {
    /// The source has no pixels, or more than a camera has.
    #[error("image is {width} x {height}: each side must be 1..=8192 pixels")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
    /// The camera sees more or less than the policy was trained with.
    #[error(
        "{axis} field of view is {found_rad:.4} rad, the policy was trained with {needed_rad:.4}: crop the image, or \
         train for this camera"
    )]
    FieldOfView {
        /// "horizontal" or "vertical".
        axis: &'static str,
        /// The source's, rad.
        found_rad: f64,
        /// The policy's, rad.
        needed_rad: f64,
    },
    /// A buffer does not fit the source's size.
    #[error("{buffer} buffer has {found} bytes, a {width} x {height} image needs {needed}")]
    Length {
        /// "rgb" or "depth".
        buffer: &'static str,
        /// Its bytes.
        found: usize,
        /// Bytes it must have.
        needed: usize,
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
    },
}

/// Prepares the frames of one source for one policy.
#[derive(Clone, Debug)]
pub struct Preprocessor {
    source: Source,
    colour: Colour,
    depth: DepthImage,
    /// The columns of [`Nearest`] that each of the source's is in: one, or more of a source that has fewer.
    columns: Vec<Range<usize>>,
    /// `[4, height, width]`.
    rgbd: Vec<f32>,
}

impl Preprocessor {
    /// For frames of `source`, as `contract` wants them.
    ///
    /// # Errors
    /// The source's size is impossible, or its field of view is off by more than [`FIELD_OF_VIEW_TOLERANCE`].
    pub fn new(contract: &Contract, source: Source) -> Result<Self, PreprocessError> {
        let Source { width, height, .. } = source;
        if !(1..=8192).contains(&width) || !(1..=8192).contains(&height) {
            return Err(PreprocessError::Size { width, height });
        }
        let image = contract.image;
        for (axis, found_rad, needed_rad) in
            [("horizontal", source.hfov_rad, image.hfov_rad), ("vertical", source.vfov_rad, image.vfov_rad)]
        {
            let close = (found_rad / needed_rad - 1.0).abs() <= FIELD_OF_VIEW_TOLERANCE; // false for NaN
            if !close {
                return Err(PreprocessError::FieldOfView { axis, found_rad, needed_rad });
            }
        }
        Ok(Self {
            source,
            colour: Colour::new(source, image),
            depth: DepthImage::new(source, image, contract.depth),
            columns: (0..width as usize).map(|u| columns_of(u, width as usize)).collect(),
            rgbd: vec![0.0; 4 * image.width * image.height],
        })
    }

    /// With a rim of `pixels` of the network's image in which depth may be missing: there the network is shown the first
    /// measurement further in, along the column, then along the row. [`Self::nearest`] tells of measurements alone.
    #[must_use]
    pub fn with_rim(mut self, pixels: usize) -> Self {
        self.depth.rim = pixels;
        self
    }

    /// What it was built for; a frame that differs needs another preprocessor.
    #[must_use]
    pub fn source(&self) -> Source {
        self.source
    }

    /// Prepares one frame: `rgb` is `[height, width, 3]`, `depth_mm` `[height, width]` millimetres along the optical
    /// axis, 0 for no measurement. Gives `[4, 96, 160]`, each value 0..=1: red, green, blue, depth.
    ///
    /// # Errors
    /// A buffer of the wrong length.
    pub fn run(&mut self, rgb: &[u8], depth_mm: &[u16]) -> Result<&[f32], PreprocessError> {
        self.check(rgb, 2 * depth_mm.len())?;
        self.prepare(rgb, |index| depth_mm[index]);
        Ok(&self.rgbd)
    }

    /// The frame at the network's size: colour `[96, 160, 3]` and depth `[96, 160]`, millimetres. Preparing these gives
    /// the very input that preparing the frame gives.
    ///
    /// # Errors
    /// A buffer of the wrong length.
    pub fn at_network_size(&mut self, rgb: &[u8], depth_mm: &[u16]) -> Result<(Vec<u8>, Vec<u16>), PreprocessError> {
        self.check(rgb, 2 * depth_mm.len())?;
        let pixels = self.rgbd.len() / 4;
        let mut small = vec![0; 3 * pixels];
        self.colour.run(rgb, |index, pixel| small[3 * index..][..3].copy_from_slice(&pixel));
        let depth = &self.depth;
        let taken = depth.row_starts.iter().flat_map(|start| depth.columns.iter().map(move |column| start + column));
        Ok((small, taken.map(|index| depth_mm[index]).collect()))
    }

    /// The nearest measurement in each column of each row of [`Nearest`], of a depth image, `[height, width]`, for
    /// [`goshawk_core::Planner::see`].
    ///
    /// # Errors
    /// A buffer of the wrong length.
    pub fn nearest(&self, depth_mm: &[u16]) -> Result<Nearest, PreprocessError> {
        let Source { width, height, .. } = self.source;
        self.check_buffer("depth", 2 * depth_mm.len(), 2 * width as usize * height as usize)?;
        let mut nearest = [NONE; COLUMNS * ROWS];
        for (v, row) in depth_mm.chunks_exact(width as usize).enumerate() {
            let first = v * ROWS / height as usize * COLUMNS;
            for (u, &mm) in row.iter().enumerate() {
                if mm >= self.depth.near_mm.max(1) {
                    nearest[first..][self.columns[u].clone()].iter_mut().for_each(|least| *least = mm.min(*least));
                }
            }
        }
        Ok(nearest.map(|mm| if mm == NONE { 0 } else { mm }))
    }

    fn check(&self, rgb: &[u8], depth_bytes: usize) -> Result<(), PreprocessError> {
        let pixels = self.source.width as usize * self.source.height as usize;
        self.check_buffer("rgb", rgb.len(), 3 * pixels)?;
        self.check_buffer("depth", depth_bytes, 2 * pixels)
    }

    fn check_buffer(&self, buffer: &'static str, found: usize, needed: usize) -> Result<(), PreprocessError> {
        let Source { width, height, .. } = self.source;
        if found == needed { Ok(()) } else { Err(PreprocessError::Length { buffer, found, needed, width, height }) }
    }

    fn prepare(&mut self, rgb: &[u8], depth_at: impl Fn(usize) -> u16) {
        let plane = self.rgbd.len() / 4;
        let (colour, depth) = self.rgbd.split_at_mut(3 * plane);
        let (red, rest) = colour.split_at_mut(plane);
        let (green, blue) = rest.split_at_mut(plane);
        self.colour.run(rgb, |index, pixel| {
            [red[index], green[index], blue[index]] = pixel.map(|value| f32::from(value) / 255.0);
        });
        self.depth.run(depth_at, depth);
    }
}

/// For each target pixel of one axis: the first source pixel of its box, and each covered one's share.
#[derive(Clone, Debug)]
struct Boxes {
    first: Vec<usize>,
    shares: Vec<Vec<f32>>,
}

impl Boxes {
    fn new(source: usize, target: usize) -> Self {
        let step = source as f64 / target as f64;
        let mut boxes = Self { first: Vec::new(), shares: Vec::new() };
        for index in 0..target {
            let (start, stop) = (index as f64 * step, (index + 1) as f64 * step);
            let first = (start.floor() as usize).min(source - 1);
            let last = (stop.ceil() as usize).clamp(first + 1, source);
            let share = |pixel: usize| {
                let covered = stop.min((pixel + 1) as f64) - start.max(pixel as f64);
                (covered.max(0.0) / step) as f32
            };
            boxes.first.push(first);
            boxes.shares.push((first..last).map(share).collect());
        }
        boxes
    }
}

/// The columns of [`Nearest`] that column `u` of a source of this width is in. No column is in none.
fn columns_of(u: usize, width: usize) -> Range<usize> {
    let first = u * COLUMNS / width;
    first..((u + 1) * COLUMNS / width).max(first + 1)
}

/// Colour: interleaved bytes to the network's size.
#[derive(Clone, Debug)]
struct Colour {
    /// Absent: the source has the network's size.
    boxes: Option<(Boxes, Boxes)>,
    width: usize,
    row_bytes: usize,
    /// One source row, averaged down the box.
    row: Vec<f32>,
}

impl Colour {
    fn new(source: Source, image: Image) -> Self {
        let (width, height) = (source.width as usize, source.height as usize);
        let same = (width, height) == (image.width, image.height);
        let boxes = (!same).then(|| (Boxes::new(height, image.height), Boxes::new(width, image.width)));
        Self { boxes, width: image.width, row_bytes: 3 * width, row: vec![0.0; 3 * width] }
    }

    /// Gives `put` each pixel of the network's image, row by row.
    fn run(&mut self, rgb: &[u8], mut put: impl FnMut(usize, [u8; 3])) {
        let Some((rows, columns)) = &self.boxes else {
            let (pixels, _) = rgb.as_chunks::<3>();
            pixels.iter().enumerate().for_each(|(index, pixel)| put(index, *pixel));
            return;
        };
        for (y, (&first, shares)) in rows.first.iter().zip(&rows.shares).enumerate() {
            self.row.fill(0.0);
            let sources = rgb[first * self.row_bytes..].chunks_exact(self.row_bytes);
            for (source, &share) in sources.zip(shares) {
                for (sum, &value) in self.row.iter_mut().zip(source) {
                    *sum += share * f32::from(value);
                }
            }
            let (pixels, _) = self.row.as_chunks::<3>();
            for (x, (&first, shares)) in columns.first.iter().zip(&columns.shares).enumerate() {
                let mut sum = [0.5; 3]; // rounds to the nearest whole value
                for (pixel, &share) in pixels[first..].iter().zip(shares) {
                    for channel in 0..3 {
                        sum[channel] += share * pixel[channel];
                    }
                }
                put(y * self.width + x, sum.map(|value| value as u8)); // saturates
            }
        }
    }
}

/// Depth: resampled, filled, normalised.
#[derive(Clone, Debug)]
struct DepthImage {
    near_mm: u16,
    far_mm: u16,
    passes: u32,
    rim: usize,
    width: usize,
    height: usize,
    /// Index of each target row's first source pixel.
    row_starts: Vec<usize>,
    /// Source column of each target column.
    columns: Vec<usize>,
    /// The image in millimetres with a border of [`NONE`], `[height + 2, width + 2]`.
    image: Vec<u16>,
    /// Minima of three along the rows; same layout.
    minima: Vec<u16>,
}

impl DepthImage {
    fn new(source: Source, image: Image, depth: Depth) -> Self {
        let under_centre = |index: usize, from: usize, to: usize| {
            (((index as f64 + 0.5) * from as f64 / to as f64) as usize).min(from - 1)
        };
        let (source_width, source_height) = (source.width as usize, source.height as usize);
        let padded = (image.width + 2) * (image.height + 2);
        Self {
            near_mm: (depth.min_m * 1000.0).round() as u16,
            far_mm: (depth.max_m * 1000.0).round() as u16,
            passes: depth.fill_passes,
            rim: 0,
            width: image.width,
            height: image.height,
            row_starts: (0..image.height)
                .map(|y| under_centre(y, source_height, image.height) * source_width)
                .collect(),
            columns: (0..image.width).map(|x| under_centre(x, source_width, image.width)).collect(),
            image: vec![NONE; padded],
            minima: vec![NONE; padded],
        }
    }

    fn run(&mut self, depth_at: impl Fn(usize) -> u16, plane: &mut [f32]) {
        let stride = self.width + 2;
        let nearest = self.near_mm.max(1); // 0 is no measurement whatever min_m
        for (row, &start) in self.image[stride..].chunks_exact_mut(stride).zip(&self.row_starts) {
            for (out, &column) in row[1..].iter_mut().zip(&self.columns) {
                let mm = depth_at(start + column);
                *out = if mm < nearest { NONE } else { mm.min(FARTHEST) };
            }
        }
        if self.rim > 0 {
            self.fill_rim();
        }
        for _ in 0..self.passes {
            self.fill_once();
        }
        let far = f32::from(self.far_mm);
        let rows = self.image[stride..].chunks_exact(stride);
        for (row, out) in rows.zip(plane.chunks_exact_mut(self.width)) {
            for (&mm, value) in row[1..].iter().zip(out) {
                *value = f32::from(mm.min(self.far_mm)) / far;
            }
        }
    }

    fn fill_rim(&mut self) {
        let (width, height, stride) = (self.width, self.height, self.width + 2);
        let place = |x: usize, y: usize| (y + 1) * stride + x + 1;
        for x in 0..width {
            self.fill_inward(place(x, 0), stride.cast_signed(), height);
            self.fill_inward(place(x, height - 1), -stride.cast_signed(), height);
        }
        for y in 0..height {
            self.fill_inward(place(0, y), 1, width);
            self.fill_inward(place(width - 1, y), -1, width);
        }
    }

    /// Gives the pixels before the first measurement its value, if no more than the rim are before it.
    fn fill_inward(&mut self, first: usize, step: isize, size: usize) {
        let place = |steps: usize| first.wrapping_add_signed(step * steps.cast_signed());
        let measured = (0..=self.rim.min(size - 1)).find(|steps| self.image[place(*steps)] != NONE);
        for steps in 0..measured.unwrap_or(0) {
            self.image[place(steps)] = self.image[place(measured.unwrap_or(0))];
        }
    }

    fn fill_once(&mut self) {
        let stride = self.width + 2;
        let interior = stride..stride * (self.height + 1);
        let rows = self.image[interior.clone()].chunks_exact(stride);
        for (row, minima) in rows.zip(self.minima[interior.clone()].chunks_exact_mut(stride)) {
            let neighbours = row.iter().zip(&row[1..]).zip(&row[2..]);
            for (((&a, &b), &c), minimum) in neighbours.zip(&mut minima[1..]) {
                *minimum = a.min(b).min(c);
            }
        }
        let below = &self.minima[2 * stride..];
        let here = &self.minima[stride..];
        let neighbours = self.minima.iter().zip(here).zip(below);
        for (((&a, &b), &c), mm) in neighbours.zip(&mut self.image[interior]) {
            let nearest = a.min(b).min(c);
            *mm = if *mm == NONE { nearest } else { *mm };
        }
    }
}
