//! Colour and depth come by themselves: those of nearly the same stamp are one image.

use std::collections::VecDeque;

/// As many of a kind wait for their other half.
const MOST_WAITING: usize = 4;

/// Half an image: when it was taken, ns, and its bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Half {
    /// ns.
    pub stamp: u64,
    /// In the picture's size.
    pub bytes: Vec<u8>,
}

/// Which half.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Side {
    Colour,
    Depth,
}

/// What waits.
#[derive(Debug)]
pub struct Pairs {
    within: u64,
    colour: VecDeque<Half>,
    depth: VecDeque<Half>,
    lost: u64,
}

impl Pairs {
    /// Of stamps not farther apart than `within`, ns.
    #[must_use]
    pub fn new(within: u64) -> Self {
        Pairs { within, colour: VecDeque::new(), depth: VecDeque::new(), lost: 0 }
    }

    /// Takes a half; gives colour and depth of an image that it completes. Halves that are older than these are lost.
    pub fn take(&mut self, side: Side, half: Half) -> Option<(Half, Half)> {
        let (own, other) = match side {
            Side::Colour => (&mut self.colour, &mut self.depth),
            Side::Depth => (&mut self.depth, &mut self.colour),
        };
        let apart = |waiting: &Half| waiting.stamp.abs_diff(half.stamp);
        let nearest = (0..other.len()).min_by_key(|&k| apart(&other[k])).filter(|&k| apart(&other[k]) <= self.within);
        let Some(k) = nearest else {
            own.push_back(half);
            if own.len() > MOST_WAITING {
                own.pop_front();
                self.lost += 1;
            }
            return None;
        };
        self.lost += k as u64 + own.iter().filter(|waiting| waiting.stamp < half.stamp).count() as u64;
        own.retain(|waiting| waiting.stamp >= half.stamp);
        let found = other.drain(..=k).next_back()?;
        Some(match side {
            Side::Colour => (half, found),
            Side::Depth => (found, half),
        })
    }

    /// Halves that never found the other, since the last time that this was asked.
    pub fn take_lost(&mut self) -> u64 {
        std::mem::take(&mut self.lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn half(stamp: u64) -> Half {
        Half { stamp, bytes: Vec::new() }
    }

    fn stamps(pair: Option<(Half, Half)>) -> Option<(u64, u64)> {
        pair.map(|(colour, depth)| (colour.stamp, depth.stamp))
    }

    #[test]
    fn halves_pair_by_stamp_in_either_order() {
        let mut pairs = Pairs::new(5);
        assert_eq!(stamps(pairs.take(Side::Colour, half(100))), None);
        assert_eq!(stamps(pairs.take(Side::Depth, half(104))), Some((100, 104)));
        assert_eq!(stamps(pairs.take(Side::Depth, half(200))), None);
        assert_eq!(stamps(pairs.take(Side::Depth, half(203))), None);
        assert_eq!(stamps(pairs.take(Side::Colour, half(202))), Some((202, 203)));
        assert_eq!(pairs.take_lost(), 1);
    }

    #[test]
    fn stamps_farther_apart_do_not_pair_and_no_more_wait_than_four() {
        let mut pairs = Pairs::new(5);
        for k in 0..100 {
            assert_eq!(stamps(pairs.take(Side::Colour, half(100 * k))), None);
            assert_eq!(stamps(pairs.take(Side::Depth, half(100 * k + 50))), None);
        }
        assert_eq!((pairs.colour.len(), pairs.depth.len(), pairs.take_lost()), (4, 4, 192));
    }

    #[test]
    fn an_image_is_sent_once() {
        let mut pairs = Pairs::new(5);
        pairs.take(Side::Colour, half(100));
        assert!(pairs.take(Side::Depth, half(100)).is_some());
        assert!(pairs.take(Side::Depth, half(100)).is_none());
    }
}
