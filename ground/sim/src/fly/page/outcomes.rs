//! How often flights succeeded, and why they did not.

use super::axis::Scale;
use super::cells::Pool;
use super::svg::{Anchor, Svg, n, polyline};

const WIDTH: f64 = 560.0;

/// Success against speed with 95 % intervals, a line for each spacing.
pub(super) fn success(pools: &[Pool<'_>]) -> Svg {
    let mut svg = Svg::new(WIDTH, 320.0, "Success rate against speed, with 95 % intervals");
    let speeds = || pools.iter().map(|p| p.cell.speed_mps);
    let (low, high) = (speeds().fold(f64::INFINITY, f64::min), speeds().fold(0.0, f64::max));
    let room = (0.08 * (high - low)).max(0.5);
    let x = Scale::linear([low - room, high + room], [52.0, WIDTH - 12.0]);
    let y = Scale::linear([0.0, 100.0], [272.0, 42.0]);
    for tick in y.ticks(5) {
        svg.line("grid", [x.pixels[0], y.at(tick)], [x.pixels[1], y.at(tick)]);
        svg.text("soft", Anchor::End, [x.pixels[0] - 8.0, y.at(tick) + 4.0], &n(tick));
    }
    let mut ticks: Vec<f64> = speeds().collect();
    ticks.sort_by(f64::total_cmp);
    ticks.dedup();
    for tick in if ticks.len() > 12 { x.ticks(8) } else { ticks } {
        svg.text("soft", Anchor::Middle, [x.at(tick), y.pixels[0] + 18.0], &n(tick));
    }
    svg.line("axis", [x.pixels[0], y.pixels[0]], [x.pixels[1], y.pixels[0]]);
    let whose = if pools.iter().any(|p| p.cell.task == "track") { "runner’s speed" } else { "speed" };
    svg.text("soft", Anchor::Middle, [0.5 * (x.pixels[0] + x.pixels[1]), 312.0], &format!("{whose} [m/s]"));
    svg.text_up("soft", [14.0, 157.0], "success [%]");

    let mut spacings: Vec<f64> = pools.iter().map(|p| p.cell.spacing_m).collect();
    spacings.sort_by(f64::total_cmp);
    spacings.dedup();
    for (series, spacing) in spacings.iter().enumerate() {
        // Side by side, so that no interval hides another.
        let aside = 7.0 * (series as f64 - 0.5 * (spacings.len() - 1) as f64);
        let mut of: Vec<&Pool<'_>> = pools.iter().filter(|p| p.cell.spacing_m == *spacing).collect();
        of.sort_by(|a, b| a.cell.speed_mps.total_cmp(&b.cell.speed_mps));
        let at = |p: &Pool<'_>, percent: f64| [x.at(p.cell.speed_mps) + aside, y.at(percent)];
        let rate = |p: &Pool<'_>| 100.0 * p.cell.successes as f64 / p.cell.trials.max(1) as f64;
        let class = format!("c{}", series % 6);
        svg.path(&format!("curve {class}"), &polyline(of.iter().map(|p| at(p, rate(p)))));
        for pool in &of {
            let [least, most] = pool.cell.success_interval.map(|share| 100.0 * share);
            let hint = format!(
                "{}: {} of {}, {}–{} %",
                pool.label(),
                pool.cell.successes,
                pool.cell.trials,
                n(least.round()),
                n(most.round())
            );
            svg.open("", &hint);
            let ([px, bottom], [_, top]) = (at(pool, least), at(pool, most));
            svg.line(&format!("whisker {class}"), [px, bottom], [px, top]);
            for end in [bottom, top] {
                svg.line(&format!("whisker {class}"), [px - 4.0, end], [px + 4.0, end]);
            }
            marker(&mut svg, series, at(pool, rate(pool)));
            svg.close();
            if spacings.len() == 1 {
                let [px, py] = at(pool, rate(pool));
                svg.text(
                    "strong",
                    Anchor::Start,
                    [px + 9.0, py + 16.0],
                    &format!("{}/{}", pool.cell.successes, pool.cell.trials),
                );
            }
        }
        let key = [x.pixels[0] + 6.0 + 110.0 * series as f64, 16.0];
        marker(&mut svg, series, key);
        svg.text(
            "",
            Anchor::Start,
            [key[0] + 10.0, key[1] + 4.0],
            &if *spacing > 0.0 { format!("spacing {} m", n(*spacing)) } else { of[0].cell.world.clone() },
        );
    }
    svg
}

/// A sign for each series: colour is not all that tells them apart.
fn marker(svg: &mut Svg, series: usize, [x, y]: [f64; 2]) {
    let class = format!("mark c{}", series % 6);
    match series % 4 {
        0 => svg.circle(&class, [x, y], 5.0),
        1 => svg.rect(&class, [x - 4.5, y - 4.5], [9.0, 9.0], ""),
        2 => svg.path(&class, &format!("{}Z", polyline([[x, y - 6.5], [x + 6.0, y + 4.5], [x - 6.0, y + 4.5]]))),
        _ => svg.path(&class, &format!("{}Z", polyline([[x, y - 6.5], [x + 6.5, y], [x, y + 6.5], [x - 6.5, y]]))),
    }
}

/// Outcomes of each cell, stacked.
pub(super) fn failures(pools: &[Pool<'_>]) -> Svg {
    let pitch = (236.0 / pools.len() as f64).clamp(24.0, 60.0);
    let bottom = 40.0 + pitch * pools.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + 44.0, "Outcomes of each cell");
    let x = Scale::linear([0.0, 100.0], [132.0, WIDTH - 16.0]);
    for tick in x.ticks(5) {
        svg.line("grid", [x.at(tick), 36.0], [x.at(tick), bottom]);
        svg.text("soft", Anchor::Middle, [x.at(tick), bottom + 16.0], &n(tick));
    }
    svg.text("soft", Anchor::Middle, [0.5 * (x.pixels[0] + x.pixels[1]), bottom + 36.0], "share of the flights [%]");
    for (index, name) in ["success", "collision", "lost", "timeout", "too-close"].iter().enumerate() {
        let left = x.pixels[0] + 82.0 * index as f64;
        svg.rect(&format!("bar-{name}"), [left, 8.0], [11.0, 11.0], "");
        svg.text("", Anchor::Start, [left + 17.0, 18.0], name);
    }
    for (index, pool) in pools.iter().enumerate() {
        let (cell, top) = (pool.cell, 40.0 + pitch * index as f64);
        svg.text("", Anchor::End, [x.pixels[0] - 10.0, top + 0.5 * pitch + 4.0], &pool.label());
        let f = &cell.failures;
        let parts = [
            ("success", cell.successes),
            ("collision", f.collision),
            ("lost", f.lost),
            ("timeout", f.timeout),
            ("too-close", f.too_close),
        ];
        let mut left = x.pixels[0];
        for (name, count) in parts.into_iter().filter(|part| part.1 > 0) {
            let width = (x.pixels[1] - x.pixels[0]) * count as f64 / cell.trials as f64;
            let what: Vec<String> = cell.contacts.iter().map(|(what, count)| format!("{what} {count}")).collect();
            let hint = match name {
                "collision" => format!("{count} collisions: {}", what.join(", ")),
                _ => format!("{count} {name}"),
            };
            svg.open("", &hint);
            svg.rect(&format!("bar-{name}"), [left, top + 3.0], [width - 1.0, pitch - 6.0], "");
            if width > 14.0 {
                let class = if name == "success" { "" } else { "on" };
                svg.text(class, Anchor::Middle, [left + 0.5 * width, top + 0.5 * pitch + 4.0], &count.to_string());
            }
            svg.close();
            left += width;
        }
    }
    svg
}
