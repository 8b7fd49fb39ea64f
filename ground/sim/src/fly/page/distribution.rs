//! Distributions, a row for each cell: shape above, the middle 50 % and 5–95 % as bars, the median as a point.

use super::axis::{Scale, short};
use super::svg::{Anchor, Svg, n, polyline};
use crate::fly::stats::quantiles;
use crate::fly::table::two;

/// What is distributed.
pub(super) struct Distribution<'a> {
    pub(super) title: &'a str,
    /// Of the axis, in brackets there.
    pub(super) unit: &'a str,
    pub(super) logarithmic: bool,
    /// The axis begins at 0.
    pub(super) from_zero: bool,
    /// Lines at plus and minus this; the axis ends at four times as much.
    pub(super) band: Option<f64>,
    /// Label and values of each cell.
    pub(super) rows: Vec<(String, Vec<f64>)>,
}

const WIDTH: f64 = 560.0;
const LEFT: f64 = 132.0;
const RIGHT: f64 = WIDTH - 92.0;
const TOP: f64 = 24.0;
/// Fewer values than this are drawn one by one.
const FEW: usize = 120;
const BINS: usize = 120;
/// Width of the kernel that smooths the bins.
const SMOOTH_BINS: f64 = 1.6;

impl Distribution<'_> {
    /// None if there are no values at all.
    pub(super) fn draw(&self) -> Option<Svg> {
        let x = self.scale()?;
        let pitch = if self.rows.len() <= 6 { 50.0 } else { 38.0 };
        let bottom = TOP + pitch * self.rows.len() as f64 + 4.0;
        let mut svg = Svg::new(WIDTH, bottom + 44.0, self.title);
        let said = if self.band.is_some() { "5 … 95 %" } else { "median" };
        svg.text("soft", Anchor::End, [WIDTH - 4.0, 14.0], said);
        for value in x.ticks(7) {
            svg.line("grid", [x.at(value), TOP], [x.at(value), bottom]);
            svg.text("soft", Anchor::Middle, [x.at(value), bottom + 16.0], &short(value));
        }
        svg.text(
            "soft",
            Anchor::Middle,
            [0.5 * (LEFT + RIGHT), bottom + 36.0],
            &format!("{} [{}]", self.title, self.unit),
        );
        for limit in self.band.iter().flat_map(|b| [-b, *b]).filter(|b| (0.0..=1.0).contains(&x.fraction(*b))) {
            svg.line("band", [x.at(limit), TOP - 4.0], [x.at(limit), bottom]);
            svg.text("soft", Anchor::Middle, [x.at(limit), TOP - 9.0], &format!("{limit:+}"));
        }
        for (index, (label, values)) in self.rows.iter().enumerate() {
            let base = TOP + pitch * (index + 1) as f64 - 12.0;
            svg.text("", Anchor::End, [LEFT - 10.0, base + 4.0], label);
            self.row(&mut svg, &x, base, pitch - 20.0, label, values);
        }
        Some(svg)
    }

    fn scale(&self) -> Option<Scale> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (_, values) in &self.rows {
            // Of many values the rarest may lie beyond the axis.
            let rare = match self.band {
                Some(_) => 0.05,
                None if values.len() < FEW => 0.0,
                None => 0.004,
            };
            let Some([least, most]) = quantiles(values, [rare, 1.0 - rare]) else { continue };
            (low, high) = (low.min(least), high.max(most));
        }
        if self.from_zero {
            low = low.min(0.0);
        }
        if let Some(band) = self.band {
            let most = (1.2 * low.abs().max(high.abs())).clamp(1.6 * band, 4.0 * band);
            return (low <= high).then(|| Scale::linear([-most, most], [LEFT, RIGHT]));
        }
        let logarithmic = self.logarithmic && low > 0.0 && high / low > 8.0;
        (low <= high).then(|| Scale::around(low, high, [LEFT, RIGHT], logarithmic))
    }

    fn row(&self, svg: &mut Svg, x: &Scale, base: f64, height: f64, label: &str, values: &[f64]) {
        svg.line("axis", [LEFT, base], [RIGHT, base]);
        let Some([p5, p25, p50, p75, p95]) = quantiles(values, [0.05, 0.25, 0.5, 0.75, 0.95]) else {
            svg.text("soft", Anchor::End, [WIDTH - 4.0, base + 4.0], "–");
            return;
        };
        let hint = format!(
            "{label}: 5 % {}, 25 % {}, median {}, 75 % {}, 95 % {} {} ({} values)",
            n(p5),
            n(p25),
            n(p50),
            n(p75),
            n(p95),
            self.unit,
            values.len()
        );
        svg.open("", &hint);
        if values.len() < FEW {
            dots(svg, x, base, height, values)
        } else {
            density(svg, x, base, height, values)
        }
        svg.line("reach", [x.held(p5), base], [x.held(p95), base]);
        svg.line("middle-half", [x.held(p25), base], [x.held(p75), base]);
        svg.circle("median", [x.held(p50), base], 4.0);
        svg.close();
        let said = match self.band {
            Some(_) => format!("{} … {}", two(p5), two(p95)),
            None if p50.abs() >= 100.0 => short(p50.round()),
            None if p50.abs() >= 10.0 => format!("{p50:.1}"),
            None => two(p50),
        };
        svg.text("strong", Anchor::End, [WIDTH - 4.0, base + 4.0], &said);
    }
}

/// A dot for each, those at the same place on top of each other.
fn dots(svg: &mut Svg, x: &Scale, base: f64, height: f64, values: &[f64]) {
    const DOT: f64 = 5.0;
    let mut stacks = std::collections::BTreeMap::<i64, usize>::new();
    for value in values {
        *stacks.entry((x.held(*value) / DOT).round() as i64).or_default() += 1;
    }
    let tallest = stacks.values().copied().max().unwrap_or(1);
    let step = DOT.min((height - 6.0) / tallest as f64);
    for (column, count) in stacks {
        for level in 0..count {
            svg.circle("dot", [column as f64 * DOT, base - 8.0 - step * level as f64], 2.4);
        }
    }
}

fn density(svg: &mut Svg, x: &Scale, base: f64, height: f64, values: &[f64]) {
    let mut counts = [0.0f64; BINS];
    for value in values {
        let bin = (x.fraction(*value) * BINS as f64).floor();
        if (0.0..BINS as f64).contains(&bin) {
            counts[bin as usize] += 1.0;
        }
    }
    let kernel = |away: f64| (-0.5 * (away / SMOOTH_BINS).powi(2)).exp();
    let smooth = |bin: usize| (0..BINS).map(|other| counts[other] * kernel(bin as f64 - other as f64)).sum::<f64>();
    let heights: Vec<f64> = (0..BINS).map(smooth).collect();
    let highest = heights.iter().copied().fold(1e-9, f64::max);
    let place = |bin: usize| x.pixels[0] + (bin as f64 + 0.5) / BINS as f64 * (x.pixels[1] - x.pixels[0]);
    let top = heights.iter().enumerate().map(|(bin, h)| [place(bin), base - height * h / highest]);
    let outline = [[place(0), base]].into_iter().chain(top).chain([[place(BINS - 1), base]]);
    svg.path("density", &format!("{}Z", polyline(outline)));
}
