//! The page itself. Well-formed as XML too, so that it can be checked.

use std::fmt::Write;

use super::super::pick::Pick;
use super::super::report::{Cell, Report};
use super::super::stats::{quantile, wilson};
use super::Figure;
use super::cells::{self, Pool};
use super::flights::{Flights, Shown};
use super::svg::{STYLE, escape, n};
use super::tables;

/// What is on the page.
pub(super) struct Contents<'a> {
    pub(super) report: &'a Report,
    pub(super) pools: &'a [Pool<'a>],
    pub(super) command: &'a str,
    pub(super) outcomes: Vec<Figure>,
    pub(super) distributions: Vec<Figure>,
    pub(super) flights: Flights<'a>,
}

/// The whole page.
pub(super) fn page(contents: &Contents<'_>) -> String {
    let Contents { report, pools, outcomes, distributions, flights, .. } = contents;
    let (successes, trials) = totals(pools);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <title>{successes} of {trials}: {}</title>\n<style>\n{}{STYLE}</style>\n</head>\n<body>\n<main>\n",
        escape(&what(report)),
        include_str!("page.css"),
    );
    head(&mut page, contents, successes, trials);
    let (pair, view): (Vec<&Figure>, Vec<&Figure>) = outcomes.iter().partition(|figure| figure.name != "view");
    page += "<div class=\"grid2\">\n";
    pair.iter().for_each(|figure| panel(&mut page, figure, ""));
    page += "</div>\n<h2>Cells</h2>\n<div class=\"panel wide\">\n";
    page += &tables::html(report);
    page += "</div>\n";
    if !view.is_empty() {
        page += "<h2>View</h2>\n";
        view.iter().for_each(|figure| panel(&mut page, figure, " wide"));
    }
    page += "<h2>Distributions</h2>\n<p class=\"note\">Thin bar: 5 to 95 %; thick: 25 to 75 %; ring: median.</p>\n\
             <div class=\"grid2\">\n";
    distributions.iter().for_each(|figure| panel(&mut page, figure, ""));
    page += "</div>\n";
    flight_sections(&mut page, flights);
    footer(&mut page, contents);
    page + "</main>\n</body>\n</html>\n"
}

fn totals(pools: &[Pool<'_>]) -> (usize, usize) {
    pools.iter().fold((0, 0), |(s, t), pool| (s + pool.cell.successes, t + pool.cell.trials))
}

/// As in "track · forest · 3, 5 m/s, spacing 4 m".
fn what(report: &Report) -> String {
    let Some(first) = report.cells.first() else { return String::new() };
    let listed = |value: fn(&Cell) -> f64| {
        let mut values: Vec<f64> = report.cells.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values.into_iter().map(n).collect::<Vec<_>>().join(", ")
    };
    let speed = listed(|c| c.speed_mps);
    let spacing =
        if first.world == "forest" { format!(", spacing {} m", listed(|c| c.spacing_m)) } else { String::new() };
    let moving = if first.moving > 0 { format!(", {} moving obstacles", first.moving) } else { String::new() };
    let wind = if first.wind_mps > 0.0 { format!(", gusts to {} m/s", n(first.wind_mps)) } else { String::new() };
    format!("{} · {} · {speed} m/s{spacing}{moving}{wind}", first.task, first.world)
}

fn head(page: &mut String, contents: &Contents<'_>, successes: usize, trials: usize) {
    let Contents { report, pools, .. } = contents;
    let [low, high] = wilson(successes, trials).map(|share| (100.0 * share).round());
    let sum = |part: fn(&Pool<'_>) -> usize| pools.iter().map(part).sum::<usize>();
    let reasons = [
        (sum(|p| p.cell.failures.collision), "collided"),
        (sum(|p| p.cell.failures.lost), "lost the runner"),
        (sum(|p| p.cell.failures.timeout), "ran out of time"),
        (sum(|p| p.cell.failures.too_close), "came too close to the runner"),
    ];
    let reasons: Vec<String> =
        reasons.iter().filter(|(count, _)| *count > 0).map(|(count, why)| format!("{count} {why}")).collect();
    let reasons = if reasons.is_empty() { "none failed".to_owned() } else { reasons.join(", ") };
    let _ = write!(
        page,
        "<p class=\"what\">{}</p>\n<h1>{successes} of {trials} flights succeeded</h1>\n\
         <p class=\"note\">95 % interval {low}–{high} %; {reasons}.</p>\n<div class=\"tiles\">\n",
        escape(&what(report))
    );
    let pooled = |values: fn(&Pool<'_>) -> Vec<f64>, q| quantile(&pools.iter().flat_map(values).collect::<Vec<_>>(), q);
    let frames: f64 = pools.iter().flat_map(|p| p.flown).map(|f| f.flight.metrics.frames as f64).sum();
    let seen: f64 = pools.iter().flat_map(|p| p.flown).map(|f| f.flight.metrics.frames_in_view as f64).sum();
    let tracks = report.cells.iter().any(|cell| cell.in_view_fraction.is_some());
    tile(page, (tracks && frames > 0.0).then(|| 100.0 * seen / frames), 0, "%", "of the time in view");
    tile(page, pooled(cells::distances_m, 0.5), 1, "m", "median distance to the runner");
    tile(page, pooled(cells::closest_m, 0.5), 2, "m", "median closest approach");
    tile(page, pooled(cells::closest_m, 0.0), 2, "m", "closest of all");
    tile(page, pooled(cells::speeds_mps, 0.5), 1, "m/s", "median speed");
    tile(page, pooled(cells::speeds_mps, 1.0), 1, "m/s", "highest speed");
    page.push_str("</div>\n");
}

fn tile(page: &mut String, value: Option<f64>, places: usize, unit: &str, what: &str) {
    if let Some(value) = value {
        let _ = writeln!(
            page,
            "<div class=\"tile\"><b>{value:.places$} <small>{unit}</small></b><span>{what}</span></div>"
        );
    }
}

fn panel(page: &mut String, figure: &Figure, class: &str) {
    let (title, caption) = (escape(figure.title), escape(figure.caption));
    let _ = write!(
        page,
        "<figure class=\"panel{class}\"><h3>{title}</h3><figcaption>{caption}</figcaption>\n{}</figure>\n",
        figure.svg.inline()
    );
}

fn flight_sections(page: &mut String, flights: &Flights<'_>) {
    let (failed, succeeded) = flights.shown.split_at(flights.failed);
    let key = "From above: the vehicle’s path coloured by speed, and the runner’s, dotted where the camera did not see \
               it; thin lines join the two every 2 s. White ring: the start; disc: the runner at the end, or the goal. \
               The end: tick for success, cross for a collision, ring for lost, bar for a timeout, two rings for too close. Obstacles are cut at \
               the height of the flight, of a collision at that of the contact.";
    if !flights.shown.is_empty() {
        let _ = writeln!(page, "<h2>Flights</h2>\n<p class=\"note key\">{key}</p>");
    }
    for (title, of) in [("Failures", failed), ("First successes", succeeded)] {
        if of.is_empty() {
            continue;
        }
        let _ = write!(page, "<h3 class=\"of\">{title}</h3>\n<div class=\"grid2\">\n");
        of.iter().for_each(|shown| flight(page, shown));
        page.push_str("</div>\n");
        if title == "Failures" && !flights.more.is_empty() {
            let picks: Vec<String> = flights.more.iter().map(Pick::to_string).collect();
            let _ = writeln!(page, "<p class=\"note\">{} more failed: {}.</p>", picks.len(), picks.join(", "));
        }
    }
}

fn flight(page: &mut String, shown: &Shown<'_>) {
    let row = shown.row;
    let mut facts = vec![format!("{:.1} s", row.flown_s)];
    facts.extend(row.clearance_m.map(|c| format!("closest {:.2} m", c.max(0.0))));
    facts.extend(row.in_view_fraction.map(|f| format!("in view {:.0} %", 100.0 * f)));
    facts.push(format!("{:.1} m away at the end", row.end_distance_m));
    facts.push(format!("mean {:.1} m/s", row.flown_speed_mps.mean));
    let _ = write!(
        page,
        "<figure class=\"panel flight\">\n{}<p class=\"facts\">{}</p>\n{}\n\
         <details><summary>Changes of mode</summary><ul>",
        shown.svg.inline(),
        escape(&facts.join(" · ")),
        code(&shown.command)
    );
    for mode in &row.modes {
        let _ = write!(page, "<li>{}</li>", escape(mode));
    }
    page.push_str("</ul></details>\n</figure>\n");
}

/// A command, broken between its words only.
fn code(command: &str) -> String {
    let words: Vec<String> = command.split(' ').map(|word| format!("<span>{}</span>", escape(word))).collect();
    format!("<code>{}</code>", words.join(" "))
}

fn footer(page: &mut String, contents: &Contents<'_>) {
    let report = contents.report;
    let mut facts = vec![
        ("Campaign", code(contents.command)),
        ("Seed", report.seed.to_string()),
        ("Vehicle", escape(&report.vehicle)),
        ("Policy", format!("<code>{}</code>", escape(report.policy_sha256.as_deref().unwrap_or("a stand-in")))),
        ("Height", format!("{} m above the start", n(report.height_m))),
    ];
    if report.cells.iter().any(|cell| cell.task == "track") {
        facts.push(("Desired speed", format!("the runner’s and {} m/s", n(report.speed_margin_mps))));
    }
    page.push_str("<h2>What was flown</h2>\n<div class=\"panel wide\"><dl>\n");
    for (name, value) in facts {
        let _ = writeln!(page, "<dt>{name}</dt><dd>{value}</dd>");
    }
    let _ = write!(
        page,
        "</dl></div>\n<footer>Goshawk {}. The numbers are beside this page: report.json (with how long it took), \
         cells.csv, flights.csv, distributions.csv; each figure is an .svg too.</footer>\n",
        env!("CARGO_PKG_VERSION")
    );
}
