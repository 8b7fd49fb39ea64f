//! Minimisation by L-BFGS with a backtracking line search.

use std::collections::VecDeque;

/// Pairs of steps that the curvature is estimated from.
const MEMORY: usize = 8;
/// Sufficient decrease, and how often a step is halved.
const DECREASE: f64 = 1e-4;
const HALVINGS: usize = 16;
/// It ends when an iteration gains less than this part of the value.
const GAIN: f64 = 1e-4;

/// One remembered step: Δx, Δg, 1 / Δx·Δg.
type Pair = (Vec<f64>, Vec<f64>, f64);

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add(a: &mut [f64], factor: f64, b: &[f64]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += factor * b;
    }
}

/// Moves `x` to a local minimum of `value`, in at most `iterations`; `value` writes its gradient into its second
/// argument. `first_step`: length of the first step, in units of `x`. Returns the least value.
pub(super) fn minimise(
    x: &mut Vec<f64>,
    iterations: usize,
    first_step: f64,
    mut value: impl FnMut(&[f64], &mut [f64]) -> f64,
) -> f64 {
    let mut gradient = vec![0.0; x.len()];
    let mut least = value(x, &mut gradient);
    let mut memory: VecDeque<Pair> = VecDeque::with_capacity(MEMORY);
    for _ in 0..iterations {
        let mut direction = descent(&gradient, &memory, first_step);
        let mut slope = dot(&direction, &gradient);
        if slope >= 0.0 {
            memory.clear();
            direction = descent(&gradient, &memory, first_step);
            slope = dot(&direction, &gradient);
        }
        let Some((next, next_gradient, next_value)) = step(x, &direction, slope, least, &mut value) else { break };
        let moved: Vec<f64> = next.iter().zip(&*x).map(|(a, b)| a - b).collect();
        let turned: Vec<f64> = next_gradient.iter().zip(&gradient).map(|(a, b)| a - b).collect();
        let curvature = dot(&moved, &turned);
        if curvature > 1e-12 {
            if memory.len() == MEMORY {
                memory.pop_front();
            }
            memory.push_back((moved, turned, 1.0 / curvature));
        }
        let gained = least - next_value;
        (*x, gradient, least) = (next, next_gradient, next_value);
        if gained < GAIN * least.abs() {
            break;
        }
    }
    least
}

/// -H g by the two-loop recursion.
fn descent(gradient: &[f64], memory: &VecDeque<Pair>, first_step: f64) -> Vec<f64> {
    let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let Some((moved, turned, _)) = memory.back() else {
        let norm = dot(gradient, gradient).sqrt().max(1e-12);
        direction.iter_mut().for_each(|d| *d *= first_step / norm);
        return direction;
    };
    let scale = dot(moved, turned) / dot(turned, turned);
    let mut factors = Vec::with_capacity(memory.len());
    for (moved, turned, inverse) in memory.iter().rev() {
        let factor = inverse * dot(moved, &direction);
        add(&mut direction, -factor, turned);
        factors.push(factor);
    }
    direction.iter_mut().for_each(|d| *d *= scale);
    for ((moved, turned, inverse), factor) in memory.iter().zip(factors.iter().rev()) {
        let back = inverse * dot(turned, &direction);
        add(&mut direction, factor - back, moved);
    }
    direction
}

/// Halves the step until it descends enough; none: it never does.
fn step(
    x: &[f64],
    direction: &[f64],
    slope: f64,
    least: f64,
    value: &mut impl FnMut(&[f64], &mut [f64]) -> f64,
) -> Option<(Vec<f64>, Vec<f64>, f64)> {
    let mut gradient = vec![0.0; x.len()];
    let mut length = 1.0;
    for _ in 0..HALVINGS {
        let mut next = x.to_vec();
        add(&mut next, length, direction);
        let next_value = value(&next, &mut gradient);
        if next_value <= least + DECREASE * length * slope {
            return Some((next, gradient, next_value));
        }
        length *= 0.5;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_of_rosenbrocks_valley_is_found() {
        let mut x = vec![-1.2, 1.0];
        let least = minimise(&mut x, 200, 0.1, |x, g| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            g[0] = -2.0 * a - 400.0 * x[0] * b;
            g[1] = 200.0 * b;
            a * a + 100.0 * b * b
        });
        assert!(least < 1e-4 && (x[0] - 1.0).abs() < 0.05, "{least} {x:?}");
    }
}
