//! The table for the terminal.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::report::{Ordinary, Report, Row};

/// A line a fault, then a line an ordinary campaign.
pub(super) fn table(report: &Report) -> String {
    let mut text = String::new();
    if !report.faults.is_empty() {
        let _ = writeln!(
            text,
            "{:<20}{:>9}{:>7}{:>14}{:>12}  ended",
            "fault", "flights", "named", "to name, s", "collisions"
        );
        report.faults.iter().for_each(|row| text += &fault(row));
    }
    if !report.ordinary.is_empty() {
        let _ = writeln!(text, "{:<40}{:>8}{:>9}{:>8}{:>10}", "no fault", "flights", "hours", "alarms", "in 10 h");
        report.ordinary.iter().for_each(|row| text += &ordinary(row));
        let (hours, alarms) =
            report.ordinary.iter().fold((0.0, 0), |(h, n), row| (h + row.flown_h, n + row.false_alarms));
        let flights = report.ordinary.iter().map(|row| row.flights).sum();
        let all = Ordinary {
            campaign: "all".to_owned(),
            flights,
            flown_h: hours,
            false_alarms: alarms,
            names: BTreeMap::new(),
        };
        text += &ordinary(&all);
    }
    text
}

fn fault(row: &Row) -> String {
    let times = row.seconds_to_name.map_or("-".to_owned(), |t| format!("{:.2} / {:.2}", t.p50, t.max));
    let ended: Vec<String> = row.ended.iter().map(|(how, many)| format!("{how} {many}")).collect();
    format!(
        "{:<20}{:>9}{:>7}{:>14}{:>12}  {}\n",
        row.fault,
        row.flights,
        row.named,
        times,
        row.collisions,
        ended.join(", ")
    )
}

fn ordinary(row: &Ordinary) -> String {
    let names: Vec<String> = row.names.iter().map(|(name, many)| format!("  {name} {many}")).collect();
    let rate = if row.flown_h > 0.0 { 10.0 * row.false_alarms as f64 / row.flown_h } else { 0.0 };
    format!(
        "{:<40}{:>8}{:>9.2}{:>8}{:>10.1}{}\n",
        row.campaign,
        row.flights,
        row.flown_h,
        row.false_alarms,
        rate,
        names.concat()
    )
}
