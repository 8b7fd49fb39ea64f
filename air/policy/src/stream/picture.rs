//! What a picture comes to in a few numbers, from a sample of its pixels.

/// So many pairs of neighbouring pixels are looked at. Chosen by eye.
const SAMPLES: usize = 1024;
/// Darker than this in the mean, and with less contrast than the next, is black, of 255. Chosen by eye.
const BLACK_MEAN: f32 = 8.0;
/// Standard deviation of a black picture at most, of 255. Chosen by eye.
const BLACK_DEVIATION: f32 = 3.0;
/// Depth in a smaller share of the samples than this is none. Chosen by eye.
const NO_DEPTH: f32 = 0.005;
/// In a larger share than this it is much. Chosen by eye.
const MUCH_DEPTH: f32 = 0.1;
/// A depth is measured in at least this share of the samples before its spread says anything. Chosen by eye.
const MEASURED: f32 = 0.5;
/// Neighbours that differ as much as any two pixels do, nearly: the share of a variance. Chosen by eye.
const UNRELATED: f32 = 0.8;
/// A colour whose deviation is less than this is flat, not noise, of 255. Chosen by eye.
const FLAT_COLOUR: f32 = 12.0;
/// So is a depth, mm. Chosen by eye.
const FLAT_DEPTH_MM: f32 = 500.0;
/// A depth that spreads less than this share of it between its 5th and 95th percentile is one depth. Chosen by eye.
const ONE_DEPTH_SHARE: f32 = 0.01;
/// So is one that spreads less than this, mm. Chosen by eye.
const ONE_DEPTH_MM: f32 = 3.0;
/// Everything nearer than this is the lens's cover, mm. Chosen by eye.
const COVERED_MM: f32 = 500.0;

/// Memory for one picture's depths.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    depths: Vec<u16>,
}

/// What a picture comes to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picture {
    /// Of the samples' colours, and of their depths; equal pictures have equal ones.
    pub prints: [u64; 2],
    /// Mean green of 255, and its standard deviation.
    pub colour: [f32; 2],
    /// Mean square difference of neighbours over twice the variance: 0 smooth, 1 unrelated. Of green, and of depth.
    pub roughness: [f32; 2],
    /// Share of the samples with a depth.
    pub measured: f32,
    /// The depth's standard deviation, mm.
    pub depth_deviation_mm: f32,
    /// The depth's 5th, 50th and 95th percentile, mm; 0: none is measured.
    pub depth_mm: [f32; 3],
}

/// Sums over pairs of neighbours.
#[derive(Clone, Copy, Default)]
struct Pairs {
    count: f32,
    sum: f32,
    squares: f32,
    differences: f32,
}

impl Pairs {
    fn add(&mut self, here: f32, beside: f32) {
        self.count += 1.0;
        self.sum += here;
        self.squares += here * here;
        self.differences += (here - beside) * (here - beside);
    }

    fn mean(&self) -> f32 {
        self.sum / self.count.max(1.0)
    }

    fn variance(&self) -> f32 {
        (self.squares / self.count.max(1.0) - self.mean() * self.mean()).max(0.0)
    }

    fn roughness(&self) -> f32 {
        let variance = self.variance();
        if variance > 0.0 { self.differences / self.count.max(1.0) / (2.0 * variance) } else { 0.0 }
    }
}

fn mixed(print: u64, value: u32) -> u64 {
    (print ^ u64::from(value)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
}

impl Picture {
    /// `rgb`: three bytes a pixel; `depth_mm`: one value a pixel, 0 for no measurement.
    pub(super) fn of(rgb: &[u8], depth_mm: &[u16], scratch: &mut Scratch) -> Self {
        let (pixels, _) = rgb.as_chunks::<3>();
        let count = pixels.len().min(depth_mm.len());
        // An odd stride does not stay in one column.
        let stride = (count / SAMPLES).max(1) | 1;
        scratch.depths.clear();
        let (mut colour, mut depth) = (Pairs::default(), Pairs::default());
        let (mut prints, mut samples) = ([0x243f_6a88_85a3_08d3; 2], 0);
        for at in (0..count.saturating_sub(1)).step_by(stride) {
            let [here, beside] = [pixels[at], pixels[at + 1]];
            let [mm, mm_beside] = [depth_mm[at], depth_mm[at + 1]];
            samples += 1;
            prints[0] = mixed(prints[0], u32::from_le_bytes([here[0], here[1], here[2], beside[1]]));
            prints[1] = mixed(prints[1], u32::from(mm) << 16 | u32::from(mm_beside));
            colour.add(here[1].into(), beside[1].into());
            if mm > 0 {
                scratch.depths.push(mm);
                if mm_beside > 0 {
                    depth.add(mm.into(), mm_beside.into());
                }
            }
        }
        let measured = scratch.depths.len() as f32 / (samples as f32).max(1.0);
        Self {
            prints,
            colour: [colour.mean(), colour.variance().sqrt()],
            roughness: [colour.roughness(), depth.roughness()],
            measured,
            depth_deviation_mm: depth.variance().sqrt(),
            depth_mm: [0.05, 0.5, 0.95].map(|share| percentile(&mut scratch.depths, share)),
        }
    }

    pub(super) fn repeats(&self, last: &Self) -> bool {
        let depth = self.prints[1] == last.prints[1] && self.measured > MUCH_DEPTH;
        self.prints[0] == last.prints[0] || depth
    }

    pub(super) fn is_black(&self) -> bool {
        self.colour[0] < BLACK_MEAN && self.colour[1] < BLACK_DEVIATION
    }

    pub(super) fn has_no_depth(&self) -> bool {
        self.measured < NO_DEPTH
    }

    pub(super) fn has_much_depth(&self) -> bool {
        self.measured > MUCH_DEPTH
    }

    pub(super) fn is_noise(&self) -> bool {
        let colour = self.roughness[0] > UNRELATED && self.colour[1] > FLAT_COLOUR;
        let depth = self.roughness[1] > UNRELATED && self.depth_deviation_mm > FLAT_DEPTH_MM;
        colour || (depth && self.measured > MEASURED)
    }

    pub(super) fn has_one_depth(&self) -> bool {
        let [low, middle, high] = self.depth_mm;
        self.measured > MEASURED && high - low <= (ONE_DEPTH_SHARE * middle).max(ONE_DEPTH_MM)
    }

    pub(super) fn is_covered(&self) -> bool {
        self.measured > MEASURED && self.depth_mm[2] < COVERED_MM
    }
}

fn percentile(depths: &mut [u16], share: f32) -> f32 {
    if depths.is_empty() {
        return 0.0;
    }
    let place = ((depths.len() - 1) as f32 * share) as usize;
    let (_, value, _) = depths.select_nth_unstable(place);
    f32::from(*value)
}
