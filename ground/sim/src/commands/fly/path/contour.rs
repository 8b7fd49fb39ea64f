//! Outlines of a solid in a plane, from its signed distance alone: whatever a world is made of can be drawn.

use std::collections::BTreeMap;

/// Signed distance to the solid in the plane, m: negative inside, and never steeper than 1.
pub(super) type Field<'a> = dyn Fn(f64, f64) -> f64 + 'a;

/// Squares of so many steps a side are looked at first, and divided only near a surface.
const BLOCK: usize = 64;

/// Closed outlines of the solid within the rectangle, the solid to the left; points about `step_m` apart.
pub(super) fn outlines(field: &Field<'_>, min: [f64; 2], max: [f64; 2], step_m: f64) -> Vec<Vec<[f64; 2]>> {
    let cells = |axis: usize| (((max[axis] - min[axis]) / step_m).ceil() as usize).max(1);
    let mut tracer = Tracer {
        field,
        min,
        step_m,
        cells: [cells(0), cells(1)],
        nodes: vec![f64::NAN; (cells(0) + 1) * (cells(1) + 1)],
        next: BTreeMap::new(),
    };
    for j in (0..tracer.cells[1]).step_by(BLOCK) {
        for i in (0..tracer.cells[0]).step_by(BLOCK) {
            tracer.visit(i, j, BLOCK);
        }
    }
    tracer.loops()
}

/// An edge between two nodes: the lower one, and whether the other is above it (true) or to its right.
type Edge = (usize, usize, bool);

struct Tracer<'a> {
    field: &'a Field<'a>,
    min: [f64; 2],
    step_m: f64,
    cells: [usize; 2],
    nodes: Vec<f64>,
    /// Where the outline that crosses an edge goes on, and where it crosses.
    next: BTreeMap<Edge, (Edge, [f64; 2])>,
}

impl Tracer<'_> {
    fn place(&self, i: f64, j: f64) -> [f64; 2] {
        [self.min[0] + i * self.step_m, self.min[1] + j * self.step_m]
    }

    /// Value at a node. The border counts as outside, so that every outline closes.
    fn node(&mut self, i: usize, j: usize) -> f64 {
        let index = j * (self.cells[0] + 1) + i;
        if self.nodes[index].is_nan() {
            let [x, y] = self.place(i as f64, j as f64);
            let border = i == 0 || j == 0 || i == self.cells[0] || j == self.cells[1];
            let value = (self.field)(x, y);
            self.nodes[index] = if border { value.max(0.1 * self.step_m) } else { value };
        }
        self.nodes[index]
    }

    /// Finds the crossings in the square of `size` cells at (i, j).
    fn visit(&mut self, i: usize, j: usize, size: usize) {
        if i >= self.cells[0] || j >= self.cells[1] {
            return;
        }
        if size == 1 {
            self.cell(i, j);
            return;
        }
        let half = 0.5 * size as f64;
        let [x, y] = self.place(i as f64 + half, j as f64 + half);
        let value = (self.field)(x, y);
        let reach = half * self.step_m * std::f64::consts::SQRT_2;
        let border = i == 0 || j == 0 || i + size >= self.cells[0] || j + size >= self.cells[1];
        if value > reach || (value < -reach && !border) {
            return;
        }
        let part = size / 2;
        for (di, dj) in [(0, 0), (part, 0), (0, part), (part, part)] {
            self.visit(i + di, j + dj, part);
        }
    }

    fn cell(&mut self, i: usize, j: usize) {
        // Around the cell, counterclockwise: corner, and the edge from it to the next.
        let around: [(usize, usize, Edge); 4] = [
            (i, j, (i, j, false)),
            (i + 1, j, (i + 1, j, true)),
            (i + 1, j + 1, (i, j + 1, false)),
            (i, j + 1, (i, j, true)),
        ];
        let values = around.map(|(a, b, _)| self.node(a, b));
        // The outline leaves through an edge that goes out of the solid, to the last one before it that came in.
        let out = (0..4).filter(|k| values[*k] < 0.0 && values[(k + 1) % 4] >= 0.0);
        for k in out {
            let came = (1..4).map(|back| (k + 4 - back) % 4).find(|k| values[*k] >= 0.0 && values[(k + 1) % 4] < 0.0);
            let Some(came) = came else { continue };
            let part = values[k] / (values[k] - values[(k + 1) % 4]);
            let ((a, b, edge), (c, d, _)) = (around[k], around[(k + 1) % 4]);
            let mix = |from: usize, to: usize| from as f64 + part * (to as f64 - from as f64);
            self.next.insert(edge, (around[came].2, self.place(mix(a, c), mix(b, d))));
        }
    }

    fn loops(mut self) -> Vec<Vec<[f64; 2]>> {
        let mut loops = Vec::new();
        while let Some((_, (mut edge, point))) = self.next.pop_first() {
            let mut outline = vec![point];
            while let Some((next, point)) = self.next.remove(&edge) {
                outline.push(point);
                edge = next;
            }
            loops.push(outline);
        }
        loops
    }
}

/// The outline without points that lie within `tolerance` of the line past them.
pub(super) fn simplified(outline: &[[f64; 2]], tolerance: f64) -> Vec<[f64; 2]> {
    let mut kept: Vec<[f64; 2]> = Vec::new();
    let mut skipped: Vec<[f64; 2]> = Vec::new();
    for (index, point) in outline.iter().enumerate() {
        let after = outline[(index + 1) % outline.len()];
        skipped.push(*point);
        let far = |last: &[f64; 2]| skipped.iter().any(|p| distance_to_line(p, last, &after) > tolerance);
        if kept.last().is_none_or(far) {
            kept.push(*point);
            skipped.clear();
        }
    }
    kept
}

fn distance_to_line(point: &[f64; 2], from: &[f64; 2], to: &[f64; 2]) -> f64 {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let (px, py) = (point[0] - from[0], point[1] - from[1]);
    let length = dx.hypot(dy);
    if length < 1e-12 { px.hypot(py) } else { (px * dy - py * dx).abs() / length }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(outline: &[[f64; 2]]) -> f64 {
        let next = |i: usize| outline[(i + 1) % outline.len()];
        0.5 * outline.iter().enumerate().map(|(i, a)| a[0] * next(i)[1] - next(i)[0] * a[1]).sum::<f64>()
    }

    #[test]
    fn discs_come_out_round_and_to_scale() {
        let discs = [([1.0, 1.0], 0.3), ([4.2, 2.7], 0.12), ([7.0, 4.0], 0.8)];
        let field =
            |x: f64, y: f64| discs.iter().map(|(c, r)| (x - c[0]).hypot(y - c[1]) - r).fold(f64::INFINITY, f64::min);
        let found = outlines(&field, [0.0, 0.0], [10.0, 6.0], 0.05);
        assert_eq!(found.len(), 3);
        for outline in &found {
            assert!(outline.iter().all(|[x, y]| field(*x, *y).abs() < 0.01));
        }
        let total: f64 = found.iter().map(|o| area(o)).sum();
        let truth: f64 = discs.iter().map(|(_, r)| std::f64::consts::PI * r * r).sum();
        assert!((total / truth - 1.0).abs() < 0.01, "{total} {truth}");
        let fewer = simplified(&found[0], 0.005);
        assert!(fewer.len() < found[0].len() && (area(&fewer) / area(&found[0]) - 1.0).abs() < 0.05);
    }

    #[test]
    fn what_reaches_beyond_the_rectangle_is_closed_along_its_border() {
        let wall = |x: f64, _: f64| (x - 2.0).abs() - 0.5;
        let found = outlines(&wall, [0.0, 0.0], [4.0, 8.0], 0.1);
        assert_eq!(found.len(), 1);
        assert!((area(&found[0]) - 8.0).abs() < 0.3, "{}", area(&found[0]));
        assert_eq!(outlines(&|_, _| -1.0, [0.0, 0.0], [4.0, 4.0], 0.1).len(), 1);
        assert!(outlines(&|_, _| 1.0, [0.0, 0.0], [4.0, 4.0], 0.1).is_empty());
    }
}
