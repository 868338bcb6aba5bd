//! Least squares over the parameters of a surface: Levenberg and Marquardt, redescending weights.

use super::surface::{Frame, Kind, MOST, Surface};
use super::vectors::{along, dot, mean};
use crate::{Error, Vector, Workers};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::{IntoParallelIterator, ParallelIterator};

/// Points of a partial sum: the same whatever the number of threads.
const CHUNK: usize = 2048;
/// Damping to begin with, as a share of the diagonal; after a step that helps, and one that does not.
const DAMPING: f64 = 1e-3;
const EASED: f64 = 0.1;
const TIGHTENED: f64 = 8.0;
const MOST_DAMPING: f64 = 1e8;
/// The same of a last step that may be left: a seventh of one.
const RESTLESS: f64 = 0.02;
/// Fall of the cost, as a share of it, that rounding may be.
const ROUNDING: f64 = 1e-13;
/// Least cosine between beam and normal: nearer to the rim the range that a beam would have depends
/// more on the noise than it tells (a cosine of 0.1 or 0.4 moves radii by less than a tenth of
/// their standard errors).
pub const GRAZING: f64 = 0.25;
/// How much farther along the beam than a plane through the foot would be, at the least angle, a
/// crossing may be: beyond it is on another part of the surface than the point.
const ELSEWHERE: f64 = 2.0;
/// Radii of curvature, in standard deviations of the noise, below which the expansion that the bias
/// rests on does not hold: it is not taken to grow further.
const LEAST_RADIUS: f64 = 3.0;

type Matrix = SMatrix<f64, MOST, MOST>;
type Column = SVector<f64, MOST>;

/// What was measured.
#[derive(Clone, Copy)]
pub struct Measured<'a> {
    /// Points, metres.
    pub points: &'a [Vector],
    /// Noise of each, metres: across the surface, in all directions alike, or along the beam.
    pub sigma: &'a [f64],
    /// Unit directions of the beams, where the residuals are to be those of the ranges.
    pub beams: Option<&'a [Vector]>,
}

/// How to fit.
#[derive(Clone, Copy)]
pub struct Effort {
    /// Standard deviations from which a point does not count; infinite for least squares.
    pub cutoff: f64,
    /// Most steps.
    pub n_steps: usize,
    /// Square of a step, in standard errors, that is none.
    pub still: f64,
    /// Whether the noise is alike in all directions, which moves the mean distance from curved
    /// surfaces: half of sigma squared times the sum of the curvatures.
    pub is_isotropic: bool,
}

impl Effort {
    /// Square of the last step of a last fit: a thousandth of a standard error.
    pub const STILL: f64 = 1e-6;
}

/// A surface fitted to points.
pub struct SurfaceFit {
    /// The surface.
    pub surface: Surface,
    /// Covariance (8, 8) of place, axis and sizes (of a cone its half angle), row after row, for the
    /// noise that was given.
    pub covariance: Vec<f64>,
    /// Variance of the residuals over that of the noise, by which the covariance grows.
    pub variance: f64,
    /// Residual of each point over its noise; NaN for beams that miss or graze the surface.
    pub residuals: Vec<f64>,
    /// Whether the last step was none.
    pub has_settled: bool,
}

/// Sums over points, which add.
struct Sums {
    n: f64,
    cost: f64,
    matrix: Matrix,
    right: Column,
}

impl Sums {
    fn new() -> Self {
        Self { n: 0.0, cost: 0.0, matrix: Matrix::zeros(), right: Column::zeros() }
    }

    fn plus(mut self, other: &Self) -> Self {
        self.n += other.n;
        self.cost += other.cost;
        self.matrix += other.matrix;
        self.right += other.right;
        self
    }
}

/// A residual over its noise, with its derivatives.
type Row = (f64, [f64; MOST]);

impl Measured<'_> {
    /// The residual of a point; None for a beam that misses or grazes the surface.
    #[inline]
    fn row(
        &self,
        i: usize,
        surface: &Surface,
        frame: &Frame,
        how: &Effort,
        side: f64,
    ) -> Option<Row> {
        let (point, sigma) = (&self.points[i], self.sigma[i]);
        let Some(beams) = self.beams else {
            let at = surface.sight(point);
            let slopes = frame.slopes(surface, point, &at);
            let bias = if how.is_isotropic {
                0.5 * sigma * sigma * surface.curvature(&at, LEAST_RADIUS * sigma)
            } else {
                0.0
            };
            let inverse = 1.0 / sigma;
            return Some(((at.distance - bias) * inverse, slopes.map(|slope| slope * inverse)));
        };
        let beam = &beams[i];
        let (far, at) = surface.meet(point, beam, side)?;
        let steep = dot(&at.normal, beam);
        let is_elsewhere = GRAZING * far.abs() > ELSEWHERE * surface.distance(point).abs();
        if steep.abs() < GRAZING || is_elsewhere {
            return None;
        }
        let met = std::array::from_fn(|k| point[k] + far * beam[k]);
        let slopes = frame.slopes(surface, &met, &at);
        let inverse = 1.0 / (steep * sigma);
        Some((-far / sigma, slopes.map(|slope| slope * inverse)))
    }

    /// The normal equations.
    fn sums(&self, surface: &Surface, frame: &Frame, how: &Effort, side: f64) -> Sums {
        match surface.kind {
            Kind::Plane => self.sums_of::<3>(surface, frame, how, side),
            Kind::Sphere => self.sums_of::<4>(surface, frame, how, side),
            Kind::Cylinder => self.sums_of::<5>(surface, frame, how, side),
            Kind::Cone => self.sums_of::<6>(surface, frame, how, side),
            Kind::Torus => self.sums_of::<7>(surface, frame, how, side),
        }
    }

    /// The same for `K` parameters.
    fn sums_of<const K: usize>(
        &self,
        surface: &Surface,
        frame: &Frame,
        how: &Effort,
        side: f64,
    ) -> Sums {
        let of = |chunk: usize| {
            let mut sums = Sums::new();
            let (mut matrix, mut right) = ([[0.0; K]; K], [0.0; K]);
            for i in chunk * CHUNK..self.points.len().min((chunk + 1) * CHUNK) {
                let Some((u, slopes)) = self.row(i, surface, frame, how, side) else { continue };
                sums.n += 1.0;
                let share = (u / how.cutoff).powi(2);
                if share >= 1.0 {
                    sums.cost += how.cutoff * how.cutoff / 3.0;
                    continue;
                }
                let inside = 1.0 - share;
                let weight = inside * inside;
                // The limit of least squares must not be computed as a difference of the infinite.
                sums.cost += u * u * (1.0 - share + share * share / 3.0);
                for a in 0..K {
                    let weighted = weight * slopes[a];
                    right[a] += weighted * u;
                    for b in 0..=a {
                        matrix[a][b] += weighted * slopes[b];
                    }
                }
            }
            for (a, row) in matrix.iter().enumerate() {
                sums.right[a] = right[a];
                for (b, product) in row.iter().enumerate().take(a + 1) {
                    sums.matrix[(a, b)] = *product;
                }
            }
            sums
        };
        let n_chunks = self.points.len().div_ceil(CHUNK);
        if n_chunks == 1 {
            return of(0);
        }
        let parts: Vec<Sums> = (0..n_chunks).into_par_iter().map(of).collect();
        parts.iter().fold(Sums::new(), Sums::plus)
    }

    /// Sign of the product of normal and beam: negative for what is seen from outside.
    fn side(&self, surface: &Surface) -> f64 {
        let Some(beams) = self.beams else { return 0.0 };
        let pairs = self.points.iter().zip(beams);
        pairs.map(|(point, beam)| dot(&surface.sight(point).normal, beam)).sum::<f64>().signum()
    }
}

/// Step of the damped normal equations, and its square in standard errors.
fn step(sums: &Sums, k: usize, damping: f64) -> Option<([f64; MOST], f64)> {
    let mut matrix = sums.matrix;
    for a in 0..MOST {
        matrix[(a, a)] = if a < k { matrix[(a, a)] * (1.0 + damping) } else { 1.0 };
    }
    let solved = matrix.cholesky()?.solve(&sums.right);
    let square = solved.dot(&sums.right);
    let step: [f64; MOST] = std::array::from_fn(|a| -solved[a]);
    step.iter().all(|x| x.is_finite()).then_some((step, square))
}

/// A surface moved until no small change fits the distances of the points better, on this thread or
/// those of the pool that it runs in; and whether it came to rest.
pub fn settled(start: &Surface, measured: &Measured, how: &Effort) -> (Surface, bool) {
    let middle = mean(measured.points.iter());
    let k = start.kind.n_parameters();
    let mut surface = *start;
    let mut frame = Frame::of(&surface, middle);
    let mut sums = measured.sums(&surface, &frame, how, 0.0);
    let mut damping = DAMPING;
    for _ in 0..how.n_steps {
        let Some((change, square)) = step(&sums, k, damping) else { return (surface, false) };
        let next = surface.stepped(&frame, &change);
        let next_frame = Frame::of(&next, middle);
        let next_sums = measured.sums(&next, &next_frame, how, 0.0);
        let fall = sums.cost - next_sums.cost;
        if fall >= 0.0 {
            (surface, frame) = (next, next_frame);
            let is_still = square <= how.still || fall <= ROUNDING * sums.cost;
            sums = next_sums;
            if is_still && damping <= DAMPING {
                return (surface, true);
            }
            damping *= EASED;
        } else if fall.is_nan() || damping > MOST_DAMPING {
            return (surface, fall >= -ROUNDING * sums.cost);
        } else {
            damping *= TIGHTENED;
        }
    }
    (surface, false)
}

/// The same for ranges, by Gauss's and Newton's steps: which beams meet the surface differs from
/// one to the next, so that their costs do not compare.
fn settled_in_ranges(start: &Surface, measured: &Measured, how: &Effort) -> (Surface, bool) {
    let middle = mean(measured.points.iter());
    let side = measured.side(start);
    let mut surface = *start;
    let mut last = f64::INFINITY;
    for _ in 0..how.n_steps {
        let frame = Frame::of(&surface, middle);
        let sums = measured.sums(&surface, &frame, how, side);
        let Some((change, square)) = step(&sums, start.kind.n_parameters(), 0.0) else { break };
        surface = surface.stepped(&frame, &change);
        last = square;
        if square <= how.still {
            break;
        }
    }
    // A beam that grazes the surface in every second step keeps it from coming to rest.
    if last <= RESTLESS { (surface, true) } else { (*start, false) }
}

/// A surface fitted to distances, or to ranges where the beams are known, from a first one near it.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn fit_surface(
    start: &Surface,
    measured: &Measured,
    how: &Effort,
    workers: &Workers,
) -> Result<SurfaceFit, Error> {
    workers.watch(|stop| {
        stop.check()?;
        let across = Measured { beams: None, ..*measured };
        let (mut surface, mut has_settled) = settled(start, &across, how);
        stop.check()?;
        if measured.beams.is_some() {
            (surface, has_settled) = settled_in_ranges(&surface, measured, how);
        }
        Ok(described(surface, has_settled, measured, how))
    })
}

/// A surface with its covariance and residuals.
fn described(surface: Surface, has_settled: bool, measured: &Measured, how: &Effort) -> SurfaceFit {
    let surface = surface.opened().amid(measured, how);
    let frame = Frame::of(&surface, mean(measured.points.iter()));
    let k = surface.kind.n_parameters();
    let side = measured.side(&surface);
    let rows: Vec<Option<Row>> = (0..measured.points.len())
        .into_par_iter()
        .map(|i| measured.row(i, &surface, &frame, how, side))
        .collect();
    let (inverse, variance) = uncertainty(&rows, k, how.cutoff);
    let slopes = surface.world_slopes(&frame);
    let mut covariance = vec![f64::NAN; 64];
    if let Some(inverse) = inverse {
        for (i, number) in covariance.iter_mut().enumerate() {
            let (row, column) = (i / 8, i % 8);
            *number = 0.0;
            for (a, first) in slopes.iter().enumerate() {
                for (b, second) in slopes.iter().enumerate() {
                    *number += first[row] * inverse[(a, b)] * second[column];
                }
            }
        }
    }
    let residuals = rows.iter().map(|row| row.map_or(f64::NAN, |row| row.0)).collect();
    SurfaceFit { surface, covariance, variance, residuals, has_settled }
}

/// Covariance of the parameters for residuals of unit variance, None where these leave some open, and
/// the variance of the residuals.
///
/// Of an M-estimator (Huber 1981): mean square of the influences over their mean slope squared is the
/// variance; which points have which influence counts too, since what is scattered about the surface
/// beyond its points has the longest lever.
fn uncertainty(rows: &[Option<Row>], k: usize, cutoff: f64) -> (Option<Matrix>, f64) {
    let (mut n, mut squares, mut gain) = (0.0, 0.0, 0.0);
    let mut slope = Matrix::identity();
    slope.view_mut((0, 0), (k, k)).fill(0.0);
    let mut influence = Matrix::zeros();
    for (u, slopes) in rows.iter().flatten() {
        let share = (u / cutoff).powi(2);
        if share >= 1.0 {
            continue;
        }
        let square = u * u * (1.0 - share).powi(4);
        let turn = (1.0 - share) * (1.0 - 5.0 * share);
        n += 1.0;
        squares += square;
        gain += turn;
        for a in 0..k {
            for b in 0..k {
                let product = slopes[a] * slopes[b];
                slope[(a, b)] += turn * product;
                influence[(a, b)] += square * product;
            }
        }
    }
    let variance = squares / (n - k as f64) / (gain / n).powi(2);
    let Some(inverse) = slope.cholesky().map(|half| half.inverse()) else {
        return (None, variance);
    };
    if cutoff.is_infinite() {
        return (Some(inverse), variance);
    }
    let freedom = n / (n - k as f64);
    (Some(inverse * influence * inverse * (freedom / variance)), variance)
}

impl Surface {
    /// A cone that opens along its axis: one whose half angle is out of its range is another one.
    fn opened(self) -> Self {
        let [cosine, sine] = self.sizes;
        if self.kind == Kind::Cone && (cosine < 0.0) != (sine < 0.0) {
            let axis = self.axis.map(|x| -x);
            return Self { axis, sizes: [cosine.abs(), sine.abs()], ..self };
        }
        self
    }

    /// A plane or cylinder with its place in the middle of the points that count.
    fn amid(self, measured: &Measured, how: &Effort) -> Self {
        let sights = || {
            measured
                .points
                .iter()
                .zip(measured.sigma)
                .map(|(point, sigma)| (point, sigma, self.sight(point)))
                .filter(|(_, sigma, at)| at.distance.abs() < how.cutoff * **sigma)
        };
        match self.kind {
            Kind::Cylinder => {
                let (low, high) = sights().fold((f64::INFINITY, f64::NEG_INFINITY), |ends, one| {
                    (ends.0.min(one.2.height), ends.1.max(one.2.height))
                });
                let middle = if low <= high { f64::midpoint(low, high) } else { 0.0 };
                Self { place: along(&self.place, &self.axis, middle), ..self }
            }
            Kind::Plane => {
                let middle = mean(sights().map(|one| one.0));
                let off = self.distance(&middle);
                Self { place: along(&middle, &self.axis, -off), ..self }
            }
            _ => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Derivatives by the parameters are those of finite differences, for each kind.
    #[test]
    fn slopes_are_those_of_differences() {
        for kind in Kind::ALL {
            let sizes = match kind {
                Kind::Cone => [0.8, 0.6],
                Kind::Torus => [0.7, 0.2],
                _ => [0.5, 0.0],
            };
            let axis = [0.6, 0.0, 0.8];
            let surface = Surface { kind, place: [0.3, -0.2, 0.1], axis, sizes };
            let frame = Frame::of(&surface, [0.1, 0.4, -0.3]);
            for point in [[0.9, 0.3, 1.2], [-0.2, 0.5, 0.9], [0.5, -0.9, 0.4]] {
                let slopes = frame.slopes(&surface, &point, &surface.sight(&point));
                for a in 0..kind.n_parameters() {
                    let h = 1e-6;
                    let at = |h: f64| {
                        let mut change = [0.0; MOST];
                        change[a] = h;
                        surface.stepped(&frame, &change).distance(&point)
                    };
                    let expected = (at(h) - at(-h)) / (2.0 * h);
                    assert!(
                        (slopes[a] - expected).abs() < 1e-8,
                        "{kind:?} {a}: {slopes:?} {expected}"
                    );
                }
            }
        }
    }
}
