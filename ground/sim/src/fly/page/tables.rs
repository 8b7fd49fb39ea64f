//! The numbers behind the pictures: a table for the page, and CSV.

use std::fmt::Write;

use super::super::report::{Cell, Range, Report};
use super::axis::short;
use super::cells::Pool;
use super::svg::{escape, n};
use crate::fly::stats::quantiles;
use crate::fly::table::two;

/// Columns of the page's table: head, and what stands under it.
const COLUMNS: [(&str, &str); 17] = [
    ("cell", ""),
    ("speed", "m/s"),
    ("world", ""),
    ("success", ""),
    ("95 %", "interval, %"),
    ("collision", ""),
    ("lost", ""),
    ("timeout", ""),
    ("too close", "to the runner"),
    ("closest approach", "min / 5 % / 50 %, m"),
    ("in view", "%"),
    ("distance", "mean / max, m"),
    ("least distance", "min / 1 % / 50 %, m"),
    ("lateral error", "5 … 95 %, m"),
    ("longitudinal error", "5 … 95 %, m"),
    ("∫ jerk²", "mean / 95 %, m²/s⁵"),
    ("flown", "mean / max, m/s"),
];

/// The cells as an HTML table.
pub(super) fn html(report: &Report) -> String {
    let mut text = "<table>\n<thead><tr>".to_owned();
    for (head, under) in COLUMNS {
        let _ = write!(text, "<th>{head}<small>{under}</small></th>");
    }
    text += "</tr></thead>\n<tbody>\n";
    for cell in &report.cells {
        text += "<tr>";
        for (index, value) in values(cell).iter().enumerate() {
            let class = match index {
                3 => " class=\"main\"",
                5..=8 if value != "0" => " class=\"bad\"",
                5..=8 => " class=\"none\"",
                _ => "",
            };
            let _ = write!(text, "<td{class}>{}</td>", escape(value));
        }
        text += "</tr>\n";
    }
    text + "</tbody>\n</table>\n"
}

fn values(cell: &Cell) -> [String; 17] {
    let number = |value: Option<f64>| value.map_or("–".to_owned(), two);
    let range = |r: Option<Range>| r.map_or("–".to_owned(), |r| format!("{} … {}", two(r.p5), two(r.p95)));
    let [low, high] = cell.success_interval.map(|share| (100.0 * share).round());
    let c = &cell.clearance_m;
    [
        cell.cell.to_string(),
        n(cell.speed_mps),
        cell.place(),
        format!("{}/{}", cell.successes, cell.trials),
        format!("{low}–{high}"),
        cell.failures.collision.to_string(),
        cell.failures.lost.to_string(),
        cell.failures.timeout.to_string(),
        cell.failures.too_close.to_string(),
        format!("{} / {} / {}", number(c.min), number(c.p5), number(c.p50)),
        cell.in_view_fraction.map_or("–".to_owned(), |f| format!("{:.0}", 100.0 * f)),
        cell.target_distance_m.map_or("–".to_owned(), |d| format!("{:.1} / {:.1}", d.mean, d.max)),
        cell.min_distance_to_target_m
            .map_or("–".to_owned(), |d| format!("{} / {} / {}", two(d.min), two(d.p1), two(d.p50))),
        range(cell.target_error_m.map(|e| e.lateral)),
        range(cell.target_error_m.map(|e| e.longitudinal)),
        format!(
            "{} / {}",
            short(cell.jerk_integral.round()),
            cell.jerk_integral_quantiles.map_or("–".to_owned(), |q| short(q.p95.round()))
        ),
        format!("{:.1} / {:.1}", cell.flown_speed_mps.mean, cell.flown_speed_mps.max),
    ]
}

fn csv(head: &str, rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut text = format!("{head}\n");
    for row in rows {
        let _ = writeln!(text, "{}", row.join(","));
    }
    text
}

fn cell_of(value: Option<f64>) -> String {
    value.map_or(String::new(), |v| v.to_string())
}

/// A line for each cell.
pub(super) fn cells_csv(report: &Report) -> String {
    let row = |c: &Cell| {
        let error = |part: fn(&Cell) -> Option<Range>| part(c);
        let lateral = error(|c| c.target_error_m.map(|e| e.lateral));
        let longitudinal = error(|c| c.target_error_m.map(|e| e.longitudinal));
        let numbers = [
            Some(c.speed_mps),
            Some(c.spacing_m),
            Some(c.wind_mps),
            Some(c.moving as f64),
            Some(c.trials as f64),
            Some(c.successes as f64),
            Some(c.success_interval[0]),
            Some(c.success_interval[1]),
            Some(c.failures.collision as f64),
            Some(c.failures.lost as f64),
            Some(c.failures.timeout as f64),
            Some(c.failures.too_close as f64),
            c.clearance_m.min,
            c.clearance_m.p5,
            c.clearance_m.p50,
            c.in_view_fraction,
            c.target_distance_m.map(|d| d.mean),
            c.target_distance_m.map(|d| d.max),
            c.min_distance_to_target_m.map(|d| d.min),
            c.min_distance_to_target_m.map(|d| d.p1),
            c.min_distance_to_target_m.map(|d| d.p50),
            lateral.map(|r| r.p5),
            lateral.map(|r| r.p95),
            longitudinal.map(|r| r.p5),
            longitudinal.map(|r| r.p95),
            Some(c.jerk_integral),
            c.jerk_integral_quantiles.map(|q| q.p5),
            c.jerk_integral_quantiles.map(|q| q.p50),
            c.jerk_integral_quantiles.map(|q| q.p95),
            Some(c.flown_speed_mps.mean),
            Some(c.flown_speed_mps.max),
        ];
        let names = [c.cell.to_string(), c.task.to_owned(), quoted(&c.world)];
        names.into_iter().chain(numbers.map(cell_of)).collect()
    };
    let head = "cell,task,world,speed_mps,spacing_m,wind_mps,moving,trials,successes,success_low,success_high,collision,lost,\
                timeout,too_close,clearance_min_m,clearance_p5_m,clearance_p50_m,in_view_fraction,distance_mean_m,\
                distance_max_m,target_min_m,target_p1_m,target_p50_m,\
                lateral_p5_m,lateral_p95_m,longitudinal_p5_m,longitudinal_p95_m,jerk_mean,jerk_p5,jerk_p50,jerk_p95,\
                flown_mean_mps,flown_max_mps";
    csv(head, report.cells.iter().map(row))
}

/// A line for each flight.
pub(super) fn flights_csv(report: &Report) -> String {
    let rows = report.cells.iter().flat_map(|cell| {
        cell.flights.iter().map(move |f| {
            let numbers = [
                Some(f.flown_s),
                Some(f.end_pos_m[0]),
                Some(f.end_pos_m[1]),
                Some(f.end_pos_m[2]),
                Some(f.end_distance_m),
                f.unseen_s,
                f.clearance_m,
                f.in_view_fraction,
                f.target_distance_m.map(|d| d.mean),
                f.target_distance_m.map(|d| d.max),
                f.min_distance_to_target_m,
                Some(f.jerk_integral),
                Some(f.flown_speed_mps.mean),
                Some(f.flown_speed_mps.max),
            ];
            let names = [
                cell.cell.to_string(),
                f.trial.to_string(),
                cell.speed_mps.to_string(),
                cell.spacing_m.to_string(),
                f.outcome.to_owned(),
                f.contact.unwrap_or_default().to_owned(),
            ];
            names.into_iter().chain(numbers.map(cell_of)).collect()
        })
    });
    let head = "cell,trial,speed_mps,spacing_m,outcome,contact,flown_s,end_x_m,end_y_m,end_z_m,end_distance_m,unseen_s,\
                clearance_m,in_view_fraction,distance_mean_m,distance_max_m,\
                target_min_m,jerk_integral,flown_mean_mps,flown_max_mps";
    csv(head, rows)
}

/// A line for each distribution of each cell. `rows`: name, unit, values.
pub(super) fn distributions_csv(pools: &[Pool<'_>], named: &[(&str, &str, Vec<Vec<f64>>)]) -> String {
    let rows = named.iter().flat_map(|(name, unit, of_cells)| {
        pools.iter().zip(of_cells).map(move |(pool, values)| {
            let of = quantiles(values, [0.05, 0.25, 0.5, 0.75, 0.95]);
            let of = of.map_or([const { String::new() }; 5], |q| q.map(|v| v.to_string()));
            let names = [pool.cell.cell.to_string(), (*name).to_owned(), (*unit).to_owned(), values.len().to_string()];
            names.into_iter().chain(of).collect()
        })
    });
    csv("cell,quantity,unit,values,p5,p25,p50,p75,p95", rows)
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}
