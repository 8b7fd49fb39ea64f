//! When the evader is where on a path: as fast as asked, as slow as the bends and the acceleration limit demand.

use super::path::Path;

/// Arc between knots of the timetable, as parameter of the path.
const KNOT: f64 = 0.1;

/// The path's place at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Knot {
    /// Since the start of the run, s.
    pub(super) time_s: f64,
    /// Arc length from the path's beginning, m.
    pub(super) arc_m: f64,
    /// Parameter of the path.
    pub(super) parameter: f64,
    /// m/s.
    pub(super) speed_mps: f64,
}

/// Limits of the evader.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limits {
    /// Most speed, m/s.
    pub(super) speed_mps: f64,
    /// Most acceleration, all directions together, m/s².
    pub(super) acc_mps2: f64,
}

/// Share of the acceleration that bends may use: the rest slows down and speeds up in them.
const BEND_SHARE: f64 = 0.92;

/// A place where the evader stands for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stand {
    /// Parameter of the path.
    pub(super) parameter: f64,
    /// For so long, s.
    pub(super) stand_s: f64,
}

/// Knots from `from` (a place of an earlier timetable, or rest at the beginning) to rest at the path's end, with a rest
/// at each of `stands`; none if the evader is too fast at `from` to take what follows.
pub(super) fn timetable(path: &Path, from: Knot, limits: Limits, stands: &[Stand]) -> Option<Vec<Knot>> {
    // A little less than the limit: between knots curvature is not quite that of the knots.
    let acc = 0.95 * limits.acc_mps2;
    let steps = ((path.end() - from.parameter) / KNOT).ceil().max(1.0) as usize;
    let step = (path.end() - from.parameter) / steps as f64;
    let mut knots = vec![from];
    let mut bend = vec![path.curvature(from.parameter)];
    for i in 1..=steps {
        let parameter = from.parameter + step * i as f64;
        let last = knots[i - 1];
        // Simpson's rule over the knot's interval.
        let speed = |p: f64| path.at(p).1.norm();
        let arc = step / 6.0 * (speed(last.parameter) + 4.0 * speed(parameter - 0.5 * step) + speed(parameter));
        knots.push(Knot { time_s: 0.0, arc_m: last.arc_m + arc, parameter, speed_mps: limits.speed_mps });
        bend.push(path.curvature(parameter));
    }
    // Squared speeds: what the bends allow, then what braking and speeding up allow.
    let mut square: Vec<f64> =
        bend.iter().map(|k| (BEND_SHARE * acc / k.max(1e-9)).min(limits.speed_mps * limits.speed_mps)).collect();
    square[steps] = 0.0;
    let rest = |stand: &Stand| (((stand.parameter - from.parameter) / step).round() as usize).min(steps);
    for stand in stands {
        square[rest(stand)] = 0.0;
    }
    let along = |square: f64, bend: f64| (acc * acc - (square * bend) * (square * bend)).max(0.0).sqrt();
    for i in (0..steps).rev() {
        let arc = knots[i + 1].arc_m - knots[i].arc_m;
        // The next knot's spare acceleration, and this one's own: the smaller holds over the interval.
        let reach = square[i + 1] + 2.0 * arc * along(square[i + 1], bend[i + 1].max(bend[i]));
        square[i] = square[i].min(reach);
    }
    let begin = from.speed_mps * from.speed_mps;
    if begin > square[0] * 1.02 + 1e-9 {
        return None;
    }
    square[0] = begin;
    for i in 0..steps {
        let arc = knots[i + 1].arc_m - knots[i].arc_m;
        let reach = square[i] + 2.0 * arc * along(square[i], bend[i].max(bend[i + 1]));
        square[i + 1] = square[i + 1].min(reach);
    }
    for i in 0..=steps {
        knots[i].speed_mps = square[i].sqrt();
        if i > 0 {
            let arc = knots[i].arc_m - knots[i - 1].arc_m;
            let mean = 0.5 * (knots[i].speed_mps + knots[i - 1].speed_mps);
            // Between two rests that are neighbours: speeding up and slowing down again.
            let lasts = if mean > 1e-6 { arc / mean } else { 2.0 * (arc / acc).sqrt() };
            knots[i].time_s = knots[i - 1].time_s + lasts;
        }
    }
    // From the last to the first: what comes before keeps its index.
    for stand in stands.iter().rev() {
        let index = rest(stand);
        knots.insert(index + 1, knots[index]);
        knots[index + 1..].iter_mut().for_each(|knot| knot.time_s += stand.stand_s);
    }
    Some(knots)
}

/// The place at `time_s`; before the first knot the first, after the last the last.
pub(super) fn place(knots: &[Knot], time_s: f64) -> Knot {
    let next = knots.partition_point(|k| k.time_s <= time_s);
    if next == 0 {
        return knots[0];
    }
    if next == knots.len() {
        return knots[next - 1];
    }
    let (a, b) = (knots[next - 1], knots[next]);
    let acc = (b.speed_mps - a.speed_mps) / (b.time_s - a.time_s).max(1e-12);
    let t = time_s - a.time_s;
    let arc = a.speed_mps * t + 0.5 * acc * t * t;
    let part = (arc / (b.arc_m - a.arc_m).max(1e-12)).clamp(0.0, 1.0);
    Knot {
        time_s,
        arc_m: a.arc_m + arc,
        parameter: a.parameter + part * (b.parameter - a.parameter),
        speed_mps: a.speed_mps + acc * t,
    }
}

#[cfg(test)]
mod tests {
    use super::super::field::Point;
    use super::*;

    #[test]
    fn two_rests_beside_each_other_last_no_longer_than_they_are_asked_to() {
        let path = Path { control: (0..40).map(|i| Point::new(0.5 * f64::from(i), 0.0)).collect() };
        let from = Knot { time_s: 0.0, arc_m: 0.0, parameter: 0.0, speed_mps: 0.0 };
        let limits = Limits { speed_mps: 3.0, acc_mps2: 4.0 };
        let lasts = |stands: &[Stand]| timetable(&path, from, limits, stands).unwrap().last().unwrap().time_s;
        let stand = |parameter: f64| Stand { parameter, stand_s: 1.0 };
        let one = lasts(&[stand(20.0)]);
        assert!((lasts(&[stand(20.0), stand(20.1)]) - one - 1.0).abs() < 1.0);
        assert!(lasts(&[stand(path.end() - 0.1)]) < one + 1.0);
    }
}
