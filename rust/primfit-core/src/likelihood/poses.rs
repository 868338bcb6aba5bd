//! How the ranges of beams change with the poses they were taken from and with what they meet.
//!
//! A beam that leaves `o` along `u` and meets the wall with normal `n` at `h` has the range
//! `n (a - o) / (n u)`. With `q = n / (n u)` it changes by `-q` with the place of the robot `t`, by
//! `q x (h - t)` with its heading, by `(1 - s) q` and `s q` with the ends of the wall, of which it
//! meets the share `s`, and so on with what is common to all beams: a bias of the ranges, and how
//! the sensor is mounted on the robot.

use super::Candidate;
use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Columns of a beam beside those of the wall: x, y and heading of the robot, bias of the ranges, x, y
/// and turn of the mount.
pub const RIGID: usize = 7;

/// Poses between two questions to the caller.
const CHUNK: usize = 256;

/// Least cosine between a beam and a wall that a blur is divided by: farther aslant the beam leaves
/// the wall within the blur.
const LEAST_COSINE: f64 = 0.1;

/// Standard deviations of the blur, from the ends of the sensor's reach, within which a beam may
/// return or not.
const DOUBTFUL: f64 = 3.0;

/// Beams in the frame of their robot, pose by pose.
pub struct PoseBeams {
    /// First beam of each pose, and the number of beams.
    pub starts: Vec<usize>,
    /// Place of the sensor, metres; z in the world.
    pub origins: Vec<Vector>,
    /// Unit directions.
    pub directions: Vec<Vector>,
    /// Infinite for none.
    pub ranges: Vec<f64>,
    /// Standard deviations of the ranges.
    pub sigmas: Vec<f64>,
    /// Shortest and longest true range that gives a return, of each beam.
    pub limits: Vec<[f64; 2]>,
}

/// How residuals count.
#[derive(Clone, Copy)]
pub struct Robust {
    /// Standard deviation by which walls may be off across, metres.
    pub blur: f64,
    /// Residual in standard deviations at which the weight is a quarter (Geman, `McClure`);
    /// infinite for least squares.
    pub scale: f64,
    /// Residual in standard deviations beyond which a beam does not count.
    pub cut: f64,
}

impl Robust {
    /// Cost and weight of a squared residual.
    fn cost(self, square: f64) -> (f64, f64) {
        let share = 1.0 / (1.0 + square / (self.scale * self.scale));
        (0.5 * square * share, share * share)
    }

    /// Most that a beam costs.
    fn most(self) -> f64 {
        self.cost(self.cut * self.cut).0
    }
}

/// What beams may meet, and what is common to all of them.
pub struct Surroundings<'a> {
    /// Solids, and the walls of a room.
    pub prisms: &'a [Candidate<'a>],
    /// z of the floor.
    pub floor: f64,
    /// By how much ranges are too long; x, y and turn of the sensor on the robot.
    pub globals: [f64; 4],
}

/// What the beams of one pose say.
#[derive(Clone)]
pub struct PoseSums {
    /// Robust cost.
    pub cost: f64,
    /// Beams that count.
    pub n: f64,
    /// Gauss-Newton matrix of the columns that are not the walls'.
    pub information: [[f64; RIGID]; RIGID],
    /// Weighted residuals times the same columns: the way downhill.
    pub descent: [f64; RIGID],
    /// Of these columns with the two ends of each wall, along its normal.
    pub cross: Vec<[[f64; 2]; RIGID]>,
    /// Of each wall: matrix (first, both, second) and descent (first, second).
    pub walls: Vec<[f64; 5]>,
}

/// The wall that a beam meets, at which share of its length.
#[derive(Clone, Copy)]
struct Meeting {
    range: f64,
    wall: Option<(usize, f64)>,
}

/// A wall from corner to corner, with its unit normal.
struct Wall {
    normal: [f64; 2],
}

/// A prism with the circle around it, which most beams pass.
struct Prism<'a> {
    of: &'a Candidate<'a>,
    center: [f64; 2],
    radius: f64,
    first_wall: usize,
}

impl PoseBeams {
    /// Number of poses.
    #[must_use]
    pub fn n_poses(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// What the beams of each pose say of it and of what they meet.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn sums(
        &self,
        poses: &[Vector],
        around: &Surroundings,
        robust: Robust,
        workers: &Workers,
    ) -> Result<Vec<PoseSums>, Error> {
        let (prisms, walls) = prepared(around.prisms);
        let mut sums = Vec::with_capacity(poses.len());
        let numbers: Vec<usize> = (0..poses.len()).collect();
        for some in numbers.chunks(CHUNK) {
            workers.check()?;
            workers.install(|| {
                sums.par_extend(some.par_iter().map(|&k| {
                    let mut sums = PoseSums::new(walls.len());
                    self.visit(k, poses[k], around, &prisms, 1, |beam, met| {
                        self.add(beam, met, poses[k], around, &walls, robust, &mut sums);
                    });
                    sums
                }));
            });
        }
        Ok(sums)
    }

    /// Robust costs of places where poses may be, by one beam in `stride`, each of which stands for
    /// as many; `of` tells which pose each place is of.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn costs(
        &self,
        of: &[usize],
        places: &[Vector],
        around: &Surroundings,
        robust: Robust,
        stride: usize,
        workers: &Workers,
    ) -> Result<Vec<f64>, Error> {
        let (prisms, walls) = prepared(around.prisms);
        let mut costs = Vec::with_capacity(places.len());
        let pairs: Vec<(usize, Vector)> = of.iter().copied().zip(places.iter().copied()).collect();
        for some in pairs.chunks(CHUNK) {
            workers.check()?;
            workers.install(|| {
                costs.par_extend(some.par_iter().map(|&(k, pose)| {
                    let mut cost = 0.0;
                    self.visit(k, pose, around, &prisms, stride, |beam, met| {
                        cost += self.residual(&beam, met, around, &walls, robust).0;
                    });
                    stride as f64 * cost
                }));
            });
        }
        Ok(costs)
    }

    /// Casts one beam in `stride` of a pose.
    fn visit(
        &self,
        k: usize,
        pose: Vector,
        around: &Surroundings,
        prisms: &[Prism],
        stride: usize,
        mut act: impl FnMut(Beam, Meeting),
    ) {
        let [_, x, y, turn] = around.globals;
        let (sin, cos) = pose[2].sin_cos();
        let (turned_sin, turned_cos) = (pose[2] + turn).sin_cos();
        // Every pose begins with another beam, lest the same part of the sensor speaks for all.
        let begin = self.starts[k] + k % stride;
        for row in (begin..self.starts[k + 1]).step_by(stride) {
            let ([lx, ly, z], [dx, dy, uz]) = (self.origins[row], self.directions[row]);
            let (lx, ly) = (lx + x, ly + y);
            let beam = Beam {
                row,
                origin: [pose[0] + cos * lx - sin * ly, pose[1] + sin * lx + cos * ly],
                z,
                way: [turned_cos * dx - turned_sin * dy, turned_sin * dx + turned_cos * dy],
                uz,
            };
            act(beam, beam.meet(prisms, around.floor));
        }
    }

    /// Cost, weight over variance, and residual of a beam.
    fn residual(
        &self,
        beam: &Beam,
        met: Meeting,
        around: &Surroundings,
        walls: &[Wall],
        robust: Robust,
    ) -> (f64, f64, f64) {
        let range = self.ranges[beam.row];
        let cosine = met.wall.map_or(1.0, |(wall, _)| {
            let [nx, ny] = walls[wall].normal;
            (nx * beam.way[0] + ny * beam.way[1]).abs().max(LEAST_COSINE)
        });
        let (sigma, blur) = (self.sigmas[beam.row], robust.blur / cosine);
        let variance = sigma * sigma + blur * blur;
        let [low, high] = self.limits[beam.row];
        let doubt = DOUBTFUL * blur;
        if !range.is_finite() {
            let surely = met.range >= low + doubt && met.range <= high - doubt;
            return (if surely { robust.most() } else { 0.0 }, 0.0, 0.0);
        }
        // What came back was within the limits, which may be known only roughly.
        let residual = range - met.range - around.globals[0];
        let square = residual * residual / variance;
        if square.is_nan() || square > robust.cut * robust.cut {
            return (robust.most(), 0.0, 0.0);
        }
        let (cost, weight) = robust.cost(square);
        (cost, weight / variance, residual)
    }

    // What a beam is, what it met, and where to add it.
    #[allow(clippy::too_many_arguments)]
    fn add(
        &self,
        beam: Beam,
        met: Meeting,
        pose: Vector,
        around: &Surroundings,
        walls: &[Wall],
        robust: Robust,
        sums: &mut PoseSums,
    ) {
        let (cost, weight, residual) = self.residual(&beam, met, around, walls, robust);
        sums.cost += cost;
        if weight == 0.0 {
            return;
        }
        sums.n += 1.0;
        // The floor and the tops are level: they tell no place, and a bias only as well as their z
        // is known, which follows from the same beams.
        let Some((wall, share)) = met.wall else { return };
        let [nx, ny] = walls[wall].normal;
        let rate = 1.0 / (nx * beam.way[0] + ny * beam.way[1]);
        let [qx, qy] = [nx * rate, ny * rate];
        let arm = [met.range * beam.way[0], met.range * beam.way[1]];
        let lever = [beam.origin[0] - pose[0], beam.origin[1] - pose[1]];
        let turn = qx * arm[1] - qy * arm[0];
        let (sin, cos) = pose[2].sin_cos();
        let columns = [
            -qx,
            -qy,
            turn + qx * lever[1] - qy * lever[0],
            1.0,
            -(cos * qx + sin * qy),
            sin * qx - cos * qy,
            turn,
        ];
        let ends = [(1.0 - share) * rate, share * rate];
        for (i, &column) in columns.iter().enumerate() {
            let weighted = weight * column;
            sums.descent[i] += weighted * residual;
            for (cell, other) in sums.information[i].iter_mut().zip(columns) {
                *cell += weighted * other;
            }
            for (cell, end) in sums.cross[wall][i].iter_mut().zip(ends) {
                *cell += weighted * end;
            }
        }
        let [first, second] = ends;
        let terms = [first * first, first * second, second * second];
        let steps = [residual * first, residual * second];
        for (cell, term) in sums.walls[wall].iter_mut().zip(terms.into_iter().chain(steps)) {
            *cell += weight * term;
        }
    }
}

impl PoseSums {
    fn new(n_walls: usize) -> Self {
        Self {
            cost: 0.0,
            n: 0.0,
            information: [[0.0; RIGID]; RIGID],
            descent: [0.0; RIGID],
            cross: vec![[[0.0; 2]; RIGID]; n_walls],
            walls: vec![[0.0; 5]; n_walls],
        }
    }
}

/// A beam in the world.
#[derive(Clone, Copy)]
struct Beam {
    row: usize,
    origin: [f64; 2],
    z: f64,
    way: [f64; 2],
    uz: f64,
}

impl Beam {
    /// On which side of a place the beam passes, times its level length.
    fn side(&self, [x, y]: [f64; 2]) -> f64 {
        (x - self.origin[0]) * self.way[1] - (y - self.origin[1]) * self.way[0]
    }

    /// How far along the beam it comes nearest to a place.
    fn depth(&self, [x, y]: [f64; 2], level: f64) -> f64 {
        ((x - self.origin[0]) * self.way[0] + (y - self.origin[1]) * self.way[1]) / level
    }

    /// What it meets first: walls from both sides, tops from above, or the floor.
    fn meet(&self, prisms: &[Prism], floor: f64) -> Meeting {
        let level = self.way[0] * self.way[0] + self.way[1] * self.way[1];
        let mut first = Meeting { range: f64::INFINITY, wall: None };
        if self.uz < 0.0 && self.z > floor {
            first.range = (floor - self.z) / self.uz;
        }
        for prism in prisms {
            let off = self.side(prism.center);
            if off * off > prism.radius * prism.radius * level {
                continue;
            }
            let (corners, top) = (prism.of.footprint, prism.of.top);
            let descends = !prism.of.is_open && self.uz < 0.0 && self.z > top;
            let descent = if descends { (top - self.z) / self.uz } else { f64::INFINITY };
            let mut is_within = false;
            let mut before = corners[corners.len() - 1];
            let mut last = self.side(before);
            for (k, &corner) in corners.iter().enumerate() {
                let next = self.side(corner);
                if (last < 0.0) != (next < 0.0) {
                    let share = last / (last - next);
                    let start = self.depth(before, level);
                    let range = start + share * (self.depth(corner, level) - start);
                    let z = self.z + range * self.uz;
                    is_within ^= range >= descent;
                    let is_met = range > 0.0 && z <= top && z >= prism.of.bottom;
                    if is_met && range < first.range {
                        first = Meeting { range, wall: Some((prism.first_wall + k, share)) };
                    }
                }
                (last, before) = (next, corner);
            }
            if is_within && descent < first.range {
                first = Meeting { range: descent, wall: None };
            }
        }
        first
    }
}

/// Prisms with the circles around them, and all their walls: wall `k` ends at corner `k`.
fn prepared<'a>(candidates: &'a [Candidate<'a>]) -> (Vec<Prism<'a>>, Vec<Wall>) {
    let (mut prisms, mut walls) = (Vec::with_capacity(candidates.len()), Vec::new());
    for of in candidates {
        let corners = of.footprint;
        let n = corners.len() as f64;
        let center = corners.iter().fold([0.0; 2], |[x, y], [a, b]| [x + a / n, y + b / n]);
        let radius =
            corners.iter().map(|[x, y]| (x - center[0]).hypot(y - center[1])).fold(0.0, f64::max);
        prisms.push(Prism { of, center, radius, first_wall: walls.len() });
        let mut before = corners[corners.len() - 1];
        for &corner in corners {
            let (x, y) = (corner[0] - before[0], corner[1] - before[1]);
            let length = x.hypot(y).max(f64::MIN_POSITIVE);
            walls.push(Wall { normal: [y / length, -x / length] });
            before = corner;
        }
    }
    (prisms, walls)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: [[f64; 2]; 4] = [[0.0, 0.0], [2.0, 0.1], [1.9, 1.7], [-0.1, 1.5]];
    const LEAST: Robust = Robust { blur: 0.0, scale: f64::INFINITY, cut: 1e9 };

    fn beams() -> PoseBeams {
        let n = 37;
        let directions = (0..n).map(|i| {
            let (sin, cos) = (0.17 * f64::from(i)).sin_cos();
            [0.98 * cos, 0.98 * sin, 0.2_f64.copysign(f64::from(i) - 20.0)]
        });
        PoseBeams {
            starts: vec![0, n as usize],
            origins: vec![[0.03, -0.02, 0.5]; n as usize],
            directions: directions.collect(),
            ranges: (0..n).map(|i| 0.9 + 0.01 * f64::from(i % 5)).collect(),
            sigmas: vec![0.01; n as usize],
            limits: vec![[0.0, 10.0]; n as usize],
        }
    }

    /// The cost for a pose, globals, and a corner of the room moved along a wall's normal.
    fn cost(pose: Vector, globals: [f64; 4], room: &[[f64; 2]]) -> f64 {
        let prisms =
            [Candidate { footprint: room, is_round: false, bottom: 0.0, top: 3.0, is_open: true }];
        let around = Surroundings { prisms: &prisms, floor: -10.0, globals };
        let workers = Workers::new(Some(1), &|| true).unwrap_or_else(|_| unreachable!());
        let costs = beams().costs(&[0], &[pose], &around, LEAST, 1, &workers);
        costs.map_or(f64::NAN, |costs| costs[0])
    }

    #[test]
    fn the_slopes_are_those_of_the_cost() {
        let (pose, globals) = ([0.8, 0.7, 0.4], [0.02, 0.01, -0.02, 0.03]);
        let prisms =
            [Candidate { footprint: &ROOM, is_round: false, bottom: 0.0, top: 3.0, is_open: true }];
        let around = Surroundings { prisms: &prisms, floor: -10.0, globals };
        let workers = Workers::new(Some(1), &|| true).unwrap_or_else(|_| unreachable!());
        let found = beams().sums(&[pose], &around, LEAST, &workers);
        let sums = found.map_or_else(|_| PoseSums::new(4), |mut found| found.remove(0));
        let h = 1e-6;
        for i in 0..RIGID {
            let at = |step: f64| {
                let (mut pose, mut globals) = (pose, globals);
                if i < 3 {
                    pose[i] += step;
                } else {
                    globals[i - 3] += step;
                }
                cost(pose, globals, &ROOM)
            };
            let slope = (at(h) - at(-h)) / (2.0 * h);
            assert!((slope + sums.descent[i]).abs() < 1e-4 * slope.abs().max(1.0), "{i}");
        }
        for wall in 0..4 {
            let (first, second) = ((wall + 3) % 4, wall);
            let (a, b) = (ROOM[first], ROOM[second]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            let normal = [(b[1] - a[1]) / length, (a[0] - b[0]) / length];
            let at = |step: f64| {
                let mut room = ROOM;
                for corner in [first, second] {
                    room[corner][0] += step * normal[0];
                    room[corner][1] += step * normal[1];
                }
                cost(pose, globals, &room)
            };
            // Its neighbours share the corners: their ends move, too.
            let slope = (at(h) - at(-h)) / (2.0 * h);
            let mut told = sums.walls[wall][3] + sums.walls[wall][4];
            for (other, end) in [((wall + 1) % 4, 3), ((wall + 3) % 4, 4)] {
                let (c, d) = (ROOM[(other + 3) % 4], ROOM[other]);
                let length = (d[0] - c[0]).hypot(d[1] - c[1]);
                let theirs = [(d[1] - c[1]) / length, (c[0] - d[0]) / length];
                let along = theirs[0] * normal[0] + theirs[1] * normal[1];
                told += sums.walls[other][end] * along;
            }
            assert!((slope + told).abs() < 1e-4 * slope.abs().max(1.0), "wall {wall}");
        }
    }
}
