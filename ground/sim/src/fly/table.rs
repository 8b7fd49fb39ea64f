//! The campaign's table for the terminal.

use std::fmt::Write;

use super::report::{Cell, Closest, Report};

/// Two decimals, and no minus before zero.
pub(super) fn two(value: f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" { "0.00".to_owned() } else { text }
}

/// One line a cell, then the timing.
#[must_use]
pub fn table(report: &Report) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{:>4} {:<16}{:>6}{:>15}{:>10}{:>11}{:>10}{:>6}{:>9}{:>11}{:>19}{:>8}{:>12}{:>16}{:>14}{:>14}{:>14}{:>13}",
        "cell",
        "task",
        "speed",
        "world",
        "success",
        "95 %",
        "collision",
        "lost",
        "timeout",
        "too close",
        "clearance min/5/50",
        "in view",
        "dist mean/x",
        "least min/1/50",
        "lateral 5..95",
        "along 5..95",
        "jerk² mean/95",
        "flown mean/x"
    );
    for cell in &report.cells {
        let _ = writeln!(text, "{}", row(cell));
    }
    let closest = Closest::of(report.flown.iter().flatten().map(|f| &f.flight));
    if let Some(d) = closest.filter(|_| report.cells.len() > 1) {
        let (flights, (least, p1)) = (report.flown.iter().flatten().count(), (two(d.min), two(d.p1)));
        let sum = |count: &dyn Fn(&Cell) -> usize| report.cells.iter().map(count).sum::<usize>();
        let touched = sum(&|c| c.contacts.get("person").copied().unwrap_or(0));
        let lost = sum(&|c| c.failures.lost);
        let _ = writeln!(
            text,
            "target, {flights} flights: touched in {touched}, lost in {lost}; least distance {least} m, in 1 of 100 below {p1} m"
        );
    }
    let t = &report.timing;
    let _ = write!(
        text,
        "{:.0} s of flight in {:.1} s: {:.1} x real time ({} threads, {:.1} x each)",
        t.simulated_s,
        t.wall_s,
        t.realtime_factor,
        t.threads,
        t.realtime_factor / t.threads.max(1) as f64
    );
    text
}

fn row(cell: &Cell) -> String {
    let [low, high] = cell.success_interval;
    let number = |value: Option<f64>| value.map_or("-".to_owned(), two);
    let c = &cell.clearance_m;
    let range =
        |r: Option<super::report::Range>| r.map_or("-".to_owned(), |r| format!("{}..{}", two(r.p5), two(r.p95)));
    format!(
        "{:>4} {:<16}{:>6}{:>15}{:>10}{:>11}{:>10}{:>6}{:>9}{:>11}{:>19}{:>8}{:>12}{:>16}{:>14}{:>14}{:>14}{:>13}",
        cell.cell,
        if cell.pilot == "policy" { cell.task.to_owned() } else { format!("{}, {}", cell.task, cell.pilot) },
        cell.speed_mps,
        cell.place(),
        format!("{}/{}", cell.successes, cell.trials),
        format!("{:.0}-{:.0} %", 100.0 * low, 100.0 * high),
        cell.failures.collision,
        cell.failures.lost,
        cell.failures.timeout,
        cell.failures.too_close,
        format!("{}/{}/{}", number(c.min), number(c.p5), number(c.p50)),
        cell.in_view_fraction.map_or("-".to_owned(), |f| format!("{:.0} %", 100.0 * f)),
        cell.target_distance_m.map_or("-".to_owned(), |d| format!("{:.1}/{:.1}", d.mean, d.max)),
        cell.min_distance_to_target_m.map_or("-".to_owned(), |d| format!(
            "{}/{}/{}",
            two(d.min),
            two(d.p1),
            two(d.p50)
        )),
        range(cell.target_error_m.map(|e| e.lateral)),
        range(cell.target_error_m.map(|e| e.longitudinal)),
        format!(
            "{:.0}/{}",
            cell.jerk_integral,
            cell.jerk_integral_quantiles.map_or("-".to_owned(), |q| format!("{:.0}", q.p95))
        ),
        format!("{:.1}/{:.1}", cell.flown_speed_mps.mean, cell.flown_speed_mps.max),
    )
}
