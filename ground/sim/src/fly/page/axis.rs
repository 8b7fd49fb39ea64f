//! Scales from values to pixels, and their ticks.

use super::svg::n;

/// An axis of values, linear or by powers of ten.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    /// Lowest and highest value.
    pub(super) values: [f64; 2],
    /// Where they are, px.
    pub(super) pixels: [f64; 2],
    pub(super) logarithmic: bool,
}

impl Scale {
    pub(super) fn linear(values: [f64; 2], pixels: [f64; 2]) -> Self {
        Self { values, pixels, logarithmic: false }
    }

    /// From just below the least value to just above the greatest, with round ends; none of no values.
    pub(super) fn around(low: f64, high: f64, pixels: [f64; 2], logarithmic: bool) -> Self {
        if logarithmic {
            return Self { values: [low / 1.2, high * 1.2], pixels, logarithmic };
        }
        let step = step((high - low).max(0.05 * high.abs()).max(1e-3), 5);
        let values = [(low / step + 1e-6).floor() * step, (high / step - 1e-6).ceil() * step];
        Self { values: if values[0] < values[1] { values } else { [low, low + step] }, pixels, logarithmic }
    }

    /// 0..=1 over the axis; outside it beyond.
    pub(super) fn fraction(&self, value: f64) -> f64 {
        let [low, high] = self.values;
        if self.logarithmic { (value.max(1e-9) / low).ln() / (high / low).ln() } else { (value - low) / (high - low) }
    }

    pub(super) fn at(&self, value: f64) -> f64 {
        self.pixels[0] + self.fraction(value) * (self.pixels[1] - self.pixels[0])
    }

    /// As `at`, held within the axis.
    pub(super) fn held(&self, value: f64) -> f64 {
        self.pixels[0] + self.fraction(value).clamp(0.0, 1.0) * (self.pixels[1] - self.pixels[0])
    }

    /// About `count` round values.
    pub(super) fn ticks(&self, count: usize) -> Vec<f64> {
        let [low, high] = self.values;
        if self.logarithmic {
            let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
            let parts: &[f64] = if high / low > 1e3 { &[1.0] } else { &[1.0, 2.0, 5.0] };
            let all = decades.flat_map(|d| parts.iter().map(move |part| part * 10f64.powi(d)));
            return all.filter(|v| (low..=high).contains(v)).collect();
        }
        let step = step(high - low, count);
        let first = (low / step - 1e-6).ceil() as i64;
        let last = (high / step + 1e-6).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// A round step (1, 2 or 5 times a power of ten) that divides `span` into about `count`.
fn step(span: f64, count: usize) -> f64 {
    let rough = span / count.max(1) as f64;
    let power = 10f64.powf(rough.log10().floor());
    let part = rough / power;
    power * [1.0, 2.0, 5.0].into_iter().find(|p| part <= p * 1.2).unwrap_or(10.0)
}

/// A number in little room: large ones in thousands.
pub(super) fn short(value: f64) -> String {
    if value.abs() >= 10_000.0 { format!("{}k", n((value / 1000.0).round())) } else { n(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let scale = Scale::around(0.3, 9.7, [0.0, 100.0], false);
        assert_eq!(scale.values, [0.0, 10.0]);
        assert_eq!(scale.ticks(5), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!((scale.at(5.0), scale.held(50.0)), (50.0, 100.0));
        let log = Scale::around(30.0, 700.0, [0.0, 1.0], true);
        assert_eq!(log.ticks(5), [50.0, 100.0, 200.0, 500.0]);
        assert_eq!(Scale::around(2.0, 2.0, [0.0, 1.0], false).values[0], 2.0);
        assert_eq!([short(25_300.0), short(0.5)], ["25k", "0.5"]);
    }
}
