//! What failed in a campaign, in a few lines.

use super::pick::{Pick, again};
use super::report::{Cell, Report};

/// At most so many flights of a class are named.
const NAMED: usize = 20;

/// A line for each class of failures, and how to fly the first again; nothing if none failed.
#[must_use]
pub fn failures(report: &Report) -> String {
    let mut classes: Vec<(String, Vec<Pick>)> = Vec::new();
    for (class, pick) in report.cells.iter().flat_map(failed) {
        match classes.iter_mut().find(|known| known.0 == class) {
            Some(known) => known.1.push(pick),
            None => classes.push((class, vec![pick])),
        }
    }
    let Some(first) = classes.iter().filter_map(|class| class.1.first()).min() else { return String::new() };
    let mut text = String::new();
    for (class, picks) in &classes {
        let named: Vec<String> = picks.iter().take(NAMED).map(Pick::to_string).collect();
        let more = picks.len() - named.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        text += &format!("\nfailed: {class} {}{more}", named.join(","));
    }
    text + &format!("\nre-fly one: {}", again(&report.command, *first))
}

fn failed(cell: &Cell) -> impl Iterator<Item = (String, Pick)> {
    cell.flights.iter().filter(|flight| flight.outcome != "success").map(|flight| {
        let class = flight.contact.map_or(flight.outcome.to_owned(), |what| format!("{} ({what})", flight.outcome));
        (class, Pick { cell: cell.cell, trial: flight.trial })
    })
}
