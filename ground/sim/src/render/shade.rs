//! Colours: sun, sky light, haze, and a texture for each material. Light is linear until the last line.
//!
//! Pixels are sorted by class and coloured [`LANES`] at a time; every step is a short loop over all of them.

use super::camera::{Rays, View};
use super::surface::Surface;
use super::texture::{blocks, hash, signed, smooth};
use super::{Class, FIRST_SOLID, Frame};
use crate::render::lanes::{LANES, Lanes, floor, lanes, least, low_bits, most, three};
use crate::world::Look;
use nalgebra::{Matrix3, Vector3};

type V3 = Vector3<f32>;

/// What the depth buffer's drawing left for the colours.
pub(super) struct Picture<'a> {
    pub(super) rays: &'a Rays,
    pub(super) ids: &'a [u32],
    /// Slopes of the ground along x and y, of the pixels that show it.
    pub(super) slopes: &'a [Vec<f32>; 2],
    pub(super) surfaces: &'a [Surface],
}

/// A pixel's column and row.
type Spot = [u16; 2];

/// The pixels of each class; kept from frame to frame, so that sorting allocates nothing.
pub(super) type Sorted = [Vec<Spot>; Class::ALL.len()];

/// Fills in class and colour of every pixel of `frame`, whose depth is drawn.
pub(super) fn shade(look: &Look, view: &View, picture: &Picture, sorted: &mut Sorted, frame: &mut Frame) {
    sort(picture, sorted, &mut frame.class);
    let painter = Painter { look, picture, camera: view.world_from_cam, origin: view.pos_world.cast() };
    for (class, spots) in Class::ALL.into_iter().zip(sorted) {
        for chunk in spots.chunks(LANES) {
            let mut full = [chunk[0]; LANES];
            full[..chunk.len()].copy_from_slice(chunk);
            let light = painter.light(class, &full, &frame.depth_m);
            expose(chunk, picture.rays.width, &light, &mut frame.rgb);
        }
    }
}

fn sort(picture: &Picture, sorted: &mut Sorted, classes: &mut [u8]) {
    sorted.iter_mut().for_each(Vec::clear);
    let rows = picture.ids.chunks_exact(picture.rays.width).zip(classes.chunks_exact_mut(picture.rays.width));
    for (v, (ids, classes)) in rows.enumerate() {
        let mut u = 0;
        for run in ids.chunk_by(|a, b| a == b) {
            let class = match run[0].checked_sub(FIRST_SOLID) {
                Some(solid) => picture.surfaces[solid as usize].class as u8,
                None => run[0] as u8,
            };
            let end = u + run.len();
            classes[u..end].fill(class);
            sorted[usize::from(class)].extend((u..end).map(|u| [u as u16, v as u16]));
            u = end;
        }
    }
}

/// Linear light as bytes. Square root: the display's gamma, near enough.
fn expose(spots: &[Spot], width: usize, light: &[Lanes; 3], rgb: &mut [u8]) {
    let level = |light: f32| low_bits(least(most(light, 0.0).sqrt() * 255.0, 255.0));
    let levels: [[u32; LANES]; 3] = three(|c| lanes(|i| level(light[c][i])));
    for (i, [u, v]) in spots.iter().enumerate() {
        let first = 3 * (usize::from(*v) * width + usize::from(*u));
        rgb[first..first + 3].copy_from_slice(&[levels[0][i] as u8, levels[1][i] as u8, levels[2][i] as u8]);
    }
}

/// What some pixels show.
struct Samples {
    /// Along the optical axis, m.
    depth: Lanes,
    /// World frame, m.
    point: [Lanes; 3],
    normal: [Lanes; 3],
    tint: [Lanes; 3],
    salt: [i32; LANES],
}

struct Painter<'a> {
    look: &'a Look,
    picture: &'a Picture<'a>,
    /// Columns: the camera's axes in the world.
    camera: Matrix3<f32>,
    origin: V3,
}

impl Painter<'_> {
    /// Light from pixels that all show the same class.
    fn light(&self, class: Class, spots: &[Spot; LANES], depth_m: &[f32]) -> [Lanes; 3] {
        let dir = self.directions(spots);
        let pixel = |i: usize| usize::from(spots[i][1]) * self.picture.rays.width + usize::from(spots[i][0]);
        match class {
            Class::Sky => self.background(&dir),
            Class::Ground => {
                // So far away only the wood behind is seen.
                let (depth, point) = self.points(&dir, |i| least(depth_m[pixel(i)], 1e3));
                let [along_x, along_y] = self.picture.slopes;
                let slopes = [lanes(|i| along_x[pixel(i)]), lanes(|i| along_y[pixel(i)])];
                self.ground(depth, point, &slopes)
            }
            _ => {
                let (depth, point) = self.points(&dir, |i| depth_m[pixel(i)]);
                let solid = |i: usize| &self.picture.surfaces[(self.picture.ids[pixel(i)] - FIRST_SOLID) as usize];
                let mut samples = solids(depth, point, solid);
                let detail = match class {
                    Class::Trunk | Class::Branch => bark(&samples),
                    Class::Foliage => leaves(&mut samples),
                    Class::Building => masonry(&samples),
                    Class::Scan => grain(&samples),
                    Class::Moving => bands(&samples),
                    _ => [1.0; LANES],
                };
                self.lit(&samples, &detail)
            }
        }
    }

    /// Rays with unit length along the optical axis, world frame.
    fn directions(&self, spots: &[Spot; LANES]) -> [Lanes; 3] {
        let rays = self.picture.rays;
        let (dy, dz) = (lanes(|i| rays.dy[usize::from(spots[i][0])]), lanes(|i| rays.dz[usize::from(spots[i][1])]));
        three(|axis| {
            let [ahead, left, up] = three(|column| self.camera[(axis, column)]);
            lanes(|i| ahead + left * dy[i] + up * dz[i])
        })
    }

    fn points(&self, dir: &[Lanes; 3], depth: impl Fn(usize) -> f32) -> (Lanes, [Lanes; 3]) {
        let depth = lanes(depth);
        (depth, three(|axis| lanes(|i| self.origin[axis] + dir[axis][i] * depth[i])))
    }

    /// Light from surfaces: `detail` scales their colour, dappled shade and haze are added.
    fn lit(&self, samples: &Samples, detail: &Lanes) -> [Lanes; 3] {
        let (look, Samples { depth, point: [x, y, z], normal: [nx, ny, nz], tint, .. }) = (self.look, samples);
        let [sun_x, sun_y, sun_z] = look.sun_dir_world;
        let mut sun = lanes(|i| most(nx[i] * sun_x + ny[i] * sun_y + nz[i] * sun_z, 0.0));
        if look.shade > 0.0 {
            // Shade of the canopy, carried along the sun's rays to the ground plane.
            let (slide_x, slide_y) = (sun_x / sun_z, sun_y / sun_z);
            let (x, y) = (lanes(|i| x[i] - slide_x * z[i]), lanes(|i| y[i] - slide_y * z[i]));
            let cover = smooth(|i| (x[i] * 0.7, y[i] * 0.7), |_| 11);
            let dapple = blocks(|i| (floor(x[i] * 4.0), floor(y[i] * 4.0), 12));
            let open = 1.0 - 2.0 * look.shade;
            sun = lanes(|i| {
                let open = (cover[i] + 0.35 * dapple[i] + open) * 2.5 + 0.5;
                sun[i] * least(most(open, 0.08), 1.0)
            });
        }
        let haze = lanes(|i| 1.0 - 1.0 / (1.0 + look.haze_per_m * depth[i]));
        three(|c| {
            let (direct, sky, horizon) = (look.sun_rgb[c], look.ambient_rgb[c], look.horizon_rgb[c]);
            lanes(|i| {
                let lit = (direct * sun[i] + sky * (0.62 + 0.38 * nz[i])) * tint[c][i] * detail[i];
                lit + (horizon - lit) * haze[i]
            })
        })
    }

    fn ground(&self, depth: Lanes, point: [Lanes; 3], slopes: &[Lanes; 2]) -> [Lanes; 3] {
        let [x, y, _] = &point;
        // Far hills are finer than pixels.
        let slope = |axis: usize| lanes(|i| if depth[i] < 25.0 { slopes[axis][i] } else { 0.0 });
        let (along_x, along_y) = (slope(0), slope(1));
        let upward = lanes(|i| 1.0 / (1.0 + along_x[i] * along_x[i] + along_y[i] * along_y[i]).sqrt());
        let normal = [lanes(|i| -along_x[i] * upward[i]), lanes(|i| -along_y[i] * upward[i]), upward];
        let coarse = smooth(|i| (x[i] * 0.6, y[i] * 0.6), |_| 1);
        let fine = smooth(|i| (x[i] * 2.3, y[i] * 2.3), |_| 2);
        let speck = blocks(|i| (floor(x[i] * 14.0), floor(y[i] * 14.0), 3));
        let speck = lanes(|i| 0.3 * speck[i] / (1.0 + 0.015 * depth[i] * depth[i]));
        let mix = lanes(|i| least(most(0.5 + 0.45 * (coarse[i] + 0.5 * fine[i]) + speck[i], 0.0), 1.0));
        let [first, second] = self.look.ground_rgb;
        let tint = three(|c| lanes(|i| first[c] + (second[c] - first[c]) * mix[i]));
        let detail = lanes(|i| 1.0 + speck[i]);
        let lit = self.lit(&Samples { depth, point, normal, tint, salt: [0; LANES] }, &detail);
        // Far ground fades into the wood behind it.
        let fade = lanes(|i| least(depth[i] * (1.0 / 60.0), 1.0));
        let wood = self.far_wood(&[1.0; LANES]);
        three(|c| lanes(|i| lit[c][i] + (wood[c][i] - lit[c][i]) * (fade[i] * fade[i])))
    }

    fn far_wood(&self, detail: &Lanes) -> [Lanes; 3] {
        let veil = (0.25 + 20.0 * self.look.haze_per_m).min(0.6);
        three(|c| {
            let (wood, air) = (self.look.backdrop_rgb[c] * (1.0 - veil), self.look.horizon_rgb[c] * (veil * 0.8));
            lanes(|i| wood * detail[i] + air)
        })
    }

    /// Sky with a gradient, closed at the horizon by a far wood.
    fn background(&self, dir: &[Lanes; 3]) -> [Lanes; 3] {
        let [x, y, z] = dir;
        let inverse = lanes(|i| 1.0 / most((x[i] * x[i] + y[i] * y[i]).sqrt(), 1e-6));
        // Azimuth as a point of the unit circle.
        let (ax, ay) = (lanes(|i| x[i] * inverse[i]), lanes(|i| y[i] * inverse[i]));
        // Straight up and down the slope is without bounds.
        let rise = lanes(|i| least(most(z[i] * inverse[i], -1e3), 1e3));
        let (large, small) =
            (smooth(|i| (ax[i] * 9.0, ay[i] * 9.0), |_| 21), smooth(|i| (ax[i] * 50.0, ay[i] * 50.0), |_| 22));
        let stems = blocks(|i| (floor(ax[i] * 90.0), floor(ay[i] * 90.0), floor(rise[i] * 12.0)));
        let wood = self.far_wood(&lanes(|i| 1.0 + 0.3 * stems[i]));
        let clouds = smooth(|i| (ax[i] * 3.0 + 7.0 * rise[i], ay[i] * 3.0), |_| 23);
        three(|c| {
            let (horizon, zenith) = (self.look.horizon_rgb[c], self.look.zenith_rgb[c]);
            lanes(|i| {
                let sky = horizon + (zenith - horizon) * least(rise[i] * 0.9, 1.0) + 0.06 * clouds[i];
                if rise[i] < 0.13 + 0.06 * large[i] + 0.025 * small[i] { wood[c][i] } else { sky }
            })
        })
    }
}

fn solids<'a>(depth: Lanes, point: [Lanes; 3], solid: impl Fn(usize) -> &'a Surface) -> Samples {
    let mut samples = Samples { depth, point, normal: [[0.0; LANES]; 3], tint: [[0.0; LANES]; 3], salt: [0; LANES] };
    for i in 0..LANES {
        let surface = solid(i);
        let normal = surface.normal(&V3::new(samples.point[0][i], samples.point[1][i], samples.point[2][i]));
        for axis in 0..3 {
            (samples.normal[axis][i], samples.tint[axis][i]) = (normal[axis], surface.tint[axis]);
        }
        samples.salt[i] = surface.salt;
    }
    samples
}

/// Weight of what only near surfaces show: half at 7 m.
fn near(depth: &Lanes) -> Lanes {
    lanes(|i| 1.0 / (1.0 + 0.02 * depth[i] * depth[i]))
}

fn bark(samples: &Samples) -> Lanes {
    let Samples { depth, point: [x, y, z], salt, .. } = samples;
    let near = near(depth);
    let stripe = blocks(|i| (floor(x[i] * 22.0), floor(y[i] * 22.0), floor(z[i] * 3.5) + salt[i] * 64));
    let patch = smooth(|i| (z[i] * 2.0, (x[i] + y[i]) * 3.0), |i| salt[i]);
    lanes(|i| 1.0 + 0.45 * near[i] * stripe[i] + 0.2 * patch[i])
}

/// Leaves turn the surface's normal, too.
fn leaves(samples: &mut Samples) -> Lanes {
    let Samples { depth, point: [x, y, z], normal, .. } = samples;
    let near = near(depth);
    let leaf: [u32; LANES] = lanes(|i| hash(floor(x[i] * 13.0), floor(y[i] * 13.0), floor(z[i] * 13.0)));
    let clump = blocks(|i| (floor(x[i] * 4.0), floor(y[i] * 4.0), floor(z[i] * 4.0)));
    let shifts = [3, 11, 19];
    let turned: [Lanes; 3] =
        three(|axis| lanes(|i| normal[axis][i] + signed(leaf[i].rotate_left(shifts[axis])) * 0.7 * near[i]));
    let [nx, ny, nz] = &turned;
    let inverse = lanes(|i| 1.0 / (nx[i] * nx[i] + ny[i] * ny[i] + nz[i] * nz[i]).sqrt());
    *normal = three(|axis| lanes(|i| turned[axis][i] * inverse[i]));
    lanes(|i| 1.0 + 0.5 * near[i] * signed(leaf[i]) + 0.25 * clump[i])
}

/// Courses of blocks with joints, under stains; a plaster finish on every third part.
fn masonry(samples: &Samples) -> Lanes {
    let Samples { depth, point: [x, y, z], normal: [nx, ny, _], salt, .. } = samples;
    let near = near(depth);
    let along = lanes(|i| if nx[i].abs() > ny[i].abs() { y[i] } else { x[i] });
    let row: [i32; LANES] = lanes(|i| floor(z[i] * 4.0));
    let column = lanes(|i| along[i] * 2.0 + 0.5 * (1 - (row[i] & 1)) as f32);
    let block = blocks(|i| (row[i], floor(column[i]), salt[i]));
    let stain = smooth(|i| (along[i] * 0.9, z[i] * 1.3), |i| salt[i]);
    lanes(|i| {
        let to_joint = least(z[i] * 4.0 - row[i] as f32, column[i] - floor(column[i]) as f32);
        let joint = if to_joint < 0.07 { 0.25 * near[i] } else { 0.0 };
        let course = if salt[i] % 3 == 0 { 0.0 } else { 0.12 * block[i] - joint };
        1.0 + 0.15 * stain[i] + course
    })
}

fn grain(samples: &Samples) -> Lanes {
    let Samples { depth, point: [x, y, z], .. } = samples;
    let near = near(depth);
    let grain = blocks(|i| (floor(x[i] * 9.0), floor(y[i] * 9.0), floor(z[i] * 9.0)));
    lanes(|i| 1.0 + 0.25 * near[i] * grain[i])
}

/// Painted in bands that do not run along as it moves.
fn bands(samples: &Samples) -> Lanes {
    let z = &samples.point[2];
    lanes(|i| if floor(z[i] * 2.5) & 1 == 0 { 1.2 } else { 0.8 })
}
