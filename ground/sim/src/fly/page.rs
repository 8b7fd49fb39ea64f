//! The report of a campaign for people to look at: one page that needs nothing else, its figures as SVG, its tables as
//! CSV. It holds nothing that depends on the machine: the same campaign gives the same page, byte for byte.

mod axis;
mod cells;
mod contour;
mod distribution;
mod flights;
mod html;
mod map;
mod outcomes;
mod svg;
mod tables;
mod view;

use std::io;
use std::path::Path;

use super::files::Files;
use super::report::Report;
use cells::{Pool, pools};
use distribution::Distribution;
use svg::Svg;

/// A drawing with its words.
struct Figure {
    /// Its file's name, without `.svg`.
    name: String,
    title: &'static str,
    caption: &'static str,
    svg: Svg,
}

/// A quantity whose distribution is shown.
struct Quantity {
    name: &'static str,
    title: &'static str,
    unit: &'static str,
    caption: &'static str,
    logarithmic: bool,
    from_zero: bool,
    band: Option<f64>,
    values: fn(&Pool<'_>) -> Vec<f64>,
}

impl Quantity {
    const fn new(name: &'static str, unit: &'static str, values: fn(&Pool<'_>) -> Vec<f64>) -> Self {
        Self { name, title: "", unit, caption: "", logarithmic: false, from_zero: true, band: None, values }
    }
}

const QUANTITIES: [Quantity; 8] = [
    Quantity {
        title: "Distance to the runner",
        caption: "20 times a second, all flights.",
        ..Quantity::new("distance", "m", cells::distances_m)
    },
    Quantity {
        title: "Speed",
        caption: "20 times a second, all flights.",
        ..Quantity::new("speed", "m/s", cells::speeds_mps)
    },
    Quantity {
        title: "Closest approach",
        caption: "One value a flight, from the vehicle’s sphere to the nearest obstacle; 0: it touched.",
        ..Quantity::new("closest-approach", "m", cells::closest_m)
    },
    Quantity {
        title: "Clearance",
        caption: "20 times a second, all flights; farther than 10 m counts as 10 m.",
        ..Quantity::new("clearance", "m", cells::clearances_m)
    },
    Quantity {
        title: "Time in view",
        caption: "One value a flight: frames that show the runner, of all frames.",
        ..Quantity::new("in-view", "%", cells::in_view_percent)
    },
    Quantity {
        title: "Smoothness ∫ jerk²",
        caption: "One value a flight, of the true motion’s 20 ms means; less is smoother.",
        logarithmic: true,
        from_zero: false,
        ..Quantity::new("smoothness", "m²/s⁵", cells::jerks)
    },
    Quantity {
        title: "Lateral error of the target’s estimate",
        caption: "Across the line of sight, each frame with an estimate. Dashed: ± 0.5 m.",
        from_zero: false,
        band: Some(0.5),
        ..Quantity::new("error-lateral", "m", cells::lateral_m)
    },
    Quantity {
        title: "Longitudinal error of the target’s estimate",
        caption: "Along the line of sight, positive: estimated too far. Dashed: ± 0.75 m.",
        from_zero: false,
        band: Some(0.75),
        ..Quantity::new("error-longitudinal", "m", cells::longitudinal_m)
    },
];

/// Writes index.html, report.json, the figures and the tables into a folder that exists. The flights must have been
/// traced. `command`: flies the campaign again.
///
/// # Errors
/// A file cannot be written, or a flight's world cannot be grown again.
pub fn write(folder: &Path, report: &Report, command: &str, files: &Files) -> io::Result<()> {
    let pools = pools(report);
    let outcomes = outcomes(&pools);
    let distributions = distributions(&pools);
    let flights = flights::flights(report, &pools, command).map_err(io::Error::other)?;
    for figure in outcomes.iter().chain(&distributions) {
        files.write(&folder.join(format!("{}.svg", figure.name)), figure.svg.file().as_bytes())?;
    }
    for flight in &flights.shown {
        files.write(&folder.join(format!("{}.svg", flight.name)), flight.svg.file().as_bytes())?;
    }
    let named: Vec<_> = QUANTITIES.iter().map(|q| (q.name, q.unit, pools.iter().map(q.values).collect())).collect();
    files.write(&folder.join("cells.csv"), tables::cells_csv(report).as_bytes())?;
    files.write(&folder.join("flights.csv"), tables::flights_csv(report).as_bytes())?;
    files.write(&folder.join("distributions.csv"), tables::distributions_csv(&pools, &named).as_bytes())?;
    files.write(&folder.join("report.json"), &report.to_json())?;
    let page = html::page(&html::Contents { report, pools: &pools, command, outcomes, distributions, flights });
    files.write(&folder.join("index.html"), page.as_bytes())
}

fn outcomes(pools: &[Pool<'_>]) -> Vec<Figure> {
    let mut figures = vec![
        Figure {
            name: "success".to_owned(),
            title: "Success against speed",
            caption: "Whiskers: 95 % intervals (Wilson).",
            svg: outcomes::success(pools),
        },
        Figure {
            name: "failures".to_owned(),
            title: "How the flights ended",
            caption: "Of each cell (speed · spacing); counts in the bars.",
            svg: outcomes::failures(pools),
        },
    ];
    figures.extend(view::view(pools).map(|svg| Figure {
        name: "view".to_owned(),
        title: "Where the runner was in the camera’s image",
        caption: "Its true centre, hidden or not, 20 times a second; the stronger, the more of the time in that bin of 8 × 8 px.",
        svg,
    }));
    figures
}

fn distributions(pools: &[Pool<'_>]) -> Vec<Figure> {
    let draw = |quantity: &Quantity| {
        let rows = pools.iter().map(|pool| (pool.label(), (quantity.values)(pool))).collect();
        let Quantity { title, unit, logarithmic, from_zero, band, .. } = *quantity;
        let svg = Distribution { title, unit, logarithmic, from_zero, band, rows }.draw()?;
        Some(Figure { name: quantity.name.to_owned(), title, caption: quantity.caption, svg })
    };
    QUANTITIES.iter().filter_map(draw).collect()
}
