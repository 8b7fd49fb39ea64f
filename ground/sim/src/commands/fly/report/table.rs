//! The campaign's table for the terminal.

use std::fmt::Write;

use super::{Cell, Closest, Range, Report};

/// Two decimals, and no minus before zero.
fn two(value: f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" { "0.00".to_owned() } else { text }
}

/// A heading, and what a cell says below it; none: nothing.
type Column = (&'static str, fn(&Cell) -> Option<String>);

const COLUMNS: [Column; 24] = [
    ("cell", |c| Some(c.cell.to_string())),
    ("task", |c| Some(c.task.to_owned())),
    ("pilot", |c| Some(c.pilot.to_owned())),
    ("asked", |c| Some(c.speed_mps.to_string())),
    ("cruise", |c| Some(c.cruise_speed_mps.map_or("-".to_owned(), |v| format!("{v:.1}")))),
    ("peak", |c| Some(format!("{:.1}", c.peak_speed_mps))),
    ("world", |c| Some(c.place())),
    ("success", |c| Some(format!("{}/{}", c.successes, c.trials))),
    ("95 %", |c| {
        let [low, high] = c.success_interval.map(|share| 100.0 * share);
        Some(format!("{low:.0}-{high:.0} %"))
    }),
    ("reached", |c| Some(c.reached.to_string())),
    ("collision", |c| Some(c.failures.collision.to_string())),
    ("lost", |c| count(c.failures.lost)),
    ("timeout", |c| count(c.failures.timeout)),
    ("too close", |c| count(c.failures.too_close)),
    ("behind", |c| count(c.failures.behind)),
    ("out of view", |c| count(c.failures.out_of_view)),
    ("slow", |c| count(c.failures.slow)),
    ("clearance min/5/50", |c| Some([c.clearance_m.min, c.clearance_m.p5, c.clearance_m.p50].map(number).join("/"))),
    ("in view", |c| c.in_view_fraction.map(|share| format!("{:.0} %", 100.0 * share))),
    ("dist mean/x", |c| c.target_distance_m.map(|d| format!("{:.1}/{:.1}", d.mean, d.max))),
    ("least min/1/50", |c| c.min_distance_to_target_m.map(|d| [d.min, d.p1, d.p50].map(two).join("/"))),
    ("lateral, along 5..95", |c| {
        let spread = |r: Range| format!("{}..{}", two(r.p5), two(r.p95));
        c.target_error_m.map(|e| format!("{}, {}", spread(e.lateral), spread(e.longitudinal)))
    }),
    ("to goal 50/95", |c| c.time_to_goal_s.map(|q| format!("{:.1}/{:.1} s", q.p50, q.p95))),
    ("jerk² mean/95", |c| {
        let most = c.jerk_integral_quantiles.map_or("-".to_owned(), |q| format!("{:.0}", q.p95));
        Some(format!("{:.0}/{most}", c.jerk_integral))
    }),
];

/// None of nothing: a column without any is left out.
fn count(flights: usize) -> Option<String> {
    (flights > 0).then(|| flights.to_string())
}

fn number(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), two)
}

/// One line a cell, what a success is, then the timing. Columns of which no cell has anything are left out.
#[must_use]
pub fn table(report: &Report) -> String {
    let mut lines = vec![String::new(); report.cells.len() + 1];
    for (heading, read) in COLUMNS {
        let values: Vec<Option<String>> = report.cells.iter().map(read).collect();
        if values.iter().all(Option::is_none) {
            continue;
        }
        let blank = if values.iter().flatten().all(|value| value.parse::<usize>().is_ok()) { "0" } else { "-" };
        let values = values.into_iter().map(|value| value.unwrap_or_else(|| blank.to_owned()));
        let column: Vec<String> = std::iter::once(heading.to_owned()).chain(values).collect();
        let width = column.iter().map(|text| text.chars().count()).max().unwrap_or(0);
        for (line, text) in lines.iter_mut().zip(column) {
            let gap = if line.is_empty() { "" } else { "  " };
            let _ = write!(line, "{gap}{text:>width$}");
        }
    }
    let mut text = lines.join("\n") + "\n";
    let _ = writeln!(text, "{}", report.rule);
    text += &target(report);
    let t = &report.timing;
    for c in &t.compute {
        let [perception, mapping, planning, control] =
            [c.perception_ms, c.mapping_ms, c.planning_ms, c.control_ms].map(|cost| cost.mean);
        let _ = writeln!(
            text,
            "{}: {:.2} ms a plan (p99 {:.2}): perception {perception:.2}, mapping {mapping:.2}, planning {planning:.2}, \
             control {control:.3}",
            c.pilot, c.total_ms.mean, c.total_ms.p99
        );
    }
    if t.threads == 0 {
        return text + "flown before";
    }
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

/// What all cells of a chase come to together; nothing of a single one.
fn target(report: &Report) -> String {
    let closest = Closest::of(report.flown.iter().flatten().map(|f| &f.flight));
    let Some(d) = closest.filter(|_| report.cells.len() > 1) else { return String::new() };
    let (flights, (least, p1)) = (report.flown.iter().flatten().count(), (two(d.min), two(d.p1)));
    let sum = |count: &dyn Fn(&Cell) -> usize| report.cells.iter().map(count).sum::<usize>();
    let touched = sum(&|c| c.contacts.get("person").copied().unwrap_or(0));
    let lost = sum(&|c| c.failures.lost);
    format!(
        "target, {flights} flights: touched in {touched}, lost in {lost}; least distance {least} m, in 1 of 100 below {p1} m\n"
    )
}
