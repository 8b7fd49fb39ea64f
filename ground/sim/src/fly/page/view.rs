//! Where the runner was in the camera's image.

use super::axis::Scale;
use super::cells::{self, Pool};
use super::svg::{Anchor, Svg, n};
use crate::render::Camera;

/// Side of a bin, px of the image.
const BIN: usize = 8;
const COLUMNS: usize = 4;
const TILE: f64 = 260.0;
const PITCH: f64 = 284.0;
const LEFT: f64 = 44.0;

/// Shares of the samples in each bin, and inside the image at all.
struct Heat {
    shares: Vec<f64>,
    inside: f64,
}

/// A heat map for each cell; none where there is nobody to see.
pub(super) fn view(pools: &[Pool<'_>]) -> Option<Svg> {
    let Camera { width, height, .. } = Camera::default();
    let pixels: Vec<_> = pools.iter().map(cells::pixels).collect();
    if pixels.iter().all(Vec::is_empty) {
        return None;
    }
    let heats: Vec<Heat> = pixels.iter().map(|pixels| heat(pixels, width, height)).collect();
    let most = heats.iter().flat_map(|h| &h.shares).copied().fold(1e-9, f64::max);
    let tile_height = TILE * height as f64 / width as f64;
    let rows = pools.len().div_ceil(COLUMNS);
    let row_pitch = tile_height + 56.0;
    let size = [LEFT + PITCH * pools.len().min(COLUMNS) as f64, row_pitch * rows as f64 + 40.0];
    let mut svg = Svg::new(size[0], size[1], "Where the runner's centre was in the camera's image");
    for (index, (pool, heat)) in pools.iter().zip(&heats).enumerate() {
        let at = [LEFT + PITCH * (index % COLUMNS) as f64, 26.0 + row_pitch * (index / COLUMNS) as f64];
        let u = Scale::linear([0.0, width as f64], [at[0], at[0] + TILE]);
        let v = Scale::linear([0.0, height as f64], [at[1], at[1] + tile_height]);
        svg.text("strong", Anchor::Start, [at[0], at[1] - 9.0], &pool.label());
        let inside = format!("{:.0} % inside the image", 100.0 * heat.inside);
        svg.text("soft", Anchor::End, [at[0] + TILE, at[1] - 9.0], &inside);
        bins(&mut svg, heat, most, [&u, &v], width);
        svg.line("band", [u.at(0.5 * u.values[1]), at[1]], [u.at(0.5 * u.values[1]), at[1] + tile_height]);
        svg.line("band", [at[0], v.at(0.5 * v.values[1])], [at[0] + TILE, v.at(0.5 * v.values[1])]);
        svg.rect("frame", at, [TILE, tile_height], "");
        for part in [0.0, 0.5, 1.0] {
            let (tick_u, tick_v) = (part * u.values[1], part * v.values[1]);
            svg.text("soft", Anchor::Middle, [u.at(tick_u), at[1] + tile_height + 16.0], &n(tick_u));
            if index % COLUMNS == 0 {
                svg.text("soft", Anchor::End, [at[0] - 7.0, v.at(tick_v) + 4.0], &n(tick_v));
            }
        }
        if index % COLUMNS == 0 {
            svg.text_up("soft", [12.0, at[1] + 0.5 * tile_height], "v, down [px]");
        }
    }
    legend(&mut svg, [LEFT, size[1] - 22.0], most);
    Some(svg)
}

fn heat(pixels: &[Option<[f32; 2]>], width: usize, height: usize) -> Heat {
    let mut shares = vec![0.0; (width / BIN) * (height / BIN)];
    let one = 1.0 / (pixels.len() as f64).max(1.0);
    let mut inside = 0.0;
    for [u, v] in pixels.iter().flatten() {
        if (0.0..width as f32).contains(u) && (0.0..height as f32).contains(v) {
            shares[*v as usize / BIN * (width / BIN) + *u as usize / BIN] += one;
            inside += one;
        }
    }
    Heat { shares, inside }
}

/// Opacity of a share: by its root, so that rare places show.
fn opacity(share: f64, most: f64) -> String {
    format!(r#" fill-opacity="{}""#, n((share / most).sqrt()))
}

fn bins(svg: &mut Svg, heat: &Heat, most: f64, [u, v]: [&Scale; 2], width: usize) {
    let across = width / BIN;
    for (index, share) in heat.shares.iter().enumerate().filter(|(_, share)| **share > 0.0) {
        let corner = [(index % across * BIN) as f64, (index / across * BIN) as f64];
        let at = [u.at(corner[0]), v.at(corner[1])];
        let size = [u.at(corner[0] + BIN as f64) - at[0], v.at(corner[1] + BIN as f64) - at[1]];
        svg.rect("heat", at, size, &opacity(*share, most));
    }
}

fn legend(svg: &mut Svg, at: [f64; 2], most: f64) {
    const STEPS: usize = 24;
    svg.text("soft", Anchor::Start, [at[0], at[1] + 10.0], "u, to the right [px]");
    let left = at[0] + TILE + 12.0 - 5.0 * STEPS as f64;
    for step in 0..STEPS {
        let share = (step as f64 + 0.5) / STEPS as f64;
        svg.rect("heat", [left + 5.0 * step as f64, at[1]], [5.0, 12.0], &opacity(share, 1.0));
    }
    svg.text("soft", Anchor::End, [left - 6.0, at[1] + 10.0], "0");
    let right = left + 5.0 * STEPS as f64 + 6.0;
    svg.text("soft", Anchor::Start, [right, at[1] + 10.0], &format!("{:.1} %", 100.0 * most));
}
