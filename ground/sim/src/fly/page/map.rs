//! One flight from above: what stood in its way, its path coloured by speed, and the runner's.

use goshawk_core::Task;

use super::super::Flown;
use super::super::report::{contact_name, outcome_name};
use super::super::stats::quantile;
use super::super::trace::Sample;
use super::axis::Scale;
use super::contour::{outlines, simplified};
use super::svg::{Anchor, Svg, n, polyline};
use crate::trial::{Outcome, Scene, TrialError};

const WIDTH: f64 = 560.0;
const MARGIN: [f64; 2] = [46.0, 4.0];
const TOP: f64 = 30.0;
const BOTTOM: f64 = 22.0;
/// Shown around the paths, m; and at least so much, across and up.
const AROUND_M: f64 = 2.5;
const LEAST_M: [f64; 2] = [20.0, 8.0];
/// Height over width, at most.
const STEEPEST: f64 = 0.72;
/// Fineness of the outlines, m.
const OUTLINE_M: f64 = 0.05;
/// Shades of speed in the style.
const SHADES: usize = 8;
/// A line of sight each, s.
const SIGHT_S: f64 = 2.0;

/// The part of the world that is shown.
struct View {
    x: Scale,
    y: Scale,
    bottom: f64,
}

impl View {
    fn around(points: &[[f64; 2]]) -> Self {
        let span = |axis: usize| {
            let (low, high) = points
                .iter()
                .map(|p| p[axis])
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
            let (middle, size) = (0.5 * (low + high), (high - low + 2.0 * AROUND_M).max(LEAST_M[axis]));
            (middle, size)
        };
        let ((cx, mut width), (cy, height)) = (span(0), span(1));
        width = width.max(height / STEEPEST);
        let inner = WIDTH - MARGIN[0] - MARGIN[1];
        let bottom = TOP + inner * height / width;
        Self {
            x: Scale::linear([cx - 0.5 * width, cx + 0.5 * width], [MARGIN[0], WIDTH - MARGIN[1]]),
            y: Scale::linear([cy - 0.5 * height, cy + 0.5 * height], [bottom, TOP]),
            bottom,
        }
    }

    fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.x.at(x), self.y.at(y)]
    }
}

fn flat(of: [f32; 3]) -> [f64; 2] {
    [f64::from(of[0]), f64::from(of[1])]
}

/// The outcome in words.
pub(super) fn outcome(flown: &Flown) -> String {
    let name = outcome_name(flown.flight.outcome);
    flown.flight.contact.map_or(name.to_owned(), |what| format!("{name} ({})", contact_name(what)))
}

/// Draws a flight. `fastest_mps`: where the shades of speed end. Grows its world again.
///
/// # Errors
/// If the world cannot be had again.
pub(super) fn map(flown: &Flown, label: &str, fastest_mps: f64) -> Result<Svg, TrialError> {
    let samples: &[Sample] = flown.trace.as_ref().map_or(&[], |trace| &trace.samples);
    let scene = flown.config.scene()?;
    let start = scene.world.start_world();
    let end = flown.flight.end_world;
    let goal = (flown.config.task == Task::Navigate).then(|| [scene.goal_world.x, scene.goal_world.y]);
    let mut points = vec![[start.x, start.y], [end.x, end.y]];
    points.extend(goal);
    points.extend(samples.iter().flat_map(|s| [Some(s.pos_world), s.target.map(|t| t.pos_world)]).flatten().map(flat));
    let view = View::around(&points);

    let outcome_name = outcome_name(flown.flight.outcome);
    let title = format!("Flight {} from above: {}", flown.pick, outcome(flown));
    let mut svg = Svg::new(WIDTH, view.bottom + BOTTOM, &title);
    let said = (format!("strong say-{outcome_name}"), outcome(flown));
    svg.parts([0.0, 16.0], &[("strong", &format!("{} · {label} · ", flown.pick)), (&said.0, &said.1)]);
    key(&mut svg, fastest_mps);
    frame(&mut svg, &view);

    let heights: Vec<f64> = samples.iter().map(|s| f64::from(s.pos_world[2])).collect();
    let cut_m = match flown.flight.outcome {
        // What was hit, where it was hit.
        Outcome::Collision => end.z,
        _ => quantile(&heights, 0.5).unwrap_or(end.z),
    };
    svg.clip([view.x.pixels[0], TOP], [view.x.pixels[1] - view.x.pixels[0], view.bottom - TOP]);
    let solid = |x: f64, y: f64| scene.world.clearance(&goshawk_core::Vec3::new(x, y, cut_m));
    let corner = |k: usize| [view.x.values[k], view.y.values[k]];
    let mut solids = String::new();
    for outline in outlines(&solid, corner(0), corner(1), OUTLINE_M) {
        solids += &polyline(simplified(&outline, 0.02).into_iter().map(|p| view.at(p)));
        solids.push('Z');
    }
    svg.path("solid", &solids);
    movers(&mut svg, &view, flown, &scene);
    paths(&mut svg, &view, flown, samples, fastest_mps);
    svg.circle("start", view.at([start.x, start.y]), 4.5);
    if let Some(goal) = goal {
        svg.circle("person", view.at(goal), 5.0);
    }
    end_mark(&mut svg, outcome_name, view.at([end.x, end.y]));
    svg.close_clip();
    svg.rect("frame", [view.x.pixels[0], TOP], [view.x.pixels[1] - view.x.pixels[0], view.bottom - TOP], "");
    Ok(svg)
}

fn frame(svg: &mut Svg, view: &View) {
    for x in view.x.ticks(6) {
        svg.line("grid", [view.x.at(x), TOP], [view.x.at(x), view.bottom]);
        // The axis's name stands at its end.
        if view.x.at(x) < view.x.pixels[1] - 64.0 {
            svg.text("soft", Anchor::Middle, [view.x.at(x), view.bottom + 15.0], &n(x));
        }
    }
    for y in view.y.ticks(3) {
        svg.line("grid", [view.x.pixels[0], view.y.at(y)], [view.x.pixels[1], view.y.at(y)]);
        svg.text("soft", Anchor::End, [view.x.pixels[0] - 6.0, view.y.at(y) + 4.0], &n(y));
    }
    svg.text_up("soft", [11.0, 0.5 * (TOP + view.bottom)], "north [m]");
    svg.text("soft", Anchor::End, [view.x.pixels[1], view.bottom + 15.0], "east [m]");
}

/// The moving obstacles' ways, and where they were at the end.
fn movers(svg: &mut Svg, view: &View, flown: &Flown, scene: &Scene) {
    for mover in &scene.movers {
        let [first, last] = mover.ends().map(|end| view.at(end.into()));
        svg.line("moving", first, last);
        let radius = mover.radius_m() * (view.at([1.0, 0.0])[0] - view.at([0.0, 0.0])[0]);
        svg.circle("solid", view.at(mover.at(flown.flight.metrics.task_s).into()), radius);
    }
}

/// The shades of speed.
fn key(svg: &mut Svg, fastest_mps: f64) {
    let left = WIDTH - MARGIN[1] - 62.0 - 10.0 * SHADES as f64;
    svg.text("soft", Anchor::End, [left - 6.0, 16.0], "0");
    for shade in 0..SHADES {
        svg.rect(&format!("f{shade}"), [left + 10.0 * shade as f64, 7.0], [10.0, 10.0], "");
    }
    svg.text("soft", Anchor::End, [WIDTH - MARGIN[1], 16.0], &format!("{fastest_mps:.1} m/s"));
}

fn paths(svg: &mut Svg, view: &View, flown: &Flown, samples: &[Sample], fastest_mps: f64) {
    let place = |s: &Sample| view.at(flat(s.pos_world));
    let target = |s: &Sample| s.target.map(|t| view.at(flat(t.pos_world)));
    let every = flown.trace.as_ref().map_or(1, |trace| trace.samples_in(SIGHT_S));
    for sample in samples.iter().step_by(every) {
        if let Some(target) = target(sample) {
            svg.line("sight", place(sample), target);
        }
    }
    for (visible, run) in runs(samples, |s| s.target.is_some_and(|t| t.visible)) {
        let class = if visible { "runner" } else { "runner hidden" };
        svg.path(class, &polyline(run.iter().filter_map(target)));
    }
    let shade = |s: &Sample| {
        let share = f64::from(s.speed_mps) / fastest_mps.max(1e-9);
        ((share * SHADES as f64) as usize).min(SHADES - 1)
    };
    for (shade, run) in runs(samples, shade) {
        svg.path(&format!("way s{shade}"), &polyline(run.iter().map(place)));
    }
    if let Some(target) = samples.last().and_then(target) {
        svg.circle("person", target, 4.0);
    }
}

/// Stretches of samples that are alike, each with the first sample of the next, so that they join.
fn runs<K: PartialEq>(samples: &[Sample], kind: impl Fn(&Sample) -> K) -> Vec<(K, &[Sample])> {
    let mut runs = Vec::new();
    let mut begin = 0;
    for index in 1..=samples.len() {
        if index == samples.len() || kind(&samples[index]) != kind(&samples[begin]) {
            runs.push((kind(&samples[begin]), &samples[begin..(index + 1).min(samples.len())]));
            begin = index;
        }
    }
    runs
}

/// A tick, a cross, a ring or a bar: colour is not all that tells outcomes apart.
fn end_mark(svg: &mut Svg, outcome: &str, [x, y]: [f64; 2]) {
    let class = format!("end-mark end-{outcome}");
    match outcome {
        "success" => svg.path(&class, &polyline([[x - 7.0, y], [x - 2.0, y + 6.0], [x + 8.0, y - 7.0]])),
        "collision" => {
            let cross = [[[x - 6.0, y - 6.0], [x + 6.0, y + 6.0]], [[x - 6.0, y + 6.0], [x + 6.0, y - 6.0]]];
            svg.path(&class, &cross.map(polyline).concat());
        }
        "lost" => svg.circle(&class, [x, y], 7.0),
        "too-close" => {
            svg.circle(&class, [x, y], 7.0);
            svg.circle(&class, [x, y], 3.0);
        }
        _ => svg.path(&class, &polyline([[x - 7.0, y], [x + 7.0, y]])),
    }
}
