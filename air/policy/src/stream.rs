//! Watches the camera's stream for what one picture alone does not show: a picture that stands still, that shows
//! nothing, or that comes too seldom or from two cameras. No clock, no I/O: a function of the frames so far.
//!
//! A frame that is judged bad is not planned from; then the plan expires, and the vehicle brakes, holds and lands.

mod order;
mod picture;

use goshawk_core::Time;

use order::Order;
pub use picture::Picture;

/// A picture's place in its stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Counted by the source.
    pub seq: u64,
    /// Middle of the exposure.
    pub stamp: Time,
    /// Which publisher it came from; 0: it does not say.
    pub source: u64,
}

/// How the vehicle moves while a picture is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moving {
    /// It is under way, from take-off to landing.
    pub flying: bool,
    /// m/s; 0: not known.
    pub speed_mps: f64,
    /// rad/s; 0: not known.
    pub rate_radps: f64,
}

/// How often pictures may come, 1/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateLimits {
    /// Fewer are too few to fly with.
    pub least_hz: f64,
    /// More are not one camera's.
    pub most_hz: f64,
}

/// What is wrong with a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StreamFault {
    /// Pictures of two cameras come, or more than one camera takes.
    TwoCameras,
    /// It is black, or depth has gone at once.
    Blank,
    /// Neighbouring pixels have nothing to do with each other.
    Noise,
    /// The same depth everywhere.
    OneDepth,
    /// Everything is right before the lens.
    Covered,
    /// The picture, or its depth, stands still.
    Frozen,
    /// Too few come.
    Slow,
}

impl StreamFault {
    /// All of them, the most telling first.
    pub const ALL: [Self; 7] =
        [Self::TwoCameras, Self::Blank, Self::Noise, Self::OneDepth, Self::Covered, Self::Frozen, Self::Slow];

    /// A word for it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TwoCameras => "two-cameras",
            Self::Frozen => "frozen",
            Self::Blank => "blank",
            Self::Noise => "noise",
            Self::OneDepth => "one-depth",
            Self::Covered => "covered",
            Self::Slow => "slow",
        }
    }

    /// What is seen, and what to do.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::TwoCameras => {
                "two-cameras: pictures come from two sources, or more than camera.rate_hz allows: stop the second camera"
            }
            Self::Frozen => "frozen: the picture stands still while its stamps go on: restart the camera",
            Self::Blank => "blank: the picture is black, or has lost its depth: uncover the lens, give it light",
            Self::Noise => "noise: the picture shows noise only: check the cable, restart the camera",
            Self::OneDepth => "one-depth: the depth is the same everywhere: restart the camera",
            Self::Covered => "covered: everything is nearer than half a metre: uncover the lens",
            Self::Slow => {
                "slow: fewer pictures come than camera.rate_hz asks for: set the camera's rate, check its USB port"
            }
        }
    }

    /// It must be seen for so long before it is believed, s: longer than any honest camera shows it.
    fn patience_s(self, moving: &Moving) -> f64 {
        let still = moving.speed_mps < STILL_MPS && moving.rate_radps < STILL_RADPS;
        match self {
            Self::TwoCameras | Self::Slow => 0.0,
            // Whoever moves sees something new in each frame. A noiseless camera that stands does not.
            Self::Frozen if still => 2.0,
            Self::Frozen => 0.35,
            Self::Blank | Self::Noise | Self::OneDepth | Self::Covered => 0.3,
        }
    }
}

/// Below this a vehicle stands, m/s. Chosen by eye.
const STILL_MPS: f64 = 0.3;
/// And below this it does not turn, rad/s. Chosen by eye.
const STILL_RADPS: f64 = 0.1;
/// A fault is over once it has not been seen for so long, s. Chosen by eye.
const OVER_S: f64 = 0.5;

/// One fault's history.
#[derive(Clone, Copy, Debug, Default)]
struct Suspicion {
    /// Since when it has been seen without a break.
    since: Option<Time>,
    /// It is believed; when it was seen last.
    believed: Option<Time>,
}

impl Suspicion {
    fn update(&mut self, now: Time, seen: bool, patience_s: f64) {
        if seen {
            let since = *self.since.get_or_insert(now);
            if self.believed.is_some() || now.since(since) >= patience_s {
                self.believed = Some(now);
            }
        } else {
            self.since = None;
            self.believed = self.believed.filter(|last| now.since(*last) < OVER_S);
        }
    }
}

/// Watches one stream.
#[derive(Clone, Debug)]
pub struct StreamMonitor {
    order: Order,
    last: Option<Picture>,
    /// Depth went from one frame to the next, and has not come back.
    lost_depth: bool,
    suspicions: [Suspicion; StreamFault::ALL.len()],
    scratch: picture::Scratch,
}

impl StreamMonitor {
    /// A monitor that has seen nothing yet.
    #[must_use]
    pub fn new(limits: RateLimits) -> Self {
        Self {
            order: Order::new(limits),
            last: None,
            lost_depth: false,
            suspicions: Default::default(),
            scratch: picture::Scratch::default(),
        }
    }

    /// Takes the next frame as it arrives: `rgb` `[height, width, 3]`, `depth_mm` `[height, width]`, 0 for no
    /// measurement. Gives what is wrong with the stream now; none: the frame can be flown with.
    pub fn judge(&mut self, arrival: &Arrival, rgb: &[u8], depth_mm: &[u16], moving: &Moving) -> Option<StreamFault> {
        let order = self.order.take(arrival);
        let picture = Picture::of(rgb, depth_mm, &mut self.scratch);
        let last = self.last.replace(picture);
        let lost = last.is_some_and(|last| last.has_much_depth()) || !moving.flying || self.lost_depth;
        self.lost_depth = picture.has_no_depth() && lost;
        for (fault, suspicion) in StreamFault::ALL.into_iter().zip(&mut self.suspicions) {
            let seen = match fault {
                StreamFault::TwoCameras => order.two,
                StreamFault::Slow => order.slow,
                StreamFault::Frozen => last.is_some_and(|last| picture.repeats(&last)),
                StreamFault::Blank => picture.is_black() || self.lost_depth,
                StreamFault::Noise => picture.is_noise(),
                StreamFault::OneDepth => picture.has_one_depth(),
                StreamFault::Covered => picture.is_covered(),
            };
            suspicion.update(arrival.stamp, seen, fault.patience_s(moving));
        }
        self.fault()
    }

    /// Tells the last picture from others; 0: none has come.
    #[must_use]
    pub fn print(&self) -> u64 {
        self.last.map_or(0, |last| last.prints[0] ^ last.prints[1].rotate_left(1))
    }

    /// What is wrong with the stream; none: nothing.
    #[must_use]
    pub fn fault(&self) -> Option<StreamFault> {
        let mut believed = StreamFault::ALL.into_iter().zip(&self.suspicions);
        believed.find(|(_, suspicion)| suspicion.believed.is_some()).map(|(fault, _)| fault)
    }
}

#[cfg(test)]
mod tests;
